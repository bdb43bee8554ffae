//! The noise of a film as the sensor sees it: what plans are made from, and what is certified.

use crate::develop::{Frame, SensorFrame};
use crate::parallel::par_map;
use crate::settings::SensorChoice;
use dunkelfeld_adaptive::certificate::{Certificate, Claim, certify as certify_planes, ratios};
use dunkelfeld_adaptive::evidence::{Evidence, Level, Surface, surfaces};
use dunkelfeld_adaptive::expected::{Expected, expected_row, told};
use dunkelfeld_adaptive::need::{DEFAULT_TARGET, Needs, SensorNoise, needs};
use dunkelfeld_adaptive::own::{BLOCK, own_noise_of_blocks};
use dunkelfeld_adaptive::pooling::{PixelNoise, noise_row};
use dunkelfeld_film::{Film, PixelSums, Plane, Scatter};
use dunkelfeld_integrator::Label;
use dunkelfeld_radiometry::{Rgb, Seconds};
use dunkelfeld_sensor::{Exposure, Response, SensorError, SensorModel, Weights, auto_exposure};
use rayon::prelude::*;

/// How radiance counts: the unit in which noise is measured.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eye {
    /// Electrons per radiance and channel of each pixel; luminance without a sensor.
    response: Response,
    /// Level at which it saturates, in that unit.
    pub(crate) white: f32,
    /// The sensor's own noise, if there is a sensor.
    pub(crate) sensor: Option<SensorNoise>,
}

impl Eye {
    /// The sensor at its exposure, or the luminance of an image without one. A black image, which has no automatic
    /// exposure, is exposed for 1 s, as [`crate::develop`] does.
    ///
    /// # Errors
    /// A sensor whose ranges the exposure leaves.
    pub(crate) fn of(mean: &Plane<[f32; 3]>, sensor: &SensorChoice) -> Result<Self, SensorError> {
        let SensorChoice::Emva { model, optics, exposure } = sensor else {
            return Ok(Self { response: Response::constant(Weights::luminance()), white: 1.0, sensor: None });
        };
        let exposure = match exposure.map_or_else(|| auto_exposure(mean, model, optics), Ok) {
            Err(SensorError::NoLight) => Exposure::new(Seconds(1.0))?,
            other => other?,
        };
        Ok(Self {
            response: Response::new(model, optics, exposure),
            white: model.saturation().0 as f32,
            sensor: Some(sensor_noise(model, exposure)),
        })
    }

    /// The mean image in this unit, without the mosaic of a filter array: its edges are none of the scene's.
    pub(crate) fn image(&self, mean: &Plane<[f32; 3]>) -> Plane<f32> {
        let weights = self.response.average();
        mean.map(|&pixel| weights.electrons(pixel).0 as f32)
    }

    /// What the film knows of every pixel, seen through pixels of one kind, on the threads of the current pool.
    fn evidence(&self, film: &Film, surface: &Plane<Surface>, weights: Weights) -> Evidence {
        let moments = par_map(film.pixels(), |p| p.weighted_mean_and_variance(weights.0));
        // A film remembers the luminance of its largest sample; its colour is taken for that of the pixel.
        let largest = |p: &PixelSums| (per_luminance(weights, p.mean()).0 * f64::from(p.max_luminance())) as f32;
        let scatter = |p: &PixelSums| p.scatter().map(|s| seen(s, per_luminance(weights, p.mean()).0));
        let (mean, variance) = (moments.map(|m| m.0 as f32), moments.map(|m| m.1 as f32));
        Evidence {
            counts: par_map(film.pixels(), PixelSums::count),
            level: levels(&mean, &variance, self.sensor),
            mean,
            variance,
            scatter: par_map(film.pixels(), scatter),
            largest: par_map(film.pixels(), largest),
            surface: surface.clone(),
        }
    }
}

/// Signal per luminance of light of this colour, and its luminance.
pub(crate) fn per_luminance(weights: Weights, [r, g, b]: [f64; 3]) -> (f64, f64) {
    let luminance = f64::from(Rgb::new(r as f32, g as f32, b as f32).luminance());
    let signal = weights.electrons([r, g, b].map(|v| v as f32)).0;
    (if luminance > 0.0 { signal / luminance } else { 0.0 }, luminance)
}

/// Scatter of luminance as that of a signal.
pub(crate) fn seen(scatter: Scatter, per_luminance: f64) -> Scatter {
    let square = per_luminance * per_luminance;
    Scatter { all: square * scatter.all, largest: square * scatter.largest }
}

