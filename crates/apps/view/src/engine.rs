//! The thread that renders. It begins again when the scene changes, and publishes its film.

use crate::developed::Sensors;
use crate::outlook::{MAX_SPP, PILOT_SPP, of_plan};
use crate::panics::caught;
use crate::protocol::{Activity, Fault, Note};
use crate::scene_change::{SceneChange, SceneParts};
use crate::shared::{LightFilms, Shared, Stamp, lock};
use crate::snapshot::{Content, PictureScene, Snapshot};
use dunkelfeld::adaptive::Forecast;
use dunkelfeld::denoising::find_denoiser;
use dunkelfeld::film::FilmLayers;
use dunkelfeld::io::program_seconds;
use dunkelfeld::limits::DEFAULT_SENSOR;
use dunkelfeld::memory::KeptFilms;
use dunkelfeld::outputs::{ExrImage, LensSource};
use dunkelfeld::radiometry::Number;
use dunkelfeld::scene::Effect;
use dunkelfeld::sensor::ExposureNoise;
use dunkelfeld::{
    Budget, Cancel, DenoiseMethod, Error, ExposeOptions, ExposeSettings, InputFiles, Progress, ProgressState, Project,
    ProjectOptions, RenderSettings, RenderedFilm, SavedFilm, SensorChoice, find_sensor,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

/// The processor time of the program is measured over so many seconds of a render.
const LOAD_SECONDS: f64 = 3.0;
/// Seconds between two films at the beginning of a render, and later.
const FIRST_INTERVAL: f64 = 0.4;
const LATER_INTERVAL: f64 = 1.0;
/// Seconds after which the films are published less often.
const EARLY: f64 = 8.0;
/// The copy of a film may take this share of the time of the render.
const COPY_SHARE: f64 = 0.02;
/// The help for a fault of the program.
pub(crate) const AFTER_PANIC: &str = "start the render again, and report this fault";
/// Pause between two looks at the files of the scene.
const WATCH_EVERY: Duration = Duration::from_millis(700);

/// The data that a view keeps beside its render: the film that is shown and the one before, which requests may still use; the
/// exposures of the store; an analysis. For each of both films its mean (25 while gaps are filled) and two planes of samples
/// (8), and for two requests at a time a frame, a picture or a map, and its bytes (13). For each result that is kept, samples
/// (4), variances (5) and a denoised mean (12).
const KEPT: KeptFilms = KeptFilms {
    films: 2,
    exposures: crate::store::KEPT as u64,
    analyses: 1,
    bytes_per_pixel: 2 * (25 + 8 + 13) + crate::prepared::KEPT as u64 * (4 + 5 + 12),
};

/// Renders until the view ends.
pub(crate) fn run(shared: &Arc<Shared>) {
    let mut project: Option<Project> = None;
    let mut opened_without = Vec::new();
    loop {
        let (change, is_reloaded, cancel) = {
            let mut control = lock(&shared.control);
            if control.quit {
                return;
            }
            // A request from here on cancels this render. The lock keeps it from cancelling the one before.
            let cancel = Arc::new(Cancel::new());
            control.cancel = cancel.clone();
            let change = control.change.take().unwrap_or_else(|| lock(&shared.live).change.clone());
            control.in_progress = Some(change.clone());
            (change, std::mem::take(&mut control.reload), cancel)
        };
        if is_reloaded || project.is_none() || opened_without != change.without {
            project = None;
        }
        let load = || prepare(shared, &mut project, &change, &cancel);
        let result = caught("the load of the scene", AFTER_PANIC, load).and_then(|result| result.map_err(Fault::from));
        opened_without.clone_from(&change.without);
        if result.is_err() {
            // The change is made as soon as the files allow it.
            lock(&shared.live).change = change;
        }
        {
            let mut control = lock(&shared.control);
            let unfinished = control
                .in_progress
                .take()
                .filter(|change| result.is_ok() && cancel.is_cancelled() && lock(&shared.live).change != *change);
            control.change = control.change.take().or(unfinished);
        }
        let rendered = result.and_then(|()| match &project {
            Some(project) => caught("the render", AFTER_PANIC, || render(shared, project, &cancel))
                .and_then(|result| result.map_err(Fault::from)),
            None => Ok(()),
        });
        if let Err(fault) = rendered {
            shared.update(|live| {
                live.error = Some(fault);
                live.render.state = Activity::Failed;
            });
        }
        // Until there is something to do.
        let mut control = lock(&shared.control);
        while !(control.quit || control.change.is_some() || control.reload) {
            let jobs = std::mem::take(&mut control.jobs);
            if let (false, Some(project)) = (jobs.is_empty(), &project) {
                drop(control);
                jobs.into_iter().for_each(|job| job(project));
                control = lock(&shared.control);
                continue;
            }
            control = shared.wake.wait(control).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// Opens the project, or changes it.
fn prepare(
    shared: &Arc<Shared>,
    project: &mut Option<Project>,
    change: &SceneChange,
    cancel: &Cancel,
) -> Result<(), Error> {
    lock(&shared.live).scene_number += 1;
    let (mut opened, parts) = match project.take() {
        Some(project) => (project, lock(&shared.live).parts.clone()),
        None => open(shared, change)?,
    };
    // A change that comes now is checked by the parts that were read.
    lock(&shared.live).parts = parts.clone();
    if cancel.is_cancelled() {
        *project = Some(opened);
        return Ok(());
    }
    // A file that has changed, or an effect that is left out, may remove a part that the page has changed. The change is kept
    // for the scene that has the part again.
    let kept = change.clone();
    let change = change.restricted_to(&parts);
    let text = toml::to_string(&change.overrides(&parts))
        .map_err(|e| Error::setting("scene", e.to_string(), "use other values"))?;
    opened.set_overrides(&text)?;
    opened.settings.camera = change.camera.clone().or(opened.settings.camera.take());
    opened.settings.budget = Budget::default().with_spp(MAX_SPP);
    opened.settings.run.max_pilot_spp = Some(PILOT_SPP);
    opened.settings.run.layers = FilmLayers::All;
    let of_lights: Vec<Vec<String>> = opened.scene.light_names().into_iter().map(|name| vec![name]).collect();
    let lights = of_lights.len();
    opened.settings.run.light_groups = if change.per_light { of_lights.clone() } else { Vec::new() };
    let mut settings = opened.fitted()?;
    let (bytes, fits) = opened.memory_beside(&settings.clone().running(|run| run.with_light_groups(of_lights)), KEPT);
    let light_films = Some(LightFilms { lights, bytes, fits: fits.map_err(Fault::from) });
    let is_vignetted = dunkelfeld::camera(&opened.scene, &settings)?.has_vignetting();
    let no_denoiser = without_missing_denoiser(&mut settings);
    let timed = opened.timed_exposure();
    let note = |text: String| Note { level: "warning", text, help: None };
    let findings = opened.findings();
    let notes = opened.warnings.iter().map(|w| note(w.to_string()));
    let notes = notes.chain(findings.findings.iter().map(|f| note(format!("{}: {}", f.place, f.message))));
    let unmade = kept.unmade(&parts).into_iter().map(|fault| Note {
        level: "warning",
        text: format!("a change of the scene is not made: {}", fault.problem),
        help: fault.help,
    });
    let notes = notes.chain(unmade).chain(no_denoiser).collect();
    // Files and presets are read without the lock.
    let sensors = Sensors::new(&settings.sensor);
    let files = stamps(opened.inputs.iter().map(|file| file.identity.path()));
    shared.update(|live| {
        live.notes = notes;
        live.is_vignetted = is_vignetted;
        live.parts = parts;
        live.change = kept;
        live.light_films = light_films;
        live.error = None;
        for (path, stamp) in files {
            live.files.entry(path).or_insert(stamp);
        }
        live.sensors = sensors;
        live.settings = Some(settings);
        live.timed = timed;
        if let Some(timed) = timed {
            live.statistics.set_exposure(timed.time.0);
        }
    });
    *project = Some(opened);
    Ok(())
}

/// Opens the project, with its parts before any change.
fn open(shared: &Arc<Shared>, change: &SceneChange) -> Result<(Project, SceneParts), Error> {
    // A file that changes while it is read is read again.
    let before: Vec<PathBuf> = lock(&shared.live).files.keys().cloned().collect();
    let files = stamps(before.iter().chain([&shared.subject.path]).map(PathBuf::as_path));
    shared.update(|live| {
        live.render.state = Activity::Loading;
        "load".clone_into(&mut live.render.stage);
        live.files = files;
    });
    let options = ProjectOptions::default().with_without(change.without.clone());
    let mut read = InputFiles::new();
    let opened = Project::open_recorded(&shared.subject.path, options, &mut read);
    // The file with the fault is among those that are watched.
    let files = stamps(read.iter().map(|file| file.identity.path()));
    shared.update(|live| {
        for (path, stamp) in files {
            live.files.entry(path).or_insert(stamp);
        }
    });
    let opened = opened?;
    let inspection = opened.inspect();
    let mut parts = SceneParts::new(&inspection, opened.scene.materials());
    // An effect that is left out is not used any more.
    let before = lock(&shared.live).parts.effects.clone();
    for (name, used) in &mut parts.effects {
        *used |= change.without.iter().any(|effect| effect.name() == name) && before.contains(&(name.clone(), true));
    }
    if change.without.contains(&Effect::Textures) {
        parts.keep_textured(&inspection, &opened.described_materials()?);
    }
    let is_job = shared.subject.path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    lock(&shared.live).job = opened.job_text().filter(|_| is_job).map(str::to_owned);
    Ok((opened, parts))
}

/// The picture of a job is denoised. Where this machine lacks the denoiser, the view begins without, and states it.
fn without_missing_denoiser(settings: &mut RenderSettings) -> Option<Note> {
    let fault = Fault::from(find_denoiser(&settings.denoise).err()?);
    settings.denoise.method = DenoiseMethod::Off;
    let help = Some("choose another denoiser".to_owned());
    Some(Note { level: "warning", text: format!("the picture is not denoised: {}", fault.problem), help })
}

/// Renders a project until it is cancelled. Its last film, which has the most samples, stays until then.
fn render(shared: &Arc<Shared>, project: &Project, cancel: &Arc<Cancel>) -> Result<(), Error> {
    if cancel.is_cancelled() {
        return Ok(());
    }
    let settings = project.fitted()?;
    let camera = dunkelfeld::camera(&project.scene, &settings)?;
    let is_vignetted = camera.has_vignetting();
    let is_restart = shared.snapshot().is_some();
    let scene = {
        let live = lock(&shared.live);
        PictureScene {
            number: live.scene_number,
            change: live.change.restricted_to(&live.parts),
            parts: live.parts.clone(),
            job: live.job.clone(),
            sensors: live.sensors.clone(),
            timed: live.timed,
            camera: Some(camera),
            ..PictureScene::default()
        }
    };
    shared.update(|live| {
        live.times = Times::default();
        live.statistics.curve.clear();
        live.plan.clear();
        live.render.state = Activity::Running;
        live.render.reason = None;
        live.render.processor_share = None;
        live.render.restarted += u32::from(is_restart);
    });
    let watcher = Watcher {
        shared,
        project,
        settings: (settings, is_vignetted),
        scene: Arc::new(scene),
        cancel,
        is_restart,
        next_note: AtomicU64::new(0),
    };
    let (rendering, ..) = project.render_film_beside(shared.subject.nice, KEPT, &watcher, cancel)?;
    if !cancel.is_cancelled() {
        watcher.publish(Content::Film(rendering.film));
        watcher.finish();
    }
    Ok(())
}

/// The times of a render \[s\].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Times {
    began: Instant,
    paused: f64,
    /// When the next film is due, and whether one of this render is shown.
    next: f64,
    is_published: bool,
    /// Seconds of the render and of the processors at the last measurement of the load.
    load: Option<[f64; 2]>,
}

impl Default for Times {
    /// Those of a render that begins now.
    fn default() -> Self {
        Self { began: Instant::now(), paused: 0.0, next: 0.0, is_published: false, load: None }
    }
}

/// Receives progress and films of a render.
struct Watcher<'a> {
    shared: &'a Arc<Shared>,
    project: &'a Project,
    settings: (RenderSettings, bool),
    scene: Arc<PictureScene>,
    cancel: &'a Cancel,
    is_restart: bool,
    /// Milliseconds of the clock after which the pages are told of progress.
    next_note: AtomicU64,
}

impl Watcher<'_> {
    /// Reads or changes the times of the render. `f` may lock nothing.
    fn times<T>(&self, f: impl FnOnce(&mut Times) -> T) -> T {
        f(&mut lock(&self.shared.live).times)
    }

    /// Seconds of the render, without pauses.
    fn seconds(&self) -> f64 {
        self.times(|times| times.began.elapsed().as_secs_f64() - times.paused)
    }

    /// Processor time of the program over that of all of its threads, at the end of some seconds of a render.
    fn processor_share(&self, seconds: f64) -> Option<f64> {
        if self.times(|times| times.load).is_some_and(|[began, _]| seconds < began + LOAD_SECONDS) {
            return None;
        }
        let used = program_seconds()?;
        let [began, before] = self.times(|times| times.load.replace([seconds, used]))?;
        Some((used - before) / ((seconds - began) * self.shared.background.threads() as f64))
    }

    /// Is the next film due?
    fn is_due(&self) -> bool {
        self.seconds() >= self.times(|times| times.next) && !self.cancel.is_cancelled()
    }

    /// After a restart the earlier picture stays until each pixel has a sample.
    fn needs_all_pixels(&self) -> bool {
        self.is_restart && !self.times(|times| times.is_published)
    }

    fn publish(&self, content: Content) {
        let seconds = self.seconds();
        let before = self.shared.snapshot();
        let id = before.as_ref().map_or(1, |before| before.id + 1);
        let is_first = !self.times(|times| std::mem::replace(&mut times.is_published, true));
        let earlier = before.as_deref().filter(|_| !is_first);
        let mut snapshot = Snapshot::new(id, content, self.settings.clone(), self.scene.clone(), seconds, earlier);
        snapshot.restarted = lock(&self.shared.live).render.restarted;
        if is_first {
            lock(&self.shared.live).statistics.certificate = None;
        }
        self.shared.publish(snapshot);
    }

    /// Publishes a film that has other samples than the picture, as soon as it may be shown.
    fn publish_newest(&self, film: &RenderedFilm) {
        let is_shown = self.times(|times| times.is_published)
            && self.shared.snapshot().is_some_and(|shown| shown.samples == film.sums.total_samples());
        if is_shown || (self.needs_all_pixels() && !film.sums.has_all_pixels()) {
            return;
        }
        let began = self.seconds();
        self.publish(Content::Film(film.clone()));
        // So copies take this share of the time.
        let next = began + (self.seconds() - began) / COPY_SHARE;
        self.times(|times| times.next = next);
    }

    /// States that the render has its last sample.
    fn finish(&self) {
        self.shared.update(|live| {
            live.render.state = Activity::Finished;
            (live.render.fraction, live.render.remaining) = (1.0, None);
            live.render.reason = Some(format!("the image has {MAX_SPP} samples per pixel, the most of a view"));
        });
    }

    /// Does the work that waits for the scene, and holds the render while it is paused.
    fn hold(&self, present: &RenderedFilm) {
        let began = Instant::now();
        let mut control = lock(&self.shared.control);
        let mut is_paused = false;
        loop {
            let jobs = std::mem::take(&mut control.jobs);
            if !jobs.is_empty() {
                drop(control);
                jobs.into_iter().for_each(|job| job(self.project));
                control = lock(&self.shared.control);
                continue;
            }
            if !control.is_paused || self.cancel.is_cancelled() {
                break;
            }
            if !is_paused {
                is_paused = true;
                drop(control);
                // The picture of a pause is the newest film.
                self.publish_newest(present);
                self.shared.update(|live| live.render.state = Activity::Paused);
                control = lock(&self.shared.control);
                continue;
            }
            control = self.shared.wake.wait(control).unwrap_or_else(PoisonError::into_inner);
        }
        drop(control);
        if is_paused {
            self.times(|times| (times.load, times.paused) = (None, times.paused + began.elapsed().as_secs_f64()));
            self.shared.update(|live| live.render.state = Activity::Running);
        }
    }
}

impl Progress for Watcher<'_> {
    fn update(&self, progress: &ProgressState) {
        let now = self.shared.began.elapsed().as_millis() as u64;
        let due = self.next_note.load(Ordering::Relaxed);
        let next = now + 200;
        if now < due || self.next_note.compare_exchange(due, next, Ordering::Relaxed, Ordering::Relaxed).is_err() {
            return;
        }
        let seconds = self.seconds();
        let share = self.processor_share(seconds);
        self.shared.update(|live| {
            live.render.processor_share = share.or(live.render.processor_share);
            live.render.stage = progress.stage.name().into();
            live.render.elapsed = seconds;
            live.render.samples_per_second = if seconds > 0.0 { progress.samples as f64 / seconds } else { 0.0 };
        });
    }

    fn forecast(&self, forecast: &Forecast) {
        let pixels = f64::from(self.settings.0.width) * f64::from(self.settings.0.height);
        let plan = of_plan(&forecast.levels, pixels, self.times(|times| times.paused));
        self.shared.update(|live| live.plan = plan);
    }

    fn film_interval(&self) -> Option<f64> {
        Some(if self.seconds() < EARLY { FIRST_INTERVAL } else { LATER_INTERVAL })
    }

    fn film(&self, film: &RenderedFilm) {
        if self.is_due() {
            self.publish_newest(film);
        }
        self.hold(film);
    }
}

