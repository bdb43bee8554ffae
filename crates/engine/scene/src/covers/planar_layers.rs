//! Rays through parallel layers in closed form: the ray between two heights with a given sideways shift.
//!
//! Between parallel faces the sine of the angle to the axis times the index of refraction is the same in every layer
//! (Snell 1621). A ray is parametrised by the tangent t of its angle in air, or in the layer with the lowest index n0
//! on its way. With `v_i = n_i / n0` and `q_i = sqrt(1 + (v_i^2 - 1) (1 + t^2))` its sideways shift is `r(t) = sum D_i
//! t / q_i`, where `D_i` is the sum of the heights of all crossings of layer i. This function is increasing and concave.
//! So Newton's method from below the root converges monotonically.
//!
//! The layers are the same in all lanes, their depths are not. The indices of refraction below are relative: `v_i`, at
//! least 1.

use dunkelfeld_bsdf::fresnel;
use dunkelfeld_lanes::{Mask, Real};

/// A layer that a ray crosses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Leg<R> {
    /// Index of refraction over the lowest one on the way.
    pub(super) index: f32,
    /// Distance along the axis \[m\], not negative: thickness times the number of crossings.
    pub(super) depth: R,
}

/// Maximum number of Newton steps. At most five are usual; no case is known that needs half of this number.
const MAX_STEPS: u32 = 64;

/// A ray through parallel layers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PlateRay<R> {
    /// Tangent of the angle to the axis where the index of refraction is lowest.
    pub(super) tangent: R,
}

impl<R: Real> PlateRay<R> {
    /// The ray that crosses all legs with a total sideways shift of `shift` \[m\], and whether there is one.
    ///
    /// There is none without any depth, or if no layer of the lowest index has a depth and total reflection limits the
    /// shift in the others.
    #[inline(always)]
    pub(super) fn to_shift(legs: &[Leg<R>], shift: R) -> (Self, R::Mask) {
        let zero = shift.constant(0.0);
        // The slope at t = 0, the depth of the lowest index, and the largest shift of the other layers.
        let (mut slope, mut height, mut reach) = (zero, zero, zero);
        for leg in legs {
            if leg.index > 1.0 {
                slope = slope + leg.depth / shift.constant(leg.index);
                reach = reach + leg.depth / excess(shift, leg.index).sqrt();
            } else {
                height = height + leg.depth;
            }
        }
        slope = slope + height;
        let is_possible =
            slope.is_positive() & zero.le(shift) & (height.is_positive() | shift.lt(reach)) & shift.is_finite();
        // Two bounds from below: r(t) <= slope t, and r(t) <= height t + reach.
        let tangent = shift / slope;
        let mut tangent = height.is_positive().select(tangent.max((shift - reach) / height), tangent);
        // The relative error after a step is at most 1.5 times the square of the step.
        let tolerance = shift.epsilon().sqrt() * shift.constant(0.25);
        let mut is_climbing = is_possible;
        for _ in 0..MAX_STEPS {
            let ray = Self { tangent };
            let (mut r, mut derivative) = (height * tangent, height);
            for leg in legs {
                // Where the index is lowest, q = v = 1.
                if leg.index > 1.0 {
                    let inverse = ray.root(leg.index).recip();
                    r = r + leg.depth * tangent * inverse;
                    derivative = derivative + leg.depth * cubed(inverse, leg.index);
                }
            }
            let step = (shift - r) / derivative;
            tangent = is_climbing.select(tangent + step, tangent);
            is_climbing = is_climbing & step.gt(tolerance * tangent);
            if !is_climbing.any() {
                break;
            }
        }
        (Self { tangent }, is_possible & tangent.is_finite())
    }

    /// The ray with the given sine and cosine to the axis in a layer, and whether there is one: it enters all layers,
    /// and is not parallel to them.
    #[inline(always)]
    pub(super) fn from_direction(index: f32, sine: R, cosine: R) -> (Self, R::Mask) {
        // 1 - p^2 for p = index * sine, without cancellation near the horizon where the index is lowest.
        let p = sine * sine.constant(index);
        let square = if index > 1.0 { p.one_minus() * (p + p.constant(1.0)) } else { cosine * cosine };
        (Self { tangent: p / square.sqrt() }, square.is_positive() & cosine.is_positive())
    }

    /// `q_i`. The cosine of the angle to the axis is `q_i / (v_i sqrt(1 + t^2))`, the sine `t / (v_i sqrt(1 + t^2))`.
    #[inline(always)]
    pub(super) fn root(&self, index: f32) -> R {
        let one = self.tangent.constant(1.0);
        if index > 1.0 { (one + excess(one, index) * self.stretch()).sqrt() } else { one }
    }

    /// Tangent of the angle to the axis in a layer.
    #[inline(always)]
    pub(super) fn slope(&self, index: f32) -> R {
        self.tangent / self.root(index)
    }

