//! The paths of many samples at once, vertex by vertex.
//!
//! ```text
//! camera -> [ closest hits -> media, coverage, emission -> sort -> light samples and scattering
//!                                                                 -> connections through covers -> shadow rays ]
//! ```
//!
//! The stages in brackets are repeated until no path is left. Each is a loop over all paths that have reached it. Light
//! samples and scattering are computed in lanes, of paths on one material or in one medium. Stages that scenes rarely need
//! are computed path by path.
//!
//! Behind its first light samples a path may be split (`learned_roulette`). The light of all its parts is that of the sample.
//!
//! A path reads and writes only its own state, and its contributions are added in the order of its vertices and lights.
//! So a sample has the same bits at every width and in every batch. A batch of one sample in one lane is the reference.

mod attempts;
mod connect;
mod escape;
mod group;
mod light_groups;
mod media;
pub(crate) mod rays;
mod scatter;

use crate::dimensions;
use crate::estimator::{Estimator, PixelSample};
use crate::mnee::{Segments, SpecularPrefix};
use crate::observer::{ConnectionTally, Event, Observer, TraceConnection};
use crate::path::{PathState, PathStates};
use crate::ray_state::{EnclosingSolids, RayState};
use attempts::Attempts;
use dunkelfeld_bvh::Hit;
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::Ray;
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, dispatch};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{CameraRays, Interface, LightChoice, LightGroups, Moment, SurfacePoint};
use light_groups::GroupLight;
use rays::{Hits, Rays, ShadowRays};
use std::time::Instant;

/// Most paths that are followed together. Their state takes about a megabyte.
const BATCH: usize = 4096;

/// Paths can be abandoned after each so many vertices of all of them: some milliseconds.
const CHECK_EVERY: usize = 4096;

/// Most vertices of a training path. Nothing is learned from the rest of a longer one.
const MAX_TRAINING_VERTICES: u32 = 4096;

/// Fewer rays are followed lane by lane, so that long paths do not carry free lanes.
const LEAST_RAYS: usize = 3;

/// Follows the paths of samples, a batch at a time. A thread uses one for all of its samples.
#[derive(Debug)]
pub struct Wavefront<'a> {
    estimator: Estimator<'a>,
    set: InstructionSet,
    paths: Vec<PathState>,
    group_light: GroupLight<'a>,
    /// For each path behind those of the samples, the sample that it belongs to. Such a path is the rest behind the first
    /// light of a sample, or one of several.
    owners: Vec<u32>,
    /// For each path the factor on its radiance, the distance from the camera to the origin of its ray \[m\], and the place of
    /// its sample.
    camera: Vec<(f32, f32, [f32; 2])>,
    /// The samples of the paths, with their auxiliary layers.
    samples: Vec<Sample>,
    layers: Vec<Layers>,
    /// In scenes with solids.
    among_solids: Vec<AmongSolids>,
    /// The rays to the next surfaces, and their hits.
    rays: Rays,
    hits: Hits,
    /// The rays after this wave.
    next: Rays,
    /// The rays that leave the scene.
    escaped: Vec<u32>,
    /// The rays whose points are found path by path, and the distances at which media scatter them, else infinity.
    arriving: Vec<(u32, f32)>,
    /// These points: in media, on surfaces that may be absent, and between solids that touch.
    arrivals: Vec<Arrival>,
    /// Paths that scatter: the key of their points, and the number of the ray or the arrival.
    order: Vec<u64>,
    /// For each light sample of a vertex: straight shadow rays, and those behind covers.
    shadow: Vec<[ShadowRays; 2]>,
    occluded: Vec<bool>,
    /// Light of shadow rays that an observer has seen, not added yet: index and kind of the queue, path, light.
    observed_light: Vec<([u32; 2], u32, Rgb)>,
    /// Connections through covers that are still to be searched, and the next segments of some.
    attempts: Attempts,
    segments: Segments,
    lane_use: LaneUse,
    /// Do paths end at their first light samples?
    pub(crate) only_first_light: bool,
}

/// The state of the auxiliary layers of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layers {
    /// No surface yet.
    Unset,
    /// Of smooth glass or a mirror. They will describe the first other surface behind it.
    SeeThrough,
    /// Final.
    Set,
}

/// The state of a path in a scene with solids.
#[derive(Clone, Copy, Debug)]
struct AmongSolids {
    /// The solids around the origin of its ray.
    enclosing: EnclosingSolids,
    /// The interfaces of covers that it has passed since the last scattering, if connections could sample its light.
    prefix: Option<SpecularPrefix>,
}

