//! Scattering at surfaces and in media, in lanes: auxiliary layers, next-event estimation, a new direction and roulette.
//!
//! Each stage is a function of its own, so that only the evaluation of BSDFs is compiled for each kind of them.

use super::connect::Candidates;
use super::group::Group;
use super::rays::Queued;
use super::{Arrival, LIGHT_SAMPLES, Layers, Watch, Wavefront};
use crate::dimensions;
use crate::direct::light_weight;
use crate::learned_roulette::SHADOW;
use crate::mnee::SpecularPrefix;
use crate::observer::{Event, TraceScattering};
use crate::path::{RR_SCALE, max_survival};
use crate::ray_state::{EnclosingSolids, RayState};
use crate::scatterer::{Scatterer, Scattering};
use dunkelfeld_bsdf::{Bsdf, BsdfSamples, Dielectric, HenyeyGreenstein, InLanes, Lobe, Principled, ThinSheet, View};
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::Ray;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, Real, V3, vectorize};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Bsdfs, LightChoice, LightSamples, Scene, shadow_rays};
use smallvec::SmallVec;

/// Most light samples of a vertex.
pub(super) const LIGHTS: usize = Scene::MAX_LIGHT_SAMPLES as usize;

/// A light sample of each lane, with the numbers for a connection and for roulette.
#[derive(Clone, Copy)]
pub(super) struct Draw<F: Lanes> {
    pub(super) light: LightSamples<F>,
    pub(super) u_chain: F,
    pub(super) u_roulette: F,
}

/// Directions in render space, with the lanes that have one: those of light samples, then those of candidate chains.
pub(super) type Directions<F> = SmallVec<[Direction<F>; LIGHTS]>;
pub(super) type Direction<F> = (<F as Real>::Mask, V3<F>);

/// The BSDFs of a group.
pub(super) struct Evaluated<F: Lanes> {
    albedo: Rgb<F>,
    /// For each given direction: BSDF times cosine [1/sr], and its density by scattering [1/sr].
    pub(super) direct: SmallVec<[(Rgb<F>, F); LIGHTS]>,
    children: SmallVec<[Child<F>; 1]>,
}

/// A new direction of each lane in render space, with the rest of its sample, and the number for roulette.
struct Child<F: Lanes> {
    wi: V3<F>,
    sample: BsdfSamples<F>,
    u_roulette: F,
}

