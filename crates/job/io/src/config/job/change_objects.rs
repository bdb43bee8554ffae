//! Applies `[[object]]` of a job to the objects of a scene.

use super::change_materials::new_material;
use super::move_objects::{OwnMotion, OwnMotions};
use super::objects::{MOST_OBJECTS, Placement, about};
use super::patterns::{matches, unique};
use super::place::no_object;
use super::primitives::Primitive;
use super::{Job, ObjectOverride, Pivot};
use crate::error::InputError;
use crate::names::suggestion;
use crate::toml_file::TomlFile;
use crate::toml_keys::TableKeys;
use dunkelfeld_geometry::{DAffine3, DVec3, Transform};
use dunkelfeld_scene::{Instance, MeshPart, SceneBuilder};
use std::collections::HashMap;

/// Most emitting triangles that copies add. Each is a light of its own, also if its mesh is shared.
const MOST_EMITTERS: u64 = 4_000_000;

impl ObjectOverride {
    /// Reads the entries of a job.
    pub(super) fn read_all(file: &TomlFile) -> Result<Vec<Self>, InputError> {
        let read = |mut keys: TableKeys<'_>| {
            let shape = Primitive::read(&mut keys)?;
            let object = Self { shape, ..keys.rest()? };
            object.check(&keys).map(|()| object)
        };
        TableKeys::of_list(file, "object").into_iter().map(read).collect()
    }

    /// Checks that no keys exclude each other.
    fn check(&self, keys: &TableKeys<'_>) -> Result<(), InputError> {
        let moves = [
            ("translate", self.translate.is_some()),
            ("rotate", self.rotate.is_some()),
            ("scale", self.scale.is_some()),
        ];
        // A new object keeps its keys: a study removes it in some of its images.
        let removed = Self { name: self.name.clone(), visible: false, ..Self::default() };
        if !self.visible && self.shape.is_none() && *self != removed {
            let problem = "an object that `visible = false` removes has no other keys than its name";
            return Err(keys.error("visible", problem, "remove this, or the other keys"));
        }
        if let (Some(_), Some((key, _))) = (self.matrix, moves.iter().find(|(_, given)| *given)) {
            let problem = format!("`{key}` and `matrix` exclude each other");
            return Err(keys.error(key, problem, "write the whole placement into one of them"));
        }
        if self.grid.is_some() && self.instances.is_some() {
            return Err(keys.error("grid", "`instances` and `grid` exclude each other", "keep one of them"));
        }
        if self.instances.as_ref().is_some_and(Vec::is_empty) {
            let help = "list placements such as { translate = [0.1, 0, 0] }, or remove the object by `visible = false`";
            return Err(keys.error("instances", "the list of copies is empty", help));
        }
        let turns = self.placement().has_fixed_point() || self.instances().iter().any(Placement::has_fixed_point);
        if self.pivot != Pivot::Origin && !turns && self.matrix.is_none() {
            let problem = "a pivot has no effect without a rotation or a scale";
            return Err(keys.error("pivot", problem, "add `rotate` or `scale`, or remove it"));
        }
        if self.name.is_empty() {
            return Err(keys.error("name", "the name is empty", "write the name of an object"));
        }
        if self.shape.is_some() && self.name.contains(['*', '?']) {
            let problem = "a new object cannot have a pattern as its name";
            return Err(keys.error("name", problem, "write a name without `*` and `?`"));
        }
        Ok(())
    }
}

impl Job {
    /// Applies all `[[object]]` entries to a scene, in order. Returns the motions that they contain, by object.
    pub(super) fn change_all_objects(&self, scene: &mut SceneBuilder) -> Result<OwnMotions, InputError> {
        let mut own = OwnMotions::default();
        for (i, change) in self.objects.iter().enumerate() {
            let objects = self.change_objects(i, change, scene, &mut own)?;
            self.move_objects(i, change, &objects, scene, &mut own)?;
        }
        Ok(own)
    }

