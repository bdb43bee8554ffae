//! The camera of an image, in the frames of OpenCV and BOP.

use dunkelfeld_geometry::{DAffine3, DMat3, DVec3};
use dunkelfeld_scene::{Camera, Projection, Shutter};
use serde::{Deserialize, Serialize};

/// A camera without its lens errors. The frame of the camera has x to the right, y down and z forward.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Pinhole {
    /// Camera matrix \[pixels\], row by row; the middle of the first pixel is (0, 0).
    pub(crate) k: [f64; 9],
    /// Coefficients of OpenCV: k1, k2, p1, p2, k3, k4, k5, k6.
    pub(crate) distortion: [f64; 8],
    /// Rotation from the world to the camera, row by row.
    pub(crate) r: [f64; 9],
    /// Translation from the world to the camera \[mm\].
    pub(crate) t: [f64; 3],
}

impl Pinhole {
    /// The camera of an image of `width` x `height` pixels; `None` for a telecentric lens and for a line scan, which have
    /// no such matrix. The rows of a line scan are of different times, all through one row of the lens.
    pub(crate) fn new(camera: &Camera, shutter: Option<&Shutter>, [width, height]: [u32; 2]) -> Option<Self> {
        if matches!(shutter, Some(Shutter::Lines(_))) {
            return None;
        }
        let Projection::Perspective { vertical_fov } = camera.projection else { return None };
        let (whole, origin, step) =
            camera.window.map_or(([width, height], [0.0; 2], 1.0), |window| (window.full, window.origin, window.step));
        let [w, h] = whole.map(f64::from);
        let fy = 0.5 * h / (0.5 * f64::from(vertical_fov)).tan();
        let fx = fy / camera.lens.pixel_aspect;
        let [px, py] = camera.lens.principal_point;
        // In the whole film the optical axis is at this distance from its left and upper edge.
        let (x, y) = (0.5 * w + px, 0.5 * h + py);
        let (cx, cy) = ((x - origin[0]) / step - 0.5, (y - origin[1]) / step - 0.5);
        let to_camera = world_to_camera(camera.to_world);
        let [k1, k2, k3, k4, k5, k6] = camera.lens.distortion.radial;
        let [p1, p2] = camera.lens.distortion.tangential;
        Some(Self {
            k: [fx / step, 0.0, cx, 0.0, fy / step, cy, 0.0, 0.0, 1.0],
            distortion: [k1, k2, p1, p2, k3, k4, k5, k6],
            r: rows(to_camera.matrix3),
            t: (to_camera.translation * 1e3).to_array(),
        })
    }
}

/// A box of pixels that contains the image of a box of the world, with a margin for clear covers: left, top, right, bottom.
/// `None` if it is not known: for a line scan, a telecentric or distorting lens, and a box that reaches behind the camera.
pub(crate) fn image_box(
    camera: &Camera,
    shutter: Option<&Shutter>,
    size: [u32; 2],
    [low, high]: [DVec3; 2],
) -> Option<[u32; 4]> {
    /// Pixels beside the share of the film by which a cover of a few millimetres moves a point.
    const MARGIN: f64 = 4.0;
    const SHARE: f64 = 0.01;
    let pinhole = Pinhole::new(camera, shutter, size).filter(|pinhole| pinhole.distortion == [0.0; 8])?;
    let to_camera = world_to_camera(camera.to_world);
    let mut bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for corner in 0..8 {
        let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
        let point = to_camera.transform_point3(DVec3::new(pick(0), pick(1), pick(2)));
        if point.z <= 0.0 {
            return None;
        }
        let x = pinhole.k[0] * point.x / point.z + pinhole.k[2] + 0.5;
        let y = pinhole.k[4] * point.y / point.z + pinhole.k[5] + 0.5;
        bounds = [bounds[0].min(x), bounds[1].min(y), bounds[2].max(x), bounds[3].max(y)];
    }
    let [width, height] = size.map(f64::from);
    let margin = MARGIN + SHARE * width.max(height);
    let [left, top, right, bottom] = bounds;
    Some([
        (left - margin).clamp(0.0, width) as u32,
        (top - margin).clamp(0.0, height) as u32,
        (right + margin).ceil().clamp(0.0, width) as u32,
        (bottom + margin).ceil().clamp(0.0, height) as u32,
    ])
}

/// The transform from the world to the frame of a camera, without scale.
pub(crate) fn world_to_camera(to_world: DAffine3) -> DAffine3 {
    let axes = to_world.matrix3;
    let turned = DMat3::from_cols(
        axes.x_axis.normalize_or_zero(),
        -axes.y_axis.normalize_or_zero(),
        -axes.z_axis.normalize_or_zero(),
    );
    let rotation = turned.transpose();
    DAffine3 { matrix3: rotation, translation: -(rotation * to_world.translation) }
}

/// The elements of a matrix row by row.
pub(crate) fn rows(m: DMat3) -> [f64; 9] {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    [x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z]
}
