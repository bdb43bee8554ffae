//! Files that are written completely or not at all: a temporary file in the same folder, synced, then renamed to the
//! target.

use std::fs;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use tempfile::{NamedTempFile, TempPath};

use crate::faults::{self, Operation, retry};
use crate::partial::{folder_of, new_file, new_folder, resolved, sync_folder};

/// Writes a file. Readers read either the complete old contents or the complete new ones, also after a crash.
///
/// `fill` writes the contents through a buffer. The bytes are written to a hidden file with a unique name in the
/// target's folder (a rename is atomic only within one file system), synced to the disk, and then renamed to `path`.
/// After an error, the hidden file is removed and an existing target remains as it was. Only if the very last step
/// fails, the sync of the folder, the target is the new file. Leftovers of killed processes that wrote the same target
/// are removed.
///
/// # Errors
/// The error of `fill`, of the same kind, or that of the file system. The message contains `path`, the cause and help.
pub fn write_atomically<F>(path: &Path, fill: F) -> io::Result<()>
where
    F: FnOnce(&mut BufWriter<PartialFile>) -> io::Result<()>,
{
    let target = writable_target(path)?;
    let write = || {
        let mut writer = BufWriter::new(PartialFile { file: new_file(&target)? });
        let result = fill(&mut writer).and_then(|()| writer.flush());
        // After a fault the rest of the buffer is not written.
        let (partial, _) = writer.into_parts();
        result.and_then(|()| partial.finish(&target))
    };
    write().map_err(|e| explain(path, folder_of(&target), &e))
}

/// Writes a file that must not exist: neither a file nor a link of this name is replaced, also not one that appears during
/// the write. `write` writes a file of the same name in a hidden folder beside `path`. When it is complete, it is moved to `path`.
///
/// # Errors
/// The error of `write`; that of the file system, of the kind [`io::ErrorKind::AlreadyExists`] if `path` exists. No partial
/// file remains.
pub fn write_new(path: &Path, write: impl FnOnce(&Path) -> io::Result<()>) -> io::Result<()> {
    let folder = folder_of(path);
    let fault = |e: io::Error| explain(path, folder, &e);
    let Some(name) = path.file_name() else {
        return Err(fault(io::Error::new(io::ErrorKind::InvalidInput, "it names no file")));
    };
    let hidden = new_folder(path).map_err(fault)?;
    let partial = hidden.path().join(name);
    write(&partial)?;
    let mut left = Some(TempPath::try_from_path(partial).map_err(fault)?);
    let rename = || match left.take().map(|partial| partial.persist_noclobber(path)) {
        Some(Err(e)) => {
            left = Some(e.path);
            Err(e.error)
        }
        _ => Ok(()),
    };
    retry(Operation::Rename, rename).and_then(|()| sync_folder(folder)).map_err(fault)
}

/// A file under a temporary name. Writes are complete or fail. Signals and short writes are handled.
#[derive(Debug)]
pub struct PartialFile {
    file: NamedTempFile,
}

impl PartialFile {
    /// Renames the file to the target.
    fn finish(self, target: &Path) -> io::Result<()> {
        if let Ok(existing) = fs::metadata(target) {
            // The permissions are set if possible: some file systems store none.
            let _ = self.file.as_file().set_permissions(existing.permissions());
        }
        retry(Operation::Sync, || self.file.as_file().sync_all())?;
        let mut path = Some(self.file);
        retry(Operation::Rename, || match path.take().map(|file| file.persist(target)) {
            Some(Err(e)) => {
                path = Some(e.file);
                Err(e.error)
            }
            _ => Ok(()),
        })?;
        sync_folder(folder_of(target))
    }
}

impl Write for PartialFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut left = bytes;
        while !left.is_empty() {
            match retry(Operation::Write, || self.file.as_file_mut().write(&left[..faults::most(left.len())]))? {
                0 => return Err(io::ErrorKind::WriteZero.into()),
                written => left = left.get(written..).unwrap_or_default(),
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.as_file_mut().flush()
    }
}

impl Seek for PartialFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        retry(Operation::Seek, || self.file.as_file_mut().seek(to))
    }
}

/// A hidden file beside `path`, at whose path [`write_atomically`] can write. Dropped, it is removed.
///
/// # Errors
/// As [`check_writable`].
pub fn hidden_file(path: &Path) -> io::Result<impl AsRef<Path> + use<>> {
    let target = writable_target(path)?;
    new_file(&target).map_err(|e| explain(path, folder_of(&target), &e))
}

/// Would [`write_atomically`] succeed now, apart from a full disk? Long runs check this before they start.
///
/// # Errors
/// As [`write_atomically`]. No file remains, and an existing file is not changed.
pub fn check_writable(path: &Path) -> io::Result<()> {
    hidden_file(path).map(drop)
}

