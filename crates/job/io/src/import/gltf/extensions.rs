//! Extensions without types in `gltf::json`, read from its raw JSON, and node transforms in f64.

use gltf::json::extensions::texture::TextureTransform;
use gltf::json::{Accessor, Image, Index, texture::Info};
use serde::Deserialize;
use std::collections::BTreeMap;

/// A node's transform as in the file: `gltf::json` rounds it to f32.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Transform {
    pub(super) matrix: Option<[f64; 16]>,
    pub(super) translation: Option<[f64; 3]>,
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
}

/// Declares structs that read camelCase JSON objects and use defaults for absent members.
macro_rules! extensions {
    ($($(#[$meta:meta])* struct $name:ident { $($(#[$field_meta:meta])* $field:ident: $type:ty = $default:expr,)* })*) => {$(
        $(#[$meta])*
        #[derive(Clone, Debug, Deserialize)]
        #[serde(default, rename_all = "camelCase")]
        pub(super) struct $name { $($(#[$field_meta])* pub(super) $field: $type,)* }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }
    )*};
}

extensions! {
    /// The lists are parallel to those of the document.
    struct Untyped {
        nodes: Vec<Node> = Vec::new(),
        materials: Vec<Material> = Vec::new(),
        textures: Vec<Texture> = Vec::new(),
    }

    struct Node {
        #[serde(flatten)]
        transform: Transform = Transform::default(),
        extensions: OfNode = OfNode::default(),
    }

    struct Material {
        extensions: OfMaterial = OfMaterial::default(),
        normal_texture: NormalTexture = NormalTexture::default(),
    }

    struct NormalTexture { extensions: OfNormalTexture = OfNormalTexture::default(), }

    struct Texture { extensions: OfTexture = OfTexture::default(), }

    struct OfNode {
        #[serde(rename = "EXT_mesh_gpu_instancing")]
        instancing: Option<Instancing> = None,
        #[serde(rename = "KHR_node_visibility")]
        visibility: Visibility = Visibility::default(),
    }

    struct Instancing { attributes: BTreeMap<String, Index<Accessor>> = BTreeMap::new(), }

    struct Visibility { visible: bool = true, }

    struct OfTexture {
        #[serde(rename = "EXT_texture_webp")]
        webp: TextureSource = TextureSource::default(),
    }

    struct TextureSource { source: Option<Index<Image>> = None, }

    struct OfNormalTexture {
        #[serde(rename = "KHR_texture_transform")]
        transform: Option<TextureTransform> = None,
    }

    struct OfMaterial {
        #[serde(rename = "KHR_materials_anisotropy")]
        anisotropy: Option<Anisotropy> = None,
        #[serde(rename = "KHR_materials_clearcoat")]
        clearcoat: Option<Clearcoat> = None,
        #[serde(rename = "KHR_materials_diffuse_transmission")]
        diffuse_transmission: Option<DiffuseTransmission> = None,
        #[serde(rename = "KHR_materials_sheen")]
        sheen: Option<Sheen> = None,
        #[serde(rename = "KHR_materials_volume_scatter")]
        volume_scatter: Option<VolumeScatter> = None,
    }

    struct Anisotropy {
        anisotropy_strength: f32 = 0.0,
        anisotropy_rotation: f32 = 0.0,
        anisotropy_texture: Option<Info> = None,
    }

    struct Clearcoat {
        clearcoat_factor: f32 = 0.0,
        clearcoat_texture: Option<Info> = None,
        clearcoat_roughness_factor: f32 = 0.0,
        clearcoat_roughness_texture: Option<Info> = None,
        clearcoat_normal_texture: Option<Info> = None,
    }

    struct DiffuseTransmission {
        diffuse_transmission_factor: f32 = 0.0,
        diffuse_transmission_texture: Option<Info> = None,
        diffuse_transmission_color_factor: [f32; 3] = [1.0; 3],
        diffuse_transmission_color_texture: Option<Info> = None,
    }

    struct Sheen {
        sheen_color_factor: [f32; 3] = [0.0; 3],
        sheen_color_texture: Option<Info> = None,
        sheen_roughness_factor: f32 = 0.0,
    }

    /// The name of the colour is `multiscatterColor` in the schema of the draft and `scatterAlbedo` in an earlier text.
    struct VolumeScatter {
        multiscatter_color: Option<[f32; 3]> = None,
        scatter_albedo: Option<[f32; 3]> = None,
        scatter_anisotropy: f32 = 0.0,
    }
}
