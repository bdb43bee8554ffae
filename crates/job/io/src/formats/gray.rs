//! Reads frames of grey values in their stored depth: 8 or 16 bits, never scaled.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use dunkelfeld_film::Plane;
use image::{DynamicImage, ImageFormat, ImageReader};

use crate::error::InputError;
use crate::images::ImageFault;
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
    // The decoders are third-party code on arbitrary bytes. A panic in one of them becomes an error.
    let decoded = catch_unwind(AssertUnwindSafe(|| decode(&bytes, limits)))
        .unwrap_or_else(|_| Err(fault("the decoder cannot read the image", "save the frame again as 16-bit PNG")));
    decoded.map_err(|f| f.at(path, "frame"))
}

fn fault(problem: impl Into<String>, help: impl Into<String>) -> ImageFault {
    ImageFault { problem: problem.into(), help: help.into() }
}

const READABLE: &str = "save the frame as grey PNG or TIFF with 8 or 16 bits, right-aligned";

fn decode(bytes: &[u8], limits: &Limits) -> Result<GrayFrame, ImageFault> {
    let format = match image::guess_format(bytes) {
        Ok(f @ (ImageFormat::Png | ImageFormat::Tiff | ImageFormat::Bmp)) => f,
        Ok(ImageFormat::Jpeg | ImageFormat::WebP) => {
            return Err(fault("the frame was compressed with losses, which changes its noise", READABLE));
        }
        _ => return Err(fault("the bytes are no PNG, TIFF or BMP", READABLE)),
    };
    let mut reader = ImageReader::with_format(std::io::Cursor::new(bytes), format);
    let mut bounds = image::Limits::default();
    bounds.max_image_width = Some(limits.image_side);
    bounds.max_image_height = Some(limits.image_side);
    bounds.max_alloc = Some(limits.image_bytes);
    reader.limits(bounds);
    let image = reader
        .decode()
        .map_err(|e| fault(format!("the image is broken or uses what cannot be read: {e}"), READABLE))?;
    let (width, height) = (image.width(), image.height());
    if width == 0 || height == 0 {
        return Err(fault("the image has no pixels", "save the frame again"));
    }
    let colored =
        || fault("the frame is coloured", "use raw frames, one data set for each channel of the colour filter");
    let wide = |v: Vec<u8>| -> Vec<u16> { v.into_iter().map(u16::from).collect() };
    let (values, stored_bits) = match image {
        DynamicImage::ImageLuma8(i) => (wide(i.into_raw()), 8),
        DynamicImage::ImageLuma16(i) => (i.into_raw(), 16),
        DynamicImage::ImageLumaA8(i) => (i.pixels().map(|p| p.0[0].into()).collect(), 8),
        DynamicImage::ImageLumaA16(i) => (i.pixels().map(|p| p.0[0]).collect(), 16),
        DynamicImage::ImageRgb8(_) | DynamicImage::ImageRgba8(_) => {
            (grey(image.into_rgb8().pixels().map(|p| p.0.map(u16::from))).ok_or_else(colored)?, 8)
        }
        DynamicImage::ImageRgb16(_) | DynamicImage::ImageRgba16(_) => {
            (grey(image.into_rgb16().pixels().map(|p| p.0)).ok_or_else(colored)?, 16)
        }
        _ => return Err(fault("the values are floating-point numbers", READABLE)),
    };
    let values =
        Plane::from_vec(width, height, values).ok_or_else(|| fault("the image is incomplete", "save it again"))?;
    Ok(GrayFrame { values, stored_bits })
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
