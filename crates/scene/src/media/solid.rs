//! Solids that light can enter.

use crate::media::medium::Medium;

/// A body that light can enter. Its index in the scene is its rank.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Solid {
    /// The material that says what fills it.
    pub(crate) material: u32,
    pub(crate) ior: f32,
    pub(crate) medium: Medium,
}