/// A point in a medium or on a surface at which a path scatters.
#[derive(Clone, Copy, Debug)]
struct Arrival {
    ray: u32,
    point: SurfacePoint,
    /// The number that decides the kind of a stochastic surface.
    u_kind: f32,
    interface: Option<Interface>,
}

/// In keys of points in a medium, and of those that are found path by path. Points of the same key scatter together: those
/// on one material, or in one medium with the same choice of lights.
const MEDIUM: u32 = 1 << 31;
const ARRIVED: u32 = 1 << 30;

/// The stages whose use of lanes is counted.
const STAGES: [&str; 3] = ["points", "light samples", "connections"];
const POINTS: usize = 0;
const LIGHT_SAMPLES: usize = 1;
const CONNECTIONS: usize = 2;

/// Use of the lanes of the stages: lanes with work, and lanes in all. Points are those at which paths scatter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LaneUse([[u64; 2]; STAGES.len()]);

impl LaneUse {
    /// Counts a group of lanes of a stage.
    #[inline(always)]
    fn count<F: Lanes>(&mut self, stage: usize, used: usize) {
        self.0[stage][0] += used as u64;
        self.0[stage][1] += F::WIDTH as u64;
    }

    /// Adds another use.
    pub fn add(&mut self, other: &Self) {
        self.0.as_flattened_mut().iter_mut().zip(other.0.as_flattened()).for_each(|(own, other)| *own += other);
    }

    /// The share of lanes with work of each stage that has had some, with its name.
    pub fn shares(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let stages = STAGES.into_iter().zip(self.0).filter(|(_, [_, all])| *all > 0);
        stages.map(|(name, [used, all])| (name, used as f64 / all as f64))
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
        let lights = estimator.scene.num_light_samples(choice);
        let rays = || Rays::new(estimator.scene);
        let queue = || ShadowRays { rays: rays(), ..ShadowRays::default() };
        Self {
            estimator: *estimator,
            set,
            paths: Vec::new(),
            group_light: GroupLight::default(),
            owners: Vec::new(),
            camera: Vec::new(),
            samples: Vec::new(),
            layers: Vec::new(),
            among_solids: Vec::new(),
            rays: rays(),
            hits: Hits::default(),
            next: rays(),
            escaped: Vec::new(),
            arriving: Vec::new(),
            arrivals: Vec::new(),
            order: Vec::new(),
            shadow: (0..lights).map(|_| [queue(), queue()]).collect(),
            occluded: Vec::new(),
            observed_light: Vec::new(),
            attempts: Attempts::default(),
            segments: Segments::new(estimator.scene),
            lane_use: LaneUse::default(),
            only_first_light: false,
        }
    }

    /// Also finds the light of groups of lights.
    pub fn with_light_groups(self, groups: Option<&'a LightGroups>) -> Self {
        Self { group_light: GroupLight::new(groups), ..self }
    }

    /// Use of the lanes since it was made.
    pub fn lane_use(&self) -> LaneUse {
        self.lane_use
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
        self.samples_by_group(at, tally, std::slice::from_mut(found));
    }

    /// [`Self::samples`] into the first list, and into one more list for each group of lights the light of its lights, with the
    /// places of the samples and without auxiliary layers.
    ///
    /// The light of all groups adds up to that of a sample, to the rounding of the sums in single precision. A sample that is
    /// invalid is so in each group.
    ///
    /// # Panics
    /// With fewer lists.
    pub fn samples_by_group(&mut self, at: &[PixelSample], tally: &mut ConnectionTally, found: &mut [Vec<Sample>]) {
        found.iter_mut().for_each(Vec::clear);
        for at in at.chunks(BATCH) {
            let complete = found[0].len();
            self.observed(at, Watch { tally, observer: None }, found);
            if tally.is_abandoned {
                found.iter_mut().for_each(|found| found.truncate(complete));
                return;
            }
        }
    }

    /// Appends the samples of a batch, with the events of their paths. Returns the weight of the first camera ray.
    pub(crate) fn observed(&mut self, at: &[PixelSample], watch: Watch<'_>, found: &mut [Vec<Sample>]) -> f32 {
        self.begin();
        let set = self.set;
        dispatch!(set, F, token => {
            for group in at.chunks(F::WIDTH) {
                self.generate::<F>(token, group);
            }
        });
        self.follow(watch);
        let complete = found[0].len();
        self.collect(|path| self.paths[path].radiance(), |path| self.samples[path], &mut found[0]);
        for group in 0..self.group_light.len() {
            let (whole, of_group) = found.split_at_mut(1 + group);
            self.collect(|path| self.group_light.of(path, group), |_| Sample::MISS, &mut of_group[0]);
            let invalid = whole[0].iter().zip(&mut of_group[0]).skip(complete).filter(|(whole, _)| !whole.is_valid());
            invalid.for_each(|(whole, of_group)| of_group.radiance = whole.radiance);
        }
        self.camera.first().map_or(1.0, |(weight, ..)| *weight)
    }

