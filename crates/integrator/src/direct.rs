//! Next-event estimation along straight lines from a vertex to a light.

use crate::mnee::SpecularPrefix;
use crate::vertex::Vertex;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Features, LightChoice, LightSample, LightSampleContext, Scene};

/// The last vertex at which light sampling and scattering could both have sampled a light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LastScatter {
    pub(crate) receiver: LightSampleContext,
    /// The choice of lights at that vertex.
    pub(crate) choice: LightChoice,
    /// Density of the sampled direction [1/sr].
    pub(crate) pdf: f32,
    /// The smooth interfaces of covers that the path has passed since then; `None` in scenes without covers.
    pub(crate) passage: Option<SpecularPrefix>,
}

/// Russian roulette on a shadow ray, before the ray is traced (Veach 1997, section 10.4). A light sample that would add
/// almost nothing to the radiance gathered so far is traced with a probability in proportion to its contribution, and
/// its weight increases accordingly. Without it, most shadow rays of long paths would be traced for such samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShadowRoulette {
    /// Largest channel of the throughput, over the limit of the roulette: [`Self::LITTLE`] times the largest channel of
    /// the gathered radiance \[m^2 sr/W\]. 0 if every shadow ray is traced.
    worth: f32,
    /// A number in `[0, 1)` for one light sample only.
    u: f32,
}

impl ShadowRoulette {
    /// The roulette applies to contributions below this share of the gathered radiance f. It adds no more than (f /
    /// 32)^2 / 4 to the variance of a sample, which is little also where light is smooth. A limit at f itself would
    /// more than double the noise of matt rooms.
    const LITTLE: f32 = 1.0 / 32.0;

    /// Smallest survival probability. It limits the weight of a sample.
    const LEAST: f32 = 1.0 / 16.0;

    /// No roulette: every shadow ray is traced.
    pub(crate) const NONE: Self = Self { worth: 0.0, u: 0.0 };

    /// The roulette for a path with the given `throughput` that has gathered `found` \[W/(m^2 sr)\] before this vertex.
    #[inline]
    pub(crate) fn new(throughput: Rgb, found: Rgb, u: impl FnOnce() -> f32) -> Self {
        let found = found.max_channel();
        if found > 0.0 { Self { worth: throughput.max_channel() / (Self::LITTLE * found), u: u() } } else { Self::NONE }
    }

    /// The survival probability of a light sample with the expected contribution `light` \[W/(m^2 sr)\] at the vertex;
    /// `None` if its shadow ray is not traced.
    #[inline]
    pub(crate) fn survival(&self, light: Rgb) -> Option<f32> {
        let part = self.worth * light.max_channel();
        // Samples that are not a number survive, so that the film can count them.
        let is_little = part < 1.0;
        if self.worth == 0.0 || !is_little {
            return Some(1.0);
        }
        let survival = part.max(Self::LEAST);
        (self.u < survival).then_some(survival)
    }
}

/// Next-event estimation: light of a light sample that reaches a vertex on a straight line and is scattered toward the
/// camera.
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

/// The power heuristic with exponent 2 (Veach & Guibas 1995): the weight of the technique with density `own`.
#[inline]
pub(crate) fn power_heuristic(own: f32, other: f32) -> f32 {
    if own.is_infinite() {
        return 1.0;
    }
    // A ratio, so that squares of large densities do not overflow.
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

#[cfg(test)]
mod tests {
    use super::{ShadowRoulette, power_heuristic};
    use dunkelfeld_radiometry::Rgb;

    #[test]
    fn a_light_sample_survives_in_proportion_to_its_contribution() {
        let survival = |throughput, found, light, u| {
            ShadowRoulette::new(Rgb::splat(throughput), Rgb::splat(found), || u).survival(Rgb::splat(light))
        };
        // A 32nd of the gathered radiance or more: certain survival. Nothing gathered yet: certain survival.
        for u in [0.0, 0.5, 0.99] {
            assert_eq!(survival(0.5, 64.0, 4.0, u), Some(1.0));
            assert_eq!(survival(0.5, 64.0, 400.0, u), Some(1.0));
            assert_eq!(survival(0.5, 0.0, 1e-9, u), Some(1.0));
        }
        // A quarter of that limit: survival for a quarter of the numbers.
        assert_eq!(survival(0.5, 64.0, 1.0, 0.24), Some(0.25));
        assert_eq!(survival(0.5, 64.0, 1.0, 0.26), None);
        // Values that are not a number survive.
        for (found, light) in
            [(64.0, f32::NAN), (1e-42, 0.0), (f32::NAN, 1.0), (f32::INFINITY, 1.0), (64.0, f32::INFINITY)]
        {
            assert_eq!(survival(0.5, found, light, 0.99), Some(1.0), "{found} {light}");
        }
        // Contributions near zero and of exactly zero survive with the smallest probability.
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
