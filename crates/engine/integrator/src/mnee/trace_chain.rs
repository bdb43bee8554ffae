//! Traces chains of smooth interfaces from receivers through the real mesh.

use super::linearized_chain::{LinearizedChains, SpecularVertices};
use super::ray_differential::RayDifferentials;
use super::{Search, Solver};
use crate::ray_state::{EnclosingSolids, RayState};
use crate::scatterer::Scatterer;
use crate::wavefront::rays::{Hits, Rays};
use dunkelfeld_bsdf::{Bsdf, Dielectric, InLanes, Lobe, View};
use dunkelfeld_geometry::Ray;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3, vectorize};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Bsdfs, Chain, HitLanes, Interface, Scene, SurfacePoint, SurfacePoints};

/// The largest number below one. As a choice among two events it never selects the first.
const ALMOST_ONE: f32 = 1.0 - f32::EPSILON / 2.0;
/// Maximum number of surfaces without effect on the direction that one segment may pass.
const MAX_PASSED: u32 = 64;

/// Traced chains up to their last interfaces.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TracedChains<F: Lanes> {
    /// Lanes whose chain exists.
    pub(crate) exists: F::Mask,
    /// The segments to the lights.
    pub(crate) origin: V3<F>,
    pub(crate) direction: V3<F>,
    pub(crate) enclosing: [EnclosingSolids; MAX_WIDTH],
    pub(super) differentials: RayDifferentials<F>,
    /// Throughput of the chains: Fresnel factor of each event, change of radiance by refraction, tints, absorption, and
    /// the open share of partly covering surfaces.
    pub(crate) weight: Rgb<F>,
    /// The probability with which scattering takes the same events.
    pub(crate) probability: F,
}

/// The next faces of stacks that rays meet.
struct Faces<F: Lanes> {
    /// Lanes that meet one.
    found: F::Mask,
    points: SurfacePoints<F>,
    /// Distances from the last interface \[m\], and the transmittance up to the face, with the probability of it.
    distance: F,
    weight: Rgb<F>,
    open: F,
    /// Faces where several solids meet, with their lanes.
    interfaces: Vec<(usize, Interface)>,
}

/// The next face of a stack behind surfaces without effect on the direction.
struct Passed {
    point: SurfacePoint,
    interface: Option<Interface>,
    distance: f32,
    weight: Rgb,
    open: f32,
}

/// Most traversals whose rays are followed together.
pub(crate) const MAX_TRAVERSALS: usize = 8;

/// Chains on their way through the interfaces of their stacks, one for each lane.
pub(crate) struct Traversal<'a, F: Lanes> {
    pub(super) solver: Solver<'a, F>,
    chain: &'a [(u16, Chain); MAX_WIDTH],
    /// The lanes with a search.
    pub(crate) lanes: F::Mask,
    pub(crate) search: Search<F>,
    pub(crate) traced: TracedChains<F>,
    /// The interfaces that were hit.
    pub(super) linearized: LinearizedChains<F>,
}

