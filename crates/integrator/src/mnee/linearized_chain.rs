//! Linearised chain: the faces of a cover near a traced ray. It predicts the neighbouring rays without intersecting the
//! mesh again.

use super::ray_differential::RayDifferential;
use dunkelfeld_geometry::{DVec3, Vec3};
use dunkelfeld_scene::NormalDifferential;

/// Maximum number of events. Longer chains are not linearised. Two double passes through a sheet have this number of
/// events.
const MAX_BENDS: usize = 6;

/// One interface near the point where the traced ray met it.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpecularVertex {
    /// The intersection in render space.
    pub(super) point: DVec3,
    /// Unit geometric normal.
    pub(super) flat: DVec3,
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
    bends: [Option<SpecularVertex>; MAX_BENDS],
    events: usize,
}

impl LinearizedChain {
    pub(super) fn new() -> Self {
        Self { bends: [const { None }; MAX_BENDS], events: 0 }
    }

    /// Removes all interfaces.
    pub(super) fn clear(&mut self) {
        self.events = 0;
    }

    /// Appends an interface.
    pub(super) fn note(&mut self, bend: SpecularVertex) {
        if let Some(place) = self.bends.get_mut(self.events) {
            *place = Some(bend);
        }
        self.events += 1;
    }

    /// Traces a ray near the recorded one through the linearised faces. Returns the point where it leaves the last
    /// interface, its unit direction there, and its ray differential. Each face is replaced by the plane at its
    /// intersection, with a normal that changes linearly. `None` if the ray does not pass, or if the chain has too many
    /// events.
    pub(super) fn follow(&self, origin: DVec3, first: Vec3) -> Option<(DVec3, DVec3, RayDifferential)> {
        let (mut beam, mut place, mut direction) = (RayDifferential::from_point(first), origin, first.as_dvec3());
        for bend in self.bends.get(..self.events)?.iter().flatten() {
            let distance = (bend.point - place).dot(bend.flat) / direction.dot(bend.flat);
            let is_ahead = distance > 0.0 && distance.is_finite();
            if !is_ahead {
                return None;
            }
            place += direction * distance;
            beam.travel(direction, distance, bend.flat);
            let turn = bend.differential.map_or(DVec3::ZERO, |d| d.along(place - bend.point));
            let normal = (bend.normal + turn).normalize();
            let before = direction.dot(normal);
            direction = match bend.eta {
                None => {
                    beam.reflect(direction, normal, bend.differential.as_ref());
                    direction - normal * (2.0 * before)
                }
                Some(eta) => {
                    let square = 1.0 - (1.0 - before * before) / (eta * eta);
                    let comes_through = square > 0.0;
                    if !comes_through {
                        return None;
                    }
                    let along = square.sqrt() * before.signum();
                    let refracted = direction / eta + normal * (along - before / eta);
                    beam.refract((direction, refracted), normal, eta, bend.differential.as_ref());
                    refracted
                }
            };
        }
        Some((place, direction, beam))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_run_through_a_plate_and_a_mirror_by_the_laws() {
        let (d, n, h) = (0.004, 1.49, 0.02);
        let mut trail = LinearizedChain::new();
        let bend = |z: f64, eta| SpecularVertex {
            point: DVec3::new(0.3, -0.2, z),
            flat: DVec3::Z,
            normal: DVec3::Z,
            differential: None,
            eta,
        };
        trail.note(bend(h, Some(n)));
        trail.note(bend(h + d, Some(1.0 / n)));
        trail.note(bend(0.5, None));
        let first = DVec3::new(0.5, 0.1, 0.7).normalize().as_vec3();
        let direction = first.as_dvec3().normalize();
        let (place, leaving, beam) = trail.follow(DVec3::ZERO, first).expect("it comes through");
        let sine = direction.x.hypot(direction.y) / n;
        let inner = d * sine / (1.0 - sine * sine).sqrt();
        let shift = (0.5 - d) * direction.x.hypot(direction.y) / direction.z + inner;
        let expected = DVec3::new(direction.x, direction.y, 0.0).normalize() * shift + DVec3::Z * 0.5;
        assert!(place.distance(expected) < 1e-7, "{place} instead of {expected}");
        assert!(leaving.distance(DVec3::new(direction.x, direction.y, -direction.z)) < 1e-7);
        // The ray differential equals the difference to a neighbouring ray.
        let step = 1e-3f32;
        let moved = (first + beam.across[0] * step).normalize();
        let (other, turned, _) = trail.follow(DVec3::ZERO, moved).expect("it comes through");
        let spread = beam.spread_at(leaving, 0.3);
        let reached = (other - place) + (turned - leaving) * 0.3;
        let reached = reached - turned * (reached.dot(leaving) / turned.dot(leaving));
        let solved = spread.solve(reached).expect("an open bundle");
        assert!((solved[0] - f64::from(step)).abs() < 3e-6 && solved[1].abs() < 3e-6, "{solved:?}");
        // Total reflection, and a chain with too many events.
        trail.clear();
        trail.note(bend(h, Some(1.0 / 3.0)));
        assert!(trail.follow(DVec3::ZERO, first).is_none());
        trail.clear();
        (0..7).for_each(|_| trail.note(bend(h, Some(1.0))));
        assert!(trail.follow(DVec3::ZERO, first).is_none());
    }
}
