//! Shading frames: interpolated and mapped normals, tangents, coverage and colours, on meshes that are moved to render
//! space and on instances, mirrored or not. All expectations are closed forms.

use dunkelfeld_geometry::{DAffine3, DVec3, Frame, Mesh, Ray, Vec2, Vec3, Vec4};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::shapes::rectangle;
use dunkelfeld_scene::{
    AlphaMode, ColorEncoding, Filter, Image, ImageId, Material, NormalMap, Parameter, Scene, SceneBuilder,
    SurfacePoint, Texels, Texture, TextureTransform,
};

fn build(builder: SceneBuilder) -> Scene {
    builder.build().expect("the scene is valid").0
}

/// The hit of a ray straight down (or up) at world (x, y).
fn shade(scene: &Scene, x: f64, y: f64, down: bool) -> SurfacePoint {
    let z = if down { 5.0 } else { -5.0 };
    let origin = (DVec3::new(x, y, z) - scene.world_origin()).as_vec3();
    scene.intersect(&Ray::new(origin, if down { Vec3::NEG_Z } else { Vec3::Z })).expect("something is there")
}

/// Adds so many triangles that a mesh used twice is not copied. They are far below all other objects.
fn ballast(mesh: &mut Mesh) {
    for k in 0..9000 {
        let base = mesh.positions.len() as u32;
        let p = Vec3::new(0.0, 0.0, -1.0 - k as f32 * 1e-4);
        mesh.positions.extend([p, p + Vec3::X * 1e-4, p + Vec3::Y * 1e-4]);
        mesh.triangles.push([base, base + 1, base + 2]);
    }
    let n = mesh.positions.len();
    let longer = |uvs: &mut Vec<Vec2>| {
        if !uvs.is_empty() {
            uvs.resize(n, Vec2::ZERO);
        }
    };
    mesh.uvs.iter_mut().for_each(longer);
    if !mesh.normals.is_empty() {
        mesh.normals.resize(n, Vec3::Z);
    }
    if !mesh.tangents.is_empty() {
        mesh.tangents.resize(n, Vec4::new(1.0, 0.0, 0.0, 1.0));
    }
}

/// A scene with one object under a transform; as an instance if `instanced` is true, with a copy far away.
fn placed(mesh: Mesh, material: Material, images: Vec<Image>, to_world: DAffine3, instanced: bool) -> Scene {
    let mut b = SceneBuilder { images, ..SceneBuilder::default() };
    let m = b.add_material(material);
    let mut mesh = mesh;
    if instanced {
        ballast(&mut mesh);
    }
    b.add_object("object", mesh, m);
    b.instances[0].to_world = to_world;
    if instanced {
        let mut twin = b.instances[0].clone();
        twin.to_world = DAffine3::from_translation(DVec3::new(50.0, 0.0, 0.0));
        b.instances.push(twin);
    }
    let scene = build(b);
    assert_eq!(scene.summary().instanced_parts, if instanced { 2 } else { 0 });
    scene
}

/// A normal map with the same tangent-space normal everywhere.
fn flat_map(n: Vec3) -> Image {
    let [x, y, z] = n.to_array().map(|v| ((0.5 + 0.5 * v) * 65535.0).round() as u16);
    Image { name: "map".into(), width: 1, height: 1, texels: Texels::Rgba16(vec![[x, y, z, 65535]]).into() }
}

/// The frame of shading for a viewer in direction `wo`.
fn shading_frame(scene: &Scene, p: &SurfacePoint, wo: Vec3) -> Frame {
    scene.shade_lanes::<f32>(p.material(), &p.into(), wo.into()).frames.frame.into()
}

