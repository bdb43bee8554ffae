//! The expected result of an analysis of a simulated data set: the figures that follow from the model.

use super::plan::{DatasetSettings, Vary};
use dunkelfeld::radiometry::{Irradiance, Nanometres, Seconds};
use dunkelfeld::sensor::SensorModel;
use serde::Serialize;
use std::collections::BTreeMap;

/// Standard deviations that 0.15 % of normal numbers exceed: the middle of what release 4.0 allows at saturation.
const QUANTILE: f64 = 2.967_738;
/// Standard deviations above the end of the scale where all pixels are at it.
const FULL: f64 = 5.0;
/// Maximum number of doublings from the full well to a light that fills it in all pixels. Pixels whose responses differ
/// by a fifth are never all full.
const MAX_DOUBLINGS: u32 = 10;
/// Number of steps of the bisection: the result is accurate to the last bit.
const HALVINGS: u32 = 80;

/// The light of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Light {
    pub(super) wavelength: Nanometres,
    /// Quantum efficiency there.
    pub(super) efficiency: f64,
    /// The irradiance, or the largest irradiance.
    pub(super) irradiance: Irradiance,
}

/// The true figures of a data set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Truth {
    /// The sensor.
    pub sensor: String,
    /// Wavelength of the light \[nm\].
    pub wavelength_nm: f64,
    /// The irradiance of all levels, or the largest \[W/m^2\].
    pub irradiance_w_m2: f64,
    /// Pixel pitch \[um\].
    pub pixel_pitch_um: f64,
    /// The varied quantity.
    pub vary: Vary,
    /// Seed of device and noise.
    pub seed: u64,
    /// The figures by their symbols, for devices of this kind and release 4.0.
    pub quantities: BTreeMap<&'static str, f64>,
    /// Notes on missing figures.
    pub notes: Vec<String>,
}

/// The end of the scale, from which on more electrons do not change the grey value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Edge {
    /// Number of electrons, with dark ones, from which on the grey value is the largest.
    end: f64,
    read: f64,
    dsnu: f64,
    prnu: f64,
}

impl Edge {
    pub(super) fn of(model: &SensorModel) -> Self {
        let s = model.spec();
        // Grey values are rounded: the largest begins half a step below, if the well is not full before.
        let full = s.offset.0 + s.system_gain * s.full_well.0;
        let largest = (full + 0.5).floor().min(f64::from(model.max_value()));
        let end = (largest - 0.5 - s.offset.0) / s.system_gain;
        Self { end, read: s.dark_noise.0, dsnu: s.fixed_pattern.dsnu.0, prnu: s.fixed_pattern.prnu }
    }

    /// Photo-electrons at saturation, where 0.15 % of the values are the largest. `dark` computes the dark electrons
    /// that belong to them. `None` if the dark electrons alone saturate the pixels.
    pub(super) fn saturation(&self, dark: impl Fn(f64) -> f64) -> Option<f64> {
        self.photo_electrons(QUANTILE, dark)
    }

    /// Photo-electrons at which practically all values are the largest. `None` if the dark electrons alone cause this,
    /// or if the responses of the pixels differ so much that no light does.
    pub(super) fn full(&self, dark: impl Fn(f64) -> f64) -> Option<f64> {
        self.photo_electrons(-FULL, dark)
    }

    /// Is this number of dark electrons so small that dark frames, as required, have no value at the end of the scale?
    pub(super) fn has_room_for(&self, dark: f64) -> bool {
        self.room(QUANTILE, 0.0, dark) > 0.0
    }

