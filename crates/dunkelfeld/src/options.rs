//! Options of one render and of one exposure. Rust, Python and C give them the same names.

use crate::commands::expose::ExposeSettings;
use crate::denoising::{Denoised, denoise_film, find_denoiser};
use crate::exposer::Exposer;
use crate::frame::{Picture, develop_film};
use crate::memory::expose_account;
use crate::project::{Project, ProjectResult, find_sensor_recorded};
use derive_setters::Setters;
use dunkelfeld_adaptive::Strategy;
use dunkelfeld_film::Plane;
use dunkelfeld_io::input::InputFiles;
use dunkelfeld_render::film_noise::Certified;
use dunkelfeld_render::{
    Budget, Cancel, CheckpointSettings, DenoiseSettings, Error, Progress, RenderSettings, SavedFilm, SensorChoice,
    Session, thread_count,
};
use dunkelfeld_sensor::{Exposure, ExposureNoise, Optics, SensorModel};
use std::ops::Range;
use std::path::PathBuf;

/// The sensor of a render or of an exposure.
#[derive(Clone, Debug, PartialEq)]
pub enum SensorOption {
    /// No sensor: radiance 1 W/(m² sr) is white.
    None,
    /// A preset or a sensor file, by name or path.
    Named(String),
    /// A model.
    Model(Box<SensorModel>),
}

/// The exposure time of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ExposureOption {
    /// Automatic: the 99.5 % quantile of the electrons is at 90 % of saturation.
    Auto,
    /// A time.
    Time(Exposure),
}

/// Settings of one render that replace those of its project. `None` leaves a setting as it is.
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_", strip_option, into)]
#[non_exhaustive]
pub struct RenderOptions {
    /// Width of the film \[pixels\].
    pub width: Option<u32>,
    /// Height of the film \[pixels\].
    pub height: Option<u32>,
    /// Name of the camera.
    pub camera: Option<String>,
    /// Wall-clock seconds. A limit of the options (`time`, `spp`, `noise`) replaces all limits of the project.
    pub time: Option<f64>,
    /// Mean samples per pixel.
    pub spp: Option<f64>,
    /// The k of the certificate at which the render may end.
    pub noise: Option<f64>,
    /// Seed of the samples, of the noise and of the device.
    pub seed: Option<u64>,
    /// Number of the frame.
    pub frame: Option<u32>,
    /// Number of threads; 0 means one per core.
    pub threads: Option<usize>,
    /// Range of the sample indices of a part of a render, which [`crate::merge`] joins with others. It replaces budget and
    /// strategy.
    pub samples: Option<Range<u32>>,
    /// Allocation of the samples.
    pub strategy: Option<Strategy>,
    /// The sensor. It is exposed as that of the project, unless `exposure` is set.
    pub sensor: Option<SensorOption>,
    /// The exposure time.
    pub exposure: Option<ExposureOption>,
    /// Path of the checkpoint. If the file exists, the render continues from it.
    pub checkpoint: Option<PathBuf>,
}

/// An exposure of a rendered film. `None` selects the value of the render.
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_", strip_option, into)]
#[non_exhaustive]
pub struct ExposeOptions {
    /// The sensor, behind the lens of the render. [`SensorOption::None`] is the plain picture.
    pub sensor: Option<SensorOption>,
    /// The exposure time.
    pub exposure: Option<ExposureOption>,
    /// Seed of the noise and of the device.
    pub seed: Option<u64>,
    /// Number of the first frame.
    pub frame: Option<u32>,
    /// The noise that the sensor adds.
    pub exposure_noise: Option<ExposureNoise>,
}

