//! Participating media and the solids that contain them.

pub mod medium;
pub mod medium_stack;
pub mod nested_dielectrics;
pub(crate) mod solid;
