//! `[lens]` of a job: its keys, and the keys that exclude each other.

use super::{FilmSettings, PsfSettings, SensorChoice, check};
use crate::error::InputError;
use crate::input::InputFiles;
use dunkelfeld_scene::{Distortion, Vignetting};
use dunkelfeld_sensor::Psf;
use serde::Deserialize;
use std::path::PathBuf;

/// `[lens]`: field of view, aperture, focus and aberrations of the lens. An absent key keeps the value of the camera.
///
/// Without `focus_distance` the aperture is infinitely small for the image, and everything is in focus. Then f-number,
/// transmission and magnification determine only the irradiance on the sensor.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LensSettings {
    /// Makes every camera a perspective or a telecentric one. Default: the projection of the scene's cameras.
    pub projection: Option<LensProjection>,
    /// Full vertical field of view \[rad\] of a perspective; written as `"30deg"`.
    #[serde(deserialize_with = "check::field_of_view")]
    pub vertical_fov: Option<f64>,
    /// Focal length \[m\] of a perspective, written as `"12mm"`. Together with the film's height on the sensor, and
    /// focus distance or magnification, it determines the field of view.
    #[serde(deserialize_with = "check::focal_length")]
    pub focal_length: Option<f64>,
    /// Height \[m\] of the field of a telecentric lens, written as `"40mm"`.
    #[serde(deserialize_with = "check::positive_length")]
    pub field_height: Option<f64>,
    /// f-number N, 0.5 to 1000. Default 4.
    #[serde(deserialize_with = "check::f_number")]
    pub f_number: Option<f64>,
    /// Numerical aperture of a telecentric lens on the side of the object, 1e-6 to 0.999; instead of the f-number.
    #[serde(deserialize_with = "check::numerical_aperture")]
    pub numerical_aperture: Option<f64>,
    /// Share of the light that passes the glass, above 0 and at most 1. Default 0.9.
    #[serde(deserialize_with = "check::positive_share")]
    pub transmission: f64,
    /// Magnification m, image size over object size, 0 to 100. Default: computed from the focus distance or from the
    /// field of a telecentric lens, otherwise 0, an object far away.
    #[serde(deserialize_with = "check::magnification")]
    pub magnification: Option<f64>,
    /// Distance \[m\] from the camera to the plane in focus, along the axis. It makes the aperture finite.
    #[serde(deserialize_with = "check::focus_distance")]
    pub focus_distance: Option<f64>,
    /// Straight blades of the aperture, 3 to 64; by default it is round.
    #[serde(deserialize_with = "check::blades")]
    pub blades: Option<u32>,
    /// Angle \[rad\] of the first corner between two blades from the camera's right, toward up; written as `"15deg"`.
    #[serde(deserialize_with = "check::angle")]
    pub blade_rotation: Option<f32>,
    /// Distortion coefficients in the order of OpenCV: k1, k2, p1, p2, k3, k4, k5, k6; 4, 5 or 8 of them, or 12 or
    /// 14 with zeros after the eighth.
    #[serde(deserialize_with = "check::distortion")]
    pub distortion: Option<Distortion>,
    /// Offset of the optical axis from the film's middle \[pixels\], to the right and down.
    #[serde(deserialize_with = "check::principal_point")]
    pub principal_point: Option<[f64; 2]>,
    /// Vignetting: how the image darkens toward its edge.
    #[serde(deserialize_with = "check::vignetting")]
    pub vignetting: Option<Vignetting>,
    /// A band-pass filter in front of the sensor.
    pub filter: Option<FilterSettings>,
    /// How the lens blurs the image: `"none"`, `"diffraction"`, a Gaussian `{ sigma = "1.5um" }` or `{ mtf50 = 80 }` [line pairs
    /// per mm] on the sensor, or the MTF in a CSV file. Default: diffraction if the aperture is given, otherwise none.
    pub psf: Option<PsfSettings>,
    /// Share of the light in the veiling glare, 0 to 0.5. Default 0; real lenses have 0.01 to 0.03.
    #[serde(deserialize_with = "check::glare")]
    pub glare: Option<f64>,
}

/// A band-pass filter: `{ center = "635nm", width = "40nm", transmission = 0.9 }`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilterSettings {
    /// Middle of the band \[nm\].
    #[serde(deserialize_with = "check::nanometres")]
    pub center: f64,
    /// Full width of the band \[nm\].
    #[serde(deserialize_with = "check::band_width")]
    pub width: f64,
    /// Transmission in the band. Default 0.9.
    #[serde(default = "filter_transmission", deserialize_with = "check::positive_share")]
    pub transmission: f64,
}

