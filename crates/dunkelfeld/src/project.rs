//! A scene or job file with everything around it: one thing to open, adjust, render and save.

use crate::develop::{Frame, develop};
use crate::error::Error;
use crate::inspect::{Inspection, inspect};
use crate::outputs::{self, OutputPaths, Written};
use crate::progress::{Cancel, Progress, ProgressState, Silent, Stage};
use crate::render::{Rendering, render_rehearsed, thread_pool};
use crate::settings::{Budget, RenderSettings, SensorChoice};
use crate::stats::Stats;
use dunkelfeld_adaptive::allocation::Strategy;
use dunkelfeld_film::{Film, Plane};
use dunkelfeld_integrator::Label;
use dunkelfeld_io::import::{ImportOptions, Imported, load_scene};
use dunkelfeld_io::job::{self, Job};
use dunkelfeld_io::{ImportWarning, InputError};
use dunkelfeld_scene::{BuildReport, Projection, Scene, SceneBuilder};
use dunkelfeld_sensor::{Exposure, Optics, SensorModel};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// An opened scene or job.
#[derive(Debug)]
pub struct Project {
    /// The compiled scene.
    pub scene: Scene,
    /// What to render and how long; adjust before rendering.
    pub settings: RenderSettings,
    /// The files that the job names.
    pub outputs: OutputPaths,
    /// What was repaired or left out while reading.
    pub warnings: Vec<ImportWarning>,
    /// What building found.
    pub report: BuildReport,
    /// The lens of the job, or the default one: what a sensor that is chosen later stands behind.
    pub optics: Optics,
    started: Instant,
    load_seconds: f64,
    build_seconds: f64,
}

/// A rendered project.
#[derive(Debug)]
pub struct ProjectResult {
    /// Statistics of every pixel.
    pub rendering: Rendering,
    /// The exposed frame.
    pub frame: Frame,
    /// What was achieved. Complete once everything is written, see [`ProjectResult::save`].
    pub stats: Stats,
    settings: RenderSettings,
    object_names: Vec<String>,
    started: Instant,
}

impl Project {
    /// Opens a scene (`.gltf`, `.glb`, `.obj`) or a job (`.toml`). The time budget starts now.
    ///
    /// # Errors
    /// A file that cannot be used: the error names file, place and mend.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        Self::open_at(path.as_ref(), Instant::now())
    }

    /// Opens a project whose time budget started at `started`.
    ///
    /// # Errors
    /// As [`Project::open`].
    pub fn open_at(path: &Path, started: Instant) -> Result<Self, Error> {
        let began = Instant::now();
        let is_job = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
        let job = if is_job { Some(Job::from_file(path)?) } else { None };
        let optics = optics_of(&job.as_ref().map(|job| job.lens.clone()).unwrap_or_default())?;
        let (imported, settings, outputs) = match &job {
            Some(job) => open_job(job, optics)?,
            None => {
                let sensor = sensor_of(&job::SensorSettings::default(), optics)?;
                let settings = RenderSettings { sensor, ..RenderSettings::default() };
                (load_scene(path, &ImportOptions::default())?, settings, OutputPaths::default())
            }
        };
        let load_seconds = began.elapsed().as_secs_f64();
        let began = Instant::now();
        let (scene, report) = imported.scene.build()?;
        Ok(Self {
            scene,
            settings,
            outputs,
            warnings: imported.warnings,
            report,
            optics,
            started,
            load_seconds,
            build_seconds: began.elapsed().as_secs_f64(),
        })
    }

    /// What the scene holds, and what may trouble a render.
    pub fn inspect(&self) -> Inspection {
        let mut inspection = inspect(&self.scene, &self.report);
        inspection.warnings = self.warnings.iter().map(ToString::to_string).collect();
        inspection
    }

    /// Renders and exposes, in silence.
    ///
    /// # Errors
    /// As [`Project::render_with`].
    pub fn render(&self) -> Result<ProjectResult, Error> {
        self.render_with(&Silent, &Cancel::new())
    }

    /// Renders and exposes.
    ///
    /// # Errors
    /// Settings outside their range, an unknown camera, outputs that could not be written.
    pub fn render_with(&self, progress: &dyn Progress, cancel: &Cancel) -> Result<ProjectResult, Error> {
        self.outputs.check(matches!(self.settings.sensor, SensorChoice::Emva { .. }))?;
        let object_names = self.scene.object_names();
        let rehearsal = |film: &Film, labels: &Plane<Option<Label>>| {
            let frame = develop(&film.mean(), &self.settings)?;
            let settings = &self.settings;
            Written { film, labels, frame: &frame, settings, object_names }.save(&self.outputs)
        };
        let rendering = render_rehearsed(&self.scene, &self.settings, self.started, progress, cancel, &rehearsal)?;
        let began = Instant::now();
        progress.update(&ProgressState {
            stage: Stage::Expose,
            fraction: 1.0,
            elapsed: self.started.elapsed().as_secs_f64(),
            remaining: None,
            samples: rendering.film.total_samples(),
        });
        let mean = rendering.film.mean();
        let frame = thread_pool(self.settings.threads)?.install(|| develop(&mean, &self.settings))?;
        let mut stats = Stats::new(&rendering, &frame, &self.settings);
        stats.add_seconds(Stage::Load, self.load_seconds);
        stats.add_seconds(Stage::Build, self.build_seconds);
        stats.add_seconds(Stage::Expose, began.elapsed().as_secs_f64());
        stats.finish(self.started.elapsed().as_secs_f64());
        Ok(ProjectResult {
            rendering,
            frame,
            stats,
            settings: self.settings.clone(),
            object_names: object_names.to_vec(),
            started: self.started,
        })
    }
}

