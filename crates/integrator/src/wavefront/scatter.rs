//! Scattering at surfaces, in lanes: auxiliary layers, next-event estimation, a new direction and roulette.
//!
//! Each stage is a function of its own, so that only the evaluation of BSDFs is compiled for each kind of them.

use super::Wavefront;
use crate::dimensions;
use crate::direct::{ShadowRoulette, gathered_survival, light_weight};
use crate::dispatch::Wide;
use crate::learned_roulette::VertexRoulettes;
use crate::mnee;
use crate::path::survival;
use crate::recorder::ConnectionTally;
use crate::scatterer::{EachLane, OneLane, Scatterer};
use crate::vertex::{SurfaceVertex, Vertex};
use dunkelfeld_bsdf::{Bsdf, BsdfSamples, InLanes, Lobe, View};
use dunkelfeld_geometry::{Ray, Vec3, offset_ray_origins};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{
    LightChoice, LightSample, LightSamples, LightTarget, Receivers, Scene, ShadingFrames, shadow_rays,
};
use smallvec::SmallVec;

/// Most light samples of a vertex.
const LIGHTS: usize = Scene::MAX_LIGHT_SAMPLES as usize;

/// Paths on surfaces, one for each lane. Free lanes repeat the first path.
struct Group<'g, 'a, F: Lanes> {
    token: F::Token,
    /// Number of the vertex on each path.
    vertex: u32,
    vertices: &'g [SurfaceVertex<'a, Wide>],
    paths: [u32; MAX_WIDTH],
    used: F::Mask,
    /// Lanes with light samples.
    lit: F::Mask,
    /// Does a lane set its auxiliary layers?
    has_layers: bool,
    frames: ShadingFrames<F>,
    wo: V3<F>,
    sampler: Sampler<F>,
    learned: VertexRoulettes<'a, F>,
    throughput: Rgb<F>,
    eta_scale: F,
    /// Largest channel of the radiance before the vertex; zero at the first vertex with light samples. That one contributes
    /// most of the light of the pixel. Without training, roulette skips none of its shadow rays.
    gathered: F,
}

/// A light sample of each lane, with the numbers for its roulette and for a connection.
#[derive(Clone, Copy)]
struct Draw<F: Lanes> {
    light: LightSamples<F>,
    u_roulette: F,
    u_chain: F,
}

/// The BSDFs of a group.
struct Evaluated<F: Lanes> {
    albedo: Rgb<F>,
    /// For each light sample: BSDF times cosine [1/sr], and density of its direction by scattering [1/sr].
    direct: [(Rgb<F>, F); LIGHTS],
    /// The new direction in render space, and the rest of its sample.
    wi: V3<F>,
    sample: BsdfSamples<F>,
    /// The number for roulette.
    u_roulette: F,
}

