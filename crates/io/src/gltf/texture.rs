//! Texture references: sampler, encoding, coordinates; images of the same content are decoded once.

use super::accessor::Accessors;
use super::container::Asset;
use super::schema::{self, TextureInfo, Whole};
use crate::image_store::{Content, ImageStore};
use crate::input::Role;
use crate::loader::AssetLoader;
use crate::warnings::Warnings;
use dunkelfeld_geometry::Vec2;
use dunkelfeld_scene::{ColorEncoding, Filter, Image, ImageId, Texture, TextureTransform, Wrap};
use std::collections::{BTreeMap, HashMap};

/// The images of one asset.
pub(super) struct Textures<'a> {
    asset: &'a Asset,
    accessors: &'a Accessors<'a>,
    loader: &'a AssetLoader,
    /// The images themselves.
    pub(super) store: ImageStore,
    /// By index in the file; `None` for one that cannot be read.
    known: BTreeMap<usize, Option<ImageId>>,
    /// By what the encoded image holds; what is wrong with it if it cannot be read.
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

    /// Resolves a reference. What cannot be used is left out with a warning, so that the factor alone remains.
    pub(super) fn resolve(
        &mut self,
        info: Option<&TextureInfo>,
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
        info: &TextureInfo,
        encoding: ColorEncoding,
        place: &str,
        warnings: &mut Warnings,
    ) -> Result<Option<Texture>, String> {
        let index = info.index.ok_or("it has no index")?.get();
        let document = &self.asset.document;
        let texture = document.textures.get(index).ok_or_else(|| format!("texture {index} does not exist"))?;
        let transform = info.extensions.transform.as_ref();
        let uv_set = transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord).0;
        let uv_set = u8::try_from(uv_set)
            .ok()
            .filter(|s| *s < 2)
            .ok_or_else(|| format!("it uses texture coordinate set {uv_set}, but only sets 0 and 1 are read"))?;
        let Some(image) = self.source(texture, warnings)? else { return Ok(None) };
        let sampler = match texture.sampler {
            None => schema::Sampler::default(),
            Some(s) => document.samplers.get(s.get()).cloned().unwrap_or_else(|| {
                warnings.push(place, format!("sampler {} does not exist; the default takes its place", s.0));
                schema::Sampler::default()
            }),
        };
        let mut wrap = |code: Option<Whole>| match code.map(|c| c.0) {
            None | Some(10497) => Wrap::Repeat,
            Some(33071) => Wrap::Clamp,
            Some(33648) => Wrap::Mirror,
            Some(other) => {
                warnings.push(place, format!("wrap mode {other} does not exist; the texture repeats"));
                Wrap::Repeat
            }
        };
        Ok(Some(Texture {
            image,
            encoding,
            wrap: [wrap(sampler.wrap_s), wrap(sampler.wrap_t)],
            filter: if sampler.mag_filter == Some(Whole(9728)) { Filter::Nearest } else { Filter::Linear },
            uv_set,
            transform: transform.map_or_else(TextureTransform::default, convert_transform),
        }))
    }

    /// The first image of a texture that can be read: its plain source, else the WebP one.
    fn source(&mut self, texture: &schema::Texture, warnings: &mut Warnings) -> Result<Option<ImageId>, String> {
        let webp = texture.extensions.webp.as_ref().and_then(|t| t.source);
        let candidates = [texture.source, webp];
        let mut any = false;
        for index in candidates.into_iter().flatten() {
            any = true;
            if let Some(id) = self.load(index.get(), warnings) {
                return Ok(Some(id));
            }
        }
        match (any, &texture.extensions.basisu) {
            (true, _) => Ok(None),
            (false, Some(_)) => Err("it has only a KTX2 image (KHR_texture_basisu), which cannot be read".into()),
            (false, None) => Err("it has no image".into()),
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
        let Some(image) = self.asset.document.images.get(index) else {
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
            (None, Some(view)) => self.accessors.view_bytes(view.get()).map_err(fail)?,
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

/// Measures or decodes an image, as the store does.
fn read(
    store: &mut ImageStore,
    bytes: &[u8],
    file_name: &str,
    name: &str,
    place: &str,
    warnings: &mut Warnings,
) -> Result<ImageId, String> {
    if store.measures() {
        let header = store.header(bytes, file_name)?;
        return store.add_measured(&header, place);
    }
    let decoded = store.decode(bytes, file_name, place, warnings)?;
    store.add(Image { name: name.to_owned(), ..decoded }, place)
}

fn convert_transform(t: &schema::TextureTransform) -> TextureTransform {
    let vector = |v: Option<[f64; 2]>, default: Vec2| {
        v.map(|[x, y]| Vec2::new(x as f32, y as f32)).filter(|v| v.is_finite()).unwrap_or(default)
    };
    TextureTransform {
        offset: vector(t.offset, Vec2::ZERO),
        rotation: t.rotation.map(|r| r as f32).filter(|r| r.is_finite()).unwrap_or(0.0),
        scale: vector(t.scale, Vec2::ONE),
    }
}

/// `offset + rotation * (scale * uv)`: the matrix of KHR_texture_transform, whose v axis points down.
pub(super) fn apply_transform(t: &TextureTransform, uv: Vec2) -> Vec2 {
    let (sin, cos) = t.rotation.sin_cos();
    let scaled = t.scale * uv;
    t.offset + Vec2::new(cos * scaled.x + sin * scaled.y, cos * scaled.y - sin * scaled.x)
}
