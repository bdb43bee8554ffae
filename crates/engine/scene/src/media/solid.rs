//! Solids that light can enter.

use crate::media::medium::Medium;

/// A solid that light can enter. Its index in the scene is its rank.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) struct Solid {
    /// The material that defines its medium.
    pub(crate) material: u32,
    pub(crate) ior: f32,
    pub(crate) medium: Medium,
}
