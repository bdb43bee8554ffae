//! The paths of the folder of a set, and its lock.

use dunkelfeld::{Error, InputError};
use dunkelfeld_io::lock::TargetLock;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::time::Duration;

/// Creates the folder of a set, and waits for another process that starts the same set, which takes milliseconds.
pub(crate) fn enter(path: &Path) -> Result<TargetLock, Error> {
    const PAUSES: u32 = 500;
    fs::create_dir_all(path).map_err(|e| Error::Output {
        file: path.into(),
        problem: format!("cannot be made: {e}"),
        help: "name a folder on a disk with room".into(),
    })?;
    let file = own_path(path, "set.json")?;
    for _ in 0..PAUSES {
        if let Some(lock) = TargetLock::try_acquire(&file)? {
            return Ok(lock);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    Ok(TargetLock::acquire(&file)?)
}

/// The path of a file in the folder of a set. The folder itself may be a link.
///
/// # Errors
/// The name leads out of the folder, or the file or a folder in between is a symbolic link, which may lead to any place.
/// Nothing is read or written there.
pub(crate) fn own_path(folder: &Path, name: &str) -> Result<PathBuf, InputError> {
    if !Path::new(name).components().all(|part| matches!(part, Component::Normal(_))) || name.contains('\\') {
        return Err(InputError::new(name, "the name", "leads out of the set", "make the image again"));
    }
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
pub(crate) const FOLDERS: [&str; 12] = [
    "costs", "coverage", "depth", "images", "labels", "linear", "masks", "mvtec", "normals", "raw", "records",
    "semantic",
];
