//! The reference pages under `docs/` against the code: every key that is read or written has its row, every row its key,
//! and examples, defaults and ranges are what the readers make of them.
//!
//! Replay: `cargo test -p dunkelfeld --test it docs::NAME`.

use crate::support::{Add, build, emitter, rendered, sensor, settings, spot_camera, square};
use dunkelfeld::film::Plane;
use dunkelfeld::geometry::DVec3;
use dunkelfeld::memory::{MemoryAccount, MemoryItem, MemoryStats};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::{Effect, Material, Scene, SceneBuilder};
use dunkelfeld::sensor::PixelMap;
use dunkelfeld::stats::{DenoiseStats, HeavySample, PartStats, STATS_VERSION};
use dunkelfeld::{Budget, Project, RenderSettings, Stage, Stats, develop_film, find_sensor};
use dunkelfeld_io::InputError;
use dunkelfeld_io::job::{Job, light_keys, object_keys};
use dunkelfeld_io::sensor_file::parse_sensor;
use dunkelfeld_io::tiff::write_map;
use dunkelfeld_io::toml_file::TomlFile;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

// --- Pages -------------------------------------------------------------------------------------------------------------

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn page(name: &str) -> String {
    let path = root().join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// A heading and the rows of the tables under it, without their header.
struct Section {
    title: String,
    rows: Vec<Vec<String>>,
}

/// The sections of a page that hold a table.
fn sections(text: &str) -> Vec<Section> {
    let mut found: Vec<Section> = Vec::new();
    let mut title = String::new();
    for line in text.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            title = heading.trim_matches('`').to_owned();
            continue;
        }
        let Some(cells) = line.strip_prefix("| `").and_then(|l| l.strip_suffix(" |")) else { continue };
        let cells: Vec<String> = format!("`{cells}").split(" | ").map(str::to_owned).collect();
        match found.last_mut() {
            Some(section) if section.title == title => section.rows.push(cells),
            _ => found.push(Section { title: title.clone(), rows: vec![cells] }),
        }
    }
    found
}

/// The text of the code blocks in one language.
fn blocks(text: &str, language: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut open: Option<String> = None;
    for line in text.lines() {
        match &mut open {
            Some(_) if line == "```" => found.extend(open.take()),
            Some(block) => *block += &format!("{line}\n"),
            None if line.strip_prefix("```") == Some(language) => open = Some(String::new()),
            None => {}
        }
    }
    found
}

/// The text of a cell that is one pair of backticks.
fn literal(cell: &str) -> Option<&str> {
    cell.strip_prefix('`')?.strip_suffix('`').filter(|inner| !inner.contains('`'))
}

// --- TOML references ---------------------------------------------------------------------------------------------------

/// One row of a table of keys: key, value, default, example, meaning.
struct Row {
    key: String,
    value: String,
    default: String,
    example: String,
}

impl Row {
    fn of(cells: &[String]) -> Self {
        let [key, value, default, example, _meaning] = cells else { panic!("five columns: {cells:?}") };
        let inner = |cell: &str| literal(cell).unwrap_or_else(|| panic!("`{cell}` is no literal")).to_owned();
        Self { key: inner(key), value: value.clone(), default: default.clone(), example: inner(example) }
    }

    fn is_required(&self) -> bool {
        self.default == "required"
    }

    /// `0 to 1` at the end of the value's description; `within 0 to 1` where other keys narrow it further.
    fn range(&self) -> Option<(f64, f64, bool)> {
        let (before, high) = self.value.rsplit_once(" to ")?;
        let (what, low) = before.rsplit_once(' ')?;
        Some((low.parse().ok()?, high.parse().ok()?, what.ends_with("within")))
    }

    fn number(&self, v: f64) -> String {
        if self.value.starts_with("whole number") { format!("{v:.0}") } else { format!("{v:?}") }
    }
}