impl Wavefront<'_> {
    /// Scattering of paths at points: their key, and the numbers of their rays or arrivals. `vertex` is the number of the point
    /// on each path.
    #[inline(always)]
    pub(super) fn scatter_group<F: Lanes>(
        &mut self,
        token: F::Token,
        vertex: u32,
        points: (u32, [u32; MAX_WIDTH], usize),
        arrivals: &[Arrival],
        watch: &mut Watch<'_>,
    ) {
        let mut storage = [const { None }; MAX_WIDTH];
        let group = self.group::<F>(token, vertex, points, (arrivals, &mut storage), watch);
        let mut draws = SmallVec::new();
        if group.lit.any() {
            self.draw_lights(&group, &mut draws);
            if self.group_light.groups.is_some() {
                self.find_groups(&group);
            }
        }
        let mut directions = Directions::<F>::new();
        for draw in &draws {
            directions.push((group.lit & draw.light.pdf.is_positive(), draw.light.direction));
        }
        let mut candidates = Candidates::new();
        if !self.estimator.scene.covers().is_empty() {
            self.choose_chains(&group, &draws, &mut directions, &mut candidates);
        }
        let found = evaluate_group(&group.at, &directions, Some(&group));
        self.set_layers(&group, found.albedo);
        self.add_direct_light(&group, &draws, &found);
        self.queue_connections(&group, &draws, &candidates, &found);
        for (number, child) in (0..1 << group.splits).zip(&found.children) {
            self.continue_paths(&group, (number, child), watch);
        }
    }

    /// Draws the light samples of a group.
    #[inline(never)]
    fn draw_lights<F: Lanes>(&self, group: &Group<'_, F>, draws: &mut SmallVec<[Draw<F>; LIGHTS]>) {
        let (scene, token, choice) = (self.estimator.scene, group.at.token, group.choice);
        vectorize!(F, token, {
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
        });
    }

    /// The auxiliary layers of paths that have reached their first surface: those behind smooth glass and mirrors, if there
    /// are any. A path that ends on the glass keeps the layers of the glass.
    fn set_layers<F: Lanes>(&mut self, group: &Group<'_, F>, albedo: Rgb<F>) {
        if !group.has_layers {
            return;
        }
        let (albedo, from) = (albedo.to_lanes(), group.from.to_lanes());
        let (normals, depth) = (group.at.frames.frame.normal.to_lanes(), group.state.path_length.to_array());
        for (lane, &path) in group.paths[..group.at.len].iter().enumerate() {
            let is_see_through = group.at.bsdfs.lane(lane).is_see_through();
            let (owner, layers) = (self.owner(path) as usize, &mut self.layers[path as usize]);
            let is_new = match *layers {
                Layers::Unset => true,
                Layers::SeeThrough => !is_see_through,
                Layers::Set => continue,
            };
            if is_new {
                let (albedo, normal) = match group.medium_albedo {
                    Some(albedo) => (albedo, -from[lane]),
                    None => (albedo[lane], normals[lane]),
                };
                let sample = &mut self.samples[owner];
                *sample = Sample { hit: true, albedo, normal: normal.to_array(), depth: depth[lane], ..*sample };
            }
            *layers = if is_see_through { Layers::SeeThrough } else { Layers::Set };
        }
    }

    /// Next-event estimation: the shadow rays of light samples, with the light that they carry.
    #[inline(never)]
    fn add_direct_light<F: Lanes>(&mut self, group: &Group<'_, F>, draws: &[Draw<F>], found: &Evaluated<F>) {
        vectorize!(F, group.at.token, {
            for (index, (draw, (scattered, pdf))) in (0..).zip(draws.iter().zip(&found.direct)) {
                let light = &draw.light;
                let sampled = group.lit & light.pdf.is_positive();
                self.lane_use.count::<F>(LIGHT_SAMPLES, sampled.bits().count_ones() as usize);
                if !sampled.any() {
                    continue;
                }
                let unoccluded = *scattered * light.radiance;
                let expected = unoccluded * light_weight(light.pdf, *pdf, light.is_delta);
                let survival = group.ray_survival(SHADOW, index, expected);
                let traced = sampled & unoccluded.is_lit() & draw.u_roulette.lt(survival);
                let origin = group.ray_origins(light.direction);
                let end = (light.point, light.normal, light.is_finite);
                let (direction, t_max) = shadow_rays(origin, light.direction, end);
                let light = group.state.throughput * (expected * survival.recip());
                let mut rays = Queued { lanes: traced, origin, direction, t_max, light };
                if self.estimator.scene.has_solids() {
                    let enclosing = self.enclosing_beyond(group, direction);
                    self.dim_by_solids(&mut rays, group.points.time, &enclosing);
                }
                let queue = &mut self.shadow[index as usize][0];
                queue.append(&rays, group.points.time, &group.paths);
                if let Some(of_lanes) = self.group_light.sampled.get(index as usize) {
                    queue.append_groups::<F>(traced, of_lanes);
                }
            }
        });
    }

    /// Multiplies the light of shadow rays by the transmittance of the solids around their origins. A ray in several solids
    /// is traced here and loses its length.
    #[inline(always)]
    pub(super) fn dim_by_solids<F: Lanes>(&self, q: &mut Queued<F>, time: F, enclosing: &[EnclosingSolids; MAX_WIDTH]) {
        let mut is_clear = true;
        for lane in q.lanes.lanes() {
            is_clear &= matches!(enclosing[lane], EnclosingSolids::Last(None));
        }
        if is_clear {
            return;
        }
        let (origins, directions) = (q.origin.to_lanes(), q.direction.to_lanes());
        let (mut ends, times) = (q.t_max.to_array(), time.to_array());
        let mut transmittance = EnclosingSolids::transmittances(enclosing, self.estimator.scene, q.t_max).to_lanes();
        for lane in q.lanes.lanes() {
            if let EnclosingSolids::All(interior) = &enclosing[lane] {
                let ray = Ray::with_end(origins[lane], directions[lane], ends[lane]).at_time(times[lane]);
                transmittance[lane] = self.estimator.scene.shadow_transmittance(&ray, interior);
                ends[lane] = 0.0;
            }
        }
        q.light *= Rgb::from_lanes(time.token(), &transmittance);
        q.t_max = F::load(time.token(), &ends);
    }

    /// The first or a further child of each path: a new direction, and roulette.
    #[inline(never)]
    fn continue_paths<F: Lanes>(
        &mut self,
        group: &Group<'_, F>,
        (number, child): (u32, &Child<F>),
        watch: &mut Watch<'_>,
    ) {
        let scene = self.estimator.scene;
        vectorize!(F, group.at.token, {
            let Child { wi, sample, u_roulette } = child;
            let (token, mut state) = (group.at.token, group.state);
            let one = state.bounces.constant(1.0);
            let mut most = one;
            if !group.in_medium {
                state.bounces += one;
                most = max_survival(state.bounces);
            }
            let mut used = group.used;
            if group.splits > 0 {
                let children = group.num_children();
                used = used & children.gt(one * number as f32);
                state.sampler = group.sampler(number);
                state.children *= children;
                state.throughput *= children.recip();
            }
            state.throughput *= sample.weight;
            state.eta_scale *= sample.eta * sample.eta;
            // Roulette does not take a split for a loss.
            let brightest = state.throughput.max_channel() * state.children;
            let by_throughput = brightest * state.eta_scale * RR_SCALE;
            let survival = group.learned.path_survival(brightest, by_throughput).min(most);
            if self.only_first_light {
                used = used & !group.is_first_light;
            }
            let alive = used & sample.pdf.is_positive() & u_roulette.lt(survival);
            if !alive.any() {
                return;
            }
            state.throughput *= survival.recip();
            // The rest is a path of its own, so that the path of the sample keeps the first light.
            let (mut paths, separate) = (group.paths, alive & group.is_first_light);
            if separate.any() && !watch.needs_outcomes() {
                state.radiance = Rgb::select(separate, Rgb::splat(one.constant(0.0)), state.radiance);
                self.split::<F>(number, &mut paths, separate, watch);
            }
            // The vertex at which the next scattered light is combined with light sampling.
            let delta = F::splat_word(token, Lobe::DELTA.bits());
            let is_delta = F::word_eq(sample.lobe & delta, delta);
            let origin = group.ray_origins(*wi);
            let through_covers = match scene.has_solids() {
                true => {
                    let enclosing = self.enclosing_beyond(group, *wi);
                    self.enter_solids(group, (alive, &paths), (origin, *wi, sample.lobe), &enclosing)
                }
                false => F::mask(token, 0),
            };
            state.last_pdf = is_delta.select(state.last_pdf.only(through_covers), sample.pdf);
            state.last.point = V3::select(is_delta, state.last.point, group.receivers.point);
            state.last.normal = V3::select(is_delta, state.last.normal, group.receivers.normal);
            state.last.both_sides = (is_delta & state.last.both_sides) | (!is_delta & group.receivers.both_sides);
            let is_one = F::mask(token, if group.choice == LightChoice::One { u32::MAX >> (32 - F::WIDTH) } else { 0 });
            state.last_choice_is_one = (is_delta & state.last_choice_is_one) | (!is_delta & is_one);
            if watch.observer.is_some() {
                observe_scattering(child, (alive, &paths), state.throughput, watch);
            }
            state.store(
                alive,
                #[inline(always)]
                |lane, state| self.paths[paths[lane] as usize] = state,
            );
            let infinity = one.constant(f32::INFINITY);
            let ray = [origin, *wi];
            self.next.append((alive, &paths), ray, infinity, group.points.time);
        });
    }

    /// Replaces the paths of some lanes by new ones behind them. The first of them goes on with the auxiliary layers.
    #[inline(never)]
    fn split<F: Lanes>(&mut self, number: u32, paths: &mut [u32; MAX_WIDTH], lanes: F::Mask, watch: &mut Watch<'_>) {
        for lane in lanes.lanes() {
            let parent = paths[lane];
            paths[lane] = self.paths.len() as u32;
            self.paths.push(self.paths[parent as usize]);
            self.group_light.resize(self.paths.len());
            self.owners.push(self.owner(parent));
            watch.event(paths[lane], || Event::Split { parent });
            self.layers.push(if number == 0 { self.layers[parent as usize] } else { Layers::Set });
            if let Some(among) = self.among_solids.get(parent as usize) {
                self.among_solids.push(*among);
            }
        }
    }

    /// The solids and covers of paths that leave surfaces in given directions. Returns the lanes that continue the prefix of
    /// their last scattering.
    #[inline(never)]
    fn enter_solids<F: Lanes>(
        &mut self,
        group: &Group<'_, F>,
        (alive, paths): (F::Mask, &[u32; MAX_WIDTH]),
        (origin, wi, lobe): (V3<F>, V3<F>, F::Word),
        enclosing: &[EnclosingSolids; MAX_WIDTH],
    ) -> F::Mask {
        vectorize!(F, group.at.token, {
            let (scene, mut continued) = (self.estimator.scene, 0);
            let (origins, wi, times) = (origin.to_lanes(), wi.to_lanes(), group.points.time.to_array());
            let (parts, lobes) = (F::word_to_array(group.points.part), F::word_to_array(lobe));
            for lane in alive.lanes() {
                let enclosing = enclosing[lane];
                let among = &mut self.among_solids[paths[lane] as usize];
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
                    true => prefix
                        .filter(|_| !group.in_medium)
                        .and_then(|prefix| prefix.extended(scene, parts[lane], lobe.contains(Lobe::REFLECTION))),
                };
                continued |= u32::from(among.prefix.is_some()) << lane;
            }
            F::mask(group.at.token, continued)
        })
    }
}

