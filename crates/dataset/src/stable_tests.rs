//! Stable poses against closed forms.

use super::*;
use crate::draws::Draws;
use dunkelfeld_geometry::{RigidMotion, Vec3};
use dunkelfeld_testkit::{chi_squared, z_test};

/// An object of one mesh.
fn scene(positions: &[[f64; 3]], triangles: &[[u32; 3]], to_world: DAffine3) -> SceneBuilder {
    let mut scene = SceneBuilder::default();
    let positions = positions.iter().map(|p| Vec3::from_array(p.map(|v| v as f32))).collect();
    let mesh = Mesh { positions, triangles: triangles.to_vec(), ..Mesh::default() };
    let material = scene.add_material(Default::default());
    let object = scene.add_object("part", mesh, material);
    scene.instances[object].to_world = to_world;
    assert_eq!(scene.instances[object].motion, RigidMotion::default());
    scene
}

fn poses_of(scene: &SceneBuilder) -> Result<Vec<StablePose>, &'static str> {
    Hulls::default().stable_poses(scene, &scene.instances[0])
}

/// A prism between two heights along z over a polygon that its first corner sees, counter-clockwise from +z.
fn prism(polygon: &[[f64; 2]], low: f64, high: f64) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let n = polygon.len() as u32;
    let corners = [low, high].into_iter().flat_map(|z| polygon.iter().map(move |p| [p[0], p[1], z]));
    let mut triangles = Vec::new();
    for i in 1..n - 1 {
        triangles.extend([[0, i + 1, i], [n, n + i, n + i + 1]]);
    }
    for i in 0..n {
        let j = (i + 1) % n;
        triangles.extend([[i, j, n + j], [i, n + j, n + i]]);
    }
    (corners.collect(), triangles)
}

fn cuboid(size: [f64; 3]) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let [x, y, z] = size.map(|v| 0.5 * v);
    prism(&[[-x, -y], [x, -y], [x, y], [-x, y]], -z, z)
}

fn posed(mesh: &(Vec<[f64; 3]>, Vec<[u32; 3]>), to_world: DAffine3) -> Vec<StablePose> {
    poses_of(&scene(&mesh.0, &mesh.1, to_world)).expect("poses")
}

fn probability_along(poses: &[StablePose], direction: DVec3) -> f64 {
    poses.iter().filter(|pose| pose.normal.dot(direction) > 0.999).map(|pose| pose.probability).sum()
}

/// The share of the sphere that a rectangle a x b covers, seen from above its middle at the height c / 2: the solid angle
/// 4 asin(a b / sqrt((a² + c²)(b² + c²))) over 4 pi.
fn share(a: f64, b: f64, c: f64) -> f64 {
    (a * b / ((a * a + c * c) * (b * b + c * c)).sqrt()).asin() / PI
}

#[test]
fn a_cuboid_falls_on_its_sides_by_their_solid_angles() {
    let [a, b, c] = [0.01, 0.02, 0.005];
    let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_z(0.3), DVec3::new(1.0, 2.0, 3.0));
    let poses = posed(&cuboid([a, b, c]), turned);
    assert_eq!(poses.len(), 6);
    let expected = [share(b, c, a), share(a, c, b), share(a, b, c)];
    assert!((2.0 * expected.iter().sum::<f64>() - 1.0).abs() < 1e-12, "they cover the sphere");
    for (axis, expected) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().zip(expected) {
        for side in [axis, -axis] {
            let found = probability_along(&poses, turned.transform_vector3(side));
            // The corners are f32.
            assert!((found - expected).abs() < 1e-6, "{side}: {found} and {expected}");
        }
    }
    // Draws of many images.
    let mut counts = vec![0u64; 6];
    for index in 0..60_000 {
        let pose = choose(&poses, Draws { seed: 5, index }.uniform("place[part].rest")).expect("a pose");
        counts[poses.iter().position(|other| *other == pose).expect("one of them")] += 1;
    }
    let expected: Vec<f64> = poses.iter().map(|pose| 60_000.0 * pose.probability).collect();
    chi_squared(&counts, &expected).assert(1e-9, "poses of a cuboid");
}

#[test]
fn a_cube_has_six_poses_and_a_scale_changes_them() {
    let cube = cuboid([0.02; 3]);
    for pose in posed(&cube, DAffine3::IDENTITY) {
        assert!((pose.probability - 1.0 / 6.0).abs() < 1e-12, "{pose:?}");
    }
    // A grid of points on its surface and inside has the same hull. It is larger than one call of the crate.
    let steps = |n: u32| (0..20).map(move |i| (f64::from(i), n));
    let points: Vec<[f64; 3]> =
        steps(0).flat_map(|(x, _)| steps(0).flat_map(move |(y, _)| steps(0).map(move |(z, _)| [x, y, z]))).collect();
    let triangles: Vec<[u32; 3]> = (0..points.len() as u32 - 2).map(|i| [i, i + 1, i + 2]).collect();
    let poses = posed(&(points, triangles), DAffine3::IDENTITY);
    assert_eq!(poses.len(), 6);
    assert!(poses.iter().all(|pose| (pose.probability - 1.0 / 6.0).abs() < 1e-9), "{poses:?}");
    // Scaled unevenly and mirrored, it is a cuboid.
    let stretched = DAffine3::from_scale(DVec3::new(-1.0, 3.0, 2.0));
    let poses = posed(&cube, stretched);
    for (side, expected) in
        [(DVec3::X, share(3.0, 2.0, 1.0)), (DVec3::NEG_Y, share(1.0, 2.0, 3.0)), (DVec3::Z, share(1.0, 3.0, 2.0))]
    {
        let found = probability_along(&poses, side);
        assert!((found - expected).abs() < 1e-9, "{side}: {found} and {expected}");
    }
}

