//! `expose`: converts an EXR of ours or of another renderer to frames of a camera.

use crate::default_settings::default_optics;
use crate::exposer::Exposer;
use crate::exr_image::{ExrImage, LensSource};
use crate::frame::Picture;
use crate::guard::{Output, check_outputs};
use crate::memory::estimate::MAX_WAITING;
use crate::outputs::{Align, extension, misfit, save_commented, save_values, values_words};
use crate::views::with_number;
use derive_setters::Setters;
use dunkelfeld_film::Plane;
use dunkelfeld_io::input::{InputFiles, Role, files_in};
use dunkelfeld_render::{Error, RenderSettings, SensorChoice, Session, Stage, written};
use dunkelfeld_sensor::{Exposure, ExposureNoise, Optics, Readout, SensorModel};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Settings of the exposure of an image.
#[derive(Clone, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ExposeSettings {
    /// The sensor.
    pub model: SensorModel,
    /// The lens: determines the irradiance on its axis from the radiance.
    #[setters(skip)]
    pub optics: Optics,
    /// The values of sensor and lens that an image of a render replaces by those of its render.
    pub of_image: OfImage,
    /// Focal length \[m\] of a lens that darkens the image with the fourth power of the cosine of the field angle. Its
    /// axis meets the middle of the image. `None` for a lens without vignetting, or for an image that already contains
    /// it.
    #[setters(into)]
    pub vignetting: Option<f64>,
    /// How pixels of the sensor form those of the film. An EXR of a render replaces it by its own.
    pub readout: Readout,
    /// The exposure. `None` selects automatic exposure: the 99.5 % quantile is at 90 % of saturation.
    #[setters(into)]
    pub exposure: Option<Exposure>,
    /// The sensor noise that is added: all of it, or less by the noise of the image.
    pub exposure_noise: ExposureNoise,
    /// Seed of the noise and of the device.
    pub seed: u64,
    /// Number of the first frame.
    pub first_frame: u32,
    /// Number of frames.
    pub frames: u32,
    /// The layer that contains radiance. `None` searches the names that renderers use.
    #[setters(into)]
    pub layer: Option<String>,
    /// Number of threads; 0 means one per core.
    pub threads: usize,
    /// Limit of memory \[bytes\] of the exposure.
    #[setters(into)]
    pub memory_limit: Option<u64>,
    /// The files that the settings were read from, such as a sensor file. An output must not replace one of them.
    pub inputs: InputFiles,
}

/// The values that an image of a render replaces by those of its render.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OfImage {
    /// The sensor, as the job of the render adjusts it.
    pub sensor: bool,
    /// f-number, transmission and magnification of the lens.
    pub lens: [bool; 3],
    /// Its point spread function, and its veiling glare.
    pub blur: [bool; 2],
}

/// The files to write. With several frames, each name contains the frame number before its extension, as in
/// `out-0007.png`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ExposeOutputs {
    /// 8-bit gamma-2.2 PNG.
    #[setters(into)]
    pub image: Option<PathBuf>,
    /// 16-bit linear grey values, PNG or TIFF.
    #[setters(into)]
    pub linear: Option<PathBuf>,
    /// The place of their bits.
    pub align: Align,
}

/// The result of an exposure.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ExposedFile {
    /// The image behind the camera, with its exposure.
    pub exposer: Exposer,
    /// Written frames: fewer than requested if the run was cancelled.
    pub frames: u32,
    /// The lens that was used.
    pub optics: Optics,
    /// The sources of its f-number, transmission and magnification.
    pub lens: [LensSource; 3],
    /// Seconds of the exposures alone.
    pub expose_seconds: f64,
    /// Seconds of computing pictures and writing files.
    pub write_seconds: f64,
    /// The files, in their order.
    pub files: Vec<PathBuf>,
}

