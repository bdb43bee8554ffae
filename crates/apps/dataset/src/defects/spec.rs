//! The description of a defect, and its place.

use crate::distribution::{Fault, read};
use dunkelfeld_geometry::DVec3;
use dunkelfeld_io::names::nearest_names;
use dunkelfeld_io::quantity::{Angle, Length};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::Image;
use serde::Deserialize;
use toml::Table;

/// A size \[m\] of at least 1 nm: smaller bodies lose their shape in f32.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Length")]
pub(crate) struct Size(pub(crate) f64);

impl TryFrom<Length> for Size {
    type Error = String;

    fn try_from(Length(size): Length) -> Result<Self, String> {
        let is_size = (1e-9..f64::INFINITY).contains(&size);
        is_size.then_some(Self(size)).ok_or_else(|| format!("{size} m is no size; give one above 0, at least 1 nm"))
    }
}

/// A number from 0 to 1.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "f64")]
pub(crate) struct Share(pub(crate) f64);

impl TryFrom<f64> for Share {
    type Error = String;

    fn try_from(v: f64) -> Result<Self, String> {
        (0.0..=1.0)
            .contains(&v)
            .then_some(Self(v))
            .ok_or_else(|| format!("{v} is out of range; give a number from 0 to 1"))
    }
}

/// A colour, linear Rec. 709: three channels, or one number for all of them.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged, expecting = "not a colour; write three numbers from 0 to 1, or one for all three")]
pub(crate) enum Color {
    Gray(Share),
    Channels([Share; 3]),
}

impl Color {
    fn rgb(self) -> Rgb {
        let [r, g, b] = match self {
            Self::Gray(value) => [value; 3],
            Self::Channels(channels) => channels,
        };
        Rgb::new(r.0 as f32, g.0 as f32, b.0 as f32)
    }
}

/// A unit direction in the world.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "[f64; 3]")]
pub(crate) struct Direction(DVec3);

impl TryFrom<[f64; 3]> for Direction {
    type Error = String;

    fn try_from(vector: [f64; 3]) -> Result<Self, String> {
        let unit = DVec3::from(vector).try_normalize().filter(|unit| unit.is_finite());
        unit.map(Self).ok_or_else(|| "the direction has no length; give a vector other than 0".into())
    }
}

/// What the values of a picture are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum DecalMode {
    /// The share of the surface that is covered, linear, from the first channel.
    Mask,
    /// The colour, sRGB.
    Color,
    /// The roughness, linear, from the first channel.
    Roughness,
    /// The height, linear, from the first channel.
    Height,
}

