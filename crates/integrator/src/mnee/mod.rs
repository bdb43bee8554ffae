//! Light through clear covers: connections that bend.
//!
//! A shadow ray ends at a refracting interface, so light behind a cover would be left to chance: scattering has to pick the
//! one direction that the cover bends into a small light. Here the direction is found. A *chain* is a row of smooth
//! interfaces of one stack of covers between a receiver x and a point y of a light, each transmitting or reflecting in a
//! given order; seen from x it is one direction. It is sought by shooting: a ray is sent from x in the direction that the
//! chain would have if the stack were a plate of parallel layers, followed through the real mesh, and its direction corrected
//! by Newton's method until it arrives at y: on the mesh as it was met first (`trail.rs`), then through the mesh itself. The
//! derivative, and with it the area at y per solid angle at x, is that of the
//! bundle of rays about it (Igehy 1999), so the estimate is that of manifold next-event estimation (Hanika, Droske and
//! Fascione 2015) in the coordinates of the first direction. In a plate the first ray arrives.
//!
//! # Who finds which path
//!
//! Every path from a receiver to a light belongs to one of three kinds, by its interfaces in between:
//!
//! 1. *None.* Light sampling and scattering both find it, and share it by their densities (`direct.rs`).
//! 2. *A chain of one stack* which the solver, started for (x, y) and that order of events, converges to. The connection
//!    and scattering both find it, and share it by their densities over the direction at x.
//! 3. *Everything else*: longer chains, solutions that the solver does not find, chains through two stacks or through
//!    glass that is no cover, rough faces. Scattering alone finds it, and it counts in full.
//!
//! What tells the second kind from the third is [`Solver::connect`], a function of x, y, stack and chain without any random
//! number. The connection runs it to find the path; scattering, having found a path by chance, runs it to learn whether
//! the connection would have found the same. Both evaluate the same densities. So a solver that fails costs time and
//! noise, never light, and no path counts twice. If several chains could lead to y, one is asked, with a probability that
//! is part of the density.
//!
//! Whether two directions belong to one solution is decided by how far each still is from it, by its own next Newton step,
//! not by an angle that is called small: a rippled face has solutions side by side.
//!
//! Lights without extent are not connected: scattering cannot find them, and the chains that the solver does not know would
//! be missing.

mod linearized_chain;
mod ray_differential;
mod trace_chain;

use crate::direct::{ShadowRoulette, power_heuristic};
use crate::ray_state::RayState;
use crate::recorder::Recorder;
use crate::vertex::Vertex;
use dunkelfeld_geometry::{DVec3, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{
    Candidate, Chain, Crossing, Features, LightSample, LightSampleContext, Scene, SurfacePoint, Target,
};
use linearized_chain::LinearizedChain;
use ray_differential::RayDifferential;
use std::marker::PhantomData;
use trace_chain::{TracedChain, shoot};

/// Rays that one connection may send ...
const MAX_SHOTS: u32 = 6;
/// ... if after so many of them ...
const FIRST_SHOTS: u32 = 3;
/// ... one has missed the light by less than this share of the straight distance. What is found at all is found soon.
const NEAR: f64 = 0.01;
/// Steps of Newton's method on a trail.
const MAX_SOLVES: u32 = 4;
/// They may end with a step as small as this \[rad\].
const RECKONED: f64 = 1e-3;
/// Times that a step may be halved in a row.
const MAX_HALVINGS: u32 = 4;
/// A chain has arrived when it misses the light by less than this share of the straight distance ...
const ARRIVED: f64 = 1e-4;
/// ... and the next step would turn it by less than this \[rad\]. That step is still taken: the first direction, in which
/// a glossy receiver may be very particular, is known to the square of it.
const SETTLED: f64 = 1e-4;
/// Rounding of a direction in f32, some times over \[rad\].
const ROUNDING: f64 = 1e-6;
/// No step turns the first direction by more than this \[rad\].
const LONGEST_STEP: f64 = 0.3;

/// The interfaces that a path has passed since it was scattered: events of one stack.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SpecularPrefix {
    /// The way that it took from where it was scattered.
    start: RayState,
    /// The stack, once an interface was passed.
    stack: Option<u16>,
    chain: Chain,
}

