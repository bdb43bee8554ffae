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

use crate::dimensions;
use crate::direct::{ShadowRoulette, gathered_survival, light_weight};
use crate::estimator::{CameraSample, Estimator, PixelSample, weighted};
use crate::learned_roulette::VertexRoulettes;
use crate::mnee;
use crate::path::{Path, Presence, survival};
use crate::ray_state::SurfaceHit;
use crate::recorder::ConnectionTally;
use crate::scatterer::{EachLane, OneLane, Scatterer};
use crate::vertex::{SurfaceVertex, Vertex};
use dunkelfeld_bsdf::{Bsdf, InLanes, Lobe, View};
use dunkelfeld_bvh::{Hit, HitBatch, NO_HIT, RayBatch};
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::{Ray, Vec3, offset_ray_origins};
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, Mask, V3, dispatch};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{
    KernelFeatures, LightChoice, LightSample, LightSamples, LightTarget, Receivers, ShadingFrames, SurfacePoint,
    shadow_rays,
};

/// Most paths that are followed together. Their state takes about half a megabyte.
const BATCH: usize = 1024;

/// All features but media. Paths in scenes with media are followed one by one.
type Wide = KernelFeatures<true, true, true, false>;

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

/// Rays, an array for each number.
#[derive(Debug, Default)]
struct Rays {
    origin: [Vec<f32>; 3],
    direction: [Vec<f32>; 3],
    t_max: Vec<f32>,
    /// Empty for a scene at rest.
    time: Vec<f32>,
}

impl Rays {
    fn clear(&mut self) {
        let Self { origin, direction, t_max, time } = self;
        origin.iter_mut().chain(direction).chain([t_max, time]).for_each(Vec::clear);
    }

    #[inline]
    fn push(&mut self, ray: &Ray, moves: bool) {
        for k in 0..3 {
            self.origin[k].push(ray.origin[k]);
            self.direction[k].push(ray.direction[k]);
        }
        self.t_max.push(ray.t_max);
        if moves {
            self.time.push(ray.time);
        }
    }

    fn batch(&self) -> RayBatch<'_> {
        RayBatch {
            origin: self.origin.each_ref().map(Vec::as_slice),
            direction: self.direction.each_ref().map(Vec::as_slice),
            t_max: &self.t_max,
            time: &self.time,
        }
    }
}

/// The nearest hits of rays.
#[derive(Debug, Default)]
struct Hits {
    /// Ray parameters and barycentric weights.
    numbers: [Vec<f32>; 3],
    /// Instances, parts, triangles.
    ids: [Vec<u32>; 3],
}

impl Hits {
    fn batch(&mut self, len: usize) -> HitBatch<'_> {
        self.numbers.iter_mut().for_each(|v| v.resize(len, 0.0));
        self.ids.iter_mut().for_each(|v| v.resize(len, 0));
        let ([t, b1, b2], [instance, part, triangle]) = (&mut self.numbers, &mut self.ids);
        HitBatch { t, b1, b2, instance, part, triangle }
    }

    #[inline]
    fn get(&self, i: usize) -> Option<Hit> {
        let ([t, b1, b2], [instance, part, triangle]) = (&self.numbers, &self.ids);
        (instance[i] != NO_HIT).then(|| Hit {
            t: t[i],
            b1: b1[i],
            b2: b2[i],
            instance: instance[i],
            part: part[i],
            triangle: triangle[i],
        })
    }
}

/// Shadow rays to one light, with the light that they carry.
#[derive(Debug, Default)]
struct ShadowRays {
    rays: Rays,
    /// The light of each ray.
    light: Vec<QueuedLight>,
}

/// Light of a light sample at a vertex.
#[derive(Clone, Copy, Debug)]
struct QueuedLight {
    path: u32,
    /// Throughput of the path at the vertex.
    throughput: Rgb,
    /// Radiance that is scattered to the camera side if the ray is not occluded [W/(m^2 sr)].
    direct: Rgb,
    /// Radiance of the connection through covers [W/(m^2 sr)].
    connected: Rgb,
}

