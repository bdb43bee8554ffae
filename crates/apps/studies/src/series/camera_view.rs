//! The camera view of renders: one exposure for all.

use super::statistics::quantile;
use dunkelfeld::adaptive::sobel::{gamma_image, magnitude};
use dunkelfeld::denoising::{Denoiser, denoise_film};
use dunkelfeld::film::{Film, FilmNoise, LensImage, MeanImage, Plane, SignalModel};
use dunkelfeld::radiometry::{Electrons, Rgb};
use dunkelfeld::sensor::{
    Device, Exposure, FrameKey, ImageExposure, Optics, Response, SensorError, SensorModel, display,
};
use dunkelfeld::{Error, RenderSettings, RenderedFilm, SensorChoice, Session, Silent};

/// The camera with its exposure; without one, luminance with white at 1 W/(m^2 sr).
#[derive(Clone, Debug)]
pub(crate) struct View {
    camera: Option<(SensorModel, Optics, Exposure)>,
}

impl View {
    /// The exposure of the settings, or the automatic one of the radiance of the reference behind the lens; one second if that
    /// is black.
    pub(crate) fn new(sensor: &SensorChoice, reference: &Plane<[f32; 3]>) -> Result<Self, SensorError> {
        let SensorChoice::Emva { model, optics, exposure } = sensor else { return Ok(Self { camera: None }) };
        let ImageExposure { exposure, .. } = ImageExposure::new(*exposure, reference, model, optics)?;
        Ok(Self { camera: Some(((**model).clone(), optics.clone(), exposure)) })
    }

    pub(crate) fn has_sensor(&self) -> bool {
        self.camera.is_some()
    }

    pub(crate) fn model(&self) -> Option<&SensorModel> {
        self.camera.as_ref().map(|c| &c.0)
    }

    pub(crate) fn exposure(&self) -> Option<Exposure> {
        self.camera.as_ref().map(|c| c.2)
    }

    /// The linear signal of radiance behind the lens: expected photo-electrons, or luminance [W/(m^2 sr)]. With a colour
    /// filter array, all pixels have the mean response of its colours, because noise and gradient must not depend on the mosaic.
    pub(crate) fn signal(&self, mean: &Plane<[f32; 3]>) -> Plane<f32> {
        match &self.camera {
            Some((model, optics, exposure)) => {
                let response = Response::new(model, optics, *exposure);
                if response.kinds().len() == 1 {
                    return dunkelfeld::sensor::electrons(mean, &response).plane;
                }
                let average = response.average();
                let valid = |v: f32| if v > 0.0 { v.min(f32::MAX) } else { 0.0 };
                mean.map(|pixel| (average.electrons(pixel.map(valid)).0 as f32).min(f32::MAX))
            }
            None => mean.map(|&[r, g, b]| Rgb::new(r, g, b).luminance()),
        }
    }

    /// The signal of a film after a denoiser, and the seconds that the denoiser took; `None` if it was cancelled.
    ///
    /// # Errors
    /// Those of the denoiser, as a setting that cannot be used.
    pub(crate) fn denoised(
        &self,
        film: &Film,
        denoiser: &dyn Denoiser,
        settings: &RenderSettings,
        session: &Session<'_>,
    ) -> Result<Option<(Plane<f32>, f64)>, Error> {
        session.install(|| match denoise_film(film, denoiser, &session.clone().with_progress(&Silent)) {
            Ok(done) => {
                let mean = MeanImage::without_moments(done.mean, settings.is_spread());
                Ok(Some((self.signal(&LensImage::new(mean, &settings.sensor).radiance), done.seconds)))
            }
            Err(_) if session.is_cancelled() => Ok(None),
            Err(e) => {
                let help = "choose another denoiser with --denoise; the renders that are finished are kept";
                Err(Error::setting("denoise", format!("{}: {e}", denoiser.name()), help))
            }
        })
    }

    /// The variance of the signal that a render estimates from its own samples, as its certificate uses it.
    pub(crate) fn signal_variance(&self, film: &RenderedFilm, image: &LensImage) -> Result<Plane<f64>, Error> {
        let noise = match &self.camera {
            Some((model, optics, exposure)) => {
                let average = Response::new(model, optics, *exposure).average();
                FilmNoise::exposed(Response::constant(average), model, *exposure, film)
            }
            None => FilmNoise::new(&SignalModel::new(&image.radiance, &SensorChoice::None)?, film),
        };
        Ok(noise.behind(image).variances_of_mean().map(|&v| f64::from(v)))
    }

    /// The signal at which the picture is white.
    pub(crate) fn white(&self) -> f64 {
        self.camera.as_ref().map_or(1.0, |(model, ..)| model.saturation().0)
    }

    /// The sensor's own variance per pixel, s = mu_e + sigma_d^2 + sigma_q^2 / K^2 \[e-^2\].
    pub(crate) fn sensor_variance(&self, signal: &Plane<f32>) -> Option<Plane<f64>> {
        let (model, _, exposure) = self.camera.as_ref()?;
        Some(signal.map(|&e| model.temporal_variance(Electrons(f64::from(e)), exposure.time())))
    }

    /// Grey values per electron, K \[DN/e-\].
    pub(crate) fn gain(&self) -> Option<f64> {
        self.model().map(|m| m.spec().system_gain)
    }

    /// The 8-bit picture of the expected values, without the sensor's noise, as in the paper.
    pub(crate) fn picture(&self, signal: &Plane<f32>) -> Plane<u8> {
        gamma_image(signal, self.white() as f32)
    }

    /// The 8-bit picture of the camera, with noise; `None` without a sensor.
    pub(crate) fn exposed(&self, signal: &Plane<f32>, seed: u64) -> Option<Plane<u8>> {
        let (model, _, exposure) = self.camera.as_ref()?;
        let device = Device::new(model.clone(), seed, signal.width(), signal.height()).ok()?;
        let frame = device.expose(signal, *exposure, FrameKey { seed, frame: 0 }).ok()?;
        Some(display::frame_to_8bit(&frame, model))
    }

    /// Gradient of the picture [DN per pixel].
    pub(crate) fn sobel(&self, signal: &Plane<f32>) -> Plane<f32> {
        magnitude(&self.picture(signal))
    }

    /// The mask of the unsaturated pixels of the reference.
    pub(crate) fn unsaturated(&self, reference: &Plane<f32>) -> Vec<bool> {
        let white = self.white();
        reference.data().iter().map(|&e| f64::from(e) < white).collect()
    }
}

/// The exposure as text, with the level of the reference's brightest pixels.
pub(crate) fn exposure_words(view: &View, reference: &Plane<f32>) -> String {
    let top = quantile(reference.data().iter().map(|&v| f64::from(v)).collect(), 0.995) / view.white();
    match (view.model(), view.exposure()) {
        (Some(model), Some(exposure)) => {
            let time = match exposure.time().0 {
                s if s < 1e-3 => format!("{:.3} \u{b5}s", s * 1e6),
                s if s < 1.0 => format!("{:.3} ms", s * 1e3),
                s => format!("{s:.3} s"),
            };
            format!("{}, {time}, 99.5 % quantile at {:.0} % of saturation", model.spec().name, 100.0 * top)
        }
        _ => "no sensor: radiance 1 W/(m\u{b2} sr) is white".into(),
    }
}
