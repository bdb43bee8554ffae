//! `dunkelfeld init`: a job for a scene, with all names filled in.

use crate::outputs::save_text;
use crate::stations::Station;
use dunkelfeld_io::InputError;
use dunkelfeld_io::import::{ImportOptions, load_scene};
use dunkelfeld_render::Error;
use dunkelfeld_scene::{Instance, LARGEST_OBJECT, Material, Projection, PunctualKind, SceneBuilder};
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Names of one kind that are listed. A job with more entries is not read by a person.
const MOST_NAMES: usize = 200;

/// Writes a job file and returns its path.
///
/// For a scene file, active lines render the scene; the names of all objects, materials, lights and cameras stand in
/// lines that a `#` switches off. With a station, its camera, lens, film and lights are added to the scene. A station
/// without a scene has a stand-in part.
///
/// The default of `output` is the name of the scene or the station with `.toml`, in the current folder.
///
/// # Errors
/// If neither a scene nor a station is given, if the scene cannot be read, if the output exists or does not end in
/// `.toml`, or if it cannot be written.
pub fn init(scene: Option<&Path>, station: Option<Station>, output: Option<&Path>) -> Result<PathBuf, Error> {
    let stem = scene.and_then(Path::file_stem).or(station.map(|s| s.name.as_ref())).unwrap_or_else(|| "job".as_ref());
    let usual = || PathBuf::from(stem).with_extension("toml");
    let path = output.map_or_else(usual, Path::to_path_buf);
    let refuse = |problem: &str, help: &str| Err(Error::from(InputError::new(&path, "the job", problem, help)));
    if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")) {
        return refuse("does not end in .toml", "write a name such as job.toml");
    }
    // A link without a target counts as well.
    if path.symlink_metadata().is_ok() {
        return refuse("exists, and init replaces no file", "name another file by -o, or remove this one");
    }
    let text = match (scene, station) {
        (Some(scene), _) => init_text(scene, station, &path)?,
        (None, Some(station)) => station.job(),
        (None, None) => return refuse("has no scene", "name a scene file, or a station by --station"),
    };
    save_text(&path, &text)?;
    Ok(path)
}

/// The text of the job that [`init`] writes for a scene file to the path `job`. Nothing is written. The path of the scene in
/// it is as the folder of `job` needs it.
///
/// # Errors
/// The scene cannot be read.
pub fn init_text(scene: &Path, station: Option<Station>, job: &Path) -> Result<String, Error> {
    let imported = load_scene(scene, &ImportOptions::default())?;
    Ok(job_text(&imported.scene, &path_from(job, scene), station))
}

/// The scene's path as the job needs it: relative to the folder of the job where both are in it or the job is in the
/// current folder, else absolute.
fn path_from(job: &Path, scene: &Path) -> PathBuf {
    let folder = |path: &Path| match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
        _ => PathBuf::from("."),
    };
    let whole = |path: &Path| path.canonicalize().ok();
    match (whole(&folder(job)), whole(&folder(scene)), scene.file_name()) {
        (Some(job), Some(scene), Some(name)) if job == scene => PathBuf::from(name),
        (Some(job), _, _) if scene.is_relative() && Some(&job) == whole(Path::new(".")).as_ref() => scene.to_path_buf(),
        (_, Some(folder), Some(name)) => folder.join(name),
        _ => scene.to_path_buf(),
    }
}

