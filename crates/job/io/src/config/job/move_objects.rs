//! Applies the motion of a job: velocities and rotations of objects, and the shutter of the scene.

use super::{Exposure, Job, ObjectOverride};
use crate::error::{ImportWarning, InputError};
use dunkelfeld_geometry::{DAffine3, DVec3, RigidMotion, Spin};
use dunkelfeld_radiometry::Number;
use dunkelfeld_scene::{Instance, LineScan, Material, SceneBuilder, Shutter};

/// Most names of objects in a warning.
const MOST_NAMES: usize = 6;

/// The entries of `[[object]]` that an object has its motion from. Other motions are those of the scene file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct OwnMotion {
    velocity: Option<usize>,
    rotation: Option<usize>,
    /// Does the entry fix the origin of the rotation in the world?
    has_origin: bool,
}

/// [`OwnMotion`] of each object, by index.
#[derive(Clone, Debug, Default)]
pub(super) struct OwnMotions(pub(super) Vec<OwnMotion>);

impl OwnMotion {
    /// The motion of an object after a map of the world has moved it. Velocities and axes of the job are those of the world,
    /// also where a later entry turns or scales the object. The centre of an object moves with it.
    pub(super) fn mapped(&self, motion: &RigidMotion, map: &DAffine3) -> RigidMotion {
        let mut mapped = motion.mapped(map);
        if self.velocity.is_some() {
            mapped.velocity = motion.velocity;
        }
        if let (Some(_), Some(spin), Some(before)) = (self.rotation, &mut mapped.spin, &motion.spin) {
            spin.axis = before.axis;
            if self.has_origin {
                spin.origin = before.origin;
            }
        }
        mapped
    }

    /// The entry, and its key.
    fn place(&self) -> Option<(usize, &'static str)> {
        self.velocity.map(|i| (i, "velocity")).or(self.rotation.map(|i| (i, "rotation")))
    }
}

impl OwnMotions {
    /// The objects that entries move, as they are now.
    pub(super) fn objects(&self, scene: &SceneBuilder) -> Vec<(Instance, (usize, &'static str))> {
        let moved = |(own, object): (&OwnMotion, &Instance)| own.place().map(|place| (object.clone(), place));
        self.0.iter().zip(&scene.instances).filter_map(moved).collect()
    }
}

impl Job {
    /// Gives the objects with the given indices the motion of entry `i`. They keep the part of their motion that the entry
    /// does not contain.
    pub(super) fn move_objects(
        &self,
        i: usize,
        change: &ObjectOverride,
        objects: &[usize],
        scene: &mut SceneBuilder,
        own: &mut OwnMotions,
    ) -> Result<(), InputError> {
        let common = match change.rotation.as_ref().and_then(|rotation| rotation.origin.as_ref()) {
            None => None,
            Some(origin) => {
                let point = origin.resolve(scene);
                Some(point.map_err(|e| self.object_error(i, "rotation", e.problem, e.help))?)
            }
        };
        for &index in objects {
            let Some(object) = scene.instances.get(index) else { continue };
            let center =
                || scene.bounds_of(object).map_or(object.to_world.translation, |[low, high]| 0.5 * (low + high));
            let spin = change.rotation.as_ref().map(|rotation| Spin {
                axis: rotation.axis.unwrap_or(DVec3::Y),
                origin: common.unwrap_or_else(center),
                speed: rotation.speed,
            });
            let RigidMotion { velocity, spin: old } = object.motion;
            let motion = RigidMotion { velocity: change.velocity.unwrap_or(velocity), spin: spin.or(old) };
            if let Some(object) = scene.instances.get_mut(index) {
                object.motion = motion;
            }
            if let Some(own) = own.0.get_mut(index) {
                own.velocity = change.velocity.map(|_| i).or(own.velocity);
                if change.rotation.is_some() {
                    (own.rotation, own.has_origin) = (Some(i), common.is_some());
                }
            }
        }
        Ok(())
    }

