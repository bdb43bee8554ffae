//! Decodes images of any supported format within limits, and reads environment maps.

use crate::error::{ImportWarning, InputError};
use crate::input::{InputFiles, Role};
use crate::loader::Limits;
use dunkelfeld_scene::{Image, Texels};
use exr::prelude::{ReadChannels as _, ReadLayers as _};
use image::{DynamicImage, ImageFormat, ImageReader};
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

const READABLE: &str = "save the image as PNG, JPEG, TIFF, WebP, BMP, TGA, HDR or EXR";

/// A decoded image, and how many of its texels were not finite numbers at or above zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// The image.
    pub image: Image,
    /// Texels of a floating-point image that were NaN, infinite or negative; they were set to 0, or for +infinity to
    /// the largest finite half-float, 65 504.
    pub repaired: usize,
}

/// Why an image could not be decoded: what is wrong, and the mend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageFault {
    /// What is wrong, without a full stop.
    pub problem: String,
    /// What the user can do about it, without a full stop.
    pub mend: String,
}

impl ImageFault {
    fn new(problem: impl Into<String>, mend: impl Into<String>) -> Self {
        Self { problem: problem.into(), mend: mend.into() }
    }

    /// The fault as an error of `file` at `place`.
    pub fn at(self, file: &Path, place: impl Into<String>) -> InputError {
        InputError::new(file, place, self.problem, self.mend)
    }
}

/// Decodes PNG, JPEG, TIFF, WebP, BMP, TGA, Radiance HDR or OpenEXR. The bytes decide which; the extension of `name` is
/// asked only for TGA, which has no signature.
///
/// 8-bit images become `Rgba8`, 16-bit ones `Rgba16`, floating-point ones `RgbF32`; grey is spread over the channels.
/// Values are left as stored: what they mean (sRGB, linear) is up to the texture that uses them.
///
/// # Errors
/// If the bytes are no image, are broken, or exceed `limits` (which are checked on the header).
pub fn decode_image(bytes: &[u8], name: &str, limits: &Limits) -> Result<Decoded, ImageFault> {
    // The decoders are other people's and read hostile bytes: a panic in one of them must not be ours.
    catch_unwind(AssertUnwindSafe(|| decode_unguarded(bytes, name, limits)))
        .unwrap_or_else(|_| Err(ImageFault::new("the decoder gave up on the image", "save the image again as PNG")))
}

/// Reads an equirectangular environment map (HDR or EXR; 8- and 16-bit images are decoded as they are) from any place:
/// the path comes from the user, not from a scene file.
///
/// # Errors
/// If the file cannot be read or decoded within `limits`.
pub fn load_environment(path: &Path, limits: &Limits) -> Result<(Image, Vec<ImportWarning>), InputError> {
    let bytes = InputFiles::new().read(path, Role::Environment, limits.file_bytes).map_err(|fault| fault.at(path))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let decoded = decode_image(&bytes, &name, limits).map_err(|fault| fault.at(path, "environment image"))?;
    let mut warnings = Vec::new();
    if decoded.repaired > 0 {
        warnings.push(ImportWarning { place: name.into_owned(), message: repair_message(decoded.repaired) });
    }
    Ok((decoded.image, warnings))
}

/// The warning for an image with repaired texels.
pub(crate) fn repair_message(texels: usize) -> String {
    format!("{texels} texels were negative, infinite or not a number and have been set to 0 (infinite ones to 65504)")
}

/// Bytes that an image occupies in memory.
pub(crate) fn image_bytes(image: &Image) -> u64 {
    let texel = match image.texels {
        Texels::Rgba8(_) => 4,
        Texels::Rgba16(_) => 8,
        Texels::RgbF32(_) => 12,
    };
    u64::from(image.width) * u64::from(image.height) * texel
}