    /// Appends the samples of the paths, from the light on each path and the auxiliary layers of each sample.
    fn collect(&self, light: impl Fn(usize) -> Rgb, layers: impl Fn(usize) -> Sample, found: &mut Vec<Sample>) {
        let (samples, complete) = (self.samples.len(), found.len());
        found.extend((0..samples).map(|path| {
            let light = light(path);
            Sample { radiance: light, first_light: light, ..layers(path) }
        }));
        let found = &mut found[complete..];
        for (rest, &owner) in (samples..self.paths.len()).zip(&self.owners) {
            found[owner as usize].radiance += light(rest);
        }
        for (sample, &(weight, start, place)) in found.iter_mut().zip(&self.camera) {
            // The lens scales the radiance, for example by vignetting.
            sample.radiance *= weight;
            sample.first_light *= weight;
            sample.place = place;
            sample.depth += if sample.hit { start } else { 0.0 };
        }
    }

    /// Begins a batch.
    pub(crate) fn begin(&mut self) {
        self.paths.clear();
        self.owners.clear();
        self.rays.clear();
        self.camera.clear();
    }

    /// The number of the sample that a path belongs to.
    #[inline]
    fn owner(&self, path: u32) -> u32 {
        match path.checked_sub(self.samples.len() as u32) {
            Some(behind) => self.owners[behind as usize],
            None => path,
        }
    }

    /// Adds the path of a ray to the batch.
    pub(crate) fn push(&mut self, ray: &Ray, sampler: &Sampler) {
        self.rays.push(ray, self.paths.len() as u32);
        self.paths.push(PathState::new(sampler));
    }

    /// Adds the paths of some samples, at most one for each lane: from a uniform place in the pixel, which is the box filter
    /// of a sensor that integrates over its pixel. For a lens that blurs, they are spread farther by a second box.
    #[inline(always)]
    fn generate<F: Lanes>(&mut self, token: F::Token, at: &[PixelSample]) {
        let Estimator { scene, camera, seed, frame, .. } = self.estimator;
        let first = self.paths.len() as u32;
        let ([mut column, mut row], mut paths) = ([[0.0; MAX_WIDTH]; 2], [first; MAX_WIDTH]);
        for (lane, at) in at.iter().enumerate() {
            (column[lane], row[lane], paths[lane]) = (at.x as f32, at.y as f32, first + lane as u32);
            self.paths.push(PathState::new(&self.estimator.sampler(*at)));
        }
        let PathStates { sampler, .. } = PathStates::<F>::load(
            token,
            #[inline(always)]
            |lane| &self.paths[paths[lane] as usize],
        );
        let numbers = sampler.numbers(dimensions::CAMERA);
        let [dx, dy] = numbers.first_two();
        let (mut x, mut y) = (F::load(token, &column) + dx, F::load(token, &row) + dy);
        let mut time = F::splat(token, 0.0);
        if let Some(shutter) = scene.shutter() {
            // The time of each sample. The rows of a line scan have the same place on the film.
            let (dy, u) = (dy.to_array(), sampler.numbers(dimensions::TIME).get(0).to_array());
            let mut times = [0.0; MAX_WIDTH];
            for (lane, at) in at.iter().enumerate() {
                Moment { time: times[lane], y: row[lane] } = shutter.moment(at.y, dy[lane], u[lane], (seed, frame));
            }
            (time, y) = (F::load(token, &times), F::load(token, &row));
        }
        let mut places = [[0.0; MAX_WIDTH]; 2];
        if let Some(spread) = camera.spread() {
            let middle = F::splat(token, 0.5);
            let [right, down] = numbers.last_two().map(
                #[inline(always)]
                |u| (u - middle) * spread,
            );
            (x, y) = (x + right, y + down);
            (dx - middle).store(&mut places[0]);
            (dy - middle).store(&mut places[1]);
        }
        // A pinhole needs no place on the lens.
        let lens = match camera.has_aperture() {
            true => Some(sampler.numbers(dimensions::LENS).first_two()),
            false => None,
        };
        let CameraRays { origin, direction, weight, start } = camera.camera_rays(token, x, y, lens);
        let lanes = F::mask(token, u32::MAX >> (32 - at.len()));
        self.rays.append((lanes, &paths), [origin, direction], weight.constant(f32::INFINITY), time);
        let (weight, start) = (weight.to_array(), start.to_array());
        for lane in 0..at.len() {
            self.camera.push((weight[lane], start[lane], [places[0][lane], places[1][lane]]));
        }
    }

