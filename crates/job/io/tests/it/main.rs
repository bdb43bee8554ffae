//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-io --test it MODULE::NAME`.

mod corpus;
mod faults;
mod gltf;
mod job;
mod job_cameras;
mod job_objects;
mod meshes;
mod obj;
mod output_exr;
mod output_pictures;
mod refusals;
mod sensor_files;
