//! Rectangles: solid angle, sampling by solid angle, and their detection in pairs of triangles.

use glam::{DVec3, Vec3};

use super::{IN_PLANE, MIN_SOLID_ANGLE, ShapeSample, area_pdf};

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
    corner: DVec3,
    center: DVec3,
    /// Unit vectors along the edges and perpendicular to them.
    axes: [DVec3; 3],
    /// Lengths of the edges.
    size: [f64; 2],
    area: f64,
    half_diagonal2: f64,
}

impl RectangleSampler {
    /// Precomputes the values. A rectangle without area is valid: it is never sampled.
    pub fn new(rectangle: &Rectangle) -> Self {
        let (u, v) = (rectangle.edge_u.as_dvec3(), rectangle.edge_v.as_dvec3());
        let corner = rectangle.corner.as_dvec3();
        let size = [u.length(), v.length()];
        let (ex, ey) = (u / size[0], v / size[1]);
        Self {
            rectangle: *rectangle,
            corner,
            center: corner + 0.5 * (u + v),
            axes: [ex, ey, ex.cross(ey)],
            size,
            area: size[0] * size[1],
            half_diagonal2: 0.25 * (u.length_squared() + v.length_squared()),
        }
    }

    /// The rectangle itself.
    pub fn rectangle(&self) -> &Rectangle {
        &self.rectangle
    }

    /// See [`sample_rectangle`].
    pub fn sample(&self, reference: Vec3, u: [f32; 2]) -> Option<ShapeSample> {
        let (coordinates, point, pdf);
        match Far::new(self, reference) {
            Some(far) => {
                (coordinates, point) = (u, self.rectangle.point(u[0], u[1]));
                pdf = far.pdf(point, reference);
            }
            None => {
                let view = View::new(self, reference)?;
                coordinates = if view.by_solid_angle() { view.sample(u.map(f64::from)) } else { u };
                point = self.rectangle.point(coordinates[0], coordinates[1]);
                pdf = view.pdf(point, reference);
            }
        }
        (pdf > 0.0).then_some(ShapeSample { point, coordinates, pdf })
    }

    /// See [`pdf_rectangle`].
    pub fn pdf(&self, reference: Vec3, point: Vec3) -> f32 {
        match Far::new(self, reference) {
            Some(far) => far.pdf(point, reference),
            None => View::new(self, reference).map_or(0.0, |view| view.pdf(point, reference)),
        }
    }
}

/// The random numbers for which [`sample_rectangle`] returns the point at these fractions of the edges; `None` where it
/// returns nothing.
pub fn invert_rectangle(rectangle: &Rectangle, reference: Vec3, coordinates: [f32; 2]) -> Option<[f32; 2]> {
    let rectangle = RectangleSampler::new(rectangle);
    if Far::new(&rectangle, reference).is_some() {
        return Some(coordinates);
    }
    let view = View::new(&rectangle, reference)?;
    Some(if view.by_solid_angle() { view.invert(coordinates.map(f64::from)) } else { coordinates })
}

/// A rectangle is far away if the square of its distance is this many times that of its half diagonal.
///
/// If it is then sampled by area, the density per solid angle `d^3 / (A h)` varies over it by a factor of 1.4 face on.
/// That is a variance of one percent of the squared mean, far below that of visibility and surface. The density varies
/// more only at slanted angles, where the rectangle contributes little light. The cost is a fifth.
const FAR: f64 = 4.0;

/// A rectangle that is far away.
struct Far {
    /// Area times the distance of the reference from the plane.
    volume: f64,
}

impl Far {
    #[inline]
    fn new(rectangle: &RectangleSampler, reference: Vec3) -> Option<Self> {
        let reference = reference.as_dvec3();
        let height = (rectangle.corner - reference).dot(rectangle.axes[2]);
        let d2 = (rectangle.center - reference).length_squared();
        // Near the plane the exact method decides if the rectangle is visible.
        let clear = height * height > EDGE_ON * EDGE_ON * d2;
        let volume = rectangle.area * height.abs();
        (clear && FAR * rectangle.half_diagonal2 < d2).then_some(Self { volume })
    }

