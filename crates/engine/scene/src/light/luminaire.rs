//! The angular distribution of a luminaire: radiant intensity over a grid of directions, as in an IES file.

use dunkelfeld_geometry::Vec3;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3, atan2};
use std::f64::consts::{PI, TAU};

/// Radiant intensity of a light without extent by direction, bilinear between the angles of a grid.
///
/// In the space of the light, the direction at the vertical angle t and the horizontal angle p is `(sin t cos p, sin t
/// sin p, -cos t)`. t counts from the axis along which the light emits, p from +x over +y (type C photometry with the
/// nadir along -z). Beyond the first and last vertical angle the intensity is zero.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LightProfile {
    name: String,
    /// Ascending \[rad\], in [0, pi].
    vertical: Vec<f32>,
    /// Ascending \[rad\], from 0 to 2 pi; a single 0 if the light has rotational symmetry.
    horizontal: Vec<f32>,
    /// Intensities [W/sr]: all vertical angles for each horizontal one.
    intensity: Vec<f32>,
    power: f32,
    peak: f32,
    cutoff_angle: f32,
}

/// Reason why numbers are no profile.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ProfileError {
    /// The angles are not ascending, or not in their range.
    #[error("the {0} angles must ascend {1}")]
    Angles(&'static str, &'static str),
    /// The number of intensities does not fit the grid.
    #[error("there are {found} intensities where {wanted} belong")]
    Count {
        /// Expected number: vertical times horizontal angles.
        wanted: usize,
        /// Number in the file.
        found: usize,
    },
    /// An intensity is negative or not finite.
    #[error("the intensities must be finite and not negative")]
    Intensity,
}

impl LightProfile {
    /// A profile from vertical angles in degrees (ascending, within 0 to 180, at least two), horizontal angles in
    /// degrees (0 alone, or ascending from 0 to 360) and intensities [W/sr]. The vertical angle runs fastest.
    ///
    /// # Errors
    /// If the angles are not ascending or out of range, if the number of intensities is wrong, or if one is negative or
    /// not finite.
    pub fn new(
        name: impl Into<String>,
        vertical: &[f64],
        horizontal: &[f64],
        intensity: Vec<f32>,
    ) -> Result<Self, ProfileError> {
        let ascends = |angles: &[f64]| angles.windows(2).all(|w| w[0] < w[1]);
        let within = |angles: &[f64], most: f64| angles.iter().all(|a| (0.0..=most).contains(a));
        if vertical.len() < 2 || !ascends(vertical) || !within(vertical, 180.0) {
            return Err(ProfileError::Angles("vertical", "within 0 and 180 degrees, and be two at least"));
        }
        let around = horizontal == [0.0]
            || (ascends(horizontal) && horizontal.first() == Some(&0.0) && horizontal.last() == Some(&360.0));
        if !around {
            return Err(ProfileError::Angles("horizontal", "from 0 to 360 degrees, or be 0 alone"));
        }
        let wanted = vertical.len() * horizontal.len();
        if intensity.len() != wanted {
            return Err(ProfileError::Count { wanted, found: intensity.len() });
        }
        if !intensity.iter().all(|v| v.is_finite() && *v >= 0.0) {
            return Err(ProfileError::Intensity);
        }
        let peak = intensity.iter().copied().fold(0.0, f32::max);
        let radians = |angles: &[f64]| angles.iter().map(|a| a.to_radians()).collect::<Vec<f64>>();
        let (vertical, horizontal) = (radians(vertical), radians(horizontal));
        let power = integrate(&vertical, &horizontal, &intensity) as f32;
        // Light ends at the angle after the last one with an intensity above zero.
        let emits = |i: usize| intensity.chunks(vertical.len()).any(|run| run[i] > 0.0);
        let last = (0..vertical.len()).rev().find(|&i| emits(i)).unwrap_or(0);
        let cutoff_angle = vertical[(last + 1).min(vertical.len() - 1)] as f32;
        let narrow = |angles: Vec<f64>| angles.into_iter().map(|a| a as f32).collect();
        Ok(Self {
            name: name.into(),
            vertical: narrow(vertical),
            horizontal: narrow(horizontal),
            intensity,
            power,
            peak,
            cutoff_angle,
        })
    }

    /// Its name: that of its file.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Total power \[W\]: the integral of the bilinear intensity over the sphere.
    pub fn power(&self) -> f32 {
        self.power
    }

    /// Largest intensity [W/sr].
    pub fn peak(&self) -> f32 {
        self.peak
    }

    /// The vertical angle \[rad\] beyond which the intensity is zero.
    pub fn cutoff_angle(&self) -> f32 {
        self.cutoff_angle
    }

    /// Intensity [W/sr] in a unit direction of the light's space. The direction points away from the light.
    pub fn intensity(&self, direction: Vec3) -> f32 {
        self.intensities::<f32>(direction.into())
    }

