//! Interfaces between solids: coincident faces form one interface, and ranks decide in overlaps.
//!
//! A path stores the set of solids around the start of its ray (an [`Interior`]). Every change of position changes the
//! set by the faces that were crossed. The crossed faces are determined by the exact sides of start and end of each
//! step. The arithmetic is the same with which the hierarchy decides if a hit lies before or behind a ray's origin. So
//! a face within the rounding error of another one, which a ray leaving the surface steps over, is crossed as well. No
//! face is missed, none counts twice, in any order of the file, and no tolerance is needed.
//!
//! The solid of the highest rank fills a place (Schmidt and Budge 2002). A face has no effect on light if the same
//! solid fills both sides.

use crate::Interior;
use crate::media::medium::Medium;
use crate::media::solid::Solid;
use crate::query::intersect::SurfacePoint;
use crate::scene::{Part, Scene};
use dunkelfeld_geometry::triangle::plane_distance_f64;
use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_radiometry::Rgb;
use std::collections::HashMap;

/// No solid: marks parts that bound nothing.
pub(crate) const NO_SOLID: u32 = u32::MAX;

/// Maximum number of coincident faces at one place; further ones are ignored.
const MAX_FACES: usize = 16;

/// Directions of the rays that find the solids around a point. None is near an axis or a diagonal.
const PROBE_DIRECTIONS: [Vec3; 3] = [
    Vec3::new(0.267_261_24, 0.534_522_5, 0.801_783_7),
    Vec3::new(-0.811_107_1, 0.324_442_84, 0.486_664_27),
    Vec3::new(0.123_091_49, -0.861_640_4, -0.492_365_96),
];

/// Effect of a face between two places on light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Boundary {
    /// Only a tint. Either the same solid fills both sides, or a clear face separates solids of the same index.
    Open {
        /// Factor on the light that passes; white where no solid ends.
        tint: Rgb,
    },
    /// An interface of this index of refraction, on the inside of the surface over the outside.
    Between {
        /// Inside over outside.
        eta: f32,
    },
    /// The surface bounds no solid.
    Surface,
}

/// The intersection of a ray with a face and with all faces that coincide with it.
#[derive(Clone, Copy, Debug)]
pub struct Interface {
    /// The surface that provides the material, at the position of the hit.
    pub surface: SurfacePoint,
    /// Its effect on light.
    pub boundary: Boundary,
    near: Interior,
    far: Interior,
    /// True if the ray runs along the surface's normal.
    outward: bool,
}

impl Interface {
    /// The solids around the start of a ray that leaves the surface in a direction.
    #[inline]
    pub fn beyond(&self, direction: Vec3) -> Interior {
        if (direction.dot(self.surface.normal) > 0.0) == self.outward { self.far } else { self.near }
    }

    /// The index of refraction inside the surface over that outside, if two solids meet here.
    #[inline]
    pub fn relative_index(&self) -> Option<f32> {
        match self.boundary {
            Boundary::Between { eta } => Some(eta),
            _ => None,
        }
    }

    /// The solids on the far side.
    #[inline]
    pub fn far(&self) -> Interior {
        self.far
    }
}

/// One of several coincident faces.
#[derive(Clone, Copy)]
struct Face {
    point: SurfacePoint,
    solid: u32,
    /// True if the ray enters the solid through it.
    enters: bool,
}

impl Scene {
    /// The medium that fills a place.
    #[inline]
    pub fn medium(&self, inside: &Interior) -> Option<&Medium> {
        Some(&self.solids.get(inside.top()? as usize)?.medium)
    }

    /// Index of the material whose solid fills a place.
    pub fn material_inside(&self, inside: &Interior) -> Option<u32> {
        Some(self.solids.get(inside.top()? as usize)?.material)
    }

    /// True if two solids could touch or overlap.
    pub fn has_nesting(&self) -> bool {
        self.has_nesting
    }

    /// True if light could pass the face of a solid straight, because the index of refraction is the same on both
    /// sides.
    pub fn has_open_faces(&self) -> bool {
        self.has_open_faces
    }

    /// The index of refraction of the solid that fills a place; 1 outside of solids.
    #[inline]
    fn index_of(&self, inside: &Interior) -> f32 {
        inside.top().and_then(|s| self.solids.get(s as usize)).map_or(1.0, |s| s.ior)
    }

    /// True if a point of render space lies in the box around all solids. Other points are outside of all of them.
    #[inline]
    pub fn may_be_inside(&self, point: Vec3) -> bool {
        self.solid_bounds.is_some_and(|[lo, hi]| point.cmpge(lo).all() && point.cmple(hi).all())
    }

    /// The solids that contain a point in render space.
    ///
    /// For each solid the crossings of a ray from the point to the outside are counted, outward faces minus inward
    /// ones. Three rays in fixed directions are used, and the median counts.
    pub fn interior_at(&self, point: Vec3) -> Interior {
        self.interior_at_time(point, 0.0)
    }

