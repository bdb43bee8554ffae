//! The paths of many samples at once, vertex by vertex.
//!
//! ```text
//! camera -> [ closest hits -> media, coverage, emission -> sort -> light samples and scattering -> shadow rays ]
//! ```
//!
//! The stages in brackets are repeated until no path is left. Each is a loop over all paths that have reached it. Light
//! samples and scattering are computed in lanes, of paths on surfaces of the same material. Stages that scenes rarely need
//! are computed path by path.
//!
//! A path reads and writes only its own state, and its contributions are added in the order of its vertices and lights.
//! So a sample has the same bits at every width and in every batch. A batch of one sample in one lane is the reference.

mod rays;
mod scatter;

use crate::dimensions;
use crate::estimator::{CameraSample, Estimator, PixelSample};
use crate::observer::{ConnectionTally, Event, Observer};
use crate::path::{Path, Presence};
use crate::ray_state::SurfaceHit;
use crate::vertex::Vertex;
use dunkelfeld_bsdf::Bsdf;
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::Ray;
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, dispatch};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{Interface, LightChoice, SurfacePoint};
use rays::{Hits, Rays, ShadowRays};
use smallvec::SmallVec;
use std::time::Instant;

/// Most paths that are followed together. Their state takes about half a megabyte.
const BATCH: usize = 1024;

/// A path in a medium can be abandoned after each so many vertices: some milliseconds for one path.
const CHECK_EVERY: u32 = 4096;

/// Follows the paths of samples, a batch at a time. A thread uses one for all of its samples.
#[derive(Debug)]
pub struct Wavefront<'a> {
    estimator: Estimator<'a>,
    set: InstructionSet,
    paths: Vec<Path>,
    /// Paths with a ray to the next surface.
    active: Vec<u32>,
    /// Paths after this wave.
    next: Vec<u32>,
    /// The rays of the active paths, and their hits.
    rays: Rays,
    hits: Hits,
    /// The point that each path has reached.
    arrivals: Vec<Option<Arrival>>,
    /// Interfaces of solids at these points, in scenes with media.
    interfaces: Vec<Interface>,
    /// Paths that scatter: [`Arrival::key`] and number.
    order: Vec<u64>,
    /// For each light sample of a vertex.
    shadow: Vec<ShadowRays>,
    occluded: Vec<bool>,
}

/// A point at which a path scatters.
#[derive(Clone, Copy, Debug)]
enum Arrival {
    /// A surface, the number that decides its kind if it is stochastic, and the number of the interface.
    Surface { point: SurfacePoint, u_kind: f32, interface: Option<u32> },
    /// The medium of a material, at a distance \[m\] along the ray.
    Medium { material: u32, distance: f32, choice: LightChoice },
}

/// In keys of points in a medium.
const MEDIUM: u32 = 1 << 31;

impl Arrival {
    /// Points of the same key scatter together: those on one material, or in one medium with the same choice of lights.
    fn key(&self) -> u32 {
        match self {
            Self::Surface { point, .. } => 2 * point.material(),
            Self::Medium { material, choice, .. } => MEDIUM | (2 * material) | u32::from(*choice == LightChoice::One),
        }
    }
}

/// Receivers of events while paths are followed.
pub(crate) struct Watch<'w> {
    pub(crate) tally: &'w mut ConnectionTally,
    pub(crate) observer: Option<&'w mut dyn Observer>,
}

impl Watch<'_> {
    #[inline]
    fn event(&mut self, path: u32, event: impl FnOnce() -> Event) {
        if let Some(observer) = &mut self.observer {
            observer.event(path as usize, event());
        }
    }

    /// See [`Observer::needs_outcomes`].
    fn needs_outcomes(&self) -> bool {
        self.observer.as_ref().is_some_and(|o| o.needs_outcomes())
    }
}

impl<'a> Wavefront<'a> {
    /// For the samples of an estimator, with the lanes of an instruction set.
    pub fn new(estimator: &Estimator<'a>, set: InstructionSet) -> Self {
        let choice = estimator.scene.light_choice_at(0, false);
        let lights = estimator.scene.num_light_samples(choice) as usize;
        Self {
            estimator: *estimator,
            set,
            paths: Vec::new(),
            active: Vec::new(),
            next: Vec::new(),
            rays: Rays::default(),
            hits: Hits::default(),
            arrivals: Vec::new(),
            interfaces: Vec::new(),
            order: Vec::new(),
            shadow: (0..lights).map(|_| ShadowRays::default()).collect(),
            occluded: Vec::new(),
        }
    }

    /// Number of samples that are computed together.
    pub const BATCH: usize = BATCH;

