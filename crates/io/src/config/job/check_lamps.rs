//! Checks of new lamps in a job: keys that a kind of lamp does not have, or that exclude each other.

use super::lamp_values::MAX_LEDS;
use super::{Exposure, Job, LampKind, LightSettings};
use crate::error::InputError;
use dunkelfeld_radiometry::{Number, Rgb};

/// Largest number of lamps of a job that have a surface.
const MAX_LAMPS: u32 = 1000;

/// The keys of a new lamp that only some kinds have.
const KEYS: &[&str] = &[
    "diameter",
    "inner_diameter",
    "width",
    "height",
    "opening",
    "tilt",
    "leds",
    "led_diameter",
    "diffuser",
    "lens_angle",
    "spread",
    "splitter",
    "cone_angle",
    "blend",
    "angle",
    "body",
    "power",
    "radiance",
    "intensity",
    "irradiance",
    "scale",
    "working_distance",
    "camera",
    "position",
    "aim",
    "target",
    "distance",
    "direction",
    "elevation",
    "azimuth",
    "up",
    "count",
];

/// Pairs of keys that exclude each other, and the reason. The error is at the second one.
const EXCLUSIVE: &[(&str, &str, &str)] = &[
    ("position", "distance", "both set the distance from the target"),
    ("position", "direction", "both set the place of the lamp"),
    ("position", "elevation", "both set the place of the lamp"),
    ("position", "azimuth", "both set the place of the lamp"),
    ("direction", "elevation", "both set the direction to the lamp"),
    ("direction", "azimuth", "both set the direction to the lamp"),
    ("lens_angle", "spread", "both set the angular distribution"),
    ("diameter", "width", "both set the size"),
    ("aim", "target", "both set the direction in which the lamp shines"),
    ("aim", "distance", "`aim` belongs to a `position`"),
    ("aim", "direction", "both set the direction in which the lamp shines"),
    ("aim", "elevation", "both set the direction in which the lamp shines"),
    ("azimuth", "up", "`azimuth` turns the lamp already"),
];

/// Keys that have no effect without another one, and the reason.
const NEEDS: &[(&str, &str, &str)] = &[
    ("azimuth", "elevation", "an azimuth without an elevation gives no direction"),
    ("working_distance", "irradiance", "it is the distance of `irradiance`, which is not given"),
    ("led_diameter", "leds", "there are no LEDs"),
    ("diffuser", "leds", "there are no LEDs"),
];

/// The first key of an entry without `kind` that only new lamps have.
pub(super) fn lamp_key(given: impl Fn(&str) -> bool) -> Option<&'static str> {
    let shared = ["power", "radiance", "intensity", "irradiance", "scale"];
    let own = KEYS.iter().copied().filter(|key| !shared.contains(key));
    own.chain(["strobe"]).find(|key| given(key))
}

