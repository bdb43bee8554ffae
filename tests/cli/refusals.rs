//! Refusals of the program: with exit code 2, a message with place and help, and no file written. Frequent ones are whole in
//! `snapshots.rs`.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it refusals::NAME`.

use crate::bench::{Bench, stderr};
use std::fs;

#[test]
fn bad_input_ends_with_code_2_names_the_place_and_leaves_everything_as_it_was() {
    let bench = Bench::new();
    bench.write("bad-sensor.toml", "name = \"x\"\n");
    bench.write("frame.toml", "frame = 5000000000\nscene = \"scene.gltf\"\n");
    bench.write("wide.toml", "scene = \"scene.gltf\"\n[lens]\nvertical_fov = \"179deg\"\n");
    bench.write("pilot.toml", "scene = \"scene.gltf\"\n[allocate]\npilot_spp = 1.5\n");
    bench.write("exposed.toml", "scene = \"scene.gltf\"\n[sensor]\nmodel = \"none\"\nexposure = \"5ms\"\n");
    bench.write("matched.toml", "scene = \"scene.gltf\"\n[sensor]\nmodel = \"none\"\nexposure_noise = \"matched\"\n");
    bench.write("noending", "");
    fs::write(bench.path("image.glb"), b"\x89PNG\r\n\x1a\n").expect("writable");
    let words = [0x4654_6c67u32, 2, 20, 0, 0x4e4f_534a].map(u32::to_le_bytes);
    fs::write(bench.path("empty.glb"), words.concat()).expect("writable");
    bench.write("there.png", "precious");
    bench.write("there.exr", "precious");
    bench.run("render scene.gltf --width 8 --height 8 --spp 1 --plan plan.exr -o small.png").code(0);
    let before = bench.names();

    // Arguments after `render`, and what the message must say.
    let render: &[(&str, &[&str])] = &[
        // Files that are not what they should be.
        (".", &["help:"]),
        // Values that cannot be, each with what could be.
        ("frame.toml", &["frame", "5000000000 is out of range", "help: write a whole number from 0 to 4294967295"]),
        ("wide.toml", &["[lens] vertical_fov", "179deg is out of range", "178deg", "help:"]),
        ("pilot.toml", &["[allocate] pilot_spp", "`1.5`", "help: write a whole number from 1 to 65536"]),
        ("exposed.toml", &["[sensor] exposure", "no sensor", "help:", "4 | exposure = \"5ms\""]),
        ("matched.toml", &["[sensor] exposure_noise", "no sensor", "help:", "4 | exposure_noise = \"matched\""]),
        // Names that do not exist.
        ("scene.gltf --sensor bad-sensor.toml", &["bad-sensor.toml", "help:"]),
        ("empty.glb", &["empty.glb", "JSON, line 1", "EOF while parsing"]),
        ("image.glb", &["image.glb", "GLB header", "begins with \"\\x89PNG\" instead of \"glTF\"", "help:"]),
        ("noending", &["noending", "has no ending that names a scene format"]),
        // Outputs that cannot be.
        ("scene.gltf -o noending", &["noending", "has no ending that names a format", "end it in .png"]),
        ("scene.gltf --exr a.png", &["a.png", ".exr"]),
        ("scene.gltf --stats scene.gltf", &["scene.gltf", ".json"]),
        ("scene.gltf -o there.png/a.png", &["there.png/a.png", "help:"]),
        ("scene.gltf --linear a.tif --sensor none", &["a.tif", "sensor", "help:"]),
        ("scene.gltf --exposure-noise matched --sensor none", &["exposure_noise", "sensor", "help:"]),
        // Replays.
        ("scene.gltf --replay plan.exr --width 9", &["8 x 8", "9 x 8", "help:"]),
        ("scene.gltf --replay there.exr", &["there.exr", "help:"]),
        ("scene.gltf --replay plan.exr --spp 4", &["--replay", "--spp"]),
        // Flags.
        ("scene.gltf --width 40000", &["--width", "32768"]),
        ("scene.gltf --spp nan", &["--spp", "above zero"]),
        ("scene.gltf --time 0s", &["--time", "above zero"]),
        ("scene.gltf --exposure 0ms", &["--exposure"]),
        ("scene.gltf --threads 0", &["--threads", "1024"]),
        ("scene.gltf --seed x", &["--seed"]),
        ("scene.gltf --noise quiet", &["--noise", "write a number"]),
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
    for (line, says) in [
        ("render scene.gltf --debug-sample 512,0,0", "help: name a pixel"),
        ("sensors bad-sensor.toml", "bad-sensor.toml"),
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
