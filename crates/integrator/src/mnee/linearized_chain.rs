//! Linearised chain: the faces of a cover near a traced ray. It predicts the neighbouring rays without intersecting the
//! mesh again.

use super::ray_differential::RayDifferential;
use dunkelfeld_geometry::{DVec3, Vec3};
use dunkelfeld_scene::NormalDifferential;

/// Maximum number of events. Longer chains are not linearised. Two double passes through a sheet have this number of
/// events.
const MAX_EVENTS: usize = 6;

/// One interface near the point where the traced ray hit it.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpecularVertex {
    /// The intersection in render space.
    pub(super) point: DVec3,
    /// Unit geometric normal.
    pub(super) geometric_normal: DVec3,
    /// Unit shading normal.
    pub(super) normal: DVec3,
    /// Derivative of the shading normal; `None` where it is constant.
    pub(super) differential: Option<NormalDifferential>,
    /// Index of refraction on the far side over that on the near side; `None` if the ray is reflected.
    pub(super) eta: Option<f64>,
}

/// The interfaces of a traced chain in order, starting at the receiver.
#[derive(Clone, Debug)]
pub(super) struct LinearizedChain {
    vertices: [Option<SpecularVertex>; MAX_EVENTS],
    events: usize,
}

impl LinearizedChain {
    pub(super) fn new() -> Self {
        Self { vertices: [const { None }; MAX_EVENTS], events: 0 }
    }

    /// Removes all interfaces.
    pub(super) fn clear(&mut self) {
        self.events = 0;
    }

    /// Appends an interface.
    pub(super) fn push(&mut self, vertex: SpecularVertex) {
        if let Some(slot) = self.vertices.get_mut(self.events) {
            *slot = Some(vertex);
        }
        self.events += 1;
    }

    /// Traces a ray near the recorded one through the linearised faces. Returns the point where it leaves the last
    /// interface, its unit direction there, and its ray differential. Each face is replaced by the plane at its
    /// intersection, with a normal that changes linearly. `None` if the ray does not pass, or if the chain has too many
    /// events.
    pub(super) fn trace(&self, origin: DVec3, first: Vec3) -> Option<(DVec3, DVec3, RayDifferential)> {
        let (mut ray_differential, mut position, mut direction) =
            (RayDifferential::from_point(first), origin, first.as_dvec3());
        for vertex in self.vertices.get(..self.events)?.iter().flatten() {
            let distance =
                (vertex.point - position).dot(vertex.geometric_normal) / direction.dot(vertex.geometric_normal);
            let is_forward = distance > 0.0 && distance.is_finite();
            if !is_forward {
                return None;
            }
            position += direction * distance;
            ray_differential.transfer(direction, distance, vertex.geometric_normal);
            let normal_change = vertex.differential.map_or(DVec3::ZERO, |d| d.along(position - vertex.point));
            let normal = (vertex.normal + normal_change).normalize();
            let before = direction.dot(normal);
            direction = match vertex.eta {
                None => {
                    ray_differential.reflect(direction, normal, vertex.differential.as_ref());
                    direction - normal * (2.0 * before)
                }
                Some(eta) => {
                    let square = 1.0 - (1.0 - before * before) / (eta * eta);
                    let is_transmitted = square > 0.0;
                    if !is_transmitted {
                        return None;
                    }
                    let along = square.sqrt() * before.signum();
                    let refracted = direction / eta + normal * (along - before / eta);
                    ray_differential.refract((direction, refracted), normal, eta, vertex.differential.as_ref());
                    refracted
                }
            };
        }
        Some((position, direction, ray_differential))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_rays_obey_snells_law_and_the_law_of_reflection() {
        let (d, n, h) = (0.004, 1.49, 0.02);
        let mut linearized_chain = LinearizedChain::new();
        let vertex = |z: f64, eta| SpecularVertex {
            point: DVec3::new(0.3, -0.2, z),
            geometric_normal: DVec3::Z,
            normal: DVec3::Z,
            differential: None,
            eta,
        };
        linearized_chain.push(vertex(h, Some(n)));
        linearized_chain.push(vertex(h + d, Some(1.0 / n)));
        linearized_chain.push(vertex(0.5, None));
        let first = DVec3::new(0.5, 0.1, 0.7).normalize().as_vec3();
        let direction = first.as_dvec3().normalize();
        let (position, leaving, ray_differential) =
            linearized_chain.trace(DVec3::ZERO, first).expect("a transmitted ray");
        let sine = direction.x.hypot(direction.y) / n;
        let inner = d * sine / (1.0 - sine * sine).sqrt();
        let shift = (0.5 - d) * direction.x.hypot(direction.y) / direction.z + inner;
        let expected = DVec3::new(direction.x, direction.y, 0.0).normalize() * shift + DVec3::Z * 0.5;
        assert!(position.distance(expected) < 1e-7, "{position} instead of {expected}");
        assert!(leaving.distance(DVec3::new(direction.x, direction.y, -direction.z)) < 1e-7);
        // The ray differential equals the difference to a neighbouring ray.
        let step = 1e-3f32;
        let moved = (first + ray_differential.axes[0] * step).normalize();
        let (other, turned, _) = linearized_chain.trace(DVec3::ZERO, moved).expect("a transmitted ray");
        let jacobian = ray_differential.jacobian_at(leaving, 0.3);
        let reached = (other - position) + (turned - leaving) * 0.3;
        let reached = reached - turned * (reached.dot(leaving) / turned.dot(leaving));
        let solved = jacobian.solve(reached).expect("an open bundle");
        assert!((solved[0] - f64::from(step)).abs() < 3e-6 && solved[1].abs() < 3e-6, "{solved:?}");
        // Total reflection, and a chain with too many events.
        linearized_chain.clear();
        linearized_chain.push(vertex(h, Some(1.0 / 3.0)));
        assert!(linearized_chain.trace(DVec3::ZERO, first).is_none());
        linearized_chain.clear();
        (0..7).for_each(|_| linearized_chain.push(vertex(h, Some(1.0))));
        assert!(linearized_chain.trace(DVec3::ZERO, first).is_none());
    }
}
