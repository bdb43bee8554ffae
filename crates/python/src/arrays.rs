//! Planes as arrays of numpy. The buffer of a plane moves to its array.

use crate::errors::Failure;
use bytemuck::Pod;
use dunkelfeld::film::Plane;
use numpy::{Element, PyArray1, PyArray2, PyArray3, PyArrayMethods};
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
