//! The state of a render that a later process needs: stored, and restored.

use super::Renderer;
use crate::checkpoint::{Restored, ResumedWork, Snapshot, State, began, film_rows};
use crate::plan::Planner;
use dunkelfeld_adaptive::budget::StopReason;

impl Renderer<'_> {
    /// Restores the state that an earlier process stored.
    pub(super) fn restore(&mut self, saved: Restored) {
        let Restored { state, weights, target, film } = saved;
        self.taken = film.total_samples();
        self.film.sums = film;
        self.count();
        self.invalid = state.invalid();
        self.connections = state.connections();
        if let Some(weights) = weights {
            self.planner = Planner::resumed(self.settings, weights, state.planner, state.forecast);
        }
        let (started, seconds) = began(self.started, state.elapsed);
        self.started = started;
        let was_complete = state.stop.is_some();
        self.earlier = ResumedWork { seconds, samples: self.taken, was_complete };
        self.stages = state.stages;
        self.course = state.course;
        if let Some(course) = self.course.as_mut().filter(|_| !was_complete) {
            if target.is_none() {
                // The clock has set the present round.
                course.schedule.record(self.taken);
            }
            // The open round took the time that the completed stages do not account for.
            let accounted: f64 = self.stages.iter().map(|(_, seconds)| seconds).sum();
            self.stages.push((course.stage, (state.elapsed - accounted).max(0.0)));
        }
        (self.target, self.stopped) = (target, state.stop);
    }

    /// The state that is stored beside film and plan.
    pub(super) fn state(&self, stop: Option<StopReason>) -> State {
        State {
            elapsed: 0.0,
            stop,
            course: self.course.clone(),
            planner: self.planner.state(),
            forecast: self.planner.forecast().cloned(),
            connections: [self.connections.attempts, self.connections.converged, self.connections.rays],
            stages: self.stages.clone(),
            invalid: self.invalid.iter().map(|s| [s.x, s.y, s.index]).collect(),
        }
    }

    /// Stores a checkpoint between two rounds. `stop` is the reason for the end of the render, or `None` if it
    /// continues. Without a reason, and unless `must` is set, it is stored only when one is due.
    pub(super) fn keep(&self, stop: Option<StopReason>, must: bool) {
        let Some(writer) = &self.writer else { return };
        let state = self.state(stop);
        let weights = self.course.is_some().then(|| self.planner.weights());
        let snapshot = Snapshot { state: &state, weights, target: self.target.as_ref() };
        let mut rows = film_rows(&self.film.sums);
        if must {
            writer.keep(snapshot, &mut rows);
        } else {
            writer.keep_if_due(snapshot, self.clock().map(|clock| clock.deadline), &mut rows);
        }
    }
}
