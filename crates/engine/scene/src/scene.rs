//! The compiled scene that rays are traced against.

use crate::build::builder::Camera;
use crate::build::effects::Effects;
use crate::camera::shutter::Shutter;
use crate::camera::{CameraError, RayGenerator, framing_camera};
use crate::covers::scene_covers::Covers;
use crate::geometry::rounded_edges::RoundedEdges;
use crate::geometry::triangle_data::{FLAT, Facet, Facets};
use crate::light::LightTable;
use crate::material::Material;
use crate::material::texture::Image;
use crate::media::solid::Solid;
use crate::query::surface::CompiledMaterial;
use dunkelfeld_bvh::Bvh;
use dunkelfeld_geometry::{DVec3, Mesh, RigidMotion, Transform, Vec3};
use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::Arc;

/// Vertical field of view [rad] of the camera that frames a scene without one: 40 degrees.
const FRAMING_FOV: f64 = 0.698_131_700_797_731_8;

/// A scene ready to be rendered. Immutable, shared between threads.
///
/// Coordinates are in *render space*: world space moved so that the middle of the scene is the origin. So a part at a
/// distance of one kilometre from the world's origin is rendered as precisely as a part at the origin.
#[derive(Debug)]
pub struct Scene {
    pub(crate) world_origin: DVec3,
    pub(crate) bounds: Option<[DVec3; 2]>,
    pub(crate) bvh: Bvh,
    /// For each instance of the hierarchy: its part, or a mark for the shared tree, whose triangles refer to their
    /// parts.
    pub(crate) placements: Vec<Placement>,
    /// The triangles of the shared tree.
    pub(crate) facets: Facets,
    pub(crate) parts: Vec<Part>,
    pub(crate) meshes: Vec<Arc<Mesh>>,
    pub(crate) object_names: Vec<String>,
    pub(crate) punctual_names: Vec<String>,
    pub(crate) materials: Vec<Material>,
    pub(crate) compiled: Vec<CompiledMaterial>,
    pub(crate) images: Vec<Image>,
    pub(crate) lights: LightTable,
    pub(crate) cameras: Vec<Camera>,
    pub(crate) radius: f32,
    pub(crate) has_coverage: bool,
    /// True if light could pass the face of a solid straight.
    pub(crate) has_open_faces: bool,
    /// The solids, by rank.
    pub(crate) solids: Vec<Solid>,
    /// Corners of a box around all solids, in render space.
    pub(crate) solid_bounds: Option<[Vec3; 2]>,
    /// True if solids could touch or overlap.
    pub(crate) has_nesting: bool,
    pub(crate) covers: Covers,
    /// The times of the samples, if the image depends on them.
    pub(crate) shutter: Option<Shutter>,
    /// True if light enters solids.
    pub(crate) has_solids: bool,
    /// True if a path needs all solids around it.
    pub(crate) has_media: bool,
    pub(crate) effects: Effects,
}

/// Content of an instance of the hierarchy.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) enum Placement {
    /// The tree of all parts in render space without a tree of their own.
    Shared,
    /// The trees of all parts in render space, joined. They are the first parts of the scene.
    Joined,
    /// One part with a tree of its own, in render space or under a transform.
    Part(u32),
}

/// One mesh of one object, in the form that shading needs.
#[derive(Debug, serde::Serialize)]
pub(crate) struct Part {
    pub(crate) mesh: u32,
    pub(crate) material: u32,
    pub(crate) object: u32,
    /// Object to render space; `None` if the mesh is stored in render space.
    pub(crate) transform: Option<Box<Transform>>,
    /// Motion in render space of a part that moves; it has a transform, which is the pose at time 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) motion: Option<Box<RigidMotion>>,
    /// Index of its first triangle in the shared tree and in [`Scene::facets`]; 0 with a tree of its own.
    pub(crate) first_facet: u32,
    /// Its triangles, if it has a tree of its own.
    #[serde(skip)]
    pub(crate) facets: Option<Arc<Facets>>,
    /// The solid that it bounds, `NO_SOLID` if none.
    pub(crate) solid: u32,
    /// Light of each triangle; empty if nothing emits.
    pub(crate) lights: Vec<u32>,
    /// The frame of the object in metres to render space, at time 0, for rounded edges and materials with a grain or heights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) frame: Option<Box<Transform>>,
    /// The fillets of its edges.
    #[serde(skip)]
    pub(crate) edges: Option<Arc<RoundedEdges>>,
}

impl Part {
    /// [`Self::frame`] at a time \[s\].
    pub(crate) fn frame_at(&self, time: f32) -> Option<Transform> {
        let frame = self.frame.as_deref()?;
        Some(self.motion.as_ref().map_or(*frame, |motion| motion.moved(frame, f64::from(time))))
    }

    /// Object to render space at a time \[s\]; `None` if the mesh is stored in render space.
    #[inline]
    pub(crate) fn transform_at(&self, time: f32) -> Option<Cow<'_, Transform>> {
        let transform = self.transform.as_deref()?;
        Some(match &self.motion {
            None => Cow::Borrowed(transform),
            Some(motion) => Cow::Owned(motion.moved(transform, f64::from(time))),
        })
    }
}

