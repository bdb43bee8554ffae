//! A ray followed through the scene until it ends: next-event estimation and scattering, weighed against each other.

use crate::medium::{self, MediumVertex};
use crate::sets;
use crate::trace::Recorder;
use dunkelfeld_bsdf::Lobe;
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{
    Boundary, Features, Interface, Interior, LightChoice, LightReceiver, LightSample, MediumEvent, Scene, ShadingPoint,
    SurfacePoint,
};

/// From this bounce on even a path that has lost nothing survives with less than certainty, so that light caught between
/// perfect mirrors comes to an end.
const ENDLESS: u32 = 64;
/// Survival of such a path.
const ENDLESS_SURVIVAL: f32 = 0.98;

/// The last place where light sampling and scattering both could have found a light.
pub(crate) struct LastScatter {
    pub(crate) receiver: LightReceiver,
    /// Which lights were asked.
    pub(crate) choice: LightChoice,
    /// Density of the direction that was taken [1/sr].
    pub(crate) pdf: f32,
}

/// Follows a camera ray. The radiance is unbiased; path length is unbounded.
// Never inlined: the instances share one caller, which must stay small.
#[inline(never)]
pub(crate) fn follow<F: Features>(
    scene: &Scene,
    mut ray: Ray,
    sampler: &Sampler,
    recorder: &mut impl Recorder,
) -> Sample {
    let mut sample = Sample::MISS;
    let mut throughput = Rgb::WHITE;
    // What refraction did to radiance (the factor eta^2) and roulette must not mistake for loss.
    let mut eta_scale = 1.0;
    // The solid that the ray travels in; with media, all solids that it may be in at once.
    let mut inside: Option<u32> = None;
    let mut around = if F::MEDIA { scene.interior_at(ray.origin) } else { Interior::OUTSIDE };
    let mut scatterings = 0;
    let mut last: Option<LastScatter> = None;
    let mut bounce = 0;
    // Vertices that have asked for light.
    let mut asked = 0;
    // Distance travelled through surfaces that let the ray pass unchanged.
    let mut passed = 0.0;

    for vertex in 0.. {
        let Some(mut hit) = scene.intersect(&ray) else {
            recorder.vertex(ray.direction.to_array(), None, throughput);
            let found = throughput * scene.environment_radiance(ray.direction);
            if !found.is_black() {
                let other = last.as_ref().map_or(0.0, |l| scene.environment_pdf(&l.receiver, l.choice, ray.direction));
                let found = found * weight_against(last.as_ref(), other);
                recorder.emitted(found);
                sample.radiance += found;
            }
            break;
        };
        // What the medium on the way does, and which of the faces that coincide here counts.
        let mut interface: Option<Interface> = None;
        if F::MEDIA {
            let met = scene.interface(&ray, &hit, &around);
            if let Some(medium) = scene.medium(&around) {
                let event = if medium.scatters() {
                    let [_, u_distance, u_channel, u_digits] = sampler.get_4d(sets::kind(vertex));
                    medium.sample(throughput, hit.distance, [u_distance, u_channel, u_digits])
                } else {
                    MediumEvent::Pass { weight: medium.transmittance(hit.distance) }
                };
                match event {
                    MediumEvent::Pass { weight } => throughput *= weight,
                    MediumEvent::Scatter { distance, weight } => {
                        throughput *= weight;
                        let at = MediumVertex { medium, point: ray.at(distance), wo: -ray.direction, around: &around };
                        recorder.medium(at.point.to_array(), scene.material_inside(&around), throughput);
                        if !sample.hit && bounce == 0 {
                            sample.hit = true;
                            sample.albedo = medium.albedo();
                            sample.normal = at.wo.to_array();
                            sample.depth = passed + distance;
                        }
                        let choice = scene.light_choice_at(asked);
                        asked += 1;
                        for light in lights(scene, &at.receiver(), choice, sampler, vertex) {
                            let direct = throughput * at.direct_light(scene, &light);
                            recorder.direct(direct);
                            sample.radiance += direct;
                        }

                        let [u_x, u_y, _, u_roulette] = sampler.get_4d(sets::scatter(vertex));
                        let (wi, scattered) = at.scatter(choice, [u_x, u_y]);
                        scatterings += 1;
                        let survival = medium::survival(throughput.max_channel() * eta_scale, scatterings);
                        if u_roulette >= survival {
                            break;
                        }
                        throughput *= 1.0 / survival;
                        recorder.scattered(wi.to_array(), scattered.pdf, Rgb::WHITE);
                        ray = Ray::new(at.point, wi);
                        last = Some(scattered);
                        continue;
                    }
                }
            }
            hit = met.surface;
            if let Boundary::Open { tint } = met.boundary {
                // No vertex: what the path could have been lit by before it can be still.
                throughput *= tint;
                passed += hit.distance;
                around = met.far();
                ray = Ray::new(hit.leave(ray.direction), ray.direction);
                continue;
            }
            interface = Some(met);
        } else if F::SOLIDS {
            throughput *= attenuation(scene, inside, hit.distance);
        }
        // Coverage: the ray meets the surface with that probability, else it goes on as if nothing were there.
        let mut u_kind = 0.0;
        if F::CHANCE && scene.is_chance(&hit) {
            u_kind = sampler.get_1d(sets::kind(vertex));
            let coverage = scene.coverage(&hit);
            if u_kind >= coverage {
                passed += hit.distance;
                ray = Ray::new(hit.leave(ray.direction), ray.direction);
                continue;
            }
            u_kind /= coverage;
        }

        let wo = -ray.direction;
        let shading = match interface.as_ref().map(|i| i.boundary) {
            Some(Boundary::Between { eta }) => scene.shade_between(&hit, wo, u_kind, eta),
            _ => scene.shade_with::<F>(&hit, wo, u_kind),
        };
        recorder.vertex(hit.point.to_array(), Some(shading.material), throughput);

        // Light that the surface itself emits; where light sampling could have found it too, the two share.
        let emitted = throughput * scene.emitted(&hit, wo);
        if !emitted.is_black() {
            let other = last.as_ref().map_or(0.0, |l| scene.light_pdf(&l.receiver, l.choice, &hit));
            let emitted = emitted * weight_against(last.as_ref(), other);
            recorder.emitted(emitted);
            sample.radiance += emitted;
        }

        let wo_local = shading.frame.to_local(wo);
        if bounce == 0 && !sample.hit {
            sample.hit = true;
            sample.albedo = shading.bsdf.albedo(wo_local);
            sample.normal = shading.frame.normal.to_array();
            sample.depth = passed + hit.distance;
        }

        // Light from lights, connected directly.
        let choice = scene.light_choice_at(asked);
        if !shading.bsdf.is_delta() {
            asked += 1;
            for light in lights(scene, &shading.receiver, choice, sampler, vertex) {
                let inside = (inside, interface.as_ref());
                let direct = throughput * direct_light::<F>(scene, &hit, &shading, wo, inside, &light);
                recorder.direct(direct);
                sample.radiance += direct;
            }
        }

        // A direction to go on in.
        let [u_x, u_y, u_lobe, u_roulette] = sampler.get_4d(sets::scatter(vertex));
        let Some(scattered) = shading.bsdf.sample(wo_local, u_lobe, [u_x, u_y]) else { break };
        let wi = shading.frame.to_world(scattered.wi);
        if !shading.consistent(hit.normal, wi, scattered.wi) {
            break;
        }
        throughput *= scattered.weight;
        eta_scale *= scattered.eta * scattered.eta;
        bounce += 1;

        // Roulette on what the path still carries.
        let survival =
            (throughput.max_channel() * eta_scale).min(if bounce < ENDLESS { 1.0 } else { ENDLESS_SURVIVAL });
        if u_roulette >= survival {
            break;
        }
        throughput *= 1.0 / survival;
        recorder.scattered(wi.to_array(), scattered.pdf, scattered.weight);

        last = (!scattered.lobe.contains(Lobe::DELTA)).then_some(LastScatter {
            receiver: shading.receiver,
            choice,
            pdf: scattered.pdf,
        });
        if let Some(interface) = &interface {
            around = interface.beyond(wi);
        } else if F::SOLIDS && scattered.lobe.contains(Lobe::TRANSMISSION) {
            inside = medium_beyond(&shading, &hit, wi, inside);
        }
        ray = Ray::new(hit.leave(wi), wi);
    }
    sample
}

