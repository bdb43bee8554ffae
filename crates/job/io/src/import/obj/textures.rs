//! Finds, decodes and converts the images of MTL maps. Each is stored once.

use super::bake;
use super::map::Map;
use crate::import::image_store::{Content, ImageStore};
use crate::import::warnings::Warnings;
use crate::input::Role;
use crate::loader::AssetLoader;
use dunkelfeld_geometry::Vec2;
use dunkelfeld_scene::{ColorEncoding, ImageId, Texture, TextureTransform, Wrap};
use std::collections::HashMap;

/// The conversion of an image file. Factors are stored as bits, so that they can be keys.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum Variant {
    AsStored,
    NormalsOfHeights { strength: u32, clamp: bool },
    RoughnessOfExponents { factor: u32 },
}

/// The images of one scene during reading.
pub(super) struct Textures<'a> {
    loader: &'a AssetLoader,
    /// The images themselves.
    pub(super) store: ImageStore,
    /// By resolved name; `None` if it cannot be used, after a warning.
    known: HashMap<(String, Variant), Option<ImageId>>,
    /// By content of the file; the fault if it cannot be used.
    by_content: HashMap<(Content, Variant), Result<ImageId, String>>,
}

impl<'a> Textures<'a> {
    pub(super) fn new(loader: &'a AssetLoader, store: ImageStore) -> Self {
        Self { loader, store, known: HashMap::new(), by_content: HashMap::new() }
    }

    /// A map of colours, in sRGB.
    pub(super) fn color(&mut self, map: &Map, folder: &str, warnings: &mut Warnings) -> Option<Texture> {
        let image = self.find(map, folder, Variant::AsStored, warnings)?;
        Some(self.texture(map, image, true))
    }

    /// A map of numbers: normals, or values in the red channel.
    pub(super) fn numbers(&mut self, map: &Map, folder: &str, warnings: &mut Warnings) -> Option<Texture> {
        let image = self.find(map, folder, Variant::AsStored, warnings)?;
        Some(self.texture(map, image, false))
    }

    /// A map of coverage: alpha if the image has it, else red.
    pub(super) fn coverage(&mut self, map: &Map, folder: &str, warnings: &mut Warnings) -> Option<Texture> {
        let texture = self.numbers(map, folder, warnings)?;
        let has_alpha = self.store.image(texture.image).is_some_and(bake::has_alpha);
        Some(Texture { channel: if has_alpha { 3 } else { 0 }, ..texture })
    }

    /// A normal map from a bump map, and the factor for its x and y.
    pub(super) fn bumps(&mut self, map: &Map, folder: &str, warnings: &mut Warnings) -> Option<(Texture, f32)> {
        let variant = Variant::NormalsOfHeights { strength: map.bump.to_bits(), clamp: map.clamp };
        let image = self.find(map, folder, variant, warnings)?;
        let converted = self.store.image(image).is_some_and(|i| i.name.ends_with("(normals)"));
        // A normal map in place of a bump map: then the strength scales its slopes.
        Some((self.texture(map, image, false), if converted { 1.0 } else { map.bump }))
    }

    /// A roughness map from a map of exponents, of which `factor` is the largest.
    pub(super) fn exponents(
        &mut self,
        map: &Map,
        folder: &str,
        factor: f32,
        warnings: &mut Warnings,
    ) -> Option<Texture> {
        let variant = Variant::RoughnessOfExponents { factor: factor.to_bits() };
        let image = self.find(map, folder, variant, warnings)?;
        Some(self.texture(map, image, false))
    }

    /// A texture with the map's options. The coordinates of OBJ are `scale * uv + offset` with v upwards. Ours point
    /// down: 1 - (s (1 - v) + o) = s v + (1 - s - o).
    fn texture(&self, map: &Map, image: ImageId, srgb: bool) -> Texture {
        let float = self.store.image(image).is_some_and(|i| i.texels.is_float());
        let encoding = if srgb && !float { ColorEncoding::Srgb } else { ColorEncoding::Linear };
        let mut texture = Texture::new(image, encoding);
        if map.clamp {
            texture.wrap = [Wrap::Clamp; 2];
        }
        texture.transform = TextureTransform {
            offset: Vec2::new(map.offset[0], 1.0 - map.scale[1] - map.offset[1]),
            rotation: 0.0,
            scale: Vec2::from_array(map.scale),
        };
        texture
    }

    fn find(&mut self, map: &Map, folder: &str, variant: Variant, warnings: &mut Warnings) -> Option<ImageId> {
        let key = (join(folder, &map.file), variant);
        if let Some(known) = self.known.get(&key) {
            return *known;
        }
        let id = self.load(map, folder, variant, warnings);
        self.known.insert(key, id);
        id
    }

    fn load(&mut self, map: &Map, folder: &str, variant: Variant, warnings: &mut Warnings) -> Option<ImageId> {
        let place = format!("image \"{}\"", map.file);
        let bytes = match load_beside(self.loader, folder, &map.file, Role::Texture) {
            Ok(bytes) => bytes,
            Err(problem) => {
                warnings.push(&place, format!("{problem}; the map is left out"));
                return None;
            }
        };
        let content = Content::from_bytes(&bytes, &map.file);
        let made = match self.by_content.get(&(content, variant)) {
            Some(known) => known.clone(),
            None => self.make(&bytes, content, map, variant, &place, warnings),
        };
        self.by_content.insert((content, variant), made.clone());
        made.map_err(|problem| warnings.push(&place, format!("{problem}; the map is left out"))).ok()
    }

    /// Decodes and converts an image.
    fn make(
        &mut self,
        bytes: &[u8],
        content: Content,
        map: &Map,
        variant: Variant,
        place: &str,
        warnings: &mut Warnings,
    ) -> Result<ImageId, String> {
        let raw = self.store.decode(bytes, &map.file, place, warnings)?;
        let image = match variant {
            Variant::AsStored => raw,
            Variant::NormalsOfHeights { .. } if bake::looks_like_normals(&raw) => {
                warnings.push(place, "is named as a bump map but holds normals; it is used as a normal map");
                // The same image as that of a normal map.
                let as_stored = (content, Variant::AsStored);
                if let Some(known) = self.by_content.get(&as_stored) {
                    return known.clone();
                }
                let made = self.store.add(raw, place);
                self.by_content.insert(as_stored, made.clone());
                return made;
            }
            Variant::NormalsOfHeights { strength, clamp } => {
                bake::normals_of_heights(&raw, f32::from_bits(strength), clamp)
            }
            Variant::RoughnessOfExponents { factor } => bake::roughness_of_exponents(&raw, f32::from_bits(factor)),
        };
        self.store.add(image, place)
    }
}

/// Reads a file that a file in `folder` refers to: from there, otherwise from the scene's own folder.
///
/// # Errors
/// The fault of the first of these.
pub(super) fn load_beside(loader: &AssetLoader, folder: &str, name: &str, role: Role) -> Result<Vec<u8>, String> {
    let first = join(folder, name);
    loader.load_relative(&first, role).or_else(|e| match first != name {
        true => loader.load_relative(name, role).map_err(|_| e.problem),
        false => Err(e.problem),
    })
}

fn join(folder: &str, name: &str) -> String {
    if folder.is_empty() { name.to_string() } else { format!("{folder}/{name}") }
}
