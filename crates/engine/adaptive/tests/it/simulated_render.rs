//! Tests of schedule, plan and work queue together, on simulated machines and images whose pixels have very different costs.
//! No test here reads a real clock.

use dunkelfeld_adaptive::budget::tolerance;
use dunkelfeld_adaptive::{
    Affordable, Levels, Limits, Phase, SamplePlan, Schedule, Settings, Step, StopReason, TileGrid, WorkQueue, WorkUnit,
    plan, weights,
};
use dunkelfeld_film::Plane;

const SIDE: u32 = 64;
const PIXELS: u64 = SIDE as u64 * SIDE as u64;

/// A machine and an image.
struct Machine<'a> {
    threads: usize,
    /// The time limit, and the seconds after the last sample [s].
    budget: Option<f64>,
    closing: f64,
    /// Seconds of a sample of each pixel, and the factor on them at a time.
    costs: &'a Plane<f64>,
    slowness: &'a dyn Fn(f64) -> f64,
    /// The plan after the pilot.
    weights: Plane<f32>,
    /// Samples that each pixel needs: the render ends when 99 % of the pixels have theirs.
    need: Option<&'a Plane<f32>>,
}

/// A finished render.
struct Run {
    end: f64,
    stop: StopReason,
    taken: SamplePlan,
    /// Samples at the plan, if there was one.
    planned_at: Vec<u64>,
}

impl<'a> Machine<'a> {
    fn new(budget: f64, costs: &'a Plane<f64>) -> Self {
        let weights = weights::uniform(SIDE, SIDE);
        let closing = (0.02 * budget).min(0.1);
        Self { threads: 2, budget: Some(budget), closing, costs, slowness: &|_| 1.0, weights, need: None }
    }

    fn deadline(&self) -> f64 {
        self.budget.map_or(f64::INFINITY, |budget| budget - self.closing - (0.01 * budget).min(0.25))
    }

    fn affordable(&self, queue: &WorkQueue, now: f64) -> Affordable {
        match self.budget.map(|_| queue.affordable(self.threads as f64 * (self.deadline() - now))) {
            None => Affordable::All,
            Some(None) => Affordable::Unknown,
            Some(Some(samples)) => Affordable::Samples(samples),
        }
    }

    fn render(&self) -> Run {
        let limits = Limits { seconds: self.budget, stop_on_noise: self.need.is_some(), ..Limits::default() };
        let mut schedule = Schedule::new(limits, Settings { pixels: PIXELS, pilot_spp: 16 });
        let mut queue = WorkQueue::new(TileGrid::new(SIDE, SIDE, 16));
        let mut taken = plan::empty(SIDE, SIDE);
        let mut weights = weights::uniform(SIDE, SIDE);
        let (mut now, mut planned_at) = (0.0, Vec::new());
        let stop = loop {
            let round = match schedule.next(self.affordable(&queue, now)) {
                Step::Stop(reason) => break reason,
                Step::CheckNoise => {
                    let pixels = || taken.data().iter().zip(self.need.expect("a target").data());
                    if pixels().filter(|(n, need)| **need > **n as f32).count() * 100 <= PIXELS as usize {
                        break StopReason::NoiseTarget;
                    }
                    schedule.stop_on_noise(pixels().map(|(&n, &need)| f64::from(need).max(f64::from(n))).sum());
                    (weights, now) = (self.weights.clone(), now + 2e-3);
                    continue;
                }
                Step::Round(round) => round,
            };
            if round.replan {
                weights = self.weights.clone();
                planned_at.push(schedule.taken());
            }
            let target = plan::next_round(&taken, &weights, schedule.taken() + round.samples);
            let is_over = self.round(&mut queue, &mut taken, &target, round.most, &mut now);
            schedule.record(plan::total(&taken));
            assert!(round.phase == Phase::Refine || planned_at.is_empty());
            if is_over {
                break StopReason::Time;
            }
        };
        Run { end: now + self.closing, stop, taken, planned_at }
    }

