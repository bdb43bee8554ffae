//! Watertight intersection of a ray and a triangle, the position of the hit, and the start of the next ray.
//!
//! The test is that of Woop, Benthin & Wald, "Watertight ray/triangle intersection" (JCGT 2013). A ray becomes the axis
//! of a sheared coordinate system, in which the signs of three edge functions decide. Every product is rounded once and
//! no operation is fused, so two triangles that share an edge compute the same number with opposite signs. Rounding is
//! monotone: a computed sign is right or the result is zero. A zero is decided in f64, where the products are exact.
//!
//! The second part is the distance of the hit. In f32, `t` near zero may be rounding. Pharr, Jakob & Humphreys (2016,
//! section 3.9.6) reject hits below their error bound, and so lose real surfaces a few micrometres away. Here such a
//! hit is decided in f64. So a ray hits a film of a micrometre, and does not hit the surface that it has just left. A
//! hit near the end of a ray is also decided in f64: a shadow ray that ends just before a light, almost parallel to it,
//! must not hit that light.

use dunkelfeld_lanes::{Double, Lanes, Mask, Real, V3};
use glam::{DVec3, Vec3};

use crate::Ray;

/// Largest relative error of one f32 rounding (half the distance from 1 to the next number).
pub const UNIT_ROUNDOFF: f32 = 0.5 * f32::EPSILON;

/// Bound on the relative error of `n` f32 roundings in a row (Higham 2002, lemma 3.1).
#[inline]
pub const fn gamma(n: u32) -> f32 {
    let nu = n as f32 * UNIT_ROUNDOFF;
    nu / (1.0 - nu)
}

/// Intersection of a ray and a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    /// Ray parameter of the hit.
    pub t: f32,
    /// Barycentric weight of the second corner.
    pub b1: f32,
    /// Barycentric weight of the third corner.
    pub b2: f32,
}

/// Values of a ray for the watertight test, computed once per ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayShear {
    /// Permutation of the axes: the third one is the direction's largest component.
    pub axes: [usize; 3],
    /// The ray's origin in the permuted axes.
    pub origin: [f32; 3],
    /// `d_x / d_z`, `d_y / d_z` and `1 / d_z` in the permuted axes.
    pub shear: [f32; 3],
}

/// The permuted axes of each largest axis. A swap of the first two for negative directions, which keeps the winding, would
/// only negate all edge functions.
const AXES: [[usize; 3]; 3] = [[1, 2, 0], [2, 0, 1], [0, 1, 2]];

impl RayShear {
    /// The shear that maps the ray's direction to the third axis. A zero direction gives non-finite values, which hit nothing.
    #[inline]
    pub fn new(ray: &Ray) -> Self {
        let (d, o) = (ray.direction.to_array(), ray.origin.to_array());
        let [kx, ky, kz] = shear_axes(ray.direction);
        let inv = 1.0 / d[kz];
        Self { axes: [kx, ky, kz], origin: [o[kx], o[ky], o[kz]], shear: [d[kx] * inv, d[ky] * inv, inv] }
    }
}

/// [`RayShear::axes`] of a direction.
#[inline]
pub fn shear_axes(direction: Vec3) -> [usize; 3] {
    let a = direction.abs();
    // Arithmetic and a table replace branches, because a branch predictor cannot predict the direction of a ray.
    let largest = if a.x >= a.y.max(a.z) { 0 } else { 1 + usize::from(a.y < a.z) };
    AXES[largest]
}

/// The three edge functions of a sheared triangle in f64, for the case that one is zero in f32.
///
/// `x` and `y` are the sheared corners. The products of two f32 are exact in f64, so the signs are exact.
#[inline]
pub fn edge_functions_f64(x: [f32; 3], y: [f32; 3]) -> [f32; 3] {
    let [ax, bx, cx] = x.map(f64::from);
    let [ay, by, cy] = y.map(f64::from);
    let keep_sign = |e: f64| {
        // With an underflow to zero a clear miss would become a hit on the edge.
        let f = e as f32;
        if f == 0.0 && e != 0.0 { f32::from_bits(1).copysign(e as f32) } else { f }
    };
    [cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax].map(keep_sign)
}

/// The parameter at which a ray crosses a triangle's plane, in f64; zero if the side cannot be decided even in f64.
///
/// Called when `t` lies within the error bound of the f32 result from either end of the ray. With e1, e2 the edges and
/// a = v0 - o, `t = (e1 x e2 . a) / (e1 x e2 . d)`. Differences of f32 and their triple product have a relative error
/// below 8 units of roundoff of the sum of absolute terms.
#[inline]
pub fn plane_distance_f64(ray: &Ray, corners: &[Vec3; 3]) -> f32 {
    PlaneF64::new(corners).distance::<f32>(ray.origin.into(), ray.direction.into())
}

