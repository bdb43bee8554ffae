//! `expose`: converts an EXR of ours or of another renderer to frames of a camera.

use crate::camera_fit::DEFAULT_F_NUMBER;
use crate::commands::denoise::{invalid_variances_of, radiance_of};
use crate::frame::Picture;
use crate::guard::{DefaultPath, Output, check_outputs, free_file};
use crate::memory::expose_account;
use crate::noise_compensation::CompensationInputs;
use crate::outputs::{VIGNETTING, attributes, extension, misfit, save_plain_picture, save_values, values_words};
use derive_setters::Setters;
use dunkelfeld_adaptive::required_samples::SensorNoise;
use dunkelfeld_adaptive::variance::inputs::{NoiseInputs, PixelFeatures, pixel_features};
use dunkelfeld_film::{Plane, Scatter};
use dunkelfeld_io::InputError;
use dunkelfeld_io::exr::{ExrLayers, ExrSize, read_exr_if};
use dunkelfeld_io::input::{InputFiles, Role, files_in};
use dunkelfeld_io::job::LensSettings;
use dunkelfeld_io::layers::{Single, Triple};
use dunkelfeld_render::Error;
use dunkelfeld_render::film_noise::{FilmNoise, levels, per_luminance, sensor_noise, signal_scatter};
use dunkelfeld_render::{Session, thread_count};
use dunkelfeld_render::{Stage, written};
use dunkelfeld_sensor::{
    Device, Exposure, ExposureNoise, FrameKey, ImageExposure, Optics, Response, SensorModel, Weights, electrons,
};
use rayon::prelude::*;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Maximum number of frames that wait for the writer.
pub(crate) const MAX_WAITING: usize = 16;
/// Minimum number of digits of the frame number in a file name.
const DIGITS: usize = 4;

/// Settings of the exposure of an image.
#[derive(Clone, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ExposeSettings {
    /// The sensor.
    pub model: SensorModel,
    /// The lens: determines the irradiance on its axis from the radiance.
    pub optics: Optics,
    /// Focal length \[m\] of a lens that darkens the image with the fourth power of the cosine of the field angle. Its
    /// axis meets the middle of the image. `None` for a lens without vignetting, or for an image that already contains
    /// it.
    #[setters(into)]
    pub vignetting: Option<f64>,
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
}

/// The result of an exposure.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ExposedFile {
    /// Width and height \[pixels\].
    pub size: [u32; 2],
    /// Written frames: fewer than requested if the run was cancelled.
    pub frames: u32,
    /// The exposure that was used.
    pub exposure: Exposure,
    /// Was the image so dark that no automatic exposure exists?
    pub no_light: bool,
    /// Share of pixels whose expected electrons fill the well or reach the end of the converter.
    pub saturated: f64,
    /// Share of pixels where matched exposure can hold, from the noise data that the file contains. `None` if all of
    /// the camera's noise was drawn.
    pub matched: Option<f64>,
    /// Pixels whose radiance was negative or not a number (they count as black) or infinite (they saturate).
    pub invalid: u64,
    /// Pixels whose variance was negative or not a number, where it was required. Such a variance counts as unknown.
    pub invalid_variances: u64,
    /// Seconds of the exposures alone.
    pub expose_seconds: f64,
    /// Seconds of computing pictures and writing files.
    pub write_seconds: f64,
    /// The files, in their order.
    pub files: Vec<PathBuf>,
}

/// An image and a camera. It computes frames.
#[derive(Clone, Debug)]
pub struct Exposer {
    device: Device,
    exposure: Exposure,
    seed: u64,
    electrons: Plane<f32>,
    /// The noise of the electrons, as far as the file contains it. `None` if all of the camera's noise is drawn.
    known: Option<CompensationInputs>,
    no_light: bool,
    invalid: u64,
    invalid_variances: u64,
}

impl Exposer {
    /// Combines mean radiance [W/(m^2 sr)] with a camera, and with the noise of the radiance for matched exposure.
    ///
    /// # Errors
    /// An exposure outside the ranges of the sensor.
    fn new(
        mut radiance: Plane<[f32; 3]>,
        settings: &ExposeSettings,
        mut noise: Option<NoiseLayers>,
    ) -> Result<Self, Error> {
        let ExposeSettings { model, optics, .. } = settings;
        let (width, height) = (radiance.width(), radiance.height());
        if let Some(focal_length) = settings.vignetting {
            let distance = focal_length * (1.0 + optics.magnification()) / model.spec().pixel_pitch.0;
            // Transmission of the lens, relative to its axis.
            let share = Plane::from_fn(width, height, |x, y| cosine_fourth(x, y, width, height, distance));
            radiance = darkened(&radiance, &share);
            noise = noise.map(|noise| noise.darkened(&share));
        }
        let ImageExposure { exposure, no_light } = ImageExposure::new(settings.exposure, &radiance, model, optics)?;
        let response = Response::new(model, optics, exposure);
        let mean = electrons(&radiance, &response);
        let invalid_variances = noise.as_ref().map_or(0, |noise| invalid_variances_of(&noise.variance));
        let known = noise.map(|noise| noise.known(response, sensor_noise(model, exposure), &radiance));
        let device = Device::new(model.clone(), settings.seed, width, height);
        let (electrons, invalid) = (mean.plane, mean.invalid);
        Ok(Self { device, exposure, seed: settings.seed, electrons, known, no_light, invalid, invalid_variances })
    }