impl<'a> Wavefront<'a> {
    /// Scattering of the paths `paths` at their vertices, which have the number `vertex` on them.
    #[inline(always)]
    pub(super) fn scatter_group<'v, F: Lanes>(
        &mut self,
        token: F::Token,
        (vertex, vertices, paths): (u32, &[SurfaceVertex<'v, Wide>], [u32; MAX_WIDTH]),
        tally: &mut ConnectionTally,
    ) where
        'a: 'v,
    {
        let group = self.group::<F>(token, vertex, vertices, paths);
        let mut draws = SmallVec::new();
        if group.lit.any() {
            self.draw_lights(&group, &mut draws);
        }
        let found = evaluate_group(&group, &draws);
        self.set_layers(&group, found.albedo);
        self.add_direct_light(&group, &draws, &found, tally);
        self.continue_paths(&group, &found);
    }

    /// Loads the state of paths into lanes.
    #[inline(never)]
    fn group<'g, 'v, F: Lanes>(
        &mut self,
        token: F::Token,
        vertex: u32,
        vertices: &'g [SurfaceVertex<'v, Wide>],
        paths: [u32; MAX_WIDTH],
    ) -> Group<'g, 'v, F>
    where
        'a: 'v,
    {
        let first = &self.paths[paths[0] as usize];
        let (roulette, mut samplers) = (first.roulette, [first.sampler; MAX_WIDTH]);
        let (mut points, mut materials) = ([vertices[0].hit.surface.point; MAX_WIDTH], [0; MAX_WIDTH]);
        let mut gain_scales = [-1.0; MAX_WIDTH];
        let (mut throughput, mut wo) = ([first.throughput; MAX_WIDTH], [vertices[0].wo_local().0; MAX_WIDTH]);
        let [mut eta_scale, mut gathered] = [[0.0; MAX_WIDTH]; 2];
        let (mut lit, mut has_layers) = (0, false);
        for (lane, at) in vertices.iter().enumerate() {
            let path = &mut self.paths[paths[lane] as usize];
            path.path_length += at.hit.surface.distance;
            has_layers |= path.is_first_surface();
            (points[lane], materials[lane]) = (at.hit.surface.point, at.shading.material);
            gain_scales[lane] = path.gain_scale.unwrap_or(-1.0);
            (samplers[lane], throughput[lane], wo[lane]) = (path.sampler, path.throughput, at.wo_local().0);
            eta_scale[lane] = path.eta_scale;
            if !at.is_delta() {
                lit |= 1 << lane;
                if path.light_vertices > 0 {
                    gathered[lane] = path.sample.radiance.max_channel();
                }
                path.light_vertices += 1;
            }
        }
        let group: Group<'_, '_, F> = F::vectorize(
            token,
            #[inline(always)]
            || {
                let learned = match roulette {
                    Some(roulette) => {
                        let (point, material) = (V3::from_lanes(token, &points), F::load_word(token, &materials));
                        roulette.at_lanes(token, point, material, F::load(token, &gain_scales))
                    }
                    None => VertexRoulettes::none(token),
                };
                let padded = vertices.iter().chain(std::iter::repeat_n(&vertices[0], MAX_WIDTH));
                Group {
                    token,
                    vertex,
                    vertices,
                    paths,
                    used: F::mask(token, u32::MAX >> (32 - vertices.len())),
                    lit: F::mask(token, lit),
                    has_layers,
                    frames: ShadingFrames::of(token, padded.map(|at| (&at.shading, at.hit.surface.normal))),
                    wo: V3::from_lanes(token, &wo),
                    sampler: Sampler::from_lanes(token, &samplers),
                    learned,
                    throughput: rgb_of_lanes(token, &throughput),
                    eta_scale: F::load(token, &eta_scale),
                    gathered: F::load(token, &gathered),
                }
            },
        );
        let gain_scales = group.learned.gain_scale.to_array();
        for lane in 0..vertices.len() {
            let gain_scale = gain_scales[lane];
            self.paths[paths[lane] as usize].gain_scale = (gain_scale >= 0.0).then_some(gain_scale);
        }
        group
    }

    /// Draws the light samples of a group.
    #[inline(never)]
    fn draw_lights<F: Lanes>(&self, group: &Group<'_, '_, F>, draws: &mut SmallVec<[Draw<F>; LIGHTS]>) {
        let (scene, token) = (self.estimator.scene, group.token);
        let choice = scene.light_choice_at(0, false);
        F::vectorize(
            token,
            #[inline(always)]
            || {
                let receivers = group.receivers();
                for index in 0..scene.num_light_samples(choice) {
                    let numbers = group.sampler.numbers(dimensions::light(group.vertex, index));
                    let [u_2, u_chain] = numbers.last_two();
                    let (u_choice, u_roulette) = match choice {
                        LightChoice::Each => (u_2.constant(0.0), u_2),
                        LightChoice::One => {
                            let set = dimensions::single_light_roulette(group.vertex);
                            (u_2, group.sampler.numbers(set).get(0))
                        }
                    };
                    let u = numbers.first_two();
                    let light = scene.sample_lights(token, &receivers, choice, index, u_choice, u, group.lit);
                    draws.push(Draw { light, u_roulette, u_chain });
                }
            },
        );
    }

    /// The auxiliary layers of paths that have reached their first surface.
    fn set_layers<F: Lanes>(&mut self, group: &Group<'_, '_, F>, albedo: Rgb<F>) {
        if !group.has_layers {
            return;
        }
        let (r, g, b) = (albedo.r.to_array(), albedo.g.to_array(), albedo.b.to_array());
        for (lane, at) in group.vertices.iter().enumerate() {
            let path = &mut self.paths[group.paths[lane] as usize];
            if path.is_first_surface() {
                let layers = (Rgb::new(r[lane], g[lane], b[lane]), at.shading.frame.normal);
                path.set_layers(at.is_see_through(), || layers);
            }
        }
    }

