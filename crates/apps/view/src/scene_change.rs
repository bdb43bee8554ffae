//! The changes of the scene that the page asked for, as keys of a job.

use crate::protocol::{Fault, LightChange, MaterialChange, MaterialState, SceneRequest};
use dunkelfeld::Inspection;
use dunkelfeld::commands::removable_effects;
use dunkelfeld::io::literal_pattern;
use dunkelfeld::scene::{Effect, Material};
use std::collections::BTreeMap;
use toml::{Table, Value};

/// Kinds of lights without a power.
const NO_POWER: [&str; 3] = ["environment", "sun", "directional"];

/// Has a light of this kind a power?
pub(crate) fn has_power(kind: &str) -> bool {
    !NO_POWER.contains(&kind)
}

/// Can a light of this kind be switched off?
pub(crate) fn has_switch(kind: &str) -> bool {
    kind != "environment"
}

/// All changes since the scene was opened.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SceneChange {
    pub(crate) camera: Option<String>,
    pub(crate) lights: BTreeMap<String, LightChange>,
    pub(crate) materials: BTreeMap<String, MaterialChange>,
    pub(crate) without: Vec<Effect>,
    /// Has each light a film?
    pub(crate) per_light: bool,
}

/// The parts of the scene as it was opened, by which changes are checked.
#[derive(Clone, Debug, Default)]
pub(crate) struct SceneParts {
    pub(crate) cameras: Vec<String>,
    /// Names, kinds and powers \[W\] of the lights.
    pub(crate) lights: Vec<(String, String, f64)>,
    /// The materials that a job can change.
    pub(crate) materials: Vec<MaterialState>,
    pub(crate) effects: Vec<(String, bool)>,
    /// Names that lights with a surface share with other lights. An entry of a job changes one of both kinds only.
    mixed_names: Vec<String>,
}

impl SceneParts {
    pub(crate) fn new(inspection: &Inspection, materials: &[Material]) -> Self {
        let mut lights: Vec<(String, String, f64)> = Vec::new();
        let mut mixed_names: Vec<String> = Vec::new();
        let has_surface = |kind: &str| kind.starts_with("area");
        for light in &inspection.lights {
            let is_mixed = |(name, kind, _): &(String, String, f64)| {
                *name == light.name && has_surface(kind) != has_surface(&light.kind)
            };
            if lights.iter().any(is_mixed) {
                mixed_names.push(light.name.clone());
            }
            match lights.iter_mut().find(|(name, ..)| *name == light.name) {
                Some((.., watts)) => *watts += light.watts,
                None => lights.push((light.name.clone(), light.kind.clone(), light.watts)),
            }
        }
        Self {
            cameras: inspection.cameras.iter().map(|camera| camera.name.clone()).collect(),
            lights,
            materials: of_materials(inspection, materials),
            effects: (inspection.effects.iter())
                .filter(|effect| removable_effects().iter().any(|removable| removable.name() == effect.name))
                .map(|effect| (effect.name.clone(), effect.on))
                .collect(),
            mixed_names,
        }
    }

    /// Values that textures multiply stay without a knob while textures are left out: a value of a job multiplies their
    /// mean then. `described` are the materials with their textures.
    pub(crate) fn keep_textured(&mut self, inspection: &Inspection, described: &[Material]) {
        self.keep_values_of(&of_materials(inspection, described));
    }

    fn keep_values_of(&mut self, textured: &[MaterialState]) {
        for material in &mut self.materials {
            let Some(textured) = textured.iter().find(|textured| textured.name == material.name) else { continue };
            material.roughness = material.roughness.filter(|_| textured.roughness.is_some());
            material.metallic = material.metallic.filter(|_| textured.metallic.is_some());
            material.color = material.color.filter(|_| textured.color.is_some());
        }
    }

    /// Checks that an entry of a job changes all lights of a name.
    fn check_name(&self, name: &str) -> Result<(), Fault> {
        if self.mixed_names.iter().any(|mixed| mixed == name) {
            let problem =
                format!("lights with and without a surface have the name {name:?}, and a job changes one kind");
            return Err(Fault::new(problem, "give them different names"));
        }
        Ok(())
    }

