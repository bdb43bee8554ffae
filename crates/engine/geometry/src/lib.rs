//! Geometry without light: vectors, rays, frames, transforms, triangle meshes and their health.
//!
//! Lengths are metres, angles radians. World and local directions are different types: a [`LocalDir`] belongs to a
//! shading [`Frame`] whose normal is +z. Coordinates are f32. Computations with strong cancellation use f64 inside.

#![forbid(unsafe_code)]
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod bounds;
mod frame;
pub mod health;
mod mesh;
mod motion;
mod ray;
pub mod shape;
mod threads;
mod transform;
pub mod triangle;

pub use bounds::Aabb;
pub use frame::{Frame, LocalDir};
pub use mesh::Mesh;
pub use motion::{RigidMotion, Spin};
pub use ray::Ray;
pub use threads::Threads;
pub use transform::{Transform, TransformError};
pub use triangle::{geometric_normal, hit_point, hit_points, offset_ray_origin, offset_ray_origins, triangle_area};

pub use glam::{Affine3A, DAffine3, DMat3, DMat4, DQuat, DVec2, DVec3, Mat3, Quat, Vec2, Vec3, Vec3A, Vec4};
