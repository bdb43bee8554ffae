//! Tests of the bias of allocation by samples. The hardest case is pixels of two values, mostly dark and rarely bright.
//! A pixel that stops at a low measured variance stops before its bright sample (Kirk and Arvo 1991).
//!
//! The planning runs here without a renderer: a pilot, weights from neighbours, and a plan, as in renders. The controls show
//! the reason: if bright samples are rare, other methods are biased.
//!
//! Replay: `cargo test -p dunkelfeld-adaptive --test it two_valued::NAME`. Seeds are fixed. The bounds are at least six
//! standard errors of the simulation away from zero bias: one false alarm in 5e8 each, for a dozen checks.

use dunkelfeld_adaptive::weights::{sensor, uniform};
use dunkelfeld_adaptive::{SamplePlan, plan};
use dunkelfeld_film::{BATCHES, Plane};

const SIDE: u32 = 64;
const PILOT: u32 = 16;

/// The samples of a pixel so far: sums and counts of its batches, and whether a sample was bright.
#[derive(Clone, Copy, Default)]
struct Pixel {
    sums: [f64; BATCHES],
    counts: [u32; BATCHES],
}

impl Pixel {
    fn count(&self) -> u32 {
        self.counts.iter().sum()
    }

    fn mean(&self) -> f64 {
        self.sums.iter().sum::<f64>() / f64::from(self.count().max(1))
    }

    /// As the film computes it: from the spread of the batch means.
    fn variance_of_mean(&self) -> f64 {
        let (n, mean) = (f64::from(self.count()), self.mean());
        let spread = |(s, &c): (&f64, &u32)| f64::from(c) * (s / f64::from(c.max(1)) - mean).powi(2);
        self.sums.iter().zip(&self.counts).map(spread).sum::<f64>() / ((BATCHES - 1) as f64 * n)
    }
}

/// Uniform numbers, by the finaliser of SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 11) as f64 * (-53f64).exp2()
    }
}

struct Image {
    pixels: Plane<Pixel>,
    probability: f64,
    random: Random,
}

impl Image {
    fn new(probability: f64, seed: u64) -> Self {
        Self { pixels: Plane::new(SIDE, SIDE, Pixel::default()), probability, random: Random(seed << 40) }
    }

    /// Takes the missing samples of a plan: 1 with the probability of the image, else 0.
    fn render(&mut self, plan: &SamplePlan) {
        for (pixel, &n) in self.pixels.data_mut().iter_mut().zip(plan.data()) {
            for index in pixel.count()..n {
                let batch = index as usize % BATCHES;
                pixel.counts[batch] += 1;
                pixel.sums[batch] += f64::from(u8::from(self.random.unit() < self.probability));
            }
        }
    }

    /// The variance of one sample. A sensor of constant noise is its unit.
    fn noise(&self) -> Plane<f32> {
        self.pixels.map(|p| (f64::from(p.count()) * p.variance_of_mean()) as f32)
    }
}

/// The pixels whose samples decide about a pixel.
#[derive(Clone, Copy, Debug)]
enum Neighbourhood {
    /// Its neighbours, as in renders.
    Neighbours,
    /// The pixel itself, as in the certificate. Renders must not use it.
    Own,
}

/// The weights of a plan.
fn weights(noise: &Plane<f32>, neighbourhood: Neighbourhood) -> Plane<f32> {
    match neighbourhood {
        Neighbourhood::Neighbours => sensor(noise),
        Neighbourhood::Own => {
            let mean = noise.data().iter().sum::<f32>() / noise.data().len() as f32;
            if mean > 0.0 { noise.map(|v| (v + 0.1 * mean).powf(0.4)) } else { uniform(SIDE, SIDE) }
        }
    }
}

/// The invalid rule: each pixel stops when the measured variance of its own samples is low enough.
fn by_own_variance(image: &mut Image, target: f64) {
    image.render(&Plane::new(SIDE, SIDE, PILOT));
    for _ in 0..400 {
        let next =
            image.pixels.map(|p| if p.variance_of_mean() > target * target { p.count() + 16 } else { p.count() });
        image.render(&next);
    }
}

/// Relative bias of the mean of all pixels, and its standard error.
fn bias_of(probability: f64, repeats: u64, render: impl Fn(&mut Image)) -> (f64, f64) {
    let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
    for seed in 0..repeats {
        let mut image = Image::new(probability, seed + 1);
        render(&mut image);
        for pixel in image.pixels.data() {
            let off = pixel.mean() - probability;
            sum += off;
            squares += off * off;
            count += 1.0;
        }
    }
    (sum / count / probability, (squares / count / count).sqrt() / probability)
}

/// The same when plans distribute a budget of 64 samples per pixel. They are at doubling totals, from all samples so far.
fn bias_of_plans(probability: f64, neighbourhood: Neighbourhood, plans: u32, repeats: u64) -> (f64, f64) {
    bias_of(probability, repeats, |image| {
        image.render(&Plane::new(SIDE, SIDE, PILOT));
        for plan in 1..=plans {
            let weights = weights(&image.noise(), neighbourhood);
            let total = (64 * u64::from(SIDE * SIDE)) >> (plans - plan);
            image.render(&plan::next_round(&image.pixels.map(Pixel::count), &weights, total));
        }
    })
}

/// The control: the method of this test detects a bias if there is one.
#[test]
fn stopping_by_a_pixels_own_variance_is_biased() {
    let (probability, samples) = (0.05, 200.0f64);
    let target = (probability * (1.0 - probability) / samples).sqrt();
    let (bias, _) = bias_of(probability, 24, |image| by_own_variance(image, target));
    assert!(bias < -0.03, "{bias:+.4}");
}

/// Probabilities of a bright sample, and numbers of renders. The last one is so low that for half of the pixels the pilot
/// has no bright sample in their 7 x 7 neighbourhood.
const CASES: [(f64, u64); 3] = [(0.2, 400), (0.02, 400), (1.0 / 1000.0, 2000)];

#[test]
fn one_plan_by_the_neighbours_does_not_bias() {
    for (probability, repeats) in CASES {
        let (bias, standard_error) = bias_of_plans(probability, Neighbourhood::Neighbours, 1, repeats);
        println!("{probability}: bias {:+.3} % +- {:.3} %", 100.0 * bias, 100.0 * standard_error);
        assert!(
            standard_error < 0.002 && bias.abs() < 6.0 * standard_error,
            "{probability}: {bias:+.4} +- {standard_error:.4}"
        );
    }
}

/// The controls: a plan from the pixel's own samples loses light, and so does a plan that follows another plan.
#[test]
fn plans_by_own_samples_and_plans_after_plans_bias_rare_light() {
    for (neighbourhood, plans) in [(Neighbourhood::Own, 1), (Neighbourhood::Neighbours, 2)] {
        let (bias, standard_error) = bias_of_plans(1.0 / 1000.0, neighbourhood, plans, 300);
        println!("{neighbourhood:?}, {plans} plans: bias {:+.3} % +- {:.3} %", 100.0 * bias, 100.0 * standard_error);
        assert!(bias < -6.0 * standard_error, "{neighbourhood:?}, {plans}: {bias:+.4} +- {standard_error:.4}");
    }
}
