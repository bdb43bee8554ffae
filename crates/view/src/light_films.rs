//! A render with a film for each light: one render for each, of which one at a time has its turn.
//!
//! Each light has its own scene, in which it alone emits, and its own seed. So the films are independent.

use crate::engine::Watcher;
use crate::light_sum::LightFilm;
use crate::scenes::LightScene;
use crate::shared::{Shared, lock};
use crate::snapshot::Content;
use dunkelfeld::memory::KeptFilms;
use dunkelfeld::{Cancel, Error, Progress, ProgressState, Project, RenderedFilm};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// The most lights with films. Each has threads of its own.
const MAX_LIGHTS: usize = 64;
/// The copies of the films may take this share of the time of the render: more than those of one film, so that many lights
/// do not make pictures rare.
const COPY_SHARE: f64 = 0.05;
/// The step between the seeds of two lights: 2^64 over the golden ratio.
const SEED_STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// The scenes of the lights, if each is to have a film.
///
/// # Errors
/// No light, too many of them, or too little memory.
pub(crate) fn open(shared: &Shared, project: Option<&mut Project>, cancel: &Cancel) -> Result<Vec<LightScene>, Error> {
    let is_on = lock(&shared.live).change.per_light;
    let (true, Some(project), false) = (is_on, project, cancel.is_cancelled()) else { return Ok(Vec::new()) };
    let names = project.light_names();
    check_number(names.len())?;
    project.memory_of_light_films(&project.fitted()?, names.len()).check()?;
    let seed = project.settings.seed;
    let mut lights = Vec::with_capacity(names.len());
    for (name, number) in names.into_iter().zip(1u64..) {
        if cancel.is_cancelled() {
            return Ok(Vec::new());
        }
        let mut project = project.only_light(&name)?;
        project.settings.seed = seed.wrapping_add(number.wrapping_mul(SEED_STEP));
        lights.push(LightScene { name, project });
    }
    Ok(lights)
}

/// Checks the number of lights that are on.
pub(crate) fn check_number(lights: usize) -> Result<(), Error> {
    match lights {
        0 => {
            Err(Error::setting("lights", "no light is on, so there is nothing to give a film to", "switch a light on"))
        }
        1..=MAX_LIGHTS => Ok(()),
        _ => {
            let problem = format!("{lights} lights are on, and at most {MAX_LIGHTS} have films of their own");
            Err(Error::setting("lights", problem, "use one film for all lights"))
        }
    }
}

/// Renders the films until they are cancelled or have the most samples.
///
/// # Errors
/// The first error of a render, which ends the others.
pub(crate) fn render(watcher: &Watcher<'_>, lights: &[LightScene], cancel: &Cancel) -> Result<Content, Error> {
    let state =
        State { turn: 0, is_due: false, copy_seconds: 0.0, films: lights.iter().map(|_| Default::default()).collect() };
    let rounds = Rounds { watcher, lights, cancel, state: Mutex::new(state), turned: Condvar::new() };
    let results: Vec<Result<Arc<RenderedFilm>, Error>> = std::thread::scope(|scope| {
        let start = |number: usize| {
            let (turn, project) = (Turn { rounds: &rounds, number }, &lights[number].project);
            let run = move || turn.render(project);
            std::thread::Builder::new().name(format!("light {number}")).spawn_scoped(scope, run)
        };
        // All begin before the first one is waited for.
        let running: Vec<_> = (0..lights.len()).map(start).collect();
        let failed = |problem: &str| Error::Threads(problem.to_owned());
        let result = |thread: std::io::Result<std::thread::ScopedJoinHandle<'_, _>>| {
            let thread = thread.map_err(|e| {
                cancel.cancel();
                failed(&e.to_string())
            })?;
            thread.join().unwrap_or_else(|_| Err(failed("the thread of a light failed")))
        };
        running.into_iter().map(result).collect()
    });
    let films = results.into_iter().collect::<Result<Vec<_>, Error>>()?;
    Ok(content(lights, films))
}

fn content(lights: &[LightScene], films: Vec<Arc<RenderedFilm>>) -> Content {
    Content::Lights(lights.iter().zip(films).map(|(light, film)| LightFilm::new(light.name.clone(), film)).collect())
}

