//! Finishes of machined surfaces: height fields in the space of an object, evaluated as slopes.
//!
//! Each sample meets the slope at its own place, so the mean over a pixel is that of the surface at any distance. A filter that
//! turns slopes below the size of a pixel into roughness (Dupuy et al. 2013, LEADR mapping) is not used: it widens the tail of GGX
//! with its core. In a dark field, which sees the tail alone, metal of roughness 0.15 would be seven times too bright.

use crate::material::HeightField;
use crate::material::height_image::ImageRelief;
use crate::material::texture::Image;
use dunkelfeld_geometry::{Mat3, Vec3};
use dunkelfeld_lanes::{Frame, Lanes, MAX_WIDTH, Mask, V3, cos_sin_of_turn, pow};
use dunkelfeld_sampling::hash_u64;
use std::f32::consts::{FRAC_1_SQRT_2, PI, TAU};

/// The direction of the grooves of a surface, in the frame of its object.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Grain {
    /// One direction, as on ground and brushed surfaces. Not zero.
    Straight(Vec3),
    /// Rings about an axis, as on turned surfaces.
    Around {
        /// The direction of the axis. Not zero.
        axis: Vec3,
        /// A point of the axis \[m\].
        origin: Vec3,
    },
}

impl Grain {
    pub(crate) fn is_valid(&self) -> bool {
        match *self {
            Self::Straight(direction) => is_direction(direction),
            Self::Around { axis, origin } => is_direction(axis) && origin.is_finite(),
        }
    }

    /// The unit tangent across the grooves at a point \[m\] with a unit normal. `None` where no groove lies in the surface.
    pub(crate) fn across(&self, point: Vec3, normal: Vec3) -> Option<Vec3> {
        let along = match *self {
            Self::Straight(direction) => direction,
            Self::Around { axis, origin } => axis.cross(point - origin),
        };
        normal.cross(along).try_normalize()
    }
}

/// The height field of a machined surface.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Finish {
    /// How the surface was made.
    pub process: Process,
    /// Arithmetic mean deviation Ra of the height \[m\] (ISO 21920-2), above 0.
    pub mean_deviation: f32,
    /// Seed of the height field.
    pub seed: u64,
}

impl Finish {
    pub(crate) fn is_valid(&self) -> bool {
        let is_length = |v: f32| v > 0.0 && v.is_finite();
        let is_process = match self.process {
            Process::Milled { feed, radius, direction } => {
                is_length(feed) && is_length(radius) && is_direction(direction)
            }
            Process::Turned { feed, axis, origin } => is_length(feed) && is_direction(axis) && origin.is_finite(),
            Process::Grooved { width, length, direction } => {
                is_length(width) && is_length(length) && is_direction(direction)
            }
            Process::Grained { size } => is_length(size),
        };
        is_process && is_length(self.mean_deviation)
    }
}

fn is_direction(v: Vec3) -> bool {
    v.try_normalize().is_some()
}

/// How a surface was machined. Directions and points are in the frame of the object, lengths in m and above 0. Directions are
/// not zero.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Process {
    /// Face milling: parabolic cusps along arcs of the tool's edge, in rows side by side. The axis of the tool is that of three
    /// perpendicular ones, among them the direction of the feed, which is nearest to the normal.
    Milled {
        /// Feed of the tool per revolution.
        feed: f32,
        /// Radius of the tool.
        radius: f32,
        /// Direction of the feed.
        direction: Vec3,
    },
    /// Turning and facing: parabolic cusps about an axis. On faces they are rings, on sides they follow one another along the
    /// axis.
    Turned {
        /// Feed of the tool per revolution.
        feed: f32,
        /// Direction of the axis.
        axis: Vec3,
        /// A point of the axis.
        origin: Vec3,
    },
    /// Ground or brushed: grooves of random depth and width in one direction.
    Grooved {
        /// Mean width of a groove with its ridge. Widths are from half to twice of it.
        width: f32,
        /// Length of a groove.
        length: f32,
        /// Direction of the grooves.
        direction: Vec3,
    },
    /// Blasted or cast: bumps of random size, without direction.
    Grained {
        /// Mean size of a bump with its hollow. Sizes are from half to twice of it.
        size: f32,
    },
}

