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
    scene.meshes.push(MeshPart { name: name.into(), mesh: made.mesh.into(), material, ..MeshPart::default() });
    let to_world = DAffine3::from_translation(at);
    scene.instances.push(Instance { name: name.into(), meshes: vec![scene.meshes.len() - 1], to_world, motion });
}

/// The largest distance between two vertices of a mesh \[m\] ([`largest_distance`]).
pub(super) fn extent_of(mesh: &Mesh) -> f64 {
    largest_distance(mesh.positions.iter().map(|p| p.as_dvec3()))
}

/// The largest distance between two points, to a few per cent: from the largest distance between the outermost points in 26
/// directions, to the farthest point of each point, until the distance grows no more. Exact for balls and boxes.
pub(super) fn largest_distance(points: impl Iterator<Item = DVec3> + Clone) -> f64 {
    let steps = || (-1..=1).map(f64::from);
    let directions = steps().flat_map(|x| steps().flat_map(move |y| steps().map(move |z| DVec3::new(x, y, z))));
    // Of two opposite directions one is enough.
    let mut outermost: Vec<(DVec3, [(f64, DVec3); 2])> =
        directions.skip(14).map(|d| (d, [(f64::INFINITY, DVec3::ZERO), (f64::NEG_INFINITY, DVec3::ZERO)])).collect();
    let mut is_empty = true;
    for p in points.clone() {
        is_empty = false;
        for (direction, [least, most]) in &mut outermost {
            let height = p.dot(*direction);
            if height < least.0 {
                *least = (height, p);
            }
            if height > most.0 {
                *most = (height, p);
            }
        }
    }
    if is_empty {
        return 0.0;
    }
    let ends = || outermost.iter().flat_map(|(_, ends)| ends.map(|(_, p)| p));
    let pairs = ends().flat_map(|a| ends().map(move |b| (a.distance(b), a)));
    let Some((mut distance, mut from)) = pairs.reduce(|a, b| if b.0 > a.0 { b } else { a }) else { return 0.0 };
    loop {
        let all = points.clone().map(|p| (p.distance(from), p));
        match all.reduce(|a, b| if b.0 > a.0 { b } else { a }) {
            Some((farther, p)) if farther > distance => (distance, from) = (farther, p),
            _ => return distance,
        }
    }
}
