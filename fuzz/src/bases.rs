//! Small valid glTF assets that mutations begin with: together they use everything that the reader reads.

use serde_json::{Value, json};

/// An asset with one buffer, whose `uri` is an argument.
#[derive(Clone, Debug)]
pub struct Asset {
    /// The document.
    pub json: Value,
    /// The buffer.
    pub buffer: Vec<u8>,
}

/// How an asset is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Container {
    /// One binary file.
    Glb,
    /// JSON with the buffer in a file beside it, which has this name.
    WithFile(&'static str),
}

/// Names of keys and values of the format, for mutations.
pub const WORDS: &[&str] = &[
    "SCALAR",
    "VEC2",
    "VEC3",
    "VEC4",
    "MAT2",
    "MAT3",
    "MAT4",
    "POSITION",
    "NORMAL",
    "TANGENT",
    "TEXCOORD_0",
    "TEXCOORD_1",
    "TEXCOORD_9",
    "COLOR_0",
    "COLOR_1",
    "JOINTS_0",
    "JOINTS_1",
    "WEIGHTS_0",
    "WEIGHTS_1",
    "indices",
    "targets",
    "weights",
    "mode",
    "sparse",
    "byteOffset",
    "byteStride",
    "byteLength",
    "bufferView",
    "count",
    "normalized",
    "componentType",
    "matrix",
    "translation",
    "rotation",
    "scale",
    "children",
    "mesh",
    "skin",
    "camera",
    "inverseBindMatrices",
    "perspective",
    "orthographic",
    "point",
    "spot",
    "directional",
    "OPAQUE",
    "MASK",
    "BLEND",
    "uri",
    "data:,",
    "data:;base64,AAAA",
    "scene.bin",
    "%",
    "..",
    "extensions",
    "KHR_texture_transform",
    "EXT_mesh_gpu_instancing",
    "TRANSLATION",
    "ROTATION",
    "SCALE",
    "KHR_node_visibility",
    "visible",
    "KHR_materials_unlit",
    "extensionsRequired",
    "texCoord",
    "name",
    "2.0",
];

const EXTENSIONS: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_materials_volume_scatter",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

const BYTE: u32 = 5121;
const SHORT: u32 = 5122;
const UNSIGNED_SHORT: u32 = 5123;
const FLOAT: u32 = 5126;

/// The assets: a textured plate, a deformed mesh, solids of every material, instances and other primitives.
pub fn assets() -> Vec<Asset> {
    vec![plate(), deformed(), solids(), placed()]
}

impl Asset {
    /// Names the buffer, sets its length, and gives the bytes of the scene file; those of a buffer beside it are
    /// `buffer`.
    pub fn encode(&self, container: Container) -> Vec<u8> {
        let mut json = self.json.clone();
        if let (Container::WithFile(name), Some(Value::Object(buffer))) = (container, json.pointer_mut("/buffers/0")) {
            buffer.insert("uri".into(), name.into());
        }
        let mut text = json.to_string().into_bytes();
        if container != Container::Glb {
            return text;
        }
        let mut binary = self.buffer.clone();
        text.resize(text.len().next_multiple_of(4), b' ');
        binary.resize(binary.len().next_multiple_of(4), 0);
        let mut file = b"glTF".to_vec();
        let total = 12 + 8 + text.len() + 8 + binary.len();
        for word in [2, total as u32, text.len() as u32, u32::from_le_bytes(*b"JSON")] {
            file.extend(word.to_le_bytes());
        }
        file.extend(text);
        for word in [binary.len() as u32, u32::from_le_bytes(*b"BIN\0")] {
            file.extend(word.to_le_bytes());
        }
        file.extend(binary);
        file
    }
}

/// Puts an asset together.
#[derive(Default)]
struct Maker {
    buffer: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Maker {
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.buffer.resize(self.buffer.len().next_multiple_of(4), 0);
        self.views.push(json!({"buffer": 0, "byteOffset": self.buffer.len(), "byteLength": bytes.len()}));
        self.buffer.extend(bytes);
        self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.numbers(kind, FLOAT, &bytes, values.len())
    }

