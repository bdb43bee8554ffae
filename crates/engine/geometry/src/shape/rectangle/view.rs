//! A rectangle as seen from a reference: density and sampled place, in single or double precision.

use super::super::{IN_PLANE, MIN_SOLID_ANGLE};
use dunkelfeld_lanes::{Mask, Real, V3};

/// Views of which a precision has enough digits.
pub(super) struct Limits {
    /// Sine of the angle to the plane, if the rectangle is far away.
    far: f32,
    /// Height over the plane as a part of the reach of the rectangle (see [`NearView`]), if it is not.
    near: f32,
}

/// A sine of 0.01 has a rounding of 1e-5 of the height in single precision.
pub(super) const SINGLE: Limits = Limits { far: 0.01, near: 0.03 };

/// Beyond these limits the reference lies in the plane. A far rectangle that is seen at a smaller sine is sampled by solid
/// angle, if that is above [`MIN_SOLID_ANGLE`].
pub(super) const DOUBLE: Limits = Limits { far: 1e-4, near: IN_PLANE as f32 };

/// The density, and the sampled place if random numbers are given.
pub(super) struct View<N: Real> {
    pub(super) is_by_solid_angle: N::Mask,
    /// Inverse of the solid angle [1/sr], where that is the density.
    pub(super) inverse_solid_angle: N,
    /// Elsewhere: area times the distance of the reference from the plane [m^3]; zero where there is no sample.
    pub(super) volume: N,
    /// Distances from the corner along the short and the long edge \[m\].
    pub(super) place: [N; 2],
}

impl<N: Real> View<N> {
    /// The view for the first corner in coordinates of the reference, and the lanes that are within the limits.
    #[inline(always)]
    pub(super) fn new([x, y, h]: [N; 3], size: [N; 2], u: Option<[N; 2]>, limits: &Limits) -> (Self, N::Mask) {
        let ([width, length], h) = (size, h.abs());
        let (zero, half) = (h.constant(0.0), h.constant(0.5));
        let (middle_x, middle_y) = (x + width * half, y + length * half);
        let d2 = middle_x * middle_x + middle_y * middle_y + h * h;
        let place = match u {
            Some([u, v]) => [u * width, v * length],
            None => [zero; 2],
        };
        let mut view =
            Self { is_by_solid_angle: zero.lt(zero), inverse_solid_angle: zero, volume: width * length * h, place };
        // A rectangle is far away if its diagonal is shorter than its distance. If it is then sampled by area, the density
        // per solid angle `d^3 / (A h)` varies over it by a factor of 1.4 face on. That is a variance of one percent of the
        // squared mean, far below that of visibility and surface. The density varies more only at slanted angles, where the
        // rectangle contributes little light. The cost is a fifth.
        let is_far = (width * width + length * length).lt(d2);
        // The comparisons are written so that a NaN is beyond the limits.
        let mut is_clear = is_far & (d2.sqrt() * h.constant(limits.far)).lt(h);
        let is_near = !is_clear & (reach([x, y, h], size) * h.constant(limits.near)).lt(h);
        is_clear = is_clear | is_near;
        if is_near.any() {
            let near = NearView::new([x, y, h], size);
            view.is_by_solid_angle = is_near & h.constant(MIN_SOLID_ANGLE as f32).le(near.solid_angle);
            view.inverse_solid_angle = near.solid_angle.recip();
            if let Some(u) = u {
                let [x, y] = near.sample(u, size);
                view.place =
                    [view.is_by_solid_angle.select(x, view.place[0]), view.is_by_solid_angle.select(y, view.place[1])];
            }
        }
        (view, is_clear)
    }

    /// Density [1/sr] of a point on the rectangle: constant, or `d^3 / (A h)` (see `area_pdf`).
    #[inline(always)]
    pub(super) fn pdf(&self, point: V3<N>, reference: V3<N>) -> N {
        let d2 = (point - reference).length_squared();
        let by_area = d2 / self.volume * d2.sqrt();
        let pdf = self.is_by_solid_angle.select(self.inverse_solid_angle, by_area);
        pdf.only(pdf.is_finite())
    }
}

