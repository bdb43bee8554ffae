//! Leaves: up to eight triangles, tested at once.
//!
//! The test is `dunkelfeld_geometry::triangle::intersect_triangle`, lane by lane, with the same operations in the same
//! order; the two agree to the bit.

use dunkelfeld_geometry::Ray;
use dunkelfeld_geometry::triangle::{RayShear, T_ERROR, edge_functions_f64, plane_distance_f64};
use glam::Vec3;

use crate::simd8::{Eight, Lanes, WIDTH};

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

    fn corners(&self, lane: usize) -> [Vec3; 3] {
        [0, 1, 2].map(|c| Vec3::from_array([0, 1, 2].map(|axis| self.corners[axis][c][lane])))
    }
}

/// The values of a ray that the block test needs, in every lane.
#[derive(Clone, Copy)]
pub(crate) struct ShearLanes<L: Lanes> {
    axes: [usize; 3],
    origin: [L::F; 3],
    shear: [L::F; 3],
}

impl<L: Lanes> ShearLanes<L> {
    #[inline(always)]
    pub(crate) fn new(ray: &Ray) -> Self {
        let s = RayShear::new(ray);
        Self {
            axes: s.axes,
            origin: [L::splat(s.origin[0]), L::splat(s.origin[1]), L::splat(s.origin[2])],
            shear: [L::splat(s.shear[0]), L::splat(s.shear[1]), L::splat(s.shear[2])],
        }
    }

    /// One corner of all triangles in the ray's sheared coordinates (z not yet scaled).
    // A function, not a closure, here and below. Only functions can be marked for inlining, and code that is not
    // inlined into the function with AVX2 is compiled without it.
    #[inline(always)]
    fn sheared(&self, block: &TriangleBlock, corner: usize) -> (L::F, L::F, L::F) {
        let [kx, ky, kz] = self.axes;
        let z = L::sub(L::load(&block.corners[kz][corner]), self.origin[2]);
        let x = L::sub(L::load(&block.corners[kx][corner]), self.origin[0]);
        let y = L::sub(L::load(&block.corners[ky][corner]), self.origin[1]);
        (L::sub(x, L::mul(self.shear[0], z)), L::sub(y, L::mul(self.shear[1], z)), z)
    }

    /// The nearest hit with `0 < t < t_max` among the given lanes, if any; of equal ones the first lane's.
    #[inline(always)]
    pub(crate) fn intersect(&self, block: &TriangleBlock, ray: &Ray, t_max: f32, lanes: u32) -> Option<BlockHit> {
        let (ax, ay, az) = self.sheared(block, 0);
        let (bx, by, bz) = self.sheared(block, 1);
        let (cx, cy, cz) = self.sheared(block, 2);
        let mut u = L::sub(L::mul(cx, by), L::mul(cy, bx));
        let mut v = L::sub(L::mul(ax, cy), L::mul(ay, cx));
        let mut w = L::sub(L::mul(bx, ay), L::mul(by, ax));

        let mut candidates = inside::<L>(u, v, w) & lanes;
        if candidates == 0 {
            return None;
        }
        let undecided = candidates & L::eq(L::min(L::min(L::abs(u), L::abs(v)), L::abs(w)), L::splat(0.0));
        if undecided != 0 {
            [u, v, w] = exact_edges::<L>(undecided, [ax, bx, cx], [ay, by, cy], [u, v, w]);
            candidates &= inside::<L>(u, v, w);
            if candidates == 0 {
                return None;
            }
        }

        let inv_det = L::div(L::splat(1.0), L::add(L::add(u, v), w));
        let sz = self.shear[2];
        let (az, bz, cz) = (L::mul(sz, az), L::mul(sz, bz), L::mul(sz, cz));
        let t = L::mul(L::add(L::add(L::mul(u, az), L::mul(v, bz)), L::mul(w, cz)), inv_det);
        let (mx, my, mz) = (largest::<L>(ax, bx, cx), largest::<L>(ay, by, cy), largest::<L>(az, bz, cz));
        let spread = L::mul(L::add(L::mul(mx, my), L::mul(L::add(mx, my), mz)), mz);
        let t_error = L::mul(L::mul(L::splat(T_ERROR), spread), L::abs(inv_det));
        candidates &= L::le(L::neg(t_error), t) & L::lt(t, L::splat(t_max));
        if candidates == 0 {
            return None;
        }
        // Compared with the end of the ray, not with the best hit so far: a hit near that one needs no more precision.
        let ends = L::le(t, t_error) | L::le(L::sub(L::splat(ray.t_max), t_error), t);
        let near = candidates & ends;
        let mut ts = L::store(t);
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
        let (b1, b2) = (L::store(L::mul(v, inv_det))[lane], L::store(L::mul(w, inv_det))[lane]);
        Some(BlockHit { t, b1, b2, triangle: block.triangles[lane] & !ALPHA_TESTED })
    }
}

/// Lanes whose edge functions do not disagree in sign.
#[inline(always)]
fn inside<L: Lanes>(u: L::F, v: L::F, w: L::F) -> u32 {
    let zero = L::splat(0.0);
    L::le(zero, L::min(L::min(u, v), w)) | L::le(L::max(L::max(u, v), w), zero)
}

#[inline(always)]
fn largest<L: Lanes>(a: L::F, b: L::F, c: L::F) -> L::F {
    L::max(L::max(L::abs(a), L::abs(b)), L::abs(c))
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
fn exact_edges<L: Lanes>(lanes: u32, x: [L::F; 3], y: [L::F; 3], e: [L::F; 3]) -> [L::F; 3] {
    let [x0, x1, x2] = x;
    let [y0, y1, y2] = y;
    let [e0, e1, e2] = e;
    let mut edges = [L::store(e0), L::store(e1), L::store(e2)];
    let x = [L::store(x0), L::store(x1), L::store(x2)];
    let y = [L::store(y0), L::store(y1), L::store(y2)];
    exact_lanes(lanes, x, y, &mut edges);
    [L::load(&edges[0]), L::load(&edges[1]), L::load(&edges[2])]
}
