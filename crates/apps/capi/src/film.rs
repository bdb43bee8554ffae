//! Films: layers as buffers, exposures, certificate, files.

use crate::film_data::{FILMS, FilmData};
use crate::options::{Certificate, ExposeOptions};
use crate::pointers::{Elements, In, Out, Text};
use crate::status::{Failure, Status, call};
use dunkelfeld::commands::MergeSettings;
use dunkelfeld::film::{Plane, certify_film, denoise_saved, expose_film, picture_of_film};
use dunkelfeld::outputs::{save_film, save_film_files};
use dunkelfeld::{Cancel, DenoiseMethod, DenoiseSettings, Error, OutputPaths, Picture, SavedFilm};
use std::ffi::c_char;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A rendered film.
#[derive(Debug)]
pub struct Film {
    _opaque: (),
}

/// A layer of a film, of 32-bit floats.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// Mean radiance [W/(m^2 sr)], linear Rec. 709; 3 channels.
    Mean = 0,
    /// Variance of the mean; 3 channels. Infinite with fewer than two samples.
    Variance = 1,
    /// Mean unit normal toward the camera, world axes; 3 channels.
    Normal = 2,
    /// Mean albedo, linear Rec. 709; 3 channels.
    Albedo = 3,
    /// Mean distance from the camera along its axis [m]; 1 channel.
    Depth = 4,
}

/// A layer of a film, of 32-bit unsigned integers; 1 channel.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IdLayer {
    /// Samples per pixel.
    Spp = 0,
    /// Object at the centre of each pixel, or DUNKELFELD_NO_ID. Behind a smooth clear surface it is the first that scatters.
    ObjectIds = 1,
    /// Material at the centre of each pixel, or DUNKELFELD_NO_ID.
    MaterialIds = 2,
}

/// The id of pixels without an object.
pub const NO_ID: u32 = 0xffff_ffff;
const _: () = assert!(NO_ID == dunkelfeld::film::NO_ID, "the header names the id of the library");

fn unknown_layer(layer: i32) -> Failure {
    Failure::new(Status::Argument, "layer", format!("there is no layer {layer}"), "pass a constant of the header")
}

/// Width and height of a film [pixels].
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_size(film: *const Film, width: *mut u32, height: *mut u32) -> Status {
    // SAFETY: what the header says of pointers.
    let (width, height) = unsafe { (Out::of(width), Out::of(height)) };
    call(|| {
        let film = FILMS.get(film)?;
        width.check("width")?;
        height.set("height", film.saved.film.sums.height())?;
        width.set("width", film.saved.film.sums.width())
    })
}

/// Copies a layer of floats (a DunkelfeldLayer) to a buffer of `count` elements.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_read(
    film: *const Film,
    layer: i32,
    buffer: *mut f32,
    count: usize,
    row_stride: usize,
) -> Status {
    // SAFETY: what the header says of pointers.
    let buffer = unsafe { Elements::of(buffer) };
    call(|| {
        let film = FILMS.get(film)?;
        let to = (count, row_stride);
        let rgb = |plane: Plane<[f32; 3]>| write_pixels(&buffer, to, &plane);
        match layer {
            l if l == Layer::Mean as i32 => rgb(film.compute(|s| s.film.sums.mean())?),
            l if l == Layer::Variance as i32 => rgb(film.compute(|s| s.film.sums.variance())?),
            l if l == Layer::Normal as i32 => rgb(film.compute(|s| s.film.sums.map(|p| p.mean_normal()))?),
            l if l == Layer::Albedo as i32 => rgb(film.compute(|s| s.film.sums.map(|p| p.mean_albedo()))?),
            l if l == Layer::Depth as i32 => {
                write(&buffer, to, &film.compute(|s| s.film.sums.map(|p| p.mean_depth()))?)
            }
            other => Err(unknown_layer(other)),
        }
    })
}

