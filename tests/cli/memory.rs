//! The account of a run's memory: in `inspect` and the statistics, with `--memory`, and on systems with too little
//! memory.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it memory::NAME`.

use crate::bench::{Bench, PROGRAM, stderr, stdout};
use serde_json::Value;

/// Names of the items of an account.
fn items(account: &Value) -> Vec<String> {
    let items = account["items"].as_array().expect("a list").iter();
    items.map(|item| item["name"].as_str().expect("a name").to_owned()).collect()
}

/// Bytes of an item, in the phase where it has most.
fn most(account: &Value, name: &str) -> u64 {
    let items = account["items"].as_array().expect("a list").iter();
    let item = items.filter(|item| item["name"] == name).flat_map(|item| item["bytes"].as_array().expect("numbers"));
    item.map(|bytes| bytes.as_u64().expect("a number of bytes")).max().unwrap_or(0)
}

#[test]
fn inspect_lists_what_a_render_of_the_job_will_need() {
    let bench = Bench::new();
    let account = |film: &str| {
        bench.write("sized.toml", &format!("scene = \"scene.gltf\"\n[film]\n{film}\n[budget]\nspp = 16\n"));
        let inspection: Value =
            serde_json::from_str(&stdout(&bench.run("inspect sized.toml --json").code(0))).expect("JSON");
        inspection["memory"].clone()
    };
    let small = account("width = 100\nheight = 50");
    let large = account("width = 2000\nheight = 1000");
    assert_eq!(small["phases"], serde_json::json!(["render", "plan", "expose", "denoise", "write"]));
    for account in [&small, &large] {
        let names = items(account);
        for name in ["program", "scene", "film", "planes", "certificate", "exposure", "files", "threads"] {
            assert!(names.iter().any(|n| n == name), "{name} is not among {names:?}");
        }
        // The peak is the sum of the phase that needs most.
        let phases = account["phases"].as_array().expect("a list").len();
        let sum = |phase: usize| -> u64 {
            let items = account["items"].as_array().expect("a list").iter();
            items.map(|item| item["bytes"][phase].as_u64().expect("a number of bytes")).sum()
        };
        assert_eq!((0..phases).map(sum).max(), account["peak_bytes"].as_u64());
    }
    // A film of 400 times the pixels, of which each takes some tens to some hundreds of bytes.
    let pixels = 2_000_000;
    assert!((40 * pixels..500 * pixels).contains(&most(&large, "film")), "{large}");
    assert!(most(&large, "film") > 100 * most(&small, "film"));
    let text = stdout(&bench.run("inspect sized.toml").code(0));
    for part in ["memory [MB]", "render", "film", "sum"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn a_render_beyond_its_limit_does_not_begin() {
    let bench = Bench::new();
    bench
        .write("limited.toml", "scene = \"scene.gltf\"\n[film]\nwidth = 20\nheight = 10\n[budget]\nmemory = \"1MB\"\n");
    bench.write("bad.toml", "scene = \"scene.gltf\"\n[budget]\nmemory = 6\n");
    bench.write("none.toml", "scene = \"scene.gltf\"\n[budget]\nmemory = \"0GB\"\n");
    let before = bench.names();
    for line in [
        "render scene.gltf --width 4096 --height 4096 --spp 1 --memory 500MB",
        "render limited.toml",
        "bench scene.gltf --quick --memory 1MB -o report",
        "ptc scene.gltf --memory 1MB --frames 4 --spp 1,2 -o report",
    ] {
        let said = stderr(&bench.run(line).code(2));
        for part in ["more than the limit", "memory [MB]", "film", "sum", "help:"] {
            assert!(said.contains(part), "{line}: {part}: {said}");
        }
    }
    for (line, part) in [
        ("render scene.gltf --memory 6", "lacks a unit"),
        ("render scene.gltf --memory 0GB", "out of range"),
        ("render scene.gltf --memory=-1GB", "out of range"),
        ("render scene.gltf --memory 6parsecs", "unknown unit"),
        ("render bad.toml", "[budget] memory"),
        ("render none.toml", "[budget] memory"),
    ] {
        let said = stderr(&bench.run(line).code(2));
        assert!(said.contains(part), "{line}: {said}");
    }
    let after = bench.names();
    assert!(after.difference(&before).all(|name| name == "report"), "{after:?}");
    // The flag wins over the job.
    bench.run("render limited.toml --spp 1 --memory 4GB -o large-enough.png").code(0);
}

#[test]
fn the_statistics_hold_the_account_and_what_was_measured() {
    let bench = Bench::new();
    let flags = "--width 700 --height 500 --spp 8 --denoise builtin --exr a.exr -o a.png --stats a.json";
    bench.run(&format!("render scene.gltf {flags}")).code(0);
    let memory = bench.json("a.json")["memory"].clone();
    let expected = memory["peak_bytes"].as_u64().expect("a number of bytes");
    assert!(items(&memory).iter().any(|name| name == "denoiser"), "{memory}");
    if cfg!(target_os = "linux") {
        let measured = memory["measured_bytes"].as_u64().expect("Linux says so");
        // All sums of the film were touched at least.
        assert!(measured > most(&memory, "film") / 2, "{memory}");
        assert!(measured < 2 * expected, "{memory}");
    }
    let film = memory["film_bytes"].as_u64().expect("a number of bytes");
    assert!(film > 0 && film <= most(&memory, "film") && film <= 192 * 700 * 500, "{memory}");
}

/// Address space of the process is bounded, as on a system that has no more.
#[cfg(target_os = "linux")]
mod bounded {
    use super::*;
    use assert_cmd::Command;
    use assert_cmd::assert::Assert;

    /// Runs the program in the folder with so many kilobytes of address space.
    fn run_within(bench: &Bench, kilobytes: u64, line: &str) -> Assert {
        let script = format!("ulimit -v {kilobytes} && exec {PROGRAM} {line}");
        Command::new("sh").current_dir(bench.folder.path()).args(["-c", &script]).assert()
    }

    #[test]
    fn a_render_that_does_not_fit_ends_with_its_account() {
        let bench = Bench::new();
        let before = bench.names();
        let line = "render scene.gltf --width 4096 --height 4096 --spp 1 --threads 2";
        let said = stderr(&run_within(&bench, 1_000_000, line).code(2));
        for part in ["which this system does not have", "memory [MB]", "film", "sum", "help:"] {
            assert!(said.contains(part), "{part}: {said}");
        }
        assert_eq!(bench.names(), before);
        run_within(&bench, 1_000_000, "render scene.gltf --width 64 --height 64 --spp 1 --threads 2 -o a.png").code(0);
    }
}
