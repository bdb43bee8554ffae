//! `dunkelfeld bench` as its users have it: the report and its numbers, going on after an interruption, what it refuses.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it noise_bench::NAME`.

use crate::lab::{CutAt, Lab, complaint, same_numbers, square, stands_alone};
use crate::markup::as_xml;
use dunkelfeld::adaptive::Strategy;
use dunkelfeld::{Cancel, Progress, Project, Session, Silent};
use dunkelfeld_io::exr::{Channel, read_exr, write_exr};
use dunkelfeld_studies::StudyOutcome;
use dunkelfeld_studies::bench::{BenchSettings, bench};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// A tiny bench: everything in it, nothing of it large.
const TINY: &str = "bench <scene>.obj --quick --width 20 --height 14 --spp 2,4 --seeds 4 --progress none";

/// The tiny bench with one of its flags (or a further one) set otherwise.
fn tiny_but(flag: &str, value: &str) -> String {
    let mut words: Vec<&str> = TINY.split(' ').collect();
    match words.iter().position(|w| *w == flag) {
        Some(at) => words[at + 1] = value,
        None => words.extend([flag, value]),
    }
    words.join(" ")
}

/// A lit floor, half hidden by a sheet that is there by chance.
fn lab() -> Lab {
    let objects = square(1.0, 0.0, false) + &square(0.4, 0.3, false) + &square(0.3, 1.0, true);
    let faces = "usemtl floor\nf 1 2 3 4\nusemtl sheet\nf 5 6 7 8\nusemtl lamp\nf 9 10 11 12\n";
    let sheet = "newmtl sheet\nKd 0.8 0.2 0.2\nd 0.5\n";
    let lamp = "newmtl lamp\nKd 0 0 0\nKe 3 3 3\n";
    Lab::new(&(objects + faces), &format!("newmtl floor\nKd 0.5 0.5 0.5\n{sheet}{lamp}"))
}

/// The tiny bench through the library.
fn call(lab: &Lab, folder: &Path, progress: &dyn Progress, cancel: &Cancel) -> StudyOutcome {
    let input = lab.path("<scene>.obj");
    let mut project = Project::open(&input).expect("a scene");
    (project.settings.width, project.settings.height) = (20, 14);
    let settings = BenchSettings::default().with_quick(true).with_seeds(4).with_spp(vec![2, 4]);
    let session = Session::new(0).expect("threads").with_progress(progress).with_cancel(cancel);
    bench(project, &input, &settings, folder, true, false, &session).expect("a bench")
}

#[test]
fn a_report_stands_alone_and_its_numbers_are_those_of_the_tables() {
    let bench = lab();
    let done = bench.run(TINY).code(0);
    let said = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    assert!(said.contains("report.html") && said.contains("without coverage"), "{said}");
    let home = "<scene>-bench";
    let page = as_xml(&bench.read(&format!("{home}/report.html")));

    let document = stands_alone(&page);
    for name in ["noise", "hidden", "denoised", "stages", "effects"] {
        same_numbers(&document, name, &bench.read(&format!("{home}/{name}.csv")));
    }

    // Every strategy at every rung, with a spread that is known; every chart as a file of its own.
    let noise = bench.table(&format!("{home}/noise.csv"));
    let points: BTreeSet<(&str, &str)> = noise.iter().map(|r| (r["strategy"].as_str(), r["spp"].as_str())).collect();
    let wanted = Strategy::ALL.iter().flat_map(|s| [(s.name(), "2"), (s.name(), "4")]).collect();
    assert_eq!(points, wanted);
    for row in &noise {
        for key in ["variance_picture", "variance_signal", "variance_over_sensor", "seconds", "variance_signal_error"] {
            assert!(row[key].parse::<f64>().is_ok_and(|v| v > 0.0), "{key}: {row:?}");
        }
    }
    let charts: Vec<String> = bench.names(home).into_iter().filter(|n| n.ends_with(".svg")).collect();
    assert_eq!(charts.len(), 11, "{charts:?}");
    for chart in charts {
        let text = bench.read(&format!("{home}/{chart}"));
        roxmltree::Document::parse(&text).unwrap_or_else(|e| panic!("{chart}: {e}"));
    }
}

#[test]
fn the_bias_of_an_effect_is_measured_at_its_pixels() {
    let bench = lab();
    bench.run(&format!("{TINY} --effect-spp 256 --strategies uniform -o out")).code(0);
    let effects = bench.table("out/effects.csv");
    assert_eq!(effects.iter().map(|r| r["effect"].as_str()).collect::<Vec<_>>(), ["coverage"]);
    let number = |key: &str| effects[0][key].parse::<f64>().unwrap_or_else(|_| panic!("{key}: {effects:?}"));
    // A sheet that is wholly there is not the floor that half shone through it, by far more than noise.
    assert!(number("bias_mean").abs() > 10.0 * number("bias_mean_error"), "{effects:?}");
    assert!(number("sigma_p99") > 3.0 * number("sigma_p99_noise"), "{effects:?}");
    assert_eq!(effects[0]["visible"], "yes");
}

