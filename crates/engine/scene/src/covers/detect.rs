//! Detection of covers: solids that are clear, smooth sheets between light and object.
//!
//! A solid is a cover under two conditions. Its smooth faces within 30 degrees of a common axis, in both directions,
//! hold at least half of its surface. The mean distance between the two faces is at most half of its smaller extent
//! across the axis. The axis is the main direction of the surface normals: the principal eigenvector of `sum A n n^T`.
//! Holes, engravings, ribs and rims need no special treatment, because tracing decides if a chain of refractions
//! exists.

use super::scene_covers::{Covers, NO_COVER};
use super::slab_face::{self, Facing, Triangle};
use super::stack::{CoverInterface, CoverLayer, CoverStack, MAX_INTERFACES, TouchingSolid};
use crate::material::{Material, Surface};
use crate::media::medium::Medium;
use crate::media::nested_dielectrics::NO_SOLID;
use crate::scene::Scene;
use dunkelfeld_geometry::{DVec2, DVec3};
use std::collections::BTreeMap;

/// The two faces of a sheet hold at least this share of its surface.
const MIN_SHARE: f64 = 0.5;
/// The smaller of the two has at least this share of the larger one's area.
const MIN_BALANCE: f64 = 0.25;
/// A sheet is at most this thick, as a share of its smaller extent.
const MAX_THICKNESS: f64 = 0.5;
/// Cosine between the axes of two sheets of one stack.
const PARALLEL: f64 = 0.999;
/// Sheets of one stack overlap by at least this share of the smaller one.
const MIN_OVERLAP: f64 = 0.25;
/// Sheets of one stack overlap in height by at most this share of the thinner one. A glued sheet may be slightly
/// overlap_depth in.
const MAX_OVERLAP_DEPTH: f64 = 0.25;
/// Faces nearer to each other than this many roundings of the scene's coordinates are in contact.
const CONTACT: f64 = 16.0;
/// Maximum number of sheets; the largest are used. Each is compared with all stacks.
const MAX_SHEETS: usize = 4096;

/// A solid that is a cover.
struct Sheet {
    /// Its parts with smooth clear faces.
    parts: Vec<usize>,
    axis: DVec3,
    tangents: [DVec3; 2],
    ior: f64,
    material: u32,
    /// Area of its footprint.
    extent: f64,
    /// A sphere around its smooth clear faces \[m\].
    center: DVec3,
    radius: f64,
}

/// A sheet in its stack: lower and upper face along the axis of the stack.
struct Placed {
    sheet: Sheet,
    faces: [CoverInterface; 2],
    is_flat: bool,
}

/// Finds the covers of a compiled scene.
pub(crate) fn find(scene: &Scene) -> Covers {
    // The smooth clear parts of each solid, and the area of the others. The faces of a stack are at rest.
    let mut bodies: BTreeMap<u32, (Vec<usize>, f64)> = BTreeMap::new();
    let is_clear: Vec<bool> = (0..scene.materials.len()).map(|m| is_clear(scene, m)).collect();
    for (index, part) in scene.parts.iter().enumerate().filter(|(_, p)| p.solid != NO_SOLID && p.motion.is_none()) {
        let body = bodies.entry(part.solid).or_default();
        if is_clear[part.material as usize] {
            body.0.push(index);
        }
    }
    bodies.retain(|_, (parts, _)| !parts.is_empty());
    if bodies.is_empty() {
        return Covers::default();
    }
    for (index, part) in scene.parts.iter().enumerate() {
        if let Some((_, other)) = bodies.get_mut(&part.solid).filter(|(parts, _)| !parts.contains(&index)) {
            *other += slab_face::triangles(scene, &[index]).map(|t| t.area).sum::<f64>();
        }
    }
    let mut sheets: Vec<Sheet> =
        bodies.into_iter().filter_map(|(solid, (parts, other))| sheet(scene, solid, parts, other)).collect();
    sheets.sort_by(|a, b| b.extent.total_cmp(&a.extent));
    sheets.truncate(MAX_SHEETS);
    let mut stacks: Vec<Vec<Placed>> = Vec::new();
    for sheet in sheets {
        let home = stacks.iter_mut().find_map(|stack| Some((place(scene, &sheet, stack)?, stack)));
        match home {
            Some(((faces, is_flat), stack)) => stack.push(Placed { sheet, faces, is_flat }),
            None => {
                let measured = measure(scene, &sheet, sheet.axis, sheet.tangents);
                if let Some((faces, is_flat)) = measured.filter(|_| stacks.len() < usize::from(NO_COVER)) {
                    stacks.push(vec![Placed { sheet, faces, is_flat }]);
                }
            }
        }
    }
    let mut covers = Covers { of_part: vec![NO_COVER; scene.parts.len()], stacks: Vec::new() };
    for mut sheets in stacks {
        sheets.iter().flat_map(|p| &p.sheet.parts).for_each(|&p| covers.of_part[p] = covers.stacks.len() as u16);
        let (axis, tangents) = (sheets[0].sheet.axis, sheets[0].sheet.tangents);
        sheets.sort_by(|a, b| a.faces[0].height.total_cmp(&b.faces[0].height));
        covers.stacks.push(assemble(axis, tangents, sheets, CONTACT * rounding(scene)));
    }
    add_touching_solids(scene, &mut covers);
    if covers.stacks.is_empty() { Covers::default() } else { covers }
}

