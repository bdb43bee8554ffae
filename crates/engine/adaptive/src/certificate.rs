//! The certificate: the shares and quantiles of hidden noise of a render.
//!
//! Each pixel has the ratio `v_r / s`: the variance of its rendered mean over the temporal variance of the sensor at
//! that mean (EMVA 1288), both in electrons squared. A pixel is *hidden at k* if its ratio is at most `k^2`. Saturated
//! pixels are left out: differences above saturation are not visible.

use dunkelfeld_film::Plane;

use crate::required_samples::{HIDDEN_SHARE, quantile_in};

/// Statistics of the ratios `v_r / s` over the pixels that are not saturated. An unknown ratio counts as infinite in
/// the quantiles. Mean and maximum are those of the known ratios, infinite if all are unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Certificate {
    /// The level k of the certificate.
    pub k: f64,
    /// Share of the counted pixels that must be hidden for a hidden render: [`HIDDEN_SHARE`], unless the caller sets
    /// another.
    pub share: f64,
    /// Share of the counted pixels whose ratio is at most `k^2`, in \[0, 1\]; 1 if none is counted.
    pub hidden: f64,
    /// The same share of the means of blocks of 8 x 8 pixels, for a lens that blurs: their noise is the one at low frequencies,
    /// which a lens does not remove. `None` for other lenses.
    pub hidden_blocks: Option<f64>,
    /// Mean ratio.
    pub mean: f64,
    /// Median ratio.
    pub median: f64,
    /// Ratio that 99 % of the pixels do not exceed. Its square root is the k at which the render is hidden.
    pub p99: f64,
    /// Largest ratio.
    pub max: f64,
    /// Number of counted pixels, including those of unknown variance: these have no ratio and are not hidden.
    pub pixels: u64,
    /// Pixels left out because they are saturated beyond doubt.
    pub saturated: u64,
    /// Pixels of unknown variance.
    pub unknown: u64,
}

impl Certificate {
    /// Returns whether the render is hidden at its k: at least `share` of the unsaturated pixels are.
    pub fn is_hidden(&self) -> bool {
        self.hidden >= self.share
    }
}

/// The variances of a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Claim {
    /// Variance of the rendered mean, v_r [e-^2]. Infinite if it is unknown.
    pub render: f32,
    /// Variance of the sensor, s [e-^2], above zero.
    pub sensor: f32,
    /// The pixel is saturated.
    pub saturated: bool,
}

impl Claim {
    /// The ratio v_r / s. Infinite if v_r is unknown.
    fn ratio(&self) -> f32 {
        // Zero variance is hidden even by a sensor without noise.
        let ratio = if self.render == 0.0 { 0.0 } else { self.render / self.sensor };
        if ratio.is_nan() { f32::INFINITY } else { ratio }
    }
}

