//! A project renders as often as asked, and changes by overrides: the result has the bits of a fresh load.
//! Replay: `cargo test --workspace --test it project::NAME`.

use dunkelfeld::film::Film;
use dunkelfeld::film::{expose_film, picture_of_film};
use dunkelfeld::outputs::{SavedPlan, save_film_files};
use dunkelfeld::{
    Cancel, ExposeOptions, GivenSensor, InputFiles, OutputPaths, Project, ProjectOptions, RenderOptions, ReplayOption,
    SavedFilm, SensorChoice, Silent,
};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// An OBJ file of a floor and three waved plates of `n` x `n` squares each, side by side.
fn write_scene(folder: &Path, n: usize) {
    let mut text = String::from("mtllib scene.mtl\n");
    let mut first = 1;
    let mut plate = |name: &str, material: &str, [x, y, z]: [f64; 3], size: f64, n: usize| {
        writeln!(text, "o {name}\nusemtl {material}").expect("text");
        for i in 0..=n {
            for j in 0..=n {
                let [u, v] = [i, j].map(|k| k as f64 / n as f64);
                let wave = 0.05 * size * ((9.0 * u).sin() * (7.0 * v).cos());
                writeln!(text, "v {} {} {}", x + size * (u - 0.5), y + wave, z + size * (v - 0.5)).expect("text");
            }
        }
        for i in 0..n {
            for j in 0..n {
                let a = first + i * (n + 1) + j;
                writeln!(text, "f {} {} {} {}", a, a + 1, a + n + 2, a + n + 1).expect("text");
            }
        }
        first += (n + 1) * (n + 1);
    };
    plate("floor", "grey", [0.0, -0.1, 0.0], 1.0, 1);
    plate("left", "grey", [-0.2, 0.0, 0.0], 0.15, n);
    plate("middle", "red", [0.0, 0.0, 0.0], 0.15, n);
    plate("right", "grey", [0.2, 0.0, 0.0], 0.15, n);
    fs::write(folder.join("scene.obj"), text).expect("writable");
    fs::write(folder.join("scene.mtl"), "newmtl grey\nKd 0.5 0.5 0.5\nnewmtl red\nKd 0.7 0.1 0.1\n").expect("writable");
}

const JOB: &str = "scene = \"scene.obj\"\nfilm = { width = 24, height = 20 }\nbudget = { spp = 4 }\n\
    camera = { look_at = [0, 0, 0], position = [0.1, 0.6, 0.4] }\nenvironment = { radiance = 1 }\n";

fn open(folder: &TempDir, name: &str, text: &str) -> Project {
    let path = folder.path().join(name);
    fs::write(&path, text).expect("writable");
    Project::open(path).unwrap_or_else(|e| panic!("{text}\n{e}"))
}

/// With small plates.
fn folder() -> TempDir {
    let folder = TempDir::new().expect("a temporary folder");
    write_scene(folder.path(), 4);
    folder
}

fn film(project: &Project) -> Film {
    project.render().expect("rendered").rendering.film.sums
}

/// Overrides that move, hide, copy, show and repaint objects, and change lights, camera, film and sensor.
const CHANGES: [&str; 9] = [
    "[[object]]\nname = \"middle\"\ntranslate = [0, \"30mm\", \"10mm\"]\n",
    "[[object]]\nname = \"middle\"\ntranslate = [0, \"60mm\", 0]\nrotate = [0, \"30deg\", \"20deg\"]\n",
    "[[object]]\nname = \"left\"\nvisible = false\n",
    "[[material]]\nname = \"red\"\nroughness = 0.2\nmetallic = 1\n",
    "[[light]]\nkind = \"panel\"\nwidth = \"100mm\"\nposition = [0, \"500mm\", 0]\naim = [0, -1, 0]\npower = \"2W\"\n",
    "camera = { position = [-0.3, 0.5, 0.4] }\n",
    "[environment]\nradiance = 0.3\n[sensor]\nexposure = \"2ms\"\nmodel = \"imx174\"\n",
    "[[object]]\nname = \"right\"\ntranslate = [\"900mm\", 0, 0]\n",
    "",
];

