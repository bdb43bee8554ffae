//! The analysis of a linear camera: from a measurement to all figures of a data sheet.

use serde::Serialize;

use crate::bound::{Bound, Side};
use crate::frame::AnalysisError;
use crate::hidden::Hidden;
use crate::histogram::{self, Histogram};
use crate::linearity::{Linearity, linearity};
use crate::measurement::{AnalysisSettings, Measurement, Release, StackLevel};
use crate::profile::{Profile, profiles};
use crate::propagate::errors;
use crate::quantity::Quantity;
use crate::saturation::saturation;
use crate::shortcomings;
use crate::spectrum::{Spectrogram, horizontal, vertical};
use crate::summary::{Is, Summary};

/// Least number of levels in the range of the regressions.
const MIN_LEVELS: usize = 3;

/// One level of light, for the plots.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelPoint {
    /// Exposure time \[s\].
    pub exposure: f64,
    /// Photons per pixel, mu_p.
    pub photons: f64,
    /// mu_y - mu_y.dark \[DN\].
    pub signal: f64,
    /// Temporal variance sigma_y^2 \[DN^2\].
    pub variance: f64,
    /// Its standard error \[DN^2\].
    pub variance_error: f64,
    /// sigma_y.dark^2 of the same exposure time \[DN^2\].
    pub dark_variance: f64,
    /// Signal divided by temporal noise.
    pub snr: f64,
    /// The level lies in the range of the regressions for R and K.
    pub is_used: bool,
}

/// One dark level.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DarkPoint {
    /// Exposure time \[s\].
    pub exposure: f64,
    /// mu_y.dark and its standard error \[DN\].
    pub mean: [f64; 2],
    /// sigma_y.dark^2 and its standard error \[DN^2\].
    pub variance: [f64; 2],
}

/// Spectrograms, profiles and histograms of the stacks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Nonuniformity {
    /// Frames in the dark and in the bright stack.
    pub frames: [u32; 2],
    /// Spectrograms along rows and columns, of the dark stack and of the light alone.
    pub dark_spectrograms: [Spectrogram; 2],
    /// See [`Nonuniformity::dark_spectrograms`].
    pub bright_spectrograms: [Spectrogram; 2],
    /// Profiles along rows and columns.
    pub dark_profiles: [Profile; 2],
    /// See [`Nonuniformity::dark_profiles`].
    pub bright_profiles: [Profile; 2],
    /// Histogram of the dark pixels.
    pub dark_histogram: Option<Histogram>,
    /// Histogram of the responses of the pixels, high-pass filtered.
    pub response_histogram: Option<Histogram>,
}

/// The results of an analysis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Analysis {
    /// The release whose rules were used.
    pub release: Release,
    /// Bits per grey value.
    pub bits: u32,
    /// The figures.
    pub quantities: Vec<Quantity>,
    /// The figures of which only an upper or lower bound is known.
    pub bounds: Vec<Bound>,
    /// The grey value of saturated pixels \[DN\], if most pixels of the brightest level have the same.
    pub saturation_value: Option<u16>,
    /// Range of K \[DN/e-\], if rounding hides the dark variance that its regression subtracts.
    pub gain_range: Option<[f64; 2]>,
    /// Differences from the requirements of the standard, and how the analysis treats them.
    pub notes: Vec<String>,
    /// Levels of light, by ascending photons.
    pub levels: Vec<LevelPoint>,
    /// Dark levels, by ascending exposure time.
    pub darks: Vec<DarkPoint>,
    /// Deviations from a straight line.
    pub linearity: Linearity,
    /// Non-uniformity of the stacks.
    pub nonuniformity: Option<Nonuniformity>,
}

impl Analysis {
    /// The figure with this symbol.
    pub fn get(&self, symbol: &str) -> Option<&Quantity> {
        self.quantities.iter().find(|q| q.symbol == symbol)
    }

