//! The render key: it decides whether a checkpoint may be continued, and whether parts belong to one render.

use crate::settings::{Budget, DenoiseSettings, RenderSettings, RunSettings, SensorChoice};
use dunkelfeld_integrator::{Estimator, LearnedRoulette, PixelSample};
use dunkelfeld_scene::{RayGenerator, Scene, digest};
use dunkelfeld_sensor::ExposureNoise;
use serde::{Deserialize, Serialize};

/// Number of samples that are rendered again before a render is resumed, to verify that they have the same values.
const PROBES: u64 = 64;

/// All values on which samples depend, by name, and further ones that a study adds. A short value is stored as text, a
/// long one as the XXH3 of its serialised form ([`digest`]).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RenderKey(Vec<(String, String)>);

impl RenderKey {
    /// The key of the samples alone: those of two renders with equal keys have the same bits. It contains the version of
    /// the program, size, seed, frame, scene, camera, number of training paths, and the hash of some samples, which are
    /// not those of the learned roulette. The film has the size of `settings`.
    pub fn of_samples(scene: &Scene, camera: &RayGenerator, settings: &RenderSettings) -> Self {
        Self::with_roulette(scene, camera, settings, None)
    }

    /// [`Self::of_samples`] with the hash of samples that use the learned roulette.
    fn with_roulette(
        scene: &Scene,
        camera: &RayGenerator,
        settings: &RenderSettings,
        roulette: Option<&LearnedRoulette>,
    ) -> Self {
        let s = settings;
        let mut key = Self(Vec::new());
        key.add("program", concat!("dunkelfeld ", env!("CARGO_PKG_VERSION")));
        key.add("size", format!("{} x {}", s.width, s.height));
        key.add("seed", s.seed);
        key.add("frame", s.frame);
        key.add("choice of effects left out", s.run.without.iter().map(|e| e.name()).collect::<Vec<_>>().join(", "));
        key.add("scene", hex(scene.fingerprint()));
        key.add_digest("camera", camera);
        key.add("number of training paths", s.training_paths());
        key.add("outcome of samples", hex(probe(scene, camera, s, roulette)));
        key
    }

    /// The key of samples and plan.
    pub(crate) fn new(
        scene: &Scene,
        camera: &RayGenerator,
        settings: &RenderSettings,
        roulette: Option<&LearnedRoulette>,
    ) -> Self {
        let s = settings;
        let mut key = Self::with_roulette(scene, camera, s, roulette);
        match &s.run.replay {
            Some(plan) => key.add_digest("plan", plan),
            None => key.add("plan", ""),
        }
        if s.run.samples.is_none() {
            key.add("budget", words(&s.budget));
            key.add("allocation", s.strategy().name());
            key.add_sensor(&s.sensor);
            // All other settings, except those that change no sample.
            let rest = RenderSettings {
                memory_limit: None,
                run: RunSettings {
                    threads: 0,
                    replay: None,
                    checkpoint: None,
                    training_paths: None,
                    view: None,
                    ..s.run.clone()
                },
                strategy: Some(s.strategy()),
                exposure_noise: ExposureNoise::default(),
                denoise: DenoiseSettings::default(),
                ..s.clone()
            };
            key.add_digest("further settings", &rest);
        }
        key
    }

    /// Adds a value as text.
    pub fn add(&mut self, name: &str, value: impl ToString) {
        self.0.push((name.into(), value.to_string()));
    }

    /// Adds the hash of a value.
    pub fn add_digest(&mut self, name: &str, value: &impl Serialize) {
        self.add(name, hex(digest(value)));
    }

    /// Adds sensor, lens and exposure: the name of the sensor, and the hash of all values.
    pub fn add_sensor(&mut self, sensor: &SensorChoice) {
        let value = match sensor {
            SensorChoice::None => "none".into(),
            SensorChoice::Emva { model, .. } => format!("{} ({})", model.spec().name, hex(digest(sensor))),
        };
        self.add("sensor or exposure", value);
    }

    /// The first difference, as a phrase: `other` is \"here\". `None` if the keys are equal.
    pub fn difference(&self, other: &Self) -> Option<String> {
        let value = |of: &Self, name: &str| of.0.iter().find(|(n, _)| n == name).map(|(_, v)| v.clone());
        let names = self.0.iter().chain(&other.0).map(|(name, _)| name);
        names.into_iter().find_map(|name| match (value(self, name), value(other, name)) {
            (a, b) if a == b => None,
            (Some(a), Some(b)) if is_digest(&a) || is_digest(&b) => Some(format!("not the same {name}")),
            (Some(a), Some(b)) => Some(format!("not the same {name}, \"{a}\" there and \"{b}\" here")),
            _ => Some(format!("only one of them has a {name}")),
        })
    }
}

/// A budget in words. The text of a number is exact to the last bit.
fn words(budget: &Budget) -> String {
    let Budget { seconds, spp, noise, share } = budget;
    let of_pixels = share.map_or(String::new(), |share| format!(" in {share} % of the pixels"));
    let limits = [
        seconds.map(|s| format!("{s} s")),
        spp.map(|n| format!("{n} samples per pixel")),
        noise.map(|k| format!("noise hidden at k = {k}{of_pixels}")),
    ];
    let limits: Vec<String> = limits.into_iter().flatten().collect();
    if limits.is_empty() { "the default".into() } else { limits.join(", ") }
}

fn hex(digest: u128) -> String {
    format!("{digest:032x}")
}

fn is_digest(text: &str) -> bool {
    text.len() == 32 && text.bytes().all(|b| b.is_ascii_hexdigit())
}

/// Hash of a few samples, spread over the image. It detects a program that was changed without a new version number,
/// and a machine that computes differently.
fn probe(scene: &Scene, camera: &RayGenerator, s: &RenderSettings, roulette: Option<&LearnedRoulette>) -> u128 {
    let estimator = Estimator { scene, camera, width: s.width, seed: s.seed, frame: s.frame, roulette };
    let pixels = u64::from(s.width) * u64::from(s.height);
    let samples: Vec<_> = (0..PROBES)
        .map(|i| {
            // The golden ratio spreads the samples (Weyl 1916).
            let pixel = (u128::from(i.wrapping_mul(0x9e37_79b9_7f4a_7c15)) * u128::from(pixels)) >> 64;
            let (x, y) = ((pixel as u64 % u64::from(s.width)) as u32, (pixel as u64 / u64::from(s.width)) as u32);
            estimator.sample(PixelSample { x, y, index: (i % 7) as u32 })
        })
        .collect();
    digest(&samples)
}
