//! Affine transforms between an object's space and the world's, with bounds of their rounding errors.
//!
//! Coordinates are f32, but the matrix and its inverse are stored and applied in f64. Each result is then rounded once.
//! So a mesh one kilometre from the origin keeps the accuracy of its own object space. A transform and its inverse
//! cancel without the mismatch of an f32 inverse and its f32 matrix.

use dunkelfeld_lanes::{Double, Lanes, Real, V3};
use glam::{DAffine3, DMat3, DVec3, Vec3};

use crate::Ray;
use crate::triangle::{MIN_ERROR, next_up};

/// Half the distance from 1 to the next f64: the relative error of one rounding.
const UNIT_ROUNDOFF_64: f64 = 0.5 * f64::EPSILON;
/// Half the distance from 1 to the next f32.
const UNIT_ROUNDOFF_32: f64 = 0.5 * f32::EPSILON as f64;

/// Reason why a matrix is no transform.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TransformError {
    /// An element is NaN or infinite, or exceeds the range of f32.
    #[error("the transform has an element that is not a finite number")]
    NotFinite,
    /// It maps space to a plane, a line or a point, so it has no inverse.
    #[error("the transform is singular: it flattens space and has no inverse")]
    Singular,
}

/// An invertible affine map from object space to world space.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Transform {
    to_world: DAffine3,
    to_object: DAffine3,
}

impl Default for Transform {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Transform {
    /// The identity.
    pub const IDENTITY: Self = Self { to_world: DAffine3::IDENTITY, to_object: DAffine3::IDENTITY };

    /// A transform from its object-to-world map.
    ///
    /// # Errors
    /// [`TransformError::NotFinite`] for elements (of the map or its inverse) that are no finite f32;
    /// [`TransformError::Singular`] when the determinant is below 1e-12 of the product of the columns' lengths, a
    /// measure that no scale, uniform or not, can change.
    pub fn new(to_world: DAffine3) -> Result<Self, TransformError> {
        let fits = |m: &DAffine3| m.to_cols_array().iter().all(|&x| (x as f32).is_finite());
        if !fits(&to_world) {
            return Err(TransformError::NotFinite);
        }
        let m = to_world.matrix3;
        let volume = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
        if m.determinant().abs() <= 1e-12 * volume {
            return Err(TransformError::Singular);
        }
        let to_object = to_world.inverse();
        if fits(&to_object) { Ok(Self { to_world, to_object }) } else { Err(TransformError::NotFinite) }
    }

    /// A transform from its map and the inverse of it.
    #[inline]
    pub(crate) fn from_inverse_pair(to_world: DAffine3, to_object: DAffine3) -> Self {
        Self { to_world, to_object }
    }

    /// The object-to-world map.
    #[inline]
    pub fn to_world(&self) -> &DAffine3 {
        &self.to_world
    }

    /// The world-to-object map.
    #[inline]
    pub fn to_object(&self) -> &DAffine3 {
        &self.to_object
    }

    /// True if it is the identity.
    #[inline]
    pub fn is_identity(&self) -> bool {
        self.to_world == DAffine3::IDENTITY
    }

    /// The inverse: world to object becomes object to world.
    #[inline]
    pub fn inverse(&self) -> Self {
        Self { to_world: self.to_object, to_object: self.to_world }
    }

    /// An object-space point in the world, correctly rounded except for the last bits of f64.
    #[inline]
    pub fn point(&self, p: Vec3) -> Vec3 {
        self.to_world.transform_point3(p.as_dvec3()).as_vec3()
    }

    /// An object-space vector (a difference of points: an edge, a tangent) in the world; its length changes with the
    /// scale.
    #[inline]
    pub fn vector(&self, v: Vec3) -> Vec3 {
        self.to_world.transform_vector3(v.as_dvec3()).as_vec3()
    }

    /// An object-space normal in the world, of unit length (zero if `n` is zero or not finite).
    ///
    /// It is transformed by the inverse transpose, so it stays perpendicular to the surface. Under a mirroring
    /// transform it keeps its side of the surface, while the normal from the winding of transformed corners changes
    /// sides: see [`Transform::swaps_handedness`].
    #[inline]
    pub fn normal(&self, n: Vec3) -> Vec3 {
        self.normals::<f32>(n.into()).into()
    }

    /// [`Self::normal`] in lanes.
    #[inline(always)]
    pub fn normals<F: Lanes>(&self, n: V3<F>) -> V3<F> {
        let (token, moved) = (n.x.token(), self.covectors::<F>(n.x.token(), n.widen()));
        let length = moved.length();
        let inverse = length.recip();
        let is_some = F::Double::narrow_mask(length.is_finite() & inverse.is_finite());
        V3::select(is_some, V3::narrow(moved * inverse), V3::splat(token, Vec3::ZERO))
    }

