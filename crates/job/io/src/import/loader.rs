//! Reads the files that a scene refers to: only inside the scene's folder, and only within the limits.

use crate::error::InputError;
use crate::input::{InputFiles, ReadFault, Role};
use base64::Engine as _;
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use std::cell::{Cell, RefCell};
use std::path::{Component, Path, PathBuf};

const GIB: u64 = 1 << 30;

/// Upper bounds that are checked *before* any data is read or memory is allocated, so that a small hostile file cannot
/// use all memory of the machine. Every default is far above the need of an inspection scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of one file or buffer; default 2 GiB.
    pub file_bytes: u64,
    /// Bytes of all files and buffers of a scene together; default 8 GiB.
    pub total_bytes: u64,
    /// Objects (`{`) in the JSON of a glTF file; default 4 million.
    pub json_objects: usize,
    /// Texels along one side of an image; default 32 768.
    pub image_side: u32,
    /// Bytes of one image during decoding, with channels that are not kept; default 1 GiB.
    pub image_bytes: u64,
    /// Bytes of the stored texels of all images of a scene together, with converted images and the environment; default
    /// 1 GiB. This is 21 images of 4096 x 4096 with three channels of 8 bits. Inspection scenes have fewer, and any
    /// machine that renders has this memory.
    pub total_image_bytes: u64,
    /// Bytes of all meshes and instances of a scene together; default 8 GiB.
    pub geometry_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            file_bytes: 2 * GIB,
            total_bytes: 8 * GIB,
            json_objects: 4_000_000,
            image_side: 32_768,
            image_bytes: GIB,
            total_image_bytes: GIB,
            geometry_bytes: 8 * GIB,
        }
    }
}

impl Limits {
    /// For reading the header of an image: the texel budget of all images checks the size in memory.
    pub(crate) fn of_header(&self) -> Self {
        Self { image_bytes: u64::MAX, ..*self }
    }
}

/// Reads the files that one scene file refers to.
#[derive(Debug)]
pub struct AssetLoader {
    scene_file: PathBuf,
    folder: PathBuf,
    limits: Limits,
    bytes_read: Cell<u64>,
    inputs: RefCell<InputFiles>,
}

