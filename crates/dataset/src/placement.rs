//! `[[study.place]]`: objects at drawn places that keep apart.

use crate::distribution::Fault;
use crate::draws::{Draws, uniform};
use crate::study::Names;
use dunkelfeld_geometry::{DAffine3, DQuat, DVec3};
use dunkelfeld_io::quantity::{Angle, Length};
use dunkelfeld_sampling::Pcg;
use dunkelfeld_scene::SceneBuilder;
use serde::Deserialize;
use std::collections::BTreeMap;
use toml::Value;

/// Places that are tried for an object before the placement is given up.
const TRIES: u32 = 2000;

/// One entry, with all values drawn.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Placement {
    /// Names or patterns of the objects.
    objects: Names,
    /// Centre of the region \[m\], world axes.
    center: [Length; 3],
    /// Edges of the region along x, y and z \[m\]. With a height of 0 the objects rest on a plane.
    size: [Length; 3],
    /// Range of the rotation about the vertical through the centre of the object: from minus half of it to plus half of it.
    #[serde(default)]
    turn: Option<Angle>,
    /// Least distance between the objects that are placed \[m\]. Default 0.
    #[serde(default)]
    clearance: Option<Length>,
    /// May objects that are placed overlap? Default false.
    #[serde(default)]
    overlap: bool,
}

/// A vertical cylinder around an object that was placed.
#[derive(Clone, Copy, Debug)]
struct Occupied {
    center: DVec3,
    radius: f64,
    /// Half of the height.
    half: f64,
}

impl Placement {
    pub(crate) fn parse(value: Value) -> Result<Self, Fault> {
        let placement: Self =
            value.try_into().map_err(|e: toml::de::Error| Fault::new(e.message(), "see docs/datasets.md"))?;
        let edges = placement.size.map(|l| l.0);
        let numbers =
            placement.center.iter().chain(&placement.size).map(|l| l.0).chain(placement.clearance.map(|c| c.0));
        if numbers.chain(placement.turn.map(|t| t.0)).any(|v| !v.is_finite()) {
            return Err(Fault::new("a number of the placement is not finite", "write lengths and angles"));
        }
        if edges.iter().any(|edge| *edge < 0.0) {
            return Err(Fault::new("an edge of the region is below zero", "write lengths from 0 up").below("size"));
        }
        if placement.clearance.is_some_and(|c| c.0 < 0.0) {
            return Err(Fault::new("the distance is below zero", "write a length from 0 up").below("clearance"));
        }
        Ok(placement)
    }

    /// Moves the objects. An object lies in the region with its whole bounds, which rest on the drawn height; two of them
    /// never share a part of the vertical cylinders around their bounds. `drawn` receives position and rotation.
    pub(crate) fn apply(
        &self,
        scene: &mut SceneBuilder,
        draws: Draws,
        drawn: &mut BTreeMap<String, Value>,
    ) -> Result<(), Fault> {
        let found: Vec<usize> =
            (0..scene.instances.len()).filter(|i| self.objects.match_name(&scene.instances[*i].name)).collect();
        if found.is_empty() {
            return Err(
                Fault::new("no object has such a name", "`dunkelfeld inspect` lists the objects").below("objects")
            );
        }
        let mut occupied: Vec<Occupied> = Vec::new();
        for i in found {
            let name = scene.instances[i].name.clone();
            let mut stream = draws.stream(&format!("place[{name}]"));
            let Some([low, high]) = scene.bounds_of(&scene.instances[i]) else { continue };
            let center = (low + high) * 0.5;
            let shape =
                Occupied { center, radius: 0.5 * (high - low).with_y(0.0).length(), half: 0.5 * (high.y - low.y) };
            let (placed, angle) = self.find(shape, &occupied, &mut stream).ok_or_else(|| {
                let problem = format!("\"{name}\" finds no place after {TRIES} tries");
                Fault::new(problem, "use a larger region, fewer objects or a smaller clearance").below("size")
            })?;
            occupied.push(placed);
            let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_y(angle), placed.center);
            let object = &mut scene.instances[i];
            object.to_world = turned * DAffine3::from_translation(-center) * object.to_world;
            for (axis, length) in ["x", "y", "z"].iter().zip((placed.center - center).to_array()) {
                drawn.insert(format!("place[{name}].{axis}"), Value::String(format!("{}mm", length * 1e3)));
            }
            drawn.insert(format!("place[{name}].turn"), Value::String(format!("{}deg", angle.to_degrees())));
        }
        Ok(())
    }

    fn find(&self, shape: Occupied, occupied: &[Occupied], stream: &mut Pcg) -> Option<(Occupied, f64)> {
        let half_size = DVec3::from(self.size.map(|l| 0.5 * l.0));
        let middle = DVec3::from(self.center.map(|l| l.0));
        // Horizontally the cylinder lies in the region; vertically the bottom does.
        let room = DVec3::new(half_size.x - shape.radius, half_size.y, half_size.z - shape.radius);
        if room.x < 0.0 || room.z < 0.0 {
            return None;
        }
        let clearance = self.clearance.map_or(0.0, |c| c.0);
        for _ in 0..TRIES {
            let place = [(); 3].map(|()| 2.0 * uniform(stream) - 1.0);
            let angle = self.turn.map_or(0.0, |turn| turn.0 * (uniform(stream) - 0.5));
            let bottom = middle + DVec3::from(place) * room;
            let at = Occupied { center: bottom + DVec3::Y * shape.half, ..shape };
            let is_free = |other: &Occupied| {
                let between = at.center - other.center;
                between.with_y(0.0).length() >= at.radius + other.radius + clearance
                    || between.y.abs() >= at.half + other.half + clearance
            };
            if self.overlap || occupied.iter().all(is_free) {
                return Some((at, angle));
            }
        }
        None
    }
}
