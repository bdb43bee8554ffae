//! Checks for normals, tangents and texture coordinates that cannot be used, or that disagree with the surface.

use super::places::{place, push};
use crate::build::report::BuildReport;
use crate::scene::Scene;
use dunkelfeld_geometry::{Mesh, Vec2, geometric_normal};

/// Cosine of the angle between the geometric and the interpolated normal at which they start to disagree: 60 degrees.
const DISAGREE: f32 = 0.5;

pub(super) fn check(scene: &Scene, report: &mut BuildReport) {
    let (mut tilted, mut unusable, mut maps) = (Vec::new(), Vec::new(), Vec::new());
    let mut seen = vec![false; scene.meshes.len()];
    for part in &scene.parts {
        let mesh = &scene.meshes[part.mesh as usize];
        // A mesh is checked once, in its own space, for all of its instances.
        if std::mem::replace(&mut seen[part.mesh as usize], true) {
            continue;
        }
        let normals = Normals::from_mesh(mesh);
        if normals.disagreeing > 0 {
            tilted.push((
                place(scene, part),
                format!(
                    "has {} triangles whose shading normals differ by more than 60 degrees from the surface ({:.0} at most): light is lost there, and edges are dark; split the normals at sharp edges, or leave them out",
                    normals.disagreeing,
                    normals.min_cosine.clamp(-1.0, 1.0).acos().to_degrees()
                ),
            ));
        }
        if normals.unusable > 0 {
            unusable.push((
                place(scene, part),
                format!("has {} normals that are zero or not finite; these corners are shaded with the normals of the others; recompute the normals", normals.unusable),
            ));
        }
        let material = &scene.materials[part.material as usize];
        let called_for = match (&material.normal_map.texture, material.anisotropy.strength.factor != 0.0) {
            (Some(t), _) => Some(("a normal map", usize::from(t.uv_set & 1))),
            (None, true) => {
                Some(("anisotropy", material.anisotropy.strength.texture.map_or(0, |t| usize::from(t.uv_set & 1))))
            }
            (None, false) => None,
        };
        if let Some((what, set)) = called_for
            && let Some(trouble) = without_direction(mesh, set)
        {
            maps.push((
                place(scene, part),
                format!(
                    "has {what} (material \"{}\") but {trouble}; unwrap the mesh, or export tangents",
                    material.name
                ),
            ));
        }
    }
    [tilted, unusable, maps].into_iter().for_each(|findings| push(report, findings));
}

struct Normals {
    disagreeing: usize,
    min_cosine: f32,
    unusable: usize,
}

impl Normals {
    fn from_mesh(mesh: &Mesh) -> Self {
        let mut found = Self { disagreeing: 0, min_cosine: 1.0, unusable: 0 };
        if mesh.normals.is_empty() {
            return found;
        }
        found.unusable = mesh.normals.iter().filter(|n| n.try_normalize().is_none()).count();
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            let face = geometric_normal(&mesh.corners(t));
            let usable = triangle.iter().filter_map(|&i| mesh.normals[i as usize].try_normalize());
            // The code that uses a normal turns it to the correct side, so the sign is ignored here.
            let least = usable.map(|n| n.dot(face).abs()).fold(1.0, f32::min);
            found.disagreeing += usize::from(least < DISAGREE);
            found.min_cosine = found.min_cosine.min(least);
        }
        found
    }
}

/// The reason why a mesh does not define a texture direction, if it does not.
fn without_direction(mesh: &Mesh, set: usize) -> Option<String> {
    if !mesh.tangents.is_empty() {
        let bad = mesh
            .tangents
            .iter()
            .filter(|t| t.truncate().try_normalize().is_none() || t.w.is_nan() || t.w == 0.0)
            .count();
        return (bad > 0).then(|| format!("{bad} of its tangents are zero or not finite"));
    }
    let uvs = &mesh.uvs[set];
    if uvs.is_empty() {
        return Some("neither tangents nor texture coordinates, so the direction is arbitrary".into());
    }
    let flat = |t: &&[u32; 3]| {
        let [a, b, c] = t.map(|i| uvs[i as usize]);
        let area = (b - a).perp_dot(c - a);
        let extent = |p: Vec2, q: Vec2| (q - p).length_squared();
        // Coordinates on one line or in one point, up to rounding.
        let spans_an_area = area.abs() > 1e-6 * extent(a, b).max(extent(a, c));
        !spans_an_area
    };
    let bad = mesh.triangles.iter().filter(flat).count();
    (bad > 0).then(|| format!("{bad} of its triangles have texture coordinates on a line or in a point, so the direction is arbitrary there"))
}
