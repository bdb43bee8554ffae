//! Sensors of EMVA 1288 as Python objects.

use crate::errors::Failure;
use crate::json::loaded;
use dunkelfeld::GivenSensor;
use dunkelfeld::commands::sensor_sheet;
use dunkelfeld::io::sensor_file;
use dunkelfeld::sensor::SensorModel;
use pyo3::prelude::*;
use std::path::PathBuf;

/// A sensor by the EMVA 1288 model: a preset (see `sensors()`) or a sensor file (`*.toml`).
#[pyclass(frozen, module = "dunkelfeld", from_py_object)]
#[derive(Clone)]
pub(crate) struct Sensor {
    /// The name or path that it was made of, for copies.
    origin: String,
    pub(crate) model: SensorModel,
}

#[pymethods]
impl Sensor {
    #[new]
    fn new(name: PathBuf) -> Result<Self, Failure> {
        let name = name.display().to_string();
        let model = dunkelfeld::find_sensor(&name)?;
        Ok(Self { origin: origin_of(name), model })
    }

    /// Name and source of the sensor.
    #[getter]
    fn name(&self) -> &str {
        &self.model.spec().name
    }

    /// Bits of a grey value.
    #[getter]
    fn bit_depth(&self) -> u32 {
        self.model.spec().bit_depth
    }

    /// Side of a pixel [m].
    #[getter]
    fn pixel_pitch(&self) -> f64 {
        self.model.spec().pixel_pitch.0
    }

    /// Width and height [pixels], if the sensor file has them.
    #[getter]
    fn resolution(&self) -> Option<(u32, u32)> {
        self.model.spec().resolution.map(|[w, h]| (w, h))
    }

    /// Saturation [electrons].
    #[getter]
    fn saturation(&self) -> f64 {
        self.model.saturation().0
    }

    /// Does it have a colour filter array?
    #[getter]
    fn is_color(&self) -> bool {
        self.model.spec().quantum_efficiency.filter().is_some()
    }

    /// The data sheet that the model implies, beside the published one: the dictionary of `dunkelfeld sensors NAME --json`, with
    /// `channels` and `figures` (lists of dictionaries).
    fn data_sheet<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyAny>, Failure> {
        loaded(py, &sensor_sheet(&self.origin, &self.model))
    }

    fn __repr__(&self) -> String {
        format!("Sensor({:?}): {}", self.origin, self.name())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> (Bound<'py, PyAny>, (String,)) {
        (py.get_type::<Self>().into_any(), (self.origin.clone(),))
    }
}

/// A preset by its name, a file by its absolute path: a copy may be made in another folder.
fn origin_of(name: String) -> String {
    if sensor_file::preset_names().any(|preset| preset == name) {
        return name;
    }
    std::path::absolute(&name).map_or(name, |path| path.display().to_string())
}

/// Names of the preset sensors.
#[pyfunction]
pub(crate) fn sensors() -> Vec<&'static str> {
    sensor_file::preset_names().collect()
}

/// A sensor object in place of that of a job.
pub(crate) fn given_sensor(sensor: &Sensor) -> GivenSensor {
    let is_preset = sensor_file::preset_names().any(|preset| preset == sensor.origin);
    let file = (!is_preset).then(|| PathBuf::from(&sensor.origin));
    GivenSensor { model: sensor.model.clone(), file }
}

/// A sensor from Python: an object, or the name of a preset or file.
#[derive(FromPyObject)]
#[allow(clippy::large_enum_variant, reason = "one exists for the time of a call")]
pub(crate) enum SensorArgument {
    Sensor(Sensor),
    Name(String),
    Path(PathBuf),
}