#[test]
fn a_normal_map_tilts_along_the_image() {
    // A square in the xy plane with u = su x and v = sv y. In a normal map red tilts to the image's right, where u
    // grows, and green to its top, where v shrinks (glTF: v points down). With the map's normal (a, b, c) the surface's
    // must be (su a, -sv b, c), also if the mesh has tangents (w = -su sv, so that w n x t points to the top).
    let tilt = Vec3::new(0.36, 0.48, 0.8);
    let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    for (su, sv) in [(1.0f32, -1.0f32), (1.0, 1.0), (-1.0, -1.0), (-1.0, 1.0)] {
        for (instanced, mirrored) in [(false, false), (false, true), (true, false), (true, true)] {
            let mut mesh = rectangle(Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y);
            mesh.uvs[0] = mesh.positions.iter().map(|p| Vec2::new(su * p.x, sv * p.y)).collect();
            mesh.tangents = vec![Vec4::new(su, 0.0, 0.0, -su * sv); 4];
            let texture = Texture::new(ImageId(0), ColorEncoding::Linear);
            let material =
                Material { normal_map: NormalMap { texture: Some(texture), scale: 1.0 }, ..Material::default() };
            let to_world = if mirrored { mirror } else { DAffine3::IDENTITY };
            let scene = placed(mesh, material, vec![flat_map(tilt)], to_world, instanced);
            // The mirror also mirrors the image.
            let sign = if mirrored { -1.0 } else { 1.0 };
            let expected = Vec3::new(sign * su * tilt.x, -sv * tilt.y, tilt.z);
            let what = format!("su {su}, sv {sv}, instanced {instanced}, mirrored {mirrored}");
            let hit = shade(&scene, 0.1, 0.2, true);
            assert!((hit.normal - Vec3::Z).length() < 1e-6, "{what}: the geometric normal stays");
            let frame = shading_frame(&scene, &hit, Vec3::Z);
            assert!((frame.normal - expected).length() < 1e-4, "{what}: {} should be {expected}", frame.normal);
            assert!((frame.tangent.cross(frame.bitangent) - frame.normal).length() < 1e-5, "{what}: right-handed");
            // From below, the same surface is turned over.
            let below = shading_frame(&scene, &shade(&scene, 0.1, 0.2, false), Vec3::NEG_Z);
            assert!((below.normal + expected).length() < 1e-4, "{what}: from below {}", below.normal);
            assert!((below.tangent.cross(below.bitangent) - below.normal).length() < 1e-5, "{what}: from below");
        }
    }
}

#[test]
fn smooth_normals_are_continuous_over_an_edge_and_follow_uneven_scales() {
    // A ridge along y: two slopes that meet at x = 0, with vertex normals (-+0.6, 0, 0.8) outside and +z on the crest.
    // Along x the interpolated normal is (0.6 x, 0, 1 - 0.2 |x|), normalised; under the scale (2, 1, 1) the inverse
    // transpose halves its x.
    let mesh = || Mesh {
        positions: [-1.0f32, 0.0, 1.0]
            .iter()
            .flat_map(|&x| [Vec3::new(x, -1.0, -0.3 * x.abs()), Vec3::new(x, 1.0, -0.3 * x.abs())])
            .collect(),
        triangles: vec![[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]],
        normals: [-0.6f32, -0.6, 0.0, 0.0, 0.6, 0.6].map(|x| Vec3::new(x, 0.0, (1.0 - x * x).sqrt())).to_vec(),
        ..Mesh::default()
    };
    for (instanced, scale) in [(false, 1.0), (true, 1.0), (false, 2.0), (true, 2.0), (false, -2.0), (true, -2.0)] {
        let to_world = DAffine3::from_scale(DVec3::new(scale, 1.0, 1.0));
        let scene = placed(mesh(), Material::default(), Vec::new(), to_world, instanced);
        for x in [-0.7f64, -0.3, -1e-4, 1e-4, 0.3, 0.7] {
            let hit = shade(&scene, x * scale, 0.37, true);
            let n = shading_frame(&scene, &hit, Vec3::Z).normal;
            let object = DVec3::new(0.6 * x, 0.0, 1.0 - 0.2 * x.abs());
            let expected = DVec3::new(object.x / scale, 0.0, object.z).normalize().as_vec3();
            assert!((n - expected).length() < 1e-5, "x {x}, scale {scale}, instanced {instanced}: {n}, not {expected}");
            assert!(hit.normal.z > 0.9, "fronts stay fronts under a mirror: {}", hit.normal);
        }
    }
}

#[test]
fn a_normal_that_faces_away_is_turned_until_the_viewer_is_above_it() {
    let mut mesh = rectangle(Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y);
    let tilted = Vec3::new(0.8, 0.0, 0.6);
    mesh.normals = vec![tilted; 4];
    let scene = placed(mesh, Material::default(), Vec::new(), DAffine3::IDENTITY, false);
    let hit = shade(&scene, 0.1, 0.2, true);
    let normal = |wo: Vec3| shading_frame(&scene, &hit, wo).normal;
    // -0.28 * 0.8 + 0.96 * 0.6 is above a fifth of 0.96.
    assert!((normal(Vec3::new(-0.28, 0.0, 0.96)) - tilted).length() < 1e-6);
    for degrees in [2.0f32, 15.0, 40.0] {
        for azimuth in [0.0f32, 0.5] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let wo = Vec3::new(-cos * azimuth.cos(), cos * azimuth.sin(), sin);
            // In the plane of both normals, between them, with a fifth of the cosine of the geometric one.
            let n = normal(wo);
            assert!((n.dot(wo) - 0.2 * wo.z).abs() < 1e-5 && n.y == 0.0 && n.x > 0.0 && n.z > 0.6, "{degrees}: {n}");
            // From behind, the same normal on the other side.
            assert!((normal(-wo) + n).length() < 1e-6, "{degrees}: from behind");
        }
    }
}