/// A rectangle in the coordinates of a reference point: `[x0, x1] x [y0, y1]` at the distance `h`, over its reach.
///
/// The part of the rectangle between 0 and x subtends (signed) `G(x) = F(x, y1) - F(x, y0)`, `F(x, y) = atan(x y / (h
/// sqrt(x^2 + y^2 + h^2)))`. This is the distribution that Urena, Fajardo & King (2013) invert. With
/// `s = x / sqrt(x^2 + h^2)` and `b = y / sqrt(y^2 + h^2)` each F is `asin(s b)`, and the addition theorem gives the inverse of `g =
/// asin(s b1) - asin(s b0)` in closed form: `s = sin g / sqrt(b0^2 + b1^2 - 2 b0 b1 cos g)`. This is their result
/// without the inner angles, whose arc cosines lose half of the digits near 0 and pi. Differences of cosines are products
/// of sines.
pub(super) struct NearView<N> {
    x: [N; 2],
    y: [N; 2],
    pub(super) h: N,
    /// The unit of the other lengths \[m\]. See the function [`reach`].
    reach: N,
    /// Length of the long edge.
    length: N,
    /// Distances of the corners (x0, y0) and (x0, y1).
    d: [N; 2],
    pub(super) solid_angle: N,
}

impl<N: Real> NearView<N> {
    #[inline(always)]
    pub(super) fn new([x, y, h]: [N; 3], [width, length]: [N; 2]) -> Self {
        let h = h.abs();
        let reach = reach([x, y, h], [width, length]);
        let unit = reach.recip();
        let ([x0, y0, h], [width, length]) = ([x * unit, y * unit, h * unit], [width * unit, length * unit]);
        let (x1, y1, h2) = (x0 + width, y0 + length, h * h);
        let (x00, x01, x11) = (x0 * x0, x0 * x1, x1 * x1);
        let (y00, y01, y11) = (y0 * y0, y0 * y1, y1 * y1);
        // Distances of the corners, in the order around the rectangle.
        let (a, b) = ((x00 + y00 + h2).sqrt(), (x11 + y00 + h2).sqrt());
        let (c, d) = ((x11 + y11 + h2).sqrt(), (x00 + y11 + h2).sqrt());
        // The solid angles of two triangles (van Oosterom and Strackee 1983) as one argument. The triple product of each
        // has no cancellation.
        let diagonal = x01 + y01 + h2;
        let first = a * b * c + (x01 + y00 + h2) * c + (x11 + y01 + h2) * a + diagonal * b;
        let second = a * c * d + diagonal * d + (x01 + y11 + h2) * a + (x00 + y01 + h2) * c;
        let triple = width * length * h;
        let half = N::angle(first * second - triple * triple, triple * (first + second));
        Self { x: [x0, x1], y: [y0, y1], h, reach, length, d: [a, d], solid_angle: half + half }
    }

