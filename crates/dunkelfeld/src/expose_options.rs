//! Options of the exposure of an image of any renderer: an EXR, or an array of radiance. Names are those of the flags of
//! `dunkelfeld expose`.

use crate::commands::expose::{ExposeSettings, OfImage, check};
use crate::exposer::Exposer;
use crate::options::{ExposureOption, SensorOption, check_frames, frames_of};
use crate::project::find_sensor_recorded;
use derive_setters::Setters;
use dunkelfeld_film::Plane;
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_io::job::{DEFAULT_SENSOR, PsfSettings};
use dunkelfeld_radiometry::Number;
use dunkelfeld_render::{Cancel, Error};
use dunkelfeld_scene::Vignetting;
use dunkelfeld_sensor::{ExposureNoise, Optics, SensorError};
use std::path::Path;

/// An exposure of an image. `None` selects the defaults of [`ExposeSettings::new`].
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_", strip_option, into)]
#[non_exhaustive]
pub struct ImageOptions {
    /// The sensor; by default that of the render of the image, or [`DEFAULT_SENSOR`].
    pub sensor: Option<SensorOption>,
    /// The exposure time; by default automatic, or that for which the samples of the image were made.
    pub exposure: Option<ExposureOption>,
    /// The noise that the sensor adds. Matched noise needs a layer `variance`, and is for one frame.
    pub exposure_noise: Option<ExposureNoise>,
    /// f-number of the lens, 0.5 to 1000; by default that of the render of the image, as the other values of the lens.
    pub f_number: Option<f64>,
    /// Share of the light that passes the lens, above 0 and at most 1.
    pub transmission: Option<f64>,
    /// Image size over object size, 0 (far away) to 100.
    pub magnification: Option<f64>,
    /// Point spread function of the lens: `none`, `diffraction`, or a CSV file with an MTF
    /// ([`load_mtf`](dunkelfeld_io::job::load_mtf)); by default that of the render of the image, or none.
    pub psf: Option<String>,
    /// Share of the light in the veiling glare, 0 to 0.5; by default that of the render of the image, or 0.
    pub glare: Option<f64>,
    /// Vignetting of the lens. It needs the focal length, and is not for images that contain it.
    pub vignetting: Option<Vignetting>,
    /// Focal length \[m\].
    pub focal_length: Option<f64>,
    /// The layer that contains radiance, as in `ViewLayer.Combined`.
    pub layer: Option<String>,
    /// Number of frames; by default 1.
    pub frames: Option<u32>,
    /// Seed of noise and device; by default 0.
    pub seed: Option<u64>,
    /// Number of the first frame; by default 0.
    pub frame: Option<u32>,
    /// Number of threads; 0 means one per core.
    pub threads: Option<usize>,
    /// Limit of memory \[bytes\].
    pub memory: Option<u64>,
}

impl ImageOptions {
    /// The settings of these options. A sensor file is one of their inputs.
    ///
    /// # Errors
    /// A sensor that does not exist, or none; a lens out of range; a focal length without vignetting, and vignetting without
    /// a focal length.
    pub fn settings(self) -> Result<ExposeSettings, Error> {
        let mut inputs = InputFiles::new();
        let lens = [self.f_number, self.transmission, self.magnification].map(|value| value.is_none());
        let of_image =
            OfImage { sensor: self.sensor.is_none(), lens, blur: [self.psf.is_none(), self.glare.is_none()] };
        let model = match self.sensor {
            None => find_sensor_recorded(DEFAULT_SENSOR, &mut inputs)?,
            Some(SensorOption::Named(name)) => find_sensor_recorded(&name, &mut inputs)?,
            Some(SensorOption::Model { model, file }) => {
                file.iter().for_each(|file| inputs.add(file, Role::Sensor));
                *model
            }
            Some(SensorOption::None) => {
                return Err(Error::setting("sensor", "there is no sensor to expose", "name a sensor, such as imx250"));
            }
        };
        let defaults = ExposeSettings::new(model)?;
        let lens = defaults.optics.clone();
        let optics = Optics::new(
            self.f_number.unwrap_or(lens.f_number()),
            self.transmission.unwrap_or(lens.transmission()),
            self.magnification.unwrap_or(lens.magnification()),
        );
        let psf = self.psf.map(|word| {
            let help = "write none, diffraction, or the path of a CSV file";
            let psf = PsfSettings::from_word(&word).map_err(|problem| Error::setting("psf", problem, help))?;
            Ok::<_, Error>(psf.load(&mut inputs)?)
        });
        let psf = psf.transpose()?.unwrap_or_default();
        let optics = optics.and_then(|optics| optics.with_psf(psf).with_glare(self.glare.unwrap_or(0.0)));
        let optics = optics.map_err(|e| match e {
            SensorError::OutOfRange { field, value, allowed } => {
                Error::setting(field, format!("{} is out of range", Number(value)), format!("write a number {allowed}"))
            }
            other => other.into(),
        })?;
        let vignetting = match (self.vignetting, self.focal_length) {
            (None, Some(_)) => {
                let problem = "only vignetting needs it, and there is none";
                return Err(Error::setting("focal_length", problem, "add vignetting, or leave it out"));
            }
            (None | Some(Vignetting::None), _) => None,
            (Some(Vignetting::CosineFourth), Some(focal_length)) => Some(focal_length),
            (Some(Vignetting::CosineFourth), None) => {
                let problem = "field angles follow from a focal length, and there is none";
                return Err(Error::setting("vignetting", problem, "add the focal length, such as 12 mm"));
            }
        };
        Ok(defaults
            .with_optics(optics)
            .with_of_image(of_image)
            .with_vignetting(vignetting)
            .with_exposure(match self.exposure {
                None | Some(ExposureOption::Auto) => None,
                Some(ExposureOption::Time(time)) => Some(time),
            })
            .with_exposure_noise(self.exposure_noise.unwrap_or_default())
            .with_seed(self.seed.unwrap_or(0))
            .with_first_frame(self.frame.unwrap_or(0))
            .with_frames(self.frames.unwrap_or(1))
            .with_layer(self.layer)
            .with_threads(self.threads.unwrap_or(0))
            .with_memory_limit(self.memory)
            .with_inputs(inputs))
    }
}

/// Grey values \[DN\] of the frames of an EXR of any renderer: those that [`expose_exr`](crate::commands::expose_exr) writes. `cancel` ends
/// the exposure after a frame; then those until then are returned. Runs on the threads of the current pool.
///
/// # Errors
/// As [`Exposer::open`], and more memory than the limit.
pub fn expose_image(path: &Path, settings: &ExposeSettings, cancel: &Cancel) -> Result<Vec<Plane<u16>>, Error> {
    let exposer = Exposer::open(path, settings)?;
    let [width, height] = exposer.size();
    check_frames(settings, (width, height))?;
    frames_of(&exposer, settings, cancel)
}

/// [`expose_image`] for mean radiance [W/(m^2 sr)], linear Rec. 709, instead of a file.
///
/// # Errors
/// As [`Exposer::of_radiance`], no pixels, and more memory than the limit.
pub fn expose_radiance(
    radiance: Plane<[f32; 3]>,
    settings: &ExposeSettings,
    cancel: &Cancel,
) -> Result<Vec<Plane<u16>>, Error> {
    check(settings)?;
    if radiance.data().is_empty() {
        return Err(Error::setting("radiance", "has no pixels", "pass an image with at least one pixel"));
    }
    check_frames(settings, (radiance.width(), radiance.height()))?;
    frames_of(&Exposer::of_radiance(radiance, settings)?, settings, cancel)
}
