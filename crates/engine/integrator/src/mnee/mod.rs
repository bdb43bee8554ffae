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
//! [`Traversal::advance`] decides between the second and the third kind. It is a function of x, y, stack and chain without
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
use crate::ray_state::{EnclosingSolids, RayState};
use dunkelfeld_geometry::Vec3;
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, Mask, V3, vectorize};
use dunkelfeld_scene::covers::Wanted;
use dunkelfeld_scene::{CandidateChains, Chain, Receivers, Scene, Targets};
use linearized_chain::LinearizedChains;
use ray_differential::{EndpointJacobians, RayDifferentials};
pub(crate) use trace_chain::{MAX_TRAVERSALS, Segments, TracedChains, Traversal, trace_chains};

/// Maximum number of rays of one connection. Most chains are found within three.
const MAX_RAYS: u32 = 6;
/// After this number of rays the solver stops, unless [`EARLY_STOP_ERROR`] is reached.
const EARLY_STOP_RAYS: u32 = 3;
/// The solver continues after [`EARLY_STOP_RAYS`] rays if one ray has missed the light by less than this share of the
/// straight distance. Most solutions are found within few rays.
const EARLY_STOP_ERROR: f32 = 0.01;
/// Maximum number of Newton steps on a linearised chain.
const MAX_LINEARIZED_STEPS: u32 = 4;
/// Newton's method on a linearised chain ends at a step of this size \[rad\].
const LINEARIZED_TOLERANCE: f32 = 1e-3;
/// Maximum number of times in a row that a step is halved.
const MAX_HALVINGS: u32 = 4;
/// A chain has arrived if it misses the light by less than this share of the straight distance, and if its next step is
/// below [`STEP_TOLERANCE`]. Its shadow ray leads from the last interface to the light itself.
const ERROR_TOLERANCE: f32 = 1e-3;
/// Largest next Newton step of a chain that has arrived \[rad\]. That step is still applied. So the error of the first
/// direction is of the order of its square, which matters for a glossy receiver. The relative error of the density is of
/// the order of the step.
const STEP_TOLERANCE: f32 = 1e-3;
/// Rounding error of a direction in f32, with a margin \[rad\].
const ROUNDING: f32 = 1e-6;
/// Largest change of the first direction in one step \[rad\]. Beyond it the linearisation fails.
const MAX_STEP: f32 = 0.3;

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
    pub(crate) fn extended(&self, scene: &Scene, part: u32, is_reflection: bool) -> Option<Self> {
        let stack = scene.cover_of_part(part)?;
        let is_same = self.stack.is_none_or(|s| s == stack);
        let chain = self.chain.extended(is_reflection).filter(|_| is_same)?;
        Some(Self { stack: Some(stack), chain, ..*self })
    }
}

/// The ends of connections, one for each lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Endpoints<F: Lanes> {
    /// The receivers, and the origins of their rays on the side of the straight line.
    pub(crate) receivers: Receivers<F>,
    pub(crate) origin: V3<F>,
    pub(crate) time: F,
    /// The solids around the origins.
    pub(crate) enclosing: [EnclosingSolids; MAX_WIDTH],
    /// The ends on lights, with the unit directions of the straight lines to them. All chains start on their side.
    pub(crate) targets: Targets<F>,
    /// Unit normals of the surfaces of the lights, which are zero where there is none.
    pub(crate) light_normal: V3<F>,
}

/// The end of a path on a light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct End {
    /// True for a point on a surface that emits, false for a direction toward light at infinity.
    pub(crate) is_finite: bool,
    pub(crate) place: Vec3,
    /// Unit normal of the surface; zero at infinity.
    pub(crate) normal: Vec3,
}

