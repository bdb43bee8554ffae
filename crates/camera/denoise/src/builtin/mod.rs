//! The built-in filter, without trained weights or downloads.

mod average;
mod blend;
mod lanes;
mod noise;
mod patch;
mod plane;
mod tiles;

use fearless_simd::Level;

use crate::denoiser::{Control, DenoiseError, DenoiseInput, Denoiser, Triples};

/// Averages a pixel with others nearby that have similar albedo, normal and depth, and whose difference in colour may
/// be noise (`docs/denoising.md` describes the method).
///
/// Uses the variance of the mean if it is present, and estimates it from the image if it is missing or infinite.
/// Without features it uses colour alone. Pixels that are not finite are filled from their neighbours. The result has
/// the same bits for any number of threads, and scales with its input.
#[derive(Clone, Copy, Debug, Default)]
pub struct Builtin;

impl Denoiser for Builtin {
    fn name(&self) -> String {
        "builtin 3".into()
    }

    fn denoise(&self, input: &DenoiseInput<'_>, control: &Control<'_>) -> Result<Triples, DenoiseError> {
        input.check()?;
        if !(control.progress)(0.0) {
            return Err(DenoiseError::Cancelled);
        }
        let image = patch::Image::new(input);
        let size = image.size();
        let level = Level::new();
        let shares = tiles::map_tiles(size, control, (0.0, 0.2), |tile| noise::supported_shares(level, &image, tile))?;
        let estimates =
            tiles::map_tiles(size, control, (0.2, 0.45), |tile| noise::estimates(level, &image, &shares, tile))?;
        let image = image.with_mean(&estimates.map(|[mean, _]| *mean));
        let variance = estimates.map(|[_, variance]| *variance);
        let averages =
            tiles::map_tiles(size, control, (0.45, 0.95), |tile| average::averages(level, &image, &variance, tile))?;
        tiles::map_tiles(size, control, (0.95, 1.0), |tile| blend::blended(&image, &variance, &averages, tile))
    }
}