    /// Applies entry `i`, and returns the indices of the objects that it leaves, in ascending order.
    pub(super) fn change_objects(
        &self,
        i: usize,
        change: &ObjectOverride,
        scene: &mut SceneBuilder,
        own: &mut OwnMotions,
    ) -> Result<Vec<usize>, InputError> {
        if let Some(shape) = &change.shape {
            self.add_primitive(i, shape, change, scene)?;
        }
        own.0.resize(scene.instances.len(), OwnMotion::default());
        let selected = self.selected_objects(i, change, scene)?;
        if !change.visible {
            let mut removed = scene.instances.iter().map(|n| matches(&change.name, &n.name));
            own.0.retain(|_| !removed.next().unwrap_or(false));
            scene.instances.retain(|n| !matches(&change.name, &n.name));
            return Ok(Vec::new());
        }
        if let Some(material) = &change.material {
            self.assign_material(i, material, &selected, scene)?;
        }
        if let Some(radius) = change.edge_radius {
            change_meshes(&selected, scene, |part| part.edge_radius = radius as f32);
        }
        self.check_copies(i, change, &selected, scene)?;
        let common = match &change.pivot {
            Pivot::At(place) => {
                Some(place.resolve(scene).map_err(|e| self.object_error(i, "pivot", e.problem, e.help))?)
            }
            Pivot::Origin => Some(DVec3::ZERO),
            Pivot::Center => None,
        };
        let (mut changed, mut copies) = (selected.clone(), Vec::new());
        for index in selected {
            let Some(object) = scene.instances.get(index) else { continue };
            let center =
                || scene.bounds_of(object).map_or(object.to_world.translation, |[low, high]| 0.5 * (low + high));
            let kept = own.0.get(index).copied().unwrap_or_default();
            let mut placed = self.placed(i, change, object, common.unwrap_or_else(center), kept)?.into_iter();
            if let (Some(target), Some(first)) = (scene.instances.get_mut(index), placed.next()) {
                *target = first;
            }
            own.0.extend(std::iter::repeat_n(kept, placed.len()));
            copies.extend(placed);
        }
        changed.extend(scene.instances.len()..scene.instances.len() + copies.len());
        scene.instances.extend(copies);
        Ok(changed)
    }

    /// The indices of the objects of entry `i`.
    fn selected_objects(
        &self,
        i: usize,
        change: &ObjectOverride,
        scene: &SceneBuilder,
    ) -> Result<Vec<usize>, InputError> {
        let is_named = |name: &str| matches(&change.name, name);
        let objects = scene.instances.iter().enumerate().filter(|(_, object)| is_named(&object.name));
        let selected: Vec<usize> = objects.map(|(k, _)| k).collect();
        if !selected.is_empty() {
            return Ok(selected);
        }
        let InputError { problem, mut help, .. } = no_object(&change.name, scene);
        if scene.lights.iter().any(|l| is_named(&l.name)) {
            help = "this is the name of a light without a body; change it by [[light]]".into();
        } else if scene.cameras.iter().any(|c| is_named(&c.name)) {
            help = "this is the name of a camera, which is no object".into();
        }
        Err(self.object_error(i, "name", problem, help))
    }

    /// An object at its new place, or the copies that replace it.
    fn placed(
        &self,
        i: usize,
        change: &ObjectOverride,
        object: &Instance,
        pivot: DVec3,
        own: OwnMotion,
    ) -> Result<Vec<Instance>, InputError> {
        let map = match change.matrix {
            Some(matrix) => about(matrix, pivot, DVec3::ZERO),
            None => change.placement().about(pivot),
        };
        let place = map * object.to_world;
        // A scale beyond the range of f32 would make the object vanish in the build.
        if Transform::new(object.to_world).is_ok() {
            self.check_place(i, place, object)?;
        }
        let moved = |to_world: DAffine3, map: &DAffine3| {
            let motion = own.mapped(&object.motion, map);
            Instance { to_world, motion, ..object.clone() }
        };
        if change.copies().is_none() {
            return Ok(vec![moved(place, &map)]);
        }
        // The pivot moves with the object.
        let maps = (1..).zip(change.copy_maps(map.transform_point3(pivot)));
        maps.map(|(number, copy)| {
            let name = format!("{} {number}", object.name);
            let copied = Instance { name, ..moved(copy * place, &(copy * map)) };
            if change.grid.is_none() {
                self.check_place(i, copied.to_world, &copied)?;
            }
            Ok(copied)
        })
        .collect()
    }

    fn check_place(&self, i: usize, place: DAffine3, object: &Instance) -> Result<(), InputError> {
        Transform::new(place).map(drop).map_err(|e| {
            let problem = format!("the place of \"{}\" cannot be used: {e}", object.name);
            self.object_error(i, "name", problem, "check the factors of its scale")
        })
    }

