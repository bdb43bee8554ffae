//! The present objects, groups, materials and smoothing groups during the reading of an OBJ file.
//!
//! `tobj` treats `o` and `g` alike, has no smoothing groups, and discards the names of materials that no library
//! defines. So these statements are stored separately.

use super::text;
use std::collections::HashMap;

/// The names of a file and the present ones.
#[derive(Debug, Default)]
pub(super) struct Groups {
    /// Names of objects and groups; the first is that of faces before any name.
    pub objects: Names,
    /// Material names in order of first use; the first, empty one is "none".
    pub materials: Names,
    /// Material libraries and their lines, as written.
    pub libraries: Vec<(u32, String)>,
    /// Index into `objects`.
    pub object: u32,
    /// Index into `materials`.
    pub material: u32,
    /// Smoothing group; 0 is off.
    pub smoothing: u32,
    o: String,
    g: String,
}

/// Names in order of first use. The first one is empty.
#[derive(Debug)]
pub(super) struct Names {
    pub list: Vec<String>,
    ids: HashMap<String, u32>,
}

impl Default for Names {
    fn default() -> Self {
        Self { list: vec![String::new()], ids: HashMap::from([(String::new(), 0)]) }
    }
}

impl Names {
    fn id(&mut self, name: &str) -> u32 {
        if let Some(id) = self.ids.get(name) {
            return *id;
        }
        let id = self.list.len() as u32;
        self.list.push(name.to_string());
        self.ids.insert(name.to_string(), id);
        id
    }
}

impl Groups {
    /// Executes a statement. `false` if it does not set a name.
    pub(super) fn statement(&mut self, line: u32, key: &str, rest: &str) -> bool {
        let data = text::without_comment(rest);
        match key {
            "o" => {
                self.o = data.to_string();
                self.g.clear();
                self.name_object();
            }
            "g" => {
                self.g = data.split_whitespace().collect::<Vec<_>>().join(" ");
                self.name_object();
            }
            // `off` is 0.
            "s" if data == "on" => self.smoothing = 1,
            "s" => self.smoothing = data.parse().unwrap_or(0),
            // Names may contain spaces and `#`.
            "usemtl" => self.material = self.materials.id(rest),
            "mtllib" => self.libraries.push((line, data.to_string())),
            _ => return false,
        }
        true
    }

    /// `o` begins an object. A `g` in it with another name is a separate object.
    fn name_object(&mut self) {
        self.object = match (self.o.as_str(), self.g.as_str()) {
            (o, "" | "default") => self.objects.id(o),
            ("", g) => self.objects.id(g),
            (o, g) if o == g => self.objects.id(g),
            (o, g) => self.objects.id(&format!("{o}/{g}")),
        };
    }
}
