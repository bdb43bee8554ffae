//! The stored units of a bench: a folder with one small file for each finished render, bound to the settings of the
//! renders.

use super::denoised::Filtered;
use super::runs::Unit;
use super::settings::SettingsSummary;
use crate::series::{Kept, push_plane};
use dunkelfeld::Error;
use dunkelfeld::film::{Plane, RenderKey};
use dunkelfeld_io::exr::ExrLayers;
use dunkelfeld_io::layers::{Single, Triple};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Version of the files in the folder.
pub(super) const VERSION: u32 = 4;
/// The file that binds the folder.
const MANIFEST: &str = "bench.json";
/// The layer that holds the linear signal of a unit.
const SIGNAL: &str = "signal.Y";

/// The key of the units of a folder. Two benches with equal keys may share them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Manifest {
    key: RenderKey,
    pub(super) size: [u32; 2],
    pub(super) settings: SettingsSummary,
}

impl Manifest {
    pub(super) fn new(mut key: RenderKey, size: [u32; 2], settings: SettingsSummary) -> Self {
        key.add_digest("list of settings", &settings);
        Self { key, size, settings }
    }
}

/// The small file of a finished unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Record {
    pub(super) name: String,
    pub(super) seed: u64,
    pub(super) allocation: String,
    pub(super) without: Option<String>,
    /// Samples per pixel: requested, and taken.
    pub(super) spp: u32,
    pub(super) samples: u64,
    pub(super) invalid_samples: u64,
    /// Seconds by stage; `expose` and `write` where they were measured.
    pub(super) seconds: BTreeMap<String, f64>,
    /// Seconds of the render as a whole, and of its image behind the lens, without exposing and writing.
    pub(super) total_seconds: f64,
    /// Share of the lanes of each stage that had work.
    #[serde(default)]
    pub(super) lanes: BTreeMap<String, f64>,
    /// Seconds of each denoiser, by its name in tables.
    pub(super) denoise_seconds: BTreeMap<String, f64>,
    /// Mean over the unsaturated pixels of the variance that the render estimates from its own samples, in the square
    /// of the signal's unit. Absent in the reference, which determines the saturated pixels.
    pub(super) stated_variance: Option<f64>,
}

/// The folder of the units.
#[derive(Debug)]
pub(super) struct Store(Kept);

impl Store {
    /// Opens the units of a bench's folder; `restart` discards its content.
    pub(super) fn open(home: &Path, restart: bool) -> Result<Self, Error> {
        Ok(Self(Kept::open(home, MANIFEST, restart)?))
    }

    /// The key of the units. `None` if there are none yet.
    pub(super) fn manifest(&self) -> Result<Option<Manifest>, Error> {
        self.0.manifest()
    }

    /// Binds the folder.
    ///
    /// # Errors
    /// It has another key.
    pub(super) fn bind(&self, manifest: &Manifest) -> Result<(), Error> {
        self.0.bind(manifest, |m: &Manifest| &m.key)?;
        self.0.expect_size(manifest.size);
        Ok(())
    }

    /// The record of a unit, if it is finished.
    pub(super) fn record(&self, unit: &Unit, base_seed: u64) -> Result<Option<Record>, Error> {
        let record: Option<Record> = self.0.record(&unit.name())?;
        Ok(record.filter(|r| r.seed == unit.seed(base_seed)))
    }

    /// Stores a finished unit.
    pub(super) fn keep(&self, record: &Record, layers: ExrLayers) -> Result<(), Error> {
        self.0.keep(&record.name, record, layers)
    }

    /// Path of the timed picture of a unit.
    pub(super) fn picture(&self, unit: &Unit) -> std::path::PathBuf {
        self.0.file(&format!("{}.png", unit.name()))
    }

    /// The linear signal of a finished unit.
    pub(super) fn signal(&self, unit: &Unit) -> Result<Plane<f32>, Error> {
        self.0.plane(&unit.name(), SIGNAL)
    }

    /// The same after a denoiser.
    pub(super) fn denoised(&self, unit: &Unit, key: &str) -> Result<Plane<f32>, Error> {
        self.0.plane(&unit.name(), &denoised_layer(key))
    }

    /// The mean radiance of the reference behind the lens.
    pub(super) fn radiance(&self, unit: &Unit) -> Result<Plane<[f32; 3]>, Error> {
        self.0.radiance(&unit.name())
    }

    /// The samples per pixel of a unit that stores them.
    pub(super) fn sample_counts(&self, unit: &Unit) -> Result<Plane<u32>, Error> {
        let name = unit.name();
        self.0.layers(&name)?.integers(Single::SampleCount).ok_or_else(|| self.0.lacks(&name, "spp.Y"))
    }
}

/// The layers that a unit stores.
pub(super) fn layers(
    signal: Plane<f32>,
    denoised: Vec<Filtered>,
    counts: Option<Plane<u32>>,
    radiance: Option<&Plane<[f32; 3]>>,
) -> ExrLayers {
    let mut layers = ExrLayers::new(signal.width(), signal.height());
    push_plane(&mut layers, SIGNAL, signal);
    for d in denoised {
        push_plane(&mut layers, &denoised_layer(d.key), d.signal);
    }
    if let Some(counts) = counts {
        layers.push_integers(Single::SampleCount, counts);
    }
    if let Some(radiance) = radiance {
        layers.push_triples(Triple::Mean, radiance);
    }
    layers
}

fn denoised_layer(key: &str) -> String {
    format!("{key}.Y")
}