impl ProjectResult {
    /// Writes the 8-bit picture as PNG.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save_image(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        outputs::save_picture(&self.frame, path.as_ref())
    }

    /// Writes all outputs that are named, the statistics last: they tell how long all of it took.
    ///
    /// # Errors
    /// The first file that cannot be written; those before it are.
    pub fn save(&mut self, paths: &OutputPaths) -> Result<(), Error> {
        let began = Instant::now();
        let written = Written {
            film: &self.rendering.film,
            labels: &self.rendering.labels,
            frame: &self.frame,
            settings: &self.settings,
            object_names: &self.object_names,
        };
        written.save(paths)?;
        self.stats.add_seconds(Stage::Write, began.elapsed().as_secs_f64());
        self.stats.finish(self.started.elapsed().as_secs_f64());
        match &paths.stats {
            Some(path) => outputs::save_text(path, &self.stats.to_json()),
            None => Ok(()),
        }
    }
}

/// A sensor by preset name or file.
///
/// # Errors
/// There is neither, or the file is not a sensor.
pub fn find_sensor(name_or_path: &str) -> Result<SensorModel, Error> {
    Ok(dunkelfeld_io::sensor_file::find_sensor(name_or_path)?)
}

fn optics_of(lens: &job::LensSettings) -> Result<Optics, Error> {
    Ok(Optics::new(lens.f_number, lens.transmission, lens.magnification.unwrap_or(0.0))?)
}

fn open_job(job: &Job, optics: Optics) -> Result<(Imported, RenderSettings, OutputPaths), Error> {
    let mut imported = load_scene(&job.scene, &job.import_options())?;
    job.camera_index(&imported.scene)?;
    imported.warnings.extend(job.apply_overrides(&mut imported.scene)?);
    let defaults = RenderSettings::default();
    let height = job.film.height.unwrap_or(defaults.height);
    let sensor = sensor_of(&job.sensor, optics)?;
    set_lens(job, &mut imported.scene, &sensor, height);
    let settings = RenderSettings {
        width: job.film.width.unwrap_or(defaults.width),
        height,
        camera: job.camera.clone(),
        budget: Budget { seconds: job.budget.time.map(|t| t.as_secs_f64()), spp: job.budget.spp.map(f64::from) },
        strategy: match job.allocate.strategy {
            job::AllocateStrategy::Uniform => Strategy::Uniform,
            job::AllocateStrategy::Sobel => Strategy::Sobel,
        },
        pilot_spp: job.allocate.pilot_spp,
        sobel_floor: job.allocate.floor as f32,
        seed: job.seed,
        frame: job.frame,
        sensor,
        ..defaults
    };
    let o = &job.output;
    let outputs = OutputPaths {
        image: o.image.clone(),
        linear: o.linear.clone(),
        exr: o.exr.clone(),
        stats: o.stats.clone(),
        plan: o.plan.clone(),
    };
    Ok((imported, settings, outputs))
}

fn sensor_of(sensor: &job::SensorSettings, optics: Optics) -> Result<SensorChoice, Error> {
    let model = match &sensor.model {
        job::SensorChoice::None => return Ok(SensorChoice::None),
        job::SensorChoice::Preset(name) => dunkelfeld_io::sensor_file::preset(name)?,
        job::SensorChoice::File(path) => dunkelfeld_io::sensor_file::load_sensor(path)?,
    };
    let exposure = match sensor.exposure {
        job::Exposure::Auto => None,
        job::Exposure::Seconds(s) => Some(Exposure::new(dunkelfeld_radiometry::Seconds(s))?),
    };
    Ok(SensorChoice::Emva { model: Box::new(model), optics, exposure })
}

/// The job's lens sets the field of view of every perspective camera: the render uses one, whichever it is.
fn set_lens(job: &Job, scene: &mut SceneBuilder, sensor: &SensorChoice, height: u32) {
    let from_focal_length = job.lens.focal_length.and_then(|f| match sensor {
        SensorChoice::Emva { model, .. } => {
            let film_height = f64::from(height) * model.spec().pixel_pitch.0;
            Some(2.0 * (0.5 * film_height / f).atan())
        }
        SensorChoice::None => None,
    });
    if let Some(fov) = job.lens.vertical_fov.or(from_focal_length) {
        for camera in &mut scene.cameras {
            if let Projection::Perspective { vertical_fov } = &mut camera.projection {
                *vertical_fov = fov as f32;
            }
        }
    }
}

/// The picture's name when none is given: that of the input with `.png`, in the current folder.
pub fn default_image_path(input: &Path) -> PathBuf {
    PathBuf::from(input.file_stem().unwrap_or_else(|| "render".as_ref())).with_extension("png")
}

/// Reads a scene file without building it, for programs that want to change it first.
///
/// # Errors
/// A file that cannot be used.
pub fn read_scene(path: impl AsRef<Path>) -> Result<Imported, InputError> {
    load_scene(path.as_ref(), &ImportOptions::default())
}
