//! Strobes of the lamps of a job, and the exposure time to which they belong.

use super::light::{Lamp, LampKind};
use super::{Exposure, Job, Light};
use crate::error::ImportWarning;
use dunkelfeld_radiometry::Number;
use dunkelfeld_scene::{EnvironmentSource, Instance, Material, PunctualKind, PunctualLight, SceneBuilder};

/// An exposure time from this one on \[s\] that is written without a unit was probably meant in milliseconds.
const LONG_WITHOUT_UNIT: f64 = 0.1;

impl Job {
    /// Exposure time \[s\] of a pixel: that of all stages of a line scan together. `None` if it is automatic.
    pub fn total_exposure(&self) -> Option<f64> {
        let Exposure::Seconds(exposure) = self.sensor.exposure else { return None };
        Some(match &self.line_scan {
            Some(lines) => exposure.min(1.0 / lines.line_rate) * f64::from(lines.tdi_stages),
            None => exposure,
        })
    }

    /// The first lamp with a strobe: its position in [`Job::lights`].
    pub fn first_strobe(&self) -> Option<usize> {
        self.lamps().find(|(_, lamp)| lamp.common.strobe.is_some()).map(|(i, _)| i)
    }

    /// The new lamps that are on, and their positions in [`Job::lights`].
    pub(super) fn lamps(&self) -> impl Iterator<Item = (usize, &Lamp)> {
        self.lights.iter().enumerate().filter_map(|(i, light)| match light {
            Light::Lamp(lamp) if lamp.common.enabled => Some((i, lamp.as_ref())),
            _ => None,
        })
    }

    /// The share of the exposure for which the lamp is on.
    pub(super) fn duty(&self, lamp: &Lamp) -> f64 {
        match (lamp.common.strobe, self.sensor.exposure) {
            (Some(strobe), Exposure::Seconds(exposure)) => (strobe / exposure).min(1.0),
            _ => 1.0,
        }
    }

    /// The time \[s\] of each exposure in which the scene has light, if that is the same strobe of all of its lights.
    pub fn common_strobe(&self, scene: &SceneBuilder) -> Option<f64> {
        let lamps = || self.lamps().map(|(_, lamp)| lamp);
        let strobe = lamps().find_map(|lamp| lamp.common.strobe)?;
        if lamps().any(|lamp| lamp.common.strobe != Some(strobe)) {
            return None;
        }
        let is_sky = |lamp: &&Lamp| matches!(lamp.kind, LampKind::Environment(_));
        let mut names: Vec<String> = lamps().filter(|lamp| !is_sky(lamp)).flat_map(Lamp::names).collect();
        // Each light of the scene must be one of these lamps.
        let mut is_lamp = |name: &str| match names.iter().position(|lamp| lamp == name) {
            Some(i) => {
                names.swap_remove(i);
                true
            }
            None => false,
        };
        let lights = scene.lights.iter().filter(|light| shines(light)).map(|light| light.name.as_str());
        let objects = scene.instances.iter().filter(|object| emits(object, scene)).map(|object| object.name.as_str());
        let has_environment = scene.environment.as_ref().is_some_and(|e| match e.source {
            EnvironmentSource::Constant(radiance) => !radiance.is_black(),
            EnvironmentSource::Image { .. } => true,
        });
        let is_own = !has_environment || lamps().any(|lamp| is_sky(&lamp));
        (is_own && lights.chain(objects).all(&mut is_lamp)).then_some(strobe)
    }

    /// A hazard of a scene whose lamps have strobes: objects move during the whole exposure, because there is other
    /// light. `None` without motion, and if the pulse of all lights is the same.
    pub fn strobe_hazard(&self, scene: &SceneBuilder) -> Option<ImportWarning> {
        let first = self.first_strobe()?;
        let moves = scene.instances.iter().any(|object| !object.motion.is_static());
        if !moves || self.common_strobe(scene).is_some() {
            return None;
        }
        let message = "objects move for the whole exposure, also in the light of this lamp, because the scene has light \
                       without this strobe; give all lamps the same `strobe` and remove other lights, or write a \
                       shorter `exposure`";
        Some(ImportWarning { place: format!("[[light]] {}, strobe", first + 1), message: message.into() })
    }

    /// The warning about a long exposure without a unit.
    pub(super) fn exposure_warning(&self) -> Option<ImportWarning> {
        let Exposure::Seconds(exposure) = self.sensor.exposure else { return None };
        let text = self.source.text_at(&["sensor", "exposure"])?.trim_matches(['"', '\'']).trim().to_string();
        if exposure < LONG_WITHOUT_UNIT || text.replace('_', "").parse::<f64>().is_err() {
            return None;
        }
        let number = Number(exposure);
        let message = format!("{text} is {number} s; write \"{number}ms\" for milliseconds, or \"{number}s\"");
        Some(ImportWarning { place: "[sensor] exposure".into(), message })
    }
}

fn shines(light: &PunctualLight) -> bool {
    let (PunctualKind::Point { intensity: strength }
    | PunctualKind::Spot { intensity: strength, .. }
    | PunctualKind::Directional { irradiance: strength }
    | PunctualKind::Sun { irradiance: strength, .. }
    | PunctualKind::Profile { scale: strength, .. }) = light.kind;
    !strength.is_black()
}

