//! Flags that several commands share.

use crate::bar::Sink;
use crate::interrupt::cancel_on_interrupt;
#[cfg(feature = "studies")]
use crate::key_flags::{KeyFlags, OfStudy};
use crate::outcome::say;
use crate::values::within;
use clap::{Args, ValueEnum};
use dunkelfeld::io::{Memory, QuantityError};
use dunkelfeld::{Error, Session};

/// Limit of the memory of a command.
#[derive(Debug, Args)]
pub(crate) struct MemoryArgs {
    /// The most memory that the command may need, as in 6GB or 512MiB. The need is computed beforehand; if it is larger,
    /// the command ends with its account and exit code 2.
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    pub(crate) memory: Option<u64>,
}

fn memory(text: &str) -> Result<u64, String> {
    let size: Memory = text.parse().map_err(|e: QuantityError| e.to_string())?;
    size.whole().ok_or_else(|| "write a size above zero, such as 6GB".into())
}

/// Threads and progress of a command.
#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// Threads [default: one per core].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = within(1..=1024u16))]
    pub(crate) threads: Option<u16>,
    /// Progress on standard error.
    #[arg(long, value_enum, default_value_t = ProgressKind::Bar)]
    pub(crate) progress: ProgressKind,
}

impl RunArgs {
    /// The number of threads; 0 for one per core.
    pub(crate) fn thread_count(&self) -> usize {
        self.threads.map_or(0, usize::from)
    }

    /// Does work that Ctrl-C cancels. `None` if it did.
    pub(crate) fn work<T>(
        &self,
        work: impl FnOnce(&Session<'_>) -> Result<Option<T>, Error>,
    ) -> Result<Option<T>, Error> {
        let sink = Sink::new(self.progress);
        let cancel = cancel_on_interrupt();
        let session = Session::new(self.thread_count())?.with_progress(&sink).with_cancel(&cancel);
        let done = work(&session);
        drop(sink);
        if let Ok(None) = done {
            say("interrupted: nothing was written");
        }
        done
    }
}

/// View and seed of a scene, for a command that renders it many times.
#[cfg(feature = "studies")]
#[derive(Debug, Args)]
pub(crate) struct ViewArgs {
    #[command(flatten)]
    pub(crate) keys: KeyFlags<OfStudy>,
    /// Camera by name [default: the first; a framing of the whole scene if there is none].
    #[arg(long, value_name = "NAME")]
    pub(crate) camera: Option<String>,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// Form of the progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressKind {
    /// A bar with the remaining time (only on a terminal).
    Bar,
    /// One JSON object a line, for machines.
    Json,
    /// Nothing.
    None,
}
