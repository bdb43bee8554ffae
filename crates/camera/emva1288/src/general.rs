//! The general module, for cameras that are not linear or whose frames were processed (EMVA 1288 release 4.0 General).
//!
//! Without a straight line there is neither K nor eta. The remaining quantity is the light that a pixel must receive.
//! Noise is referred to the input by the local slope of the characteristic curve, sigma_p = sigma_y / (d mu_y / d
//! mu_p).

use serde::Serialize;

use crate::bound::{Bound, Side};
use crate::frame::AnalysisError;
use crate::measurement::{AnalysisSettings, Measurement, Release};
use crate::propagate::errors;
use crate::quantity::Quantity;
use crate::saturation::saturation;
use crate::shortcomings::{self, is_cut_off};
use crate::summary::{MIN_DARK_VARIANCE, Point, Summary};

/// Least number of levels up to saturation.
const MIN_LEVELS: usize = 4;
const SECTION: &str = "release 4.0 General";

/// A level with its noise referred to the input.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InputPoint {
    /// Photons per pixel, mu_p.
    pub photons: f64,
    /// mu_y - mu_y.dark \[DN\].
    pub signal: f64,
    /// Local slope d mu_y / d mu_p \[DN per photon\].
    pub slope: f64,
    /// Noise at the input and its standard error, sigma_p \[photons\].
    pub noise: [f64; 2],
    /// Signal-to-noise ratio at the input, mu_p / sigma_p.
    pub snr: f64,
}

/// The figures of a camera of any characteristic.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GeneralAnalysis {
    /// The release whose rules for saturation were used.
    pub release: Release,
    /// Bits per grey value.
    pub bits: u32,
    /// The figures.
    pub quantities: Vec<Quantity>,
    /// The figures of which only an upper or lower bound is known.
    pub bounds: Vec<Bound>,
    /// Notes on the measurement.
    pub notes: Vec<String>,
    /// Levels below saturation, by ascending photons.
    pub levels: Vec<InputPoint>,
}

impl GeneralAnalysis {
    /// The bound of a figure, if only a bound is known.
    pub fn bound(&self, symbol: &str) -> Option<Bound> {
        self.bounds.iter().copied().find(|b| b.symbol == symbol)
    }
}

/// Analyses a camera of any characteristic (EMVA 1288 release 4.0, General).
///
/// # Errors
/// The measurement lacks a requirement. The error contains help.
pub fn analyse_general(
    measurement: &Measurement,
    settings: &AnalysisSettings,
) -> Result<GeneralAnalysis, AnalysisError> {
    let (measurement, of_steps) = measurement.in_steps();
    let data = measurement.ordered()?;
    let saturation = saturation(&data, settings.release)?;
    let mut summary = Summary::new(&data, &saturation);
    let end = summary.bright.iter().position(|p| p.photons > saturation.photons).unwrap_or(summary.bright.len());
    summary.bright.truncate(end);
    // One level for each amount of light, since slopes are computed across levels.
    summary.bright.dedup_by(|b, a| b.photons <= a.photons);
    if summary.bright.len() < MIN_LEVELS {
        return Err(AnalysisError::unfit(
            format!("{} levels lie below saturation, {MIN_LEVELS} are needed at least", summary.bright.len()),
            "add levels between dark and saturation; the standard requires 50",
        ));
    }
    let slopes = slopes(&summary);
    if let Some(i) = slopes.iter().position(|s| s.is_nan() || *s <= 0.0) {
        return Err(AnalysisError::unfit(
            format!(
                "the grey values do not grow with the light near {:.4} photons",
                summary.bright[i.saturating_sub(1)].photons
            ),
            "use levels whose grey values differ by more than their noise, and order them by their light",
        ));
    }
    summary.is_bound = summary.dark[summary.bright[0].dark].variance.value < MIN_DARK_VARIANCE;
    let values = figures(&summary);
    let spread = errors(&summary, figures);
    let rows = [
        ("mu_p.min", "absolute sensitivity threshold, where SNR is 1", "photons"),
        ("mu_p.sat", "saturation irradiation", "photons"),
        ("DR", "dynamic range", "1"),
        ("DR.dB", "dynamic range", "dB"),
        ("SNR_max", "largest signal-to-noise ratio at the input", "1"),
        ("SNR_max.dB", "largest signal-to-noise ratio at the input", "dB"),
        ("sigma_p.dark", "dark noise at the input", "photons"),
    ];
    let mut quantities = Vec::new();
    let mut bounds = Vec::new();
    for ((symbol, name, unit), (value, standard_error)) in rows.into_iter().zip(values.into_iter().zip(spread)) {
        if !value.is_finite() {
            continue;
        }
        // If dark values are cut off at zero, the noise has no bound.
        let side = match symbol {
            "mu_p.min" | "sigma_p.dark" => Some(Side::Below),
            "DR" | "DR.dB" => Some(Side::Above),
            _ => None,
        };
        let side = side.filter(|_| summary.is_bound && !is_cut_off(&data));
        bounds.extend(side.map(|side| Bound { symbol, limit: value, side }));
        quantities.push(Quantity { symbol, name, value, standard_error, unit, section: SECTION });
    }
    let levels = summary.bright.iter().zip(slopes.iter().skip(1)).map(|(p, slope)| {
        let noise = p.variance.value.max(0.0).sqrt() / slope;
        let error = if p.variance.value > 0.0 { 0.5 * noise * p.variance.error / p.variance.value } else { 0.0 };
        InputPoint {
            photons: p.photons,
            signal: p.mean.value - summary.dark[p.dark].mean.value,
            slope: *slope,
            noise: [noise, error],
            snr: if noise > 0.0 { p.photons / noise } else { 0.0 },
        }
    });
    let mut notes: Vec<String> = of_steps.into_iter().chain(saturation.note).collect();
    notes.extend(shortcomings::general(&data, summary.is_bound));
    if !values[0].is_finite() {
        notes.push("at no level is the light as large as its noise: mu_p.min and DR were not found".into());
    }
    let levels = levels.collect();
    Ok(GeneralAnalysis { release: settings.release, bits: data.bits, quantities, bounds, notes, levels })
}

