//! Tests of the glTF import, on assets that are built in the tests themselves.

mod animation;
mod hostile;
mod materials;
mod meshes;
mod relaxed;
mod said;
mod support;
