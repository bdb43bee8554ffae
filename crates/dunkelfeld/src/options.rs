//! Options of one render and of one exposure. Rust, Python and C give them the same names.

use crate::commands::expose::ExposeSettings;
use crate::denoising::{Denoised, denoise_film, find_denoiser};
use crate::expose_options::{ExposeOptions, no_sensor};
use crate::exposer::Exposer;
use crate::frame::{Picture, develop_film};
use crate::memory::expose_account;
use crate::outputs::{SavedPlan, load_plan_recorded};
use crate::project::{EachCapture, GivenSensor, Project, ProjectResult, Setup};
use crate::traced_sample::TracedSample;
use derive_setters::Setters;
use dunkelfeld_adaptive::budget::NOISE_LEVELS;
use dunkelfeld_film::Plane;
use dunkelfeld_integrator::PixelSample;
use dunkelfeld_io::input::InputFiles;
use dunkelfeld_io::toml_file::TomlFile;
use dunkelfeld_render::film_noise::Certified;
use dunkelfeld_render::{
    Budget, Cancel, CheckpointSettings, DenoiseSettings, Error, Progress, SavedFilm, SensorChoice, Session,
    thread_count,
};
use dunkelfeld_sensor::ExposureNoise;
use std::ops::Range;
use std::path::PathBuf;

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

/// What one render has in place of its project's. `None` leaves it as it is.
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_", strip_option, into)]
#[non_exhaustive]
pub struct RenderOptions {
    /// Keys of a job (`docs/job-file.md`) that do not change the scene, as lines of TOML: `budget.spp = 64`. They are
    /// merged as those of [`Project::set_overrides`]. With keys or a sensor the settings are those of the job: what the program
    /// has adjusted in [`Project::settings`] and could be a key counts no more.
    pub keys: String,
    /// A sensor in place of that of the job.
    pub sensor: Option<GivenSensor>,
    /// Name of the camera.
    pub camera: Option<String>,
    /// Number of threads; 0 means one per core.
    pub threads: Option<usize>,
    /// Range of the sample indices of a part of a render, which [`merge`](crate::commands::merge()) joins with others. It replaces budget and
    /// strategy.
    pub samples: Option<Range<u32>>,
    /// A plan that is rendered instead of budget and strategy.
    pub replay: Option<ReplayOption>,
    /// Path of the checkpoint. If the file exists, the render continues from it.
    pub checkpoint: Option<PathBuf>,
    /// Seconds between two checkpoints; 0 writes at every opportunity.
    pub checkpoint_every: Option<f64>,
}

impl RenderOptions {
    /// Do the keys set one of these?
    pub fn sets(&self, keys: &[[&str; 2]]) -> bool {
        let file = TomlFile::from_text("the keys", self.keys.as_str());
        keys.iter().any(|key| file.has_key(key))
    }