/// Declares the kinds of defects, each with its own keys.
///
/// `length`, `width` and `depth` are those of the table of the module. `angle` is a direction in the tangent plane,
/// counter-clockwise from outside; zero is the world's +x projected on this plane, or +z if the normal is within 18 degrees of
/// the x axis. Without it the direction is drawn uniformly. `curvature` is the total turn over the length. `roughness`,
/// `color` and `metallic` are by kind and by the surface below, unless they are given. With `facing`, only points count whose
/// normal, by the winding of the triangle, is within 60 degrees of this direction.
macro_rules! kinds {
    ($($(#[$doc:meta])* $kind:ident $name:literal { $($key:ident: $type:ty),* })*) => {
        $($(#[$doc])*
        #[derive(Clone, Debug, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub(crate) struct $kind {
            $(pub(crate) $key: $type,)*
        })*

        /// A defect with all its values drawn.
        #[derive(Clone, Debug)]
        pub(crate) enum Defect {
            $($kind($kind),)*
        }

        impl Defect {
            /// Reads the keys of a kind.
            ///
            /// # Errors
            /// A kind that does not exist, a key that the kind does not have or lacks, and a value out of its range.
            pub(crate) fn read(kind: &str, keys: &Table) -> Result<Self, Fault> {
                match kind {
                    $($name => read(keys).map(Self::$kind),)*
                    _ => Err(unknown(kind, &[$($name),*])),
                }
            }
        }
    };
}

kinds! {
    /// A narrow groove. `burr` is the height of the burrs beside it over its depth, by default 1.
    Scratch "scratch" {
        length: Size, width: Size, depth: Size, angle: Option<Angle>, curvature: Option<Angle>, burr: Option<Share>,
        roughness: Option<Share>, color: Option<Color>, metallic: Option<Share>, facing: Option<Direction>
    }
    /// A shallow round hollow.
    Dent "dent" {
        length: Size, depth: Size,
        roughness: Option<Share>, color: Option<Color>, metallic: Option<Share>, facing: Option<Direction>
    }
    /// A pit with steep walls and an irregular outline, as gas leaves in castings.
    Pore "pore" {
        length: Size, depth: Size,
        roughness: Option<Share>, color: Option<Color>, metallic: Option<Share>, facing: Option<Direction>
    }
    /// A break of an edge. `depth` is below the edge, in its middle.
    Chip "chip" {
        length: Size, depth: Size,
        roughness: Option<Share>, color: Option<Color>, metallic: Option<Share>, facing: Option<Direction>
    }
    /// Waves that a vibrating tool leaves. `depth` is from crest to valley, and `angle` is the direction from wave to wave.
    Chatter "chatter" {
        length: Size, pitch: Size, depth: Size, angle: Option<Angle>,
        roughness: Option<Share>, color: Option<Color>, metallic: Option<Share>, facing: Option<Direction>
    }
    /// A seam between two fronts of metal that met too cold to join: a narrow groove between rounded lips.
    ColdShut "cold_shut" {
        length: Size, width: Size, depth: Size, angle: Option<Angle>, curvature: Option<Angle>,
        roughness: Option<Share>, color: Option<Color>, metallic: Option<Share>, facing: Option<Direction>
    }
    /// A coloured film with an irregular outline and a soft edge. `strength` is the largest coverage, by default 1.
    Stain "stain" {
        length: Size, strength: Option<Share>,
        roughness: Option<Share>, color: Option<Color>, metallic: Option<Share>, facing: Option<Direction>
    }
    /// A picture on the surface. `length` is that of its rows, `depth` the height of white, and `strength` its opacity, by default 1.
    Decal "decal" {
        image: String, mode: DecalMode, length: Size, depth: Option<Size>, strength: Option<Share>, angle: Option<Angle>,
        roughness: Option<Share>, color: Option<Color>, metallic: Option<Share>, facing: Option<Direction>
    }
    /// An irregular particle on the surface.
    Dust "dust" {
        length: Size,
        roughness: Option<Share>, color: Option<Color>, metallic: Option<Share>, facing: Option<Direction>
    }
    /// A thin curved fibre on the surface.
    Fibre "fibre" {
        length: Size, width: Size, angle: Option<Angle>, curvature: Option<Angle>,
        roughness: Option<Share>, color: Option<Color>, metallic: Option<Share>, facing: Option<Direction>
    }
    /// A sphere of gas inside a clear solid.
    Bubble "bubble" { length: Size, roughness: Option<Share> }
    /// An irregular opaque particle inside a clear solid.
    Inclusion "inclusion" { length: Size, roughness: Option<Share>, color: Option<Color>, metallic: Option<Share> }
    /// The object is absent.
    Missing "missing" {}
    /// The object covers only a part of the light, like a worn print. `strength` is the missing part, by default 1.
    Faded "faded" { strength: Option<Share> }
    /// The object lies beside its place. Zero of `angle` is an edge of the largest side of the bounding box.
    Shifted "shifted" { length: Size, angle: Option<Angle> }
}

fn unknown(kind: &str, known: &[&str]) -> Fault {
    let list = known.join(", ");
    let help = match nearest_names(kind, known.iter().copied()).first() {
        Some(near) => format!("did you mean \"{near}\"? The kinds are {list}"),
        None => format!("the kinds are {list}"),
    };
    Fault::new(format!("there is no kind \"{kind}\" of defects"), help).below("kind")
}

/// The changes of a material that a defect has.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Finish<'a> {
    /// Name of the material.
    pub(crate) name: &'a str,
    pub(crate) roughness: Option<f32>,
    pub(crate) color: Option<Rgb>,
    /// 0 dielectric, 1 metal.
    pub(crate) metallic: Option<f32>,
}

impl Defect {
    /// The surfaces that it lies on.
    pub(crate) fn facing(&self) -> Option<DVec3> {
        match self {
            Self::Scratch(Scratch { facing, .. })
            | Self::Dent(Dent { facing, .. })
            | Self::Pore(Pore { facing, .. })
            | Self::Chip(Chip { facing, .. })
            | Self::Chatter(Chatter { facing, .. })
            | Self::ColdShut(ColdShut { facing, .. })
            | Self::Stain(Stain { facing, .. })
            | Self::Decal(Decal { facing, .. })
            | Self::Dust(Dust { facing, .. })
            | Self::Fibre(Fibre { facing, .. }) => facing.map(|Direction(facing)| facing),
            _ => None,
        }
    }

    /// Its material, with the name of the defect.
    pub(crate) fn finish<'a>(&self, name: &'a str) -> Finish<'a> {
        let (roughness, color, metallic) = match self {
            Self::Scratch(Scratch { roughness, color, metallic, .. })
            | Self::Dent(Dent { roughness, color, metallic, .. })
            | Self::Pore(Pore { roughness, color, metallic, .. })
            | Self::Chip(Chip { roughness, color, metallic, .. })
            | Self::Chatter(Chatter { roughness, color, metallic, .. })
            | Self::ColdShut(ColdShut { roughness, color, metallic, .. })
            | Self::Stain(Stain { roughness, color, metallic, .. })
            | Self::Decal(Decal { roughness, color, metallic, .. })
            | Self::Dust(Dust { roughness, color, metallic, .. })
            | Self::Fibre(Fibre { roughness, color, metallic, .. })
            | Self::Inclusion(Inclusion { roughness, color, metallic, .. }) => (*roughness, *color, *metallic),
            Self::Bubble(Bubble { roughness, .. }) => (*roughness, None, None),
            Self::Missing(_) | Self::Faded(_) | Self::Shifted(_) => (None, None, None),
        };
        let number = |share: Option<Share>| share.map(|Share(v)| v as f32);
        Finish { name, roughness: number(roughness), color: color.map(Color::rgb), metallic: number(metallic) }
    }

    /// # Errors
    /// Sizes that do not fit each other.
    pub(crate) fn check(&self) -> Result<(), Fault> {
        let too_wide = |length: &Size, width: &Size| {
            (width.0 > length.0)
                .then(|| Fault::new("the defect is wider than long", "exchange `length` and `width`").below("width"))
        };
        let too_deep =
            |is_deep: bool, problem: &str, help: &str| is_deep.then(|| Fault::new(problem, help).below("depth"));
        let half = "give at most half of the width, which is a slope of 69 degrees";
        let fault = match self {
            Self::Scratch(Scratch { length, width, depth, .. })
            | Self::ColdShut(ColdShut { length, width, depth, .. }) => too_wide(length, width)
                .or_else(|| too_deep(depth.0 > 0.5 * width.0, "the groove is too deep for its width", half)),
            Self::Dent(Dent { length, depth, .. }) => {
                let help = "give at most a quarter of the diameter, which is a slope of 38 degrees";
                too_deep(depth.0 > 0.25 * length.0, "the dent is too deep for its diameter", help)
            }
            Self::Chip(Chip { length, depth, .. }) if depth.0 < 0.02 * length.0 => {
                too_deep(true, "the chip is too shallow for its length", "give at least a fiftieth of the length")
            }
            Self::Pore(Pore { length, depth, .. }) | Self::Chip(Chip { length, depth, .. }) => {
                too_deep(depth.0 > 0.5 * length.0, "it is too deep for its length", "give at most half of the length")
            }
            Self::Chatter(Chatter { length, pitch, depth, .. }) => {
                let help = "give at most a fifth of the pitch, which is a slope of 32 degrees";
                let is_wave = (1.0..=25.0).contains(&(length.0 / pitch.0));
                let no_wave = Fault::new("the pitch does not fit the length", "give 1 to 25 waves").below("pitch");
                (!is_wave)
                    .then_some(no_wave)
                    .or_else(|| too_deep(depth.0 > 0.2 * pitch.0, "the marks are too deep for their pitch", help))
            }
            Self::Fibre(Fibre { length, width, .. }) => too_wide(length, width),
            Self::Decal(Decal { mode, depth, strength, .. }) => {
                let is_height = *mode == DecalMode::Height;
                let help = "heights have a `depth` and no `strength`, other decals no `depth`";
                let is_wrong = is_height != depth.is_some() || is_height && strength.is_some();
                is_wrong.then(|| Fault::new("the keys do not fit the mode of the decal", help).below("mode"))
            }
            _ => None,
        };
        fault.map_or(Ok(()), Err)
    }
}

