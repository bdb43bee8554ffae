//! Rectangles: solid angle, sampling by solid angle, and their detection in pairs of triangles.
//!
//! Single precision is enough under three conditions. The rectangle is sampled along its short edge first, because along
//! the long one the roots are differences of almost equal numbers. No formula subtracts angles or cosines that are almost
//! equal. The same formulas in double precision are used if a reference is near the plane.

mod view;

use super::ShapeSample;
use dunkelfeld_lanes::{Double, Lanes, MAX_WIDTH, Mask, Real, V3};
use glam::Vec3;
use view::{DOUBLE, NearView, SINGLE, View};

/// A flat rectangle: `corner + u edge_u + v edge_v` for u and v in [0, 1].
///
/// The edges are perpendicular (within the tolerance of [`rectangle_from_triangles`]).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Rectangle {
    /// One corner \[m\].
    pub corner: Vec3,
    /// The edge from the corner along u \[m\].
    pub edge_u: Vec3,
    /// The edge from the corner along v \[m\].
    pub edge_v: Vec3,
}

impl Rectangle {
    /// Area [m^2].
    pub fn area(&self) -> f32 {
        (self.edge_u.as_dvec3().length() * self.edge_v.as_dvec3().length()) as f32
    }

    /// Unit normal `edge_u x edge_v`; zero if the rectangle has no area.
    pub fn normal(&self) -> Vec3 {
        self.edge_u.as_dvec3().cross(self.edge_v.as_dvec3()).normalize_or_zero().as_vec3()
    }

    /// The point at fractions `u` and `v` of the edges.
    pub fn point(&self, u: f32, v: f32) -> Vec3 {
        (self.corner.as_dvec3() + f64::from(u) * self.edge_u.as_dvec3() + f64::from(v) * self.edge_v.as_dvec3())
            .as_vec3()
    }
}

/// Samples a rectangle from `reference`: uniformly by solid angle, or by area if it is far away, below 1e-6 sr or
/// almost edge-on.
pub fn sample_rectangle(rectangle: &Rectangle, reference: Vec3, u: [f32; 2]) -> Option<ShapeSample> {
    RectangleSampler::new(rectangle).sample(reference, u)
}

/// Density per solid angle [1/sr] with which [`sample_rectangle`] returns `point`, a point on the rectangle.
pub fn pdf_rectangle(rectangle: &Rectangle, reference: Vec3, point: Vec3) -> f32 {
    RectangleSampler::new(rectangle).pdf(reference, point)
}

/// A rectangle with precomputed values that do not depend on the reference.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct RectangleSampler {
    rectangle: Rectangle,
    /// True if `edge_v` is the shorter edge. It is sampled first then.
    is_turned: bool,
    /// Unit vectors along the short and the long edge, and perpendicular to them.
    axes: [Vec3; 3],
    /// Lengths of the short and of the long edge.
    size: [f32; 2],
}

impl RectangleSampler {
    /// Precomputes the values. A rectangle without area is valid: it is never sampled.
    pub fn new(rectangle: &Rectangle) -> Self {
        let is_turned = rectangle.edge_v.length_squared() < rectangle.edge_u.length_squared();
        let unset = Self { rectangle: *rectangle, is_turned, axes: [Vec3::ZERO; 3], size: [0.0; 2] };
        let (axes, size) = axes(unset.edges().map(|edge| V3::from(edge).widen()));
        Self { axes: axes.map(|axis| V3::<f32>::narrow(axis).into()), size: size.map(|length| length as f32), ..unset }
    }

    /// The short and the long edge.
    #[inline(always)]
    fn edges(&self) -> [Vec3; 2] {
        let Rectangle { edge_u, edge_v, .. } = self.rectangle;
        if self.is_turned { [edge_v, edge_u] } else { [edge_u, edge_v] }
    }

    /// The rectangle itself.
    pub fn rectangle(&self) -> &Rectangle {
        &self.rectangle
    }

    /// See [`sample_rectangle`].
    pub fn sample(&self, reference: Vec3, u: [f32; 2]) -> Option<ShapeSample> {
        let sample = RectangleLanes::<f32>::splat((), self).sample(reference.into(), u);
        let [x, y] = [0, 1].map(|axis| (sample.place[axis] / self.size[axis]).clamp(0.0, 1.0));
        let coordinates = if self.is_turned { [y, x] } else { [x, y] };
        (sample.pdf > 0.0).then_some(ShapeSample { point: sample.point.into(), coordinates, pdf: sample.pdf })
    }

