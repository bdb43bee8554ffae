//! Linearised chains: the faces of covers near traced rays. They predict the neighbouring rays without intersecting the
//! mesh again.

use super::ray_differential::RayDifferentials;
use dunkelfeld_lanes::{Lanes, Mask, V3};
use dunkelfeld_scene::NormalDifferentials;
use smallvec::SmallVec;

/// Maximum number of events. Longer chains are not linearised. Two double passes through a sheet have this number of
/// events.
const MAX_EVENTS: usize = 6;

/// Interfaces near the points where traced rays hit them.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpecularVertices<F: Lanes> {
    /// Lanes whose chain has this event.
    pub(super) lanes: F::Mask,
    /// The intersections in render space.
    pub(super) point: V3<F>,
    /// Unit geometric normals.
    pub(super) geometric_normal: V3<F>,
    /// Unit shading normals, and their derivatives.
    pub(super) normal: V3<F>,
    pub(super) differential: Option<NormalDifferentials<F>>,
    /// Indices of refraction on the far side over those on the near side; 1 for a reflection.
    pub(super) eta: F,
    pub(super) is_reflection: F::Mask,
}

/// The interfaces of traced chains in order, starting at the receivers.
#[derive(Debug)]
pub(super) struct LinearizedChains<F: Lanes> {
    vertices: SmallVec<[SpecularVertices<F>; MAX_EVENTS]>,
    /// Lanes whose chain has no more than [`MAX_EVENTS`].
    is_short: F::Mask,
}

impl<F: Lanes> LinearizedChains<F> {
    #[inline(always)]
    pub(super) fn new(token: F::Token) -> Self {
        Self { vertices: SmallVec::new(), is_short: F::mask(token, u32::MAX >> (32 - F::WIDTH)) }
    }

    /// Appends the interfaces of the next event.
    #[inline(always)]
    pub(super) fn push(&mut self, vertices: SpecularVertices<F>) {
        if self.vertices.len() < MAX_EVENTS {
            self.vertices.push(vertices);
        } else {
            self.is_short = self.is_short & !vertices.lanes;
        }
    }

    /// Traces rays near the recorded ones through the linearised faces. Returns the lanes that pass, the points where
    /// they leave the last interface, their unit directions there, and their ray differentials. Each face is replaced by
    /// the plane at its intersection, with a normal that changes linearly.
    #[inline(always)]
    pub(super) fn trace(&self, origin: V3<F>, first: V3<F>) -> (F::Mask, [V3<F>; 2], RayDifferentials<F>) {
        let mut rays = RayDifferentials::from_point(first);
        let (mut position, mut direction, mut passes) = (origin, first, self.is_short);
        for vertex in &self.vertices {
            let (point, flat, eta) = (vertex.point, vertex.geometric_normal, vertex.eta);
            let distance = (point - position).dot(flat) / direction.dot(flat);
            let there = position + direction * distance;
            let mut normal = vertex.normal;
            if let Some(differential) = &vertex.differential {
                normal = (normal + differential.along(there - point)).normalize();
            }
            let incident = direction.dot(normal);
            let (one, zero) = (incident.constant(1.0), incident.constant(0.0));
            let square = one - (one - incident * incident) / (eta * eta);
            let is_reflection = vertex.is_reflection;
            let cosine = square.max(zero).sqrt();
            // Of the direction behind the interface along the normal.
            let along = (incident.lt(zero) ^ is_reflection).select(-cosine, cosine);
            let behind = direction / eta + normal * (along - incident / eta);
            rays = rays.behind(vertex, distance, normal, [direction, behind]);
            let is_possible = distance.is_positive() & distance.is_finite() & square.is_positive();
            passes = passes & (!vertex.lanes | is_possible);
            let lanes = vertex.lanes;
            position = V3::select(lanes, there, position);
            direction = V3::select(lanes, behind, direction);
        }
        (passes, [position, direction], rays)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_geometry::{DVec3, Vec3};

    #[test]
    fn neighbouring_rays_obey_snells_law_and_the_law_of_reflection() {
        let (d, n, h) = (0.004f32, 1.49f32, 0.02f32);
        let up = V3::new(0.0, 0.0, 1.0);
        let vertex = |z: f32, eta: f32, is_reflection| SpecularVertices::<f32> {
            lanes: true,
            point: V3::new(0.3, -0.2, z),
            geometric_normal: up,
            normal: up,
            differential: None,
            eta,
            is_reflection,
        };
        let zero = V3::new(0.0, 0.0, 0.0);
        let mut chain = LinearizedChains::new(());
        let (top, inverse) = (h + d, 1.0 / n);
        chain.push(vertex(h, n, false));
        chain.push(vertex(top, inverse, false));
        chain.push(vertex(0.5, 1.0, true));
        let first = DVec3::new(0.5, 0.1, 0.7).normalize().as_vec3();
        let direction = first.as_dvec3();
        let (passes, [position, leaving], rays) = chain.trace(zero, first.into());
        assert!(passes, "a transmitted ray");
        let vector = |v: V3<f32>| Vec3::from(v).as_dvec3();
        let (position, leaving_vector) = (vector(position), vector(leaving));
        let (d, n, top) = (f64::from(top - h), f64::from(n), f64::from(top));
        let sine = direction.x.hypot(direction.y) / n;
        let inner = d * sine / (1.0 - sine * sine).sqrt();
        let shift = (0.5 - top + f64::from(h)) * direction.x.hypot(direction.y) / direction.z + inner;
        let expected = DVec3::new(direction.x, direction.y, 0.0).normalize() * shift + DVec3::Z * 0.5;
        assert!(position.distance(expected) < 2e-7, "{position} instead of {expected}");
        assert!(leaving_vector.distance(DVec3::new(direction.x, direction.y, -direction.z)) < 3e-7);
        // The ray differential equals the difference to a neighbouring ray.
        let step = 1e-3f32;
        let moved = (first + Vec3::from(rays.axes[0]) * step).normalize();
        let (_, [other, turned], _) = chain.trace(zero, moved.into());
        let (other, turned) = (vector(other), vector(turned));
        let reached = (other - position) + (turned - leaving_vector) * 0.3;
        let reached = reached - turned * (reached.dot(leaving_vector) / turned.dot(leaving_vector));
        let [x, y] = rays.jacobians(leaving, 0.3, false).solve(reached.as_vec3().into());
        assert!((x - step).abs() < 3e-6 && y.abs() < 3e-6, "{x} {y}");
        // Total reflection, and a chain with too many events.
        let mut total = LinearizedChains::new(());
        total.push(vertex(h, 1.0 / 3.0, false));
        assert!(!total.trace(zero, first.into()).0);
        let mut long = LinearizedChains::new(());
        (0..7).for_each(|event| long.push(vertex(h + event as f32, 1.0, false)));
        assert!(!long.trace(zero, first.into()).0);
    }
}
