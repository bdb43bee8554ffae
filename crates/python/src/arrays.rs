//! Planes as arrays of numpy. The buffer of a plane moves to its array.

use crate::errors::{Failure, setting};
use bytemuck::Pod;
use dunkelfeld::film::Plane;
use numpy::{
    AllowTypeChange, Element, PyArray1, PyArray2, PyArray3, PyArrayLike2, PyArrayLike3, PyArrayMethods,
    PyReadonlyArray2,
};
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

/// An image of numbers from Python, shape (height, width).
pub(crate) type GrayArray<'py> = PyArrayLike2<'py, f32, AllowTypeChange>;

/// An image of three channels from Python, shape (height, width, 3).
pub(crate) type RgbArray<'py> = PyArrayLike3<'py, f32, AllowTypeChange>;

/// The plane of an array of shape (height, width). `what` is its name in errors.
pub(crate) fn gray_plane(what: &str, array: &GrayArray<'_>) -> Result<Plane<f32>, Failure> {
    let view = array.as_array();
    plane_of(what, view.dim(), view.iter().copied().collect())
}

/// The plane of an array of shape (height, width, 3).
pub(crate) fn rgb_plane(what: &str, array: &RgbArray<'_>) -> Result<Plane<[f32; 3]>, Failure> {
    let view = array.as_array();
    let (height, width, channels) = view.dim();
    if channels != 3 {
        let problem = format!("has {channels} channels, and not 3");
        return Err(setting(what, problem, "pass an array of shape (height, width, 3)"));
    }
    let values: Vec<f32> = view.iter().copied().collect();
    plane_of(what, (height, width), values.as_chunks().0.to_vec())
}

/// Numbers of samples from Python, shape (height, width).
#[derive(FromPyObject)]
pub(crate) enum CountsArray<'py> {
    U32(PyReadonlyArray2<'py, u32>),
    I64(PyReadonlyArray2<'py, i64>),
}

impl CountsArray<'_> {
    pub(crate) fn plane(&self, what: &str) -> Result<Plane<u32>, Failure> {
        let (size, values) = match self {
            Self::U32(array) => (array.as_array().dim(), array.as_array().iter().copied().collect()),
            Self::I64(array) => {
                let count = |n: &i64| {
                    u32::try_from(*n).map_err(|_| {
                        let help = "pass whole numbers from 0 to 4294967295";
                        setting(what, format!("{n} is no number of samples"), help)
                    })
                };
                (array.as_array().dim(), array.as_array().iter().map(count).collect::<Result<_, _>>()?)
            }
        };
        plane_of(what, size, values)
    }
}

fn plane_of<T>(what: &str, (height, width): (usize, usize), values: Vec<T>) -> Result<Plane<T>, Failure> {
    let sides = u32::try_from(width).ok().zip(u32::try_from(height).ok());
    let plane = sides.and_then(|(width, height)| Plane::from_vec(width, height, values));
    plane.ok_or_else(|| setting(what, format!("has {width} x {height} pixels"), "pass an image of a smaller size"))
}
