//! The noise of a film relative to the noise of a sensor. Plans and certificates are computed from it.

use crate::lens_image::LensImage;
use crate::parallel::map_film_at;
use crate::rendered_film::RenderedFilm;
use crate::settings::SensorChoice;
use dunkelfeld_adaptive::certificate::{Certificate, Claim, certify as certify_pixels};
use dunkelfeld_adaptive::required_samples::{RequiredSamples, SensorNoise, required_samples};
use dunkelfeld_adaptive::variance::inputs::{NoiseInputs, PixelFeatures, SensorVarianceRange, pixel_features};
use dunkelfeld_adaptive::variance::pixel::{BLOCK, pixel_noise_of_blocks};
use dunkelfeld_adaptive::variance::pooled::{PixelNoise, pooled_pixel};
use dunkelfeld_film::{Film, Needed, Plane, Scatter};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sensor::{Exposure, ImageExposure, LensBlur, Response, SensorError, SensorModel, Weights};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Conversion of radiance to a signal: the unit in which noise is measured.
#[derive(Clone, Copy, Debug)]
pub struct SignalModel {
    /// Electrons per radiance and channel of each pixel; luminance without a sensor.
    response: Response,
    /// Saturation level, in that unit.
    pub white: f32,
    /// The noise of the sensor; `None` without a sensor.
    pub sensor: Option<SensorNoise>,
}

impl SignalModel {
    /// The sensor at its exposure ([`ImageExposure`]), or the luminance of an image without a sensor.
    ///
    /// # Errors
    /// A sensor whose ranges the exposure exceeds.
    pub fn new(mean: &Plane<[f32; 3]>, sensor: &SensorChoice) -> Result<Self, SensorError> {
        let SensorChoice::Emva { model, optics, exposure } = sensor else {
            return Ok(Self { response: Response::constant(Weights::luminance()), white: 1.0, sensor: None });
        };
        let ImageExposure { exposure, .. } = ImageExposure::new(*exposure, mean, model, optics)?;
        Ok(Self {
            response: Response::new(model, optics, exposure),
            white: model.saturation().0 as f32,
            sensor: Some(sensor_noise(model, exposure)),
        })
    }

    /// The mean image in this unit, without the mosaic of a filter array. The edges of the mosaic are not edges of the
    /// scene.
    pub fn image(&self, mean: &Plane<[f32; 3]>) -> Plane<f32> {
        let weights = self.response.average();
        mean.map(|&pixel| weights.electrons(pixel).0 as f32)
    }

    /// The variance of one sample of each pixel over that of the sensor at its mean, by the spread of the batches. Plans are made
    /// from it. Infinite for pixels that are saturated beyond doubt, and for those of unknown variance. `None` without a
    /// sensor. It is that in front of the lens: what a lens takes from the noise is about the same share everywhere.
    pub(crate) fn noise_of_samples(&self, film: &Film) -> Option<Plane<f32>> {
        let sensor = self.sensor?;
        let [noise] = map_film_at(film, Needed::Image, |x, y, sums| {
            let (mean, variance) = sums.means().weighted_mean_and_variance(self.response.at(x, y).0);
            let of_sample = f64::from(sums.count()) * variance / sensor.variance(mean);
            [if sensor.is_saturated(mean, variance) { f32::INFINITY } else { of_sample as f32 }]
        });
        Some(noise)
    }