    /// [`Self::interior_at`] with moving objects at a time \[s\].
    pub fn interior_at_time(&self, point: Vec3, time: f32) -> Interior {
        let mut interior = Interior::OUTSIDE;
        if !self.may_be_inside(point) {
            return interior;
        }
        let mut counts: Vec<(u32, [i32; 3])> = Vec::new();
        for (way, direction) in PROBE_DIRECTIONS.into_iter().enumerate() {
            self.bvh.each_hit(&Ray::new(point, direction).at_time(time), |hit| {
                let p = self.surface_point(&hit, time);
                let solid = self.parts[p.part as usize].solid;
                if solid == NO_SOLID {
                    return;
                }
                let out = if direction.dot(p.normal) > 0.0 { 1 } else { -1 };
                match counts.iter_mut().find(|(s, _)| *s == solid) {
                    Some((_, count)) => count[way] += out,
                    None => {
                        let mut count = [0; 3];
                        count[way] = out;
                        counts.push((solid, count));
                    }
                }
            });
        }
        for (solid, mut count) in counts {
            count.sort_unstable();
            (0..count[1]).for_each(|_| interior.enter(solid));
        }
        interior
    }

    /// The interface at the hit of a ray that starts `inside`.
    #[inline]
    pub fn interface(&self, ray: &Ray, hit: &SurfacePoint, inside: &Interior) -> Interface {
        if self.has_nesting { self.shared_interface(ray, hit, inside) } else { self.lone_interface(ray, hit, inside) }
    }

    /// The interface, where other faces may coincide with the hit.
    fn shared_interface(&self, ray: &Ray, hit: &SurfacePoint, inside: &Interior) -> Interface {
        let part = &self.parts[hit.part as usize];
        let outward = ray.direction.dot(hit.normal) > 0.0;
        let pass = |surface: &SurfacePoint, boundary| Interface {
            surface: *surface,
            boundary,
            near: *inside,
            far: *inside,
            outward: ray.direction.dot(surface.normal) > 0.0,
        };
        if part.solid == NO_SOLID {
            return pass(hit, Boundary::Surface);
        }
        let mut faces = [Face { point: *hit, solid: part.solid, enters: !outward }; MAX_FACES];
        let mut count = 1;
        self.each_face_near(ray, hit, |point| {
            let same = point.part == hit.part && point.triangle == hit.triangle;
            if !same && count < MAX_FACES {
                let enters = ray.direction.dot(point.normal) < 0.0;
                faces[count] = Face { point, solid: self.parts[point.part as usize].solid, enters };
                count += 1;
            }
        });
        let faces = &faces[..count];
        let sides = self.sides(ray, hit, faces, inside);
        let Some(face) = self.dominant_face(ray, hit, faces, inside, &sides.1) else {
            return self.assemble(ray, hit, inside, sides);
        };
        if face.solid == NO_SOLID {
            return pass(&face.point, Boundary::Surface);
        }
        // Position and error of the hit, with material and normal of the other face.
        let surface = SurfacePoint { point: hit.point, error: hit.error, distance: hit.distance, ..face.point };
        let sides = self.sides(ray, &surface, faces, inside);
        self.assemble(ray, &surface, inside, sides)
    }