/// A page of keys, and the reader that it describes.
struct Reference {
    page: &'static str,
    read: fn(&str) -> Result<String, InputError>,
}

const JOB: Reference = Reference { page: "docs/job-file.md", read: read_job };
const SENSOR: Reference = Reference { page: "docs/sensor-file.md", read: read_sensor };

/// The values of a job, as text, without the source that it keeps for messages.
fn read_job(text: &str) -> Result<String, InputError> {
    let job = Job::from_text("job.toml", text)?;
    let said = format!("{job:?}");
    Ok(said.split(", source: TomlFile").next().unwrap_or_default().to_owned())
}

/// Sensors, with the maps of the examples beside the file.
fn read_sensor(text: &str) -> Result<String, InputError> {
    static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for name in ["dsnu", "prnu", "flat"] {
            let map = PixelMap::new(Plane::new(4, 3, 1.0)).expect("finite");
            write_map(&folder.path().join(format!("{name}.tif")), &map, name).expect("writable");
        }
        folder
    });
    parse_sensor(&TomlFile::from_text(FOLDER.path().join("sensor.toml"), text)).map(|model| format!("{model:?}"))
}

const ROOT: &str = "The file itself";

impl Reference {
    fn tables(&self) -> Vec<(String, Vec<Row>)> {
        let found = sections(&page(self.page));
        assert!(found.iter().any(|s| s.title == ROOT), "{} has no section \"{ROOT}\"", self.page);
        found.into_iter().map(|s| (s.title, s.rows.iter().map(|cells| Row::of(cells)).collect())).collect()
    }

    /// A file with `key = value` in a table, and beside it only the required keys.
    fn text(&self, table: &str, key: &str, value: &str) -> String {
        let mut text = String::new();
        for (title, rows) in self.tables() {
            let here = title == table;
            if title != ROOT && here {
                text += &format!("{title}\n");
            }
            if title == ROOT || here {
                for row in rows.iter().filter(|row| row.is_required() && !(here && row.key == key)) {
                    text += &format!("{} = {}\n", row.key, row.example);
                }
            }
            if title == ROOT && !(here && key.starts_with("gain_")) && self.page == SENSOR.page {
                text += "gain_dn_per_e = 0.38\n";
            }
            // One curve, or those of a filter.
            if title == ROOT && table != "[color_filter]" && key != "quantum_efficiency" && self.page == SENSOR.page {
                text += "quantum_efficiency = [[545, 0.7]]\n";
            }
            // Parts have a whole.
            for (whole, parts) in [("dsnu_e", "dsnu_"), ("prnu_percent", "prnu_")] {
                if title == ROOT && here && key.starts_with(parts) && key != whole && self.page == SENSOR.page {
                    text += &format!("{whole} = 4\n");
                }
            }
            if here {
                text += &format!("{key} = {value}\n");
                // These two belong to an image.
                if table == "[environment]" && ["scale", "rotation"].contains(&key) {
                    text += "image = \"sky.hdr\"\n";
                }
                // And these to a finite aperture, to one kind of lens, or to one denoiser.
                text += match (table, key) {
                    ("[lens]", "blades") => "focus_distance = 1\n",
                    ("[lens]", "blade_rotation") => "focus_distance = 1\nblades = 6\n",
                    ("[lens]", "field_height" | "numerical_aperture") => "projection = \"telecentric\"\n",
                    ("[[light]]", key) => lamp_of(key),
                    ("[camera]", "up") => "look_at = [9, 9, 9]\nposition = [1, 2, 3]\n",
                    ("[camera]", "position") => "look_at = [9, 9, 9]\n",
                    ("[camera]", "look_at") => "working_distance = 0.5\n",
                    ("[camera]", "direction") => "look_at = [9, 9, 9]\nworking_distance = 0.5\n",
                    ("[camera]", "working_distance") => "look_at = [9, 9, 9]\n",
                    ("[camera]", "R") => "t = [0, 0, 1]\n",
                    ("[camera]", "t") => "R = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n",
                    ("[denoise]", "oidn") => "method = \"oidn\"\n",
                    ("[[object]]", "kind") => "size = [1, 1, 1]\n",
                    ("[[object]]", "size") => "kind = \"box\"\n",
                    ("[[object]]", "diameter") => "kind = \"sphere\"\n",
                    ("[[object]]", "height") => "kind = \"cylinder\"\ndiameter = 1\n",
                    ("[[object]]", "pivot") => "rotate = [0, 0, \"90deg\"]\n",
                    ("[defects]", "hot_per_million") => "[dark_current]\ne_per_s = 1\nat_c = 25\ndoubling_k = 7\n",
                    _ => "",
                };
            }
        }
        text
    }

