//! Points on surfaces, one for each lane.

use crate::geometry::triangle_data::{CornerNormals, FLAT, Facet, FacetLanes};
use crate::query::intersect::SurfacePoint;
use crate::scene::{Part, Placement, Scene};
use dunkelfeld_geometry::{RigidMotion, Transform, Vec3, hit_points, offset_ray_origins};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, One, V3};

/// Hits of lanes. See [`Hit`](dunkelfeld_bvh::Hit). All lanes have a hit.
#[derive(Clone, Copy, Debug)]
pub struct HitLanes<F: Lanes> {
    /// Ray parameters \[m\].
    pub t: F,
    /// Barycentric weights of the second corners.
    pub b1: F,
    /// Barycentric weights of the third corners.
    pub b2: F,
    /// Instances.
    pub instance: F::Word,
    /// Parts of joined meshes.
    pub part: F::Word,
    /// Triangles.
    pub triangle: F::Word,
}

/// Points on surfaces, one for each lane. See [`SurfacePoint`].
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoints<F: Lanes> {
    /// Positions in render space.
    pub point: V3<F>,
    /// Bounds of the positions' rounding errors, per axis.
    pub error: V3<F>,
    /// Unit geometric normals, on the side given by the winding.
    pub normal: V3<F>,
    /// Ray parameters of the hits \[m\].
    pub distance: F,
    /// Barycentric weights of the second corners.
    pub b1: F,
    /// Barycentric weights of the third corners.
    pub b2: F,
    /// Indices of the parts.
    pub part: F::Word,
    /// Indices of the materials.
    pub material: F::Word,
    /// Indices of the triangles in the parts.
    pub triangle: F::Word,
    /// Lanes with interpolated normals.
    pub is_smooth: F::Mask,
    /// Times of the rays \[s\], which are those of the poses of moving parts.
    pub time: F,
    /// Numbers of the normals of the corners, in lanes with interpolated normals.
    pub(crate) normals: F::Word,
}

impl From<&SurfacePoint> for SurfacePoints<f32> {
    #[inline(always)]
    fn from(p: &SurfacePoint) -> Self {
        let [_, b1, b2] = p.barycentrics;
        Self {
            point: p.point.into(),
            error: p.error.into(),
            normal: p.normal.into(),
            distance: p.distance,
            b1,
            b2,
            part: One(p.part),
            material: One(p.material),
            triangle: One(p.triangle),
            is_smooth: p.normals != FLAT,
            time: p.time,
            normals: One(p.normals),
        }
    }
}

impl<F: Lanes> SurfacePoints<F> {
    /// The point of one lane, for code that is not in lanes.
    #[inline(always)]
    pub fn lane(&self, lane: usize) -> SurfacePoint {
        let [b1, b2] = [self.b1.to_array()[lane], self.b2.to_array()[lane]];
        SurfacePoint {
            point: vector(self.point, lane),
            error: vector(self.error, lane),
            normal: vector(self.normal, lane),
            distance: self.distance.to_array()[lane],
            part: F::word_to_array(self.part)[lane],
            material: F::word_to_array(self.material)[lane],
            triangle: F::word_to_array(self.triangle)[lane],
            normals: F::word_to_array(self.normals)[lane],
            barycentrics: [1.0 - b1 - b2, b1, b2],
            time: self.time.to_array()[lane],
        }
    }

    /// The points of lanes, found one by one.
    #[inline(always)]
    pub fn from_lanes(token: F::Token, lanes: &[SurfacePoint; MAX_WIDTH]) -> Self {
        let mut records = [[[0.0; 4]; 5]; MAX_WIDTH];
        for lane in 0..F::WIDTH {
            let p = &lanes[lane];
            let [part, material, triangle, normals] = [p.part, p.material, p.triangle, p.normals].map(f32::from_bits);
            records[lane] = [
                p.point.extend(p.distance).to_array(),
                p.error.extend(p.barycentrics[1]).to_array(),
                p.normal.extend(p.barycentrics[2]).to_array(),
                [part, material, triangle, normals],
                [p.time; 4],
            ];
        }
        let [(point, distance), (error, b1), (normal, b2), (words, normals), (_, time)] = V3::<F>::load_records(
            token,
            #[inline(always)]
            |lane| &records[lane],
        );
        let [part, material, triangle] = [words.x.to_bits(), words.y.to_bits(), words.z.to_bits()];
        let (normals, flat) = (normals.to_bits(), F::splat_word(token, FLAT));
        let is_smooth = !F::word_eq(normals, flat);
        Self { point, error, normal, distance, b1, b2, part, material, triangle, is_smooth, time, normals }
    }

    /// The origins of rays in the given directions, moved so that no ray hits its surface again.
    #[inline(always)]
    pub fn ray_origins(&self, directions: V3<F>) -> V3<F> {
        offset_ray_origins(self.point, self.error, self.normal, directions)
    }
}

/// Normals at the corners of triangles in the space of their meshes, one for each lane.
#[derive(Clone, Copy)]
pub(crate) struct CornerLanes<F: Lanes> {
    /// Zero in lanes without interpolated normals.
    pub(crate) normals: [V3<F>; 3],
    /// The lanes with interpolated normals and a transform.
    pub(crate) is_placed: u32,
}

#[inline(always)]
fn vector<F: Lanes>(v: V3<F>, lane: usize) -> Vec3 {
    Vec3::new(v.x.to_array()[lane], v.y.to_array()[lane], v.z.to_array()[lane])
}

