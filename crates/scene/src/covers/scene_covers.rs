//! The covers that a scene has.

use super::stack::CoverStack;

/// The covers of a scene.
#[derive(Clone, Debug, Default)]
pub(crate) struct Covers {
    pub(crate) stacks: Vec<CoverStack>,
    /// For each part the stack that it belongs to, [`NO_COVER`] if to none; empty without any stack.
    pub(crate) of_part: Vec<u16>,
}

/// Marks parts that are no cover.
pub(crate) const NO_COVER: u16 = u16::MAX;
