//! Rendered images and masks: PNG files as pixels, scaled down in linear light.

use super::error::ReportError;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageEncoder, ImageReader};
use std::io::{Cursor, ErrorKind};
use std::path::Path;

/// The exponent of 8-bit images.
const GAMMA: f32 = 2.2;
/// The help for a file that is no image.
const HELP: &str = "delete the record of the image, and run the command again";

/// An 8-bit picture, gamma 2.2: one channel (grey) or three (RGB) per pixel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Pixels {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) channels: usize,
    pub(crate) data: Vec<u8>,
}

/// A mask: the id of the visible instance per pixel. Zero is none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Mask {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) ids: Vec<u16>,
}

impl Pixels {
    /// Reads an image. A grey one has one channel.
    pub(crate) fn read(path: &Path) -> Result<Self, ReportError> {
        let image = decoded(path)?.ok_or_else(|| ReportError::new(path, "the file is missing", HELP))?;
        let (width, height) = (image.width(), image.height());
        Ok(match image {
            DynamicImage::ImageLuma8(grey) => Self { width, height, channels: 1, data: grey.into_raw() },
            DynamicImage::ImageLuma16(_) | DynamicImage::ImageLumaA8(_) | DynamicImage::ImageLumaA16(_) => {
                Self { width, height, channels: 1, data: image.into_luma8().into_raw() }
            }
            other => Self { width, height, channels: 3, data: other.into_rgb8().into_raw() },
        })
    }

    /// The size of the picture in a square of `cell` pixels: never enlarged, the aspect kept, one pixel at least.
    pub(crate) fn size_within(&self, cell: u32) -> [u32; 2] {
        let longest = self.width.max(self.height).max(1);
        let scaled = |v: u32| (f64::from(v) * f64::from(cell) / f64::from(longest)).round().max(1.0) as u32;
        if longest <= cell { [self.width, self.height] } else { [scaled(self.width), scaled(self.height)] }
    }

    /// The picture scaled down: each pixel is the mean of its area, computed in linear light.
    pub(crate) fn shrunk(&self, [width, height]: [u32; 2]) -> Self {
        if [width, height] == [self.width, self.height] {
            return self.clone();
        }
        let (columns, rows) = (shares(self.width, width), shares(self.height, height));
        let linear: [f32; 256] = std::array::from_fn(|v| (v as f32 / 255.0).powf(GAMMA));
        let n = self.channels;
        let mut sums = vec![0.0_f32; width as usize * height as usize * n];
        let mut line = vec![0.0_f32; width as usize * n];
        for (source, row) in self.data.chunks_exact((self.width as usize * n).max(1)).zip(&rows) {
            line.fill(0.0);
            for (pixel, column) in source.chunks_exact(n).zip(&columns) {
                for (at, share) in column.iter().filter(|(_, share)| *share > 0.0) {
                    let target = line.iter_mut().skip(at * n);
                    target.zip(pixel).for_each(|(sum, v)| *sum += share * linear[usize::from(*v)]);
                }
            }
            for (at, share) in row.iter().filter(|(_, share)| *share > 0.0) {
                let target = sums.iter_mut().skip(at * line.len());
                target.zip(&line).for_each(|(sum, v)| *sum += share * v);
            }
        }
        let data = sums.iter().map(|v| (v.powf(1.0 / GAMMA) * 255.0 + 0.5) as u8).collect();
        Self { width, height, channels: n, data }
    }
}

impl Mask {
    /// Reads a mask. None if there is no file.
    pub(crate) fn read(path: &Path) -> Result<Option<Self>, ReportError> {
        let image = decoded(path)?;
        Ok(image.map(|i| Self { width: i.width(), height: i.height(), ids: i.into_luma16().into_raw() }))
    }

    /// The mask at the size of a picture that was scaled down. A pixel has the most frequent id in its area that is not
    /// zero, so that thin instances remain. Of equally frequent ids it has the larger one.
    pub(crate) fn shrunk(&self, [width, height]: [u32; 2]) -> Vec<u16> {
        let range = |i: u32, n: u32, size: u32| {
            let edge = |i: u32| u64::from(i) * u64::from(size);
            let (from, to) = (edge(i) / u64::from(n), edge(i + 1).div_ceil(u64::from(n)));
            from as usize..to as usize
        };
        let mut found: Vec<u16> = Vec::new();
        let mut ids = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            for x in 0..width {
                found.clear();
                for row in range(y, height, self.height) {
                    let start = row * self.width as usize;
                    let columns = range(x, width, self.width);
                    let part = self.ids.get(start + columns.start..start + columns.end).unwrap_or_default();
                    found.extend(part.iter().filter(|id| **id > 0));
                }
                found.sort_unstable();
                let most = found.chunk_by(|a, b| a == b).max_by_key(|same| same.len());
                ids.push(most.and_then(|same| same.first()).copied().unwrap_or(0));
            }
        }
        ids
    }
}

