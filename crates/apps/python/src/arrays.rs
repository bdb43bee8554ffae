//! Planes as arrays of numpy. The buffer of a plane moves to its array.

use crate::errors::{Failure, setting};
use bytemuck::Pod;
use dunkelfeld::film::Plane;
use dunkelfeld::limits::{MAX_PIXELS, MAX_SIDE};
use dunkelfeld::memory::check_image_memory;
use numpy::{
    AllowTypeChange, Element, PyArray1, PyArray2, PyArray3, PyArrayDescrMethods, PyArrayLike2, PyArrayLike3,
    PyArrayMethods, PyReadonlyArray2, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

/// An array of shape (height, width).
pub(crate) fn gray<T: Element>(py: Python<'_>, plane: Plane<T>) -> Result<Bound<'_, PyArray2<T>>, Failure> {
    let shape = [plane.height() as usize, plane.width() as usize];
    Ok(PyArray1::from_vec(py, plane.into_vec()).reshape(shape)?)
}

/// An array of shape (height, width, 3).
pub(crate) fn rgb<T: Element + Pod>(py: Python<'_>, plane: Plane<[T; 3]>) -> Result<Bound<'_, PyArray3<T>>, Failure> {
    let shape = [plane.height() as usize, plane.width() as usize, 3];
    Ok(PyArray1::from_vec(py, flat(plane.into_vec())).reshape(shape)?)
}

/// An array of shape (planes, height, width) of planes of one size.
pub(crate) fn stack<T: Element + Copy>(
    py: Python<'_>,
    planes: Vec<Plane<T>>,
) -> Result<Bound<'_, PyArray3<T>>, Failure> {
    let [height, width] = planes.first().map_or([0, 0], |p| [p.height(), p.width()].map(|n| n as usize));
    let shape = [planes.len(), height, width];
    let mut planes = planes.into_iter();
    let mut values = planes.next().map(Plane::into_vec).unwrap_or_default();
    values.reserve_exact(shape.iter().product::<usize>() - values.len());
    planes.for_each(|plane| values.extend_from_slice(plane.data()));
    Ok(PyArray1::from_vec(py, values).reshape(shape)?)
}

/// The same buffer, number by number.
pub(crate) fn flat<T: Pod, const N: usize>(pixels: Vec<[T; N]>) -> Vec<T>
where
    [T; N]: Pod,
{
    match bytemuck::allocation::try_cast_vec(pixels) {
        Ok(values) => values,
        // The capacity is no multiple of a pixel.
        Err((_, pixels)) => pixels.into_iter().flatten().collect(),
    }
}

/// An image from Python: an array of numpy, or what numpy makes one of. Its shape and its memory are checked before the copy.
pub(crate) struct ImageArray<'py>(Bound<'py, PyAny>);

impl<'py> FromPyObject<'_, 'py> for ImageArray<'py> {
    type Error = PyErr;

    fn extract(array: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self(array.to_owned()))
    }
}

impl<'py> ImageArray<'py> {
    /// The plane of an array of shape (height, width). `what` is its name in errors, `memory` a limit \[bytes\] of the copy.
    pub(crate) fn gray(&self, what: &str, memory: Option<u64>) -> Result<Plane<f32>, Failure> {
        self.check(what, &["height", "width"], memory)?;
        let array: PyArrayLike2<'py, f32, AllowTypeChange> = self.0.extract().map_err(|e| no_numbers(what, e))?;
        let view = array.as_array();
        check_size(what, view.dim(), size_of::<f32>(), memory)?;
        plane_of(what, view.dim(), view.iter().copied())
    }

    /// The plane of an array of shape (height, width, 3).
    pub(crate) fn rgb(&self, what: &str, memory: Option<u64>) -> Result<Plane<[f32; 3]>, Failure> {
        self.check(what, &["height", "width", "3"], memory)?;
        let array: PyArrayLike3<'py, f32, AllowTypeChange> = self.0.extract().map_err(|e| no_numbers(what, e))?;
        let view = array.as_array();
        let (height, width, channels) = view.dim();
        if channels != 3 {
            let problem = format!("has {channels} channels, and not 3");
            return Err(setting(what, problem, "pass an array of shape (height, width, 3)"));
        }
        check_size(what, (height, width), size_of::<[f32; 3]>(), memory)?;
        plane_of(what, (height, width), view.rows().into_iter().map(|pixel| [pixel[0], pixel[1], pixel[2]]))
    }

