//! Sampling of rectangles and triangles from a reference point: by solid angle, or by area where that is as good.
//!
//! Contract of every pair here. `sample_x(shape, reference, u)` takes two numbers in [0, 1) and returns a point on the
//! shape with its density per solid angle at the reference [1/sr]. It returns `None` if the shape is edge-on to the
//! reference, is degenerate or subtends nothing. Then it exchanges no light with the reference. `pdf_x(shape,
//! reference, point)` returns the density with which `sample_x` returns `point`, bit for bit the same, and zero where
//! `sample_x` returns `None`. The choice between the two methods depends on shape and reference alone. Both sides of a
//! shape are sampled. `invert_x(shape, reference, coordinates)` returns the two numbers.
//!
//! All have several references at once. Triangles are computed in f64, because the differences of angles in these formulas
//! would cancel all digits of an f32. Rectangles have formulas for f32.

mod rectangle;
mod triangle;

use glam::Vec3;

pub use rectangle::{
    Rectangle, RectangleLanes, RectangleSampler, RectangleSamples, invert_rectangle, pdf_rectangle,
    rectangle_from_triangles, sample_rectangle,
};
pub use triangle::{
    TriangleLanes, invert_triangle, invert_triangle_area, pdf_triangle, pdf_triangle_area, sample_triangle,
    sample_triangle_area,
};

/// A point sampled on a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeSample {
    /// The point, on the shape up to rounding \[m\].
    pub point: Vec3,
    /// Its position on the shape: fractions of `edge_u` and `edge_v` of a rectangle, weights of the second and third
    /// corner of a triangle.
    pub coordinates: [f32; 2],
    /// Density per solid angle at the reference point [1/sr]; positive and finite.
    pub pdf: f32,
}

/// Below this solid angle \[sr\] points are sampled by area. A shape so small is far away or edge-on. If it is far
/// away, its density per solid angle is almost constant. If it is edge-on, it contributes almost no light. Above this
/// limit f64 keeps nine digits.
const MIN_SOLID_ANGLE: f64 = 1e-6;

/// A reference nearer to the shape's plane than this fraction of its distance to the shape's corners lies in the plane.
const IN_PLANE: f64 = 1e-10;
