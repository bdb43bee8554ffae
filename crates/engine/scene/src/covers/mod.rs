//! Clear covers: detection of sheets that light crosses in chains of refractions, and the directions of these chains in
//! parallel plates.
//!
//! A refracting interface occludes a straight shadow ray. These sheets are detected when a scene is built
//! (`detect.rs`), and ordered in stacks (`stack.rs`). Between a point and a light a stack has candidate chains
//! (`layer_crossing.rs`, `chain.rs`), and each has a first direction (`planar_layers.rs`). One of them is chosen for each
//! lane (`candidates.rs`). These directions are only start values, in single precision. The integrator finds the chain
//! by tracing the real surface.

mod candidates;
mod chain;
mod detect;
mod layer_crossing;
mod planar_layers;
pub(crate) mod scene_covers;
mod slab_face;
mod stack;

pub use candidates::{CandidateChains, Targets, Wanted};
pub use chain::Chain;
use detect::find;
pub use stack::{CoverInterface, CoverLayer, CoverStack, MAX_CHAINS, MAX_INTERFACES};

use crate::build::effects::{Effect, material_place};
use crate::query::intersect::SurfacePoint;
use crate::scene::Scene;
use scene_covers::NO_COVER;

impl Scene {
    /// Detects covers, and records the materials that need their connection.
    pub(crate) fn find_covers(&mut self) {
        self.covers = find(self);
        for material in self.covers.stacks.iter().flat_map(|s| s.layers()).flat_map(|l| &l.materials) {
            let place = material_place(&self.materials[*material as usize]);
            self.effects.add(Effect::CoverConnection, place);
        }
    }

    /// The detected covers, each a stack of sheets. Empty if the technique was left out.
    #[inline]
    pub fn covers(&self) -> &[CoverStack] {
        &self.covers.stacks
    }

    /// Index of the stack that contains the smooth clear part of a surface point, its rim included.
    #[inline]
    pub fn cover_of(&self, p: &SurfacePoint) -> Option<u16> {
        self.cover_of_part(p.part)
    }

    /// Index of the stack that contains a part.
    #[inline]
    pub fn cover_of_part(&self, part: u32) -> Option<u16> {
        self.covers.of_part.get(part as usize).copied().filter(|&c| c != NO_COVER)
    }
}
