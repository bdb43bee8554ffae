//! Tests of whole measurements of cameras with known parameters, which are defined here in a few lines. The errors of
//! many small measurements must be the scatter of their results. Other tests check the errors for measurements that
//! cannot be analysed.
//!
//! Seeds are fixed. Replay: `cargo test -p dunkelfeld-emva1288 --test it whole_measurement::NAME`.

use dunkelfeld_emva1288::{
    Analysis, AnalysisError, AnalysisSettings, Frame, FramePair, Level, Measurement, Release, Side, StackAccumulator,
    StackLevel, analyse, analyse_general,
};
use rand_distr::{Distribution, Normal, Poisson, StandardNormal};
use rand_pcg::Pcg64;

/// A camera with the parameters of the model of EMVA 1288, and no others.
#[derive(Clone, Copy)]
struct Camera {
    gain: f64,
    efficiency: f64,
    dark_noise: f64,
    dark_current: f64,
    offset: f64,
    full_well: f64,
    /// Pixel, row, column: \[e-\].
    dsnu: [f64; 3],
    /// Pixel, row, column: fractions.
    prnu: [f64; 3],
    /// Light that is missing in the corners, as a fraction.
    fall: f64,
    /// Values are multiples of it.
    step: u16,
}

const CAMERA: Camera = Camera {
    gain: 0.4,
    efficiency: 0.6,
    dark_noise: 5.0,
    dark_current: 40.0,
    offset: 30.0,
    full_well: 5000.0,
    dsnu: [3.0, 1.0, 2.0],
    prnu: [0.02, 0.006, 0.01],
    fall: 0.0,
    step: 1,
};
const SIDE: usize = 40;
const MAX: f64 = 4095.0;

/// One device of the camera, with its pattern.
struct Device {
    camera: Camera,
    dark: Vec<f64>,
    response: Vec<f64>,
}

impl Device {
    fn new(camera: Camera, rng: &mut Pcg64) -> Self {
        let mut pattern = |[pixel, row, column]: [f64; 3]| -> Vec<f64> {
            let mut draw = |n: usize| -> Vec<f64> { (0..n).map(|_| StandardNormal.sample(rng)).collect() };
            let (p, r, c) = (draw(SIDE * SIDE), draw(SIDE), draw(SIDE));
            (0..SIDE * SIDE).map(|i| pixel * p[i] + row * r[i / SIDE] + column * c[i % SIDE]).collect()
        };
        let (dark, mut response) = (pattern(camera.dsnu), pattern(camera.prnu));
        let across = |k: usize| (k as f64 / (SIDE - 1) as f64 - 0.5).powi(2);
        let falls = (0..SIDE * SIDE).map(|i| 2.0 * camera.fall * (across(i / SIDE) + across(i % SIDE)));
        response.iter_mut().zip(falls).for_each(|(response, fall)| *response -= fall);
        Self { camera, dark, response }
    }

    fn frame(&self, photons: f64, time: f64, rng: &mut Pcg64) -> Vec<u16> {
        let c = &self.camera;
        let noise = Normal::new(0.0, c.dark_noise).expect("a deviation");
        let pixels = self.dark.iter().zip(&self.response);
        pixels
            .map(|(dark, response)| {
                let mean = c.efficiency * photons * (1.0 + response) + c.dark_current * time;
                let shot = if mean > 0.0 { Poisson::new(mean).expect("positive").sample(rng) } else { 0.0 };
                let charge = (shot + dark + noise.sample(rng)).min(c.full_well);
                (c.gain * charge + c.offset).round().clamp(0.0, MAX) as u16 * c.step
            })
            .collect()
    }

    fn pair(&self, photons: f64, exposure: f64, rng: &mut Pcg64) -> Level {
        let (a, b) = (self.frame(photons, exposure, rng), self.frame(photons, exposure, rng));
        let view = |v| Frame::new(SIDE as u32, SIDE as u32, v).expect("square");
        Level { exposure, photons, pair: FramePair::from_frames(view(&a), view(&b)).expect("same size") }
    }

    fn stack(&self, photons: f64, exposure: f64, frames: usize, rng: &mut Pcg64) -> StackLevel {
        let mut stack = StackAccumulator::new(SIDE as u32, SIDE as u32);
        for _ in 0..frames {
            let values = self.frame(photons, exposure, rng);
            stack.add(Frame::new(SIDE as u32, SIDE as u32, &values).expect("square")).expect("same size");
        }
        StackLevel { exposure, photons, stack: stack.finish().expect("frames") }
    }
}

