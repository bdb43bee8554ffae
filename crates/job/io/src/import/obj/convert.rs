//! Converts MTL materials. The table in the documentation of [`load_obj`](super::load_obj) is the contract.

use super::bake::roughness_of_exponent;
use super::map::Map;
use super::mtl::Mtl;
use super::textures::Textures;
use crate::import::warnings::Warnings;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{AlphaMode, Clearcoat, Material, NormalMap, Parameter, Specular, Texture};

/// Diffuse reflectance of a material without one: light grey, so that unlit corners and bright faces are both visible.
const GREY: f32 = 0.8;

/// A material, and whether it refracts: a closed mesh of it is a solid.
pub(super) struct Converted {
    pub material: Material,
    pub refracts: bool,
}

/// The material of faces without one, or with one that no library defines.
pub(super) fn default_material(name: &str) -> Material {
    let name = if name.is_empty() { "default" } else { name };
    Material {
        name: name.to_string(),
        base_color: Rgb::splat(GREY).into(),
        specular: Specular::NONE,
        ..Material::default()
    }
}

/// Converts a material whose library lies in `folder` (relative to the OBJ file; empty beside it).
pub(super) fn convert(m: &Mtl, folder: &str, textures: &mut Textures<'_>, warnings: &mut Warnings) -> Converted {
    let mut reader = Reader { place: format!("material \"{}\"", m.name), folder, textures, warnings };
    let is_pbr =
        m.roughness.is_some() || m.metallic.is_some() || m.maps.roughness.is_some() || m.maps.metallic.is_some();
    let base_map = reader.color(&m.maps.diffuse);
    let specular_map = reader.color(&m.maps.specular);
    let diffuse = reader.beside_map("Kd", m.diffuse, base_map.is_some()).unwrap_or([GREY; 3]);
    let specular = reader.beside_map("Ks", m.specular, specular_map.is_some() && !is_pbr).unwrap_or([0.0; 3]);
    let mut out = Material {
        name: m.name.clone(),
        base_color: Parameter { factor: rgb(diffuse), texture: base_map },
        ..Material::default()
    };

    let transmission = transmission(m);
    let transmissive = transmission.is_some();
    if let Some((share, tint)) = transmission {
        out.transmission = share.into();
        out.base_color.factor = out.base_color.factor.lerp(rgb(tint), share);
    }
    if let Some(ior) = m.ior {
        // Many exporters write 0 or 1 for materials that never refract. Their highlights still need an interface.
        let meant = ior > 1.0 || (transmissive && ior == 1.0);
        if !meant && ior != 1.0 {
            reader.warn(format!("an index of refraction (Ni) of {ior} is not usable; 1.5 is used"));
        }
        out.ior = if meant { ior.min(10.0) } else { 1.5 };
    }

    let is_mirror = !is_pbr && matches!(m.illumination, Some(3 | 8)) && largest(specular) > largest(diffuse);
    if is_mirror {
        out.metallic = 1.0.into();
        out.base_color = Parameter { factor: rgb(specular), texture: specular_map };
    } else if is_pbr || transmissive {
        // Fresnel's equations determine the reflection. A colour for it would count twice.
        out.specular.strength = 1.0.into();
    } else if largest(specular) > 0.0 && !matches!(m.illumination, Some(0 | 1)) {
        out.specular.strength = largest(specular).into();
        out.specular.color = Parameter { factor: rgb(specular) / largest(specular), texture: specular_map };
    } else {
        out.specular.strength = 0.0.into();
    }
    reader.roughness(m, transmissive, &mut out);
    reader.layers(m, &mut out);

    let alpha = if transmissive { 1.0 } else { m.dissolve.unwrap_or(1.0) };
    out.alpha = Parameter { factor: alpha, texture: reader.coverage(&m.maps.dissolve) };
    if alpha < 1.0 || out.alpha.texture.is_some() {
        out.alpha_mode = AlphaMode::Blend;
    }
    if alpha == 0.0 {
        reader.warn("covers nothing (d 0 or Tr 1) and is invisible; if it should be visible, set d 1");
    }
    Converted { refracts: transmissive && out.ior != 1.0, material: out }
}

/// Share and tint of the transmitted light. Only the refracting illumination models transmit: `d` below 1 elsewhere means
/// coverage, and `Tf 1 1 1` is written by many exporters for everything opaque.
pub(super) fn transmission(m: &Mtl) -> Option<(f32, [f32; 3])> {
    let model = m.illumination?;
    if !matches!(model, 4 | 6 | 7 | 9) {
        return None;
    }
    let filter = m.filter.unwrap_or([1.0; 3]);
    let share = match m.dissolve {
        Some(d) if d < 1.0 => 1.0 - d,
        // In the models of refraction the body is clear also without a value of `d`.
        _ if matches!(model, 6 | 7) => largest(filter),
        _ => 0.0,
    };
    let tint = if largest(filter) > 0.0 { filter.map(|v| v / largest(filter)) } else { [1.0; 3] };
    (share > 0.0).then_some((share, tint))
}

