//! Job files: their values, their refusals, and the effects of their overrides on a scene.

use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, Vec3};
use dunkelfeld_io::InputError;
use dunkelfeld_io::import::EmissiveUnit;
use dunkelfeld_io::job::{Exposure, Job, LensProjection, LensSettings, Light, SensorChoice, Strength};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{
    AlphaMode, Camera, Distortion, EnvironmentSource, HeightField, Instance, Material, Medium, MeshPart,
    PrincipledModel, Projection, PunctualKind, PunctualLight, SceneBuilder, Surface, Vignetting, Volume,
};
use dunkelfeld_sensor::ExposureNoise;
use std::path::{Path, PathBuf};
use std::time::Duration;

fn job(text: &str) -> Job {
    Job::from_text("jobs/a.toml", text).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()))
}

/// With a scene named, as every job must.
fn with(text: &str) -> String {
    format!("scene = \"a.glb\"\n{text}")
}

const EVERYTHING: &str = r#"
scene = "../scenes/a.glb"
camera = "above"
seed = 7
frame = 3
[import]
emissive_unit = "W/(m2 sr)"
[lens]
focal_length = "12mm"
f_number = 5.6
transmission = 0.8
magnification = 0.1
[film]
width = 640
height = 480
pixel_pitch = "3.45um"
[budget]
time = "2min"
spp = 64
[allocate]
strategy = "sobel"
pilot_spp = 8
floor = 0.5
[sensor]
model = "sensors/mine.toml"
exposure = "5ms"
exposure_noise = "matched"
[output]
image = "out.png"
linear = "out.tif"
exr = "out.exr"
stats = "out.json"
plan = "plan.exr"
[environment]
image = "sky.hdr"
scale = 2
rotation = "90deg"
[[material]]
name = "pmma"
ior = 1.49
[[light]]
name = "rear"
power = "500mW"
"#;

#[test]
fn a_job_with_every_key() {
    let job = job(EVERYTHING);
    assert_eq!(job.scene_path(), Path::new("jobs/../scenes/a.glb"));
    assert_eq!((job.camera.selected.as_deref(), job.seed, job.frame), (Some("above"), 7, 3));
    assert_eq!(job.import_options().emissive_unit, EmissiveUnit::WattPerSteradianSquareMetre);
    assert!((job.lens.focal_length.unwrap() - 0.012).abs() < 1e-15);
    assert_eq!((job.lens.f_number, job.lens.transmission, job.lens.magnification), (Some(5.6), 0.8, Some(0.1)));
    assert_eq!((job.film.width, job.film.height), (Some(640), Some(480)));
    assert_eq!((job.budget.time, job.budget.spp), (Some(Duration::from_secs(120)), Some(64.0)));
    assert_eq!(
        (job.allocate.strategy, job.allocate.pilot_spp, job.allocate.floor),
        (Some(dunkelfeld_adaptive::Strategy::Sobel), 8, 0.5)
    );
    assert_eq!(job.sensor.model, SensorChoice::File(PathBuf::from("jobs/sensors/mine.toml")));
    assert_eq!((job.sensor.exposure, job.sensor.exposure_noise), (Exposure::Seconds(0.005), ExposureNoise::Matched));
    // Outputs stay relative to where the command runs.
    assert_eq!(job.output.image.as_deref(), Some(Path::new("out.png")));
    let environment = job.environment.unwrap();
    assert_eq!(environment.image.as_deref(), Some(Path::new("jobs/sky.hdr")));
    assert_eq!(environment.scale, Some(Rgb::splat(2.0)));
    assert!((environment.rotation.unwrap() - std::f32::consts::FRAC_PI_2).abs() < 1e-6);
    assert_eq!(job.materials[0].ior, Some(1.49));
    let is_change =
        |light: &Light| matches!(light, Light::Change(c) if c.enabled && c.strength == Some(Strength::Power(0.5)));
    assert!(is_change(&job.lights[0]), "{:?}", job.lights[0]);
}