    /// The value of a figure. NaN if it does not exist.
    pub fn value(&self, symbol: &str) -> f64 {
        self.get(symbol).map_or(f64::NAN, |q| q.value)
    }

    /// The bound of a figure, if only a bound is known.
    pub fn bound(&self, symbol: &str) -> Option<Bound> {
        self.bounds.iter().copied().find(|b| b.symbol == symbol)
    }

    /// Signal-to-noise ratio of the linear model at a number of photons (equation 21), without and with the spatial
    /// noise.
    pub fn snr(&self, photons: f64) -> [f64; 2] {
        let electrons = self.value("eta") * photons;
        let dark = (self.value("sigma_y.dark") / self.value("K")).powi(2);
        let or_none = |symbol: &str| self.get(symbol).map_or(0.0, |q| q.value);
        let spatial = or_none("DSNU1288").powi(2) + (or_none("PRNU1288") / 100.0 * electrons).powi(2);
        [electrons / (dark + electrons).sqrt(), electrons / (dark + electrons + spatial).sqrt()]
    }
}

/// Analyses a linear camera (EMVA 1288, Linear).
///
/// Standard errors are those of a repetition with another camera of the same kind. They contain the noise of the
/// frames. For responsivity, saturation and non-uniformity they also contain the sampling error of the pixels, which
/// are a sample of such pixels.
///
/// # Errors
/// The measurement lacks a requirement. The error contains help.
pub fn analyse(measurement: &Measurement, settings: &AnalysisSettings) -> Result<Analysis, AnalysisError> {
    let (measurement, of_steps) = measurement.in_steps();
    let data = measurement.ordered()?;
    let saturation = saturation(&data, settings.release)?;
    let summary = Summary::new(&data, &saturation);
    if summary.used < MIN_LEVELS {
        return Err(AnalysisError::unfit(
            format!("{} levels lie below 70 % of saturation, {MIN_LEVELS} are needed at least", summary.used),
            "add levels between dark and saturation; the standard requires 50",
        ));
    }
    let linearity = linearity(&summary, saturation.signal)?;
    let results = summary.results();
    if !(results[Is::Gain as usize] > 0.0 && results[Is::Responsivity as usize] > 0.0) {
        return Err(AnalysisError::unfit(
            "the noise does not grow with the light, or the light not with its number of photons",
            "use raw frames of a linear camera; cameras that process their frames need the general module",
        ));
    }
    let errors = errors(&summary, Summary::results);
    let hidden = Hidden::new(&data, &summary);
    let (mut quantities, bounds) = figures(&results, &errors, settings, &hidden);
    for (symbol, name, [value, standard_error]) in [
        ("LE", "linearity error", [linearity.error, linearity.standard_error]),
        ("LE_min", "smallest deviation from linearity", linearity.least),
        ("LE_max", "largest deviation from linearity", linearity.most),
    ] {
        let section = "6.7 linearity";
        quantities.push(Quantity { symbol, name, value, standard_error, unit: "%", section });
    }
    let levels = data.bright.iter().zip(&summary.bright).enumerate().map(|(i, (s, p))| {
        let dark = &summary.dark[p.dark];
        let signal = p.mean.value - dark.mean.value;
        LevelPoint {
            exposure: s.level.exposure,
            photons: p.photons,
            signal,
            variance: p.variance.value,
            variance_error: p.variance.error,
            dark_variance: dark.variance.value,
            snr: if p.variance.value > 0.0 { signal / p.variance.value.sqrt() } else { 0.0 },
            is_used: i < summary.used,
        }
    });
    let darks = summary.dark.iter().map(|d| DarkPoint {
        exposure: d.exposure,
        mean: [d.mean.value, d.mean.error],
        variance: [d.variance.value, d.variance.error],
    });
    let nonuniformity = data.stacks.map(|(bright, dark)| nonuniformity(bright, dark));
    let mut notes: Vec<String> = of_steps.into_iter().chain(saturation.note).collect();
    notes.extend(shortcomings::linear(&data, &summary, &hidden));
    let response = nonuniformity.as_ref().and_then(|n| n.response_histogram.as_ref());
    notes.extend(response.and_then(|response| shortcomings::uneven(&summary, &results, &errors, response)));
    Ok(Analysis {
        release: settings.release,
        bits: data.bits,
        quantities,
        bounds,
        saturation_value: saturation.largest,
        gain_range: hidden.gains(),
        notes,
        levels: levels.collect(),
        darks: darks.collect(),
        linearity,
        nonuniformity,
    })
}

