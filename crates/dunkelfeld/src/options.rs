//! Options of one render and of one exposure. Rust, Python and C give them the same names.

use crate::commands::expose::ExposeSettings;
use crate::denoising::{Denoised, denoise_film, find_denoiser, select_denoiser};
use crate::exposer::Exposer;
use crate::frame::{Picture, develop_film};
use crate::memory::expose_account;
use crate::outputs::{SavedPlan, load_plan_recorded};
use crate::project::{FilmRegion, Project, ProjectResult, find_sensor_recorded};
use crate::traced_sample::TracedSample;
use derive_setters::Setters;
use dunkelfeld_adaptive::Strategy;
use dunkelfeld_adaptive::budget::NOISE_LEVELS;
use dunkelfeld_film::Plane;
use dunkelfeld_integrator::PixelSample;
use dunkelfeld_io::ImportWarning;
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_render::film_noise::Certified;
use dunkelfeld_render::{
    Budget, Cancel, CheckpointSettings, DenoiseMethod, DenoiseSettings, Error, Progress, RenderSettings, SavedFilm,
    SensorChoice, Session, thread_count,
};
use dunkelfeld_scene::Vignetting;
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
    /// A model, and the file that it was read from, which no output may replace.
    Model {
        /// The model.
        model: Box<SensorModel>,
        /// The file; `None` for a preset and for a model that the program has made.
        file: Option<PathBuf>,
    },
}

/// The exposure time of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ExposureOption {
    /// Automatic: the 99.5 % quantile of the electrons is at 90 % of saturation.
    Auto,
    /// A time.
    Time(Exposure),
}

/// The samples of an earlier render, for a replay.
#[derive(Clone, Debug, PartialEq)]
pub enum ReplayOption {
    /// An EXR with the layers or the plan of a render. Size, seed and frame are those of the file, unless the options
    /// set them.
    File(PathBuf),
    /// A plan with the same data, such as [`SavedPlan::of_film`].
    Plan(SavedPlan),
    /// Samples per pixel. They determine the size of the film; seed and frame are those of the project.
    Samples(Plane<u32>),
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
    /// The share of the pixels \[%\] that must be hidden at that k.
    pub share: Option<f64>,
    /// Seed of the samples, of the noise and of the device.
    pub seed: Option<u64>,
    /// Number of the frame.
    pub frame: Option<u32>,
    /// Number of threads; 0 means one per core.
    pub threads: Option<usize>,
    /// Range of the sample indices of a part of a render, which [`merge`](crate::commands::merge()) joins with others. It replaces budget and
    /// strategy.
    pub samples: Option<Range<u32>>,
    /// Allocation of the samples.
    pub strategy: Option<Strategy>,
    /// The sensor. It is exposed as that of the project, unless `exposure` is set.
    pub sensor: Option<SensorOption>,
    /// The exposure time.
    pub exposure: Option<ExposureOption>,
    /// The noise that the sensor adds.
    pub exposure_noise: Option<ExposureNoise>,
    /// Vignetting of all lenses.
    pub vignetting: Option<Vignetting>,
    /// Denoiser of the picture.
    pub denoise: Option<DenoiseMethod>,
    /// Path of Intel Open Image Denoise. Without `denoise` it selects this denoiser.
    pub oidn: Option<PathBuf>,
    /// A plan that is rendered instead of budget and strategy.
    pub replay: Option<ReplayOption>,
    /// Limit of memory \[bytes\].
    pub memory: Option<u64>,
    /// Path of the checkpoint. If the file exists, the render continues from it.
    pub checkpoint: Option<PathBuf>,
    /// Seconds between two checkpoints; 0 writes at every opportunity.
    pub checkpoint_every: Option<f64>,
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
        Some(SensorOption::Model { model, file }) => {
            file.iter().for_each(|file| inputs.add(file, Role::Sensor));
            Some(model)
        }
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
        let is_limited = self.time.is_some() || self.spp.is_some() || self.noise.is_some();
        let is_replay = self.replay.is_some();
        if is_replay && (is_limited || self.share.is_some() || self.strategy.is_some()) {
            let problem = "the samples are those of the plan, so that there is neither a limit nor a strategy";
            return Err(Error::setting(
                "replay",
                problem,
                "leave out time, spp, noise, share and strategy, or the plan",
            ));
        }
        if let Some(replay) = self.replay {
            replay.apply(project)?;
        }
        let Self { width, height, camera, time, spp, noise, share, seed, frame, threads, strategy, .. } = self;
        let s = &mut project.settings;
        let another = self.sensor.is_some();
        select_sensor(&mut s.sensor, (self.sensor, self.exposure), project.optics.clone(), &mut project.inputs)?;
        if another && !is_replay && width.or(height).is_none() {
            project.refit_film()?;
        }
        project.vignetting = self.vignetting.or(project.vignetting);
        let s: &mut RenderSettings = &mut project.settings;
        select_exposure_noise(self.exposure_noise, s)?;
        select_denoiser(self.denoise, self.oidn.as_deref(), &mut s.denoise);
        s.width = width.unwrap_or(s.width);
        s.height = height.unwrap_or(s.height);
        s.camera = camera.or(s.camera.take());
        if is_limited {
            s.budget = Budget::default().with_seconds(time).with_spp(spp).with_noise(noise);
        }
        s.budget.share = share.or(s.budget.share);
        s.seed = seed.unwrap_or(s.seed);
        s.frame = frame.unwrap_or(s.frame);
        s.threads = threads.unwrap_or(s.threads);
        s.memory_limit = self.memory.or(s.memory_limit);
        if another && !s.has_sensor() && strategy.is_none() && s.strategy == Some(Strategy::Sensor) {
            s.strategy = None;
            let message = "there is no sensor, so that `uniform` replaces the allocation `sensor` of the job";
            project.warnings.push(ImportWarning { place: "allocation".into(), message: message.into() });
        }
        let s: &mut RenderSettings = &mut project.settings;
        s.strategy = strategy.or(s.strategy);
        if self.samples.is_some() {
            // Those of the job are for the whole render.
            if !is_limited {
                s.budget = Budget::default();
            }
            s.strategy = strategy;
            s.samples = self.samples;
        }
        s.checkpoint = self.checkpoint.map(CheckpointSettings::new).or(s.checkpoint.take());
        match (self.checkpoint_every, &mut s.checkpoint) {
            (None, _) => {}
            (Some(seconds), Some(keep)) if seconds.is_finite() && seconds >= 0.0 => keep.seconds = seconds,
            (Some(seconds), Some(_)) => {
                let problem = format!("{seconds} s is out of range");
                return Err(Error::setting("checkpoint_every", problem, "use 0 or more seconds"));
            }
            (Some(_), None) => {
                let problem = "there is no checkpoint to write";
                return Err(Error::setting("checkpoint_every", problem, "name a checkpoint, or leave it out"));
            }
        }
        Ok(())
    }
}

