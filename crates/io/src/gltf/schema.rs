//! The part of the glTF 2.0 JSON that matters to a still picture, as Rust types; everything else is ignored.
//!
//! Types are strict (a string where a number belongs is an error with line and column), values are not: every index,
//! count and factor is judged where it is used.

use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{self, Deserializer, Visitor};
use std::collections::BTreeMap;

/// A non-negative whole number: an index or a count. Some exporters write `3.0`, which is accepted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Whole(pub(super) u64);

impl Whole {
    /// As an index; what exceeds the address space is out of every range.
    pub(super) fn get(self) -> usize {
        usize::try_from(self.0).unwrap_or(usize::MAX)
    }
}

impl<'de> Deserialize<'de> for Whole {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct WholeVisitor;
        impl Visitor<'_> for WholeVisitor {
            type Value = Whole;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a whole number that is not negative")
            }
            fn visit_u64<E: de::Error>(self, v: u64) -> Result<Whole, E> {
                Ok(Whole(v))
            }
            fn visit_f64<E: de::Error>(self, v: f64) -> Result<Whole, E> {
                // 2^53: above it an f64 no longer tells neighbouring whole numbers apart.
                if v >= 0.0 && v.fract() == 0.0 && v <= 9_007_199_254_740_992.0 {
                    Ok(Whole(v as u64))
                } else {
                    Err(E::invalid_value(de::Unexpected::Float(v), &self))
                }
            }
        }
        deserializer.deserialize_any(WholeVisitor)
    }
}