/// A measurement with one exposure time per level.
fn measure(camera: Camera, levels: usize, frames: usize, rng: &mut Pcg64) -> Measurement {
    let device = Device::new(camera, rng);
    let top = 1.25 * camera.full_well / camera.efficiency;
    let mut all = Vec::new();
    for k in 1..=levels {
        let share = k as f64 / levels as f64;
        all.push(device.pair(0.0, share, rng));
        all.push(device.pair(top * share, share, rng));
    }
    let half = 0.5 * camera.full_well / camera.efficiency;
    let stacks = vec![device.stack(0.0, 0.4, frames, rng), device.stack(half, 0.4, frames, rng)];
    Measurement { bits: Some(12), levels: all, stacks }
}

fn truth(c: &Camera) -> Vec<(&'static str, f64)> {
    let dark_variance = (c.gain * c.dark_noise).powi(2) + 1.0 / 12.0;
    let least = (dark_variance / c.gain.powi(2) + 0.25).sqrt() + 0.5;
    let total = |[p, r, c]: [f64; 3]| (p * p + r * r + c * c).sqrt();
    vec![
        ("K", c.gain),
        ("R", c.gain * c.efficiency),
        ("eta", c.efficiency),
        ("sigma_d", c.dark_noise),
        ("sigma_y.dark", dark_variance.sqrt()),
        ("mu_e.min", least),
        ("mu_p.min", least / c.efficiency),
        ("mu_I.mean", c.dark_current),
        ("mu_I.var", c.dark_current),
        ("DSNU1288", total(c.dsnu)),
        ("DSNU1288.pixel", c.dsnu[0]),
        ("DSNU1288.row", c.dsnu[1]),
        ("DSNU1288.col", c.dsnu[2]),
        ("PRNU1288", 100.0 * total(c.prnu)),
        ("PRNU1288.pixel", 100.0 * c.prnu[0]),
        ("PRNU1288.row", 100.0 * c.prnu[1]),
        ("PRNU1288.col", 100.0 * c.prnu[2]),
    ]
}

fn linear(measurement: &Measurement) -> Analysis {
    analyse(measurement, &AnalysisSettings::default()).expect("a whole measurement")
}

/// 240 small measurements, each with its own device. For every figure (estimate - truth) / error must have mean 0 and
/// variance 1. The variance of n values of variance 1 is chi-squared over n - 1. For normal values and 239 degrees of
/// freedom it lies in 0.5 to 1.75, with an exception of 1e-10 on either side. The mean lies within 0.5, which is 7.7 of
/// its standard deviations. The widths also cover the curvature of ratios and roots for such small measurements: gain
/// to 1.5 %, row parts to a fifth.
#[test]
fn the_errors_are_the_scatter_of_repeated_measurements() {
    const SETS: usize = 240;
    let mut rng = Pcg64::new(11, 1);
    let truth = truth(&CAMERA);
    let mut z = vec![Vec::new(); truth.len()];
    for _ in 0..SETS {
        let found = linear(&measure(CAMERA, 16, 6, &mut rng));
        assert!(found.notes.iter().all(|note| !note.contains("smoothly")), "{:?}", found.notes);
        for ((symbol, value), z) in truth.iter().zip(&mut z) {
            let q = found.get(symbol).unwrap_or_else(|| panic!("{symbol} is missing"));
            z.push((q.value - value) / q.standard_error);
        }
    }
    for ((symbol, _), z) in truth.iter().zip(z) {
        let n = z.len() as f64;
        let mean = z.iter().sum::<f64>() / n;
        let variance = z.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        println!("{symbol:>16}: mean of z {mean:+.3}, variance {variance:.3}");
        assert!(mean.abs() < 0.5, "{symbol}: mean of z {mean:.3}");
        assert!((0.5..1.75).contains(&variance), "{symbol}: variance of z {variance:.3}");
    }
}

