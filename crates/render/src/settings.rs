//! What to render and how long: the settings of one render.

mod checkpoint;

pub use checkpoint::{CheckpointSettings, DEFAULT_CHECKPOINT_SECONDS, lock};
pub use dunkelfeld_denoise::{DenoiseMethod, DenoiseSettings, OIDN_VARIABLE};
pub use dunkelfeld_film::{MAX_PIXELS, MAX_SIDE};

use dunkelfeld_adaptive::weights::Strategy;
use dunkelfeld_film::{FilmLayers, Plane};
use dunkelfeld_scene::{Camera, Effect};
use dunkelfeld_sensor::{Exposure, ExposureNoise, Optics, SensorModel};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Samples per pixel when no budget is given.
pub const DEFAULT_SPP: f64 = 64.0;
/// Samples per pixel of the pilot.
pub const DEFAULT_PILOT_SPP: u32 = 16;
/// Samples per pixel that the memory account assumes where the clock or the noise ends the render.
pub const UNKNOWN_SPP: f64 = 4096.0;

/// When a render ends: the first limit that is met. Without any, [`DEFAULT_SPP`] samples per pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Budget {
    /// Wall-clock seconds, from the start of the command to the last file written.
    pub seconds: Option<f64>,
    /// Mean samples per pixel.
    pub spp: Option<f64>,
    /// The k at which 99 % of the unsaturated pixels shall be hidden: the standard deviation of their rendered mean is then
    /// at most k times that of the sensor's noise. Needs a sensor.
    pub noise: Option<f64>,
}

/// How the render is exposed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SensorChoice {
    /// No sensor: radiance 1 W/(m^2 sr) is white, clipped, gamma 2.2, 8 bit; the paper's images.
    None,
    /// An EMVA 1288 sensor behind a lens.
    Emva {
        /// The sensor.
        model: Box<SensorModel>,
        /// The lens.
        optics: Optics,
        /// The exposure; `None` finds one: the 99.5 % quantile comes to 90 % of saturation.
        exposure: Option<Exposure>,
    },
}

/// Everything a render depends on beside the scene.
#[derive(Clone, Debug, Serialize)]
pub struct RenderSettings {
    /// Width of the film \[pixels\], 1 to [`MAX_SIDE`].
    pub width: u32,
    /// Height of the film \[pixels\], 1 to [`MAX_SIDE`].
    pub height: u32,
    /// Name of the camera; `None` takes the first, or frames the scene.
    pub camera: Option<String>,
    /// A camera of one's own, in place of the scene's.
    pub view: Option<Camera>,
    /// When to stop.
    pub budget: Budget,
    /// Where the samples go; `None` decides by the sensor ([`Strategy::default_for`]).
    pub strategy: Option<Strategy>,
    /// Samples per pixel of the pilot.
    pub pilot_spp: u32,
    /// Weight of flat regions under [`Strategy::Sobel`], relative to the mean Sobel magnitude, in \[0, 1\].
    pub sobel_floor: f32,
    /// Seed of the render, of the sensor's noise and of the device.
    pub seed: u64,
    /// Frame number; frames of one seed are independent.
    pub frame: u32,
    /// Threads; 0 takes as many as there are cores.
    pub threads: usize,
    /// The camera's sensor.
    pub sensor: SensorChoice,
    /// What noise the sensor adds to the render's own. [`ExposureNoise::Matched`] needs a sensor.
    pub exposure_noise: ExposureNoise,
    /// What the picture is denoised with. Nothing that is measured reads it.
    pub denoise: DenoiseSettings,
    /// A plan to replay: samples per pixel, instead of budget and strategy.
    pub replay: Option<Plane<u32>>,
    /// Of the samples that the plan gives each pixel only those with an index in this range: a part of the render, which
    /// [`JoinedParts`](crate::JoinedParts) joins with others. Without a plan to replay, every pixel gets all of them. Neither budget nor
    /// strategy may be set then.
    pub samples: Option<Range<u32>>,
    /// The most memory \[bytes\] that the run may need: a render whose account (`dunkelfeld::MemoryAccount`) is beyond it does not begin.
    pub memory_limit: Option<u64>,
    /// Where to keep a checkpoint, and to take the render up from if it exists.
    #[serde(skip)]
    pub checkpoint: Option<CheckpointSettings>,
    /// The layers that the film keeps sums for. [`FilmLayers::Image`] needs less memory and allows neither auxiliary layers in an EXR
    /// nor denoisers that use them. A render with a checkpoint keeps all: it may be asked for them later.
    pub layers: FilmLayers,
    /// Effects that were left out on purpose. They mark the outputs; the scene itself must have been built without them
    /// (`dunkelfeld::Project::open_without`).
    pub without: Vec<Effect>,
}

