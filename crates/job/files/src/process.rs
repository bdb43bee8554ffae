//! Figures of the operating system about this process.

use crate::input::{InputFiles, Role};
use std::path::Path;

/// The longest status of a process \[bytes\]; it has some two thousand.
const MAX_STATUS: u64 = 1 << 16;

/// The peak resident set of this process \[bytes\]. `None` where the system does not report it.
pub fn peak_memory() -> Option<u64> {
    let status = InputFiles::new().read(Path::new("/proc/self/status"), Role::Report, MAX_STATUS).ok()?;
    peak_of(&String::from_utf8_lossy(&status))
}

/// Does the system allocate this many bytes in one piece? They are freed immediately.
///
/// Systems with overcommit of memory accept sizes up to the total of the machine.
pub fn can_reserve(bytes: u64) -> bool {
    let Ok(bytes) = usize::try_from(bytes) else { return false };
    let mut block: Vec<u8> = Vec::new();
    let done = block.try_reserve_exact(bytes).is_ok();
    // The compiler may remove an allocation without any use.
    std::hint::black_box(&mut block);
    done
}

/// The line `VmHWM:     12345 kB` of `/proc/self/status`.
fn peak_of(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_peak_is_read_from_its_line() {
        let status = "Name:\tdunkelfeld\nVmPeak:\t  999999 kB\nVmHWM:\t   12345 kB\nVmRSS:\t     100 kB\n";
        assert_eq!(peak_of(status), Some(12_345 * 1024));
        for text in ["", "VmHWM:\n", "VmHWM: many kB\n", "VmHWM: 18446744073709551615 kB\n", "VmRSS: 5 kB\n"] {
            assert_eq!(peak_of(text), None, "{text}");
        }
    }

    #[test]
    fn a_page_can_be_reserved_and_all_memory_cannot() {
        assert!(can_reserve(0) && can_reserve(4096));
        assert!(!can_reserve(u64::MAX) && !can_reserve(1 << 62));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_peak_of_this_process_grows_with_what_it_touches() {
        let before = peak_memory().expect("Linux has it");
        let touched = vec![1u8; 64 << 20];
        let after = peak_memory().expect("Linux has it");
        assert!(after >= touched.iter().map(|&b| u64::from(b)).sum() && after >= before, "{before}, then {after}");
    }
}
