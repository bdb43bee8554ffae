//! The state of a path, and the steps that are computed path by path: emission, media, coverage.

use crate::dimensions;
use crate::direct::{self, LastScatter};
use crate::mnee::{self, End, SpecularPrefix};
use crate::ray_state::{RayState, SurfaceHit};
use dunkelfeld_bsdf::Lobe;
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_lanes::Lanes;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{Interface, LightChoice, LightSampleContext, MediumEvent, Scene, SurfacePoint};

/// From this bounce at a surface on the survival probability is below one, also for a path without any loss. So light
/// between perfect mirrors ends. A path in a medium leaves it, and ends by its loss only: a limit would end a share of
/// the long paths in a dense white medium and increase the weight of the others, with infinite variance.
const FORCED_RR_BOUNCES: u32 = 64;
/// Survival probability of such a path. The variance of a closed cavity is finite up to an albedo of the square root of
/// this value, 0.9899. A value nearer to one would give finite variance for brighter cavities, but light trapped in
/// clear sheets would be traced for longer.
const MAX_SURVIVAL: f32 = 0.98;

/// Scale of Russian roulette: a path whose throughput is a third or more always survives. Termination on dark surfaces
/// produces rare bright samples. On the inspection scenes this factor reduces the variance of the image by a third and
/// costs a tenth more time (`validation/README.md`).
const RR_SCALE: f32 = 3.0;

/// The state of a path.
#[derive(Debug)]
pub(crate) struct Path {
    /// Scale of the learned survival probabilities; `None` before the first surface with statistics.
    pub(crate) gain_scale: Option<f32>,
    pub(crate) sampler: Sampler,
    pub(crate) ray_state: RayState,
    /// Path throughput: the weight of all further contributions.
    pub(crate) throughput: Rgb,
    /// Change of radiance by refraction (the factor eta^2). Russian roulette must not treat it as loss.
    pub(crate) eta_scale: f32,
    /// Number of scatterings at surfaces.
    bounces: u32,
    /// Number of vertices with light samples so far.
    pub(crate) light_vertices: u32,
    /// Distance from the camera along the path \[m\].
    pub(crate) path_length: f32,
    /// True while the path has hit only smooth glass and mirrors. The auxiliary layers describe the surface behind
    /// them.
    only_specular: bool,
    last: Option<LastScatter>,
    pub(crate) sample: Sample,
}

impl Path {
    /// The path of a camera ray.
    #[inline]
    pub(crate) fn new(scene: &Scene, ray: Ray, sampler: Sampler) -> Self {
        Self {
            gain_scale: None,
            sampler,
            ray_state: RayState::from_camera(scene, ray),
            throughput: Rgb::WHITE,
            eta_scale: 1.0,
            bounces: 0,
            light_vertices: 0,
            path_length: 0.0,
            only_specular: false,
            last: None,
            sample: Sample::MISS,
        }
    }

    /// The ray leaves the scene and adds the radiance of the environment. Returns the contribution.
    #[inline]
    pub(crate) fn add_environment(&mut self, scene: &Scene) -> Rgb {
        let direction = self.ray_state.ray.direction;
        let end = || End::infinite(direction);
        let mut sum = Rgb::BLACK;
        let radiance = self.throughput * scene.environment_radiance(direction);
        if !radiance.is_black() {
            let pdf = |l: &LastScatter| scene.environment_pdf(&l.receiver, l.choice, direction);
            sum += self.add_with_mis(scene, radiance, end, pdf);
        }
        for (sun, radiance) in scene.suns_along(direction) {
            let pdf = |l: &LastScatter| scene.sun_pdf(&l.receiver, l.choice, sun, direction);
            sum += self.add_with_mis(scene, self.throughput * radiance, end, pdf);
        }
        sum
    }

    /// The ray hits a surface and adds its emission. Returns the contribution.
    #[inline]
    pub(crate) fn add_emission(&mut self, scene: &Scene, surface: &SurfacePoint) -> Rgb {
        let radiance = self.throughput * scene.emitted(surface, -self.ray_state.ray.direction);
        if radiance.is_black() {
            return Rgb::BLACK;
        }
        let end = || End::surface(surface.point, surface.normal);
        self.add_with_mis(scene, radiance, end, |l| scene.light_pdf(&l.receiver, l.choice, surface))
    }

    /// Adds light that a scattered ray has hit, and returns the contribution. `light_pdf` [1/sr] is the density with which
    /// light sampling draws the same direction. Both techniques share the light by the power heuristic. Behind a cover the
    /// other technique is the connection, if it finds the chain to `end`.
    #[inline]
    fn add_with_mis(
        &mut self,
        scene: &Scene,
        radiance: Rgb,
        end: impl FnOnce() -> End,
        light_pdf: impl FnOnce(&LastScatter) -> f32,
    ) -> Rgb {
        let mis_weight = match &self.last {
            None => 1.0,
            Some(l) => {
                let light_pdf = light_pdf(l);
                match l.specular_prefix.filter(|p| !p.is_direct()) {
                    None => direct::power_heuristic(l.pdf, light_pdf),
                    Some(p) => mnee::scattering_mis_weight(scene, &l.receiver, &p, end(), l.pdf, light_pdf),
                }
            }
        };
        let contribution = radiance * mis_weight;
        self.sample.radiance += contribution;
        contribution
    }

