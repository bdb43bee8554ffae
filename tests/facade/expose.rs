//! Exposing images of any renderer, and colour sensors: layers, lens, mosaic and given noise in the facade.
//!
//! Replay: `cargo test -p dunkelfeld --test it expose::NAME`.

use crate::support::{Add, build, emitter, rendered, settings, square};
use dunkelfeld::commands::{ExposeOutputs, expose_exr};
use dunkelfeld::film::Plane;
use dunkelfeld::geometry::DVec3;
use dunkelfeld::outputs::ExrImage;
use dunkelfeld::radiometry::{Electrons, Rgb, Seconds};
use dunkelfeld::sensor::{BayerPattern, Exposure, ExposureNoise, Optics, SensorModel};
use dunkelfeld::{
    Cancel, ExposeSettings, Exposer, Frame, Picture, RenderSettings, SensorChoice, Session, develop_film, find_sensor,
};
use dunkelfeld_io::exr::{Channel, ExrLayers, write_exr};
use dunkelfeld_io::layers::{Single, Triple};
use dunkelfeld_io::sensor_file::parse_sensor;
use dunkelfeld_io::toml_file::TomlFile;
use std::path::PathBuf;
use tempfile::TempDir;

fn folder() -> TempDir {
    TempDir::new().expect("a temporary folder")
}

/// An image of one renderer or another: channels of floats.
fn written(folder: &TempDir, name: &str, size: (u32, u32), channels: &[(&str, Vec<f32>)]) -> PathBuf {
    let mut layers = ExrLayers::new(size.0, size.1);
    layers.channels = channels.iter().map(|(name, v)| ((*name).into(), Channel::F32(v.clone()))).collect();
    layers.channels.sort_by(|a, b| a.0.cmp(&b.0));
    let path = folder.path().join(name);
    write_exr(&path, layers).expect("written");
    path
}

fn exposure(seconds: f64) -> Option<Exposure> {
    Some(Exposure::new(Seconds(seconds)).expect("in range"))
}

/// A sensor with negligible noise, in which a third of the light comes with each band.
fn sensor(rest: &str) -> SensorModel {
    let text = format!(
        "name = \"test\"\nsource = \"made up\"\nbit_depth = 16\npixel_pitch_um = 3.45\nfull_well_e = 60000\ndark_noise_e = 4\n\
         gain_dn_per_e = 1\noffset_dn = 100\n{rest}"
    );
    parse_sensor(&TomlFile::from_text("test.toml", text)).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()))
}

const MONO: &str = "quantum_efficiency = [[550, 0.6]]\n";
const RED: &str = "[[465, 0.04], [550, 0.06], [610, 0.45]]";
const GREEN: &str = "[[465, 0.15], [530, 0.58], [610, 0.1]]";
const BLUE: &str = "[[465, 0.52], [550, 0.12], [610, 0.04]]";

fn colour(pattern: BayerPattern) -> SensorModel {
    let name = pattern.name();
    sensor(&format!("[color_filter]\npattern = \"{name}\"\nred = {RED}\ngreen = {GREEN}\nblue = {BLUE}\n"))
}

fn exposing(model: SensorModel) -> ExposeSettings {
    ExposeSettings::new(model).expect("defaults").with_exposure(exposure(1e-3))
}

