//! The program killed with SIGKILL at random moments, in every command that writes for long: no file is torn, the next run
//! ends as one that was left alone, and nothing is left behind.
//!
//! The moments are shares of the time that the command takes. `DUNKELFELD_KILLS=200` kills each command so many times.
//! Replay: `cargo test -p dunkelfeld-cli --test it kills::NAME`.
#![allow(clippy::print_stderr, reason = "the counts are for the table in docs/checkpoints.md")]

use crate::lab::{Lab, square};
use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const PROGRAM: &str = env!("CARGO_BIN_EXE_dunkelfeld");

/// A command, and what it leaves.
struct Case {
    name: &'static str,
    line: &'static str,
    /// Run once, before all else.
    before: &'static [&'static str],
    /// Files and folders that it writes; they are deleted to begin anew.
    writes: &'static [&'static str],
    /// Is the command refused once its work is done?
    is_written_once: bool,
    /// Endings of those files whose bytes do not depend on the clock.
    same: &'static [&'static str],
}

const CASES: [Case; 5] = [
    Case {
        name: "render",
        line: "render <scene>.obj --width 96 --height 80 --spp 90 --threads 2 --progress none \
               --checkpoint a.film --checkpoint-every 0s -o a.png --exr a.exr --stats a.json",
        before: &[],
        writes: &["a.film", "a.png", "a.exr", "a.json"],
        is_written_once: false,
        same: &[".png", ".exr"],
    },
    Case {
        name: "merge",
        line: "merge p.film q.film --checkpoint whole.film -o whole.png --exr whole.exr",
        before: &[
            "render <scene>.obj --width 160 --height 120 --samples 0..2 --progress none --checkpoint p.film -o p.png",
            "render <scene>.obj --width 160 --height 120 --samples 2..4 --progress none --checkpoint q.film -o q.png",
        ],
        writes: &["whole.film", "whole.png", "whole.exr"],
        is_written_once: false,
        same: &[".png", ".exr", ".film"],
    },
    Case {
        name: "bench",
        line: "bench <scene>.obj --quick --width 20 --height 14 --spp 2,4 --seeds 4 --progress none -o out",
        before: &[],
        writes: &["out"],
        is_written_once: false,
        same: &[".exr"],
    },
    Case {
        name: "ptc",
        line: "ptc <scene>.obj --width 24 --height 16 --frames 5 --spp 4,16 --denoise off --progress none -o out",
        before: &[],
        writes: &["out"],
        is_written_once: false,
        same: &[".exr", ".svg", "lines.csv"],
    },
    Case {
        name: "emva dataset",
        line: "emva dataset --sensor imx250 -o set --size 48x40 --levels 20 --spatial 4 --seed 3 --progress none",
        before: &[],
        writes: &["set"],
        is_written_once: true,
        same: &[".png", ".txt", ".json"],
    },
];

fn lab() -> Lab {
    let objects = square(1.0, 0.0, false) + &square(0.2, 0.3, false) + &square(0.5, 1.0, true);
    let faces = "usemtl floor\nf 1 2 3 4\nf 5 6 7 8\nusemtl lamp\nf 9 10 11 12\n";
    Lab::new(&(objects + faces), "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 3 3 3\n")
}