impl SpecularPrefix {
    /// Sets out.
    #[inline]
    pub(crate) fn from(start: RayState) -> Self {
        Self { start, stack: None, chain: Chain::EMPTY }
    }

    /// Has no interface been passed yet?
    #[inline]
    pub(crate) fn is_direct(&self) -> bool {
        self.stack.is_none()
    }

    /// Passes a smooth interface; `None` if no connection leads this way.
    #[inline]
    pub(crate) fn then(&self, scene: &Scene, at: &SurfacePoint, is_reflection: bool) -> Option<Self> {
        let stack = scene.cover_of(at)?;
        let is_same = self.stack.is_none_or(|s| s == stack);
        let chain = self.chain.then(is_reflection).filter(|_| is_same)?;
        Some(Self { stack: Some(stack), chain, ..*self })
    }
}

/// A chain that was sought: how often the solver ran, and how it fared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Search {
    pub(crate) stack: u16,
    pub(crate) chain: Chain,
    /// The probability with which this chain was asked.
    pub(crate) probability: f32,
    /// Rays sent through the cover.
    pub(crate) shots: u32,
    pub(crate) has_arrived: bool,
}

/// A light as connections see it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct End {
    pub(crate) target: Target,
    /// Unit normal of the light's surface; zero where it has none.
    pub(crate) normal: Vec3,
}

impl End {
    /// A point on a surface that emits.
    pub(crate) fn surface(point: Vec3, normal: Vec3) -> Self {
        Self { target: Target::Point(point), normal }
    }

    /// Light from infinitely far away.
    pub(crate) fn infinite(direction: Vec3) -> Self {
        Self { target: Target::Direction(direction), normal: Vec3::ZERO }
    }

    /// Unit direction from a point straight to it.
    fn straight(&self, from: Vec3) -> Vec3 {
        match self.target {
            Target::Point(p) => (p - from).normalize_or_zero(),
            Target::Direction(d) => d,
        }
    }
}

/// Light of a sample that reaches a vertex through a cover and is scattered toward the camera. `u` gives a number in `[0, 1)` that
/// chooses among the chains that may lead there. Roulette is played with the stake before the search; the recorder hears of the
/// search and, if it found light, of the connection's share.
#[inline(never)]
pub(crate) fn light_from<F: Features, V: Vertex>(
    scene: &Scene,
    at: &V,
    light: &LightSample,
    roulette: ShadowRoulette,
    u: impl FnOnce() -> f32,
    recorder: &mut impl Recorder,
) -> Rgb {
    if light.is_delta {
        return Rgb::BLACK;
    }
    let end = match light.target {
        Some(t) => End::surface(t.point, t.normal),
        None => End::infinite(light.direction),
    };
    let solver = Solver::<F>::new(scene, *at.receiver(), at.leave(light.direction), end);
    if !solver.may_lead_to(light.direction) {
        return Rgb::BLACK;
    }
    let Some(way) = solver.choose(u).filter(|w| solver.may_lead_to(w.direction)) else { return Rgb::BLACK };
    // What the plate would bring if it let all light through.
    let density = light.pdf * way.share;
    let (scattered, pdf) = at.eval(way.direction);
    let expected = scattered * light.radiance * (power_heuristic(density, pdf) / density);
    let Some(survival) = roulette.survival(expected) else { return Rgb::BLACK };
    let (found, shots) = solver.connect(&way);
    let ChainCandidate { stack, chain, share: probability, .. } = way;
    recorder.connection(&Search { stack, chain, probability, shots, has_arrived: found.is_some() });
    let Some(found) = found else { return Rgb::BLACK };
    let (scattered, pdf) = at.eval(found.direction);
    let unoccluded = scattered * light.radiance * found.shot.weight;
    if unoccluded.is_black() {
        return Rgb::BLACK;
    }
    let last = &found.shot.walk;
    let ray = scene.shadow_ray_from(last.ray.origin, last.ray.direction, light.target.as_ref());
    let (open, left) = last.light_along::<F>(scene, &ray);
    if open == 0.0 {
        return Rgb::BLACK;
    }
    // The density of the first direction.
    let density = light.pdf * way.share / found.solid_angle_ratio;
    let share = power_heuristic(density, pdf * found.shot.probability);
    recorder.shares(share);
    unoccluded * left * (open * share / (density * survival))
}

