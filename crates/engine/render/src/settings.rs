//! The settings of one render: its inputs and its limits.

mod checkpoint;

pub use checkpoint::{CheckpointSettings, DEFAULT_CHECKPOINT_SECONDS, lock};
pub use dunkelfeld_denoise::{DenoiseMethod, DenoiseSettings, OIDN_VARIABLE};
pub use dunkelfeld_film::{MAX_PIXELS, MAX_SIDE};

use derive_setters::Setters;
use dunkelfeld_adaptive::required_samples::HIDDEN_SHARE;
use dunkelfeld_adaptive::weights::Strategy;
use dunkelfeld_film::{FilmLayers, Plane};
use dunkelfeld_scene::{Camera, Effect};
use dunkelfeld_sensor::{Exposure, ExposureNoise, Optics, Readout, SensorModel};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Default of the samples per pixel, if there is no budget.
pub const DEFAULT_SPP: f64 = 64.0;
/// Samples per pixel of the pilot.
pub const DEFAULT_PILOT_SPP: u32 = 16;
/// Largest number of training paths. They take about 10 s of one thread on a scene without media.
pub const MAX_TRAINING_PATHS: u32 = 1 << 20;
/// Largest number of training paths that is selected by itself. More change the noise by less than the scatter of its
/// measurement.
pub const TRAINING_PATHS: u32 = 8192;
/// Pixels of the film for each training path. A training path takes about the time of two samples, so training takes 3 %
/// of a render with four samples per pixel.
pub const PIXELS_PER_TRAINING_PATH: u32 = 16;
/// Size of the smallest film with training \[pixels\]. The training paths of a smaller one would be too few.
pub const MIN_TRAINED_PIXELS: u32 = 128 * 128;
/// Shortest time limit with training \[s\]: training takes 3 % of it.
pub const MIN_TRAINED_SECONDS: f64 = 2.0;
/// F-number of a lens without one.
pub const DEFAULT_F_NUMBER: f64 = 4.0;
/// Samples per pixel in the memory account if the clock or the noise ends the render.
pub const UNKNOWN_SPP: f64 = 4096.0;

/// The limits of a render, which ends at the first one that it reaches. Without any limit, it takes [`DEFAULT_SPP`]
/// samples per pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Budget {
    /// Wall-clock seconds, from the start of the command to the last file written.
    #[setters(into)]
    pub seconds: Option<f64>,
    /// Mean samples per pixel.
    #[setters(into)]
    pub spp: Option<f64>,
    /// The k at which 99 % of the unsaturated pixels must be hidden. The standard deviation of their rendered mean is
    /// then at most k times that of the sensor's noise. Needs a sensor.
    #[setters(into)]
    pub noise: Option<f64>,
    /// The share of the unsaturated pixels \[%\] that must be hidden at that k, instead of 99.
    #[setters(into)]
    pub share: Option<f64>,
}

impl Budget {
    /// The share of the unsaturated pixels that must be hidden, in \[0, 1\].
    pub fn hidden_share(&self) -> f64 {
        self.share.map_or(HIDDEN_SHARE, |percent| percent / 100.0)
    }
}

/// The exposure of the render.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SensorChoice {
    /// No sensor: radiance 1 W/(m^2 sr) is white, clipped, gamma 2.2, 8 bit, as in the images of the paper.
    None,
    /// An EMVA 1288 sensor behind a lens.
    Emva {
        /// The sensor.
        model: Box<SensorModel>,
        /// The lens.
        optics: Optics,
        /// The exposure. `None` selects automatic exposure: the 99.5 % quantile is at 90 % of saturation.
        exposure: Option<Exposure>,
    },
}

/// An image of a render with factors on groups of lights, and with its own exposure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Capture {
    /// Its name, which files have as a suffix.
    pub name: String,
    /// The factor of each of [`RunSettings::light_groups`]. All other lights are dark.
    pub factors: Vec<f64>,
    /// The exposure of the sensor, `None` for automatic exposure.
    pub exposure: Option<Exposure>,
    /// Its rows of the film.
    pub rows: CaptureRows,
}