/// The plane of a triangle for [`plane_distance_f64`] of several rays.
#[derive(Clone, Copy, Debug)]
pub struct PlaneF64 {
    corner: DVec3,
    /// Cross product of the edges, and the sums of the absolute values of its terms.
    normal: DVec3,
    magnitude: DVec3,
}

impl PlaneF64 {
    /// The plane through three corners.
    #[inline]
    pub fn new(corners: &[Vec3; 3]) -> Self {
        let corner = corners[0].as_dvec3();
        let (e1, e2) = (corners[1].as_dvec3() - corner, corners[2].as_dvec3() - corner);
        let (left, right) =
            (DVec3::new(e1.y * e2.z, e1.z * e2.x, e1.x * e2.y), DVec3::new(e1.z * e2.y, e1.x * e2.z, e1.y * e2.x));
        Self { corner, normal: left - right, magnitude: left.abs() + right.abs() }
    }

    /// [`plane_distance_f64`] of rays, given by their origins and directions.
    #[inline(always)]
    pub fn distance<F: Lanes>(&self, origin: V3<F>, direction: V3<F>) -> F {
        let token = origin.x.token();
        let (normal, magnitude) = (splat::<F>(token, self.normal), splat::<F>(token, self.magnitude));
        let to_corner = splat::<F>(token, self.corner) - origin.widen();
        let numerator = normal.dot(to_corner);
        let bound = magnitude.dot(to_corner.abs()) * (4.0 * f64::EPSILON);
        let distance = (numerator / normal.dot(direction.widen())).narrow();
        let is_undecided = F::Double::narrow_mask(numerator.abs().le(bound));
        is_undecided.select(distance.constant(0.0), distance)
    }
}

#[inline(always)]
fn splat<F: Lanes>(token: F::Token, v: DVec3) -> V3<F::Double> {
    V3::<F>::splat_double(token, V3::new(v.x, v.y, v.z))
}

/// `t` of the watertight test may be off by this factor times `(x y + (x + y) z) z / |det|`, where x, y and z are the
/// largest absolute sheared coordinates.
///
/// Pharr, Jakob & Humphreys (2016, section 3.9.6) bound the error by
/// `3 (g3 e z + de z + dz e) / |det|` with `dz = g3 z`, `dx = g5 (x + z)`, `dy = g5 (y + z)`,
/// `de = 2 (g2 x y + dy x + dx y)` and e the largest edge function. With `e <= 2 x y` this is at most
/// `u (108 x y + 30 (x + y) z) z / |det|`; the rest of 128 covers the rounding of the bound.
pub const T_ERROR: f32 = 128.0 * UNIT_ROUNDOFF;

/// The watertight test: the hit with `0 < t < ray.t_max`, from either side.
///
/// Hits on an edge or corner belong to every triangle that shares it; no ray passes between. Triangles that are edge-on
/// to the ray are never hit, nor those with a NaN.
#[inline]
pub fn intersect_triangle(shear: &RayShear, ray: &Ray, corners: &[Vec3; 3]) -> Option<TriangleHit> {
    let [kx, ky, kz] = shear.axes;
    let [ox, oy, oz] = shear.origin;
    let [sx, sy, sz] = shear.shear;
    let from_origin = corners.map(|c| [c[kx] - ox, c[ky] - oy, c[kz] - oz]);
    let x = from_origin.map(|p| p[0] - sx * p[2]);
    let y = from_origin.map(|p| p[1] - sy * p[2]);
    let z = from_origin.map(|p| sz * p[2]);

    let inside = |e: &[f32; 3]| e.iter().all(|&e| e >= 0.0) || e.iter().all(|&e| e <= 0.0);
    let mut e = [x[2] * y[1] - y[2] * x[1], x[0] * y[2] - y[0] * x[2], x[1] * y[0] - y[1] * x[0]];
    if !inside(&e) {
        return None;
    }
    if e.contains(&0.0) {
        e = edge_functions_f64(x, y);
        if !inside(&e) {
            return None;
        }
    }

    let inv_det = 1.0 / ((e[0] + e[1]) + e[2]);
    let t = ((e[0] * z[0] + e[1] * z[1]) + e[2] * z[2]) * inv_det;
    let largest = |v: [f32; 3]| v[0].abs().max(v[1].abs()).max(v[2].abs());
    let (mx, my, mz) = (largest(x), largest(y), largest(z));
    let t_error = T_ERROR * ((mx * my + (mx + my) * mz) * mz) * inv_det.abs();
    // Comparisons are written so that a NaN (no area: 0/0) is a miss.
    if !(t >= -t_error && t < ray.t_max) {
        return None;
    }
    let t = if t <= t_error || t >= ray.t_max - t_error { plane_distance_f64(ray, corners) } else { t };
    (t > 0.0 && t < ray.t_max).then_some(TriangleHit { t, b1: e[1] * inv_det, b2: e[2] * inv_det })
}

