//! glTF materials: metallic-roughness and the KHR_materials extensions.

use super::document::Document;
use super::extensions::{OfMaterial, OfNormalTexture};
use super::reader::Reader;
use crate::import::options::{EmissiveUnit, LUMENS_PER_WATT};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{
    AlphaMode, Anisotropy, Clearcoat, ColorEncoding, DiffuseTransmission, Material, Sheen, Surface, Texture, Volume,
};
use gltf::json;
use gltf::json::extensions::{material as typed, texture};
use gltf::json::material::AlphaMode as JsonAlphaMode;
use gltf::json::texture::Info;
use gltf::json::validation::Checked;

/// The material of a primitive that has none (glTF 2.0, section 3.7.2.1).
pub(super) fn default_material() -> Material {
    Material { name: "default".into(), metallic: 1.0.into(), roughness: 1.0.into(), ..Material::default() }
}

/// A material of the file: the part typed by `gltf::json`, and the rest.
pub(super) struct Source<'a> {
    index: usize,
    name: String,
    material: &'a json::Material,
    extensions: Option<&'a typed::Material>,
    untyped: &'a OfMaterial,
    normal: &'a OfNormalTexture,
}

impl<'a> Source<'a> {
    /// `None` if there is no such material.
    pub(super) fn new(document: &'a Document, index: usize) -> Option<Self> {
        let material = document.root.materials.get(index)?;
        Some(Self {
            index,
            name: super::name(&[material.name.as_deref()], "material", index),
            material,
            extensions: material.extensions.as_ref(),
            untyped: &document.untyped.materials.get(index)?.extensions,
            normal: &document.untyped.materials.get(index)?.normal_texture.extensions,
        })
    }

    /// Index for messages.
    pub(super) fn place(&self) -> String {
        format!("material {} \"{}\"", self.index, self.name)
    }
}

/// Converts a material. Occlusion and thickness textures are not used: light transport computes both.
pub(super) fn convert(source: &Source<'_>, unit: EmissiveUnit, r: &mut Reader<'_, '_>) -> Material {
    let material = source.material;
    let mut m = Material { name: source.name.clone(), double_sided: material.double_sided, ..default_material() };
    base(source, &mut m, r);
    m.alpha_mode = match material.alpha_mode {
        Checked::Valid(JsonAlphaMode::Opaque) => AlphaMode::Opaque,
        Checked::Valid(JsonAlphaMode::Mask) => {
            let cutoff = material.alpha_cutoff.unwrap_or_default().0;
            AlphaMode::Mask { cutoff: r.within("alphaCutoff", cutoff, 0.0, f32::MAX) }
        }
        Checked::Valid(JsonAlphaMode::Blend) => AlphaMode::Blend,
        Checked::Invalid => {
            r.warn("its alpha mode does not exist; the material is opaque");
            AlphaMode::Opaque
        }
    };
    normal_map(source, &mut m, r);
    emission(source, unit, &mut m, r);
    m.unlit = source.extensions.is_some_and(|e| e.unlit.is_some());
    if let Some(extensions) = source.extensions {
        dielectric(extensions, source.untyped, &mut m, r);
        layers(source.untyped, &mut m, r);
    }
    m
}

/// Normal textures have a type without the typed extension of the others.
fn normal_map(source: &Source<'_>, m: &mut Material, r: &mut Reader<'_, '_>) {
    let Some(normal) = &source.material.normal_texture else { return };
    let texture_transform = source.normal.transform.clone();
    let info = Info {
        index: normal.index,
        tex_coord: normal.tex_coord,
        extensions: Some(texture::Info { texture_transform, ..texture::Info::default() }),
        extras: None,
    };
    m.normal_map.texture = r.texture(Some(&info), ColorEncoding::Linear);
    m.normal_map.scale = r.within("normal scale", normal.scale, f32::MIN, f32::MAX);
}

