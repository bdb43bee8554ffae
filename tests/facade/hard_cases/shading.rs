//! Family 7, shading: interpolated normals that disagree with the surface, normals, tangents and texture coordinates that
//! are zero or no numbers, mirrored coordinates, and mirrored objects.
//!
//! Hard, because a shading frame is made of data that exporters get wrong: a zero normal cannot be normalised, a tangent
//! may be parallel to its normal, a triangle may have one texture coordinate at all its corners, and a mirroring transform
//! turns winding, tangents and handedness each in its own way. One NaN in a frame is a black or a blazing pixel, and a
//! mirrored solid refracts as if it were air in glass.
//!
//! Must give: the flat surface where data cannot be used; the tilted surface where a normal map tilts it, mirrored or not;
//! the same image for a mirrored object as for one that was modelled that way; and no light through an opaque surface,
//! for any normals.

use super::support::{
    Terms, absorbing, clear, f_cos, fresnel, gives, healthy_film, pixel_means, plastic, plastic_bsdf, sky, spot, sun,
    terms, through_faces, view,
};
use crate::support::{Add, build, emitter, settings, square};
use dunkelfeld::geometry::{DAffine3, DVec3, Mesh, Vec2, Vec3, Vec4};
use dunkelfeld::scene::shapes::{cuboid, sphere};
use dunkelfeld::scene::{
    Anisotropy, ColorEncoding, Image, ImageId, Material, NormalMap, Scene, SceneBuilder, Texels, Texture,
};

/// Where the light of these scenes comes from: far above the horizon of every tilted normal.
fn from() -> DVec3 {
    DVec3::new(-0.15, 0.25, 0.95).normalize()
}

/// A floor under parallel light, its mesh changed.
fn floor_with(material: Material, image: Option<DVec3>, change: impl Fn(&mut Mesh)) -> SceneBuilder {
    let mut b = SceneBuilder::default();
    if let Some(n) = image {
        let texel = |v: f64| ((0.5 + 0.5 * v) * 65535.0).round() as u16;
        let texels = Texels::Rgba16(vec![[texel(n.x), texel(n.y), texel(n.z), 65535]]);
        b.images.push(Image { name: "map".into(), width: 1, height: 1, texels: texels.into() });
    }
    let m = b.add_material(material);
    let mut mesh = square(0.0, 1.0, false);
    change(&mut mesh);
    b.add_object("floor", mesh, m);
    sun(&mut b, from());
    spot(&mut b, view() * 4.0, DVec3::ZERO, 1e-4);
    b
}

fn mapped() -> Material {
    Material {
        normal_map: NormalMap { texture: Some(Texture::new(ImageId(0), ColorEncoding::Linear)), scale: 1.0 },
        ..plastic()
    }
}

/// Nothing in these scenes is random; a 16-bit map is known to 1.5e-5.
const EXACT: Terms = Terms { spp: 4.0, sure: 1e-3, rounding: 1e-3 };

#[test]
fn unusable_normals_are_the_flat_surface() {
    let expected = f_cos(&plastic_bsdf(), DVec3::Z, view(), from());
    let nan = Vec3::splat(f32::NAN);
    for (name, normals) in [
        ("zero", [Vec3::ZERO; 4]),
        ("no numbers", [nan; 4]),
        ("infinite", [Vec3::splat(f32::INFINITY); 4]),
        ("one of them no number", [Vec3::Z, nan, Vec3::Z, Vec3::Z]),
        ("turned over", [Vec3::NEG_Z; 4]),
        ("tiny", [Vec3::Z * 1e-30; 4]),
        ("huge", [Vec3::Z * 1e30; 4]),
    ] {
        let b = floor_with(plastic(), None, |m| m.normals = normals.to_vec());
        gives(&build(b), expected, EXACT, name);
    }
    // Normals that cancel at the visible point: the light is a number.
    let b = floor_with(plastic(), None, |m| m.normals = vec![Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y]);
    assert!(pixel_means(&build(b), 16.0, 1, "cancelling normals").mean() < 10.0);
}

