//! The statistics of a render, as data: the `--stats` file.

use crate::frame::Frame;
use crate::outliers::{HeavyPiece, heaviest};
use dunkelfeld_adaptive::budget::StopReason;
use dunkelfeld_adaptive::certificate::Certificate;
use dunkelfeld_film::PixelSums;
use dunkelfeld_render::ForecastLevel;
use dunkelfeld_render::Rendering;
use dunkelfeld_render::Stage;
use dunkelfeld_render::film_noise::Certified;
use dunkelfeld_render::parallel::fold_tile_rows;
use dunkelfeld_render::{RenderSettings, SensorChoice};
use serde::Serialize;
use std::collections::BTreeMap;

pub use crate::memory::MemoryStats;
pub use crate::outliers::HeavySample;

/// Version of the schema. It increases with every change that a reader must handle; new fields alone do not count.
pub const STATS_VERSION: u32 = 3;

/// The statistics of a render. Field names, also those of the parts, are the keys of one JSON object; times are seconds,
/// radiances W/(m^2 sr).
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Stats {
    /// Version of this schema.
    pub version: u32,
    /// Version of the program.
    pub program: String,
    /// The render.
    #[serde(flatten)]
    pub run: RunStats,
    /// Its samples.
    #[serde(flatten)]
    pub sampling: SamplingStats,
    /// Its time.
    #[serde(flatten)]
    pub time: TimeStats,
    /// The sensor, if there is one.
    pub sensor: Option<SensorStats>,
    /// The forecast of the pilot, and its error. `null` without a sensor, or without a plan.
    pub forecast: Option<Vec<ForecastLevel>>,
    /// The certificate: ratio of the render's noise to the sensor's; `null` without a sensor.
    pub certificate: Option<CertificateStats>,
    /// The denoiser, if one was set. No other field depends on its image.
    pub denoise: Option<DenoiseStats>,
    /// The account of memory, and the measured memory; `None` if the render was not one of a [project](crate::Project)
    /// or a merge.
    pub memory: Option<MemoryStats>,
}

/// The render that made the image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunStats {
    /// Width and height of the film \[pixels\].
    pub size: [u32; 2],
    /// Name of the camera; `None` for a merge, whose parts do not contain it.
    pub camera: Option<String>,
    /// Name of the capture; `None` for the image of all lights.
    pub capture: Option<String>,
    /// Seed of the render.
    pub seed: u64,
    /// Frame number.
    pub frame: u32,
    /// Number of training paths of the learned Russian roulette; 0 without it.
    pub training_paths: u32,
    /// Threads that rendered.
    pub threads: usize,
    /// Allocation of the samples: name of the strategy, or `replay`.
    pub allocation: String,
    /// The limit that ended the render: `time`, `samples`, `noise` or `interrupted`.
    pub stop: String,
    /// Names of effects that were left out on purpose.
    pub without: Vec<String>,
}

/// The samples of an image, and their mean.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SamplingStats {
    /// Samples of the whole image.
    pub samples: u64,
    /// Mean samples per pixel.
    pub mean_spp: f64,
    /// Smallest and largest number of samples of a pixel.
    pub spp_range: [u32; 2],
    /// Pixels without a sample. In the picture they are filled from their neighbours; in the EXR they are black with
    /// `spp.Y` 0.
    pub pixels_without_samples: u64,
    /// Pixels with samples of which none has light.
    pub black_pixels: u64,
    /// Samples per second while rendering.
    pub samples_per_second: f64,
    /// Samples that were not finite, negative or out of range. They count as black.
    pub invalid_samples: u64,
    /// The first invalid sample as `x,y,sample`: the value of `--debug-sample`.
    pub invalid_named: Vec<String>,
    /// The samples that raise their pixels most above the mean of the others, the heaviest first, at most 8.
    pub heaviest_samples: Vec<HeavySample>,
    /// Pixels that a single sample dominates: [`HeavySample::dominates`].
    pub dominated_pixels: u64,
    /// Connections through clear covers; `None` if none was attempted.
    pub cover_connections: Option<CoverStats>,
    /// Mean radiance of the image per channel.
    pub mean_radiance: [f64; 3],
    /// Standard error of that mean per channel; `null` where fewer than two batches of samples exist.
    pub mean_radiance_standard_error: [Option<f64>; 3],
}

