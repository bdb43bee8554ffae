//! The budget: the number of samples of the next round, so that the render ends at its time limit.
//!
//! A state machine without a clock: the caller measures the time, the schedule decides. It has two phases:
//!
//! 1. *Pilot*, uniform. At first the cost of a sample is unknown. So the pilot starts with a few hundred samples and
//!    grows at most fourfold per round, until it holds about a fifth of the samples that the budget affords. It has at
//!    least 16 samples per pixel if these are no more than a quarter of the affordable ones.
//! 2. *Refinement*, the remaining samples. It begins with [`Round::replan`]: the plan is made.
//!
//! The plan is made once. With each further plan, the samples of a pixel would decide, by way of its neighbours, how
//! many others join them in the mean. If light comes in rare bright samples, that makes the mean too small by several
//! per cent.
//!
//! Under a time limit a phase consists of several rounds. No round is expected to take more than [`TIME_SHARE`] of the
//! time left. So a machine that becomes three times slower in the middle of a round still ends in time. The rounds shrink
//! geometrically toward the end, down to fractions of a sample per pixel. The first rounds after a plan are not smaller than
//! others: [`Schedule::trimmed`] bounds the cost of the favoured pixels, and the caller cuts off a round that passes
//! the deadline. Without a time limit the rounds grow fourfold from one sample per
//! pixel and depend on no measurement: the same arguments give the same plan on any machine.
//!
//! With a noise target ([`Limits::stop_on_noise`]), [`Step::CheckNoise`] requests a check of the noise after the pilot.
//! Further checks follow when the samples have doubled, or when the forecast number of samples is reached. The result
//! of a check ([`Schedule::stop_on_noise`]) sets the samples until the next one. The other limits stay in force. Such a
//! pilot begins small, and grows as long as it is too small for a plan ([`Schedule::grow_pilot`]).

use serde::{Deserialize, Serialize};

/// Largest budget of samples per pixel.
pub const MAX_MEAN_SPP: f64 = 1e9;

/// Valid targets k of the noise: the standard deviation of the render over that of the sensor. Below a thousandth no
/// sensor shows a difference.
pub const NOISE_LEVELS: std::ops::RangeInclusive<f64> = 1e-3..=1e3;

/// Valid shares of the pixels that must be hidden at the target of the noise [%].
pub const SHARES: std::ops::RangeInclusive<f64> = 1.0..=100.0;

/// The largest expected time of a round, as a share of the time left.
pub const TIME_SHARE: f64 = 0.3;
/// Samples of the first round under a time limit, when their cost is unknown.
const PROBE: u64 = 256;
/// A round has at most this many times the samples taken before, unless it would be shorter than the pause between
/// rounds. An estimate from few samples is not applied to many.
const GROWTH: u64 = 3;
/// The pilot's share of the affordable samples: the usual share, and the largest one.
pub const PILOT_SHARE: (f64, f64) = (0.2, 0.25);
/// Samples per pixel from which a variance can be computed: one for each batch of the film.
const MIN_PILOT: f64 = dunkelfeld_film::BATCHES as f64;
/// Between two checks of the noise, at least one sample per this number of samples is added.
const MIN_STEP: u64 = 20;

/// The limits of a render. The first limit that is met ends the render. Without any, it ends after [`Self::at_least`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Wall-clock seconds from the start of the command to the last file written.
    pub seconds: Option<f64>,
    /// Samples of the whole image.
    pub samples: Option<u64>,
    /// Samples that are taken even after the time limit, so that there is an image if the budget is too small for one.
    /// The render can then overrun its limit by more than [`tolerance`].
    pub at_least: u64,
    /// The caller checks the noise of the image on the way, and ends the render when its target is reached.
    pub stop_on_noise: bool,
    /// Samples per pixel of the pilot at most, if there is such a limit: for a render that a user ends long before its
    /// other limits.
    #[serde(default)]
    pub max_pilot_spp: Option<u32>,
}

/// Properties of the image and the run that the schedule needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Number of pixels.
    pub pixels: u64,
    /// Samples per pixel of the pilot, where the budget allows.
    pub pilot_spp: u32,
    /// Seconds expected for the work after the last sample: exposure, writing files. [`Schedule::set_closing_seconds`]
    /// can correct it.
    pub closing_seconds: f64,
}

/// A phase of the render.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Phase {
    /// Uniform samples, from which the plan is computed.
    Pilot,
    /// Samples distributed by the plan.
    Refine,
}

