//! The covers of a scene.

use super::stack::CoverStack;

/// The covers of a scene, and the parts that belong to them.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub(crate) struct Covers {
    pub(crate) stacks: Vec<CoverStack>,
    /// For each part the index of its stack, or [`NO_COVER`]; empty without any stack.
    pub(crate) of_part: Vec<u16>,
}

/// Marks parts that are no cover.
pub(crate) const NO_COVER: u16 = u16::MAX;