/// Reads the maps of one material.
struct Reader<'r, 'a> {
    place: String,
    folder: &'r str,
    textures: &'r mut Textures<'a>,
    warnings: &'r mut Warnings,
}

impl Reader<'_, '_> {
    fn warn(&mut self, message: impl Into<String>) {
        self.warnings.push(&self.place, message);
    }

    fn color(&mut self, map: &Option<Map>) -> Option<Texture> {
        self.textures.color(map.as_ref()?, self.folder, self.warnings)
    }

    fn scalar(&mut self, map: &Option<Map>) -> Option<Texture> {
        self.textures.numbers(map.as_ref()?, self.folder, self.warnings)
    }

    fn coverage(&mut self, map: &Option<Map>) -> Option<Texture> {
        self.textures.coverage(map.as_ref()?, self.folder, self.warnings)
    }

    /// The factor of a colour that may have a map. Exporters often write black, which would hide the map.
    fn beside_map(&mut self, key: &str, factor: Option<[f32; 3]>, has_map: bool) -> Option<[f32; 3]> {
        match factor {
            Some([0.0, 0.0, 0.0]) if has_map => {
                self.warn(format!("{key} is black beside a map that it would hide; white is used"));
                Some([1.0; 3])
            }
            None if has_map => Some([1.0; 3]),
            factor => factor,
        }
    }

    /// `Pr`, else from `Ns`; refraction without `Pr` is sharp, as the illumination models define it.
    fn roughness(&mut self, m: &Mtl, clear: bool, out: &mut Material) {
        let map = self.scalar(&m.maps.roughness);
        if m.roughness.is_some() || map.is_some() {
            out.roughness = number(m.roughness, map, 1.0);
        } else if clear {
            out.roughness = 0.0.into();
        } else {
            // A map of exponents without a factor: 1000 is the largest exponent that programs of the format use.
            let factor = m.exponent.filter(|n| *n > 0.0).unwrap_or(1000.0);
            let map = m.maps.exponent.as_ref();
            let texture = map.and_then(|map| self.textures.exponents(map, self.folder, factor, self.warnings));
            let exponent = m.exponent.map_or(out.roughness.factor, roughness_of_exponent);
            out.roughness = Parameter { factor: if texture.is_some() { 1.0 } else { exponent }, texture };
        }
    }

    /// Metal, emission, sheen, clear coat, anisotropy and relief.
    fn layers(&mut self, m: &Mtl, out: &mut Material) {
        out.metallic = number(m.metallic, self.scalar(&m.maps.metallic), out.metallic.factor);
        let texture = self.color(&m.maps.emission);
        let emission = self.beside_map("Ke", m.emission, texture.is_some());
        out.emission = Parameter { factor: rgb(emission.unwrap_or([0.0; 3])), texture };
        let sheen = number(m.sheen, self.color(&m.maps.sheen), 0.0);
        out.sheen.color = Parameter { factor: Rgb::splat(sheen.factor), texture: sheen.texture };
        out.clearcoat = Clearcoat {
            strength: number(m.clearcoat, self.scalar(&m.maps.clearcoat), 0.0),
            roughness: number(m.clearcoat_roughness, self.scalar(&m.maps.clearcoat_roughness), 0.0),
        };
        out.anisotropy.strength = m.anisotropy.unwrap_or(0.0).into();
        out.anisotropy.rotation = std::f32::consts::TAU * m.anisotropy_rotation.unwrap_or(0.0);
        if let Some(map) = &m.maps.normal {
            let texture = self.textures.numbers(map, self.folder, self.warnings);
            out.normal_map = NormalMap { texture, scale: map.bump };
        } else if let Some(map) = &m.maps.bump
            && let Some((texture, scale)) = self.textures.bumps(map, self.folder, self.warnings)
        {
            out.normal_map = NormalMap { texture: Some(texture), scale };
        }
    }
}

/// A number that can have a map.
fn number(factor: Option<f32>, texture: Option<Texture>, default: f32) -> Parameter<f32> {
    let factor = match texture {
        Some(_) => factor.filter(|v| *v > 0.0).unwrap_or(1.0),
        None => factor.unwrap_or(default),
    };
    Parameter { factor, texture }
}

fn rgb(v: [f32; 3]) -> Rgb {
    Rgb::from_array(v)
}

fn largest(v: [f32; 3]) -> f32 {
    v.iter().copied().fold(0.0, f32::max)
}