fn emits(object: &Instance, scene: &SceneBuilder) -> bool {
    let material = |mesh: &usize| scene.meshes.get(*mesh).and_then(|part| scene.materials.get(part.material));
    object.meshes.iter().filter_map(material).any(Material::emits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_geometry::{DVec3, Vec3};
    use dunkelfeld_radiometry::Rgb;
    use dunkelfeld_scene::Shutter;
    use dunkelfeld_scene::shapes::cuboid;

    const MOVING: &str = "[sensor]\nexposure = \"1ms\"\n[[object]]\nname = \"part\"\nvelocity = [1, 0, 0]\n";
    const RING: &str = "[[light]]\nkind = \"ring\"\ndiameter = 0.1\ndistance = 0.2\n";
    const POINTS: &str = "[[light]]\nkind = \"point\"\nposition = [0, 1, 0]\n";

    fn applied(text: &str, change: impl FnOnce(&mut SceneBuilder)) -> (Job, SceneBuilder, Vec<ImportWarning>) {
        let job = Job::from_text("job.toml", format!("scene = \"a.glb\"\n{text}"));
        let job = job.unwrap_or_else(|e| panic!("{text}: {e}"));
        let mut scene = SceneBuilder::default();
        let material = scene.add_material(Material::default());
        scene.add_object("part", cuboid(Vec3::splat(-0.01), Vec3::splat(0.01)), material);
        scene.add_camera("above", DVec3::Y, DVec3::ZERO, 0.3);
        change(&mut scene);
        let warnings = job.apply_overrides(&mut scene).unwrap_or_else(|e| panic!("{text}: {e}"));
        (job, scene, warnings)
    }

    fn shutter_of(text: &str, change: impl FnOnce(&mut SceneBuilder)) -> (Option<Shutter>, bool) {
        let (job, scene, _) = applied(text, change);
        let shutter = job.shutter(&scene, 8).unwrap_or_else(|e| panic!("{text}: {e}"));
        (shutter, job.strobe_hazard(&scene).is_some())
    }

    #[test]
    fn a_strobe_of_all_lights_is_the_shutter_of_motion() {
        let strobe = "strobe = 2e-5\n";
        let (frozen, whole) = (Some(Shutter::Frame { exposure: 2e-5 }), Some(Shutter::Frame { exposure: 1e-3 }));
        let all = format!("{MOVING}{RING}{strobe}count = 2\n{POINTS}{strobe}");
        assert_eq!(shutter_of(&all, |_| {}), (frozen, false));
        assert_eq!(shutter_of(&format!("{all}{RING}enabled = false\n"), |_| {}), (frozen, false));
        let sky = format!("{all}[[light]]\nkind = \"environment\"\n{strobe}");
        assert_eq!(shutter_of(&sky, |_| {}), (frozen, false));
        // Without a strobe nothing is to be said.
        assert_eq!(shutter_of(&format!("{MOVING}{RING}"), |_| {}), (whole, false));
        // A lamp without strobe, another strobe, an environment, a light of the file, an emitter of the file.
        assert_eq!(shutter_of(&format!("{all}{POINTS}"), |_| {}), (whole, true));
        assert_eq!(shutter_of(&format!("{all}{POINTS}strobe = 3e-5\n"), |_| {}), (whole, true));
        assert_eq!(shutter_of(&format!("{all}[environment]\nradiance = 1\n"), |_| {}), (whole, true));
        let kind = PunctualKind::Point { intensity: Rgb::WHITE };
        let light = || PunctualLight { name: "window".into(), to_world: Default::default(), kind };
        assert_eq!(shutter_of(&all, |scene| scene.lights.push(light())), (whole, true));
        let glow = |scene: &mut SceneBuilder| {
            let material = scene.add_material(Material { emission: Rgb::WHITE.into(), ..Material::default() });
            scene.add_object("ring", cuboid(Vec3::splat(1.0), Vec3::splat(2.0)), material);
        };
        assert_eq!(shutter_of(&all, glow), (whole, true));
    }

    #[test]
    fn a_strobe_is_the_exposure_of_a_moment_of_a_line_but_not_of_the_sensor() {
        let lines = "[line_scan]\nline_rate = \"1kHz\"\ntdi_stages = 4\n";
        let text = format!("{MOVING}{lines}{RING}strobe = 2e-5\n");
        let (job, scene, _) = applied(&text, |_| {});
        let Ok(Some(Shutter::Lines(scan))) = job.shutter(&scene, 8) else { panic!("a line scan") };
        assert_eq!((scan.exposure, scan.period), (2e-5, 1e-3));
        assert!(job.total_exposure().is_some_and(|t| (t - 4e-3).abs() < 1e-15));
    }

    #[test]
    fn a_long_exposure_without_a_unit_is_warned_of() {
        for (text, is_long) in
            [("5", true), ("\"5\"", true), ("0.5", true), ("0.01", false), ("\"5s\"", false), ("\"auto\"", false)]
        {
            let (.., warnings) = applied(&format!("[sensor]\nexposure = {text}\n"), |_| {});
            assert_eq!(!warnings.is_empty(), is_long, "{text}: {warnings:?}");
            let says = |w: &ImportWarning| w.to_string().contains("ms\" for milliseconds");
            assert!(warnings.iter().all(says), "{warnings:?}");
        }
    }
}
