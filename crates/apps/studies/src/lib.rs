//! Studies: series of renders or of frames. Each writes a report of one page.
//!
//! [`mod@bench`] measures noise against time for every allocation strategy and the cost of each effect. [`photon_transfer`] evaluates frames as a photon
//! transfer curve. [`emva`] plans, writes and analyses EMVA 1288 data sets. [`mtf`] measures the MTF of a
//! camera. Nothing below uses this crate.

#![forbid(unsafe_code)]

pub mod bench;
pub mod emva;
mod folder;
pub mod mtf;
mod noise_map;
pub mod photon_transfer;
mod report;
mod series;

pub use dunkelfeld_emva1288 as emva1288;
pub use folder::default_folder;
pub use noise_map::NoiseMap;
pub use report::table::Figures;
pub use series::StudyOutcome;
