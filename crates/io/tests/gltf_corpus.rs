//! Walks every glTF file below the folder that `DUNKELFELD_CORPUS` names: each loads or ends in one clear error, within a
//! time limit. Without the variable there is nothing to do.
#![allow(clippy::print_stdout, reason = "the list of files is what this test is run for")]

use dunkelfeld_io::import::{ImportOptions, load_scene};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

fn gltf_files(folder: &Path, found: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|e| e.path()) {
        if path.is_dir() {
            gltf_files(&path, found);
        } else if path.extension().is_some_and(|e| e == "gltf" || e == "glb") {
            found.push(path);
        }
    }
}

#[test]
fn every_file_of_the_corpus_loads_or_is_refused_clearly() {
    let Some(corpus) = std::env::var_os("DUNKELFELD_CORPUS") else { return };
    let mut files = Vec::new();
    gltf_files(Path::new(&corpus), &mut files);
    files.sort();
    assert!(!files.is_empty(), "no glTF files below {}", corpus.display());
    let (mut loaded, mut refused) = (0, 0);
    for file in &files {
        let start = Instant::now();
        let name = file.strip_prefix(&corpus).unwrap_or(file).display();
        match load_scene(file, &ImportOptions::default()) {
            Ok(imported) => {
                loaded += 1;
                let triangles: usize = imported.scene.meshes.iter().map(|m| m.mesh.triangles.len()).sum();
                let instances = imported.scene.instances.len();
                println!("loaded  {name}: {instances} instances, {triangles} triangles");
                imported.warnings.iter().for_each(|w| println!("          warning: {w}"));
            }
            Err(e) => {
                refused += 1;
                println!("refused {name}: {e}\n{}", e.caret());
                let complete = !e.place.is_empty() && !e.problem.is_empty() && !e.mend.is_empty();
                assert!(complete, "{name}: the error does not name place, problem and mend: {e:?}");
            }
        }
        assert!(start.elapsed() < Duration::from_secs(20), "{name} took {:?}", start.elapsed());
    }
    println!("{loaded} loaded, {refused} refused, 0 panicked");
}
