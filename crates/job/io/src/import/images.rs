//! Decodes images of any supported format within limits, and reads environment maps.

use crate::error::{ImportWarning, InputError};
use crate::exr::{ExrFrame, blocks};
use crate::import::texel_budget::TexelBudget;
use crate::input::{InputFiles, Role};
use crate::loader::Limits;
use bytemuck::Pod;
use dunkelfeld_scene::{Image, Texels};
use exr::prelude::{AnyChannel, ChannelDescription, FlatSamples, ReadChannels as _};
use image::codecs::hdr::HdrDecoder;
use image::{ColorType, ImageDecoder, ImageFormat, ImageReader};
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

/// The reason for an image that could not be decoded, and the help.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageFault {
    /// The fault, without a full stop.
    pub problem: String,
    /// The help: a correction by the user, without a full stop.
    pub help: String,
}

impl ImageFault {
    fn new(problem: impl Into<String>, help: impl Into<String>) -> Self {
        Self { problem: problem.into(), help: help.into() }
    }

    /// The fault as an error of `file` at `place`.
    pub fn at(self, file: &Path, place: impl Into<String>) -> InputError {
        InputError::new(file, place, self.problem, self.help)
    }
}

/// The storage of an image after decoding, from its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageHeader {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// Stored channels, 1 to 4.
    pub channels: u8,
    /// Bytes of a value: 1, 2, or 4 for floating point.
    pub value_bytes: u8,
}

impl ImageHeader {
    /// Bytes of all texels.
    pub fn bytes(&self) -> u64 {
        let texels = u64::from(self.width) * u64::from(self.height);
        texels.saturating_mul(u64::from(self.channels) * u64::from(self.value_bytes))
    }
}

impl std::fmt::Display for ImageHeader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let plural = if self.channels == 1 { "" } else { "s" };
        let Self { width, height, channels, value_bytes } = self;
        write!(f, "{width} x {height}, {channels} channel{plural} of {} bits", 8 * value_bytes)
    }
}

/// Reads the header of an image: of the formats that [`decode_image`] decodes, and with its rules.
///
/// # Errors
/// If the bytes are no image, the header is broken, or the size exceeds `limits`.
pub fn image_header(bytes: &[u8], name: &str, limits: &Limits) -> Result<ImageHeader, ImageFault> {
    guarded(|| open(bytes, name, limits).map(|opened| opened.header))
}

/// Decodes PNG, JPEG, TIFF, WebP, BMP, TGA, Radiance HDR or OpenEXR. The bytes determine the format. The extension of
/// `name` is used only for TGA, which has no signature.
///
/// Bit depth and channels remain as in the file: 1 to 4 channels of 8 or 16 bits (fewer bits become 8, palettes become
/// red, green, blue), grey or three channels of floating point, whose alpha is dropped. Values are not converted. The
/// texture that uses them defines their encoding (sRGB, linear). An EXR is cut to its display window, and the values of
/// a Radiance HDR are divided by its EXPOSURE and COLORCORR. No second copy of the texels is made here.
///
/// # Errors
/// If the bytes are no image, are broken, or exceed `limits` (which are checked on the header).
pub fn decode_image(bytes: &[u8], name: &str, limits: &Limits) -> Result<Decoded, ImageFault> {
    guarded(|| open(bytes, name, limits)?.decode(bytes, name))
}

/// The decoders are third-party code on hostile bytes. A panic in one of them becomes an error.
fn guarded<T>(read: impl FnOnce() -> Result<T, ImageFault>) -> Result<T, ImageFault> {
    catch_unwind(AssertUnwindSafe(read))
        .unwrap_or_else(|_| Err(ImageFault::new("the decoder cannot read the image", "save the image again as PNG")))
}

