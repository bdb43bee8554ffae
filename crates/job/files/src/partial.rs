//! The names of files and folders that are being written, and the detection of leftovers of killed processes.
//!
//! A partial file or folder is beside its target: `.NAME.PROCESS-RANDOM.partial` for the target `NAME`, with eight
//! random digits for the process and eight random characters for the write. No two writes share one. A file is locked
//! as long as its process writes it, so that a partial file without a lock is a leftover.

use crate::faults::{Operation, retry};
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::{Builder, NamedTempFile, TempDir};
use twox_hash::XxHash3_64;

const SUFFIX: &str = ".partial";
/// Random characters in a name, and digits of the process.
const RANDOM: usize = 8;
const PROCESS_DIGITS: usize = 8;
/// Maximum length of a file name: 255 bytes. A longer target is abbreviated by a checksum.
const MAX_NAME: usize = 200;
/// Number of attempts to create a partial file that other processes remove as a leftover before it is locked.
const ATTEMPTS: usize = 32;

/// The folder of a file.
pub(crate) fn folder_of(target: &Path) -> &Path {
    target.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The path that a name resolves to. Links are followed, also those to a file that does not exist yet.
pub(crate) fn resolved(path: &Path) -> PathBuf {
    /// The limit of Linux for links.
    const MAX_LINKS: usize = 40;
    let mut path = path.to_path_buf();
    for _ in 0..MAX_LINKS {
        if let Ok(whole) = path.canonicalize() {
            return whole;
        }
        match fs::read_link(&path) {
            Ok(link) => path = folder_of(&path).join(link),
            Err(_) => break,
        }
    }
    match (folder_of(&path).canonicalize(), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path,
    }
}

/// Is a name that of a partial file or folder, of any target?
pub(crate) fn is_partial(name: &OsStr) -> bool {
    partial_of(name).is_some()
}

/// The digits of the process in the name of a partial file or folder of any target; `None` if the name is no such name.
fn partial_of(name: &OsStr) -> Option<&str> {
    let random = PROCESS_DIGITS + 1 + RANDOM;
    let target = name.len().checked_sub(random + SUFFIX.len())?;
    // Names are cut before ASCII characters.
    let prefix = std::str::from_utf8(&name.as_encoded_bytes()[..target]).ok()?;
    let is_prefix = prefix.len() > 2 && prefix.starts_with('.') && prefix.ends_with('.');
    is_prefix.then(|| process_in(name, OsStr::new(prefix)))?
}

/// The prefix of the names of all partial files of a target.
fn prefix(target: &Path) -> OsString {
    let name = target.file_name().unwrap_or_default();
    let mut prefix = OsString::from(".");
    if name.len() > MAX_NAME {
        prefix.push(format!("{:016x}", XxHash3_64::oneshot(name.as_encoded_bytes())));
    } else {
        prefix.push(name);
    }
    prefix.push(".");
    prefix
}

/// Digits of this process in names. Process ids do not suffice: in containers, successive processes have the same id.
fn own_digits() -> &'static str {
    use std::hash::{BuildHasher, RandomState};
    static DIGITS: OnceLock<String> = OnceLock::new();
    DIGITS.get_or_init(|| format!("{:08x}", RandomState::new().hash_one(std::process::id()) as u32))
}

/// The digits of the process in the name of a partial file of the target; `None` if the name is no such name.
fn process_in<'a>(name: &'a OsStr, prefix: &OsStr) -> Option<&'a str> {
    let rest = name.as_encoded_bytes().strip_prefix(prefix.as_encoded_bytes())?;
    let middle = std::str::from_utf8(rest.strip_suffix(SUFFIX.as_bytes())?).ok()?;
    let (process, random) = middle.split_once('-')?;
    let is_random = random.len() == RANDOM && random.bytes().all(|b| b.is_ascii_alphanumeric());
    let is_process = process.len() == PROCESS_DIGITS && process.bytes().all(|b| b.is_ascii_hexdigit());
    (is_random && is_process).then_some(process)
}

fn builder_of<R>(target: &Path, mode: u32, make: impl Fn(&Builder<'_, '_>) -> io::Result<R>) -> io::Result<R> {
    let mut prefix = prefix(target);
    prefix.push(format!("{}-", own_digits()));
    let mut builder = Builder::new();
    builder.prefix(&prefix).suffix(SUFFIX).rand_bytes(RANDOM);
    // The permissions of a new file. The default of the library is private to the user.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(mode));
    }
    #[cfg(not(unix))]
    let _ = mode;
    retry(Operation::Create, || make(&builder))
}

/// A new, empty partial file beside its target, locked where the file system has locks. Dropped, it is removed. Leftovers of
/// the target are removed first.
pub(crate) fn new_file(target: &Path) -> io::Result<NamedTempFile> {
    remove_leftovers(target);
    let folder = folder_of(target);
    for _ in 0..ATTEMPTS {
        let file = builder_of(target, 0o666, |builder| builder.tempfile_in(folder))?;
        // Without locks no process takes it for a leftover.
        let _ = retry(Operation::Lock, || file.as_file().lock());
        if is_at(file.as_file(), file.path()) {
            return Ok(file);
        }
    }
    Err(io::Error::other("others remove the partial file again and again"))
}

