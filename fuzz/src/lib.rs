//! What the fuzz targets share: a folder for the bytes, since importers read files, and limits that keep a run small.

#![forbid(unsafe_code)]

use dunkelfeld_io::import::ImportOptions;
use dunkelfeld_io::loader::Limits;
use std::path::PathBuf;
use tempfile::TempDir;

/// A folder that lives as long as the run.
pub struct Scratch(TempDir);

impl Scratch {
    /// A new, empty folder.
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    /// Writes a file and names it.
    pub fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).expect("the temporary folder can be written to");
        path
    }
}

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

/// Limits of a few dozen megabytes: whoever exceeds them despite the checks is found by the fuzzer's own memory limit.
pub fn options() -> ImportOptions {
    const MIB: u64 = 1 << 20;
    let limits = Limits {
        file_bytes: 16 * MIB,
        total_bytes: 64 * MIB,
        json_objects: 100_000,
        image_side: 2048,
        image_bytes: 16 * MIB,
        total_image_bytes: 64 * MIB,
        geometry_bytes: 64 * MIB,
    };
    ImportOptions { limits, ..ImportOptions::default() }
}
