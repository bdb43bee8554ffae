//! Tests of the built-in filter on synthetic images with known noise and known true values.

use std::sync::atomic::{AtomicUsize, Ordering};

use dunkelfeld_denoise::{Builtin, Control, DenoiseError, DenoiseInput, Denoiser, Executor, Serial, Triples};
use dunkelfeld_film::Plane;

/// Three threads, each of which takes the next free piece.
struct Three;

impl Executor for Three {
    fn threads(&self) -> usize {
        3
    }

    fn for_each(&self, pieces: usize, work: &(dyn Fn(usize) + Sync)) {
        let next = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| {
                    while let Some(i) = Some(next.fetch_add(1, Ordering::Relaxed)).filter(|i| *i < pieces) {
                        work(i);
                    }
                });
            }
        });
    }
}

/// Pseudo-random numbers, the same in each run (Steele et al. 2014, SplitMix).
struct Numbers(u64);

impl Numbers {
    fn uniform(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u32 << 24) as f32
    }

    /// The mean of four uniform numbers of the given mean and of variance 1/12 each, and the variance of that mean as a
    /// film estimates it from four batches.
    fn batches(&mut self, mean: f32, sigma: f32) -> (f32, f32) {
        let values = [0; 4].map(|_| mean + (self.uniform() - 0.5) * 12f32.sqrt() * 2.0 * sigma);
        let m = values.iter().sum::<f32>() / 4.0;
        (m, values.iter().map(|v| (v - m).powi(2)).sum::<f32>() / 12.0)
    }
}

/// The mean and the variance of a render of `truth` with noise of standard deviation `sigma(truth)`.
fn noisy(truth: &Triples, seed: u64, sigma: impl Fn(f32) -> f32) -> (Triples, Triples) {
    let mut numbers = Numbers(seed);
    let pairs = truth.map(|v| v.map(|v| numbers.batches(v, sigma(v))));
    (pairs.map(|p| p.map(|p| p.0)), pairs.map(|p| p.map(|p| p.1)))
}

fn filtered(input: &DenoiseInput<'_>) -> Triples {
    Builtin.denoise(input, &Control::SILENT).expect("nothing to complain about")
}

fn mse(a: &Triples, b: &Triples) -> f64 {
    let pairs = a.data().iter().flatten().zip(b.data().iter().flatten());
    pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / (3 * a.data().len()) as f64
}

/// Dark on the left of a slanted line and bright on the right of it, each side with a slope.
fn slanted_edge(size: u32) -> Triples {
    Plane::from_fn(size, size, |x, y| {
        let side = if 3 * x + y > 2 * size { 1.0 } else { 0.2 };
        let v = side * (1.0 + 0.2 * y as f32 / size as f32);
        [v, 0.9 * v, 0.7 * v]
    })
}

#[test]
fn images_of_any_size_are_taken() {
    for (width, height) in [(0, 0), (0, 7), (7, 0), (1, 1), (1, 100), (100, 1), (2, 3), (65, 64)] {
        let mean = Plane::from_fn(width, height, |x, y| [1.0 + (x % 3) as f32, 2.0, (y % 2) as f32]);
        let depth = Plane::new(width, height, 1.0);
        let input =
            DenoiseInput { albedo: Some(&mean), normal: Some(&mean), depth: Some(&depth), ..DenoiseInput::new(&mean) };
        let image = filtered(&input);
        assert_eq!((image.width(), image.height()), (width, height));
        assert!(image.data().iter().flatten().all(|v| v.is_finite()));
    }
}

#[test]
fn noise_on_even_ground_is_averaged_away() {
    let truth = Plane::new(80, 70, [0.3, 0.2, 0.1]);
    let (mean, variance) = noisy(&truth, 1, |v| 0.3 * v);
    let with_variance = filtered(&DenoiseInput { variance: Some(&variance), ..DenoiseInput::new(&mean) });
    let without = filtered(&DenoiseInput::new(&mean));
    let before = mse(&mean, &truth);
    for (name, image, least) in [("stated", &with_variance, 40.0), ("estimated", &without, 20.0)] {
        let gain = before / mse(image, &truth);
        assert!(gain > least, "variance {name}: {gain:.1} times less error, expected {least}");
    }
}

