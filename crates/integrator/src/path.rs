//! A path through the scene until it ends: next-event estimation and scattering, weighed against each other.

use crate::dimensions;
use crate::direct::{self, LastScatter, ShadowRoulette};
use crate::mnee::{self, End, SpecularPrefix};
use crate::ray_state::{RayState, SurfaceHit};
use crate::recorder::Recorder;
use crate::vertex::{MediumVertex, SurfaceVertex, Vertex};
use dunkelfeld_bsdf::Lobe;
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::Ray;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{Features, LightChoice, MediumEvent, Scene};
use std::marker::PhantomData;

/// From this bounce on even a path that has lost nothing survives with less than certainty, so that light caught between
/// perfect mirrors comes to an end.
const ENDLESS: u32 = 64;
/// Survival of such a path. The variance of closed cavities is finite up to an albedo of its square root, 0.9899; nearer to one
/// it would be so for brighter ones, and light trapped in clear sheets would be followed for longer.
const ENDLESS_SURVIVAL: f32 = 0.98;

/// The same for scattering in media. It is late: light in a dense medium that absorbs nothing is scattered some thousand
/// times before it finds out, and a walk cut short would weigh the rest.
const ENDLESS_IN_MEDIA: u32 = 4096;
/// Survival of such a path.
const ENDLESS_IN_MEDIA_SURVIVAL: f32 = 0.995;

/// Roulette spares a path that carries a third or more. What ends early on dark surfaces returns as rare bright samples: on the
/// inspection scenes the variance of the image falls by a third for a tenth of the time (`validation/README.md`).
const SPARED: f32 = 3.0;

/// Follows a camera ray. The radiance is unbiased; path length is unbounded.
// Never inlined: the instances share one caller, which must stay small.
#[inline(never)]
pub(crate) fn follow<F: Features>(scene: &Scene, ray: Ray, sampler: &Sampler, recorder: &mut impl Recorder) -> Sample {
    let mut path = Path::<F, _>::new(scene, ray, sampler, recorder);
    for vertex in 0.. {
        // What a vertex has for itself alone, where it has.
        let (mut interface, mut bsdf) = (None, None);
        // The next surface on the way. Beyond the last one there may be light from infinitely far away.
        let Some(met) = path.walk.intersect_next::<F>(scene, &mut interface) else {
            path.sees_environment();
            break;
        };
        // The medium in between takes its part, or scatters the path before it gets there.
        if let Some(at) = path.travels(vertex, met.hit.distance) {
            if path.scatters_at(&at, vertex) { continue } else { break }
        }
        // A face that bends no light, and a surface that is not there this time, let it pass.
        let Some(u_kind) = path.meets(vertex, &met) else { continue };
        let at = SurfaceVertex::<F>::new(scene, path.walk, met, u_kind, &mut bsdf);
        // Light that the surface itself emits; light from lights, connected directly; a direction to go on in.
        path.sees_surface(&at);
        if !path.scatters_at(&at, vertex) {
            break;
        }
    }
    path.sample
}

/// A path on its way.
struct Path<'a, F, R> {
    scene: &'a Scene,
    sampler: &'a Sampler,
    recorder: &'a mut R,
    walk: RayState,
    /// Weight of what is still to be found.
    throughput: Rgb,
    /// What refraction did to radiance (the factor eta^2) and roulette must not mistake for loss.
    eta_scale: f32,
    /// Scatterings at surfaces, and in media.
    bounces: u32,
    scatterings: u32,
    /// Vertices that have asked for light.
    asked: u32,
    /// Distance travelled \[m\].
    passed: f32,
    /// Has the path met nothing but surfaces that show others: smooth glass, mirrors?
    sees_glass: bool,
    last: Option<LastScatter>,
    sample: Sample,
    features: PhantomData<F>,
}

impl<'a, F: Features, R: Recorder> Path<'a, F, R> {
    #[inline]
    fn new(scene: &'a Scene, ray: Ray, sampler: &'a Sampler, recorder: &'a mut R) -> Self {
        Self {
            scene,
            sampler,
            recorder,
            walk: RayState::from_camera::<F>(scene, ray),
            throughput: Rgb::WHITE,
            eta_scale: 1.0,
            bounces: 0,
            scatterings: 0,
            asked: 0,
            passed: 0.0,
            sees_glass: false,
            last: None,
            sample: Sample::MISS,
            features: PhantomData,
        }
    }

