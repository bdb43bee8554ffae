//! Path tracing with next-event estimation: the loop over the vertices of a path. Light samples and scattered rays are
//! combined by multiple importance sampling.

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

/// From this bounce on the survival probability is below one, also for a path without any loss. So light between
/// perfect mirrors ends.
const ENDLESS: u32 = 64;
/// Survival probability of such a path. The variance of a closed cavity is finite up to an albedo of the square root of
/// this value, 0.9899. A value nearer to one would give finite variance for brighter cavities, but light trapped in
/// clear sheets would be traced for longer.
const ENDLESS_SURVIVAL: f32 = 0.98;

/// The same limit for scattering in media. It is high because light in a dense medium without absorption is scattered
/// some thousand times before it leaves the medium. A lower limit would end paths early and increase the weight of the
/// others.
const ENDLESS_IN_MEDIA: u32 = 4096;
/// Survival probability of such a path.
const ENDLESS_IN_MEDIA_SURVIVAL: f32 = 0.995;

/// Scale of Russian roulette: a path whose throughput is a third or more always survives. Termination on dark surfaces
/// produces rare bright samples. On the inspection scenes this factor reduces the variance of the image by a third and
/// costs a tenth more time (`validation/README.md`).
const SPARED: f32 = 3.0;

/// Estimates the radiance along a camera ray. The estimate is unbiased. The length of the path is not bounded.
// Never inlined: the instances share one caller, which must stay small.
#[inline(never)]
pub(crate) fn follow<F: Features>(scene: &Scene, ray: Ray, sampler: &Sampler, recorder: &mut impl Recorder) -> Sample {
    let mut path = Path::<F, _>::new(scene, ray, sampler, recorder);
    for vertex in 0.. {
        // Storage for the interface and the BSDF of this vertex, for vertices that need their own.
        let (mut interface, mut bsdf) = (None, None);
        // The next surface along the ray. If there is none, the environment may add light.
        let Some(met) = path.walk.intersect_next::<F>(scene, &mut interface) else {
            path.sees_environment();
            break;
        };
        // The medium in between attenuates the path, or scatters it before the surface.
        if let Some(at) = path.travels(vertex, met.hit.distance) {
            if path.scatters_at(&at, vertex) { continue } else { break }
        }
        // The path passes a face that bends no light, and a stochastic surface that is absent for this sample.
        let Some(u_kind) = path.meets(vertex, &met) else { continue };
        let at = SurfaceVertex::<F>::new(scene, path.walk, met, u_kind, &mut bsdf);
        // Emission of the surface, then next-event estimation, then a new direction.
        path.sees_surface(&at);
        if !path.scatters_at(&at, vertex) {
            break;
        }
    }
    path.sample
}

/// The state of a path.
struct Path<'a, F, R> {
    scene: &'a Scene,
    sampler: &'a Sampler,
    recorder: &'a mut R,
    walk: RayState,
    /// Path throughput: the weight of all further contributions.
    throughput: Rgb,
    /// Change of radiance by refraction (the factor eta^2). Russian roulette must not treat it as loss.
    eta_scale: f32,
    /// Number of scatterings at surfaces (`bounces`) and in media (`scatterings`).
    bounces: u32,
    scatterings: u32,
    /// Number of vertices with next-event estimation.
    asked: u32,
    /// Distance from the camera along the path \[m\].
    passed: f32,
    /// True while the path has hit only smooth glass and mirrors, which the auxiliary layers pass through.
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

    /// The ray leaves the scene and adds the radiance of the environment.
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

    /// The ray hits a surface and adds its emission.
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

    /// Adds light that a scattered ray has hit. `other` [1/sr] is the density with which light sampling draws the same
    /// direction. Both techniques share the light by the power heuristic. Behind a cover the other technique is the
    /// connection, if it finds the chain to `end`.
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

    /// The segment to the next surface: multiplies the throughput by the transmittance of the medium. Returns the
    /// vertex if the medium scatters the path before the surface.
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

    /// Decides if the path meets the surface. If it does, returns a number in `[0, 1)` that is still unused, for
    /// surfaces with two random kinds. If not, the path continues in the same direction and the result is `None`.
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
        // This is no vertex. So the last scattering stays the one that competes with light sampling.
        self.passed += met.hit.distance;
        self.walk = self.walk.pass_through::<F>(met);
        None
    }

    /// Scattering at a vertex: auxiliary layers, next-event estimation and a new direction. False if the path ends.
    #[inline]
    fn scatters_at<V: Vertex>(&mut self, at: &V, vertex: u32) -> bool {
        // Auxiliary layers: the first surface behind smooth glass and mirrors. If the path ends there, the layers keep
        // the values of the glass.
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

        // Next-event estimation.
        let choice = self.scene.light_choice_at(self.asked, V::IN_MEDIUM);
        if !is_delta {
            // The first vertex contributes most of the light of the pixel, so its shadow rays are never skipped by
            // roulette.
            let found_before = if self.asked > 0 { self.sample.radiance } else { Rgb::BLACK };
            self.asked += 1;
            for question in 0..self.scene.light_questions(choice) {
                let u = self.sampler.numbers(dimensions::light(vertex, question));
                // With one sample for each light there is no choice of a light. The number decides the roulette
                // instead.
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

        // A new direction by sampling the BSDF or the phase function.
        let [u_x, u_y, u_lobe, u_roulette] = self.sampler.get_4d(dimensions::scatter(vertex));
        let Some(scattered) = at.sample([u_x, u_y, u_lobe]) else { return false };
        self.throughput *= scattered.weight;
        self.eta_scale *= scattered.eta * scattered.eta;

        // Russian roulette on the throughput.
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

    /// True if the scene has covers for connections and the kernel includes solids.
    #[inline]
    fn has_covers(&self) -> bool {
        F::SOLIDS && !self.scene.covers().is_empty()
    }

    /// Counts a scattering and returns the survival probability of a path without loss.
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

/// The survival probability in Russian roulette (Arvo and Kirk 1990). `carried` is the throughput without the factor
/// eta^2. The last argument is the survival probability of a path without loss.
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
        // Below the limit the surviving path carries a third again.
        for carried in [1e-6f32, 0.01, 0.2] {
            assert!((carried / survival(carried, 1.0) - 1.0 / 3.0).abs() < 1e-6, "{carried}");
        }
    }
}