    /// Next-event estimation: the shadow rays of light samples, with the light that they carry.
    #[inline(never)]
    fn add_direct_light<F: Lanes>(
        &mut self,
        group: &Group<'_, '_, F>,
        draws: &[Draw<F>],
        found: &Evaluated<F>,
        tally: &mut ConnectionTally,
    ) {
        let scene = self.estimator.scene;
        F::vectorize(
            group.token,
            #[inline(always)]
            || {
                let (point, error) = group.points();
                let brightest = group.throughput.max_channel();
                let one = brightest.constant(1.0);
                // The roulette of gathered light, for lanes without learned statistics.
                let scale = brightest / (group.gathered * ShadowRoulette::THRESHOLD);
                let is_gathered = group.gathered.is_positive() & scale.is_positive();
                let choice = scene.light_choice_at(0, false);
                for (index, (draw, (scattered, pdf))) in (0..).zip(draws.iter().zip(&found.direct)) {
                    let light = &draw.light;
                    let sampled = group.lit & light.pdf.is_positive();
                    if !sampled.any() {
                        continue;
                    }
                    let unoccluded = *scattered * light.radiance;
                    let expected = unoccluded * light_weight(light.pdf, *pdf, light.is_delta);
                    let other = match choice {
                        LightChoice::Each => is_gathered.select(gathered_survival(scale * expected.max_channel()), one),
                        LightChoice::One => one,
                    };
                    let survival = group.learned.shadow_survival(index, brightest * expected.max_channel(), other);
                    let traced = sampled & unoccluded.is_lit() & draw.u_roulette.lt(survival);
                    let origin = offset_ray_origins(point, error, group.frames.normal, light.direction);
                    let end = (light.point, light.normal, light.is_finite);
                    let (direction, t_max) = shadow_rays(origin, light.direction, end);
                    self.queue_shadow_rays(
                        group,
                        Queued { index, traced, origin, direction, t_max, expected, survival },
                    );
                    if !scene.covers().is_empty() {
                        self.connect(group, draw, (index, choice, sampled), tally);
                    }
                }
            },
        );
    }

    /// Stores the shadow rays of lanes.
    #[inline(always)]
    fn queue_shadow_rays<F: Lanes>(&mut self, group: &Group<'_, '_, F>, q: Queued<F>) {
        let scene = self.estimator.scene;
        let Queued { index, traced, origin, direction, mut t_max, expected, survival } = q;
        let bits = traced.bits();
        let mut arriving = expected * survival.recip();
        if scene.has_coverage() || scene.features().solids {
            let (origins, directions, ends) = (origin.to_lanes(), direction.to_lanes(), t_max.to_array());
            let (mut open, mut transmittance) = ([1.0; MAX_WIDTH], [Rgb::WHITE; MAX_WIDTH]);
            for (lane, at) in group.vertices.iter().enumerate().filter(|(lane, _)| bits >> lane & 1 == 1) {
                if scene.has_coverage() {
                    let time = self.paths[group.paths[lane] as usize].ray_state.ray.time;
                    let ray = Ray { origin: origins[lane], direction: directions[lane], t_max: ends[lane], time };
                    open[lane] = scene.transmittance_with::<Wide>(&ray);
                }
                transmittance[lane] = at.transmittance_toward(scene, directions[lane], ends[lane]);
            }
            arriving = expected * (F::load(group.token, &open) / survival);
            arriving *= rgb_of_lanes(group.token, &transmittance);
        }
        if scene.has_coverage() {
            // It is traced already.
            t_max = t_max.constant(0.0);
        }
        let light = group.throughput * arriving;
        let moves = scene.shutter().is_some();
        let queue = &mut self.shadow[index as usize];
        queue.rays.append(traced, origin, direction, t_max);
        let [r, g, b] = &mut queue.light;
        light.r.append(traced, r);
        light.g.append(traced, g);
        light.b.append(traced, b);
        for (lane, path) in group.paths[..group.vertices.len()].iter().enumerate() {
            if bits >> lane & 1 == 1 {
                queue.paths.push(*path);
                if moves {
                    queue.rays.push_time(self.paths[*path as usize].ray_state.ray.time);
                }
            }
        }
    }

