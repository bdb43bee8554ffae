//! What a pixel shows, for labels: the first surface behind the pixel's centre that scatters light.

use crate::ray_state::RayState;
use crate::vertex::{SurfaceVertex, Vertex};
use dunkelfeld_scene::{AllFeatures, RayGenerator, Scene};
use std::num::NonZeroU32;

/// Object and material that a pixel's centre shows. An `Option` of it takes 8 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Label {
    /// Index of the object plus one.
    object: NonZeroU32,
    material: u32,
}

impl Label {
    /// Of indices that are counted from 0; that of the object is below `u32::MAX`.
    pub fn new(object: u32, material: u32) -> Self {
        Self { object: NonZeroU32::MIN.saturating_add(object), material }
    }

    /// Index of the object in the scene, counted from 0.
    pub fn object(&self) -> u32 {
        self.object.get() - 1
    }

    /// Index of the material.
    pub fn material(&self) -> u32 {
        self.material
    }
}

/// The label of pixel (x, y), or `None` if its centre shows nothing. A surface that covers less than half is looked through,
/// and a smooth clear one too, in the direction that more light takes; it is shown where nothing lies behind it.
pub fn label(scene: &Scene, camera: &RayGenerator, x: u32, y: u32) -> Option<Label> {
    let mut walk = RayState::from_camera::<AllFeatures>(scene, camera.ray(x as f32 + 0.5, y as f32 + 0.5));
    let mut glass = None;
    // More sheets behind one another than anybody models: a bound on what a strange file can cost.
    for _ in 0..10_000 {
        let (mut interface, mut bsdf) = (None, None);
        let Some(met) = walk.intersect_next::<AllFeatures>(scene, &mut interface) else { break };
        if met.open_tint().is_some() || scene.coverage(&met.hit) < 0.5 {
            walk = walk.pass_through::<AllFeatures>(&met);
            continue;
        }
        let (object, material) = scene.ids(&met.hit);
        let here = Label::new(object, material);
        let at = SurfaceVertex::<AllFeatures>::new(scene, walk, met, 0.5, &mut bsdf);
        let Some(passed) = at.delta(0.5) else { return Some(here) };
        glass = glass.or(Some(here));
        walk = at.leave(passed.wi);
    }
    glass
}
