//! Traversal of both levels by a ray, compiled once for each kind of machine.
//!
//! There are two queries, the nearest hit and occlusion. Each has a visitor of the leaves of meshes and one of instances.
//! [`Reported`] contains the triangles that an occlusion query reports and passes. It is a type, so that a query without
//! such triangles is compiled without their code.

use dunkelfeld_geometry::{Aabb, Ray, RigidMotion, Transform};
use fearless_simd::Simd;

use crate::scene::{Bvh, Hit, Instance, MeshTree, Space};
use crate::simd8::dispatch8;
use crate::tree::{Leaves, Slabs};
use crate::triangle_block::{ALL, BlockHit, ShearLanes, TriangleBlock};

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
        ALL
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
    dispatch8!(bvh.level, simd => closest_in_scene(simd, bvh, ray))
}

/// True if any triangle blocks the ray.
#[inline(never)]
pub(crate) fn occluded(bvh: &Bvh, ray: &Ray) -> bool {
    dispatch8!(bvh.level, simd => occluded_in_scene(simd, bvh, ray, &mut NoTriangles))
}

/// True if a triangle that is not alpha-tested blocks the ray. Reports hits on the others until then.
#[inline(never)]
pub(crate) fn occluded_with_alpha(bvh: &Bvh, ray: &Ray, on_alpha_hit: &mut dyn FnMut(Hit)) -> bool {
    dispatch8!(bvh.level, simd => occluded_in_scene(simd, bvh, ray, &mut AlphaTestedTriangles(&mut *on_alpha_hit)))
}

/// Reports all hits.
#[inline(never)]
pub(crate) fn each_hit(bvh: &Bvh, ray: &Ray, found: &mut dyn FnMut(Hit)) {
    dispatch8!(bvh.level, simd => occluded_in_scene(simd, bvh, ray, &mut AllTriangles(&mut *found)));
}

/// A ray in the space of some trees, in the forms that boxes and triangles need.
#[derive(Clone, Copy)]
struct Prepared<S: Simd> {
    slabs: Slabs<S>,
    shear: ShearLanes<S>,
}

impl<S: Simd> Prepared<S> {
    /// Prepares a ray for trees within `bounds`.
    #[inline(always)]
    fn new(simd: S, ray: &Ray, bounds: &Aabb) -> Self {
        Self { slabs: Slabs::new(simd, ray, bounds), shear: ShearLanes::new(simd, ray) }
    }
}

#[inline(always)]
fn closest_in_scene<S: Simd>(simd: S, bvh: &Bvh, ray: &Ray) -> Option<Hit> {
    let mut t_max = ray.t_max;
    // All instances in world space share it.
    let prepared = Prepared::new(simd, ray, &bvh.top.bounds);
    if bvh.single {
        let (hit, part) = closest_in_mesh(&prepared, &bvh.meshes[bvh.instances[0].mesh as usize], ray, &mut t_max)?;
        return Some(Hit { t: hit.t, instance: 0, part, triangle: hit.triangle, b1: hit.b1, b2: hit.b2 });
    }
    let mut leaves = ClosestInstance { simd, bvh, ray, prepared: &prepared, hit: None };
    bvh.top.traverse::<S, true>(&prepared.slabs, &mut t_max, &mut leaves);
    leaves.hit
}

#[inline(always)]
fn closest_in_mesh<S: Simd>(
    prepared: &Prepared<S>,
    mesh: &MeshTree,
    ray: &Ray,
    t_max: &mut f32,
) -> Option<(BlockHit, u32)> {
    let mut leaves = ClosestTriangle { mesh, ray, shear: prepared.shear, hit: None };
    mesh.tree.traverse::<S, true>(&prepared.slabs, t_max, &mut leaves);
    leaves.hit
}

#[inline(always)]
fn occluded_in_scene<S: Simd>(simd: S, bvh: &Bvh, ray: &Ray, reported: &mut impl Reported) -> bool {
    let mut t_max = ray.t_max;
    let prepared = Prepared::new(simd, ray, &bvh.top.bounds);
    if bvh.single {
        let mesh = &bvh.meshes[bvh.instances[0].mesh as usize];
        return occluded_in_mesh(&prepared, mesh, ray, WorldRay { scale: 1.0, t_max, instance: 0 }, reported);
    }
    let mut leaves = BlockingInstance { simd, bvh, ray, prepared: &prepared, reported };
    bvh.top.traverse::<S, false>(&prepared.slabs, &mut t_max, &mut leaves)
}

/// `ray` is in object space.
#[inline(always)]
fn occluded_in_mesh<S: Simd>(
    prepared: &Prepared<S>,
    mesh: &MeshTree,
    ray: &Ray,
    world: WorldRay,
    reported: &mut impl Reported,
) -> bool {
    let mut leaves = BlockingTriangle { mesh, ray, shear: prepared.shear, world, reported };
    let mut t_max = ray.t_max;
    mesh.tree.traverse::<S, false>(&prepared.slabs, &mut t_max, &mut leaves)
}

