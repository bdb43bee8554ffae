//! Traversal of both levels by a ray, compiled once for each kind of machine.
//!
//! There are two queries, the nearest hit and occlusion. Each has a visitor of the leaves of meshes and one of instances.
//! [`Reported`] contains the triangles that an occlusion query reports and passes. It is a type, so that a query without
//! such triangles is compiled without their code.

use dunkelfeld_geometry::triangle::{UNIT_ROUNDOFF, plane_distance_f64, shear_axes};
use dunkelfeld_geometry::{Aabb, Ray, RigidMotion, Transform};
use fearless_simd::Simd;

use crate::scene::{Bvh, Hit, Instance, MeshTree, NO_HIT, Space, is_valid};
use crate::simd8::{Eight, F8, WIDTH, dispatch8};
use crate::tree::{Leaves, Slabs, octant};
use crate::triangle_block::{Candidates, Shear, TriangleBlock};

/// The triangles that do not block a ray, and the receiver of their hits.
trait Reported {
    /// The lanes of these triangles.
    fn lanes(&self, block: &TriangleBlock) -> u32;
    /// Gets a hit on one of them.
    fn report(&mut self, hit: Hit);
}

/// No triangle is reported: each one blocks.
struct NoTriangles;

/// The alpha-tested triangles are reported.
struct AlphaTestedTriangles<F>(F);

/// All triangles are reported, and none blocks.
struct AllTriangles<F>(F);

impl Reported for NoTriangles {
    #[inline(always)]
    fn lanes(&self, _block: &TriangleBlock) -> u32 {
        0
    }
    #[inline(always)]
    fn report(&mut self, _hit: Hit) {}
}

impl<F: FnMut(Hit)> Reported for AlphaTestedTriangles<F> {
    #[inline(always)]
    fn lanes(&self, block: &TriangleBlock) -> u32 {
        block.alpha_tested()
    }
    #[inline(always)]
    fn report(&mut self, hit: Hit) {
        (self.0)(hit);
    }
}

impl<F: FnMut(Hit)> Reported for AllTriangles<F> {
    #[inline(always)]
    fn lanes(&self, _block: &TriangleBlock) -> u32 {
        u32::MAX
    }
    #[inline(always)]
    fn report(&mut self, hit: Hit) {
        (self.0)(hit);
    }
}

// The four queries are compiled here and not in the crates that call them: each one is compiled for every instruction set,
// which takes seconds. So they are not generic and not inlined.

/// The nearest hit.
#[inline(never)]
pub(crate) fn closest_hit(bvh: &Bvh, ray: &Ray) -> Option<Hit> {
    dispatch8!(bvh.level, simd => {
        let mut nearest = Nearest::none(ray.t_max);
        closest_below(simd, bvh, ray, bvh.whole(), &mut nearest);
        (nearest.hit.instance != NO_HIT).then_some(nearest.hit)
    })
}

/// The nearest hits of rays, each with its number. A ray without a hit has the instance [`NO_HIT`].
#[inline(never)]
pub(crate) fn closest_of_each(bvh: &Bvh, rays: impl Iterator<Item = (usize, Ray)>, mut found: impl FnMut(usize, &Hit)) {
    dispatch8!(bvh.level, simd => {
        for (number, ray) in rays {
            let mut nearest = Nearest::none(ray.t_max);
            if is_valid(&ray) {
                closest_below(simd, bvh, &ray, bvh.whole(), &mut nearest);
            }
            found(number, &nearest.hit);
        }
    });
}

/// [`occluded`] of rays, each with its number.
#[inline(never)]
pub(crate) fn occluded_of_each(
    bvh: &Bvh,
    rays: impl Iterator<Item = (usize, Ray)>,
    mut found: impl FnMut(usize, bool),
) {
    dispatch8!(bvh.level, simd => {
        for (number, ray) in rays {
            found(number, is_valid(&ray) && occluded_below(simd, bvh, &ray, bvh.whole(), &mut NoTriangles));
        }
    });
}

