//! Family 1, thin things: gaps of 10 um and films of 1 um in a housing of 0.6 m, surfaces that lie in each other, needles
//! and slivers, and sizes a million to one.
//!
//! Hard, because at 0.3 m from the middle neighbouring f32 numbers are 3e-8 m apart: a film of a micrometre is thirty of
//! them thick. A renderer that starts its rays a fixed "epsilon" of 1e-4 or 1e-5 off a surface steps over the film or the
//! gap, and one that takes no such step meets the surface again that it has just left. A needle has an area of rounding
//! errors for one that divides by it.
//!
//! Must give: the transmittance of a stack of N faces, `(1 - R) / (1 + (N - 1) R)`, from any side and at any angle; the
//! light of a panel, for any triangles that it is cut into; nothing through a closed screen; the radiance of one floor where two
//! coincide; and the same light from a panel over a floor, be they 1 mm or 1 km across.

use super::support::{
    Terms, absorbing, clear, floor, fresnel, gives, lit_by_panel, pixel_means, place, plastic, same, sky, spot, terms,
    through_faces, view,
};
use crate::support::{Add, black, build, emitter, square};
use dunkelfeld::geometry::{DAffine3, DQuat, DVec3, Mesh, Vec3};
use dunkelfeld::scene::shapes::cuboid;
use dunkelfeld::scene::{Scene, SceneBuilder};

const PMMA: f64 = 1.49;