    /// Follows the paths of the batch to their ends.
    pub(crate) fn follow(&mut self, mut watch: Watch<'_>) {
        let scene = self.estimator.scene;
        self.among_solids.clear();
        if scene.has_solids() {
            for ray in 0..self.paths.len() {
                let enclosing = RayState::from_camera(scene, self.rays.get(ray)).enclosing;
                self.among_solids.push(AmongSolids { enclosing, prefix: None });
            }
        }
        self.samples.clear();
        self.samples.resize(self.paths.len(), Sample::MISS);
        self.layers.clear();
        self.layers.resize(self.paths.len(), Layers::Unset);
        self.group_light.clear();
        self.group_light.resize(self.paths.len());
        let mut unchecked = 0;
        for vertex in 0.. {
            self.wave(vertex, &mut watch);
            if watch.observer.is_some() {
                self.trace_shadow_rays(&mut watch);
            }
            if self.rays.paths.is_empty() || watch.needs_outcomes() && vertex + 1 >= MAX_TRAINING_VERTICES {
                break;
            }
            // Paths in dense media have thousands of vertices: their shadow rays would fill the memory.
            if (vertex + 1) % 16 == 0 {
                self.add_light(&mut watch);
            }
            unchecked += self.rays.paths.len();
            if unchecked >= CHECK_EVERY {
                unchecked = 0;
                watch.tally.is_abandoned = watch.tally.abandon_at.is_some_and(|at| Instant::now() > at);
                if watch.tally.is_abandoned {
                    break;
                }
            }
        }
        self.add_light(&mut watch);
    }

    /// Adds the light of the shadow rays of all vertices so far.
    fn add_light(&mut self, watch: &mut Watch<'_>) {
        self.trace_shadow_rays(watch);
        // The order of the sum is that of a batch without an observer.
        self.observed_light.sort_by_key(|(queue, ..)| *queue);
        for (_, path, light) in self.observed_light.drain(..) {
            self.paths[path as usize].add_radiance(light);
        }
    }

    /// All paths advance by one vertex.
    fn wave(&mut self, vertex: u32, watch: &mut Watch<'_>) {
        let scene = self.estimator.scene;
        let count = self.rays.paths.len();
        scene.bvh().closest_hits(self.set, &self.rays.batch(), &mut self.hits.batch(count));
        self.next.clear();
        self.order.clear();
        self.arrivals.clear();
        self.escaped.clear();
        self.arriving.clear();
        for ray in 0..count {
            match self.hits.get(ray) {
                None => self.escaped.push(ray as u32),
                Some(hit) => self.reach(ray, &hit),
            }
        }
        let set = if count < LEAST_RAYS { InstructionSet::Scalar } else { self.set };
        dispatch!(set, F, token => self.pass_media::<F>(token, vertex));
        for at in 0..self.arriving.len() {
            self.arrive(self.arriving[at], vertex);
        }
        self.order.sort_unstable();
        dispatch!(set, F, token => {
            self.escape::<F>(token, watch);
            self.scatter_all::<F>(token, vertex, watch);
            self.connect::<F>(token, watch);
        });
        std::mem::swap(&mut self.rays, &mut self.next);
    }

    /// The ray with its solids.
    fn ray_state(&self, ray: usize) -> RayState {
        let number = self.rays.paths[ray] as usize;
        let enclosing = self.among_solids.get(number).map_or(EnclosingSolids::Last(None), |a| a.enclosing);
        RayState { ray: self.rays.get(ray), enclosing }
    }

    /// The interfaces that some paths have passed since their last scatterings.
    #[inline(always)]
    fn prefixes(&self, paths: &[u32]) -> [Option<&SpecularPrefix>; MAX_WIDTH] {
        let mut prefixes = [None; MAX_WIDTH];
        for (prefix, path) in prefixes.iter_mut().zip(paths) {
            if let Some(among) = self.among_solids.get(*path as usize) {
                *prefix = among.prefix.as_ref();
            }
        }
        prefixes
    }

    /// The ray reaches a surface. Where it is certainly present, lanes find the point.
    #[inline]
    fn reach(&mut self, ray: usize, hit: &Hit) {
        let scene = self.estimator.scene;
        let material = scene.material_of(hit.instance, hit.part, hit.triangle);
        let is_among_solids = scene.has_solids()
            && matches!(self.among_solids[self.rays.paths[ray] as usize].enclosing, EnclosingSolids::All(_));
        if scene.is_random(material) || is_among_solids {
            return self.arriving.push((ray as u32, f32::INFINITY));
        }
        self.order.push(u64::from(2 * material) << 32 | ray as u64);
    }

