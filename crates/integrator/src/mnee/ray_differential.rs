//! Ray differentials: derivatives of position and direction by the initial direction of a ray (Igehy 1999).

use dunkelfeld_geometry::{DVec3, Vec3};
use dunkelfeld_scene::NormalDifferential;

/// The derivative of a ray by two coordinates of its first direction, along unit vectors perpendicular to it.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayDifferential {
    /// The unit vectors perpendicular to the first direction.
    pub(super) axes: [Vec3; 2],
    /// Change of the position per radian \[m\].
    points: [DVec3; 2],
    /// Change of the unit direction per radian.
    directions: [DVec3; 2],
}

/// The Jacobian at the end of a ray: change of two coordinates perpendicular to the last direction, per radian of each
/// first coordinate.
#[derive(Clone, Copy, Debug)]
pub(super) struct EndpointJacobian {
    /// Unit vectors perpendicular to the last direction.
    axes: [DVec3; 2],
    /// `rows[i][j]`: change along axis i per radian along first coordinate j.
    rows: [[f64; 2]; 2],
}

impl RayDifferential {
    /// All rays from one point around the given direction.
    pub(super) fn from_point(direction: Vec3) -> Self {
        let (a, b) = direction.any_orthonormal_pair();
        Self { axes: [a, b], points: [DVec3::ZERO; 2], directions: [a.as_dvec3(), b.as_dvec3()] }
    }

    /// Transfers over a distance \[m\] along `direction`, to a surface with the geometric normal `normal`. Each
    /// neighbouring ray ends on the plane of that surface.
    pub(super) fn transfer(&mut self, direction: DVec3, distance: f64, normal: DVec3) {
        let cosine = direction.dot(normal);
        for (point, turn) in self.points.iter_mut().zip(&self.directions) {
            let moved = *point + *turn * distance;
            *point = moved - direction * (moved.dot(normal) / cosine);
        }
    }

    /// Reflects at a surface with the unit shading normal `normal`.
    pub(super) fn reflect(&mut self, direction: DVec3, normal: DVec3, differential: Option<&NormalDifferential>) {
        let cosine = direction.dot(normal);
        self.change_directions(differential, |turn, bent| {
            turn - (normal * (turn.dot(normal) + direction.dot(bent)) + bent * cosine) * 2.0
        });
    }

    /// Refracts at the surface into the unit direction `refracted`. `eta` is the index of refraction on the far side
    /// over that on the near side.
    pub(super) fn refract(
        &mut self,
        (direction, refracted): (DVec3, DVec3),
        normal: DVec3,
        eta: f64,
        differential: Option<&NormalDifferential>,
    ) {
        // d' = d / eta + m n with m = (n.d') - (n.d) / eta; by Snell's law eta^2 (1 - (n.d')^2) = 1 - (n.d)^2.
        let (before, after) = (direction.dot(normal), refracted.dot(normal));
        let m = after - before / eta;
        self.change_directions(differential, |turn, bent| {
            let change_before = turn.dot(normal) + direction.dot(bent);
            let change_after = before * change_before / (eta * eta * after);
            turn / eta + normal * (change_after - change_before / eta) + bent * m
        });
    }

    fn change_directions(&mut self, differential: Option<&NormalDifferential>, turned: impl Fn(DVec3, DVec3) -> DVec3) {
        for (point, turn) in self.points.iter().zip(&mut self.directions) {
            let bent = differential.map_or(DVec3::ZERO, |d| d.along(*point));
            *turn = turned(*turn, bent);
        }
    }

    /// The Jacobian at a further distance \[m\] along the ray, perpendicular to the ray: `[m/rad]`.
    pub(super) fn jacobian_at(&self, direction: DVec3, distance: f64) -> EndpointJacobian {
        EndpointJacobian::new(direction, [0, 1].map(|j| self.points[j] + self.directions[j] * distance))
    }

    /// The Jacobian of the directions: `[rad/rad]`.
    pub(super) fn jacobian_at_infinity(&self, direction: DVec3) -> EndpointJacobian {
        EndpointJacobian::new(direction, self.directions)
    }
}

impl EndpointJacobian {
    fn new(direction: DVec3, changes: [DVec3; 2]) -> Self {
        let (a, b) = direction.any_orthonormal_pair();
        Self { axes: [a, b], rows: [a, b].map(|axis| changes.map(|c| axis.dot(c))) }
    }

    /// Area (or solid angle) at the end per solid angle at the start.
    pub(super) fn area(&self) -> f64 {
        self.determinant().abs()
    }

    fn determinant(&self) -> f64 {
        let [[a, b], [c, d]] = self.rows;
        a * d - b * c
    }

    /// The change of the two first coordinates \[rad\] that moves the end by `miss`, to first order; `None` if the
    /// Jacobian is singular.
    pub(super) fn solve(&self, miss: DVec3) -> Option<[f64; 2]> {
        let [[a, b], [c, d]] = self.rows;
        let determinant = self.determinant();
        let [x, y] = self.axes.map(|axis| axis.dot(miss));
        let solution = [(d * x - b * y) / determinant, (a * y - c * x) / determinant];
        solution.iter().all(|s| s.is_finite()).then_some(solution)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z).normalize()
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
        let mut differential = RayDifferential::from_point(first);
        let (point, refracted) = through_plane(direction, eta);
        differential.transfer(direction, point.length(), DVec3::Z);
        differential.refract((direction, refracted), DVec3::Z, eta, None);
        for j in 0..2 {
            let moved = (direction + differential.axes[j].as_dvec3() * h).normalize();
            let (p, d) = through_plane(moved, eta);
            assert!(((p - point) / h - differential.points[j]).length() < 1e-4, "place {j}");
            assert!(((d - refracted) / h - differential.directions[j]).length() < 1e-4, "direction {j}");
        }
        // A cone of solid angle w covers d^2 w in empty space.
        let free = RayDifferential::from_point(first).jacobian_at(direction, 2.0);
        assert!((free.area() - 4.0).abs() < 1e-6);
        let step = free.solve(differential.axes[0].as_dvec3() * 0.02);
        assert!(step.is_some_and(|[x, y]| (x - 0.01).abs() < 1e-8 && y.abs() < 1e-8));
    }

    #[test]
    fn a_mirror_turns_the_beam_and_keeps_its_area() {
        let first = unit(0.1, 0.2, -0.9).as_vec3();
        let direction = first.as_dvec3();
        let mut differential = RayDifferential::from_point(first);
        differential.transfer(direction, 2.0, DVec3::Z);
        differential.reflect(direction, DVec3::Z, None);
        let reflected = DVec3::new(direction.x, direction.y, -direction.z);
        assert!((differential.jacobian_at(reflected, 1.0).area() - 9.0).abs() < 1e-5);
        assert!((differential.jacobian_at_infinity(reflected).area() - 1.0).abs() < 1e-6);
    }
}
