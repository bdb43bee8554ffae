//! From the film to a frame: radiance, electrons, grey values, a picture for display.

use crate::commands::expose::ExposeSettings;
use crate::denoising::Denoised;
use crate::exposer::{Exposer, through_lens};
use crate::noise_compensation::{CompensationInputs, Matched};
use dunkelfeld_adaptive::required_samples::DEFAULT_TARGET;
use dunkelfeld_film::{MeanImage, Plane};
use dunkelfeld_io::picture::Picture as File;
use dunkelfeld_render::film_noise::Certified;
use dunkelfeld_render::parallel::mean_image;
use dunkelfeld_render::{Error, RenderSettings, RenderedFilm, SensorChoice};
use dunkelfeld_scene::Effect;
use dunkelfeld_sensor::{Exposure, ExposureNoise, Optics, Response, SensorModel, display};
use std::sync::Arc;

/// An 8-bit picture, gamma 2.2, clipped at saturation.
#[derive(Clone, Debug, PartialEq)]
pub enum Picture {
    /// One channel, for a monochrome sensor.
    Gray(Plane<u8>),
    /// Three channels, for a colour sensor or no sensor.
    Rgb(Plane<[u8; 3]>),
}

impl Picture {
    /// The picture as the content of a file.
    pub fn as_file(&self) -> File<'_> {
        match self {
            Self::Gray(plane) => File::Gray8(plane),
            Self::Rgb(plane) => File::Rgb8(plane),
        }
    }

    /// The picture of a sensor's grey values: grey, or in the colours of its filter array.
    pub fn from_values(values: &Plane<u16>, model: &SensorModel) -> Self {
        match model.spec().quantum_efficiency.filter() {
            None => Self::Gray(display::frame_to_8bit(values, model)),
            Some(filter) => Self::Rgb(display::mosaic_to_8bit(values, model, filter)),
        }
    }
}

/// The exposure of the sensor.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct SensorFrame {
    /// Expected photo-electrons per pixel.
    pub electrons: Plane<f32>,
    /// Grey values \[DN\]; behind a colour filter array the raw mosaic.
    pub values: Plane<u16>,
    /// The exposure that was used.
    pub exposure: Exposure,
    /// The sensor.
    pub model: SensorModel,
    /// Share of pixels whose expected electrons fill the well or reach the end of the converter.
    pub saturated: f64,
    /// The response of each pixel to radiance behind the lens.
    pub response: Response,
    /// The lens.
    pub optics: Optics,
    /// The radiance behind a lens that blurs [W/(m^2 sr)].
    pub radiance: Option<Plane<[f32; 3]>>,
    /// The certificate: the ratio of the render's noise to the sensor's. `None` without a
    /// film.
    pub certified: Option<Certified>,
    /// The pixels where noise-matched exposure holds; `None` if all of the camera's noise was drawn on purpose.
    pub matched: Option<Matched>,
}

/// A developed image.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Frame {
    /// The picture for display. It is computed from the denoised mean if there is one.
    pub picture: Picture,
    /// The exposure of the sensor. `None` without a sensor.
    pub sensor: Option<SensorFrame>,
    /// Was the image so dark that no automatic exposure exists? The longest one was used then.
    pub no_light: bool,
    /// Effects that the render left out on purpose.
    pub without: Vec<Effect>,
    /// The denoised mean, if the picture shows it. All other values are computed from the unbiased mean.
    pub denoised: Option<Denoised>,
}

/// Computes the picture of a frame from a denoised mean, at the frame's exposure. With a sensor, all of the camera's
/// noise is added. The frame's grey values and its statistics do not change.
///
/// # Errors
/// As [`develop`].
pub(crate) fn show_denoised(frame: &mut Frame, denoised: Denoised, settings: &RenderSettings) -> Result<(), Error> {
    let mut settings = settings.clone();
    if let (SensorChoice::Emva { exposure, .. }, Some(sensor)) = (&mut settings.sensor, &frame.sensor) {
        *exposure = Some(sensor.exposure);
    }
    // The remaining noise is unknown. So none of the camera's noise is removed for it.
    settings.exposure_noise = ExposureNoise::Plain;
    frame.picture = develop(&denoised.mean, &settings)?.picture;
    frame.denoised = Some(denoised);
    Ok(())
}