/// Paths on surfaces of one material, one for each lane. Free lanes repeat the first path.
struct Group<'g, 'a> {
    paths: [u32; MAX_WIDTH],
    vertices: &'g [SurfaceVertex<'a, Wide>],
    vertex: u32,
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
        let features = self.estimator.scene.features();
        for (first, at) in (0..).step_by(BATCH).zip(at.chunks(BATCH)) {
            self.paths.clear();
            self.samples.clear();
            for (number, at) in (first..).zip(at) {
                let CameraSample { sampler, ray, weight, start } = self.estimator.camera_sample(*at);
                let is_inside = features.solids && self.estimator.scene.may_be_inside(ray.origin);
                if features.media || is_inside {
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
        let mut storage = [const { None }; MAX_WIDTH];
        for of_material in order.chunk_by(|a, b| a >> 32 == b >> 32) {
            for group in of_material.chunks(F::WIDTH) {
                let mut paths = [group[0] as u32; MAX_WIDTH];
                for (lane, key) in group.iter().enumerate() {
                    paths[lane] = *key as u32;
                }
                let vertices = self.vertices(scene, &paths[..group.len()], &mut storage);
                let group = Group { paths, vertices: &vertices, vertex };
                self.scatter_group::<F>(token, &group, tally);
            }
        }
        self.order = order;
    }

    /// The surfaces of some paths.
    #[inline(never)]
    fn vertices<'s>(
        &self,
        scene: &'s dunkelfeld_scene::Scene,
        paths: &[u32],
        storage: &'s mut [Option<Bsdf>; MAX_WIDTH],
    ) -> Vec<SurfaceVertex<'s, Wide>> {
        let mut vertices = Vec::with_capacity(MAX_WIDTH);
        for (&number, storage) in paths.iter().zip(storage) {
            if let Some((point, u_kind)) = self.points[number as usize] {
                let (state, hit) = (self.paths[number as usize].ray_state, SurfaceHit::of_surface(point));
                vertices.push(SurfaceVertex::new(scene, state, hit, u_kind, storage));
            }
        }
        vertices
    }

    /// Scattering of a group by the BSDFs of its lanes: all principled and plain, all principled, or of several kinds.
    #[inline(always)]
    fn scatter_group<F: Lanes>(&mut self, token: F::Token, group: &Group<'_, '_>, tally: &mut ConnectionTally) {
        let first = &group.vertices[0];
        let padded = || group.vertices.iter().chain(std::iter::repeat_n(first, MAX_WIDTH));
        let frames = ShadingFrames::of(token, padded().map(|at| (&at.shading, at.hit.surface.normal)));
        if let Bsdf::Principled(surface) = first.shading.bsdf {
            let mut surfaces = [surface; MAX_WIDTH];
            let (mut all, mut is_same) = (true, true);
            for (lane, at) in group.vertices.iter().enumerate() {
                match at.shading.bsdf {
                    Bsdf::Principled(own) => {
                        surfaces[lane] = own;
                        is_same &= std::ptr::eq(own, surface);
                    }
                    _ => all = false,
                }
            }
            if all {
                let mut wo = [Vec3::Z; MAX_WIDTH];
                for (lane, at) in group.vertices.iter().enumerate() {
                    wo[lane] = at.wo_local().0;
                }
                let wo = V3::from_lanes(token, &wo);
                let surface =
                    if is_same { InLanes::<F>::splat(token, surface) } else { InLanes::<F>::gather(token, &surfaces) };
                if surface.is_rich() {
                    self.scatter::<F, _>(token, group, &Scatterer { frames, view: surface.view::<true>(wo) }, tally);
                } else {
                    self.scatter::<F, _>(token, group, &Scatterer { frames, view: surface.view::<false>(wo) }, tally);
                }
                return;
            }
        }
        let mut lanes = [OneLane { bsdf: first.shading.bsdf, wo: first.wo_local() }; MAX_WIDTH];
        for (lane, at) in group.vertices.iter().enumerate() {
            lanes[lane] = OneLane { bsdf: at.shading.bsdf, wo: at.wo_local() };
        }
        self.scatter::<F, _>(token, group, &Scatterer { frames, view: EachLane { lanes } }, tally);
    }

    /// Auxiliary layers, light samples and a new direction for the paths of a group.
    #[inline(always)]
    fn scatter<F: Lanes, V: View<F>>(
        &mut self,
        token: F::Token,
        group: &Group<'_, '_>,
        at: &Scatterer<F, V>,
        tally: &mut ConnectionTally,
    ) {
        self.set_layers(token, group, at);
        let (scene, vertex) = (self.estimator.scene, group.vertex);
        let mut samplers = [self.paths[group.paths[0] as usize].sampler; MAX_WIDTH];
        for lane in 0..group.vertices.len() {
            samplers[lane] = self.paths[group.paths[lane] as usize].sampler;
        }
        let sampler = Sampler::<F>::from_lanes(token, &samplers);
        let used = F::mask(token, u32::MAX >> (32 - group.vertices.len()));

        let mut learned = [None; MAX_WIDTH];
        let (mut throughput, mut eta_scale, mut max_survival) = ([Rgb::BLACK; MAX_WIDTH], [1.0; MAX_WIDTH], [1.0; MAX_WIDTH]);
        let mut gathered = [0.0; MAX_WIDTH];
        let mut delta = 0;
        for (lane, surface) in group.vertices.iter().enumerate() {
            let path = &mut self.paths[group.paths[lane] as usize];
            if let Some(roulette) = path.roulette {
                learned[lane] = roulette.at(surface.hit.surface.point, surface.shading.material, &mut path.gain_scale);
            }
            (throughput[lane], eta_scale[lane]) = (path.throughput, path.eta_scale);
            if surface.shading.bsdf.is_delta() {
                delta |= 1 << lane;
            } else {
                // The first vertex contributes most of the light of the pixel. Without training, roulette skips none of
                // its shadow rays.
                if path.light_vertices > 0 {
                    gathered[lane] = path.sample.radiance.max_channel();
                }
                path.light_vertices += 1;
            }
        }
        let learned = VertexRoulettes::<F>::new(token, learned);
        let throughput = rgb_of_lanes::<F>(token, &throughput);
        let lit = used & !F::mask(token, delta);
        if lit.any() {
            let light = (lit, &learned, throughput, F::load(token, &gathered));
            self.sample_lights(token, group, at, &sampler, light, tally);
        }

        // A new direction by sampling the BSDF.
        let numbers = sampler.numbers(dimensions::scatter(vertex));
        let ([u_x, u_y], [u_lobe, u_roulette]) = (numbers.first_two(), numbers.last_two());
        let (wi, sample) = at.sample([u_x, u_y, u_lobe]);
        let throughput = throughput * sample.weight;
        let eta_scale = F::load(token, &eta_scale) * (sample.eta * sample.eta);
        for lane in 0..group.vertices.len() {
            max_survival[lane] = self.paths[group.paths[lane] as usize].count_scattering(false);
        }
        let max_survival = F::load(token, &max_survival);
        let brightest = throughput.max_channel();
        let other = survival(brightest * eta_scale, max_survival);
        let survival = learned.path_survival(brightest, other).min(max_survival);
        let alive = used & sample.pdf.is_positive() & u_roulette.lt(survival);
        if !alive.any() {
            return;
        }
        let throughput = throughput * survival.recip();
        let (wi, eta_scale, pdf) = (wi.to_lanes(), eta_scale.to_array(), sample.pdf.to_array());
        let (r, g, b) = (throughput.r.to_array(), throughput.g.to_array(), throughput.b.to_array());
        let lobe = F::word_to_array(sample.lobe);
        let bits = alive.bits();
        for (lane, surface) in group.vertices.iter().enumerate() {
            if bits >> lane & 1 == 0 {
                continue;
            }
            let path = &mut self.paths[group.paths[lane] as usize];
            path.throughput = Rgb::new(r[lane], g[lane], b[lane]);
            path.eta_scale = eta_scale[lane];
            path.ray_state = surface.spawn_ray(wi[lane]);
            let choice = scene.light_choice_at(path.light_vertices, false);
            let from = (pdf[lane], Lobe::from_bits(lobe[lane]));
            path.set_last(&surface.shading.receiver, choice, from, Some(&surface.hit.surface));
            self.next.push(group.paths[lane]);
        }
    }

    /// The auxiliary layers of paths that have reached their first surface.
    #[inline(always)]
    fn set_layers<F: Lanes, V: View<F>>(&mut self, token: F::Token, group: &Group<'_, '_>, at: &Scatterer<F, V>) {
        let mut is_first = false;
        for (lane, surface) in group.vertices.iter().enumerate() {
            let path = &mut self.paths[group.paths[lane] as usize];
            path.path_length += surface.hit.surface.distance;
            is_first |= path.is_first_surface();
        }
        if !is_first {
            return;
        }
        let mut wo = [Vec3::Z; MAX_WIDTH];
        for (lane, surface) in group.vertices.iter().enumerate() {
            wo[lane] = surface.wo_local().0;
        }
        let albedo = at.view.albedo(V3::from_lanes(token, &wo));
        let (r, g, b) = (albedo.r.to_array(), albedo.g.to_array(), albedo.b.to_array());
        for (lane, surface) in group.vertices.iter().enumerate() {
            let path = &mut self.paths[group.paths[lane] as usize];
            if path.is_first_surface() {
                let layers = (Rgb::new(r[lane], g[lane], b[lane]), surface.shading.frame.normal);
                path.set_layers(surface.is_see_through(), || layers);
            }
        }
    }

    /// Next-event estimation: light samples of all lights that a vertex samples, and their shadow rays.
    #[inline(always)]
    fn sample_lights<F: Lanes, V: View<F>>(
        &mut self,
        token: F::Token,
        group: &Group<'_, '_>,
        at: &Scatterer<F, V>,
        sampler: &Sampler<F>,
        (lit, learned, throughput, gathered): (F::Mask, &VertexRoulettes<'_, F>, Rgb<F>, F),
        tally: &mut ConnectionTally,
    ) {
        let (scene, vertex) = (self.estimator.scene, group.vertex);
        let choice = scene.light_choice_at(0, false);
        let [mut points, mut errors, mut facing] = [[Vec3::ZERO; MAX_WIDTH]; 3];
        let mut both_sides = 0;
        for (lane, surface) in group.vertices.iter().enumerate() {
            (points[lane], errors[lane]) = (surface.hit.surface.point, surface.hit.surface.error);
            facing[lane] = surface.shading.receiver.normal;
            both_sides |= u32::from(surface.shading.receiver.both_sides) << lane;
        }
        let (point, error) = (V3::from_lanes(token, &points), V3::from_lanes(token, &errors));
        let receivers = Receivers {
            point,
            normal: V3::from_lanes(token, &facing),
            both_sides: F::mask(token, both_sides),
        };
        let brightest = throughput.max_channel();
        // The roulette of gathered light, for lanes without learned statistics.
        let scale = brightest / (gathered * ShadowRoulette::THRESHOLD);
        let is_gathered = gathered.is_positive() & scale.is_positive();
        for index in 0..scene.num_light_samples(choice) {
            let numbers = sampler.numbers(dimensions::light(vertex, index));
            let [u_2, u_chain] = numbers.last_two();
            let (u_choice, u_roulette) = match choice {
                LightChoice::Each => (u_2.constant(0.0), u_2),
                LightChoice::One => (u_2, sampler.numbers(dimensions::single_light_roulette(vertex)).get(0)),
            };
            let light = scene.sample_lights(token, &receivers, choice, index, u_choice, numbers.first_two(), lit);
            let sampled = lit & light.pdf.is_positive();
            if !sampled.any() {
                continue;
            }
            let (scattered, pdf) = at.eval(light.direction);
            let unoccluded = scattered * light.radiance;
            let expected = unoccluded * light_weight(light.pdf, pdf, light.is_delta);
            let one = pdf.constant(1.0);
            let other = match choice {
                LightChoice::Each => is_gathered.select(gathered_survival(scale * expected.max_channel()), one),
                LightChoice::One => one,
            };
            let survival = learned.shadow_survival(index, brightest * expected.max_channel(), other);
            let traced = sampled & unoccluded.is_lit() & u_roulette.lt(survival);
            let origin = offset_ray_origins(point, error, at.frames.normal, light.direction);
            let (direction, t_max) = shadow_rays(origin, light.direction, (light.point, light.normal, light.is_finite));
            let rays = Queued { index, sampled, traced, origin, direction, t_max, expected, survival };
            self.queue_shadow_rays(group, &rays);
            if !scene.covers().is_empty() {
                let u = (u_roulette, u_chain);
                self.connect(group, &light, (index, choice, sampled), (learned, gathered), u, tally);
            }
        }
    }

    /// Stores the shadow rays of lanes.
    #[inline(always)]
    fn queue_shadow_rays<F: Lanes>(&mut self, group: &Group<'_, '_>, q: &Queued<F>) {
        let scene = self.estimator.scene;
        let (has_covers, has_coverage) = (!scene.covers().is_empty(), scene.has_coverage());
        let moves = scene.shutter().is_some();
        let queue = &mut self.shadow[q.index as usize];
        let (origins, directions, t_max) = (q.origin.to_lanes(), q.direction.to_lanes(), q.t_max.to_array());
        let (r, g, b) = (q.expected.r.to_array(), q.expected.g.to_array(), q.expected.b.to_array());
        let survival = q.survival.to_array();
        let (sampled, traced) = (q.sampled.bits(), q.traced.bits());
        for (lane, surface) in group.vertices.iter().enumerate() {
            let path = group.paths[lane];
            let Path { throughput, ray_state, .. } = &self.paths[path as usize];
            let mut light = QueuedLight { path, throughput: *throughput, direct: Rgb::BLACK, connected: Rgb::BLACK };
            let mut ray = Ray {
                origin: origins[lane],
                direction: directions[lane],
                t_max: t_max[lane],
                time: ray_state.ray.time,
            };
            if traced >> lane & 1 == 1 {
                let mut open = 1.0;
                if has_coverage {
                    open = scene.transmittance_with::<Wide>(&ray);
                }
                let arriving = Rgb::new(r[lane], g[lane], b[lane]) * (open / survival[lane]);
                light.direct = arriving * surface.transmittance_toward(scene, ray.direction, ray.t_max);
                if has_coverage {
                    ray.t_max = 0.0;
                }
            } else if has_covers && sampled >> lane & 1 == 1 {
                // A connection of this light sample may follow.
                ray.t_max = 0.0;
            } else {
                continue;
            }
            queue.rays.push(&ray, moves);
            queue.light.push(light);
        }
    }

    /// Connections through covers to the light samples of lanes, one by one.
    #[inline(never)]
    fn connect<F: Lanes>(
        &mut self,
        group: &Group<'_, '_>,
        light: &LightSamples<F>,
        (index, choice, sampled): (u32, LightChoice, F::Mask),
        (learned, gathered): (&VertexRoulettes<'_, F>, F),
        (u_roulette, u_chain): (F, F),
        tally: &mut ConnectionTally,
    ) {
        let (directions, points, normals) = (light.direction.to_lanes(), light.point.to_lanes(), light.normal.to_lanes());
        let (r, g, b) = (light.radiance.r.to_array(), light.radiance.g.to_array(), light.radiance.b.to_array());
        let (pdf, u_roulette, u_chain) = (light.pdf.to_array(), u_roulette.to_array(), u_chain.to_array());
        let gathered = gathered.to_array();
        let (is_finite, is_delta, sampled) = (light.is_finite.bits(), light.is_delta.bits(), sampled.bits());
        let first = self.shadow[index as usize].light.len() - sampled.count_ones() as usize;
        let mut place = first;
        for (lane, surface) in group.vertices.iter().enumerate() {
            if sampled >> lane & 1 == 0 {
                continue;
            }
            let path = &self.paths[group.paths[lane] as usize];
            let sample = LightSample {
                direction: directions[lane],
                target: (is_finite >> lane & 1 == 1).then(|| LightTarget::new(points[lane], normals[lane])),
                radiance: Rgb::new(r[lane], g[lane], b[lane]),
                pdf: pdf[lane],
                is_delta: is_delta >> lane & 1 == 1,
            };
            let u = u_roulette[lane];
            let roulette = match (learned.lane(lane), choice) {
                (Some(vertex), _) => {
                    ShadowRoulette::Learned { vertex, index, throughput: path.throughput.max_channel(), u }
                }
                (None, LightChoice::One) => ShadowRoulette::Off,
                (None, LightChoice::Each) => {
                    ShadowRoulette::from_gathered(path.throughput, Rgb::splat(gathered[lane]), || u)
                }
            };
            let connected = mnee::estimate::<Wide, _>(
                self.estimator.scene,
                surface,
                &sample,
                index,
                roulette,
                || u_chain[lane],
                tally,
            );
            self.shadow[index as usize].light[place].connected = connected;
            place += 1;
        }
    }

    /// Traces the shadow rays, light by light, and adds the light of those that are not occluded.
    fn trace_shadow_rays(&mut self) {
        let bvh = self.estimator.scene.bvh();
        for queue in &mut self.shadow {
            self.occluded.clear();
            self.occluded.resize(queue.light.len(), false);
            bvh.occluded_batch(self.set, &queue.rays.batch(), &mut self.occluded);
            for (light, is_occluded) in queue.light.drain(..).zip(&self.occluded) {
                let QueuedLight { path, throughput, direct, connected } = light;
                let direct = if *is_occluded { Rgb::BLACK } else { direct };
                self.paths[path as usize].sample.radiance += throughput * (direct + connected);
            }
            queue.rays.clear();
        }
    }
}

/// The shadow rays of lanes to a light.
struct Queued<F: Lanes> {
    index: u32,
    /// Lanes with a light sample.
    sampled: F::Mask,
    /// Lanes whose ray is traced.
    traced: F::Mask,
    origin: V3<F>,
    direction: V3<F>,
    t_max: F,
    /// Radiance that is scattered to the camera side if the ray is not occluded, and the probability that it is traced.
    expected: Rgb<F>,
    survival: F,
}

/// Colours, one for each lane.
#[inline(always)]
fn rgb_of_lanes<F: Lanes>(token: F::Token, lanes: &[Rgb; MAX_WIDTH]) -> Rgb<F> {
    let [mut r, mut g, mut b] = [[0.0; MAX_WIDTH]; 3];
    for lane in 0..F::WIDTH {
        [r[lane], g[lane], b[lane]] = lanes[lane].to_array();
    }
    Rgb::new(F::load(token, &r), F::load(token, &g), F::load(token, &b))
}
