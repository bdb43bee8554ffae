//! Files that users write: jobs and sensors.

pub mod job;
pub mod keys;
pub mod quantity;
pub mod sensor_file;
pub mod toml_file;
pub mod toml_keys;