    /// Reads an EXR and combines it with a camera.
    ///
    /// # Errors
    /// A file that cannot be read or has no such layer; settings outside their range; noise that is to be matched, but
    /// is not in the file.
    pub fn open(path: &Path, settings: &ExposeSettings) -> Result<Self, Error> {
        check(settings)?;
        let is_matched = settings.exposure_noise == ExposureNoise::Matched;
        let agree = |size: ExrSize| {
            let threads = thread_count(settings.threads);
            let account = expose_account((size.width, size.height), size.bytes, is_matched, threads);
            let help = "expose a smaller image, one with fewer layers, or on fewer --threads";
            account.check(settings.memory_limit, 0, help)
        };
        let layers = read_exr_if(path, Role::Image, &mut InputFiles::new(), agree)?;
        if settings.vignetting.is_some() && attributes(&layers).contains_key(VIGNETTING) {
            let problem = "the lens of the render has darkened its corners already";
            return Err(InputError::new(path, "--vignetting", problem, "leave out --vignetting").into());
        }
        let radiance = radiance_of(path, &layers, settings.layer.as_deref())?;
        let noise = match settings.exposure_noise {
            ExposureNoise::Plain => None,
            ExposureNoise::Matched => Some(NoiseLayers::from_layers(&layers).ok_or_else(|| {
                let problem = "is missing, so the noise of the render is unknown";
                InputError::new(path, "the layer `variance`", problem, "leave out --exposure-noise matched")
            })?),
        };
        Self::new(radiance, settings, noise)
    }

    /// Width and height \[pixels\].
    pub fn size(&self) -> [u32; 2] {
        [self.electrons.width(), self.electrons.height()]
    }

    /// The camera.
    pub fn model(&self) -> &SensorModel {
        self.device.model()
    }

    /// The exposure of the settings, or the automatic one.
    pub fn exposure(&self) -> Exposure {
        self.exposure
    }

    /// Expected photo-electrons of each pixel.
    pub fn electrons(&self) -> &Plane<f32> {
        &self.electrons
    }

    /// Grey values \[DN\] of the frame with this number. They are a function of image, settings, seed and number. Runs
    /// on the threads of the current pool.
    ///
    /// # Errors
    /// None, as the planes are of one size.
    pub fn frame(&self, number: u32) -> Result<Plane<u16>, Error> {
        let [width, height] = self.size();
        let key = FrameKey { seed: self.seed, frame: number };
        let mut values = Plane::new(width, height, 0u16);
        values.data_mut().par_chunks_mut(width.max(1) as usize).enumerate().try_for_each(|(y, row)| {
            let rows = y as u32..y as u32 + 1;
            match &self.known {
                Some(k) => self.device.expose_rows_matched(&self.electrons, &k.variance, self.exposure, key, rows, row),
                None => self.device.expose_rows(&self.electrons, self.exposure, key, rows, row),
            }
        })?;
        Ok(values)
    }

    fn matched(&self) -> Option<f64> {
        let held = self.known.as_ref()?.held(&self.electrons, self.model(), self.exposure);
        Some(held.data().iter().filter(|held| **held).count() as f64 / held.data().len().max(1) as f64)
    }