fn job_text(scene: &SceneBuilder, path: &Path, station: Option<Station>) -> String {
    let mut t = String::from(
        "# A job of Dunkelfeld. `dunkelfeld render` with this file makes the image.\n\
         # Lines that begin with # are off: remove the # to use them. docs/job-file.md describes all keys.\n\n",
    );
    let _ = writeln!(t, "scene = {}", quoted(&path.to_string_lossy()));
    if station.is_none() {
        t += &cameras(scene);
    }
    let all = scene.instances.iter().filter_map(|i| scene.bounds_of(i));
    let extent = all.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]).map(|[low, high]| high - low);
    if let Some(size) = extent {
        let note = if size.max_element() > f64::from(LARGEST_OBJECT) {
            ", which is large: was it modelled in millimetres?"
        } else {
            ""
        };
        let [x, y, z] = size.to_array().map(length);
        let _ = writeln!(t, "\n# The scene is {x} x {y} x {z} m{note}\n# [import]\n# unit = \"mm\"");
    }
    match station {
        None => t += &view(scene),
        Some(station) => {
            let (keys, changes) = station.keys_for_scene();
            let changes = for_dark_objects(&changes, scene);
            // Keys of the whole file stand before the first section.
            let whole = t.find("\n# The scene is").unwrap_or(t.len());
            let size = t.split_off(whole);
            t += &format!("budget = {{ time = \"20s\" }}\n\n{keys}{changes}");
            t += &size;
        }
    }
    lights(&mut t, scene);
    materials(&mut t, scene);
    objects(&mut t, scene);
    t
}

/// Changes of all objects, repeated for each object that does not emit, if some do: an object that emits must be at rest.
fn for_dark_objects(changes: &str, scene: &SceneBuilder) -> String {
    if changes.is_empty() || !scene.instances.iter().any(|o| emission_of(scene, o).is_some()) {
        return changes.into();
    }
    let dark = scene.instances.iter().filter(|o| emission_of(scene, o).is_none());
    let names: BTreeSet<&str> = dark.map(|o| o.name.as_str()).collect();
    names.into_iter().map(|name| changes.replace("\"*\"", &quoted(name))).collect()
}

/// Emission of the first emitting material of an object.
fn emission_of(scene: &SceneBuilder, object: &Instance) -> Option<[f32; 3]> {
    let part = |mesh: &usize| scene.meshes.get(*mesh).and_then(|part| scene.materials.get(part.material));
    let mut materials = object.meshes.iter().filter_map(part);
    materials.find(|m| !m.emission.factor.is_black()).map(|m| m.emission.factor.to_array())
}

/// The camera of the scene, and the others in lines that are off.
fn cameras(scene: &SceneBuilder) -> String {
    let mut t = String::new();
    match scene.cameras.split_first() {
        Some((first, others)) => {
            let _ = writeln!(t, "camera = {}", quoted(&first.name));
            for camera in others.iter().take(MOST_NAMES) {
                let _ = writeln!(t, "# camera = {}", quoted(&camera.name));
            }
        }
        None => t += "# The scene has no camera: the whole scene is in the image.\n",
    }
    t
}

/// Film, budget, sensor, and light from all directions for a scene without light.
fn view(scene: &SceneBuilder) -> String {
    let mut t = String::new();
    let aspect = scene.cameras.first().and_then(|camera| match (camera.projection, camera.aspect) {
        (Projection::Orthographic { half_width, half_height }, _) => Some(half_width / half_height),
        (_, aspect) => aspect,
    });
    let aspect = aspect.filter(|a| a.is_finite()).map_or(1.0, |a| f64::from(a).clamp(0.25, 4.0));
    let height = if aspect < 1.0 { 640.0 } else { 640.0 / aspect };
    let _ = writeln!(t, "\n[film]\nwidth = {:.0}\nheight = {height:.0}", height * aspect);
    t += "\n# The render ends at the first limit. A noise of 1: until the noise of the sensor hides that of the render.\n\
          [budget]\ntime = \"20s\"\n# noise = 1\n\n# `dunkelfeld sensors` lists the models.\n[sensor]\nmodel = \"imx250\"\n\
          exposure = \"auto\"\n# exposure = \"5ms\"\n\n# [lens]\n# f_number = 4\n";
    let is_dark =
        scene.lights.is_empty() && !scene.materials.iter().any(Material::emits) && scene.environment.is_none();
    t += if is_dark {
        "\n# The scene has no light. The same light from all directions [W/(m2 sr)]:\n[environment]\nradiance = 1\n"
    } else {
        "\n# Light from all directions [W/(m2 sr)]:\n# [environment]\n# radiance = 0.1\n"
    };
    t
}

