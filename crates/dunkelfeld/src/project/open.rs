//! Opens a scene or a job: reads its files, compiles the scene, and derives the settings.

use super::overrides::Description;
use super::{CommandClock, Project};
use crate::film_part::FilmPart;
use crate::outputs::OutputPaths;
use crate::shutter::{expose_for, report_strobes};
use derive_setters::Setters;
use dunkelfeld_adaptive::Strategy;
use dunkelfeld_io::import::{Imported, load_scene};
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_io::job::{self, FilmSettings, Job, LensSettings};
use dunkelfeld_io::{ImportWarning, InputError};
use dunkelfeld_radiometry::{Celsius, DigitalNumber, Seconds};
use dunkelfeld_render::{Budget, DEFAULT_F_NUMBER, Error, RenderSettings, SensorChoice, check_threads};
use dunkelfeld_scene::{BuildCache, BuildError, BuildReport, Effect, Scene, SceneBuilder};
use dunkelfeld_sensor::{Exposure, ExposureNoise, Optics, Published, SensorModel};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// How a project is opened.
#[derive(Clone, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ProjectOptions {
    /// The start of the command, from which the time budget of its render counts. By default the clock of each render
    /// starts with it.
    #[setters(into)]
    pub started: Option<Instant>,
    /// Effects of the scene to leave out, see [`SceneBuilder::leave_out`](dunkelfeld_scene::SceneBuilder::leave_out). The
    /// outputs are marked.
    pub without: Vec<Effect>,
    /// Keep the description of the scene, so that [`Project::set_overrides`] can change it. It takes the memory of the
    /// meshes once more. Default true.
    pub can_change: bool,
    /// Number of threads that build the scene, and that render it unless
    /// [`RunSettings::threads`](dunkelfeld_render::RunSettings::threads) is changed; 0 means one per core, the default.
    pub threads: usize,
    /// Keys of a job that replace those of the file, as in [`Project::set_overrides`].
    #[setters(into)]
    pub keys: String,
}

impl Default for ProjectOptions {
    fn default() -> Self {
        Self { started: None, without: Vec::new(), can_change: true, threads: 0, keys: String::new() }
    }
}

/// A compiled job.
#[derive(Debug)]
pub(super) struct Compiled {
    pub(super) scene: Scene,
    pub(super) report: BuildReport,
    pub(super) setup: Setup,
    pub(super) build_seconds: f64,
}

/// A sensor that a program has made, or read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct GivenSensor {
    /// The model.
    pub model: SensorModel,
    /// The file that it was read from, which no output may replace.
    pub file: Option<PathBuf>,
}

/// What a job says of its render beside the scene.
#[derive(Clone, Debug)]
pub(crate) struct Setup {
    pub(crate) job: Box<Job>,
    pub(crate) settings: RenderSettings,
    pub(crate) outputs: OutputPaths,
    pub(crate) optics: Optics,
    pub(crate) lens: LensSettings,
    pub(crate) film: FilmSettings,
    pub(crate) part: Option<FilmPart>,
    pub(crate) own_pitch: Option<f64>,
    pub(crate) inputs: InputFiles,
    pub(crate) warnings: Vec<ImportWarning>,
}

