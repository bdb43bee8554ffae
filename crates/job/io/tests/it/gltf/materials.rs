//! glTF import: materials and their extensions, textures, lights and cameras.

use super::support::{Asset, SQUARE, load_bytes, warns};
use dunkelfeld_geometry::{DVec3, Vec2};
use dunkelfeld_io::import::{EmissiveUnit, ImportOptions, Imported, LUMENS_PER_WATT};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{
    AlphaMode, ColorEncoding, Filter, Material, Medium, Projection, PunctualKind, Surface, Texels, Wrap,
};
use serde_json::{Value, json};

/// A square with both sets of texture coordinates under material 0, two textures, and the material.
fn asset(material: Value) -> Asset {
    let mut a = Asset::with_primitive(|a| {
        let uv = a.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]);
        json!({"mode": 5, "material": 0,
            "attributes": {"POSITION": a.floats(&SQUARE), "TEXCOORD_0": uv, "TEXCOORD_1": uv}})
    });
    a.texture(1, &[[255, 0, 0, 255]]);
    a.texture(2, &[[0, 255, 0, 128], [0, 0, 255, 255]]);
    a.json["materials"] = json!([material]);
    a
}

fn only_material(imported: &Imported) -> &Material {
    assert_eq!(imported.scene.materials.len(), 1);
    &imported.scene.materials[0]
}

fn near(a: f32, b: f64) -> bool {
    (f64::from(a) - b).abs() <= 1e-6 * b.abs().max(1.0)
}

#[test]
fn an_empty_material_has_the_defaults_of_the_format() {
    let imported = asset(json!({})).load().expect("loads");
    let expected =
        Material { name: "material 0".into(), metallic: 1.0.into(), roughness: 1.0.into(), ..Material::default() };
    assert_eq!(*only_material(&imported), expected);
}

#[test]
fn metallic_roughness_with_all_textures() {
    let imported = asset(json!({
        "name": "steel",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.1, 0.2, 0.3, 0.4], "baseColorTexture": {"index": 0},
            "metallicFactor": 0.5, "roughnessFactor": 0.25, "metallicRoughnessTexture": {"index": 1, "texCoord": 1}
        },
        "emissiveFactor": [1, 0.5, 0], "emissiveTexture": {"index": 1},
        "alphaMode": "MASK", "alphaCutoff": 0.75, "doubleSided": true
    }))
    .load()
    .expect("loads");
    let m = only_material(&imported);
    assert_eq!(m.name, "steel");
    assert_eq!((m.base_color.factor, m.alpha.factor), (Rgb::new(0.1, 0.2, 0.3), 0.4));
    assert_eq!((m.metallic.factor, m.roughness.factor, m.double_sided), (0.5, 0.25, true));
    assert_eq!(m.alpha_mode, AlphaMode::Mask { cutoff: 0.75 });
    let base = m.base_color.texture.expect("texture");
    let (metallic, roughness) = (m.metallic.texture.expect("texture"), m.roughness.texture.expect("texture"));
    assert_eq!((base.encoding, base.uv_set), (ColorEncoding::Srgb, 0));
    assert_eq!((metallic.channel, roughness.channel), (2, 1));
    assert_eq!((metallic.encoding, metallic.uv_set), (ColorEncoding::Linear, 1));
    let emission = m.emission.texture.expect("texture");
    assert_eq!((emission.encoding, emission.image), (ColorEncoding::Srgb, metallic.image));
    assert_eq!(imported.scene.images.len(), 2, "each image is decoded once");
    let image = &imported.scene.images[metallic.image.0 as usize];
    assert_eq!((image.width, image.height), (2, 1));
    assert_eq!(*image.texels, Texels::Rgba8(vec![[0, 255, 0, 128], [0, 0, 255, 255]]));
}

