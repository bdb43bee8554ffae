//! The program from the command line: inputs, outputs, exit codes. No test depends on the clock.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it commands::NAME`.

use crate::bench::{Bench, PROGRAM, stderr, stdout};
use assert_cmd::Command;
use dunkelfeld_io::exr::read_exr;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// The data of a PNG's first chunk of a kind.
fn chunk<'a>(png: &'a [u8], kind: &[u8; 4]) -> Option<&'a [u8]> {
    let mut rest = png.strip_prefix(b"\x89PNG\r\n\x1a\n").expect("a PNG");
    while let Some((head, tail)) = rest.split_at_checked(8) {
        let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
        if head[4..] == kind[..] {
            return tail.get(..length);
        }
        rest = tail.get(length + 4..)?;
    }
    None
}

/// Width, height, bit depth and colour type of a PNG.
fn header(png: &[u8]) -> (u32, u32, u8, u8) {
    let h = chunk(png, b"IHDR").expect("a header");
    let number = |at: usize| u32::from_be_bytes([h[at], h[at + 1], h[at + 2], h[at + 3]]);
    (number(0), number(4), h[8], h[9])
}

#[test]
fn a_render_writes_all_outputs_well_formed() {
    let bench = Bench::new();
    let outputs = ["-o", "a.png", "--linear", "a.tif", "--exr", "a.exr", "--stats", "a.json", "--plan", "plan.exr"];
    let render = ["render", "scene.gltf", "--width", "24", "--height", "16", "--spp", "20", "--seed", "7"];
    let run = bench.run_words(&[&render[..], &outputs[..]].concat()).code(0);
    for file in ["a.png", "a.tif", "a.exr", "a.json", "plan.exr"] {
        assert!(stdout(&run).contains(&format!("wrote {file}")), "{}", stdout(&run));
    }
    assert!(!bench.names().iter().any(|n| n.contains("partial")), "{:?}", bench.names());

    let png = bench.read("a.png");
    assert_eq!(header(&png), (24, 16, 8, 0), "grey, as the image of a monochrome sensor");
    assert_eq!(chunk(&png, b"gAMA"), Some(&45_455u32.to_be_bytes()[..]), "1 / 2.2");
    assert_eq!(&bench.read("a.tif")[..2], b"II");

    let layers = read_exr(&bench.path("a.exr")).expect("an EXR");
    let names: BTreeSet<&str> = layers.channels.iter().map(|(name, _)| name.as_str()).collect();
    let expected = "R G B first_light.R first_light.G first_light.B variance.R variance.G variance.B \
                    covariance.RG covariance.RB covariance.GB spp.Y \
                    albedo.R albedo.G albedo.B normal.X normal.Y normal.Z \
                    albedo.variance.R albedo.variance.G albedo.variance.B normal.variance.X normal.variance.Y \
                    normal.variance.Z depth.Z depth.variance.Z scatter.Y scatter.largest id.object id.material \
                    electrons.Y hidden.Y";
    assert_eq!(names, expected.split_whitespace().collect());
    assert_eq!((layers.width, layers.height), (24, 16));
    assert!(bench.floats("a.exr", "R").iter().any(|&v| v > 0.0), "the lamp lights the floor");
    assert!(bench.floats("a.exr", "variance.G").iter().all(|&v| v >= 0.0 && v.is_finite()));

    let plan = dunkelfeld::outputs::load_plan(&bench.path("plan.exr")).expect("a plan");
    assert_eq!((plan.seed, plan.frame), (Some(7), Some(0)));
    assert_eq!(plan, dunkelfeld::outputs::load_plan(&bench.path("a.exr")).expect("the same plan"));
    let samples: u64 = plan.samples.data().iter().map(|&n| u64::from(n)).sum();
    assert_eq!(samples, 20 * 24 * 16, "--spp is the mean");

    let stats = bench.json("a.json");
    assert_eq!(
        (&stats["version"], &stats["stop"], &stats["allocation"]),
        (&3.into(), &"samples".into(), &"sensor".into())
    );
    assert_eq!((&stats["seed"], &stats["samples"], &stats["mean_spp"]), (&7.into(), &samples.into(), &20.0.into()));
    assert_eq!(stats["size"], serde_json::json!([24, 16]));
    assert!(stats["budget_seconds"].is_null() && stats["budget_missed"] == false);
    for stage in ["load", "build", "pilot", "plan", "refine", "expose", "write"] {
        assert!(stats["seconds"][stage].as_f64().is_some_and(|s| s >= 0.0), "{stage}: {}", stats["seconds"]);
    }
}

