//! Checks for objects that are twice in one place: the same meshes, or other meshes with the same triangles.

use super::places::push;
use crate::build::bake::PlacedObject;
use crate::build::builder::MeshPart;
use crate::build::report::BuildReport;
use dunkelfeld_geometry::DVec3;
use std::collections::{BTreeMap, HashMap};

/// Two shapes are equal within this share of their size.
const SAME: f64 = 1e-5;
/// Coordinates are rounded by this share: a step of f32, twice.
const ROUNDING: f64 = 2.0 * f32::EPSILON as f64;
/// Maximum number of triangles of objects that are measured, and of pairs of objects that are compared. The remaining
/// objects are not checked.
const MAX_TRIANGLES: usize = 4_000_000;
const MAX_PAIRS: usize = 1 << 20;

/// Reports objects that lie in the same place as an earlier one with the same meshes, or with the same shape.
pub(crate) fn twins(
    placed: &[PlacedObject],
    meshes: &[MeshPart],
    shapes_of: &mut dyn FnMut(&[&PlacedObject]) -> Vec<Shape>,
    report: &mut BuildReport,
) {
    let mut known: HashMap<(&[usize], [u32; 12]), usize> = HashMap::new();
    let mut found: BTreeMap<usize, usize> = BTreeMap::new();
    // Objects by their number of triangles.
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, (_, instance, transform)) in placed.iter().enumerate() {
        let triangles: usize = instance.meshes.iter().map(|&m| meshes[m].mesh.triangles.len()).sum();
        if triangles == 0 {
            continue;
        }
        let key = transform.to_world().to_cols_array().map(|v| (v as f32 + 0.0).to_bits());
        if let Some(first) = known.get(&(instance.meshes.as_slice(), key)) {
            found.insert(i, *first);
        } else {
            known.insert((&instance.meshes, key), i);
            groups.entry(triangles).or_default().push(i);
        }
    }
    let (mut triangles, mut pairs) = (MAX_TRIANGLES, MAX_PAIRS);
    for (count, group) in groups {
        // Copies of the same meshes are in other places.
        let first_meshes = group.first().map(|i| &placed[*i].1.meshes);
        if group.iter().all(|i| Some(&placed[*i].1.meshes) == first_meshes) {
            continue;
        }
        let most = triangles / count;
        triangles -= count * group.len().min(most);
        let measured: Vec<&PlacedObject> = group.iter().take(most).map(|i| &placed[*i]).collect();
        let mut shapes: Vec<(Shape, usize)> = shapes_of(&measured).into_iter().zip(group).collect();
        shapes.sort_by(|(a, i), (b, j)| a.low.x.total_cmp(&b.low.x).then(i.cmp(j)));
        for (k, (shape, i)) in shapes.iter().enumerate() {
            let tolerance = shape.tolerance();
            for (other, j) in shapes[k + 1..].iter().take_while(|(other, _)| other.low.x - shape.low.x <= tolerance) {
                if pairs == 0 {
                    break;
                }
                pairs -= 1;
                if shape.is_equal(other, tolerance) {
                    found.entry(*i.max(j)).or_insert(*i.min(j));
                }
            }
        }
    }
    let finding = |(copy, first): (usize, usize)| {
        let name = |i: usize| &placed[i].1.name;
        (
            format!("object \"{}\"", name(copy)),
            format!(
                "is a copy of object \"{}\" in the same place: both reflect light, and a label image contains one of the two; remove one of them, for example by `[[object]]` with `visible = false`",
                name(first)
            ),
        )
    };
    push(report, found.into_iter().map(finding).collect());
}

/// The shape of an object in world space, independent of the order of its triangles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    low: DVec3,
    high: DVec3,
    /// Mean of the centres of the triangles.
    mean: DVec3,
    /// Root of the mean squared distance of these centres from the mean.
    spread: f64,
    /// Sum of the areas of the triangles, as vectors along their normals \[m^2\]. A sheet and its back differ.
    area: DVec3,
}

impl Shape {
    /// Measures an object.
    pub(crate) fn of((_, instance, transform): &PlacedObject, meshes: &[MeshPart]) -> Self {
        let triangles = || {
            instance.meshes.iter().flat_map(|&m| {
                let mesh = &meshes[m].mesh;
                mesh.triangles
                    .iter()
                    .map(|t| t.map(|i| transform.to_world().transform_point3(mesh.positions[i as usize].as_dvec3())))
            })
        };
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut sum, mut area, mut count) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for [a, b, c] in triangles() {
            (low, high) = (low.min(a.min(b).min(c)), high.max(a.max(b).max(c)));
            sum += (a + b + c) / 3.0;
            area += 0.5 * (b - a).cross(c - a);
            count += 1.0;
        }
        let mean = sum / count;
        let squares: f64 = triangles().map(|[a, b, c]| ((a + b + c) / 3.0).distance_squared(mean)).sum();
        Self { low, high, mean, spread: (squares / count).sqrt(), area }
    }

    fn size(&self) -> f64 {
        (self.high - self.low).max_element()
    }

    /// Difference of equal places \[m\].
    fn tolerance(&self) -> f64 {
        SAME * self.size() + ROUNDING * self.low.abs().max(self.high.abs()).max_element()
    }

    fn is_equal(&self, other: &Self, tolerance: f64) -> bool {
        let points = [(self.low, other.low), (self.high, other.high), (self.mean, other.mean)];
        points.iter().all(|(a, b)| (*a - *b).abs().max_element() <= tolerance)
            && (self.spread - other.spread).abs() <= tolerance
            && (self.area - other.area).abs().max_element() <= 10.0 * tolerance * self.size()
    }
}
