//! Writes results to files: pictures, raw values, layers, the plan.

use crate::frame::{Frame, Picture};
use crate::guard::{Output, check_outputs};
use derive_setters::Setters;
use dunkelfeld_film::{Film, FilmLayers, NO_ID, PixelSums, Plane};
use dunkelfeld_integrator::PixelIds;
use dunkelfeld_io::InputError;
use dunkelfeld_io::exr::{ExrHead, ExrLayers, read_exr_recorded, write_exr, write_exr_rows};
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_io::job::{self, Job};
use dunkelfeld_io::layers::{Single, Triple};
use dunkelfeld_io::picture::Picture as File;
use dunkelfeld_io::png::png_bytes;
use dunkelfeld_radiometry::Number;
use dunkelfeld_render::Error;
use dunkelfeld_render::{RenderSettings, SensorChoice};
use dunkelfeld_render::{RenderedFilm, SavedFilm};
use dunkelfeld_scene::Effect;
use dunkelfeld_sensor::{Exposure, Optics, Readout, SensorModel};
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};

pub use crate::exr_image::{ExrImage, LensSource};
pub use crate::film_files::{save_film, save_film_files};
pub use crate::project::EachCapture;
pub use dunkelfeld_io::job::Align;
pub use dunkelfeld_render::written;

/// The files to write. A file without a path is not written.
#[derive(Clone, Debug, Default, PartialEq, Eq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct OutputPaths {
    /// 8-bit gamma-2.2 PNG.
    #[setters(into)]
    pub image: Option<PathBuf>,
    /// 16-bit linear PNG or TIFF, by extension.
    #[setters(into)]
    pub linear: Option<PathBuf>,
    /// EXR with all layers.
    #[setters(into)]
    pub exr: Option<PathBuf>,
    /// Statistics as JSON.
    #[setters(into)]
    pub stats: Option<PathBuf>,
    /// EXR with the sample plan alone.
    #[setters(into)]
    pub plan: Option<PathBuf>,
    /// The place of the bits of linear grey values.
    pub align: Align,
}

impl OutputPaths {
    /// The files that keys of a job name, as lines of TOML: `output.image = "a.png"`.
    ///
    /// # Errors
    /// Keys and values that a job may not have.
    pub fn of_keys(keys: &str) -> Result<Self, Error> {
        Ok(Self::of_job(&Job::from_text("the keys", format!("scene = \"none\"\n{keys}"))?))
    }

    pub(crate) fn of_job(job: &Job) -> Self {
        let job::OutputSettings { image, linear, exr, stats, plan, align } = job.output.clone();
        Self { image, linear, exr, stats, plan, align }
    }

    /// The outputs, each with its name in messages and its endings.
    fn all(&self) -> impl Iterator<Item = (&'static str, &Path, &'static [&'static str])> {
        let paths: [(_, _, &[_]); 5] = [
            ("the image", &self.image, &["png"]),
            ("the linear image", &self.linear, &["png", "tif", "tiff"]),
            ("the EXR", &self.exr, &["exr"]),
            ("the statistics", &self.stats, &["json"]),
            ("the plan", &self.plan, &["exr"]),
        ];
        paths.into_iter().filter_map(|(what, path, endings)| Some((what, path.as_deref()?, endings)))
    }

    /// Is no file named?
    pub(crate) fn is_empty(&self) -> bool {
        self.all().next().is_none()
    }

    /// The outputs, each with its name in messages.
    pub(crate) fn named(&self) -> Vec<Output<'_>> {
        self.all().map(|(what, path, _)| (what, path)).collect()
    }

    /// Detects before the render the faults that would occur after it: folders that do not exist or cannot be written
    /// to, invalid names, two outputs in one file.
    ///
    /// # Errors
    /// The first fault found, with help.
    pub fn check(&self, has_sensor: bool) -> Result<(), Error> {
        self.check_beside(has_sensor, None, &InputFiles::new())
    }

