//! An EXR of any renderer, read once and exposed by several cameras.

use crate::commands::denoise::{invalid_variances_of, radiance_of};
use crate::commands::expose::{ExposeSettings, check};
use crate::exposer::{Exposer, lens_share, through_lens};
use crate::image_noise::ImageNoise;
use crate::memory::expose_account;
use crate::noise_compensation::CompensationInputs;
use crate::outputs::{FilmOfSensor, SPREAD, VIGNETTING, attributes};
use crate::shutter::TimedExposure;
use dunkelfeld_adaptive::required_samples::SensorNoise;
use dunkelfeld_adaptive::variance::inputs::{PixelFeatures, pixel_features};
use dunkelfeld_film::{MeanImage, Plane, Scatter, fill_gaps};
use dunkelfeld_io::InputError;
use dunkelfeld_io::exr::{ExrLayers, ExrSize, read_exr_if};
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_io::layers::{Single, Triple};
use dunkelfeld_radiometry::Number;
use dunkelfeld_render::film_noise::{Certified, FilmNoise, SignalEstimates, sensor_noise, signal_scatter};
use dunkelfeld_render::{Error, thread_count};
use dunkelfeld_sensor::{Exposure, ExposureNoise, Optics, Response, SensorModel, Weights};
use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The radiance of an EXR and, if it was read for matched exposure, its noise.
#[derive(Debug)]
pub struct ExrImage {
    path: PathBuf,
    mean: MeanImage,
    /// `None` if the file has no variances, or was read for plain exposure.
    noise: Option<NoiseLayers>,
    is_read_for_matched: bool,
    film: Option<FilmOfSensor>,
    has_vignetting: bool,
    /// The words for the effects that the render left out.
    pub(crate) left_out: Option<String>,
    /// Ids of the objects and of the materials of the pixels, with their names.
    surfaces: [Option<(Plane<u32>, Vec<String>)>; 2],
}

/// The source of a value of the lens of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LensSource {
    /// The settings of the exposure.
    Given,
    /// The file, which is of a render of this program.
    Image,
    /// The default, because the file contains no lens.
    Default,
}

impl ExrImage {
    /// Reads the layer of the settings, and the noise of the image if the settings ask for matched exposure. A file without
    /// noise can be exposed plainly.
    ///
    /// # Errors
    /// A file that cannot be read or has no such layer; settings outside their range.
    pub fn open(path: &Path, settings: &ExposeSettings) -> Result<Self, Error> {
        check(settings)?;
        let is_matched = settings.exposure_noise == ExposureNoise::Matched;
        let agree = |size: ExrSize| {
            let threads = thread_count(settings.threads);
            let account =
                expose_account((size.width, size.height), size.bytes, (is_matched, settings.optics.blurs()), threads);
            let help = "expose a smaller image, one with fewer layers, or on fewer --threads";
            account.check(settings.memory_limit, 0, help)
        };
        let layers = read_exr_if(path, Role::Image, &mut InputFiles::new(), agree)?;
        layers.check_primaries(path)?;
        let layers = layers.displayed();
        let mut radiance = radiance_of(path, &layers, settings.layer.as_deref())?;
        if let (None, Some(counts)) = (&settings.layer, layers.integers(Single::SampleCount))
            && counts.data().contains(&0)
        {
            // As in the frame of the render.
            radiance = fill_gaps(&radiance, &counts.map(|n| *n > 0));
        }
        let is_spread = attributes(&layers).get(SPREAD).is_some_and(|spread| *spread == true);
        let mean = match (&settings.layer, layers.triples(Triple::MomentX), layers.triples(Triple::MomentY)) {
            (None, Some(right), Some(down)) => MeanImage { radiance, moments: Some([right, down]), is_spread },
            // The radiance behind the lens is an image without one.
            _ => MeanImage::without_moments(radiance, is_spread && !is_behind_lens(settings)),
        };
        let named = |layer: Single, names: &str| {
            let names = attributes(&layers).remove(names).and_then(|names| serde_json::from_value(names).ok());
            Some((layers.integers(layer)?, names.unwrap_or_default()))
        };
        Ok(Self {
            path: path.to_owned(),
            has_vignetting: attributes(&layers).contains_key(VIGNETTING),
            left_out: left_out_of_file(&layers),
            mean,
            noise: if is_matched { NoiseLayers::from_layers(&layers) } else { None },
            is_read_for_matched: is_matched,
            film: FilmOfSensor::of_file(path, &layers)?,
            surfaces: [named(Single::ObjectId, "objects"), named(Single::MaterialId, "materials")],
        })
    }

