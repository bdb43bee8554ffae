//! The share of the processors that the threads of a render get beside other programs.

use std::time::Instant;

/// Thread seconds on idle processors that are assumed before the first measurement. Short measurements are uncertain: a
/// thread waits for whole time slices.
const PRIOR: f64 = 0.5;
/// Lower bound of the share.
const LEAST: f64 = 0.05;

/// Seconds of busy threads: by the clock, and on a processor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ProcessorLoad {
    wall: f64,
    processor: f64,
}

impl ProcessorLoad {
    /// Adds further seconds.
    pub(crate) fn add(&mut self, other: Self) {
        self.wall += other.wall;
        self.processor += other.processor;
    }

    /// Seconds by the clock of work that takes `seconds` on idle processors.
    pub(crate) fn stretched(&self, seconds: f64) -> f64 {
        seconds / self.share()
    }

    /// The inverse of [`Self::stretched`].
    pub(crate) fn on_idle_processors(&self, seconds: f64) -> f64 {
        seconds * self.share()
    }

    /// Processor time over wall-clock time.
    fn share(&self) -> f64 {
        ((self.processor + PRIOR) / (self.wall + PRIOR)).clamp(LEAST, 1.0)
    }
}

/// Measures the seconds of the current thread.
pub(crate) struct ThreadClock {
    wall: Instant,
    processor: Option<f64>,
}

impl ThreadClock {
    pub(crate) fn start() -> Self {
        Self { wall: Instant::now(), processor: processor_seconds() }
    }

    /// The seconds since the start. They are equal where the system has no clock of a thread.
    pub(crate) fn elapsed(&self) -> ProcessorLoad {
        let wall = self.wall.elapsed().as_secs_f64();
        let processor = processor_seconds().zip(self.processor).map_or(wall, |(now, then)| now - then);
        ProcessorLoad { wall, processor }
    }
}

/// Processor time of this thread \[s\].
fn processor_seconds() -> Option<f64> {
    #[cfg(unix)]
    return Some(seconds_of(rustix::time::ClockId::ThreadCPUTime));
    #[cfg(not(unix))]
    None
}

/// Processor time of all threads of this program \[s\]. `None` where the system has no clock of it.
pub fn program_seconds() -> Option<f64> {
    #[cfg(unix)]
    return Some(seconds_of(rustix::time::ClockId::ProcessCPUTime));
    #[cfg(not(unix))]
    None
}

#[cfg(unix)]
fn seconds_of(clock: rustix::time::ClockId) -> f64 {
    let time = rustix::time::clock_gettime(clock);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reserve_grows_with_wall_clock_time_over_processor_time() {
        let mut load = ProcessorLoad::default();
        assert_eq!(load.stretched(2.0), 2.0, "idle until measured");
        // One time slice of other programs in the first milliseconds.
        load.add(ProcessorLoad { wall: 0.012, processor: 0.002 });
        assert!(load.stretched(2.0) < 2.1);
        // Three tenths of the time: a little less than 10 / 3, by the assumption.
        load.add(ProcessorLoad { wall: 20.0, processor: 6.0 });
        let reserve = load.stretched(2.0);
        assert!((reserve - 2.0 * 20.512 / 6.502).abs() < 1e-9, "{reserve}");
        // A reserve that was measured under the same load stays.
        assert!((load.stretched(load.on_idle_processors(7.0)) - 7.0).abs() < 1e-12);
        let stopped = ProcessorLoad { wall: 1e6, processor: 0.0 };
        assert_eq!(stopped.stretched(1.0), 20.0);
        assert_eq!(ProcessorLoad { wall: 1.0, processor: 1.1 }.stretched(1.0), 1.0);
    }

    #[test]
    fn a_thread_that_sleeps_takes_no_processor_time() {
        let clock = ThreadClock::start();
        std::thread::sleep(std::time::Duration::from_millis(50));
        let load = clock.elapsed();
        assert!(load.wall >= 0.05 && (cfg!(not(unix)) || load.processor < 0.04), "{load:?}");
    }
}
