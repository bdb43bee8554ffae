//! Tests of schedule, plan and cost map together, on a simulated machine with two threads and an image whose pixels
//! have very different costs. No test here reads a real clock.

use dunkelfeld_adaptive::tile_cost::{self, CostMap, TileGrid, WorkUnit};
use dunkelfeld_adaptive::{Limits, SamplePlan, Schedule, Settings, Shares, Step, StopReason, plan, weights};
use dunkelfeld_film::Plane;

const THREADS: usize = 2;
const SIDE: u32 = 64;

/// Seconds of a unit, summed over its pixels.
fn seconds(unit: &WorkUnit, grid: TileGrid, taken: &SamplePlan, increment: &Plane<u32>, costs: &Plane<f64>) -> f64 {
    let rect = grid.rect(unit.tile);
    let pixels = (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y)));
    pixels.map(|(x, y)| unit.range(*taken.at(x, y), *increment.at(x, y)).len() as f64 * costs.at(x, y)).sum()
}

struct Result {
    end: f64,
    taken: SamplePlan,
    replans: usize,
}

/// Renders an image with the given seconds per sample and the given Sobel weights of each pixel.
fn render(budget: f64, costs: &Plane<f64>, weights: &Plane<f32>) -> Result {
    let (closing, overhead) = ((0.02 * budget).min(0.1), 5e-4);
    let pixels = u64::from(SIDE * SIDE);
    let limits = Limits { seconds: Some(budget), ..Limits::default() };
    let mut schedule = Schedule::new(limits, Settings { pixels, pilot_spp: 16, closing_seconds: closing });
    let grid = TileGrid::new(SIDE, SIDE, 16);
    let mut map = CostMap::new(grid);
    let mut taken = plan::empty(SIDE, SIDE);
    let mut shares = Shares::from_weights(weights::uniform(SIDE, SIDE));
    let (mut now, mut work_per_sample, mut replans) = (0.0, 1.0, 0);
    loop {
        let round = match schedule.next(now, work_per_sample) {
            Step::Stop(reason) => {
                assert_eq!(reason, StopReason::Time);
                return Result { end: now + closing, taken, replans };
            }
            Step::CheckNoise => panic!("nobody judges here"),
            Step::Round(round) => round,
        };
        if round.replan {
            shares = Shares::from_weights(weights.clone());
            replans += 1;
        }
        let next = |samples: u64| plan::next_round(&taken, &shares, schedule.taken() + samples);
        let Dealt { samples, next, increment, units, work } = deal(&schedule, &mut map, &taken, round.samples, next);
        let took = work_off(&units, &mut map, |unit| seconds(unit, grid, &taken, &increment, costs));
        schedule.record(samples, work, took);
        work_per_sample = work / samples as f64;
        now += took + overhead;
        taken = next;
    }
}

/// A round after its samples were distributed.
struct Dealt {
    samples: u64,
    next: SamplePlan,
    increment: Plane<u32>,
    units: Vec<WorkUnit>,
    work: f64,
}

/// A round of the given number of samples, or of the number that fits the time once their pixels are known.
fn deal(
    schedule: &Schedule,
    map: &mut CostMap,
    taken: &SamplePlan,
    mut samples: u64,
    next: impl Fn(u64) -> SamplePlan,
) -> Dealt {
    loop {
        let next = next(samples);
        let increment = plan::increment(taken, &next);
        let units = map.cut(&increment, THREADS);
        let work = tile_cost::makespan(&units, THREADS);
        match schedule.trimmed(samples, tile_cost::upper_makespan(&units, THREADS)) {
            Some(fewer) => samples = fewer,
            None => return Dealt { samples, next, increment, units, work },
        }
    }
}

/// Each free thread takes the next unit and measures its cost, which updates the map. Returns the seconds until all
/// units are done.
fn work_off(units: &[WorkUnit], map: &mut CostMap, cost_of: impl Fn(&WorkUnit) -> f64) -> f64 {
    let mut busy = [0.0f64; THREADS];
    let mut tiles = vec![(0u64, 0.0); map.grid().len()];
    for unit in units {
        let took = cost_of(unit);
        let thread = usize::from(busy[1] < busy[0]);
        busy[thread] += took;
        tiles[unit.tile].0 = unit.samples;
        tiles[unit.tile].1 += took;
    }
    map.record(&tiles.iter().enumerate().map(|(i, &(n, s))| (i, n, s)).collect::<Vec<_>>());
    busy[0].max(busy[1])
}

fn assert_in_time(budget: f64, end: f64, what: &str) {
    let tolerance = (0.02 * budget).max(0.2);
    assert!(end <= budget + tolerance && end >= 0.9 * budget, "{what}: {budget} s became {end} s");
}

#[test]
fn one_expensive_pixel_with_most_samples_does_not_delay_the_end() {
    // One pixel costs a thousand times the rest per sample, and the plan gives it fifty times more samples.
    let costs = Plane::from_fn(SIDE, SIDE, |x, y| if (x, y) == (21, 37) { 1e-3 } else { 1e-6 });
    let weights = Plane::from_fn(SIDE, SIDE, |x, y| if (x, y) == (21, 37) { 50.0 } else { 1.0 });
    for budget in [0.3, 1.0, 5.0, 20.0, 300.0] {
        let result = render(budget, &costs, &weights);
        assert_in_time(budget, result.end, "one dear pixel");
        if budget >= 1.0 {
            let (dear, other) = (*result.taken.at(21, 37), *result.taken.at(5, 5));
            let ratio = f64::from(dear) / f64::from(other);
            // By the plan the other pixels would have 8 % of the time. They had a fifth of it in the pilot. All
            // remaining time goes to the pixel.
            assert!((18.0..60.0).contains(&ratio), "{budget} s: {dear} samples against {other}");
            assert_eq!(result.replans, 1);
        }
    }
}

