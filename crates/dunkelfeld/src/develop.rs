//! From the film to a frame: radiance, electrons, grey values, a picture to look at.

use crate::error::Error;
use crate::noise::Certified;
use crate::settings::{RenderSettings, SensorChoice};
use dunkelfeld_film::Plane;
use dunkelfeld_scene::Effect;
use dunkelfeld_sensor::{Device, Exposure, FrameKey, Response, SensorError, SensorModel, auto_exposure, display};
use rayon::prelude::*;

/// An 8-bit picture, gamma 2.2, clipped at saturation.
#[derive(Clone, Debug, PartialEq)]
pub enum Picture {
    /// One channel, as a monochrome sensor sees.
    Gray(Plane<u8>),
    /// Three channels.
    Rgb(Plane<[u8; 3]>),
}

/// What the sensor recorded.
#[derive(Clone, Debug)]
pub struct SensorFrame {
    /// Expected photo-electrons per pixel.
    pub electrons: Plane<f32>,
    /// Grey values \[DN\].
    pub values: Plane<u16>,
    /// The exposure that was used.
    pub exposure: Exposure,
    /// The sensor.
    pub model: SensorModel,
    /// Share of pixels at the largest grey value.
    pub saturated: f64,
    /// Electrons per radiance and channel [e- m^2 sr/W].
    pub weights: [f64; 3],
    /// How well the render's noise is hidden; `None` until [`crate::certify`] has looked at the film.
    pub certified: Option<Certified>,
}

/// A developed image.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The picture to look at.
    pub picture: Picture,
    /// What the sensor recorded; `None` without a sensor.
    pub sensor: Option<SensorFrame>,
    /// Was the image so dark that no automatic exposure exists? The longest one was used then.
    pub no_light: bool,
    /// Effects that the render left out on purpose.
    pub without: Vec<Effect>,
}

/// Exposes a mean radiance image [W/(m^2 sr)] as the settings say, on the threads of the current pool.
///
/// The noise is a function of (device seed = seed, seed, frame, pixel): other frames of the same seed come from the same
/// device. Automatic exposure of a black image, which has none, takes 1 s and says so.
///
/// # Errors
/// A sensor whose ranges the exposure leaves.
pub fn develop(mean: &Plane<[f32; 3]>, settings: &RenderSettings) -> Result<Frame, Error> {
    let SensorChoice::Emva { model, optics, exposure } = &settings.sensor else {
        let picture = Picture::Rgb(display::linear_to_8bit(mean));
        return Ok(Frame { picture, sensor: None, no_light: false, without: settings.without.clone() });
    };
    let mut no_light = false;
    let exposure = match exposure {
        Some(exposure) => *exposure,
        None => match auto_exposure(mean, model, optics) {
            Ok(exposure) => exposure,
            Err(SensorError::NoLight) => {
                no_light = true;
                Exposure::new(dunkelfeld_radiometry::Seconds(1.0))?
            }
            Err(e) => return Err(e.into()),
        },
    };
    let response = Response::new(model, optics, exposure);
    let electrons = dunkelfeld_sensor::electrons(mean, &response).plane;
    let (width, height) = (mean.width(), mean.height());
    let device = Device::new((**model).clone(), settings.seed, width, height);
    let key = FrameKey { seed: settings.seed, frame: settings.frame };
    let mut values = Plane::new(width, height, 0u16);
    values
        .data_mut()
        .par_chunks_mut(width as usize)
        .enumerate()
        .try_for_each(|(y, row)| device.expose_rows(&electrons, exposure, key, y as u32..y as u32 + 1, row))?;
    let top = model.max_value();
    let saturated = values.data().iter().filter(|&&v| v >= top).count() as f64 / values.data().len().max(1) as f64;
    let picture = Picture::Gray(display::frame_to_8bit(&values, model));
    let (model, weights) = ((**model).clone(), response.weights());
    let sensor = SensorFrame { electrons, values, exposure, model, saturated, weights, certified: None };
    Ok(Frame { picture, sensor: Some(sensor), no_light, without: settings.without.clone() })
}
