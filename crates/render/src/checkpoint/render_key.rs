//! The render key: it decides whether a checkpoint may be continued, and whether parts belong to one render.

use crate::settings::DenoiseSettings;
use crate::settings::{Budget, RenderSettings, SensorChoice};
use dunkelfeld_integrator::{Estimator, PixelSample};
use dunkelfeld_scene::{RayGenerator, Scene, digest};
use dunkelfeld_sensor::ExposureNoise;
use serde::{Deserialize, Serialize};
use std::fmt::Debug;

/// Number of samples that are rendered again before a render is resumed, to verify that they have the same values.
const PROBES: u64 = 64;

/// All values on which the samples and the plan of a render depend, by name. A short value is stored as text, a long
/// one as its XXH3.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct RenderKey(Vec<(String, String)>);

impl RenderKey {
    pub(crate) fn new(scene: &Scene, camera: &RayGenerator, settings: &RenderSettings) -> Self {
        let s = settings;
        let mut all = Vec::new();
        let mut put = |name: &str, value: String| all.push((name.to_string(), value));
        put("program", format!("dunkelfeld {}", env!("CARGO_PKG_VERSION")));
        put("size", format!("{} x {}", s.width, s.height));
        put("seed", s.seed.to_string());
        put("frame", s.frame.to_string());
        put("choice of effects left out", s.without.iter().map(|e| e.name()).collect::<Vec<_>>().join(", "));
        put("scene", format!("{:032x}", scene.fingerprint()));
        put("camera", hex(camera));
        put("plan", s.replay.as_ref().map_or_else(String::new, hex));
        if s.samples.is_none() {
            put("budget", words(&s.budget));
            put("allocation", s.strategy().name().into());
            let sensor = match &s.sensor {
                SensorChoice::None => "none".into(),
                SensorChoice::Emva { model, .. } => format!("{} ({})", model.spec().name, hex(&s.sensor)),
            };
            put("sensor or exposure", sensor);
            // All other settings, except those that change no sample.
            let rest = RenderSettings {
                threads: 0,
                replay: None,
                checkpoint: None,
                memory_limit: None,
                view: None,
                strategy: Some(s.strategy()),
                exposure_noise: ExposureNoise::default(),
                denoise: DenoiseSettings::default(),
                ..s.clone()
            };
            put("further settings", hex(&rest));
        }
        put("outcome of samples", probe(scene, camera, s));
        Self(all)
    }

    /// The first difference, as a sentence; `None` if the keys are equal.
    pub(crate) fn difference(&self, other: &Self) -> Option<String> {
        let value = |of: &Self, name: &str| of.0.iter().find(|(n, _)| n == name).map(|(_, v)| v.clone());
        let names = self.0.iter().chain(&other.0).map(|(name, _)| name);
        names.into_iter().find_map(|name| match (value(self, name), value(other, name)) {
            (a, b) if a == b => None,
            (Some(a), Some(b)) if is_digest(&a) || is_digest(&b) => Some(format!("not the same {name}")),
            (Some(a), Some(b)) => Some(format!("not the same {name}, \"{a}\" there and \"{b}\" here")),
            _ => Some(format!("only one of them knows of a {name}")),
        })
    }
}

/// A budget in words. The text of a number is exact to the last bit.
fn words(budget: &Budget) -> String {
    let Budget { seconds, spp, noise } = budget;
    let limits = [
        seconds.map(|s| format!("{s} s")),
        spp.map(|n| format!("{n} samples per pixel")),
        noise.map(|k| format!("noise hidden at k = {k}")),
    ];
    let limits: Vec<String> = limits.into_iter().flatten().collect();
    if limits.is_empty() { "the default".into() } else { limits.join(", ") }
}

fn hex(value: &impl Debug) -> String {
    format!("{:032x}", digest(value))
}

fn is_digest(text: &str) -> bool {
    text.len() == 32 && text.bytes().all(|b| b.is_ascii_hexdigit())
}

/// Hash of a few samples, spread over the image. It detects a program that was changed without a new version number,
/// and a machine that computes differently.
fn probe(scene: &Scene, camera: &RayGenerator, s: &RenderSettings) -> String {
    let estimator = Estimator { scene, camera, width: s.width, seed: s.seed, frame: s.frame };
    let pixels = u64::from(s.width) * u64::from(s.height);
    let samples: Vec<_> = (0..PROBES)
        .map(|i| {
            // The golden ratio spreads the samples (Weyl 1916).
            let pixel = (u128::from(i.wrapping_mul(0x9e37_79b9_7f4a_7c15)) * u128::from(pixels)) >> 64;
            let (x, y) = ((pixel as u64 % u64::from(s.width)) as u32, (pixel as u64 / u64::from(s.width)) as u32);
            estimator.sample(PixelSample { x, y, index: (i % 7) as u32 })
        })
        .collect();
    hex(&samples)
}