/// The noise that a sensor adds to a frame of the given exposure.
pub(crate) fn sensor_noise(model: &SensorModel, exposure: Exposure) -> SensorNoise {
    SensorNoise {
        floor: model.temporal_variance(dunkelfeld_radiometry::Electrons(0.0), exposure.time()),
        // Dark electrons fill the well, too.
        saturation: (model.saturation().0 - model.dark_electrons(exposure.time()).0).max(0.0),
    }
}

/// How bright pixels are for a sensor; without one all are alike.
pub(crate) fn levels(mean: &Plane<f32>, variance: &Plane<f32>, sensor: Option<SensorNoise>) -> Plane<Level> {
    let mut variances = variance.data().iter();
    mean.map(|&mean| match (sensor, variances.next()) {
        (Some(sensor), Some(&variance)) if variance.is_finite() => sensor.level(mean, variance),
        _ => Level::ANY,
    })
}

/// [`dunkelfeld_adaptive::pooling::noise`], rows shared out among the threads of the current pool.
fn pooled(evidence: &Evidence) -> Plane<PixelNoise> {
    let unknown = evidence.mean.map(|_| PixelNoise::UNKNOWN);
    if is_unknown(evidence) { unknown } else { by_rows(unknown, |y| noise_row(evidence, y)) }
}

/// [`dunkelfeld_adaptive::own::own_noise`], likewise.
fn owned(evidence: &Evidence) -> Plane<PixelNoise> {
    let unknown = evidence.mean.map(|_| PixelNoise::UNKNOWN);
    let blocks = evidence.height().div_ceil(BLOCK);
    if is_unknown(evidence) { unknown } else { by_parts(unknown, blocks, |row| own_noise_of_blocks(evidence, row)) }
}

/// Is there a sample a pixel, or none? Then there is nothing to pool, and no time to lose with it.
fn is_unknown(evidence: &Evidence) -> bool {
    evidence.variance.data().par_iter().all(|v| !v.is_finite())
}

/// A plane like another, its rows made on the threads of the current pool.
fn by_rows<T: Clone + Send>(like: Plane<T>, row: impl Fn(u32) -> Vec<T> + Send + Sync) -> Plane<T> {
    let height = like.height();
    by_parts(like, height, row)
}

/// The same of parts of one or more rows each.
fn by_parts<T: Clone + Send>(like: Plane<T>, parts: u32, part: impl Fn(u32) -> Vec<T> + Send + Sync) -> Plane<T> {
    let parts: Vec<Vec<T>> = (0..parts).into_par_iter().map(part).collect();
    Plane::from_vec(like.width(), like.height(), parts.concat()).unwrap_or(like)
}

/// A certificate together with what it rests on.
#[derive(Clone, Debug, PartialEq)]
pub struct Certified {
    /// The certificate.
    pub certificate: Certificate,
    /// Variance of the rendered mean over that of the sensor, per pixel: the layer `hidden.Y`. Infinite where it is not known.
    pub ratios: Plane<f32>,
}

/// What is known of a film's noise beneath a sensor's.
pub(crate) struct Measured {
    pub(crate) evidence: Evidence,
    pub(crate) sensor: Option<SensorNoise>,
    /// Behind a filter array: the film as red, green and blue pixels everywhere would see it. Neighbours tell of each other's
    /// noise only if they see the same, so each pixel is judged in the view of its own colour.
    views: Vec<Evidence>,
    response: Response,
}

impl Measured {
    pub(crate) fn new(eye: &Eye, film: &Film, labels: &Plane<Option<Label>>) -> Self {
        let normals = par_map(film.pixels(), PixelSums::mean_normal);
        let surface = surfaces(&labels.map(|l| l.map_or(u32::MAX, |l| l.object)), &normals);
        let views = eye.response.kinds().iter().map(|&weights| eye.evidence(film, &surface, weights)).collect();
        Self::of(views, eye.response, eye.sensor)
    }

    /// Of the views through each kind of pixel.
    pub(crate) fn of(mut views: Vec<Evidence>, response: Response, sensor: Option<SensorNoise>) -> Self {
        if views.len() == 1
            && let Some(evidence) = views.pop()
        {
            return Self { evidence, sensor, views, response };
        }
        let evidence = Evidence {
            counts: views[0].counts.clone(),
            mean: woven(&response, |kind| &views[kind].mean),
            variance: woven(&response, |kind| &views[kind].variance),
            scatter: woven(&response, |kind| &views[kind].scatter),
            largest: woven(&response, |kind| &views[kind].largest),
            surface: views[0].surface.clone(),
            level: woven(&response, |kind| &views[kind].level),
        };
        Self { evidence, sensor, views, response }
    }

