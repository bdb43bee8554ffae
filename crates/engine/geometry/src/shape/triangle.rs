//! Triangles: solid angle and sampling by solid angle (Arvo 1995) or area (Heitz 2019).

use dunkelfeld_lanes::{Double, Lanes, Mask, Real, V3};
use glam::Vec3;

use super::{IN_PLANE, MIN_SOLID_ANGLE, ShapeSample};

/// Samples a triangle from `reference`: uniformly by solid angle, or by area below 1e-6 sr.
pub fn sample_triangle(corners: &[Vec3; 3], reference: Vec3, u: [f32; 2]) -> Option<ShapeSample> {
    let (point, coordinates, pdf) = TriangleLanes::<f32>::new(corners, reference.into()).sample(u);
    (pdf > 0.0).then_some(ShapeSample { point: point.into(), coordinates, pdf })
}

/// Density per solid angle [1/sr] with which [`sample_triangle`] returns `point`, a point on the triangle.
pub fn pdf_triangle(corners: &[Vec3; 3], reference: Vec3, point: Vec3) -> f32 {
    TriangleLanes::<f32>::new(corners, reference.into()).pdf(point.into())
}

/// The random numbers for which [`sample_triangle`] returns the point with these weights of the second and third corner;
/// `None` where it returns nothing.
pub fn invert_triangle(corners: &[Vec3; 3], reference: Vec3, weights: [f32; 2]) -> Option<[f32; 2]> {
    let TriangleLanes { view, is_by_solid_angle, .. } = TriangleLanes::<f32>::new(corners, reference.into());
    let invert = || if is_by_solid_angle { view.invert(weights.map(f64::from)) } else { invert_triangle_area(weights) };
    view.is_seen.any().then(invert)
}

/// A triangle as seen from a reference, per lane.
pub struct TriangleLanes<F: Lanes> {
    view: View<F::Double>,
    is_by_solid_angle: F::Mask,
    reference: V3<F::Double>,
    corner: V3<F::Double>,
}

impl<F: Lanes> TriangleLanes<F> {
    /// The same triangle in all lanes.
    #[inline(always)]
    pub fn new([v0, v1, v2]: &[Vec3; 3], reference: V3<F>) -> Self {
        let token = reference.x.token();
        let corner = V3::<F>::splat(token, *v0).widen();
        let edges = [V3::<F>::splat(token, *v1).widen() - corner, V3::<F>::splat(token, *v2).widen() - corner];
        let reference = reference.widen();
        let view = View::new(corner - reference, edges);
        let least = view.height.constant(MIN_SOLID_ANGLE as f32);
        let is_by_solid_angle = F::Double::narrow_mask(view.solid_angle.ge(least));
        Self { view, is_by_solid_angle, reference, corner }
    }

    /// See [`sample_triangle`]: a point, the weights of the second and third corner, and the density, which is zero where
    /// there is no sample.
    #[inline(always)]
    pub fn sample(&self, u: [F; 2]) -> (V3<F>, [F; 2], F) {
        let mut weights = sample_triangle_area(u);
        if self.is_by_solid_angle.any() {
            let [b1, b2] = self.view.sample([F::Double::widen(u[0]), F::Double::widen(u[1])]);
            weights[0] = self.is_by_solid_angle.select(b1.narrow(), weights[0]);
            weights[1] = self.is_by_solid_angle.select(b2.narrow(), weights[1]);
        }
        let [b1, b2] = [F::Double::widen(weights[0]), F::Double::widen(weights[1])];
        let point = V3::narrow(self.corner + self.view.e1 * b1 + self.view.e2 * b2);
        (point, weights, self.pdf(point))
    }

    /// See [`pdf_triangle`].
    #[inline(always)]
    pub fn pdf(&self, point: V3<F>) -> F {
        let View { normal, height, solid_angle, is_seen, .. } = &self.view;
        // By area: `d^2 / (A cos) = d^3 / (A h)`.
        let d2 = (point.widen() - self.reference).length_squared();
        let by_area = d2 * d2.sqrt() / (normal.length() * height.constant(0.5) * *height);
        let pdf = self.is_by_solid_angle.select(solid_angle.recip().narrow(), by_area.narrow());
        pdf.only(F::Double::narrow_mask(*is_seen) & pdf.is_finite())
    }
}

/// Uniform by area: the weights of the second and third corner. The density is 1 / area.
///
/// The map of Heitz, "A low-distortion map between triangle and square" (2019), which keeps strata compact.
#[inline(always)]
pub fn sample_triangle_area<F: Lanes>([u, v]: [F; 2]) -> [F; 2] {
    // The square is folded along its diagonal onto the triangle; each half keeps its shape up to a shear.
    let (half_u, half_v, is_above) = (u * 0.5, v * 0.5, v.gt(u));
    [is_above.select(half_u, u - half_v), is_above.select(v - half_u, half_v)]
}

