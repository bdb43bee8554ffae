//! Measures the cost of accuracy in time: noise against time for every strategy, time until the noise is hidden, and
//! cost and bias of each effect. One call makes one folder with one page that needs no other file.
//!
//! The steps of a bench: [`BenchSettings`] give a list of units (`runs.rs`), each a render with its own seed.
//! `measure.rs` renders them. `store.rs` keeps each one as soon as it is finished, so that an interrupted bench
//! continues. `denoised.rs` applies denoisers. `results.rs` reads the units back and analyses them with the pure
//! functions of `statistics.rs`, `hidden.rs` and `ablation.rs`. `tables.rs`, `figures.rs` and `page.rs` write the
//! report.

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

pub use measure::bench;
pub use settings::BenchSettings;
