//! Options of all studies that render a scene many times.

use derive_setters::Setters;
use dunkelfeld::sensor::select_sensor;
use dunkelfeld::{Error, ExposureOption, Project, SensorOption};

/// View, sensor and seed of a study, in place of those of its project. `None` leaves a setting as it is.
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ViewOptions {
    /// Width of the film \[pixels\].
    pub width: Option<u32>,
    /// Height of the film \[pixels\].
    pub height: Option<u32>,
    /// Name of the camera.
    pub camera: Option<String>,
    /// The sensor.
    pub sensor: Option<SensorOption>,
    /// The exposure time.
    pub exposure: Option<ExposureOption>,
    /// Seed from which the seeds of all renders are derived.
    pub seed: Option<u64>,
    /// Limit of the memory \[bytes\].
    pub memory: Option<u64>,
    /// Number of threads; 0 means one per core.
    pub threads: Option<usize>,
}

impl ViewOptions {
    /// Sets the options in the settings of a project.
    ///
    /// # Errors
    /// A sensor that does not exist, and an exposure without a sensor.
    pub fn apply(&self, project: &mut Project) -> Result<(), Error> {
        let s = &mut project.settings;
        s.width = self.width.unwrap_or(s.width);
        s.height = self.height.unwrap_or(s.height);
        s.seed = self.seed.unwrap_or(s.seed);
        s.threads = self.threads.unwrap_or(s.threads);
        s.memory_limit = self.memory.or(s.memory_limit);
        if self.camera.is_some() {
            s.camera.clone_from(&self.camera);
        }
        let sensor = (self.sensor.clone(), self.exposure);
        select_sensor(&mut s.sensor, sensor, project.optics.clone(), &mut project.inputs)
    }

    /// Do the options set the size of the film? Then a quick bench keeps it.
    pub fn has_size(&self) -> bool {
        self.width.is_some() || self.height.is_some()
    }
}