/// Reads an image of a job in its role, the environment or a texture, from any folder: the path comes from the user, not from a
/// scene file. `beside` contains the images of the scene. The limit on all
/// images together includes them.
///
/// # Errors
/// If the file cannot be read or decoded within `limits`.
pub fn load_image(
    path: &Path,
    role: Role,
    limits: &Limits,
    beside: &[Image],
) -> Result<(Image, Vec<ImportWarning>), InputError> {
    let bytes = InputFiles::new().read(path, role, limits.file_bytes).map_err(|fault| fault.at(path))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let header = image_header(&bytes, &name, &limits.of_header()).map_err(|f| f.at(path, role.name()))?;
    let mut budget = TexelBudget::new(limits, beside);
    budget.add(role.name(), &header);
    budget.check(path)?;
    let decoded = decode_image(&bytes, &name, limits).map_err(|fault| fault.at(path, role.name()))?;
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

/// An image with a header that was read and is within the limits.
struct Opened<'a> {
    header: ImageHeader,
    decoder: Decoder<'a>,
}

enum Decoder<'a> {
    Exr(Colors, Option<ExrFrame>),
    /// With the factor of each channel.
    Hdr(Box<dyn ImageDecoder + 'a>, [f32; 3]),
    Other(Box<dyn ImageDecoder + 'a>),
}

/// The used channels of an EXR, by their index in its list.
enum Colors {
    Rgb([usize; 3]),
    Gray(usize),
}

fn open<'a>(bytes: &'a [u8], name: &str, limits: &Limits) -> Result<Opened<'a>, ImageFault> {
    const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
    if bytes.is_empty() {
        return Err(ImageFault::new("the image is empty", "save the image again"));
    }
    if bytes.starts_with(&EXR_MAGIC) {
        return open_exr(bytes, limits);
    }
    if let Some(what) = foreign_format(bytes) {
        return Err(ImageFault::new(what, READABLE));
    }
    if bytes.starts_with(b"#?RADIANCE") || bytes.starts_with(b"#?RGBE") {
        return open_hdr(bytes, limits);
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
    let decoder = reader.into_decoder().map_err(|e| broken_image(&e, limits))?;
    let color = decoder.color_type();
    let value_bytes = color.bytes_per_pixel() / color.channel_count();
    // Alpha of floating point is dropped.
    let channels = if value_bytes == 4 { 3 } else { color.channel_count() };
    let (width, height) = decoder.dimensions();
    let header = ImageHeader { width, height, channels, value_bytes };
    check_size(width as usize, height as usize, u64::from(color.bytes_per_pixel()), limits)?;
    Ok(Opened { header, decoder: Decoder::Other(Box::new(decoder)) })
}

fn broken_image(e: &image::ImageError, limits: &Limits) -> ImageFault {
    match e {
        image::ImageError::Limits(_) => too_large(limits),
        image::ImageError::Unsupported(_) => {
            ImageFault::new(format!("the image uses what cannot be read: {e}"), "save it as plain PNG, JPEG or EXR")
        }
        _ => ImageFault::new(format!("the image is broken: {e}"), "save the image again"),
    }
}

fn broken_exr(e: exr::error::Error) -> ImageFault {
    match e {
        exr::error::Error::NotSupported(what) => {
            let help = "save it as flat scan-line RGB with ZIP compression";
            ImageFault::new(format!("the EXR uses what cannot be read: {what}"), help)
        }
        other => ImageFault::new(format!("the EXR is broken: {other}"), "save the image again"),
    }
}

/// The lines EXPOSURE and COLORCORR contain the factors that the values were multiplied by (Ward 1991).
fn open_hdr<'a>(bytes: &'a [u8], limits: &Limits) -> Result<Opened<'a>, ImageFault> {
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(|e| broken_image(&e, limits))?;
    let meta = decoder.metadata();
    check_size(meta.width as usize, meta.height as usize, 12, limits)?;
    let exposure = meta.exposure.unwrap_or(1.0);
    let (r, g, b) = meta.color_correction.unwrap_or((1.0, 1.0, 1.0));
    let factors = [r, g, b].map(|v| 1.0 / (v * exposure));
    if !factors.iter().all(|v| *v > 0.0 && v.is_finite()) {
        let problem = format!("its header has EXPOSURE {exposure} and COLORCORR {r} {g} {b}, which are not above 0");
        return Err(ImageFault::new(problem, "correct or remove these lines of the header"));
    }
    let header = ImageHeader { width: meta.width, height: meta.height, channels: 3, value_bytes: 4 };
    Ok(Opened { header, decoder: Decoder::Hdr(Box::new(decoder), factors) })
}

