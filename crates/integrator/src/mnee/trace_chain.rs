//! Traces a chain of smooth interfaces from the receiver through the real mesh.

use super::linearized_chain::{LinearizedChain, SpecularVertex};
use super::ray_differential::RayDifferential;
use crate::ray_state::RayState;
use crate::vertex::Vertex;
use dunkelfeld_bsdf::Lobe;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Chain, Scene};

/// The largest number below one. As a choice among two events it never selects the first.
const ALMOST_ONE: f32 = 1.0 - f32::EPSILON / 2.0;
/// Maximum number of surfaces without effect on the direction that one segment may pass.
const MAX_PASSED: u32 = 64;

/// A traced chain up to its last interface.
#[derive(Clone, Copy, Debug)]
pub(super) struct TracedChain {
    /// The segment to the light.
    pub(super) ray_state: RayState,
    /// The ray differential.
    pub(super) ray_differential: RayDifferential,
    /// Throughput of the chain: Fresnel factor of each event, change of radiance by refraction, tints, absorption, and
    /// the open share of partly covering surfaces.
    pub(super) weight: Rgb,
    /// The probability with which scattering takes the same events.
    pub(super) probability: f32,
}

/// Traces a chain through the interfaces of a stack. `None` if it does not exist: another surface is in the way, an
/// interface is missed, or light is reflected totally where it should be transmitted. Afterwards `linearized_chain`
/// contains the interfaces that were hit.
pub(super) fn trace_chain(
    scene: &Scene,
    start: RayState,
    stack: u16,
    chain: Chain,
    linearized_chain: &mut LinearizedChain,
) -> Option<TracedChain> {
    linearized_chain.clear();
    let mut ray_differential = RayDifferential::from_point(start.ray.direction);
    let (mut ray_state, mut weight, mut probability) = (start, Rgb::WHITE, 1.0);
    let (mut event, mut passed) = (0, 0);
    while event < chain.events() {
        let (mut interface, mut bsdf) = (None, None);
        let hit = ray_state.intersect_next(scene, &mut interface)?;
        weight *= ray_state.transmittance(scene, hit.surface.distance);
        let direction = ray_state.ray.direction.as_dvec3();
        ray_differential.transfer(direction, f64::from(hit.surface.distance), hit.surface.normal.as_dvec3());
        let is_cover = scene.cover_of(&hit.surface) == Some(stack);
        let open = match hit.open_tint() {
            Some(tint) => {
                weight *= tint;
                1.0
            }
            None if is_cover => 0.0,
            None => 1.0 - scene.coverage(&hit.surface, ray_state.ray.direction),
        };
        if open > 0.0 {
            // A surface in contact with one that is passed lets light pass as well, or is in the way.
            let (mut open, mut last) = (open, None);
            while let Some(point) =
                if hit.open_tint().is_none() { scene.next_coincident(&ray_state.ray, hit.surface, last) } else { None }
            {
                open *= 1.0 - scene.coverage(&point, ray_state.ray.direction);
                last = Some(point);
            }
            if open == 0.0 {
                return None;
            }
            weight *= open;
            probability *= open;
            passed += 1;
            if passed > MAX_PASSED {
                return None;
            }
            ray_state = ray_state.pass_through(&hit);
            continue;
        }
        if !is_cover {
            return None;
        }
        let at = Vertex::on_surface(scene, ray_state, hit, 0.0, &mut bsdf);
        let is_reflection = chain.is_reflection(event);
        let (wi, scattered) = at.delta(if is_reflection { 0.0 } else { ALMOST_ONE })?;
        if Lobe::from_bits(scattered.lobe.0).contains(Lobe::REFLECTION) != is_reflection {
            return None;
        }
        let (normal, differential) = scene.normal_differential(&hit.surface, at.wo)?;
        let (normal, eta) = (normal.as_dvec3(), f64::from(scattered.eta));
        if is_reflection {
            ray_differential.reflect(direction, normal, differential.as_ref());
        } else {
            ray_differential.refract((direction, wi.as_dvec3()), normal, eta, differential.as_ref());
        }
        let (point, geometric_normal) = (hit.surface.point.as_dvec3(), hit.surface.normal.as_dvec3());
        linearized_chain.push(SpecularVertex {
            point,
            geometric_normal,
            normal,
            differential,
            eta: (!is_reflection).then_some(eta),
        });
        weight *= scattered.weight * scattered.pdf;
        probability *= scattered.pdf;
        ray_state = at.spawn_ray(wi);
        event += 1;
    }
    Some(TracedChain { ray_state, ray_differential, weight, probability })
}