    /// The area, perpendicular to the ray at its end, per solid angle at its start [m^2/sr]; `start` and `end` are the
    /// indices of refraction there.
    ///
    /// `v_x / v_y q_x q_y (1 + t^2) (sum D_i / q_i) (sum D_i v_i^2 / q_i^3)`: the Jacobian of the sideways shift in
    /// polar coordinates, all of whose terms are positive. In empty space it is the squared distance. For a light at
    /// infinity see [`Self::spread_to_infinity`]. If start and end are exchanged, it changes by `v_y^2 / v_x^2`.
    #[inline(always)]
    pub(super) fn spread(&self, legs: &[Leg<R>], start: f32, end: f32) -> R {
        let (mut across, mut along) = (self.tangent.constant(0.0), self.tangent.constant(0.0));
        for leg in legs {
            let inverse = self.root(leg.index).recip();
            across = across + leg.depth * inverse;
            along = along + leg.depth * cubed(inverse, leg.index);
        }
        let ratio = across.constant(start) / across.constant(end);
        (ratio * self.root(start) * across) * (self.root(end) * along) * self.stretch()
    }

    /// The solid angle behind the layers per solid angle in front of them [sr/sr]: `v_x q_x / (v_y q_y)`.
    #[inline(always)]
    pub(super) fn spread_to_infinity(&self, start: f32, end: f32) -> R {
        let [x, y] = [self.tangent.constant(start), self.tangent.constant(end)];
        (x * self.root(start)) / (y * self.root(end))
    }

    /// Reflectance of an interface for unpolarised light. No reflection is total, since the ray enters all layers.
    #[inline(always)]
    pub(super) fn reflectance(&self, from: f32, to: f32) -> R {
        // The cosines times one factor.
        let [x, y] = [self.tangent.constant(from), self.tangent.constant(to)];
        fresnel::from_cosines(self.root(from) * y, self.root(to) * x, y / x)
    }

    /// `1 + t^2`.
    #[inline(always)]
    fn stretch(&self) -> R {
        self.tangent.constant(1.0) + self.tangent * self.tangent
    }
}

/// `v^2 - 1`, in the lanes of `x`.
#[inline(always)]
fn excess<R: Real>(x: R, index: f32) -> R {
    let (v, one) = (x.constant(index), x.constant(1.0));
    (v - one) * (v + one)
}