/// EMVA 1288's own anchor: mu_p = 50.34 A\[um^2\] t\[ms\] lambda\[um\] E\[uW/cm^2\], summed over the three bands, through the lens
/// E = pi L tau / (4 N^2 (1 + m)^2). 1 W/m^2 is 100 uW/cm^2.
#[test]
fn an_image_of_another_renderer_gives_the_electrons_of_the_standard() {
    let folder = folder();
    let size = (6, 4);
    let flat = |v: f32| vec![v; 24];
    let path = written(
        &folder,
        "blender.exr",
        size,
        &[
            ("ViewLayer.Combined.R", flat(2.0)),
            ("ViewLayer.Combined.G", flat(1.0)),
            ("ViewLayer.Combined.B", flat(0.5)),
            ("ViewLayer.Emit.R", flat(7.0)),
            ("ViewLayer.Emit.G", flat(7.0)),
            ("ViewLayer.Emit.B", flat(7.0)),
        ],
    );
    let settings = exposing(sensor(MONO)).with_optics(Optics::new(2.8, 0.8, 0.25).expect("in range"));
    let expected = |rgb: [f64; 3]| {
        let irradiance = std::f64::consts::PI * 0.8 / (4.0 * 2.8 * 2.8 * 1.25 * 1.25) * 100.0;
        let bands = [0.61, 0.55, 0.465];
        let sum: f64 = bands.iter().zip(rgb).map(|(lambda, l)| lambda * l / 3.0).sum();
        0.6 * 50.34 * 3.45 * 3.45 * 1.0 * irradiance * sum
    };
    for (layer, rgb) in
        [(None, [2.0, 1.0, 0.5]), (Some("emit"), [7.0; 3]), (Some("ViewLayer.Combined"), [2.0, 1.0, 0.5])]
    {
        let settings = settings.clone().with_layer(layer.map(Into::into));
        let exposer = Exposer::open(&path, &settings).expect("an image");
        assert_eq!(exposer.size(), [6, 4]);
        for &e in exposer.electrons().data() {
            assert!((f64::from(e) / expected(rgb) - 1.0).abs() < 1e-4, "{layer:?}: {e}, not {}", expected(rgb));
        }
    }
    let missing = settings.with_layer(Some("Diffuse".into()));
    let message = Exposer::open(&path, &missing).expect_err("no such layer").to_string();
    assert!(
        message.contains("Diffuse") && message.contains("ViewLayer.Emit.R") && message.contains("help"),
        "{message}"
    );
}

/// A thin lens of 5 mm over 101 x 61 pixels of 3.45 um: tan^2 of the field angle from the pixel's distance to the middle.
#[test]
fn a_lens_that_vignettes_darkens_by_the_fourth_power_of_the_cosine() {
    let folder = folder();
    let size = (101, 61);
    let path = written(&folder, "grey.exr", size, &[("Y", vec![3.0; 101 * 61])]);
    let f = 0.4e-3;
    let open = |vignetting, magnification| {
        let optics = Optics::new(4.0, 0.9, magnification).expect("in range");
        let settings = exposing(sensor(MONO)).with_vignetting(vignetting).with_optics(optics);
        Exposer::open(&path, &settings).expect("an image").electrons().clone()
    };
    for m in [0.0, 0.5] {
        let (plain, dark) = (open(None, m), open(Some(f), m));
        assert!(plain.data().iter().all(|e| e == plain.at(0, 0)), "a flat image stays flat by default");
        for (x, y) in [(50, 30), (0, 0), (100, 60), (100, 30), (50, 0), (77, 12)] {
            let off = f64::hypot(f64::from(x) - 50.0, f64::from(y) - 30.0) * 3.45e-6;
            let cosine = (off / (f * (1.0 + m))).atan().cos();
            let got = f64::from(*dark.at(x, y)) / f64::from(*plain.at(x, y));
            assert!((got / cosine.powi(4) - 1.0).abs() < 1e-6, "({x}, {y}), m = {m}: {got}, not {}", cosine.powi(4));
        }
    }
    // A long lens hardly darkens.
    assert!(*open(Some(1.0), 0.0).at(0, 0) > 0.999_999 * *open(None, 0.0).at(0, 0));
}

#[test]
fn frames_are_numbered_and_do_not_depend_on_threads_or_company() {
    let folder = folder();
    let ramp = (0..40 * 30).map(|i| i as f32 * 1e-3).collect();
    let path = written(&folder, "ramp.exr", (40, 30), &[("R", ramp), ("G", vec![0.3; 1200]), ("B", vec![0.1; 1200])]);
    let model = find_sensor("imx174").expect("a preset");
    let many = exposing(model).with_seed(5).with_first_frame(9998).with_frames(5).with_exposure(None).with_threads(3);
    let outputs = |name: &str| {
        ExposeOutputs::default()
            .with_image(folder.path().join(format!("{name}.png")))
            .with_linear(folder.path().join(format!("{name}.tif")))
    };
    let done =
        expose_exr(&path, &many, &outputs("many"), &Session::new(many.threads).expect("threads")).expect("exposed");
    let names: Vec<_> =
        done.files.iter().map(|f| f.file_name().expect("a name").to_string_lossy().into_owned()).collect();
    assert_eq!(
        (done.frames, names.len(), names[0].as_str(), names[9].as_str()),
        (5, 10, "many-09998.png", "many-10002.tif")
    );
    // One of them alone, on one thread.
    let one = many.clone().with_first_frame(10_000).with_frames(1).with_threads(1);
    let alone =
        expose_exr(&path, &one, &outputs("one"), &Session::new(one.threads).expect("threads")).expect("exposed");
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
    for ending in ["png", "tif"] {
        assert_eq!(read(&format!("many-10000.{ending}")), read(&format!("one.{ending}")));
        assert_ne!(read(&format!("many-10001.{ending}")), read(&format!("one.{ending}")));
    }
    assert_eq!(alone.exposer.exposure(), done.exposer.exposure(), "the automatic exposure is that of the image");
    // In memory, from the same image.
    let exposer = Exposer::open(&path, &many).expect("an image");
    let frames = [1, 4].map(|n| Session::new(n).expect("threads").install(|| exposer.frame(10_000).expect("a frame")));
    assert_eq!(frames[0], frames[1]);
    // A run that was cancelled before its first frame writes none.
    let cancel = Cancel::new();
    cancel.cancel();
    let none = expose_exr(&path, &many, &outputs("none"), &Session::new(1).expect("threads").with_cancel(&cancel))
        .expect("nothing to do");
    assert_eq!((none.frames, none.files.len()), (0, 0));
}

