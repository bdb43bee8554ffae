//! The acceleration structure of a scene: meshes, their instances, and ray queries.

use dunkelfeld_geometry::{Aabb, Ray, RigidMotion, Threads, Transform, geometric_normal};
use fearless_simd::Level;
use glam::Vec3;
use std::sync::Arc;

use crate::build::{CHUNK, build_tree};
use crate::pairs::{Pair, Subtree};
use crate::simd8::{WIDTH, levels};
use crate::traverse;
use crate::tree::{LEAF, MAX_DEPTH, NONE, Node, Tree, moved};
use crate::triangle_block::TriangleBlock;

/// Maximum number of triangles of a mesh, and of instances.
const MAX_COUNT: usize = (1 << 31) - 2;

/// The number of no instance: a ray of a batch that hits nothing.
pub const NO_HIT: u32 = u32::MAX;

/// The triangles of a mesh, in its object space \[m\].
#[derive(Clone, Copy, Debug)]
pub struct MeshTriangles<'a> {
    /// Vertex positions.
    pub positions: &'a [Vec3],
    /// Vertex indices of each triangle.
    pub triangles: &'a [[u32; 3]],
}

/// A placement of a mesh in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BvhInstance {
    /// Index of the mesh.
    pub mesh: u32,
    /// Object to world; `None` if the positions are world positions already, which saves the transform of each ray.
    pub to_world: Option<Transform>,
    /// Motion in the world after the transform; `None` for an instance at rest.
    pub motion: Option<InstanceMotion>,
}

/// The motion of an instance, and the times at which rays meet it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InstanceMotion {
    /// The motion. At time 0 the instance has its placement.
    pub motion: RigidMotion,
    /// First and last time of any ray \[s\].
    pub times: [f64; 2],
}

/// Intersection of a ray with the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Ray parameter: the distance for a direction of unit length \[m\].
    pub t: f32,
    /// Index of the instance.
    pub instance: u32,
    /// Number of the tree that contains the triangle, if the mesh is joined ([`MeshTree::join`]); otherwise 0.
    pub part: u32,
    /// Index of the triangle in the mesh, or in the part of a joined mesh.
    pub triangle: u32,
    /// Barycentric weight of the triangle's second corner.
    pub b1: f32,
    /// Barycentric weight of the triangle's third corner.
    pub b2: f32,
}

/// Reason why no structure could be built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BvhError {
    /// A triangle has an index beyond the vertices.
    #[error("mesh {mesh}: triangle {triangle} names a vertex beyond the mesh's {vertices}")]
    VertexOutOfRange {
        /// The mesh.
        mesh: usize,
        /// The triangle in it.
        triangle: usize,
        /// Number of vertices of the mesh.
        vertices: usize,
    },
    /// An instance refers to a mesh that does not exist.
    #[error("instance {instance} names mesh {mesh}, but there are {meshes}")]
    MeshOutOfRange {
        /// The instance.
        instance: usize,
        /// Index of the mesh.
        mesh: u32,
        /// Number of meshes.
        meshes: usize,
    },
    /// More than 2^31 - 2 triangles in a mesh, or instances.
    #[error("more than 2147483646 triangles in one mesh, or instances")]
    TooMany,
}

/// The tree of one mesh in its own space: blocks of triangles in its leaves. It is a function of the triangles alone, so
/// that structures share it: an instance that moves needs no other tree.
#[derive(Clone, Debug)]
pub struct MeshTree {
    pub(crate) tree: Tree,
    pub(crate) blocks: Vec<TriangleBlock>,
    /// Number of triangles in the blocks. The other triangles of the mesh can never be hit.
    pub(crate) triangles: usize,
    /// The trees of a joined mesh, which contain its blocks.
    pub(crate) parts: Vec<Arc<MeshTree>>,
    /// Bits of the payload of a leaf of a joined mesh that are the number of the block. The others are that of the part.
    pub(crate) shift: u32,
}

#[derive(Clone, Debug)]
pub(crate) struct Instance {
    pub(crate) mesh: u32,
    pub(crate) space: Space,
    /// Bounds in the world, at all times of a moving instance.
    pub(crate) bounds: Aabb,
}

