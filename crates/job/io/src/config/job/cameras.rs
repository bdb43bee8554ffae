//! `[camera]` and `[[camera]]` of a job: the pose and the projection of cameras. `camera = "name"` selects one.

use super::place::{Place, direction, optional_point, three};
use super::{FilmSettings, LensProjection, LensSettings, SensorChoice, check, lens};
use crate::error::InputError;
use crate::names::suggestion;
use crate::toml_file::TomlFile;
use dunkelfeld_geometry::{DAffine3, DMat3, DVec3};
use dunkelfeld_radiometry::Number;
use dunkelfeld_scene::{Camera, Projection, SceneBuilder, look_at};
use serde::Deserialize;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, Error, MapAccess, SeqAccess, Visitor};
use std::fmt;

/// Largest difference of R R^T from the identity in an element. Matrices that were rounded to five digits pass.
const ROTATION_TOLERANCE: f64 = 1e-4;
/// Sine of the angle between two directions below which they count as parallel.
const PARALLEL: f64 = 1e-6;

/// The key `camera`: the name of a camera, or the definitions of cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cameras {
    /// `camera = "name"`. Default: the first camera, or a view of the whole scene if there is none.
    pub selected: Option<String>,
    /// `[camera]` or `[[camera]]`. All of them are rendered.
    pub defined: Vec<CameraSettings>,
    /// Are they written as a list, `[[camera]]`?
    is_list: bool,
}

impl<'de> Deserialize<'de> for Cameras {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct CamerasVisitor;
        impl<'de> Visitor<'de> for CamerasVisitor {
            type Value = Cameras;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the name of a camera, or a section [camera] or [[camera]]")
            }
            fn visit_str<E: Error>(self, name: &str) -> Result<Cameras, E> {
                Ok(Cameras { selected: Some(name.into()), ..Cameras::default() })
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Cameras, A::Error> {
                let camera = CameraSettings::deserialize(MapAccessDeserializer::new(map))?;
                Ok(Cameras { defined: vec![camera], ..Cameras::default() })
            }
            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Cameras, A::Error> {
                let defined = Vec::deserialize(SeqAccessDeserializer::new(seq))?;
                Ok(Cameras { defined, is_list: true, selected: None })
            }
        }
        d.deserialize_any(CamerasVisitor)
    }
}

/// A camera of the job. Without a pose it is the camera of the scene with its name.
///
/// The pose is one of: `position` and `look_at`; `look_at` and `working_distance`; `R` and `t`. The projection is one
/// of: `vertical_fov`; `K`; the keys of the lens.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraSettings {
    /// Its name, unique in the job. Default `"camera"`, then `"camera-2"` and so on.
    pub name: String,
    /// Position of the camera in the world \[m\]: the middle of its lens.
    #[serde(deserialize_with = "optional_point")]
    pub position: Option<DVec3>,
    /// The point in the middle of the image: coordinates, or the name of objects.
    pub look_at: Option<Place>,
    /// Direction that is up in the image, in the world. Default +y, or -z for a view along y.
    #[serde(deserialize_with = "direction")]
    pub up: Option<DVec3>,
    /// Distance \[m\] from the lens to `look_at`.
    #[serde(deserialize_with = "check::positive_length")]
    pub working_distance: Option<f64>,
    /// Direction from `look_at` to the camera, with a working distance. Default +y: the camera looks down.
    #[serde(deserialize_with = "direction")]
    pub direction: Option<DVec3>,
    /// Rotation from the world to the frame of the camera, in rows, with the axes of OpenCV: x right, y down, z
    /// forward. Stored as read.
    #[serde(rename = "R", deserialize_with = "rows")]
    pub rotation: Option<[[f64; 3]; 3]>,
    /// Translation \[m\] of OpenCV: a point of the world is at R x + t in the frame of the camera.
    #[serde(deserialize_with = "optional_point")]
    pub t: Option<DVec3>,
    /// Full vertical field of view \[rad\] of a perspective; written as `"30deg"`.
    #[serde(deserialize_with = "check::field_of_view")]
    pub vertical_fov: Option<f64>,
    /// Camera matrix \[pixels\] of OpenCV for the whole film, in rows: fx, 0, cx; 0, fy, cy; 0, 0, 1. The middle of the
    /// first pixel is (0, 0).
    #[serde(rename = "K", deserialize_with = "rows")]
    pub intrinsics: Option<[[f64; 3]; 3]>,
    /// The lens of this camera, instead of `[lens]`.
    pub lens: Option<LensSettings>,
    /// `false`: it is not rendered, and lamps may refer to it. Default true.
    pub enabled: Option<bool>,
}

