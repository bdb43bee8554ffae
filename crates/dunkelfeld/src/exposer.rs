//! An image and a camera: exposes a film or an EXR again and again, without a render.

use crate::black_image::black_share;
use crate::commands::expose::{ExposeSettings, check};
use crate::exr_image::ExrImage;
use crate::frame::{Frame, Picture, SensorFrame};
use crate::image_noise::ImageNoise;
use crate::noise_compensation::{CompensationInputs, Matched};
use dunkelfeld_film::{MeanImage, Plane};
use dunkelfeld_render::film_noise::{Certified, FilmNoise, certify_variances, sensor_noise};
use dunkelfeld_render::lens_image::LensImage;
use dunkelfeld_render::parallel::mean_image;
use dunkelfeld_render::{Error, RenderedFilm};
use dunkelfeld_scene::Effect;
use dunkelfeld_sensor::{
    Device, Exposure, ExposureNoise, FrameKey, ImageExposure, MeanElectrons, Optics, Readout, Response, SensorModel,
    electrons,
};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// An image and a camera. It computes frames.
#[derive(Clone, Debug)]
pub struct Exposer {
    device: Device,
    response: Response,
    exposure: Exposure,
    seed: u64,
    electrons: Plane<f32>,
    /// The lens, and the image behind it if it blurs.
    optics: Optics,
    behind: Option<Arc<LensImage>>,
    /// The transmission of another lens than that of the film. `None` if they have the same.
    transmission: Option<Arc<Plane<f32>>>,
    /// The noise of the electrons, as far as the file contains it. `None` if all of the camera's noise is drawn.
    known: Option<CompensationInputs>,
    no_light: bool,
    invalid: u64,
    invalid_variances: u64,
}

impl Exposer {
    /// Combines a rendered film with a camera: one whose model describes the pixels of the film
    /// ([`ExposeSettings::of_render`]). Pixels without samples are filled from their neighbours. Runs on the threads of
    /// the current pool.
    ///
    /// # Errors
    /// Settings outside their range, or outside the ranges of the sensor.
    pub fn of_film(film: &RenderedFilm, settings: &ExposeSettings) -> Result<Self, Error> {
        Self::of_film_and_mean(film, &mean_image(&film.sums, film.is_spread), None, settings)
    }

    /// [`Self::of_film`], given the mean of the film, or its denoised mean.
    ///
    /// Behind a lens with another transmission than that of the film, `transmission` is the ratio of both in each pixel, above
    /// zero. `mean` is then the mean times the transmission ([`through_lens`]). The variances get its square.
    ///
    /// # Errors
    /// As [`Self::of_film`], a mean of another size, and a transmission of another size or out of range.
    pub fn of_film_and_mean(
        film: &RenderedFilm,
        mean: &MeanImage,
        transmission: Option<Arc<Plane<f32>>>,
        settings: &ExposeSettings,
    ) -> Result<Self, Error> {
        check(settings)?;
        let size = mean.size();
        if let Some(transmission) = &transmission
            && ([transmission.width(), transmission.height()] != size
                || !transmission.data().iter().all(|t| t.is_finite() && *t > 0.0))
        {
            let problem = "is not above zero in each pixel of the film";
            return Err(Error::setting("transmission", problem, "pass a plane of the size of the film"));
        }
        if [film.sums.width(), film.sums.height()] != size {
            let problem = format!("it has {size:?} pixels, and the film has another number");
            return Err(Error::setting("mean", problem, "pass the mean of the film"));
        }
        if settings.vignetting.is_some() {
            let problem = "the lens of a render darkens its corners during the render";
            return Err(Error::setting("vignetting", problem, "set it in the lens of the render"));
        }
        let camera = (&settings.model, &settings.optics, settings.readout);
        let exposer = Self { transmission, ..Self::new(mean.clone(), settings, camera)? };
        if settings.exposure_noise == ExposureNoise::Plain {
            return Ok(exposer);
        }
        let noise = exposer.image_noise(film);
        exposer.with_inputs(noise.inputs)
    }

