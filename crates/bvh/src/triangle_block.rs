//! Leaves: up to eight triangles, tested at once.
//!
//! The test is `dunkelfeld_geometry::triangle::intersect_triangle`, lane by lane, with the same operations in the same
//! order; the two agree to the bit.

use dunkelfeld_geometry::Ray;
use dunkelfeld_geometry::triangle::{RayShear, T_ERROR, edge_functions_f64, plane_distance_f64};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};
use glam::Vec3;

use crate::simd8::{Eight, WIDTH, bits, greater, lesser, load, splat3};

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
/// All lanes.
pub(crate) const ALL: u32 = (1 << WIDTH) - 1;

/// A hit in a block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockHit {
    pub(crate) t: f32,
    pub(crate) b1: f32,
    pub(crate) b2: f32,
    pub(crate) triangle: u32,
}

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

    /// The triangles in it: number and corners.
    pub(crate) fn triangles(&self) -> impl Iterator<Item = (u32, [Vec3; 3])> {
        (0..WIDTH)
            .filter(|&lane| self.triangles[lane] != NO_TRIANGLE)
            .map(|lane| (self.triangles[lane] & !ALPHA_TESTED, self.corners(lane)))
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

    #[inline]
    fn corners(&self, lane: usize) -> [Vec3; 3] {
        let [x, y, z] = &self.corners;
        let corner = |c: usize| Vec3::new(x[c][lane], y[c][lane], z[c][lane]);
        [corner(0), corner(1), corner(2)]
    }
}

/// The values of a ray that the block test needs, in every lane.
#[derive(Clone, Copy)]
pub(crate) struct ShearLanes<S: Simd> {
    simd: S,
    axes: [usize; 3],
    origin: [f32x8<S>; 3],
    shear: [f32x8<S>; 3],
}

impl<S: Simd> ShearLanes<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S, ray: &Ray) -> Self {
        let s = RayShear::new(ray);
        Self { simd, axes: s.axes, origin: splat3(simd, s.origin), shear: splat3(simd, s.shear) }
    }

    /// One corner of all triangles in the ray's sheared coordinates (z not yet scaled).
    // A function, not a closure, here and below. Only functions can be marked for inlining, and code that is not
    // inlined into the function of a level is compiled for the minimum instruction set.
    #[inline(always)]
    fn sheared(&self, block: &TriangleBlock, corner: usize) -> [f32x8<S>; 3] {
        let [kx, ky, kz] = self.axes;
        let z = load(self.simd, &block.corners[kz][corner]) - self.origin[2];
        let x = load(self.simd, &block.corners[kx][corner]) - self.origin[0];
        let y = load(self.simd, &block.corners[ky][corner]) - self.origin[1];
        [x - self.shear[0] * z, y - self.shear[1] * z, z]
    }

    /// The nearest hit with `0 < t < t_max` among the given lanes, if any; of equal ones the first lane's.
    #[inline(always)]
    pub(crate) fn intersect(&self, block: &TriangleBlock, ray: &Ray, t_max: f32, lanes: u32) -> Option<BlockHit> {
        let zero = f32x8::splat(self.simd, 0.0);
        let [ax, ay, az] = self.sheared(block, 0);
        let [bx, by, bz] = self.sheared(block, 1);
        let [cx, cy, cz] = self.sheared(block, 2);
        let mut u = cx * by - cy * bx;
        let mut v = ax * cy - ay * cx;
        let mut w = bx * ay - by * ax;

        let mut candidates = inside(zero, u, v, w) & lanes;
        if candidates == 0 {
            return None;
        }
        let undecided = candidates & bits(lesser(lesser(u.abs(), v.abs()), w.abs()).simd_eq(zero));
        if undecided != 0 {
            [u, v, w] = exact_edges(self.simd, undecided, [ax, bx, cx], [ay, by, cy], [u, v, w]);
            candidates &= inside(zero, u, v, w);
            if candidates == 0 {
                return None;
            }
        }

        let inv_det = f32x8::splat(self.simd, 1.0) / (u + v + w);
        let sz = self.shear[2];
        let (az, bz, cz) = (sz * az, sz * bz, sz * cz);
        let t = (u * az + v * bz + w * cz) * inv_det;
        let (mx, my, mz) = (largest(ax, bx, cx), largest(ay, by, cy), largest(az, bz, cz));
        let spread = (mx * my + (mx + my) * mz) * mz;
        let t_error = f32x8::splat(self.simd, T_ERROR) * spread * inv_det.abs();
        candidates &= bits((-t_error).simd_le(t)) & bits(t.simd_lt(f32x8::splat(self.simd, t_max)));
        if candidates == 0 {
            return None;
        }
        // Compared with the end of the ray, not with the best hit so far: a hit near that one needs no more precision.
        let ray_end = f32x8::splat(self.simd, ray.t_max);
        let near = candidates & (bits(t.simd_le(t_error)) | bits((ray_end - t_error).simd_le(t)));
        let mut ts: Eight = t.into();
        if near != 0 {
            decide_near(block, ray, near, &mut ts);
        }

        let (mut best, mut t) = (NO_TRIANGLE, t_max);
        while candidates != 0 {
            let lane = candidates.trailing_zeros();
            candidates &= candidates - 1;
            let lane_t = ts[lane as usize];
            if lane_t > 0.0 && lane_t < t {
                (best, t) = (lane, lane_t);
            }
        }
        if best == NO_TRIANGLE {
            return None;
        }
        let lane = best as usize;
        let (b1, b2): (Eight, Eight) = ((v * inv_det).into(), (w * inv_det).into());
        let (b1, b2) = (b1[lane], b2[lane]);
        Some(BlockHit { t, b1, b2, triangle: block.triangles[lane] & !ALPHA_TESTED })
    }
}

