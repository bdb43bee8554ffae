//! Work without the interpreter's lock: on threads of its own, cancelled by Ctrl-C.

use crate::errors::{Failure, setting};
use dunkelfeld::{Cancel, Session};
use pyo3::prelude::*;
use std::sync::Mutex;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

/// Interval in which signals are looked at.
pub(crate) const SIGNALS: Duration = Duration::from_millis(50);

/// Runs `work` on a pool of so many threads (0: one per core). The pool ends with it, so that a fork of the process finds no
/// threads that it does not have.
pub(crate) fn with_pool<T: Send>(
    py: Python<'_>,
    threads: usize,
    work: impl FnOnce() -> T + Send,
) -> Result<T, Failure> {
    let result = py.detach(|| Ok::<_, dunkelfeld::Error>(Session::new(threads)?.install(work)))?;
    // Before the interpreter runs other code: a signal that came meanwhile is not an error of that code.
    py.check_signals()?;
    Ok(result)
}

/// [`with_pool`] for work that Ctrl-C cancels: then the exception is the result.
pub(crate) fn with_cancellable_pool<T: Send>(
    py: Python<'_>,
    threads: usize,
    work: impl FnOnce(&Cancel) -> T + Send,
) -> Result<T, Failure> {
    let cancel = Cancel::new();
    let (result, raised) =
        interruptible(py, &cancel, || Ok::<_, dunkelfeld::Error>(Session::new(threads)?.install(|| work(&cancel))));
    match (raised, result) {
        (Some(raised), _) => Err(raised.into()),
        (None, Some(result)) => Ok(result?),
        (None, None) => Err(setting("work", "a thread failed", "report this fault")),
    }
}

/// Runs `work` on another thread. A signal whose handler raises an exception, such as Ctrl-C, sets `cancel`; then the result
/// of the work comes together with the exception.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    cancel: &Cancel,
    work: impl FnOnce() -> T + Send,
) -> (Option<T>, Option<PyErr>) {
    let mut raised = None;
    let result = std::thread::scope(|scope| {
        let (done, finished) = mpsc::channel::<()>();
        let worker = scope.spawn(move || {
            let result = work();
            drop(done);
            result
        });
        // A receiver is not shared, but a lock of it is.
        let finished = Mutex::new(finished);
        loop {
            let wait = || finished.lock().map_or(Err(RecvTimeoutError::Disconnected), |f| f.recv_timeout(SIGNALS));
            match py.detach(wait) {
                Err(RecvTimeoutError::Disconnected) => break,
                _ => {
                    if raised.is_none()
                        && let Err(e) = py.check_signals()
                    {
                        cancel.cancel();
                        raised = Some(e);
                    }
                }
            }
        }
        py.detach(|| worker.join().ok())
    });
    (result, raised)
}
