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