/// The data of a stored picture, which has no scene.
fn scene_of_file(settings: &RenderSettings) -> Arc<PictureScene> {
    Arc::new(PictureScene { sensors: Sensors::new(&settings.sensor), ..PictureScene::default() })
}

/// Reads an EXR of any renderer, with its noise if the file has it.
pub(crate) fn open_exr(path: &Path) -> Result<ExrImage, Error> {
    let settings = ExposeSettings::new(find_sensor(DEFAULT_SENSOR)?)?;
    ExrImage::open(path, &settings.with_exposure_noise(ExposureNoise::Matched))
}

/// Shows an EXR of any renderer.
pub(crate) fn show_exr(shared: &Arc<Shared>, image: ExrImage, options: &ExposeOptions) -> Result<(), Error> {
    let mean = image.radiance();
    let mut settings = dunkelfeld::default_settings();
    (settings.width, settings.height) = (mean.width(), mean.height());
    let model = Box::new(image.sensor().cloned().map_or_else(|| find_sensor(DEFAULT_SENSOR), Ok)?);
    let (optics, sources) = image.lens(&options.settings()?);
    let mut notes = Vec::new();
    if sources.contains(&LensSource::Default) {
        let text = format!(
            "the file contains no lens: f/{}, transmission {} and magnification {} are assumed",
            Number(optics.f_number()),
            Number(optics.transmission()),
            Number(optics.magnification())
        );
        let help = Some("start the view with --f-number, --transmission and --magnification".to_owned());
        notes.push(Note { level: "info", text, help });
    }
    let is_invalid = |pixel: &&[f32; 3]| pixel.iter().any(|v| !v.is_finite() || *v < 0.0);
    let invalid = mean.data().iter().filter(is_invalid).count();
    if invalid > 0 {
        let pixels = if invalid == 1 { "pixel" } else { "pixels" };
        let text = format!(
            "the radiance of {invalid} {pixels} is negative or not a number (they count as black) or infinite (they saturate)"
        );
        notes.push(Note { level: "warning", text, help: None });
    }
    settings.sensor = SensorChoice::Emva { model, optics, exposure: None };
    let scene = scene_of_file(&settings);
    let snapshot = Snapshot::of_exr(image, settings, scene);
    show_stored(shared, snapshot, "exr", notes);
    Ok(())
}

