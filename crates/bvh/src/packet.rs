//! Batches of rays: a packet has a ray in each lane and goes through the tree child by child.
//!
//! The rays of a packet have the same shear axes and octant, so that the axes of triangles and the sides of boxes are those
//! of all lanes. Where few of them share a child, each of these rays goes through the subtree alone. The results have the
//! bits of single rays: a lane has the same operations, and the nearest hit does not depend on the order of visits.

use std::mem::MaybeUninit;

use dunkelfeld_geometry::triangle::{plane_distance_f64, shear_axes};
use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, Mask, V3, dispatch};

use crate::scene::{Bvh, Hit, NO_HIT, Space, is_valid};
use crate::simd8::WIDTH;
use crate::traverse::{self, Nearest, Part, Prepared};
use crate::tree::{LEAF, NONE, STACK, Tree, entry, octant};

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

/// The nearest hits of a batch: arrays of its length. A ray without a hit has the instance [`NO_HIT`], and its other
/// numbers mean nothing.
#[derive(Debug)]
pub struct HitBatch<'a> {
    /// Ray parameters, as [`Hit::t`].
    pub t: &'a mut [f32],
    /// Barycentric weights of the second corners.
    pub b1: &'a mut [f32],
    /// Barycentric weights of the third corners.
    pub b2: &'a mut [f32],
    /// Instances, or [`NO_HIT`].
    pub instance: &'a mut [u32],
    /// Parts, as [`Hit::part`].
    pub part: &'a mut [u32],
    /// Triangles, as [`Hit::triangle`].
    pub triangle: &'a mut [u32],
}

