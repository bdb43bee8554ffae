//! The budget: how many samples the next round may have, so that the render ends when it was told to.
//!
//! A state machine without a clock: the caller measures, this decides. Two stretches of work:
//!
//! 1. *Pilot*, uniform. At first nothing is known about the cost of a sample, so it starts with a few hundred and grows
//!    fourfold at most per round, until the pilot holds about a fifth of what the budget affords (but at least 16 samples
//!    per pixel where these are no more than a quarter of it).
//! 2. *Refinement*, what remains, which begins with [`Round::replan`]: the plan is made.
//!
//! The plan is made once. Each plan more would let the samples of a pixel decide how many others join them in the mean, by
//! way of its neighbours, and where light comes in rare bright samples that makes the mean too small by several per cent.
//!
//! Under a time limit a stretch is made of several rounds, none of which is expected to take more than
//! [`TIME_SHARE`] of the time left: a machine that turns three times slower in the middle of a round still ends in time.
//! After each replanning the first rounds are small, since nobody knows what the favoured pixels cost.
//! The rounds shrink geometrically toward the end, down to fractions of a sample per pixel. Without a time limit the
//! rounds grow fourfold from one sample per pixel and depend on nothing measured: the same arguments give the same plan on any machine.
//!
//! Where the image itself decides when it is good enough ([`Limits::stop_on_noise`]), [`Step::CheckNoise`] asks for that after the pilot
//! and then whenever the samples have doubled, or those that were said to suffice have been taken. What is answered
//! ([`Schedule::stop_on_noise`]) sets the next stretch; the other limits hold as ever. Such a pilot begins small, and grows as long as
//! it turns out to be too small for what is to come ([`Schedule::grow_pilot`]).

use serde::{Deserialize, Serialize};

/// The share of the time left that a round may be expected to take.
pub const TIME_SHARE: f64 = 0.3;
/// After new weights the samples go to other pixels, which may cost far more than any map of tiles can foresee: the first
/// rounds then have this part of their share, growing fourfold from one to the next. A jump to the two-hundredfold cost
/// per sample still ends in time.
const CAUTION: f64 = 1.0 / 64.0;
/// Samples in the very first round under a time limit, when nothing is known of their cost.
const PROBE: u64 = 256;
/// A round has at most so many times the samples taken before (unless it would be shorter than the pause between rounds):
/// an estimate from few samples is not trusted with many.
const GROWTH: u64 = 3;
/// The pilot's share of the affordable samples: what it should have, and what it may have.
pub const PILOT_SHARE: (f64, f64) = (0.2, 0.25);
/// Samples per pixel from which a variance is known: one for each batch of the film.
const MIN_PILOT: f64 = dunkelfeld_film::BATCHES as f64;
/// Between two judgements lies at least this part of the samples taken, one in so many.
const MIN_STEP: u64 = 20;

/// When to stop. The first limit to be met ends the render; without any, it ends after [`Self::at_least`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Wall-clock seconds from the start of the command to the last file written.
    pub seconds: Option<f64>,
    /// Samples of the whole image.
    pub samples: Option<u64>,
    /// Samples that are taken whatever the clock says, so that there is an image also where the budget is too small for
    /// one, at the price of missing it (see [`Schedule::budget_missed`]).
    pub at_least: u64,
    /// Does somebody judge the image on the way, and end the render when it is good enough?
    pub stop_on_noise: bool,
}

/// What the schedule has to know about the image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Number of pixels.
    pub pixels: u64,
    /// Samples per pixel of the pilot, where the budget allows.
    pub pilot_spp: u32,
    /// Seconds expected for what follows the last sample: exposure, writing files. May be corrected on the way by
    /// [`Schedule::set_closing_seconds`].
    pub closing_seconds: f64,
}

/// A stretch of the render.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Phase {
    /// Uniform samples, which tell where more are needed.
    Pilot,
    /// Samples where they are needed, by the plan.
    Refine,
}

/// A round of samples to take now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Round {
    /// So many samples in the whole image, at least one.
    pub samples: u64,
    /// What they are for: a pilot's samples are shared out evenly.
    pub phase: Phase,
    /// The pilot is done: make the plan before sharing out these samples.
    pub replan: bool,
}

/// Why there are no more rounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StopReason {
    /// The time is used up, but for what the closing work needs.
    Time,
    /// All samples are taken.
    Samples,
    /// The image was judged good enough.
    NoiseTarget,
}

/// What to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Take samples, then report them with [`Schedule::record`].
    Round(Round),
    /// Judge the image: either it is good enough, and the render is over, or say with [`Schedule::stop_on_noise`] how many samples
    /// it takes; the first time, make the plan, or say that the pilot is too small for one with [`Schedule::grow_pilot`].
    CheckNoise,
    /// Expose and write.
    Stop(StopReason),
}

