//! Manifold next-event estimation: connections to lights through clear covers.
//!
//! A shadow ray ends at a refracting interface. Without a further technique, only scattered rays reach light behind a
//! cover, and they must hit the one direction that the cover refracts into a small light. This module computes that
//! direction. A *chain* is a sequence of smooth interfaces of one stack of covers between a receiver x and a point y of
//! a light. Each interface transmits or reflects, in a given order. At x a chain is one direction.
//!
//! The solver finds it by tracing rays from x. The first ray has the direction of the chain in a plate of parallel
//! layers that replaces the stack. It is traced through the real mesh. Newton's method corrects the direction until the
//! ray arrives at y: first on a linearisation of the mesh around the traced ray (`linearized_chain.rs`), then on the
//! mesh itself (`trace_chain.rs`). The derivative, and with it the area at y per solid angle at x, comes from ray
//! differentials (Igehy 1999, `ray_differential.rs`). So the estimate is that of manifold next-event estimation
//! (Hanika, Droske and Fascione 2015) in the coordinates of the first direction. In a plate the first ray arrives.
//!
//! # The technique that samples each path
//!
//! Every path from a receiver to a light belongs to one of three kinds, by the interfaces in between:
//!
//! 1. *No interface.* Light sampling and scattering both sample it. They share it by their densities (`direct.rs`).
//! 2. *A chain of one stack* to which the solver converges from its start for (x, y) and that order of events. The
//!    connection and scattering both sample it. They share it by their densities over the direction at x.
//! 3. *All other paths*: longer chains, solutions that the solver does not find, chains through two stacks or through
//!    glass that is no cover, rough faces. Only scattering samples them, and they have full weight.
//!
//! [`Solver::solve`] decides between the second and the third kind. It is a function of x, y, stack and chain without
//! any random number. The connection runs it to find the path. A path that scattering has sampled runs it as well, to
//! decide if the connection finds the same path. Both techniques evaluate the same densities. So a solver that fails
//! costs time and noise. It loses no light, and no path counts twice. If several chains could lead to y, one of them is
//! chosen, with a probability that is part of the density.
//!
//! Two directions belong to one solution if their distance is within the sum of their own next Newton steps. No fixed
//! angle is used, because a rippled face has solutions close together.
//!
//! Lights without extent are not connected. Scattering cannot hit them, so light of chains that the solver does not
//! find would be missing.

mod linearized_chain;
mod ray_differential;
mod trace_chain;

use crate::direct::power_heuristic;
use crate::ray_state::RayState;
use crate::vertex::Vertex;
use dunkelfeld_geometry::{DVec3, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Candidate, Chain, Crossing, LightSample, LightSampleContext, Scene, SurfacePoint, Target};
use linearized_chain::LinearizedChain;
use ray_differential::RayDifferential;
use trace_chain::{TracedChain, trace_chain};

/// Maximum number of rays of one connection.
const MAX_RAYS: u32 = 6;
/// After this number of rays the solver stops, unless [`EARLY_STOP_ERROR`] is reached.
const EARLY_STOP_RAYS: u32 = 3;
/// The solver continues after [`EARLY_STOP_RAYS`] rays if one ray has missed the light by less than this share of the
/// straight distance. Most solutions are found within few rays.
const EARLY_STOP_ERROR: f64 = 0.01;
/// Maximum number of Newton steps on a linearised chain.
const MAX_LINEARIZED_STEPS: u32 = 4;
/// Newton's method on a linearised chain ends at a step of this size \[rad\].
const LINEARIZED_TOLERANCE: f64 = 1e-3;
/// Maximum number of times in a row that a step is halved.
const MAX_HALVINGS: u32 = 4;
/// A chain has arrived if it misses the light by less than this share of the straight distance, and if its next step is
/// below [`STEP_TOLERANCE`].
const ERROR_TOLERANCE: f64 = 1e-4;
/// Largest next Newton step of a chain that has arrived \[rad\]. That step is still applied. So the error of the first
/// direction is of the order of its square, which matters for a glossy receiver.
const STEP_TOLERANCE: f64 = 1e-4;
/// Rounding error of a direction in f32, with a margin \[rad\].
const ROUNDING: f64 = 1e-6;
/// Largest change of the first direction in one step \[rad\].
const MAX_STEP: f64 = 0.3;