fn filter_transmission() -> f64 {
    0.9
}

impl Default for LensSettings {
    fn default() -> Self {
        Self {
            projection: None,
            vertical_fov: None,
            focal_length: None,
            field_height: None,
            f_number: None,
            numerical_aperture: None,
            transmission: 0.9,
            magnification: None,
            focus_distance: None,
            blades: None,
            blade_rotation: None,
            distortion: None,
            principal_point: None,
            vignetting: None,
            filter: None,
            psf: None,
            glare: None,
        }
    }
}

impl LensSettings {
    /// The point spread function: without one, that of diffraction if the aperture is given. A table is read from its file.
    ///
    /// # Errors
    /// As [`PsfSettings::load`].
    pub fn psf(&self, inputs: &mut InputFiles) -> Result<Psf, InputError> {
        match &self.psf {
            Some(psf) => psf.load(inputs),
            None if self.f_number.or(self.numerical_aperture).is_some() => Ok(Psf::Diffraction),
            None => Ok(Psf::None),
        }
    }

    /// The file of its MTF.
    pub(super) fn mtf_file(&mut self) -> Option<&mut PathBuf> {
        match &mut self.psf {
            Some(PsfSettings::File(path)) => Some(path),
            _ => None,
        }
    }
}

/// `projection` of a lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LensProjection {
    /// Chief rays intersect in the middle of the lens.
    Perspective,
    /// Chief rays are parallel.
    Telecentric,
}

