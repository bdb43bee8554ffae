//! A folder of results that grows during a long measurement. Each file is written completely or not at all.

use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use crate::atomic::{cause, write_atomically};
use crate::error::InputError;
use crate::faults::{Operation, retry};
use crate::input::{InputFiles, ReadFault, Role};
use crate::lock::TargetLock;
use crate::partial::{folder_of, is_partial, remove_leftovers_in};

/// The longest text of a result \[bytes\].
const MAX_TEXT: u64 = 256 << 20;

/// An open folder, locked against other processes that would write it. Names are those of files in it, and never come
/// from a user's input.
#[derive(Debug)]
pub struct ResultsFolder {
    path: PathBuf,
    _lock: TargetLock,
}

impl ResultsFolder {
    /// Opens a folder, and creates it with its parents if there is none. Partial files of killed processes are removed.
    ///
    /// # Errors
    /// It cannot be made, something else has its name, or another process writes it.
    pub fn open(path: &Path) -> Result<Self, InputError> {
        let problem = |e: io::Error| format!("cannot be made: {e}");
        make(path).map_err(|e| InputError::new(path, "the folder", problem(e), "name another folder"))?;
        let lock = TargetLock::acquire(path)?;
        remove_leftovers_in(path);
        Ok(Self { path: path.to_path_buf(), _lock: lock })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Path of the present or future file of this name.
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Is it empty, except for partial files?
    ///
    /// # Errors
    /// It cannot be listed.
    pub fn is_empty(&self) -> io::Result<bool> {
        for entry in fs::read_dir(&self.path)? {
            if !is_partial(&entry?.file_name()) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The text of a file; `None` if there is no such file.
    ///
    /// # Errors
    /// The file is there, but cannot be read as text.
    pub fn read_text(&self, name: &str) -> Result<Option<String>, InputError> {
        let path = self.file(name);
        let fault =
            |problem: String| InputError::new(&path, "the whole file", problem, "delete it, or use another folder");
        let bytes = match InputFiles::new().read(&path, Role::Result, MAX_TEXT) {
            Ok(bytes) => bytes,
            Err(ReadFault::Missing) => return Ok(None),
            Err(e) => return Err(fault(e.problem())),
        };
        String::from_utf8(bytes).map(Some).map_err(|_| fault("is not UTF-8 text".into()))
    }

    /// Writes a text.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write_text(&self, name: &str, text: &str) -> io::Result<()> {
        write_atomically(&self.file(name), |w| w.write_all(text.as_bytes()))
    }

    /// Removes the folder with its content, and opens it again, empty.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn clear(self) -> io::Result<Self> {
        match fs::remove_dir_all(&self.path) {
            Err(e) if e.kind() != ErrorKind::NotFound => Err(e),
            _ => make(&self.path).map(|()| self),
        }
    }
}

fn make(path: &Path) -> io::Result<()> {
    retry(Operation::Create, || fs::create_dir_all(path)).map_err(|e| match e.kind() {
        ErrorKind::AlreadyExists | ErrorKind::NotADirectory => {
            io::Error::new(e.kind(), "a file is in the way; name a folder")
        }
        kind => io::Error::new(kind, cause(folder_of(path), &e)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn written_results_are_read_and_missing_ones_are_none() {
        let home = tempfile::tempdir().expect("a temporary folder");
        let folder = ResultsFolder::open(&home.path().join("a/b")).expect("writable");
        assert_eq!(folder.read_text("x.json").expect("no error"), None);
        assert!(folder.is_empty().expect("a folder"));
        folder.write_text("x.json", "{}").expect("writable");
        assert_eq!(folder.read_text("x.json").expect("readable").as_deref(), Some("{}"));
        fs::write(folder.file("x.json"), [0xff, 0xfe]).expect("writable");
        let error = folder.read_text("x.json").expect_err("not text");
        assert!(error.to_string().contains("x.json"), "{error}");
        assert!(!folder.is_empty().expect("a folder"));
        let folder = folder.clear().expect("removable");
        assert_eq!(folder.read_text("x.json").expect("no error"), None);
    }

    #[test]
    fn a_file_in_the_way_is_no_folder() {
        let home = tempfile::tempdir().expect("a temporary folder");
        let path = home.path().join("taken");
        fs::write(&path, "x").expect("writable");
        let error = ResultsFolder::open(&path).expect_err("a file");
        assert!(error.to_string().contains("in the way"), "{error}");
    }

    /// A process was killed while it wrote its first file.
    #[test]
    fn a_folder_with_a_partial_file_alone_is_empty() {
        let home = tempfile::tempdir().expect("a temporary folder");
        let folder = ResultsFolder::open(&home.path().join("a")).expect("writable");
        fs::write(folder.file(".x.json.91be2f9a-FnAfuOcr.partial"), "{").expect("writable");
        assert!(folder.is_empty().expect("a folder"));
        folder.write_text("x.json", "{}").expect("writable");
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1, "the leftover is removed");
        for other in [".partial", ".x.partial", "x.json.91be2f9a-FnAfuOcr.partial", "\u{e4}.91be2f9a-FnAfuOcr.partial"]
        {
            let folder = folder.path().join("b");
            let folder = ResultsFolder::open(&folder).expect("writable").clear().expect("removable");
            fs::write(folder.file(other), "").expect("writable");
            assert!(!folder.is_empty().expect("a folder"), "{other}");
        }
    }
}