/// A matrix of three rows.
fn rows<'de, D: Deserializer<'de>>(d: D) -> Result<Option<[[f64; 3]; 3]>, D::Error> {
    struct Row([f64; 3]);
    impl<'de> Deserialize<'de> for Row {
        fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
            three(d, "a row of three numbers").map(Self)
        }
    }
    let matrix = three::<Row, D>(d, "three rows of three numbers")?.map(|row| row.0);
    match matrix.as_flattened().iter().find(|v| v.is_nan() || v.abs() > 1e9) {
        Some(v) => Err(D::Error::custom(format!("{} is out of range; write numbers from -1e9 to 1e9", Number(*v)))),
        None => Ok(Some(matrix)),
    }
}

fn fault<T>(key: &str, problem: impl Into<String>, help: impl Into<String>) -> Result<T, InputError> {
    Err(InputError::of_key(key, problem, help))
}

impl CameraSettings {
    /// The lens of the camera: its own, or that of the job. A working distance and a focal length give the
    /// magnification of the thin lens, m = f / (u - f), and a working distance and a magnification give the focal
    /// length, unless the lens has a focus distance. So the plane at the working distance has its size in the image.
    pub fn lens_or(&self, of_job: &LensSettings) -> LensSettings {
        let mut lens = self.lens.as_ref().unwrap_or(of_job).clone();
        let is_open = lens.focus_distance.is_none() && self.vertical_fov.or(lens.vertical_fov).is_none();
        let is_perspective = lens.projection != Some(LensProjection::Telecentric);
        if let (Some(u), None, true, true) = (self.working_distance, self.intrinsics, is_open, is_perspective) {
            match (lens.focal_length, lens.magnification) {
                (Some(f), None) if f < u => lens.magnification = Some(f / (u - f)),
                (None, Some(m)) if m > 0.0 => lens.focal_length = Some(u * m / (1.0 + m)),
                _ => {}
            }
        }
        lens
    }

    /// Is it rendered?
    pub fn is_enabled(&self) -> bool {
        self.enabled != Some(false)
    }

    fn has_pose(&self) -> bool {
        self.look_at.is_some() || self.position.is_some() || self.rotation.is_some()
    }

    /// Is there one pose and one projection at most?
    fn check(&self, of_job: &LensSettings) -> Result<(), InputError> {
        self.check_pose()?;
        let lens = self.lens.as_ref().unwrap_or(of_job);
        if let (Some(f), Some(u), None) = (lens.focal_length, self.working_distance, lens.focus_distance)
            && f >= u
        {
            let problem = format!("a lens with a focal length of {} m is sharp only beyond it", Number(f));
            return fault("working_distance", problem, "write a larger distance, or a shorter `focal_length`");
        }
        let projection = match (self.vertical_fov, &self.intrinsics) {
            (None, None) => return Ok(()),
            (Some(_), Some(_)) => {
                return fault("K", "`vertical_fov` and `K` both set the projection", "keep one of them");
            }
            (Some(_), None) => "vertical_fov",
            (None, Some(_)) => "K",
        };
        let telecentric = lens.projection == Some(LensProjection::Telecentric);
        let keys = [
            ("projection", telecentric),
            ("vertical_fov", lens.vertical_fov.is_some()),
            ("focal_length", lens.focal_length.is_some()),
            ("field_height", lens.field_height.is_some()),
            ("principal_point", self.intrinsics.is_some() && lens.principal_point.is_some()),
        ];
        if let Some((key, _)) = keys.iter().find(|(_, given)| *given) {
            let problem = format!("`{projection}` and `{key}` of the lens both set the projection");
            return fault(projection, problem, "remove one of them, or write `lens = {}` for a camera without [lens]");
        }
        match &self.intrinsics {
            Some(k) => check_intrinsics(k),
            None => Ok(()),
        }
    }

