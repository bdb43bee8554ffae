//! What a bench has so far: a folder with one small file for each finished render, bound to what was rendered.

use super::denoised::Filtered;
use super::settings::SettingsSummary;
use super::units::{Unit, hash_text};
use crate::error::Error;
use crate::outputs::written;
use crate::settings::{RenderSettings, SensorChoice};
use dunkelfeld_film::Plane;
use dunkelfeld_integrator::{Estimator, PixelSample};
use dunkelfeld_io::InputError;
use dunkelfeld_io::exr::{Channel, ExrLayers};
use dunkelfeld_io::layers::{Single, Triple};
use dunkelfeld_io::results::ResultsFolder;
use dunkelfeld_sampling::hash_u64;
use dunkelfeld_scene::{RayGenerator, Scene};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Version of the files in the folder.
const VERSION: u32 = 2;
/// The folder in the bench's folder, and the file that binds it.
const FOLDER: &str = "units";
const MANIFEST: &str = "bench.json";
/// The layer that holds the linear signal of a unit.
const SIGNAL: &str = "signal.Y";
/// Samples along each side of the grid that a scene is known by.
const PROBES: u32 = 64;

/// What the folder's units are of. Two benches whose manifests are equal may share them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Manifest {
    pub(super) version: u32,
    pub(super) program: String,
    /// Hash of the samples of a grid of pixels and of what the scene is made of: the scene, camera and lens, and the code.
    pub(super) scene: String,
    pub(super) size: [u32; 2],
    pub(super) seed: u64,
    pub(super) threads: usize,
    /// Sensor, optics and exposure.
    pub(super) sensor: String,
    pub(super) pilot_spp: u32,
    /// Names and versions.
    pub(super) denoisers: Vec<String>,
    pub(super) settings: SettingsSummary,
}

impl Manifest {
    pub(super) fn new(
        scene: &Scene,
        camera: &RayGenerator,
        settings: &RenderSettings,
        threads: usize,
        denoisers: Vec<String>,
        summary: SettingsSummary,
    ) -> Self {
        let sensor = match &settings.sensor {
            SensorChoice::None => "none".into(),
            // The name for people, a hash for all its numbers.
            SensorChoice::Emva { model, optics, exposure } => {
                let numbers = hash_text(&format!("{model:?} {optics:?} {exposure:?}"));
                format!("{}, {numbers:016x}", model.spec().name)
            }
        };
        Self {
            version: VERSION,
            program: format!("dunkelfeld {}", env!("CARGO_PKG_VERSION")),
            scene: format!("{:016x}", fingerprint(scene, camera, settings)),
            size: [settings.width, settings.height],
            seed: settings.seed,
            threads,
            sensor,
            pilot_spp: settings.pilot_spp,
            denoisers,
            settings: summary,
        }
    }

    /// The first difference, in words.
    fn difference(&self, other: &Self) -> Option<String> {
        let words = |m: &Self| {
            [
                ("version of the folder", m.version.to_string()),
                ("program", m.program.clone()),
                ("film", format!("{} x {}", m.size[0], m.size[1])),
                ("seed", m.seed.to_string()),
                ("number of threads", m.threads.to_string()),
                ("sensor", m.sensor.clone()),
                ("samples of the pilot", m.pilot_spp.to_string()),
                ("list of denoisers", if m.denoisers.is_empty() { "empty".into() } else { m.denoisers.join(", ") }),
                ("settings", format!("{:?}", m.settings)),
                ("scene or the code that renders it", m.scene.clone()),
            ]
        };
        let (mine, theirs) = (words(self), words(other));
        let differing = mine.into_iter().zip(theirs).find(|(a, b)| a.1 != b.1);
        differing.map(|((what, now), (_, then))| format!("{what} is {now} now and was {then}"))
    }
}