impl ReplayOption {
    /// The plan is the budget. Its other data are settings, which options may replace.
    fn apply(self, project: &mut Project) -> Result<(), Error> {
        let plan = match self {
            Self::File(path) => load_plan_recorded(&path, &mut project.inputs)?,
            Self::Plan(plan) => plan,
            Self::Samples(samples) => {
                let s = &mut project.settings;
                (s.width, s.height, s.budget) = (samples.width(), samples.height(), Budget::default());
                s.replay = Some(samples);
                return Ok(());
            }
        };
        let s = &mut project.settings;
        (s.width, s.height, s.budget) = (plan.samples.width(), plan.samples.height(), Budget::default());
        s.seed = plan.seed.unwrap_or(s.seed);
        s.frame = plan.frame.unwrap_or(s.frame);
        s.training_paths = Some(plan.training_paths);
        s.replay = Some(plan.samples);
        Ok(())
    }
}

/// The noise that the exposure adds. Without a sensor there is no noise, also if a job sets it.
fn select_exposure_noise(noise: Option<ExposureNoise>, s: &mut RenderSettings) -> Result<(), Error> {
    if noise.is_some() && !s.has_sensor() {
        let problem = "there is no sensor that adds noise";
        return Err(Error::setting("exposure_noise", problem, "name a sensor, or leave it out"));
    }
    let of_job = if s.has_sensor() { s.exposure_noise } else { ExposureNoise::Plain };
    s.exposure_noise = noise.unwrap_or(of_job);
    Ok(())
}

/// What options change in a project.
type Changed = (RenderSettings, FilmRegion, Option<Vignetting>, InputFiles, Vec<ImportWarning>);

/// A project with other settings for a while.
struct Adjusted<'a> {
    project: &'a mut Project,
    before: Option<Changed>,
}