/// Density of [`sample_triangle_area`] with respect to the two weights: 2 inside the triangle.
#[inline]
pub fn pdf_triangle_area([b1, b2]: [f32; 2]) -> f32 {
    if b1 >= 0.0 && b2 >= 0.0 && b1 + b2 <= 1.0 { 2.0 } else { 0.0 }
}

/// The random numbers that give the weights in [`sample_triangle_area`].
#[inline]
pub fn invert_triangle_area([b1, b2]: [f32; 2]) -> [f32; 2] {
    let [u, v] = if b2 > b1 { [2.0 * b1, b1 + b2] } else { [b1 + b2, 2.0 * b2] };
    [u.clamp(0.0, 1.0), v.clamp(0.0, 1.0)]
}

/// A triangle on the unit sphere around a reference point.
///
/// Arvo (1995) cuts off a triangle of the wanted area by a great circle through one corner, then samples a point on
/// that circle. The cut is written without the inner angles, whose arc cosines lose half of the digits in a small
/// triangle. For corners A, B, C let C' on the arc AC be the reflection of A in `o = p A + q C`. Then `tan(area(A, B,
/// C') / 2) = [A B o] / ((A + B) . o)`, which is linear in p and q. So `p = [A B C] cos f - (AC + BC) sin f`, `q = (1 +
/// AB) sin f` with f half of the wanted area (the form in which Peters 2021 samples polygons).
struct View<N: Real> {
    /// Unit vectors to the corners.
    a: V3<N>,
    b: V3<N>,
    c: V3<N>,
    /// Absolute triple product of the unit vectors.
    triple: N,
    solid_angle: N,
    /// From the reference to the first corner, and the two edges from that corner.
    to_v0: V3<N>,
    e1: V3<N>,
    e2: V3<N>,
    /// `e1 x e2`; its length is twice the area.
    normal: V3<N>,
    /// Distance of the reference from the triangle's plane.
    height: N,
    /// False where the triangle is degenerate or seen edge-on. Then the angles mean nothing.
    is_seen: N::Mask,
}

impl<N: Real> View<N> {
    #[inline(always)]
    fn new(to_v0: V3<N>, [e1, e2]: [V3<N>; 2]) -> Self {
        let normal = e1.cross(e2);
        let (a, b, c) = (to_v0, to_v0 + e1, to_v0 + e2);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let volume = a.dot(normal).abs();
        let height = volume / normal.length();
        // A NaN (no area, a reference that is not finite or on a corner) fails this comparison too.
        let is_seen = height.gt(la.max(lb).max(lc) * height.constant(IN_PLANE as f32)) & height.is_finite();
        let (a, b, c) = (a / la, b / lb, c / lc);
        let (triple, one) = (volume / (la * lb * lc), la.constant(1.0));
        let solid_angle = N::angle(one + a.dot(b) + b.dot(c) + c.dot(a), triple) * la.constant(2.0);
        Self { a, b, c, triple, solid_angle, to_v0, e1, e2, normal, height, is_seen }
    }

    /// Weights of the second and third corner, uniform by solid angle.
    #[inline(always)]
    fn sample(&self, [u, v]: [N; 2]) -> [N; 2] {
        let Self { a, b, c, .. } = *self;
        let (zero, half, one, two) = (u.constant(0.0), u.constant(0.5), u.constant(1.0), u.constant(2.0));
        let (cos, sin) = N::cos_sin(half * u * self.solid_angle);
        let o = a * (self.triple * cos - (a.dot(c) + b.dot(c)) * sin) + c * ((one + a.dot(b)) * sin);
        let cut = o * (two * a.dot(o) / o.length_squared()) - a;

        // From B towards C', uniform in the cosine (Archimedes); 1 - cos is kept, not cos.
        let towards = cut - b;
        let one_minus_cos_max = half * towards.length_squared();
        let tangent = (towards + b * one_minus_cos_max).normalize_or(V3::new(zero, zero, zero));
        let one_minus_cos = v * one_minus_cos_max;
        let sin = (one_minus_cos * (two - one_minus_cos)).max(zero).sqrt();
        let direction = b * one_minus_cos.one_minus() + tangent * sin;

        // Down to the plane, in weights, so that rounding cannot leave the triangle.
        let t = self.to_v0.dot(self.normal) / direction.dot(self.normal);
        let in_plane = direction * t - self.to_v0;
        let n = self.normal / self.normal.length_squared();
        let b1 = in_plane.cross(self.e2).dot(n).max(zero).min(one);
        [b1, self.e1.cross(in_plane).dot(n).max(zero).min(b1.one_minus())]
    }
}

