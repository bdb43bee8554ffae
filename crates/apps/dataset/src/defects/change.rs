//! Defects that change an object: missing, faded, shifted.

use super::draw;
use super::host::refuse_emitters;
use super::material;
use super::site::largest_distance;
use super::spec::{Defect, DefectSpec, Faded, PlacedDefect, Shifted};
use crate::distribution::Fault;
use dunkelfeld_geometry::{DVec3, Mesh};
use dunkelfeld_sampling::Pcg;
use dunkelfeld_scene::{AlphaMode, Instance, Material, MeshPart, SceneBuilder};
use std::sync::Arc;

/// Changes one of the candidates. It keeps its name, so that other defects find it.
///
/// # Errors
/// If a candidate emits light, is a solid that shall fade, or has no extent.
pub(super) fn change(scene: &mut SceneBuilder, spec: &DefectSpec, stream: &mut Pcg) -> Result<PlacedDefect, Fault> {
    refuse_emitters(scene, &spec.on)?;
    let index = spec.on[draw::index(stream, spec.on.len())];
    let Some((normal, tangents)) = largest_side(scene, &scene.instances[index]) else {
        let problem = format!("the object \"{}\" has no extent", scene.instances[index].name);
        return Err(Fault::new(problem, "name an object with triangles").below("on"));
    };
    let mut angle = None;
    let parts = &scene.instances[index].meshes;
    let is_clear = parts.iter().all(|part| material::of(scene, *part).is_some_and(material::is_clear));
    match &spec.defect {
        Defect::Faded(Faded { strength }) => fade(scene, index, &spec.name, strength.map_or(1.0, |s| s.0))?,
        Defect::Shifted(Shifted { length, angle: given }) => {
            let direction = given.map_or_else(|| draw::angle(stream), |angle| angle.0);
            angle = Some(direction);
            let (sin, cos) = direction.sin_cos();
            scene.instances[index].to_world.translation += (tangents[0] * cos + tangents[1] * sin) * length.0;
        }
        _ => with_materials(scene, index, |m| material::absent(m, &spec.name)),
    }
    let on = scene.instances[index].name.clone();
    let [low, high] = scene.bounds_of(&scene.instances[index]).unwrap_or_default();
    let extent = extent_of(scene, &scene.instances[index]);
    Ok(PlacedDefect {
        object: spec.name.clone(),
        at: 0.5 * (low + high),
        normal,
        on,
        host: index,
        extent,
        angle,
        is_clear,
        replaces: None,
    })
}

/// The largest extent of an object in the world \[m\].
fn extent_of(scene: &SceneBuilder, instance: &Instance) -> f64 {
    let meshes = instance.meshes.iter().filter_map(|m| scene.meshes.get(*m)).map(|part| &part.mesh);
    let corners =
        meshes.flat_map(|mesh| mesh.triangles.iter().flatten().filter_map(|i| mesh.positions.get(*i as usize)));
    largest_distance(
        corners.map(|p| instance.to_world.transform_point3(p.as_dvec3())).filter(|p: &DVec3| p.is_finite()),
    )
}

/// Unit normal and two tangents of the largest side of the bounding box of an object, in the world. The box is that in
/// the space of the meshes. `None` without an extent.
fn largest_side(scene: &SceneBuilder, instance: &Instance) -> Option<(DVec3, [DVec3; 2])> {
    let meshes = instance.meshes.iter().filter_map(|m| scene.meshes.get(*m)).map(|part| &part.mesh);
    let used = meshes.flat_map(|mesh| mesh.triangles.iter().flatten().filter_map(|i| mesh.positions.get(*i as usize)));
    let finite = used.filter(|p| p.is_finite()).map(|p| p.as_dvec3());
    let (low, high) = finite.map(|p| (p, p)).reduce(|(a, b), (c, d)| (a.min(c), b.max(d)))?;
    let axes = [0, 1, 2].map(|k| instance.to_world.matrix3.col(k));
    let edges = [0, 1, 2].map(|k| axes[k].length() * (high[k] - low[k]));
    // The largest side is at right angles to the shortest edge.
    let thin = (0..3).reduce(|a, b| if edges[b] < edges[a] { b } else { a })?;
    let (first, second) = ((thin + 1) % 3, (thin + 2) % 3);
    let u = axes[first].try_normalize()?;
    let normal = axes[first].cross(axes[second]).try_normalize()?;
    (edges[first] > 0.0 || edges[second] > 0.0).then(|| (normal, [u, normal.cross(u)]))
}

fn fade(scene: &mut SceneBuilder, index: usize, name: &str, strength: f64) -> Result<(), Fault> {
    let instance = &scene.instances[index];
    let of = |part: &usize| material::of(scene, *part);
    if instance.meshes.iter().filter_map(of).any(|m| material::clear_volume(m).is_some()) {
        let problem = format!("the object \"{}\" is a clear solid, which cannot fade", instance.name);
        return Err(Fault::new(problem, "name a print, a label or an opaque object").below("on"));
    }
    let is_opaque = |m: &Material| m.alpha_mode == AlphaMode::Opaque;
    let opaque: Vec<bool> = instance.meshes.iter().map(|part| of(part).is_some_and(is_opaque)).collect();
    with_materials(scene, index, |m| material::faded(m, name, strength));
    // An opaque surface ignores the alpha of its vertex colours. From now on it counts.
    for (part, _) in scene.instances[index].meshes.clone().into_iter().zip(opaque).filter(|(_, opaque)| *opaque) {
        let Some(m) = scene.meshes.get_mut(part) else { continue };
        if m.mesh.colors.iter().any(|c| c.w != 1.0) {
            let colors = m.mesh.colors.iter().map(|c| c.truncate().extend(1.0)).collect();
            m.mesh = Arc::new(Mesh { colors, ..(*m.mesh).clone() });
        }
    }
    Ok(())
}

/// Gives an object materials of its own, made from its materials.
fn with_materials(scene: &mut SceneBuilder, index: usize, change: impl Fn(&Material) -> Material) {
    for k in 0..scene.instances[index].meshes.len() {
        let part = scene.instances[index].meshes[k];
        let Some(old) = material::of(scene, part) else { continue };
        let new = change(old);
        let new = scene.add_material(new);
        own_part(scene, index, part).material = new;
    }
}

/// A part that only this object uses: the part itself, or a copy, which shares the triangles.
pub(super) fn own_part(scene: &mut SceneBuilder, index: usize, part: usize) -> &mut MeshPart {
    let uses = scene.instances.iter().flat_map(|i| &i.meshes).filter(|m| **m == part).count();
    if uses <= 1 {
        return &mut scene.meshes[part];
    }
    let (copy, new) = (scene.meshes[part].clone(), scene.meshes.len());
    if let Some(own) = scene.instances[index].meshes.iter_mut().find(|m| **m == part) {
        *own = new;
    }
    scene.meshes.push(copy);
    &mut scene.meshes[new]
}
