//! Connections through covers: next-event estimation where clear sheets lie before the lights (`mnee`).

use super::attempts::{Attempts, Entry};
use super::group::Group;
use super::rays::Queued;
use super::scatter::{Directions, Draw, Evaluated, LIGHTS, evaluate_group};
use super::{Watch, Wavefront};
use crate::direct::power_heuristic;
use crate::mnee::{Attempt, Endpoints, Solver};
use crate::observer::Event;
use dunkelfeld_geometry::Ray;
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
                    let chosen = self.solver(group.token, &ends).choose(lanes, *u_chain);
                    directions.push((chosen.is_some, chosen.direction));
                    candidates.push(chosen);
                }
            },
        );
    }

    /// Queues the chains that survive roulette.
    #[inline(never)]
    pub(super) fn queue_connections<F: Lanes>(
        &mut self,
        group: &Group<'_, F>,
        draws: &[Draw<F>],
        candidates: &[CandidateChains<F>],
        found: &Evaluated<F>,
        watch: &Watch<'_>,
    ) {
        F::vectorize(
            group.token,
            #[inline(always)]
            || {
                let expected = candidates.iter().zip(&found.direct[draws.len()..]);
                for (index, (draw, (chosen, scattered))) in (0..).zip(draws.iter().zip(expected)) {
                    if !chosen.is_some.any() {
                        continue;
                    }
                    let survival = self.connection_survival(group, (index, draw), (chosen, scattered), watch);
                    let lanes = chosen.is_some & draw.u_roulette.lt(survival);
                    if lanes.any() {
                        let ends = self.endpoints(group, &draw.light);
                        let light = group.state.throughput * draw.light.radiance * survival.recip();
                        let columns = Entry { ends, light, pdf: draw.light.pdf, at: group.scattering() };
                        self.attempts.append(lanes, index, (chosen, &columns), &group.paths);
                    }
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

    /// Searches the queued chains, and stores the shadow rays behind the covers.
    #[inline(always)]
    pub(super) fn connect<F: Lanes>(&mut self, token: F::Token, watch: &mut Watch<'_>) {
        if self.attempts.paths.is_empty() {
            return;
        }
        let mut attempts = std::mem::take(&mut self.attempts);
        attempts.pad(F::WIDTH);
        for first in (0..attempts.paths.len()).step_by(F::WIDTH) {
            self.connect_lanes::<F>(token, &attempts, first, watch);
        }
        attempts.clear();
        self.attempts = attempts;
    }

    #[inline(never)]
    fn connect_lanes<F: Lanes>(&mut self, token: F::Token, queue: &Attempts, first: usize, watch: &mut Watch<'_>) {
        F::vectorize(
            token,
            #[inline(always)]
            || {
                let len = F::WIDTH.min(queue.paths.len() - first);
                let lanes = F::mask(token, u32::MAX >> (32 - len));
                self.lane_use.connections[0] += len as u64;
                self.lane_use.connections[1] += F::WIDTH as u64;
                let (Entry { ends, light, pdf: light_pdf, at }, chains) = queue.load::<F>(token, first, lanes);
                let connections = self.solver(token, &ends).solve(&chains, lanes);
                let direction = [(connections.has_converged, connections.direction)];
                let (scattered, pdf) = evaluate_group(&at, &direction, None).direct[0];
                let traced = &connections.traced;
                let unoccluded = scattered * light * traced.weight;
                let arriving = connections.has_converged & unoccluded.is_lit();
                // The density of the first direction.
                let density = light_pdf * chains.probability / connections.solid_angle_ratio;
                let mis_weight = power_heuristic(density, pdf * traced.probability);
                let end = (ends.targets.point, ends.light_normal, ends.targets.is_finite);
                let (direction, t_max) = shadow_rays(traced.origin, traced.direction, end);
                let (origin, light) = (traced.origin, unoccluded * (mis_weight / density));
                let mut rays = Queued { lanes: arriving, origin, direction, t_max, light };
                self.dim_by_solids(&mut rays, ends.time, &traced.enclosing);
                let (paths, indices) = (&queue.paths[first..first + len], &queue.indices[first..first + len]);
                let (origins, directions) = (origin.to_lanes(), rays.direction.to_lanes());
                let (ends, times) = (rays.t_max.to_array(), ends.time.to_array());
                let lights = rays.light.to_lanes();
                arriving.each(
                    #[inline(always)]
                    |lane| {
                        let ray = Ray {
                            origin: origins[lane],
                            direction: directions[lane],
                            t_max: ends[lane],
                            time: times[lane],
                        };
                        self.shadow[indices[lane] as usize][1].push(&ray, paths[lane], lights[lane]);
                    },
                );
                let (rays, converged) = (connections.rays.to_array(), connections.has_converged.bits());
                watch.tally.attempts += len as u64;
                watch.tally.converged += u64::from(converged.count_ones());
                for rays in rays {
                    watch.tally.rays += rays as u64;
                }
                if watch.observer.is_some() {
                    let probability = chains.probability.to_array();
                    let mis_weight = mis_weight.only(arriving).to_array();
                    for lane in 0..len {
                        let attempt = Attempt {
                            stack: chains.stack[lane],
                            chain: chains.chain[lane],
                            probability: probability[lane],
                            rays: rays[lane] as u32,
                            has_converged: converged >> lane & 1 == 1,
                            mis_weight: mis_weight[lane],
                        };
                        let index = indices[lane];
                        if arriving.bits() >> lane & 1 == 1 {
                            self.shadow[index as usize][1].attempts.push(attempt);
                        } else {
                            watch.event(paths[lane], || Event::Connection { index, attempt, light: Rgb::BLACK });
                        }
                    }
                }
            },
        );
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
    fn solver<'s, F: Lanes>(&'s self, token: F::Token, ends: &'s Endpoints<F>) -> Solver<'s, F> {
        Solver { scene: self.estimator.scene, set: self.set, token, ends }
    }
}
