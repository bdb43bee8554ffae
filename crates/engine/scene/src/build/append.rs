//! Several scenes in one: other units and axes, names with a prefix, the parts of a scene added to another one.

use crate::build::builder::{Projection, PunctualKind, SceneBuilder};
use crate::material::Surface;
use crate::material::texture::ImageId;
use dunkelfeld_geometry::{DAffine3, DMat3};

impl SceneBuilder {
    /// Scales the whole scene about the origin by `scale`, after a rotation by `turn`: objects, lights, cameras, and the
    /// lengths of media and orthographic cameras. Radiance, intensity and irradiance keep their values.
    pub fn scale_and_turn(&mut self, scale: f64, turn: DMat3) {
        let map = DAffine3::from_mat3(turn * scale);
        let objects = self.instances.iter_mut().map(|i| &mut i.to_world);
        let lights = self.lights.iter_mut().map(|l| &mut l.to_world);
        let cameras = self.cameras.iter_mut().map(|c| &mut c.to_world);
        for to_world in objects.chain(lights).chain(cameras) {
            *to_world = map * *to_world;
        }
        self.instances.iter_mut().for_each(|i| i.motion = i.motion.mapped(&map));
        for camera in &mut self.cameras {
            if let Projection::Orthographic { half_width, half_height } = &mut camera.projection {
                (*half_width, *half_height) = (*half_width * scale as f32, *half_height * scale as f32);
            }
        }
        for material in &mut self.materials {
            if let Surface::Solid(volume) = &mut material.surface {
                volume.attenuation_distance *= scale as f32;
                volume.absorption *= (1.0 / scale) as f32;
                volume.scattering *= (1.0 / scale) as f32;
            }
        }
    }

    /// Puts a text before the names of all objects, meshes, materials, lights and cameras.
    pub fn prefix_names(&mut self, prefix: &str) {
        let objects = self.instances.iter_mut().map(|i| &mut i.name);
        let meshes = self.meshes.iter_mut().map(|m| &mut m.name);
        let materials = self.materials.iter_mut().map(|m| &mut m.name);
        let lights = self.lights.iter_mut().map(|l| &mut l.name);
        let cameras = self.cameras.iter_mut().map(|c| &mut c.name);
        for name in objects.chain(meshes).chain(materials).chain(lights).chain(cameras) {
            name.insert_str(0, prefix);
        }
    }

    /// Adds all parts of another scene after its own. An environment replaces none. Energy compensation and techniques
    /// remain.
    pub fn append(&mut self, mut other: Self) {
        let (images, materials) = (self.images.len(), self.materials.len());
        let (meshes, profiles) = (self.meshes.len(), self.profiles.len());
        for material in &mut other.materials {
            for texture in material.texture_slots().flatten() {
                texture.image = ImageId(texture.image.0.saturating_add(images as u32));
            }
        }
        other.meshes.iter_mut().for_each(|part| part.material += materials);
        other.instances.iter_mut().flat_map(|i| &mut i.meshes).for_each(|mesh| *mesh += meshes);
        for light in &mut other.lights {
            if let PunctualKind::Profile { profile, .. } = &mut light.kind {
                *profile += profiles;
            }
        }
        self.images.extend(other.images);
        self.materials.extend(other.materials);
        self.meshes.extend(other.meshes);
        self.instances.extend(other.instances);
        self.lights.extend(other.lights);
        self.profiles.extend(other.profiles);
        self.cameras.extend(other.cameras);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::builder::{Camera, PunctualLight};
    use crate::light::luminaire::LightProfile;
    use crate::material::texture::{ColorEncoding, Image, Texels, Texture};
    use crate::material::{Material, Volume};
    use crate::shapes::rectangle;
    use dunkelfeld_geometry::{DVec3, Vec3};
    use dunkelfeld_radiometry::Rgb;

    fn textured() -> SceneBuilder {
        let mut scene = SceneBuilder::default();
        scene.images.push(Image {
            name: "red".into(),
            width: 1,
            height: 1,
            texels: Texels::Rgb8(vec![[255, 0, 0]]).into(),
        });
        let mut paint = Material {
            name: "paint".into(),
            surface: Surface::Solid(Volume { attenuation_distance: 2.0, scattering: Rgb::WHITE, ..Volume::default() }),
            ..Material::default()
        };
        paint.texture_slots().for_each(|slot| *slot = Some(Texture::new(ImageId(0), ColorEncoding::Linear)));
        let material = scene.add_material(paint);
        scene.add_object("plate", rectangle(Vec3::ZERO, Vec3::X, Vec3::Y), material);
        let profile = LightProfile::new("lamp", &[0.0, 180.0], &[0.0], vec![1.0, 1.0]).expect("a profile");
        scene.profiles.push(profile);
        scene.lights.push(PunctualLight {
            name: "bulb".into(),
            to_world: DAffine3::from_translation(DVec3::Z),
            kind: PunctualKind::Profile { profile: 0, scale: Rgb::WHITE },
        });
        scene.cameras.push(Camera {
            name: "above".into(),
            projection: Projection::Orthographic { half_width: 4.0, half_height: 3.0 },
            ..Camera::default()
        });
        scene
    }

    #[test]
    fn indices_of_an_appended_scene_refer_to_its_own_parts() {
        let mut both = textured();
        let mut second = textured();
        second.prefix_names("b/");
        both.append(second);
        assert_eq!(both.instances[1].meshes, [1]);
        assert_eq!((both.meshes[1].material, both.instances[1].name.as_str()), (1, "b/plate"));
        assert_eq!((both.materials[1].name.as_str(), both.cameras[1].name.as_str()), ("b/paint", "b/above"));
        assert!(both.materials[1].textures().all(|t| t.image == ImageId(1)), "{:?}", both.materials[1]);
        assert_eq!(both.materials[1].textures().count(), 15);
        assert!(matches!(both.lights[1].kind, PunctualKind::Profile { profile: 1, .. }));
        assert!(both.materials[0].textures().all(|t| t.image == ImageId(0)));
    }

    #[test]
    fn units_and_axes_apply_to_all_lengths() {
        let mut scene = textured();
        let z_up = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
        scene.scale_and_turn(0.5, z_up);
        assert_eq!(scene.lights[0].to_world.translation, 0.5 * DVec3::Y, "+z became +y");
        assert_eq!(scene.instances[0].to_world.transform_point3(DVec3::Y), -0.5 * DVec3::Z);
        assert!(matches!(scene.cameras[0].projection, Projection::Orthographic { half_width: 2.0, half_height: 1.5 }));
        let Surface::Solid(volume) = scene.materials[0].surface else { panic!("a solid") };
        assert_eq!((volume.attenuation_distance, volume.scattering), (1.0, Rgb::splat(2.0)));
    }
}
