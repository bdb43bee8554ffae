//! Path tracing with next-event estimation: the loop over the vertices of a path. Light samples and scattered rays are
//! combined by multiple importance sampling.

use crate::dimensions;
use crate::direct::{self, LastScatter, ShadowRoulette};
use crate::learned_roulette::LearnedRoulette;
use crate::mnee::{self, End, SpecularPrefix};
use crate::ray_state::{RayState, SurfaceHit};
use crate::recorder::Recorder;
use crate::vertex::{MediumVertex, SurfaceVertex, Vertex};
use dunkelfeld_bsdf::Lobe;
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_lanes::Lanes;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{Features, Interface, LightChoice, LightSampleContext, MediumEvent, Scene, SurfacePoint};
use std::marker::PhantomData;

/// From this bounce at a surface on the survival probability is below one, also for a path without any loss. So light
/// between perfect mirrors ends. A path in a medium leaves it, and ends by its loss only: a limit would end a share of
/// the long paths in a dense white medium and increase the weight of the others, with infinite variance.
const FORCED_RR_BOUNCES: u32 = 64;
/// Survival probability of such a path. The variance of a closed cavity is finite up to an albedo of the square root of
/// this value, 0.9899. A value nearer to one would give finite variance for brighter cavities, but light trapped in
/// clear sheets would be traced for longer.
const MAX_SURVIVAL: f32 = 0.98;

/// A path that is scattered in a medium can be abandoned after each so many vertices: some milliseconds.
const CHECK_EVERY: u32 = 4096;

/// Scale of Russian roulette: a path whose throughput is a third or more always survives. Termination on dark surfaces
/// produces rare bright samples. On the inspection scenes this factor reduces the variance of the image by a third and
/// costs a tenth more time (`validation/README.md`).
const RR_SCALE: f32 = 3.0;

/// Estimates the radiance along a camera ray. The estimate is unbiased. The length of the path is not bounded. Returns
/// the recorder with its sample.
// Never inlined: the instances share one caller, which must stay small.
#[inline(never)]
pub(crate) fn trace_path<F: Features, R: Recorder>(
    scene: &Scene,
    roulette: Option<&LearnedRoulette>,
    ray: Ray,
    sampler: Sampler,
    recorder: R,
) -> (Sample, R) {
    let mut path = Path::<F, _>::new(scene, roulette, ray, sampler, recorder);
    for vertex in 0.. {
        // Storage for the interface and the BSDF of this vertex, for vertices that need their own.
        let (mut interface, mut bsdf) = (None, None);
        // The next surface along the ray. If there is none, the environment may add light.
        let Some(hit) = path.ray_state.intersect_next::<F>(scene, &mut interface) else {
            path.add_environment();
            break;
        };
        // The medium in between attenuates the path, or scatters it before the surface.
        if let Some(at) = path.sample_medium(vertex, hit.surface.distance) {
            let is_checked = vertex % CHECK_EVERY == CHECK_EVERY - 1;
            if path.scatter(&at, vertex) && !(is_checked && path.recorder.abandons()) { continue } else { break }
        }
        // The path passes a face without refraction, and a stochastic surface that is absent for this sample. A surface
        // in contact with an absent one may be present.
        let mut behind = None;
        let (hit, u_kind) = match path.sample_coverage(vertex, &hit) {
            Presence::Present { u_kind } => (hit, u_kind),
            Presence::Open => continue,
            Presence::Absent { u } => match path.sample_coincident(hit.surface, u, &mut behind) {
                Some(found) => found,
                None => continue,
            },
        };
        let at = SurfaceVertex::<F>::new(scene, path.ray_state, hit, u_kind, &mut bsdf);
        // Emission of the surface, then next-event estimation, then a new direction.
        path.recorder.vertex(at.hit.surface.point.to_array(), Some(at.shading.material), path.throughput);
        path.add_emission(&at.hit.surface);
        if !path.scatter(&at, vertex) {
            break;
        }
    }
    (path.sample, path.recorder)
}

/// The state of a path.
#[derive(Debug)]
pub(crate) struct Path<'a, F, R> {
    pub(crate) scene: &'a Scene,
    pub(crate) roulette: Option<&'a LearnedRoulette>,
    /// Scale of the learned survival probabilities; `None` before the first surface with statistics.
    pub(crate) gain_scale: Option<f32>,
    pub(crate) sampler: Sampler,
    pub(crate) recorder: R,
    pub(crate) ray_state: RayState,
    /// Path throughput: the weight of all further contributions.
    pub(crate) throughput: Rgb,
    /// Change of radiance by refraction (the factor eta^2). Russian roulette must not treat it as loss.
    pub(crate) eta_scale: f32,
    /// Number of scatterings at surfaces.
    pub(crate) bounces: u32,
    /// Number of vertices with light samples so far.
    pub(crate) light_vertices: u32,
    /// Distance from the camera along the path \[m\].
    pub(crate) path_length: f32,
    /// True while the path has hit only smooth glass and mirrors. The auxiliary layers describe the surface behind
    /// them.
    pub(crate) only_specular: bool,
    pub(crate) last: Option<LastScatter>,
    pub(crate) sample: Sample,
    features: PhantomData<F>,
}

