//! Possible places of a shared library: the path of a user or an installation, completed by a search in folders.

use crate::input::other_kind;
use std::path::{Path, PathBuf};

/// The libraries at a path whose file names begin with `stem` (`lib` before it or not). If the path is no folder, it is
/// the path itself. If it is a folder, these are the libraries with such names in it and in its `lib` or `bin` folder,
/// the newest version first. Empty if there are none, or if the path is a pipe, a socket or a device.
pub fn find_libraries(path: &Path, stem: &str) -> Vec<PathBuf> {
    match std::fs::metadata(path) {
        // The system's loader would wait for a named pipe.
        Ok(meta) if !meta.is_dir() && other_kind(&meta).is_some() => return Vec::new(),
        // A bare name is searched in the system's folders only.
        Ok(meta) if meta.is_file() && path.parent() == Some(Path::new("")) => return vec![Path::new(".").join(path)],
        Ok(meta) if meta.is_dir() => {}
        _ => return vec![path.to_path_buf()],
    }
    [path.to_path_buf(), path.join("lib"), path.join("bin")].iter().flat_map(|folder| named(folder, stem)).collect()
}

/// The libraries in the folder of a file with names that begin with `stem`: possible dependencies beside it.
pub fn libraries_beside(file: &Path, stem: &str) -> Vec<PathBuf> {
    match file.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        Some(folder) => named(folder, stem),
        None => Vec::new(),
    }
}

/// Shared libraries of a folder whose name after `lib` is the stem, with or without a version before or after the
/// extension. They are sorted by name in descending order, so that a later version is first. A folder that cannot be
/// read has none.
fn named(folder: &Path, stem: &str) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let is_library = |path: &PathBuf| {
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        let name = name.strip_prefix("lib").unwrap_or(name);
        let version = |rest: &str| rest.chars().all(|c| c.is_ascii_digit() || c == '.');
        name.strip_prefix(stem).is_some_and(|rest| {
            rest.strip_prefix(".so").is_some_and(version)
                || rest.strip_suffix(".dylib").is_some_and(version)
                || rest.strip_suffix(".dll").is_some_and(version)
        })
    };
    let mut found: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).filter(is_library).collect();
    found.sort_unstable_by(|a, b| b.cmp(a));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn libraries_are_known_by_name_and_a_file_stands_for_itself() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let lib = folder.path().join("lib");
        std::fs::create_dir(&lib).expect("a folder");
        for name in
            ["libA.so.1.4.3", "libA.so.2", "libA.2.dylib", "A.dll", "libA_core.so.2", "libA.so.2.txt", "libAB.so"]
        {
            std::fs::write(lib.join(name), "").expect("writable");
        }
        let names = |paths: Vec<PathBuf>| -> Vec<String> {
            paths.iter().filter_map(|p| Some(p.file_name()?.to_str()?.to_owned())).collect()
        };
        let expected = ["libA.so.2", "libA.so.1.4.3", "libA.2.dylib", "A.dll"];
        assert_eq!(names(find_libraries(folder.path(), "A")), expected);
        assert_eq!(names(find_libraries(&lib, "A")), expected);
        assert_eq!(names(libraries_beside(&lib.join("libA.so.2"), "AB")), ["libAB.so"]);
        assert!(libraries_beside(Path::new("libA.so.2"), "AB").is_empty(), "a name is left to the system");
        let absent = folder.path().join("absent.so");
        assert_eq!(find_libraries(&absent, "A"), std::slice::from_ref(&absent));
        assert!(find_libraries(folder.path(), "B").is_empty());
        #[cfg(unix)]
        {
            let socket = folder.path().join("libA.so.3");
            let _listener = std::os::unix::net::UnixListener::bind(&socket).expect("a socket");
            assert!(find_libraries(&socket, "A").is_empty(), "the loader does not open what is no regular file");
        }
    }
}
