//! Leaves: up to eight triangles. A ray is tested against all of them at once, a packet of rays against one by one.
//!
//! The test is `dunkelfeld_geometry::triangle::intersect_triangle`, lane by lane, with the same operations in the same
//! order; the two agree to the bit.

use dunkelfeld_geometry::triangle::{T_ERROR, edge_functions_f64};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
use fearless_simd::Simd;
use glam::Vec3;

use crate::simd8::{Eight, F8, WIDTH};
use crate::tree::splat3;

/// Up to eight triangles, coordinate by coordinate. Free lanes hold NaN and are never hit.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct TriangleBlock {
    /// `corners[axis][corner][lane]`: a ray selects its axes once and then reads 96 contiguous bytes for each.
    corners: [[Eight; 3]; 3],
    /// The triangles' numbers in their mesh.
    triangles: [u32; WIDTH],
}

/// The number in free lanes.
const NO_TRIANGLE: u32 = u32::MAX >> 1;
/// Set in the number of a triangle that lets some light through.
const ALPHA_TESTED: u32 = 1 << 31;
impl TriangleBlock {
    /// A block of at most eight triangles: their numbers and corners.
    pub(crate) fn new(triangles: impl Iterator<Item = (u32, [Vec3; 3])>) -> Self {
        let mut block = Self { corners: [[[f32::NAN; WIDTH]; 3]; 3], triangles: [NO_TRIANGLE; WIDTH] };
        for (lane, (number, corners)) in triangles.take(WIDTH).enumerate() {
            block.triangles[lane] = number;
            for (c, corner) in corners.iter().enumerate() {
                for axis in 0..3 {
                    block.corners[axis][c][lane] = corner[axis];
                }
            }
        }
        block
    }

    /// The triangles in it: lane, number and corners.
    pub(crate) fn triangles(&self) -> impl Iterator<Item = (u32, u32, [Vec3; 3])> {
        (0..WIDTH)
            .filter(|&lane| self.triangles[lane] != NO_TRIANGLE)
            .map(|lane| (lane as u32, self.triangles[lane] & !ALPHA_TESTED, self.corners(lane)))
    }

    /// Are the marks those that [`Self::mark_alpha_tested`] would set?
    pub(crate) fn has_marks(&self, is_alpha_tested: &impl Fn(u32) -> bool) -> bool {
        let mut numbers = self.triangles.iter().filter(|n| **n != NO_TRIANGLE);
        numbers.all(|n| (n & ALPHA_TESTED != 0) == is_alpha_tested(n & !ALPHA_TESTED))
    }

    /// Marks the triangles that let some light through.
    pub(crate) fn mark_alpha_tested(&mut self, is_alpha_tested: &impl Fn(u32) -> bool) {
        for number in self.triangles.iter_mut().filter(|n| **n != NO_TRIANGLE) {
            let plain = *number & !ALPHA_TESTED;
            *number = if is_alpha_tested(plain) { plain | ALPHA_TESTED } else { plain };
        }
    }

    /// The lanes of triangles that let some light through.
    #[inline(always)]
    pub(crate) fn alpha_tested(&self) -> u32 {
        (0..WIDTH).fold(0, |mask, lane| mask | (self.triangles[lane] >> 31) << lane)
    }

    /// The number of the triangle in a lane.
    #[inline(always)]
    pub(crate) fn triangle(&self, lane: usize) -> u32 {
        self.triangles[lane] & !ALPHA_TESTED
    }

    /// The corners of the triangle in a lane.
    #[inline]
    pub(crate) fn corners(&self, lane: usize) -> [Vec3; 3] {
        let [x, y, z] = &self.corners;
        let corner = |c: usize| Vec3::new(x[c][lane], y[c][lane], z[c][lane]);
        [corner(0), corner(1), corner(2)]
    }
}

/// The values of rays that the triangle test needs, as in `dunkelfeld_geometry::triangle::RayShear`.
#[derive(Clone, Copy)]
pub(crate) struct Shear<F> {
    axes: [usize; 3],
    origin: [F; 3],
    shear: [F; 3],
}

