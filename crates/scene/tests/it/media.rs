//! Distances in homogeneous media: samples follow the density, and weights are unbiased in every channel.
//!
//! Replay: `cargo test -p dunkelfeld-scene --test it media`.

use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, Mask, dispatch};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::{Sampler, keyed_stream, mix64};
use dunkelfeld_scene::{Medium, MediumEvents, MediumLanes, Volume};
use dunkelfeld_testkit::{DensityTest, SampleMoments, sidak, z_test};
use rand_core::Rng;

/// False-alarm rate of each test function.
const RATE: f64 = 1e-9;

struct Uniform(dunkelfeld_sampling::Pcg);

impl Uniform {
    fn new(key: u64) -> Self {
        Self(keyed_stream(31, 0, 0, mix64(key)))
    }

    fn next(&mut self) -> f32 {
        (self.0.next_u32() >> 8) as f32 / (1 << 24) as f32
    }

    fn three(&mut self) -> [f32; 3] {
        [self.next(), self.next(), self.next()]
    }
}

fn medium(absorption: [f32; 3], scattering: [f32; 3]) -> Medium {
    Medium::new(&Volume {
        absorption: Rgb::from_array(absorption),
        scattering: Rgb::from_array(scattering),
        ..Volume::default()
    })
}

/// Distance and weight of an event; there is no distance if the path reaches the end.
fn sample(medium: &Medium, throughput: Rgb, end: f32, u: [f32; 3]) -> (Option<f32>, Rgb) {
    let MediumEvents { is_scattered, distance, weight } = medium.coefficients().sample(throughput, end, u);
    (is_scattered.then_some(distance), weight)
}

/// Media, path throughputs, and ends: grey and coloured, with channels that scatter nothing or everything.
fn cases() -> Vec<(Medium, Rgb, f32)> {
    let mut cases = Vec::new();
    for (absorption, scattering) in [
        ([0.0; 3], [40.0; 3]),
        ([3.0, 20.0, 90.0], [50.0, 20.0, 5.0]),
        ([0.0, 1.0, 2.0], [0.0, 100.0, 0.0]),
        ([1000.0, 10.0, 0.0], [1.0, 300.0, 0.5]),
    ] {
        for throughput in [Rgb::WHITE, Rgb::new(1e-3, 0.5, 2.0), Rgb::new(0.0, 3e-20, 1e-20)] {
            for end in [0.002, 0.03, 0.2] {
                cases.push((medium(absorption, scattering), throughput, end));
            }
        }
    }
    cases
}

#[test]
fn distances_follow_their_density() {
    let cases = cases();
    for (k, (medium, throughput, end)) in cases.iter().enumerate() {
        let mut u = Uniform::new(k as u64);
        // The distance as a share of the end. A path that passes gives no sample, and the probability of that must be
        // the rest.
        let sample = || Some([f64::from(sample(medium, *throughput, *end, u.three()).0? / end), 0.5]);
        let density = |[x, _]: [f64; 2]| f64::from(end * medium.pdf(*throughput, end * x as f32));
        let what = format!("case {k}: {medium:?}, throughput {throughput:?}, end {end}");
        let test = DensityTest { columns: 256, rows: 1, samples: 50_000 };
        test.run(&what, sample, density).assert(sidak(RATE, cases.len()), &what);
        let total = 1e-3 * (0..1000).map(|i| density([(f64::from(i) + 0.5) * 1e-3, 0.0])).sum::<f64>()
            + f64::from(medium.probability_to_pass(*throughput, *end));
        // The midpoint rule resolves a decay of up to 200 mean free paths in a thousand steps.
        assert!((total - 1.0).abs() < 3e-3, "{what}: density and probability sum to {total}");
    }
}

