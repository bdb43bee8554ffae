//! The bias of leaving out an effect, and whether the camera can detect it: the same samples with and without it.

use crate::report::estimate::{Estimate, mean};
use crate::series::statistics::quantile;
use dunkelfeld::film::Plane;

/// Share of pixels for the quantiles of the bias.
const SHARE: f64 = 0.99;
/// Significance of a bias, in multiples of its own noise.
const RESOLVED: f64 = 2.0;

/// Is the absence of an effect detectable by the camera?
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// At least 1 % of the pixels are off by more than the noise of a frame.
    Visible,
    /// At least 99 % of the pixels are off by less than that.
    Beneath,
    /// The renders are too noisy for a result.
    Unresolved,
}

impl Verdict {
    pub(super) const fn words(self) -> &'static str {
        match self {
            Self::Visible => "yes",
            Self::Beneath => "no",
            Self::Unresolved => "too noisy",
        }
    }
}

/// The result of leaving out one effect.
#[derive(Clone, Debug)]
pub(super) struct Bias {
    /// Mean over the image, without minus with, in the signal's unit.
    pub(super) mean: Estimate,
    /// Root of the mean square of the bias over the sensor's standard deviation, after subtraction of its noise.
    pub(super) rms_sigma: f64,
    /// The 99 % quantile of the absolute bias, in the signal's unit. Its noise is part of it.
    pub(super) p99: f64,
    /// The same, in standard deviations of the sensor.
    pub(super) p99_sigma: f64,
    /// The expected `p99` and `p99_sigma` without any bias.
    pub(super) noise: f64,
    pub(super) noise_sigma: f64,
    /// Is it detectable by the camera? `None` without a sensor.
    pub(super) verdict: Option<Verdict>,
    /// The bias per pixel, in standard deviations of the sensor, or in the signal's unit without one.
    pub(super) map: Plane<f32>,
}

/// Compares signals with an effect and without it, seed by seed, up to the saturation signal of the sensor (`white`).
///
/// The bias of a pixel is the mean difference d over the seeds. Its noise is estimated from the same differences. With
/// signs that alternate from seed to seed, the common part of all seeds cancels. The remainder has the variance of the
/// noise of the mean and no bias. `None` unless the number of seeds is even and the same for both.
pub(super) fn bias(
    with: &[Plane<f32>],
    without: &[Plane<f32>],
    white: f64,
    sensor_variance: Option<&Plane<f64>>,
) -> Option<Bias> {
    let n = with.len();
    let first = with.first()?;
    let pixels = first.data().len();
    if n % 2 == 1 || without.len() != n || with.iter().chain(without).any(|p| p.data().len() != pixels) {
        return None;
    }
    let (mut bias, mut noise) = (vec![0.0; pixels], vec![0.0; pixels]);
    let mut means = Vec::new();
    for (i, (a, b)) in with.iter().zip(without).enumerate() {
        let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
        let mut sum = 0.0;
        for (p, (a, b)) in a.data().iter().zip(b.data()).enumerate() {
            let d = (f64::from(*b).min(white) - f64::from(*a).min(white)) / n as f64;
            bias[p] += d;
            noise[p] += sign * d;
            sum += d;
        }
        means.push(sum * n as f64 / pixels as f64);
    }
    let in_sigma = |v: &[f64]| -> Vec<f64> {
        match sensor_variance {
            Some(s) => v.iter().zip(s.data()).map(|(v, s)| v / s.sqrt()).collect(),
            None => v.to_vec(),
        }
    };
    let worst = |v: &[f64]| quantile(v.iter().map(|v| v.abs()).collect(), SHARE);
    let square = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>() / pixels as f64;
    let (bias_sigma, noise_sigma) = (in_sigma(&bias), in_sigma(&noise));
    let (p99_sigma, noise_p99_sigma) = (worst(&bias_sigma), worst(&noise_sigma));
    Some(Bias {
        mean: mean(&means),
        rms_sigma: (square(&bias_sigma) - square(&noise_sigma)).max(0.0).sqrt(),
        p99: worst(&bias),
        p99_sigma,
        noise: worst(&noise),
        noise_sigma: noise_p99_sigma,
        verdict: sensor_variance.map(|_| verdict(p99_sigma, noise_p99_sigma)),
        map: Plane::from_vec(first.width(), first.height(), bias_sigma.into_iter().map(|v| v as f32).collect())?,
    })
}

