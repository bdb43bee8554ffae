//! Renders a project: to a result in memory, or as a command that writes files.

use super::{CommandClock, Project, ProjectResult, needed_layers};
use crate::denoising::{denoise_frame, find_denoiser};
use crate::frame::{Frame, develop_film};
use crate::guard::check_outputs;
use crate::memory::{KeptFilms, MemoryAccount, MemoryStats};
use crate::outputs::{OutputPaths, Written};
use crate::stats::{DenoiseStats, Stats};
use crate::views::plain_name;
use dunkelfeld_denoise::{Builtin, Denoiser};
use dunkelfeld_film::Film;
use dunkelfeld_io::input::InputFiles;
use dunkelfeld_render::{
    Cancel, Capture, DenoiseMethod, Error, Progress, RenderSettings, RenderedFilm, Rendering, Session, Silent, Stage,
    camera, render, render_with_dry_run,
};
use std::time::Instant;

/// What a program does with each image of a render: the name of its capture, if there are captures, and the result.
pub type EachCapture<'a> = dyn FnMut(Option<&str>, ProjectResult) -> Result<(), Error> + 'a;

impl Project {
    /// Renders and exposes, without progress. See [`Project::render_with`].
    ///
    /// # Errors
    /// As [`Project::render_with`].
    pub fn render(&self) -> Result<ProjectResult, Error> {
        self.render_with(&Silent, &Cancel::new())
    }

    /// Renders and exposes. It writes no file, except a checkpoint of the settings; [`ProjectResult::save`] does. The
    /// time budget begins with the call and contains exposure and denoising.
    ///
    /// # Errors
    /// Settings outside their range, an unknown camera.
    pub fn render_with(&self, progress: &dyn Progress, cancel: &Cancel) -> Result<ProjectResult, Error> {
        self.render_for(None, progress, cancel)
    }

    /// Renders and exposes as a command that writes the files of [`Project::outputs`]. They are checked before the render.
    /// With a time limit, those of some rows are written now and then and removed, which measures the time to reserve for the
    /// final ones. The time budget begins with the command ([`ProjectOptions::started`](
    /// super::ProjectOptions::started)), or with the call, and contains [`ProjectResult::save`].
    ///
    /// # Errors
    /// As [`Project::render_with`], and outputs that could not be written, or that are inputs.
    pub fn render_to_files(&self, progress: &dyn Progress, cancel: &Cancel) -> Result<ProjectResult, Error> {
        self.render_for(Some(&self.outputs), progress, cancel)
    }

