//! Ids of a pixel: object and material of the first surface behind the centre of the pixel that scatters light.

use crate::ray_state::RayState;
use crate::vertex::{SurfaceVertex, Vertex};
use dunkelfeld_scene::{AllFeatures, Moment, RayGenerator, Scene};
use std::num::NonZeroU32;

/// Object and material at the centre of a pixel. An `Option` of it takes 8 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelIds {
    /// Index of the object plus one.
    object: NonZeroU32,
    material: u32,
}

impl PixelIds {
    /// From indices counted from 0. The index of the object is below `u32::MAX`.
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

/// The ids of pixel (x, y), or `None` if no surface lies behind its centre. The ray passes a surface whose coverage is
/// below one half. It also passes a smooth clear surface, in the direction that carries more light. The ids of the
/// first such clear surface are returned if no other surface lies behind it. Moving objects are at the middle of the
/// exposure.
pub fn pixel_ids(scene: &Scene, camera: &RayGenerator, x: u32, y: u32) -> Option<PixelIds> {
    let Moment { time, y } =
        scene.shutter().map_or(Moment { time: 0.0, y: y as f32 + 0.5 }, |shutter| shutter.middle(y));
    let ray = camera.ray(x as f32 + 0.5, y).at_time(time);
    let mut ray_state = RayState::from_camera::<AllFeatures>(scene, ray);
    let mut first_clear = None;
    // Upper bound on the cost of a hostile file. No real scene has so many sheets behind one another.
    for _ in 0..10_000 {
        let (mut interface, mut bsdf) = (None, None);
        let Some(hit) = ray_state.intersect_next::<AllFeatures>(scene, &mut interface) else { break };
        if hit.open_tint().is_some() || scene.coverage(&hit.surface, ray_state.ray.direction) < 0.5 {
            ray_state = ray_state.pass_through::<AllFeatures>(&hit);
            continue;
        }
        let (object, material) = scene.ids(&hit.surface);
        let here = PixelIds::new(object, material);
        let at = SurfaceVertex::<AllFeatures>::new(scene, ray_state, hit, 0.5, &mut bsdf);
        let Some(passed) = at.delta(0.5) else { return Some(here) };
        first_clear = first_clear.or(Some(here));
        ray_state = at.spawn_ray(passed.wi);
    }
    first_clear
}