/// The space of an instance's mesh. Boxed, so that the many instances in world space stay small.
#[derive(Clone, Debug)]
pub(crate) enum Space {
    World,
    Fixed(Box<Transform>),
    Moving(Box<(Transform, RigidMotion)>),
}

/// An acceleration structure over instances of triangle meshes. Immutable once built, shared between threads freely.
#[derive(Clone, Debug)]
pub struct Bvh {
    pub(crate) meshes: Vec<Arc<MeshTree>>,
    pub(crate) instances: Vec<Instance>,
    /// Over the instances; its leaves are one instance each.
    pub(crate) top: Tree,
    /// True if the scene is one instance in world space. Its tree is traversed directly.
    pub(crate) single: bool,
    /// The instruction set that traversal uses.
    pub(crate) level: Level,
}

impl Bvh {
    /// Builds the structure, by one thread. A mesh with several instances is stored once.
    ///
    /// Triangles with a NaN or infinite corner, and those without area, are left out: no ray can hit them.
    /// (`dunkelfeld_geometry::health` counts them.) Without triangles, meshes or instances nothing is ever hit.
    ///
    /// # Errors
    /// [`BvhError`] for an index out of range, or for more triangles or instances than fit.
    pub fn build(meshes: &[MeshTriangles], instances: &[BvhInstance]) -> Result<Self, BvhError> {
        Self::build_for(meshes, instances, Level::new())
    }

    /// As [`Bvh::build`], once with each set of instructions that the machine has, plain Rust first: for tests and
    /// comparisons. The hits are the same to the bit.
    ///
    /// # Errors
    /// As [`Bvh::build`].
    pub fn build_with_each_instruction_set(
        meshes: &[MeshTriangles],
        instances: &[BvhInstance],
    ) -> Result<Vec<Self>, BvhError> {
        levels().into_iter().map(|level| Self::build_for(meshes, instances, level)).collect()
    }

    fn build_for(meshes: &[MeshTriangles], instances: &[BvhInstance], level: Level) -> Result<Self, BvhError> {
        let of_mesh = |(i, mesh)| MeshTree::of_mesh(mesh, i, level, Threads::ONE).map(Arc::new);
        let trees = meshes.iter().enumerate().map(of_mesh);
        Self::from_trees_for(trees.collect::<Result<_, BvhError>>()?, instances, level, Threads::ONE)
    }

    /// Builds the structure over trees of meshes that exist already. The result is that of [`Bvh::build`] for the same
    /// triangles.
    ///
    /// # Errors
    /// [`BvhError`] for a mesh out of range, or for more instances than fit.
    pub fn from_trees(
        meshes: Vec<Arc<MeshTree>>,
        instances: &[BvhInstance],
        threads: Threads,
    ) -> Result<Self, BvhError> {
        Self::from_trees_for(meshes, instances, Level::new(), threads)
    }

    fn from_trees_for(
        meshes: Vec<Arc<MeshTree>>,
        instances: &[BvhInstance],
        level: Level,
        threads: Threads,
    ) -> Result<Self, BvhError> {
        if instances.len() > MAX_COUNT {
            return Err(BvhError::TooMany);
        }
        for (i, instance) in instances.iter().enumerate() {
            if instance.mesh as usize >= meshes.len() {
                return Err(BvhError::MeshOutOfRange { instance: i, mesh: instance.mesh, meshes: meshes.len() });
            }
        }
        let instances: Vec<Instance> = instances
            .iter()
            .map(|i| {
                let to_world = i.to_world.filter(|t| !t.is_identity());
                let local = meshes[i.mesh as usize].tree.bounds;
                let rest = to_world.map_or(local, |t| local.transformed(&t));
                let (space, bounds) = match (i.motion.filter(|m| !m.motion.is_static()), to_world) {
                    (Some(InstanceMotion { motion, times: [from, to] }), placement) => {
                        let moving = Space::Moving(Box::new((placement.unwrap_or(Transform::IDENTITY), motion)));
                        (moving, motion.swept(&rest, from, to))
                    }
                    (None, Some(placement)) => (Space::Fixed(Box::new(placement)), rest),
                    (None, None) => (Space::World, rest),
                };
                Instance { mesh: i.mesh, space, bounds }
            })
            .collect();

        let single = matches!(instances.as_slice(), [only] if matches!(only.space, Space::World));
        // No ray can hit an instance that is empty, or whose transform exceeds the range of f32.
        let present: Vec<u32> = (0..instances.len() as u32)
            .filter(|&i| {
                let b = &instances[i as usize].bounds;
                b.min.is_finite() && b.max.is_finite()
            })
            .collect();
        let boxes: Vec<Aabb> = present.iter().map(|&i| instances[i as usize].bounds).collect();
        let (mut top, _) = build_tree(level, threads, &boxes, 1, |_, leaf| present[leaf[0] as usize]);
        top.pair_up(&[]);
        Ok(Self { meshes, instances, top, single, level })
    }

