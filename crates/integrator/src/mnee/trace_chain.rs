//! Traces chains of smooth interfaces from receivers through the real mesh.

use super::linearized_chain::{LinearizedChains, SpecularVertices};
use super::ray_differential::{Bend, RayDifferentials};
use super::{Endpoints, Solver};
use crate::ray_state::{EnclosingSolids, RayState};
use crate::scatterer::Scatterer;
use dunkelfeld_bsdf::{Bsdf, Dielectric, InLanes, Lobe, View};
use dunkelfeld_bvh::{HitBatch, NO_HIT, RayBatch};
use dunkelfeld_geometry::Ray;
use dunkelfeld_lanes::{Double, InstructionSet, Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{CandidateChains, Chain, HitLanes, Interface, Scene, SurfacePoint, SurfacePoints};

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

impl<F: Lanes> TracedChains<F> {
    /// The starts of chains in given directions.
    #[inline(always)]
    pub(super) fn new(ends: &Endpoints<F>, exists: F::Mask, direction: V3<F>) -> Self {
        let one = ends.time.constant(1.0);
        Self {
            exists,
            origin: ends.origin,
            direction,
            enclosing: ends.enclosing,
            differentials: RayDifferentials::from_point(direction),
            weight: Rgb::splat(one),
            probability: one,
        }
    }

    /// The segment of a lane to its light.
    fn ray_state(&self, lane: usize, ray: Ray) -> RayState {
        RayState { ray, enclosing: self.enclosing[lane] }
    }
}

/// Most traversals whose rays are followed together.
pub(crate) const MAX_TRAVERSALS: usize = 8;
/// Most segments of chains in one batch of rays.
const MAX_SEGMENTS: usize = MAX_TRAVERSALS * MAX_WIDTH;

/// Chains on their way through the interfaces of their stacks, one for each lane.
pub(crate) struct Traversal<'a, F: Lanes> {
    pub(super) solver: Solver<'a, F>,
    chains: &'a CandidateChains<F>,
    pub(super) traced: TracedChains<F>,
    /// The interfaces that were hit.
    pub(super) linearized: LinearizedChains<F>,
}

impl<'a, F: Lanes> Traversal<'a, F> {
    /// The starts of chains of some lanes in given directions.
    #[inline(always)]
    pub(crate) fn new(solver: &Solver<'a, F>, chains: &'a CandidateChains<F>, lanes: F::Mask, from: V3<F>) -> Self {
        let traced = TracedChains::new(solver.ends, lanes & solver.is_same_hemisphere(from), from);
        Self { solver: *solver, chains, traced, linearized: LinearizedChains::new(solver.token) }
    }

    /// The lanes whose chain has an event, and those where it is a reflection.
    #[inline(always)]
    fn event(&self, event: u32) -> [u32; 2] {
        let [mut has_event, mut is_reflection] = [0; 2];
        self.traced.exists.each(
            #[inline(always)]
            |lane| {
                let chain = self.chains.chain[lane];
                has_event |= u32::from(event < chain.events()) << lane;
                is_reflection |= u32::from(chain.is_reflection(event)) << lane;
            },
        );
        [has_event, is_reflection]
    }
}

