//! Traversal of both levels by a ray, compiled once for each kind of machine.

use dunkelfeld_geometry::Ray;

use crate::scene::{Bvh, Hit, MeshTree};
use crate::simd8::{Lanes, Portable};
use crate::tree::Leaves;
use crate::triangle_block::{ALL, BlockHit, ShearLanes, TriangleBlock};

/// The code that traverses the tree. It is selected once, when the tree is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kernel {
    Portable,
    /// Exists only if AVX2 was detected.
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2Detected),
}

#[cfg(target_arch = "x86_64")]
pub(crate) use detected::Avx2Detected;

#[cfg(target_arch = "x86_64")]
mod detected {
    /// Proof that this machine has AVX2: `new` is the only way to get one.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub(crate) struct Avx2Detected(());

    impl Avx2Detected {
        pub(crate) fn new() -> Option<Self> {
            is_x86_feature_detected!("avx2").then_some(Self(()))
        }
    }
}

impl Kernel {
    /// The fastest code for this machine.
    pub(crate) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(proof) = Avx2Detected::new() {
            return Self::Avx2(proof);
        }
        Self::Portable
    }

    #[inline]
    pub(crate) fn closest_hit(self, bvh: &Bvh, ray: &Ray) -> Option<Hit> {
        match self {
            Self::Portable => closest_hit::<Portable>(bvh, ray),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: an `Avx2Detected` exists, so this machine has AVX2.
            Self::Avx2(_) => unsafe { closest_hit_avx2(bvh, ray) },
        }
    }

    #[inline]
    pub(crate) fn occluded(self, bvh: &Bvh, ray: &Ray) -> bool {
        match self {
            Self::Portable => occluded::<Portable>(bvh, ray),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: an `Avx2Detected` exists, so this machine has AVX2.
            Self::Avx2(_) => unsafe { occluded_avx2(bvh, ray) },
        }
    }

    #[inline]
    pub(crate) fn occluded_with_alpha(self, bvh: &Bvh, ray: &Ray, on_alpha_hit: &mut impl FnMut(Hit)) -> bool {
        match self {
            Self::Portable => occluded_with_alpha::<Portable>(bvh, ray, on_alpha_hit),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: an `Avx2Detected` exists, so this machine has AVX2.
            Self::Avx2(_) => unsafe { occluded_with_alpha_avx2(bvh, ray, on_alpha_hit) },
        }
    }

    #[inline]
    pub(crate) fn each_hit(self, bvh: &Bvh, ray: &Ray, found: &mut impl FnMut(Hit)) {
        match self {
            Self::Portable => each_hit::<Portable>(bvh, ray, found),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: an `Avx2Detected` exists, so this machine has AVX2.
            Self::Avx2(_) => unsafe { each_hit_avx2(bvh, ray, found) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn each_hit_avx2(bvh: &Bvh, ray: &Ray, found: &mut impl FnMut(Hit)) {
    each_hit::<crate::simd8::Avx2>(bvh, ray, found);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn occluded_with_alpha_avx2(bvh: &Bvh, ray: &Ray, on_alpha_hit: &mut impl FnMut(Hit)) -> bool {
    occluded_with_alpha::<crate::simd8::Avx2>(bvh, ray, on_alpha_hit)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn closest_hit_avx2(bvh: &Bvh, ray: &Ray) -> Option<Hit> {
    closest_hit::<crate::simd8::Avx2>(bvh, ray)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn occluded_avx2(bvh: &Bvh, ray: &Ray) -> bool {
    occluded::<crate::simd8::Avx2>(bvh, ray)
}

#[inline(always)]
fn closest_hit<L: Lanes>(bvh: &Bvh, ray: &Ray) -> Option<Hit> {
    let mut t_max = ray.t_max;
    if bvh.single {
        let hit = closest_hit_in_mesh::<L>(&bvh.meshes[bvh.instances[0].mesh as usize], ray, &mut t_max)?;
        return Some(Hit { t: hit.t, instance: 0, triangle: hit.triangle, b1: hit.b1, b2: hit.b2 });
    }
    let mut leaves = ClosestInstance::<L> { bvh, ray, hit: None, lanes: std::marker::PhantomData };
    bvh.top.traverse::<L, true>(ray, &mut t_max, &mut leaves);
    leaves.hit
}

#[inline(always)]
fn occluded<L: Lanes>(bvh: &Bvh, ray: &Ray) -> bool {
    if bvh.single {
        return occluded_in_mesh::<L>(&bvh.meshes[bvh.instances[0].mesh as usize], ray, 1.0, ray.t_max);
    }
    let mut t_max = ray.t_max;
    let mut leaves = AnyInstance::<L> { bvh, ray, lanes: std::marker::PhantomData };
    bvh.top.traverse::<L, false>(ray, &mut t_max, &mut leaves)
}

#[inline(always)]
fn occluded_with_alpha<L: Lanes>(bvh: &Bvh, ray: &Ray, on_alpha_hit: &mut impl FnMut(Hit)) -> bool {
    visit_hits::<L, false>(bvh, ray, on_alpha_hit)
}

#[inline(always)]
fn each_hit<L: Lanes>(bvh: &Bvh, ray: &Ray, found: &mut impl FnMut(Hit)) {
    visit_hits::<L, true>(bvh, ray, found);
}

/// Calls `on_alpha_hit` for hits on alpha-tested triangles until a triangle that is not alpha-tested occludes the ray.
/// With `ALL_HITS`, all triangles count as alpha-tested.
#[inline(always)]
fn visit_hits<L: Lanes, const ALL_HITS: bool>(bvh: &Bvh, ray: &Ray, on_alpha_hit: &mut impl FnMut(Hit)) -> bool {
    let mut t_max = ray.t_max;
    if bvh.single {
        let mesh = &bvh.meshes[bvh.instances[0].mesh as usize];
        return occluded_in_mesh_with_alpha::<L, ALL_HITS>(mesh, ray, 1.0, ray.t_max, 0, on_alpha_hit);
    }
    let mut leaves =
        OccludedInstanceWithAlpha::<L, _, ALL_HITS> { bvh, ray, on_alpha_hit, lanes: std::marker::PhantomData };
    bvh.top.traverse::<L, false>(ray, &mut t_max, &mut leaves)
}

/// As [`occluded_in_mesh`], but triangles marked as alpha-tested (or with `ALL_HITS` all) are reported and do not
/// block.
#[inline(always)]
fn occluded_in_mesh_with_alpha<L: Lanes, const ALL_HITS: bool>(
    mesh: &MeshTree,
    ray: &Ray,
    scale: f32,
    world_t_max: f32,
    instance: u32,
    on_alpha_hit: &mut impl FnMut(Hit),
) -> bool {
    let shear = ShearLanes::new(ray);
    let mut leaves = OccludedTriangleWithAlpha::<L, _, ALL_HITS> {
        blocks: &mesh.blocks,
        ray,
        shear,
        scale,
        world_t_max,
        instance,
        on_alpha_hit,
    };
    let mut t_max = ray.t_max;
    mesh.tree.traverse::<L, false>(ray, &mut t_max, &mut leaves)
}

#[inline(always)]
fn closest_hit_in_mesh<L: Lanes>(mesh: &MeshTree, ray: &Ray, t_max: &mut f32) -> Option<BlockHit> {
    let mut leaves = ClosestTriangle::<L> { blocks: &mesh.blocks, ray, shear: ShearLanes::new(ray), hit: None };
    mesh.tree.traverse::<L, true>(ray, t_max, &mut leaves);
    leaves.hit
}

/// `ray` is in object space, where `t` is `scale` times what it is in the world.
#[inline(always)]
fn occluded_in_mesh<L: Lanes>(mesh: &MeshTree, ray: &Ray, scale: f32, world_t_max: f32) -> bool {
    let mut leaves = AnyTriangle::<L> { blocks: &mesh.blocks, ray, shear: ShearLanes::new(ray), scale, world_t_max };
    let mut t_max = ray.t_max;
    mesh.tree.traverse::<L, false>(ray, &mut t_max, &mut leaves)
}

/// The scale rounds: a hit within the ray in object space may be outside in the world. Both kinds of traversal make
/// this test, so that they agree.
#[inline(always)]
fn is_world_hit(t: f32, t_max: f32) -> bool {
    t > 0.0 && t < t_max
}

struct ClosestTriangle<'a, L: Lanes> {
    blocks: &'a [TriangleBlock],
    ray: &'a Ray,
    shear: ShearLanes<L>,
    hit: Option<BlockHit>,
}

impl<L: Lanes> Leaves for ClosestTriangle<'_, L> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, t_max: &mut f32) -> bool {
        let Some(block) = self.blocks.get(payload as usize) else { return false };
        if let Some(hit) = self.shear.intersect(block, self.ray, *t_max, ALL) {
            *t_max = hit.t;
            self.hit = Some(hit);
        }
        false
    }
}

struct AnyTriangle<'a, L: Lanes> {
    blocks: &'a [TriangleBlock],
    ray: &'a Ray,
    shear: ShearLanes<L>,
    scale: f32,
    world_t_max: f32,
}

impl<L: Lanes> Leaves for AnyTriangle<'_, L> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, t_max: &mut f32) -> bool {
        let Some(block) = self.blocks.get(payload as usize) else { return false };
        self.shear
            .intersect(block, self.ray, *t_max, ALL)
            .is_some_and(|hit| is_world_hit(hit.t / self.scale, self.world_t_max))
    }
}

