//! Tests of the schedule on machines that are steady, drift, stall or have uneven costs. All machines are simulated: no
//! test here reads a real clock.

use super::*;

/// A simulated machine on which a model gives the time of each round.
struct Machine<'a> {
    budget: f64,
    pixels: u64,
    /// True seconds after the last sample. The schedule gets the same value.
    closing: f64,
    /// Seconds between rounds.
    overhead: f64,
    /// Relative error of the measured seconds, at most this share.
    clock_noise: f64,
    /// Wall-clock seconds of a round, as a function of its number of samples and its start time.
    cost: &'a mut dyn FnMut(u64, f64) -> f64,
}

struct Run {
    end: f64,
    taken: u64,
    rounds: Vec<(f64, Round)>,
}

/// A small generator for the models. The schedule itself uses no random numbers.
struct Noise(u64);

impl Noise {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 * (-53f64).exp2()
    }
}

impl Machine<'_> {
    fn run(&mut self) -> Run {
        let limits = Limits { seconds: Some(self.budget), samples: None, ..Limits::default() };
        let settings = Settings { pixels: self.pixels, pilot_spp: 16, closing_seconds: self.closing };
        let mut schedule = Schedule::new(limits, settings);
        let mut noise = Noise(self.pixels);
        let (mut now, mut rounds) = (0.0, Vec::new());
        loop {
            match schedule.next(now, 1.0) {
                Step::Stop(reason) => {
                    assert_eq!(reason, StopReason::Time);
                    break;
                }
                Step::CheckNoise => panic!("nobody judges here"),
                Step::Round(round) => {
                    assert!(round.samples > 0);
                    let took = (self.cost)(round.samples, now);
                    rounds.push((now, round));
                    now += took + self.overhead;
                    let measured = took * (1.0 + self.clock_noise * (2.0 * noise.unit() - 1.0));
                    schedule.record(round.samples, round.samples as f64, measured);
                    assert!(rounds.len() < 1000, "too many rounds");
                }
            }
        }
        Run { end: now + self.closing, taken: schedule.taken(), rounds }
    }

    /// Runs and checks the contract: no overrun beyond the tolerance, at least nine tenths of the budget used.
    fn check(&mut self, what: &str) -> Run {
        let run = self.run();
        let (budget, end) = (self.budget, run.end);
        assert!(end <= budget + tolerance(budget), "{what}: {budget} s became {end} s");
        assert!(end >= 0.9 * budget, "{what}: only {end} of {budget} s used");
        run
    }
}

const BUDGETS: [f64; 7] = [0.3, 1.0, 5.0, 20.0, 60.0, 600.0, 3600.0];

fn closing_for(budget: f64) -> f64 {
    (0.05 * budget).min(0.4)
}

#[test]
fn renders_of_constant_speed_end_in_time_at_any_speed() {
    for budget in BUDGETS {
        for pixels in [1, 4096, 512 * 512, 5_000_000] {
            for per_sample in [1e-8, 1e-7, 1e-6, 1e-5, 1e-4] {
                let mut cost = |n: u64, _| n as f64 * per_sample;
                let overhead = (pixels as f64 * 4e-9).min(0.01 * budget);
                let closing = closing_for(budget);
                let mut machine = Machine { budget, pixels, closing, overhead, clock_noise: 0.0, cost: &mut cost };
                let run = machine.check(&format!("{pixels} pixels at {per_sample} s"));
                assert!(run.rounds.len() < 60, "{} rounds for {budget} s", run.rounds.len());
            }
        }
    }
}

#[test]
fn a_noisy_clock_does_not_overrun() {
    for budget in BUDGETS {
        let mut cost = |n: u64, _| n as f64 * 1e-6;
        let closing = closing_for(budget);
        Machine { budget, pixels: 65_536, closing, overhead: 1e-3, clock_noise: 0.5, cost: &mut cost }.check("noise");
    }
}

#[test]
fn a_machine_that_slows_down_threefold_at_any_moment_does_not_overrun() {
    for budget in BUDGETS {
        for percent in 0..100 {
            let turn = budget * f64::from(percent) / 100.0;
            // Work runs at full pace until the turn, and at a third of it afterwards.
            let mut cost = |n: u64, now: f64| {
                let work = n as f64 * 1e-6;
                let fast = (turn - now).clamp(0.0, work);
                fast + 3.0 * (work - fast)
            };
            let closing = closing_for(budget);
            Machine { budget, pixels: 65_536, closing, overhead: 1e-3, clock_noise: 0.05, cost: &mut cost }
                .check(&format!("three times slower from {turn} s on"));
        }
    }
}

