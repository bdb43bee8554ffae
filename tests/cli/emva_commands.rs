//! `dunkelfeld emva` as users of the program have it.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it emva_commands::NAME`.

use crate::bench::{Bench, stderr, stdout};

const SMALL: &str = "--size 48x40 --levels 20 --spatial 4 --seed 3 --progress none";

#[test]
fn a_data_set_is_written_and_its_figures_are_found() {
    let bench = Bench::new();
    let run = bench.run(&format!("emva dataset --sensor imx900-hcg -o set {SMALL}")).code(0);
    assert!(stdout(&run).contains("88 frames of 48 x 40 pixels, 20 levels of light at 536 nm"), "{}", stdout(&run));
    let run =
        bench.run("emva analyse set/emva.txt --html r.html --json r.json --pixel-pitch 2.25 --progress none").code(0);
    let table = stdout(&run);
    for row in ["eta ", "K ", "mu_p.min.area ", "DSNU1288.row ", "LE "] {
        assert!(table.lines().any(|l| l.starts_with(row)), "{row}: {table}");
    }
    // It has fewer levels than the standard requires, and a note names the difference.
    assert!(stderr(&run).contains("note: there are 20 levels of light, the standard requires 50"), "{}", stderr(&run));
    let truth = bench.json("set/truth.json");
    let found = bench.json("r.json");
    let all = found["quantities"].as_array().expect("figures");
    let gain = all.iter().find(|q| q["symbol"] == "K").expect("a gain");
    let [value, error] = ["value", "standard_error"].map(|k| gain[k].as_f64().expect("a number"));
    let z = (value - truth["quantities"]["K"].as_f64().expect("a number")) / error;
    assert!(z.abs() < 6.5, "K is {z:.1} standard errors off");
    assert!(String::from_utf8_lossy(&bench.read("r.html")).starts_with("<!DOCTYPE html>"));

    // The same again, by other rules, on one thread, and by the other module.
    let again = bench.run("emva analyse set/emva.txt --threads 1 --pixel-pitch 2.25 --progress none").code(0);
    assert_eq!(stdout(&again), table.replace("wrote r.json\nwrote r.html\n", ""));
    let old = bench.run("emva analyze set/emva.txt --release 3.1 --progress none").code(0);
    assert_ne!(stdout(&old), table);
    let general = bench.run("emva analyse set/emva.txt --general --progress none").code(0);
    assert!(stdout(&general).contains("sigma_p.dark") && !stdout(&general).contains("eta"), "{}", stdout(&general));
}

/// The written sensor is checked by `sensors`, and rendered with its maps: only at their size.
#[test]
fn a_measured_camera_is_written_and_rendered() {
    let bench = Bench::new();
    bench.run(&format!("emva dataset --sensor imx900-lcg -o set {SMALL}")).code(0);
    let analyse =
        "emva analyse set/emva.txt --sensor mine.toml --maps --pixel-pitch 2.25 --wavelength 536 --progress none";
    let run = bench.run(analyse).code(0);
    for name in ["mine.toml", "mine-dsnu.tif", "mine-prnu.tif", "mine-flat.tif"] {
        assert!(stdout(&run).contains(&format!("wrote {name}\n")) && bench.path(name).is_file(), "{}", stdout(&run));
    }
    let text = String::from_utf8(bench.read("mine.toml")).expect("text");
    for part in [
        "gain_dn_per_e = 0.4",
        ", K\n",
        "[[536, 0.",
        "resolution = [48, 40]",
        "prnu_map = \"mine-prnu.tif\"",
        "# Note: ",
    ] {
        assert!(text.contains(part), "`{part}` is not in\n{text}");
    }
    assert!(stdout(&bench.run("sensors mine.toml").code(0)).contains("mine"));
    bench.write("job.toml", "scene = \"scene.gltf\"\nsensor = { model = \"mine.toml\" }\n[budget]\nspp = 1\n");
    bench.run("render job.toml --width 48 --height 40 -o a.png --progress none").code(0);
    let run = bench.run("render job.toml --width 40 --height 40 -o b.png --progress none").code(2);
    assert!(stderr(&run).contains("40 x 40") && stderr(&run).contains("48 x 40"), "{}", stderr(&run));
    // Without stacks there are no maps, and nothing is written.
    let whole = String::from_utf8(bench.read("set/emva.txt")).expect("text");
    let stacks = whole.rfind("\nd ").expect("the dark stack");
    bench.write("set/pairs.txt", &whole[..=stacks]);
    let run = bench.run(&analyse.replace("emva.txt", "pairs.txt").replace("mine.toml", "other.toml")).code(2);
    assert!(stderr(&run).contains("there are no stacks") && !bench.path("other.toml").exists(), "{}", stderr(&run));
}

