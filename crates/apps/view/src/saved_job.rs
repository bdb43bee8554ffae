//! The job of a picture: its camera and its lens, and the check that `render` does not refuse it.

use crate::protocol::Fault;
use crate::snapshot::Snapshot;
use dunkelfeld::io::visible_line;
use dunkelfeld::radiometry::Number;
use dunkelfeld::scene::{Effect, Vignetting};
use dunkelfeld::sensor::Optics;
use dunkelfeld::{Error, Project, ProjectOptions, RenderSettings, SensorChoice};
use std::path::Path;
use toml::{Table, Value};

/// Makes the job render the camera `shown` alone. `all` are the cameras of the scene. They keep their order, so that the
/// scene of the job is that of the picture. Lamps without the name of a camera belong to the one that the job selects, or
/// to the first one. They keep it.
pub(crate) fn select_camera(job: &mut Table, shown: &str, all: &[String]) {
    let defined = match job.get("camera") {
        Some(Value::Table(camera)) => vec![Value::Table(camera.clone())],
        Some(Value::Array(cameras)) => cameras.clone(),
        _ => {
            let first = all.first().map_or("", String::as_str);
            let before = job.get("camera").and_then(Value::as_str).unwrap_or(first).to_owned();
            if shown != before {
                name_camera_of_lamps(job, &before);
                job.insert("camera".into(), shown.into());
            }
            return;
        }
    };
    if let [Value::Table(only)] = &defined[..]
        && name_of(only, 0) == shown
    {
        return;
    }
    let mut names: Vec<String> = Vec::new();
    let mut cameras: Vec<Value> = Vec::new();
    for (i, camera) in defined.into_iter().enumerate() {
        let Value::Table(mut camera) = camera else { continue };
        let name = name_of(&camera, i);
        if name == shown {
            camera.remove("enabled");
        } else {
            camera.insert("enabled".into(), false.into());
        }
        camera.insert("name".into(), name.clone().into());
        names.push(name);
        cameras.push(camera.into());
    }
    if !names.iter().any(|name| name == shown) {
        // A camera of a file, as it is. Cameras of the job come first, so that those before it are named too.
        for name in all.iter().take_while(|name| *name != shown) {
            // A file may have two cameras of one name, and a job may not.
            if !names.contains(name) {
                let entry = [("name".to_owned(), Value::from(name.as_str())), ("enabled".to_owned(), false.into())];
                cameras.push(Table::from_iter(entry).into());
                names.push(name.clone());
            }
        }
        cameras.push(Table::from_iter([("name".to_owned(), Value::from(shown))]).into());
    }
    job.insert("camera".into(), cameras.into());
}

/// Names the camera of the lamps that have none.
fn name_camera_of_lamps(job: &mut Table, camera: &str) {
    let entries = job.get_mut("light").and_then(Value::as_array_mut).into_iter().flatten();
    for lamp in entries.filter_map(Value::as_table_mut) {
        let has_place = lamp.get("kind").is_some_and(|kind| kind.as_str() != Some("environment"));
        if has_place && !lamp.contains_key("camera") {
            lamp.insert("camera".into(), camera.into());
        }
    }
}

/// The name of a camera of the job at an index.
fn name_of(camera: &Table, index: usize) -> String {
    let given = camera.get("name").and_then(Value::as_str).filter(|name| !name.is_empty());
    let default = || if index == 0 { "camera".to_owned() } else { format!("camera-{}", index + 1) };
    given.map_or_else(default, str::to_owned)
}

/// Changes the lens of the camera `shown`: its own, or that of the job.
pub(crate) fn change_lens(job: &mut Table, shown: &str, change: impl FnOnce(&mut Table)) {
    let defined = match job.get_mut("camera") {
        Some(Value::Table(camera)) => vec![camera],
        Some(Value::Array(cameras)) => cameras.iter_mut().filter_map(Value::as_table_mut).collect(),
        _ => Vec::new(),
    };
    let camera = defined.into_iter().enumerate().find(|(i, camera)| name_of(camera, *i) == shown);
    let own = camera.and_then(|(_, camera)| camera.get_mut("lens")).and_then(Value::as_table_mut);
    if let Some(lens) = own {
        change(lens);
    } else if let Value::Table(lens) = job.entry("lens").or_insert_with(|| Table::new().into()) {
        change(lens);
    }
}

/// Sets the aperture and the glare of a lens.
pub(crate) fn describe_lens(lens: &mut Table, f_number: Option<f64>, glare: Option<f64>) {
    if let Some(f_number) = f_number {
        lens.remove("numerical_aperture");
        lens.insert("f_number".into(), f_number.into());
    }
    glare.map(|glare| lens.insert("glare".into(), glare.into()));
}

