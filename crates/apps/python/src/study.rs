//! Data sets: studies, single images for programs that distribute them, and the folder of a set.

use crate::arguments::{checked_threads, index_of, indices_of, jobs_of, some_threads_of, threads_of};
use crate::errors::{Failure, internal, setting};
use crate::inputs::names_of;
use crate::json::loaded;
use crate::progress::{lock, lock_unless};
use crate::work::{SIGNALS, interruptible};
use dunkelfeld::{Cancel, Error};
use dunkelfeld_dataset::{
    Cost, Made as MadeImage, Record, RunOptions, RunProgress, RunState, RunSummary, Set, Study as SetStudy, Worker,
    run, verify,
};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use std::collections::BTreeMap;
use std::ffi::CString;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// A study: a job whose values may be distributions, and a description of the images and labels of a data set.
#[pyclass(frozen, module = "dunkelfeld.dataset")]
pub(crate) struct Study(Arc<SetStudy>);

#[pymethods]
impl Study {
    /// Reads a study file (`.toml`).
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> Result<Self, Failure> {
        // A copy may be made in another folder.
        let path = std::path::absolute(&path).unwrap_or(path);
        Ok(Self(Arc::new(py.detach(|| SetStudy::open(path))?)))
    }

    /// Name of the study.
    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// Number of images that the study names.
    #[getter]
    fn count(&self) -> u64 {
        self.0.count
    }

    /// Hash of the texts of the study and of its job, 32 hexadecimal digits. The files of the scene are not part of it.
    #[getter]
    fn hash(&self) -> &str {
        self.0.hash()
    }

    /// The absolute path of the study.
    #[getter]
    fn path(&self) -> PathBuf {
        self.0.path().to_path_buf()
    }

    /// Makes the missing images of a set in `folder`, as `dunkelfeld dataset`, and the files of the whole set. `count` is
    /// the number of images (default: that of the study); `indices` are the only images to make; `jobs` images are made at
    /// the same time (default: one per core), each with `threads` threads (default: 1, and with one job one per core);
    /// `time` [s] is for all missing images together, instead of the budget of the job. `progress` is
    /// called with (finished images, all images, elapsed [s], remaining [s] or None), from the threads of the run.
    ///
    /// Returns a dictionary: `made`, `finished` and `count` (images), `seconds`, `failed` (index and message of
    /// images whose draws do not fit), `price` of the whole set by the images of this run, or None.
    /// Raises the error of the first image if the set has no image yet and the draws of this image do not fit.
    /// Ctrl-C and an exception of `progress` end the run; finished images remain, and the same call continues.
    #[pyo3(signature = (folder, *, count=None, indices=None, jobs=None, threads=None, time=None, progress=None))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn run<'py>(
        &self,
        py: Python<'py>,
        folder: PathBuf,
        count: Option<u64>,
        #[pyo3(from_py_with = indices_of)] indices: Option<Vec<u64>>,
        #[pyo3(from_py_with = jobs_of)] jobs: Option<usize>,
        #[pyo3(from_py_with = some_threads_of)] threads: Option<usize>,
        time: Option<f64>,
        progress: Option<Py<PyAny>>,
    ) -> Result<Bound<'py, PyDict>, Failure> {
        let mut options = RunOptions::default();
        (options.count, options.indices) = (count, indices);
        options.jobs = jobs;
        options.threads = checked_threads(threads)?;
        options.seconds = checked_seconds(time)?;
        let cancel = Cancel::new();
        let sink = Reports { function: progress.as_ref(), cancel: &cancel, raised: Mutex::default() };
        let (result, raised) = interruptible(py, &cancel, || run(&self.0, &folder, &options, &sink, &cancel));
        if let Some(raised) = raised.or_else(|| lock(&sink.raised).take()) {
            return Err(raised.into());
        }
        let RunSummary { made, finished, count, seconds, failed, price, .. } =
            result.ok_or_else(|| internal("a thread panicked"))??;
        let entries = PyDict::new(py);
        for (name, number) in [("made", made), ("finished", finished), ("count", count)] {
            entries.set_item(name, number)?;
        }
        entries.set_item("seconds", seconds)?;
        entries.set_item("failed", failed)?;
        entries.set_item("price", loaded(py, &price)?)?;
        Ok(entries)
    }

    /// Loads the scene, and makes single images. `threads` is the number of threads of each image; 0 means one per core.
    #[pyo3(signature = (threads=1))]
    fn worker(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = threads_of)] threads: usize,
    ) -> Result<StudyWorker, Failure> {
        let threads = checked_threads(Some(threads))?.unwrap_or(1);
        let worker = py.detach(|| Worker::open(&self.0, threads))?;
        let inputs = names_of([worker.project().inputs.iter(), self.0.inputs().iter()].into_iter().flatten());
        Ok(StudyWorker { worker: Mutex::new(worker), study: self.0.clone(), inputs })
    }

    /// Opens the folder of a set of this study for its images, and creates it if there is none. A set may grow; it never
    /// shrinks. This loads the scene.
    #[pyo3(signature = (folder, count=None))]
    fn open(&self, py: Python<'_>, folder: PathBuf, count: Option<u64>) -> Result<DataSet, Failure> {
        self.worker(py, 1)?.open(py, folder, count)
    }

    fn __repr__(&self) -> String {
        format!("Study({}, {} images)", self.0.path().display(), self.0.count)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        Ok((py.get_type::<Self>().into_any(), (self.0.path().to_path_buf(),).into_pyobject(py)?))
    }
}