impl<'a> Adjusted<'a> {
    fn new(project: &'a mut Project, options: RenderOptions) -> Result<Self, Error> {
        let (settings, inputs, warnings) = (&project.settings, &project.inputs, &project.warnings);
        let before = (settings.clone(), project.region(), project.vignetting, inputs.clone(), warnings.clone());
        let adjusted = Self { project, before: Some(before) };
        options.apply(adjusted.project)?;
        Ok(adjusted)
    }
}

impl Drop for Adjusted<'_> {
    fn drop(&mut self) {
        if let Some((settings, region, vignetting, inputs, warnings)) = self.before.take() {
            self.project.settings = settings;
            self.project.restore_region(region);
            self.project.vignetting = vignetting;
            self.project.inputs = inputs;
            self.project.warnings = warnings;
        }
    }
}

impl Project {
    /// Replaces settings of the project by options. After an error the settings are as before.
    ///
    /// # Errors
    /// A sensor or a plan that does not exist; an exposure or its noise without a sensor; a replay with a limit or a
    /// strategy; an interval without a checkpoint.
    pub fn apply_options(&mut self, options: RenderOptions) -> Result<(), Error> {
        Adjusted::new(self, options)?.before = None;
        Ok(())
    }

    /// [`Project::render_with`] with options for this render. The settings of the project stay as they are, also after an
    /// error.
    ///
    /// # Errors
    /// As [`Project::render_with`] and [`Project::apply_options`].
    pub fn render_options(
        &mut self,
        options: RenderOptions,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<ProjectResult, Error> {
        Adjusted::new(self, options)?.project.render_with(progress, cancel)
    }

    /// [`Project::trace_sample`] with options for this sample. The settings of the project stay as they are.
    ///
    /// # Errors
    /// As [`Project::trace_sample`] and [`Project::apply_options`].
    pub fn trace_options(&mut self, options: RenderOptions, at: PixelSample) -> Result<TracedSample, Error> {
        Adjusted::new(self, options)?.project.trace_sample(at)
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
            Some(SensorOption::Model { model, .. }) => Some((**model).clone()),
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
/// same device. `cancel` ends the exposure after a frame; then those until then are returned. Runs on the threads of the
/// current pool.
///
/// # Errors
/// As [`ExposeSettings::of_film`]; settings outside their range; several frames with matched noise; more memory than the
/// system has.
pub fn expose_film(
    saved: &SavedFilm,
    options: &ExposeOptions,
    frames: u32,
    cancel: &Cancel,
) -> Result<Vec<Plane<u16>>, Error> {
    let settings = ExposeSettings::of_film(saved, options)?.with_frames(frames);
    let size = (saved.film.sums.width(), saved.film.sums.height());
    let settings = settings.with_memory_limit(saved.settings.memory_limit);
    check_frames(&settings, size)?;
    frames_of(&Exposer::of_film(&saved.film, &settings)?, &settings, cancel)
}

/// All frames of the settings, or those until `cancel`.
pub(crate) fn frames_of(
    exposer: &Exposer,
    settings: &ExposeSettings,
    cancel: &Cancel,
) -> Result<Vec<Plane<u16>>, Error> {
    let numbers = (0..settings.frames).take_while(|_| !cancel.is_cancelled());
    numbers.map(|n| exposer.frame(settings.first_frame + n)).collect()
}

/// Checks that the frames of the settings fit into memory, for a film of this width and height \[pixels\].
pub(crate) fn check_frames(settings: &ExposeSettings, (width, height): (u32, u32)) -> Result<(), Error> {
    let is_matched = settings.exposure_noise == ExposureNoise::Matched;
    let mut account =
        expose_account((width, height), 0, (is_matched, settings.optics.blurs()), thread_count(settings.threads));
    let bytes = u64::from(width) * u64::from(height) * 2;
    let phases = account.phases.len();
    // Once as planes, once as the array of a caller.
    account.add("frames", &vec![bytes.saturating_mul(2 * u64::from(settings.frames)); phases]);
    account.check(settings.memory_limit, 0, "expose fewer frames at a time")
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
/// A film without a sensor, and a `k` outside of [`NOISE_LEVELS`].
pub fn certify_film(saved: &SavedFilm, k: f64) -> Result<Certified, Error> {
    if !NOISE_LEVELS.contains(&k) {
        return Err(Error::setting("k", format!("{k} is out of range"), "use a number from 0.001 to 1000"));
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