/// The file of `path`, if it can be one.
fn writable_target(path: &Path) -> io::Result<PathBuf> {
    if path.file_name().is_none() {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            format!("cannot write {}: it names no file", path.display()),
        ));
    }
    if path.is_dir() {
        return Err(io::Error::new(
            io::ErrorKind::IsADirectory,
            format!("cannot write {}: it is a folder; name a file in it", path.display()),
        ));
    }
    // A link is followed, so that the file behind it is replaced and not the link itself.
    let target = resolved(path);
    // The partial file has a shorter name, so that only the rename would fail.
    if let Err(e) = fs::symlink_metadata(&target)
        && e.kind() == io::ErrorKind::InvalidFilename
    {
        let problem = format!("cannot write {}: its name is too long; use a shorter one", path.display());
        return Err(io::Error::new(e.kind(), problem));
    }
    // A pipe or a device would be replaced by a file.
    if let Some(what) = fs::metadata(&target).ok().as_ref().and_then(crate::input::other_kind) {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            format!("cannot write {}: it is {what}, not a regular file; name a regular file", path.display()),
        ));
    }
    // A write-protected file is not replaced. The rename alone would replace it.
    if fs::metadata(&target).is_ok_and(|m| m.permissions().readonly()) {
        return Err(io::Error::new(
            io::ErrorKind::PermissionDenied,
            format!(
                "cannot write {}: the file is read-only; change its permissions or write elsewhere",
                path.display()
            ),
        ));
    }
    Ok(target)
}

fn explain(path: &Path, folder: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("cannot write {}: {}", path.display(), cause(folder, error)))
}

