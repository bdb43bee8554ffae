//! Messages of the program about unusual inputs: the message names the cause, and no content of a file reaches the
//! terminal as a control sequence.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it messages::NAME`.

use crate::bench::{Bench, stderr, stdout};
use dunkelfeld_io::exr::{Channel, read_exr, write_exr};
use std::fs;

fn refused(bench: &Bench, line: &str, says: &[&str]) {
    let before = bench.names();
    let message = stderr(&bench.run(line).code(2));
    assert!(message.starts_with("error: "), "{line}\n{message}");
    for part in says {
        assert!(message.contains(part), "`{line}` does not say `{part}`:\n{message}");
    }
    assert_eq!(bench.names(), before, "{line} wrote something");
}

/// The floor's corners become `corners`; lamp and cameras go.
fn floor_alone(bench: &Bench, name: &str, corners: [[f32; 3]; 4]) {
    let mut buffer = bench.read("scene.bin");
    for (bytes, v) in buffer.chunks_exact_mut(4).zip(corners.iter().flatten()) {
        bytes.copy_from_slice(&v.to_le_bytes());
    }
    fs::write(bench.path(&format!("{name}.bin")), buffer).expect("writable");
    let text = String::from_utf8(bench.read("scene.gltf")).expect("text");
    let text =
        text.replace("scene.bin", &format!("{name}.bin")).replace("\"nodes\": [0, 1, 2, 3]", "\"nodes\": [0, 2]");
    bench.write(&format!("{name}.gltf"), &text);
}

#[test]
fn a_scene_without_a_triangle_that_is_left_is_refused() {
    let bench = Bench::new();
    floor_alone(&bench, "line", [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]]);
    let says = ["line.gltf", "no triangle is left", "dropped 2 triangles: 2 without area", "help:"];
    for command in ["render", "inspect", "bench"] {
        refused(&bench, &format!("{command} line.gltf"), &says);
    }
    // An environment is visible.
    bench.write("sky.toml", "scene = \"line.gltf\"\n[environment]\nradiance = 1\n");
    bench.run("render sky.toml --width 8 --height 8 --spp 1 -o sky.png").code(0);
    bench.write("night.toml", "scene = \"line.gltf\"\n[environment]\nradiance = 0\n");
    refused(&bench, "render night.toml", &says);

    for (name, far) in [("e20", 1e20), ("e30", 1e30), ("e38", 1e38)] {
        floor_alone(&bench, name, [[0.0; 3], [far, 0.0, 0.0], [far, 0.0, far], [0.0, 0.0, far]]);
        let file = format!("{name}.gltf");
        refused(&bench, &format!("render {file}"), &[&file, "object \"floor\"", "exceed the range of f32", "help:"]);
    }
}

#[test]
fn file_contents_reach_the_terminal_only_escaped() {
    let bench = Bench::new();
    // As JSON escapes: clear the screen, a title, DEL, C1, an override of the direction, a line of its own.
    let evil = r"\u001b[2J\u001b]0;x\u0007\u007f\u009b31m\u202egpj\nfake line";
    let mut text = String::from_utf8(bench.read("scene.gltf")).expect("text");
    for name in ["floor", "lamp", "front", "far", "grey"] {
        text = text.replace(&format!("\"name\": \"{name}\""), &format!("\"name\": \"{name}{evil}\""));
    }
    // A warning with a name in it, too.
    text = text.replace("\"metallicFactor\": 0 }", "\"metallicFactor\": 7 }");
    bench.write("evil.gltf", &text);
    let obeyed = |c: char| (c.is_control() && c != '\n') || c == '\u{202e}';
    let name = if cfg!(unix) { "x\u{1b}[2J.glb" } else { "x.glb" };
    let lines: [&[&str]; 6] = [
        &["inspect", "evil.gltf"],
        &["inspect", "evil.gltf", "--json"],
        &["render", "evil.gltf", "--width", "8", "--height", "8", "--spp", "1", "-o", "a.png"],
        &["render", "evil.gltf", "--debug-sample", "200,300,0"],
        &["render", "evil.gltf", "--camera", "nobody"],
        &["inspect", name],
    ];
    for words in lines {
        let run = bench.run_words(words);
        for text in [stdout(&run), stderr(&run)] {
            assert!(!text.contains(obeyed), "{words:?}: {text:?}");
            assert!(!text.lines().any(|line| line.trim_start().starts_with("fake line")), "{words:?}: {text}");
        }
    }
    let listed = stdout(&bench.run("inspect evil.gltf").code(0));
    assert!(listed.contains("grey\\u{1b}[2J") && listed.contains("\\u{202e}gpj\\u{a}fake line"), "{listed}");
    // JSON contains the name of the file unchanged.
    let json = stdout(&bench.run("inspect evil.gltf --json").code(0));
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    let camera = json["cameras"][0]["name"].as_str().expect("a name");
    assert_eq!(camera, "front\u{1b}[2J\u{1b}]0;x\u{7}\u{7f}\u{9b}31m\u{202e}gpj\nfake line");
}

