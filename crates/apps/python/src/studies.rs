//! The studies of a scene: `bench` and `ptc`.

use crate::arguments::{
    NamesArgument, PathsArgument, checked_threads, effect_of, method_of, some_threads_of, strategy_of,
};
use crate::errors::{Failure, setting};
use crate::json::loaded;
use crate::keywords::Keywords;
use crate::progress::{completed, supervised};
use crate::scene::Scene;
use dunkelfeld::io::OF_STUDY;
use dunkelfeld::{Error, ProgressState, Project, ProjectOptions, Session, Stage};
use dunkelfeld_studies::bench::BenchSettings;
use dunkelfeld_studies::photon_transfer::{PtcSettings, is_frame, of_render_only, ptc_of_frames};
use dunkelfeld_studies::{Figures, StudyOutcome, default_folder};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};

/// The results of a study.
struct Study {
    folder: PathBuf,
    files: Vec<PathBuf>,
    findings: Vec<String>,
    figures: Figures,
    /// Numbers of finished renders, of all renders, and of invalid samples.
    numbers: [u64; 3],
}

impl Study {
    fn entries<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyDict>, Failure> {
        let text = |path: &PathBuf| path.display().to_string();
        let entries = PyDict::new(py);
        entries.set_item("folder", text(&self.folder))?;
        entries.set_item("report", self.files.first().map(text))?;
        entries.set_item("files", self.files.iter().map(text).collect::<Vec<_>>())?;
        entries.set_item("findings", &self.findings)?;
        entries.set_item("figures", loaded(py, &self.figures)?)?;
        for (key, number) in ["finished", "renders", "invalid_samples"].into_iter().zip(self.numbers) {
            entries.set_item(key, number)?;
        }
        Ok(entries)
    }
}

/// The input of a study: a path, or a scene that was opened from one.
#[derive(FromPyObject)]
pub(crate) enum InputArgument {
    Scene(Py<Scene>),
    Path(PathBuf),
}

impl InputArgument {
    fn path(self) -> Result<PathBuf, Failure> {
        match self {
            Self::Scene(scene) => scene.get().path_of_studies(),
            Self::Path(path) => Ok(path),
        }
    }
}

/// The input of `ptc`: also several paths.
#[derive(FromPyObject)]
pub(crate) enum StackArgument {
    One(InputArgument),
    Paths(PathsArgument),
}

impl StackArgument {
    fn list(self) -> Result<Vec<PathBuf>, Failure> {
        match self {
            Self::One(input) => Ok(vec![input.path()?]),
            Self::Paths(paths) => Ok(paths.list()),
        }
    }
}

/// What the renders of a study have in place of their job's.
struct View {
    keywords: Keywords,
    camera: Option<String>,
    threads: usize,
}

/// A list of values; an empty one stands for the defaults.
fn given<T>(name: &str, values: Option<Vec<T>>) -> Result<Vec<T>, Failure> {
    match values {
        Some(values) if values.is_empty() => {
            Err(setting(name, "is an empty list", "name values, or leave it out for the defaults"))
        }
        values => Ok(values.unwrap_or_default()),
    }
}

/// Opens an input with the options of a study, and runs the study in a folder: by default the one of its name.
fn study<'py>(
    py: Python<'py>,
    progress: Option<&Py<PyAny>>,
    (input, view): (&Path, View),
    (output, name): (Option<PathBuf>, &str),
    run: impl FnOnce(Project, &Path, &Session<'_>) -> Result<StudyOutcome, Error> + Send,
) -> Result<Bound<'py, PyDict>, Failure> {
    let done = supervised(py, progress, 0, |sink, cancel| {
        sink.update(&ProgressState { stage: Stage::Load, fraction: 0.0, elapsed: 0.0, remaining: None, samples: 0 });
        let keys = view.keywords.keys.clone();
        let options = ProjectOptions::default().with_can_change(false).with_threads(view.threads).with_keys(keys);
        let mut project = Project::open_with(input, options)?;
        let mut options = view.keywords.options();
        options.camera = view.camera;
        project.apply_options(options)?;
        let folder = output.unwrap_or_else(|| default_folder(input, name));
        let session = Session::new(project.settings.run.threads)?.with_progress(sink).with_cancel(cancel);
        let o = run(project, &folder, &session)?;
        let numbers = [o.finished[0] as u64, o.finished[1] as u64, o.invalid_samples];
        Ok(Study { folder, files: o.files, findings: o.findings, figures: o.figures, numbers })
    })?;
    completed(done)?.entries(py)
}