impl RenderSettings {
    /// The strategy that the render follows.
    pub fn strategy(&self) -> Strategy {
        match self.samples {
            Some(_) => Strategy::Uniform,
            None => self.strategy.unwrap_or(Strategy::default_for(self.has_sensor())),
        }
    }

    /// The plan of a render that does not plan for itself: one that is replayed, or a part. Samples per pixel, those that
    /// other parts have included.
    pub(crate) fn given_plan(&self) -> Option<Plane<u32>> {
        match (&self.replay, &self.samples) {
            (None, None) => None,
            (Some(plan), None) => Some(plan.clone()),
            (None, Some(samples)) => Some(Plane::new(self.width, self.height, samples.end)),
            (Some(plan), Some(samples)) => Some(plan.map(|&n| n.min(samples.end))),
        }
    }

    /// Samples per pixel that are left to other parts: a part begins where the one before it ends.
    pub(crate) fn samples_before(&self) -> Plane<u32> {
        let first = self.samples.as_ref().map_or(0, |s| s.start);
        match &self.replay {
            Some(plan) => plan.map(|&n| n.min(first)),
            None => Plane::new(self.width, self.height, first),
        }
    }

    /// Samples per pixel of a render that does not plan for itself.
    pub fn given_spp(&self) -> Option<f64> {
        match (&self.replay, &self.samples) {
            (Some(plan), _) => Some(mean_of(plan)),
            (None, Some(samples)) => Some(f64::from(samples.end.saturating_sub(samples.start))),
            (None, None) => None,
        }
    }

    /// Samples per pixel that a film is made for.
    pub fn expected_spp(&self) -> f64 {
        let budget = self.budget;
        let open = budget.seconds.is_some() || budget.noise.is_some();
        self.given_spp().or(budget.spp).unwrap_or(if open { UNKNOWN_SPP } else { DEFAULT_SPP })
    }

    /// The layers of the film, as [`Self::layers`] has it.
    pub fn film_layers(&self) -> FilmLayers {
        if self.checkpoint.is_some() { FilmLayers::All } else { self.layers }
    }

    /// Is there a sensor?
    pub fn has_sensor(&self) -> bool {
        matches!(self.sensor, SensorChoice::Emva { .. })
    }
}

impl Default for RenderSettings {
    /// 512 x 512 pixels, [`DEFAULT_SPP`] samples by the paper's method, no sensor.
    fn default() -> Self {
        Self {
            width: 512,
            height: 512,
            camera: None,
            view: None,
            budget: Budget::default(),
            strategy: None,
            pilot_spp: DEFAULT_PILOT_SPP,
            sobel_floor: dunkelfeld_adaptive::weights::SOBEL_FLOOR,
            seed: 0,
            frame: 0,
            threads: 0,
            sensor: SensorChoice::None,
            exposure_noise: ExposureNoise::default(),
            denoise: DenoiseSettings::default(),
            replay: None,
            samples: None,
            memory_limit: None,
            checkpoint: None,
            layers: FilmLayers::default(),
            without: Vec::new(),
        }
    }
}

fn mean_of(plan: &Plane<u32>) -> f64 {
    plan.data().iter().map(|&n| f64::from(n)).sum::<f64>() / plan.data().len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_those_of_the_budget_or_of_the_plan() {
        let spp = |change: fn(&mut RenderSettings)| {
            let mut settings = RenderSettings { width: 2, height: 1, ..RenderSettings::default() };
            change(&mut settings);
            settings.expected_spp()
        };
        assert_eq!(spp(|_| {}), DEFAULT_SPP);
        assert_eq!(spp(|s| s.budget.spp = Some(7.0)), 7.0);
        assert_eq!(spp(|s| s.budget.seconds = Some(7.0)), UNKNOWN_SPP);
        assert_eq!(spp(|s| s.samples = Some(8..24)), 16.0);
        assert_eq!(spp(|s| s.replay = Plane::from_vec(2, 1, vec![3, 6])), 4.5);
    }
}