    /// [`check`](Self::check), and no output replaces an input or the checkpoint of the same run.
    pub(crate) fn check_beside(
        &self,
        has_sensor: bool,
        checkpoint: Option<&Path>,
        inputs: &InputFiles,
    ) -> Result<(), Error> {
        for (_, path, _) in self.all() {
            let fault = |problem: &str, help: &str| Error::Output {
                file: path.into(),
                problem: problem.into(),
                help: help.into(),
            };
            if path.file_name().is_none() || path.is_dir() {
                return Err(fault("is a folder, not a file", "name a file in it"));
            }
            let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            if !folder.is_dir() {
                return Err(fault("cannot be written: its folder does not exist", "create the folder first"));
            }
        }
        let mut outputs = self.named();
        outputs.extend(checkpoint.map(|path| ("the checkpoint", path)));
        let lock = checkpoint.map(dunkelfeld_io::lock::lock_path);
        outputs.extend(lock.as_deref().map(|path| ("the lock of the checkpoint", path)));
        check_outputs(&outputs, &InputFiles::new())?;
        if let Some((_, path, endings)) = self.all().find(|(_, path, allowed)| !allowed.contains(&&*extension(path))) {
            let (problem, help) = (misfit(path), format!("end it in .{}", endings.join(" or .")));
            return Err(Error::Output { file: path.into(), problem, help });
        }
        check_outputs(&outputs, inputs)?;
        if let (Some(path), false) = (&self.linear, has_sensor) {
            return Err(Error::Output {
                file: path.clone(),
                problem: "linear grey values come from a sensor, and there is none".into(),
                help: "choose a sensor, or write an EXR for linear radiance".into(),
            });
        }
        self.all().try_for_each(|(_, path, _)| written(path, dunkelfeld_io::atomic::check_writable(path)))
    }
}

pub(crate) fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase()
}

/// The problem of a file name with an invalid extension.
pub(crate) fn misfit(path: &Path) -> String {
    match extension(path).as_str() {
        "" => "has no ending that names a format".into(),
        ending => format!("has an ending that does not fit (\".{ending}\")"),
    }
}

/// Writes the 8-bit picture of a frame as PNG.
///
/// # Errors
/// If the file cannot be written; an existing one then remains as it was.
pub fn save_picture(frame: &Frame, path: &Path) -> Result<(), Error> {
    save_commented(&frame.picture, comment(frame).as_deref(), path)
}

/// The bytes of a PNG file of a picture, gamma 2.2, without metadata.
///
/// # Errors
/// A picture without pixels.
pub fn encode_picture(picture: &Picture) -> Result<Vec<u8>, Error> {
    png_bytes(picture.as_file()).map_err(|e| Error::setting("picture", e.to_string(), "render an image with pixels"))
}

pub(crate) fn save_commented(picture: &Picture, comment: Option<&str>, path: &Path) -> Result<(), Error> {
    let mut text = vec![("Software", "Dunkelfeld")];
    text.extend(comment.map(|words| ("Comment", words)));
    written(path, dunkelfeld_io::png::write_png(path, picture.as_file(), &text))
}

/// The metadata of a picture that differs from the image of the scene or from the rendered image.
fn comment(frame: &Frame) -> Option<String> {
    let denoised = frame.denoised.as_ref().map(|d| denoised_by(&d.denoiser));
    let words: Vec<String> = left_out(&frame.without).into_iter().chain(denoised).collect();
    (!words.is_empty()).then(|| words.join("; "))
}

/// The metadata of a denoised picture.
pub(crate) fn denoised_by(denoiser: &str) -> String {
    format!("denoised by {denoiser}: for display, not for measurement")
}

/// The metadata of an image without some effects.
fn left_out(without: &[Effect]) -> Option<String> {
    let names: Vec<&str> = without.iter().map(|e| e.name()).collect();
    (!names.is_empty()).then(|| format!("rendered without {}", names.join(", ")))
}

/// Writes the linear grey values of a frame as 16-bit PNG or TIFF.
///
/// # Errors
/// A frame without a sensor; a file that cannot be written.
pub fn save_linear(frame: &Frame, path: &Path) -> Result<(), Error> {
    save_aligned(frame, Align::Right, path)
}

