//! A scene or job file with its settings: it can be opened, adjusted, rendered and saved.

mod findings;

use crate::camera_fit::{DEFAULT_F_NUMBER, FilmSize, Fitted, Misfit, fit};
use crate::denoising::{denoise_frame, find_denoiser};
use crate::film_part::FilmPart;
use crate::frame::{Frame, develop_film};
use crate::guard::check_outputs;
use crate::inspect::{Inspection, camera_entry, inspect};
use crate::memory::{MemoryAccount, MemoryStats, RenderNeeds, render_account};
use crate::outputs::{self, OutputPaths, Written};
use crate::shutter::{check_shutter, expose_for, report_strobes, splitter_of};
use crate::stats::Stats;
use dunkelfeld_denoise::{Builtin, Denoiser as _};
use dunkelfeld_film::{Film, FilmLayers};
use dunkelfeld_io::import::{ImportOptions, Imported, load_scene};
use dunkelfeld_io::input::InputFiles;
use dunkelfeld_io::job::{self, FilmSettings, Job, LensSettings};
use dunkelfeld_io::{ImportWarning, InputError};
use dunkelfeld_radiometry::Seconds;
use dunkelfeld_render::{Budget, RenderSettings, SensorChoice};
use dunkelfeld_render::{Cancel, Progress, Silent, Stage};
use dunkelfeld_render::{DenoiseMethod, validate};
use dunkelfeld_render::{
    EXR_PER_MEGAPIXEL, OutputDryRun, RenderedFilm, Rendering, Session, camera, find_camera, render_with_dry_run,
    thread_count,
};
use dunkelfeld_render::{Error, camera_help};
use dunkelfeld_scene::{
    BuildError, BuildReport, Camera, CameraError, Distortion, Effect, Projection, Scene, Vignetting, framing_camera,
};
use dunkelfeld_sensor::{Exposure, Optics, SensorModel};
use std::path::Path;
use std::time::Instant;

/// An opened scene or job.
#[derive(Debug)]
pub struct Project {
    /// The compiled scene.
    pub scene: Scene,
    /// Settings of the render. Adjust them before rendering.
    pub settings: RenderSettings,
    /// The files that the job names.
    pub outputs: OutputPaths,
    /// Data that was repaired or left out during import.
    pub warnings: Vec<ImportWarning>,
    /// Findings of the scene builder. [`Project::findings`] adds those of the images.
    pub report: BuildReport,
    /// The lens of the job, or the default one. A sensor that is selected later uses it. Its magnification is that of
    /// the job. A render uses the magnification that follows from focus and field.
    pub optics: Optics,
    /// The lens of the job. It is combined with the camera when the project is rendered. Adjust it together with the
    /// settings.
    pub lens: LensSettings,
    /// The size of the film on the sensor, as far as the job contains it. Width and height are those of the settings.
    pub film: FilmSettings,
    /// The files that were read for it, or were to be read. An output must not replace one of them. Record files that
    /// are read later.
    pub inputs: InputFiles,
    /// Vignetting of all lenses, instead of their own.
    pub vignetting: Option<Vignetting>,
    /// For later errors.
    pub(crate) job: Option<Box<Job>>,
    /// The part of a larger film that is rendered, if the job describes one.
    part: Option<FilmPart>,
    /// Pixel pitch [m] of the job's own sensor. The lens keeps it when another command leaves the sensor out.
    own_pitch: Option<f64>,
    pub(crate) started: Instant,
    pub(crate) load_seconds: f64,
    pub(crate) build_seconds: f64,
}

/// A rendered project.
#[derive(Debug)]
pub struct ProjectResult {
    /// Statistics of every pixel.
    pub rendering: Rendering,
    /// The exposed frame.
    pub frame: Frame,
    /// The statistics. Complete once all outputs are written, see [`ProjectResult::save`].
    pub stats: Stats,
    settings: RenderSettings,
    is_vignetted: bool,
    session: Session<'static>,
    inputs: InputFiles,
    /// The outputs that were checked before the render.
    checked: OutputPaths,
}