/// For each of `from` pixels: the one or two of `to` larger pixels that contain it, with the shares of its area in
/// units of the larger pixels.
fn shares(from: u32, to: u32) -> Vec<[(usize, f32); 2]> {
    let scale = f64::from(to) / f64::from(from.max(1));
    let last = to.saturating_sub(1) as usize;
    let pair = |i: u32| {
        let (low, high) = (f64::from(i) * scale, f64::from(i + 1) * scale);
        let at = (low as usize).min(last);
        let inside = (high.min((at + 1) as f64) - low).max(0.0);
        [(at, inside as f32), ((at + 1).min(last), (high - low - inside) as f32)]
    };
    (0..from).map(pair).collect()
}

fn decoded(path: &Path) -> Result<Option<DynamicImage>, ReportError> {
    let reader = match ImageReader::open(path) {
        Ok(reader) => reader,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(ReportError::new(path, e, "check the file and its permissions")),
    };
    let image = reader.with_guessed_format().map_err(image::ImageError::from).and_then(ImageReader::decode);
    image.map(Some).map_err(|e| ReportError::new(path, format!("the image cannot be read: {e}"), HELP))
}

/// A picture as the bytes of a PNG file. `channels` is 1 (grey), 3 (RGB) or 4 (RGB and opacity).
pub(crate) fn png(data: &[u8], [width, height]: [u32; 2], channels: usize) -> Result<Vec<u8>, ReportError> {
    let kind = match channels {
        1 => ExtendedColorType::L8,
        3 => ExtendedColorType::Rgb8,
        _ => ExtendedColorType::Rgba8,
    };
    let mut bytes = Cursor::new(Vec::new());
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Default, FilterType::Adaptive);
    let failed = |e| ReportError::new(Path::new("report"), format!("a picture cannot be encoded: {e}"), "report this");
    encoder.write_image(data, width, height, kind).map_err(failed)?;
    Ok(bytes.into_inner())
}

/// The bytes of a PNG file as the address of an image (RFC 4648, base 64).
pub(crate) fn data_uri(png: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut uri = String::from("data:image/png;base64,");
    for part in png.chunks(3) {
        let at = |i: usize| u32::from(part.get(i).copied().unwrap_or(0));
        let bits = at(0) << 16 | at(1) << 8 | at(2);
        for i in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * i)) as usize & 63];
            uri.push(if i <= part.len() { char::from(digit) } else { '=' });
        }
    }
    uri
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_is_taken_in_linear_light() {
        let checker = Pixels { width: 4, height: 2, channels: 1, data: vec![0, 255, 0, 255, 255, 0, 255, 0] };
        // The 2.2th root of one half is 0.7297.
        assert_eq!(checker.shrunk([2, 1]).data, [186, 186]);
        assert_eq!(checker.shrunk([4, 2]), checker);
    }

    #[test]
    fn flat_pictures_stay_flat_at_any_size() {
        let flat = Pixels { width: 37, height: 23, channels: 3, data: [90, 128, 255].repeat(37 * 23) };
        for size in [[36, 22], [11, 7], [1, 1]] {
            let small = flat.shrunk(size);
            assert_eq!(small.data, [90, 128, 255].repeat((size[0] * size[1]) as usize), "{size:?}");
        }
    }

    #[test]
    fn the_aspect_is_kept_and_nothing_is_enlarged() {
        let sized = |width, height| Pixels { width, height, channels: 1, data: Vec::new() };
        assert_eq!(sized(1000, 500).size_within(200), [200, 100]);
        assert_eq!(sized(1, 5000).size_within(200), [1, 200]);
        assert_eq!(sized(64, 32).size_within(200), [64, 32]);
    }

    #[test]
    fn thin_instances_remain_in_a_small_mask() {
        let mut mask = Mask { width: 8, height: 4, ids: vec![0; 32] };
        mask.ids[9] = 700;
        (mask.ids[6], mask.ids[7], mask.ids[15]) = (2, 3, 3);
        assert_eq!(mask.shrunk([2, 1]), [700, 3]);
    }

    #[test]
    fn addresses_are_those_of_the_standard() {
        let text = |bytes: &[u8]| data_uri(bytes).trim_start_matches("data:image/png;base64,").to_string();
        assert_eq!([text(b""), text(b"f"), text(b"fo"), text(b"foobar")], ["", "Zg==", "Zm8=", "Zm9vYmFy"]);
    }

    #[test]
    fn files_that_are_no_images_are_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("000000.png");
        assert_eq!(Mask::read(&path), Ok(None));
        assert!(Pixels::read(&path).expect_err("missing").problem.contains("missing"));
        std::fs::write(&path, "no image").expect("written");
        assert_eq!(Pixels::read(&path).expect_err("no image").file, path);
    }
}
