//! Flags that several commands share.

use crate::values::{ExposureChoice, exposure, whole, within};
use clap::{Args, ValueEnum};
use dunkelfeld::io::quantity::{Memory, QuantityError};

/// Memory limit of a command.
#[derive(Debug, Args)]
pub(crate) struct MemoryArgs {
    /// Memory limit, as in 6GB or 512MiB. The command computes its need before the work. If the need is larger, the
    /// command prints the account of it and ends with exit code 2.
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    pub(crate) memory: Option<u64>,
}

fn memory(text: &str) -> Result<u64, String> {
    let size: Memory = text.parse().map_err(|e: QuantityError| e.to_string())?;
    size.whole().ok_or_else(|| "write a size above zero, such as 6GB".into())
}

/// Threads and progress of any command.
#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// Threads [default: one per core].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = within(1..=1024u16))]
    pub(crate) threads: Option<u16>,
    /// How progress is shown on standard error.
    #[arg(long, value_enum, default_value_t = ProgressKind::Bar)]
    pub(crate) progress: ProgressKind,
}

impl RunArgs {
    /// The number of threads; 0 for one per core.
    pub(crate) fn thread_count(&self) -> usize {
        self.threads.map_or(0, usize::from)
    }
}

/// View and seed of a scene, for a command that renders it many times.
#[derive(Debug, Args)]
pub(crate) struct ViewArgs {
    /// Width of the image [default: 512].
    #[arg(long, value_name = "PIXELS", allow_negative_numbers = true, value_parser = within(1..=dunkelfeld::MAX_SIDE))]
    pub(crate) width: Option<u32>,
    /// Height of the image [default: 512].
    #[arg(long, value_name = "PIXELS", allow_negative_numbers = true, value_parser = within(1..=dunkelfeld::MAX_SIDE))]
    pub(crate) height: Option<u32>,
    /// Camera by name [default: the first; if there is none, a view of the whole scene].
    #[arg(long, value_name = "NAME")]
    pub(crate) camera: Option<String>,
    /// Sensor preset, a sensor file (.toml), or none [default: imx250].
    #[arg(long, value_name = "NAME|FILE|none")]
    pub(crate) sensor: Option<String>,
    /// Exposure time as in 5ms, or auto, which computes it from the render with the most samples and uses it for all
    /// renders [default: auto].
    #[arg(long, value_name = "TIME|auto", value_parser = exposure)]
    pub(crate) exposure: Option<ExposureChoice>,
    /// Seed from which all others are derived [default: 0].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole::<u64>)]
    pub(crate) seed: Option<u64>,
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// How progress is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressKind {
    /// A bar with the remaining time (only on a terminal).
    Bar,
    /// One JSON object a line, for machines.
    Json,
    /// Nothing.
    None,
}