/// The same frames, shifted left by four bits, give the same figures in all modules, and one more note.
#[test]
fn values_that_are_shifted_left_are_divided() {
    let of = |step| {
        let measurement = measure(Camera { step, ..CAMERA }, 16, 6, &mut Pcg64::new(14, 1));
        Measurement { bits: Some(if step > 1 { 16 } else { 12 }), ..measurement }
    };
    let (plain, shifted) = (linear(&of(1)), linear(&of(16)));
    assert_eq!((&plain.quantities, plain.bits, &plain.darks), (&shifted.quantities, shifted.bits, &shifted.darks));
    let [general, divided] =
        [1, 16].map(|step| analyse_general(&of(step), &AnalysisSettings::default()).expect("whole"));
    assert_eq!(general.quantities, divided.quantities);
    for (before, after) in [(plain.notes, shifted.notes), (general.notes, divided.notes)] {
        assert!(after[0].contains("multiples of 16") && after[1..] == before, "{after:?}");
    }
}

/// Light that falls by 4 % to the corners adds 0.85 % to a PRNU of 0.5 %. The note has that of the pixels, whose standard error
/// is 1.8 % by their number.
#[test]
fn uneven_light_is_not_the_pixels() {
    let camera = Camera { prnu: [0.005, 0.0, 0.0], full_well: 50_000.0, gain: 0.08, ..CAMERA };
    let of = |fall| linear(&measure(Camera { fall, ..camera }, 16, 60, &mut Pcg64::new(15, 1)));
    let (even, uneven) = (of(0.0), of(0.04));
    assert!(even.notes.iter().all(|note| !note.contains("smoothly")), "{:?}", even.notes);
    let note = uneven.notes.iter().find(|note| note.contains("smoothly")).expect("a note");
    let figures: Vec<f64> = note.split(&[' ', ',']).filter_map(|word| word.parse().ok()).collect();
    assert!((figures[0] - uneven.value("PRNU1288")).abs() < 1e-3 && figures[0] > 0.9, "{note}");
    assert!((figures[1] - 0.5).abs() < 6.5 * 0.5 * 0.025, "{note}");
}

#[test]
fn the_other_release_takes_the_peak_of_the_variance() {
    let mut rng = Pcg64::new(13, 1);
    let measurement = measure(CAMERA, 50, 4, &mut rng);
    let new = linear(&measurement);
    let old = analyse(&measurement, &AnalysisSettings::default().with_release(Release::R31)).expect("levels");
    let peak = old.levels.iter().max_by(|a, b| a.variance.total_cmp(&b.variance)).expect("levels");
    assert!((old.value("mu_p.sat") - peak.photons).abs() < 1e-9);
    assert!((old.value("mu_p.sat") / new.value("mu_p.sat") - 1.0).abs() < 0.08);
}

/// Without differences between rows and columns, their parts are near zero or below it. The result is zero with a
/// bound, never NaN.
#[test]
fn absent_effects_are_zero_within_a_bound() {
    let mut rng = Pcg64::new(14, 1);
    let plain = Camera { dsnu: [0.0; 3], prnu: [0.0; 3], dark_current: 0.0, ..CAMERA };
    for _ in 0..5 {
        let found = linear(&measure(plain, 20, 8, &mut rng));
        for q in found.quantities.iter().filter(|q| q.symbol.contains("NU")) {
            assert!(q.value.is_finite() && q.value >= 0.0 && q.standard_error > 0.0, "{q}");
            // The bound holds and is tight.
            assert!(q.value < 6.5 * q.standard_error && q.standard_error < 2.0, "{q}");
            assert!(found.bound(q.symbol).is_some() || q.value > q.standard_error, "{q}");
        }
    }
}