fn checked_seconds(time: Option<f64>) -> Result<Option<f64>, Failure> {
    match time {
        Some(seconds) if !(seconds > 0.0 && seconds.is_finite()) => {
            Err(setting("time", format!("{seconds} s is out of range"), "pass a number of seconds above 0"))
        }
        time => Ok(time),
    }
}

/// Calls functions of Python with the progress of a run.
struct Reports<'a> {
    function: Option<&'a Py<PyAny>>,
    cancel: &'a Cancel,
    raised: Mutex<Option<PyErr>>,
}

impl Reports<'_> {
    /// An exception ends the run.
    fn check(&self, result: PyResult<()>) {
        if let Err(e) = result {
            self.cancel.cancel();
            lock(&self.raised).get_or_insert(e);
        }
    }
}

impl RunProgress for Reports<'_> {
    fn update(&self, state: &RunState) {
        let Some(function) = self.function else { return };
        let arguments = (state.finished, state.count, state.elapsed, state.remaining);
        self.check(Python::attach(|py| function.call1(py, arguments).map(|_| ())));
    }

    fn warning(&self, warning: &str) {
        self.check(Python::attach(|py| PyErr::warn(py, &py.get_type::<PyUserWarning>(), &CString::new(warning)?, 0)));
    }
}

/// Makes single images of a study, from `Study.worker`. Calls from several threads run one after the other.
#[pyclass(frozen, module = "dunkelfeld.dataset")]
pub(crate) struct StudyWorker {
    worker: Mutex<Worker>,
    study: Arc<SetStudy>,
    inputs: Vec<PathBuf>,
}

impl StudyWorker {
    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Worker) -> T + Send) -> PyResult<T> {
        let mut work = Some(work);
        loop {
            // A signal such as Ctrl-C ends a wait for an image on another thread.
            let tried = py.detach(|| {
                let began = Instant::now();
                let mut worker = lock_unless(&self.worker, || began.elapsed() > SIGNALS)?;
                work.take().map(|work| work(&mut worker))
            });
            match tried {
                Some(result) => return Ok(result),
                None => py.check_signals()?,
            }
        }
    }
}

