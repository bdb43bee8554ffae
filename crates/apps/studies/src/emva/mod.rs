//! EMVA 1288: data sets of simulated cameras, and the analysis of data sets of any camera.
//!
//! [`DatasetPlan`] plans a measurement by the standard. [`write_dataset`] simulates its frames and writes them in the
//! format of the standard's reference implementation, with the truth beside them. [`read_measurement`] reads such a
//! data set frame by frame. [`Findings`] contains the results of the analyser of [`crate::emva1288`] as a table, JSON
//! and a page.

mod dataset;
mod figures;
mod findings;
mod measurement;
mod options;
mod page;
mod plan;
mod sensor_file;
mod truth;

pub use dataset::{DESCRIPTOR, TRUTH, WrittenDataset, write_dataset};
pub use findings::Findings;
pub use measurement::{ReadMeasurement, read_measurement};
pub use options::{AnalyseOptions, PIXEL_PITCHES, WAVELENGTHS};
pub use plan::{DatasetPlan, DatasetSettings, EXPOSURES, Shot, Vary};
pub use truth::Truth;