#[test]
fn impossible_requests_end_with_code_2_help_and_no_output() {
    let bench = Bench::new();
    bench.run(&format!("emva dataset --sensor imx250 -o set {SMALL}")).code(0);
    let whole = String::from_utf8(bench.read("set/emva.txt")).expect("text");
    let dark: String = {
        let end = whole.find("\nb ").expect("a level");
        whole[..=end].to_owned()
    };
    bench.write("set/dark.txt", &dark);
    bench.write("set/short.txt", &whole.replace("n 12 48 40", "n 12 48"));
    bench.write("set/other.txt", &whole.replace("n 12 48 40", "n 12 40 48"));
    bench.write("set/gone.txt", &whole.replace("images/b_001_0.png", "images/gone.png"));
    let first = whole.find("\ni images/b_021").expect("a level in the middle");
    bench.write("set/dim.txt", &whole[..whole[..first].rfind("\nb ").expect("its block") + 1]);
    let before = bench.names();
    let frame = bench.read("set/images/b_001_0.png");
    let cases: &[(&str, &[&str])] = &[
        ("dataset --sensor imx250 -o set", &["set", "not empty", "help:"]),
        ("dataset --sensor imx250 -o scene.bin", &["scene.bin", "in the way", "help:"]),
        ("dataset --sensor imx999 -o new", &["imx999", "imx250", "help:"]),
        ("dataset --sensor imx250 -o new --color red", &["color", "no colour filters", "help:"]),
        ("dataset --sensor imx250 -o new --size 640", &["--size", "640x480"]),
        ("dataset --sensor imx250 -o new --levels 3", &["--levels", "from 10 to 1000"]),
        ("dataset --sensor imx250 -o new --exposure 0s", &["--exposure", "100ms"]),
        (
            "dataset --sensor imx900-hcg -o new --exposure 100000s",
            &["exposure", "100000 s the pixels fill in the dark", "help: choose a shorter time", "1.47 dark electrons"],
        ),
        ("dataset --sensor imx250", &["--output"]),
        ("analyse nowhere.txt", &["nowhere.txt", "help:"]),
        ("analyse scene.bin", &["scene.bin", "help:"]),
        ("analyse set/dark.txt", &["dark.txt", "no pair of frames with light", "help: add blocks of two frames"]),
        (
            "analyse set/short.txt",
            &["short.txt", "line 2", "2 | n 12 48", "^^^^^^^", "help: write `n BITS WIDTH HEIGHT`"],
        ),
        ("analyse set/other.txt", &["images", ".png", "48 x 40 pixels, the data set 40 x 48", "help:"]),
        ("analyse set/gone.txt", &["gone.png", "help:"]),
        ("analyse set/dim.txt", &["dim.txt", "not saturated", "help: add levels with more light"]),
        ("analyse set/emva.txt --html missing/r.html", &["missing/r.html", "folder", "help:"]),
        ("analyse set/emva.txt --html ./set/emva.txt", &["set/emva.txt", "descriptor", "help: write to another file"]),
        ("analyse set/emva.txt --json set/../set/emva.txt", &["emva.txt", "descriptor", "help:"]),
        (
            "analyse set/emva.txt --json set/images/b_001_0.png",
            &["b_001_0.png", "is a frame", "help: write to another file"],
        ),
        ("analyse set/emva.txt --json r --html ./r", &["./r", "two outputs", "help: give each its own file"]),
        ("analyse set/emva.txt --sensor m.toml --pixel-pitch 3.45", &["neither", "--wavelength 545"]),
        ("analyse set/emva.txt --general --sensor m.toml --pixel-pitch 3.45 --wavelength 545", &["neither K", "help:"]),
        ("analyse set/emva.txt --sensor m.png", &["--sensor", "mine.toml"]),
        ("analyse set/emva.txt --maps", &["--sensor"]),
        ("analyse set/emva.txt --release 5.0", &["5.0", "4.0", "3.1"]),
        ("analyse set/emva.txt --pixel-pitch 0", &["--pixel-pitch", "3.45"]),
    ];
    for (words, says) in cases {
        let run = bench.run(&format!("emva {words} --progress none")).code(2);
        for part in *says {
            assert!(stderr(&run).contains(part), "emva {words}: `{part}` is not in\n{}", stderr(&run));
        }
        assert!(stdout(&run).is_empty(), "emva {words}: {}", stdout(&run));
    }
    assert_eq!(bench.names(), before);
    assert_eq!((bench.read("set/emva.txt"), bench.read("set/images/b_001_0.png")), (whole.into_bytes(), frame));
}
