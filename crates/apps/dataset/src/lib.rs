//! Data sets: many images of a station, each a little different, with exact labels and the noise of a camera.
//!
//! A [`Study`] is a job in which values may be distributions. [`run()`] makes a set of its images, [`verify()`] checks one, and
//! a [`Worker`] makes single images for programs that distribute them.

#![forbid(unsafe_code)]

mod cameras;
mod checks;
mod coco;
mod continuation;
mod defect;
mod defects;
mod distribution;
mod draws;
mod encode;
mod expression;
mod hull;
mod ids;
mod inputs;
mod job_error;
mod keypoints;
mod label_entry;
mod labels;
mod layout;
mod make;
mod named;
mod names;
mod outline;
mod pinhole;
mod placement;
mod pose;
mod price;
mod quantity;
mod record;
mod report;
mod resolved;
mod rle;
mod run;
mod set;
mod set_folder;
mod stable_text;
mod study;
mod surface_path;
mod surroundings;
mod verify;
mod visibility;
mod yolo;

pub use make::{Made, Worker};
pub use price::{Price, PriceLevel};
pub use record::{CertificateRecord, Cost, FileRecord, InstanceRecord, PlaceRecord, Record};
pub use run::{RunOptions, RunProgress, RunState, RunSummary, run};
pub use set::{Claim, Set};
pub use study::{MAX_COUNT, Study};
pub use verify::{Verified, verify};