/// Selects a sensor and its exposure. Another sensor keeps the exposure, and has the lens `optics`. A named sensor is added
/// to `inputs`.
///
/// # Errors
/// A sensor that does not exist, and an exposure without a sensor.
pub fn select_sensor(
    choice: &mut SensorChoice,
    (sensor, exposure): (Option<SensorOption>, Option<ExposureOption>),
    optics: Optics,
    inputs: &mut InputFiles,
) -> Result<(), Error> {
    let model = match sensor {
        None => None,
        Some(SensorOption::None) => {
            *choice = SensorChoice::None;
            None
        }
        Some(SensorOption::Named(name)) => Some(Box::new(find_sensor_recorded(&name, inputs)?)),
        Some(SensorOption::Model(model)) => Some(model),
    };
    if let Some(model) = model {
        let before = if let SensorChoice::Emva { exposure, .. } = choice { *exposure } else { None };
        *choice = SensorChoice::Emva { model, optics, exposure: before };
    }
    match (exposure, choice) {
        (None, _) => {}
        (Some(_), SensorChoice::None) => {
            return Err(Error::setting("exposure", "there is no sensor to expose", "name a sensor, or leave it out"));
        }
        (Some(ExposureOption::Auto), SensorChoice::Emva { exposure, .. }) => *exposure = None,
        (Some(ExposureOption::Time(time)), SensorChoice::Emva { exposure, .. }) => *exposure = Some(time),
    }
    Ok(())
}

impl RenderOptions {
    fn apply(self, project: &mut Project) -> Result<(), Error> {
        let Self { width, height, camera, time, spp, noise, seed, frame, threads, strategy, .. } = self;
        let s = &mut project.settings;
        let another = self.sensor.is_some();
        select_sensor(&mut s.sensor, (self.sensor, self.exposure), project.optics, &mut project.inputs)?;
        if another && width.or(height).is_none() {
            project.refit_film()?;
        }
        let s: &mut RenderSettings = &mut project.settings;
        s.width = width.unwrap_or(s.width);
        s.height = height.unwrap_or(s.height);
        s.camera = camera.or(s.camera.take());
        if time.is_some() || spp.is_some() || noise.is_some() {
            s.budget = Budget::default().with_seconds(time).with_spp(spp).with_noise(noise);
        }
        s.seed = seed.unwrap_or(s.seed);
        s.frame = frame.unwrap_or(s.frame);
        s.threads = threads.unwrap_or(s.threads);
        s.strategy = strategy.or(s.strategy);
        if self.samples.is_some() {
            // Those of the job are for the whole render.
            if time.or(spp).or(noise).is_none() {
                s.budget = Budget::default();
            }
            s.strategy = strategy;
            s.samples = self.samples;
        }
        s.checkpoint = self.checkpoint.map(CheckpointSettings::new).or(s.checkpoint.take());
        Ok(())
    }
}

/// A project with other settings for a while.
struct Adjusted<'a> {
    project: &'a mut Project,
    before: Option<(RenderSettings, crate::project::FilmRegion)>,
}

impl Drop for Adjusted<'_> {
    fn drop(&mut self) {
        if let Some((settings, region)) = self.before.take() {
            self.project.settings = settings;
            self.project.restore_region(region);
        }
    }
}