/// The reason for a file or folder that cannot be written, with help.
pub(crate) fn cause(folder: &Path, error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound if !folder.exists() => {
            format!("the folder {} does not exist; create it or write elsewhere", folder.display())
        }
        io::ErrorKind::NotADirectory => format!("{} is not a folder", folder.display()),
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            format!("no permission to write in {}; change it or write elsewhere", folder.display())
        }
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "the disk is full; free some space".to_string(),
        io::ErrorKind::FileTooLarge => {
            format!(
                "{error}; the file system or `ulimit -f` limits the size of files; raise the limit or write elsewhere"
            )
        }
        io::ErrorKind::CrossesDevices => {
            format!("{error}; the file is a mount point of its own; name a file beside it or in another folder")
        }
        // The message of an encoder about its data.
        _ if error.raw_os_error().is_none() => error.to_string(),
        io::ErrorKind::AlreadyExists => "the file exists; use another name".to_string(),
        _ => format!("{error}; check the disk {} is on, or write elsewhere", folder.display()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .expect("the folder exists")
            .filter_map(|e| e.ok()?.file_name().into_string().ok())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_new_file_and_a_replaced_file_hold_the_new_bytes() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.txt");
        for text in ["first", "the second, longer than the first", "3"] {
            write_atomically(&path, |w| w.write_all(text.as_bytes())).expect("writable");
            assert_eq!(fs::read_to_string(&path).expect("readable"), text);
        }
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_failing_writer_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.txt");
        fs::write(&path, "old").expect("writable");
        let error = write_atomically(&path, |w| {
            w.write_all(&[0; 100_000])?;
            Err(io::Error::new(io::ErrorKind::InvalidData, "the encoder failed"))
        })
        .expect_err("the writer fails");
        assert_eq!(error.kind(), io::ErrorKind::InvalidData);
        assert!(error.to_string().contains("failed"), "{error}");
        assert_eq!(fs::read_to_string(&path).expect("readable"), "old");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_file_that_is_written_again_clears_away_what_a_killed_process_left() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.film");
        fs::write(folder.path().join(".a.film.01234567-abcd1234.partial"), "half of it").expect("writable");
        check_writable(&path).expect("a new file");
        assert!(names(folder.path()).is_empty());
        for text in ["first", "second"] {
            fs::write(folder.path().join(".a.film.01234567-abcd1234.partial"), "half of it").expect("writable");
            write_atomically(&path, |w| w.write_all(text.as_bytes())).expect("writable");
            assert_eq!(fs::read_to_string(&path).expect("readable"), text);
            assert_eq!(names(folder.path()), ["a.film"]);
        }
        write_atomically(&path, |_| Err(io::Error::other("failed"))).expect_err("the writer fails");
        assert_eq!(fs::read_to_string(&path).expect("readable"), "second");
        assert_eq!(names(folder.path()), ["a.film"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_name_that_is_too_long_is_found_before_the_work() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let name = |length: usize| folder.path().join(format!("{}.png", "a".repeat(length)));
        check_writable(&name(240)).expect("a long name");
        let error = check_writable(&name(260)).expect_err("a longer name").to_string();
        assert!(error.contains("too long") && error.contains("shorter"), "{error}");
    }

    #[test]
    fn a_new_file_replaces_none_that_appears_during_its_write() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.txt");
        let write = |text: &'static str| {
            move |partial: &Path| -> io::Result<()> { write_atomically(partial, |w| w.write_all(text.as_bytes())) }
        };
        write_new(&path, write("first")).expect("no such file");
        assert_eq!(fs::read_to_string(&path).expect("readable"), "first");
        assert_eq!(names(folder.path()), ["a.txt"]);
        let error = write_new(&path, write("second")).expect_err("it exists");
        assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        assert!(error.to_string().contains("a.txt: the file exists"), "{error}");
        fs::remove_file(&path).expect("own file");
        // Another program writes it meanwhile.
        let meanwhile = |partial: &Path| {
            assert_eq!((partial.file_name(), partial.extension()), (path.file_name(), path.extension()));
            fs::write(&path, "of another program")?;
            write("third")(partial)
        };
        assert_eq!(write_new(&path, meanwhile).expect_err("it appeared").kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read_to_string(&path).expect("readable"), "of another program");
        assert_eq!(names(folder.path()), ["a.txt"]);
        let failed = write_new(&folder.path().join("b.txt"), |_| Err(io::Error::other("failed")));
        assert_eq!(failed.expect_err("the writer fails").to_string(), "failed");
        assert_eq!(names(folder.path()), ["a.txt"]);
        // A link that leads nowhere is not followed.
        #[cfg(unix)]
        {
            let (link, target) = (folder.path().join("link"), folder.path().join("target"));
            std::os::unix::fs::symlink(&target, &link).expect("links work");
            assert_eq!(write_new(&link, write("x")).expect_err("a link").kind(), io::ErrorKind::AlreadyExists);
            assert!(!target.exists() && fs::symlink_metadata(&link).expect("present").is_symlink());
        }
        for impossible in [Path::new(""), &folder.path().join("no/a.txt")] {
            write_new(impossible, write("x")).expect_err("no such folder");
        }
    }

    #[test]
    fn messages_name_the_missing_folder_and_the_folder_in_the_file_s_place() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let missing = folder.path().join("no/such/a.png");
        let error = write_atomically(&missing, |_| Ok(())).expect_err("no such folder");
        assert!(error.to_string().contains("does not exist"), "{error}");
        let error = write_atomically(folder.path(), |_| Ok(())).expect_err("a folder");
        assert!(error.to_string().contains("is a folder"), "{error}");
        let error = write_atomically(Path::new(""), |_| Ok(())).expect_err("no name");
        assert!(error.to_string().contains("names no file"), "{error}");
        let plain = folder.path().join("plain");
        fs::write(&plain, "x").expect("writable");
        assert!(write_atomically(&plain.join("a.png"), |_| Ok(())).is_err());
    }

    #[test]
    fn the_check_of_an_output_leaves_no_file() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.txt");
        check_writable(&path).expect("a new file");
        assert!(names(folder.path()).is_empty());
        fs::write(&path, "old").expect("writable");
        check_writable(&path).expect("a file that is there");
        assert_eq!(fs::read_to_string(&path).expect("readable"), "old");
        for impossible in [folder.path(), &path.join("b.txt"), &folder.path().join("no/b.txt"), Path::new("")] {
            check_writable(impossible).expect_err("not a file that can be");
        }
    }

    #[test]
    fn a_read_only_file_is_not_replaced() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.txt");
        fs::write(&path, "old").expect("writable");
        let mut permissions = fs::metadata(&path).expect("present").permissions();
        permissions.set_readonly(true);
        fs::set_permissions(&path, permissions).expect("own file");
        let error = write_atomically(&path, |w| w.write_all(b"new")).expect_err("read-only");
        assert!(error.to_string().contains("read-only"), "{error}");
        assert_eq!(check_writable(&path).expect_err("read-only").to_string(), error.to_string());
        assert_eq!(fs::read_to_string(&path).expect("readable"), "old");
    }

    #[cfg(unix)]
    #[test]
    fn a_socket_and_a_device_are_not_replaced() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (socket, link) = (folder.path().join("socket"), folder.path().join("link"));
        let _bound = std::os::unix::net::UnixListener::bind(&socket).expect("a socket");
        std::os::unix::fs::symlink("/dev/null", &link).expect("links work");
        for (path, what) in [(&socket, "a socket"), (&link, "a device")] {
            let before = fs::symlink_metadata(path).expect("present").file_type();
            let error = write_atomically(path, |w| w.write_all(b"new")).expect_err(what);
            assert!(error.to_string().contains(what), "{error}");
            assert_eq!(check_writable(path).expect_err(what).to_string(), error.to_string());
            assert_eq!(fs::symlink_metadata(path).expect("present").file_type(), before);
        }
        assert_eq!(names(folder.path()), ["link", "socket"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_keeps_pointing_to_the_replaced_file_and_permissions_stay() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.txt");
        fs::write(&path, "old").expect("writable");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).expect("own file");
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&path, &link).expect("links work");
        write_atomically(&link, |w| w.write_all(b"new")).expect("writable");
        assert!(fs::symlink_metadata(&link).expect("present").is_symlink());
        assert_eq!(fs::read_to_string(&path).expect("readable"), "new");
        assert_eq!(fs::metadata(&path).expect("present").permissions().mode() & 0o777, 0o640);
    }
}
