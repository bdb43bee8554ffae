//! Refusals of the program: with exit code 2, a message with place and help, and no file written.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it refusals::NAME`.

use crate::bench::{Bench, stderr};
use std::fs;

#[test]
fn bad_input_ends_with_code_2_names_the_place_and_leaves_everything_as_it_was() {
    let bench = Bench::new();
    bench.write("broken.gltf", "{ \"asset\": ");
    bench.write("no-scene.toml", "[film]\nwidth = 3\n");
    bench.write("unknown-key.toml", "scene = \"scene.gltf\"\n[film]\nwidht = 3\n");
    bench.write("bad-camera.toml", "scene = \"scene.gltf\"\ncamera = \"frnt\"\n");
    bench.write("no.toml", "scene = \"nowhere.glb\"\n");
    bench.write("bad-sensor.toml", "name = \"x\"\n");
    bench.write("seed.toml", "seed = -1\nscene = \"scene.gltf\"\n");
    bench.write("frame.toml", "frame = 5000000000\nscene = \"scene.gltf\"\n");
    bench.write("angle.toml", "scene = \"scene.gltf\"\n[lens]\nvertical_fov = 30\n");
    bench.write("wide.toml", "scene = \"scene.gltf\"\n[lens]\nvertical_fov = \"179deg\"\n");
    bench.write("pilot.toml", "scene = \"scene.gltf\"\n[allocate]\npilot_spp = 1.5\n");
    bench.write("exposed.toml", "scene = \"scene.gltf\"\n[sensor]\nmodel = \"none\"\nexposure = \"5ms\"\n");
    bench.write("matched.toml", "scene = \"scene.gltf\"\n[sensor]\nmodel = \"none\"\nexposure_noise = \"matched\"\n");
    bench.write("notes.txt", "no scene");
    bench.write("there.png", "precious");
    bench.write("there.exr", "precious");
    fs::create_dir(bench.path("folder.png")).expect("writable");
    bench.run("render scene.gltf --width 8 --height 8 --spp 1 --plan plan.exr -o small.png").code(0);
    let before = bench.names();

    // Arguments after `render`, and what the message must say.
    let render: &[(&str, &[&str])] = &[
        // Files that are not what they should be.
        ("nowhere.glb", &["nowhere.glb", "help:"]),
        ("no.toml", &["nowhere.glb", "help:"]),
        ("notes.txt", &["notes.txt", "help:"]),
        (".", &["help:"]),
        ("broken.gltf", &["broken.gltf", "help:"]),
        ("no-scene.toml", &["no-scene.toml", "scene", "help:"]),
        ("unknown-key.toml", &["unknown-key.toml", "[film] widht", "did you mean `width`", "3 | widht = 3", "| ^^^^^"]),
        ("bad-camera.toml", &["bad-camera.toml", "frnt", "front", "^^^^^^"]),
        // Values that cannot be, each with what could be.
        ("seed.toml", &["seed", "-1 is out of range", "help: write a whole number from 0"]),
        ("frame.toml", &["frame", "5000000000 is out of range", "help: write a whole number from 0 to 4294967295"]),
        ("angle.toml", &["[lens] vertical_fov", "30 lacks a unit", "help: write an angle as \"30deg\""]),
        ("wide.toml", &["[lens] vertical_fov", "179deg is out of range", "178deg", "help:"]),
        ("pilot.toml", &["[allocate] pilot_spp", "`1.5`", "help: write a whole number from 1 to 65536"]),
        ("exposed.toml", &["[sensor] exposure", "no sensor", "help:", "4 | exposure = \"5ms\""]),
        ("matched.toml", &["[sensor] exposure_noise", "no sensor", "help:", "4 | exposure_noise = \"matched\""]),
        // Names that do not exist.
        ("scene.gltf --camera nobody", &["nobody", "front", "far", "help:"]),
        ("scene.gltf --sensor imx999", &["imx999", "imx250", "help:"]),
        ("scene.gltf --sensor nowhere.toml", &["nowhere.toml", "help:"]),
        ("scene.gltf --sensor bad-sensor.toml", &["bad-sensor.toml", "help:"]),
        // Outputs that cannot be.
        ("scene.gltf -o missing/a.png", &["missing/a.png", "folder", "help:"]),
        ("scene.gltf -o folder.png", &["folder.png", "is a folder", "help:"]),
        ("scene.gltf -o a.jpg", &["a.jpg", ".png"]),
        ("scene.gltf --exr a.png", &["a.png", ".exr"]),
        ("scene.gltf --linear a.exr", &["a.exr", ".tif"]),
        ("scene.gltf --stats scene.gltf", &["scene.gltf", ".json"]),
        ("scene.gltf -o there.png/a.png", &["there.png/a.png", "help:"]),
        ("scene.gltf --exr a.exr --plan a.exr", &["a.exr", "two outputs", "help:"]),
        ("scene.gltf --exr a.exr --plan ./a.exr", &["a.exr", "two outputs", "help:"]),
        ("scene.gltf --linear a.tif --sensor none", &["a.tif", "sensor", "help:"]),
        ("scene.gltf --exposure 5ms --sensor none", &["--exposure", "--sensor", "help:"]),
        ("scene.gltf --exposure-noise matched --sensor none", &["--exposure-noise", "--sensor", "help:"]),
        ("scene.gltf --exposure-noise loud", &["loud", "plain", "matched"]),
        // Replays.
        ("scene.gltf --replay plan.exr --width 9", &["8 x 8", "9 x 8", "help:"]),
        ("scene.gltf --replay nowhere.exr", &["nowhere.exr", "help:"]),
        ("scene.gltf --replay there.exr", &["there.exr", "help:"]),
        ("scene.gltf --replay plan.exr --spp 4", &["--replay", "--spp"]),
        // Flags.
        ("scene.gltf --no-such-flag", &["--no-such-flag"]),
        ("", &["SCENE"]),
        ("scene.gltf --width 0", &["--width", "32768"]),
        ("scene.gltf --width 40000", &["--width", "32768"]),
        ("scene.gltf --height -3", &["--height", "32768"]),
        ("scene.gltf --spp 0", &["--spp", "above zero"]),
        ("scene.gltf --spp nan", &["--spp", "above zero"]),
        ("scene.gltf --spp=-1", &["--spp", "above zero"]),
        ("scene.gltf --time 0s", &["--time", "above zero"]),
        ("scene.gltf --time 20x", &["--time", "unit"]),
        ("scene.gltf --time soon", &["--time"]),
        ("scene.gltf --exposure 0ms", &["--exposure"]),
        ("scene.gltf --threads 0", &["--threads", "1024"]),
        ("scene.gltf --seed x", &["--seed"]),
        ("scene.gltf --allocate best", &["best", "uniform", "sobel", "sensor"]),
        ("scene.gltf --noise quiet", &["--noise", "0.7"]),
        ("scene.gltf --noise 1 --sensor none", &["noise", "sensor", "help"]),
        ("scene.gltf --allocate sensor --sensor none", &["allocation", "uniform", "help"]),
        ("scene.gltf --progress loud", &["loud", "json"]),
        ("scene.gltf --debug-sample 1,2", &["--debug-sample", "12,40,7"]),
        ("scene.gltf --debug-sample 0,0,0", &["--debug-sample", "--output"]),
    ];
    for (line, says) in render {
        // The earlier outputs are in danger as well.
        let more = if line.contains("-o ") || line.contains("--exr") { "" } else { "-o there.png --exr there.exr" };
        let line = format!("render {line} {more}");
        let message = stderr(&bench.run(&line).code(2));
        assert!(message.starts_with("error: "), "{line}\n{message}");
        for part in *says {
            assert!(message.contains(part), "`{line}` does not say `{part}`:\n{message}");
        }
    }
    // A sample that is traced writes nothing.
    for flag in ["-o a.png", "--linear a.tif", "--exr a.exr", "--stats a.json", "--plan p.exr", "--time 1s", "--spp 4"]
    {
        let message = stderr(&bench.run(&format!("render scene.gltf --debug-sample 0,0,0 {flag}")).code(2));
        assert!(message.contains("--debug-sample") && message.contains("cannot be used with"), "{flag}: {message}");
    }
    // Every listed effect can be left out.
    let message = stderr(&bench.run("render scene.gltf --without every-lamp").code(2));
    assert!(message.contains("every-light") && message.contains("cover-connection"), "{message}");
    assert!(!["nesting", "many-lights", "color,"].iter().any(|name| message.contains(name)), "{message}");
    for (line, says) in [
        ("render scene.gltf --debug-sample 512,0,0", "help: name a pixel"),
        ("inspect nowhere.glb", "nowhere.glb"),
        ("inspect broken.gltf", "broken.gltf"),
        ("sensors imx999", "imx250"),
        ("sensors bad-sensor.toml", "bad-sensor.toml"),
        ("paint", "paint"),
        ("", "Usage"),
    ] {
        let message = stderr(&bench.run(line).code(2));
        assert!(message.contains(says), "`{line}` does not say `{says}`:\n{message}");
    }
    assert_eq!(bench.names(), before, "something was written");
    assert_eq!((bench.read("there.png"), bench.read("there.exr")), (b"precious".to_vec(), b"precious".to_vec()));
}

#[cfg(unix)]
#[test]
fn a_file_that_is_write_protected_is_refused_before_the_render() {
    use std::os::unix::fs::PermissionsExt;
    let bench = Bench::new();
    bench.write("there.png", "precious");
    fs::set_permissions(bench.path("there.png"), fs::Permissions::from_mode(0o444)).expect("own file");
    let run = bench.run("render scene.gltf --width 8 --height 8 --spp 1 -o there.png --exr a.exr").code(2);
    assert!(stderr(&run).contains("there.png") && stderr(&run).contains("read-only"), "{}", stderr(&run));
    assert!(bench.read("there.png") == b"precious" && !bench.path("a.exr").exists());
}