/// `v^2 / q^3`, from `1 / q`.
#[inline(always)]
fn cubed<R: Real>(inverse: R, index: f32) -> R {
    let share = inverse * inverse.constant(index);
    share * share * inverse
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use proptest::test_runner::{Config, RngSeed};

    fn config() -> Config {
        Config { cases: 500, failure_persistence: None, rng_seed: RngSeed::Fixed(1288), ..Config::default() }
    }

    fn leg(index: f32, depth: f64) -> Leg<f64> {
        Leg { index, depth }
    }

    /// The ray to a shift, if there is one.
    fn to_shift(legs: &[Leg<f64>], shift: f64) -> Option<PlateRay<f64>> {
        let (ray, is_some) = PlateRay::to_shift(legs, shift);
        is_some.any().then_some(ray)
    }

    impl PlateRay<f64> {
        fn cosine(&self, index: f32) -> f64 {
            self.root(index) / (f64::from(index) * self.stretch().sqrt())
        }

        fn sine(&self, index: f32) -> f64 {
            self.tangent / (f64::from(index) * self.stretch().sqrt())
        }

        fn shift(&self, legs: &[Leg<f64>]) -> f64 {
            legs.iter().map(|leg| leg.depth * self.slope(leg.index)).sum()
        }
    }

    /// Air, a stack of layers, and a last medium, which may be air: indices, and depths over twelve decades.
    fn any_legs() -> impl Strategy<Value = Vec<Leg<f64>>> {
        let decade = || (-6.0..6.0f64).prop_map(|e| 10f64.powf(e));
        let layer = (prop_oneof![Just(1.0), 1.0001..2.5f32, Just(1.49)], decade());
        (decade(), prop::collection::vec(layer, 0..6)).prop_map(|(first, layers)| {
            std::iter::once(leg(1.0, first)).chain(layers.into_iter().map(|(index, depth)| leg(index, depth))).collect()
        })
    }

    /// The sideways shift of the ray with sine `s` in the first layer, by Snell's law layer by layer, from the cosine
    /// there. The cosine avoids cancellation in `1 - s^2`.
    fn snell(legs: &[Leg<f64>], cosine: f64) -> f64 {
        let (n, s2) = (f64::from(legs[0].index), (1.0 - cosine) * (1.0 + cosine));
        let tangent = |ior: f64| {
            let sine2 = s2 * (n / ior) * (n / ior);
            let cosine2 = if ior == n { cosine * cosine } else { 1.0 - sine2 };
            (sine2 / cosine2).sqrt()
        };
        legs.iter().map(|l| l.depth * tangent(l.index.into())).sum()
    }

    proptest! {
        #![proptest_config(config())]

        #[test]
        fn the_ray_reaches_its_target_for_all_proportions(legs in any_legs(), e in -6.0..6.0f64) {
            let shift = 10f64.powf(e);
            let ray = to_shift(&legs, shift).expect("air lets every ray through");
            prop_assert!((ray.shift(&legs) / shift - 1.0).abs() < 1e-13, "{} for {shift}", ray.shift(&legs));
            // The same ray by bisection on the logarithm of the tangent in air, where the index is lowest.
            let (mut low, mut high) = (-60.0f64, 60.0f64);
            for _ in 0..200 {
                let middle = 0.5 * (low + high);
                let cosine = 1.0 / middle.exp().hypot(1.0);
                if snell(&legs, cosine) < shift { low = middle } else { high = middle }
            }
            // Near the normal the bisection depends on 1 - cos^2. Its rounding limits the comparison.
            let tolerance = 1e-12 + 4e-16 / ray.tangent.powi(2).min(1.0);
            prop_assert!((ray.tangent / low.exp() - 1.0).abs() < tolerance, "{} against {}", ray.tangent, low.exp());
        }

        #[test]
        fn the_spread_is_the_derivative(legs in any_legs(), angle in 0.001..1.5f64) {
            // Neighbours of a ray at a small angle in the plane of incidence, and across it.
            let (start, end) = (legs[0].index, legs[legs.len() - 1].index);
            let ray = PlateRay { tangent: angle.tan() };
            let shift = |angle: f64| PlateRay { tangent: angle.tan() }.shift(&legs);
            let h = 1e-5 * angle.min(1.57 - angle);
            let slope = (shift(angle + h) - shift(angle - h)) / (2.0 * h);
            // dA = r dr dphi cos_y over d omega = sin dtheta dphi.
            let expected = shift(angle) * slope * ray.cosine(end) / angle.sin();
            let spread = ray.spread(&legs, start, end);
            prop_assert!((spread / expected - 1.0).abs() < 1e-7, "{spread} against {expected}");
        }
    }

    #[test]
    fn irradiance_under_a_plate_equals_the_closed_form() {
        // E per light area = L cos_l (1 + t^2)^(-3/2) / ((H + D / q) (H + D n^2 / q^3)) on a receiver across the axis,
        // before the faces' losses, with H the height in air and D the way in the plate of index n.
        let (n, h, d) = (f64::from(1.49f32), 0.201f64, 3.0 * 0.004);
        for shift in [1e-6, 0.01, 0.2, 3.0, 100.0] {
            let legs = [leg(1.0, 0.001), leg(1.49, d), leg(1.0, 0.2)];
            let ray = to_shift(&legs, shift).unwrap();
            let t = ray.tangent;
            let q = (n * n + (n * n - 1.0) * t * t).sqrt();
            assert!((h * t + d * t / q - shift).abs() < 1e-14 * shift);
            let textbook = (1.0 + t * t).powf(-1.5) / ((h + d / q) * (h + d * n * n / q.powi(3)));
            let ours = ray.cosine(1.0) / ray.spread(&legs, 1.0, 1.0);
            assert!((ours / textbook - 1.0).abs() < 1e-13, "shift {shift}: {ours}, {textbook}");
        }
    }

    #[test]
    fn optical_contact_starts_inside() {
        // Inside the plate the ray is steeper than in air. The solid angle of the light at the receiver is
        // smaller by n^2.
        let legs = [leg(1.5, 0.004), leg(1.0, 0.2)];
        let ray = to_shift(&legs, 0.3).unwrap();
        assert!((1.5 * ray.sine(1.5) - ray.sine(1.0)).abs() < 1e-15 && ray.sine(1.5) < 1.0 / 1.5);
        // Almost no plate: a cone of d omega inside is one of n^2 cos_x / cos_y d omega in air.
        let thin = [leg(1.5, 1e-12), leg(1.0, 0.2)];
        let ray = to_shift(&thin, 0.3).unwrap();
        let (d2, c) = (0.3f64 * 0.3 + 0.04, ray.cosine(1.0));
        let expected = d2 * 2.25 * ray.cosine(1.5) / c;
        assert!((ray.spread(&thin, 1.5, 1.0) / expected - 1.0).abs() < 1e-9);
    }

    #[test]
    fn faces_reflect_by_fresnels_equations() {
        let normal = PlateRay { tangent: 0.0 };
        assert!(
            (normal.reflectance(1.0, 1.5) - 0.04).abs() < 1e-7 && (normal.reflectance(1.5, 1.0) - 0.04).abs() < 1e-7
        );
        assert_eq!(normal.reflectance(1.5, 1.5), 0.0);
        // Brewster's angle: only the perpendicular half is left.
        let brewster = PlateRay { tangent: 1.5 };
        let r = (1.25f64 / 3.25).powi(2) / 2.0;
        assert!((brewster.reflectance(1.0, 1.5) - r).abs() < 1e-6);
        let grazing = PlateRay { tangent: 1e9 };
        assert!((grazing.reflectance(1.0, 1.5) - 1.0).abs() < 1e-8);
    }
}
