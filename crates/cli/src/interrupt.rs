//! Ctrl-C and its relatives (SIGTERM, SIGHUP): the first asks for the best image so far, a later one does not wait for it.

use crate::outcome::{Outcome, say};
use dunkelfeld::Cancel;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Signals within this time of the first belong to it: some senders signal the process and then its whole group.
const ONE_GESTURE: Duration = Duration::from_millis(500);

/// A switch that the first interrupt throws. A later one ends the process at once: files that are finished stay, an
/// unfinished one leaves its old version and at most a hidden temporary file.
pub(crate) fn cancel_on_interrupt() -> Arc<Cancel> {
    let cancel = Arc::new(Cancel::new());
    let switch = Arc::clone(&cancel);
    let first = OnceLock::new();
    let handler = move || match first.get() {
        None => {
            let _ = first.set(Instant::now());
            switch.cancel();
        }
        Some(at) if at.elapsed() > ONE_GESTURE => std::process::exit(Outcome::Interrupted.code().into()),
        Some(_) => {}
    };
    if let Err(e) = ctrlc::set_handler(handler) {
        say(&format!("warning: interrupts cannot be caught ({e}); Ctrl-C will end without an image"));
    }
    cancel
}
