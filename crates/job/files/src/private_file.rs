//! Files that other users of the machine cannot read, for a short time.

use std::io::{self, Write};
use std::path::Path;
use tempfile::{Builder, NamedTempFile, TempDir};

/// A file in a temporary folder of its own. Both are removed when it is dropped. On Unix only their owner can read them
/// (modes 0700 and 0600).
#[derive(Debug)]
pub struct PrivateFile {
    // It is removed before its folder.
    file: NamedTempFile,
    _folder: TempDir,
}

impl PrivateFile {
    /// Writes a file with this text, and with a random name that has this ending, as `.html`.
    ///
    /// # Errors
    /// The folder of temporary files cannot be written to.
    pub fn new(ending: &str, text: &str) -> io::Result<Self> {
        let mut builder = Builder::new();
        builder.prefix("dunkelfeld-");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o700));
        }
        let folder = builder.tempdir()?;
        // The default of the library is private to the user.
        let mut file = Builder::new().prefix("page-").suffix(ending).tempfile_in(folder.path())?;
        file.write_all(text.as_bytes())?;
        file.flush()?;
        Ok(Self { file, _folder: folder })
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        self.file.path()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_private_file_is_readable_by_its_owner_and_is_removed() {
        let file = PrivateFile::new(".html", "secret").expect("temporary files work");
        let (path, folder) = (file.path().to_owned(), file.path().parent().expect("a folder").to_owned());
        assert_eq!(fs::read_to_string(&path).expect("readable"), "secret");
        assert_eq!(path.extension().and_then(|e| e.to_str()), Some("html"));
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode = |path: &Path| fs::metadata(path).expect("present").permissions().mode() & 0o777;
            assert_eq!((mode(&folder), mode(&path)), (0o700, 0o600));
        }
        drop(file);
        assert!(!path.exists() && !folder.exists());
    }
}
