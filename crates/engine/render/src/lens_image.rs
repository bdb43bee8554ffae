//! The image of a film behind the lens of a sensor.

use crate::settings::SensorChoice;
use dunkelfeld_film::{MeanImage, Plane};
use dunkelfeld_sensor::{LensBlur, Optics, SensorModel};
use std::sync::Arc;

/// The radiance that the pixels of a sensor see, and the blur of the lens in front of them.
#[derive(Clone, Debug)]
pub struct LensImage {
    /// Mean radiance [W/(m^2 sr)] behind the lens.
    pub radiance: Plane<[f32; 3]>,
    /// The blur; `None` for a lens that does not blur.
    pub blur: Option<Arc<LensBlur>>,
}

impl LensImage {
    /// The image behind the lens of a sensor. Without a sensor it is that of the film. Runs on the threads of the current pool.
    pub fn new(image: MeanImage, sensor: &SensorChoice) -> Self {
        match sensor {
            SensorChoice::Emva { model, optics, .. } => Self::behind(image, model, optics),
            SensorChoice::None => Self { radiance: image.radiance, blur: None },
        }
    }

    /// The image behind a lens with a sensor.
    pub fn behind(image: MeanImage, model: &SensorModel, optics: &Optics) -> Self {
        match LensBlur::new(optics, model.spec().pixel_pitch, &image) {
            None => Self { radiance: image.radiance, blur: None },
            Some(blur) => Self { radiance: blur.image(&image), blur: Some(Arc::new(blur)) },
        }
    }
}
