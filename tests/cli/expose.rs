//! `dunkelfeld expose` as users of the program have it.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it expose::NAME`.

use crate::bench::{Bench, stderr, stdout};
use dunkelfeld_io::exr::{Channel, ExrLayers, write_exr};
use dunkelfeld_io::gray::read_gray;
use dunkelfeld_io::loader::Limits;
use serde_json::Value;

/// A grey ramp as another renderer writes it.
fn ramp(bench: &Bench, file: &str, first: f32) {
    let mut layers = ExrLayers::new(24, 16);
    let samples = (0..24 * 16).map(|i| if i == 0 { first } else { i as f32 * 1e-3 });
    layers.channels = vec![("Y".into(), Channel::F32(samples.collect()))];
    write_exr(&bench.path(file), layers).expect("written");
}

const COLOUR: &str = "name = \"colour\"\nsource = \"made up\"\nbit_depth = 12\npixel_pitch_um = 3.45\nfull_well_e = 10000\n\
    dark_noise_e = 3\ngain_e_per_dn = 2.5\noffset_dn = 30\n[color_filter]\npattern = \"rggb\"\n\
    red = [[465, 0.04], [550, 0.06], [610, 0.45]]\ngreen = [[465, 0.15], [530, 0.58], [610, 0.1]]\n\
    blue = [[465, 0.52], [550, 0.12], [610, 0.04]]\n";

/// A render and `expose` of its EXR write the same files.
#[test]
fn an_image_of_our_own_is_exposed_as_its_render_was() {
    let bench = Bench::new();
    bench.write("colour.toml", COLOUR);
    for (sensor, more) in [("imx174", "--exposure auto"), ("imx900-hcg", "--exposure 700us"), ("colour.toml", "")] {
        let camera = format!("--sensor {sensor} {more} --seed 3 --frame 5");
        let files = "-o a.png --linear a.tif --exr a.exr";
        bench.run(&format!("render scene.gltf --width 40 --height 30 --spp 4 {camera} {files}")).code(0);
        let run = bench.run(&format!("expose a.exr {camera} -o b.png --linear b.tif --threads 2")).code(0);
        assert!(stdout(&run).contains("40 x 30 pixels") && stdout(&run).contains("per second"), "{}", stdout(&run));
        assert_eq!(bench.read("a.png"), bench.read("b.png"), "{sensor}");
        assert_eq!(bench.read("a.tif"), bench.read("b.tif"), "{sensor}");
    }
    // The byte of a PNG with its kind of pixels: grey is 0, colours are 2.
    assert_eq!(bench.read("b.png")[25], 2, "behind a colour filter the picture has colours");
    bench.run("expose a.exr -o colour.png").code(0);
    assert_eq!(bench.read("colour.png")[25], 2, "the sensor is that of the file");
    bench.run("expose a.exr --sensor imx250 -o grey.png").code(0);
    assert_eq!(bench.read("grey.png")[25], 0);
}

/// A job whose lens, gain and black level are not the default ones: `expose` takes them from the EXR, with pixels
/// without samples and with an effect left out. A flag replaces its value.
#[test]
fn an_exr_contains_the_lens_and_the_sensor_of_its_render() {
    let bench = Bench::new();
    bench.write(
        "job.toml",
        "scene = \"scene.gltf\"\nlens = { f_number = 2.8, transmission = 0.7, magnification = 0.2 }\n\
         film = { width = 40, height = 30, pixel_pitch = \"64um\" }\nseed = 3\n\
         sensor = { model = \"imx174\", exposure = \"2ms\", gain = \"6dB\", black_level = 100, temperature = 40 }\n",
    );
    for more in ["--spp 4", "--spp 0.5", "--spp 4 --without every-light"] {
        bench.run(&format!("render job.toml {more} -o a.png --linear a.tif --exr a.exr")).code(0);
        let run = bench.run("expose a.exr --exposure 2ms --seed 3 -o b.png --linear b.tif").code(0);
        let line = "lens: f/2.8 (of the file), transmission 0.7 (of the file), magnification 0.200 (of the file)";
        assert!(stdout(&run).contains(line) && stdout(&run).contains("IMX174"), "{}", stdout(&run));
        assert_eq!(bench.read("a.png"), bench.read("b.png"), "{more}");
        assert_eq!(bench.read("a.tif"), bench.read("b.tif"), "{more}");
    }
    // The sensor of a flag has no gain of a job, in a render as in an exposure.
    bench.run("render job.toml --spp 4 --sensor imx174 -o a.png --linear a.tif --exr a.exr").code(0);
    bench.run("expose a.exr --sensor imx174 --exposure 2ms --seed 3 --linear b.tif").code(0);
    assert_eq!(bench.read("a.tif"), bench.read("b.tif"));
    let run =
        bench.run("expose a.exr --f-number 2.8 --transmission 0.7 --exposure 2ms --seed 3 --linear c.tif").code(0);
    assert!(stdout(&run).contains("lens: f/2.8, transmission 0.7, magnification 0.200 (of the file)"));
    bench.run("expose a.exr --exposure 2ms --seed 3 --linear d.tif").code(0);
    assert_eq!(bench.read("c.tif"), bench.read("d.tif"));
    ramp(&bench, "ramp.exr", 0.0);
    let run = bench.run("expose ramp.exr --f-number 8 -o c.png").code(0);
    let defaults = "lens: f/8, transmission 0.9 (default, the file contains none), magnification 0 (default";
    assert!(stdout(&run).contains(defaults), "{}", stdout(&run));
}

