//! Changed results of a tiny bench, which the bench reads back for its report: values of its records, planes of its images.
//!
//! Each mutation chooses a file of the finished bench; the folder is as it was before the next input.
#![no_main]

use dunkelfeld_io::exr::{Channel, ExrLayers, read_exr, write_exr};
use dunkelfeld::{DenoiseMethod, Project, Session};
use dunkelfeld_fuzz::bases::{Container, assets};
use dunkelfeld_fuzz::tree::{extreme_number, mutate_value};
use dunkelfeld_fuzz::{Scratch, target};
use dunkelfeld_studies::bench::{BenchSettings, bench};
use libfuzzer_sys::arbitrary::{Result, Unstructured};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// The finished bench: its folder, and its files with their contents.
struct Finished {
    scratch: Scratch,
    files: Vec<(PathBuf, Vec<u8>)>,
}

static FINISHED: LazyLock<Finished> = LazyLock::new(|| {
    let scratch = Scratch::new();
    // The first asset has lights and a camera.
    scratch.write("scene.glb", &assets()[0].encode(Container::Glb));
    report(&scratch).expect("a bench");
    let units = std::fs::read_dir(scratch.path("bench/units")).expect("its results");
    let mut files: Vec<_> = units
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|e| e == "json" || e == "exr"))
        .map(|path| (path.clone(), std::fs::read(path).expect("a file")))
        .collect();
    files.sort();
    Finished { scratch, files }
});

/// More mutations than this are not made of one input.
const MOST: usize = 6;

target!(init: LazyLock::force(&FINISHED), |data| {
    let mut u = Unstructured::new(data);
    let finished = &*FINISHED;
    let mut changed = Vec::new();
    for _ in 0..MOST {
        let Ok(choice) = u.arbitrary::<u8>() else { break };
        let Some(file) = finished.files.get(usize::from(choice) % finished.files.len()) else { break };
        if u.is_empty() || change(&mut u, &file.0).is_err() {
            break;
        }
        changed.push(file);
    }
    if let Err(e) = report(&finished.scratch) {
        drop(e.to_string());
    }
    for (path, bytes) in changed {
        std::fs::write(path, bytes).expect("writable");
    }
});

/// A bench of 4 x 3 pixels; what is finished is read back.
fn report(scratch: &Scratch) -> std::result::Result<(), dunkelfeld::Error> {
    let input = scratch.path("scene.glb");
    let mut project = Project::open(&input)?;
    (project.settings.width, project.settings.height, project.settings.run.threads) = (4, 3, 1);
    let quick = BenchSettings::default().with_quick(true).with_seeds(4).with_reference_spp(4).with_effects(Vec::new());
    let settings = quick.with_spp(vec![2, 4]).with_denoise(vec![DenoiseMethod::Off]);
    bench(project, &input, &settings, &scratch.path("bench"), true, false, &Session::new(1)?).map(drop)
}

fn change(u: &mut Unstructured<'_>, path: &Path) -> Result<()> {
    let is_image = path.extension().is_some_and(|e| e == "exr");
    if u.arbitrary::<u8>()? < 16 {
        // Any bytes, as a program that was killed or a disk may leave them.
        let length = usize::from(u.arbitrary::<u8>()?);
        let bytes = u.bytes(length.min(u.len()))?;
        std::fs::write(path, bytes).expect("writable");
    } else if is_image {
        if let Ok(mut layers) = read_exr(path) {
            change_layers(u, &mut layers)?;
            drop(write_exr(path, layers));
        }
    } else if let Some(mut record) = std::fs::read(path).ok().and_then(|text| serde_json::from_slice(&text).ok()) {
        mutate_value(u, &mut record, &["seed", "spp", "samples", "seconds", "render", "expose", "size"])?;
        std::fs::write(path, record.to_string()).expect("writable");
    }
    Ok(())
}

fn change_layers(u: &mut Unstructured<'_>, layers: &mut ExrLayers) -> Result<()> {
    match u.arbitrary::<u8>()? % 4 {
        0 => {
            (layers.width, layers.height) = (u.int_in_range(1..=6)?, u.int_in_range(1..=6)?);
            let pixels = (layers.width * layers.height) as usize;
            for (_, channel) in &mut layers.channels {
                match channel {
                    Channel::F32(values) => values.resize(pixels, 0.5),
                    Channel::U32(values) => values.resize(pixels, 5),
                }
            }
        }
        1 if layers.channels.len() > 1 => drop(layers.channels.remove(0)),
        _ => {
            let (at, value) = (u.arbitrary::<u8>()?, extreme_number(u)?);
            for (_, channel) in &mut layers.channels {
                match channel {
                    Channel::F32(values) => {
                        let i = usize::from(at) % values.len().max(1);
                        values[i] = if at % 7 == 0 { f32::NAN } else { value as f32 };
                    }
                    Channel::U32(values) => {
                        let i = usize::from(at) % values.len().max(1);
                        values[i] = value as u32;
                    }
                }
            }
        }
    }
    Ok(())
}
