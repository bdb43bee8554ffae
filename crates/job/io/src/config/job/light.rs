//! `[[light]]` of a job: a new lamp with the keys of its kind, or a change of lights of the scene.

use super::lamp_values::StrengthKeys;
use super::place::{self, Place};
use super::{Exposure, Job, LedCount, Strength, Wavelength, check};
use crate::error::InputError;
use crate::toml_file::TomlFile;
use crate::toml_keys::{TableKeys, keys_of};
use dunkelfeld_geometry::DVec3;
use dunkelfeld_radiometry::Number;
use serde::Deserialize;
use std::path::PathBuf;

/// Largest number of lamps of a job that have a surface.
const MAX_LAMPS: u32 = 1000;

/// An entry of `[[light]]`: a new lamp if it has a `kind`, otherwise a change.
#[derive(Clone, Debug, PartialEq)]
pub enum Light {
    /// A new lamp.
    Lamp(Box<Lamp>),
    /// A change of lights of the scene.
    Change(LightChange),
}

/// A change of lights of the scene.
///
/// The name is searched among lights without extent, then among objects (nodes) with an emissive material, then among
/// emissive materials, then among all objects and all materials. The first kind with a match is used. An object that
/// shares its mesh or material with others gets its own copy.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightChange {
    /// Name or pattern with `*` and `?` of lights of the scene.
    #[serde(default)]
    pub name: String,
    /// `false` switches it off. Its body goes as well: an object with an emitting part, or all parts of an emitting
    /// material. Default true.
    #[serde(default = "check::yes")]
    pub enabled: bool,
    /// An IES file (ANSI/IES LM-63, type C), relative to the job file. It replaces the distribution and strength of a
    /// point or spot light, whose hue remains. The nadir of the file is the light's -z, its zero plane contains +x.
    pub ies: Option<PathBuf>,
    /// Factor of the strength of each light of the scene that the name selects. Default 1.
    #[serde(default, deserialize_with = "check::light_scale")]
    pub scale: Option<f64>,
    /// Wavelength of the light; the quantum efficiency of the sensor is that at it.
    pub wavelength: Option<Wavelength>,
    /// Its strength.
    #[serde(skip)]
    pub strength: Option<Strength>,
}

/// A new lamp, described as in a catalogue.
#[derive(Clone, Debug, PartialEq)]
pub struct Lamp {
    /// The keys of all lamps. Its name is the kind if none is given.
    pub common: LampKeys,
    /// Its kind, with the keys of this kind.
    pub kind: LampKind,
    /// Its strength. Default 1 W.
    pub strength: Option<Strength>,
    /// Distance \[m\] of an irradiance from the lamp. Default: that of the target.
    pub working_distance: Option<f64>,
    /// LEDs, housing and angular distribution.
    pub front: Front,
    /// Its place.
    pub pose: Pose,
}

/// Keys of all lamps.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct LampKeys {
    /// Name of the lamp.
    #[serde(default)]
    pub name: String,
    /// `false`: it does not exist. Default true.
    #[serde(default = "check::yes")]
    pub enabled: bool,
    /// Wavelength of the light; the quantum efficiency of the sensor is that at it.
    pub wavelength: Option<Wavelength>,
    /// Duration \[s\] of the pulse of the lamp in the middle of each exposure, at most the exposure time.
    #[serde(default, deserialize_with = "check::pulse")]
    pub strobe: Option<f64>,
    /// Name of the camera that the place of the lamp refers to. Default: the camera that the job selects, or its first
    /// one. The beam splitter of a coaxial lamp is in front of this camera.
    pub camera: Option<String>,
}

/// The kinds of lamps.
#[derive(Clone, Debug, PartialEq)]
pub enum LampKind {
    /// A ring around the axis.
    Ring(Ring),
    /// A long rectangle.
    Bar(Bar),
    /// The inside of a hemisphere.
    Dome(Dome),
    /// A panel whose image in a beam splitter lies on the axis of the camera.
    Coaxial(PanelSize, Splitter),
    /// A panel behind the part.
    Back(PanelSize),
    /// A rectangle or a disc.
    Panel(PanelSize),
    /// A cone of light.
    Spot(Spot),
    /// Light in all directions, from a point or a sphere.
    Point(Point),
    /// Light from infinitely far away.
    Sun(Sun),
    /// The same radiance from all directions.
    Environment(Sky),
}

/// The names of the kinds.
const KINDS: &[&str] = &["ring", "bar", "dome", "coaxial", "back", "panel", "spot", "point", "sun", "environment"];

