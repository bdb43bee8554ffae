//! Ray differentials: derivatives of position and direction by the initial direction of a ray (Igehy 1999).

use super::linearized_chain::SpecularVertices;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_lanes::{Frame, Lanes, Mask, V3};

/// The derivatives of rays by two coordinates of their first directions, along unit vectors perpendicular to them.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayDifferentials<F: Lanes> {
    /// The unit vectors perpendicular to the first direction.
    pub(super) axes: [V3<F>; 2],
    /// Change of the position per radian \[m\].
    points: [V3<F>; 2],
    /// Change of the unit direction per radian.
    directions: [V3<F>; 2],
}

/// The Jacobians at the ends of rays: change perpendicular to the last directions, per radian of each first coordinate.
#[derive(Clone, Copy, Debug)]
pub(super) struct EndpointJacobians<F: Lanes> {
    direction: V3<F>,
    changes: [V3<F>; 2],
}

impl<F: Lanes> RayDifferentials<F> {
    /// All rays from one point around the given direction.
    #[inline(always)]
    pub(super) fn from_point(direction: V3<F>) -> Self {
        let Frame { tangent, bitangent, .. } = Frame::from_normal(direction);
        let zero = V3::splat(direction.x.token(), Vec3::ZERO);
        Self { axes: [tangent, bitangent], points: [zero; 2], directions: [tangent, bitangent] }
    }

    /// The differentials behind specular vertices, in their lanes, at a distance \[m\] from the vertices before. The unit
    /// directions are those before and behind the vertices, and `normal` are the unit shading normals that the rays meet.
    #[inline(always)]
    pub(super) fn behind(
        self,
        at: &SpecularVertices<F>,
        distance: F,
        normal: V3<F>,
        [before, behind]: [V3<F>; 2],
    ) -> Self {
        let (lanes, is_reflection) = (at.lanes, at.is_reflection);
        let (flat, eta): (V3<F>, F) = (at.geometric_normal, at.eta);
        // Each neighbouring ray ends on the plane of the surface.
        let across = before.dot(flat).recip();
        // d' = d / eta + m n with m = (n.d') - (n.d) / eta; by Snell's law eta^2 (1 - (n.d')^2) = 1 - (n.d)^2. For a
        // reflection d' = d - 2 (n.d) n: the same with an eta of 1 and n.d' = -(n.d).
        let (incident, exitant) = (before.dot(normal), behind.dot(normal));
        let inverse = eta.recip();
        let m = exitant - incident * inverse;
        let ratio = is_reflection.select(-inverse, incident / (eta * eta * exitant));
        let mut passed = self;
        for k in 0..2 {
            let (moved, turn) = (self.points[k] + self.directions[k] * distance, self.directions[k]);
            let point = moved - before * (moved.dot(flat) * across);
            let mut change = turn.dot(normal);
            let mut turned = turn * inverse;
            if let Some(differential) = &at.differential {
                let bent = differential.along(point);
                change += before.dot(bent);
                turned += bent * m;
            }
            turned += normal * (change * ratio - change * inverse);
            passed.points[k] = V3::select(lanes, point, self.points[k]);
            passed.directions[k] = V3::select(lanes, turned, self.directions[k]);
        }
        passed
    }

    /// The Jacobians at a further distance \[m\] along the rays, perpendicular to them \[m/rad\]. In lanes at infinity those
    /// of the directions \[rad/rad\].
    #[inline(always)]
    pub(super) fn jacobians(&self, direction: V3<F>, distance: F, is_infinite: F::Mask) -> EndpointJacobians<F> {
        let ([p, q], [a, b], lanes) = (self.points, self.directions, is_infinite);
        let changes = [V3::select(lanes, a, p + a * distance), V3::select(lanes, b, q + b * distance)];
        EndpointJacobians { direction, changes }
    }
}

impl<F: Lanes> EndpointJacobians<F> {
    /// Area (or solid angle) at the end per solid angle at the start.
    #[inline(always)]
    pub(super) fn area(&self) -> F {
        self.determinant().abs()
    }

    #[inline(always)]
    fn determinant(&self) -> F {
        let [a, b] = self.changes;
        self.direction.dot(a.cross(b))
    }

    /// The changes of the two first coordinates \[rad\] that move the ends by `miss`, to first order (Cramer's rule). Not
    /// finite if the Jacobian is singular.
    #[inline(always)]
    pub(super) fn solve(&self, miss: V3<F>) -> [F; 2] {
        let ([a, b], inverse) = (self.changes, self.determinant().recip());
        [self.direction.dot(miss.cross(b)) * inverse, self.direction.dot(a.cross(miss)) * inverse]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_geometry::DVec3;

    fn unit(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z).normalize()
    }

    fn single(v: DVec3) -> V3<f32> {
        v.as_vec3().into()
    }

    /// The differentials around a ray from one point, behind a plane.
    fn behind(first: Vec3, distance: f32, [before, behind]: [DVec3; 2], eta: f32) -> RayDifferentials<f32> {
        let up = V3::new(0.0, 0.0, 1.0);
        let at = SpecularVertices {
            lanes: true,
            point: up,
            geometric_normal: up,
            normal: up,
            differential: None,
            eta,
            is_reflection: eta == 1.0,
        };
        RayDifferentials::from_point(first.into()).behind(&at, distance, up, [single(before), single(behind)])
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
        let (direction, eta, h) = (unit(0.4, -0.3, 0.8), 1.49f32, 1e-5);
        let first = direction.as_vec3();
        let direction = first.as_dvec3().normalize();
        let (point, refracted) = through_plane(direction, eta.into());
        let differential = behind(first, point.length() as f32, [direction, refracted], eta);
        let vector = |v: V3<f32>| Vec3::from(v).as_dvec3();
        for j in 0..2 {
            let axis = Vec3::from(differential.axes[j]).as_dvec3();
            let moved = (direction + axis * h).normalize();
            let (p, d) = through_plane(moved, eta.into());
            assert!(((p - point) / h - vector(differential.points[j])).length() < 1e-4, "place {j}");
            assert!(((d - refracted) / h - vector(differential.directions[j])).length() < 1e-4, "direction {j}");
        }
        // A cone of solid angle w covers d^2 w in empty space.
        let free = RayDifferentials::<f32>::from_point(first.into()).jacobians(single(direction), 2.0, false);
        assert!((free.area() - 4.0).abs() < 1e-5);
        let [x, y] = free.solve(differential.axes[0] * 0.02);
        assert!((x - 0.01).abs() < 1e-7 && y.abs() < 1e-7);
    }

    #[test]
    fn a_mirror_turns_the_beam_and_keeps_its_area() {
        let first = unit(0.1, 0.2, -0.9).as_vec3();
        let direction = first.as_dvec3();
        let reflected = DVec3::new(direction.x, direction.y, -direction.z);
        let differential = behind(first, 2.0, [direction, reflected], 1.0);
        assert!((differential.jacobians(single(reflected), 1.0, false).area() - 9.0).abs() < 1e-5);
        assert!((differential.jacobians(single(reflected), 1.0, true).area() - 1.0).abs() < 1e-5);
    }
}