    /// The threads take units until the round or the time is over. Returns whether the time is.
    fn round(
        &self,
        queue: &mut WorkQueue,
        taken: &mut SamplePlan,
        target: &Plane<u32>,
        most: u64,
        now: &mut f64,
    ) -> bool {
        let before = taken.clone();
        queue.begin([&before, target], plan::total(&before));
        let levels = Levels { first: PIXELS / 16, most: most.max(queue.target()), pixels: PIXELS };
        let mut threads = vec![(*now, Vec::<(WorkUnit, u64, f64)>::new()); self.threads];
        let (mut units, mut is_complete, mut is_over) = (Vec::new(), false, false);
        while let Some((time, work)) = threads.iter_mut().filter(|t| t.0.is_finite()).min_by(|a, b| a.0.total_cmp(&b.0))
        {
            *now = now.max(*time);
            work.drain(..).for_each(|(unit, samples, seconds)| queue.record(unit.tile, samples, seconds));
            while !is_complete && !is_over && !queue.take(&mut units) {
                match levels.after(queue.issued(), self.affordable(queue, *time)) {
                    Some(samples) => queue.raise(samples),
                    None => is_complete = true,
                }
            }
            is_over |= *time > self.deadline() && plan::total(taken) >= PIXELS / 16;
            if is_complete || is_over {
                *time = f64::INFINITY;
                continue;
            }
            let mut end = *time;
            for unit in &units {
                let rect = queue.costs().grid().rect(unit.tile);
                let (mut samples, mut seconds) = (0, 0.0);
                for (x, y) in (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y))) {
                    let range = unit.range([x, y], [*before.at(x, y), *target.at(x, y)]);
                    samples += range.len() as u64;
                    seconds += range.len() as f64 * self.costs.at(x, y) * (self.slowness)(*time);
                    taken.data_mut()[(y * SIDE + x) as usize] += range.len() as u32;
                }
                work.push((*unit, samples, seconds));
                end += seconds;
            }
            // A longer unit would be abandoned.
            *time = end.min(self.deadline() + (0.01 * self.budget.unwrap_or(0.0)).max(0.1));
        }
        is_over
    }

    /// Renders, and checks the contract: no overrun beyond the tolerance, and at least 95 % of the limit used.
    fn check(&self, what: &str) -> Run {
        let (run, budget) = (self.render(), self.budget.expect("a limit"));
        assert!(run.end <= budget + tolerance(budget), "{what}: {budget} s became {} s", run.end);
        assert!(run.end >= 0.95 * budget, "{what}: only {} of {budget} s used", run.end);
        run
    }
}

const BUDGETS: [f64; 4] = [0.3, 1.0, 5.0, 60.0];

fn even(seconds: f64) -> Plane<f64> {
    Plane::new(SIDE, SIDE, seconds)
}

/// The least and the largest number of samples of a tile.
fn of_tiles(taken: &SamplePlan) -> (u32, u32) {
    let grid = TileGrid::new(SIDE, SIDE, 16);
    let sums = (0..grid.len()).map(|tile| {
        let rect = grid.rect(tile);
        (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| *taken.at(x, y))).sum::<u32>()
    });
    sums.fold((u32::MAX, 0), |(least, most), n| (least.min(n), most.max(n)))
}

#[test]
fn renders_end_in_time_at_any_speed_and_on_any_number_of_threads() {
    for budget in BUDGETS {
        for threads in [1, 2, 16] {
            for per_sample in [1e-7, 1e-6, 1e-5, 1e-4] {
                let (what, costs) = (format!("{threads} threads at {per_sample} s"), even(per_sample));
                let run = Machine { threads, ..Machine::new(budget, &costs) }.check(&what);
                let share = plan::total(&run.taken) as f64 * per_sample / (budget * threads as f64);
                assert!(share > 0.9, "{what}: {share} of {budget} s for samples");
                let (least, most) = of_tiles(&run.taken);
                assert!(
                    f64::from(most - least) <= 300.0 + 0.03 * f64::from(most),
                    "{what}: {least} to {most} of a tile"
                );
            }
        }
    }
}

#[test]
fn a_machine_that_becomes_slower_does_not_overrun_and_stays_even() {
    let costs = even(2e-6);
    for budget in BUDGETS {
        for percent in (0..100).step_by(3) {
            let turn = budget * f64::from(percent) / 100.0;
            let slowness = |now: f64| if now < turn { 1.0 } else { 2.4 };
            let machine = Machine { slowness: &slowness, ..Machine::new(budget, &costs) };
            let run = machine.check(&format!("2.4 times slower from {turn} s on"));
            let (least, most) = of_tiles(&run.taken);
            assert!(f64::from(least) >= 0.8 * f64::from(most) - 300.0, "from {turn} s on: {least} to {most} of a tile");
        }
        for drift in [-0.9, -0.5, 1.0, 4.0] {
            let slowness = |now: f64| 1.0 + drift * (now / budget).min(1.0);
            Machine { slowness: &slowness, ..Machine::new(budget, &costs) }.check(&format!("drift of {drift}"));
        }
    }
}