/// Shows a stored picture.
fn show_stored(shared: &Shared, snapshot: Snapshot, stage: &str, notes: Vec<Note>) {
    shared.update(|live| {
        live.sensors = snapshot.scene.sensors.clone();
        live.settings = Some(snapshot.settings.clone());
        live.is_vignetted = snapshot.is_vignetted;
        live.snapshot = Some(Arc::new(snapshot));
        live.render.state = Activity::None;
        live.render.stage = stage.into();
        live.notes = notes;
    });
    shared.wake.notify_all();
}

/// Shows a film of a file.
pub(crate) fn show_film(shared: &Arc<Shared>, saved: SavedFilm) {
    let SavedFilm { film, mut settings, is_vignetted } = saved;
    let no_denoiser = without_missing_denoiser(&mut settings);
    let scene = scene_of_file(&settings);
    let content = Content::Film(film);
    let snapshot = Snapshot::new(1, content, (settings, is_vignetted), scene, 0.0, None);
    show_stored(shared, snapshot, "film", no_denoiser.into_iter().collect());
}

/// The present version of a file.
fn stamp(path: &Path) -> Stamp {
    let data = std::fs::metadata(path).ok()?;
    Some((data.modified().ok()?, data.len()))
}

/// The present versions of files.
fn stamps<'a>(paths: impl Iterator<Item = &'a Path>) -> BTreeMap<PathBuf, Stamp> {
    paths.map(|path| (path.to_owned(), stamp(path))).collect()
}

/// Reloads the scene when one of its files changes, until the view ends.
pub(crate) fn watch_files(shared: &Arc<Shared>) {
    loop {
        let control = lock(&shared.control);
        if control.quit {
            return;
        }
        drop(shared.wake.wait_timeout_while(control, WATCH_EVERY, |control| !control.quit));
        let seen = lock(&shared.live).files.clone();
        let changed: Vec<(PathBuf, Stamp)> = (seen.into_iter())
            .map(|(path, seen)| (stamp(&path), path, seen))
            // A file that is gone is being replaced.
            .filter(|(now, _, seen)| now.is_some() && now != seen)
            .map(|(now, path, _)| (path, now))
            .collect();
        if !changed.is_empty() {
            lock(&shared.live).files.extend(changed);
            shared.control(|control| (control.reload, control.is_paused) = (true, false));
        }
    }
}
