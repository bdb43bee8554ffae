//! Uncompressed TIFF files, which all measurement software can read.

use std::io::{self, Seek, Write};
use std::path::Path;

use tiff::TiffError;
use tiff::encoder::{TiffEncoder, colortype};
use tiff::tags::Tag;

use crate::atomic::write_atomically;
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
