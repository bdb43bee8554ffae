//! Defects inside clear solids: bubbles and inclusions.

use super::draw;
use super::host::refuse_emitters;
use super::material::{self, clear_volume};
use super::particle::particle;
use super::site::{Made, insert, rounding};
use super::spec::{Bubble, Defect, DefectSpec, Inclusion, PlacedDefect};
use super::surface::LocalSurface;
use crate::distribution::Fault;
use dunkelfeld_geometry::health::MeshHealth;
use dunkelfeld_geometry::{DAffine3, DVec3, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Pcg;
use dunkelfeld_scene::{SceneBuilder, Volume, shapes};

/// Number of points in a solid that are tried.
const TRIES: usize = 512;
/// Number of points in the bounding box for each of them.
const DRAWS: usize = 10_000;
/// Distance to the boundary over the radius of the defect.
const CLEARANCE: f64 = 1.02;
/// Circles of latitude of a bubble. Its radius deviates from the sphere by 0.12 %.
const RINGS: u32 = 64;
/// Burnt matter.
const INCLUSION_COLOR: Rgb = Rgb::new(0.03, 0.025, 0.02);
const INCLUSION_ROUGHNESS: f32 = 0.7;

/// A closed part of a candidate that light can enter.
struct Solid {
    instance: usize,
    part: usize,
    volume: Volume,
    /// Bounds in the space of the mesh.
    low: DVec3,
    size: DVec3,
}

/// The clear solids of the candidates, with the sums of their volumes [m³].
fn solids(scene: &SceneBuilder, spec: &DefectSpec) -> Result<(Vec<Solid>, Vec<f64>), Fault> {
    let (mut solids, mut cumulative, mut sum, mut open) = (Vec::new(), Vec::new(), 0.0, None);
    for &index in &spec.on {
        let Some(instance) = scene.instances.get(index) else { continue };
        for &part in &instance.meshes {
            let Some(m) = scene.meshes.get(part) else { continue };
            let Some(volume) = scene.materials.get(m.material).and_then(clear_volume) else { continue };
            let health = MeshHealth::from_mesh(&m.mesh);
            let content = health.signed_volume.abs() * instance.to_world.matrix3.determinant().abs();
            if !(health.is_closed() && content > 0.0 && content.is_finite()) {
                open = Some(&instance.name);
                continue;
            }
            sum += content;
            cumulative.push(sum);
            let (low, high) = (health.bounds.min.as_dvec3(), health.bounds.max.as_dvec3());
            solids.push(Solid { instance: index, part, volume, low, size: high - low });
        }
    }
    match (solids.is_empty(), open) {
        (false, _) => Ok((solids, cumulative)),
        (true, Some(name)) => {
            Err(Fault::new(format!("the object \"{name}\" is not closed"), "repair its mesh: a solid needs an inside")
                .below("on"))
        }
        (true, None) => Err(Fault::new(
            "no candidate is a clear solid",
            "name an object whose material is solid and has a transmission above 0",
        )
        .below("on")),
    }
}

/// Adds a defect inside a clear solid.
///
/// # Errors
/// If no candidate is a closed clear solid, or if no point of 512 is far enough from the boundary.
pub(super) fn inside(scene: &mut SceneBuilder, spec: &DefectSpec, stream: &mut Pcg) -> Result<PlacedDefect, Fault> {
    refuse_emitters(scene, &spec.on)?;
    let (solids, cumulative) = solids(scene, spec)?;
    let finish = spec.defect.finish(&spec.name);
    let (length, is_gas) = match &spec.defect {
        Defect::Bubble(Bubble { length, .. }) => (length.0, true),
        Defect::Inclusion(Inclusion { length, .. }) => (length.0, false),
        _ => return Err(Fault::new("the defect does not lie in a solid", "choose another kind")),
    };
    let mesh = match is_gas {
        true => shapes::sphere(Vec3::ZERO, (0.5 * length) as f32, RINGS, true),
        false => particle(length, draw::direction(stream), stream),
    };
    let radius = mesh.positions.iter().map(|p| p.as_dvec3().length()).fold(0.0, f64::max);
    let clearance = CLEARANCE * radius + 8.0 * rounding(scene);
    let Some((at, solid)) = find(scene, &solids, &cumulative, clearance, stream) else {
        return Err(Fault::new(
            format!("the defect \"{}\" finds no room in the solid: no point of {TRIES} fits", spec.name),
            "make it smaller, or name larger objects",
        )
        .below("length"));
    };
    let host = solid.instance;
    let instance = &scene.instances[host];
    let (on, motion) = (instance.name.clone(), instance.motion);
    let material = match is_gas {
        true => material::gas(&finish, &solid.volume, 0.0),
        false => material::own(&finish, INCLUSION_COLOR, INCLUSION_ROUGHNESS),
    };
    insert(scene, &spec.name, Made::new(mesh, None, material), DAffine3::from_translation(at), motion);
    Ok(PlacedDefect {
        object: spec.name.clone(),
        at,
        normal: DVec3::Y,
        on,
        host,
        extent: length,
        replaces: None,
        angle: None,
        is_clear: false,
    })
}

/// A point in one of the solids, uniform by volume over the points that are at least `clearance` \[m\] away from the
/// boundary.
fn find<'a>(
    scene: &SceneBuilder,
    solids: &'a [Solid],
    cumulative: &[f64],
    clearance: f64,
    stream: &mut Pcg,
) -> Option<(DVec3, &'a Solid)> {
    let mut surfaces: Vec<Option<LocalSurface<'_>>> = solids.iter().map(|_| None).collect();
    for _ in 0..TRIES {
        let chosen = draw::entry(stream, cumulative);
        let solid = solids.get(chosen)?;
        let instance = scene.instances.get(solid.instance)?;
        let middle = instance.to_world.transform_point3(solid.low + 0.5 * solid.size);
        let surface = surfaces
            .get_mut(chosen)?
            .get_or_insert_with(|| LocalSurface::collect(scene, instance, &[solid.part], middle, f64::INFINITY));
        // Twice the largest extent in the world, so that a ray from any point leaves the solid.
        let reach = 2.0 * (0..3).map(|k| instance.to_world.matrix3.col(k).length() * solid.size[k]).sum::<f64>();
        for _ in 0..DRAWS {
            let u = DVec3::new(draw::uniform(stream), draw::uniform(stream), draw::uniform(stream));
            let point = instance.to_world.transform_point3(solid.low + u * solid.size);
            if surface.contains(point - middle, reach) {
                if surface.distance(point - middle, clearance) >= clearance {
                    return Some((point, solid));
                }
                break;
            }
        }
    }
    None
}
