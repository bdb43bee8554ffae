//! Ray differentials: derivatives of position and direction by the initial direction of a ray (Igehy 1999).

use dunkelfeld_lanes::{Double, Frame, Lanes, Mask, Real, V3};
use dunkelfeld_scene::NormalDifferentials;

/// Double precision, and its masks.
type DoubleOf<F> = <F as Lanes>::Double;
pub(super) type DoubleMask<F> = <DoubleOf<F> as Real>::Mask;

/// The derivatives of rays by two coordinates of their first directions, along unit vectors perpendicular to them.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayDifferentials<F: Lanes> {
    /// The unit vectors perpendicular to the first direction.
    pub(super) axes: [V3<F>; 2],
    /// Change of the position per radian \[m\].
    points: [V3<F::Double>; 2],
    /// Change of the unit direction per radian.
    directions: [V3<F::Double>; 2],
}

/// The Jacobians at the ends of rays: change perpendicular to the last directions, per radian of each first coordinate.
#[derive(Clone, Copy, Debug)]
pub(super) struct EndpointJacobians<F: Lanes> {
    direction: V3<F::Double>,
    changes: [V3<F::Double>; 2],
}

/// An interface that rays meet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bend<F: Lanes> {
    /// Unit directions of the rays before and behind it.
    pub(super) before: V3<F::Double>,
    pub(super) behind: V3<F::Double>,
    /// Unit shading normals, and their derivatives.
    pub(super) normal: V3<F::Double>,
    pub(super) differential: Option<NormalDifferentials<F>>,
    /// Indices of refraction on the far side over those on the near side; 1 for a reflection.
    pub(super) eta: F::Double,
    pub(super) is_reflection: DoubleMask<F>,
}

impl<F: Lanes> RayDifferentials<F> {
    /// All rays from one point around the given direction.
    #[inline(always)]
    pub(super) fn from_point(direction: V3<F>) -> Self {
        let Frame { tangent, bitangent, .. } = Frame::from_normal(direction);
        let zero = V3::<F>::splat_double(direction.x.token(), V3::new(0.0, 0.0, 0.0));
        Self { axes: [tangent, bitangent], points: [zero; 2], directions: [tangent.widen(), bitangent.widen()] }
    }

    /// Transfers over a distance \[m\] along `direction`, to a surface with the geometric normal `normal`. Each
    /// neighbouring ray ends on the plane of that surface.
    #[inline(always)]
    pub(super) fn transfer(&mut self, direction: V3<F::Double>, distance: F::Double, normal: V3<F::Double>) {
        let inverse = direction.dot(normal).recip();
        for k in 0..2 {
            let moved = self.points[k] + self.directions[k] * distance;
            self.points[k] = moved - direction * (moved.dot(normal) * inverse);
        }
    }

    /// Reflects or refracts at a surface.
    #[inline(always)]
    pub(super) fn bend(&mut self, at: &Bend<F>) {
        let Bend { before, behind, normal, differential, eta, is_reflection } = *at;
        // d' = d / eta + m n with m = (n.d') - (n.d) / eta; by Snell's law eta^2 (1 - (n.d')^2) = 1 - (n.d)^2. For a
        // reflection d' = d - 2 (n.d) n: the same with an eta of 1 and n.d' = -(n.d).
        let (incident, exitant) = (before.dot(normal), behind.dot(normal));
        let inverse = eta.recip();
        let m = exitant - incident * inverse;
        let ratio = is_reflection.select(-inverse, incident / (eta * eta * exitant));
        for k in 0..2 {
            let turn = self.directions[k];
            let mut change = turn.dot(normal);
            let mut turned = turn * inverse;
            if let Some(differential) = &differential {
                let bent = differential.along(self.points[k]);
                change = change + before.dot(bent);
                turned += bent * m;
            }
            self.directions[k] = turned + normal * (change * ratio - change * inverse);
        }
    }

    /// The Jacobians at a further distance \[m\] along the ray, perpendicular to the ray: `[m/rad]`.
    #[inline(always)]
    pub(super) fn jacobians_at(&self, direction: V3<F::Double>, distance: F::Double) -> EndpointJacobians<F> {
        let ([p, q], [a, b]) = (self.points, self.directions);
        EndpointJacobians { direction, changes: [p + a * distance, q + b * distance] }
    }

    /// The Jacobians of the directions: `[rad/rad]`.
    #[inline(always)]
    pub(super) fn jacobians_at_infinity(&self, direction: V3<F::Double>) -> EndpointJacobians<F> {
        EndpointJacobians { direction, changes: self.directions }
    }

