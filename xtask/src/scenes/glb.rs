//! A small writer of binary glTF 2.0: nodes, shared geometry, raw material JSON, one buffer.

use glam::{DQuat, DVec3};
use serde_json::{Value, json};

use super::mesh::Mesh;

/// A scene while it is put together; `Document::finish` turns it into the bytes of a `.glb`.
#[derive(Default)]
pub(crate) struct Document {
    nodes: Vec<Node>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    cameras: Vec<Value>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    bytes: Vec<u8>,
    extensions: Vec<&'static str>,
    triangles: Vec<usize>,
}

/// A node: where it stands and what it holds.
#[derive(Clone, Default)]
pub(crate) struct Node {
    name: String,
    translation: DVec3,
    rotation: Option<DQuat>,
    mesh: Option<usize>,
    camera: Option<usize>,
    children: Vec<usize>,
}

/// The accessors of a mesh in the buffer, for any number of meshes with different materials.
#[derive(Clone, Copy)]
pub(crate) struct Geometry {
    position: usize,
    normal: usize,
    indices: usize,
    triangles: usize,
}

impl Node {
    /// A node at its parent's origin.
    pub(crate) fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), ..Self::default() }
    }

    /// Moves the node \[m\].
    pub(crate) fn at(mut self, x: f64, y: f64, z: f64) -> Self {
        self.translation = DVec3::new(x, y, z);
        self
    }

    /// Turns the node about its origin.
    pub(crate) fn turned(mut self, rotation: DQuat) -> Self {
        self.rotation = Some(rotation);
        self
    }

    /// Shows a mesh.
    pub(crate) fn with(mut self, mesh: usize) -> Self {
        self.mesh = Some(mesh);
        self
    }
}

impl Document {
    /// Appends a node under `parent` (or as a root of the scene) and returns its index.
    pub(crate) fn node(&mut self, parent: Option<usize>, node: Node) -> usize {
        let index = self.nodes.len();
        self.nodes.push(node);
        if let Some(parent) = parent {
            self.nodes[parent].children.push(index);
        }
        index
    }

    /// Appends a material given as glTF JSON and returns its index.
    pub(crate) fn material(&mut self, material: Value) -> usize {
        self.materials.push(material);
        self.materials.len() - 1
    }

    /// Names an extension that the file uses.
    pub(crate) fn uses(&mut self, extension: &'static str) {
        if !self.extensions.contains(&extension) {
            self.extensions.push(extension);
        }
    }

    /// Appends a perspective camera to a node; `yfov` is the full vertical angle \[rad\], the image is square.
    pub(crate) fn camera(&mut self, node: usize, name: &str, yfov: f64) {
        self.cameras.push(json!({
            "name": name,
            "type": "perspective",
            "perspective": { "aspectRatio": 1.0, "yfov": tidy(yfov), "znear": 0.001 },
        }));
        self.nodes[node].camera = Some(self.cameras.len() - 1);
    }

    /// Stores a mesh's numbers once.
    pub(crate) fn geometry(&mut self, mesh: &Mesh) -> Geometry {
        let triples = |values: &[DVec3]| -> Vec<[f32; 3]> {
            values.iter().map(|v| v.to_array().map(|c| tidy(c) as f32)).collect()
        };
        let positions = triples(&mesh.positions);
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for p in &positions {
            for axis in 0..3 {
                low[axis] = low[axis].min(p[axis]);
                high[axis] = high[axis].max(p[axis]);
            }
        }
        let position = self.vectors(&positions);
        self.accessors[position]["min"] = json!(low);
        self.accessors[position]["max"] = json!(high);
        let normal = self.vectors(&triples(&mesh.normals));
        let corners = mesh.triangles.as_flattened();
        // 65 535 itself is the restart index, so the largest usable 16-bit index is one less.
        let (kind, indices): (u32, Vec<u8>) = if mesh.positions.len() < 65_536 {
            let narrow = corners.iter().flat_map(|i| (*i as u16).to_le_bytes());
            (5123, narrow.collect())
        } else {
            (5125, corners.iter().flat_map(|i| i.to_le_bytes()).collect())
        };
        let view = self.view(&indices, 34963);
        let indices = self.accessor(view, kind, corners.len(), "SCALAR");
        Geometry { position, normal, indices, triangles: mesh.triangles.len() }
    }

