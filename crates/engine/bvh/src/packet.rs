//! Packets: a ray in each lane, which go through the binary tree together, box by box.
//!
//! Where few of the rays enter a node, each of them goes through its subtree alone. The results have the bits of single rays: a
//! lane has the same operations, and the nearest hit does not depend on the order of visits.

use std::mem::MaybeUninit;
use std::ops::Range;

use dunkelfeld_geometry::Aabb;
use dunkelfeld_geometry::triangle::PlaneF64;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};

use crate::batch::{RayBatch, Results};
use crate::pairs::{MAX_LEVELS, Pair, Subtree};
use crate::scene::{Bvh, Hit, NO_HIT, Space};
use crate::simd8::WIDTH;
use crate::traverse::{self, Nearest, Part};
use crate::tree::{LEAF, NONE, Slabs, Tree, entry};
use crate::triangle_block::LaneShear;

/// Follows the rays of a range, at most one for each lane. Returns how often a ray went alone.
#[inline(always)]
pub(crate) fn together<F: Lanes, const ANY: bool>(
    token: F::Token,
    bvh: &Bvh,
    rays: &RayBatch,
    range: Range<usize>,
    results: &mut Results,
) -> usize {
    let origin: V3<F> = load3(token, rays.origin, &range);
    let direction: V3<F> = load3(token, rays.direction, &range);
    let end: F = load(token, rays.t_max, &range);
    let is_valid =
        is_finite(origin) & is_finite(direction) & direction.abs().max_element().is_positive() & end.is_positive();
    let valid = is_valid.bits() & (u32::MAX >> (32 - range.len()));
    let (none, zero) = (bits(token, NO_HIT), F::splat(token, 0.0));
    let boxes = Boxes::new(origin, direction, &bvh.top.bounds);
    let mut packet = Packet::<F, ANY> {
        token,
        bvh,
        rays,
        first: range.start,
        shear: LaneShear::new(origin, direction, boxes.slabs.near_inverse),
        boxes,
        origin,
        direction,
        live: valid,
        alone: 0,
        end,
        nearest: NearestHits { key: end, t: end.constant(f32::INFINITY), b1: zero, b2: zero, numbers: [none; 3] },
    };
    let whole = bvh.whole();
    if whole.instance == NO_HIT {
        packet.traverse::<true>(&bvh.top, NO_HIT, valid);
    } else {
        packet.traverse::<false>(&bvh.mesh(0).tree, 0, valid);
    }
    match results {
        Results::Occluded(occluded) => {
            for (lane, occluded) in occluded[range].iter_mut().enumerate() {
                *occluded = (valid & !packet.live) >> lane & 1 == 1;
            }
        }
        Results::Nearest(hits) => {
            let NearestHits { t, b1, b2, numbers: [instance, part, triangle], .. } = packet.nearest;
            store(t, &mut hits.t[range.clone()]);
            store(b1, &mut hits.b1[range.clone()]);
            store(b2, &mut hits.b2[range.clone()]);
            store_bits(instance, &mut hits.instance[range.clone()]);
            store_bits(part, &mut hits.part[range.clone()]);
            store_bits(triangle, &mut hits.triangle[range]);
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

    /// Calls a function with some lanes and their hits, which it may replace.
    #[inline(always)]
    fn each(&mut self, lanes: u32, mut f: impl FnMut(usize, &mut Nearest)) {
        let (token, mut all) = (self.t.token(), self.to_arrays());
        each_bit(lanes, |lane| {
            let mut nearest = all.lane(lane);
            f(lane, &mut nearest);
            all.set(lane, &nearest);
        });
        let [instance, part, triangle] = &all.numbers;
        *self = Self {
            key: F::load(token, &all.key),
            t: F::load(token, &all.t),
            b1: F::load(token, &all.b1),
            b2: F::load(token, &all.b2),
            numbers: [F::load(token, instance), F::load(token, part), F::load(token, triangle)],
        };
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

/// The rays of all lanes in the form that the box test needs.
#[derive(Clone, Copy)]
struct Boxes<F: Lanes> {
    /// Their numbers. The rows of the near sides have no meaning.
    slabs: Slabs<F>,
    /// The lanes whose near sides are the upper ones.
    down: [F::Mask; 3],
}

impl<F: Lanes> Boxes<F> {
    #[inline(always)]
    fn new(origin: V3<F>, direction: V3<F>, bounds: &Aabb) -> Self {
        let slabs = Slabs::new(origin, direction, 0, bounds);
        let [x, y, z] = slabs.near_inverse;
        Self { down: [is_negative(x), is_negative(y), is_negative(z)], slabs }
    }

    /// The lanes that enter the boxes of both children before `end`, and their distances.
    #[inline(always)]
    fn enter(&self, pair: &Pair, end: F) -> ([u32; 2], [F; 2]) {
        let (mut entered, mut nears) = ([0; 2], [end; 2]);
        for child in 0..2 {
            let (mut near, mut far) = (end.constant(0.0), end);
            for axis in 0..3 {
                let low = end.constant(pair.bounds[2 * axis][child]);
                let high = end.constant(pair.bounds[2 * axis + 1][child]);
                let (n, f) = (self.down[axis].select(high, low), self.down[axis].select(low, high));
                (near, far) = self.slabs.narrow(axis, n, f, near, far);
            }
            (entered[child], nears[child]) = (near.le(far).bits(), near);
        }
        (entered, nears)
    }
}

/// Rays that go through the tree together: for the nearest hits, or for any hit.
struct Packet<'a, F: Lanes, const ANY: bool> {
    token: F::Token,
    bvh: &'a Bvh,
    rays: &'a RayBatch<'a>,
    /// Number of the first ray.
    first: usize,
    boxes: Boxes<F>,
    shear: LaneShear<F>,
    origin: V3<F>,
    direction: V3<F>,
    /// Bits of the lanes that are not decided.
    live: u32,
    /// How often a ray went alone.
    alone: usize,
    end: F,
    nearest: NearestHits<F>,
}

/// A subtree that is not visited yet, and the lanes that enter it.
#[derive(Clone, Copy)]
struct Visit {
    subtree: Subtree,
    lanes: u32,
}

impl<F: Lanes, const ANY: bool> Packet<'_, F, ANY> {
    /// Follows the given lanes through a tree: that over the instances, or that of an instance in world space.
    #[inline(always)]
    fn traverse<const TOP: bool>(&mut self, tree: &Tree, instance: u32, lanes: u32) {
        if lanes == 0 || tree.first.word == NONE {
            return;
        }
        // The stacks are not cleared, because that would cost a quarter of a traversal.
        let mut stack = [const { MaybeUninit::<Visit>::uninit() }; MAX_LEVELS];
        let mut nears = [const { MaybeUninit::<F>::uninit() }; MAX_LEVELS];
        let mut top = 0;
        let (mut visit, mut near) = (Visit { subtree: tree.first, lanes }, self.end.constant(0.0));
        loop {
            let Visit { subtree, lanes } = visit;
            if subtree.word & LEAF != 0 {
                if TOP {
                    self.instance(subtree.word & !LEAF, lanes, near);
                } else {
                    self.leaf(instance, subtree, lanes, near);
                }
            } else {
                let pair = &tree.pairs[subtree.word as usize];
                if lanes.count_ones() as usize <= few::<F>() && pair.node != NONE {
                    self.alone(pair.node, lanes, near, if TOP { NO_HIT } else { instance });
                } else {
                    // A hit in a block counts from the place where the block begins, so the boxes in it have no distances.
                    let end = if ANY || pair.is_block { self.end } else { self.nearest.key };
                    let ([first, second], mut nears_of) = self.boxes.enter(pair, end);
                    if !ANY && pair.is_block {
                        nears_of = [near; 2];
                    }
                    let first = Visit { subtree: pair.child(0), lanes: first & lanes };
                    let second = Visit { subtree: pair.child(1), lanes: second & lanes };
                    let both = first.lanes & second.lanes;
                    let sooner = nears_of[1].lt(nears_of[0]).bits() & both;
                    let is_second_next = first.lanes == 0 || !ANY && 2 * sooner.count_ones() > both.count_ones();
                    let (next, later) = if is_second_next { (second, first) } else { (first, second) };
                    if next.lanes != 0 {
                        let [of_next, of_later] = if is_second_next { [nears_of[1], nears_of[0]] } else { nears_of };
                        (visit, near) = (next, of_next);
                        if later.lanes != 0 {
                            stack[top].write(later);
                            nears[top].write(of_later);
                            top += 1;
                        }
                        continue;
                    }
                }
            }
            loop {
                if top == 0 {
                    return;
                }
                top -= 1;
                // SAFETY: every entry below the top was written by a push.
                (visit, near) = unsafe { (stack[top].assume_init(), nears[top].assume_init()) };
                visit.lanes &= self.live;
                if !ANY {
                    visit.lanes &= near.le(self.nearest.key).bits();
                }
                if visit.lanes != 0 {
                    break;
                }
            }
        }
    }

    /// Visits an instance.
    #[inline(always)]
    fn instance(&mut self, number: u32, lanes: u32, near: F) {
        let Some(instance) = self.bvh.instances.get(number as usize) else { return };
        match instance.space {
            Space::World => self.traverse::<false>(&self.bvh.mesh(number).tree, number, lanes),
            Space::Fixed(_) | Space::Moving(_) => self.alone(LEAF | number, lanes, near, NO_HIT),
        }
    }

    /// Tests the triangles of a leaf one by one.
    #[inline(always)]
    fn leaf(&mut self, instance: u32, leaf: Subtree, lanes: u32, near: F) {
        let (bvh, token) = (self.bvh, self.token);
        let Some((block, part)) = bvh.mesh(instance).block(leaf.word & !LEAF) else { return };
        let mut triangles = u32::from(leaf.triangles);
        while triangles != 0 {
            let triangle = triangles.trailing_zeros() as usize & (WIDTH - 1);
            triangles &= triangles - 1;
            let lanes = lanes & self.live;
            let Some(found) = self.shear.intersect((block, triangle), lanes, self.end, self.nearest.key) else {
                continue;
            };
            let mut t = found.t;
            if found.near != 0 {
                // Within its own error of zero or of the ray's end.
                let exact = PlaneF64::new(&block.corners(triangle)).distance(self.origin, self.direction);
                t = F::mask(token, found.near).select(exact, t);
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
                key: t.max(near),
                t,
                b1: found.b1,
                b2: found.b2,
                numbers: [bits(token, instance), bits(token, part), bits(token, block.triangle(triangle))],
            };
            let hits = hits & F::mask(self.token, found.lanes);
            let equal = hits & nearest.key.eq(self.nearest.key) & nearest.t.le(self.nearest.t);
            self.nearest.replace(hits & nearest.key.lt(self.nearest.key), &nearest);
            if equal.any() {
                let found = nearest.to_arrays();
                self.nearest.each(equal.bits(), |lane, nearest| {
                    let found = found.lane(lane);
                    if found.is_before(nearest) {
                        *nearest = found;
                    }
                });
            }
        }
    }

    /// Follows the rays of a child one by one.
    #[inline(always)]
    fn alone(&mut self, child: u32, lanes: u32, near: F, instance: u32) {
        self.alone += lanes.count_ones() as usize;
        let near = near.to_array();
        let Self { bvh, rays, first, live, .. } = self;
        let place = |lane: usize| (rays.ray(*first + lane), Part { start: entry(near[lane], child), instance });
        if ANY {
            each_bit(lanes, |lane| {
                let (ray, part) = place(lane);
                *live &= !(u32::from(traverse::occluded_in_part(bvh, &ray, part)) << lane);
            });
        } else {
            self.nearest.each(lanes, |lane, nearest| {
                let (ray, part) = place(lane);
                traverse::closest_in_part(bvh, &ray, part, nearest);
            });
        }
    }
}

#[inline(always)]
fn is_finite<F: Lanes>(v: V3<F>) -> F::Mask {
    v.x.is_finite() & v.y.is_finite() & v.z.is_finite()
}

/// The lanes whose sign bit is set.
#[inline(always)]
fn is_negative<F: Lanes>(x: F) -> F::Mask {
    F::word_eq(x.to_bits() >> 31, F::splat_word(x.token(), 1))
}

/// A group of so many rays is followed one by one.
#[inline(always)]
pub(crate) fn few<F: Lanes>() -> usize {
    (3 * F::WIDTH / 16).max(1)
}

/// Calls a function with the number of each bit that is set.
#[inline(always)]
fn each_bit(mut bits: u32, mut f: impl FnMut(usize)) {
    while bits != 0 {
        f(bits.trailing_zeros() as usize & (MAX_WIDTH - 1));
        bits &= bits - 1;
    }
}

/// The bits of an integer in all lanes.
#[inline(always)]
fn bits<F: Lanes>(token: F::Token, number: u32) -> F {
    F::from_bits(F::splat_word(token, number))
}

/// A number of each ray. Lanes beyond the last ray have those of the last one.
#[inline(always)]
fn load<F: Lanes>(token: F::Token, from: &[f32], range: &Range<usize>) -> F {
    let from = &from[range.clone()];
    if from.len() == F::WIDTH {
        return F::load(token, from);
    }
    let mut lanes = [from[from.len() - 1]; MAX_WIDTH];
    lanes[..from.len()].copy_from_slice(from);
    F::load(token, &lanes)
}

/// [`load`] of three arrays.
#[inline(always)]
fn load3<F: Lanes>(token: F::Token, [x, y, z]: [&[f32]; 3], range: &Range<usize>) -> V3<F> {
    V3::new(load(token, x, range), load(token, y, range), load(token, z, range))
}

/// Writes a number of each ray.
#[inline(always)]
fn store<F: Lanes>(x: F, to: &mut [f32]) {
    if to.len() == F::WIDTH {
        return x.store(to);
    }
    to.copy_from_slice(&x.to_array()[..to.len()]);
}

/// [`store`] of bits.
#[inline(always)]
fn store_bits<F: Lanes>(x: F, to: &mut [u32]) {
    if to.len() == F::WIDTH {
        return F::store_word(x.to_bits(), to);
    }
    to.copy_from_slice(&F::word_to_array(x.to_bits())[..to.len()]);
}