impl Project {
    /// Opens a scene (`.gltf`, `.glb`, `.obj`, `.stl`, `.ply`) or a job (`.toml`).
    ///
    /// # Errors
    /// A file that cannot be used: the error names file, place and help.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        Self::open_with(path, ProjectOptions::default())
    }

    /// [`Project::open`] with options.
    ///
    /// # Errors
    /// As [`Project::open`], for an effect that cannot be left out, and for too many threads.
    pub fn open_with(path: impl AsRef<Path>, options: ProjectOptions) -> Result<Self, Error> {
        Self::open_recorded(path, options, &mut InputFiles::new())
    }

    /// [`Project::open_with`], and records the files that are read or requested, also if an error ends it: then as far as
    /// they are known. Such a file may have the fault.
    ///
    /// # Errors
    /// As [`Project::open_with`].
    pub fn open_recorded(
        path: impl AsRef<Path>,
        options: ProjectOptions,
        inputs: &mut InputFiles,
    ) -> Result<Self, Error> {
        let path = path.as_ref();
        let began = Instant::now();
        let is_job = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
        inputs.add(path, if is_job { Role::Job } else { Role::Scene });
        let job = if is_job { Job::from_file(path)? } else { Job::of_scene(path)? };
        inputs.extend(job.inputs());
        let opened = Self::of_job(job, is_job, began, options, inputs);
        if let Ok(project) = &opened {
            inputs.extend(&project.inputs);
        }
        opened
    }

    /// Opens a job from a text. Messages name `path`, and input paths of the job are relative to its folder. The file need
    /// not exist.
    ///
    /// ```
    /// let text = "scene = 'none'\nfilm = { width = 16, height = 16 }\nbudget = { spp = 4 }\n\
    ///     camera = { look_at = [0, 0, 0], position = [0, 0.3, 0.4] }\n\
    ///     [[object]]\nname = 'ball'\nkind = 'sphere'\ndiameter = '100mm'\n\
    ///     [environment]\nradiance = 1\n";
    /// let result = dunkelfeld::Project::from_text("ball.toml", text)?.render()?;
    /// assert_eq!(result.rendering.film.sums.total_samples(), 4 * 16 * 16);
    /// # Ok::<(), dunkelfeld::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Project::open`].
    pub fn from_text(path: impl AsRef<Path>, text: &str) -> Result<Self, Error> {
        Self::from_text_with(path, text, ProjectOptions::default())
    }

    /// [`Project::from_text`] with options.
    ///
    /// # Errors
    /// As [`Project::open_with`].
    pub fn from_text_with(path: impl AsRef<Path>, text: &str, options: ProjectOptions) -> Result<Self, Error> {
        let began = Instant::now();
        let job = Job::from_text(path.as_ref(), text)?;
        Self::of_job(job, true, began, options, &mut InputFiles::new())
    }

    fn of_job(
        job: Job,
        has_job_file: bool,
        began: Instant,
        options: ProjectOptions,
        read: &mut InputFiles,
    ) -> Result<Self, Error> {
        let ProjectOptions { started, without, can_change, threads, keys } = options;
        check_threads(threads)?;
        let job = if keys.is_empty() { job } else { job.with_overrides(&keys)? };
        read.extend(job.inputs());
        let imported = match has_job_file {
            true => job.load_scene(),
            // Errors about the file that the caller has named show no text of a job.
            false => load_scene(job.scene_path(), &job.import_options()),
        };
        let imported = imported.inspect_err(|e| e.read_files().for_each(|path| read.add(path, Role::Scene)))?;
        read.extend(&imported.inputs);
        let mut description = None;
        let compiled = if can_change {
            let mut cache = BuildCache::default();
            let mut compiled = compile(&job, imported.clone(), (&without, threads), Some(&mut cache))?;
            compiled.scene.report_hazards(&mut compiled.report);
            description = Some(Box::new(Description { base: job.clone(), imported, without, cache }));
            compiled
        } else {
            compile(&job, imported, (&without, threads), None)?
        };
        let Compiled { scene, report, setup, build_seconds } = compiled;
        let load_seconds = began.elapsed().as_secs_f64() - build_seconds;
        let Setup { job, settings, outputs, optics, lens, film, part, own_pitch, inputs, warnings } = setup;
        Ok(Self {
            scene,
            own_pitch,
            part,
            settings,
            outputs,
            warnings,
            report,
            optics,
            lens,
            film,
            inputs,
            job,
            has_job_file,
            command: started.map(|started| CommandClock { started, load_seconds, build_seconds }),
            description,
            has_all_findings: true,
        })
    }
}

/// The effects that a scene can be rendered without ([`ProjectOptions::without`]).
pub fn removable_effects() -> Vec<Effect> {
    // An empty scene can leave out all effects that any scene can.
    Effect::ALL.into_iter().filter(|&effect| SceneBuilder::default().leave_out(effect)).collect()
}

/// Compiles an imported scene with the changes of its job, without some effects and on so many threads.
pub(super) fn compile(
    job: &Job,
    imported: Imported,
    options: (&[Effect], usize),
    cache: Option<&mut BuildCache>,
) -> Result<Compiled, Error> {
    compile_and(job, imported, options, cache, |_| Ok(()))
}