/// Copies a layer of integers (a DunkelfeldIdLayer) to a buffer of `count` elements.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_read_ids(
    film: *const Film,
    layer: i32,
    buffer: *mut u32,
    count: usize,
    row_stride: usize,
) -> Status {
    // SAFETY: what the header says of pointers.
    let buffer = unsafe { Elements::of(buffer) };
    call(|| {
        let film = FILMS.get(film)?;
        let saved = &film.saved.film;
        let plane = match layer {
            l if l == IdLayer::Spp as i32 => saved.sums.sample_counts(),
            l if l == IdLayer::ObjectIds as i32 => saved.ids.map(|id| id.map_or(NO_ID, |id| id.object())),
            l if l == IdLayer::MaterialIds as i32 => saved.ids.map(|id| id.map_or(NO_ID, |id| id.material())),
            other => return Err(unknown_layer(other)),
        };
        write(&buffer, (count, row_stride), &plane)
    })
}

fn write<T: Copy>(buffer: &Elements<T>, to: (usize, usize), plane: &Plane<T>) -> Result<(), Failure> {
    buffer.write_rows(to, plane.data(), plane.width() as usize)
}

fn write_pixels<T: bytemuck::Pod>(
    buffer: &Elements<T>,
    to: (usize, usize),
    plane: &Plane<[T; 3]>,
) -> Result<(), Failure> {
    buffer.write_rows(to, plane.data().as_flattened(), 3 * plane.width() as usize)
}

/// The numbers of objects and of materials of a film. A film from a file has no names of materials.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_name_counts(
    film: *const Film,
    objects: *mut u32,
    materials: *mut u32,
) -> Status {
    // SAFETY: what the header says of pointers.
    let (objects, materials) = unsafe { (Out::of(objects), Out::of(materials)) };
    call(|| {
        let film = FILMS.get(film)?;
        objects.check("objects")?;
        materials.set("materials", film.saved.film.material_names.len() as u32)?;
        objects.set("objects", film.saved.film.object_names.len() as u32)
    })
}

/// The name of an object by its id. Close the text by dunkelfeld_text_close().
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_object_name(film: *const Film, id: u32, name: *mut *mut c_char) -> Status {
    // SAFETY: what the header says of pointers.
    let name = unsafe { Out::of(name) };
    call(|| named(&FILMS.get(film)?.saved.film.object_names, id, name))
}

/// The name of a material by its id. Close the text by dunkelfeld_text_close().
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_material_name(film: *const Film, id: u32, name: *mut *mut c_char) -> Status {
    // SAFETY: what the header says of pointers.
    let name = unsafe { Out::of(name) };
    call(|| named(&FILMS.get(film)?.saved.film.material_names, id, name))
}

fn named(names: &[String], id: u32, name: Out<*mut c_char>) -> Result<(), Failure> {
    let Some(text) = names.get(id as usize) else {
        let problem = format!("{id} is not below the {} names", names.len());
        return Err(Failure::new(Status::Argument, "id", problem, "ask for the number of names first"));
    };
    name.set_text("name", text)
}

/// Grey values [DN] of `frames` frames, of which the options name the first: element (f * height + y) * width + x of the buffer. Frames
/// of one seed come from the same device. `options` may be NULL.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_expose(
    film: *const Film,
    options: *const ExposeOptions,
    frames: u32,
    buffer: *mut u16,
    count: usize,
) -> Status {
    // SAFETY: what the header says of pointers.
    let (options, buffer) = unsafe { (In::of(options), Elements::of(buffer)) };
    call(|| {
        let film = FILMS.get(film)?;
        let options = options.get("options")?.to_options()?;
        buffer.check(count)?;
        let size = film.saved.film.sums.pixels() as u64 * u64::from(frames);
        if (count as u64) < size {
            let problem = format!("{count} elements are fewer than the {size} that are written");
            return Err(Failure::new(Status::Argument, "count", problem, "pass a larger buffer and its count"));
        }
        let planes = film.compute(|saved| expose_film(saved, &options, frames, &Cancel::new()))??;
        let values: Vec<u16> = planes.iter().flat_map(|plane| plane.data()).copied().collect();
        let width = film.saved.film.sums.width() as usize;
        buffer.write_rows((count, 0), &values, width)
    })
}