    /// Estimates of some rows of pixels of a film, from the first row of a tile on, as signals of each kind of pixel.
    fn evidence(&self, film: &RenderedFilm, rows: Range<u32>) -> Vec<NoiseInputs> {
        let (width, height, kinds) = (film.sums.width(), rows.len() as u32, self.response.kinds());
        let mut counts = Plane::new(width, height, 0);
        let mut normals = Plane::new(width, height, [0.0; 3]);
        let mut seen: Vec<_> = kinds.iter().map(|_| Plane::new(width, height, SignalEstimates::default())).collect();
        let tile = |y: u32| (y / Film::TILE) as usize;
        for (row, top) in
            film.sums.tile_rows()[tile(rows.start)..].iter().zip((rows.start..rows.end).step_by(Film::TILE as usize))
        {
            let first = (top - rows.start) as usize * width as usize;
            row.visit(Needed::Image, |x, y, sums| {
                let pixel = first + y as usize * width as usize + x as usize;
                counts.data_mut()[pixel] = sums.count();
                normals.data_mut()[pixel] = sums.mean_normal();
                let means = sums.means();
                let (variance, covariance) = means.variance_and_covariance();
                let scatter = sums.scatter_about(means.mean);
                let [mean, variance, covariance] = [means.mean, variance, covariance].map(|v| v.map(|v| v as f32));
                for (seen, weights) in seen.iter_mut().zip(kinds) {
                    let of_kind = SignalEstimates::new(weights, mean, (variance, covariance), scatter, sums.count());
                    seen.data_mut()[pixel] = of_kind;
                }
            });
        }
        let objects =
            Plane::from_fn(width, height, |x, y| film.ids.at(x, rows.start + y).map_or(u32::MAX, |l| l.object()));
        let surface = pixel_features(&objects, &normals);
        let of_kind = |seen| SignalEstimates::inputs(&seen, counts.clone(), surface.clone(), self.sensor);
        seen.into_iter().map(of_kind).collect()
    }
}

/// Estimates of a pixel, as signals of one kind of pixel of the sensor.
#[derive(Clone, Copy, Debug, Default)]
pub struct SignalEstimates {
    mean: f32,
    variance: f32,
    largest: f32,
    scatter: Option<Scatter>,
}

impl SignalEstimates {
    /// From the layers of an EXR, or the same numbers of a film, so that both have the same bits: mean radiance, variance and
    /// covariance of its channels, scatter of luminance, number of samples.
    pub fn new(
        weights: &Weights,
        mean: [f32; 3],
        (variance, covariance): ([f32; 3], [f32; 3]),
        scatter: Option<Scatter>,
        count: u32,
    ) -> Self {
        let scatter = scatter
            .map(|Scatter { all, largest }| Scatter { all: f64::from(all as f32), largest: f64::from(largest as f32) });
        let (factor, luminance) = per_luminance(*weights, mean.map(f64::from));
        // The value of the largest sample follows from its distance to the mean. It is assumed to have the colour of the pixel.
        let off = scatter.map_or(0.0, |s| f64::from(count.saturating_sub(1)) * s.largest.sqrt());
        Self {
            mean: weights.electrons(mean).0 as f32,
            variance: weights.variance(variance, covariance) as f32,
            largest: (factor * (luminance + off)) as f32,
            scatter: scatter.map(|s| signal_scatter(s, factor)),
        }
    }

    /// The estimates of all pixels of rows.
    pub fn inputs(
        of_pixels: &Plane<Self>,
        counts: Plane<u32>,
        surface: Plane<PixelFeatures>,
        sensor: Option<SensorNoise>,
    ) -> NoiseInputs {
        let (mean, variance) = (of_pixels.map(|s| s.mean), of_pixels.map(|s| s.variance));
        NoiseInputs {
            counts,
            level: levels(&mean, &variance, sensor),
            scatter: of_pixels.map(|s| s.scatter),
            largest: of_pixels.map(|s| s.largest),
            surface,
            mean,
            variance,
        }
    }
}

/// Signal per luminance of light of this colour, and the luminance of the light.
fn per_luminance(weights: Weights, [r, g, b]: [f64; 3]) -> (f64, f64) {
    let luminance = f64::from(Rgb::new(r as f32, g as f32, b as f32).luminance());
    let signal = weights.electrons([r, g, b].map(|v| v as f32)).0;
    (if luminance > 0.0 { signal / luminance } else { 0.0 }, luminance)
}

/// Converts the scatter of luminance to the scatter of a signal.
pub fn signal_scatter(scatter: Scatter, per_luminance: f64) -> Scatter {
    let square = per_luminance * per_luminance;
    Scatter { all: square * scatter.all, largest: square * scatter.largest }
}

/// The noise that a sensor adds to a frame of the given exposure.
pub fn sensor_noise(model: &SensorModel, exposure: Exposure) -> SensorNoise {
    SensorNoise {
        floor: model.temporal_variance(dunkelfeld_radiometry::Electrons(0.0), exposure.time()),
        // Dark electrons also fill the well.
        saturation: (model.saturation().0 - model.dark_electrons(exposure.time()).0).max(0.0),
    }
}

