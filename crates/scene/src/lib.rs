//! What is in front of the camera: meshes, materials, textures, lights, cameras; and the compiled [`Scene`] that rays
//! are traced against.
//!
//! A [`SceneBuilder`] is plain data that an importer or a program fills; [`SceneBuilder::build`] checks it, repairs what
//! can be repaired, reports hazards, and compiles it.

#![forbid(unsafe_code)]

mod builder;
mod material;
mod texture;

pub use builder::{
    Camera, Environment, EnvironmentSource, Instance, MeshPart, Projection, PunctualKind, PunctualLight, SceneBuilder,
};
pub use material::{AlphaMode, ChannelTexture, Material, Surface, Volume};
pub use texture::{ColorEncoding, Filter, Image, ImageId, Texels, Texture, TextureTransform, Wrap};
