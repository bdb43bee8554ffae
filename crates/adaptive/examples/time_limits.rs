//! Ends of renders under a time limit on a simulated machine: overrun, unused time and noise, with all mechanisms that
//! keep the limit and without single ones.
//!
//! ```text
//! cargo run --release -p dunkelfeld-adaptive --example time_limits -- [NAME ...]
//! ```
//!
//! The machine has two threads and virtual time. The loop is that of `crates/render/src/driver.rs` and
//! `crates/render/src/round/mod.rs`. Every row of the table has the same renders: of each kind of scene four limits and
//! eight seeds. A `NAME` is a mechanism that is switched off ([`Off`]); without any, each is switched off in turn.
//!
//! - *Missed*: share of the renders with an overrun above the tolerance (2 % or 0.2 s).
//! - *Overrun*: the largest one, over the tolerance.
//! - *Unused*: mean share of the limit that is left at the end.
//! - *Noise*: variance of the mean of the image, over that of the plan with all of the time and known costs. Geometric
//!   mean.

#![allow(clippy::print_stdout, reason = "an example prints a table")]

use std::env;

use dunkelfeld_adaptive::budget::tolerance;
use dunkelfeld_adaptive::tile_cost::{CostMap, TileGrid, WorkUnit, makespan, upper_makespan};
use dunkelfeld_adaptive::{Limits, SamplePlan, Schedule, Settings, Shares, Step, plan, weights};
use dunkelfeld_film::Plane;

const THREADS: usize = 2;
const SIDE: u32 = 64;
const PIXELS: u64 = (SIDE * SIDE) as u64;
const BUDGETS: [f64; 4] = [0.3, 1.0, 5.0, 20.0];
const SEEDS: u64 = 8;
/// Seconds of planning, and between two rounds.
const PLANNING: f64 = 4e-3;
const BETWEEN: f64 = 5e-4;
/// Constants of the driver and of its passes.
const CLOSING_MARGIN: f64 = 1.15;
const REHEARSAL_SHARE: f64 = 0.065;
const PREVIEW: u64 = 16;
const PASS_SECONDS: f64 = 0.5;
const FIRST_PASS: u32 = 16;
const CHECK_EVERY: f64 = 64.0;

/// Mechanisms of the driver that are switched off.
#[derive(Clone, Copy, Default)]
struct Off {
    /// A round is made smaller if its samples are too much work in their tiles.
    trim: bool,
    /// A round is divided into passes of half a second.
    passes: bool,
    /// The outputs are written once after the pilot, and measured.
    dry_run: bool,
    /// Factor on the measured time.
    closing_margin: bool,
    /// No unit begins after the deadline.
    deadline: bool,
    /// Units that take much longer than the deadline are abandoned.
    abort: bool,
    /// One sample in every sixteenth pixel, whatever the time.
    preview: bool,
}

const NAMES: [&str; 7] = ["trim", "passes", "dry_run", "closing_margin", "deadline", "abort", "preview"];

impl Off {
    fn switch(mut self, name: &str) -> Option<Self> {
        let field = match name {
            "trim" => &mut self.trim,
            "passes" => &mut self.passes,
            "dry_run" => &mut self.dry_run,
            "closing_margin" => &mut self.closing_margin,
            "deadline" => &mut self.deadline,
            "abort" => &mut self.abort,
            "preview" => &mut self.preview,
            _ => return None,
        };
        *field = true;
        Some(self)
    }
}

/// A scene on a machine.
struct Case {
    budget: f64,
    /// Seconds of a sample on one thread.
    costs: Plane<f64>,
    /// Standard deviation of a sample, the weight of the plan.
    deviations: Plane<f32>,
    /// Seconds of the outputs: as estimated before the render, as measured by the dry run, and in truth.
    closing: [f64; 3],
    /// From this moment on the machine is slower by the factor.
    slower: (f64, f64),
    /// At this moment the machine stalls for some seconds.
    stall: (f64, f64),
}

struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) * (-53f64).exp2()
    }

    /// A factor with logarithm of the given standard deviation (the sum of twelve uniform numbers).
    fn factor(&mut self, deviation: f64) -> f64 {
        (deviation * ((0..12).map(|_| self.unit()).sum::<f64>() - 6.0)).exp()
    }
}

