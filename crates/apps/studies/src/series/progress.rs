//! Converts the progress of single renders to the progress of the whole work.

use dunkelfeld::{Progress, ProgressState};
use std::sync::Mutex;
use std::time::Instant;

/// A sink for the progress of successive renders, which reports the progress of all.
pub(crate) struct Meter<'a> {
    sink: &'a dyn Progress,
    began: Instant,
    total: u64,
    /// Samples of earlier runs, and of all finished renders.
    before: u64,
    done: Mutex<u64>,
}

impl<'a> Meter<'a> {
    /// For a total number of samples, some of which are finished already.
    pub(crate) fn new(sink: &'a dyn Progress, total: u64, before: u64) -> Self {
        Self { sink, began: Instant::now(), total, before, done: Mutex::new(before) }
    }

    /// Sets the number of samples that are finished and stored.
    pub(crate) fn finish(&self, samples: u64) {
        if let Ok(mut done) = self.done.lock() {
            *done += samples;
        }
    }
}

impl Progress for Meter<'_> {
    fn update(&self, s: &ProgressState) {
        let done = self.done.lock().map_or(0, |d| *d) + s.samples;
        let elapsed = self.began.elapsed().as_secs_f64();
        let fresh = done.saturating_sub(self.before);
        let left = self.total.saturating_sub(done) as f64;
        let remaining = (fresh > 0).then(|| elapsed / fresh as f64 * left);
        let fraction = (done as f64 / self.total.max(1) as f64).min(1.0);
        self.sink.update(&ProgressState { stage: s.stage, fraction, elapsed, remaining, samples: done });
    }
}