fn save_aligned(frame: &Frame, align: Align, path: &Path) -> Result<(), Error> {
    let Some(sensor) = &frame.sensor else {
        return Err(Error::setting("linear", "there is no sensor, so there are no grey values", "choose a sensor"));
    };
    let mut text = values_words(&sensor.model, sensor.exposure);
    text.extend(left_out(&frame.without).iter().flat_map(|words| [", ", words]));
    save_values(&sensor.values, &sensor.model, align, &text, path)
}

/// The metadata of linear grey values.
pub(crate) fn values_words(model: &SensorModel, exposure: Exposure) -> String {
    let spec = model.spec();
    let mosaic = spec.quantum_efficiency.filter().map_or(String::new(), |f| format!(", mosaic {}", f.pattern.name()));
    let (name, time, bits, offset) = (&spec.name, exposure.time().0, spec.bit_depth, spec.offset.0);
    format!("{name}, exposure {time} s, {bits} bit, black level {offset} DN{mosaic}")
}

/// Writes linear grey values with a description as 16-bit PNG or TIFF.
pub(crate) fn save_values(
    values: &Plane<u16>,
    model: &SensorModel,
    align: Align,
    words: &str,
    path: &Path,
) -> Result<(), Error> {
    let shift = 16u32.saturating_sub(model.spec().bit_depth);
    let (values, words) = match align {
        Align::Right => (Cow::Borrowed(values), Cow::Borrowed(words)),
        Align::Left => (Cow::Owned(values.map(|v| v << shift)), Cow::Owned(format!("{words}, left-aligned in 16 bit"))),
    };
    let (picture, words) = (File::Gray16(&values), &*words);
    written(
        path,
        match extension(path).as_str() {
            "tif" | "tiff" => dunkelfeld_io::tiff::write_tiff(path, picture, Some(words)),
            _ => dunkelfeld_io::png::write_png(path, picture, &[("Software", "Dunkelfeld"), ("Description", words)]),
        },
    )
}

/// All layers of a render as the contents of an EXR: `R G B`, `variance.*`, `covariance.*`, `spp.Y`, `first_light.*`,
/// `moment.x.*` and `moment.y.*` ([`MeanImage`](dunkelfeld_film::MeanImage)) and `lens.*`, the radiance behind the lens, for a lens that blurs,
/// `albedo.*`, `normal.*`, `depth.Z` and their variances, `scatter.*`, `id.object`, `id.material` ([`NO_ID`] where there is no
/// surface). With a sensor it contains `electrons.Y`, `hidden.Y` if the frame is certified, and
/// `matched.Y` (1 or 0) if its noise was to be matched. It contains `denoised.*` if the picture shows
/// it. For a film without all layers ([`FilmLayers::Image`]), first light, albedo, depth and the
/// variances of auxiliary layers are left out.
pub fn encode_layers(film: &RenderedFilm, frame: &Frame, settings: &RenderSettings) -> ExrLayers {
    let mut layers = layers_of_rows(film, frame, 0..film.sums.height());
    layers.attributes = layer_attributes(frame, settings, film).to_string();
    layers
}

/// The attribute of an EXR with all layers.
pub(crate) fn layer_attributes(frame: &Frame, settings: &RenderSettings, film: &RenderedFilm) -> serde_json::Value {
    let sensor = frame.sensor.as_ref();
    let of_image = serde_json::json!({
        "denoiser": frame.denoised.as_ref().map(|d| &d.denoiser),
        "exposure_seconds": sensor.map(|s| s.exposure.time().0),
        "sensor": sensor.map(|s| &s.model.spec().name),
        "exposure_noise": sensor.map(|_| settings.exposure_noise.name()),
        FILM_OF_SENSOR: FilmOfSensor::new(settings),
        "objects": film.object_names,
        "materials": film.material_names,
        "without": settings.run.without.iter().map(|e| e.name()).collect::<Vec<_>>(),
        SPREAD: film.is_spread,
    });
    plan_attributes(settings, of_image)
}

/// `more` and the attributes of a plan. Those of a part of a render that does not begin with sample 0 have its number: its
/// numbers of samples are no plan.
fn plan_attributes(settings: &RenderSettings, mut more: serde_json::Value) -> serde_json::Value {
    more["program"] = format!("dunkelfeld {}", env!("CARGO_PKG_VERSION")).into();
    more["seed"] = settings.seed.into();
    more["frame"] = settings.frame.into();
    more["training_paths"] = settings.training_paths().into();
    if let Some(first @ 1..) = settings.run.samples.as_ref().map(|samples| samples.start) {
        more["first_sample"] = first.into();
    }
    more
}