    /// Computes samples. They replace the content of `found`, in order. The tally counts their connections through covers. If
    /// a path is abandoned, the rest is left out.
    ///
    /// A sample is a pure function of (scene, camera, seed, frame, pixel, sample index). Its radiance is an unbiased estimate
    /// of the mean over the area of the pixel. It is finite and not negative unless values of the scene exceed the range of
    /// floating-point numbers. Such an invalid sample is returned unchanged, and the film counts it.
    pub fn samples(&mut self, at: &[PixelSample], tally: &mut ConnectionTally, found: &mut Vec<Sample>) {
        found.clear();
        for at in at.chunks(BATCH) {
            self.observed(at, Watch { tally, observer: None }, found);
            if tally.is_abandoned {
                return;
            }
        }
    }

    /// Appends the samples of a batch, with the events of their paths. Returns the weight of the first camera ray.
    pub(crate) fn observed(&mut self, at: &[PixelSample], watch: Watch<'_>, found: &mut Vec<Sample>) -> f32 {
        let estimator = self.estimator;
        let samplers: Vec<Sampler> = at.iter().map(|at| estimator.sampler(*at)).collect();
        let places = places_in_pixels(self.set, &samplers);
        let cameras: Vec<CameraSample> = (at.iter().zip(&samplers).zip(places))
            .map(|((at, sampler), place)| estimator.camera_sample(*at, sampler, place))
            .collect();
        self.follow(cameras.iter().map(|camera| camera.ray).zip(samplers), watch);
        let samples = self.paths.iter().zip(&cameras);
        found.extend(samples.map(|(path, camera)| camera.weighted(&path.sample)));
        cameras.first().map_or(1.0, |camera| camera.weight)
    }

    /// Follows the paths of rays to their ends.
    pub(crate) fn follow(&mut self, rays: impl Iterator<Item = (Ray, Sampler)>, mut watch: Watch<'_>) {
        let scene = self.estimator.scene;
        self.paths.clear();
        self.paths.extend(rays.map(|(ray, sampler)| Path::new(scene, ray, sampler)));
        self.active.clear();
        self.active.extend(0..self.paths.len() as u32);
        for vertex in 0.. {
            self.wave(vertex, &mut watch);
            if self.active.is_empty() {
                return;
            }
            if vertex % CHECK_EVERY == CHECK_EVERY - 1 {
                let is_late = watch.tally.abandon_at.is_some_and(|at| Instant::now() > at);
                // Nothing is learned from the rest of a long path.
                if is_late || watch.needs_outcomes() {
                    watch.tally.is_abandoned = is_late;
                    return;
                }
            }
        }
    }

    /// All paths advance by one vertex.
    fn wave(&mut self, vertex: u32, watch: &mut Watch<'_>) {
        self.next.clear();
        self.arrive(vertex, watch);
        self.order.sort_unstable();
        let set = self.set;
        dispatch!(set, F, token => self.scatter_all::<F>(token, vertex, watch));
        self.trace_shadow_rays(watch);
        std::mem::swap(&mut self.active, &mut self.next);
    }

    /// The next surface along each ray: the medium before it, its coverage and its emission. Without a surface, the radiance
    /// of the environment.
    fn arrive(&mut self, vertex: u32, watch: &mut Watch<'_>) {
        let Self { paths, arrivals, interfaces, active, next, rays, hits, order, estimator, set, .. } = self;
        let scene = estimator.scene;
        rays.clear();
        let moves = scene.shutter().is_some();
        active.iter().for_each(|&number| rays.push(&paths[number as usize].ray_state.ray, moves));
        scene.bvh().closest_hits(*set, &rays.batch(), &mut hits.batch(active.len()));
        order.clear();
        interfaces.clear();
        arrivals.resize(arrivals.len().max(paths.len()), None);
        for (i, &number) in active.iter().enumerate() {
            let path = &mut paths[number as usize];
            let mut arrive = |arrival: Arrival| {
                arrivals[number as usize] = Some(arrival);
                order.push(u64::from(arrival.key()) << 32 | u64::from(number));
            };
            let throughput = path.throughput;
            let Some(hit) = hits.get(i) else {
                let position = path.ray_state.ray.direction;
                watch.event(number, || Event::Vertex { position, material: None, in_medium: false, throughput });
                let light = path.add_environment(scene);
                watch.event(number, || Event::Emitted(light));
                continue;
            };
            let (mut interface, mut behind) = (None, None);
            let point = scene.surface_point(&hit, path.ray_state.ray.time);
            let hit = path.ray_state.hit_at(scene, point, &mut interface);
            if let Some(distance) = path.sample_medium(scene, vertex, hit.surface.distance) {
                let Some(material) = path.ray_state.solid(scene) else { continue };
                let (position, throughput) = (path.ray_state.ray.at(distance), path.throughput);
                let material_of_event = Some(material);
                watch.event(number, || Event::Vertex {
                    position,
                    material: material_of_event,
                    in_medium: true,
                    throughput,
                });
                let choice = scene.light_choice_at(path.light_vertices, true);
                arrive(Arrival::Medium { material, distance, choice });
                continue;
            }
            let (hit, u_kind) = match path.sample_coverage(scene, vertex, &hit) {
                Presence::Present { u_kind } => (hit, u_kind),
                Presence::Open => {
                    next.push(number);
                    continue;
                }
                Presence::Absent { u } => match path.sample_coincident(scene, hit.surface, u, &mut behind) {
                    Some(found) => found,
                    None => {
                        next.push(number);
                        continue;
                    }
                },
            };
            let (point, throughput) = (hit.surface, path.throughput);
            watch.event(number, || Event::Vertex {
                position: point.point,
                material: Some(point.material()),
                in_medium: false,
                throughput,
            });
            let light = path.add_emission(scene, &point);
            watch.event(number, || Event::Emitted(light));
            let interface = hit.interface.map(|interface| {
                interfaces.push(*interface);
                interfaces.len() as u32 - 1
            });
            arrive(Arrival::Surface { point, u_kind, interface });
        }
    }

