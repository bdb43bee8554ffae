//! Faults of the machine as the program meets them: a full disk behind standard output, a limit on the size of files, folders
//! that cannot be written, a checkpoint that another process works on. What fails operation by operation is tested in
//! `crates/job/io/tests/it/faults.rs`.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it machine_faults::NAME`.
#![cfg(unix)]

use crate::lab::{Lab, complaint, square};
use std::collections::BTreeSet;
use std::fs;
use std::io::Read;
use std::process::{Command, Stdio};

const PROGRAM: &str = env!("CARGO_BIN_EXE_dunkelfeld");

fn lab() -> Lab {
    let objects = square(1.0, 0.0, false) + &square(0.5, 1.0, true);
    let faces = "usemtl floor\nf 1 2 3 4\nusemtl lamp\nf 5 6 7 8\n";
    Lab::new(&(objects + faces), "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 3 3 3\n")
}

const SMALL: &str = "render <scene>.obj --width 32 --height 32 --spp 4 --progress none";

/// Standard output cannot be written: an error, exit code 2. A reader that has closed the pipe is no error.
#[test]
fn standard_output_that_cannot_be_written_is_an_error() {
    let lab = lab();
    lab.run(&format!("{SMALL} -o a.png --exr a.exr")).code(0);
    lab.run("render <scene>.obj --width 32 --height 32 --samples 0..4 --progress none --checkpoint p.film").code(0);
    let set = "emva dataset --sensor imx250 -o set --size 16x16 --levels 10 --spatial 3 --progress none";
    let lines = [
        "sensors",
        "sensors --json",
        "sensors imx250",
        "sensors imx250 --json",
        "inspect <scene>.obj",
        "inspect <scene>.obj --json",
        "--help",
        "render --help",
        "--version",
        &format!("{SMALL} -o b.png"),
        "render <scene>.obj --width 32 --height 32 --debug-sample 1,1,0",
        "merge p.film -o m.png",
        "denoise a.exr -o d.exr",
        "expose a.exr --sensor imx250 -o e.png",
        set,
        "emva analyse set/emva.txt",
    ];
    for line in lines {
        let full = fs::OpenOptions::new().write(true).open("/dev/full").expect("there is such a device");
        let words = line.split_whitespace();
        let run =
            Command::new(PROGRAM).current_dir(lab.path(".")).args(words).stdout(full).output().expect("it starts");
        let said = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(2), "{line}: {said}");
        assert!(said.contains("standard output") && said.contains("help:"), "{line}: {said}");
    }
    assert!(lab.path("b.png").exists() && lab.path("m.png").exists() && lab.path("set/truth.json").exists());

    let mut child = Command::new(PROGRAM)
        .args(["sensors", "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts");
    drop(child.stdout.take());
    let mut said = String::new();
    child.stderr.take().expect("a pipe").read_to_string(&mut said).expect("text");
    assert_eq!((child.wait().expect("it ends").code(), said.as_str()), (Some(0), ""));
}

/// A limit on the size of files: the write fails, the program prints an error, and the previous file stays.
#[test]
fn a_limit_on_the_size_of_files_is_an_error_and_no_torn_file() {
    let lab = lab();
    fs::write(lab.path("big.exr"), "old").expect("writable");
    let before = lab.names(".");
    // Blocks of 512 or 1024 bytes, by the shell.
    let script = format!("ulimit -f 8; exec \"$0\" {} -o a.png --exr big.exr", SMALL.replace("<scene>", "'<scene>'"));
    let line = script.replace("--width 32 --height 32", "--width 64 --height 64");
    let run = Command::new("sh").current_dir(lab.path(".")).args(["-c", &line, PROGRAM]).output().expect("a shell");
    let said = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(2), "{:?}: {said}", run.status);
    for words in ["big.exr", "limit", "help:"] {
        assert!(said.contains(words), "{words}: {said}");
    }
    assert_eq!(lab.read("big.exr"), "old");
    let new: BTreeSet<_> = lab.names(".").difference(&before).cloned().collect();
    assert!(new.iter().all(|name| name == "a.png"), "{new:?}");
}

/// A checkpoint that cannot be written on the way does not end the render; it is flagged, and nothing torn is left.
#[test]
fn a_checkpoint_that_cannot_be_written_is_flagged() {
    let lab = lab();
    let line = "ulimit -f 32; exec \"$0\" render '<scene>.obj' --width 64 --height 64 --spp 4 --progress none -o a.png \
                --checkpoint a.film --checkpoint-every 0s";
    let run = Command::new("sh").current_dir(lab.path(".")).args(["-c", line, PROGRAM]).output().expect("a shell");
    let said = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(1), "{:?}: {said}", run.status);
    assert!(said.contains("a.film") && said.contains("limit"), "{said}");
    let names = lab.names(".");
    assert!(names.contains("a.png") && !names.iter().any(|n| n.contains("a.film")), "{names:?}");
}

/// The second of two renders on one checkpoint is refused before it reads the scene; so is any other command that would write it.
#[test]
fn a_checkpoint_in_use_is_refused_and_states_who_has_it() {
    let lab = lab();
    let long = "render <scene>.obj --width 64 --height 64 --spp 100000 --progress json -o a.png --checkpoint a.film";
    let mut first = Command::new(PROGRAM)
        .current_dir(lab.path("."))
        .args(long.split_whitespace())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts");
    // It reports before it loads anything, and has the lock by then.
    let mut byte = [0];
    first.stderr.as_mut().expect("a pipe").read_exact(&mut byte).expect("a report");
    let process = format!("process {}", first.id());
    for line in [
        "render <scene>.obj --progress none -o b.png --checkpoint a.film",
        "render no-such-scene.obj --progress none -o b.png --checkpoint ./a.film",
    ] {
        let said = complaint(&lab.run(line).code(2));
        for words in ["a.film", "in use", &process, "since", "help:"] {
            assert!(said.contains(words), "{line}: {words} is not in {said}");
        }
    }
    first.kill().expect("it is ours");
    first.wait().expect("it is ours");
    assert!(lab.path("a.film.lock").exists(), "the lock file of a killed process stays");
    lab.run("render <scene>.obj --width 32 --height 32 --spp 2 --progress none -o b.png --checkpoint a.film").code(0);
    let names = lab.names(".");
    assert!(!names.iter().any(|n| n.ends_with(".lock") || n.contains(".partial")), "{names:?}");
}
