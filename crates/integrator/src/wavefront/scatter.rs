//! Scattering at surfaces and in media, in lanes: auxiliary layers, next-event estimation, a new direction and roulette.
//!
//! Each stage is a function of its own, so that only the evaluation of BSDFs is compiled for each kind of them.

use super::group::Group;
use super::{Layers, Watch, Wavefront};
use crate::dimensions;
use crate::direct::{GATHERED_SHARE, gathered_survival, light_weight};
use crate::mnee::{self, SpecularPrefix};
use crate::observer::{Event, TraceScattering};
use crate::path::{max_survival, survival};
use crate::ray_state::RayState;
use crate::scatterer::{EachLane, Scatterer};
use crate::vertex::Place;
use dunkelfeld_bsdf::{Bsdf, BsdfSamples, Dielectric, HenyeyGreenstein, InLanes, Lobe, Principled, ThinSheet, View};
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Bsdfs, Interface, LightChoice, LightSample, LightSamples, LightTarget, Scene, shadow_rays};
use smallvec::SmallVec;

/// Most light samples of a vertex.
const LIGHTS: usize = Scene::MAX_LIGHT_SAMPLES as usize;

/// A light sample of each lane, with the numbers for a connection and for roulette.
#[derive(Clone, Copy)]
struct Draw<F: Lanes> {
    light: LightSamples<F>,
    u_chain: F,
    u_roulette: F,
}

/// The BSDFs of a group.
struct Evaluated<F: Lanes> {
    albedo: Rgb<F>,
    /// For each light sample: BSDF times cosine [1/sr], and density of its direction by scattering [1/sr].
    direct: SmallVec<[(Rgb<F>, F); LIGHTS]>,
    /// The new direction in render space, and the rest of its sample.
    wi: V3<F>,
    sample: BsdfSamples<F>,
    /// The number for roulette.
    u_roulette: F,
}