#[test]
fn a_job_with_the_least_keys_gets_the_documented_defaults() {
    let job = job(&with(""));
    assert_eq!((job.seed, job.frame, job.camera.selected.as_deref()), (0, 0, None));
    assert_eq!(job.lens, LensSettings { transmission: 0.9, ..LensSettings::default() });
    assert_eq!((job.film.pixel_pitch, job.film.sensor_width, job.film.sensor_height), (None, None, None));
    assert_eq!((job.allocate.strategy, job.allocate.pilot_spp, job.allocate.floor), (None, 16, 0.25));
    assert_eq!(job.budget.noise, None);
    assert_eq!((job.sensor.model, job.sensor.exposure), (SensorChoice::Preset("imx250".into()), Exposure::Auto));
    assert_eq!(job.sensor.exposure_noise, ExposureNoise::Plain);
    assert_eq!(job.import.emissive_unit, EmissiveUnit::Nit);
    assert!(job.environment.is_none() && job.materials.is_empty() && job.lights.is_empty());
}

#[test]
fn a_lens_with_every_key() {
    let perspective = job(&with(
        r#"
        [lens]
        projection = "perspective"
        focal_length = "25mm"
        focus_distance = "0.4m"
        blades = 7
        blade_rotation = "15deg"
        distortion = [-0.1, 0.02, 0.001, -0.002, 0.003]
        principal_point = [12, -3.5]
        vignetting = "cos4"
        "#,
    ));
    let lens = &perspective.lens;
    assert_eq!((lens.projection, lens.focus_distance), (Some(LensProjection::Perspective), Some(0.4)));
    assert_eq!((lens.blades, lens.vignetting), (Some(7), Some(Vignetting::CosineFourth)));
    assert!((lens.blade_rotation.unwrap() - 15f32.to_radians()).abs() < 1e-6);
    let expected = Distortion { radial: [-0.1, 0.02, 0.003, 0.0, 0.0, 0.0], tangential: [0.001, -0.002] };
    assert_eq!((lens.distortion, lens.principal_point), (Some(expected), Some([12.0, -3.5])));
    let text = "[lens]\nprojection = \"telecentric\"\nfield_height = \"40mm\"\nnumerical_aperture = 0.02\nfocus_distance = 0.11";
    let lens = job(&with(text)).lens;
    assert_eq!((lens.field_height, lens.numerical_aperture, lens.f_number), (Some(0.04), Some(0.02), None));
    for inf in ["inf", "\"inf\""] {
        let text = format!("[lens]\nfocus_distance = {inf}\n[[material]]\nname = \"a\"\nattenuation_distance = {inf}");
        let job = job(&with(&text));
        assert_eq!(job.lens.focus_distance, Some(f64::INFINITY));
        assert_eq!(job.materials[0].interior.attenuation_distance, Some(f32::INFINITY));
    }
    assert_eq!(job(&with("[budget]\nspp = 2.5")).budget.spp, Some(2.5));
    // With a given size of a pixel, no sensor is needed.
    job(&with("[film]\npixel_pitch = \"5um\"\n[lens]\nfocal_length = \"12mm\"\n[sensor]\nmodel = \"none\""));
    assert!(Job::from_file(Path::new("no/such.toml")).is_err());
}

/// Two quads of 1 m by 2 m from one mesh, both of material "panel"; a cube-less "pmma"; three punctual lights; a camera.
fn scene() -> SceneBuilder {
    let mesh = Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 2.0, 0.0), Vec3::new(0.0, 2.0, 0.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    let material = |name: &str, emission: f32| Material {
        name: name.into(),
        emission: Rgb::splat(emission).into(),
        ..Material::default()
    };
    let instance = |name: &str, meshes: &[usize], scale: f64| Instance {
        name: name.into(),
        meshes: meshes.to_vec(),
        to_world: DAffine3::from_scale(DVec3::splat(scale)),
        motion: Default::default(),
    };
    let light = |name: &str, kind| PunctualLight { name: name.into(), to_world: DAffine3::IDENTITY, kind };
    SceneBuilder {
        materials: vec![material("panel", 2.0), material("pmma", 0.0), material("pmma edge", 0.0)],
        meshes: vec![
            MeshPart { name: "quad".into(), mesh: mesh.clone().into(), material: 0, ..MeshPart::default() },
            MeshPart { name: "sheet".into(), mesh: mesh.into(), material: 1, ..MeshPart::default() },
        ],
        instances: vec![instance("left", &[0], 1.0), instance("right", &[0], 2.0), instance("cover", &[1], 1.0)],
        lights: vec![
            light("bulb", PunctualKind::Point { intensity: Rgb::new(1.0, 2.0, 3.0) }),
            light("spot", PunctualKind::Spot { intensity: Rgb::BLACK, inner: 0.5, outer: 0.5 }),
            light("sun", PunctualKind::Directional { irradiance: Rgb::WHITE }),
        ],
        cameras: vec![Camera {
            name: "above".into(),
            to_world: DAffine3::IDENTITY,
            projection: Projection::Perspective { vertical_fov: 0.5 },
            ..Camera::default()
        }],
        ..SceneBuilder::default()
    }
}

