//! A folder that is written completely or not at all: filled under a hidden name beside its target, then renamed.

use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use crate::atomic::{cause, write_atomically};
use crate::error::InputError;
use crate::faults::{Operation, retry};
use crate::lock::TargetLock;
use crate::partial::{folder_of, new_folder, sync_folder};

/// A folder during writing. If it is dropped before the end, no file remains. Its target is locked meanwhile.
#[derive(Debug)]
pub struct NewFolder {
    target: PathBuf,
    partial: TempDir,
    _lock: TargetLock,
}

impl NewFolder {
    /// Starts a folder at `target`, and creates its parents. An existing folder must be empty. Leftovers of killed
    /// processes that wrote the same folder are removed.
    ///
    /// # Errors
    /// The target exists, cannot be written to, or another process is writing it.
    pub fn start(target: &Path) -> Result<Self, InputError> {
        let fault = |problem: String| {
            let help = "name a folder that does not exist yet, on a disk with room";
            InputError::new(target, "the new folder", problem, help)
        };
        // A link to an empty folder is followed.
        let place = fs::canonicalize(target).unwrap_or_else(|_| target.to_path_buf());
        let cannot = |e: io::Error| fault(format!("cannot be made: {}", cause(folder_of(&place), &e)));
        fs::create_dir_all(folder_of(&place)).map_err(cannot)?;
        // The folder is locked before the check. A killed process that had finished leaves its lock file. The next
        // holder of the lock removes it, even if it finds the folder complete.
        let lock = TargetLock::acquire(&place)?;
        match fs::read_dir(target) {
            Ok(mut entries) => {
                if entries.next().is_some() {
                    return Err(fault("the folder is not empty".into()));
                }
            }
            Err(e) if e.kind() == ErrorKind::NotFound => {}
            Err(e) if e.kind() == ErrorKind::NotADirectory => return Err(fault("a file is in the way".into())),
            Err(e) => return Err(fault(format!("cannot be read: {e}"))),
        }
        let partial = new_folder(&place).map_err(cannot)?;
        Ok(Self { target: place, partial, _lock: lock })
    }

    /// Path of a file of this name during writing. Its own folder is created.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn file(&self, name: &str) -> io::Result<PathBuf> {
        let path = self.partial.path().join(name);
        if let Some(parent) = path.parent() {
            retry(Operation::Create, || fs::create_dir_all(parent)).map_err(|e| self.explain(&e))?;
        }
        Ok(path)
    }

    /// Writes a text.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write_text(&self, name: &str, text: &str) -> io::Result<()> {
        write_atomically(&self.file(name)?, |w| w.write_all(text.as_bytes()))
    }

    /// Renames the folder to its target, once all of it is on the disk.
    ///
    /// # Errors
    /// Those of the file system; no file remains. Only if the very last step fails, the sync of the folder's name, the
    /// folder is at its target.
    pub fn finish(self) -> io::Result<()> {
        sync_all_folders(self.partial.path()).map_err(|e| self.explain(&e))?;
        // An empty folder may be at the target. On Unix the rename replaces it; elsewhere it must be removed first.
        #[cfg(not(unix))]
        let _ = fs::remove_dir(&self.target);
        retry(Operation::Rename, || fs::rename(self.partial.path(), &self.target)).map_err(|e| self.explain(&e))?;
        // The temporary name no longer exists, and nothing is left to remove.
        let Self { target, partial, _lock } = self;
        let _ = partial.keep();
        let folder = folder_of(&target);
        sync_folder(folder).map_err(|e| io::Error::new(e.kind(), cause(folder, &e)))
    }

    fn explain(&self, error: &io::Error) -> io::Error {
        io::Error::new(error.kind(), cause(folder_of(&self.target), error))
    }
}

/// Syncs the names in a folder and in its subfolders to the disk. The files are there already.
fn sync_all_folders(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            sync_all_folders(&entry.path())?;
        }
    }
    sync_folder(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).expect("there").filter_map(|e| e.ok()?.file_name().into_string().ok()).collect()
    }

    #[test]
    fn a_folder_appears_when_it_is_finished_and_leaves_nothing_when_it_is_not() {
        let home = tempfile::tempdir().expect("a temporary folder");
        let target = home.path().join("a/set");
        let begun = NewFolder::start(&target).expect("writable");
        fs::write(begun.file("images/x.png").expect("made"), "x").expect("written");
        assert!(!target.exists());
        drop(begun);
        assert!(names(&home.path().join("a")).is_empty());
        fs::create_dir(&target).expect("an empty folder is no obstacle");
        let begun = NewFolder::start(&target).expect("writable");
        fs::write(begun.file("images/x.png").expect("made"), "x").expect("written");
        begun.finish().expect("finished");
        assert_eq!(names(&home.path().join("a")), ["set"]);
        assert_eq!(fs::read_to_string(target.join("images/x.png")).expect("there"), "x");
        // A process that was killed at the very end left its lock file.
        fs::write(home.path().join("a/set.lock"), "").expect("written");
        assert!(NewFolder::start(&target).expect_err("full").to_string().contains("not empty"));
        assert_eq!(names(&home.path().join("a")), ["set"]);
        let file = home.path().join("file");
        fs::write(&file, "x").expect("written");
        assert!(NewFolder::start(&file).expect_err("a file").to_string().contains("in the way"));
    }
}