impl<'a, F: Lanes> Traversal<'a, F> {
    /// The starts of the next rays of searches in some lanes, each for a chain of a stack.
    #[inline(always)]
    pub(crate) fn new(
        solver: Solver<'a, F>,
        (lanes, chain): (F::Mask, &'a [(u16, Chain); MAX_WIDTH]),
        search: &Search<F>,
    ) -> Self {
        let (ends, direction) = (solver.ends, search.direction);
        let one = ends.time.constant(1.0);
        let traced = TracedChains {
            exists: lanes & solver.is_same_hemisphere(direction),
            origin: ends.origin,
            direction,
            enclosing: ends.enclosing,
            differentials: RayDifferentials::from_point(direction),
            weight: Rgb::splat(one),
            probability: one,
        };
        Self { solver, chain, lanes, search: *search, traced, linearized: LinearizedChains::new(solver.token) }
    }

    /// The lanes whose chain has an event, and those where it is a reflection.
    #[inline(always)]
    fn event(&self, event: u32) -> [F::Mask; 2] {
        let [mut has_event, mut is_reflection] = [0; 2];
        for lane in self.traced.exists.lanes() {
            let (_, chain) = self.chain[lane];
            has_event |= u32::from(event < chain.events()) << lane;
            is_reflection |= u32::from(chain.is_reflection(event)) << lane;
        }
        [F::mask(self.solver.token, has_event), F::mask(self.solver.token, is_reflection)]
    }
}

/// Traces chains through the real mesh. A chain does not exist if another surface is in the way, if an interface is missed,
/// or if light is reflected totally where it should be transmitted.
#[inline(never)]
pub(crate) fn trace_chains<F: Lanes>(traversals: &mut [Traversal<'_, F>], Segments { rays, hits }: &mut Segments) {
    let Some(Solver { scene, set, token, .. }) = traversals.first().map(|traversal| traversal.solver) else { return };
    for event in 0..Chain::MAX_EVENTS {
        rays.clear();
        vectorize!(F, token, {
            for traversal in traversals.iter() {
                let (traced, [active, _]) = (&traversal.traced, traversal.event(event));
                let time = traversal.solver.ends.time;
                let segment = [traced.origin, traced.direction];
                rays.append((active, &[0; MAX_WIDTH]), segment, time.constant(f32::INFINITY), time);
            }
        });
        let count = rays.paths.len();
        if count == 0 {
            return;
        }
        scene.bvh().closest_hits(set, &rays.batch(), &mut hits.batch(count));
        let mut first = 0;
        vectorize!(F, token, {
            for traversal in traversals.iter_mut() {
                traversal.pass(event, hits, &mut first);
            }
        });
    }
}

/// The next segments of chains, and their hits.
#[derive(Debug)]
pub(crate) struct Segments {
    rays: Rays,
    hits: Hits,
}

impl Segments {
    pub(crate) fn new(scene: &Scene) -> Self {
        Self { rays: Rays::new(scene), hits: Hits::default() }
    }
}

impl<F: Lanes> Traversal<'_, F> {
    /// Passes the faces that the segments of an event have hit. `next` is the number of the next segment.
    #[inline(always)]
    fn pass(&mut self, event: u32, hits: &Hits, next: &mut u32) {
        let ([active, is_reflection], token) = (self.event(event), self.solver.token);
        let (mut segments, mut found) = ([0; MAX_WIDTH], 0);
        for lane in active.lanes() {
            segments[lane] = *next;
            found |= u32::from(hits.has(*next)) << lane;
            *next += 1;
        }
        self.traced.exists = self.traced.exists & (!active | F::mask(token, found));
        if found != 0 {
            // Other lanes repeat a hit.
            let one = segments[found.trailing_zeros() as usize % MAX_WIDTH];
            for (lane, segment) in segments.iter_mut().enumerate() {
                if found >> lane & 1 == 0 {
                    *segment = one;
                }
            }
            let faces = self.next_faces(F::mask(token, found), &hits.lanes(token, &segments));
            self.pass_faces(&faces, active, is_reflection);
        }
    }

    /// The next faces on the way, in lanes with hits.
    #[inline(always)]
    fn next_faces(&self, lanes: F::Mask, hits: &HitLanes<F>) -> Faces<F> {
        let Self { solver: Solver { scene, token, ends, .. }, traced, .. } = *self;
        let mut faces = Faces {
            found: lanes,
            points: scene.surface_points(token, hits, ends.time),
            distance: hits.t,
            weight: EnclosingSolids::transmittances(&traced.enclosing, scene, hits.t),
            open: hits.t.constant(1.0),
            interfaces: Vec::new(),
        };
        let parts = F::word_to_array(faces.points.part);
        let mut others = 0;
        for lane in lanes.lanes() {
            let is_face = scene.cover_of_part(parts[lane]) == Some(self.chain[lane].0);
            let is_single = matches!(traced.enclosing[lane], EnclosingSolids::Last(_));
            others |= u32::from(!(is_face && is_single)) << lane;
        }
        if others != 0 {
            self.pass_surfaces(&mut faces, others);
        }
        faces
    }

    /// Passes surfaces without effect on the direction, in lanes that meet one or that may be in several solids.
    #[inline(never)]
    fn pass_surfaces(&self, faces: &mut Faces<F>, lanes: u32) {
        let Self { solver: Solver { token, ends, .. }, traced, .. } = self;
        let (origins, directions) = (traced.origin.to_lanes(), traced.direction.to_lanes());
        let (times, mut distances) = (ends.time.to_array(), faces.distance.to_array());
        let (mut weights, mut open) = (faces.weight.to_lanes(), faces.open.to_array());
        let mut found = faces.found.bits() & !lanes;
        let mut points = [faces.points.lane(0); MAX_WIDTH];
        for (lane, point) in points.iter_mut().enumerate().take(F::WIDTH) {
            *point = faces.points.lane(lane);
            if lanes >> lane & 1 == 0 {
                continue;
            }
            let ray = Ray::new(origins[lane], directions[lane]).at_time(times[lane]);
            let start = RayState { ray, enclosing: traced.enclosing[lane] };
            let Some(passed) = self.next_face(&start, *point, self.chain[lane].0) else { continue };
            *point = passed.point;
            (distances[lane], weights[lane], open[lane]) = (passed.distance, passed.weight, passed.open);
            faces.interfaces.extend(passed.interface.map(|interface| (lane, interface)));
            found |= 1 << lane;
        }
        faces.points = SurfacePoints::from_lanes(*token, &points);
        faces.distance = F::load(*token, &distances);
        faces.weight = Rgb::from_lanes(*token, &weights);
        faces.open = F::load(*token, &open);
        faces.found = F::mask(*token, found);
    }

    /// The next face of a stack along a ray whose first surface is given; `None` if another surface is in the way.
    fn next_face(&self, start: &RayState, mut surface: SurfacePoint, stack: u16) -> Option<Passed> {
        let scene = self.solver.scene;
        let (mut ray_state, mut distance, mut weight, mut open) = (*start, 0.0, Rgb::WHITE, 1.0);
        for _ in 0..=MAX_PASSED {
            let mut interface = None;
            let hit = ray_state.hit_at(scene, surface, &mut interface);
            weight *= ray_state.enclosing.transmittance(scene, hit.surface.distance);
            distance += hit.surface.distance;
            let is_cover = scene.cover_of(&hit.surface) == Some(stack);
            match hit.open_tint() {
                Some(tint) => weight *= tint,
                None if is_cover => return Some(Passed { point: hit.surface, interface, distance, weight, open }),
                None => {
                    let direction = ray_state.ray.direction;
                    let mut its = 1.0 - scene.coverage(&hit.surface, direction);
                    // A surface in contact with one that is passed lets light pass as well, or is in the way.
                    let mut last = None;
                    while let Some(point) = scene.next_coincident(&ray_state.ray, hit.surface, last) {
                        its *= 1.0 - scene.coverage(&point, direction);
                        last = Some(point);
                    }
                    if its == 0.0 {
                        return None;
                    }
                    weight *= its;
                    open *= its;
                }
            }
            ray_state = ray_state.pass_through(&hit);
            surface = scene.intersect(&ray_state.ray)?;
        }
        None
    }

    /// Reflects and refracts rays at their faces, in the lanes of an event.
    #[inline(always)]
    fn pass_faces(&mut self, faces: &Faces<F>, active: F::Mask, is_reflection: F::Mask) {
        let Self { solver: Solver { scene, token, .. }, traced, .. } = self;
        let token = *token;
        let (points, from) = (&faces.points, traced.direction);
        let mut wi = from;
        let (zero, one) = (from.x.constant(0.0), from.x.constant(1.0));
        let (mut normals, mut passes) = (points.normal, F::mask(token, 0));
        let (mut weight, mut pdf, mut eta) = (traced.weight * faces.weight, one, one);
        let materials = F::word_to_array(points.material);
        let (mut left, mut etas) = (faces.found.bits(), [None; MAX_WIDTH]);
        for (lane, interface) in &faces.interfaces {
            etas[*lane] = interface.relative_index();
        }
        // The faces of each material, which is one in general.
        while left != 0 {
            let material = materials[left.trailing_zeros() as usize % MAX_WIDTH];
            let same = F::word_eq(points.material, F::splat_word(token, material));
            let mut storage = [const { None }; MAX_WIDTH];
            let bsdfs = scene.bsdfs(material, points, (&[], &etas), &mut storage);
            let Some((surfaces, its)) = dielectrics(&bsdfs) else { break };
            let frames = scene.shade_lanes(material, points, -from).frames;
            let surface = InLanes::<F>::gather(token, &surfaces);
            let at = Scatterer { frames, view: surface.view(frames.frame.to_local(-from)) };
            let sample = at.view.sample(is_reflection.select(zero, from.x.constant(ALMOST_ONE)), [zero; 2]);
            let direction = at.frames.frame.to_world(sample.wi);
            let reflection = F::splat_word(token, Lobe::REFLECTION.bits());
            let is_reflected = F::word_eq(sample.lobe & reflection, reflection);
            let is_possible = sample.pdf.is_positive() & at.frames.consistent(direction, sample.wi);
            passes = passes | same & F::mask(token, its) & is_possible & !(is_reflected ^ is_reflection);
            wi = V3::select(same, direction, wi);
            normals = V3::select(same, at.frames.frame.normal, normals);
            weight = Rgb::select(same, weight * sample.weight * sample.pdf, weight);
            pdf = same.select(sample.pdf, pdf);
            eta = (same & !is_reflection).select(sample.eta, eta);
            left &= !same.bits();
        }
        let (is_turned, differential) = scene.normal_differentials(token, points, -from, normals);
        let passes = active & faces.found & passes & !is_turned;
        traced.exists = traced.exists & (!active | passes);
        let vertices = SpecularVertices {
            lanes: passes,
            point: points.point,
            geometric_normal: points.normal,
            normal: normals,
            differential,
            eta,
            is_reflection,
        };
        let (distance, directions) = (faces.distance, [from, wi]);
        traced.differentials = traced.differentials.behind(&vertices, distance, normals, directions);
        self.linearized.push(vertices);
        traced.weight = Rgb::select(passes, weight, traced.weight);
        traced.probability = passes.select(traced.probability * faces.open * pdf, traced.probability);
        traced.origin = V3::select(passes, points.ray_origins(wi), traced.origin);
        traced.direction = V3::select(passes, wi, traced.direction);
        let from_inside = from.dot(points.normal).is_positive().bits();
        let inward = wi.dot(points.normal).lt(zero).bits();
        for lane in passes.lanes() {
            let [from_inside, inward] = [from_inside, inward].map(|bits| bits >> lane & 1 == 1);
            let solid = Some(materials[lane]);
            traced.enclosing[lane] = traced.enclosing[lane].beyond(solid, from_inside, inward);
        }
        if !faces.interfaces.is_empty() {
            let directions = wi.to_lanes();
            for (lane, interface) in &faces.interfaces {
                traced.enclosing[*lane] = EnclosingSolids::All(interface.beyond(directions[*lane]));
            }
        }
    }
}

/// The smooth boundaries of clear solids, and the lanes that have one. Other lanes repeat one of them.
fn dielectrics<'b>(bsdfs: &Bsdfs<'b>) -> Option<([&'b Dielectric; MAX_WIDTH], u32)> {
    let each = match bsdfs {
        Bsdfs::Same(bsdf) => return Some(([smooth(bsdf)?; MAX_WIDTH], u32::MAX)),
        Bsdfs::Each(each) => each.map(smooth),
    };
    let first = *each.iter().flatten().next()?;
    let lanes = (0..).zip(&each).fold(0, |bits, (lane, found)| bits | u32::from(found.is_some()) << lane);
    Some((each.map(|surface| surface.unwrap_or(first)), lanes))
}

/// The smooth boundary of a clear solid.
#[inline(always)]
fn smooth(bsdf: &Bsdf) -> Option<&Dielectric> {
    match bsdf {
        Bsdf::Dielectric(surface) if surface.is_delta() => Some(surface),
        _ => None,
    }
}