    /// Checks that an entry of a job makes a change of a light. `kind` is that of the light.
    fn check_light(&self, name: &str, kind: &str, change: LightChange) -> Result<(), Fault> {
        if !has_switch(kind) && !change.on {
            let problem = format!("{name:?} is the environment, which has no switch");
            return Err(Fault::new(problem, "write `radiance = 0` or `scale = 0` in `[environment]` of the job"));
        }
        if change.factor != 1.0 && !has_power(kind) {
            let problem = format!("the light {name:?} comes from infinitely far away, and has no power");
            return Err(Fault::new(problem, "change it in the job"));
        }
        if change == LightChange::NONE { Ok(()) } else { self.check_name(name) }
    }
}

/// The values of the materials in use, each name once. A value that a texture multiplies is `None`. Materials that emit
/// belong to lights, which have knobs of their own.
fn of_materials(inspection: &Inspection, materials: &[Material]) -> Vec<MaterialState> {
    let is_used = |name: &str| inspection.materials.iter().any(|used| used.name == name);
    // The plate behind the LEDs of a lamp is no material of the job either.
    let is_plate = |name: &str| {
        name.strip_suffix(" plate").is_some_and(|lamp| inspection.lights.iter().any(|light| light.name == lamp))
    };
    let mut list: Vec<MaterialState> = Vec::new();
    for material in materials.iter().filter(|m| !m.emits() && is_used(&m.name) && !is_plate(&m.name)) {
        if list.iter().any(|listed| listed.name == material.name) {
            continue;
        }
        list.push(MaterialState {
            name: material.name.clone(),
            roughness: material.roughness.texture.is_none().then(|| decimal(material.roughness.factor)),
            metallic: material.metallic.texture.is_none().then(|| decimal(material.metallic.factor)),
            color: material.base_color.texture.is_none().then(|| material.base_color.factor.to_array().map(decimal)),
            changed: MaterialChange::default(),
        });
    }
    list
}

/// The decimal number that the f32 was read from.
fn decimal(value: f32) -> f64 {
    value.to_string().parse().unwrap_or_else(|_| f64::from(value))
}

impl LightChange {
    /// A light as it is in the scene.
    const NONE: Self = Self { on: true, factor: 1.0 };
}

impl MaterialChange {
    /// The values that differ from those of a material of the scene.
    fn other_than(self, base: &MaterialState) -> Self {
        Self {
            roughness: self.roughness.filter(|v| base.roughness != Some(*v)),
            metallic: self.metallic.filter(|v| base.metallic != Some(*v)),
            color: self.color.filter(|v| base.color != Some(*v)),
        }
    }

    /// The values that the material has as numbers. A texture multiplies the others.
    fn without_textured(self, base: &MaterialState) -> Self {
        Self {
            roughness: self.roughness.filter(|_| base.roughness.is_some()),
            metallic: self.metallic.filter(|_| base.metallic.is_some()),
            color: self.color.filter(|_| base.color.is_some()),
        }
    }
}

impl SceneChange {
    /// The changes that an entry of a job makes in the scene: those of the parts that it has.
    pub(crate) fn restricted_to(&self, parts: &SceneParts) -> Self {
        let mut change = self.clone();
        change.camera = change.camera.filter(|camera| parts.cameras.contains(camera));
        change.lights.retain(|name, light| {
            let found = parts.lights.iter().find(|(of_scene, ..)| of_scene == name);
            found.is_some_and(|(_, kind, _)| parts.check_light(name, kind, *light).is_ok())
        });
        change.materials.retain(|name, values| {
            let Some(base) = parts.materials.iter().find(|material| material.name == *name) else { return false };
            *values = values.without_textured(base);
            *values != MaterialChange::default()
        });
        change
    }

    /// The reasons why changes of lights of the scene are not made: files that have changed since may allow them no more.
    pub(crate) fn unmade(&self, parts: &SceneParts) -> Vec<Fault> {
        let fault = |(name, kind, _): &(String, String, f64)| {
            self.lights.get(name).and_then(|light| parts.check_light(name, kind, *light).err())
        };
        parts.lights.iter().filter_map(fault).collect()
    }

