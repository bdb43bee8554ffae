//! Pearson's chi-squared test of goodness of fit.

use crate::Outcome;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Least expected count of a cell that is judged by itself; smaller ones are pooled (Cochran 1952).
const MIN_EXPECTED: f64 = 5.0;

/// Do counts follow their expectations (Pearson 1900)?
///
/// `expected` holds the mean count of each cell; the sums should agree, and one degree of freedom is taken off for it.
/// Cells with an expectation below 5 are pooled, smallest first. A count where nothing can be (expectation zero) fails.
pub fn chi_squared(observed: &[u64], expected: &[f64]) -> Outcome {
    if observed.len() != expected.len() || expected.iter().any(|e| !e.is_finite() || *e < 0.0) {
        return Outcome::impossible("cells do not match, or an expectation is negative or not finite");
    }
    if let Some(cell) = (0..observed.len()).find(|&i| expected[i] == 0.0 && observed[i] > 0) {
        return Outcome::impossible(format!("{} counts in cell {cell}, where none can be", observed[cell]));
    }
    let mut order: Vec<usize> = (0..observed.len()).filter(|&i| expected[i] > 0.0).collect();
    order.sort_by(|&a, &b| expected[a].total_cmp(&expected[b]));

    let (mut statistic, mut cells, mut pooled) = (0.0, 0u64, 0usize);
    let (mut pool_observed, mut pool_expected) = (0u64, 0.0);
    let mut worst = (0.0, 0);
    let mut judge = |o: u64, e: f64, cell: usize| {
        let term = (o as f64 - e).powi(2) / e;
        statistic += term;
        cells += 1;
        if term > worst.0 {
            worst = (term, cell);
        }
    };
    for &i in &order {
        if expected[i] < MIN_EXPECTED || (pool_expected > 0.0 && pool_expected < MIN_EXPECTED) {
            pool_observed += observed[i];
            pool_expected += expected[i];
            pooled += 1;
        } else {
            judge(observed[i], expected[i], i);
        }
    }
    if pool_expected > 0.0 {
        judge(pool_observed, pool_expected, order[0]);
    }
    let total: u64 = observed.iter().sum();
    let message = format!(
        "chi-squared {statistic:.2} over {cells} cells ({pooled} pooled), {total} counts, worst cell {} with {:.2}",
        worst.1, worst.0
    );
    // With a single cell only the total could differ, and that is not a question of fit.
    if cells < 2 {
        return Outcome { p_value: if statistic < 25.0 { 1.0 } else { 0.0 }, message };
    }
    match ChiSquared::new((cells - 1) as f64) {
        Ok(distribution) if statistic.is_finite() => Outcome { p_value: distribution.sf(statistic), message },
        _ => Outcome::impossible(message),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mendels_peas() {
        // Mendel (1866), 9:3:3:1; the statistic is 0.470 and p = 0.925 (three degrees of freedom).
        let expected = [312.75, 104.25, 104.25, 34.75];
        let outcome = chi_squared(&[315, 101, 108, 32], &expected);
        assert!((outcome.p_value - 0.9254).abs() < 1e-4, "{outcome:?}");
    }

    #[test]
    fn the_tail_is_resolved() {
        // Two degrees of freedom: the tail is exp(-x/2) exactly. (100-e)^2/e summed is 150.
        let outcome = chi_squared(&[200, 50, 50], &[100.0, 100.0, 100.0]);
        assert!((outcome.p_value / (-75.0f64).exp() - 1.0).abs() < 1e-9, "{outcome:?}");
    }

    #[test]
    fn small_cells_are_pooled_and_impossible_ones_fail() {
        let outcome = chi_squared(&[50, 50, 3, 0, 1, 2], &[50.0, 50.0, 2.0, 1.0, 1.0, 2.0]);
        assert!(outcome.message.contains("over 3 cells (4 pooled)"), "{outcome:?}");
        assert!((outcome.p_value - 1.0).abs() < 1e-12);
        assert_eq!(chi_squared(&[10, 1], &[11.0, 0.0]).p_value, 0.0);
        assert_eq!(chi_squared(&[10], &[f64::NAN]).p_value, 0.0);
    }
}
