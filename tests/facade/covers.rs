//! Light through clear covers: the image with the connection is the image without it, for any object under the cover.
//!
//! Each set-up is rendered twice, with the connection and with everything left to chance, by different seeds; the pixels of each
//! all see the same radiance, so their means are two samples that must have one mean (Welch 1947). Each
//! comparison has a check of its power: with some percent of the light counted twice, as a path that two techniques both find would be,
//! it must fail. The false-alarm rate of each check is `support::RATE`. Replay: `cargo test -p dunkelfeld --test it covers::NAME`.

use crate::support::{Add, RATE, build, emitter, film, settings, sky, spot_camera, square};
use dunkelfeld::geometry::{DAffine3, DQuat, DVec3, Mesh, Vec2, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::shapes::{cuboid, rectangle, sheet, turned};
use dunkelfeld::scene::{AlphaMode, Effect, Material, SceneBuilder, Surface, Volume};
use dunkelfeld_testkit::{SampleMoments, welch_test};

/// Clear PMMA, or another plastic, that absorbs a little: half of the light is left after 30 mm.
fn clear(ior: f32) -> Material {
    let volume = Volume { absorption: Rgb::new(20.0, 23.0, 30.0), ..Volume::default() };
    Material {
        name: format!("clear {ior}"),
        transmission: 1.0.into(),
        roughness: 0.0.into(),
        ior,
        surface: Surface::Solid(volume),
        ..Material::default()
    }
}

fn paint() -> Material {
    Material { name: "paint".into(), base_color: Rgb::splat(0.7).into(), roughness: 0.9.into(), ..Material::default() }
}

/// A plate of 160 mm x 160 mm between two heights.
fn plate(low: f32, high: f32) -> Mesh {
    cuboid(Vec3::new(-0.08, -0.08, low), Vec3::new(0.08, 0.08, high))
}

/// Objects under a low light at +x, as in a dark field, seen from straight above at a spot near the origin.
fn bench(objects: Vec<(&str, Mesh, Material)>) -> SceneBuilder {
    let mut b = SceneBuilder::default();
    for (name, mesh, material) in objects {
        b.add(name, mesh, material);
    }
    b.add("light", rectangle(Vec3::new(0.1, -0.15, 0.02), Vec3::Z * 0.18, Vec3::Y * 0.3), emitter(5.0));
    spot_camera(&mut b, DVec3::new(0.003, 0.0, 0.3), DVec3::new(0.003, 0.0, 0.0), 1e-4);
    b
}

/// Means of the pixels, and the same with a share of the light counted twice.
fn moments(builder: SceneBuilder, spp: f64, seed: u64, twice: f64) -> [SampleMoments; 2] {
    let film = film(&build(builder), &settings(16, 16, spp, seed));
    assert_eq!(film.invalid_samples(), 0, "samples that are not finite or negative");
    let mean = |factor: f64| film.sums().data().iter().map(|p| p.mean()[1] * factor).collect();
    [mean(1.0), mean(1.0 + twice)]
}

/// Compares the two images of a scene, in which `stacks` covers must be found. A share `twice` of the light counted twice must
/// be detected.
fn compare(what: &str, builder: SceneBuilder, stacks: usize, spp: f64, twice: f64) {
    let mut left_out = builder.clone();
    assert!(left_out.leave_out(Effect::CoverConnection));
    assert_eq!(build(builder.clone()).covers().len(), stacks, "{what}: covers found");
    assert!(build(left_out.clone()).covers().is_empty(), "{what}: the cover is left out");
    let [with, _] = moments(builder, spp, 21, twice);
    let [without, wrong] = moments(left_out, spp, 22, twice);
    assert!(without.mean() > 0.0, "{what}: no light arrives");
    welch_test(&with, &without).assert(RATE, &format!("{what}: with the connection and without it"));
    let outcome = welch_test(&with, &wrong);
    assert!(
        outcome.p_value < RATE,
        "{what}: {} % of the light counted twice go unnoticed: {}",
        100.0 * twice,
        outcome.message
    );
}

#[test]
fn a_cover_of_two_layers() {
    let floor = || ("floor", square(0.0, 0.3, false), paint());
    let cover = || ("cover", plate(0.001, 0.005), clear(1.49));
    for (what, low) in [("glued", 0.005), ("with air between them", 0.0055)] {
        let film = ("film", plate(low, 0.006), clear(1.65));
        compare(&format!("two layers, {what}"), bench(vec![floor(), cover(), film]), 1, 1024.0, 0.05);
    }
}

/// Both faces bulge upwards, the upper one more.
fn bulged() -> Mesh {
    sheet(Vec2::splat(0.08), 40, |side, x, y| {
        let (u, v) = (x / 0.08, y / 0.08);
        let side = side as f64;
        0.001 + 0.004 * side + (0.003 + 0.002 * side) * (1.0 - u * u) * (1.0 - v * v)
    })
}

#[test]
fn a_cover_over_a_floor() {
    // One refraction: the floor stands in the cover, whose upper face bulges.
    let lid = sheet(Vec2::splat(0.08), 40, |side, x, y| {
        let (u, v) = (x / 0.08, y / 0.08);
        0.001 + side as f64 * (0.004 + 0.002 * (1.0 - u * u) * (1.0 - v * v))
    });
    // The light comes in where the upper face begins to fall towards the rim.
    let rounded = sheet(Vec2::splat(0.012), 48, |side, x, y| {
        let (u, v) = (x / 0.012, y / 0.012);
        0.001 + side as f64 * (0.001 + 0.003 * (1.0 - u.powi(6)) * (1.0 - v.powi(6)))
    });
    // Under the edge of the hole some light comes straight through it, some through its wall, and some through both
    // faces.
    let hole = [(0.005, 0.001), (0.08, 0.001), (0.08, 0.005), (0.005, 0.005)].map(Vec2::from);
    // In contact the floor stands a little above the cover's lower face: light that is in the cover falls on it.
    for (what, floor, cover, spp, twice) in [
        ("flat, gapped", 0.0, plate(0.001, 0.005), 1024.0, 0.05),
        ("flat, in contact", 0.0011, plate(0.001, 0.005), 1024.0, 0.05),
        ("moulded", 0.0, bulged(), 1024.0, 0.05),
        ("moulded, in contact", 0.0011, lid, 1024.0, 0.05),
        ("rounded rim", 0.0, rounded, 2048.0, 0.08),
        ("a hole", 0.0, turned(&hole, 48), 2048.0, 0.08),
    ] {
        let objects = vec![("floor", square(floor, 0.3, false), paint()), ("cover", cover, clear(1.49))];
        compare(what, bench(objects), 1, spp, twice);
    }
}

/// A lens of half a metre's focal length, of 40 mm x 40 mm in 100 x 100 cells, under a light right above.
fn under_a_lens(is_smooth: bool) -> SceneBuilder {
    let mut lens = sheet(Vec2::splat(0.02), 100, |side, x, y| {
        let (u, v) = (x / 0.02, y / 0.02);
        0.002 + side as f64 * (0.003 + 0.00075 * (2.0 - u * u - v * v))
    });
    if !is_smooth {
        lens.normals.clear();
    }
    let mut b = SceneBuilder::default();
    b.add("floor", square(0.0, 0.1, false), paint());
    b.add("cover", lens, clear(1.49));
    b.add("light", square(0.15, 0.08, true), emitter(5.0));
    spot_camera(&mut b, DVec3::new(0.2, 0.0, 0.2), DVec3::ZERO, 1e-4);
    b
}

#[test]
fn a_lens_with_a_smooth_face() {
    compare("smooth lens", under_a_lens(true), 1, 1024.0, 0.05);
}

#[test]
fn a_lens_of_facets() {
    // Each facet is a prism of its own: where their images of the light overlap, two chains of one order lead to one
    // point, in directions that differ by less than a milliradian.
    compare("lens of facets", under_a_lens(false), 1, 1024.0, 0.05);
}

#[test]
fn a_tilted_cover_with_the_light_below() {
    let mut b = SceneBuilder::default();
    let m = b.add_material(clear(1.49));
    let cover = b.add_object("cover", plate(-0.002, 0.002), m);
    b.instances[cover].to_world = DAffine3::from_rotation_translation(DQuat::from_rotation_y(0.35), DVec3::ZERO);
    b.add("ceiling", square(0.04, 0.3, true), paint());
    b.add("light", rectangle(Vec3::new(0.02, -0.08, -0.1), Vec3::X * 0.12, Vec3::Y * 0.16), emitter(5.0));
    spot_camera(&mut b, DVec3::new(-0.2, 0.0, -0.2), DVec3::new(0.0, 0.0, 0.04), 1e-4);
    compare("tilted, light below", b, 1, 1024.0, 0.05);
}

#[test]
fn two_covers_that_are_no_stack() {
    // The one lies over the spot, the other stands between it and the light.
    let mut b = bench(vec![
        ("floor", square(0.0, 0.3, false), paint()),
        ("cover", plate(0.001, 0.005), clear(1.49)),
        ("window", plate(-0.002, 0.002), clear(1.52)),
    ]);
    let upright = DQuat::from_rotation_y(1.3);
    b.instances[2].to_world = DAffine3::from_rotation_translation(upright, DVec3::new(0.06, 0.0, 0.09));
    compare("two covers", b, 2, 1024.0, 0.05);
}

#[test]
fn the_sky_through_a_cover() {
    let mut b = bench(vec![("floor", square(0.0, 0.3, false), paint()), ("cover", plate(0.001, 0.005), clear(1.49))]);
    b.environment = sky(0.5);
    compare("with a sky", b, 1, 256.0, 0.05);
}

#[test]
fn receivers_under_a_cover() {
    let cover = || ("cover", plate(0.004, 0.008), clear(1.49));
    let tilted = || rectangle(Vec3::new(-0.02, -0.02, 0.003), Vec3::new(0.04, 0.0, -0.016), Vec3::Y * 0.04);
    let metal = Material { name: "metal".into(), metallic: 1.0.into(), roughness: 0.35.into(), ..paint() };
    let ink = Material {
        name: "ink".into(),
        base_color: Rgb::splat(0.05).into(),
        alpha: 0.6.into(),
        alpha_mode: AlphaMode::Blend,
        ..paint()
    };
    let floor = || ("floor", square(0.0, 0.3, false), paint());
    for (what, objects) in [
        ("tilted paint", vec![("slope", tilted(), paint()), cover()]),
        ("rough metal", vec![("slope", tilted(), metal), cover()]),
        ("a symbol that covers six tenths", vec![floor(), ("ink", square(0.0001, 0.02, false), ink), cover()]),
    ] {
        compare(what, bench(objects), 1, 1024.0, 0.1);
    }
}

#[test]
#[ignore = "long: .ci/run runs it"]
fn a_scattering_thermoplastic_that_touches_the_cover() {
    let milky = |roughness: f32, ior: f32| {
        let volume = Volume {
            scattering: Rgb::splat(3000.0),
            absorption: Rgb::splat(100.0),
            scattering_anisotropy: 0.5,
            ..Volume::default()
        };
        Material { name: "milky".into(), roughness: roughness.into(), surface: Surface::Solid(volume), ..clear(ior) }
    };
    let body = || plate(-0.02, 0.001);
    for (what, roughness, ior) in
        [("of the same index", 0.0, 1.49), ("of another index", 0.0, 1.6), ("rough", 0.3, 1.6)]
    {
        let objects = vec![("body", body(), milky(roughness, ior)), ("cover", plate(0.001, 0.005), clear(1.49))];
        compare(&format!("thermoplastic {what}"), bench(objects), 1, 256.0, 0.25);
    }
}
