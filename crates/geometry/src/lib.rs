//! Geometry without opinions about light: vectors, rays, frames, transforms, triangle meshes and their health.
//!
//! Lengths are metres, angles radians. World and local directions are different types: a [`LocalDir`] lives in a
//! shading [`Frame`] whose normal is +z.

#![forbid(unsafe_code)]

mod frame;
mod mesh;
mod ray;

pub use frame::{Frame, LocalDir};
pub use mesh::Mesh;
pub use ray::Ray;

pub use glam::{Affine3A, DAffine3, DMat3, DMat4, DQuat, DVec3, Mat3, Quat, Vec2, Vec3, Vec3A, Vec4};