/// A round of samples to take now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Round {
    /// Samples of the whole image, at least one.
    pub samples: u64,
    /// The phase of the samples. Those of a pilot are distributed evenly.
    pub phase: Phase,
    /// The pilot is complete: make the plan before distributing these samples.
    pub replan: bool,
}

/// The reason why there are no more rounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StopReason {
    /// The time is used up, except for the closing work.
    Time,
    /// All samples are taken.
    Samples,
    /// The image reached its noise target.
    NoiseTarget,
}

/// The next action of the caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Take samples, then report them with [`Schedule::record`].
    Round(Round),
    /// Check the noise of the image. If the target is reached, end the render. Otherwise report the forecast number of
    /// samples with [`Schedule::stop_on_noise`]. At the first check, make the plan, or report with
    /// [`Schedule::grow_pilot`] that the pilot is too small for one.
    CheckNoise,
    /// Expose the image and write the files.
    Stop(StopReason),
}

/// The state machine. Call [`Self::next`], render, call [`Self::record`], and repeat until the step is a stop. The
/// state can be stored. A schedule that was stored and read again continues as if without interruption.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Schedule {
    limits: Limits,
    settings: Settings,
    taken: u64,
    phase: Phase,
    /// Seconds per unit of work: smoothed, and of the last round. `None` before the first.
    pace: Option<(f64, f64)>,
    /// Seconds that pass between rounds (planning, folding results), smoothed.
    overhead: f64,
    /// Start of the last round and its duration.
    last_round: Option<(f64, f64)>,
    now: f64,
    /// Samples after which the noise is checked next.
    judge_at: u64,
}

impl Schedule {
    /// A new schedule. Limits that are negative or not numbers count as zero.
    pub fn new(mut limits: Limits, settings: Settings) -> Self {
        limits.seconds = limits.seconds.map(finite_or_zero);
        Self {
            limits,
            settings: Settings { closing_seconds: finite_or_zero(settings.closing_seconds), ..settings },
            taken: 0,
            phase: Phase::Pilot,
            pace: None,
            overhead: 0.0,
            last_round: None,
            now: 0.0,
            judge_at: 0,
        }
    }

    /// Continues a render that had other limits: its samples count, and a plan that it made stays.
    pub fn start_at(&mut self, taken: u64, phase: Phase) {
        (self.taken, self.phase) = (taken, phase);
    }

    /// The present phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Corrects the estimate of the seconds that follow the last sample.
    pub fn set_closing_seconds(&mut self, seconds: f64) {
        self.settings.closing_seconds = finite_or_zero(seconds);
    }

    /// Reports that the render was paused since the last call. The time that passed meanwhile belongs to no round.
    pub fn wake(&mut self) {
        self.last_round = None;
    }

    /// Samples recorded so far.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// The next step, given the seconds since the start of the command and the expected work per sample of the coming
    /// round.
    ///
    /// *Work* is any measure to which wall-clock time is proportional, the same as in [`Self::record`]. It is the
    /// makespan of the units that a round is cut into ([`crate::tile_cost::makespan`]), or the number of samples (then
    /// one per sample).
    pub fn next(&mut self, elapsed: f64, work_per_sample: f64) -> Step {
        self.observe_clock(elapsed);
        let wanted = self.limits.samples.unwrap_or(u64::MAX);
        if self.taken >= wanted {
            return Step::Stop(StopReason::Samples);
        }
        let Some(left) = self.seconds_left() else {
            if self.limits.samples.is_none() && !self.limits.stop_on_noise {
                return self.owed_or_stop(StopReason::Samples);
            }
            return self.untimed_round(wanted);
        };
        if left <= self.too_short() && self.taken > 0 {
            return self.owed_or_stop(StopReason::Time);
        }
        let Some((smooth, last)) = self.pace else {
            return self.start_round(PROBE.min(self.settings.pixels).min(wanted).max(1), false);
        };
        let per_sample = smooth.max(last) * positive_or_one(work_per_sample);
        let affordable = (left - self.overhead).max(0.0) / per_sample;
        let all = (self.taken as f64 + affordable).min(wanted as f64);
        if self.is_judge_due(all) {
            return Step::CheckNoise;
        }
        let replan = self.advance(all);
        let target = match self.phase {
            Phase::Pilot => self.pilot_target(all).max(self.taken + 1),
            Phase::Refine if self.limits.stop_on_noise => self.judge_at.min(wanted),
            Phase::Refine => wanted,
        };
        // Rounds shorter than the pause between them would make no progress.
        let grown = self.taken.saturating_mul(GROWTH).max((self.overhead / per_sample) as u64);
        let most = ((TIME_SHARE * affordable) as u64).min(grown);
        let samples = target.saturating_sub(self.taken).min(most).min(wanted - self.taken).max(1);
        self.start_round(samples, replan)
    }