/// Reports the new directions of paths.
#[inline(never)]
fn observe_scattering<F: Lanes>(
    Child { wi, sample, .. }: &Child<F>,
    (alive, paths): (F::Mask, &[u32; MAX_WIDTH]),
    throughput: Rgb<F>,
    watch: &mut Watch<'_>,
) {
    for lane in alive.lanes() {
        let scattering = TraceScattering {
            direction: wi.to_lanes()[lane].to_array(),
            pdf: sample.pdf.to_array()[lane],
            weight: sample.weight.to_lanes()[lane],
            lobe: Lobe::from_bits(F::word_to_array(sample.lobe)[lane]),
        };
        watch.event(paths[lane], || Event::Scattered { scattering, throughput: throughput.to_lanes()[lane] });
    }
}

/// The BSDFs of a group: of one kind, in lanes, or of several.
pub(super) fn evaluate_group<F: Lanes>(
    at: &Scattering<'_, F>,
    directions: &[Direction<F>],
    group: Option<&Group<'_, F>>,
) -> Evaluated<F> {
    macro_rules! lanes_of {
        ($kind:ident) => {
            of_kind(at, |bsdf| match bsdf {
                Bsdf::$kind(surface) => Some(surface),
                _ => None,
            })
        };
    }
    if let Some(surfaces) = lanes_of!(Principled) {
        return match surfaces.iter().any(|surface| surface.is_rich()) {
            false => evaluate_plain(at, &surfaces, directions, group),
            true => evaluate_rich(at, &surfaces, directions, group),
        };
    }
    if let Some(surfaces) = lanes_of!(Dielectric) {
        return evaluate_dielectric(at, &surfaces, directions, group);
    }
    if let Some(surfaces) = lanes_of!(ThinSheet) {
        return evaluate_sheet(at, &surfaces, directions, group);
    }
    if let Some(surfaces) = lanes_of!(Phase) {
        return evaluate_phase(at, &surfaces, directions, group);
    }
    evaluate_each(at, directions, group)
}

