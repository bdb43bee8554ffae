//! Odd and broken scene files: each loads or ends in one clear error; none panics, hangs or exhausts the memory.
//!
//! The files are other projects' and no part of this repository. `DUNKELFELD_CORPUS` names the folder they lie in; every
//! `.obj`, `.gltf` and `.glb` below it is read:
//!
//! ```text
//! DUNKELFELD_CORPUS=... cargo test -p dunkelfeld-io --test it corpus -- --nocapture
//! ```
//!
//! The scenes that the repository does ship are read in any case, and must all load.

#![allow(clippy::print_stdout, reason = "the test prints its counts")]

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Duration;

use dunkelfeld_io::import::{ImportOptions, load_scene};

/// Nothing in a corpus of a few megabytes takes a hundredth of this; what takes all of it hangs.
const PATIENCE: Duration = Duration::from_secs(60);
/// Peak memory of the whole test [kB].
const MEMORY: u64 = 1024 * 1024;

/// How reading a file ended.
enum Outcome {
    /// So many triangles, so many warnings.
    Loaded(usize, usize),
    /// Refused, with the message.
    Refused(String),
    /// The reader broke down, with its message.
    Broke(String),
}

fn read(path: &Path) -> Outcome {
    let (answer, inbox) = mpsc::channel();
    let owned = path.to_owned();
    // A thread of its own: a reader that never returns is abandoned, and the test continues.
    std::thread::spawn(move || {
        let result = catch_unwind(AssertUnwindSafe(|| load_scene(&owned, &ImportOptions::default())));
        let outcome = match result {
            Ok(Ok(imported)) => {
                let triangles = imported.scene.meshes.iter().map(|m| m.mesh.triangles.len()).sum();
                Outcome::Loaded(triangles, imported.warnings.len())
            }
            Ok(Err(error)) => {
                let silent = [&error.place, &error.problem, &error.help].iter().any(|part| part.trim().is_empty());
                let message = error.to_string();
                if silent {
                    Outcome::Broke(format!("an error without place or help: {message}"))
                } else {
                    Outcome::Refused(message)
                }
            }
            Err(panic) => {
                let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
                let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
                Outcome::Broke(format!("panicked: {}", text.unwrap_or_default()))
            }
        };
        // The receiver is gone after the time limit.
        let _ = answer.send(outcome);
    });
    inbox.recv_timeout(PATIENCE).unwrap_or_else(|_| Outcome::Broke(format!("no answer after {PATIENCE:?}")))
}

/// Scene files below a folder, in a fixed order. Symbolic links are not followed.
fn scene_files(folder: &Path) -> Vec<PathBuf> {
    let (mut found, mut folders) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(folder) = folders.pop() {
        let entries = std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
        for entry in entries.flatten() {
            let path = entry.path();
            let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => folders.push(path),
                Ok(kind) if kind.is_file() && ["obj", "gltf", "glb"].contains(&extension.as_str()) => found.push(path),
                _ => {}
            }
        }
    }
    found.sort();
    found
}

/// Peak resident memory of this process [kB], if the system provides it.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    line.trim().trim_end_matches("kB").trim().parse().ok()
}

#[test]
fn every_file_of_the_corpus_loads_or_is_refused_with_a_reason() {
    let Some(folder) = std::env::var_os("DUNKELFELD_CORPUS") else {
        println!("DUNKELFELD_CORPUS is not set: no corpus to read");
        return;
    };
    let folder = PathBuf::from(folder);
    let files = scene_files(&folder);
    assert!(!files.is_empty(), "no scene files below {}", folder.display());
    let (mut loaded, mut repaired, mut refused, mut broke) = (0, 0, 0, Vec::new());
    for path in &files {
        let name = path.strip_prefix(&folder).unwrap_or(path).display();
        match read(path) {
            Outcome::Loaded(_, warnings) => {
                loaded += 1;
                repaired += usize::from(warnings > 0);
            }
            Outcome::Refused(message) => {
                refused += 1;
                let text = message.replace(&format!("{}: ", path.display()), "").replace('\n', " ");
                println!("refused  {name}: {text}");
            }
            Outcome::Broke(what) => {
                println!("PANICKED {name}: {what}");
                broke.push(name.to_string());
            }
        }
    }
    let memory = peak_memory();
    println!(
        "corpus: {} files; loaded {loaded} ({repaired} of them with warnings), refused {refused}, panicked {}; peak memory {}",
        files.len(),
        broke.len(),
        memory.map_or("unknown".to_owned(), |kb| format!("{} MB", kb / 1024)),
    );
    assert!(broke.is_empty(), "panicked, hung or gave an error without place or help: {broke:?}");
    assert!(memory.is_none_or(|kb| kb < MEMORY), "{memory:?} kB of memory, more than {MEMORY}");
}

#[test]
fn the_shipped_scenes_load() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../scenes");
    let files = scene_files(&folder);
    assert!(!files.is_empty(), "no scenes below {}", folder.display());
    for path in files {
        match read(&path) {
            Outcome::Loaded(triangles, _) => assert!(triangles > 0, "{} is empty", path.display()),
            Outcome::Refused(why) | Outcome::Broke(why) => panic!("{}: {why}", path.display()),
        }
    }
}
