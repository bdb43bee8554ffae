//! The one module that opens files for reading: every file is checked, bounded and recorded here.
//!
//! Only regular files are read. Their type is checked before they are opened, because opening a named pipe can block,
//! and again on the open handle, because another file may have replaced the name in between. The number of bytes is
//! limited, also if the file grows or has no length. Each file is recorded in an [`InputFiles`], so that no output
//! replaces it later.

use crate::error::InputError;
use crate::partial::resolved;
pub use crate::role::Role;
use std::fs::{File, Metadata, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// The limit of a file that is read in pieces, a checkpoint or a render \[bytes\]: more than the largest film needs.
pub const MAX_STREAMED: u64 = 64 << 30;
/// The depth of nested result folders: folders of results contain folders of results, and these contain none.
const RESULT_DEPTH: u32 = 1;

/// The identity of a file from the file system: two identities are of one file if a name, a resolved name, or device
/// and inode agree.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileIdentity {
    named: PathBuf,
    /// The canonical folder with the name itself, which may be a link.
    place: Option<PathBuf>,
    /// The target of links; `None` if there is no file.
    target: Option<PathBuf>,
    /// Device and inode; `None` if there is no file, or on systems without.
    id: Option<(u64, u64)>,
}

/// One key of a file's identity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FileKey<'a> {
    /// A path: as given, or resolved.
    Path(&'a Path),
    /// Device and inode.
    Inode(u64, u64),
}

impl FileIdentity {
    /// The identity of the present or future file of this name.
    pub fn from_path(path: &Path) -> Self {
        Self::with_metadata(path, std::fs::metadata(path).ok().as_ref())
    }

    fn with_metadata(path: &Path, metadata: Option<&Metadata>) -> Self {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let place = folder.canonicalize().ok().zip(path.file_name()).map(|(folder, name)| folder.join(name));
        Self { named: path.to_path_buf(), place, target: Some(resolved(path)), id: metadata.and_then(id_of) }
    }

    /// The path as given.
    pub fn path(&self) -> &Path {
        &self.named
    }

    /// The keys of the file: two identities that share a key are of one file.
    pub fn keys(&self) -> impl Iterator<Item = FileKey<'_>> {
        let paths = [Some(&self.named), self.place.as_ref(), self.target.as_ref()];
        let id = self.id.map(|(device, inode)| FileKey::Inode(device, inode));
        paths.into_iter().flatten().map(|path| FileKey::Path(path)).chain(id)
    }

    /// Are both the same file?
    pub fn is_same(&self, other: &Self) -> bool {
        self.keys().any(|key| other.keys().any(|k| k == key))
    }

    /// Is the file, or the link to it, in a folder or in one within it? `folder` is canonical.
    pub fn is_within(&self, folder: &Path) -> bool {
        [&self.place, &self.target].into_iter().flatten().any(|path| path.starts_with(folder))
    }
}

#[cfg(unix)]
fn id_of(metadata: &Metadata) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    Some((metadata.dev(), metadata.ino()))
}

#[cfg(not(unix))]
fn id_of(_: &Metadata) -> Option<(u64, u64)> {
    None
}

/// A file that was read, or was to be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputFile {
    /// Its use.
    pub role: Role,
    /// The identity of the file.
    pub identity: FileIdentity,
}

/// The files that a run reads, in the order in which they were opened or named.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct InputFiles {
    files: Vec<InputFile>,
}

impl InputFiles {
    /// Records a library as an input, if its path is that of a file.
    pub fn add_library(&mut self, path: Option<&Path>) {
        if let Some(path) = path.filter(|path| path.is_file()) {
            self.add(path, Role::Library);
        }
    }

    /// An empty list.
    pub fn new() -> Self {
        Self::default()
    }

    /// Records a file that another file refers to, readable or not.
    pub fn add(&mut self, path: &Path, role: Role) {
        self.push(InputFile { role, identity: FileIdentity::from_path(path) });
    }

    /// Adds the files of another list.
    pub fn extend(&mut self, others: &Self) {
        others.files.iter().for_each(|file| self.push(file.clone()));
    }

    fn push(&mut self, file: InputFile) {
        if !self.files.contains(&file) {
            self.files.push(file);
        }
    }

