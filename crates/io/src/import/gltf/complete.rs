//! Adds members that `gltf::json` requires and that files leave out, and stores the codes that it does not support.

use super::lenient::ABSENT;
use gltf::json::{accessor, extensions::scene::khr_lights_punctual, material, mesh, texture};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

pub(super) const ACCESSOR_COMPONENT: &str = "accessors/*/componentType";
pub(super) const ACCESSOR_TYPE: &str = "accessors/*/type";
pub(super) const SPARSE_COMPONENT: &str = "accessors/*/sparse/indices/componentType";
pub(super) const ALPHA_MODE: &str = "materials/*/alphaMode";
pub(super) const LIGHT_TYPE: &str = "extensions/KHR_lights_punctual/lights/*/type";
pub(super) const PRIMITIVE_MODE: &str = "meshes/*/primitives/*/mode";
pub(super) const WRAP_S: &str = "samplers/*/wrapS";
pub(super) const WRAP_T: &str = "samplers/*/wrapT";

/// Codes outside the lists of the format, as in the file.
#[derive(Debug, Default)]
pub(super) struct UnknownCodes(BTreeMap<(&'static str, Vec<usize>), String>);

impl UnknownCodes {
    /// The code of a kind ([`ALPHA_MODE`] and so on) in the object at the path `indices`; empty if it is absent.
    pub(super) fn get(&self, kind: &'static str, indices: &[usize]) -> &str {
        self.0.get(&(kind, indices.to_vec())).map_or("", String::as_str)
    }
}

/// Completes the JSON of a document. Members of a wrong type remain, so that `gltf::json` refuses them.
pub(super) fn complete(document: &mut Map<String, Value>) -> UnknownCodes {
    let (zero, text, list, object) = (json!(0), json!(""), json!([]), json!({}));
    let required: [(&str, &[(&str, &Value)]); 15] = [
        ("accessors/*", &[("count", &zero), ("componentType", &zero), ("type", &text)]),
        ("accessors/*/sparse", &[("count", &zero), ("indices", &object), ("values", &object)]),
        ("accessors/*/sparse/indices", &[("bufferView", &zero), ("componentType", &zero)]),
        ("accessors/*/sparse/values", &[("bufferView", &zero)]),
        ("bufferViews/*", &[("buffer", &zero), ("byteLength", &zero)]),
        ("cameras/*", &[("type", &text)]),
        ("cameras/*/perspective", &[("yfov", &zero), ("znear", &zero)]),
        ("cameras/*/orthographic", &[("xmag", &zero), ("ymag", &zero), ("zfar", &zero), ("znear", &zero)]),
        ("extensions/KHR_lights_punctual", &[("lights", &list)]),
        ("extensions/KHR_lights_punctual/lights/*", &[("type", &text)]),
        ("meshes/*", &[("primitives", &list)]),
        ("meshes/*/primitives/*", &[("attributes", &object)]),
        ("nodes/*/extensions/KHR_lights_punctual", &[("light", &json!(ABSENT))]),
        ("scenes/*", &[("nodes", &list)]),
        ("skins/*", &[("joints", &list)]),
    ];
    for (path, members) in required {
        each(document, path, &mut |object, _| {
            for (name, value) in members {
                object.entry(*name).or_insert_with(|| (*value).clone());
            }
        });
    }
    // Unused names and unread extensions may have any value.
    for path in ["accessors/*", "bufferViews/*", "buffers/*", "samplers/*", "textures/*"] {
        each(document, path, &mut |object, _| drop(object.remove("name")));
    }
    for path in
        ["accessors/*", "asset", "buffers/*", "cameras/*", "images/*", "meshes/*", "samplers/*", "scenes/*", "skins/*"]
    {
        each(document, path, &mut |object, _| drop(object.remove("extensions")));
    }
    unknown_codes(document)
}

fn unknown_codes(document: &mut Map<String, Value>) -> UnknownCodes {
    enum Known {
        Codes(&'static [u32]),
        Names(&'static [&'static str]),
    }
    use Known::{Codes, Names};
    let mut unknown = UnknownCodes::default();
    for (kind, known) in [
        (ACCESSOR_COMPONENT, Codes(accessor::VALID_COMPONENT_TYPES)),
        (ACCESSOR_TYPE, Names(accessor::VALID_ACCESSOR_TYPES)),
        (SPARSE_COMPONENT, Codes(accessor::VALID_INDEX_TYPES)),
        (ALPHA_MODE, Names(material::VALID_ALPHA_MODES)),
        (LIGHT_TYPE, Names(khr_lights_punctual::VALID_TYPES)),
        (PRIMITIVE_MODE, Codes(mesh::VALID_MODES)),
        (WRAP_S, Codes(texture::VALID_WRAPPING_MODES)),
        (WRAP_T, Codes(texture::VALID_WRAPPING_MODES)),
    ] {
        let Some((path, name)) = kind.rsplit_once('/') else { continue };
        each(document, path, &mut |object, indices| {
            let code = match (object.get(name), &known) {
                (Some(Value::Number(n)), Codes(known)) if !known.iter().any(|k| n.as_u64() == Some(u64::from(*k))) => {
                    n.to_string()
                }
                (Some(Value::String(s)), Names(known)) if !known.contains(&s.as_str()) => s.clone(),
                _ => return,
            };
            unknown.0.insert((kind, indices.to_vec()), code);
        });
    }
    unknown
}

/// Calls `act` with every object of a path, and the indices on the path; `*` means each element.
fn each(document: &mut Map<String, Value>, path: &str, act: &mut impl FnMut(&mut Map<String, Value>, &[usize])) {
    fn descend(
        value: &mut Value,
        steps: &[&str],
        indices: &mut Vec<usize>,
        act: &mut impl FnMut(&mut Map<String, Value>, &[usize]),
    ) {
        match (steps, value) {
            ([], Value::Object(object)) => act(object, indices),
            (["*", rest @ ..], Value::Array(list)) => {
                for (i, element) in list.iter_mut().enumerate() {
                    indices.push(i);
                    descend(element, rest, indices, act);
                    indices.pop();
                }
            }
            ([name, rest @ ..], Value::Object(object)) => {
                if let Some(member) = object.get_mut(*name) {
                    descend(member, rest, indices, act);
                }
            }
            _ => {}
        }
    }
    let steps: Vec<&str> = path.split('/').collect();
    if let [name, rest @ ..] = &steps[..]
        && let Some(member) = document.get_mut(*name)
    {
        descend(member, rest, &mut Vec::new(), act);
    }
}