/// A defect to add.
#[derive(Clone, Debug)]
pub(crate) struct DefectSpec {
    /// Name of the added object. For missing, faded and shifted: the name of the object that changes after all defects
    /// of the image are made.
    pub(crate) name: String,
    /// Indices into [`SceneBuilder::instances`](dunkelfeld_scene::SceneBuilder::instances): the candidates, at least one.
    ///
    /// A point of the surface is drawn uniformly by area in the world over all of them. For bubble and inclusion a
    /// point is drawn uniformly by volume over their clear solids, and drawn again if the defect has no room there. For
    /// missing, faded and shifted one object is drawn, each with the same probability.
    pub(crate) on: Vec<usize>,
    pub(crate) defect: Defect,
    /// The picture of a decal.
    pub(crate) image: Option<Image>,
}

/// A defect in its place.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PlacedDefect {
    /// Name of the object.
    pub(crate) object: String,
    /// Place in the world at time 0 \[m\]: the drawn point. For missing, faded and shifted the middle of the bounds of
    /// the object after the change.
    pub(crate) at: DVec3,
    /// Unit normal of the surface there, in the world at time 0. Bubble and inclusion have no surface, and have +y. For
    /// missing, faded and shifted the normal of the largest side of the bounding box.
    pub(crate) normal: DVec3,
    /// Name of the object below, or around. For missing, faded and shifted the former name of the object.
    pub(crate) on: String,
    /// Its index in [`SceneBuilder::instances`](dunkelfeld_scene::SceneBuilder::instances).
    pub(crate) host: usize,
    /// Largest extent \[m\].
    pub(crate) extent: f64,
    /// Direction in the tangent plane \[rad\], drawn or given. `None` if the kind has none.
    pub(crate) angle: Option<f64>,
    /// Of a changed object: were all of its materials smooth and clear?
    pub(crate) is_clear: bool,
    /// The material of the part of the host that has a hole, which the defect fills.
    pub(crate) replaces: Option<usize>,
}
