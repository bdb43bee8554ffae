//! EMVA 1288: data sets of simulated cameras, and the analysis of data sets of any camera.
//!
//! [`DatasetPlan`] lays out a measurement as the standard requires it, [`write_dataset`] takes its frames and writes them in the
//! format of the standard's reference implementation, with the truth beside them. [`read_measurement`] reads such a data set
//! frame by frame, and [`Findings`] is what the analyser of [`crate::emva1288`] makes of it: a table, JSON, a page.

mod dataset;
mod figures;
mod findings;
mod measurement;
mod page;
mod plan;
mod truth;

pub use dataset::{DESCRIPTOR, TRUTH, WrittenDataset, write_dataset};
pub use findings::Findings;
pub use measurement::{ReadMeasurement, read_measurement};
pub use plan::{DatasetPlan, DatasetSettings, Shot, Vary};
pub use truth::Truth;