    /// The settings that a project has with these options.
    fn setup(self, project: &Project) -> Result<Setup, Error> {
        let is_limited = self.sets(&[["budget", "time"], ["budget", "spp"], ["budget", "noise"]]);
        let has_strategy = self.sets(&[["allocate", "strategy"]]);
        if self.replay.is_some() && (is_limited || has_strategy || self.sets(&[["budget", "share"]])) {
            let problem = "the samples are those of the plan, so that there is neither a limit nor a strategy";
            let help = "leave out time, spp, noise, share and strategy, or the plan";
            return Err(Error::setting("replay", problem, help));
        }
        let mut inputs = InputFiles::new();
        // Mere counts leave the training to the film.
        let is_trained = !matches!(self.replay, Some(ReplayOption::Samples(_)));
        let plan = self.replay.map(|replay| replay.plan(&mut inputs)).transpose()?;
        let of_plan = plan.as_ref().map_or_else(String::new, keys_of);
        let mut setup = match (of_plan.as_str(), self.keys.as_str(), self.sensor) {
            ("", "", None) => project.setup(),
            (of_plan, keys, sensor) => project.setup_with(&[of_plan, keys], sensor)?,
        };
        setup.inputs.extend(&inputs);
        let s = &mut setup.settings;
        if let Some(SavedPlan { samples, training_paths, .. }) = plan {
            s.budget = Budget::default();
            s.run.training_paths = is_trained.then_some(training_paths).or(s.run.training_paths);
            s.run.replay = Some(samples);
        }
        if self.samples.is_some() {
            // Those of the job are for the whole render.
            s.budget = if is_limited { s.budget } else { Budget::default() };
            s.strategy = s.strategy.filter(|_| has_strategy);
            s.run.samples = self.samples;
        }
        s.camera = self.camera.or(s.camera.take());
        s.run.threads = self.threads.unwrap_or(s.run.threads);
        s.run.checkpoint = self.checkpoint.map(CheckpointSettings::new).or(s.run.checkpoint.take());
        match (self.checkpoint_every, &mut s.run.checkpoint) {
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
        Ok(setup)
    }
}

impl ReplayOption {
    fn plan(self, inputs: &mut InputFiles) -> Result<SavedPlan, Error> {
        match self {
            Self::File(path) => load_plan_recorded(&path, inputs),
            Self::Plan(plan) => Ok(plan),
            Self::Samples(samples) => Ok(SavedPlan { samples, seed: None, frame: None, training_paths: 0 }),
        }
    }
}

/// The keys of a job that a plan sets.
fn keys_of(plan: &SavedPlan) -> String {
    let mut keys = format!("film.width = {}\nfilm.height = {}\n", plan.samples.width(), plan.samples.height());
    plan.seed.iter().for_each(|seed| keys += &format!("seed = \"{seed}\"\n"));
    plan.frame.iter().for_each(|frame| keys += &format!("frame = {frame}\n"));
    keys
}

impl Project {
    /// Replaces settings of the project by options. After an error the settings are as before.
    ///
    /// # Errors
    /// Keys and values that a job may not have, or that change the scene; a plan that does not exist; a replay with a limit
    /// or a strategy; an interval without a checkpoint.
    pub fn apply_options(&mut self, options: RenderOptions) -> Result<(), Error> {
        let setup = options.setup(self)?;
        self.set_up(setup);
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
        self.with_options(options, |project| project.render_with(progress, cancel))
    }

    /// [`Project::render_captures`] with options for this render. The settings of the project stay as they are.
    ///
    /// # Errors
    /// As [`Project::render_captures`] and [`Project::apply_options`], and a job without captures.
    pub fn render_captures_options(
        &mut self,
        options: RenderOptions,
        progress: &dyn Progress,
        cancel: &Cancel,
        each: &mut EachCapture<'_>,
    ) -> Result<(), Error> {
        if self.job.captures.is_empty() {
            return Err(Error::setting("capture", "the job has no captures", "add [[capture]], or render the scene"));
        }
        self.with_options(options, |project| project.render_captures(progress, cancel, each))
    }

    /// [`Project::trace_sample`] with options for this sample. The settings of the project stay as they are.
    ///
    /// # Errors
    /// As [`Project::trace_sample`] and [`Project::apply_options`].
    pub fn trace_options(&mut self, options: RenderOptions, at: PixelSample) -> Result<TracedSample, Error> {
        self.with_options(options, |project| project.trace_sample(at))
    }

    fn with_options<T>(
        &mut self,
        options: RenderOptions,
        work: impl FnOnce(&Self) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let (before, setup) = (self.setup(), options.setup(self)?);
        self.set_up(setup);
        let changed = Changed { project: self, before: Some(before) };
        work(changed.project)
    }
}

/// A project with other settings for a while, also if a panic ends it.
struct Changed<'a> {
    project: &'a mut Project,
    before: Option<Setup>,
}

impl Drop for Changed<'_> {
    fn drop(&mut self) {
        if let Some(before) = self.before.take() {
            self.project.set_up(before);
        }
    }
}

/// Grey values \[DN\] of `frames` frames of a film, from the first frame of the options on. Frames of one seed come from the
/// same device. `cancel` ends the exposure after a frame; then those until then are returned. Runs on the threads of the
/// current pool.
///
/// # Errors
/// As [`ExposeOptions::settings_of`]; settings outside their range; several frames with matched noise; more memory than the
/// system has.
pub fn expose_film(
    saved: &SavedFilm,
    options: &ExposeOptions,
    frames: u32,
    cancel: &Cancel,
) -> Result<Vec<Plane<u16>>, Error> {
    let settings = options.settings_of(saved)?.with_frames(frames);
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
    if options.is_plain(saved)? {
        let settings = saved.settings.clone().with_sensor(SensorChoice::None);
        return Ok(develop_film(&saved.film, &settings)?.picture);
    }
    let settings = options.settings_of(saved)?;
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
    let session = Session::new(saved.settings.run.threads)?;
    session
        .install(|| denoise_film(&saved.film.sums, &*denoiser, &session))
        .map_err(|e| Error::setting("denoise", e.to_string(), "use the denoiser `builtin`"))
}
