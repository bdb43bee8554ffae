//! Rounded edges: a sharp body reflects as one with fillets. Replay: `cargo test -p dunkelfeld --test it rounded_edges::NAME`.

use crate::support::{RATE, build, emitter, film, settings};
use dunkelfeld::geometry::{DVec3, Mesh, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::{
    Camera, Environment, EnvironmentSource, Material, Projection, Scene, SceneBuilder, look_at,
    shapes::{cuboid, rectangle},
};
use dunkelfeld_testkit::z_test;

/// Half width of the body and radius of its fillets \[m\].
const HALF: f32 = 0.1;
const RADIUS: f32 = 0.01;

/// A bar along y below z = 0, open at the bottom, from its outline in x and z with the normals of its corners.
fn bar(outline: &[[Vec3; 2]]) -> Mesh {
    let mut mesh = Mesh::default();
    for [corner, normal] in outline {
        mesh.positions.extend([*corner - Vec3::Y, *corner + Vec3::Y]);
        mesh.normals.extend([*normal; 2]);
    }
    for k in (0..2 * outline.len() as u32 - 2).step_by(2) {
        mesh.triangles.extend([[k, k + 2, k + 1], [k + 2, k + 3, k + 1]]);
    }
    // Clockwise seen from -y: the normals point outward.
    mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    mesh
}

/// The bar with cylinders of triangles at its edges.
fn rounded() -> Mesh {
    let foot = |side: f32| [Vec3::new(side * HALF, 0.0, -HALF), Vec3::X * side];
    let fillet = |side: f32, k: u32| {
        let (sin, cos) = (k as f32 / 64.0 * std::f32::consts::FRAC_PI_2).sin_cos();
        let normal = Vec3::new(side * cos, 0.0, sin);
        [Vec3::new(side * (HALF - RADIUS), 0.0, -RADIUS) + normal * RADIUS, normal]
    };
    let left = (0..=64).map(|k| fillet(-1.0, k));
    let right = (0..=64).rev().map(|k| fillet(1.0, k));
    let outline: Vec<_> = std::iter::once(foot(-1.0)).chain(left).chain(right).chain([foot(1.0)]).collect();
    bar(&outline)
}

fn sharp() -> Mesh {
    let mut mesh =
        bar(&[[-HALF, -HALF], [-HALF, 0.0], [HALF, 0.0], [HALF, -HALF]]
            .map(|[x, z]| [Vec3::new(x, 0.0, z), Vec3::ZERO]));
    mesh.normals.clear();
    mesh
}

/// A bar under a lamp at an angle \[degrees\] from above. The film shows an edge on one side, from another angle.
fn scene((mesh, radius): (Mesh, f32), lamp: f32, (view, side): (f64, f64)) -> Scene {
    let mut b = SceneBuilder::default();
    let metal = Material {
        base_color: Rgb::splat(0.9).into(),
        metallic: 1.0.into(),
        roughness: 0.2.into(),
        ..Material::default()
    };
    let m = b.add_material(metal);
    b.add_object("bar", mesh, m);
    b.meshes[0].edge_radius = radius;
    let light = b.add_material(emitter(10.0));
    let (sin, cos) = lamp.to_radians().sin_cos();
    let (across, center) = (Vec3::new(-cos, 0.0, sin), Vec3::new(sin, 0.0, cos));
    b.add_object("lamp", rectangle(center - 0.1 * across + Vec3::Y * 0.3, -Vec3::Y * 0.6, across * 0.2), light);
    let (sin, cos) = view.to_radians().sin_cos();
    let edge = DVec3::X * side * f64::from(HALF);
    b.cameras.push(Camera {
        to_world: look_at(edge + 2.0 * DVec3::new(sin, 0.0, cos), edge, DVec3::Y),
        projection: Projection::Orthographic { half_width: 2.0 * RADIUS, half_height: 1e-3 * RADIUS },
        ..Camera::default()
    });
    build(b)
}

/// Mean radiance with its standard error.
fn mean(scene: &Scene, seed: u64) -> [f64; 2] {
    let film = film(scene, &settings(64, 16, 1024.0, seed));
    let pixels = film.sums().data();
    let [sum, variance] = pixels.iter().fold([0.0; 2], |[s, v], p| [s + p.mean()[1], v + p.variance_of_mean()[1]]);
    let n = pixels.len() as f64;
    [sum / n, variance.sqrt() / n]
}

/// In a dark field the line of light on an edge is that of the fillet: of lamps from both sides, also below the plane of the top,
/// for views from above and of both faces.
#[test]
fn an_edge_reflects_as_its_fillet() {
    for view in [0.0, 20.0, 45.0] {
        for lamp in [-75.0, -60.0, 30.0, 70.0, 80.0, 100.0, 130.0] {
            let fillet = mean(&scene((rounded(), 0.0), lamp, (view, 1.0)), 1);
            let edge = mean(&scene((sharp(), RADIUS), lamp, (view, 1.0)), 2);
            let bare = mean(&scene((sharp(), 0.0), lamp, (view, 1.0)), 2);
            println!("{view} {lamp}: {fillet:?} {edge:?} {bare:?}");
            let what = format!("view {view}, lamp {lamp} degrees");
            z_test((edge[0] - fillet[0]).abs() - 0.005 * fillet[0], fillet[1].hypot(edge[1]), 0.0).assert(RATE, &what);
        }
    }
}

/// A white body under uniform light reflects all of it, at edges and corners too, and with silhouettes.
#[test]
fn no_light_is_lost_or_made() {
    let mut b = SceneBuilder { energy_compensation: true, ..SceneBuilder::default() };
    let white =
        Material { base_color: Rgb::WHITE.into(), metallic: 1.0.into(), roughness: 0.3.into(), ..Material::default() };
    let m = b.add_material(white);
    b.add_object("box", cuboid(-Vec3::ONE, Vec3::ONE), m);
    b.meshes[0].edge_radius = 0.3;
    b.environment = Some(Environment { source: EnvironmentSource::Constant(Rgb::WHITE), rotation: 0.0 });
    b.add_camera("camera", DVec3::new(2.5, 5.0, 3.5), DVec3::ZERO, 0.7);
    let film = film(&build(b), &settings(48, 48, 256.0, 3));
    for p in film.sums().data() {
        let error = p.variance_of_mean()[1].sqrt();
        assert!((p.mean()[1] - 1.0).abs() < 0.01 + 6.0 * error, "{} with {error}", p.mean()[1]);
    }
}