    /// Vectors in the world, in double precision: see [`Self::vector`].
    #[inline(always)]
    pub fn vectors<F: Lanes>(&self, token: F::Token, v: V3<F::Double>) -> V3<F::Double> {
        linear::<F>(token, &self.to_world.matrix3, v)
    }

    /// Normals in the world, in double precision and not of unit length: see [`Self::normal`].
    #[inline(always)]
    pub fn covectors<F: Lanes>(&self, token: F::Token, n: V3<F::Double>) -> V3<F::Double> {
        let m = &self.to_object.matrix3;
        V3::new(
            V3::<F>::splat_double(token, v3(m.x_axis)).dot(n),
            V3::<F>::splat_double(token, v3(m.y_axis)).dot(n),
            V3::<F>::splat_double(token, v3(m.z_axis)).dot(n),
        )
    }

    /// True if it mirrors, so that a counter-clockwise triangle becomes clockwise.
    #[inline]
    pub fn swaps_handedness(&self) -> bool {
        self.to_world.matrix3.determinant() < 0.0
    }

    /// A world-space ray in object space. `t` has the same meaning, so the direction is not of unit length.
    #[inline]
    pub fn ray(&self, ray: &Ray) -> Ray {
        Ray {
            origin: self.to_object.transform_point3(ray.origin.as_dvec3()).as_vec3(),
            direction: self.to_object.transform_vector3(ray.direction.as_dvec3()).as_vec3(),
            t_max: ray.t_max,
            time: ray.time,
        }
    }

    /// A world-space ray in object space with a direction of unit length, and the factor `s` with `t_object = s *
    /// t_world` (`t_max` is scaled with it).
    ///
    /// A direction of unit length prevents overflow and underflow in a traversal at any scale of the instance.
    #[inline]
    pub fn unit_ray(&self, ray: &Ray) -> (Ray, f32) {
        self.unit_ray_from(ray.origin.as_dvec3(), ray)
    }

    /// [`Self::unit_ray`] of a ray with another origin in the world.
    #[inline]
    pub(crate) fn unit_ray_from(&self, origin: DVec3, ray: &Ray) -> (Ray, f32) {
        let direction = self.to_object.transform_vector3(ray.direction.as_dvec3());
        let scale = direction.length();
        let ray = Ray {
            origin: self.to_object.transform_point3(origin).as_vec3(),
            direction: (direction / scale).as_vec3(),
            t_max: (f64::from(ray.t_max) * scale) as f32,
            time: ray.time,
        };
        (ray, scale as f32)
    }

    /// An object-space point with an error box in the world: the point and the half widths of a box that contains the
    /// exact point.
    #[inline]
    pub fn point_with_error(&self, p: Vec3, p_error: Vec3) -> (Vec3, Vec3) {
        let (point, error) = self.points_with_error::<f32>(p.into(), p_error.into());
        (point.into(), error.into())
    }

