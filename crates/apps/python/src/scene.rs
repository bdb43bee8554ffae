//! Scenes: opened, changed and rendered.

use crate::arguments::{NamesArgument, checked_threads, effect_left_out, some_threads_of, threads_of};
use crate::arrays::CountsArray;
use crate::errors::{Failure, Interrupted, setting};
use crate::film::Film;
use crate::inputs::{absolute, names_of};
use crate::job::{job_text, overrides_text};
use crate::json::loaded;
use crate::keywords::Keywords;
use crate::progress::{is_reporting, lock, lock_unless, reports_about, supervised_by};
use crate::work::SIGNALS;
use dunkelfeld::io::OF_RENDER;
use dunkelfeld::outputs::EachCapture;
use dunkelfeld::outputs::SavedPlan;
use dunkelfeld::scene::Effect;
use dunkelfeld::trace::PixelSample;
use dunkelfeld::{
    Cancel, Error, InputFiles, Progress, Project, ProjectOptions, ProjectResult, RenderOptions, ReplayOption,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// The films of captures by their names.
type NamedFilms = Vec<(String, Film)>;

/// A scene or job file. `Scene(path)` opens a scene (`.glb`, `.gltf`, `.obj`, `.stl`, `.ply`) or a job (`.toml`).
///
/// `without` names effects to leave out, as in `without=["scattering", "normal-maps"]`, to measure their influence on an image.
/// The outputs of the renders are marked. `Scene.effects` lists those that a scene uses. Another choice needs another
/// `Scene`, which loads its files again.
///
/// `threads` is the number of threads that load the scene, and the default of `render`; 0 stands for one per core.
///
/// A scene can be used by several threads; its renders run one after the other.
#[pyclass(frozen, module = "dunkelfeld")]
pub(crate) struct Scene {
    project: Mutex<Project>,
    /// Path, and the text of a job that is no file: for copies.
    origin: (PathBuf, Option<String>),
    without: Vec<Effect>,
    /// Number of threads with which it was opened.
    threads: usize,
    overrides: Mutex<String>,
    /// Ends the render that holds the project.
    running: Mutex<Option<Arc<Cancel>>>,
}

/// Time in which a cancelled render leaves its scene, and in which a progress function waits for another scene. A render that
/// does not leave waits for its progress function, which may wait for the scene itself.
const PATIENCE: Duration = Duration::from_secs(3);

const HELD: &str = "a render holds the scene";
const AFTER_RENDER: &str = "use it after the render, and not from its progress function";

/// A wait for a scene.
struct Held {
    /// Since when the render that holds it is cancelled, or the progress function waits.
    since: Option<Instant>,
    /// Does a progress function wait?
    is_reporting: bool,
}

impl Held {
    /// A wait of this thread.
    fn new() -> Self {
        Self { since: None, is_reporting: is_reporting() }
    }

    fn exceeds_patience(&mut self, scene: &Scene) -> bool {
        if !self.is_reporting && !scene.is_ending() {
            self.since = None;
            return false;
        }
        self.since.get_or_insert_with(Instant::now).elapsed() > PATIENCE
    }
}

impl Scene {
    fn address(&self) -> usize {
        std::ptr::from_ref(self).addr()
    }

    /// Refuses the use of a scene by its own progress function, which would wait for the end of the render.
    fn check_idle(&self) -> Result<(), Failure> {
        if reports_about(self.address()) {
            let problem = "a progress function cannot use the scene that it reports about";
            return Err(setting("scene", problem, "use it after the render"));
        }
        Ok(())
    }

    /// Is the render that holds the project cancelled?
    fn is_ending(&self) -> bool {
        lock(&self.running).as_ref().is_some_and(|cancel| cancel.is_cancelled())
    }

    /// Works on the project without the lock of the interpreter: a render on another thread may need that lock.
    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Project) -> T + Send) -> Result<T, Failure> {
        self.check_idle()?;
        let mut work = Some(work);
        let mut held = Held::new();
        loop {
            // A signal such as Ctrl-C ends a wait for a render on another thread.
            let tried = py.detach(|| {
                let began = Instant::now();
                let mut project = lock_unless(&self.project, || began.elapsed() > SIGNALS)?;
                work.take().map(|work| work(&mut project))
            });
            match tried {
                Some(result) => return Ok(result),
                None => py.check_signals()?,
            }
            if held.exceeds_patience(self) {
                return Err(setting("scene", HELD, AFTER_RENDER));
            }
        }
    }

    fn open(path: PathBuf, text: Option<String>, without: Vec<Effect>, threads: usize) -> Result<Self, Failure> {
        // Other files may be read, and copies be made, after a change of folder.
        let path = std::path::absolute(&path).unwrap_or(path);
        let options = ProjectOptions::default().with_without(without).with_threads(threads);
        let project = match &text {
            None => Project::open_with(&path, options)?,
            Some(text) => Project::from_text_with(&path, text, options)?,
        };
        let without = project.settings.run.without.clone();
        Ok(Self {
            project: Mutex::new(project),
            origin: (path, text),
            without,
            threads,
            overrides: Mutex::default(),
            running: Mutex::default(),
        })
    }

    /// The file of the scene, for studies, which open it themselves.
    pub(crate) fn path_of_studies(&self) -> Result<PathBuf, Failure> {
        let (path, text) = &self.origin;
        let has_overrides = !lock(&self.overrides).is_empty();
        let reasons = [
            (text.is_some(), "the job is a text and no file", "write it to a file"),
            (has_overrides, "the scene has overrides", "write them into a job file"),
            (!self.without.is_empty(), "effects are left out", "pass a scene with all effects"),
        ];
        match reasons.into_iter().find(|(applies, ..)| *applies) {
            Some((_, problem, help)) => Err(setting("input", format!("a study opens a file, and {problem}"), help)),
            None => Ok(path.clone()),
        }
    }

    /// The films of a render by the names of their captures, and the exception that ended it.
    fn films(
        &self,
        py: Python<'_>,
        mut options: RenderOptions,
        replay: Option<&Bound<'_, PyAny>>,
        progress: Option<&Py<PyAny>>,
        render: impl FnOnce(&mut Project, RenderOptions, &dyn Progress, &Cancel, &mut EachCapture<'_>) -> Result<(), Error>
        + Send,
    ) -> Result<(NamedFilms, Option<PyErr>), Failure> {
        self.check_idle()?;
        options.replay = replay.map(replay_of).transpose()?;
        let replayed = replay.and_then(|plan| Some(plan.cast::<Film>().ok()?.get().inputs.clone()));
        let cancel = Arc::new(Cancel::new());
        let mut held = Held::new();
        let work = |sink: &dyn Progress, _: &Cancel| {
            let is_given_up = || cancel.is_cancelled() || held.exceeds_patience(self);
            let Some(mut project) = lock_unless(&self.project, is_given_up) else {
                return Err(match cancel.is_cancelled() {
                    true => Error::setting("render", "was cancelled before it began", "render again"),
                    false => Error::setting("scene", HELD, AFTER_RENDER),
                });
            };
            let mut films = Vec::new();
            *lock(&self.running) = Some(cancel.clone());
            let rendered = render(&mut project, options, sink, &cancel, &mut |name, result| {
                films.push((name.unwrap_or_default().to_owned(), film_of(result, replayed.as_deref())));
                Ok(())
            });
            *lock(&self.running) = None;
            rendered.map(|()| films)
        };
        supervised_by(py, progress, self.address(), &cancel, work)
    }
}

