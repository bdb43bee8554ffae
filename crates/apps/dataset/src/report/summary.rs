//! The summary of numbers in a table.

use dunkelfeld_report::bins::quantile;

/// Mean, median, 5 % and 95 % quantile of numbers. NaN if there are none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Summary {
    pub(crate) n: usize,
    pub(crate) mean: f64,
    pub(crate) median: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

impl Summary {
    /// The summary of the finite numbers.
    pub(crate) fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let mean = sorted.iter().sum::<f64>() / sorted.len() as f64;
        let [low, median, high] = [0.05, 0.5, 0.95].map(|share| quantile(&sorted, share));
        Self { n: sorted.len(), mean, median, low, high }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summary_is_of_the_finite_numbers() {
        let summary = Summary::of([4.0, f64::NAN, 1.0, 1.0]);
        assert_eq!((summary.n, summary.mean, summary.median), (3, 2.0, 1.0));
        assert!(Summary::of([f64::NAN]).mean.is_nan());
    }
}
