//! Renders that outlive their process, and parts of a render: the same bits as if nothing had happened, and clear words where
//! things do not belong together.
//!
//! A killed process leaves the checkpoint that it wrote last. Here copies of it are taken while a render runs.
//! The program itself is killed in `tests/cli/kills.rs`. Replay: `cargo test --workspace --test it checkpoints::NAME`.

use crate::support::{Add, build, emitter, film, sensor, settings, square};
use dunkelfeld::commands::{MergeSettings, Merged};
use dunkelfeld::film::{CheckpointSettings, Plane};
use dunkelfeld::geometry::{DVec3, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::shapes::{cuboid, sphere};
use dunkelfeld::scene::{Effect, Material, Scene, SceneBuilder};
use dunkelfeld::{
    Budget, Cancel, Error, Progress, ProgressState, RenderSettings, Rendering, SavedFilm, SensorChoice, Session, render,
};
use dunkelfeld_adaptive::weights::Strategy;
use dunkelfeld_io::checkpoint::{CheckpointHead, read_checkpoint, write_checkpoint};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Three tiles side by side: few samples, so that slow reports do not make the test long.
const WIDTH: u32 = 33;
const HEIGHT: u32 = 3;
/// One tile.
const TILE: u32 = 16;

fn room(light: f32) -> Scene {
    let mut b = SceneBuilder::default();
    let floor = b.add_material(Material { base_color: Rgb::new(0.7, 0.5, 0.3).into(), ..Material::default() });
    b.add_object("floor", square(0.0, 2.0, false), floor);
    b.add(
        "ball",
        sphere(Vec3::new(0.2, 0.0, 0.25), 0.2, 12, true),
        Material { metallic: 1.0.into(), roughness: 0.3.into(), ..Material::default() },
    );
    b.add_object("box", cuboid(Vec3::new(-0.5, -0.2, 0.01), Vec3::new(-0.1, 0.2, 0.3)), floor);
    b.add("light", square(1.0, 0.5, true), emitter(light));
    b.add_camera("camera", DVec3::new(0.3, -1.5, 0.9), DVec3::new(0.0, 0.0, 0.15), 0.7);
    b.add_camera("other", DVec3::new(0.0, -1.5, 0.9), DVec3::new(0.0, 0.0, 0.15), 0.7);
    build(b)
}

/// An adaptive render: a pilot and a refinement, of several rounds.
fn adaptive() -> RenderSettings {
    settings(WIDTH, HEIGHT, 24.0, 3).with_strategy(Strategy::Sobel).with_sensor(sensor("imx250", Some(5.0)))
}

/// The samples of a render that another process does.
fn only(settings: &RenderSettings, samples: std::ops::Range<u32>) -> RenderSettings {
    settings.clone().running(|run| run.with_samples(samples)).with_budget(Budget::default()).with_strategy(None)
}

/// Joins parts into a checkpoint.
fn merge(parts: &[PathBuf], out: &Path) -> Result<Merged, Error> {
    let settings = MergeSettings::default().with_parts(parts.to_vec()).with_checkpoint(Some(out.into()));
    dunkelfeld::commands::merge(&settings, Instant::now())
}

/// Stores a checkpoint as often as it can.
fn kept(path: &Path, settings: &RenderSettings) -> RenderSettings {
    let checkpoint = CheckpointSettings::new(path).with_seconds(0.0);
    settings.clone().running(|run| run.with_checkpoint(checkpoint))
}

fn run(scene: &Scene, settings: &RenderSettings) -> Result<Rendering, Error> {
    render(scene, settings, &Session::new(settings.run.threads).expect("threads"))
}

/// Progress is reported ten times a second. A report that takes longer, with a single rendering thread, gives a report for every
/// few hundred samples, on any machine.
fn listen_slowly() {
    std::thread::sleep(Duration::from_millis(101));
}

/// The start of a render whose first report is due at once.
fn a_second_ago() -> Instant {
    Instant::now().checked_sub(Duration::from_secs(1)).unwrap_or_else(Instant::now)
}

/// A switch that is thrown once a render has taken so many samples.
struct StopAt<'a>(u64, &'a Cancel);

impl Progress for StopAt<'_> {
    fn update(&self, state: &ProgressState) {
        if state.samples >= self.0 {
            self.1.cancel();
        }
        listen_slowly();
    }
}

