//! Locks of files and folders that one process uses for long: checkpoints, folders of results.
//!
//! The lock of `NAME` is the file `NAME.lock` beside it. The holder has an advisory lock of the operating system on
//! that file, and writes its identity into it. The lock ends with the process, however it ends. A lock file without an
//! advisory lock is a leftover and no obstacle. The holder removes the file at the end. Another process that opened the
//! file before the removal detects this and starts again.
//!
//! A file system without advisory locks is refused.

use crate::atomic::cause;
use crate::error::InputError;
use crate::faults::{Operation, retry};
use crate::partial::{folder_of, is_at, resolved};
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Maximum size of a lock file \[bytes\].
const MAX_BYTES: u64 = 4096;
/// Number of attempts to open a lock file that was removed, or not written yet, at the time of the check.
const ATTEMPTS: u32 = 50;
/// The pause between two attempts: a holder writes into the file immediately.
const PAUSE: Duration = Duration::from_millis(4);
/// The first line of each lock file.
const TITLE: &str = "lock file of dunkelfeld\n";

/// The lock of a file or folder, until it is dropped.
#[derive(Debug)]
pub struct TargetLock {
    target: PathBuf,
    path: PathBuf,
    /// Locked.
    file: File,
}

impl PartialEq for TargetLock {
    /// Is it the lock of the same target?
    fn eq(&self, other: &Self) -> bool {
        self.path == other.path
    }
}

/// The result of one attempt.
enum Attempt {
    Held(File),
    /// The file was removed while it was opened.
    Again,
    /// The holder in words, if they can be read yet.
    Busy(Option<String>),
}

impl TargetLock {
    /// Takes the lock of a file or folder, which need not exist; its folder must. Links are followed.
    ///
    /// # Errors
    /// Another process holds it, or this one already: the error names the holder and the time. The lock file cannot be
    /// written, or is no lock file.
    pub fn acquire(target: &Path) -> Result<Self, InputError> {
        let target = resolved(target);
        let path = lock_path(&target);
        for attempt in 0..ATTEMPTS {
            if attempt > 0 {
                std::thread::sleep(PAUSE);
            }
            match attempt_at(&path)? {
                Attempt::Held(file) => return Ok(Self { target, path, file }),
                Attempt::Again | Attempt::Busy(None) => {}
                Attempt::Busy(Some(holder)) => return Err(refusal(&target, &path, Some(&holder))),
            }
        }
        Err(refusal(&target, &path, None))
    }

    /// [`TargetLock::acquire`] for work that someone else may do: `None` if another process holds the lock, or this one
    /// already.
    ///
    /// # Errors
    /// The lock file cannot be written, or is no lock file.
    pub fn try_acquire(target: &Path) -> Result<Option<Self>, InputError> {
        let target = resolved(target);
        let path = lock_path(&target);
        for _ in 0..ATTEMPTS {
            match attempt_at(&path)? {
                Attempt::Held(file) => return Ok(Some(Self { target, path, file })),
                Attempt::Again => {}
                Attempt::Busy(_) => return Ok(None),
            }
        }
        Ok(None)
    }

    /// The file or folder that is locked, by its whole name.
    pub fn target(&self) -> &Path {
        &self.target
    }
}

