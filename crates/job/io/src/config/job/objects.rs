//! `[[object]]` of a job: objects that are removed, moved, copied, given another material, or made.

use super::check::{self, yes};
use super::motion::{self, RotationSettings};
use super::place::{self, Place};
use super::primitives::Primitive;
use crate::toml_keys::keys_of;
use dunkelfeld_geometry::{DAffine3, DQuat, DVec3};
use serde::Deserialize;
use serde::de::{Deserializer, Error};

/// Most objects of a scene with copies. A million take about half a gigabyte beside their meshes, which copies share.
pub(super) const MOST_OBJECTS: u64 = 1_000_000;

/// `[[object]]`: changes of objects of the scene, or a new one. The entries apply in their order, after the import and
/// before `[[material]]` and `[[light]]`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectOverride {
    /// Name of objects of the scene, or a pattern with `*` and `?`. With `kind`: the name of the new object.
    pub name: String,
    /// Makes a new object of this shape around the origin.
    #[serde(skip)]
    pub shape: Option<Primitive>,
    /// `false` removes the objects, from the labels too; with `kind` the object is not made. Default true.
    #[serde(default = "yes")]
    pub visible: bool,
    /// Translation \[m\] in the world, after rotation and scale.
    #[serde(default, deserialize_with = "place::optional_point")]
    pub translate: Option<DVec3>,
    /// Rotation about the pivot, after the scale: an axis of the world and an angle, or three angles about the fixed axes
    /// x, y and z of the world, in this order.
    #[serde(default, deserialize_with = "place::rotation")]
    pub rotate: Option<DQuat>,
    /// Scale about the pivot along the axes of the world: one factor, or three.
    #[serde(default, deserialize_with = "place::scale")]
    pub scale: Option<DVec3>,
    /// Instead of the three: an affine map of the world about the pivot, 16 numbers row by row.
    #[serde(default, deserialize_with = "place::matrix")]
    pub matrix: Option<DAffine3>,
    /// Fixed point of rotation and scale. Default: the origin of the world.
    #[serde(default)]
    pub pivot: Pivot,
    /// Name of a material of the scene or of a `[[material]]` with `new = true`, for all parts of the objects.
    pub material: Option<String>,
    /// Radius \[m\] of the fillets of sharp convex edges; 0 leaves them sharp.
    #[serde(default, deserialize_with = "check::length_or_zero")]
    pub edge_radius: Option<f64>,
    /// Copies, each moved from the place of the object. They replace it.
    pub instances: Option<Vec<Placement>>,
    /// Copies on a grid whose first point is the place of the object. They replace it.
    pub grid: Option<Grid>,
    /// Velocity \[m/s\] in the world; written as `["200mm/s", 0, 0]`.
    #[serde(default, deserialize_with = "motion::velocity")]
    pub velocity: Option<DVec3>,
    /// Rotation at a constant speed about an axis of the world.
    pub rotation: Option<RotationSettings>,
}

/// The place of a copy, relative to the object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Placement {
    /// Translation \[m\].
    #[serde(deserialize_with = "place::optional_point")]
    pub translate: Option<DVec3>,
    /// Rotation about the pivot.
    #[serde(deserialize_with = "place::rotation")]
    pub rotate: Option<DQuat>,
    /// Scale about the pivot.
    #[serde(deserialize_with = "place::scale")]
    pub scale: Option<DVec3>,
}

/// Copies on a grid.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Copies along x, y and z, 1 or more each; at most 1 000 000 together.
    #[serde(deserialize_with = "count")]
    pub count: [u32; 3],
    /// Distance \[m\] of neighbours along x, y and z.
    #[serde(deserialize_with = "place::point")]
    pub step: DVec3,
}

/// The fixed point of rotation and scale.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Pivot {
    /// The origin of the world.
    #[default]
    Origin,
    /// The centre of the bounds of each object.
    Center,
    /// A point, or the centre of other objects.
    At(Place),
}

impl<'de> Deserialize<'de> for Pivot {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        Ok(match Place::deserialize(d)? {
            Place::Object(name) if name == "origin" => Self::Origin,
            Place::Object(name) if name == "center" => Self::Center,
            place => Self::At(place),
        })
    }
}

fn count<'de, D: Deserializer<'de>>(d: D) -> Result<[u32; 3], D::Error> {
    let counts = place::three::<check::Count, D>(d, "three whole numbers such as [4, 1, 3]")?.map(|c| c.0);
    let all: u64 = counts.iter().map(|c| u64::from(*c)).product();
    if all <= MOST_OBJECTS {
        return Ok(counts);
    }
    Err(D::Error::custom(format!("{all} copies are too many; write at most {MOST_OBJECTS} together")))
}

impl Placement {
    /// The map of the world about a fixed point.
    pub(super) fn about(&self, pivot: DVec3) -> DAffine3 {
        let linear = DAffine3::from_scale_rotation_translation(
            self.scale.unwrap_or(DVec3::ONE),
            self.rotate.unwrap_or(DQuat::IDENTITY),
            DVec3::ZERO,
        );
        about(linear, pivot, self.translate.unwrap_or(DVec3::ZERO))
    }

    pub(super) fn has_fixed_point(&self) -> bool {
        self.rotate.is_some() || self.scale.is_some()
    }
}

pub(super) fn about(map: DAffine3, pivot: DVec3, translate: DVec3) -> DAffine3 {
    DAffine3::from_translation(pivot + translate) * map * DAffine3::from_translation(-pivot)
}

/// The keys of `[[object]]`, of all kinds.
pub fn object_keys() -> Vec<&'static str> {
    let mut keys = Primitive::keys().concat();
    keys.extend(keys_of::<ObjectOverride>());
    keys
}

impl ObjectOverride {
    pub(super) fn instances(&self) -> &[Placement] {
        self.instances.as_deref().unwrap_or_default()
    }

    pub(super) fn placement(&self) -> Placement {
        Placement { translate: self.translate, rotate: self.rotate, scale: self.scale }
    }

    /// The number of copies of an object; `None` without copies.
    pub(super) fn copies(&self) -> Option<u64> {
        match self.grid {
            Some(grid) => Some(grid.count.iter().map(|c| u64::from(*c)).product()),
            None => self.instances.as_ref().map(|copies| copies.len() as u64),
        }
    }

    /// The maps of all copies, from the place of the object.
    pub(super) fn copy_maps(&self, pivot: DVec3) -> Vec<DAffine3> {
        let Some(Grid { count: [nx, ny, nz], step }) = self.grid else {
            return self.instances().iter().map(|copy| copy.about(pivot)).collect();
        };
        let at = |x: u32, y: u32, z: u32| step * DVec3::new(f64::from(x), f64::from(y), f64::from(z));
        let points = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| at(x, y, z))));
        points.map(DAffine3::from_translation).collect()
    }
}
