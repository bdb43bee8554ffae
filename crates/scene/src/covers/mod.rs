//! Clear covers: which of a scene's solids are sheets that light crosses in chains of refractions, and where such a chain
//! would run if they were plates.
//!
//! To light sampling a refracting interface is an obstacle. These sheets are found when a scene is built (`find.rs`), put in
//! order (`stack.rs`), and answer for a point and a light (`crossing.rs`) which chains may connect them (`chain.rs`) and in
//! which direction each begins (`plate.rs`). Where the real surface lies is not decided here: a chain is found by tracing it.

mod chain;
mod detect;
mod layer_crossing;
pub mod planar_layers;
pub(crate) mod scene_covers;
mod slab_face;
mod stack;

pub use chain::Chain;
use detect::find;
pub use layer_crossing::{Candidate, Crossing, Seed};
pub use stack::{CoverInterface, CoverLayer, CoverStack, MAX_CHAINS, MAX_INTERFACES, Target};

use crate::build::effects::{Effect, material_place};
use crate::query::intersect::SurfacePoint;
use crate::scene::Scene;

impl Scene {
    /// Looks for covers, and notes which materials call for their connection.
    pub(crate) fn find_covers(&mut self) {
        self.covers = find(self);
        for material in self.covers.stacks.iter().flat_map(|s| s.layers()).flat_map(|l| &l.materials) {
            let place = material_place(&self.materials[*material as usize]);
            self.effects.call(Effect::CoverConnection, place);
        }
    }

    /// The covers that were found, each a stack of sheets; none if they were left out.
    #[inline]
    pub fn covers(&self) -> &[CoverStack] {
        &self.covers.stacks
    }

    /// Index of the stack that a surface belongs to with a smooth clear part, its rim included.
    #[inline]
    pub fn cover_of(&self, p: &SurfacePoint) -> Option<u16> {
        self.covers.of_part.get(p.part as usize).copied().filter(|&c| c != scene_covers::NO_COVER)
    }
}