#[test]
fn an_edge_above_the_noise_is_preserved_without_features() {
    let truth = slanted_edge(96);
    let (mean, variance) = noisy(&truth, 2, |v| 0.1 * v);
    let image = filtered(&DenoiseInput { variance: Some(&variance), ..DenoiseInput::new(&mean) });
    let gain = mse(&mean, &truth) / mse(&image, &truth);
    assert!(gain > 8.0, "{gain:.1} times less error");
    // No pixel has a value of the other side.
    for (a, t) in image.data().iter().zip(truth.data()) {
        assert!((a[0] / t[0] - 1.0).abs() < 0.4, "{} where the truth is {}", a[0], t[0]);
    }
}

#[test]
fn features_preserve_edges_below_the_noise() {
    // A step of a third with noise of the same size. The albedo has the same step.
    let albedo: Triples = Plane::from_fn(96, 96, |x, y| [if (x / 8 + y / 8) % 2 == 0 { 0.3 } else { 0.4 }; 3]);
    let (mean, variance) = noisy(&albedo, 3, |_| 0.1);
    let blind = DenoiseInput { variance: Some(&variance), ..DenoiseInput::new(&mean) };
    let guided = DenoiseInput { albedo: Some(&albedo), ..blind };
    let (blind, guided) = (mse(&filtered(&blind), &albedo), mse(&filtered(&guided), &albedo));
    assert!(guided < 0.2 * blind, "guided {guided:.2e}, blind {blind:.2e}");
    assert!(guided < 0.03 * mse(&mean, &albedo), "guided {guided:.2e}");
}

#[test]
fn noisy_features_preserve_no_edges() {
    // A uniform surface with one of two albedos per sample at random, as for a mask of dots finer than a pixel.
    let truth = Plane::new(96, 96, [0.3, 0.2, 0.1]);
    let (mean, variance) = noisy(&truth, 10, |v| 0.3 * v);
    let (albedo, albedo_variance) = noisy(&Plane::new(96, 96, [0.5; 3]), 11, |_| 0.12);
    let naive = DenoiseInput { variance: Some(&variance), albedo: Some(&albedo), ..DenoiseInput::new(&mean) };
    let with_variance = DenoiseInput { albedo_variance: Some(&albedo_variance), ..naive };
    let [before, naive, with_variance] =
        [&mean, &filtered(&naive), &filtered(&with_variance)].map(|image| mse(image, &truth));
    assert!(
        with_variance < 0.05 * before && with_variance < 0.7 * naive,
        "before {before:.2e}, naive {naive:.2e}, with_variance {with_variance:.2e}"
    );
}

#[test]
fn detail_without_a_feature_costs_a_twentieth_at_most() {
    // Detail of different kinds and heights, in units of the noise, that is not in the features: bright dots, lines,
    // waves, and pixels with dark or bright values.
    type Detail = fn(u32, u32) -> f32;
    let kinds: [(&str, Detail); 4] = [
        ("dots", |x, y| if x % 7 == 3 && y % 7 == 3 { 1.0 } else { 0.0 }),
        ("lines", |x, _| if x % 9 == 0 { 1.0 } else { 0.0 }),
        ("waves", |x, _| (0.8 * x as f32).sin()),
        ("grains", |x, y| if Numbers(u64::from(x) << 32 | u64::from(y)).uniform() < 0.5 { 1.0 } else { 0.0 }),
    ];
    for (seed, height) in (20..).zip([0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 10.0, 30.0, 100.0]) {
        for (name, detail) in kinds {
            let grey = Plane::from_fn(128, 128, |x, y| [10.0 + height * detail(x, y); 3]);
            // The same noise for all channels, as for white light.
            let (mean, variance) = noisy(&grey.map(|v| [v[0], 0.0, 0.0]), seed, |v| if v > 0.0 { 1.0 } else { 0.0 });
            let (mean, variance) = (mean.map(|v| [v[0]; 3]), variance.map(|v| [v[0]; 3]));
            let image = filtered(&DenoiseInput { variance: Some(&variance), ..DenoiseInput::new(&mean) });
            let (before, after) = (mse(&mean, &grey), mse(&image, &grey));

            assert!(after < 1.05 * before, "{name} {height} times as high as the noise: {:.3}", after / before);
        }
    }
}