const KINDS: [&str; 9] = [
    "even costs",
    "tiles 50 times slower",
    "heavy tail of pixels",
    "favoured pixels 200 times slower",
    "one pixel 1000 times slower",
    "samples of a millisecond",
    "machine slows down 3 times",
    "stall of a tenth",
    "outputs 0.3 to 3 times the estimate",
];

fn case(kind: usize, budget: f64, seed: u64) -> Case {
    let mut random = Random(1000 * seed + kind as u64 + 17);
    (0..10).for_each(|_| _ = random.unit());
    let speed = 1e-6 * random.factor(0.7);
    let blocks: Vec<f64> = (0..256).map(|_| random.factor(1.0)).collect();
    let tiles: Vec<f64> = (0..16).map(|_| random.unit()).collect();
    let of_block = |x: u32, y: u32| blocks[(y / 4 * 16 + x / 4) as usize];
    let mut deviations = Plane::from_fn(SIDE, SIDE, |x, y| of_block(x, y) as f32);
    let mut costs = Plane::from_fn(SIDE, SIDE, |_, _| speed * random.factor(0.3));
    let place = (random.unit() * PIXELS as f64) as usize;
    match kind {
        1 => {
            costs = Plane::from_fn(SIDE, SIDE, |x, y| {
                costs.at(x, y) * if tiles[(y / 16 * 4 + x / 16) as usize] < 0.15 { 50.0 } else { 1.0 }
            })
        }
        2 => costs.data_mut().iter_mut().for_each(|c| *c *= 0.3 * random.unit().powf(-1.0 / 1.2)),
        3 => {
            let pixels = costs.data_mut().iter_mut().zip(deviations.data_mut());
            pixels.filter(|_| random.unit() < 0.01).for_each(|(c, w)| (*c, *w) = (200.0 * *c, 50.0 * *w));
        }
        4 => {
            costs.data_mut()[place] *= 1000.0;
            deviations.data_mut()[place] *= 50.0;
        }
        5 => costs.data_mut().iter_mut().for_each(|c| *c *= 1e-3 / speed),
        _ => {}
    }
    let estimate = (0.02 * budget).min(0.1);
    let truth = estimate * if kind == 8 { 0.3 * 10f64.powf(random.unit()) } else { random.factor(0.2) };
    let when = budget * random.unit();
    Case {
        budget,
        costs,
        deviations,
        closing: [estimate, truth * random.factor(0.05), truth * random.factor(0.05)],
        slower: if kind == 6 { (when, 3.0) } else { (0.0, 1.0) },
        stall: if kind == 7 { (0.7 * when, 0.1 * budget) } else { (0.0, 0.0) },
    }
}

/// A render in progress.
struct Machine<'a> {
    case: &'a Case,
    off: Off,
    random: Random,
    now: f64,
    stall: f64,
    taken: SamplePlan,
    map: CostMap,
    pass: u32,
}

struct End {
    seconds: f64,
    noise: f64,
}