    /// The nearest hit with `0 < t < ray.t_max`.
    ///
    /// A ray with a NaN, an infinite origin or direction, or a zero direction hits nothing.
    #[inline]
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        if !is_valid(ray) {
            return None;
        }
        traverse::closest_hit(self, ray)
    }

    /// True if there is any hit with `0 < t < ray.t_max`. The result is true exactly if [`Bvh::closest_hit`] finds one,
    /// but is faster.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        is_valid(ray) && traverse::occluded(self, ray)
    }

    /// Marks the triangles whose material has an alpha texture or a coverage below one, by mesh, part of a joined mesh, and triangle. [`Bvh::occluded_with_alpha`] reports them and
    /// continues behind them. All other queries treat them like any other triangle.
    pub fn mark_alpha_tested(&mut self, is_alpha_tested: impl Fn(u32, u32, u32) -> bool) {
        // A tree that other structures share is copied only if its marks change.
        let has_marks = |tree: &MeshTree, mesh: u32, part: u32| {
            tree.blocks.iter().all(|block| block.has_marks(&|triangle| is_alpha_tested(mesh, part, triangle)))
        };
        let mark = |tree: &mut Arc<MeshTree>, mesh: u32, part: u32| {
            if !has_marks(tree, mesh, part) {
                for block in &mut Arc::make_mut(tree).blocks {
                    block.mark_alpha_tested(&|triangle| is_alpha_tested(mesh, part, triangle));
                }
            }
        };
        for (number, mesh) in (0u32..).zip(&mut self.meshes) {
            mark(mesh, number, 0);
            if (0u32..).zip(&mesh.parts).any(|(part, tree)| !has_marks(tree, number, part)) {
                for (part, tree) in (0u32..).zip(&mut Arc::make_mut(mesh).parts) {
                    mark(tree, number, part);
                }
            }
        }
    }

    /// True if there is a hit with `0 < t < ray.t_max` on a triangle that is not alpha-tested. `on_alpha_hit` is called
    /// for each hit on an alpha-tested triangle, in an order that depends on the ray alone. If the result is true, it
    /// may have been called for some of these hits only.
    #[inline]
    pub fn occluded_with_alpha(&self, ray: &Ray, mut on_alpha_hit: impl FnMut(Hit)) -> bool {
        is_valid(ray) && traverse::occluded_with_alpha(self, ray, &mut on_alpha_hit)
    }

    /// Calls `found` for every hit with `0 < t < ray.t_max`, in an order that depends on the ray alone. A ray through
    /// an edge may hit both triangles there.
    #[inline]
    pub fn each_hit(&self, ray: &Ray, mut found: impl FnMut(Hit)) {
        if is_valid(ray) {
            traverse::each_hit(self, ray, &mut found);
        }
    }

    /// Bounds of all instances in the world; empty if there are none.
    pub fn bounds(&self) -> Aabb {
        self.top.bounds
    }

    /// Memory held \[bytes\].
    pub fn memory_bytes(&self) -> usize {
        let tree = |t: &Tree| t.nodes.capacity() * size_of::<Node>() + t.pairs.capacity() * size_of::<Pair>();
        let alone =
            |m: &MeshTree| size_of::<MeshTree>() + tree(&m.tree) + m.blocks.capacity() * size_of::<TriangleBlock>();
        let mesh = |m: &MeshTree| alone(m) + m.parts.iter().map(|part| alone(part)).sum::<usize>();
        let instance = |i: &Instance| {
            size_of::<Instance>()
                + match i.space {
                    Space::World => 0,
                    Space::Fixed(_) => size_of::<Transform>(),
                    Space::Moving(_) => size_of::<(Transform, RigidMotion)>(),
                }
        };
        size_of::<Self>()
            + tree(&self.top)
            + self.meshes.iter().map(|m| mesh(m)).sum::<usize>()
            + self.instances.iter().map(instance).sum::<usize>()
    }

    /// Checks every invariant of the structure: each triangle and instance lies in one leaf, each box contains
    /// everything below it, no tree is too deep.
    ///
    /// # Errors
    /// A sentence with the broken invariant.
    pub fn validate(&self) -> Result<(), String> {
        crate::validate::validate(self)
    }
}

