//! `[[study.place]]`: objects at drawn places that keep apart.

use crate::distribution::{Fault, Template, read};
use crate::draws::{Draws, uniform};
use crate::label_entry::Names;
use crate::names::ObjectNames;
use crate::study::Study;
use dunkelfeld_geometry::{DAffine3, DQuat, DVec3};
use dunkelfeld_io::quantity::{Angle, Length};
use dunkelfeld_sampling::Pcg;
use dunkelfeld_scene::SceneBuilder;
use serde::Deserialize;
use std::collections::BTreeMap;
use toml::Value;

/// Places that are tried for an object before all objects of the entry are drawn again.
const TRIES: u32 = 2000;
/// The same after the first time.
const LATER_TRIES: u32 = 200;
/// The objects of an entry are drawn so many times before the placement is given up.
const ATTEMPTS: u32 = 1000;

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
    /// Default 0.
    turn: Option<Angle>,
    /// Least distance between the objects that are placed \[m\]. Default 0.
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
        let placement: Self = read(&value.as_table().cloned().unwrap_or_default())?;
        placement.objects.check("objects")?;
        let finite = placement.center.iter().map(|l| l.0).chain(placement.turn.map(|t| t.0));
        if !finite.into_iter().all(f64::is_finite) {
            return Err(Fault::new("a number of the placement is not finite", "write lengths and angles"));
        }
        for (key, lengths) in [("size", placement.size.to_vec()), ("clearance", Vec::from_iter(placement.clearance))] {
            if lengths.iter().any(|length| !(0.0..f64::INFINITY).contains(&length.0)) {
                return Err(Fault::new("a length is below zero, or not finite", "write lengths from 0 up").below(key));
            }
        }
        Ok(placement)
    }

    /// An entry of a study, drawn for an image. `drawn` receives the draws.
    pub(crate) fn drawn(
        study: &Study,
        number: usize,
        index: u64,
        drawn: &mut BTreeMap<String, Value>,
    ) -> Result<Self, Fault> {
        let draws = study.draws(index);
        let mut record = |name: &str, value: &Value| drop(drawn.insert(name.to_owned(), value.clone()));
        let value =
            study.place[number].draw(draws, &format!("place[{number}]"), &mut study.named(draws), &mut record)?;
        Self::parse(value)
    }

    /// Checks the entries of a study before the first image: their keys, and that an image has their objects.
    ///
    /// # Errors
    /// The number of the entry, and the fault.
    pub(crate) fn check(study: &Study, names: &mut ObjectNames<'_>) -> Result<(), (usize, Fault)> {
        for number in 0..study.place.len() {
            let at = |fault: Fault| (number, fault);
            let placement = Self::drawn(study, number, 0, &mut BTreeMap::new()).map_err(at)?;
            let own = match &study.place[number] {
                Template::Table(keys) => keys.get("objects").map(Template::texts),
                _ => None,
            };
            let patterns = own.into_iter().flatten().chain(placement.objects.patterns().to_vec());
            names.check(patterns).map_err(|fault| at(fault.below("objects")))?;
        }
        Ok(())
    }

    /// Moves the objects. An object lies in the region with its whole bounds, which rest on the drawn height; two of them
    /// never share a part of the vertical cylinders around their bounds. `drawn` receives the position and the
    /// rotation.
    pub(crate) fn apply(
        &self,
        scene: &mut SceneBuilder,
        draws: Draws,
        drawn: &mut BTreeMap<String, Value>,
    ) -> Result<(), Fault> {
        let found: Vec<usize> =
            (0..scene.instances.len()).filter(|i| self.objects.match_name(&scene.instances[*i].name)).collect();
        // The object and its cylinder.
        let mut shapes: Vec<(usize, Occupied)> = Vec::new();
        for i in found {
            let Some([low, high]) = scene.bounds_of(&scene.instances[i]) else { continue };
            let center = (low + high) * 0.5;
            let shape =
                Occupied { center, radius: 0.5 * (high - low).with_y(0.0).length(), half: 0.5 * (high.y - low.y) };
            shapes.push((i, shape));
        }
        let named: Vec<(&str, Occupied)> =
            shapes.iter().map(|(i, shape)| (scene.instances[*i].name.as_str(), *shape)).collect();
        let places = self.arrange(&named, draws)?;
        for ((i, shape), (placed, angle)) in shapes.into_iter().zip(places) {
            let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_y(angle), placed.center);
            let object = &mut scene.instances[i];
            object.to_world = turned * DAffine3::from_translation(-shape.center) * object.to_world;
            let name = &object.name;
            for (axis, length) in ["x", "y", "z"].iter().zip((placed.center - shape.center).to_array()) {
                drawn.insert(format!("place[{name}].{axis}"), Value::String(format!("{}mm", length * 1e3)));
            }
            drawn.insert(format!("place[{name}].turn"), Value::String(format!("{}deg", angle.to_degrees())));
        }
        Ok(())
    }

    /// The places and the rotations of objects, by their names. If an object finds no place beside those before it, all
    /// of them are drawn again.
    fn arrange(&self, shapes: &[(&str, Occupied)], draws: Draws) -> Result<Vec<(Occupied, f64)>, Fault> {
        let mut last = "";
        for attempt in 0..ATTEMPTS {
            let (mut occupied, mut places) = (Vec::new(), Vec::new());
            for (name, shape) in shapes {
                let (key, tries) = match attempt {
                    0 => (format!("place[{name}]"), TRIES),
                    n => (format!("place[{name}] again {n}"), LATER_TRIES),
                };
                let Some(place) = self.find(*shape, &occupied, &mut draws.stream(&key), tries) else {
                    last = name;
                    break;
                };
                occupied.push(place.0);
                places.push(place);
            }
            if places.len() == shapes.len() {
                return Ok(places);
            }
            // Alone it does not fit either.
            if occupied.is_empty() {
                break;
            }
        }
        let problem = match shapes.first() {
            Some((first, _)) if *first == last => format!("\"{last}\" finds no place in the region"),
            _ => format!("\"{last}\" finds no place, also after the objects of the entry were drawn {ATTEMPTS} times"),
        };
        Err(Fault::new(problem, "use a larger region, fewer objects or a smaller clearance").below("size"))
    }

    fn find(&self, shape: Occupied, occupied: &[Occupied], stream: &mut Pcg, tries: u32) -> Option<(Occupied, f64)> {
        let half_size = DVec3::from(self.size.map(|l| 0.5 * l.0));
        let middle = DVec3::from(self.center.map(|l| l.0));
        // Horizontally the cylinder lies in the region; vertically the bottom does.
        let room = DVec3::new(half_size.x - shape.radius, half_size.y, half_size.z - shape.radius);
        if room.x < 0.0 || room.z < 0.0 {
            return None;
        }
        let clearance = self.clearance.map_or(0.0, |c| c.0);
        let range = self.turn.map(|turn| turn.0);
        for _ in 0..tries {
            let place = [(); 3].map(|()| 2.0 * uniform(stream) - 1.0);
            let angle = range.map_or(0.0, |range| range * (uniform(stream) - 0.5));
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

#[cfg(test)]
mod tests {
    use super::*;

    fn placement(edge: &str) -> Placement {
        let text = format!("objects = \"*\"\ncenter = [0, 0, 0]\nsize = [\"{edge}\", 0, \"{edge}\"]\n");
        Placement::parse(Value::Table(text.parse().expect("TOML"))).expect("a placement")
    }

    /// Two cylinders of the radius 5 mm have their centres in a square with an edge shorter by 10 mm. They fit if its diagonal
    /// is 10 mm or more: in a region of 18 mm (11.3 mm), where most first places leave no room for the second one. The
    /// diagonal of a region of 17 mm is 9.9 mm.
    #[test]
    fn a_tight_placement_is_drawn_again() {
        let shape = Occupied { center: DVec3::ZERO, radius: 0.005, half: 0.001 };
        let shapes = [("a", shape), ("b", shape)];
        let (tight, small) = (placement("18mm"), placement("17mm"));
        let mut again = 0;
        for index in 0..64 {
            let draws = Draws { seed: 7, index };
            let places = tight.arrange(&shapes, draws).unwrap_or_else(|e| panic!("{index}: {e:?}"));
            let [(a, _), (b, _)] = places[..] else { panic!("{places:?}") };
            assert!(a.center.with_y(0.0).distance(b.center.with_y(0.0)) >= 0.01);
            assert!([a, b].iter().all(|o| o.center.x.abs().max(o.center.z.abs()) <= 0.004 + 1e-12));
            assert_eq!(places.iter().map(|p| p.0.center).collect::<Vec<_>>(), {
                let same = tight.arrange(&shapes, draws).expect("the same");
                same.iter().map(|p| p.0.center).collect::<Vec<_>>()
            });
            // The first place of the first object, if the second one fits beside it.
            let first = tight.find(shape, &[], &mut draws.stream("place[a]"), TRIES).expect("a place");
            again += u32::from(first.0.center != a.center);
        }
        assert!(again > 16, "{again} of 64 were drawn again");
        let fault = small.arrange(&shapes, Draws { seed: 7, index: 0 }).expect_err("no room");
        assert!(fault.problem.contains("\"b\" finds no place, also after"), "{fault:?}");
        let alone = placement("9mm").arrange(&shapes, Draws { seed: 7, index: 0 }).expect_err("no room");
        assert!(alone.problem.contains("\"a\" finds no place in the region"), "{alone:?}");
    }
}