/// Keys of a ring.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ring {
    /// Outer diameter \[m\].
    #[serde(deserialize_with = "check::length")]
    pub diameter: f64,
    /// Inner diameter \[m\]. Default 0.6 of the outer one.
    #[serde(default, deserialize_with = "check::positive_length")]
    pub inner_diameter: Option<f64>,
    /// Angle \[rad\] by which the normals are tilted toward the axis. Default 0.
    #[serde(default, deserialize_with = "check::quarter_turn")]
    pub tilt: Option<f64>,
}

/// Keys of a bar.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bar {
    /// Width \[m\].
    #[serde(deserialize_with = "check::length")]
    pub width: f64,
    /// Height \[m\]. Default a tenth of the width.
    #[serde(default, deserialize_with = "check::positive_length")]
    pub height: Option<f64>,
}

/// Keys of a dome.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dome {
    /// Diameter \[m\].
    #[serde(deserialize_with = "check::length")]
    pub diameter: f64,
    /// Diameter \[m\] of the opening at the apex. Default a quarter of that of the dome.
    #[serde(default, deserialize_with = "check::length_or_zero")]
    pub opening: Option<f64>,
}

/// Size of a panel: that of a rectangle, or the diameter of a disc.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PanelSize {
    /// Width \[m\].
    #[serde(default, deserialize_with = "check::positive_length")]
    pub width: Option<f64>,
    /// Height \[m\]. Default the width, or the diameter.
    #[serde(default, deserialize_with = "check::positive_length")]
    pub height: Option<f64>,
    /// Diameter \[m\].
    #[serde(default, deserialize_with = "check::positive_length")]
    pub diameter: Option<f64>,
}

/// Keys of a coaxial lamp beside its size.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Splitter {
    /// Share of the light that the beam splitter reflects toward the part. Default 0.5.
    #[serde(default, deserialize_with = "check::inner_share")]
    pub splitter: Option<f64>,
}

/// Keys of a spot.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spot {
    /// Diameter \[m\]. Default: without extent.
    #[serde(default, deserialize_with = "check::positive_length")]
    pub diameter: Option<f64>,
    /// Full angle \[rad\] of the cone. Default 45 degrees.
    #[serde(default, deserialize_with = "check::open_angle")]
    pub cone_angle: Option<f64>,
    /// Share of the cone that is its soft edge. Default 0.15.
    #[serde(default, deserialize_with = "check::unit")]
    pub blend: Option<f32>,
}

/// Keys of a point.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// Diameter \[m\]. Default: without extent.
    #[serde(default, deserialize_with = "check::positive_length")]
    pub diameter: Option<f64>,
}

/// Keys of a sun.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sun {
    /// Angular diameter \[rad\]. Default that of the sun.
    #[serde(default, deserialize_with = "check::sun_angle")]
    pub angle: Option<f64>,
}

/// Keys of an environment: none.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sky {}

/// LEDs, housing and angular distribution of a lamp. Default: the whole surface is Lambertian.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Front {
    /// Number of LEDs in a row, or `[columns, rows]`.
    pub leds: Option<LedCount>,
    /// Diameter \[m\] of the emitting disc of an LED.
    #[serde(deserialize_with = "check::positive_length")]
    pub led_diameter: Option<f64>,
    /// Does a diffuser cover the LEDs, so that the whole surface emits?
    pub diffuser: Option<bool>,
    /// `false`: the lamp is invisible and transparent from behind.
    pub body: Option<bool>,
    /// Full angle \[rad\] at half of the intensity, up to that of a Lambertian surface (120 degrees).
    #[serde(deserialize_with = "check::lens_angle")]
    pub lens_angle: Option<f64>,
    /// Full angle \[rad\] beyond which a louver lets nothing pass.
    #[serde(deserialize_with = "check::open_angle")]
    pub spread: Option<f64>,
}

