//! Does a sampler follow the density it claims? One harness for everything that maps to a square or to the sphere.

use crate::artefact::write_csv;
use crate::{Outcome, chi_squared};
use std::f64::consts::{PI, TAU};

/// A chi-squared test of a sampler against its density over a grid of cells.
///
/// A point of the unit square describes the sampled value (see [`direction_to_square`] for directions). A sampler
/// may give nothing; the density must then integrate to one minus the share of nothing, which is tested as well.
#[derive(Clone, Copy, Debug)]
pub struct DensityTest {
    /// Cells along the first coordinate.
    pub columns: usize,
    /// Cells along the second coordinate.
    pub rows: usize,
    /// Number of samples drawn.
    pub samples: u64,
}

impl Default for DensityTest {
    /// 24 x 16 cells, 100 000 samples.
    fn default() -> Self {
        Self { columns: 24, rows: 16, samples: 100_000 }
    }
}

impl DensityTest {
    /// Draws samples and compares their histogram with the integral of `density` (with respect to the area of the unit
    /// square) over each cell. On a suspicious result (p below 1e-6) the table of cells is stored and named in the
    /// message.
    pub fn run(
        &self,
        name: &str,
        mut sample: impl FnMut() -> Option<[f64; 2]>,
        density: impl Fn([f64; 2]) -> f64,
    ) -> Outcome {
        let (nx, ny) = (self.columns.max(1), self.rows.max(1));
        let mut observed = vec![0u64; nx * ny + 1];
        for _ in 0..self.samples {
            let cell = match sample() {
                Some([x, y]) if (0.0..=1.0).contains(&x) && (0.0..=1.0).contains(&y) => {
                    ((y * ny as f64) as usize).min(ny - 1) * nx + ((x * nx as f64) as usize).min(nx - 1)
                }
                Some(p) => return Outcome::impossible(format!("sample {p:?} lies outside the unit square")),
                None => nx * ny,
            };
            observed[cell] += 1;
        }
        let n = self.samples as f64;
        // A thousandth of the standard deviation of the smallest cell that counts.
        let tolerance = 2e-3 / n;
        let mut expected = Vec::with_capacity(observed.len());
        for j in 0..ny {
            for i in 0..nx {
                let low = [i as f64 / nx as f64, j as f64 / ny as f64];
                let high = [(i + 1) as f64 / nx as f64, (j + 1) as f64 / ny as f64];
                expected.push(n * refine(&density, low, high, gauss(&density, low, high), tolerance, ENOUGH, 8));
            }
        }
        let total: f64 = expected.iter().sum();
        // Rounding and quadrature may leave a little; a standard deviation of the count is sqrt(n).
        let rest = n - total;
        if rest.is_nan() || rest < -(1e-4 * n).max(0.1 * n.sqrt()) {
            return Outcome::impossible(format!("{name}: the density integrates to {}, more than one", total / n));
        }
        let nothing = observed[nx * ny];
        let silent = rest < (1e-4 * n).max(0.1 * n.sqrt()) && (nothing as f64) < (1e-3 * n).max(5.0);
        if silent {
            observed.pop();
        } else {
            expected.push(rest.max(0.0));
        }
        let mut outcome = chi_squared(&observed, &expected);
        outcome.message = format!("{name}: {}; the density integrates to {:.6}", outcome.message, total / n);
        if outcome.p_value < 1e-6 {
            let rows = observed.iter().zip(&expected).enumerate().map(|(i, (&o, &e))| {
                vec![(i % nx) as f64, (i / nx) as f64, o as f64, e, (o as f64 - e) / e.max(1e-30).sqrt()]
            });
            let place = write_csv(name, "column,row,observed,expected,deviation", rows);
            outcome.message = format!("{}; {place}", outcome.message);
        }
        outcome
    }
}

/// A direction as a point of the unit square, equal areas for equal solid angles: `x` is the azimuth in turns, `y` is
/// `(1 + z) / 2`, so that a horizon lies on a border of cells when the rows are even. A density per steradian becomes
/// one per area by the factor 4 pi.
pub fn direction_to_square([x, y, z]: [f32; 3]) -> [f64; 2] {
    let turn = f64::from(y).atan2(f64::from(x)) / TAU;
    [turn - turn.floor(), (0.5 + 0.5 * f64::from(z)).clamp(0.0, 1.0)]
}