    fn shorts(&mut self, kind: &str, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.numbers(kind, UNSIGNED_SHORT, &bytes, values.len())
    }

    fn numbers(&mut self, kind: &str, component: u32, bytes: &[u8], values: usize) -> usize {
        let view = self.view(bytes);
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "MAT4" => 16,
            _ => 4,
        };
        self.accessor(json!({"bufferView": view, "componentType": component, "count": values / width, "type": kind}))
    }

    fn finish(self, mut json: Value) -> Asset {
        json["asset"] = json!({"version": "2.0"});
        json["extensionsUsed"] = json!(EXTENSIONS);
        json["scene"] = json!(0);
        json["buffers"] = json!([{"byteLength": self.buffer.len()}]);
        json["bufferViews"] = self.views.into();
        json["accessors"] = self.accessors.into();
        Asset { json, buffer: self.buffer }
    }
}

const SQUARE: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0];
const SQUARE_INDICES: [u16; 6] = [0, 1, 2, 0, 2, 3];

/// PNG of 1 x 1 texels.
const PNG: &[u8] = &[
    0x89, b'P', b'N', b'G', 0x0d, 0x0a, 0x1a, 0x0a, 0, 0, 0, 13, b'I', b'H', b'D', b'R', 0, 0, 0, 1, 0, 0, 0, 1, 8, 2,
    0, 0, 0, 0x90, 0x77, 0x53, 0xde, 0, 0, 0, 12, b'I', b'D', b'A', b'T', 0x08, 0xd7, 0x63, 0xf8, 0xcf, 0xc0, 0, 0, 3,
    1, 1, 0, 0x18, 0xdd, 0x8d, 0xb0, 0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82,
];

/// A square with all attributes, textures, lights and both kinds of cameras.
fn plate() -> Asset {
    let mut m = Maker::default();
    let position = m.floats("VEC3", &SQUARE);
    let normal = m.floats("VEC3", &[0.0, 0.0, 1.0].repeat(4));
    let tangent = m.floats("VEC4", &[1.0, 0.0, 0.0, 1.0].repeat(4));
    let uv = m.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
    let second = m.shorts("VEC2", &[0, 0, 65535, 0, 65535, 65535, 0, 65535]);
    m.accessors[second]["normalized"] = json!(true);
    let color = m.numbers("VEC4", BYTE, &[255, 128, 0, 255].repeat(4), 16);
    m.accessors[color]["normalized"] = json!(true);
    let indices = m.shorts("SCALAR", &SQUARE_INDICES);
    let image = m.view(PNG);
    let transform = json!({"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.3, "scale": [2, -2]}});
    let texture = json!({"index": 0, "texCoord": 1, "extensions": transform});
    let attributes = json!({"POSITION": position, "NORMAL": normal, "TANGENT": tangent, "TEXCOORD_0": uv,
        "TEXCOORD_1": second, "COLOR_0": color});
    m.finish(json!({
        "scenes": [{"nodes": [0, 1, 2, 3, 4, 5]}],
        "nodes": [
            {"mesh": 0, "name": "plate", "children": [6]},
            {"camera": 0, "translation": [0, 0, 3]},
            {"camera": 1, "rotation": [0, 0.7071, 0, 0.7071]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 2, 2]},
            {"extensions": {"KHR_lights_punctual": {"light": 1}}},
            {"mesh": 0, "matrix": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 1, 1, 1, 1]}
        ],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
        "cameras": [
            {"type": "perspective", "perspective": {"yfov": 0.7, "aspectRatio": 1.5, "znear": 0.1}},
            {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0.1, "zfar": 9}}
        ],
        "materials": [{
            "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.7, 0.6, 0.5], "baseColorTexture": texture,
                "metallicFactor": 0.5, "roughnessFactor": 0.4, "metallicRoughnessTexture": {"index": 0}},
            "normalTexture": {"index": 0, "scale": 0.5}, "emissiveTexture": {"index": 0},
            "emissiveFactor": [1, 0.5, 0.2], "alphaMode": "MASK", "alphaCutoff": 0.4, "doubleSided": true,
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 1000}}
        }],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"magFilter": 9728, "wrapS": 33071, "wrapT": 33648}],
        "images": [{"bufferView": image, "mimeType": "image/png"}],
        "extensions": {
            "KHR_lights_punctual": {"lights": [
                {"type": "spot", "color": [1, 1, 0], "intensity": 100, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.5}},
                {"type": "directional", "intensity": 10}
            ]}
        }
    }))
}