/// The place of a lamp: a position with a target or an aim, or a target with a distance and a direction.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Pose {
    /// Centre of the lamp \[m\] in the world.
    #[serde(deserialize_with = "place::optional_point")]
    pub position: Option<DVec3>,
    /// Direction in which the lamp shines, of a lamp at a position or a sun.
    #[serde(deserialize_with = "place::direction")]
    pub aim: Option<DVec3>,
    /// Point that the lamp faces. Default: the point of the camera's axis nearest to the middle of the scene.
    pub target: Option<Place>,
    /// Distance \[m\] from the target.
    #[serde(deserialize_with = "check::length_or_zero")]
    pub distance: Option<f64>,
    /// Direction from the target to the lamp. Default: to the camera.
    #[serde(deserialize_with = "place::direction")]
    pub direction: Option<DVec3>,
    /// Angle \[rad\] of that direction above the plane through the target that is perpendicular to the axis of the camera.
    #[serde(deserialize_with = "check::angle")]
    pub elevation: Option<f32>,
    /// Angle \[rad\] around the axis of the camera, from its right toward up.
    #[serde(deserialize_with = "check::angle")]
    pub azimuth: Option<f32>,
    /// Direction of the height of the lamp.
    #[serde(deserialize_with = "place::direction")]
    pub up: Option<DVec3>,
    /// Number of such lamps, evenly around the axis of the camera.
    #[serde(deserialize_with = "check::count")]
    pub count: Option<u32>,
}

/// The keys of `[[light]]`, of all kinds.
pub fn light_keys() -> Vec<&'static str> {
    let lists = [
        &["kind"],
        keys_of::<LightChange>(),
        keys_of::<StrengthKeys>(),
        keys_of::<LampKeys>(),
        keys_of::<Front>(),
        keys_of::<Pose>(),
        keys_of::<Ring>(),
        keys_of::<Dome>(),
        keys_of::<PanelSize>(),
        keys_of::<Splitter>(),
        keys_of::<Spot>(),
        keys_of::<Sun>(),
    ];
    let mut keys = lists.concat();
    keys.sort_unstable();
    keys.dedup();
    keys
}

impl Light {
    /// Reads the entries of a job.
    pub(super) fn read_all(job: &Job, file: &TomlFile) -> Result<Vec<Self>, InputError> {
        let mut list = Vec::new();
        let mut room =
            Room { environment: job.environment.is_some().then(|| "[environment]".into()), ..Room::default() };
        for mut keys in TableKeys::of_list(file, "light") {
            let light = match keys.kind(KINDS)? {
                Some(kind) => Self::Lamp(Box::new(Lamp::read(kind, &mut keys, job.sensor.exposure)?)),
                None => Self::Change(LightChange::read(&mut keys)?),
            };
            if let Self::Lamp(lamp) = &light {
                room.add(lamp, list.len(), &keys)?;
            }
            list.push(light);
        }
        Ok(list)
    }

    /// Its IES file.
    pub(super) fn profile(&self) -> Option<&PathBuf> {
        if let Self::Change(change) = self { change.ies.as_ref() } else { None }
    }

    /// Is it on?
    pub(super) fn is_enabled(&self) -> bool {
        match self {
            Self::Lamp(lamp) => lamp.common.enabled,
            Self::Change(change) => change.enabled,
        }
    }

    /// Its wavelength.
    pub(super) fn wavelength(&self) -> Option<Wavelength> {
        match self {
            Self::Lamp(lamp) => lamp.common.wavelength,
            Self::Change(change) => change.wavelength,
        }
    }
}

impl LightChange {
    fn read(keys: &mut TableKeys<'_>) -> Result<Self, InputError> {
        keys.describe(" of a light without a `kind`");
        let (strength, _) = Strength::read(keys, &["working_distance"])?;
        let mut change: Self = keys.rest()?;
        if change.name.is_empty() {
            let help = "write the name of a light of the scene, or a `kind` such as \"ring\" for a new lamp";
            return Err(keys.error("name", "a change of a light needs its name", help));
        }
        strength.map_or(Ok(()), |strength| strength.check_color(change.wavelength, keys))?;
        change.ies = change.ies.map(|path| keys.file().resolve(path));
        Ok(Self { strength, ..change })
    }
}

