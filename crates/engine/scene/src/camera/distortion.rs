//! Lens distortion of OpenCV: the forward model, its domain, and its inverse for the ray generator.

use dunkelfeld_lanes::Real;

/// OpenCV's lens distortion: radial and tangential terms (Brown 1971), the radial ones as a fraction of polynomials.
///
/// It maps the direction `(x, y, 1)` in the camera frame of OpenCV (x right, y *down*, z forward) to its place on a
/// film at unit distance. With r^2 = x^2 + y^2 and g = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
/// that place is
///
/// x' = x g + 2 p1 x y + p2 (r^2 + 2 x^2), y' = y g + p1 (r^2 + 2 y^2) + 2 p2 x y.
#[derive(Clone, Copy, Debug, PartialEq, Default, serde::Serialize)]
pub struct Distortion {
    /// k1 to k6: the first three are in the numerator, the others in the denominator.
    pub radial: [f64; 6],
    /// p1 and p2.
    pub tangential: [f64; 2],
}

/// The fold of a distortion: beyond it, two directions map to one place of the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fold {
    /// Tangent of the field angle.
    pub radius: f64,
    /// Distance from the principal point on a film at unit distance; no point farther out is reached from inside.
    pub film_radius: f64,
}

impl Distortion {
    /// No distortion.
    pub const NONE: Self = Self { radial: [0.0; 6], tangential: [0.0; 2] };

    /// The coefficients in the order in which OpenCV gives them: k1, k2, p1, p2, then k3, then k4, k5, k6, then those of a
    /// thin prism and a tilted sensor, which must be zero.
    ///
    /// `None` unless there are 4, 5, 8, 12 or 14 of them.
    pub fn from_opencv(coefficients: &[f64]) -> Option<Self> {
        let (&[k1, k2, p1, p2], rest) = coefficients.split_first_chunk::<4>()?;
        let [k3, k4, k5, k6] = match *rest {
            [] => [0.0; 4],
            [k3] => [k3, 0.0, 0.0, 0.0],
            [k3, k4, k5, k6] => [k3, k4, k5, k6],
            [k3, k4, k5, k6, ref more @ ..] if [4, 6].contains(&more.len()) && more.iter().all(|v| *v == 0.0) => {
                [k3, k4, k5, k6]
            }
            _ => return None,
        };
        Some(Self { radial: [k1, k2, k3, k4, k5, k6], tangential: [p1, p2] })
    }

    /// True if the model is the identity.
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// Are all coefficients finite?
    pub fn is_finite(&self) -> bool {
        self.radial.iter().chain(&self.tangential).all(|v| v.is_finite())
    }

    /// The place of the direction `(x, y, 1)` on the film; x to the right and y down, in units of the distance to the
    /// film.
    #[inline]
    pub fn forward(&self, x: [f64; 2]) -> [f64; 2] {
        self.image(x).place
    }

    fn image(&self, [x, y]: [f64; 2]) -> Image {
        let [k1, k2, k3, k4, k5, k6] = self.radial;
        let [p1, p2] = self.tangential;
        let s = x * x + y * y;
        let above = 1.0 + s * (k1 + s * (k2 + s * k3));
        let below = 1.0 + s * (k4 + s * (k5 + s * k6));
        let g = above / below;
        // dg/ds.
        let slope = (k1 + s * (2.0 * k2 + s * 3.0 * k3) - g * (k4 + s * (2.0 * k5 + s * 3.0 * k6))) / below;
        Image {
            place: [
                x * g + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
                y * g + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            xx: g + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
            xy: 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y,
            yy: g + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
            below,
        }
    }
}

/// A distorted place and the derivatives there. Their matrix is symmetric, because the model is the gradient of a
/// potential.
struct Image {
    place: [f64; 2],
    xx: f64,
    xy: f64,
    yy: f64,
    /// The denominator of the radial fraction.
    below: f64,
}

impl Image {
    fn determinant(&self) -> f64 {
        self.xx * self.yy - self.xy * self.xy
    }

    /// True if the potential is convex here and the point is on this side of any pole.
    fn is_regular(&self) -> bool {
        self.below > 0.0 && self.xx + self.yy > 0.0 && self.determinant() > 0.0
    }
}

/// Number of steps of the march from the axis, per radius of the film.
const STEPS: f64 = 512.0;
/// Number of directions in which an asymmetric distortion is sampled.
const SPOKES: u32 = 64;
/// Largest tangent of a field angle (89.9 degrees). No perspective film exceeds it.
const WIDEST: f64 = 573.0;
/// Entries of the table that Newton's method starts from.
const ENTRIES: usize = 128;
/// Maximum number of Newton steps. Two or three are usual.
const MAX_STEPS: u32 = 32;
/// Smallest fraction of a Newton step that is tried.
const SHORTEST: f64 = 1.0 / 1024.0;
/// Residual at which a place is accepted, relative to the radius of the film. It is far below the precision of f32.
const CLOSE: f64 = 1e-13;

/// The inverse of a distortion over a film: from places on the film to directions.
///
/// The matrix of the derivatives of the model is symmetric. On a disc of directions where it is positive definite
/// everywhere the model is the gradient of a strictly convex function. So no two directions of the disc map to one
/// place, and a Newton descent with decreasing residual finds the direction of every place.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Undistorter {
    model: Distortion,
    /// Radius of the disc of directions.
    radius: f64,
    /// Radius on the film that the disc covers completely.
    film_radius: f64,
    /// Quotient of radii, direction over film, at equal steps of the film radius. They follow from the other values.
    #[serde(skip)]
    quotients: [f64; ENTRIES + 1],
}