    fn saturated(&self) -> f64 {
        let model = self.model();
        let full = (model.saturation().0 - model.dark_electrons(self.exposure.time()).0) as f32;
        let electrons = self.electrons.data();
        electrons.iter().filter(|&&e| e >= full).count() as f64 / electrons.len().max(1) as f64
    }
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
    let exposer = session.install(|| Exposer::open(input, settings))?;
    let mut done = ExposedFile {
        size: exposer.size(),
        frames: 0,
        exposure: exposer.exposure,
        no_light: exposer.no_light,
        saturated: exposer.saturated(),
        matched: exposer.matched(),
        invalid: exposer.invalid,
        invalid_variances: exposer.invalid_variances,
        expose_seconds: 0.0,
        write_seconds: 0.0,
        files: Vec::new(),
    };
    let at_once = session.threads().min(MAX_WAITING) as u32;
    while done.frames < settings.frames && !session.is_cancelled() {
        let next = settings.first_frame + done.frames;
        let group: Vec<u32> = (next..=settings.last_frame()).take(at_once as usize).collect();
        session.report_share(Stage::Expose, f64::from(done.frames) / f64::from(settings.frames));
        let began = Instant::now();
        let frames: Vec<_> =
            session.install(|| group.iter().map(|&n| Ok((n, exposer.frame(n)?))).collect::<Result<_, Error>>())?;
        done.expose_seconds += began.elapsed().as_secs_f64();
        let began = Instant::now();
        // Errors are reported in the order of the frames, for any order of the threads.
        let written: Vec<Result<Vec<PathBuf>, Error>> = session
            .install(|| frames.par_iter().map(|(n, values)| save(&exposer, settings, outputs, *n, values)).collect());
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
    settings: &ExposeSettings,
    outputs: &ExposeOutputs,
    number: u32,
    values: &Plane<u16>,
) -> Result<Vec<PathBuf>, Error> {
    let mut files = Vec::new();
    if let Some(path) = &outputs.image {
        let path = settings.numbered(path, number);
        save_plain_picture(&Picture::from_values(values, exposer.model()), &path)?;
        files.push(path);
    }
    if let Some(path) = &outputs.linear {
        let path = settings.numbered(path, number);
        save_values(values, &values_words(exposer.model(), exposer.exposure), &path)?;
        files.push(path);
    }
    Ok(files)
}

impl ExposeSettings {
    /// One frame through a lens of f/4 and transmission 0.9, far from the object, with automatic exposure. These are
    /// the values of a render without a job.
    ///
    /// # Errors
    /// None.
    pub fn new(model: SensorModel) -> Result<Self, Error> {
        Ok(Self {
            model,
            optics: Optics::new(DEFAULT_F_NUMBER, LensSettings::default().transmission, 0.0)?,
            vignetting: None,
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
        if self.frames == 1 {
            return path.to_path_buf();
        }
        let digits = self.last_frame().to_string().len().max(DIGITS);
        let mut name = path.file_stem().unwrap_or_default().to_os_string();
        name.push(format!("-{number:0digits$}"));
        if let Some(ending) = path.extension() {
            name.push(".");
            name.push(ending);
        }
        path.with_file_name(name)
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

    /// Names the image after the input, or gives it another name where a frame would replace an input.
    pub fn set_default_image(&mut self, input: &Path, settings: &ExposeSettings) -> DefaultPath {
        let usual = PathBuf::from(input.file_stem().unwrap_or_else(|| "render".as_ref())).with_extension("png");
        let chosen = free_file(usual, "exposed", |path| {
            Self { image: Some(path.to_path_buf()), linear: None }.check_apart(input, settings)
        });
        self.image = Some(chosen.path.clone());
        chosen
    }
}

fn check(s: &ExposeSettings) -> Result<(), Error> {
    if s.frames == 0 || s.first_frame.checked_add(s.frames - 1).is_none() {
        let problem = format!("{} frames from number {} on cannot be counted", s.frames, s.first_frame);
        return Err(Error::setting("frames", problem, "use at least 1, and numbers below 2^32"));
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

/// The share of light behind a thin lens that reaches a pixel, relative to the axis in the middle of the image: cos^4 of the
/// field angle, at the pixel's centre. `distance` of the image from
/// the lens in pixels.
fn cosine_fourth(x: u32, y: u32, width: u32, height: u32, distance: f64) -> f64 {
    let off = |at: u32, size: u32| (f64::from(at) + 0.5 - 0.5 * f64::from(size)) / distance;
    let tangent_squared = off(x, width).powi(2) + off(y, height).powi(2);
    (1.0 + tangent_squared).powi(-2)
}

/// The image behind a lens with this relative transmission.
fn darkened(radiance: &Plane<[f32; 3]>, share: &Plane<f64>) -> Plane<[f32; 3]> {
    let mut shares = share.data().iter();
    radiance.map(|&pixel| {
        let share = shares.next().copied().unwrap_or(1.0);
        pixel.map(|v| (f64::from(v) * share) as f32)
    })
}

/// The noise data of a mean, from a file.
struct NoiseLayers {
    /// Variance of the mean, by channel.
    variance: Plane<[f32; 3]>,
    /// Covariance of its channels.
    covariance: Plane<[f32; 3]>,
    /// Further data of a file of ours.
    pixels: Option<PixelLayers>,
}

/// Surface ids and samples of the pixels.
struct PixelLayers {
    counts: Plane<u32>,
    surface: Plane<PixelFeatures>,
    scatter: Plane<Option<Scatter>>,
}

impl NoiseLayers {
    /// `None` without variances.
    fn from_layers(layers: &ExrLayers) -> Option<Self> {
        let variance = layers.triples(Triple::Variance)?;
        let covariance =
            layers.triples(Triple::Covariance).unwrap_or_else(|| variance.map(|_| Weights::UNKNOWN_COVARIANCE));
        let whole = [layers.integers(Single::SampleCount), layers.integers(Single::ObjectId)];
        let pixels = match (whole, layers.triples(Triple::Normal)) {
            ([Some(counts), Some(objects)], Some(normals)) => {
                let scatter = [Single::Scatter, Single::LargestScatter].map(|layer| layers.single(layer));
                let scatter = match scatter {
                    [Some(all), Some(largest)] => {
                        let mut largest = largest.data().iter();
                        all.map(|&all| {
                            let largest = f64::from(*largest.next()?);
                            let all = f64::from(all);
                            (all.is_finite() && all >= 0.0 && (0.0..=all).contains(&largest))
                                .then_some(Scatter { all, largest })
                        })
                    }
                    _ => counts.map(|_| None),
                };
                Some(PixelLayers { counts, surface: pixel_features(&objects, &normals), scatter })
            }
            _ => None,
        };
        Some(Self { variance, covariance, pixels })
    }

    fn darkened(self, share: &Plane<f64>) -> Self {
        let squares = share.map(|s| s * s);
        let mut shares = share.data().iter();
        let pixels = self.pixels.map(|PixelLayers { counts, surface, scatter }| {
            let scatter = scatter.map(|&scatter| {
                let share = shares.next().copied().unwrap_or(1.0);
                scatter.map(|s| signal_scatter(s, share))
            });
            PixelLayers { counts, surface, scatter }
        });
        let [variance, covariance] = [&self.variance, &self.covariance].map(|plane| darkened(plane, &squares));
        Self { variance, covariance, pixels }
    }

    /// The noise of the electrons of a sensor: as in a render if the file contains the ids of the surfaces in the
    /// pixels, otherwise from each pixel's own variance.
    fn known(self, response: Response, sensor: SensorNoise, mean: &Plane<[f32; 3]>) -> CompensationInputs {
        let (width, height) = (mean.width(), mean.height());
        let Some(PixelLayers { counts, surface, scatter }) = self.pixels else {
            let own = |x, y| response.at(x, y).variance(*self.variance.at(x, y), *self.covariance.at(x, y)) as f32;
            return CompensationInputs {
                variance: Plane::from_fn(width, height, own),
                is_rare: Plane::new(width, height, false),
            };
        };
        let view = |weights: &Weights, rows: &Range<u32>| {
            let (top, rows) = (rows.start, rows.len() as u32);
            let own = Plane::from_fn(width, rows, |x, y| weights.electrons(*mean.at(x, top + y)).0 as f32);
            let variance = Plane::from_fn(width, rows, |x, y| {
                weights.variance(*self.variance.at(x, top + y), *self.covariance.at(x, top + y)) as f32
            });
            let largest = Plane::from_fn(width, rows, |x, y| {
                // The value follows from the distance of the largest sample to the mean of all.
                let (x, y) = (x, top + y);
                let (per_luminance, luminance) = per_luminance(*weights, mean.at(x, y).map(f64::from));
                let others = f64::from(counts.at(x, y).saturating_sub(1));
                let off = scatter.at(x, y).map_or(0.0, |s| others * s.largest.sqrt());
                (per_luminance * (luminance + off)) as f32
            });
            NoiseInputs {
                counts: Plane::from_fn(width, rows, |x, y| *counts.at(x, top + y)),
                level: levels(&own, &variance, Some(sensor)),
                mean: own,
                variance,
                scatter: Plane::from_fn(width, rows, |x, y| {
                    let (per_luminance, _) = per_luminance(*weights, mean.at(x, top + y).map(f64::from));
                    scatter.at(x, top + y).map(|s| signal_scatter(s, per_luminance))
                }),
                largest,
                surface: Plane::from_fn(width, rows, |x, y| *surface.at(x, top + y)),
            }
        };
        let views = |rows: Range<u32>| response.kinds().iter().map(|weights| view(weights, &rows)).collect();
        let own = Plane::from_fn(width, height, |x, y| response.at(x, y).electrons(*mean.at(x, y)).0 as f32);
        CompensationInputs::from_noise(&FilmNoise::from_estimates(own, counts.clone(), views, response, Some(sensor)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A field angle of 45 degrees has cos^4 = 1/4.
    #[test]
    fn the_edge_is_darker_by_the_fourth_power_of_the_cosine() {
        assert_eq!(cosine_fourth(1, 1, 3, 3, 50.0), 1.0);
        assert!((cosine_fourth(100, 0, 101, 1, 50.0) - 0.25).abs() < 1e-12);
        assert!((cosine_fourth(0, 0, 101, 1, 50.0) - 0.25).abs() < 1e-12);
        assert!((cosine_fourth(0, 100, 1, 101, 50.0) - 0.25).abs() < 1e-12);
    }
}