impl Project {
    /// Opens a scene (`.gltf`, `.glb`, `.obj`, `.stl`, `.ply`) or a job (`.toml`). The time budget starts now.
    ///
    /// # Errors
    /// A file that cannot be used: the error names file, place and help.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        Self::open_at(path.as_ref(), Instant::now())
    }

    /// Opens a project whose time budget started at `started`.
    ///
    /// # Errors
    /// As [`Project::open`].
    pub fn open_at(path: &Path, started: Instant) -> Result<Self, Error> {
        Self::open_without(path, started, &[])
    }

    /// Opens a project and leaves out effects of its scene, see
    /// [`SceneBuilder::leave_out`](dunkelfeld_scene::SceneBuilder::leave_out). The outputs are marked.
    ///
    /// # Errors
    /// As [`Project::open`], and for an effect that cannot be left out.
    pub fn open_without(path: &Path, started: Instant, without: &[Effect]) -> Result<Self, Error> {
        let began = Instant::now();
        let is_job = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
        let job = if is_job { Some(Job::from_file(path)?) } else { None };
        let lens = job.as_ref().map(|job| job.lens.clone()).unwrap_or_default();
        let f_number = lens.f_number.unwrap_or(DEFAULT_F_NUMBER);
        let bands = job.as_ref().map(Job::bands).transpose()?.unwrap_or_default();
        let optics = Optics::new(f_number, lens.transmission, lens.magnification.unwrap_or(0.0))?.with_bands(bands);
        let mut inputs = job.as_ref().map(|job| job.inputs().clone()).unwrap_or_default();
        let (mut imported, mut settings, outputs) = match &job {
            Some(job) => open_job(job, optics, &mut inputs)?,
            None => {
                let sensor = sensor_of(&job::SensorSettings::default(), optics, &mut inputs)?;
                let settings = RenderSettings::default().with_sensor(sensor);
                (load_scene(path, &ImportOptions::default())?, settings, OutputPaths::default())
            }
        };
        inputs.extend(&imported.inputs);
        let mut left_out: Vec<Effect> = Vec::new();
        for &effect in without {
            // An effect that is given twice is left out once.
            if left_out.contains(&effect) {
                continue;
            }
            left_out.push(effect);
            if !imported.scene.leave_out(effect) {
                return Err(Error::setting(
                    "without",
                    format!(
                        "{} cannot be left out: it is not a part of the scene that can be taken away",
                        effect.name()
                    ),
                    "leave out another effect; `dunkelfeld inspect` lists those that the scene uses",
                ));
            }
        }
        settings.without = left_out;
        let load_seconds = began.elapsed().as_secs_f64();
        let began = Instant::now();
        let file = job.as_ref().map_or(path, Job::scene_path);
        let strobes = job.as_ref().and_then(|job| job.strobe_hazard(&imported.scene));
        let (scene, mut report) = imported.scene.build().map_err(|e| build_error(e, file))?;
        report_strobes(strobes, &mut report);
        Ok(Self {
            scene,
            own_pitch: pitch_of(&settings.sensor),
            part: job.as_ref().map(|job| film_part(job, &settings.sensor)).transpose()?.flatten(),
            vignetting: None,
            settings,
            outputs,
            warnings: imported.warnings,
            report,
            optics,
            lens,
            film: job.as_ref().map(|job| job.film.clone()).unwrap_or_default(),
            inputs,
            job: job.map(Box::new),
            started,
            load_seconds,
            build_seconds: began.elapsed().as_secs_f64(),
        })
    }

    /// The content of the scene, and its hazards.
    pub fn inspect(&self) -> Inspection {
        let mut inspection = inspect(&self.scene, &self.findings());
        let film = self.film_size();
        let fitted = |camera: &Camera| {
            fit(camera, &self.lens_of(&camera.name), film).map_or_else(|_| camera.clone(), |fitted| fitted.camera)
        };
        inspection.cameras = self.scene.cameras().iter().map(|camera| camera_entry(&fitted(camera))).collect();
        for camera in self.views() {
            match self.fit_settings(self.settings.clone().with_camera(camera)).map(|settings| settings.view) {
                Ok(view) => {
                    let lens = view.map(|v| v.lens).unwrap_or_default();
                    if lens.aperture.is_some() {
                        inspection.add_effect(Effect::FiniteAperture, "lens");
                    }
                    if !lens.distortion.is_none() {
                        inspection.add_effect(Effect::Distortion, "lens");
                    }
                }
                Err(e) => inspection.hazards.push(e.to_string().replace("\n  help: ", "; ")),
            }
        }
        inspection.memory = Some(self.memory());
        inspection.warnings = self.warnings.iter().map(ToString::to_string).collect();
        inspection
    }

    /// The settings of a render with the lens combined with its camera: with [`RenderSettings::view`] set, and with the
    /// f-number and magnification of the image for the sensor. Film and sensor are those of the settings as they are
    /// now.
    ///
    /// A view, or optics of the sensor, that were set by hand remain.
    ///
    /// # Errors
    /// Settings outside their range, an unknown camera, a lens that does not fit the camera, a distortion without an
    /// inverse on the film.
    pub fn fitted(&self) -> Result<RenderSettings, Error> {
        self.fit_settings(self.settings.clone())
    }

    fn fit_settings(&self, mut settings: RenderSettings) -> Result<RenderSettings, Error> {
        validate(&settings)?;
        check_shutter(&self.scene, &settings, self.job.as_deref())?;
        if settings.view.is_some() {
            return Ok(settings);
        }
        let camera = find_camera(&self.scene, &settings)?;
        let (lens, film) = (self.lens_of(&camera.name), self.film_size());
        let Fitted { camera: mut view, f_number, magnification } =
            fit(&camera, &lens, film).map_err(|misfit| self.misfit(&camera.name, misfit))?;
        self.scale_intrinsics(&mut view, film);
        view.window = self.part.and_then(|part| part.window(settings.width, settings.height));
        if let (true, Projection::Perspective { vertical_fov }) = (self.scene.cameras().is_empty(), view.projection) {
            // A view of the whole scene, also with this lens.
            let aspect = settings.width as f32 / settings.height as f32;
            view.to_world = framing_camera(self.scene.bounds(), aspect, f64::from(vertical_fov)).to_world;
        }
        if settings.without.contains(&Effect::FiniteAperture) {
            view.lens.aperture = None;
        }
        if settings.without.contains(&Effect::Distortion) {
            view.lens.distortion = Distortion::default();
        }
        if let Err(e) = self.scene.ray_generator(&view, settings.width, settings.height) {
            return Err(match &self.job {
                Some(job) if matches!(e, CameraError::NotInvertible { .. }) && lens.distortion.is_some() => {
                    job.lens_error(&camera.name, "distortion", e.to_string(), camera_help(&e)).into()
                }
                _ => e.into(),
            });
        }
        settings.view = Some(view);
        if let SensorChoice::Emva { optics, .. } = &mut settings.sensor
            && *optics == self.optics
        {
            let (splitter, bands) = match &self.job {
                Some(job) => (splitter_of(job, &self.scene, &camera.name), job.bands_behind(&lens)?),
                None => (1.0, optics.bands()),
            };
            *optics = Optics::new(f_number, lens.transmission * splitter, magnification)?.with_bands(bands);
        }
        if let (SensorChoice::Emva { model, .. }, Some(part)) = (&mut settings.sensor, self.part) {
            **model = model.binned(part.binning)?;
            settings.readout.binning = part.binning;
        }
        Ok(settings)
    }

    /// The lens of a camera: its own in the job, or that of the project.
    fn lens_of(&self, camera: &str) -> LensSettings {
        let defined = self.job.as_ref().and_then(|job| job.camera_settings(camera));
        let mut lens = defined.map_or_else(|| self.lens.clone(), |camera| camera.lens_or(&self.lens));
        lens.vignetting = self.vignetting.or(lens.vignetting);
        lens
    }

    /// `K` refers to the film of the job. On a film with another number of rows the field of view stays, so that the
    /// principal point moves with the size of a pixel.
    fn scale_intrinsics(&self, view: &mut Camera, film: FilmSize) {
        let Some(job) = &self.job else { return };
        if job.camera_settings(&view.name).is_some_and(|camera| camera.intrinsics.is_some()) {
            let scale = f64::from(film.height) / f64::from(whole_film(job, self.part)[1]);
            view.lens.principal_point = view.lens.principal_point.map(|offset| offset * scale);
        }
    }

    /// Leaves sums out of the film that neither the outputs nor the denoiser need ([`RenderSettings::layers`]). Call it
    /// after both are set, and only if no other data of the film is needed.
    pub fn keep_needed_layers(&mut self) {
        let are_needed = self.outputs.exr.is_some() || self.settings.denoise.method != DenoiseMethod::Off;
        self.settings.layers = if are_needed { FilmLayers::All } else { FilmLayers::Image };
    }

    /// Changes the number of pixels for the same field of view: pixels become larger as their number decreases.
    pub fn resize_keeping_view(&mut self, width: u32, height: u32) {
        if self.part.is_none() {
            let before = self.film_size();
            let growth = f64::from(before.width) / f64::from(width.max(1));
            self.film.pixel_pitch = before.pitch.map(|pitch| pitch * growth);
        }
        (self.settings.width, self.settings.height) = (width, height);
    }

    /// Gives the film the resolution of the present sensor, if the job sets `full`. Call it after another sensor is
    /// selected.
    ///
    /// # Errors
    /// A sensor without a resolution, or one that is smaller than the region of the job.
    pub fn refit_film(&mut self) -> Result<(), Error> {
        let Some(job) = self.job.as_ref().filter(|job| job.film.full && self.settings.has_sensor()) else {
            return Ok(());
        };
        self.part = film_part(job, &self.settings.sensor)?;
        if let Some(part) = self.part {
            [self.settings.width, self.settings.height] = part.size();
        }
        Ok(())
    }

    /// Takes all settings, but not the scene, from another project.
    pub fn take_settings_of(&mut self, other: &Self) {
        self.settings = other.settings.clone();
        self.lens = other.lens.clone();
        self.film = other.film.clone();
        self.optics = other.optics;
        self.own_pitch = other.own_pitch;
        self.part = other.part;
        self.vignetting = other.vignetting;
    }

    /// The memory account of a render with the present settings.
    pub fn memory(&self) -> MemoryAccount {
        self.account(&self.settings).1
    }

    fn account(&self, settings: &RenderSettings) -> (u64, MemoryAccount) {
        let threads = thread_count(settings.threads);
        render_account(RenderNeeds { scene: &self.scene.summary(), settings, outputs: &self.outputs, threads })
    }

    /// The account of a render that may begin.
    pub fn checked_account(&self, settings: &RenderSettings) -> Result<MemoryAccount, Error> {
        let (held, account) = self.account(settings);
        let help = "render fewer pixels (--width, --height), without --exr or a denoiser, or with smaller textures";
        account.check(settings.memory_limit, held, help)?;
        Ok(account)
    }

    fn film_size(&self) -> FilmSize {
        let [width, height] = self.part.map_or([self.settings.width, self.settings.height], |part| part.whole);
        let pitch = self
            .film
            .pixel_pitch
            .or(self.film.sensor_width.map(|w| w / f64::from(width)))
            .or(self.film.sensor_height.map(|h| h / f64::from(height)))
            .or(pitch_of(&self.settings.sensor))
            .or(self.own_pitch);
        FilmSize { width, height, pitch }
    }

    fn misfit(&self, camera: &str, misfit: Misfit) -> Error {
        match &self.job {
            Some(job) => job.lens_error(camera, misfit.key, misfit.problem, misfit.help).into(),
            None => Error::setting(format!("lens {}", misfit.key), misfit.problem, misfit.help),
        }
    }

    /// Renders and exposes, without progress.
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
        let quiet = Session::new(self.settings.threads)?.with_start(self.started);
        let session = quiet.clone().with_progress(progress).with_cancel(cancel);
        let mut inputs = self.inputs.clone();
        inputs.add_library(self.settings.denoise.oidn.as_deref());
        let checkpoint = self.settings.checkpoint.as_ref().map(|keep| keep.path.as_path());
        self.outputs.check_beside(self.settings.has_sensor(), checkpoint, &inputs)?;
        let mut settings = self.fitted()?;
        let denoiser = find_denoiser(&settings.denoise)?;
        if denoiser.as_ref().is_some_and(|d| d.name() == Builtin.name()) {
            // The time reserved for it is less.
            settings.denoise.method = DenoiseMethod::Builtin;
        }
        let account = self.checked_account(&settings)?;
        let denoise = |frame: &mut Frame, film: &Film, session: &Session<'_>| match &denoiser {
            Some(denoiser) => denoise_frame(frame, film, &**denoiser, &settings, session).map(Some),
            None => Ok(None),
        };
        let is_vignetted = camera(&self.scene, &settings)?.has_vignetting();
        let silent = quiet.clone().with_cancel(cancel);
        let dry_run = |film: &RenderedFilm| {
            let mut frame = develop_film(film, &settings)?;
            denoise(&mut frame, &film.sums, &silent)?;
            Written { film, frame: &frame, settings: &settings, is_vignetted }.save(&self.outputs)
        };
        let more_per_megapixel = if self.outputs.exr.is_some() { EXR_PER_MEGAPIXEL } else { 0.0 };
        let end = OutputDryRun { more_per_megapixel, write: &dry_run };
        let mut rendering = render_with_dry_run(&self.scene, &settings, &session, end)?;
        let began = Instant::now();
        session.begin(Stage::Expose, 1.0, rendering.film.sums.total_samples());
        let mut frame = session.install(|| develop_film(&rendering.film, &settings))?;
        let exposed = began.elapsed().as_secs_f64();
        let denoising = session.install(|| denoise(&mut frame, &rendering.film.sums, &session))?;
        if denoising.as_ref().is_some_and(|d| d.error.is_some()) {
            rendering.interrupted |= cancel.is_cancelled();
        }
        let mut stats = session.install(|| Stats::new(&rendering, &frame, &settings));
        stats.memory = Some(MemoryStats::new(account, &rendering.film.sums));
        stats.add_seconds(Stage::Load, self.load_seconds);
        stats.add_seconds(Stage::Build, self.build_seconds);
        stats.add_seconds(Stage::Expose, exposed);
        denoising.into_iter().for_each(|d| stats.add_denoising(d));
        stats.finish(session.elapsed());
        Ok(ProjectResult {
            rendering,
            frame,
            stats,
            settings,
            is_vignetted,
            session: quiet,
            inputs,
            checked: self.outputs.clone(),
        })
    }
}