/// A plan contains the number of training paths, so that a replay has the same samples.
#[test]
fn training_changes_the_samples_and_a_replay_repeats_it() {
    let bench = Bench::new();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/references/all-kinds-of-light.toml");
    let render = format!("render {scene} --width 128 --height 128 --spp 2");
    bench.run(&format!("{render} --without learned-roulette --exr plain.exr -o plain.png")).code(0);
    bench.run(&format!("{render} --threads 1 --exr one.exr --plan plan.exr --stats one.json -o one.png")).code(0);
    bench.run(&format!("render {scene} --replay plan.exr --threads 3 --exr replay.exr -o replay.png")).code(0);
    assert_ne!(bench.floats("plain.exr", "R"), bench.floats("one.exr", "R"), "training has an effect");
    assert_eq!(bench.floats("one.exr", "R"), bench.floats("replay.exr", "R"));
    let stats = bench.json("one.json");
    assert_eq!(stats["training_paths"], 1024);
    assert!(stats["seconds"]["training"].as_f64().is_some_and(|s| s >= 0.0), "{}", stats["seconds"]);
}

/// Every output names the effects that are left out. For a technique it states that the image is the same.
#[test]
fn left_out_effects_mark_the_outputs() {
    let bench = Bench::new();
    bench.write("two.toml", "scene = \"scene.gltf\"\n[environment]\nradiance = 1\n");
    let inspect = stdout(&bench.run("inspect two.toml").code(0));
    let line = |name: &str| inspect.lines().find(|l| l.trim_start().starts_with(name)).map(str::to_owned);
    assert!(line("every-light").is_some_and(|l| l.ends_with("2 lights")), "{inspect}");
    assert!(line("environment").is_some(), "{inspect}");

    for (name, words) in
        [("every-light", "another way to the same image"), ("environment", "not the image of the scene as it is")]
    {
        let render = "render two.toml --width 8 --height 6 --spp 2 -o a.png --stats a.json --without";
        let run = bench.run(&format!("{render} {name}")).code(0);
        assert!(stdout(&run).contains(&format!("without {name}: {words}")), "{}", stdout(&run));
        assert_eq!(bench.json("a.json")["without"], serde_json::json!([name]));
        let marked = format!("rendered without {name}");
        assert!(bench.read("a.png").windows(marked.len()).any(|w| w == marked.as_bytes()), "the PNG does not say so");
    }
}

#[test]
fn invalid_samples_flag_the_result_and_the_command_that_is_named_replays_one() {
    let bench = Bench::new();
    let size = ["--width", "12", "--height", "9", "--spp", "4", "--seed", "3", "--frame", "2"];
    let line = [&["render", "too bright.obj"][..], &size[..], &["--stats", "a.json"][..]].concat();
    let run = bench.run_words(&line).code(1);
    let stats = bench.json("a.json");
    let invalid = stats["invalid_samples"].as_u64().expect("a number");
    assert!(invalid > 0 && bench.path("too bright.png").exists());
    let message = stderr(&run);
    assert!(message.contains(&format!("flagged: {invalid} samples")), "{message}");
    let named = stats["invalid_named"][0].as_str().expect("a sample is named");
    let command = message.split_once("to replay one: ").expect("a command").1.lines().next().expect("a line");
    assert!(command.contains("'too bright.obj'") && command.ends_with(&format!("--debug-sample {named}")), "{command}");
    // As typed into a shell.
    #[cfg(unix)]
    {
        let shell = Command::new("sh").current_dir(bench.folder.path()).args(["-c", command]).assert().code(1);
        assert!(stdout(&shell).contains("this sample is invalid"), "{}", stdout(&shell));
    }
}

#[test]
fn a_timed_render_stops_by_time_and_is_replayed_to_the_last_bit() {
    let bench = Bench::new();
    // A busy machine may miss the budget, which is a warning.
    let line = "render scene.gltf --width 48 --height 32 --seed 11 --frame 4 --time 0.7s";
    let run = bench.run(&format!("{line} -o timed.png --exr timed.exr --stats timed.json --plan plan.exr"));
    run.code(0);
    let stats = bench.json("timed.json");
    assert_eq!((&stats["stop"], &stats["budget_seconds"]), (&"time".into(), &0.7.into()));
    assert!(stats["samples"].as_u64() >= Some(48 * 32 / 16), "a preview at least");
    // Size, seed and frame come with the plan; either file will do, on any number of threads.
    for (plan, threads) in [("timed.exr", 1), ("plan.exr", 3)] {
        let line = format!("render scene.gltf --replay {plan} --threads {threads} -o r.png --exr r.exr --stats r.json");
        bench.run(&line).code(0);
        assert!(bench.read("r.exr") == bench.read("timed.exr"), "replaying {plan} gives another EXR");
        assert!(bench.read("r.png") == bench.read("timed.png"), "replaying {plan} gives another image");
        let replayed = bench.json("r.json");
        assert_eq!((&replayed["allocation"], &replayed["samples"]), (&"replay".into(), &stats["samples"]));
    }
}

