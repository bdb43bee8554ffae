//! The sampler: stratification, independence, no bias, and less error than random numbers.

use dunkelfeld_sampling::{BATCHES, Sampler, keyed_stream, mix64};
use dunkelfeld_testkit::{SampleMoments, chi_squared, sidak, student_t_test, z_test};
use rand_core::Rng;

/// False-alarm rate of each test function.
const RATE: f64 = 1e-9;

/// Point `index` of a batch, as the sample that carries it.
fn batch_point(pixel: u32, batch: u32, index: u32, set: u32) -> [f32; 4] {
    Sampler::new(7, 0, pixel, index * BATCHES + batch).get_4d(set)
}

#[test]
fn power_of_two_runs_of_each_batch_are_stratified() {
    for (pixel, batch, set) in [(0, 0, 0), (1, 3, 0), (77, 1, 5), (123_456, 2, 4_000_000_000)] {
        for log in [0, 1, 4, 8, 11] {
            let n = 1u32 << log;
            for block in [0, 1, 5] {
                let points: Vec<_> = (0..n).map(|i| batch_point(pixel, batch, block * n + i, set)).collect();
                let place = format!("pixel {pixel}, batch {batch}, set {set}, points {}..+{n}", block * n);
                for d in 0..4 {
                    assert_one_per_cell(n, points.iter().map(|p| (p[d] * n as f32) as u32), &place);
                }
                // Every elementary interval of the first two dimensions: the (0,2)-net property (Niederreiter 1987).
                for split in 0..=log {
                    let (nx, ny) = (1u32 << split, 1u32 << (log - split));
                    let cell = |p: &[f32; 4]| (p[1] * ny as f32) as u32 * nx + (p[0] * nx as f32) as u32;
                    assert_one_per_cell(n, points.iter().map(cell), &place);
                }
            }
        }
    }
}

/// The children of the samples of a batch are a run of points too.
#[test]
fn children_of_a_run_of_samples_are_stratified() {
    let children = |sample, splits: u32| {
        let sampler = Sampler::new(3, 1, 77, sample);
        (0..1 << splits).map(move |child| sampler.child(child, splits, true).get_4d(5))
    };
    for splits in 0..4 {
        for first in [0, 24] {
            let cells = 8 << splits;
            let points: Vec<[f32; 4]> =
                (first..first + 8).flat_map(|index| children(BATCHES * index + 2, splits)).collect();
            for dimension in 0..4 {
                let hits = points.iter().map(|p| (p[dimension] * cells as f32) as u32);
                assert_one_per_cell(
                    cells,
                    hits,
                    &format!("{splits} splits, samples from {first}, dimension {dimension}"),
                );
            }
            let elementary =
                points.iter().map(|p| (p[0] * 8.0) as u32 * (cells / 8) + (p[1] * (cells / 8) as f32) as u32);
            assert_one_per_cell(cells, elementary, &format!("{splits} splits, samples from {first}"));
        }
    }
    let sample = Sampler::new(3, 1, 77, 9);
    assert_eq!(sample.child(3, 2, false).get_4d(5), sample.get_4d(5));
    assert!(children(9, 2).all(|child| child != sample.get_4d(5)), "no number is used twice");
}

#[test]
fn stratification_holds_beyond_65536_points() {
    const N: u32 = 1 << 17;
    assert_one_per_cell(N, (0..N).map(|i| (batch_point(3, 1, i, 2)[1] * N as f32) as u32), "2^17 points");
    let far = (0..64).filter(|&i| batch_point(3, 1, i, 2) == batch_point(3, 1, i + 65_536, 2)).count();
    assert_eq!(far, 0, "points repeat after 65536");
}

fn assert_one_per_cell(cells: u32, hits: impl Iterator<Item = u32>, place: &str) {
    let mut seen = vec![false; cells as usize];
    for cell in hits {
        assert!(!std::mem::replace(&mut seen[cell as usize], true), "cell {cell} of {cells} is hit twice: {place}");
    }
    assert!(seen.iter().all(|&s| s), "a cell of {cells} is missed: {place}");
}

