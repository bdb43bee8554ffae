//! Films: sums of samples per pixel, as arrays of numpy, and their exposure.

use crate::arrays::{gray, rgb, stack};
use crate::errors::{Failure, setting};
use crate::noise_map::NoiseMap;
use crate::sensor::{ExposureArgument, SensorArgument};
use crate::work::with_pool;
use dunkelfeld::sensor::ExposureNoise;
use dunkelfeld::{
    DenoiseMethod, DenoiseSettings, ExposeOptions, NO_ID, Picture, RenderSettings, SavedFilm, certify_film,
    denoise_saved, develop_film, expose_film, picture_of_film,
};
use dunkelfeld_studies::NoiseMap as Map;
use numpy::{PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;
use std::sync::Arc;

/// A rendered film. Its arrays are row-major with row 0 at the top.
#[pyclass(frozen, module = "dunkelfeld")]
pub(crate) struct Film {
    pub(crate) saved: Arc<SavedFilm>,
    pub(crate) material_names: Arc<Vec<String>>,
    /// The statistics of the render as JSON; empty for a film from a file.
    pub(crate) stats: String,
    pub(crate) interrupted: bool,
}

impl Film {
    fn settings(&self) -> &RenderSettings {
        &self.saved.settings
    }

    /// Computes a plane on the threads of the render, without the interpreter.
    fn compute<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&SavedFilm) -> T + Send) -> Result<T, Failure> {
        let saved = &*self.saved;
        with_pool(py, self.settings().threads, move || work(saved))
    }
}

/// The options of an exposure, from the keywords of Python.
fn expose_options(
    sensor: Option<SensorArgument>,
    exposure: Option<ExposureArgument>,
    frame: Option<u32>,
    seed: Option<u64>,
    exposure_noise: Option<&str>,
) -> Result<ExposeOptions, Failure> {
    let mut options = ExposeOptions::default();
    options.sensor = sensor.map(SensorArgument::option);
    options.exposure = exposure.map(ExposureArgument::option).transpose()?;
    (options.frame, options.seed) = (frame, seed);
    options.exposure_noise = match exposure_noise {
        None => None,
        Some("plain") => Some(ExposureNoise::Plain),
        Some("matched") => Some(ExposureNoise::Matched),
        Some(other) => return Err(setting("exposure_noise", format!("unknown value \"{other}\""), "plain or matched")),
    };
    Ok(options)
}

#[pymethods]
impl Film {
    /// Height and width [pixels].
    #[getter]
    fn shape(&self) -> (u32, u32) {
        (self.saved.film.sums.height(), self.saved.film.sums.width())
    }

    /// Mean radiance, float32 of shape (height, width, 3): linear Rec. 709 [W/(m² sr)].
    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray3<f32>>, Failure> {
        rgb(py, self.compute(py, |s| s.film.sums.mean())?)
    }

    /// Variance of the mean, float32 of shape (height, width, 3) [(W/(m² sr))²]. Infinite with fewer than two samples.
    #[getter]
    fn variance<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray3<f32>>, Failure> {
        rgb(py, self.compute(py, |s| s.film.sums.variance())?)
    }

    /// Samples per pixel, uint32 of shape (height, width).
    #[getter]
    fn spp<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray2<u32>>, Failure> {
        gray(py, self.compute(py, |s| s.film.sums.sample_counts())?)
    }

    /// Object at the centre of each pixel, uint32 of shape (height, width); `NO_ID` where there is none.
    #[getter]
    fn object_ids<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray2<u32>>, Failure> {
        gray(py, self.compute(py, |s| s.film.ids.map(|id| id.map_or(NO_ID, |id| id.object())))?)
    }

    /// Material at the centre of each pixel, uint32 of shape (height, width); `NO_ID` where there is none.
    #[getter]
    fn material_ids<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray2<u32>>, Failure> {
        gray(py, self.compute(py, |s| s.film.ids.map(|id| id.map_or(NO_ID, |id| id.material())))?)
    }

    /// Names of the objects by id.
    #[getter]
    fn object_names(&self) -> Vec<String> {
        self.saved.film.object_names.clone()
    }

    /// Names of the materials by id; empty for a film from a file.
    #[getter]
    fn material_names(&self) -> Vec<String> {
        self.material_names.to_vec()
    }

    /// Mean distance from the camera along its axis, float32 of shape (height, width) [m].
    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray2<f32>>, Failure> {
        gray(py, self.compute(py, |s| s.film.sums.map(|p| p.mean_depth()))?)
    }

    /// Mean unit normal toward the camera, float32 of shape (height, width, 3), world axes.
    #[getter]
    fn normal<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray3<f32>>, Failure> {
        rgb(py, self.compute(py, |s| s.film.sums.map(|p| p.mean_normal()))?)
    }

    /// Mean albedo, float32 of shape (height, width, 3), linear Rec. 709.
    #[getter]
    fn albedo<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray3<f32>>, Failure> {
        rgb(py, self.compute(py, |s| s.film.sums.map(|p| p.mean_albedo()))?)
    }