fn base(source: &Source<'_>, m: &mut Material, r: &mut Reader<'_, '_>) {
    let pbr = &source.material.pbr_metallic_roughness;
    let [red, green, blue, alpha] = pbr.base_color_factor.0;
    m.base_color.factor = r.color("baseColorFactor", [red, green, blue], 1.0);
    m.alpha.factor = r.unit("baseColorFactor (alpha)", alpha);
    m.base_color.texture = r.texture(pbr.base_color_texture.as_ref(), ColorEncoding::Srgb);
    m.metallic.factor = r.unit("metallicFactor", pbr.metallic_factor.0);
    m.roughness.factor = r.unit("roughnessFactor", pbr.roughness_factor.0);
    m.metallic.texture = r.channel(pbr.metallic_roughness_texture.as_ref(), 2);
    m.roughness.texture = m.metallic.texture.map(|t| Texture { channel: 1, ..t });
}

fn emission(source: &Source<'_>, unit: EmissiveUnit, m: &mut Material, r: &mut Reader<'_, '_>) {
    let strength = source.extensions.and_then(|e| e.emissive_strength.as_ref());
    let strength = strength.map_or(1.0, |e| e.emissive_strength.0);
    let strength = r.within("emissiveStrength", strength, 0.0, f32::MAX);
    let per_unit = match unit {
        EmissiveUnit::Nit => 1.0 / LUMENS_PER_WATT,
        EmissiveUnit::WattPerSteradianSquareMetre => 1.0,
    };
    m.emission.factor = r.color("emissiveFactor", source.material.emissive_factor.0, f32::MAX) * strength * per_unit;
    if !m.emission.factor.is_finite() {
        r.warn("the emission exceeds the range of numbers and is left out");
        m.emission.factor = Rgb::BLACK;
    }
    if !m.emission.factor.is_black() {
        m.emission.texture = r.texture(source.material.emissive_texture.as_ref(), ColorEncoding::Srgb);
    }
}

/// Index of refraction, specular, transmission and volume.
fn dielectric(extensions: &typed::Material, untyped: &OfMaterial, m: &mut Material, r: &mut Reader<'_, '_>) {
    // In KHR_materials_ior, 0 means an infinite index: full reflection, with the colour of specular alone.
    const INFINITE_IOR: f32 = 1000.0;
    m.ior = match extensions.ior.as_ref().map_or(1.5, |e| e.ior.0) {
        0.0 => INFINITE_IOR,
        ior => r.within("ior", ior, 1.0, INFINITE_IOR),
    };
    if let Some(e) = &extensions.specular {
        m.specular.strength.factor = r.unit("specularFactor", e.specular_factor.0);
        m.specular.strength.texture = r.channel(e.specular_texture.as_ref(), 3);
        m.specular.color.factor = r.color("specularColorFactor", e.specular_color_factor.0, f32::MAX);
        m.specular.color.texture = r.texture(e.specular_color_texture.as_ref(), ColorEncoding::Srgb);
    }
    if let Some(e) = &extensions.transmission {
        m.transmission.factor = r.unit("transmissionFactor", e.transmission_factor.0);
        if m.transmission.factor > 0.0 {
            m.transmission.texture = r.channel(e.transmission_texture.as_ref(), 0);
        }
    }
    if let Some(e) = &untyped.diffuse_transmission {
        let DiffuseTransmission { share, color } = &mut m.diffuse_transmission;
        share.factor = r.unit("diffuseTransmissionFactor", e.diffuse_transmission_factor);
        if share.factor > 0.0 {
            share.texture = r.channel(e.diffuse_transmission_texture.as_ref(), 3);
            color.factor = r.color("diffuseTransmissionColorFactor", e.diffuse_transmission_color_factor, 1.0);
            color.texture = r.texture(e.diffuse_transmission_color_texture.as_ref(), ColorEncoding::Srgb);
        }
    }
    if let Some(e) = &extensions.volume {
        let thickness = r.within("thicknessFactor", e.thickness_factor.0, 0.0, f32::MAX);
        let mut distance = e.attenuation_distance.0;
        if distance <= 0.0 {
            r.warn(format!("attenuationDistance {distance} is not above 0; the volume is clear"));
            distance = f32::INFINITY;
        }
        // A channel of exactly 0 would be absorbed immediately, at any distance.
        let color = r.color("attenuationColor", e.attenuation_color.0, 1.0).map(|c| c.max(1e-6));
        if thickness > 0.0 && (m.transmission.factor > 0.0 || m.diffuse_transmission.share.factor > 0.0) {
            let volume = Volume { attenuation_color: color, attenuation_distance: distance, ..Volume::default() };
            m.surface = Surface::Solid(scattering(untyped, volume, r));
        }
    }
}