#[test]
fn a_denoiser_is_shown_beside_what_it_was_given_and_nothing_else_reads_it() {
    let bench = lab();
    let flags = "--effects none --strategies uniform --reference-spp 1024 --spp 4,64 --seeds 8";
    let line = |denoise: &str, out: &str| {
        let tiny =
            TINY.replace("--spp 2,4 --seeds 4", flags).replace("--width 20 --height 14", "--width 96 --height 72");
        bench.run(&format!("{tiny} --denoise {denoise} -o {out}")).code(0);
    };
    line("builtin", "on");
    line("off", "off");
    let rows = bench.table("on/denoised.csv");
    let number = |denoiser: &str, spp: &str, key: &str| {
        let row = rows.iter().find(|r| r["denoiser"] == denoiser && r["spp"] == spp).expect("a row");
        row[key].parse::<f64>().unwrap_or_else(|_| panic!("{key}: {row:?}"))
    };
    assert_eq!(rows.len(), 4, "{rows:?}");
    for spp in ["4", "64"] {
        // Renders as they are have no error but their noise, within five standard errors of the sum of both.
        let noise = bench.table("on/noise.csv");
        let noise = noise.iter().find(|r| r["spp"] == spp).expect("a row");
        let [v, e] =
            ["variance_over_sensor", "variance_over_sensor_error"].map(|k| noise[k].parse::<f64>().expect("one"));
        let (error, of_error) = (number("off", spp, "squared_error"), number("off", spp, "squared_error_error"));
        assert!((error - v).abs() < 5.0 * (e + of_error), "{spp}: {error} +- {of_error} against {v} +- {e}");
        assert_eq!(number("off", spp, "error_over_off"), 1.0);
    }
    // Few samples gain from the filter, and what it smooths it has less of from render to render.
    assert!(number("builtin", "4", "error_over_off") < 0.9, "{rows:?}");
    assert!(number("builtin", "4", "noise_share") < 100.0, "{rows:?}");
    assert!(number("builtin", "4", "seconds") > number("off", "4", "seconds"));
    let page = bench.read("on/report.html");
    assert!(page.contains("Effect of a denoiser") && page.contains("denoised by builtin"));
    assert!(!bench.read("off/report.html").contains("Effect of a denoiser"));
    assert!(!bench.names("off").contains("denoised.csv"));
    // Everything else is what it is without one, but for the clock.
    for name in ["noise", "hidden"] {
        let timeless = |folder: &str| {
            let mut rows = bench.table(&format!("{folder}/{name}.csv"));
            rows.iter_mut().for_each(|r| r.retain(|k, _| !k.contains("seconds") && k != "over_best"));
            rows
        };
        assert_eq!(timeless("on"), timeless("off"), "{name}");
    }
}

#[test]
fn an_interrupted_bench_continues_with_the_same_numbers() {
    let bench = lab();
    let whole = call(&bench, &bench.path("whole"), &Silent, &Cancel::new());
    assert!(!whole.interrupted && whole.finished[0] == whole.finished[1], "{whole:?}");

    // Every unit reports at least once before it begins.
    let cut = bench.path("cut");
    let cancel = Cancel::new();
    let partial = call(&bench, &cut, &CutAt(0.4, &cancel), &cancel);
    assert!(partial.interrupted && (1..partial.finished[1]).contains(&partial.finished[0]), "{partial:?}");
    let page = bench.read("cut/report.html");
    assert!(page.contains(&format!("{} of {} renders", partial.finished[0], partial.finished[1])));

    // Finished renders are not repeated.
    let stamp = |name: &str| fs::metadata(cut.join("units").join(name)).and_then(|m| m.modified()).expect("a file");
    let kept: Vec<String> = bench.names("cut/units").into_iter().collect();
    let before: Vec<_> = kept.iter().map(|name| stamp(name)).collect();
    let rest = call(&bench, &cut, &Silent, &Cancel::new());
    assert_eq!(rest.finished, whole.finished);
    assert_eq!(kept.iter().map(|name| stamp(name)).collect::<Vec<_>>(), before);
    assert_eq!(bench.names("cut/units"), bench.names("whole/units"));

    // All but the clock's numbers are the same.
    let timeless = |folder: &str, name: &str| -> Vec<BTreeMap<String, String>> {
        let mut rows = bench.table(&format!("{folder}/{name}.csv"));
        let clocks = ["seconds", "seconds_error", "over_best", "seconds_saved", "seconds_saved_error", "share_saved"];
        rows.iter_mut().for_each(|row| row.retain(|key, _| !clocks.contains(&key.as_str())));
        rows
    };
    for name in ["noise", "hidden", "denoised", "effects"] {
        assert_eq!(timeless("cut", name), timeless("whole", name), "{name}");
    }
}