/// Ranges of the sensor variance of the pixels. Without a sensor all pixels have the same.
fn levels(mean: &Plane<f32>, variance: &Plane<f32>, sensor: Option<SensorNoise>) -> Plane<SensorVarianceRange> {
    let mut variances = variance.data().iter();
    mean.map(|&mean| match (sensor, variances.next()) {
        (Some(sensor), Some(&variance)) if variance.is_finite() => sensor.level(mean, variance),
        _ => SensorVarianceRange::ANY,
    })
}

/// [`dunkelfeld_adaptive::variance::pixel::pixel_noise`] of some rows of an image that begin and end with a row of
/// blocks, distributed in the same way.
fn pixel_noise(evidence: &NoiseInputs, rows: Range<u32>) -> Vec<PixelNoise> {
    if evidence.variance.data().iter().all(|v| !v.is_finite()) {
        // With one sample per pixel or none, there is no variance to pool.
        return vec![PixelNoise::UNKNOWN; rows.len() * evidence.width() as usize];
    }
    let blocks = rows.start / BLOCK..rows.end.div_ceil(BLOCK);
    blocks.into_par_iter().map(|row| pixel_noise_of_blocks(evidence, row)).collect::<Vec<_>>().concat()
}

/// Rows that are analysed at once. Estimates of an image take ten times the memory of the results.
const BAND: u32 = 64;
/// Rows above and below that influence the result: whole blocks, and more than the radius of any neighbourhood.
const HALO: u32 = BLOCK;
const _: () = assert!(BAND.is_multiple_of(BLOCK) && HALO >= 8 && HALO.is_multiple_of(BLOCK));
const _: () = assert!(BLOCK.is_multiple_of(Film::TILE), "a band begins with a row of tiles");

/// A certificate together with the ratios from which it is computed.
#[derive(Clone, Debug, PartialEq)]
pub struct Certified {
    /// The certificate.
    pub certificate: Certificate,
    /// Variance of the rendered mean over that of the sensor, per pixel: the layer `hidden.Y`. Infinite where it is
    /// unknown.
    pub ratios: Plane<f32>,
    /// The pixels that the certificate leaves out because they are saturated beyond doubt.
    pub saturated: Plane<bool>,
}

impl Certified {
    /// The ratios of the pixels that the certificate counts, row by row.
    pub fn counted(&self) -> impl Iterator<Item = f32> + '_ {
        let pixels = self.ratios.data().iter().zip(self.saturated.data());
        pixels.filter(|(_, is_saturated)| !**is_saturated).map(|(&ratio, _)| ratio)
    }

    /// The share of the counted pixels that are hidden at `k`, in \[0, 1\]; 1 if none is counted. It is
    /// [`Certificate::hidden`] of a certificate at `k`.
    pub fn hidden_at(&self, k: f64) -> f64 {
        let limit = k * k;
        let (counted, hidden) = self
            .counted()
            .fold((0u64, 0u64), |(all, hidden), ratio| (all + 1, hidden + u64::from(f64::from(ratio) <= limit)));
        if counted == 0 { 1.0 } else { hidden as f64 / counted as f64 }
    }
}

/// The noise of a pixel from its own samples, with and without rare samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelVariance {
    /// The noise with all samples, for the certificate ([`FilmNoise::pixel_noise`]).
    pub noise: PixelNoise,
    /// The variance of the first moments, times 12.
    pub moments: f32,
    /// Does the pixel contain a rare sample? Without a sensor no sample is rare.
    pub is_rare: bool,
    /// The variance of the mean \[e^-2\]. Pixels with a rare sample do not contribute to the variance of their neighbours.
    /// Infinite where the pixel has samples in fewer than two batches. Its neighbours determine the noise of its samples,
    /// but not whether one of them is rare.
    pub variance: f32,
}

impl PixelVariance {
    const UNKNOWN: Self =
        Self { noise: PixelNoise::UNKNOWN, moments: f32::INFINITY, is_rare: false, variance: f32::INFINITY };
}

/// The noise of the pixels of a film in front of the lens ([`FilmNoise::pixel_noise`]), and the variances of their first moments,
/// times 12: for a lens that blurs a sensor with a filter array, as if all pixels were of one kind, for each kind.
pub struct PixelNoises(Vec<Plane<(PixelNoise, f32)>>);

