//! The text of the command line, whole: help, version, messages of refusals, sensors, inspection.
//!
//! Each command has a file in `tests/snapshots/` with its exit code, standard output and standard error. After an intended
//! change, this command writes the files anew; the difference is then reviewed with `git diff tests/snapshots`:
//! `INSTA_UPDATE=always cargo test -p dunkelfeld-cli --test it snapshots`.
//!
//! Everything runs in a temporary folder with relative paths. The name of the program and the version are replaced, and the
//! width of the help does not depend on a terminal.

use crate::bench::Bench;
use assert_cmd::Command;
use std::fs;

/// The commands of the program, subcommands of subcommands included.
const COMMANDS: [&str; 16] = [
    "",
    "render",
    "merge",
    "bench",
    "dataset",
    "denoise",
    "expose",
    "emva",
    "emva dataset",
    "emva analyse",
    "mtf",
    "ptc",
    "view",
    "init",
    "inspect",
    "sensors",
];

/// The whole answer of the program to a line.
fn answer(bench: &Bench, line: &str) -> String {
    let mut command = Command::new(crate::bench::PROGRAM);
    for variable in ["COLUMNS", "LINES", "CLICOLOR", "CLICOLOR_FORCE", "NO_COLOR", "TERM"] {
        command.env_remove(variable);
    }
    let run = command.current_dir(bench.folder.path()).args(line.split_whitespace()).assert();
    let code = run.get_output().status.code().map_or("none".to_owned(), |code| code.to_string());
    let mut text = format!("$ dunkelfeld {line}\nexit code: {code}\n");
    for (name, stream) in
        [("standard output", crate::bench::stdout(&run)), ("standard error", crate::bench::stderr(&run))]
    {
        if !stream.is_empty() {
            let stream = stream.replace("dunkelfeld.exe", "dunkelfeld").replace(env!("CARGO_PKG_VERSION"), "[VERSION]");
            text.push_str(&format!("--- {name}\n{stream}"));
        }
    }
    assert!(!text.contains(&*bench.folder.path().to_string_lossy()), "a path of this machine: {text}");
    text
}

/// Compares an answer with the file `NAME.snap`.
fn check(name: &str, answer: &str) {
    let mut settings = insta::Settings::clone_current();
    settings.set_snapshot_path("../snapshots");
    settings.set_prepend_module_to_snapshot(false);
    settings.set_omit_expression(true);
    settings.bind(|| insta::assert_snapshot!(name, answer));
}

fn file_name(line: &str) -> String {
    line.split_whitespace().collect::<Vec<_>>().join("-")
}

#[test]
fn help_of_every_command() {
    let bench = Bench::new();
    for command in COMMANDS {
        let text = answer(&bench, format!("{command} --help").trim());
        assert!(text.contains("\nexit code: 0\n") && text.contains("\nUsage: dunkelfeld"), "{text}");
        check(&file_name(&format!("help {command}")), &text);
    }
}

/// The list of commands above is the one that the program prints.
#[test]
fn no_command_is_left_out() {
    let bench = Bench::new();
    let listed = |command: &str| -> Vec<String> {
        let text = answer(&bench, format!("{command} --help").trim());
        let section = text.split("\nCommands:\n").nth(1).unwrap_or_default();
        let lines = section.lines().take_while(|line| line.starts_with("  "));
        let names = lines.filter(|line| !line.starts_with("   ")).filter_map(|line| line.split_whitespace().next());
        names.filter(|name| *name != "help").map(|name| format!("{command} {name}").trim().to_owned()).collect()
    };
    let mut found = vec![String::new()];
    let mut next = 0;
    while next < found.len() {
        let more = listed(&found[next]);
        found.extend(more);
        next += 1;
    }
    found.sort();
    let mut expected = COMMANDS.map(str::to_owned);
    expected.sort();
    assert_eq!(found, expected);
}

#[test]
fn version() {
    let bench = Bench::new();
    check("version", &answer(&bench, "--version"));
}

#[test]
fn sensors_as_list_as_sheet_and_as_json() {
    let bench = Bench::new();
    for line in ["sensors", "sensors imx250", "sensors imx250 --json"] {
        check(&file_name(line), &answer(&bench, line));
    }
}