impl Wavefront<'_> {
    /// Scattering of the paths of some rays at points with a key. `vertex` is the number of the point on each path.
    #[inline(always)]
    pub(super) fn scatter_group<F: Lanes>(
        &mut self,
        token: F::Token,
        vertex: u32,
        rays: (u32, &[u32; MAX_WIDTH], usize),
        interfaces: &[Interface],
        watch: &mut Watch<'_>,
    ) {
        let mut storage = [const { None }; MAX_WIDTH];
        let group = self.group::<F>(token, vertex, rays, (interfaces, &mut storage), watch);
        let mut draws = SmallVec::new();
        if group.lit.any() {
            self.draw_lights(&group, &mut draws);
        }
        let found = evaluate_group(&group, &draws);
        self.set_layers(&group, found.albedo);
        self.add_direct_light(&group, &draws, &found, watch);
        self.continue_paths(&group, &found, watch);
    }

    /// Draws the light samples of a group.
    #[inline(never)]
    fn draw_lights<F: Lanes>(&self, group: &Group<'_, F>, draws: &mut SmallVec<[Draw<F>; LIGHTS]>) {
        let (scene, token, choice) = (self.estimator.scene, group.token, group.choice);
        F::vectorize(
            token,
            #[inline(always)]
            || {
                for index in 0..scene.num_light_samples(choice) {
                    let numbers = group.state.sampler.numbers(dimensions::light(group.vertex, index));
                    let [u_2, u_chain] = numbers.last_two();
                    let (u_choice, u_roulette) = match choice {
                        LightChoice::Each => (u_2.constant(0.0), u_2),
                        LightChoice::One => {
                            let set = dimensions::single_light_roulette(group.vertex);
                            (u_2, group.state.sampler.numbers(set).get(0))
                        }
                    };
                    let u = numbers.first_two();
                    let light = scene.sample_lights(token, &group.receivers, choice, index, u_choice, u, group.lit);
                    draws.push(Draw { light, u_chain, u_roulette });
                }
            },
        );
    }

    /// The auxiliary layers of paths that have reached their first surface: those behind smooth glass and mirrors, if there
    /// are any. A path that ends on the glass keeps the layers of the glass.
    fn set_layers<F: Lanes>(&mut self, group: &Group<'_, F>, albedo: Rgb<F>) {
        if !group.has_layers {
            return;
        }
        let (r, g, b) = (albedo.r.to_array(), albedo.g.to_array(), albedo.b.to_array());
        let (normals, depth) = (group.frames.frame.normal.to_lanes(), group.state.path_length.to_array());
        for (lane, &path) in group.paths[..group.len].iter().enumerate() {
            let is_see_through = group.bsdfs.lane(lane).is_see_through();
            let layers = &mut self.layers[path as usize];
            let is_new = match *layers {
                Layers::Unset => true,
                Layers::SeeThrough => !is_see_through,
                Layers::Set => continue,
            };
            if is_new {
                let (albedo, normal) = match group.vertices.get(lane).map(|at| (&at.place, at.wo)) {
                    Some((Place::Medium(medium), wo)) => (medium.albedo(), wo),
                    _ => (Rgb::new(r[lane], g[lane], b[lane]), normals[lane]),
                };
                let sample = &mut self.samples[path as usize];
                *sample = Sample { hit: true, albedo, normal: normal.to_array(), depth: depth[lane], ..*sample };
            }
            *layers = if is_see_through { Layers::SeeThrough } else { Layers::Set };
        }
    }

    /// Next-event estimation: the shadow rays of light samples, with the light that they carry.
    #[inline(never)]
    fn add_direct_light<F: Lanes>(
        &mut self,
        group: &Group<'_, F>,
        draws: &[Draw<F>],
        found: &Evaluated<F>,
        watch: &mut Watch<'_>,
    ) {
        let (scene, choice) = (self.estimator.scene, group.choice);
        let needs_outcomes = watch.needs_outcomes();
        F::vectorize(
            group.token,
            #[inline(always)]
            || {
                let brightest = group.state.throughput.max_channel();
                let one = brightest.constant(1.0);
                // The roulette of gathered light, for lanes without learned statistics.
                let scale = brightest / (group.gathered * GATHERED_SHARE);
                let is_gathered = group.gathered.is_positive() & scale.is_positive();
                for (index, (draw, (scattered, pdf))) in (0..).zip(draws.iter().zip(&found.direct)) {
                    let light = &draw.light;
                    let sampled = group.lit & light.pdf.is_positive();
                    self.lane_use.light_samples[0] += u64::from(sampled.bits().count_ones());
                    self.lane_use.light_samples[1] += F::WIDTH as u64;
                    if !sampled.any() {
                        continue;
                    }
                    let unoccluded = *scattered * light.radiance;
                    let expected = unoccluded * light_weight(light.pdf, *pdf, light.is_delta);
                    let other = match choice {
                        LightChoice::Each => is_gathered.select(gathered_survival(scale * expected.max_channel()), one),
                        LightChoice::One => one,
                    };
                    let survival = match needs_outcomes {
                        true => one,
                        false => group.learned.shadow_survival(index, brightest * expected.max_channel(), other),
                    };
                    let traced = sampled & unoccluded.is_lit() & draw.u_roulette.lt(survival);
                    let origin = group.ray_origins(light.direction);
                    let end = (light.point, light.normal, light.is_finite);
                    let (direction, t_max) = shadow_rays(origin, light.direction, end);
                    self.queue_shadow_rays(
                        group,
                        Queued { index, traced, origin, direction, t_max, expected, survival },
                    );
                    if !scene.covers().is_empty() {
                        self.connect(group, draw, (index, sampled, scale.only(is_gathered)), watch);
                    }
                }
            },
        );
    }

    /// Stores the shadow rays of lanes.
    #[inline(always)]
    fn queue_shadow_rays<F: Lanes>(&mut self, group: &Group<'_, F>, q: Queued<F>) {
        let scene = self.estimator.scene;
        let Queued { index, traced, origin, direction, mut t_max, expected, survival } = q;
        let bits = traced.bits();
        let mut arriving = expected * survival.recip();
        // Where media on the way matter, the ray is traced here.
        if scene.has_solids() {
            let (origins, directions, mut ends) = (origin.to_lanes(), direction.to_lanes(), t_max.to_array());
            let (times, normals) = (group.points.time.to_array(), group.points.normal.to_lanes());
            let (mut open, mut transmittance) = ([1.0; MAX_WIDTH], [Rgb::WHITE; MAX_WIDTH]);
            for lane in (0..group.len).filter(|lane| bits >> lane & 1 == 1) {
                let ray =
                    Ray { origin: origins[lane], direction: directions[lane], t_max: ends[lane], time: times[lane] };
                let enclosing = self.enclosing_beyond(group, lane, (normals[lane], directions[lane]));
                let start = RayState { ray, enclosing };
                match start.clear_transmittance(scene, ends[lane]) {
                    Some(clear) => transmittance[lane] = clear,
                    None => {
                        (open[lane], transmittance[lane]) = start.shadow_transmittance(scene, &ray);
                        ends[lane] = 0.0;
                    }
                }
            }
            arriving = expected * (F::load(group.token, &open) / survival);
            arriving *= rgb_of_lanes(group.token, &transmittance);
            t_max = F::load(group.token, &ends);
        }
        let light = group.state.throughput * arriving;
        let queue = &mut self.shadow[index as usize];
        queue.rays.append((traced, &group.paths), [origin, direction], t_max, group.points.time);
        let [r, g, b] = &mut queue.light;
        light.r.append(traced, r);
        light.g.append(traced, g);
        light.b.append(traced, b);
    }

    /// Connections through covers to the light samples of lanes, one by one. `gathered` is the scale of the gathered
    /// roulette, or zero.
    #[inline(never)]
    fn connect<F: Lanes>(
        &mut self,
        group: &Group<'_, F>,
        draw: &Draw<F>,
        (index, sampled, gathered): (u32, F::Mask, F),
        watch: &mut Watch<'_>,
    ) {
        let light = &draw.light;
        let (directions, points, normals) =
            (light.direction.to_lanes(), light.point.to_lanes(), light.normal.to_lanes());
        let (r, g, b) = (light.radiance.r.to_array(), light.radiance.g.to_array(), light.radiance.b.to_array());
        let (pdf, u_roulette, u_chain) = (light.pdf.to_array(), draw.u_roulette.to_array(), draw.u_chain.to_array());
        let (is_finite, is_delta, sampled) = (light.is_finite.bits(), light.is_delta.bits(), sampled.bits());
        let gathered = gathered.to_array();
        let Rgb { r: red, g: green, b: blue } = group.state.throughput;
        let throughput = [red.to_array(), green.to_array(), blue.to_array()];
        let needs_outcomes = watch.needs_outcomes();
        for (lane, at) in group.vertices.iter().enumerate() {
            if sampled >> lane & 1 == 0 {
                continue;
            }
            let (number, learned) = (group.paths[lane], group.learned.lane(lane));
            let throughput = Rgb::new(throughput[0][lane], throughput[1][lane], throughput[2][lane]);
            let sample = LightSample {
                direction: directions[lane],
                target: (is_finite >> lane & 1 == 1)
                    .then(|| LightTarget { point: points[lane], normal: normals[lane] }),
                radiance: Rgb::new(r[lane], g[lane], b[lane]),
                pdf: pdf[lane],
                is_delta: is_delta >> lane & 1 == 1,
            };
            let survival = |expected: Rgb| match (learned, group.choice) {
                _ if needs_outcomes => 1.0,
                (Some(v), _) => v.connection_survival(index, throughput.max_channel() * expected.max_channel()),
                (None, LightChoice::Each) if gathered[lane] > 0.0 => {
                    gathered_survival(gathered[lane] * expected.max_channel())
                }
                _ => 1.0,
            };
            let u = [u_chain[lane], u_roulette[lane]];
            if let Some(attempt) = mnee::estimate(self.estimator.scene, at, &sample, survival, u) {
                let light = throughput * attempt.radiance;
                watch.tally.count(&attempt);
                watch.event(number, || Event::Connection { index, attempt, light });
                if attempt.arrives {
                    self.shadow[index as usize].connected.push((number, light));
                }
            }
        }
    }

    /// New directions by sampling the BSDFs, and roulette.
    #[inline(never)]
    fn continue_paths<F: Lanes>(&mut self, group: &Group<'_, F>, found: &Evaluated<F>, watch: &mut Watch<'_>) {
        let scene = self.estimator.scene;
        F::vectorize(
            group.token,
            #[inline(always)]
            || {
                let Evaluated { wi, sample, u_roulette, .. } = found;
                let (token, mut state) = (group.token, group.state);
                let one = state.bounces.constant(1.0);
                let mut most = one;
                if !group.in_medium {
                    state.bounces += one;
                    most = max_survival(state.bounces);
                }
                state.throughput *= sample.weight;
                state.eta_scale *= sample.eta * sample.eta;
                let brightest = state.throughput.max_channel();
                let survival = group.learned.path_survival(brightest, survival(brightest * state.eta_scale)).min(most);
                let alive = group.used & sample.pdf.is_positive() & u_roulette.lt(survival);
                if !alive.any() {
                    return;
                }
                state.throughput *= survival.recip();
                // The vertex at which the next scattered light is combined with light sampling.
                let delta = F::splat_word(token, Lobe::DELTA.bits());
                let is_delta = F::word_eq(sample.lobe & delta, delta);
                let origin = group.ray_origins(*wi);
                let through_covers = match scene.has_solids() {
                    true => {
                        let leaving = (origin.to_lanes(), wi.to_lanes(), F::word_to_array(sample.lobe));
                        self.enter_solids(group, alive.bits(), leaving)
                    }
                    false => 0,
                };
                state.last_pdf = is_delta.select(state.last_pdf.only(F::mask(token, through_covers)), sample.pdf);
                state.last.point = V3::select(is_delta, state.last.point, group.receivers.point);
                state.last.normal = V3::select(is_delta, state.last.normal, group.receivers.normal);
                state.last.both_sides = (is_delta & state.last.both_sides) | (!is_delta & group.receivers.both_sides);
                let is_one =
                    F::mask(token, if group.choice == LightChoice::One { u32::MAX >> (32 - F::WIDTH) } else { 0 });
                state.last_choice_is_one = (is_delta & state.last_choice_is_one) | (!is_delta & is_one);
                if watch.observer.is_some() {
                    observe_scattering(group, found, (alive.bits(), state.throughput), watch);
                }
                let rows = state.rows(token);
                let mut bits = alive.bits();
                while bits != 0 {
                    let lane = bits.trailing_zeros() as usize % MAX_WIDTH;
                    self.paths[group.paths[lane] as usize].set(&rows, lane);
                    bits &= bits - 1;
                }
                let infinity = one.constant(f32::INFINITY);
                let ray = [origin, *wi];
                self.next.append((alive, &group.paths), ray, infinity, group.points.time);
            },
        );
    }

    /// The solids and covers of paths that leave surfaces in given directions. Returns the lanes that continue the prefix of
    /// their last scattering.
    #[inline(never)]
    fn enter_solids<F: Lanes>(
        &mut self,
        group: &Group<'_, F>,
        alive: u32,
        (origins, wi, lobes): ([Vec3; MAX_WIDTH], [Vec3; MAX_WIDTH], [u32; MAX_WIDTH]),
    ) -> u32 {
        let (scene, mut continued) = (self.estimator.scene, 0);
        let (normals, times) = (group.points.normal.to_lanes(), group.points.time.to_array());
        for lane in (0..group.len).filter(|lane| alive >> lane & 1 == 1) {
            let enclosing = self.enclosing_beyond(group, lane, (normals[lane], wi[lane]));
            let among = &mut self.among_solids[group.paths[lane] as usize];
            among.enclosing = enclosing;
            if scene.covers().is_empty() {
                continue;
            }
            let (lobe, prefix) = (Lobe::from_bits(lobes[lane]), among.prefix.take());
            among.prefix = match lobe.contains(Lobe::DELTA) {
                false => {
                    let ray = Ray::new(origins[lane], wi[lane]).at_time(times[lane]);
                    Some(SpecularPrefix::new(RayState { ray, enclosing }))
                }
                true => prefix.filter(|_| !group.in_medium).and_then(|prefix| {
                    prefix.extended(scene, &group.points.lane(lane), lobe.contains(Lobe::REFLECTION))
                }),
            };
            continued |= u32::from(among.prefix.is_some()) << lane;
        }
        continued
    }
}