#[pymethods]
impl StudyWorker {
    /// Makes the image `index`, counted from 0: the same bytes alone, in any order, with any number of threads. `time` [s]
    /// replaces the budget of the job; the image then depends on the speed of the machine. Nothing is written. Ctrl-C ends
    /// it.
    #[pyo3(signature = (index, time=None))]
    fn make(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = index_of)] index: u64,
        time: Option<f64>,
    ) -> Result<Made, Failure> {
        let time = checked_seconds(time)?;
        let cancel = Cancel::new();
        let (result, raised) = interruptible(py, &cancel, || {
            let mut worker = lock_unless(&self.worker, || cancel.is_cancelled())?;
            Some(worker.make(index, time, &cancel))
        });
        if let Some(raised) = raised {
            return Err(raised.into());
        }
        let made = result.ok_or_else(|| internal("a thread panicked"))?.transpose()?.flatten();
        made.map(Made).ok_or_else(|| internal("an image was cancelled"))
    }

    /// Opens the folder of a set for images of a run: the set, the number of images, and those that are not finished.
    fn _start(
        &self,
        py: Python<'_>,
        folder: PathBuf,
        count: Option<u64>,
        #[pyo3(from_py_with = indices_of)] indices: Option<Vec<u64>>,
    ) -> Result<(DataSet, u64, Vec<u64>), Failure> {
        let folder = std::path::absolute(&folder).unwrap_or(folder);
        let start = self.with(py, |worker| worker.start(&folder, count, indices.as_deref()))??;
        Ok((DataSet(start.set), start.wanted, start.missing))
    }

    /// Opens the folder of a set, as `Study.open`, without a second load of the scene.
    #[pyo3(signature = (folder, count=None))]
    fn open(&self, py: Python<'_>, folder: PathBuf, count: Option<u64>) -> Result<DataSet, Failure> {
        let folder = std::path::absolute(&folder).unwrap_or(folder);
        Ok(DataSet(self.with(py, |worker| worker.open_set(&folder, count))??))
    }

    /// Has the last image a budget by time? Then its bytes depend on the speed of the machine.
    #[getter]
    fn is_timed(&self, py: Python<'_>) -> PyResult<bool> {
        self.with(py, |worker| worker.project().settings.budget.seconds.is_some())
    }

    /// Settings of the study that have no effect, in sentences. `Study.run` gives them as warnings.
    #[getter]
    fn warnings(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |worker| worker.warnings().to_vec())
    }

    /// The absolute paths of the files that image 0 is made from: the scene with its textures, sensors, job and study. Files
    /// that only other images read are not in it.
    #[getter]
    fn inputs(&self) -> Vec<PathBuf> {
        self.inputs.clone()
    }

    fn __repr__(&self) -> String {
        format!("StudyWorker({})", self.study.path().display())
    }
}

/// An image of a study before its files are written. It can be pickled.
#[pyclass(frozen, module = "dunkelfeld.dataset")]
pub(crate) struct Made(MadeImage);

#[pymethods]
impl Made {
    /// Index of the image in its set.
    #[getter]
    fn index(&self) -> u64 {
        self.0.record.index
    }

    /// The record: draws, instances, certificate, and size and hash of each file.
    #[getter]
    fn record<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyAny>, Failure> {
        loaded(py, &self.0.record)
    }

    /// The contents of the files by their names, relative to the folder of the set.
    #[getter]
    fn files<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let entries = PyDict::new(py);
        for (name, content) in &self.0.files {
            entries.set_item(name, PyBytes::new(py, content))?;
        }
        Ok(entries)
    }

    /// Seconds of each part of the work, and their `total`.
    #[getter]
    fn cost<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyAny>, Failure> {
        loaded(py, &self.0.cost)
    }

    fn __repr__(&self) -> String {
        let bytes: usize = self.0.files.iter().map(|(_, content)| content.len()).sum();
        format!("Made(image {}, {} files, {bytes} bytes)", self.0.record.index, self.0.files.len())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> Result<(Bound<'py, PyAny>, Bound<'py, PyTuple>), Failure> {
        let (record, cost) = (text_of(&self.0.record)?, text_of(&self.0.cost)?);
        let arguments = (record, self.files(py)?, cost).into_pyobject(py)?;
        Ok((py.get_type::<Self>().getattr("_restore")?, arguments))
    }

    #[staticmethod]
    fn _restore(record: &str, files: BTreeMap<String, Bound<'_, PyBytes>>, cost: &str) -> Result<Self, Failure> {
        let broken =
            |e: serde_json::Error| setting("image", format!("the copy is broken: {e}"), "make the image again");
        let record: Record = serde_json::from_str(record).map_err(broken)?;
        let cost: Cost = serde_json::from_str(cost).map_err(broken)?;
        let files = files.into_iter().map(|(name, content)| (name, content.as_bytes().to_vec())).collect();
        Ok(Self(MadeImage { record, files, cost }))
    }
}