    /// Appends a mesh: stored geometry seen with a material.
    pub(crate) fn mesh(&mut self, name: &str, geometry: Geometry, material: usize) -> usize {
        self.meshes.push(json!({
            "name": name,
            "primitives": [{
                "attributes": { "POSITION": geometry.position, "NORMAL": geometry.normal },
                "indices": geometry.indices,
                "material": material,
            }],
        }));
        self.triangles.push(geometry.triangles);
        self.meshes.len() - 1
    }

    /// Triangles of the scene as seen, each instance counted.
    pub(crate) fn triangles(&self) -> usize {
        let seen = self.nodes.iter().filter_map(|n| n.mesh);
        seen.map(|mesh| self.triangles[mesh]).sum()
    }

    /// The file: header, JSON chunk with sorted keys, binary chunk.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        self.extensions.sort_unstable();
        let mut is_child = vec![false; self.nodes.len()];
        for child in self.nodes.iter().flat_map(|n| &n.children) {
            is_child[*child] = true;
        }
        let roots: Vec<usize> = (0..self.nodes.len()).filter(|i| !is_child[*i]).collect();
        let nodes: Vec<Value> = self.nodes.iter().map(Node::json).collect();
        let mut document = json!({
            "asset": { "version": "2.0", "generator": "cargo xtask scenes" },
            "scene": 0,
            "scenes": [{ "name": "inspection", "nodes": roots }],
            "nodes": nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "cameras": self.cameras,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{ "byteLength": self.bytes.len() }],
            "extensionsUsed": self.extensions,
        });
        // Key order must not depend on whether another crate turns on serde_json's `preserve_order`.
        document.sort_all_objects();
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');

        let mut file = Vec::new();
        let word = |file: &mut Vec<u8>, value: usize| {
            file.extend((value as u32).to_le_bytes());
        };
        file.extend(b"glTF");
        word(&mut file, 2);
        word(&mut file, 12 + 8 + text.len() + 8 + self.bytes.len());
        word(&mut file, text.len());
        file.extend(b"JSON");
        file.extend(text);
        word(&mut file, self.bytes.len());
        file.extend(b"BIN\0");
        file.extend(self.bytes);
        file
    }

    fn vectors(&mut self, values: &[[f32; 3]]) -> usize {
        let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|c| c.to_le_bytes()).collect();
        let view = self.view(&bytes, 34962);
        self.accessor(view, 5126, values.len(), "VEC3")
    }

    fn view(&mut self, bytes: &[u8], target: u32) -> usize {
        self.views.push(json!({
            "buffer": 0,
            "byteOffset": self.bytes.len(),
            "byteLength": bytes.len(),
            "target": target,
        }));
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.len() - 1
    }

    fn accessor(&mut self, view: usize, component: u32, count: usize, kind: &str) -> usize {
        self.accessors.push(json!({
            "bufferView": view,
            "componentType": component,
            "count": count,
            "type": kind,
        }));
        self.accessors.len() - 1
    }
}

impl Node {
    fn json(&self) -> Value {
        let mut node = json!({ "name": self.name });
        if self.translation != DVec3::ZERO {
            node["translation"] = json!(self.translation.to_array().map(tidy));
        }
        if let Some(rotation) = self.rotation {
            node["rotation"] = json!(rotation.to_array().map(tidy));
        }
        if let Some(mesh) = self.mesh {
            node["mesh"] = json!(mesh);
        }
        if let Some(camera) = self.camera {
            node["camera"] = json!(camera);
        }
        if !self.children.is_empty() {
            node["children"] = json!(self.children);
        }
        node
    }
}

/// Rounds to 1e-9 (a nanometre): hides the last bits in which mathematics libraries differ, and reads well in JSON.
fn tidy(value: f64) -> f64 {
    // Adding zero turns -0 into 0.
    (value * 1e9).round() / 1e9 + 0.0
}