    /// Adds a request.
    ///
    /// # Errors
    /// A name that the scene does not have, and a number out of range.
    pub(crate) fn add(&mut self, request: SceneRequest, parts: &SceneParts) -> Result<(), Fault> {
        let mut next = self.clone();
        next.per_light = request.per_light.unwrap_or(next.per_light);
        if let Some(camera) = request.camera {
            if !parts.cameras.contains(&camera) {
                return Err(unknown("camera", &camera));
            }
            next.camera = Some(camera);
        }
        for (name, change) in request.lights.into_iter().flatten() {
            next.add_light(name, change, parts)?;
        }
        for (name, change) in request.materials.into_iter().flatten() {
            next.add_material(name, change, parts)?;
        }
        if let Some(effects) = request.effects {
            let removable = removable_effects();
            if let Some(name) = effects.keys().find(|name| !removable.iter().any(|effect| effect.name() == *name)) {
                let help = "choose an effect of the list";
                return Err(Fault::new(format!("{name:?} is no effect that can be left out"), help));
            }
            // In the order of the list, so that equal changes are equal lists.
            let left_out = |effect: &Effect| {
                effects.get(effect.name()).map_or_else(|| next.without.contains(effect), |is_on| !is_on)
            };
            next.without = removable.into_iter().filter(left_out).collect();
        }
        let made = next.restricted_to(parts);
        let is_off = |(name, ..): &(String, String, f64)| made.lights.get(name).is_some_and(|light| !light.on);
        if next.per_light && !parts.lights.is_empty() && parts.lights.iter().all(is_off) {
            let help = "leave a light on, or use one film for all lights";
            return Err(Fault::new("no light is on, and each light has a film", help));
        }
        *self = next;
        Ok(())
    }

    /// Adds a change of a light; `None` for a light as in the job.
    fn add_light(&mut self, name: String, change: Option<LightChange>, parts: &SceneParts) -> Result<(), Fault> {
        let Some(change) = change else {
            self.lights.remove(&name);
            return Ok(());
        };
        let Some((_, kind, _)) = parts.lights.iter().find(|(light, ..)| *light == name) else {
            return Err(unknown("light", &name));
        };
        if !(change.factor.is_finite() && (0.0..=1e6).contains(&change.factor)) {
            let problem = format!("the factor {} of a light is out of range", change.factor);
            return Err(Fault::new(problem, "use 0 to 1000000"));
        }
        parts.check_light(&name, kind, change)?;
        // A light as in the scene is no change.
        if change == LightChange::NONE {
            self.lights.remove(&name);
        } else {
            self.lights.insert(name, change);
        }
        Ok(())
    }

    /// Adds a change of a material; `None` for a material as in the job.
    fn add_material(&mut self, name: String, change: Option<MaterialChange>, parts: &SceneParts) -> Result<(), Fault> {
        let Some(change) = change else {
            self.materials.remove(&name);
            return Ok(());
        };
        let Some(base) = parts.materials.iter().find(|material| material.name == name) else {
            return Err(unknown("material", &name));
        };
        let mut values = change.roughness.iter().chain(&change.metallic).chain(change.color.iter().flatten());
        if let Some(value) = values.find(|value| !(0.0..=1.0).contains(*value)) {
            let problem = format!("the value {value} of the material {name:?} is out of range");
            return Err(Fault::new(problem, "use 0 to 1"));
        }
        if change.without_textured(base) != change {
            let problem = format!("a texture multiplies a value of the material {name:?}");
            return Err(Fault::new(problem, "leave out the values that are null in the state"));
        }
        // Values of the scene are no changes: they follow its files.
        let before = self.materials.remove(&name).unwrap_or_default();
        let own = MaterialChange {
            roughness: change.roughness.or(before.roughness),
            metallic: change.metallic.or(before.metallic),
            color: change.color.or(before.color),
        }
        .other_than(base);
        if own != MaterialChange::default() {
            self.materials.insert(name, own);
        }
        Ok(())
    }

    /// The change with the power of the lights times the factors of a camera.
    ///
    /// # Errors
    /// A factor of a light without a power, other than 1. A sun or a directional light may have the factor 0.
    pub(crate) fn with_factors(
        &self,
        parts: &SceneParts,
        factors: Option<&BTreeMap<String, f64>>,
    ) -> Result<Self, Fault> {
        let mut change = self.clone();
        for (name, kind, _) in &parts.lights {
            let factor = factors.and_then(|factors| factors.get(name)).copied().unwrap_or(1.0);
            let light = change.lights.entry(name.clone()).or_insert(LightChange::NONE);
            if factor == 1.0 || !light.on {
                continue;
            }
            parts.check_name(name)?;
            if has_power(kind) {
                light.factor *= factor;
            } else if factor == 0.0 && has_switch(kind) {
                light.on = false;
            } else {
                let problem = format!("the light {name:?} has the factor {factor}, and no power");
                return Err(Fault::new(problem, "set its factor to 1, or change it in the job"));
            }
        }
        Ok(change)
    }