fn changed(text: &str) -> SceneBuilder {
    let mut scene = scene();
    job(&with(text)).apply_overrides(&mut scene).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()));
    scene
}

fn unfit(text: &str) -> InputError {
    job(&with(text)).apply_overrides(&mut scene()).expect_err(text)
}

fn emission_of(scene: &SceneBuilder, instance: usize) -> Rgb {
    scene.materials[scene.meshes[scene.instances[instance].meshes[0]].material].emission.factor
}

/// Each light keeps its share of the strength of all lights of its name.
#[test]
fn a_scale_multiplies_the_strength_of_each_light() {
    let mut scene = scene();
    let light = PunctualKind::Point { intensity: Rgb::new(1.0, 2.0, 3.0) };
    let lamp = |kind| PunctualLight { name: "twins".into(), kind, to_world: DAffine3::IDENTITY };
    scene.lights = vec![lamp(light), lamp(PunctualKind::Directional { irradiance: Rgb::splat(4.0) })];
    let text = "[[light]]\nname = \"twins\"\nscale = 2\n";
    job(&with(text)).apply_overrides(&mut scene).expect("two lights");
    assert_eq!(scene.lights[0].kind, PunctualKind::Point { intensity: Rgb::new(2.0, 4.0, 6.0) });
    assert_eq!(scene.lights[1].kind, PunctualKind::Directional { irradiance: Rgb::splat(8.0) });
    // Of a surface, beside its power.
    let emission = |keys: &str| emission_of(&changed(&format!("[[light]]\nname = \"left\"\n{keys}\n")), 0).mean();
    let once = emission("power = 1");
    assert!(once > 0.0 && (emission("power = 1\nscale = 3") / (3.0 * once) - 1.0).abs() < 1e-6);
}

#[test]
fn material_factors_are_replaced_by_name_and_pattern() {
    let scene = changed(
        r#"
        [[material]]
        name = "pmma"
        solid = true
        transmission = 1
        attenuation_color = [0.9, 0.8, 0.7]
        attenuation_distance = "2mm"
        alpha_mode = "mask"
        [[material]]
        name = "pmma*"
        ior = 1.49
        roughness = 0
        base_color = 0.5
        "#,
    );
    let volume =
        Volume { attenuation_color: Rgb::new(0.9, 0.8, 0.7), attenuation_distance: 0.002, ..Volume::default() };
    let pmma = &scene.materials[1];
    assert_eq!((pmma.surface, pmma.transmission.factor), (Surface::Solid(volume), 1.0));
    assert_eq!(pmma.alpha_mode, AlphaMode::Mask { cutoff: 0.5 });
    for m in &scene.materials[1..] {
        assert_eq!((m.ior, m.roughness.factor, m.base_color.factor), (1.49, 0.0, Rgb::splat(0.5)));
    }
    assert_eq!(scene.materials[0], self::scene().materials[0]);
}

#[test]
fn media_are_stated_by_colour_or_by_coefficients() {
    let volume = |keys: &str| {
        let scene = changed(&format!("[[material]]\nname = \"pmma\"\nsolid = true\ntransmission = 1\n{keys}"));
        let Surface::Solid(volume) = scene.materials[1].surface else { panic!("{keys}: a solid was expected") };
        volume
    };
    let v =
        volume("scattering = \"0.5/mm\"\nabsorption = [1, \"2/cm\", 0.5]\nscattering_anisotropy = -0.4\npriority = -3");
    assert_eq!((v.scattering, v.absorption), (Rgb::splat(500.0), Rgb::new(1.0, 200.0, 0.5)));
    assert_eq!((v.scattering_anisotropy, v.priority), (-0.4, -3));
    let v = volume("attenuation_color = 0.5\nattenuation_distance = \"1cm\"\nscattering_albedo = [1, 0.25, 0]");
    let medium = Medium::new(&v);
    let extinction = 100.0 * std::f32::consts::LN_2;
    assert!((medium.scattering.g / (0.25 * extinction) - 1.0).abs() < 1e-6 && medium.absorption.r == 0.0, "{medium:?}");
    // One coefficient is replaced, the other stays what the colour made it.
    let v = volume(
        "attenuation_color = 0.5\nattenuation_distance = \"1cm\"\n[[material]]\nname = \"pmma\"\nscattering = 7",
    );
    assert!(Medium::new(&v).scattering == Rgb::splat(7.0));
    assert!((Medium::new(&v).absorption.r / extinction - 1.0).abs() < 1e-6);
}

