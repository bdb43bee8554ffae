//! Images of any renderer: exposed and denoised, from EXR files or arrays.

use crate::arguments::{MemoryArgument, checked_threads, method_of, some_threads_of};
use crate::arrays::{ImageArray, rgb, stack};
use crate::errors::{Failure, setting};
use crate::keywords::Keywords;
use crate::progress::{completed, supervised};
use crate::work::with_cancellable_pool;
use dunkelfeld::commands::{DenoisePlanes, ExposeOutputs, check_denoise_output};
use dunkelfeld::denoising::select_denoiser;
use dunkelfeld::io::OF_IMAGE;
use dunkelfeld::{Cancel, DenoiseMethod, DenoiseSettings, ExposeSettings, Session};
use numpy::PyArray3;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// The settings of an exposure, from the arguments of Python.
fn settings_of(
    function: &str,
    first: (Option<&Bound<'_, PyAny>>, Option<&Bound<'_, PyAny>>),
    keys: Option<&Bound<'_, PyDict>>,
    (frames, layer, threads): (u32, Option<String>, Option<usize>),
) -> Result<ExposeSettings, Failure> {
    let mut options = Keywords::of_exposure(function, first, keys, OF_IMAGE)?.exposure().with_frames(frames);
    (options.layer, options.threads) = (layer, checked_threads(threads)?);
    Ok(options.settings()?)
}

/// Exposes an EXR of this or another renderer, as `dunkelfeld expose`: linear grey values, uint16 of shape (frames, height,
/// width) [DN]. Frames of one seed come from the same device. The arguments are the flags of the command: `sensor` (default
/// that of the render of the EXR, or "imx250"), `exposure` [s] or "auto", `exposure_noise` ("matched" needs a layer
/// `variance`), `frame` (number of the first frame), `f_number`, `transmission` and `magnification` (those of the
/// render, or 4, 0.9 and 0), `psf` ("none", "diffraction" or a CSV file) and `glare` (a share; both those of the render, or none),
/// `vignetting` ("cos4" needs `focal_length` [m]), `layer` (name of the layer with the
/// radiance), `memory` (bytes or a text such as "6GB").
///
/// Radiance that is negative or not a number counts as black, infinite radiance saturates.
#[pyfunction]
#[pyo3(signature = (path, sensor=None, exposure=None, frames=1, *, layer=None, threads=None, **keys))]
#[allow(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn expose_exr<'py>(
    py: Python<'py>,
    path: PathBuf,
    sensor: Option<&Bound<'py, PyAny>>,
    exposure: Option<&Bound<'py, PyAny>>,
    frames: u32,
    layer: Option<String>,
    #[pyo3(from_py_with = some_threads_of)] threads: Option<usize>,
    keys: Option<&Bound<'py, PyDict>>,
) -> Result<Bound<'py, PyArray3<u16>>, Failure> {
    let settings = settings_of("expose_exr", (sensor, exposure), keys, (frames, layer, threads))?;
    stack(
        py,
        with_cancellable_pool(py, settings.threads, |cancel| {
            dunkelfeld::commands::expose_image(&path, &settings, cancel)
        })??,
    )
}

/// Exposes an EXR of this or another renderer, and writes each frame to a file, as `dunkelfeld expose` with the same bytes:
/// `image` (PNG, 8 bit, gamma 2.2) and `linear` (16-bit grey values [DN], .png or .tif). Of several frames each name gets its
/// number, as in `out-0007.png`. The other arguments are those of `expose_exr`; `progress` is a function as that of `render`.
///
/// Returns a dictionary: `files` (paths), `frames` (number), `exposure` [s], `no_light` (is the image too dark for an
/// automatic exposure?), `saturated` and `matched` (shares of the pixels; `matched` is None for plain noise), `invalid` and
/// `invalid_variances` (numbers of pixels). Ctrl-C ends it; the finished frames remain.
#[pyfunction]
#[pyo3(signature = (path, image=None, linear=None, *, sensor=None, exposure=None, frames=1, layer=None, threads=None,
    progress=None, **keys))]