#[test]
fn a_finished_render_is_there_at_once_and_stays_as_it_is() {
    let scene = room(8.0);
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("a.film");
    let settings = kept(&path, &adaptive());
    let first = run(&scene, &settings).expect("a render");
    let bytes = fs::read(&path).expect("a checkpoint");
    let again = run(&scene, &settings).expect("the same render");
    assert!(!first.earlier.was_complete && again.earlier.was_complete);
    assert!(first.film == again.film && first.stop == again.stop && first.weights == again.weights);
    assert_eq!(fs::read(&path).expect("a checkpoint"), bytes);
}

/// The checkpoint with one passage of its text replaced.
fn with_text(path: &Path, from: &str, to: &str) {
    let stored = read_checkpoint(path).expect("a checkpoint");
    assert!(stored.text.contains(from), "no {from} in {}", stored.text);
    let text = stored.text.replace(from, to);
    let head = CheckpointHead {
        width: stored.film.width(),
        height: stored.film.height(),
        text: &text,
        weights: stored.weights.as_ref(),
        target: stored.target.as_ref(),
        objects: stored.objects.as_ref(),
        materials: stored.materials.as_ref(),
    };
    let mut rows = |rows: std::ops::Range<u32>, out: &mut Vec<_>| stored.film.read_rows(rows, out);
    write_checkpoint(path, &head, &mut rows).expect("writable");
}

/// Replaces the seconds of the text.
fn set_elapsed(path: &Path, seconds: &str) {
    let text = read_checkpoint(path).expect("a checkpoint").text;
    let value = text.split("\"elapsed\":").nth(1).and_then(|rest| rest.split(',').next()).expect("elapsed seconds");
    with_text(path, &format!("\"elapsed\":{value}"), &format!("\"elapsed\":{seconds}"));
}

#[test]
fn the_time_of_all_processes_counts_against_the_budget() {
    // Just under an hour, and more than an hour: the threads find a tile each, or one for all of them, and no time for it.
    for (width, elapsed) in [(WIDTH, "3599.9"), (TILE, "3601.5")] {
        let scene = room(8.0);
        let folder = TempDir::new().expect("a folder");
        let path = folder.path().join("a.film");
        let budget = Budget::default().with_seconds(3600.0);
        let timed = kept(&path, &adaptive().with_width(width).with_budget(budget)).running(|run| run.with_threads(2));
        let cancel = Cancel::new();
        let stop = StopAt(2_000, &cancel);
        let first = render(
            &scene,
            &timed,
            &Session::new(timed.run.threads)
                .expect("threads")
                .with_start(a_second_ago())
                .with_progress(&stop)
                .with_cancel(&cancel),
        )
        .expect("a render");
        assert!(first.interrupted);
        // As if the first process had worked for so long: nothing but the open round is left to do.
        set_elapsed(&path, elapsed);
        let second = run(&scene, &timed).expect("it goes on");
        assert!(!second.interrupted && second.stop == dunkelfeld::adaptive::StopReason::Time);
        assert_eq!(second.earlier.seconds.to_string(), elapsed);
        // All of it was spent in some stage.
        let accounted: f64 = second.stages.iter().map(|(_, seconds)| seconds).sum();
        assert!((accounted - second.earlier.seconds).abs() < 60.0, "{accounted} s in {:?}", second.stages);
        // The plan of the render replays it.
        let replay = timed.running(|run| run.with_replay(second.plan())).running(|run| run.with_checkpoint(None));
        assert!(film(&scene, &replay) == second.film.sums);
    }
}

#[track_caller]
fn refused<T: std::fmt::Debug>(result: Result<T, Error>, says: &[&str]) {
    let message = result.map(|_| ()).expect_err("must be refused").to_string();
    for word in says {
        assert!(message.contains(word), "\"{word}\" is not in: {message}");
    }
    assert!(message.contains("help:"), "{message}");
}