    /// Reports that the image has not reached its target yet, and that `total` samples by the plan are forecast to
    /// reach it.
    ///
    /// The next check comes then, or when the samples have doubled, since later data give a better estimate than the
    /// forecast. At least a twentieth is added, so that the steps do not become ever smaller.
    pub fn stop_on_noise(&mut self, total: f64) {
        let least = self.taken.saturating_add(self.taken / MIN_STEP).saturating_add(1);
        // `as` saturates. A NaN becomes zero and adds only the minimum.
        self.judge_at = (total.ceil() as u64).min(self.taken.saturating_mul(2)).max(least);
        if self.phase == Phase::Pilot {
            self.phase = Phase::Refine;
        }
    }

    /// Reports the samples per pixel that the pilot should have before a plan is made. Returns false if it has them, or
    /// if the pilot is over. The pilot never gets more than a quarter of the samples that the budget affords.
    pub fn grow_pilot(&mut self, spp: u32) -> bool {
        let grows = self.phase == Phase::Pilot && spp > self.settings.pilot_spp;
        if grows {
            self.settings.pilot_spp = spp;
        }
        grows
    }

    /// The number of samples with which a round stays within its share of the time, for a round whose work was computed
    /// after its samples were distributed. `None` if it stays within it already, or if there is no time limit.
    pub fn trimmed(&self, samples: u64, work: f64) -> Option<u64> {
        let (smooth, last) = self.pace?;
        let share = TIME_SHARE * self.seconds_left()?.max(0.0);
        let expected = smooth.max(last) * work;
        (samples > 1 && expected > 1.05 * share).then(|| ((samples as f64 * share / expected) as u64).max(1))
    }

    /// Estimated seconds per unit of work, `None` before the first round. [`Self::next`] defines work.
    pub fn pace(&self) -> Option<f64> {
        self.pace.map(|(smooth, _)| smooth)
    }

    /// Reports a finished round: its samples, its expected work, and its measured wall-clock seconds.
    pub fn record(&mut self, samples: u64, work: f64, seconds: f64) {
        self.taken = self.taken.saturating_add(samples);
        let seconds = finite_or_zero(seconds);
        // A clock that did not advance means a very fast round, not one without cost.
        let pace = seconds.max(1e-9) / if work > 0.0 { work } else { samples.max(1) as f64 };
        self.pace = Some(match self.pace {
            Some((smooth, _)) => (0.5 * (smooth + pace), pace),
            None => (pace, pace),
        });
        if let Some((_, took)) = &mut self.last_round {
            *took = seconds;
        }
    }

    /// Records the time, and the seconds that passed beside the last round.
    fn observe_clock(&mut self, elapsed: f64) {
        // If the clock runs backwards, the time stays the same.
        self.now = self.now.max(finite_or_zero(elapsed));
        if let Some((handed_out, took)) = self.last_round.take() {
            let beside = (self.now - handed_out - took).max(0.0);
            self.overhead = if self.overhead == 0.0 { beside } else { 0.5 * (self.overhead + beside) };
        }
    }

    /// Seconds until sampling must end; `None` without a time limit.
    fn seconds_left(&self) -> Option<f64> {
        let margin = |seconds: f64| (0.01 * seconds).min(0.25);
        self.limits.seconds.map(|s| s - margin(s) - self.settings.closing_seconds - self.now)
    }

    /// The least time left \[s\] for another round. With less, its overhead is too large.
    fn too_short(&self) -> f64 {
        let budget = self.limits.seconds.unwrap_or(0.0);
        (2.0 * self.overhead).max((0.01 * budget).min(0.5))
    }

    /// The samples that an image needs at least, or the end.
    fn owed_or_stop(&mut self, reason: StopReason) -> Step {
        let owed = self.limits.at_least.min(self.limits.samples.unwrap_or(u64::MAX)).saturating_sub(self.taken);
        if owed == 0 { Step::Stop(reason) } else { self.start_round(owed, false) }
    }