    #[inline]
    fn pdf(&self, point: Vec3, reference: Vec3) -> f32 {
        let d2 = (point.as_dvec3() - reference.as_dvec3()).length_squared();
        let pdf = (d2 * d2.sqrt() / self.volume) as f32;
        if pdf.is_finite() { pdf } else { 0.0 }
    }
}

/// Sine of the angle to the plane below which a far rectangle is sampled by the exact method.
const EDGE_ON: f64 = 1e-4;

/// A rectangle in the coordinates of a reference point: `[x0, x1] x [y0, y1]` at the distance `h`.
///
/// The part of the rectangle between 0 and x subtends (signed) `G(x) = F(x, y1) - F(x, y0)`, `F(x, y) = atan(x y / (h
/// sqrt(x^2 + y^2 + h^2)))`. This is the distribution that Urena, Fajardo & King (2013) invert. With
/// `s = x / sqrt(x^2 + h^2)` and `b = y / sqrt(y^2 + h^2)` each F is `asin(s b)`, and the addition theorem gives the inverse of `g =
/// asin(s b1) - asin(s b0)` in closed form: `s = sin g / sqrt(b0^2 + b1^2 - 2 b0 b1 cos g)`. This is their result
/// without the inner angles, whose arc cosines lose half of the digits near 0 and pi.
struct View {
    x: [f64; 2],
    y: [f64; 2],
    height: f64,
    /// Lengths of the edges.
    size: [f64; 2],
    /// G(x0).
    g0: f64,
    /// G(x1) - G(x0).
    solid_angle: f64,
}

impl View {
    fn new(rectangle: &RectangleSampler, reference: Vec3) -> Option<Self> {
        let size = rectangle.size;
        let to_corner = rectangle.corner - reference.as_dvec3();
        let [x0, y0, height] = rectangle.axes.map(|axis| to_corner.dot(axis));
        let (x, y) = ([x0, x0 + size[0]], [y0, y0 + size[1]]);
        let height = height.abs();
        let reach = x[0].abs().max(x[1].abs()).max(y[0].abs()).max(y[1].abs());
        // A NaN (an edge of no length, a reference that is not finite) fails this comparison too.
        if height > IN_PLANE * reach && height.is_finite() {
            let g = x.map(|x| solid_angle_to(x, y, height));
            Some(Self { x, y, height, size, g0: g[0], solid_angle: g[1] - g[0] })
        } else {
            None
        }
    }

    fn by_solid_angle(&self) -> bool {
        self.solid_angle >= MIN_SOLID_ANGLE
    }

    fn pdf(&self, point: Vec3, reference: Vec3) -> f32 {
        if self.by_solid_angle() {
            (1.0 / self.solid_angle) as f32
        } else {
            area_pdf(point, reference, self.size[0] * self.size[1], self.height)
        }
    }

    /// Fractions of the two edges, uniform by solid angle.
    fn sample(&self, [u, v]: [f64; 2]) -> [f32; 2] {
        let h = self.height;
        let [y0, y1] = self.y;

        let (sin_half, cos_half) = (0.5 * (self.g0 + u * self.solid_angle)).sin_cos();
        let sin_g = 2.0 * sin_half * cos_half;
        let (r0, r1) = (hypotenuse(y0, h), hypotenuse(y1, h));
        let (b0, b1) = (y0 / r0, y1 / r1);
        // b1 - b0 without cancellation when both lie near +1 or -1.
        let b_difference =
            if y0 * y1 > 0.0 { h * h * (y1 * y1 - y0 * y0) / (r0 * r1 * (y1 * r0 + y0 * r1)) } else { b1 - b0 };
        let d2 = b_difference * b_difference + 4.0 * b0 * b1 * sin_half * sin_half;
        let one_minus_s2 = (d2 - sin_g * sin_g).max(f64::MIN_POSITIVE);
        let x = (h * sin_g / one_minus_s2.sqrt()).clamp(self.x[0], self.x[1]);

        // Along the meridian the measure is uniform in the sine of the elevation (Archimedes).
        let d = hypotenuse(x, h);
        let [e0, e1] = self.y.map(|y| y / hypotenuse(y, d));
        let e = e0 + v * (e1 - e0);
        let y = (e * d / (1.0 - e * e).max(f64::MIN_POSITIVE).sqrt()).clamp(y0, y1);

        // Clamped fractions, so that the point stays in the rectangle.
        [(x - self.x[0]) / self.size[0], (y - y0) / self.size[1]].map(|f| (f as f32).clamp(0.0, 1.0))
    }