    /// The path leaves the scene.
    #[inline]
    fn sees_environment(&mut self) {
        let direction = self.walk.ray.direction;
        self.recorder.vertex(direction.to_array(), None, self.throughput);
        let found = self.throughput * self.scene.environment_radiance(direction);
        if !found.is_black() {
            let end = || End::infinite(direction);
            self.finds(found, end, |scene, l| scene.environment_pdf(&l.receiver, l.choice, direction));
        }
    }

    /// The path meets a surface, which may emit light.
    #[inline]
    fn sees_surface(&mut self, at: &SurfaceVertex<'_, F>) {
        self.recorder.vertex(at.met.hit.point.to_array(), Some(at.shading.material), self.throughput);
        let found = self.throughput * self.scene.emitted(&at.met.hit, at.wo);
        if !found.is_black() {
            let end = || End::surface(at.met.hit.point, at.met.hit.normal);
            let hit = at.met.hit;
            self.finds(found, end, |scene, l| scene.light_pdf(&l.receiver, l.choice, &hit));
        }
    }

    /// Light that the path has run into. Where light sampling could have found it too, with the density `other` [1/sr], the
    /// two share; behind a cover, if the connection could have found `end`.
    #[inline]
    fn finds(&mut self, light: Rgb, end: impl FnOnce() -> End, other: impl FnOnce(&Scene, &LastScatter) -> f32) {
        let share = match self.last {
            None => 1.0,
            Some(l) => {
                let other = other(self.scene, &l);
                match l.passage.filter(|p| F::SOLIDS && !p.is_direct()) {
                    None => direct::power_heuristic(l.pdf, other),
                    Some(p) => mnee::share_of_scattering::<F>(self.scene, &l.receiver, &p, end(), l.pdf, other),
                }
            }
        };
        let found = light * share;
        self.recorder.emitted(found);
        self.sample.radiance += found;
    }