    fn check_pose(&self) -> Result<(), InputError> {
        let looks = [
            ("position", self.position.is_some()),
            ("look_at", self.look_at.is_some()),
            ("working_distance", self.working_distance.is_some()),
            ("direction", self.direction.is_some()),
            ("up", self.up.is_some()),
        ];
        let given = looks.iter().find(|(_, given)| *given).map(|(key, _)| *key);
        match (&self.rotation, &self.t, given) {
            (Some(_), Some(_), Some(key)) => {
                let problem = format!("`R` and `t` are a pose already, and `{key}` belongs to another one");
                return fault(key, problem, "keep one of the two poses");
            }
            (Some(r), Some(_), None) => return check_rotation(r),
            (Some(_), None, _) => return fault("R", "`R` is a pose only together with `t`", "add `t = [x, y, z]`"),
            (None, Some(_), _) => return fault("t", "`t` is a pose only together with `R`", "add `R`, three rows"),
            (None, None, _) => {}
        }
        let add_target = "add `look_at`, a point or an object";
        match (self.position.is_some(), self.look_at.is_some(), self.working_distance.is_some(), given) {
            (true, _, true, _) => {
                let problem = "`position` and `working_distance` both set the place of the camera";
                fault("working_distance", problem, "keep one of them")
            }
            (true, false, false, _) => fault("position", "the direction of the view is missing", add_target),
            (true, true, false, _) if self.direction.is_some() => {
                let problem = "`position` and `direction` both set the place of the camera";
                fault("direction", problem, "remove one")
            }
            (false, true, false, _) => {
                let help = "add `position`, or a `working_distance`";
                fault("look_at", "the place of the camera is missing", help)
            }
            (false, false, true, _) => fault("working_distance", "the place of the object is missing", add_target),
            (false, false, false, Some(key)) => {
                let problem = format!("`{key}` belongs to a pose, and there is none");
                fault(key, problem, "add `look_at` with a `position` or a `working_distance`")
            }
            _ => Ok(()),
        }
    }

    /// The transform from the camera to the world; `None` without a pose.
    fn to_world(&self, scene: &SceneBuilder) -> Result<Option<DAffine3>, InputError> {
        if let (Some([right, down, forward]), Some(t)) = (self.rotation, self.t) {
            let [right, down, forward] = [right, down, forward].map(DVec3::from_array);
            let axes = DMat3::from_cols(right, -down, -forward);
            let position = -(right * t.x + down * t.y + forward * t.z);
            return Ok(Some(DAffine3 { matrix3: axes, translation: position }));
        }
        let Some(place) = &self.look_at else { return Ok(None) };
        let target = place.resolve(scene).map_err(|e| InputError { place: "look_at".into(), ..e })?;
        let eye = match (self.position, self.working_distance) {
            (Some(position), _) => position,
            (None, Some(distance)) => target + distance * self.direction.unwrap_or(DVec3::Y),
            (None, None) => return Ok(None),
        };
        let Some(back) = (eye - target).try_normalize() else {
            let problem = "the camera is at the point that it looks at";
            return fault("position", problem, "move it away from `look_at`");
        };
        let up = match self.up {
            Some(up) if up.cross(back).length() < PARALLEL => {
                return fault("up", "`up` is parallel to the view", "write a direction across the view");
            }
            Some(up) => up,
            None if DVec3::Y.cross(back).length() < PARALLEL => DVec3::NEG_Z,
            None => DVec3::Y,
        };
        Ok(Some(look_at(eye, target, up)))
    }

    /// The camera, from the camera of the scene with its name.
    pub(super) fn camera(&self, scene: &SceneBuilder) -> Result<Camera, InputError> {
        let of_scene = scene.cameras.iter().find(|camera| camera.name == self.name);
        let mut camera = match of_scene {
            Some(camera) => camera.clone(),
            None if self.has_pose() => Camera { name: self.name.clone(), ..Camera::default() },
            None => {
                let known: Vec<&str> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
                let problem = format!("\"{}\" has no pose, and the scene has no camera of this name", self.name);
                let help = format!("add `position` and `look_at`; {}", suggestion(&self.name, "cameras", &known));
                return fault("name", problem, help);
            }
        };
        if let Some(to_world) = self.to_world(scene)? {
            camera.to_world = to_world;
        }
        if let Some(field) = self.vertical_fov {
            camera.projection = Projection::Perspective { vertical_fov: field as f32 };
        }
        Ok(camera)
    }

    /// Sets the projection of `K`, which refers to a whole film of these pixels.
    pub(super) fn set_intrinsics(&self, camera: &mut Camera, [width, height]: [u32; 2]) {
        if let Some([[fx, _, cx], [_, fy, cy], _]) = self.intrinsics {
            let [width, height] = [width, height].map(f64::from);
            let field = 2.0 * (0.5 * height / fy).atan();
            camera.projection = Projection::Perspective { vertical_fov: field as f32 };
            camera.lens.principal_point = [cx - 0.5 * (width - 1.0), cy - 0.5 * (height - 1.0)];
            camera.lens.pixel_aspect = fy / fx;
        }
    }
}

