//! A place on a surface, and a made defect that is put there.

use super::material;
use super::spec::DefectSpec;
use super::surface::{LocalSurface, SurfaceHit};
use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, RigidMotion};
use dunkelfeld_scene::{Instance, Material, MeshPart, SceneBuilder, Volume};

/// A place for a defect.
pub(super) struct Site<'a> {
    /// The description of the defect.
    pub(super) spec: &'a DefectSpec,
    /// The surface around the place. Positions are relative to the drawn point.
    pub(super) surface: LocalSurface<'a>,
    /// The drawn point.
    pub(super) foot: SurfaceHit,
    /// Part below the drawn point: index and mesh.
    pub(super) below: (usize, &'a Mesh),
    /// Its material.
    pub(super) host: &'a Material,
    /// The volume below, if light can enter it.
    pub(super) volume: Option<Volume>,
    /// Height of a patch above the surface \[m\].
    pub(super) lift: f64,
}

/// A defect in coordinates relative to the drawn point.
pub(super) struct Made {
    pub(super) mesh: Mesh,
    pub(super) material: Material,
    /// Direction in the tangent plane \[rad\], drawn or given. `None` if the kind has none.
    pub(super) angle: Option<f64>,
}

/// The step of f32 at the radius of the scene \[m\].
pub(super) fn rounding(scene: &SceneBuilder) -> f64 {
    let bounds = scene.instances.iter().filter_map(|i| scene.bounds_of(i));
    let all = bounds.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
    all.map_or(0.0, |[low, high]| 0.5 * low.distance(high)) * f64::from(f32::EPSILON)
}

/// Adds a mesh relative to a point in the world as an object of its own.
pub(super) fn insert(scene: &mut SceneBuilder, name: &str, made: Made, at: DVec3, motion: RigidMotion) {
    let material = material::add(scene, made.material);
    scene.meshes.push(MeshPart { name: name.into(), mesh: made.mesh.into(), material, is_single_light: false });
    let to_world = DAffine3::from_translation(at);
    scene.instances.push(Instance { name: name.into(), meshes: vec![scene.meshes.len() - 1], to_world, motion });
}

/// The largest distance between two vertices \[m\], to 15 %: the larger one of two distances, from the first vertex to
/// the farthest one, and from there to the farthest one.
pub(super) fn extent_of(mesh: &Mesh) -> f64 {
    let farthest = |from: DVec3| {
        let distances = mesh.positions.iter().map(|p| (p.as_dvec3().distance(from), p.as_dvec3()));
        distances.reduce(|a, b| if b.0 > a.0 { b } else { a })
    };
    let first = mesh.positions.first().map_or(DVec3::ZERO, |p| p.as_dvec3());
    farthest(first).and_then(|(_, p)| farthest(p)).map_or(0.0, |(distance, _)| distance)
}