/// The answers of the lights that a vertex asks: each while the path is young and they are few, else one.
#[inline]
fn lights<'a>(
    scene: &'a Scene,
    receiver: &'a LightReceiver,
    choice: LightChoice,
    sampler: &'a Sampler,
    vertex: u32,
) -> impl Iterator<Item = LightSample> + 'a {
    (0..scene.light_questions(choice)).filter_map(move |question| {
        let [x, y, u_choice, _] = sampler.get_4d(sets::light(vertex, question));
        scene.sample_light(receiver, choice, question, u_choice, [x, y])
    })
}

/// Light that reaches a point straight from a light and is scattered toward `wo`.
#[inline]
fn direct_light<F: Features>(
    scene: &Scene,
    hit: &SurfacePoint,
    shading: &ShadingPoint<'_>,
    wo: Vec3,
    (inside, interface): (Option<u32>, Option<&Interface>),
    light: &LightSample,
) -> Rgb {
    let wi = shading.frame.to_local(light.direction);
    if !shading.consistent(hit.normal, light.direction, wi) {
        return Rgb::BLACK;
    }
    let (scattered, pdf) = shading.bsdf.eval_pdf(shading.frame.to_local(wo), wi);
    let unoccluded = scattered * light.radiance;
    if unoccluded.is_black() {
        return Rgb::BLACK;
    }
    let ray = scene.shadow_ray(hit, light.direction, light.target.as_ref());
    let share = if light.is_delta { 1.0 } else { power_heuristic(light.pdf, pdf) };
    if let Some(interface) = interface {
        return unoccluded * scene.light_through(&ray, &interface.beyond(light.direction)) * (share / light.pdf);
    }
    let visible = scene.transmittance_with::<F>(&ray);
    if visible == 0.0 {
        return Rgb::BLACK;
    }
    let arriving = unoccluded * (visible * share / light.pdf);
    if !F::SOLIDS {
        return arriving;
    }
    let crosses = (light.direction.dot(hit.normal) > 0.0) != (wo.dot(hit.normal) > 0.0);
    let medium = if crosses { medium_beyond(shading, hit, light.direction, inside) } else { inside };
    arriving * attenuation(scene, medium, ray.t_max)
}