/// The power of a Lambertian quad is pi * area * radiance; the right one is scaled by 2, so of four times the area.
#[test]
fn power_makes_the_radiance_of_each_object_by_its_own_area() {
    let scene = changed("[[light]]\nname = \"left\"\npower = \"6W\"");
    assert!((emission_of(&scene, 0).g - 6.0 / (2.0 * std::f32::consts::PI)).abs() < 1e-6);
    assert_eq!(emission_of(&scene, 1), Rgb::splat(2.0), "the other object keeps its light");
    let scene = changed("[[light]]\nname = \"?*ight\"\npower = \"6W\"");
    assert!((emission_of(&scene, 1).g - 6.0 / (8.0 * std::f32::consts::PI)).abs() < 1e-6);
    // As a material it is one light of both quads.
    let scene = changed("[[light]]\nname = \"panel\"\npower = \"6W\"");
    for i in [0, 1] {
        assert!((emission_of(&scene, i).g - 6.0 / (10.0 * std::f32::consts::PI)).abs() < 1e-6);
    }
}

#[test]
fn surfaces_are_switched_and_set() {
    let scene =
        changed("[[light]]\nname = \"right\"\nenabled = false\n[[light]]\nname = \"left\"\nradiance = [1, 2, 3]");
    assert_eq!(emission_of(&scene, 0), Rgb::new(1.0, 2.0, 3.0));
    let names = |scene: &SceneBuilder| scene.instances.iter().map(|i| i.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&scene), ["left", "cover"], "the body of a lamp goes with its light");
    assert_eq!(names(&changed("[[light]]\nname = \"panel\"\nenabled = false")), ["cover"], "by its material");
    assert_eq!(names(&changed("[[light]]\nname = \"cover\"\nenabled = false")).len(), 3, "it is no lamp");
    // An object that was dark becomes a light.
    let scene = changed("[[light]]\nname = \"cover\"\npower = 1");
    assert!((emission_of(&scene, 2).r - 0.5 / std::f32::consts::PI).abs() < 1e-6);
    assert_eq!(scene.materials.len(), 3, "nothing was shared, so nothing is copied");
}

#[test]
fn punctual_lights_take_what_fits_their_kind() {
    let scene = changed(
        "[[light]]\nname = \"bulb\"\npower = \"1W\"\n[[light]]\nname = \"spot\"\nintensity = 5\n[[light]]\nname = \"sun\"\nirradiance = [1, 0, 0]",
    );
    let PunctualKind::Point { intensity } = scene.lights[0].kind else { panic!("a point light") };
    assert!((4.0 * std::f32::consts::PI * intensity.mean() - 1.0).abs() < 1e-6);
    assert!((intensity.b / intensity.r - 3.0).abs() < 1e-6, "the colour stays");
    assert_eq!(scene.lights[1].kind, PunctualKind::Spot { intensity: Rgb::splat(5.0), inner: 0.5, outer: 0.5 });
    assert_eq!(scene.lights[2].kind, PunctualKind::Directional { irradiance: Rgb::new(1.0, 0.0, 0.0) });
    assert_eq!(changed("[[light]]\nname = \"s*\"\nenabled = false").lights.len(), 1);
}

#[test]
fn cameras_and_environments() {
    assert_eq!(job("scene = \"a.glb\"\ncamera = \"above\"").camera_index(&scene()).unwrap(), Some(0));
    assert_eq!(job(&with("")).camera_index(&scene()).unwrap(), None);
    let scene = changed("[environment]\nradiance = [0.1, 0.2, 0.3]");
    assert_eq!(scene.environment.unwrap().source, EnvironmentSource::Constant(Rgb::new(0.1, 0.2, 0.3)));
    let error = unfit("[environment]\nimage = \"gone.hdr\"");
    assert_eq!(error.place, "[environment] image");
    assert!(error.problem.contains("gone.hdr"), "{error}");
}

