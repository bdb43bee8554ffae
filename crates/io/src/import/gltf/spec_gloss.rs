//! KHR_materials_pbrSpecularGlossiness as metallic-roughness, by the conversion of Khronos for the extension.

use super::reader::Reader;
use crate::images::ImageHeader;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{ChannelTexture, ColorEncoding, Image, Material, Texels, Texture};
use gltf::json::extensions::material::PbrSpecularGlossiness;

/// Reflectance at normal incidence of the dielectric behind metallic-roughness (ior 1.5).
const DIELECTRIC: f32 = 0.04;

/// Fills base colour, alpha, metallic and roughness of `material`. Textures are converted texel by texel into new images.
pub(super) fn convert(source: &PbrSpecularGlossiness, material: &mut Material, reader: &mut Reader<'_, '_>) {
    let [r, g, b, alpha] = source.diffuse_factor.0;
    let factors = Factors {
        diffuse: reader.color("diffuseFactor", [r, g, b], 1.0),
        alpha: reader.unit("diffuseFactor (alpha)", alpha),
        specular: reader.color("specularFactor", source.specular_factor.0, 1.0),
        glossiness: reader.unit("glossinessFactor", source.glossiness_factor.0),
    };
    let diffuse = reader.texture(source.diffuse_texture.as_ref(), ColorEncoding::Srgb);
    let mut specular = reader.texture(source.specular_glossiness_texture.as_ref(), ColorEncoding::Srgb);
    if let (Some(d), Some(s)) = (&diffuse, &specular)
        && (d.uv_set, d.transform, d.wrap) != (s.uv_set, s.transform, s.wrap)
    {
        reader.warn("diffuse and specular-glossiness textures lie differently on the surface; the latter is left out");
        specular = None;
    }
    let Some(template) = diffuse.or(specular) else {
        let m = factors.convert(Rgb::WHITE, Rgb::WHITE, 1.0);
        material.base_color = m.base_color;
        material.alpha = factors.alpha;
        material.metallic = m.metallic;
        material.roughness = 1.0 - factors.glossiness;
        return;
    };
    if let Err(problem) = bake(&factors, diffuse, specular, template, material, reader) {
        reader.warn(format!(
            "the specular-glossiness textures cannot be converted, the factors alone are used: {problem}"
        ));
        let m = factors.convert(Rgb::WHITE, Rgb::WHITE, 1.0);
        (material.base_color, material.metallic, material.roughness) = (m.base_color, m.metallic, m.roughness);
        material.alpha = factors.alpha;
    }
}

struct Factors {
    diffuse: Rgb,
    alpha: f32,
    specular: Rgb,
    glossiness: f32,
}

struct MetallicRoughness {
    base_color: Rgb,
    metallic: f32,
    roughness: f32,
}

impl Factors {
    /// The conversion for one texel (linear values), factors included.
    fn convert(&self, diffuse: Rgb, specular: Rgb, glossiness: f32) -> MetallicRoughness {
        let (diffuse, specular) = (self.diffuse * diffuse, self.specular * specular);
        let rest = 1.0 - specular.max_channel();
        let metallic = solve_metallic(perceived_brightness(diffuse), perceived_brightness(specular), rest);
        const SMALL: f32 = 1e-6;
        let from_diffuse = diffuse * (rest / (1.0 - DIELECTRIC) / (1.0 - metallic).max(SMALL));
        let from_specular = specular.map(|s| (s - DIELECTRIC * (1.0 - metallic)) / metallic.max(SMALL));
        MetallicRoughness {
            base_color: from_diffuse.lerp(from_specular, metallic * metallic).map(|v| v.clamp(0.0, 1.0)),
            metallic,
            roughness: 1.0 - self.glossiness * glossiness,
        }
    }
}

/// Root of the quadratic equation for equal brightness in both models.
fn solve_metallic(diffuse: f32, specular: f32, rest: f32) -> f32 {
    if specular < DIELECTRIC {
        return 0.0;
    }
    let a = DIELECTRIC;
    let b = diffuse * rest / (1.0 - DIELECTRIC) + specular - 2.0 * DIELECTRIC;
    let c = DIELECTRIC - specular;
    let discriminant = (b * b - 4.0 * a * c).max(0.0);
    ((discriminant.sqrt() - b) / (2.0 * a)).clamp(0.0, 1.0)
}