    /// [`Self::intensity`] in lanes.
    #[inline(always)]
    pub(crate) fn intensities<F: Lanes>(&self, V3 { x, y, z }: V3<F>) -> F {
        let theta = atan2((x * x + y * y).sqrt(), -z).to_array();
        let phi = atan2(y, x);
        let phi = phi.lt(phi.constant(0.0)).select(phi + TAU as f32, phi).to_array();
        let mut found = [0.0; MAX_WIDTH];
        for lane in 0..F::WIDTH {
            found[lane] = self.intensity_at(theta[lane], phi[lane]);
        }
        F::load(x.token(), &found)
    }

    /// Intensity [W/sr] at a vertical and a horizontal angle \[rad\].
    #[inline]
    fn intensity_at(&self, theta: f32, phi: f32) -> f32 {
        let (Some(&first), Some(&last)) = (self.vertical.first(), self.vertical.last()) else { return 0.0 };
        if !(first..=last).contains(&theta) {
            return 0.0;
        }
        let (i, s) = place(&self.vertical, theta);
        let along = |j: usize| {
            let run = &self.intensity[j * self.vertical.len()..];
            run[i] + s * (run[i + 1] - run[i])
        };
        if self.horizontal.len() == 1 {
            return along(0);
        }
        let (j, t) = place(&self.horizontal, phi);
        along(j) + t * (along(j + 1) - along(j))
    }
}

/// The interval of ascending angles that contains an angle, and the position in it in [0, 1].
#[inline]
fn place(angles: &[f32], angle: f32) -> (usize, f32) {
    let i = angles.partition_point(|a| *a <= angle).clamp(1, angles.len() - 1) - 1;
    (i, ((angle - angles[i]) / (angles[i + 1] - angles[i])).clamp(0.0, 1.0))
}

/// The integral over the sphere of an intensity that is bilinear in the two angles, in closed form. In each interval
/// the weights of the ends are the integrals of `(1 - s) sin t` and `s sin t` along the vertical, and half of the
/// interval around the axis.
fn integrate(vertical: &[f64], horizontal: &[f64], intensity: &[f32]) -> f64 {
    let mut around = vec![0.0; horizontal.len()];
    match horizontal.len() {
        1 => around[0] = TAU,
        n => (1..n).for_each(|j| {
            let half = 0.5 * (horizontal[j] - horizontal[j - 1]);
            around[j - 1] += half;
            around[j] += half;
        }),
    }
    let mut down = vec![0.0; vertical.len()];
    for i in 1..vertical.len() {
        let (a, b) = (vertical[i - 1], vertical[i]);
        let upper = (b.sin() - a.sin()) / (b - a) - b.cos();
        down[i] += upper;
        down[i - 1] += a.cos() - b.cos() - upper;
    }
    debug_assert!((around.iter().sum::<f64>() - 2.0 * PI).abs() < 1e-9);
    let runs = intensity.chunks(vertical.len()).zip(&around);
    runs.map(|(run, w)| w * run.iter().zip(&down).map(|(v, d)| f64::from(*v) * d).sum::<f64>()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn degrees(step: f64, last: f64) -> Vec<f64> {
        (0..=(last / step) as usize).map(|i| i as f64 * step).collect()
    }

    #[test]
    fn the_power_of_bilinear_grids_is_exact() {
        // A constant: 4 pi. Linear in the angle, I = t: 2 pi times the integral of t sin t, which is pi: 2 pi^2.
        for horizontal in [vec![0.0], degrees(90.0, 360.0), vec![0.0, 10.0, 200.0, 360.0]] {
            let vertical = [0.0, 17.0, 90.0, 133.0, 180.0];
            let full = LightProfile::new("c", &vertical, &horizontal, vec![2.0; 5 * horizontal.len()]).unwrap();
            assert!((f64::from(full.power()) / (8.0 * PI) - 1.0).abs() < 1e-6);
            let linear: Vec<f32> = horizontal.iter().flat_map(|_| vertical.map(|t| t.to_radians() as f32)).collect();
            let p = LightProfile::new("t", &vertical, &horizontal, linear).unwrap();
            assert!((f64::from(p.power()) / (2.0 * PI * PI) - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn horizontal_angles_run_from_x_over_y() {
        let vertical = [0.0, 180.0];
        let horizontal = [0.0, 90.0, 180.0, 270.0, 360.0];
        let values = [1.0, 2.0, 3.0, 4.0, 1.0].iter().flat_map(|v| [*v; 2]).collect();
        let p = LightProfile::new("turn", &vertical, &horizontal, values).unwrap();
        for (d, want) in [(Vec3::X, 1.0), (Vec3::Y, 2.0), (-Vec3::X, 3.0), (-Vec3::Y, 4.0)] {
            assert!((p.intensity(d) - want).abs() < 1e-6, "{d}: {}", p.intensity(d));
        }
        assert!((p.intensity(Vec3::new(1.0, 1.0, 0.0).normalize()) - 1.5).abs() < 1e-6);
        assert!((p.intensity(Vec3::new(1.0, -1.0, 0.0).normalize()) - 2.5).abs() < 1e-6);
    }
}
