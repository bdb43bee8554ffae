//! Tests of the bias of allocation by samples. The hardest case is pixels of two values, mostly dark and rarely bright.
//! A pixel that stops at a low measured variance stops before its bright sample (Kirk and Arvo 1991).
//!
//! The whole planning runs here without a renderer: a pilot, predictions from neighbours, required samples, plans at
//! doubling budgets. The target is a standard error, which a sensor of constant noise represents. Renders are simpler:
//! one plan, from a pilot. The last tests show the reason: if bright samples are rare, every other method is biased.
//!
//! Replay: `cargo test -p dunkelfeld-adaptive --test two_valued NAME`. Seeds are fixed. The bounds are at least six
//! standard errors of the simulation away from zero bias: one false alarm in 5e8 each, for a dozen checks.

use dunkelfeld_adaptive::required_samples::{RequiredSamples, SensorNoise, total};
use dunkelfeld_adaptive::variance::inputs::{NoiseInputs, PixelFeatures};
use dunkelfeld_adaptive::variance::neighbours::{PredictedNoise, expected};
use dunkelfeld_adaptive::variance::pixel::pixel_noise;
use dunkelfeld_adaptive::{MeasuredNoise, Pilot, SamplePlan, Shares, Strategy, plan};
use dunkelfeld_film::{BATCHES, Plane, Scatter};

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

    /// Scatter of samples that are zero or one.
    fn scatter(&self) -> Option<Scatter> {
        let (n, mean) = (f64::from(self.count()), self.mean());
        let all = mean * (1.0 - mean) / (n - 1.0);
        (n > 1.0).then(|| Scatter {
            all,
            largest: if mean > 0.0 { ((1.0 - mean) / (n - 1.0)).powi(2).min(all) } else { 0.0 },
        })
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

    fn evidence(&self) -> NoiseInputs {
        // The similarity of pixels depends on their means as much as possible, with a sensor without noise in the dark.
        let quiet = SensorNoise { floor: 1e-3, saturation: f64::INFINITY };
        NoiseInputs {
            counts: self.pixels.map(Pixel::count),
            mean: self.pixels.map(|p| p.mean() as f32),
            variance: self.pixels.map(|p| p.variance_of_mean() as f32),
            level: self.pixels.map(|p| quiet.level(p.mean() as f32, p.variance_of_mean() as f32)),
            scatter: self.pixels.map(Pixel::scatter),
            largest: self.pixels.map(|p| if p.mean() > 0.0 { 1.0 } else { 0.0 }),
            surface: Plane::new(SIDE, SIDE, PixelFeatures::default()),
        }
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

/// The relative noise for a plan.
fn predicted(
    evidence: &NoiseInputs,
    neighbourhood: Neighbourhood,
    sensor: Option<SensorNoise>,
) -> Plane<PredictedNoise> {
    match neighbourhood {
        Neighbourhood::Neighbours => expected(evidence, sensor),
        // The tolerated noise is constant, so that a bright sample does not raise its own tolerance.
        Neighbourhood::Own => {
            pixel_noise(evidence).map(|noise| PredictedNoise { ratio: noise.variance, saturated: false })
        }
    }
}

/// Renders until every pixel has the samples that it needs for a standard error of `target`. Plans have doubling
/// budgets. Each number of samples is fixed before the samples are taken.
fn adaptive(image: &mut Image, target: f64) {
    // The noise is so large that the signal does not matter.
    let sensor = SensorNoise { floor: 1e8, saturation: f64::INFINITY };
    let k = target / 1e4;
    image.render(&Plane::new(SIDE, SIDE, PILOT));
    for _ in 0..12 {
        let evidence = image.evidence();
        let expected = predicted(&evidence, Neighbourhood::Neighbours, Some(sensor));
        let required_samples = RequiredSamples::expected(&expected, k);
        let wanted = required_samples
            .capped_targets()
            .data()
            .iter()
            .zip(evidence.counts.data())
            .map(|(&n, &c)| n.max(c as f32))
            .collect();
        let aim = Plane::from_vec(SIDE, SIDE, wanted).map_or(0, |wanted| total(&wanted) as u64);
        let taken = plan::total(&evidence.counts);
        if aim <= taken + taken / 50 {
            return;
        }
        let measured = MeasuredNoise { expected: &expected, required_samples: Some(&required_samples) };
        let pilot = Pilot { luminance: &evidence.mean, white: 1.0, sobel_floor: 0.25, measured: Some(measured) };
        let shares = Strategy::Sensor.shares(&pilot);
        image.render(&plan::next_round(&evidence.counts, &shares, aim.min(2 * taken)));
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

struct Verdict {
    /// Relative bias of the mean, and its standard error.
    bias: (f64, f64),
    /// Root mean squared error over the target.
    error: f64,
    samples: f64,
}

fn judge(probability: f64, target: f64, repeats: u64, render: impl Fn(&mut Image)) -> Verdict {
    let (mut sum, mut squares, mut samples, mut count) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..repeats {
        let mut image = Image::new(probability, seed + 1);
        render(&mut image);
        for pixel in image.pixels.data() {
            let off = pixel.mean() - probability;
            sum += off;
            squares += off * off;
            samples += f64::from(pixel.count());
            count += 1.0;
        }
    }
    let standard_error = (squares / count / count).sqrt();
    Verdict {
        bias: (sum / count / probability, standard_error / probability),
        error: (squares / count).sqrt() / target,
        samples: samples / count,
    }
}

/// Probabilities of the bright value, and the samples that the target needs.
const CASES: [(f64, f64); 4] = [(0.5, 100.0), (0.2, 150.0), (0.05, 200.0), (0.02, 400.0)];

#[test]
#[ignore = "long: .ci/run runs it"]
fn plans_by_the_neighbours_do_not_bias_and_meet_their_target() {
    for (probability, samples) in CASES {
        let target = (probability * (1.0 - probability) / samples).sqrt();
        // Enough repeats for a standard error of the mean of one thousandth.
        let repeats = ((1.0 - probability) / probability / samples / f64::from(SIDE * SIDE) / 1e-6).ceil() as u64;
        let verdict = judge(probability, target, repeats.max(4), |image| adaptive(image, target));
        let (bias, standard_error) = verdict.bias;
        let what = format!(
            "probability {probability}: bias {:+.3} % +- {:.3} %, error {:.3} of the target, {:.0} samples for {samples}",
            100.0 * bias,
            100.0 * standard_error,
            verdict.error,
            verdict.samples
        );
        assert!(standard_error <= 1.001e-3, "too few repeats: {what}");
        assert!(bias.abs() <= 0.006, "{what}");
        assert!((0.8..=1.2).contains(&verdict.error), "{what}");
    }
}

/// The control: the method of this test detects a bias if there is one.
#[test]
fn stopping_by_a_pixels_own_variance_is_biased() {
    let (probability, samples) = (0.05, 200.0f64);
    let target = (probability * (1.0 - probability) / samples).sqrt();
    let verdict = judge(probability, target, 24, |image| by_own_variance(image, target));
    assert!(verdict.bias.0 < -0.03 && verdict.error > 1.2, "{:+.4}, {:.3}", verdict.bias.0, verdict.error);
}

/// Probability of a bright sample. It is so low that for four of ten pixels the pilot has no bright sample in their 17
/// x 17 neighbourhood.
const RARE: f64 = 1.0 / 5000.0;

/// The quantity by which a budget is distributed.
#[derive(Clone, Copy, Debug)]
enum Rule {
    /// The standard deviation.
    Deviation,
    /// The required samples for a noise level, as estimated from a pilot:
    /// [`dunkelfeld_adaptive::RequiredSamples::shares`].
    ForNoise,
}

/// Relative bias of the mean, with its standard error, when plans distribute a budget of 64 samples per pixel. The
/// plans are at doubling totals, from all samples so far.
fn bias_of_budget(rule: Rule, neighbourhood: Neighbourhood, plans: u32, repeats: u64) -> (f64, f64) {
    let verdict = judge(RARE, 1.0, repeats, |image| {
        image.render(&Plane::new(SIDE, SIDE, PILOT));
        let pixels = u64::from(SIDE * SIDE);
        for plan in 1..=plans {
            let evidence = image.evidence();
            let shares = match rule {
                Rule::Deviation => {
                    let expected = predicted(&evidence, neighbourhood, None);
                    let measured = MeasuredNoise { expected: &expected, required_samples: None };
                    let luminance = &evidence.mean;
                    Strategy::Variance.shares(&Pilot {
                        luminance,
                        white: 1.0,
                        sobel_floor: 0.25,
                        measured: Some(measured),
                    })
                }
                Rule::ForNoise => {
                    // A sensor on which the signal of a bright sample counts.
                    let sensor = SensorNoise { floor: RARE, saturation: f64::INFINITY };
                    Shares::from_weights(
                        RequiredSamples::expected(&predicted(&evidence, neighbourhood, Some(sensor)), 0.5).shares(1e-3),
                    )
                }
            };
            let total = (64 * pixels) >> (plans - plan);
            image.render(&plan::next_round(&evidence.counts, &shares, total));
        }
    });
    verdict.bias
}

#[test]
#[ignore = "long: .ci/run runs it"]
fn one_plan_by_the_neighbours_does_not_bias_rare_light() {
    for rule in [Rule::Deviation, Rule::ForNoise] {
        let (bias, standard_error) = bias_of_budget(rule, Neighbourhood::Neighbours, 1, 600);
        println!("{rule:?}: bias {:+.3} % +- {:.3} %", 100.0 * bias, 100.0 * standard_error);
        assert!(
            standard_error < 0.015 && bias.abs() < 6.0 * standard_error,
            "{rule:?}: {bias:+.4} +- {standard_error:.4}"
        );
    }
}

/// The controls: a plan from the pixel's own samples loses light, and so does a plan that follows other plans.
#[test]
#[ignore = "long: .ci/run runs it"]
fn plans_by_own_samples_and_plans_after_plans_bias_rare_light() {
    use Neighbourhood::{Neighbours, Own};
    use Rule::{Deviation, ForNoise};
    for (rule, neighbourhood, plans) in [
        (Deviation, Own, 1),
        (Deviation, Own, 2),
        (Deviation, Neighbours, 2),
        (ForNoise, Own, 1),
        (ForNoise, Neighbours, 2),
    ] {
        let (bias, standard_error) = bias_of_budget(rule, neighbourhood, plans, 120);
        println!(
            "{rule:?}, {neighbourhood:?}, {plans} plans: bias {:+.3} % +- {:.3} %",
            100.0 * bias,
            100.0 * standard_error
        );
        assert!(
            bias < -6.0 * standard_error,
            "{rule:?}, {neighbourhood:?}, {plans}: {bias:+.4} +- {standard_error:.4}"
        );
    }
}