/// A budget that is too small for an image still gives one, of a sample for every sixteenth pixel, with a message.
#[test]
fn pixels_without_samples_show_their_neighbours_and_are_reported() {
    let bench = Bench::new();
    let render = "render scene.gltf --width 96 --height 64 --allocate uniform";
    let check = |name: &str| {
        let plan = dunkelfeld::outputs::load_plan(&bench.path(&format!("{name}.exr"))).expect("a plan");
        let gaps = plan.samples.data().iter().filter(|&&n| n == 0).count();
        assert_eq!(gaps, 96 * 64 * 15 / 16, "one sample for sixteen pixels");
        assert_eq!(bench.json(&format!("{name}.json"))["pixels_without_samples"].as_u64(), Some(gaps as u64));
    };
    let run = bench.run(&format!("{render} --time 1ms -o a.png --exr a.exr --stats a.json")).code(1);
    assert!(stderr(&run).contains("flagged: 93.8 % of pixels have no sample"), "{}", stderr(&run));
    check("a");
    // As a number of samples it is no fault, and a replay fills the same gaps.
    let run = bench.run(&format!("{render} --spp 0.0625 -o b.png --exr b.exr --stats b.json")).code(0);
    assert!(stderr(&run).contains("warning: 93.8 % of pixels have no sample"), "{}", stderr(&run));
    check("b");
    bench.run("render scene.gltf --replay a.exr -o c.png").code(0);
    assert!(bench.read("c.png") == bench.read("a.png"));
    // The picture is filled, the layer of the mean is not.
    let lit = |layer: &str| bench.floats("a.exr", layer).into_iter().filter(|&v| v > 0.0).count();
    assert!(lit("R") > 0 && lit("electrons.Y") >= 8 * lit("R"), "{} of {}", lit("electrons.Y"), lit("R"));
}

#[test]
fn a_render_can_end_when_the_sensor_hides_its_noise() {
    let bench = Bench::new();
    // A lit floor under a lens so fast that every pixel has thousands of electrons.
    let run = bench
        .run("render scene.gltf --width 16 --height 12 --noise 0.5 --progress json --exr a.exr --stats a.json")
        .code(0);
    let (stats, said) = (bench.json("a.json"), stdout(&run));
    assert_eq!((&stats["stop"], &stats["allocation"]), (&"noise".into(), &"sensor".into()));
    let c = &stats["certificate"];
    assert!(c["k"] == 0.5 && c["is_hidden"] == true && c["hidden"].as_f64().is_some_and(|h| h >= 0.99), "{c}");
    assert!(
        said.contains("hidden, the camera would not show the difference")
            && said.contains("at most 0.5 times")
            && said.contains("the forecast was"),
        "{said}"
    );
    // The layer agrees with the certificate: nothing is saturated here.
    let ratios = bench.floats("a.exr", "hidden.Y");
    let hidden = ratios.iter().filter(|r| **r <= 0.25).count() as f64 / ratios.len() as f64;
    assert_eq!(c["saturated"], 0);
    assert!((hidden - c["hidden"].as_f64().expect("a number")).abs() < 1e-9, "{hidden} against {c}");
    let levels: Vec<f64> =
        stats["forecast"].as_array().expect("levels").iter().filter_map(|l| l["k"].as_f64()).collect();
    assert_eq!(levels, [1.0, 0.7, 0.5, 0.25]);
    // With several rules the first to be met stops.
    bench.run("render scene.gltf --width 16 --height 12 --noise 0.001 --spp 20 --stats b.json").code(0);
    let stats = bench.json("b.json");
    assert!(stats["stop"] == "samples" && stats["mean_spp"] == 20.0 && stats["certificate"]["is_hidden"] == false);
}

#[test]
fn a_job_is_obeyed_and_flags_win_over_it() {
    let bench = Bench::new();
    bench.run("render job.toml --stats a.json").code(0);
    let stats = bench.json("a.json");
    assert_eq!(header(&bench.read("job.png")), (20, 10, 8, 0));
    assert_eq!((&stats["mean_spp"], &stats["allocation"]), (&3.0.into(), &"sensor".into()));
    // A job without a sensor has the default sensor, as a scene has.
    bench.run("render scene.gltf --width 20 --height 10 --spp 3 -o b.png --stats b.json").code(0);
    assert_eq!(stats["sensor"]["name"], bench.json("b.json")["sensor"]["name"]);
    assert!(bench.read("job.png") == bench.read("b.png"), "the job and the same flags give other images");
    let line =
        "render job.toml --width 5 --spp 2 --allocate uniform --sensor none --camera far -o c.png --stats c.json";
    bench.run(line).code(0);
    let stats = bench.json("c.json");
    assert_eq!(header(&bench.read("c.png")), (5, 10, 8, 2));
    assert!(stats["mean_spp"] == 2.0 && stats["allocation"] == "uniform" && stats["sensor"].is_null());
}

