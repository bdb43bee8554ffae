//! Long work with a progress function of Python, which Ctrl-C and an exception of this function cancel.

use crate::errors::{Failure, internal};
use crate::work::interruptible;
use dunkelfeld::{Cancel, Error, Progress, ProgressState, Silent};
use pyo3::prelude::*;
use std::cell::RefCell;
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::time::Duration;

/// Interval in which a lock is tried.
const WAIT: Duration = Duration::from_millis(2);

thread_local! {
    /// The addresses of the scenes whose progress functions run on this thread, or wait for it.
    static REPORTS: RefCell<Vec<usize>> = const { RefCell::new(Vec::new()) };
}

/// Calls a function of Python with the progress. An exception cancels the work.
struct Callback<'a> {
    function: &'a Py<PyAny>,
    /// The address of the scene, and of those whose progress functions began this work.
    scenes: Vec<usize>,
    cancel: &'a Cancel,
    raised: Mutex<Option<PyErr>>,
}

impl Progress for Callback<'_> {
    fn update(&self, state: &ProgressState) {
        let called = Python::attach(|py| {
            let arguments = (state.stage.name(), state.fraction, state.elapsed, state.remaining);
            let before = REPORTS.replace(self.scenes.clone());
            let called = self.function.call1(py, arguments).map(|_| ());
            REPORTS.replace(before);
            called
        });
        if let Err(e) = called {
            self.cancel.cancel();
            lock(&self.raised).get_or_insert(e);
        }
    }
}

/// The content of a lock. Its data stay valid if a thread panicked.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// The content of a lock, for which other work may wait long. `None` if the wait is given up.
pub(crate) fn lock_unless<T>(mutex: &Mutex<T>, mut is_given_up: impl FnMut() -> bool) -> Option<MutexGuard<'_, T>> {
    loop {
        match mutex.try_lock() {
            Ok(guard) => return Some(guard),
            Err(TryLockError::Poisoned(guard)) => return Some(guard.into_inner()),
            Err(TryLockError::WouldBlock) if is_given_up() => return None,
            Err(TryLockError::WouldBlock) => std::thread::sleep(WAIT),
        }
    }
}

/// Does the progress function of the scene with this address run on this thread, or wait for it?
pub(crate) fn reports_about(scene: usize) -> bool {
    REPORTS.with_borrow(|scenes| scenes.contains(&scene))
}

/// Does a progress function run on this thread?
pub(crate) fn is_reporting() -> bool {
    REPORTS.with_borrow(|scenes| !scenes.is_empty())
}

/// Runs `work` on another thread. `function` is called with (stage, fraction, elapsed \[s\], remaining \[s\] or None). The
/// second result is an exception of it, or of a handler of signals such as Ctrl-C, which cancelled the work.
///
/// # Errors
/// Those of the work. An exception of Python is raised instead of an error that follows it.
pub(crate) fn supervised<T: Send>(
    py: Python<'_>,
    function: Option<&Py<PyAny>>,
    scene: usize,
    work: impl FnOnce(&dyn Progress, &Cancel) -> Result<T, Error> + Send,
) -> Result<(T, Option<PyErr>), Failure> {
    supervised_by(py, function, scene, &Cancel::new(), work)
}

/// [`supervised`] work that `cancel` ends.
///
/// # Errors
/// As [`supervised`].
pub(crate) fn supervised_by<T: Send>(
    py: Python<'_>,
    function: Option<&Py<PyAny>>,
    scene: usize,
    cancel: &Cancel,
    work: impl FnOnce(&dyn Progress, &Cancel) -> Result<T, Error> + Send,
) -> Result<(T, Option<PyErr>), Failure> {
    let callback = function.map(|function| {
        let scenes = REPORTS.with_borrow(|scenes| scenes.iter().copied().chain([scene]).collect());
        Callback { function, scenes, cancel, raised: Mutex::default() }
    });
    let sink: &dyn Progress = callback.as_ref().map_or(&Silent, |callback| callback);
    let (result, raised) = interruptible(py, cancel, || work(sink, cancel));
    let raised = raised.or_else(|| callback.as_ref().and_then(|c| lock(&c.raised).take()));
    match (result, raised) {
        (Some(Ok(result)), raised) => Ok((result, raised)),
        (_, Some(raised)) => Err(raised.into()),
        (Some(Err(error)), None) => Err(error.into()),
        (None, None) => Err(internal("a thread panicked")),
    }
}

/// The result of [`supervised`] work that has no partial result.
///
/// # Errors
/// The exception that cancelled the work.
pub(crate) fn completed<T>((result, raised): (T, Option<PyErr>)) -> Result<T, Failure> {
    raised.map_or(Ok(result), |raised| Err(raised.into()))
}
