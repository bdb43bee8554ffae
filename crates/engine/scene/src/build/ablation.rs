//! Scenes without an effect. The description is changed before it is compiled, so that a disabled effect costs no time.

use crate::build::builder::{PunctualKind, SceneBuilder};
use crate::build::effects::Effect;
use crate::camera::shutter::Shutter;
use crate::light::emission_profile::EmissionProfile;
use crate::material::texture::Image;
use crate::material::texture_eval::Texel;
use crate::material::{AlphaMode, Material, Parameter, Surface, Volume};
use crate::media::medium::Medium;
use dunkelfeld_geometry::RigidMotion;
use dunkelfeld_radiometry::Rgb;
use std::sync::Arc;

impl SceneBuilder {
    /// Changes the scene so that it no longer needs an effect. The table lists the replacements:
    ///
    /// | left out | instead |
    /// |---|---|
    /// | textures | their means |
    /// | vertex colours, normal maps, interpolated normals | white, flat, flat |
    /// | finishes, rounded edges | a smooth surface, sharp edges |
    /// | coverage | the surface covers fully |
    /// | thin sheets, refraction | light passes straight, without reflection; tint and absorption stay |
    /// | absorption, scattering | the other one of the two stays |
    /// | diffuse transmission, anisotropy, sheen, clear coats, energy compensation | none |
    /// | emission profiles | the same power in a Lambertian distribution |
    /// | finite apertures, distortion, blur of the lens | a pinhole, an ideal image, a sharp one without glare |
    /// | motion | every object rests in its pose at time 0 |
    /// | line scan | all rows are exposed at once, for the exposure time of all stages together |
    /// | environment, punctual lights, light profiles | dark |
    /// | every light | one light is sampled, chosen by its estimated contribution: other noise, the same expected image |
    /// | the connection through covers | only scattering samples light behind a cover: more noise, the same expected image |
    /// | learned roulette | survival probabilities by the throughput of a path: other noise, the same expected image |
    ///
    /// Returns false if the effect cannot be left out: nesting, the choice among many lights, and colour.
    pub fn leave_out(&mut self, effect: Effect) -> bool {
        match effect {
            Effect::Nesting | Effect::ManyLights | Effect::Color => return false,
            Effect::VertexColors => self.meshes.iter_mut().for_each(|m| Arc::make_mut(&mut m.mesh).colors.clear()),
            Effect::SmoothNormals => self.meshes.iter_mut().for_each(|m| Arc::make_mut(&mut m.mesh).normals.clear()),
            Effect::RoundedEdges => self.meshes.iter_mut().for_each(|m| m.edge_radius = 0.0),
            Effect::EnergyCompensation => self.energy_compensation = false,
            Effect::FiniteAperture => self.cameras.iter_mut().for_each(|c| c.lens.aperture = None),
            Effect::Distortion => self.cameras.iter_mut().for_each(|c| c.lens.distortion = Default::default()),
            Effect::LensBlur => self.cameras.iter_mut().for_each(|c| c.lens.spread = None),
            Effect::Motion => self.instances.iter_mut().for_each(|i| i.motion = RigidMotion::default()),
            Effect::LineScan => {
                if let Some(Shutter::Lines(lines)) = self.shutter {
                    self.shutter = Some(Shutter::Frame { exposure: lines.total_exposure() });
                }
            }
            Effect::Environment => self.environment = None,
            Effect::PunctualLights => self.lights.retain(|l| matches!(l.kind, PunctualKind::Profile { .. })),
            Effect::LightProfiles => self.lights.retain(|l| !matches!(l.kind, PunctualKind::Profile { .. })),
            Effect::Textures => self.materials.iter_mut().for_each(|m| flatten(m, &self.images)),
            Effect::EveryLight => self.techniques.every_light = false,
            Effect::CoverConnection => self.techniques.cover_connection = false,
            Effect::LearnedRoulette => self.techniques.learned_roulette = false,
            Effect::NormalMaps
            | Effect::Coverage
            | Effect::ThinSheets
            | Effect::DiffuseTransmission
            | Effect::SmoothRefraction
            | Effect::RoughRefraction
            | Effect::Absorption
            | Effect::Scattering
            | Effect::Anisotropy
            | Effect::Finish
            | Effect::Sheen
            | Effect::EmissionProfiles
            | Effect::Clearcoat => self.materials.iter_mut().for_each(|m| simplify(m, effect)),
        }
        true
    }
}