/// Exposes an EXR, and writes the frames in their order. A cancelled run leaves the frames that it has finished. It
/// runs on its own threads. The values are the same for any number of them.
///
/// # Errors
/// As [`Exposer::open`], and files that cannot be written; earlier files remain.
pub fn expose_exr(
    input: &Path,
    settings: &ExposeSettings,
    outputs: &ExposeOutputs,
    session: &Session<'_>,
) -> Result<ExposedFile, Error> {
    check(settings)?;
    outputs.check(input, settings)?;
    let image = session.install(|| ExrImage::open(input, settings))?;
    let exposer = session.install(|| image.expose(settings))?;
    let ((optics, lens), left_out) = (image.lens(settings), image.left_out.clone());
    drop(image);
    let (expose_seconds, write_seconds) = (0.0, 0.0);
    let mut done = ExposedFile { exposer, frames: 0, optics, lens, expose_seconds, write_seconds, files: Vec::new() };
    let at_once = session.threads().min(MAX_WAITING) as u32;
    while done.frames < settings.frames && !session.is_cancelled() {
        let next = settings.first_frame + done.frames;
        let group: Vec<u32> = (next..=settings.last_frame()).take(at_once as usize).collect();
        session.report_share(Stage::Expose, f64::from(done.frames) / f64::from(settings.frames));
        let began = Instant::now();
        let frames: Vec<_> =
            session.install(|| group.iter().map(|&n| Ok((n, done.exposer.frame(n)?))).collect::<Result<_, Error>>())?;
        done.expose_seconds += began.elapsed().as_secs_f64();
        let began = Instant::now();
        // Errors are reported in the order of the frames, for any order of the threads.
        let written: Vec<Result<Vec<PathBuf>, Error>> = session.install(|| {
            let save = |(n, values): &(u32, Plane<u16>)| {
                save(&done.exposer, left_out.as_deref(), settings, outputs, *n, values)
            };
            frames.par_iter().map(save).collect()
        });
        done.write_seconds += began.elapsed().as_secs_f64();
        for files in written {
            done.files.extend(files?);
            done.frames += 1;
        }
    }
    Ok(done)
}

fn save(
    exposer: &Exposer,
    left_out: Option<&str>,
    settings: &ExposeSettings,
    outputs: &ExposeOutputs,
    number: u32,
    values: &Plane<u16>,
) -> Result<Vec<PathBuf>, Error> {
    let mut files = Vec::new();
    if let Some(path) = &outputs.image {
        let path = settings.numbered(path, number);
        save_commented(&Picture::from_values(values, exposer.model()), left_out, &path)?;
        files.push(path);
    }
    if let Some(path) = &outputs.linear {
        let path = settings.numbered(path, number);
        let mut words = values_words(exposer.model(), exposer.exposure());
        words.extend(left_out.iter().flat_map(|left_out| [", ", left_out]));
        save_values(values, exposer.model(), outputs.align, &words, &path)?;
        files.push(path);
    }
    Ok(files)
}

impl ExposeSettings {
    /// One frame through the lens of the image, with automatic exposure. For an image without a lens it has f/4 and
    /// transmission 0.9, and is far from the object. These are the values of a render without a job.
    ///
    /// # Errors
    /// None.
    pub fn new(model: SensorModel) -> Result<Self, Error> {
        Ok(Self {
            model,
            optics: default_optics()?,
            of_image: OfImage { sensor: false, lens: [true; 3], blur: [true; 2] },
            vignetting: None,
            readout: Readout::default(),
            exposure: None,
            exposure_noise: ExposureNoise::default(),
            seed: 0,
            first_frame: 0,
            frames: 1,
            layer: None,
            threads: 0,
            memory_limit: None,
            inputs: InputFiles::new(),
        })
    }

    /// The exposure of a render: its sensor, lens, exposure, seed and frame. `settings` are those with the lens combined
    /// with its camera ([`Project::fitted`](crate::Project::fitted), [`ProjectResult::settings`](crate::ProjectResult)).
    /// `None` without a sensor.
    ///
    /// # Errors
    /// None.
    pub fn of_render(settings: &RenderSettings) -> Result<Option<Self>, Error> {
        let SensorChoice::Emva { model, optics, exposure } = &settings.sensor else { return Ok(None) };
        Ok(Some(Self {
            optics: optics.clone(),
            of_image: OfImage::default(),
            exposure: *exposure,
            readout: settings.readout,
            exposure_noise: settings.exposure_noise,
            seed: settings.seed,
            first_frame: settings.frame,
            ..Self::new((**model).clone())?
        }))
    }

    /// The lens, instead of that of the image.
    #[must_use]
    pub fn with_optics(mut self, optics: Optics) -> Self {
        (self.optics, self.of_image.lens, self.of_image.blur) = (optics, [false; 3], [false; 2]);
        self
    }

    /// Number of the last frame.
    fn last_frame(&self) -> u32 {
        self.first_frame.saturating_add(self.frames.saturating_sub(1))
    }

