//! Denoising as users of the program have it: `render --denoise` and `denoise`.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it denoise::NAME`.

use crate::bench::{Bench, stderr, stdout};
use dunkelfeld_io::exr::{Channel, ExrLayers, read_exr, write_exr};
use dunkelfeld_io::layers::Triple;
use serde_json::Value;

/// Does the file hold the text, as its metadata do?
fn says(bench: &Bench, file: &str, text: &str) -> bool {
    bench.read(file).windows(text.len()).any(|w| w == text.as_bytes())
}

/// Nothing that is measured reads the denoised image: every layer but its own, the raw grey values, the plan, and every
/// number of the statistics but those of denoising and of time are what they are without.
#[test]
fn measurements_never_read_the_denoised_image() {
    let bench = Bench::new();
    let render = "render scene.gltf --width 40 --height 30 --spp 12 --seed 3 --exposure-noise matched";
    bench.run(&format!("{render} -o a.png --linear a.tif --exr a.exr --plan ap.exr --stats a.json")).code(0);
    let run = bench
        .run(&format!("{render} --denoise builtin -o b.png --linear b.tif --exr b.exr --plan bp.exr --stats b.json"))
        .code(0);
    assert!(stdout(&run).contains("the picture is denoised by builtin"), "{}", stdout(&run));

    let [plain, denoised] = ["a.exr", "b.exr"].map(|f| read_exr(&bench.path(f)).expect("an EXR"));
    let kept = denoised.channels.iter().filter(|(name, _)| !name.starts_with("denoised."));
    assert_eq!(kept.cloned().collect::<Vec<_>>(), plain.channels);
    assert_eq!(denoised.channels.len(), plain.channels.len() + 3);
    let (mean, smooth) = (denoised.triples(Triple::Mean), denoised.triples(Triple::Denoised));
    assert!(mean != smooth && smooth.is_some_and(|p| p.data().as_flattened().iter().all(|v| v.is_finite())));
    let attributes: Value = serde_json::from_str(&denoised.attributes).expect("JSON");
    assert!(attributes["denoiser"].as_str().is_some_and(|d| d.starts_with("builtin")), "{attributes}");
    let attributes: Value = serde_json::from_str(&plain.attributes).expect("JSON");
    assert!(attributes["denoiser"].is_null(), "{attributes}");

    assert_eq!(bench.read("a.tif"), bench.read("b.tif"), "raw grey values");
    assert_eq!(bench.read("ap.exr"), bench.read("bp.exr"), "the plan");
    let [mut a, mut b] = ["a.json", "b.json"].map(|f| bench.json(f));
    assert!(a["denoise"].is_null() && b["denoise"]["error"].is_null(), "{}", b["denoise"]);
    assert!(b["denoise"]["seconds"].as_f64().is_some_and(|s| s > 0.0) && b["seconds"]["denoise"].is_number());
    for stats in [&mut a, &mut b] {
        for field in ["denoise", "seconds", "total_seconds", "samples_per_second", "forecast", "memory"] {
            stats[field] = Value::Null;
        }
    }
    assert_eq!(a, b);
    assert!(a["certificate"]["ratio_mean"].is_number() && a["sensor"]["matched"].is_number());

    // The pictures differ, and the denoised one contains a note.
    assert_ne!(bench.read("a.png"), bench.read("b.png"));
    assert!(says(&bench, "b.png", "denoised by builtin") && !says(&bench, "a.png", "denoised"));
    // The same again, also from the plan, and on other threads.
    bench.run(&format!("{render} --denoise builtin --threads 3 -o c.png --exr c.exr")).code(0);
    assert_eq!((bench.read("b.png"), bench.read("b.exr")), (bench.read("c.png"), bench.read("c.exr")));
}

