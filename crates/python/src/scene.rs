//! Scenes: opened, changed and rendered.

use crate::errors::{Failure, Interrupted, setting};
use crate::film::Film;
use crate::job::job_text;
use crate::sensor::{ExposureArgument, SensorArgument};
use crate::work::interruptible;
use dunkelfeld::adaptive::Strategy;
use dunkelfeld::{Cancel, Progress, ProgressState, Project, ProjectOptions, RenderOptions};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

/// A scene or job file. `Scene(path)` opens a scene (`.glb`, `.gltf`, `.obj`, `.stl`, `.ply`) or a job (`.toml`).
///
/// A scene can be used by several threads; its renders run one after the other.
#[pyclass(frozen, module = "dunkelfeld")]
pub(crate) struct Scene {
    project: Mutex<Project>,
    /// Path, text of a job that is no file, and the overrides: for copies.
    origin: (PathBuf, Option<String>),
    overrides: Mutex<String>,
}

thread_local! {
    /// The address of the scene whose progress function runs on this thread, or 0.
    static REPORTS: Cell<usize> = const { Cell::new(0) };
}

/// Calls a function of Python with the progress. An exception cancels the render.
struct Callback<'a> {
    function: &'a Py<PyAny>,
    /// The address of the scene.
    scene: usize,
    cancel: &'a Cancel,
    raised: Mutex<Option<PyErr>>,
}

impl Progress for Callback<'_> {
    fn update(&self, state: &ProgressState) {
        let called = Python::attach(|py| {
            let arguments = (state.stage.name(), state.fraction, state.elapsed, state.remaining);
            let before = REPORTS.replace(self.scene);
            let called = self.function.call1(py, arguments).map(|_| ());
            REPORTS.set(before);
            called
        });
        if let Err(e) = called {
            self.cancel.cancel();
            lock(&self.raised).get_or_insert(e);
        }
    }
}

/// The content of a lock. Its data stay valid if a thread panicked.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

impl Scene {
    /// Refuses the use of a scene by its own progress function, which would wait for the end of the render.
    fn check_idle(&self) -> Result<(), Failure> {
        if REPORTS.get() == std::ptr::from_ref(self).addr() {
            let problem = "a progress function cannot use the scene that it reports about";
            return Err(setting("scene", problem, "use it after the render"));
        }
        Ok(())
    }

    /// Works on the project without the lock of the interpreter: a render on another thread may need that lock.
    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Project) -> T + Send) -> Result<T, Failure> {
        self.check_idle()?;
        Ok(py.detach(|| work(&mut lock(&self.project))))
    }

    fn open(path: PathBuf, text: Option<String>) -> Result<Self, Failure> {
        let project = match &text {
            None => Project::open_with(&path, ProjectOptions::default())?,
            Some(text) => Project::from_text(&path, text)?,
        };
        Ok(Self { project: Mutex::new(project), origin: (path, text), overrides: Mutex::default() })
    }
}

/// The error of a panic.
fn panicked() -> Failure {
    setting("render", "the render panicked", "report it with the scene")
}

#[pymethods]
impl Scene {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> Result<Self, Failure> {
        py.detach(|| Self::open(path, None).map_err(PyErr::from)).map_err(Failure::from)
    }

    /// Opens a job from a text of TOML or a dictionary with the keys of a job file. Paths in it are relative to `folder`.
    #[staticmethod]
    #[pyo3(signature = (job, folder=None))]
    fn from_job(py: Python<'_>, job: &Bound<'_, PyAny>, folder: Option<PathBuf>) -> Result<Self, Failure> {
        let path = folder.unwrap_or_default().join("job.toml");
        let text = job_text(job)?;
        py.detach(|| Self::open(path, Some(text)).map_err(PyErr::from)).map_err(Failure::from)
    }

    /// Changes scene and settings by keys of a job (a text of TOML or a dictionary), which are merged into the job. They
    /// replace the overrides of an earlier call. Parts of scene files that do not change are not built again.
    fn set_overrides(&self, py: Python<'_>, overrides: &Bound<'_, PyAny>) -> Result<(), Failure> {
        let text = job_text(overrides)?;
        self.with(py, |project| {
            project.set_overrides(&text)?;
            // Within the lock of the project, so that the text is always that of the project.
            *lock(&self.overrides) = text;
            Ok::<_, dunkelfeld::Error>(())
        })??;
        Ok(())
    }