impl Machine<'_> {
    /// The moment at which work of some seconds that begins at `from` ends.
    fn end(&self, from: f64, seconds: f64) -> f64 {
        let fast = (self.case.slower.0 - from).clamp(0.0, seconds);
        from + fast + self.case.slower.1 * (seconds - fast)
    }

    fn run(mut self) -> End {
        let [estimate, measured, truth] = self.case.closing;
        let budget = self.case.budget;
        let at_least = if self.off.preview { 0 } else { PIXELS / PREVIEW };
        let limits = Limits { seconds: Some(budget), at_least, ..Limits::default() };
        let settings = Settings { pixels: PIXELS, pilot_spp: 16, closing_seconds: estimate };
        let mut schedule = Schedule::new(limits, settings);
        let mut shares = Shares::from_weights(weights::uniform(SIDE, SIDE));
        let (mut closing, mut work_per_sample) = (estimate, 1.0);
        while let Step::Round(round) = schedule.next(self.now, work_per_sample) {
            if round.replan {
                let began = self.now;
                self.now = self.end(self.now, PLANNING);
                let margin = if self.off.closing_margin { 1.0 } else { CLOSING_MARGIN };
                if !self.off.dry_run && closing < REHEARSAL_SHARE * (budget - self.now) {
                    self.now = self.end(self.now, measured);
                    closing = closing.max(margin * measured);
                } else {
                    closing = closing.max(margin * (self.now - began));
                }
                schedule.set_closing_seconds(closing);
                shares = Shares::from_weights(self.case.deviations.clone());
            }
            let before = plan::total(&self.taken);
            let target = self.target(&schedule, &shares, round.samples, before < at_least);
            let is_guarded = !self.off.deadline && before >= at_least;
            let deadline = if is_guarded { (budget - closing).max(0.0) } else { f64::INFINITY };
            let began = self.now;
            let work = self.round(&target, deadline);
            let samples = plan::total(&self.taken) - before;
            schedule.record(samples, work, self.now - began);
            if samples > 0 {
                work_per_sample = work / samples as f64;
            }
            if self.now > deadline && plan::total(&self.taken) < plan::total(&target) {
                break;
            }
            self.now = self.end(self.now, BETWEEN);
        }
        End { seconds: self.end(self.now, truth), noise: self.noise(truth) }
    }

    fn target(&mut self, schedule: &Schedule, shares: &Shares, mut samples: u64, is_preview: bool) -> SamplePlan {
        loop {
            let target = plan::next_round(&self.taken, shares, schedule.taken() + samples);
            if is_preview || self.off.trim {
                return target;
            }
            let units = self.map.cut(&plan::increment(&self.taken, &target), THREADS);
            match schedule.trimmed(samples, upper_makespan(&units, THREADS)) {
                Some(fewer) => samples = fewer,
                None => return target,
            }
        }
    }

    /// Renders a round in passes. Returns its expected work.
    fn round(&mut self, target: &SamplePlan, deadline: f64) -> f64 {
        let mut work = None;
        loop {
            let mut increment = plan::increment(&self.taken, target);
            let units = self.map.cut(&increment, THREADS);
            let work = *work.get_or_insert_with(|| makespan(&units, THREADS));
            let most = if self.off.passes { u32::MAX } else { self.pass };
            let is_last = increment.data().iter().all(|&n| n <= most);
            increment.data_mut().iter_mut().for_each(|n| *n = (*n).min(most));
            let units = if is_last { units } else { self.map.cut(&increment, THREADS) };
            let (before, began) = (plan::total(&self.taken), self.now);
            let dearest = self.render(&units, &increment, deadline).min(self.now - began);
            if dearest < 0.5 * PASS_SECONDS {
                self.pass = self.pass.saturating_mul(2);
            } else if dearest > 2.0 * PASS_SECONDS {
                self.pass = (self.pass / 2).max(1);
            }
            if is_last || plan::total(&self.taken) - before < plan::total(&increment) {
                return work;
            }
        }
    }

    /// Renders the units of a pass. Returns the largest thread time of a tile.
    fn render(&mut self, units: &[WorkUnit], increment: &Plane<u32>, deadline: f64) -> f64 {
        let grid = self.map.grid();
        let grace = if self.off.abort { f64::INFINITY } else { (0.01 * self.case.budget).max(0.1) };
        let mut busy = [(self.now, true); THREADS];
        let mut tiles = vec![(0u32, 0.0f64, 0u64); grid.len()];
        for unit in units {
            // A thread that abandoned its unit takes no other.
            let free = busy.iter_mut().filter(|(_, works)| *works).min_by(|a, b| a.0.total_cmp(&b.0));
            let Some(thread) = free.filter(|thread| thread.0 <= deadline) else { break };
            let from = thread.0;
            let rect = grid.rect(unit.tile);
            let (mut seconds, mut samples) = (0.0, 0.0);
            for (x, y) in (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y))) {
                let n = unit.range(*self.taken.at(x, y), *increment.at(x, y)).len() as f64;
                seconds += n * self.case.costs.at(x, y);
                samples += n;
            }
            // The scatter of single samples.
            seconds *= self.random.factor(0.1);
            let fast = (self.case.slower.0 - from).clamp(0.0, seconds);
            let mut end = from + fast + self.case.slower.1 * (seconds - fast);
            if self.case.stall.1 > 0.0 && self.stall > 0.0 && end >= self.case.stall.0 {
                end += std::mem::take(&mut self.stall);
            }
            let abort = deadline + grace + CHECK_EVERY * seconds / samples.max(1.0);
            let is_done = end <= abort;
            *thread = (end.min(abort), is_done);
            if is_done {
                let tile = &mut tiles[unit.tile];
                *tile = (tile.0 + 1, tile.1 + end - from, unit.samples);
                if tile.0 < unit.parts {
                    tile.2 = 0;
                }
            }
        }
        self.now = busy.iter().fold(self.now, |last, thread| last.max(thread.0));
        let mut measured = Vec::new();
        for (index, &(_, seconds, samples)) in tiles.iter().enumerate().filter(|(_, tile)| tile.2 > 0) {
            measured.push((index, samples, seconds));
            let rect = grid.rect(index);
            for (x, y) in (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y))) {
                let at = (y * SIDE + x) as usize;
                self.taken.data_mut()[at] += increment.data()[at];
            }
        }
        self.map.record(&measured);
        measured.iter().map(|t| t.2).fold(0.0, f64::max)
    }

    /// The variance of the image over that of the plan with all of the time.
    fn noise(&self, closing: f64) -> f64 {
        let pixels = || self.case.deviations.data().iter().map(|&w| f64::from(w));
        let cost: f64 = pixels().zip(self.case.costs.data()).map(|(w, c)| w * c).sum();
        let weight: f64 = pixels().sum();
        let samples = THREADS as f64 * (self.case.budget - closing) * weight / cost;
        let counts = self.taken.data().iter().map(|&n| f64::from(n).max(0.25));
        pixels().zip(counts).map(|(w, n)| w * w / n).sum::<f64>() / (weight * weight / samples)
    }
}