/// The reason why a part of a render cannot be replayed, and the help.
fn no_plan_of_part(first: u32) -> (String, &'static str) {
    let problem = format!("is a part of a render, whose first sample is {first}, and a plan begins with sample 0");
    (problem, "merge it with the other parts, or render the part again by its range of samples")
}

/// The layers of some rows of pixels, without attributes. The names of the channels are the same for all rows. Runs on
/// the threads of the current pool.
fn layers_of_rows(film: &RenderedFilm, frame: &Frame, rows: Range<u32>) -> ExrLayers {
    let stored = (film.sums.layers(), film.sums.has_moments());
    let bands = rows.clone().step_by(Film::TILE as usize).map(|y| y..(y + Film::TILE).min(rows.end));
    let bands: Vec<ExrLayers> = bands
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|band| {
            let mut sums = Vec::new();
            joined(band.map(|y| {
                // The sums of a row stay in the cache of the processor.
                sums.clear();
                film.sums.read_rows(y..y + 1, &mut sums);
                layers_of_band(stored, &sums, &film.ids, frame, y..y + 1)
            }))
        })
        .collect();
    joined(bands.into_iter())
}

/// The layers of consecutive rows.
fn joined(mut parts: impl Iterator<Item = ExrLayers>) -> ExrLayers {
    let mut all = parts.next().unwrap_or_else(|| ExrLayers::new(0, 0));
    parts.for_each(|part| all.append_rows(part));
    all
}

/// The same for a few rows of pixels with these sums.
pub(crate) fn layers_of_band(
    (layers, has_moments): (FilmLayers, bool),
    sums: &[PixelSums],
    labels: &Plane<Option<PixelIds>>,
    frame: &Frame,
    rows: Range<u32>,
) -> ExrLayers {
    let (width, height) = (labels.width(), rows.len() as u32);
    let pixels = rows.start as usize * width as usize..rows.end as usize * width as usize;
    let mut out = ExrLayers::new(width, height);
    let triples = |f: &dyn Fn(&PixelSums) -> [f32; 3]| plane(width, height, sums.iter().map(f), [0.0; 3]);
    let floats = |f: &dyn Fn(&PixelSums) -> f32| plane(width, height, sums.iter().map(f), 0.0);
    out.push_integers(Single::SampleCount, plane(width, height, sums.iter().map(PixelSums::count), 0));
    let [mut means, mut variances, mut covariances] = [(); 3].map(|()| Vec::with_capacity(sums.len()));
    let [mut scatter, mut largest] = [(); 2].map(|()| Vec::with_capacity(sums.len()));
    for sums in sums {
        let of_pixel = sums.means();
        let (variance, covariance) = of_pixel.variance_and_covariance();
        means.push(of_pixel.mean.map(|v| v as f32));
        variances.push(variance.map(|v| v as f32));
        covariances.push(covariance.map(|v| v as f32));
        let of_samples = sums.scatter_about(of_pixel.mean);
        scatter.push(of_samples.map_or(f32::INFINITY, |s| s.all as f32));
        largest.push(of_samples.map_or(f32::INFINITY, |s| s.largest as f32));
    }
    for (layer, values) in [(Triple::Mean, means), (Triple::Variance, variances), (Triple::Covariance, covariances)] {
        out.push_triples(layer, &plane(width, height, values.into_iter(), [0.0; 3]));
    }
    for (layer, values) in [(Single::Scatter, scatter), (Single::LargestScatter, largest)] {
        out.push_floats(layer, plane(width, height, values.into_iter(), 0.0));
    }
    out.push_triples(Triple::Normal, &triples(&PixelSums::mean_normal));
    if layers == FilmLayers::All {
        out.push_triples(Triple::FirstLight, &triples(&PixelSums::mean_first_light));
        out.push_triples(Triple::Albedo, &triples(&PixelSums::mean_albedo));
        out.push_floats(Single::Depth, floats(&PixelSums::mean_depth));
        out.push_triples(Triple::AlbedoVariance, &triples(&PixelSums::variance_of_albedo));
        out.push_triples(Triple::NormalVariance, &triples(&PixelSums::variance_of_normal));
        out.push_floats(Single::DepthVariance, floats(&PixelSums::variance_of_depth));
    }
    // A film of a sharp lens has none, also if its image is blurred later.
    if has_moments && frame.sensor.as_ref().is_some_and(|sensor| sensor.radiance.is_some()) {
        for (axis, layer) in [Triple::MomentX, Triple::MomentY].into_iter().enumerate() {
            out.push_triples(layer, &triples(&|sums| sums.mean_moments()[axis]));
        }
    }
    let labels = &labels.data()[pixels.clone()];
    let ids =
        |f: &dyn Fn(&PixelIds) -> u32| plane(width, height, labels.iter().map(|l| l.as_ref().map_or(NO_ID, f)), NO_ID);
    out.push_integers(Single::ObjectId, ids(&PixelIds::object));
    out.push_integers(Single::MaterialId, ids(&PixelIds::material));
    if let Some(sensor) = &frame.sensor {
        if let Some(radiance) = &sensor.radiance {
            let radiance = radiance.data()[pixels.clone()].iter().copied();
            out.push_triples(Triple::Lens, &plane(width, height, radiance, [0.0; 3]));
        }
        let electrons = sensor.electrons.data()[pixels.clone()].iter().copied();
        out.push_floats(Single::Electrons, plane(width, height, electrons, 0.0));
        if let Some(certified) = &sensor.certified {
            let ratios = certified.ratios.data()[pixels.clone()].iter().copied();
            out.push_floats(Single::Hidden, plane(width, height, ratios, 0.0));
        }
        if let Some(matched) = &sensor.matched {
            let held = matched.held.data()[pixels.clone()].iter().map(|&held| f32::from(u8::from(held)));
            out.push_floats(Single::Matched, plane(width, height, held, 0.0));
        }
    }
    if let Some(denoised) = &frame.denoised {
        let mean = denoised.mean.data()[pixels].iter().copied();
        out.push_triples(Triple::Denoised, &plane(width, height, mean, [0.0; 3]));
    }
    out
}