    fn try_value(&self, table: &str, key: &str, value: &str) -> Result<String, InputError> {
        (self.read)(&self.text(table, key, value))
    }

    /// Keys that the code reads in a table, from its message about an unknown key.
    fn known_keys(&self, table: &str) -> BTreeSet<String> {
        match table {
            "[[light]]" => return light_keys().into_iter().map(str::to_owned).collect(),
            "[[object]]" => return object_keys().into_iter().map(str::to_owned).collect(),
            _ => {}
        }
        let error = self.try_value(table, "qqqqqqqqqqqq", "1").expect_err("an unknown key");
        let list = error.help.split("known keys: ").nth(1).unwrap_or_else(|| panic!("{table}: {error}"));
        list.split(", ").map(str::to_owned).collect()
    }

    fn check(&self) {
        let tables = self.tables();
        for (table, rows) in &tables {
            let mut documented: BTreeSet<String> = rows.iter().map(|row| row.key.clone()).collect();
            assert_eq!(documented.len(), rows.len(), "{}, {table}: a key has two rows", self.page);
            if table == ROOT {
                let others = tables.iter().map(|(title, _)| title).filter(|title| *title != ROOT);
                documented.extend(others.map(|title| title.trim_matches(['[', ']']).to_owned()));
            }
            let known = self.known_keys(table);
            assert_eq!(documented, known, "{}, {table}: left the page, right the code", self.page);
            for row in rows {
                self.check_row(table, row);
            }
        }
    }

    fn check_row(&self, table: &str, row: &Row) {
        let place = format!("{}, {table} {}", self.page, row.key);
        let set = |value: &str| self.try_value(table, &row.key, value);
        set(&row.example).unwrap_or_else(|e| panic!("{place}: the example is refused: {e}"));
        if let Some(default) = literal(&row.default) {
            let said = set(default).unwrap_or_else(|e| panic!("{place}: the default is refused: {e}"));
            let silent = self.silent(table, &row.key);
            // Either the reader fills the default in, or it leaves the key out and the code that uses it does.
            assert!(
                said == silent || silent.contains(&format!("{}: None", row.key)),
                "{place}: {said}\nsilent: {silent}"
            );
        }
        for choice in row.value.split(['`']).skip(1).step_by(2).filter(|c| c.starts_with('"') || *c == "inf") {
            set(choice).unwrap_or_else(|e| panic!("{place}: {choice} is refused: {e}"));
        }
        let Some((low, high, narrowed)) = row.range() else { return };
        let step = |v: f64| if row.value.starts_with("whole") { 1.0 } else { 1e-3 * v.abs().max(1.0) };
        for end in [low, high].into_iter().filter(|_| !narrowed) {
            set(&row.number(end)).unwrap_or_else(|e| panic!("{place}: {end} is refused: {e}"));
        }
        for beyond in [low - step(low), high + step(high)] {
            assert!(set(&row.number(beyond)).is_err(), "{place}: {beyond} is accepted");
        }
    }

    /// The result of the reader for the file of [`Self::text`] without the key.
    fn silent(&self, table: &str, key: &str) -> String {
        let text = self.text(table, key, "?").replace(&format!("{key} = ?\n"), "");
        (self.read)(&text).unwrap_or_else(|e| panic!("{}, {table}: {e}\n{text}", self.page))
    }
}