    /// Mean radiance [W/(m^2 sr)], linear Rec. 709.
    pub fn radiance(&self) -> &Plane<[f32; 3]> {
        &self.mean.radiance
    }

    /// The mean in front of the lens.
    pub fn mean(&self) -> &MeanImage {
        &self.mean
    }

    /// Samples of each pixel. `None` if the file does not contain them and the noise of the mean, or was read for plain
    /// exposure.
    pub fn sample_counts(&self) -> Option<&Plane<u32>> {
        Some(&self.noise.as_ref()?.pixels.as_ref()?.counts)
    }

    /// Names of object and material at a pixel, or their numbers if the file has no names. `None` for what the file does not
    /// contain, and where no surface is.
    pub fn surface_at(&self, x: u32, y: u32) -> [Option<String>; 2] {
        self.surfaces.each_ref().map(|layer| {
            let (ids, names) = layer.as_ref()?;
            let id = Some(*ids.at(x, y)).filter(|id| *id != u32::MAX)?;
            Some(names.get(id as usize).cloned().unwrap_or_else(|| format!("number {id}")))
        })
    }

    /// The certificate at `k` behind a camera of [`Self::expose`] without vignetting, as that of the film of the image. `None`
    /// without [`Self::sample_counts`]. Runs on the threads of the current pool.
    pub fn certify(&self, exposer: &Exposer, k: f64) -> Option<Certified> {
        let sensor = sensor_noise(exposer.model(), exposer.exposure());
        let noise = self.noise.as_ref()?.film_noise(*exposer.response(), sensor, &self.mean.radiance)?;
        match exposer.behind() {
            Some(image) => noise.behind(image).certify(k),
            None => noise.certify(k),
        }
    }

    /// Combines the image with a camera. Binning, the stages of a line scan, the wavelengths of the channels, the filter of the
    /// lens and the beam splitters in front of it are those of the render, if the file contains them. So are the values
    /// of the lens and the sensor that the settings leave to the image ([`ExposeSettings::of_image`]), and an exposure
    /// time for which the samples were made. The layer is that of [`Self::open`]. Runs on the threads of the current pool.
    ///
    /// # Errors
    /// Settings outside their range; another exposure time than that of the samples; vignetting that the image has
    /// already; noise that is to be matched, but is not in the file or was not read.
    pub fn expose(&self, settings: &ExposeSettings) -> Result<Exposer, Error> {
        let image = self.behind_lens(settings)?;
        let exposer = self.plain(&image.mean, settings)?;
        if settings.exposure_noise == ExposureNoise::Plain {
            return Ok(exposer);
        }
        let (noise, invalid_variances) = self.noise_behind(&image, &exposer)?;
        Ok(exposer.with_inputs(noise.inputs)?.with_invalid_variances(invalid_variances))
    }

    /// Analyses the noise of the image for matched exposure with a camera: for [`Exposer::with_noise`] without
    /// numbers of samples. Runs on the threads of the current pool.
    ///
    /// # Errors
    /// As [`Self::expose`] with matched noise.
    pub fn image_noise(&self, settings: &ExposeSettings) -> Result<ImageNoise, Error> {
        let image = self.behind_lens(settings)?;
        Ok(self.noise_behind(&image, &self.plain(&image.mean, settings)?)?.0)
    }