impl RayBatch<'_> {
    #[inline(always)]
    fn ray(&self, i: usize) -> Ray {
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

/// Rays are sorted in groups of this size.
const GROUP: usize = 1024;
/// Number of kinds of rays: three axes and eight octants, and rays that hit nothing.
const KINDS: usize = 25;

impl Bvh {
    /// [`Bvh::closest_hit`] of each ray of a batch, with the same bits for all instruction sets.
    ///
    /// # Panics
    /// If the arrays have different lengths.
    pub fn closest_hits(&self, set: InstructionSet, rays: &RayBatch, hits: &mut HitBatch) {
        dispatch!(set, F, token => each_packet::<F, false>(token, self, rays, &mut Results::Nearest(hits)));
    }

    /// [`Bvh::occluded`] of each ray of a batch.
    ///
    /// # Panics
    /// If the arrays have different lengths.
    pub fn occluded_batch(&self, set: InstructionSet, rays: &RayBatch, occluded: &mut [bool]) {
        dispatch!(set, F, token => each_packet::<F, true>(token, self, rays, &mut Results::Occluded(occluded)));
    }
}

/// The results of a batch.
enum Results<'a, 'b> {
    Nearest(&'a mut HitBatch<'b>),
    Occluded(&'a mut [bool]),
}

/// The kind of a ray: rays of a packet have the same one.
#[inline(always)]
fn kind(ray: &Ray) -> usize {
    if is_valid(ray) { 3 * octant(ray.direction) + shear_axes(ray.direction)[2] } else { KINDS - 1 }
}

/// Sorts rays by their kind and follows them in packets.
#[inline(always)]
fn each_packet<F: Lanes, const ANY: bool>(token: F::Token, bvh: &Bvh, rays: &RayBatch, results: &mut Results) {
    let count = rays.t_max.len();
    let (mut kinds, mut order) = ([0u8; GROUP], [0u32; GROUP]);
    for first in (0..count).step_by(GROUP) {
        let group = GROUP.min(count - first);
        let mut ends = [0; KINDS];
        for i in 0..group {
            let kind = kind(&rays.ray(first + i));
            kinds[i] = kind as u8;
            ends[kind] += 1;
        }
        let mut end = 0;
        for kind in 0..KINDS {
            (ends[kind], end) = (end, end + ends[kind]);
        }
        for i in 0..group {
            let at = &mut ends[usize::from(kinds[i])];
            order[*at] = (first + i) as u32;
            *at += 1;
        }
        let mut begin = 0;
        for kind in 0..KINDS {
            let mut rest = &order[begin..ends[kind]];
            begin = ends[kind];
            while !rest.is_empty() {
                let (packet, others) = rest.split_at(rest.len().min(F::WIDTH));
                rest = others;
                if kind == KINDS - 1 || packet.len() <= few::<F>() {
                    alone::<ANY>(bvh, rays, packet, results);
                } else {
                    together::<F, ANY>(token, bvh, rays, packet, results);
                }
            }
        }
    }
}

/// A group of so many rays is followed one by one.
#[inline(always)]
fn few<F: Lanes>() -> usize {
    F::WIDTH.div_ceil(4)
}

#[inline(never)]
fn alone<const ANY: bool>(bvh: &Bvh, rays: &RayBatch, numbers: &[u32], results: &mut Results) {
    for &i in numbers {
        let i = i as usize;
        let ray = rays.ray(i);
        match results {
            Results::Nearest(hits) => hits.set(i, &bvh.closest_hit(&ray).unwrap_or(Nearest::none(0.0).hit)),
            Results::Occluded(occluded) => occluded[i] = bvh.occluded(&ray),
        }
    }
}

#[inline(always)]
fn together<F: Lanes, const ANY: bool>(
    token: F::Token,
    bvh: &Bvh,
    rays: &RayBatch,
    numbers: &[u32],
    results: &mut Results,
) {
    let mut index = [numbers[0]; MAX_WIDTH];
    index[..numbers.len()].copy_from_slice(numbers);
    let first = rays.ray(index[0] as usize).direction;
    let [ox, oy, oz] = rays.origin;
    let [dx, dy, dz] = rays.direction;
    let origin = V3::new(F::gather(token, ox, &index), F::gather(token, oy, &index), F::gather(token, oz, &index));
    let direction = V3::new(F::gather(token, dx, &index), F::gather(token, dy, &index), F::gather(token, dz, &index));
    let form = Prepared::<F>::new(origin, direction, shear_axes(first), octant(first), &bvh.top.bounds);
    let end = F::gather(token, rays.t_max, &index);
    let none = F::from_bits(F::splat_word(token, NO_HIT));
    let zero = F::splat(token, 0.0);
    let mut packet = Packet::<F, ANY> {
        token,
        bvh,
        rays,
        index,
        form,
        arrays: form.to_arrays(),
        live: u32::MAX >> (32 - numbers.len()),
        end,
        nearest: NearestHits { key: end, t: end.constant(f32::INFINITY), b1: zero, b2: zero, numbers: [none; 3] },
    };
    let whole = bvh.whole();
    if whole.instance == NO_HIT {
        packet.traverse::<true>(&bvh.top, NO_HIT, packet.live, zero);
    } else {
        packet.traverse::<false>(&bvh.mesh(0).tree, 0, packet.live, zero);
    }
    match results {
        Results::Occluded(occluded) => {
            for (lane, &i) in numbers.iter().enumerate() {
                occluded[i as usize] = packet.live >> lane & 1 == 0;
            }
        }
        Results::Nearest(hits) => {
            let nearest = packet.nearest.to_arrays();
            for (lane, &i) in numbers.iter().enumerate() {
                hits.set(i as usize, &nearest.lane(lane).hit);
            }
        }
    }
}

/// [`Nearest`] of each lane. The numbers are the bits of the instance, the part and the triangle.
#[derive(Clone, Copy)]
struct NearestHits<F> {
    key: F,
    t: F,
    b1: F,
    b2: F,
    numbers: [F; 3],
}

impl<F: Lanes> NearestHits<F> {
    #[inline(always)]
    fn to_arrays(self) -> NearestHits<[f32; MAX_WIDTH]> {
        let [instance, part, triangle] = self.numbers;
        NearestHits {
            key: self.key.to_array(),
            t: self.t.to_array(),
            b1: self.b1.to_array(),
            b2: self.b2.to_array(),
            numbers: [instance.to_array(), part.to_array(), triangle.to_array()],
        }
    }

    #[inline(always)]
    fn from_arrays(token: F::Token, from: &NearestHits<[f32; MAX_WIDTH]>) -> Self {
        let [instance, part, triangle] = &from.numbers;
        Self {
            key: F::load(token, &from.key),
            t: F::load(token, &from.t),
            b1: F::load(token, &from.b1),
            b2: F::load(token, &from.b2),
            numbers: [F::load(token, instance), F::load(token, part), F::load(token, triangle)],
        }
    }

    /// `yes` in the lanes that are true, this one in the others.
    #[inline(always)]
    fn replace(&mut self, mask: F::Mask, yes: &Self) {
        self.key = mask.select(yes.key, self.key);
        self.t = mask.select(yes.t, self.t);
        self.b1 = mask.select(yes.b1, self.b1);
        self.b2 = mask.select(yes.b2, self.b2);
        for i in 0..3 {
            self.numbers[i] = mask.select(yes.numbers[i], self.numbers[i]);
        }
    }
}

impl NearestHits<[f32; MAX_WIDTH]> {
    #[inline(always)]
    fn lane(&self, lane: usize) -> Nearest {
        let [instance, part, triangle] =
            [self.numbers[0][lane].to_bits(), self.numbers[1][lane].to_bits(), self.numbers[2][lane].to_bits()];
        let hit = Hit { t: self.t[lane], instance, part, triangle, b1: self.b1[lane], b2: self.b2[lane] };
        Nearest { key: self.key[lane], hit }
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, Nearest { key, hit }: &Nearest) {
        (self.key[lane], self.t[lane], self.b1[lane], self.b2[lane]) = (*key, hit.t, hit.b1, hit.b2);
        self.numbers[0][lane] = f32::from_bits(hit.instance);
        self.numbers[1][lane] = f32::from_bits(hit.part);
        self.numbers[2][lane] = f32::from_bits(hit.triangle);
    }
}

/// Rays that go through the tree together: for the nearest hits, or for any hit.
struct Packet<'a, F: Lanes, const ANY: bool> {
    token: F::Token,
    bvh: &'a Bvh,
    rays: &'a RayBatch<'a>,
    /// Number of the ray of each lane.
    index: [u32; MAX_WIDTH],
    form: Prepared<F>,
    /// The same numbers in memory, for rays that go alone.
    arrays: Prepared<[f32; MAX_WIDTH]>,
    /// Bits of the lanes that are not decided.
    live: u32,
    end: F,
    nearest: NearestHits<F>,
}

/// A child that is not visited yet.
#[derive(Clone, Copy)]
struct Child {
    /// Entry distances.
    near: [f32; MAX_WIDTH],
    /// The lanes that enter it.
    lanes: u32,
    word: u32,
}

impl<F: Lanes, const ANY: bool> Packet<'_, F, ANY> {
    /// Follows the given lanes through a tree: that over the instances, or that of an instance in world space.
    #[inline(always)]
    fn traverse<const TOP: bool>(&mut self, tree: &Tree, instance: u32, lanes: u32, near: F) {
        if tree.root == NONE {
            return;
        }
        // The stack is not cleared, because that would cost a quarter of a traversal.
        let mut stack = [const { MaybeUninit::<Child>::uninit() }; STACK];
        let mut top = 0;
        let mut child = Child { near: near.to_array(), lanes, word: tree.root };
        loop {
            if child.lanes.count_ones() as usize <= few::<F>() {
                self.alone(&child, if TOP { NO_HIT } else { instance });
            } else if child.word & LEAF == 0 {
                let node = &tree.nodes[child.word as usize];
                let mut children = [const { MaybeUninit::<Child>::uninit() }; WIDTH];
                let mut order = [0u64; WIDTH];
                let mut count = 0;
                for slot in 0..WIDTH {
                    let word = node.children[slot];
                    let (entered, near) = self.form.slabs.enter_child(node, slot, self.nearest.key);
                    let lanes = entered.bits() & child.lanes;
                    if lanes != 0 {
                        let near = near.to_array();
                        let next = entry(near[lanes.trailing_zeros() as usize & (MAX_WIDTH - 1)], slot as u32);
                        children[slot].write(Child { near, lanes, word });
                        let mut at = count;
                        while !ANY && at > 0 && order[at - 1] < next {
                            order[at] = order[at - 1];
                            at -= 1;
                        }
                        order[at] = next;
                        count += 1;
                    }
                }
                // The nearest one is the last.
                for &next in &order[..count] {
                    stack[top] = children[next as u32 as usize & (WIDTH - 1)];
                    top += 1;
                }
            } else if TOP {
                self.instance(&child);
            } else {
                self.leaf(instance, &child);
            }
            loop {
                if top == 0 {
                    return;
                }
                top -= 1;
                // SAFETY: every entry below the top was written by a push of a child that was written.
                child = unsafe { stack[top].assume_init() };
                child.lanes &= self.live;
                if !ANY {
                    child.lanes &= F::load(self.token, &child.near).le(self.nearest.key).bits();
                }
                if child.lanes != 0 {
                    break;
                }
            }
        }
    }

    /// Visits an instance.
    #[inline(always)]
    fn instance(&mut self, child: &Child) {
        let number = child.word & !LEAF;
        let Some(instance) = self.bvh.instances.get(number as usize) else { return };
        match instance.space {
            Space::World => {
                let tree = &self.bvh.mesh(number).tree;
                self.traverse::<false>(tree, number, child.lanes, F::load(self.token, &child.near));
            }
            Space::Fixed(_) | Space::Moving(_) => self.alone(child, NO_HIT),
        }
    }

    /// Tests the triangles of a leaf one by one.
    #[inline(always)]
    fn leaf(&mut self, instance: u32, child: &Child) {
        let bvh = self.bvh;
        let Some((block, part)) = bvh.mesh(instance).block(child.word & !LEAF) else { return };
        let entry = F::load(self.token, &child.near);
        for triangle in 0..block.count() {
            let lanes = child.lanes & self.live;
            let Some(found) = self.form.shear.intersect_one(block, triangle, lanes, self.end, self.nearest.key) else {
                continue;
            };
            let mut t = found.t;
            if found.near != 0 {
                let mut ts = t.to_array();
                self.decide_near(found.near, &block.corners(triangle), &mut ts);
                t = F::load(self.token, &ts);
            }
            let hits = t.is_positive() & t.lt(self.end);
            if ANY {
                self.live &= !(found.lanes & hits.bits());
                if self.live == 0 {
                    return;
                }
                continue;
            }
            let nearest = NearestHits {
                key: t.max(entry),
                t,
                b1: found.b1,
                b2: found.b2,
                numbers: [self.bits(instance), self.bits(part), self.bits(block.triangle(triangle))],
            };
            let hits = hits & F::mask(self.token, found.lanes);
            let equal = hits & nearest.key.eq(self.nearest.key) & nearest.t.le(self.nearest.t);
            self.nearest.replace(hits & nearest.key.lt(self.nearest.key), &nearest);
            if equal.any() {
                self.decide_equal(equal.bits(), &nearest);
            }
        }
    }

    /// Distances within their own error of zero or of the ray's end, computed again in f64.
    #[inline(never)]
    fn decide_near(&self, lanes: u32, corners: &[Vec3; 3], t: &mut [f32; MAX_WIDTH]) {
        each_bit(lanes, |lane| t[lane] = plane_distance_f64(&self.rays.ray(self.index[lane] as usize), corners));
    }

    /// The order of equally near hits.
    #[inline(always)]
    fn decide_equal(&mut self, lanes: u32, found: &NearestHits<F>) {
        let (found, mut nearest) = (found.to_arrays(), self.nearest.to_arrays());
        order_equal(lanes, &found, &mut nearest);
        self.nearest = NearestHits::from_arrays(self.token, &nearest);
    }

    #[inline(always)]
    fn bits(&self, number: u32) -> F {
        F::from_bits(F::splat_word(self.token, number))
    }

    /// Follows the rays of a child one by one.
    #[inline(always)]
    fn alone(&mut self, child: &Child, instance: u32) {
        let mut nearest = self.nearest.to_arrays();
        self.live &= !self.each_alone(child, instance, &mut nearest);
        if !ANY {
            self.nearest = NearestHits::from_arrays(self.token, &nearest);
        }
    }

    /// [`Self::alone`] for nearest hits in memory. Returns the lanes that are blocked.
    #[inline(never)]
    fn each_alone(&self, child: &Child, instance: u32, nearest: &mut NearestHits<[f32; MAX_WIDTH]>) -> u32 {
        let mut blocked = 0;
        each_bit(child.lanes, |lane| {
            let (form, ray) = (self.arrays.lane(lane), self.rays.ray(self.index[lane] as usize));
            let part = Part { start: entry(child.near[lane], child.word), instance };
            if ANY {
                blocked |= u32::from(traverse::occluded_in_part(self.bvh, &form, &ray, part)) << lane;
            } else {
                let mut of_lane = nearest.lane(lane);
                traverse::closest_in_part(self.bvh, &form, &ray, part, &mut of_lane);
                nearest.set(lane, &of_lane);
            }
        });
        blocked
    }
}

/// Replaces equally near hits by those that count.
#[inline(never)]
fn order_equal(lanes: u32, found: &NearestHits<[f32; MAX_WIDTH]>, nearest: &mut NearestHits<[f32; MAX_WIDTH]>) {
    each_bit(lanes, |lane| {
        let found = found.lane(lane);
        if found.is_before(&nearest.lane(lane)) {
            nearest.set(lane, &found);
        }
    });
}

/// Calls a function with the number of each bit that is set.
fn each_bit(mut bits: u32, mut f: impl FnMut(usize)) {
    while bits != 0 {
        f(bits.trailing_zeros() as usize & (MAX_WIDTH - 1));
        bits &= bits - 1;
    }
}
