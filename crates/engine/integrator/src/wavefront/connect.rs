//! Connections through covers: next-event estimation where clear sheets lie before the lights (`mnee`).

use super::attempts::{Attempts, Connection, Entry, in_lanes};
use super::group::Group;
use super::rays::Queued;
use super::scatter::{Directions, Draw, Evaluated, LIGHTS, evaluate_group};
use super::{CONNECTIONS, Watch, Wavefront};
use crate::direct::power_heuristic;
use crate::estimator::Estimator;
use crate::learned_roulette::CONNECTION;
use crate::mnee::{
    Connections, Endpoints, MAX_TRAVERSALS, Search, SearchRecord, Solver, TracedChains, Traversal, trace_chains,
};
use crate::observer::{Event, TraceConnection};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3, vectorize};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{CandidateChains, LightSamples, Targets, shadow_rays};
use smallvec::SmallVec;

/// A candidate chain to each light sample; empty without covers.
pub(super) type Candidates<F> = SmallVec<[CandidateChains<F>; LIGHTS]>;

impl Wavefront<'_> {
    /// Chooses a chain to each light sample. Its first directions are appended to those that are evaluated.
    #[inline(never)]
    pub(super) fn choose_chains<F: Lanes>(
        &self,
        group: &Group<'_, F>,
        draws: &[Draw<F>],
        directions: &mut Directions<F>,
        candidates: &mut Candidates<F>,
    ) {
        vectorize!(F, group.at.token, {
            for Draw { light, u_chain, .. } in draws {
                let lanes = group.lit & light.pdf.is_positive() & !light.is_delta;
                let (ends, scene) = (&self.endpoints(group, light), self.estimator.scene);
                let solver = Solver { scene, set: self.set, token: group.at.token, ends };
                let chosen = solver.choose(lanes, *u_chain);
                directions.push((chosen.is_some, chosen.direction));
                candidates.push(chosen);
            }
        });
    }

    /// Queues the chains that survive roulette.
    #[inline(never)]
    pub(super) fn queue_connections<F: Lanes>(
        &mut self,
        group: &Group<'_, F>,
        draws: &[Draw<F>],
        candidates: &[CandidateChains<F>],
        found: &Evaluated<F>,
    ) {
        vectorize!(F, group.at.token, {
            let expected = candidates.iter().zip(&found.direct[draws.len()..]);
            for (index, (draw, (chosen, (scattered, pdf)))) in (0..).zip(draws.iter().zip(expected)) {
                if !chosen.is_some.any() {
                    continue;
                }
                // The contribution of a chain in the plate without losses at its faces.
                let density = draw.light.pdf * chosen.probability;
                let expected = *scattered * draw.light.radiance * (power_heuristic(density, *pdf) / density);
                let survival = group.ray_survival(CONNECTION, index, expected);
                let lanes = chosen.is_some & draw.u_roulette.lt(survival);
                if lanes.any() {
                    let ends = self.endpoints(group, &draw.light);
                    let light = group.state.throughput * draw.light.radiance * survival.recip();
                    let CandidateChains { chain, probability, .. } = *chosen;
                    let (pdf, at) = (draw.light.pdf, group.at);
                    let entry = Entry { ends, chain, probability, light, pdf, at };
                    let groups = self.group_light.sampled.get(index as usize);
                    self.attempts.append(lanes, (chosen, index), &entry, (&group.paths, groups));
                }
            }
        });
    }

    /// Searches the queued chains ray by ray, and stores the shadow rays behind the covers.
    #[inline(always)]
    pub(super) fn connect<F: Lanes>(&mut self, token: F::Token, watch: &mut Watch<'_>) {
        let mut queue = std::mem::take(&mut self.attempts);
        let mut searches = std::mem::take(&mut queue.searches);
        watch.tally.attempts += searches.len() as u64;
        let (mut order, mut open) = (queue.order(), Vec::new());
        let mut ray = 0;
        while !order.is_empty() {
            ray += 1;
            watch.tally.rays += order.len() as u64;
            for numbers in order.chunks(MAX_TRAVERSALS * F::WIDTH) {
                self.advance::<F>(token, &queue, (numbers, ray), (&mut searches, &mut open), watch);
            }
            std::mem::swap(&mut order, &mut open);
            open.clear();
        }
        queue.searches = searches;
        queue.clear();
        self.attempts = queue;
    }

    /// Traces the next rays of some searches. Those that go on are appended to `open`.
    #[inline(never)]
    fn advance<F: Lanes>(
        &mut self,
        token: F::Token,
        queue: &Attempts,
        (numbers, ray): (&[u32], u32),
        (searches, open): (&mut [SearchRecord], &mut Vec<u32>),
        watch: &mut Watch<'_>,
    ) {
        let Wavefront { estimator: Estimator { scene, .. }, set, .. } = *self;
        let (mut loaded, mut traversals) = (Vec::with_capacity(MAX_TRAVERSALS), Vec::with_capacity(MAX_TRAVERSALS));
        vectorize!(F, token, {
            for numbers in numbers.chunks(F::WIDTH) {
                let places = in_lanes(numbers);
                let search = V3::<F>::load_records(
                    token,
                    #[inline(always)]
                    |lane| &searches[places[lane] as usize],
                );
                loaded.push((queue.load::<F>(token, numbers), Search::from_rows(search)));
            }
        });
        vectorize!(F, token, {
            for (entry, search) in &loaded {
                let solver = Solver { scene, set, token, ends: &entry.ends };
                let lanes = F::mask(token, u32::MAX >> (32 - entry.at.len));
                traversals.push(Traversal::new(solver, (lanes, &entry.chain), search));
            }
        });
        trace_chains(&mut traversals, &mut self.segments);
        vectorize!(F, token, {
            for (numbers, (traversal, (entry, _))) in numbers.chunks(F::WIDTH).zip(traversals.iter_mut().zip(&loaded)) {
                self.lane_use.count::<F>(CONNECTIONS, numbers.len());
                let (connections, is_open) = traversal.advance(ray);
                let (arriving, mis_weight) =
                    self.send_shadow_rays(queue, (numbers, entry), (&traversal.traced, &connections), watch);
                if watch.observer.is_some() {
                    let lanes = [traversal.lanes & !is_open, connections.has_converged, arriving];
                    self.report(queue, (numbers, entry, ray), (lanes, mis_weight), watch);
                }
                V3::store_records(
                    traversal.search.to_rows(),
                    is_open,
                    #[inline(always)]
                    |lane, search| {
                        searches[numbers[lane] as usize] = search;
                        open.push(numbers[lane]);
                    },
                );
            }
        });
    }

    /// Stores the shadow rays of chains that have arrived. Returns the lanes that have one, and their weights by the power
    /// heuristic.
    #[inline(always)]
    fn send_shadow_rays<F: Lanes>(
        &mut self,
        queue: &Attempts,
        (numbers, entry): (&[u32], &Entry<'_, F>),
        (traced, connections): (&TracedChains<F>, &Connections<F>),
        watch: &mut Watch<'_>,
    ) -> (F::Mask, F) {
        let Entry { ends, light, pdf: light_pdf, at, .. } = entry;
        if !connections.has_converged.any() {
            return (connections.has_converged, light_pdf.constant(0.0));
        }
        watch.tally.converged += u64::from(connections.has_converged.bits().count_ones());
        let direction = [(connections.has_converged, connections.direction)];
        let (scattered, pdf) = evaluate_group(at, &direction, None).direct[0];
        let unoccluded = scattered * *light * traced.weight;
        let arriving = connections.has_converged & unoccluded.is_lit();
        // The density of the first direction.
        let density = *light_pdf * entry.probability / connections.solid_angle_ratio;
        let mis_weight = power_heuristic(density, pdf * traced.probability);
        let end = (ends.targets.point, ends.light_normal, ends.targets.is_finite);
        let (direction, t_max) = shadow_rays(traced.origin, traced.direction, end);
        let (origin, light) = (traced.origin, unoccluded * (mis_weight / density));
        let mut rays = Queued { lanes: arriving, origin, direction, t_max, light };
        self.dim_by_solids(&mut rays, ends.time, &traced.enclosing);
        let (mut paths, mut lights, mut groups) = ([0; MAX_WIDTH], [0; MAX_WIDTH], [0; MAX_WIDTH]);
        for lane in arriving.lanes() {
            let Connection { path, light, group, .. } = *queue.connection(numbers[lane]);
            (paths[lane], lights[lane], groups[lane]) = (path, light, group);
        }
        let mut left = arriving;
        // The rays of each light sample, which is one in general.
        while let Some(first) = left.lanes().next() {
            let (index, of_lanes) = (lights[first], F::load_word(at.token, &lights));
            rays.lanes = left & F::word_eq(of_lanes, F::splat_word(at.token, index));
            let shadow = &mut self.shadow[index as usize][1];
            shadow.append(&rays, ends.time, &paths);
            if self.group_light.groups.is_some() {
                shadow.append_groups::<F>(rays.lanes, &groups);
            }
            left = left & !rays.lanes;
        }
        (arriving, mis_weight.only(arriving))
    }

    /// Reports attempts that have ended: with the shadow rays of those that have one, the others now.
    #[inline(never)]
    fn report<F: Lanes>(
        &mut self,
        queue: &Attempts,
        (numbers, entry, rays): (&[u32], &Entry<'_, F>, u32),
        ([ended, converged, arriving], mis_weight): ([F::Mask; 3], F),
        watch: &mut Watch<'_>,
    ) {
        let (probability, mis_weight) = (entry.probability.to_array(), mis_weight.to_array());
        let [converged, arriving] = [converged.bits(), arriving.bits()];
        for lane in ended.lanes() {
            let (cover, chain) = entry.chain[lane];
            let connection = TraceConnection {
                cover,
                chain,
                probability: probability[lane],
                rays,
                has_converged: converged >> lane & 1 == 1,
                mis_weight: mis_weight[lane],
                contribution: Rgb::BLACK,
            };
            let Connection { light: index, path, .. } = *queue.connection(numbers[lane]);
            if arriving >> lane & 1 == 1 {
                self.shadow[index as usize][1].connections.push(connection);
            } else {
                watch.event(path, || Event::Connection { index, connection });
            }
        }
    }

    /// The receivers of a group and the ends of light samples.
    #[inline(always)]
    fn endpoints<F: Lanes>(&self, group: &Group<'_, F>, light: &LightSamples<F>) -> Endpoints<F> {
        Endpoints {
            receivers: group.receivers,
            origin: group.ray_origins(light.direction),
            time: group.points.time,
            enclosing: self.enclosing_beyond(group, light.direction),
            targets: Targets { point: light.point, direction: light.direction, is_finite: light.is_finite },
            light_normal: light.normal,
        }
    }
}