/// Lanes whose edge functions do not disagree in sign.
#[inline(always)]
fn inside<S: Simd>(zero: f32x8<S>, u: f32x8<S>, v: f32x8<S>, w: f32x8<S>) -> u32 {
    bits(zero.simd_le(lesser(lesser(u, v), w))) | bits(greater(greater(u, v), w).simd_le(zero))
}

#[inline(always)]
fn largest<S: Simd>(a: f32x8<S>, b: f32x8<S>, c: f32x8<S>) -> f32x8<S> {
    greater(greater(a.abs(), b.abs()), c.abs())
}

/// Distances within their own error of zero or of the ray's end, computed again in f64.
#[inline(never)]
fn decide_near(block: &TriangleBlock, ray: &Ray, lanes: u32, t: &mut Eight) {
    let mut rest = lanes;
    while rest != 0 {
        let lane = rest.trailing_zeros() as usize;
        rest &= rest - 1;
        t[lane] = plane_distance_f64(ray, &block.corners(lane));
    }
}

/// Edge functions; those of the given lanes are computed again in f64. Rare, so not inlined.
#[cold]
#[inline(never)]
fn exact_lanes(lanes: u32, x: [Eight; 3], y: [Eight; 3], e: &mut [Eight; 3]) {
    let mut rest = lanes;
    while rest != 0 {
        let i = rest.trailing_zeros() as usize;
        rest &= rest - 1;
        let exact = edge_functions_f64([x[0][i], x[1][i], x[2][i]], [y[0][i], y[1][i], y[2][i]]);
        for (row, value) in e.iter_mut().zip(exact) {
            row[i] = value;
        }
    }
}

#[inline(always)]
fn exact_edges<S: Simd>(
    simd: S,
    lanes: u32,
    [x0, x1, x2]: [f32x8<S>; 3],
    [y0, y1, y2]: [f32x8<S>; 3],
    [e0, e1, e2]: [f32x8<S>; 3],
) -> [f32x8<S>; 3] {
    let mut edges = [e0.into(), e1.into(), e2.into()];
    exact_lanes(lanes, [x0.into(), x1.into(), x2.into()], [y0.into(), y1.into(), y2.into()], &mut edges);
    let [e0, e1, e2] = edges;
    [load(simd, &e0), load(simd, &e1), load(simd, &e2)]
}