impl ProjectResult {
    /// Writes the 8-bit picture as PNG.
    ///
    /// # Errors
    /// If it is an input of the render, or cannot be written.
    pub fn save_image(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        if self.checked.image.as_deref() != Some(path.as_ref()) {
            check_outputs(&[("the image", path.as_ref())], &self.inputs)?;
        }
        outputs::save_picture(&self.frame, path.as_ref())
    }

    /// Writes all outputs. The statistics are last, because they contain the time of all outputs.
    ///
    /// # Errors
    /// An output that is an input of the render, or the first file that cannot be written. Earlier files remain.
    pub fn save(&mut self, paths: &OutputPaths) -> Result<(), Error> {
        let began = Instant::now();
        // A path that passed the check before the render is not refused after it.
        if *paths != self.checked {
            check_outputs(&paths.named(), &self.inputs)?;
        }
        let written = Written {
            film: &self.rendering.film,
            frame: &self.frame,
            settings: &self.settings,
            is_vignetted: self.is_vignetted,
        };
        self.session.install(|| written.save(paths))?;
        self.stats.add_seconds(Stage::Write, began.elapsed().as_secs_f64());
        self.stats.finish(self.session.elapsed());
        match &paths.stats {
            Some(path) => outputs::save_text(path, &self.stats.to_json()),
            None => Ok(()),
        }
    }
}

