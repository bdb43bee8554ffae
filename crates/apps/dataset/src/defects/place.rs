//! Defects on a surface: the search for a place with enough room.

use super::change::own_part;
use super::host::{Anchor, AreaTable, EdgeTable};
use super::material::{self, clear_volume, is_absent};
use super::site::{Known, Made, Site, extent_of, insert, rounding};
use super::spec::{
    Chatter, Chip, ColdShut, Decal, Defect, DefectSpec, Dent, Dust, Fibre, PlacedDefect, Pore, Scratch, Stain,
};
use super::surface::LocalSurface;
use super::{decal, particle, round, scratch, shapes};
use crate::distribution::Fault;
use dunkelfeld_geometry::{DAffine3, DVec3};
use dunkelfeld_sampling::Pcg;
use dunkelfeld_scene::SceneBuilder;
use std::cell::RefCell;

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

/// Adds a defect that lies on a surface.
///
/// # Errors
/// If no surface fits, or if no place of 256 has enough room.
pub(super) fn on_surface(scene: &mut SceneBuilder, spec: &DefectSpec, stream: &mut Pcg) -> Result<PlacedDefect, Fault> {
    let (areas, edges) = match &spec.defect {
        Defect::Chip(_) => (None, Some(EdgeTable::new(scene, spec)?)),
        _ => (Some(AreaTable::new(scene, spec)?), None),
    };
    let rounding = rounding(scene);
    let known = RefCell::default();
    for _ in 0..TRIES {
        let on_edge = edges.as_ref().and_then(|table| table.draw(stream));
        let Some(anchor) = on_edge.or_else(|| areas.as_ref()?.draw(scene, stream)) else { continue };
        let Some(mut made) = attempt(scene, spec, &anchor, (rounding, &known), stream) else { continue };
        let instance = &scene.instances[anchor.instance];
        let (on, motion) = (instance.name.clone(), instance.motion);
        let is_in_body = made.is_in_body || made.hole.is_some();
        let to_world = if is_in_body { instance.to_world } else { DAffine3::from_translation(anchor.point) };
        let (extent, angle) = (extent_of(&made.mesh, &to_world), made.angle);
        let replaces = made.hole.take().map(|mesh| {
            let part = own_part(scene, anchor.instance, anchor.part);
            part.mesh = mesh.into();
            part.material
        });
        scene.images.extend(made.image.take());
        insert(scene, &spec.name, made, to_world, motion);
        return Ok(PlacedDefect {
            object: spec.name.clone(),
            at: anchor.point,
            normal: anchor.normal,
            on,
            host: anchor.instance,
            extent,
            angle,
            is_clear: false,
            replaces,
        });
    }
    Err(Fault::new(
        format!("the defect \"{}\" finds no room on the surface: no place of {TRIES} fits", spec.name),
        "make it smaller, or name larger, smoother or opaque objects; a defect that is cut into a body needs free space \
         in and below it, and a chip an edge",
    )
    .below("length"))
}

fn attempt(
    scene: &SceneBuilder,
    spec: &DefectSpec,
    anchor: &Anchor,
    (rounding, known): (f64, &RefCell<Known>),
    stream: &mut Pcg,
) -> Option<Made> {
    let instance = scene.instances.get(anchor.instance)?;
    let part = scene.meshes.get(anchor.part)?;
    let host = scene.materials.get(part.material)?;
    // A defect extends by half of its length. The rest is room for steps over steep triangles.
    let (size, radius) = match &spec.defect {
        Defect::Scratch(Scratch { length, width, .. })
        | Defect::ColdShut(ColdShut { length, width, .. })
        | Defect::Fibre(Fibre { length, width, .. }) => (width.0, length.0 + width.0),
        Defect::Decal(Decal { length, .. }) => {
            let image = spec.image.as_ref()?;
            (length.0, length.0 * f64::from(image.width).hypot(f64::from(image.height)) / f64::from(image.width))
        }
        Defect::Dent(Dent { length, .. })
        | Defect::Pore(Pore { length, .. })
        | Defect::Chip(Chip { length, .. })
        | Defect::Chatter(Chatter { length, .. })
        | Defect::Stain(Stain { length, .. })
        | Defect::Dust(Dust { length, .. }) => (length.0, length.0),
        _ => return None,
    };
    let safe = (SAFE_STEPS * rounding).min(SAFE_OF_SIZE * size);
    let lift = LIFT.min(LIFT_OF_SIZE * size).max(safe).max(LEAST_STEPS * rounding);
    let is_present = |part: &&usize| material::of(scene, **part).is_some_and(|m| !is_absent(m));
    let parts: Vec<usize> = instance.meshes.iter().filter(is_present).copied().collect();
    let surface = LocalSurface::collect(scene, instance, &parts, anchor.point, radius);
    let foot = surface.project(DVec3::ZERO, anchor.normal, lift)?;
    let volume = clear_volume(host);
    let (finish, below) = (spec.defect.finish(&spec.name), (anchor.part, &*part.mesh));
    let site = Site { finish, scene, anchor, surface, foot, below, host, volume, lift, known };
    match &spec.defect {
        Defect::Scratch(scratch) => scratch::scratch(&site, scratch, stream),
        Defect::Dent(dent) => round::dent(&site, dent),
        Defect::Stain(stain) => round::stain(&site, stain, stream),
        Defect::Decal(decal) => decal::decal(&site, decal, spec.image.as_ref()?, stream),
        Defect::Fibre(fibre) => particle::fibre(&site, fibre, stream),
        Defect::Dust(dust) => Some(particle::dust(&site, dust, stream)),
        // The other kinds are cut into an opaque body.
        _ if site.volume.is_some() => None,
        Defect::ColdShut(shut) => scratch::cold_shut(&site, shut, stream),
        Defect::Pore(pore) => shapes::pore(&site, pore, stream),
        Defect::Chip(chip) => shapes::chip(&site, chip, stream),
        Defect::Chatter(chatter) => shapes::chatter(&site, chatter, stream),
        _ => None,
    }
}