    /// The inverse of [`Self::sample`].
    fn invert(&self, [u, v]: [f64; 2]) -> [f32; 2] {
        let (x, y) = (self.x[0] + u * self.size[0], self.y[0] + v * self.size[1]);
        let turned = solid_angle_to(x, self.y, self.height) - self.g0;
        let d = hypotenuse(x, self.height);
        let [e0, e1, e] = [self.y[0], self.y[1], y].map(|y| y / hypotenuse(y, d));
        [turned / self.solid_angle, (e - e0) / (e1 - e0)].map(|f| (f as f32).clamp(0.0, 1.0))
    }
}

/// G(x) of [`View`]: the signed solid angle of the part of a rectangle between 0 and x.
fn solid_angle_to(x: f64, y: [f64; 2], height: f64) -> f64 {
    // The difference of two arc tangents is the argument of one product of complex numbers, h r + i x y.
    let [(re0, im0), (re1, im1)] = y.map(|y| (height * DVec3::new(x, y, height).length(), x * y));
    (im1 * re0 - re1 * im0).atan2(re1 * re0 + im1 * im0)
}

/// `sqrt(a^2 + b^2)`. Lengths come from f32, so their squares neither overflow nor vanish in f64.
#[inline]
fn hypotenuse(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt()
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
    use super::super::triangle::tests::triangle_solid_angle;
    use super::*;

    /// The solid angle [sr] that a rectangle subtends at a point.
    fn rectangle_solid_angle(rectangle: &Rectangle, reference: Vec3) -> f32 {
        View::new(&RectangleSampler::new(rectangle), reference).map_or(0.0, |view| view.solid_angle as f32)
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
        assert!((rectangle_solid_angle(&face, Vec3::new(0.0, 0.0, 1.0 - 1e-6)) - std::f32::consts::TAU).abs() < 1e-4);
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

    /// Equal cells of (u1, u2) must cover equal probability: solid angle of the image of a cell times density.
    #[test]
    fn each_cell_of_random_numbers_covers_its_share_of_solid_angle() {
        let r = rectangle();
        const N: usize = 48;
        // From 0.1 mm the far cells are long and curved; the bit-for-bit test covers that view.
        for p in references().into_iter().filter(|&p| (p - r.corner).dot(r.normal()).abs() > 1e-3) {
            let at = |i: usize, j: usize| {
                let u = [i, j].map(|k| (k as f32 / N as f32).min(1.0 - f32::EPSILON / 2.0));
                sample_rectangle(&r, p, u).map(|s| s.point)
            };
            let mut covered = 0.0;
            for i in 0..N {
                for j in 0..N {
                    let [Some(a), Some(b), Some(c), Some(d)] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]
                    else {
                        panic!("no sample from {p}");
                    };
                    let centre = 0.25 * (a + b + c + d);
                    let cell = triangle_solid_angle(&[a, b, c], p) + triangle_solid_angle(&[a, c, d], p);
                    let share = cell * pdf_rectangle(&r, p, centre) * (N * N) as f32;
                    // Cells at the far ends of a wide view are curved; the rest are flat to a few per cent.
                    assert!((0.75..1.35).contains(&share), "cell {i},{j} from {p} has {share} of its share");
                    covered += share / (N * N) as f32;
                }
            }
            assert!((covered - 1.0).abs() < 5e-3, "cells cover {covered} of the rectangle from {p}");
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