    fn add_primitive(
        &self,
        i: usize,
        shape: &Primitive,
        change: &ObjectOverride,
        scene: &mut SceneBuilder,
    ) -> Result<(), InputError> {
        if scene.instances.iter().any(|n| matches(&change.name, &n.name)) {
            let problem = format!("the scene already has an object named \"{}\"", change.name);
            let help = "give the new object another name, or remove `kind` to change the existing one";
            return Err(self.object_error(i, "name", problem, help));
        }
        // The material of the same name lets `[[material]]` change a new object without another entry.
        let material = match &change.material {
            Some(_) => 0,
            None => scene.add_material(new_material(&change.name)),
        };
        scene.add_object(&change.name, shape.mesh(), material);
        Ok(())
    }

    /// Gives all parts of the objects a material.
    fn assign_material(
        &self,
        i: usize,
        name: &str,
        selected: &[usize],
        scene: &mut SceneBuilder,
    ) -> Result<(), InputError> {
        let Some(material) = scene.materials.iter().position(|m| m.name == name) else {
            let known = unique(scene.materials.iter().map(|m| m.name.as_str()));
            let help =
                format!("{}; a new one needs [[material]] with `new = true`", suggestion(name, "materials", &known));
            return Err(self.object_error(i, "material", format!("the scene has no material named \"{name}\""), help));
        };
        change_meshes(selected, scene, |part| part.material = material);
        Ok(())
    }

    /// Refuses copies that would need much memory.
    fn check_copies(
        &self,
        i: usize,
        change: &ObjectOverride,
        selected: &[usize],
        scene: &SceneBuilder,
    ) -> Result<(), InputError> {
        let Some(copies) = change.copies() else { return Ok(()) };
        let key = if change.grid.is_some() { "grid" } else { "instances" };
        let objects = copies.saturating_mul(selected.len() as u64).saturating_add(scene.instances.len() as u64);
        if objects > MOST_OBJECTS {
            let problem = format!("the scene would have {objects} objects");
            return Err(self.object_error(i, key, problem, format!("make copies for at most {MOST_OBJECTS} objects")));
        }
        let emits = |material: usize| scene.materials.get(material).is_some_and(|m| !m.emission.factor.is_black());
        let parts = selected.iter().filter_map(|k| scene.instances.get(*k)).flat_map(|n| &n.meshes);
        let parts = parts.filter_map(|m| scene.meshes.get(*m)).filter(|part| emits(part.material));
        let emitters: u64 = parts.map(|part| part.mesh.triangles.len() as u64).sum();
        if emitters.saturating_mul(copies) > MOST_EMITTERS {
            let problem = format!("the copies would have {} emitting triangles", emitters.saturating_mul(copies));
            let help = format!("make fewer copies, with at most {MOST_EMITTERS} emitting triangles together");
            return Err(self.object_error(i, key, problem, help));
        }
        Ok(())
    }

    pub(super) fn object_error(
        &self,
        i: usize,
        key: &str,
        problem: impl Into<String>,
        help: impl Into<String>,
    ) -> InputError {
        self.source.error_at_key(&["object", &i.to_string(), key], problem, help)
    }
}

/// Changes all meshes of the objects. Meshes that other objects use as well are copied once.
fn change_meshes(selected: &[usize], scene: &mut SceneBuilder, change: impl Fn(&mut MeshPart)) {
    let mut uses: HashMap<usize, usize> = HashMap::new();
    for mesh in scene.instances.iter().flat_map(|n| &n.meshes) {
        *uses.entry(*mesh).or_default() += 1;
    }
    for mesh in selected.iter().filter_map(|k| scene.instances.get(*k)).flat_map(|n| &n.meshes) {
        if let Some(left) = uses.get_mut(mesh) {
            *left -= 1;
        }
    }
    let mut changed: HashMap<usize, usize> = HashMap::new();
    for index in selected {
        let Some(object) = scene.instances.get_mut(*index) else { continue };
        for mesh in &mut object.meshes {
            if let Some(own) = changed.get(mesh) {
                *mesh = *own;
                continue;
            }
            let Some(part) = scene.meshes.get_mut(*mesh) else { continue };
            let (old, mut own) = (*mesh, part.clone());
            change(&mut own);
            let is_same = (own.material, own.edge_radius) == (part.material, part.edge_radius);
            if uses.get(mesh).is_some_and(|others| *others > 0) && !is_same {
                scene.meshes.push(own);
                *mesh = scene.meshes.len() - 1;
            } else {
                *part = own;
            }
            changed.insert(old, *mesh);
        }
    }
}