/// A figure in the report, with the result that it comes from.
struct Row {
    is: Is,
    symbol: &'static str,
    name: &'static str,
    unit: &'static str,
    section: &'static str,
    /// The result is a square, and the report contains its square root.
    is_square: bool,
    /// Factor from the result to the reported value.
    scale: f64,
}

#[rustfmt::skip]
const ROWS: [Row; 25] = {
    const fn row(is: Is, symbol: &'static str, name: &'static str, unit: &'static str, section: &'static str) -> Row {
        Row { is, symbol, name, unit, section, is_square: false, scale: 1.0 }
    }
    const fn root(is: Is, symbol: &'static str, name: &'static str, unit: &'static str, section: &'static str, scale: f64) -> Row {
        Row { is, symbol, name, unit, section, is_square: true, scale }
    }
    const SENSITIVITY: &str = "6.6 sensitivity";
    const SPATIAL: &str = "8 spatial nonuniformity";
    [
        Row { is: Is::Efficiency, symbol: "eta", name: "quantum efficiency", unit: "e-/photon", section: SENSITIVITY, is_square: false, scale: 1.0 },
        row(Is::Gain, "K", "overall system gain", "DN/e-", "6.6 sensitivity, eq. 50"),
        row(Is::Responsivity, "R", "responsivity", "DN/photon", SENSITIVITY),
        root(Is::DarkNoise2, "sigma_d", "temporal dark noise", "e-", SENSITIVITY, 1.0),
        root(Is::RowNoise2, "sigma_d.row", "temporal dark noise of rows", "e-", "of dark pairs, beside the standard", 1.0),
        root(Is::DarkVariance, "sigma_y.dark", "temporal dark noise", "DN", SENSITIVITY, 1.0),
        row(Is::DarkMean, "mu_y.dark", "dark grey value", "DN", SENSITIVITY),
        row(Is::LeastPhotons, "mu_p.min", "absolute sensitivity threshold", "photons", "2.6, eq. 27"),
        row(Is::LeastElectrons, "mu_e.min", "absolute sensitivity threshold", "e-", "2.6, eq. 27"),
        row(Is::MostPhotons, "mu_p.sat", "saturation irradiation", "photons", SENSITIVITY),
        row(Is::MostElectrons, "mu_e.sat", "saturation capacity", "e-", SENSITIVITY),
        row(Is::SnrMax, "SNR_max", "largest signal-to-noise ratio", "1", SENSITIVITY),
        row(Is::SnrMaxDb, "SNR_max.dB", "largest signal-to-noise ratio", "dB", SENSITIVITY),
        row(Is::Range, "DR", "dynamic range", "1", SENSITIVITY),
        row(Is::RangeDb, "DR.dB", "dynamic range", "dB", SENSITIVITY),
        row(Is::DarkCurrentMean, "mu_I.mean", "dark current, from means", "e-/s", "7 dark current"),
        row(Is::DarkCurrentVariance, "mu_I.var", "dark current, from variances", "e-/s", "7 dark current"),
        root(Is::Dsnu2, "DSNU1288", "dark signal nonuniformity", "e-", SPATIAL, 1.0),
        root(Is::DsnuPixel2, "DSNU1288.pixel", "of pixels", "e-", SPATIAL, 1.0),
        root(Is::DsnuRow2, "DSNU1288.row", "of rows", "e-", SPATIAL, 1.0),
        root(Is::DsnuColumn2, "DSNU1288.col", "of columns", "e-", SPATIAL, 1.0),
        root(Is::Prnu2, "PRNU1288", "photo response nonuniformity", "%", SPATIAL, 100.0),
        root(Is::PrnuPixel2, "PRNU1288.pixel", "of pixels", "%", SPATIAL, 100.0),
        root(Is::PrnuRow2, "PRNU1288.row", "of rows", "%", SPATIAL, 100.0),
        root(Is::PrnuColumn2, "PRNU1288.col", "of columns", "%", SPATIAL, 100.0),
    ]
};

