//! Errors between a scene file and a finished frame.

use dunkelfeld_files::InputError;
use dunkelfeld_files::visible::visible_line;
use dunkelfeld_scene::{BuildError, CameraError};
use dunkelfeld_sensor::{SensorError, time_in_words};
use std::borrow::Cow;
use std::fmt::{Display, Formatter};
use std::path::{Path, PathBuf};

/// All errors that end a render without an image. Names in the messages are escaped, so that a terminal does not
/// execute control characters.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file that cannot be used.
    Input(#[from] InputError),
    /// A scene that is not valid.
    Build(#[from] BuildError),
    /// A camera that has no rays for this film.
    Camera(#[from] CameraError),
    /// A setting outside its range.
    Setting {
        /// Name of the setting.
        what: String,
        /// The fault.
        problem: String,
        /// Advice to the user.
        help: String,
    },
    /// A sensor that cannot be exposed with these settings.
    Sensor(SensorError),
    /// A file that could not be written.
    Output {
        /// The file.
        file: PathBuf,
        /// The fault.
        problem: String,
        /// Advice to the user.
        help: String,
    },
    /// There is not enough memory.
    Memory {
        /// The object that needs the memory.
        what: String,
        /// Advice to the user.
        help: String,
    },
    /// A run that needs more memory than its limit, or than the machine has.
    MemoryNeeded {
        /// The required memory, and the limit that it exceeds.
        problem: String,
        /// The account, as a table.
        account: String,
        /// Advice to the user.
        help: String,
    },
    /// The threads could not be started.
    Threads(String),
}

impl Display for Error {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.statement())?;
        self.help().map_or(Ok(()), |help| write!(f, "\n  help: {help}"))
    }
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

    /// The message without its help.
    pub fn statement(&self) -> String {
        match self {
            Self::Input(e) => e.statement(),
            Self::Build(e) => format!("the scene cannot be built: {}", visible_line(&e.to_string())),
            Self::Camera(e) => e.to_string(),
            Self::Setting { what, problem, .. } => format!("{}: {}", visible_line(what), visible_line(problem)),
            Self::Sensor(e) => format!("the sensor cannot be used: {e}"),
            Self::Output { file, problem, .. } => {
                format!("{}: {}", visible_line(&file.to_string_lossy()), visible_line(problem))
            }
            Self::Memory { what, .. } => format!("{what}: there is not enough memory"),
            Self::MemoryNeeded { problem, account, .. } => format!("{problem}\n{account}"),
            Self::Threads(problem) => format!("the worker threads could not be started: {problem}"),
        }
    }

    /// The help of the message, if it has one.
    pub fn help(&self) -> Option<Cow<'_, str>> {
        match self {
            Self::Input(InputError { help, .. }) | Self::Setting { help, .. } | Self::Output { help, .. } => {
                Some(visible_line(help))
            }
            Self::Memory { help, .. } | Self::MemoryNeeded { help, .. } => Some(help.into()),
            Self::Camera(e) => Some(camera_help(e).into()),
            Self::Build(_) | Self::Sensor(_) | Self::Threads(_) => None,
        }
    }

    /// The message in one line.
    pub fn in_one_line(&self) -> String {
        match self.help() {
            Some(help) => format!("{}; help: {help}", self.statement()),
            None => self.statement(),
        }
    }

    /// The texts of the error one by one.
    pub fn parts(&self) -> ErrorParts<'_> {
        let texts = |place: &'static str, problem: &dyn Display, help: &'static str| ErrorParts {
            file: None,
            place: Some(place.into()),
            problem: Some(problem.to_string().into()),
            help: Some(help.into()),
        };
        match self {
            Self::Input(e) => ErrorParts {
                file: Some(&e.file),
                place: Some(e.place.as_str().into()),
                problem: Some(e.problem.as_str().into()),
                help: Some(e.help.as_str().into()),
            },
            Self::Setting { what, problem, help } => ErrorParts {
                file: None,
                place: Some(what.into()),
                problem: Some(problem.into()),
                help: Some(help.into()),
            },
            Self::Output { file, problem, help } => ErrorParts {
                file: Some(file),
                place: Some("output".into()),
                problem: Some(problem.into()),
                help: Some(help.into()),
            },
            Self::Memory { what, help } => ErrorParts {
                file: None,
                place: Some(what.into()),
                problem: Some("there is not enough memory".into()),
                help: Some(help.into()),
            },
            Self::MemoryNeeded { problem, help, .. } => ErrorParts {
                file: None,
                place: Some("memory".into()),
                problem: Some(problem.into()),
                help: Some(help.into()),
            },
            Self::Camera(e) => texts("camera", e, camera_help(e)),
            Self::Build(e) => texts("scene", e, "correct the scene, or leave the part out"),
            Self::Sensor(e) => texts("sensor", e, "change the value, or use another sensor"),
            Self::Threads(problem) => texts("threads", problem, "use fewer threads, or end other programs"),
        }
    }

    /// The line of the input file with a caret below the fault; empty where there is none.
    pub fn caret(&self) -> String {
        match self {
            Self::Input(e) => e.caret(),
            _ => String::new(),
        }
    }
}

/// The texts of an error, as far as it has them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ErrorParts<'a> {
    /// The file.
    pub file: Option<&'a Path>,
    /// The place in the file, the setting, or the object.
    pub place: Option<Cow<'a, str>>,
    /// The fault.
    pub problem: Option<Cow<'a, str>>,
    /// Advice to the user.
    pub help: Option<Cow<'a, str>>,
}

impl From<SensorError> for Error {
    fn from(error: SensorError) -> Self {
        let SensorError::Exposure { limit, .. } = &error else { return Self::Sensor(error) };
        let help = format!("use {}, another sensor, or a sensor file without limits", time_in_words(*limit));
        Self::setting("exposure", error.to_string(), help)
    }
}

/// Advice for a camera that cannot be used.
pub fn camera_help(error: &CameraError) -> &'static str {
    match error {
        CameraError::NotInvertible { .. } => {
            "let the film end before that (fewer pixels, a longer focal length), or fit the coefficients up to its corners"
        }
        _ => "change the value",
    }
}

/// The result of writing a file as an [`Error::Output`] with help.
///
/// # Errors
/// The given one.
pub fn written<T>(path: &Path, result: std::io::Result<T>) -> Result<T, Error> {
    result.map_err(|e| {
        // The message of this error contains the name of the file. So the name is removed from the reason.
        let said = e.to_string();
        let reason = said.strip_prefix(&format!("cannot write {}: ", path.display())).unwrap_or(&said);
        Error::Output {
            file: path.into(),
            problem: format!("cannot be written: {reason}"),
            help: "name a regular file in a folder that can be written to, on a disk with room".into(),
        }
    })
}