/// The other keys of a lamp with this key.
fn lamp_of(key: &str) -> &'static str {
    const RING: &str = "kind = \"ring\"\ndistance = 1\n";
    match key {
        "name" | "unknown" => "",
        "kind" => "diameter = 1\nposition = [1, 1, 1]\n",
        "diameter" => RING,
        "inner_diameter" | "tilt" | "leds" | "lens_angle" => "kind = \"ring\"\ndistance = 1\ndiameter = 1000\n",
        "led_diameter" | "diffuser" => "kind = \"ring\"\ndistance = 1\ndiameter = 1000\nleds = 8\n",
        "width" => "kind = \"panel\"\ndistance = 1\n",
        "height" | "spread" | "body" => "kind = \"panel\"\ndistance = 1\nwidth = 1\n",
        "opening" => "kind = \"dome\"\ndiameter = 1000\n",
        "splitter" => "kind = \"coaxial\"\ndistance = 1\nwidth = 1\n",
        "cone_angle" | "blend" => "kind = \"spot\"\ndistance = 1\n",
        "angle" => "kind = \"sun\"\n",
        "distance" => "kind = \"panel\"\nwidth = 1\n",
        "position" => "kind = \"panel\"\nwidth = 1\n",
        "aim" => "kind = \"panel\"\nwidth = 1\nposition = [0, 1, 0]\n",
        "azimuth" => "kind = \"panel\"\nwidth = 1\ndistance = 1\nelevation = \"20deg\"\n",
        "camera" | "target" | "direction" | "elevation" | "up" | "count" => {
            "kind = \"panel\"\nwidth = 1\ndistance = 1\n"
        }
        "working_distance" => "kind = \"panel\"\nwidth = 1\ndistance = 1\nirradiance = 1\n",
        "strobe" => "kind = \"panel\"\nwidth = 1\ndistance = 1\n[sensor]\nexposure = \"1ms\"\n",
        _ => "name = \"lamp\"\n",
    }
}

#[test]
fn the_job_page_names_every_key_and_no_other() {
    JOB.check();
}

#[test]
fn the_sensor_page_names_every_key_and_no_other() {
    SENSOR.check();
}

#[test]
fn the_examples_of_the_pages_and_all_presets_are_read() {
    for reference in [JOB, SENSOR] {
        let examples = blocks(&page(reference.page), "toml");
        assert!(!examples.is_empty(), "{} has no example", reference.page);
        for example in examples {
            (reference.read)(&example).unwrap_or_else(|e| panic!("{}: {e}\n{example}", reference.page));
        }
    }
    assert!(dunkelfeld_io::sensor_file::preset_names().all(|name| find_sensor(name).is_ok()));
}

#[test]
fn the_stations_page_shows_each_preset_station() {
    let text = page("docs/stations.md");
    let lamps = text.split("## Lamps\n").nth(1).expect("docs/stations.md has a section about lamps");
    let example = format!("scene = \"none\"\n{}", blocks(lamps, "toml")[0]);
    (JOB.read)(&example).unwrap_or_else(|e| panic!("{e}\n{example}"));
    for station in dunkelfeld::commands::STATIONS {
        let picture = format!("stations/{}.png", station.name);
        assert!(text.contains(&format!("| `{}`: ", station.name)) && text.contains(&picture), "{}", station.name);
        assert!(root().join("docs").join(&picture).is_file(), "{picture} is missing");
    }
}

// --- Examples ----------------------------------------------------------------------------------------------------------

/// Opens a job of `examples/jobs/` with this text.
fn open_example(text: &str) {
    let project = Project::from_text(root().join("examples/jobs/job.toml"), text);
    project.and_then(|p| p.fitted().map(|_| ())).unwrap_or_else(|e| panic!("{e}\n{text}"));
}

