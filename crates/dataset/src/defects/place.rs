//! Defects on a surface: the search for a place with enough room.

use super::host::{Anchor, AreaTable};
use super::material::{self, clear_volume, is_absent};
use super::surface::{LocalSurface, SurfaceHit};
use super::{DefectKind, DefectProblem, DefectSpec, PlacedDefect, particle, round, scratch};
use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, RigidMotion};
use dunkelfeld_sampling::Pcg;
use dunkelfeld_scene::{Instance, Material, MeshPart, SceneBuilder, Volume};

/// Number of places that are tried.
const TRIES: usize = 256;
/// Height of a patch above the surface \[m\], unless the defect is small or the scene large.
const LIFT: f64 = 2e-6;
/// The largest height over the size of the defect.
const LIFT_OF_SIZE: f64 = 0.005;
/// Below this number of steps of f32 at the radius of the scene, the compiler of the scene warns that rounding changes
/// the gap by percents. So the height is at least this, or this share of the size of the defect.
const SAFE_STEPS: f64 = 66.0;
const SAFE_OF_SIZE: f64 = 0.02;
/// The smallest height, in steps of f32 at the radius of the scene. Positions in render space are rounded to half a
/// step.
const LEAST_STEPS: f64 = 8.0;

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
}

/// Adds a defect that lies on a surface.
///
/// # Errors
/// If no surface fits, or if no place of 256 has enough room.
pub(super) fn on_surface(
    scene: &mut SceneBuilder,
    spec: &DefectSpec,
    stream: &mut Pcg,
) -> Result<PlacedDefect, DefectProblem> {
    let table = AreaTable::new(scene, spec)?;
    let rounding = rounding(scene);
    for _ in 0..TRIES {
        let Some(anchor) = table.draw(scene, stream) else { continue };
        let Some(made) = attempt(scene, spec, &anchor, rounding, stream) else { continue };
        let instance = &scene.instances[anchor.instance];
        let (on, motion) = (instance.name.clone(), instance.motion);
        let extent = extent_of(&made.mesh);
        insert(scene, &spec.name, made, anchor.point, motion);
        return Ok(PlacedDefect { object: spec.name.clone(), at: anchor.point, normal: anchor.normal, on, extent });
    }
    Err(DefectProblem::new(
        format!("the defect \"{}\" finds no room on the surface: no place of {TRIES} fits", spec.name),
        "make it smaller, or name larger or smoother objects; a defect does not extend over sharp edges",
    ))
}

/// The step of f32 at the radius of the scene \[m\].
pub(super) fn rounding(scene: &SceneBuilder) -> f64 {
    let bounds = scene.instances.iter().filter_map(|i| scene.bounds_of(i));
    let all = bounds.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
    all.map_or(0.0, |[low, high]| 0.5 * low.distance(high)) * f64::from(f32::EPSILON)
}

fn attempt(scene: &SceneBuilder, spec: &DefectSpec, anchor: &Anchor, rounding: f64, stream: &mut Pcg) -> Option<Made> {
    let instance = scene.instances.get(anchor.instance)?;
    let part = scene.meshes.get(anchor.part)?;
    let host = scene.materials.get(part.material)?;
    let is_curve = matches!(spec.kind, DefectKind::Scratch | DefectKind::Fibre);
    let size = if is_curve { spec.width } else { spec.length };
    let safe = (SAFE_STEPS * rounding).min(SAFE_OF_SIZE * size);
    let lift = LIFT.min(LIFT_OF_SIZE * size).max(safe).max(LEAST_STEPS * rounding);
    // A defect extends by half of its length. The rest is room for steps over steep triangles.
    let radius = spec.length + if is_curve { spec.width } else { 0.0 };
    let is_present = |part: &&usize| {
        let material = scene.meshes.get(**part).and_then(|m| scene.materials.get(m.material));
        material.is_some_and(|m| !is_absent(m))
    };
    let parts: Vec<usize> = instance.meshes.iter().filter(is_present).copied().collect();
    let surface = LocalSurface::collect(scene, instance, &parts, anchor.point, radius);
    let foot = surface.project(DVec3::ZERO, anchor.normal, lift)?;
    let volume = clear_volume(host);
    let site = Site { spec, surface, foot, below: (anchor.part, &part.mesh), host, volume, lift };
    match spec.kind {
        DefectKind::Scratch => scratch::scratch(&site, stream),
        DefectKind::Dent => round::dent(&site),
        DefectKind::Stain => round::stain(&site, stream),
        DefectKind::Fibre => particle::fibre(&site, stream),
        _ => Some(particle::dust(&site, stream)),
    }
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