/// Brightness in the HSP model (Finley, 2006).
fn perceived_brightness(color: Rgb) -> f32 {
    let [r, g, b] = color.to_array();
    (0.299 * r * r + 0.587 * g * g + 0.114 * b * b).sqrt()
}

/// Converts both textures at the larger resolution of the two, factors baked in.
fn bake(
    factors: &Factors,
    diffuse: Option<Texture>,
    specular: Option<Texture>,
    template: Texture,
    material: &mut Material,
    reader: &mut Reader<'_, '_>,
) -> Result<(), String> {
    let store = &reader.textures.store;
    let image = |texture: Option<Texture>| texture.and_then(|t| store.image(t.image));
    let (diffuse, specular) = (image(diffuse), image(specular));
    let size = |f: fn(&Image) -> u32| diffuse.iter().chain(&specular).map(|i| f(i)).max().unwrap_or(1);
    let (width, height) = (size(|i| i.width), size(|i| i.height));
    let name = |what: &str| format!("{} ({what} from specular-glossiness)", material.name);
    let names = [name("base colour"), name("metallic and roughness")];
    let (color, surface) = if store.measures() {
        let header = ImageHeader { width, height, channels: 4, value_bytes: 1 };
        let surface = ImageHeader { channels: 3, ..header };
        let store = &mut reader.textures.store;
        (store.add_measured(&header, &names[0])?, store.add_measured(&surface, &names[1])?)
    } else {
        let (colors, surfaces) = converted(factors, diffuse, specular, width, height);
        let [color, surface] = names;
        let store = &mut reader.textures.store;
        let mut add = |name: String, texels| {
            let place = name.clone();
            store.add(Image { name, width, height, texels }, &place)
        };
        (add(color, Texels::Rgba8(colors).into())?, add(surface, Texels::Rgb8(surfaces).into())?)
    };
    let surface = Texture { image: surface, encoding: ColorEncoding::Linear, ..template };
    material.base_color = Rgb::WHITE;
    material.base_color_texture = Some(Texture { image: color, encoding: ColorEncoding::Srgb, ..template });
    material.alpha = factors.alpha;
    material.metallic = 1.0;
    material.roughness = 1.0;
    material.metallic_texture = Some(ChannelTexture { texture: surface, channel: 2 });
    material.roughness_texture = Some(ChannelTexture { texture: surface, channel: 1 });
    Ok(())
}

/// Texels of base colour with alpha, and of roughness (green) and metallic (blue).
fn converted(
    factors: &Factors,
    diffuse: Option<&Image>,
    specular: Option<&Image>,
    width: u32,
    height: u32,
) -> (Vec<[u8; 4]>, Vec<[u8; 3]>) {
    let texels = width as usize * height as usize;
    let (mut colors, mut surfaces) = (Vec::with_capacity(texels), Vec::with_capacity(texels));
    for y in 0..height {
        for x in 0..width {
            // If the sizes differ, the nearest texel of the smaller image is used.
            let at = |image: Option<&Image>| image.map_or([1.0; 4], |i| texel(i, x, y, width, height));
            let ([dr, dg, db, alpha], [sr, sg, sb, glossiness]) = (at(diffuse), at(specular));
            let m = factors.convert(Rgb::new(dr, dg, db), Rgb::new(sr, sg, sb), glossiness);
            let [r, g, b] = m.base_color.to_array().map(|v| byte(linear_to_srgb(v)));
            colors.push([r, g, b, byte(alpha)]);
            surfaces.push([255, byte(m.roughness), byte(m.metallic)]);
        }
    }
    (colors, surfaces)
}

/// A texel in linear light, addressed on a grid of `width * height`.
fn texel(image: &Image, x: u32, y: u32, width: u32, height: u32) -> [f32; 4] {
    let scaled = |v: u32, from: u32, to: u32| (u64::from(v) * u64::from(to) / u64::from(from)) as usize;
    let i = scaled(y, height, image.height) * image.width as usize + scaled(x, width, image.width);
    let Some([r, g, b, a]) = image.texels.get(i) else { return [1.0; 4] };
    if image.texels.is_float() { [r, g, b, a] } else { [srgb_to_linear(r), srgb_to_linear(g), srgb_to_linear(b), a] }
}

fn byte(v: f32) -> u8 {
    (v.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// IEC 61966-2-1.
fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// IEC 61966-2-1.
fn linear_to_srgb(v: f32) -> f32 {
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}