fn verdict(p99: f64, noise: f64) -> Verdict {
    if p99 <= 1.0 {
        Verdict::Beneath
    } else if p99 > RESOLVED * noise {
        Verdict::Visible
    } else {
        Verdict::Unresolved
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_sampling::keyed_stream;
    use rand_core::Rng;

    const SIDE: u32 = 64;

    /// Eight renders of a grey field with noise of variance 1, and the same with `extra(x)` added and noise of its own.
    fn renders(extra: impl Fn(u32) -> f32) -> (Vec<Plane<f32>>, Vec<Plane<f32>>) {
        let mut rng = keyed_stream(7, 0, 0, 0);
        let mut noise = || 12f32.sqrt() * (rng.next_u32() as f32 / u32::MAX as f32 - 0.5);
        let mut set = |add: &dyn Fn(u32) -> f32| -> Vec<Plane<f32>> {
            (0..8).map(|_| Plane::from_fn(SIDE, SIDE, |x, _| 100.0 + noise() + add(x))).collect()
        };
        (set(&|_| 0.0), set(&extra))
    }

    #[test]
    fn no_effect_is_no_bias_and_its_noise_is_stated() {
        let (with, without) = renders(|_| 0.0);
        let s = Plane::new(SIDE, SIDE, 4.0);
        let found = bias(&with, &without, 1e9, Some(&s)).expect("a bias");
        // The mean of 8 differences of variance 2 has sigma 0.5, which is 0.25 of the sensor's. 99 % of normal numbers
        // lie within 2.58 sigma. 4096 pixels determine that quantile to 2 %. A tenth is five times that.
        for value in [found.p99_sigma, found.noise_sigma] {
            assert!((value - 2.576 * 0.25).abs() < 0.06, "{value}");
        }
        assert!((found.noise - 2.0 * found.noise_sigma).abs() < 1e-9);
        // Of a mean of 8 x 4096 differences: sigma sqrt(2 / 32768) = 0.0078; five of that are a false alarm of 6e-7.
        assert!(found.mean.value.abs() < 0.039, "{:?}", found.mean);
        assert!(found.rms_sigma < 0.1, "{}", found.rms_sigma);
        assert_eq!(found.verdict, Some(Verdict::Beneath));
    }

    #[test]
    fn a_bias_is_found_where_it_is_and_as_large_as_it_is() {
        // A tenth of the columns is darker by 30, which is 15 sensor sigma.
        let (with, without) = renders(|x| if x % 10 == 0 { -30.0 } else { 0.0 });
        let s = Plane::new(SIDE, SIDE, 4.0);
        let found = bias(&with, &without, 1e9, Some(&s)).expect("a bias");
        let share = 7.0 / 64.0;
        assert!((found.mean.value + 30.0 * share).abs() < 0.05, "{:?}", found.mean);
        assert!((found.rms_sigma - 15.0 * f64::sqrt(share)).abs() < 0.05, "{}", found.rms_sigma);
        assert!((found.p99_sigma - 15.5).abs() < 0.5 && found.noise_sigma < 0.8, "{found:?}");
        assert_eq!(found.verdict, Some(Verdict::Visible));
        assert!((found.map.at(10, 3) + 15.0).abs() < 1.5 && found.map.at(11, 3).abs() < 1.5);
    }

    #[test]
    fn differences_above_white_are_invisible_to_a_camera() {
        let (with, without) = renders(|_| 50.0);
        let found = bias(&with, &without, 90.0, None).expect("a bias");
        assert_eq!((found.mean.value, found.p99, found.verdict), (0.0, 0.0, None));
    }

    #[test]
    fn noise_alone_gives_no_verdict_beyond_it() {
        assert_eq!(verdict(5.0, 4.0), Verdict::Unresolved);
        assert_eq!(verdict(5.0, 2.0), Verdict::Visible);
        assert_eq!(verdict(0.9, 4.0), Verdict::Beneath);
    }
}