/// The weight of a path that scattering has sampled through a cover, with the density `pdf` [1/sr] at its start.
/// `straight_pdf` [1/sr] is the density with which light sampling draws its end without the cover.
#[inline(never)]
pub(crate) fn scattering_mis_weight(
    scene: &Scene,
    receiver: &Receivers<f32>,
    specular_prefix: &SpecularPrefix,
    end: End,
    pdf: f32,
    straight_pdf: f32,
) -> f32 {
    let Some(stack) = specular_prefix.stack.filter(|_| straight_pdf > 0.0) else { return 1.0 };
    let RayState { ray, enclosing } = specular_prefix.start;
    let End { is_finite, place, normal } = end;
    let direction = if is_finite { (place - Vec3::from(receiver.point)).normalize_or_zero() } else { place };
    let ends = Endpoints::<f32> {
        receivers: *receiver,
        origin: ray.origin.into(),
        time: ray.time,
        enclosing: [enclosing; MAX_WIDTH],
        targets: Targets { point: place.into(), direction: direction.into(), is_finite },
        light_normal: normal.into(),
    };
    let solver = Solver { scene, set: InstructionSet::Scalar, token: (), ends: &ends };
    let sampled = V3::from(ray.direction);
    if !solver.is_same_hemisphere(sampled) {
        return 1.0;
    }
    let given = Wanted::Given([(stack, specular_prefix.chain); MAX_WIDTH]);
    let selected = scene.choose_chains::<f32>(given, true, receiver.point, &ends.inside(scene), &ends.targets);
    if !selected.is_some {
        return 1.0;
    }
    let mut segments = Segments::new(scene);
    let mut trace = |search: &Search<f32>| {
        let mut traversals = [Traversal::new(solver, (true, &selected.chain), search)];
        trace_chains(&mut traversals, &mut segments);
        let [traversal] = traversals;
        traversal
    };
    let (mut ray, mut search) = (0, Search::new((), selected.direction));
    let (traversal, found) = loop {
        ray += 1;
        let mut traversal = trace(&search);
        let (found, is_open) = traversal.advance(ray);
        if !is_open {
            break (traversal, found);
        }
        search = traversal.search;
    };
    if !found.has_converged {
        return 1.0;
    }
    // Does the sampled direction belong to the same solution?
    let residuals = trace(&Search::new((), sampled)).residuals();
    let distance = (found.direction - sampled).length();
    let is_same = residuals.exists && distance <= (found.step + residuals.size) * 2.0 + ROUNDING;
    if !is_same {
        return 1.0;
    }
    let density = straight_pdf * selected.probability / found.solid_angle_ratio;
    power_heuristic(pdf * traversal.traced.probability, density)
}

/// Solved chains, one for each lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Connections<F: Lanes> {
    /// Lanes whose chain arrives at the light.
    pub(crate) has_converged: F::Mask,
    /// First directions.
    pub(crate) direction: V3<F>,
    /// The next Newton steps \[rad\], which are about the distances of the directions from the solutions.
    step: F,
    /// Solid angles at the receivers through the chains over those of the straight lines [sr/sr].
    pub(crate) solid_angle_ratio: F,
}

/// The state of searches between two rays, one for each lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Search<F: Lanes> {
    /// The first directions of the next rays.
    pub(crate) direction: V3<F>,
    best: Best<F>,
    /// Numbers of rays since the best ones.
    failures: F,
}

/// A [`Search`] of one lane.
pub(crate) type SearchRecord = [[f32; 4]; 5];

impl<F: Lanes> Search<F> {
    /// Begins in the directions of the chains in plates.
    #[inline(always)]
    pub(crate) fn new(token: F::Token, direction: V3<F>) -> Self {
        let (zero, none) = (F::splat(token, 0.0), F::mask(token, 0));
        let best = Best {
            direction,
            axes: [direction; 2],
            step: [zero; 2],
            error: zero.constant(f32::INFINITY),
            linearized: direction,
            has_linearized: none,
        };
        Self { direction, best, failures: zero }
    }

    #[inline(always)]
    pub(crate) fn to_rows(self) -> [(V3<F>, F); 5] {
        let Self { direction, best, failures } = self;
        let is_linearized = failures.constant(1.0).only(best.has_linearized);
        let ([u, v], [x, y]) = (best.axes, best.step);
        [(direction, failures), (best.direction, best.error), (u, x), (v, y), (best.linearized, is_linearized)]
    }

    #[inline(always)]
    pub(crate) fn from_rows(rows: [(V3<F>, F); 5]) -> Self {
        let [(first, failures), (direction, error), (u, x), (v, y), (linearized, is_linearized)] = rows;
        let has_linearized = is_linearized.is_positive();
        let best = Best { direction, axes: [u, v], step: [x, y], error, linearized, has_linearized };
        Self { direction: first, best, failures }
    }
}

/// The misses of rays at lights.
#[derive(Clone, Copy, Debug)]
struct Residuals<F: Lanes> {
    /// Lanes whose light is ahead of the ray, and whose miss is corrected by a step.
    exists: F::Mask,
    /// Distance by which the ray misses the light, as a share of the straight distance or as an angle \[rad\].
    error: F,
    /// The Newton step \[rad\] that corrects the miss, along the unit vectors perpendicular to the first direction.
    step: [F; 2],
    /// Its length \[rad\].
    size: F,
    /// The derivatives at the light.
    jacobians: EndpointJacobians<F>,
}

/// The rays with the smallest misses so far.
#[derive(Clone, Copy, Debug)]
struct Best<F: Lanes> {
    /// First directions, and unit vectors perpendicular to them.
    direction: V3<F>,
    axes: [V3<F>; 2],
    /// The Newton steps of the rays \[rad\].
    step: [F; 2],
    /// Infinite in lanes without such a ray.
    error: F,
    /// The directions computed from their linearised chains, in lanes that have one.
    linearized: V3<F>,
    has_linearized: F::Mask,
}

