//! What a pixel shows, for labels: the first surface behind the pixel's centre.

use dunkelfeld_geometry::Ray;
use dunkelfeld_scene::{RayGenerator, Scene};

/// Object and material that a pixel's centre shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Label {
    /// Index of the object in the scene, counted from 0.
    pub object: u32,
    /// Index of the material.
    pub material: u32,
}

/// The label of pixel (x, y), or `None` if its centre shows nothing. A surface that covers less than half is looked through.
pub fn label(scene: &Scene, camera: &RayGenerator, x: u32, y: u32) -> Option<Label> {
    let mut ray = camera.ray(x as f32 + 0.5, y as f32 + 0.5);
    // More sheets behind one another than anybody models: a bound on what a strange file can cost.
    for _ in 0..10_000 {
        let hit = scene.intersect(&ray)?;
        if scene.coverage(&hit) >= 0.5 {
            let (object, material) = scene.ids(&hit);
            return Some(Label { object, material });
        }
        ray = Ray::new(hit.leave(ray.direction), ray.direction);
    }
    None
}
