//! Checks of new lamps in a job: keys that a kind of lamp does not have, or that exclude each other.

use super::{Exposure, Job, LampKind, LightSettings};
use crate::error::InputError;
use dunkelfeld_radiometry::Number;

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
    "working_distance",
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

/// The first key of an entry without `kind` that only new lamps have.
pub(super) fn lamp_key(given: impl Fn(&str) -> bool) -> Option<&'static str> {
    let shared = ["power", "radiance", "intensity", "irradiance"];
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
        let exclusive: [(&str, &str, &str); 9] = [
            ("position", "distance", "both set the distance from the target"),
            ("position", "direction", "both set the place of the lamp"),
            ("position", "elevation", "both set the place of the lamp"),
            ("direction", "elevation", "both set the direction to the lamp"),
            ("direction", "azimuth", "both set the direction to the lamp"),
            ("lens_angle", "spread", "both set the angular distribution"),
            ("diameter", "width", "both set the size"),
            ("aim", "target", "both set the direction in which the lamp shines"),
            ("aim", "distance", "`aim` belongs to a `position`"),
        ];
        for (first, second, why) in exclusive {
            // A ring has a diameter and no width.
            if given(first) && given(second) {
                let problem = format!("`{first}` and `{second}`: {why}");
                return Err(self.light_error(i, second, problem, "keep one of them"));
            }
        }
        if light.wavelength.is_some()
            && let Some(key) = ["radiance", "intensity", "irradiance"].into_iter().find(|key| {
                let triple = match *key {
                    "radiance" => light.radiance,
                    "intensity" => light.intensity,
                    _ => light.irradiance,
                };
                triple.is_some_and(|c| c.r != c.g || c.g != c.b)
            })
        {
            let problem = "a light of one wavelength has no colour";
            return Err(self.light_error(i, key, problem, "write one number, or remove `wavelength`"));
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
        if given("leds") && kind != LampKind::Bar && kind != LampKind::Ring && given("diameter") && given("width") {
            return Err(self.light_error(i, "leds", "the size is given twice", "keep `diameter` or `width`"));
        }
        if (given("led_diameter") || given("diffuser")) && !given("leds") {
            let key = if given("diffuser") { "diffuser" } else { "led_diameter" };
            return Err(self.light_error(i, key, "there are no LEDs", "write `leds` as well, or remove this"));
        }
        if given("strobe") && matches!(self.sensor.exposure, Exposure::Auto) {
            let help = "write `exposure` in [sensor], such as \"1ms\"";
            return Err(self.light_error(i, "strobe", "a strobe needs a fixed exposure time", help));
        }
        if given("up") && given("azimuth") {
            return Err(self.light_error(i, "up", "`azimuth` turns the lamp already", "keep one of them"));
        }
        Ok(())
    }
}