#[test]
fn the_examples_page_shows_each_job_with_its_picture() {
    let text = page("docs/examples.md");
    let shown = blocks(&text, "toml");
    let files = std::fs::read_dir(root().join("examples/jobs")).expect("the folder of the jobs");
    let paths = files.map(|file| file.expect("a file").path());
    let jobs: Vec<PathBuf> =
        paths.filter(|p| p.extension().is_some_and(|e| e == "toml") && !p.ends_with("recipes.toml")).collect();
    assert_eq!(shown.len(), jobs.len(), "jobs on the page, and in the folder");
    for path in jobs {
        let (name, job) = (path.file_stem().expect("a name").to_string_lossy(), page(&path.to_string_lossy()));
        assert!(shown.contains(&job), "docs/examples.md shows another text of {name}");
        assert!(text.contains(&format!("](examples/{name}.png)")) && job.lines().count() <= 25, "{name}");
        // A study has values that no job has; the crate of data sets reads it.
        if !job.contains("[[study.defect]]") {
            open_example(&job);
        }
    }
}

#[test]
fn the_recipes_fit_the_part_of_their_job() {
    let base = page("examples/jobs/recipes.toml");
    let recipes = blocks(&page("docs/recipes.md"), "toml");
    assert!(recipes.len() >= 13, "recipes are missing");
    for recipe in recipes {
        open_example(&format!("{base}\n{recipe}"));
    }
}

// --- Materials ---------------------------------------------------------------------------------------------------------

#[test]
fn the_materials_page_states_what_becomes_of_every_material_extension() {
    let extensions = |text: &str| -> BTreeSet<String> {
        let names = text.split("KHR_materials_").skip(1);
        names.map(|rest| rest.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect()).collect()
    };
    let read = extensions(&page("crates/job/io/src/import/gltf/container.rs"));
    assert!(read.len() >= 11, "the importer names its extensions in another file");
    assert_eq!(extensions(&page("docs/materials.md")), read, "left the page, right the importer");
}

// --- Statistics --------------------------------------------------------------------------------------------------------

/// A lamp that fills the view.
fn lamp() -> Scene {
    let mut b = SceneBuilder::default();
    b.add("lamp", square(0.0, 1.0, false), Material { emission: Rgb::new(1.0, 2.0, 3.0).into(), ..emitter(1.0) });
    spot_camera(&mut b, DVec3::new(0.0, 0.0, 1.0), DVec3::ZERO, 0.25);
    build(b)
}

fn stats(settings: &RenderSettings) -> Value {
    let rendering = rendered(&lamp(), settings);
    let frame = develop_film(&rendering.film, settings).expect("a frame");
    let mut stats = Stats::new(&rendering, &frame, settings);
    for stage in [
        Stage::Load,
        Stage::Build,
        Stage::Training,
        Stage::Pilot,
        Stage::Plan,
        Stage::Refine,
        Stage::Expose,
        Stage::Denoise,
        Stage::Write,
    ] {
        stats.add_seconds(stage, 0.0);
    }
    let error = settings.budget.seconds.map(|_| "no reason".into());
    let denoise = DenoiseStats { denoiser: "builtin 1".into(), seconds: 0.1, error };
    if settings.has_sensor() {
        stats.add_denoising(denoise);
    }
    // A named sample shows the form of the list's entries.
    stats.sampling.invalid_named.push("1,2,3".into());
    let heavy = HeavySample { sample: "1,2,3".into(), luminance: 2.0, share: 0.5, lift: 0.1, dominates: false };
    stats.sampling.heaviest_samples.push(heavy);
    if settings.has_sensor() {
        let item = MemoryItem { name: "film".into(), bytes: vec![7, 8] };
        let phases = vec!["render".into(), "write".into()];
        let account = MemoryAccount { phases, items: vec![item], peak_bytes: 8 };
        // As on a system that counts it, and on one that does not.
        let measured_bytes = settings.budget.seconds.map(|_| 7);
        stats.memory = Some(MemoryStats { account, measured_bytes, film_bytes: 7 });
        stats.time.parts = Some(vec![PartStats { file: "a.film".into(), range: [0, 8], samples: 96, seconds: 0.5 }]);
    }
    stats.finish(1.0);
    serde_json::from_str(&stats.to_json()).expect("JSON")
}

