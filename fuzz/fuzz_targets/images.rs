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
            let finite = |v: &f32| v.is_finite() && *v >= 0.0;
            match &*image.texels {
                Texels::GrayF32(texels) => assert!(texels.iter().flatten().all(finite)),
                Texels::RgbF32(texels) => assert!(texels.iter().flatten().all(finite)),
                _ => {}
            }
            assert_eq!(image.texels.len() as u64, u64::from(image.width) * u64::from(image.height));
            assert!(image.texels.bytes() as u64 <= limits.image_bytes);
        }
        Err(fault) => assert!(!fault.problem.is_empty()),
    }
});