/// Sparse and quantised accessors, morph targets, a skin, an animation.
fn deformed() -> Asset {
    let mut m = Maker::default();
    let base = m.floats("VEC3", &SQUARE);
    let at = m.view(&[1, 0, 3, 0]);
    let values: Vec<u8> = [1.0f32, 0.5, 0.5, 0.0, 1.0, 0.5].iter().flat_map(|v| v.to_le_bytes()).collect();
    let values = m.view(&values);
    m.accessors[base]["sparse"] = json!({"count": 2, "indices": {"bufferView": at, "componentType": UNSIGNED_SHORT},
        "values": {"bufferView": values}});
    let target = m.accessor(json!({"componentType": FLOAT, "count": 4, "type": "VEC3", "sparse": {"count": 2,
        "indices": {"bufferView": at, "componentType": UNSIGNED_SHORT}, "values": {"bufferView": values}}}));
    let shorts: Vec<u8> = [0i16, 0, 32767, 0].repeat(4).iter().flat_map(|v| v.to_le_bytes()).collect();
    let normal = m.numbers("VEC4", SHORT, &shorts, 16);
    m.accessors[normal]["type"] = json!("VEC3");
    m.accessors[normal]["normalized"] = json!(true);
    let view = m.accessors[normal]["bufferView"].as_u64().unwrap_or_default() as usize;
    m.views[view]["byteStride"] = json!(8);
    let joints = m.numbers("VEC4", BYTE, &[0, 1, 0, 0].repeat(4), 16);
    let weights = m.floats("VEC4", &[0.5, 0.5, 0.0, 0.0].repeat(4));
    let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let binds = m.floats("MAT4", &identity.repeat(2));
    let indices = m.numbers("SCALAR", BYTE, &[0, 1, 2, 0, 2, 3], 6);
    let times = m.floats("SCALAR", &[0.0, 1.0]);
    let moves = m.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    let attributes = json!({"POSITION": base, "NORMAL": normal, "JOINTS_0": joints, "WEIGHTS_0": weights});
    m.finish(json!({
        "scenes": [{"nodes": [0, 1, 3]}],
        "nodes": [
            {"mesh": 0, "skin": 0, "weights": [0.5, 0.25]},
            {"translation": [0, 0.1, 0], "children": [2]},
            {"rotation": [0, 0, 0.3826834, 0.9238795], "scale": [1, 2, 1]},
            {"mesh": 1, "scale": [-1, 1, 1]}
        ],
        "meshes": [
            {"primitives": [{"attributes": attributes, "indices": indices, "material": 0,
                "targets": [{"POSITION": target}, {"POSITION": target, "NORMAL": target}]}], "weights": [0.1, 0.2]},
            {"primitives": [{"attributes": {"POSITION": base, "NORMAL": normal}, "indices": indices, "targets": [{"NORMAL": target}]}],
                "weights": [1]}
        ],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": binds, "skeleton": 1}],
        "animations": [{"channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}],
            "samplers": [{"input": times, "output": moves, "interpolation": "LINEAR"}]}],
        "materials": [{"emissiveFactor": [1, 1, 1]}]
    }))
}