    /// Light samples and new directions at all points.
    #[inline(always)]
    fn scatter_all<F: Lanes>(&mut self, token: F::Token, vertex: u32, watch: &mut Watch<'_>) {
        let (order, interfaces) = (std::mem::take(&mut self.order), std::mem::take(&mut self.interfaces));
        for of_key in order.chunk_by(|a, b| a >> 32 == b >> 32) {
            for group in of_key.chunks(F::WIDTH) {
                let mut paths = [group[0] as u32; MAX_WIDTH];
                for (lane, key) in group.iter().enumerate() {
                    paths[lane] = *key as u32;
                }
                let mut storage = [const { None }; MAX_WIDTH];
                let vertices = self.vertices(&paths[..group.len()], &interfaces, &mut storage);
                if vertices.len() == group.len() {
                    self.scatter_group::<F>(token, (vertex, &vertices, paths), watch);
                }
            }
        }
        (self.order, self.interfaces) = (order, interfaces);
    }

    /// The vertices of some paths.
    #[inline(never)]
    fn vertices<'s>(
        &self,
        paths: &[u32],
        interfaces: &'s [Interface],
        storage: &'s mut [Option<Bsdf>; MAX_WIDTH],
    ) -> SmallVec<[Vertex<'s>; MAX_WIDTH]>
    where
        'a: 's,
    {
        let scene = self.estimator.scene;
        let vertex = |(&number, storage): (&u32, &'s mut Option<Bsdf>)| {
            let state = self.paths[number as usize].ray_state;
            match self.arrivals[number as usize]? {
                Arrival::Surface { point, u_kind, interface } => {
                    let interface = interface.and_then(|i| interfaces.get(i as usize));
                    let hit = SurfaceHit { surface: point, interface };
                    Some(Vertex::on_surface(scene, state, hit, u_kind, storage))
                }
                Arrival::Medium { distance, .. } => Vertex::in_medium(scene, state, distance, storage),
            }
        };
        paths.iter().zip(storage).filter_map(vertex).collect()
    }

    /// Traces the shadow rays, light by light, and adds the light of those that are not occluded, and of connections.
    fn trace_shadow_rays(&mut self, watch: &mut Watch<'_>) {
        let bvh = self.estimator.scene.bvh();
        for (index, queue) in (0..).zip(&mut self.shadow) {
            self.occluded.clear();
            self.occluded.resize(queue.paths.len(), false);
            bvh.occluded_batch(self.set, &queue.rays.batch(), &mut self.occluded);
            for (i, &path) in queue.paths.iter().enumerate() {
                let light = if self.occluded[i] { Rgb::BLACK } else { queue.light(i) };
                self.paths[path as usize].sample.radiance += light;
                watch.event(path, || Event::ShadowRay { index, light });
            }
            for &(path, light) in &queue.connected {
                self.paths[path as usize].sample.radiance += light;
            }
            queue.clear();
        }
    }
}

/// The place of each sample in its pixel.
fn places_in_pixels(set: InstructionSet, samplers: &[Sampler]) -> Vec<[f32; 2]> {
    let mut places = Vec::with_capacity(samplers.len());
    dispatch!(set, F, token => {
        for group in samplers.chunks(F::WIDTH) {
            let mut lanes = [group[0]; MAX_WIDTH];
            lanes[..group.len()].copy_from_slice(group);
            let [x, y] = Sampler::<F>::from_lanes(token, &lanes).numbers(dimensions::CAMERA).first_two();
            let (x, y) = (x.to_array(), y.to_array());
            places.extend((0..group.len()).map(|lane| [x[lane], y[lane]]));
        }
    });
    places
}