/// [`compile`] with a change of the description after those of the job.
pub(super) fn compile_and(
    job: &Job,
    mut imported: Imported,
    (without, threads): (&[Effect], usize),
    cache: Option<&mut BuildCache>,
    edit: impl FnOnce(&mut SceneBuilder) -> Result<(), Error>,
) -> Result<Compiled, Error> {
    let mut setup = resolve(job, None, job.inputs().clone())?;
    let scene = &mut imported.scene;
    setup.warnings = imported.warnings;
    setup.warnings.extend(job.apply_overrides(scene)?);
    job.apply_intrinsics(scene, whole_film(job, setup.part));
    job.camera_index(scene)?;
    scene.shutter = job.shutter(scene, setup.settings.height)?;
    expose_for(&mut setup.settings, scene.shutter.as_ref(), job)?;
    setup.inputs.extend(&imported.inputs);
    setup.settings.run.threads = threads;
    edit(scene)?;
    scene.threads = threads;
    for &effect in without {
        // An effect that is given twice is left out once.
        if setup.settings.run.without.contains(&effect) {
            continue;
        }
        setup.settings.run.without.push(effect);
        if !scene.leave_out(effect) {
            let problem =
                format!("{} cannot be left out: it is not a part of the scene that can be taken away", effect.name());
            let help = "leave out another effect; `dunkelfeld inspect` lists those that the scene uses";
            return Err(Error::setting("without", problem, help));
        }
    }
    let strobes = job.strobe_hazard(scene);
    let began = Instant::now();
    let built = match cache {
        Some(cache) => imported.scene.build_with(cache),
        None => imported.scene.build(),
    };
    let (scene, mut report) = built.map_err(|e| build_error(e, job.scene_path()))?;
    report_strobes(strobes, &mut report);
    Ok(Compiled { scene, report, setup, build_seconds: began.elapsed().as_secs_f64() })
}

/// The settings of a job: a function of the job, of a sensor in place of that of the job, and of the files of both. They
/// are added to `inputs`.
pub(super) fn resolve(job: &Job, given: Option<GivenSensor>, mut inputs: InputFiles) -> Result<Setup, Error> {
    let lens = job.lens.clone();
    let f_number = lens.f_number.unwrap_or(DEFAULT_F_NUMBER);
    let optics = Optics::new(f_number, lens.transmission, lens.magnification.unwrap_or(0.0))?.with_bands(job.bands()?);
    let is_given = given.is_some();
    let own = sensor_of(&job.sensor, given, optics.clone(), &mut inputs).map_err(|e| match e {
        Error::Input(e) => job.sensor_error(e).into(),
        e => e,
    })?;
    let own_pitch = pitch_of(&own);
    let part = film_part(job, &own)?;
    let sensor = if job.sensor.expose || is_given { own } else { SensorChoice::None };
    let has_sensor = sensor != SensorChoice::None;
    let [width, height] = part.map_or_else(|| whole_film(job, part), |part| part.size());
    let budget = Budget::default()
        .with_seconds(job.budget.time.map(|t| t.as_secs_f64()))
        .with_spp(job.budget.spp)
        .with_noise(job.budget.noise)
        .with_share(job.budget.share);
    // The data of this strategy are those of a sensor.
    let strategy = job.allocate.strategy.filter(|s| has_sensor || job.sensor.expose || *s != Strategy::Sensor);
    let settings = RenderSettings::without_sensor()
        .with_width(job.size[0].unwrap_or(width))
        .with_height(job.size[1].unwrap_or(height))
        .with_camera(job.camera.selected.clone())
        .with_budget(budget)
        .with_memory_limit(job.budget.memory)
        .with_strategy(strategy)
        .with_pilot_spp(job.allocate.pilot_spp)
        .with_sobel_floor(job.allocate.floor as f32)
        .with_seed(job.seed)
        .with_frame(job.frame)
        .with_sensor(sensor)
        .with_exposure_noise(if has_sensor { job.sensor.exposure_noise } else { ExposureNoise::Plain })
        .with_denoise(job.denoise.clone());
    let outputs = OutputPaths::of_job(job);
    let (job, film, warnings) = (Box::new(job.clone()), job.film.clone(), Vec::new());
    Ok(Setup { job, settings, outputs, optics, lens, film, part, own_pitch, inputs, warnings })
}