/// Size of a scene in numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneSummary {
    /// Number of placed triangles: a mesh used n times counts n times.
    pub placed_triangles: u64,
    /// Number of stored triangles.
    pub stored_triangles: u64,
    /// Objects (instances of the builder).
    pub objects: usize,
    /// Meshes that are instanced, not moved to render space.
    pub instanced_parts: usize,
    /// Memory of geometry, the hierarchy and images \[bytes\].
    pub memory_bytes: u64,
    /// Memory of images, which is part of it \[bytes\].
    pub texture_bytes: u64,
    /// Lowest and highest corner in world space \[m\].
    pub bounds: Option<[[f64; 3]; 2]>,
}

impl Scene {
    /// The triangles among which those of a part are.
    #[inline(always)]
    pub(crate) fn facets_of<'a>(&'a self, part: &'a Part) -> &'a Facets {
        part.facets.as_deref().unwrap_or(&self.facets)
    }

    /// A triangle of a part.
    #[inline(always)]
    pub(crate) fn facet<'a>(&'a self, part: &'a Part, triangle: u32) -> &'a Facet {
        self.facets_of(part).triangle(part.first_facet + triangle)
    }

    /// The normals of the corners of a triangle; `None` if it has none of its own.
    pub(crate) fn corner_normals(&self, part: &Part, facet: &Facet) -> Option<[Vec3; 3]> {
        (facet.normals() != FLAT).then(|| self.facets_of(part).normals(facet.normals()).vectors())
    }

    /// The acceleration structure.
    #[inline]
    pub fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    /// True if some surface covers light in part. Then a shadow ray has a transmittance.
    #[inline]
    pub fn has_coverage(&self) -> bool {
        self.has_coverage
    }

    /// The position in world space of render space's origin.
    pub fn world_origin(&self) -> DVec3 {
        self.world_origin
    }

    /// Corners of the bounding box in world space; `None` for an empty scene.
    pub fn bounds(&self) -> Option<[DVec3; 2]> {
        self.bounds
    }

    /// Radius of the bounding sphere \[m\].
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// The effects that the scene needs, and the objects that need them.
    pub fn effects(&self) -> &Effects {
        &self.effects
    }

    /// True if light comes from infinitely far away: an environment or suns.
    #[inline]
    pub fn has_environment(&self) -> bool {
        self.lights.environment.is_some() || self.lights.has_suns()
    }

    /// True if light enters solids.
    #[inline]
    pub fn has_solids(&self) -> bool {
        self.has_solids
    }

    /// True if a medium scatters, if solids touch or overlap, or if faces bend no light. Then a path needs all solids
    /// around it.
    #[inline]
    pub fn has_media(&self) -> bool {
        self.has_media
    }

    /// The times of the samples. `None` if the image does not depend on them: a frame camera, and no object moves.
    #[inline]
    pub fn shutter(&self) -> Option<&Shutter> {
        self.shutter.as_ref()
    }

    /// The cameras of the scene file or the builder.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// The materials.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// Names of the objects, by object id.
    pub fn object_names(&self) -> &[String] {
        &self.object_names
    }

    /// The camera with the given name. Without a name, the first camera. If the scene has none, a camera with the whole
    /// scene in its image.
    ///
    /// `None` if there is no camera of that name.
    pub fn camera(&self, name: Option<&str>, aspect: f32) -> Option<Camera> {
        match name {
            Some(name) => self.cameras.iter().find(|c| c.name == name).cloned(),
            None => {
                Some(self.cameras.first().cloned().unwrap_or_else(|| framing_camera(self.bounds, aspect, FRAMING_FOV)))
            }
        }
    }

    /// Binds a camera to a film.
    ///
    /// # Errors
    /// As [`RayGenerator::new`]: invalid values, a distortion that cannot be inverted over the film.
    pub fn ray_generator(&self, camera: &Camera, width: u32, height: u32) -> Result<RayGenerator, CameraError> {
        RayGenerator::new(camera, width, height, self.world_origin, self.radius)
    }

    /// Size of the scene in numbers.
    pub fn summary(&self) -> SceneSummary {
        let image_bytes: usize = self.images.iter().map(|i| i.texels.bytes()).sum();
        let own = self.parts.iter().filter_map(|p| Some((p.facets.as_ref()?, p.mesh)));
        // Copies of a mesh share its triangles.
        let own: HashMap<u32, usize> = own.map(|(facets, mesh)| (mesh, facets.bytes())).collect();
        let facets = self.facets.bytes() + own.values().sum::<usize>();
        let meshes: usize = self.meshes.iter().map(|m| m.bytes()).sum();
        SceneSummary {
            placed_triangles: self.parts.iter().map(|p| self.meshes[p.mesh as usize].triangles.len() as u64).sum(),
            stored_triangles: self.meshes.iter().map(|m| m.triangles.len() as u64).sum(),
            objects: self.object_names.len(),
            instanced_parts: self.parts.iter().filter(|p| p.transform.is_some()).count(),
            memory_bytes: (self.bvh.memory_bytes() + meshes + image_bytes + facets) as u64,
            texture_bytes: image_bytes as u64,
            bounds: self.bounds.map(|b| b.map(|v| v.to_array())),
        }
    }
}