    /// The existing files with the names of frames, and the first frame's name.
    fn frames_of(&self, path: &Path) -> Vec<PathBuf> {
        let first = self.numbered(path, self.first_frame);
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let is_frame = |file: &PathBuf| {
            let number = file.file_stem().and_then(|stem| stem.to_str()?.rsplit_once('-')?.1.parse::<u32>().ok());
            number.is_some_and(|number| {
                (self.first_frame..=self.last_frame()).contains(&number)
                    && self.numbered(path, number).file_name() == file.file_name()
            })
        };
        let mut files: Vec<PathBuf> = files_in(folder).into_iter().filter(is_frame).collect();
        if !files.iter().any(|file| file.file_name() == first.file_name()) {
            files.push(first);
        }
        files
    }

    /// The name of a frame's file. For a single frame it is the name of the output.
    pub fn numbered(&self, path: &Path, number: u32) -> PathBuf {
        if self.frames == 1 { path.to_path_buf() } else { with_number(path, number, self.last_frame()) }
    }
}

impl ExposeOutputs {
    /// Checks before the work whether its results can be written.
    ///
    /// # Errors
    /// No output at all, an invalid extension, a folder that does not exist or cannot be written to, two outputs in one
    /// file, a frame with the name of an input.
    pub fn check(&self, input: &Path, settings: &ExposeSettings) -> Result<(), Error> {
        let fault = |file: &Path, problem: String, help: &str| {
            Err(Error::Output { file: file.into(), problem, help: help.into() })
        };
        for (path, endings) in [(&self.image, &["png"][..]), (&self.linear, &["png", "tif", "tiff"])] {
            let Some(path) = path else { continue };
            if !endings.contains(&extension(path).as_str()) {
                let problem = misfit(path);
                return fault(path, problem, &format!("end it in .{}", endings.join(" or .")));
            }
            let first = settings.numbered(path, settings.first_frame);
            written(&first, dunkelfeld_io::atomic::check_writable(&first))?;
        }
        if self.named().next().is_none() {
            return Err(Error::setting("output", "no file is named", "name a picture, or linear grey values"));
        }
        self.check_apart(input, settings)
    }

    fn named(&self) -> impl Iterator<Item = Output<'_>> {
        let paths = [("the image", &self.image), ("the linear image", &self.linear)];
        paths.into_iter().filter_map(|(what, path)| Some((what, path.as_deref()?)))
    }

    /// A frame must not replace an input or another output.
    fn check_apart(&self, input: &Path, settings: &ExposeSettings) -> Result<(), Error> {
        let mut inputs = settings.inputs.clone();
        inputs.add(input, Role::Image);
        let outputs: Vec<Output<'_>> = self.named().collect();
        if settings.frames == 1 {
            return check_outputs(&outputs, &inputs);
        }
        // Different output names give different frame names.
        check_outputs(&outputs, &InputFiles::new())?;
        // Only frame names that exist already can be other files, for any number of frames.
        let frames: Vec<_> = outputs.iter().map(|&(what, path)| (what, settings.frames_of(path))).collect();
        let frames: Vec<Output<'_>> =
            frames.iter().flat_map(|(what, files)| files.iter().map(move |file| (*what, file.as_path()))).collect();
        check_outputs(&frames, &inputs)
    }

    /// Names the image after the input, in the current folder.
    pub fn set_default_image(&mut self, input: &Path) {
        let stem = input.file_stem().unwrap_or_else(|| "render".as_ref());
        self.image = Some(PathBuf::from(stem).with_extension("png"));
    }
}

pub(crate) fn check(s: &ExposeSettings) -> Result<(), Error> {
    if s.frames == 0 || s.first_frame.checked_add(s.frames - 1).is_none() {
        let problem = format!("{} frames from number {} on cannot be counted", s.frames, s.first_frame);
        return Err(Error::setting("frames", problem, "use at least 1, and numbers below 2^32"));
    }
    if let Some(exposure) = s.exposure.filter(|_| !s.of_image.sensor) {
        s.model.check_exposure(exposure)?;
    }
    if s.vignetting.is_some_and(|f| !(1e-6..=1e3).contains(&f)) {
        return Err(Error::setting("vignetting", "the focal length is out of range", "use 1 um to 1 km, as in 12mm"));
    }
    if s.exposure_noise == ExposureNoise::Matched {
        if s.frames > 1 {
            let problem =
                "frames of one image share its noise, so that matched frames together would have too little noise";
            let help = "render anew for each frame, or leave out --exposure-noise matched";
            return Err(Error::setting("exposure noise", problem, help));
        }
        if s.layer.is_some() {
            let problem = "the layer `variance` is that of the mean, not of another layer";
            return Err(Error::setting("exposure noise", problem, "leave out --layer, or --exposure-noise matched"));
        }
    }
    Ok(())
}
