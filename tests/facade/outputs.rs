//! The results of the facade: layers with the values of the film, plans that can be replayed, and progress.
//!
//! Replay: `cargo test -p dunkelfeld --test it outputs::NAME`.

use crate::support::{build, emitter, settings, spot_camera, square};
use dunkelfeld::film::{NO_ID, Plane};
use dunkelfeld::geometry::DVec3;
use dunkelfeld::limits::DEFAULT_SENSOR;
use dunkelfeld::outputs::{encode_layers, load_plan};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::{Material, Scene, SceneBuilder};
use dunkelfeld::{
    Budget, Cancel, OutputPaths, Picture, Progress, ProgressState, Project, RenderSettings, SensorChoice, Session,
    develop, render,
};
use dunkelfeld_adaptive::weights::Strategy;
use dunkelfeld_io::exr::Channel;
use dunkelfeld_io::layers::{Single, Triple};
use std::fs;
use std::path::PathBuf;
use std::sync::Mutex;
use tempfile::TempDir;

/// Half of the view shows a lit floor, 2 m below the camera; the other half shows nothing.
fn floor_and_void() -> Scene {
    let mut b = SceneBuilder::default();
    let floor = b.add_material(Material { base_color: Rgb::new(0.8, 0.4, 0.2).into(), ..Material::default() });
    b.add_object("floor", square(0.0, 1.0, false), floor);
    let lamp = b.add_material(emitter(5.0));
    b.add_object("lamp", square(3.0, 1.0, true), lamp);
    spot_camera(&mut b, DVec3::new(0.5, 0.0, 2.0), DVec3::new(0.5, 0.0, 0.0), 0.25);
    build(b)
}

fn with_sensor(settings: RenderSettings) -> RenderSettings {
    let model = Box::new(dunkelfeld::find_sensor(DEFAULT_SENSOR).expect("a preset"));
    let optics = dunkelfeld::sensor::Optics::new(4.0, 0.9, 0.0).expect("in range");
    settings.with_sensor(SensorChoice::Emva { model, optics, exposure: None })
}

fn scene_file(folder: &TempDir) -> PathBuf {
    let path = folder.path().join("scene.obj");
    fs::write(folder.path().join("scene.mtl"), "newmtl lamp\nKd 0 0 0\nKe 1 1 1\nnewmtl floor\nKd .5 .5 .5\n")
        .expect("writable");
    let floor = "v -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\no floor\nusemtl floor\nf 1 2 3 4\n";
    let lamp = "v -.3 1 -.3\nv .3 1 -.3\nv .3 1 .3\nv -.3 1 .3\no lamp\nusemtl lamp\nf 5 6 7 8\n";
    fs::write(&path, format!("mtllib scene.mtl\n{floor}{lamp}")).expect("writable");
    path
}

#[test]
fn layers_hold_what_the_film_and_the_sensor_hold() {
    let scene = floor_and_void();
    let s = with_sensor(settings(16, 12, 8.0, 3));
    let rendering = render(&scene, &s, &Session::new(s.run.threads).expect("threads")).expect("valid");
    let frame = develop(&rendering.film.sums.mean(), &s).expect("exposed");
    let layers = encode_layers(&rendering.film, &frame, &s);

    assert_eq!(layers.triples(Triple::Mean), Some(rendering.film.sums.mean()));
    assert_eq!(layers.triples(Triple::Variance), Some(rendering.film.sums.variance()));
    assert_eq!(layers.triples(Triple::Covariance), Some(rendering.film.sums.covariance()));
    assert_eq!(layers.integers(Single::SampleCount), Some(Plane::new(16, 12, 8)));
    let sensor = frame.sensor.expect("there is one");
    assert_eq!(layers.single(Single::Electrons), Some(sensor.electrons.clone()));

    // The pixels show a floor 2 m away that faces the camera, or nothing.
    let ids = layers.integers(Single::ObjectId).expect("ids");
    let names = scene.object_names();
    let plane = |layer| layers.triples(layer).expect("a layer");
    let (normal, albedo, depth) =
        (plane(Triple::Normal), plane(Triple::Albedo), layers.single(Single::Depth).expect("depth"));
    let (mut floor, mut void) = (0, 0);
    for (i, id) in ids.data().iter().enumerate() {
        if *id == NO_ID {
            void += 1;
            continue;
        }
        floor += 1;
        assert_eq!(names[*id as usize], "floor");
        // Pixels at the border of the floor average it with nothing, so whole ones are recognised by their albedo.
        if albedo.data()[i][0] == 0.8 {
            assert_eq!((albedo.data()[i], normal.data()[i]), ([0.8, 0.4, 0.2], [0.0, 0.0, 1.0]));
            assert!((depth.data()[i] - 2.0).abs() < 1e-5, "{}", depth.data()[i]);
        }
    }
    assert!(floor >= 80 && void >= 80, "{floor} pixels show the floor, {void} nothing");
    let Some(Channel::U32(materials)) = layers.channel("id.material") else { panic!("ids are whole numbers") };
    assert_eq!(materials.iter().filter(|m| **m == NO_ID).count(), void);

    // The picture keeps the order of the grey values.
    let Picture::Gray(picture) = frame.picture else { panic!("a monochrome sensor") };
    let values = sensor.values.data();
    let mut pairs: Vec<_> = values.iter().zip(picture.data()).collect();
    pairs.sort_unstable();
    assert!(pairs.windows(2).all(|w| w[0].1 <= w[1].1) && pairs[0].1 < pairs[191].1);
    assert_eq!(sensor.saturated, values.iter().filter(|v| **v == sensor.model.max_value()).count() as f64 / 192.0);
}

