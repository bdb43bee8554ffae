//! A group-sequential test of a value: at most three analyses, each at four standard errors, with a false-alarm rate low
//! enough for a large suite.

use crate::SampleMoments;
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Critical value of each analysis, in standard errors.
const STANDARD_ERRORS: f64 = 4.0;
/// Number of analyses. All must reject the value, on the same side.
const ANALYSES: u32 = 3;

/// The estimate of a random value by one run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Its standard error; zero for a value without noise.
    pub standard_error: f64,
}

impl From<SampleMoments> for Estimate {
    /// The mean of a sample. Values that all agree to the last bits have no noise.
    fn from(m: SampleMoments) -> Self {
        let noisy = m.variance() > 0.0 || m.count() < 2;
        Self { value: m.mean(), standard_error: if noisy { m.standard_error() } else { 0.0 } }
    }
}

/// The expected value, and the largest standard error of a run.
///
/// The procedure: a first analysis with the seed of the case. Within four standard errors (and `tolerance`) the case
/// passes. Otherwise a second analysis follows with an independent seed and four times the samples, and a third with
/// sixteen times the samples. The case fails only if *all three* analyses are off by more than four standard errors, *to the same side*.
///
/// False alarms: one analysis of a normal value errs with probability 6.3e-5, three independent ones to the same side with
/// 2 (3.17e-5)^3 = 6.4e-14; with the spread taken from 256 pixels (255 degrees of freedom) 1.4e-13
/// ([`Self::false_alarm_rate`]). A suite of 2000 cases errs with 3e-10. Two analyses would give 3.5e-9 for a case, and 7e-6 for
/// such a suite, where 1e-6 is allowed.
///
/// Power: the first analysis decides. A value that is off by 6 of its standard errors is found in 97.7 % of all cases
/// ([`Self::power`]), by 8 in all but 3e-5 of them, since it is 12 and 24, or 16 and 32, standard errors of the later analyses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Claim {
    /// The expected value.
    pub expected: f64,
    /// Error in addition to noise: the rounding of the code under test, the error of the expectation.
    pub tolerance: f64,
    /// Bound on the standard error of every analysis, so that no case passes by being noisy.
    pub sure: f64,
}

impl Claim {
    /// Judges; `estimate` computes the estimates of the analyses 0, 1, 2, each with its own seed and four times the samples of the one before.
    ///
    /// # Errors
    /// The estimates, if the claim is refuted, if the standard error of a run is too large, or if an estimate is not a number.
    pub fn judge(&self, mut estimate: impl FnMut(u32) -> Estimate) -> Result<(), String> {
        let mut said = format!("expected {:.7e}, found", self.expected);
        let mut side = 0.0;
        for k in 0..ANALYSES {
            let Estimate { value, standard_error: error } = estimate(k);
            let off = value - self.expected;
            said += &format!("\n  {value:.7e} +- {error:.1e}, {:+.1} standard errors off", off / error);
            if !value.is_finite() || error.is_nan() || error > self.sure {
                return Err(format!("{said}; the standard error must be at most {:.1e}", self.sure));
            }
            if off.abs() <= STANDARD_ERRORS * error + self.tolerance || off * side < 0.0 {
                return Ok(());
            }
            side = off;
        }
        Err(said)
    }

    /// Fails the running test unless [`Self::judge`] passes.
    ///
    /// # Panics
    /// If the claim is refuted.
    #[track_caller]
    pub fn assert(&self, what: &str, estimate: impl FnMut(u32) -> Estimate) {
        if let Err(said) = self.judge(estimate) {
            panic!("{what}: {said}");
        }
    }

    /// Probability that a true claim is refuted, with standard errors of so many degrees of freedom.
    pub fn false_alarm_rate(freedom: f64) -> f64 {
        let beyond = match StudentsT::new(0.0, 1.0, freedom) {
            Ok(student) if freedom < 1e6 => student.sf(STANDARD_ERRORS),
            _ => Normal::standard().sf(STANDARD_ERRORS),
        };
        2.0 * beyond.powi(ANALYSES as i32)
    }