/// The renders of all lights. In a round, each that has not ended has a turn of one pass.
struct Rounds<'a> {
    watcher: &'a Watcher<'a>,
    lights: &'a [LightScene],
    cancel: &'a Cancel,
    state: Mutex<State>,
    /// The turn has changed.
    turned: Condvar,
}

struct State {
    /// The number of the light that has the turn.
    turn: usize,
    /// Are the films of this round published?
    is_due: bool,
    /// Seconds of copies in this round.
    copy_seconds: f64,
    films: Vec<FilmState>,
}

#[derive(Default)]
struct FilmState {
    has_ended: bool,
    samples: u64,
    copy: Option<Arc<RenderedFilm>>,
}

impl Rounds<'_> {
    fn state(&self) -> MutexGuard<'_, State> {
        lock(&self.state)
    }

    /// Gives the turn to the next light.
    fn pass(&self, number: usize) {
        let mut state = self.state();
        if state.turn == number {
            let count = state.films.len();
            let next = (1..=count).map(|step| (number + step) % count).find(|&next| !state.films[next].has_ended);
            state.turn = next.unwrap_or(number);
        }
        drop(state);
        self.turned.notify_all();
    }

    /// Publishes the copies of a round, after its last turn.
    fn publish(&self, state: &mut State) {
        let copies: Option<Vec<Arc<RenderedFilm>>> = state.films.iter().map(|film| film.copy.clone()).collect();
        let Some(films) = copies.filter(|_| std::mem::take(&mut state.is_due)) else { return };
        if self.watcher.needs_all_pixels() && !films.iter().all(|film| film.sums.has_all_pixels()) {
            return;
        }
        let began = self.watcher.seconds();
        self.watcher.publish(content(self.lights, films));
        let copy = state.copy_seconds + self.watcher.seconds() - began;
        self.watcher.copied(began, copy, COPY_SHARE);
    }
}

/// The part of a light in the rounds: the receiver of its film. Its end gives the turn away, also if its thread fails.
struct Turn<'a> {
    rounds: &'a Rounds<'a>,
    number: usize,
}

impl Turn<'_> {
    fn wait(&self) {
        let state = self.rounds.state();
        let waits = |state: &mut State| state.turn != self.number;
        drop(self.rounds.turned.wait_while(state, waits).unwrap_or_else(PoisonError::into_inner));
    }

    fn render(self, project: &Project) -> Result<Arc<RenderedFilm>, Error> {
        self.wait();
        let result =
            project.render_film_beside(self.rounds.watcher.nice(), KeptFilms::default(), &self, self.rounds.cancel);
        if result.is_err() {
            self.rounds.cancel.cancel();
        }
        let film = Arc::new(result?.0.film);
        self.rounds.state().films[self.number].copy = Some(film.clone());
        Ok(film)
    }
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.rounds.state().films[self.number].has_ended = true;
        self.rounds.pass(self.number);
    }
}

impl Progress for Turn<'_> {
    fn update(&self, progress: &ProgressState) {
        let mut state = self.rounds.state();
        state.films[self.number].samples = progress.samples;
        let samples = state.films.iter().map(|film| film.samples).sum();
        drop(state);
        self.rounds.watcher.update(&ProgressState { samples, ..*progress });
    }

    fn film_interval(&self) -> Option<f64> {
        Some(self.rounds.watcher.film_interval()? / self.rounds.lights.len().max(1) as f64)
    }

    fn film(&self, film: &RenderedFilm) {
        let watcher = self.rounds.watcher;
        let mut state = self.rounds.state();
        if state.films[..self.number].iter().all(|film| film.has_ended) {
            (state.is_due, state.copy_seconds) = (watcher.is_due(), 0.0);
        }
        if state.is_due {
            let began = Instant::now();
            state.films[self.number].copy = Some(Arc::new(film.clone()));
            state.copy_seconds += began.elapsed().as_secs_f64();
        }
        if state.films[self.number + 1..].iter().all(|film| film.has_ended) {
            self.rounds.publish(&mut state);
        }
        drop(state);
        watcher.hold(None);
        // A render that is cancelled ends with its turn.
        if !self.rounds.cancel.is_cancelled() {
            self.rounds.pass(self.number);
            self.wait();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_lights_has_limits() {
        assert!(check_number(0).is_err() && check_number(MAX_LIGHTS + 1).is_err());
        assert!(check_number(1).is_ok() && check_number(MAX_LIGHTS).is_ok());
    }
}