#[test]
fn emission_is_in_nits_unless_set_otherwise() {
    let a = asset(json!({"emissiveFactor": [1, 0.5, 0],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 1366.0}}}));
    let of = |emissive_unit| {
        let options = ImportOptions::default().with_emissive_unit(emissive_unit);
        only_material(&load_bytes(&a.gltf(), "a.gltf", &options).expect("loads")).emission.factor.to_array()
    };
    let nit = of(EmissiveUnit::Nit);
    assert!(near(nit[0], 2.0) && near(nit[1], 1.0) && nit[2] == 0.0, "{nit:?}");
    assert_eq!(of(EmissiveUnit::WattPerSteradianSquareMetre), [1366.0, 683.0, 0.0]);
}

#[test]
fn textures_carry_sampler_and_transform() {
    let mut a = asset(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 0, "extensions":
        {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.3, "scale": [2, 3], "texCoord": 1}}}}}));
    a.json["samplers"] = json!([{"magFilter": 9728, "minFilter": 9987, "wrapS": 33071, "wrapT": 33648}]);
    a.json["textures"][0]["sampler"] = json!(0);
    let imported = a.load().expect("loads");
    let t = only_material(&imported).base_color.texture.expect("texture");
    assert_eq!((t.wrap, t.filter, t.uv_set), ([Wrap::Clamp, Wrap::Mirror], Filter::Nearest, 1));
    assert_eq!((t.transform.offset, t.transform.rotation), (Vec2::new(0.1, 0.2), 0.3));
    assert_eq!(t.transform.scale, Vec2::new(2.0, 3.0));
}

#[test]
fn textures_that_cannot_be_used_leave_the_factor_and_a_warning() {
    for (info, word) in [
        (json!({"index": 0, "texCoord": 2}), "coordinate set 2"),
        (json!({"index": 7}), "texture 7 does not exist"),
        (json!({"index": 2}), "image 9"),
        (json!({"index": 3}), "no image"),
        (json!({"index": 4}), "broken.png"),
        (json!({"index": 5}), "missing.png"),
        (json!({"index": 6}), "'..'"),
    ] {
        let mut a = asset(json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1],
            "baseColorTexture": info}}));
        let images = a.json["images"].as_array_mut().expect("array");
        images.push(json!({"name": "broken.png", "uri": "data:image/png;base64,iVBORw0KGgo="}));
        images.push(json!({"uri": "missing.png"}));
        images.push(json!({"uri": "../outside.png"}));
        let textures = a.json["textures"].as_array_mut().expect("array");
        textures.push(json!({"source": 9}));
        textures.push(json!({}));
        (2..5).for_each(|i| textures.push(json!({"source": i})));
        let imported = a.load().expect("loads");
        let m = only_material(&imported);
        assert!(m.base_color.texture.is_none() && m.base_color.factor == Rgb::splat(0.5));
        assert!(warns(&imported, &[word]), "{word}: {:?}", imported.warnings);
    }
}

#[test]
fn the_png_stands_in_for_a_ktx2_image() {
    let mut a = asset(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    a.json["extensionsUsed"] = json!(["KHR_texture_basisu"]);
    a.json["textures"][0]["extensions"] = json!({"KHR_texture_basisu": {"source": 1}});
    let imported = a.load().expect("loads");
    assert!(only_material(&imported).base_color.texture.is_some());
    assert!(warns(&imported, &["KHR_texture_basisu"]));
    a.json["extensionsRequired"] = json!(["KHR_texture_basisu"]);
    let e = a.load().expect_err("required");
    assert!(e.problem.contains("KHR_texture_basisu") && e.help.contains("PNG"), "{e}");
}

#[test]
fn glass_is_solid_where_it_is_thick() {
    let of = |volume: Value| {
        let a = asset(json!({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1,
            "transmissionTexture": {"index": 0}}, "KHR_materials_ior": {"ior": 1.49}, "KHR_materials_volume": volume}}));
        only_material(&a.load().expect("loads")).clone()
    };
    let thin = of(json!({"attenuationDistance": 1}));
    assert_eq!((thin.transmission.factor, thin.ior, thin.surface), (1.0, 1.49, Surface::Thin));
    assert_eq!(thin.transmission.texture.map(|t| t.channel), Some(0));
    let clear = of(json!({"thicknessFactor": 0.1}));
    assert!(matches!(clear.surface, Surface::Solid(v) if v.attenuation_distance == f32::INFINITY));
    let solid = of(json!({"thicknessFactor": 0.1, "attenuationDistance": 0.5, "attenuationColor": [1, 0.5, 0]}));
    let Surface::Solid(volume) = solid.surface else { panic!("a solid was expected: {solid:?}") };
    assert_eq!(volume.attenuation_distance, 0.5);
    let [r, g, b] = volume.attenuation_color.to_array();
    assert!(r == 1.0 && g == 0.5 && b > 0.0 && b < 1e-5);
}