#[test]
fn the_facet_of_a_pose_lies_below_after_its_rotation() {
    let [x, y] = [0.003, 0.004];
    let mesh = prism(&[[0.0, 0.0], [x, 0.0], [0.0, y]], 0.0, 0.002);
    let tilted = DAffine3::from_quat(DQuat::from_rotation_x(0.7)) * DAffine3::from_rotation_y(0.4);
    for to_world in [tilted, tilted * DAffine3::from_scale(DVec3::new(1.0, -1.0, 1.0))] {
        for pose in posed(&mesh, to_world) {
            let rested = DAffine3::from_quat(pose.rotation()) * to_world;
            let mut heights: Vec<f64> = mesh.0.iter().map(|p| rested.transform_point3(DVec3::from(*p)).y).collect();
            heights.sort_by(f64::total_cmp);
            assert!(heights[2] - heights[0] < 1e-8, "three corners rest: {heights:?}");
            assert!(heights[5] - heights[0] > 1e-4);
        }
    }
}

/// A rod of the length 20 and the width 1 with pyramids on its ends: it cannot stand on a side of a pyramid.
#[test]
fn a_pointed_rod_never_stands_and_a_long_one_hardly() {
    let ring = |y: f64| [[-0.5, y, -0.5], [-0.5, y, 0.5], [0.5, y, 0.5], [0.5, y, -0.5]];
    let mut points: Vec<[f64; 3]> = [ring(-10.0), ring(10.0)].concat();
    points.extend([[0.0, -12.0, 0.0], [0.0, 12.0, 0.0]]);
    let mut triangles = Vec::new();
    for i in 0..4u32 {
        let j = (i + 1) % 4;
        triangles.extend([[i, j, 4 + j], [i, 4 + j, 4 + i], [4 + i, 4 + j, 9], [j, i, 8]]);
    }
    let poses = posed(&(points, triangles), DAffine3::IDENTITY);
    assert_eq!(poses.len(), 4, "{poses:?}");
    assert!(poses.iter().all(|pose| pose.normal.y.abs() < 1e-9 && (pose.probability - 0.25).abs() < 1e-9));

    let rod = posed(&cuboid([1.0, 100.0, 1.0]), DAffine3::IDENTITY);
    let standing = probability_along(&rod, DVec3::Y) + probability_along(&rod, DVec3::NEG_Y);
    assert!((standing - 2.0 * share(1.0, 1.0, 100.0)).abs() < 1e-12 && standing < 1e-4, "{standing}");
}

