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
use crate::traverse::{Nearest, closest_of_each, occluded_of_each};

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
        let ([ox, oy, oz], [dx, dy, dz]) = (self.origin, self.direction);
        let (origin, direction) = (Vec3::new(ox[i], oy[i], oz[i]), Vec3::new(dx[i], dy[i], dz[i]));
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
    fn set_none(&mut self, numbers: &[u32]) {
        for number in numbers {
            match self {
                Self::Nearest(hits) => hits.set(*number as usize, &Nearest::none(0.0).hit),
                Self::Occluded(occluded) => occluded[*number as usize] = false,
            }
        }
    }
}

/// The kinds of the rays at a place of a batch: the largest axis of the direction and its octant.
#[inline(always)]
fn kinds_of<F: Lanes>(token: F::Token, rays: &RayBatch, at: usize, kinds: &mut [u32]) {
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

/// Follows rays of one kind in packets: neighbours if their kinds are equal, and the others sorted by their kind.
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
    let (mut of_others, mut others, mut order) = ([0; GROUP], [0; GROUP], [0; GROUP]);
    let mut packets = Packets { skip: 0, pause: 1 };
    for first in (0..count).step_by(GROUP) {
        let end = count.min(first + GROUP);
        // Numbers of neighbours of one kind, and of the other rays.
        let (mut equal, mut other, mut at) = (0, 0, first);
        while at < end {
            let kinds = &mut of_others[other..];
            let width = if end - at < F::WIDTH { 1 } else { F::WIDTH };
            if width == F::WIDTH {
                kinds_of::<F>(token, rays, at, kinds);
            } else {
                kinds_of::<f32>((), rays, at, kinds);
            }
            let is_equal = width == F::WIDTH && are_equal(&kinds[..width]) && kinds[0] as usize != INVALID;
            let (list, len) = if is_equal { (&mut order, &mut equal) } else { (&mut others, &mut other) };
            for (number, to) in (at as u32..).zip(&mut list[*len..*len + width]) {
                *to = number;
            }
            *len += width;
            at += width;
        }
        let ends = sort(&others[..other], &of_others[..other], &mut order[equal..]);
        let mut begin = 0;
        for (kind, end) in std::iter::once(0).chain(ends).enumerate() {
            while begin < equal + end {
                let numbers = &order[begin..(equal + end).min(begin + F::WIDTH)];
                begin += numbers.len();
                if kind == INVALID + 1 {
                    results.set_none(numbers);
                } else {
                    packets.follow::<F, ANY>(token, bvh, rays, numbers, results);
                }
            }
        }
    }
}

/// The choice between packets and single rays. The results are the same.
struct Packets {
    /// So many packets are not tried.
    skip: usize,
    /// How many are not tried after the next one whose rays go alone.
    pause: usize,
}

impl Packets {
    #[inline(always)]
    fn follow<F: Lanes, const ANY: bool>(
        &mut self,
        token: F::Token,
        bvh: &Bvh,
        rays: &RayBatch,
        numbers: &[u32],
        results: &mut Results,
    ) {
        if numbers.len() <= few::<F>() || self.skip > 0 {
            self.skip = self.skip.saturating_sub(1);
            one_by_one(bvh, rays, numbers, results);
            return;
        }
        // Half of the rays of 16 lanes, a quarter of those of 8: the more lanes, the more a packet saves. Factors and limits
        // are those of the least times on meshes of 1 M triangles.
        let alone = together::<F, ANY>(token, bvh, rays, numbers, results);
        if 32 * alone > F::WIDTH * F::WIDTH {
            self.pause = (4 * self.pause).min(512);
            self.skip = self.pause;
        } else {
            self.pause = (self.pause / 4).max(1);
        }
    }
}

/// The results of some rays, which are followed one by one.
fn one_by_one(bvh: &Bvh, rays: &RayBatch, numbers: &[u32], results: &mut Results) {
    let each = numbers.iter().map(|number| (*number as usize, rays.ray(*number as usize)));
    match results {
        Results::Nearest(hits) => closest_of_each(bvh, each, |number, hit| hits.set(number, hit)),
        Results::Occluded(occluded) => {
            occluded_of_each(bvh, each, |number, is_occluded| occluded[number] = is_occluded)
        }
    }
}

/// Is each number equal to the first one?
#[inline(always)]
fn are_equal(kinds: &[u32]) -> bool {
    let mut different = 0;
    for kind in kinds {
        different |= kind ^ kinds[0];
    }
    different == 0
}

/// Rays in the order of their kinds. Returns the end of each kind.
fn sort(rays: &[u32], kinds: &[u32], order: &mut [u32]) -> [usize; KINDS] {
    let mut ends = [0; KINDS];
    for kind in kinds {
        ends[*kind as usize % KINDS] += 1;
    }
    let mut end = 0;
    for begin in &mut ends {
        (*begin, end) = (end, end + *begin);
    }
    for (ray, kind) in rays.iter().zip(kinds) {
        let at = &mut ends[*kind as usize % KINDS];
        order[*at] = *ray;
        *at += 1;
    }
    ends
}

/// A group of so many rays is followed one by one.
#[inline(always)]
pub(crate) fn few<F: Lanes>() -> usize {
    F::WIDTH.div_ceil(8)
}

/// The place of as many numbers in a row as there are lanes, if these are such.
#[inline(always)]
fn in_a_row<F: Lanes>(numbers: &[u32]) -> Option<Range<usize>> {
    let (first, last) = (numbers[0] as usize, numbers[numbers.len() - 1] as usize);
    (last - first + 1 == F::WIDTH && numbers.len() == F::WIDTH).then_some(first..last + 1)
}

/// A number of each ray. Lanes beyond the last ray have those of the last one.
#[inline(always)]
pub(crate) fn load<F: Lanes>(token: F::Token, from: &[f32], numbers: &[u32]) -> F {
    if let Some(row) = in_a_row::<F>(numbers) {
        return F::load(token, &from[row]);
    }
    let mut lanes = [from[numbers[numbers.len() - 1] as usize]; MAX_WIDTH];
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