    /// Analyses the noise of a film for matched exposure with this camera: see [`Self::with_noise`]. Runs on the threads of the
    /// current pool.
    pub fn image_noise(&self, film: &RenderedFilm) -> ImageNoise {
        let noise = FilmNoise::exposed(self.response, self.model(), self.exposure, film);
        let inputs = CompensationInputs::from_variances(&noise.pixel_variances());
        ImageNoise { response: self.response, counts: Some(noise.counts), inputs }
    }

    /// Matched exposure of this image, whose film has these numbers of samples per pixel, with noise that was analysed before:
    /// for this film and this camera, for another camera, or for the same film with fewer or more samples.
    ///
    /// The variance of a mean is proportional to the square of the signal of a grey pixel and to the inverse of its number of
    /// samples; without a number, the number is that of the analysis. Rare samples are those of the analysis. For the film
    /// and the camera of the analysis, the result is that of [`Self::of_film`] to the last bit.
    ///
    /// # Errors
    /// Noise or numbers of another size.
    pub fn with_noise(self, noise: &ImageNoise, counts: Option<&Plane<u32>>) -> Result<Self, Error> {
        let inputs = noise.converted(self.size(), &self.response, counts)?;
        self.with_inputs(inputs)
    }

    /// The number of variances in the image that were negative or not a number, and count as unknown.
    pub(crate) fn with_invalid_variances(self, invalid_variances: u64) -> Self {
        Self { invalid_variances, ..self }
    }

    /// Matched exposure with the noise of the film in front of the lens of [`Self::of_film_and_mean`].
    ///
    /// # Errors
    /// As [`CompensationInputs::behind`].
    pub(crate) fn with_inputs(mut self, mut inputs: CompensationInputs) -> Result<Self, Error> {
        if let Some(transmission) = &self.transmission {
            let pixels = inputs.variance.data_mut().iter_mut().zip(transmission.data());
            pixels.for_each(|(variance, t)| *variance *= t * t);
        }
        self.known = Some(match &self.behind {
            Some(image) => inputs.behind(image, self.device.model(), &self.response)?,
            None => inputs,
        });
        Ok(self)
    }

    /// Combines a mean image with a camera. All of the camera's noise is drawn.
    pub(crate) fn new(
        mean: MeanImage,
        settings: &ExposeSettings,
        (model, optics, readout): (&SensorModel, &Optics, Readout),
    ) -> Result<Self, Error> {
        let pixels = mean.size()[0].min(mean.size()[1]);
        if pixels > 0 && !optics.fits(pixels, model.spec().pixel_pitch) {
            let problem = format!("the lens blurs the image over more than its {pixels} pixels");
            return Err(Error::setting("psf", problem, "use a larger aperture, or another point spread function"));
        }
        let image = LensImage::behind(mean, model, optics);
        let radiance = &image.radiance;
        let ImageExposure { exposure, no_light } = ImageExposure::new(settings.exposure, radiance, model, optics)?;
        let response = Response::new(model, optics, exposure);
        let MeanElectrons { plane: electrons, invalid } = electrons(radiance, &response);
        let device = Device::with_readout(model.clone(), settings.seed, [radiance.width(), radiance.height()], readout);
        Ok(Self {
            device,
            response,
            exposure,
            seed: settings.seed,
            electrons,
            optics: optics.clone(),
            behind: image.blur.is_some().then(|| Arc::new(image)),
            transmission: None,
            known: None,
            no_light,
            invalid,
            invalid_variances: 0,
        })
    }

    /// Reads an EXR and combines it with a camera ([`ExrImage`] does it for several cameras).
    ///
    /// # Errors
    /// As [`ExrImage::open`] and [`ExrImage::expose`].
    pub fn open(path: &Path, settings: &ExposeSettings) -> Result<Self, Error> {
        ExrImage::open(path, settings)?.expose(settings)
    }

    /// Combines mean radiance [W/(m^2 sr)], linear Rec. 709, with a camera. Its noise is unknown, so that all of the noise of
    /// the camera is drawn.
    ///
    /// # Errors
    /// Settings outside their range, matched noise, a name of a layer, and more memory than the limit.
    pub fn of_radiance(mut radiance: Plane<[f32; 3]>, settings: &ExposeSettings) -> Result<Self, Error> {
        check(settings)?;
        if settings.exposure_noise == ExposureNoise::Matched {
            let problem = "the noise of the image is unknown, so that it cannot be matched";
            return Err(Error::setting("exposure noise", problem, "use `plain`, or an EXR with a layer `variance`"));
        }
        if settings.layer.is_some() {
            return Err(Error::setting("layer", "an array has no layers", "leave it out"));
        }
        let (model, optics) = (&settings.model, &settings.optics);
        if let Some(focal_length) = settings.vignetting {
            let share = lens_share(focal_length, optics, model, [radiance.width(), radiance.height()]);
            radiance = through_lens(&radiance, &share);
        }
        Self::new(radiance.into(), settings, (model, optics, settings.readout))
    }