/// The share of a path that scattering has found through a passage, with the density `pdf` [1/sr] at its start; `straight_pdf`
/// [1/sr] is that with which light sampling draws its end, as if nothing were in between.
#[inline(never)]
pub(crate) fn share_of_scattering<F: Features>(
    scene: &Scene,
    receiver: &LightSampleContext,
    passage: &SpecularPrefix,
    end: End,
    pdf: f32,
    straight_pdf: f32,
) -> f32 {
    let Some(stack) = passage.stack.filter(|_| straight_pdf > 0.0) else { return 1.0 };
    let taken = passage.start.ray.direction;
    let straight = end.straight(receiver.point);
    let solver = Solver::<F>::new(scene, *receiver, passage.start.aimed(straight), end);
    if !solver.is_on_its_side(taken) {
        return 1.0;
    }
    let Some(way) = solver.way(stack, passage.chain) else { return 1.0 };
    let Some(found) = solver.connect(&way).0.filter(|f| solver.is_same(&way, f, taken)) else { return 1.0 };
    let density = straight_pdf * way.share / found.solid_angle_ratio;
    power_heuristic(pdf * found.shot.probability, density)
}

/// One of the chains that may lead from a receiver to a light.
#[derive(Clone, Copy, Debug)]
struct ChainCandidate {
    stack: u16,
    chain: Chain,
    /// First direction, in the plate that stands for the stack.
    direction: Vec3,
    /// The probability with which it is asked.
    share: f32,
}

impl ChainCandidate {
    /// A candidate among others that bring `total` together with it.
    fn new(stack: u16, crossing: &Crossing<'_>, candidate: &Candidate, total: f64) -> Option<Self> {
        let chain = candidate.chain;
        let direction = candidate.seed.or_else(|| crossing.seed(chain))?.direction;
        Some(Self { stack, chain, direction, share: (candidate.brings / total) as f32 })
    }
}

/// A chain that arrives.
#[derive(Clone, Copy, Debug)]
struct Connection {
    /// First direction.
    direction: Vec3,
    shot: TracedChain,
    /// The step \[rad\] that would correct the direction: about how far it is from the solution.
    step: f64,
    /// Solid angle at the receiver through the chain over that of the straight line [sr/sr].
    solid_angle_ratio: f32,
}

/// How well a ray hits the light.
#[derive(Clone, Copy, Debug)]
struct Residual {
    /// By how much it misses, as a share of the straight distance, or as an angle.
    error: f64,
    /// The step \[rad\] that would correct it, along the unit vectors across the first direction.
    step: [f64; 2],
}

impl Residual {
    /// Length of the step.
    fn size(&self) -> f64 {
        self.step[0].hypot(self.step[1])
    }
}

/// The best ray so far.
struct Best {
    /// First direction, and unit vectors across it.
    direction: Vec3,
    across: [Vec3; 2],
    /// The step that it asks for \[rad\].
    step: [f64; 2],
    error: f64,
    /// The direction that was reckoned from its trail.
    reckoned: Option<Vec3>,
}

impl Best {
    /// The direction to try after so many failures: what was reckoned, then Newton's step, then half of it and so on.
    fn attempt(&self, failures: u32) -> Option<Vec3> {
        let halvings = match (self.reckoned, failures) {
            (Some(reckoned), 0) => return Some(reckoned),
            (Some(_), n) => n - 1,
            (None, n) => n,
        };
        let scale = 0.5f64.powi(halvings as i32);
        (halvings <= MAX_HALVINGS).then(|| turned(self.direction, self.across, self.step.map(|s| s * scale)))
    }
}

/// A receiver and a light, between which chains are sought.
struct Solver<'a, F> {
    scene: &'a Scene,
    receiver: LightSampleContext,
    /// The straight way, which tells the side of the surface on which all others start.
    start: RayState,
    end: End,
    features: PhantomData<F>,
}