impl Project {
    /// [`Project::render_with`] with options for this render. The settings of the project stay as they are, also after an
    /// error.
    ///
    /// # Errors
    /// As [`Project::render_with`]; a sensor that does not exist; an exposure without a sensor.
    pub fn render_options(
        &mut self,
        options: RenderOptions,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<ProjectResult, Error> {
        let before = Some((self.settings.clone(), self.region()));
        let adjusted = Adjusted { project: self, before };
        options.apply(adjusted.project)?;
        adjusted.project.render_with(progress, cancel)
    }
}

impl ExposeSettings {
    /// The settings that expose a film for options, without the number of frames.
    ///
    /// # Errors
    /// A sensor that does not exist, or none.
    pub fn of_film(saved: &SavedFilm, options: &ExposeOptions) -> Result<Self, Error> {
        let model = match &options.sensor {
            None => None,
            Some(SensorOption::Named(name)) => Some(crate::project::find_sensor(name)?),
            Some(SensorOption::Model(model)) => Some((**model).clone()),
            Some(SensorOption::None) => return Err(no_sensor()),
        };
        let mut settings = match (model, Self::of_render(&saved.settings)?) {
            (None, Some(settings)) => settings,
            (None, None) => return Err(no_sensor()),
            (Some(model), Some(settings)) => {
                // All but the sensor is that of the render.
                let model = model.binned(settings.readout.binning)?;
                settings.with_model(model)
            }
            (Some(model), None) => Self::new(model)?,
        };
        match options.exposure {
            None => {}
            Some(ExposureOption::Auto) => settings.exposure = None,
            Some(ExposureOption::Time(time)) => settings.exposure = Some(time),
        }
        settings.seed = options.seed.unwrap_or(settings.seed);
        settings.first_frame = options.frame.unwrap_or(settings.first_frame);
        settings.exposure_noise = options.exposure_noise.unwrap_or(settings.exposure_noise);
        settings.threads = saved.settings.threads;
        Ok(settings)
    }
}

fn no_sensor() -> Error {
    Error::setting("sensor", "the render had no sensor", "name a sensor, such as imx250")
}

/// Grey values \[DN\] of `frames` frames of a film, from the first frame of the options on. Frames of one seed come from the
/// same device. Runs on the threads of the current pool.
///
/// # Errors
/// As [`ExposeSettings::of_film`]; settings outside their range; several frames with matched noise; more memory than the
/// system has.
pub fn expose_film(saved: &SavedFilm, options: &ExposeOptions, frames: u32) -> Result<Vec<Plane<u16>>, Error> {
    let settings = ExposeSettings::of_film(saved, options)?.with_frames(frames);
    let (width, height) = (saved.film.sums.width(), saved.film.sums.height());
    let is_matched = settings.exposure_noise == ExposureNoise::Matched;
    let mut account = expose_account((width, height), 0, is_matched, thread_count(settings.threads));
    let bytes = u64::from(width) * u64::from(height) * 2;
    let phases = account.phases.len();
    // Once as planes, once as the array of a caller.
    account.add("frames", &vec![bytes.saturating_mul(2 * u64::from(frames)); phases]);
    account.check(saved.settings.memory_limit, 0, "expose fewer frames at a time")?;
    let exposer = Exposer::of_film(&saved.film, &settings)?;
    (0..frames).map(|n| exposer.frame(settings.first_frame + n)).collect()
}

/// The 8-bit picture of one frame of a film, gamma 2.2: of the sensor of the options or of the render, or the plain one
/// without a sensor. Runs on the threads of the current pool.
///
/// # Errors
/// As [`expose_film`].
pub fn picture_of_film(saved: &SavedFilm, options: &ExposeOptions) -> Result<Picture, Error> {
    let is_plain = match &options.sensor {
        None => !saved.settings.has_sensor(),
        Some(sensor) => *sensor == SensorOption::None,
    };
    if is_plain {
        let settings = saved.settings.clone().with_sensor(SensorChoice::None);
        return Ok(develop_film(&saved.film, &settings)?.picture);
    }
    let settings = ExposeSettings::of_film(saved, options)?;
    Exposer::of_film(&saved.film, &settings)?.picture(settings.first_frame)
}

/// The certificate of a film at level `k`, for the sensor of its render. Runs on the threads of the current pool.
///
/// # Errors
/// A film without a sensor, and a `k` that is not a number above zero.
pub fn certify_film(saved: &SavedFilm, k: f64) -> Result<Certified, Error> {
    if !(k.is_finite() && k > 0.0) {
        return Err(Error::setting("k", format!("{k} is out of range"), "use a number above zero"));
    }
    let mut settings = saved.settings.clone();
    settings.budget = settings.budget.with_noise(k);
    let frame = develop_film(&saved.film, &settings)?;
    frame.sensor.and_then(|sensor| sensor.certified).ok_or_else(no_sensor)
}

/// The denoised mean of a film, on threads of its own. It is for display, not for measurement.
///
/// # Errors
/// A denoiser that is off or cannot be loaded, and its own errors.
pub fn denoise_saved(saved: &SavedFilm, settings: &DenoiseSettings) -> Result<Denoised, Error> {
    let Some(denoiser) = find_denoiser(settings)? else {
        return Err(Error::setting("denoise", "the denoiser is off", "use `auto`, `oidn` or `builtin`"));
    };
    let session = Session::new(saved.settings.threads)?;
    session
        .install(|| denoise_film(&saved.film.sums, &*denoiser, &session))
        .map_err(|e| Error::setting("denoise", e.to_string(), "use the denoiser `builtin`"))
}