#[test]
fn drift_in_either_direction_is_followed() {
    for budget in BUDGETS {
        for drift in [-0.9, -0.5, 1.0, 4.0] {
            let mut cost = |n: u64, now: f64| n as f64 * 2e-6 * (1.0 + drift * (now / budget).min(1.0));
            let closing = closing_for(budget);
            Machine { budget, pixels: 65_536, closing, overhead: 1e-3, clock_noise: 0.05, cost: &mut cost }
                .check(&format!("drift of {drift}"));
        }
    }
}

#[test]
fn stalls_are_absorbed() {
    // A pause of a tenth of the budget begins at any moment of the first seven tenths. A round that starts with 30 % of
    // the time left may take 9 % and then stall. It still ends in time.
    for budget in BUDGETS {
        for percent in 0..70 {
            let stall = budget * f64::from(percent) / 100.0;
            let mut pending = 0.1 * budget;
            let mut cost = |n: u64, now: f64| {
                let work = n as f64 * 1e-6;
                work + if now + work >= stall { std::mem::take(&mut pending) } else { 0.0 }
            };
            let closing = closing_for(budget);
            Machine { budget, pixels: 65_536, closing, overhead: 1e-3, clock_noise: 0.05, cost: &mut cost }
                .check(&format!("stall at {stall} s"));
        }
    }
}

#[test]
fn one_pixel_of_a_thousandfold_cost_does_not_overrun() {
    for budget in BUDGETS {
        for pixels in [64u64, 4096, 262_144] {
            let mut noise = Noise(3);
            // Whole passes take one sample of the pixel each. A part of a pass takes one by chance.
            let mut cost = |n: u64, _| {
                let passes = n as f64 / pixels as f64;
                let hits = passes.floor() + f64::from(noise.unit() < passes.fract());
                let sample = 0.5e-6;
                // Of the two threads, one may have to finish the expensive sample alone.
                (n as f64 * sample + hits * 1000.0 * sample) / 2.0 + if hits > 0.0 { 500.0 * sample } else { 0.0 }
            };
            let closing = closing_for(budget);
            Machine { budget, pixels, closing, overhead: 1e-3, clock_noise: 0.05, cost: &mut cost }
                .check(&format!("one dear pixel of {pixels}"));
        }
    }
}

#[test]
fn stretches_take_their_shares() {
    let mut cost = |n: u64, _| n as f64 * 1e-7;
    let run = Machine { budget: 20.0, pixels: 65_536, closing: 0.4, overhead: 1e-3, clock_noise: 0.0, cost: &mut cost }
        .check("shares");
    let replans: Vec<f64> = run.rounds.iter().filter(|(_, r)| r.replan).map(|(t, _)| t / 20.0).collect();
    assert_eq!(replans.len(), 1, "{replans:?}");
    assert!((0.18..0.21).contains(&replans[0]), "pilot until {}", replans[0]);
    // 98 % of 20 s at 10 M samples/s.
    assert!(run.taken > 185_000_000, "{} samples", run.taken);
    assert!(run.rounds.windows(2).all(|w| w[0].1.phase <= w[1].1.phase));
}

#[test]
fn the_pilot_has_sixteen_samples_per_pixel_where_these_are_affordable() {
    // With 100 affordable samples per pixel the pilot is a fifth of them. With 70 it is 16, which is more than a fifth.
    // With 30 it is a quarter of them. With three the render cannot adapt.
    let pilot_of = |spp: f64| {
        let pixels = 65_536;
        let per_sample = 19.0 / (pixels as f64 * spp);
        let mut cost = |n: u64, _| n as f64 * per_sample;
        let mut machine =
            Machine { budget: 20.0, pixels, closing: 0.4, overhead: 1e-4, clock_noise: 0.0, cost: &mut cost };
        let rounds = machine.check("pilot").rounds;
        let pilot = rounds.iter().filter(|(_, r)| r.phase == Phase::Pilot).map(|(_, r)| r.samples);
        (pilot.sum::<u64>() as f64 / pixels as f64, rounds.iter().any(|(_, r)| r.replan))
    };
    assert_eq!(pilot_of(100.0), (20.0, true));
    assert_eq!(pilot_of(70.0), (16.0, true));
    assert_eq!(pilot_of(30.0), (7.0, true));
    assert!(!pilot_of(3.0).1);
}