    /// All files.
    pub fn iter(&self) -> std::slice::Iter<'_, InputFile> {
        self.files.iter()
    }

    /// The first that is the same file.
    pub fn find(&self, file: &FileIdentity) -> Option<&InputFile> {
        self.files.iter().find(|f| f.identity.is_same(file))
    }

    /// The first file in a folder or in one within it, or with another name there.
    pub fn find_within(&self, folder: &Path) -> Option<&InputFile> {
        let folder = folder.canonicalize().ok()?;
        let named = self.files.iter().find(|f| f.identity.is_within(&folder));
        named.or_else(|| self.find_among(&folder))
    }

    /// The first file that is also in a folder of results, or in a folder in it, under another name. No command writes
    /// deeper. Links to folders are not followed.
    fn find_among(&self, folder: &Path) -> Option<&InputFile> {
        if self.files.is_empty() {
            return None;
        }
        let mut folders = vec![(folder.to_path_buf(), 0)];
        while let Some((folder, depth)) = folders.pop() {
            for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
                match entry.file_type() {
                    Ok(kind) if kind.is_dir() && depth < RESULT_DEPTH => folders.push((entry.path(), depth + 1)),
                    Ok(kind) if kind.is_dir() => {}
                    Ok(_) => {
                        if let Some(found) = self.find(&FileIdentity::from_path(&entry.path())) {
                            return Some(found);
                        }
                    }
                    Err(_) => {}
                }
            }
        }
        None
    }

    /// Opens a file that is read in pieces.
    ///
    /// # Errors
    /// It is missing, unreadable, not a regular file, or longer than `most` bytes.
    pub fn open(&mut self, path: &Path, role: Role, most: u64) -> Result<OpenFile, ReadFault> {
        let opened = open(path);
        let metadata = opened.as_ref().ok().map(|(_, metadata)| metadata);
        let identity = match metadata {
            Some(metadata) => FileIdentity::with_metadata(path, Some(metadata)),
            None => FileIdentity::from_path(path),
        };
        self.push(InputFile { role, identity });
        let (file, metadata) = opened?;
        let length = metadata.len();
        if length > most {
            return Err(ReadFault::TooLarge { most });
        }
        Ok(OpenFile { file, length, position: 0 })
    }

    /// Reads a whole file.
    ///
    /// # Errors
    /// As [`open`](Self::open); also if it has more than `most` bytes in total, or there is not enough memory for them.
    pub fn read(&mut self, path: &Path, role: Role, most: u64) -> Result<Vec<u8>, ReadFault> {
        let OpenFile { file, length, .. } = self.open(path, role, most)?;
        let mut bytes = Vec::new();
        let expected = usize::try_from(length).map_err(|_| ReadFault::NoMemory)?;
        bytes.try_reserve_exact(expected).map_err(|_| ReadFault::NoMemory)?;
        // One more byte shows that the file exceeds the limit.
        file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > most {
            return Err(ReadFault::TooLarge { most });
        }
        Ok(bytes)
    }
}

impl<'a> IntoIterator for &'a InputFiles {
    type Item = &'a InputFile;
    type IntoIter = std::slice::Iter<'a, InputFile>;

    fn into_iter(self) -> Self::IntoIter {
        self.files.iter()
    }
}

/// The reason for a file that was not read.
#[derive(Debug)]
pub enum ReadFault {
    /// There is no file of that name.
    Missing,
    /// The permissions forbid it.
    NotPermitted,
    /// It is not a regular file but this.
    NotRegular(&'static str),
    /// The name belonged to another file shortly before.
    Replaced,
    /// It is longer than the limit.
    TooLarge {
        /// The limit \[bytes\].
        most: u64,
    },
    /// There is not enough memory for it.
    NoMemory,
    /// Another error of the system.
    Failed(io::Error),
}

impl From<io::Error> for ReadFault {
    fn from(e: io::Error) -> Self {
        match e.kind() {
            io::ErrorKind::NotFound => Self::Missing,
            io::ErrorKind::PermissionDenied => Self::NotPermitted,
            io::ErrorKind::OutOfMemory => Self::NoMemory,
            _ => Self::Failed(e),
        }
    }
}

impl ReadFault {
    /// The problem, as the continuation of the file's name: `is a folder, not a regular file`. Without a full stop.
    pub fn problem(&self) -> String {
        match self {
            Self::Missing => "cannot be read: there is no file of this name".into(),
            Self::NotPermitted => "cannot be read: its permissions forbid it".into(),
            Self::NotRegular(what) => format!("is {what}, not a regular file"),
            Self::Replaced => "was replaced while it was opened".into(),
            Self::TooLarge { most } => format!("has more than the {} allowed", in_units(*most)),
            Self::NoMemory => "needs more memory than there is".into(),
            Self::Failed(e) => format!("cannot be read: {e}"),
        }
    }