#[test]
fn light_passes_diffusely_through_sheets_and_into_solids() {
    let of = |more: Value| {
        let mut extensions = json!({"KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.25,
            "diffuseTransmissionTexture": {"index": 0}, "diffuseTransmissionColorFactor": [1, 0.9, 0.5],
            "diffuseTransmissionColorTexture": {"index": 1}}});
        for (key, value) in more.as_object().expect("an object") {
            extensions[key] = value.clone();
        }
        only_material(&asset(json!({"extensions": extensions})).load().expect("loads")).clone()
    };
    let sheet = of(json!({}));
    assert_eq!((sheet.diffuse_transmission.share.factor, sheet.surface), (0.25, Surface::Thin));
    assert_eq!(sheet.diffuse_transmission.color.factor, Rgb::new(1.0, 0.9, 0.5));
    assert_eq!(sheet.diffuse_transmission.share.texture.map(|t| t.channel), Some(3));
    assert_eq!(sheet.diffuse_transmission.color.texture.map(|t| t.encoding), Some(ColorEncoding::Srgb));
    assert!(matches!(of(json!({"KHR_materials_volume": {"thicknessFactor": 1}})).surface, Surface::Solid(_)));
}

#[test]
fn attenuation_is_shared_out_between_scattering_and_absorption() {
    let of = |scatter: Value| {
        let a = asset(json!({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 0.01, "attenuationColor": [0.5, 0.5, 0.9]},
            "KHR_materials_volume_scatter": scatter}}));
        let imported = a.load().expect("loads");
        let Surface::Solid(volume) = only_material(&imported).surface else { panic!("a solid was expected") };
        (Medium::new(&volume), volume.scattering_anisotropy)
    };
    let extinction = 100.0 * std::f32::consts::LN_2;
    for key in ["multiscatterColor", "scatterAlbedo"] {
        let (medium, g) = of(json!({key: [0, 1, 0.5], "scatterAnisotropy": 0.3}));
        assert_eq!(g, 0.3);
        assert!(medium.scattering.r == 0.0 && (medium.absorption.r / extinction - 1.0).abs() < 1e-6, "{medium:?}");
        assert!(medium.absorption.g == 0.0 && (medium.scattering.g / extinction - 1.0).abs() < 1e-6, "{medium:?}");
        // By hand: s = 4.09712 + 2.104315 - sqrt(9.59217 + 20.8404 + 4.42815) = 0.297138.
        let (albedo, total) = (medium.albedo().b, -(0.9f32.ln()) * 100.0);
        assert!((albedo - (1.0 - 0.297_138f32.powi(2))).abs() < 1e-5, "{albedo}");
        assert!((medium.extinction().b / total - 1.0).abs() < 1e-5);
    }
    let (medium, g) = of(json!({}));
    assert!(!medium.scatters() && g == 0.0);
}

