//! Next-event estimation: light that reaches a vertex straight from a light.

use crate::cover::Passage;
use crate::vertex::Vertex;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Features, LightChoice, LightReceiver, LightSample, Scene};

/// The last place where light sampling and scattering both could have found a light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LastScatter {
    pub(crate) receiver: LightReceiver,
    /// Which lights were asked.
    pub(crate) choice: LightChoice,
    /// Density of the direction that was taken [1/sr].
    pub(crate) pdf: f32,
    /// The covers passed since then, in scenes that have some.
    pub(crate) passage: Option<Passage>,
}

/// Light that reaches a vertex straight from a light and is scattered toward the camera.
#[inline]
pub(crate) fn light_from<F: Features, V: Vertex>(scene: &Scene, at: &V, light: &LightSample) -> Rgb {
    let (scattered, pdf) = at.eval(light.direction);
    let unoccluded = scattered * light.radiance;
    if unoccluded.is_black() {
        return Rgb::BLACK;
    }
    let out = at.leave(light.direction);
    let ray = scene.shadow_ray_from(out.ray.origin, light.direction, light.target.as_ref());
    let (open, left) = out.light_along::<F>(scene, &ray);
    if open == 0.0 {
        return Rgb::BLACK;
    }
    let share = if light.is_delta { 1.0 } else { power_heuristic(light.pdf, pdf) };
    let arriving = unoccluded * (open * share / light.pdf);
    if F::SOLIDS { arriving * left } else { arriving }
}

/// The power heuristic with exponent 2 (Veach & Guibas 1995): the share of the technique with density `own`.
#[inline]
pub(crate) fn power_heuristic(own: f32, other: f32) -> f32 {
    if own.is_infinite() {
        return 1.0;
    }
    // Of the ratio, so that squares of large densities do not overflow.
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

#[cfg(test)]
mod tests {
    use super::power_heuristic;

    #[test]
    fn the_shares_of_two_techniques_sum_to_one() {
        for (a, b) in [(1.0, 2.0), (1e-20, 1e20), (3e30, 2e30), (5.0, 0.0)] {
            let sum = power_heuristic(a, b) + power_heuristic(b, a);
            assert!((sum - 1.0).abs() < 1e-6 || b == 0.0, "{a} and {b} sum to {sum}");
        }
        assert_eq!(power_heuristic(5.0, 0.0), 1.0);
        assert!((power_heuristic(2.0, 1.0) - 0.8).abs() < 1e-6);
    }
}