struct OccludedTriangleWithAlpha<'a, L: Lanes, F: FnMut(Hit), const ALL_HITS: bool> {
    blocks: &'a [TriangleBlock],
    ray: &'a Ray,
    shear: ShearLanes<L>,
    scale: f32,
    world_t_max: f32,
    instance: u32,
    on_alpha_hit: &'a mut F,
}

impl<L: Lanes, F: FnMut(Hit), const ALL_HITS: bool> Leaves for OccludedTriangleWithAlpha<'_, L, F, ALL_HITS> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, t_max: &mut f32) -> bool {
        let Some(block) = self.blocks.get(payload as usize) else { return false };
        let mut alpha_tested = if ALL_HITS { ALL } else { block.alpha_tested() };
        let solid = self.shear.intersect(block, self.ray, *t_max, ALL & !alpha_tested);
        if solid.is_some_and(|hit| is_world_hit(hit.t / self.scale, self.world_t_max)) {
            return true;
        }
        while alpha_tested != 0 {
            let lane = alpha_tested & alpha_tested.wrapping_neg();
            alpha_tested ^= lane;
            if let Some(hit) = self.shear.intersect(block, self.ray, *t_max, lane) {
                let t = hit.t / self.scale;
                if is_world_hit(t, self.world_t_max) {
                    let BlockHit { triangle, b1, b2, .. } = hit;
                    (self.on_alpha_hit)(Hit { t, instance: self.instance, triangle, b1, b2 });
                }
            }
        }
        false
    }
}

