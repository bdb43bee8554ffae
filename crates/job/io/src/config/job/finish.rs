//! `finish`, `height` and `grain` of `[[material]]`: machined surfaces, and heights of images.

use super::check;
use super::place::point;
use dunkelfeld_geometry::{DVec3, Vec3};
use dunkelfeld_scene::{Finish, Grain, Process};
use serde::de::value::{MapAccessDeserializer, StrDeserializer};
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;
use std::path::PathBuf;

/// `grain`: the direction of the grooves in the frame of the object, or the axis that they run about.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(untagged, expecting = "write a direction such as [1, 0, 0], or { axis = [0, 0, 1], origin = [0, 0, 0] }")]
pub enum GrainSettings {
    /// A direction.
    Straight([f64; 3]),
    /// An axis.
    Around(Around),
}

/// An axis in the frame of the object.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Around {
    /// Its direction.
    pub axis: [f64; 3],
    /// One of its points \[m\]. Default: the origin of the object.
    #[serde(default, deserialize_with = "point")]
    pub origin: DVec3,
}

impl GrainSettings {
    /// `None` for a direction of no length.
    pub(super) fn grain(self) -> Option<Grain> {
        let direction = |v: [f64; 3]| DVec3::from_array(v).try_normalize().map(|v| v.as_vec3());
        Some(match self {
            Self::Straight(v) => Grain::Straight(direction(v)?),
            Self::Around(Around { axis, origin }) => Grain::Around { axis: direction(axis)?, origin: origin.as_vec3() },
        })
    }
}

/// `height`: the heights of a grey image.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeightSettings {
    /// The image, grey, of 8 or 16 bits.
    pub image: PathBuf,
    /// Height of white over black \[m\].
    #[serde(deserialize_with = "check::length")]
    pub depth: f64,
    /// Width of one image \[m\], repeated along the axes of the object. Default: by texture coordinates.
    #[serde(default, deserialize_with = "check::positive_length")]
    pub size: Option<f64>,
}

/// `finish`: the name of a process, or a table with its keys.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FinishSettings {
    /// The process.
    pub kind: FinishKind,
    /// Feed per revolution \[m\].
    pub feed: Option<f64>,
    /// Diameter of the tool \[m\].
    pub tool_diameter: Option<f64>,
    /// Width of a groove, or size of a bump \[m\].
    pub size: Option<f64>,
    /// Length of a groove \[m\].
    pub length: Option<f64>,
    /// Arithmetic mean deviation Ra \[m\].
    pub ra: Option<f64>,
    /// Seed of the height field.
    pub seed: u32,
}

/// A process of machining.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FinishKind {
    /// Face milling.
    Milled,
    /// Turning and facing.
    Turned,
    /// Grinding.
    Ground,
    /// Brushing.
    Brushed,
    /// Blasting with grains.
    Blasted,
    /// Casting.
    Cast,
}

impl<'de> Deserialize<'de> for FinishSettings {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Table {
            kind: FinishKind,
            #[serde(default, deserialize_with = "check::positive_length")]
            feed: Option<f64>,
            #[serde(default, deserialize_with = "check::positive_length")]
            tool_diameter: Option<f64>,
            #[serde(default, deserialize_with = "check::positive_length")]
            size: Option<f64>,
            #[serde(default, deserialize_with = "check::positive_length")]
            length: Option<f64>,
            #[serde(default, deserialize_with = "check::positive_length")]
            ra: Option<f64>,
            #[serde(default)]
            seed: u32,
        }
        struct FinishVisitor;
        impl<'de> Visitor<'de> for FinishVisitor {
            type Value = FinishSettings;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(
                    "the name of a finish, or a table such as { kind = \"milled\", feed = \"0.2mm\", ra = \"1.6um\" }",
                )
            }
            fn visit_str<E: Error>(self, name: &str) -> Result<FinishSettings, E> {
                let kind = FinishKind::deserialize(StrDeserializer::new(name))?;
                Ok(FinishSettings {
                    kind,
                    feed: None,
                    tool_diameter: None,
                    size: None,
                    length: None,
                    ra: None,
                    seed: 0,
                })
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<FinishSettings, A::Error> {
                let table = Table::deserialize(MapAccessDeserializer::new(map))?;
                let Table { kind, feed, tool_diameter, size, length, ra, seed } = table;
                Ok(FinishSettings { kind, feed, tool_diameter, size, length, ra, seed })
            }
        }
        d.deserialize_any(FinishVisitor)
    }
}