    /// [`Self::point_with_error`] in lanes.
    ///
    /// With L the linear part, u the unit roundoff of f32 and p' the result, the half widths are
    /// `|L| p_error + u |p'| + |L| u |p|`, similar to Pharr, Jakob & Humphreys (2016, section 3.9), plus the rounding of the arithmetic in
    /// f64. The third term is for the next ray: when it leaves this point, its origin is transformed to object space
    /// and rounded to f32 again.
    #[inline(always)]
    pub fn points_with_error<F: Lanes>(&self, p: V3<F>, p_error: V3<F>) -> (V3<F>, V3<F>) {
        let (token, p, p_error) = (p.x.token(), p.widen(), p_error.widen());
        let DAffine3 { matrix3, translation } = &self.to_world;
        let exact = linear::<F>(token, matrix3, p) + V3::<F>::splat_double(token, v3(*translation));
        let magnitudes = DMat3::from_cols(matrix3.x_axis.abs(), matrix3.y_axis.abs(), matrix3.z_axis.abs());
        let (p_abs, unit) = (p.abs(), F::Double::splat(token, UNIT_ROUNDOFF_32));
        let rounding = linear::<F>(token, &magnitudes, p_abs) + V3::<F>::splat_double(token, v3(translation.abs()));
        let error = linear::<F>(token, &magnitudes, p_error + p_abs * unit)
            + exact.abs() * unit
            + rounding * F::Double::splat(token, 8.0 * UNIT_ROUNDOFF_64);
        let V3 { x, y, z } = V3::<F>::narrow(error);
        let least = x.constant(MIN_ERROR);
        (V3::narrow(exact), V3::new(next_up(x).max(least), next_up(y).max(least), next_up(z).max(least)))
    }
}

/// The product of a matrix and a vector.
#[inline(always)]
fn linear<F: Lanes>(token: F::Token, m: &DMat3, v: V3<F::Double>) -> V3<F::Double> {
    V3::<F>::splat_double(token, v3(m.x_axis)) * v.x
        + V3::<F>::splat_double(token, v3(m.y_axis)) * v.y
        + V3::<F>::splat_double(token, v3(m.z_axis)) * v.z
}

#[inline(always)]
fn v3(v: DVec3) -> V3<f64> {
    V3::new(v.x, v.y, v.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn sample() -> Transform {
        Transform::new(DAffine3::from_scale_rotation_translation(
            DVec3::new(-2.0, 0.25, 3.0),
            DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7),
            DVec3::new(1000.0, -3.0, 0.5),
        ))
        .unwrap()
    }

    #[test]
    fn singular_and_non_finite_maps_are_refused_and_tiny_ones_are_not() {
        let scale = |x, y, z| Transform::new(DAffine3::from_scale(DVec3::new(x, y, z)));
        assert_eq!(scale(1.0, 0.0, 1.0), Err(TransformError::Singular));
        assert_eq!(scale(0.0, 0.0, 0.0), Err(TransformError::Singular));
        assert_eq!(scale(1.0, f64::NAN, 1.0), Err(TransformError::NotFinite));
        assert_eq!(scale(1.0, f64::INFINITY, 1.0), Err(TransformError::NotFinite));
        assert_eq!(scale(1.0, 1e39, 1.0), Err(TransformError::NotFinite));
        assert!(scale(1e-9, 1e-9, 1e-9).is_ok() && scale(1e-6, 1e6, 1.0).is_ok());
        let flat = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(0.3, 0.4, 0.0));
        assert_eq!(Transform::new(DAffine3::from_mat3(flat)), Err(TransformError::Singular));
    }

    #[test]
    fn normals_stay_at_right_angles_under_non_uniform_and_mirroring_scales() {
        let t = sample();
        assert!(t.swaps_handedness());
        let (a, b) = (Vec3::new(1.0, 2.0, -0.5), Vec3::new(-0.3, 0.4, 2.0));
        let n = t.normal(a.cross(b));
        assert!((n.length() - 1.0).abs() < 1e-6);
        assert!(n.dot(t.vector(a).normalize()).abs() < 1e-6 && n.dot(t.vector(b).normalize()).abs() < 1e-6);
        assert!(n.dot(t.vector(a).cross(t.vector(b))) < 0.0, "mirroring turns the winding's normal over");
        assert_eq!(t.normal(Vec3::ZERO), Vec3::ZERO);
    }

    #[test]
    fn rays_keep_their_parameter_and_unit_rays_scale_it() {
        let t = sample();
        let world = Ray::with_end(Vec3::new(999.0, 2.0, 1.0), Vec3::new(0.6, 0.64, 0.48), 7.0);
        let object = t.ray(&world);
        assert!((t.point(object.at(2.0)) - world.at(2.0)).length() < 2e-4, "an ulp at 1 km is 6e-5");
        let (unit, s) = t.unit_ray(&world);
        assert!((unit.direction.length() - 1.0).abs() < 1e-6);
        assert!((unit.at(2.0 * s) - object.at(2.0)).length() < 1e-5 && (unit.t_max - 7.0 * s).abs() < 1e-4);
    }

    #[test]
    fn the_error_box_holds_the_exact_point() {
        let t = sample();
        let mut x = 1u32;
        let mut next = || {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (x >> 8) as f32 / 16_777_216.0 - 0.5
        };
        for _ in 0..10_000 {
            let scale = 10f32.powf(6.0 * next());
            let p = scale * Vec3::new(next(), next(), next());
            let e = 1e-6 * scale * Vec3::new(next(), next(), next()).abs();
            let (w, err) = t.point_with_error(p, e);
            for corner in 0..8 {
                let s = |bit: u32| if corner & bit == 0 { -1.0 } else { 1.0 };
                let exact = t.to_world().transform_point3(p.as_dvec3() + e.as_dvec3() * DVec3::new(s(1), s(2), s(4)));
                assert!((exact - w.as_dvec3()).abs().cmple(err.as_dvec3()).all(), "p = {p}, e = {e}");
            }
            assert!(err.max_element() < 1e-3 * (1.0 + scale), "the bound stays useful: {err} at {p}");
        }
    }
}
