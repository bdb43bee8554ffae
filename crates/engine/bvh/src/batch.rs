//! Batches of rays.
//!
//! Neighbours go through the tree together, in packets. Where these fall apart, rays are followed one by one.

use std::ops::Range;

use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_lanes::{InstructionSet, Lanes, dispatch};

use crate::packet::{few, together};
use crate::scene::{Bvh, Hit};
use crate::traverse::{closest_of_each, occluded_of_each};

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

impl Bvh {
    /// [`Bvh::closest_hit`] of each ray of a batch, with the same bits for all instruction sets.
    ///
    /// # Panics
    /// If an array is shorter than that of the ends of the rays. Times that are missing are zero.
    pub fn closest_hits(&self, set: InstructionSet, rays: &RayBatch, hits: &mut HitBatch) {
        dispatch!(set, F, token => each_packet::<F, false>(token, self, rays, &mut Results::Nearest(hits)));
    }

    /// [`Bvh::occluded`] of each ray of a batch.
    ///
    /// # Panics
    /// If an array is shorter than that of the ends of the rays. Times that are missing are zero.
    pub fn occluded_batch(&self, set: InstructionSet, rays: &RayBatch, occluded: &mut [bool]) {
        dispatch!(set, F, token => each_packet::<F, true>(token, self, rays, &mut Results::Occluded(occluded)));
    }
}

/// The results of a batch.
pub(crate) enum Results<'a, 'b> {
    Nearest(&'a mut HitBatch<'b>),
    Occluded(&'a mut [bool]),
}

/// Follows rays in packets of neighbours.
#[inline(always)]
fn each_packet<F: Lanes, const ANY: bool>(token: F::Token, bvh: &Bvh, rays: &RayBatch, results: &mut Results) {
    let count = rays.t_max.len();
    // So many packets are not tried, and how many after the next one whose rays go alone.
    let (mut skip, mut pause) = (0, 1);
    for first in (0..count).step_by(F::WIDTH) {
        let range = first..count.min(first + F::WIDTH);
        if range.len() <= few::<F>() || skip > 0 {
            skip = usize::saturating_sub(skip, 1);
            one_by_one(bvh, rays, range, results);
            continue;
        }
        // All rays of 16 lanes, half of those of 8: the more lanes, the more a packet saves. Factors and limits are those of
        // the least times on the stations and on a mesh of 1 M triangles.
        let alone = together::<F, ANY>(token, bvh, rays, range, results);
        if 16 * alone > F::WIDTH * F::WIDTH {
            pause = usize::min(4 * pause, 512);
            skip = pause;
        } else {
            pause = usize::max(pause / 4, 1);
        }
    }
}

/// The results of some rays, which are followed one by one.
fn one_by_one(bvh: &Bvh, rays: &RayBatch, range: Range<usize>, results: &mut Results) {
    let each = range.map(|number| (number, rays.ray(number)));
    match results {
        Results::Nearest(hits) => closest_of_each(bvh, each, |number, hit| hits.set(number, hit)),
        Results::Occluded(occluded) => {
            occluded_of_each(bvh, each, |number, is_occluded| occluded[number] = is_occluded)
        }
    }
}