/// KHR_materials_volume_scatter applied to a volume: its attenuation is extinction, and a part of it is scattered.
fn scattering(untyped: &OfMaterial, volume: Volume, r: &mut Reader<'_, '_>) -> Volume {
    let Some(e) = &untyped.volume_scatter else { return volume };
    let color = r.color("multiscatterColor", e.multiscatter_color.or(e.scatter_albedo).unwrap_or_default(), 1.0);
    let attenuates = volume.attenuation_distance.is_finite() && volume.attenuation_color != Rgb::WHITE;
    if !color.is_black() && !attenuates {
        r.warn("KHR_materials_volume_scatter shares out the attenuation of KHR_materials_volume, and there is none: nothing is scattered; give an attenuationColor and an attenuationDistance");
    }
    Volume {
        scattering_albedo: color.map(single_scattering_albedo),
        scattering_anisotropy: r.within("scatterAnisotropy", e.scatter_anisotropy, -0.9999, 0.9999),
        ..volume
    }
}

/// Single-scattering albedo of a medium with the multiple-scattering albedo `color` (Kulla and Conty 2017, as in
/// KHR_materials_volume_scatter): `1 - (4.09712 + 4.20863 c - sqrt(9.59217 + 41.6808 c + 17.7126 c^2))^2`.
///
/// The fit has an error of 2e-6 at the ends, which are made exact: the colour one has no loss.
fn single_scattering_albedo(color: f32) -> f32 {
    let c = f64::from(color);
    if c <= 0.0 || c >= 1.0 {
        return c.clamp(0.0, 1.0) as f32;
    }
    let s = 4.09712 + 4.20863 * c - (9.59217 + 41.6808 * c + 17.7126 * c * c).sqrt();
    (1.0 - s * s).clamp(0.0, 1.0) as f32
}

/// Clear coat, sheen and anisotropy.
fn layers(untyped: &OfMaterial, m: &mut Material, r: &mut Reader<'_, '_>) {
    if let Some(e) = &untyped.clearcoat {
        let Clearcoat { strength, roughness } = &mut m.clearcoat;
        strength.factor = r.unit("clearcoatFactor", e.clearcoat_factor);
        roughness.factor = r.unit("clearcoatRoughnessFactor", e.clearcoat_roughness_factor);
        if strength.factor > 0.0 {
            strength.texture = r.channel(e.clearcoat_texture.as_ref(), 0);
            roughness.texture = r.channel(e.clearcoat_roughness_texture.as_ref(), 1);
            if e.clearcoat_normal_texture.is_some() {
                r.warn("the coat's own normal map is ignored: the coat has the interpolated normals");
            }
        }
    }
    if let Some(e) = &untyped.sheen {
        let Sheen { color, roughness } = &mut m.sheen;
        color.factor = r.color("sheenColorFactor", e.sheen_color_factor, 1.0);
        *roughness = r.unit("sheenRoughnessFactor", e.sheen_roughness_factor);
        if !color.factor.is_black() {
            color.texture = r.texture(e.sheen_color_texture.as_ref(), ColorEncoding::Srgb);
        }
    }
    if let Some(e) = &untyped.anisotropy {
        let Anisotropy { strength, rotation, .. } = &mut m.anisotropy;
        strength.factor = r.unit("anisotropyStrength", e.anisotropy_strength);
        *rotation = r.within("anisotropyRotation", e.anisotropy_rotation, f32::MIN, f32::MAX);
        if strength.factor > 0.0 {
            strength.texture = r.channel(e.anisotropy_texture.as_ref(), 2);
        }
    }
}