/// Reports the new directions of paths.
#[inline(never)]
fn observe_scattering<F: Lanes>(
    group: &Group<'_, F>,
    found: &Evaluated<F>,
    (alive, throughput): (u32, Rgb<F>),
    watch: &mut Watch<'_>,
) {
    let Evaluated { wi, sample, .. } = found;
    let color = |c: Rgb<F>, lane: usize| Rgb::new(c.r.to_array()[lane], c.g.to_array()[lane], c.b.to_array()[lane]);
    for lane in (0..group.len).filter(|lane| alive >> lane & 1 == 1) {
        watch.event(group.paths[lane], || Event::Scattered {
            scattering: TraceScattering {
                direction: wi.to_lanes()[lane].to_array(),
                pdf: sample.pdf.to_array()[lane],
                weight: color(sample.weight, lane),
                lobe: Lobe::from_bits(F::word_to_array(sample.lobe)[lane]),
            },
            throughput: color(throughput, lane),
        });
    }
}

/// The BSDFs of a group: of one kind, in lanes, or of several.
fn evaluate_group<F: Lanes>(group: &Group<'_, F>, draws: &[Draw<F>]) -> Evaluated<F> {
    macro_rules! lanes_of {
        ($kind:ident) => {
            of_kind(group, |bsdf| match bsdf {
                Bsdf::$kind(surface) => Some(surface),
                _ => None,
            })
        };
    }
    if let Some(surfaces) = lanes_of!(Principled) {
        return match surfaces.iter().any(|surface| surface.is_rich()) {
            false => evaluate_principled::<F, false>(group, &surfaces, draws),
            true => evaluate_principled::<F, true>(group, &surfaces, draws),
        };
    }
    if let Some(surfaces) = lanes_of!(Dielectric) {
        return evaluate_dielectric(group, &surfaces, draws);
    }
    if let Some(surfaces) = lanes_of!(ThinSheet) {
        return evaluate_sheet(group, &surfaces, draws);
    }
    if let Some(surfaces) = lanes_of!(Phase) {
        return evaluate_phase(group, &surfaces, draws);
    }
    evaluate_each(group, draws)
}