/// Exposes a mean radiance image [W/(m^2 sr)] in front of the lens with the settings, on the threads of the current pool.
///
/// The noise is a function of (device seed = seed, seed, frame, pixel). Other frames of the same seed come from the
/// same device. A black image has no automatic exposure; then the exposure is 1 s, and a flag in the result is set.
///
/// A mean alone contains no estimate of its noise. So all of the camera's noise is drawn, and noise-matched exposure
/// ([`RenderSettings::exposure_noise`]) holds nowhere. [`develop_film`] also uses the variance of the film.
///
/// # Errors
/// An exposure outside the ranges of the sensor.
pub fn develop(mean: &Plane<[f32; 3]>, settings: &RenderSettings) -> Result<Frame, Error> {
    // The mean of a film with these settings, or its denoised mean.
    expose(MeanImage::without_moments(mean.clone(), settings.is_spread()), settings, None)
}

/// [`develop`] of a rendered film, with the noise of [`RenderSettings::exposure_noise`], and certified
/// at the level of the budget: with the ratio of its noise to that of the sensor. Pixels without samples are filled from their neighbours.
///
/// # Errors
/// As [`develop`].
pub fn develop_film(film: &RenderedFilm, settings: &RenderSettings) -> Result<Frame, Error> {
    expose(mean_image(&film.sums, film.is_spread), settings, Some(film))
}

/// [`develop_film`] behind a lens with another transmission than that of the film ([`Exposer::of_film_and_mean`]).
///
/// # Errors
/// As [`Exposer::of_film_and_mean`].
pub fn develop_behind_lens(
    film: &RenderedFilm,
    transmission: Arc<Plane<f32>>,
    settings: &RenderSettings,
) -> Result<Frame, Error> {
    let mean = mean_image(&film.sums, film.is_spread).map(|plane| through_lens(plane, &transmission));
    let Some(camera) = ExposeSettings::of_render(settings)? else { return develop(&mean.radiance, settings) };
    let exposer = Exposer::of_film_and_mean(film, &mean, Some(transmission), &camera)?;
    let mut certified = exposer.certify(film, settings.budget.noise.unwrap_or(DEFAULT_TARGET));
    if let Some(certified) = &mut certified {
        certified.certificate.share = settings.budget.hidden_share();
    }
    exposer.into_frame(settings.noise_frame(), certified, &settings.run.without)
}

fn expose(mean: MeanImage, settings: &RenderSettings, film: Option<&RenderedFilm>) -> Result<Frame, Error> {
    let Some(camera) = ExposeSettings::of_render(settings)? else {
        let picture = Picture::Rgb(display::linear_to_8bit(&mean.radiance));
        return Ok(Frame {
            picture,
            sensor: None,
            no_light: false,
            without: settings.run.without.clone(),
            denoised: None,
        });
    };
    let mut exposer = Exposer::new(mean, &camera, (&camera.model, &camera.optics, camera.readout))?;
    let is_matched = settings.exposure_noise == ExposureNoise::Matched;
    let mut certified = None;
    if let Some(film) = film {
        let k = settings.budget.noise.unwrap_or(DEFAULT_TARGET);
        let noise = exposer.noise(film);
        certified = if is_matched {
            // Once for both.
            let variances = noise.pixel_variances();
            exposer = exposer.with_inputs(CompensationInputs::from_variances(&variances))?;
            noise.certify_by(&variances.map(|pixel| (pixel.noise, pixel.moments)).into(), k)
        } else {
            noise.certify(k)
        };
    } else if is_matched {
        let unknown = Plane::new(exposer.size()[0], exposer.size()[1], f32::INFINITY);
        let is_rare = unknown.map(|_| false);
        exposer = exposer.with_inputs(CompensationInputs::new(unknown, is_rare))?;
    }
    if let Some(certified) = &mut certified {
        certified.certificate.share = settings.budget.hidden_share();
    }
    exposer.into_frame(settings.noise_frame(), certified, &settings.run.without)
}