/// A plane with one value per pixel.
pub(crate) fn plane<T: Clone>(width: u32, height: u32, values: impl Iterator<Item = T>, missing: T) -> Plane<T> {
    Plane::from_vec(width, height, values.collect()).unwrap_or_else(|| Plane::new(width, height, missing))
}

/// The attribute that describes how a sensor recorded the film.
const FILM_OF_SENSOR: &str = "film";

/// The properties of a film that another exposure of it needs.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub(crate) struct FilmOfSensor {
    /// How pixels of the sensor form those of the film.
    pub(crate) readout: Readout,
    /// The lens, with the wavelengths of the channels, and the transmission of a filter and of beam splitters.
    pub(crate) optics: Optics,
    /// The sensor, as the job adjusts it. It describes the pixels of the film.
    pub(crate) model: SensorModel,
    /// The exposure time for which the samples were made; `None` if they hold for any time.
    pub(crate) timed: Option<Exposure>,
}

impl FilmOfSensor {
    /// The properties of a render; `None` without a sensor.
    fn new(settings: &RenderSettings) -> Option<Self> {
        let SensorChoice::Emva { model, optics, exposure } = &settings.sensor else { return None };
        let timed = exposure.filter(|_| settings.is_timed);
        Some(Self { readout: settings.readout, optics: optics.clone(), model: (**model).clone(), timed })
    }

    /// The properties that a file contains, if it is of a render with a sensor.
    ///
    /// # Errors
    /// Properties out of range.
    pub(crate) fn of_file(path: &Path, layers: &ExrLayers) -> Result<Option<Self>, InputError> {
        let value = attributes(layers).remove(FILM_OF_SENSOR).unwrap_or_default();
        serde_json::from_value(value).map_err(|e| {
            let problem = format!("is not what Dunkelfeld writes: {e}");
            InputError::new(path, format!("the attribute `{FILM_OF_SENSOR}`"), problem, "render the image again")
        })
    }
}