/// The job with the same keys in its text.
fn fresh(overrides: &str) -> String {
    match overrides {
        // A table cannot be written twice in a file.
        camera if camera.starts_with("camera") => {
            JOB.replace("position = [0.1, 0.6, 0.4]", "position = [-0.3, 0.5, 0.4]")
        }
        sky if sky.starts_with("[environment]") => JOB.replace("environment = { radiance = 1 }\n", sky),
        other => format!("{JOB}{other}"),
    }
}

/// Also of more triangles than share a tree.
#[test]
fn overrides_have_the_bits_of_a_fresh_load() {
    with_the_bits_of_a_fresh_load(12, &CHANGES);
    with_the_bits_of_a_fresh_load(212, &[CHANGES[0], CHANGES[2], CHANGES[7]]);
}

fn with_the_bits_of_a_fresh_load(n: usize, changes: &[&str]) {
    let folder = TempDir::new().expect("a temporary folder");
    write_scene(folder.path(), n);
    let mut project = open(&folder, "job.toml", JOB);
    let before = film(&project);
    for overrides in changes {
        project.set_overrides(overrides).unwrap_or_else(|e| panic!("{overrides}\n{e}"));
        let loaded = open(&folder, "fresh.toml", &fresh(overrides));
        assert_eq!(format!("{:?}", project.settings), format!("{:?}", loaded.settings), "{overrides}");
        assert_eq!(project.scene.fingerprint(), loaded.scene.fingerprint(), "{overrides}");
        let hazards = |p: &Project| p.findings().findings;
        assert_eq!(hazards(&project), hazards(&loaded), "{overrides}");
        let film = film(&project);
        assert!(film == self::film(&loaded), "{overrides}");
        assert!((film == before) == overrides.is_empty(), "the override changes nothing: {overrides}");
    }
}

#[test]
fn overrides_that_fail_leave_the_project_as_it_was() {
    let folder = folder();
    let mut project = open(&folder, "job.toml", JOB);
    project.set_overrides(CHANGES[0]).expect("a change");
    let before = (film(&project), format!("{:?}", project.settings));
    for (overrides, says) in [
        ("[[object]]\nname = \"lid\"\nvisible = false\n", "lid"),
        ("[[object]\n", "the overrides"),
        ("[film]\nwidth = \"wide\"\n", "width"),
        ("pixels = 3\n", "pixels"),
        ("scene = \"missing.obj\"\n", "missing.obj"),
        ("[[light]]\nkind = \"ring\"\npower = \"-1W\"\n", "power"),
    ] {
        let error = project.set_overrides(overrides).expect_err(says).to_string();
        assert!(error.contains(says) && error.contains("help:"), "{overrides}\n{error}");
        assert!((film(&project), format!("{:?}", project.settings)) == before, "{overrides}");
    }
    let options = ProjectOptions::default().with_can_change(false);
    let mut fixed = Project::open_with(folder.path().join("job.toml"), options).expect("a job");
    let error = fixed.set_overrides("").expect_err("the description was not kept").to_string();
    assert!(error.contains("can_change"), "{error}");
}

#[test]
fn a_scene_file_without_a_job_takes_overrides() {
    let folder = folder();
    let mut project = Project::open(folder.path().join("scene.obj")).expect("a scene");
    let overrides = "film = { width = 20, height = 15 }\nenvironment = { radiance = 1 }\nbudget.spp = 2\n";
    project.set_overrides(overrides).expect("overrides");
    let text = format!("scene = \"scene.obj\"\n{overrides}");
    let loaded = open(&folder, "fresh.toml", &text);
    assert!(film(&project) == film(&loaded));
    // Another scene file.
    fs::write(folder.path().join("other.obj"), "v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 3 2\n").expect("writable");
    project.set_overrides("scene = \"other.obj\"\n").expect("another scene");
    assert_eq!(project.scene.object_names().len(), 1);
}