/// With and without a sensor, a time limit, and a variance: every field in every form that it can have.
fn all_kinds_of_stats() -> [Value; 3] {
    let sensor = sensor("imx250", None);
    let budget = Budget::default().with_seconds(60.0).with_spp(8.0).with_noise(Some(100.0));
    [
        stats(&settings(4, 3, 8.0, 1).with_sensor(sensor.clone()).with_budget(budget)),
        stats(&settings(4, 3, 1.0, 1).with_sensor(sensor)),
        stats(&settings(4, 3, 1.0, 1)),
    ]
}

/// Does a value have the type that a row states?
fn fits(value: &Value, kind: &str) -> bool {
    let entries = |check: fn(&Value) -> bool| value.as_array().is_some_and(|a| a.iter().all(check));
    let length = |n: usize| value.as_array().is_some_and(|a| a.len() == n);
    match kind {
        "integer" => value.is_u64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "object" => value.is_object(),
        "object of numbers" => value.as_object().is_some_and(|o| o.values().all(Value::is_number)),
        "array of strings" => entries(Value::is_string),
        "array of objects" => entries(Value::is_object),
        "array of 2 integers" => length(2) && entries(Value::is_u64),
        "array of 3 numbers" => length(3) && entries(Value::is_number),
        "array of 3 numbers or nulls" => length(3) && entries(|v| v.is_number() || v.is_null()),
        other => match other.strip_suffix(" or null") {
            Some(kind) => value.is_null() || fits(value, kind),
            None => panic!("the page states an unknown type: {other}"),
        },
    }
}

#[test]
fn the_statistics_page_names_every_field_with_its_type() {
    let text = page("docs/statistics.md");
    let version = format!("version {STATS_VERSION}.");
    assert!(text.contains(&version), "docs/statistics.md does not say that it describes {version}");
    let examples = blocks(&text, "json");
    let example: Value = serde_json::from_str(&examples[0]).expect("the example is JSON");
    let renders = all_kinds_of_stats();
    for section in sections(&text) {
        let part =
            |whole: &Value| if section.title == "Fields" { whole.clone() } else { whole[&section.title].clone() };
        // Of a list of objects each one is described.
        let objects = |whole: &Value| match part(whole) {
            Value::Array(list) => list,
            one => vec![one],
        };
        for part in renders.iter().chain([&example]).flat_map(objects) {
            let Some(fields) = part.as_object() else { continue };
            let documented: BTreeSet<&str> = section.rows.iter().filter_map(|row| literal(&row[0])).collect();
            let written: BTreeSet<&str> = fields.keys().map(String::as_str).collect();
            assert_eq!(documented, written, "docs/statistics.md, {}: left the page, right the code", section.title);
            for row in &section.rows {
                let value = &fields[literal(&row[0]).expect("a field")];
                assert!(fits(value, &row[1]), "docs/statistics.md, {} is \"{}\", but here {value}", row[0], row[1]);
            }
        }
        // A field that is never null must not be documented as such.
        for row in section.rows.iter().filter(|row| row[1].contains("null")) {
            let field = literal(&row[0]).expect("a field");
            let has_null = |v: &Value| v.is_null() || v.as_array().is_some_and(|a| a.iter().any(Value::is_null));
            assert!(renders.iter().any(|r| has_null(&part(r)[field])), "docs/statistics.md: {field} is never null");
        }
    }
}

// --- Effects -----------------------------------------------------------------------------------------------------------

