//! A small study in a folder of its own, and the program with it.

use crate::bench::PROGRAM;
use assert_cmd::Command;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

/// A plate with two blocks and a ball under a lamp, from above.
pub(crate) const STUDY: &str = r#"
scene = "none"

[study]
name = "blocks"
count = 6
seed = 3
device = 2

[study.draw]
supply = { uniform = [0.8, 1.2] }
twice = { expression = "2 * supply" }

[study.images]
linear = "tiff"
raw = true

[study.labels]
semantic = true
depth = true
normals = true
yolo = true
bop = true

[[study.label]]
category = "block"
objects = "block *"

[[study.label]]
category = "ball"
objects = ["ball"]

[[study.place]]
objects = "block *"
center = [0, 0, 0]
size = ["90mm", 0, "90mm"]
turn = "360deg"
clearance = "1mm"

[[study.defect]]
kind = "scratch"
on = "plate"
facing = [0, 1, 0]
count = { integer = [0, 2] }
length = { uniform = ["10mm", "30mm"] }
width = "2mm"
depth = "100um"

[camera]
name = "above"
position = [{ uniform = ["-5mm", "5mm"] }, "300mm", "1mm"]
look_at = [0, 0, 0]
vertical_fov = "25deg"

[film]
width = 64
height = 48

[budget]
spp = 8

[sensor]
exposure = "20ms"

[[object]]
name = "plate"
kind = "box"
size = ["120mm", "2mm", "120mm"]
translate = [0, "-1mm", 0]

[[object]]
name = "block 1"
kind = "box"
size = ["12mm", "6mm", "12mm"]
translate = [0, "3mm", 0]

[[object]]
name = "block 2"
kind = "box"
size = ["10mm", "8mm", "20mm"]
translate = [0, "4mm", 0]

[[object]]
name = "ball"
kind = "sphere"
diameter = { log_uniform = ["6mm", "12mm"] }
translate = ["40mm", "12mm", "30mm"]

[[light]]
name = "panel"
kind = "panel"
width = "100mm"
position = ["150mm", "200mm", 0]
target = [0, 0, 0]
power = { expression = "1.5 * supply", unit = "W" }
"#;

pub(crate) struct Bench {
    pub(crate) folder: TempDir,
}

impl Bench {
    pub(crate) fn new(study: &str) -> Self {
        let folder = TempDir::new().expect("a temporary folder");
        fs::write(folder.path().join("study.toml"), study).expect("writable");
        Self { folder }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn command(&self, line: &str) -> Command {
        let mut command = Command::new(PROGRAM);
        command.current_dir(self.folder.path()).args(line.split_whitespace()).args(["--progress", "none"]);
        command
    }

    pub(crate) fn run(&self, line: &str) {
        self.command(line).assert().success();
    }

    /// Standard error of a command that is refused with exit code 2.
    pub(crate) fn refused(&self, line: &str) -> String {
        self.said(line, 2)
    }

    /// Standard error of a command with an exit code.
    pub(crate) fn said(&self, line: &str, code: i32) -> String {
        crate::bench::stderr(&self.command(line).assert().code(code))
    }

    pub(crate) fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&fs::read(self.path(name)).expect(name)).expect(name)
    }
}

/// All files of a set but the times, which differ from run to run.
pub(crate) fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(&next).expect("a folder") {
            let path = entry.expect("an entry").path();
            let name = path.strip_prefix(folder).expect("below").to_string_lossy().replace('\\', "/");
            if path.is_dir() {
                folders.push(path);
            } else if !name.starts_with("costs/") && name != "report.html" {
                found.insert(name, fs::read(&path).expect("readable"));
            }
        }
    }
    found
}

pub(crate) fn assert_same(a: &Path, b: &Path) {
    let (a, b) = (files(a), files(b));
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    for (name, content) in &a {
        assert!(b[name] == *content, "{name} differs");
    }
}