impl Drop for TargetLock {
    fn drop(&mut self) {
        // The lock is still held: another process that has opened the file detects the removal once it gets the lock. A
        // file that replaced it belongs to another process.
        if is_at(&self.file, &self.path) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// The lock file of a target.
pub fn lock_path(target: &Path) -> PathBuf {
    let mut name = target.file_name().map_or_else(OsString::new, OsString::from);
    name.push(".lock");
    folder_of(target).join(name)
}

fn refusal(target: &Path, path: &Path, holder: Option<&str>) -> InputError {
    let lock = path.display();
    let (problem, help) = match holder {
        Some(holder) => (format!("is in use: {holder}"), "wait until it ends, end it, or use another name".into()),
        None => (
            "is in use by another process, which has not written its number".into(),
            format!("wait until it ends, or use another name; if there is no such process, delete {lock}"),
        ),
    };
    InputError::new(target, format!("the lock {lock}"), problem, help)
}

fn attempt_at(path: &Path) -> Result<Attempt, InputError> {
    let fault = |problem: String, help: &str| InputError::new(path, "the lock file", problem, help);
    let cannot = |e: io::Error| {
        let problem = format!("cannot be written: {}", cause(folder_of(path), &e));
        fault(problem, "check the permissions of the folder and the space on the disk")
    };
    let foreign =
        || fault("is in the way: this program did not write it".into(), "move it elsewhere, or use another name");
    let mut options = OpenOptions::new();
    options.read(true).write(true);
    let (mut file, is_new) = match retry(Operation::Create, || options.clone().create_new(true).open(path)) {
        Ok(file) => (file, true),
        Err(e) if e.kind() == ErrorKind::AlreadyExists => {
            // Opening a FIFO would wait, and a link may lead to any place.
            match fs::symlink_metadata(path) {
                Ok(meta) if !meta.is_file() => return Err(foreign()),
                Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Attempt::Again),
                _ => {}
            }
            match options.open(path) {
                Ok(file) => (file, false),
                Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Attempt::Again),
                Err(e) => return Err(cannot(e)),
            }
        }
        Err(e) => return Err(cannot(e)),
    };
    match locked(&file) {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Ok(Attempt::Busy(read(&mut file).ok().flatten())),
        Err(TryLockError::Error(e)) => {
            if is_new {
                let _ = fs::remove_file(path);
            }
            let problem = format!("cannot be locked: {e}");
            return Err(fault(problem, "write to a disk whose file system has advisory locks (`flock`)"));
        }
    }
    if !is_at(&file, path) {
        return Ok(Attempt::Again);
    }
    if !is_new {
        match read(&mut file) {
            Ok(_) => {}
            Err(e) if e.kind() == ErrorKind::InvalidData => return Err(foreign()),
            Err(e) => return Err(cannot(e)),
        }
    }
    if let Err(e) = write(&mut file) {
        let _ = fs::remove_file(path);
        return Err(cannot(e));
    }
    Ok(Attempt::Held(file))
}

fn locked(file: &File) -> Result<(), TryLockError> {
    let result = retry(Operation::Lock, || match file.try_lock() {
        Err(TryLockError::Error(e)) => Err(e),
        other => Ok(other),
    });
    result.unwrap_or_else(|e| Err(TryLockError::Error(e)))
}

/// The holder of the lock in words. `None` if the file is incomplete: its process is about to write it, or was killed before
/// it could.
fn read(file: &mut File) -> io::Result<Option<String>> {
    let mut text = String::new();
    file.seek(SeekFrom::Start(0))?;
    file.take(MAX_BYTES + 1).read_to_string(&mut text)?;
    match text.strip_prefix(TITLE) {
        Some(holder) => Ok(holder.strip_suffix('\n').map(str::to_owned)),
        None if TITLE.starts_with(&text) => Ok(None),
        None => Err(ErrorKind::InvalidData.into()),
    }
}

fn write(file: &mut File) -> io::Result<()> {
    let text = format!("{TITLE}{}\n", own());
    retry(Operation::Write, || {
        file.set_len(0)?;
        file.seek(SeekFrom::Start(0))?;
        file.write_all(text.as_bytes())
    })
}

/// The content of a lock file of this process.
fn own() -> String {
    let (process, since) = (std::process::id(), humantime::format_rfc3339_seconds(SystemTime::now()));
    let program = concat!("dunkelfeld ", env!("CARGO_PKG_VERSION"));
    format!("process {process} on host {:?} ({program}) has held it since {since}", host())
}