/// Each effect and each technique has its row, in their order, and prices are those of effects that there are.
#[test]
fn the_effects_page_names_every_effect_and_no_other() {
    let found = sections(&page("docs/effects.md"));
    let names = |title: &str| -> Vec<String> {
        let rows = found.iter().filter(|s| s.title == title).flat_map(|s| &s.rows);
        rows.map(|cells| literal(&cells[0]).unwrap_or_else(|| panic!("{cells:?} has no name")).to_owned()).collect()
    };
    let of = |techniques: bool| -> Vec<&str> {
        Effect::ALL.into_iter().filter(|e| e.is_technique() == techniques).map(|e| e.name()).collect()
    };
    assert_eq!(names("The effects"), of(false));
    assert_eq!(names("Techniques"), of(true));
    let prices = names("Cost");
    let unknown: Vec<&String> = prices.iter().filter(|p| !Effect::ALL.iter().any(|e| e.name() == p.as_str())).collect();
    assert!(unknown.is_empty() && prices.len() >= 24, "no effects: {unknown:?} of {} prices", prices.len());
}

// --- Checkpoints -------------------------------------------------------------------------------------------------------

/// The bytes of a pixel add up to what the code writes.
#[test]
fn the_checkpoint_page_states_the_bytes_of_a_pixel() {
    use dunkelfeld_io::checkpoint::{CHECKPOINT_VERSION, PIXEL_BYTES};
    let text = page("docs/checkpoints.md");
    assert!(text.contains(&format!("| sums | {PIXEL_BYTES} per pixel, 8 |")), "the sums have {PIXEL_BYTES} bytes");
    assert!(text.contains(&format!("version of the format: {CHECKPOINT_VERSION} |")));
    let pixel = text.split("A pixel:").nth(1).expect("the table of a pixel");
    let rows = pixel.lines().filter_map(|line| line.strip_prefix("| ")).filter_map(|row| row.split(" |").next());
    let bytes = rows.flat_map(|first| first.split(", ")).filter_map(|n| n.parse::<usize>().ok());
    assert_eq!(bytes.sum::<usize>(), PIXEL_BYTES);
}

// --- Links -------------------------------------------------------------------------------------------------------------

/// Targets of the links and pictures of a page that lie in this repository.
fn local_links(text: &str) -> Vec<String> {
    let targets = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    targets.filter(|t| !t.contains("://")).map(str::to_owned).collect()
}

/// The name that a heading gets as the target of a link.
fn anchor(heading: &str) -> String {
    let lower = heading.trim_start_matches('#').trim().to_lowercase();
    lower.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c)).collect::<String>().replace(' ', "-")
}

#[test]
fn links_between_the_pages_lead_somewhere() {
    let mut pages: Vec<String> =
        ["README.md", "ARCHITECTURE.md", "CONVENTIONS.md", "CONTRIBUTING.md", "CHANGELOG.md", "validation/README.md"]
            .map(str::to_owned)
            .into();
    for folder in ["docs", "docs/research"] {
        let files = std::fs::read_dir(root().join(folder)).expect("the folder of the pages");
        let names = files.map(|file| file.expect("a file").file_name().into_string().expect("UTF-8"));
        pages.extend(names.filter(|name| name.ends_with(".md")).map(|name| format!("{folder}/{name}")));
    }
    assert!(pages.len() >= 35, "pages are missing: {pages:?}");
    for name in &pages {
        let folder = root().join(name).parent().map(Path::to_path_buf).unwrap_or_default();
        for link in local_links(&page(name)) {
            let (file, fragment) = link.split_once('#').unwrap_or((&link, ""));
            let target = if file.is_empty() { root().join(name) } else { folder.join(file) };
            assert!(target.exists(), "{name}: nothing at {link}");
            if !fragment.is_empty() {
                let text = std::fs::read_to_string(&target).expect("a page");
                let found = text.lines().filter(|l| l.starts_with('#')).any(|l| anchor(l) == fragment);
                assert!(found, "{name}: no heading for {link}");
            }
        }
    }
}