impl<F: Lanes> Best<F> {
    /// Replaces the rays of some lanes.
    #[inline(always)]
    fn replace(&mut self, lanes: F::Mask, new: &Self) {
        self.direction = V3::select(lanes, new.direction, self.direction);
        for k in 0..2 {
            self.axes[k] = V3::select(lanes, new.axes[k], self.axes[k]);
            self.step[k] = lanes.select(new.step[k], self.step[k]);
        }
        self.error = lanes.select(new.error, self.error);
        self.linearized = V3::select(lanes, new.linearized, self.linearized);
        self.has_linearized = self.has_linearized & !lanes | lanes & new.has_linearized;
    }

    /// The next directions to trace after a number of failures: those of the linearised chains, then Newton's steps, then
    /// half of the steps and so on. Also the lanes that have one.
    #[inline(always)]
    fn next_directions(&self, failures: F) -> (V3<F>, F::Mask) {
        let one = failures.constant(1.0);
        let is_linearized = self.has_linearized & failures.lt(one);
        let halvings = failures - one.only(self.has_linearized);
        let mut scale = one;
        for halved in 0..MAX_HALVINGS {
            let half = scale * 0.5;
            scale = halvings.gt(one * halved as f32).select(half, scale);
        }
        let stepped = turned(self.direction, self.axes, [self.step[0] * scale, self.step[1] * scale]);
        let is_allowed = is_linearized | halvings.le(one * MAX_HALVINGS as f32);
        (V3::select(is_linearized, self.linearized, stepped), self.error.is_finite() & is_allowed)
    }
}

impl<F: Lanes> Endpoints<F> {
    /// The materials of the solids around the receivers.
    #[inline(always)]
    pub(crate) fn inside(&self, scene: &Scene) -> [Option<u32>; MAX_WIDTH] {
        let mut inside = [None; MAX_WIDTH];
        for (inside, enclosing) in inside.iter_mut().zip(&self.enclosing).take(F::WIDTH) {
            *inside = enclosing.material(scene);
        }
        inside
    }
}

/// The solver for chains between receivers and lights, one for each lane.
#[derive(Clone, Copy)]
pub(crate) struct Solver<'a, F: Lanes> {
    pub(crate) scene: &'a Scene,
    /// Instructions for rays.
    pub(crate) set: InstructionSet,
    pub(crate) token: F::Token,
    pub(crate) ends: &'a Endpoints<F>,
}

impl<F: Lanes> Solver<'_, F> {
    /// Lanes in which a direction leaves the receiver on the side of the straight line.
    #[inline(always)]
    fn is_same_hemisphere(&self, direction: V3<F>) -> F::Mask {
        let normal = self.ends.receivers.normal;
        !(normal.dot(direction).is_positive() ^ normal.dot(self.ends.targets.direction).is_positive())
    }

    /// Lanes in which the receiver can scatter light from a direction to the viewer, on the side of the straight line.
    #[inline(always)]
    fn can_scatter_from(&self, direction: V3<F>) -> F::Mask {
        self.ends.receivers.faces(direction) & self.is_same_hemisphere(direction)
    }

    /// Chooses a chain in proportion to its estimated contribution, in the lanes that have one.
    #[inline(always)]
    pub(crate) fn choose(&self, lanes: F::Mask, u: F) -> CandidateChains<F> {
        let ends = self.ends;
        let lanes = lanes & self.can_scatter_from(ends.targets.direction);
        let (from, inside) = (ends.receivers.point, ends.inside(self.scene));
        let mut chosen = self.scene.choose_chains(Wanted::Random(u), lanes, from, &inside, &ends.targets);
        chosen.is_some = chosen.is_some & self.can_scatter_from(chosen.direction);
        chosen
    }

    /// Newton's method on linearised chains of some lanes, starting at `direction`: the first directions of the chains if
    /// the faces continued as near the traced rays, and the lanes in which it converges.
    #[inline(never)]
    fn solve_linearized(&self, chains: &LinearizedChains<F>, lanes: F::Mask, mut direction: V3<F>) -> (V3<F>, F::Mask) {
        vectorize!(F, self.token, {
            let origin = self.ends.origin;
            let mut error = self.ends.time.constant(f32::INFINITY);
            let (mut running, mut converges) = (lanes, lanes);
            for _ in 0..MAX_LINEARIZED_STEPS {
                let (passes, [position, leaving], differentials) = chains.trace(origin, direction);
                let residuals = self.residuals(position, leaving, &differentials);
                let Residuals { exists, step, size, .. } = residuals;
                let is_better = passes & exists & residuals.error.lt(error) & size.lt(size.constant(MAX_STEP));
                converges = converges & (!running | is_better);
                running = running & is_better;
                error = running.select(residuals.error, error);
                direction = V3::select(running, turned(direction, differentials.axes, step), direction);
                running = running & size.gt(size.constant(LINEARIZED_TOLERANCE));
                if !running.any() {
                    break;
                }
            }
            (direction, converges)
        })
    }

    /// The misses of rays that leave the covers.
    #[inline(always)]
    fn residuals(&self, position: V3<F>, leaving: V3<F>, differentials: &RayDifferentials<F>) -> Residuals<F> {
        let Endpoints { targets, receivers, .. } = self.ends;
        let point = targets.point;
        let to_light = point - position;
        let distance = to_light.dot(leaving);
        let (is_infinite, one) = (!targets.is_finite, distance.constant(1.0));
        let is_ahead = distance.is_positive() | is_infinite;
        let miss = V3::select(is_infinite, targets.direction - leaving, to_light - leaving * distance);
        let scale = is_infinite.select(one, (point - receivers.point).length());
        let jacobians = differentials.jacobians(leaving, distance, !targets.is_finite);
        let [x, y] = jacobians.solve(miss);
        let step = [x, y];
        let exists = is_ahead & step[0].is_finite() & step[1].is_finite();
        let size = (x * x + y * y).sqrt();
        Residuals { exists, error: miss.length() / scale, step, size, jacobians }
    }
}

