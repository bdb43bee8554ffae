//! The budget: the samples of each round, and the levels in which a round takes them.
//!
//! A state machine without a clock: the caller measures how many samples fit into the time, the schedule decides. It has two
//! phases:
//!
//! 1. *Pilot*, uniform. It holds about a fifth of the samples that the budget affords, and at least 16 samples per pixel if
//!    these are no more than a quarter of the affordable ones. With a time limit it begins with one sample per pixel, whose
//!    cost is unknown.
//! 2. *Refinement*, the remaining samples. It begins with [`Round::replan`]: the plan is made.
//!
//! The plan is made once. With each further plan, the samples of a pixel would decide, by way of its neighbours, how
//! many others join them in the mean. If light comes in rare bright samples, that makes the mean too small by several
//! per cent.
//!
//! A round takes its samples in levels ([`crate::queue`]), which grow fourfold ([`Levels`]). Under a time limit no level is
//! expected to take more than two fifths of the time left. So levels shrink geometrically toward the end, and the deadline
//! finds the tiles of the image within about a sample per pixel of the same level, also on a machine that becomes slower. Without a
//! time limit rounds grow fourfold from one sample per pixel and depend on no measurement: the same arguments give the same
//! plan on any machine.
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

/// The largest expected time of a level, as a share of the time left. So a level is completed on a machine that becomes
/// two and a half times slower meanwhile.
const TIME_SHARE: f64 = 0.4;
/// A level or a round has at most this many times the samples taken before. An estimate from few samples is not applied to
/// many.
const GROWTH: u64 = 3;
/// The smallest level under a time limit, in samples per pixel: a sample, with fewer samples as many as there are and at
/// least the first of these numbers, with many samples the second of these shares of them. A smaller one costs more than it
/// evens out.
const SMALLEST_LEVEL: (f64, f64) = (0.25, 0.02);
/// The pilot's share of the affordable samples: the usual share, and the largest one.
pub const PILOT_SHARE: (f64, f64) = (0.2, 0.25);
/// A pilot is complete with this share of its samples. Their number follows the measured costs, which scatter.
const ENOUGH: f64 = 0.8;
/// Samples per pixel from which a variance can be computed: one for each batch of the film.
const MIN_PILOT: f64 = dunkelfeld_film::BATCHES as f64;
/// Between two checks of the noise, at least one sample per this number of samples is added.
const MIN_STEP: u64 = 20;

/// The limits of a render. The first limit that is met ends the render.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Wall-clock seconds from the start of the command to the last file written.
    pub seconds: Option<f64>,
    /// Samples of the whole image.
    pub samples: Option<u64>,
    /// The caller checks the noise of the image on the way, and ends the render when its target is reached.
    pub stop_on_noise: bool,
    /// Samples per pixel of the pilot at most, if there is such a limit: for a render that a user ends long before its
    /// other limits.
    #[serde(default)]
    pub max_pilot_spp: Option<u32>,
}

/// Properties of the image that the schedule needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Number of pixels.
    pub pixels: u64,
    /// Samples per pixel of the pilot, where the budget allows.
    pub pilot_spp: u32,
}

/// A phase of the render.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Phase {
    /// Uniform samples, from which the plan is computed.
    Pilot,
    /// Samples distributed by the plan.
    Refine,
}

/// The further samples that a render can afford.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Affordable {
    /// There is no time limit.
    All,
    /// There is one, and the cost of a sample is unknown.
    Unknown,
    /// So many fit into the time. Zero: the time is over.
    Samples(f64),
}

/// A round of samples to take now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Round {
    /// Samples of the whole image, at least one.
    pub samples: u64,
    /// Samples of the image at the end of the round. They are more than those of its plan if the round lasts until the time
    /// is over.
    pub most: u64,
    /// The phase of the samples. Those of a pilot are distributed evenly.
    pub phase: Phase,
    /// The pilot is complete: make the plan before distributing these samples.
    pub replan: bool,
}

/// The levels of a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Levels {
    /// Samples of the image at the first level of a render.
    pub first: u64,
    /// Samples of the image at the end of the round ([`Round::most`]).
    pub most: u64,
    /// Number of pixels.
    pub pixels: u64,
}

