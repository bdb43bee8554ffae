//! Films: sums of samples per pixel, as arrays of numpy, and their exposure.

use crate::arguments::method_of;
use crate::arrays::{gray, rgb, stack};
use crate::errors::Failure;
use crate::inputs::{input_names, inputs_of};
use crate::keywords::Keywords;
use crate::noise_map::NoiseMap;
use crate::work::{with_cancellable_pool, with_pool};
use dunkelfeld::film::PixelSums;
use dunkelfeld::film::{NO_ID, certify_film, denoise_saved, expose_film, picture_of_film};
use dunkelfeld::io::OF_FILM;
use dunkelfeld::outputs::{save_film, save_film_files};
use dunkelfeld::{
    DenoiseMethod, DenoiseSettings, InputFiles, OutputPaths, Picture, RenderSettings, SavedFilm, develop_film,
};
use dunkelfeld_io::input::Role;
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
    /// The statistics of the render as JSON; empty for a film from a file.
    pub(crate) stats: String,
    pub(crate) interrupted: bool,
    /// The files that it was made from. No output replaces them.
    pub(crate) inputs: Arc<InputFiles>,
}

impl Film {
    fn settings(&self) -> &RenderSettings {
        &self.saved.settings
    }

    /// Writes files of the film.
    fn write(&self, py: Python<'_>, outputs: &OutputPaths) -> Result<(), Failure> {
        let stats = Some(self.stats.as_str()).filter(|text| !text.is_empty());
        Ok(py.detach(|| save_film_files(&self.saved, stats, outputs, &self.inputs))?)
    }

    /// Computes a plane on the threads of the render, without the interpreter.
    fn compute<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&SavedFilm) -> T + Send) -> Result<T, Failure> {
        let saved = &*self.saved;
        with_pool(py, self.settings().run.threads, move || work(saved))
    }
}