/// The figures with a value, and those that are bounds.
fn figures(
    results: &[f64],
    errors: &[f64],
    settings: &AnalysisSettings,
    hidden: &Hidden,
) -> (Vec<Quantity>, Vec<Bound>) {
    let (mut quantities, mut bounds) = (Vec::new(), Vec::new());
    for row in &ROWS {
        let (value, error) = (results[row.is as usize], errors[row.is as usize]);
        if !value.is_finite() {
            continue;
        }
        let (value, standard_error) = if row.is_square { root(value, error) } else { (value, error) };
        let (value, standard_error) = (row.scale * value, row.scale * standard_error);
        let Row { symbol, name, unit, section, .. } = *row;
        let shown = |result: f64| row.scale * if row.is_square { result.max(0.0).sqrt() } else { result };
        let bound = match hidden.bound(row.is) {
            Some((limit, side)) => Some((shown(limit), side)),
            // The value is not significantly different from zero.
            None if row.is_square && results[row.is as usize] < 2.0 * error => {
                Some((value + 3.0 * standard_error, Side::Below))
            }
            None => None,
        };
        bounds.extend(bound.map(|(limit, side)| Bound { symbol, limit, side }));
        quantities.push(Quantity { symbol, name, value, standard_error, unit, section });
        let per_area = match symbol {
            "mu_p.min" => Some(("mu_p.min.area", "absolute sensitivity threshold per area")),
            "mu_p.sat" => Some(("mu_p.sat.area", "saturation irradiation per area")),
            _ => None,
        };
        if let (Some((symbol, name)), Some(pitch)) = (per_area, settings.pixel_pitch) {
            let area = pitch * pitch;
            bounds.extend(bound.map(|(limit, side)| Bound { symbol, limit: limit / area, side }));
            let (value, standard_error) = (value / area, standard_error / area);
            quantities.push(Quantity { symbol, name, value, standard_error, unit: "photons/um^2", section });
        }
    }
    (quantities, bounds)
}

/// The square root of a square that may be negative, and its standard error. Near zero, where a square root has no
/// finite slope, the error is the increase of the root for a square that is one error larger.
fn root(square: f64, error: f64) -> (f64, f64) {
    let value = square.max(0.0).sqrt();
    let slope = square.max(0.25 * error).sqrt();
    (value, if slope > 0.0 { error / (2.0 * slope) } else { 0.0 })
}

fn nonuniformity(bright: &StackLevel, dark: &StackLevel) -> Nonuniformity {
    let (bright, dark) = (&bright.stack, &dark.stack);
    Nonuniformity {
        frames: [dark.frames, bright.frames],
        dark_spectrograms: [horizontal(dark, None), vertical(dark, None)],
        bright_spectrograms: [horizontal(bright, Some(dark)), vertical(bright, Some(dark))],
        dark_profiles: profiles(dark),
        bright_profiles: profiles(bright),
        dark_histogram: histogram::dark(dark),
        response_histogram: histogram::response(bright, dark),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_of_squares_that_are_not_there_are_zero_with_a_bound() {
        let (value, error) = root(9.0, 0.6);
        assert!(value == 3.0 && (error - 0.1).abs() < 1e-12);
        let (value, error) = root(-0.01, 0.04);
        assert_eq!(value, 0.0);
        assert!((error - 0.2).abs() < 1e-12);
        assert_eq!(root(0.0, 0.0), (0.0, 0.0));
    }
}