/// The smooth interfaces of one stack that a path has passed since its last scattering.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SpecularPrefix {
    /// The state of the ray that left the last scattering.
    start: RayState,
    /// The stack; `None` before the first interface.
    stack: Option<u16>,
    chain: Chain,
}

impl SpecularPrefix {
    /// Starts at a ray that leaves a scattering vertex.
    #[inline]
    pub(crate) fn new(start: RayState) -> Self {
        Self { start, stack: None, chain: Chain::EMPTY }
    }

    /// True if no interface was passed yet.
    #[inline]
    pub(crate) fn is_direct(&self) -> bool {
        self.stack.is_none()
    }

    /// Passes a smooth interface; `None` if no connection can sample this path.
    #[inline]
    pub(crate) fn extended(&self, scene: &Scene, at: &SurfacePoint, is_reflection: bool) -> Option<Self> {
        let stack = scene.cover_of(at)?;
        let is_same = self.stack.is_none_or(|s| s == stack);
        let chain = self.chain.extended(is_reflection).filter(|_| is_same)?;
        Some(Self { stack: Some(stack), chain, ..*self })
    }
}

/// One attempted connection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Attempt {
    pub(crate) stack: u16,
    pub(crate) chain: Chain,
    /// The probability with which this chain was chosen.
    pub(crate) probability: f32,
    /// Number of rays traced through the cover.
    pub(crate) rays: u32,
    pub(crate) has_converged: bool,
    /// True if the light reaches the vertex.
    pub(crate) arrives: bool,
    /// Weight by the power heuristic; zero if no light arrives.
    pub(crate) mis_weight: f32,
    /// Radiance that is scattered toward the camera [W/(m^2 sr)], for the throughput 1.
    pub(crate) radiance: Rgb,
}

/// The end of a connection on a light.
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

    /// A direction toward light at infinity.
    pub(crate) fn infinite(direction: Vec3) -> Self {
        Self { target: Target::Direction(direction), normal: Vec3::ZERO }
    }

    /// Unit direction of the straight line from a point to the end.
    fn straight(&self, from: Vec3) -> Vec3 {
        match self.target {
            Target::Point(p) => (p - from).normalize_or_zero(),
            Target::Direction(d) => d,
        }
    }
}

/// Light of a light sample that reaches a vertex through a cover and is scattered toward the camera. `u` in `[0, 1)`
/// chooses among the candidate chains, and decides a roulette before the search. `survival` gives its probability for
/// the expected radiance [W/(m^2 sr)] toward the camera. `None` if there is no chain or if the roulette ends the attempt.
#[inline(never)]
pub(crate) fn estimate(
    scene: &Scene,
    at: &Vertex<'_>,
    light: &LightSample,
    survival: impl FnOnce(Rgb) -> f32,
    [u_chain, u_roulette]: [f32; 2],
) -> Option<Attempt> {
    if light.is_delta {
        return None;
    }
    let end = match light.target {
        Some(t) => End::surface(t.point, t.normal),
        None => End::infinite(light.direction),
    };
    let solver = Solver { scene, receiver: at.shading.receiver, start: at.spawn_ray(light.direction), end };
    if !solver.can_scatter_from(light.direction) {
        return None;
    }
    let selected = solver.choose(u_chain).filter(|w| solver.can_scatter_from(w.direction))?;
    // The contribution in the plate without losses at its faces.
    let density = light.pdf * selected.probability;
    let (scattered, pdf) = at.eval(selected.direction);
    let expected = scattered * light.radiance * (power_heuristic(density, pdf) / density);
    let survival = survival(expected);
    let is_ended = u_roulette >= survival;
    if is_ended {
        return None;
    }
    let (found, rays) = solver.solve(&selected);
    let ChainCandidate { stack, chain, probability, .. } = selected;
    let mut attempt = Attempt {
        stack,
        chain,
        probability,
        rays,
        has_converged: found.is_some(),
        arrives: false,
        mis_weight: 0.0,
        radiance: Rgb::BLACK,
    };
    let Some(found) = found else { return Some(attempt) };
    let (scattered, pdf) = at.eval(found.direction);
    let unoccluded = scattered * light.radiance * found.traced.weight;
    if unoccluded.is_black() {
        return Some(attempt);
    }
    let last = &found.traced.ray_state;
    let ray = scene.shadow_ray_from(last.ray.origin, last.ray.direction, light.target.as_ref()).at_time(last.ray.time);
    let (open, transmittance) = last.shadow_transmittance(scene, &ray);
    attempt.arrives = open > 0.0 && !transmittance.is_black();
    if open > 0.0 {
        // The density of the first direction.
        let density = light.pdf * selected.probability / found.solid_angle_ratio;
        attempt.mis_weight = power_heuristic(density, pdf * found.traced.probability);
        attempt.radiance = unoccluded * transmittance * (open * attempt.mis_weight / (density * survival));
    }
    Some(attempt)
}

