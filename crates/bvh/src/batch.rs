//! Batches of rays.
//!
//! The rays of a packet have the same shear axes and octant, so that the axes of triangles and the sides of boxes are those
//! of all lanes. Rays are sorted for that. The results have the bits of single rays: a lane has the same operations, and
//! the nearest hit does not depend on the order of visits.

use std::ops::Range;

use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, Mask, V3, dispatch};

use crate::packet::together;
use crate::scene::{Bvh, Hit};
use crate::traverse::Nearest;

/// Rays of a batch: one array for each number, all of one length. Units and meaning are those of [`Ray`].
#[derive(Clone, Copy, Debug)]
pub struct RayBatch<'a> {
    /// Coordinates of the origins \[m\].
    pub origin: [&'a [f32]; 3],
    /// Coordinates of the directions.
    pub direction: [&'a [f32]; 3],
    /// Ends of the rays.
    pub t_max: &'a [f32],
    /// Times \[s\]; empty if all are zero.
    pub time: &'a [f32],
}

/// The nearest hits of a batch: arrays of its length. A ray without a hit has the instance [`NO_HIT`](crate::NO_HIT), and its other
/// numbers mean nothing.
#[derive(Debug)]
pub struct HitBatch<'a> {
    /// Ray parameters, as [`Hit::t`].
    pub t: &'a mut [f32],
    /// Barycentric weights of the second corners.
    pub b1: &'a mut [f32],
    /// Barycentric weights of the third corners.
    pub b2: &'a mut [f32],
    /// Instances, or [`NO_HIT`](crate::NO_HIT).
    pub instance: &'a mut [u32],
    /// Parts, as [`Hit::part`].
    pub part: &'a mut [u32],
    /// Triangles, as [`Hit::triangle`].
    pub triangle: &'a mut [u32],
}

impl RayBatch<'_> {
    #[inline(always)]
    pub(crate) fn ray(&self, i: usize) -> Ray {
        let [origin, direction] = [self.origin, self.direction].map(|[x, y, z]| Vec3::new(x[i], y[i], z[i]));
        Ray { origin, direction, t_max: self.t_max[i], time: self.time.get(i).copied().unwrap_or(0.0) }
    }
}

impl HitBatch<'_> {
    #[inline(always)]
    fn set(&mut self, i: usize, hit: &Hit) {
        (self.t[i], self.b1[i], self.b2[i]) = (hit.t, hit.b1, hit.b2);
        (self.instance[i], self.part[i], self.triangle[i]) = (hit.instance, hit.part, hit.triangle);
    }
}

/// Kinds of rays are computed for groups of this size.
const GROUP: usize = 1024;
/// Number of kinds: three axes, or none, times eight octants.
const KINDS: usize = 32;
/// The kind of rays that hit nothing.
const INVALID: usize = KINDS - 1;

impl Bvh {
    /// [`Bvh::closest_hit`] of each ray of a batch, with the same bits for all instruction sets.
    ///
    /// # Panics
    /// If an array is shorter than that of the ends of the rays. Times that are missing are zero.
    pub fn closest_hits(&self, set: InstructionSet, rays: &RayBatch, hits: &mut HitBatch) {
        let results = &mut Results::Nearest(hits);
        match rays.t_max.len() <= MAX_WIDTH {
            true => dispatch!(set, F, token => each_packet::<F, false, MAX_WIDTH>(token, self, rays, results)),
            false => dispatch!(set, F, token => each_packet::<F, false, GROUP>(token, self, rays, results)),
        }
    }

    /// [`Bvh::occluded`] of each ray of a batch.
    ///
    /// # Panics
    /// If an array is shorter than that of the ends of the rays. Times that are missing are zero.
    pub fn occluded_batch(&self, set: InstructionSet, rays: &RayBatch, occluded: &mut [bool]) {
        dispatch!(set, F, token => each_packet::<F, true, GROUP>(token, self, rays, &mut Results::Occluded(occluded)));
    }
}

