//! Commands on files: merge, expose and denoise of earlier renders, init of a job.

pub(crate) mod denoise;
pub(crate) mod expose;
pub(crate) mod init;
pub(crate) mod merge;

pub use crate::black_image::black_image;
pub use crate::expose_options::{expose_image, expose_radiance};
pub use crate::project::removable_effects;
pub use crate::sensor_sheet::sensor_sheet;
pub use crate::stations::{STATIONS, Station};
pub use denoise::{DenoisePlanes, DenoisedFile, check_denoise_output, denoise_exr, denoise_planes};
pub use expose::{ExposeOutputs, ExposedFile, OfImage, expose_exr};
pub use init::{init, init_text};
pub use merge::{MergeSettings, Merged, merge};