fn lights(t: &mut String, scene: &SceneBuilder) {
    let mut seen = BTreeSet::new();
    for light in scene.lights.iter().filter(|l| seen.insert(l.name.as_str())).take(MOST_NAMES) {
        let (kind, key) = match light.kind {
            PunctualKind::Point { .. } => ("A point light", "power = \"1W\""),
            PunctualKind::Spot { .. } => ("A spot light", "power = \"1W\""),
            PunctualKind::Profile { .. } => ("A light with an IES profile", "power = \"1W\""),
            PunctualKind::Directional { .. } => ("A distant light", "irradiance = 1"),
            PunctualKind::Sun { .. } => ("A sun", "irradiance = 1"),
        };
        let _ = writeln!(t, "\n# {kind}.\n# [[light]]\n# name = {}\n# {key}\n# enabled = false", quoted(&light.name));
    }
    for object in scene.instances.iter().filter(|o| !seen.contains(o.name.as_str())).take(MOST_NAMES) {
        let Some([r, g, b]) = emission_of(scene, object) else { continue };
        let _ = writeln!(
            t,
            "\n# An object that emits.\n# [[light]]\n# name = {}\n# radiance = [{r:?}, {g:?}, {b:?}]\n# enabled = false",
            quoted(&object.name)
        );
    }
}

fn materials(t: &mut String, scene: &SceneBuilder) {
    let mut seen = BTreeSet::new();
    for m in scene.materials.iter().filter(|m| !m.name.is_empty() && seen.insert(m.name.as_str())).take(MOST_NAMES) {
        let [r, g, b] = m.base_color.factor.to_array();
        let _ = writeln!(
            t,
            "\n# [[material]]\n# name = {}\n# base_color = [{r:?}, {g:?}, {b:?}]\n# metallic = {:?}\n# roughness = {:?}",
            quoted(&m.name),
            m.metallic.factor,
            m.roughness.factor
        );
        if m.transmission.factor > 0.0 {
            let _ = writeln!(t, "# transmission = {:?}\n# ior = {:?}\n# solid = true", m.transmission.factor, m.ior);
        }
    }
}

fn objects(t: &mut String, scene: &SceneBuilder) {
    let mut seen = BTreeSet::new();
    let named = scene.instances.iter().filter(|o| !o.name.is_empty() && seen.insert(o.name.as_str()));
    for object in named.take(MOST_NAMES) {
        if let Some([low, high]) = scene.bounds_of(object) {
            let ([w, h, d], [x, y, z]) =
                ((high - low).to_array().map(length), (0.5 * (low + high)).to_array().map(length));
            let _ = writeln!(t, "\n# {w} x {h} x {d} m, centre at ({x}, {y}, {z})");
        } else {
            t.push('\n');
        }
        let name = quoted(&object.name);
        let _ = writeln!(t, "# [[object]]\n# name = {name}\n# visible = false\n# translate = [0, 0, \"10mm\"]");
    }
    if scene.instances.len() > MOST_NAMES {
        t.push_str("\n# `dunkelfeld inspect --json` lists the names of all objects.\n");
    }
}

/// Metres with four significant digits.
fn length(v: f64) -> f64 {
    let digits = if v == 0.0 { 0.0 } else { 3.0 - v.abs().log10().floor() };
    let step = 10f64.powf(digits.clamp(-9.0, 9.0));
    (v * step).round() / step
}

