//! The noise map of a film, for notebooks and as arrays.

use crate::arrays::{ImageArray, gray, rgb};
use crate::errors::Failure;
use dunkelfeld_studies::NoiseMap as Map;
use numpy::{PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyTuple};

/// Noise of the render over that of the camera, per pixel, from `Film.noise_map`. Notebooks show it with its scale.
///
/// The scale is logarithmic: blue where the camera hides the noise of the render at level k (at and below `range[0]` =
/// k / 8 the end of the scale), grey at k, orange where it is visible (`range[1]` = 8 k), nearly black where it is unknown.
#[pyclass(frozen, module = "dunkelfeld")]
pub(crate) struct NoiseMap(pub(crate) Map);

#[pymethods]
impl NoiseMap {
    /// Standard deviation of the rendered mean over that of the camera, float32 of shape (height, width); infinite where it
    /// is unknown.
    #[getter]
    fn ratios<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray2<f32>>, Failure> {
        gray(py, self.0.ratios().clone())
    }

    /// The picture, uint8 of shape (height, width, 3), sRGB.
    #[getter]
    fn picture<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray3<u8>>, Failure> {
        rgb(py, self.0.picture())
    }

    /// The level in the middle of the scale.
    #[getter]
    fn k(&self) -> f64 {
        self.0.k()
    }

    /// Share of the unsaturated pixels whose ratio is at most k.
    #[getter]
    fn hidden(&self) -> f64 {
        self.0.hidden()
    }

    /// The ratios at the ends of the scale.
    #[getter]
    fn range(&self) -> (f64, f64) {
        let [low, high] = self.0.range();
        (low, high)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> Result<(Bound<'py, PyAny>, Bound<'py, PyTuple>), Failure> {
        let arguments = (self.ratios(py)?, self.k(), self.hidden()).into_pyobject(py)?;
        Ok((py.get_type::<Self>().getattr("_restore")?, arguments))
    }

    #[staticmethod]
    fn _restore(ratios: ImageArray<'_>, k: f64, hidden: f64) -> Result<Self, Failure> {
        Ok(Self(Map::from_parts(ratios.gray("ratios", None)?, k, hidden)))
    }

    fn __repr__(&self) -> String {
        let (ratios, [low, high]) = (self.0.ratios(), self.0.range());
        let (width, height) = (ratios.width(), ratios.height());
        format!("NoiseMap({width} x {height} pixels, k = {}, {low} to {high})", self.0.k())
    }

    /// The picture as PNG, for notebooks.
    fn _repr_png_<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyBytes>, Failure> {
        Ok(PyBytes::new(py, &py.detach(|| self.0.png())?))
    }

    /// The picture with its scale, for notebooks.
    fn _repr_html_(&self, py: Python<'_>) -> Result<String, Failure> {
        Ok(py.detach(|| self.0.html())?)
    }
}