    /// What is expected of each pixel by its neighbours: what plans are made from. Judged by the sensor's noise, or alike everywhere.
    pub(crate) fn expected(&self, sensor: Option<SensorNoise>) -> Plane<Expected> {
        let unknown = Expected { ratio: f32::INFINITY, saturated: false };
        self.by_kind(|evidence| {
            let told = told(evidence, sensor);
            by_rows(told.map(|_| unknown), |y| expected_row(&evidence.surface, &told, y))
        })
    }

    /// Of a film that is exposed like this.
    pub(crate) fn exposed(
        response: Response,
        model: &SensorModel,
        exposure: Exposure,
        film: &Film,
        labels: &Plane<Option<Label>>,
    ) -> Self {
        let (white, sensor) = (model.saturation().0 as f32, Some(sensor_noise(model, exposure)));
        Self::new(&Eye { response, white, sensor }, film, labels)
    }

    /// What a function makes of the film as each kind of pixel sees it, every pixel's value from the view of its own.
    fn by_kind<T: Copy>(&self, f: impl Fn(&Evidence) -> Plane<T>) -> Plane<T> {
        if self.views.is_empty() {
            return f(&self.evidence);
        }
        let made: Vec<_> = self.views.iter().map(f).collect();
        woven(&self.response, |kind| &made[kind])
    }

    /// The noise of each pixel by its own samples, as far as they can tell.
    pub(crate) fn owned(&self) -> Plane<PixelNoise> {
        self.by_kind(owned)
    }

    /// Of each pixel: does it hold a rare sample, and the variance of its mean \[e-^2\], without what pixels that hold one
    /// would tell their neighbours. Without a sensor no sample is rare.
    pub(crate) fn without_rare(&self) -> Plane<(bool, f32)> {
        self.by_kind(|evidence| {
            let rare = match self.sensor {
                None => evidence.mean.map(|_| false),
                Some(sensor) => rare(evidence, &pooled(evidence), sensor),
            };
            let mut variances = told_without(evidence, &rare).into_vec().into_iter();
            rare.map(|&rare| (rare, variances.next().unwrap_or(f32::INFINITY)))
        })
    }

    /// What each pixel needs to be hidden at `k` by such noise; `None` without a sensor.
    pub(crate) fn needs_by(&self, noise: &Plane<PixelNoise>, k: f64) -> Option<Needs> {
        self.sensor.map(|sensor| needs(&self.evidence, noise, sensor, k))
    }

    /// Certifies at `k`; `None` without a sensor.
    pub(crate) fn certify(&self, k: f64) -> Option<Certified> {
        self.certify_by(&self.owned(), k)
    }

    /// The same if the [`Self::owned`] noise is at hand.
    pub(crate) fn certify_by(&self, noise: &Plane<PixelNoise>, k: f64) -> Option<Certified> {
        let sensor = self.sensor?;
        let (width, height) = (self.evidence.width(), self.evidence.height());
        let counts = self.evidence.counts.data();
        let render: Vec<f32> = noise.data().iter().zip(counts).map(|(noise, &n)| noise.of_mean(n)).collect();
        let saturated = |(&mean, &v): (&f32, &f32)| sensor.is_saturated(f64::from(mean), f64::from(v));
        let saturated: Vec<bool> = self.evidence.mean.data().iter().zip(&render).map(saturated).collect();
        let render = Plane::from_vec(width, height, render)?;
        let saturated = Plane::from_vec(width, height, saturated)?;
        let freedom = noise.map(|n| n.freedom);
        let own = self.evidence.mean.map(|&mean| sensor.variance(f64::from(mean)) as f32);
        let claim = Claim { render: &render, sensor: &own, freedom: &freedom, saturated: &saturated };
        Some(Certified { certificate: certify_planes(&claim, k), ratios: ratios(&claim) })
    }
}

/// Certifies a frame: how well the noise of the film that it was exposed from is hidden beneath the sensor's, at `k` or, if
/// that is `None`, at [`DEFAULT_TARGET`]. Without a sensor nothing happens. Runs on the threads of the current pool.
pub fn certify(frame: &mut Frame, film: &Film, labels: &Plane<Option<Label>>, k: Option<f64>) {
    if let Some(sensor) = &mut frame.sensor {
        sensor.certified = certified(sensor, film, labels, k.unwrap_or(DEFAULT_TARGET));
    }
}