#[test]
fn unusable_tangents_and_coordinates_leave_a_flat_map_flat() {
    let expected = f_cos(&plastic_bsdf(), DVec3::Z, view(), from());
    let nan = f32::NAN;
    let tangents: [(&str, Vec4); 6] = [
        ("zero", Vec4::ZERO),
        ("along the normal", Vec4::new(0.0, 0.0, 1.0, 1.0)),
        ("no numbers", Vec4::splat(nan)),
        ("infinite", Vec4::new(f32::INFINITY, 0.0, 0.0, 1.0)),
        ("without a sign", Vec4::new(1.0, 0.0, 0.0, 0.0)),
        ("a sign that is no number", Vec4::new(1.0, 0.0, 0.0, nan)),
    ];
    for material in
        [mapped(), Material { anisotropy: Anisotropy { strength: 0.0.into(), ..Anisotropy::default() }, ..mapped() }]
    {
        for (name, t) in tangents {
            let b = floor_with(material.clone(), Some(DVec3::Z), |m| m.tangents = vec![t; 4]);
            gives(&build(b), expected, EXACT, &format!("tangents {name}"));
        }
    }
    let coordinates: [(&str, [Vec2; 4]); 5] = [
        ("all the same", [Vec2::new(0.3, 0.3); 4]),
        ("on a line", [Vec2::ZERO, Vec2::X, Vec2::X * 2.0, Vec2::X * 3.0]),
        ("no numbers", [Vec2::splat(nan); 4]),
        ("infinite", [Vec2::splat(f32::INFINITY); 4]),
        ("huge", [Vec2::ZERO, Vec2::X * 1e30, Vec2::splat(1e30), Vec2::Y * 1e30]),
    ];
    for (name, uv) in coordinates {
        let b = floor_with(mapped(), Some(DVec3::Z), |m| m.uvs[0] = uv.to_vec());
        gives(&build(b), expected, EXACT, &format!("coordinates {name}"));
    }
    gives(&build(floor_with(mapped(), Some(DVec3::Z), |m| m.uvs[0].clear())), expected, EXACT, "no coordinates");
}

#[test]
fn anisotropy_without_usable_tangents_is_still_a_number() {
    // The direction of the highlight is then arbitrary; the test accepts both.
    let metal = Material {
        metallic: 1.0.into(),
        roughness: 0.5.into(),
        anisotropy: Anisotropy { strength: 1.0.into(), ..Anisotropy::default() },
        ..Material::default()
    };
    for t in [Vec4::ZERO, Vec4::splat(f32::NAN), Vec4::new(0.0, 0.0, 1.0, 1.0)] {
        let b = floor_with(metal.clone(), None, |m| m.tangents = vec![t; 4]);
        let mean = pixel_means(&build(b), 4.0, 1, "anisotropy").mean();
        assert!(mean > 0.0 && mean < 100.0, "tangent {t}: {mean}");
    }
}

#[test]
fn maps_on_mirrored_coordinates_tilt_the_other_way() {
    // Red is the slope along u, green the slope against v. On coordinates that are mirrored in u the same map means the
    // mirrored tilt; with and without tangents.
    let tilt = |x: f64, y: f64| DVec3::new(x, y, (1.0 - x * x - y * y).sqrt());
    let map = tilt(0.3, 0.2);
    for (mirror_u, mirror_v) in [(false, false), (true, false), (false, true), (true, true)] {
        for with_tangents in [false, true] {
            let b = floor_with(mapped(), Some(map), |m| {
                let flip = |on: bool, c: f32| if on { 1.0 - c } else { c };
                m.uvs[0].iter_mut().for_each(|uv| *uv = Vec2::new(flip(mirror_u, uv.x), flip(mirror_v, uv.y)));
                if with_tangents {
                    let x = if mirror_u { -1.0 } else { 1.0 };
                    // v grows along +y, against the bitangent that glTF means, unless it is mirrored.
                    let up = if mirror_v { 1.0 } else { -1.0 };
                    // Bitangent = w (normal x tangent) = w x (+y); it must be `up`.
                    m.tangents = vec![Vec4::new(x, 0.0, 0.0, x * up); 4];
                }
            });
            let sign = |mirrored: bool| if mirrored { -1.0 } else { 1.0 };
            let n = tilt(0.3 * sign(mirror_u), -0.2 * sign(mirror_v));
            let expected = f_cos(&plastic_bsdf(), n, view(), from());
            let what = format!("u mirrored {mirror_u}, v mirrored {mirror_v}, tangents {with_tangents}");
            gives(&build(b), expected, EXACT, &what);
        }
    }
}