fn open_exr<'a>(bytes: &'a [u8], limits: &Limits) -> Result<Opened<'a>, ImageFault> {
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken_exr)?;
    for header in &meta.headers {
        let channels = header.channels.list.len().max(3);
        for size in [header.layer_size, header.shared_attributes.display_window.size] {
            check_size(size.width(), size.height(), 4 * channels as u64, limits)?;
        }
    }
    let deep = || ImageFault::new("the EXR has no flat layer", "save it as flat scan-line RGB");
    let layer = meta.headers.iter().find(|h| !h.deep).ok_or_else(deep)?;
    let colors = colors_of(&layer.channels.list)?;
    let frame = ExrFrame::of_header(layer);
    if let Some((problem, help)) = frame.and_then(|frame| frame.other_primaries()) {
        return Err(ImageFault::new(format!("the EXR cannot be used: {problem}"), help));
    }
    // `check_size` has kept both below `image_side`, a u32.
    let display = layer.shared_attributes.display_window.size;
    let (width, height) = (display.width() as u32, display.height() as u32);
    let channels = if matches!(colors, Colors::Rgb(_)) { 3 } else { 1 };
    let header = ImageHeader { width, height, channels, value_bytes: 4 };
    Ok(Opened { header, decoder: Decoder::Exr(colors, frame) })
}

/// Selects by name, among the channels at full resolution: R, G and B, else Y, else the only one.
fn colors_of(channels: &[ChannelDescription]) -> Result<Colors, ImageFault> {
    let full = |c: &ChannelDescription| c.sampling.x() == 1 && c.sampling.y() == 1;
    let find = |wanted: &str| channels.iter().position(|c| full(c) && c.name.eq(wanted));
    let only = || (channels.len() == 1 && channels.first().is_some_and(full)).then_some(0);
    match (find("R"), find("G"), find("B")) {
        (Some(r), Some(g), Some(b)) => Ok(Colors::Rgb([r, g, b])),
        _ => find("Y").or_else(only).map(Colors::Gray).ok_or_else(|| {
            ImageFault::new("the EXR has neither R, G, B nor Y channels at full resolution", "save it as flat RGB")
        }),
    }
}

impl Opened<'_> {
    fn decode(self, bytes: &[u8], name: &str) -> Result<Decoded, ImageFault> {
        let ImageHeader { width, height, .. } = self.header;
        let count = width as usize * height as usize;
        let mut texels = match self.decoder {
            Decoder::Exr(colors, frame) => decode_exr(bytes, &colors, frame, count)?,
            Decoder::Hdr(decoder, factors) => {
                let mut texels: Vec<[f32; 3]> = read(decoder, count)?;
                texels.iter_mut().for_each(|texel| (0..3).for_each(|c| texel[c] *= factors[c]));
                Texels::RgbF32(texels)
            }
            Decoder::Other(decoder) => match decoder.color_type() {
                ColorType::L8 => Texels::Gray8(read(decoder, count)?),
                ColorType::La8 => Texels::GrayAlpha8(read(decoder, count)?),
                ColorType::Rgb8 => Texels::Rgb8(read(decoder, count)?),
                ColorType::Rgba8 => Texels::Rgba8(read(decoder, count)?),
                ColorType::L16 => Texels::Gray16(read(decoder, count)?),
                ColorType::La16 => Texels::GrayAlpha16(read(decoder, count)?),
                ColorType::Rgb16 => Texels::Rgb16(read(decoder, count)?),
                ColorType::Rgba16 => Texels::Rgba16(read(decoder, count)?),
                ColorType::Rgb32F => Texels::RgbF32(read(decoder, count)?),
                // The texels are collected in place: the vector shrinks, and no second one is made.
                _ => {
                    Texels::RgbF32(read(decoder, count)?.into_iter().map(|[r, g, b, _]: [f32; 4]| [r, g, b]).collect())
                }
            },
        };
        let repaired = match &mut texels {
            Texels::GrayF32(texels) => repair(texels),
            Texels::RgbF32(texels) => repair(texels),
            _ => 0,
        };
        Ok(Decoded { image: Image { name: name.to_owned(), width, height, texels: texels.into() }, repaired })
    }
}

