//! Rays through parallel layers in closed form: the ray between two heights with a given sideways shift.
//!
//! Between parallel faces the sine of the angle to the axis times the index of refraction is the same in every layer
//! (Snell 1621). A ray is parametrised by the tangent t of its angle in air, or in the layer with the lowest index n0
//! on its way. With `v_i = n_i / n0` and `q_i = sqrt(v_i^2 + (v_i^2 - 1) t^2)` its sideways shift is `r(t) = sum D_i t
//! / q_i`, where `D_i` is the sum of the heights of all crossings of layer i. This function is increasing and concave.
//! So Newton's method from below the root converges monotonically.

use dunkelfeld_bsdf::fresnel;

/// A layer that a ray crosses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// Index of refraction.
    pub ior: f64,
    /// Distance along the axis \[m\], not negative: thickness times the number of crossings.
    pub depth: f64,
}

/// Maximum number of Newton steps. Five are usual; no case is known that needs half of this number.
const MAX_STEPS: u32 = 64;

/// A ray through parallel layers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateRay {
    /// Tangent of the angle to the axis where the index of refraction is lowest.
    pub tangent: f64,
    /// The lowest index of refraction on the way.
    pub lowest: f64,
}

impl PlateRay {
    /// The ray that crosses all legs with a total sideways shift of `shift` \[m\].
    ///
    /// `None` if there is none: without any depth, or if no layer of the lowest index has a depth and total reflection
    /// limits the shift in the others.
    pub fn to_shift(legs: &[Leg], shift: f64) -> Option<Self> {
        let lowest = lowest(legs)?;
        // The slope at t = 0, the depth of the lowest index, and the largest shift of the other layers.
        let (mut slope, mut height, mut reach) = (0.0, 0.0, 0.0);
        for leg in legs {
            let v = leg.ior / lowest;
            slope += leg.depth / v;
            if v > 1.0 {
                reach += leg.depth / ((v - 1.0) * (v + 1.0)).sqrt();
            } else {
                height += leg.depth;
            }
        }
        let is_possible = slope > 0.0 && shift >= 0.0 && (height > 0.0 || shift < reach);
        if !is_possible {
            return None;
        }
        // Two bounds from below: r(t) <= slope t, and r(t) <= height t + reach.
        let mut tangent = shift / slope;
        if height > 0.0 {
            tangent = tangent.max((shift - reach) / height);
        }
        for _ in 0..MAX_STEPS {
            let ray = Self { tangent, lowest };
            // Where the index is lowest, q = v = 1.
            let (mut r, mut derivative) = (height * tangent, height);
            for leg in legs.iter().filter(|l| l.ior > lowest && l.depth > 0.0) {
                let (v, q) = ray.relative(leg.ior);
                let inverse = 1.0 / q;
                r += leg.depth * tangent * inverse;
                derivative += leg.depth * (v * inverse) * (v * inverse) * inverse;
            }
            let step = (shift - r) / derivative;
            // At the root rounding decides the sign of the step.
            let is_climbing = step > 2.0 * f64::EPSILON * tangent;
            if !is_climbing {
                break;
            }
            tangent += step;
        }
        tangent.is_finite().then_some(Self { tangent, lowest })
    }

    /// The ray with the given sine and cosine to the axis in a place of index `ior`; `None` if it cannot enter all
    /// layers, or is parallel to them.
    pub fn from_direction(legs: &[Leg], ior: f64, sine: f64, cosine: f64) -> Option<Self> {
        let lowest = lowest(legs)?.min(ior);
        // lowest^2 - p^2 for p = ior * sine, without cancellation near the horizon where both indices are equal.
        let p = ior * sine;
        let square = if ior == lowest { (ior * cosine).powi(2) } else { (lowest - p) * (lowest + p) };
        let enters = square > 0.0 && cosine > 0.0;
        enters.then(|| Self { tangent: p / square.sqrt(), lowest })
    }

    /// Cosine of the angle to the axis in a layer.
    pub fn cosine(&self, ior: f64) -> f64 {
        let (v, q) = self.relative(ior);
        q / (v * (1.0 + self.tangent * self.tangent).sqrt())
    }

