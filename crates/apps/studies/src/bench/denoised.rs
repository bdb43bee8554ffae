//! Denoisers in a bench: the available ones, their images, and the errors of the images.

use super::settings::BenchSettings;
use super::statistics::mean_plane;
use crate::report::estimate::{Estimate, mean};
use crate::series::View;
use dunkelfeld::denoising::{Denoiser, find_denoiser};
use dunkelfeld::film::{Film, Plane};
use dunkelfeld::{DenoiseMethod, DenoiseSettings, Error, RenderSettings, Session};

/// A denoiser under its name in files and tables, `builtin` or `oidn`.
pub(super) struct Filter {
    pub(super) key: &'static str,
    denoiser: Box<dyn Denoiser>,
}

/// The denoised image of a render.
#[derive(Clone, Debug)]
pub(super) struct Filtered {
    pub(super) key: &'static str,
    /// The linear signal.
    pub(super) signal: Plane<f32>,
    pub(super) seconds: f64,
}

/// The denoisers of the settings. If there are none, the built-in one, and Intel Open Image Denoise if this machine has
/// it.
///
/// # Errors
/// A named denoiser is not available.
pub(super) fn filters(settings: &BenchSettings) -> Result<Vec<Filter>, Error> {
    let find = |method: DenoiseMethod| {
        // The path of the library does not matter to users of the reports.
        let oidn = settings.oidn.clone().filter(|_| method == DenoiseMethod::Oidn);
        let found = find_denoiser(&DenoiseSettings::default().with_method(method).with_oidn(oidn))?;
        Ok::<_, Error>(found.map(|denoiser| Filter { key: method.name(), denoiser }))
    };
    let chosen = match settings.denoisers() {
        Some(methods) => methods.iter().map(|m| find(*m)).collect::<Result<Vec<_>, _>>()?,
        None if settings.oidn.is_some() => vec![find(DenoiseMethod::Builtin)?, find(DenoiseMethod::Oidn)?],
        None => vec![find(DenoiseMethod::Builtin)?, find(DenoiseMethod::Oidn).ok().flatten()],
    };
    Ok(chosen.into_iter().flatten().collect())
}

impl Filter {
    /// Its name with version.
    pub(super) fn name(&self) -> String {
        self.denoiser.name()
    }

    /// The denoised signal of a film; `None` if it was cancelled.
    ///
    /// # Errors
    /// Those of the denoiser, as a setting that cannot be used.
    pub(super) fn apply(
        &self,
        film: &Film,
        settings: &RenderSettings,
        view: &View,
        session: &Session<'_>,
    ) -> Result<Option<Filtered>, Error> {
        let done = view.denoised(film, &*self.denoiser, settings, session)?;
        Ok(done.map(|(signal, seconds)| Filtered { key: self.key, signal, seconds }))
    }
}

/// Mean squared error of images against the truth, weighted by pixel. It uses unbiased renders that are independent of
/// the images. With two of these, a and b, the mean of (x - a) (x - b) is the squared error of x, without a
/// contribution of the noise of a and b. The estimate also includes the bias of images whose own noise was removed by
/// smoothing.
pub(super) struct Truth<'a> {
    reference: &'a Plane<f32>,
    others: &'a [Plane<f32>],
    sum: Plane<f64>,
    /// Weight of a pixel's squared error; zero for excluded pixels.
    weights: Vec<f64>,
}

impl<'a> Truth<'a> {
    /// From the reference and further renders of the scene, all unbiased and independent of each other. The error is over
    /// the sensor's variance `s` if there is one. `None` with fewer than two further renders.
    pub(super) fn new(
        reference: &'a Plane<f32>,
        others: &'a [Plane<f32>],
        counts: &[bool],
        s: Option<&Plane<f64>>,
    ) -> Option<Self> {
        if others.len() < 2 {
            return None;
        }
        let n = others.len() as f64;
        let mut sum = mean_plane(others)?;
        sum.data_mut().iter_mut().for_each(|v| *v *= n);
        let counted = counts.iter().filter(|c| **c).count() as f64;
        let weight = |i: usize| s.and_then(|s| s.data().get(i)).map_or(1.0, |s| 1.0 / s) / counted;
        let weights = counts.iter().enumerate().map(|(i, c)| if *c { weight(i) } else { 0.0 }).collect();
        Some(Self { reference, others, sum, weights })
    }

    /// The error of images. `own` means that image i was computed from the further render i. Then render i is left out
    /// of its estimate.
    pub(super) fn error(&self, images: &[Plane<f32>], own: bool) -> Estimate {
        let of = |(i, image): (usize, &Plane<f32>)| {
            let left_out = if own { self.others.get(i) } else { None };
            let n = (self.others.len() - usize::from(left_out.is_some())) as f64;
            let pixels = image.data().iter().zip(self.reference.data()).zip(self.sum.data()).zip(&self.weights);
            let mut error = 0.0;
            for (p, (((&x, &a), &sum), weight)) in pixels.enumerate() {
                let mine = left_out.and_then(|plane| plane.data().get(p)).map_or(0.0, |&v| f64::from(v));
                let (x, a, b) = (f64::from(x), f64::from(a), (sum - mine) / n);
                error += weight * (x - a) * (x - b);
            }
            error
        };
        mean(&images.iter().enumerate().map(of).collect::<Vec<_>>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_sampling::keyed_stream;
    use rand_core::Rng;

    /// Uniform noise of variance `sigma^2` around a slope that ends at 10.
    fn render(seed: u64, sigma: f64) -> Plane<f32> {
        let mut rng = keyed_stream(seed, 0, 0, 0);
        let mut one = || (f64::from(rng.next_u32()) / f64::from(u32::MAX) - 0.5) * 12f64.sqrt();
        Plane::from_fn(100, 20, |x, _| (f64::from(x) / 10.0 + sigma * one()) as f32)
    }

    #[test]
    fn the_error_of_a_render_is_its_variance_and_that_of_a_flat_picture_its_bias() {
        let reference = render(0, 1.0);
        let renders: Vec<_> = (1..9).map(|seed| render(seed, 2.0)).collect();
        let counts = vec![true; 2000];
        let truth = Truth::new(&reference, &renders, &counts, None).expect("eight renders");
        // The renders themselves: variance 4, with a relative standard error of sqrt(0.8 / 16000) for uniform numbers,
        // and the common part from the reference, 2 * 1 / sqrt(16000). Six of both.
        let noise = truth.error(&renders, true);
        assert!((noise.value - 4.0).abs() < 6.0 * (0.0285f64 + 0.016), "{noise:?}");
        // A flat picture at the mean: the squared slope around its middle, 8.3325, with the same noise for all.
        let flat = vec![Plane::new(100, 20, 4.95f32); 8];
        let bias = truth.error(&flat, false);
        assert!((bias.value - 8.3325).abs() < 0.4, "{bias:?}");
        // Independent images without error have the result zero, for any noise of the renders in the comparison.
        let perfect = vec![render(0, 0.0); 8];
        assert!(truth.error(&perfect, false).value.abs() < 0.1);
        // Over a sensor's variance of 4 the renders have the error one. Excluded pixels have no influence.
        let s = Plane::new(100, 20, 4.0);
        let half: Vec<bool> = (0..2000).map(|i| i % 2 == 0).collect();
        let ratio = Truth::new(&reference, &renders, &half, Some(&s)).expect("renders").error(&renders, true);
        assert!((ratio.value - 1.0).abs() < 6.0 * 0.015, "{ratio:?}");
        assert!(Truth::new(&reference, &renders[..1], &counts, None).is_none());
    }
}