/// Dark noise of 0.08 DN: all dark values are equal, and their variance lacks the 1/12 of rounding that the bright
/// levels have. Over levels x of the regression K is too large by sum(x) / 12 / sum(x^2), some 8 %, and its error is 1
/// %.
#[test]
fn rounding_that_hides_the_dark_noise_leaves_bounds() {
    let mut rng = Pcg64::new(15, 1);
    let coarse = Camera { gain: 0.02, dark_noise: 4.0, dark_current: 0.0, ..CAMERA };
    let settings = AnalysisSettings::default().with_pixel_pitch(2.0);
    let found = analyse(&measure(coarse, 20, 4, &mut rng), &settings).expect("levels");
    let gain = found.get("K").expect("a gain");
    let z = |value: f64| (value - coarse.gain) / gain.standard_error;
    assert!(z(gain.value) > 4.0, "the flaw is not there: {gain}");
    // The correct dark variance is 1/12, and 0.0064 of dark noise. It lies at one end of the range of K.
    let [low, high] = found.gain_range.expect("K is not known to its error");
    assert!(z(high).abs() < 6.5 && low < coarse.gain, "{low} to {high}");
    for symbol in ["K", "eta", "mu_e.sat", "SNR_max", "DSNU1288"] {
        let named = |n: &String| n.contains("K lies between") && n.contains(symbol);
        assert!(found.notes.iter().any(named), "{symbol}: {:?}", found.notes);
    }
    assert!(found.notes.iter().any(|n| n.contains("0.24") && n.contains("sigma_d") && n.contains("DR")));
    // The bounds hold for the camera, and follow from the 0.24 DN^2 of the standard.
    let truth = truth(&coarse);
    let bound = |symbol| found.bound(symbol).unwrap_or_else(|| panic!("{symbol} has no bound: {:?}", found.bounds));
    let most = (0.24f64 - 1.0 / 12.0).sqrt() / coarse.gain;
    assert!((1.0..1.6).contains(&(bound("sigma_d").limit / most)), "{:?}", bound("sigma_d"));
    for symbol in ["sigma_d", "sigma_y.dark", "mu_e.min", "mu_p.min", "DSNU1288", "DSNU1288.pixel", "DSNU1288.row"] {
        let true_value = truth.iter().find(|t| t.0 == symbol).expect("known").1;
        assert!(bound(symbol).side == Side::Below && bound(symbol).limit > true_value, "{:?}", bound(symbol));
    }
    assert!((4.0 * bound("mu_p.min.area").limit / bound("mu_p.min").limit - 1.0).abs() < 1e-12);
    let least = truth.iter().find(|t| t.0 == "mu_p.min").expect("known").1;
    assert!(bound("DR").side == Side::Above && bound("DR").limit < found.value("mu_p.sat") / least);
    assert!(found.bound("K").is_none() && found.bound("eta").is_none());
    // The same camera with a gain at which its noise is visible.
    let fine = linear(&measure(Camera { gain: 0.4, ..coarse }, 20, 4, &mut rng));
    let gain = fine.get("K").expect("a gain");
    assert!(((gain.value - 0.4) / gain.standard_error).abs() < 6.5 && fine.gain_range.is_none(), "{gain}");
    assert!(fine.bound("sigma_d").is_none() && fine.bound("DR").is_none());
}

/// For any camera: noise that rounding hides has a bound, noise that is cut off at zero has none, and the notes contain
/// both.
#[test]
fn the_general_module_accounts_for_rounding_and_clipping_at_zero() {
    let mut rng = Pcg64::new(20, 1);
    let plain = Camera { dsnu: [0.0; 3], prnu: [0.0; 3], dark_current: 0.0, ..CAMERA };
    let mut general =
        |camera| analyse_general(&measure(camera, 30, 3, &mut rng), &AnalysisSettings::default()).expect("levels");
    let coarse = Camera { gain: 0.02, dark_noise: 4.0, ..plain };
    let found = general(coarse);
    let truth = truth(&coarse);
    let least = truth.iter().find(|t| t.0 == "mu_p.min").expect("known").1;
    let bound = |symbol| found.bound(symbol).unwrap_or_else(|| panic!("{symbol} has no bound: {:?}", found.bounds));
    assert!(bound("mu_p.min").side == Side::Below && bound("mu_p.min").limit > least, "{:?}", found.bounds);
    assert!(bound("sigma_p.dark").limit > coarse.dark_noise / coarse.efficiency, "{:?}", found.bounds);
    let range = coarse.full_well / coarse.efficiency / least;
    assert!(bound("DR").side == Side::Above && bound("DR").limit < range, "{:?}, truth {range}", bound("DR"));
    assert!(found.notes.iter().any(|n| n.contains("0.24") && n.contains("upper bounds")), "{:?}", found.notes);

    let cut = general(Camera { offset: 0.0, ..plain });
    assert!(cut.notes.iter().any(|n| n.contains("values are zero") && n.contains("mu_p.min")), "{:?}", cut.notes);
    assert!(cut.bounds.is_empty(), "{:?}", cut.bounds);
    let whole = general(plain);
    assert!(whole.bounds.is_empty() && whole.notes.len() == 1, "{:?} {:?}", whole.bounds, whole.notes);
}