/// Slopes of a height field, one for each lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slopes<F: Lanes> {
    /// A tangent vector along the steepest ascent, as long as the slope.
    pub(crate) slope: V3<F>,
    /// The unit tangent across the grooves; `None` without a direction.
    pub(crate) across: Option<V3<F>>,
    /// The visible area of the slope over that of the plane, divided by its mean over the slopes that are seen: the masking of
    /// Smith (1967). It keeps the energy at each view.
    pub(crate) visible: F,
}

/// Heights with all values precomputed that do not depend on the place.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) enum Relief {
    Finish(Marks),
    Image(Box<ImageRelief>),
}

impl Relief {
    pub(crate) fn new(height: &HeightField, images: &[Image]) -> Option<Self> {
        Some(match height {
            HeightField::Finish(finish) => Self::Finish(Marks::new(finish)),
            HeightField::Image(image) => Self::Image(Box::new(ImageRelief::new(image, images)?)),
        })
    }
}

/// A [`Finish`] with all values precomputed that do not depend on the place.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) enum Marks {
    Cusps(Cusps),
    Waves(Box<Waves>),
}

impl Marks {
    pub(crate) fn new(finish: &Finish) -> Self {
        let &Finish { process, mean_deviation, seed } = finish;
        let cusps =
            |feed: f32, path| Self::Cusps(Cusps { feed, height: mean_deviation * CUSP_PER_DEVIATION, path, seed });
        let waves = |waves| Self::Waves(Box::new(waves));
        match process {
            Process::Milled { feed, radius, direction } => {
                let x = direction.normalize();
                let (y, z) = x.any_orthonormal_pair();
                cusps(feed, Path::Arcs { axes: [x, y, z], radius })
            }
            Process::Turned { feed, axis, origin } => cusps(feed, Path::Rings { axis: axis.normalize(), origin }),
            Process::Grooved { width, length, direction } => {
                waves(Waves::new(width, Some((direction.normalize(), length)), mean_deviation, seed))
            }
            Process::Grained { size } => waves(Waves::new(size, None, mean_deviation, seed)),
        }
    }

    /// The slopes at points \[m\] with unit normals, for viewers in directions divided by their cosines.
    #[inline(always)]
    pub(crate) fn slopes<F: Lanes>(
        &self,
        token: F::Token,
        (points, normals): (V3<F>, V3<F>),
        views: V3<F>,
    ) -> Slopes<F> {
        let (slope, across, mean) = match self {
            Self::Cusps(cusps) => cusps.slopes(token, points, normals, views),
            Self::Waves(waves) => waves.slopes(token, points, normals, views),
        };
        let visible = slope.dot(views).one_minus().max(F::splat(token, 0.0)) / mean;
        Slopes { slope, across, visible }
    }
}

/// Height of a parabolic cusp over its mean deviation: a parabola of height 1 has the mean 1/3 and the mean deviation
/// 8 / (9 sqrt 12).
const CUSP_PER_DEVIATION: f32 = 3.897_114_3;
/// Distance of rows of milling over the radius of the tool.
const ROW: f32 = 1.4;

/// Parabolic cusps, one for each feed.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct Cusps {
    feed: f32,
    height: f32,
    path: Path,
    seed: u64,
}

#[derive(Clone, Debug, serde::Serialize)]
enum Path {
    /// Unit axes, the first along the feed, and the radius of the tool.
    Arcs {
        axes: [Vec3; 3],
        radius: f32,
    },
    Rings {
        axis: Vec3,
        origin: Vec3,
    },
}

impl Cusps {
    /// The path of the tool's edge at a point \[m\], and its gradient.
    fn path(&self, point: Vec3, normal: Vec3) -> (f32, Vec3) {
        match self.path {
            Path::Rings { axis, origin } => {
                let from = point - origin;
                let height = from.dot(axis);
                let radial = from - axis * height;
                let is_face = normal.dot(axis).abs() > FRAC_1_SQRT_2;
                if is_face { (radial.length(), radial.normalize_or_zero()) } else { (height, axis) }
            }
            Path::Arcs { axes, radius } => {
                let [x, y, z] = axes.map(|axis| normal.dot(axis).abs());
                let [feed, side] =
                    if x > y.max(z) { [axes[1], axes[2]] } else { [axes[0], axes[if y > z { 2 } else { 1 }]] };
                let row = (point.dot(side) / (ROW * radius)).round();
                let off = point.dot(side) - row * ROW * radius;
                // The tool returns in every second row.
                let sign = if row as i64 & 1 == 0 { 1.0 } else { -1.0 };
                let chord = (radius * radius - off * off).sqrt();
                let start = unit(self.seed, row as i64 as u64) * self.feed;
                (sign * point.dot(feed) - chord + start, feed * sign + side * (off / chord))
            }
        }
    }

