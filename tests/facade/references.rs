//! Our images against those of Mitsuba 3.9.1, which `validation/parity.py` rendered and keeps in `tests/references/` with
//! the standard error of each pixel: every parameter of the principled BSDF, clear solids and sheets, media, lights,
//! cameras, coverage, textures, normals.
//!
//! `cases.txt` names the cases. Each has a job and a picture, and misses neither without failing. Several independent
//! renders of ours, with seeds of their own, give mean and variance; [`ImageTest`] compares. The false-alarm rate of the
//! whole file is [`RATE`], shared out by Sidak's rule. What fails leaves a map of the scores in `target/test-failures`.
//!
//! Replay: `REFERENCE=NAME cargo test -p dunkelfeld --test it references`; NAME may hold part of a case's name.

use crate::support::{film, settings};
use dunkelfeld::Project;
use dunkelfeld_io::exr::{Channel, read_exr};
use dunkelfeld_testkit::{ImageEstimate, ImageTest, Outcome, SampleMoments, sidak};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// False-alarm rate of all cases together.
const RATE: f64 = 1e-7;
/// Independent renders of each case.
const BATCHES: u32 = 24;
/// Samples per pixel of each.
const BATCH_SPP: f64 = 16.0;
/// Of 256 pixels two are forgiven: a rare, bright path makes a pixel anything but normal. Pictures are kept in half
/// precision, which the rounding allows for.
const TEST: ImageTest = ImageTest { minimum_pass_share: 0.99, rounding: 4.9e-4 };
/// Fewer cases than these means that some were lost.
const AT_LEAST: usize = 80;
/// Batches that the pictures were made from.
const REFERENCE_BATCHES: f64 = 32.0;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/references")
}

/// All cases: their names, and Mitsuba's samples per pixel.
fn cases() -> Vec<(String, f64)> {
    let path = folder().join("cases.txt");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let case = |line: &str| {
        let (name, spp) = line.split_once(' ')?;
        Some((name.to_owned(), spp.parse().ok()?))
    };
    text.lines().map(|line| case(line).unwrap_or_else(|| panic!("{}: {line}", path.display()))).collect()
}

/// Mitsuba's picture: `R G B` and their standard errors `error.R/G/B`.
fn reference(name: &str) -> Result<ImageEstimate, String> {
    let path = folder().join(format!("{name}.exr"));
    let layers = read_exr(&path).map_err(|e| e.to_string())?;
    let channel = |name: &str| match layers.channel(name) {
        Some(Channel::F32(v)) => Ok(v.clone()),
        _ => Err(format!("{}: the channel {name} is missing", path.display())),
    };
    let triples = |names: [&str; 3]| -> Result<Vec<[f64; 3]>, String> {
        let [r, g, b] = names.map(channel);
        let (r, g, b) = (r?, g?, b?);
        Ok(r.iter().zip(&g).zip(&b).map(|((r, g), b)| [*r, *g, *b].map(f64::from)).collect())
    };
    let variance = triples(["error.R", "error.G", "error.B"])?.into_iter().map(|e| e.map(|e| e * e)).collect();
    Ok(ImageEstimate {
        width: layers.width as usize,
        height: layers.height as usize,
        mean: triples(["R", "G", "B"])?,
        variance,
        freedom: REFERENCE_BATCHES - 1.0,
    })
}

/// Our picture of a case.
fn ours(name: &str) -> Result<ImageEstimate, String> {
    let project = Project::open(folder().join(format!("{name}.toml"))).map_err(|e| e.to_string())?;
    let (width, height) = (project.settings.width, project.settings.height);
    let view = project.fitted().map_err(|e| e.to_string())?.run.view;
    let mut moments = vec![[SampleMoments::default(); 3]; (width * height) as usize];
    for batch in 0..BATCHES {
        let mut settings = settings(width, height, BATCH_SPP, u64::from(batch) + 1);
        settings.run.threads = 1;
        settings.run.view.clone_from(&view);
        let film = film(&project.scene, &settings);
        if film.invalid_samples() > 0 {
            return Err(format!("{} samples are not finite or negative", film.invalid_samples()));
        }
        for (pixel, sums) in moments.iter_mut().zip(film.sums().data()) {
            pixel.iter_mut().zip(sums.mean()).for_each(|(m, v)| m.push(v));
        }
    }
    let of = |f: fn(&SampleMoments) -> f64| moments.iter().map(|p| [f(&p[0]), f(&p[1]), f(&p[2])]).collect();
    Ok(ImageEstimate {
        width: width as usize,
        height: height as usize,
        mean: of(SampleMoments::mean),
        variance: of(|m| m.standard_error().powi(2)),
        freedom: f64::from(BATCHES) - 1.0,
    })
}

/// Compares a case, of which Mitsuba took `spp` samples per pixel.
///
/// Where few samples hold most of the light, a short render that missed them has too small a variance along with too
/// small a mean. The reference, twenty times as long, is more precise: its variance, scaled to as few samples, is used
/// where it is larger.
fn judge(name: &str, spp: f64) -> Result<Outcome, String> {
    let (mut ours, reference) = (ours(name)?, reference(name)?);
    let scale = spp / (f64::from(BATCHES) * BATCH_SPP);
    for (own, other) in ours.variance.iter_mut().flatten().zip(reference.variance.iter().flatten()) {
        *own = own.max(scale * other);
    }
    Ok(TEST.run(&format!("reference {name}"), &ours, &reference))
}

#[test]
#[ignore = "long: .ci/run runs it"]
fn images_equal_those_of_mitsuba() {
    let all = cases();
    let part = std::env::var("REFERENCE").unwrap_or_default();
    let chosen: Vec<&(String, f64)> = all.iter().filter(|(name, _)| name.contains(&part)).collect();
    assert!(!chosen.is_empty(), "no case has \"{part}\" in its name");
    let rate = sidak(RATE, all.len());
    let next = AtomicUsize::new(0);
    let failures = Mutex::new(Vec::new());
    let work = || {
        while let Some((name, spp)) = chosen.get(next.fetch_add(1, Ordering::Relaxed)) {
            let failure = match judge(name, *spp) {
                Ok(outcome) if outcome.passes(rate) => {
                    println!("{}", outcome.message);
                    continue;
                }
                Ok(outcome) => outcome.message,
                Err(problem) => format!("{name}: {problem}"),
            };
            failures.lock().expect("no thread panicked").push(failure);
        }
    };
    // One case after the other in each thread: a render of 256 pixels has no work for two.
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(2, usize::from) {
            scope.spawn(work);
        }
    });
    let failures = failures.into_inner().expect("no thread panicked");
    assert!(
        failures.is_empty(),
        "{} of {} cases differ at the rate {rate:.1e} each (replay: REFERENCE=NAME):\n{}",
        failures.len(),
        chosen.len(),
        failures.join("\n")
    );
}

#[test]
fn no_case_is_lost() {
    let listed: BTreeSet<String> = cases().into_iter().map(|(name, _)| name).collect();
    assert!(listed.len() >= AT_LEAST, "the list has lost cases: {}", listed.len());
    for ending in ["toml", "exr"] {
        let entries = std::fs::read_dir(folder()).expect("the folder of the references exists");
        let there: BTreeSet<String> = entries
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| path.extension().is_some_and(|e| e == ending))
            .filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned()))
            .collect();
        assert_eq!(there, listed, "cases.txt and the .{ending} files differ");
    }
}
