//! Several cameras of one job, and the words of a render for people and for programs.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it cameras::NAME`.

use crate::bench::{Bench, stderr, stdout};
use serde_json::Value;

const TWO: &str = r#"scene = "scene.gltf"
[film]
width = 16
height = 12
[budget]
spp = 4
[[camera]]
name = "left"
position = [-1, 1, 2]
look_at = "floor"
vertical_fov = "40deg"
[[camera]]
name = "right"
look_at = "floor"
working_distance = "900mm"
lens = { focal_length = "12mm" }
"#;

#[test]
fn each_camera_of_a_job_has_its_files() {
    let bench = Bench::new();
    bench.write("two.toml", TWO);
    let run = bench.run("render two.toml --exr all.exr --stats all.json").code(0);
    for file in ["two-left.png", "two-right.png", "all-left.exr", "all-right.json"] {
        assert!(stdout(&run).contains(&format!("wrote {file}")), "{}", stdout(&run));
    }
    assert!(!bench.names().contains("two.png") && !bench.names().contains("all.exr"), "{:?}", bench.names());
    for name in ["left", "right"] {
        assert!(stdout(&run).contains(&format!("camera \"{name}\"")), "{}", stdout(&run));
        assert_eq!(bench.json(&format!("all-{name}.json"))["camera"], name);
        // Alone, a camera gives the same bits in the files that are named.
        bench.run(&format!("render two.toml --camera {name} -o one.png --exr one.exr")).code(0);
        assert!(bench.read("one.exr") == bench.read(&format!("all-{name}.exr")), "{name}");
        assert!(bench.read("one.png") == bench.read(&format!("two-{name}.png")), "{name}");
    }
    assert!(bench.read("all-left.exr") != bench.read("all-right.exr"));
    // A camera of the scene can be selected too.
    bench.run("render two.toml --camera far --stats far.json").code(0);
    assert_eq!(bench.json("far.json")["camera"], "far");
    let run = bench.run("render two.toml --camera middle").code(2);
    assert!(stderr(&run).contains("left, right, front, far"), "{}", stderr(&run));
}

/// Captures of each camera: one render, and files with both names. A time limit holds for all of them together.
#[test]
fn each_capture_of_a_job_has_its_files() {
    let bench = Bench::new();
    let lamp = |name: &str, x: i32| {
        format!(
            "[[light]]\nname = \"{name}\"\nkind = \"panel\"\nwidth = \"200mm\"\nheight = \"200mm\"\nposition = [{x}, 1, 0]\n\
             target = [0, 0, 0]\npower = 2\n"
        )
    };
    let captures = "[[capture]]\nname = \"east\"\nlights = [\"east\"]\n[[capture]]\nname = \"both\"\nlights = { east = 1, west = 0.5 }\n\
        [[capture]]\nname = \"west\"\nlights = [\"west\"]\ncamera = \"right\"\nexposure = \"1ms\"\n";
    bench.write("lamps.toml", &format!("{TWO}{}{}{captures}", lamp("east", 1), lamp("west", -1)));
    let run = bench.run("render lamps.toml --exr all.exr --stats all.json --time 1h --spp 4").code(0);
    for camera in ["left", "right"] {
        for capture in ["east", "both"] {
            let name = format!("{camera}-{capture}");
            for file in [format!("lamps-{name}.png"), format!("all-{name}.exr"), format!("all-{name}.json")] {
                assert!(bench.names().contains(&file), "{:?}", bench.names());
            }
            assert_eq!(bench.json(&format!("all-{name}.json"))["capture"], capture);
        }
        assert!(bench.read(&format!("all-{camera}-east.exr")) != bench.read(&format!("all-{camera}-both.exr")));
    }
    // A capture of one camera, and an exposure for all of them.
    assert!(bench.names().contains("lamps-right-west.png") && !bench.names().contains("lamps-left-west.png"));
    bench.run("render lamps.toml --camera right --exposure 3ms --stats one.json").code(0);
    for name in ["east", "both", "west"] {
        assert_eq!(bench.json(&format!("one-{name}.json"))["sensor"]["exposure_seconds"], 3e-3);
    }
    assert!(stdout(&run).contains("capture \"both\"") && !bench.names().contains("lamps-left.png"));
    let run = bench.run("render lamps.toml --camera left --frames 2").code(2);
    assert!(stderr(&run).contains("--frames") && stderr(&run).contains("captures"), "{}", stderr(&run));
}

#[test]
fn a_time_budget_is_divided_among_the_cameras() {
    let bench = Bench::new();
    bench.write("two.toml", TWO);
    bench.run("render two.toml --time 1h --spp 2 --stats t.json").code(0);
    let budget = |name: &str| bench.json(&format!("t-{name}.json"))["budget_seconds"].as_f64().expect("a limit");
    assert!((1800.0..2400.0).contains(&budget("left")), "half of the hour: {}", budget("left"));
    assert!((2400.0..3600.0).contains(&budget("right")), "the rest of the hour: {}", budget("right"));
}