#[test]
fn a_project_is_opened_adjusted_rendered_and_saved() {
    let folder = TempDir::new().expect("a temporary folder");
    let mut project = Project::open(scene_file(&folder)).expect("a scene");
    assert_eq!((project.settings.strategy(), project.settings.width), (Strategy::Sensor, 512));
    let SensorChoice::Emva { exposure: None, .. } = &project.settings.sensor else {
        panic!("a sensor, exposed by itself")
    };
    (project.settings.width, project.settings.height) = (12, 10);
    project.settings.budget = Budget::default().with_spp(4.0);
    let at = |name: &str| Some(folder.path().join(name));
    project.outputs = OutputPaths::default().with_image(at("a.png")).with_exr(at("a.exr")).with_stats(at("a.json"));
    let mut result = project.render().expect("rendered");
    result.save(&project.outputs).expect("saved");
    result.save_image(folder.path().join("b.png")).expect("saved");
    let read = |name: &str| fs::read(folder.path().join(name)).expect("written");
    assert!(read("a.png") == read("b.png"));
    // The file contains the statistics of the result, to the last digit.
    assert_eq!(String::from_utf8(read("a.json")).expect("text"), result.stats.to_json());
    let stats = &result.stats;
    assert_eq!((stats.samples, stats.size, stats.stop.as_str()), (480, [12, 10], "samples"));
    let mean = result.rendering.film.sums.mean();
    let average = mean.data().iter().map(|p| f64::from(p[1])).sum::<f64>() / 120.0;
    assert!(average > 0.0 && (stats.mean_radiance[1] / average - 1.0).abs() < 1e-5, "{average}");
    // A replay by the library is the same film.
    project.settings.run.replay = Some(load_plan(&folder.path().join("a.exr")).expect("a plan").samples);
    assert!(project.render().expect("rendered").rendering.film == result.rendering.film);
}

/// Stores all reports, and cancels after so many samples.
struct Watch<'a> {
    seen: Mutex<Vec<ProgressState>>,
    cancel: &'a Cancel,
    most: u64,
}

impl Progress for Watch<'_> {
    fn update(&self, state: &ProgressState) {
        self.seen.lock().expect("no panic").push(*state);
        if state.samples >= self.most {
            self.cancel.cancel();
        }
    }
}

#[test]
fn a_render_that_is_cancelled_from_its_progress_keeps_samples_that_can_be_replayed() {
    let scene = floor_and_void();
    let cancel = Cancel::new();
    // The first rounds are small: by then some are complete.
    let watch = Watch { seen: Mutex::default(), cancel: &cancel, most: 100 * 32 * 32 };
    // An hour's budget: only the switch can end it.
    let s = settings(32, 32, 1.0, 8).with_budget(Budget::default().with_seconds(3600.0));
    let cut =
        render(&scene, &s, &Session::new(s.run.threads).expect("threads").with_progress(&watch).with_cancel(&cancel))
            .expect("valid");
    assert!(cut.interrupted && cut.film.sums.total_samples() > 0);
    let replay =
        s.running(|run| run.with_replay(cut.plan())).with_budget(Budget::default()).running(|run| run.with_threads(3));
    let again = render(&scene, &replay, &Session::new(replay.run.threads).expect("threads")).expect("valid");
    assert!(again.film == cut.film && !again.interrupted);
    let seen = watch.seen.into_inner().expect("no panic");
    assert!(seen.iter().all(|s| (0.0..=1.0).contains(&s.fraction) && s.remaining.is_none_or(|r| r >= 0.0)), "{seen:?}");
    assert!(seen.windows(2).all(|w| w[0].stage <= w[1].stage), "stages come in order");
}
