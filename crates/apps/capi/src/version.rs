//! Version of the library and of its binary interface.

use crate::pointers::Out;
use crate::status::{Failure, Status, call};
use std::ffi::{CStr, c_char};

/// Version of the binary interface: of the functions, and of the layout of structures.
pub const ABI_VERSION: u32 = 1;

const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
    Ok(version) => version,
    Err(_) => c"",
};

/// Version of the library, as in "0.1.0".
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub extern "C" fn dunkelfeld_version() -> *const c_char {
    VERSION.as_ptr()
}

/// Version of the binary interface of the library.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub extern "C" fn dunkelfeld_abi_version() -> u32 {
    ABI_VERSION
}

/// Compares the version of the header that a program was compiled with (DUNKELFELD_ABI_VERSION) with that of the library. They must
/// be equal: else DUNKELFELD_STATUS_ABI.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub extern "C" fn dunkelfeld_check_abi(header: u32) -> Status {
    call(|| {
        if header == ABI_VERSION {
            return Ok(());
        }
        let problem = format!("the header has version {header}, the library {ABI_VERSION}");
        Err(Failure::new(
            Status::Abi,
            "the binary interface",
            problem,
            "compile the program with the header of the library",
        ))
    })
}

/// Names of the preset sensors as a JSON array. Close the text by dunkelfeld_text_close().
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_sensors(names: *mut *mut c_char) -> Status {
    // SAFETY: what the header says of pointers.
    let names = unsafe { Out::of(names) };
    call(|| {
        let all: Vec<&str> = dunkelfeld::io::sensor_file::preset_names().collect();
        names.set_text("names", &serde_json::to_string(&all).unwrap_or_default())
    })
}