    /// Slopes, tangents across, and means of visible areas.
    #[inline(always)]
    fn slopes<F: Lanes>(
        &self,
        token: F::Token,
        points: V3<F>,
        normals: V3<F>,
        views: V3<F>,
    ) -> (V3<F>, Option<V3<F>>, F) {
        let (points, normals) = (points.to_lanes(), normals.to_lanes());
        let [mut slope, mut across, mut steepest] = [[Vec3::ZERO; MAX_WIDTH]; 3];
        for lane in 0..F::WIDTH {
            [slope[lane], across[lane], steepest[lane]] = self.slope(points[lane], normals[lane]);
        }
        let [slope, across, steepest] = [slope, across, steepest].map(
            #[inline(always)]
            |v| V3::<F>::from_lanes(token, &v),
        );
        // The mean of max(0, 1 - s) over an even distribution of s from -u to u.
        let u = steepest.dot(views).abs().max(F::splat(token, 1.0));
        (slope, Some(across), (u + 1.0) * (u + 1.0) / (u * 4.0))
    }

    /// The slope at a point, the unit tangent across the grooves, and the steepest slope.
    fn slope(&self, point: Vec3, normal: Vec3) -> [Vec3; 3] {
        let (path, gradient) = self.path(point, normal);
        let tangent = gradient - normal * normal.dot(gradient);
        let Some(across) = tangent.try_normalize() else {
            return [Vec3::ZERO, normal.any_orthonormal_vector(), Vec3::ZERO];
        };
        let (phase, steepest) = (path / self.feed, tangent * (4.0 * self.height / self.feed));
        [steepest * (2.0 * (phase - phase.floor() - 0.5)), across, steepest]
    }
}

/// Number of waves of a random height field.
const WAVES: usize = 48;
/// Fractional parts of the powers of the plastic number: additive recurrences that fill a square evenly (Roberts 2018).
pub(crate) const PLASTIC: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];

/// A Gaussian height field: plane waves of random phases (Rice 1944).
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct Waves {
    /// Wave vectors [1/m], in cycles.
    vectors: Vec<Vec3>,
    /// Phases in cycles.
    phases: Vec<f32>,
    /// Amplitude \[m\].
    amplitudes: Vec<f32>,
    /// The unit direction of the grooves, if there are any.
    along: Option<Vec3>,
    /// The covariance of the slopes.
    covariance: Mat3,
}

impl Waves {
    /// Waves from half to twice a length \[m\], all with the same slope. With grooves of a length \[m\] along a direction the wave
    /// vectors are perpendicular to it but for the reciprocal of that length.
    fn new(size: f32, grooves: Option<(Vec3, f32)>, mean_deviation: f32, seed: u64) -> Self {
        let start = [0, 1].map(|axis| unit(seed, axis));
        let (mut vectors, mut phases, mut amplitudes) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..WAVES {
            let [u, v] = [0, 1].map(|axis| (start[axis] + i as f32 * PLASTIC[axis] as f32).fract());
            let frequency = pow(2.0, 2.0 * (i as f32 + unit(seed, 2 + 2 * i as u64)) / WAVES as f32 - 1.0) / size;
            let (cos, sin) = cos_sin_of_turn(u);
            vectors.push(match grooves {
                Some((along, length)) => {
                    let (x, y) = along.any_orthonormal_pair();
                    (x * cos + y * sin) * frequency + along * ((2.0 * v - 1.0) / length)
                }
                None => {
                    let z: f32 = 2.0 * v - 1.0;
                    let r = (1.0 - z * z).sqrt();
                    Vec3::new(r * cos, r * sin, z) * frequency
                }
            });
            phases.push(unit(seed, 3 + 2 * i as u64));
            amplitudes.push(1.0 / frequency);
        }
        // A Gaussian height has the mean deviation sqrt(2 / pi) times its standard deviation.
        let squares: f32 = amplitudes.iter().map(|a| 0.5 * a * a).sum();
        let scale = mean_deviation * (0.5 * PI / squares).sqrt();
        amplitudes.iter_mut().for_each(|a| *a *= scale);
        let of_wave = |(v, a): (&Vec3, &f32)| Mat3::from_cols(*v * v.x, *v * v.y, *v * v.z) * (0.5 * TAU * TAU * a * a);
        let covariance = vectors.iter().zip(&amplitudes).map(of_wave).sum();
        Self { vectors, phases, amplitudes, along: grooves.map(|(along, _)| along), covariance }
    }