    /// The image behind the lens of the settings.
    fn behind_lens(&self, settings: &ExposeSettings) -> Result<Image<'_>, Error> {
        check(settings)?;
        let (mean, noise) = (&self.mean, self.noise.as_ref());
        let Some(focal_length) = settings.vignetting else {
            return Ok(Image { mean: Cow::Borrowed(mean), noise: noise.map(Cow::Borrowed) });
        };
        if self.has_vignetting {
            let problem = "the lens of the render has darkened its corners already";
            return Err(InputError::new(&self.path, "--vignetting", problem, "leave out --vignetting").into());
        }
        let share = lens_share(focal_length, &self.lens(settings).0, &self.model(settings)?, mean.size());
        let noise = noise.map(|noise| Cow::Owned(noise.darkened(&share)));
        Ok(Image { mean: Cow::Owned(mean.map(|plane| through_lens(plane, &share))), noise })
    }

    fn model(&self, settings: &ExposeSettings) -> Result<SensorModel, Error> {
        let model = settings.model.clone();
        Ok(match &self.film {
            Some(film) if settings.of_image.sensor => film.model.clone(),
            Some(film) => model.binned(film.readout.binning)?,
            None => model,
        })
    }

    /// The sensor of the render of the image. `None` without a render, and if the render combined pixels.
    pub fn sensor(&self) -> Option<&SensorModel> {
        self.film.as_ref().filter(|film| film.readout.binning == 1).map(|film| &film.model)
    }

    /// The lens in front of the image, and the sources of f-number, transmission and magnification.
    pub fn lens(&self, settings: &ExposeSettings) -> (Optics, [LensSource; 3]) {
        let (given, of_image) = (settings.optics.clone(), settings.of_image.lens);
        let Some(FilmOfSensor { optics, .. }) = &self.film else {
            return (given, of_image.map(|is_open| if is_open { LensSource::Default } else { LensSource::Given }));
        };
        let values = |lens: &Optics| [lens.f_number(), lens.transmission(), lens.magnification()];
        let [is_own_psf, is_own_glare] = settings.of_image.blur.map(|is_own| is_own && !is_behind_lens(settings));
        let psf = if is_own_psf { optics } else { &given }.psf().clone();
        let glare = if is_own_glare { optics } else { &given }.glare();
        let [given, own] = [values(&given), values(optics)];
        let [f_number, transmission, magnification] = [0, 1, 2].map(|i| if of_image[i] { own[i] } else { given[i] });
        // Values of two valid lenses are valid.
        let lens =
            Optics::new(f_number, transmission, magnification).and_then(|lens| lens.with_psf(psf).with_glare(glare));
        let lens = lens.unwrap_or_else(|_| optics.clone()).with_bands(optics.bands());
        (lens, of_image.map(|is_own| if is_own { LensSource::Image } else { LensSource::Given }))
    }

    /// The exposure time for which the samples of the image were made. `None` if it can be exposed for any time.
    pub fn timed_exposure(&self) -> Option<TimedExposure> {
        let time = self.film.as_ref()?.timed?.time();
        Some(TimedExposure { time, reason: "objects move, rows are scanned, or the strobe of a lamp is timed," })
    }

    /// The exposure of the settings, or that of the samples.
    fn exposure(&self, settings: &ExposeSettings) -> Result<Option<Exposure>, Error> {
        let Some(TimedExposure { time, reason }) = self.timed_exposure() else { return Ok(settings.exposure) };
        // A time is rounded when it is written in another unit.
        if settings.exposure.is_some_and(|given| (given.time().0 / time.0 - 1.0).abs() > 1e-9) {
            let problem = format!("{reason} for an exposure of {} s", Number(time.0));
            return Err(
                InputError::new(&self.path, "exposure", problem, "leave the exposure out, or render again").into()
            );
        }
        Ok(Some(Exposure::new(time)?))
    }

    /// Plain exposure.
    fn plain(&self, mean: &MeanImage, settings: &ExposeSettings) -> Result<Exposer, Error> {
        let readout = self.film.as_ref().map_or(settings.readout, |film| film.readout);
        let settings = settings.clone().with_exposure(self.exposure(settings)?);
        let (model, lens) = (self.model(&settings)?, self.lens(&settings).0);
        Exposer::new(mean.clone(), &settings, (&model, &lens, readout))
    }

    /// The noise of the image behind a camera, and the number of its variances that are no variances.
    fn noise_behind(&self, image: &Image<'_>, exposer: &Exposer) -> Result<(ImageNoise, u64), Error> {
        let Some(noise) = &image.noise else {
            let problem = match self.is_read_for_matched {
                true => "is missing, so the noise of the render is unknown",
                false => "was not read, so the noise of the render is unknown",
            };
            let help = "leave out --exposure-noise matched";
            return Err(InputError::new(&self.path, "the layer `variance`", problem, help).into());
        };
        let sensor = sensor_noise(exposer.model(), exposer.exposure());
        let behind = noise.behind(*exposer.response(), sensor, &image.mean.radiance);
        Ok((behind, invalid_variances_of(&noise.variance)))
    }
}

/// Is the layer of the settings the radiance behind the lens of a render? Then the lens of the file has no blur.
fn is_behind_lens(settings: &ExposeSettings) -> bool {
    settings.layer.as_deref() == Some("lens")
}

/// The words for the effects that the render of a file left out.
fn left_out_of_file(layers: &ExrLayers) -> Option<String> {
    let names = attributes(layers).remove("without").unwrap_or_default();
    let names: Vec<String> = serde_json::from_value(names).unwrap_or_default();
    (!names.is_empty()).then(|| format!("rendered without {}", names.join(", ")))
}

/// An image behind a lens.
struct Image<'a> {
    mean: Cow<'a, MeanImage>,
    noise: Option<Cow<'a, NoiseLayers>>,
}

/// The noise data of a mean, from a file.
#[derive(Clone, Debug)]
struct NoiseLayers {
    /// Variance of the mean, by channel.
    variance: Plane<[f32; 3]>,
    /// Covariance of its channels.
    covariance: Plane<[f32; 3]>,
    /// Further data of a file of ours.
    pixels: Option<PixelLayers>,
}

