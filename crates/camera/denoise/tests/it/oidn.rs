//! Tests of the adapter with the library itself. The environment variable `DUNKELFELD_OIDN` contains its path. Without
//! it these tests print that they are skipped.
//!
//! To run them: `DUNKELFELD_OIDN=/path/to/libOpenImageDenoise.so.2 cargo test --workspace --test it oidn -- --nocapture`,
//! and with `--include-ignored` for the largest image, which needs some minutes and 4 GB.

#![allow(clippy::print_stdout, reason = "says which library it is, or that there is none")]

use dunkelfeld_denoise::oidn::Candidate;
use dunkelfeld_denoise::{Control, DenoiseError, DenoiseInput, Denoiser, Executor, Oidn, Serial, Triples};
use dunkelfeld_film::Plane;
use std::path::PathBuf;
use std::sync::Mutex;

/// The library of the environment variable, with its thread library from the same folder.
fn library() -> Option<Oidn> {
    let Some(path) = std::env::var_os("DUNKELFELD_OIDN").map(PathBuf::from) else {
        println!("skipped: DUNKELFELD_OIDN names no library");
        return None;
    };
    let folder = path.parent().expect("a file in a folder");
    let files = std::fs::read_dir(folder).expect("a folder").map(|e| e.expect("readable").path());
    let companions = files.filter(|p| p.file_name().is_some_and(|n| n.to_string_lossy().starts_with("libtbb.so")));
    let candidate = Candidate { companions: companions.collect(), library: path };
    Some(Oidn::load(&[candidate]).expect("the library that DUNKELFELD_OIDN names"))
}

/// A pseudo-random number in `[0, 1)`, from a hash of its coordinates.
fn noise(x: u32, y: u32, channel: u32) -> f32 {
    let mut h = x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b) ^ channel.wrapping_mul(0xc2b2_ae35);
    for _ in 0..2 {
        h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    }
    (h >> 8) as f32 / (1u32 << 24) as f32
}

/// A disc before a dark ground: radiance, albedo and normal without noise.
fn scene(width: u32, height: u32, x: u32, y: u32) -> [[f32; 3]; 3] {
    let (dx, dy) = (x as f32 / width as f32 - 0.5, y as f32 / height as f32 - 0.5);
    match dx * dx + dy * dy < 0.1 {
        true => [[0.9, 0.6, 0.3], [0.9, 0.6, 0.3], [2.0 * dx, 2.0 * dy, 0.9]],
        false => [[0.08; 3], [0.2; 3], [0.0, 0.0, 1.0]],
    }
}

/// Radiance with multiplicative noise of mean one, and features with a little noise.
fn noisy(width: u32, height: u32) -> [Triples; 3] {
    [0, 1, 2].map(|layer| {
        Plane::from_fn(width, height, |x, y| {
            let clean = scene(width, height, x, y)[layer];
            let strength = if layer == 0 { 1.8 } else { 0.1 };
            std::array::from_fn(|c| clean[c] * (1.0 + strength * (noise(x, y, c as u32 + 3 * layer as u32) - 0.5)))
        })
    })
}

fn input(planes: &[Triples; 3]) -> DenoiseInput<'_> {
    DenoiseInput { albedo: Some(&planes[1]), normal: Some(&planes[2]), ..DenoiseInput::new(&planes[0]) }
}

fn squared_error(image: &Triples) -> f64 {
    let (width, height) = (image.width(), image.height());
    let truth = Plane::from_fn(width, height, |x, y| scene(width, height, x, y)[0]);
    let pairs = image.data().as_flattened().iter().zip(truth.data().as_flattened());
    pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / f64::from(width * height * 3)
}

fn is_finite(image: &Triples) -> bool {
    image.data().as_flattened().iter().all(|v| v.is_finite())
}

#[test]
fn noise_is_removed_and_the_image_is_preserved() {
    let Some(oidn) = library() else { return };
    println!("{}", oidn.name());
    assert!(oidn.name().starts_with("Intel Open Image Denoise ") && oidn.name().ends_with(oidn.version()));
    let planes = noisy(192, 128);
    let before = squared_error(&planes[0]);
    for input in [DenoiseInput::new(&planes[0]), input(&planes)] {
        let out = oidn.denoise(&input, &Control::SILENT).expect("denoised");
        let after = squared_error(&out);
        println!("mean squared error {before:.3e} before, {after:.3e} after");
        assert!(after < before / 8.0, "{after} of {before}");
        let mean = |p: &Triples| p.data().as_flattened().iter().map(|&v| f64::from(v)).sum::<f64>();
        assert!((mean(&out) / mean(&planes[0]) - 1.0).abs() < 0.03, "the light stays");
    }
    // The library does not support a normal alone. The image is denoised without it.
    let alone = DenoiseInput { normal: Some(&planes[2]), ..DenoiseInput::new(&planes[0]) };
    let without = oidn.denoise(&DenoiseInput::new(&planes[0]), &Control::SILENT);
    assert_eq!(oidn.denoise(&alone, &Control::SILENT), without);
}