    /// The help about this file: a correction by the user, without a full stop.
    pub fn help(&self, file: &Path) -> &'static str {
        let name = file.to_string_lossy();
        match self {
            Self::Missing if name.contains(char::is_control) => {
                "the name has a control character; in \"double quotes\" of TOML a back slash begins an escape: write `/` \
                 or put the name in 'single quotes'"
            }
            Self::Missing if cfg!(not(windows)) && name.contains('\\') => {
                "write `/` between folders; here a back slash (`\\`) is a character of the name"
            }
            Self::Missing => "check the name, upper and lower case included",
            Self::NotPermitted => "change the file's permissions",
            Self::NotRegular(_) => "name a regular file",
            Self::Replaced => "run the command again",
            Self::TooLarge { .. } => "check that this is the right file",
            Self::NoMemory => "free memory, or use a smaller file",
            Self::Failed(_) => "check that it is a readable file",
        }
    }

    /// The fault as an error of `file` itself.
    pub fn at(&self, file: &Path) -> InputError {
        InputError::of_file(file, self.problem(), self.help(file))
    }
}

fn in_units(bytes: u64) -> String {
    match bytes {
        n if n >= 1 << 30 => format!("{:.3} GiB", n as f64 / (1u64 << 30) as f64).replace(".000", ""),
        n if n >= 1 << 20 => format!("{:.1} MiB", n as f64 / (1u64 << 20) as f64).replace(".0", ""),
        n => format!("{n} bytes"),
    }
}

/// An open regular file. Reading ends at the length that it had when it was opened.
#[derive(Debug)]
pub struct OpenFile {
    file: File,
    length: u64,
    position: u64,
}

impl OpenFile {
    /// Its length when it was opened \[bytes\].
    pub fn length(&self) -> u64 {
        self.length
    }
}

impl Read for OpenFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = self.length.saturating_sub(self.position);
        let count = usize::try_from(left).map_or(buffer.len(), |left| buffer.len().min(left));
        let done = self.file.read(buffer.get_mut(..count).unwrap_or_default())?;
        self.position += done as u64;
        Ok(done)
    }
}

impl Seek for OpenFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let to = match to {
            SeekFrom::End(offset) => {
                let position = self.length.checked_add_signed(offset);
                SeekFrom::Start(position.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?)
            }
            other => other,
        };
        self.position = self.file.seek(to)?;
        Ok(self.position)
    }
}

/// Opens a regular file, and never waits for another process.
fn open(path: &Path) -> Result<(File, Metadata), ReadFault> {
    let before = std::fs::metadata(path)?;
    regular(&before)?;
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt;
        // Without effect on regular files. A pipe that replaced the name meanwhile does not block.
        options.custom_flags(rustix::fs::OFlags::NONBLOCK.bits().cast_signed());
    }
    let file = options.open(path)?;
    let metadata = file.metadata()?;
    regular(&metadata)?;
    if id_of(&before) != id_of(&metadata) {
        return Err(ReadFault::Replaced);
    }
    Ok((file, metadata))
}

fn regular(metadata: &Metadata) -> Result<(), ReadFault> {
    match other_kind(metadata) {
        None => Ok(()),
        Some(what) => Err(ReadFault::NotRegular(what)),
    }
}

/// The kind of a file that is not regular. `None` for regular ones.
pub fn other_kind(metadata: &Metadata) -> Option<&'static str> {
    if metadata.is_file() {
        return None;
    }
    if metadata.is_dir() {
        return Some("a folder");
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        let kind = metadata.file_type();
        if kind.is_fifo() {
            return Some("a named pipe");
        }
        if kind.is_socket() {
            return Some("a socket");
        }
        if kind.is_char_device() || kind.is_block_device() {
            return Some("a device");
        }
    }
    Some("something else")
}