    /// Checks an array of numpy before it is converted to float32, which copies other types.
    fn check(&self, what: &str, shape: &[&str], memory: Option<u64>) -> Result<(), Failure> {
        let Ok(array) = self.0.cast::<PyUntypedArray>() else { return Ok(()) };
        let refuse = |problem: String| {
            let help = format!("pass an array of real numbers of shape ({})", shape.join(", "));
            Err(setting(what, problem, &help))
        };
        if array.ndim() != shape.len() {
            return refuse(format!("has {} dimensions", array.ndim()));
        }
        if !matches!(array.dtype().kind(), b'b' | b'i' | b'u' | b'f' | b'O') {
            return refuse(format!("contains no real numbers, but {}", array.dtype()));
        }
        if self.0.hasattr("mask")? {
            return refuse("is a masked array, whose mask would be lost".into());
        }
        let [height, width] = [array.shape()[0], array.shape()[1]];
        let channels = array.shape().get(2).map_or(1, |&channels| channels.min(3));
        check_size(what, (height, width), channels * size_of::<f32>(), memory)
    }
}

/// Numbers of samples from Python, shape (height, width).
#[derive(FromPyObject)]
pub(crate) enum CountsArray<'py> {
    U32(PyReadonlyArray2<'py, u32>),
    I64(PyReadonlyArray2<'py, i64>),
}

impl CountsArray<'_> {
    pub(crate) fn plane(&self, what: &str) -> Result<Plane<u32>, Failure> {
        let check = |size| check_size(what, size, size_of::<u32>(), None);
        match self {
            Self::U32(array) => {
                let view = array.as_array();
                check(view.dim())?;
                plane_of(what, view.dim(), view.iter().copied())
            }
            Self::I64(array) => {
                let view = array.as_array();
                check(view.dim())?;
                if let Some(n) = view.iter().find(|&&n| u32::try_from(n).is_err()) {
                    let help = "pass whole numbers from 0 to 4294967295";
                    return Err(setting(what, format!("{n} is no number of samples"), help));
                }
                plane_of(what, view.dim(), view.iter().map(|&n| u32::try_from(n).unwrap_or(0)))
            }
        }
    }
}

fn no_numbers(what: &str, error: PyErr) -> Failure {
    PyTypeError::new_err(format!("{what} is no array of numbers: {error}")).into()
}

/// Checks the sides of an image, and whether its copy is within the memory.
fn check_size(
    what: &str,
    (height, width): (usize, usize),
    bytes_per_pixel: usize,
    memory: Option<u64>,
) -> Result<(), Failure> {
    let pixels = (height as u64).saturating_mul(width as u64);
    let is_side = |side: usize| (1..=MAX_SIDE as usize).contains(&side);
    if !is_side(height) || !is_side(width) || pixels > MAX_PIXELS {
        let help = format!("pass an image of 1 to {MAX_SIDE} pixels along each side, and at most {MAX_PIXELS}");
        return Err(setting(what, format!("has {width} x {height} pixels"), &help));
    }
    Ok(check_image_memory(pixels * bytes_per_pixel as u64, memory)?)
}

fn plane_of<T>(
    what: &str,
    (height, width): (usize, usize),
    pixels: impl Iterator<Item = T>,
) -> Result<Plane<T>, Failure> {
    let sides = u32::try_from(width).ok().zip(u32::try_from(height).ok());
    let plane = sides.and_then(|(width, height)| Plane::from_vec(width, height, pixels.collect()));
    plane.ok_or_else(|| setting(what, format!("has {width} x {height} pixels"), "pass an image of a smaller size"))
}
