//! Any bytes as an EXR: its layers can be read by all of their names, and a file that is written again reads the same.
#![no_main]

use dunkelfeld_fuzz::{Scratch, target};
use dunkelfeld_io::exr::{Channel, ExrLayers, read_exr, write_exr};
use dunkelfeld_io::layers::{Single, Triple};
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

/// Larger images are not written again.
const MAX_PIXELS: usize = 4096;

target!(|data| {
    match read_exr(&SCRATCH.write("in.exr", data)) {
        Ok(layers) => {
            ask(&layers);
            if layers.width as usize * layers.height as usize <= MAX_PIXELS {
                write_again(&layers);
            }
        }
        Err(e) => drop((e.to_string(), e.caret())),
    }
});

fn ask(layers: &ExrLayers) {
    use Triple as T;
    for layer in [T::Mean, T::Variance, T::Covariance, T::Denoised, T::Albedo, T::Normal, T::AlbedoVariance] {
        if let Some(plane) = layers.triples(layer) {
            assert_eq!((plane.width(), plane.height()), (layers.width, layers.height), "{layer:?}");
        }
    }
    for layer in [Single::SampleCount, Single::Depth, Single::ObjectId, Single::Hidden] {
        for size in [
            layers.single(layer).map(|plane| (plane.width(), plane.height())),
            layers.integers(layer).map(|plane| (plane.width(), plane.height())),
        ] {
            assert!(size.is_none_or(|size| size == (layers.width, layers.height)), "{layer:?}");
        }
    }
    std::hint::black_box(layers.triples_named("combined"));
}

/// Names that the format allows and ours does not are refused; all else comes back bit by bit.
fn write_again(layers: &ExrLayers) {
    let path = SCRATCH.path("again.exr");
    if write_exr(&path, layers.clone()).is_ok() {
        let again = read_exr(&path).expect("what was written can be read");
        assert_eq!(sorted(&again), sorted(layers));
    }
}

fn sorted(layers: &ExrLayers) -> Vec<(&str, Vec<u32>)> {
    let mut channels: Vec<(&str, Vec<u32>)> = (layers.channels.iter())
        .map(|(name, channel)| match channel {
            Channel::F32(values) => (name.as_str(), values.iter().map(|v| v.to_bits()).collect()),
            Channel::U32(values) => (name.as_str(), values.clone()),
        })
        .collect();
    channels.sort();
    channels
}