/// The state machine. Ask [`Self::next`], render, [`Self::record`], and so on until it says stop. Its state can be stored: a
/// schedule that was stored and read again goes on as if nothing had happened.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Schedule {
    limits: Limits,
    settings: Settings,
    taken: u64,
    phase: Phase,
    /// The part of [`TIME_SHARE`] that is dared.
    caution: f64,
    /// Seconds per unit of work: smoothed, and of the last round. `None` before the first.
    pace: Option<(f64, f64)>,
    /// Seconds that pass between rounds (planning, folding results), smoothed.
    overhead: f64,
    /// When the last round was handed out, and how long it took.
    last_round: Option<(f64, f64)>,
    now: f64,
    /// Samples after which the image is judged next.
    judge_at: u64,
}

impl Schedule {
    /// A schedule at its beginning. Limits that are not numbers or negative count as zero.
    pub fn new(mut limits: Limits, settings: Settings) -> Self {
        limits.seconds = limits.seconds.map(sane);
        Self {
            limits,
            settings: Settings { closing_seconds: sane(settings.closing_seconds), ..settings },
            taken: 0,
            phase: Phase::Pilot,
            caution: 1.0,
            pace: None,
            overhead: 0.0,
            last_round: None,
            now: 0.0,
            judge_at: 0,
        }
    }

    /// Corrects the estimate of the seconds that follow the last sample.
    pub fn set_closing_seconds(&mut self, seconds: f64) {
        self.settings.closing_seconds = sane(seconds);
    }

    /// Tells that the render was at rest since the last call: what passed meanwhile does not belong to a round.
    pub fn wake(&mut self) {
        self.last_round = None;
    }