impl<'a, F: Features> Solver<'a, F> {
    #[inline]
    fn new(scene: &'a Scene, receiver: LightSampleContext, start: RayState, end: End) -> Self {
        Self { scene, receiver, start, end, features: PhantomData }
    }

    /// Does a direction leave the receiver on the side of the straight line?
    #[inline]
    fn is_on_its_side(&self, direction: Vec3) -> bool {
        let normal = self.receiver.normal;
        (normal.dot(direction) > 0.0) == (normal.dot(self.start.ray.direction) > 0.0)
    }

    /// Can light from a direction be scattered to the viewer, on the side of the straight line?
    #[inline]
    fn may_lead_to(&self, direction: Vec3) -> bool {
        self.receiver.faces(direction) && self.is_on_its_side(direction)
    }

    /// Shows all chains that may lead to the light, with the stacks between it and the receiver.
    #[inline]
    fn each_way(&self, mut visit: impl FnMut(u16, &Crossing<'a>, Candidate)) {
        let inside = self.start.solid::<F>(self.scene);
        let (from, target) = (self.receiver.point, self.end.target);
        for (stack, cover) in (0u16..).zip(self.scene.covers()) {
            if let Some(crossing) = cover.crossing(from, inside, target) {
                crossing.each_candidate(|candidate| visit(stack, &crossing, candidate));
            }
        }
    }

    /// Chooses a chain by what it may bring.
    fn choose(&self, u: impl FnOnce() -> f32) -> Option<ChainCandidate> {
        let (mut total, mut u, mut rest, mut chosen) = (0.0, Some(u), 0.0, None);
        self.each_way(|stack, crossing, candidate| {
            total += candidate.brings;
            // Most questions have no candidate, and need no number.
            if let Some(u) = u.take() {
                rest = f64::from(u());
            }
            // What is left of the random number is as good as a new one.
            let takes = candidate.brings / total;
            if rest < takes {
                rest /= takes;
                chosen = Some((stack, *crossing, candidate));
            } else {
                rest = (rest - takes) / (1.0 - takes);
            }
        });
        let (stack, crossing, candidate) = chosen?;
        ChainCandidate::new(stack, &crossing, &candidate, total)
    }

    /// A given chain, if it is one of those that may be chosen.
    fn way(&self, stack: u16, chain: Chain) -> Option<ChainCandidate> {
        let (mut total, mut wanted) = (0.0, None);
        self.each_way(|s, crossing, candidate| {
            total += candidate.brings;
            if (s, candidate.chain) == (stack, chain) {
                wanted = Some((*crossing, candidate));
            }
        });
        let (crossing, candidate) = wanted?;
        ChainCandidate::new(stack, &crossing, &candidate, total)
    }

    /// Seeks the chain; also tells how many rays that took. A function of receiver, light, stack and chain alone.
    fn connect(&self, way: &ChainCandidate) -> (Option<Connection>, u32) {
        let mut trail = LinearizedChain::new();
        let mut direction = way.direction;
        let mut best: Option<Best> = None;
        let mut failures = 0;
        for shots in 1..=MAX_SHOTS {
            if let Some((shot, aim)) = self.try_direction(way, direction, &mut trail) {
                let size = aim.size();
                if aim.error <= ARRIVED && size <= SETTLED {
                    return (self.finish(turned(direction, shot.beam.across, aim.step), shot, size), shots);
                }
                if best.as_ref().is_none_or(|b| aim.error < b.error) {
                    let scale = (LONGEST_STEP / size).min(1.0);
                    let (across, step) = (shot.beam.across, aim.step.map(|s| s * scale));
                    let reckoned = self.solve_linearized(&trail, turned(direction, across, step));
                    best = Some(Best { direction, across, step, error: aim.error, reckoned });
                    failures = 0;
                } else {
                    failures += 1;
                }
            } else {
                failures += 1;
            }
            let promising = best.as_ref().filter(|b| shots < FIRST_SHOTS || b.error < NEAR);
            let Some(next) = promising.and_then(|b| b.attempt(failures)) else { return (None, shots) };
            direction = next;
        }
        (None, MAX_SHOTS)
    }

    /// Newton's method on what a ray has left as its trail, from a direction on: where the chain would start if the faces went
    /// on as they are there. `None` if that leads nowhere.
    fn solve_linearized(&self, trail: &LinearizedChain, mut direction: Vec3) -> Option<Vec3> {
        let mut error = f64::INFINITY;
        for _ in 0..MAX_SOLVES {
            let (place, leaving, beam) = trail.follow(self.start.ray.origin.as_dvec3(), direction)?;
            let aim = self.aim(place, leaving, &beam)?;
            let is_better = aim.error < error && aim.size() < LONGEST_STEP;
            if !is_better {
                return None;
            }
            error = aim.error;
            direction = turned(direction, beam.across, aim.step);
            if aim.size() <= RECKONED {
                break;
            }
        }
        Some(direction)
    }

    /// Sends a ray: where it leaves the cover, and how well it hits the light.
    fn try_direction(
        &self,
        way: &ChainCandidate,
        direction: Vec3,
        trail: &mut LinearizedChain,
    ) -> Option<(TracedChain, Residual)> {
        if !self.is_on_its_side(direction) {
            return None;
        }
        let shot = shoot::<F>(self.scene, self.start.aimed(direction), way.stack, way.chain, trail)?;
        let last = &shot.walk.ray;
        let aim = self.aim(last.origin.as_dvec3(), last.direction.as_dvec3(), &shot.beam)?;
        Some((shot, aim))
    }

    /// How well a ray that leaves the cover hits the light; `None` if that is behind it, or no step corrects the miss.
    fn aim(&self, place: DVec3, leaving: DVec3, beam: &RayDifferential) -> Option<Residual> {
        let (miss, scale, spread) = match self.end.target {
            Target::Point(point) => {
                let to_light = point.as_dvec3() - place;
                let distance = to_light.dot(leaving);
                let is_ahead = distance > 0.0;
                if !is_ahead {
                    return None;
                }
                let miss = to_light - leaving * distance;
                let straight = point.as_dvec3().distance(self.receiver.point.as_dvec3());
                (miss, straight, beam.spread_at(leaving, distance))
            }
            Target::Direction(d) => (d.as_dvec3() - leaving, 1.0, beam.spread_to_infinity(leaving)),
        };
        Some(Residual { error: miss.length() / scale, step: spread.solve(miss)? })
    }

    /// Does a direction that leads to the light as well belong to the same solution?
    fn is_same(&self, way: &ChainCandidate, found: &Connection, taken: Vec3) -> bool {
        let Some((_, aim)) = self.try_direction(way, taken, &mut LinearizedChain::new()) else { return false };
        let distance = (found.direction.as_dvec3() - taken.as_dvec3()).length();
        distance <= ROUNDING + 2.0 * (found.step + aim.size())
    }

    /// The chain that has arrived; `None` if its light would leave on the other side of the light's surface.
    fn finish(&self, direction: Vec3, shot: TracedChain, step: f64) -> Option<Connection> {
        let leaving = shot.walk.ray.direction.as_dvec3();
        let solid_angle_ratio = match self.end.target {
            Target::Point(point) => {
                let to_light = point.as_dvec3() - shot.walk.ray.origin.as_dvec3();
                let spread = shot.beam.spread_at(leaving, to_light.dot(leaving)).area();
                let line = point.as_dvec3() - self.receiver.point.as_dvec3();
                let straight = line.length();
                let normal = self.end.normal.as_dvec3();
                let cosines = leaving.dot(normal) * straight / line.dot(normal);
                straight * straight * cosines / spread
            }
            Target::Direction(_) => 1.0 / shot.beam.spread_to_infinity(leaving).area(),
        };
        let solid_angle_ratio = solid_angle_ratio as f32;
        (solid_angle_ratio > 0.0 && solid_angle_ratio.is_finite()).then_some(Connection {
            direction,
            shot,
            step,
            solid_angle_ratio,
        })
    }
}

/// A direction turned by a step \[rad\] along two unit vectors across it.
fn turned(from: Vec3, [a, b]: [Vec3; 2], step: [f64; 2]) -> Vec3 {
    let [x, y] = step.map(|s| s as f32);
    (from + a * x + b * y).normalize()
}