#[allow(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn expose_exr_files<'py>(
    py: Python<'py>,
    path: PathBuf,
    image: Option<PathBuf>,
    linear: Option<PathBuf>,
    sensor: Option<&Bound<'py, PyAny>>,
    exposure: Option<&Bound<'py, PyAny>>,
    frames: u32,
    layer: Option<String>,
    #[pyo3(from_py_with = some_threads_of)] threads: Option<usize>,
    progress: Option<Py<PyAny>>,
    keys: Option<&Bound<'py, PyDict>>,
) -> Result<Bound<'py, PyDict>, Failure> {
    let settings = settings_of("expose_exr_files", (sensor, exposure), keys, (frames, layer, threads))?;
    let outputs = ExposeOutputs::default().with_image(image).with_linear(linear);
    let done = supervised(py, progress.as_ref(), 0, |sink, cancel| {
        let session = Session::new(settings.threads)?.with_progress(sink).with_cancel(cancel);
        dunkelfeld::commands::expose_exr(&path, &settings, &outputs, &session)
    })?;
    let exposed = completed(done)?;
    let entries = PyDict::new(py);
    entries.set_item("files", exposed.files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>())?;
    entries.set_item("frames", exposed.frames)?;
    entries.set_item("exposure", exposed.exposer.exposure().time().0)?;
    entries.set_item("no_light", exposed.exposer.no_light())?;
    entries.set_item("saturated", exposed.exposer.saturated())?;
    entries.set_item("matched", exposed.exposer.matched())?;
    entries.set_item("invalid", exposed.exposer.invalid())?;
    entries.set_item("invalid_variances", exposed.exposer.invalid_variances())?;
    Ok(entries)
}

/// `expose_exr` for an array instead of a file. `radiance` has the shape (height, width, 3) and is mean radiance in W/(m² sr),
/// linear Rec. 709, row 0 at the top; it is converted to float32. All of the noise of the sensor is added, because that of
/// the array is unknown.
#[pyfunction]
#[pyo3(signature = (radiance, sensor=None, exposure=None, frames=1, *, threads=None, **keys))]
#[allow(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn expose_radiance<'py>(
    py: Python<'py>,
    radiance: ImageArray<'py>,
    sensor: Option<&Bound<'py, PyAny>>,
    exposure: Option<&Bound<'py, PyAny>>,
    frames: u32,
    #[pyo3(from_py_with = some_threads_of)] threads: Option<usize>,
    keys: Option<&Bound<'py, PyDict>>,
) -> Result<Bound<'py, PyArray3<u16>>, Failure> {
    let settings = settings_of("expose_radiance", (sensor, exposure), keys, (frames, None, threads))?;
    let radiance = radiance.rgb("radiance", settings.memory_limit)?;
    let expose = |cancel: &Cancel| dunkelfeld::commands::expose_radiance(radiance, &settings, cancel);
    stack(py, with_cancellable_pool(py, settings.threads, expose)??)
}

/// The denoiser of the keywords.
fn denoiser(name: Option<&str>, oidn: Option<PathBuf>) -> Result<DenoiseSettings, Failure> {
    let method = name.map(method_of).transpose()?.or(oidn.is_none().then_some(DenoiseMethod::Auto));
    let mut settings = DenoiseSettings::default();
    select_denoiser(method, oidn.as_deref(), &mut settings);
    Ok(settings)
}

fn cancelled() -> Failure {
    setting("denoise", "was cancelled", "call it again")
}