impl<F: Lanes> Traversal<'_, F> {
    /// The misses of traced chains.
    #[inline(always)]
    fn residuals(&self) -> Residuals<F> {
        let traced = &self.traced;
        let (position, leaving) = (traced.origin, traced.direction);
        let residuals = self.solver.residuals(position, leaving, &traced.differentials);
        Residuals { exists: residuals.exists & traced.exists, ..residuals }
    }

    /// Chains that have arrived, in lanes whose light leaves the right side of its surface.
    #[inline(always)]
    fn connections(&self, lanes: F::Mask, direction: V3<F>, residuals: &Residuals<F>) -> Connections<F> {
        let Endpoints { targets, receivers, light_normal, .. } = self.solver.ends;
        let area = residuals.jacobians.area();
        let line = targets.point - receivers.point;
        let square = line.length_squared();
        let cosines = self.traced.direction.dot(*light_normal) * square.sqrt() / line.dot(*light_normal);
        let solid_angle_ratio = targets.is_finite.select(square * cosines, area.constant(1.0)) / area;
        let has_converged = lanes & solid_angle_ratio.is_positive() & solid_angle_ratio.is_finite();
        Connections { has_converged, direction, step: residuals.size, solid_angle_ratio }
    }

    /// Continues the searches behind their traced rays; `ray` is their number, from one. Returns the chains that have arrived,
    /// and the lanes whose search goes on. The result depends only on receiver, light, stack and chain.
    #[inline(always)]
    pub(crate) fn advance(&mut self, ray: u32) -> (Connections<F>, F::Mask) {
        let (residuals, axes) = (self.residuals(), self.traced.differentials.axes);
        let Residuals { exists, error, step, size, .. } = residuals;
        let has_arrived = exists & error.le(error.constant(ERROR_TOLERANCE)) & size.le(size.constant(STEP_TOLERANCE));
        let arrived = turned(self.search.direction, axes, step);
        let connections = self.connections(has_arrived, arrived, &residuals);
        let Self { solver, lanes, search: Search { direction, best, failures }, linearized, .. } = self;
        let active = *lanes & !has_arrived;
        let is_better = active & exists & error.lt(best.error);
        *failures = (*failures + 1.0).only(!is_better);
        if is_better.any() {
            let scale = size.constant(1.0).min(size.recip() * MAX_STEP);
            let step = [step[0] * scale, step[1] * scale];
            let start = turned(*direction, axes, step);
            let (linearized, has_linearized) = solver.solve_linearized(linearized, is_better, start);
            best.replace(is_better, &Best { direction: *direction, axes, step, error, linearized, has_linearized });
        }
        let (next, has_next) = best.next_directions(*failures);
        let mut active = active & has_next & F::mask(solver.token, if ray < MAX_RAYS { u32::MAX } else { 0 });
        if ray >= EARLY_STOP_RAYS {
            active = active & best.error.lt(best.error.constant(EARLY_STOP_ERROR));
        }
        *direction = next;
        (connections, active)
    }
}

/// Directions turned by steps \[rad\] along two unit vectors perpendicular to them.
#[inline(always)]
fn turned<F: Lanes>(from: V3<F>, [a, b]: [V3<F>; 2], [x, y]: [F; 2]) -> V3<F> {
    (from + a * x + b * y).normalize()
}