    /// The face that provides the material, if it is not the first one: an opaque face in contact with the solid, else
    /// that of the solid of higher rank.
    fn dominant_face<'a>(
        &self,
        ray: &Ray,
        hit: &SurfacePoint,
        faces: &'a [Face],
        inside: &Interior,
        far: &Interior,
    ) -> Option<&'a Face> {
        let opaque = |f: &&Face| {
            let compiled = &self.compiled[self.parts[f.point.part as usize].material as usize];
            f.solid == NO_SOLID && !compiled.both_sides && !compiled.has_coverage
        };
        let end = hit.ray_origin(ray.direction);
        if let Some(face) = faces.iter().filter(opaque).find(|f| self.crosses(ray, end, &f.point, true)) {
            return Some(face);
        }
        let dominant = inside.top().max(far.top())?;
        if faces[0].solid == dominant { None } else { faces.iter().find(|f| f.solid == dominant) }
    }

    /// The solids around the two points where a ray may leave a surface: on the near side, and on the far side.
    fn sides(&self, ray: &Ray, surface: &SurfacePoint, faces: &[Face], inside: &Interior) -> (Interior, Interior) {
        let side = |end: Vec3, continues: bool| {
            let mut interior = *inside;
            for (i, face) in faces.iter().enumerate().filter(|(_, f)| f.solid != NO_SOLID) {
                // A ray that hits an edge intersects both its triangles. One face of a solid is crossed once in one
                // direction.
                let is_duplicate = |f: &Face| {
                    f.solid == face.solid && f.enters == face.enters && self.crosses(ray, end, &f.point, continues)
                };
                if self.crosses(ray, end, &face.point, continues) && !faces[..i].iter().any(is_duplicate) {
                    if face.enters {
                        interior.enter(face.solid);
                    } else {
                        interior.leave(face.solid);
                    }
                }
            }
            interior
        };
        (side(surface.ray_origin(-ray.direction), false), side(surface.ray_origin(ray.direction), true))
    }

    fn assemble(&self, ray: &Ray, surface: &SurfacePoint, inside: &Interior, sides: (Interior, Interior)) -> Interface {
        let (near, far) = sides;
        let outward = ray.direction.dot(surface.normal) > 0.0;
        let boundary = if inside.top() == far.top() {
            Boundary::Open { tint: Rgb::WHITE }
        } else {
            let (before, after) = (self.index_of(inside), self.index_of(&far));
            let clear = self.compiled[self.parts[surface.part as usize].material as usize].clear_tint;
            match clear.filter(|_| before == after) {
                Some(tint) => Boundary::Open { tint },
                None => Boundary::Between { eta: if outward { before / after } else { after / before } },
            }
        };
        Interface { surface: *surface, boundary, near, far, outward }
    }

    /// True if the step from a ray's origin to `end` crosses the plane of a face, along the ray. If the ray continues
    /// from `end`, the face is hit again only if `end` lies strictly before it. If the ray turns back, only if `end`
    /// lies strictly behind it.
    pub(crate) fn crosses(&self, ray: &Ray, end: Vec3, face: &SurfacePoint, continues: bool) -> bool {
        let part = &self.parts[face.part as usize];
        let corners = self.meshes[part.mesh as usize].corners(face.triangle as usize);
        let transform = part.transform_at(ray.time);
        let signed_distance = |origin: Vec3| {
            let ray = Ray::new(origin, ray.direction);
            let local = transform.as_ref().map_or(ray, |t| t.unit_ray(&ray).0);
            plane_distance_f64(&local, &corners)
        };
        let ahead = signed_distance(end);
        signed_distance(ray.origin) > 0.0 && if continues { ahead <= 0.0 } else { ahead < 0.0 }
    }

    /// The interface, where no two solids touch: each face has air on its outside.
    #[inline]
    fn lone_interface(&self, ray: &Ray, hit: &SurfacePoint, inside: &Interior) -> Interface {
        let part = &self.parts[hit.part as usize];
        let outward = ray.direction.dot(hit.normal) > 0.0;
        let (near, far, boundary) = if part.solid == NO_SOLID {
            (*inside, *inside, Boundary::Surface)
        } else {
            let mut within = Interior::OUTSIDE;
            within.enter(part.solid);
            let boundary = match self.compiled[part.material as usize].clear_tint {
                Some(tint) if self.solids[part.solid as usize].ior == 1.0 => Boundary::Open { tint },
                _ => Boundary::Between { eta: self.solids[part.solid as usize].ior },
            };
            if outward { (within, Interior::OUTSIDE, boundary) } else { (Interior::OUTSIDE, within, boundary) }
        };
        Interface { surface: *hit, boundary, near, far, outward }
    }

    /// Transmittance from a ray's end to its origin. Media attenuate, and partly covering surfaces and faces between
    /// equal indices let light pass. Any other surface that covers fully occludes the ray.
    ///
    /// `ray` ends before the light's body surface; `inside` are the solids around its origin.
    pub fn shadow_transmittance(&self, ray: &Ray, inside: &Interior) -> Rgb {
        let (mut open, mut bounded) = (1.0, false);
        let occluded = self.bvh.occluded_with_alpha(ray, |hit| {
            let p = self.surface_point(&hit, ray.time);
            let material = self.parts[p.part as usize].material as usize;
            if self.compiled[material].clear_tint.is_some() {
                bounded = true;
            } else {
                open *= 1.0 - self.coverage(&p, ray.direction);
            }
        });
        if occluded || open == 0.0 {
            return Rgb::BLACK;
        }
        if !bounded {
            return self.medium(inside).map_or(Rgb::WHITE, |m| m.transmittance(ray.t_max)) * open;
        }
        self.transmittance_by_face(ray, inside)
    }

    /// The transmittance, computed face by face.
    fn transmittance_by_face(&self, ray: &Ray, inside: &Interior) -> Rgb {
        let end = ray.t_max.is_finite().then(|| ray.at(ray.t_max));
        let (mut ray, mut inside, mut through) = (*ray, *inside, Rgb::WHITE);
        loop {
            let hit = self.intersect(&ray);
            let distance = hit.as_ref().map_or(ray.t_max, |h| h.distance);
            if let Some(medium) = self.medium(&inside) {
                through *= medium.transmittance(distance);
            }
            let Some(hit) = hit.filter(|_| !through.is_black()) else { return through };
            let interface = self.interface(&ray, &hit, &inside);
            let origin = match interface.boundary {
                Boundary::Open { tint } => {
                    through *= tint;
                    inside = interface.far;
                    interface.surface.ray_origin(ray.direction)
                }
                Boundary::Between { .. } => return Rgb::BLACK,
                Boundary::Surface => {
                    through *= 1.0 - self.coverage(&interface.surface, ray.direction);
                    interface.surface.ray_origin(ray.direction)
                }
            };
            ray = match end {
                None => Ray::new(origin, ray.direction).at_time(ray.time),
                Some(end) => {
                    let offset = end - origin;
                    let distance = offset.length();
                    // Rounding has moved the position beyond the end: no segment is left.
                    let is_ahead = offset.dot(ray.direction) > 0.0;
                    if !is_ahead {
                        return through;
                    }
                    Ray::with_end(origin, offset / distance, distance * (1.0 - 2.0 * f32::EPSILON)).at_time(ray.time)
                }
            };
        }
    }
}