    /// Distances from the corner along the two edges \[m\], uniform by solid angle.
    #[inline(always)]
    pub(super) fn sample(&self, [u, v]: [N; 2], size: [N; 2]) -> [N; 2] {
        let (h, h2) = (self.h, self.h * self.h);
        let ([x0, x1], [y0, y1]) = (self.x, self.y);
        // Each y has an angle b with tan b = y / h. With the difference and the sum of both,
        // 1 - s^2 = (cos g - cos difference) (cos g + cos sum) / (s^-2 sin^2 g).
        let product = ((y0 * y0 + h2) * (y1 * y1 + h2)).sqrt();
        let x2 = x0 * x0 + h2;
        let scale_of_both = (product * x2).recip();
        let scale = scale_of_both * x2;
        let difference = one_minus_cos(h * self.length * scale, (h2 + y0 * y1) * scale);
        let sum = one_minus_cos(h * (y0 + y1) * scale, (y0 * y1 - h2) * scale);
        // Sine and cosine of G(x0).
        let [d0, d1] = self.d;
        let (sin0, cos0) =
            (x0 * h * (y1 * d0 - y0 * d1) * scale_of_both, (h2 * d0 * d1 + x0 * x0 * y0 * y1) * scale_of_both);
        let (cos, sin) = N::cos_sin(u * self.solid_angle);
        let (sin, cos) = (sin0 * cos + cos0 * sin, cos0 * cos - sin0 * sin);
        let from_zero = one_minus_cos(sin, cos);
        let rest = (difference - from_zero) * (sum - from_zero);
        let x = (h * sin / rest.max(rest.tiny()).sqrt()).max(x0).min(x1);

        // Along the meridian the measure is uniform in the sine of the elevation (Archimedes). One minus the sine and one
        // plus it are interpolated, so that their product is exact near 1.
        let m2 = x * x + h2;
        let ((below0, above0), (below1, above1)) = (one_minus_and_plus_sin(y0, m2), one_minus_and_plus_sin(y1, m2));
        let w = v.one_minus();
        let (below, above) = (below0 * w + below1 * v, above0 * w + above1 * v);
        let y = ((above - below) * h.constant(0.5) * (m2 / (below * above)).sqrt()).max(y0).min(y1);
        let zero = h.constant(0.0);
        [((x - x0) * self.reach).max(zero).min(size[0]), ((y - y0) * self.reach).max(zero).min(size[1])]
    }
}

/// At least the distance of the farthest corner, at most 1.8 times it.
#[inline(always)]
fn reach<N: Real>([x, y, h]: [N; 3], [width, length]: [N; 2]) -> N {
    x.abs().max((x + width).abs()) + y.abs().max((y + length).abs()) + h
}

impl NearView<f64> {
    /// The random numbers of the place at these fractions of the edges: the inverse of [`Self::sample`].
    pub(super) fn invert(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let ([x0, x1], [y0, y1]) = (self.x, self.y);
        let width = u * (x1 - x0);
        let part = Self::new([x0, y0, self.h], [width, self.length]).solid_angle / self.solid_angle;
        let m2 = (x0 + width) * (x0 + width) + self.h * self.h;
        let [e0, e1, e] = [y0, y1, y0 + v * self.length].map(|y| y / (y * y + m2).sqrt());
        [part, (e - e0) / (e1 - e0)]
    }
}

/// `1 - cos` of an angle without cancellation.
#[inline(always)]
fn one_minus_cos<N: Real>(sin: N, cos: N) -> N {
    cos.is_positive().select(sin * sin / (cos + cos.constant(1.0)), cos.one_minus())
}

/// `1 - sin` and `1 + sin` of the elevation with the tangent `y / sqrt(m2)`, without cancellation.
#[inline(always)]
fn one_minus_and_plus_sin<N: Real>(y: N, m2: N) -> (N, N) {
    let r = (y * y + m2).sqrt();
    let sum = r + y.abs();
    let scale = (r * sum).recip();
    let (large, small) = (sum * sum * scale, m2 * scale);
    (y.is_positive().select(small, large), y.is_positive().select(large, small))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squares and strips over, beside and close to their plane. In double precision the random numbers of a sample lead
    /// back.
    #[test]
    fn samples_near_the_plane_have_their_digits_in_double_precision() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1 << 24) as f64
        };
        for (height, bound) in [(1e-1, 1e-10), (1e-2, 1e-9), (1e-3, 1e-7), (1e-4, 1e-5), (1e-6, 5e-3)] {
            for size in [[0.7, 1.0], [1e-3, 0.3], [0.1, 0.1]] {
                let scale = f64::hypot(size[0], size[1]);
                for _ in 0..20_000 {
                    let [x, y] = size.map(|length| length * (1.5 - 4.0 * random()));
                    let near = NearView::new([x, y, height * scale * (0.1 + random())], size);
                    let u = [random(), random()];
                    let place = near.sample(u, size);
                    let back = near.invert([place[0] / size[0], place[1] / size[1]]);
                    let error = (back[0] - u[0]).abs().max((back[1] - u[1]).abs());
                    assert!(near.solid_angle < 1e-6 || error < bound, "{size:?} at {x}, {y}, {}: {error:e}", near.h);
                }
            }
        }
    }
}
