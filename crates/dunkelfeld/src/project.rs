//! A scene or job file with its settings: it can be opened, adjusted, rendered and saved.

mod captures;
mod findings;
mod open;
mod overrides;
mod rendering;

pub use open::{GivenSensor, ProjectOptions, removable_effects};
pub(crate) use open::{Setup, exposure_of, sensor_of};
use open::{pitch_of, resolve, whole_film};
use overrides::Description;
pub use rendering::EachCapture;

use crate::camera_fit::{FilmSize, Fitted, fit};
use crate::film_part::FilmPart;
use crate::frame::Frame;
use crate::guard::check_outputs;
use crate::inspect::{Inspection, camera_entry, inspect_lines};
use crate::memory::{KeptFilms, MemoryAccount, RenderNeeds, render_account};
use crate::outputs::{self, OutputPaths, Written};
use crate::shutter::{TimedExposure, check_shutter, expose_for, splitter_of, timed_exposure};
use crate::stats::Stats;
use dunkelfeld_film::FilmLayers;
use dunkelfeld_io::ImportWarning;
use dunkelfeld_io::InputError;
use dunkelfeld_io::input::InputFiles;
use dunkelfeld_io::job::{DEFAULT_SENSOR, FilmSettings, Job, LensSettings};
use dunkelfeld_render::{
    DenoiseMethod, Error, RenderSettings, Rendering, SavedFilm, SensorChoice, Session, Stage, camera_help, find_camera,
    thread_count, validate,
};
use dunkelfeld_scene::{BuildReport, Camera, CameraError, Distortion, Effect, Projection, Scene, framing_camera};
use dunkelfeld_sensor::{Optics, SensorModel};
use std::path::Path;
use std::time::Instant;

/// The hint for a lens whose veiling glare is not set.
const NO_GLARE: &str =
    "lens: its image has no veiling glare; real lenses have 1 to 3 % (ISO 9358); `glare = 0.02` in [lens] sets it";

/// An opened scene or job. It can be rendered as often as needed: with other settings, and with changes of the scene
/// ([`Project::set_overrides`]).
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
    /// The job as it is now; that of a scene file contains no more than its path.
    pub(crate) job: Box<Job>,
    has_job_file: bool,
    /// The part of a larger film that is rendered, if the job describes one.
    part: Option<FilmPart>,
    /// Pixel pitch [m] of the job's own sensor. The lens keeps it when another command leaves the sensor out.
    own_pitch: Option<f64>,
    /// The start of the command whose time budget includes the load of the scene, and the duration of load and build
    /// \[s\]. `None` if each render has its own clock.
    pub(crate) command: Option<CommandClock>,
    /// The description, for changes.
    description: Option<Box<Description>>,
    /// Does the report contain the hazards of the compiled scene?
    has_all_findings: bool,
}

/// The clock of a command that began before its scene was read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CommandClock {
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
    /// The start of the clock.
    started: Instant,
    inputs: InputFiles,
    /// The outputs that were checked before the render.
    checked: OutputPaths,
}

impl Project {
    /// The content of the scene, and its hazards.
    pub fn inspect(&self) -> Inspection {
        let lines = self.job.lines().unwrap_or_default();
        let mut inspection = inspect_lines(&self.scene, &self.findings(), lines);
        let film = self.film_size();
        let fitted = |camera: &Camera| {
            fit(camera, &self.lens_of(&camera.name), film).map_or_else(|_| camera.clone(), |fitted| fitted.camera)
        };
        inspection.cameras = self.scene.cameras().iter().map(|camera| camera_entry(&fitted(camera))).collect();
        let mut memory: Option<MemoryAccount> = None;
        for camera in self.views() {
            let fitted = self.fit_settings(self.settings.clone().with_camera(camera));
            match fitted.and_then(|settings| self.captured(settings)) {
                Ok(settings) => {
                    let (_, account) = self.account(&settings, Some(&self.outputs), KeptFilms::default());
                    if memory.as_ref().is_none_or(|most| most.peak_bytes < account.peak_bytes) {
                        memory = Some(account);
                    }
                    let is_blurred = settings.is_blurred();
                    let Some(Camera { name, lens, .. }) = settings.run.view else { continue };
                    if lens.aperture.is_some() {
                        inspection.add_effect(Effect::FiniteAperture, "lens");
                    }
                    if !lens.distortion.is_none() {
                        inspection.add_effect(Effect::Distortion, "lens");
                    }
                    if is_blurred {
                        inspection.add_effect(Effect::LensBlur, "lens");
                        if self.lens_of(&name).glare.is_none() {
                            inspection.hints = vec![NO_GLARE.into()];
                        }
                    }
                }
                Err(e) => inspection.hazards.push(e.in_one_line()),
            }
        }
        inspection.memory = memory.or_else(|| Some(self.memory()));
        inspection.warnings = self.warnings.iter().map(ToString::to_string).collect();
        inspection
    }

