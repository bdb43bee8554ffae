//! Which triangle a ray meets first, and whether it meets any.
//!
//! Built from obvhs's binary tree, walked as an own tree of eight children to a node with up to eight triangles to a
//! leaf, all tested at once: with AVX2 where the machine has it, else in plain Rust, with the same bits either way. The
//! triangle test is watertight and the boxes allow for all rounding, so that no ray slips through a closed mesh. Two
//! levels: each mesh has a tree, and a tree over instances stands above; a scene of one mesh that already lies in world
//! space has no upper level and transforms nothing.
//!
//! ```
//! use dunkelfeld_bvh::{Bvh, BvhInstance, MeshTriangles};
//! use dunkelfeld_geometry::{Ray, Vec3};
//!
//! let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
//! let mesh = MeshTriangles { positions: &positions, triangles: &[[0, 1, 2]] };
//! let bvh = Bvh::build(&[mesh], &[BvhInstance { mesh: 0, to_world: None }])?;
//! let hit = bvh.closest_hit(&Ray::new(Vec3::new(0.25, 0.5, 2.0), -Vec3::Z));
//! assert_eq!(hit.map(|h| (h.t, h.b1, h.b2)), Some((2.0, 0.25, 0.5)));
//! # Ok::<(), dunkelfeld_bvh::BvhError>(())
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used))]

mod build;
mod scene;
mod simd8;
mod traverse;
mod tree;
mod triangle_block;
mod validate;

pub use scene::{Bvh, BvhError, BvhInstance, Hit, MeshTriangles};