/// The attribute that states whether the samples of a pixel are spread over its neighbours.
pub(crate) const SPREAD: &str = "spread";

/// The attribute of images with vignetting.
pub(crate) const VIGNETTING: &str = "vignetting";

/// The attribute of a file, if this program wrote it.
pub(crate) fn attributes(layers: &ExrLayers) -> serde_json::Map<String, serde_json::Value> {
    match serde_json::from_str(&layers.attributes) {
        Ok(serde_json::Value::Object(attributes)) => attributes,
        _ => serde_json::Map::new(),
    }
}

/// Adds to the attribute of a file.
pub(crate) fn set_attribute(layers: &mut ExrLayers, name: &str, value: &str) {
    let mut all = attributes(layers);
    all.insert(name.into(), value.into());
    layers.attributes = serde_json::Value::Object(all).to_string();
}

fn plan_layers(plan: &Plane<u32>, settings: &RenderSettings) -> ExrLayers {
    let mut layers = ExrLayers::new(plan.width(), plan.height());
    layers.push_integers(Single::SampleCount, plan.clone());
    layers.attributes = plan_attributes(settings, serde_json::json!({})).to_string();
    layers
}

/// All outputs except the statistics.
pub(crate) struct Written<'a> {
    pub(crate) film: &'a RenderedFilm,
    pub(crate) frame: &'a Frame,
    pub(crate) settings: &'a RenderSettings,
    /// Does the lens darken the image towards its corners?
    pub(crate) is_vignetted: bool,
}

impl Written<'_> {
    /// Writes the files of the outputs.
    pub(crate) fn save(&self, paths: &OutputPaths) -> Result<(), Error> {
        if let Some(path) = &paths.image {
            save_picture(self.frame, path)?;
        }
        if let Some(path) = &paths.linear {
            save_aligned(self.frame, paths.align, path)?;
        }
        if let Some(path) = &paths.exr {
            written(path, self.write_layers(path))?;
        }
        if let Some(path) = &paths.plan {
            save_plan(path, &self.film.sums.sample_counts(), self.settings)?;
        }
        Ok(())
    }

    /// Writes the files under hidden names beside those of the outputs, and removes them.
    pub(crate) fn try_out(&self, paths: &OutputPaths) -> Result<(), Error> {
        let hidden = [&paths.image, &paths.linear, &paths.exr, &paths.plan].map(|path| {
            path.as_deref().map(|path| written(path, dunkelfeld_io::atomic::hidden_file(path))).transpose()
        });
        let [image, linear, exr, plan] = hidden;
        let hidden = [image?, linear?, exr?, plan?];
        let [image, linear, exr, plan] =
            hidden.each_ref().map(|file| file.as_ref().map(|file| file.as_ref().to_path_buf()));
        self.save(&OutputPaths { image, linear, exr, plan, stats: None, align: paths.align })
    }

    /// Writes all layers in strips. The layers of a whole image would take more memory than its film.
    fn write_layers(&self, path: &Path) -> std::io::Result<()> {
        let mut first = layers_of_rows(self.film, self.frame, 0..self.film.sums.height().min(1));
        first.attributes = layer_attributes(self.frame, self.settings, self.film).to_string();
        if self.is_vignetted {
            set_attribute(&mut first, VIGNETTING, "cos4");
        }
        write_exr_rows(path, &ExrHead::from_strip(&first, self.film.sums.height()), &mut |rows| {
            Ok(layers_of_rows(self.film, self.frame, rows).into_samples())
        })
    }
}

/// Writes an EXR.
///
/// # Errors
/// If the file cannot be written; an existing one then remains as it was.
pub fn save_exr(path: &Path, layers: ExrLayers) -> Result<(), Error> {
    written(path, write_exr(path, layers))
}

/// Writes the plan alone: samples per pixel, for a replay.
///
/// # Errors
/// If the file cannot be written.
pub fn save_plan(path: &Path, plan: &Plane<u32>, settings: &RenderSettings) -> Result<(), Error> {
    save_exr(path, plan_layers(plan, settings))
}