    /// The exposure time for which the samples of the scene are made. `None` if a film of it can be exposed for any time:
    /// nothing moves, no rows are scanned, and no lamp has a strobe.
    pub fn timed_exposure(&self) -> Option<TimedExposure> {
        timed_exposure(&self.scene, &self.job)
    }

    /// The settings of a render with the lens combined with its camera: with [`RunSettings::view`](dunkelfeld_render::RunSettings::view) set, and with the
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
        check_shutter(&self.scene, &settings, &self.job)?;
        settings.is_timed = self.timed_exposure().is_some();
        if settings.run.view.is_some() {
            return Ok(settings);
        }
        if settings.camera.is_none() {
            settings.camera = self.job.first_enabled().map(str::to_owned);
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
        if settings.run.without.contains(&Effect::FiniteAperture) {
            view.lens.aperture = None;
        }
        if settings.run.without.contains(&Effect::Distortion) {
            view.lens.distortion = Distortion::default();
        }
        if let Err(e) = self.scene.ray_generator(&view, settings.width, settings.height) {
            let is_of_lens = matches!(e, CameraError::NotInvertible { .. }) && lens.distortion.is_some();
            let of_lens = || InputError::of_key("distortion", e.to_string(), camera_help(&e));
            return Err(match is_of_lens {
                true => self.job.lens_error(&camera.name, of_lens()).into(),
                false => e.into(),
            });
        }
        settings.run.view = Some(view);
        if let SensorChoice::Emva { optics, .. } = &mut settings.sensor
            && *optics == self.optics
        {
            // Files of the image contain the bands, so that another exposure has the beam splitter too.
            let splitter = splitter_of(&self.job, &self.scene, &camera.name);
            let bands = self.job.bands_behind(&lens)?.behind_splitter(splitter);
            *optics = Optics::new(f_number, lens.transmission, magnification)?.with_bands(bands);
            if !settings.run.without.contains(&Effect::LensBlur) {
                let psf = lens.psf(&mut InputFiles::new())?;
                *optics = optics.clone().with_psf(psf).with_glare(lens.glare.unwrap_or(0.0))?;
            }
        }
        if let (SensorChoice::Emva { model, .. }, Some(part)) = (&mut settings.sensor, self.part) {
            **model = model.binned(part.binning)?;
            settings.readout.binning = part.binning;
        }
        if let SensorChoice::Emva { model, optics, .. } = &settings.sensor {
            let (size, pitch) = (settings.width.min(settings.height), model.spec().pixel_pitch);
            if self.part.is_some() && optics.psf().heights().len() > 1 {
                let problem = "an MTF over field heights is that of the whole film, and a part of it is rendered";
                let help = "write one field height, or render the whole film without `roi` and `binning`";
                return Err(self.misfit(&camera.name, InputError::of_key("psf", problem, help)));
            }
            if !optics.fits(size, pitch) {
                let problem = format!("the lens blurs the image over more than the {size} pixels of the film");
                let help = "write a larger aperture or another `psf`, or render more pixels";
                let key = match (&lens.psf, lens.f_number) {
                    (Some(_), _) => "psf",
                    (None, Some(_)) => "f_number",
                    (None, None) => "numerical_aperture",
                };
                return Err(self.misfit(&camera.name, InputError::of_key(key, problem, help)));
            }
        }
        Ok(settings)
    }

    /// The lens of a camera: its own in the job, or that of the project.
    fn lens_of(&self, camera: &str) -> LensSettings {
        let defined = self.job.camera_settings(camera);
        defined.map_or_else(|| self.lens.clone(), |camera| camera.lens_or(&self.lens))
    }

    /// `K` refers to the film of the job. On a film with another number of rows the field of view stays, so that the
    /// principal point moves with the size of a pixel.
    fn scale_intrinsics(&self, view: &mut Camera, film: FilmSize) {
        if self.job.camera_settings(&view.name).is_some_and(|camera| camera.intrinsics.is_some()) {
            let scale = f64::from(film.height) / f64::from(whole_film(&self.job, self.part)[1]);
            view.lens.principal_point = view.lens.principal_point.map(|offset| offset * scale);
        }
    }

