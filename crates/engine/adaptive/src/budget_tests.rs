//! Tests of the schedule. Those with a time limit, on simulated machines, are in `tests/it/simulated_render.rs`.

use super::*;

/// All rounds of a schedule that only a number of samples limits.
fn untimed(samples: u64, pixels: u64) -> Vec<Round> {
    let limits = Limits { samples: Some(samples), ..Limits::default() };
    let mut schedule = Schedule::new(limits, Settings { pixels, pilot_spp: 16 });
    let mut rounds = Vec::new();
    while let Step::Round(round) = schedule.next(Affordable::All) {
        assert_eq!(round.most, schedule.taken() + round.samples);
        rounds.push(round);
        schedule.record(schedule.taken() + round.samples);
    }
    assert_eq!(schedule.taken(), samples);
    rounds
}

#[test]
fn rounds_without_a_time_limit_grow_fourfold() {
    // One sample per pixel first, then at most four times the samples so far. So an interrupted render has an image.
    let expected = [
        (100, Phase::Pilot, false),
        (300, Phase::Pilot, false),
        (1200, Phase::Pilot, false),
        (4800, Phase::Refine, true),
    ];
    let found: Vec<_> = untimed(6400, 100).iter().map(|r| (r.samples, r.phase, r.replan)).collect();
    assert_eq!(found, expected);
    // Three samples per pixel: the render cannot adapt, and all samples belong to the pilot.
    assert!(untimed(300, 100).iter().all(|r| r.phase == Phase::Pilot));
    assert!(untimed(0, 100).is_empty() && untimed(1, 100).len() == 1 && untimed(u64::MAX, 12).len() < 40);
}

#[test]
fn the_first_limit_to_be_met_stops() {
    let limits = Limits { seconds: Some(2.0), samples: Some(6400), ..Limits::default() };
    let mut schedule = Schedule::new(limits, Settings { pixels: 100, pilot_spp: 16 });
    let of = |step| if let Step::Round(round) = step { (round.samples, round.most) } else { (0, 0) };
    assert_eq!(of(schedule.next(Affordable::Unknown)), (100, 100), "a sample per pixel, to measure their cost");
    schedule.record(100);
    assert_eq!(
        of(schedule.next(Affordable::Samples(200.0))),
        (200, 6400),
        "and more, if they are faster than expected"
    );
    assert_eq!(of(schedule.next(Affordable::Samples(1e9))), (1500, 1600), "a quarter of all is the pilot");
    assert_eq!(schedule.clone().next(Affordable::Samples(0.5)), Step::Stop(StopReason::Time));
    schedule.record(6400);
    assert_eq!(schedule.next(Affordable::Samples(1e9)), Step::Stop(StopReason::Samples));
    assert_eq!(
        Schedule::new(Limits::default(), Settings { pixels: 100, pilot_spp: 16 }).next(Affordable::All),
        Step::Stop(StopReason::Samples)
    );
    assert_eq!((tolerance(0.5), tolerance(60.0)), (0.2, 1.2));
}

#[test]
fn levels_grow_fourfold_and_shrink_toward_the_end() {
    let levels = Levels { first: 10, most: 5000, pixels: 160 };
    let all = |affordable: &dyn Fn(u64) -> Affordable| {
        let mut issued = vec![0];
        while let Some(next) = levels.after(issued[issued.len() - 1], affordable(issued[issued.len() - 1])) {
            issued.push(next);
        }
        issued
    };
    assert_eq!(all(&|_| Affordable::All), [0, 10, 40, 160, 640, 2560, 5000]);
    assert_eq!(all(&|_| Affordable::Unknown), all(&|_| Affordable::All));
    let timed = all(&|issued| Affordable::Samples(3000.0 - issued as f64));
    assert_eq!(timed[..7], [0, 10, 40, 160, 640, 1584, 2150]);
    assert!(timed[7..].windows(2).all(|w| w[1] - w[0] <= 340), "a sample per pixel: {timed:?}");
}

