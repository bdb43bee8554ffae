//! Any bytes as an image: PNG, JPEG, TIFF, WebP, BMP, HDR and EXR by their signature, TGA if the first byte is odd. What
//! is decoded keeps the limits and holds nothing but finite numbers.
#![no_main]

use dunkelfeld_fuzz::{options, target};
use dunkelfeld_io::images::decode_image;
use dunkelfeld_scene::Texels;

target!(|data| {
    let Some((first, bytes)) = data.split_first() else { return };
    let name = if first & 1 == 1 { "image.tga" } else { "image" };
    let limits = options().limits;
    match decode_image(bytes, name, &limits) {
        Ok(decoded) => {
            let image = decoded.image;
            assert!(image.width.max(image.height) <= limits.image_side);
            let texels = match &image.texels {
                Texels::Rgba8(texels) => texels.len(),
                Texels::Rgba16(texels) => texels.len(),
                Texels::RgbF32(texels) => {
                    assert!(texels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
                    texels.len()
                }
            };
            assert_eq!(texels as u64, u64::from(image.width) * u64::from(image.height));
        }
        Err(fault) => assert!(!fault.problem.is_empty()),
    }
});
