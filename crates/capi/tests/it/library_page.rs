//! `docs/library.md` names functions that exist: those of Rust for the compiler, those of C in the header, keys of a job in the page
//! that is held to the code. Names of Python are tested by `crates/python/tests/test_library_page.py`.
//! Replay: `cargo test --workspace --test it library_page`.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

fn page(name: &str) -> String {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(name);
    fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn header() -> String {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(package.join("cbindgen.toml")).expect("a configuration");
    let mut text = Vec::new();
    let built = cbindgen::Builder::new().with_config(config).with_src(package.join("src/lib.rs")).generate();
    built.expect("a header").write(&mut text);
    String::from_utf8(text).expect("UTF-8")
}

/// The cells of the rows of a section's table, without its head.
fn rows(title: &str) -> Vec<Vec<String>> {
    let text = page("docs/library.md");
    let section = text.split("\n## ").find(|section| section.starts_with(title)).expect("a section");
    let rows = section.lines().filter(|line| line.starts_with('|')).skip(2);
    let cells = |row: &str| row.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect();
    let rows: Vec<Vec<String>> = rows.map(cells).collect();
    assert!(!rows.is_empty(), "{title} has no rows");
    rows
}

/// The texts in backticks.
fn names(cell: &str) -> impl Iterator<Item = &str> {
    cell.split('`').skip(1).step_by(2)
}

fn column(n: usize) -> BTreeSet<String> {
    rows("Tasks").iter().flat_map(|row| names(&row[n]).map(String::from).collect::<Vec<_>>()).collect()
}

/// Does `text` contain `word` as a whole word?
fn has_word(text: &str, word: &str) -> bool {
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    text.match_indices(word).any(|(at, _)| {
        !text[..at].chars().next_back().is_some_and(is_part)
            && !text[at + word.len()..].chars().next().is_some_and(is_part)
    })
}

/// The names of paths, which must be those of functions.
macro_rules! functions {
    ($($path:path),* $(,)?) => {{
        $(let _ = $path;)*
        [$(stringify!($path).replace(' ', "")),*]
    }};
}

#[test]
fn the_functions_of_rust_exist() {
    use dunkelfeld::commands::{
        Station, denoise_exr, denoise_planes, expose_exr, expose_image, expose_radiance, init_text, merge, sensor_sheet,
    };
    use dunkelfeld::film::{Film, PixelSums, certify_film, denoise_saved, expose_film, picture_of_film};
    use dunkelfeld::outputs::{SavedPlan, save_film, save_film_files};
    use dunkelfeld::trace::PixelIds;
    use dunkelfeld::{Cancel, Error, Progress, Project, ProjectOptions, ReplayOption, SavedFilm, Stats, find_sensor};
    // Their arguments are generic, so that they have no type alone.
    let _ = |path: &Path| Project::open(path);
    let _ = |path: &Path, text: &str| Project::from_text(path, text);
    let _ = |progress: &dyn Progress, state: &dunkelfeld::ProgressState| Progress::update(progress, state);
    let generic = ["Project::open", "Project::from_text", "Progress::update"].map(String::from);
    let others = functions![
        Project::set_overrides,
        ProjectOptions::with_without,
        Project::inspect,
        Project::trace_sample,
        ReplayOption::Plan,
        SavedPlan::of_film,
        save_film,
        save_film_files,
        expose_image,
        expose_exr,
        expose_radiance,
        denoise_exr,
        denoise_planes,
        init_text,
        Station::job,
        sensor_sheet,
        Project::render_options,
        Cancel::cancel,
        Film::mean,
        Film::variance,
        Film::sample_counts,
        PixelSums::mean_normal,
        PixelSums::mean_albedo,
        PixelSums::mean_depth,
        PixelSums::mean_first_light,
        PixelIds::object,
        PixelIds::material,
        expose_film,
        picture_of_film,
        certify_film,
        denoise_saved,
        Stats::to_json,
        SavedFilm::write,
        SavedFilm::read,
        merge,
        find_sensor,
        Error::parts,
    ];
    let expected: BTreeSet<String> = generic.into_iter().chain(others).collect();
    assert_eq!(column(1), expected, "the column of Rust, and the functions of this test");
}

#[test]
fn the_functions_of_c_exist() {
    let header = header();
    for name in column(3) {
        assert!(has_word(&header, &name), "{name} is not in the header");
    }
    // And the other way: every function that is no helper of another has its task.
    let helpers = [
        "dunkelfeld_text_close",
        "dunkelfeld_scene_close",
        "dunkelfeld_film_close",
        "dunkelfeld_film_size",
        "dunkelfeld_film_read",
        "dunkelfeld_film_read_ids",
        "dunkelfeld_film_name_counts",
        "dunkelfeld_cancel_new",
        "dunkelfeld_cancel_close",
        "dunkelfeld_version",
        "dunkelfeld_abi_version",
        "dunkelfeld_check_abi",
        "dunkelfeld_render_options",
        "dunkelfeld_expose_options",
        "dunkelfeld_certificate",
    ];
    let words = header.split(|c: char| !c.is_alphanumeric() && c != '_');
    for name in words.filter(|word| word.starts_with("dunkelfeld_")) {
        assert!(column(3).contains(name) || helpers.contains(&name), "{name} has no task in docs/library.md");
    }
}

/// The keys of `docs/job-file.md`, as `key` or `[section] key`.
fn job_keys() -> BTreeSet<String> {
    let text = page("docs/job-file.md");
    let mut found = BTreeSet::new();
    for section in text.split("\n## ").skip(1) {
        let title = names(section.lines().next().expect("a title")).next().map(|title| format!("{title} "));
        for line in section.lines().filter(|line| line.starts_with("| `")) {
            let key = names(line).next().expect("a key");
            found.insert(format!("{}{key}", title.clone().unwrap_or_default()));
        }
    }
    found
}

#[test]
fn the_keys_of_jobs_exist() {
    let keys = job_keys();
    let named = rows("Tasks").into_iter().map(|row| row[4].clone());
    for cell in named {
        for name in names(&cell).filter(|name| !name.starts_with("--") && !name.starts_with("dunkelfeld ")) {
            assert!(keys.contains(name), "`{name}` is no key of docs/job-file.md");
        }
    }
}