/// A saved plan: together with the scene, all data of a replay.
#[derive(Clone, Debug, PartialEq)]
pub struct SavedPlan {
    /// Samples per pixel.
    pub samples: Plane<u32>,
    /// Seed of the render; `None` if another program wrote the file.
    pub seed: Option<u64>,
    /// Frame number of the render; `None` if another program wrote the file.
    pub frame: Option<u32>,
    /// Number of training paths of the render; 0 if the file does not state it.
    pub training_paths: u32,
}

impl SavedPlan {
    /// The plan of a rendered film: a replay with the same scene, camera and lens has the same samples.
    ///
    /// # Errors
    /// A part of a render that does not begin with sample 0.
    pub fn of_film(saved: &SavedFilm) -> Result<Self, Error> {
        let SavedFilm { film, settings, .. } = saved;
        if let Some(first @ 1..) = settings.run.samples.as_ref().map(|samples| samples.start) {
            let (problem, help) = no_plan_of_part(first);
            return Err(Error::setting("replay", format!("the film {problem}"), help));
        }
        Ok(Self {
            samples: film.sums.sample_counts(),
            seed: Some(settings.seed),
            frame: Some(settings.frame),
            training_paths: settings.training_paths(),
        })
    }
}

/// Reads a plan that [`save_plan`] wrote, or that of the layers of a render.
///
/// # Errors
/// A file that is no EXR, has no layer `spp.Y`, or is a part of a render that does not begin with sample 0.
pub fn load_plan(path: &Path) -> Result<SavedPlan, Error> {
    load_plan_recorded(path, &mut InputFiles::new())
}

/// [`load_plan`], and records the file as an input of a run.
///
/// # Errors
/// As [`load_plan`].
pub(crate) fn load_plan_recorded(path: &Path, inputs: &mut InputFiles) -> Result<SavedPlan, Error> {
    /// The part of the channels that a replay needs.
    #[derive(Default, serde::Deserialize)]
    struct Attributes {
        seed: Option<u64>,
        frame: Option<u32>,
        #[serde(default)]
        training_paths: u32,
        #[serde(default)]
        first_sample: u32,
    }
    let layers = read_exr_recorded(path, Role::Plan, inputs)?;
    let Attributes { seed, frame, training_paths, first_sample } =
        serde_json::from_str(&layers.attributes).unwrap_or_default();
    if first_sample > 0 {
        let (problem, help) = no_plan_of_part(first_sample);
        return Err(InputError::new(path, "layer spp.Y", problem, help).into());
    }
    let fault = |problem: String| {
        let help = "use an EXR that --exr or --plan wrote";
        Err(InputError::new(path, "layer spp.Y", problem, help).into())
    };
    match (layers.integers(Single::SampleCount), layers.singles_that_are_no_counts(Single::SampleCount)) {
        (Some(samples), _) => Ok(SavedPlan { samples, seed, frame, training_paths }),
        (None, None) => fault("is missing: there is no sample plan in this file".into()),
        (None, Some((pixels, [x, y], value))) => fault(format!(
            "holds no numbers of samples: {pixels} of its values are negative, fractional, too large or not a number, the \
             first is {} at pixel {x}, {y}",
            Number(f64::from(value))
        )),
    }
}

/// Writes a file that must not exist, by a function of this module: no file is replaced, also not one that appears during the
/// write. `save` writes a file of the same name in a hidden folder beside `path`; when it is complete, it is moved to `path`.
///
/// # Errors
/// Those of `save`; if `path` exists or cannot be written.
pub fn save_new(path: &Path, save: impl FnOnce(&Path) -> Result<(), Error>) -> Result<(), Error> {
    let mut failed = None;
    let result = dunkelfeld_io::atomic::write_new(path, |partial| {
        save(partial).map_err(|e| {
            failed = Some(match e {
                Error::Output { problem, help, .. } => Error::Output { file: path.into(), problem, help },
                other => other,
            });
            std::io::Error::other("the file cannot be made")
        })
    });
    failed.map_or_else(|| written(path, result), Err)
}

/// Writes text.
///
/// # Errors
/// If the file cannot be written.
pub fn save_text(path: &Path, text: &str) -> Result<(), Error> {
    use std::io::Write;
    written(path, dunkelfeld_io::atomic::write_atomically(path, |w| w.write_all(text.as_bytes())))
}