/// Unit normal of a triangle by its winding, or zero if it has no area. It is computed in f64, so that it is precise
/// for slivers too.
#[inline]
pub fn geometric_normal(corners: &[Vec3; 3]) -> Vec3 {
    let v0 = corners[0].as_dvec3();
    let n = (corners[1].as_dvec3() - v0).cross(corners[2].as_dvec3() - v0);
    n.normalize_or_zero().as_vec3()
}

/// Area of a triangle [m^2], computed in f64.
#[inline]
pub fn triangle_area(corners: &[Vec3; 3]) -> f32 {
    let v0 = corners[0].as_dvec3();
    (0.5 * (corners[1].as_dvec3() - v0).cross(corners[2].as_dvec3() - v0).length()) as f32
}

/// Smallest error of a coordinate \[m\]. A plane through the origin has no rounding error. An error of zero would leave the
/// next ray on the surface, and a subnormal one would make all arithmetic with its origin a hundred times slower.
pub(crate) const MIN_ERROR: f32 = 1e-30;

/// The point with barycentric weights `b1` and `b2` (of the second and third corner), and the half widths of a box that
/// contains the point of the triangle's plane with exactly these weights.
#[inline]
pub fn hit_point(corners: &[Vec3; 3], b1: f32, b2: f32) -> (Vec3, Vec3) {
    let (point, error) = hit_points::<f32>(&corners.map(V3::from), b1, b2);
    (point.into(), error.into())
}

/// [`hit_point`] in lanes.
///
/// `v0 + b1 (v1 - v0) + b2 (v2 - v0)` lies in the plane for *any* b1 and b2, so their own error moves the point within
/// the plane and not off it. Evaluated in f64 the expression has at most four roundings in a row, and one to f32 at the
/// end: `|error| <= u |p| + 4 u64 (|v0| + |b1 e1| + |b2 e2|)`. That is a seventh of the bound of f32 arithmetic (Pharr,
/// Jakob & Humphreys 2016, section 3.9.4: gamma(7)). The difference is important if surfaces lie micrometres apart or a
/// kilometre from the origin.
#[inline(always)]
pub fn hit_points<F: Lanes>(corners: &[V3<F>; 3], b1: F, b2: F) -> (V3<F>, V3<F>) {
    let token = b1.token();
    let v0 = corners[0].widen();
    let along1 = (corners[1].widen() - v0) * F::Double::widen(b1);
    let along2 = (corners[2].widen() - v0) * F::Double::widen(b2);
    let exact = v0 + along1 + along2;
    let terms = v0.abs() + along1.abs() + along2.abs();
    let error = exact.abs() * F::Double::splat(token, f64::from(UNIT_ROUNDOFF))
        + terms * F::Double::splat(token, 2.0 * f64::EPSILON);
    // At least one ulp more for the rounding of the bound itself.
    let error = V3::<F>::narrow(error) * b1.constant(1.0 + f32::EPSILON) + V3::splat(token, Vec3::splat(MIN_ERROR));
    (V3::narrow(exact), error)
}

/// The start of a ray that leaves a surface: outside the error box of the hit, on the side of `direction`.
///
/// The point moves along the unit normal by the extent of the error box in that direction and is then rounded away from
/// the surface (Pharr, Jakob & Humphreys 2016, section 3.9.5). Pass the *geometric* normal; its sign does not matter.
/// If `direction` lies in the surface, the side is that of the normal.
#[inline]
pub fn offset_ray_origin(p: Vec3, p_error: Vec3, geometric_normal: Vec3, direction: Vec3) -> Vec3 {
    offset_ray_origins::<f32>(p.into(), p_error.into(), geometric_normal.into(), direction.into()).into()
}

/// [`offset_ray_origin`] in lanes.
#[inline(always)]
pub fn offset_ray_origins<F: Lanes>(p: V3<F>, p_error: V3<F>, geometric_normal: V3<F>, direction: V3<F>) -> V3<F> {
    let is_behind = direction.dot(geometric_normal).lt(p.x.constant(0.0));
    let n = V3::select(is_behind, -geometric_normal, geometric_normal);
    // The factor covers the rounding error of the length of n.
    let offset = n * (n.abs().dot(p_error) * (1.0 + 8.0 * UNIT_ROUNDOFF));
    let moved = p + offset;
    V3::new(away(moved.x, offset.x), away(moved.y, offset.y), away(moved.z, offset.z))
}