/// The lanes in which a ray may hit a triangle.
pub(crate) struct Candidates<F> {
    pub(crate) lanes: u32,
    /// The lanes whose `t` is within its own error of zero or of the end of the ray. It must be computed again by
    /// `plane_distance_f64`. After that a hit has `0 < t < ray.t_max`.
    pub(crate) near: u32,
    pub(crate) t: F,
    pub(crate) b1: F,
    pub(crate) b2: F,
}

impl<F: Lanes> Shear<F> {
    /// The form of rays, whose numbers are in these axes.
    #[inline(always)]
    pub(crate) fn new(origin: [F; 3], direction: [F; 3], inverse: F, axes: [usize; 3]) -> Self {
        let [x, y, _] = direction;
        Self { axes, origin, shear: [x * inverse, y * inverse, inverse] }
    }

    /// A corner, seen from the origin, in the rays' sheared coordinates (z not yet scaled).
    // A function, not a closure, here and below. Only functions can be marked for inlining, and code that is not
    // inlined into the function of a level is compiled for the minimum instruction set.
    #[inline(always)]
    fn sheared(&self, [x, y, z]: [F; 3]) -> [F; 3] {
        [x - self.shear[0] * z, y - self.shear[1] * z, z]
    }

    /// The watertight test in the given lanes. Hits beyond `t_max` may be left out. The corners are seen from the
    /// origins, in the axes of the rays.
    #[inline(always)]
    fn intersect(&self, [a, b, c]: [[F; 3]; 3], lanes: u32, ray_end: F, t_max: F) -> Option<Candidates<F>> {
        let zero = ray_end.constant(0.0);
        let [ax, ay, az] = self.sheared(a);
        let [bx, by, bz] = self.sheared(b);
        let [cx, cy, cz] = self.sheared(c);
        let mut u = cx * by - cy * bx;
        let mut v = ax * cy - ay * cx;
        let mut w = bx * ay - by * ax;

        let mut lanes = inside(zero, u, v, w) & lanes;
        if lanes == 0 {
            return None;
        }
        let undecided = lanes & u.abs().min(v.abs()).min(w.abs()).eq(zero).bits();
        if undecided != 0 {
            [u, v, w] = exact_edges(undecided, [ax, bx, cx], [ay, by, cy], [u, v, w]);
            lanes &= inside(zero, u, v, w);
            if lanes == 0 {
                return None;
            }
        }

        let inv_det = (u + v + w).recip();
        let sz = self.shear[2];
        let (az, bz, cz) = (sz * az, sz * bz, sz * cz);
        let t = (u * az + v * bz + w * cz) * inv_det;
        let (mx, my, mz) = (largest(ax, bx, cx), largest(ay, by, cy), largest(az, bz, cz));
        let spread = (mx * my + (mx + my) * mz) * mz;
        let t_error = spread * T_ERROR * inv_det.abs();
        // Compared with the end of the ray, not with the best hit so far: a hit near that one needs no more precision.
        let near = t.le(t_error) | (ray_end - t_error).le(t);
        lanes &= ((-t_error).le(t) & t.lt(ray_end) & (t.le(t_max) | near)).bits();
        if lanes == 0 {
            return None;
        }
        Some(Candidates { lanes, near: lanes & near.bits(), t, b1: v * inv_det, b2: w * inv_det })
    }
}

/// The form of rays that have their own axes, for a triangle at a time.
pub(crate) struct LaneShear<F: Lanes> {
    /// The lanes whose direction is largest along the first and the second axis.
    largest: [F::Mask; 2],
    /// In the axes of the scene.
    origin: V3<F>,
    /// In the axes of each lane.
    shear: Shear<F>,
}

impl<F: Lanes> LaneShear<F> {
    /// `inverse` has the inverses of the coordinates of the directions.
    #[inline(always)]
    pub(crate) fn new(origin: V3<F>, direction: V3<F>, inverse: [F; 3]) -> Self {
        let V3 { x, y, z } = direction.abs();
        let is_x = x.ge(y.max(z));
        let largest = [is_x, !is_x & z.le(y)];
        let (o, d) = (permuted(largest, origin), permuted(largest, direction));
        let [_, _, inverse] = permuted(largest, V3::new(inverse[0], inverse[1], inverse[2]));
        Self { largest, origin, shear: Shear::new(o, d, inverse, [0, 1, 2]) }
    }

