//! What can go wrong between a file and a frame.

use dunkelfeld_io::InputError;
use dunkelfeld_io::visible::visible_line;
use dunkelfeld_scene::{BuildError, CameraError};
use dunkelfeld_sensor::SensorError;
use std::path::{Path, PathBuf};

/// Everything that ends a render without a picture. Shown, names are spelled so that a terminal does not obey them.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file that cannot be used.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A scene that makes no sense.
    #[error("the scene cannot be built: {}", visible_line(&.0.to_string()))]
    Build(#[from] BuildError),
    /// A camera that has no rays for this film.
    #[error("{0}\n  help: {help}", help = camera_help(.0))]
    Camera(#[from] CameraError),
    /// A setting outside its range.
    #[error("{}: {}\n  help: {}", visible_line(what), visible_line(problem), visible_line(help))]
    Setting {
        /// Which setting.
        what: String,
        /// What is wrong.
        problem: String,
        /// What to do about it.
        help: String,
    },
    /// A sensor that cannot expose this.
    #[error("the sensor cannot be used: {0}")]
    Sensor(#[from] SensorError),
    /// A file that could not be written.
    #[error(
        "{}: {}\n  help: {}",
        visible_line(&file.to_string_lossy()),
        visible_line(problem),
        visible_line(help)
    )]
    Output {
        /// The file.
        file: PathBuf,
        /// What went wrong.
        problem: String,
        /// What to do about it.
        help: String,
    },
    /// There is not enough memory.
    #[error("{what}: there is not enough memory\n  help: {help}")]
    Memory {
        /// What it was asked for.
        what: String,
        /// What to do about it.
        help: String,
    },
    /// A run that needs more memory than it may take, or than there is.
    #[error("{problem}\n{account}\n  help: {help}")]
    MemoryNeeded {
        /// How much, and of what there is less.
        problem: String,
        /// The account, as a table.
        account: String,
        /// What to do about it.
        help: String,
    },
    /// The threads could not be started.
    #[error("the worker threads could not be started: {0}")]
    Threads(String),
}

impl Error {
    /// A setting outside its range.
    pub fn setting(what: impl Into<String>, problem: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Setting { what: what.into(), problem: problem.into(), help: help.into() }
    }

    /// The film does not fit into memory.
    pub fn film_memory() -> Self {
        let help = "render fewer pixels, fewer layers (no --exr, no denoiser), or end other programs";
        Self::Memory { what: "the film".into(), help: help.into() }
    }

    /// The line of the input file with a caret under the fault; empty where there is none.
    pub fn caret(&self) -> String {
        match self {
            Self::Input(e) => e.caret(),
            _ => String::new(),
        }
    }
}

/// What to do about a camera that cannot be used.
pub fn camera_help(error: &CameraError) -> &'static str {
    match error {
        CameraError::Value { .. } => "change the value",
        CameraError::NotInvertible { .. } => {
            "let the film end before that (fewer pixels, a longer focal length), or fit the coefficients up to its corners"
        }
    }
}

/// The result of writing a file as an [`Error::Output`] with help.
///
/// # Errors
/// The one that is given.
pub fn written(path: &Path, result: std::io::Result<()>) -> Result<(), Error> {
    result.map_err(|e| {
        // The file is named once, by our own error.
        let said = e.to_string();
        let reason = said.strip_prefix(&format!("cannot write {}: ", path.display())).unwrap_or(&said);
        Error::Output {
            file: path.into(),
            problem: format!("cannot be written: {reason}"),
            help: "name a regular file in a folder that can be written to, on a disk with room".into(),
        }
    })
}
