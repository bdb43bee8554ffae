//! The commands of the feature `studies`: `bench`, `dataset`, `ptc`, `emva` and `mtf`.

mod bench;
mod bench_args;
mod dataset;
mod dataset_args;
mod emva;
mod emva_args;
mod mtf;
mod photon_transfer;
mod photon_transfer_args;
mod series;

pub(crate) use bench::run as run_bench;
pub(crate) use bench_args::BenchArgs;
pub(crate) use dataset::run as run_dataset;
pub(crate) use dataset_args::DatasetArgs;
pub(crate) use emva::run as run_emva;
pub(crate) use emva_args::EmvaArgs;
pub(crate) use mtf::{MtfArgs, run as run_mtf};
pub(crate) use photon_transfer::run as run_photon_transfer;
pub(crate) use photon_transfer_args::PtcArgs;