impl Scene {
    /// Index of the material of a hit. For all other data of the point see [`Self::surface_points`].
    #[inline(always)]
    pub fn material_of(&self, instance: u32, part: u32, triangle: u32) -> u32 {
        match self.placements[instance as usize] {
            Placement::Shared => self.facets.triangle(triangle).material(),
            Placement::Joined => self.parts[part as usize].material,
            Placement::Part(part) => self.parts[part as usize].material,
        }
    }

    /// The points on surfaces of hits at times \[s\]: [`Self::surface_point`] in lanes.
    #[inline(always)]
    pub fn surface_points<F: Lanes>(&self, token: F::Token, hits: &HitLanes<F>, time: F) -> SurfacePoints<F> {
        let triangles = F::word_to_array(hits.triangle);
        let mut facets = [&Facet::NONE; MAX_WIDTH];
        let (mut parts, mut materials) = ([0.0; MAX_WIDTH], [0.0; MAX_WIDTH]);
        // Lanes whose triangles do not refer to a part, and those with a transform.
        let (mut is_own, mut is_placed) = (0, 0);
        // The shared tree is the first one.
        let is_first = F::word_eq(hits.instance, F::splat_word(token, 0));
        if matches!(self.placements.first(), Some(Placement::Shared)) && !(!is_first).any() {
            for lane in 0..F::WIDTH {
                facets[lane] = self.facets.triangle(triangles[lane]);
            }
        } else {
            let (instances, joined) = (F::word_to_array(hits.instance), F::word_to_array(hits.part));
            for lane in 0..F::WIDTH {
                let index = match self.placements[instances[lane] as usize] {
                    Placement::Shared => {
                        facets[lane] = self.facets.triangle(triangles[lane]);
                        continue;
                    }
                    Placement::Joined => joined[lane],
                    Placement::Part(index) => index,
                };
                let part = &self.parts[index as usize];
                facets[lane] = self.facet(part, triangles[lane]);
                (parts[lane], materials[lane]) = (f32::from_bits(index), f32::from_bits(part.material));
                is_own |= 1 << lane;
                is_placed |= u32::from(part.transform.is_some()) << lane;
            }
        }
        let FacetLanes { corners, mut normal, mut part, mut material, triangle, normals } =
            Facet::load::<F>(token, &facets);
        if is_own != 0 {
            let is_own = F::mask(token, is_own);
            part = is_own.select(F::load(token, &parts), F::from_bits(part)).to_bits();
            material = is_own.select(F::load(token, &materials), F::from_bits(material)).to_bits();
        }
        let (mut point, mut error) = hit_points(&corners, hits.b1, hits.b2);
        if is_placed != 0 {
            self.each_pose(
                token,
                (part, time),
                is_placed,
                #[inline(always)]
                |lanes, transform| {
                    let (there, its_error) = transform.points_with_error(point, error);
                    point = V3::select(lanes, there, point);
                    error = V3::select(lanes, its_error, error);
                    normal = V3::select(lanes, transform.normals(normal), normal);
                },
            );
        }
        SurfacePoints {
            point,
            error,
            normal,
            distance: hits.t,
            b1: hits.b1,
            b2: hits.b2,
            part,
            material,
            triangle,
            is_smooth: !F::word_eq(normals, F::splat_word(token, FLAT)),
            time,
            normals,
        }
    }

    /// The normals at the corners of triangles. Calls `f` for each lane with interpolated normals, with its part.
    #[inline(always)]
    pub(crate) fn corner_lanes<'a, F: Lanes>(
        &'a self,
        token: F::Token,
        points: &SurfacePoints<F>,
        mut f: impl FnMut(usize, &'a Part),
    ) -> CornerLanes<F> {
        let (parts, numbers) = (F::word_to_array(points.part), F::word_to_array(points.normals));
        let (mut normals, mut is_placed) = ([&CornerNormals::NONE; MAX_WIDTH], 0);
        for lane in points.is_smooth.lanes() {
            let part = &self.parts[parts[lane] as usize];
            f(lane, part);
            normals[lane] = self.facets_of(part).normals(numbers[lane]);
            is_placed |= u32::from(part.transform.is_some()) << lane;
        }
        CornerLanes { normals: CornerNormals::load(token, &normals), is_placed }
    }

    /// Calls `f` for each pose of the parts of some lanes at their times, with the lanes that have it. Lanes of one part
    /// at rest have one pose.
    #[inline(always)]
    pub(crate) fn each_pose<F: Lanes>(
        &self,
        token: F::Token,
        (part, time): (F::Word, F),
        lanes: u32,
        mut f: impl FnMut(F::Mask, &Transform),
    ) {
        let (parts, times) = (F::word_to_array(part), time.to_array());
        let mut left = lanes;
        while left != 0 {
            let first = left.trailing_zeros() as usize % MAX_WIDTH;
            let its = &self.parts[parts[first] as usize];
            let mut same = 1 << first;
            if let Some(transform) = &its.transform {
                let moved;
                let transform = match &its.motion {
                    None => {
                        same = F::word_eq(part, F::splat_word(token, parts[first])).bits() & left;
                        &**transform
                    }
                    Some(motion) => {
                        moved = pose(motion, transform, times[first]);
                        &moved
                    }
                };
                f(F::mask(token, same), transform);
            }
            left &= !same;
        }
    }
}

/// The transform of a moving part at a time \[s\]. Motion is rare.
#[inline(never)]
fn pose(motion: &RigidMotion, transform: &Transform, time: f32) -> Transform {
    motion.moved(transform, f64::from(time))
}
