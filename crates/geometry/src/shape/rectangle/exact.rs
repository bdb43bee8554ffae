//! Rectangles in double precision, for references near the plane, and the inverse of the sampling.

use super::super::{IN_PLANE, MIN_SOLID_ANGLE};
use super::Rectangle;
use glam::{DVec3, Vec3};

/// A rectangle, with its short edge along x.
pub(super) struct ExactRectangle {
    corner: DVec3,
    center: DVec3,
    /// Unit vectors along the edges and perpendicular to them.
    pub(super) axes: [DVec3; 3],
    /// Lengths of the edges.
    pub(super) size: [f64; 2],
    area: f64,
    pub(super) half_diagonal2: f64,
}

/// What sampling needs. See `View` in the module above.
pub(super) struct Exact {
    pub(super) is_by_solid_angle: bool,
    pub(super) inverse_solid_angle: f32,
    pub(super) volume: f32,
    pub(super) place: [f32; 2],
}

/// Sine of the angle to the plane below which a far rectangle is sampled by solid angle, if that is above
/// [`MIN_SOLID_ANGLE`]. The view also decides if the rectangle is visible.
const EDGE_ON: f64 = 1e-4;

impl ExactRectangle {
    pub(super) fn new(rectangle: &Rectangle, is_turned: bool) -> Self {
        let (u, v) = (rectangle.edge_u.as_dvec3(), rectangle.edge_v.as_dvec3());
        let (u, v) = if is_turned { (v, u) } else { (u, v) };
        let corner = rectangle.corner.as_dvec3();
        let size = [u.length(), v.length()];
        let (ex, ey) = (u / size[0], v / size[1]);
        Self {
            corner,
            center: corner + 0.5 * (u + v),
            axes: [ex, ey, ex.cross(ey)],
            size,
            area: size[0] * size[1],
            half_diagonal2: 0.25 * (u.length_squared() + v.length_squared()),
        }
    }

    /// The method, its constants and the place of a sample.
    pub(super) fn sample(&self, reference: Vec3, u: [f32; 2]) -> Exact {
        let by_area = |volume: f64| {
            let place = [0, 1].map(|axis| (f64::from(u[axis]) * self.size[axis]) as f32);
            Exact { is_by_solid_angle: false, inverse_solid_angle: 0.0, volume: volume as f32, place }
        };
        if let Some(volume) = self.far_volume(reference) {
            return by_area(volume);
        }
        match View::new(self, reference) {
            None => by_area(0.0),
            Some(view) if !view.by_solid_angle() => by_area(self.area * view.height),
            Some(view) => Exact {
                is_by_solid_angle: true,
                inverse_solid_angle: (1.0 / view.solid_angle) as f32,
                volume: 0.0,
                place: view.sample(u.map(f64::from)),
            },
        }
    }

    /// Area times height if the rectangle is far away and the reference clearly beside its plane.
    fn far_volume(&self, reference: Vec3) -> Option<f64> {
        let reference = reference.as_dvec3();
        let height = (self.corner - reference).dot(self.axes[2]);
        let d2 = (self.center - reference).length_squared();
        let is_clear = height * height > EDGE_ON * EDGE_ON * d2;
        (is_clear && f64::from(super::FAR) * self.half_diagonal2 < d2).then_some(self.area * height.abs())
    }

    #[cfg(test)]
    pub(super) fn solid_angle(&self, reference: Vec3) -> f64 {
        View::new(self, reference).map_or(0.0, |view| view.solid_angle)
    }

    #[cfg(test)]
    pub(super) fn invert_place(&self, reference: Vec3, place: [f32; 2]) -> [f32; 2] {
        let fractions = [0, 1].map(|axis| f64::from(place[axis]) / self.size[axis]);
        View::new(self, reference).map_or([f32::NAN; 2], |view| view.invert(fractions))
    }

    #[cfg(test)]
    pub(super) fn area_density(&self, reference: Vec3, point: Vec3) -> f64 {
        let (to_corner, d) = (self.corner - reference.as_dvec3(), (point - reference).as_dvec3().length());
        d * d * d / (self.area * to_corner.dot(self.axes[2]).abs())
    }

    /// The random numbers of the place at these fractions of the edges.
    pub(super) fn invert(&self, reference: Vec3, coordinates: [f32; 2]) -> Option<[f32; 2]> {
        Some(View::new(self, reference)?.invert(coordinates.map(f64::from)))
    }
}

/// A rectangle in the coordinates of a reference point: `[x0, x1] x [y0, y1]` at the distance `h`.
///
/// The part of the rectangle between 0 and x subtends (signed) `G(x) = F(x, y1) - F(x, y0)`, `F(x, y) = atan(x y / (h
/// sqrt(x^2 + y^2 + h^2)))`. This is the distribution that Urena, Fajardo & King (2013) invert. With
/// `s = x / sqrt(x^2 + h^2)` and `b = y / sqrt(y^2 + h^2)` each F is `asin(s b)`, and the addition theorem gives the inverse of `g =
/// asin(s b1) - asin(s b0)` in closed form: `s = sin g / sqrt(b0^2 + b1^2 - 2 b0 b1 cos g)`. This is their result
/// without the inner angles, whose arc cosines lose half of the digits near 0 and pi.
pub(super) struct View {
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
    fn new(rectangle: &ExactRectangle, reference: Vec3) -> Option<Self> {
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

    /// Distances from the corner along the two edges, uniform by solid angle.
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

        // Clamped, so that the point stays in the rectangle.
        [(x - self.x[0]).clamp(0.0, self.size[0]) as f32, (y - y0).clamp(0.0, self.size[1]) as f32]
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
