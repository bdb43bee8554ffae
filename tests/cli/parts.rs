//! A render that is interrupted leaves its checkpoint, and parts of several processes merge to the whole: the files are those
//! of a run that was left alone, byte by byte.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it parts::NAME`.

use crate::bench::{Bench, PROGRAM, stderr, stdout};
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

/// Ctrl-C, as `kill -INT` sends it: no checkpoint was due by then.
#[cfg(unix)]
#[test]
fn an_interrupted_render_leaves_its_checkpoint_and_continues() {
    let bench = Bench::new();
    let base = "render scene.obj --width 96 --height 80 --seed 5 --spp 300 --threads 1";
    let kept = format!("{base} --checkpoint a.film --checkpoint-every 1h -o b.png --exr b.exr");
    let mut child = Command::new(PROGRAM)
        .current_dir(bench.folder.path())
        .args(kept.split_whitespace())
        .args(["--progress", "json"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut progress = BufReader::new(child.stderr.take().expect("a pipe")).lines();
    assert_eq!(progress.by_ref().take(4).count(), 4, "it runs");
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("there is a kill");
    assert!(sent.success());
    // Reads to the end: otherwise the pipe would be full.
    let _ = progress.count();
    assert_eq!(child.wait().expect("it ends").code(), Some(130));
    let said = bench.run(&format!("{kept} --stats b.json")).code(0);
    assert!(stdout(&said).contains("continued from a checkpoint"), "{}", stdout(&said));
    bench.run(&format!("{base} -o a.png --exr a.exr")).code(0);
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
        ("merge a.film text.film -o x.png", &["text.film", "help:"]),
        ("merge a.film b.film -o x.film", &["x.film", ".png", "help:"]),
        ("merge -o x.png", &["PART"]),
        ("merge a.film", &["--output"]),
        ("render scene.obj --seed 6 --width 40 --height 30 --samples 0..10 --checkpoint a.film", &["seed", "help:"]),
        ("render scene.obj --samples 0..10", &["--checkpoint"]),
        ("render scene.obj --samples 10..10 --checkpoint x.film", &["--samples", "0..64"]),
        ("render scene.obj --samples 0..10 --spp 3 --checkpoint x.film", &["--samples", "--spp"]),
        ("render scene.obj --checkpoint-every 5s", &["--checkpoint"]),
        ("render scene.obj --checkpoint x.png -o x.png", &["x.png", "checkpoint", "help:"]),
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