/// The weight of a path that scattering has sampled through a cover, with the density `pdf` [1/sr] at its start.
/// `straight_pdf` [1/sr] is the density with which light sampling draws its end without the cover.
#[inline(never)]
pub(crate) fn scattering_mis_weight(
    scene: &Scene,
    receiver: &LightSampleContext,
    specular_prefix: &SpecularPrefix,
    end: End,
    pdf: f32,
    straight_pdf: f32,
) -> f32 {
    let Some(stack) = specular_prefix.stack.filter(|_| straight_pdf > 0.0) else { return 1.0 };
    let sampled = specular_prefix.start.ray.direction;
    let straight = end.straight(receiver.point);
    let solver = Solver { scene, receiver: *receiver, start: specular_prefix.start.with_direction(straight), end };
    if !solver.is_same_hemisphere(sampled) {
        return 1.0;
    }
    let Some(selected) = solver.candidate(stack, specular_prefix.chain) else { return 1.0 };
    let Some(found) = solver.solve(&selected).0.filter(|f| solver.is_same_solution(&selected, f, sampled)) else {
        return 1.0;
    };
    let density = straight_pdf * selected.probability / found.solid_angle_ratio;
    power_heuristic(pdf * found.traced.probability, density)
}

/// One of the candidate chains from a receiver to a light.
#[derive(Clone, Copy, Debug)]
struct ChainCandidate {
    stack: u16,
    chain: Chain,
    /// First direction in the plate that replaces the stack.
    direction: Vec3,
    /// The probability with which the candidate is chosen.
    probability: f32,
}

impl ChainCandidate {
    /// A candidate among others. `total` is the sum of `contribution` over all of them.
    fn new(stack: u16, crossing: &Crossing<'_>, candidate: &Candidate, total: f64) -> Option<Self> {
        let chain = candidate.chain;
        let direction = candidate.seed.or_else(|| crossing.seed(chain))?.direction;
        Some(Self { stack, chain, direction, probability: (candidate.contribution / total) as f32 })
    }
}

/// A chain that arrives at the light.
#[derive(Clone, Copy, Debug)]
struct Connection {
    /// First direction.
    direction: Vec3,
    traced: TracedChain,
    /// The next Newton step \[rad\], which is about the distance of the direction from the solution.
    step: f64,
    /// Solid angle at the receiver through the chain over that of the straight line [sr/sr].
    solid_angle_ratio: f32,
}

/// The miss of a ray at the light.
#[derive(Clone, Copy, Debug)]
struct Residual {
    /// Distance by which the ray misses the light, as a share of the straight distance or as an angle \[rad\].
    error: f64,
    /// The Newton step \[rad\] that corrects the miss, along the unit vectors perpendicular to the first direction.
    step: [f64; 2],
}

impl Residual {
    /// Length of the step.
    fn size(&self) -> f64 {
        self.step[0].hypot(self.step[1])
    }
}

/// The ray with the smallest miss so far.
struct Best {
    /// First direction, and unit vectors perpendicular to it.
    direction: Vec3,
    axes: [Vec3; 2],
    /// The Newton step of the ray \[rad\].
    step: [f64; 2],
    error: f64,
    /// The direction computed from its linearised chain.
    linearized: Option<Vec3>,
}

impl Best {
    /// The next direction to trace after a number of failures: that of the linearised chain, then Newton's step, then
    /// half of the step and so on.
    fn next_direction(&self, failures: u32) -> Option<Vec3> {
        let halvings = match (self.linearized, failures) {
            (Some(linearized), 0) => return Some(linearized),
            (Some(_), n) => n - 1,
            (None, n) => n,
        };
        let scale = 0.5f64.powi(halvings as i32);
        (halvings <= MAX_HALVINGS).then(|| turned(self.direction, self.axes, self.step.map(|s| s * scale)))
    }
}