/// Closed cubes of every material, one in another.
fn solids() -> Asset {
    let mut m = Maker::default();
    let corners: Vec<f32> = (0..8).flat_map(|i| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|v| v as f32 - 0.5)).collect();
    let position = m.floats("VEC3", &corners);
    let faces =
        [0u16, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5];
    let indices = m.shorts("SCALAR", &faces);
    let cube = |material: u32| json!({"primitives": [{"attributes": {"POSITION": position}, "indices": indices, "material": material}]});
    m.finish(json!({
        "scenes": [{"nodes": [0, 1, 2, 3, 4, 5]}],
        "nodes": [
            {"mesh": 0}, {"mesh": 1, "scale": [0.5, 0.5, 0.5]}, {"mesh": 2, "translation": [1, 0, 0]},
            {"mesh": 3, "translation": [0, 0, 0.25]}, {"mesh": 4, "translation": [0, 3, 0]}, {"mesh": 5, "scale": [9, 9, 0.01]}
        ],
        "meshes": [cube(0), cube(1), cube(2), cube(3), cube(4), cube(5)],
        "materials": [
            {"pbrMetallicRoughness": {"roughnessFactor": 0}, "extensions": {
                "KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": 1.5},
                "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 0.5, "attenuationColor": [0.9, 0.5, 0.1]}}},
            {"extensions": {
                "KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": 1.33},
                "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [0.1, 0.5, 0.9]},
                "KHR_materials_volume_scatter": {"multiscatterColor": [0.9, 0.5, 0.2], "scatterAnisotropy": -0.5}}},
            {"extensions": {
                "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.5, "diffuseTransmissionColorFactor": [1, 0.5, 0]},
                "KHR_materials_sheen": {"sheenColorFactor": [0.5, 0.5, 1], "sheenRoughnessFactor": 0.5},
                "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [1, 2, 1]}}},
            {"pbrMetallicRoughness": {"metallicFactor": 1, "roughnessFactor": 0.3}, "extensions": {
                "KHR_materials_anisotropy": {"anisotropyStrength": 0.5, "anisotropyRotation": 1},
                "KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatRoughnessFactor": 0.1}}},
            {"emissiveFactor": [1, 1, 1]},
            {"pbrMetallicRoughness": {"roughnessFactor": 0}, "alphaMode": "BLEND",
                "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}}
        ]
    }))
}

/// Instances, strips, fans, meshes without indices, nodes that are not visible, a second scene.
fn placed() -> Asset {
    let mut m = Maker::default();
    let position = m.floats("VEC3", &SQUARE);
    let triangles = m.floats("VEC3", &[0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let strip = m.shorts("SCALAR", &[0, 1, 3, 2]);
    let translations = m.floats("VEC3", &[0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0, 0.0]);
    let rotations = m.floats("VEC4", &[0.0, 0.0, 0.0, 1.0].repeat(3));
    let scales = m.floats("VEC3", &[1.0, 1.0, 1.0, 0.5, 2.0, 1.0, -1.0, 1.0, 1.0]);
    m.finish(json!({
        "scenes": [{"nodes": [0, 1]}, {"nodes": [2]}],
        "nodes": [
            {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": translations,
                "ROTATION": rotations, "SCALE": scales}}}},
            {"mesh": 1, "children": [2, 3], "translation": [0, 0, 1]},
            {"mesh": 0, "extensions": {"KHR_node_visibility": {"visible": false}}},
            {"name": "light", "mesh": 2}
        ],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": position}, "indices": strip, "mode": 5},
                {"attributes": {"POSITION": position}, "mode": 6}]},
            {"primitives": [{"attributes": {"POSITION": triangles}}, {"attributes": {"POSITION": position}, "mode": 1}]},
            {"primitives": [{"attributes": {"POSITION": triangles}, "material": 0}]}
        ],
        "materials": [{"emissiveFactor": [1, 0.9, 0.8], "extensions": {"KHR_materials_unlit": {}}}]
    }))
}