/// All rounds of a schedule that only a number of samples limits, on a machine that takes `seconds` for each round.
fn untimed(samples: u64, pixels: u64, seconds: f64) -> Vec<Round> {
    let limits = Limits { samples: Some(samples), ..Limits::default() };
    let mut schedule = Schedule::new(limits, Settings { pixels, pilot_spp: 16, closing_seconds: 1.0 });
    let (mut rounds, mut now) = (Vec::new(), 0.0);
    while let Step::Round(round) = schedule.next(now, 1.0) {
        rounds.push(round);
        schedule.record(round.samples, 3.0, seconds);
        now += seconds;
    }
    assert_eq!(schedule.taken(), samples);
    rounds
}

#[test]
fn without_a_time_limit_no_clock_has_influence() {
    let rounds = untimed(6400, 100, 1e-3);
    // One sample per pixel first, then at most four times the samples so far. So an interrupted render has an image.
    let expected = [
        (100, Phase::Pilot, false),
        (300, Phase::Pilot, false),
        (1200, Phase::Pilot, false),
        (4800, Phase::Refine, true),
    ];
    let expected = expected.map(|(samples, phase, replan)| Round { samples, phase, replan });
    assert_eq!(rounds, expected);
    assert_eq!(untimed(6400, 100, 1e6), rounds);
    for (samples, pixels) in [(1, 100), (100, 100), (399, 100), (401, 100), (1_000_003, 77), (u64::MAX, 12)] {
        assert_eq!(untimed(samples, pixels, 1.0), untimed(samples, pixels, 1e-9));
    }
    // Three samples per pixel: the render cannot adapt, and all samples belong to the pilot.
    assert!(untimed(300, 100, 1.0).iter().all(|r| r.phase == Phase::Pilot));
    assert!(untimed(0, 100, 1.0).is_empty());
}

#[test]
fn the_first_limit_to_be_met_stops() {
    let run = |seconds: f64, samples: u64| {
        let limits = Limits { seconds: Some(seconds), samples: Some(samples), ..Limits::default() };
        let mut schedule = Schedule::new(limits, Settings { pixels: 4096, pilot_spp: 16, closing_seconds: 0.1 });
        let mut now = 0.0;
        loop {
            match schedule.next(now, 1.0) {
                Step::Stop(reason) => return (reason, schedule.taken(), now),
                Step::CheckNoise => panic!("nobody judges here"),
                Step::Round(round) => {
                    let took = round.samples as f64 * 1e-6;
                    schedule.record(round.samples, round.samples as f64, took);
                    now += took;
                }
            }
        }
    };
    let (reason, taken, _) = run(20.0, 1_000_000);
    assert_eq!((reason, taken), (StopReason::Samples, 1_000_000));
    let (reason, taken, now) = run(2.0, 1_000_000_000);
    assert_eq!(reason, StopReason::Time);
    assert!(now > 1.8 && now < 1.95 && taken > 1_800_000, "{taken} samples in {now} s");
}

#[test]
fn the_size_of_a_round_follows_the_expected_work() {
    let mut schedule = Schedule::new(
        Limits { seconds: Some(100.0), ..Limits::default() },
        Settings { pixels: 1000, pilot_spp: 16, closing_seconds: 0.0 },
    );
    schedule.next(0.0, 1.0);
    // A million samples already, so that growth is no bound. A unit of work takes one microsecond.
    schedule.record(1_000_000_000, 1e6, 1.0);
    let samples = |step| if let Step::Round(r) = step { r.samples } else { 0 };
    let cheap = samples(schedule.clone().next(1.0, 0.1));
    let dear = samples(schedule.clone().next(1.0, 1.0));
    assert!((cheap as f64 / dear as f64 - 10.0).abs() < 0.01, "{cheap} against {dear}");
}

#[test]
fn an_image_at_all_may_be_worth_missing_the_budget() {
    let limits = Limits { seconds: Some(0.5), at_least: 1_000_000, ..Limits::default() };
    let mut schedule = Schedule::new(limits, Settings { pixels: 1_000_000, pilot_spp: 16, closing_seconds: 0.0 });
    let mut now = 0.0;
    while let Step::Round(round) = schedule.next(now, 1.0) {
        let took = round.samples as f64 * 1e-5;
        schedule.record(round.samples, round.samples as f64, took);
        now += took;
    }
    assert_eq!(schedule.taken(), 1_000_000);
    assert!(now > 0.5 + tolerance(0.5));
    assert_eq!((tolerance(0.5), tolerance(60.0)), (0.2, 1.2));
}