/// The prepared ray of an instance with a space of its own.
struct Own<S: Simd>(Option<Prepared<S>>);

impl<S: Simd> Own<S> {
    #[inline(always)]
    fn of(instance: &Instance, simd: S, ray: &Ray, mesh: &MeshTree) -> Self {
        match instance.space {
            Space::World => Self(None),
            Space::Fixed(_) | Space::Moving(_) => Self(Some(Prepared::new(simd, ray, &mesh.tree.bounds))),
        }
    }

    #[inline(always)]
    fn prepared<'a>(&'a self, world: &'a Prepared<S>) -> &'a Prepared<S> {
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

/// The scale rounds: a hit within the ray in object space may be outside in the world. Both kinds of traversal make
/// this test, so that they agree.
#[inline(always)]
fn is_world_hit(t: f32, t_max: f32) -> bool {
    t > 0.0 && t < t_max
}

struct ClosestTriangle<'a, S: Simd> {
    mesh: &'a MeshTree,
    ray: &'a Ray,
    shear: ShearLanes<S>,
    /// The hit, and the number of its part.
    hit: Option<(BlockHit, u32)>,
}

impl<S: Simd> Leaves for ClosestTriangle<'_, S> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, t_max: &mut f32) -> bool {
        let Some((block, part)) = self.mesh.block(payload) else { return false };
        if let Some(hit) = self.shear.intersect(block, self.ray, *t_max, ALL) {
            *t_max = hit.t;
            self.hit = Some((hit, part));
        }
        false
    }
}

struct ClosestInstance<'a, S: Simd> {
    simd: S,
    bvh: &'a Bvh,
    ray: &'a Ray,
    prepared: &'a Prepared<S>,
    hit: Option<Hit>,
}

impl<S: Simd> Leaves for ClosestInstance<'_, S> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, t_max: &mut f32) -> bool {
        let Some(instance) = self.bvh.instances.get(payload as usize) else { return false };
        let mesh = &self.bvh.meshes[instance.mesh as usize];
        let world = Ray { t_max: *t_max, ..*self.ray };
        let Some((ray, scale)) = object_ray(instance, mesh, &world) else { return false };
        let own = Own::of(instance, self.simd, &ray, mesh);
        let mut object_t_max = ray.t_max;
        if let Some((hit, part)) = closest_in_mesh(own.prepared(self.prepared), mesh, &ray, &mut object_t_max) {
            let t = hit.t / scale;
            if is_world_hit(t, *t_max) {
                *t_max = t;
                self.hit = Some(Hit { t, instance: payload, part, triangle: hit.triangle, b1: hit.b1, b2: hit.b2 });
            }
        }
        false
    }
}

struct BlockingTriangle<'a, S: Simd, R: Reported> {
    mesh: &'a MeshTree,
    ray: &'a Ray,
    shear: ShearLanes<S>,
    world: WorldRay,
    reported: &'a mut R,
}

impl<S: Simd, R: Reported> Leaves for BlockingTriangle<'_, S, R> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, t_max: &mut f32) -> bool {
        let Some((block, part)) = self.mesh.block(payload) else { return false };
        let WorldRay { scale, t_max: world_t_max, instance } = self.world;
        let mut reported = self.reported.lanes(block);
        let blocking = self.shear.intersect(block, self.ray, *t_max, ALL & !reported);
        if blocking.is_some_and(|hit| is_world_hit(hit.t / scale, world_t_max)) {
            return true;
        }
        while reported != 0 {
            let lane = reported & reported.wrapping_neg();
            reported ^= lane;
            if let Some(hit) = self.shear.intersect(block, self.ray, *t_max, lane) {
                let t = hit.t / scale;
                if is_world_hit(t, world_t_max) {
                    let BlockHit { triangle, b1, b2, .. } = hit;
                    self.reported.report(Hit { t, instance, part, triangle, b1, b2 });
                }
            }
        }
        false
    }
}

struct BlockingInstance<'a, S: Simd, R: Reported> {
    simd: S,
    bvh: &'a Bvh,
    ray: &'a Ray,
    prepared: &'a Prepared<S>,
    reported: &'a mut R,
}

impl<S: Simd, R: Reported> Leaves for BlockingInstance<'_, S, R> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, _t_max: &mut f32) -> bool {
        let Some(instance) = self.bvh.instances.get(payload as usize) else { return false };
        let mesh = &self.bvh.meshes[instance.mesh as usize];
        let Some((ray, scale)) = object_ray(instance, mesh, self.ray) else { return false };
        let world = WorldRay { scale, t_max: self.ray.t_max, instance: payload };
        let own = Own::of(instance, self.simd, &ray, mesh);
        occluded_in_mesh(own.prepared(self.prepared), mesh, &ray, world, self.reported)
    }
}