struct OccludedInstanceWithAlpha<'a, L: Lanes, F: FnMut(Hit), const ALL_HITS: bool> {
    bvh: &'a Bvh,
    ray: &'a Ray,
    on_alpha_hit: &'a mut F,
    lanes: std::marker::PhantomData<L>,
}

impl<L: Lanes, F: FnMut(Hit), const ALL_HITS: bool> Leaves for OccludedInstanceWithAlpha<'_, L, F, ALL_HITS> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, _t_max: &mut f32) -> bool {
        let Some(instance) = self.bvh.instances.get(payload as usize) else { return false };
        let mesh = &self.bvh.meshes[instance.mesh as usize];
        let (ray, scale) = match &instance.to_world {
            None => (*self.ray, 1.0),
            Some(transform) => transform.unit_ray(self.ray),
        };
        occluded_in_mesh_with_alpha::<L, ALL_HITS>(mesh, &ray, scale, self.ray.t_max, payload, self.on_alpha_hit)
    }
}

struct ClosestInstance<'a, L: Lanes> {
    bvh: &'a Bvh,
    ray: &'a Ray,
    hit: Option<Hit>,
    lanes: std::marker::PhantomData<L>,
}

impl<L: Lanes> Leaves for ClosestInstance<'_, L> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, t_max: &mut f32) -> bool {
        let Some(instance) = self.bvh.instances.get(payload as usize) else { return false };
        let mesh = &self.bvh.meshes[instance.mesh as usize];
        let world = Ray { t_max: *t_max, ..*self.ray };
        let (ray, scale) = match &instance.to_world {
            None => (world, 1.0),
            Some(transform) => transform.unit_ray(&world),
        };
        let mut object_t_max = ray.t_max;
        if let Some(hit) = closest_hit_in_mesh::<L>(mesh, &ray, &mut object_t_max) {
            let t = hit.t / scale;
            if is_world_hit(t, *t_max) {
                *t_max = t;
                self.hit = Some(Hit { t, instance: payload, triangle: hit.triangle, b1: hit.b1, b2: hit.b2 });
            }
        }
        false
    }
}

struct AnyInstance<'a, L: Lanes> {
    bvh: &'a Bvh,
    ray: &'a Ray,
    lanes: std::marker::PhantomData<L>,
}

impl<L: Lanes> Leaves for AnyInstance<'_, L> {
    #[inline(always)]
    fn visit(&mut self, payload: u32, _t_max: &mut f32) -> bool {
        let Some(instance) = self.bvh.instances.get(payload as usize) else { return false };
        let mesh = &self.bvh.meshes[instance.mesh as usize];
        let (ray, scale) = match &instance.to_world {
            None => (*self.ray, 1.0),
            Some(transform) => transform.unit_ray(self.ray),
        };
        occluded_in_mesh::<L>(mesh, &ray, scale, self.ray.t_max)
    }
}