#[test]
fn a_checkpoint_of_another_render_is_refused_and_the_difference_named() {
    let scene = room(8.0);
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("a.film");
    let small = adaptive().with_width(12).with_height(8);
    let settings = kept(&path, &small);
    run(&scene, &settings).expect("a render");
    let bytes = fs::read(&path).expect("a checkpoint");
    let base = || settings.clone();
    let cases: [(RenderSettings, &str); 15] = [
        (base().with_seed(4), "not the same seed, \"3\" there and \"4\" here"),
        (base().with_frame(1), "not the same frame"),
        (base().with_width(13), "not the same size, \"12 x 8\" there and \"13 x 8\" here"),
        (base().with_camera(Some("other".into())), "not the same camera"),
        (base().running(|run| run.with_without(vec![Effect::ALL[0]])), "not the same choice of effects left out"),
        (base().with_budget(Budget::default().with_spp(91.0)), "not the same budget"),
        (
            base().with_budget(Budget::default().with_seconds(9.0)),
            "not the same budget, \"24 samples per pixel\" there and \"9 s\" here",
        ),
        (base().with_strategy(Strategy::Uniform), "not the same allocation"),
        (base().with_sensor(SensorChoice::None), "not the same sensor or exposure"),
        (base().with_sensor(sensor("imx174", Some(5.0))), "not the same sensor or exposure"),
        (base().with_sensor(sensor("imx250", Some(6.0))), "not the same sensor or exposure"),
        (base().with_pilot_spp(17), "not the same further settings"),
        (base().with_sobel_floor(0.3), "not the same further settings"),
        (base().running(|run| run.with_replay(Plane::new(12, 8, 4))), "not the same plan"),
        (only(&base(), 0..4), "the whole render there and samples 0..4 here"),
    ];
    for (other, says) in cases {
        refused(run(&scene, &other), &["a.film", "another render", says]);
    }
    refused(run(&room(8.000_001), &settings), &["not the same scene"]);
    assert_eq!(fs::read(&path).expect("a checkpoint"), bytes, "a refused checkpoint stays");

    // Another version of the program, and one that computes otherwise under the same number.
    with_text(&path, "\"dunkelfeld ", "\"dunkelfeld 9.");
    refused(run(&scene, &settings), &["not the same program", "dunkelfeld 9."]);
    fs::write(&path, &bytes).expect("writable");
    let probes = read_checkpoint(&path).expect("a checkpoint").text;
    let digest = probes.split("\"outcome of samples\",\"").nth(1).map(|rest| rest[..32].to_owned()).expect("a digest");
    with_text(&path, &digest, &digest.chars().rev().collect::<String>());
    refused(run(&scene, &settings), &["not the same outcome of samples"]);

    // No checkpoint at all, a text that is none, a place where there cannot be one.
    fs::write(&path, "precious").expect("writable");
    refused(run(&scene, &settings), &["a.film", "cut short"]);
    fs::write(&path, "precious".repeat(9)).expect("writable");
    refused(run(&scene, &settings), &["a.film", "not that of a checkpoint"]);
    fs::write(&path, &bytes).expect("writable");
    with_text(&path, "\"key\"", "\"kez\"");
    refused(run(&scene, &settings), &["a.film", "description"]);
    refused(run(&scene, &kept(&folder.path().join("no/a.film"), &settings)), &["no/a.film", "folder"]);
    refused(run(&scene, &kept(folder.path(), &settings)), &["is a folder"]);
}

#[test]
fn a_checkpoint_of_a_whole_render_is_a_saved_film() {
    let scene = room(8.0);
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("a.film");
    let settings = kept(&path, &adaptive());
    let rendering = run(&scene, &settings).expect("a render");
    let saved = SavedFilm::read(&path).expect("a saved film");
    assert!(saved.film == rendering.film);
    assert_eq!(format!("{:?}", saved.settings.sensor), format!("{:?}", settings.sensor));
}

/// The samples of a uniform render in a part of its own.
fn part(scene: &Scene, folder: &TempDir, settings: &RenderSettings, samples: std::ops::Range<u32>) -> PathBuf {
    let path = folder.path().join(format!("{}-{}.film", samples.start, samples.end));
    run(scene, &kept(&path, &only(settings, samples))).expect("a part");
    path
}

