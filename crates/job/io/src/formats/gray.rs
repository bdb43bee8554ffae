//! Reads frames of grey values in their stored depth: 8 or 16 bits, never scaled.

use std::path::Path;

use dunkelfeld_film::Plane;
use dunkelfeld_scene::Texels;
use image::ImageFormat;

use crate::error::InputError;
use crate::images::{ImageFault, decode_image};
use crate::input::{InputFiles, Role};
use crate::loader::Limits;

/// A frame and its stored depth.
#[derive(Clone, Debug, PartialEq)]
pub struct GrayFrame {
    /// Grey values \[DN\]; those of 8 bits are widened, not scaled.
    pub values: Plane<u16>,
    /// Bits per value in the file: 8 or 16.
    pub stored_bits: u32,
}

/// Reads a frame: PNG, TIFF or BMP with one channel, or with three that are equal everywhere.
///
/// # Errors
/// The file cannot be read, is no such image, or is coloured.
pub fn read_gray(path: &Path, limits: &Limits) -> Result<GrayFrame, InputError> {
    let bytes = InputFiles::new().read(path, Role::Frame, limits.file_bytes).map_err(|fault| fault.at(path))?;
    decode(&bytes, limits).map_err(|fault| fault.at(path, "frame"))
}

const READABLE: &str = "save the frame as grey PNG or TIFF with 8 or 16 bits, right-aligned";

fn decode(bytes: &[u8], limits: &Limits) -> Result<GrayFrame, ImageFault> {
    let fault = |problem: &str, help: &str| ImageFault { problem: problem.into(), help: help.into() };
    match image::guess_format(bytes) {
        Ok(ImageFormat::Png | ImageFormat::Tiff | ImageFormat::Bmp) => {}
        Ok(ImageFormat::Jpeg | ImageFormat::WebP) => {
            return Err(fault("the frame was compressed with losses, which changes its noise", READABLE));
        }
        _ => return Err(fault("the bytes are no PNG, TIFF or BMP", READABLE)),
    }
    let image = decode_image(bytes, "", limits)?.image;
    let values = match &*image.texels {
        Texels::Gray8(texels) => Some(texels.iter().map(|[g]| u16::from(*g)).collect()),
        Texels::Gray16(texels) => Some(texels.as_flattened().to_vec()),
        Texels::GrayAlpha8(texels) => Some(texels.iter().map(|[g, _]| u16::from(*g)).collect()),
        Texels::GrayAlpha16(texels) => Some(texels.iter().map(|[g, _]| *g).collect()),
        Texels::Rgb8(texels) => grey(texels.iter().map(|rgb| rgb.map(u16::from))),
        Texels::Rgb16(texels) => grey(texels.iter().copied()),
        Texels::Rgba8(texels) => grey(texels.iter().map(|[r, g, b, _]| [*r, *g, *b].map(u16::from))),
        Texels::Rgba16(texels) => grey(texels.iter().map(|[r, g, b, _]| [*r, *g, *b])),
        Texels::GrayF32(_) | Texels::RgbF32(_) => {
            return Err(fault("the values are floating-point numbers", READABLE));
        }
    };
    let help = "use raw frames, one data set for each channel of the colour filter";
    let values = values.ok_or_else(|| fault("the frame is coloured", help))?;
    let stored_bits = 8 * image.texels.value_bytes() as u32;
    let values = Plane::from_vec(image.width, image.height, values);
    Ok(GrayFrame { values: values.ok_or_else(|| fault("the image is incomplete", READABLE))?, stored_bits })
}

/// The one value of pixels whose channels are equal.
fn grey(pixels: impl Iterator<Item = [u16; 3]>) -> Option<Vec<u16>> {
    pixels.map(|[r, g, b]| (r == g && g == b).then_some(r)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Picture;
    use crate::png::write_png;
    use crate::tiff::write_tiff;

    #[test]
    fn values_come_back_as_they_were_whatever_holds_them() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let wide = Plane::from_fn(5, 3, |x, y| (4000 + 20 * x + y) as u16);
        let narrow = Plane::from_fn(5, 3, |x, y| (10 * x + y) as u8);
        let at = |name: &str| folder.path().join(name);
        write_png(&at("a.png"), Picture::Gray16(&wide), &[]).expect("written");
        write_tiff(&at("a.tif"), Picture::Gray16(&wide), None).expect("written");
        write_png(&at("b.png"), Picture::Gray8(&narrow), &[]).expect("written");
        let triple = narrow.map(|v| [*v; 3]);
        write_tiff(&at("c.tif"), Picture::Rgb8(&triple), None).expect("written");
        for (name, bits) in [("a.png", 16), ("a.tif", 16), ("b.png", 8), ("c.tif", 8)] {
            let frame = read_gray(&at(name), &Limits::default()).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(frame.stored_bits, bits, "{name}");
            let expected = if bits == 16 { wide.clone() } else { narrow.map(|v| u16::from(*v)) };
            assert_eq!(frame.values, expected, "{name}");
        }
    }

    #[test]
    fn files_without_a_frame_are_refused_with_help() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| folder.path().join(name);
        write_png(&at("c.png"), Picture::Rgb8(&Plane::new(2, 2, [1, 2, 3])), &[]).expect("written");
        std::fs::write(at("t.png"), "not an image").expect("written");
        std::fs::write(at("j.png"), [0xff, 0xd8, 0xff, 0xe0, 0, 16, b'J', b'F', b'I', b'F']).expect("written");
        for (name, problem) in [("c.png", "coloured"), ("t.png", "no PNG"), ("j.png", "losses"), ("no.png", "")] {
            let error = read_gray(&at(name), &Limits::default()).expect_err(name);
            assert!(error.to_string().contains(problem) && error.to_string().contains(name), "{error}");
        }
    }
}
