//! Batches of rays: a packet has a ray in each lane and goes through the tree child by child.
//!
//! The rays of a packet have the same shear axes and octant, so that the axes of triangles and the sides of boxes are those
//! of all lanes. Where few of them share a child, each of these rays goes through the subtree alone. The results have the
//! bits of single rays: a lane has the same operations, and the nearest hit does not depend on the order of visits.

use std::mem::MaybeUninit;
use std::ops::Range;

use dunkelfeld_geometry::triangle::{PlaneF64, shear_axes};
use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, Mask, V3, dispatch};

use crate::scene::{Bvh, Hit, NO_HIT, Space};
use crate::simd8::WIDTH;
use crate::traverse::{self, Nearest, Part, Prepared};
use crate::tree::{LEAF, MAX_DEPTH, NONE, STACK, Tree, entry, octant};

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
fn bits<F: Lanes>(token: F::Token, number: u32) -> F {
    F::from_bits(F::splat_word(token, number))
}

/// Sorts rays by their kind, and follows them in packets.
#[inline(always)]
fn each_packet<F: Lanes, const ANY: bool>(token: F::Token, bvh: &Bvh, rays: &RayBatch, results: &mut Results) {
    let count = rays.t_max.len();
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
                if kind == INVALID || packet.len() <= few::<F>() || skip > 0 {
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
fn sort(first: u32, kinds: &[u32], order: &mut [u32; GROUP]) -> [usize; KINDS] {
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
        order[*at % GROUP] = number;
        *at += 1;
    }
    ends
}

/// A group of so many rays is followed one by one.
#[inline(always)]
fn few<F: Lanes>() -> usize {
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
fn load<F: Lanes>(token: F::Token, from: &[f32], numbers: &[u32]) -> F {
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
fn load3<F: Lanes>(token: F::Token, [x, y, z]: [&[f32]; 3], numbers: &[u32]) -> V3<F> {
    V3::new(load(token, x, numbers), load(token, y, numbers), load(token, z, numbers))
}

/// Writes a number of each ray.
#[inline(always)]
fn store<F: Lanes>(x: F, to: &mut [f32], numbers: &[u32]) {
    if let Some(row) = in_a_row::<F>(numbers) {
        return x.store(&mut to[row]);
    }
    for (number, x) in numbers.iter().zip(x.to_array()) {
        to[*number as usize] = x;
    }
}

/// [`store`] of bits.
#[inline(always)]
fn store_bits<F: Lanes>(x: F, to: &mut [u32], numbers: &[u32]) {
    if let Some(row) = in_a_row::<F>(numbers) {
        return F::store_word(x.to_bits(), &mut to[row]);
    }
    for (number, x) in numbers.iter().zip(F::word_to_array(x.to_bits())) {
        to[*number as usize] = x;
    }
}

/// Follows a packet. Returns how often a ray went alone.
#[inline(always)]
fn together<F: Lanes, const ANY: bool>(
    token: F::Token,
    bvh: &Bvh,
    rays: &RayBatch,
    numbers: &[u32],
    results: &mut Results,
) -> usize {
    let first = rays.ray(numbers[0] as usize).direction;
    let (origin, direction) = (load3(token, rays.origin, numbers), load3(token, rays.direction, numbers));
    let form = Prepared::<F>::new(origin, direction, shear_axes(first), octant(first), &bvh.top.bounds);
    let ray_end = load(token, rays.t_max, numbers);
    let none = bits(token, NO_HIT);
    let zero = F::splat(token, 0.0);
    let mut packet = Packet::<F, ANY> {
        token,
        bvh,
        rays,
        numbers,
        form,
        arrays: form.to_arrays(),
        live: u32::MAX >> (32 - numbers.len()),
        alone: 0,
        end: ray_end,
        nearest: NearestHits {
            key: ray_end,
            t: ray_end.constant(f32::INFINITY),
            b1: zero,
            b2: zero,
            numbers: [none; 3],
        },
    };
    let whole = bvh.whole();
    if whole.instance == NO_HIT {
        packet.traverse::<true>(&bvh.top, NO_HIT, packet.live, zero);
    } else {
        packet.traverse::<false>(&bvh.mesh(0).tree, 0, packet.live, zero);
    }
    match results {
        Results::Occluded(occluded) => {
            for (lane, number) in numbers.iter().enumerate() {
                occluded[*number as usize] = packet.live >> lane & 1 == 0;
            }
        }
        Results::Nearest(hits) => {
            let NearestHits { t, b1, b2, numbers: [instance, part, triangle], .. } = packet.nearest;
            store(t, hits.t, numbers);
            store(b1, hits.b1, numbers);
            store(b2, hits.b2, numbers);
            store_bits(instance, hits.instance, numbers);
            store_bits(part, hits.part, numbers);
            store_bits(triangle, hits.triangle, numbers);
        }
    }
    packet.alone
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
    numbers: &'a [u32],
    form: Prepared<F>,
    /// The same numbers in memory, for rays that go alone.
    arrays: Prepared<[f32; MAX_WIDTH]>,
    /// Bits of the lanes that are not decided.
    live: u32,
    /// How often a ray went alone.
    alone: usize,
    end: F,
    nearest: NearestHits<F>,
}

/// A child that is not visited yet.
#[derive(Clone, Copy, Default)]
struct Child {
    word: u32,
    /// The lanes that enter it.
    lanes: u32,
    /// Entry distance of one of these lanes.
    key: f32,
    /// Place of the entry distances of all lanes, and the end of those of its siblings.
    near: u16,
    end: u16,
}

impl<F: Lanes, const ANY: bool> Packet<'_, F, ANY> {
    /// Follows the given lanes through a tree: that over the instances, or that of an instance in world space.
    #[inline(always)]
    fn traverse<const TOP: bool>(&mut self, tree: &Tree, instance: u32, lanes: u32, near: F) {
        if tree.root == NONE {
            return;
        }
        // The stacks are not cleared, because that would cost a quarter of a traversal.
        let mut stack = [const { MaybeUninit::<Child>::uninit() }; STACK];
        let mut nears = [const { MaybeUninit::<[f32; MAX_WIDTH]>::uninit() }; WIDTH * MAX_DEPTH + 1];
        nears[0].write(near.to_array());
        let mut top = 0;
        let mut child = Child { word: tree.root, lanes, key: 0.0, near: 0, end: 1 };
        loop {
            if child.word & LEAF == 0 && child.lanes.count_ones() as usize > few::<F>() {
                let node = &tree.nodes[child.word as usize];
                let (mut children, mut count) = ([Child::default(); WIDTH], 0);
                for slot in 0..WIDTH {
                    let (entered, near) = self.form.slabs.enter_child(node, slot, self.nearest.key);
                    let lanes = entered.bits() & child.lanes;
                    if lanes != 0 {
                        let (place, near) = (usize::from(child.end) + count, near.to_array());
                        nears[place].write(near);
                        let key = near[lanes.trailing_zeros() as usize & (MAX_WIDTH - 1)];
                        // The nearest one is the last.
                        let mut at = count;
                        while !ANY && at > 0 && children[at - 1].key < key {
                            children[at] = children[at - 1];
                            at -= 1;
                        }
                        children[at] = Child { word: node.children[slot], lanes, key, near: place as u16, end: 0 };
                        count += 1;
                    }
                }
                for next in &children[..count] {
                    stack[top].write(Child { end: child.end + count as u16, ..*next });
                    top += 1;
                }
            } else {
                // SAFETY: the places of the distances of a child were written with it.
                let near = unsafe { nears[usize::from(child.near)].assume_init_ref() };
                if child.word & LEAF == 0 {
                    self.alone(&child, near, if TOP { NO_HIT } else { instance });
                } else if TOP {
                    self.instance(&child, near);
                } else {
                    self.leaf(instance, &child, near);
                }
            }
            loop {
                if top == 0 {
                    return;
                }
                top -= 1;
                // SAFETY: every entry below the top was written by a push, and so were its distances.
                let near;
                (child, near) = unsafe {
                    let child = stack[top].assume_init();
                    (child, nears[usize::from(child.near)].assume_init_ref())
                };
                child.lanes &= self.live;
                if !ANY {
                    child.lanes &= F::load(self.token, near).le(self.nearest.key).bits();
                }
                if child.lanes != 0 {
                    break;
                }
            }
        }
    }

    /// Visits an instance.
    #[inline(always)]
    fn instance(&mut self, child: &Child, near: &[f32; MAX_WIDTH]) {
        let number = child.word & !LEAF;
        let Some(instance) = self.bvh.instances.get(number as usize) else { return };
        match instance.space {
            Space::World => {
                let tree = &self.bvh.mesh(number).tree;
                self.traverse::<false>(tree, number, child.lanes, F::load(self.token, near));
            }
            Space::Fixed(_) | Space::Moving(_) => self.alone(child, near, NO_HIT),
        }
    }

    /// Tests the triangles of a leaf one by one.
    #[inline(always)]
    fn leaf(&mut self, instance: u32, child: &Child, near: &[f32; MAX_WIDTH]) {
        let (bvh, token) = (self.bvh, self.token);
        let Some((block, part)) = bvh.mesh(instance).block(child.word & !LEAF) else { return };
        let entry = F::load(self.token, near);
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
                numbers: [bits(token, instance), bits(token, part), bits(token, block.triangle(triangle))],
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
        let plane = PlaneF64::new(corners);
        each_bit(lanes, |lane| t[lane] = plane.distance(&self.rays.ray(self.numbers[lane] as usize)));
    }

    /// The order of equally near hits.
    #[inline(always)]
    fn decide_equal(&mut self, lanes: u32, found: &NearestHits<F>) {
        let (found, mut nearest) = (found.to_arrays(), self.nearest.to_arrays());
        order_equal(lanes, &found, &mut nearest);
        self.nearest = NearestHits::from_arrays(self.token, &nearest);
    }

    /// Follows the rays of a child one by one.
    #[inline(always)]
    fn alone(&mut self, child: &Child, near: &[f32; MAX_WIDTH], instance: u32) {
        self.alone += child.lanes.count_ones() as usize;
        let mut nearest = self.nearest.to_arrays();
        self.live &= !self.each_alone(child, near, instance, &mut nearest);
        if !ANY {
            self.nearest = NearestHits::from_arrays(self.token, &nearest);
        }
    }

    /// [`Self::alone`] for nearest hits in memory. Returns the lanes that are blocked.
    #[inline(never)]
    fn each_alone(
        &self,
        child: &Child,
        near: &[f32; MAX_WIDTH],
        instance: u32,
        nearest: &mut NearestHits<[f32; MAX_WIDTH]>,
    ) -> u32 {
        let mut blocked = 0;
        each_bit(child.lanes, |lane| {
            let (form, ray) = (self.arrays.lane(lane), self.rays.ray(self.numbers[lane] as usize));
            let part = Part { start: entry(near[lane], child.word), instance };
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