/// Runs a render that checks its noise. The image reaches the noise target after `enough` samples, and each check
/// forecasts `says * enough`. Returns the sample counts of the checks and the reason of the stop.
fn stop_on_noise(limits: Limits, enough: u64, says: f64) -> (Vec<u64>, StopReason) {
    let limits = Limits { stop_on_noise: true, ..limits };
    let mut schedule = Schedule::new(limits, Settings { pixels: 1000, pilot_spp: 16 });
    let mut looks = Vec::new();
    loop {
        match schedule.next(Affordable::All) {
            Step::Stop(reason) => return (looks, reason),
            Step::CheckNoise if schedule.taken() >= enough => return (looks, StopReason::NoiseTarget),
            Step::CheckNoise => {
                looks.push(schedule.taken());
                assert!(looks.len() < 100 && looks.windows(2).all(|w| w[0] < w[1]), "{looks:?}");
                schedule.stop_on_noise(says * enough as f64);
            }
            Step::Round(round) => {
                assert!(round.samples > 0 && !round.replan);
                schedule.record(schedule.taken() + round.samples);
            }
        }
    }
}

#[test]
fn noise_is_checked_after_the_pilot_after_each_doubling_and_at_the_target() {
    let (looks, reason) = stop_on_noise(Limits::default(), 100_000, 1.0);
    assert_eq!((looks, reason), (vec![16_000, 32_000, 64_000], StopReason::NoiseTarget));
    // A forecast that is too low causes small steps, but few of them. A forecast that is no number causes at most
    // doublings.
    let (looks, reason) = stop_on_noise(Limits::default(), 100_000, 0.9);
    assert!(looks.len() <= 6 && reason == StopReason::NoiseTarget, "{looks:?}");
    for odd in [f64::NAN, f64::INFINITY, -1.0] {
        assert_eq!(stop_on_noise(Limits::default(), 100_000, odd).1, StopReason::NoiseTarget);
    }
}

#[test]
fn a_render_with_a_noise_target_keeps_its_other_limits() {
    let samples = Limits { samples: Some(50_000), ..Limits::default() };
    let (looks, reason) = stop_on_noise(samples, u64::MAX, 1.0);
    assert_eq!((looks, reason), (vec![12_000, 24_000, 48_000], StopReason::Samples));
    assert_eq!(stop_on_noise(samples, 20_000, 1.0).1, StopReason::NoiseTarget);
    // Too few samples for a useful pilot: the schedule requests no check.
    let (looks, reason) = stop_on_noise(Limits { samples: Some(3000), ..Limits::default() }, 1, 1.0);
    assert_eq!((looks.len(), reason), (0, StopReason::Samples));
}

#[test]
fn a_pilot_grows_until_it_is_large_enough_and_never_beyond_its_share() {
    let run = |samples: u64, wanted: &[u32]| {
        let limits = Limits { samples: Some(samples), stop_on_noise: true, ..Limits::default() };
        let mut schedule = Schedule::new(limits, Settings { pixels: 1000, pilot_spp: 4 });
        let (mut wanted, mut looks) = (wanted.iter(), Vec::new());
        loop {
            match schedule.next(Affordable::All) {
                Step::Stop(_) => return (looks, schedule),
                Step::CheckNoise => {
                    looks.push(schedule.taken());
                    if !wanted.next().is_some_and(|&spp| schedule.grow_pilot(spp)) {
                        schedule.stop_on_noise(samples as f64);
                    }
                }
                Step::Round(round) => schedule.record(schedule.taken() + round.samples),
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
    let settings = Settings { pixels: 100, pilot_spp: 16 };
    let pilot = |max_pilot_spp| {
        let limits = Limits { samples: Some(6_553_600), max_pilot_spp, ..Limits::default() };
        let mut schedule = Schedule::new(limits, settings);
        loop {
            match schedule.next(Affordable::All) {
                Step::Round(round) if round.phase == Phase::Pilot => schedule.record(schedule.taken() + round.samples),
                Step::Round(round) => break (schedule.taken(), round.replan),
                other => panic!("{other:?}"),
            }
        }
    };
    assert_eq!(pilot(None), (13_104 * 100, true));
    assert_eq!(pilot(Some(32)), (3200, true));
    assert_eq!(pilot(Some(1)), (400, true), "a variance needs a sample in each batch");
}
