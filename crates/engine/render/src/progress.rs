//! Progress of a long render, and its cancellation.

use crate::plan::forecast::Forecast;
use crate::rendered_film::RenderedFilm;
use crate::stage::Stage;
use std::sync::atomic::{AtomicBool, Ordering};

/// The progress of a render.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProgressState {
    /// The current stage.
    pub stage: Stage,
    /// Share of the render that is done, in \[0, 1\].
    pub fraction: f64,
    /// Seconds since the start of the command.
    pub elapsed: f64,
    /// Expected remaining seconds. `None` while unknown.
    pub remaining: Option<f64>,
    /// Camera samples taken so far.
    pub samples: u64,
}

/// A sink for the progress of a render. Called from worker threads, about ten times a second.
pub trait Progress: Sync {
    /// Receives the current progress.
    fn update(&self, state: &ProgressState);

    /// Receives the forecast of the pilot. Called once, only with a sensor.
    fn forecast(&self, _: &Forecast) {}

    /// The time between two films ([`Self::film`]) \[s\]; `None` if they are not needed. The render then takes its samples
    /// in passes of about this duration. No bit of its result depends on it.
    fn film_interval(&self) -> Option<f64> {
        None
    }

    /// Receives the film after each pass, if it has an interval. The render waits meanwhile. After the first pass one pixel
    /// in sixteen has a sample.
    fn film(&self, _: &RenderedFilm) {}
}

/// Ignores the progress.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn update(&self, _: &ProgressState) {}
}

/// A switch that ends a render early. The rendered samples stay usable. Share it by reference or in an `Arc`.
#[derive(Debug, Default)]
pub struct Cancel(AtomicBool);

impl Cancel {
    /// A switch that is not set.
    pub const fn new() -> Self {
        Self(AtomicBool::new(false))
    }

    /// Requests the end of the render as soon as possible.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Is the end requested?
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