/// Continues the search for the nearest hit at a child of a tree.
#[inline(never)]
pub(crate) fn closest_in_part(bvh: &Bvh, ray: &Ray, part: Part, nearest: &mut Nearest) {
    dispatch8!(bvh.level, simd => closest_below(simd, bvh, ray, part, nearest));
}

/// True if any triangle blocks the ray.
#[inline(never)]
pub(crate) fn occluded(bvh: &Bvh, ray: &Ray) -> bool {
    dispatch8!(bvh.level, simd => occluded_below(simd, bvh, ray, bvh.whole(), &mut NoTriangles))
}

/// True if any triangle below a child of a tree blocks the ray.
#[inline(never)]
pub(crate) fn occluded_in_part(bvh: &Bvh, ray: &Ray, part: Part) -> bool {
    dispatch8!(bvh.level, simd => occluded_below(simd, bvh, ray, part, &mut NoTriangles))
}

/// True if a triangle that is not alpha-tested blocks the ray. Reports hits on the others until then.
#[inline(never)]
pub(crate) fn occluded_with_alpha(bvh: &Bvh, ray: &Ray, on_alpha_hit: &mut dyn FnMut(Hit)) -> bool {
    dispatch8!(bvh.level, simd => occluded_below(simd, bvh, ray, bvh.whole(), &mut AlphaTestedTriangles(&mut *on_alpha_hit)))
}

/// Reports all hits.
#[inline(never)]
pub(crate) fn each_hit(bvh: &Bvh, ray: &Ray, found: &mut dyn FnMut(Hit)) {
    dispatch8!(bvh.level, simd => occluded_below(simd, bvh, ray, bvh.whole(), &mut AllTriangles(&mut *found)));
}

/// A child of the tree over instances, or of the tree of an instance in world space.
#[derive(Clone, Copy)]
pub(crate) struct Part {
    /// The child as an entry of the stack of a traversal.
    pub(crate) start: u64,
    /// The instance; [`NO_HIT`] for the tree over instances.
    pub(crate) instance: u32,
}

impl Bvh {
    /// The whole scene.
    #[inline(always)]
    pub(crate) fn whole(&self) -> Part {
        if self.single {
            Part { start: self.mesh(0).tree.start(), instance: 0 }
        } else {
            Part { start: self.top.start(), instance: NO_HIT }
        }
    }

    /// The mesh of an instance.
    #[inline(always)]
    pub(crate) fn mesh(&self, instance: u32) -> &MeshTree {
        &self.meshes[self.instances[instance as usize].mesh as usize]
    }
}

/// The nearest hit so far.
///
/// It is a function of the ray and the triangles, not of the order in which they are visited: of all hits the first one in
/// the order of [`Self::is_before`]. A hit counts from the place where the ray enters the box of its leaf, if rounding has
/// put it before that. So a box that begins behind the nearest hit contains no nearer one.
#[derive(Clone, Copy)]
pub(crate) struct Nearest {
    /// The larger one of the distances to the hit and to the box of its leaf. The end of the ray if there is no hit.
    pub(crate) key: f32,
    /// The hit. Its instance is [`NO_HIT`] if there is none.
    pub(crate) hit: Hit,
}

impl Nearest {
    /// No hit up to a distance.
    #[inline(always)]
    pub(crate) fn none(end: f32) -> Self {
        let hit = Hit { t: f32::INFINITY, instance: NO_HIT, part: NO_HIT, triangle: NO_HIT, b1: 0.0, b2: 0.0 };
        Self { key: end, hit }
    }

    /// Of equal distances the first instance counts, in it the first part, and in it the first triangle.
    #[inline(always)]
    pub(crate) fn is_before(&self, other: &Self) -> bool {
        let (a, b) = (&self.hit, &other.hit);
        self.key < other.key
            || self.key == other.key
                && (a.t < b.t || a.t == b.t && (a.instance, a.part, a.triangle) < (b.instance, b.part, b.triangle))
    }
}