impl AssetLoader {
    /// A loader for the files beside `scene_file`. It opens no file yet.
    pub fn new(scene_file: &Path, limits: Limits) -> Self {
        let folder = match scene_file.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
            _ => PathBuf::from("."),
        };
        Self {
            scene_file: scene_file.to_path_buf(),
            folder,
            limits,
            bytes_read: Cell::new(0),
            inputs: RefCell::default(),
        }
    }

    /// The scene file whose references are resolved.
    pub fn scene_file(&self) -> &Path {
        &self.scene_file
    }

    /// The limits.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The files that were read or requested.
    pub fn into_inputs(self) -> InputFiles {
        self.inputs.into_inner()
    }

    /// The scene file's own bytes.
    ///
    /// # Errors
    /// If it is missing, unreadable, not a regular file, or larger than the limits.
    pub fn read_scene(&self) -> Result<Vec<u8>, InputError> {
        self.read(&self.scene_file, Role::Scene, "the file", &self.scene_file.display().to_string())
    }

    /// The bytes of a file, named as in OBJ and MTL: a relative path, used literally except that a backslash separates
    /// folders like a slash.
    ///
    /// # Errors
    /// If the name is outside the scene's folder (absolute, drive letter, scheme, `..`, symbolic link), or the file is
    /// missing, not a regular file, or larger than the limits.
    pub fn load_relative(&self, name: &str, role: Role) -> Result<Vec<u8>, InputError> {
        self.load_inside(&self.inside(name)?, role, name)
    }

    /// The bytes of a URI reference as in glTF: a `data:` URI (base64 or percent-encoded), or a percent-encoded
    /// relative path.
    ///
    /// # Errors
    /// As [`load_relative`](Self::load_relative); also if a `data:` URI is malformed.
    pub fn load_uri(&self, uri: &str, role: Role) -> Result<Vec<u8>, InputError> {
        if starts_with_ignore_case(uri, "data:") {
            return self.load_data_uri(uri);
        }
        let decoded = percent_encoding::percent_decode_str(uri).decode_utf8();
        let decoded = decoded.map_err(|_| {
            self.refuse(uri, "the URI does not decode to UTF-8", "percent-encode the file name as UTF-8, or rename it")
        })?;
        let mut path = self.inside(&decoded)?;
        // Some exporters write names without encoding, so that a '%' in them is no escape.
        let exists = |path: &PathBuf| self.folder.join(path).exists();
        if !exists(&path) {
            path = self.inside(uri).ok().filter(exists).unwrap_or(path);
        }
        self.load_inside(&path, role, uri)
    }

    fn load_data_uri(&self, uri: &str) -> Result<Vec<u8>, InputError> {
        let shown: String = uri.chars().take(40).collect();
        let (head, payload) = uri
            .split_once(',')
            .ok_or_else(|| self.refuse(&shown, "the data URI has no comma", "write it as data:<type>;base64,<data>"))?;
        // Decoding never gives more bytes than characters.
        self.charge(payload.len() as u64, &shown)?;
        if !head.to_ascii_lowercase().ends_with(";base64") {
            return Ok(percent_encoding::percent_decode_str(payload).collect());
        }
        // Missing padding and stray bits at the end are common and harmless.
        let config = GeneralPurposeConfig::new()
            .with_decode_padding_mode(DecodePaddingMode::Indifferent)
            .with_decode_allow_trailing_bits(true);
        GeneralPurpose::new(&alphabet::STANDARD, config).decode(payload).map_err(|e| {
            self.refuse(&shown, &format!("the data URI is not valid base64: {e}"), "encode the data again as base64")
        })
    }

    /// Checks a reference lexically and returns it as a path relative to the scene's folder.
    fn inside(&self, name: &str) -> Result<PathBuf, InputError> {
        let outside = |why: &str| {
            self.refuse(
                name,
                &format!("{why}; only files inside the scene's folder are read"),
                "copy the file into the scene's folder and refer to it by a relative path",
            )
        };
        let slashes = name.replace('\\', "/");
        if slashes.trim().is_empty() || slashes.contains('\0') {
            return Err(self.refuse(name, "the reference to a file is empty", "name the file"));
        }
        if slashes.starts_with('/') {
            return Err(outside("the path is absolute"));
        }
        let first = slashes.split('/').next().unwrap_or_default();
        if let Some((scheme, _)) = first.split_once(':') {
            return Err(match scheme.len() {
                1 => outside("the path starts with a drive letter"),
                _ if slashes.contains("://") => outside("the reference is a URL"),
                _ => outside("the reference has a scheme"),
            });
        }
        let mut path = PathBuf::new();
        for component in Path::new(&slashes).components() {
            match component {
                Component::Normal(part) => path.push(part),
                Component::CurDir => {}
                Component::ParentDir if path.pop() => {}
                Component::ParentDir => return Err(outside("the path leads out of the scene's folder by '..'")),
                Component::RootDir | Component::Prefix(_) => return Err(outside("the path is absolute")),
            }
        }
        if path.as_os_str().is_empty() {
            return Err(self.refuse(name, "the reference names the folder itself", "name a file in it"));
        }
        Ok(path)
    }

    fn load_inside(&self, relative: &Path, role: Role, shown: &str) -> Result<Vec<u8>, InputError> {
        let path = self.folder.join(relative);
        self.inputs.borrow_mut().add(&path, role);
        let missing = |e: std::io::Error| {
            let fault = ReadFault::from(e);
            self.refuse(shown, &format!("{} {}", path.display(), fault.problem()), fault.help(&path))
        };
        let folder = self.folder.canonicalize().map_err(missing)?;
        let real = path.canonicalize().map_err(missing)?;
        if !real.starts_with(&folder) {
            return Err(self.refuse(
                shown,
                "a symbolic link leads out of the scene's folder; only files inside it are read",
                "replace the link by a copy of the file",
            ));
        }
        self.read(&real, role, &format!("reference \"{shown}\""), shown)
    }

    fn read(&self, path: &Path, role: Role, place: &str, shown: &str) -> Result<Vec<u8>, InputError> {
        let left = self.limits.total_bytes.saturating_sub(self.bytes_read.get());
        let most = left.min(self.limits.file_bytes);
        let read = self.inputs.borrow_mut().read(path, role, most);
        match read {
            Ok(bytes) => self.charge(bytes.len() as u64, shown).map(|()| bytes),
            // The error contains the limit.
            Err(ReadFault::TooLarge { .. }) => Err(self.too_large(left >= self.limits.file_bytes, shown)),
            Err(fault) => {
                let problem = match path == self.scene_file {
                    true => fault.problem(),
                    false => format!("{} {}", path.display(), fault.problem()),
                };
                Err(InputError::new(&self.scene_file, place, problem, fault.help(path)))
            }
        }
    }

    /// Counts `size` bytes against both limits.
    fn charge(&self, size: u64, shown: &str) -> Result<(), InputError> {
        let total = self.bytes_read.get().saturating_add(size);
        if size > self.limits.file_bytes || total > self.limits.total_bytes {
            return Err(self.too_large(size > self.limits.file_bytes, shown));
        }
        self.bytes_read.set(total);
        Ok(())
    }

    /// The error of an exceeded limit: of one file, or of all together.
    fn too_large(&self, is_of_one: bool, shown: &str) -> InputError {
        let problem = if is_of_one {
            format!("it has more than the {} allowed for one file", mib(self.limits.file_bytes))
        } else {
            format!("the scene's files exceed {} together", mib(self.limits.total_bytes))
        };
        self.refuse(shown, &problem, "split or shrink the file, or raise the import limits")
    }

    fn refuse(&self, reference: &str, problem: &str, help: &str) -> InputError {
        InputError::new(&self.scene_file, format!("reference \"{reference}\""), problem, help)
    }
}