#[test]
fn a_folder_stays_with_what_it_measured() {
    let bench = lab();
    let small = format!("{TINY} --effects none --strategies uniform -o out");
    bench.run(&small).code(0);
    let record = bench.read("out/units/uniform-2-00.json");
    // Another seed, another size, another ladder, another scene: refused with the difference, and nothing is lost.
    let others = [
        ("--seed", "7", "not the same seed, \"0\" there and \"7\" here"),
        ("--width", "21", "not the same size"),
        ("--spp", "2,8", "settings"),
        ("--seeds", "6", "settings"),
        ("--sensor", "imx174", "sensor"),
        ("--denoise", "off", "not the same list of denoisers"),
    ];
    for (flag, value, difference) in others {
        let line = tiny_but(flag, value) + " --effects none --strategies uniform -o out";
        let said = complaint(&bench.run(&line).code(2));
        assert!(said.contains(difference) && said.contains("help:") && said.contains("--restart"), "{line}: {said}");
    }
    let mtl = bench.read("scene.mtl");
    bench.write("scene.mtl", &mtl.replace("Kd 0.5", "Kd 0.6"));
    let said = complaint(&bench.run(&small).code(2));
    assert!(said.contains("scene"), "{said}");
    assert_eq!(bench.read("out/units/uniform-2-00.json"), record);
    // More strategies of the same bench may join; another bench may not, without --restart.
    bench.write("scene.mtl", &mtl);
    bench.run(&small.replace("--strategies uniform", "--strategies uniform,sobel")).code(0);
    assert_eq!(bench.read("out/units/uniform-2-00.json"), record);
    bench.run(&format!("{small} --seed 7 --restart")).code(0);
    assert_ne!(bench.read("out/units/uniform-2-00.json"), record);
}

#[test]
fn inputs_that_cannot_be_measured_are_refused_with_help() {
    let bench = lab();
    bench.write("taken", "a file");
    let cases = [
        ("bench <scene>.obj --spp 8,4", "ascending"),
        ("bench <scene>.obj --seeds 3", "seeds"),
        ("bench <scene>.obj --effects color", "color"),
        ("bench <scene>.obj --effects every-light", "sampling technique"),
        ("bench <scene>.obj --strategies uniform,sobel,uniform", "strategies"),
        ("bench <scene>.obj --noise 0", "k"),
        ("bench <scene>.obj --denoise builtin,builtin", "denoise"),
        ("bench <scene>.obj --denoise builtin --oidn lib", "named and not used"),
        ("bench <scene>.obj --width 8 --height 8 -o taken", "in the way"),
    ];
    for (line, word) in cases {
        let said = complaint(&bench.run(line).code(2));
        assert!(said.contains(word), "{line}: {said}");
        assert!(!said.contains("panicked"), "{line}: {said}");
    }
    assert_eq!(bench.names(".").len(), 3, "{:?}", bench.names("."));
    // A record that is no record: the file, the line and what to do.
    let small = format!("{TINY} --effects none --strategies uniform -o out");
    bench.run(&small).code(0);
    bench.write("out/units/uniform-2-00.json", "{ \"name\": 3");
    let said = complaint(&bench.run(&small).code(2));
    assert!(said.contains("uniform-2-00.json") && said.contains("help:"), "{said}");
    // A record without its image is repaired in the same way.
    bench.run(&format!("{small} --restart")).code(0);
    fs::remove_file(bench.path("out/units/uniform-2-00.exr")).expect("there");
    let said = complaint(&bench.run(&small).code(2));
    assert!(said.contains("uniform-2-00.exr"), "{said}");
    // An image of another size, which statistics over renders would be wrong with.
    for name in ["uniform-2-00", "reference-16"] {
        bench.run(&format!("{small} --restart")).code(0);
        let path = bench.path(&format!("out/units/{name}.exr"));
        let mut image = read_exr(&path).unwrap_or_else(|e| panic!("{e}"));
        image.height -= 1;
        for (_, channel) in &mut image.channels {
            match channel {
                Channel::F32(samples) => samples.truncate(20 * 13),
                Channel::U32(samples) => samples.truncate(20 * 13),
            }
        }
        write_exr(&path, image).expect("written");
        let said = complaint(&bench.run(&small).code(2));
        assert!(said.contains(name) && said.contains("20 x 13") && said.contains("help:"), "{said}");
    }
}