    /// Photo-electrons whose mean is `quantile` standard deviations of all pixels below the end; above it for negative
    /// ones.
    fn photo_electrons(&self, quantile: f64, dark: impl Fn(f64) -> f64) -> Option<f64> {
        let room = |photo: f64| self.room(quantile, photo, dark(photo));
        let (mut low, mut high) = (0.0, self.end.max(1.0));
        if room(low).is_nan() || room(low) <= 0.0 {
            return None;
        }
        for _ in 0..MAX_DOUBLINGS {
            if room(high) < 0.0 {
                break;
            }
            (low, high) = (high, 2.0 * high);
        }
        if room(high) >= 0.0 {
            return None;
        }
        // Bisection always converges, for any share of dark electrons that the light brings.
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if room(middle) > 0.0 { low = middle } else { high = middle }
        }
        Some(0.5 * (low + high))
    }

    /// Electrons between the end and the mean of all pixels, beyond so many standard deviations.
    fn room(&self, quantile: f64, photo: f64, dark: f64) -> f64 {
        // Poisson numbers whose means differ from pixel to pixel.
        let pattern = (self.prnu * photo).powi(2);
        let variance = photo + dark + self.read * self.read + self.dsnu * self.dsnu + pattern;
        // Cornish and Fisher (1938), first term: the upper tail of counts is longer. The skewness is the third moment over the
        // variance to the power of 3/2; times the standard deviation it is this.
        let skew = if variance > 0.0 { (photo + dark + 3.0 * pattern) / variance } else { 0.0 };
        let reach = quantile * variance.sqrt() + (quantile * quantile - 1.0) * skew / 6.0;
        self.end - photo - dark - reach
    }
}

/// The figures of the model, by the definitions of EMVA 1288 release 4.0 Linear. `saturation` is in photo-electrons.
pub(super) fn truth(model: &SensorModel, light: &Light, settings: &DatasetSettings, saturation: f64) -> Truth {
    let s = model.spec();
    let (gain, efficiency) = (s.system_gain, light.efficiency);
    let current = model.dark_electrons(Seconds(1.0)).0;
    let has_times = settings.vary == Vary::Exposure;
    // With several exposure times, the dark noise is that at time zero.
    let dark = if has_times { 0.0 } else { current * settings.exposure.0 };
    let dark_noise2 = s.dark_noise.0.powi(2) + dark;
    let dark_variance = gain * gain * dark_noise2 + 1.0 / 12.0;
    let least = (dark_variance / (gain * gain) + 0.25).sqrt() + 0.5;
    let pattern = &s.fixed_pattern;
    let range = saturation / least;
    let mut quantities = BTreeMap::from([
        ("eta", efficiency),
        ("K", gain),
        ("R", gain * efficiency),
        ("sigma_d", dark_noise2.sqrt()),
        ("sigma_d.row", s.row_noise.0),
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
            "sigma_y.dark^2 is below 0.24 DN^2, where rounding rules: an analysis gives bounds for dark noise, thresholds and DR, and K, \
             eta and mu_e.sat come out wrong by what rounding hides"
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

#[cfg(test)]
mod tests {
    use super::*;

    const EDGE: Edge = Edge { end: 2000.0, read: 2.0, dsnu: 1.0, prnu: 0.005 };

    /// The result is the required number of standard deviations below the end, also if nine tenths of all electrons are
    /// dark.
    #[test]
    fn saturation_is_found_however_dark_the_light_is() {
        for share in [0.0, 0.5, 1.0, 1.5, 9.0] {
            let photo = EDGE.saturation(|photo| share * photo).expect("a saturation");
            let all = photo * (1.0 + share);
            let variance = all + 5.0 + (0.005 * photo).powi(2);
            let z = (2000.0 - all) / variance.sqrt();
            // The term of Cornish and Fisher changes it by less than 0.04.
            assert!((z - QUANTILE).abs() < 0.04, "{share}: {photo}, {z}");
        }
        let full = EDGE.full(|_| 1500.0).expect("a light");
        assert!(full > 500.0 && full < 1000.0, "{full}");
    }

    #[test]
    fn a_well_that_fills_in_the_dark_has_no_saturation() {
        assert!(EDGE.saturation(|_| 2000.0).is_none() && EDGE.full(|_| 3000.0).is_none());
        assert!(EDGE.has_room_for(1800.0) && !EDGE.has_room_for(1900.0));
        assert!(Edge { prnu: 0.3, ..EDGE }.full(|_| 0.0).is_none());
    }
}