impl Undistorter {
    /// Prepares the inverse for all places of a film at unit distance within `film_radius` of its principal point.
    ///
    /// # Errors
    /// If the model folds, has a pole, or ends before it covers the film.
    pub fn new(model: Distortion, film_radius: f64) -> Result<Self, Fold> {
        let spokes = if model.tangential == [0.0; 2] { 1 } else { SPOKES };
        let directions: Vec<[f64; 2]> = (0..spokes)
            .map(|i| {
                let (cos, sin) = Real::cos_sin(std::f64::consts::TAU * f64::from(i) / f64::from(spokes));
                [cos, sin]
            })
            .collect();
        let mut step = film_radius / STEPS;
        // Pairs of film radius (in the least favourable direction) and radius. A fold between two steps that is not
        // visible at either of them is very shallow. It moves places by less than the precision of f32.
        let mut march = vec![[0.0, 0.0]];
        let mut covered = [0.0, 0.0];
        while covered[0] < film_radius {
            let radius = covered[1] + step;
            let mut least = f64::INFINITY;
            for [cos, sin] in &directions {
                let image = model.image([radius * cos, radius * sin]);
                let place = length(image.place);
                if !image.is_regular() || !place.is_finite() || radius > WIDEST {
                    return Err(Fold { radius: covered[1], film_radius: covered[0] });
                }
                least = least.min(place);
            }
            covered = [least, radius];
            march.push(covered);
            // If the model approaches the edge of the film slowly, the steps grow.
            step *= 1.001;
        }
        let mut at = 1;
        let quotients = std::array::from_fn(|i| {
            let wanted = film_radius * i as f64 / ENTRIES as f64;
            while at + 1 < march.len() && march[at][0] < wanted {
                at += 1;
            }
            let ([f0, r0], [f1, r1]) = (march[at - 1], march[at]);
            let share = if f1 > f0 { (wanted - f0) / (f1 - f0) } else { 1.0 };
            // On the axis the model is the identity.
            if i == 0 { 1.0 } else { (r0 + (r1 - r0) * share) / wanted }
        });
        Ok(Self { model, radius: covered[1], film_radius, quotients })
    }

    /// The model.
    pub fn model(&self) -> &Distortion {
        &self.model
    }

    /// True if the direction `(x, y, 1)` lies in the domain where the model is proved to be one to one. All directions
    /// that map to the film do.
    pub fn is_valid(&self, [x, y]: [f64; 2]) -> bool {
        x * x + y * y <= self.radius * self.radius
    }

    /// The direction `(x, y, 1)` of a place on the film, to 1e-13 of the film's radius.
    ///
    /// For a place beyond the film radius, where there may be no direction, the nearest result of the descent.
    pub fn inverse(&self, place: [f64; 2]) -> [f64; 2] {
        let mut at = self.start(place);
        let residual = |at: [f64; 2]| {
            let image = self.model.image(at);
            let gap = [image.place[0] - place[0], image.place[1] - place[1]];
            (length(gap), gap, image)
        };
        let (mut size, mut gap, mut image) = residual(at);
        let mut share = 1.0;
        for _ in 0..MAX_STEPS {
            if size <= CLOSE * self.film_radius || share < SHORTEST {
                break;
            }
            let determinant = image.determinant();
            let step = [
                (image.yy * gap[0] - image.xy * gap[1]) / determinant,
                (image.xx * gap[1] - image.xy * gap[0]) / determinant,
            ];
            let next = self.clamped([at[0] - share * step[0], at[1] - share * step[1]]);
            let (next_size, next_gap, next_image) = residual(next);
            // A step that does not reduce the residual was too long. The comparison also rejects not-a-number.
            if next_size < size {
                (at, size, gap, image, share) = (next, next_size, next_gap, next_image, 1.0);
            } else {
                share *= 0.5;
            }
        }
        at
    }

    /// Start value of the descent: the table inverts the radial part.
    fn start(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let t = ENTRIES as f64 * (length([x, y]) / self.film_radius).min(1.0);
        let i = (t as usize).min(ENTRIES - 1);
        let (a, b) = (self.quotients[i], self.quotients[i + 1]);
        let quotient = a + (b - a) * (t - i as f64);
        self.clamped([x * quotient, y * quotient])
    }

    /// A direction clamped to the disc.
    fn clamped(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let shrink = self.radius / length([x, y]).max(self.radius);
        [x * shrink, y * shrink]
    }
}

/// `hypot` of the library of C has other bits on other machines.
fn length([x, y]: [f64; 2]) -> f64 {
    (x * x + y * y).sqrt()
}