/// A number that changes with everything an image depends on: what the scene is made of, and the first sample of a grid of
/// pixels to the last bit.
fn fingerprint(scene: &Scene, camera: &RayGenerator, settings: &RenderSettings) -> u64 {
    let estimator = Estimator { scene, camera, width: settings.width, seed: 0, frame: settings.frame };
    let summary = scene.summary();
    let lights: Vec<_> = scene.light_inventory().into_iter().map(|l| (l.name, l.kind, l.power.to_array())).collect();
    let mut hash = hash_text(&format!("{summary:?} {:?} {lights:?}", scene.materials()));
    for i in 0..PROBES * PROBES {
        let place = |cell: u32, side: u32| (u64::from(cell) * u64::from(side) / u64::from(PROBES)) as u32;
        let at = PixelSample { x: place(i % PROBES, settings.width), y: place(i / PROBES, settings.height), index: i };
        let sample = estimator.sample(at);
        for v in sample.radiance.to_array() {
            hash = hash_u64([hash, u64::from(v.to_bits())]);
        }
        hash = hash_u64([hash, u64::from(sample.depth.to_bits())]);
    }
    hash
}

/// The small file of a finished unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Record {
    pub(super) name: String,
    pub(super) seed: u64,
    pub(super) allocation: String,
    pub(super) without: Option<String>,
    /// Samples per pixel that were asked for, and what there is.
    pub(super) spp: u32,
    pub(super) samples: u64,
    pub(super) invalid_samples: u64,
    /// Seconds by stage; `expose` and `write` where they were measured.
    pub(super) seconds: BTreeMap<String, f64>,
    /// Seconds of the render as a whole, without exposing and writing.
    pub(super) total_seconds: f64,
    /// Seconds that each denoiser took, by its name in tables.
    pub(super) denoise_seconds: BTreeMap<String, f64>,
    /// Mean over the unsaturated pixels of the variance that the render states of itself, in the square of the signal's
    /// unit. Absent in the reference, from which it is only learnt what is saturated.
    pub(super) stated_variance: Option<f64>,
}

/// The folder of the units.
#[derive(Debug)]
pub(super) struct Store {
    folder: ResultsFolder,
}

impl Store {
    /// Opens the units of a bench's folder; `restart` discards what is there.
    pub(super) fn open(home: &Path, restart: bool) -> Result<Self, Error> {
        let path = home.join(FOLDER);
        let folder = ResultsFolder::open(&path).and_then(|f| if restart { f.clear() } else { Ok(f) });
        let mut opened = None;
        written(&path, folder.map(|f| opened = Some(f)))?;
        opened.map(|folder| Self { folder }).ok_or_else(|| Error::Output {
            file: path,
            problem: "cannot be opened".into(),
            mend: "name another folder".into(),
        })
    }

    /// What the units are of; `None` if there are none yet.
    pub(super) fn manifest(&self) -> Result<Option<Manifest>, Error> {
        self.read_json(MANIFEST)
    }

    /// Binds the folder.
    ///
    /// # Errors
    /// It is bound to something else.
    pub(super) fn bind(&self, manifest: &Manifest) -> Result<(), Error> {
        match self.manifest()? {
            None => self.write_json(MANIFEST, manifest),
            Some(there) => match manifest.difference(&there) {
                None => Ok(()),
                Some(difference) => {
                    let problem = format!("holds the results of another bench: the {difference}");
                    let mend = "name another folder with -o, or discard these results with --restart";
                    Err(InputError::new(self.folder.file(MANIFEST), "the whole file", problem, mend).into())
                }
            },
        }
    }

    /// The record of a unit, if it is finished.
    pub(super) fn record(&self, unit: &Unit, base_seed: u64) -> Result<Option<Record>, Error> {
        let record: Option<Record> = self.read_json(&format!("{}.json", unit.name()))?;
        Ok(record.filter(|r| r.seed == unit.seed(base_seed)))
    }