/// A text of TOML. The escapes of JSON are valid in it; TOML also escapes the delete character.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string().replace('\u{7f}', "\\u007f")
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_io::job::Job;

    const OBJ: &str = "mtllib a.mtl\no lid \"x\"\nv 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nusemtl steel\nf 1 2 3\no lamp\nusemtl glow\nf 3 2 1\n";
    const MTL: &str = "newmtl steel\nKd 0.5 0.5 0.5\nnewmtl glow\nKe 4 5 6\n";

    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for (name, text) in [("a.obj", OBJ), ("a.mtl", MTL)] {
            std::fs::write(folder.path().join(name), text).expect("writable");
        }
        folder
    }

    #[test]
    fn the_job_renders_and_all_its_lines_are_valid() {
        let folder = folder();
        let at = |name: &str| folder.path().join(name);
        let path = init(Some(&at("a.obj")), None, Some(&at("job.toml"))).expect("a job");
        let text = std::fs::read_to_string(&path).expect("written");
        assert!(text.contains("scene = \"a.obj\"") && text.contains("radiance = [4.0, 5.0, 6.0]"), "{text}");
        let mut project = crate::Project::open(&path).expect("a project");
        (project.settings.width, project.settings.height) = (4, 4);
        project.settings.budget = dunkelfeld_render::Budget::default().with_spp(Some(1.0));
        project.render().expect("an image");
        // With all keys on, except those that exclude others, the entries name things of the scene.
        let on = text.lines().map(|line| match line.strip_prefix("# ") {
            Some(key) if key.starts_with('[') || key.contains(" = ") => key,
            _ => line,
        });
        let repeated = ["visible = false", "exposure = \"5ms\"", "enabled = false"];
        let on: String = on.filter(|line| !repeated.contains(line)).map(|line| format!("{line}\n")).collect();
        let job = Job::from_text(at("all.toml"), &on).unwrap_or_else(|e| panic!("{e}\n{on}"));
        assert_eq!((job.objects.len(), job.materials.len(), job.lights.len()), (2, 2, 1), "{on}");
        let mut scene = job.load_scene().expect("the scene").scene;
        job.apply_overrides(&mut scene).unwrap_or_else(|e| panic!("{e}\n{on}"));
    }

    #[test]
    fn stations_are_made_for_a_stand_in_and_for_a_scene() {
        let folder = folder();
        let at = |name: &str| folder.path().join(name);
        for station in crate::stations::STATIONS {
            for (scene, name) in [(None, "stand-in.toml"), (Some(at("a.obj")), "scene.toml")] {
                let job = at(&format!("{}-{name}", station.name));
                let path = init(scene.as_deref(), Some(station), Some(&job)).expect("a job");
                let mut project = crate::Project::open(&path).unwrap_or_else(|e| panic!("{}: {e}", station.name));
                if scene.is_none() {
                    let findings = project.findings();
                    assert_eq!(findings.hazards().next(), None, "{}", station.name);
                }
                if station.name != "line-scan" {
                    (project.settings.width, project.settings.height) = (24, 20);
                    project.settings.budget = dunkelfeld_render::Budget::default().with_spp(Some(1.0));
                    project.render().unwrap_or_else(|e| panic!("{}: {e}", station.name));
                }
            }
        }
        assert!(init(None, None, Some(&at("none.toml"))).is_err());
    }

    #[test]
    fn shipped_scenes_have_no_hazards() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/inspection");
        for name in ["inspection", "inspection-flat", "inspection-open"] {
            let project = crate::Project::open(folder.join(name).with_extension("toml")).expect(name);
            assert_eq!(project.findings().hazards().next(), None, "{name}");
        }
    }

    #[test]
    fn no_file_is_replaced() {
        let folder = folder();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("job.toml"), "mine").expect("writable");
        for (scene, output, part) in
            [("a.obj", "job.toml", "exists"), ("a.obj", "job.txt", ".toml"), ("b.obj", "new.toml", "not")]
        {
            let error = init(Some(&at(scene)), None, Some(&at(output))).expect_err(output).to_string();
            assert!(error.contains(part), "{error}");
        }
        assert_eq!(std::fs::read_to_string(at("job.toml")).expect("still there"), "mine");
        assert!(!at("new.toml").exists());
    }
}