impl Levels {
    /// The samples of the image at the next level, if those of the last one are `issued`. `None` at the end of the round.
    pub fn after(&self, issued: u64, affordable: Affordable) -> Option<u64> {
        let grown = issued.saturating_mul(1 + GROWTH).max(self.first);
        let next = match affordable {
            Affordable::Samples(more) => {
                let (pixels, taken) = (self.pixels as f64, issued as f64);
                let least = taken.clamp(SMALLEST_LEVEL.0 * pixels, pixels).max(SMALLEST_LEVEL.1 * taken).max(1.0);
                // `as` saturates.
                grown.min(issued.saturating_add((TIME_SHARE * more).max(least) as u64))
            }
            Affordable::All | Affordable::Unknown => grown,
        };
        (issued < self.most).then_some(next.min(self.most))
    }
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
    /// Samples after which the noise is checked next.
    judge_at: u64,
}

impl Schedule {
    /// A new schedule.
    pub fn new(limits: Limits, settings: Settings) -> Self {
        Self { limits, settings, taken: 0, phase: Phase::Pilot, judge_at: 0 }
    }

    /// Samples recorded so far.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// Reports the samples of the image after a round.
    pub fn record(&mut self, taken: u64) {
        self.taken = taken;
    }

    /// The next step, given the further samples that the time allows.
    pub fn next(&mut self, affordable: Affordable) -> Step {
        let wanted = self.limits.samples.unwrap_or(u64::MAX);
        if self.taken >= wanted {
            return Step::Stop(StopReason::Samples);
        }
        let more = match affordable {
            Affordable::All if self.limits.samples.is_none() && !self.limits.stop_on_noise => {
                return Step::Stop(StopReason::Samples);
            }
            Affordable::All => return self.untimed_round(wanted),
            Affordable::Unknown => {
                return self.round((self.taken + self.settings.pixels.max(1)).min(wanted), None, false);
            }
            Affordable::Samples(more) => more,
        };
        if more < 1.0 {
            return Step::Stop(StopReason::Time);
        }
        let all = (self.taken as f64 + more).min(wanted as f64);
        if self.is_judge_due(all) {
            return Step::CheckNoise;
        }
        let replan = self.advance(all);
        match self.phase {
            Phase::Pilot if self.can_adapt(all) => self.round(self.pilot_target(all).max(self.taken + 1), None, replan),
            Phase::Refine if self.limits.stop_on_noise => self.round(self.judge_at.min(wanted), None, replan),
            // Only whole samples per pixel go on evenly.
            Phase::Pilot => {
                let spp = (all / self.settings.pixels.max(1) as f64).max(1.0).ceil() as u64;
                let target = spp.saturating_mul(self.settings.pixels).min(wanted);
                self.round(target.max(self.taken + 1), Some(wanted), replan)
            }
            Phase::Refine => self.round((all as u64).max(self.taken + 1), Some(wanted), replan),
        }
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

    /// The next step without a time limit. Rounds grow fourfold from one sample per pixel, so that an interrupted
    /// render has an image. Only numbers of samples decide.
    fn untimed_round(&mut self, wanted: u64) -> Step {
        if self.is_judge_due(wanted as f64) {
            return Step::CheckNoise;
        }
        let most = self.taken.saturating_mul(GROWTH).max(self.settings.pixels).max(1);
        if self.limits.stop_on_noise && self.phase > Phase::Pilot {
            return self.round(self.judge_at.min(wanted).min(self.taken.saturating_add(most)), None, false);
        }
        let pilot = self.pilot_target(wanted as f64).min(wanted);
        let (target, phase) = if self.taken < pilot { (pilot, Phase::Pilot) } else { (wanted, Phase::Refine) };
        let replan = phase > self.phase;
        self.phase = phase;
        self.round(target.min(self.taken.saturating_add(most)), None, replan)
    }

    /// A round up to a target, and beyond it up to `most` if there is such a number.
    fn round(&self, target: u64, most: Option<u64>, replan: bool) -> Step {
        let samples = target.saturating_sub(self.taken).max(1);
        Step::Round(Round { samples, most: most.unwrap_or(self.taken + samples), phase: self.phase, replan })
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
        let done = self.taken > 0 && self.taken as f64 >= ENOUGH * self.pilot_target(all) as f64;
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

/// Samples per pixel of a pilot with this share of the affordable samples, before rounding.
fn size_of_pilot(spp: f64, pilot_spp: u32, share: f64) -> f64 {
    f64::from(pilot_spp).max(share * spp).min(PILOT_SHARE.1 * spp).max(MIN_PILOT)
}

/// Whole samples per pixel, and full sets of film batches if there are enough.
fn whole_spp(pilot: f64) -> f64 {
    if pilot >= 8.0 { (pilot / 4.0).floor() * 4.0 } else { pilot.floor() }
}

#[cfg(test)]
#[path = "budget_tests.rs"]
mod tests;