fn certified(frame: &SensorFrame, film: &Film, labels: &Plane<Option<Label>>, k: f64) -> Option<Certified> {
    Measured::exposed(frame.response, &frame.model, frame.exposure, film, labels).certify(k)
}

/// A sample is rare if it lifts its pixel by more of the sensor's standard deviations, so that it is seen in a single frame ...
const SEEN: f64 = 1.0;

/// ... and, because a pixel may be brighter than those around without any noise, by half as many above its own other samples.
const OWN: f64 = 0.5;

/// Which pixels hold a sample that lifts them by so much above the mean of their neighbourhood. What counts as rare depends little
/// on the pixel's other samples: those that are left scatter as samples do that are bounded.
fn rare(evidence: &Evidence, noise: &Plane<PixelNoise>, sensor: SensorNoise) -> Plane<bool> {
    let mut samples = evidence.counts.data().iter().zip(evidence.largest.data()).zip(evidence.mean.data());
    noise.map(|around| {
        samples.next().is_some_and(|((&n, &largest), &own)| {
            let seen = SEEN * sensor.variance(f64::from(around.mean)).sqrt();
            let lift = f64::from(largest - around.mean) / f64::from(n.max(1));
            // Above the mean of the others; a lone sample's noise is not known anyway.
            let lift_of_own = f64::from(largest - own) / f64::from(n.max(2) - 1);
            lift > seen && lift_of_own > OWN * seen
        })
    })
}

/// The variance of the mean of each pixel \[e-^2\] by its own samples; what any of them might have seen is told by those that hold no
/// rare one.
fn told_without(evidence: &Evidence, is_rare: &Plane<bool>) -> Plane<f32> {
    let mut others = evidence.clone();
    let variances = others.variance.data_mut().iter_mut();
    variances.zip(is_rare.data()).filter(|(_, rare)| **rare).for_each(|(v, _)| *v = f32::INFINITY);
    let mut told = owned(&others);
    if is_rare.data().contains(&true) {
        let all = owned(evidence);
        let pixels = told.data_mut().iter_mut().zip(all.data()).zip(is_rare.data());
        pixels.filter(|(_, rare)| **rare).for_each(|((told, all), _)| *told = *all);
    }
    let mut counts = evidence.counts.data().iter();
    told.map(|noise| noise.of_mean(counts.next().copied().unwrap_or(0)))
}

/// Of the planes of each kind of pixel, every pixel's value from that of its own kind.
fn woven<'a, T: Copy + 'a>(response: &Response, planes: impl Fn(usize) -> &'a Plane<T>) -> Plane<T> {
    let (width, height) = (planes(0).width(), planes(0).height());
    Plane::from_fn(width, height, |x, y| *planes(response.kind(x, y)).at(x, y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_film::Sample;
    use dunkelfeld_sampling::mix64;

    /// Green and blue columns, as noisy as each other for a sensor that counts all light alike: luminance, of which green light has ten
    /// times as much, must not tell them apart.
    #[test]
    fn neighbours_of_other_colours_have_the_noise_that_the_sensor_sees() {
        let (width, height, count) = (24, 24, 64u32);
        let mut film = Film::new(width, height);
        let mut state = 7u64;
        for pixel in 0..(width * height) as usize {
            for index in 0..count {
                state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
                let value = (mix64(state) >> 40) as f32 / (1u32 << 24) as f32;
                let radiance = if pixel % 2 == 0 { Rgb::new(0.0, value, 0.0) } else { Rgb::new(0.0, 0.0, value) };
                film.add(pixel, index, &Sample { radiance, ..Sample::MISS });
            }
        }
        let response = Response::constant(Weights([1000.0; 3]));
        let sensor = Some(SensorNoise { floor: 10.0, saturation: 1e5 });
        let measured = Measured::new(&Eye { response, white: 1e5, sensor }, &film, &Plane::new(width, height, None));
        let own = measured.owned();
        for colour in 0..2 {
            let noise: Vec<f64> = own.data().iter().skip(colour).step_by(2).map(|n| f64::from(n.variance)).collect();
            let ratio = noise.iter().sum::<f64>() / noise.len() as f64 / (1e6 / 12.0);
            // By the batches of 576 pixels: a standard error of 3.4 %.
            assert!((0.8..1.2).contains(&ratio), "colour {colour}: {ratio}");
        }
    }
}