/// The solver for chains between a receiver and a light.
struct Solver<'a> {
    scene: &'a Scene,
    receiver: LightSampleContext,
    /// The straight ray. All chains start on its side of the surface.
    start: RayState,
    end: End,
}

impl<'a> Solver<'a> {
    /// True if a direction leaves the receiver on the side of the straight line.
    #[inline]
    fn is_same_hemisphere(&self, direction: Vec3) -> bool {
        let normal = self.receiver.normal;
        (normal.dot(direction) > 0.0) == (normal.dot(self.start.ray.direction) > 0.0)
    }

    /// True if the receiver can scatter light from a direction to the viewer, on the side of the straight line.
    #[inline]
    fn can_scatter_from(&self, direction: Vec3) -> bool {
        self.receiver.faces(direction) && self.is_same_hemisphere(direction)
    }

    /// Calls `visit` for all candidate chains to the light, with the stacks between it and the receiver.
    #[inline]
    fn each_candidate(&self, mut visit: impl FnMut(u16, &Crossing<'a>, Candidate)) {
        let inside = self.start.solid(self.scene);
        let (from, target) = (self.receiver.point, self.end.target);
        for (stack, cover) in (0u16..).zip(self.scene.covers()) {
            if let Some(crossing) = cover.crossing(from, inside, target) {
                crossing.each_candidate(|candidate| visit(stack, &crossing, candidate));
            }
        }
    }

    /// Chooses a chain in proportion to its estimated contribution.
    fn choose(&self, u: f32) -> Option<ChainCandidate> {
        let (mut total, mut rest, mut chosen) = (0.0, f64::from(u), None);
        self.each_candidate(|stack, crossing, candidate| {
            total += candidate.contribution;
            // The rescaled random number is uniform again and is used for the next choice.
            let fraction = candidate.contribution / total;
            if rest < fraction {
                rest /= fraction;
                chosen = Some((stack, *crossing, candidate));
            } else {
                rest = (rest - fraction) / (1.0 - fraction);
            }
        });
        let (stack, crossing, candidate) = chosen?;
        ChainCandidate::new(stack, &crossing, &candidate, total)
    }

    /// The candidate of a given stack and chain, if it can be chosen.
    fn candidate(&self, stack: u16, chain: Chain) -> Option<ChainCandidate> {
        let (mut total, mut found) = (0.0, None);
        self.each_candidate(|s, crossing, candidate| {
            total += candidate.contribution;
            if (s, candidate.chain) == (stack, chain) {
                found = Some((*crossing, candidate));
            }
        });
        let (crossing, candidate) = found?;
        ChainCandidate::new(stack, &crossing, &candidate, total)
    }

    /// Solves for the chain. Also returns the number of traced rays. The result depends only on receiver, light, stack
    /// and chain.
    fn solve(&self, selected: &ChainCandidate) -> (Option<Connection>, u32) {
        let mut linearized_chain = LinearizedChain::new();
        let mut direction = selected.direction;
        let mut best: Option<Best> = None;
        let mut failures = 0;
        for rays in 1..=MAX_RAYS {
            if let Some((traced, residual)) = self.trace(selected, direction, &mut linearized_chain) {
                let size = residual.size();
                if residual.error <= ERROR_TOLERANCE && size <= STEP_TOLERANCE {
                    return (
                        self.connection(turned(direction, traced.ray_differential.axes, residual.step), traced, size),
                        rays,
                    );
                }
                if best.as_ref().is_none_or(|b| residual.error < b.error) {
                    let scale = (MAX_STEP / size).min(1.0);
                    let (axes, step) = (traced.ray_differential.axes, residual.step.map(|s| s * scale));
                    let linearized = self.solve_linearized(&linearized_chain, turned(direction, axes, step));
                    best = Some(Best { direction, axes, step, error: residual.error, linearized });
                    failures = 0;
                } else {
                    failures += 1;
                }
            } else {
                failures += 1;
            }
            let to_improve = best.as_ref().filter(|b| rays < EARLY_STOP_RAYS || b.error < EARLY_STOP_ERROR);
            let Some(next) = to_improve.and_then(|b| b.next_direction(failures)) else { return (None, rays) };
            direction = next;
        }
        (None, MAX_RAYS)
    }

    /// Newton's method on a linearised chain, starting at `direction`: the first direction of the chain if the faces
    /// continued as near the traced ray. `None` if it does not converge.
    fn solve_linearized(&self, linearized_chain: &LinearizedChain, mut direction: Vec3) -> Option<Vec3> {
        let mut error = f64::INFINITY;
        for _ in 0..MAX_LINEARIZED_STEPS {
            let (position, leaving, ray_differential) =
                linearized_chain.trace(self.start.ray.origin.as_dvec3(), direction)?;
            let residual = self.residual(position, leaving, &ray_differential)?;
            let is_better = residual.error < error && residual.size() < MAX_STEP;
            if !is_better {
                return None;
            }
            error = residual.error;
            direction = turned(direction, ray_differential.axes, residual.step);
            if residual.size() <= LINEARIZED_TOLERANCE {
                break;
            }
        }
        Some(direction)
    }

    /// Traces a ray through the stack. Returns the traced chain and its miss at the light.
    fn trace(
        &self,
        selected: &ChainCandidate,
        direction: Vec3,
        linearized_chain: &mut LinearizedChain,
    ) -> Option<(TracedChain, Residual)> {
        if !self.is_same_hemisphere(direction) {
            return None;
        }
        let traced = trace_chain(
            self.scene,
            self.start.with_direction(direction),
            selected.stack,
            selected.chain,
            linearized_chain,
        )?;
        let last = &traced.ray_state.ray;
        let residual = self.residual(last.origin.as_dvec3(), last.direction.as_dvec3(), &traced.ray_differential)?;
        Some((traced, residual))
    }

    /// The miss of a ray that leaves the cover. `None` if the light is behind the ray, or if no step corrects the miss.
    fn residual(&self, position: DVec3, leaving: DVec3, ray_differential: &RayDifferential) -> Option<Residual> {
        let (miss, scale, jacobian) = match self.end.target {
            Target::Point(point) => {
                let to_light = point.as_dvec3() - position;
                let distance = to_light.dot(leaving);
                let is_ahead = distance > 0.0;
                if !is_ahead {
                    return None;
                }
                let miss = to_light - leaving * distance;
                let straight = point.as_dvec3().distance(self.receiver.point.as_dvec3());
                (miss, straight, ray_differential.jacobian_at(leaving, distance))
            }
            Target::Direction(d) => (d.as_dvec3() - leaving, 1.0, ray_differential.jacobian_at_infinity(leaving)),
        };
        Some(Residual { error: miss.length() / scale, step: jacobian.solve(miss)? })
    }

    /// True if the direction of a sampled path to the light belongs to the same solution.
    fn is_same_solution(&self, selected: &ChainCandidate, found: &Connection, sampled: Vec3) -> bool {
        let Some((_, residual)) = self.trace(selected, sampled, &mut LinearizedChain::new()) else { return false };
        let distance = (found.direction.as_dvec3() - sampled.as_dvec3()).length();
        distance <= ROUNDING + 2.0 * (found.step + residual.size())
    }

    /// The chain that has arrived; `None` if its light would leave the other side of the surface of the light.
    fn connection(&self, direction: Vec3, traced: TracedChain, step: f64) -> Option<Connection> {
        let leaving = traced.ray_state.ray.direction.as_dvec3();
        let solid_angle_ratio = match self.end.target {
            Target::Point(point) => {
                let to_light = point.as_dvec3() - traced.ray_state.ray.origin.as_dvec3();
                let area = traced.ray_differential.jacobian_at(leaving, to_light.dot(leaving)).area();
                let line = point.as_dvec3() - self.receiver.point.as_dvec3();
                let straight = line.length();
                let normal = self.end.normal.as_dvec3();
                let cosines = leaving.dot(normal) * straight / line.dot(normal);
                straight * straight * cosines / area
            }
            Target::Direction(_) => 1.0 / traced.ray_differential.jacobian_at_infinity(leaving).area(),
        };
        let solid_angle_ratio = solid_angle_ratio as f32;
        (solid_angle_ratio > 0.0 && solid_angle_ratio.is_finite()).then_some(Connection {
            direction,
            traced,
            step,
            solid_angle_ratio,
        })
    }
}

/// A direction turned by a step \[rad\] along two unit vectors perpendicular to it.
fn turned(from: Vec3, [a, b]: [Vec3; 2], step: [f64; 2]) -> Vec3 {
    let [x, y] = step.map(|s| s as f32);
    (from + a * x + b * y).normalize()
}
