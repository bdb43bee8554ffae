//! The library at run time: the candidate names, and its functions under the names of both generations.
//!
//! Intel Open Image Denoise 2 renamed the functions that set parameters (`oidnSetFilter1b` became `oidnSetFilterBool`).
//! Their arguments stayed the same. The other functions of its header are not needed here.

#![allow(unsafe_code, reason = "functions of a library in C, found at run time")]

use crate::denoiser::DenoiseError;
use libloading::Library;
use std::ffi::{c_char, c_int, c_void};
use std::path::PathBuf;

/// The oldest supported version. It is the first with a parameter for noise-free auxiliary images.
const OLDEST: i32 = 10_400;
/// The first version that this adapter does not support.
const UNKNOWN: i32 = 30_000;
/// The library's number of the CPU device. The program always sets it, since the library would prefer a GPU.
const DEVICE_CPU: c_int = 1;

/// Handle of a device in the library.
pub(super) type RawDevice = *mut c_void;
/// Handle of a filter in the library.
pub(super) type RawFilter = *mut c_void;
/// Gets the pointer with which it was registered and the finished fraction. Returns false to stop.
pub(super) type Monitor = extern "C" fn(*mut c_void, f64) -> bool;

/// A possible location of the library.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Candidate {
    /// Path or name of the library, in the form of the system's loader.
    pub library: PathBuf,
    /// Libraries that it needs and that the loader may not find (for its threads: `libtbb`). They are loaded before it
    /// if possible. A failure to load one is no error.
    pub companions: Vec<PathBuf>,
}

impl Candidate {
    /// A library without companions.
    pub fn new(library: impl Into<PathBuf>) -> Self {
        Self { library: library.into(), companions: Vec::new() }
    }
}

/// Names under which systems install the library, the newest first. The loader of the system searches for them.
pub fn standard_names() -> &'static [&'static str] {
    if cfg!(windows) {
        &["OpenImageDenoise.dll"]
    } else if cfg!(target_os = "macos") {
        &["libOpenImageDenoise.2.dylib", "libOpenImageDenoise.1.dylib", "libOpenImageDenoise.dylib"]
    } else {
        &["libOpenImageDenoise.so.2", "libOpenImageDenoise.so.1", "libOpenImageDenoise.so"]
    }
}

/// Folders of installations that the system's loader may not search.
pub fn standard_places() -> &'static [&'static str] {
    if cfg!(windows) { &[] } else { &["/usr/local/lib", "/opt/oidn/lib", "/opt/homebrew/lib", "/opt/local/lib"] }
}

/// The functions of a loaded library. It is never unloaded, since its threads may outlive every device.
///
/// # Safety
/// Devices and filters must come from the same library and must not have been released. Names must end in zero. Images
/// must have the stated size and stay at their place until the filter is released. `session.rs` ensures this.
#[derive(Clone, Copy, Debug)]
pub(super) struct Functions {
    pub(super) new_device: unsafe extern "C" fn(c_int) -> RawDevice,
    pub(super) release_device: unsafe extern "C" fn(RawDevice),
    pub(super) set_device_bool: unsafe extern "C" fn(RawDevice, *const c_char, bool),
    pub(super) set_device_int: unsafe extern "C" fn(RawDevice, *const c_char, c_int),
    pub(super) get_device_int: unsafe extern "C" fn(RawDevice, *const c_char) -> c_int,
    pub(super) get_device_error: unsafe extern "C" fn(RawDevice, *mut *const c_char) -> c_int,
    pub(super) commit_device: unsafe extern "C" fn(RawDevice),
    pub(super) new_filter: unsafe extern "C" fn(RawDevice, *const c_char) -> RawFilter,
    pub(super) release_filter: unsafe extern "C" fn(RawFilter),
    pub(super) set_shared_image:
        unsafe extern "C" fn(RawFilter, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize),
    pub(super) set_filter_bool: unsafe extern "C" fn(RawFilter, *const c_char, bool),
    pub(super) set_filter_float: unsafe extern "C" fn(RawFilter, *const c_char, f32),
    pub(super) set_monitor: unsafe extern "C" fn(RawFilter, Option<Monitor>, *mut c_void),
    pub(super) commit_filter: unsafe extern "C" fn(RawFilter),
    pub(super) execute_filter: unsafe extern "C" fn(RawFilter),
}

impl Functions {
    /// Loads the first candidate that exists and has a supported version.
    pub(super) fn load(candidates: &[Candidate]) -> Result<Self, DenoiseError> {
        let mut tried = Vec::new();
        for candidate in candidates {
            match Self::load_one(candidate) {
                Ok(functions) => return Ok(functions),
                Err(reason) => tried.push(format!("{}: {reason}", candidate.library.display())),
            }
        }
        let tried = if tried.is_empty() { "nothing".into() } else { tried.join("; ") };
        Err(DenoiseError::Unavailable(format!("Intel Open Image Denoise cannot be loaded; tried: {tried}")))
    }

    fn load_one(candidate: &Candidate) -> Result<Self, String> {
        for companion in &candidate.companions {
            // If a companion cannot be loaded, the library itself reports the missing part.
            if let Ok(library) = open(companion) {
                std::mem::forget(library);
            }
        }
        let library = open(&candidate.library)?;
        let functions = Self::find(&library)?;
        std::mem::forget(library);
        Ok(functions)
    }