impl<'a, F: Features, R: Recorder> Path<'a, F, R> {
    #[inline]
    pub(crate) fn new(
        scene: &'a Scene,
        roulette: Option<&'a LearnedRoulette>,
        ray: Ray,
        sampler: Sampler,
        recorder: R,
    ) -> Self {
        Self {
            scene,
            roulette,
            gain_scale: None,
            sampler,
            recorder,
            ray_state: RayState::from_camera::<F>(scene, ray),
            throughput: Rgb::WHITE,
            eta_scale: 1.0,
            bounces: 0,
            light_vertices: 0,
            path_length: 0.0,
            only_specular: false,
            last: None,
            sample: Sample::MISS,
            features: PhantomData,
        }
    }

    /// The ray leaves the scene and adds the radiance of the environment.
    #[inline]
    pub(crate) fn add_environment(&mut self) {
        let direction = self.ray_state.ray.direction;
        self.recorder.vertex(direction.to_array(), None, self.throughput);
        let radiance = self.throughput * self.scene.environment_radiance(direction);
        if !radiance.is_black() {
            let end = || End::infinite(direction);
            self.add_with_mis(radiance, end, |scene, l| scene.environment_pdf(&l.receiver, l.choice, direction));
        }
        for (sun, radiance) in self.scene.suns_along(direction) {
            let end = || End::infinite(direction);
            let radiance = self.throughput * radiance;
            self.add_with_mis(radiance, end, |scene, l| scene.sun_pdf(&l.receiver, l.choice, sun, direction));
        }
    }

    /// The ray hits a surface and adds its emission.
    #[inline]
    pub(crate) fn add_emission(&mut self, surface: &SurfacePoint) {
        let radiance = self.throughput * self.scene.emitted(surface, -self.ray_state.ray.direction);
        if !radiance.is_black() {
            let end = || End::surface(surface.point, surface.normal);
            let surface = *surface;
            self.add_with_mis(radiance, end, |scene, l| scene.light_pdf(&l.receiver, l.choice, &surface));
        }
    }

    /// Adds light that a scattered ray has hit. `light_pdf` [1/sr] is the density with which light sampling draws the
    /// same direction. Both techniques share the light by the power heuristic. Behind a cover the other technique is
    /// the connection, if it finds the chain to `end`.
    #[inline]
    fn add_with_mis(
        &mut self,
        radiance: Rgb,
        end: impl FnOnce() -> End,
        light_pdf: impl FnOnce(&Scene, &LastScatter) -> f32,
    ) {
        let mis_weight = match self.last {
            None => 1.0,
            Some(l) => {
                let light_pdf = light_pdf(self.scene, &l);
                match l.specular_prefix.filter(|p| F::SOLIDS && !p.is_direct()) {
                    None => direct::power_heuristic(l.pdf, light_pdf),
                    Some(p) => mnee::scattering_mis_weight::<F>(self.scene, &l.receiver, &p, end(), l.pdf, light_pdf),
                }
            }
        };
        let contribution = radiance * mis_weight;
        self.recorder.add_emitted(contribution);
        self.sample.radiance += contribution;
    }