#[test]
fn weights_are_unbiased_in_every_channel() {
    // E[weight; pass] is the transmittance; E[weight; scatter] is the share that scatters, albedo (1 - transmittance).
    let cases = cases();
    for (k, (medium, throughput, end)) in cases.iter().enumerate() {
        let mut u = Uniform::new(100 + k as u64);
        let (mut passed, mut scattered) = ([SampleMoments::default(); 3], [SampleMoments::default(); 3]);
        for _ in 0..40_000 {
            let (pass, scatter) = match sample(medium, *throughput, *end, u.three()) {
                (None, weight) => (weight, Rgb::BLACK),
                (Some(_), weight) => (Rgb::BLACK, weight),
            };
            // The balance heuristic keeps the sum of the channels from growing.
            let (before, after) = (*throughput, (pass + scatter) * *throughput);
            assert!(after.mean() <= before.mean() * 1.0001 && after.r >= 0.0 && after.g >= 0.0 && after.b >= 0.0);
            for c in 0..3 {
                passed[c].push(f64::from(pass[c]));
                scattered[c].push(f64::from(scatter[c]));
            }
        }
        let (left, albedo) = (medium.transmittance(*end), medium.albedo());
        for c in (0..3).filter(|&c| throughput[c] > 0.0) {
            let what = |event| format!("case {k}, channel {c}, {event}: {medium:?}, {throughput:?}, end {end}");
            let rate = sidak(RATE, 6 * cases.len());
            // A rare event needs its share of samples for the normal approximation; where the channel is hardly ever
            // chosen the weight is bounded by the sum rule above, and the mean is tested where 50 of its samples are
            // expected.
            let likely = |p: f32| 40_000.0 * p > 50.0;
            let t = medium.extinction()[c];
            if likely(medium.probability_to_pass(*throughput, *end))
                && likely(left[c] * throughput[c] / throughput.mean())
            {
                let m = passed[c];
                z_test(m.mean(), m.standard_error().max(1e-6), f64::from(left[c])).assert(rate, &what("pass"));
            }
            if t > 0.0 && likely(throughput[c] / throughput.mean()) {
                let m = scattered[c];
                let expected = f64::from(albedo[c]) * -f64::from(-t * end).exp_m1();
                z_test(m.mean(), m.standard_error().max(1e-6), expected).assert(rate, &what("scatter"));
            }
        }
    }
}

#[test]
fn a_grey_medium_without_absorption_has_weight_one() {
    let mut u = Uniform::new(7);
    for density in [1e-3, 1.0, 1e6] {
        let medium = medium([0.0; 3], [density; 3]);
        for _ in 0..1000 {
            let (_, weight) = sample(&medium, Rgb::new(0.2, 0.5, 1.0), 1.0 / density, u.three());
            assert!((0..3).all(|c| (weight[c] - 1.0).abs() < 1e-6), "density {density}: {weight:?}");
        }
    }
}

#[test]
fn zero_density_is_clear_and_extremes_are_finite() {
    let mut u = Uniform::new(8);
    for _ in 0..1000 {
        assert_eq!(sample(&Medium::clear(), Rgb::WHITE, f32::INFINITY, u.three()), (None, Rgb::WHITE));
    }
    assert_eq!(Medium::clear().transmittance(f32::INFINITY), Rgb::WHITE);
    assert!(Medium::new(&Volume::default()).is_clear());
    let values = [0.0, 1e-30, 1.0, 1e6, 1e30];
    let ends = [0.0, 1e-30, 1e-6, 1.0, 1e20, f32::INFINITY];
    for k in 0..50_000u32 {
        let mut pick = |from: &[f32]| from[((u.next() * from.len() as f32) as usize).min(from.len() - 1)];
        let three = |pick: &mut dyn FnMut(&[f32]) -> f32| [pick(&values), pick(&values), pick(&values)];
        let medium = medium(three(&mut pick), three(&mut pick));
        let throughput = Rgb::from_array(three(&mut pick));
        let end = pick(&ends);
        let numbers = if k % 3 == 0 { [0.999_999_94; 3] } else { u.three() };
        let (_, weight) = sample(&medium, throughput, end, numbers);
        assert!(weight.is_finite() && (0..3).all(|c| weight[c] >= 0.0), "{medium:?} {throughput:?} {end}: {weight:?}");
    }
}

