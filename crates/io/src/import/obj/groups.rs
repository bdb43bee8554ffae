//! The present objects, groups, materials and smoothing groups during the reading of an OBJ file.
//!
//! `tobj` treats `o` and `g` alike, has no smoothing groups, and discards the names of materials that no library
//! defines. So these statements are stored separately.

use super::text;
use std::collections::HashMap;

/// The names of a file and the present ones.
#[derive(Debug)]
pub(super) struct Groups {
    /// Names of objects and groups; the first is that of faces before any name.
    pub objects: Vec<String>,
    /// Material names in order of first use, as written; the first, empty one is "none".
    pub materials: Vec<String>,
    /// Material libraries and their lines, as written.
    pub libraries: Vec<(u32, String)>,
    /// Index into `objects`.
    pub object: u32,
    /// Index into `materials`.
    pub material: u32,
    /// Smoothing group; 0 is off.
    pub smoothing: u32,
    object_ids: HashMap<String, u32>,
    material_ids: HashMap<String, u32>,
    o: String,
    g: String,
}

impl Groups {
    /// The state before the first statement.
    pub(super) fn new() -> Self {
        let unnamed = || HashMap::from([(String::new(), 0)]);
        Self {
            objects: vec![String::new()],
            materials: vec![String::new()],
            libraries: Vec::new(),
            object: 0,
            material: 0,
            smoothing: 0,
            object_ids: unnamed(),
            material_ids: unnamed(),
            o: String::new(),
            g: String::new(),
        }
    }

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
            "s" => self.smoothing = smoothing_group(data),
            // Names may contain spaces and even '#'. The search for the name handles these.
            "usemtl" => self.material = intern(&mut self.material_ids, &mut self.materials, rest),
            "mtllib" => self.libraries.push((line, rest.to_string())),
            _ => return false,
        }
        true
    }

    /// `o` begins an object. A `g` in it with another name is a separate object.
    fn name_object(&mut self) {
        let name = match (self.o.as_str(), self.g.as_str()) {
            (o, "" | "default") => o.to_string(),
            ("", g) => g.to_string(),
            (o, g) if o == g => g.to_string(),
            (o, g) => format!("{o}/{g}"),
        };
        self.object = intern(&mut self.object_ids, &mut self.objects, &name);
    }
}

fn smoothing_group(data: &str) -> u32 {
    match data.split_whitespace().next().unwrap_or("off") {
        "on" => 1,
        word => word.parse().unwrap_or(0),
    }
}

fn intern(ids: &mut HashMap<String, u32>, names: &mut Vec<String>, name: &str) -> u32 {
    if let Some(id) = ids.get(name) {
        return *id;
    }
    let id = names.len() as u32;
    names.push(name.to_string());
    ids.insert(name.to_string(), id);
    id
}