#[test]
fn costs_that_follow_the_weights_are_predicted() {
    // Edges are expensive and get the samples: the mean cost rises at the plan, and differs from tile to tile.
    let steep = |x: u32, y: u32| (x / 8 + y / 16).is_multiple_of(3);
    let costs = Plane::from_fn(SIDE, SIDE, |x, y| if steep(x, y) { 8e-6 } else { 0.5e-6 });
    let weights = Plane::from_fn(SIDE, SIDE, |x, y| if steep(x, y) { 6.0 } else { 0.3 });
    for budget in [0.3, 1.0, 5.0, 60.0] {
        let result = render(budget, &costs, &weights);
        assert_in_time(budget, result.end, "dear edges");
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
    for budget in [0.3, 1.0, 5.0, 60.0] {
        let result = render(budget, &costs, &weights::uniform(SIDE, SIDE));
        assert_in_time(budget, result.end, "heavy tail");
        let counts = result.taken.data().iter();
        let (least, most) = (counts.clone().min(), counts.max());
        assert!(most.zip(least).is_some_and(|(m, l)| m - l <= 8), "uniform stays uniform: {least:?} to {most:?}");
    }
}

/// As [`render`], but with a sensor: each pixel needs a number of samples. The render ends when 99 % of the pixels have
/// theirs or the time is up.
fn render_until_hidden(budget: Option<f64>, costs: &Plane<f64>, need: &Plane<f32>) -> (StopReason, Result) {
    let closing = budget.map_or(0.0, |b| (0.02 * b).min(0.1));
    let pixels = u64::from(SIDE * SIDE);
    let limits = Limits { seconds: budget, stop_on_noise: true, ..Limits::default() };
    let mut schedule = Schedule::new(limits, Settings { pixels, pilot_spp: 16, closing_seconds: closing });
    let grid = TileGrid::new(SIDE, SIDE, 16);
    let mut map = CostMap::new(grid);
    let mut taken = plan::empty(SIDE, SIDE);
    let mut shares = Shares::from_weights(weights::uniform(SIDE, SIDE));
    let (mut now, mut work_per_sample, mut replans) = (0.0, 1.0, 0);
    let reason = loop {
        let round = match schedule.next(now, work_per_sample) {
            Step::Stop(reason) => break reason,
            Step::CheckNoise => {
                replans += 1;
                let short = need.data().iter().zip(taken.data()).filter(|(need, n)| **need > **n as f32).count();
                if short * 100 <= need.data().len() {
                    break StopReason::NoiseTarget;
                }
                let target = |(&need, &n): (&f32, &u32)| f64::from(need).max(f64::from(n));
                schedule.stop_on_noise(need.data().iter().zip(taken.data()).map(target).sum());
                shares = Shares { weights: need.map(|n| n.sqrt()), caps: Some(need.clone()) };
                now += 2e-3;
                continue;
            }
            Step::Round(round) => round,
        };
        let next = |samples: u64| plan::next_round(&taken, &shares, schedule.taken() + samples);
        let Dealt { samples, next, increment, units, work } = deal(&schedule, &mut map, &taken, round.samples, next);
        let took = work_off(&units, &mut map, |unit| seconds(unit, grid, &taken, &increment, costs));
        schedule.record(samples, work, took);
        work_per_sample = work / samples as f64;
        now += took + 5e-4;
        taken = next;
    };
    (reason, Result { end: now + closing, taken, replans })
}

#[test]
fn an_expensive_pixel_of_large_need_does_not_delay_the_render() {
    // One pixel costs a thousand times the rest per sample, and needs more samples by the same factor: more work than
    // all others together.
    let costs = Plane::from_fn(SIDE, SIDE, |x, y| if (x, y) == (21, 37) { 1e-3 } else { 1e-6 });
    let need = Plane::from_fn(SIDE, SIDE, |x, y| if (x, y) == (21, 37) { 1e5 } else { 100.0 + x as f32 });
    for budget in [1.0, 5.0, 20.0, 60.0] {
        let (reason, result) = render_until_hidden(Some(budget), &costs, &need);
        if reason == StopReason::Time {
            assert_in_time(budget, result.end, "a dear and needy pixel");
        } else {
            assert!(result.end <= budget, "{budget} s: {} s", result.end);
        }
    }
    // With enough time the render ends by itself, and no pixel has many more samples than it needs.
    let (reason, result) = render_until_hidden(Some(3600.0), &costs, &need);
    assert!(reason == StopReason::NoiseTarget && result.end < 400.0, "{reason:?} after {} s", result.end);
    assert_eq!(render_until_hidden(None, &costs, &need).0, StopReason::NoiseTarget);
    let spent: f64 = result.taken.data().iter().map(|&n| f64::from(n)).sum();
    let needed: f64 = need.data().iter().map(|&n| f64::from(n)).sum();
    assert!(spent < 1.1 * needed, "{spent} samples where {needed} do");
}

#[test]
fn no_plan_of_a_render_by_samples_feels_the_clock() {
    let need = Plane::from_fn(SIDE, SIDE, |x, y| 20.0 + ((x * y) % 200) as f32);
    let cheap = Plane::new(SIDE, SIDE, 1e-7);
    let dear = Plane::from_fn(SIDE, SIDE, |x, _| 1e-5 * f64::from(x + 1));
    let (a, b) = (render_until_hidden(None, &cheap, &need).1, render_until_hidden(None, &dear, &need).1);
    assert!(a.taken == b.taken && a.replans == b.replans);
}
