//! Clear covers: detection of sheets that light crosses in chains of refractions, and the directions of these chains in
//! parallel plates.
//!
//! A refracting interface occludes a straight shadow ray. These sheets are detected when a scene is built
//! (`detect.rs`), and ordered in stacks (`stack.rs`). For a point and a light a stack gives the candidate chains
//! (`layer_crossing.rs`, `chain.rs`) and the first direction of each (`planar_layers.rs`). These directions are only
//! start values. The integrator finds the chain by tracing the real surface.

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
        self.covers.of_part.get(part as usize).copied().filter(|&c| c != scene_covers::NO_COVER)
    }
}
