//! Ctrl-C and similar signals (SIGTERM, SIGHUP): the first one requests the best image so far, a later one does not
//! wait for it.

use crate::outcome::{Outcome, say};
use dunkelfeld::Cancel;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Signals within this time of the first belong to it: some senders signal the process and then its whole group.
const ONE_GESTURE: Duration = Duration::from_millis(500);

/// Lets writes beyond the limit of the process on the size of files (`ulimit -f`) fail, as on a full disk, instead of the
/// signal SIGXFSZ end the process in the middle of a file.
pub(crate) fn survive_file_size_limit() {
    #[cfg(unix)]
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
}

/// A switch that the first interrupt sets. A later one ends the process immediately: finished files stay. An unfinished
/// one keeps its old version and leaves at most a hidden partial file, which the next writer of that file removes.
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