    /// The way to the next surface: what the medium takes. The place where it scatters the path instead, if it does.
    #[inline]
    fn travels(&mut self, vertex: u32, distance: f32) -> Option<MediumVertex<'a>> {
        if !F::MEDIA {
            if F::SOLIDS {
                self.throughput *= self.walk.transmittance::<F>(self.scene, distance);
            }
            return None;
        }
        let medium = self.walk.medium(self.scene)?;
        let event = if medium.scatters() {
            let [_, u_distance, u_channel, u_digits] = self.sampler.get_4d(dimensions::kind(vertex));
            medium.sample(self.throughput, distance, [u_distance, u_channel, u_digits])
        } else {
            MediumEvent::Pass { weight: medium.transmittance(distance) }
        };
        match event {
            MediumEvent::Pass { weight } => {
                self.throughput *= weight;
                None
            }
            MediumEvent::Scatter { distance, weight } => {
                self.throughput *= weight;
                let at = MediumVertex::new(medium, self.walk, distance);
                self.recorder.medium(at.point.to_array(), self.walk.solid::<F>(self.scene), self.throughput);
                Some(at)
            }
        }
    }

    /// Does the path meet the surface? Then a number in `[0, 1)` that is still to be used, for surfaces that are one of two
    /// things at random; else it goes on as if nothing were there.
    #[inline]
    fn meets(&mut self, vertex: u32, met: &SurfaceHit<'_>) -> Option<f32> {
        let tint = if F::MEDIA { met.open_tint() } else { None };
        let mut u_kind = 0.0;
        if let Some(tint) = tint {
            self.throughput *= tint;
        } else if F::STOCHASTIC && self.scene.is_chance(&met.hit) {
            u_kind = self.sampler.get_1d(dimensions::kind(vertex));
            let coverage = self.scene.coverage(&met.hit);
            if u_kind < coverage {
                return Some(u_kind / coverage);
            }
        } else {
            return Some(u_kind);
        }
        // No vertex: what the path could have been lit by before it can be still.
        self.passed += met.hit.distance;
        self.walk = self.walk.pass_through::<F>(met);
        None
    }

    /// Everything at a place where light is scattered: light from lights, and a direction to go on in. False if the path ends.
    #[inline]
    fn scatters_at<V: Vertex>(&mut self, at: &V, vertex: u32) -> bool {
        // What the camera sees, through smooth glass and in mirrors; a path that ends there has seen the glass.
        self.passed += at.distance();
        let is_delta = at.is_delta();
        if !self.sample.hit || self.sees_glass {
            let is_see_through = at.is_see_through();
            if !self.sample.hit || !is_see_through {
                let (albedo, normal) = at.look();
                self.sample =
                    Sample { hit: true, albedo, normal: normal.to_array(), depth: self.passed, ..self.sample };
            }
            self.sees_glass = is_see_through;
        }

        // Light from lights, connected directly.
        let choice = self.scene.light_choice_at(self.asked, V::IN_MEDIUM);
        if !is_delta {
            // The first vertex brings most of the light that the camera sees, and asks every question.
            let found_before = if self.asked > 0 { self.sample.radiance } else { Rgb::BLACK };
            self.asked += 1;
            for question in 0..self.scene.light_questions(choice) {
                let u = self.sampler.numbers(dimensions::light(vertex, question));
                // Where each light is asked there is none to choose, but whether to ask it.
                let (u_choice, roulette) = match choice {
                    LightChoice::One => (u.get(2), ShadowRoulette::NONE),
                    LightChoice::Each => (0.0, ShadowRoulette::new(self.throughput, found_before, || u.get(2))),
                };
                let place = u.first_two();
                let Some(light) = self.scene.sample_light(at.receiver(), choice, question, u_choice, place) else {
                    continue;
                };
                let mut found = direct::light_from::<F, _>(self.scene, at, &light, roulette);
                self.recorder.direct(self.throughput * found);
                if self.has_covers() {
                    let connected =
                        mnee::light_from::<F, _>(self.scene, at, &light, roulette, || u.get(3), self.recorder);
                    self.recorder.connected(self.throughput * connected);
                    found += connected;
                }
                self.sample.radiance += self.throughput * found;
            }
        }

        // A direction to go on in.
        let [u_x, u_y, u_lobe, u_roulette] = self.sampler.get_4d(dimensions::scatter(vertex));
        let Some(scattered) = at.sample([u_x, u_y, u_lobe]) else { return false };
        self.throughput *= scattered.weight;
        self.eta_scale *= scattered.eta * scattered.eta;

        // Roulette on what the path still carries.
        let survival = survival(self.throughput.max_channel() * self.eta_scale, self.endurance::<V>());
        if u_roulette >= survival {
            return false;
        }
        self.throughput *= 1.0 / survival;
        self.recorder.scattered(&scattered);

        self.walk = at.leave(scattered.wi);
        if !scattered.lobe.contains(Lobe::DELTA) {
            let passage = self.has_covers().then(|| SpecularPrefix::from(self.walk));
            self.last = Some(LastScatter { receiver: *at.receiver(), choice, pdf: scattered.pdf, passage });
        } else if self.has_covers() {
            let is_reflection = scattered.lobe.contains(Lobe::REFLECTION);
            self.last = self.last.take().and_then(|last| {
                let passage = last.passage?.then(self.scene, at.surface()?, is_reflection)?;
                Some(LastScatter { passage: Some(passage), ..last })
            });
        } else {
            self.last = None;
        }
        true
    }

    /// Are there covers to connect through?
    #[inline]
    fn has_covers(&self) -> bool {
        F::SOLIDS && !self.scene.covers().is_empty()
    }

    /// Counts a scattering; the survival of a path that has lost nothing.
    #[inline]
    fn endurance<V: Vertex>(&mut self) -> f32 {
        let (count, endless, survival) = if V::IN_MEDIUM {
            (&mut self.scatterings, ENDLESS_IN_MEDIA, ENDLESS_IN_MEDIA_SURVIVAL)
        } else {
            (&mut self.bounces, ENDLESS, ENDLESS_SURVIVAL)
        };
        *count += 1;
        if *count < endless { 1.0 } else { survival }
    }
}

/// The probability that roulette lets a path go on that carries so much, and that survives with the given probability if it
/// has lost nothing (Arvo and Kirk 1990).
#[inline]
fn survival(carried: f32, endurance: f32) -> f32 {
    (SPARED * carried).min(endurance)
}

#[cfg(test)]
mod tests {
    use super::survival;

    #[test]
    fn roulette_spares_what_still_carries_a_third() {
        for carried in [1.0 / 3.0, 0.5, 1.0, 7.0] {
            assert_eq!(survival(carried, 1.0), 1.0, "{carried}");
        }
        assert_eq!(survival(0.1, 1.0), 0.3);
        assert_eq!(survival(0.0, 1.0), 0.0, "what carries nothing ends");
        assert_eq!(survival(1.0, 0.98), 0.98, "nothing goes on for ever");
        // What goes on below that carries a third again.
        for carried in [1e-6f32, 0.01, 0.2] {
            assert!((carried / survival(carried, 1.0) - 1.0 / 3.0).abs() < 1e-6, "{carried}");
        }
    }
}
