//! Traces chains of smooth interfaces from receivers through the real mesh.

use super::linearized_chain::{LinearizedChains, SpecularVertices};
use super::ray_differential::{Bend, RayDifferentials};
use super::{Endpoints, Solver};
use crate::ray_state::{EnclosingSolids, RayState};
use crate::scatterer::Scatterer;
use dunkelfeld_bsdf::{Bsdf, Dielectric, InLanes, Lobe, View};
use dunkelfeld_bvh::{HitBatch, NO_HIT, RayBatch};
use dunkelfeld_geometry::Ray;
use dunkelfeld_lanes::{Double, Lanes, MAX_WIDTH, Mask, V3};
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

    /// Replaces the chains of some lanes.
    #[inline(always)]
    pub(super) fn replace(&mut self, lanes: F::Mask, new: &Self) {
        self.exists = self.exists & !lanes | lanes & new.exists;
        self.origin = V3::select(lanes, new.origin, self.origin);
        self.direction = V3::select(lanes, new.direction, self.direction);
        self.weight = Rgb::select(lanes, new.weight, self.weight);
        self.probability = lanes.select(new.probability, self.probability);
        lanes.each(
            #[inline(always)]
            |lane| self.enclosing[lane] = new.enclosing[lane],
        );
    }

    /// The segment of a lane to its light.
    fn ray_state(&self, lane: usize, ray: Ray) -> RayState {
        RayState { ray, enclosing: self.enclosing[lane] }
    }
}

impl<F: Lanes> Solver<'_, F> {
    /// Traces the chains of some lanes through the interfaces of their stacks. A chain does not exist if another surface
    /// is in the way, if an interface is missed, or if light is reflected totally where it should be transmitted.
    /// Afterwards `linearized` has the interfaces that were hit.
    #[inline(never)]
    pub(super) fn trace_chains(
        &self,
        chains: &CandidateChains<F>,
        (lanes, direction): (F::Mask, V3<F>),
        linearized: &mut LinearizedChains<F>,
    ) -> TracedChains<F> {
        F::vectorize(
            self.token,
            #[inline(always)]
            || {
                *linearized = LinearizedChains::new(self.token);
                let mut traced = TracedChains::new(self.ends, lanes, direction);
                for event in 0..Chain::MAX_EVENTS {
                    let [mut has_event, mut is_reflection] = [0; 2];
                    traced.exists.each(
                        #[inline(always)]
                        |lane| {
                            has_event |= u32::from(event < chains.chain[lane].events()) << lane;
                            is_reflection |= u32::from(chains.chain[lane].is_reflection(event)) << lane;
                        },
                    );
                    let active = traced.exists & F::mask(self.token, has_event);
                    if !active.any() {
                        break;
                    }
                    let faces = self.next_faces(&traced, active, &chains.stack);
                    let is_reflection = F::mask(self.token, is_reflection);
                    self.pass_faces(&mut traced, &faces, (event as usize, active, is_reflection), linearized);
                }
                traced
            },
        )
    }

    /// The next faces on the way, in the lanes of `active`.
    #[inline(always)]
    fn next_faces(&self, traced: &TracedChains<F>, active: F::Mask, stacks: &[u16; MAX_WIDTH]) -> Faces<F> {
        let Solver { scene, token, ends, .. } = *self;
        let (hits, found) = self.closest_hits(traced, active);
        let one = hits.t.constant(1.0);
        let mut faces = Faces {
            found: F::mask(token, 0),
            points: scene.surface_points(token, &hits, ends.time),
            distance: hits.t,
            weight: Rgb::splat(one),
            open: one,
            interfaces: Vec::new(),
        };
        let parts = F::word_to_array(faces.points.part);
        let [mut at_face, mut others, mut absorbed] = [0; 3];
        (active & found).each(
            #[inline(always)]
            |lane| {
                let is_face = scene.cover_of_part(parts[lane]) == Some(stacks[lane]);
                match &traced.enclosing[lane] {
                    EnclosingSolids::Last(material) if is_face => {
                        at_face |= 1 << lane;
                        absorbed |= u32::from(material.is_some_and(|m| !scene.absorption(m).is_black())) << lane;
                    }
                    _ => others |= 1 << lane,
                }
            },
        );
        if absorbed != 0 {
            let (distances, mut passed) = (faces.distance.to_array(), [Rgb::WHITE; MAX_WIDTH]);
            F::mask(token, absorbed).each(
                #[inline(always)]
                |lane| passed[lane] = traced.enclosing[lane].transmittance(scene, distances[lane]),
            );
            faces.weight = Rgb::from_lanes(token, &passed);
        }
        faces.found = F::mask(token, at_face);
        if others != 0 {
            self.pass_surfaces(traced, &mut faces, (others, stacks));
        }
        faces
    }

    /// The nearest hits of the rays of some lanes, and the lanes that have one. Other lanes repeat one of them.
    #[inline(always)]
    fn closest_hits(&self, traced: &TracedChains<F>, active: F::Mask) -> (HitLanes<F>, F::Mask) {
        let (o, d, token) = (traced.origin, traced.direction, self.token);
        let [o, d] = [[o.x, o.y, o.z], [d.x, d.y, d.z]].map(
            #[inline(always)]
            |[x, y, z]| [x.to_array(), y.to_array(), z.to_array()],
        );
        let [ox, oy, oz] = &o;
        let [dx, dy, dz] = &d;
        let t_max = F::splat(token, f32::INFINITY).only(active).to_array();
        let rays = RayBatch {
            origin: [&ox[..F::WIDTH], &oy[..F::WIDTH], &oz[..F::WIDTH]],
            direction: [&dx[..F::WIDTH], &dy[..F::WIDTH], &dz[..F::WIDTH]],
            t_max: &t_max[..F::WIDTH],
            time: &self.ends.time.to_array(),
        };
        let [mut t, mut b1, mut b2] = [[0.0; MAX_WIDTH]; 3];
        let [mut instance, mut part, mut triangle] = [[0; MAX_WIDTH]; 3];
        let mut hits = HitBatch {
            t: &mut t,
            b1: &mut b1,
            b2: &mut b2,
            instance: &mut instance,
            part: &mut part,
            triangle: &mut triangle,
        };
        self.scene.bvh().closest_hits(self.set, &rays, &mut hits);
        let mut found = 0;
        for (lane, instance) in instance.iter().enumerate().take(F::WIDTH) {
            found |= u32::from(*instance != NO_HIT) << lane;
        }
        let found = active & F::mask(token, found);
        let first = found.bits().trailing_zeros() as usize % MAX_WIDTH;
        let ids = match found.any() {
            true => [instance[first], part[first], triangle[first]],
            false => [0; 3],
        };
        let [instance, part, triangle] = [(instance, ids[0]), (part, ids[1]), (triangle, ids[2])].map(
            #[inline(always)]
            |(own, other)| {
                let (own, other) = (F::load_word(token, &own), F::splat_word(token, other));
                found.select(F::from_bits(own), F::from_bits(other)).to_bits()
            },
        );
        let [t, b1, b2] = [F::load(token, &t), F::load(token, &b1), F::load(token, &b2)];
        (HitLanes { t, b1, b2, instance, part, triangle }, found)
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
