//! Packets: a ray in each lane, which go through the tree together, child by child.
//!
//! Where few of the rays enter a child, each of them goes through the subtree alone.

use std::mem::MaybeUninit;

use dunkelfeld_geometry::triangle::{PlaneF64, shear_axes};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};

use crate::batch::{RayBatch, Results, bits, few, load, load3, store, store_bits};
use crate::beam::Beam;
use crate::scene::{Bvh, Hit, NO_HIT, Space};
use crate::simd8::WIDTH;
use crate::traverse::{self, Nearest, Part, Prepared};
use crate::tree::{LEAF, MAX_DEPTH, NONE, STACK, Tree, entry, growth, octant};

/// Follows a packet. Returns how often a ray went alone.
#[inline(always)]
pub(crate) fn together<F: Lanes, const ANY: bool>(
    token: F::Token,
    bvh: &Bvh,
    rays: &RayBatch,
    numbers: &[u32],
    results: &mut Results,
) -> usize {
    let first = rays.ray(numbers[0] as usize).direction;
    let (origin, direction) = (load3(token, rays.origin, numbers), load3(token, rays.direction, numbers));
    let bounds = &bvh.top.bounds;
    let form = Prepared::<F>::new(origin, direction, shear_axes(first), octant(first), bounds);
    let ray_end: F = load(token, rays.t_max, numbers);
    let none = bits(token, NO_HIT);
    let zero = F::splat(token, 0.0);
    let mut packet = Packet::<F, ANY> {
        token,
        bvh,
        rays,
        numbers,
        form,
        arrays: &mut None,
        origin,
        direction,
        beam: Beam::new(origin, &form.slabs, growth(origin, bounds)),
        ends: [ray_end.extremes()[1]; 2],
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

/// Rays that go through the tree together: for the nearest hits, or for any hit.
struct Packet<'a, F: Lanes, const ANY: bool> {
    token: F::Token,
    bvh: &'a Bvh,
    rays: &'a RayBatch<'a>,
    /// Number of the ray of each lane.
    numbers: &'a [u32],
    form: Prepared<F>,
    /// The same numbers in memory, once a ray has gone alone.
    arrays: &'a mut Option<Prepared<[f32; MAX_WIDTH]>>,
    origin: V3<F>,
    direction: V3<F>,
    beam: Beam<F::Eight>,
    /// The greatest end of all rays, and the greatest distance of a nearest hit.
    ends: [f32; 2],
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
    fn traverse<const TOP: bool>(&mut self, tree: &Tree, instance: u32, lanes: u32, mut near: F) {
        if tree.root == NONE {
            return;
        }
        // The stacks are not cleared, because that would cost a quarter of a traversal.
        let mut stack = [const { MaybeUninit::<Child>::uninit() }; STACK];
        let mut nears = [const { MaybeUninit::<F>::uninit() }; WIDTH * MAX_DEPTH];
        let mut top = 0;
        let mut child = Child { word: tree.root, lanes, key: 0.0, near: 0, end: 0 };
        loop {
            if child.word & LEAF == 0 && child.lanes.count_ones() as usize > few::<F>() {
                let node = &tree.nodes[child.word as usize];
                let (mut children, mut count) = ([Child::default(); WIDTH], 0);
                let mut slots = self.beam.children(node, self.ends[1]);
                while slots != 0 {
                    let slot = slots.trailing_zeros() as usize & (WIDTH - 1);
                    slots &= slots - 1;
                    let (entered, near) = self.form.slabs.enter_child(node, slot, self.nearest.key);
                    let lanes = entered.bits() & child.lanes;
                    if lanes != 0 {
                        let place = usize::from(child.end) + count;
                        nears[place].write(near);
                        let key = near.to_array()[lanes.trailing_zeros() as usize & (MAX_WIDTH - 1)];
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
            } else if child.word & LEAF == 0 {
                self.alone(&child, near, if TOP { NO_HIT } else { instance });
            } else if TOP {
                self.instance(&child, near);
            } else {
                self.leaf(instance, &child, near);
            }
            loop {
                if top == 0 {
                    return;
                }
                top -= 1;
                // SAFETY: every entry below the top was written by a push.
                child = unsafe { stack[top].assume_init() };
                // SAFETY: the distances of a child were written with it. Those of later nodes are at its end or behind.
                near = unsafe { nears[usize::from(child.near)].assume_init() };
                child.lanes &= self.live;
                if !ANY {
                    child.lanes &= near.le(self.nearest.key).bits();
                }
                if child.lanes != 0 {
                    break;
                }
            }
        }
    }

    /// Visits an instance.
    #[inline(always)]
    fn instance(&mut self, child: &Child, near: F) {
        let number = child.word & !LEAF;
        let Some(instance) = self.bvh.instances.get(number as usize) else { return };
        match instance.space {
            Space::World => {
                let tree = &self.bvh.mesh(number).tree;
                self.traverse::<false>(tree, number, child.lanes, near);
            }
            Space::Fixed(_) | Space::Moving(_) => self.alone(child, near, NO_HIT),
        }
    }

    /// Tests the triangles of a leaf one by one.
    #[inline(always)]
    fn leaf(&mut self, instance: u32, child: &Child, near: F) {
        let (bvh, token) = (self.bvh, self.token);
        let Some((block, part)) = bvh.mesh(instance).block(child.word & !LEAF) else { return };
        let mut triangles = self.beam.triangles(block, self.ends[0]);
        let mut is_nearer = false;
        while triangles != 0 {
            let triangle = triangles.trailing_zeros() as usize & (WIDTH - 1);
            triangles &= triangles - 1;
            let lanes = child.lanes & self.live;
            let Some(found) = self.form.shear.intersect_one(block, triangle, lanes, self.end, self.nearest.key) else {
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
            is_nearer |= hits.any();
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
        if is_nearer {
            self.ends[1] = self.nearest.key.extremes()[1];
        }
    }

    /// Follows the rays of a child one by one.
    #[inline(always)]
    fn alone(&mut self, child: &Child, near: F, instance: u32) {
        self.alone += child.lanes.count_ones() as usize;
        let near = near.to_array();
        let Self { bvh, rays, numbers, live, form, .. } = self;
        let arrays = self.arrays.get_or_insert_with(
            #[inline(always)]
            || form.to_arrays(),
        );
        let place = |lane: usize| {
            let part = Part { start: entry(near[lane], child.word), instance };
            (arrays.lane(lane), rays.ray(numbers[lane] as usize), part)
        };
        if ANY {
            each_bit(child.lanes, |lane| {
                let (form, ray, part) = place(lane);
                *live &= !(u32::from(traverse::occluded_in_part(bvh, &form, &ray, part)) << lane);
            });
        } else {
            self.nearest.each(child.lanes, |lane, nearest| {
                let (form, ray, part) = place(lane);
                traverse::closest_in_part(bvh, &form, &ray, part, nearest);
            });
            self.ends[1] = self.nearest.key.extremes()[1];
        }
    }
}

/// Calls a function with the number of each bit that is set.
#[inline(always)]
fn each_bit(mut bits: u32, mut f: impl FnMut(usize)) {
    while bits != 0 {
        f(bits.trailing_zeros() as usize & (MAX_WIDTH - 1));
        bits &= bits - 1;
    }
}