/// 16-bit files of a 12-bit sensor: right-aligned, or times 16.
#[test]
fn grey_values_are_right_aligned_or_left_aligned() {
    let bench = Bench::new();
    ramp(&bench, "ramp.exr", 0.0);
    let values = |file: &str| read_gray(&bench.path(file), &Limits::default()).expect("grey values").values.into_vec();
    bench.run("expose ramp.exr --linear right.png").code(0);
    bench.run("expose ramp.exr --linear left.png --align left").code(0);
    let [right, left] = ["right.png", "left.png"].map(values);
    assert!(right.iter().all(|v| *v <= 4095) && right.iter().any(|v| *v > 3000));
    assert!(right.iter().zip(&left).all(|(right, left)| right * 16 == *left));
    bench.run("render scene.gltf --width 8 --height 6 --spp 1 --linear a.png -o p.png").code(0);
    bench.run("render scene.gltf --width 8 --height 6 --spp 1 --linear b.png -o p.png --align left").code(0);
    assert!(values("a.png").iter().zip(values("b.png")).all(|(right, left)| right * 16 == left));
}

/// Frames of one device are the renders with their numbers; an automatic exposure is that of the first.
#[test]
fn frames_of_a_render_are_those_of_one_device() {
    let bench = Bench::new();
    let render = "render scene.gltf --width 24 --height 16 --spp 2 --seed 5";
    let run = bench.run(&format!("{render} --frames 3 --frame 7 -o a.png --linear a.tif --stats a.json")).code(0);
    assert!(stdout(&run).contains("frame 9"), "{}", stdout(&run));
    let stats = |file: &str| serde_json::from_slice::<Value>(&bench.read(file)).expect("JSON");
    let exposure = stats("a-0007.json")["sensor"]["exposure_seconds"].as_f64().expect("a time");
    for (frame, name) in [(7, "a-0007"), (8, "a-0008"), (9, "a-0009")] {
        let one = format!("{render} --frame {frame} --exposure {exposure}s -o b.png --linear b.tif");
        bench.run(&one).code(0);
        assert_eq!(bench.read(&format!("{name}.tif")), bench.read("b.tif"), "{name}");
        assert_eq!(stats(&format!("{name}.json"))["sensor"]["exposure_seconds"].as_f64(), Some(exposure));
    }
    assert_ne!(bench.read("a-0007.tif"), bench.read("a-0008.tif"));
    for (flags, part) in [
        ("--frames 2 --checkpoint a.film", "--checkpoint"),
        ("--frames 2 --debug-sample 1,1,0", "--debug-sample"),
        ("--frames 0", "--frames"),
        ("--frames 2 --frame 4294967295", "2^32"),
    ] {
        let message = stderr(&bench.run(&format!("{render} {flags}")).code(2));
        assert!(message.contains(part), "{flags}: {message}");
    }
}