/// The gain scales grey values of equal electrons, and the temperature sets the dark current, which doubles every few kelvin.
#[test]
fn gain_temperature_and_black_level_of_a_job_change_its_sensor() {
    let model = |keys: &str| {
        let text = format!("scene = 'none'\n[[object]]\nname = 'o'\nkind = 'sphere'\ndiameter = 1\n[sensor]\n{keys}");
        let project = Project::from_text("sensor.toml", &text).unwrap_or_else(|e| panic!("{e}"));
        match project.settings.sensor {
            SensorChoice::Emva { model, .. } => model.spec().clone(),
            SensorChoice::None => panic!("no sensor"),
        }
    };
    let (plain, changed) =
        (model("model = 'imx174'"), model("model = 'imx174'\ngain = 2.5\ntemperature = 45\nblack_level = 77.5"));
    assert_eq!(changed.system_gain, 2.5 * plain.system_gain);
    assert_eq!((changed.dark_noise, changed.full_well), (plain.dark_noise, plain.full_well));
    assert_eq!((changed.temperature.0, changed.offset.0), (45.0, 77.5));
    for (keys, words) in [
        ("gain = 0", "gain"),
        ("temperature = 300", "temperature"),
        ("black_level = -1", "black_level"),
        ("black_level = 65535", "offset"),
        ("model = 'none'\ngain = 2", "no sensor"),
        ("model = 'none'\nblack_level = 2", "no sensor"),
    ] {
        let text = format!("scene = 'none'\n[sensor]\n{keys}");
        let error = Project::from_text("sensor.toml", &text).expect_err("refused").to_string();
        assert!(error.contains(words) && error.contains("help:"), "{error}");
    }
}

#[test]
fn a_given_sensor_has_the_lens_and_the_exposure_of_the_job() {
    let folder = folder();
    let mut project = open(&folder, "job.toml", JOB);
    let sensor = GivenSensor { model: dunkelfeld::find_sensor("imx174").expect("a preset"), file: None };
    let keys = "lens.f_number = 8\nsensor.exposure = '3ms'";
    project.apply_options(RenderOptions::default().with_sensor(sensor).with_keys(keys)).expect("options");
    let SensorChoice::Emva { model, optics, exposure } = project.fitted().expect("a lens").sensor else {
        panic!("no sensor")
    };
    assert!(model.spec().name.contains("IMX174") && optics.f_number() == 8.0, "{optics:?}");
    assert_eq!(exposure.map(|time| time.time().0), Some(3e-3));
}

/// A render begins its clock itself: the time between `open` and `render` does not count.
#[test]
fn each_render_has_its_own_clock() {
    let folder = folder();
    let mut project = open(&folder, "job.toml", JOB);
    project.settings.budget.seconds = Some(30.0);
    for _ in 0..2 {
        std::thread::sleep(Duration::from_millis(60));
        let began = Instant::now();
        let result = project.render().expect("rendered");
        let elapsed = began.elapsed().as_secs_f64();
        assert!(result.stats.time.total_seconds <= elapsed, "{} of {elapsed}", result.stats.time.total_seconds);
        assert!(!result.stats.time.seconds.contains_key("load"), "{:?}", result.stats.time.seconds);
    }
}

fn render(project: &mut Project, options: RenderOptions) -> SavedFilm {
    let result = project.render_options(options, &Silent, &Cancel::new()).expect("rendered");
    result.into_saved_film()
}

/// The options of a render have the bits of the same settings, and the settings stay as they were, also after an error.
#[test]
fn options_belong_to_one_render() {
    let folder = folder();
    let mut project = open(&folder, "job.toml", JOB);
    let before = format!("{:?}", project.settings);
    let keys = "film.width = 20\nbudget.spp = 3\nseed = 9\nsensor.model = 'none'\n";
    let options = RenderOptions::default().with_keys(keys);
    let saved = render(&mut project, options.clone());
    assert_eq!(format!("{:?}", project.settings), before);
    let mut set = open(&folder, "job.toml", JOB);
    (set.settings.width, set.settings.budget.spp, set.settings.seed) = (20, Some(3.0), 9);
    set.settings.sensor = SensorChoice::None;
    assert!(saved.film.sums == film(&set) && !saved.settings.has_sensor());
    for (bad, says) in [
        (options.clone().with_camera("nobody"), "nobody"),
        (RenderOptions::default().with_keys(format!("{keys}sensor.exposure = 'auto'")), "exposure"),
        (RenderOptions::default().with_keys("sensor.model = 'no-such-sensor'"), "no-such-sensor"),
        (RenderOptions::default().with_keys("budget.spp = nan"), "spp"),
        (RenderOptions::default().with_keys("environment.radiance = 3"), "environment"),
    ] {
        let error = project.render_options(bad, &Silent, &Cancel::new()).expect_err(says).to_string();
        assert!(error.contains(says), "{error}");
        assert_eq!(format!("{:?}", project.settings), before);
    }
}

