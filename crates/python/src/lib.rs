//! The native part of the Python package `dunkelfeld`.

#![forbid(unsafe_code)]

mod arrays;
mod commands;
mod errors;
mod film;
mod job;
mod scene;
mod sensor;
mod work;

use pyo3::prelude::*;

/// The module `dunkelfeld._native`.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("NO_ID", dunkelfeld::NO_ID)?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<film::Film>()?;
    module.add_class::<sensor::Sensor>()?;
    module.add_function(wrap_pyfunction!(sensor::sensors, module)?)?;
    module.add_function(wrap_pyfunction!(commands::merge, module)?)?;
    errors::register(module)
}
