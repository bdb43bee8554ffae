//! What an analysis of a simulated data set must find: the figures that follow from the model.

use super::plan::{DatasetSettings, Vary};
use dunkelfeld_radiometry::{Irradiance, Nanometres, Seconds};
use dunkelfeld_sensor::SensorModel;
use serde::Serialize;
use std::collections::BTreeMap;

/// Standard deviations that 0.15 % of normal numbers exceed: the middle of what release 4.0 allows at saturation.
const QUANTILE: f64 = 2.967_738;
/// Standard deviations above the end of the scale where all pixels are at it.
const FULL: f64 = 5.0;

/// The light of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Light {
    pub(super) wavelength: Nanometres,
    /// Quantum efficiency there.
    pub(super) efficiency: f64,
    /// The irradiance, or the largest.
    pub(super) irradiance: Irradiance,
}

/// What is true of a data set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Truth {
    /// The sensor.
    pub sensor: String,
    /// Wavelength of the light \[nm\].
    pub wavelength_nm: f64,
    /// The irradiance of all levels, or the largest \[W/m^2\].
    pub irradiance_w_m2: f64,
    /// Distance of the pixels \[um\].
    pub pixel_pitch_um: f64,
    /// What was varied.
    pub vary: Vary,
    /// Picks device and noise.
    pub seed: u64,
    /// The figures by their symbols, those of devices of this kind, for release 4.0.
    pub quantities: BTreeMap<&'static str, f64>,
    /// What the figures leave out.
    pub notes: Vec<String>,
}

/// The end of the scale: where electrons are no longer told apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Edge {
    /// Electrons, dark ones included, from which on the grey value is the largest.
    end: f64,
    read: f64,
    dsnu: f64,
    prnu: f64,
}

impl Edge {
    pub(super) fn of(model: &SensorModel) -> Self {
        let s = model.spec();
        // Grey values are rounded: the largest is reached half a step early, if the well is not full before.
        let full = s.offset.0 + s.system_gain * s.full_well.0;
        let largest = (full + 0.5).floor().min(f64::from(model.max_value()));
        let end = (largest - 0.5 - s.offset.0) / s.system_gain;
        Self { end, read: s.dark_noise.0, dsnu: s.fixed_pattern.dsnu.0, prnu: s.fixed_pattern.prnu }
    }

    /// Photo-electrons at saturation, where 0.15 % of the values are the largest. `dark` gives the dark electrons that come with
    /// them.
    pub(super) fn saturation(&self, dark: impl Fn(f64) -> f64) -> f64 {
        self.photo_electrons(QUANTILE, dark)
    }

    /// Photo-electrons at which practically all values are the largest.
    pub(super) fn full(&self, dark: impl Fn(f64) -> f64) -> f64 {
        self.photo_electrons(-FULL, dark)
    }

    /// Photo-electrons whose mean lies so many standard deviations of all pixels below the end; above it for negative ones.
    fn photo_electrons(&self, quantile: f64, dark: impl Fn(f64) -> f64) -> f64 {
        let mut photo = self.end.max(1.0);
        // The spread hardly depends on the light: this converges at once.
        for _ in 0..60 {
            let dark = dark(photo);
            // Poisson numbers whose means differ from pixel to pixel.
            let pattern = (self.prnu * photo).powi(2);
            let variance = photo + dark + self.read * self.read + self.dsnu * self.dsnu + pattern;
            let skewness = (photo + dark + 3.0 * pattern) / variance.powf(1.5);
            // Cornish and Fisher (1938), first term: the upper tail of counts is longer.
            let reach = quantile + (quantile * quantile - 1.0) * skewness / 6.0;
            photo = (self.end - dark - variance.sqrt() * reach).max(1.0);
        }
        photo
    }
}

/// The figures of the model, by the definitions of EMVA 1288 release 4.0 Linear. `most` are the photons of the last level.
pub(super) fn truth(model: &SensorModel, light: &Light, settings: &DatasetSettings, most: f64) -> Truth {
    let s = model.spec();
    let (gain, efficiency) = (s.system_gain, light.efficiency);
    let current = model.dark_electrons(Seconds(1.0)).0;
    let has_times = settings.vary == Vary::Exposure;
    // With several times dark noise is what it is at time zero.
    let dark = if has_times { 0.0 } else { current * settings.exposure.0 };
    let dark_noise2 = s.dark_noise.0.powi(2) + dark;
    let dark_variance = gain * gain * dark_noise2 + 1.0 / 12.0;
    let least = (dark_variance / (gain * gain) + 0.25).sqrt() + 0.5;
    let saturation = Edge::of(model).saturation(|photo| dark_at(current, settings, photo / (efficiency * most)));
    let pattern = &s.fixed_pattern;
    let range = saturation / least;
    let mut quantities = BTreeMap::from([
        ("eta", efficiency),
        ("K", gain),
        ("R", gain * efficiency),
        ("sigma_d", dark_noise2.sqrt()),
        ("sigma_y.dark", dark_variance.sqrt()),
        ("mu_y.dark", s.offset.0 + gain * dark),
        ("mu_e.min", least),
        ("mu_p.min", least / efficiency),
        ("mu_e.sat", saturation),
        ("mu_p.sat", saturation / efficiency),
        ("SNR_max", saturation.sqrt()),
        ("SNR_max.dB", 10.0 * saturation.log10()),
        ("DR", range),
        ("DR.dB", 20.0 * range.log10()),
        ("LE", 0.0),
        ("DSNU1288", pattern.dsnu.0),
        ("DSNU1288.pixel", pattern.dsnu_pixel().0),
        ("DSNU1288.row", pattern.dsnu_row.0),
        ("DSNU1288.col", pattern.dsnu_column.0),
        ("PRNU1288", 100.0 * pattern.prnu),
        ("PRNU1288.pixel", 100.0 * pattern.prnu_pixel()),
        ("PRNU1288.row", 100.0 * pattern.prnu_row),
        ("PRNU1288.col", 100.0 * pattern.prnu_column),
    ]);
    if has_times {
        quantities.extend([("mu_I.mean", current), ("mu_I.var", current)]);
    }
    let mut notes = vec![
        "for devices of this kind: the pixels of one are a sample, as large as its frames".to_owned(),
        "mu_p.sat and what follows from it: where 0.15 % of the values are the largest (release 4.0)".to_owned(),
    ];
    if s.defects.hot > 0.0 || s.defects.dead > 0.0 {
        notes.push("hot and dead pixels are left out: the figures are those of the others".to_owned());
    }
    if dark_variance < 0.24 {
        notes.push(
            "sigma_y.dark^2 is below 0.24 DN^2: an analysis gives upper bounds for dark noise and thresholds"
                .to_owned(),
        );
    }
    Truth {
        sensor: s.name.clone(),
        wavelength_nm: light.wavelength.0,
        irradiance_w_m2: light.irradiance.0,
        pixel_pitch_um: s.pixel_pitch.micrometres(),
        vary: settings.vary,
        seed: settings.seed,
        quantities,
        notes,
    }
}

/// Dark electrons of the level with this share of the full light, where `current` are those of a second.
pub(super) fn dark_at(current: f64, settings: &DatasetSettings, share: f64) -> f64 {
    match settings.vary {
        Vary::Exposure => current * settings.exposure.0 * share,
        Vary::Irradiance => current * settings.exposure.0,
    }
}