/// Certifies a render at `k` from the variances of its pixels, row by row. Also returns the ratio v_r / s of every
/// pixel, infinite if v_r is unknown.
///
/// # Panics
/// If there are more or fewer pixels than the size has.
pub fn certify([width, height]: [u32; 2], claims: impl Iterator<Item = Claim>, k: f64) -> (Certificate, Plane<f32>) {
    let mut ratios = Vec::with_capacity(width as usize * height as usize);
    let limit = k * k;
    let (mut pixels, mut saturated, mut unknown, mut hidden) = (0u64, 0u64, 0u64, 0u64);
    let (mut sum, mut max) = (0.0, 0.0f64);
    let mut counted = Vec::with_capacity(ratios.capacity());
    for claim in claims {
        let ratio = claim.ratio();
        ratios.push(ratio);
        if claim.saturated {
            saturated += 1;
            continue;
        }
        pixels += 1;
        counted.push(ratio);
        if !ratio.is_finite() {
            unknown += 1;
            continue;
        }
        let ratio = f64::from(ratio);
        hidden += u64::from(ratio <= limit);
        sum += ratio;
        max = max.max(ratio);
    }
    let share = |n: u64| if pixels == 0 { 1.0 } else { n as f64 / pixels as f64 };
    let known = pixels - unknown;
    let (mean, max) =
        if known == 0 && pixels > 0 { (f64::INFINITY, f64::INFINITY) } else { (sum / known.max(1) as f64, max) };
    let mut quantile = |share| f64::from(quantile_in(&mut counted, share).unwrap_or(0.0));
    let certificate = Certificate {
        k,
        share: HIDDEN_SHARE,
        hidden: share(hidden),
        hidden_blocks: None,
        mean,
        median: quantile(0.5),
        p99: quantile(HIDDEN_SHARE),
        max,
        pixels,
        saturated,
        unknown,
    };
    (certificate, Plane::of_pixels(width, height, ratios))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Planes {
        render: Plane<f32>,
        sensor: Plane<f32>,
        saturated: Plane<bool>,
    }

    impl Planes {
        /// 100 x 100 pixels. A function of the pixel number gives the ratio.
        fn of(ratio: impl Fn(u32) -> f32) -> Self {
            Self {
                render: Plane::from_fn(100, 100, |x, y| 20.0 * ratio(y * 100 + x)),
                sensor: Plane::new(100, 100, 20.0),
                saturated: Plane::new(100, 100, false),
            }
        }

        fn ratios(&self, k: f64) -> (Certificate, Plane<f32>) {
            let variances = self.render.data().iter().zip(self.sensor.data());
            let claim = |((&render, &sensor), &saturated)| Claim { render, sensor, saturated };
            certify([100, 100], variances.zip(self.saturated.data()).map(claim), k)
        }

        fn certify(&self, k: f64) -> Certificate {
            self.ratios(k).0
        }
    }

    #[test]
    fn shares_and_quantiles_are_counted() {
        // Ratios 0.0001, 0.0002, ... 1.
        let c = Planes::of(|i| (i + 1) as f32 / 1e4).certify(0.5);
        assert!((c.hidden - 0.25).abs() < 1e-3, "{c:?}");
        assert!((c.median - 0.5).abs() < 1e-3 && (c.p99 - 0.99).abs() < 1e-3 && (c.max - 1.0).abs() < 1e-6, "{c:?}");
        assert!((c.mean - 0.50005).abs() < 1e-4);
        assert_eq!((c.pixels, c.saturated, c.unknown), (10_000, 0, 0));
        assert!(!c.is_hidden() && Planes::of(|_| 0.2).certify(0.5).is_hidden());
    }

    #[test]
    fn saturated_pixels_do_not_count_and_unknown_ones_are_not_hidden() {
        let mut planes = Planes::of(|_| 0.1);
        for i in 0..200 {
            planes.saturated.data_mut()[i] = true;
            planes.render.data_mut()[i] = f32::INFINITY;
        }
        let c = planes.certify(0.5);
        assert!(c.hidden == 1.0 && c.saturated == 200 && c.pixels == 9800 && c.unknown == 0, "{c:?}");
        planes.render.data_mut()[300..398].fill(f32::INFINITY);
        let c = planes.certify(0.5);
        assert!((c.hidden - 0.99).abs() < 1e-12 && c.unknown == 98 && c.is_hidden(), "{c:?}");
        assert!((c.p99 - 0.1).abs() < 1e-6 && (c.max - 0.1).abs() < 1e-6, "{c:?}");
        planes.render.data_mut()[398] = f32::NAN;
        let c = planes.certify(0.5);
        assert!(!c.is_hidden() && c.p99 == f64::INFINITY && (c.median - 0.1).abs() < 1e-6, "{c:?}");
        planes.render = Plane::new(100, 100, f32::INFINITY);
        let c = planes.certify(0.5);
        assert_eq!((c.hidden, c.unknown), (0.0, 9800));
        assert!([c.mean, c.median, c.p99, c.max].iter().all(|&r| r == f64::INFINITY), "{c:?}");
        planes.saturated = Plane::new(100, 100, true);
        let none = planes.certify(0.5);
        assert_eq!((none.hidden, none.mean, none.max, none.pixels), (1.0, 0.0, 0.0, 0));
    }
}