#[test]
fn inspection_of_a_small_job() {
    let bench = Bench::new();
    for line in ["inspect job.toml", "inspect job.toml --json"] {
        check(&file_name(line), &answer(&bench, line));
    }
    let hint = |glare: &str| {
        bench.write("lens.toml", &format!("scene = \"scene.gltf\"\n[lens]\nf_number = 4\n{glare}"));
        answer(&bench, "inspect lens.toml").contains("real lenses have 1 to 3 %")
    };
    assert!(hint("") && !hint("glare = 0\n") && !hint("psf = \"none\"\n"));
}

#[test]
fn refusals() {
    let bench = Bench::new();
    let scene = "scene = \"scene.gltf\"\n";
    for (name, text) in [
        ("broken.gltf", "{ \"asset\": ".to_owned()),
        ("notes.txt", "no scene".to_owned()),
        ("unknown-key.toml", format!("{scene}[film]\nwidht = 3\n")),
        ("unknown-table.toml", format!("{scene}[films]\nwidth = 3\n")),
        ("wrong-type.toml", format!("{scene}[film]\nwidth = \"wide\"\n")),
        ("no-scene.toml", "[film]\nwidth = 3\n".to_owned()),
        ("no-unit.toml", format!("{scene}[lens]\nvertical_fov = 30\n")),
        ("range.toml", format!("{scene}seed = -1\n")),
        ("syntax.toml", format!("{scene}[film\n")),
        ("camera.toml", format!("{scene}camera = \"frnt\"\n")),
        ("nowhere.toml", "seed = 1\nscene = \"nowhere.glb\"\n".to_owned()),
        ("model.toml", format!("{scene}[sensor]\nmodel = \"imx251\"\n")),
        ("far.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n".to_owned()),
        ("there.png", "precious".to_owned()),
    ] {
        bench.write(name, &text);
    }
    fs::create_dir(bench.path("folder.png")).expect("writable");
    let before = bench.names();
    for (name, line) in [
        ("no-command", ""),
        ("unknown-command", "paint"),
        ("unknown-flag", "render scene.gltf --spps 4"),
        ("missing-argument", "render"),
        ("missing-file", "render nowhere.glb"),
        ("no-scene-format", "render notes.txt"),
        ("broken-gltf", "inspect broken.gltf"),
        ("unusable-obj", "inspect far.obj"),
        ("job-unknown-key", "render unknown-key.toml"),
        ("job-unknown-table", "render unknown-table.toml"),
        ("job-wrong-type", "render wrong-type.toml"),
        ("job-no-scene", "render no-scene.toml"),
        ("job-no-unit", "render no-unit.toml"),
        ("job-out-of-range", "render range.toml"),
        ("job-syntax", "render syntax.toml"),
        ("job-unknown-camera", "render camera.toml"),
        ("job-missing-scene", "render nowhere.toml"),
        ("job-unknown-sensor", "render model.toml"),
        ("width-zero", "render scene.gltf --width 0"),
        ("spp-negative", "render scene.gltf --spp=-1"),
        ("time-unknown-unit", "render scene.gltf --time 20parsecs"),
        ("unknown-strategy", "render scene.gltf --allocate best"),
        ("unknown-effect", "render scene.gltf --without every-lamp"),
        ("unknown-sensor", "render scene.gltf --sensor imx999"),
        ("exposure-without-sensor", "render scene.gltf --exposure 5ms --sensor none"),
        ("output-ending", "render scene.gltf -o a.jpg"),
        ("output-folder-missing", "render scene.gltf -o missing/a.png"),
        ("output-is-a-folder", "render scene.gltf -o folder.png"),
        ("output-twice", "render scene.gltf --exr a.exr --plan ./a.exr"),
        ("output-replaces-input", "denoise there.png -o there.png"),
        ("bench-folder-is-the-scene", "bench scene.gltf -o scene.gltf"),
        ("expose-missing-file", "expose nowhere.exr --sensor imx250"),
        ("emva-missing-file", "emva analyse nowhere.txt"),
        ("ptc-too-few-frames", "ptc scene.gltf --frames 2"),
    ] {
        let text = answer(&bench, line);
        assert!(text.contains("\nexit code: 2\n"), "{text}");
        check(&format!("refused-{name}"), &text);
    }
    assert_eq!(bench.names(), before, "a refusal wrote a file");
    assert_eq!(bench.read("there.png"), b"precious");
}
