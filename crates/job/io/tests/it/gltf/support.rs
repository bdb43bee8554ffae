//! Builds small glTF assets for tests: JSON, with the binary data in a data URI or a GLB chunk.

use base64::Engine as _;
use dunkelfeld_io::InputError;
use dunkelfeld_io::import::{ImportOptions, Imported, load_scene};
use serde_json::{Value, json};

/// A glTF asset under construction.
pub(crate) struct Asset {
    /// The JSON; tests change it at will.
    pub(crate) json: Value,
    /// The only buffer.
    pub(crate) data: Vec<u8>,
}

impl Asset {
    /// An asset without content; `rest` is merged into the JSON.
    pub(crate) fn new(rest: Value) -> Self {
        let mut json = json!({"asset": {"version": "2.0"}, "accessors": [], "bufferViews": []});
        if let (Value::Object(json), Value::Object(rest)) = (&mut json, rest) {
            json.extend(rest);
        }
        Self { json, data: Vec::new() }
    }

    /// An asset with one node "part" that shows one mesh of one primitive.
    pub(crate) fn with_primitive(make: impl FnOnce(&mut Self) -> Value) -> Self {
        let mut asset = Self::new(json!({"nodes": [{"name": "part", "mesh": 0}]}));
        let primitive = make(&mut asset);
        asset.json["meshes"] = json!([{"primitives": [primitive]}]);
        asset
    }

    /// Appends a buffer view and gives its index.
    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        self.data.resize(self.data.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.data.len(), "byteLength": bytes.len()});
        self.data.extend_from_slice(bytes);
        push(&mut self.json["bufferViews"], view)
    }

    /// Appends an accessor over raw bytes and gives its index.
    pub(crate) fn raw(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize, normalized: bool) -> usize {
        let view = self.view(bytes);
        let accessor = json!({"bufferView": view, "componentType": component, "type": kind, "count": count,
            "normalized": normalized});
        push(&mut self.json["accessors"], accessor)
    }

    /// Appends an accessor of float vectors.
    pub(crate) fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let kind = match N {
            1 => "SCALAR",
            2 => "VEC2",
            3 => "VEC3",
            4 => "VEC4",
            _ => "MAT4",
        };
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        self.raw(&bytes, 5126, kind, values.len(), false)
    }

    /// Appends an accessor of 16-bit indices.
    pub(crate) fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.raw(&bytes, 5123, "SCALAR", values.len(), false)
    }

    /// Appends a PNG and a texture of it; gives the texture's index.
    pub(crate) fn texture(&mut self, width: u32, texels: &[[u8; 4]]) -> usize {
        let height = texels.len() as u32 / width;
        let image = image::RgbaImage::from_raw(width, height, texels.concat()).expect("size");
        let mut png = std::io::Cursor::new(Vec::new());
        image.write_to(&mut png, image::ImageFormat::Png).expect("encode");
        let view = self.view(png.get_ref());
        let source = push(&mut self.json["images"], json!({"bufferView": view, "mimeType": "image/png"}));
        push(&mut self.json["textures"], json!({"source": source}))
    }

    fn complete(&self, uri: Option<String>) -> Value {
        let mut json = self.json.clone();
        if json.get("buffers").is_none() {
            let mut buffer = json!({"byteLength": self.data.len()});
            if let Some(uri) = uri {
                buffer["uri"] = uri.into();
            }
            json["buffers"] = json!([buffer]);
        }
        json
    }

    /// As JSON text with a data URI.
    pub(crate) fn gltf(&self) -> Vec<u8> {
        let data = base64::engine::general_purpose::STANDARD.encode(&self.data);
        let uri = format!("data:application/octet-stream;base64,{data}");
        serde_json::to_vec_pretty(&self.complete(Some(uri))).expect("JSON")
    }

    /// As GLB.
    pub(crate) fn glb(&self) -> Vec<u8> {
        let mut json = serde_json::to_vec(&self.complete(None)).expect("JSON");
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut data = self.data.clone();
        data.resize(data.len().next_multiple_of(4), 0);
        let length = 12 + 8 + json.len() + 8 + data.len();
        let word = |v: usize| (v as u32).to_le_bytes();
        let header = [*b"glTF", word(2), word(length), word(json.len()), *b"JSON"].concat();
        [header, json, [word(data.len()), *b"BIN\0"].concat(), data].concat()
    }

    /// Reads the asset back.
    pub(crate) fn load(&self) -> Result<Imported, InputError> {
        load_bytes(&self.gltf(), "asset.gltf", &ImportOptions::default())
    }
}

/// Writes bytes to a file and reads it as a scene.
pub(crate) fn load_bytes(bytes: &[u8], name: &str, options: &ImportOptions) -> Result<Imported, InputError> {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("write");
    load_scene(&path, options)
}

/// Is there a warning that contains all of `words`?
pub(crate) fn warns(imported: &Imported, words: &[&str]) -> bool {
    imported.warnings.iter().any(|w| words.iter().all(|word| w.to_string().contains(word)))
}

/// A unit square in the xy-plane as a strip of four vertices: (0,0), (1,0), (0,1), (1,1).
pub(crate) const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];

fn push(list: &mut Value, value: Value) -> usize {
    if list.is_null() {
        *list = json!([]);
    }
    let list = list.as_array_mut().expect("an array");
    list.push(value);
    list.len() - 1
}