/// A replay of a film has its samples, and neither the plan nor the vignetting of one render is that of the next. Options that
/// are applied stay, and those that are refused change nothing.
#[test]
fn a_replay_belongs_to_one_render_and_applied_options_stay() {
    let folder = folder();
    let mut project = open(&folder, "job.toml", JOB);
    let whole = film(&project);
    let options = RenderOptions::default().with_keys("budget.spp = 7\nseed = 5\n");
    let vignetted = |keys: &str| RenderOptions::default().with_keys(format!("{keys}lens.vignetting = 'cos4'\n"));
    let saved = render(&mut project, vignetted(&options.keys));
    assert!(saved.is_vignetted && project.lens.vignetting.is_none());
    let own_lens = JOB.replace("0.4] }", "0.4], lens = { f_number = 8 } }");
    assert!(render(&mut open(&folder, "own.toml", &own_lens), vignetted("")).is_vignetted);
    let plan = folder.path().join("plan.exr");
    let files = OutputPaths::default().with_plan(plan.clone());
    save_film_files(&saved, None, &files, &InputFiles::new()).expect("saved");
    let known = project.inputs.iter().count();
    for replay in [ReplayOption::File(plan), ReplayOption::Plan(SavedPlan::of_film(&saved).expect("a whole film"))] {
        assert!(render(&mut project, vignetted("").with_replay(replay.clone())).film.sums == saved.film.sums);
        let limited = vignetted("budget.noise = 1\n").with_replay(replay);
        let error = project.apply_options(limited).expect_err("a limit").to_string();
        assert!(error.contains("replay") && error.contains("help"), "{error}");
        assert!(film(&project) == whole && project.inputs.iter().count() == known);
    }
    project.apply_options(options).expect("applied");
    let settings = &project.settings;
    assert_eq!((settings.budget.spp, settings.seed), (Some(7.0), 5));
    // A seed beside the plan replaces that of its file.
    let plan = SavedPlan::of_film(&saved).expect("a whole film");
    project
        .apply_options(RenderOptions::default().with_replay(ReplayOption::Plan(plan)).with_keys("seed = 6"))
        .expect("applied");
    assert_eq!((project.settings.seed, project.settings.budget.spp), (6, None));
    assert!(film(&project) != saved.film.sums);
}

/// With `full` in the job the film has the resolution of the sensor of the options, for this render only.
#[test]
fn a_sensor_of_the_options_resizes_a_full_film() {
    let folder = folder();
    let sheet = "name = \"small\"\nsource = \"made up\"\nbit_depth = 12\npixel_pitch_um = 3.45\nfull_well_e = 10000\n\
        dark_noise_e = 2\ngain_e_per_dn = 2.5\noffset_dn = 30\nquantum_efficiency = [[400, 0.4], [550, 0.7], [850, 0.2]]\n";
    for (name, size) in [("a", "[24, 16]"), ("b", "[10, 12]")] {
        fs::write(folder.path().join(format!("{name}.toml")), format!("{sheet}resolution = {size}\n"))
            .expect("writable");
    }
    let job =
        JOB.replace("film = { width = 24, height = 20 }", "film = { full = true }\nsensor = { model = \"a.toml\" }");
    let mut project = open(&folder, "job.toml", &job);
    let saved = render(&mut project, RenderOptions::default().with_keys("sensor.model = 'b.toml'"));
    assert_eq!((saved.film.sums.width(), saved.film.sums.height()), (10, 12));
    let again = render(&mut project, RenderOptions::default());
    assert_eq!((again.film.sums.width(), again.film.sums.height()), (24, 16));
}

