//! What is in front of the camera: meshes, materials, textures, lights, cameras; and the compiled [`Scene`] that rays
//! are traced against.
//!
//! A [`SceneBuilder`] is plain data that an importer or a program fills; [`SceneBuilder::build`] checks it, repairs what
//! can be repaired, reports hazards, and compiles it.

#![forbid(unsafe_code)]

mod builder;
pub mod camera;
mod check;
mod compile;
pub mod cover;
mod delta_light;
pub mod distortion;
pub mod effects;
mod environment;
mod facet;
pub mod features;
mod fingerprint;
mod hazards;
pub mod interior;
pub mod intersect;
mod inventory;
mod leave_out;
pub mod lens;
pub mod light;
mod light_tree;
mod material;
pub mod medium;
pub mod nesting;
mod normal_differential;
mod profile;
pub mod report;
mod scene;
pub mod shading;
pub mod shapes;
mod surface;
pub mod techniques;
mod texture;
mod texture_eval;

pub use dunkelfeld_bsdf::EFFECTS;

pub use builder::{
    Camera, Environment, EnvironmentSource, Instance, MeshPart, Projection, PunctualKind, PunctualLight, SceneBuilder,
};
pub use camera::{CameraError, CameraRay, RayGenerator, framing_camera, look_at};
pub use compile::BuildError;
pub use cover::{Candidate, Chain, CoverStack, Crossing, Seed, Target};
pub use distortion::Distortion;
pub use effects::{Effect, Effects, kernel_words};
pub use features::{Everything, FeatureSet, Features, With};
pub use fingerprint::digest;
pub use interior::Interior;
pub use intersect::SurfacePoint;
pub use inventory::{LightInfo, PartInfo};
pub use lens::{Aperture, Blades, Lens, Opening, ThinLens, Vignetting};
pub use light::{LightChoice, LightReceiver, LightSample, LightTarget};
pub use material::{AlphaMode, ChannelTexture, Material, Surface, Volume};
pub use medium::{Medium, MediumEvent};
pub use nesting::{Boundary, Interface};
pub use normal_differential::NormalDifferential;
pub use profile::{LightProfile, ProfileError};
pub use report::{BuildReport, Finding, Severity};
pub use scene::{Scene, SceneSummary};
pub use shading::ShadingPoint;
pub use techniques::Techniques;
pub use texture::{ColorEncoding, Filter, Image, ImageId, Texels, Texture, TextureTransform, Wrap};
