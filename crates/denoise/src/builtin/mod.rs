//! The built-in filter: no weights that were learned, nothing to download.

mod average;
mod blend;
mod lanes;
mod noise;
mod patch;
mod plane;
mod tiles;

use crate::denoiser::{Control, DenoiseError, DenoiseInput, Denoiser, Triples};

/// Averages pixels with others nearby that look alike in albedo, normal and depth, and whose difference in colour may be
/// noise (`docs/denoising.md` says how).
///
/// Uses the variance of the mean if it is there, and estimates it from the image where it is missing or infinite. Without
/// features it goes by colour alone. Pixels that are not finite are filled from their neighbours. The result is the same
/// bits for any number of threads, and scales with its input.
#[derive(Clone, Copy, Debug, Default)]
pub struct Builtin;

impl Denoiser for Builtin {
    fn name(&self) -> String {
        "builtin 2".into()
    }

    fn denoise(&self, input: &DenoiseInput<'_>, control: &Control<'_>) -> Result<Triples, DenoiseError> {
        input.check()?;
        if !(control.progress)(0.0) {
            return Err(DenoiseError::Cancelled);
        }
        let image = patch::Image::new(input);
        let size = image.size();
        let variance = tiles::map_tiles(size, control, (0.0, 0.1), |tile| noise::variances(&image, tile))?;
        let averages = tiles::map_tiles(size, control, (0.1, 0.95), |tile| average::averages(&image, &variance, tile))?;
        tiles::map_tiles(size, control, (0.95, 1.0), |tile| blend::blended(&image, &variance, &averages, tile))
    }
}