fn text_of(value: &impl serde::Serialize) -> Result<String, Failure> {
    serde_json::to_string(value).map_err(|e| internal(&e.to_string()))
}

/// The folder of a data set: `DataSet(folder)` opens one that exists, `Study.open` starts one.
#[pyclass(frozen, module = "dunkelfeld.dataset")]
pub(crate) struct DataSet(Set);

#[pymethods]
impl DataSet {
    #[new]
    fn new(py: Python<'_>, folder: PathBuf) -> Result<Self, Failure> {
        let folder = std::path::absolute(&folder).unwrap_or(folder);
        Ok(Self(py.detach(|| Set::read(&folder))?))
    }

    /// The absolute path of the folder.
    #[getter]
    fn path(&self) -> &Path {
        self.0.path()
    }

    /// Number of images that the set shall have.
    #[getter]
    fn count(&self) -> u64 {
        self.0.count()
    }

    /// Indices of the images that are not finished.
    fn missing(&self, py: Python<'_>) -> Vec<u64> {
        py.detach(|| self.0.missing())
    }

    /// Is an image finished? Then all its files are there.
    fn is_finished(&self, index: u64) -> bool {
        self.0.is_finished(index)
    }

    /// The record of a finished image: draws, instances, certificate, and size and hash of each file.
    fn record<'py>(&self, py: Python<'py>, index: u64) -> Result<Bound<'py, PyAny>, Failure> {
        loaded(py, &py.detach(|| self.0.record(index))?)
    }

    /// Writes the files of an image, and its record last. Returns False, and writes nothing, if the image is finished or if
    /// another process makes it at this moment. With `force` the image is written also then, because that process may stall;
    /// this is for images without a budget by time, which are the same from each process. Raises `SettingError` for an image
    /// whose files differ from the hashes of its record, and for an index outside of the set.
    #[pyo3(signature = (made, *, force=false))]
    fn commit(&self, py: Python<'_>, made: &Made, force: bool) -> Result<bool, Failure> {
        let (index, count) = (made.index(), self.0.count());
        if index >= count {
            let problem = format!("there is no image {index}: the set has {count}, counted from 0");
            return Err(setting("index", problem, "open the set with a larger count"));
        }
        let committed = py.detach(|| {
            if !made.0.is_whole() {
                let problem = format!("the files of image {index} differ from its record");
                return Err(Error::setting("image", problem, "make the image again; the copy was damaged"));
            }
            match self.0.claim(index)? {
                Some(claim) => self.0.commit(claim, made.0.clone()).map(|_| true),
                None if force && !self.0.is_finished(index) => self.0.write(made.0.clone()).map(|_| true),
                None => Ok(false),
            }
        });
        Ok(committed?)
    }

    /// Writes the files of the whole set from those of its finished images: `records.jsonl`, `coco.json`, `report.html` and
    /// so on.
    fn assemble(&self, py: Python<'_>) -> Result<(), Failure> {
        Ok(py.detach(|| self.0.assemble())?)
    }

    /// Checks the set as `dunkelfeld dataset --verify`: the size and the hash of each file, labels against masks, and the files
    /// of the whole set against those that the images give.
    ///
    /// Returns a dictionary: `count` and `finished` (images), `files` and `annotations` (numbers that were checked), `faults`
    /// (texts), `more` (number of faults that are not listed), `is_whole`.
    fn verify<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyAny>, Failure> {
        let found = py.detach(|| verify(self.0.path(), &|_, _| {}))?;
        let entries = loaded(py, &found)?;
        entries.set_item("is_whole", found.is_whole())?;
        Ok(entries)
    }

    fn __repr__(&self) -> String {
        format!("DataSet({}, {} images)", self.0.path().display(), self.0.count())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        Ok((py.get_type::<Self>().into_any(), (self.0.path().to_path_buf(),).into_pyobject(py)?))
    }
}