#[test]
fn layers_and_dielectric_extensions() {
    let imported = asset(json!({"extensions": {
        "KHR_materials_specular": {"specularFactor": 0.5, "specularTexture": {"index": 0},
            "specularColorFactor": [2, 1, 0], "specularColorTexture": {"index": 1}},
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.6, "clearcoatTexture": {"index": 0},
            "clearcoatRoughnessFactor": 0.7, "clearcoatRoughnessTexture": {"index": 1}},
        "KHR_materials_sheen": {"sheenColorFactor": [0.1, 0.2, 0.3], "sheenColorTexture": {"index": 0},
            "sheenRoughnessFactor": 0.8},
        "KHR_materials_anisotropy": {"anisotropyStrength": 0.9, "anisotropyRotation": 1.5,
            "anisotropyTexture": {"index": 1}},
        "KHR_materials_unlit": {}
    }}))
    .load()
    .expect("loads");
    let m = only_material(&imported);
    assert_eq!((m.specular.strength.factor, m.specular.strength.texture.map(|t| t.channel)), (0.5, Some(3)));
    assert_eq!(m.specular.color.factor, Rgb::new(2.0, 1.0, 0.0));
    assert_eq!(m.specular.color.texture.map(|t| t.encoding), Some(ColorEncoding::Srgb));
    assert_eq!((m.clearcoat.strength.factor, m.clearcoat.strength.texture.map(|t| t.channel)), (0.6, Some(0)));
    assert_eq!((m.clearcoat.roughness.factor, m.clearcoat.roughness.texture.map(|t| t.channel)), (0.7, Some(1)));
    assert_eq!((m.sheen.color.factor, m.sheen.roughness), (Rgb::new(0.1, 0.2, 0.3), 0.8));
    assert_eq!(m.sheen.color.texture.map(|t| t.encoding), Some(ColorEncoding::Srgb));
    assert_eq!((m.anisotropy.strength.factor, m.anisotropy.rotation, m.unlit), (0.9, 1.5, true));
    assert_eq!(m.anisotropy.strength.texture.map(|t| t.encoding), Some(ColorEncoding::Linear));
    assert_eq!(imported.scene.meshes[0].mesh.tangents.len(), 6, "anisotropy needs tangents");
    let said: Vec<&str> = imported.warnings.iter().map(|w| w.message.as_str()).collect();
    assert_eq!(said, ["it has no TANGENT; its anisotropy takes its direction from TEXCOORD_0"]);
}

#[test]
fn factors_out_of_range_are_clamped_with_a_warning() {
    let imported = asset(json!({"alphaMode": "FOO",
        "pbrMetallicRoughness": {"baseColorFactor": [2, 0, -1, 3], "roughnessFactor": -0.5},
        "extensions": {"KHR_materials_ior": {"ior": 0.5}}}))
    .load()
    .expect("loads");
    let m = only_material(&imported);
    assert_eq!(
        (m.base_color.factor, m.alpha.factor, m.roughness.factor, m.ior),
        (Rgb::new(1.0, 0.0, 0.0), 1.0, 0.0, 1.0)
    );
    for word in ["baseColorFactor 2", "baseColorFactor -1", "roughnessFactor", "ior", "alpha mode"] {
        assert!(warns(&imported, &[word]), "{word}: {:?}", imported.warnings);
    }
}