/// Two places in a housing of 0.6 m: its middle, and tilted near a corner, where no coordinate is a round number.
fn places() -> [(&'static str, DAffine3); 2] {
    let tilt = DQuat::from_rotation_x(0.7) * DQuat::from_rotation_y(-0.4) * DQuat::from_rotation_z(0.3);
    [
        ("in the middle", DAffine3::IDENTITY),
        ("tilted in a corner", DAffine3::from_rotation_translation(tilt, DVec3::new(0.23, 0.19, 0.25))),
    ]
}

/// Marks the corners of the housing, so that the scene has its size and its middle.
fn housing(b: &mut SceneBuilder) {
    let m = b.add_material(black());
    let low = cuboid(Vec3::splat(-0.3001), Vec3::splat(-0.3));
    b.add_object("foot", low.clone(), m);
    b.add_object("lid", Mesh { positions: low.positions.iter().map(|p| -*p).collect(), ..low }, m);
}

/// Clear plates over an emitter of radiance 1 in the plane z = `emitter_z`, seen at an angle to their normal.
fn stack(plates: &[(f32, f32)], emitter_z: f32, angle: f64, at: DAffine3) -> Scene {
    let mut b = SceneBuilder::default();
    let pmma = b.add_material(clear(PMMA as f32));
    for &(low, high) in plates {
        b.add_object("plate", cuboid(Vec3::new(-0.1, -0.05, low), Vec3::new(0.1, 0.05, high)), pmma);
    }
    b.add("light", square(emitter_z, 0.2, false), emitter(1.0));
    let up = DVec3::new(angle.sin(), 0.0, angle.cos());
    spot(&mut b, up * 0.15, DVec3::ZERO, 1e-3);
    place(&mut b, at);
    housing(&mut b);
    build(b)
}

#[test]
fn gaps_and_films_pass_what_their_faces_leave() {
    const UM: f32 = 1e-6;
    /// Lower and upper face [m].
    type Film = (f32, f32);
    let ten_films: Vec<Film> = (0..10).map(|k| (2.0 * k as f32 * UM, (2.0 * k as f32 + 1.0) * UM)).collect();
    let mut cases: Vec<(String, Vec<Film>, f32)> = Vec::new();
    for gap in [10.0, 1.0] {
        cases.push((format!("a gap of {gap} um over the light"), vec![(gap * UM, 0.004)], 0.0));
        cases.push((format!("a gap of {gap} um in glass"), vec![(-0.004, 0.0), (gap * UM, 0.004)], -0.006));
        cases.push((format!("a film of {gap} um"), vec![(0.0, gap * UM)], -0.006));
    }
    cases.push(("ten films of 1 um, 1 um apart".into(), ten_films, -0.001));
    for (where_, at) in places() {
        for (name, plates, emitter_z) in &cases {
            for degrees in [0.0f64, 45.0, 80.0] {
                let angle = degrees.to_radians();
                let expected = through_faces(2.0 * plates.len() as f64, fresnel(angle, PMMA));
                let what = format!("{name}, {where_}, at {degrees} degrees");
                // Of n samples a share p arrives: a relative error of sqrt((1 - p) / p n). In a tall stack paths are long,
                // and from the 64th vertex on a few stand for many.
                let longer = if plates.len() > 2 { 4.0 } else { 1.5 };
                let sure = longer * ((1.0 - expected) / expected / (256.0 * 128.0)).sqrt();
                let scene = stack(plates, *emitter_z, angle, at);
                // Directions are rounded to 6e-8 rad; dR/R per radian is 30 at 80 degrees.
                gives(&scene, expected, Terms { spp: 128.0, sure, rounding: 2e-5 }, &what);
            }
        }
    }
}

#[test]
fn a_film_absorbs_by_its_thickness() {
    // Half of the light is left after 1 um; faces of index 1, so that nothing is reflected. Both faces are rounded by up to
    // 1.5e-8 m each and the ray's start by an error bound of about as much again: 6 % of ln 2.
    for (where_, at) in places() {
        for (thickness, rounding) in [(1e-4f32, 1e-3), (1e-5, 7e-3), (1e-6, 0.07)] {
            let mut b = SceneBuilder::default();
            b.add(
                "film",
                cuboid(Vec3::new(-0.1, -0.05, 0.0), Vec3::new(0.1, 0.05, thickness)),
                absorbing(1.0, 0.5, thickness),
            );
            b.environment = sky(1.0);
            spot(&mut b, DVec3::Z * 0.15, DVec3::ZERO, 1e-3);
            place(&mut b, at);
            housing(&mut b);
            let what = format!("{thickness} m, {where_}");
            gives(&build(b), 0.5, Terms { spp: 64.0, sure: 0.02, rounding }, &what);
        }
    }
}

/// The cuts of an edge from -half to half: alternately a needle's width and what is left.
fn cuts(half: f32, strips: usize, needle: f32) -> Vec<f32> {
    let step = 2.0 * half / strips as f32;
    let mut x: Vec<f32> =
        (0..strips).flat_map(|i| [-half + step * i as f32, -half + step * i as f32 + needle]).collect();
    x.push(half);
    x
}

/// A square in the plane z, front up or down, of strips between cuts.
fn strips(cuts: &[f32], half: f32, z: f32, up: bool) -> Mesh {
    let mut mesh = Mesh::default();
    for &x in cuts {
        mesh.positions.extend([Vec3::new(x, -half, z), Vec3::new(x, half, z)]);
    }
    for i in 0..cuts.len() as u32 - 1 {
        let [a, b, c, d] = [2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1];
        let quad = if up { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
        mesh.triangles.extend(quad);
    }
    mesh
}

/// The same square as a fan of needles from one corner.
fn fan(cuts: &[f32], half: f32, z: f32, up: bool) -> Mesh {
    let mut mesh = Mesh { positions: vec![Vec3::new(-half, -half, z)], ..Mesh::default() };
    mesh.positions.extend(cuts.iter().map(|&y| Vec3::new(half, y, z)));
    mesh.positions.extend(cuts.iter().rev().skip(1).map(|&x| Vec3::new(x, half, z)));
    for i in 1..mesh.positions.len() as u32 - 1 {
        mesh.triangles.push(if up { [0, i, i + 1] } else { [0, i + 1, i] });
    }
    mesh
}

#[test]
fn needles_shine_like_the_panel_they_make() {
    let corner = DVec3::new(-0.2, -0.2, 0.5);
    let expected = lit_by_panel(view(), corner, DVec3::X * 0.4, DVec3::Y * 0.4, 5.0, 200);
    let few = cuts(0.2, 10, 1e-6);
    let many = cuts(0.2, 200, 1e-6);
    for (name, mesh) in [
        ("20 strips", strips(&few, 0.2, 0.5, false)),
        ("400 strips", strips(&many, 0.2, 0.5, false)),
        ("fan of 40", fan(&few, 0.2, 0.5, false)),
        ("fan of 800", fan(&many, 0.2, 0.5, false)),
    ] {
        let mut b = floor(1.0);
        b.add("light", mesh, emitter(5.0));
        spot(&mut b, view() * 4.0, DVec3::ZERO, 1e-4);
        gives(&build(b), expected, terms(256.0, 5e-3), name);
    }
}

#[test]
fn needles_cover_what_is_behind_them() {
    // A closed screen before an emitter: not one ray of 65 536 may find a way between two needles.
    for (name, mesh) in
        [("strips", strips(&cuts(0.2, 500, 1e-6), 0.2, 0.1, true)), ("fan", fan(&cuts(0.2, 500, 1e-6), 0.2, 0.1, true))]
    {
        for (where_, at) in places() {
            let mut b = SceneBuilder::default();
            b.add("screen", mesh.clone(), black());
            let light = b.add_material(emitter(1e6));
            b.add_object("light", square(0.0, 0.6, false), light);
            spot(&mut b, DVec3::new(0.05, 0.03, 0.3), DVec3::Z * 0.1, 0.1);
            place(&mut b, at);
            assert_eq!(pixel_means(&build(b), 256.0, 3, name).mean(), 0.0, "light through {name}, {where_}");
        }
    }
}

#[test]
fn a_plate_of_slivers_is_a_plate() {
    // Top and bottom cut into 400 strips, every other one 1 um wide; the rims follow the cuts, so the body is closed.
    let (x, half, high) = (cuts(0.2, 200, 1e-6), 0.2f32, 0.004f32);
    let mut mesh = Mesh::default();
    for &x in &x {
        for (y, z) in [(-half, 0.0), (half, 0.0), (half, high), (-half, high)] {
            mesh.positions.push(Vec3::new(x, y, z));
        }
    }
    let last = 4 * (x.len() as u32 - 1);
    for i in (0..last).step_by(4) {
        for k in 0..4 {
            let [a, b] = [i + k, i + (k + 1) % 4];
            mesh.triangles.extend([[a, b, b + 4], [a, b + 4, a + 4]]);
        }
    }
    mesh.triangles.extend([[0, 2, 1], [0, 3, 2], [last, last + 1, last + 2], [last, last + 2, last + 3]]);
    let mut b = SceneBuilder::default();
    b.add("plate", mesh, clear(PMMA as f32));
    b.add("light", square(-0.05, 0.6, false), emitter(1.0));
    spot(&mut b, DVec3::new(0.1, 0.0, 0.3), DVec3::ZERO, 0.05);
    let (scene, report) = b.build().expect("the scene is valid");
    assert!(
        !report.hazards().any(|h| h.message.contains("not closed") || h.message.contains("inside out")),
        "{report:?}"
    );
    let expected = through_faces(2.0, fresnel((0.1f64 / 0.3).atan(), PMMA));
    gives(&scene, expected, terms(256.0, 2e-3), "a plate of slivers");
}

#[test]
fn a_floor_that_lies_in_a_floor_is_one_floor() {
    // The same square twice, as two objects: a ray that leaves one of them must not meet the other.
    let panel = |doubled: bool, at: DAffine3| {
        let mut b = floor(0.4);
        if doubled {
            b.add_object("twin", square(0.0, 0.4, false), 0);
        }
        b.add("light", square(0.2, 0.1, true), emitter(5.0));
        b.environment = sky(0.3);
        spot(&mut b, view() * 0.5, DVec3::new(0.011, 0.017, 0.0), 1e-3);
        place(&mut b, at);
        housing(&mut b);
        build(b)
    };
    for (where_, at) in places() {
        same(&panel(false, at), &panel(true, at), terms(256.0, 1e-2), where_);
    }
}

#[test]
fn a_million_to_one_in_size() {
    // A panel as wide as it hangs high over a floor a million times its size: the same radiance at any scale. A point on a
    // triangle is known to 1e-7 of the triangle, so the floor's triangles get smaller toward the panel, as any mesher makes
    // them.
    for size in [1e-6f32, 1e-3, 1.0] {
        let steps = (0..=6).map(|k| 0.5 * size * 10f32.powi(k));
        let cuts: Vec<f32> = steps.clone().rev().map(|x| -x).chain(steps).collect();
        let n = cuts.len() as u32;
        let at = |i: u32, j: u32| i * n + j;
        let cell = |k: u32| [k / (n - 1), k % (n - 1)];
        let graded = Mesh {
            positions: (0..n * n).map(|k| Vec3::new(cuts[(k / n) as usize], cuts[(k % n) as usize], 0.0)).collect(),
            triangles: (0..(n - 1) * (n - 1))
                .map(cell)
                .flat_map(|[i, j]| {
                    let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                    [[a, b, c], [a, c, d]]
                })
                .collect(),
            ..Mesh::default()
        };
        let mut b = SceneBuilder::default();
        b.add("floor", graded, plastic());
        let m = b.add_material(emitter(5.0));
        b.add_object("light", square(size, size, true), m);
        let s = f64::from(size);
        spot(&mut b, view() * (1e3 * s), DVec3::ZERO, 1e-3 * size);
        let expected = lit_by_panel(view(), DVec3::new(-0.5, -0.5, 1.0), DVec3::X, DVec3::Y, 5.0, 200);
        // The eye stands a thousand panels away, where a coordinate is known to 6e-5 of the panel.
        gives(&build(b), expected, Terms { spp: 256.0, sure: 5e-3, rounding: 2e-4 }, &format!("a panel of {size} m"));
    }
}
