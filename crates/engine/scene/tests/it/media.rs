//! Distances in homogeneous media: samples follow the density, and weights are unbiased in every channel.
//!
//! Replay: `cargo test -p dunkelfeld-scene --test it media`.

use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::{Sampler, keyed_stream, mix64};
use dunkelfeld_scene::{Medium, MediumEvents, Volume};
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
