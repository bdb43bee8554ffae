//! Random numbers in f64 from a stream.

use dunkelfeld_geometry::{DMat3, DQuat, DVec3};
use dunkelfeld_sampling::Pcg;
use std::f64::consts::TAU;

pub(super) use crate::draws::uniform;

/// A uniform number in `[low, high)`.
pub(super) fn between(stream: &mut Pcg, low: f64, high: f64) -> f64 {
    low + (high - low) * uniform(stream)
}

/// A uniform angle in `[0, 2 pi)` \[rad\].
pub(super) fn angle(stream: &mut Pcg) -> f64 {
    TAU * uniform(stream)
}

/// A uniform index below `count`; 0 if `count` is 0.
pub(super) fn index(stream: &mut Pcg, count: usize) -> usize {
    ((uniform(stream) * count as f64) as usize).min(count.saturating_sub(1))
}

/// An entry with a probability in proportion to its weight. `cumulative` contains the sums of the weights up to and
/// with each entry, and is not empty. Entries of weight zero are not drawn.
pub(super) fn entry(stream: &mut Pcg, cumulative: &[f64]) -> usize {
    let total = cumulative.last().copied().unwrap_or(0.0);
    let u = uniform(stream) * total;
    let found = cumulative.partition_point(|sum| *sum <= u);
    // Rounding of the product can give the total. The last entry with a weight is where the total is first reached.
    if found < cumulative.len() { found } else { cumulative.partition_point(|sum| *sum < total) }
}

/// A uniform unit vector (Archimedes: the height on a sphere is uniform).
pub(super) fn direction(stream: &mut Pcg) -> DVec3 {
    let z = between(stream, -1.0, 1.0);
    let (sin, cos) = angle(stream).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(r * cos, r * sin, z)
}

/// A uniform rotation (Shoemake 1992).
pub(super) fn rotation(stream: &mut Pcg) -> DMat3 {
    let u = uniform(stream);
    let (s0, c0) = angle(stream).sin_cos();
    let (s1, c1) = angle(stream).sin_cos();
    let (a, b) = ((1.0 - u).sqrt(), u.sqrt());
    DMat3::from_quat(DQuat::from_xyzw(a * s0, a * c0, b * s1, b * c1).normalize())
}

/// A smooth random function of period 1 with mean zero: a sum of harmonics whose amplitudes decrease with their
/// number.
pub(super) struct Harmonics {
    /// Number of periods, amplitude and phase \[rad\] of each harmonic.
    waves: Vec<[f64; 3]>,
}

impl Harmonics {
    /// Harmonics with `first` to `last` periods. The amplitudes are random, at most `amplitude * first / number`.
    pub(super) fn draw(stream: &mut Pcg, first: u32, last: u32, amplitude: f64) -> Self {
        let wave = |k: u32| {
            let size = amplitude * f64::from(first) / f64::from(k) * between(stream, 0.4, 1.0);
            [f64::from(k), size, angle(stream)]
        };
        Self { waves: (first..=last).map(wave).collect() }
    }

    /// The function that is zero.
    pub(super) fn none() -> Self {
        Self { waves: Vec::new() }
    }

    /// The value at `t`.
    pub(super) fn at(&self, t: f64) -> f64 {
        self.waves.iter().map(|[k, size, phase]| size * (TAU * k * t + phase).sin()).sum()
    }
}

/// A smooth random function of two variables with mean zero: plane waves in random directions.
pub(super) struct Waves {
    /// Wave vector \[rad/m\], amplitude and phase \[rad\] of each wave.
    waves: Vec<[f64; 4]>,
}

impl Waves {
    /// Waves from the longest to the shortest of two lengths \[m\], whose amplitudes are proportional to the length and add up to
    /// at most `amplitude`.
    pub(super) fn draw(stream: &mut Pcg, [longest, shortest]: [f64; 2], amplitude: f64) -> Self {
        const COUNT: u32 = 12;
        let wave = |k: u32| {
            let share = (shortest / longest).powf(f64::from(k) / f64::from(COUNT - 1));
            let (sin, cos) = angle(stream).sin_cos();
            let number = TAU / (share * longest);
            [number * cos, number * sin, share, angle(stream)]
        };
        let mut waves: Vec<[f64; 4]> = (0..COUNT).map(wave).collect();
        let sum: f64 = waves.iter().map(|wave| wave[2]).sum();
        waves.iter_mut().for_each(|wave| wave[2] *= amplitude / sum);
        Self { waves }
    }

    /// The value at a place \[m\].
    pub(super) fn at(&self, x: f64, y: f64) -> f64 {
        self.waves.iter().map(|[kx, ky, size, phase]| size * (kx * x + ky * y + phase).sin()).sum()
    }
}