/// The surfaces of lanes if all are of one kind. Free lanes repeat the first.
fn of_kind<'g, F: Lanes, B>(
    group: &Group<'g, F>,
    kind: impl Fn(&'g Bsdf) -> Option<&'g B>,
) -> Option<[&'g B; MAX_WIDTH]> {
    let mut surfaces = [kind(group.bsdfs.lane(0))?; MAX_WIDTH];
    if let Bsdfs::Each(each) = &group.bsdfs {
        for (surface, bsdf) in surfaces.iter_mut().zip(&each[..group.len]) {
            *surface = kind(bsdf)?;
        }
    }
    Some(surfaces)
}

/// Principled surfaces.
#[inline(never)]
fn evaluate_principled<F: Lanes, const RICH: bool>(
    group: &Group<'_, F>,
    surfaces: &[&Principled; MAX_WIDTH],
    draws: &[Draw<F>],
) -> Evaluated<F> {
    F::vectorize(
        group.token,
        #[inline(always)]
        || {
            let surface = match group.bsdfs {
                Bsdfs::Same(_) => InLanes::<F>::splat(group.token, surfaces[0]),
                Bsdfs::Each(_) => InLanes::<F>::gather(group.token, surfaces),
            };
            evaluate(group, surface.view::<RICH>(group.wo), draws)
        },
    )
}