impl Lamp {
    fn read(kind: &'static str, keys: &mut TableKeys<'_>, exposure: Exposure) -> Result<Self, InputError> {
        keys.describe(format!(" of a light of kind \"{kind}\""));
        let (is_sun, is_sky) = (kind == "sun", kind == "environment");
        let mut common: LampKeys = keys.take(if is_sky { &["camera"] } else { &[] })?;
        if common.name.is_empty() {
            common.name = kind.into();
        }
        let (strength, working_distance) = Strength::read(
            keys,
            match kind {
                "spot" | "point" => &["radiance"],
                "sun" => &["radiance", "power", "intensity", "working_distance"],
                "environment" => &["power", "intensity", "irradiance", "working_distance"],
                _ => &["intensity"],
            },
        )?;
        let front = match kind {
            "ring" => keys.take(&["body", "spread"])?,
            "bar" | "back" | "panel" => keys.take(&[])?,
            "coaxial" => keys.take(&["leds", "led_diameter", "diffuser", "body"])?,
            _ => Front::default(),
        };
        let pose = match kind {
            "environment" => Pose::default(),
            "sun" => Pose::read(keys, &["position", "target", "distance", "up", "count"])?,
            "point" => Pose::read(keys, &["aim", "up"])?,
            // Copies around the axis would need a beam splitter each.
            "coaxial" => Pose::read(keys, &["count"])?,
            _ => Pose::read(keys, &[])?,
        };
        let kind = match kind {
            "ring" => LampKind::Ring(keys.rest()?),
            "bar" => LampKind::Bar(keys.rest()?),
            "dome" => LampKind::Dome(keys.rest()?),
            "coaxial" => LampKind::Coaxial(keys.take(&[])?, keys.rest()?),
            "back" => LampKind::Back(keys.rest()?),
            "panel" => LampKind::Panel(keys.rest()?),
            "spot" => LampKind::Spot(keys.rest()?),
            "point" => LampKind::Point(keys.rest()?),
            "sun" => LampKind::Sun(keys.rest()?),
            _ => LampKind::Environment(keys.rest()?),
        };
        let lamp = Self { common, kind, strength, working_distance, front, pose };
        strength.map_or(Ok(()), |strength| strength.check_color(lamp.common.wavelength, keys))?;
        lamp.kind.check(keys)?;
        lamp.front.check(keys)?;
        let needs_distance = !(is_sun || is_sky || matches!(lamp.kind, LampKind::Dome(_)));
        lamp.check_place(keys, needs_distance)?;
        lamp.check_strobe(keys, exposure)?;
        Ok(lamp)
    }

    fn check_place(&self, keys: &TableKeys<'_>, needs_distance: bool) -> Result<(), InputError> {
        let Pose { position, aim, distance, .. } = &self.pose;
        if needs_distance && position.is_none() && distance.is_none() {
            let help = "write distance = \"200mm\" from the target, or a `position`";
            return Err(keys.error("kind", "the place of the lamp is missing", help));
        }
        let is_irradiance = matches!(self.strength, Some(Strength::Irradiance(_)));
        if position.is_some() && aim.is_some() && is_irradiance && self.working_distance.is_none() {
            let problem = "a lamp with `aim` faces no target, so that the distance of its irradiance is missing";
            return Err(keys.error("irradiance", problem, "write `working_distance` as well"));
        }
        Ok(())
    }

    fn check_strobe(&self, keys: &TableKeys<'_>, exposure: Exposure) -> Result<(), InputError> {
        let Some(strobe) = self.common.strobe else { return Ok(()) };
        let Exposure::Seconds(exposure) = exposure else {
            let help = "write `exposure` in [sensor], such as \"1ms\"";
            return Err(keys.error("strobe", "a strobe needs a fixed exposure time", help));
        };
        if strobe > exposure * (1.0 + 1e-9) {
            let (strobe, exposure) = (Number(strobe), Number(exposure));
            let problem = format!("the pulse of {strobe} s is longer than the exposure of {exposure} s");
            let help = "write a shorter one, or remove it: then the lamp is on for the whole exposure";
            return Err(keys.error("strobe", problem, help));
        }
        Ok(())
    }

    /// LEDs that are seen one by one.
    pub(super) fn leds(&self) -> Option<LedCount> {
        self.front.leds.filter(|_| self.front.diffuser != Some(true))
    }

    /// Its number.
    pub(super) fn count(&self) -> u32 {
        self.pose.count.unwrap_or(1)
    }

    /// The names of the lamps of the entry in the scene.
    pub(super) fn names(&self) -> Vec<String> {
        let name = &self.common.name;
        match self.count() {
            1 => vec![name.clone()],
            count => (1..=count).map(|k| format!("{name} {k}")).collect(),
        }
    }
}

impl LampKind {
    fn check(&self, keys: &TableKeys<'_>) -> Result<(), InputError> {
        let (key, outer, inner) = match self {
            Self::Ring(ring) => ("inner_diameter", ring.diameter, ring.inner_diameter),
            Self::Dome(dome) => ("opening", dome.diameter, dome.opening),
            Self::Coaxial(size, _) | Self::Back(size) | Self::Panel(size) => return size.check(keys),
            _ => return Ok(()),
        };
        match inner {
            Some(inner) if inner >= outer => {
                let problem = format!("{key} {} m is not below the diameter {} m", Number(inner), Number(outer));
                Err(keys.error(key, problem, "write a smaller one"))
            }
            _ => Ok(()),
        }
    }
}