/// An object placed by a transform, as itself or as an instance of a mesh too large to be copied.
fn placed(
    material: Material,
    mut mesh: Mesh,
    to_world: DAffine3,
    instanced: bool,
    tilt: Option<DVec3>,
) -> SceneBuilder {
    let mut b = floor_with(plastic(), tilt, |_| {});
    (b.instances, b.meshes) = (Vec::new(), Vec::new());
    let m = b.add_material(material);
    if instanced {
        // A mesh of more than 16 384 triangles that is used twice stays an instance: far away there is a cloud of dust.
        for k in 0..17_000u32 {
            let (base, z) = (mesh.positions.len() as u32, -1.0 - k as f32 * 1e-4);
            mesh.positions.extend([Vec3::new(0.0, 0.0, z), Vec3::new(1e-4, 0.0, z), Vec3::new(0.0, 1e-4, z)]);
            mesh.triangles.push([base, base + 1, base + 2]);
        }
        let n = mesh.positions.len();
        let fill = |v: &mut Vec<Vec2>| {
            if !v.is_empty() {
                v.resize(n, Vec2::ZERO)
            }
        };
        mesh.uvs.iter_mut().for_each(fill);
        if !mesh.normals.is_empty() {
            mesh.normals.resize(n, Vec3::Z);
        }
        if !mesh.tangents.is_empty() {
            mesh.tangents.resize(n, Vec4::new(1.0, 0.0, 0.0, 1.0));
        }
    }
    b.add_object("object", mesh, m);
    b.instances[0].to_world = to_world;
    if instanced {
        let mut twin = b.instances[0].clone();
        twin.to_world = DAffine3::from_translation(DVec3::Z * -20.0) * twin.to_world;
        b.instances.push(twin);
    }
    b
}

#[test]
fn a_mirrored_floor_keeps_its_map_and_its_front() {
    // The floor under a mirroring transform: the map's tilt is mirrored with it, along x or y; its front stays its front.
    let tilt = |x: f64, y: f64| DVec3::new(x, y, (1.0 - x * x - y * y).sqrt());
    for instanced in [false, true] {
        for with_tangents in [false, true] {
            for scale in [DVec3::new(-1.0, 1.0, 1.0), DVec3::new(1.0, -1.0, 1.0), DVec3::new(-2.0, -2.0, 3.0)] {
                let mut mesh = square(0.0, 1.0, false);
                mesh.normals = vec![Vec3::Z; 4];
                if with_tangents {
                    mesh.tangents = vec![Vec4::new(1.0, 0.0, 0.0, -1.0); 4];
                }
                let b = placed(mapped(), mesh, DAffine3::from_scale(scale), instanced, Some(tilt(0.3, 0.2)));
                let scene = build(b);
                assert_eq!(scene.summary().instanced_parts, if instanced { 2 } else { 0 });
                let n = tilt(0.3 * scale.x.signum(), -0.2 * scale.y.signum());
                let expected = f_cos(&plastic_bsdf(), n, view(), from());
                let what = format!("scale {scale}, instanced {instanced}, tangents {with_tangents}");
                gives(&scene, expected, EXACT, &what);
            }
        }
    }
    for mirrored in [false, true] {
        let mut b = placed(
            emitter(3.0),
            square(0.0, 1.0, false),
            DAffine3::from_scale(DVec3::new(if mirrored { -1.0 } else { 1.0 }, 1.0, 1.0)),
            false,
            None,
        );
        b.lights.clear();
        gives(&build(b), 3.0, terms(4.0, 0.0), "the front of a mirrored emitter");
    }
}