/// The rows of a film that a capture has: all, or those of its light where lights flash in turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct CaptureRows {
    /// The first one.
    pub first: u32,
    /// From one to the next, 1 or more. The height of the film is a multiple of it.
    pub step: u32,
}

impl Default for CaptureRows {
    fn default() -> Self {
        Self::ALL
    }
}

impl CaptureRows {
    /// All rows.
    pub const ALL: Self = Self { first: 0, step: 1 };

    /// The row of the film of a row of the capture.
    pub fn of_film(self, row: u32) -> u32 {
        self.first + row * self.step
    }
}

/// What a program asks of a render beside the keys of a job.
#[derive(Clone, Debug, Default, Serialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct RunSettings {
    /// A camera that replaces the scene's.
    #[setters(into)]
    pub view: Option<Camera>,
    /// Samples per pixel of the pilot at most. By default a pilot has a fifth of the samples of the budget; a render that
    /// a user ends long before its limits needs less.
    #[setters(into)]
    pub max_pilot_spp: Option<u32>,
    /// Number of training paths of the learned Russian roulette ([`LearnedRoulette`](dunkelfeld_integrator::LearnedRoulette)),
    /// at most [`MAX_TRAINING_PATHS`]; 0 selects survival probabilities by the throughput of a path. A replay needs the
    /// number of the render, and so do parts of a render. `None` selects a number by the size of the film
    /// ([`RenderSettings::training_paths`]).
    #[setters(into)]
    pub training_paths: Option<u32>,
    /// Number of threads; 0 means one per core.
    pub threads: usize,
    /// A plan to replay: samples per pixel, instead of budget and strategy.
    #[setters(into)]
    pub replay: Option<Plane<u32>>,
    /// Range of sample indices of a part of a render. Of the samples of the plan, a pixel gets only those with an index
    /// in this range. [`JoinedParts`](crate::JoinedParts) joins the part with others. Without a plan to replay, every
    /// pixel gets all samples of the range. Neither budget nor strategy may be set then.
    #[setters(into)]
    pub samples: Option<Range<u32>>,
    /// Path and interval of the checkpoint. If the file exists, the render continues from it.
    #[serde(skip)]
    #[setters(into)]
    pub checkpoint: Option<CheckpointSettings>,
    /// The layers whose sums the film stores. [`FilmLayers::Image`] needs less memory and allows neither auxiliary
    /// layers in an EXR nor denoisers that use them. A render with a checkpoint stores all layers, because a later
    /// command may need them.
    pub layers: FilmLayers,
    /// Groups of lights by the names of their lights: each gets a film of its own beside that of all lights
    /// ([`RenderedFilm::groups`](crate::RenderedFilm::groups)). It changes no sample. A checkpoint does not contain these films.
    #[serde(skip)]
    pub light_groups: Vec<Vec<String>>,
    /// The images that the render is for, instead of that of all lights. The plan and the noise limit are those of the worst.
    #[serde(skip)]
    pub captures: Vec<Capture>,
    /// The number of the capture that the settings are of, from 0: each has noise of its own ([`RenderSettings::noise_frame`]).
    #[serde(skip)]
    pub capture: u32,
    /// The rows of the film of that capture.
    #[serde(skip)]
    pub rows: CaptureRows,
    /// Effects that were left out on purpose. They mark the outputs. The scene must have been built without them
    /// (`dunkelfeld::ProjectOptions::without`).
    pub without: Vec<Effect>,
}