#[test]
fn one_expensive_pixel_with_most_samples_does_not_delay_the_end() {
    // One pixel costs a thousand times the rest per sample, and the plan gives it fifty times more samples.
    let costs = Plane::from_fn(SIDE, SIDE, |x, y| if (x, y) == (21, 37) { 1e-3 } else { 1e-6 });
    let weights = Plane::from_fn(SIDE, SIDE, |x, y| if (x, y) == (21, 37) { 50.0 } else { 1.0 });
    for budget in BUDGETS {
        let run = Machine { weights: weights.clone(), ..Machine::new(budget, &costs) }.check("dear");
        if budget >= 1.0 {
            // A neighbour in the same tile has the same level.
            let ratio = f64::from(*run.taken.at(21, 37)) / f64::from(*run.taken.at(22, 37));
            assert!((12.0..60.0).contains(&ratio), "{budget} s: {ratio} times the samples");
            assert_eq!(run.planned_at.len(), 1);
        }
    }
}

#[test]
fn a_heavy_tail_of_pixel_costs_is_no_trouble() {
    // Pareto-distributed with exponent 1.2: few pixels dominate the mean.
    let costs = Plane::from_fn(SIDE, SIDE, |x, y| {
        let mut h = u64::from(y * SIDE + x + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        h ^= h >> 29;
        h = h.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let u = ((h >> 11) as f64 + 0.5) * (-53f64).exp2();
        0.3e-6 * u.powf(-1.0 / 1.2)
    });
    for budget in BUDGETS {
        let run = Machine::new(budget, &costs).check("heavy tail");
        let (least, most) = of_tiles(&run.taken);
        assert!(f64::from(most - least) <= 300.0 + 0.03 * f64::from(most), "{least} to {most} of a tile");
    }
}

/// The pilot is a fifth of the affordable samples, or 16 per pixel if these are more and at most a quarter. With three
/// samples per pixel the render cannot adapt.
#[test]
fn the_pilot_has_its_share() {
    let pilot_of = |spp: f64| {
        let costs = even(2.0 * 19.65 / (PIXELS as f64 * spp));
        let planned_at = Machine::new(20.0, &costs).check("pilot").planned_at;
        planned_at.first().map(|n| (n / PIXELS) as u32)
    };
    assert_eq!(pilot_of(200.0), Some(40));
    assert_eq!(pilot_of(70.0), Some(16));
    assert_eq!(pilot_of(34.0), Some(8));
    assert_eq!(pilot_of(3.0), None);
}

/// A budget without time for the end gives an image of one sample for each sixteenth pixel.
#[test]
fn there_is_an_image_in_any_case() {
    let costs = even(1e-4);
    let run = Machine { closing: 0.2, ..Machine::new(0.1, &costs) }.render();
    assert_eq!((plan::total(&run.taken), run.stop), (PIXELS / 16, StopReason::Time));
    assert!(of_tiles(&run.taken) == (16, 16));
}

#[test]
fn an_expensive_pixel_of_large_need_does_not_delay_the_render() {
    // One pixel costs a thousand times the rest per sample, and needs more samples by the same factor: more work than
    // all others together.
    let costs = Plane::from_fn(SIDE, SIDE, |x, y| if (x, y) == (21, 37) { 1e-3 } else { 1e-6 });
    let need = Plane::from_fn(SIDE, SIDE, |x, y| if (x, y) == (21, 37) { 1e5 } else { 100.0 + x as f32 });
    let machine = |budget| Machine { weights: need.clone(), need: Some(&need), budget, ..Machine::new(1.0, &costs) };
    for budget in [1.0, 5.0, 20.0, 60.0] {
        let run = machine(Some(budget)).render();
        assert!(run.end <= budget + tolerance(budget), "{budget} s: {} s", run.end);
        assert!(run.stop == StopReason::NoiseTarget || run.end >= 0.9 * budget, "{budget} s: {} s", run.end);
    }
    // With enough time the render ends by itself, and no pixel has many more samples than it needs.
    let run = machine(Some(3600.0)).render();
    assert!(run.stop == StopReason::NoiseTarget && run.end < 400.0, "{:?} after {} s", run.stop, run.end);
    let run = machine(None).render();
    assert_eq!(run.stop, StopReason::NoiseTarget);
    let needed: f64 = need.data().iter().map(|&n| f64::from(n)).sum();
    assert!((plan::total(&run.taken) as f64) < 1.1 * needed, "{} samples where {needed} do", plan::total(&run.taken));
}

#[test]
fn no_plan_of_a_render_by_samples_feels_the_clock() {
    let need = Plane::from_fn(SIDE, SIDE, |x, y| 20.0 + ((x * y) % 200) as f32);
    let taken = |threads, costs: &Plane<f64>| {
        let weights = need.map(|n| n.sqrt());
        Machine { threads, budget: None, weights, need: Some(&need), ..Machine::new(1.0, costs) }.render().taken
    };
    let dear = Plane::from_fn(SIDE, SIDE, |x, _| 1e-5 * f64::from(x + 1));
    assert!(taken(2, &even(1e-7)) == taken(5, &dear));
}