    /// `yes` in the lanes of the mask, `no` in the others.
    #[inline(always)]
    pub(super) fn select(mask: F::Mask, yes: Self, no: Self) -> Self {
        let wide = F::Double::widen_mask(mask);
        let mut chosen = no;
        for k in 0..2 {
            chosen.axes[k] = V3::select(mask, yes.axes[k], no.axes[k]);
            chosen.points[k] = V3::select(wide, yes.points[k], no.points[k]);
            chosen.directions[k] = V3::select(wide, yes.directions[k], no.directions[k]);
        }
        chosen
    }
}

impl<F: Lanes> EndpointJacobians<F> {
    /// `yes` in the lanes of the mask, `no` in the others.
    #[inline(always)]
    pub(super) fn select(mask: DoubleMask<F>, yes: Self, no: Self) -> Self {
        let [a, b] = [0, 1].map(
            #[inline(always)]
            |k| V3::select(mask, yes.changes[k], no.changes[k]),
        );
        Self { direction: V3::select(mask, yes.direction, no.direction), changes: [a, b] }
    }

    /// Area (or solid angle) at the end per solid angle at the start.
    #[inline(always)]
    pub(super) fn area(&self) -> F::Double {
        self.determinant().abs()
    }

    #[inline(always)]
    fn determinant(&self) -> F::Double {
        let [a, b] = self.changes;
        self.direction.dot(a.cross(b))
    }

    /// The changes of the two first coordinates \[rad\] that move the ends by `miss`, to first order (Cramer's rule). Not
    /// finite if the Jacobian is singular.
    #[inline(always)]
    pub(super) fn solve(&self, miss: V3<F::Double>) -> [F::Double; 2] {
        let ([a, b], inverse) = (self.changes, self.determinant().recip());
        [self.direction.dot(miss.cross(b)) * inverse, self.direction.dot(a.cross(miss)) * inverse]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_geometry::{DVec3, Vec3};

    fn unit(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z).normalize()
    }

    fn double(v: DVec3) -> V3<f64> {
        V3::new(v.x, v.y, v.z)
    }

    const UP: V3<f64> = V3 { x: 0.0, y: 0.0, z: 1.0 };

    fn bend([before, behind]: [DVec3; 2], eta: f64, is_reflection: bool) -> Bend<f32> {
        let is_reflection = <f64 as Double<f32>>::widen_mask(is_reflection);
        Bend { before: double(before), behind: double(behind), normal: UP, differential: None, eta, is_reflection }
    }

    /// Traces one ray from the origin through a plane z = 1 into a medium of index eta, and on to z = 3.
    fn through_plane(direction: DVec3, eta: f64) -> (DVec3, DVec3) {
        let point = direction / direction.z;
        let t = direction / eta;
        let sine2 = t.x * t.x + t.y * t.y;
        let refracted = DVec3::new(t.x, t.y, (1.0 - sine2).sqrt());
        (point, refracted)
    }

    #[test]
    fn refraction_at_a_plane_agrees_with_differences() {
        let (direction, eta, h) = (unit(0.4, -0.3, 0.8), 1.49, 1e-5);
        let first = direction.as_vec3();
        let direction = first.as_dvec3().normalize();
        let mut differential = RayDifferentials::<f32>::from_point(first.into());
        let (point, refracted) = through_plane(direction, eta);
        differential.transfer(double(direction), point.length(), UP);
        differential.bend(&bend([direction, refracted], eta, false));
        let vector = |v: V3<f64>| DVec3::new(v.x, v.y, v.z);
        for j in 0..2 {
            let axis = Vec3::from(differential.axes[j]).as_dvec3();
            let moved = (direction + axis * h).normalize();
            let (p, d) = through_plane(moved, eta);
            assert!(((p - point) / h - vector(differential.points[j])).length() < 1e-4, "place {j}");
            assert!(((d - refracted) / h - vector(differential.directions[j])).length() < 1e-4, "direction {j}");
        }
        // A cone of solid angle w covers d^2 w in empty space.
        let free = RayDifferentials::<f32>::from_point(first.into()).jacobians_at(double(direction), 2.0);
        assert!((free.area() - 4.0).abs() < 1e-6);
        let [x, y] = free.solve(differential.axes[0].widen() * 0.02);
        assert!((x - 0.01).abs() < 1e-8 && y.abs() < 1e-8);
    }

    #[test]
    fn a_mirror_turns_the_beam_and_keeps_its_area() {
        let first = unit(0.1, 0.2, -0.9).as_vec3();
        let direction = first.as_dvec3();
        let mut differential = RayDifferentials::<f32>::from_point(first.into());
        differential.transfer(double(direction), 2.0, UP);
        let reflected = DVec3::new(direction.x, direction.y, -direction.z);
        differential.bend(&bend([direction, reflected], 1.0, true));
        assert!((differential.jacobians_at(double(reflected), 1.0).area() - 9.0).abs() < 1e-5);
        assert!((differential.jacobians_at_infinity(double(reflected)).area() - 1.0).abs() < 1e-6);
    }
}
