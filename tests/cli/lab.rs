//! The bench of tests of long work with a report: a folder with a scene, in which the program runs and leaves tables and a page.

use assert_cmd::Command;
use assert_cmd::assert::Assert;
use dunkelfeld::{Cancel, Progress, ProgressState};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::PathBuf;
use tempfile::TempDir;

const PROGRAM: &str = env!("CARGO_BIN_EXE_dunkelfeld");

/// A folder with a scene whose name does its worst to HTML, `<scene>.obj`, and its materials, `scene.mtl`.
pub(crate) struct Lab {
    folder: TempDir,
}

impl Lab {
    /// From the vertices and faces of the scene, and its materials.
    pub(crate) fn new(geometry: &str, materials: &str) -> Self {
        let lab = Self { folder: TempDir::new().expect("a temporary folder") };
        lab.write("<scene>.obj", &format!("mtllib scene.mtl\n{geometry}"));
        lab.write("scene.mtl", materials);
        lab
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).expect("writable");
    }

    pub(crate) fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// Runs the program in the folder, with the words of a line as arguments.
    pub(crate) fn run(&self, line: &str) -> Assert {
        Command::new(PROGRAM).current_dir(self.folder.path()).args(line.split_whitespace()).assert()
    }

    pub(crate) fn names(&self, folder: &str) -> BTreeSet<String> {
        let entries = fs::read_dir(self.path(folder)).expect("readable");
        entries.map(|e| e.expect("readable").file_name().to_string_lossy().into_owned()).collect()
    }

    /// The rows of a table, by column.
    pub(crate) fn table(&self, name: &str) -> Vec<BTreeMap<String, String>> {
        let text = self.read(name);
        csv::Reader::from_reader(text.as_bytes()).deserialize().map(|row| row.expect("a row")).collect()
    }
}

/// The vertices of a level square around the origin.
pub(crate) fn square(half: f32, height: f32, down: bool) -> String {
    let corners = [[-half, half], [half, half], [half, -half], [-half, -half]];
    let corner = |i: usize| corners[if down { 3 - i } else { i }];
    (0..4).map(|i| format!("v {} {height} {}\n", corner(i)[0], corner(i)[1])).collect()
}

/// The text on standard error.
pub(crate) fn complaint(assert: &Assert) -> String {
    String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
}

/// Cancels once a share of the work is done.
pub(crate) struct CutAt<'a>(pub(crate) f64, pub(crate) &'a Cancel);

impl Progress for CutAt<'_> {
    fn update(&self, state: &ProgressState) {
        if state.fraction >= self.0 {
            self.1.cancel();
        }
    }
}

/// A page (from [`crate::markup::as_xml`]) is well-formed, has the scene's name as text and not as an element, and loads nothing from anywhere: no links, no
/// sources but those in the page itself, nor by style or script.
pub(crate) fn stands_alone(page: &str) -> roxmltree::Document<'_> {
    let document = roxmltree::Document::parse(page).unwrap_or_else(|e| panic!("{e}"));
    assert!(!document.descendants().any(|n| n.has_tag_name("scene")));
    for node in document.descendants() {
        assert!(!["link", "iframe", "object", "embed", "base"].contains(&node.tag_name().name()), "{node:?}");
        for attribute in node.attributes() {
            let loads = ["src", "href", "srcset", "action", "poster", "data"].contains(&attribute.name());
            assert!(!loads || attribute.value().starts_with("data:image/"), "{attribute:?}");
        }
    }
    // The pictures' own letters may spell anything.
    let parts = page.split("data:image/").enumerate();
    let text: String = parts.map(|(i, p)| if i == 0 { p } else { p.split_once('"').map_or("", |p| p.1) }).collect();
    for foreign in ["http:", "https:", "@import", "url(", "src=\"//", "NaN", "inf "] {
        assert!(!text.contains(foreign), "the page has {foreign:?}");
    }
    document
}

/// The numbers of a table of the page are those of its file, cell by cell.
pub(crate) fn same_numbers(document: &roxmltree::Document<'_>, name: &str, csv: &str) {
    let id = format!("table-{name}");
    let table = document.descendants().find(|n| n.attribute("id") == Some(&id)).unwrap_or_else(|| panic!("{id}"));
    let shown: Vec<&str> = table.descendants().filter_map(|n| n.attribute("value")).collect();
    let mut reader = csv::Reader::from_reader(csv.as_bytes());
    let cells = reader.records().flat_map(|row| row.expect("a row").iter().map(str::to_owned).collect::<Vec<_>>());
    let written: Vec<String> = cells.filter(|c| c.is_empty() || c.parse::<f64>().is_ok()).collect();
    assert_eq!(shown, written, "{name}");
    assert!(!shown.is_empty(), "{name} is empty");
}