/// Surface ids and samples of the pixels.
#[derive(Clone, Debug)]
struct PixelLayers {
    counts: Plane<u32>,
    surface: Plane<PixelFeatures>,
    scatter: Plane<Option<Scatter>>,
}

impl NoiseLayers {
    /// `None` without variances.
    fn from_layers(layers: &ExrLayers) -> Option<Self> {
        let variance = layers.triples(Triple::Variance)?;
        let covariance =
            layers.triples(Triple::Covariance).unwrap_or_else(|| variance.map(|_| Weights::UNKNOWN_COVARIANCE));
        let whole = [layers.integers(Single::SampleCount), layers.integers(Single::ObjectId)];
        let pixels = match (whole, layers.triples(Triple::Normal)) {
            ([Some(counts), Some(objects)], Some(normals)) => {
                let scatter = [Single::Scatter, Single::LargestScatter].map(|layer| layers.single(layer));
                let scatter = match scatter {
                    [Some(all), Some(largest)] => {
                        let mut largest = largest.data().iter();
                        all.map(|&all| {
                            let largest = f64::from(*largest.next()?);
                            let all = f64::from(all);
                            (all.is_finite() && all >= 0.0 && (0.0..=all).contains(&largest))
                                .then_some(Scatter { all, largest })
                        })
                    }
                    _ => counts.map(|_| None),
                };
                Some(PixelLayers { counts, surface: pixel_features(&objects, &normals), scatter })
            }
            _ => None,
        };
        Some(Self { variance, covariance, pixels })
    }

    fn darkened(&self, share: &Plane<f64>) -> Self {
        let squares = share.map(|s| s * s);
        let mut shares = share.data().iter();
        let pixels = self.pixels.as_ref().map(|PixelLayers { counts, surface, scatter }| {
            let scatter = scatter.map(|&scatter| {
                let share = shares.next().copied().unwrap_or(1.0);
                scatter.map(|s| signal_scatter(s, share))
            });
            PixelLayers { counts: counts.clone(), surface: surface.clone(), scatter }
        });
        let [variance, covariance] = [&self.variance, &self.covariance].map(|plane| through_lens(plane, &squares));
        Self { variance, covariance, pixels }
    }

    /// The noise of the electrons of a sensor: as in a render if the file contains the ids of the surfaces in the
    /// pixels, otherwise from each pixel's own variance.
    fn behind(&self, response: Response, sensor: SensorNoise, mean: &Plane<[f32; 3]>) -> ImageNoise {
        let (width, height) = (mean.width(), mean.height());
        let own = |x, y| response.at(x, y).variance(*self.variance.at(x, y), *self.covariance.at(x, y)) as f32;
        let inputs = match self.film_noise(response, sensor, mean) {
            Some(noise) => CompensationInputs::from_variances(&noise.pixel_variances()),
            None => CompensationInputs::new(Plane::from_fn(width, height, own), Plane::new(width, height, false)),
        };
        ImageNoise { response, counts: None, inputs }
    }

    /// The noise of the electrons of a sensor, as in a render. `None` without samples and ids of the pixels.
    fn film_noise<'a>(
        &'a self,
        response: Response,
        sensor: SensorNoise,
        mean: &'a Plane<[f32; 3]>,
    ) -> Option<FilmNoise<'a>> {
        let (width, height) = (mean.width(), mean.height());
        let PixelLayers { counts, surface, scatter } = self.pixels.as_ref()?;
        let view = move |weights: &Weights, rows: &Range<u32>| {
            let (top, rows) = (rows.start, rows.len() as u32);
            let seen = Plane::from_fn(width, rows, |x, y| {
                let (x, y) = (x, top + y);
                let variances = (*self.variance.at(x, y), *self.covariance.at(x, y));
                SignalEstimates::new(weights, *mean.at(x, y), variances, *scatter.at(x, y), *counts.at(x, y))
            });
            let counts = Plane::from_fn(width, rows, |x, y| *counts.at(x, top + y));
            let surface = Plane::from_fn(width, rows, |x, y| *surface.at(x, top + y));
            SignalEstimates::inputs(&seen, counts, surface, Some(sensor))
        };
        let views = move |rows: Range<u32>| response.kinds().iter().map(|weights| view(weights, &rows)).collect();
        let own = Plane::from_fn(width, height, |x, y| response.at(x, y).electrons(*mean.at(x, y)).0 as f32);
        Some(FilmNoise::from_estimates(own, counts.clone(), views, response, Some(sensor)))
    }
}