/// The time that an image took, and its parts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TimeStats {
    /// Seconds by stage: `load`, `build`, `pilot`, `plan`, `refine`, `expose`, `denoise`, `write`.
    pub seconds: BTreeMap<String, f64>,
    /// Wall-clock seconds of the whole command, and the limit if there was one. The sum includes earlier processes of a
    /// render that continued from a checkpoint, and the processes that rendered the parts of a merged one.
    pub total_seconds: f64,
    /// Seconds of earlier processes; part of the total.
    pub earlier_seconds: f64,
    /// The samples from a checkpoint or from parts.
    pub earlier_samples: u64,
    /// The merged parts, ordered by their first samples; `None` for a render without parts.
    pub parts: Option<Vec<PartStats>>,
    /// The time budget.
    pub budget_seconds: Option<f64>,
    /// Was the time budget missed by more than 2 % and 0.2 s?
    pub budget_missed: bool,
    /// Did a checkpoint contain all samples? Then the later steps missed no budget.
    #[serde(skip)]
    pub was_complete: bool,
}

/// The result of denoising.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DenoiseStats {
    /// Name and version of the denoiser.
    pub denoiser: String,
    /// Seconds of denoising, also of a denoiser that did not finish.
    pub seconds: f64,
    /// The reason for a missing denoised image. The picture shows the rendered mean then.
    pub error: Option<String>,
}

/// A part of a merged render.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartStats {
    /// Its file.
    pub file: String,
    /// Index of its first sample in every pixel, and of the first sample after it.
    pub range: [u32; 2],
    /// Samples of the whole image.
    pub samples: u64,
    /// Seconds of rendering it.
    pub seconds: f64,
}

/// The certificate ([`dunkelfeld_adaptive::certificate`]): ratios are the variance of a pixel's rendered mean over the
/// temporal variance of the sensor there, over the pixels that are not saturated.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct CertificateStats {
    /// The level that is certified: standard deviation of the render's noise over that of the sensor's.
    pub k: f64,
    /// Is the render hidden at k: are 99 % of the unsaturated pixels, or the share that was set?
    pub is_hidden: bool,
    /// Share of the unsaturated pixels that are hidden at k.
    pub hidden: f64,
    /// The same share of the means of blocks of 8 x 8 pixels, behind a lens that blurs; otherwise `None`.
    pub hidden_blocks: Option<f64>,
    /// Level at which the render is hidden: the root of `ratio_p99`. The level and the ratios are `None` if the data
    /// does not suffice: pixels of unknown variance count as infinitely noisy in the quantiles.
    pub hidden_at: Option<f64>,
    /// Mean ratio.
    pub ratio_mean: Option<f64>,
    /// Median ratio.
    pub ratio_p50: Option<f64>,
    /// 99 % quantile of the ratios.
    pub ratio_p99: Option<f64>,
    /// Largest ratio.
    pub ratio_max: Option<f64>,
    /// Unsaturated pixels.
    pub pixels: u64,
    /// Saturated pixels.
    pub saturated: u64,
    /// Unsaturated pixels of unknown variance. They count as not hidden, and have no ratio.
    pub unknown: u64,
}