#[test]
fn values_are_a_pure_function_and_lie_below_one() {
    for k in 0..100_000u64 {
        let h = mix64(k);
        let (pixel, sample, set) = (h as u32, (h >> 32) as u32, mix64(h) as u32);
        let sampler = Sampler::new(k, 1, pixel, sample);
        let p = sampler.get_4d(set);
        assert!(
            p.iter().all(|x| (0.0..1.0).contains(x)),
            "{p:?} for seed {k}, pixel {pixel}, sample {sample}, set {set}"
        );
        assert_eq!(p, Sampler::new(k, 1, pixel, sample).get_4d(set));
        assert_eq!([p[0], p[1]], sampler.get_2d(set));
        assert_eq!(p[0], sampler.get_1d(set));
    }
}

#[test]
fn one_sample_is_uniform_over_the_pixels() {
    const N: u32 = 100_000;
    let tests = [0, 1, 6, 400, 1 << 20];
    for sample in tests {
        for (a, b) in [(0, 1), (1, 2), (2, 3), (0, 3)] {
            let mut counts = vec![0u64; 32 * 32];
            for pixel in 0..N {
                let p = Sampler::new(1, 0, pixel, sample).get_4d(9);
                counts[(p[a] * 32.0) as usize * 32 + (p[b] * 32.0) as usize] += 1;
            }
            let expected = vec![f64::from(N) / 1024.0; 1024];
            chi_squared(&counts, &expected)
                .assert(sidak(RATE, 20), &format!("sample {sample}, dimensions {a} and {b}"));
        }
    }
}

#[test]
fn sets_pixels_batches_frames_and_seeds_are_independent() {
    // Two numbers that differ in one part of the key only, over many pixels: their correlation is 0 +- 1/sqrt(n).
    const N: u32 = 40_000;
    let get = |seed, frame, pixel, sample, set, d: usize| Sampler::new(seed, frame, pixel, sample).get_4d(set)[d];
    type Pair<'a> = (&'a str, &'a dyn Fn(u32) -> (f32, f32));
    let pairs: [Pair; 9] = [
        ("neighbouring sets", &|p| (get(1, 0, p, 5, 0, 0), get(1, 0, p, 5, 1, 0))),
        ("sets, other dimension", &|p| (get(1, 0, p, 5, 0, 0), get(1, 0, p, 5, 1, 1))),
        ("far sets", &|p| (get(1, 0, p, 5, 3, 2), get(1, 0, p, 5, 3 + (1 << 31), 2))),
        ("neighbouring pixels", &|p| (get(1, 0, 2 * p, 5, 0, 0), get(1, 0, 2 * p + 1, 5, 0, 0))),
        ("pixels of neighbouring rows", &|p| (get(1, 0, p, 5, 0, 0), get(1, 0, p + (1 << 20), 5, 0, 0))),
        ("batches", &|p| (get(1, 0, p, 4, 0, 0), get(1, 0, p, 5, 0, 0))),
        ("frames", &|p| (get(1, 0, p, 5, 0, 0), get(1, 1, p, 5, 0, 0))),
        ("seeds", &|p| (get(1, 0, p, 5, 0, 0), get(2, 0, p, 5, 0, 0))),
        ("frame and pixel swapped", &|p| (get(1, 3, p + 4, 5, 0, 0), get(1, p + 4, 3, 5, 0, 0))),
    ];
    for (name, pair) in pairs {
        let products: SampleMoments = (0..N)
            .map(|p| {
                let (x, y) = pair(p);
                12.0 * (f64::from(x) - 0.5) * (f64::from(y) - 0.5)
            })
            .collect();
        // The product of two independent centred uniforms has variance 1/144.
        z_test(products.mean(), 1.0 / f64::from(N).sqrt(), 0.0).assert(sidak(RATE, 9), name);
    }
}