/// Values with a gamma curve: the general module finds the threshold and the range of the camera without the curve.
#[test]
fn the_general_module_is_correct_for_a_gamma_curve() {
    let mut rng = Pcg64::new(18, 1);
    let camera = Camera { gain: 0.75, dsnu: [0.0; 3], prnu: [0.0; 3], dark_current: 0.0, ..CAMERA };
    let device = Device::new(camera, &mut rng);
    let mut encoded = |photons: f64| {
        let mut one = || -> Vec<u16> {
            let encode = |y: u16| (4095.0 * (f64::from(y) / 4095.0).powf(1.0 / 1.5)).round() as u16;
            device.frame(photons, 1.0, &mut rng).into_iter().map(encode).collect()
        };
        let (a, b) = (one(), one());
        let view = |v| Frame::new(SIDE as u32, SIDE as u32, v).expect("square");
        Level { exposure: 1.0, photons, pair: FramePair::from_frames(view(&a), view(&b)).expect("same size") }
    };
    let top = 1.1 * camera.full_well / camera.efficiency;
    let levels = (0..=100).map(|k| encoded(top * f64::from(k) / 100.0)).collect();
    let measurement = Measurement { bits: Some(12), levels, stacks: Vec::new() };
    let found = analyse_general(&measurement, &AnalysisSettings::default()).expect("levels");
    let middle = found.levels.iter().find(|l| l.photons > 0.4 * top).expect("a level");
    // sigma_p = sqrt(mu_e + sigma_d^2) / eta.
    let expected = (camera.efficiency * middle.photons + camera.dark_noise.powi(2)).sqrt() / camera.efficiency;
    assert!((middle.noise[0] / expected - 1.0).abs() < 0.15, "{middle:?}, expected {expected}");
    let snr = found.quantities.iter().find(|q| q.symbol == "SNR_max").expect("found");
    assert!((snr.value / camera.full_well.sqrt() - 1.0).abs() < 0.15, "{snr}");
    // The linear module is not valid for this camera: its linearity error is many per cent.
    let linear = analyse(&measurement, &AnalysisSettings::default()).expect("levels");
    assert!(linear.value("LE") > 3.0, "{}", linear.value("LE"));
}

type Spoil = fn(&mut Measurement);

#[test]
fn data_that_cannot_be_analysed_are_errors_with_help() {
    let mut rng = Pcg64::new(19, 1);
    let whole = measure(CAMERA, 20, 2, &mut rng);
    let cases: [(Spoil, &str, &str); 9] = [
        (|m| m.levels.clear(), "no pair of frames with light", "blocks of two frames"),
        (|m| m.levels.retain(|l| l.photons > 0.0), "no pair of dark frames", "without light"),
        (|m| m.levels.retain(|l| l.photons > 0.0 || l.exposure > 0.1), "has no dark frames", "that exposure time"),
        (|m| m.levels.retain(|l| l.exposure < 0.6), "not saturated", "more light"),
        (|m| m.levels.retain(|l| l.photons == 0.0 || l.exposure > 0.7), "below 70 %", "50"),
        (|m| m.stacks.retain(|s| s.photons > 0.0), "no dark stack", "16 or more"),
        (|m| m.stacks.retain(|s| s.photons == 0.0), "none with light", "16 or more"),
        (|m| m.stacks.push(m.stacks[1].clone()), "2 stacks of frames with light", "keep one"),
        (|m| m.bits = Some(10), "too large for 10 bits", "right-aligned"),
    ];
    for (spoil, problem, help) in cases {
        let mut spoilt = whole.clone();
        spoil(&mut spoilt);
        let error = analyse(&spoilt, &AnalysisSettings::default()).expect_err(problem);
        assert!(error.to_string().contains(problem), "{problem}: {error}");
        assert!(error.help().contains(help), "{help}: {}", error.help());
        assert!(matches!(error, AnalysisError::Unfit { .. }));
    }
    let mut bare = whole;
    bare.stacks.clear();
    let found = linear(&bare);
    assert!(found.get("DSNU1288").is_none() && found.nonuniformity.is_none());
    assert!(found.notes.iter().any(|n| n.contains("no stacks")), "{:?}", found.notes);
}
