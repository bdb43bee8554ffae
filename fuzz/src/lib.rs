//! Shared parts of the fuzz targets: a folder in memory for files, a bound on the heap, small limits, and the guard of a run.

#![forbid(unsafe_code)]

pub mod bases;
pub mod tree;

use cap::Cap;
use dunkelfeld_io::import::{ImportOptions, Imported};
use dunkelfeld_io::loader::Limits;
use std::alloc::System;
use std::backtrace::{Backtrace, BacktraceStatus};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use tempfile::TempDir;

/// Heap of a fuzzer, input and caches included \[bytes\]. An allocation beyond it fails, which ends the process unless the
/// code reserved with `try_reserve`: libFuzzer counts memory only once it was written to.
const MAX_HEAP: usize = 512 << 20;

#[global_allocator]
static HEAP: Cap<System> = Cap::new(System, MAX_HEAP);

/// The last panic of any thread, until a run has ended.
static LAST_PANIC: Mutex<String> = Mutex::new(String::new());

/// A fuzz target over bytes: `target!(|data| ...)`, or `target!(init: expression, |data| ...)` with work before the first
/// input, which no time limit of an input counts.
#[macro_export]
macro_rules! target {
    (|$data:ident| $body:expr) => {
        $crate::target!(init: (), |$data| $body);
    };
    (init: $init:expr, |$data:ident| $body:expr) => {
        libfuzzer_sys::fuzz_target!(init: { $crate::start(); $init; }, |$data: &[u8]| -> () {
            $crate::guard(|| {
                $body;
            })
        });
    };
}

/// Replaces the panic hook of libfuzzer-sys, which ends the process also for panics that are caught: the readers of images
/// catch those of foreign decoders and refuse the file.
pub fn start() {
    std::panic::set_hook(Box::new(|info| {
        let trace = Backtrace::capture();
        let mut text = info.to_string();
        if trace.status() == BacktraceStatus::Captured {
            text.push_str(&format!("\n{trace}"));
        }
        if let Ok(mut last) = LAST_PANIC.lock() {
            *last = text;
        }
    }));
}

/// Runs one input; a panic that leaves `body` is shown and ends the process, which libFuzzer reports as a crash.
pub fn guard(body: impl FnOnce()) {
    if catch_unwind(AssertUnwindSafe(body)).is_err() {
        eprintln!("{}", LAST_PANIC.lock().map_or_else(|e| e.into_inner().clone(), |last| last.clone()));
        std::process::abort();
    }
}

/// A folder that exists as long as the run, in memory where the system has `/dev/shm`.
pub struct Scratch(TempDir);

impl Scratch {
    /// A new, empty folder.
    pub fn new() -> Self {
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() { TempDir::new_in(memory) } else { TempDir::new() };
        Self(folder.expect("a temporary folder"))
    }

    /// The path of a file of that name.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file and names it.
    pub fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, bytes).expect("the temporary folder can be written to");
        path
    }
}

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

/// Limits of a few megabytes: code that exceeds them despite the checks meets the bound on the heap.
pub fn options() -> ImportOptions {
    const MIB: u64 = 1 << 20;
    let limits = Limits {
        file_bytes: 4 * MIB,
        total_bytes: 16 * MIB,
        json_objects: 100_000,
        image_side: 1024,
        image_bytes: 4 * MIB,
        total_image_bytes: 16 * MIB,
        geometry_bytes: 4 * MIB,
        ..Limits::default()
    };
    ImportOptions::default().with_limits(limits)
}

/// Builds the scene that was read: a file that a reader accepts is a scene, or refused with a message.
pub fn build(imported: Imported) {
    let warnings: usize = imported.warnings.iter().map(|w| w.to_string().len()).sum();
    std::hint::black_box(warnings);
    if let Err(e) = imported.scene.build() {
        std::hint::black_box(e.to_string());
    }
}