/// A sensor by preset name or file.
///
/// # Errors
/// Neither a preset nor a file has this name, or the file is not a sensor.
pub fn find_sensor(name_or_path: &str) -> Result<SensorModel, Error> {
    Ok(dunkelfeld_io::sensor_file::find_sensor(name_or_path)?)
}

/// [`find_sensor`], and records the file as an input of a run.
///
/// # Errors
/// As [`find_sensor`].
pub fn find_sensor_recorded(name_or_path: &str, inputs: &mut InputFiles) -> Result<SensorModel, Error> {
    Ok(dunkelfeld_io::sensor_file::find_sensor_recorded(name_or_path, inputs)?)
}

fn pitch_of(sensor: &SensorChoice) -> Option<f64> {
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
        other => other.into(),
    }
}

fn open_job(
    job: &Job,
    optics: Optics,
    inputs: &mut InputFiles,
) -> Result<(Imported, RenderSettings, OutputPaths), Error> {
    let mut imported = job.load_scene()?;
    let sensor = sensor_of(&job.sensor, optics, inputs).map_err(|e| match e {
        Error::Input(e) => job.sensor_error(e).into(),
        e => e,
    })?;
    let part = film_part(job, &sensor)?;
    imported.warnings.extend(job.apply_overrides(&mut imported.scene)?);
    job.apply_intrinsics(&mut imported.scene, whole_film(job, part));
    job.camera_index(&imported.scene)?;
    let [width, height] = part.map_or_else(|| whole_film(job, part), |part| part.size());
    let budget = Budget::default()
        .with_seconds(job.budget.time.map(|t| t.as_secs_f64()))
        .with_spp(job.budget.spp)
        .with_noise(job.budget.noise);
    let settings = RenderSettings::default()
        .with_width(width)
        .with_height(height)
        .with_camera(job.camera.selected.clone())
        .with_budget(budget)
        .with_memory_limit(job.budget.memory)
        .with_strategy(job.allocate.strategy)
        .with_pilot_spp(job.allocate.pilot_spp)
        .with_sobel_floor(job.allocate.floor as f32)
        .with_seed(job.seed)
        .with_frame(job.frame)
        .with_sensor(sensor)
        .with_exposure_noise(job.sensor.exposure_noise)
        .with_denoise(job.denoise.clone());
    imported.scene.shutter = job.shutter(&imported.scene, settings.height)?;
    let settings = match imported.scene.shutter {
        Some(_) => expose_for(settings, imported.scene.shutter.as_ref(), job)?,
        None => settings,
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

/// The part of a larger film that a job describes.
fn film_part(job: &Job, sensor: &SensorChoice) -> Result<Option<FilmPart>, Error> {
    let film = &job.film;
    if !film.full && film.roi.is_none() && film.binning.is_none() {
        return Ok(None);
    }
    let part = FilmPart::new(film, sensor);
    part.map(Some).map_err(|(key, problem, help)| job.film_error(key, problem, help).into())
}

/// Width and height of the whole film of a job \[pixels\].
fn whole_film(job: &Job, part: Option<FilmPart>) -> [u32; 2] {
    let defaults = RenderSettings::default();
    let given = [job.film.width.unwrap_or(defaults.width), job.film.height.unwrap_or(defaults.height)];
    part.map_or(given, |part| part.whole)
}

fn sensor_of(sensor: &job::SensorSettings, optics: Optics, inputs: &mut InputFiles) -> Result<SensorChoice, Error> {
    let model = match &sensor.model {
        job::SensorChoice::None => return Ok(SensorChoice::None),
        job::SensorChoice::Preset(name) => dunkelfeld_io::sensor_file::preset(name)?,
        job::SensorChoice::File(path) => dunkelfeld_io::sensor_file::load_sensor_recorded(path, inputs)?,
    };
    let exposure = match sensor.exposure {
        job::Exposure::Auto => None,
        job::Exposure::Seconds(s) => Some(Exposure::new(Seconds(s))?),
    };
    Ok(SensorChoice::Emva { model: Box::new(model), optics, exposure })
}

/// Reads a scene file without building it, for programs that change it first.
///
/// # Errors
/// A file that cannot be used.
pub fn read_scene(path: impl AsRef<Path>) -> Result<Imported, InputError> {
    load_scene(path.as_ref(), &ImportOptions::default())
}