    /// Refuses objects that emit and that entries move: `moved` are the objects after all entries. An animation does not
    /// move an object that emits.
    pub(super) fn rest_emitters(
        &self,
        moved: &[(Instance, (usize, &'static str))],
        scene: &mut SceneBuilder,
        warnings: &mut Vec<ImportWarning>,
    ) -> Result<(), InputError> {
        let emits: Vec<bool> = scene.materials.iter().map(Material::emits).collect();
        let material = |mesh: &usize| scene.meshes.get(*mesh).map(|part| part.material);
        let mut at_rest = Vec::new();
        for object in scene.instances.iter_mut().filter(|object| !object.motion.is_static()) {
            if !object.meshes.iter().filter_map(material).any(|m| emits.get(m) == Some(&true)) {
                continue;
            }
            let is_it =
                |o: &Instance| (&o.name, o.to_world, o.motion) == (&object.name, object.to_world, object.motion);
            if let Some((_, (i, key))) = moved.iter().find(|(o, _)| is_it(o)) {
                let problem = format!("\"{}\" emits light, and lights must be at rest", object.name);
                let help = format!(
                    "remove `{key}`, name only objects that do not emit, or write `emission = 0` for its material in [[material]]"
                );
                return Err(self.object_error(*i, key, problem, help));
            }
            object.motion = RigidMotion::default();
            at_rest.push(object.name.clone());
        }
        if let (Some(first), Exposure::Seconds(_)) = (at_rest.first(), self.sensor.exposure) {
            let names: Vec<String> = at_rest.iter().take(MOST_NAMES).map(|name| format!("\"{name}\"")).collect();
            let more = at_rest.len() - names.len();
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            let message = format!(
                "the animation moves {}{more}, which emit light: lights must be at rest, so they keep their pose at `[import] animation_time`; to move them write `emission = 0` for their material in [[material]]",
                names.join(", ")
            );
            warnings.push(ImportWarning { place: format!("object \"{first}\""), message });
        }
        Ok(())
    }

    /// The shutter of the scene for a film of `rows` rows: that of `[line_scan]`, or a frame with the exposure of the
    /// sensor. If all light of the scene has the same strobe, that is the time of the motion in each exposure. `None` if
    /// nothing moves. Call it after [`Job::apply_overrides`].
    ///
    /// # Errors
    /// An exposure that is not fixed, or longer than the period of a line.
    pub fn shutter(&self, scene: &SceneBuilder, rows: u32) -> Result<Option<Shutter>, InputError> {
        let is_moved = |o: &ObjectOverride| o.velocity.is_some() || o.rotation.is_some();
        let (place, what): (Vec<String>, &str) = match (&self.line_scan, self.objects.iter().position(is_moved)) {
            (Some(_), _) => (vec!["line_scan".into(), "line_rate".into()], "a line scan"),
            (None, Some(i)) => {
                let key = if self.objects[i].velocity.is_some() { "velocity" } else { "rotation" };
                (vec!["object".into(), i.to_string(), key.into()], "the motion of an object")
            }
            (None, None) => {
                // The animation of a scene file gives motion only if an exposure time is known.
                let moves = scene.instances.iter().any(|object| !object.motion.is_static());
                return Ok(match self.sensor.exposure {
                    Exposure::Seconds(exposure) if moves => {
                        Some(Shutter::Frame { exposure: self.common_strobe(scene).unwrap_or(exposure) })
                    }
                    _ => None,
                });
            }
        };
        let Exposure::Seconds(exposure) = self.sensor.exposure else {
            let keys: Vec<&str> = place.iter().map(String::as_str).collect();
            let problem = format!("{what} needs the exposure time of the sensor, and it is automatic");
            let help = "write a time in [sensor], such as `exposure = \"5ms\"`";
            return Err(self.source.error_at_key(&keys, problem, help));
        };
        // Without light nothing moves in the image.
        let lit = self.common_strobe(scene).unwrap_or(exposure);
        let Some(settings) = &self.line_scan else { return Ok(Some(Shutter::Frame { exposure: lit })) };
        let period = 1.0 / settings.line_rate;
        // The rounding of a line rate must not refuse an exposure of the whole period.
        if exposure > period * (1.0 + 1e-9) {
            let problem = format!(
                "the exposure of {} s is longer than the {} s from line to line",
                Number(exposure),
                Number(period)
            );
            let help = "write a shorter `exposure`, or a lower `line_rate` in [line_scan]";
            return Err(self.source.error_at_key(&["sensor", "exposure"], problem, help));
        }
        if settings.encoder_jitter > period {
            let problem = "the deviation of a line is longer than the time from line to line";
            let help = "write a shorter `encoder_jitter`";
            return Err(self.source.error_at_key(&["line_scan", "encoder_jitter"], problem, help));
        }
        Ok(Some(Shutter::Lines(LineScan {
            period,
            exposure: lit.min(period),
            stages: settings.tdi_stages,
            jitter: settings.encoder_jitter,
            line: settings.line,
            rows,
            in_turn: self.lines_in_turn(rows)?,
        })))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity::AngularSpeed;
    use dunkelfeld_geometry::{Mesh, Vec3};

    fn scene() -> SceneBuilder {
        let mut scene = SceneBuilder::default();
        let material = scene.add_material(Default::default());
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 2.0, 0.0)];
        let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
        scene.add_object("part 1", mesh.clone(), material);
        scene.add_object("table", mesh, material);
        scene
    }

    fn job(text: &str) -> Result<Job, InputError> {
        Job::from_text("job.toml", format!("scene = \"a.glb\"\n{text}"))
    }

    #[test]
    fn objects_get_velocity_and_rotation_with_their_units() {
        let job = job("[[object]]\nname = \"part*\"\nvelocity = [\"200mm/s\", 0, \"-3m/min\"]\n[[object]]\nname = \"part 1\"\nrotation = { axis = [0, 0, 2], speed = \"120rpm\" }\n")
            .expect("a job");
        let mut scene = scene();
        job.apply_overrides(&mut scene).expect("the names exist");
        let motion = scene.instances[0].motion;
        assert!((motion.velocity - DVec3::new(0.2, 0.0, -0.05)).length() < 1e-12);
        let spin = motion.spin.expect("a rotation");
        assert_eq!((spin.axis, spin.origin), (DVec3::Z, DVec3::new(0.5, 1.0, 0.0)), "about its centre");
        assert!((spin.speed - 4.0 * std::f64::consts::PI).abs() < 1e-12);
        assert!(scene.instances[1].motion.is_static());
        for (text, speed) in [("2turn/s", 4.0 * std::f64::consts::PI), ("-90deg/s", -0.5 * std::f64::consts::PI)] {
            let AngularSpeed(v) = text.parse().expect(text);
            assert!((v - speed).abs() < 1e-12, "{text}");
        }
    }

    #[test]
    fn velocities_and_axes_of_a_job_stay_in_the_world() {
        let after = |first: &str, second: &str| {
            let first = format!("[[object]]\nname = \"part 1\"\n{first}\n");
            let job = job(&format!("{first}[[object]]\nname = \"part 1\"\n{second}\n")).expect("a job");
            let mut scene = scene();
            // The scene file moves it along +x, and turns it about +y.
            let motion = RigidMotion::rotation(DVec3::Y, DVec3::ZERO, 1.0).expect("an axis");
            scene.instances[0].motion = RigidMotion { velocity: DVec3::X, ..motion };
            job.apply_overrides(&mut scene).expect("the names exist");
            scene.instances
        };
        let is_near = |a: DVec3, b: DVec3| (a - b).length() < 1e-12;
        let turn = "rotate = { axis = [0, 0, 1], angle = \"90deg\" }\nscale = 3";
        // A motion of the scene file turns with the object.
        let motion = after("translate = [0, 0, 0]", turn)[0].motion;
        assert!(is_near(motion.velocity, 3.0 * DVec3::Y) && is_near(motion.spin.expect("turns").axis, DVec3::NEG_X));
        let motion = after("velocity = [0.5, 0, 0]", turn)[0].motion;
        assert!(is_near(motion.velocity, 0.5 * DVec3::X) && is_near(motion.spin.expect("turns").axis, DVec3::NEG_X));
        let rotation = "rotation = { axis = [1, 0, 0], speed = \"60rpm\"";
        let moved = "translate = [5, 0, 0]";
        let spin = |first: &str, second: &str| after(first, second)[0].motion.spin.expect("turns");
        let own = spin(&format!("{rotation} }}"), &format!("{turn}\n{moved}"));
        assert!(is_near(own.axis, DVec3::X) && is_near(own.origin, DVec3::new(5.0 - 3.0, 1.5, 0.0)), "{own:?}");
        let fixed = spin(&format!("{rotation}, origin = [0, 1, 0] }}"), moved);
        assert_eq!(fixed.origin, DVec3::Y);
        // Copies move in the same direction, and an object that is removed takes its motion along.
        let copies =
            after("velocity = [0.5, 0, 0]", "instances = [{}, { rotate = { axis = [0, 0, 1], angle = \"90deg\" } }]");
        assert!(copies[..3].iter().filter(|o| o.name != "table").all(|o| is_near(o.motion.velocity, 0.5 * DVec3::X)));
        let job = job(
            "[[object]]\nname = \"part 1\"\nvelocity = [1, 0, 0]\n[[object]]\nname = \"part 1\"\nvisible = false\n[[object]]\nname = \"table\"\nrotate = { axis = [0, 0, 1], angle = \"90deg\" }\n",
        );
        let mut scene = scene();
        scene.instances[1].motion = RigidMotion::linear(DVec3::X);
        job.expect("a job").apply_overrides(&mut scene).expect("the names exist");
        assert!(is_near(scene.instances[0].motion.velocity, DVec3::Y));
    }

    #[test]
    fn animated_emitters_are_at_rest_and_those_that_a_job_moves_are_refused() {
        let apply = |text: &str| {
            let mut scene = scene();
            scene.instances[0].motion = RigidMotion::linear(DVec3::X);
            let material = scene.add_material(Material { name: "glow".into(), ..Default::default() });
            scene.meshes[0].material = material;
            let job =
                job(&format!("[sensor]\nexposure = \"1ms\"\n[[material]]\nname = \"glow\"\nemission = 2\n{text}"));
            job.expect("a job").apply_overrides(&mut scene).map(|warnings| (scene, warnings))
        };
        let (scene, warnings) = apply("").expect("valid");
        assert!(scene.instances[0].motion.is_static());
        assert!(
            warnings.len() == 1
                && warnings[0].message.contains("\"part 1\"")
                && warnings[0].message.contains("`emission = 0`"),
            "{warnings:?}"
        );
        let (scene, warnings) = apply("[[material]]\nname = \"glow\"\nemission = 0\n").expect("valid");
        assert!(!scene.instances[0].motion.is_static() && warnings.is_empty(), "{warnings:?}");
        for key in ["velocity = [1, 0, 0]", "rotation = { axis = [0, 1, 0], speed = \"3rpm\" }"] {
            let error = apply(&format!("[[object]]\nname = \"part*\"\n{key}\n")).expect_err("an emitter");
            let name = key.split(' ').next().unwrap_or_default();
            assert!(
                error.place.contains(name) && error.problem.contains("emits light") && error.help.contains(name),
                "{error}"
            );
        }
        assert!(apply("[[object]]\nname = \"table\"\nvelocity = [1, 0, 0]\n").is_ok());
    }

    #[test]
    fn a_shutter_needs_a_fixed_exposure() {
        let line = "[line_scan]\nline_rate = \"10kHz\"\n";
        let moving = "[[object]]\nname = \"table\"\nvelocity = [1, 0, 0]\n";
        let of = |text: &str| {
            let job = job(text).expect("a job");
            let mut scene = scene();
            job.apply_overrides(&mut scene).expect("the names exist");
            job.shutter(&scene, 64)
        };
        assert_eq!(of("[sensor]\nexposure = \"1ms\"\n").expect("valid"), None);
        assert_eq!(
            of(&format!("[sensor]\nexposure = \"1ms\"\n{moving}")).expect("valid"),
            Some(Shutter::Frame { exposure: 1e-3 })
        );
        let scan =
            of(&format!("[sensor]\nexposure = 1e-4\n{line}tdi_stages = 8\nencoder_jitter = \"1us\"\nline = 0.25\n"));
        let expected =
            LineScan { period: 1e-4, exposure: 1e-4, stages: 8, jitter: 1e-6, line: 0.25, rows: 64, in_turn: 1 };
        assert_eq!(scan.expect("valid"), Some(Shutter::Lines(expected)));
        for (text, place, part) in
            [(moving.to_string(), "velocity", "automatic"), (line.to_string(), "line_rate", "automatic")]
        {
            let error = of(&text).expect_err(part);
            assert!(error.problem.contains(part) && error.place.contains(place), "{text}: {error}");
        }
    }
}