/// Largest Ra over the distance of the marks: slopes of cusps are 16 times as large, and heights cast no shadows.
const STEEPEST: f64 = 1.0 / 16.0;

/// Ra of a process, and the length of its marks: feed, width of a groove or size of a bump; middle values of handbooks
/// of machining, by process \[m\].
const fn usual(kind: FinishKind) -> (f64, f64) {
    match kind {
        FinishKind::Milled => (1.6e-6, 200e-6),
        FinishKind::Turned => (0.8e-6, 100e-6),
        FinishKind::Ground => (0.4e-6, 40e-6),
        FinishKind::Brushed => (0.8e-6, 100e-6),
        FinishKind::Blasted => (3e-6, 100e-6),
        FinishKind::Cast => (6e-6, 500e-6),
    }
}

impl FinishSettings {
    /// The finish on a surface with a grain. The error is a key with its problem and help.
    pub(super) fn finish(&self, grain: Option<Grain>) -> Result<Finish, [&'static str; 3]> {
        let (ra, mark) = usual(self.kind);
        let straight = || match grain {
            None => Ok(Vec3::X),
            Some(Grain::Straight(direction)) => Ok(direction),
            Some(Grain::Around { .. }) => {
                Err(["grain", "this finish runs in one direction", "write a direction, such as grain = [1, 0, 0]"])
            }
        };
        let (feed, size) = (self.feed.unwrap_or(mark) as f32, self.size.unwrap_or(mark) as f32);
        let foreign = |keys: &[(&str, bool)]| match keys.iter().find(|(_, given)| *given) {
            Some(("feed", _)) => {
                Err(["finish", "this finish has no feed", "remove `feed`; `size` is that of its marks"])
            }
            Some(("tool_diameter", _)) => Err(["finish", "this finish has no tool_diameter", "remove `tool_diameter`"]),
            Some(("size", _)) => {
                Err(["finish", "this finish has no size", "remove `size`; `feed` is the distance of its marks"])
            }
            Some(_) => Err(["finish", "this finish has no length", "remove `length`"]),
            None => Ok(()),
        };
        let (feed_key, tool) = (("feed", self.feed.is_some()), ("tool_diameter", self.tool_diameter.is_some()));
        let (size_key, length) = (("size", self.size.is_some()), ("length", self.length.is_some()));
        let process = match self.kind {
            FinishKind::Milled => {
                foreign(&[size_key, length])?;
                let radius = 0.5 * self.tool_diameter.unwrap_or(50e-3) as f32;
                Process::Milled { feed, radius, direction: straight()? }
            }
            FinishKind::Turned => {
                foreign(&[tool, size_key, length])?;
                let (axis, origin) = match grain {
                    Some(Grain::Around { axis, origin }) => (axis, origin),
                    None | Some(Grain::Straight(_)) => {
                        return Err([
                            "grain",
                            "turning runs about an axis",
                            "write its axis in the frame of the object, such as grain = { axis = [0, 1, 0] }",
                        ]);
                    }
                };
                Process::Turned { feed, axis, origin }
            }
            FinishKind::Ground | FinishKind::Brushed => {
                foreign(&[feed_key, tool])?;
                let length = self.length.unwrap_or(if self.kind == FinishKind::Ground { 3e-3 } else { 20e-3 });
                if length < f64::from(size) {
                    return Err(["finish", "the `length` of a groove is less than its `size`", "write a longer one"]);
                }
                Process::Grooved { width: size, length: length as f32, direction: straight()? }
            }
            FinishKind::Blasted | FinishKind::Cast => {
                foreign(&[feed_key, tool, length])?;
                Process::Grained { size }
            }
        };
        let (ra, mark) = (self.ra.unwrap_or(ra), self.feed.or(self.size).unwrap_or(mark));
        if ra > STEEPEST * mark {
            let help = "write a smaller `ra`, such as \"1.6um\", or a larger distance of the marks";
            return Err(["finish", "`ra` is more than a sixteenth of `feed` or `size`: slopes of 45 degrees", help]);
        }
        Ok(Finish { process, mean_deviation: ra as f32, seed: u64::from(self.seed) })
    }
}
