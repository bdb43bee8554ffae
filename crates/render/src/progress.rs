//! What a long render tells its caller, and how the caller tells it to stop.

use crate::plan::forecast::Forecast;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, Ordering};

/// Where a render stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProgressState {
    /// What is being done.
    pub stage: Stage,
    /// Share of the render that is done, in \[0, 1\].
    pub fraction: f64,
    /// Seconds since the start of the command.
    pub elapsed: f64,
    /// Seconds that are expected to remain; `None` while nothing is known.
    pub remaining: Option<f64>,
    /// Camera samples taken so far.
    pub samples: u64,
}

/// Stretches of a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Stage {
    /// Reading files.
    Load,
    /// Building the acceleration structure and tables.
    Build,
    /// The uniform pilot.
    Pilot,
    /// Deciding where samples go, and rehearsing the end.
    Plan,
    /// Rounds with the samples where they are needed.
    Refine,
    /// Electrons and grey values.
    Expose,
    /// The noise goes, from a picture that is only looked at.
    Denoise,
    /// Writing files.
    Write,
}

impl Stage {
    /// Name for people and for the statistics.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Load => "load",
            Self::Build => "build",
            Self::Pilot => "pilot",
            Self::Plan => "plan",
            Self::Refine => "refine",
            Self::Expose => "expose",
            Self::Denoise => "denoise",
            Self::Write => "write",
        }
    }
}

/// Something that wants to know how far a render is. Called from worker threads, about ten times a second.
pub trait Progress: Sync {
    /// The render stands here now.
    fn update(&self, state: &ProgressState);

    /// The pilot is done, and this is what it tells of the time that the rest takes. Called once, behind a sensor only.
    fn forecast(&self, _: &Forecast) {}
}

/// Does not want to know.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn update(&self, _: &ProgressState) {}
}

/// A switch that ends a render early; what has been rendered stays usable. Share it by reference or in an `Arc`.
#[derive(Debug, Default)]
pub struct Cancel(AtomicBool);

impl Cancel {
    /// A switch that has not been thrown.
    pub const fn new() -> Self {
        Self(AtomicBool::new(false))
    }

    /// Asks the render to stop as soon as it can.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Was it asked to?
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