#[test]
fn merged_parts_are_the_whole_to_the_last_bit() {
    let scene = room(8.0);
    let folder = TempDir::new().expect("a folder");
    let out = folder.path().join("out.film");
    let uniform = settings(33, 21, 24.0, 5);
    let Rendering { film: whole, .. } = run(&scene, &uniform).expect("a render");
    let [a, b, c] = [0..7, 7..8, 8..24].map(|range| part(&scene, &folder, &uniform, range));

    for parts in [[&a, &b, &c], [&c, &a, &b], [&b, &c, &a]] {
        let merged = merge(&parts.map(PathBuf::clone), &out).expect("parts of one render");
        assert_eq!(merged.samples, 0..24);
        assert!(merged.rendering.film == whole);
        let parts = merged.stats.time.parts.expect("parts");
        assert_eq!(parts.iter().map(|p| p.range).collect::<Vec<_>>(), [[0, 7], [7, 8], [8, 24]], "by their samples");
        assert_eq!(parts.iter().map(|p| p.samples).sum::<u64>(), whole.sums.total_samples());
        assert_eq!(
            (merged.stats.time.earlier_samples, merged.stats.sampling.samples),
            (whole.sums.total_samples(), whole.sums.total_samples())
        );
        assert!(read_checkpoint(&out).expect("a part").film == whole.sums);
        // A merged render is a finished part, for any sensor.
        let settings = only(&uniform, 0..24).with_sensor(sensor("imx174", Some(3.0)));
        let again = run(&scene, &kept(&out, &settings)).expect("a finished part");
        assert!(again.earlier.was_complete && again.film == whole);
    }
}

#[test]
fn parts_of_a_plan_are_the_plan() {
    let scene = room(8.0);
    let folder = TempDir::new().expect("a folder");
    let out = folder.path().join("out.film");
    let adaptive = adaptive().with_width(33).with_height(21);
    let whole = run(&scene, &adaptive).expect("a render");
    let plan = whole.plan();
    let most = plan.data().iter().copied().max().expect("pixels");
    let replay = adaptive.running(|run| run.with_replay(plan.clone()));
    let cut = most / 2;
    assert!(plan.data().iter().any(|&n| n < cut), "some pixels lie in the first part alone");
    let parts = [0..5, 5..cut, cut..most].map(|range| part(&scene, &folder, &replay, range));
    let merged = merge(&parts, &out).expect("parts of one plan");
    assert_eq!(merged.stats.run.allocation, "replay");
    assert!(read_checkpoint(&out).expect("a part").film == whole.film.sums);
}

#[test]
fn parts_that_do_not_belong_together_are_refused() {
    let scene = room(8.0);
    let folder = TempDir::new().expect("a folder");
    let out = folder.path().join("out.film");
    let uniform = settings(12, 8, 24.0, 5);
    let [a, b, c, d] = [0..8, 8..16, 12..24, 20..24].map(|range| part(&scene, &folder, &uniform, range));
    let together = |parts: &[&PathBuf]| merge(&parts.iter().map(|&p| p.clone()).collect::<Vec<_>>(), &out);
    refused(together(&[&a, &b, &c]), &["12-24.film", "overlap", "8..16", "12..24"]);
    refused(together(&[&a, &a]), &["0-8.film", "overlap"]);
    refused(together(&[&d, &b, &a]), &["20-24.film", "gap", "8..16"]);
    refused(merge(&[], &out), &["no parts"]);

    // Other renders.
    let elsewhere = TempDir::new().expect("a folder");
    let other = |scene: &Scene, settings: &RenderSettings| part(scene, &elsewhere, settings, 8..16);
    refused(together(&[&a, &other(&room(9.0), &uniform)]), &["not the same scene", "0-8.film"]);
    for (changed, says) in [
        (uniform.clone().with_seed(6), "not the same seed"),
        (uniform.clone().running(|run| run.with_replay(Plane::new(12, 8, 99))), "not the same plan"),
        (uniform.clone().with_sensor(sensor("imx174", Some(5.0))), "not the same sensor, lens or exposure"),
    ] {
        let _ = fs::remove_file(elsewhere.path().join("8-16.film"));
        refused(together(&[&a, &other(&scene, &changed)]), &["8-16.film", says]);
    }

    // A part must not be written over.
    refused(merge(&[a.clone(), b.clone()], &b), &["8-16.film", "is a part"]);

    // A whole render, an unfinished part, one that contains more samples than its range.
    let whole = folder.path().join("whole.film");
    run(&scene, &kept(&whole, &uniform)).expect("a render");
    refused(together(&[&whole]), &["whole.film", "not a part"]);
    with_text(&b, "\"stop\":\"Samples\"", "\"stop\":null");
    refused(together(&[&a, &b]), &["8-16.film", "not finished"]);
    with_text(&a, "\"samples\":{\"start\":0,\"end\":8}", "\"samples\":{\"start\":0,\"end\":7}");
    refused(together(&[&a]), &["0-8.film", "8 samples in a pixel"]);
    assert!(!out.exists(), "nothing was written");
}