/// The next number after `x` in the direction of the sign of `by`; `x` itself if `by` is zero. It has no branches,
/// because the direction is unpredictable where rays leave a surface.
#[inline(always)]
fn away<F: Lanes>(x: F, by: F) -> F {
    let zero = x.constant(0.0);
    // Bit patterns of one sign are ordered like the magnitudes. Zero steps to the smallest number of the sign of `by`.
    let inward = (x.to_bits() ^ by.to_bits()) >> 31;
    let stepped = F::from_bits(x.to_bits() + 1 - (inward << 1));
    let stepped = x.eq(zero).select(F::from_bits((by.to_bits() & (1 << 31)) | 1), stepped);
    by.eq(zero).select(x, stepped)
}

/// The next number above one that is not negative.
#[inline(always)]
pub(crate) fn next_up<F: Lanes>(x: F) -> F {
    x.is_finite().select(F::from_bits(x.to_bits() + 1), x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(seed: &mut u64) -> f32 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 40) as f32 / 8_388_608.0 - 1.0
    }

    fn point(seed: &mut u64) -> Vec3 {
        Vec3::new(random(seed), random(seed), random(seed))
    }

    fn hit(ray: &Ray, corners: &[Vec3; 3]) -> Option<TriangleHit> {
        intersect_triangle(&RayShear::new(ray), ray, corners)
    }

    #[test]
    fn hits_have_the_right_distance_and_weights_from_both_sides() {
        let corners = [Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 4.0, 0.0)];
        for side in [1.0, -1.0] {
            let ray = Ray::new(Vec3::new(0.5, 1.0, 3.0 * side), -side * Vec3::Z);
            assert_eq!(hit(&ray, &corners), Some(TriangleHit { t: 3.0, b1: 0.25, b2: 0.25 }));
            assert_eq!(hit(&Ray { t_max: 3.0, ..ray }, &corners), None, "t_max itself is outside");
            assert_eq!(hit(&Ray { direction: side * Vec3::Z, ..ray }, &corners), None, "behind");
        }
        assert_eq!(hit(&Ray::new(Vec3::new(0.5, 1.0, 0.0), Vec3::Z), &corners), None, "t = 0 is no hit");
        assert_eq!(hit(&Ray::new(Vec3::new(0.5, -1.0, 0.0), Vec3::Y), &corners), None, "edge-on is no hit");
    }

    /// A fan around a point: a ray at an edge or at the centre must hit one of the triangles at least.
    #[test]
    fn rays_at_shared_edges_and_corners_hit_one_of_the_triangles() {
        let mut seed = 1;
        for round in 0..20_000 {
            let scale = [1e-12f32, 1e-4, 1.0, 1e6, 1e12][round % 5];
            let away = if round % 3 == 0 { 100.0 * scale * point(&mut seed) } else { Vec3::ZERO };
            let frame = crate::Frame::from_normal(point(&mut seed).normalize());
            let rim: Vec<Vec3> = (0..7)
                .map(|k| {
                    let a = std::f32::consts::TAU * (k as f32 + 0.3 * random(&mut seed)) / 7.0;
                    let bump = 0.2 * random(&mut seed);
                    away + scale * frame.to_world(crate::LocalDir::new(a.cos(), a.sin(), bump))
                })
                .collect();
            let centre = away + 0.1 * scale * point(&mut seed);
            let f = 0.5 * (random(&mut seed) + 1.0);
            let target = if round % 2 == 0 { centre } else { centre.lerp(rim[0], 0.9 * f) };
            let origin = away + scale * (4.0 * frame.normal + point(&mut seed));
            let ray = Ray::new(origin, (target - origin).normalize());
            let hits = (0..7).filter(|&k| hit(&ray, &[centre, rim[k], rim[(k + 1) % 7]]).is_some()).count();
            assert!(hits >= 1, "round {round}: {ray:?} slips between triangles around {centre}");
        }
    }

    #[test]
    fn a_sheet_one_nanometre_away_is_hit_and_the_own_plane_is_not() {
        // A metre-sized triangle through the origin, where such a distance can be represented.
        let mut seed = 2;
        let corners = [Vec3::new(-0.5, -0.4, 0.0), Vec3::new(0.6, -0.5, 0.0), Vec3::new(0.0, 0.7, 0.0)];
        for _ in 0..100_000 {
            let start = 0.1 * Vec3::new(random(&mut seed), random(&mut seed), 0.0);
            let d = Vec3::new(random(&mut seed), random(&mut seed), random(&mut seed).abs().max(1e-3)).normalize();
            assert_eq!(hit(&Ray::new(start, d), &corners), None, "from the plane itself");
            assert_eq!(hit(&Ray::new(start + 1e-9 * Vec3::Z, d), &corners), None, "leaving");
            let below = Ray::new(start - 1e-9 * Vec3::Z, d);
            let t = 1e-9 / d.z;
            assert!(hit(&below, &corners).is_some_and(|h| (h.t - t).abs() < 1e-3 * t), "{below:?} should hit at {t}");
        }
    }

    #[test]
    fn the_error_box_of_a_hit_holds_the_exact_point_and_an_offset_clears_the_plane() {
        let mut seed = 3;
        for round in 0..100_000 {
            let scale = 10f32.powf(4.0 * random(&mut seed));
            let far = if round % 2 == 0 { Vec3::ZERO } else { 1000.0 * point(&mut seed) };
            let corners = [0; 3].map(|_| far + scale * point(&mut seed));
            let (b1, b2) = (0.5 * (random(&mut seed) + 1.0), 0.5 * (random(&mut seed) + 1.0));
            let (p, error) = hit_point(&corners, b1, b2);
            let [v0, v1, v2] = corners.map(|c| c.as_dvec3());
            let exact = v0 + f64::from(b1) * (v1 - v0) + f64::from(b2) * (v2 - v0);
            assert!((p.as_dvec3() - exact).abs().cmple(error.as_dvec3()).all(), "round {round}: {p} off {exact}");
            assert!(error.cmple(1e-7 * p.abs() + 1e-13 * Vec3::splat(scale + 1000.0)).all(), "the bound is tight");

            let n = geometric_normal(&corners);
            let d = point(&mut seed);
            if n == Vec3::ZERO {
                continue;
            }
            let start = offset_ray_origin(p, error, n, d);
            let normal = (v1 - v0).cross(v2 - v0).normalize();
            let height = normal.dot(start.as_dvec3() - v0) * f64::from(d.dot(n)).signum();
            assert!(height > 0.0, "round {round}: the start lies {height} above the plane");
            let ulp = f64::from(f32::EPSILON) * exact.abs().max_element();
            assert!(height < 4.0 * ulp + 1e-12, "round {round}: {height} is farther than the rounding error");
        }
    }

    #[test]
    fn rays_that_end_before_a_plane_they_run_along_do_not_reach_it() {
        // Over a triangle of a metre, at angles down to 1e-5 rad: a ray that ends just before the plane misses it, and
        // one that ends just behind it hits. The distance is a few roundings of its direction across the plane.
        let corners = [Vec3::new(0.0, -1.0, -1.0), Vec3::new(0.0, 1.0, -1.0), Vec3::new(0.0, 0.0, 1.5)];
        let mut seed = 4;
        for round in 0..20_000 {
            let height = 10f32.powf(-3.0 + 2.0 * random(&mut seed));
            let from = Vec3::new(height, 0.3 * random(&mut seed), -0.8);
            let to = Vec3::new(0.0, 0.1 * random(&mut seed), 0.5 * random(&mut seed));
            let way = to - from;
            let ray = Ray::new(from, way.normalize());
            let crossing = f64::from(height) / -f64::from(ray.direction.x);
            let hair = 1e-6 * crossing;
            let ends = |t: f64| hit(&Ray { t_max: t as f32, ..ray }, &corners).is_some();
            assert!(
                !ends(crossing - hair),
                "round {round}: met before its end, at an angle of {}",
                height / way.length()
            );
            assert!(ends(crossing * (1.0 + 1e-2)), "round {round}: passed through");
        }
    }

    #[test]
    fn degenerate_triangles_and_rays_are_missed() {
        let good = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let from = Vec3::new(0.2, 0.2, 1.0);
        for bad in [[Vec3::ZERO; 3], [Vec3::NAN, Vec3::X, Vec3::Y], [Vec3::INFINITY, Vec3::X, Vec3::Y]] {
            assert_eq!(hit(&Ray::new(from, -Vec3::Z), &bad), None);
        }
        for d in [Vec3::ZERO, Vec3::NAN, Vec3::new(0.0, 0.0, f32::NEG_INFINITY)] {
            assert_eq!(hit(&Ray::new(from, d), &good), None);
        }
        assert_eq!(geometric_normal(&[Vec3::ZERO, Vec3::X, 2.0 * Vec3::X]), Vec3::ZERO);
        assert_eq!(triangle_area(&good), 0.5);
    }
}