/// Four texels of different red, one of them with alpha 0.2, the others opaque.
fn quarters() -> Image {
    let texels = Texels::Rgba8(vec![[51, 0, 0, 255], [102, 0, 0, 51], [153, 0, 0, 255], [204, 0, 0, 255]]);
    Image { name: "quarters".into(), width: 2, height: 2, texels: texels.into() }
}

#[test]
fn coverage_comes_from_factor_texture_and_vertices() {
    let texture = Texture { filter: Filter::Nearest, ..Texture::new(ImageId(0), ColorEncoding::Srgb) };
    let alpha = Texture { encoding: ColorEncoding::Linear, ..texture };
    // u = x + 0.5 and v = y + 0.5: (0.25, -0.25) lies in the second texel, (-0.25, 0.25) in the third.
    let at = |material: Material, color: f32, x, y| {
        let mut mesh = rectangle(Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y);
        mesh.colors = vec![Vec4::new(1.0, 1.0, 1.0, color); 4];
        let scene = placed(mesh, material, vec![quarters()], DAffine3::IDENTITY, false);
        scene.coverage(&shade(&scene, x, y, true), Vec3::NEG_Z)
    };
    let blend = |alpha: f32| Material { alpha: alpha.into(), alpha_mode: AlphaMode::Blend, ..Material::default() };
    let textured =
        |alpha| Material { base_color: Parameter { factor: Rgb::WHITE, texture: Some(texture) }, ..blend(alpha) };
    let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-6, "{a} should be {b}");
    near(at(blend(0.3), 1.0, 0.25, -0.25), 0.3);
    near(at(blend(0.3), 0.5, 0.25, -0.25), 0.15);
    near(at(textured(0.5), 1.0, 0.25, -0.25), 0.5 * 0.2);
    near(at(textured(0.5), 1.0, -0.25, 0.25), 0.5);
    near(at(Material { alpha: Parameter { factor: 1.0, texture: Some(alpha) }, ..blend(1.0) }, 1.0, -0.25, 0.25), 0.6);
    let mask = |cutoff| Material { alpha_mode: AlphaMode::Mask { cutoff }, ..textured(1.0) };
    near(at(mask(0.19), 1.0, 0.25, -0.25), 1.0);
    near(at(mask(0.21), 1.0, 0.25, -0.25), 0.0);
    near(at(Material { alpha_mode: AlphaMode::Opaque, ..textured(0.0) }, 0.0, 0.25, -0.25), 1.0);
}

#[test]
fn emission_uses_its_own_coordinates_and_transform() {
    // Set 1 holds (x + 0.5, y + 0.5). Set 0 is not used. KHR_texture_transform: scale first, then a quarter turn
    // counter-clockwise with v down, (u, v) -> (v, -u), then the offset. (0.25, 0.75) in set 1 becomes (0.25, 0.375)
    // scaled by (1, 0.5), turned (0.375, -0.25), moved by (0.5, 0.1): (0.875, -0.15), which repeats to (0.875, 0.85):
    // the last texel, red 204 / 255.
    let mut mesh = rectangle(Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y);
    mesh.uvs[1] = std::mem::replace(&mut mesh.uvs[0], vec![Vec2::ZERO; 4]);
    let transform = TextureTransform {
        offset: Vec2::new(0.5, 0.1),
        rotation: std::f32::consts::FRAC_PI_2,
        scale: Vec2::new(1.0, 0.5),
    };
    let texture =
        Texture { filter: Filter::Nearest, uv_set: 1, transform, ..Texture::new(ImageId(0), ColorEncoding::Linear) };
    let material =
        Material { emission: Parameter { factor: Rgb::splat(2.0), texture: Some(texture) }, ..Material::default() };
    let scene = placed(mesh, material, vec![quarters()], DAffine3::IDENTITY, false);
    let hit = shade(&scene, -0.25, 0.25, true);
    assert!((scene.emitted(&hit, Vec3::Z).r - 2.0 * 204.0 / 255.0).abs() < 1e-6);
    assert!(scene.emitted(&hit, Vec3::NEG_Z).is_black(), "one-sided");
}
