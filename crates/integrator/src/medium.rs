//! A vertex in a medium: light straight from a light, and a direction to go on in.

use crate::path::{LastScatter, power_heuristic};
use dunkelfeld_geometry::Vec3;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Interior, LightChoice, LightReceiver, LightSample, Medium, Scene};

/// From this scattering in media on, a path survives each with less than certainty. It is late: light in a dense medium that
/// absorbs nothing is scattered some thousand times before it finds out, and a walk cut short would weigh the rest.
const ENDLESS: u32 = 4096;
/// Survival of such a path.
const ENDLESS_SURVIVAL: f32 = 0.995;

/// A place inside a medium where light is scattered.
pub(crate) struct MediumVertex<'a> {
    pub(crate) medium: &'a Medium,
    /// Position in render space.
    pub(crate) point: Vec3,
    /// Direction toward the camera.
    pub(crate) wo: Vec3,
    /// The solids around the place.
    pub(crate) around: &'a Interior,
}

impl MediumVertex<'_> {
    /// The vertex as lights see it: without a surface, open to all sides.
    pub(crate) fn receiver(&self) -> LightReceiver {
        LightReceiver { point: self.point, normal: Vec3::ZERO, both_sides: true }
    }

    /// Light that reaches the vertex straight from a light and is scattered toward `wo`.
    pub(crate) fn direct_light(&self, scene: &Scene, light: &LightSample) -> Rgb {
        let phase = self.medium.phase.pdf(self.wo, light.direction);
        let unoccluded = light.radiance * phase;
        if unoccluded.is_black() {
            return Rgb::BLACK;
        }
        let ray = scene.shadow_ray_from(self.point, light.direction, light.target.as_ref());
        let share = if light.is_delta { 1.0 } else { power_heuristic(light.pdf, phase) };
        unoccluded * scene.light_through(&ray, self.around) * (share / light.pdf)
    }

    /// A direction to go on in, with its density [1/sr] and the lights that were asked; its weight is one.
    pub(crate) fn scatter(&self, choice: LightChoice, u: [f32; 2]) -> (Vec3, LastScatter) {
        let wi = self.medium.phase.sample(self.wo, u);
        (wi, LastScatter { receiver: self.receiver(), choice, pdf: self.medium.phase.pdf(self.wo, wi) })
    }
}

/// The probability with which a path of this weight, scattered in media so many times, goes on.
pub(crate) fn survival(weight: f32, scatterings: u32) -> f32 {
    weight.min(if scatterings < ENDLESS { 1.0 } else { ENDLESS_SURVIVAL })
}
