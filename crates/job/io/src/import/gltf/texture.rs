//! Texture references: sampler, encoding, coordinates; images of the same content are decoded once.

use super::accessor::Accessors;
use super::container::Asset;
use crate::import::image_store::{Content, ImageStore};
use crate::import::warnings::Warnings;
use crate::input::Role;
use crate::loader::AssetLoader;
use dunkelfeld_geometry::Vec2;
use dunkelfeld_scene::{ColorEncoding, Filter, Image, ImageId, Texture, TextureTransform, Wrap};
use gltf::json::extensions::texture::TextureTransform as JsonTransform;
use gltf::json::texture::{Info, MagFilter, Sampler, WrappingMode};
use gltf::json::validation::Checked;
use std::collections::{BTreeMap, HashMap};

/// The images of one asset.
pub(super) struct Textures<'a> {
    asset: &'a Asset,
    accessors: &'a Accessors<'a>,
    loader: &'a AssetLoader,
    /// The images themselves.
    pub(super) store: ImageStore,
    /// By index in the file; `None` for an image that cannot be read.
    known: BTreeMap<usize, Option<ImageId>>,
    /// By a hash of the encoded image. The fault, if it cannot be read.
    by_content: HashMap<Content, Result<ImageId, String>>,
}

impl<'a> Textures<'a> {
    pub(super) fn new(
        asset: &'a Asset,
        accessors: &'a Accessors<'a>,
        loader: &'a AssetLoader,
        store: ImageStore,
    ) -> Self {
        Self { asset, accessors, loader, store, known: BTreeMap::new(), by_content: HashMap::new() }
    }

    /// Resolves a reference. An unusable texture is left out with a warning, so that only the factor remains.
    pub(super) fn resolve(
        &mut self,
        info: Option<&Info>,
        encoding: ColorEncoding,
        place: &str,
        warnings: &mut Warnings,
    ) -> Option<Texture> {
        let info = info?;
        self.try_resolve(info, encoding, place, warnings)
            .map_err(|e| warnings.push(place, format!("a texture is left out: {e}")))
            .ok()
            .flatten()
    }

    fn try_resolve(
        &mut self,
        info: &Info,
        encoding: ColorEncoding,
        place: &str,
        warnings: &mut Warnings,
    ) -> Result<Option<Texture>, String> {
        let document = &self.asset.document;
        let texture = document.root.get(info.index).ok_or_else(|| format!("texture {} does not exist", info.index))?;
        let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
        let uv_set = transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
        let uv_set = u8::try_from(uv_set)
            .ok()
            .filter(|s| *s < 2)
            .ok_or_else(|| format!("it uses texture coordinate set {uv_set}, but only sets 0 and 1 are read"))?;
        let Some(image) = self.source(info.index.value(), warnings)? else { return Ok(None) };
        let sampler = match texture.sampler {
            None => Sampler::default(),
            Some(s) => document.root.get(s).cloned().unwrap_or_else(|| {
                warnings.push(place, format!("sampler {s} does not exist; the default takes its place"));
                Sampler::default()
            }),
        };
        let mut wrap = |mode: Checked<WrappingMode>| match mode {
            Checked::Valid(WrappingMode::Repeat) => Wrap::Repeat,
            Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
            Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
            Checked::Invalid => {
                warnings.push(place, "the wrap mode of a texture does not exist; the texture repeats");
                Wrap::Repeat
            }
        };
        let is_nearest = matches!(sampler.mag_filter, Some(Checked::Valid(MagFilter::Nearest)));
        Ok(Some(Texture {
            image,
            encoding,
            wrap: [wrap(sampler.wrap_s), wrap(sampler.wrap_t)],
            filter: if is_nearest { Filter::Nearest } else { Filter::Linear },
            uv_set,
            channel: 0,
            transform: transform.map_or_else(TextureTransform::default, convert_transform),
        }))
    }