fn decode_unguarded(bytes: &[u8], name: &str, limits: &Limits) -> Result<Decoded, ImageFault> {
    const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
    if bytes.is_empty() {
        return Err(ImageFault::new("the image is empty", "save the image again"));
    }
    if bytes.starts_with(&EXR_MAGIC) {
        return decode_exr(bytes, name, limits);
    }
    if let Some(what) = foreign_format(bytes) {
        return Err(ImageFault::new(what, READABLE));
    }
    let format = image::guess_format(bytes).ok().or_else(|| {
        let is_tga = Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case("tga"));
        is_tga.then_some(ImageFormat::Tga)
    });
    let Some(format) = format else {
        return Err(ImageFault::new("the bytes are no image of a known format", READABLE));
    };
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut bounds = image::Limits::default();
    bounds.max_image_width = Some(limits.image_side);
    bounds.max_image_height = Some(limits.image_side);
    bounds.max_alloc = Some(limits.image_bytes);
    reader.limits(bounds);
    let decoded = reader.decode().map_err(|e| match e {
        image::ImageError::Limits(_) => too_large(limits),
        image::ImageError::Unsupported(_) => {
            ImageFault::new(format!("the image uses what cannot be read: {e}"), "save it as plain PNG, JPEG or EXR")
        }
        _ => ImageFault::new(format!("the image is broken: {e}"), "save the image again"),
    })?;
    let (width, height) = (decoded.width(), decoded.height());
    check_size(width as usize, height as usize, 4, limits)?;
    let mut repaired = 0;
    let texels = match decoded {
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => {
            check_size(width as usize, height as usize, 8, limits)?;
            Texels::Rgba16(decoded.into_rgba16().pixels().map(|p| p.0).collect())
        }
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            check_size(width as usize, height as usize, 12, limits)?;
            let mut texels: Vec<[f32; 3]> = decoded.into_rgb32f().pixels().map(|p| p.0).collect();
            repaired = repair(&mut texels);
            Texels::RgbF32(texels)
        }
        other => Texels::Rgba8(other.into_rgba8().pixels().map(|p| p.0).collect()),
    };
    Ok(Decoded { image: Image { name: name.to_owned(), width, height, texels }, repaired })
}

