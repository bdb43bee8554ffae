//! Piecewise-constant distributions over a line and over a rectangle: light selection, environment maps.

/// Result of a discrete draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Index of the entry.
    pub index: usize,
    /// Its probability.
    pub probability: f32,
    /// A uniform number in `[0, 1)` for further use: the position within the entry's share.
    pub remapped: f32,
}

/// A discrete distribution over n entries, and the piecewise-constant density over `[0, 1)` with n equal steps.
///
/// Weights that are negative or not finite count as zero. If all weights are zero, the distribution is uniform, so that
/// a scene with dark lights only can still be sampled. Without weights it has one entry. Sums are f64, so that ten
/// thousand lights with a range of 1e12 keep their shares.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Distribution1D {
    /// n + 1 values, from 0 to exactly 1.
    cdf: Box<[f64]>,
    sum: f64,
}

impl Distribution1D {
    /// Normalises the weights.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Self {
        let mut cdf = vec![0.0];
        let mut sum = 0.0;
        for w in weights {
            sum += usable(w);
            cdf.push(sum);
        }
        if cdf.len() == 1 {
            cdf.push(0.0);
        }
        normalise(&mut cdf, sum);
        Self { cdf: cdf.into(), sum }
    }

    /// Number of entries, at least one.
    #[inline]
    pub fn len(&self) -> usize {
        self.cdf.len() - 1
    }

    /// Always false; a distribution has at least one entry.
    #[inline]
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Sum of the usable weights, zero if the distribution fell back to uniform.
    #[inline]
    pub fn sum(&self) -> f64 {
        self.sum
    }

    /// Draws an entry with probability proportional to its weight. Entries of probability zero are never drawn.
    #[inline]
    pub fn sample_discrete(&self, u: f32) -> Choice {
        let u = f64::from(u);
        let index = locate(self.len(), |i| self.cdf[i] <= u);
        let (low, share) = (self.cdf[index], self.cdf[index + 1] - self.cdf[index]);
        Choice { index, probability: share as f32, remapped: below_one(((u - low) / share) as f32) }
    }

    /// Probability of an entry; zero beyond the last.
    #[inline]
    pub fn pdf_discrete(&self, index: usize) -> f32 {
        if index < self.len() { (self.cdf[index + 1] - self.cdf[index]) as f32 } else { 0.0 }
    }

    /// Draws a point of `[0, 1)`; returns it with its density.
    #[inline]
    pub fn sample_continuous(&self, u: f32) -> (f32, f32) {
        let c = self.sample_discrete(u);
        let n = self.len() as f32;
        (below_one((c.index as f32 + c.remapped) / n), c.probability * n)
    }

    /// Density of [`Self::sample_continuous`] at `x`; zero outside `[0, 1)`.
    #[inline]
    pub fn pdf_continuous(&self, x: f32) -> f32 {
        if (0.0..1.0).contains(&x) { self.pdf_discrete(self.entry_at(x)) * self.len() as f32 } else { 0.0 }
    }

    /// The uniform number that gives a point in [`Self::sample_continuous`].
    #[inline]
    pub fn invert_continuous(&self, x: f32) -> f32 {
        let i = self.entry_at(x);
        let t = (f64::from(x) * self.len() as f64 - i as f64).clamp(0.0, 1.0);
        below_one((self.cdf[i] + t * (self.cdf[i + 1] - self.cdf[i])) as f32)
    }

    #[inline]
    fn entry_at(&self, x: f32) -> usize {
        ((x * self.len() as f32) as usize).min(self.len() - 1)
    }
}

/// The piecewise-constant density over the unit square in proportion to a grid of weights, such as an environment map.
///
/// Rows are stacked along the second coordinate. Unusable weights and all-zero grids are treated as in
/// [`Distribution1D`]. Within a row the cumulative sums are computed in f64 and stored in f32 (an 8192 x 4096 map takes
/// 128 MB). Densities are computed from the stored sums, so they are exactly those of the sampling.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Distribution2D {
    width: usize,
    /// `height` rows of `width + 1` values from 0 to exactly 1.
    rows: Box<[f32]>,
    marginal: Distribution1D,
}