#[test]
fn an_image_of_our_own_is_denoised_as_its_render_would_have_been() {
    let bench = Bench::new();
    let render = "render scene.gltf --width 40 --height 30 --spp 12 --seed 3";
    bench.run(&format!("{render} --denoise builtin -o a.png --exr a.exr")).code(0);
    bench.run(&format!("{render} -o b.png --exr b.exr")).code(0);
    let run = bench.run("denoise b.exr -o c.exr --denoise builtin").code(0);
    assert!(stdout(&run).contains("40 x 30 pixels, denoised by builtin"), "{}", stdout(&run));
    assert!(
        stdout(&run).contains("the image and its variance, first light, albedo, normal, depth"),
        "{}",
        stdout(&run)
    );
    let [from_render, from_file] = ["a.exr", "c.exr"].map(|f| read_exr(&bench.path(f)).expect("an EXR"));
    assert_eq!(from_render, from_file);
    // A denoised image is not denoised twice: it is the mean that counts.
    bench.run("denoise c.exr -o d.exr --denoise builtin --threads 1").code(0);
    assert_eq!(bench.read("c.exr"), bench.read("d.exr"));

    // As a picture: its radiances have a unit, so that the bright parts are brought near white.
    bench.run("denoise b.exr -o b2.png --denoise builtin").code(0);
    assert!(says(&bench, "b2.png", "denoised by builtin") && says(&bench, "b2.png", "white is a radiance of"));
}

/// A value from inside or outside the disc (1 or 0) and from noise in 0 to 1.
type Shade = fn(f32, f32) -> f32;

/// A file as another program writes it, without variances: a bright disc with noise, its albedo and normal.
fn foreign(bench: &Bench, file: &str, names: &[(&str, Shade)]) -> ExrLayers {
    let (width, height) = (48u32, 40u32);
    let mut layers = ExrLayers::new(width, height);
    for (name, value) in names {
        let samples = (0..width * height).map(|i| {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            let inside = f32::from(u8::from((x - 24.0).powi(2) + (y - 20.0).powi(2) < 144.0));
            let noise = (i.wrapping_mul(0x9e37_79b9) ^ (i << 7)).wrapping_mul(0x85eb_ca6b) as f32 / u32::MAX as f32;
            value(inside, noise)
        });
        layers.channels.push(((*name).into(), Channel::F32(samples.collect())));
    }
    layers.channels.sort_by(|a, b| a.0.cmp(&b.0));
    write_exr(&bench.path(file), layers.clone()).expect("written");
    layers
}

#[test]
fn images_of_others_are_denoised_under_their_own_names() {
    let bench = Bench::new();
    let color: Shade = |inside, noise| (0.1 + 0.7 * inside) * (0.5 + noise);
    let albedo: Shade = |inside, _| 0.2 + 0.6 * inside;
    let (zero, one): (Shade, Shade) = (|_, _| 0.0, |_, _| 1.0);
    let blender = [
        ("ViewLayer.Combined.R", color),
        ("ViewLayer.Combined.G", color),
        ("ViewLayer.Combined.B", color),
        ("ViewLayer.Combined.A", one),
        ("ViewLayer.Denoising Albedo.R", albedo),
        ("ViewLayer.Denoising Albedo.G", albedo),
        ("ViewLayer.Denoising Albedo.B", albedo),
        ("ViewLayer.Denoising Normal.X", zero),
        ("ViewLayer.Denoising Normal.Y", zero),
        ("ViewLayer.Denoising Normal.Z", one),
    ];
    let mitsuba = [
        ("R", color),
        ("G", color),
        ("B", color),
        ("albedo.R", albedo),
        ("albedo.G", albedo),
        ("albedo.B", albedo),
        ("nn.X", zero),
        ("nn.Y", zero),
        ("nn.Z", one),
        ("dd.Y", one),
    ];
    for (file, names, used) in [
        ("blender.exr", &blender[..], "albedo, normal in"),
        ("mitsuba.exr", &mitsuba[..], "albedo, normal, depth in"),
        ("plain.exr", &mitsuba[..3], "the image alone"),
    ] {
        let before = foreign(&bench, file, names);
        let run = bench.run(&format!("denoise {file} -o out.exr --denoise builtin")).code(0);
        let used = used.trim_end_matches(" in");
        assert!(stdout(&run).contains(used), "{}", stdout(&run));
        let after = read_exr(&bench.path("out.exr")).expect("an EXR");
        let kept: Vec<_> = after.channels.iter().filter(|(name, _)| !name.starts_with("denoised.")).cloned().collect();
        assert_eq!(kept, before.channels, "{file}: what was there stays");
        let error = |layer| {
            let plane = after.triples(layer).expect("there");
            let off = plane.data().iter().enumerate().map(|(i, v)| {
                let (x, y) = ((i % 48) as f32, (i / 48) as f32);
                let inside = (x - 24.0).powi(2) + (y - 20.0).powi(2) < 144.0;
                (v[1] - if inside { 0.8 } else { 0.1 }).powi(2)
            });
            off.sum::<f32>()
        };
        assert!(error(Triple::Denoised) < 0.6 * error(Triple::Mean), "{file}: it is closer to the truth");
        bench.run(&format!("denoise {file} -o out.png --denoise builtin")).code(0);
        assert!(says(&bench, "out.png", "denoised by builtin") && !says(&bench, "out.png", "white is"));
    }
}