impl Job {
    /// Checks `[[light]]` entry `i` of a kind without the scene: keys that the kind does not have, or that exclude each
    /// other.
    pub(super) fn check_lamp(&self, i: usize, light: &LightSettings, kind: LampKind) -> Result<(), InputError> {
        let item = i.to_string();
        let given = |key: &str| self.source.has_key(&["light", &item, key]);
        if light.ies.is_some() {
            let help = "remove it, or give it to a point or spot light of the scene by an entry without `kind`";
            return Err(self.light_error(i, "ies", format!("a new {} has no profile", kind.name()), help));
        }
        for key in KEYS {
            let allowed =
                [kind.geometry_keys(), kind.strength_keys(), kind.pose_keys()].iter().any(|k| k.contains(key));
            if given(key) && !allowed {
                let known = [kind.geometry_keys(), kind.strength_keys(), kind.pose_keys()].concat().join("`, `");
                let problem = format!("a light of kind \"{}\" has no {key}", kind.name());
                return Err(self.light_error(i, key, problem, format!("its keys are `{known}`")));
            }
        }
        for (first, second, why) in EXCLUSIVE {
            if given(first) && given(second) {
                let problem = format!("`{first}` and `{second}`: {why}");
                return Err(self.light_error(i, second, problem, "keep one of them"));
            }
        }
        for (key, other, why) in NEEDS {
            if given(key) && !given(other) {
                let help = format!("write `{other}` as well, or remove this");
                return Err(self.light_error(i, key, *why, help));
            }
        }
        if given("aim") && !given("position") && kind != LampKind::Sun {
            let help = "write `position` as well, or `direction` instead";
            return Err(self.light_error(i, "aim", "`aim` belongs to a `position`", help));
        }
        if given("aim") && given("irradiance") && kind != LampKind::Sun && !given("working_distance") {
            let problem = "a lamp with `aim` faces no target, so that the distance of its irradiance is missing";
            return Err(self.light_error(i, "irradiance", problem, "write `working_distance` as well"));
        }
        if given("led_diameter") && light.diffuser == Some(true) {
            let help = "remove this, or write diffuser = false";
            return Err(self.light_error(i, "led_diameter", "the whole surface emits behind a diffuser", help));
        }
        let required: &[&str] = match kind {
            LampKind::Ring | LampKind::Dome => &["diameter"],
            LampKind::Bar => &["width"],
            _ => &[],
        };
        if let Some(key) = required.iter().find(|key| !given(key)) {
            let problem = format!("a light of kind \"{}\" needs its {key}", kind.name());
            return Err(self.light_error(i, "kind", problem, format!("write {key} = \"100mm\"")));
        }
        let is_panel = matches!(kind, LampKind::Coaxial | LampKind::Back | LampKind::Panel);
        if is_panel && !given("diameter") && !given("width") {
            let problem = format!("a light of kind \"{}\" needs its size", kind.name());
            return Err(self.light_error(i, "kind", problem, "write width = \"100mm\" and `height`, or `diameter`"));
        }
        let is_placed = given("position") || given("distance");
        if !is_placed && !matches!(kind, LampKind::Sun | LampKind::Environment | LampKind::Dome) {
            let help = "write distance = \"200mm\" from the target, or a `position`";
            return Err(self.light_error(i, "kind", "the place of the lamp is missing", help));
        }
        for (key, outer, inner) in
            [("inner_diameter", light.diameter, light.inner_diameter), ("opening", light.diameter, light.opening)]
        {
            if let (Some(outer), Some(inner)) = (outer, inner)
                && inner >= outer
            {
                let problem = format!("{key} {} m is not below the diameter {} m", Number(inner), Number(outer));
                return Err(self.light_error(i, key, problem, "write a smaller one"));
            }
        }
        if given("strobe") && matches!(self.sensor.exposure, Exposure::Auto) {
            let help = "write `exposure` in [sensor], such as \"1ms\"";
            return Err(self.light_error(i, "strobe", "a strobe needs a fixed exposure time", help));
        }
        if let (Some(strobe), Exposure::Seconds(exposure)) = (light.strobe, self.sensor.exposure)
            && strobe > exposure * (1.0 + 1e-9)
        {
            let (strobe, exposure) = (Number(strobe), Number(exposure));
            let problem = format!("the pulse of {strobe} s is longer than the exposure of {exposure} s");
            let help = "write a shorter one, or remove it: then the lamp is on for the whole exposure";
            return Err(self.light_error(i, "strobe", problem, help));
        }
        Ok(())
    }

    /// Checks that a light of one wavelength has no colour.
    pub(super) fn check_color(&self, i: usize, light: &LightSettings) -> Result<(), InputError> {
        let strengths =
            [("radiance", light.radiance), ("intensity", light.intensity), ("irradiance", light.irradiance)];
        let is_colored = |strength: Option<Rgb>| strength.is_some_and(|c| c.r != c.g || c.g != c.b);
        match strengths.into_iter().find(|(_, strength)| is_colored(*strength)) {
            Some((key, _)) if light.wavelength.is_some() => {
                let problem = "a light of one wavelength has no colour";
                Err(self.light_error(i, key, problem, "write one number, or remove `wavelength`"))
            }
            _ => Ok(()),
        }
    }

    /// Checks all new lamps together: their number, their LEDs, and that there is one environment.
    pub(super) fn check_all_lights(&self) -> Result<(), InputError> {
        let mut environment = self.environment.is_some().then(|| "[environment]".to_string());
        let (mut lamps, mut leds) = (0, 0);
        for (i, light) in self.lights.iter().enumerate().filter(|(_, light)| light.enabled) {
            let Some(kind) = light.kind else { continue };
            if kind == LampKind::Environment {
                if let Some(other) = environment {
                    let problem = format!("a scene has one environment, and {other} sets it already");
                    return Err(self.light_error(i, "kind", problem, "keep one of them"));
                }
                environment = Some(format!("[[light]] {}", i + 1));
            }
            let count = light.count.unwrap_or(1);
            if light.has_surface(kind) {
                lamps += count;
            }
            if lamps > MAX_LAMPS {
                let problem =
                    format!("the job has more than {MAX_LAMPS} lamps with a surface, each of `count` counted");
                return Err(self.light_error(i, "kind", problem, "write fewer lamps"));
            }
            if let Some(own) = light.leds.filter(|_| light.diffuser != Some(true)) {
                leds += count * own.columns * own.rows;
            }
            if leds > MAX_LEDS {
                let problem = format!("the lamps of the job have more than {MAX_LEDS} LEDs together");
                let help = "write fewer LEDs, or diffuser = true for lamps whose LEDs are not seen one by one";
                return Err(self.light_error(i, "leds", problem, help));
            }
        }
        Ok(())
    }
}