    /// The test of the ray of each lane and a triangle of a block.
    #[inline(always)]
    pub(crate) fn intersect(
        &self,
        (block, triangle): (&TriangleBlock, usize),
        lanes: u32,
        ray_end: F,
        t_max: F,
    ) -> Option<Candidates<F>> {
        let mut corners = [[ray_end; 3]; 3];
        for (number, corner) in corners.iter_mut().enumerate() {
            let [x, y, z] = &block.corners;
            let [x, y, z] = [x[number][triangle], y[number][triangle], z[number][triangle]];
            *corner = permuted(self.largest, V3::splat(ray_end.token(), Vec3::new(x, y, z)) - self.origin);
        }
        self.shear.intersect(corners, lanes, ray_end, t_max)
    }
}

/// The axes of each lane, as in `dunkelfeld_geometry::triangle::RayShear`.
#[inline(always)]
fn permuted<F: Lanes>([is_x, is_y]: [F::Mask; 2], V3 { x, y, z }: V3<F>) -> [F; 3] {
    [is_x.select(y, is_y.select(z, x)), is_x.select(z, is_y.select(x, y)), is_x.select(x, is_y.select(y, z))]
}

impl Shear<f32> {
    /// The same ray in eight lanes, one for each triangle.
    #[inline(always)]
    pub(crate) fn splat<S: Simd>(&self, simd: S) -> Shear<F8<S>> {
        Shear { axes: self.axes, origin: splat3(simd, self.origin), shear: splat3(simd, self.shear) }
    }
}

impl<S: Simd> Shear<F8<S>> {
    /// The test of a ray and all triangles of a block, a triangle in each lane.
    #[inline(always)]
    pub(crate) fn intersect_block(&self, block: &TriangleBlock, ray_end: f32, t_max: f32) -> Option<Candidates<F8<S>>> {
        let simd = self.origin[0].token();
        let ray_end = Lanes::splat(simd, ray_end);
        let mut corners = [[ray_end; 3]; 3];
        for (number, corner) in corners.iter_mut().enumerate() {
            for (k, axis) in self.axes.into_iter().enumerate() {
                let x: F8<S> = Lanes::load(simd, &block.corners[axis][number]);
                corner[k] = x - self.origin[k];
            }
        }
        self.intersect(corners, u32::MAX, ray_end, Lanes::splat(simd, t_max))
    }
}

/// Lanes whose edge functions do not disagree in sign.
#[inline(always)]
fn inside<F: Lanes>(zero: F, u: F, v: F, w: F) -> u32 {
    (zero.le(u.min(v).min(w)) | u.max(v).max(w).le(zero)).bits()
}

#[inline(always)]
fn largest<F: Lanes>(a: F, b: F, c: F) -> F {
    a.abs().max(b.abs()).max(c.abs())
}

/// Edge functions; those of the given lanes are computed again in f64. Rare, so not inlined.
#[cold]
#[inline(never)]
fn exact_lanes(lanes: u32, x: [[f32; MAX_WIDTH]; 3], y: [[f32; MAX_WIDTH]; 3], e: &mut [[f32; MAX_WIDTH]; 3]) {
    let mut rest = lanes;
    while rest != 0 {
        let i = rest.trailing_zeros() as usize;
        rest &= rest - 1;
        let exact = edge_functions_f64(of_lane(&x, i), of_lane(&y, i));
        for (row, value) in e.iter_mut().zip(exact) {
            row[i] = value;
        }
    }
}

/// Three numbers of each lane.
#[inline(always)]
fn arrays<F: Lanes>([x, y, z]: [F; 3]) -> [[f32; MAX_WIDTH]; 3] {
    [x.to_array(), y.to_array(), z.to_array()]
}

/// The three numbers of a lane.
#[inline(always)]
fn of_lane([x, y, z]: &[[f32; MAX_WIDTH]; 3], lane: usize) -> [f32; 3] {
    [x[lane], y[lane], z[lane]]
}

#[inline(always)]
fn exact_edges<F: Lanes>(lanes: u32, x: [F; 3], y: [F; 3], edges: [F; 3]) -> [F; 3] {
    let token = x[0].token();
    let mut e = arrays(edges);
    exact_lanes(lanes, arrays(x), arrays(y), &mut e);
    [F::load(token, &e[0]), F::load(token, &e[1]), F::load(token, &e[2])]
}