#[test]
fn inputs_that_cannot_be_denoised_are_refused_before_any_output() {
    let bench = Bench::new();
    bench.write("notes.exr", "no image");
    bench.write("there.txt", "");
    std::fs::create_dir(bench.path("empty")).expect("writable");
    foreign(&bench, "good.exr", &[("R", |_, n| n), ("G", |_, n| n), ("B", |_, n| n)]);
    foreign(&bench, "depth.exr", &[("Z", |_, n| n), ("mist.V", |_, n| n)]);
    let before = bench.names();
    let cases: &[(&str, &[&str])] = &[
        ("denoise nowhere.exr -o x.exr", &["nowhere.exr", "help:"]),
        ("denoise notes.exr -o x.exr", &["notes.exr", "help:"]),
        ("denoise depth.exr -o x.exr", &["depth.exr", "radiance", "Z, mist.V", "Combined.R", "help:"]),
        ("denoise good.exr -o x.tif", &["x.tif", ".tif", "help: end it in .exr"]),
        ("denoise good.exr -o ./good.exr", &["good.exr", "is the input", "help:"]),
        ("denoise good.exr -o missing/x.exr", &["missing/x.exr", "help:"]),
        ("denoise good.exr -o x.exr --denoise off", &["help: choose another than `off`"]),
        ("denoise good.exr -o x.exr --denoise builtin --oidn lib.so", &["lib.so is not used", "help:"]),
        ("denoise good.exr -o x.exr --oidn nowhere/lib.so", &["nowhere/lib.so", "builtin", "help: install"]),
        ("denoise good.exr -o x.exr --oidn empty", &["no OpenImageDenoise library in empty", "help:"]),
        ("denoise good.exr -o x.exr --denoise auto --oidn there.txt", &["there.txt", "help:"]),
        ("denoise good.exr", &["--output"]),
        ("render scene.gltf --oidn nowhere/lib.so -o x.png", &["nowhere/lib.so", "help:"]),
        ("render scene.gltf --denoise magic -o x.png", &["magic", "builtin"]),
    ];
    for (line, texts) in cases {
        let error = stderr(&bench.run(line).code(2));
        for text in *texts {
            assert!(error.contains(text), "{line}: \"{text}\" is not in\n{error}");
        }
        assert_eq!(bench.names(), before, "{line}: something was left behind");
    }
}

/// With the library itself, where the environment names it.
#[test]
fn a_library_that_the_environment_names_is_used() {
    let Some(library) = std::env::var_os("DUNKELFELD_OIDN") else {
        println!("skipped: DUNKELFELD_OIDN names no library");
        return;
    };
    let bench = Bench::new();
    let render = "render scene.gltf --width 40 --height 30 --spp 8 --seed 3";
    let run = bench.run(&format!("{render} --denoise auto -o a.png --exr a.exr")).code(0);
    assert!(stdout(&run).contains("denoised by Intel Open Image Denoise"), "{}", stdout(&run));
    assert!(says(&bench, "a.png", "denoised by Intel Open Image Denoise"));
    let path = library.to_string_lossy();
    bench.run_words(&["denoise", "a.exr", "-o", "b.exr", "--oidn", &path]).code(0);
    let [a, b] = ["a.exr", "b.exr"].map(|f| read_exr(&bench.path(f)).expect("an EXR").triples(Triple::Denoised));
    assert!(a.is_some() && a == b);
}