/// Opens the job as `render` does, and states a difference between its image and the picture. `settings` are those of the
/// picture behind the camera that is shown.
///
/// # Errors
/// The reason why `render` would refuse the job.
pub(crate) fn check(
    file: &Path,
    text: &str,
    without: &[Effect],
    (snapshot, settings): (&Snapshot, &RenderSettings),
) -> Result<Option<String>, Fault> {
    let options = ProjectOptions::default().with_without(without.to_vec()).with_can_change(false);
    // The file does not exist, so that neither its name nor its lines are a place.
    let refused = |error: Error| {
        let mut fault = Fault::from(error);
        fault.place = fault.place.map(|place| {
            let place = place.replacen(&*visible_line(&file.to_string_lossy()), "the job to be saved", 1);
            place.split_once(", line ").map_or(place.clone(), |(key, _)| key.to_owned())
        });
        fault
    };
    let project = Project::from_text_with(file, text, options).map_err(refused)?;
    let of_job = project.fitted().map_err(refused)?;
    let [width, height] = snapshot.size();
    if [of_job.width, of_job.height] != [width, height] {
        return Ok(Some(format!(
            "The job renders {} x {} pixels, because its film depends on the sensor; the picture has {width} x {height}.",
            of_job.width, of_job.height
        )));
    }
    let view_of = |settings: &RenderSettings| {
        settings.run.view.clone().map(|mut view| {
            view.lens.vignetting = Vignetting::default();
            view
        })
    };
    if view_of(&of_job) != view_of(settings) {
        let text = "The job renders another field of view than the picture: its lens is given by lengths, and this sensor \
                    has pixels of another size.";
        return Ok(Some(text.into()));
    }
    let optics_of = |settings: &RenderSettings| match &settings.sensor {
        SensorChoice::Emva { optics, .. } => Some(optics.clone()),
        SensorChoice::None => None,
    };
    let of_lens = |optics: Optics| {
        let (f_number, transmission) = (Number(optics.f_number()), Number(optics.transmission()));
        let glare = Number(optics.glare());
        format!(
            "f/{f_number}, transmission {transmission}, magnification {}, glare {glare}",
            Number(optics.magnification())
        )
    };
    Ok(match (optics_of(&of_job), optics_of(settings)) {
        (Some(job), Some(picture)) if job != picture => Some(format!(
            "The lens of the job has {} for this sensor; that of the picture has {}.",
            of_lens(job),
            of_lens(picture)
        )),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: &str = "[[camera]]\nname = \"above\"\n[[camera]]\nvertical_fov = \"30deg\"\nlens = { f_number = 2 }\n\
        [[light]]\nname = \"lamp\"\n[[light]]\nkind = \"ring\"\n[[light]]\nkind = \"environment\"\n\
        [[light]]\nkind = \"bar\"\ncamera = \"camera-2\"\n";

    fn selected(text: &str, shown: &str, all: &[&str]) -> Table {
        let mut job: Table = text.parse().expect("TOML");
        select_camera(&mut job, shown, &all.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        job
    }

    #[test]
    fn the_shown_camera_is_rendered_and_lamps_keep_theirs() {
        let job = selected(TWO, "camera-2", &["above", "camera-2"]);
        let [above, second] = [0, 1].map(|i| job["camera"][i].clone());
        assert_eq!((above["name"].as_str(), above["enabled"].as_bool()), (Some("above"), Some(false)));
        assert_eq!((second["name"].as_str(), second.get("enabled")), (Some("camera-2"), None));
        assert_eq!(job["light"], TWO.parse::<Table>().expect("TOML")["light"], "the first camera is still the first");
        assert_eq!(selected(TWO, "above", &["above", "camera-2"])["camera"][1]["enabled"].as_bool(), Some(false));
        // The choice of a camera of the scene would move lamps.
        let lamps = &TWO[TWO.find("[[light]]").expect("lamps")..];
        let job = selected(lamps, "right", &["left", "right"]);
        let cameras = [0, 1, 2, 3].map(|i| job["light"][i].get("camera").and_then(Value::as_str).map(str::to_owned));
        assert_eq!(cameras, [None, Some("left".into()), None, Some("camera-2".into())]);
        // A camera of the scene beside one of the job.
        let job = selected("[camera]\nlook_at = [0, 0, 0]\n", "scene", &["camera", "scene"]);
        assert_eq!(job["camera"][0]["enabled"].as_bool(), Some(false));
        assert_eq!(job["camera"][1]["name"].as_str(), Some("scene"));
        // Cameras of a file keep their order behind those of the job.
        let all = ["camera", "left", "left", "right", "top"];
        let job = selected("[camera]\nlook_at = [0, 0, 0]\n", "right", &all);
        let cameras = [0, 1, 2].map(|i| (job["camera"][i]["name"].as_str(), job["camera"][i].get("enabled").is_none()));
        assert_eq!(cameras, [(Some("camera"), false), (Some("left"), false), (Some("right"), true)]);
        assert_eq!(job["camera"].as_array().map(Vec::len), Some(3));
        // A single camera, and cameras of the scene alone.
        let text = "[camera]\nlook_at = [0, 0, 0]\n";
        assert_eq!(selected(text, "camera", &["camera"]), text.parse::<Table>().expect("TOML"));
        assert_eq!(selected("seed = 1", "left", &["left"]), "seed = 1".parse::<Table>().expect("TOML"));
        assert_eq!(selected("seed = 1", "right", &["left", "right"])["camera"].as_str(), Some("right"));
        assert_eq!(selected("camera = \"right\"", "left", &["left", "right"])["camera"].as_str(), Some("left"));
    }

    #[test]
    fn a_lens_is_that_of_the_camera() {
        let mut job: Table = TWO.parse().expect("TOML");
        change_lens(&mut job, "camera-2", |lens| describe_lens(lens, Some(8.0), None));
        assert_eq!(job["camera"][1]["lens"]["f_number"].as_float(), Some(8.0));
        assert!(!job.contains_key("lens"));
        change_lens(&mut job, "above", |lens| describe_lens(lens, None, Some(0.02)));
        assert_eq!(job["lens"], Value::Table(Table::from_iter([("glare".to_owned(), 0.02.into())])));
        // Both keys set the aperture.
        let mut lens = Table::from_iter([("numerical_aperture".to_owned(), Value::from(0.01))]);
        describe_lens(&mut lens, Some(11.0), None);
        assert_eq!(lens, Table::from_iter([("f_number".to_owned(), Value::from(11.0))]));
    }
}