/// Decodes directly into the stored texels.
fn read<T: Pod, const N: usize>(decoder: Box<dyn ImageDecoder + '_>, count: usize) -> Result<Vec<[T; N]>, ImageFault> {
    let mut texels = allocate([T::zeroed(); N], count)?;
    decoder
        .read_image_boxed(bytemuck::cast_slice_mut(texels.as_flattened_mut()))
        .map_err(|e| broken_image(&e, &Limits::default()))?;
    Ok(texels)
}

/// `count` texels, or an error if there is not enough memory.
fn allocate<T: Copy>(texel: T, count: usize) -> Result<Vec<T>, ImageFault> {
    let mut texels = Vec::new();
    texels.try_reserve_exact(count).map_err(|_| {
        let mib = count.saturating_mul(size_of::<T>()) >> 20;
        ImageFault::new(format!("there is not enough memory for the {mib} MiB of the image"), "make the image smaller")
    })?;
    texels.resize(count, texel);
    Ok(texels)
}

fn decode_exr(bytes: &[u8], colors: &Colors, frame: Option<ExrFrame>, count: usize) -> Result<Texels, ImageFault> {
    let layers = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let image = blocks::decode(Cursor::new(bytes), &layers).map_err(broken_exr)?;
    let size = [image.layer_data.size.0, image.layer_data.size.1];
    let channels = image.layer_data.channel_data.list;
    let values = |i: usize| {
        let missing = || ImageFault::new("the EXR's channels are not those of its header", "save the image again");
        let channel: &AnyChannel<FlatSamples> = channels.get(i).ok_or_else(missing)?;
        let values = channel.sample_data.values_as_f32();
        Ok::<Box<dyn Iterator<Item = f32>>, ImageFault>(match frame {
            Some(frame) => Box::new(frame.displayed(&values.collect::<Vec<_>>(), size).into_iter()),
            None => Box::new(values),
        })
    };
    match colors {
        Colors::Gray(y) => {
            let mut texels = allocate([0.0], count)?;
            texels.iter_mut().zip(values(*y)?).for_each(|(texel, value)| *texel = [value]);
            Ok(Texels::GrayF32(texels))
        }
        Colors::Rgb(places) => {
            let mut texels = allocate([0.0; 3], count)?;
            for (c, place) in places.iter().enumerate() {
                texels.iter_mut().zip(values(*place)?).for_each(|(texel, value)| texel[c] = value);
            }
            Ok(Texels::RgbF32(texels))
        }
    }
}