    /// Width and height \[pixels\].
    pub fn size(&self) -> [u32; 2] {
        [self.electrons.width(), self.electrons.height()]
    }

    /// The camera.
    pub fn model(&self) -> &SensorModel {
        self.device.model()
    }

    /// The exposure of the settings, or the automatic one.
    pub fn exposure(&self) -> Exposure {
        self.exposure
    }

    /// The response of the pixels to radiance, at this exposure.
    pub(crate) fn response(&self) -> &Response {
        &self.response
    }

    /// Expected photo-electrons of each pixel.
    pub fn electrons(&self) -> &Plane<f32> {
        &self.electrons
    }

    /// The certificate at `k` of the film that is exposed, for this camera. Runs on the threads of the current pool.
    pub fn certify(&self, film: &RenderedFilm, k: f64) -> Option<Certified> {
        let noise = self.noise(film);
        let Some(transmission) = &self.transmission else { return noise.certify(k) };
        let variances = noise.variances_of_mean();
        let behind = variances
            .data()
            .iter()
            .zip(transmission.data())
            .map(|(v, t)| (f64::from(*v) * f64::from(*t).powi(2)) as f32);
        Some(certify_variances(&self.electrons, sensor_noise(self.model(), self.exposure), behind, k))
    }

    /// The noise of the film that is exposed, behind this lens.
    pub(crate) fn noise<'a>(&self, film: &'a RenderedFilm) -> FilmNoise<'a> {
        let noise = FilmNoise::exposed(self.response, self.model(), self.exposure, film);
        match &self.behind {
            Some(image) => noise.behind(image),
            None => noise,
        }
    }

    /// The image behind a lens that blurs.
    pub(crate) fn behind(&self) -> Option<&LensImage> {
        self.behind.as_deref()
    }

    /// Grey values \[DN\] of the frame with this number. They are a function of image, settings, seed and number. Runs
    /// on the threads of the current pool.
    ///
    /// # Errors
    /// None, as the planes are of one size.
    pub fn frame(&self, number: u32) -> Result<Plane<u16>, Error> {
        let [width, height] = self.size();
        let key = FrameKey { seed: self.seed, frame: number };
        let drawn = self
            .known
            .as_ref()
            .map(|known| (known, known.electrons(&self.electrons, (&self.device, self.exposure), key)));
        let mut values = Plane::new(width, height, 0u16);
        values.data_mut().par_chunks_mut(width.max(1) as usize).enumerate().try_for_each(|(y, row)| {
            let rows = y as u32..y as u32 + 1;
            match &drawn {
                Some((k, drawn)) => self.device.expose_rows_matched(drawn, &k.variance, self.exposure, key, rows, row),
                None => self.device.expose_rows(&self.electrons, self.exposure, key, rows, row),
            }
        })?;
        Ok(values)
    }

    /// The frame with this number and its picture, without a certificate.
    ///
    /// # Errors
    /// As [`Self::frame`].
    pub fn develop(&self, number: u32) -> Result<Frame, Error> {
        self.clone().into_frame(number, None, &[])
    }

    /// The frame with this number, with a certificate.
    pub(crate) fn into_frame(
        self,
        number: u32,
        certified: Option<Certified>,
        without: &[Effect],
    ) -> Result<Frame, Error> {
        let values = self.frame(number)?;
        let (exposure, model) = (self.exposure, self.model().clone());
        let matched = self.known.as_ref().map(|known| Matched::new(known, &self.electrons, &model, exposure));
        let (picture, saturated) = (Picture::from_values(&values, &model), self.saturated());
        let Self { electrons, response, no_light, optics, behind, .. } = self;
        let radiance = behind
            .map(|image| Arc::try_unwrap(image).map_or_else(|image| image.radiance.clone(), |image| image.radiance));
        let sensor = SensorFrame {
            electrons,
            values,
            exposure,
            model,
            saturated,
            response,
            optics,
            radiance,
            certified,
            matched,
        };
        Ok(Frame { picture, sensor: Some(sensor), no_light, without: without.to_vec(), denoised: None })
    }

    /// Was the image so dark that no automatic exposure exists? The longest one was used then.
    pub fn no_light(&self) -> bool {
        self.no_light
    }

    /// Is the image black: do 99.9 % of the pixels receive less than one photo-electron?
    pub fn is_black(&self) -> bool {
        black_share(&self.electrons).is_some()
    }

    /// Pixels whose radiance was negative or not a number (they count as black) or infinite (they saturate).
    pub fn invalid(&self) -> u64 {
        self.invalid
    }

    /// Pixels whose variance was negative or not a number, where it was required. Such a variance counts as unknown.
    pub fn invalid_variances(&self) -> u64 {
        self.invalid_variances
    }

    /// The 8-bit picture of a frame with this number, gamma 2.2: grey, or in the colours of the filter array.
    ///
    /// # Errors
    /// As [`Self::frame`].
    pub fn picture(&self, number: u32) -> Result<Picture, Error> {
        Ok(Picture::from_values(&self.frame(number)?, self.model()))
    }

    /// Share of pixels where matched exposure can hold. `None` if all of the camera's noise is drawn.
    pub fn matched(&self) -> Option<f64> {
        let held = self.known.as_ref()?.held(&self.electrons, self.model(), self.exposure);
        Some(held.data().iter().filter(|held| **held).count() as f64 / held.data().len().max(1) as f64)
    }

    /// Share of pixels whose expected electrons fill the well or reach the end of the converter.
    pub fn saturated(&self) -> f64 {
        let model = self.model();
        let full = (model.saturation().0 - model.dark_electrons(self.exposure.time()).0) as f32;
        let electrons = self.electrons.data();
        electrons.iter().filter(|&&e| e >= full).count() as f64 / electrons.len().max(1) as f64
    }
}