#[test]
fn a_late_start_still_takes_a_probe_and_odd_clocks_do_not_confuse() {
    let settings = Settings { pixels: 100, pilot_spp: 16, closing_seconds: f64::NAN };
    let mut late = Schedule::new(Limits { seconds: Some(1.0), ..Limits::default() }, settings);
    assert!(matches!(late.next(5.0, 1.0), Step::Round(Round { samples: 100, phase: Phase::Pilot, .. })));
    late.record(100, 100.0, 0.1);
    assert_eq!(late.next(5.1, 1.0), Step::Stop(StopReason::Time));

    let mut odd = Schedule::new(Limits { seconds: Some(1.0), ..Limits::default() }, settings);
    for (elapsed, seconds) in [(0.1, 0.0), (0.05, -1.0), (f64::NAN, f64::NAN), (0.2, f64::INFINITY)] {
        let Step::Round(round) = odd.next(elapsed, f64::NAN) else { panic!("there is time left at {elapsed}") };
        odd.record(round.samples, 0.0, seconds);
    }
    assert_eq!(odd.next(f64::MAX, 1.0), Step::Stop(StopReason::Time));

    for limits in [Limits::default(), Limits { seconds: Some(f64::NAN), ..Limits::default() }] {
        let mut schedule = Schedule::new(limits, settings);
        if let Step::Round(round) = schedule.next(0.0, 1.0) {
            schedule.record(round.samples, 1.0, 1e-3);
        }
        assert!(matches!(schedule.next(0.1, 1.0), Step::Stop(_)));
    }
}

/// Runs a render that checks its noise. The image reaches the noise target after `enough` samples, and each check
/// forecasts `says * enough`. Returns the sample counts of the checks, the reason of the stop and the time at the end
/// \[s\].
fn stop_on_noise(limits: Limits, enough: u64, says: f64, per_sample: f64) -> (Vec<u64>, StopReason, f64) {
    let limits = Limits { stop_on_noise: true, ..limits };
    let mut schedule = Schedule::new(limits, Settings { pixels: 1000, pilot_spp: 16, closing_seconds: 0.01 });
    let (mut now, mut looks) = (0.0, Vec::new());
    loop {
        match schedule.next(now, 1.0) {
            Step::Stop(reason) => return (looks, reason, now),
            Step::CheckNoise if schedule.taken() >= enough => return (looks, StopReason::NoiseTarget, now),
            Step::CheckNoise => {
                looks.push(schedule.taken());
                assert!(looks.len() < 100 && looks.windows(2).all(|w| w[0] < w[1]), "{looks:?}");
                schedule.stop_on_noise(says * enough as f64);
                now += 1e-3;
            }
            Step::Round(round) => {
                assert!(round.samples > 0 && !round.replan);
                let took = round.samples as f64 * per_sample;
                schedule.record(round.samples, round.samples as f64, took);
                now += took;
            }
        }
    }
}

#[test]
fn noise_is_checked_after_the_pilot_after_each_doubling_and_at_the_target() {
    let (looks, reason, _) = stop_on_noise(Limits::default(), 100_000, 1.0, 1e-6);
    assert_eq!((looks, reason), (vec![16_000, 32_000, 64_000], StopReason::NoiseTarget));
    // A forecast that is too low causes small steps, but few of them. A forecast that is no number causes at most
    // doublings.
    let (looks, reason, _) = stop_on_noise(Limits::default(), 100_000, 0.9, 1e-6);
    assert!(looks.len() <= 6 && reason == StopReason::NoiseTarget, "{looks:?}");
    for odd in [f64::NAN, f64::INFINITY, -1.0] {
        assert_eq!(stop_on_noise(Limits::default(), 100_000, odd, 1e-6).1, StopReason::NoiseTarget);
    }
    // No clock has an influence.
    assert_eq!(
        stop_on_noise(Limits::default(), 77_777, 1.0, 1e-9).0,
        stop_on_noise(Limits::default(), 77_777, 1.0, 1.0).0
    );
}