impl PanelSize {
    fn check(&self, keys: &TableKeys<'_>) -> Result<(), InputError> {
        match (self.width, self.diameter) {
            (Some(_), Some(_)) => {
                Err(keys.error("width", "`diameter` and `width`: both set the size", "keep one of them"))
            }
            (None, None) => {
                let help = "write width = \"100mm\" and `height`, or `diameter`";
                Err(keys.error("kind", "the size of the panel is missing", help))
            }
            _ => Ok(()),
        }
    }
}

impl Front {
    fn check(&self, keys: &TableKeys<'_>) -> Result<(), InputError> {
        let given = [("led_diameter", self.led_diameter.is_some()), ("diffuser", self.diffuser.is_some())];
        if let (None, Some((key, _))) = (self.leds, given.iter().find(|(_, given)| *given)) {
            return Err(keys.error(key, "there are no LEDs", "write `leds` as well, or remove this"));
        }
        if self.led_diameter.is_some() && self.diffuser == Some(true) {
            let help = "remove this, or write diffuser = false";
            return Err(keys.error("led_diameter", "the whole surface emits behind a diffuser", help));
        }
        if self.lens_angle.is_some() && self.spread.is_some() {
            let problem = "`lens_angle` and `spread`: both set the angular distribution";
            return Err(keys.error("spread", problem, "keep one of them"));
        }
        Ok(())
    }
}

impl Pose {
    /// The keys of a place, except those in `without`. A lamp at a position has no distance from a target; only such a lamp
    /// and a sun have an aim.
    fn read(keys: &mut TableKeys<'_>, without: &[&str]) -> Result<Self, InputError> {
        let is_sun = without.contains(&"position");
        let of_place: &[&str] = if keys.has("position") && !is_sun {
            keys.describe(" with a `position`");
            &["distance", "direction", "elevation", "azimuth"]
        } else if is_sun {
            &[]
        } else {
            &["aim"]
        };
        let pose: Self = keys.take(&[without, of_place].concat())?;
        let given = [
            ("aim", pose.aim.is_some()),
            ("direction", pose.direction.is_some()),
            ("elevation", pose.elevation.is_some()),
            ("target", pose.target.is_some() && pose.aim.is_some()),
        ];
        let mut given = given.iter().filter(|(_, given)| *given).map(|(key, _)| *key);
        if let (Some(first), Some(second)) = (given.next(), given.next()) {
            let problem = format!("`{first}` and `{second}` both set the direction of the lamp");
            return Err(keys.error(second, problem, "keep one of them"));
        }
        if pose.azimuth.is_some() && pose.elevation.is_none() {
            let help = "write `elevation` as well, or remove this";
            return Err(keys.error("azimuth", "an azimuth without an elevation gives no direction", help));
        }
        if pose.azimuth.is_some() && pose.up.is_some() {
            return Err(keys.error("up", "`azimuth` turns the lamp already", "keep one of them"));
        }
        Ok(pose)
    }
}

/// The lamps of a job together: their number, their LEDs, and that there is one environment.
#[derive(Default)]
struct Room {
    environment: Option<String>,
    lamps: u32,
    leds: u32,
}

impl Room {
    fn add(&mut self, lamp: &Lamp, i: usize, keys: &TableKeys<'_>) -> Result<(), InputError> {
        if !lamp.common.enabled {
            return Ok(());
        }
        if matches!(lamp.kind, LampKind::Environment(_)) {
            let own = format!("[[light]] {}", i + 1);
            if let Some(other) = self.environment.replace(own) {
                let problem = format!("a scene has one environment, and {other} sets it already");
                return Err(keys.error("kind", problem, "keep one of them"));
            }
        }
        if lamp.surface().is_some() {
            self.lamps += lamp.count();
        }
        if self.lamps > MAX_LAMPS {
            let problem = format!("the job has more than {MAX_LAMPS} lamps with a surface, each of `count` counted");
            return Err(keys.error("kind", problem, "write fewer lamps"));
        }
        if let Some(own) = lamp.leds() {
            self.leds += lamp.count() * own.columns * own.rows;
        }
        if self.leds > LedCount::MOST {
            let problem = format!("the lamps of the job have more than {} LEDs together", LedCount::MOST);
            let help = "write fewer LEDs, or diffuser = true for lamps whose LEDs are not seen one by one";
            return Err(keys.error("leds", problem, help));
        }
        Ok(())
    }
}
