//! The noise of a film for noise-matched exposure: the variance of every pixel, and the pixels where it is reliable.

use dunkelfeld_film::Plane;
use dunkelfeld_render::Error;
use dunkelfeld_render::film_noise::{PixelVariance, sensor_noise, shares};
use dunkelfeld_render::lens_image::LensImage;
use dunkelfeld_sensor::{Device, Exposure, FrameKey, LensBlur, Response, SensorModel, largest_variance, matched_where};
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

    /// The mean electrons of a frame of a device: those of the image, with the noise that the lens takes from the render. Where the
    /// render has more noise than the camera, it takes no more than that of the largest render noise that can be matched.
    pub(crate) fn electrons<'a>(
        &self,
        mean: &'a Plane<f32>,
        (device, exposure): (&Device, Exposure),
        key: FrameKey,
    ) -> Cow<'a, Plane<f32>> {
        let Some((blur, shares, variance)) = &self.restored else { return Cow::Borrowed(mean) };
        let model = device.model();
        let (dark, read) = (model.dark_electrons(exposure.time()).0, model.pixel_dark_noise().0.powi(2));
        let mut means = mean.data().iter();
        let variance = variance.map(|&v| {
            let most = means.next().map_or(0.0, |&mean| largest_variance(f64::from(mean) + dark, read) as f32);
            if v.is_finite() { v.min(most) } else { v }
        });
        let mut restored = blur.restored(&variance, *shares, device.normals(key));
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

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_film::MeanImage;
    use dunkelfeld_radiometry::{Metres, Seconds};
    use dunkelfeld_sensor::{Optics, Psf};

    /// A variance far above that of the camera, as a rare sample gives its surroundings, adds no more noise than a camera has.
    #[test]
    fn a_lens_restores_no_more_noise_than_a_camera_has() {
        let optics = Optics::new(5.6, 0.9, 0.0).expect("in range").with_psf(Psf::Diffraction);
        let image = MeanImage::without_moments(Plane::new(1, 1, [0.0; 3]), true);
        let blur = Arc::new(LensBlur::new(&optics, Metres(3.45e-6), &image).expect("it blurs"));
        let model = dunkelfeld_io::sensor_file::preset("imx250").expect("a preset");
        let (size, mean, key) = (48, 1000.0, FrameKey { seed: 1, frame: 0 });
        let device = Device::new(model, 1, size, size);
        let exposure = Exposure::new(Seconds(1e-3)).expect("in range");
        let frame = |variance: f32| {
            let unknown = Plane::new(size, size, false);
            let known = CompensationInputs {
                restored: Some((blur.clone(), [1.0, 0.0, 0.0], Plane::new(size, size, variance))),
                ..CompensationInputs::new(Plane::new(size, size, variance), unknown)
            };
            known.electrons(&Plane::new(size, size, mean), (&device, exposure), key).into_owned()
        };
        let spread = |frame: &Plane<f32>| {
            let squares = frame.data().iter().map(|v| f64::from(v - mean).powi(2)).sum::<f64>();
            squares / f64::from(size * size)
        };
        // Below the limit, noise is restored in proportion to the variance; above it, that of the limit.
        let (low, high, limit) = (frame(100.0), frame(1e8), frame(0.64 * 1010.0));
        assert!(spread(&low) > 1.0 && spread(&low) < 100.0, "{}", spread(&low));
        assert!((spread(&high) / spread(&limit) - 1.0).abs() < 0.02, "{} {}", spread(&high), spread(&limit));
    }
}