#[test]
fn attenuation_and_coefficients_add_up() {
    let volume = Volume {
        attenuation_color: Rgb::new(0.5, 0.25, 1.0),
        attenuation_distance: 0.01,
        scattering_albedo: Rgb::new(0.75, 0.0, 1.0),
        absorption: Rgb::splat(2.0),
        scattering: Rgb::new(0.0, 3.0, 0.0),
        ..Volume::default()
    };
    let medium = Medium::new(&volume);
    let ln2 = 100.0 * std::f32::consts::LN_2;
    let close = |a: Rgb, b: [f32; 3]| (0..3).all(|c| (a[c] - b[c]).abs() <= 1e-5 * b[c]);
    assert!(close(medium.absorption, [2.0 + 0.25 * ln2, 2.0 + 2.0 * ln2, 2.0]), "{medium:?}");
    assert!(close(medium.scattering, [0.75 * ln2, 3.0, 0.0]), "{medium:?}");
    let clear = Volume { absorption: Rgb::BLACK, scattering: Rgb::BLACK, ..volume };
    assert!(close(Medium::new(&clear).transmittance(0.01), [0.5, 0.25, 1.0]));
}

#[test]
fn stratified_numbers_reach_beyond_sixteen_mean_free_paths() {
    // 2^-24 is exp(-16.6): without further digits nothing would pass 20 mean free paths. Here every batch of the
    // sampler holds the first number at its very end with the digits spread behind it.
    let medium = medium([0.0; 3], [20.0; 3]);
    let last = 1.0 - 1.0 / (1 << 24) as f32;
    let n = 4096;
    let passed = (0..n)
        .filter(|&s| {
            let digits = Sampler::new(5, 0, 0, s).get_1d(1);
            sample(&medium, Rgb::WHITE, 1.0, [last, 0.5, digits]).0.is_none()
        })
        .count() as f64;
    let expected = f64::from(n) * (-20f64).exp() * f64::from(1 << 24);
    assert!((passed / expected - 1.0).abs() < 0.02, "{passed}, expected {expected}");
}

/// Events of the cases in lanes.
#[inline(always)]
fn events<F: Lanes>(token: F::Token, cases: &[(Medium, Rgb, f32)], u: &[[f32; 3]], out: &mut Vec<[u32; 5]>) {
    for at in (0..cases.len()).step_by(F::WIDTH) {
        let mut media = [MediumLanes::CLEAR; MAX_WIDTH];
        let (mut throughput, mut end, mut numbers) = ([Rgb::BLACK; MAX_WIDTH], [0.0; MAX_WIDTH], [[0.0; MAX_WIDTH]; 3]);
        for lane in 0..F::WIDTH.min(cases.len() - at) {
            let case = &cases[at + lane];
            (media[lane], throughput[lane], end[lane]) = (case.0.coefficients(), case.1, case.2);
            for k in 0..3 {
                numbers[k][lane] = u[at + lane][k];
            }
        }
        let u = [F::load(token, &numbers[0]), F::load(token, &numbers[1]), F::load(token, &numbers[2])];
        let (throughput, end) = (Rgb::from_lanes(token, &throughput), F::load(token, &end));
        let found = MediumLanes::from_lanes(token, &media).sample(throughput, end, u);
        let (distance, weight) = (found.distance.to_array(), found.weight.to_lanes());
        for lane in 0..F::WIDTH.min(cases.len() - at) {
            let [r, g, b] = weight[lane].to_array().map(f32::to_bits);
            let is_scattered = found.is_scattered.bits() >> lane & 1;
            out.push([is_scattered, is_scattered * distance[lane].to_bits(), r, g, b]);
        }
    }
}

#[test]
fn all_widths_have_the_same_bits() {
    let mut cases = cases();
    cases.push((Medium::clear(), Rgb::WHITE, f32::INFINITY));
    cases.push((medium([3.0, 0.0, 1e30], [0.0; 3]), Rgb::WHITE, 0.4));
    let mut u = Uniform::new(9);
    for _ in 0..500 {
        let numbers: Vec<_> = cases.iter().map(|_| u.three()).collect();
        let mut expected = Vec::new();
        events::<f32>((), &cases, &numbers, &mut expected);
        for set in InstructionSet::all() {
            let mut found = Vec::new();
            dispatch!(set, F, token => events::<F>(token, &cases, &numbers, &mut found));
            assert_eq!(found, expected, "{set:?}");
        }
    }
}
