//! Decals: a picture on a surface.

use super::draw;
use super::material;
use super::patch::Patch;
use super::site::{Made, Site};
use super::spec::{Decal, DecalMode};
use super::walk::{Course, Footing};
use crate::defects::draw::Harmonics;
use dunkelfeld_geometry::Vec2;
use dunkelfeld_sampling::Pcg;
use dunkelfeld_scene::{AlphaMode, ColorEncoding, HeightField, HeightImage, Image, ImageId, Material, Texture, Wrap};

/// Cells along the longer side.
const CELLS: f64 = 96.0;
/// Largest distance between facets and patch, over the length.
const LARGEST_RISE: f64 = 0.03;

/// A picture that is laid on a surface: its middle row is a geodesic, and its columns are geodesics at right angles to it. So
/// distances along these are those of the picture, also around a cylinder.
pub(super) fn decal(site: &Site<'_>, decal: &Decal, image: &Image, stream: &mut Pcg) -> Option<Made> {
    let (surface, length) = (&site.surface, decal.length.0);
    let height = length * f64::from(image.height) / f64::from(image.width);
    let angle = decal.angle.map_or_else(|| draw::angle(stream), |angle| angle.0);
    let steps = |side: f64| (0.5 * CELLS * side / length.max(height)).ceil().max(2.0) as usize;
    let course = Course { length, steps: steps(length), angle, curvature: 0.0, wander: &Harmonics::none() };
    let (rows, half) = (course.on(surface, site.foot)?, steps(height));
    let columns = 2 * half + 1;
    let (mut feet, mut uvs) = (Vec::with_capacity(rows.len() * columns), Vec::with_capacity(rows.len() * columns));
    for (row, middle) in rows.iter().enumerate() {
        let side = |sign: f64| {
            let mut foot = Footing { along: middle.left() * sign, ..*middle };
            let mut hits = Vec::with_capacity(half);
            for _ in 0..half {
                foot = foot.step(surface, 0.5 * height / half as f64, 0.0)?;
                hits.push(foot.hit);
            }
            Some(hits)
        };
        feet.extend(side(-1.0)?.into_iter().rev().chain([middle.hit]).chain(side(1.0)?));
        let u = row as f32 / (rows.len() - 1) as f32;
        uvs.extend((0..columns).map(|column| Vec2::new(u, 1.0 - column as f32 / (columns - 1) as f32)));
    }
    let mut made = material::like_surface(site.host, &site.finish, true);
    let depth = decal.depth.map_or(0.0, |depth| depth.0 as f32);
    if depth > 0.0 && !made.is_opaque() {
        return None;
    }
    made.alpha_mode = AlphaMode::Blend;
    made.alpha = decal.strength.map_or(1.0, |strength| strength.0 as f32).into();
    let set = free_set(&mut made);
    let patch = Patch { own_uvs: Some((set, uvs)), frame: surface.to_mesh, ..Patch::grid(feet, columns) };
    let rise = patch.rise(surface).filter(|rise| *rise <= LARGEST_RISE * length)?;
    let (mut mesh, _) = patch.mesh(surface, Some(site.below), |_| site.lift + rise, |i| patch.feet[i].normal);
    let texture = |encoding, channel| {
        let id = ImageId(site.scene.images.len() as u32);
        Some(Texture { wrap: [Wrap::Clamp; 2], uv_set: set as u8, channel, ..Texture::new(id, encoding) })
    };
    // What the alpha of the picture does not cover shows the surface.
    let alpha = texture(ColorEncoding::Linear, 3);
    match decal.mode {
        DecalMode::Mask => made.alpha.texture = texture(ColorEncoding::Linear, 0),
        DecalMode::Color => {
            mesh.colors.clear();
            (made.base_color, made.metallic) = (dunkelfeld_radiometry::Rgb::WHITE.into(), 0.0.into());
            material::override_with(&mut made, &site.finish);
            (made.base_color.texture, made.alpha.texture) = (texture(ColorEncoding::Srgb, 0), alpha);
        }
        DecalMode::Roughness => {
            made.roughness = decal.roughness.map_or(1.0, |roughness| roughness.0 as f32).into();
            (made.roughness.texture, made.alpha.texture) = (texture(ColorEncoding::Linear, 0), alpha);
        }
        DecalMode::Height => {
            let heights = HeightImage { texture: texture(ColorEncoding::Linear, 0), depth, size: None };
            (made.height, made.alpha_mode) = (Some(HeightField::Image(heights)), AlphaMode::Opaque);
        }
    }
    Some(Made { is_in_body: true, image: Some(image.clone()), ..Made::new(mesh, Some(angle), made) })
}

/// A set of texture coordinates that no texture of the material uses. If both are used, its textures are dropped.
fn free_set(material: &mut Material) -> usize {
    let mut is_used = [false; 2];
    material.texture_slots().filter_map(|slot| *slot).for_each(|t| is_used[usize::from(t.uv_set) % 2] = true);
    if is_used == [true; 2] {
        material.texture_slots().for_each(|slot| *slot = None);
    }
    usize::from(is_used[0])
}