/// Largest coordinate of a principal point \[pixels\].
const MAX_PRINCIPAL_POINT: f64 = 5e5;

/// Is this a camera matrix without skew?
fn check_intrinsics([[fx, skew, cx], [zero, fy, cy], last]: &[[f64; 3]; 3]) -> Result<(), InputError> {
    let form = "write [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]";
    if *last != [0.0, 0.0, 1.0] {
        return fault("K", "the last row of `K` is not 0, 0, 1", form);
    }
    for (name, focal_length) in [("fx", *fx), ("fy", *fy)] {
        if focal_length <= 0.0 {
            let problem = format!("the focal length {name} is {}, which is not above zero", Number(focal_length));
            return fault("K", problem, format!("{form}, with focal lengths in pixels"));
        }
    }
    if *skew != 0.0 || *zero != 0.0 {
        let skew = Number(if *skew != 0.0 { *skew } else { *zero });
        return fault("K", format!("`K` has a skew of {skew}; only 0 is supported"), form);
    }
    if !(1e-3..=1e3).contains(&(fy / fx)) {
        return fault("K", "fx and fy differ by more than a factor of 1000", form);
    }
    for (name, value) in [("cx", *cx), ("cy", *cy)] {
        if value.is_nan() || value.abs() > MAX_PRINCIPAL_POINT {
            let problem = format!("{name} is {} pixels, which is out of range", Number(value));
            return fault("K", problem, format!("{form}, with a principal point in the film"));
        }
    }
    Ok(())
}

/// Is this a rotation?
fn check_rotation(rows: &[[f64; 3]; 3]) -> Result<(), InputError> {
    let r = DMat3::from_cols_array_2d(rows).transpose();
    let difference = r * r.transpose() - DMat3::IDENTITY;
    let largest = difference.to_cols_array().into_iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    if largest.is_nan() || largest > ROTATION_TOLERANCE {
        let problem = format!("`R` is not a rotation: R R^T differs from the identity by {}", Number(largest));
        return fault("R", problem, "write the three rows of the rotation matrix, as `cv2.Rodrigues` returns them");
    }
    if r.determinant() < 0.0 {
        let problem = "`R` is mirrored: its determinant is -1";
        return fault("R", problem, "change the sign of one row: x is right, y is down and z is forward");
    }
    Ok(())
}

impl Cameras {
    /// Names the cameras, and checks all that needs no scene.
    pub(super) fn complete(
        &mut self,
        file: &TomlFile,
        of_job: &LensSettings,
        film: &FilmSettings,
        sensor: &SensorChoice,
    ) -> Result<(), InputError> {
        if self.is_list && self.defined.is_empty() {
            return Err(file.error_at_key(&["camera"], "the list of cameras is empty", "define one, or remove it"));
        }
        if !self.defined.is_empty() && !self.defined.iter().any(CameraSettings::is_enabled) {
            return Err(self.error(file, 0, &["enabled"], "no camera is enabled", "remove this from one camera"));
        }
        for i in 0..self.defined.len() {
            let (before, rest) = self.defined.split_at_mut(i);
            let Some(camera) = rest.first_mut() else { break };
            if camera.name.is_empty() {
                camera.name = if i == 0 { "camera".into() } else { format!("camera-{}", i + 1) };
            }
            if before.iter().any(|other| other.name == camera.name) {
                let problem = format!("there are two cameras named \"{}\"", camera.name);
                return Err(self.error(file, i, &["name"], problem, "give each its own name"));
            }
            let Some(camera) = self.defined.get(i) else { break };
            if let Some(own) = &camera.lens {
                lens::check_lens(own, film, sensor)
                    .map_err(|e| self.error(file, i, &["lens", &e.place], e.problem, e.help))?;
            }
            camera.check(of_job).map_err(|e| self.error(file, i, &[&e.place], e.problem, e.help))?;
            lens::check_lens(&camera.lens_or(of_job), film, sensor)
                .map_err(|e| self.error(file, i, &["working_distance"], e.problem, e.help))?;
        }
        Ok(())
    }

    /// An error about a key of the camera at an index.
    pub(super) fn error(
        &self,
        file: &TomlFile,
        index: usize,
        key: &[&str],
        problem: impl Into<String>,
        help: impl Into<String>,
    ) -> InputError {
        let index = index.to_string();
        let mut path = if self.is_list { vec!["camera", &index] } else { vec!["camera"] };
        path.extend(key);
        file.error_at_key(&path, problem, help)
    }
}