#[test]
fn a_plan_with_values_that_are_no_counts_is_not_called_missing() {
    let bench = Bench::new();
    bench.run("render scene.gltf --width 6 --height 5 --spp 2 --plan plan.exr -o a.png").code(0);
    let plan = read_exr(&bench.path("plan.exr")).expect("an EXR");
    for (value, shown) in [(f32::NAN, "NaN"), (-1.0, "-1"), (1.5, "1.5"), (1e30, "e30")] {
        let mut bad = plan.clone();
        bad.channels.retain(|(name, _)| name != "spp.Y");
        let mut counts = vec![2.0; 30];
        (counts[6 + 3], counts[6 + 4]) = (value, value);
        bad.channels.push(("spp.Y".into(), Channel::F32(counts)));
        bad.channels.sort_by(|a, b| a.0.cmp(&b.0));
        write_exr(&bench.path("bad.exr"), bad).expect("written");
        let says =
            ["bad.exr", "spp.Y", "holds no numbers of samples: 2 of its values", "at pixel 3, 1", shown, "help:"];
        refused(&bench, "render scene.gltf --replay bad.exr", &says);
    }
    let mut none = plan.clone();
    none.channels.retain(|(name, _)| name != "spp.Y");
    none.channels.push(("Z".into(), Channel::F32(vec![0.0; 30])));
    write_exr(&bench.path("none.exr"), none).expect("written");
    refused(&bench, "render scene.gltf --replay none.exr", &["spp.Y", "is missing"]);
}

#[test]
fn an_image_with_pixels_that_are_no_radiance_is_denoised_and_flagged() {
    let bench = Bench::new();
    bench.run("render scene.gltf --width 16 --height 12 --spp 2 --exr a.exr -o a.png").code(0);
    bench.run("denoise a.exr --denoise builtin -o fine.exr").code(0);
    let mut layers = read_exr(&bench.path("a.exr")).expect("an EXR");
    for (name, channel) in &mut layers.channels {
        if let ("R", Channel::F32(values)) = (name.as_str(), channel) {
            (values[3], values[20], values[40]) = (f32::NAN, f32::INFINITY, -1.0);
        }
    }
    write_exr(&bench.path("bad.exr"), layers).expect("written");
    let run = bench.run("denoise bad.exr --denoise builtin -o out.exr").code(1);
    assert!(stderr(&run).contains("flagged: the radiance of 3 pixels is negative, infinite or not a number"));
    assert!(bench.path("out.exr").exists());
    // Variances that are none.
    let mut layers = read_exr(&bench.path("a.exr")).expect("an EXR");
    for (name, channel) in &mut layers.channels {
        if let ("variance.G", Channel::F32(values)) = (name.as_str(), channel) {
            (values[3], values[20], values[40]) = (f32::NAN, f32::INFINITY, -1.0);
        }
    }
    write_exr(&bench.path("bad.exr"), layers).expect("written");
    for line in [
        "denoise bad.exr --denoise builtin -o out.exr",
        "expose bad.exr --sensor imx250 --exposure-noise matched -o out.png",
    ] {
        let said = stderr(&bench.run(line).code(1));
        assert!(said.contains("flagged: the variance of 2 pixels is negative or not a number"), "{line}: {said}");
    }
    bench.run("expose bad.exr --sensor imx250 -o plain.png").code(0);
}

#[test]
fn a_bench_of_a_black_scene_states_that_there_is_no_light() {
    let bench = Bench::new();
    floor_alone(&bench, "dark", [[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 0.0, -1.0]]);
    let line = "bench dark.gltf --quick --width 12 --height 8 --spp 2,4 --seeds 4 --progress none -o out";
    let run = bench.run(line).code(0);
    assert!(stdout(&run).contains("no light"), "{}", stdout(&run));
    let mut texts = vec![stdout(&run)];
    for entry in fs::read_dir(bench.path("out")).expect("a folder").flatten() {
        let is_text = entry.path().extension().is_some_and(|e| ["csv", "html", "json", "svg"].iter().any(|x| e == *x));
        if is_text {
            texts.push(fs::read_to_string(entry.path()).expect("text"));
        }
    }
    assert!(texts.len() > 3);
    assert!(texts.iter().any(|t| t.contains("<html")) && texts.iter().all(|t| !t.contains("NaN")), "{}", texts[0]);
}