/// The surfaces of lanes if all are of one kind. Free lanes repeat the first.
fn of_kind<'g, F: Lanes, B>(
    at: &Scattering<'g, F>,
    kind: impl Fn(&'g Bsdf) -> Option<&'g B>,
) -> Option<[&'g B; MAX_WIDTH]> {
    let mut surfaces = [kind(at.bsdfs.lane(0))?; MAX_WIDTH];
    if let Bsdfs::Each(each) = &at.bsdfs {
        for (surface, bsdf) in surfaces.iter_mut().zip(&each[..at.len]) {
            *surface = kind(bsdf)?;
        }
    }
    Some(surfaces)
}

macro_rules! evaluate_kind {
    ($name:ident, $kind:ty $(, $rich:literal)?) => {
        #[inline(never)]
        fn $name<F: Lanes>(
            at: &Scattering<'_, F>,
            lanes: &[&$kind; MAX_WIDTH],
            directions: &[Direction<F>],
            group: Option<&Group<'_, F>>,
        ) -> Evaluated<F> {
            vectorize!(F, at.token, {
                    let surface = match at.bsdfs {
                        Bsdfs::Same(_) => InLanes::<F>::splat(at.token, lanes[0]),
                        Bsdfs::Each(_) => InLanes::<F>::gather(at.token, lanes),
                    };
                    evaluate(at, surface.view$(::<$rich>)?(at.wo), directions, group)
            })
        }
    };
}
// Principled surfaces without rare lobes, and all of them.
evaluate_kind!(evaluate_plain, Principled, false);
evaluate_kind!(evaluate_rich, Principled, true);
// Boundaries of clear solids.
evaluate_kind!(evaluate_dielectric, Dielectric);
evaluate_kind!(evaluate_sheet, ThinSheet);
// Points in media.
evaluate_kind!(evaluate_phase, HenyeyGreenstein);