    /// Slopes, tangents across, and means of visible areas.
    #[inline(always)]
    fn slopes<F: Lanes>(
        &self,
        token: F::Token,
        points: V3<F>,
        normals: V3<F>,
        views: V3<F>,
    ) -> (V3<F>, Option<V3<F>>, F) {
        let across = self.along.map(
            #[inline(always)]
            |along| normals.cross(V3::splat(token, along)).normalize_or(Frame::from_normal(normals).tangent),
        );
        let mut slope = V3::splat(token, Vec3::ZERO);
        for ((vector, phase), amplitude) in self.vectors.iter().zip(&self.phases).zip(&self.amplitudes) {
            let vector = V3::splat(token, *vector);
            let turns = vector.dot(points) + *phase;
            let (_, sin) = cos_sin_of_turn(turns - turns.floor());
            slope = slope - vector * (sin * (TAU * amplitude));
        }
        let tangential = views - normals * normals.dot(views);
        let Mat3 { x_axis, y_axis, z_axis } = self.covariance;
        let of_axis = [x_axis, y_axis, z_axis].map(
            #[inline(always)]
            |column| V3::splat(token, column).dot(tangential),
        );
        let [x, y, z] = of_axis;
        let deviation = V3::new(x, y, z).dot(tangential).max(F::splat(token, 0.0)).sqrt();
        (slope - normals * normals.dot(slope), across, mean_visible(deviation))
    }
}

/// The mean of max(0, 1 - s) over a normal distribution of s with a standard deviation: 1 + Lambda of Smith (1967), in the
/// approximation of Walter et al. (2007), whose error is below 0.4 %.
#[inline(always)]
fn mean_visible<F: Lanes>(deviation: F) -> F {
    let one = deviation.constant(1.0);
    // One over the slope of Beckmann, at most 1.6: there Lambda is 0.
    let a = (deviation * std::f32::consts::SQRT_2).max(deviation.constant(1.0 / 1.6)).recip();
    let lambda = (a * (a * 0.396 + -1.259) + 1.0) / (a * (a * 2.181 + 3.535));
    deviation.gt(deviation.constant(FRAC_1_SQRT_2 / 1.6)).select(lambda + 1.0, one)
}