impl From<&Certificate> for CertificateStats {
    fn from(c: &Certificate) -> Self {
        let known = |ratio: f64| ratio.is_finite().then_some(ratio);
        Self {
            k: c.k,
            is_hidden: c.is_hidden(),
            hidden: c.hidden,
            hidden_blocks: c.hidden_blocks,
            hidden_at: known(c.p99.sqrt()),
            ratio_mean: known(c.mean),
            ratio_p50: known(c.median),
            ratio_p99: known(c.p99),
            ratio_max: known(c.max),
            pixels: c.pixels,
            saturated: c.saturated,
            unknown: c.unknown,
        }
    }
}

/// Statistics of the search for light through clear covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct CoverStats {
    /// Connections that were attempted: a receiver, a point of a light and the events at the interfaces between them,
    /// in order.
    pub attempts: u64,
    /// Connections whose chain the solver found.
    pub arrived: u64,
    /// Rays that the solver traced through covers: one for each plate, a few for each curved face.
    pub shots: u64,
}

/// The sensor's part of the statistics.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct SensorStats {
    /// Name of the sensor.
    pub name: String,
    /// Exposure time \[s\].
    pub exposure_seconds: f64,
    /// Mean expected photo-electrons per pixel.
    pub mean_electrons: f64,
    /// Mean grey value \[DN\].
    pub mean_value: f64,
    /// Share of pixels whose expected electrons fill the well or reach the end of the converter.
    pub saturated: f64,
    /// Was the image so dark that there is no automatic exposure?
    pub no_light: bool,
    /// Noise of the exposure: `plain` or `matched`.
    pub exposure_noise: String,
    /// Share of pixels where noise-matched exposure holds; `null` for `plain`.
    pub matched: Option<f64>,
}

/// Sums over all pixels.
#[derive(Clone, Copy, Default)]
struct Totals {
    /// Sum of the means, and of their variances.
    mean: [f64; 3],
    variance: [f64; 3],
    samples: u64,
    invalid: u64,
    /// Fewest and most samples of a pixel.
    range: Option<[u32; 2]>,
    /// Pixels without samples.
    without: u64,
    /// Pixels with samples of which none has light.
    black: u64,
}

impl Totals {
    /// Sums rows of tiles in their order, so that the sums are the same for any number of threads.
    fn from_pieces<'a>(pieces: impl Iterator<Item = &'a Self>) -> Self {
        pieces.fold(Self::default(), |all, piece| all.and(piece))
    }

    fn add(&mut self, p: &PixelSums) {
        let (n, means) = (p.count(), p.means());
        *self = self.and(&Self {
            mean: means.mean,
            variance: means.variance_and_covariance().0,
            samples: n.into(),
            invalid: p.invalid.into(),
            range: Some([n, n]),
            without: u64::from(n == 0),
            black: u64::from(n > 0 && means.mean == [0.0; 3]),
        });
    }

    fn and(self, other: &Self) -> Self {
        let sum = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| a[i] + b[i]);
        let range = match (self.range, other.range) {
            (Some(a), Some(b)) => Some([a[0].min(b[0]), a[1].max(b[1])]),
            (a, b) => a.or(b),
        };
        Self {
            mean: sum(self.mean, other.mean),
            variance: sum(self.variance, other.variance),
            samples: self.samples + other.samples,
            invalid: self.invalid + other.invalid,
            range,
            without: self.without + other.without,
            black: self.black + other.black,
        }
    }
}

