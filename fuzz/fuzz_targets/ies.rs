//! Any bytes as an IES file; one that can be read has a power and intensities that are numbers, and every refusal can show
//! its line.
#![no_main]

use dunkelfeld_fuzz::target;
use dunkelfeld_io::ies::parse_ies;
use std::path::Path;

target!(|data| {
    match parse_ies(Path::new("lamp.ies"), data) {
        Ok((profile, _)) => {
            // Of f32 intensities up to its largest number the sum may leave its range.
            assert!(!profile.power().is_nan() && profile.peak().is_finite() && profile.cutoff_angle().is_finite());
        }
        Err(e) => {
            drop((e.to_string(), e.caret()));
        }
    }
});
