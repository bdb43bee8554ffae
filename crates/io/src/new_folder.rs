//! A folder that appears whole or not at all: filled under a hidden name beside its place, then renamed.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use tempfile::TempDir;

/// A folder that is being filled. Dropped before it is finished, it leaves nothing behind.
#[derive(Debug)]
pub struct NewFolder {
    target: PathBuf,
    partial: TempDir,
}

impl NewFolder {
    /// Starts a folder at `target`, whose parents are made. A folder that is there must be empty.
    ///
    /// # Errors
    /// The place is taken, or cannot be written to.
    pub fn start(target: &Path) -> io::Result<Self> {
        match fs::read_dir(target) {
            Ok(mut entries) => {
                if entries.next().is_some() {
                    return Err(io::Error::new(ErrorKind::AlreadyExists, "the folder is not empty"));
                }
            }
            Err(e) if e.kind() == ErrorKind::NotFound => {}
            Err(e) if e.kind() == ErrorKind::NotADirectory => {
                return Err(io::Error::new(e.kind(), "a file is in the way"));
            }
            Err(e) => return Err(e),
        }
        let parent = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(parent)?;
        let mut builder = tempfile::Builder::new();
        builder.prefix(".dunkelfeld-").suffix(".partial");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(fs::Permissions::from_mode(0o777));
        }
        Ok(Self { target: target.to_path_buf(), partial: builder.tempdir_in(parent)? })
    }

    /// Where the file of this name is while the folder is being filled; its own folder is made.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn file(&self, name: &str) -> io::Result<PathBuf> {
        let path = self.partial.path().join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent)?;
        }
        Ok(path)
    }

    /// Writes a text.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write_text(&self, name: &str, text: &str) -> io::Result<()> {
        fs::write(self.file(name)?, text)
    }

    /// Puts the folder into its place.
    ///
    /// # Errors
    /// Those of the file system; nothing is left behind.
    pub fn finish(self) -> io::Result<()> {
        // An empty folder may be in the place; it was so when this one was started.
        match fs::remove_dir(&self.target) {
            Err(e) if e.kind() != ErrorKind::NotFound => return Err(e),
            _ => {}
        }
        fs::rename(self.partial.path(), &self.target)?;
        // The name is gone, and with it what would be cleared away.
        let _ = self.partial.keep();
        Ok(())
    }
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
        assert!(NewFolder::start(&target).expect_err("full").to_string().contains("not empty"));
        let file = home.path().join("file");
        fs::write(&file, "x").expect("written");
        assert!(NewFolder::start(&file).expect_err("a file").to_string().contains("in the way"));
    }
}