impl From<Plane<(PixelNoise, f32)>> for PixelNoises {
    /// For sensors without a filter array, and lenses that do not blur.
    fn from(noise: Plane<(PixelNoise, f32)>) -> Self {
        Self(vec![noise])
    }
}

/// The variance of the first moments of a pixel, times 12: for independent samples that of the mean.
///
/// Light and place of a sample are two sequences that are shuffled independently, within aligned runs of samples (Burley
/// 2020). The moment is a sum of the products of their differences over each run with random signs, so its variance is
/// `sum_l e_l h_l n / N_l` times that of independent samples, for shares `e` and `h` of the variances of light and place in
/// the `N_l` runs of level l. The place has 3/4 in runs of two samples, 3/16 in runs of four, and so on. So the factor is at
/// most 3/2, for light with all of its variance in runs of two. Light that no run resolves has 1/2, 1/4, and so on, which gives
/// 1. Between them the factor follows the share of the variance that quasi-random samples leave in the mean.
fn moments(evidence: &NoiseInputs, pixel: usize, noise: &PixelNoise) -> f32 {
    let of_mean = noise.of_mean(evidence.counts.data()[pixel]);
    evidence.scatter.data()[pixel].map_or(of_mean, |scatter| {
        let independent = scatter.all as f32;
        let gain = independent - of_mean;
        if gain > 0.0 { independent + 0.5 * gain } else { independent }
    })
}

/// Shares of the channels of an image in a signal.
pub fn shares(radiance: &Plane<[f32; 3]>, weights: &Weights) -> [f64; 3] {
    let sums = radiance.data().iter().fold([0.0; 3], |sum, pixel| {
        let light = |c: usize| if pixel[c] > 0.0 && pixel[c].is_finite() { f64::from(pixel[c]) } else { 0.0 };
        [sum[0] + light(0), sum[1] + light(1), sum[2] + light(2)]
    });
    let signals = [0, 1, 2].map(|c: usize| weights.0[c] * sums[c]);
    let all: f64 = signals.iter().sum();
    if all > 0.0 { signals.map(|signal| signal / all) } else { [1.0 / 3.0; 3] }
}

/// Estimates of some rows of an image, as signals of each kind of pixel.
type Views<'a> = Box<dyn Fn(Range<u32>) -> Vec<NoiseInputs> + Send + Sync + 'a>;

/// The noise of a film relative to that of a sensor. The estimates are computed band by band, each time they are
/// needed. Those of a whole image would take more memory than its film.
pub struct FilmNoise<'a> {
    /// Mean signal of each pixel behind the lens, with the response of its kind.
    pub mean: Plane<f32>,
    /// Samples per pixel.
    pub counts: Plane<u32>,
    /// The noise of the sensor; `None` without a sensor.
    pub sensor: Option<SensorNoise>,
    /// With a filter array there are several views: the film as it would be with red, green or blue pixels everywhere.
    /// Neighbours share their noise only within one view, so each pixel is evaluated in the view of its own colour.
    views: Views<'a>,
    response: Response,
    /// A lens that blurs, with the shares of the channels in the signal of each kind of pixel.
    blur: Option<(Arc<LensBlur>, Vec<[f64; 3]>)>,
}

impl<'a> FilmNoise<'a> {
    /// Noise of a film, in the unit of `signal_model`.
    pub fn new(signal_model: &SignalModel, film: &'a RenderedFilm) -> Self {
        let signal_model = *signal_model;
        let [mean] = map_film_at(&film.sums, Needed::Means, |x, y, sums| {
            [sums.weighted_mean(signal_model.response.at(x, y).0) as f32]
        });
        let counts = film.sums.sample_counts();
        let views = move |rows: Range<u32>| signal_model.evidence(film, rows);
        let (sensor, response) = (signal_model.sensor, signal_model.response);
        Self { mean, counts, sensor, views: Box::new(views), response, blur: None }
    }