#[test]
fn an_ies_file_takes_the_place_of_a_point_or_a_spot() {
    let dir = tempfile::tempdir().expect("temporary folder");
    let path = dir.path().join("lamp.ies");
    // 683 cd in the lower half space: 1 W/sr, 2 pi W.
    let text = "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n1 1 1\n0 90\n0\n683 683\n";
    std::fs::write(&path, text).expect("write");
    let apply = |text: &str| {
        let mut scene = scene();
        let job = Job::from_text(dir.path().join("job.toml"), with(text)).expect("a job");
        job.apply_overrides(&mut scene).map(|_| scene)
    };
    let changed = apply("[[light]]\nname = \"bulb\"\nies = \"lamp.ies\"").expect("fits");
    assert_eq!(changed.profiles.len(), 1);
    let PunctualKind::Profile { profile: 0, scale } = changed.lights[0].kind else { panic!("{:?}", changed.lights[0]) };
    assert!((scale.mean() - 1.0).abs() < 1e-6 && (scale.b / scale.r - 3.0).abs() < 1e-6, "the hue stays: {scale:?}");
    let scaled = |text: &str| match apply(text).expect("fits").lights[1].kind {
        PunctualKind::Profile { scale, .. } => scale,
        other => panic!("{other:?}"),
    };
    let spot = "[[light]]\nname = \"spot\"\nies = \"lamp.ies\"\n";
    assert!((scaled(&format!("{spot}power = \"1W\"")).g * 2.0 * std::f32::consts::PI - 1.0).abs() < 1e-6);
    assert_eq!(scaled(&format!("{spot}intensity = [1, 2, 3]")), Rgb::new(1.0, 2.0, 3.0));
    // A later entry may change the strength of what an earlier one attached.
    assert_eq!(scaled(&format!("{spot}[[light]]\nname = \"spot\"\nintensity = 4")), Rgb::splat(4.0));
    for (text, word) in [
        ("[[light]]\nname = \"sun\"\nies = \"lamp.ies\"", "distant light"),
        ("[[light]]\nname = \"left\"\nies = \"lamp.ies\"", "without extent"),
        ("[[light]]\nname = \"bulb\"\nies = \"gone.ies\"", "gone.ies"),
        ("[[light]]\nname = \"bulb\"\nies = \"lamp.ies\"\nirradiance = 1", "light with an IES profile"),
    ] {
        let e = apply(text).expect_err(text);
        assert!(e.to_string().contains(word) && !e.caret().is_empty(), "{e}");
    }
    std::fs::write(&path, text.replace("683 683", "683 x")).expect("write");
    let e = apply("[[light]]\nname = \"bulb\"\nies = \"lamp.ies\"").expect_err("no number");
    assert!(e.place.ends_with("ies") && e.problem.contains("lamp.ies, line 7"), "{e}");
}

#[test]
fn energy_compensation_is_off_unless_requested() {
    assert!(!changed("").energy_compensation);
    assert!(!changed("[render]").energy_compensation);
    assert!(changed("[render]\nenergy_compensation = true").energy_compensation);
    assert_eq!(changed("[render]").principled, PrincipledModel::Layered);
    assert_eq!(changed("[render]\nprincipled = \"mitsuba\"").principled, PrincipledModel::Mitsuba);
}

#[test]
fn the_memory_of_textures_is_an_amount_with_its_unit() {
    let read = |value: &str| Job::from_text("job.toml", format!("scene = \"a.glb\"\nimport.texture_memory = {value}"));
    let limits = read("\"2GiB\"").expect("an amount").import_options().limits;
    assert_eq!((limits.total_image_bytes, limits.image_bytes), (2 << 30, 2 << 30));
    assert_eq!(read("\"500 kB\"").expect("an amount").import_options().limits.total_image_bytes, 500_000);
}

