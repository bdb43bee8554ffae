//! The parts of reports: charts as SVG, the frame of an HTML page that needs no other file, and numbers as text.
//! Each report adds its own sections. This crate does not depend on their content, and it opens no file.

#![forbid(unsafe_code)]

pub mod bins;
pub mod chart;
pub mod page;
pub mod words;