/// See `Film._extras`.
type Extras = (String, bool, Vec<(PathBuf, String)>, Option<PathBuf>, Option<u64>);

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

    /// The plan of the film: samples per pixel, uint32 of shape (height, width). `save_plan` writes it, and
    /// `Scene.render(replay=film)` renders the same samples again.
    #[getter]
    fn plan<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray2<u32>>, Failure> {
        self.spp(py)
    }

    /// Object at the centre of each pixel, uint32 of shape (height, width); `NO_ID` where there is none. Behind a smooth clear
    /// surface it is the first object that scatters, so that a clear cover has no pixels.
    #[getter]
    fn object_ids<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray2<u32>>, Failure> {
        gray(py, self.compute(py, |s| s.film.ids.map(|id| id.map_or(NO_ID, |id| id.object())))?)
    }

    /// Material at the centre of each pixel, that of `object_ids`, uint32 of shape (height, width); `NO_ID` where there is none.
    #[getter]
    fn material_ids<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray2<u32>>, Failure> {
        gray(py, self.compute(py, |s| s.film.ids.map(|id| id.map_or(NO_ID, |id| id.material())))?)
    }

    /// Names of the objects by id.
    #[getter]
    fn object_names(&self) -> Vec<String> {
        self.saved.film.object_names.clone()
    }

    /// Names of the materials by id.
    #[getter]
    fn material_names(&self) -> Vec<String> {
        self.saved.film.material_names.clone()
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

    /// First light: emission before the first surface that scatters light, and the light samples of that surface; float32 of shape
    /// (height, width, 3) [W/(m² sr)], linear Rec. 709.
    #[getter]
    fn first_light<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray3<f32>>, Failure> {
        rgb(py, self.compute(py, |s| s.film.sums.map(|p| p.mean_first_light()))?)
    }

    /// The rest of the mean behind [`first_light`]: light that was scattered twice or more, or found by scattering.
    #[getter]
    fn rest<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyArray3<f32>>, Failure> {
        let rest = |p: &PixelSums| {
            let (mean, first_light) = (p.mean(), p.mean_first_light());
            std::array::from_fn(|c| (mean[c] - f64::from(first_light[c])).max(0.0) as f32)
        };
        rgb(py, self.compute(py, move |s| s.film.sums.map(rest))?)
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
    /// "auto", `frame` is the number of the first frame, `exposure_noise` is "plain" or "matched". Ctrl-C ends it after a frame.
    #[pyo3(signature = (sensor=None, exposure=None, frames=1, **keys))]
    fn expose<'py>(
        &self,
        py: Python<'py>,
        sensor: Option<&Bound<'py, PyAny>>,
        exposure: Option<&Bound<'py, PyAny>>,
        frames: u32,
        keys: Option<&Bound<'py, PyDict>>,
    ) -> Result<Bound<'py, PyArray3<u16>>, Failure> {
        let options = Keywords::of_exposure("expose", (sensor, exposure), keys, OF_FILM)?.exposure();
        let (saved, threads) = (&*self.saved, self.settings().run.threads);
        stack(py, with_cancellable_pool(py, threads, |cancel| expose_film(saved, &options, frames, cancel))??)
    }

    /// The 8-bit picture of one frame, gamma 2.2: uint8 of shape (height, width) or, of a colour sensor or none, (height,
    /// width, 3). It shows the unbiased mean, also after `render(denoise=...)`.
    #[pyo3(signature = (sensor=None, exposure=None, **keys))]
    fn picture<'py>(
        &self,
        py: Python<'py>,
        sensor: Option<&Bound<'py, PyAny>>,
        exposure: Option<&Bound<'py, PyAny>>,
        keys: Option<&Bound<'py, PyDict>>,
    ) -> Result<Bound<'py, PyAny>, Failure> {
        let options = Keywords::of_exposure("picture", (sensor, exposure), keys, OF_FILM)?.exposure();
        Ok(match self.compute(py, move |s| picture_of_film(s, &options))?? {
            Picture::Gray(plane) => gray(py, plane)?.into_any(),
            Picture::Rgb(plane) => rgb(py, plane)?.into_any(),
        })
    }

    /// The certificate of the film at level `k`: the share of pixels (`hidden`) whose render noise is at most `k` times that
    /// of the sensor of the render, and quantiles of the ratio of the variances. `k` is 0.001 to 1000.
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
    /// `SettingError` for a film without a sensor, and for a `k` outside of 0.001 to 1000.
    #[pyo3(signature = (k=1.0))]
    fn noise_map(&self, py: Python<'_>, k: f64) -> Result<NoiseMap, Failure> {
        Ok(NoiseMap(self.compute(py, move |s| certify_film(s, k).map(|certified| Map::new(&certified)))??))
    }

    /// The denoised mean, float32 of shape (height, width, 3) [W/(m² sr)], for display and not for measurement. `method` is
    /// "auto", "oidn" or "builtin", `oidn` the path of Open Image Denoise; without it the path of the render counts.
    #[pyo3(signature = (method="auto", *, oidn=None))]
    fn denoise<'py>(
        &self,
        py: Python<'py>,
        method: &str,
        oidn: Option<PathBuf>,
    ) -> Result<Bound<'py, PyArray3<f32>>, Failure> {
        let method = method_of(method)?;
        let of_render = || self.settings().denoise.oidn.clone().filter(|_| method != DenoiseMethod::Builtin);
        let settings = DenoiseSettings::default().with_method(method).with_oidn(oidn.or_else(of_render));
        let saved = self.saved.clone();
        let denoised = py.detach(move || denoise_saved(&saved, &settings))?;
        rgb(py, denoised.mean)
    }

    /// Writes the film to a file: its sums to the last bit, with the settings that expose it. `Film.load` reads it.
    /// It replaces neither a file that the film was made from nor the checkpoint of its render.
    fn save(&self, py: Python<'_>, path: PathBuf) -> Result<(), Failure> {
        Ok(py.detach(|| save_film(&self.saved, &path, &self.inputs))?)
    }

    /// Writes the files of `dunkelfeld render` with the same bytes: `image` (PNG, 8 bit, gamma 2.2), `linear` (16-bit grey
    /// values [DN], .png or .tif), `exr` (all layers), `stats` (JSON) and `plan` (EXR with the samples per pixel). The names are
    /// those of `[output]` of a job. The film is exposed as its render was, and denoised by `render(denoise=...)`.
    ///
    /// A file is written as a whole or not at all. Raises `OutputError` for a name that does not fit, for a file that the
    /// film was made from, and for a file that cannot be written; earlier files remain.
    #[pyo3(signature = (*, image=None, linear=None, exr=None, stats=None, plan=None))]
    fn save_files(
        &self,
        py: Python<'_>,
        image: Option<PathBuf>,
        linear: Option<PathBuf>,
        exr: Option<PathBuf>,
        stats: Option<PathBuf>,
        plan: Option<PathBuf>,
    ) -> Result<(), Failure> {
        let outputs = OutputPaths::default().with_image(image).with_linear(linear).with_exr(exr);
        self.write(py, &outputs.with_stats(stats).with_plan(plan))
    }

    /// Writes the picture: PNG, 8 bit, gamma 2.2, clipped at saturation. See `save_files`.
    fn save_image(&self, py: Python<'_>, path: PathBuf) -> Result<(), Failure> {
        self.write(py, &OutputPaths::default().with_image(path))
    }

    /// Writes the linear grey values [DN], 16 bit, .png or .tif; behind a colour filter the raw mosaic. See `save_files`.
    fn save_linear(&self, py: Python<'_>, path: PathBuf) -> Result<(), Failure> {
        self.write(py, &OutputPaths::default().with_linear(path))
    }

    /// Writes an EXR with all layers. See `save_files`.
    fn save_exr(&self, py: Python<'_>, path: PathBuf) -> Result<(), Failure> {
        self.write(py, &OutputPaths::default().with_exr(path))
    }

    /// Writes an EXR with the samples per pixel, for `Scene.render(replay=path)` and `--replay`. See `save_files`.
    fn save_plan(&self, py: Python<'_>, path: PathBuf) -> Result<(), Failure> {
        self.write(py, &OutputPaths::default().with_plan(path))
    }

    /// Writes the statistics of the render as JSON. Raises `SettingError` for a film from a file, which has none. See
    /// `save_files`.
    fn save_stats(&self, py: Python<'_>, path: PathBuf) -> Result<(), Failure> {
        self.write(py, &OutputPaths::default().with_stats(path))
    }

    /// Reads a film that `save` wrote, or the film of a checkpoint. It has no statistics and no limit of memory, it does not know
    /// whether it was interrupted, and a checkpoint has no denoiser. The library of a denoiser is where this machine has it.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> Result<Self, Failure> {
        let mut inputs = InputFiles::new();
        inputs.add(&std::path::absolute(&path).unwrap_or_else(|_| path.clone()), Role::Checkpoint);
        let saved = Arc::new(py.detach(|| SavedFilm::read(&path))?);
        Ok(Self { saved, stats: String::new(), interrupted: false, inputs: inputs.into() })
    }

    /// The data that a saved film does not contain, for copies: statistics, whether it was interrupted, its inputs with their
    /// roles, the library of the denoiser, and the limit of memory [bytes].
    fn _extras(&self) -> Extras {
        let RenderSettings { denoise, memory_limit, .. } = self.settings();
        (self.stats.clone(), self.interrupted, input_names(&self.inputs), denoise.oidn.clone(), *memory_limit)
    }

    /// The film of a file with the values of `_extras`.
    #[staticmethod]
    fn _restore(py: Python<'_>, path: PathBuf, extras: Extras) -> Result<Self, Failure> {
        let (stats, interrupted, inputs, oidn, memory_limit) = extras;
        let mut saved = py.detach(|| SavedFilm::read(&path))?;
        (saved.settings.denoise.oidn, saved.settings.memory_limit) = (oidn, memory_limit);
        Ok(Self { saved: Arc::new(saved), stats, interrupted, inputs: Arc::new(inputs_of(&inputs)) })
    }

    fn __repr__(&self) -> String {
        let sums = &self.saved.film.sums;
        let mean = sums.total_samples() as f64 / sums.pixels().max(1) as f64;
        format!("Film({} x {} pixels, {mean:.1} samples per pixel)", sums.width(), sums.height())
    }

    /// The picture as PNG, for notebooks.
    fn _repr_png_<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyBytes>, Failure> {
        let frame = self.compute(py, |s| develop_film(&s.film, &s.settings))??;
        let bytes = py.detach(|| dunkelfeld::outputs::encode_picture(&frame.picture))?;
        Ok(PyBytes::new(py, &bytes))
    }
}