impl MeshTree {
    /// Builds the tree of a mesh. Triangles that no ray can hit are left out, as in [`Bvh::build`]. The tree has the same bits
    /// for any number of threads.
    ///
    /// # Errors
    /// [`BvhError`] for an index out of range, or for too many triangles.
    pub fn build(mesh: &MeshTriangles, threads: Threads) -> Result<Self, BvhError> {
        Self::of_mesh(mesh, 0, Level::new(), threads)
    }

    fn of_mesh(mesh: &MeshTriangles, number: usize, level: Level, threads: Threads) -> Result<Self, BvhError> {
        if mesh.triangles.len() > MAX_COUNT {
            return Err(BvhError::TooMany);
        }
        let threads = if mesh.triangles.len() < Threads::LARGE { Threads::ONE } else { threads };
        let (kept, boxes) = boxes_of(mesh, number, threads)?;
        let (mut tree, leaves) = build_tree(level, threads, &boxes, WIDTH, |leaf, _| leaf);
        drop(boxes);
        let blocks = leaves.map(threads, |_, leaf| {
            TriangleBlock::new(leaf.iter().map(|&k| {
                let triangle = kept[k as usize];
                (triangle, mesh.triangles[triangle as usize].map(|v| mesh.positions[v as usize]))
            }))
        });
        tree.pair_up(&blocks);
        Ok(Self { tree, blocks, triangles: kept.len(), parts: Vec::new(), shift: 0 })
    }

