//! The settings of a scene file that is opened without a job.

use dunkelfeld_io::job::{DEFAULT_SENSOR, LensSettings};
use dunkelfeld_io::sensor_file::preset;
use dunkelfeld_render::{DEFAULT_F_NUMBER, RenderSettings, SensorChoice};
use dunkelfeld_sensor::Optics;

/// 512 x 512 pixels, [`DEFAULT_SPP`](crate::limits::DEFAULT_SPP) samples, the sensor [`DEFAULT_SENSOR`] behind a lens with
/// f/4 and transmission 0.9, far from the object, with automatic exposure.
pub fn default_settings() -> RenderSettings {
    let sensor = match (preset(DEFAULT_SENSOR), default_optics()) {
        (Ok(model), Ok(optics)) => SensorChoice::Emva { model: Box::new(model), optics, exposure: None },
        // A test excludes it.
        _ => SensorChoice::None,
    };
    RenderSettings::without_sensor().with_sensor(sensor)
}

/// The lens of [`default_settings`].
pub(crate) fn default_optics() -> Result<Optics, dunkelfeld_sensor::SensorError> {
    Optics::new(DEFAULT_F_NUMBER, LensSettings::default().transmission, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_has_the_default_sensor() {
        let SensorChoice::Emva { model, exposure, .. } = default_settings().sensor else { panic!("no sensor") };
        assert!(model.spec().name.contains("IMX250"), "{}", model.spec().name);
        assert_eq!(exposure, None);
        assert!(!RenderSettings::without_sensor().has_sensor());
    }
}