    /// Renders the scene. The defaults of all arguments are the settings of the job. `time` [s], `spp` and `noise` (k) limit
    /// the render; one of them replaces all limits of the job. `sensor` is a `Sensor`, the name of a preset or file, or
    /// "none"; `exposure` is a time [s] or "auto". `progress` is called with (stage, fraction, elapsed [s], remaining [s] or None).
    ///
    /// Ctrl-C ends the render and raises `Interrupted`, whose `film` has the samples until then.
    #[pyo3(signature = (*, spp=None, time=None, noise=None, width=None, height=None, camera=None, seed=None, frame=None,
        threads=None, strategy=None, sensor=None, exposure=None, checkpoint=None, progress=None))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn render(
        &self,
        py: Python<'_>,
        spp: Option<f64>,
        time: Option<f64>,
        noise: Option<f64>,
        width: Option<u32>,
        height: Option<u32>,
        camera: Option<String>,
        seed: Option<u64>,
        frame: Option<u32>,
        threads: Option<usize>,
        strategy: Option<&str>,
        sensor: Option<SensorArgument>,
        exposure: Option<ExposureArgument>,
        checkpoint: Option<PathBuf>,
        progress: Option<Py<PyAny>>,
    ) -> Result<Film, Failure> {
        self.check_idle()?;
        let strategy = strategy.map(str::parse::<Strategy>).transpose();
        let strategy =
            strategy.map_err(|e| setting("strategy", e.to_string(), "uniform, sobel, variance or sensor"))?;
        let mut options = RenderOptions::default();
        (options.width, options.height, options.camera) = (width, height, camera);
        (options.time, options.spp, options.noise) = (time, spp, noise);
        (options.seed, options.frame, options.threads, options.strategy) = (seed, frame, threads, strategy);
        options.sensor = sensor.map(SensorArgument::option);
        options.exposure = exposure.map(ExposureArgument::option).transpose()?;
        options.checkpoint = checkpoint;
        let cancel = Cancel::new();
        let callback = progress.as_ref().map(|function| Callback {
            function,
            scene: std::ptr::from_ref(self).addr(),
            cancel: &cancel,
            raised: Mutex::default(),
        });
        let work = || -> Result<Film, dunkelfeld::Error> {
            let mut project = lock(&self.project);
            let silent = dunkelfeld::Silent;
            let sink: &dyn Progress = callback.as_ref().map_or(&silent, |callback| callback);
            let result = project.render_options(options, sink, &cancel)?;
            let names = project.scene.materials().iter().map(|m| m.name.clone()).collect();
            let (stats, interrupted) = (result.stats.to_json(), result.rendering.interrupted);
            let saved = Arc::new(result.into_saved_film());
            Ok(Film { saved, material_names: Arc::new(names), stats, interrupted })
        };
        let (result, raised) = interruptible(py, &cancel, work);
        let raised = raised.or_else(|| callback.and_then(|c| lock(&c.raised).take()));
        let film = match result {
            // An exception of Python is the cause of an error that follows it.
            Some(Err(_)) | None if raised.is_some() => return Err(raised.map_or_else(panicked, Failure::from)),
            Some(result) => result?,
            None => return Err(panicked()),
        };
        let Some(raised) = raised else { return Ok(film) };
        if !raised.is_instance_of::<pyo3::exceptions::PyKeyboardInterrupt>(py) {
            return Err(raised.into());
        }
        let error = Interrupted::new_err("the render was interrupted; the attribute `film` has its samples");
        error.value(py).setattr("film", Py::new(py, film)?)?;
        Err(error.into())
    }

    /// The content of the scene as a dictionary, as `dunkelfeld inspect --json`.
    fn inspect<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyAny>, Failure> {
        let inspection = self.with(py, |project| project.inspect())?;
        let text = serde_json::to_string(&inspection).map_err(|e| setting("inspect", e.to_string(), "report it"))?;
        Ok(py.import("json")?.call_method1("loads", (text,))?)
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

    /// Hazards of the scene and of its images, as texts.
    #[getter]
    fn hazards(&self, py: Python<'_>) -> Result<Vec<String>, Failure> {
        self.with(py, |project| project.findings().hazards().map(|f| format!("{}: {}", f.place, f.message)).collect())
    }

    fn __repr__(&self) -> String {
        let (path, text) = &self.origin;
        let path: &Path = if text.is_some() { Path::new("a job") } else { path };
        format!("Scene({})", path.display())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (path, text) = &self.origin;
        let arguments = (path.clone(), text.clone(), lock(&self.overrides).clone()).into_pyobject(py)?;
        Ok((py.get_type::<Self>().getattr("_restore")?, arguments))
    }

    #[staticmethod]
    fn _restore(py: Python<'_>, path: PathBuf, text: Option<String>, overrides: String) -> Result<Self, Failure> {
        let opened = py.detach(|| {
            let scene = Self::open(path, text)?;
            if !overrides.is_empty() {
                lock(&scene.project).set_overrides(&overrides)?;
                *lock(&scene.overrides) = overrides;
            }
            Ok(scene)
        });
        opened.map_err(|failure: Failure| failure)
    }
}
