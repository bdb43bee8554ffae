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
//! So a sample has the same bits at every width and in every batch: those of [`crate::path`].

mod rays;
mod scatter;

use crate::dimensions;
use crate::dispatch::{Wide, needs_media};
use crate::estimator::{CameraSample, Estimator, PixelSample, weighted};
use crate::path::{Path, Presence};
use crate::ray_state::SurfaceHit;
use crate::recorder::ConnectionTally;
use crate::vertex::SurfaceVertex;
use dunkelfeld_bsdf::Bsdf;
use dunkelfeld_film::Sample;
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, dispatch};
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{Scene, SurfacePoint};
use rays::{Hits, Rays, ShadowRays};
use smallvec::SmallVec;

/// Most paths that are followed together. Their state takes about half a megabyte.
const BATCH: usize = 1024;

/// Follows the paths of samples, a batch at a time. A thread uses one for all of its samples.
#[derive(Debug)]
pub struct Wavefront<'a> {
    estimator: Estimator<'a>,
    set: InstructionSet,
    paths: Vec<Path<'a, Wide, ()>>,
    /// Number of the sample of each path, the weight of its ray, and the distance from the camera to its origin.
    samples: Vec<(usize, f32, f32)>,
    /// Paths with a ray to the next surface.
    active: Vec<u32>,
    /// Paths after this wave.
    next: Vec<u32>,
    /// The rays of the active paths, and their hits.
    rays: Rays,
    hits: Hits,
    /// The surface point of each path, and the number that decides the kind of a stochastic surface.
    points: Vec<Option<(SurfacePoint, f32)>>,
    /// Paths that scatter at a surface, by material.
    order: Vec<u64>,
    /// For each light sample of a vertex.
    shadow: Vec<ShadowRays>,
    occluded: Vec<bool>,
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
            samples: Vec::new(),
            active: Vec::new(),
            next: Vec::new(),
            rays: Rays::default(),
            hits: Hits::default(),
            points: Vec::new(),
            order: Vec::new(),
            shadow: (0..lights).map(|_| ShadowRays::default()).collect(),
            occluded: Vec::new(),
        }
    }

    /// Number of samples that are computed together.
    pub const BATCH: usize = BATCH;

    /// Computes samples: those of [`Estimator::sample_counting`]. They replace the content of `found`, in order. If a path
    /// is abandoned, the rest is left out.
    pub fn samples(&mut self, at: &[PixelSample], tally: &mut ConnectionTally, found: &mut Vec<Sample>) {
        found.clear();
        found.resize(at.len(), Sample::MISS);
        for (first, at) in (0..).step_by(BATCH).zip(at.chunks(BATCH)) {
            self.paths.clear();
            self.samples.clear();
            let estimator = self.estimator;
            let samplers: Vec<Sampler> = at.iter().map(|at| estimator.sampler(*at)).collect();
            let places = places_in_pixels(self.set, &samplers);
            for (i, at) in at.iter().enumerate() {
                let (number, sampler) = (first + i, samplers[i]);
                let CameraSample { ray, weight, start } = estimator.camera_sample(*at, &sampler, places[i]);
                if needs_media(self.estimator.scene, &ray) {
                    found[number] = self.estimator.sample_counting(*at, tally);
                    if tally.is_abandoned {
                        return;
                    }
                } else {
                    self.paths.push(Path::new(self.estimator.scene, self.estimator.roulette, ray, sampler, ()));
                    self.samples.push((number, weight, start));
                }
            }
            self.active.clear();
            self.active.extend(0..self.paths.len() as u32);
            for vertex in 0.. {
                if self.active.is_empty() {
                    break;
                }
                self.wave(vertex, tally);
            }
            for (path, &(number, weight, start)) in self.paths.iter().zip(&self.samples) {
                found[number] = weighted(&path.sample, weight, start);
            }
        }
    }

    /// All paths advance by one vertex.
    fn wave(&mut self, vertex: u32, tally: &mut ConnectionTally) {
        self.next.clear();
        self.reach_surfaces(vertex);
        self.order.sort_unstable();
        let set = self.set;
        dispatch!(set, F, token => self.scatter_all::<F>(token, vertex, tally));
        self.trace_shadow_rays();
        std::mem::swap(&mut self.active, &mut self.next);
    }

    /// The next surface along each ray: its coverage and its emission. Without a surface, the radiance of the environment.
    fn reach_surfaces(&mut self, vertex: u32) {
        let Self { paths, points, active, next, rays, hits, order, estimator, set, .. } = self;
        let scene = estimator.scene;
        rays.clear();
        let moves = scene.shutter().is_some();
        active.iter().for_each(|&number| rays.push(&paths[number as usize].ray_state.ray, moves));
        scene.bvh().closest_hits(*set, &rays.batch(), &mut hits.batch(active.len()));
        order.clear();
        points.resize(points.len().max(paths.len()), None);
        for (i, &number) in active.iter().enumerate() {
            let path = &mut paths[number as usize];
            let Some(hit) = hits.get(i) else {
                path.add_environment();
                continue;
            };
            let point = scene.surface_point(&hit, path.ray_state.ray.time);
            path.sample_medium(vertex, point.distance);
            let hit = SurfaceHit::of_surface(point);
            let (point, u_kind) = match path.sample_coverage(vertex, &hit) {
                Presence::Present { u_kind } => (point, u_kind),
                Presence::Open => continue,
                Presence::Absent { u } => match path.sample_coincident(point, u, &mut None) {
                    Some((found, u_kind)) => (found.surface, u_kind),
                    None => {
                        next.push(number);
                        continue;
                    }
                },
            };
            path.add_emission(&point);
            points[number as usize] = Some((point, u_kind));
            order.push(u64::from(point.material()) << 32 | u64::from(number));
        }
    }

    /// Light samples and new directions at all surfaces.
    #[inline(always)]
    fn scatter_all<F: Lanes>(&mut self, token: F::Token, vertex: u32, tally: &mut ConnectionTally) {
        let order = std::mem::take(&mut self.order);
        let scene = self.estimator.scene;
        for of_material in order.chunk_by(|a, b| a >> 32 == b >> 32) {
            for group in of_material.chunks(F::WIDTH) {
                let mut paths = [group[0] as u32; MAX_WIDTH];
                for (lane, key) in group.iter().enumerate() {
                    paths[lane] = *key as u32;
                }
                let (mut storage, mut vertices) = ([const { None }; MAX_WIDTH], SmallVec::new());
                self.vertices(scene, &paths[..group.len()], &mut storage, &mut vertices);
                self.scatter_group::<F>(token, (vertex, &vertices, paths), tally);
            }
        }
        self.order = order;
    }

    /// The surfaces of some paths.
    #[inline(never)]
    fn vertices<'s>(
        &self,
        scene: &'s Scene,
        paths: &[u32],
        storage: &'s mut [Option<Bsdf>; MAX_WIDTH],
        vertices: &mut SmallVec<[SurfaceVertex<'s, Wide>; MAX_WIDTH]>,
    ) {
        for (&number, storage) in paths.iter().zip(storage) {
            if let Some((point, u_kind)) = self.points[number as usize] {
                let (state, hit) = (self.paths[number as usize].ray_state, SurfaceHit::of_surface(point));
                vertices.push(SurfaceVertex::new(scene, state, hit, u_kind, storage));
            }
        }
    }

    /// Traces the shadow rays, light by light, and adds the light of those that are not occluded.
    fn trace_shadow_rays(&mut self) {
        let bvh = self.estimator.scene.bvh();
        for queue in &mut self.shadow {
            self.occluded.clear();
            self.occluded.resize(queue.paths.len(), false);
            bvh.occluded_batch(self.set, &queue.rays.batch(), &mut self.occluded);
            for (i, path) in queue.paths.iter().enumerate() {
                if !self.occluded[i] {
                    self.paths[*path as usize].sample.radiance += queue.light(i);
                }
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