/// Removes an effect from a material.
fn simplify(m: &mut Material, effect: Effect) {
    let volume = |m: &mut Material, to: &dyn Fn(Medium, Volume) -> Volume| {
        if let Surface::Solid(v) = &mut m.surface {
            *v = to(Medium::new(v), *v);
        }
    };
    // Absorption and scattering as coefficients only, without the additional attenuation.
    let stated = |v: Volume| Volume { attenuation_distance: f32::INFINITY, scattering_albedo: Rgb::BLACK, ..v };
    match effect {
        Effect::NormalMaps => m.normal_map.texture = None,
        Effect::Coverage => m.alpha_mode = AlphaMode::Opaque,
        Effect::EmissionProfiles => {
            m.emission.factor *= m.emission_profile.exitance() as f32;
            m.emission_profile = EmissionProfile::Lambertian;
        }
        Effect::DiffuseTransmission => m.diffuse_transmission.share.factor = 0.0,
        Effect::Absorption => {
            volume(m, &|medium, v| Volume { absorption: Rgb::BLACK, scattering: medium.scattering, ..stated(v) })
        }
        Effect::Scattering => {
            volume(m, &|medium, v| Volume { absorption: medium.absorption, scattering: Rgb::BLACK, ..stated(v) })
        }
        Effect::Anisotropy => m.anisotropy.strength = 0.0.into(),
        Effect::Finish => m.height = None,
        Effect::Sheen => m.sheen.color.factor = Rgb::BLACK,
        Effect::Clearcoat => m.clearcoat.strength.factor = 0.0,
        Effect::ThinSheets if m.surface == Surface::Thin && m.transmission.factor > 0.0 => remove_refraction(m),
        Effect::SmoothRefraction if is_refracting(m) && m.is_smooth() => remove_refraction(m),
        Effect::RoughRefraction if is_refracting(m) && !m.is_smooth() => remove_refraction(m),
        _ => {}
    }
}

fn is_refracting(m: &Material) -> bool {
    m.transmission.factor > 0.0 && matches!(m.surface, Surface::Solid(_))
}

/// Light passes the surface in a straight line. Only tint and medium change it.
fn remove_refraction(m: &mut Material) {
    m.ior = 1.0;
    m.roughness = 0.0.into();
}

