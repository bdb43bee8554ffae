//! The validation of the crate `gltf`. It gives the reason for refusing a file without any usable mesh.
//!
//! Most of its findings do not justify the refusal of a file: indices are checked at their use, and missing bounds of
//! positions have no effect.

use gltf::json::mesh::{Primitive, Semantic};
use gltf::json::validation::{Checked, Error, Validate};
use gltf::json::{Path, Root};

/// Maximum number of findings in a message.
const MOST: usize = 3;

/// The first findings in accessors, buffer views, buffers and meshes, as `path: finding`.
pub(super) fn findings(root: &Root) -> Vec<String> {
    let mut found = Vec::new();
    let mut report = |path: &dyn Fn() -> Path, error: Error| {
        if found.len() < MOST && error != Error::Missing {
            found.push(format!("{}: {}", path(), error.to_string().to_lowercase()));
        }
    };
    let at = |name: &'static str| move || Path::new().field(name);
    root.buffers.validate(root, at("buffers"), &mut report);
    root.buffer_views.validate(root, at("bufferViews"), &mut report);
    root.accessors.validate(root, at("accessors"), &mut report);
    for (i, mesh) in root.meshes.iter().enumerate() {
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            let path = || at("meshes")().index(i).field("primitives").index(k);
            if has_positions(root, primitive) {
                primitive.validate(root, path, &mut report);
            } else {
                report(&|| path().field("attributes").key("POSITION"), Error::IndexOutOfBounds);
            }
        }
    }
    found
}

/// `Primitive::validate` panics at a POSITION whose accessor does not exist.
fn has_positions(root: &Root, primitive: &Primitive) -> bool {
    primitive.attributes.get(&Checked::Valid(Semantic::Positions)).is_none_or(|index| root.get(*index).is_some())
}
