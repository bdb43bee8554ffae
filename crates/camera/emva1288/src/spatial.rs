//! Spatial variances and their split into pixels, rows and columns (EMVA 1288 release 4.0 Linear, section 8).

use crate::stack::SpatialStack;

/// Non-uniformity statistics of a mean image, as numbers whose errors are independent of each other: the analysis of
/// variance of an image by rows and columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spatial {
    pub(crate) mean: f64,
    /// Rows M and columns N.
    pub(crate) rows: f64,
    pub(crate) columns: f64,
    pub(crate) frames: f64,
    /// Temporal variance of one frame \[DN^2\].
    pub(crate) temporal: Estimate,
    /// Variance of the residuals after row and column means are subtracted.
    pub(crate) residual: Estimate,
    /// Variance of the columns' means, and of the rows' means.
    pub(crate) column_means: Estimate,
    pub(crate) row_means: Estimate,
}

/// A number and its standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Estimate {
    pub(crate) value: f64,
    pub(crate) error: f64,
}

/// The spatial variances of the standard \[DN^2\], less the noise that is left in the mean image. They may be negative
/// if there is no non-uniformity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Variances {
    pub(crate) total: f64,
    pub(crate) pixel: f64,
    pub(crate) row: f64,
    pub(crate) column: f64,
}

/// The similarity of the patterns of two images, as correlations of residuals, column means and row means.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Likeness {
    pub(crate) residual: f64,
    pub(crate) column_means: f64,
    pub(crate) row_means: f64,
}

impl Spatial {
    pub(crate) fn from_stacks(stack: &SpatialStack) -> Self {
        let (m, n) = (f64::from(stack.height), f64::from(stack.width));
        let (columns, rows) = stack.profiles();
        let (mut second, mut fourth) = (0.0, 0.0);
        for r in residuals(stack, &columns, &rows) {
            second += r * r;
            fourth += r * r * r * r;
        }
        let freedom = (m - 1.0) * (n - 1.0);
        let residual = second / freedom;
        // The formula assumes no distribution, since defect pixels cause tails.
        let spread = (fourth / (m * n) - residual * residual).max(0.0);
        let variance_of = |means: &[f64]| {
            let freedom = means.len() as f64 - 1.0;
            let value = means.iter().map(|v| v * v).sum::<f64>() / freedom;
            Estimate { value, error: value * (2.0 / freedom).sqrt() }
        };
        let l = f64::from(stack.frames);
        let temporal = stack.temporal_variance;
        Self {
            mean: stack.mean,
            rows: m,
            columns: n,
            frames: l,
            temporal: Estimate { value: temporal, error: temporal * (2.0 / ((l - 1.0) * m * n)).sqrt() },
            residual: Estimate { value: residual, error: (spread / (m * n)).sqrt() },
            column_means: variance_of(&columns),
            row_means: variance_of(&rows),
        }
    }

    /// Variances of pixels, rows and columns, and of all together.
    ///
    /// Row and column means contain a part of the pixels' variance and of the noise. The formulas solve for the parts.
    pub(crate) fn split(&self) -> Variances {
        let (m, n, noise) = (self.rows, self.columns, self.temporal.value / self.frames);
        let squares = (m - 1.0) * (n - 1.0) * self.residual.value
            + m * (n - 1.0) * self.column_means.value
            + n * (m - 1.0) * self.row_means.value;
        let total = squares / (m * n - 1.0) - noise;
        // The standard divides by the number of means, not by the number less one.
        let cav = self.column_means.value * (n - 1.0) / n - noise / m;
        let rav = self.row_means.value * (m - 1.0) / m - noise / n;
        let d = m * n - m - n;
        Variances {
            total,
            pixel: m * n / d * (total - cav - rav),
            row: (m * n - n) / d * rav - m / d * (total - cav),
            column: (m * n - m) / d * cav - n / d * (total - rav),
        }
    }
}

impl Likeness {
    /// The correlations of two stacks of one size.
    pub(crate) fn from_stacks(a: &SpatialStack, b: &SpatialStack) -> Self {
        let ((a_columns, a_rows), (b_columns, b_rows)) = (a.profiles(), b.profiles());
        Self {
            residual: correlation(residuals(a, &a_columns, &a_rows).zip(residuals(b, &b_columns, &b_rows))),
            column_means: correlation(a_columns.iter().copied().zip(b_columns.iter().copied())),
            row_means: correlation(a_rows.iter().copied().zip(b_rows.iter().copied())),
        }
    }
}

/// The residual of each pixel after the means of its row and column are subtracted.
fn residuals<'a>(stack: &'a SpatialStack, columns: &'a [f64], rows: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
    let width = stack.width as usize;
    stack.means().enumerate().map(move |(i, y)| y - stack.mean - columns[i % width] - rows[i / width])
}

/// The correlation of pairs whose means are zero.
fn correlation(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (a, b) in pairs {
        aa += a * a;
        bb += b * b;
        ab += a * b;
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::tests::still;

    /// A calculation by hand: 3 x 3 pixels, s^2 = 1, cav = 0.5, rav = 0.25 and no noise. D = 3.
    #[test]
    fn the_split_by_hand() {
        let exact = |value| Estimate { value, error: 0.0 };
        // cav = column_means * 2 / 3. The residual makes the sum of squares 8.
        let s = Spatial {
            mean: 0.0,
            rows: 3.0,
            columns: 3.0,
            frames: 2.0,
            temporal: exact(0.0),
            residual: exact((8.0 - 6.0 * 0.75 - 6.0 * 0.375) / 4.0),
            column_means: exact(0.75),
            row_means: exact(0.375),
        };
        let v = s.split();
        assert!((v.total - 1.0).abs() < 1e-12);
        assert!((v.pixel - 3.0 * 0.25).abs() < 1e-12, "{v:?}");
        assert!((v.column - (2.0 * 0.5 - 0.75)).abs() < 1e-12, "{v:?}");
        assert!((v.row - (2.0 * 0.25 - 0.5)).abs() < 1e-12, "{v:?}");
    }

    #[test]
    fn a_pattern_is_like_itself_and_unlike_another() {
        let hash = |x: u32, y: u32, k: u32| {
            let mut h = (x * 7919 + y * 104_729 + k).wrapping_mul(2_654_435_761);
            h ^= h >> 15;
            (h.wrapping_mul(2_246_822_519) >> 20) as u16 % 100
        };
        let a = still(50, 40, |x, y| hash(x, y, 1));
        let b = still(50, 40, |x, y| 2 * hash(x, y, 1) + 5);
        let c = still(50, 40, |x, y| hash(x, y, 77));
        let same = Likeness::from_stacks(&a, &b);
        assert!((same.residual - 1.0).abs() < 1e-9 && (same.row_means - 1.0).abs() < 1e-9, "{same:?}");
        assert!(Likeness::from_stacks(&a, &c).residual.abs() < 0.15);
    }
}