    /// The first image of a texture that can be read: its plain source, else the WebP one.
    fn source(&mut self, index: usize, warnings: &mut Warnings) -> Result<Option<ImageId>, String> {
        let document = &self.asset.document;
        let texture = document.root.textures.get(index);
        // The crate's value for a texture without a source.
        let plain = texture.map(|t| t.source).filter(|s| s.value() != u32::MAX as usize);
        let candidates = [plain, document.untyped.textures.get(index).and_then(|t| t.extensions.webp.source)];
        let extensions = texture.and_then(|t| t.extensions.as_ref());
        let has_basisu = extensions.is_some_and(|e| e.others.contains_key("KHR_texture_basisu"));
        let mut any = false;
        for index in candidates.into_iter().flatten() {
            any = true;
            if let Some(id) = self.load(index.value(), warnings) {
                return Ok(Some(id));
            }
        }
        match (any, has_basisu) {
            (true, _) => Ok(None),
            (false, true) => Err("it has only a KTX2 image (KHR_texture_basisu), which cannot be read".into()),
            (false, false) => Err("it has no image".into()),
        }
    }

    fn load(&mut self, index: usize, warnings: &mut Warnings) -> Option<ImageId> {
        if let Some(known) = self.known.get(&index) {
            return *known;
        }
        let id = self.decode(index, warnings).map_err(|(place, e)| warnings.push(place, e)).ok();
        self.known.insert(index, id);
        id
    }

    fn decode(&mut self, index: usize, warnings: &mut Warnings) -> Result<ImageId, (String, String)> {
        let number = format!("image {index}");
        let Some(image) = self.asset.document.root.images.get(index) else {
            return Err((number, "the image does not exist; its textures are left out".into()));
        };
        let uri = image.uri.as_deref().filter(|u| !u.get(..5).is_some_and(|s| s.eq_ignore_ascii_case("data:")));
        let name = image.name.as_deref().or(uri).unwrap_or(&number);
        let place = if name == number { number.clone() } else { format!("{number} \"{name}\"") };
        let fail = |e: String| (place.clone(), format!("{e}; its textures are left out"));
        let loaded;
        let bytes = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => {
                loaded = self.loader.load_uri(uri, Role::Texture).map_err(|e| fail(e.problem))?;
                &loaded
            }
            (None, Some(view)) => self.accessors.view_bytes(view.value()).map_err(fail)?,
            (None, None) => return Err(fail("it has neither a URI nor a buffer view".into())),
        };
        let content = Content::from_bytes(bytes, uri.unwrap_or(name));
        if let Some(known) = self.by_content.get(&content) {
            return known.clone().map_err(fail);
        }
        let read = read(&mut self.store, bytes, uri.unwrap_or(name), name, &place, warnings);
        self.by_content.insert(content, read.clone());
        read.map_err(fail)
    }
}

/// Decodes an image.
fn read(
    store: &mut ImageStore,
    bytes: &[u8],
    file_name: &str,
    name: &str,
    place: &str,
    warnings: &mut Warnings,
) -> Result<ImageId, String> {
    let decoded = store.decode(bytes, file_name, place, warnings)?;
    store.add(Image { name: name.to_owned(), ..decoded }, place)
}

fn convert_transform(t: &JsonTransform) -> TextureTransform {
    let vector = |v: [f32; 2], default: Vec2| Some(Vec2::from_array(v)).filter(|v| v.is_finite()).unwrap_or(default);
    TextureTransform {
        offset: vector(t.offset.0, Vec2::ZERO),
        rotation: Some(t.rotation.0).filter(|r| r.is_finite()).unwrap_or(0.0),
        scale: vector(t.scale.0, Vec2::ONE),
    }
}

/// `offset + rotation * (scale * uv)`: the matrix of KHR_texture_transform, whose v axis points down.
pub(super) fn apply_transform(t: &TextureTransform, uv: Vec2) -> Vec2 {
    let (sin, cos) = t.rotation.sin_cos();
    let scaled = t.scale * uv;
    t.offset + Vec2::new(cos * scaled.x + sin * scaled.y, cos * scaled.y - sin * scaled.x)
}