/// Beside the noise of the rest, a fine pattern of first light is blurred. By itself it has no noise, and stays.
#[test]
fn a_pattern_of_first_light_is_kept() {
    let Some(oidn) = library() else { return };
    let (width, height) = (192, 128);
    let pattern = |x: u32, y: u32| [if (x / 2 + y / 2).is_multiple_of(2) { 0.1 } else { 0.2 }; 3];
    let first_light = Plane::from_fn(width, height, pattern);
    let mean = Plane::from_fn(width, height, |x, y| pattern(x, y).map(|v| v + noise(x, y, 0)));
    let error = |given: Option<&Triples>| {
        let input = DenoiseInput { first_light: given, ..DenoiseInput::new(&mean) };
        let out = oidn.denoise(&input, &Control::SILENT).expect("denoised");
        let pairs = out.data().as_flattened().iter().zip(first_light.data().as_flattened());
        pairs.map(|(v, pattern)| f64::from(v - pattern - 0.5).powi(2)).sum::<f64>()
    };
    let (apart, whole) = (error(Some(&first_light)), error(None));
    assert!(apart < 0.25 * whole, "squared error {apart} apart, {whole} as a whole");
    // More first light than light, or none that is a number, is all of it.
    for value in [f32::INFINITY, 1e9, f32::NAN] {
        let all = error(Some(&Plane::new(width, height, [value; 3])));
        assert!(
            (all / whole - 1.0).abs() < 0.01,
            "squared error {all} with a first light of {value}, {whole} as a whole"
        );
    }
}

#[test]
fn every_size_has_an_image() {
    let Some(oidn) = library() else { return };
    for (width, height) in [(0, 0), (0, 7), (1, 1), (1, 300), (300, 1), (2, 3), (17, 15), (257, 129)] {
        let planes = noisy(width, height);
        let out = oidn.denoise(&input(&planes), &Control::SILENT).expect("denoised");
        assert_eq!((out.width(), out.height()), (width, height));
        assert!(is_finite(&out), "{width} x {height}");
        let without = oidn.denoise(&DenoiseInput::new(&planes[0]), &Control::SILENT).expect("denoised");
        assert!(is_finite(&without) && without.data().len() == out.data().len());
    }
}

#[test]
#[ignore = "needs some minutes and 4 GB"]
fn an_image_of_8192_x_4320_is_denoised() {
    let Some(oidn) = library() else { return };
    let planes = noisy(8192, 4320);
    let two = Threads(2);
    let out = oidn.denoise(&input(&planes), &Control { executor: &two, progress: &|_| true }).expect("denoised");
    assert!(is_finite(&out) && squared_error(&out) < squared_error(&planes[0]) / 8.0);
}

#[test]
fn odd_numbers_stay_where_they_are() {
    let Some(oidn) = library() else { return };
    let clean = noisy(96, 64);
    let reference = oidn.denoise(&input(&clean), &Control::SILENT).expect("denoised");
    let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -3.0, 3e38, 1e-42];
    let mut planes = clean.clone();
    for (plane, y) in planes.iter_mut().zip([10, 20, 30]) {
        for (x, value) in (5..).step_by(15).zip(odd) {
            plane.data_mut()[y * 96 + x][x % 3] = value;
        }
    }
    let out = oidn.denoise(&input(&planes), &Control::SILENT).expect("denoised");
    assert!(is_finite(&out));
    // Far from these pixels the image does not change. 3e38 is a valid bright pixel, and may affect its neighbours.
    let near = |x: u32, y: u32| y > 50 && !(50..85).contains(&x);
    for (i, (a, b)) in out.data().iter().zip(reference.data()).enumerate() {
        let (x, y) = (i as u32 % 96, i as u32 / 96);
        if near(x, y) {
            let off = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 0.1, "({x}, {y}) differs by {off}");
        }
    }
    let nothing = Plane::new(40, 30, [f32::NAN; 3]);
    let out = oidn.denoise(&DenoiseInput::new(&nothing), &Control::SILENT).expect("denoised");
    assert!(out.data().as_flattened().iter().all(|v| v.abs() < 1e-3), "nothing is black");
}

/// Reports more threads than it has, since the library has its own.
struct Threads(usize);

impl Executor for Threads {
    fn threads(&self) -> usize {
        self.0
    }

    fn for_each(&self, pieces: usize, work: &(dyn Fn(usize) + Sync)) {
        (0..pieces).for_each(work);
    }
}

#[test]
fn progress_grows_to_one_and_stops_on_request() {
    let Some(oidn) = library() else { return };
    let planes = noisy(400, 300);
    let fractions = Mutex::new(Vec::new());
    let listen = |fraction| {
        fractions.lock().expect("not poisoned").push(fraction);
        true
    };
    oidn.denoise(&input(&planes), &Control { executor: &Serial, progress: &listen }).expect("denoised");
    let fractions = fractions.into_inner().expect("not poisoned");
    assert!(fractions.is_sorted() && fractions[0] >= 0.0 && fractions[fractions.len() - 1] > 0.9, "{fractions:?}");
    assert!(fractions.len() > 5, "{fractions:?}");

    for limit in [0.0, 0.2, 0.5, 0.8] {
        let stop = |fraction: f64| fraction < limit;
        let result = oidn.denoise(&input(&planes), &Control { executor: &Serial, progress: &stop });
        assert_eq!(result, Err(DenoiseError::Cancelled), "at {limit}");
    }
    // The library still works after it.
    oidn.denoise(&input(&planes), &Control::SILENT).expect("denoised");
}