    /// See [`pdf_rectangle`].
    pub fn pdf(&self, reference: Vec3, point: Vec3) -> f32 {
        RectangleLanes::<f32>::splat((), self).pdf(reference.into(), point.into())
    }
}

/// The random numbers for which [`sample_rectangle`] returns the point at these fractions of the edges; `None` where it
/// returns nothing.
pub fn invert_rectangle(rectangle: &Rectangle, reference: Vec3, [u, v]: [f32; 2]) -> Option<[f32; 2]> {
    let sampler = RectangleSampler::new(rectangle);
    let coordinates = if sampler.is_turned { [v, u] } else { [u, v] };
    let rectangle = RectangleLanes::<f32>::splat((), &sampler);
    let view = rectangle.view(reference.into(), None);
    if view.is_by_solid_angle {
        let (corner, size) = rectangle.in_double_precision(reference.into());
        let u = NearView::new(corner, size).invert(coordinates.map(f64::from));
        Some(u.map(|u| (u as f32).clamp(0.0, 1.0)))
    } else {
        (view.volume > 0.0).then_some(coordinates)
    }
}

/// Unit vectors along two perpendicular edges and perpendicular to both, and the lengths of the edges.
#[inline(always)]
fn axes<N: Real>([short, long]: [V3<N>; 2]) -> ([V3<N>; 3], [N; 2]) {
    let size = [short.length(), long.length()];
    let (x, y) = (short * size[0].recip(), long * size[1].recip());
    ([x, y, x.cross(y)], size)
}

/// A rectangle per lane.
#[derive(Clone, Copy, Debug)]
pub struct RectangleLanes<'a, F> {
    sources: Sources<'a>,
    corner: V3<F>,
    axes: [V3<F>; 3],
    size: [F; 2],
}