    /// The segment to the next surface: multiplies the throughput by the transmittance of the medium. Returns the
    /// vertex if the medium scatters the path before the surface.
    #[inline]
    pub(crate) fn sample_medium(&mut self, vertex: u32, distance: f32) -> Option<MediumVertex<'a>> {
        if !F::MEDIA {
            if F::SOLIDS {
                self.throughput *= self.ray_state.transmittance::<F>(self.scene, distance);
            }
            return None;
        }
        let medium = self.ray_state.medium(self.scene)?;
        let event = if medium.scatters() {
            let [_, u_distance, u_channel, u_digits] = self.sampler.get_4d(dimensions::surface_kind(vertex));
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
                let at = MediumVertex::new(medium, self.ray_state, distance);
                self.recorder.medium_vertex(
                    at.point.to_array(),
                    self.ray_state.solid::<F>(self.scene),
                    self.throughput,
                );
                Some(at)
            }
        }
    }

    /// Samples if the surface is present. The path passes an open face.
    #[inline]
    pub(crate) fn sample_coverage(&mut self, vertex: u32, hit: &SurfaceHit<'_>) -> Presence {
        let tint = if F::MEDIA { hit.open_tint() } else { None };
        if let Some(tint) = tint {
            self.throughput *= tint;
            self.pass(hit);
            return Presence::Open;
        }
        if !(F::STOCHASTIC && self.scene.is_stochastic(&hit.surface)) {
            return Presence::Present { u_kind: 0.0 };
        }
        let u = self.sampler.get_1d(dimensions::surface_kind(vertex));
        presence(u, self.scene.coverage(&hit.surface, self.ray_state.ray.direction))
    }

    /// Samples which of the surfaces that coincide with an absent one is present, with a number in `[0, 1)` that is
    /// still unused. If none is, the path passes all of them.
    // Rare, so the point is passed by value.
    #[inline(never)]
    pub(crate) fn sample_coincident<'b>(
        &mut self,
        absent: SurfacePoint,
        mut u: f32,
        storage: &'b mut Option<Interface>,
    ) -> Option<(SurfaceHit<'b>, f32)> {
        let ray = self.ray_state.ray;
        let mut last = None;
        while let Some(point) = self.scene.next_coincident(&ray, absent, last) {
            last = Some(point);
            let u_kind = match self.scene.is_stochastic(&point) {
                false => 0.0,
                true => match presence(u, self.scene.coverage(&point, ray.direction)) {
                    Presence::Present { u_kind } => u_kind,
                    Presence::Absent { u: rest } => {
                        u = rest;
                        continue;
                    }
                    Presence::Open => continue,
                },
            };
            let hit = self.ray_state.hit_at::<F>(self.scene, point, storage);
            if let Some(tint) = if F::MEDIA { hit.open_tint() } else { None } {
                self.throughput *= tint;
                self.pass(&hit);
                return None;
            }
            return Some((hit, u_kind));
        }
        self.pass(&SurfaceHit::of_surface(absent));
        None
    }

    /// The path continues behind a surface in the same direction.
    #[inline]
    pub(crate) fn pass(&mut self, hit: &SurfaceHit<'_>) {
        // This is no vertex. So the last scattering stays the one that is combined with light sampling.
        self.path_length += hit.surface.distance;
        self.ray_state = self.ray_state.pass_through::<F>(hit);
    }

    /// Scattering at a vertex: auxiliary layers, next-event estimation and a new direction. False if the path ends.
    #[inline]
    fn scatter<V: Vertex>(&mut self, at: &V, vertex: u32) -> bool {
        // Auxiliary layers: the first surface behind smooth glass and mirrors. If the path ends there, the layers keep
        // the values of the glass.
        self.path_length += at.distance();
        let is_delta = at.is_delta();
        if self.is_first_surface() {
            self.set_layers(at.is_see_through(), || at.aov_features());
        }

        // Learned decisions at this vertex, if there are any.
        let learned = match (self.roulette, at.material()) {
            (Some(roulette), Some(material)) => roulette.at(at.receiver().point, material, &mut self.gain_scale),
            _ => None,
        };

        // Next-event estimation.
        let choice = self.scene.light_choice_at(self.light_vertices, V::IN_MEDIUM);
        if !is_delta {
            // The first vertex contributes most of the light of the pixel. Without training, roulette skips none of its
            // shadow rays.
            let radiance_before = if self.light_vertices > 0 { self.sample.radiance } else { Rgb::BLACK };
            self.light_vertices += 1;
            for index in 0..self.scene.num_light_samples(choice) {
                let u = self.sampler.numbers(dimensions::light(vertex, index));
                // With one sample for each light there is no choice of a light. The number decides the roulette
                // instead.
                let u_choice = if choice == LightChoice::One { u.get(2) } else { 0.0 };
                let u_roulette = || match choice {
                    LightChoice::Each => u.get(2),
                    LightChoice::One => self.sampler.numbers(dimensions::single_light_roulette(vertex)).get(0),
                };
                let roulette = match (learned, choice) {
                    _ if R::TRAINING => ShadowRoulette::Off,
                    (Some(vertex), _) => {
                        let throughput = self.throughput.max_channel();
                        ShadowRoulette::Learned { vertex, index, throughput, u: u_roulette() }
                    }
                    (None, LightChoice::One) => ShadowRoulette::Off,
                    (None, LightChoice::Each) => {
                        ShadowRoulette::from_gathered(self.throughput, radiance_before, u_roulette)
                    }
                };
                let u_point = u.first_two();
                let Some(light) = self.scene.sample_light(at.receiver(), choice, index, u_choice, u_point) else {
                    continue;
                };
                let direct = direct::estimate::<F, _>(self.scene, at, &light, index, roulette, &mut self.recorder);
                let direct = self.throughput * direct;
                self.recorder.add_direct(direct);
                self.sample.radiance += direct;
                if self.has_covers() {
                    let u_chain = || u.get(3);
                    let connected =
                        mnee::estimate::<F, _>(self.scene, at, &light, index, roulette, u_chain, &mut self.recorder);
                    let connected = self.throughput * connected;
                    self.recorder.add_connection(connected);
                    self.sample.radiance += connected;
                }
            }
        }

        // A new direction by sampling the BSDF or the phase function.
        let [u_x, u_y, u_lobe, u_roulette] = self.sampler.get_4d(dimensions::scatter(vertex));
        let Some(scattered) = at.sample([u_x, u_y, u_lobe]) else { return false };
        self.throughput *= scattered.weight;
        self.eta_scale *= scattered.eta * scattered.eta;

        // Russian roulette, by the learned gain or by the throughput.
        let max_survival = self.count_scattering(V::IN_MEDIUM);
        let survival = match learned {
            Some(vertex) => vertex.path_survival(self.throughput.max_channel()).min(max_survival),
            None => survival(self.throughput.max_channel() * self.eta_scale, max_survival),
        };
        if u_roulette >= survival {
            return false;
        }
        self.throughput *= 1.0 / survival;
        self.recorder.scattering(&scattered, self.throughput);

        self.ray_state = at.spawn_ray(scattered.wi);
        self.set_last(at.receiver(), choice, (scattered.pdf, scattered.lobe), at.surface());
        true
    }

    /// True if the auxiliary layers may still be set.
    #[inline]
    pub(crate) fn is_first_surface(&self) -> bool {
        !self.sample.hit || self.only_specular
    }

    /// Sets the auxiliary layers to albedo and normal of a vertex, unless it lies on smooth glass behind other glass.
    #[inline]
    pub(crate) fn set_layers(&mut self, is_see_through: bool, features: impl FnOnce() -> (Rgb, Vec3)) {
        if !self.sample.hit || !is_see_through {
            let (albedo, normal) = features();
            self.sample =
                Sample { hit: true, albedo, normal: normal.to_array(), depth: self.path_length, ..self.sample };
        }
        self.only_specular = is_see_through;
    }

    /// Sets the vertex at which the next scattered light is combined with light sampling. `at` is the surface of the
    /// vertex, and `self` has the ray that leaves it.
    #[inline]
    pub(crate) fn set_last(
        &mut self,
        receiver: &LightSampleContext,
        choice: LightChoice,
        (pdf, lobe): (f32, Lobe),
        at: Option<&SurfacePoint>,
    ) {
        if !lobe.contains(Lobe::DELTA) {
            let specular_prefix = self.has_covers().then(|| SpecularPrefix::new(self.ray_state));
            self.last = Some(LastScatter { receiver: *receiver, choice, pdf, specular_prefix });
        } else if self.has_covers() {
            let is_reflection = lobe.contains(Lobe::REFLECTION);
            self.last = self.last.take().and_then(|last| {
                let specular_prefix = last.specular_prefix?.extended(self.scene, at?, is_reflection)?;
                Some(LastScatter { specular_prefix: Some(specular_prefix), ..last })
            });
        } else {
            self.last = None;
        }
    }

    /// True if the scene has covers for connections and the kernel includes solids.
    #[inline]
    pub(crate) fn has_covers(&self) -> bool {
        F::SOLIDS && !self.scene.covers().is_empty()
    }

    /// Counts a scattering and returns the survival probability of a path without loss.
    #[inline]
    pub(crate) fn count_scattering(&mut self, in_medium: bool) -> f32 {
        self.bounces += u32::from(!in_medium);
        if in_medium || self.bounces < FORCED_RR_BOUNCES { 1.0 } else { MAX_SURVIVAL }
    }
}

/// The result of the sampling of a coverage.
pub(crate) enum Presence {
    /// The surface is present. `u_kind` is a number in `[0, 1)` that is still unused, for surfaces with two random kinds.
    Present { u_kind: f32 },
    /// The surface is absent for this sample. `u` is a number in `[0, 1)` that is still unused.
    Absent { u: f32 },
    /// The path has passed an open face.
    Open,
}

/// Samples a coverage by a number in `[0, 1)`.
#[inline]
fn presence(u: f32, coverage: f32) -> Presence {
    /// The largest number below 1.
    const BELOW_ONE: f32 = 1.0 - 0.5 * f32::EPSILON;
    if u < coverage {
        Presence::Present { u_kind: u / coverage }
    } else {
        Presence::Absent { u: ((u - coverage) / (1.0 - coverage)).min(BELOW_ONE) }
    }
}

/// The survival probability in Russian roulette (Arvo and Kirk 1990). `rr_throughput` is the throughput without the
/// factor eta^2. The last argument is the survival probability of a path without loss.
#[inline(always)]
pub(crate) fn survival<L: Lanes>(rr_throughput: L, max_survival: L) -> L {
    (rr_throughput * RR_SCALE).min(max_survival)
}