    /// The text of the job as it is now, with its overrides. `None` for a scene without a job.
    pub fn job_text(&self) -> Option<&str> {
        self.has_job_file.then(|| self.job.text())
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

    /// The settings with the keys of a job in place of those of the project. Settings that the program has adjusted and
    /// that are no keys stay.
    pub(crate) fn setup_with(&self, keys: &[&str], sensor: Option<GivenSensor>) -> Result<Setup, Error> {
        let mut job = (*self.job).clone();
        if sensor.is_some() {
            // The keys of another sensor go, and a job without one gets its exposure.
            job = job.with_overrides(&format!("sensor.model = \"{DEFAULT_SENSOR}\""))?;
        }
        for keys in keys.iter().filter(|keys| !keys.is_empty()) {
            job = job.with_overrides(keys)?;
        }
        if let Some(section) = self.job.difference_of_scenes(&job) {
            let problem = format!("`{section}` is a part of the scene, which a render does not change");
            return Err(Error::setting("keys", problem, "change the scene before, by its overrides"));
        }
        let mut setup = resolve(&job, sensor, self.inputs.clone())?;
        expose_for(&mut setup.settings, self.scene.shutter(), &job)?;
        check_shutter(&self.scene, &setup.settings, &self.job)?;
        setup.settings.camera.clone_from(&self.settings.camera);
        setup.settings.run.clone_from(&self.settings.run);
        setup.inputs.extend(&self.inputs);
        setup.warnings.clone_from(&self.warnings);
        Ok(setup)
    }

    /// The settings as they are.
    pub(crate) fn setup(&self) -> Setup {
        let Self { job, settings, outputs, optics, lens, film, part, own_pitch, inputs, warnings, .. } = self;
        let (part, own_pitch) = (*part, *own_pitch);
        let (job, settings, outputs) = (job.clone(), settings.clone(), outputs.clone());
        let (optics, lens, film) = (optics.clone(), lens.clone(), film.clone());
        let (inputs, warnings) = (inputs.clone(), warnings.clone());
        Setup { job, settings, outputs, optics, lens, film, part, own_pitch, inputs, warnings }
    }

    /// Replaces the settings.
    pub(crate) fn set_up(&mut self, setup: Setup) {
        let Setup { job, settings, outputs, optics, lens, film, part, own_pitch, inputs, warnings } = setup;
        (self.job, self.settings, self.outputs) = (job, settings, outputs);
        (self.optics, self.lens, self.film) = (optics, lens, film);
        (self.part, self.own_pitch) = (part, own_pitch);
        (self.inputs, self.warnings) = (inputs, warnings);
    }

    /// Takes all settings, but not the scene, from another project.
    pub fn take_settings_of(&mut self, other: &Self) {
        let inputs = self.inputs.clone();
        self.set_up(other.setup());
        self.inputs.extend(&inputs);
    }

    /// The memory account of a render with the present settings, as a command that writes the outputs of the project.
    pub fn memory(&self) -> MemoryAccount {
        self.account(&self.settings, Some(&self.outputs), KeptFilms::default()).1
    }

    fn account(
        &self,
        settings: &RenderSettings,
        outputs: Option<&OutputPaths>,
        kept: KeptFilms,
    ) -> (u64, MemoryAccount) {
        let settings = &needed_layers(settings.clone(), outputs);
        let (threads, none) = (thread_count(settings.run.threads), OutputPaths::default());
        let outputs = outputs.unwrap_or(&none);
        let description = self.description.as_ref().map_or(0, |description| description.bytes());
        render_account(RenderNeeds { scene: &self.scene.summary(), description, settings, outputs, threads, kept })
    }

    /// The account of a render that may begin, as a command that writes the outputs of the project.
    pub fn checked_account(&self, settings: &RenderSettings) -> Result<MemoryAccount, Error> {
        self.checked_account_for(settings, Some(&self.outputs), KeptFilms::default())
    }

    fn checked_account_for(
        &self,
        settings: &RenderSettings,
        outputs: Option<&OutputPaths>,
        kept: KeptFilms,
    ) -> Result<MemoryAccount, Error> {
        let (held, account) = self.account(settings, outputs, kept);
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

    fn misfit(&self, camera: &str, misfit: InputError) -> Error {
        self.job.lens_error(camera, misfit).into()
    }
}

/// The settings of a command that writes `outputs`: sums that neither these nor the denoiser need are left out of the film
/// ([`RunSettings::layers`](dunkelfeld_render::RunSettings::layers)).
fn needed_layers(mut settings: RenderSettings, outputs: Option<&OutputPaths>) -> RenderSettings {
    if outputs.is_some_and(|outputs| outputs.exr.is_none()) && settings.denoise.method == DenoiseMethod::Off {
        settings.run.layers = FilmLayers::Image;
    }
    settings
}

impl ProjectResult {
    /// The settings of the render, with the lens combined with its camera.
    pub fn settings(&self) -> &RenderSettings {
        &self.settings
    }

    /// The film with the settings that expose it, without its frame.
    pub fn into_saved_film(self) -> SavedFilm {
        let Self { rendering, settings, is_vignetted, .. } = self;
        SavedFilm { film: rendering.film, settings, is_vignetted }
    }

    /// The files that the render read. An output must not replace one of them.
    pub fn inputs(&self) -> &InputFiles {
        &self.inputs
    }

    /// Seconds since the clock of the render started.
    pub fn elapsed(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

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
        let session = Session::new(self.settings.run.threads)?.with_start(self.started);
        session.install(|| written.save(paths))?;
        self.stats.add_seconds(Stage::Write, began.elapsed().as_secs_f64());
        self.stats.finish(session.elapsed());
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