impl Stats {
    /// Computes the statistics of a render, on the threads of the current pool. Stages and total time are set when they
    /// end.
    pub fn new(rendering: &Rendering, frame: &Frame, settings: &RenderSettings) -> Self {
        let film = &rendering.film.sums;
        // A large film takes seconds to read.
        let pieces = fold_tile_rows(film, |(totals, heavy): &mut (Totals, HeavyPiece), pixel, sums| {
            totals.add(sums);
            heavy.add(pixel, sums);
        });
        let totals = Totals::from_pieces(pieces.iter().map(|(totals, _)| totals));
        let heavy = heaviest(film, pieces.into_iter().map(|(_, heavy)| heavy).collect(), settings.run.rows);
        let n = film.pixels().max(1) as f64;
        let samples_were_taken = |stage: &Stage| matches!(stage, Stage::Pilot | Stage::Refine);
        let rendering_seconds: f64 =
            rendering.stages.iter().filter(|(stage, _)| samples_were_taken(stage)).map(|(_, s)| s).sum();
        let mut seconds = BTreeMap::new();
        for (stage, s) in &rendering.stages {
            *seconds.entry(stage.name().to_string()).or_insert(0.0) += s;
        }
        let samples = totals.samples;
        let run = RunStats {
            size: [film.width(), film.height()],
            capture: None,
            camera: settings.run.view.as_ref().map(|view| view.name.clone()).or(settings.camera.clone()),
            seed: settings.seed,
            frame: settings.frame,
            training_paths: settings.training_paths(),
            threads: rendering.threads,
            allocation: if settings.run.replay.is_some() { "replay".into() } else { settings.strategy().name().into() },
            stop: match (rendering.interrupted, rendering.stop) {
                (true, _) => "interrupted",
                (false, StopReason::Time) => "time",
                (false, StopReason::Samples) => "samples",
                (false, StopReason::NoiseTarget) => "noise",
            }
            .into(),
            without: settings.run.without.iter().map(|e| e.name().to_string()).collect(),
        };
        let sampling = SamplingStats {
            samples,
            mean_spp: samples as f64 / n,
            spp_range: totals.range.unwrap_or_default(),
            pixels_without_samples: totals.without,
            black_pixels: totals.black,
            samples_per_second: if rendering_seconds > 0.0 { samples as f64 / rendering_seconds } else { 0.0 },
            invalid_samples: totals.invalid,
            invalid_named: rendering.invalid.iter().map(|s| format!("{},{},{}", s.x, s.y, s.index)).collect(),
            heaviest_samples: heavy.samples,
            dominated_pixels: heavy.dominated,
            cover_connections: (rendering.connections.attempts > 0).then_some(CoverStats {
                attempts: rendering.connections.attempts,
                arrived: rendering.connections.converged,
                shots: rendering.connections.rays,
            }),
            mean_radiance: totals.mean.map(|s| s / n),
            mean_radiance_standard_error: totals.variance.map(|v| v.is_finite().then(|| v.sqrt() / n)),
        };
        let time = TimeStats {
            seconds,
            total_seconds: 0.0,
            earlier_seconds: rendering.earlier.seconds,
            earlier_samples: rendering.earlier.samples,
            parts: None,
            budget_seconds: settings.budget.seconds,
            budget_missed: false,
            was_complete: rendering.earlier.was_complete,
        };
        Self {
            version: STATS_VERSION,
            program: format!("dunkelfeld {}", env!("CARGO_PKG_VERSION")),
            run,
            sampling,
            time,
            sensor: sensor_stats(frame, settings),
            forecast: rendering.forecast.as_ref().map(|f| f.levels.clone()),
            certificate: certified(frame).map(|c| (&c.certificate).into()),
            denoise: None,
            memory: None,
        }
    }

    /// Records the seconds of a stage.
    pub fn add_seconds(&mut self, stage: Stage, seconds: f64) {
        *self.time.seconds.entry(stage.name().to_string()).or_insert(0.0) += seconds;
    }

    /// Records the result of denoising, and its seconds.
    pub fn add_denoising(&mut self, denoise: DenoiseStats) {
        self.add_seconds(Stage::Denoise, denoise.seconds);
        self.denoise = Some(denoise);
    }