    /// A ray of those that arrive reaches a point in a medium or on a surface that is present, or passes the surface.
    fn arrive(&mut self, (ray, distance): (u32, f32), vertex: u32) {
        let Some(hit) = self.hits.get(ray as usize) else { return };
        let (scene, number) = (self.estimator.scene, self.rays.paths[ray as usize]);
        let mut ray_state = self.ray_state(ray as usize);
        let (mut interface, mut behind) = (None, None);
        let mut path = self.paths[number as usize].get();
        let arrival = if distance < f32::INFINITY {
            let is_one = scene.light_choice_at(path.light_vertices as u32, true) == LightChoice::One;
            let point = SurfacePoint::in_medium(&ray_state.ray, distance);
            let material = ray_state.enclosing.material(scene);
            material.map(|material| (MEDIUM | (2 * material) | u32::from(is_one), (point, 0.0, None)))
        } else {
            let point = scene.surface_point(&hit, ray_state.ray.time);
            let hit = ray_state.hit_at(scene, point, &mut interface);
            let present = path.sample_presence(scene, &mut ray_state, vertex, hit, &mut behind);
            if present.is_none() {
                self.next.push(&ray_state.ray, number);
                if let Some(among) = self.among_solids.get_mut(number as usize) {
                    among.enclosing = ray_state.enclosing;
                }
            }
            present.map(|(hit, u_kind)| (2 * hit.surface.material(), (hit.surface, u_kind, hit.interface.copied())))
        };
        self.paths[number as usize].put(&path);
        if let Some((key, (point, u_kind, interface))) = arrival {
            self.order.push(u64::from(ARRIVED | key) << 32 | self.arrivals.len() as u64);
            self.arrivals.push(Arrival { ray, point, u_kind, interface });
        }
    }

    /// Light samples and new directions at all points.
    #[inline(always)]
    fn scatter_all<F: Lanes>(&mut self, token: F::Token, vertex: u32, watch: &mut Watch<'_>) {
        let (order, arrivals) = (std::mem::take(&mut self.order), std::mem::take(&mut self.arrivals));
        for of_key in order.chunk_by(|a, b| a >> 32 == b >> 32) {
            for group in of_key.chunks(F::WIDTH) {
                let mut numbers = [group[0] as u32; MAX_WIDTH];
                for (number, key) in numbers.iter_mut().zip(group) {
                    *number = *key as u32;
                }
                let key = (group[0] >> 32) as u32;
                self.lane_use.count::<F>(POINTS, group.len());
                self.scatter_group::<F>(token, vertex, (key, numbers, group.len()), &arrivals, watch);
            }
        }
        (self.order, self.arrivals) = (order, arrivals);
    }

    /// Traces the shadow rays of all vertices, light by light, and adds the light of those that are not occluded. Those behind
    /// covers follow the straight ones of the same light. The rays of late vertices are few: together they fill packets.
    fn trace_shadow_rays(&mut self, watch: &mut Watch<'_>) {
        let scene = self.estimator.scene;
        for (index, queues) in (0..).zip(&mut self.shadow) {
            for (kind, queue) in (0..).zip(queues) {
                self.occluded.clear();
                self.occluded.resize(queue.rays.paths.len(), false);
                scene.bvh().occluded_batch(self.set, &queue.rays.batch(), &mut self.occluded);
                for (i, &path) in queue.rays.paths.iter().enumerate() {
                    // A surface that lets light pass may be the only one on the way.
                    let light = match (self.occluded[i], scene.has_coverage()) {
                        (false, _) => queue.light(i),
                        (true, false) => Rgb::BLACK,
                        (true, true) => queue.light(i) * scene.transmittance(&queue.rays.get(i)),
                    };
                    if watch.observer.is_some() {
                        self.observed_light.push(([index, kind], path, light));
                    } else if !light.is_black() {
                        self.paths[path as usize].add_radiance(light);
                        if let Some(&group) = queue.groups.get(i) {
                            self.group_light.add(path, group, light);
                        }
                    }
                    watch.event(path, || match queue.connections.get(i) {
                        Some(of) => {
                            Event::Connection { index, connection: TraceConnection { contribution: light, ..*of } }
                        }
                        None => Event::ShadowRay { index, light },
                    });
                }
                queue.clear();
            }
        }
    }
}
