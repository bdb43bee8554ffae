//! Scenes in which one light emits. Light is additive: the images of the lights of a scene add up to its image.

use crate::build::builder::SceneBuilder;
use crate::material::Material;
use dunkelfeld_radiometry::Rgb;
use std::collections::HashMap;

/// The name of the environment among the lights.
pub(crate) const ENVIRONMENT: &str = "environment";

impl SceneBuilder {
    /// Changes the scene so that only one light emits: the emitting surfaces of the objects with this name, the punctual
    /// lights with this name, and the environment if the name is `environment`, as in
    /// [`Scene::light_inventory`](crate::Scene::light_inventory). All other sources become dark. Their surfaces stay and
    /// scatter as before. So the radiance of the scenes of all lights adds up to that of this scene. A name that no light
    /// has leaves a dark scene.
    pub fn keep_light(&mut self, name: &str) {
        self.lights.retain(|light| light.name == name);
        if name != ENVIRONMENT {
            self.environment = None;
        }
        let is_emitting = |mesh: usize| {
            let part = self.meshes.get(mesh)?;
            self.materials.get(part.material).filter(|material| emits(material)).map(|_| part.material)
        };
        // The emitting meshes of the light and of the others, with their materials.
        let (mut kept, mut others) = (HashMap::new(), Vec::new());
        for instance in &self.instances {
            for &mesh in &instance.meshes {
                let Some(material) = is_emitting(mesh) else { continue };
                if instance.name == name {
                    kept.insert(mesh, material);
                } else if !others.contains(&(mesh, material)) {
                    others.push((mesh, material));
                }
            }
        }
        // A material or a mesh of the light is copied for the others.
        let mut dark_materials = HashMap::new();
        let mut dark_meshes = HashMap::new();
        for (mesh, material) in others {
            let is_shared = kept.values().any(|of_light| *of_light == material);
            let dark = *dark_materials.entry(material).or_insert_with(|| {
                if is_shared {
                    self.materials.push(self.materials[material].clone());
                }
                let dark = if is_shared { self.materials.len() - 1 } else { material };
                darken(&mut self.materials[dark]);
                dark
            });
            if kept.contains_key(&mesh) {
                self.meshes.push(self.meshes[mesh].clone());
                dark_meshes.insert(mesh, self.meshes.len() - 1);
            }
            let mesh = dark_meshes.get(&mesh).copied().unwrap_or(mesh);
            self.meshes[mesh].material = dark;
        }
        let of_others = self.instances.iter_mut().filter(|instance| instance.name != name);
        for mesh in of_others.flat_map(|instance| &mut instance.meshes) {
            *mesh = dark_meshes.get(mesh).copied().unwrap_or(*mesh);
        }
    }
}

fn emits(material: &Material) -> bool {
    material.unlit || !material.emission.is_black()
}

/// Removes the emission. An unlit surface absorbs all light, and stays unlit.
fn darken(material: &mut Material) {
    material.emission = Rgb::BLACK;
    if material.unlit {
        material.base_color = Rgb::BLACK;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::builder::{Environment, EnvironmentSource, PunctualKind, PunctualLight};
    use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, Vec3};

    fn triangle() -> Mesh {
        Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]], ..Mesh::default() }
    }

    /// Two lamps with one mesh, one with another mesh of their material, an unlit sign, a point light, an environment,
    /// and a dark floor.
    fn scene() -> SceneBuilder {
        let mut scene = SceneBuilder::default();
        let glow = scene.add_material(Material { name: "glow".into(), emission: Rgb::WHITE, ..Material::default() });
        let sign = scene.add_material(Material { name: "sign".into(), unlit: true, ..Material::default() });
        let floor = scene.add_material(Material { name: "floor".into(), ..Material::default() });
        for (i, (name, material)) in
            [("left", glow), ("right", glow), ("other", glow), ("sign", sign), ("floor", floor)].into_iter().enumerate()
        {
            scene.add_object(name, triangle(), material);
            scene.instances[i].to_world = DAffine3::from_translation(DVec3::X * i as f64);
        }
        scene.instances[1].meshes = scene.instances[0].meshes.clone();
        scene.lights.push(PunctualLight {
            name: "point".into(),
            to_world: DAffine3::IDENTITY,
            kind: PunctualKind::Point { intensity: Rgb::WHITE },
        });
        scene.environment = Some(Environment { source: EnvironmentSource::Constant(Rgb::WHITE), rotation: 0.0 });
        scene
    }

    fn lights(scene: SceneBuilder) -> Vec<(String, f32)> {
        let (scene, _) = scene.build().expect("a valid scene");
        let all = scene.light_inventory().into_iter().map(|light| (light.name, light.power.mean()));
        all.filter(|(_, power)| *power > 0.0).collect()
    }

    #[test]
    fn each_light_is_in_exactly_one_scene() {
        let all = lights(scene());
        let names: Vec<&str> = all.iter().map(|(name, _)| &name[..]).collect();
        assert_eq!(names, ["left", "right", "other", "sign", "point", "environment"]);
        for light in &all {
            let mut one = scene();
            one.keep_light(&light.0);
            assert_eq!(one.instances.len(), 5, "surfaces stay");
            assert_eq!(lights(one), std::slice::from_ref(light));
        }
        let mut none = scene();
        none.keep_light("floor");
        assert_eq!(lights(none), []);
    }

    /// Sources with one name are one light.
    #[test]
    fn sources_of_one_name_are_kept_together() {
        let mut one = scene();
        one.instances[2].name = "point".into();
        one.keep_light("point");
        let names: Vec<String> = lights(one).into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["point", "point"]);
    }

    #[test]
    fn materials_of_dark_surfaces_differ_only_in_emission() {
        let (before, mut one) = (scene(), scene());
        one.keep_light("left");
        let material = |scene: &SceneBuilder, object: usize| {
            scene.materials[scene.meshes[scene.instances[object].meshes[0]].material].clone()
        };
        assert_eq!(material(&one, 0), material(&before, 0));
        assert_eq!(material(&one, 1), Material { emission: Rgb::BLACK, ..material(&before, 1) });
        assert_eq!(material(&one, 2), Material { emission: Rgb::BLACK, ..material(&before, 2) });
        assert_eq!(material(&one, 3), Material { base_color: Rgb::BLACK, ..material(&before, 3) });
        assert_eq!(material(&one, 4), material(&before, 4));
    }
}