/// The film of a result. That of a replay stands for the files that it was made from.
fn film_of(result: ProjectResult, replayed: Option<&InputFiles>) -> Film {
    let (stats, interrupted) = (result.stats.to_json(), result.rendering.interrupted);
    let mut inputs = absolute(result.inputs());
    for input in replayed.into_iter().flat_map(InputFiles::iter) {
        inputs.add(input.identity.path(), input.role);
    }
    Film { saved: Arc::new(result.into_saved_film()), stats, interrupted, inputs: Arc::new(inputs) }
}

/// The exception of a render that ended early: Ctrl-C gets the samples until then as an attribute.
fn ended(py: Python<'_>, raised: PyErr, attribute: &str, films: Py<PyAny>) -> Failure {
    if !raised.is_instance_of::<pyo3::exceptions::PyKeyboardInterrupt>(py) {
        return raised.into();
    }
    let error =
        Interrupted::new_err(format!("the render was interrupted; the attribute `{attribute}` has its samples"));
    match error.value(py).setattr(attribute, films) {
        Ok(()) => error.into(),
        Err(e) => e.into(),
    }
}

/// The effects of these names.
fn effects_of(without: Option<NamesArgument>) -> Result<Vec<Effect>, Failure> {
    without.map_or_else(|| Ok(Vec::new()), |names| names.each(effect_left_out))
}