impl Distribution2D {
    /// From `width` x `height` weights in row-major order. Missing weights count as zero, surplus ones are ignored; a
    /// width or height of zero counts as one.
    pub fn new(width: usize, height: usize, weights: impl IntoIterator<Item = f64>) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        let mut weights = weights.into_iter();
        let mut rows = Vec::with_capacity((width + 1) * height);
        let mut sums = Vec::with_capacity(height);
        let mut row = vec![0.0; width + 1];
        for _ in 0..height {
            let mut sum = 0.0;
            for cell in &mut row[1..] {
                sum += usable(weights.next().unwrap_or(0.0));
                *cell = sum;
            }
            normalise(&mut row, sum);
            rows.extend(row.iter().map(|&c| c as f32));
            sums.push(sum);
        }
        Self { width, rows: rows.into(), marginal: Distribution1D::new(sums) }
    }

    /// Number of columns and rows.
    #[inline]
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.marginal.len()]
    }

    /// Sum of the usable weights, zero if the distribution fell back to uniform.
    #[inline]
    pub fn sum(&self) -> f64 {
        self.marginal.sum()
    }

    /// Draws a point of the unit square; returns it with its density per unit area.
    #[inline]
    pub fn sample_continuous(&self, [u0, u1]: [f32; 2]) -> ([f32; 2], f32) {
        let c = self.marginal.sample_discrete(u1);
        let row = self.row(c.index);
        let i = locate(self.width, |i| row[i] <= u0);
        let share = row[i + 1] - row[i];
        let (w, h) = (self.width as f32, self.marginal.len() as f32);
        let x = below_one((i as f32 + below_one((u0 - row[i]) / share)) / w);
        let y = below_one((c.index as f32 + c.remapped) / h);
        ([x, y], share * w * c.probability * h)
    }

    /// Density of [`Self::sample_continuous`] at a point; zero outside the unit square.
    #[inline]
    pub fn pdf_continuous(&self, [x, y]: [f32; 2]) -> f32 {
        if !(0.0..1.0).contains(&x) || !(0.0..1.0).contains(&y) {
            return 0.0;
        }
        let j = self.marginal.entry_at(y);
        let (i, row) = (self.column_at(x), self.row(j));
        (row[i + 1] - row[i]) * self.width as f32 * self.marginal.pdf_discrete(j) * self.marginal.len() as f32
    }

    /// The uniform numbers that give a point in [`Self::sample_continuous`].
    #[inline]
    pub fn invert_continuous(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let row = self.row(self.marginal.entry_at(y));
        let i = self.column_at(x);
        let t = (x * self.width as f32 - i as f32).clamp(0.0, 1.0);
        [below_one(row[i] + t * (row[i + 1] - row[i])), self.marginal.invert_continuous(y)]
    }

    #[inline]
    fn row(&self, j: usize) -> &[f32] {
        &self.rows[j * (self.width + 1)..(j + 1) * (self.width + 1)]
    }

    #[inline]
    fn column_at(&self, x: f32) -> usize {
        ((x * self.width as f32) as usize).min(self.width - 1)
    }
}

/// The weight if it is finite and not negative, else zero.
fn usable(w: f64) -> f64 {
    if w.is_finite() { w.max(0.0) } else { 0.0 }
}

/// Divides cumulative sums by their total, or makes them uniform if the total is zero or not finite.
fn normalise(cdf: &mut [f64], sum: f64) {
    let n = cdf.len() - 1;
    let scale = 1.0 / sum;
    let serves = sum > 0.0 && sum.is_finite() && scale.is_finite();
    for (i, c) in cdf.iter_mut().enumerate() {
        *c = if serves { (*c * scale).min(1.0) } else { i as f64 / n as f64 };
    }
    // The sums from the last used entry on must all be 1 exactly, or a draw near 1 would land on an unused entry.
    let last = cdf[n];
    for c in cdf.iter_mut().rev().take_while(|c| **c == last) {
        *c = 1.0;
    }
}

/// The last of `0..n` for which `holds` is true. It must be true for 0, and after the first false one it must stay
/// false.
#[inline]
fn locate(n: usize, holds: impl Fn(usize) -> bool) -> usize {
    let (mut low, mut size) = (0, n);
    while size > 1 {
        let half = size / 2;
        if holds(low + half) {
            low += half;
        }
        size -= half;
    }
    low
}

/// Clamps a quotient below 1, because rounding may have raised it to 1.
#[inline]
fn below_one(x: f32) -> f32 {
    x.clamp(0.0, 1.0 - f32::EPSILON / 2.0)
}
