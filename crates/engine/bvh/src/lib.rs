//! Bounding volume hierarchy: the nearest triangle along a ray, and tests for occlusion.
//!
//! The tree has eight children to a node and up to eight triangles to a leaf, all tested at once. It is built from the
//! top down by the surface area heuristic. Traversal uses AVX-512 or AVX2 if the machine has it, else SSE2, NEON or plain
//! Rust, with the same bits. The triangle test is watertight and the boxes allow for all rounding, so that no ray passes
//! between the triangles of a closed mesh. There are two levels: each mesh has a tree, and a tree over instances is above.
//! A scene of one mesh in world space has no upper level and transforms no rays. Batches of rays in world space follow a
//! binary tree of the same boxes and triangles in packets, with the hits of single rays.
//!
//! ```
//! use dunkelfeld_bvh::{Bvh, BvhInstance, MeshTriangles};
//! use dunkelfeld_geometry::{Ray, Vec3};
//!
//! let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
//! let mesh = MeshTriangles { positions: &positions, triangles: &[[0, 1, 2]] };
//! let bvh = Bvh::build(&[mesh], &[BvhInstance { mesh: 0, to_world: None, motion: None }])?;
//! let hit = bvh.closest_hit(&Ray::new(Vec3::new(0.25, 0.5, 2.0), -Vec3::Z));
//! assert_eq!(hit.map(|h| (h.t, h.b1, h.b2)), Some((2.0, 0.25, 0.5)));
//! # Ok::<(), dunkelfeld_bvh::BvhError>(())
//! ```

mod batch;
mod build;
mod packet;
mod pairs;
mod scene;
mod simd8;
mod traverse;
mod tree;
mod triangle_block;
mod validate;

pub use batch::{HitBatch, RayBatch};
pub use scene::{Bvh, BvhError, BvhInstance, Hit, InstanceMotion, MeshTree, MeshTriangles, NO_HIT};