/// Denoises an EXR of this or another renderer, as `dunkelfeld denoise`: float32 of shape (height, width, 3) [W/(m² sr)], for
/// display and not for measurement. It uses variance, albedo, normal and depth if the file has them. `output` is the path of
/// a file to write as well: an EXR with all layers and `denoised.R/G/B`, or a PNG (8 bit, gamma 2.2). `denoise` is "auto"
/// (the default), "oidn" or "builtin", `oidn` the path of Open Image Denoise.
///
/// Where the radiance is negative, infinite or not a number, and around such pixels, the result is undefined.
#[pyfunction]
#[pyo3(signature = (path, output=None, *, denoise=None, oidn=None, memory=None, threads=None, progress=None))]
#[allow(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn denoise_exr<'py>(
    py: Python<'py>,
    path: PathBuf,
    output: Option<PathBuf>,
    denoise: Option<&str>,
    oidn: Option<PathBuf>,
    memory: Option<MemoryArgument>,
    #[pyo3(from_py_with = some_threads_of)] threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> Result<Bound<'py, PyArray3<f32>>, Failure> {
    let settings = denoiser(denoise, oidn)?;
    let (memory, threads) = (memory.map(MemoryArgument::bytes).transpose()?, checked_threads(threads)?.unwrap_or(0));
    let done = supervised(py, progress.as_ref(), 0, |sink, cancel| {
        if let Some(output) = &output {
            check_denoise_output(&path, output, &settings)?;
        }
        let session = Session::new(threads)?.with_progress(sink).with_cancel(cancel);
        let Some(file) = dunkelfeld::commands::denoise_exr(&path, &settings, memory, &session)? else {
            return Ok(None);
        };
        let mean = file.denoised.mean.clone();
        if let Some(output) = &output {
            file.save(output)?;
        }
        Ok(Some(mean))
    })?;
    rgb(py, completed(done)?.ok_or_else(cancelled)?)
}

/// `denoise_exr` for arrays instead of a file, row 0 at the top; they are converted to float32. `radiance` has the shape
/// (height, width, 3) [W/(m² sr)], linear Rec. 709. Optional: `variance` of the radiance, `first_light` as its part (see
/// `Film.first_light`), `albedo` and `normal` (unit vectors) of the same shape, `depth` [m] of shape (height, width).
#[pyfunction]
#[pyo3(signature = (radiance, *, variance=None, first_light=None, albedo=None, normal=None, depth=None, denoise=None, oidn=None,
    memory=None, threads=None, progress=None))]
#[allow(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn denoise_radiance<'py>(
    py: Python<'py>,
    radiance: ImageArray<'py>,
    variance: Option<ImageArray<'py>>,
    first_light: Option<ImageArray<'py>>,
    albedo: Option<ImageArray<'py>>,
    normal: Option<ImageArray<'py>>,
    depth: Option<ImageArray<'py>>,
    denoise: Option<&str>,
    oidn: Option<PathBuf>,
    memory: Option<MemoryArgument>,
    #[pyo3(from_py_with = some_threads_of)] threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> Result<Bound<'py, PyArray3<f32>>, Failure> {
    let settings = denoiser(denoise, oidn)?;
    let (memory, threads) = (memory.map(MemoryArgument::bytes).transpose()?, checked_threads(threads)?.unwrap_or(0));
    // Each copy is checked by itself, and all of them, with the work, before the denoiser begins.
    let plane = |what, array: Option<ImageArray<'_>>| array.map(|array| array.rgb(what, memory)).transpose();
    let planes = DenoisePlanes::new(radiance.rgb("radiance", memory)?)
        .with_variance(plane("variance", variance)?)
        .with_first_light(plane("first_light", first_light)?)
        .with_albedo(plane("albedo", albedo)?)
        .with_normal(plane("normal", normal)?)
        .with_depth(depth.map(|array| array.gray("depth", memory)).transpose()?);
    let done = supervised(py, progress.as_ref(), 0, |sink, cancel| {
        let session = Session::new(threads)?.with_progress(sink).with_cancel(cancel);
        dunkelfeld::commands::denoise_planes(&planes, &settings, memory, &session)
    })?;
    rgb(py, completed(done)?.ok_or_else(cancelled)?.mean)
}
