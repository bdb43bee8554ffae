//! Is a mean what it should be? Are two means the same?

use crate::{Outcome, SampleMoments};
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Two-sided Z-test: is `value`, known with `standard_error`, equal to `expected`?
///
/// For means of so many values that their standard error is as good as known. A standard error of zero demands
/// equality.
pub fn z_test(value: f64, standard_error: f64, expected: f64) -> Outcome {
    let message = format!("value {value:.8e}, expected {expected:.8e}, standard error {standard_error:.3e}");
    if value == expected && standard_error >= 0.0 {
        return Outcome { p_value: 1.0, message };
    }
    let z = (value - expected).abs() / standard_error;
    two_sided(Normal::standard().sf(z), z, message)
}

/// Two-sided Student test: is the mean of a (roughly normal) sample equal to `expected`?
pub fn student_t_test(sample: &SampleMoments, expected: f64) -> Outcome {
    let error = sample.standard_error();
    let message = format!(
        "mean {:.8e} of {} values, expected {expected:.8e}, standard error {error:.3e}",
        sample.mean(),
        sample.count()
    );
    against_t(sample.mean() - expected, error, sample.count() as f64 - 1.0, message)
}

/// Two-sided Welch (1947) test: do two samples with unequal variances have the same mean?
pub fn welch_test(a: &SampleMoments, b: &SampleMoments) -> Outcome {
    let (va, vb) = (a.variance() / a.count() as f64, b.variance() / b.count() as f64);
    let error = (va + vb).sqrt();
    let freedom = (va + vb).powi(2) / (va * va / (a.count() as f64 - 1.0) + vb * vb / (b.count() as f64 - 1.0));
    let message = format!(
        "means {:.8e} of {} and {:.8e} of {} values, standard error of the difference {error:.3e}",
        a.mean(),
        a.count(),
        b.mean(),
        b.count()
    );
    against_t(a.mean() - b.mean(), error, freedom, message)
}

fn against_t(difference: f64, error: f64, freedom: f64, message: String) -> Outcome {
    if difference == 0.0 && error == 0.0 {
        return Outcome { p_value: 1.0, message };
    }
    let t = difference.abs() / error;
    match StudentsT::new(0.0, 1.0, freedom) {
        Ok(distribution) if t.is_finite() => two_sided(distribution.sf(t), t, message),
        _ => Outcome::impossible(format!("cannot be judged: {message}")),
    }
}

fn two_sided(upper_tail: f64, statistic: f64, message: String) -> Outcome {
    if statistic.is_finite() {
        Outcome { p_value: (2.0 * upper_tail).clamp(0.0, 1.0), message: format!("{message}, statistic {statistic:.3}") }
    } else {
        Outcome::impossible(format!("cannot be judged: {message}"))
    }
}
