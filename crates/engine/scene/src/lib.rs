//! The scene in front of the camera: meshes, materials, textures, lights, cameras; and the compiled [`Scene`] that rays
//! are traced against.
//!
//! A [`SceneBuilder`] is plain data that an importer or a program fills. [`SceneBuilder::build`] validates it, repairs
//! damaged data, reports hazards, and compiles it.

#![forbid(unsafe_code)]

pub mod build;
pub mod camera;
pub mod covers;
mod geometry;
pub mod lamps;
pub mod light;
pub mod material;
pub mod media;
pub mod query;
pub mod sampling_options;
mod scene;
pub mod shapes;

pub use dunkelfeld_bsdf::PrincipledModel;

pub use build::builder::{
    Camera, Environment, EnvironmentSource, FilmWindow, Instance, MeshPart, Projection, PunctualKind, PunctualLight,
    SceneBuilder,
};
pub use build::cache::BuildCache;
pub use build::effects::{Effect, Effects};
pub use build::error::BuildError;
pub use build::fingerprint::digest;
pub use build::lints::LARGEST_OBJECT;
pub use build::report::{BuildReport, Finding, Severity};
pub use camera::distortion::Distortion;
pub use camera::lens::{Aperture, Blades, Lens, Opening, ThinLens, Vignetting};
pub use camera::shutter::{LineScan, Moment, Shutter};
pub use camera::{CameraError, CameraRay, CameraRays, RayGenerator, framing_camera, look_at};
pub use covers::{CandidateChains, Chain, CoverStack, Targets};
pub use geometry::normal_differential::NormalDifferentials;
pub use lamps::{LampMeshes, LampShape, Leds};
pub use light::LightChoice;
pub use light::emission_profile::EmissionProfile;
pub use light::groups::LightGroups;
pub use light::luminaire::{LightProfile, ProfileError};
pub use light::sample::{LightSamples, Receivers};
pub use light::summary::{LightInfo, ObjectInfo, PartInfo};
pub use material::finish::{Finish, Grain, Process};
pub use material::height_image::HeightImage;
pub use material::texture::{ColorEncoding, Filter, Image, ImageId, Texels, Texture, TextureTransform, Wrap};
pub use material::{
    AlphaMode, Anisotropy, Clearcoat, DiffuseTransmission, HeightField, Material, NormalMap, Parameter, Sheen,
    Specular, Surface, Volume,
};
pub use media::medium::{Medium, MediumEvents, MediumLanes, transmittance};
pub use media::medium_stack::Interior;
pub use media::nested_dielectrics::{Boundary, Interface};
pub use query::intersect::{SurfacePoint, shadow_rays};
pub use query::shading::{Bsdfs, ShadingFrames, ShadingLanes};
pub use query::surface_points::{HitLanes, SurfacePoints};
pub use sampling_options::Techniques;
pub use scene::{Scene, SceneSummary};