    /// Samples recorded so far.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// The next round, given the seconds since the start of the command and the expected work per sample of the coming
    /// round.
    ///
    /// *Work* is any measure to which wall-clock time is proportional, the same as in [`Self::record`]: the makespan of
    /// the units a round is cut into ([`crate::tile_cost::makespan`]), or simply the number of samples (then one per sample).
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
            return self.hand_out(PROBE.min(self.settings.pixels).min(wanted).max(1), false);
        };
        let per_sample = smooth.max(last) * positive_or_one(work_per_sample);
        let affordable = (left - self.overhead).max(0.0) / per_sample;
        let all = (self.taken as f64 + affordable).min(wanted as f64);
        if self.is_judge_due(all) {
            return Step::CheckNoise;
        }
        let replan = self.advance(all);
        let goal = match self.phase {
            Phase::Pilot => self.pilot_target(all).max(self.taken + 1),
            Phase::Refine if self.limits.stop_on_noise => self.judge_at.min(wanted),
            Phase::Refine => wanted,
        };
        self.caution = if replan { CAUTION } else { (4.0 * self.caution).min(1.0) };
        // Rounds shorter than what passes between them would not get anywhere.
        let grown = self.taken.saturating_mul(GROWTH).max((self.overhead / per_sample) as u64);
        let most = ((self.caution * TIME_SHARE * affordable) as u64).min(grown);
        let samples = goal.saturating_sub(self.taken).min(most).min(wanted - self.taken).max(1);
        self.hand_out(samples, replan)
    }

    /// Reports that the image is not good enough yet, and that it is expected to be after `total` samples by the plan.
    ///
    /// The next judgement comes then, or when the samples have doubled: what is known by then is worth more than what was
    /// foretold. At least a twentieth is added, so that there is no end of small steps.
    pub fn stop_on_noise(&mut self, total: f64) {
        let least = self.taken.saturating_add(self.taken / MIN_STEP).saturating_add(1);
        // `as` saturates; what is not a number asks for nothing.
        self.judge_at = (total.ceil() as u64).min(self.taken.saturating_mul(2)).max(least);
        if self.phase == Phase::Pilot {
            self.phase = Phase::Refine;
            self.caution = CAUTION;
        }
    }

    /// Reports that the pilot should have so many samples per pixel before a plan is made; false if it has, or if it is over.
    /// It never gets more than a quarter of what the budget affords.
    pub fn grow_pilot(&mut self, spp: u32) -> bool {
        let grows = self.phase == Phase::Pilot && spp > self.settings.pilot_spp;
        if grows {
            self.settings.pilot_spp = spp;
        }
        grows
    }

    /// A round of so many samples turns out to be so much work, now that it is known where they go: how many it should have
    /// instead to stay within its share of the time; `None` if it does, or if there is no time limit.
    pub fn trimmed(&self, samples: u64, work: f64) -> Option<u64> {
        let (smooth, last) = self.pace?;
        let share = TIME_SHARE * self.seconds_left()?.max(0.0);
        let expected = smooth.max(last) * work;
        (samples > 1 && expected > 1.05 * share).then(|| ((samples as f64 * share / expected) as u64).max(1))
    }

    /// Seconds that a unit of work takes, as far as is known; see [`Self::next`] for what work is.
    pub fn pace(&self) -> Option<f64> {
        self.pace.map(|(smooth, _)| smooth)
    }

    /// Reports a finished round: its samples, its work as it was expected beforehand, and the wall-clock seconds it took.
    pub fn record(&mut self, samples: u64, work: f64, seconds: f64) {
        self.taken = self.taken.saturating_add(samples);
        let seconds = sane(seconds);
        // A clock that stood still says "very fast", not "free".
        let pace = seconds.max(1e-9) / if work > 0.0 { work } else { samples.max(1) as f64 };
        self.pace = Some(match self.pace {
            Some((smooth, _)) => (0.5 * (smooth + pace), pace),
            None => (pace, pace),
        });
        if let Some((_, took)) = &mut self.last_round {
            *took = seconds;
        }
    }

    /// The share of the render that is done, in \[0, 1\], by the limit that is nearest.
    pub fn progress(&self, elapsed: f64) -> f64 {
        let time = self.limits.seconds.map_or(0.0, |s| sane(elapsed) / s.max(1e-9));
        let samples = self.limits.samples.map_or(0.0, |s| self.taken as f64 / s.max(1) as f64);
        time.max(samples).clamp(0.0, 1.0)
    }

    /// Was the time limit missed by more than 2 % and 0.2 s, at `elapsed` seconds when all is written?
    pub fn budget_missed(&self, elapsed: f64) -> bool {
        self.limits.seconds.is_some_and(|s| elapsed > s + tolerance(s))
    }

    /// Takes note of the time, and of what passed beside the round just recorded.
    fn observe_clock(&mut self, elapsed: f64) {
        // A clock that runs backwards is taken to stand still.
        self.now = self.now.max(sane(elapsed));
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

    /// With no more time left than this, another round is not worth its overhead.
    fn too_short(&self) -> f64 {
        let budget = self.limits.seconds.unwrap_or(0.0);
        (2.0 * self.overhead).max((0.01 * budget).min(0.5))
    }

    /// The samples still owed for an image at all, or the end.
    fn owed_or_stop(&mut self, reason: StopReason) -> Step {
        let owed = self.limits.at_least.min(self.limits.samples.unwrap_or(u64::MAX)).saturating_sub(self.taken);
        if owed == 0 { Step::Stop(reason) } else { self.hand_out(owed, false) }
    }

    /// A stretch, in rounds that grow fourfold from one sample per pixel, so that an interruption finds an image; decided by
    /// numbers of samples alone.
    fn untimed_round(&mut self, wanted: u64) -> Step {
        if self.is_judge_due(wanted as f64) {
            return Step::CheckNoise;
        }
        let most = self.taken.saturating_mul(GROWTH).max(self.settings.pixels).max(1);
        if self.limits.stop_on_noise && self.phase > Phase::Pilot {
            return self.hand_out((self.judge_at.min(wanted) - self.taken).min(most), false);
        }
        let pilot = self.pilot_target(wanted as f64).min(wanted);
        let (goal, phase) = if self.taken < pilot { (pilot, Phase::Pilot) } else { (wanted, Phase::Refine) };
        let replan = phase > self.phase;
        self.phase = phase;
        self.hand_out((goal - self.taken).min(most), replan)
    }

    fn hand_out(&mut self, samples: u64, replan: bool) -> Step {
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
        // A judged render may be over long before its budget: its pilot is no larger than it must be.
        let share = if self.limits.stop_on_noise { 0.0 } else { PILOT_SHARE.0 };
        let pilot = f64::from(self.settings.pilot_spp).max(share * spp).min(PILOT_SHARE.1 * spp).max(MIN_PILOT);
        // Whole samples per pixel, and full sets of film batches where there are enough.
        let whole = if pilot >= 8.0 { (pilot / 4.0).floor() * 4.0 } else { pilot.floor() };
        (whole as u64).saturating_mul(pixels)
    }

    /// Do `all` samples have room for a pilot that knows its variance? If not there is nothing to adapt by: all are pilot.
    /// A judged render may be over after the pilot, which may then be all of it.
    fn can_adapt(&self, all: f64) -> bool {
        let most = if self.limits.stop_on_noise { 1.0 } else { PILOT_SHARE.1 };
        most * all >= MIN_PILOT * self.settings.pixels.max(1) as f64
    }

    /// Is there somebody to judge, and enough new to judge by, if the budget affords `all` samples?
    fn is_judge_due(&self, all: f64) -> bool {
        let adapts = self.can_adapt(all);
        self.limits.stop_on_noise
            && self.taken > 0
            && match self.phase {
                Phase::Pilot => adapts && self.taken >= self.pilot_target(all),
                Phase::Refine => self.taken >= self.judge_at,
            }
    }

    /// Enters the refinement where the pilot is done; true if it does.
    fn advance(&mut self, all: f64) -> bool {
        // A pilot of everything has no refinement.
        let adapts = !self.limits.stop_on_noise && self.can_adapt(all);
        let done = self.taken > 0 && self.taken >= self.pilot_target(all);
        let begins = adapts && done && self.phase == Phase::Pilot;
        if begins {
            self.phase = Phase::Refine;
        }
        begins
    }
}

/// Seconds by which a time limit may be overrun.
fn tolerance(seconds: f64) -> f64 {
    (0.02 * seconds).max(0.2)
}

fn sane(seconds: f64) -> f64 {
    if seconds.is_finite() { seconds.max(0.0) } else { 0.0 }
}

fn positive_or_one(v: f64) -> f64 {
    if v > 0.0 && v.is_finite() { v } else { 1.0 }
}

#[cfg(test)]
#[path = "budget_tests.rs"]
mod tests;