#[test]
fn mirrored_glass_is_glass() {
    // A plate under a mirroring transform lets through what its two faces and its absorption leave.
    let angle = view().angle_between(DVec3::Z);
    let sin = angle.sin() / 1.5;
    let a = 0.5f64.powf(0.01 / (1.0 - sin * sin).sqrt() / 0.02);
    let r = fresnel(angle, 1.5);
    for (material, expected) in [
        (clear(1.5), through_faces(2.0, r)),
        (absorbing(1.5, 0.5, 0.02), (1.0 - r).powi(2) * a / (1.0 - r * r * a * a)),
    ] {
        for instanced in [false, true] {
            for scale in [DVec3::new(-1.0, 1.0, 1.0), DVec3::new(1.0, 1.0, -1.0), DVec3::splat(-1.0)] {
                let mesh = cuboid(Vec3::new(-0.5, -0.5, -0.005), Vec3::new(0.5, 0.5, 0.005));
                let mut b = placed(material.clone(), mesh, DAffine3::from_scale(scale), instanced, None);
                b.lights.clear();
                b.add("light", square(-0.1, 2.0, false), emitter(1.0));
                let sure = 1.5 * ((1.0 - expected) / expected / (256.0 * 256.0)).sqrt();
                let what = format!("scale {scale}, instanced {instanced}, expecting {expected}");
                gives(&build(b), expected, Terms { spp: 256.0, sure, rounding: 1e-5 }, &what);
            }
        }
    }
}

#[test]
fn no_light_leaks_through_an_opaque_sheet_whatever_its_normals() {
    // Light from below only, normals tilted by up to 89 degrees in every direction: the upper side is black.
    let leak = |degrees: f32, azimuth: f32| -> Scene {
        let mut b = SceneBuilder::default();
        let m = b.add_material(plastic());
        let mut mesh = square(0.0, 1.0, false);
        let (sin, cos) = degrees.to_radians().sin_cos();
        mesh.normals = vec![Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos); 4];
        b.add_object("sheet", mesh, m);
        b.add("light", square(-0.3, 3.0, false), Material { double_sided: true, ..emitter(1e3) });
        sun(&mut b, DVec3::new(0.5, 0.1, -0.2));
        spot(&mut b, view(), DVec3::ZERO, 0.01);
        build(b)
    };
    for degrees in [10.0, 45.0, 80.0, 89.0] {
        for k in 0..8 {
            let what = format!("normals tilted by {degrees} degrees, direction {k}");
            gives(&leak(degrees, k as f32 * 0.785), 0.0, terms(64.0, 0.0), &what);
        }
    }
}

#[test]
fn normals_that_disagree_reflect_the_light_there_is() {
    // White metal and clear glass are invisible in a white furnace, with any normals: a plate with tilted ones, and balls
    // of few triangles with interpolated ones.
    let metal = || Material { metallic: 1.0.into(), roughness: 0.1.into(), ..Material::default() };
    let furnace = |material: Material, mesh: Mesh, half: f32, least: f32, what: &str| {
        let mut b = SceneBuilder { energy_compensation: true, ..SceneBuilder::default() };
        b.add("body", mesh, material);
        b.environment = sky(1.0);
        spot(&mut b, view() * 4.0, DVec3::ZERO, half);
        let film = healthy_film(&build(b), &settings(16, 16, 256.0, 3), what);
        let m = crate::support::pixel_moments(&film);
        // 6.5 standard errors: a false-alarm rate of 1e-10.
        assert!(m.mean() <= 1.001 + 6.5 * m.standard_error() && m.standard_error() < 1e-2, "{what}: {m:?}");
        let darkest = film.mean().data().iter().map(|p| p[1]).fold(f32::INFINITY, f32::min);
        assert!(m.mean() >= 0.99 && darkest >= least, "{what}: a pixel of {darkest}");
    };
    for degrees in [0.0f32, 30.0, 60.0, 85.0] {
        let mut mesh = square(0.0, 1.0, false);
        let (sin, cos) = degrees.to_radians().sin_cos();
        mesh.normals = vec![Vec3::new(-sin, 0.0, cos); 4];
        furnace(metal(), mesh, 0.01, 0.98, &format!("normals tilted by {degrees} degrees"));
    }
    // Interpolated normals keep some light inside of a ball of clear glass for long.
    for (name, material, least) in [("metal", metal(), 0.98), ("glass", clear(1.5), 0.9)] {
        furnace(material, sphere(Vec3::ZERO, 1.0, 5, true), 1.2, least, &format!("a coarse ball of {name}"));
    }
}
