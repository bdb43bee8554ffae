//! The folder of a set among several processes: its start and its removal, one at a time, and a mark that it is open.

use dunkelfeld::{Error, InputError};
use dunkelfeld_io::lock::{FolderMark, TargetLock};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Creates the folder of a set, and waits for another process that starts, finishes or removes the same set, which takes
/// milliseconds.
pub(crate) fn enter(path: &Path) -> Result<TargetLock, Error> {
    const PAUSES: u32 = 500;
    /// Another process may have removed the folder.
    const TRIES: u32 = 10;
    let file = own_path(path, "set.json")?;
    for pause in 0..PAUSES {
        fs::create_dir_all(path).map_err(|e| Error::Output {
            file: path.into(),
            problem: format!("cannot be made: {e}"),
            help: "name a folder on a disk with room".into(),
        })?;
        match TargetLock::try_acquire(&file) {
            Ok(Some(lock)) => return Ok(lock),
            Err(e) if pause >= TRIES => return Err(e.into()),
            Ok(None) | Err(_) => std::thread::sleep(Duration::from_millis(20)),
        }
    }
    Ok(TargetLock::acquire(&file)?)
}

/// The path of a file in the folder of a set. The folder itself may be a link.
///
/// # Errors
/// The file, or a folder in between, is a symbolic link: it may lead to any place. Nothing is read or written there.
pub(crate) fn own_path(folder: &Path, name: &str) -> Result<PathBuf, InputError> {
    let mut path = folder.to_path_buf();
    for part in Path::new(name) {
        path.push(part);
        if fs::symlink_metadata(&path).is_ok_and(|meta| meta.is_symlink()) {
            let help = "replace the link by the file or folder that it leads to";
            return Err(InputError::of_file(path, "is a symbolic link, and a set follows none", help));
        }
    }
    Ok(path)
}

/// The folders of the files of images.
pub(crate) const FOLDERS: [&str; 11] =
    ["costs", "coverage", "depth", "images", "labels", "linear", "masks", "normals", "raw", "records", "semantic"];

/// Removes the files of images in the folder of a set in which no image is finished, and that no program has open.
pub(crate) fn remove_stale(path: &Path) {
    for folder in FOLDERS {
        let Ok(folder) = own_path(path, folder) else { continue };
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let is_index = |(index, _): (&str, &str)| index.parse::<u64>().is_ok();
            if name.split_once('.').is_some_and(is_index) {
                // A file that stays is found by a check.
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

/// Removes the folder of a set without images that no other program has open. A folder that contains any other file is left.
pub(crate) fn remove_empty(path: &Path, mark: Option<&FolderMark>) {
    let Ok(lock) = enter(path) else { return };
    if !mark.is_some_and(FolderMark::end) {
        return;
    }
    let folders = fs::read_dir(path).into_iter().flatten().flatten().filter(|entry| entry.path().is_dir());
    if folders.map(|entry| fs::remove_dir(entry.path())).any(|removed| removed.is_err()) {
        return;
    }
    for name in ["study.toml", "set.json"] {
        // A file that stays is in a folder that stays.
        let _ = fs::remove_file(path.join(name));
    }
    drop(lock);
    // Another process that starts the set has its lock in the folder.
    let _ = fs::remove_dir(path);
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_io::lock::is_marked;

    fn start(path: &Path) -> Option<FolderMark> {
        let _lock = enter(path).expect("a folder");
        for name in ["records", "labels"] {
            fs::create_dir_all(path.join(name)).expect("a folder");
        }
        fs::write(path.join("set.json"), "{}").expect("written");
        FolderMark::new(&path.join("records"))
    }

    #[test]
    fn the_last_one_removes_an_empty_set() {
        let home = tempfile::tempdir().expect("a folder");
        let path = home.path().join("a/set");
        let [first, second] = [(); 2].map(|()| start(&path));
        assert!(first.is_some() && second.is_some());
        remove_empty(&path, None);
        remove_empty(&path, first.as_ref());
        assert!(path.join("records").is_dir() && path.join("labels").is_dir() && path.join("set.json").is_file());
        // The first one has given up its mark, although it is still there.
        assert_eq!(is_marked(&path.join("records")), Some(true));
        remove_empty(&path, second.as_ref());
        assert!(!path.exists() && is_marked(&path.join("records")) == Some(false));
        // A file of an image keeps the folder.
        let mark = start(&path);
        fs::write(path.join("records/000000.json"), "{}").expect("written");
        remove_empty(&path, mark.as_ref());
        assert!(path.join("set.json").is_file());
    }

    /// Two threads start and remove one set many times: each of them finds the folder of its records until its end.
    #[test]
    fn starts_and_removals_do_not_fight() {
        let home = tempfile::tempdir().expect("a folder");
        let path = home.path().join("set");
        std::thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| {
                    for _ in 0..40 {
                        let mark = start(&path);
                        assert!(path.join("records").is_dir() && path.join("set.json").is_file());
                        std::thread::yield_now();
                        assert!(path.join("records").is_dir() && path.join("set.json").is_file());
                        remove_empty(&path, mark.as_ref());
                    }
                });
            }
        });
        assert!(!path.exists());
    }
}
