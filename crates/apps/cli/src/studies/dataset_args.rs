//! Flags of `dataset`.

use crate::run_args::ProgressKind;
use crate::values::{time_limit, within};
use clap::Args;
use dunkelfeld_dataset::MAX_COUNT;
use std::path::PathBuf;

/// Flags of `dataset`.
#[derive(Debug, Args)]
pub(crate) struct DatasetArgs {
    /// The study: a job in which values may be distributions, with a table [study] (docs/datasets.md). The same command
    /// continues a set, and several processes may make one set together.
    #[arg(value_name = "STUDY.toml", required_unless_present = "verify")]
    pub(crate) study: Option<PathBuf>,
    /// The folder of the set [default: the name of the study, in this folder].
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    /// Number of images. A set may grow [default: that of the study].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = within(1..=MAX_COUNT))]
    pub(crate) count: Option<u64>,
    /// Make only these images, counted from 0.
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', allow_negative_numbers = true, value_parser = within(0..=MAX_COUNT - 1))]
    pub(crate) index: Vec<u64>,
    /// Wall-clock time for all missing images, as in 8h, instead of the budget of the job. It depends on the speed of the
    /// machine how many samples the images have.
    #[arg(long, value_name = "TIME", value_parser = time_limit)]
    pub(crate) time: Option<f64>,
    /// Images that are made at the same time. Each has its own scene in memory [default: one per core].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = within(1..=1024u16))]
    pub(crate) jobs: Option<u16>,
    /// Check a finished set instead: its files by their hashes, labels against masks, and the files of the whole set against
    /// those that the images give. Exit code 1 if something is wrong or missing.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["study", "output", "count", "index", "time", "jobs", "threads"])]
    pub(crate) verify: Option<PathBuf>,
    /// Threads of each image [default: 1, and with --jobs 1 one per core].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = within(1..=1024u16))]
    pub(crate) threads: Option<u16>,
    /// Progress on standard error.
    #[arg(long, value_enum, default_value_t = ProgressKind::Bar)]
    pub(crate) progress: ProgressKind,
}