    /// Connections through covers to the light samples of lanes, one by one.
    #[inline(never)]
    fn connect<F: Lanes>(
        &mut self,
        group: &Group<'_, '_, F>,
        draw: &Draw<F>,
        (index, choice, sampled): (u32, LightChoice, F::Mask),
        tally: &mut ConnectionTally,
    ) {
        let (light, learned) = (&draw.light, &group.learned);
        let (directions, points, normals) =
            (light.direction.to_lanes(), light.point.to_lanes(), light.normal.to_lanes());
        let (r, g, b) = (light.radiance.r.to_array(), light.radiance.g.to_array(), light.radiance.b.to_array());
        let (pdf, u_roulette, u_chain) = (light.pdf.to_array(), draw.u_roulette.to_array(), draw.u_chain.to_array());
        let gathered = group.gathered.to_array();
        let (is_finite, is_delta, sampled) = (light.is_finite.bits(), light.is_delta.bits(), sampled.bits());
        for (lane, surface) in group.vertices.iter().enumerate() {
            if sampled >> lane & 1 == 0 {
                continue;
            }
            let path = &self.paths[group.paths[lane] as usize];
            let sample = LightSample {
                direction: directions[lane],
                target: (is_finite >> lane & 1 == 1)
                    .then(|| LightTarget { point: points[lane], normal: normals[lane] }),
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
            if !connected.is_black() {
                let throughput = self.paths[group.paths[lane] as usize].throughput;
                let moves = self.estimator.scene.shutter().is_some();
                self.shadow[index as usize].push_open(group.paths[lane], throughput * connected, moves);
            }
        }
    }

    /// New directions by sampling the BSDFs, and roulette.
    #[inline(never)]
    fn continue_paths<F: Lanes>(&mut self, group: &Group<'_, '_, F>, found: &Evaluated<F>) {
        let Evaluated { wi, sample, u_roulette, .. } = found;
        let mut max_survival = [1.0; MAX_WIDTH];
        for (most, path) in max_survival.iter_mut().zip(&group.paths[..group.vertices.len()]) {
            *most = self.paths[*path as usize].count_scattering(false);
        }
        let (alive, throughput, eta_scale) = F::vectorize(
            group.token,
            #[inline(always)]
            || {
                let throughput = group.throughput * sample.weight;
                let eta_scale = group.eta_scale * (sample.eta * sample.eta);
                let max_survival = F::load(group.token, &max_survival);
                let brightest = throughput.max_channel();
                let other = survival(brightest * eta_scale, max_survival);
                let survival = group.learned.path_survival(brightest, other).min(max_survival);
                let alive = group.used & sample.pdf.is_positive() & u_roulette.lt(survival);
                (alive.bits(), throughput * survival.recip(), eta_scale)
            },
        );
        if alive == 0 {
            return;
        }
        let choice = self.estimator.scene.light_choice_at(0, false);
        let (wi, eta_scale, pdf) = (wi.to_lanes(), eta_scale.to_array(), sample.pdf.to_array());
        let (r, g, b) = (throughput.r.to_array(), throughput.g.to_array(), throughput.b.to_array());
        let lobe = F::word_to_array(sample.lobe);
        for (lane, at) in group.vertices.iter().enumerate() {
            if alive >> lane & 1 == 1 {
                let path = &mut self.paths[group.paths[lane] as usize];
                path.throughput = Rgb::new(r[lane], g[lane], b[lane]);
                path.eta_scale = eta_scale[lane];
                path.ray_state = at.spawn_ray(wi[lane]);
                let from = (pdf[lane], Lobe::from_bits(lobe[lane]));
                path.set_last(&at.shading.receiver, choice, from, Some(&at.hit.surface));
                self.next.push(group.paths[lane]);
            }
        }
    }
}

impl<F: Lanes> Group<'_, '_, F> {
    /// Positions of the vertices and bounds of their rounding errors.
    #[inline(always)]
    fn points(&self) -> (V3<F>, V3<F>) {
        let [mut points, mut errors] = [[Vec3::ZERO; MAX_WIDTH]; 2];
        for (lane, at) in self.vertices.iter().enumerate() {
            (points[lane], errors[lane]) = (at.hit.surface.point, at.hit.surface.error);
        }
        (V3::from_lanes(self.token, &points), V3::from_lanes(self.token, &errors))
    }