/// The part of a larger film that a job describes.
pub(super) fn film_part(job: &Job, sensor: &SensorChoice) -> Result<Option<FilmPart>, Error> {
    let film = &job.film;
    if !film.full && film.roi.is_none() && film.binning.is_none() {
        return Ok(None);
    }
    let part = FilmPart::new(film, sensor);
    part.map(Some).map_err(|e| job.film_error(e).into())
}

/// Width and height of the whole film of a job \[pixels\].
pub(super) fn whole_film(job: &Job, part: Option<FilmPart>) -> [u32; 2] {
    let defaults = RenderSettings::without_sensor();
    let given = [job.film.width.unwrap_or(defaults.width), job.film.height.unwrap_or(defaults.height)];
    part.map_or(given, |part| part.whole)
}

/// The sensor of a job, or another one. Its files are added to `inputs`.
pub(crate) fn sensor_of(
    sensor: &job::SensorSettings,
    given: Option<GivenSensor>,
    optics: Optics,
    inputs: &mut InputFiles,
) -> Result<SensorChoice, Error> {
    let model = match (given, &sensor.model) {
        (Some(given), _) => {
            given.file.iter().for_each(|file| inputs.add(file, Role::Sensor));
            given.model
        }
        (None, job::SensorChoice::None) => return Ok(SensorChoice::None),
        (None, job::SensorChoice::Preset(name)) => adjusted(dunkelfeld_io::sensor_file::preset(name)?, sensor)?,
        (None, job::SensorChoice::File(path)) => {
            adjusted(dunkelfeld_io::sensor_file::load_sensor_recorded(path, inputs)?, sensor)?
        }
    };
    Ok(SensorChoice::Emva { model: Box::new(model), optics, exposure: exposure_of(sensor)? })
}

/// The exposure time of a job; `None` is the automatic one.
pub(crate) fn exposure_of(sensor: &job::SensorSettings) -> Result<Option<Exposure>, Error> {
    seconds_of(sensor.exposure)
}

/// The exposure of a key; `None` for automatic exposure.
pub(super) fn seconds_of(exposure: job::Exposure) -> Result<Option<Exposure>, Error> {
    match exposure {
        job::Exposure::Auto => Ok(None),
        job::Exposure::Seconds(s) => Ok(Some(Exposure::new(Seconds(s))?)),
    }
}

/// A sensor with the gain, the temperature and the black level of a job.
fn adjusted(model: SensorModel, sensor: &job::SensorSettings) -> Result<SensorModel, Error> {
    if (sensor.gain, sensor.temperature, sensor.black_level) == (None, None, None) {
        return Ok(model);
    }
    let mut spec = model.spec().clone();
    spec.system_gain *= sensor.gain.unwrap_or(1.0);
    spec.temperature = sensor.temperature.map_or(spec.temperature, Celsius);
    if let Some(level) = sensor.black_level {
        let most = (0.9 * f64::from(model.max_value())).floor();
        if level > most {
            let problem = format!("the offset {level} DN is above 90 % of the largest grey value");
            return Err(Error::setting("[sensor] black_level", problem, format!("write 0 to {most}")));
        }
        spec.offset = DigitalNumber(level);
    }
    // Figures were published for the sensor as it is.
    spec.published = Published::default();
    Ok(SensorModel::new(spec)?)
}

/// Pixel pitch \[m\] of a sensor.
pub(super) fn pitch_of(sensor: &SensorChoice) -> Option<f64> {
    match sensor {
        SensorChoice::Emva { model, .. } => Some(model.spec().pixel_pitch.0),
        SensorChoice::None => None,
    }
}

/// The error of a scene that cannot be built, with its file where the file has the fault.
fn build_error(error: BuildError, file: &Path) -> Error {
    match error {
        BuildError::NothingLeft { ref lost } => {
            let problem = format!("no triangle is left, so that there is nothing to render: {lost}");
            InputError::new(file, "the scene", problem, "export the scene again with triangles that have an area")
                .into()
        }
        BuildError::TooLarge { ref place, ref radius } => {
            let problem = format!(
                "the scene extends to {radius} from its centre, where squared distances exceed the range of f32, \
                 and this object farthest"
            );
            InputError::new(file, place, problem, "remove the object, or export with the right unit of length").into()
        }
        BuildError::TooDense { ref place, ref problem, help } => InputError::new(file, place, problem, help).into(),
        other => other.into(),
    }
}