    /// Sine of that angle.
    pub fn sine(&self, ior: f64) -> f64 {
        self.lowest / ior * (self.tangent / (1.0 + self.tangent * self.tangent).sqrt())
    }

    /// Tangent of that angle; infinite along the layer.
    #[inline]
    pub fn slope(&self, ior: f64) -> f64 {
        self.tangent / self.relative(ior).1
    }

    /// Sideways shift of the ray \[m\].
    pub fn shift(&self, legs: &[Leg]) -> f64 {
        legs.iter().map(|leg| leg.depth * self.slope(leg.ior)).sum()
    }

    /// The area, perpendicular to the ray at its end, per solid angle at its start [m^2/sr]; `start` and `end` are the
    /// indices of refraction there.
    ///
    /// `n_x^2 cos_x cos_y (1 + t^2)^2 / n0^2 (sum D_i / q_i) (sum D_i v_i^2 / q_i^3)`: the Jacobian of the sideways
    /// shift in polar coordinates, all of whose terms are positive. In empty space it is the squared distance. For a
    /// light at infinity see [`Self::spread_to_infinity`]. If start and end are exchanged, it changes by `n_y^2 /
    /// n_x^2`.
    pub fn spread(&self, legs: &[Leg], start: f64, end: f64) -> f64 {
        let (mut across, mut along) = (0.0, 0.0);
        for leg in legs {
            let (v, q) = self.relative(leg.ior);
            across += leg.depth / q;
            along += leg.depth * (v / q) * (v / q) / q;
        }
        let stretch = 1.0 + self.tangent * self.tangent;
        (start / self.lowest).powi(2) * self.cosine(start) * self.cosine(end) * (stretch * across) * (stretch * along)
    }

    /// The solid angle behind the layers per solid angle in front of them [sr/sr]: `n_x^2 cos_x / (n_y^2 cos_y)`.
    pub fn spread_to_infinity(&self, start: f64, end: f64) -> f64 {
        (start / end).powi(2) * self.cosine(start) / self.cosine(end)
    }

    /// Reflectance of an interface for unpolarised light; 1 for total reflection.
    pub fn reflectance(&self, from: f64, to: f64) -> f64 {
        if from == to {
            return 0.0;
        }
        let v = to / self.lowest;
        let square = v * v + (v - 1.0) * (v + 1.0) * self.tangent * self.tangent;
        if square <= 0.0 {
            return 1.0;
        }
        f64::from(fresnel::from_cosines(self.cosine(from) as f32, self.cosine(to) as f32, (to / from) as f32))
    }

    /// `v_i` and `q_i`.
    fn relative(&self, ior: f64) -> (f64, f64) {
        let v = ior / self.lowest;
        (v, (v * v + (v - 1.0) * (v + 1.0) * self.tangent * self.tangent).max(0.0).sqrt())
    }
}

