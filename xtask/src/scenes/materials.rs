//! The materials, as glTF JSON.

use serde_json::{Value, json};

/// An opaque dielectric.
pub(crate) fn dielectric(name: &str, [r, g, b]: [f64; 3], roughness: f64) -> Value {
    json!({
        "name": name,
        "pbrMetallicRoughness": { "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": roughness },
    })
}

/// Aluminium with a blasted or brushed surface.
pub(crate) fn aluminium(name: &str, roughness: f64) -> Value {
    json!({
        "name": name,
        "pbrMetallicRoughness": { "baseColorFactor": [0.91, 0.92, 0.92, 1.0], "metallicFactor": 1.0, "roughnessFactor": roughness },
    })
}

/// Clear PMMA: index 1.49 as in the paper; a metre of it passes about nine tenths of the light.
pub(crate) fn pmma() -> Value {
    json!({
        "name": "pmma",
        "pbrMetallicRoughness": { "baseColorFactor": [1.0, 1.0, 1.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.0 },
        "extensions": {
            "KHR_materials_transmission": { "transmissionFactor": 1.0 },
            "KHR_materials_ior": { "ior": 1.49 },
            "KHR_materials_volume": {
                "thicknessFactor": 0.004,
                "attenuationDistance": 1.0,
                "attenuationColor": [0.88, 0.9, 0.9],
            },
        },
    })
}

/// Ink that covers a share of the surface at random: stochastic coverage.
pub(crate) fn ink(name: &str, [r, g, b]: [f64; 3], coverage: f64) -> Value {
    json!({
        "name": format!("ink-{name}"),
        "alphaMode": "BLEND",
        "doubleSided": true,
        "pbrMetallicRoughness": { "baseColorFactor": [r, g, b, coverage], "metallicFactor": 0.0, "roughnessFactor": 0.5 },
    })
}

/// An area light that emits `nits` \[cd/m^2\] on its front and reflects nothing.
pub(crate) fn emitter(name: &str, nits: f64) -> Value {
    json!({
        "name": name,
        "emissiveFactor": [1.0, 1.0, 1.0],
        "pbrMetallicRoughness": { "baseColorFactor": [0.0, 0.0, 0.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0 },
        "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": nits } },
    })
}