#[test]
fn padding_does_not_correlate_the_sets_within_a_pixel() {
    // 64 points of one batch in two sets: without a shuffle their strata would be paired.
    for (a, b) in [(0, 0), (0, 1), (2, 3), (1, 1)] {
        let correlations: SampleMoments = (0..4000)
            .map(|pixel| {
                let product = |i| {
                    let (x, y) = (batch_point(pixel, 0, i, 10)[a], batch_point(pixel, 0, i, 11)[b]);
                    12.0 * (f64::from(x) - 0.5) * (f64::from(y) - 0.5)
                };
                (0..64).map(product).sum::<f64>() / 64.0
            })
            .collect();
        student_t_test(&correlations, 0.0).assert(sidak(RATE, 4), &format!("dimensions {a} and {b}"));
        // Random pairs would have a variance of 1/64. Shuffles that keep runs together also keep pairs of points
        // together, whose products agree. e is the bound of Owen (1997) for the increase of variance by scrambled nets.
        let ratio = correlations.variance() * 64.0;
        assert!(ratio < std::f64::consts::E, "dimensions {a} and {b}: {ratio:.2} times the spread of random pairs");
    }
}

/// A smooth integrand over the unit 4-cube with integral (e - 1)^4.
fn smooth(p: [f32; 4]) -> f64 {
    p.iter().map(|&x| f64::from(x)).sum::<f64>().exp()
}

fn exact() -> f64 {
    (1f64.exp() - 1.0).powi(4)
}

/// Means over `n` samples, for many pixels.
fn estimates(n: u32, pixels: u32) -> SampleMoments {
    (0..pixels)
        .map(|pixel| (0..n).map(|s| smooth(Sampler::new(99, 0, pixel, s).get_4d(0))).sum::<f64>() / f64::from(n))
        .collect()
}

#[test]
fn a_smooth_integrand_converges_faster_than_with_random_numbers() {
    // Independent numbers: variance of the integrand over n.
    let e2 = (2f64.exp() - 1.0) / 2.0;
    let single = e2.powi(4) - exact().powi(2);
    let variance = [64u32, 256, 1024, 4096].map(|n| (f64::from(n), estimates(n, 300).variance()));
    for (n, v) in variance {
        let gain = single / n / v;
        // Measured 9, 41, 200, 1000; the relative error of a variance of 300 values is 8 %.
        assert!(gain > 0.1 * n.powf(0.9) * 0.5, "{n} samples: only {gain:.1} times better than random");
    }
    let slope = (variance[3].1 / variance[0].1).ln() / (64f64).ln();
    assert!(slope < -1.4, "the variance falls with the power {slope:.2} of the number of samples only");
}

#[test]
fn the_spread_of_the_batches_is_an_honest_error() {
    const POINTS: u32 = 32;
    let mut claimed = SampleMoments::default();
    let mut totals = SampleMoments::default();
    for pixel in 0..4000 {
        let batches: SampleMoments = (0..BATCHES)
            .map(|b| (0..POINTS).map(|i| smooth(batch_point(pixel, b, i, 0))).sum::<f64>() / f64::from(POINTS))
            .collect();
        claimed.push(batches.variance() / f64::from(BATCHES));
        totals.push(batches.mean());
    }
    // The variance of 4000 means has a relative error of about sqrt(2 / 4000) = 2.2 %, more for heavy tails.
    let actual = totals.variance();
    let error = (claimed.standard_error().powi(2) + (actual * 0.03).powi(2)).sqrt();
    z_test(claimed.mean(), error, actual).assert(RATE, "variance claimed by the batches against the actual one");
}

#[test]
fn keyed_streams_are_uniform_across_keys() {
    // The first numbers of neighbouring streams, not successive ones of one stream, because each pixel has its own
    // stream.
    let mut counts = vec![0u64; 1 << 12];
    const N: u32 = 200_000;
    for pixel in 0..N {
        let mut stream = keyed_stream(5, 0, pixel, 1);
        let (a, b) = (stream.next_u64() >> 58, stream.next_u64() >> 58);
        counts[(a << 6 | b) as usize] += 1;
    }
    let expected = vec![f64::from(N) / 4096.0; 4096];
    chi_squared(&counts, &expected).assert(RATE, "first two numbers of neighbouring streams");
}