    /// The same noise behind the lens of an image of the film.
    pub fn behind(mut self, image: &LensImage) -> Self {
        if let Some(blur) = &image.blur {
            let (response, radiance) = (self.response, &image.radiance);
            let mean = |x, y| response.at(x, y).electrons(*radiance.at(x, y)).0 as f32;
            self.mean = Plane::from_fn(radiance.width(), radiance.height(), mean);
            let shares = response.kinds().iter().map(|weights| shares(radiance, weights)).collect();
            self.blur = Some((blur.clone(), shares));
        }
        self
    }

    /// Noise from given estimates: the mean signal of each pixel, the numbers of samples, and the views of some rows
    /// through each kind of pixel.
    pub fn from_estimates(
        mean: Plane<f32>,
        counts: Plane<u32>,
        views: impl Fn(Range<u32>) -> Vec<NoiseInputs> + Send + Sync + 'a,
        response: Response,
        sensor: Option<SensorNoise>,
    ) -> Self {
        Self { mean, counts, sensor, views: Box::new(views), response, blur: None }
    }

    /// Noise of a film with this exposure.
    pub fn exposed(response: Response, model: &SensorModel, exposure: Exposure, film: &'a RenderedFilm) -> Self {
        let (white, sensor) = (model.saturation().0 as f32, Some(sensor_noise(model, exposure)));
        Self::new(&SignalModel { response, white, sensor }, film)
    }

    /// Planes that are computed band by band. `f` gets the estimates of a band with its surrounding rows, and the range
    /// of the required rows in them. Each pixel has the value from the view of its own kind, in one plane; or there is a plane for
    /// each kind, with the values of all pixels.
    fn by_bands<T: Copy + Send + Sync>(
        &self,
        unknown: T,
        has_all_kinds: bool,
        f: impl Fn(&NoiseInputs, Range<u32>) -> Vec<T> + Send + Sync,
    ) -> Vec<Plane<T>> {
        let (width, height) = (self.mean.width(), self.mean.height());
        let made = |top: u32| {
            let around = top.saturating_sub(HALO)..(top + BAND + HALO).min(height);
            let rows = top - around.start..(top + BAND).min(height) - around.start;
            (self.views)(around).iter().map(|evidence| f(evidence, rows.clone())).collect::<Vec<Vec<T>>>()
        };
        let tops = (0..height).into_par_iter().step_by(BAND as usize);
        let pixels = (width as usize * BAND as usize).max(1);
        if has_all_kinds {
            let mut planes = vec![Plane::new(width, height, unknown); self.response.kinds().len()];
            let bands: Vec<Vec<Vec<T>>> = tops.map(made).collect();
            for (band, of_band) in bands.into_iter().enumerate() {
                for (plane, values) in planes.iter_mut().zip(of_band) {
                    plane.data_mut().iter_mut().skip(band * pixels).zip(values).for_each(|(to, value)| *to = value);
                }
            }
            return planes;
        }
        let mut out = Plane::new(width, height, unknown);
        out.data_mut().par_chunks_mut(pixels).zip(tops).for_each(|(out, top)| {
            let made = made(top);
            for (i, value) in out.iter_mut().enumerate() {
                let (x, y) = (i as u32 % width, top + i as u32 / width);
                let kind = if made.len() == 1 { 0 } else { self.response.kind(x, y) };
                *value = made[kind][i];
            }
        });
        vec![out]
    }

    /// The noise of each pixel from its own samples, where they determine it, in front of the lens.
    pub fn pixel_noise(&self) -> PixelNoises {
        PixelNoises(self.by_bands((PixelNoise::UNKNOWN, f32::INFINITY), self.blur.is_some(), |evidence, rows| {
            let width = evidence.width() as usize;
            let pixels = rows.start as usize * width..rows.end as usize * width;
            let noise = pixel_noise(evidence, rows);
            noise.iter().zip(pixels).map(|(noise, pixel)| (*noise, moments(evidence, pixel, noise))).collect()
        }))
    }

    /// Variances of the means.
    fn variances_of(&self, noise: &Plane<PixelNoise>) -> Plane<f32> {
        let mut counts = self.counts.data().iter();
        noise.map(|noise| noise.of_mean(counts.next().copied().unwrap_or(0)))
    }

    /// Variances of the means in front of the lens, and those of the first moments, times 12.
    fn variances_before(&self, noise: &Plane<(PixelNoise, f32)>) -> [Plane<f32>; 2] {
        [self.variances_of(&noise.map(|(noise, _)| *noise)), noise.map(|(_, moments)| *moments)]
    }