/// The data of a part that the compiler needs to find the solids.
pub(crate) struct SolidPart {
    pub(crate) part: usize,
    /// Corners of its box in render space.
    pub(crate) bounds: [Vec3; 2],
    /// True if its mesh encloses a volume by itself.
    pub(crate) is_closed: bool,
    pub(crate) priority: i32,
    pub(crate) solid: Solid,
}

/// The solids of a scene by rank, and common data of all of them.
#[derive(Default)]
pub(crate) struct Solids {
    pub(crate) list: Vec<Solid>,
    /// Box around all of them.
    pub(crate) bounds: Option<[Vec3; 2]>,
    /// True if two of them could touch or overlap.
    pub(crate) has_nesting: bool,
}

impl Solids {
    /// True if a face of a solid could separate places of the same index of refraction.
    pub(crate) fn is_open(&self, solid: u32) -> bool {
        self.has_nesting || self.list.get(solid as usize).is_some_and(|s| s.ior == 1.0)
    }
}

/// Ranks the solids and stores in each part the solid that it bounds. Parts of one object that are not closed by
/// themselves bound one solid together. The material of the first part fills it.
pub(crate) fn rank_solids(found: Vec<SolidPart>, parts: &mut [Part]) -> Solids {
    struct SolidGroup {
        parts: Vec<usize>,
        bounds: [Vec3; 2],
        priority: i32,
        solid: Solid,
    }
    let mut groups: Vec<SolidGroup> = Vec::new();
    let mut shared: HashMap<u32, usize> = HashMap::new();
    for f in found {
        let object = parts[f.part].object;
        let body = SolidGroup { parts: vec![f.part], bounds: f.bounds, priority: f.priority, solid: f.solid };
        match shared.get(&object).filter(|_| !f.is_closed) {
            Some(&body) => {
                let body = &mut groups[body];
                body.parts.push(f.part);
                body.bounds = [body.bounds[0].min(f.bounds[0]), body.bounds[1].max(f.bounds[1])];
            }
            None => {
                if !f.is_closed {
                    shared.insert(object, groups.len());
                }
                groups.push(body);
            }
        }
    }
    // Of equal priorities the smaller box wins, because a solid inside another one has the smaller box.
    let size = |b: &SolidGroup| {
        let extent = (b.bounds[1] - b.bounds[0]).as_dvec3();
        extent.x * extent.y * extent.z
    };
    groups.sort_by(|a, b| a.priority.cmp(&b.priority).then(size(b).total_cmp(&size(a))));
    let mut solids =
        Solids { has_nesting: any_overlap(groups.iter().map(|b| b.bounds).collect()), ..Solids::default() };
    for (rank, body) in (0u32..).zip(&groups) {
        body.parts.iter().for_each(|&p| parts[p].solid = rank);
        let [lo, hi] = solids.bounds.get_or_insert(body.bounds);
        (*lo, *hi) = (lo.min(body.bounds[0]), hi.max(body.bounds[1]));
        solids.list.push(body.solid);
    }
    solids
}

/// True if any two boxes touch or overlap, with a margin for the rounding of their corners.
fn any_overlap(mut boxes: Vec<[Vec3; 2]>) -> bool {
    for b in &mut boxes {
        let rounding = b[0].abs().max(b[1].abs()) * (8.0 * f32::EPSILON);
        *b = [b[0] - rounding, b[1] + rounding];
    }
    boxes.sort_by(|a, b| a[0].x.total_cmp(&b[0].x));
    (0..boxes.len()).any(|i| {
        let [lo, hi] = boxes[i];
        boxes[i + 1..].iter().take_while(|b| b[0].x <= hi.x).any(|b| b[0].cmple(hi).all() && lo.cmple(b[1]).all())
    })
}
