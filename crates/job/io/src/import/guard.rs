//! Protection against panics of third-party code that reads a file.

use crate::error::InputError;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Runs `read`; a panic in it becomes an error.
pub(crate) fn guarded<T>(
    path: &Path,
    place: &str,
    read: impl FnOnce() -> Result<T, InputError>,
) -> Result<T, InputError> {
    // The data that `read` borrows is dropped with the import, so that no code uses it in a partly changed state.
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        let problem = "the reader of the format stopped at a fault that it does not expect";
        Err(InputError::new(
            path,
            place,
            problem,
            "export the file again, and report the file as a defect of this program",
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_an_error_with_file_and_place() {
        let e = guarded::<()>(Path::new("a.glb"), "JSON", || panic!("on purpose")).expect_err("a panic");
        assert_eq!((e.file.as_path(), e.place.as_str()), (Path::new("a.glb"), "JSON"));
        assert!(e.problem.contains("stopped") && e.help.contains("export the file again"), "{e}");
        assert_eq!(guarded(Path::new("a.glb"), "JSON", || Ok(3)), Ok(3));
    }
}
