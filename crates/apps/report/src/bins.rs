//! Bins of a histogram, and quantiles of numbers.

/// Maximum number of bins with one whole number each.
const WHOLE: f64 = 24.0;
/// Positive numbers that extend over more than this factor, most of them at its lower end, have logarithmic bins.
const FACTOR: f64 = 20.0;

/// A histogram: equal bins on a linear or a logarithmic axis. A bin contains its lower edge. The last one contains both.
#[derive(Clone, Debug, PartialEq)]
pub struct Bins {
    /// The lowest edge.
    pub low: f64,
    /// The highest edge.
    pub high: f64,
    /// Is the axis logarithmic? Then both edges are positive.
    pub is_log: bool,
    /// Does each bin contain one whole number, in its middle?
    pub is_whole: bool,
    /// The number of values in each bin.
    pub counts: Vec<u64>,
}

impl Bins {
    /// Bins that suit the numbers. Numbers that are not finite are left out.
    pub fn of(values: &[f64]) -> Self {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let (Some(&low), Some(&high)) = (sorted.first(), sorted.last()) else {
            return Self { low: 0.0, high: 1.0, is_log: false, is_whole: false, counts: vec![0] };
        };
        if sorted.iter().all(|v| v.fract() == 0.0) && high - low < WHOLE {
            let n = (high - low) as usize + 1;
            let mut bins = Self::within(&sorted, low - 0.5, high + 0.5, n, false);
            bins.is_whole = true;
            return bins;
        }
        let n = ((sorted.len() as f64).sqrt().ceil() as usize).clamp(5, 24);
        if low == high {
            let room = if low == 0.0 { 0.5 } else { 0.5 * low.abs() };
            return Self::within(&sorted, low - room, high + room, n | 1, false);
        }
        let middle = quantile(&sorted, 0.5);
        let is_log = low > 0.0 && high / low > FACTOR && middle - low < 0.2 * (high - low);
        Self::within(&sorted, low, high, n, is_log)
    }

    /// A number of bins from `low` to `high`. Numbers outside are left out. The ends of logarithmic bins are positive.
    pub fn within(values: &[f64], low: f64, high: f64, n: usize, is_log: bool) -> Self {
        let n = n.max(1);
        let mut counts = vec![0; n];
        let place = |v: f64| if is_log { v.ln() } else { v };
        // Halves of the ends do not overflow.
        let [from, to] = [0.5 * place(low), 0.5 * place(high)];
        for v in values.iter().copied().filter(|v| (low..=high).contains(v)) {
            let share = (0.5 * place(v) - from) / (to - from);
            // Rounding must not move a number on an edge into the bin below.
            let at = (share * n as f64 + 1e-9).floor().max(0.0) as usize;
            counts[at.min(n - 1)] += 1;
        }
        Self { low, high, is_log, is_whole: false, counts }
    }

    /// The lower and the upper edge of a bin, counted from 0.
    pub fn edges(&self, bin: usize) -> [f64; 2] {
        let n = self.counts.len() as f64;
        [bin, bin + 1].map(|i| {
            let share = i as f64 / n;
            match self.is_log {
                true => self.low * (self.high / self.low).powf(share),
                false => self.low * (1.0 - share) + self.high * share,
            }
        })
    }
}

/// A quantile of sorted numbers, linear between the nearest two of them. `share` is from 0 (the lowest) to 1 (the
/// highest). NaN if there are none.
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = share.clamp(0.0, 1.0) * sorted.len().saturating_sub(1) as f64;
    let below = at.floor() as usize;
    match (sorted.get(below), sorted.get(below + 1)) {
        (Some(a), Some(b)) => a + (b - a) * (at - below as f64),
        (Some(a), None) => *a,
        _ => f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_those_of_a_count_by_hand() {
        // Five bins of width 2: [0, 2), [2, 4), [4, 6), [6, 8), [8, 10].
        let values = [0.0, 1.9, 2.0, 3.5, 3.9, 6.0, 8.0, 9.0, 10.0, 11.0, -1.0, f64::NAN];
        assert_eq!(Bins::within(&values, 0.0, 10.0, 5, false).counts, [2, 3, 0, 1, 3]);
        // One bin per decade.
        let values = [1.0, 9.0, 10.0, 99.0, 100.0, 500.0, 1000.0];
        let bins = Bins::within(&values, 1.0, 1000.0, 3, true);
        assert_eq!(bins.counts, [2, 2, 3]);
        assert!((bins.edges(1)[0] - 10.0).abs() < 1e-9 && (bins.edges(1)[1] - 100.0).abs() < 1e-9);
    }
}
