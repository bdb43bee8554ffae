//! The stored results of a long computation: a folder with a small record and an image for each finished render, and
//! the key of the renders.

use dunkelfeld::film::{Plane, RenderKey};
use dunkelfeld::outputs::written;
use dunkelfeld::scene::{RayGenerator, Scene};
use dunkelfeld::{Error, RenderSettings};
use dunkelfeld_io::InputError;
use dunkelfeld_io::exr::{Channel, ExrLayers, read_exr, write_exr};
use dunkelfeld_io::layers::Triple;
use dunkelfeld_io::results::ResultsFolder;
use dunkelfeld_sampling::hash_u64;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Help for a finished render that cannot be read back.
const DAMAGED: &str =
    "delete this file and the .json of the same name, to have it rendered again, or start anew with --restart";

/// The folder of the renders in that of the report.
pub(crate) const UNITS: &str = "units";
/// The key of the renders of a study: that of their samples, the version of the folder, threads, sensor, pilot, denoisers.
pub(crate) fn study_key(
    version: u32,
    scene: &Scene,
    camera: &RayGenerator,
    settings: &RenderSettings,
    threads: usize,
    denoisers: &[String],
) -> RenderKey {
    let mut key = RenderKey::of_samples(scene, camera, settings);
    key.add("version of the folder", version);
    key.add("number of threads", threads);
    key.add_sensor(&settings.sensor);
    key.add("samples of the pilot", settings.pilot_spp);
    key.add("list of denoisers", if denoisers.is_empty() { "none".into() } else { denoisers.join(", ") });
    key
}

/// A hash of a text.
pub(crate) fn hash_text(text: &str) -> u64 {
    text.bytes().fold(text.len() as u64, |h, b| hash_u64([h, u64::from(b)]))
}

/// The folder of the finished renders.
#[derive(Debug)]
pub(crate) struct Kept {
    folder: ResultsFolder,
    manifest: &'static str,
    /// Width and height of the renders, once they are fixed.
    size: OnceLock<[u32; 2]>,
}

impl Kept {
    /// Opens the renders in a report's folder, and locks them against other processes; `restart` discards its content.
    /// `manifest` is the name of the file with the key.
    ///
    /// # Errors
    /// It cannot be made, another process writes it, or it contains files of other kinds, which remain as they are.
    pub(crate) fn open(home: &Path, manifest: &'static str, restart: bool) -> Result<Self, Error> {
        let path = home.join(UNITS);
        let fault = |problem: String, help: &str| Error::Output { file: path.clone(), problem, help: help.into() };
        let broken = |e: std::io::Error| fault(format!("cannot be used: {e}"), "name another folder with -o");
        let folder = ResultsFolder::open(&path)?;
        let is_ours = folder.is_empty().map_err(broken)? || folder.file(manifest).is_file();
        if !is_ours {
            let problem = format!("holds other files than those of such a measurement: there is no {manifest}");
            return Err(fault(problem, "name another folder with -o"));
        }
        let folder = if restart { folder.clear().map_err(broken)? } else { folder };
        Ok(Self { folder, manifest, size: OnceLock::new() })
    }

    /// Is there a measurement of any kind in a report's folder?
    pub(crate) fn is_there(home: &Path) -> bool {
        home.join(UNITS).is_dir()
    }

    /// The key of the folder. `None` if it has none yet.
    pub(crate) fn manifest<M: for<'a> Deserialize<'a>>(&self) -> Result<Option<M>, Error> {
        self.read_json(self.manifest)
    }

    /// Sets the key of the folder. `facts` are those of the manifest, also of an existing one.
    ///
    /// # Errors
    /// It has another key.
    pub(crate) fn bind<M>(&self, manifest: &M, key: impl Fn(&M) -> &RenderKey) -> Result<(), Error>
    where
        M: Serialize + for<'a> Deserialize<'a>,
    {
        let Some(there) = self.manifest::<M>()? else { return self.write_json(self.manifest, manifest) };
        match key(&there).difference(key(manifest)) {
            None => Ok(()),
            Some(difference) => {
                let problem = format!("holds the results of another run: {difference}");
                let help = "name another folder with -o, or discard these results with --restart";
                Err(InputError::new(self.folder.file(self.manifest), "the whole file", problem, help).into())
            }
        }
    }