    /// The segment to the next surface: multiplies the throughput by the transmittance of the medium. Returns the
    /// distance \[m\] if the medium scatters the path before the surface.
    #[inline]
    pub(crate) fn sample_medium(&mut self, scene: &Scene, vertex: u32, distance: f32) -> Option<f32> {
        let Some(medium) = self.ray_state.medium(scene).filter(|m| m.scatters()) else {
            self.throughput *= self.ray_state.transmittance(scene, distance);
            return None;
        };
        let [_, u_distance, u_channel, u_digits] = self.sampler.get_4d(dimensions::surface_kind(vertex));
        match medium.sample(self.throughput, distance, [u_distance, u_channel, u_digits]) {
            MediumEvent::Pass { weight } => {
                self.throughput *= weight;
                None
            }
            MediumEvent::Scatter { distance, weight } => {
                self.throughput *= weight;
                Some(distance)
            }
        }
    }

    /// Samples if the surface is present. The path passes an open face.
    #[inline]
    pub(crate) fn sample_coverage(&mut self, scene: &Scene, vertex: u32, hit: &SurfaceHit<'_>) -> Presence {
        if let Some(tint) = hit.open_tint() {
            self.throughput *= tint;
            self.pass(hit);
            return Presence::Open;
        }
        if !scene.is_stochastic(&hit.surface) {
            return Presence::Present { u_kind: 0.0 };
        }
        let u = self.sampler.get_1d(dimensions::surface_kind(vertex));
        presence(u, scene.coverage(&hit.surface, self.ray_state.ray.direction))
    }

    /// Samples which of the surfaces that coincide with an absent one is present, with a number in `[0, 1)` that is
    /// still unused. If none is, the path passes all of them.
    #[inline(never)]
    pub(crate) fn sample_coincident<'b>(
        &mut self,
        scene: &Scene,
        absent: SurfacePoint,
        mut u: f32,
        storage: &'b mut Option<Interface>,
    ) -> Option<(SurfaceHit<'b>, f32)> {
        let ray = self.ray_state.ray;
        let mut last = None;
        while let Some(point) = scene.next_coincident(&ray, absent, last) {
            last = Some(point);
            let u_kind = match scene.is_stochastic(&point) {
                false => 0.0,
                true => match presence(u, scene.coverage(&point, ray.direction)) {
                    Presence::Present { u_kind } => u_kind,
                    Presence::Absent { u: rest } => {
                        u = rest;
                        continue;
                    }
                    Presence::Open => continue,
                },
            };
            let hit = self.ray_state.hit_at(scene, point, storage);
            if let Some(tint) = hit.open_tint() {
                self.throughput *= tint;
                self.pass(&hit);
                return None;
            }
            return Some((hit, u_kind));
        }
        self.pass(&SurfaceHit { surface: absent, interface: None });
        None
    }

    /// The path continues behind a surface in the same direction.
    #[inline]
    fn pass(&mut self, hit: &SurfaceHit<'_>) {
        // This is no vertex. So the last scattering stays the one that is combined with light sampling.
        self.path_length += hit.surface.distance;
        self.ray_state = self.ray_state.pass_through(hit);
    }

    /// True if the auxiliary layers may still be set.
    #[inline]
    pub(crate) fn is_first_surface(&self) -> bool {
        !self.sample.hit || self.only_specular
    }

    /// Sets the auxiliary layers to albedo and normal of a vertex, unless it lies on smooth glass behind other glass.
    #[inline]
    pub(crate) fn set_layers(&mut self, is_see_through: bool, albedo: Rgb, normal: Vec3) {
        if !self.sample.hit || !is_see_through {
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
        scene: &Scene,
        (receiver, choice): (&LightSampleContext, LightChoice),
        (pdf, lobe): (f32, Lobe),
        at: Option<&SurfacePoint>,
    ) {
        let has_covers = !scene.covers().is_empty();
        if !lobe.contains(Lobe::DELTA) {
            let specular_prefix = has_covers.then(|| SpecularPrefix::new(self.ray_state));
            self.last = Some(LastScatter { receiver: *receiver, choice, pdf, specular_prefix });
        } else if has_covers {
            let is_reflection = lobe.contains(Lobe::REFLECTION);
            self.last = self.last.take().and_then(|last| {
                let specular_prefix = last.specular_prefix?.extended(scene, at?, is_reflection)?;
                Some(LastScatter { specular_prefix: Some(specular_prefix), ..last })
            });
        } else {
            self.last = None;
        }
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