/// A ray in the space of some trees, in the forms that boxes and triangles need.
#[derive(Clone, Copy)]
struct Prepared<F> {
    slabs: Slabs<F>,
    shear: Shear<F>,
}

impl Prepared<f32> {
    /// Prepares a ray for trees within `bounds`.
    #[inline(always)]
    fn of_ray(ray: &Ray, bounds: &Aabb) -> Self {
        let (o, d) = (ray.origin.to_array(), ray.direction.to_array());
        let slabs = Slabs::new(ray.origin.into(), ray.direction.into(), octant(ray.direction), bounds);
        let axes = shear_axes(ray.direction);
        let shear = Shear::new(axes.map(|axis| o[axis]), axes.map(|axis| d[axis]), slabs.near_inverse[axes[2]], axes);
        Self { slabs, shear }
    }

    /// The same ray in eight lanes.
    #[inline(always)]
    fn splat<S: Simd>(&self, simd: S) -> Prepared<F8<S>> {
        Prepared { slabs: self.slabs.splat(simd), shear: self.shear.splat(simd) }
    }
}

#[inline(always)]
fn closest_below<S: Simd>(simd: S, bvh: &Bvh, ray: &Ray, Part { start, instance }: Part, nearest: &mut Nearest) {
    let prepared = Prepared::of_ray(ray, &bvh.top.bounds).splat(simd);
    if instance != NO_HIT {
        let world = WorldRay { scale: 1.0, t_max: ray.t_max, instance };
        closest_in_mesh(&prepared, bvh.mesh(instance), start, ray, world, nearest);
        return;
    }
    let mut t_max = nearest.key;
    let mut leaves = ClosestInstance { simd, bvh, ray, prepared: &prepared, nearest };
    bvh.top.traverse::<S, true>(&prepared.slabs, start, &mut t_max, &mut leaves);
}

/// `ray` and `nearest` are in object space.
#[inline(always)]
fn closest_in_mesh<S: Simd>(
    prepared: &Prepared<F8<S>>,
    mesh: &MeshTree,
    start: u64,
    ray: &Ray,
    world: WorldRay,
    nearest: &mut Nearest,
) {
    let mut t_max = nearest.key;
    let mut leaves = ClosestTriangle { mesh, ray, shear: prepared.shear, world, nearest };
    mesh.tree.traverse::<S, true>(&prepared.slabs, start, &mut t_max, &mut leaves);
}

#[inline(always)]
fn occluded_below<S: Simd>(
    simd: S,
    bvh: &Bvh,
    ray: &Ray,
    Part { start, instance }: Part,
    reported: &mut impl Reported,
) -> bool {
    let prepared = Prepared::of_ray(ray, &bvh.top.bounds).splat(simd);
    let mut t_max = ray.t_max;
    if instance != NO_HIT {
        let world = WorldRay { scale: 1.0, t_max, instance };
        return occluded_in_mesh(&prepared, bvh.mesh(instance), start, ray, world, reported);
    }
    let mut leaves = BlockingInstance { simd, bvh, ray, prepared: &prepared, reported };
    bvh.top.traverse::<S, false>(&prepared.slabs, start, &mut t_max, &mut leaves)
}

/// `ray` is in object space.
#[inline(always)]
fn occluded_in_mesh<S: Simd>(
    prepared: &Prepared<F8<S>>,
    mesh: &MeshTree,
    start: u64,
    ray: &Ray,
    world: WorldRay,
    reported: &mut impl Reported,
) -> bool {
    let mut leaves = BlockingTriangle { mesh, ray, shear: prepared.shear, world, reported };
    let mut t_max = ray.t_max;
    mesh.tree.traverse::<S, false>(&prepared.slabs, start, &mut t_max, &mut leaves)
}

/// The prepared ray of an instance with a space of its own.
struct Own<S: Simd>(Option<Prepared<F8<S>>>);

