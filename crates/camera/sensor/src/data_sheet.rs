//! The figures of merit of a sensor model.

use dunkelfeld_radiometry::{Electrons, Nanometres};

use crate::efficiency::FilterColor;
use crate::model::{Published, SensorModel};

/// Figures of merit of EMVA 1288 (release 4.0, Linear), computed from the model, for short exposures.
#[derive(Clone, Debug, PartialEq)]
pub struct DataSheet {
    /// Wavelength of the figures in photons: that of the highest quantum efficiency. For a colour sensor, that of its
    /// most sensitive colour.
    pub wavelength: Nanometres,
    /// Quantum efficiency at this wavelength.
    pub quantum_efficiency: f64,
    /// The figures in photons of each colour. One entry for a monochrome sensor.
    pub channels: Vec<ChannelSheet>,
    /// Overall system gain K \[DN/e-\].
    pub system_gain: f64,
    /// Temporal dark noise sigma_d.
    pub dark_noise: Electrons,
    /// The part of it that the pixels of a row share.
    pub row_noise: Electrons,
    /// Rounding noise sigma_q / K.
    pub quantisation_noise: Electrons,
    /// Absolute sensitivity threshold mu_e.min, at which the signal equals the noise (equation 27).
    pub threshold: Electrons,
    /// The same in photons, mu_p.min.
    pub threshold_photons: f64,
    /// Saturation capacity mu_e.sat.
    pub saturation: Electrons,
    /// The same in photons, mu_p.sat.
    pub saturation_photons: f64,
    /// Dynamic range mu_p.sat / mu_p.min \[dB\].
    pub dynamic_range_db: f64,
    /// Largest signal-to-noise ratio, sqrt(mu_e.sat) \[dB\].
    pub snr_max_db: f64,
    /// Dark signal non-uniformity, DSNU1288.
    pub dsnu: Electrons,
    /// Its parts of rows, columns and pixels.
    pub dsnu_parts: [Electrons; 3],
    /// Photo response non-uniformity, PRNU1288 \[%\].
    pub prnu_percent: f64,
    /// Its parts of rows, columns and pixels \[%\].
    pub prnu_parts_percent: [f64; 3],
    /// The published figures, for comparison.
    pub published: Published,
}

/// One figure of a data sheet beside the published one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figure {
    /// Its name for files, with the unit, as in a sensor file.
    pub key: &'static str,
    /// Its name, in words.
    pub name: &'static str,
    /// Its symbol in EMVA 1288, in ASCII.
    pub symbol: &'static str,
    /// Its unit, in ASCII.
    pub unit: &'static str,
    /// The value of the model.
    pub implied: f64,
    /// The published value.
    pub published: Option<f64>,
}

impl DataSheet {
    /// All figures in the usual order of data sheets.
    pub fn figures(&self) -> Vec<Figure> {
        let published = self.published.figures();
        let [dsnu_row, dsnu_column, dsnu_pixel] = self.dsnu_parts.map(|e| e.0);
        let [prnu_row, prnu_column, prnu_pixel] = self.prnu_parts_percent;
        let figure = |(key, name, symbol, unit, implied)| Figure {
            key,
            name,
            symbol,
            unit,
            implied,
            published: published.iter().find(|(k, _)| *k == key).and_then(|(_, figure)| *figure),
        };
        [
            ("quantum_efficiency_percent", "quantum efficiency", "eta", "%", 100.0 * self.quantum_efficiency),
            ("gain_dn_per_e", "system gain", "K", "DN/e-", self.system_gain),
            ("gain_e_per_dn", "its inverse", "1/K", "e-/DN", 1.0 / self.system_gain),
            ("dark_noise_e", "temporal dark noise", "sigma_d", "e-", self.dark_noise.0),
            ("row_noise_e", "row noise in it", "", "e-", self.row_noise.0),
            ("quantisation_noise_e", "rounding noise", "sigma_q/K", "e-", self.quantisation_noise.0),
            ("threshold_e", "sensitivity threshold", "mu_e.min", "e-", self.threshold.0),
            ("threshold_p", "the same in photons", "mu_p.min", "p", self.threshold_photons),
            ("saturation_e", "saturation capacity", "mu_e.sat", "e-", self.saturation.0),
            ("saturation_p", "the same in photons", "mu_p.sat", "p", self.saturation_photons),
            ("dynamic_range_db", "dynamic range", "DR", "dB", self.dynamic_range_db),
            ("snr_max_db", "largest SNR", "SNR_max", "dB", self.snr_max_db),
            ("dsnu_e", "dark non-uniformity", "DSNU", "e-", self.dsnu.0),
            ("dsnu_row_e", "of rows", "DSNU.row", "e-", dsnu_row),
            ("dsnu_column_e", "of columns", "DSNU.col", "e-", dsnu_column),
            ("dsnu_pixel_e", "of pixels", "DSNU.pixel", "e-", dsnu_pixel),
            ("prnu_percent", "response non-uniformity", "PRNU", "%", self.prnu_percent),
            ("prnu_row_percent", "of rows", "PRNU.row", "%", prnu_row),
            ("prnu_column_percent", "of columns", "PRNU.col", "%", prnu_column),
            ("prnu_pixel_percent", "of pixels", "PRNU.pixel", "%", prnu_pixel),
        ]
        .map(figure)
        .to_vec()
    }
}