/// All inputs of a render except the scene.
#[derive(Clone, Debug, Serialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct RenderSettings {
    /// Width of the film \[pixels\], 1 to [`MAX_SIDE`].
    pub width: u32,
    /// Height of the film \[pixels\], 1 to [`MAX_SIDE`].
    pub height: u32,
    /// Name of the camera. `None` selects the first, or a view of the whole scene if there is none.
    #[setters(into)]
    pub camera: Option<String>,
    /// The limits of the render.
    pub budget: Budget,
    /// The allocation of samples; `None` selects it by the sensor ([`Strategy::default_for`]).
    #[setters(into)]
    pub strategy: Option<Strategy>,
    /// Samples per pixel of the pilot.
    pub pilot_spp: u32,
    /// Weight of flat regions under [`Strategy::Sobel`], relative to the mean Sobel magnitude, in \[0, 1\].
    pub sobel_floor: f32,
    /// Seed of the render, of the sensor's noise and of the device.
    pub seed: u64,
    /// Frame number; frames of one seed are independent.
    pub frame: u32,
    /// The camera's sensor.
    pub sensor: SensorChoice,
    /// How the pixels of the sensor form those of the film. It changes no sample.
    #[serde(skip)]
    pub readout: Readout,
    /// Are the samples those of this exposure time, because objects move, rows are scanned or a lamp has a strobe? It
    /// changes no sample.
    #[serde(skip)]
    pub is_timed: bool,
    /// Noise that the sensor adds to the render's own. [`ExposureNoise::Matched`] needs a sensor.
    pub exposure_noise: ExposureNoise,
    /// Denoiser of the picture. No measurement uses its image.
    pub denoise: DenoiseSettings,
    /// Limit of memory \[bytes\] of the run. A render whose account (`dunkelfeld::memory::MemoryAccount`) exceeds it does not
    /// begin.
    #[setters(into)]
    pub memory_limit: Option<u64>,
    /// What is no key of a job.
    pub run: RunSettings,
}

impl RenderSettings {
    /// The settings of a scene file that is opened without a job, but without its sensor: 512 x 512 pixels, [`DEFAULT_SPP`]
    /// samples.
    pub fn without_sensor() -> Self {
        Self {
            width: 512,
            height: 512,
            camera: None,
            budget: Budget::default(),
            strategy: None,
            pilot_spp: DEFAULT_PILOT_SPP,
            sobel_floor: dunkelfeld_adaptive::weights::SOBEL_FLOOR,
            seed: 0,
            frame: 0,
            sensor: SensorChoice::None,
            readout: Readout::default(),
            is_timed: false,
            exposure_noise: ExposureNoise::default(),
            denoise: DenoiseSettings::default(),
            memory_limit: None,
            run: RunSettings::default(),
        }
    }

    /// The settings with a change of what is no key.
    #[must_use]
    pub fn running(mut self, change: impl FnOnce(RunSettings) -> RunSettings) -> Self {
        self.run = change(self.run);
        self
    }

    /// The strategy of the render.
    pub fn strategy(&self) -> Strategy {
        match self.run.samples {
            Some(_) => Strategy::Uniform,
            None => self.strategy.unwrap_or(Strategy::default_for(self.has_sensor())),
        }
    }

    /// The given plan of a replay or of a part: samples per pixel, with the samples of other parts.
    pub(crate) fn given_plan(&self) -> Option<Plane<u32>> {
        match (&self.run.replay, &self.run.samples) {
            (None, None) => None,
            (Some(plan), None) => Some(plan.clone()),
            (None, Some(samples)) => Some(Plane::new(self.width, self.height, samples.end)),
            (Some(plan), Some(samples)) => Some(plan.map(|&n| n.min(samples.end))),
        }
    }

    /// Samples per pixel that other parts render: a part begins where the one before it ends.
    pub(crate) fn samples_before(&self) -> Plane<u32> {
        let first = self.run.samples.as_ref().map_or(0, |s| s.start);
        match &self.run.replay {
            Some(plan) => plan.map(|&n| n.min(first)),
            None => Plane::new(self.width, self.height, first),
        }
    }

    /// Samples per pixel of a render with a given plan.
    pub fn given_spp(&self) -> Option<f64> {
        match (&self.run.replay, &self.run.samples) {
            (Some(plan), _) => Some(mean_of(plan)),
            (None, Some(samples)) => Some(f64::from(samples.end.saturating_sub(samples.start))),
            (None, None) => None,
        }
    }

    /// Samples per pixel for which the film is allocated.
    pub fn expected_spp(&self) -> f64 {
        let budget = self.budget;
        let open = budget.seconds.is_some() || budget.noise.is_some();
        self.given_spp().or(budget.spp).unwrap_or(if open { UNKNOWN_SPP } else { DEFAULT_SPP })
    }