#[test]
fn a_film_is_exposed_with_options() {
    let folder = folder();
    let mut project = open(&folder, "job.toml", JOB);
    let saved = render(&mut project, RenderOptions::default());
    let frames = expose_film(&saved, &ExposeOptions::default(), 2, &Cancel::new()).expect("frames");
    let later =
        expose_film(&saved, &ExposeOptions::default().with_keys("frame = 1"), 1, &Cancel::new()).expect("a frame");
    assert!(frames[0] != frames[1] && frames[1] == later[0]);
    // So many frames would not fit: an error before any of them is allocated.
    let error = expose_film(&saved, &ExposeOptions::default(), u32::MAX, &Cancel::new());
    let error = error.expect_err("too many").to_string();
    assert!(error.contains("memory") && error.contains("fewer frames"), "{error}");
    let cancelled = Cancel::new();
    cancelled.cancel();
    assert_eq!(expose_film(&saved, &ExposeOptions::default(), 2, &cancelled).expect("no frame").len(), 0);
    let plain =
        picture_of_film(&saved, &ExposeOptions::default().with_keys("sensor.model = 'none'")).expect("a picture");
    assert!(matches!(plain, dunkelfeld::Picture::Rgb(_)));
}

/// The EXR and the film of a render behind a beam splitter, exposed with the lens of the job alone, have the grey values of the
/// render.
#[test]
fn files_of_a_coaxial_station_have_its_beam_splitter() {
    let folder = folder();
    let coaxial = "sensor = { exposure = \"2ms\" }\n[[light]]\nkind = \"coaxial\"\nwidth = \"80mm\"\ndistance = \"120mm\"\n\
                   radiance = 5000\nsplitter = 0.3\n";
    let mut project = open(&folder, "job.toml", &JOB.replace("environment = { radiance = 1 }\n", coaxial));
    let mut result = project.render().expect("rendered");
    let exr = folder.path().join("a.exr");
    result.save(&OutputPaths::default().with_exr(exr.clone())).expect("saved");
    let values = result.frame.sensor.as_ref().expect("a sensor").values.clone();
    let model = dunkelfeld::find_sensor("imx250").expect("a preset");
    let SensorChoice::Emva { exposure, .. } = &result.settings().sensor else { panic!("a sensor") };
    let settings = dunkelfeld::ExposeSettings::new(model).expect("defaults").with_exposure(*exposure);
    let exposed = dunkelfeld::commands::expose_image(&exr, &settings, &Cancel::new()).expect("exposed");
    assert!(exposed[0] == values, "{:?} instead of {:?}", &exposed[0].data()[..8], &values.data()[..8]);
    let black = values.data().iter().filter(|v| **v < 60).count();
    assert!(black < values.data().len() / 2, "the lamp lights the image");
    let saved = render(&mut project, RenderOptions::default());
    let frames = expose_film(&saved, &ExposeOptions::default(), 1, &Cancel::new()).expect("a frame");
    assert!(frames[0] == values);
}

/// What a job resolves to: settings of the render with the lens combined with its camera, outputs, and the data of the scene.
fn resolved(name: &str, project: &Project) -> String {
    let settings = project.fitted().unwrap_or_else(|e| panic!("{name}: {e}"));
    let (scene, readout, is_timed) = (project.scene.fingerprint(), settings.readout, settings.is_timed);
    let (outputs, settings) = (&project.outputs, serde_json::to_string(&settings).expect("JSON"));
    format!("{name}: scene {scene:032x}, {readout:?}, timed {is_timed}, {outputs:?}\n    {settings}\n")
}

/// Shipped jobs, stations and references give the same scenes and settings as before.
#[test]
fn jobs_resolve_to_the_same_scenes_and_settings() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut text = String::new();
    for station in dunkelfeld::commands::STATIONS {
        let project = Project::from_text("station.toml", &station.job()).unwrap_or_else(|e| panic!("{e}"));
        text += &resolved(station.name, &project);
    }
    for folder in ["scenes/inspection", "tests/references"] {
        let mut jobs: Vec<_> =
            fs::read_dir(root.join(folder)).expect("a folder").map(|e| e.expect("a file").path()).collect();
        jobs.retain(|path| path.extension().is_some_and(|e| e == "toml"));
        jobs.sort();
        for path in jobs {
            let project = Project::open(&path).unwrap_or_else(|e| panic!("{e}"));
            text += &resolved(&path.file_stem().expect("a name").to_string_lossy(), &project);
        }
    }
    insta::with_settings!({ snapshot_path => root.join("tests/snapshots"), prepend_module_to_snapshot => false }, {
        insta::assert_snapshot!("resolved-jobs", text);
    });
}
