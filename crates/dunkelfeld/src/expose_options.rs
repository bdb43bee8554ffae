//! Options of the exposure of a film, of an EXR of any renderer, and of an array of radiance.

use crate::commands::expose::{ExposeSettings, OfImage, check};
use crate::exposer::Exposer;
use crate::options::{check_frames, frames_of};
use crate::project::{GivenSensor, exposure_of, sensor_of};
use derive_setters::Setters;
use dunkelfeld_film::Plane;
use dunkelfeld_io::input::InputFiles;
use dunkelfeld_io::job::{self, Job};
use dunkelfeld_render::{Cancel, Error, SavedFilm, SensorChoice};
use dunkelfeld_scene::Vignetting;
use dunkelfeld_sensor::Optics;
use std::path::Path;

/// An exposure. What it does not set is that of the render of the film or file, or a default of [`ExposeSettings::new`].
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_", strip_option, into)]
#[non_exhaustive]
pub struct ExposeOptions {
    /// Keys of a job as lines of TOML: `model`, `exposure` and `exposure_noise` of `[sensor]`, `seed` and `frame`. For images also
    /// `budget.memory` and those of the lens that act on a finished image: `f_number`, `transmission`, `magnification`, `psf`,
    /// `glare`, and `vignetting` with `focal_length`.
    pub keys: String,
    /// A sensor in place of that of the keys.
    pub sensor: Option<GivenSensor>,
    /// The layer of an EXR that contains radiance, as in `ViewLayer.Combined`.
    pub layer: Option<String>,
    /// Number of frames; by default 1.
    pub frames: Option<u32>,
    /// Number of threads; 0 means one per core.
    pub threads: Option<usize>,
}

/// Keys of the lens that act on a finished image.
const LENS: [&str; 7] = ["f_number", "transmission", "magnification", "psf", "glare", "vignetting", "focal_length"];

impl ExposeOptions {
    /// The keys as a job.
    fn job(&self, lens: &[&str]) -> Result<Job, Error> {
        let job = Job::from_text("the keys", format!("scene = \"none\"\n{}", self.keys))?;
        let unused = job.keys().into_iter().find(|path| match path.as_slice() {
            ["scene" | "seed" | "frame"] | ["sensor", "model" | "exposure" | "exposure_noise"] => false,
            ["budget", "memory"] => lens.is_empty(),
            ["lens", key] => !lens.contains(key),
            _ => true,
        });
        match unused {
            None => Ok(job),
            Some(path) => Err(Error::setting(path.join("."), "an exposure does not use this key", "leave it out")),
        }
    }

    /// Is the picture that of the radiance, because there is no sensor?
    pub(crate) fn is_plain(&self, saved: &SavedFilm) -> Result<bool, Error> {
        let job = self.job(&[])?;
        let is_other = self.sensor.is_some() || job.sets(&["sensor", "model"]);
        Ok(if is_other {
            self.sensor.is_none() && job.sensor.model == job::SensorChoice::None
        } else {
            !saved.settings.has_sensor()
        })
    }

    /// The settings that expose a film, without the number of frames.
    ///
    /// # Errors
    /// A sensor that does not exist, or none; keys that an exposure of a film does not use.
    pub fn settings_of(&self, saved: &SavedFilm) -> Result<ExposeSettings, Error> {
        let job = self.job(&[])?;
        let is_other = self.sensor.is_some() || job.sets(&["sensor", "model"]);
        let mut inputs = InputFiles::new();
        let choice = sensor_of(&job.sensor, self.sensor.clone(), Optics::new(1.0, 1.0, 0.0)?, &mut inputs)?;
        let mut settings = match (choice, ExposeSettings::of_render(&saved.settings)?) {
            (_, Some(settings)) if !is_other => settings,
            (SensorChoice::Emva { model, .. }, Some(settings)) if is_other => {
                // All but the sensor is that of the render.
                let model = model.binned(settings.readout.binning)?;
                settings.with_model(model)
            }
            (SensorChoice::Emva { model, .. }, None) if is_other => ExposeSettings::new(*model)?,
            _ => return Err(no_sensor()),
        };
        if job.sets(&["sensor", "exposure"]) {
            settings.exposure = exposure_of(&job.sensor)?;
        }
        if job.sets(&["sensor", "exposure_noise"]) {
            settings.exposure_noise = job.sensor.exposure_noise;
        }
        settings.seed = if job.sets(&["seed"]) { job.seed } else { settings.seed };
        settings.first_frame = if job.sets(&["frame"]) { job.frame } else { settings.first_frame };
        settings.threads = saved.settings.run.threads;
        settings.inputs.extend(&inputs);
        Ok(settings)
    }

    /// The settings that expose an image. A sensor file is one of their inputs.
    ///
    /// # Errors
    /// A sensor that does not exist, or none; a lens out of range; a focal length without vignetting, and vignetting without
    /// a focal length; keys that an exposure does not use.
    pub fn settings(&self) -> Result<ExposeSettings, Error> {
        let job = self.job(&LENS)?;
        let is_given = |key: &str| job.sets(&["lens", key]);
        let mut inputs = InputFiles::new();
        let lens = &job.lens;
        let optics = Optics::new(
            lens.f_number.unwrap_or(dunkelfeld_render::DEFAULT_F_NUMBER),
            lens.transmission,
            lens.magnification.unwrap_or(0.0),
        )?;
        let psf = if is_given("psf") { lens.psf(&mut inputs)? } else { Default::default() };
        let optics = optics.with_psf(psf).with_glare(lens.glare.unwrap_or(0.0))?;
        let of_image = OfImage {
            sensor: self.sensor.is_none() && !job.sets(&["sensor", "model"]),
            lens: ["f_number", "transmission", "magnification"].map(|key| !is_given(key)),
            blur: ["psf", "glare"].map(|key| !is_given(key)),
        };
        let choice = sensor_of(&job.sensor, self.sensor.clone(), optics.clone(), &mut inputs)?;
        let SensorChoice::Emva { model, exposure, .. } = choice else { return Err(no_sensor()) };
        let vignetting = match (lens.vignetting, lens.focal_length) {
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
        Ok(ExposeSettings::new(*model)?
            .with_optics(optics)
            .with_of_image(of_image)
            .with_vignetting(vignetting)
            .with_exposure(exposure)
            .with_exposure_noise(job.sensor.exposure_noise)
            .with_seed(job.seed)
            .with_first_frame(job.frame)
            .with_frames(self.frames.unwrap_or(1))
            .with_layer(self.layer.clone())
            .with_threads(self.threads.unwrap_or(0))
            .with_memory_limit(job.budget.memory)
            .with_inputs(inputs))
    }
}

pub(crate) fn no_sensor() -> Error {
    Error::setting("sensor", "there is no sensor to expose", "name a sensor, such as imx250")
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
