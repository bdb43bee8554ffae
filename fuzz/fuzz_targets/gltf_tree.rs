//! Mutations of small valid glTF assets, JSON and buffer together: read and built, or refused.
//!
//! The first byte chooses asset and container, each further one whether the document or the buffer is changed.
#![no_main]

use dunkelfeld_fuzz::bases::{Asset, Container, WORDS, assets};
use dunkelfeld_fuzz::tree::{mutate_buffer, mutate_value};
use dunkelfeld_fuzz::{Scratch, build, options, target};
use libfuzzer_sys::arbitrary::{Result, Unstructured};
use std::path::PathBuf;
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);
static ASSETS: LazyLock<Vec<Asset>> = LazyLock::new(|| {
    let assets = assets();
    for (i, asset) in assets.iter().enumerate() {
        let loaded = dunkelfeld_io::gltf::load_gltf(&write(asset, Container::Glb), &options());
        let warnings = loaded.unwrap_or_else(|e| panic!("asset {i} is refused: {e}")).warnings;
        eprintln!("asset {i}: {} warnings", warnings.len());
        warnings.iter().for_each(|w| eprintln!("  {w}"));
    }
    assets
});

/// More mutations than this are not made of one input.
const MOST: usize = 32;

target!(|data| {
    let mut u = Unstructured::new(data);
    let choice = u.arbitrary::<u8>().unwrap_or_default();
    let mut asset = ASSETS[usize::from(choice) % ASSETS.len()].clone();
    for _ in 0..MOST {
        if u.is_empty() || mutate(&mut u, &mut asset).is_err() {
            break;
        }
    }
    let container = if choice < 128 { Container::Glb } else { Container::WithFile("scene.bin") };
    match dunkelfeld_io::gltf::load_gltf(&write(&asset, container), &options()) {
        Ok(imported) => build(imported),
        Err(e) => drop((e.to_string(), e.caret())),
    }
});

fn write(asset: &Asset, container: Container) -> PathBuf {
    match container {
        Container::Glb => SCRATCH.write("scene.glb", &asset.encode(container)),
        Container::WithFile(name) => {
            SCRATCH.write(name, &asset.buffer);
            SCRATCH.write("scene.gltf", &asset.encode(container))
        }
    }
}

fn mutate(u: &mut Unstructured<'_>, asset: &mut Asset) -> Result<()> {
    match u.arbitrary::<u8>()? {
        0..176 => mutate_value(u, &mut asset.json, WORDS),
        _ => mutate_buffer(u, &mut asset.buffer),
    }
}