/// Renders a scene or job many times with different seeds, and writes noise against time of each strategy and denoiser,
/// the time until the noise is hidden, and cost and bias of each effect into the folder `output` (default: the name of
/// the input with -bench): `report.html`, tables as CSV, charts as SVG. `input` is a path, or a `Scene` from a path without
/// overrides, which is opened again. The options are those of `dunkelfeld bench`.
///
/// Returns a dictionary: `folder`, `report` and `files` (paths), `findings` (texts), `figures` (the rows of the tables
/// noise, hidden, denoised, stages and effects, with the keys of the CSV; None where a number is unknown), `finished` and
/// `renders` (numbers), `invalid_samples`.
///
/// Ctrl-C and an exception of `progress` end it; the same call continues with the missing renders.
#[pyfunction]
#[pyo3(signature = (input, output=None, *, quick=false, restart=false, spp=None, seeds=None, strategies=None, noise=None,
    effects=None, denoise=None, oidn=None, effect_spp=None, reference_spp=None, camera=None, threads=None, progress=None,
    **keys))]
#[allow(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn bench<'py>(
    py: Python<'py>,
    input: InputArgument,
    output: Option<PathBuf>,
    quick: bool,
    restart: bool,
    spp: Option<Vec<u32>>,
    seeds: Option<u32>,
    strategies: Option<NamesArgument>,
    noise: Option<Vec<f64>>,
    effects: Option<NamesArgument>,
    denoise: Option<NamesArgument>,
    oidn: Option<PathBuf>,
    effect_spp: Option<u32>,
    reference_spp: Option<u32>,
    camera: Option<String>,
    #[pyo3(from_py_with = some_threads_of)] threads: Option<usize>,
    progress: Option<Py<PyAny>>,
    keys: Option<&Bound<'_, PyDict>>,
) -> Result<Bound<'py, PyDict>, Failure> {
    let keywords = Keywords::new("bench", keys, OF_STUDY)?;
    let has_size = ["film.width", "film.height"].iter().any(|key| keywords.keys.contains(key));
    let input = input.path()?;
    let strategies = strategies.map(|names| names.each(|name| strategy_of("strategies", name))).transpose()?;
    let settings = BenchSettings::default()
        .with_quick(quick)
        .with_spp(given("spp", spp)?)
        .with_seeds(seeds)
        .with_strategies(given("strategies", strategies)?)
        .with_noise(given("noise", noise)?)
        .with_effects(effects.map(|names| names.each(effect_of)).transpose()?)
        .with_denoise(given("denoise", denoise.map(|names| names.each(method_of)).transpose()?)?)
        .with_oidn(oidn)
        .with_effect_spp(effect_spp)
        .with_reference_spp(reference_spp);
    settings.check()?;
    let view = View { keywords, camera, threads: checked_threads(threads)?.unwrap_or(0) };
    let input = &input;
    study(py, progress.as_ref(), (input, view), (output, "bench"), |project, folder, session| {
        dunkelfeld_studies::bench::bench(project, input, &settings, folder, has_size, restart, session)
    })
}