    /// The vertices as receivers of light samples.
    #[inline(always)]
    fn receivers(&self) -> Receivers<F> {
        let [mut points, mut normals] = [[Vec3::ZERO; MAX_WIDTH]; 2];
        let mut both_sides = 0;
        for (lane, at) in self.vertices.iter().enumerate() {
            let receiver = &at.shading.receiver;
            (points[lane], normals[lane]) = (receiver.point, receiver.normal);
            both_sides |= u32::from(receiver.both_sides) << lane;
        }
        Receivers {
            point: V3::from_lanes(self.token, &points),
            normal: V3::from_lanes(self.token, &normals),
            both_sides: F::mask(self.token, both_sides),
        }
    }
}

/// The BSDFs of a group: all principled and plain, all principled, or of several kinds.
fn evaluate_group<F: Lanes>(group: &Group<'_, '_, F>, draws: &[Draw<F>]) -> Evaluated<F> {
    let first = &group.vertices[0];
    if let Bsdf::Principled(surface) = first.shading.bsdf {
        let mut surfaces = [surface; MAX_WIDTH];
        let (mut all, mut is_rich) = (true, false);
        for (lane, at) in group.vertices.iter().enumerate() {
            match at.shading.bsdf {
                Bsdf::Principled(own) => {
                    surfaces[lane] = own;
                    is_rich |= own.is_rich();
                }
                _ => all = false,
            }
        }
        match (all, is_rich) {
            (true, false) => return evaluate_principled::<F, false>(group, &surfaces, draws),
            (true, true) => return evaluate_principled::<F, true>(group, &surfaces, draws),
            _ => {}
        }
    }
    let mut lanes = [OneLane { bsdf: first.shading.bsdf, wo: first.wo_local() }; MAX_WIDTH];
    for (lane, at) in group.vertices.iter().enumerate() {
        lanes[lane] = OneLane { bsdf: at.shading.bsdf, wo: at.wo_local() };
    }
    evaluate_each(group, lanes, draws)
}

/// Principled surfaces.
#[inline(never)]
fn evaluate_principled<F: Lanes, const RICH: bool>(
    group: &Group<'_, '_, F>,
    surfaces: &[&dunkelfeld_bsdf::Principled; MAX_WIDTH],
    draws: &[Draw<F>],
) -> Evaluated<F> {
    F::vectorize(
        group.token,
        #[inline(always)]
        || {
            let is_same = surfaces[..F::WIDTH].iter().all(|other| std::ptr::eq(*other, surfaces[0]));
            let surface = if is_same {
                InLanes::<F>::splat(group.token, surfaces[0])
            } else {
                InLanes::<F>::gather(group.token, surfaces)
            };
            evaluate(group, surface.view::<RICH>(group.wo), draws)
        },
    )
}

/// Surfaces of several kinds, lane by lane.
#[inline(never)]
fn evaluate_each<F: Lanes>(
    group: &Group<'_, '_, F>,
    lanes: [OneLane<'_>; MAX_WIDTH],
    draws: &[Draw<F>],
) -> Evaluated<F> {
    F::vectorize(
        group.token,
        #[inline(always)]
        || evaluate(group, EachLane { lanes }, draws),
    )
}

/// Evaluates BSDFs for the light samples, and samples a direction.
#[inline(always)]
fn evaluate<F: Lanes, V: View<F>>(group: &Group<'_, '_, F>, view: V, draws: &[Draw<F>]) -> Evaluated<F> {
    let at = Scatterer { frames: group.frames, view };
    let black = Rgb::splat(group.eta_scale.constant(0.0));
    let albedo = if group.has_layers { at.view.albedo(group.wo) } else { black };
    let mut direct = [(black, black.r); LIGHTS];
    for (direct, draw) in direct.iter_mut().zip(draws) {
        if (group.lit & draw.light.pdf.is_positive()).any() {
            *direct = at.eval(draw.light.direction);
        }
    }
    let numbers = group.sampler.numbers(dimensions::scatter(group.vertex));
    let ([u_x, u_y], [u_lobe, u_roulette]) = (numbers.first_two(), numbers.last_two());
    let (wi, sample) = at.sample([u_x, u_y, u_lobe]);
    Evaluated { albedo, direct, wi, sample, u_roulette }
}

/// The shadow rays of lanes to a light.
struct Queued<F: Lanes> {
    index: u32,
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
