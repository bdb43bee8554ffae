//! The figures of merit that a sensor model implies.

use dunkelfeld_radiometry::{Electrons, Nanometres};

use crate::efficiency::FilterColor;
use crate::model::{Published, SensorModel};

/// Figures of merit of EMVA 1288 (release 4.0, Linear), computed from the model, for short exposures.
#[derive(Clone, Debug, PartialEq)]
pub struct DataSheet {
    /// Wavelength of the figures in photons: where the quantum efficiency is highest; of a colour sensor, that of its best
    /// colour.
    pub wavelength: Nanometres,
    /// Quantum efficiency there.
    pub quantum_efficiency: f64,
    /// The figures in photons of each colour; one entry for a monochrome sensor.
    pub channels: Vec<ChannelSheet>,
    /// Overall system gain K \[DN/e-\].
    pub system_gain: f64,
    /// Temporal dark noise sigma_d.
    pub dark_noise: Electrons,
    /// What of it the pixels of a row share.
    pub row_noise: Electrons,
    /// Rounding noise sigma_q / K.
    pub quantisation_noise: Electrons,
    /// Absolute sensitivity threshold mu_e.min, where the signal equals the noise (equation 27).
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
    /// What was published, for comparison.
    pub published: Published,
}

/// The figures that depend on the wavelength, where the quantum efficiency of one colour is highest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelSheet {
    /// The colour; `None` without a filter.
    pub color: Option<FilterColor>,
    /// Where the quantum efficiency is highest.
    pub wavelength: Nanometres,
    /// Quantum efficiency there.
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
    use crate::model::tests::example;

    /// At the threshold the signal-to-noise ratio of equation (21) is 1: that is its definition.
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
