//! Tests of the analyser on frames of a camera with known parameters, which are defined here in a few lines.
//!
//! Seeds are fixed. The stated rates are the probabilities that a correct analyser fails with a random seed.

use dunkelfeld_emva1288::{Frame, PhotonTransfer, Quantity, TemporalAccumulator};
use rand_distr::{Distribution, Normal, Poisson};
use rand_pcg::Pcg64;

const GAIN: f64 = 0.25;
const DARK_NOISE: f64 = 8.0;
const OFFSET: f64 = 50.0;
const FULL_WELL: f64 = 12_000.0;
const SATURATION: f64 = OFFSET + GAIN * FULL_WELL;
/// K^2 sigma_d^2 + 1/12.
const DARK_VARIANCE: f64 = GAIN * GAIN * DARK_NOISE * DARK_NOISE + 1.0 / 12.0;

fn frame(electrons: impl Iterator<Item = f64>, rng: &mut Pcg64) -> Vec<u16> {
    let noise = Normal::new(0.0, DARK_NOISE).expect("a valid distribution");
    electrons
        .map(|mu| {
            let shot = if mu > 0.0 { Poisson::new(mu).expect("positive").sample(rng) } else { 0.0 };
            let charge = (shot + noise.sample(rng)).min(FULL_WELL);
            (GAIN * charge + OFFSET).round().clamp(0.0, 4095.0) as u16
        })
        .collect()
}

fn z(q: &Quantity, truth: f64) -> f64 {
    (q.value - truth) / q.standard_error
}

/// One scene with a gradient, 24 frames, bins one DN wide: Z-tests at 6.5 sigma.
#[test]
fn a_scene_by_unit_bins_gives_the_gain() {
    let mut rng = Pcg64::new(3, 3);
    let side = 160;
    let mut stack = TemporalAccumulator::new(side, side);
    for _ in 0..24 {
        let ramp = (0..side * side).map(|i| f64::from(i) * FULL_WELL / f64::from(side * side));
        let values = frame(ramp, &mut rng);
        stack.add(Frame::new(side, side, &values).expect("square")).expect("same size");
    }
    let curve = PhotonTransfer::by_unit_bins(&stack.finish().expect("frames"), OFFSET, None).expect("no mask");
    let line = curve.line(SATURATION).expect("levels");
    assert!(z(&line.slope, GAIN).abs() < 6.5, "{}", line.slope);
    assert!(line.slope.standard_error < 0.005 * GAIN, "{}", line.slope);
    assert!(z(&line.intercept, DARK_VARIANCE).abs() < 6.5, "{}", line.intercept);
    assert!((0.8..1.2).contains(&line.reduced_chi_squared), "{line:?}");
}

/// The finding of the paper: gamma-encoded 8-bit values of a perfect photon counter have no straight line through them.
/// The variance of y ~ x^(1/2.2) falls as y^-0.2 instead of rising.
#[test]
fn the_curve_of_gamma_encoded_frames_does_not_rise() {
    let mut rng = Pcg64::new(4, 4);
    let side = 128;
    let mut stack = TemporalAccumulator::new(side, side);
    for _ in 0..50 {
        let values: Vec<u16> = (0..side * side)
            .map(|i| {
                let mu = 100.0 + 900.0 * f64::from(i) / f64::from(side * side);
                let x: f64 = Poisson::new(mu).expect("positive").sample(&mut rng);
                (255.0 * (x / 1200.0).min(1.0).powf(1.0 / 2.2)).round() as u16
            })
            .collect();
        stack.add(Frame::new(side, side, &values).expect("square")).expect("same size");
    }
    let curve = PhotonTransfer::by_unit_bins(&stack.finish().expect("frames"), 0.0, None).expect("no mask");
    // 6.5 standard errors below zero.
    let slope = curve.line(300.0).expect("levels").slope;
    assert!(slope.value < -6.5 * slope.standard_error, "{slope}");
}