/// An image whose pixels scatter with a given variance around one truth: plain frames have its noise and that of the camera, matched
/// ones have that of the camera alone. 40 000 pixels: a variance is known to 0.7 %, the bar is seven of that.
#[test]
fn known_noise_of_an_image_is_taken_out_of_the_cameras() {
    const SIDE: u32 = 200;
    let count = (SIDE * SIDE) as usize;
    let folder = folder();
    let model = sensor(MONO);
    let settings = exposing(model.clone()).with_optics(Optics::new(4.0, 1.0, 0.0).expect("in range"));
    let flat = written(&folder, "flat.exr", (1, 1), &[("Y", vec![1.0])]);
    let per_radiance = f64::from(*Exposer::open(&flat, &settings).expect("an image").electrons().at(0, 0));
    // 400 electrons, the noise of the render half of the camera's as a variance.
    let truth = 400.0 / per_radiance;
    let time = Seconds(1e-3);
    let camera = model.temporal_variance(Electrons(400.0), time);
    let spread = (0.5 * camera).sqrt() / per_radiance;
    // Twelve uniform numbers minus six are nearly normal, with a variance of one.
    let mut state = 1u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let noisy: Vec<f32> =
        (0..count).map(|_| (truth + spread * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0)) as f32).collect();
    let variance = vec![(spread * spread) as f32; count];
    let channels: Vec<(&str, Vec<f32>)> = ["R", "G", "B"]
        .into_iter()
        .map(|c| (c, noisy.clone()))
        .chain(["variance.R", "variance.G", "variance.B"].into_iter().map(|c| (c, variance.clone())))
        .collect();
    let path = written(&folder, "noisy.exr", (SIDE, SIDE), &channels);
    for (exposure_noise, expected) in [(ExposureNoise::Plain, 1.5), (ExposureNoise::Matched, 1.0)] {
        let settings = settings.clone().with_exposure_noise(exposure_noise).with_seed(3);
        let frame = Exposer::open(&path, &settings).expect("an image").frame(0).expect("a frame");
        let n = count as f64;
        let mean = frame.data().iter().map(|&y| f64::from(y)).sum::<f64>() / n;
        let got = frame.data().iter().map(|&y| (f64::from(y) - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let ratio = (got - 1.0 / 12.0) / (camera - 1.0 / 12.0);
        assert!((ratio / expected - 1.0).abs() < 0.05, "{exposure_noise:?}: {ratio:.3} of the camera's variance");
        assert!((mean - 500.0).abs() < 7.0 * (got / n).sqrt(), "{exposure_noise:?}: mean {mean}");
    }
    // Unknown noise cannot be compensated, and frames that share it would have too little noise together.
    let matched = settings.with_exposure_noise(ExposureNoise::Matched);
    for (path, settings, part) in [
        (&flat, matched.clone(), "layer `variance`"),
        (&path, matched.clone().with_frames(2), "share its noise"),
        (&path, matched.with_layer(String::new()), "--layer"),
    ] {
        let message = Exposer::open(path, &settings).expect_err(part).to_string();
        assert!(message.contains(part) && message.contains("help"), "{message}");
    }
}

// --- Colour ------------------------------------------------------------------------------------------------------------

/// A coloured floor under a lamp.
fn lit_floor(sensor: SensorModel, noise: ExposureNoise) -> (dunkelfeld::Rendering, RenderSettings) {
    let mut b = dunkelfeld::scene::SceneBuilder::default();
    let base_color = Rgb::new(0.7, 0.4, 0.2);
    b.add(
        "floor",
        square(0.0, 2.4, false),
        dunkelfeld::scene::Material { base_color: base_color.into(), ..Default::default() },
    );
    b.add("lamp", square(1.2, 0.8, true), emitter(20.0));
    b.add_camera("camera", DVec3::new(1.1, -2.0, 1.1), DVec3::new(0.0, 0.0, 0.1), 0.7);
    let optics = Optics::new(4.0, 0.9, 0.0).expect("in range");
    let sensor = SensorChoice::Emva { model: Box::new(sensor), optics, exposure: exposure(0.3e-3) };
    let settings = settings(30, 24, 16.0, 4).with_sensor(sensor).with_exposure_noise(noise);
    (rendered(&build(b), &settings), settings)
}

fn developed(rendering: &dunkelfeld::Rendering, settings: &RenderSettings) -> Frame {
    develop_film(&rendering.film, settings).expect("a frame")
}

/// A pixel behind a filter is exposed, certified and matched as the same pixel of a monochrome sensor with the curve of its
/// colour: to the last bit, wherever it stands.
#[test]
fn every_pixel_of_a_mosaic_is_one_of_a_monochrome_sensor_of_its_colour() {
    for (pattern, noise) in
        BayerPattern::ALL.into_iter().zip([ExposureNoise::Plain, ExposureNoise::Matched].into_iter().cycle())
    {
        let (rendering, settings) = lit_floor(colour(pattern), noise);
        let frame = developed(&rendering, &settings);
        let mosaic = frame.sensor.as_ref().expect("a sensor");
        assert!(matches!(&frame.picture, Picture::Rgb(p) if p.width() == 30), "the picture has colours");
        for (color, curve) in [RED, GREEN, BLUE].into_iter().enumerate() {
            let SensorChoice::Emva { optics, exposure, .. } = settings.sensor.clone() else { panic!("a sensor") };
            let model = Box::new(sensor(&format!("quantum_efficiency = {curve}\n")));
            let mono = settings.clone().with_sensor(SensorChoice::Emva { model, optics, exposure });
            let frame = developed(&rendering, &mono);
            let mono = frame.sensor.as_ref().expect("a sensor");
            let ratios = [mosaic, mono].map(|s| &s.certified.as_ref().expect("certified").ratios);
            let held = [mosaic, mono].map(|s| s.matched.as_ref().map(|m| &m.held));
            for (x, y) in (0..24).flat_map(|y| (0..30).map(move |x| (x, y))) {
                if pattern.color_at(x, y) as usize != color {
                    continue;
                }
                let place = format!("{} ({x}, {y}) {noise:?}", pattern.name());
                assert_eq!(mosaic.electrons.at(x, y), mono.electrons.at(x, y), "{place}");
                assert_eq!(mosaic.values.at(x, y), mono.values.at(x, y), "{place}");
                assert_eq!(ratios[0].at(x, y), ratios[1].at(x, y), "{place}");
                if let [Some(a), Some(b)] = held {
                    assert_eq!(a.at(x, y), b.at(x, y), "{place}");
                }
            }
        }
    }
}

/// A matched frame of a render behind a colour sensor, the layers of its EXR, and how to expose these likewise.
fn matched_behind_a_mosaic() -> (Frame, ExrLayers, ExposeSettings) {
    let exposure_noise = ExposureNoise::Matched;
    let (rendering, settings) = lit_floor(colour(BayerPattern::Rggb), exposure_noise);
    let frame = developed(&rendering, &settings);
    let layers = dunkelfeld::outputs::encode_layers(&rendering.film, &frame, &settings);
    let SensorChoice::Emva { model, optics, exposure } = settings.sensor else { panic!("a sensor") };
    let defaults = ExposeSettings::new(*model).expect("defaults");
    (
        frame,
        layers,
        defaults
            .with_optics(optics)
            .with_exposure(exposure)
            .with_exposure_noise(exposure_noise)
            .with_seed(settings.seed),
    )
}

/// Behind a colour filter a budget of noise is met by the pixels of every colour, and samples do not follow the mosaic's edges.
#[test]
fn a_render_behind_a_filter_is_planned_and_certified() {
    use dunkelfeld::Budget;
    use dunkelfeld_adaptive::weights::Strategy;
    let (_, settings) = lit_floor(colour(BayerPattern::Rggb), ExposureNoise::Plain);
    let mut b = dunkelfeld::scene::SceneBuilder::default();
    b.add("lamp", square(0.0, 3.0, false), emitter(5.0));
    b.add_camera("camera", DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, 0.7);
    let scene = build(b);
    // A flat image has no edges: the paper's method shares its samples out evenly, mosaic or not.
    let sobel = settings.clone().with_strategy(Strategy::Sobel).with_budget(Budget::default().with_spp(32.0));
    let counts = rendered(&scene, &sobel).film.sums.sample_counts();
    let (least, most) = (counts.data().iter().min(), counts.data().iter().max());
    assert!(most.zip(least).is_some_and(|(most, least)| most - least <= 1), "{least:?} to {most:?} samples");
    // And a level of noise is reached.
    let (_, settings) = lit_floor(colour(BayerPattern::Grbg), ExposureNoise::Plain);
    let budget = Budget::default().with_noise(1.0).with_spp(Some(4000.0));
    let hidden = settings.with_strategy(Strategy::Sensor).with_budget(budget);
    let mut b = dunkelfeld::scene::SceneBuilder::default();
    b.add("floor", square(0.0, 2.4, false), dunkelfeld::scene::Material::default());
    b.add("lamp", square(1.2, 0.8, true), emitter(20.0));
    b.add_camera("camera", DVec3::new(1.1, -2.0, 1.1), DVec3::new(0.0, 0.0, 0.1), 0.7);
    let rendering = rendered(&build(b), &hidden);
    let frame = developed(&rendering, &hidden);
    let certified = frame.sensor.and_then(|s| s.certified).expect("certified");
    assert!(certified.certificate.is_hidden(), "{:?}", certified.certificate);
}

/// A render with a colour sensor can be exposed again from its EXR, noise matched: but for rounding as the render had it.
#[test]
fn layers_of_a_render_are_matched_as_the_render_was() {
    let folder = folder();
    let (frame, layers, exposing) = matched_behind_a_mosaic();
    assert!(layers.triples(Triple::Variance).is_some() && layers.integers(Single::ObjectId).is_some());
    let path = folder.path().join("layers.exr");
    write_exr(&path, layers).expect("written");
    let expose = |exposure_noise| {
        let settings = exposing.clone().with_exposure_noise(exposure_noise);
        Exposer::open(&path, &settings).expect("an image").frame(0).expect("a frame")
    };
    let own = &frame.sensor.as_ref().expect("a sensor").values;
    // Layers are single precision: what is left out may be a little different.
    let distance = |other: &Plane<u16>| {
        let off = own.data().iter().zip(other.data()).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2));
        off.sum::<f64>() / own.data().len() as f64
    };
    let (matched, plain) = (distance(&expose(ExposureNoise::Matched)), distance(&expose(ExposureNoise::Plain)));
    assert!(
        matched < 0.02 * plain,
        "mean square {matched:.2} from the render's own matched frame, {plain:.2} when plain"
    );
    // An image that is read once has the same frames, as has the noise that is analysed apart.
    let with = |exposure_noise| exposing.clone().with_exposure_noise(exposure_noise);
    let image = ExrImage::open(&path, &with(ExposureNoise::Matched)).expect("an image");
    for noise in [ExposureNoise::Matched, ExposureNoise::Plain] {
        assert!(image.expose(&with(noise)).expect("a camera").frame(0).expect("a frame") == expose(noise), "{noise:?}");
    }
    let noise = image.image_noise(&with(ExposureNoise::Plain)).expect("variances");
    let plain = image.expose(&with(ExposureNoise::Plain)).expect("a camera");
    let frame = plain.with_noise(&noise, None).expect("one film").frame(0).expect("a frame");
    assert!(frame == expose(ExposureNoise::Matched));
    let unread = ExrImage::open(&path, &with(ExposureNoise::Plain)).expect("an image");
    let error = unread.expose(&with(ExposureNoise::Matched)).expect_err("no noise").to_string();
    assert!(error.contains("was not read"), "{error}");
}
