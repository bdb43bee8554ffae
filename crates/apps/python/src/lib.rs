//! The native part of the Python package `dunkelfeld`.

#![forbid(unsafe_code)]

mod arguments;
mod arrays;
mod commands;
mod emva;
mod errors;
mod film;
mod images;
mod inputs;
mod job;
mod json;
mod keys;
mod keywords;
mod noise_map;
mod progress;
mod scene;
mod sensor;
mod studies;
mod study;
mod work;

use pyo3::prelude::*;

/// The module `dunkelfeld._native`.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    // The interface of numpy is loaded here, where an error is one of the import.
    module.py().import("numpy")?;
    drop(numpy::PyArray1::<u8>::zeros(module.py(), 0, false));
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("NO_ID", dunkelfeld::film::NO_ID)?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<film::Film>()?;
    module.add_class::<noise_map::NoiseMap>()?;
    module.add_class::<sensor::Sensor>()?;
    module.add_class::<study::Study>()?;
    module.add_class::<study::StudyWorker>()?;
    module.add_class::<study::Made>()?;
    module.add_class::<study::DataSet>()?;
    module.add_function(wrap_pyfunction!(inputs::read_image, module)?)?;
    module.add_function(wrap_pyfunction!(sensor::sensors, module)?)?;
    module.add_function(wrap_pyfunction!(commands::run_command, module)?)?;
    module.add_function(wrap_pyfunction!(commands::merge, module)?)?;
    module.add_function(wrap_pyfunction!(commands::init_job, module)?)?;
    module.add_function(wrap_pyfunction!(commands::stations, module)?)?;
    module.add_function(wrap_pyfunction!(commands::station_job, module)?)?;
    module.add_function(wrap_pyfunction!(images::expose_exr, module)?)?;
    module.add_function(wrap_pyfunction!(images::expose_exr_files, module)?)?;
    module.add_function(wrap_pyfunction!(images::expose_radiance, module)?)?;
    module.add_function(wrap_pyfunction!(images::denoise_exr, module)?)?;
    module.add_function(wrap_pyfunction!(images::denoise_radiance, module)?)?;
    module.add_function(wrap_pyfunction!(studies::bench, module)?)?;
    module.add_function(wrap_pyfunction!(studies::ptc, module)?)?;
    module.add_function(wrap_pyfunction!(emva::emva_dataset, module)?)?;
    module.add_function(wrap_pyfunction!(emva::emva_analyse, module)?)?;
    module.add_function(wrap_pyfunction!(keys::job_keys, module)?)?;
    module.add_function(wrap_pyfunction!(keys::check_job_keys, module)?)?;
    errors::register(module)
}