    /// The noise of each pixel behind the lens. A sample there stands for one of its pixel together with those of the neighbours.
    pub fn behind_lens(&self, PixelNoises(kinds): &PixelNoises) -> Plane<PixelNoise> {
        let (width, height) = (self.mean.width(), self.mean.height());
        let Some((blur, shares)) = &self.blur else {
            let unknown = || Plane::new(width, height, PixelNoise::UNKNOWN);
            return kinds.first().map_or_else(unknown, |noise| noise.map(|(noise, _)| *noise));
        };
        let of_kind = |(noise, shares): (&Plane<(PixelNoise, f32)>, &[f64; 3])| {
            let [variance, moments] = self.variances_before(noise);
            blur.variance(&variance, &moments, *shares)
        };
        let behind: Vec<Plane<f32>> = kinds.iter().zip(shares).map(of_kind).collect();
        Plane::from_fn(width, height, |x, y| {
            let kind = if kinds.len() == 1 { 0 } else { self.response.kind(x, y) };
            let (mean, count) = (kinds[kind].at(x, y).0.mean, *self.counts.at(x, y));
            PixelNoise { variance: *behind[kind].at(x, y) * count as f32, mean }
        })
    }

    /// The share of blocks of [`LensBlur::BLOCK`] squared pixels whose mean has a noise of at most `k` times that of the sensor's,
    /// in \[0, 1\]. Blocks with a saturated pixel do not count. `None` without a sensor, and without a lens that blurs: then the
    /// noise of neighbours is independent, and the ratio of a block is that of its pixels.
    fn hidden_blocks(&self, PixelNoises(kinds): &PixelNoises, k: f64) -> Option<f64> {
        let (sensor, (blur, shares)) = (self.sensor?, self.blur.as_ref()?);
        // Behind a filter array a block has pixels of all kinds: that of green counts.
        let kind = kinds.len() / 2;
        let [variances, moments] = self.variances_before(&kinds[kind]);
        let blocks = blur.variance_of_blocks(&variances, &moments, shares[kind]);
        let side = LensBlur::BLOCK;
        let (columns, rows) = (self.mean.width() / side, self.mean.height() / side);
        let (mut counted, mut hidden) = (0u64, 0u64);
        for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x * side, y * side))) {
            let pixels = (0..side * side).map(|i| (x + i % side, y + i / side));
            let of_pixels = pixels.map(|(x, y)| {
                let (mean, render) = (f64::from(*self.mean.at(x, y)), f64::from(*variances.at(x, y)));
                (!sensor.is_saturated(mean, render)).then(|| sensor.variance(mean))
            });
            let Some(of_sensor) = of_pixels.sum::<Option<f64>>() else { continue };
            counted += 1;
            let of_sensor = of_sensor / f64::from(side * side).powi(2);
            hidden += u64::from(f64::from(*blocks.at(x, y)) <= k * k * of_sensor);
        }
        Some(if counted == 0 { 1.0 } else { hidden as f64 / counted as f64 })
    }

    /// The noise of each pixel from its own samples, with and without rare samples, in front of the lens.
    pub fn pixel_variances(&self) -> Plane<PixelVariance> {
        let mut planes = self.by_bands(PixelVariance::UNKNOWN, false, |evidence, rows| {
            let outliers = self.sensor.and_then(|sensor| outliers(evidence, sensor));
            let width = evidence.width() as usize;
            let pixels = rows.start as usize * width..rows.end as usize * width;
            let all = pixel_noise(evidence, rows.clone());
            let others = outliers.as_ref().map(|is_rare| {
                let mut others = evidence.clone();
                let variances = others.variance.data_mut().iter_mut().zip(is_rare.data());
                variances.filter(|(_, is_rare)| **is_rare).for_each(|(v, _)| *v = f32::INFINITY);
                pixel_noise(&others, rows)
            });
            let own = evidence.variance.data()[pixels.clone()].iter().zip(&evidence.counts.data()[pixels.clone()]);
            let of_pixel = |(i, (all, (own, &count))): (usize, (&PixelNoise, (&f32, &u32)))| {
                let is_rare = outliers.as_ref().is_some_and(|outliers| outliers.data()[pixels.start + i]);
                let without = others.as_ref().filter(|_| !is_rare).map_or(all, |others| &others[i]);
                let variance = if own.is_finite() { without.of_mean(count) } else { f32::INFINITY };
                PixelVariance { noise: *all, moments: moments(evidence, pixels.start + i, all), is_rare, variance }
            };
            all.iter().zip(own).enumerate().map(of_pixel).collect()
        });
        planes.pop().unwrap_or_else(|| Plane::new(0, 0, PixelVariance::UNKNOWN))
    }

    /// Samples that each pixel needs to be hidden at `k`, for the given noise; `None` without a sensor.
    pub fn needs_by(&self, noise: &PixelNoises, k: f64) -> Option<RequiredSamples> {
        self.sensor.map(|sensor| required_samples(&self.mean, &self.counts, &self.behind_lens(noise), sensor, k))
    }

    /// Certifies at `k`; `None` without a sensor.
    pub fn certify(&self, k: f64) -> Option<Certified> {
        self.certify_by(&self.pixel_noise(), k)
    }

    /// The certificate at `k` from given [`Self::pixel_noise`].
    pub fn certify_by(&self, noise: &PixelNoises, k: f64) -> Option<Certified> {
        let variances = self.variances_of(&self.behind_lens(noise));
        let mut certified = certify_variances(&self.mean, self.sensor?, variances.data().iter().copied(), k);
        certified.certificate.hidden_blocks = self.hidden_blocks(noise, k);
        Some(certified)
    }

    /// The variance of the mean of each pixel behind the lens, as the certificate uses it. Infinite where it is unknown.
    pub fn variances_of_mean(&self) -> Plane<f32> {
        self.variances_of(&self.behind_lens(&self.pixel_noise()))
    }
}