/// Traces chains through the real mesh. A chain does not exist if another surface is in the way, if an interface is missed,
/// or if light is reflected totally where it should be transmitted.
#[inline(never)]
pub(crate) fn trace_chains<F: Lanes>(traversals: &mut [Traversal<'_, F>]) {
    let Some(Solver { scene, set, token, .. }) = traversals.first().map(|traversal| traversal.solver) else { return };
    let mut segments = Segments::default();
    let count = traversals.len() * F::WIDTH;
    for event in 0..Chain::MAX_EVENTS {
        let mut lanes = [[0; 2]; MAX_TRAVERSALS];
        F::vectorize(
            token,
            #[inline(always)]
            || {
                for (number, traversal) in traversals.iter().enumerate() {
                    lanes[number] = traversal.event(event);
                    segments.set(number * F::WIDTH, traversal, F::mask(token, lanes[number][0]));
                }
            },
        );
        if lanes.iter().all(|[has_event, _]| *has_event == 0) {
            return;
        }
        segments.trace(scene, set, count);
        F::vectorize(
            token,
            #[inline(always)]
            || {
                for (number, traversal) in traversals.iter_mut().enumerate() {
                    let [active, is_reflection] = lanes[number].map(
                        #[inline(always)]
                        |bits| F::mask(token, bits),
                    );
                    if active.any() {
                        let Traversal { solver, chains, traced, linearized } = traversal;
                        let hits = segments.hits(token, number * F::WIDTH, active);
                        let faces = solver.next_faces(traced, (active, hits), &chains.stack);
                        solver.pass_faces(traced, &faces, (event as usize, active, is_reflection), linearized);
                    }
                }
            },
        );
    }
}

/// The next segments of chains, and their hits.
struct Segments {
    /// Coordinates of the origins and directions, ends and times.
    rays: [[f32; MAX_SEGMENTS]; 8],
    /// Distances and barycentric weights.
    numbers: [[f32; MAX_SEGMENTS]; 3],
    /// Instances, parts and triangles.
    ids: [[u32; MAX_SEGMENTS]; 3],
}

impl Default for Segments {
    fn default() -> Self {
        Self { rays: [[0.0; MAX_SEGMENTS]; 8], numbers: [[0.0; MAX_SEGMENTS]; 3], ids: [[0; MAX_SEGMENTS]; 3] }
    }
}

impl Segments {
    /// Sets the rays of some lanes. The others hit nothing.
    #[inline(always)]
    fn set<F: Lanes>(&mut self, first: usize, traversal: &Traversal<'_, F>, active: F::Mask) {
        let (o, d, time) = (traversal.traced.origin, traversal.traced.direction, traversal.solver.ends.time);
        let numbers = [o.x, o.y, o.z, d.x, d.y, d.z, time.constant(f32::INFINITY).only(active), time];
        for (number, column) in numbers.into_iter().zip(&mut self.rays) {
            number.store(&mut column[first..]);
        }
    }

    fn trace(&mut self, scene: &Scene, set: InstructionSet, count: usize) {
        let Self { rays, numbers, ids } = self;
        let [ox, oy, oz, dx, dy, dz, t_max, time] = rays.each_ref().map(|column| &column[..count]);
        let [t, b1, b2] = numbers.each_mut().map(|column| &mut column[..count]);
        let [instance, part, triangle] = ids.each_mut().map(|column| &mut column[..count]);
        let rays = RayBatch { origin: [ox, oy, oz], direction: [dx, dy, dz], t_max, time };
        scene.bvh().closest_hits(set, &rays, &mut HitBatch { t, b1, b2, instance, part, triangle });
    }

    /// The hits of some lanes, and the lanes that have one. Other lanes repeat one of them.
    #[inline(always)]
    fn hits<F: Lanes>(&self, token: F::Token, first: usize, active: F::Mask) -> (HitLanes<F>, F::Mask) {
        let Self { numbers, ids, .. } = self;
        let mut found = 0;
        for (lane, instance) in ids[0][first..first + F::WIDTH].iter().enumerate() {
            found |= u32::from(*instance != NO_HIT) << lane;
        }
        let found = active & F::mask(token, found);
        let one = first + found.bits().trailing_zeros() as usize % MAX_WIDTH % F::WIDTH;
        let [instance, part, triangle] = [&ids[0], &ids[1], &ids[2]].map(
            #[inline(always)]
            |ids| {
                let other = if found.any() { ids[one] } else { 0 };
                let (own, other) = (F::load_word(token, &ids[first..]), F::splat_word(token, other));
                found.select(F::from_bits(own), F::from_bits(other)).to_bits()
            },
        );
        let [t, b1, b2] = [&numbers[0], &numbers[1], &numbers[2]].map(
            #[inline(always)]
            |column| F::load(token, &column[first..]),
        );
        (HitLanes { t, b1, b2, instance, part, triangle }, found)
    }
}

impl<F: Lanes> Solver<'_, F> {
    /// The next faces on the way, in the lanes of `active`.
    #[inline(always)]
    fn next_faces(
        &self,
        traced: &TracedChains<F>,
        (active, (hits, found)): (F::Mask, (HitLanes<F>, F::Mask)),
        stacks: &[u16; MAX_WIDTH],
    ) -> Faces<F> {
        let Solver { scene, token, ends, .. } = *self;
        let one = hits.t.constant(1.0);
        let mut faces = Faces {
            found: F::mask(token, 0),
            points: scene.surface_points(token, &hits, ends.time),
            distance: hits.t,
            weight: EnclosingSolids::transmittances(&traced.enclosing, scene, hits.t),
            open: one,
            interfaces: Vec::new(),
        };
        let parts = F::word_to_array(faces.points.part);
        let [mut at_face, mut others] = [0; 2];
        (active & found).each(
            #[inline(always)]
            |lane| {
                let is_face = scene.cover_of_part(parts[lane]) == Some(stacks[lane]);
                let is_single = matches!(traced.enclosing[lane], EnclosingSolids::Last(_));
                at_face |= u32::from(is_face && is_single) << lane;
                others |= u32::from(!(is_face && is_single)) << lane;
            },
        );
        faces.found = F::mask(token, at_face);
        if others != 0 {
            self.pass_surfaces(traced, &mut faces, (others, stacks));
        }
        faces
    }

    /// Passes surfaces without effect on the direction, in lanes that meet one or that may be in several solids.
    #[inline(never)]
    fn pass_surfaces(&self, traced: &TracedChains<F>, faces: &mut Faces<F>, (lanes, stacks): (u32, &[u16; MAX_WIDTH])) {
        let (origins, directions) = (traced.origin.to_lanes(), traced.direction.to_lanes());
        let (times, mut distances) = (self.ends.time.to_array(), faces.distance.to_array());
        let (mut weights, mut open, mut found) = (faces.weight.to_lanes(), faces.open.to_array(), faces.found.bits());
        let mut points = [faces.points.lane(0); MAX_WIDTH];
        for (lane, point) in points.iter_mut().enumerate().take(F::WIDTH) {
            *point = faces.points.lane(lane);
            if lanes >> lane & 1 == 0 {
                continue;
            }
            let ray = Ray::new(origins[lane], directions[lane]).at_time(times[lane]);
            let Some(passed) = self.pass(&traced.ray_state(lane, ray), *point, stacks[lane]) else { continue };
            *point = passed.point;
            (distances[lane], weights[lane], open[lane]) = (passed.distance, passed.weight, passed.open);
            faces.interfaces.extend(passed.interface.map(|interface| (lane, interface)));
            found |= 1 << lane;
        }
        faces.points = SurfacePoints::from_lanes(self.token, &points);
        faces.distance = F::load(self.token, &distances);
        faces.weight = Rgb::from_lanes(self.token, &weights);
        faces.open = F::load(self.token, &open);
        faces.found = F::mask(self.token, found);
    }

    /// The next face of a stack along a ray whose first surface is given; `None` if another surface is in the way.
    fn pass(&self, start: &RayState, mut surface: SurfacePoint, stack: u16) -> Option<Passed> {
        let scene = self.scene;
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
    fn pass_faces(
        &self,
        traced: &mut TracedChains<F>,
        faces: &Faces<F>,
        (event, active, is_reflection): (usize, F::Mask, F::Mask),
        linearized: &mut LinearizedChains<F>,
    ) {
        let Solver { scene, token, .. } = *self;
        let (points, from) = (&faces.points, traced.direction);
        let mut wi = from;
        let (zero, one) = (from.x.constant(0.0), from.x.constant(1.0));
        let (mut normals, mut passes) = (points.normal, F::mask(token, 0));
        let (mut weight, mut pdf, mut eta) = (traced.weight * faces.weight, one, one);
        let materials = F::word_to_array(points.material);
        let mut left = faces.found.bits();
        // The faces of each material, which is one in general.
        while left != 0 {
            let material = materials[left.trailing_zeros() as usize % MAX_WIDTH];
            let same = F::word_eq(points.material, F::splat_word(token, material));
            let mut storage = [const { None }; MAX_WIDTH];
            let interfaces = &faces.interfaces;
            let Some((surfaces, its)) = self.dielectrics(material, points, interfaces, &mut storage) else { break };
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
        let mut differentials = traced.differentials;
        let bend = Bend {
            before: from.widen(),
            behind: wi.widen(),
            normal: normals.widen(),
            differential,
            eta: Double::widen(eta),
            is_reflection: F::Double::widen_mask(is_reflection),
        };
        differentials.transfer(bend.before, Double::widen(faces.distance), points.normal.widen());
        differentials.bend(&bend);
        traced.differentials = RayDifferentials::select(passes, differentials, traced.differentials);
        linearized.set(
            event,
            &SpecularVertices {
                lanes: passes,
                point: points.point,
                geometric_normal: points.normal,
                normal: normals,
                differential,
                eta,
                is_reflection,
            },
        );
        traced.weight = Rgb::select(passes, weight, traced.weight);
        traced.probability = passes.select(traced.probability * faces.open * pdf, traced.probability);
        traced.origin = V3::select(passes, points.ray_origins(wi), traced.origin);
        traced.direction = V3::select(passes, wi, traced.direction);
        let from_inside = from.dot(points.normal).is_positive().bits();
        let inward = wi.dot(points.normal).lt(zero).bits();
        passes.each(
            #[inline(always)]
            |lane| {
                let [from_inside, inward] = [from_inside, inward].map(|bits| bits >> lane & 1 == 1);
                let solid = Some(materials[lane]);
                traced.enclosing[lane] = traced.enclosing[lane].beyond(solid, from_inside, inward);
            },
        );
        if !faces.interfaces.is_empty() {
            let directions = wi.to_lanes();
            for (lane, interface) in &faces.interfaces {
                traced.enclosing[*lane] = EnclosingSolids::All(interface.beyond(directions[*lane]));
            }
        }
    }

    /// The smooth boundaries of clear solids at faces of one material, and the lanes that have one. Other lanes repeat one
    /// of them.
    #[inline(always)]
    fn dielectrics<'b>(
        &'b self,
        material: u32,
        points: &SurfacePoints<F>,
        interfaces: &[(usize, Interface)],
        storage: &'b mut [Option<Bsdf>; MAX_WIDTH],
    ) -> Option<([&'b Dielectric; MAX_WIDTH], u32)> {
        if interfaces.is_empty()
            && let Some(bsdf) = self.scene.only_bsdf(material)
        {
            return Some(([smooth(bsdf)?; MAX_WIDTH], u32::MAX));
        }
        each_dielectric(self.scene, points, interfaces, storage)
    }
}

#[inline(never)]
fn each_dielectric<'b, F: Lanes>(
    scene: &'b Scene,
    points: &SurfacePoints<F>,
    interfaces: &[(usize, Interface)],
    storage: &'b mut [Option<Bsdf>; MAX_WIDTH],
) -> Option<([&'b Dielectric; MAX_WIDTH], u32)> {
    let mut found = [None; MAX_WIDTH];
    for (lane, (found, storage)) in found.iter_mut().zip(storage).enumerate().take(F::WIDTH) {
        let interface = interfaces.iter().find(|(its, _)| *its == lane);
        let eta = interface.and_then(|(_, interface)| interface.relative_index());
        *found = smooth(scene.bsdf(&points.lane(lane), 0.0, eta, storage));
    }
    let first = found.iter().flatten().next()?;
    let lanes = (0..).zip(&found).fold(0, |bits, (lane, found)| bits | u32::from(found.is_some()) << lane);
    Some((found.map(|surface| surface.unwrap_or(first)), lanes))
}

/// The smooth boundary of a clear solid.
#[inline(always)]
fn smooth(bsdf: &Bsdf) -> Option<&Dielectric> {
    match bsdf {
        Bsdf::Dielectric(surface) if surface.is_delta() => Some(surface),
        _ => None,
    }
}