    /// The keys of a job that make the changes of lights and materials.
    pub(crate) fn overrides(&self, parts: &SceneParts) -> Table {
        let mut table = Table::new();
        // A name is that of one light, and no pattern.
        let entry_of = |name: &str| Table::from_iter([("name".to_owned(), Value::from(literal_pattern(name)))]);
        let mut lights = Vec::new();
        for (name, change) in self.lights.iter().filter(|(name, _)| parts.lights.iter().any(|(l, ..)| l == *name)) {
            let mut entry = entry_of(name);
            if !change.on {
                entry.insert("enabled".into(), false.into());
            } else if change.factor != 1.0 {
                // Lights that share a name may have different powers.
                entry.insert("scale".into(), change.factor.into());
            } else {
                continue;
            }
            lights.push(Value::Table(entry));
        }
        let mut materials = Vec::new();
        for base in &parts.materials {
            let Some(change) = self.materials.get(&base.name) else { continue };
            let mut entry = entry_of(&base.name);
            let MaterialChange { roughness, metallic, color } = change.other_than(base);
            roughness.map(|v| entry.insert("roughness".into(), v.into()));
            metallic.map(|v| entry.insert("metallic".into(), v.into()));
            color.map(|c| entry.insert("base_color".into(), c.map(Value::from).to_vec().into()));
            if entry.len() > 1 {
                materials.push(Value::Table(entry));
            }
        }
        for (key, entries) in [("light", lights), ("material", materials)] {
            if !entries.is_empty() {
                table.insert(key.into(), Value::Array(entries));
            }
        }
        table
    }
}