/// The files of a folder, by name; none if it cannot be listed.
pub fn files_in(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries.map(|e| e.path()).filter(|path| !path.is_dir()).collect();
    files.sort_unstable();
    files
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(path: &Path, most: u64) -> Result<Vec<u8>, ReadFault> {
        InputFiles::new().read(path, Role::Scene, most)
    }

    fn problem(path: &Path, most: u64) -> String {
        read(path, most).expect_err("refused").problem()
    }

    #[test]
    fn limits_hold_for_the_length_and_for_what_is_read() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a");
        std::fs::write(&path, [7; 100]).expect("writable");
        assert_eq!(read(&path, 100).expect("as much as allowed").len(), 100);
        assert!(problem(&path, 99).contains("more than the 99 bytes"));
        let sparse = folder.path().join("sparse");
        File::create(&sparse).and_then(|f| f.set_len(1 << 40)).expect("a sparse file");
        assert!(problem(&sparse, 3 << 30).contains("more than the 3 GiB"));
        let mut inputs = InputFiles::new();
        assert!(inputs.open(&sparse, Role::Checkpoint, MAX_STREAMED).is_err());
        assert_eq!(inputs.iter().count(), 1, "what is refused counts too");
    }

    #[test]
    fn a_file_that_grows_ends_where_it_ended_when_it_was_opened() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a");
        std::fs::write(&path, b"0123456789").expect("writable");
        let mut file = InputFiles::new().open(&path, Role::Checkpoint, 10).expect("readable");
        std::fs::write(&path, [b'x'; 1000]).expect("writable");
        assert_eq!(file.length(), 10);
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).expect("readable");
        assert_eq!(bytes.len(), 10);
        assert_eq!(file.seek(SeekFrom::End(-4)).expect("inside"), 6);
        bytes.clear();
        file.read_to_end(&mut bytes).expect("readable");
        assert_eq!(bytes.len(), 4);
        assert_eq!(file.seek(SeekFrom::Start(500)).expect("beyond the end"), 500);
        assert_eq!(file.read(&mut [0; 8]).expect("the end"), 0);
    }

    #[test]
    fn a_missing_file_and_a_folder_are_named_as_such() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        assert!(problem(&folder.path().join("none"), 9).contains("there is no file"));
        assert!(problem(folder.path(), 9).contains("is a folder"));
    }

    #[test]
    fn names_of_one_file_are_the_same_and_those_of_two_are_not() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("a.png"), "a").expect("writable");
        std::fs::write(at("b.png"), "a").expect("writable");
        std::fs::create_dir(at("sub")).expect("writable");
        let mut inputs = InputFiles::new();
        inputs.add(&at("a.png"), Role::Texture);
        inputs.add(&at("missing.png"), Role::Texture);
        let finds = |name: &str| inputs.find(&FileIdentity::from_path(&at(name))).is_some();
        for same in ["a.png", "./a.png", "sub/../a.png", "missing.png", "sub/../missing.png"] {
            assert!(finds(same), "{same}");
        }
        for other in ["b.png", "A.PNG", "sub/a.png", "c.png"] {
            assert!(!finds(other), "{other}");
        }
        assert!(inputs.find_within(folder.path()).is_some());
        assert!(inputs.find_within(&at("sub")).is_none());
    }

    #[cfg(unix)]
    mod unix {
        use super::*;
        use std::os::unix::fs::symlink;
        use std::os::unix::net::UnixListener;

        fn pipe(path: &Path) {
            let made = std::process::Command::new("mkfifo").arg(path).status().expect("mkfifo is at hand");
            assert!(made.success());
        }

        #[test]
        fn irregular_files_are_refused_at_once_also_through_links() {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let at = |name: &str| folder.path().join(name);
            pipe(&at("pipe"));
            symlink("/dev/zero", at("zero")).expect("links work");
            let _socket = UnixListener::bind(at("socket")).expect("a socket");
            for name in ["pipe", "socket"] {
                symlink(at(name), at(&format!("{name}-link"))).expect("links work");
            }
            for (name, what) in [
                ("pipe", "a named pipe"),
                ("pipe-link", "a named pipe"),
                ("zero", "a device"),
                ("socket", "a socket"),
                ("socket-link", "a socket"),
            ] {
                assert!(problem(&at(name), u64::MAX).contains(what), "{name}");
            }
            assert!(problem(Path::new("/dev/zero"), u64::MAX).contains("a device"));
        }

        /// Files of the process file system have contents, and a length of zero.
        #[test]
        fn a_file_that_states_no_length_is_read_up_to_the_limit() {
            let path = Path::new("/proc/self/maps");
            if path.exists() {
                assert!(!read(path, 1 << 24).expect("readable").is_empty());
                assert!(matches!(read(path, 16), Err(ReadFault::TooLarge { most: 16 })));
            }
        }

        #[test]
        fn links_and_hard_links_are_the_file_itself() {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let at = |name: &str| folder.path().join(name);
            std::fs::write(at("a.png"), "a").expect("writable");
            for name in ["sub", "deep"] {
                std::fs::create_dir(at(name)).expect("writable");
            }
            symlink(at("a.png"), at("link.png")).expect("links work");
            symlink(folder.path(), at("sub/up")).expect("links work");
            std::fs::hard_link(at("a.png"), at("deep/hard.png")).expect("hard links work");
            let same = |a: &str, b: &str| FileIdentity::from_path(&at(a)).is_same(&FileIdentity::from_path(&at(b)));
            for name in ["link.png", "sub/up/a.png", "deep/hard.png"] {
                assert!(same("a.png", name) && same(name, "a.png"), "{name}");
            }
            assert!(same("none.png", "sub/up/none.png"), "through a folder's link");
            let mut inputs = InputFiles::new();
            inputs.read(&at("a.png"), Role::Texture, 9).expect("readable");
            assert!(inputs.find_within(&at("deep")).is_some(), "a hard link in a folder");
            assert!(inputs.find_within(&at("sub")).is_none(), "links to folders are not followed");
        }
    }
}
