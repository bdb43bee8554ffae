//! Files that a scene or a study is made from, and images as arrays.

use crate::errors::Failure;
use dunkelfeld::scene::Texels;
use dunkelfeld::{Error, InputFiles};
use dunkelfeld_io::images::decode_image;
use dunkelfeld_io::input::{InputFile, Role};
use dunkelfeld_io::loader::Limits;
use numpy::{Element, PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};

/// The absolute paths of input files, each once. Libraries belong to the machine and are left out.
pub(crate) fn names_of<'a>(inputs: impl Iterator<Item = &'a InputFile>) -> Vec<PathBuf> {
    let mut names: Vec<PathBuf> = Vec::new();
    for input in inputs.filter(|input| input.role != Role::Library) {
        let path = input.identity.path();
        let path = std::path::absolute(path).unwrap_or_else(|_| path.into());
        if !names.contains(&path) {
            names.push(path);
        }
    }
    names
}

/// The absolute paths of input files with their roles, for copies.
pub(crate) fn input_names(inputs: &InputFiles) -> Vec<(PathBuf, String)> {
    let named = |input: &InputFile| {
        let path = input.identity.path();
        (std::path::absolute(path).unwrap_or_else(|_| path.into()), input.role.name().to_owned())
    };
    inputs.iter().map(named).collect()
}

/// The input files by their absolute paths: the current folder may change, and a copy may be used in another one.
pub(crate) fn absolute(inputs: &InputFiles) -> InputFiles {
    inputs_of(&input_names(inputs))
}

/// The input files of [`input_names`].
pub(crate) fn inputs_of(names: &[(PathBuf, String)]) -> InputFiles {
    let mut inputs = InputFiles::new();
    for (path, name) in names {
        if let Some(role) = Role::ALL.into_iter().find(|role| role.name() == name) {
            inputs.add(path, role);
        }
    }
    inputs
}

/// Reads an image file: PNG, JPEG, TIFF, WebP, BMP, TGA, Radiance HDR or OpenEXR, as stored. Returns an array of shape
/// (height, width) for one channel, otherwise (height, width, channels): uint8, uint16, or float32 for HDR and OpenEXR.
#[pyfunction]
pub(crate) fn read_image(py: Python<'_>, path: PathBuf) -> Result<Bound<'_, PyAny>, Failure> {
    let (texels, shape) = py.detach(|| decoded(&path))?;
    match texels {
        Texels::Gray8(values) => array(py, values, shape),
        Texels::GrayAlpha8(values) => array(py, values, shape),
        Texels::Rgb8(values) => array(py, values, shape),
        Texels::Rgba8(values) => array(py, values, shape),
        Texels::Gray16(values) => array(py, values, shape),
        Texels::GrayAlpha16(values) => array(py, values, shape),
        Texels::Rgb16(values) => array(py, values, shape),
        Texels::Rgba16(values) => array(py, values, shape),
        Texels::GrayF32(values) => array(py, values, shape),
        Texels::RgbF32(values) => array(py, values, shape),
    }
}

/// The texels of a file, with height and width.
fn decoded(path: &Path) -> Result<(Texels, [usize; 2]), Error> {
    let limits = Limits::default();
    let bytes = InputFiles::new().read(path, Role::Frame, limits.file_bytes).map_err(|fault| fault.at(path))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let image = decode_image(&bytes, &name, &limits).map_err(|fault| fault.at(path, "the image"))?.image;
    let shape = [image.height, image.width].map(|side| side as usize);
    let texels = std::sync::Arc::try_unwrap(image.texels).unwrap_or_else(|shared| (*shared).clone());
    Ok((texels, shape))
}

fn array<T: Element + bytemuck::Pod, const N: usize>(
    py: Python<'_>,
    values: Vec<[T; N]>,
    [height, width]: [usize; 2],
) -> Result<Bound<'_, PyAny>, Failure>
where
    [T; N]: bytemuck::Pod,
{
    let values = PyArray1::from_vec(py, crate::arrays::flat(values));
    Ok(match N {
        1 => values.reshape([height, width])?.into_any(),
        _ => values.reshape([height, width, N])?.into_any(),
    })
}