/// The inverse of [`direction_to_square`], in f64.
pub fn square_to_direction([x, y]: [f64; 2]) -> [f64; 3] {
    let z = 2.0 * y - 1.0;
    let r = (4.0 * y * (1.0 - y)).max(0.0).sqrt();
    let (s, c) = (2.0 * PI * x).sin_cos();
    [r * c, r * s, z]
}

/// Integral of `f` over a rectangle to the absolute `tolerance`, by adaptive Gauss-Legendre cubature; two to eight
/// subdivisions, so that a jump is resolved to a 256th of the rectangle. A peak much narrower than a tenth of it may
/// be missed: divide first.
pub fn integrate_square(f: &impl Fn([f64; 2]) -> f64, low: [f64; 2], high: [f64; 2], tolerance: f64) -> f64 {
    refine(f, low, high, gauss(f, low, high), tolerance, 1e-5, 8)
}

/// Relative change at which a cell of a histogram is divided no further: the fourth part of a standard deviation for 10^4
/// counts, and more than what f32 leaves undecided on a peak of 1e7 / sr. What the finer sum is off by is far less.
const ENOUGH: f64 = 2e-3;

fn refine(
    f: &impl Fn([f64; 2]) -> f64,
    a: [f64; 2],
    b: [f64; 2],
    whole: f64,
    tolerance: f64,
    relative: f64,
    depth: u32,
) -> f64 {
    let m = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
    let quarters = [(a, m), ([m[0], a[1]], [b[0], m[1]]), ([a[0], m[1]], [m[0], b[1]]), (m, b)];
    let parts = quarters.map(|(a, b)| gauss(f, a, b));
    let sum: f64 = parts.iter().sum();
    if depth == 0 || (depth < 7 && (sum - whole).abs() <= tolerance.max(relative * sum.abs())) {
        return sum;
    }
    quarters.into_iter().zip(parts).map(|((a, b), p)| refine(f, a, b, p, 0.5 * tolerance, relative, depth - 1)).sum()
}

/// Gauss-Legendre, 4 x 4 points.
fn gauss(f: &impl Fn([f64; 2]) -> f64, a: [f64; 2], b: [f64; 2]) -> f64 {
    const NODES: [(f64, f64); 4] = [
        (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
        (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
        (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
        (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    ];
    let half = [0.5 * (b[0] - a[0]), 0.5 * (b[1] - a[1])];
    let mut sum = 0.0;
    for (x, wx) in NODES {
        for (y, wy) in NODES {
            sum += wx * wy * f([a[0] + half[0] * (1.0 + x), a[1] + half[1] * (1.0 + y)]);
        }
    }
    sum * half[0] * half[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small generator, so that this crate needs no other (Marsaglia 2003).
    fn xorshift(state: &mut u64) -> f64 {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        (*state >> 11) as f64 / (1u64 << 53) as f64
    }

    #[test]
    fn cubature_resolves_peaks_and_jumps() {
        let peak = |[x, y]: [f64; 2]| (-((x - 0.3).powi(2) + (y - 0.6).powi(2)) / 5e-3).exp() / (5e-3 * PI);
        assert!((integrate_square(&peak, [0.0; 2], [1.0; 2], 1e-7) - 1.0).abs() < 1e-4);
        let disk = |[x, y]: [f64; 2]| f64::from(x * x + y * y < 1.0);
        assert!((integrate_square(&disk, [0.0; 2], [1.0; 2], 1e-6) - PI / 4.0).abs() < 2e-4);
    }

    #[test]
    fn a_right_density_passes_and_wrong_ones_fail() {
        let mut state = 42;
        // Density 2x, sampled by sqrt(u); a tenth of the samples is lost.
        let mut draw = || {
            let (u, v, w) = (xorshift(&mut state), xorshift(&mut state), xorshift(&mut state));
            (w >= 0.1).then(|| [u.sqrt(), v])
        };
        let test = DensityTest { columns: 8, rows: 8, samples: 50_000 };
        assert!(test.run("self test right", &mut draw, |[x, _]| 0.9 * 2.0 * x).p_value > 1e-6);
        assert!(test.run("self test total", &mut draw, |[x, _]| 2.0 * x).p_value < 1e-12);
        assert!(test.run("self test shape", &mut draw, |[x, _]| 0.9 * (1.9 * x + 0.05)).p_value < 1e-6);
        assert!(test.run("self test excess", &mut draw, |[x, _]| 2.2 * x).p_value == 0.0);
    }
}