    /// Probability that a claim is refuted whose value is off by `off` standard errors of the first analysis.
    pub fn power(off: f64) -> f64 {
        let normal = Normal::standard();
        // Above, and below.
        let all = |off: f64| -> f64 {
            (0..ANALYSES).map(|k| normal.sf(STANDARD_ERRORS - off * f64::from(1u32 << k))).product()
        };
        all(off) + all(-off)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small generator (Marsaglia 2003).
    fn uniform(state: &mut u64) -> f64 {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        ((*state >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    /// The estimate of analysis `k` of a value that lies `off` standard errors of the first analysis above zero.
    fn estimate(state: &mut u64, off: f64, k: u32) -> Estimate {
        let noise = (-2.0 * uniform(state).ln()).sqrt() * (std::f64::consts::TAU * uniform(state)).cos();
        let error = 1.0 / f64::from(1u32 << k);
        Estimate { value: off + error * noise, standard_error: error }
    }

    /// How many of `n` claims that the value is zero are refuted. `blind` is taken off the four standard errors, for rates
    /// that can be counted.
    fn refuted(n: u32, off: f64, blind: f64) -> f64 {
        let mut state = 2026;
        let mut count = 0;
        for _ in 0..n {
            let claim = Claim { expected: 0.0, tolerance: 0.0, sure: 4.0 };
            // A standard error that is called smaller than it is makes four of it fewer.
            let shrink = (STANDARD_ERRORS - blind) / STANDARD_ERRORS;
            let mut analysis = |k| {
                let l = estimate(&mut state, off, k);
                Estimate { standard_error: l.standard_error * shrink, ..l }
            };
            count += u32::from(claim.judge(&mut analysis).is_err());
        }
        f64::from(count)
    }

    #[test]
    fn false_alarms_are_as_rare_as_stated() {
        assert!((Claim::false_alarm_rate(f64::INFINITY) / 6.35e-14 - 1.0).abs() < 0.01);
        assert!(2000.0 * Claim::false_alarm_rate(255.0) < 5e-10);
        // Counted where it can be: at one standard error instead of four it is 2 P(z > 1)^3 = 0.00799. Five standard
        // deviations of the count: a false alarm of this test in 1.7 million, were its seed not fixed.
        let (n, p) = (200_000u32, 2.0 * Normal::standard().sf(1.0).powi(3));
        let expected = f64::from(n) * p;
        let found = refuted(n, 0.0, 3.0);
        assert!((found - expected).abs() < 5.0 * (expected * (1.0 - p)).sqrt(), "{found} of {expected}");
    }

    #[test]
    fn wrong_values_are_found_as_often_as_stated() {
        assert!(Claim::power(0.0) < 1e-12 && Claim::power(6.0) > 0.977 && Claim::power(8.0) > 0.9999);
        const N: u32 = 20_000;
        for off in [2.0, 4.0, 5.0, 6.0, -6.0] {
            let p = Claim::power(off);
            let found = refuted(N, off, 0.0) / f64::from(N);
            assert!((found - p).abs() < 5.0 * (p * (1.0 - p) / f64::from(N)).sqrt() + 1e-12, "{off}: {found}, not {p}");
        }
    }

    #[test]
    fn a_tolerance_is_granted_once_and_only_as_stated() {
        let at = |value: f64| move |_| Estimate { value, standard_error: 1e-3 };
        let claim = Claim { expected: 1.0, tolerance: 1e-2, sure: 1e-3 };
        assert!(claim.judge(at(1.0139)).is_ok() && claim.judge(at(1.0141)).is_err());
        // Without noise and tolerance only the value itself will do.
        let exact = |value: f64| {
            Claim { expected: 1.0, tolerance: 0.0, sure: 0.0 }.judge(|_| Estimate { value, standard_error: 0.0 })
        };
        assert!(exact(1.0).is_ok() && exact(1.0 + f64::EPSILON).is_err());
    }
}