/// Declares structs that read camelCase JSON objects and take defaults for what is absent.
///
/// Serde would also fill a struct from an array, element by element; here an array in an object's place is an error.
macro_rules! schema {
    ($($(#[$meta:meta])* struct $name:ident { $($(#[$field_meta:meta])* $field:ident: $type:ty,)* })*) => {$(
        $(#[$meta])*
        #[derive(Clone, Debug, Default, Deserialize)]
        #[serde(default, rename_all = "camelCase", remote = "Self")]
        pub(super) struct $name { $($(#[$field_meta])* pub(super) $field: $type,)* }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct ObjectVisitor;
                impl<'de> Visitor<'de> for ObjectVisitor {
                    type Value = $name;
                    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                        f.write_str("an object")
                    }
                    fn visit_map<A: de::MapAccess<'de>>(self, map: A) -> Result<$name, A::Error> {
                        $name::deserialize(MapAccessDeserializer::new(map))
                    }
                }
                deserializer.deserialize_map(ObjectVisitor)
            }
        }
    )*};
}

schema! {
    /// What is read before anything else, to tell versions apart.
    struct Preamble { asset: Option<Asset>, }

    struct Asset { version: Option<String>, min_version: Option<String>, }

    struct Document {
        extensions_used: Vec<String>,
        extensions_required: Vec<String>,
        scene: Option<Whole>,
        scenes: Vec<Scene>,
        nodes: Vec<Node>,
        meshes: Vec<Mesh>,
        skins: Vec<Skin>,
        cameras: Vec<Camera>,
        materials: Vec<Material>,
        textures: Vec<Texture>,
        samplers: Vec<Sampler>,
        images: Vec<Image>,
        accessors: Vec<Accessor>,
        buffer_views: Vec<BufferView>,
        buffers: Vec<Buffer>,
        extensions: DocumentExtensions,
    }

    struct DocumentExtensions {
        #[serde(rename = "KHR_lights_punctual")]
        lights: Option<Lights>,
        #[serde(rename = "EXT_lights_ies")]
        profiles: Option<Profiles>,
    }

    struct Lights { lights: Vec<Light>, }

    struct Light {
        name: Option<String>,
        #[serde(rename = "type")]
        kind: Option<String>,
        color: Option<[f64; 3]>,
        intensity: Option<f64>,
        range: Option<f64>,
        spot: Option<Spot>,
    }

    struct Profiles { lights: Vec<Profile>, }

    struct Profile { name: Option<String>, uri: Option<String>, buffer_view: Option<Whole>, }

    struct Spot { inner_cone_angle: Option<f64>, outer_cone_angle: Option<f64>, }

    struct Scene { name: Option<String>, nodes: Vec<Whole>, }

    struct Node {
        name: Option<String>,
        children: Vec<Whole>,
        matrix: Option<[f64; 16]>,
        translation: Option<[f64; 3]>,
        rotation: Option<[f64; 4]>,
        scale: Option<[f64; 3]>,
        mesh: Option<Whole>,
        skin: Option<Whole>,
        camera: Option<Whole>,
        weights: Option<Vec<f64>>,
        extensions: NodeExtensions,
    }

    struct NodeExtensions {
        #[serde(rename = "KHR_lights_punctual")]
        light: Option<LightReference>,
        #[serde(rename = "EXT_lights_ies")]
        profile: Option<ProfileReference>,
        #[serde(rename = "EXT_mesh_gpu_instancing")]
        instancing: Option<Instancing>,
        #[serde(rename = "KHR_node_visibility")]
        visibility: Option<Visibility>,
    }

    struct LightReference { light: Option<Whole>, }

    struct ProfileReference { light: Option<Whole>, multiplier: Option<f64>, color: Option<[f64; 3]>, }

    struct Instancing { attributes: BTreeMap<String, Whole>, }

    struct Visibility { visible: Option<bool>, }

    struct Mesh { name: Option<String>, primitives: Vec<Primitive>, weights: Option<Vec<f64>>, }

    struct Primitive {
        attributes: BTreeMap<String, Whole>,
        indices: Option<Whole>,
        material: Option<Whole>,
        mode: Option<Whole>,
        targets: Vec<BTreeMap<String, Whole>>,
        extensions: PrimitiveExtensions,
    }

    struct PrimitiveExtensions {
        #[serde(rename = "KHR_draco_mesh_compression")]
        draco: Option<de::IgnoredAny>,
    }

    struct Skin { name: Option<String>, joints: Vec<Whole>, inverse_bind_matrices: Option<Whole>, }

    struct Camera {
        name: Option<String>,
        #[serde(rename = "type")]
        kind: Option<String>,
        perspective: Option<Perspective>,
        orthographic: Option<Orthographic>,
    }

    struct Perspective { yfov: Option<f64>, aspect_ratio: Option<f64>, }

    struct Orthographic { xmag: Option<f64>, ymag: Option<f64>, }

    struct Accessor {
        buffer_view: Option<Whole>,
        byte_offset: Whole,
        component_type: Whole,
        normalized: bool,
        count: Whole,
        #[serde(rename = "type")]
        kind: String,
        sparse: Option<Sparse>,
    }

    struct Sparse { count: Whole, indices: SparseIndices, values: SparseValues, }

    struct SparseIndices { buffer_view: Whole, byte_offset: Whole, component_type: Whole, }

    struct SparseValues { buffer_view: Whole, byte_offset: Whole, }

    struct BufferView {
        buffer: Whole,
        byte_offset: Whole,
        byte_length: Whole,
        byte_stride: Option<Whole>,
        extensions: BufferViewExtensions,
    }

    struct BufferViewExtensions {
        #[serde(rename = "EXT_meshopt_compression")]
        meshopt: Option<de::IgnoredAny>,
    }

    struct Buffer { uri: Option<String>, byte_length: Whole, }

    struct Image { name: Option<String>, uri: Option<String>, buffer_view: Option<Whole>, }

    struct Sampler { mag_filter: Option<Whole>, wrap_s: Option<Whole>, wrap_t: Option<Whole>, }

    struct Texture { sampler: Option<Whole>, source: Option<Whole>, extensions: TextureExtensions, }

    struct TextureExtensions {
        #[serde(rename = "EXT_texture_webp")]
        webp: Option<TextureSource>,
        #[serde(rename = "KHR_texture_basisu")]
        basisu: Option<TextureSource>,
    }

    struct TextureSource { source: Option<Whole>, }

    /// A reference to a texture, with the `scale` that only normal textures have.
    struct TextureInfo {
        index: Option<Whole>,
        tex_coord: Whole,
        scale: Option<f64>,
        extensions: TextureInfoExtensions,
    }

    struct TextureInfoExtensions {
        #[serde(rename = "KHR_texture_transform")]
        transform: Option<TextureTransform>,
    }

    struct TextureTransform {
        offset: Option<[f64; 2]>,
        rotation: Option<f64>,
        scale: Option<[f64; 2]>,
        tex_coord: Option<Whole>,
    }

    struct Material {
        name: Option<String>,
        pbr_metallic_roughness: MetallicRoughness,
        normal_texture: Option<TextureInfo>,
        emissive_texture: Option<TextureInfo>,
        emissive_factor: Option<[f64; 3]>,
        alpha_mode: Option<String>,
        alpha_cutoff: Option<f64>,
        double_sided: bool,
        extensions: MaterialExtensions,
    }

    struct MetallicRoughness {
        base_color_factor: Option<[f64; 4]>,
        base_color_texture: Option<TextureInfo>,
        metallic_factor: Option<f64>,
        roughness_factor: Option<f64>,
        metallic_roughness_texture: Option<TextureInfo>,
    }

    struct MaterialExtensions {
        #[serde(rename = "KHR_materials_anisotropy")]
        anisotropy: Option<Anisotropy>,
        #[serde(rename = "KHR_materials_clearcoat")]
        clearcoat: Option<Clearcoat>,
        #[serde(rename = "KHR_materials_diffuse_transmission")]
        diffuse_transmission: Option<DiffuseTransmission>,
        #[serde(rename = "KHR_materials_emissive_strength")]
        emissive_strength: Option<EmissiveStrength>,
        #[serde(rename = "KHR_materials_ior")]
        ior: Option<Ior>,
        #[serde(rename = "KHR_materials_pbrSpecularGlossiness")]
        specular_glossiness: Option<SpecularGlossiness>,
        #[serde(rename = "KHR_materials_sheen")]
        sheen: Option<Sheen>,
        #[serde(rename = "KHR_materials_specular")]
        specular: Option<Specular>,
        #[serde(rename = "KHR_materials_transmission")]
        transmission: Option<Transmission>,
        #[serde(rename = "KHR_materials_unlit")]
        unlit: Option<de::IgnoredAny>,
        #[serde(rename = "KHR_materials_volume")]
        volume: Option<Volume>,
        #[serde(rename = "KHR_materials_volume_scatter")]
        volume_scatter: Option<VolumeScatter>,
    }

    struct Anisotropy {
        anisotropy_strength: Option<f64>,
        anisotropy_rotation: Option<f64>,
        anisotropy_texture: Option<TextureInfo>,
    }

    struct Clearcoat {
        clearcoat_factor: Option<f64>,
        clearcoat_texture: Option<TextureInfo>,
        clearcoat_roughness_factor: Option<f64>,
        clearcoat_roughness_texture: Option<TextureInfo>,
        clearcoat_normal_texture: Option<TextureInfo>,
    }

    struct DiffuseTransmission {
        diffuse_transmission_factor: Option<f64>,
        diffuse_transmission_texture: Option<TextureInfo>,
        diffuse_transmission_color_factor: Option<[f64; 3]>,
        diffuse_transmission_color_texture: Option<TextureInfo>,
    }

    struct EmissiveStrength { emissive_strength: Option<f64>, }

    struct Ior { ior: Option<f64>, }

    struct SpecularGlossiness {
        diffuse_factor: Option<[f64; 4]>,
        diffuse_texture: Option<TextureInfo>,
        specular_factor: Option<[f64; 3]>,
        glossiness_factor: Option<f64>,
        specular_glossiness_texture: Option<TextureInfo>,
    }

    struct Sheen {
        sheen_color_factor: Option<[f64; 3]>,
        sheen_color_texture: Option<TextureInfo>,
        sheen_roughness_factor: Option<f64>,
    }

    struct Specular {
        specular_factor: Option<f64>,
        specular_texture: Option<TextureInfo>,
        specular_color_factor: Option<[f64; 3]>,
        specular_color_texture: Option<TextureInfo>,
    }

    struct Transmission { transmission_factor: Option<f64>, transmission_texture: Option<TextureInfo>, }

    /// The draft calls the colour `multiscatterColor` in its schema and `scatterAlbedo` in an earlier text.
    struct VolumeScatter {
        multiscatter_color: Option<[f64; 3]>,
        scatter_albedo: Option<[f64; 3]>,
        scatter_anisotropy: Option<f64>,
    }

    struct Volume {
        thickness_factor: Option<f64>,
        attenuation_distance: Option<f64>,
        attenuation_color: Option<[f64; 3]>,
    }
}