/// A slanted prism whose centre of mass is not above its base: (0, 0), (1, 0), (4, 1), (3, 1) over the depth 1.
#[test]
fn an_unstable_facet_passes_its_probability_on() {
    let corners = [[0.0, 0.0], [1.0, 0.0], [4.0, 1.0], [3.0, 1.0]];
    let poses = posed(&prism(&corners, 0.0, 1.0), DAffine3::IDENTITY);
    assert_eq!(poses.len(), 4, "{poses:?}");
    let slope = DVec3::new(1.0, -3.0, 0.0).normalize();
    let [front, slanted] = [DVec3::Z, slope].map(|normal| probability_along(&poses, normal));
    for (normal, same) in [(DVec3::NEG_Z, front), (-slope, slanted)] {
        assert!((probability_along(&poses, normal) - same).abs() < 1e-9, "point symmetry");
    }
    assert!((2.0 * (front + slanted) - 1.0).abs() < 1e-9);
    // Without the base a slanted side has less: the share of directions that meet it from the centre (2, 0.5, 0.5).
    let (n, mut hits) = (200_000, [0u32; 3]);
    let draws = Draws { seed: 1, index: 0 };
    let mut stream = draws.stream("directions");
    for _ in 0..n {
        let [u, v] = [(); 2].map(|()| crate::draws::uniform(&mut stream));
        let (z, angle) = (2.0 * u - 1.0, 2.0 * PI * v);
        let d = DVec3::new((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin(), z);
        let center = DVec3::new(2.0, 0.5, 0.5);
        // Base y = 0, slanted side x - 3 y = 1, front z = 1: the first plane that the ray meets.
        let planes = [(DVec3::NEG_Y, 0.0), (DVec3::new(1.0, -3.0, 0.0), 1.0), (DVec3::Z, 1.0)];
        let others = [(DVec3::Y, 1.0), (DVec3::new(-1.0, 3.0, 0.0), 0.0), (DVec3::NEG_Z, 0.0)];
        let reach = |(normal, offset): &(DVec3, f64)| {
            let speed = normal.dot(d);
            if speed > 0.0 { (offset - normal.dot(center)) / speed } else { f64::INFINITY }
        };
        let all: Vec<f64> = planes.iter().chain(&others).map(reach).collect();
        let first = (0..6).min_by(|a, b| all[*a].total_cmp(&all[*b])).expect("six");
        if first < 3 {
            hits[first] += 1;
        }
    }
    let share = |count: u32| f64::from(count) / f64::from(n);
    let (base, side, face) = (share(hits[0]), share(hits[1]), share(hits[2]));
    for (found, expected) in [(slanted, base + side), (front, face)] {
        let error = (expected * (1.0 - expected) / f64::from(n)).sqrt();
        z_test(expected, error, found).assert(1e-9, "the slanted side with the base, or the front");
    }
    assert!(base > 0.01, "{hits:?}");
}

#[test]
fn the_centre_of_mass_is_that_of_the_volume_or_of_the_hull() {
    let l = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
    let (points, mut triangles) = prism(&l, 0.0, 1.0);
    let body = |triangles: &[[u32; 3]]| {
        let scene = scene(&points, triangles, DAffine3::IDENTITY);
        body_of(&[scene.meshes[0].mesh.clone()]).expect("a body")
    };
    // Two squares of the areas 2 and 1.
    let expected = DVec3::new((2.0 + 0.5) / 3.0, (1.0 + 1.5) / 3.0, 0.5);
    assert!((body(&triangles).center - expected).length() < 1e-9);
    let inward: Vec<[u32; 3]> = triangles.iter().map(|t| [t[0], t[2], t[1]]).collect();
    assert!((body(&inward).center - expected).length() < 1e-9, "wound inward");
    // The hull has a triangle of the area 1/2 more, with its centre at 4/3.
    triangles.pop();
    let open = body(&triangles);
    let of_hull = DVec3::new((2.5 + 0.5 * 4.0 / 3.0) / 3.5, (2.5 + 0.5 * 4.0 / 3.0) / 3.5, 0.5);
    assert!((open.center - of_hull).length() < 1e-9, "{}", open.center);
    assert!((open.hull.volume - 3.5).abs() < 1e-9);
}

#[test]
fn flat_objects_have_two_poses_and_lines_none() {
    let sheet = vec![[0.0, 0.0, 0.0], [0.03, 0.0, 0.01], [0.03, 0.02, 0.01], [0.0, 0.02, 0.0]];
    let poses = posed(&(sheet, vec![[0, 1, 2], [0, 2, 3]]), DAffine3::IDENTITY);
    assert_eq!(poses.iter().map(|pose| pose.probability).collect::<Vec<_>>(), [0.5, 0.5]);
    assert!(poses[0].normal.dot(poses[1].normal) < -0.999);
    // A sheet of paper is thick enough for its edges to count.
    let paper = posed(&cuboid([0.2, 0.3, 1e-4]), DAffine3::IDENTITY);
    assert!((probability_along(&paper, DVec3::Z) - share(0.2, 0.3, 1e-4)).abs() < 1e-6 && paper.len() >= 2);
    for points in [
        vec![[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [2.0, 2.0, 2.0]],
        vec![[1.0, 1.0, 1.0]; 3],
        vec![[f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
    ] {
        assert!(poses_of(&scene(&points, &[[0, 1, 2]], DAffine3::IDENTITY)).is_err(), "{points:?}");
    }
    let flattened = DAffine3::from_scale(DVec3::new(1.0, 0.0, 0.0));
    assert!(poses_of(&scene(&cuboid([1.0; 3]).0, &cuboid([1.0; 3]).1, flattened)).is_err());
}

/// A ball of many facets, with its hull in parts: no facet is preferred, and the poses add up.
#[test]
fn a_ball_of_many_corners_rests_on_all_sides() {
    let n = 6000;
    let golden = PI * (3.0 - 5f64.sqrt());
    let points: Vec<[f64; 3]> = (0..n)
        .map(|i| {
            let (y, angle) = (1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(n), golden * f64::from(i));
            let r = (1.0 - y * y).sqrt();
            [r * angle.cos(), y, r * angle.sin()]
        })
        .collect();
    let triangles: Vec<[u32; 3]> = (0..n as u32 - 2).map(|i| [i, i + 1, i + 2]).collect();
    let poses = posed(&(points, triangles), DAffine3::IDENTITY);
    assert!(poses.len() > 3000, "{}", poses.len());
    assert!((poses.iter().map(|pose| pose.probability).sum::<f64>() - 1.0).abs() < 1e-9);
    let upper: f64 = poses.iter().filter(|pose| pose.normal.y > 0.0).map(|pose| pose.probability).sum();
    assert!((upper - 0.5).abs() < 0.01, "{upper}");
}
