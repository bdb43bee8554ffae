//! PNG files with the correct gAMA chunk.

use std::io::{self, Write};
use std::path::Path;

use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, Filter, ScaledFloat};

use crate::atomic::write_atomically;
use crate::picture::Picture;

/// gAMA of a 2.2 encoding: 100 000 / 2.2, rounded (PNG specification, third edition, 11.3.2.2).
const GAMMA_2_2: u32 = 45_455;
/// gAMA of linear values.
const LINEAR: u32 = 100_000;

/// Writes a picture: 8 bit as gamma 2.2, 16 bit as linear. There is no sRGB chunk, which would overrule the gamma.
///
/// `text` contains keywords and texts for the file's metadata (a keyword has 1 to 79 Latin-1 characters). The same
/// picture and texts give the same bytes.
///
/// # Errors
/// Those of the file system, a picture without pixels, a keyword that PNG cannot hold. An existing file stays as it was.
pub fn write_png(path: &Path, picture: Picture<'_>, text: &[(&str, &str)]) -> io::Result<()> {
    write_atomically(path, |file| encode(file, picture, text))
}

/// The bytes of a PNG file of a picture, without metadata.
///
/// # Errors
/// A picture without pixels.
pub fn png_bytes(picture: Picture<'_>) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    encode(&mut bytes, picture, &[])?;
    Ok(bytes)
}

/// A picture as a `data:` address, for a page that needs no other file.
///
/// # Errors
/// A picture without pixels.
pub fn data_uri(picture: Picture<'_>) -> io::Result<String> {
    use base64::Engine;
    let bytes = png_bytes(picture)?;
    Ok(format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(&bytes)))
}

fn encode(file: impl Write, picture: Picture<'_>, text: &[(&str, &str)]) -> io::Result<()> {
    let (width, height) = picture.size();
    let mut encoder = Encoder::new(file, width, height);
    let (color, depth, gamma) = match picture {
        Picture::Gray8(_) => (ColorType::Grayscale, BitDepth::Eight, GAMMA_2_2),
        Picture::Rgb8(_) => (ColorType::Rgb, BitDepth::Eight, GAMMA_2_2),
        Picture::Gray16(_) => (ColorType::Grayscale, BitDepth::Sixteen, LINEAR),
        Picture::Rgb16(_) => (ColorType::Rgb, BitDepth::Sixteen, LINEAR),
    };
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_source_gamma(ScaledFloat::from_scaled(gamma));
    // Noise does not compress, so that a higher level costs time without effect.
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Up);
    for &(keyword, text) in text {
        let (keyword, text) = (keyword.to_string(), text.to_string());
        let added = match text.is_ascii() {
            true => encoder.add_text_chunk(keyword, text),
            false => encoder.add_itxt_chunk(keyword, text),
        };
        added.map_err(explain)?;
    }
    let mut writer = encoder.write_header().map_err(explain)?;
    match picture {
        Picture::Gray8(p) => writer.write_image_data(p.data()),
        Picture::Rgb8(p) => writer.write_image_data(p.data().as_flattened()),
        Picture::Gray16(p) => writer.write_image_data(&big_endian(p.data())),
        Picture::Rgb16(p) => writer.write_image_data(&big_endian(p.data().as_flattened())),
    }
    .map_err(explain)?;
    writer.finish().map_err(explain)
}

fn big_endian(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_be_bytes()).collect()
}

fn explain(error: EncodingError) -> io::Error {
    match error {
        EncodingError::IoError(e) => e,
        other => io::Error::new(io::ErrorKind::InvalidInput, other.to_string()),
    }
}