    /// The record of a render, if it is finished.
    pub(crate) fn record<R: for<'a> Deserialize<'a>>(&self, name: &str) -> Result<Option<R>, Error> {
        self.read_json(&format!("{name}.json"))
    }

    /// Stores a finished render: the image first, then the record, which marks it as finished.
    pub(crate) fn keep<R: Serialize>(&self, name: &str, record: &R, layers: ExrLayers) -> Result<(), Error> {
        let image = format!("{name}.exr");
        written(&self.folder.file(&image), write_exr(&self.folder.file(&image), layers))?;
        self.write_json(&format!("{name}.json"), record)
    }

    /// A file of the folder.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.folder.file(name)
    }

    /// Sets the width and height of all renders of the folder. From then on, images of another size count as damaged.
    pub(crate) fn expect_size(&self, size: [u32; 2]) {
        self.size.get_or_init(|| size);
    }

    /// The layers of a finished render.
    ///
    /// # Errors
    /// The image does not exist, is no EXR, or has another size than the renders of the folder.
    pub(crate) fn layers(&self, name: &str) -> Result<ExrLayers, Error> {
        let image = format!("{name}.exr");
        let damaged = |e: InputError| InputError { help: DAMAGED.into(), ..e };
        let layers = read_exr(&self.folder.file(&image)).map_err(damaged)?;
        match self.size.get() {
            Some(&[width, height]) if (layers.width, layers.height) != (width, height) => {
                let problem = format!(
                    "has {} x {} pixels, the renders of this folder {width} x {height}",
                    layers.width, layers.height
                );
                Err(InputError::new(self.folder.file(&image), "the whole file", problem, DAMAGED).into())
            }
            _ => Ok(layers),
        }
    }

    /// A plane of a finished render.
    pub(crate) fn plane(&self, name: &str, layer: &str) -> Result<Plane<f32>, Error> {
        let layers = self.layers(name)?;
        let plane = match layers.channel(layer) {
            Some(Channel::F32(data)) => Plane::from_vec(layers.width, layers.height, data.clone()),
            _ => None,
        };
        plane.ok_or_else(|| self.lacks(name, layer))
    }

    /// The mean radiance of the reference behind the lens.
    pub(crate) fn radiance(&self, name: &str) -> Result<Plane<[f32; 3]>, Error> {
        self.layers(name)?.triples(Triple::Mean).ok_or_else(|| self.lacks(name, "R G B"))
    }

    /// The error of a finished render without a required layer.
    pub(crate) fn lacks(&self, name: &str, layer: &str) -> Error {
        let file = self.folder.file(&format!("{name}.exr"));
        InputError::new(file, format!("layer {layer}"), "is missing", DAMAGED).into()
    }

    fn read_json<T: for<'a> Deserialize<'a>>(&self, name: &str) -> Result<Option<T>, Error> {
        let Some(text) = self.folder.read_text(name)? else { return Ok(None) };
        let parsed = serde_json::from_str(&text);
        parsed.map(Some).map_err(|e| {
            let place = format!("line {}", e.line());
            let help = "delete this file to measure it again, or start anew with --restart";
            InputError::new(self.folder.file(name), place, e.to_string(), help).into()
        })
    }

    fn write_json<T: Serialize>(&self, name: &str, value: &T) -> Result<(), Error> {
        // Plain data with string keys: serialisation cannot fail.
        let text = serde_json::to_string_pretty(value).unwrap_or_default() + "\n";
        written(&self.folder.file(name), self.folder.write_text(name, &text))
    }
}

/// Adds a plane under its own name.
pub(crate) fn push_plane(layers: &mut ExrLayers, name: &str, plane: Plane<f32>) {
    layers.channels.push((name.into(), Channel::F32(plane.into_vec())));
}
