//! The first images of a run: if none of them can be made, the run ends.

use std::sync::{Condvar, Mutex};
use std::time::Duration;

/// Images of a run that decide whether it goes on.
const TRIED: usize = 16;

/// The decision whether a run goes on. It depends on the first images of the run alone. The others may be rendered before,
/// but are not written. So the result of a run does not depend on the number of its jobs.
#[derive(Debug)]
pub(crate) struct Trial {
    tried: usize,
    state: Mutex<State>,
    change: Condvar,
}

#[derive(Debug)]
struct State {
    /// Images of the trial that are neither made nor refused.
    left: usize,
    /// Does the run go on?
    is_passed: bool,
}

impl Trial {
    /// The trial of a run of so many images. A set that has images needs none.
    pub(crate) fn new(images: usize, has_images: bool) -> Self {
        let tried = images.min(TRIED);
        let state = State { left: tried, is_passed: has_images || tried == 0 };
        Self { tried, state: Mutex::new(state), change: Condvar::new() }
    }

    /// The image at a position of the run is made, here or by another process.
    pub(crate) fn pass(&self, position: usize) {
        if let Ok(mut state) = self.state.lock()
            && position < self.tried
        {
            state.is_passed = true;
            self.change.notify_all();
        }
    }

    /// The image at a position of the run cannot be made. True if the run ends with it.
    pub(crate) fn refuse(&self, position: usize) -> bool {
        let Ok(mut state) = self.state.lock() else { return false };
        if position >= self.tried {
            return false;
        }
        state.left = state.left.saturating_sub(1);
        self.change.notify_all();
        state.left == 0 && !state.is_passed
    }

    /// Waits until the image at a position may be written. False if it must not be: then none of the first images can be
    /// made, or `is_over`.
    pub(crate) fn wait(&self, position: usize, is_over: impl Fn() -> bool) -> bool {
        const PAUSE: Duration = Duration::from_millis(50);
        let Ok(mut state) = self.state.lock() else { return false };
        loop {
            if state.is_passed || position < self.tried {
                return true;
            }
            if state.left == 0 || is_over() {
                return false;
            }
            // An error of another thread and Ctrl-C do not change the state.
            match self.change.wait_timeout(state, PAUSE) {
                Ok((next, _)) => state = next,
                Err(_) => return false,
            }
        }
    }

    /// Can none of the first images be made?
    pub(crate) fn is_failed(&self) -> bool {
        self.state.lock().is_ok_and(|state| state.left == 0 && !state.is_passed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_images_decide() {
        let trial = Trial::new(100, false);
        assert!(!trial.wait(TRIED, || true), "it is not decided");
        assert!((0..TRIED - 1).all(|position| !trial.refuse(position)));
        assert!(!trial.refuse(TRIED) && !trial.is_failed(), "a later image does not count");
        assert!(trial.wait(TRIED - 1, || true), "an image of the trial does not wait");
        assert!(trial.refuse(TRIED - 1) && trial.is_failed());
        assert!(!trial.wait(TRIED, || false));

        let trial = Trial::new(100, false);
        trial.pass(TRIED);
        assert!(!trial.wait(TRIED, || true), "a later image does not count");
        trial.pass(3);
        assert!((0..TRIED).filter(|position| *position != 3).all(|position| !trial.refuse(position)));
        assert!(trial.wait(99, || true) && !trial.is_failed());

        // All images of a short run, and a set that has images.
        let trial = Trial::new(2, false);
        assert!(!trial.refuse(1) && trial.refuse(0) && trial.is_failed());
        let trial = Trial::new(2, true);
        assert!(!trial.refuse(1) && !trial.refuse(0) && !trial.is_failed());
        assert!(!Trial::new(0, false).is_failed());
    }

    #[test]
    fn a_later_image_waits_for_the_decision() {
        let trial = Trial::new(100, false);
        std::thread::scope(|scope| {
            let later = scope.spawn(|| trial.wait(50, || false));
            assert!(!trial.refuse(0));
            trial.pass(1);
            assert!(later.join().expect("no panic"));
        });
    }
}