#[test]
fn a_sample_is_traced_to_the_radiance_that_the_image_has() {
    let bench = Bench::new();
    bench.run("render scene.gltf --width 1 --height 1 --spp 1 --seed 9 -o a.png --exr a.exr").code(0);
    let traced = stdout(&bench.run("render scene.gltf --width 1 --height 1 --seed 9 --debug-sample 0,0,0").code(0));
    let last = traced.lines().last().and_then(|l| l.strip_prefix("radiance ")).expect("the radiance");
    let radiance: Vec<f32> = last.split_whitespace().map_while(|v| v.parse().ok()).collect();
    assert_eq!(radiance, ["R", "G", "B"].map(|c| bench.floats("a.exr", c)[0]), "{traced}");
    assert!(!bench.path("scene.png").exists(), "tracing writes no image");
    // Each direction is named with its lobe; the floor has a diffuse and a glossy one.
    let mut diffuse = 0;
    for index in 0..16 {
        let line = format!("render scene.gltf --width 1 --height 1 --seed 9 --debug-sample 0,0,{index}");
        let traced = stdout(&bench.run(&line).code(0));
        for line in traced.lines().filter(|l| l.trim_start().starts_with("scattered ")) {
            let lobe = line.split(", ").find_map(|part| part.strip_prefix("lobe "));
            assert!(matches!(lobe, Some("diffuse reflection" | "glossy reflection")), "{line}");
            diffuse += u32::from(lobe == Some("diffuse reflection"));
        }
    }
    assert!(diffuse > 0, "no sample was scattered diffusely");
}

/// Tests with signals and pipes.
#[cfg(unix)]
mod processes {
    use super::*;
    use std::io::{BufRead, BufReader, Read};
    use std::process::{Child, Stdio};

    fn start(folder: &Path, line: &str) -> Child {
        std::process::Command::new(PROGRAM)
            .current_dir(folder)
            .args(line.split_whitespace())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts")
    }

    #[test]
    fn an_interrupted_render_writes_its_image_and_statistics_and_ends_with_130() {
        for signal in ["INT", "TERM"] {
            let bench = Bench::new();
            let line = "render scene.gltf --width 32 --height 32 --time 1h --progress json -o a.png --stats a.json --exr a.exr";
            let mut child = start(bench.folder.path(), line);
            let mut messages = BufReader::new(child.stderr.take().expect("piped"));
            // The first rounds are small: after a hundred samples per pixel there is something to be kept.
            let mut samples = 0;
            while samples < 100 * 32 * 32 {
                let mut message = String::new();
                assert!(messages.read_line(&mut message).expect("readable") > 0, "ended before it was interrupted");
                samples = serde_json::from_str::<Value>(&message).expect("JSON")["samples"].as_u64().expect("a number");
            }
            let kill = format!("kill -{signal} {}", child.id());
            assert!(std::process::Command::new("sh").args(["-c", &kill]).status().expect("a shell").success());
            let mut rest = String::new();
            messages.read_to_string(&mut rest).expect("readable");
            assert_eq!(child.wait().expect("ends").code(), Some(130), "SIG{signal}: {rest}");
            assert!(rest.contains("interrupted"), "{rest}");
            assert_eq!(bench.json("a.json")["stop"], "interrupted");
            assert_eq!(header(&bench.read("a.png")), (32, 32, 8, 0));
            assert!(bench.floats("a.exr", "R").iter().any(|&v| v > 0.0), "what was rendered is kept");
            // The render can be replayed, too.
            bench.run("render scene.gltf --replay a.exr --exr r.exr -o r.png").code(0);
            assert!(bench.read("r.exr") == bench.read("a.exr"), "SIG{signal}");
        }
    }

    #[test]
    fn a_closed_pipe_causes_no_panic() {
        let bench = Bench::new();
        for line in ["sensors", "inspect scene.gltf", "--help", "render scene.gltf --width 8 --height 8 --spp 1"] {
            let mut child = start(bench.folder.path(), line);
            drop(child.stdout.take());
            let mut message = String::new();
            child.stderr.take().expect("piped").read_to_string(&mut message).expect("readable");
            assert_eq!((child.wait().expect("ends").code(), message.as_str()), (Some(0), ""), "{line}");
        }
        for (line, code) in [
            ("render scene.gltf --width 32 --height 32 --spp 64 --progress json -o b.png", 0),
            ("render nowhere.glb", 2),
            ("render --no-such-flag", 2),
        ] {
            let mut child = start(bench.folder.path(), line);
            drop(child.stderr.take());
            assert_eq!(child.wait().expect("ends").code(), Some(code), "{line}");
        }
        assert!(bench.path("b.png").exists());
    }
}
