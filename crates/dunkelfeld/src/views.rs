//! Several cameras of one job: their names, their files, and the clock of each render.

use crate::guard::{DefaultPath, Output, check_outputs, free_picture};
use crate::outputs::OutputPaths;
use crate::project::Project;
use dunkelfeld_io::input::InputFiles;
use dunkelfeld_render::Error;
use std::path::{Path, PathBuf};

impl Project {
    /// Names of the cameras that the job defines and enables, in its order, and of those that only captures name; none if the
    /// settings name a camera. A camera that is in no capture is left out. Each of them gets a render of its own.
    pub fn defined_cameras(&self) -> Vec<String> {
        if self.settings.camera.is_some() {
            return Vec::new();
        }
        let enabled = self.job.camera.defined.iter().filter(|camera| camera.is_enabled());
        let mut cameras: Vec<String> = enabled.map(|camera| camera.name.clone()).collect();
        let own: Vec<&String> = self.job.captures.iter().filter_map(|capture| capture.camera.as_ref()).collect();
        if !own.is_empty() && cameras.is_empty() {
            cameras.extend(self.scene.cameras().first().map(|first| first.name.clone()));
        }
        if !own.is_empty() && own.len() == self.job.captures.len() {
            cameras.retain(|camera| own.contains(&camera));
        }
        for camera in own {
            if !cameras.contains(camera) {
                cameras.push(camera.clone());
            }
        }
        cameras
    }

    /// Gives later renders clocks of their own: the time of loading belongs to the first one.
    pub fn end_command_clock(&mut self) {
        self.command = None;
    }

    /// The default name of the picture: that of the opened file `input` with `.png`, in the current folder. It is
    /// another one where an input or another output of the project has it.
    pub fn default_image_path(&self, input: &Path) -> DefaultPath {
        self.default_image(input, None, &self.outputs)
    }

    /// The default name of the picture of one of several cameras, beside its other outputs.
    pub fn default_image_path_of(&self, input: &Path, camera: &str, outputs: &OutputPaths) -> DefaultPath {
        self.default_image(input, Some(camera), outputs)
    }

    fn default_image(&self, input: &Path, camera: Option<&str>, outputs: &OutputPaths) -> DefaultPath {
        let usual = PathBuf::from(input.file_stem().unwrap_or_else(|| "render".as_ref())).with_extension("png");
        let usual = camera.map_or(usual.clone(), |camera| with_camera(&usual, camera));
        let others = OutputPaths { image: None, ..outputs.clone() };
        let checkpoint = self.settings.run.checkpoint.as_ref().map(|keep| ("the checkpoint", keep.path.as_path()));
        free_picture(usual, |path| {
            let image = ("the image", path);
            check_outputs(&[image], &self.inputs)?;
            // Another name for the image cannot avoid faults of the other outputs.
            let mut others = others.named().into_iter().chain(checkpoint);
            others.try_for_each(|other| check_outputs(&[other, image], &InputFiles::new()))
        })
    }

    /// Checks the outputs of several renders of the project before the first one: each for itself, and that no file is
    /// named twice.
    ///
    /// # Errors
    /// The first fault found, with help.
    pub fn check_outputs_of_all(&self, renders: &[OutputPaths]) -> Result<(), Error> {
        let mut inputs = self.inputs.clone();
        inputs.add_library(self.settings.denoise.oidn.as_deref());
        for outputs in renders {
            outputs.check_beside(self.settings.has_sensor(), None, &inputs)?;
        }
        let all: Vec<Output<'_>> = renders.iter().flat_map(OutputPaths::named).collect();
        check_outputs(&all, &InputFiles::new())
    }
}

impl OutputPaths {
    /// The files of one of several cameras: its name is in front of the extension, as in `panel-left.png`. Characters
    /// that are neither letters nor digits nor one of `-`, `_` and `.` become `_`.
    #[must_use]
    pub fn for_camera(&self, camera: &str) -> Self {
        self.renamed(|path| with_camera(path, camera))
    }

    /// The files of one of several frames, up to the number `last`, as
    /// [`ExposeSettings::numbered`](crate::ExposeSettings::numbered).
    #[must_use]
    pub fn for_frame(&self, number: u32, last: u32) -> Self {
        self.renamed(|path| with_number(path, number, last))
    }

    fn renamed(&self, name: impl Fn(&Path) -> PathBuf) -> Self {
        let named = |path: &Option<PathBuf>| path.as_deref().map(&name);
        Self {
            align: self.align,
            image: named(&self.image),
            linear: named(&self.linear),
            exr: named(&self.exr),
            stats: named(&self.stats),
            plan: named(&self.plan),
        }
    }
}

fn with_camera(path: &Path, camera: &str) -> PathBuf {
    with_suffix(path, &plain_name(camera))
}

/// The name of a camera in the name of a file.
pub(crate) fn plain_name(camera: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_.".contains(c);
    camera.chars().map(|c| if is_plain(c) { c } else { '_' }).collect()
}

/// The name with a suffix in front of the extension.
fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_os_string();
    name.push("-");
    name.push(suffix);
    if let Some(ending) = path.extension() {
        name.push(".");
        name.push(ending);
    }
    path.with_file_name(name)
}

/// The name of the file of one of several frames, up to `last`: of four digits at least.
pub(crate) fn with_number(path: &Path, number: u32, last: u32) -> PathBuf {
    let digits = last.to_string().len().max(4);
    with_suffix(path, &format!("{number:0digits$}"))
}