    /// Keeps a finished unit: the image first, then the record, which says that it is finished.
    pub(super) fn keep(&self, record: &Record, layers: ExrLayers) -> Result<(), Error> {
        let image = format!("{}.exr", record.name);
        written(&self.folder.file(&image), self.folder.write_layers(&image, layers))?;
        self.write_json(&format!("{}.json", record.name), record)
    }

    /// Where the picture of a unit is written, to see how long that takes.
    pub(super) fn picture(&self, unit: &Unit) -> std::path::PathBuf {
        self.folder.file(&format!("{}.png", unit.name()))
    }

    /// The linear signal of a finished unit.
    pub(super) fn signal(&self, unit: &Unit) -> Result<Plane<f32>, Error> {
        self.plane(unit, SIGNAL)
    }

    /// The same after a denoiser.
    pub(super) fn denoised(&self, unit: &Unit, key: &str) -> Result<Plane<f32>, Error> {
        self.plane(unit, &denoised_layer(key))
    }

    fn plane(&self, unit: &Unit, name: &str) -> Result<Plane<f32>, Error> {
        let layers = self.layers(unit)?;
        let plane = match layers.channel(name) {
            Some(Channel::F32(data)) => Plane::from_vec(layers.width, layers.height, data.clone()),
            _ => None,
        };
        plane.ok_or_else(|| self.lacks(unit, name))
    }

    /// The mean radiance of the reference.
    pub(super) fn radiance(&self, unit: &Unit) -> Result<Plane<[f32; 3]>, Error> {
        self.layers(unit)?.triples(Triple::Mean).ok_or_else(|| self.lacks(unit, "R G B"))
    }

    /// The samples per pixel of a unit that keeps them.
    pub(super) fn sample_counts(&self, unit: &Unit) -> Result<Plane<u32>, Error> {
        self.layers(unit)?.integers(Single::SampleCount).ok_or_else(|| self.lacks(unit, "spp.Y"))
    }

    fn layers(&self, unit: &Unit) -> Result<ExrLayers, Error> {
        Ok(self.folder.read_layers(&format!("{}.exr", unit.name()))?)
    }

    fn lacks(&self, unit: &Unit, layer: &str) -> Error {
        let file = self.folder.file(&format!("{}.exr", unit.name()));
        let mend = "delete the folder's units, or start anew with --restart";
        InputError::new(file, format!("layer {layer}"), "is missing", mend).into()
    }

    fn read_json<T: for<'a> Deserialize<'a>>(&self, name: &str) -> Result<Option<T>, Error> {
        let Some(text) = self.folder.read_text(name)? else { return Ok(None) };
        let parsed = serde_json::from_str(&text);
        parsed.map(Some).map_err(|e| {
            let place = format!("line {}", e.line());
            let mend = "delete this file to measure it again, or start anew with --restart";
            InputError::new(self.folder.file(name), place, e.to_string(), mend).into()
        })
    }

    fn write_json<T: Serialize>(&self, name: &str, value: &T) -> Result<(), Error> {
        // Plain data with string keys: serialisation cannot fail.
        let text = serde_json::to_string_pretty(value).unwrap_or_default() + "\n";
        written(&self.folder.file(name), self.folder.write_text(name, &text))
    }
}

fn denoised_layer(key: &str) -> String {
    format!("{key}.Y")
}

/// The layers that a unit keeps.
pub(super) fn layers(
    signal: Plane<f32>,
    denoised: Vec<Filtered>,
    counts: Option<Plane<u32>>,
    radiance: Option<&Plane<[f32; 3]>>,
) -> ExrLayers {
    let mut layers = ExrLayers::new(signal.width(), signal.height());
    layers.channels.push((SIGNAL.into(), Channel::F32(signal.into_vec())));
    for d in denoised {
        layers.channels.push((denoised_layer(d.key), Channel::F32(d.signal.into_vec())));
    }
    if let Some(counts) = counts {
        layers.push_integers(Single::SampleCount, counts);
    }
    if let Some(radiance) = radiance {
        layers.push_triples(Triple::Mean, radiance);
    }
    layers
}