/// Kills per command.
fn kills() -> u32 {
    std::env::var("DUNKELFELD_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(4)
}

/// Shares of a duration: multiples of the golden ratio (Weyl 1916), early and late, the same in every run.
fn moments() -> impl Iterator<Item = f64> {
    (1u32..).map(|i| f64::from(i.wrapping_mul(0x9e37_79b9)) / f64::from(u32::MAX))
}

/// Starts the program. Its few lines on standard error stay in the pipe.
fn start(lab: &Lab, line: &str) -> Child {
    let mut command = Command::new(PROGRAM);
    command.current_dir(lab.path(".")).args(line.split_whitespace());
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the program starts")
}

/// All files below a folder, by their paths in it.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    let Ok(entries) = fs::read_dir(folder) else { return all };
    for entry in entries {
        let path = entry.expect("readable").path();
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        if path.is_dir() {
            all.extend(files(&path).into_iter().map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            all.insert(name, fs::read(&path).expect("readable"));
        }
    }
    all
}

fn is_leftover(name: &str) -> bool {
    name.contains(".partial") || name.ends_with(".lock")
}

/// Is a file complete and of the format of its ending?
fn is_whole(lab: &Lab, name: &str, bytes: &[u8]) -> bool {
    let path = lab.path(name);
    match path.extension().and_then(|e| e.to_str()).unwrap_or_default() {
        "film" => dunkelfeld_io::checkpoint::read_checkpoint(&path).is_ok(),
        "exr" => dunkelfeld_io::exr::read_exr(&path).is_ok(),
        "png" => bytes.starts_with(b"\x89PNG") && bytes.ends_with(b"IEND\xaeB`\x82"),
        "json" => serde_json::from_slice::<serde_json::Value>(bytes).is_ok(),
        "svg" => bytes.trim_ascii_end().ends_with(b"</svg>"),
        "html" => bytes.trim_ascii_end().ends_with(b"</html>"),
        "csv" => bytes.ends_with(b"\r\n"),
        _ => !bytes.is_empty(),
    }
}

fn forget(lab: &Lab, names: &[&str]) {
    for name in names {
        let path = lab.path(name);
        if path.is_dir() {
            fs::remove_dir_all(path).expect("removable");
        } else {
            let _ = fs::remove_file(path);
        }
    }
}

/// Kills one command again and again, and holds what it leaves against `reference`.
fn kill_again_and_again(case: &Case) {
    let lab = lab();
    for line in case.before {
        lab.run(line).code(0);
    }
    let began = Instant::now();
    lab.run(case.line).code(0);
    let duration = began.elapsed();
    let reference = files(&lab.path("."));
    assert!(!reference.keys().any(|name| is_leftover(name)), "{}: {:?}", case.name, reference.keys());
    let is_same = |name: &str| case.same.iter().any(|end| name.ends_with(end));

    forget(&lab, case.writes);
    let (mut killed, mut finished, mut with_leftovers) = (0, 0, 0);
    for share in moments() {
        if killed == kills() || finished > 20 * kills() {
            break;
        }
        let mut child = start(&lab, case.line);
        let (began, moment) = (Instant::now(), duration.mul_f64(1.05 * share));
        let mut status = None;
        while status.is_none() && began.elapsed() < moment {
            std::thread::sleep(Duration::from_millis(1).min(moment.saturating_sub(began.elapsed())));
            status = child.try_wait().expect("it is ours");
        }
        // SIGKILL on Unix: nothing of the program runs after it.
        let _ = child.kill();
        let ended = child.wait().expect("it is ours");
        let there = files(&lab.path("."));
        let what = format!("{}, {killed} kills, at {share:.3} of {duration:?}", case.name);
        for (name, bytes) in there.iter().filter(|(name, _)| !is_leftover(name)) {
            assert!(is_whole(&lab, name, bytes), "{what}: {name} is torn, {} bytes", bytes.len());
            if is_same(name) {
                assert!(reference.get(name) == Some(bytes), "{what}: {name} is another one");
            }
        }
        if ended.success() {
            assert_eq!(
                there.keys().collect::<Vec<_>>(),
                reference.keys().collect::<Vec<_>>(),
                "{what}: files at the end"
            );
            finished += 1;
            forget(&lab, case.writes);
        } else {
            let mut said = String::new();
            let _ = child.stderr.take().map(|mut pipe| pipe.read_to_string(&mut said));
            assert_eq!(ended.code(), None, "{what}: it ended by itself: {said}");
            killed += 1;
            with_leftovers += u32::from(there.keys().any(|name| is_leftover(name)));
            // Killed with all of its work done: a complete data set is not written again.
            if case.is_written_once && lab.path(case.writes[0]).exists() {
                forget(&lab, case.writes);
            }
        }
    }
    assert!(killed > 0, "{}: too quick to be killed", case.name);
    lab.run(case.line).code(0);
    let after = files(&lab.path("."));
    assert_eq!(after.keys().collect::<Vec<_>>(), reference.keys().collect::<Vec<_>>(), "{}: files", case.name);
    for (name, bytes) in after.iter().filter(|(name, _)| is_same(name)) {
        assert!(reference.get(name) == Some(bytes), "{}: {name} differs after {killed} kills", case.name);
    }
    eprintln!(
        "{}: {killed} kills within {duration:?}, {with_leftovers} left partial or lock files; {finished} runs ended before",
        case.name
    );
}

#[test]
fn killed_renders_leave_whole_files_and_end_as_if_left_alone() {
    kill_again_and_again(&CASES[0]);
}

#[test]
fn killed_merges_leave_whole_files_or_none() {
    kill_again_and_again(&CASES[1]);
}

#[test]
fn a_killed_bench_leaves_whole_files_and_continues() {
    kill_again_and_again(&CASES[2]);
}

#[test]
fn a_killed_photon_transfer_leaves_whole_files_and_continues() {
    kill_again_and_again(&CASES[3]);
}

#[test]
fn a_killed_data_set_is_there_whole_or_not_at_all() {
    kill_again_and_again(&CASES[4]);
}

/// One of two renders on one checkpoint is refused; when both are killed, the file is whole, and the render goes on.
#[test]
fn two_renders_on_one_checkpoint_never_tear_it() {
    let lab = lab();
    let case = &CASES[0];
    let began = Instant::now();
    lab.run(case.line).code(0);
    let duration = began.elapsed();
    let reference = files(&lab.path("."));
    forget(&lab, case.writes);
    let (mut kept, mut refused) = (0, 0);
    let rounds = (kills() / 8).max(3);
    for share in moments().take(rounds as usize) {
        let pair = [start(&lab, case.line), start(&lab, case.line)];
        std::thread::sleep(duration.mul_f64(0.1 + 0.5 * share));
        for mut child in pair {
            let _ = child.kill();
            refused += u32::from(child.wait().expect("it is ours").code() == Some(2));
        }
        let path = lab.path("a.film");
        if path.exists() {
            kept += 1;
            dunkelfeld_io::checkpoint::read_checkpoint(&path).unwrap_or_else(|e| panic!("{e}"));
        }
    }
    assert!(refused > 0, "two renders wrote one checkpoint");
    lab.run(case.line).code(0);
    let after = files(&lab.path("."));
    assert_eq!(after.keys().collect::<Vec<_>>(), reference.keys().collect::<Vec<_>>());
    assert!(["a.exr", "a.png"].iter().all(|name| after.get(*name) == reference.get(*name)));
    eprintln!("two renders on one checkpoint: {rounds} rounds, {kept} with a checkpoint, {refused} refusals");
}
