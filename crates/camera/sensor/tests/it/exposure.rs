//! Tests of frames against the EMVA 1288 noise model: mean, variance, and clipping.
//!
//! Seeds are fixed. The stated rates are the probabilities that a correct implementation fails with a random seed.

use crate::support::spec;
use dunkelfeld_film::Plane;
use dunkelfeld_radiometry::{DigitalNumber, Electrons, Seconds};
use dunkelfeld_sensor::{DarkCurrent, Device, Exposure, FrameKey, SensorModel, SensorSpec};

const SIZE: u32 = 256;
const PIXELS: f64 = (SIZE * SIZE) as f64;

fn device(spec: SensorSpec, seed: u64) -> Device {
    Device::new(SensorModel::new(spec).expect("valid"), seed, SIZE, SIZE).expect("no maps")
}

fn exposure() -> Exposure {
    Exposure::new(Seconds(0.02)).expect("valid")
}

fn flat(electrons: f32) -> Plane<f32> {
    Plane::new(SIZE, SIZE, electrons)
}

fn frame(device: &Device, electrons: f32, seed: u64, number: u32) -> Vec<f64> {
    let key = FrameKey { seed, frame: number };
    let frame = device.expose(&flat(electrons), exposure(), key).expect("sizes agree");
    frame.into_vec().into_iter().map(f64::from).collect()
}

fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0))
}

/// Z-tests at 7 sigma (2.6e-12 each, 1e-10 together). The noise is at least 1 DN, so that rounding adds 1/12 to better
/// than 1e-8 (Sheppard).
#[test]
fn mean_and_variance_follow_the_model() {
    let device = device(spec(), 1);
    let model = device.model().clone();
    let spec = model.spec();
    for (i, mu) in [0.0f32, 0.5, 3.0, 20.0, 100.0, 700.0, 4000.0, 12_000.0].into_iter().enumerate() {
        let (mean, variance) = moments(&frame(&device, mu, 11, i as u32));
        let dark = 2.0; // 100 e-/s for 20 ms
        let expected_mean = spec.system_gain * (f64::from(mu) + dark) + spec.offset.0;
        let expected = spec.system_gain.powi(2) * model.temporal_variance(Electrons(f64::from(mu)), exposure().time());
        // A second computation, so that the test does not depend on that of the model.
        let by_hand = 0.0625 * (f64::from(mu) + dark + 16.0) + 1.0 / 12.0;
        assert!((expected / by_hand - 1.0).abs() < 1e-12);
        let z_mean = (mean - expected_mean) / (expected / PIXELS).sqrt();
        // Fourth moment of a Poisson number plus normal noise: 3 sigma^4 + K^4 mean.
        let fourth = 2.0 * expected * expected + 0.25f64.powi(4) * (f64::from(mu) + dark);
        let z_variance = (variance - expected) / (fourth / PIXELS).sqrt();
        assert!(z_mean.abs() < 7.0, "{mu} e-: mean {mean}, expected {expected_mean}, z = {z_mean:.2}");
        assert!(z_variance.abs() < 7.0, "{mu} e-: variance {variance}, expected {expected}, z = {z_variance:.2}");
    }
}

#[test]
fn signals_are_clipped_at_the_well_at_the_converter_and_at_zero() {
    let well = device(SensorSpec { full_well: Electrons(8000.0), ..spec() }, 1);
    let huge = [20_000.0, 1e9, 1e30, f32::MAX];
    for electrons in huge {
        assert!(frame(&well, electrons, 1, 0).iter().all(|y| *y == 2040.0), "{electrons} e-");
    }
    let converter = device(SensorSpec { system_gain: 0.5, ..spec() }, 1);
    assert!(frame(&converter, 1e6, 1, 0).iter().all(|y| *y == 4095.0));
    let no_offset = device(SensorSpec { offset: DigitalNumber(0.0), ..spec() }, 1);
    let dark = frame(&no_offset, 0.0, 1, 0);
    assert!(dark.contains(&0.0) && dark.iter().all(|y| *y < 20.0));
}

#[test]
fn without_noise_a_grey_value_is_the_rounded_signal() {
    let quiet = SensorSpec {
        dark_noise: Electrons(0.0),
        dark_current: DarkCurrent { rate: 0.0, ..spec().dark_current },
        offset: DigitalNumber(12.5),
        ..spec()
    };
    // Without photons there is no noise: 12.5 is rounded once, upwards.
    assert!(frame(&device(quiet, 1), 0.0, 1, 0).iter().all(|y| *y == 13.0));
}