#[test]
fn lights_become_radiometric() {
    let lights = json!([
        {"type": "point", "name": "bulb", "intensity": 683, "color": [1, 0.5, 0]},
        {"type": "directional", "intensity": 1366, "range": 3},
        {"type": "spot", "intensity": 683, "spot": {"innerConeAngle": 0.25, "outerConeAngle": 0.5}},
        {"type": "spot", "spot": {"innerConeAngle": 0.6, "outerConeAngle": 0.5}},
        {"type": "laser"},
        {"type": "point", "intensity": -1}
    ]);
    let node = |i: usize| json!({"translation": [i, 0, 0], "extensions": {"KHR_lights_punctual": {"light": i}}});
    let nodes: Vec<_> = (0..7).map(node).collect();
    let a = Asset::new(json!({"nodes": nodes, "extensions": {"KHR_lights_punctual": {"lights": lights}}}));
    let imported = a.load().expect("loads");
    let lights = &imported.scene.lights;
    assert_eq!(lights.len(), 4);
    assert_eq!((lights[0].name.as_str(), lights[1].name.as_str()), ("bulb", "light 1"));
    assert_eq!(lights[1].to_world.translation, DVec3::X);
    let PunctualKind::Point { intensity } = lights[0].kind else { panic!("{:?}", lights[0]) };
    assert!((intensity - Rgb::new(1.0, 0.5, 0.0)).to_array().iter().all(|v| v.abs() < 1e-6));
    let PunctualKind::Directional { irradiance } = lights[1].kind else { panic!("{:?}", lights[1]) };
    assert!(near(irradiance.to_array()[0], 1366.0 / f64::from(LUMENS_PER_WATT)));
    assert!(matches!(lights[2].kind, PunctualKind::Spot { inner: 0.25, outer: 0.5, .. }));
    assert!(matches!(lights[3].kind, PunctualKind::Spot { inner: 0.5, outer: 0.5, .. }));
    for word in ["range", "innerConeAngle", "its type does not exist", "negative", "light 6 does not exist"] {
        assert!(warns(&imported, &[word]), "{word}: {:?}", imported.warnings);
    }
}

#[test]
fn cameras_of_both_kinds() {
    let cameras = json!([
        {"type": "perspective", "name": "lens", "perspective": {"yfov": 0.7, "aspectRatio": 1.5, "znear": 0.1}},
        {"type": "orthographic", "orthographic": {"xmag": 2, "ymag": -1, "znear": 0.1, "zfar": 9}},
        {"type": "perspective", "perspective": {"yfov": 4, "znear": 0.1}},
        {"type": "perspective"}
    ]);
    let nodes = json!([{"name": "left", "camera": 0, "translation": [1, 2, 3]}, {"camera": 0}, {"camera": 1},
        {"camera": 2}, {"camera": 3}, {"camera": 4}]);
    let imported = Asset::new(json!({"cameras": cameras, "nodes": nodes})).load().expect("loads");
    let cameras = &imported.scene.cameras;
    let names: Vec<_> = cameras.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["left", "lens", "camera 1"]);
    assert_eq!((cameras[0].projection, cameras[0].aspect), (Projection::Perspective { vertical_fov: 0.7 }, Some(1.5)));
    assert_eq!(cameras[0].to_world.translation, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(cameras[2].projection, Projection::Orthographic { half_width: 2.0, half_height: 1.0 });
    assert_eq!(cameras[2].aspect, Some(2.0));
    assert!(warns(&imported, &["camera 2", "field of view"]) && warns(&imported, &["camera 4 does not exist"]));
}

#[test]
fn extensions_that_are_not_supported_are_named() {
    let mut a = asset(json!({}));
    a.json["extensionsUsed"] = json!(["KHR_materials_iridescence", "KHR_materials_volume", "ACME_thing"]);
    let imported = a.load().expect("loads");
    assert!(warns(&imported, &["KHR_materials_iridescence"]) && warns(&imported, &["ACME_thing"]));
    assert!(!warns(&imported, &["KHR_materials_volume"]));
    // The typed crates refuse these although they support them; they must load.
    a.json["extensionsRequired"] = json!(["KHR_materials_volume", "KHR_materials_specular", "KHR_materials_variants"]);
    a.load().expect("required and supported");
    for (name, word) in [("KHR_draco_mesh_compression", "Draco"), ("EXT_meshopt_compression", "meshopt"), ("ACME", "")]
    {
        a.json["extensionsRequired"] = json!([name]);
        let e = a.load().expect_err("required and not supported");
        assert!(e.problem.contains(name) && e.help.contains(word), "{e}");
    }
}