/// A random number in `[0, 1)` of a seed.
fn unit(seed: u64, number: u64) -> f32 {
    (hash_u64([seed, number]) >> 40) as f32 / 16_777_216.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const UM: f32 = 1e-6;

    impl Marks {
        /// The slope, and the tangent across.
        fn at(&self, point: Vec3, normal: Vec3) -> [Vec3; 2] {
            let Slopes { slope, across, .. } = self.slopes::<f32>((), (point.into(), normal.into()), normal.into());
            let across = across.map_or_else(|| normal.any_orthonormal_vector(), Into::into);
            [slope.into(), across]
        }

        fn height(&self, point: Vec3, normal: Vec3) -> f32 {
            match self {
                Self::Cusps(cusps) => {
                    let phase = cusps.path(point, normal).0 / cusps.feed;
                    4.0 * cusps.height * (phase - phase.floor() - 0.5).powi(2)
                }
                Self::Waves(waves) => {
                    let wave =
                        |((v, phase), a): ((&Vec3, &f32), &f32)| a * cos_sin_of_turn((v.dot(point) + phase).fract()).0;
                    waves.vectors.iter().zip(&waves.phases).zip(&waves.amplitudes).map(wave).sum()
                }
            }
        }
    }

    /// Finishes, each with a normal of its surface, and the variance of the slope across and along that its process states, if
    /// it does.
    fn finishes() -> Vec<(Marks, Vec3, [Option<f32>; 2])> {
        let (ra, feed, width) = (0.8 * UM, 200.0 * UM, 100.0 * UM);
        let of = |process, seed| Marks::new(&Finish { process, mean_deviation: ra, seed });
        let (axis, origin) = (Vec3::Z, Vec3::new(0.011, 0.02, 0.0));
        let direction = Vec3::new(3.0, 1.0, 0.2).normalize();
        // A parabola of height H has slopes evenly from -4 H / feed to 4 H / feed.
        let of_cusps = (4.0 * CUSP_PER_DEVIATION * ra / feed).powi(2) / 3.0;
        // Waves of one slope, whose amplitudes are evenly distributed in the logarithm from half to twice: the mean of their
        // squares is 15 / (16 ln 2) / 2 of the square of the middle one.
        let middle =
            |size: f32| TAU * TAU * 0.5 * PI * ra * ra / (size * size) / (15.0 / (16.0 * std::f32::consts::LN_2));
        let grooved = Process::Grooved { width, length: 0.01, direction };
        vec![
            (of(Process::Milled { feed, radius: 0.025, direction: Vec3::X }, 1), Vec3::Z, [None, Some(0.0)]),
            (of(Process::Turned { feed, axis, origin }, 2), Vec3::Z, [Some(of_cusps), Some(0.0)]),
            (of(Process::Turned { feed, axis, origin }, 3), Vec3::Y, [Some(of_cusps), Some(0.0)]),
            // On a surface along the grooves, half of the slope of each wave lies across.
            (of(grooved, 4), direction.any_orthonormal_vector(), [Some(middle(width) / 2.0), None]),
            (of(Process::Grained { size: width }, 5), Vec3::new(1.0, 2.0, 2.0) / 3.0, [Some(middle(width) / 3.0); 2]),
        ]
    }

    /// Random points of a square of 64 mm on the plane through a point with a normal.
    fn points(normal: Vec3) -> impl Iterator<Item = Vec3> {
        let (u, v) = normal.any_orthonormal_pair();
        let place = |i: u64| 0.064 * unit(99, i);
        (0..200_000).map(move |i| Vec3::new(0.004, 0.001, 0.003) + u * place(2 * i) + v * place(2 * i + 1))
    }

    fn mean(values: impl Iterator<Item = f32>) -> f32 {
        let (sum, n) = values.fold((0.0, 0u32), |(sum, n), v| (sum + f64::from(v), n + 1));
        (sum / f64::from(n)) as f32
    }

    /// The mean deviation is that of the description, and the slopes have the variance that follows from the process.
    #[test]
    fn heights_and_slopes_are_as_stated() {
        for (i, (relief, normal, stated)) in finishes().into_iter().enumerate() {
            let height = |p| relief.height(p, normal);
            let level = mean(points(normal).map(height));
            let ra = mean(points(normal).map(|p| (height(p) - level).abs()));
            assert!((ra / (0.8 * UM) - 1.0).abs() < 0.03, "{i}: Ra {ra}");
            let squares = |along: bool| {
                mean(points(normal).map(|p| {
                    let [slope, across] = relief.at(p, normal);
                    slope.dot(if along { normal.cross(across) } else { across }).powi(2)
                }))
            };
            for (along, stated) in [false, true].into_iter().zip(stated) {
                let Some(stated) = stated else { continue };
                let found = squares(along);
                assert!((found - stated).abs() <= 0.05 * stated + 1e-9, "{i}: slope {found}, stated {stated}");
            }
        }
    }

    /// The slope of a point is the derivative of the height.
    #[test]
    fn slopes_are_derivatives() {
        for (i, (relief, normal, _)) in finishes().into_iter().enumerate() {
            let step = 0.5 * UM;
            let misses = points(normal).step_by(401).filter(|&p| {
                let [slope, across] = relief.at(p, normal);
                let along = |axis: Vec3| {
                    (relief.height(p + axis * step, normal) - relief.height(p - axis * step, normal)) / (2.0 * step)
                };
                let axes = [across, normal.cross(across)];
                axes.iter().any(|&axis| (along(axis) - slope.dot(axis)).abs() > 4e-3)
            });
            // A step over a cusp has no derivative.
            assert!(misses.count() < 20, "{i}");
        }
    }
}