/// The figures that depend on the wavelength, at the highest quantum efficiency of one colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelSheet {
    /// The colour. `None` without a filter.
    pub color: Option<FilterColor>,
    /// Wavelength of the highest quantum efficiency.
    pub wavelength: Nanometres,
    /// Quantum efficiency at this wavelength.
    pub quantum_efficiency: f64,
    /// Absolute sensitivity threshold mu_p.min \[photons\].
    pub threshold_photons: f64,
    /// Saturation capacity mu_p.sat \[photons\].
    pub saturation_photons: f64,
}

/// The data sheet of a sensor.
pub fn data_sheet(model: &SensorModel) -> DataSheet {
    let spec = model.spec();
    let dark = spec.dark_noise.0;
    let quantisation = model.quantisation_variance();
    let threshold = (dark * dark + quantisation + 0.25).sqrt() + 0.5;
    let saturation = model.saturation().0;
    let is_mosaic = spec.quantum_efficiency.filter().is_some();
    let channels: Vec<ChannelSheet> = spec
        .quantum_efficiency
        .curves()
        .iter()
        .zip(FilterColor::ALL)
        .map(|(curve, color)| {
            let (wavelength, efficiency) = curve.peak();
            ChannelSheet {
                color: is_mosaic.then_some(color),
                wavelength,
                quantum_efficiency: efficiency,
                threshold_photons: threshold / efficiency,
                saturation_photons: saturation / efficiency,
            }
        })
        .collect();
    let best = channels.iter().map(|c| (c.wavelength, c.quantum_efficiency));
    let (wavelength, efficiency) = best.fold((Nanometres(0.0), 0.0), |a, b| if b.1 > a.1 { b } else { a });
    let p = &spec.fixed_pattern;
    DataSheet {
        channels,
        row_noise: spec.row_noise,
        dsnu_parts: [p.dsnu_row, p.dsnu_column, p.dsnu_pixel()],
        prnu_parts_percent: [p.prnu_row, p.prnu_column, p.prnu_pixel()].map(|v| 100.0 * v),
        wavelength,
        quantum_efficiency: efficiency,
        system_gain: spec.system_gain,
        dark_noise: spec.dark_noise,
        quantisation_noise: Electrons(quantisation.sqrt()),
        threshold: Electrons(threshold),
        threshold_photons: threshold / efficiency,
        saturation: Electrons(saturation),
        saturation_photons: saturation / efficiency,
        dynamic_range_db: 20.0 * (saturation / threshold).log10(),
        snr_max_db: 10.0 * saturation.log10(),
        dsnu: spec.fixed_pattern.dsnu,
        prnu_percent: 100.0 * spec.fixed_pattern.prnu,
        published: spec.published,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SensorSpec;
    use crate::model::tests::example;

    #[test]
    fn every_published_figure_is_listed_with_that_of_the_model() {
        let published = Published {
            quantum_efficiency_percent: Some(1.0),
            dark_noise_e: Some(2.0),
            gain_e_per_dn: Some(3.0),
            threshold_e: Some(4.0),
            threshold_p: Some(5.0),
            saturation_e: Some(6.0),
            saturation_p: Some(7.0),
            dynamic_range_db: Some(8.0),
            snr_max_db: Some(9.0),
            dsnu_e: Some(10.0),
            prnu_percent: Some(11.0),
        };
        let numbers = published.figures().map(|(_, figure)| figure);
        let spec = SensorSpec { published, ..example() };
        let figures = data_sheet(&SensorModel::new(spec).expect("valid")).figures();
        let mut shown: Vec<f64> = figures.iter().filter_map(|f| f.published).collect();
        shown.sort_by(f64::total_cmp);
        assert_eq!(shown, numbers.map(Option::unwrap_or_default), "each once");
    }

    /// At the threshold the signal-to-noise ratio of equation (21) is 1, by definition.
    #[test]
    fn at_the_threshold_signal_and_noise_are_equal() {
        let model = SensorModel::new(example()).expect("valid");
        let sheet = data_sheet(&model);
        let e = sheet.threshold.0;
        let noise = (e + 16.0 + 16.0 / 12.0f64).sqrt();
        assert!((e / noise - 1.0).abs() < 1e-12, "{e} electrons, noise {noise}");
        assert!((sheet.threshold_photons * 0.65 - e).abs() < 1e-12);
    }
}
