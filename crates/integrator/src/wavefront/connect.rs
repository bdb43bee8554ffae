//! Connections through covers: next-event estimation where clear sheets lie before the lights (`mnee`).

use super::group::Group;
use super::scatter::{Directions, Draw, Evaluated, LIGHTS, Queued, evaluate_group};
use super::{Watch, Wavefront};
use crate::direct::power_heuristic;
use crate::mnee::{Attempt, Connections, Endpoints, Solver};
use crate::observer::Event;
use dunkelfeld_lanes::{Lanes, Mask};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{CandidateChains, LightSamples, Targets, shadow_rays};
use smallvec::SmallVec;

/// A candidate chain to each light sample; empty without covers.
pub(super) type Candidates<F> = SmallVec<[CandidateChains<F>; LIGHTS]>;

impl Wavefront<'_> {
    /// Chooses a chain to each light sample. Its first directions are appended to those that are evaluated.
    #[inline(always)]
    pub(super) fn choose_chains<F: Lanes>(
        &self,
        group: &Group<'_, F>,
        draws: &[Draw<F>],
        directions: &mut Directions<F>,
    ) -> Candidates<F> {
        let mut candidates = SmallVec::new();
        if !self.estimator.scene.covers().is_empty() {
            self.choose_each(group, draws, directions, &mut candidates);
        }
        candidates
    }

    #[inline(never)]
    fn choose_each<F: Lanes>(
        &self,
        group: &Group<'_, F>,
        draws: &[Draw<F>],
        directions: &mut Directions<F>,
        candidates: &mut Candidates<F>,
    ) {
        F::vectorize(
            group.token,
            #[inline(always)]
            || {
                for Draw { light, u_chain, .. } in draws {
                    let lanes = group.lit & light.pdf.is_positive() & !light.is_delta;
                    let ends = self.endpoints(group, light);
                    let chosen = self.solver(group, &ends).choose(lanes, *u_chain);
                    directions.push((chosen.is_some, chosen.direction));
                    candidates.push(chosen);
                }
            },
        );
    }

    /// Searches the chains that survive roulette, and stores the shadow rays behind the covers.
    #[inline(never)]
    pub(super) fn connect<F: Lanes>(
        &mut self,
        group: &Group<'_, F>,
        draws: &[Draw<F>],
        candidates: &[CandidateChains<F>],
        found: &Evaluated<F>,
        watch: &mut Watch<'_>,
    ) {
        if candidates.iter().all(|chosen| !chosen.is_some.any()) {
            return;
        }
        let mut directions = Directions::<F>::new();
        let mut solved: SmallVec<[(F::Mask, F, Connections<F>); LIGHTS]> = SmallVec::new();
        F::vectorize(
            group.token,
            #[inline(always)]
            || {
                let expected = candidates.iter().zip(&found.direct[draws.len()..]);
                for (index, (draw, (chosen, scattered))) in (0..).zip(draws.iter().zip(expected)) {
                    let survival = self.connection_survival(group, (index, draw), (chosen, scattered), watch);
                    let lanes = chosen.is_some & draw.u_roulette.lt(survival);
                    self.lane_use.connections[0] += u64::from(lanes.bits().count_ones());
                    self.lane_use.connections[1] += F::WIDTH as u64;
                    let ends = self.endpoints(group, &draw.light);
                    let connections = self.solver(group, &ends).solve(chosen, lanes);
                    directions.push((connections.has_converged, connections.direction));
                    solved.push((lanes, survival, connections));
                }
            },
        );
        let found = evaluate_group(group, &directions, false);
        F::vectorize(
            group.token,
            #[inline(always)]
            || {
                for (index, draw) in (0..).zip(draws) {
                    let (chosen, at) = (&candidates[index as usize], found.direct[index as usize]);
                    self.add_connections(group, (index, draw, chosen), &solved[index as usize], at, watch);
                }
            },
        );
    }

    /// The probabilities with which chains are searched. They depend on the contribution of a chain in the plate without
    /// losses at its faces.
    #[inline(always)]
    fn connection_survival<F: Lanes>(
        &self,
        group: &Group<'_, F>,
        (index, draw): (u32, &Draw<F>),
        (chosen, (scattered, pdf)): (&CandidateChains<F>, &(Rgb<F>, F)),
        watch: &Watch<'_>,
    ) -> F {
        if watch.needs_outcomes() {
            return pdf.constant(1.0);
        }
        let density = draw.light.pdf * chosen.probability;
        let expected = *scattered * draw.light.radiance * (power_heuristic(density, *pdf) / density);
        let brightest = group.state.throughput.max_channel() * expected.max_channel();
        group.learned.connection_survival(index, brightest, group.gathered_survival(expected))
    }

    /// The contributions of searched chains.
    #[inline(always)]
    fn add_connections<F: Lanes>(
        &mut self,
        group: &Group<'_, F>,
        (index, draw, chosen): (u32, &Draw<F>, &CandidateChains<F>),
        (lanes, survival, connections): &(F::Mask, F, Connections<F>),
        (scattered, pdf): (Rgb<F>, F),
        watch: &mut Watch<'_>,
    ) {
        let (light, traced) = (&draw.light, &connections.traced);
        let unoccluded = scattered * light.radiance * traced.weight;
        let arriving = connections.has_converged & unoccluded.is_lit();
        // The density of the first direction.
        let density = light.pdf * chosen.probability / connections.solid_angle_ratio;
        let mis_weight = power_heuristic(density, pdf * traced.probability);
        let radiance = group.state.throughput * (unoccluded * (mis_weight / (density * *survival)));
        let end = (light.point, light.normal, light.is_finite);
        let (direction, t_max) = shadow_rays(traced.origin, traced.direction, end);
        let rays = Queued { lanes: arriving, origin: traced.origin, direction, t_max, light: radiance };
        self.queue_shadow_rays(group, (index, 1), rays, Some(&traced.enclosing));
        let (rays, converged) = (connections.rays.to_array(), connections.has_converged.bits());
        watch.tally.attempts += u64::from(lanes.bits().count_ones());
        watch.tally.converged += u64::from(converged.count_ones());
        watch.tally.rays += rays.iter().map(|rays| *rays as u64).sum::<u64>();
        if watch.observer.is_none() {
            return;
        }
        let (probability, mis_weight) = (chosen.probability.to_array(), mis_weight.to_array());
        lanes.each(|lane| {
            let arrives = arriving.bits() >> lane & 1 == 1;
            let attempt = Attempt {
                stack: chosen.stack[lane],
                chain: chosen.chain[lane],
                probability: probability[lane],
                rays: rays[lane] as u32,
                has_converged: converged >> lane & 1 == 1,
                mis_weight: if arrives { mis_weight[lane] } else { 0.0 },
            };
            match arrives {
                true => self.shadow[index as usize][1].attempts.push(attempt),
                false => {
                    let light = Rgb::BLACK;
                    watch.event(group.paths[lane], || Event::Connection { index, attempt, light });
                }
            }
        });
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
            straight: light.direction,
        }
    }

    #[inline(always)]
    fn solver<'s, F: Lanes>(&'s self, group: &Group<'_, F>, ends: &'s Endpoints<F>) -> Solver<'s, F> {
        Solver { scene: self.estimator.scene, set: self.set, token: group.token, ends }
    }
}