    /// Sets the total time: that of this command, plus that of earlier processes.
    pub fn finish(&mut self, seconds: f64) {
        if let Some(memory) = &mut self.memory {
            memory.measure();
        }
        let total = self.time.earlier_seconds + seconds;
        self.time.total_seconds = total;
        if let (Some(forecast), "noise", Some(c)) = (&mut self.forecast, self.run.stop.as_str(), &self.certificate) {
            for level in forecast.iter_mut().filter(|level| level.k == c.k) {
                (level.actual_samples, level.actual_seconds) = (Some(self.sampling.samples as f64), Some(total));
            }
        }
        self.time.budget_missed = self.run.stop != "interrupted"
            && !self.time.was_complete
            && self.time.budget_seconds.is_some_and(|b| total > b + dunkelfeld_adaptive::budget::tolerance(b));
    }

    /// Does the result have a fault? A time budget that was missed is none: the image has only more samples.
    pub fn is_flagged(&self) -> bool {
        self.sampling.invalid_samples > 0 || self.budget_too_small() || self.denoising_failed()
    }

    /// Did the time limit end the render before every pixel had a sample?
    pub fn budget_too_small(&self) -> bool {
        self.run.stop == "time" && self.sampling.pixels_without_samples > 0
    }

    /// Was denoising set, is the image not denoised, and was the run not interrupted?
    pub fn denoising_failed(&self) -> bool {
        self.run.stop != "interrupted" && self.denoise.as_ref().is_some_and(|d| d.error.is_some())
    }

    /// The statistics as JSON text, which ends in a newline.
    pub fn to_json(&self) -> String {
        // Plain numbers and strings with string keys: serialisation cannot fail.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}

fn certified(frame: &Frame) -> Option<&Certified> {
    frame.sensor.as_ref()?.certified.as_ref()
}

fn sensor_stats(frame: &Frame, settings: &RenderSettings) -> Option<SensorStats> {
    let (SensorChoice::Emva { model, .. }, Some(sensor)) = (&settings.sensor, &frame.sensor) else { return None };
    let n = sensor.values.data().len().max(1) as f64;
    Some(SensorStats {
        name: model.spec().name.clone(),
        exposure_seconds: sensor.exposure.time().0,
        mean_electrons: sensor.electrons.data().iter().map(|&e| f64::from(e)).sum::<f64>() / n,
        mean_value: sensor.values.data().iter().map(|&v| f64::from(v)).sum::<f64>() / n,
        saturated: sensor.saturated,
        no_light: frame.no_light,
        exposure_noise: settings.exposure_noise.name().into(),
        matched: sensor.matched.as_ref().map(|m| m.share),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_film::{Accumulate, Film, Sample};
    use dunkelfeld_radiometry::Rgb;

    #[test]
    fn a_large_film_is_summed_up_in_pieces() {
        let (width, height) = (150, 240);
        let mut sums = vec![PixelSums::default(); (width * height) as usize];
        for (pixel, sums) in sums.iter_mut().enumerate() {
            for index in 0..(pixel % 5) as u32 {
                let value = Rgb::new((pixel % 11) as f32, (index + 1) as f32, 0.1);
                sums.add(index, &Sample { radiance: value, ..Sample::MISS });
            }
        }
        let mut film = Film::new(width, height);
        film.add_rows(0, &sums).expect("memory");
        let totals =
            || Totals::from_pieces(fold_tile_rows(&film, |totals: &mut Totals, _, sums| totals.add(sums)).iter());
        let of = |threads| dunkelfeld_render::Session::new(threads).expect("threads").install(totals);
        let (one, three) = (of(1), of(3));
        assert_eq!((one.mean, one.samples, one.range), (three.mean, three.samples, three.range));
        let counts = film.sample_counts();
        let without = counts.data().iter().filter(|&&n| n == 0).count() as u64;
        assert_eq!((one.samples, one.range, one.without), (film.total_samples(), Some([0, 4]), without));
        assert_eq!((one.black, three.black), (0, 0), "the blue channel has light everywhere");
        for channel in 0..3 {
            let sum: f64 = film.map(|p| p.mean()[channel]).data().iter().sum();
            assert!((one.mean[channel] / sum - 1.0).abs() < 1e-12, "{channel}");
        }
    }
}
