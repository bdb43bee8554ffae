//! Converts MTL materials. The table in the documentation of [`load_obj`](super::load_obj) is the contract.

use super::bake::roughness_of_exponent;
use super::mtl::Mtl;
use super::textures::Textures;
use crate::import::warnings::Warnings;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{AlphaMode, Material};

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
    Material { name: name.to_string(), base_color: Rgb::splat(GREY), specular: 0.0, ..Material::default() }
}

/// Converts a material whose library lies in `folder` (relative to the OBJ file; empty beside it).
pub(super) fn convert(m: &Mtl, folder: &str, textures: &mut Textures<'_>, warnings: &mut Warnings) -> Converted {
    let place = format!("material \"{}\"", m.name);
    let is_pbr =
        m.roughness.is_some() || m.metallic.is_some() || m.maps.roughness.is_some() || m.maps.metallic.is_some();
    let base_map = m.maps.diffuse.as_ref().and_then(|map| textures.color(map, folder, warnings));
    let specular_map = m.maps.specular.as_ref().and_then(|map| textures.color(map, folder, warnings));
    let diffuse = beside_map(m.diffuse, base_map.is_some(), "Kd", &place, warnings).unwrap_or([GREY; 3]);
    let specular =
        beside_map(m.specular, specular_map.is_some() && !is_pbr, "Ks", &place, warnings).unwrap_or([0.0; 3]);
    let mut out = Material {
        name: m.name.clone(),
        base_color: rgb(diffuse),
        base_color_texture: base_map,
        ..Material::default()
    };

    let transmission = transmission(m);
    let transmissive = transmission.is_some();
    if let Some((share, tint)) = transmission {
        out.transmission = share;
        out.base_color = out.base_color.lerp(rgb(tint), share);
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
        out.metallic = 1.0;
        out.base_color = rgb(specular);
        out.base_color_texture = specular_map;
    } else if is_pbr || transmissive {
        // Fresnel's equations determine the reflection. A colour for it would count twice.
        out.specular = 1.0;
    } else if largest(specular) > 0.0 && !matches!(m.illumination, Some(0 | 1)) {
        out.specular = largest(specular);
        out.specular_color = rgb(specular) / largest(specular);
        out.specular_color_texture = specular_map;
    } else {
        out.specular = 0.0;
    }
    roughness(m, folder, transmissive, &mut out, textures, warnings);

    out.metallic_texture = m.maps.metallic.as_ref().and_then(|map| textures.scalar(map, folder, warnings));
    if let Some(metallic) = scalar_beside_map(m.metallic, out.metallic_texture.is_some()) {
        out.metallic = metallic;
    }
    out.emission_texture = m.maps.emission.as_ref().and_then(|map| textures.color(map, folder, warnings));
    let emission = beside_map(m.emission, out.emission_texture.is_some(), "Ke", &place, warnings);
    out.emission = rgb(emission.unwrap_or([0.0; 3]));
    out.sheen_color_texture = m.maps.sheen.as_ref().and_then(|map| textures.color(map, folder, warnings));
    out.sheen_color = Rgb::splat(scalar_beside_map(m.sheen, out.sheen_color_texture.is_some()).unwrap_or(0.0));
    out.clearcoat_texture = m.maps.clearcoat.as_ref().and_then(|map| textures.scalar(map, folder, warnings));
    out.clearcoat = scalar_beside_map(m.clearcoat, out.clearcoat_texture.is_some()).unwrap_or(0.0);
    out.clearcoat_roughness_texture =
        m.maps.clearcoat_roughness.as_ref().and_then(|map| textures.scalar(map, folder, warnings));
    out.clearcoat_roughness =
        scalar_beside_map(m.clearcoat_roughness, out.clearcoat_roughness_texture.is_some()).unwrap_or(0.0);
    out.anisotropy = m.anisotropy.unwrap_or(0.0);
    out.anisotropy_rotation = std::f32::consts::TAU * m.anisotropy_rotation.unwrap_or(0.0);

    if let Some(map) = &m.maps.normal {
        out.normal_texture = textures.normals(map, folder, warnings);
        out.normal_scale = map.bump;
    } else if let Some(map) = &m.maps.bump
        && let Some((texture, scale)) = textures.bumps(map, folder, warnings)
    {
        out.normal_texture = Some(texture);
        out.normal_scale = scale;
    }

    out.alpha_texture = m.maps.dissolve.as_ref().and_then(|map| textures.coverage(map, folder, warnings));
    out.alpha = if transmissive { 1.0 } else { m.dissolve.unwrap_or(1.0) };
    if out.alpha < 1.0 || out.alpha_texture.is_some() {
        out.alpha_mode = AlphaMode::Blend;
    }
    if out.alpha == 0.0 {
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
    out: &mut Material,
    textures: &mut Textures<'_>,
    warnings: &mut Warnings,
) {
    out.roughness_texture = m.maps.roughness.as_ref().and_then(|map| textures.scalar(map, folder, warnings));
    if let Some(roughness) = scalar_beside_map(m.roughness, out.roughness_texture.is_some()) {
        out.roughness = roughness;
        return;
    }
    if clear {
        out.roughness = 0.0;
        return;
    }
    if let Some(map) = &m.maps.exponent {
        // A map of exponents without a factor: 1000 is the largest exponent that programs of the format use.
        let factor = m.exponent.filter(|n| *n > 0.0).unwrap_or(1000.0);
        out.roughness_texture = textures.exponents(map, folder, factor, warnings);
        if out.roughness_texture.is_some() {
            out.roughness = 1.0;
            return;
        }
    }
    if let Some(exponent) = m.exponent {
        out.roughness = roughness_of_exponent(exponent);
    }
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

fn scalar_beside_map(factor: Option<f32>, has_map: bool) -> Option<f32> {
    if has_map { Some(factor.filter(|v| *v > 0.0).unwrap_or(1.0)) } else { factor }
}

fn rgb(v: [f32; 3]) -> Rgb {
    Rgb::from_array(v)
}

fn largest(v: [f32; 3]) -> f32 {
    v.iter().copied().fold(0.0, f32::max)
}