    /// Renders without an exposure: the film, and the settings that expose it ([`Project::fitted`]), with the answer to:
    /// does the lens darken the image towards its corners? For programs that expose the film themselves, also during the
    /// render ([`Progress::film`]).
    ///
    /// # Errors
    /// As [`Project::render_with`].
    pub fn render_film(
        &self,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<(Rendering, RenderSettings, bool), Error> {
        self.film_of(Session::new(self.settings.run.threads)?, KeptFilms::default(), progress, cancel)
    }

    /// [`Project::render_film`] of a program that keeps copies of the film meanwhile, and that a person uses. The memory
    /// account of the render contains the copies, so that a render that does not fit with them is refused. The threads of the
    /// render leave the processor to those of the program ([`Session::in_background`] with this `nice`).
    ///
    /// # Errors
    /// As [`Project::render_with`].
    pub fn render_film_beside(
        &self,
        nice: u8,
        kept: KeptFilms,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<(Rendering, RenderSettings, bool), Error> {
        self.film_of(Session::in_background(self.settings.run.threads, nice)?, kept, progress, cancel)
    }

    /// The memory of [`Self::render_film_beside`] with these settings beside the program and its scene \[bytes\], and an error
    /// if there is less.
    pub fn memory_beside(&self, settings: &RenderSettings, kept: KeptFilms) -> (u64, Result<(), Error>) {
        let (held, account) = self.account(settings, None, kept);
        let help = "use one film for all lights, or render fewer pixels";
        (account.peak_bytes.saturating_sub(held), account.check(settings.memory_limit, held, help))
    }

    fn film_of(
        &self,
        session: Session<'_>,
        kept: KeptFilms,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<(Rendering, RenderSettings, bool), Error> {
        let session = session.with_progress(progress).with_cancel(cancel);
        let settings = self.fitted()?;
        self.checked_account_for(&settings, None, kept)?;
        let is_vignetted = camera(&self.scene, &settings)?.has_vignetting();
        let rendering = render(&self.scene, &settings, &session)?;
        Ok((rendering, settings, is_vignetted))
    }

    /// [`Self::render_with`] of all captures of the job, from one render of each camera: calls `each` with the name and the
    /// result of each capture. With several cameras ([`Self::defined_cameras`]) the name of the camera comes before it, as in
    /// `left-dark`, and each has the same share of a time limit. A job without captures has one image, without a name.
    ///
    /// # Errors
    /// As [`Self::render_with`], a capture that names no light of the scene, and the first error of `each`, after all images.
    pub fn render_captures(
        &self,
        progress: &dyn Progress,
        cancel: &Cancel,
        each: &mut EachCapture<'_>,
    ) -> Result<(), Error> {
        let cameras = self.defined_cameras();
        if self.job.captures.is_empty() || cameras.is_empty() {
            return self.render_each(None, self.captured(self.fitted()?)?, (progress, cancel), each);
        }
        for camera in &cameras {
            let mut settings = self.settings.clone().with_camera(camera.clone());
            settings.budget.seconds = settings.budget.seconds.map(|seconds| seconds / cameras.len() as f64);
            let settings = self.captured(self.fit_settings(settings)?)?;
            self.render_each(None, settings, (progress, cancel), &mut |name, result| match name {
                Some(name) if cameras.len() > 1 => each(Some(&format!("{}-{name}", plain_name(camera))), result),
                name => each(name, result),
            })?;
        }
        Ok(())
    }

    /// [`Self::render_captures`] of the camera of the settings as a command that writes files, as [`Self::render_to_files`]: those
    /// of a capture have its name ([`OutputPaths::for_camera`]).
    ///
    /// # Errors
    /// As [`Self::render_to_files`] and [`Self::render_captures`].
    pub fn render_captures_to_files(
        &self,
        progress: &dyn Progress,
        cancel: &Cancel,
        each: &mut EachCapture<'_>,
    ) -> Result<(), Error> {
        self.render_each(Some(&self.outputs), self.captured(self.fitted()?)?, (progress, cancel), each)
    }

    fn render_for(
        &self,
        outputs: Option<&OutputPaths>,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<ProjectResult, Error> {
        let mut only = None;
        self.render_each(outputs, self.fitted()?, (progress, cancel), &mut |_, result| {
            only = Some(result);
            Ok(())
        })?;
        only.ok_or_else(|| Error::setting("capture", "there is no image", "render one"))
    }

    fn render_each(
        &self,
        outputs: Option<&OutputPaths>,
        settings: RenderSettings,
        (progress, cancel): (&dyn Progress, &Cancel),
        each: &mut EachCapture<'_>,
    ) -> Result<(), Error> {
        let mut quiet = Session::new(self.settings.run.threads)?;
        let command = self.command.filter(|_| outputs.is_some());
        if let Some(CommandClock { started, .. }) = command {
            quiet = quiet.with_start(started);
        }
        let session = quiet.clone().with_progress(progress).with_cancel(cancel);
        let mut inputs = self.inputs.clone();
        inputs.add_library(self.settings.denoise.oidn.as_deref());
        let mut settings = needed_layers(settings, outputs);
        let captures = settings.run.captures.clone();
        // The settings and files of each image.
        let mut images = vec![(None, settings.clone(), outputs.cloned())];
        if !captures.is_empty() {
            let image = |capture: &Capture| {
                let outputs = outputs.map(|outputs| outputs.for_camera(&capture.name));
                (Some(capture.clone()), settings.of_capture(capture), outputs)
            };
            images = captures.iter().map(image).collect();
        }
        let checkpoint = self.settings.run.checkpoint.as_ref().map(|keep| keep.path.as_path());
        let files = || images.iter().filter_map(|(.., outputs)| outputs.as_ref());
        files().try_for_each(|outputs| outputs.check_beside(self.settings.has_sensor(), checkpoint, &inputs))?;
        let all: Vec<_> = files().flat_map(OutputPaths::named).collect();
        check_outputs(&all, &InputFiles::new())?;
        let denoiser = find_denoiser(&settings.denoise)?;
        if denoiser.as_ref().is_some_and(|d| d.name() == Builtin.name()) {
            // The time reserved for it is less.
            settings.denoise.method = DenoiseMethod::Builtin;
            images.iter_mut().for_each(|(_, settings, _)| settings.denoise.method = DenoiseMethod::Builtin);
        }
        let account = self.checked_account_for(&settings, outputs, KeptFilms::default())?;
        let is_vignetted = camera(&self.scene, &settings)?.has_vignetting();
        let silent = quiet.clone().with_cancel(cancel);
        let dry_run = |film: &RenderedFilm| {
            images.iter().try_for_each(|(capture, settings, outputs)| {
                let captured = capture.as_ref().map(|capture| film.of_capture(capture)).transpose()?;
                let film = captured.as_ref().unwrap_or(film);
                let mut frame = develop_film(film, settings)?;
                denoised(denoiser.as_deref(), &mut frame, &film.sums, settings, &silent)?;
                match outputs {
                    Some(outputs) => Written { film, frame: &frame, settings, is_vignetted }.try_out(outputs),
                    None => Ok(()),
                }
            })
        };
        let mut whole = Some(render_with_dry_run(&self.scene, &settings, &session, &dry_run)?);
        let done = Done { session: &session, command, denoiser: denoiser.as_deref(), account, is_vignetted, inputs };
        // A file that cannot be written does not end the other images.
        let mut done_all = Ok(());
        for (capture, settings, outputs) in images {
            let rendering = match (&capture, &whole) {
                (Some(capture), Some(whole)) => Some(session.install(|| whole.of_capture(capture))?),
                _ => whole.take(),
            };
            let Some(rendering) = rendering else { break };
            let name = capture.map(|capture| capture.name);
            let mut result = done.exposed(rendering, settings, outputs.unwrap_or_default(), cancel)?;
            result.stats.run.capture.clone_from(&name);
            done_all = done_all.and(each(name.as_deref(), result));
        }
        done_all
    }
}

/// A render that is done, without its films.
struct Done<'a> {
    session: &'a Session<'a>,
    command: Option<CommandClock>,
    denoiser: Option<&'a dyn Denoiser>,
    account: MemoryAccount,
    is_vignetted: bool,
    inputs: InputFiles,
}

impl Done<'_> {
    /// Exposes and denoises an image of the render.
    fn exposed(
        &self,
        mut rendering: Rendering,
        settings: RenderSettings,
        checked: OutputPaths,
        cancel: &Cancel,
    ) -> Result<ProjectResult, Error> {
        let session = self.session;
        let began = Instant::now();
        session.begin(Stage::Expose, 1.0, rendering.film.sums.total_samples());
        let mut frame = session.install(|| develop_film(&rendering.film, &settings))?;
        let exposed = began.elapsed().as_secs_f64();
        let denoising =
            session.install(|| denoised(self.denoiser, &mut frame, &rendering.film.sums, &settings, session))?;
        if denoising.as_ref().is_some_and(|d| d.error.is_some()) {
            rendering.interrupted |= cancel.is_cancelled();
        }
        let mut stats = session.install(|| Stats::new(&rendering, &frame, &settings));
        stats.memory = Some(MemoryStats::new(self.account.clone(), &rendering.film.sums));
        if let Some(CommandClock { load_seconds, build_seconds, .. }) = self.command {
            stats.add_seconds(Stage::Load, load_seconds);
            stats.add_seconds(Stage::Build, build_seconds);
        }
        stats.add_seconds(Stage::Expose, exposed);
        denoising.into_iter().for_each(|d| stats.add_denoising(d));
        stats.finish(session.elapsed());
        let (is_vignetted, started, inputs) = (self.is_vignetted, session.started(), self.inputs.clone());
        Ok(ProjectResult { rendering, frame, stats, settings, is_vignetted, started, inputs, checked })
    }
}

/// Denoises the picture of a frame, if there is a denoiser.
fn denoised(
    denoiser: Option<&dyn Denoiser>,
    frame: &mut Frame,
    film: &Film,
    settings: &RenderSettings,
    session: &Session<'_>,
) -> Result<Option<DenoiseStats>, Error> {
    denoiser.map(|denoiser| denoise_frame(frame, film, denoiser, settings, session)).transpose()
}
