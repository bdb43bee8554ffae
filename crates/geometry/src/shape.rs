//! Sampling of rectangles and triangles as they are seen from a point: by solid angle, or by area where that is as good.
//!
//! Contract of every pair here. `sample_x(shape, reference, u)` takes two numbers in [0, 1) and gives a point on the shape
//! with its density per solid angle at the reference [1/sr], or `None` where the shape is seen edge-on, is degenerate
//! or subtends nothing: no light can be exchanged then. `pdf_x(shape, reference, point)` gives the density with which
//! `sample_x` returns `point`, bit for bit the same, and zero where `sample_x` returns `None`. Which of the two methods
//! is used depends on shape and reference alone. Both sides of a shape are seen. `invert_x(shape, reference, coordinates)` gives
//! the two numbers back.
//!
//! Inside, all is f64: the differences of angles that these formulas live on leave nothing of an f32.

mod rectangle;
mod triangle;

use glam::Vec3;

pub use rectangle::{
    Rectangle, RectangleSampler, invert_rectangle, pdf_rectangle, rectangle_from_triangles, rectangle_solid_angle,
    sample_rectangle,
};
pub use triangle::{
    invert_triangle, invert_triangle_area, pdf_triangle, pdf_triangle_area, sample_triangle, sample_triangle_area,
    triangle_solid_angle,
};

/// A point sampled on a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeSample {
    /// The point, on the shape up to rounding \[m\].
    pub point: Vec3,
    /// Where it lies on the shape: fractions of `edge_u` and `edge_v` of a rectangle, weights of the second and third
    /// corner of a triangle.
    pub coordinates: [f32; 2],
    /// Density per solid angle at the reference point [1/sr]; positive and finite.
    pub pdf: f32,
}

/// Below this solid angle \[sr\] points are sampled by area. A shape so small is far away (its density per solid angle is
/// then all but constant) or edge-on (it then gives next to no light), and f64 keeps nine digits above it.
const MIN_SOLID_ANGLE: f64 = 1e-6;

/// A reference nearer to the shape's plane than this fraction of its distance to the shape's corners lies in the plane.
const IN_PLANE: f64 = 1e-10;

/// Density per solid angle of a point that was sampled uniformly by area: `d^2 / (A cos) = d^3 / (A h)`, where h is the
/// distance of the reference from the shape's plane. Zero if that is no positive finite f32.
fn area_pdf(point: Vec3, reference: Vec3, area: f64, height: f64) -> f32 {
    let d2 = (point.as_dvec3() - reference.as_dvec3()).length_squared();
    let pdf = (d2 * d2.sqrt() / (area * height)) as f32;
    if pdf.is_finite() { pdf } else { 0.0 }
}
