//! Tests of Poisson numbers against their distribution, from a millionth of an electron to a hundred million.
//!
//! Seeds are fixed, so a test either always passes or always fails. The stated rates are the probabilities that a
//! correct sampler fails with a random seed.

use dunkelfeld_sampling::keyed_stream;
use dunkelfeld_sensor::poisson;
use dunkelfeld_testkit::{chi_squared, sidak, z_test};

/// Means on both sides of each change of method (32 and 1e8), whole numbers and others.
const MEANS: [f64; 21] = [
    1e-6, 1e-4, 1e-2, 0.3, 1.0, 3.0, 7.5, 9.999, 10.0, 17.7, 31.0, 31.999, 32.0, 40.5, 100.0, 512.3, 1e4, 1e5, 1e6,
    9.9e7, 3e9,
];
const DRAWS: u32 = 400_000;

fn draws(mean: f64, seed: u64) -> impl Iterator<Item = f64> {
    let mut rng = keyed_stream(seed, 0, 0, mean.to_bits());
    (0..DRAWS).map(move |_| poisson(mean, &mut rng))
}

/// False-alarm rate of each test function as a whole.
const RATE: f64 = 1e-10;

/// Mean and variance by Z-tests.
#[test]
fn mean_and_variance_are_the_parameter() {
    for mean in MEANS {
        let n = f64::from(DRAWS);
        let (mut sum, mut squares) = (0.0, 0.0);
        for k in draws(mean, 1) {
            let d = k - mean;
            sum += d;
            squares += d * d;
        }
        // With hardly one expected count in all draws, the normal approximation is not valid. The goodness-of-fit test
        // below covers this case with exact probabilities.
        if mean * n < 50.0 {
            continue;
        }
        let rate = sidak(RATE, 2 * MEANS.len());
        z_test(sum / n, (mean / n).sqrt(), 0.0).assert(rate, &format!("mean of Poisson numbers of mean {mean}"));
        // The mean square deviation has variance (mu_4 - mean^2) / n with mu_4 = mean + 3 mean^2.
        let error = ((mean + 2.0 * mean * mean) / n).sqrt();
        z_test(squares / n, error, mean).assert(rate, &format!("variance of Poisson numbers of mean {mean}"));
    }
}

/// Pearson's chi-squared over cells with at least 25 expected counts.
#[test]
fn counts_fit_the_distribution() {
    for mean in MEANS {
        let (first, cells) = expected_cells(mean);
        let mut counts = vec![0u64; cells.len()];
        for k in draws(mean, 2) {
            // `first` is the first count of the second cell; every cell in between is `width` counts wide.
            let cell = if k < first { 0.0 } else { 1.0 + ((k - first) / cell_width(mean)).floor() };
            counts[(cell as usize).min(cells.len() - 1)] += 1;
        }
        let (counts, cells) = pool(&counts, &cells);
        if cells.len() < 2 {
            // Nearly every count is 0. For an expectation of 0.4 in all draws, 12 or more have a probability of 0.4^12
            // / 12! = 4e-14.
            let others = f64::from(DRAWS) - f64::from(draws(mean, 2).filter(|k| *k == 0.0).count() as u32);
            assert!(others < 12.0, "mean {mean}: {others} counts, expected {}", mean * f64::from(DRAWS));
            continue;
        }
        let what = format!("fit of Poisson numbers of mean {mean}");
        chi_squared(&counts, &cells).assert(sidak(RATE, MEANS.len()), &what);
    }
}

fn cell_width(mean: f64) -> f64 {
    (mean.sqrt() / 8.0).ceil().max(1.0)
}

/// The first count of the second cell, and the expected number of draws in every cell. The last cell is open.
fn expected_cells(mean: f64) -> (f64, Vec<f64>) {
    let width = cell_width(mean);
    let first = (mean - 6.0 * mean.sqrt() - 1.0).floor().max(0.0);
    let n = f64::from(DRAWS);
    let last = mean + 6.0 * mean.sqrt() + 12.0;
    let mut cells = vec![0.0];
    let mut start = first;
    while start < last {
        let p: f64 = if mean < 1e7 {
            (0..width as u64).map(|i| probability(mean, start + i as f64)).sum()
        } else {
            // Too many counts to sum: the density at three points (the cell is 1/8 sigma wide) by Simpson's rule.
            let at = |x: f64| probability(mean, x);
            width * (at(start) + 4.0 * at(start + 0.5 * (width - 1.0)) + at(start + width - 1.0)) / 6.0
        };
        cells.push(n * p);
        start += width;
    }
    let inside: f64 = cells.iter().sum();
    // The counts below `first` and above `last` have less than one draw in 1e8. They go to the ends.
    cells.push((n - inside).max(0.0));
    (first, cells)
}

/// The Poisson probability of a whole k, by logarithms. For large k, relative to the mean, since k ln k cancels.
fn probability(mean: f64, k: f64) -> f64 {
    if k < 30.0 {
        let factorial: f64 = (1..=k as u64).map(|i| i as f64).product();
        return (-mean).exp() * mean.powf(k) / factorial;
    }
    // Loader (2000): saddle point, p = exp(-D) / sqrt(2 pi k) with the deviance D = k ln(k/mean) + mean - k.
    let x = (mean - k) / k;
    let deviance = if x.abs() < 0.1 {
        // k (x - ln(1 + x)) by its series: x^2/2 - x^3/3 + ...
        k * (2..40).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 } * x.powi(i) / f64::from(i)).sum::<f64>()
    } else {
        k * (x - x.ln_1p())
    };
    let stirling = 1.0 / (12.0 * k) - 1.0 / (360.0 * k.powi(3)) + 1.0 / (1260.0 * k.powi(5));
    (-deviance - stirling).exp() / (std::f64::consts::TAU * k).sqrt()
}

/// Joins neighbouring cells until each expects at least 25.
fn pool(counts: &[u64], expected: &[f64]) -> (Vec<u64>, Vec<f64>) {
    let mut pooled: Vec<(u64, f64)> = Vec::new();
    let (mut c, mut e) = (0, 0.0);
    for (&count, &expect) in counts.iter().zip(expected) {
        c += count;
        e += expect;
        if e >= 25.0 {
            pooled.push((c, e));
            (c, e) = (0, 0.0);
        }
    }
    if let Some(last) = pooled.last_mut() {
        last.0 += c;
        last.1 += e;
    }
    pooled.into_iter().unzip()
}

#[test]
fn zero_and_invalid_means_give_zero() {
    let mut rng = keyed_stream(3, 0, 0, 0);
    for mean in [0.0, -1.0, -0.0, f64::NAN, f64::NEG_INFINITY, f64::MIN_POSITIVE] {
        assert_eq!(poisson(mean, &mut rng), 0.0, "mean {mean}");
    }
    for mean in [1e12, 1e30, f64::from(f32::MAX)] {
        let k = poisson(mean, &mut rng);
        assert!((k / mean - 1.0).abs() < 1e-4, "mean {mean}: {k}");
    }
}
