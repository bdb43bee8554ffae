//! The poses of the objects of an image in the frame of the camera, as in BOP, and their models.

use crate::ids::ObjectLabel;
use crate::pinhole::{rows, world_to_camera};
use crate::record::InstanceRecord;
use dunkelfeld_geometry::{DAffine3, DMat3, DVec3, Mesh};
use serde::{Deserialize, Serialize};
use std::hash::Hasher;
use twox_hash::XxHash3_64;

/// Largest difference of an element of a matrix, without its scale, from that of the nearest rotation. Rotations with four
/// decimals are within it.
const TOLERANCE: f64 = 1e-3;

/// The pose of an object in the frame of the camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Pose {
    /// Id of the instance.
    pub(crate) instance: u16,
    /// Hash of the shape. Empty in a set without the files of BOP.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub(crate) shape: String,
    /// Rotation from the object to the camera, row by row.
    pub(crate) r: [f64; 9],
    /// Translation \[mm\].
    pub(crate) t: [f64; 3],
    /// Scale along the axes of the object, which a rotation does not contain.
    pub(crate) scale: [f64; 3],
}

/// The poses of the labelled objects in the film, without defects. The record of an object that is mirrored, sheared or flat
/// gets its matrix instead. `objects`, `labels` and `shapes` are by the index of the object; `shapes` may be empty.
pub(crate) fn poses(
    camera: DAffine3,
    objects: &[DAffine3],
    labels: &[Option<ObjectLabel>],
    shapes: &[u64],
    instances: &mut [InstanceRecord],
) -> Vec<Pose> {
    let mut poses = Vec::new();
    for (i, (to_world, label)) in objects.iter().zip(labels).enumerate() {
        let record = label.and_then(|label| instances.iter_mut().find(|record| record.id == label.instance));
        let Some(record) = record.filter(|record| record.defect.is_none()) else { continue };
        let to_camera = world_to_camera(camera) * *to_world;
        let t = (to_camera.translation * 1e3).to_array();
        let columns = [to_camera.matrix3.x_axis, to_camera.matrix3.y_axis, to_camera.matrix3.z_axis];
        let scale = columns.map(DVec3::length);
        match nearest_rotation(columns) {
            Some(rotation) => {
                let shape = shapes.get(i).map_or_else(String::new, |shape| format!("{shape:016x}"));
                poses.push(Pose { instance: record.id, shape, r: rows(rotation), t, scale });
            }
            None => {
                let [a, b, c, d, e, f, g, h, i] = rows(to_camera.matrix3).map(|v| v * 1e3);
                record.matrix = Some([a, b, c, t[0], d, e, f, t[1], g, h, i, t[2]]);
            }
        }
    }
    poses
}

/// The rotation next to a matrix without its scale, as far as [`TOLERANCE`] allows: the orthogonal factor of its polar
/// decomposition by Newton's iteration (Higham 1986), which squares the difference in each step.
fn nearest_rotation(columns: [DVec3; 3]) -> Option<DMat3> {
    const STEPS: usize = 5;
    let [x, y, z] = columns.map(DVec3::normalize_or_zero);
    let given = DMat3::from_cols(x, y, z);
    // The determinant is 1 of a rotation, and -1 of a mirrored one.
    if given.determinant() < 0.5 {
        return None;
    }
    let rotation = (0..STEPS).fold(given, |m, _| (m + m.inverse().transpose()) * 0.5);
    rotation.abs_diff_eq(given, TOLERANCE).then_some(rotation)
}

/// A hash of the shape of an object: the triangles of its meshes in its own frame.
pub(crate) fn shape<'a>(meshes: impl Iterator<Item = &'a Mesh>) -> u64 {
    let mut hash = XxHash3_64::new();
    for mesh in meshes {
        let corners = mesh.positions.iter().flat_map(|p| p.to_array());
        corners.for_each(|v| hash.write(&v.to_bits().to_le_bytes()));
        mesh.triangles.iter().flatten().for_each(|i| hash.write(&i.to_le_bytes()));
    }
    hash.finish()
}

impl Pose {
    /// Have two objects one model: the same shape, and the same scale within the error of rounded matrices?
    pub(crate) fn has_model_of(&self, other: &Self) -> bool {
        let is_near = |(a, b): (&f64, &f64)| (a / b - 1.0).abs() < 3.0 * TOLERANCE;
        self.shape == other.shape && self.scale.iter().zip(&other.scale).all(is_near)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rotation with few decimals is the rotation within their rounding, also with a scale; a shear of 1 % and a mirror are
    /// none.
    #[test]
    fn a_rounded_rotation_is_a_rotation() {
        let exact = DMat3::from_axis_angle(DVec3::new(1.0, -2.0, 0.5).normalize(), 2.0);
        for decimals in [1e3, 1e4, 1e5] {
            let rounded = rows(exact).map(|v| (v * decimals).round() / decimals);
            let column = |k: usize| DVec3::new(rounded[k], rounded[k + 3], rounded[k + 6]) * (k + 1) as f64;
            let found = nearest_rotation([column(0), column(1), column(2)]).expect("a rotation");
            assert!(found.abs_diff_eq(exact, 1.0 / decimals), "{found} {exact}");
            assert!((found * found.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-14));
        }
        let [x, y, z] = [exact.x_axis, exact.y_axis, exact.z_axis];
        assert_eq!(nearest_rotation([-x, y, z]), None);
        assert_eq!(nearest_rotation([x, y + 0.01 * x, z]), None);
        assert_eq!(nearest_rotation([x, y, DVec3::ZERO]), None);
    }
}