/// Registers solids with a smooth surface and a scattering medium that are in contact with a stack. Chains can start
/// inside them.
fn add_touching_solids(scene: &Scene, covers: &mut Covers) {
    let scattering_solids: Vec<bool> =
        (0..scene.materials.len()).map(|m| is_smooth(scene, m) && scatters(scene, m)).collect();
    let contact = CONTACT * rounding(scene);
    for stack in &mut covers.stacks {
        let (axis, tangents) = (stack.axis(), stack.tangents);
        let last = stack.interfaces().len() - 1;
        let faces = [(false, 0, 1), (true, last, last)]
            .map(|(is_above, face, layer)| (is_above, stack.interfaces()[face].clone(), stack.thickness(layer)));
        for (index, part) in scene.parts.iter().enumerate() {
            if !scattering_solids[part.material as usize] || part.solid == NO_SOLID {
                continue;
            }
            let Some(([low, high], footprint)) = slab_face::bounds(scene, &[index], axis, tangents) else { continue };
            for (is_above, face, thickness) in &faces {
                let overlap_depth = MAX_OVERLAP_DEPTH * thickness;
                let gap = if *is_above { low - face.height } else { face.height - high };
                let meets = gap <= contact && gap >= -overlap_depth && overlap(&footprint, &face.footprint) > 0.0;
                if meets {
                    let ior = f64::from(scene.solids[part.solid as usize].ior);
                    stack.touching.push(TouchingSolid { material: part.material, ior, is_above: *is_above });
                }
            }
        }
    }
}

fn scatters(scene: &Scene, material: usize) -> bool {
    matches!(&scene.materials[material].surface, Surface::Solid(volume) if Medium::new(volume).scatters())
}

/// True if light passes the surface of a material everywhere in single directions, and the inside without scattering.
fn is_clear(scene: &Scene, material: usize) -> bool {
    is_smooth(scene, material) && !scatters(scene, material) && scene.materials[material].ior != 1.0
}

/// True if light passes the surface of a material everywhere in single directions.
fn is_smooth(scene: &Scene, material: usize) -> bool {
    let (m, compiled): (&Material, _) = (&scene.materials[material], &scene.compiled[material]);
    let is_even = m.is_smooth() && m.normal_map.texture.is_none();
    let is_full = m.transmission.factor >= 1.0 && m.transmission.texture.is_none() && m.metallic.factor <= 0.0;
    let is_there = !compiled.has_coverage && !compiled.emits;
    compiled.is_solid && is_even && is_full && is_there
}

/// Largest rounding error of a coordinate of the scene \[m\].
fn rounding(scene: &Scene) -> f64 {
    f64::from(scene.radius) * f64::from(f32::EPSILON)
}

/// The solid as a sheet, if it is a cover.
fn sheet(scene: &Scene, solid: u32, parts: Vec<usize>, other_area: f64) -> Option<Sheet> {
    let triangles = || slab_face::triangles(scene, &parts);
    let axis = slab_face::axis(triangles)?;
    let mut area = [0.0; 2];
    let mut total = other_area;
    for t in triangles() {
        total += t.area;
        match t.facing(axis) {
            Facing::Along => area[1] += t.area,
            Facing::Against => area[0] += t.area,
            Facing::Aside => {}
        }
    }
    let (less, more) = (area[0].min(area[1]), area[0].max(area[1]));
    if less + more < MIN_SHARE * total || less < MIN_BALANCE * more {
        return None;
    }
    let tangents = slab_face::tangents(triangles, axis);
    let body = &scene.solids[solid as usize];
    let (low, high) = triangles().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), t| {
        t.corners().iter().fold((low, high), |(low, high), p| (low.min(*p), high.max(*p)))
    });
    let (center, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
    let (ior, material) = (f64::from(body.ior), body.material);
    let mut sheet = Sheet { axis, tangents, ior, material, extent: 0.0, center, radius, parts };
    let (faces, _) = measure(scene, &sheet, axis, tangents)?;
    let thickness = faces[1].height - faces[0].height;
    let [low, high] = union(&faces[0], &faces[1]);
    let size = high - low;
    sheet.extent = size.x * size.y;
    let is_thin = thickness > 0.0 && thickness <= MAX_THICKNESS * size.min_element();
    is_thin.then_some(sheet)
}