/// Measures the photon transfer of a scene or job, as Kludt et al., or that of frames from files (.png, .tif, .bmp), and
/// writes `report.html`, tables as CSV and charts as SVG into the folder `output` (default: the name of the input with
/// -ptc). A scene can be a `Scene` from a path without overrides, which is opened again. The options are those of
/// `dunkelfeld ptc`. `dark` and `saturation` [DN] are for frames only; with frames, only `edges` is used beside them.
///
/// Returns a dictionary: `folder`, `report` and `files` (paths), `findings` (texts), `figures` (tables: of a scene series,
/// lines and curves; of frames curves, lines and variance; None where a number is unknown), `finished` and `renders`
/// (numbers; frames of files count as renders), `invalid_samples`.
///
/// Ctrl-C and an exception of `progress` end it; the same call continues with the missing renders.
#[pyfunction]
#[pyo3(signature = (input, output=None, *, restart=false, frames=None, spp=None, denoise=None, oidn=None, edges=None,
    pictures_only=false, dark=None, saturation=None, camera=None, threads=None, progress=None, **keys))]
#[allow(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn ptc<'py>(
    py: Python<'py>,
    input: StackArgument,
    output: Option<PathBuf>,
    restart: bool,
    frames: Option<u32>,
    spp: Option<Vec<u32>>,
    denoise: Option<&str>,
    oidn: Option<PathBuf>,
    edges: Option<f64>,
    pictures_only: bool,
    dark: Option<f64>,
    saturation: Option<f64>,
    camera: Option<String>,
    #[pyo3(from_py_with = some_threads_of)] threads: Option<usize>,
    progress: Option<Py<PyAny>>,
    keys: Option<&Bound<'_, PyDict>>,
) -> Result<Bound<'py, PyDict>, Failure> {
    let keywords = Keywords::new("ptc", keys, OF_STUDY)?;
    let inputs = input.list()?;
    let settings = PtcSettings::default()
        .with_frames(frames)
        .with_spp(given("spp", spp)?)
        .with_denoise(denoise.map(method_of).transpose()?)
        .with_oidn(oidn)
        .with_edges(edges)
        .with_pictures_only(pictures_only)
        .with_dark(dark)
        .with_saturation(saturation);
    if !inputs.is_empty() && inputs.iter().all(|path| is_frame(path)) {
        let of_render = [
            ("width, height, sensor, exposure, seed or memory", !keywords.is_empty()),
            ("camera", camera.is_some()),
            ("restart", restart),
            ("threads", threads.is_some()),
        ];
        if let Some((name, _)) = of_render.iter().find(|(_, given)| *given) {
            return Err(of_render_only(name).into());
        }
        return ptc_frames(py, &inputs, output, &settings, progress.as_ref());
    }
    let [input] = inputs.as_slice() else {
        let problem = format!("{} inputs are neither one scene nor a stack of frames", inputs.len());
        return Err(setting("input", problem, "give one scene or job, or frames (.png, .tif, .bmp) alone"));
    };
    settings.check()?;
    let view = View { keywords, camera, threads: checked_threads(threads)?.unwrap_or(0) };
    study(py, progress.as_ref(), (input, view), (output, "ptc"), |project, folder, session| {
        dunkelfeld_studies::photon_transfer::ptc(project, input, &settings, folder, restart, session)
    })
}

/// The photon transfer of files.
fn ptc_frames<'py>(
    py: Python<'py>,
    inputs: &[PathBuf],
    output: Option<PathBuf>,
    settings: &PtcSettings,
    progress: Option<&Py<PyAny>>,
) -> Result<Bound<'py, PyDict>, Failure> {
    let done = supervised(py, progress, 0, |sink, cancel| {
        let session = Session::new(1)?.with_progress(sink).with_cancel(cancel);
        let Some(stack) = ptc_of_frames(inputs, settings, &session)? else { return Ok(None) };
        let first = inputs.first().map_or(Path::new(""), PathBuf::as_path);
        let folder = output.unwrap_or_else(|| default_folder(first, "ptc"));
        let files = stack.write(&folder)?;
        let numbers = [inputs.len() as u64, inputs.len() as u64, 0];
        Ok(Some(Study { folder, files, findings: stack.findings(), figures: stack.figures(), numbers }))
    })?;
    match completed(done)? {
        Some(study) => study.entries(py),
        None => Err(setting("ptc", "was cancelled", "call it again")),
    }
}