#[test]
fn flags_for_one_camera_and_common_files_are_refused_before_the_render() {
    let bench = Bench::new();
    bench.write("two.toml", TWO);
    bench.run("render two.toml --camera left --plan plan.exr -o plan.png").code(0);
    let before = bench.names();
    for flags in [
        "--checkpoint state.film",
        "--replay plan.exr",
        "--samples 0..4 --checkpoint state.film",
        "--debug-sample 0,0,0",
    ] {
        let run = bench.run(&format!("render two.toml {flags}")).code(2);
        let flag =
            if flags.contains("--samples") { "--checkpoint" } else { flags.split(' ').next().unwrap_or_default() };
        assert!(stderr(&run).contains(flag) && stderr(&run).contains("--camera NAME"), "{}", stderr(&run));
    }
    // Both names give one file.
    bench.write("same.toml", &TWO.replace("\"left\"", "\"a b\"").replace("\"right\"", "\"a_b\""));
    let run = bench.run("render same.toml").code(2);
    assert!(stderr(&run).contains("two outputs"), "{}", stderr(&run));
    // The output of a camera is an input.
    bench.write("in.toml", &TWO.replace("scene.gltf", "scene-right.gltf"));
    bench.write(
        "scene-right.gltf",
        &String::from_utf8(bench.read("scene.gltf")).expect("text").replace("scene.bin", "s-right.png"),
    );
    std::fs::copy(bench.path("scene.bin"), bench.path("s-right.png")).expect("copied");
    let run = bench.run("render in.toml -o s.png").code(2);
    assert!(stderr(&run).contains("s-right.png") && stderr(&run).contains("that this run reads"), "{}", stderr(&run));
    let added = ["same.toml", "in.toml", "scene-right.gltf", "s-right.png"];
    let after: Vec<_> = bench.names().into_iter().filter(|n| !added.contains(&n.as_str())).collect();
    assert_eq!(after, before.into_iter().filter(|n| n != "state.film").collect::<Vec<_>>(), "nothing was written");
}

fn events(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{line}: {e}"))).collect()
}

#[test]
fn progress_as_json_leaves_nothing_else_on_standard_error() {
    let bench = Bench::new();
    bench.write("two.toml", TWO);
    bench.write("bad.toml", &TWO.replace("\"40deg\"", "\"40\""));
    let of = |line: &str, code: i32| events(&stderr(&bench.run(&format!("{line} --progress json")).code(code)));
    let with = |events: &[Value], kind: &str| -> Vec<Value> {
        events.iter().filter(|e| e["event"] == kind).cloned().collect()
    };
    let lines = of("render two.toml --exposure 5", 0);
    assert!(lines.iter().all(|e| e["event"].is_string()), "{lines:?}");
    assert!(lines.iter().filter(|e| e["event"] == "progress").all(|e| e["stage"].is_string()));
    let names: Vec<Value> = with(&lines, "camera").into_iter().map(|e| e["name"].clone()).collect();
    assert_eq!(names, ["left", "right"]);
    let note = with(&lines, "warning")[0]["message"].to_string();
    assert!(note.contains("5 is 5 s") && note.contains("5ms"), "{note}");
    let error = &with(&of("render bad.toml", 2), "error")[0];
    assert!(error["message"].as_str().is_some_and(|m| m.contains("lacks a unit")), "{error}");
    assert!(error["help"].as_str().is_some_and(|h| h.contains("30deg")), "{error}");
    assert!(error["place"].as_str().is_some_and(|p| p.contains("^")), "{error}");
    let usage = of("render two.toml --width 0", 2);
    assert!(usage.len() == 1 && usage[0]["event"] == "error", "{usage:?}");
    // A lamp so weak that the automatic exposure takes minutes.
    bench.write("dark.toml", &format!("{TWO}[[light]]\nname = \"lamp\"\npower = \"0.001uW\"\n"));
    let dark = of("render dark.toml --camera left", 0);
    let warning = with(&dark, "warning").iter().map(Value::to_string).collect::<String>();
    assert!(warning.contains("automatic exposure"), "{dark:?}");
}

#[test]
fn the_summary_leads_with_the_image_and_the_next_step() {
    let bench = Bench::new();
    let run = bench.run("render scene.gltf --width 16 --height 12 --spp 4 -o a.png").code(0);
    let lines: Vec<String> = stdout(&run).lines().map(str::to_owned).collect();
    assert!(lines[0].starts_with("a.png: Sony IMX250") && lines[0].contains("exposed for"), "{lines:?}");
    assert!(lines[1].starts_with("noise of the render: "), "{lines:?}");
    assert!(!stdout(&run).contains("in the median"), "the distribution is in the statistics");
    let hidden = lines[1].contains("would not show the difference");
    let advice = lines[2].contains("to hide it: more time") && lines[2].contains("--denoise auto");
    assert!(hidden != advice, "{lines:?}");
    let run = bench.run("render scene.gltf --width 4 --height 4 --spp 1 --exposure 5 -o b.png").code(0);
    assert!(stderr(&run).contains("exposure: 5 is 5 s; write"), "{}", stderr(&run));
    let run = bench.run("render scene.gltf --sensor none --width 4 --height 4 --spp 1 -o c.png").code(0);
    assert!(stdout(&run).starts_with("c.png: no sensor"), "{}", stdout(&run));
}