    /// The next step without a time limit. Rounds grow fourfold from one sample per pixel, so that an interrupted
    /// render has an image. Only numbers of samples decide.
    fn untimed_round(&mut self, wanted: u64) -> Step {
        if self.is_judge_due(wanted as f64) {
            return Step::CheckNoise;
        }
        let most = self.taken.saturating_mul(GROWTH).max(self.settings.pixels).max(1);
        if self.limits.stop_on_noise && self.phase > Phase::Pilot {
            return self.start_round((self.judge_at.min(wanted) - self.taken).min(most), false);
        }
        let pilot = self.pilot_target(wanted as f64).min(wanted);
        let (target, phase) = if self.taken < pilot { (pilot, Phase::Pilot) } else { (wanted, Phase::Refine) };
        let replan = phase > self.phase;
        self.phase = phase;
        self.start_round((target - self.taken).min(most), replan)
    }

    fn start_round(&mut self, samples: u64, replan: bool) -> Step {
        self.last_round = Some((self.now, 0.0));
        Step::Round(Round { samples, phase: self.phase, replan })
    }

    /// Samples of the pilot if the budget affords `all`.
    fn pilot_target(&self, all: f64) -> u64 {
        let pixels = self.settings.pixels.max(1);
        if !self.can_adapt(all) {
            return all as u64;
        }
        let spp = all / pixels as f64;
        // A render with a noise target may end long before its budget: its pilot is no larger than necessary.
        let share = if self.limits.stop_on_noise { 0.0 } else { PILOT_SHARE.0 };
        let pilot = size_of_pilot(spp, self.settings.pilot_spp, share);
        let pilot = self.limits.max_pilot_spp.map_or(pilot, |most| pilot.min(f64::from(most).max(MIN_PILOT)));
        (whole_spp(pilot) as u64).saturating_mul(pixels)
    }

    /// Returns whether `all` samples are enough for a pilot with a variance. If not, the render cannot adapt, and all
    /// samples belong to the pilot. A render with a noise target may end after the pilot, which may then be all of it.
    fn can_adapt(&self, all: f64) -> bool {
        let most = if self.limits.stop_on_noise { 1.0 } else { PILOT_SHARE.1 };
        most * all >= MIN_PILOT * self.settings.pixels.max(1) as f64
    }

    /// Returns whether a check of the noise is due, if the budget affords `all` samples.
    fn is_judge_due(&self, all: f64) -> bool {
        let adapts = self.can_adapt(all);
        self.limits.stop_on_noise
            && self.taken > 0
            && match self.phase {
                Phase::Pilot => adapts && self.taken >= self.pilot_target(all),
                Phase::Refine => self.taken >= self.judge_at,
            }
    }

    /// Enters the refinement if the pilot is complete. Returns true if it does.
    fn advance(&mut self, all: f64) -> bool {
        // A pilot that takes all samples has no refinement.
        let adapts = !self.limits.stop_on_noise && self.can_adapt(all);
        let done = self.taken > 0 && self.taken >= self.pilot_target(all);
        let begins = adapts && done && self.phase == Phase::Pilot;
        if begins {
            self.phase = Phase::Refine;
        }
        begins
    }
}

/// Seconds by which a time limit of `seconds` may be overrun: 2 %, or 0.2 s if that is more. A longer overrun is reported.
pub fn tolerance(seconds: f64) -> f64 {
    (0.02 * seconds).max(0.2)
}

/// Uniform samples per pixel of an image that has `spp` in the mean under a time limit: those of its pilot, or all of them
/// if they are too few for a plan. `pilot_spp` is the size of a pilot where the budget allows it.
pub fn uniform_spp(spp: f64, pilot_spp: u32) -> f64 {
    if PILOT_SHARE.1 * spp < MIN_PILOT { spp } else { whole_spp(size_of_pilot(spp, pilot_spp, PILOT_SHARE.0)) }
}

/// Samples per pixel of a pilot with this share of the affordable samples, before rounding.
fn size_of_pilot(spp: f64, pilot_spp: u32, share: f64) -> f64 {
    f64::from(pilot_spp).max(share * spp).min(PILOT_SHARE.1 * spp).max(MIN_PILOT)
}

/// Whole samples per pixel, and full sets of film batches if there are enough.
fn whole_spp(pilot: f64) -> f64 {
    if pilot >= 8.0 { (pilot / 4.0).floor() * 4.0 } else { pilot.floor() }
}

fn finite_or_zero(seconds: f64) -> f64 {
    if seconds.is_finite() { seconds.max(0.0) } else { 0.0 }
}

fn positive_or_one(v: f64) -> f64 {
    if v > 0.0 && v.is_finite() { v } else { 1.0 }
}

#[cfg(test)]
#[path = "budget_tests.rs"]
mod tests;
