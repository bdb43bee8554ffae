//! Converts MTL materials. The table in the documentation of [`load_obj`](super::load_obj) is the contract.

use super::bake::roughness_of_exponent;
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
    let place = format!("material \"{}\"", m.name);
    let is_pbr =
        m.roughness.is_some() || m.metallic.is_some() || m.maps.roughness.is_some() || m.maps.metallic.is_some();
    let base_map = textures.color(&m.maps.diffuse, folder, warnings);
    let specular_map = textures.color(&m.maps.specular, folder, warnings);
    let diffuse = beside_map(m.diffuse, base_map.is_some(), "Kd", &place, warnings).unwrap_or([GREY; 3]);
    let specular =
        beside_map(m.specular, specular_map.is_some() && !is_pbr, "Ks", &place, warnings).unwrap_or([0.0; 3]);
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
            warnings.push(&place, format!("an index of refraction (Ni) of {ior} is not usable; 1.5 is used"));
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
    out.roughness = roughness(m, folder, transmissive, textures, warnings);

    let metallic_map = textures.linear(&m.maps.metallic, folder, warnings);
    out.metallic = number(m.metallic, metallic_map, out.metallic.factor);
    let emission_map = textures.color(&m.maps.emission, folder, warnings);
    let emission = beside_map(m.emission, emission_map.is_some(), "Ke", &place, warnings);
    out.emission = Parameter { factor: rgb(emission.unwrap_or([0.0; 3])), texture: emission_map };
    let sheen = number(m.sheen, textures.color(&m.maps.sheen, folder, warnings), 0.0);
    out.sheen.color = Parameter { factor: Rgb::splat(sheen.factor), texture: sheen.texture };
    out.clearcoat = Clearcoat {
        strength: number(m.clearcoat, textures.linear(&m.maps.clearcoat, folder, warnings), 0.0),
        roughness: number(m.clearcoat_roughness, textures.linear(&m.maps.clearcoat_roughness, folder, warnings), 0.0),
    };
    out.anisotropy.strength = m.anisotropy.unwrap_or(0.0).into();
    out.anisotropy.rotation = std::f32::consts::TAU * m.anisotropy_rotation.unwrap_or(0.0);

    if let Some(map) = &m.maps.normal {
        out.normal_map.texture = textures.linear(&m.maps.normal, folder, warnings);
        out.normal_map.scale = map.bump;
    } else if let Some(map) = &m.maps.bump
        && let Some((texture, scale)) = textures.bumps(map, folder, warnings)
    {
        out.normal_map = NormalMap { texture: Some(texture), scale };
    }

    out.alpha.texture = textures.coverage(&m.maps.dissolve, folder, warnings);
    out.alpha.factor = if transmissive { 1.0 } else { m.dissolve.unwrap_or(1.0) };
    if out.alpha.factor < 1.0 || out.alpha.texture.is_some() {
        out.alpha_mode = AlphaMode::Blend;
    }
    if out.alpha.factor == 0.0 {
        warnings.push(&place, "covers nothing (d 0 or Tr 1) and is invisible; if it should be visible, set d 1");
    }
    Converted { refracts: transmissive && out.ior != 1.0, material: out }
}

/// Share and tint of the transmitted light. Only the refracting illumination models transmit: `d` below 1 elsewhere means
/// coverage, and `Tf 1 1 1` is written by many exporters for everything opaque.
fn transmission(m: &Mtl) -> Option<(f32, [f32; 3])> {
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

/// `Pr`, else from `Ns`; refraction without `Pr` is sharp, as the illumination models define it.
fn roughness(
    m: &Mtl,
    folder: &str,
    clear: bool,
    textures: &mut Textures<'_>,
    warnings: &mut Warnings,
) -> Parameter<f32> {
    let map = textures.linear(&m.maps.roughness, folder, warnings);
    if m.roughness.is_some() || map.is_some() {
        return number(m.roughness, map, 1.0);
    }
    if clear {
        return 0.0.into();
    }
    if let Some(map) = &m.maps.exponent {
        // A map of exponents without a factor: 1000 is the largest exponent that programs of the format use.
        let factor = m.exponent.filter(|n| *n > 0.0).unwrap_or(1000.0);
        let texture = textures.exponents(map, folder, factor, warnings);
        if texture.is_some() {
            return Parameter { factor: 1.0, texture };
        }
    }
    m.exponent.map_or(Material::default().roughness, |exponent| roughness_of_exponent(exponent).into())
}

/// The factor of a colour that also has a map. Exporters often write black, which would hide the map.
fn beside_map(
    factor: Option<[f32; 3]>,
    has_map: bool,
    key: &str,
    place: &str,
    warnings: &mut Warnings,
) -> Option<[f32; 3]> {
    match factor {
        Some([0.0, 0.0, 0.0]) if has_map => {
            warnings.push(place, format!("{key} is black beside a map that it would hide; white is used"));
            Some([1.0; 3])
        }
        None if has_map => Some([1.0; 3]),
        factor => factor,
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
