//! The scene as plain data. Importers and programs fill it.

use crate::camera::lens::Lens;
use crate::camera::look_at;
use crate::camera::shutter::Shutter;
use crate::light::luminaire::LightProfile;
use crate::material::Material;
use crate::material::texture::{Image, ImageId};
use crate::sampling_options::Techniques;
use dunkelfeld_bsdf::PrincipledModel;
use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, RigidMotion};
use dunkelfeld_radiometry::Rgb;
use std::sync::Arc;

/// A scene before it is compiled. Indices (`usize`) refer to the vectors of this struct.
///
/// World space is right-handed, in metres. Transforms are f64, so that a scene far from the origin loses no precision.
/// The compiled scene has its own origin.
#[derive(Clone, Debug, Default)]
pub struct SceneBuilder {
    /// Name for messages.
    pub name: String,
    /// Decoded images.
    pub images: Vec<Image>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Meshes, one material each. A mesh that is used n times is stored once.
    pub meshes: Vec<MeshPart>,
    /// Placements of meshes.
    pub instances: Vec<Instance>,
    /// Lights without extent.
    pub lights: Vec<PunctualLight>,
    /// Measured distributions of such lights.
    pub profiles: Vec<LightProfile>,
    /// Cameras; the first is the default.
    pub cameras: Vec<Camera>,
    /// Light from infinitely far away.
    pub environment: Option<Environment>,
    /// True if rough surfaces are compensated for the energy that their model loses between facets. Off by default; see
    /// [`dunkelfeld_bsdf::compensation`].
    pub energy_compensation: bool,
    /// How the lobes of principled surfaces share the light: layers that conserve energy by default.
    pub principled: PrincipledModel,
    /// Light sampling techniques that may be used; all by default.
    pub techniques: Techniques,
    /// The times of the samples. Without it, everything is at rest in the pose of time 0.
    pub shutter: Option<Shutter>,
    /// Number of threads of the build; 0 means one per core. The scene has the same bits for any number.
    pub threads: usize,
}

/// A mesh and its material.
#[derive(Clone, Debug, Default)]
pub struct MeshPart {
    /// Name, for reports.
    pub name: String,
    /// The triangles. Copies of the description share them.
    pub mesh: Arc<Mesh>,
    /// Index into [`SceneBuilder::materials`].
    pub material: usize,
    /// True if all emitting triangles of the mesh are one light, whose points are sampled uniformly over the area. By
    /// default each triangle, or each rectangle of two, is a light of its own.
    pub is_single_light: bool,
    /// Radius \[m\] of the fillets of its sharp convex edges in the world; 0 leaves them sharp. Light must not pass or leave the
    /// surface: else they stay sharp.
    pub edge_radius: f32,
    /// True if neither its file nor its user states the unit of length: a size below 2 mm is then reported.
    pub is_unit_assumed: bool,
}

/// One placement of an object in the world.
#[derive(Clone, Debug)]
pub struct Instance {
    /// Name of the object (the node), for labels and overrides. All parts of one node share an object id.
    pub name: String,
    /// Indices into [`SceneBuilder::meshes`]: the parts of this object.
    pub meshes: Vec<usize>,
    /// Object to world at time 0; may mirror and scale unevenly, must be invertible.
    pub to_world: DAffine3,
    /// Motion in the world. It needs [`SceneBuilder::shutter`]. An object that moves must not emit light.
    pub motion: RigidMotion,
}

/// A light without extent, at the origin of its own space. It shines along -z.
#[derive(Clone, Debug)]
pub struct PunctualLight {
    /// Name, for overrides and reports.
    pub name: String,
    /// Light to world. Only position and directions are used. Lights without a profile use only the direction of -z.
    pub to_world: DAffine3,
    /// Kind and strength of the light.
    pub kind: PunctualKind,
}

/// Kinds of punctual lights (KHR_lights_punctual), and of those with a measured profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PunctualKind {
    /// Emits equally in all directions.
    Point {
        /// Radiant intensity [W/sr].
        intensity: Rgb,
    },
    /// A cone with a soft edge: full inside `inner`, none outside `outer`, smooth between (KHR_lights_punctual).
    Spot {
        /// Radiant intensity on the axis [W/sr].
        intensity: Rgb,
        /// Half-angle of the full cone \[rad\], in \[0, outer\].
        inner: f32,
        /// Half-angle of the edge \[rad\], in (0, pi/2].
        outer: f32,
    },
    /// A distant light: all of its light has one direction.
    Directional {
        /// Irradiance on a surface that faces the light [W/m^2].
        irradiance: Rgb,
    },
    /// Light from infinitely far away with an angular diameter.
    Sun {
        /// Irradiance on a surface that faces the light [W/m^2].
        irradiance: Rgb,
        /// Half of the angular diameter \[rad\], in (0, pi/2].
        half_angle: f32,
    },
    /// A point light with a measured distribution.
    Profile {
        /// Index into [`SceneBuilder::profiles`].
        profile: usize,
        /// Multiplies the profile's intensity.
        scale: Rgb,
    },
}