    /// The layers of the film, by [`RunSettings::layers`].
    pub fn film_layers(&self) -> FilmLayers {
        if self.run.checkpoint.is_some() { FilmLayers::All } else { self.run.layers }
    }

    /// Number of training paths of the learned Russian roulette: the given one, or one for [`PIXELS_PER_TRAINING_PATH`]
    /// pixels of the film and at most [`TRAINING_PATHS`]. It is 0 without the technique, for films of fewer than
    /// [`MIN_TRAINED_PIXELS`] pixels, and for time limits below [`MIN_TRAINED_SECONDS`], unless there is a checkpoint,
    /// which a longer run may continue.
    pub fn training_paths(&self) -> u32 {
        if self.run.without.contains(&Effect::LearnedRoulette) {
            return 0;
        }
        let pixels = self.width.saturating_mul(self.height);
        let is_short = self.run.checkpoint.is_none() && self.budget.seconds.is_some_and(|s| s < MIN_TRAINED_SECONDS);
        let automatic = if pixels < MIN_TRAINED_PIXELS || is_short {
            0
        } else {
            (pixels / PIXELS_PER_TRAINING_PATH).min(TRAINING_PATHS)
        };
        self.run.training_paths.unwrap_or(automatic)
    }

    /// Does the lens of the sensor blur the image, so that the film keeps the places of samples?
    pub fn is_blurred(&self) -> bool {
        matches!(&self.sensor, SensorChoice::Emva { optics, .. } if optics.blurs())
    }

    /// Are the samples of a pixel spread over its neighbours, for the blur of the lens ([`Optics::needs_spread`])?
    pub fn is_spread(&self) -> bool {
        matches!(&self.sensor, SensorChoice::Emva { optics, model, .. } if optics.needs_spread(model.spec().pixel_pitch))
    }

    /// The frame number of the sensor's noise: that of the render for the first capture.
    pub fn noise_frame(&self) -> u32 {
        // An odd factor: frames of a few thousand captures do not meet.
        self.frame.wrapping_add(self.run.capture.wrapping_mul(0x9e37_79b9))
    }

    /// The settings of a capture: its exposure, the height of its rows, and no groups.
    #[must_use]
    pub fn of_capture(&self, capture: &Capture) -> Self {
        let mut settings = self.clone();
        let number = self.run.captures.iter().position(|other| other.name == capture.name);
        settings.run.capture = number.unwrap_or(0) as u32;
        settings.run.rows = capture.rows;
        settings.height /= capture.rows.step;
        (settings.run.light_groups, settings.run.captures) = (Vec::new(), Vec::new());
        if let SensorChoice::Emva { exposure, .. } = &mut settings.sensor {
            *exposure = capture.exposure;
        }
        settings
    }

    /// Is there a sensor?
    pub fn has_sensor(&self) -> bool {
        matches!(self.sensor, SensorChoice::Emva { .. })
    }
}

fn mean_of(plan: &Plane<u32>) -> f64 {
    plan.data().iter().map(|&n| f64::from(n)).sum::<f64>() / plan.data().len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_training_paths_follows_from_the_size_of_the_film() {
        let of = |side: u32, seconds: Option<f64>, run: RunSettings| {
            let budget = Budget::default().with_seconds(seconds);
            RenderSettings { width: side, height: side, budget, run, ..RenderSettings::without_sensor() }
                .training_paths()
        };
        let run = RunSettings::default;
        assert_eq!([127, 128, 256, 512, MAX_SIDE].map(|side| of(side, None, run())), [0, 1024, 4096, 8192, 8192]);
        assert_eq!(of(256, Some(1.0), run()), 0, "too short");
        assert_eq!(of(256, Some(2.0), run()), 4096);
        assert_eq!(
            of(256, Some(1.0), run().with_checkpoint(CheckpointSettings::new("a"))),
            4096,
            "it may be continued"
        );
        assert_eq!([of(8, None, run().with_training_paths(7)), of(512, None, run().with_training_paths(0))], [7, 0]);
        let without = run().with_training_paths(7).with_without(vec![Effect::LearnedRoulette]);
        assert_eq!(of(512, None, without), 0, "left out");
    }
}