fn unknown(what: &str, name: &str) -> Fault {
    Fault::new(format!("the scene has no {what} {name:?}"), "reload the page")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts() -> SceneParts {
        SceneParts {
            cameras: vec!["above".into()],
            lights: vec![
                ("bar \"left\"".into(), "mesh".into(), 0.25),
                ("sun".into(), "point".into(), 2.0),
                ("moonlight".into(), "directional".into(), 1.0),
                ("sky".into(), "environment".into(), 1.0),
                ("l?mp".into(), "point".into(), 1.0),
                ("spot".into(), "area (1 triangle)".into(), 1.0),
            ],
            materials: vec![MaterialState {
                name: "steel".into(),
                roughness: Some(0.5),
                metallic: Some(1.0),
                color: Some([0.9, 0.9, 0.9]),
                changed: MaterialChange::default(),
            }],
            effects: Vec::new(),
            mixed_names: vec!["spot".into()],
        }
    }

    #[test]
    fn changes_become_keys_of_a_job() {
        let mut change = SceneChange::default();
        let request = r#"{"camera": "above",
            "lights": {"bar \"left\"": {"on": true, "factor": 2.0}, "sun": {"on": false, "factor": 1.0}},
            "materials": {"steel": {"roughness": 0.3, "metallic": 1.0, "color": [0.1, 0.2, 0.3]}}}"#;
        change.add(serde_json::from_str(request).expect("JSON"), &parts()).expect("names of the scene");
        let text = toml::to_string(&change.overrides(&parts())).expect("TOML");
        let read: Table = text.parse().expect("TOML");
        let light = |i: usize| read["light"][i].clone();
        assert_eq!(light(0)["name"].as_str(), Some("bar \"left\""));
        assert_eq!(light(0)["scale"].as_float(), Some(2.0));
        assert_eq!(light(1)["enabled"].as_bool(), Some(false));
        assert_eq!(read["material"][0]["base_color"][2].as_float(), Some(0.3));
        assert_eq!(read["material"][0].get("metallic"), None, "the value of the scene needs no key");
        assert_eq!(change.materials["steel"].metallic, None, "and is no change");
        let same = r#"{"materials": {"steel": {"roughness": 0.5, "metallic": 1.0, "color": [0.9, 0.9, 0.9]}}}"#;
        let mut unchanged = SceneChange::default();
        unchanged.add(serde_json::from_str(same).expect("JSON"), &parts()).expect("values of the scene");
        assert_eq!(unchanged, SceneChange::default());
        // A scene without these parts has no such changes.
        assert!(change.restricted_to(&SceneParts::default()).overrides(&parts()).is_empty());
    }

    /// Requests of two pages at the same moment: each contains its own light, and none takes back the other one.
    #[test]
    fn later_requests_keep_the_changes_of_other_parts() {
        let mut change = SceneChange::default();
        let mut add = |request: &str| {
            change.add(serde_json::from_str(request).expect("JSON"), &parts()).expect("names of the scene");
            change.clone()
        };
        add(r#"{"lights": {"sun": {"on": true, "factor": 3}}, "materials": {"steel": {"roughness": 0.1}}}"#);
        let both =
            add(r#"{"lights": {"bar \"left\"": {"on": false, "factor": 1}}, "materials": {"steel": {"metallic": 0}}}"#);
        assert_eq!(both.lights["sun"], LightChange { on: true, factor: 3.0 });
        assert!(!both.lights["bar \"left\""].on);
        let steel = both.materials["steel"];
        assert_eq!((steel.roughness, steel.metallic, steel.color), (Some(0.1), Some(0.0), None));
        // The value of the job is no change, and null takes back all changes of a part.
        let back = add(r#"{"materials": {"steel": {"roughness": 0.5}}}"#);
        assert_eq!((back.materials["steel"].roughness, back.materials["steel"].metallic), (None, Some(0.0)));
        let back = add(r#"{"lights": {"sun": null}, "materials": {"steel": null}}"#);
        assert!(!back.lights.contains_key("sun") && back.lights.len() == 1 && back.materials.is_empty());
        // Effects one by one, in one order.
        add(r#"{"effects": {"textures": false}}"#);
        let two = add(r#"{"effects": {"environment": false, "sheen": true}}"#).without;
        assert_eq!(two.len(), 2);
        add(r#"{"effects": {"textures": true}}"#);
        assert_eq!(add(r#"{"effects": {"textures": false}}"#).without, two);
        assert_eq!(add(r#"{"effects": {"textures": true, "environment": true}}"#).without, []);
    }

    /// A name with `?` is that of one light.
    #[test]
    fn names_are_no_patterns() {
        let mut change = SceneChange::default();
        let request = r#"{"lights": {"l?mp": {"on": false, "factor": 1}}}"#;
        change.add(serde_json::from_str(request).expect("JSON"), &parts()).expect("a name of the scene");
        let name = change.overrides(&parts())["light"][0]["name"].clone();
        let matches = |light: &str| dunkelfeld::io::matches(name.as_str().expect("a text"), light);
        assert!(matches("l?mp") && !matches("lamp"), "{name}");
    }

    /// Without textures, their mean is in the values of the scene, which a value of a job would multiply.
    #[test]
    fn textured_values_have_no_knob_without_textures() {
        let mut before = parts().materials;
        before[0].color = None;
        let mut without = parts();
        without.keep_values_of(&before);
        assert_eq!((without.materials[0].color, without.materials[0].roughness), (None, Some(0.5)));
        // A colour that was changed before the texture came is kept for a scene without it, and not made.
        let mut change = SceneChange::default();
        let request = r#"{"materials": {"steel": {"color": [0.1, 0.2, 0.3]}}}"#;
        change.add(serde_json::from_str(request).expect("JSON"), &parts()).expect("a value of the scene");
        assert!(change.restricted_to(&without).materials.is_empty());
        change
            .add(serde_json::from_str(r#"{"materials": {"steel": {"roughness": 0.1}}}"#).expect("JSON"), &without)
            .expect("a value of the scene");
        let made = change.restricted_to(&without).materials["steel"];
        assert_eq!((made.roughness, made.color), (Some(0.1), None));
        assert_eq!(change.restricted_to(&parts()).materials["steel"].color, Some([0.1, 0.2, 0.3]));
        let fault = change.add(serde_json::from_str(request).expect("JSON"), &without).expect_err("a textured value");
        assert!(fault.problem.contains("texture"), "{fault}");
    }

    /// A light whose name becomes that of lights of another kind, or that has no power any more, is not half changed.
    #[test]
    fn changes_that_the_lights_do_not_allow_any_more_are_not_made() {
        let mut change = SceneChange::default();
        change.lights.insert("spot".into(), LightChange { on: false, factor: 1.0 });
        change.lights.insert("moonlight".into(), LightChange { on: true, factor: 3.0 });
        change.lights.insert("sky".into(), LightChange { on: false, factor: 1.0 });
        change.lights.insert("sun".into(), LightChange { on: true, factor: 2.0 });
        let made = change.restricted_to(&parts());
        assert_eq!(made.lights.keys().collect::<Vec<_>>(), ["sun"]);
        let unmade: Vec<String> = change.unmade(&parts()).into_iter().map(|fault| fault.problem).collect();
        assert!(unmade.len() == 3 && unmade.iter().any(|problem| problem.contains("\"spot\"")), "{unmade:?}");
        let mut separate = parts();
        separate.mixed_names.clear();
        assert!(!change.restricted_to(&separate).lights["spot"].on, "the change is kept");
        // A light as in the scene is no change.
        let back = r#"{"lights": {"sun": {"on": true, "factor": 1}, "spot": {"on": true, "factor": 1}}}"#;
        change.add(serde_json::from_str(back).expect("JSON"), &parts()).expect("no changes");
        assert_eq!(change.lights.keys().collect::<Vec<_>>(), ["moonlight", "sky"]);
    }

    /// Factors of a camera are those of the power. Lights without a power have none.
    #[test]
    fn factors_of_lights_become_their_power() {
        let mut change = SceneChange::default();
        let request = r#"{"per_light": true, "lights": {"bar \"left\"": {"on": true, "factor": 2.0}}}"#;
        change.add(serde_json::from_str(request).expect("JSON"), &parts()).expect("names of the scene");
        assert!(change.per_light);
        let factors = |list: &[(&str, f64)]| -> BTreeMap<String, f64> {
            list.iter().map(|(name, factor)| ((*name).to_owned(), *factor)).collect()
        };
        let given = factors(&[("bar \"left\"", 0.5), ("sun", 3.0), ("moonlight", 0.0), ("sky", 1.0)]);
        let table = change.with_factors(&parts(), Some(&given)).expect("powers").overrides(&parts());
        let entries: Vec<String> =
            table["light"].as_array().expect("a list").iter().map(|entry| entry.to_string()).collect();
        assert_eq!(entries, [r#"{ enabled = false, name = "moonlight" }"#, r#"{ name = "sun", scale = 3.0 }"#]);
        assert_eq!(
            change.with_factors(&parts(), None).expect("no factors").overrides(&parts()),
            change.overrides(&parts())
        );
        for wrong in [("moonlight", 0.5), ("sky", 2.0), ("sky", 0.0), ("spot", 2.0)] {
            assert!(change.with_factors(&parts(), Some(&factors(&[wrong]))).is_err(), "{wrong:?}");
        }
        // A light that is off stays off.
        change.lights.insert("sun".into(), LightChange { on: false, factor: 1.0 });
        let given = factors(&[("sun", 3.0)]);
        let changed = change.with_factors(&parts(), Some(&given)).expect("off");
        assert_eq!(changed.lights["sun"], LightChange { on: false, factor: 1.0 });
    }

    #[test]
    fn unknown_names_and_numbers_are_refused_and_change_nothing() {
        for request in [
            r#"{"camera": "left"}"#,
            r#"{"lights": {"moon": {"on": true, "factor": 1}}}"#,
            r#"{"lights": {"sun": {"on": true, "factor": -1}}}"#,
            r#"{"materials": {"gold": {}}}"#,
            r#"{"materials": {"steel": {"roughness": 1.5}}}"#,
            r#"{"materials": {"steel": {"color": [0.5, 0.5, -0.1]}}}"#,
            r#"{"lights": {"moonlight": {"on": true, "factor": 2}}}"#,
            r#"{"lights": {"sky": {"on": false, "factor": 1}}}"#,
            r#"{"lights": {"spot": {"on": false, "factor": 1}}}"#,
            r#"{"lights": {"spot": {"on": true, "factor": 3}}}"#,
            r#"{"effects": {"gravity": false}}"#,
            r#"{"effects": {"color": false}}"#,
            r#"{"camera": "above", "effects": {"textures": false, "gravity": true}}"#,
        ] {
            let mut change = SceneChange::default();
            let fault = change.add(serde_json::from_str(request).expect("JSON"), &parts());
            assert!(fault.is_err(), "{request}");
            assert_eq!(change, SceneChange::default(), "{request}");
        }
    }
}
