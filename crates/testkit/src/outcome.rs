//! The outcome of a statistical test, and the evaluation of many.

/// The result of a statistical test.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Probability of a result at least this extreme if the hypothesis holds, in `[0, 1]`; 0 for data that cannot be
    /// judged (missing, not finite), so that they fail.
    pub p_value: f64,
    /// Statistic, degrees of freedom and sizes, in words.
    pub message: String,
}

impl Outcome {
    /// An outcome that fails at any rate.
    pub(crate) fn impossible(message: impl Into<String>) -> Self {
        Self { p_value: 0.0, message: message.into() }
    }

    /// Is the result compatible with the hypothesis at this false-alarm rate?
    pub fn passes(&self, false_alarm_rate: f64) -> bool {
        self.p_value >= false_alarm_rate
    }

    /// Fails the running test, with the message, unless the result is compatible with the hypothesis.
    ///
    /// # Panics
    /// If [`Self::passes`] is false: that is its use.
    #[track_caller]
    pub fn assert(&self, false_alarm_rate: f64, what: &str) {
        assert!(
            self.passes(false_alarm_rate),
            "{what}: p = {:.3e} is below the false-alarm rate {false_alarm_rate:.1e}\n{}",
            self.p_value,
            self.message
        );
    }
}

/// The rate at which each of `count` independent tests may fail so that *any* of them fails with probability `rate`
/// only (Sidak 1967).
pub fn sidak(rate: f64, count: usize) -> f64 {
    // 1 - (1 - rate)^(1/n), without the cancellation.
    -((-rate).ln_1p() / count.max(1) as f64).exp_m1()
}
