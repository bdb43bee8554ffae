//! The description of a defect, its place, and the reason why it cannot be made.

use dunkelfeld_geometry::DVec3;
use dunkelfeld_radiometry::Rgb;
use serde::Deserialize;

/// Kind of a defect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum DefectKind {
    /// A narrow groove.
    Scratch,
    /// A shallow round hollow.
    Dent,
    /// A coloured film with an irregular outline and a soft edge.
    Stain,
    /// An irregular particle on the surface.
    Dust,
    /// A thin curved fibre on the surface.
    Fibre,
    /// A sphere of gas inside a clear solid.
    Bubble,
    /// An irregular opaque particle inside a clear solid.
    Inclusion,
    /// The object is absent.
    Missing,
    /// The object covers only a part of the light, like a worn print.
    Faded,
    /// The object lies beside its place.
    Shifted,
}

impl DefectKind {
    /// All kinds by their names in a study.
    pub(crate) const NAMES: [&str; 10] =
        ["scratch", "dent", "stain", "dust", "fibre", "bubble", "inclusion", "missing", "faded", "shifted"];

    /// True if the defect is a change of an object, and adds none.
    pub(crate) fn is_change(self) -> bool {
        matches!(self, Self::Missing | Self::Faded | Self::Shifted)
    }

    /// The keys that the kind needs.
    pub(crate) fn required(self) -> &'static [&'static str] {
        match self {
            Self::Scratch => &["length", "width", "depth"],
            Self::Dent => &["length", "depth"],
            Self::Fibre => &["length", "width"],
            Self::Stain | Self::Dust | Self::Bubble | Self::Inclusion | Self::Shifted => &["length"],
            Self::Missing | Self::Faded => &[],
        }
    }

    /// The keys of a study that this kind uses, beside those of all kinds.
    pub(crate) fn keys(self) -> &'static [&'static str] {
        match self {
            Self::Scratch => {
                &["length", "width", "depth", "angle", "curvature", "roughness", "color", "metallic", "facing"]
            }
            Self::Dent => &["length", "depth", "roughness", "color", "metallic", "facing"],
            Self::Stain => &["length", "roughness", "color", "metallic", "strength", "facing"],
            Self::Dust => &["length", "roughness", "color", "metallic", "facing"],
            Self::Fibre => &["length", "width", "angle", "curvature", "roughness", "color", "metallic", "facing"],
            Self::Bubble => &["length", "roughness"],
            Self::Inclusion => &["length", "roughness", "color", "metallic"],
            Self::Missing => &[],
            Self::Faded => &["strength"],
            Self::Shifted => &["length", "angle"],
        }
    }
}

/// One defect with all its parameters drawn.
#[derive(Clone, Debug)]
pub(crate) struct DefectSpec {
    /// Name of the added object. For missing, faded and shifted: the name of the object that changes after all defects
    /// of the image are made.
    pub(crate) name: String,
    /// Kind of the defect.
    pub(crate) kind: DefectKind,
    /// Indices into [`SceneBuilder::instances`](dunkelfeld_scene::SceneBuilder::instances): the candidates.
    ///
    /// A point of the surface is drawn uniformly by area in the world over all of them. For bubble and inclusion a
    /// point is drawn uniformly by volume over their clear solids, and drawn again if the defect has no room there. For
    /// missing, faded and shifted one object is drawn, each with the same probability.
    pub(crate) on: Vec<usize>,
    /// Length \[m\]. The table of the module contains its meaning for each kind.
    pub(crate) length: f64,
    /// Width \[m\].
    pub(crate) width: f64,
    /// Depth \[m\].
    pub(crate) depth: f64,
    /// Direction in the tangent plane \[rad\], counter-clockwise from outside. Zero is the world's +x projected on this
    /// plane, or +z if the normal is within 18 degrees of the x axis. For shifted, zero is an edge of the largest side
    /// of the bounding box. `None`: drawn uniformly.
    pub(crate) angle: Option<f64>,
    /// Total turn \[rad\] of a scratch or a fibre over its length.
    pub(crate) curvature: f64,
    /// Perceptual roughness in \[0, 1\]. `None`: by kind and by the surface below.
    pub(crate) roughness: Option<f64>,
    /// Base colour, linear Rec. 709, in \[0, 1\]. `None`: by kind and by the surface below. A bubble, and a scratch or
    /// a dent in a clear solid, have no colour.
    pub(crate) color: Option<Rgb>,
    /// 0 dielectric, 1 metal. `None`: by kind and by the surface below. The kinds without colour do not use it.
    pub(crate) metallic: Option<f64>,
    /// In \[0, 1\]. Stain: the largest coverage. Faded: the missing part of the coverage.
    pub(crate) strength: f64,
    /// Only points whose normal, by the winding of the triangle, has a cosine of at least 0.5 (60 degrees) with this
    /// direction in the world. `None`: any.
    pub(crate) facing: Option<DVec3>,
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

/// The reason why a defect cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{problem}; {help}")]
pub(crate) struct DefectProblem {
    /// The problem.
    pub(crate) problem: String,
    /// Advice.
    pub(crate) help: &'static str,
    /// The key of the study with the value at fault.
    pub(crate) key: Option<&'static str>,
}

impl DefectProblem {
    pub(super) fn new(problem: impl Into<String>, help: &'static str) -> Self {
        Self { problem: problem.into(), help, key: None }
    }

    /// The same problem, at a key of the study.
    pub(super) fn at(self, key: &'static str) -> Self {
        Self { key: Some(key), ..self }
    }
}