/// The rectangles of the lanes, for double precision.
#[derive(Clone, Copy, Debug)]
enum Sources<'a> {
    Same(&'a RectangleSampler),
    Each([&'a RectangleSampler; MAX_WIDTH]),
}

/// A point on a rectangle per lane.
#[derive(Clone, Copy, Debug)]
pub struct RectangleSamples<F> {
    /// The point \[m\].
    pub point: V3<F>,
    /// Density per solid angle at the reference point [1/sr]. Zero where there is no sample.
    pub pdf: F,
    /// Distances from the corner along the short and the long edge \[m\].
    place: [F; 2],
}

impl<'a, F: Lanes> RectangleLanes<'a, F> {
    /// The same rectangle in all lanes.
    #[inline(always)]
    pub fn splat(token: F::Token, rectangle: &'a RectangleSampler) -> Self {
        let [x, y, z] = rectangle.axes;
        Self {
            sources: Sources::Same(rectangle),
            corner: V3::splat(token, rectangle.rectangle.corner),
            axes: [V3::splat(token, x), V3::splat(token, y), V3::splat(token, z)],
            size: [F::splat(token, rectangle.size[0]), F::splat(token, rectangle.size[1])],
        }
    }

    /// The rectangle of each lane. Those beyond the last lane are not used.
    #[inline(always)]
    pub fn gather(token: F::Token, rectangles: [&'a RectangleSampler; MAX_WIDTH]) -> Self {
        let mut rows = [[0.0; MAX_WIDTH]; 14];
        for lane in 0..F::WIDTH {
            let r = rectangles[lane];
            let (c, [x, y, z]) = (r.rectangle.corner, r.axes);
            let values = [c.x, c.y, c.z, x.x, x.y, x.z, y.x, y.y, y.z, z.x, z.y, z.z, r.size[0], r.size[1]];
            for k in 0..14 {
                rows[k][lane] = values[k];
            }
        }
        let mut of = [F::splat(token, 0.0); 14];
        for k in 0..14 {
            of[k] = F::load(token, &rows[k]);
        }
        let axes = [V3::new(of[3], of[4], of[5]), V3::new(of[6], of[7], of[8]), V3::new(of[9], of[10], of[11])];
        let (corner, size) = (V3::new(of[0], of[1], of[2]), [of[12], of[13]]);
        Self { sources: Sources::Each(rectangles), corner, axes, size }
    }

    /// See [`sample_rectangle`].
    #[inline(always)]
    pub fn sample(&self, reference: V3<F>, u: [F; 2]) -> RectangleSamples<F> {
        let view = self.view(reference, Some(u));
        let [x, y] = view.place;
        let point = self.corner + self.axes[0] * x + self.axes[1] * y;
        RectangleSamples { point, pdf: view.pdf(point, reference), place: view.place }
    }

    /// See [`pdf_rectangle`].
    #[inline(always)]
    pub fn pdf(&self, reference: V3<F>, point: V3<F>) -> F {
        self.view(reference, None).pdf(point, reference)
    }

    #[inline(always)]
    fn view(&self, reference: V3<F>, u: Option<[F; 2]>) -> View<F> {
        let to_corner = self.corner - reference;
        let corner = [to_corner.dot(self.axes[0]), to_corner.dot(self.axes[1]), to_corner.dot(self.axes[2])];
        let (view, is_clear) = View::new(corner, self.size, u, &SINGLE);
        if (!is_clear).any() { self.replace_by_exact(view, reference, u, !is_clear) } else { view }
    }

    /// The view in double precision in the lanes of a mask. Few calls need it, so their code lies apart.
    #[inline(never)]
    fn replace_by_exact(&self, view: View<F>, reference: V3<F>, u: Option<[F; 2]>, lanes: F::Mask) -> View<F> {
        F::vectorize(
            reference.x.token(),
            #[inline(always)]
            || {
                let (corner, size) = self.in_double_precision(reference);
                let u = u.map(
                    #[inline(always)]
                    |[u, v]| [F::Double::widen(u), F::Double::widen(v)],
                );
                let (exact, is_seen) = View::new(corner, size, u, &DOUBLE);
                let is_by_solid_angle = F::Double::narrow_mask(exact.is_by_solid_angle);
                View {
                    is_by_solid_angle: (is_by_solid_angle & lanes) | (view.is_by_solid_angle & !lanes),
                    inverse_solid_angle: lanes.select(exact.inverse_solid_angle.narrow(), view.inverse_solid_angle),
                    volume: lanes.select(exact.volume.only(is_seen).narrow(), view.volume),
                    place: [
                        lanes.select(exact.place[0].narrow(), view.place[0]),
                        lanes.select(exact.place[1].narrow(), view.place[1]),
                    ],
                }
            },
        )
    }

    /// The first corner in coordinates of the reference and the axes, and the lengths of the edges, in double precision.
    /// They are rarely needed, so the axes are not stored.
    #[inline(always)]
    fn in_double_precision(&self, reference: V3<F>) -> ([F::Double; 3], [F::Double; 2]) {
        let token = reference.x.token();
        let (axes, size) = match &self.sources {
            Sources::Same(one) => {
                let [short, long] = one.edges();
                let ([x, y, z], [width, length]) = axes([V3::from(short).widen(), V3::from(long).widen()]);
                let axes =
                    [V3::<F>::splat_double(token, x), V3::<F>::splat_double(token, y), V3::<F>::splat_double(token, z)];
                (axes, [F::Double::splat(token, width), F::Double::splat(token, length)])
            }
            Sources::Each(all) => {
                let [mut short, mut long] = [[Vec3::ZERO; MAX_WIDTH]; 2];
                for lane in 0..F::WIDTH {
                    [short[lane], long[lane]] = all[lane].edges();
                }
                axes([V3::<F>::from_lanes(token, &short).widen(), V3::<F>::from_lanes(token, &long).widen()])
            }
        };
        let to_corner = self.corner.widen() - reference.widen();
        ([to_corner.dot(axes[0]), to_corner.dot(axes[1]), to_corner.dot(axes[2])], size)
    }
}

/// Relative tolerance of [`rectangle_from_triangles`], as a fraction of the diagonal.
const RECTANGLE_TOLERANCE: f64 = 1e-5;

/// The rectangle that two triangles form together, if they do.
///
/// They must share two corners exactly (the diagonal), wind the same way, and their other two corners must complete a
/// rectangle: no corner off by more than 1e-5 of the diagonal plus two ulps of the largest coordinate, and no angle off
/// by more than the same in radians. The normal of the rectangle is that of the triangles.
pub fn rectangle_from_triangles(first: [Vec3; 3], second: [Vec3; 3]) -> Option<Rectangle> {
    // The corner of the first triangle that is not on the diagonal, then the diagonal in winding order.
    let apex = (0..3).find(|&i| !second.contains(&first[i]))?;
    let [p, a, b] = [first[apex], first[(apex + 1) % 3], first[(apex + 2) % 3]];
    let far = (0..3).find(|&i| !first.contains(&second[i]))?;
    // With equal winding, the second triangle has the diagonal in the opposite direction.
    if [second[(far + 1) % 3], second[(far + 2) % 3]] != [b, a] {
        return None;
    }
    let [dp, da, db, dq] = [p, a, b, second[far]].map(|v| v.as_dvec3());
    let (u, v) = (da - dp, db - dp);
    let diagonal = (db - da).length();
    let largest = [p, a, b, second[far]].iter().map(|v| v.abs().max_element()).fold(0.0, f32::max);
    let slack = RECTANGLE_TOLERANCE * diagonal + 2.0 * f64::from(f32::EPSILON * largest);
    let closes = (dp + u + v - dq).length() <= slack;
    let square = u.dot(v).abs() <= u.length() * v.length() * (slack / u.length().min(v.length()));
    let has_area = u.length() > slack && v.length() > slack;
    (closes && square && has_area).then_some(Rectangle { corner: p, edge_u: a - p, edge_v: b - p })
}

#[cfg(test)]
mod tests {
    use super::super::IN_PLANE;
    use super::super::triangle::tests::triangle_solid_angle;
    use super::*;
    use std::f32::consts::TAU;

    /// The solid angle [sr] that a rectangle subtends at a point: that of the density, or in double precision where the
    /// rectangle is sampled by area.
    fn rectangle_solid_angle(rectangle: &Rectangle, reference: Vec3) -> f32 {
        let rectangle = RectangleSampler::new(rectangle);
        let rectangle = RectangleLanes::<f32>::splat((), &rectangle);
        let view = rectangle.view(reference.into(), None);
        if view.is_by_solid_angle {
            1.0 / view.inverse_solid_angle
        } else {
            let (corner, size) = rectangle.in_double_precision(reference.into());
            let near = NearView::new(corner, size);
            if near.h > IN_PLANE { near.solid_angle as f32 } else { 0.0 }
        }
    }

    fn rectangle() -> Rectangle {
        let (c, s) = (0.8, 0.6);
        Rectangle {
            corner: Vec3::new(0.2, -0.4, 1.0),
            edge_u: Vec3::new(0.5 * c, 0.5 * s, 0.0),
            edge_v: Vec3::new(-1.2 * s * c, 1.2 * c * c, 1.2 * s),
        }
    }

    fn references() -> Vec<Vec3> {
        let r = rectangle();
        let n = r.normal();
        let mut all = Vec::new();
        for (u, v) in [(0.5, 0.5), (0.0, 0.0), (1.0, 0.3), (-0.01, 0.7), (1.5, 1.5), (-3.0, 0.5), (0.2, 40.0)] {
            for h in [1e-4, 1e-2, 0.3, -1.0, 5.0, -300.0] {
                all.push(r.point(u, v) + h * n);
            }
        }
        all
    }

    #[test]
    fn a_cube_face_seen_from_the_middle_is_a_sixth_of_the_sphere() {
        let face = Rectangle { corner: Vec3::new(-1.0, -1.0, 1.0), edge_u: 2.0 * Vec3::X, edge_v: 2.0 * Vec3::Y };
        let want = 4.0 * std::f32::consts::PI / 6.0;
        assert!((rectangle_solid_angle(&face, Vec3::ZERO) - want).abs() < 1e-6);
        assert!((rectangle_solid_angle(&face, Vec3::new(0.0, 0.0, 1.0 - 1e-6)) - TAU).abs() < 1e-4);
        assert_eq!(rectangle_solid_angle(&face, Vec3::Z), 0.0, "in the plane nothing is seen");
    }

    #[test]
    fn the_solid_angle_is_that_of_its_two_triangles() {
        let r = rectangle();
        let [a, b, c, d] = [r.point(0.0, 0.0), r.point(1.0, 0.0), r.point(1.0, 1.0), r.point(0.0, 1.0)];
        for p in references() {
            let sum = triangle_solid_angle(&[a, b, c], p) + triangle_solid_angle(&[a, c, d], p);
            let got = rectangle_solid_angle(&r, p);
            // The corners of the triangles are rounded to f32, which changes directions by rounding over distance.
            let height = (p - r.corner).dot(r.normal()).abs();
            assert!((got - sum).abs() <= 1e-5 * sum + 1e-6 + 2e-7 / height, "{got} against {sum} from {p}");
        }
    }

    #[test]
    fn the_density_of_a_sample_is_that_of_pdf_to_the_bit() {
        let r = rectangle();
        for p in references() {
            for k in 0..64 {
                let u = [(k as f32 + 0.5) / 64.0, (k as f32 * 0.618_034).fract()];
                let s = sample_rectangle(&r, p, u).unwrap();
                assert_eq!(s.pdf.to_bits(), pdf_rectangle(&r, p, s.point).to_bits(), "from {p} with {u:?}");
                assert!((s.point - r.point(s.coordinates[0], s.coordinates[1])).length() < 1e-6);
            }
        }
    }

    #[test]
    fn degenerate_views_have_no_sample_and_near_degenerate_ones_are_finite() {
        let r = rectangle();
        let n = r.normal();
        for p in [r.corner, r.point(1.0, 1.0), r.point(0.5, 0.5), Vec3::NAN, Vec3::INFINITY] {
            // Rounding may move a point of the plane off it by an ulp. Then the sample must be valid.
            for q in [p, p + 1e-7 * n, p - 1e-20 * n] {
                for u in [[0.0, 0.0], [0.3, 0.9], [1.0 - f32::EPSILON / 2.0; 2]] {
                    if let Some(s) = sample_rectangle(&r, q, u) {
                        assert!(s.pdf > 0.0 && s.pdf.is_finite() && s.point.is_finite(), "{s:?} from {q}");
                        assert!(s.coordinates.iter().all(|c| (0.0..=1.0).contains(c)));
                    }
                }
            }
        }
        let axis = Rectangle { corner: Vec3::ZERO, edge_u: Vec3::X, edge_v: Vec3::Y };
        assert_eq!(sample_rectangle(&axis, Vec3::new(0.5, 0.5, 0.0), [0.5, 0.5]), None);
        assert_eq!(pdf_rectangle(&axis, Vec3::new(5.0, 0.5, 0.0), Vec3::ZERO), 0.0);
        let no_area = Rectangle { edge_u: Vec3::ZERO, ..axis };
        assert_eq!(sample_rectangle(&no_area, Vec3::Z, [0.5, 0.5]), None);
        // An emitter of 1e-12 m^2, and one at a slant of a millionth.
        let tiny = Rectangle { corner: Vec3::Z, edge_u: 1e-6 * Vec3::X, edge_v: 1e-6 * Vec3::Y };
        let s = sample_rectangle(&tiny, Vec3::ZERO, [0.5, 0.5]).unwrap();
        assert!((s.pdf * 1e-12 - 1.0).abs() < 1e-4, "{s:?}");
        assert!(sample_rectangle(&axis, Vec3::new(5.0, 0.5, 1e-6), [0.5, 0.5]).unwrap().pdf.is_finite());
    }

    #[test]
    fn two_triangles_are_a_rectangle_only_if_they_are() {
        let r = rectangle();
        let [a, b, c, d] = [r.point(0.0, 0.0), r.point(1.0, 0.0), r.point(1.0, 1.0), r.point(0.0, 1.0)];
        for first in [[b, c, a], [a, b, c], [c, a, b]] {
            for second in [[a, c, d], [d, a, c], [c, d, a]] {
                let found = rectangle_from_triangles(first, second).unwrap();
                assert!((found.area() - r.area()).abs() < 1e-5 * r.area());
                assert!(found.normal().dot(r.normal()) > 0.999_99, "the winding decides the normal");
                assert!((found.point(0.5, 0.5) - r.point(0.5, 0.5)).length() < 1e-6);
            }
        }
        assert_eq!(rectangle_from_triangles([a, b, c], [a, d, c]), None, "wound against each other");
        assert_eq!(rectangle_from_triangles([a, b, c], [a, b, c]), None, "the same triangle twice");
        assert_eq!(rectangle_from_triangles([a, b, c], [a, c, d + 1e-3 * r.normal()]), None, "not flat");
        assert_eq!(rectangle_from_triangles([a, b, c], [a, c, d + 1e-3 * r.edge_u]), None, "no parallelogram");
        let skew = 1e-3 * r.edge_u;
        assert_eq!(rectangle_from_triangles([a, b, c + skew], [a, c + skew, d + skew]), None, "a parallelogram");
        let far = Vec3::new(1000.0, 0.0, 0.0);
        let moved = |t: [Vec3; 3]| t.map(|v| v + far);
        assert!(rectangle_from_triangles(moved([a, b, c]), moved([a, c, d])).is_some(), "rounding at 1 km is forgiven");
        assert_eq!(rectangle_from_triangles([a, a, c], [a, c, d]), None, "a triangle without area");
    }
}