/// A rule of keys that belong together: the key, whether the rule is broken, the problem, and the help.
type Rule = (&'static str, bool, &'static str, &'static str);

/// The error of the first rule that is broken.
fn check_rules(rules: &[Rule]) -> Result<(), InputError> {
    match rules.iter().find(|(_, is_broken, ..)| *is_broken) {
        Some((key, _, problem, help)) => Err(InputError::of_key(key, *problem, *help)),
        None => Ok(()),
    }
}

/// Does a film contain its number of pixels, and its size on the sensor, at most once?
pub(super) fn check_film(film: &FilmSettings, sensor: &SensorChoice) -> Result<(), InputError> {
    const FULL: [&str; 2] = [
        "the film has the resolution of the sensor, because of `full`",
        "remove it, or write a `roi` for a part of the film",
    ];
    const SIZES: [&str; 2] = [
        "only one of `pixel_pitch`, `sensor_width` and `sensor_height` can set the size of a pixel",
        "keep one of them",
    ];
    let [pitch, width, height] = [film.pixel_pitch, film.sensor_width, film.sensor_height].map(|v| v.is_some());
    check_rules(&[
        ("width", film.full && film.width.is_some(), FULL[0], FULL[1]),
        ("height", film.full && film.height.is_some(), FULL[0], FULL[1]),
        (
            "full",
            film.full && *sensor == SensorChoice::None,
            "there is no sensor whose resolution the film could have",
            "name a [sensor] model, or write `width` and `height`",
        ),
        ("sensor_width", pitch && width, SIZES[0], SIZES[1]),
        ("sensor_height", (pitch || width) && height, SIZES[0], SIZES[1]),
    ])
}

/// Are the settings of a lens consistent? This checks only the ones that do not depend on the scene.
pub(super) fn check_lens(lens: &LensSettings, film: &FilmSettings, sensor: &SensorChoice) -> Result<(), InputError> {
    let has_sensor = *sensor != SensorChoice::None;
    let has_size = has_sensor || film.pixel_pitch.or(film.sensor_width).or(film.sensor_height).is_some();
    check_aperture(lens, has_sensor)?;
    match lens.projection {
        Some(LensProjection::Telecentric) => check_telecentric(lens, has_size),
        _ => check_perspective(lens, has_size),
    }
}

const NO_SIZE: &str = "without a sensor the size of the film is unknown";
const ADD_SIZE: &str = "name another [sensor] model than \"none\", or write [film] pixel_pitch = \"3.45um\"";
const REMOVE: &str = "remove one of them";

/// Rules of all lenses.
fn check_aperture(lens: &LensSettings, has_sensor: bool) -> Result<(), InputError> {
    const NO_SENSOR: &str = "the blur of a lens lies in front of a sensor, and there is none";
    const ADD_SENSOR: &str = "name another [sensor] model than \"none\", or remove this";
    const SHARP: &str = "without a focus distance everything is sharp, and the shape of the aperture has no effect";
    const ADD_FOCUS: &str = "write `focus_distance` as well, or remove this";
    let blurs = lens.psf.as_ref().is_some_and(|psf| *psf != PsfSettings::Given(Psf::None));
    let glares = lens.glare.is_some_and(|share| share > 0.0);
    let (is_sharp, turned) = (lens.focus_distance.is_none(), lens.blade_rotation.is_some());
    check_rules(&[
        (
            "filter",
            !has_sensor && lens.filter.is_some(),
            "a filter lies in front of a sensor, and there is none",
            ADD_SENSOR,
        ),
        ("psf", !has_sensor && blurs, NO_SENSOR, ADD_SENSOR),
        ("glare", !has_sensor && glares, NO_SENSOR, ADD_SENSOR),
        (
            "focal_length",
            lens.focal_length.and(lens.vertical_fov).is_some(),
            "`vertical_fov` and `focal_length` both set the field of view",
            REMOVE,
        ),
        (
            "numerical_aperture",
            lens.f_number.and(lens.numerical_aperture).is_some(),
            "`f_number` and `numerical_aperture` both set the aperture",
            REMOVE,
        ),
        ("blades", is_sharp && lens.blades.is_some(), SHARP, ADD_FOCUS),
        ("blade_rotation", is_sharp && turned, SHARP, ADD_FOCUS),
        (
            "blade_rotation",
            turned && lens.blades.is_none(),
            "a round aperture cannot be turned",
            "write `blades` as well, or remove this",
        ),
    ])
}

fn check_telecentric(lens: &LensSettings, has_size: bool) -> Result<(), InputError> {
    const PERSPECTIVE: &str = "belongs to a perspective, and the lens is telecentric";
    const HELP: &str = "remove it, or `projection`; a telecentric lens has a `field_height`";
    let has_magnification = lens.magnification.is_some();
    check_rules(&[
        ("vertical_fov", lens.vertical_fov.is_some(), PERSPECTIVE, HELP),
        ("focal_length", lens.focal_length.is_some(), PERSPECTIVE, HELP),
        ("distortion", lens.distortion.is_some_and(|d| !d.is_none()), PERSPECTIVE, HELP),
        ("vignetting", lens.vignetting == Some(Vignetting::CosineFourth), PERSPECTIVE, HELP),
        (
            "magnification",
            has_magnification && lens.field_height.is_some(),
            "`field_height` and `magnification` both set the field of a telecentric lens",
            REMOVE,
        ),
        (
            "focus_distance",
            lens.focus_distance.is_some_and(f64::is_infinite),
            "a telecentric lens is sharp at a finite distance",
            "write one such as \"110mm\"",
        ),
        ("magnification", has_magnification && !has_size, NO_SIZE, ADD_SIZE),
        (
            "focus_distance",
            lens.focus_distance.is_some() && lens.numerical_aperture.is_none() && !has_size,
            NO_SIZE,
            ADD_SIZE,
        ),
    ])
}

fn check_perspective(lens: &LensSettings, has_size: bool) -> Result<(), InputError> {
    const TELECENTRIC: &str = "belongs to a telecentric lens";
    const HELP: &str = "write projection = \"telecentric\" as well, or remove this";
    let (focus, focal_length) = (lens.focus_distance, lens.focal_length);
    check_rules(&[
        ("numerical_aperture", lens.numerical_aperture.is_some(), TELECENTRIC, HELP),
        ("field_height", lens.field_height.is_some(), TELECENTRIC, HELP),
        (
            "focal_length",
            focal_length.is_some() && !has_size,
            "without a sensor a focal length gives no field of view",
            ADD_SIZE,
        ),
        ("focus_distance", focus.is_some() && !has_size, NO_SIZE, ADD_SIZE),
        (
            "focus_distance",
            focus.zip(focal_length).is_some_and(|(focus, f)| f >= focus),
            "a lens is sharp only beyond its focal length",
            "write a larger distance, or a shorter `focal_length`",
        ),
        (
            "magnification",
            focus.is_some() && lens.magnification.is_some(),
            "the focus distance of a perspective gives its magnification",
            REMOVE,
        ),
    ])
}
