//! What a kernel is compiled with: the scene decides once, and what it does not call for is not in the code that runs.
//!
//! Each constant takes a branch, its loads and its registers out of the path loop. A scene may always be rendered by a
//! kernel that can do more. Detail, chance and solids then change no bit of the image; media walk through solids by another
//! (exact) bookkeeping, and change it by rounding only.

/// Constants that a kernel is compiled with.
pub trait Features: 'static {
    /// Surfaces that vary from place to place or have a direction: textures, vertex colours, normal maps, anisotropy.
    const TEXTURED: bool;
    /// Chance decides what a surface is: coverage, or a sheet that is partly clear.
    const STOCHASTIC: bool;
    /// Solids that light enters, and what they absorb.
    const SOLIDS: bool;
    /// Media that scatter, solids that touch or overlap, faces that light passes straight on, a camera inside a solid.
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

/// All features: right for every scene.
pub type AllFeatures = KernelFeatures<true, true, true, true>;

/// The features that a scene calls for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FeatureSet {
    /// See [`Features::TEXTURED`].
    pub detail: bool,
    /// See [`Features::STOCHASTIC`].
    pub chance: bool,
    /// See [`Features::SOLIDS`].
    pub solids: bool,
    /// See [`Features::MEDIA`].
    pub media: bool,
}

impl FeatureSet {
    /// All features.
    pub const ALL: Self = Self { detail: true, chance: true, solids: true, media: true };

    /// What either of two calls for.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self {
            detail: self.detail || other.detail,
            chance: self.chance || other.chance,
            solids: self.solids || other.solids,
            media: self.media || other.media,
        }
    }
}
