//! The program killed with SIGKILL at random moments, and taken up again: the files that it writes in the end are those of a
//! run that was left alone, byte by byte. And `merge` as its users have it.
//!
//! When a process is killed is up to the scheduler, so every run of this test tries other moments; the result must not
//! depend on them. Replay: `cargo test --workspace --test it killed::NAME`.

use assert_cmd::Command;
use assert_cmd::assert::Assert;
use std::fs;
use std::io::{BufRead, BufReader, Lines};
use std::path::PathBuf;
use std::process::{Child, ChildStderr, Command as Process, Stdio};
use tempfile::TempDir;

const PROGRAM: &str = env!("CARGO_BIN_EXE_dunkelfeld");

/// A folder with a scene: a floor under a lamp, and a wall with a shadow.
struct Bench {
    folder: TempDir,
}

impl Bench {
    fn new() -> Self {
        let bench = Self { folder: TempDir::new().expect("a temporary folder") };
        bench.write("scene.mtl", "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 3 2 1\n");
        let floor = "v -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\n";
        let lamp = "v -0.3 1 -0.3\nv 0.3 1 -0.3\nv 0.3 1 0.3\nv -0.3 1 0.3\n";
        let wall = "v 0 0 -0.5\nv 0.4 0 -0.3\nv 0.4 0.4 -0.3\nv 0 0.4 -0.5\n";
        let faces = "o floor\nusemtl floor\nf 1 2 3 4\no wall\nf 9 10 11 12\no lamp\nusemtl lamp\nf 5 6 7 8\n";
        bench.write("scene.obj", &format!("mtllib scene.mtl\n{floor}{lamp}{wall}{faces}"));
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).expect("writable");
    }

    fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    fn run(&self, line: &str) -> Assert {
        Command::new(PROGRAM).current_dir(self.folder.path()).args(line.split_whitespace()).assert()
    }

    /// Starts the program, and returns it and its lines of progress.
    fn start(&self, line: &str) -> (Child, Lines<BufReader<ChildStderr>>) {
        let mut child = Process::new(PROGRAM)
            .current_dir(self.folder.path())
            .args(line.split_whitespace())
            .args(["--progress", "json"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let progress = BufReader::new(child.stderr.take().expect("a pipe"));
        (child, progress.lines())
    }

    /// Runs the program, and kills it after so many lines of progress: true if it was faster than that.
    fn kill_after(&self, line: &str, lines: usize) -> bool {
        let (mut child, mut progress) = self.start(line);
        let seen = progress.by_ref().take(lines).count();
        // SIGKILL on Unix: nothing of the program runs after it.
        child.kill().expect("it is ours");
        let status = child.wait().expect("it is ours");
        seen < lines && status.success()
    }
}

fn stdout(assert: &Assert) -> String {
    String::from_utf8_lossy(&assert.get_output().stdout).into_owned()
}

fn stderr(assert: &Assert) -> String {
    String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
}

/// Multiples of the golden ratio, as numbers of lines from 1 to 9 (Weyl 1916): early and late, the same in every run.
fn moments() -> impl Iterator<Item = usize> {
    (1u32..).map(|i| 1 + (i.wrapping_mul(0x9e37_79b9) >> 16) as usize * 9 / 65_536)
}

#[test]
#[ignore = "long: .ci/run runs it"]
fn a_render_that_is_killed_again_and_again_ends_with_the_same_files() {
    const KILLS: usize = 12;
    let bench = Bench::new();
    for mode in ["--allocate sobel --spp 150", "--spp 150", "--samples 100..250"] {
        let _ = fs::remove_file(bench.path("a.film"));
        let name =
            if mode.contains("samples") { "--exr b.exr -o b.png" } else { "--exr b.exr -o b.png --plan b-plan.exr" };
        let base = format!("render scene.obj --width 128 --height 112 --seed 5 {mode}");
        let keep = "--checkpoint a.film --checkpoint-every 0s";
        let mut kills = 0;
        for lines in moments().take(KILLS) {
            // On one thread, so that there is something to be killed.
            if bench.kill_after(&format!("{base} {keep} {name} --threads 1"), lines) {
                break;
            }
            kills += 1;
        }
        assert!(kills > 1, "{mode}: the program was too quick to be killed more than {kills} times");
        bench.run(&format!("{base} {keep} {name}")).code(0);
        let whole = if mode.contains("samples") { format!("{base} --checkpoint whole.film") } else { base };
        bench.run(&format!("{whole} {}", name.replace("b.", "a.").replace("b-", "a-"))).code(0);
        for (a, b) in [("a.exr", "b.exr"), ("a.png", "b.png")] {
            assert!(bench.read(a) == bench.read(b), "{mode}: {a} and {b} differ after {kills} kills");
        }
        if !mode.contains("samples") {
            assert!(bench.read("a-plan.exr") == bench.read("b-plan.exr"), "{mode}: the plans differ");
        }
        assert!(!bench.path(".a.film.partial").exists(), "{mode}: what a killed process left was not cleared away");
        let _ = fs::remove_file(bench.path("whole.film"));
    }
}

/// Ctrl-C, as `kill -INT` sends it: no checkpoint was due by then.
#[cfg(unix)]
#[test]
fn an_interrupted_render_leaves_its_checkpoint_and_continues() {
    let bench = Bench::new();
    let base = "render scene.obj --width 96 --height 80 --seed 5 --spp 300 --threads 1";
    let kept = format!("{base} --checkpoint a.film --checkpoint-every 1h -o b.png --exr b.exr");
    let (mut child, mut progress) = bench.start(&kept);
    assert_eq!(progress.by_ref().take(4).count(), 4, "it runs");
    let sent = Process::new("kill").args(["-INT", &child.id().to_string()]).status().expect("there is a kill");
    assert!(sent.success());
    // Reads to the end: otherwise the pipe would be full.
    let _ = progress.count();
    assert_eq!(child.wait().expect("it ends").code(), Some(130));
    let said = bench.run(&format!("{kept} --stats b.json")).code(0);
    assert!(stdout(&said).contains("continued from a checkpoint"), "{}", stdout(&said));
    bench.run(&format!("{base} -o a.png --exr a.exr")).code(0);
    assert!(bench.read("a.exr") == bench.read("b.exr") && bench.read("a.png") == bench.read("b.png"));
}

/// How long a machine takes is not tested here: a loaded one may miss the budget, which is a warning.
#[test]
fn a_timed_render_that_was_killed_counts_the_time_before_and_replays() {
    let bench = Bench::new();
    let base = "render scene.obj --width 64 --height 48 --seed 5";
    let timed =
        format!("{base} --time 3s --checkpoint a.film --checkpoint-every 0s -o a.png --exr a.exr --stats a.json");
    assert!(!bench.kill_after(&timed, 8), "three seconds are over too soon");
    let said = bench.run(&timed).code(0);
    let stats: serde_json::Value = serde_json::from_slice(&bench.read("a.json")).expect("JSON");
    let number = |key: &str| stats[key].as_f64().unwrap_or_else(|| panic!("{key} is no number"));
    assert_eq!(stats["stop"], "time");
    assert!(number("earlier_samples") > 0.0 && number("earlier_samples") <= number("samples"));
    // At the eighth report, one each tenth of a second, three quarters of a second were over at least; a process that
    // forgot them would report three seconds of its own in all.
    assert!(number("earlier_seconds") > 0.3 && number("total_seconds") > number("earlier_seconds"));
    assert!(stdout(&said).contains("continued from a checkpoint"), "{}", stdout(&said));
    bench.run(&format!("{base} --replay a.exr -o b.png --exr b.exr")).code(0);
    assert!(bench.read("a.exr") == bench.read("b.exr") && bench.read("a.png") == bench.read("b.png"));
}

#[test]
fn parts_of_several_processes_merge_to_the_whole() {
    let bench = Bench::new();
    let base = "render scene.obj --width 40 --height 30 --seed 5";
    bench.run(&format!("{base} --spp 24 --allocate uniform --exr whole.exr -o whole.png --linear whole.tif")).code(0);
    for (name, range) in [("a", "0..10"), ("b", "10..11"), ("c", "11..24")] {
        bench.run(&format!("{base} --samples {range} --checkpoint {name}.film")).code(0);
    }
    let outputs = "--exr all.exr -o all.png --linear all.tif --stats all.json";
    let merged = bench.run(&format!("merge c.film a.film b.film --checkpoint all.film {outputs}")).code(0);
    for words in ["3 parts: samples 0..24", "exposed for", "noise of the render: "] {
        assert!(stdout(&merged).contains(words), "{}", stdout(&merged));
    }
    for (file, of) in [("exr", "layers"), ("png", "pictures"), ("tif", "grey values")] {
        assert!(bench.read(&format!("whole.{file}")) == bench.read(&format!("all.{file}")), "the {of} differ");
    }
    let stats = String::from_utf8(bench.read("all.json")).expect("text");
    for word in ["\"file\": \"b.film\"", "\"allocation\": \"uniform\"", "\"earlier_samples\": 28800"] {
        assert!(stats.contains(word), "{word} is not in {stats}");
    }
    // The whole is a finished part, from which other outputs are made.
    let finished = format!("{base} --samples 0..24 --checkpoint all.film --exr again.exr -o again.png");
    let said = bench.run(&finished).code(0);
    assert!(stdout(&said).contains("the checkpoint contained the whole render"), "{}", stdout(&said));
    assert!(bench.read("whole.exr") == bench.read("again.exr"), "the layers differ");

    bench.write("text.film", "not a film");
    for (line, says) in [
        ("merge a.film c.film -o x.png", &["c.film", "gap", "0..10", "11..24", "help:"][..]),
        ("merge a.film b.film a.film -o x.png", &["a.film", "overlap", "0..10", "help:"]),
        ("merge a.film nowhere.film -o x.png", &["nowhere.film", "help:"]),
        ("merge a.film text.film -o x.png", &["text.film", "help:"]),
        ("merge a.film b.film -o nowhere/x.png", &["nowhere/x.png", "help:"]),
        ("merge a.film b.film -o x.film", &["x.film", ".png", "help:"]),
        ("merge a.film b.film --checkpoint b.film", &["b.film", "is a part", "help:"]),
        ("merge -o x.png", &["PART"]),
        ("merge a.film", &["--output"]),
        ("render scene.obj --seed 6 --width 40 --height 30 --samples 0..10 --checkpoint a.film", &["seed", "help:"]),
        ("render scene.obj --samples 0..10", &["--checkpoint"]),
        ("render scene.obj --samples 10..10 --checkpoint x.film", &["--samples", "0..64"]),
        ("render scene.obj --samples 0..10 --spp 3 --checkpoint x.film", &["--samples", "--spp"]),
        ("render scene.obj --checkpoint-every 5s", &["--checkpoint"]),
        ("render scene.obj --checkpoint x.png -o x.png", &["x.png", "checkpoint", "help:"]),
        ("render scene.obj --checkpoint nowhere/x.film", &["nowhere/x.film", "help:"]),
        ("render scene.obj --checkpoint text.film", &["text.film", "help:"]),
    ] {
        let message = stderr(&bench.run(line).code(2));
        for word in says {
            assert!(message.contains(word), "{line}: \"{word}\" is not in: {message}");
        }
    }
    assert!(
        !bench.path("x.film").exists() && !bench.path("x.png").exists() && bench.read("text.film") == b"not a film"
    );
}