    /// Joins trees of one space to a mesh that rays traverse like one tree. Nodes are copied, triangles are shared. So a
    /// change of one part does not build the trees of the others again.
    ///
    /// `None` if there are too many parts for the numbers in the leaves, if the tree would be too deep, or if a part is
    /// joined itself.
    pub fn join(parts: Vec<Arc<Self>>) -> Option<Self> {
        let blocks = parts.iter().map(|part| part.blocks.len()).max().unwrap_or(0);
        let shift = usize::BITS - blocks.leading_zeros();
        // The last number is that of no part, because unused slots have the last payload.
        let is_small = shift < 31 && (parts.len() as u64 + 1) << shift <= 1 << 31;
        if !is_small || parts.iter().any(|part| !part.parts.is_empty()) {
            return None;
        }
        let present: Vec<u32> = (0..parts.len() as u32).filter(|&i| parts[i as usize].tree.root != NONE).collect();
        let boxes: Vec<Aabb> = present.iter().map(|&i| parts[i as usize].tree.bounds).collect();
        let (mut tree, _) = build_tree(Level::new(), Threads::ONE, &boxes, 1, |_, leaf| present[leaf[0] as usize]);
        let deepest = parts.iter().map(|part| part.tree.depth()).max().unwrap_or(0);
        if tree.depth() + deepest > MAX_DEPTH {
            return None;
        }
        tree.pair_up(&[]);
        let (above, pairs_above) = (tree.nodes.len(), tree.pairs.len());
        tree.nodes.reserve(parts.iter().map(|part| part.tree.nodes.len()).sum());
        tree.pairs.reserve(parts.iter().map(|part| part.tree.pairs.len()).sum());
        let mut roots = vec![(NONE, Subtree::NONE); parts.len()];
        for (number, part) in (0u32..).zip(&parts) {
            let first = tree.nodes.len() as u32;
            let payload = number << shift;
            let first_pair = tree.pairs.len() as u32;
            roots[number as usize] =
                (moved(part.tree.root, first, payload), part.tree.first.moved(first_pair, payload));
            tree.pairs.extend(part.tree.pairs.iter().map(|pair| {
                let mut moved_pair = Pair { node: moved(pair.node, first, payload), ..pair.clone() };
                for child in 0..2 {
                    moved_pair.set_child(child, pair.child(child).moved(first_pair, payload));
                }
                moved_pair
            }));
            let children = |node: &Node| node.children.map(|child| moved(child, first, payload));
            tree.nodes.extend(part.tree.nodes.iter().map(|node| Node { children: children(node), ..node.clone() }));
        }
        let root = |word: u32| match word {
            leaf if leaf != NONE && leaf & LEAF != 0 => roots[(leaf & !LEAF) as usize].0,
            other => other,
        };
        let root_of_pairs = |child: Subtree| match child.word {
            leaf if leaf != NONE && leaf & LEAF != 0 => roots[(leaf & !LEAF) as usize].1,
            _ => child,
        };
        for node in &mut tree.nodes[..above] {
            node.children = node.children.map(root);
        }
        for pair in &mut tree.pairs[..pairs_above] {
            for child in 0..2 {
                pair.set_child(child, root_of_pairs(pair.child(child)));
            }
        }
        tree.root = root(tree.root);
        tree.first = root_of_pairs(tree.first);
        let triangles = parts.iter().map(|part| part.triangles).sum();
        Some(Self { tree, blocks: Vec::new(), triangles, parts, shift })
    }

    /// The block of a leaf, and the number of its part.
    #[inline(always)]
    pub(crate) fn block(&self, payload: u32) -> Option<(&TriangleBlock, u32)> {
        if self.parts.is_empty() {
            return Some((self.blocks.get(payload as usize)?, 0));
        }
        let part = payload >> self.shift;
        let block = payload & ((1 << self.shift) - 1);
        Some((self.parts.get(part as usize)?.blocks.get(block as usize)?, part))
    }
}

/// The numbers of the triangles that a ray can hit, and their boxes.
fn boxes_of(mesh: &MeshTriangles, number: usize, threads: Threads) -> Result<(Vec<u32>, Vec<Aabb>), BvhError> {
    let chunks = (0..).step_by(CHUNK).zip(mesh.triangles.chunks(CHUNK)).collect();
    let parts = threads.map(chunks, |(first, triangles): (usize, &[[u32; 3]])| {
        let (mut kept, mut boxes) = (Vec::with_capacity(triangles.len()), Vec::with_capacity(triangles.len()));
        for (i, triangle) in (first..).zip(triangles) {
            let at = |v: u32| mesh.positions.get(v as usize).copied();
            let [Some(a), Some(b), Some(c)] = triangle.map(at) else {
                return Err(BvhError::VertexOutOfRange { mesh: number, triangle: i, vertices: mesh.positions.len() });
            };
            let corners = [a, b, c];
            if corners.iter().all(|c| c.is_finite()) && geometric_normal(&corners) != Vec3::ZERO {
                kept.push(i as u32);
                boxes.push(Aabb::from_points(corners));
            }
        }
        Ok((kept, boxes))
    });
    let (mut kept, mut boxes) = (Vec::with_capacity(mesh.triangles.len()), Vec::with_capacity(mesh.triangles.len()));
    for part in parts {
        let (numbers, of_part) = part?;
        kept.extend(numbers);
        boxes.extend(of_part);
    }
    Ok((kept, boxes))
}

#[inline]
pub(crate) fn is_valid(ray: &Ray) -> bool {
    ray.origin.is_finite() && ray.direction.is_finite() && ray.direction != Vec3::ZERO && ray.t_max > 0.0
}