    /// The statistics of the render, as in `--stats`; an empty dictionary for a film from a file.
    #[getter]
    fn stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        if self.stats.is_empty() {
            return Ok(PyDict::new(py).into_any());
        }
        py.import("json")?.call_method1("loads", (&self.stats,))
    }

    /// Was the render interrupted before its budget was spent?
    #[getter]
    fn interrupted(&self) -> bool {
        self.interrupted
    }

    /// Exposes the film: linear grey values of `frames` frames, uint16 of shape (frames, height, width) [DN]. Frames of one
    /// seed come from the same device. Arguments that are left out are those of the render. `exposure` is a time [s] or
    /// "auto", `frame` is the number of the first frame, `exposure_noise` is "plain" or "matched".
    #[pyo3(signature = (sensor=None, exposure=None, frames=1, *, frame=None, seed=None, exposure_noise=None))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn expose<'py>(
        &self,
        py: Python<'py>,
        sensor: Option<SensorArgument>,
        exposure: Option<ExposureArgument>,
        frames: u32,
        frame: Option<u32>,
        seed: Option<u64>,
        exposure_noise: Option<&str>,
    ) -> Result<Bound<'py, PyArray3<u16>>, Failure> {
        let options = expose_options(sensor, exposure, frame, seed, exposure_noise)?;
        stack(py, self.compute(py, move |s| expose_film(s, &options, frames))??)
    }

    /// The 8-bit picture of one frame, gamma 2.2: uint8 of shape (height, width) or, of a colour sensor or none, (height,
    /// width, 3).
    #[pyo3(signature = (sensor=None, exposure=None, *, frame=None, seed=None, exposure_noise=None))]
    fn picture<'py>(
        &self,
        py: Python<'py>,
        sensor: Option<SensorArgument>,
        exposure: Option<ExposureArgument>,
        frame: Option<u32>,
        seed: Option<u64>,
        exposure_noise: Option<&str>,
    ) -> Result<Bound<'py, PyAny>, Failure> {
        let options = expose_options(sensor, exposure, frame, seed, exposure_noise)?;
        Ok(match self.compute(py, move |s| picture_of_film(s, &options))?? {
            Picture::Gray(plane) => gray(py, plane)?.into_any(),
            Picture::Rgb(plane) => rgb(py, plane)?.into_any(),
        })
    }

    /// The certificate of the film at level `k`: the share of pixels (`hidden`) whose render noise is at most `k` times that
    /// of the sensor of the render, and quantiles of the ratio of the variances.
    #[pyo3(signature = (k=1.0))]
    fn certificate<'py>(&self, py: Python<'py>, k: f64) -> Result<Bound<'py, PyDict>, Failure> {
        let certified = self.compute(py, move |s| certify_film(s, k))??;
        let c = certified.certificate;
        let entries = PyDict::new(py);
        for (name, value) in
            [("k", c.k), ("hidden", c.hidden), ("mean", c.mean), ("median", c.median), ("p99", c.p99), ("max", c.max)]
        {
            entries.set_item(name, value)?;
        }
        for (name, value) in [("pixels", c.pixels), ("saturated", c.saturated), ("unknown", c.unknown)] {
            entries.set_item(name, value)?;
        }
        entries.set_item("is_hidden", c.is_hidden())?;
        entries.set_item("ratios", gray(py, certified.ratios)?)?;
        Ok(entries)
    }

    /// The noise of the render over that of the sensor of the render, per pixel, as a picture about the level `k`. Raises
    /// `SettingError` for a film without a sensor, and for a `k` that is not a number above zero.
    #[pyo3(signature = (k=1.0))]
    fn noise_map(&self, py: Python<'_>, k: f64) -> Result<NoiseMap, Failure> {
        Ok(NoiseMap(self.compute(py, move |s| certify_film(s, k).map(|certified| Map::new(&certified)))??))
    }

    /// The denoised mean, float32 of shape (height, width, 3) [W/(m² sr)], for display and not for measurement. `method` is
    /// "auto", "oidn" or "builtin".
    #[pyo3(signature = (method="auto"))]
    fn denoise<'py>(&self, py: Python<'py>, method: &str) -> Result<Bound<'py, PyArray3<f32>>, Failure> {
        let method = match method {
            "auto" => DenoiseMethod::Auto,
            "oidn" => DenoiseMethod::Oidn,
            "builtin" => DenoiseMethod::Builtin,
            other => return Err(setting("method", format!("unknown value \"{other}\""), "auto, oidn or builtin")),
        };
        let saved = self.saved.clone();
        let denoised = py.detach(move || denoise_saved(&saved, &DenoiseSettings::default().with_method(method)))?;
        rgb(py, denoised.mean)
    }

    /// Writes the film to a file: its sums to the last bit, with the settings that expose it. `Film.load` reads it.
    fn save(&self, py: Python<'_>, path: PathBuf) -> Result<(), Failure> {
        py.detach(|| self.saved.write(&path))?;
        Ok(())
    }

    /// Reads a film that `save` wrote.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> Result<Self, Failure> {
        let saved = Arc::new(py.detach(|| SavedFilm::read(&path))?);
        Ok(Self { saved, material_names: Arc::default(), stats: String::new(), interrupted: false })
    }

    /// What a saved film does not contain, for copies: statistics, names of the materials, and whether it was interrupted.
    fn _extras(&self) -> (String, Vec<String>, bool) {
        (self.stats.clone(), self.material_names.to_vec(), self.interrupted)
    }

    /// The film of a file with the values of `_extras`.
    #[staticmethod]
    fn _restore(
        py: Python<'_>,
        path: PathBuf,
        stats: String,
        material_names: Vec<String>,
        interrupted: bool,
    ) -> Result<Self, Failure> {
        Ok(Self { stats, material_names: Arc::new(material_names), interrupted, ..Self::load(py, path)? })
    }

    fn __repr__(&self) -> String {
        let sums = &self.saved.film.sums;
        let mean = sums.total_samples() as f64 / sums.pixels().max(1) as f64;
        format!("Film({} x {} pixels, {mean:.1} samples per pixel)", sums.width(), sums.height())
    }

    /// The picture as PNG, for notebooks.
    fn _repr_png_<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyBytes>, Failure> {
        let frame = self.compute(py, |s| develop_film(&s.film, &s.settings))??;
        let bytes = py.detach(|| dunkelfeld::encode_picture(&frame.picture))?;
        Ok(PyBytes::new(py, &bytes))
    }
}