/// Surfaces of several kinds, lane by lane.
#[inline(never)]
fn evaluate_each<F: Lanes>(
    at: &Scattering<'_, F>,
    directions: &[Direction<F>],
    group: Option<&Group<'_, F>>,
) -> Evaluated<F> {
    vectorize!(F, at.token, evaluate(at, *at, directions, group))
}

/// Evaluates BSDFs for some directions. If the paths of a group scatter, also the albedo and new directions.
#[inline(always)]
fn evaluate<F: Lanes, V: View<F>>(
    at: &Scattering<'_, F>,
    view: V,
    directions: &[Direction<F>],
    group: Option<&Group<'_, F>>,
) -> Evaluated<F> {
    let Scattering { frames, wo, .. } = *at;
    let at = Scatterer { frames, view };
    let zero = wo.x.constant(0.0);
    let black = Rgb::splat(zero);
    let mut direct = SmallVec::new();
    for (lanes, direction) in directions {
        direct.push(if lanes.any() { at.eval(*direction) } else { (black, zero) });
    }
    let Some(group) = group else {
        return Evaluated { albedo: black, direct, children: SmallVec::new() };
    };
    let albedo = if group.has_layers { at.view.albedo(wo) } else { black };
    let mut children = SmallVec::new();
    for child in 0..1 << group.splits {
        let numbers = group.sampler(child).numbers(dimensions::scatter(group.vertex));
        let ([u_x, u_y], [u_lobe, u_roulette]) = (numbers.first_two(), numbers.last_two());
        let (wi, sample) = at.sample([u_x, u_y, u_lobe]);
        children.push(Child { wi, sample, u_roulette });
    }
    Evaluated { albedo, direct, children }
}