impl View<f64> {
    /// The inverse of [`Self::sample`].
    fn invert(&self, [b1, b2]: [f64; 2]) -> [f32; 2] {
        let (a, b, c, zero) = (self.a, self.b, self.c, V3::new(0.0, 0.0, 0.0));
        let direction = (self.to_v0 + self.e1 * b1 + self.e2 * b2).normalize();
        // C' is where the great circle from B through the direction meets the one through A and C.
        let cut = b.cross(direction).cross(a.cross(c)).normalize_or(zero);
        let cut = if cut.dot(a + c) < 0.0 { -cut } else { cut };
        let triple = a.dot(b.cross(cut)).abs();
        let u = 2.0 * triple.atan2(1.0 + a.dot(b) + b.dot(cut) + cut.dot(a)) / self.solid_angle;
        // 1 - cos by the chord.
        let v = (direction - b).length_squared() / (cut - b).length_squared();
        [u, v].map(|f| if f > 0.0 { f.min(1.0) as f32 } else { 0.0 })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// The solid angle [sr] that a triangle subtends at a point.
    pub(in crate::shape) fn triangle_solid_angle(corners: &[Vec3; 3], reference: Vec3) -> f32 {
        let TriangleLanes { view, .. } = TriangleLanes::<f32>::new(corners, reference.into());
        view.solid_angle.only(view.is_seen) as f32
    }

    fn corners() -> [Vec3; 3] {
        [Vec3::new(0.1, 0.2, 1.0), Vec3::new(1.3, -0.1, 1.2), Vec3::new(0.4, 0.9, 0.7)]
    }

    fn references() -> Vec<Vec3> {
        let [a, b, c] = corners();
        let n = crate::geometric_normal(&corners());
        let mut all = Vec::new();
        for (b1, b2) in [(0.3, 0.3), (0.0, 0.0), (1.0, 0.0), (0.5, 0.5), (-0.02, 0.3), (2.0, 2.0), (-4.0, 0.1)] {
            for h in [1e-4, 1e-2, -0.3, 1.0, -7.0, 400.0] {
                all.push(a + b1 * (b - a) + b2 * (c - a) + h * n);
            }
        }
        all
    }

    #[test]
    fn an_octant_is_an_eighth_of_the_sphere() {
        let octant = [Vec3::X, Vec3::Y, Vec3::Z];
        let want = std::f32::consts::PI / 2.0;
        assert!((triangle_solid_angle(&octant, Vec3::ZERO) - want).abs() < 1e-6);
        assert_eq!(triangle_solid_angle(&[Vec3::X, Vec3::Y, -Vec3::X], Vec3::ZERO), 0.0, "in its plane");
        // Small and far: area cos / d^2.
        let small = octant.map(|v| 1e-3 * v + Vec3::splat(100.0));
        let want = crate::triangle_area(&small) / (3.0 * 1e4);
        assert!((triangle_solid_angle(&small, Vec3::ZERO) / want - 1.0).abs() < 1e-3);
    }

    #[test]
    fn the_density_of_a_sample_is_that_of_pdf_to_the_bit() {
        for p in references() {
            for k in 0..64 {
                let u = [(k as f32 + 0.5) / 64.0, (k as f32 * 0.618_034).fract()];
                let s = sample_triangle(&corners(), p, u).unwrap();
                assert_eq!(s.pdf.to_bits(), pdf_triangle(&corners(), p, s.point).to_bits(), "from {p} with {u:?}");
                assert!(s.coordinates[0] >= 0.0 && s.coordinates[1] >= 0.0);
                assert!(s.coordinates[0] + s.coordinates[1] <= 1.0 + f32::EPSILON);
            }
        }
    }

    #[test]
    fn degenerate_views_have_no_sample_and_near_degenerate_ones_are_finite() {
        let t = [Vec3::ZERO, Vec3::X, Vec3::Y];
        for p in [Vec3::ZERO, Vec3::new(0.2, 0.2, 0.0), Vec3::new(9.0, 1.0, 0.0), Vec3::NAN, Vec3::INFINITY] {
            assert_eq!(sample_triangle(&t, p, [0.4, 0.4]), None, "from {p}");
            assert_eq!(pdf_triangle(&t, p, Vec3::ZERO), 0.0);
        }
        assert_eq!(sample_triangle(&[Vec3::ZERO, Vec3::X, 2.0 * Vec3::X], Vec3::Z, [0.4, 0.4]), None, "no area");
        for h in [1e-3, 1e-5, 1e-7, 1e-9, 1e-12] {
            for p in [Vec3::new(0.0, 0.0, h), Vec3::new(0.3, 0.3, -h), Vec3::new(5.0, 1.0, h)] {
                for u in [[0.0, 0.0], [0.3, 0.9], [1.0 - f32::EPSILON / 2.0; 2]] {
                    if let Some(s) = sample_triangle(&t, p, u) {
                        assert!(s.pdf > 0.0 && s.pdf.is_finite() && s.point.is_finite(), "{s:?} from {p}");
                    }
                }
            }
        }
    }
}