macro_rules! evaluate_kind {
    ($(#[$doc:meta])* $name:ident, $kind:ty) => {
        $(#[$doc])*
        #[inline(never)]
        fn $name<F: Lanes>(
            group: &Group<'_, F>,
            lanes: &[&$kind; MAX_WIDTH],
            draws: &[Draw<F>],
        ) -> Evaluated<F> {
            F::vectorize(
                group.token,
                #[inline(always)]
                || evaluate(group, InLanes::<F>::gather(group.token, lanes).view(group.wo), draws),
            )
        }
    };
}
evaluate_kind!(
    /// Boundaries of clear solids.
    evaluate_dielectric,
    Dielectric
);
evaluate_kind!(
    /// Clear sheets.
    evaluate_sheet,
    ThinSheet
);
evaluate_kind!(
    /// Points in media.
    evaluate_phase,
    HenyeyGreenstein
);

/// Surfaces of several kinds, lane by lane.
#[inline(never)]
fn evaluate_each<F: Lanes>(group: &Group<'_, F>, draws: &[Draw<F>]) -> Evaluated<F> {
    F::vectorize(
        group.token,
        #[inline(always)]
        || evaluate(group, EachLane { lanes: group.one_by_one(), len: group.len }, draws),
    )
}

/// Evaluates BSDFs for the light samples, and samples a direction.
#[inline(always)]
fn evaluate<F: Lanes, V: View<F>>(group: &Group<'_, F>, view: V, draws: &[Draw<F>]) -> Evaluated<F> {
    let at = Scatterer { frames: group.frames, view };
    let black = Rgb::splat(group.gathered.constant(0.0));
    let albedo = if group.has_layers { at.view.albedo(group.wo) } else { black };
    let mut direct = SmallVec::new();
    for draw in draws {
        let is_sampled = (group.lit & draw.light.pdf.is_positive()).any();
        direct.push(if is_sampled { at.eval(draw.light.direction) } else { (black, black.r) });
    }
    let numbers = group.state.sampler.numbers(dimensions::scatter(group.vertex));
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