fn host() -> String {
    #[cfg(unix)]
    return rustix::system::uname().nodename().to_string_lossy().into_owned();
    #[cfg(not(unix))]
    return std::env::var("COMPUTERNAME").unwrap_or_default();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::{Fault, with_fault};

    fn home() -> (tempfile::TempDir, PathBuf) {
        let home = tempfile::tempdir().expect("a temporary folder");
        let target = home.path().join("a.film");
        (home, target)
    }

    fn is_empty(home: &tempfile::TempDir) -> bool {
        fs::read_dir(home.path()).expect("there").next().is_none()
    }

    #[test]
    fn a_second_holder_is_refused_and_learns_who_has_it() {
        let (home, target) = home();
        let lock = TargetLock::acquire(&target).expect("free");
        let message = TargetLock::acquire(&target).expect_err("held").to_string();
        let process = format!("process {} on host", std::process::id());
        for words in ["a.film", "a.film.lock", &process, "dunkelfeld", "since 2", "Z", "help: wait"] {
            assert!(message.contains(words), "{words} is not in {message}");
        }
        drop(lock);
        assert!(is_empty(&home), "the lock file is removed");
        drop(TargetLock::acquire(&target).expect("free again"));
        assert!(is_empty(&home));
    }

    #[cfg(unix)]
    #[test]
    fn links_and_dots_lead_to_the_same_lock() {
        let (home, target) = home();
        fs::write(&target, "film").expect("writable");
        let link = home.path().join("link");
        std::os::unix::fs::symlink(&target, &link).expect("links work");
        let _lock = TargetLock::acquire(&link).expect("free");
        assert!(lock_path(&target).exists());
        for name in [target.clone(), link, home.path().join(".").join("a.film")] {
            TargetLock::acquire(&name).expect_err("held");
        }
    }

    #[test]
    fn files_of_a_killed_process_are_no_obstacle() {
        let (home, target) = home();
        for left in ["", "lock file of", TITLE, &format!("{TITLE}process 1"), &format!("{TITLE}{}\n", own())] {
            fs::write(lock_path(&target), left).expect("writable");
            drop(TargetLock::acquire(&target).expect("it is free"));
            assert!(is_empty(&home));
        }
    }

    #[test]
    fn files_of_others_are_neither_locked_nor_removed() {
        let (_home, target) = home();
        let path = lock_path(&target);
        for content in ["mine", "lock file of something else", &"x".repeat(10_000)] {
            fs::write(&path, content).expect("writable");
            let message = TargetLock::acquire(&target).expect_err("not ours").to_string();
            assert!(message.contains("in the way") && message.contains("help:"), "{message}");
            assert_eq!(fs::read_to_string(&path).expect("there"), content);
        }
        fs::remove_file(&path).expect("there");
        fs::create_dir(&path).expect("free");
        TargetLock::acquire(&target).expect_err("a folder");
    }

    #[test]
    fn a_lock_file_that_was_replaced_belongs_to_whoever_did_it() {
        let (_home, target) = home();
        let lock = TargetLock::acquire(&target).expect("free");
        fs::remove_file(lock_path(&target)).expect("there");
        let second = TargetLock::acquire(&target).expect("the file is gone");
        drop(lock);
        assert!(lock_path(&target).exists(), "it is the second one's");
        TargetLock::acquire(&target).expect_err("held");
        drop(second);
        assert!(!lock_path(&target).exists());
    }

    #[test]
    fn a_file_system_without_locks_is_refused() {
        const NO_LOCKS: i32 = 37;
        let (home, target) = home();
        let acquire = || TargetLock::acquire(&target);
        let (result, met) = with_fault(Fault::EverAfter(NO_LOCKS), &[Operation::Lock], 0, acquire);
        assert_eq!(met, Some(Operation::Lock));
        let message = result.expect_err("no locks").to_string();
        assert!(message.contains("a.film.lock") && message.contains("advisory locks"), "{message}");
        assert!(is_empty(&home));
    }

    /// Many threads that request it at once, each removing the file when it is done: never two at a time.
    #[test]
    fn one_at_a_time_however_many_come_and_go() {
        use std::sync::atomic::{AtomicU32, Ordering};
        let (home, target) = home();
        let (inside, taken) = (AtomicU32::new(0), AtomicU32::new(0));
        std::thread::scope(|threads| {
            for _ in 0..4 {
                threads.spawn(|| {
                    for _ in 0..200 {
                        let Ok(lock) = TargetLock::acquire(&target) else { continue };
                        assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0, "two hold it");
                        taken.fetch_add(1, Ordering::SeqCst);
                        inside.fetch_sub(1, Ordering::SeqCst);
                        drop(lock);
                    }
                });
            }
        });
        assert!(taken.into_inner() > 0 && is_empty(&home));
    }
}