impl<S: Simd> Own<S> {
    #[inline(always)]
    fn of(instance: &Instance, simd: S, ray: &Ray, mesh: &MeshTree) -> Self {
        match instance.space {
            Space::World => Self(None),
            Space::Fixed(_) | Space::Moving(_) => Self(Some(Prepared::of_ray(ray, &mesh.tree.bounds).splat(simd))),
        }
    }

    #[inline(always)]
    fn prepared<'a>(&'a self, world: &'a Prepared<F8<S>>) -> &'a Prepared<F8<S>> {
        self.0.as_ref().unwrap_or(world)
    }
}

/// A ray in the space of an instance's mesh, and the factor on distances. `None` if the ray misses a moving instance.
#[inline(always)]
fn object_ray(instance: &Instance, mesh: &MeshTree, world: &Ray) -> Option<(Ray, f32)> {
    match &instance.space {
        Space::World => Some((*world, 1.0)),
        Space::Fixed(transform) => Some(transform.unit_ray(world)),
        Space::Moving(moving) => moving_ray(moving, mesh, world),
    }
}

/// [`object_ray`] of a moving instance at the time of the ray. The box of the hierarchy contains all poses, so the ray
/// is tested against the box of the mesh at this pose.
#[inline(never)]
fn moving_ray((rest, motion): &(Transform, RigidMotion), mesh: &MeshTree, world: &Ray) -> Option<(Ray, f32)> {
    let (ray, scale) = motion.unit_ray(rest, world);
    mesh.tree.bounds.may_be_hit(&ray).then_some((ray, scale))
}

/// The world's side of a ray in object space.
#[derive(Clone, Copy)]
struct WorldRay {
    /// A distance in object space is the distance in the world times this.
    scale: f32,
    /// The end of the ray in the world.
    t_max: f32,
    /// The instance whose object space it is.
    instance: u32,
}

impl WorldRay {
    /// Is there a hit at a distance in object space? `end` is the end of the ray there.
    ///
    /// The scale rounds: a hit within the ray in object space may be outside in the world. All kinds of traversal make
    /// this test, so that they agree.
    #[inline(always)]
    fn is_hit(&self, t: f32, end: f32) -> bool {
        t > 0.0 && t < end && (self.scale == 1.0 || (t / self.scale > 0.0 && t / self.scale < self.t_max))
    }
}

/// The distances of the candidates of a block.
#[inline(always)]
fn distances<S: Simd>(candidates: &Candidates<F8<S>>, block: &TriangleBlock, ray: &Ray) -> Eight {
    let mut t: Eight = candidates.t.into();
    if candidates.near != 0 {
        decide_near(block, ray, candidates.near, &mut t);
    }
    t
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

struct ClosestTriangle<'a, S: Simd> {
    mesh: &'a MeshTree,
    ray: &'a Ray,
    shear: Shear<F8<S>>,
    world: WorldRay,
    nearest: &'a mut Nearest,
}

impl<S: Simd> Leaves for ClosestTriangle<'_, S> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, entry: f32, t_max: &mut f32) -> bool {
        let Some((block, part)) = self.mesh.block(payload) else { return false };
        let Some(candidates) = self.shear.intersect_block(block, self.ray.t_max, *t_max) else { return false };
        let ts = distances(&candidates, block, self.ray);
        let (b1, b2): (Eight, Eight) = (candidates.b1.into(), candidates.b2.into());
        let mut rest = candidates.lanes;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize & (WIDTH - 1);
            rest &= rest - 1;
            let (t, triangle) = (ts[lane], block.triangle(lane));
            let key = if t > entry { t } else { entry };
            if key > self.nearest.key {
                continue;
            }
            let hit = Hit { t, instance: self.world.instance, part, triangle, b1: b1[lane], b2: b2[lane] };
            let found = Nearest { key, hit };
            if found.is_before(self.nearest) && self.world.is_hit(t, self.ray.t_max) {
                *self.nearest = found;
                *t_max = found.key;
            }
        }
        false
    }
}