/// A plan from Python: a film, an array of numbers of samples, or the path of an EXR.
fn replay_of(plan: &Bound<'_, PyAny>) -> Result<ReplayOption, Failure> {
    if let Ok(film) = plan.cast::<Film>() {
        return Ok(ReplayOption::Plan(SavedPlan::of_film(&film.get().saved)?));
    }
    if let Ok(counts) = plan.extract::<CountsArray<'_>>() {
        return Ok(ReplayOption::Samples(counts.plane("replay")?));
    }
    let path = plan.extract::<PathBuf>().map_err(|_| {
        let kind = plan.get_type().name().map_or_else(|_| "value".into(), |name| name.to_string());
        let takes = "a film, a path, or an array of uint32 or int64 of shape (height, width)";
        PyTypeError::new_err(format!("replay takes {takes}, and no such {kind}"))
    })?;
    Ok(ReplayOption::File(path))
}

#[pymethods]
impl Scene {
    #[new]
    #[pyo3(signature = (path, *, without=None, threads=0))]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        without: Option<NamesArgument>,
        #[pyo3(from_py_with = threads_of)] threads: usize,
    ) -> Result<Self, Failure> {
        let without = effects_of(without)?;
        py.detach(|| Self::open(path, None, without, threads).map_err(PyErr::from)).map_err(Failure::from)
    }

    /// Opens a job from a text of TOML or a dictionary with the keys of a job file. Paths in it are relative to `folder`.
    /// `without` and `threads` are those of `Scene(path)`.
    #[staticmethod]
    #[pyo3(signature = (job, folder=None, *, without=None, threads=0))]
    fn from_job(
        py: Python<'_>,
        job: &Bound<'_, PyAny>,
        folder: Option<PathBuf>,
        without: Option<NamesArgument>,
        #[pyo3(from_py_with = threads_of)] threads: usize,
    ) -> Result<Self, Failure> {
        let path = folder.unwrap_or_default().join("job.toml");
        let (text, without) = (job_text(job)?, effects_of(without)?);
        py.detach(|| Self::open(path, Some(text), without, threads).map_err(PyErr::from)).map_err(Failure::from)
    }

    /// Changes scene and settings by keys of a job (a text of TOML or a dictionary), which are merged into the job. They
    /// replace the overrides of an earlier call. Parts of scene files that do not change are not built again. Keys can be
    /// keywords as well, such as `light=[Light(...)]`, beside a dictionary or alone. Without arguments there are no overrides.
    #[pyo3(signature = (overrides=None, /, **keys))]
    fn set_overrides(
        &self,
        py: Python<'_>,
        overrides: Option<&Bound<'_, PyAny>>,
        keys: Option<&Bound<'_, PyDict>>,
    ) -> Result<(), Failure> {
        let text = overrides_text(py, overrides, keys)?;
        self.with(py, |project| {
            project.set_overrides(&text)?;
            // Within the lock of the project, so that the text is always that of the project.
            *lock(&self.overrides) = text;
            Ok::<_, Error>(())
        })??;
        Ok(())
    }

    /// Renders the scene. The defaults of all arguments are the settings of the job.
    ///
    /// Keywords beside those of the signature are keys of the job, listed in `RenderKeys`: `spp`, `time` [s], `noise` (k) and
    /// `share` [%] limit the render, and one of them replaces all limits of the job; `width`, `height`, `seed`, `frame`,
    /// `strategy`, `sensor` (a `Sensor`, a preset, a file, or "none"), `exposure` ([s] or "auto"), `exposure_noise`,
    /// `vignetting`, `denoise`, `oidn`, `memory` (bytes, or a text such as "6GB"). A denoised picture is a layer of the files
    /// that the film writes; its arrays stay those of the unbiased mean.
    ///
    /// `samples` are the first sample and the end of a part, for `merge`. `checkpoint_every` [s] is the pause between two
    /// checkpoints. `progress` is called with (stage, fraction, elapsed [s], remaining [s] or None).
    ///
    /// `replay` renders the samples of an earlier render instead of a limit: a film, or the path of an EXR that `save_exr`,
    /// `save_plan` or the program wrote. Size, seed and frame are those of that render, unless they are
    /// given. An array of samples per pixel (uint32 or int64 of shape (height, width)) gives the size alone.
    ///
    /// Ctrl-C ends the render and raises `Interrupted`, whose `film` has the samples until then.
    #[pyo3(signature = (*, camera=None, threads=None, samples=None, replay=None, checkpoint=None, checkpoint_every=None,
        progress=None, **keys))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn render(
        &self,
        py: Python<'_>,
        camera: Option<String>,
        #[pyo3(from_py_with = some_threads_of)] threads: Option<usize>,
        samples: Option<(u32, u32)>,
        replay: Option<&Bound<'_, PyAny>>,
        checkpoint: Option<PathBuf>,
        checkpoint_every: Option<f64>,
        progress: Option<Py<PyAny>>,
        keys: Option<&Bound<'_, PyDict>>,
    ) -> Result<Film, Failure> {
        let mut options = Keywords::new("render", keys, OF_RENDER)?.options();
        (options.camera, options.threads) = (camera, checked_threads(threads)?);
        options.samples = samples.map(|(from, to)| from..to);
        (options.checkpoint, options.checkpoint_every) = (checkpoint, checkpoint_every);
        let render =
            |project: &mut Project, options, sink: &dyn Progress, cancel: &Cancel, each: &mut EachCapture<'_>| {
                each(None, project.render_options(options, sink, cancel)?)
            };
        let (films, raised) = self.films(py, options, replay, progress.as_ref(), render)?;
        let film = films.into_iter().next().map(|(_, film)| film);
        let film = film.ok_or_else(|| setting("render", "there is no image", "render again"))?;
        match raised {
            None => Ok(film),
            Some(raised) => Err(ended(py, raised, "film", Py::new(py, film)?.into_any())),
        }
    }

    /// Renders the captures of the job ([[capture]]): a dictionary of their films by name, in the order of the job, from one
    /// render of each camera. Where captures without a camera have several, the name of the camera comes first, as in
    /// "left-dark". The keywords are those of `render`, without parts and checkpoints.
    ///
    /// Ctrl-C ends the render and raises `Interrupted`, whose `films` have the samples until then.
    #[pyo3(signature = (*, camera=None, threads=None, replay=None, progress=None, **keys))]
    fn render_captures<'py>(
        &self,
        py: Python<'py>,
        camera: Option<String>,
        #[pyo3(from_py_with = some_threads_of)] threads: Option<usize>,
        replay: Option<&Bound<'py, PyAny>>,
        progress: Option<Py<PyAny>>,
        keys: Option<&Bound<'py, PyDict>>,
    ) -> Result<Bound<'py, PyDict>, Failure> {
        let mut options = Keywords::new("render_captures", keys, OF_RENDER)?.options();
        (options.camera, options.threads) = (camera, checked_threads(threads)?);
        let (films, raised) = self.films(py, options, replay, progress.as_ref(), Project::render_captures_options)?;
        let by_name = PyDict::new(py);
        for (name, film) in films {
            by_name.set_item(name, Py::new(py, film)?)?;
        }
        match raised {
            None => Ok(by_name),
            Some(raised) => Err(ended(py, raised, "films", by_name.into_any().unbind())),
        }
    }

    /// The steps of one render, one for each per cent, with the keywords of `render` except `progress`: `tqdm` can wrap it.
    /// Its attribute `film` is the film.
    #[pyo3(signature = (**options))]
    fn render_steps<'py>(slf: &Bound<'py, Self>, options: Option<Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        let py = slf.py();
        let options = options.unwrap_or_else(|| PyDict::new(py));
        py.import("dunkelfeld._steps")?.call_method1("RenderSteps", (slf, options))
    }

    /// Traces one sample of the pixel in column `x` and row `y` as a render does: the path of `--debug-sample`. `sample` is its
    /// number in the pixel. The other arguments are those of `render`; the sample depends on them.
    ///
    /// Returns a dictionary: `radiance` [W/(m² sr)], `is_valid`, and `vertices`, a list of dictionaries from the camera on.
    /// A vertex has `before` (index of the vertex before it; where the path was split, several have the same), `material`,
    /// `position` [m] (None where the ray left the scene), `left_toward`, `in_medium`, `throughput`, `emitted`, `direct`
    /// [W/(m² sr)], `connections` through covers, and `scattered` (`direction`, `lobe`, `pdf` [1/sr], `weight`; None where the
    /// path ended).
    #[pyo3(signature = (x, y, sample, *, camera=None, **keys))]
    fn trace_sample<'py>(
        &self,
        py: Python<'py>,
        x: u32,
        y: u32,
        sample: u32,
        camera: Option<String>,
        keys: Option<&Bound<'_, PyDict>>,
    ) -> Result<Bound<'py, PyAny>, Failure> {
        let mut options = Keywords::new("trace_sample", keys, OF_RENDER)?.options();
        options.camera = camera;
        let at = PixelSample { x, y, index: sample };
        let traced = self.with(py, move |project| project.trace_options(options, at))??;
        loaded(py, &traced)
    }

    /// The content of the scene as a dictionary, as `dunkelfeld inspect --json`.
    fn inspect<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyAny>, Failure> {
        let inspection = self.with(py, |project| project.inspect())?;
        loaded(py, &inspection)
    }

    /// Names of the cameras.
    #[getter]
    fn cameras(&self, py: Python<'_>) -> Result<Vec<String>, Failure> {
        self.with(py, |project| project.scene.cameras().iter().map(|camera| camera.name.clone()).collect())
    }

    /// Names of the objects by id.
    #[getter]
    fn objects(&self, py: Python<'_>) -> Result<Vec<String>, Failure> {
        self.with(py, |project| project.scene.object_names().to_vec())
    }

    /// Names of the materials by id.
    #[getter]
    fn materials(&self, py: Python<'_>) -> Result<Vec<String>, Failure> {
        self.with(py, |project| project.scene.materials().iter().map(|m| m.name.clone()).collect())
    }

    /// Names of the effects that the scene uses, as of `dunkelfeld inspect`. They are values of `without`, except those that
    /// cannot be taken away, such as "color".
    #[getter]
    fn effects(&self, py: Python<'_>) -> Result<Vec<String>, Failure> {
        let inspection = self.with(py, |project| project.inspect())?;
        Ok(inspection.effects.into_iter().filter(|effect| effect.on).map(|effect| effect.name).collect())
    }

    /// Names of the effects that are left out.
    #[getter]
    fn without(&self) -> Vec<&'static str> {
        self.without.iter().map(|effect| effect.name()).collect()
    }

    /// Hazards of the scene and of its images, as texts.
    #[getter]
    fn hazards(&self, py: Python<'_>) -> Result<Vec<String>, Failure> {
        self.with(py, |project| project.findings().hazards().map(|f| format!("{}: {}", f.place, f.message)).collect())
    }

    /// The absolute paths of the files that the scene was made from: scene, textures, sensor and job.
    #[getter]
    fn inputs(&self, py: Python<'_>) -> Result<Vec<PathBuf>, Failure> {
        self.with(py, |project| names_of(project.inputs.iter()))
    }

    /// A table of the content and the hazards, for notebooks.
    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("dunkelfeld._html")?.call_method1("scene_html", (slf,))
    }

    fn __repr__(&self) -> String {
        let (path, text) = &self.origin;
        let path: &Path = if text.is_some() { Path::new("a job") } else { path };
        format!("Scene({})", path.display())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (path, text) = &self.origin;
        let overrides = lock(&self.overrides).clone();
        let arguments = (path.clone(), text.clone(), overrides, self.without(), self.threads).into_pyobject(py)?;
        Ok((py.get_type::<Self>().getattr("_restore")?, arguments))
    }

    #[staticmethod]
    fn _restore(
        py: Python<'_>,
        path: PathBuf,
        text: Option<String>,
        overrides: String,
        without: NamesArgument,
        threads: usize,
    ) -> Result<Self, Failure> {
        let without = effects_of(Some(without))?;
        let opened = py.detach(|| {
            let scene = Self::open(path, text, without, threads)?;
            if !overrides.is_empty() {
                lock(&scene.project).set_overrides(&overrides)?;
                *lock(&scene.overrides) = overrides;
            }
            Ok(scene)
        });
        opened.map_err(|failure: Failure| failure)
    }
}