/// The 8-bit picture of one frame, gamma 2.2. It has 3 channels if the sensor has colours or there is none, else 1. `channels` is written
/// first. If `buffer` is NULL, nothing else is.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_picture(
    film: *const Film,
    options: *const ExposeOptions,
    buffer: *mut u8,
    count: usize,
    row_stride: usize,
    channels: *mut u32,
) -> Status {
    // SAFETY: what the header says of pointers.
    let (options, buffer, channels) = unsafe { (In::of(options), Elements::of(buffer), Out::of(channels)) };
    call(|| {
        let film = FILMS.get(film)?;
        channels.check("channels")?;
        let options = options.get("options")?.to_options()?;
        let picture = film.compute(|saved| picture_of_film(saved, &options))??;
        let to = (count, row_stride);
        channels.set("channels", if matches!(picture, Picture::Gray(_)) { 1 } else { 3 })?;
        match (&picture, buffer.is_null()) {
            (_, true) => Ok(()),
            (Picture::Gray(plane), false) => write(&buffer, to, plane),
            (Picture::Rgb(plane), false) => write_pixels(&buffer, to, plane),
        }
    })
}

/// The certificate of a film at level `k` (0 stands for 1), for the sensor of its render.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_certificate(
    film: *const Film,
    k: f64,
    certificate: *mut Certificate,
) -> Status {
    // SAFETY: what the header says of pointers.
    let certificate = unsafe { Out::of(certificate) };
    call(|| {
        let film = FILMS.get(film)?;
        certificate.check("certificate")?;
        let k = if k == 0.0 { 1.0 } else { k };
        let c = film.compute(|saved| certify_film(saved, k))??.certificate;
        let value = Certificate {
            struct_size: size_of::<Certificate>(),
            k: c.k,
            hidden: c.hidden,
            mean: c.mean,
            median: c.median,
            p99: c.p99,
            max: c.max,
            pixels: c.pixels,
            saturated: c.saturated,
            unknown: c.unknown,
            is_hidden: i32::from(c.is_hidden()),
            reserved: 0,
        };
        certificate.set_versioned("certificate", value)
    })
}

/// The denoised mean, of 3 channels, as dunkelfeld_film_read(). `method` is "auto", "oidn" or "builtin"; NULL stands for "auto".
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_denoise(
    film: *const Film,
    method: *const c_char,
    buffer: *mut f32,
    count: usize,
    row_stride: usize,
) -> Status {
    // SAFETY: what the header says of pointers.
    let (method, buffer) = unsafe { (Text::of(method), Elements::of(buffer)) };
    call(|| {
        let film = FILMS.get(film)?;
        buffer.check(count)?;
        let method = match method.get("method")?.unwrap_or("auto") {
            "auto" => DenoiseMethod::Auto,
            "oidn" => DenoiseMethod::Oidn,
            "builtin" => DenoiseMethod::Builtin,
            other => {
                let problem = format!("unknown value \"{other}\"");
                return Err(Failure::new(Status::Setting, "method", problem, "auto, oidn or builtin"));
            }
        };
        let denoised = denoise_saved(&film.saved, &DenoiseSettings::default().with_method(method))?;
        write_pixels(&buffer, (count, row_stride), &denoised.mean)
    })
}

/// The statistics of a render as JSON, as in `--stats`; an empty text for a film from a file. Close the text by dunkelfeld_text_close().
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_stats(film: *const Film, json: *mut *mut c_char) -> Status {
    // SAFETY: what the header says of pointers.
    let json = unsafe { Out::of(json) };
    call(|| json.set_text("json", &FILMS.get(film)?.stats))
}