/// The results of a batch.
pub(crate) enum Results<'a, 'b> {
    Nearest(&'a mut HitBatch<'b>),
    Occluded(&'a mut [bool]),
}

impl Results<'_, '_> {
    /// The results of rays that hit nothing.
    #[inline(always)]
    fn set_none(&mut self, numbers: &[u32]) {
        for number in numbers {
            match self {
                Self::Nearest(hits) => hits.instance[*number as usize] = crate::NO_HIT,
                Self::Occluded(occluded) => occluded[*number as usize] = false,
            }
        }
    }
}

/// The kinds of the rays at a place of a batch: the largest axis of the direction and its octant.
#[inline(always)]
fn kinds<F: Lanes>(token: F::Token, rays: &RayBatch, at: usize, kinds: &mut [u32]) {
    let [ox, oy, oz] = rays.origin;
    let [dx, dy, dz] = rays.direction;
    let o = V3::new(F::load(token, &ox[at..]), F::load(token, &oy[at..]), F::load(token, &oz[at..]));
    let d = V3::new(F::load(token, &dx[at..]), F::load(token, &dy[at..]), F::load(token, &dz[at..]));
    let a = d.abs();
    let is_valid = (o.x.is_finite() & o.y.is_finite() & o.z.is_finite())
        & (a.x.is_finite() & a.y.is_finite() & a.z.is_finite())
        & (a.x.is_positive() | a.y.is_positive() | a.z.is_positive())
        & F::load(token, &rays.t_max[at..]).is_positive();
    let axis = a.y.lt(a.z).select(bits(token, 2), bits(token, 1));
    let axis = a.x.ge(a.y.max(a.z)).select(bits(token, 0), axis);
    let (x, y, z) = (d.x.to_bits() >> 31, d.y.to_bits() >> 31, d.z.to_bits() >> 31);
    let kind = axis.to_bits() | (x << 2) | (y << 3) | (z << 4);
    F::store_word(is_valid.select(F::from_bits(kind), bits(token, INVALID as u32)).to_bits(), kinds);
}

/// The bits of an integer in all lanes.
#[inline(always)]
pub(crate) fn bits<F: Lanes>(token: F::Token, number: u32) -> F {
    F::from_bits(F::splat_word(token, number))
}

/// Sorts rays by their kind, and follows them in packets.
#[inline(always)]
fn each_packet<F: Lanes, const ANY: bool, const GROUP: usize>(
    token: F::Token,
    bvh: &Bvh,
    rays: &RayBatch,
    results: &mut Results,
) {
    let count = rays.t_max.len();
    if count == 0 {
        return;
    }
    let (mut of_group, mut order) = ([0; GROUP], [0; GROUP]);
    // After packets whose rays soon went alone, some are not tried. The results are the same.
    let (mut skip, mut pause) = (0usize, 1);
    for first in (0..count).step_by(GROUP) {
        let group = GROUP.min(count - first);
        let vectors = group / F::WIDTH * F::WIDTH;
        for at in (0..vectors).step_by(F::WIDTH) {
            kinds::<F>(token, rays, first + at, &mut of_group[at..]);
        }
        for at in vectors..group {
            kinds::<f32>((), rays, first + at, &mut of_group[at..]);
        }
        let ends = sort(first as u32, &of_group[..group], &mut order);
        let mut begin = 0;
        for (kind, end) in ends.into_iter().enumerate() {
            while begin < end {
                let packet = &order[begin..end.min(begin + F::WIDTH)];
                begin += packet.len();
                if kind == INVALID {
                    results.set_none(packet);
                } else if packet.len() <= few::<F>() || skip > 0 {
                    skip = skip.saturating_sub(1);
                    alone::<ANY>(bvh, rays, packet, results);
                } else if together::<F, ANY>(token, bvh, rays, packet, results) > F::WIDTH / 2 {
                    pause = (2 * pause).min(64);
                    skip = pause;
                } else {
                    pause = 1;
                }
            }
        }
    }
}

/// The numbers of rays, from `first` on, in the order of their kinds. Returns the end of each kind.
fn sort(first: u32, kinds: &[u32], order: &mut [u32]) -> [usize; KINDS] {
    let mut ends = [0; KINDS];
    if kinds.iter().all(|kind| *kind == kinds[0]) {
        for (number, at) in (first..).zip(order.iter_mut()) {
            *at = number;
        }
        ends[kinds[0] as usize % KINDS..].fill(kinds.len());
        return ends;
    }
    for kind in kinds {
        ends[*kind as usize % KINDS] += 1;
    }
    let mut end = 0;
    for begin in &mut ends {
        (*begin, end) = (end, end + *begin);
    }
    for (number, kind) in (first..).zip(kinds) {
        let at = &mut ends[*kind as usize % KINDS];
        order[*at] = number;
        *at += 1;
    }
    ends
}

/// A group of so many rays is followed one by one.
#[inline(always)]
pub(crate) fn few<F: Lanes>() -> usize {
    F::WIDTH.div_ceil(4)
}

#[inline(never)]
fn alone<const ANY: bool>(bvh: &Bvh, rays: &RayBatch, numbers: &[u32], results: &mut Results) {
    // A ray that has just been written in parts cannot be read at once as a whole. So all are written first.
    let mut group = [Ray::new(Vec3::ZERO, Vec3::ZERO); MAX_WIDTH];
    for (ray, number) in group.iter_mut().zip(numbers) {
        *ray = rays.ray(*number as usize);
    }
    for (ray, number) in group.iter().zip(numbers) {
        let i = *number as usize;
        match results {
            Results::Nearest(hits) => hits.set(i, &bvh.closest_hit(ray).unwrap_or(Nearest::none(0.0).hit)),
            Results::Occluded(occluded) => occluded[i] = bvh.occluded(ray),
        }
    }
}

/// The place of as many numbers in a row as there are lanes, if these are such.
#[inline(always)]
fn in_a_row<F: Lanes>(numbers: &[u32]) -> Option<Range<usize>> {
    let (first, last) = (numbers[0] as usize, numbers[numbers.len() - 1] as usize);
    (last - first + 1 == F::WIDTH && numbers.len() == F::WIDTH).then_some(first..last + 1)
}

/// A number of each ray. Lanes beyond the last ray have zeros.
#[inline(always)]
pub(crate) fn load<F: Lanes>(token: F::Token, from: &[f32], numbers: &[u32]) -> F {
    if let Some(row) = in_a_row::<F>(numbers) {
        return F::load(token, &from[row]);
    }
    let mut lanes = [0.0; MAX_WIDTH];
    for (to, number) in lanes.iter_mut().zip(numbers) {
        *to = from[*number as usize];
    }
    F::load(token, &lanes)
}

/// [`load`] of three arrays.
#[inline(always)]
pub(crate) fn load3<F: Lanes>(token: F::Token, [x, y, z]: [&[f32]; 3], numbers: &[u32]) -> V3<F> {
    V3::new(load(token, x, numbers), load(token, y, numbers), load(token, z, numbers))
}

/// Writes a number of each ray.
#[inline(always)]
pub(crate) fn store<F: Lanes>(x: F, to: &mut [f32], numbers: &[u32]) {
    if let Some(row) = in_a_row::<F>(numbers) {
        return x.store(&mut to[row]);
    }
    for (number, x) in numbers.iter().zip(x.to_array()) {
        to[*number as usize] = x;
    }
}

/// [`store`] of bits.
#[inline(always)]
pub(crate) fn store_bits<F: Lanes>(x: F, to: &mut [u32], numbers: &[u32]) {
    if let Some(row) = in_a_row::<F>(numbers) {
        return F::store_word(x.to_bits(), &mut to[row]);
    }
    for (number, x) in numbers.iter().zip(F::word_to_array(x.to_bits())) {
        to[*number as usize] = x;
    }
}
