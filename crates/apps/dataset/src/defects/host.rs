//! The surfaces of the candidates, and uniform points on them.

use super::draw;
use super::material::{self, is_absent};
use super::pieces::Pieces;
use super::spec::DefectSpec;
use super::surface::{corners_of, oriented_area};
use crate::distribution::Fault;
use dunkelfeld_geometry::DVec3;
use dunkelfeld_sampling::Pcg;
use dunkelfeld_scene::{Material, MeshPart, SceneBuilder};

/// Smallest cosine between a normal and the direction that it must face: 60 degrees.
const LEAST_COSINE: f64 = 0.5;

/// Largest cosine between the normals on both sides of a sharp edge: 20 degrees.
const SHARP: f64 = 0.94;

/// A drawn point of a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Anchor {
    /// Index into [`SceneBuilder::instances`].
    pub(super) instance: usize,
    /// Index into [`SceneBuilder::meshes`].
    pub(super) part: usize,
    /// Position in the world at time 0 \[m\].
    pub(super) point: DVec3,
    /// Unit normal of the triangle in the world; on an edge the mean of both.
    pub(super) normal: DVec3,
    /// Unit direction of the edge, for a point on an edge.
    pub(super) edge: Option<DVec3>,
}

/// The triangles of the candidates with their areas in the world.
pub(super) struct AreaTable {
    /// Instance, part and triangle.
    faces: Vec<[u32; 3]>,
    /// Sums of the areas \[m²\].
    cumulative: Vec<f64>,
}

impl AreaTable {
    /// All triangles of the candidates that face the direction and are present.
    ///
    /// # Errors
    /// If a candidate emits light, or if no triangle is left.
    pub(super) fn new(scene: &SceneBuilder, spec: &DefectSpec) -> Result<Self, Fault> {
        refuse_emitters(scene, &spec.on)?;
        let facing = spec.defect.facing();
        let (mut faces, mut cumulative, mut sum, mut seen) = (Vec::new(), Vec::new(), 0.0, false);
        for &index in &spec.on {
            let Some(instance) = scene.instances.get(index) else { continue };
            for &part in &instance.meshes {
                let Some(m) = scene.meshes.get(part) else { continue };
                if scene.materials.get(m.material).is_none_or(is_absent) {
                    continue;
                }
                for triangle in 0..m.mesh.triangles.len() {
                    let Some(corners) = corners_of(&m.mesh, triangle) else { continue };
                    let oriented = oriented_area(&instance.to_world, &corners);
                    let area = 0.5 * oriented.length();
                    if !(area > 0.0 && area.is_finite()) {
                        continue;
                    }
                    seen = true;
                    let faces_it = |f: DVec3| oriented.dot(f) >= LEAST_COSINE * oriented.length();
                    if facing.is_none_or(faces_it) {
                        sum += area;
                        faces.push([index as u32, part as u32, triangle as u32]);
                        cumulative.push(sum);
                    }
                }
            }
        }
        match (faces.is_empty(), seen) {
            (false, _) => Ok(Self { faces, cumulative }),
            (true, true) => Err(Fault::new(
                "no surface of the candidates faces the direction",
                "turn the objects, name other ones, or leave the direction out",
            )
            .below("facing")),
            (true, false) => {
                Err(Fault::new("the candidates have no surface", "name objects with triangles").below("on"))
            }
        }
    }

    /// A point that is uniform by area.
    pub(super) fn draw(&self, scene: &SceneBuilder, stream: &mut Pcg) -> Option<Anchor> {
        let face = draw::entry(stream, &self.cumulative);
        let (u, v) = (draw::uniform(stream), draw::uniform(stream));
        let [index, part, triangle] = self.faces.get(face)?.map(|i| i as usize);
        let instance = scene.instances.get(index)?;
        let corners = corners_of(&scene.meshes.get(part)?.mesh, triangle)?;
        let normal = oriented_area(&instance.to_world, &corners).try_normalize()?;
        let [a, b, c] = corners.map(|p| instance.to_world.transform_point3(p));
        // Uniform by area: Turk (1990).
        let root = u.sqrt();
        let point = a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v);
        Some(Anchor { instance: index, part, point, normal, edge: None })
    }
}

/// The sharp convex edges of the candidates with their lengths in the world.
pub(super) struct EdgeTable {
    /// The start of each edge, and its length \[m\].
    edges: Vec<(Anchor, f64)>,
    /// Sums of the lengths \[m\].
    cumulative: Vec<f64>,
}

impl EdgeTable {
    /// All edges of the candidates that face the direction.
    ///
    /// # Errors
    /// If a candidate emits light, or if no edge is left.
    pub(super) fn new(scene: &SceneBuilder, spec: &DefectSpec) -> Result<Self, Fault> {
        refuse_emitters(scene, &spec.on)?;
        let facing = spec.defect.facing();
        let (mut table, mut sum) = (Self { edges: Vec::new(), cumulative: Vec::new() }, 0.0);
        for (index, instance) in spec.on.iter().filter_map(|i| Some((*i, scene.instances.get(*i)?))) {
            for &part in &instance.meshes {
                let present = |m: &&MeshPart| scene.materials.get(m.material).is_some_and(|m| !is_absent(m));
                let Some(m) = scene.meshes.get(part).filter(present) else { continue };
                let pieces = Pieces::new(&m.mesh, &instance.to_world);
                for (point, way, normal) in pieces.convex_edges(SHARP) {
                    let Some(edge) = way.try_normalize() else { continue };
                    if facing.is_none_or(|f| normal.dot(f) >= LEAST_COSINE) {
                        sum += way.length();
                        table
                            .edges
                            .push((Anchor { instance: index, part, point, normal, edge: Some(edge) }, way.length()));
                        table.cumulative.push(sum);
                    }
                }
            }
        }
        let problem = "the candidates have no sharp convex edge that faces the direction";
        let help = "name objects with edges above 20 degrees between two triangles that share both corners";
        (!table.edges.is_empty()).then_some(table).ok_or_else(|| Fault::new(problem, help).below("on"))
    }

    /// A point that is uniform by length.
    pub(super) fn draw(&self, stream: &mut Pcg) -> Option<Anchor> {
        let (anchor, length) = self.edges.get(draw::entry(stream, &self.cumulative))?;
        let way = anchor.edge? * (draw::uniform(stream) * length);
        Some(Anchor { point: anchor.point + way, ..*anchor })
    }
}

/// True if a part of an object is present: with strength 1 a faded object is as absent as a missing one.
pub(crate) fn has_surface(scene: &SceneBuilder, index: usize) -> bool {
    let Some(instance) = scene.instances.get(index) else { return false };
    instance.meshes.iter().filter_map(|part| material::of(scene, *part)).any(|material| !is_absent(material))
}

/// # Errors
/// If a candidate emits light.
pub(super) fn refuse_emitters(scene: &SceneBuilder, on: &[usize]) -> Result<(), Fault> {
    for instance in on.iter().filter_map(|i| scene.instances.get(*i)) {
        if instance.meshes.iter().filter_map(|part| material::of(scene, *part)).any(Material::emits) {
            let problem = format!("the object \"{}\" emits light", instance.name);
            return Err(Fault::new(problem, "name only objects that emit no light").below("on"));
        }
    }
    Ok(())
}