/// The lowest index of refraction on the way; `None` without legs, or if one index is not positive.
fn lowest(legs: &[Leg]) -> Option<f64> {
    let lowest = legs.iter().map(|l| l.ior).fold(f64::INFINITY, f64::min);
    (lowest > 0.0 && lowest.is_finite()).then_some(lowest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use proptest::test_runner::{Config, RngSeed};

    fn config() -> Config {
        Config { cases: 500, failure_persistence: None, rng_seed: RngSeed::Fixed(1288), ..Config::default() }
    }

    fn leg(ior: f64, depth: f64) -> Leg {
        Leg { ior, depth }
    }

    /// Air, a stack of layers, and a last medium, which may be air: indices, and depths over twelve decades.
    fn any_legs() -> impl Strategy<Value = Vec<Leg>> {
        let decade = || (-6.0..6.0f64).prop_map(|e| 10f64.powf(e));
        let layer = (prop_oneof![Just(1.0), 1.0001..2.5f64, Just(1.49)], decade());
        (decade(), prop::collection::vec(layer, 0..6)).prop_map(|(first, layers)| {
            std::iter::once(leg(1.0, first)).chain(layers.into_iter().map(|(ior, depth)| leg(ior, depth))).collect()
        })
    }

    /// The sideways shift of the ray with sine `s` in the first layer, by Snell's law layer by layer, from the cosine
    /// there. The cosine avoids cancellation in `1 - s^2`.
    fn snell(legs: &[Leg], cosine: f64) -> f64 {
        let (n, s2) = (legs[0].ior, (1.0 - cosine) * (1.0 + cosine));
        let tangent = |ior: f64| {
            let sine2 = s2 * (n / ior) * (n / ior);
            let cosine2 = if ior == n { cosine * cosine } else { 1.0 - sine2 };
            (sine2 / cosine2).sqrt()
        };
        legs.iter().map(|l| l.depth * tangent(l.ior)).sum()
    }

    proptest! {
        #![proptest_config(config())]

        #[test]
        fn the_ray_reaches_its_target_for_all_proportions(legs in any_legs(), e in -6.0..6.0f64) {
            let shift = 10f64.powf(e);
            let ray = PlateRay::to_shift(&legs, shift).expect("air lets every ray through");
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
        fn rays_are_reversible(legs in any_legs(), e in -6.0..6.0f64) {
            let shift = 10f64.powf(e);
            let back: Vec<Leg> = legs.iter().rev().copied().collect();
            let (start, end) = (legs[0].ior, back[0].ior);
            let (there, back_again) = (PlateRay::to_shift(&legs, shift), PlateRay::to_shift(&back, shift));
            let (there, back_again) = (there.expect("air"), back_again.expect("air"));
            prop_assert!((there.tangent / back_again.tangent - 1.0).abs() < 1e-12);
            let (a, b) = (there.spread(&legs, start, end) * end * end, back_again.spread(&back, end, start) * start * start);
            prop_assert!((a / b - 1.0).abs() < 1e-11, "{a} against {b}");
            let (r, s) = (there.reflectance(start, end), there.reflectance(end, start));
            prop_assert!((r - s).abs() < 1e-5 && (0.0..=1.0).contains(&r));
        }

        #[test]
        fn the_spread_is_the_derivative(legs in any_legs(), angle in 0.001..1.5f64) {
            // Neighbours of a ray at a small angle in the plane of incidence, and across it.
            let (start, end) = (legs[0].ior, legs[legs.len() - 1].ior);
            let ray = PlateRay { tangent: angle.tan(), lowest: 1.0 };
            let shift = |angle: f64| PlateRay { tangent: angle.tan(), lowest: 1.0 }.shift(&legs);
            let h = 1e-5 * angle.min(1.57 - angle);
            let slope = (shift(angle + h) - shift(angle - h)) / (2.0 * h);
            // dA = r dr dphi cos_y over d omega = sin dtheta dphi.
            let expected = shift(angle) * slope * ray.cosine(end) / angle.sin();
            let spread = ray.spread(&legs, start, end);
            prop_assert!((spread / expected - 1.0).abs() < 1e-7, "{spread} against {expected}");
        }
    }

    #[test]
    fn empty_space_is_a_straight_line() {
        let ray = PlateRay::to_shift(&[leg(1.0, 3.0)], 4.0).unwrap();
        assert!((ray.tangent - 4.0 / 3.0).abs() < 1e-15);
        assert!((ray.spread(&[leg(1.0, 3.0)], 1.0, 1.0) - 25.0).abs() < 1e-12, "the squared distance");
        let straight = PlateRay::to_shift(&[leg(1.0, 1e-3), leg(1.5, 4e-3), leg(1.0, 0.2)], 0.0).unwrap();
        assert_eq!((straight.tangent, straight.cosine(1.5), straight.sine(1.5)), (0.0, 1.0, 0.0));
    }

    #[test]
    fn irradiance_under_a_plate_equals_the_closed_form() {
        // E per light area = L cos_l (1 + t^2)^(-3/2) / ((H + D / q) (H + D n^2 / q^3)) on a receiver across the axis,
        // before the faces' losses, with H the height in air and D the way in the plate of index n.
        let (n, h, d) = (1.49f64, 0.201f64, 3.0 * 0.004);
        for shift in [1e-6, 0.01, 0.2, 3.0, 100.0] {
            let legs = [leg(1.0, 0.001), leg(n, d), leg(1.0, 0.2)];
            let ray = PlateRay::to_shift(&legs, shift).unwrap();
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
        let ray = PlateRay::to_shift(&legs, 0.3).unwrap();
        assert!((1.5 * ray.sine(1.5) - ray.sine(1.0)).abs() < 1e-15 && ray.sine(1.5) < 1.0 / 1.5);
        // Almost no plate: a cone of d omega inside is one of n^2 cos_x / cos_y d omega in air.
        let thin = [leg(1.5, 1e-12), leg(1.0, 0.2)];
        let ray = PlateRay::to_shift(&thin, 0.3).unwrap();
        let (d2, c) = (0.3f64 * 0.3 + 0.04, ray.cosine(1.0));
        let expected = d2 * 2.25 * ray.cosine(1.5) / c;
        assert!((ray.spread(&thin, 1.5, 1.0) / expected - 1.0).abs() < 1e-9);
    }

    #[test]
    fn unreachable_points_have_no_ray() {
        assert_eq!(PlateRay::to_shift(&[], 0.0), None);
        assert_eq!(PlateRay::to_shift(&[leg(1.0, 0.0), leg(1.5, 0.0)], 1.0), None, "no way at all");
        assert_eq!(PlateRay::to_shift(&[leg(1.0, 1.0)], f64::NAN), None);
        // A light in contact above a receiver in contact, with no more than a film of air between: total reflection.
        let glued = [leg(1.5, 1.0), leg(1.0, 0.0)];
        let reach = 1.0 / 1.25f64.sqrt();
        assert_eq!(PlateRay::to_shift(&glued, reach * 1.000_001), None);
        let near = PlateRay::to_shift(&glued, reach * 0.999_999).unwrap();
        assert!((near.shift(&glued) / (reach * 0.999_999) - 1.0).abs() < 1e-12 && near.sine(1.0) > 0.999);
    }

    #[test]
    fn light_from_infinity_keeps_its_direction_behind_the_plate() {
        let legs = [leg(1.0, 0.001), leg(1.49, 0.004), leg(1.0, 0.0)];
        for angle in [0.0, 1e-6f64, 0.7, 1.57, 1.5705] {
            let ray = PlateRay::from_direction(&legs, 1.0, angle.sin(), angle.cos()).unwrap();
            assert!((ray.sine(1.0) - angle.sin()).abs() < 1e-15 && (ray.cosine(1.0) / angle.cos() - 1.0).abs() < 1e-13);
            assert!((ray.spread_to_infinity(1.0, 1.0) - 1.0).abs() < 1e-15, "a plate changes no solid angle");
        }
        assert_eq!(PlateRay::from_direction(&legs, 1.0, 1.0, 0.0), None, "along the faces");
        // From inside of glass no light leaves beyond the critical angle.
        let out = [leg(1.0, 1.0), leg(1.5, 1.0)];
        assert_eq!(PlateRay::from_direction(&out, 1.5, 0.7, 0.51f64.sqrt()), None);
        assert!(PlateRay::from_direction(&out, 1.5, 0.66, (1.0f64 - 0.66 * 0.66).sqrt()).is_some());
    }

    #[test]
    fn faces_reflect_by_fresnels_equations() {
        let normal = PlateRay { tangent: 0.0, lowest: 1.0 };
        assert!(
            (normal.reflectance(1.0, 1.5) - 0.04).abs() < 1e-7 && (normal.reflectance(1.5, 1.0) - 0.04).abs() < 1e-7
        );
        assert_eq!(normal.reflectance(1.5, 1.5), 0.0);
        // Brewster's angle: only the perpendicular half is left.
        let brewster = PlateRay { tangent: 1.5, lowest: 1.0 };
        let r = (1.25f64 / 3.25).powi(2) / 2.0;
        assert!((brewster.reflectance(1.0, 1.5) - r).abs() < 1e-6);
        let steep = PlateRay { tangent: 1.0, lowest: 1.5 };
        assert_eq!(steep.reflectance(1.5, 1.0), 1.0, "45 degrees in glass are beyond the critical angle");
    }
}
