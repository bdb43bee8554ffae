//! Applies the motion of a job: velocities and rotations of objects, and the shutter of the scene.

use super::place::bounds_of;
use super::{Exposure, Job, ObjectOverride};
use crate::error::InputError;
use dunkelfeld_geometry::{DVec3, RigidMotion, Spin};
use dunkelfeld_radiometry::Number;
use dunkelfeld_scene::{LineScan, SceneBuilder, Shutter};

impl Job {
    /// Gives the objects with the given indices the motion of entry `i`. They keep the part of their motion that the entry
    /// does not contain.
    pub(super) fn move_objects(
        &self,
        i: usize,
        change: &ObjectOverride,
        objects: &[usize],
        scene: &mut SceneBuilder,
    ) -> Result<(), InputError> {
        let common = match change.rotation.as_ref().and_then(|rotation| rotation.origin.as_ref()) {
            None => None,
            Some(origin) => {
                let point = origin.resolve(scene);
                let error = |(problem, help): (String, String)| {
                    self.source.error_at_key(&["object", &i.to_string(), "rotation"], problem, help)
                };
                Some(point.map_err(error)?)
            }
        };
        for &index in objects {
            let Some(object) = scene.instances.get(index) else { continue };
            let center =
                || bounds_of(object, scene).map_or(object.to_world.translation, |[low, high]| 0.5 * (low + high));
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
        let expected = LineScan { period: 1e-4, exposure: 1e-4, stages: 8, jitter: 1e-6, line: 0.25, rows: 64 };
        assert_eq!(scan.expect("valid"), Some(Shutter::Lines(expected)));
        for (text, place, part) in [
            (moving.to_string(), "velocity", "automatic"),
            (line.to_string(), "line_rate", "automatic"),
            (format!("[sensor]\nexposure = \"200us\"\n{line}"), "exposure", "longer"),
            (format!("[sensor]\nexposure = \"50us\"\n{line}encoder_jitter = \"1ms\"\n"), "encoder_jitter", "deviation"),
        ] {
            let error = of(&text).expect_err(part);
            assert!(error.problem.contains(part) && error.place.contains(place), "{text}: {error}");
        }
    }

    #[test]
    fn wrong_motions_are_refused() {
        for (text, part) in [
            ("[[object]]\nname = \"a\"\nvelocity = [1, 2]\n", "three values"),
            ("[[object]]\nname = \"a\"\nvelocity = [1, 2, nan]\n", "out of range"),
            ("[[object]]\nname = \"a\"\nvelocity = [1, 2, \"3mm\"]\n", "unknown unit"),
            ("[[object]]\nname = \"a\"\nrotation = { speed = \"1rpm\" }\n", "axis"),
            ("[[object]]\nname = \"a\"\nrotation = { axis = [0, 1, 0], speed = 3 }\n", "unit"),
            ("[[object]]\nname = \"a\"\nrotation = { axis = [0, 0, 0], speed = \"3rpm\" }\n", "not a direction"),
            ("[line_scan]\nline_rate = 0\n", "out of range"),
            ("[line_scan]\nline = 0.5\n", "line_rate"),
            ("[line_scan]\nline_rate = \"1kHz\"\ntdi_stages = 0\n", "out of range"),
            ("[line_scan]\nline_rate = \"1kHz\"\nline = 1.1\n", "out of range"),
        ] {
            let error = job(text).expect_err(text).to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        let job = job("[[object]]\nname = \"tabel\"\nvelocity = [1, 0, 0]\n").expect("a job");
        let error = job.apply_overrides(&mut scene()).expect_err("no such object").to_string();
        assert!(error.contains("\"tabel\"") && error.contains("table"), "{error}");
    }
}
