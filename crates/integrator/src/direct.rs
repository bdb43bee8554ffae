//! Next-event estimation: light that reaches a vertex straight from a light.

use crate::mnee::SpecularPrefix;
use crate::vertex::Vertex;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Features, LightChoice, LightSample, LightSampleContext, Scene};

/// The last place where light sampling and scattering both could have found a light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LastScatter {
    pub(crate) receiver: LightSampleContext,
    /// Which lights were asked.
    pub(crate) choice: LightChoice,
    /// Density of the direction that was taken [1/sr].
    pub(crate) pdf: f32,
    /// The covers passed since then, in scenes that have some.
    pub(crate) passage: Option<SpecularPrefix>,
}

/// Roulette on a question for light, before it is seen whether anything is in the way (Veach 1997, section 10.4). What would
/// bring next to nothing beside what the path has found so far is asked with a probability in proportion, and counts for more:
/// most rays of long paths would be sent for it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShadowRoulette {
    /// Largest channel of what the path carries, over the part of what it has found below which roulette is played
    /// \[m^2 sr/W\]; 0 where every question is asked.
    worth: f32,
    /// A number in `[0, 1)`, for one question alone.
    u: f32,
}

impl ShadowRoulette {
    /// Roulette is played for less than this part of what was found, f. It adds no more than (f / 32)^2 / 4 to the variance of a
    /// sample, which is little also where light is smooth; below f itself it would more than double the noise of matt rooms.
    const LITTLE: f32 = 1.0 / 32.0;

    /// No question is asked with less than this, so that none counts for much more than it is worth.
    const LEAST: f32 = 1.0 / 16.0;

    /// Every question is asked.
    pub(crate) const NONE: Self = Self { worth: 0.0, u: 0.0 };

    /// The stake of a path that carries `throughput` and has found `found` \[W/(m^2 sr)\] before this vertex.
    #[inline]
    pub(crate) fn new(throughput: Rgb, found: Rgb, u: impl FnOnce() -> f32) -> Self {
        let found = found.max_channel();
        if found > 0.0 { Self { worth: throughput.max_channel() / (Self::LITTLE * found), u: u() } } else { Self::NONE }
    }

    /// The probability with which a question is asked that is expected to bring `light` \[W/(m^2 sr)\] to the vertex; `None` if
    /// it is not asked.
    #[inline]
    pub(crate) fn survival(&self, light: Rgb) -> Option<f32> {
        let part = self.worth * light.max_channel();
        // What is not a number is asked as well, so that the film can count it.
        let is_little = part < 1.0;
        if self.worth == 0.0 || !is_little {
            return Some(1.0);
        }
        let survival = part.max(Self::LEAST);
        (self.u < survival).then_some(survival)
    }
}

/// Light that reaches a vertex straight from a light and is scattered toward the camera.
#[inline]
pub(crate) fn light_from<F: Features, V: Vertex>(
    scene: &Scene,
    at: &V,
    light: &LightSample,
    roulette: ShadowRoulette,
) -> Rgb {
    let (scattered, pdf) = at.eval(light.direction);
    let unoccluded = scattered * light.radiance;
    if unoccluded.is_black() {
        return Rgb::BLACK;
    }
    let share = if light.is_delta { 1.0 } else { power_heuristic(light.pdf, pdf) };
    let expected = unoccluded * (share / light.pdf);
    let Some(survival) = roulette.survival(expected) else { return Rgb::BLACK };
    let out = at.leave(light.direction);
    let ray = scene.shadow_ray_from(out.ray.origin, light.direction, light.target.as_ref());
    let (open, left) = out.light_along::<F>(scene, &ray);
    if open == 0.0 {
        return Rgb::BLACK;
    }
    let arriving = expected * (open / survival);
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
    use super::{ShadowRoulette, power_heuristic};
    use dunkelfeld_radiometry::Rgb;

    #[test]
    fn a_question_is_asked_in_proportion_to_what_it_may_bring() {
        let survival = |throughput, found, light, u| {
            ShadowRoulette::new(Rgb::splat(throughput), Rgb::splat(found), || u).survival(Rgb::splat(light))
        };
        // A 32nd of what was found, or more: always. Nothing found yet: always.
        for u in [0.0, 0.5, 0.99] {
            assert_eq!(survival(0.5, 64.0, 4.0, u), Some(1.0));
            assert_eq!(survival(0.5, 64.0, 400.0, u), Some(1.0));
            assert_eq!(survival(0.5, 0.0, 1e-9, u), Some(1.0));
        }
        // A quarter of that: for a quarter of the numbers.
        assert_eq!(survival(0.5, 64.0, 1.0, 0.24), Some(0.25));
        assert_eq!(survival(0.5, 64.0, 1.0, 0.26), None);
        // What is not a number is not lost.
        for (found, light) in
            [(64.0, f32::NAN), (1e-42, 0.0), (f32::NAN, 1.0), (f32::INFINITY, 1.0), (64.0, f32::INFINITY)]
        {
            assert_eq!(survival(0.5, found, light, 0.99), Some(1.0), "{found} {light}");
        }
        // Next to nothing, or nothing as far as one can tell.
        for light in [1e-9, 0.0] {
            assert_eq!(survival(0.5, 2.0, light, 0.06), Some(ShadowRoulette::LEAST));
            assert_eq!(survival(0.5, 2.0, light, 0.07), None);
        }
    }

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