/// The EXR of a render contains lens, binning, stages, wavelengths and the exposure time of its samples.
#[test]
fn a_line_scan_in_infrared_light_is_exposed_as_its_render_was() {
    let bench = Bench::new();
    let pattern = "dsnu_e = 40\nprnu_percent = 3\n";
    let curve = "quantum_efficiency = [[400, 0.4], [550, 0.7], [850, 0.2], [1000, 0.05]]\nresolution = [80, 60]\n";
    let head = "name = \"lines\"\nsource = \"made up\"\nbit_depth = 12\npixel_pitch_um = 3.45\nfull_well_e = 10000\n";
    let noise = "dark_noise_e = 3\ngain_e_per_dn = 2.5\noffset_dn = 30\n";
    bench.write("lines.toml", &format!("{head}{noise}{curve}{pattern}"));
    bench.write(
        "job.toml",
        "scene = \"scene.gltf\"\ncamera = { look_at = [0, 0, 0], working_distance = \"300mm\" }\n\
         lens = { f_number = 4, transmission = 0.9, magnification = 0.05 }\nfilm = { full = true, binning = 2 }\n\
         sensor = { model = \"lines.toml\", exposure = \"20us\" }\nline_scan = { line_rate = \"10kHz\", tdi_stages = 3 }\n\
         [[light]]\nkind = \"ring\"\ndiameter = \"200mm\"\ninner_diameter = \"60mm\"\ndistance = \"200mm\"\n\
         power = \"5W\"\nwavelength = \"850nm\"\n",
    );
    bench.run("render job.toml --spp 4 --seed 3 --linear a.tif --exr a.exr").code(0);
    for camera in ["", "--sensor lines.toml --f-number 4 --magnification 0.05 --exposure 60us"] {
        bench.run(&format!("expose a.exr {camera} --seed 3 --linear b.tif")).code(0);
        assert_eq!(bench.read("a.tif"), bench.read("b.tif"), "{camera}");
    }
    let said = stderr(&bench.run("expose a.exr --exposure 1ms --linear b.tif").code(2));
    assert!(said.contains("0.00006 s") && said.contains("leave the exposure out"), "{said}");
    // Parts of it, merged, have the pattern of the whole.
    bench.run("render job.toml --samples 0..4 --seed 3 --linear whole.tif --checkpoint whole.film").code(0);
    bench.run("render job.toml --samples 0..2 --seed 3 --checkpoint first.film").code(0);
    bench.run("render job.toml --samples 2..4 --seed 3 --checkpoint second.film").code(0);
    bench.run("merge first.film second.film --linear merged.tif").code(0);
    assert_eq!(bench.read("whole.tif"), bench.read("merged.tif"));
}

#[test]
fn faults_of_an_image_are_printed_and_flagged() {
    let bench = Bench::new();
    ramp(&bench, "bad.exr", f32::NAN);
    let run = bench.run("expose bad.exr -o a.png").code(1);
    assert!(stderr(&run).contains("flagged: the radiance of 1 pixel"), "{}", stderr(&run));
    let mut dark = ExrLayers::new(4, 4);
    dark.channels = vec![("Y".into(), Channel::F32(vec![0.0; 16]))];
    write_exr(&bench.path("dark.exr"), dark).expect("written");
    let run = bench.run("expose dark.exr -o a.png").code(0);
    assert!(stderr(&run).contains("no automatic exposure"), "{}", stderr(&run));
}

#[test]
fn images_that_cannot_be_exposed_are_refused_without_output() {
    let bench = Bench::new();
    ramp(&bench, "ramp.exr", 0.0);
    bench.write("text.exr", "no image");
    bench.write("there.png", "precious");
    let before = bench.names();
    let cases: [(&str, &[&str]); 12] = [
        ("text.exr", &["text.exr", "help:"]),
        ("ramp.exr --sensor none", &["no sensor", "imx250"]),
        ("ramp.exr --exposure 0s", &["--exposure"]),
        ("ramp.exr --f-number 0.1", &["--f-number", "0.1", "from 0.5 to 1000"]),
        ("ramp.exr --vignetting cos4 --focal-length 0mm", &["--focal-length", "12mm"]),
        ("ramp.exr --vignetting cos4", &["focal length", "help:"]),
        ("ramp.exr --focal-length 12mm", &["vignetting"]),
        ("ramp.exr --layer Combined", &["Combined", "the channels are Y", "help:"]),
        ("ramp.exr --frames 0", &["--frames"]),
        ("ramp.exr --frame 4294967295 --frames 2", &["frames", "2^32", "help:"]),
        ("ramp.exr --linear a.exr", &["a.exr", ".tif", "help:"]),
        ("ramp.exr --linear there.png", &["there.png", "two outputs", "help:"]),
    ];
    for (line, says) in cases {
        let message = stderr(&bench.run(&format!("expose {line} -o there.png")).code(2));
        assert!(message.starts_with("error: "), "{line}\n{message}");
        for part in says {
            assert!(message.contains(part), "`{line}` does not say `{part}`:\n{message}");
        }
    }
    assert_eq!(bench.names(), before, "something was written");
    assert_eq!(bench.read("there.png"), b"precious");
}