fn render(case: &Case, off: Off, seed: u64) -> End {
    Machine {
        case,
        off,
        random: Random(seed),
        now: 0.0,
        stall: case.stall.1,
        taken: plan::empty(SIDE, SIDE),
        map: CostMap::new(TileGrid::new(SIDE, SIDE, 16)),
        pass: FIRST_PASS,
    }
    .run()
}

/// A row of the table over the given kinds.
fn row(name: &str, kinds: &[usize], off: Off) {
    let (mut missed, mut worst, mut unused, mut noise, mut renders) = (0, 0.0f64, 0.0, 0.0, 0);
    for (&kind, budget) in kinds.iter().flat_map(|kind| BUDGETS.map(|budget| (kind, budget))) {
        for seed in 0..SEEDS {
            let end = render(&case(kind, budget, seed), off, seed);
            let over = (end.seconds - budget) / tolerance(budget);
            missed += u32::from(over > 1.0);
            worst = worst.max(over);
            unused += (1.0 - end.seconds / budget).max(0.0);
            noise += end.noise.ln();
            renders += 1;
        }
    }
    let n = f64::from(renders);
    let (missed, unused) = (100.0 * f64::from(missed) / n, 100.0 * unused / n);
    println!("| {name} | {missed:.1} % | {worst:.2} | {unused:.1} % | {:.3} |", (noise / n).exp());
}

fn main() -> Result<(), String> {
    let all: Vec<usize> = (0..KINDS.len()).collect();
    let names: Vec<String> = env::args().skip(1).collect();
    println!("| | missed | overrun | unused | noise |\n|---|---:|---:|---:|---:|");
    let mut off = Off::default();
    for name in &names {
        off = off.switch(name).ok_or_else(|| format!("there is no {name}; there are {}", NAMES.join(", ")))?;
    }
    row("all of them", &all, off);
    for (kind, name) in KINDS.iter().enumerate() {
        row(name, &[kind], off);
    }
    if names.is_empty() {
        for name in NAMES {
            row(&format!("without {name}"), &all, off.switch(name).unwrap_or_default());
        }
    }
    Ok(())
}