fn mib(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / (1 << 20) as f64)
}

fn starts_with_ignore_case(text: &str, prefix: &str) -> bool {
    text.get(..prefix.len()).is_some_and(|head| head.eq_ignore_ascii_case(prefix))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tempfile::TempDir;

    fn folder() -> TempDir {
        let dir = tempfile::tempdir().expect("temporary folder");
        std::fs::create_dir(dir.path().join("scene")).expect("mkdir");
        std::fs::create_dir(dir.path().join("scene/sub")).expect("mkdir");
        for (name, text) in
            [("secret", "s"), ("scene/a b.bin", "ab"), ("scene/100%25.bin", "raw"), ("scene/sub/c.mtl", "c")]
        {
            std::fs::write(dir.path().join(name), text).expect("write");
        }
        dir
    }

    fn loader(dir: &TempDir) -> AssetLoader {
        AssetLoader::new(&dir.path().join("scene/scene.gltf"), Limits::default())
    }

    #[test]
    fn files_inside_the_folder_are_read() {
        let dir = folder();
        let l = loader(&dir);
        assert_eq!(l.load_uri("a%20b.bin", Role::Texture).expect("escaped"), b"ab");
        assert_eq!(l.load_uri("a b.bin", Role::Texture).expect("plain"), b"ab");
        assert_eq!(l.load_uri("100%25.bin", Role::Texture).expect("a name with a percent sign"), b"raw");
        assert_eq!(l.load_relative("sub\\c.mtl", Role::Texture).expect("backslash"), b"c");
        assert_eq!(l.load_relative("./sub/../sub/c.mtl", Role::Texture).expect("dots that stay inside"), b"c");
    }

    #[test]
    fn files_outside_the_folder_are_not_read() {
        let dir = folder();
        let l = loader(&dir);
        let absolute = dir.path().join("secret").display().to_string();
        let file_url = format!("file://{absolute}");
        for bad in [
            "../secret",
            "..\\secret",
            "sub/../../secret",
            "%2e%2e/secret",
            "..%2Fsecret",
            "C:\\secret",
            "c:secret",
            "\\\\host\\share",
            "http://host/x.bin",
            "",
            ".",
            "a\0b",
            &absolute,
            &file_url,
        ] {
            assert!(l.load_uri(bad, Role::Texture).is_err(), "{bad:?} was read as a URI");
            assert!(l.load_relative(bad, Role::Texture).is_err(), "{bad:?} was read as a name");
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_out_of_the_folder_are_refused_and_links_within_followed() {
        let dir = folder();
        let at = |name: &str| dir.path().join(name);
        std::os::unix::fs::symlink(at("secret"), at("scene/link.bin")).expect("symlink");
        std::os::unix::fs::symlink(at("scene/sub"), at("scene/again")).expect("symlink");
        let l = loader(&dir);
        let e = l.load_uri("link.bin", Role::Texture).expect_err("a link that leads out");
        assert!(e.problem.contains("symbolic link"), "{e}");
        assert_eq!(l.load_uri("again/c.mtl", Role::Texture).expect("a link that stays"), b"c");
    }

    #[test]
    fn data_uris_decode_with_and_without_padding() {
        let dir = folder();
        let l = loader(&dir);
        assert_eq!(
            l.load_uri("data:application/octet-stream;base64,AQID/w==", Role::Texture).expect("padded"),
            [1, 2, 3, 255]
        );
        assert_eq!(l.load_uri("data:;base64,AQID/w", Role::Texture).expect("bare"), [1, 2, 3, 255]);
        assert_eq!(l.load_uri("DATA:;base64,AQID", Role::Texture).expect("capitals"), [1, 2, 3]);
        assert_eq!(l.load_uri("data:,a%00b", Role::Texture).expect("percent-encoded"), b"a\0b");
        assert!(l.load_uri("data:;base64", Role::Texture).is_err());
        assert!(l.load_uri("data:;base64,!!!!", Role::Texture).is_err());
    }

    #[test]
    fn limits_hold_for_one_file_and_for_all() {
        let dir = folder();
        let limits = Limits { file_bytes: 2, total_bytes: 5, ..Limits::default() };
        let l = AssetLoader::new(&dir.path().join("scene/scene.gltf"), limits);
        assert!(l.load_uri("100%25.bin", Role::Texture).is_err(), "three bytes where two are allowed");
        assert!(l.load_uri("data:,abc", Role::Texture).is_err(), "three bytes where two are allowed");
        assert!(l.load_uri("a b.bin", Role::Texture).is_ok());
        assert!(l.load_uri("a b.bin", Role::Texture).is_ok());
        assert!(l.load_uri("a b.bin", Role::Texture).is_err(), "six bytes where five are allowed");
    }

    #[test]
    fn folders_are_not_files() {
        let dir = folder();
        let e = loader(&dir).load_uri("sub", Role::Texture).expect_err("a folder");
        assert!(e.problem.contains("folder"), "{e}");
    }
}