/// Light from all directions, from infinitely far away.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Source of the radiance.
    pub source: EnvironmentSource,
    /// Rotation about the world's +y axis \[rad\].
    pub rotation: f32,
}

/// Radiance of the environment.
#[derive(Clone, Debug, PartialEq)]
pub enum EnvironmentSource {
    /// The same radiance [W/(m^2 sr)] from everywhere.
    Constant(Rgb),
    /// An equirectangular image: +y is up, the direction -z lies in the centre column of the image.
    Image {
        /// The image, linear.
        image: ImageId,
        /// Multiplies the image to give radiance [W/(m^2 sr)].
        scale: Rgb,
    },
}

/// A camera. Its viewing direction is its own -z axis, with +y up (glTF).
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Camera {
    /// Name, for `--camera`.
    pub name: String,
    /// Camera to world. Scale is ignored.
    pub to_world: DAffine3,
    /// The projection.
    pub projection: Projection,
    /// Width over height for which the camera was made; `None` if the file does not contain it.
    pub aspect: Option<f32>,
    /// The lens; the default is a pinhole.
    pub lens: Lens,
    /// The part of a larger film that is rendered; `None` renders the whole film.
    pub window: Option<FilmWindow>,
}

/// A window of a larger film: a region of interest, binned pixels, or both. Field of view and principal point of the
/// camera are those of the whole film.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct FilmWindow {
    /// Width and height of the whole film \[pixels\].
    pub full: [u32; 2],
    /// Top left corner of the window, in pixels of the whole film from its top left corner.
    pub origin: [f64; 2],
    /// Side of a rendered pixel, in pixels of the whole film: 2 for a binning of 2 x 2.
    pub step: f64,
}

/// How a camera maps the world to its film.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Projection {
    /// All chief rays meet in the camera's position: a pinhole, or the middle of a thin lens.
    Perspective {
        /// Full vertical field of view \[rad\] of a film around the axis, without distortion: the film lies
        /// `1 / (2 tan(fov / 2))` of its height behind the lens.
        vertical_fov: f32,
    },
    /// Parallel chief rays: orthographic, or a telecentric lens if the aperture is finite. Rays start on the plane
    /// through the camera's position.
    Orthographic {
        /// Half of the film's width in the world \[m\].
        half_width: f32,
        /// Half of the film's height in the world \[m\].
        half_height: f32,
    },
}

impl Default for Projection {
    /// A perspective of 40 degrees.
    fn default() -> Self {
        Self::Perspective { vertical_fov: 40f32.to_radians() }
    }
}

impl SceneBuilder {
    /// True if an object moves while samples are taken.
    pub fn moves(&self, instance: &Instance) -> bool {
        self.shutter.is_some() && !instance.motion.is_static()
    }

    /// Lowest and highest corner \[m\] of an object in the world; `None` without triangles that have finite corners.
    pub fn bounds_of(&self, instance: &Instance) -> Option<[DVec3; 2]> {
        let meshes = instance.meshes.iter().filter_map(|m| self.meshes.get(*m)).map(|part| &part.mesh);
        let corners =
            meshes.flat_map(|mesh| mesh.triangles.iter().flatten().filter_map(|i| mesh.positions.get(*i as usize)));
        let placed = corners.map(|p| instance.to_world.transform_point3(p.as_dvec3())).filter(|p| p.is_finite());
        placed.map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
    }

    /// Adds a material; returns its index.
    pub fn add_material(&mut self, material: Material) -> usize {
        self.materials.push(material);
        self.materials.len() - 1
    }

    /// Adds a mesh with one placement by the identity, as an object of its own. Returns the index of the object.
    pub fn add_object(&mut self, name: &str, mesh: impl Into<Arc<Mesh>>, material: usize) -> usize {
        self.meshes.push(MeshPart { name: name.into(), mesh: mesh.into(), material, ..MeshPart::default() });
        self.instances.push(Instance {
            name: name.into(),
            meshes: vec![self.meshes.len() - 1],
            to_world: DAffine3::IDENTITY,
            motion: RigidMotion::default(),
        });
        self.instances.len() - 1
    }

    /// Adds a perspective camera at `eye` with the view direction to `target` with world +y up; returns its index.
    ///
    /// `vertical_fov` is the full angle \[rad\].
    pub fn add_camera(&mut self, name: &str, eye: DVec3, target: DVec3, vertical_fov: f32) -> usize {
        let to_world = look_at(eye, target, DVec3::Y);
        self.cameras.push(Camera {
            name: name.into(),
            to_world,
            projection: Projection::Perspective { vertical_fov },
            ..Camera::default()
        });
        self.cameras.len() - 1
    }
}
