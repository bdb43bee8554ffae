//! The materials of defects.

use super::spec::Finish;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{AlphaMode, Material, SceneBuilder, Surface, Volume};

/// Roughness of the walls of a scratch.
pub(super) const SCRATCH_ROUGHNESS: f32 = 0.3;

/// The material of a part.
pub(super) fn of(scene: &SceneBuilder, part: usize) -> Option<&Material> {
    scene.materials.get(scene.meshes.get(part)?.material)
}

/// True if a constant coverage of zero makes the surface absent.
pub(super) fn is_absent(m: &Material) -> bool {
    match m.alpha_mode {
        AlphaMode::Opaque | AlphaMode::FrontOnly => false,
        AlphaMode::Mask { cutoff } => m.alpha.factor < cutoff,
        AlphaMode::Blend => m.alpha.factor <= 0.0,
    }
}

/// True if a surface is smooth and clear everywhere: labels are seen through it.
pub(super) fn is_clear(m: &Material) -> bool {
    let is_whole = m.transmission.factor >= 1.0 && m.transmission.texture.is_none();
    m.is_smooth() && is_whole && m.metallic.factor <= 0.0 && m.metallic.texture.is_none()
}

/// The volume of a solid that light can enter.
pub(super) fn clear_volume(m: &Material) -> Option<Volume> {
    match m.surface {
        Surface::Solid(volume) if m.transmission.factor > 0.0 && m.metallic.factor < 1.0 => Some(volume),
        _ => None,
    }
}

/// Gas in a clear solid: index 1, above the solid in priority, so that it displaces the solid (Schmidt and Budge 2002).
/// `roughness` is that of a defect without its own.
pub(super) fn gas(finish: &Finish<'_>, host: &Volume, roughness: f32) -> Material {
    Material {
        name: finish.name.into(),
        roughness: finish.roughness.unwrap_or(roughness).into(),
        transmission: 1.0.into(),
        ior: 1.0,
        surface: Surface::Solid(Volume { priority: host.priority.saturating_add(1), ..Volume::default() }),
        ..Material::default()
    }
}

/// The surface below with the changes of the defect. `has_uvs` is false if the patch has no texture coordinates; then
/// all textures are dropped.
pub(super) fn like_surface(host: &Material, finish: &Finish<'_>, has_uvs: bool) -> Material {
    let mut m = Material { name: finish.name.into(), surface: Surface::Thin, ..host.clone() };
    if !has_uvs {
        m.texture_slots().for_each(|slot| *slot = None);
    }
    override_with(&mut m, finish);
    m
}

/// Walls that a tool or a break has left in an opaque surface: as [`like_surface`], without normal map, heights and coat, with the
/// roughness of a cut.
pub(super) fn cut(host: &Material, finish: &Finish<'_>, has_uvs: bool) -> Material {
    let mut m = like_surface(host, finish, has_uvs);
    (m.normal_map.texture, m.anisotropy.strength, m.clearcoat.strength.factor) = (None, 0.0.into(), 0.0);
    m.height = None;
    m.roughness = finish.roughness.unwrap_or(SCRATCH_ROUGHNESS).into();
    m
}

/// An opaque material of its own: a default colour and roughness, with the changes of the defect.
pub(super) fn own(finish: &Finish<'_>, color: Rgb, roughness: f32) -> Material {
    let mut m = Material {
        name: finish.name.into(),
        base_color: color.into(),
        roughness: roughness.into(),
        ..Material::default()
    };
    override_with(&mut m, finish);
    m
}

pub(super) fn override_with(m: &mut Material, finish: &Finish<'_>) {
    if let Some(roughness) = finish.roughness {
        m.roughness = roughness.into();
    }
    if let Some(color) = finish.color {
        m.base_color = color.into();
    }
    if let Some(metallic) = finish.metallic {
        m.metallic = metallic.into();
    }
}

/// A surface that no ray meets. It is no solid, transmits nothing and has no textures, so that its coverage is the
/// constant 0.
pub(super) fn absent(host: &Material, name: &str) -> Material {
    Material {
        name: format!("{name}: {}", host.name),
        alpha: 0.0.into(),
        alpha_mode: AlphaMode::Mask { cutoff: 1.0 },
        ..Material::default()
    }
}

/// The surface with `1 - strength` of its coverage. Masks become soft: their alpha is a probability then.
pub(super) fn faded(host: &Material, name: &str, strength: f64) -> Material {
    let mut m = Material { name: format!("{name}: {}", host.name), ..host.clone() };
    if m.alpha_mode == AlphaMode::Opaque {
        // An opaque surface ignores its alpha. From now on alpha counts.
        m.alpha = 1.0.into();
    }
    m.alpha.factor *= (1.0 - strength) as f32;
    m.alpha_mode = AlphaMode::Blend;
    m
}

/// The material with the alpha of the vertex colours as its coverage.
pub(super) fn covering_by_colors(m: Material) -> Material {
    Material { alpha: 1.0.into(), alpha_mode: AlphaMode::Blend, ..m }
}