struct ClosestInstance<'a, S: Simd> {
    simd: S,
    bvh: &'a Bvh,
    ray: &'a Ray,
    prepared: &'a Prepared<F8<S>>,
    nearest: &'a mut Nearest,
}

impl<S: Simd> Leaves for ClosestInstance<'_, S> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, entry: f32, t_max: &mut f32) -> bool {
        let Some(instance) = self.bvh.instances.get(payload as usize) else { return false };
        let mesh = &self.bvh.meshes[instance.mesh as usize];
        let Some((ray, scale)) = object_ray(instance, mesh, self.ray) else { return false };
        let own = Own::of(instance, self.simd, &ray, mesh);
        let world = WorldRay { scale, t_max: self.ray.t_max, instance: payload };
        // The roundings of the scaled distance must not exclude a hit that would be the nearest one in the world.
        let end = *t_max * scale * (1.0 + 8.0 * UNIT_ROUNDOFF) + f32::MIN_POSITIVE;
        let mut nearest = Nearest::none(end.min(ray.t_max));
        closest_in_mesh(own.prepared(self.prepared), mesh, mesh.tree.start(), &ray, world, &mut nearest);
        if nearest.hit.instance != NO_HIT {
            nearest.key = (nearest.key / scale).max(entry);
            nearest.hit.t /= scale;
            if nearest.is_before(self.nearest) {
                *self.nearest = nearest;
                *t_max = nearest.key;
            }
        }
        false
    }
}

struct BlockingTriangle<'a, S: Simd, R: Reported> {
    mesh: &'a MeshTree,
    ray: &'a Ray,
    shear: Shear<F8<S>>,
    world: WorldRay,
    reported: &'a mut R,
}

impl<S: Simd, R: Reported> Leaves for BlockingTriangle<'_, S, R> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, _entry: f32, t_max: &mut f32) -> bool {
        let Some((block, part)) = self.mesh.block(payload) else { return false };
        let Some(candidates) = self.shear.intersect_block(block, self.ray.t_max, *t_max) else { return false };
        let ts = distances(&candidates, block, self.ray);
        let reported = self.reported.lanes(block);
        let mut rest = candidates.lanes & !reported;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize & (WIDTH - 1);
            rest &= rest - 1;
            if self.world.is_hit(ts[lane], self.ray.t_max) {
                return true;
            }
        }
        let (b1, b2): (Eight, Eight) = (candidates.b1.into(), candidates.b2.into());
        let mut rest = candidates.lanes & reported;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize & (WIDTH - 1);
            rest &= rest - 1;
            if self.world.is_hit(ts[lane], self.ray.t_max) {
                let WorldRay { scale, instance, .. } = self.world;
                let (t, triangle) = (ts[lane] / scale, block.triangle(lane));
                self.reported.report(Hit { t, instance, part, triangle, b1: b1[lane], b2: b2[lane] });
            }
        }
        false
    }
}

struct BlockingInstance<'a, S: Simd, R: Reported> {
    simd: S,
    bvh: &'a Bvh,
    ray: &'a Ray,
    prepared: &'a Prepared<F8<S>>,
    reported: &'a mut R,
}

impl<S: Simd, R: Reported> Leaves for BlockingInstance<'_, S, R> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, _entry: f32, _t_max: &mut f32) -> bool {
        let Some(instance) = self.bvh.instances.get(payload as usize) else { return false };
        let mesh = &self.bvh.meshes[instance.mesh as usize];
        let Some((ray, scale)) = object_ray(instance, mesh, self.ray) else { return false };
        let world = WorldRay { scale, t_max: self.ray.t_max, instance: payload };
        let own = Own::of(instance, self.simd, &ray, mesh);
        occluded_in_mesh(own.prepared(self.prepared), mesh, mesh.tree.start(), &ray, world, self.reported)
    }
}