/// Replaces every texture except the normal map by its mean.
fn flatten(m: &mut Material, images: &[Image]) {
    fn set<T: Texel>(parameter: &mut Parameter<T>, images: &[Image]) {
        *parameter = parameter.mean(images).into();
    }
    if let Some(t) = &m.base_color.texture {
        m.alpha.factor *= t.mean(images)[3];
    }
    let (colors, numbers, _) = m.parameters();
    colors.into_iter().for_each(|color| set(color, images));
    numbers.into_iter().for_each(|number| set(number, images));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::effects::Effects;
    use crate::material::HeightField;
    use crate::material::finish::{Finish, Process};
    use crate::material::texture::{ColorEncoding, ImageId, Texture};
    use crate::material::{Anisotropy, Clearcoat, DiffuseTransmission, NormalMap, Sheen};
    use dunkelfeld_geometry::{Mesh, Vec3, Vec4};

    /// A scene that needs every effect that can be left out, except techniques, which only compiled scenes need.
    fn everything() -> SceneBuilder {
        let mut scene = SceneBuilder { energy_compensation: true, ..SceneBuilder::default() };
        let texels = crate::Texels::Rgba8(vec![[10, 20, 30, 128]]);
        scene.images.push(Image { name: "dot".into(), width: 1, height: 1, texels: texels.into() });
        let texture = Texture::new(ImageId(0), ColorEncoding::Srgb);
        let volume = Volume {
            attenuation_color: Rgb::new(0.5, 0.6, 0.7),
            attenuation_distance: 0.1,
            scattering_albedo: Rgb::splat(0.5),
            ..Volume::default()
        };
        let rich = Material {
            name: "rich".into(),
            base_color: Parameter { factor: Rgb::WHITE, texture: Some(texture) },
            normal_map: NormalMap { texture: Some(texture), scale: 1.0 },
            alpha_mode: AlphaMode::Blend,
            emission: Rgb::WHITE.into(),
            emission_profile: EmissionProfile::CosinePower { exponent: 3.0 },
            diffuse_transmission: DiffuseTransmission { share: 0.2.into(), ..DiffuseTransmission::default() },
            anisotropy: Anisotropy { strength: 0.5.into(), ..Anisotropy::default() },
            height: Some(HeightField::Finish(Finish {
                process: Process::Grained { size: 1e-3 },
                mean_deviation: 1e-6,
                seed: 0,
            })),
            sheen: Sheen { color: Rgb::splat(0.1).into(), ..Sheen::default() },
            clearcoat: Clearcoat { strength: 1.0.into(), ..Clearcoat::default() },
            ..Material::default()
        };
        let clear = |roughness: f32, surface| Material {
            transmission: 1.0.into(),
            roughness: roughness.into(),
            surface,
            ..Material::default()
        };
        let materials =
            [rich, clear(0.0, Surface::Thin), clear(0.0, Surface::Solid(volume)), clear(0.3, Surface::Solid(volume))];
        for material in materials {
            let index = scene.add_material(material);
            let mesh = Mesh { normals: vec![Vec3::Z], colors: vec![Vec4::ONE], ..Mesh::default() };
            scene.add_object("body", mesh, index);
        }
        scene.environment =
            Some(crate::Environment { source: crate::EnvironmentSource::Constant(Rgb::WHITE), rotation: 0.0 });
        let light = |kind| crate::PunctualLight {
            name: "lamp".into(),
            to_world: dunkelfeld_geometry::DAffine3::IDENTITY,
            kind,
        };
        scene.lights.push(light(PunctualKind::Point { intensity: Rgb::WHITE }));
        scene.lights.push(light(PunctualKind::Profile { profile: 0, scale: Rgb::WHITE }));
        let mut camera = crate::Camera::default();
        camera.lens.aperture =
            Some(crate::Aperture { opening: crate::Opening::Radius(0.01), focus_distance: 1.0, blades: None });
        camera.lens.distortion = crate::Distortion { radial: [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], ..Default::default() };
        camera.lens.spread = Some(0.5);
        scene.cameras.push(camera);
        scene.meshes[0].edge_radius = 1e-3;
        scene.instances[0].motion = RigidMotion::linear(dunkelfeld_geometry::DVec3::X);
        scene.shutter = Some(Shutter::Lines(crate::LineScan {
            period: 1e-3,
            exposure: 1e-3,
            stages: 1,
            jitter: 0.0,
            line: 0.5,
            rows: 8,
            in_turn: 1,
        }));
        scene
    }

    #[test]
    fn an_ablated_effect_is_not_required_and_all_others_are() {
        let before = Effects::from_scene(&everything());
        for effect in Effect::ALL.into_iter().filter(|e| !e.is_technique()) {
            let mut scene = everything();
            if !scene.leave_out(effect) {
                continue;
            }
            assert!(before.has(effect), "the scene of this test lacks {}", effect.name());
            let after = Effects::from_scene(&scene);
            assert!(!after.has(effect), "{} is still required by {:?}", effect.name(), after.users(effect));
            for other in Effect::ALL.into_iter().filter(|&o| o != effect && o != Effect::Color && before.has(o)) {
                assert!(after.has(other), "{} went with {}", other.name(), effect.name());
            }
        }
    }

    #[test]
    fn textures_become_their_means() {
        let mut scene = everything();
        assert!(scene.leave_out(Effect::Textures));
        let m = &scene.materials[0];
        assert!((m.alpha.factor - 128.0 / 255.0).abs() < 1e-6);
        let linear = |byte: f32| ((byte / 255.0 + 0.055) / 1.055).powf(2.4);
        assert!((m.base_color.factor.b / Material::default().base_color.factor.b - linear(30.0)).abs() < 1e-5);
        assert!(m.normal_map.texture.is_some(), "normal maps are an effect of their own");
    }

    #[test]
    fn the_remaining_medium_is_unchanged() {
        let of = |scene: &SceneBuilder| match &scene.materials[2].surface {
            Surface::Solid(v) => Medium::new(v),
            Surface::Thin => panic!("the third material of this test is a solid"),
        };
        let before = of(&everything());
        let mut scene = everything();
        assert!(scene.leave_out(Effect::Absorption));
        assert_eq!((of(&scene).scattering, of(&scene).absorption), (before.scattering, Rgb::BLACK));
        let mut scene = everything();
        assert!(scene.leave_out(Effect::Scattering));
        assert_eq!((of(&scene).scattering, of(&scene).absorption), (Rgb::BLACK, before.absorption));
    }
}
