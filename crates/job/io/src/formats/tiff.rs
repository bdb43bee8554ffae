//! Uncompressed TIFF files, which all measurement software can read, and maps of 32-bit floats in TIFF files.

use std::io::{self, Seek, Write};
use std::path::Path;

use dunkelfeld_film::{MAX_SIDE, Plane};
use dunkelfeld_sensor::PixelMap;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::encoder::{TiffEncoder, colortype};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

use crate::atomic::write_atomically;
use crate::error::InputError;
use crate::images::{ImageFault, guarded};
use crate::input::{InputFiles, Role};
use crate::loader::Limits;
use crate::picture::Picture;

/// Writes a picture. `description`, if there is one, is stored in the tag ImageDescription (ASCII; other characters
/// become `?`).
///
/// # Errors
/// Those of the file system, a picture without pixels or of more than 4 GiB. An existing file stays as it was.
pub fn write_tiff(path: &Path, picture: Picture<'_>, description: Option<&str>) -> io::Result<()> {
    write_atomically(path, |file| encode_picture(file, picture, description))
}

/// The bytes of such a file.
///
/// # Errors
/// As [`write_tiff`], without those of the file system.
pub fn tiff_bytes(picture: Picture<'_>, description: Option<&str>) -> io::Result<Vec<u8>> {
    let mut bytes = io::Cursor::new(Vec::new());
    encode_picture(&mut bytes, picture, description)?;
    Ok(bytes.into_inner())
}

/// Writes a map: one 32-bit float for each pixel.
///
/// # Errors
/// As [`write_tiff`].
pub fn write_map(path: &Path, map: &PixelMap, description: &str) -> io::Result<()> {
    let (size, values) = ((map.values().width(), map.values().height()), map.values().data());
    write_atomically(path, |file| {
        encode::<colortype::Gray32Float, _>(file, size, values, Some(description)).map_err(explain)
    })
}

/// Reads a map: a TIFF with one channel of 32-bit floats. The file is recorded as an input.
///
/// # Errors
/// The file cannot be read, is no such TIFF, or has values that are not finite.
pub fn read_map(path: &Path, inputs: &mut InputFiles) -> Result<PixelMap, InputError> {
    let bytes = inputs.read(path, Role::PixelMap, Limits::default().file_bytes).map_err(|fault| fault.at(path))?;
    let help = "write a TIFF with one channel of 32-bit floats, as `emva analyse --sensor` does";
    let fault = |problem: String| ImageFault { problem, help: help.into() };
    let decode = || {
        let mut decoder = Decoder::new(io::Cursor::new(&bytes)).map_err(|e| fault(e.to_string()))?;
        let (width, height) = decoder.dimensions().map_err(|e| fault(e.to_string()))?;
        let is_gray = decoder.colortype().is_ok_and(|color| color == ColorType::Gray(32));
        if !is_gray || width.max(height) > MAX_SIDE {
            return Err(fault("is not one channel of 32-bit floats".into()));
        }
        match decoder.read_image().map_err(|e| fault(e.to_string()))? {
            DecodingResult::F32(values) => {
                let plane = Plane::from_vec(width, height, values).ok_or_else(|| fault("is incomplete".into()))?;
                PixelMap::new(plane).map_err(fault)
            }
            _ => Err(fault("has whole numbers, not floats".into())),
        }
    };
    guarded(decode).map_err(|fault| fault.at(path, "the map"))
}

fn encode_picture(file: impl Write + Seek, picture: Picture<'_>, description: Option<&str>) -> io::Result<()> {
    let (width, height) = picture.size();
    if width == 0 || height == 0 {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "a TIFF needs at least one pixel"));
    }
    match picture {
        Picture::Gray8(p) => encode::<colortype::Gray8, _>(file, (width, height), p.data(), description),
        Picture::Rgb8(p) => encode::<colortype::RGB8, _>(file, (width, height), p.data().as_flattened(), description),
        Picture::Gray16(p) => encode::<colortype::Gray16, _>(file, (width, height), p.data(), description),
        Picture::Rgb16(p) => encode::<colortype::RGB16, _>(file, (width, height), p.data().as_flattened(), description),
    }
    .map_err(explain)
}

fn encode<C, W>(
    file: W,
    (width, height): (u32, u32),
    values: &[C::Inner],
    description: Option<&str>,
) -> Result<(), TiffError>
where
    C: colortype::ColorType,
    [C::Inner]: tiff::encoder::TiffValue,
    W: Write + Seek,
{
    let mut encoder = TiffEncoder::new(file)?;
    let mut image = encoder.new_image::<C>(width, height)?;
    if let Some(text) = description {
        let ascii: String = text.chars().map(|c| if c.is_ascii() && c != '\0' { c } else { '?' }).collect();
        image.encoder().write_tag(Tag::ImageDescription, ascii.as_str())?;
    }
    image.write_data(values)
}

fn explain(error: TiffError) -> io::Error {
    match error {
        TiffError::IoError(e) => e,
        other => io::Error::new(io::ErrorKind::InvalidInput, other.to_string()),
    }
}
