//! Every OBJ file of a corpus loads or is refused with a reason; none panics. The folder comes from
//! `DUNKELFELD_CORPUS`; without it there is nothing to do.

use dunkelfeld_io::import::ImportOptions;
use dunkelfeld_io::obj::load_obj;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

fn obj_files(folder: &Path, found: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for path in entries.filter_map(|e| Some(e.ok()?.path())) {
        if path.is_dir() {
            obj_files(&path, found);
        } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj")) {
            found.push(path);
        }
    }
}

#[test]
fn the_corpus_is_read_or_refused() {
    let Some(folder) = std::env::var_os("DUNKELFELD_CORPUS") else {
        println!("DUNKELFELD_CORPUS is not set; nothing to read");
        return;
    };
    let mut files = Vec::new();
    obj_files(Path::new(&folder), &mut files);
    files.sort();
    assert!(!files.is_empty(), "no OBJ file in {}", Path::new(&folder).display());
    let (mut loaded, mut refused, mut failures) = (0, 0, Vec::new());
    for path in &files {
        let outcome = catch_unwind(AssertUnwindSafe(|| load_obj(path, &ImportOptions::default())));
        let name = path.strip_prefix(&folder).unwrap_or(path).display();
        match outcome {
            Ok(Ok(imported)) => {
                loaded += 1;
                let triangles: usize = imported.scene.meshes.iter().map(|m| m.mesh.triangles.len()).sum();
                let objects = imported.scene.instances.len();
                println!(
                    "loaded  {name}: {triangles} triangles, {objects} objects, {} materials, {} images",
                    imported.scene.materials.len(),
                    imported.scene.images.len()
                );
                imported.warnings.iter().for_each(|w| println!("          {w}"));
            }
            Ok(Err(error)) => {
                refused += 1;
                println!("refused {name}: {}", error.problem);
            }
            Err(_) => failures.push(format!("{name} panicked")),
        }
    }
    println!("OBJ corpus: {loaded} loaded, {refused} refused, {} failed", failures.len());
    assert!(failures.is_empty(), "{failures:#?}");
}