/// Transmission of a thin lens in each pixel, relative to its axis.
pub(crate) fn lens_share(
    focal_length: f64,
    optics: &Optics,
    model: &SensorModel,
    [width, height]: [u32; 2],
) -> Plane<f64> {
    let distance = focal_length * (1.0 + optics.magnification()) / model.spec().pixel_pitch.0;
    Plane::from_fn(width, height, |x, y| cosine_fourth(x, y, width, height, distance))
}

/// The share of light behind a thin lens that reaches a pixel, relative to the axis in the middle of the image: cos^4 of the
/// field angle, at the pixel's centre. `distance` of the image from
/// the lens in pixels.
fn cosine_fourth(x: u32, y: u32, width: u32, height: u32, distance: f64) -> f64 {
    let off = |at: u32, size: u32| (f64::from(at) + 0.5 - 0.5 * f64::from(size)) / distance;
    let tangent_squared = off(x, width).powi(2) + off(y, height).powi(2);
    (1.0 + tangent_squared).powi(-2)
}

/// The image behind a lens with this transmission, relative to that of the image.
pub fn through_lens<T: Copy + Into<f64>>(radiance: &Plane<[f32; 3]>, transmission: &Plane<T>) -> Plane<[f32; 3]> {
    let mut shares = transmission.data().iter();
    radiance.map(|&pixel| {
        let share: f64 = shares.next().map_or(1.0, |&share| share.into());
        pixel.map(|v| (f64::from(v) * share) as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A field angle of 45 degrees has cos^4 = 1/4.
    #[test]
    fn the_edge_is_darker_by_the_fourth_power_of_the_cosine() {
        assert_eq!(cosine_fourth(1, 1, 3, 3, 50.0), 1.0);
        assert!((cosine_fourth(100, 0, 101, 1, 50.0) - 0.25).abs() < 1e-12);
        assert!((cosine_fourth(0, 0, 101, 1, 50.0) - 0.25).abs() < 1e-12);
        assert!((cosine_fourth(0, 100, 1, 101, 50.0) - 0.25).abs() < 1e-12);
    }
}