fn decode_exr(bytes: &[u8], name: &str, limits: &Limits) -> Result<Decoded, ImageFault> {
    let broken = |e: exr::error::Error| match e {
        exr::error::Error::NotSupported(what) => {
            ImageFault::new(format!("the EXR uses what cannot be read: {what}"), "save it as flat scan-line RGB")
        }
        other => ImageFault::new(format!("the EXR is broken: {other}"), "save the image again"),
    };
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
    for header in &meta.headers {
        let channels = header.channels.list.len().max(3);
        check_size(header.layer_size.width(), header.layer_size.height(), 4 * channels as u64, limits)?;
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(broken)?;
    let layer = &image.layer_data;
    let channels = &layer.channel_data.list;
    let full = |c: &&exr::prelude::AnyChannel<exr::prelude::FlatSamples>| c.sampling.x() == 1 && c.sampling.y() == 1;
    let find = |wanted: &str| channels.iter().filter(full).find(|c| c.name.eq(wanted));
    let grey = || find("Y").or_else(|| channels.iter().filter(full).find(|_| channels.len() == 1));
    let rgb = match (find("R"), find("G"), find("B")) {
        (Some(r), Some(g), Some(b)) => [r, g, b],
        _ => grey().map(|y| [y; 3]).ok_or_else(|| {
            ImageFault::new("the EXR has neither R, G, B nor Y channels at full resolution", "save it as flat RGB")
        })?,
    };
    let (width, height) = (layer.size.width(), layer.size.height());
    let mut texels = vec![[0.0_f32; 3]; width * height];
    for (i, channel) in rgb.iter().enumerate() {
        for (texel, value) in texels.iter_mut().zip(channel.sample_data.values_as_f32()) {
            texel[i] = value;
        }
    }
    let repaired = repair(&mut texels);
    // `check_size` has kept both below `image_side`, a u32.
    let image =
        Image { name: name.to_owned(), width: width as u32, height: height as u32, texels: Texels::RgbF32(texels) };
    Ok(Decoded { image, repaired })
}

/// A NaN or a negative radiance would poison every pixel that sees it.
fn repair(texels: &mut [[f32; 3]]) -> usize {
    const LARGEST_HALF: f32 = 65504.0;
    let usable = |v: f32| v.is_finite() && v >= 0.0;
    let mut count = 0;
    for texel in texels.iter_mut().filter(|t| !t.iter().all(|v| usable(*v))) {
        count += 1;
        *texel = texel.map(|v| match v {
            _ if usable(v) => v,
            f32::INFINITY => LARGEST_HALF,
            _ => 0.0,
        });
    }
    count
}

fn check_size(width: usize, height: usize, texel_bytes: u64, limits: &Limits) -> Result<(), ImageFault> {
    if width == 0 || height == 0 {
        return Err(ImageFault::new("the image has no texels", "save the image again"));
    }
    let bytes = (width as u64).saturating_mul(height as u64).saturating_mul(texel_bytes);
    if width.max(height) > limits.image_side as usize || bytes > limits.image_bytes {
        return Err(too_large(limits));
    }
    Ok(())
}

fn too_large(limits: &Limits) -> ImageFault {
    ImageFault::new(
        format!(
            "the image has more than {} texels on a side or needs more than {} MiB",
            limits.image_side,
            limits.image_bytes >> 20
        ),
        "make the image smaller, or raise the import limits",
    )
}

/// Names the formats people really put into scenes.
fn foreign_format(bytes: &[u8]) -> Option<&'static str> {
    let at = |offset: usize, magic: &[u8]| bytes.get(offset..).is_some_and(|b| b.starts_with(magic));
    if at(0, b"\xabKTX 20") {
        Some("this is a KTX2 image, which cannot be read")
    } else if at(0, b"DDS ") {
        Some("this is a DDS image, which cannot be read")
    } else if at(4, b"ftypavif") {
        Some("this is an AVIF image, which cannot be read")
    } else if at(0, b"<svg") || at(0, b"<?xml") {
        Some("this is a vector image, which cannot be read")
    } else if at(0, b"version https://git-lfs") {
        Some("this is a Git LFS pointer, not the image")
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encoded(image: DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).expect("encode");
        bytes.into_inner()
    }

    fn texels(bytes: &[u8], name: &str) -> Texels {
        decode_image(bytes, name, &Limits::default()).expect("decodes").image.texels
    }

    fn exr_file(channels: &[(&str, [f32; 2])]) -> Vec<u8> {
        use exr::prelude::*;
        let list = channels.iter().map(|(name, v)| AnyChannel::new(*name, FlatSamples::F32(v.to_vec()))).collect();
        let mut bytes = Cursor::new(Vec::new());
        Image::from_channels((2, 1), AnyChannels::sort(list)).write().to_buffered(&mut bytes).expect("encode");
        bytes.into_inner()
    }

    #[test]
    fn eight_and_sixteen_bits_keep_their_values_and_grey_is_spread() {
        let rgb = image::RgbImage::from_raw(2, 1, vec![1, 2, 3, 4, 5, 6]).expect("size");
        assert_eq!(
            texels(&encoded(rgb.into(), ImageFormat::Png), "a"),
            Texels::Rgba8(vec![[1, 2, 3, 255], [4, 5, 6, 255]])
        );
        let grey = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(1, 1, vec![12_345_u16]).expect("size");
        let expected = Texels::Rgba16(vec![[12_345, 12_345, 12_345, 65_535]]);
        assert_eq!(texels(&encoded(grey.into(), ImageFormat::Png), "a"), expected);
    }

    #[test]
    fn the_bytes_decide_and_not_the_extension() {
        let image = image::RgbImage::from_pixel(1, 1, image::Rgb([9, 8, 7]));
        for format in [ImageFormat::Png, ImageFormat::Bmp, ImageFormat::Tiff, ImageFormat::WebP] {
            let bytes = encoded(image.clone().into(), format);
            assert_eq!(texels(&bytes, "wrong.jpg"), Texels::Rgba8(vec![[9, 8, 7, 255]]), "{format:?}");
        }
        // TGA has no signature: there the extension helps.
        let tga = encoded(image.into(), ImageFormat::Tga);
        assert_eq!(texels(&tga, "a.TGA"), Texels::Rgba8(vec![[9, 8, 7, 255]]));
        assert!(decode_image(&tga, "a.png", &Limits::default()).is_err());
    }

    #[test]
    fn exr_is_read_by_channel_name() {
        let file = exr_file(&[("R", [1.0, 2.0]), ("G", [3.0, 4.0]), ("B", [5.0, 6.0]), ("Z", [7.0, 8.0])]);
        assert_eq!(texels(&file, "a"), Texels::RgbF32(vec![[1.0, 3.0, 5.0], [2.0, 4.0, 6.0]]));
        let grey = exr_file(&[("Y", [0.25, 0.5]), ("A", [1.0, 1.0])]);
        assert_eq!(texels(&grey, "a"), Texels::RgbF32(vec![[0.25; 3], [0.5; 3]]));
        let fault = decode_image(&exr_file(&[("U", [0.0; 2]), ("V", [0.0; 2])]), "a", &Limits::default());
        assert!(fault.expect_err("no colour").problem.contains("R, G, B"));
    }

    #[test]
    fn values_that_are_no_radiance_are_repaired_and_counted() {
        let file = exr_file(&[("R", [f32::NAN, 1.0]), ("G", [-1.0, 2.0]), ("B", [f32::INFINITY, 3.0])]);
        let decoded = decode_image(&file, "a", &Limits::default()).expect("decodes");
        assert_eq!(decoded.image.texels, Texels::RgbF32(vec![[0.0, 0.0, 65504.0], [1.0, 2.0, 3.0]]));
        assert_eq!(decoded.repaired, 1);
    }

    #[test]
    fn environments_come_from_anywhere_as_floats() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let hdr = image::Rgb32FImage::from_pixel(2, 1, image::Rgb([0.5, 2.0, 64.0]));
        let path = folder.path().join("sky.hdr");
        std::fs::write(&path, encoded(hdr.into(), ImageFormat::Hdr)).expect("write");
        let (image, warnings) = load_environment(&path, &Limits::default()).expect("loads");
        assert_eq!((image.name.as_str(), image.width, image.height), ("sky.hdr", 2, 1));
        // Shared exponent, eight bits of mantissa: 64 and 2 are exact to 1 / 256 of the largest channel.
        let Texels::RgbF32(texels) = image.texels else { panic!("floats were expected") };
        assert!(texels[0].iter().zip([0.5, 2.0, 64.0]).all(|(a, b)| (a - b).abs() <= 0.25), "{texels:?}");
        assert!(warnings.is_empty());
        let missing = load_environment(&folder.path().join("none.hdr"), &Limits::default());
        assert!(missing.expect_err("missing").problem.contains("no file"));
    }

    #[test]
    fn limits_are_checked_on_the_header() {
        let png = encoded(image::RgbImage::new(64, 8).into(), ImageFormat::Png);
        let file = exr_file(&[("Y", [0.0; 2])]);
        for limits in [Limits { image_side: 1, ..Limits::default() }, Limits { image_bytes: 8, ..Limits::default() }] {
            for bytes in [&png, &file] {
                let fault = decode_image(bytes, "a", &limits).expect_err("too large");
                assert!(fault.problem.contains("more than"), "{fault:?}");
            }
        }
    }

    #[test]
    fn damaged_images_end_in_an_error_or_an_image() {
        let png = encoded(image::RgbImage::new(8, 8).into(), ImageFormat::Png);
        let jpeg = encoded(image::RgbImage::new(8, 8).into(), ImageFormat::Jpeg);
        let exr = exr_file(&[("R", [1.0, 2.0]), ("G", [3.0, 4.0]), ("B", [5.0, 6.0])]);
        let limits = Limits { image_side: 4096, image_bytes: 1 << 24, ..Limits::default() };
        for file in [png, jpeg, exr] {
            for length in 0..file.len() {
                let mut flipped = file.clone();
                flipped[length] ^= 0x55;
                for bytes in [&file[..length], &flipped] {
                    match decode_image(bytes, "a.png", &limits) {
                        Ok(decoded) => assert!(decoded.image.width > 0 && image_bytes(&decoded.image) <= 1 << 24),
                        Err(fault) => assert!(!fault.problem.is_empty() && !fault.mend.is_empty()),
                    }
                }
            }
        }
    }

    #[test]
    fn formats_that_cannot_be_read_are_named() {
        for (bytes, word) in
            [(&b"\xabKTX 20\xbb"[..], "KTX2"), (b"DDS |", "DDS"), (b"nonsense", "no image"), (b"", "empty")]
        {
            let fault = decode_image(bytes, "a.png", &Limits::default()).expect_err("no image");
            assert!(fault.problem.contains(word), "{fault:?}");
        }
    }
}