/// The solid on the far side of a surface that light crosses in direction `wi`.
#[inline]
fn medium_beyond(shading: &ShadingPoint<'_>, hit: &SurfacePoint, wi: Vec3, inside: Option<u32>) -> Option<u32> {
    match (shading.is_solid, wi.dot(hit.normal) < 0.0) {
        (true, true) => Some(shading.material),
        (true, false) => None,
        (false, _) => inside,
    }
}

/// What absorption leaves over a distance [m] (Beer and Lambert).
#[inline]
fn attenuation(scene: &Scene, inside: Option<u32>, distance: f32) -> Rgb {
    let Some(material) = inside else { return Rgb::WHITE };
    let absorption = scene.absorption(material);
    if absorption.is_black() {
        Rgb::WHITE
    } else {
        absorption.map(|a| if a > 0.0 { (-a * distance).exp() } else { 1.0 })
    }
}

/// The share of scattering in light that light sampling could have found with density `other` [1/sr]. Camera rays and
/// delta lobes find light that nothing else can.
#[inline]
fn weight_against(last: Option<&LastScatter>, other: f32) -> f32 {
    last.map_or(1.0, |l| power_heuristic(l.pdf, other))
}

/// The power heuristic with exponent 2 (Veach & Guibas 1995): the share of the technique with density `own`.
#[inline]
pub(crate) fn power_heuristic(own: f32, other: f32) -> f32 {
    if own.is_infinite() {
        return 1.0;
    }
    // Of the ratio, so that squares of large densities do not overflow.
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

#[cfg(test)]
mod tests {
    use super::power_heuristic;

    #[test]
    fn the_shares_of_two_techniques_sum_to_one() {
        for (a, b) in [(1.0, 2.0), (1e-20, 1e20), (3e30, 2e30), (5.0, 0.0)] {
            let sum = power_heuristic(a, b) + power_heuristic(b, a);
            assert!((sum - 1.0).abs() < 1e-6 || b == 0.0, "{a} and {b} sum to {sum}");
        }
        assert_eq!(power_heuristic(5.0, 0.0), 1.0);
        assert!((power_heuristic(2.0, 1.0) - 0.8).abs() < 1e-6);
    }
}