/// 6 dB are a factor of 10^(6/20).
#[test]
fn a_gain_is_a_factor_or_decibels() {
    let gain = |text: &str| job(&format!("scene = \"a.obj\"\n[sensor]\ngain = {text}\n")).sensor.gain;
    for (text, factor) in [("2", 2.0), ("0.5", 0.5), ("\"6dB\"", 1.995_262_315), ("\"-6 dB\"", 0.501_187_234)] {
        assert!(gain(text).is_some_and(|found| (found - factor).abs() < 1e-9), "{text}: {:?}", gain(text));
    }
}

#[test]
fn back_slashes_of_paths_have_help() {
    for (line, help) in [("scene = \"C:\\temp\\new.obj\"", "single quotes"), ("scene = 'parts\\a.obj'", "`/`")] {
        let error = job(line).load_scene().expect_err("no file");
        assert!(error.place == "scene" && error.help.contains(help), "{error}");
    }
}

#[test]
fn overrides_replace_what_belongs_together() {
    let text = "scene = 'none'\nbudget = { noise = 0.5, share = 90, time = '9s' }\n\
        camera = [{ name = 'a', look_at = [0, 0, 0], position = [0, 1, 0], lens = { f_number = 4 } }]\n";
    let job = Job::from_text("a.toml", text).expect("a job");
    let changed = job.with_overrides("budget.spp = 2\nlens.vignetting = 'cos4'\nfilm = { width = 8, height = 6 }\n");
    let changed = changed.expect("overrides");
    let budget = &changed.budget;
    assert_eq!((budget.spp, budget.noise, budget.share, budget.time), (Some(2.0), None, None, None));
    let lens = changed.camera.defined[0].lens.as_ref().expect("its own lens");
    assert_eq!((lens.vignetting, lens.f_number), (Some(Vignetting::CosineFourth), Some(4.0)));
    assert_eq!((changed.size, changed.film.width), ([Some(8), Some(6)], None));
    // Beside other keys of the film, its size is that of the film.
    let part = job.with_overrides("film = { width = 64, height = 48, roi = [20, 10, 32, 24] }\n").expect("overrides");
    assert_eq!((part.size, part.film.width), ([None, None], Some(64)));
    // An error shows the line of the text that has the key.
    let error = job.with_overrides("seed = -1\n").expect_err("no seed");
    assert!(error.file.display().to_string() == "the overrides" && error.caret().contains("1 | seed = -1"), "{error}");
    let error = Job::from_text("a.toml", format!("{text}[sensor]\nexposure = '-1s'\n")).expect_err("no time");
    assert!(error.caret().contains("5 | exposure"), "{}", error.caret());
}

/// A grey image gives heights, by `size` on a mesh without texture coordinates; a coloured one does not.
#[test]
fn heights_come_from_a_grey_image() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let apply = |keys: &str| {
        let text = with(&format!("[[material]]\nname = \"panel\"\n{keys}\n"));
        let mut scene = scene();
        Job::from_text(folder.path().join("a.toml"), text)?.apply_overrides(&mut scene).map(|_| scene)
    };
    let grey = image::GrayImage::from_pixel(4, 2, image::Luma([7]));
    grey.save(folder.path().join("grey.png")).expect("written");
    image::RgbImage::from_pixel(1, 1, image::Rgb([1, 2, 3])).save(folder.path().join("red.png")).expect("written");
    let scene = apply("height = { image = \"grey.png\", depth = \"40um\", size = \"25mm\" }").expect("a grey image");
    let Some(HeightField::Image(height)) = scene.materials[0].height else { panic!("no image") };
    assert_eq!((height.depth, height.size, height.texture.map(|t| t.image.0)), (40e-6, Some(25e-3), Some(0)));
    assert_eq!((scene.images.len(), scene.images[0].width), (1, 4));
    let problem = |keys: &str| apply(keys).expect_err(keys).problem;
    assert!(problem("height = { image = \"grey.png\", depth = \"40um\" }").contains("no texture coordinates"));
    assert!(problem("height = { image = \"red.png\", depth = \"40um\", size = 1 }").contains("is grey"));
}

/// The radius is that of the selected objects, also if others share the mesh.
#[test]
fn edges_of_an_object_are_rounded() {
    let scene = changed("[[object]]\nname = \"left\"\nedge_radius = \"0.3mm\"\n");
    let radius = |instance: usize| scene.meshes[scene.instances[instance].meshes[0]].edge_radius;
    assert_eq!([0, 1, 2].map(radius), [3e-4, 0.0, 0.0]);
}