/// A new, empty partial folder beside its target. Dropped, it is removed. The caller holds the lock of the target, so all
/// other partial folders of the target are leftovers, and are removed first.
pub(crate) fn new_folder(target: &Path) -> io::Result<TempDir> {
    for path in partials(target, |_, kind| kind.is_dir()) {
        let _ = fs::remove_dir_all(path);
    }
    builder_of(target, 0o777, |builder| builder.tempdir_in(folder_of(target)))
}

/// Removes the partial files of a target that no process holds. A file that cannot be opened or locked remains.
fn remove_leftovers(target: &Path) {
    // Those of this process are being written. Some network file systems do not separate its locks.
    let own = own_digits();
    partials(target, |process, kind| process != own && kind.is_file()).iter().for_each(|path| remove_unheld(path));
}

/// Removes the partial files of all targets in a folder that no process holds.
pub(crate) fn remove_leftovers_in(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        if is_file && partial_of(&entry.file_name()).is_some_and(|process| process != own_digits()) {
            remove_unheld(&entry.path());
        }
    }
}

fn remove_unheld(path: &Path) {
    let Ok(file) = OpenOptions::new().read(true).write(true).open(path) else { return };
    if file.try_lock().is_ok() && is_at(&file, path) {
        let _ = fs::remove_file(path);
    }
}

/// The partial files or folders of a target, selected by process and kind. Links are neither.
fn partials(target: &Path, choose: impl Fn(&str, fs::FileType) -> bool) -> Vec<PathBuf> {
    let prefix = prefix(target);
    let Ok(entries) = fs::read_dir(folder_of(target)) else { return Vec::new() };
    let chosen = entries.filter_map(|entry| {
        let entry = entry.ok()?;
        let name = entry.file_name();
        let process = process_in(&name, &prefix)?;
        choose(process, entry.file_type().ok()?).then(|| entry.path())
    });
    chosen.collect()
}

/// Does the name still belong to an open file, or was the file removed or replaced meanwhile?
pub(crate) fn is_at(file: &File, path: &Path) -> bool {
    let (Ok(open), Ok(named)) = (file.metadata(), fs::symlink_metadata(path)) else { return false };
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        (open.dev(), open.ino()) == (named.dev(), named.ino())
    }
    // An open file can neither be removed nor replaced there.
    #[cfg(not(unix))]
    {
        open.is_file() && named.is_file()
    }
}

/// Syncs the names in a folder to the disk. Without this, a rename may be lost after a power failure. Not every system
/// can.
///
/// # Errors
/// The disk reports a fault.
pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    use io::ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
    #[cfg(unix)]
    if let Ok(handle) = File::open(folder) {
        return match retry(Operation::Sync, || handle.sync_all()) {
            Err(e) if !matches!(e.kind(), InvalidInput | PermissionDenied | Unsupported) => Err(e),
            _ => Ok(()),
        };
    }
    let _ = folder;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn prefix_of(target: &str) -> OsString {
        prefix(Path::new(target))
    }

    #[test]
    fn partial_names_belong_to_one_target() {
        let is_of = |name: &str, target: &str| process_in(OsStr::new(name), &prefix_of(target)).is_some();
        let name = ".a.film.0123abcd-Wxyz1234.partial";
        assert!(is_of(name, "x/a.film") && !is_of(name, "a") && !is_of(name, "b.film"));
        let others = [&name[1..], &name[..name.len() - 1], ".a.film.partial", ".a.film.0123abcd-Wxyz123.partial"];
        for other in others.into_iter().chain([".a.film.0123abcd.partial", ".a.film.0123abcg-Wxyz1234.partial"]) {
            assert!(!is_of(other, "a.film"), "{other}");
        }
        let (long, longer) = ("n".repeat(254), "n".repeat(255));
        assert_ne!(prefix_of(&long), prefix_of(&longer));
        assert!(prefix_of(&longer).len() < 100);
    }

    #[test]
    fn locked_files_stay_and_unlocked_files_are_removed() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = |name: &str| folder.path().join(name);
        let (held, left, other) = (
            path(".a.00000000-aaaaaaaa.partial"),
            path(".a.00000000-bbbbbbbb.partial"),
            path(".b.00000000-cccccccc.partial"),
        );
        for file in [&held, &left, &other] {
            fs::write(file, "half of it").expect("writable");
        }
        let holder = File::open(&held).expect("there");
        holder.try_lock().expect("it is free");
        let own = new_file(&path("a")).expect("writable");
        assert!(held.exists() && !left.exists() && other.exists() && own.path().exists());
        let second = new_file(&path("a")).expect("writable");
        assert!(own.path().exists(), "a file that this process writes is no leftover");
        drop((own, second, holder));
        new_file(&path("a")).expect("writable");
        assert!(!held.exists(), "its process has ended");
        assert_eq!(fs::read_dir(folder.path()).expect("there").count(), 1);
    }
}