/// mu_p.min, mu_p.sat, DR, DR in dB, the largest SNR, the same in dB, dark noise at the input.
fn figures(s: &Summary) -> [f64; 7] {
    let slopes = slopes(s);
    let squares: Vec<f64> =
        s.bright.iter().zip(slopes.iter().skip(1)).map(|(p, slope)| p.variance.value / (slope * slope)).collect();
    // Upper bound of the noise that rounding hides, in the dark and at the levels beside it.
    let seen = |variance: f64| if s.is_bound { variance.max(MIN_DARK_VARIANCE) } else { variance };
    let dark2 = seen(s.dark[s.bright[0].dark].variance.value) / (slopes[0] * slopes[0]);
    let bounded: Vec<f64> =
        s.bright.iter().zip(slopes.iter().skip(1)).map(|(p, slope)| seen(p.variance.value) / (slope * slope)).collect();
    let least = threshold(s, dark2, &bounded);
    // The light at saturation does not change with the errors of these pixels, since the module assumes no response.
    let most = s.saturation.value;
    let snr = s.bright.iter().zip(&squares).filter(|(_, v)| **v > 0.0).map(|(p, v)| p.photons / v.sqrt());
    let best = snr.fold(0.0, f64::max);
    let range = most / least;
    [least, most, range, 20.0 * range.log10(), best, 20.0 * best.log10(), dark2.max(0.0).sqrt()]
}

/// The light that equals its noise, mu^2 = sigma_p^2, with sigma_p^2 linear from the dark to the first level and from
/// level to level. NaN if there is no such light.
fn threshold(s: &Summary, dark2: f64, squares: &[f64]) -> f64 {
    let (mut x0, mut v0) = (0.0, dark2);
    for (p, &v) in s.bright.iter().zip(squares) {
        if p.photons * p.photons >= v {
            let growth = (v - v0) / (p.photons - x0);
            return 0.5 * growth + (0.25 * growth * growth + v0 - growth * x0).max(0.0).sqrt();
        }
        (x0, v0) = (p.photons, v);
    }
    f64::NAN
}

/// Slope of the characteristic curve in the dark and at every level: that of the parabola through the level and its
/// neighbours.
fn slopes(s: &Summary) -> Vec<f64> {
    let at = |p: &Point| (p.photons, p.mean.value - s.dark[p.dark].mean.value);
    let points: Vec<(f64, f64)> = std::iter::once((0.0, 0.0)).chain(s.bright.iter().map(at)).collect();
    (0..points.len())
        .map(|i| {
            let m = i.clamp(1, points.len() - 2);
            let [(x0, y0), (x1, y1), (x2, y2)] = [points[m - 1], points[m], points[m + 1]];
            let (left, right) = ((y1 - y0) / (x1 - x0), (y2 - y1) / (x2 - x1));
            let bend = (right - left) / (x2 - x0);
            left + bend * (2.0 * points[i].0 - x0 - x1)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::Estimate;

    fn camera(curve: impl Fn(f64) -> f64, slope: impl Fn(f64) -> f64, dark_noise: f64) -> Summary {
        let exact = |value| Estimate { value, error: 0.0 };
        let at = |photons: f64| Point {
            exposure: 1.0,
            photons,
            dark: 0,
            mean: exact(5.0 + curve(photons)),
            variance: exact((dark_noise * dark_noise + photons) * slope(photons).powi(2)),
        };
        Summary {
            bright: (1..=40).map(|k| at(25.0 * f64::from(k))).collect(),
            dark: vec![at(0.0)],
            used: 0,
            saturation: exact(1000.0),
            response: exact(1.0),
            offset: exact(0.0),
            row_variance: Estimate::default(),
            spatial: None,
            is_bound: false,
        }
    }

    /// A photon counter with dark noise of 6 photons and a parabola as characteristic curve. Slopes of a parabola are
    /// exact, so the noise at the input is that of the counter, sqrt(36 + mu). The threshold solves mu^2 = 36 + mu:
    /// 6.5208.
    #[test]
    fn the_curve_of_the_camera_drops_out() {
        let bent = camera(|x| x - 2e-4 * x * x, |x| 1.0 - 4e-4 * x, 6.0);
        let got = figures(&bent);
        assert!((got[0] - (0.5 + 36.25f64.sqrt())).abs() < 1e-9, "{got:?}");
        assert!((got[4] - 1000.0 / 1036f64.sqrt()).abs() < 1e-9, "{got:?}");
        assert!((got[6] - 6.0).abs() < 1e-9 && (got[2] - 1000.0 / got[0]).abs() < 1e-9, "{got:?}");
    }
}
