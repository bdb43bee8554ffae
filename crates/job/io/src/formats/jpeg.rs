//! JPEG files of 8-bit pictures, for sets that trade quality for size.

use crate::picture::Picture;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use std::io;

/// The bytes of a baseline JPEG of an 8-bit picture. `quality` is 1 to 100.
///
/// # Errors
/// A picture of 16 bits, without pixels, or with a side above 65535.
pub fn jpeg_bytes(picture: Picture<'_>, quality: u8) -> io::Result<Vec<u8>> {
    let (width, height) = picture.size();
    let (bytes, color) = match picture {
        Picture::Gray8(p) => (p.data(), ExtendedColorType::L8),
        Picture::Rgb8(p) => (p.data().as_flattened(), ExtendedColorType::Rgb8),
        Picture::Gray16(_) | Picture::Rgb16(_) => {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "a JPEG has 8 bits"));
        }
    };
    let mut file = Vec::new();
    JpegEncoder::new_with_quality(&mut file, quality).encode(bytes, width, height, color).map_err(io::Error::other)?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_film::Plane;

    #[test]
    fn a_picture_comes_back_within_the_loss_of_the_format() {
        let ramp = Plane::from_vec(64, 32, (0..64 * 32).map(|i| (i % 64 * 4) as u8).collect()).expect("the size");
        let bytes = jpeg_bytes(Picture::Gray8(&ramp), 95).expect("a JPEG");
        let back = image::load_from_memory(&bytes).expect("a JPEG").into_luma8();
        assert_eq!(back.dimensions(), (64, 32));
        for (a, b) in back.as_raw().iter().zip(ramp.data()) {
            assert!(a.abs_diff(*b) <= 6, "{a} {b}");
        }
        assert!(jpeg_bytes(Picture::Gray16(&Plane::new(1, 1, 0)), 95).is_err());
    }
}
