//! Errors of Rust as exceptions of Python: a small hierarchy, with file, place, problem and help as attributes.

use dunkelfeld::Error;
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyKeyboardInterrupt};
use pyo3::prelude::*;
use std::borrow::Cow;

create_exception!(
    dunkelfeld,
    DunkelfeldError,
    PyException,
    "Base of all errors. Attributes: file, place, problem, help."
);
create_exception!(dunkelfeld, InputError, DunkelfeldError, "A file or a text that cannot be used.");
create_exception!(dunkelfeld, SettingError, DunkelfeldError, "A setting outside its range, or that fits no other one.");
create_exception!(dunkelfeld, SceneError, DunkelfeldError, "A scene or a camera that cannot be rendered.");
create_exception!(dunkelfeld, SensorError, DunkelfeldError, "A sensor that cannot be exposed like this.");
create_exception!(dunkelfeld, OutputError, DunkelfeldError, "A file that cannot be written.");
create_exception!(dunkelfeld, OutOfMemoryError, DunkelfeldError, "More memory than the limit or the machine has.");

create_exception!(dunkelfeld, Interrupted, PyKeyboardInterrupt, "A render that Ctrl-C ended; `film` has its samples.");

/// An error of the library, for the operator `?`.
pub(crate) struct Failure(PyErr);

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        failure.0
    }
}

impl From<PyErr> for Failure {
    fn from(error: PyErr) -> Self {
        Self(error)
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self(exception(&error))
    }
}

/// Raises an error of a setting.
pub(crate) fn setting(what: &str, problem: impl Into<String>, help: &str) -> Failure {
    Error::setting(what, problem, help).into()
}

/// A fault of the library.
pub(crate) fn internal(problem: &str) -> Failure {
    Failure(DunkelfeldError::new_err(format!("{problem}\n  help: report it with the input")))
}

/// The exception of an error: its message, with the line and the caret of a text file.
pub(crate) fn exception(error: &Error) -> PyErr {
    let caret = error.caret();
    let message = if caret.is_empty() { error.to_string() } else { format!("{error}\n{caret}") };
    let parts = error.parts();
    let file = parts.file.map(|file| file.display().to_string());
    let [place, problem, help] = [parts.place, parts.problem, parts.help].map(|text| text.map(Cow::into_owned));
    let error = match error {
        Error::Input(_) => InputError::new_err(message),
        Error::Setting { .. } => SettingError::new_err(message),
        Error::Build(_) | Error::Camera(_) => SceneError::new_err(message),
        Error::Sensor(_) => SensorError::new_err(message),
        Error::Output { .. } => OutputError::new_err(message),
        Error::Memory { .. } | Error::MemoryNeeded { .. } => OutOfMemoryError::new_err(message),
        _ => DunkelfeldError::new_err(message),
    };
    Python::attach(|py| {
        let value = error.value(py);
        for (name, text) in [("file", file), ("place", place), ("problem", problem), ("help", help)] {
            // An exception of ours takes attributes.
            let _ = value.setattr(name, text);
        }
    });
    error
}

/// Adds the exceptions to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    // An error that Python makes has no texts.
    for name in ["file", "place", "problem", "help"] {
        py.get_type::<DunkelfeldError>().setattr(name, py.None())?;
    }
    module.add("DunkelfeldError", py.get_type::<DunkelfeldError>())?;
    module.add("InputError", py.get_type::<InputError>())?;
    module.add("SettingError", py.get_type::<SettingError>())?;
    module.add("SceneError", py.get_type::<SceneError>())?;
    module.add("SensorError", py.get_type::<SensorError>())?;
    module.add("OutputError", py.get_type::<OutputError>())?;
    module.add("Interrupted", py.get_type::<Interrupted>())?;
    module.add("OutOfMemoryError", py.get_type::<OutOfMemoryError>())
}
