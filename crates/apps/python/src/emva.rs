//! EMVA 1288: data sets of simulated cameras, and the analysis of data sets. The module `dunkelfeld.emva` has the docstrings.

use crate::arguments::{LengthArgument, checked_threads, named, some_threads_of};
use crate::errors::{Failure, setting};
use crate::json::loaded;
use crate::progress::{completed, supervised};
use crate::sensor::SensorArgument;
use dunkelfeld::radiometry::{Nanometres, Seconds};
use dunkelfeld::sensor::FilterColor;
use dunkelfeld::{Session, find_sensor};
use dunkelfeld_studies::emva::{
    AnalyseOptions, DatasetPlan, DatasetSettings, Findings, TRUTH, Vary, read_measurement, write_dataset,
};
use dunkelfeld_studies::emva1288::Release;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

fn cancelled() -> Failure {
    setting("emva", "was cancelled", "call it again")
}

/// See `dunkelfeld.emva.dataset`.
#[pyfunction]
#[pyo3(signature = (sensor, output, *, levels=None, size=None, wavelength=None, spatial=None, vary=None, exposure=None,
    bit_depth=None, color=None, seed=None, threads=None, progress=None))]
#[allow(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn emva_dataset<'py>(
    py: Python<'py>,
    sensor: SensorArgument,
    output: PathBuf,
    levels: Option<u32>,
    size: Option<[u32; 2]>,
    wavelength: Option<LengthArgument>,
    spatial: Option<u32>,
    vary: Option<&str>,
    exposure: Option<f64>,
    bit_depth: Option<u32>,
    color: Option<&str>,
    seed: Option<u64>,
    #[pyo3(from_py_with = some_threads_of)] threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> Result<Bound<'py, PyDict>, Failure> {
    let model = match sensor {
        SensorArgument::Sensor(sensor) => sensor.model,
        SensorArgument::Name(name) => find_sensor(&name)?,
        SensorArgument::Path(path) => find_sensor(&path.display().to_string())?,
    };
    let varied = [("exposure", Vary::Exposure), ("irradiance", Vary::Irradiance)];
    let colors = FilterColor::ALL.map(|color| (color.name(), color));
    let wavelength = wavelength.map(|length| length.metres("wavelength")).transpose()?;
    let mut settings = DatasetSettings::default();
    settings.levels = levels.unwrap_or(settings.levels);
    [settings.width, settings.height] = size.unwrap_or([settings.width, settings.height]);
    settings.wavelength = wavelength.map(|metres| Nanometres(1e9 * metres));
    settings.stack = spatial.unwrap_or(settings.stack);
    settings.vary = vary.map_or(Ok(settings.vary), |name| named("vary", name, &varied))?;
    settings.exposure = exposure.map_or(settings.exposure, Seconds);
    settings.bit_depth = bit_depth;
    settings.color = color.map(|name| named("color", name, &colors)).transpose()?;
    settings.seed = seed.unwrap_or(settings.seed);
    let threads = checked_threads(threads)?.unwrap_or(0);
    let done = supervised(py, progress.as_ref(), 0, |sink, cancel| {
        let plan = DatasetPlan::new(&model, &settings)?;
        let session = Session::new(threads)?.with_progress(sink).with_cancel(cancel);
        write_dataset(&plan, &output, &session)
    })?;
    let written = completed(done)?.ok_or_else(cancelled)?;
    let truth = output.join(TRUTH);
    let entries = PyDict::new(py);
    entries.set_item("descriptor", written.descriptor.display().to_string())?;
    entries.set_item("truth", truth.display().to_string())?;
    entries.set_item("frames", written.frames)?;
    entries.set_item("figures", loaded(py, &written.truth)?)?;
    Ok(entries)
}

/// See `dunkelfeld.emva.analyse`.
#[pyfunction]
#[pyo3(signature = (input, *, release="4.0", general=false, pixel_pitch=None, wavelength=None, sensor=None,
    maps=false, json=None, html=None, threads=None, progress=None))]
#[allow(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn emva_analyse<'py>(
    py: Python<'py>,
    input: PathBuf,
    release: &str,
    general: bool,
    pixel_pitch: Option<LengthArgument>,
    wavelength: Option<LengthArgument>,
    sensor: Option<PathBuf>,
    maps: bool,
    json: Option<PathBuf>,
    html: Option<PathBuf>,
    #[pyo3(from_py_with = some_threads_of)] threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> Result<Bound<'py, PyDict>, Failure> {
    let release = named("release", release, &[("4.0", Release::R40), ("3.1", Release::R31)])?;
    let pixel_pitch = pixel_pitch.map(|length| length.metres("pixel_pitch")).transpose()?;
    let wavelength = wavelength.map(|length| length.metres("wavelength")).transpose()?;
    let options = AnalyseOptions::default()
        .with_release(release)
        .with_general(general)
        .with_pixel_pitch(pixel_pitch.map(|metres| 1e6 * metres))
        .with_wavelength(wavelength.map(|metres| 1e9 * metres))
        .with_sensor(sensor)
        .with_maps(maps);
    options.check()?;
    let threads = checked_threads(threads)?.unwrap_or(0);
    let done = supervised(py, progress.as_ref(), 0, |sink, cancel| {
        Findings::check_outputs(&input, &options, json.as_deref(), html.as_deref())?;
        let session = Session::new(threads)?.with_progress(sink).with_cancel(cancel);
        let Some(read) = read_measurement(&input, &session)? else { return Ok(None) };
        let findings = options.analyse(&read)?;
        let sensor = findings.save_sensor(&read, &options)?;
        if let Some(path) = &json {
            findings.save_json(path)?;
        }
        if let Some(path) = &html {
            findings.save_html(&read, path)?;
        }
        Ok(Some((findings, read.warnings, sensor)))
    })?;
    let (findings, warnings, sensor) = completed(done)?.ok_or_else(cancelled)?;
    let quantities = PyDict::new(py);
    for quantity in findings.quantities() {
        quantities.set_item(quantity.symbol, loaded(py, quantity)?)?;
    }
    let notes: Vec<&String> = warnings.iter().chain(findings.notes()).collect();
    let entries = PyDict::new(py);
    entries.set_item("quantities", quantities)?;
    entries.set_item("notes", notes)?;
    entries.set_item("figures", loaded(py, &findings)?)?;
    let sensor: Vec<String> = sensor.iter().map(|path| path.display().to_string()).collect();
    entries.set_item("sensor", sensor)?;
    for (key, path) in [("json", json), ("html", html)] {
        entries.set_item(key, path.map(|path| path.display().to_string()))?;
    }
    Ok(entries)
}
