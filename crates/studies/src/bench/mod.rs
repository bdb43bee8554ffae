//! What accuracy costs in time, measured: noise against time for every strategy, time until the camera hides the rest, what
//! each effect costs and changes. One call, one folder, one page that stands alone.
//!
//! The way of a bench: [`BenchSettings`] become a list of units (`runs.rs`), each a render with a seed of its own.
//! `measure.rs` renders them and `store.rs` keeps each one as soon as it is finished, so that an interrupted bench goes on
//! where it was; `denoised.rs` has what denoisers make of them. `results.rs` reads them back and asks the pure functions of
//! `statistics.rs`, `hidden.rs` and `ablation.rs` what they say; `tables.rs`, `figures.rs` and `page.rs` write it down.

mod ablation;
mod denoised;
mod figures;
mod hidden;
mod measure;
mod page;
mod results;
mod runs;
mod settings;
mod statistics;
mod store;
mod tables;

pub use measure::{BenchOutcome, bench, default_folder};
pub use settings::BenchSettings;