/// A NaN or a negative radiance would make every pixel with this texel invalid.
fn repair<const N: usize>(texels: &mut [[f32; N]]) -> usize {
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

/// Formats in scenes that are not read: the place of their signature, and the signature.
const FOREIGN: [(usize, &[u8], &str); 6] = [
    (0, b"\xabKTX 20", "this is a KTX2 image, which cannot be read"),
    (0, b"DDS ", "this is a DDS image, which cannot be read"),
    (4, b"ftypavif", "this is an AVIF image, which cannot be read"),
    (0, b"<svg", "this is a vector image, which cannot be read"),
    (0, b"<?xml", "this is a vector image, which cannot be read"),
    (0, b"version https://git-lfs", "this is a Git LFS pointer, not the image"),
];

fn foreign_format(bytes: &[u8]) -> Option<&'static str> {
    let is = |at: usize, magic: &[u8]| bytes.get(at..).is_some_and(|bytes| bytes.starts_with(magic));
    FOREIGN.into_iter().find(|(at, magic, _)| is(*at, magic)).map(|(.., what)| what)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::DynamicImage;

    fn encoded(image: DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).expect("encode");
        bytes.into_inner()
    }

    fn texels(bytes: &[u8], name: &str) -> Texels {
        (*decode_image(bytes, name, &Limits::default()).expect("decodes").image.texels).clone()
    }

    fn exr_file(channels: &[(&str, [f32; 2])]) -> Vec<u8> {
        use exr::prelude::*;
        let list = channels.iter().map(|(name, v)| AnyChannel::new(*name, FlatSamples::F32(v.to_vec()))).collect();
        let mut bytes = Cursor::new(Vec::new());
        Image::from_channels((2, 1), AnyChannels::sort(list)).write().to_buffered(&mut bytes).expect("encode");
        bytes.into_inner()
    }

    #[test]
    fn bit_depth_and_channels_stay_as_the_file_has_them() {
        fn png<P>(values: &[P::Subpixel]) -> Vec<u8>
        where
            P: image::PixelWithColorType,
            [P::Subpixel]: image::EncodableLayout,
        {
            let mut bytes = Cursor::new(Vec::new());
            let channels = P::CHANNEL_COUNT as usize;
            let width = (values.len() / channels) as u32;
            let image = image::ImageBuffer::<P, _>::from_raw(width, 1, values).expect("size");
            image.write_to(&mut bytes, ImageFormat::Png).expect("encode");
            bytes.into_inner()
        }
        let cases = [
            (png::<image::Luma<u8>>(&[1, 2]), Texels::Gray8(vec![[1], [2]])),
            (png::<image::LumaA<u8>>(&[1, 2, 3, 4]), Texels::GrayAlpha8(vec![[1, 2], [3, 4]])),
            (png::<image::Rgb<u8>>(&[1, 2, 3, 4, 5, 6]), Texels::Rgb8(vec![[1, 2, 3], [4, 5, 6]])),
            (png::<image::Rgba<u8>>(&[1, 2, 3, 4]), Texels::Rgba8(vec![[1, 2, 3, 4]])),
            (png::<image::Luma<u16>>(&[12_345]), Texels::Gray16(vec![[12_345]])),
            (png::<image::LumaA<u16>>(&[12_345, 7]), Texels::GrayAlpha16(vec![[12_345, 7]])),
            (png::<image::Rgb<u16>>(&[1, 2, 60_000]), Texels::Rgb16(vec![[1, 2, 60_000]])),
            (png::<image::Rgba<u16>>(&[1, 2, 3, 60_000]), Texels::Rgba16(vec![[1, 2, 3, 60_000]])),
        ];
        for (bytes, expected) in cases {
            let header = image_header(&bytes, "a", &Limits::default()).expect("a header");
            let decoded = texels(&bytes, "a");
            assert_eq!(decoded, expected);
            assert_eq!((header.bytes(), header.height), (decoded.bytes() as u64, 1), "{header:?}");
            assert_eq!(header.width as usize, decoded.len());
        }
    }

    /// Images of 1, 2 and 4 bits, grey and with a palette.
    #[test]
    fn few_bits_become_eight() {
        for (depth, bits) in [(png::BitDepth::One, 1), (png::BitDepth::Two, 2), (png::BitDepth::Four, 4)] {
            let file = |color: png::ColorType| {
                let mut bytes = Vec::new();
                let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
                encoder.set_color(color);
                encoder.set_depth(depth);
                encoder.set_palette(vec![9, 8, 7, 1, 2, 3]);
                let mut writer = encoder.write_header().expect("header");
                // The first texel is 0, the second 1.
                writer.write_image_data(&[1 << (8 - 2 * bits)]).expect("data");
                drop(writer);
                bytes
            };
            let white = 255 / ((1 << bits) - 1);
            assert_eq!(texels(&file(png::ColorType::Grayscale), "a"), Texels::Gray8(vec![[0], [white]]), "{bits}");
            let colors = Texels::Rgb8(vec![[9, 8, 7], [1, 2, 3]]);
            assert_eq!(texels(&file(png::ColorType::Indexed), "a"), colors, "{bits}");
        }
    }

    #[test]
    fn the_bytes_decide_and_not_the_extension() {
        let image = image::RgbImage::from_pixel(1, 1, image::Rgb([9, 8, 7]));
        for format in [ImageFormat::Png, ImageFormat::Bmp, ImageFormat::Tiff, ImageFormat::WebP] {
            let bytes = encoded(image.clone().into(), format);
            assert_eq!(texels(&bytes, "wrong.jpg"), Texels::Rgb8(vec![[9, 8, 7]]), "{format:?}");
        }
        // TGA has no signature, so the extension is used.
        let tga = encoded(image.into(), ImageFormat::Tga);
        assert_eq!(texels(&tga, "a.TGA"), Texels::Rgb8(vec![[9, 8, 7]]));
        assert!(decode_image(&tga, "a.png", &Limits::default()).is_err());
    }

    #[test]
    fn exr_is_read_by_channel_name() {
        let file = exr_file(&[("R", [1.0, 2.0]), ("G", [3.0, 4.0]), ("B", [5.0, 6.0]), ("Z", [7.0, 8.0])]);
        assert_eq!(texels(&file, "a"), Texels::RgbF32(vec![[1.0, 3.0, 5.0], [2.0, 4.0, 6.0]]));
        let grey = exr_file(&[("Y", [0.25, 0.5]), ("A", [1.0, 1.0])]);
        assert_eq!(texels(&grey, "a"), Texels::GrayF32(vec![[0.25], [0.5]]));
        let fault = decode_image(&exr_file(&[("U", [0.0; 2]), ("V", [0.0; 2])]), "a", &Limits::default());
        assert!(fault.expect_err("no colour").problem.contains("R, G, B"));
    }

    #[test]
    fn values_that_are_no_radiance_are_repaired_and_counted() {
        let file = exr_file(&[("R", [f32::NAN, 1.0]), ("G", [-1.0, 2.0]), ("B", [f32::INFINITY, 3.0])]);
        let decoded = decode_image(&file, "a", &Limits::default()).expect("decodes");
        assert_eq!(*decoded.image.texels, Texels::RgbF32(vec![[0.0, 0.0, 65504.0], [1.0, 2.0, 3.0]]));
        assert_eq!(decoded.repaired, 1);
    }

    #[test]
    fn environments_come_from_anywhere_as_floats() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let hdr = image::Rgb32FImage::from_pixel(2, 1, image::Rgb([0.5, 2.0, 64.0]));
        let path = folder.path().join("sky.hdr");
        std::fs::write(&path, encoded(hdr.into(), ImageFormat::Hdr)).expect("write");
        let (image, warnings) = load_image(&path, Role::Environment, &Limits::default(), &[]).expect("loads");
        assert_eq!((image.name.as_str(), image.width, image.height), ("sky.hdr", 2, 1));
        // Shared exponent, eight bits of mantissa: 64 and 2 are exact to 1 / 256 of the largest channel.
        let Texels::RgbF32(texels) = &*image.texels else { panic!("floats were expected") };
        assert!(texels[0].iter().zip([0.5, 2.0, 64.0]).all(|(a, b)| (a - b).abs() <= 0.25), "{texels:?}");
        assert!(warnings.is_empty());
        // The images of the scene count as well.
        let limits = Limits { total_image_bytes: 39, ..Limits::default() };
        let scene = Image { name: "wood".into(), width: 4, height: 4, texels: Texels::Gray8(vec![[0]; 16]).into() };
        assert!(load_image(&path, Role::Environment, &limits, &[]).is_ok());
        let e = load_image(&path, Role::Environment, &limits, &[scene]).expect_err("beyond the budget");
        assert!(e.problem.contains("40 B") && e.place.contains("environment"), "{e}");
        let missing = load_image(&folder.path().join("none.hdr"), Role::Environment, &Limits::default(), &[]);
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
    fn formats_that_cannot_be_read_are_named() {
        for (bytes, word) in
            [(&b"\xabKTX 20\xbb"[..], "KTX2"), (b"DDS |", "DDS"), (b"nonsense", "no image"), (b"", "empty")]
        {
            let fault = decode_image(bytes, "a.png", &Limits::default()).expect_err("no image");
            assert!(fault.problem.contains(word), "{fault:?}");
        }
    }
}
