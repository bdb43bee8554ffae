//! Inputs of the program stay unchanged, and only regular files of a reasonable size are read.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it inputs::NAME`.

use crate::bench::{Bench, PROGRAM, stderr};
use assert_cmd::Command;
use assert_cmd::assert::Assert;
use serde_json::json;
use std::collections::BTreeMap;
use std::fs;
use std::time::Duration;

const SENSOR: &str = include_str!("../../crates/camera/sensor/presets/imx250.toml");
const SMALL: &str = "--width 4 --height 4 --spp 1";

/// A bench with a scene `panel.gltf` that has the texture `panel.png` and a point light, and what a job can name.
fn furnished() -> Bench {
    let bench = Bench::new();
    bench.run(&format!("render scene.gltf {SMALL} -o panel.png --exr env.exr --plan plan.exr")).code(0);
    let mut scene = bench.json("scene.gltf");
    scene["images"] = json!([{ "uri": "panel.png" }, { "uri": "missing.png" }]);
    scene["textures"] = json!([{ "source": 0 }, { "source": 1 }]);
    scene["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
    scene["materials"][1]["emissiveTexture"] = json!({ "index": 1 });
    scene["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "point", "name": "bulb" }] } });
    let nodes = scene["nodes"].as_array_mut().expect("nodes");
    nodes.push(json!({ "name": "bulb", "extensions": { "KHR_lights_punctual": { "light": 0 } } }));
    scene["scenes"][0]["nodes"] = json!([0, 1, 2, 3, 4]);
    scene["extensionsUsed"] = json!(["KHR_materials_emissive_strength", "KHR_lights_punctual"]);
    bench.write("panel.gltf", &scene.to_string());
    bench.write("sensor.toml", SENSOR);
    let ies = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 2 1 1 2 0 0 0\n1 1 10\n0 90\n0\n100 0\n";
    bench.write("bulb.ies", ies);
    bench.write("panel.toml", &job("panel.gltf", "env.exr", "bulb.ies", "sensor.toml"));
    bench
}

fn job(scene: &str, environment: &str, ies: &str, sensor: &str) -> String {
    format!(
        "scene = \"{scene}\"\n[film]\nwidth = 4\nheight = 4\n[budget]\nspp = 1\n[environment]\nimage = \"{environment}\"\n\
         [[light]]\nname = \"bulb\"\nies = \"{ies}\"\n[sensor]\nmodel = \"{sensor}\"\n"
    )
}

/// The bytes of all files, those in folders included.
fn contents(bench: &Bench) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![bench.folder.path().to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("readable") {
            let path = entry.expect("readable").path();
            let about = fs::symlink_metadata(&path).expect("there");
            if about.is_dir() {
                folders.push(path);
            } else if fs::metadata(&path).is_ok_and(|m| m.is_file() && m.len() < 1 << 30) {
                files.insert(path.display().to_string(), fs::read(&path).expect("readable"));
            }
        }
    }
    files
}

/// Runs lines that must be refused with these words, and that must leave every file as it is.
fn refused(bench: &Bench, cases: &[(&str, &[&str])]) {
    let before = contents(bench);
    for (line, says) in cases {
        let message = stderr(&run(bench, line).code(2));
        assert!(message.contains("error: ") && message.contains("help:"), "{line}\n{message}");
        for part in *says {
            assert!(message.contains(part), "`{line}` does not say `{part}`:\n{message}");
        }
        assert!(contents(bench) == before, "`{line}` changed a file");
    }
}

/// The program, which ends by itself: what waits for a pipe or reads from a device without end would be killed.
fn run(bench: &Bench, line: &str) -> Assert {
    let words: Vec<&str> = line.split_whitespace().collect();
    Command::new(PROGRAM).current_dir(bench.folder.path()).args(words).timeout(Duration::from_secs(60)).assert()
}

#[test]
fn a_default_name_that_is_a_texture_s_is_not_taken() {
    let bench = furnished();
    let before = contents(&bench);
    for input in ["panel.gltf", "panel.toml"] {
        let done = run(&bench, &format!("render {input} {SMALL} --progress none")).code(0);
        let said = stderr(&done);
        let note = said.lines().filter(|l| l.starts_with("note: panel.png is a texture")).collect::<Vec<_>>();
        assert!(note.len() == 1 && note[0].contains("panel.render.png is written instead"), "{said}");
        let mut after = contents(&bench);
        let made = after.remove(&bench.path("panel.render.png").display().to_string()).expect("an image");
        assert!(made.starts_with(b"\x89PNG") && after == before, "{input}: something else was written");
        fs::remove_file(bench.path("panel.render.png")).expect("removable");
    }
    // The name of another output is not taken either.
    run(&bench, &format!("render scene.gltf {SMALL} --linear scene.png")).code(0);
    assert!(bench.names().contains("scene.png") && bench.names().contains("scene.render.png"));
}

#[test]
fn an_output_that_is_an_input_is_refused_by_every_path_to_it() {
    let bench = furnished();
    fs::create_dir(bench.path("sub")).expect("writable");
    bench.write(
        "own.toml",
        &(job("panel.gltf", "env.exr", "bulb.ies", "sensor.toml") + "[output]\nimage = \"panel.png\"\n"),
    );
    let cases: &[(&str, &[&str])] = &[
        ("render panel.gltf -o panel.png", &["panel.png", "a texture", "the image", "write to another file"]),
        ("render panel.gltf -o ./panel.png", &["a texture", "the image"]),
        ("render panel.gltf -o sub/../panel.png", &["a texture", "the image"]),
        ("render panel.gltf --linear panel.png -o x.png", &["a texture", "the linear image"]),
        ("render panel.gltf --checkpoint panel.png -o x.png", &["a texture", "the checkpoint"]),
        ("render panel.gltf --checkpoint scene.bin -o x.png", &["a buffer", "the checkpoint"]),
        // A texture that is missing now has a name to be kept free.
        ("render panel.gltf -o missing.png", &["missing.png", "a texture"]),
        ("render own.toml", &["panel.png", "a texture", "the image"]),
        ("render panel.toml --exr env.exr -o x.png", &["env.exr", "the environment image", "the EXR"]),
        ("render panel.toml --plan ./env.exr -o x.png", &["the environment image", "the plan"]),
        ("render panel.toml --checkpoint bulb.ies -o x.png", &["a light profile", "the checkpoint"]),
        ("render panel.toml --checkpoint panel.toml -o x.png", &["the job", "the checkpoint"]),
        ("render scene.gltf --replay plan.exr --exr plan.exr -o x.png", &["plan.exr", "the plan to replay", "the EXR"]),
        ("render scene.gltf --replay plan.exr --plan plan.exr -o x.png", &["the plan to replay", "is also the plan"]),
        ("render scene.gltf --sensor sensor.toml --checkpoint sensor.toml -o x.png", &["the sensor file"]),
        ("render scene.obj --checkpoint scene.mtl -o x.png", &["a material library", "the checkpoint"]),
        ("render scene.gltf --exr x.exr --checkpoint ./x.exr -o x.png", &["x.exr", "two outputs"]),
        ("expose env.exr --linear x.png -o ./x.png", &["two outputs"]),
        ("denoise env.exr -o sub/../env.exr", &["the input image", "the denoised image"]),
    ];
    refused(&bench, cases);
}

#[cfg(unix)]
#[test]
fn an_output_that_reaches_an_input_through_a_link_is_refused() {
    use std::os::unix::fs::symlink;
    let bench = furnished();
    let link = |to: &str, name: &str| symlink(bench.path(to), bench.path(name)).expect("links work");
    let hard = |to: &str, name: &str| fs::hard_link(bench.path(to), bench.path(name)).expect("hard links work");
    link("panel.gltf", "to-scene.png");
    link("panel.png", "to-texture.png");
    link("scene.bin", "to-buffer.exr");
    link("sensor.toml", "to-sensor.json");
    link("panel.toml", "to-job.json");
    link("bulb.ies", "to-ies.tif");
    hard("panel.gltf", "hard-scene.png");
    hard("panel.png", "hard-texture.png");
    hard("panel.toml", "hard-job.png");
    hard("env.exr", "frame-0002.png");
    hard("env.exr", "many-0000000002.png");
    hard("env.exr", "hard-env.exr");
    link("plan.exr", "to-plan.exr");
    link(".", "again");
    let job = "render panel.toml";
    let cases: &[(&str, &[&str])] = &[
        (&format!("{job} -o to-scene.png"), &["the scene", "the image", "panel.gltf"]),
        (&format!("{job} -o to-texture.png"), &["a texture", "panel.png"]),
        (&format!("{job} -o again/panel.png"), &["a texture"]),
        (&format!("{job} -o again/missing.png"), &["a texture"]),
        (&format!("{job} -o x.png --exr to-buffer.exr"), &["a buffer", "the EXR"]),
        (&format!("{job} -o x.png --stats to-sensor.json"), &["the sensor file", "the statistics"]),
        (&format!("{job} -o x.png --stats to-job.json"), &["the job", "the statistics"]),
        (&format!("{job} -o x.png --linear to-ies.tif"), &["a light profile", "the linear image"]),
        (&format!("{job} -o hard-scene.png"), &["the scene"]),
        (&format!("{job} -o hard-texture.png"), &["a texture"]),
        (&format!("{job} -o hard-job.png"), &["the job"]),
        (&format!("{job} -o x.png --exr hard-env.exr"), &["the environment image"]),
        ("render scene.gltf --replay plan.exr --exr to-plan.exr -o x.png", &["the plan to replay", "the EXR"]),
        ("expose env.exr -o frame-0002.png", &["frame-0002.png", "the input image"]),
        ("expose env.exr --frames 4 -o frame.png", &["frame-0002.png", "the input image", "the image"]),
        ("expose env.exr --frames 4294967295 -o many.png", &["many-0000000002.png", "the input image"]),
        ("expose env.exr --sensor sensor.toml -o x.png --linear to-sensor.tif", &["the sensor file"]),
        ("denoise env.exr -o hard-env.exr", &["the input image", "the denoised image"]),
    ];
    link("sensor.toml", "to-sensor.tif");
    refused(&bench, cases);

    // A default name that leads to the input.
    link("env.exr", "env.png");
    refused(&bench, &[("expose env.exr", &["env.png", "the input image", "the image"])]);
}

#[cfg(unix)]
#[test]
fn parts_and_frames_are_not_replaced_and_a_checkpoint_that_is_resumed_is() {
    use std::os::unix::fs::symlink;
    let bench = furnished();
    for (samples, file) in [("0..1", "a.film"), ("1..2", "b.film")] {
        let line = format!("render scene.gltf --width 4 --height 4 --samples {samples} --checkpoint {file} -o x.png");
        run(&bench, &line).code(0);
        run(&bench, &line).code(0);
    }
    symlink(bench.path("a.film"), bench.path("to-part.png")).expect("links work");
    fs::hard_link(bench.path("b.film"), bench.path("hard-part.film")).expect("hard links work");
    run(&bench, "expose env.exr --frames 3 --exposure 1ms -o f.png").code(0);
    run(&bench, "emva dataset --sensor imx250 -o set --size 32x32 --levels 10 --spatial 3 --progress none").code(0);
    symlink(bench.path("set/images/b_001_0.png"), bench.path("to-frame.json")).expect("links work");
    fs::create_dir(bench.path("report")).expect("writable");
    symlink(bench.path("f-0001.png"), bench.path("report/report.html")).expect("links work");
    refused(
        &bench,
        &[
            ("merge a.film b.film -o to-part.png", &["a part", "the image", "a.film"]),
            ("merge a.film b.film --checkpoint b.film", &["is a part", "the checkpoint"]),
            ("merge a.film b.film --checkpoint hard-part.film", &["is a part", "b.film"]),
            ("merge a.film b.film --checkpoint x.exr --exr ./x.exr", &["two outputs", "the checkpoint"]),
            ("emva analyse set/emva.txt --json to-frame.json", &["a frame", "as JSON"]),
            ("ptc f-0000.png f-0001.png f-0002.png -o .", &["a frame", "another folder"]),
            ("ptc f-0000.png f-0001.png f-0002.png -o report", &["report", "a frame", "another folder"]),
        ],
    );
    // The default folder holds the frames.
    fs::create_dir(bench.path("g-ptc")).expect("writable");
    for (from, to) in [("f-0000.png", "g.png"), ("f-0001.png", "h.png"), ("f-0002.png", "i.png")] {
        fs::copy(bench.path(from), bench.path("g-ptc").join(to)).expect("writable");
    }
    refused(&bench, &[("ptc g-ptc/g.png g-ptc/h.png g-ptc/i.png", &["g-ptc", "holds", "a frame", "another folder"])]);
}

#[test]
fn a_folder_of_results_that_holds_an_input_is_neither_cleared_nor_written_to() {
    let bench = furnished();
    fs::create_dir_all(bench.path("out/units")).expect("writable");
    for name in ["bench.json", "ptc.json"] {
        bench.write(&format!("out/units/{name}"), "{}");
    }
    fs::copy(bench.path("env.exr"), bench.path("out/units/env.exr")).expect("writable");
    bench.write("kept.toml", &job("panel.gltf", "out/units/env.exr", "bulb.ies", "sensor.toml"));
    for command in ["bench", "ptc"] {
        refused(
            &bench,
            &[
                (
                    &format!("{command} kept.toml --restart -o out"),
                    &["out", "env.exr", "environment", "another folder"],
                ),
                (&format!("{command} kept.toml -o out"), &["out", "env.exr", "another folder"]),
                (&format!("{command} panel.toml --restart -o ."), &["the job"]),
            ],
        );
    }
}

#[cfg(unix)]
#[test]
fn irregular_and_too_large_files_are_refused_by_every_reader() {
    use std::os::unix::fs::symlink;
    use std::os::unix::net::UnixListener;
    let bench = furnished();
    // In place of every file that the program reads, by each ending that chooses a reader.
    let mut sockets = Vec::new();
    for ending in ["glb", "gltf", "obj", "hdr", "ies", "toml", "exr", "film", "txt", "png"] {
        let at = |kind: &str| bench.path(&format!("{kind}.{ending}"));
        let made = std::process::Command::new("mkfifo").arg(at("pipe")).status().expect("mkfifo is at hand");
        assert!(made.success());
        symlink("/dev/zero", at("zero")).expect("links work");
        fs::create_dir(at("folder")).expect("writable");
        sockets.push(UnixListener::bind(at("socket")).expect("a socket"));
        fs::write(at("empty"), "").expect("writable");
        fs::File::create(at("large")).and_then(|f| f.set_len(65 << 30)).expect("a sparse file");
    }
    let kinds: [(&str, &[&str]); 7] = [
        ("pipe", &["a named pipe", "help: name a regular file"]),
        ("zero", &["a device", "help: name a regular file"]),
        ("folder", &["a folder", "help: name a regular file"]),
        ("socket", &["a socket", "help: name a regular file"]),
        ("empty", &["help:"]),
        ("large", &["more than the", "help:"]),
        ("missing", &["there is no file", "help: check the name"]),
    ];
    let good = ["panel.gltf", "env.exr", "bulb.ies", "sensor.toml"];
    for (kind, says) in kinds {
        let file = |ending: &str| format!("{kind}.{ending}");
        let mut lines = Vec::new();
        for (place, ending) in [(0, "glb"), (0, "gltf"), (0, "obj"), (1, "hdr"), (1, "exr"), (2, "ies"), (3, "toml")] {
            let mut named = good.map(str::to_owned);
            named[place] = file(ending);
            let [scene, environment, ies, sensor] = named.each_ref();
            let name = format!("job-{place}-{kind}-{ending}.toml");
            bench.write(&name, &job(scene, environment, ies, sensor));
            lines.push((format!("render {name} -o x.png"), file(ending)));
        }
        for (line, ending) in [
            ("inspect FILE", "toml"),
            ("render FILE -o x.png", "glb"),
            ("render FILE -o x.png", "toml"),
            ("render scene.gltf --sensor FILE -o x.png", "toml"),
            ("render scene.gltf --replay FILE -o x.png", "exr"),
            ("sensors FILE", "toml"),
            ("expose FILE -o x.png", "exr"),
            ("expose env.exr --sensor FILE -o x.png", "toml"),
            ("denoise FILE --denoise builtin -o x.exr", "exr"),
            ("merge FILE -o x.png", "film"),
            ("ptc FILE FILE FILE -o x", "png"),
            ("bench FILE -o x", "toml"),
            ("emva analyse FILE", "txt"),
            ("emva dataset --sensor FILE -o x", "toml"),
        ] {
            lines.push((line.replace("FILE", &file(ending)), file(ending)));
        }
        // A pipe makes a reader wait that opens it by itself.
        let readers = if kind == "pipe" { lines.len() } else { 1 };
        for (line, name) in &lines[..readers] {
            let says: Vec<&str> = says.iter().copied().chain([name.as_str()]).collect();
            refused_only(&bench, line, &says);
        }
    }
    // A missing reference is left out with a warning, or is an error if the scene is useless without it.
    for (kind, _) in kinds {
        let mut scene = bench.json("panel.gltf");
        scene["images"] = json!([{ "uri": format!("{kind}.png") }, { "uri": "panel.png" }]);
        bench.write("refers.gltf", &scene.to_string());
        let said = stderr(&run(&bench, &format!("render refers.gltf {SMALL} -o x.png --progress none")).code(0));
        assert!(said.contains(&format!("{kind}.png")) && said.contains("left out"), "{kind}: {said}");
        scene["buffers"][0]["uri"] = json!(format!("{kind}.hdr"));
        bench.write("refers.gltf", &scene.to_string());
        if kind != "empty" {
            refused_only(&bench, "render refers.gltf -o x.png", &["buffer 0", kind]);
        }
    }
}

/// As [`refused`], without a look at the other files.
#[cfg(unix)]
fn refused_only(bench: &Bench, line: &str, says: &[&str]) {
    let message = stderr(&run(bench, line).code(2));
    for part in says {
        assert!(message.contains(part), "`{line}` does not say `{part}`:\n{message}");
    }
}

#[cfg(unix)]
#[test]
fn outputs_that_are_no_regular_files_are_refused_and_stay() {
    use std::os::unix::fs::{FileTypeExt, symlink};
    use std::os::unix::net::UnixListener;
    let bench = furnished();
    let made = std::process::Command::new("mkfifo").arg(bench.path("pipe.png")).status().expect("mkfifo is at hand");
    assert!(made.success());
    symlink("/dev/full", bench.path("full.json")).expect("links work");
    let _socket = UnixListener::bind(bench.path("socket.exr")).expect("a socket");
    for (line, says) in [
        ("render scene.gltf -o pipe.png", "a named pipe"),
        ("render scene.gltf --stats full.json -o x.png", "a device"),
        ("render scene.gltf --exr socket.exr -o x.png", "a socket"),
        ("render scene.gltf --checkpoint pipe.png -o x.png", "a named pipe"),
        ("expose env.exr -o pipe.png", "a named pipe"),
        ("denoise env.exr --denoise builtin -o socket.exr", "a socket"),
    ] {
        refused(&bench, &[(line, &[says, "name a regular file"])]);
    }
    let kind = |name: &str| fs::symlink_metadata(bench.path(name)).expect("still there").file_type();
    assert!(kind("pipe.png").is_fifo() && kind("full.json").is_symlink() && kind("socket.exr").is_socket());
}

/// Jobs and sensors of editors that write a byte order mark.
#[test]
fn jobs_and_sensors_may_begin_with_a_byte_order_mark() {
    let bench = furnished();
    for name in ["panel.toml", "sensor.toml", "panel.gltf"] {
        let text = String::from_utf8(bench.read(name)).expect("text");
        bench.write(name, &format!("\u{feff}{text}"));
    }
    run(&bench, "render panel.toml -o x.png").code(0);
    run(&bench, "sensors sensor.toml").code(0);
}
