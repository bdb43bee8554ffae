//! Path and interval of the checkpoints of a render.

use crate::error::{Error, written};
use derive_setters::Setters;
use dunkelfeld_files::lock::TargetLock;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Default of the interval between two checkpoints \[s\].
pub const DEFAULT_CHECKPOINT_SECONDS: f64 = 30.0;
/// Path and interval at which a render stores its state.
#[derive(Clone, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct CheckpointSettings {
    /// The file. If it exists, the render continues from it.
    pub path: PathBuf,
    /// Minimum interval between two checkpoints \[s\].
    pub seconds: f64,
    /// The lock of the file, if it is already held ([`Self::lock`]). Otherwise a render takes it, until it ends.
    #[setters(into)]
    pub lock: Option<Arc<TargetLock>>,
}

/// Takes the lock of a checkpoint that will be written.
///
/// # Errors
/// Another process holds it, or the file cannot be written.
pub fn lock(path: &Path) -> Result<TargetLock, Error> {
    written(path, dunkelfeld_files::atomic::check_writable(path))?;
    Ok(TargetLock::acquire(path)?)
}

impl CheckpointSettings {
    /// A checkpoint every [`DEFAULT_CHECKPOINT_SECONDS`].
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), seconds: DEFAULT_CHECKPOINT_SECONDS, lock: None }
    }

    /// Takes the lock of the file. No other process writes the file while these settings or a copy of them exist.
    ///
    /// # Errors
    /// Another process holds it, or the file cannot be written.
    pub fn lock(&mut self) -> Result<(), Error> {
        self.lock = Some(Arc::new(lock(&self.path)?));
        Ok(())
    }
}