    /// Finds the functions under the names of the second generation, otherwise of the first.
    fn find(library: &Library) -> Result<Self, String> {
        /// # Safety
        /// The symbol, if there is one, must be a function of type `T`.
        unsafe fn symbol<T: Copy>(library: &Library, name: &str) -> Result<T, String> {
            // SAFETY: guaranteed by the contract of this function.
            let found = unsafe { library.get::<T>(name.as_bytes()) };
            found.map(|f| *f).map_err(|_| format!("is not Open Image Denoise 1.4 or 2: it has no {name}"))
        }
        // SAFETY: only the existence of the symbol is tested. Its address is never used.
        let is_second = unsafe { library.get::<*const c_void>(b"oidnSetFilterBool") }.is_ok();
        let of = |first: &'static str, second: &'static str| if is_second { second } else { first };
        // SAFETY: the types are those of the headers of versions 1.4 and 2.3, which agree. Handles and names are
        // pointers, the type of the device and the error are C enumerations (int), sizes are size_t.
        unsafe {
            Ok(Self {
                new_device: symbol(library, "oidnNewDevice")?,
                release_device: symbol(library, "oidnReleaseDevice")?,
                set_device_bool: symbol(library, of("oidnSetDevice1b", "oidnSetDeviceBool"))?,
                set_device_int: symbol(library, of("oidnSetDevice1i", "oidnSetDeviceInt"))?,
                get_device_int: symbol(library, of("oidnGetDevice1i", "oidnGetDeviceInt"))?,
                get_device_error: symbol(library, "oidnGetDeviceError")?,
                commit_device: symbol(library, "oidnCommitDevice")?,
                new_filter: symbol(library, "oidnNewFilter")?,
                release_filter: symbol(library, "oidnReleaseFilter")?,
                set_shared_image: symbol(library, "oidnSetSharedFilterImage")?,
                set_filter_bool: symbol(library, of("oidnSetFilter1b", "oidnSetFilterBool"))?,
                set_filter_float: symbol(library, of("oidnSetFilter1f", "oidnSetFilterFloat"))?,
                set_monitor: symbol(library, "oidnSetFilterProgressMonitorFunction")?,
                commit_filter: symbol(library, "oidnCommitFilter")?,
                execute_filter: symbol(library, "oidnExecuteFilter")?,
            })
        }
    }

    /// A new device on the CPU. Null on failure.
    pub(super) fn new_cpu_device(&self) -> RawDevice {
        // SAFETY: the argument is a number, and the function returns null for an unknown one.
        unsafe { (self.new_device)(DEVICE_CPU) }
    }
}

/// Text of a version number (major * 10000 + minor * 100 + patch), if this adapter supports it.
pub(super) fn known_version(number: i32) -> Result<String, String> {
    let words = format!("{}.{}.{}", number / 10_000, number / 100 % 100, number % 100);
    match (OLDEST..UNKNOWN).contains(&number) {
        true => Ok(words),
        false => Err(format!("Open Image Denoise {words} is not supported; use 1.4 or 2")),
    }
}

/// Opens a library whose symbols are visible to libraries that are opened later. The first generation finds its thread
/// library in this way.
fn open(path: &std::path::Path) -> Result<Library, String> {
    #[cfg(unix)]
    // SAFETY: loading runs the start-up code of the library, which the user or the system's packages installed.
    let opened = unsafe {
        use libloading::os::unix::{Library as Unix, RTLD_GLOBAL, RTLD_NOW};
        Unix::open(Some(path), RTLD_NOW | RTLD_GLOBAL).map(Library::from)
    };
    #[cfg(not(unix))]
    // SAFETY: as above.
    let opened = unsafe { Library::new(path) };
    // The cause contains the message of the system.
    opened.map_err(|e| std::error::Error::source(&e).map_or_else(|| e.to_string(), ToString::to_string))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_library_states_what_was_tried_and_why_it_failed() {
        let candidates = ["/nowhere/libA.so", "/nowhere/libB.so"].map(Candidate::new);
        let text = Functions::load(&candidates).expect_err("there is no such file").to_string();
        assert!(text.contains("/nowhere/libA.so: ") && text.contains("/nowhere/libB.so: "), "{text}");
        assert!(!cfg!(target_os = "linux") || text.contains("No such file"), "the system's reason: {text}");
        let text = Functions::load(&[]).expect_err("nothing to try").to_string();
        assert!(text.ends_with("tried: nothing"), "{text}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn another_library_is_recognised_by_its_missing_functions() {
        let text = Functions::load(&[Candidate::new("libc.so.6")]).expect_err("another library").to_string();
        assert!(text.contains("libc.so.6: is not Open Image Denoise") && text.contains("oidnNewDevice"), "{text}");
    }

    #[test]
    fn only_versions_whose_functions_are_known_are_used() {
        assert_eq!(known_version(10_403).as_deref(), Ok("1.4.3"));
        assert_eq!(known_version(20_303).as_deref(), Ok("2.3.3"));
        assert!(known_version(10_301).is_err_and(|e| e.contains("1.3.1")));
        assert!(known_version(30_000).is_err_and(|e| e.contains("3.0.0")));
    }
}
