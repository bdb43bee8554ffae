//! The stages of a render.

use serde::{Deserialize, Serialize};

/// Stages of a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Stage {
    /// Reading files.
    Load,
    /// Building the acceleration structure and tables.
    Build,
    /// Training of the learned Russian roulette.
    Training,
    /// The uniform pilot.
    Pilot,
    /// Planning, and a trial of the final steps.
    Plan,
    /// Rounds with samples by the plan.
    Refine,
    /// Electrons and grey values.
    Expose,
    /// Denoising of a picture for display.
    Denoise,
    /// Writing files.
    Write,
}

impl Stage {
    /// Name for messages and statistics.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Load => "load",
            Self::Build => "build",
            Self::Training => "training",
            Self::Pilot => "pilot",
            Self::Plan => "plan",
            Self::Refine => "refine",
            Self::Expose => "expose",
            Self::Denoise => "denoise",
            Self::Write => "write",
        }
    }
}
