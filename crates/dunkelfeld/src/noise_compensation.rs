//! The noise of a film for noise-matched exposure: the variance of every pixel, and the pixels where it is reliable.

use dunkelfeld_film::Plane;
use dunkelfeld_render::Error;
use dunkelfeld_render::film_noise::{PixelVariance, sensor_noise, shares};
use dunkelfeld_render::lens_image::LensImage;
use dunkelfeld_sensor::{Device, Exposure, FrameKey, LensBlur, Response, SensorModel, matched_where};
use std::borrow::Cow;
use std::sync::Arc;

/// The pixels where noise-matched exposure holds. There, frames of independent renders have the variance of the
/// camera's frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Matched {
    /// Does it hold in the pixel? The layer `matched.Y`.
    pub held: Plane<bool>,
    /// Share of the pixels where it holds, in \[0, 1\].
    pub share: f64,
    /// Variance of the render over that of the camera. The part of the render variance that could be compensated does
    /// not count. Infinite where it is unknown, and where the pixel contains a rare sample, which raises it by more
    /// than one standard deviation of the camera.
    pub ratios: Plane<f32>,
}

impl Matched {
    /// Checks the pixels of an exposure by their mean electrons and the known part of their noise.
    pub(crate) fn new(
        known: &CompensationInputs,
        electrons: &Plane<f32>,
        model: &SensorModel,
        exposure: Exposure,
    ) -> Self {
        let sensor = sensor_noise(model, exposure);
        let held = known.held(electrons, model, exposure);
        let mut pixels = known.variance.data().iter().zip(known.is_rare.data());
        let ratios = electrons.map(|&mean| match pixels.next() {
            Some((v, false)) => v / sensor.variance(f64::from(mean)) as f32,
            _ => f32::INFINITY,
        });
        Self { share: share(&held), held, ratios }
    }
}

fn share(held: &Plane<bool>) -> f64 {
    held.data().iter().filter(|h| **h).count() as f64 / held.data().len().max(1) as f64
}

/// The noise of a film's pixels, as far as it is compensated.
#[derive(Clone, Debug)]
pub(crate) struct CompensationInputs {
    /// Variance of the rendered mean of each pixel [e-^2], from its own samples if they suffice. Infinite where the
    /// pixel has samples in fewer than two batches. Then its neighbours may determine the variance of its samples, but
    /// not whether it contains a rare sample.
    pub(crate) variance: Plane<f32>,
    /// Does the pixel contain a rare sample ([`Matched::ratios`])? Its contribution cannot be compensated in this
    /// pixel, and must not be compensated in others. Such pixels are left out of the estimates of their neighbours.
    pub(crate) is_rare: Plane<bool>,
    /// The lens that blurs, with the shares of the channels in the signal, and the variance in front of it. Then [`Self::variance`]
    /// is that of a frame in which the camera restores what the lens takes from the noise of the render.
    restored: Option<(Arc<LensBlur>, [f64; 3], Plane<f32>)>,
}

impl CompensationInputs {
    pub(crate) fn new(variance: Plane<f32>, is_rare: Plane<bool>) -> Self {
        Self { variance, is_rare, restored: None }
    }

    /// The noise behind a lens. A rare sample is then one of the pixels around its own too.
    ///
    /// # Errors
    /// A lens that blurs in front of a filter array: the noise of a pixel is then that of its colour in pixels of other colours.
    pub(crate) fn behind(self, image: &LensImage, model: &SensorModel, response: &Response) -> Result<Self, Error> {
        let Some(blur) = &image.blur else { return Ok(self) };
        if model.spec().quantum_efficiency.filter().is_some() {
            let problem = "the noise of a colour sensor behind a lens that blurs cannot be matched";
            return Err(Error::setting(
                "exposure noise",
                problem,
                "use `plain`, a monochrome sensor, or psf = \"none\"",
            ));
        }
        let shares = shares(&image.radiance, &response.average());
        let (width, height) = (self.variance.width(), self.variance.height());
        let around = |at: u32, size: u32| at.saturating_sub(1)..(at + 2).min(size);
        let is_near = |x, y| around(y, height).any(|y| around(x, width).any(|x| *self.is_rare.at(x, y)));
        Ok(Self {
            variance: blur.restored_variance(&self.variance, shares),
            is_rare: Plane::from_fn(width, height, is_near),
            restored: Some((blur.clone(), shares, self.variance)),
        })
    }

    /// The mean electrons of a frame of a device: those of the image, with the noise that the lens takes from the render.
    pub(crate) fn electrons<'a>(&self, mean: &'a Plane<f32>, device: &Device, key: FrameKey) -> Cow<'a, Plane<f32>> {
        let Some((blur, shares, variance)) = &self.restored else { return Cow::Borrowed(mean) };
        let mut restored = blur.restored(variance, *shares, device.normals(key));
        restored.data_mut().iter_mut().zip(mean.data()).for_each(|(out, mean)| *out = (*out + mean).max(0.0));
        Cow::Owned(restored)
    }

    pub(crate) fn from_variances(variances: &Plane<PixelVariance>) -> Self {
        Self::new(variances.map(|pixel| pixel.variance), variances.map(|pixel| pixel.is_rare))
    }

    /// The pixels where the method holds, for a sensor with these mean electrons.
    pub(crate) fn held(&self, electrons: &Plane<f32>, model: &SensorModel, exposure: Exposure) -> Plane<bool> {
        let mut held = matched_where(model, exposure, electrons, &self.variance);
        held.data_mut().iter_mut().zip(self.is_rare.data()).for_each(|(held, rare)| *held &= !rare);
        held
    }
}
