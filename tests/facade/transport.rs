//! Light transport against closed forms and quadrature: what a small scene must send to the camera.
//!
//! Each scene shows the same radiance in every pixel, so the pixel means are independent samples of one number. The
//! false-alarm rate of each check is that of a `testkit::Claim`, 1.4e-13. Replay: `cargo test -p dunkelfeld --test it transport::NAME`.

use crate::support::{
    Add, absorbing, black, build, emitter, f_cos, film, floor, integrate, lit_by_panel, plastic_bsdf, settings, sky,
    spot_camera, square, view,
};
use dunkelfeld::geometry::{DAffine3, DVec3, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::shapes::{cuboid, rectangle};
use dunkelfeld::scene::{AlphaMode, Material, PunctualKind, PunctualLight, SceneBuilder};
use dunkelfeld_bsdf::Bsdf;
use std::f64::consts::PI;

/// Renders a 16 x 16 image and compares its mean with the expectation.
fn check(builder: SceneBuilder, spp: f64, expected: f64, what: &str) {
    crate::support::must_be(&build(builder), spp, 7, 1, expected, what);
}

/// The plastic floor seen from above at an angle, with nothing else.
fn floor_scene() -> (SceneBuilder, Bsdf, DVec3) {
    let mut b = floor(1.0);
    spot_camera(&mut b, view() * 4.0, DVec3::ZERO, 1e-4);
    (b, plastic_bsdf(), view())
}

#[test]
fn an_emitter_shows_its_radiance_on_the_front_only() {
    for (turned, expected) in [(false, 3.0), (true, 0.0)] {
        let mut b = SceneBuilder::default();
        b.add("light", square(0.0, 1.0, turned), emitter(3.0));
        spot_camera(&mut b, DVec3::Z, DVec3::ZERO, 0.1);
        let film = film(&build(b), &settings(8, 8, 4.0, 1));
        assert!(film.mean().data().iter().all(|p| *p == [expected; 3]));
    }
}

#[test]
fn a_single_triangle_light_and_a_two_sided_one() {
    for double_sided in [false, true] {
        let (mut b, bsdf, wo) = floor_scene();
        let m = b.add_material(Material { double_sided, ..emitter(5.0) });
        let mut mesh = square(0.4, 0.4, !double_sided);
        mesh.triangles.truncate(1);
        let corners = mesh.corners(0).map(|c| c.as_dvec3());
        b.add_object("light", mesh, m);
        let expected = integrate(400, |u, v| {
            // The square folded onto the triangle keeps areas.
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let p = corners[0] + u * (corners[1] - corners[0]) + v * (corners[2] - corners[0]);
            let (d2, wi) = (p.length_squared(), p.normalize());
            0.08 * 5.0 * wi.z / d2 * f_cos(&bsdf, DVec3::Z, wo, wi)
        });
        check(b, 256.0, expected, &format!("triangle light, double-sided {double_sided}"));
    }
}

/// Panels in a ring around the floor, so many of them that the first surface samples each, one of them, or a tree; with a point
/// above. Scattering finds the panels too, with the weights of multiple importance sampling: the sum of the quadratures.
#[test]
fn panels_in_a_ring_sampled_one_by_one_and_by_a_tree() {
    for count in [3, 20, 90] {
        let (mut b, bsdf, wo) = floor_scene();
        let mut expected = 0.0;
        for i in 0..count {
            let turn = 2.0 * PI * f64::from(i) / f64::from(count);
            let (sin, cos) = turn.sin_cos();
            let center = DVec3::new(0.4 * cos, 0.4 * sin, 0.3);
            // As wide as the ring leaves room for, upright, and turned toward its axis.
            let u = DVec3::new(-sin, cos, 0.0) * (1.2 / f64::from(count)).min(0.3);
            let v = DVec3::new(0.05 * cos, 0.05 * sin, 0.1);
            let radiance = 1.0 + f64::from(i % 3);
            let m = b.add_material(emitter(radiance as f32));
            let mesh = rectangle((center - 0.5 * (u + v)).as_vec3(), v.as_vec3(), u.as_vec3());
            let normal = v.cross(u).normalize();
            assert!(normal.dot(center) < 0.0, "the front faces the floor");
            b.add_object("panel", mesh, m);
            expected += lit_by_panel(wo, center - 0.5 * (u + v), u, v, radiance, 60);
        }
        let position = DVec3::new(0.05, -0.1, 0.6);
        b.lights.push(PunctualLight {
            name: "lamp".into(),
            to_world: DAffine3::from_translation(position),
            kind: PunctualKind::Point { intensity: Rgb::splat(0.1) },
        });
        expected += 0.1 / position.length_squared() * f_cos(&bsdf, DVec3::Z, wo, position.normalize());
        check(b, 256.0, expected, &format!("{count} panels"));
    }
}

#[test]
fn a_floor_under_a_constant_sky() {
    // L = Le times the directional albedo: integral of f cos over the hemisphere, by quadrature.
    let (mut b, bsdf, wo) = floor_scene();
    b.environment = sky(1.5);
    let expected = 1.5
        * 2.0
        * PI
        * integrate(600, |u, v| {
            let (z, phi) = (u, 2.0 * PI * v);
            let r = (1.0 - z * z).sqrt();
            f_cos(&bsdf, DVec3::Z, wo, DVec3::new(r * phi.cos(), r * phi.sin(), z))
        });
    check(b, 256.0, expected, "constant sky");
}

#[test]
fn a_clear_slab_in_front_of_an_emitter() {
    // Normal incidence: R = ((n-1)/(n+1))^2 at each face, a = exp(-sigma d) in between. Summed over internal reflections
    // T = (1-R)^2 a / (1 - R^2 a^2). What is reflected back to the black camera side is lost; the emitter is black.
    let (ior, thickness, color, distance) = (1.49f64, 0.004f64, 0.5f64, 0.01f64);
    let mut b = SceneBuilder::default();
    b.add(
        "slab",
        cuboid(Vec3::new(-0.1, -0.1, 0.0), Vec3::new(0.1, 0.1, thickness as f32)),
        absorbing(ior as f32, color as f32, distance as f32),
    );
    b.add("light", square(-0.05, 0.5, false), emitter(2.0));
    spot_camera(&mut b, DVec3::Z, DVec3::ZERO, 0.01);
    let r = ((ior - 1.0) / (ior + 1.0)).powi(2);
    let a = (color.ln() * thickness / distance).exp();
    let expected = 2.0 * (1.0 - r).powi(2) * a / (1.0 - r * r * a * a);
    check(b, 1024.0, expected, "slab");
}

#[test]
fn coverage_lets_light_pass_straight_and_in_shadows() {
    // A black sheet of coverage 0.3 between light and floor, and another between floor and camera: the light is
    // multiplied by 0.7 twice.
    let (mut b, _, wo) = floor_scene();
    b.add("light", square(0.5, 0.2, true), emitter(5.0));
    let veil = b.add_material(Material { alpha: 0.3.into(), alpha_mode: AlphaMode::Blend, ..black() });
    b.add_object("veil", square(0.45, 0.6, false), veil);
    b.add_object("lens cap", square(1.5, 6.0, false), veil);
    b.add(
        "cut out",
        square(0.3, 1.0, false),
        Material { alpha: 0.4.into(), alpha_mode: AlphaMode::Mask { cutoff: 0.5 }, ..black() },
    );
    let expected = 0.7 * 0.7 * lit_by_panel(wo, DVec3::new(-0.1, -0.1, 0.5), DVec3::X * 0.2, DVec3::Y * 0.2, 5.0, 300);
    check(b, 1024.0, expected, "coverage");
}

#[test]
fn instances_shine_and_reflect_like_copies() {
    // The rectangle light, once baked, once as an instance under a mirroring, uneven transform that gives the same shape.
    let (mut b, _, wo) = floor_scene();
    let m = b.add_material(emitter(5.0));
    let mut mesh = square(0.25, 0.1, true);
    // Enough triangles that copies stay instances: a fan of tiny squares far below the floor belongs to the mesh.
    for k in 0..20_000 {
        let base = mesh.positions.len() as u32;
        let z = -1.0 - k as f32 * 1e-4;
        mesh.positions.extend([Vec3::new(0.0, 0.0, z), Vec3::new(1e-4, 0.0, z), Vec3::new(0.0, 1e-4, z)]);
        mesh.triangles.push([base, base + 2, base + 1]);
    }
    mesh.uvs[0].clear();
    b.add_object("light", mesh, m);
    b.instances[1].to_world = DAffine3::from_scale(DVec3::new(-4.0, 4.0, 2.0));
    let mut again = b.instances[1].clone();
    again.to_world = DAffine3::from_translation(DVec3::new(0.0, 0.0, -50.0));
    b.instances.push(again);
    let expected = lit_by_panel(wo, DVec3::new(-0.2, -0.2, 0.5), DVec3::X * 0.4, DVec3::Y * 0.4, 5.0, 400);
    let scene = build(b);
    assert_eq!(scene.summary().instanced_parts, 2, "the meshes must stay instanced for this test to mean anything");
    crate::support::must_be(&scene, 512.0, 7, 1, expected, "instanced light");
}