/// Writes a film to a file: its sums to the last bit, and the settings that expose it. It replaces neither a file that the film
/// was made from nor the checkpoint of its render.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_save(film: *const Film, path: *const c_char) -> Status {
    // SAFETY: what the header says of pointers.
    let path = unsafe { Text::of(path) };
    call(|| {
        let film = FILMS.get(film)?;
        Ok(save_film(&film.saved, Path::new(path.required("path")?), &film.inputs)?)
    })
}

/// Writes the files of `dunkelfeld render` with the same bytes. A path that is NULL is not written; at least one is not NULL.
/// `image`: PNG, 8 bit, gamma 2.2. `linear`: 16-bit grey values [DN], .png or .tif. `exr`: all layers. `stats`: JSON; a film from a
/// file has none. `plan`: EXR with the samples per pixel. The film is exposed, and the image denoised, as by its render. A file is
/// written as a whole or not at all. None replaces a file that the film was made from. After an error, earlier files remain.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_save_files(
    film: *const Film,
    image: *const c_char,
    linear: *const c_char,
    exr: *const c_char,
    stats: *const c_char,
    plan: *const c_char,
) -> Status {
    // SAFETY: what the header says of pointers.
    let [image, linear, exr, stats, plan] = [image, linear, exr, stats, plan].map(|path| unsafe { Text::of(path) });
    call(|| {
        let path = |name: &str, text: Text| Ok::<_, Failure>(text.get(name)?.map(PathBuf::from));
        let outputs = OutputPaths::default()
            .with_image(path("image", image)?)
            .with_linear(path("linear", linear)?)
            .with_exr(path("exr", exr)?)
            .with_stats(path("stats", stats)?)
            .with_plan(path("plan", plan)?);
        let film = FILMS.get(film)?;
        let stats = Some(film.stats.as_str()).filter(|text| !text.is_empty());
        Ok(save_film_files(&film.saved, stats, &outputs, &film.inputs)?)
    })
}

/// Reads a film that dunkelfeld_film_save() wrote. Close it by dunkelfeld_film_close().
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_film_load(path: *const c_char, film: *mut *mut Film) -> Status {
    // SAFETY: what the header says of pointers.
    let (path, film) = unsafe { (Text::of(path), Out::of(film)) };
    call(|| {
        film.check("film")?;
        let path = PathBuf::from(path.required("path")?);
        let saved = SavedFilm::read(&path)?;
        film.set("film", FILMS.open(FilmData::of_saved(saved, String::new(), &[path])))
    })
}

/// Joins parts of one render (checkpoints with disjoint samples): bit by bit the film of one process. `paths` has `count` texts.
/// Close the film by dunkelfeld_film_close().
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_merge(
    paths: *const *const c_char,
    count: usize,
    threads: u32,
    film: *mut *mut Film,
) -> Status {
    // SAFETY: what the header says of pointers.
    let (paths, film) = unsafe { (Elements::<Text>::of(paths.cast_mut().cast()), Out::of(film)) };
    call(|| {
        film.check("film")?;
        let paths = paths.read("paths", count)?;
        let paths: Vec<PathBuf> =
            paths.iter().map(|path| Ok(path.required("paths")?.into())).collect::<Result<_, Failure>>()?;
        if paths.is_empty() {
            return Err(Error::setting("paths", "there are no parts", "name at least one checkpoint").into());
        }
        let settings = MergeSettings::default().with_parts(paths.clone()).with_threads(threads as usize);
        let merged = dunkelfeld::commands::merge(&settings, Instant::now())?;
        let stats = merged.stats.to_json();
        let saved =
            SavedFilm { film: merged.rendering.film, settings: merged.settings, is_vignetted: merged.is_vignetted };
        film.set("film", FILMS.open(FilmData::of_saved(saved, stats, &paths)))
    })
}

/// Closes a film. NULL is allowed.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub extern "C" fn dunkelfeld_film_close(film: *mut Film) -> Status {
    call(|| FILMS.close(film))
}
