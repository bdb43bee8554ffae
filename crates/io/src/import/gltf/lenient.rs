//! Reads JSON into [`Value`]. It accepts deviations of common files that the types of `gltf::json` refuse.
//!
//! - Members with the value `null` count as absent.
//! - Whole numbers written as `3.0` are integers.
//! - An index that does not fit 32 bits becomes one that is out of every range. `gltf::json` would remove its high
//!   bits.
//! - A reference to a texture without an index gets the index [`ABSENT`].
//! - Parts without effect on a still picture are skipped, with the faults in them. An extension that is not read
//!   becomes an empty object, so that its presence can be detected.
//!
//! Serde fills a struct also from an array, element by element. Here an array in the place of an object is an error.

use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Unexpected, Visitor};
use serde_json::{Map, Number, Value};
use std::fmt;

/// The index that means none.
pub(super) const ABSENT: u32 = u32::MAX;
/// Out of range of every list.
const OUT_OF_RANGE: u32 = u32::MAX - 1;
/// 2^53: above it an f64 does not distinguish neighbouring whole numbers.
const LARGEST_WHOLE: f64 = 9_007_199_254_740_992.0;

/// Members that are not read.
const UNREAD: &[&str] = &[
    "animations",
    "copyright",
    "extras",
    "generator",
    "max",
    "mimeType",
    "min",
    "minFilter",
    "occlusionTexture",
    "skeleton",
    "target",
    "thicknessTexture",
];

/// Members that contain indices, alone or in an array, or codes of 32 bits.
const INDICES: &[&str] = &[
    "buffer",
    "bufferView",
    "camera",
    "children",
    "componentType",
    "index",
    "indices",
    "inverseBindMatrices",
    "joints",
    "light",
    "magFilter",
    "material",
    "mesh",
    "mode",
    "nodes",
    "sampler",
    "scene",
    "skin",
    "source",
    "texCoord",
    "wrapS",
    "wrapT",
];

/// Members that are objects, besides references to textures and extensions.
const OBJECTS: &[&str] =
    &["asset", "extensions", "orthographic", "pbrMetallicRoughness", "perspective", "sparse", "spot", "values"];

/// Extensions whose members are read.
const READ_EXTENSIONS: &[&str] = &[
    "EXT_lights_ies",
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_materials_volume_scatter",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

/// Reads a JSON text whose outermost value is an object.
///
/// # Errors
/// Syntax and arrays in the place of objects, with line and column.
pub(super) fn read(json: &[u8]) -> Result<Map<String, Value>, serde_json::Error> {
    let mut deserializer = serde_json::Deserializer::from_slice(json);
    let value = deserializer.deserialize_map(Lenient { is_object: true, ..Lenient::default() })?;
    deserializer.end()?;
    match value {
        Value::Object(map) => Ok(map),
        _ => Err(serde_json::Error::custom("the outermost value is no object")),
    }
}

fn is_texture(key: &str) -> bool {
    key.ends_with("Texture")
}

/// The expected type of a value.
#[derive(Clone, Copy, Default)]
struct Lenient {
    /// An object, or a value that `gltf::json` refuses or skips, but no array.
    is_object: bool,
    /// Whole numbers are indices.
    holds_index: bool,
    /// Every member is an index: a primitive's attributes, and a morph target's.
    names_indices: bool,
    /// Every member is an extension.
    names_extensions: bool,
    /// An element of an array.
    in_list: bool,
}

impl Lenient {
    fn member(self, key: &str) -> Self {
        Self {
            is_object: self.names_extensions || OBJECTS.contains(&key) || is_texture(key),
            holds_index: self.names_indices || INDICES.contains(&key),
            names_indices: matches!(key, "attributes" | "targets"),
            names_extensions: key == "extensions",
            in_list: false,
        }
    }

    fn index(self, value: u64) -> Value {
        let most = u64::from(OUT_OF_RANGE);
        Value::from(if self.holds_index { value.min(most) } else { value })
    }
}

impl<'de> DeserializeSeed<'de> for Lenient {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Lenient {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.is_object || self.in_list { "an object" } else { "a value" })
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Bool(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(Value::from(value))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(self.index(value))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        let is_natural = value.fract() == 0.0 && (0.0..=LARGEST_WHOLE).contains(&value);
        if is_natural && (self.holds_index || value.is_sign_positive()) {
            return Ok(self.index(value as u64));
        }
        Number::from_f64(value).map(Value::Number).ok_or_else(|| E::invalid_value(Unexpected::Float(value), &self))
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(Value::String(value.to_owned()))
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Value, A::Error> {
        if self.is_object || self.in_list {
            return Err(A::Error::invalid_type(Unexpected::Seq, &self));
        }
        let mut values = Vec::new();
        while let Some(value) = list.next_element_seed(Self { in_list: true, ..self })? {
            values.push(value);
        }
        Ok(Value::Array(values))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        let mut map = Map::new();
        while let Some(key) = members.next_key::<String>()? {
            if UNREAD.contains(&key.as_str()) {
                members.next_value::<IgnoredAny>()?;
                continue;
            }
            if self.names_extensions && !READ_EXTENSIONS.contains(&key.as_str()) {
                if members.next_value::<Option<IgnoredAny>>()?.is_some() {
                    map.insert(key, Value::Object(Map::new()));
                }
                continue;
            }
            let value = members.next_value_seed(self.member(&key))?;
            if value.is_null() {
                continue;
            }
            let value = match value {
                Value::Object(mut info) if is_texture(&key) => {
                    info.entry("index").or_insert(ABSENT.into());
                    Value::Object(info)
                }
                other => other,
            };
            map.insert(key, value);
        }
        Ok(Value::Object(map))
    }
}