#[test]
fn a_render_with_a_noise_target_keeps_its_other_limits() {
    let samples = Limits { samples: Some(50_000), ..Limits::default() };
    let (looks, reason, _) = stop_on_noise(samples, u64::MAX, 1.0, 1e-6);
    assert_eq!((looks, reason), (vec![12_000, 24_000, 48_000], StopReason::Samples));
    assert_eq!(stop_on_noise(samples, 20_000, 1.0, 1e-6).1, StopReason::NoiseTarget);
    for budget in BUDGETS {
        let time = Limits { seconds: Some(budget), ..Limits::default() };
        let (_, reason, now) = stop_on_noise(time, u64::MAX, 1.0, 1e-6);
        assert!(
            reason == StopReason::Time && now < budget + tolerance(budget) && now > 0.9 * budget,
            "{budget}: {now}"
        );
        // The target is reached after a tenth of the budget. The render then ends, after at most one doubling.
        let enough = (budget * 1e5) as u64;
        let (looks, reason, now) = stop_on_noise(time, enough, 1.0, 1e-6);
        assert!(reason == StopReason::NoiseTarget && now < 0.15 * budget + 0.02, "{budget}: {now} after {looks:?}");
    }
    // Too few samples for a useful pilot: the schedule requests no check.
    let (looks, reason, _) = stop_on_noise(Limits { samples: Some(3000), ..Limits::default() }, 1, 1.0, 1e-6);
    assert_eq!((looks.len(), reason), (0, StopReason::Samples));
}

/// A pilot of fewer samples than batches has no variance. A plan made from it would prefer no pixel, for the whole
/// render.
#[test]
fn a_pilot_measures_its_variance_also_on_a_machine_that_is_slow_at_first() {
    for budget in [0.02, 0.05, 0.1, 0.2, 0.4] {
        let limits = Limits { seconds: Some(budget), ..Limits::default() };
        let mut schedule = Schedule::new(limits, Settings { pixels: 1000, pilot_spp: 16, closing_seconds: 0.0 });
        let (mut now, mut pilot) = (0.0, 0);
        while let Step::Round(round) = schedule.next(now, 1.0) {
            if round.replan {
                assert!(schedule.taken() >= 4000, "{budget}: planned after {} samples", schedule.taken());
            }
            pilot += if round.phase == Phase::Pilot { round.samples } else { 0 };
            // The pace is five times slower at first, while the caches are cold.
            let took = round.samples as f64 * if schedule.taken() < 1000 { 5e-6 } else { 1e-6 };
            schedule.record(round.samples, round.samples as f64, took);
            now += took;
        }
        assert!(pilot > 0 && now <= budget, "{budget}: {now}");
    }
}

#[test]
fn a_pilot_grows_until_it_is_large_enough_and_never_beyond_its_share() {
    let run = |samples: u64, wanted: &[u32]| {
        let limits = Limits { samples: Some(samples), stop_on_noise: true, ..Limits::default() };
        let mut schedule = Schedule::new(limits, Settings { pixels: 1000, pilot_spp: 4, closing_seconds: 0.0 });
        let (mut wanted, mut looks) = (wanted.iter(), Vec::new());
        loop {
            match schedule.next(0.0, 1.0) {
                Step::Stop(_) => return (looks, schedule),
                Step::CheckNoise => {
                    looks.push(schedule.taken());
                    if !wanted.next().is_some_and(|&spp| schedule.grow_pilot(spp)) {
                        schedule.stop_on_noise(samples as f64);
                    }
                }
                Step::Round(round) => schedule.record(round.samples, 1.0, 1.0),
            }
        }
    };
    let (looks, mut schedule) = run(1_000_000, &[16, 64]);
    assert_eq!(looks, [4000, 16_000, 64_000, 128_000, 256_000, 512_000]);
    assert!(!schedule.grow_pilot(1000), "the pilot is over");
    // A quarter of a hundred samples per pixel, in full sets of batches. A call with the present number changes
    // nothing.
    assert_eq!(run(100_000, &[16, 500]).0[..3], [4000, 16_000, 24_000]);
    assert_eq!(run(100_000, &[4, 500]).0[..2], [4000, 8000]);
}

#[test]
fn the_pilot_of_a_large_budget_can_be_limited() {
    let settings = Settings { pixels: 100, pilot_spp: 16, closing_seconds: 0.0 };
    let pilot = |max_pilot_spp| {
        let limits = Limits { samples: Some(6_553_600), max_pilot_spp, ..Limits::default() };
        let mut schedule = Schedule::new(limits, settings);
        loop {
            match schedule.next(0.0, 1.0) {
                Step::Round(round) if round.phase == Phase::Pilot => {
                    schedule.record(round.samples, round.samples as f64, 0.1)
                }
                Step::Round(round) => break (schedule.taken(), round.replan),
                other => panic!("{other:?}"),
            }
        }
    };
    assert_eq!(pilot(None), (13_104 * 100, true));
    assert_eq!(pilot(Some(32)), (3200, true));
    assert_eq!(pilot(Some(1)), (400, true), "a variance needs a sample in each batch");
}