/// The lower and the upper face of a sheet along an axis, and whether they are planes across it.
fn measure(scene: &Scene, sheet: &Sheet, axis: DVec3, tangents: [DVec3; 2]) -> Option<([CoverInterface; 2], bool)> {
    let side = |facing| {
        let own: Vec<Triangle> =
            slab_face::triangles(scene, &sheet.parts).filter(|t| t.facing(axis) == facing).collect();
        slab_face::measure(&own, axis, tangents, rounding(scene))
    };
    let (low, high) = (side(Facing::Against)?, side(Facing::Along)?);
    let is_flat = low.1 && high.1;
    Some(([low.0, high.0], is_flat))
}

/// The faces of a sheet in a stack that it fits into. It fits if it is parallel to the stack, and above or below each
/// of its sheets.
fn place(scene: &Scene, sheet: &Sheet, stack: &[Placed]) -> Option<([CoverInterface; 2], bool)> {
    let first = &stack.first()?.sheet;
    if sheet.axis.dot(first.axis).abs() < PARALLEL || 2 * (stack.len() + 1) > MAX_INTERFACES {
        return None;
    }
    // A cheap test before all triangles are read: do the bounding spheres overlap in the projection along the axis?
    let is_beside = stack.iter().any(|other| {
        let way = sheet.center - other.sheet.center;
        let across = way - first.axis * first.axis.dot(way);
        across.length() > sheet.radius + other.sheet.radius
    });
    if is_beside {
        return None;
    }
    let (faces, is_flat) = measure(scene, sheet, first.axis, first.tangents)?;
    let thickness = |f: &[CoverInterface; 2]| f[1].height - f[0].height;
    let fits = stack.iter().all(|other| {
        let overlap_depth = MAX_OVERLAP_DEPTH * thickness(&faces).min(thickness(&other.faces));
        let is_apart = faces[0].height >= other.faces[1].height - overlap_depth
            || faces[1].height <= other.faces[0].height + overlap_depth;
        is_apart && overlap(&union(&faces[0], &faces[1]), &union(&other.faces[0], &other.faces[1])) >= MIN_OVERLAP
    });
    fits.then_some((faces, is_flat))
}

/// The footprint of both faces.
fn union(a: &CoverInterface, b: &CoverInterface) -> [DVec2; 2] {
    let [a, b] = [a.footprint, b.footprint];
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// Overlap of two footprints as a share of the smaller one.
fn overlap(a: &[DVec2; 2], b: &[DVec2; 2]) -> f64 {
    let area = |size: DVec2| size.x * size.y;
    let shared = (a[1].min(b[1]) - a[0].max(b[0])).max(DVec2::ZERO);
    area(shared) / area(a[1] - a[0]).min(area(b[1] - b[0]))
}

/// Converts sheets in ascending order to interfaces and layers. Faces in contact form one interface. They form none if
/// the index of refraction is the same on both sides.
fn assemble(axis: DVec3, tangents: [DVec3; 2], sheets: Vec<Placed>, contact: f64) -> CoverStack {
    let air = || CoverLayer { ior: 1.0, materials: Vec::new() };
    let (mut interfaces, mut layers): (Vec<CoverInterface>, Vec<CoverLayer>) = (Vec::new(), vec![air()]);
    let mut is_flat = true;
    for placed in sheets {
        is_flat &= placed.is_flat;
        let [low, high] = placed.faces;
        let own = CoverLayer { ior: placed.sheet.ior, materials: vec![placed.sheet.material] };
        let touches = interfaces.last().is_some_and(|below| low.height - below.height <= contact);
        if touches {
            // Removes the air layer above the sheet below, because the two sheets are in contact.
            layers.pop();
            if layers.last().is_some_and(|below| below.ior == own.ior) {
                interfaces.pop();
                if let Some(below) = layers.last_mut() {
                    below.materials.extend(own.materials);
                }
            } else {
                if let Some(shared) = interfaces.last_mut() {
                    *shared = merged(shared, &low);
                }
                layers.push(own);
            }
        } else {
            interfaces.push(low);
            layers.push(own);
        }
        interfaces.push(high);
        layers.push(air());
    }
    CoverStack::new(axis, tangents, interfaces, layers, is_flat)
}

/// Merges two faces in contact.
fn merged(a: &CoverInterface, b: &CoverInterface) -> CoverInterface {
    let height = 0.5 * (a.height + b.height);
    CoverInterface {
        height,
        deviation: a.deviation.max(b.deviation) + (a.height - height).abs(),
        footprint: union(a, b),
    }
}
