//! Compile-time features of a kernel. The scene selects them once, and code for features that it does not need is not
//! in the kernel.
//!
//! Each constant removes a branch, its loads and its registers from the path loop. A kernel with more features can
//! render any scene of fewer. Textures, stochastic surfaces and solids then change no bit of the image. Media use
//! another (exact) bookkeeping for solids, which changes the image by rounding only.

/// Constants that a kernel is compiled with.
pub trait Features: 'static {
    /// Surfaces that vary from place to place or have a direction: textures, vertex colours, normal maps, anisotropy.
    const TEXTURED: bool;
    /// Random surfaces: coverage, or a sheet that is partly clear.
    const STOCHASTIC: bool;
    /// Solids that light enters, and their absorption.
    const SOLIDS: bool;
    /// Media that scatter, solids that touch or overlap, faces that do not bend light, a camera inside a solid.
    const MEDIA: bool;
}

/// A set of features as a type.
#[derive(Clone, Copy, Debug)]
pub struct KernelFeatures<const TEXTURED: bool, const STOCHASTIC: bool, const SOLIDS: bool, const MEDIA: bool>;

impl<const TEXTURED: bool, const STOCHASTIC: bool, const SOLIDS: bool, const MEDIA: bool> Features
    for KernelFeatures<TEXTURED, STOCHASTIC, SOLIDS, MEDIA>
{
    const TEXTURED: bool = TEXTURED;
    const STOCHASTIC: bool = STOCHASTIC;
    const SOLIDS: bool = SOLIDS;
    const MEDIA: bool = MEDIA;
}

/// All features: correct for every scene.
pub type AllFeatures = KernelFeatures<true, true, true, true>;

/// The features that a scene needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct FeatureSet {
    /// See [`Features::TEXTURED`].
    pub textured: bool,
    /// See [`Features::STOCHASTIC`].
    pub stochastic: bool,
    /// See [`Features::SOLIDS`].
    pub solids: bool,
    /// See [`Features::MEDIA`].
    pub media: bool,
}

impl FeatureSet {
    /// All features.
    pub const ALL: Self = Self { textured: true, stochastic: true, solids: true, media: true };

    /// The union of two sets.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self {
            textured: self.textured || other.textured,
            stochastic: self.stochastic || other.stochastic,
            solids: self.solids || other.solids,
            media: self.media || other.media,
        }
    }
}