/// The certificate at `k` from the mean electrons of each pixel and the variances of these means [e^-2], row by row.
pub fn certify_variances(
    mean: &Plane<f32>,
    sensor: SensorNoise,
    variances: impl Iterator<Item = f32>,
    k: f64,
) -> Certified {
    let (width, height) = (mean.width(), mean.height());
    let mut left_out = Vec::with_capacity(mean.data().len());
    let claims = variances.zip(mean.data()).map(|(render, &mean)| {
        let saturated = sensor.is_saturated(f64::from(mean), f64::from(render));
        left_out.push(saturated);
        Claim { render, sensor: sensor.variance(f64::from(mean)) as f32, saturated }
    });
    let (certificate, ratios) = certify_pixels([width, height], claims, k);
    Certified { certificate, ratios, saturated: Plane::of_pixels(width, height, left_out) }
}

/// A sample is rare if it raises its pixel by more than this number of standard deviations of the sensor, so that it is
/// visible in a single frame ...
const MIN_VISIBLE_RISE: f64 = 1.0;

/// ... and by more than this number of them above the other samples of the pixel. A pixel may be brighter than its
/// neighbours without any noise.
const MIN_RISE_OVER_PIXEL: f64 = 0.5;

/// Pixels with a sample that raises them that far above the mean of their neighbourhood. The other samples of the pixel
/// hardly influence the decision, so that the remaining samples are distributed like bounded samples. `None` if there is
/// none.
fn outliers(evidence: &NoiseInputs, sensor: SensorNoise) -> Option<Plane<bool>> {
    let (width, height) = (evidence.width(), evidence.height());
    let is_rare = |x: u32, y: u32| {
        let (n, largest) = (*evidence.counts.at(x, y), *evidence.largest.at(x, y));
        let lift = |mean: f32| f64::from(largest - mean) / f64::from(n.max(1));
        // Relative to the mean of the other samples. The noise of a single sample is unknown anyway.
        let lift_of_own = f64::from(largest - evidence.mean.at(x, y)) / f64::from(n.max(2) - 1);
        let seen = |mean: f32| MIN_VISIBLE_RISE * sensor.variance(f64::from(mean)).sqrt();
        let is_above = |mean: f32| {
            let seen = seen(mean);
            lift(mean) > seen && lift_of_own > MIN_RISE_OVER_PIXEL * seen
        };
        // A neighbourhood with more light has a higher threshold. That of most pixels need not be known.
        is_above(0.0) && is_above(pooled_pixel(evidence, x, y).mean)
    };
    let rows: Vec<Vec<bool>> =
        (0..height).into_par_iter().map(|y| (0..width).map(|x| is_rare(x, y)).collect()).collect();
    let outliers = Plane::of_pixels(width, height, rows.concat());
    outliers.data().contains(&true).then_some(outliers)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_film::{Accumulate, PixelSums, Sample};
    use dunkelfeld_sampling::mix64;

    /// The share at a level is that of a certificate at this level. Means are at both sides of saturation, some of them
    /// not beyond doubt: these count.
    #[test]
    fn the_share_at_a_level_is_that_of_its_certificate() {
        let (width, height, n) = (32, 8, 16u32);
        let sensor = SensorNoise { floor: 10.0, saturation: 1000.0 };
        // The standard deviation of a mean is 20 e, so that doubt ends at 1060 e: three of them above saturation.
        let mean = Plane::from_fn(width, height, |x, y| 700.0 + 30.0 * x as f32 + y as f32);
        let noise = PixelNoise { variance: 400.0 * n as f32, ..PixelNoise::UNKNOWN };
        let response = Response::constant(Weights([1.0; 3]));
        let views = |_: Range<u32>| Vec::new();
        let measured =
            FilmNoise::from_estimates(mean.clone(), Plane::new(width, height, n), views, response, Some(sensor));
        let at = |k: f64| {
            // One pixel has no variance.
            let noise =
                Plane::from_fn(width, height, |x, y| if (x, y) == (3, 0) { PixelNoise::UNKNOWN } else { noise });
            measured.certify_by(&noise.map(|&noise| (noise, 0.0)).into(), k).expect("a sensor")
        };
        let certified = at(0.5);
        let beyond = mean.data().iter().filter(|&&m| m > 1060.0).count() as u64;
        let above = mean.data().iter().filter(|&&m| m > 1000.0).count() as u64;
        assert!(0 < beyond && beyond < above);
        assert_eq!(certified.certificate.saturated, beyond);
        assert_eq!(certified.counted().count() as u64, certified.certificate.pixels);
        let mut shares = Vec::new();
        for k in [0.1, 0.62, 0.65, 0.7, 0.74, 2.0] {
            assert_eq!(certified.hidden_at(k), at(k).certificate.hidden, "{k}");
            shares.push(certified.hidden_at(k));
        }
        assert!(shares[0] == 0.0 && shares[1] < shares[4] && (0.9..1.0).contains(&shares[5]), "{shares:?}");
    }

    /// Green and blue columns. Their noise is equal for a sensor that counts all light alike. Green light has ten times
    /// the luminance of blue light, which must not separate the columns.
    #[test]
    fn predictions_from_neighbours_of_other_colours_use_the_response_of_the_sensor() {
        let (width, height, count) = (24, 24, 64u32);
        let mut sums = vec![PixelSums::default(); (width * height) as usize];
        let mut state = 7u64;
        for (pixel, sums) in sums.iter_mut().enumerate() {
            for index in 0..count {
                state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
                let value = (mix64(state) >> 40) as f32 / (1u32 << 24) as f32;
                let radiance = if pixel % 2 == 0 { Rgb::new(0.0, value, 0.0) } else { Rgb::new(0.0, 0.0, value) };
                sums.add(index, &Sample { radiance, ..Sample::MISS });
            }
        }
        let mut film = Film::new(width, height);
        film.add_rows(0, &sums).expect("memory");
        let response = Response::constant(Weights([1000.0; 3]));
        let sensor = Some(SensorNoise { floor: 10.0, saturation: 1e5 });
        let film = RenderedFilm::without_ids(film);
        let measured = FilmNoise::new(&SignalModel { response, white: 1e5, sensor }, &film);
        let own = measured.behind_lens(&measured.pixel_noise());
        for colour in 0..2 {
            let noise: Vec<f64> = own.data().iter().skip(colour).step_by(2).map(|n| f64::from(n.variance)).collect();
            let ratio = noise.iter().sum::<f64>() / noise.len() as f64 / (1e6 / 12.0);
            // From the batches of 576 pixels: the standard error is 3.4 %.
            assert!((0.8..1.2).contains(&ratio), "colour {colour}: {ratio}");
        }
    }
}