#[test]
fn bright_specks_are_spread_out_and_most_of_their_light_is_kept() {
    // One pixel in a hundred has a rare event, in one batch of four. The other pixels have no sign of it.
    let size = 160;
    let mut numbers = Numbers(30);
    let pairs = Plane::from_fn(size, size, |_, _| {
        let batches =
            [0; 4].map(|_| 0.1 + 0.02 * numbers.uniform() + if numbers.uniform() < 0.0025 { 40.0 } else { 0.0 });
        let mean = batches.iter().sum::<f32>() / 4.0;
        (mean, batches.iter().map(|b| (b - mean).powi(2)).sum::<f32>() / 12.0)
    });
    let (mean, variance) = (pairs.map(|p| [p.0; 3]), pairs.map(|p| [p.1; 3]));
    let image = filtered(&DenoiseInput { variance: Some(&variance), ..DenoiseInput::new(&mean) });
    let average = |plane: &Triples| plane.data().iter().map(|v| f64::from(v[0])).sum::<f64>() / f64::from(size * size);
    let truth = Plane::new(size, size, [0.11 + 0.0025 * 40.0; 3]);
    let gain = mse(&mean, &truth) / mse(&image, &truth);
    assert!(gain > 30.0, "{gain:.1} times less error");
    let (before, after) = (average(&mean), average(&image));
    // The specks have half of the light.
    assert!((0.75..1.05).contains(&(after / before)), "light before {before:.4}, after {after:.4}");
}

#[test]
fn the_same_bits_come_from_any_number_of_threads() {
    let truth = slanted_edge(150);
    let (mean, variance) = noisy(&truth, 5, |v| 0.3 * v);
    let input = DenoiseInput { variance: Some(&variance), normal: Some(&truth), ..DenoiseInput::new(&mean) };
    let three = Builtin.denoise(&input, &Control { executor: &Three, progress: &|_| true });
    assert_eq!(three, Builtin.denoise(&input, &Control { executor: &Serial, progress: &|_| true }));
}

#[test]
fn the_image_is_finite_for_any_planes() {
    let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1.0, 0.0, f32::MIN_POSITIVE, 1e-6, 1e6];
    let mut numbers = Numbers(7);
    let mut plane = |share: f32| {
        Plane::from_fn(40, 30, |_, _| {
            [0; 3].map(|_| {
                if numbers.uniform() < share { odd[(numbers.uniform() * 8.99) as usize] } else { numbers.uniform() }
            })
        })
    };
    for share in [0.1, 1.0] {
        let (mean, variance, albedo, normal) = (plane(share), plane(share), plane(share), plane(share));
        let depth = albedo.map(|a| a[1]);
        let input = DenoiseInput {
            mean: &mean,
            variance: Some(&variance),
            first_light: Some(&albedo),
            albedo: Some(&albedo),
            albedo_variance: Some(&variance),
            normal: Some(&normal),
            normal_variance: Some(&albedo),
            depth: Some(&depth),
            depth_variance: Some(&depth),
        };
        assert!(filtered(&input).data().iter().flatten().all(|v| v.is_finite()));
    }
}

#[test]
fn a_non_finite_pixel_is_filled_and_changes_no_other() {
    let truth = Plane::new(30, 30, [0.5, 0.4, 0.3]);
    let (mut mean, variance) = noisy(&truth, 8, |v| 0.1 * v);
    mean.data_mut()[15 * 30 + 15] = [f32::NAN, 1e30, 0.0];
    let image = filtered(&DenoiseInput { variance: Some(&variance), ..DenoiseInput::new(&mean) });
    for v in image.data() {
        assert!((v[0] - 0.5).abs() < 0.05 && (v[1] - 0.4).abs() < 0.04 && (v[2] - 0.3).abs() < 0.03, "{v:?}");
    }
}

#[test]
fn the_caller_can_cancel() {
    let mean = Plane::new(200, 200, [0.5; 3]);
    for limit in [0.0, 0.05, 0.3, 0.95] {
        let control = Control { executor: &Three, progress: &|fraction| fraction < limit };
        assert_eq!(Builtin.denoise(&DenoiseInput::new(&mean), &control), Err(DenoiseError::Cancelled), "at {limit}");
    }
    let highest = std::sync::Mutex::new(0.0f64);
    let progress = |fraction: f64| {
        let mut highest = highest.lock().expect("no test panics in here");
        *highest = highest.max(fraction);
        true
    };
    assert!(Builtin.denoise(&DenoiseInput::new(&mean), &Control { executor: &Serial, progress: &progress }).is_ok());
    assert!((*highest.lock().expect("no test panics in here") - 1.0).abs() < 1e-9);
}
