//! Family 6, light: tiny and enormous at once, touching what it lights, seen from its own plane, a sun in the sky, ten
//! thousand lamps, and none.
//!
//! Hard, because sampling a light divides by its area, its solid angle and the square of its distance, and each of them can
//! be 0 or 1e-12. A spherical rectangle of 1e-12 sr has inner angles that sum to 2 pi but for rounding; a point in the
//! light's plane sees it under no angle at all; a point that touches it sees it under half of the sphere. A table of ten
//! thousand lamps must find the bright ones, and a scene without light must not divide by its power.
//!
//! Must give: `L A cos cos / d^2` times the BSDF for the tiny, quadrature for what has an extent, zero from the light's own
//! plane and from behind, and black, not NaN, in the dark.

use super::support::{
    Terms, f_cos, floor, gives, integrate, lit_by_panel, moved, pixel_means, plastic_bsdf, sky, spot, terms, view,
};
use crate::support::{Add, black, build, emitter, square};
use dunkelfeld::geometry::{DAffine3, DVec3, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::shapes::rectangle;
use dunkelfeld::scene::{
    ColorEncoding, Environment, EnvironmentSource, Image, ImageId, Material, Parameter, PunctualKind, PunctualLight,
    SceneBuilder, Texels, Texture,
};
use std::f64::consts::PI;

#[test]
fn a_square_micrometre_of_a_terawatt() {
    // The emitter hangs over the middle, where its corners are f32 numbers; as a rectangle, and as a single triangle.
    for (side, radiance) in [(1e-6f32, 1e12f32), (1e-5, 1e10), (1e-3, 1e6)] {
        for triangle in [false, true] {
            let mut b = floor(1.0);
            let m = b.add_material(emitter(radiance));
            let mut mesh = square(0.5, side, true);
            if triangle {
                mesh.triangles.truncate(1);
            }
            let third = mesh.corners(0).map(|c| c.as_dvec3() / 3.0);
            let middle = if triangle { third[0] + third[1] + third[2] } else { DVec3::Z * 0.5 };
            b.add_object("light", mesh, m);
            spot(&mut b, view() * 4.0, DVec3::ZERO, 1e-5);
            let area = f64::from(side).powi(2) * if triangle { 0.5 } else { 1.0 };
            let wi = middle.normalize();
            let light = f64::from(radiance) * area * wi.z / middle.length_squared();
            let expected = light * f_cos(&plastic_bsdf(), DVec3::Z, view(), wi);
            let what = format!("{side} m, {radiance} W/(m^2 sr), triangle {triangle}");
            // The finite size costs a relative 2 (side / d)^2, the spot of 10 um as much.
            gives(&build(b), expected, Terms { spp: 64.0, sure: 1e-4, rounding: 2e-5 }, &what);
        }
    }
}

#[test]
fn a_wall_of_light_that_touches_the_floor() {
    // The wall x = 0 stands on the floor and shines toward +x. A point at a distance far below its size sees it fill half of
    // the sky: the integral over the directions with x < 0.
    let half_sky = 2.0
        * PI
        * integrate(800, |u, v| {
            let r = (1.0 - u * u).sqrt();
            let wi = DVec3::new(r * (2.0 * PI * v).cos(), r * (2.0 * PI * v).sin(), u);
            if wi.x < 0.0 { 3.0 * f_cos(&plastic_bsdf(), DVec3::Z, view(), wi) } else { 0.0 }
        });
    for distance in [1e-3f64, 1e-4, 1e-5, 1e-6] {
        let mut b = floor(2.0);
        let m = b.add_material(emitter(3.0));
        b.add_object("wall", rectangle(Vec3::new(0.0, -0.5, 0.0), Vec3::Y, Vec3::Z), m);
        let target = DVec3::new(distance, 0.0, 0.0);
        spot(&mut b, target + view(), target, (1e-2 * distance) as f32);
        // What is missing of the half: the wall ends 0.5 m away, so at an angle of distance / 0.5. And the place is rounded:
        // the middle of the scene is 0.5 m above the floor.
        let terms = Terms { spp: 256.0, sure: 5e-3, rounding: 1e-4 + 4.0 * distance + 6e-8 / distance * 0.02 };
        gives(&build(b), half_sky, terms, &format!("{distance} m from the wall"));
    }
}

#[test]
fn a_light_gives_nothing_in_its_own_plane_and_behind_it() {
    // Floor and panel in one plane; the panel turned away; a wall of light whose plane holds the point.
    let in_plane = |turned: bool, double_sided: bool| {
        let mut b = floor(1.0);
        b.add("light", moved(square(0.0, 0.2, turned), DVec3::X * 0.7), Material { double_sided, ..emitter(1e6) });
        spot(&mut b, view() * 2.0, DVec3::new(0.013, 0.007, 0.0), 1e-3);
        build(b)
    };
    for (turned, double_sided) in [(false, false), (true, false), (false, true)] {
        let what = format!("turned {turned}, both sides {double_sided}");
        gives(&in_plane(turned, double_sided), 0.0, terms(64.0, 0.0), &what);
    }
    for double_sided in [false, true] {
        let mut b = floor(1.0);
        let m = b.add_material(Material { double_sided, ..emitter(1e6) });
        b.add_object("wall", rectangle(Vec3::new(0.0, 0.1, 0.1), Vec3::Y * 0.3, Vec3::Z * 0.3), m);
        // On the line x = 0 and beside it by less than a rounding of the light's own corners.
        spot(&mut b, view() * 2.0, DVec3::ZERO, 1e-12);
        let mean = pixel_means(&build(b), 64.0, 5, "edge-on").mean();
        // The spot is rounded to 1e-7 m and seen from there the wall's cosine is 1e-6 at most: L A cos cos / d^2 f.
        assert!(mean < 1e6 * 0.09 * 1e-6 / 0.04 * 0.3, "in the wall's plane: {mean}");
    }
}

#[test]
fn a_light_seen_almost_edge_on() {
    // The wall's plane passes the point at a distance that makes its cosine 1e-3 to 1e-5: the light goes down with it.
    for offset in [1e-3f64, 1e-4, 1e-5] {
        let mut b = floor(1.0);
        let m = b.add_material(emitter(1e5));
        let wall = rectangle(Vec3::new(0.0, 0.1, 0.1), Vec3::Y * 0.25, Vec3::Z * 0.25);
        b.add_object("wall", wall, m);
        let target = DVec3::new(offset, 0.0, 0.0);
        spot(&mut b, target + view(), target, (1e-3 * offset) as f32);
        let corner = DVec3::new(-offset, 0.1, 0.1);
        let expected = lit_by_panel(view(), corner, DVec3::Y * 0.25, DVec3::Z * 0.25, 1e5, 300);
        // The place of the point is rounded to 6e-8 m.
        let terms = Terms { spp: 256.0, sure: 5e-3, rounding: 1e-4 + 6e-8 / offset };
        gives(&build(b), expected, terms, &format!("{offset} m from the wall's plane"));
    }
}

#[test]
fn a_sun_in_a_dim_sky() {
    // One texel of 1024 x 512, a third of a degree wide like the sun, a billion times as bright as the sky around it.
    let (w, h, i, j) = (1024u32, 512u32, 300u32, 140u32);
    let (sun, dim) = (1e7f32, 1e-2f32);
    let mut texels = vec![[dim; 3]; (w * h) as usize];
    texels[(j * w + i) as usize] = [sun; 3];
    let mut b = SceneBuilder::default();
    let m = b.add_material(super::support::plastic());
    // The sky's pole is +y, so the floor faces +y.
    b.add_object("floor", rectangle(Vec3::new(-0.5, 0.0, 0.5), Vec3::X, Vec3::NEG_Z), m);
    b.images.push(Image { name: "sky".into(), width: w, height: h, texels: Texels::RgbF32(texels).into() });
    let source = EnvironmentSource::Image { image: ImageId(0), scale: Rgb::WHITE };
    b.environment = Some(Environment { source, rotation: 0.0 });
    let wo = DVec3::new(0.6, 0.7, 0.36).normalize();
    spot(&mut b, wo * 4.0, DVec3::ZERO, 1e-4);
    let bsdf = plastic_bsdf();
    let of_texel = |u: f64, v: f64| {
        let (theta, phi) =
            (PI * (f64::from(j) + v) / f64::from(h), 2.0 * PI * ((f64::from(i) + u) / f64::from(w) - 0.5));
        let wi = DVec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos());
        theta.sin() * f_cos(&bsdf, DVec3::Y, wo, wi)
    };
    let from_sun = f64::from(sun) * 2.0 * PI * PI / f64::from(w * h) * integrate(20, of_texel);
    let from_sky = f64::from(dim)
        * 2.0
        * PI
        * integrate(300, |u, v| {
            let r = (1.0 - u * u).sqrt();
            f_cos(&bsdf, DVec3::Y, wo, DVec3::new(r * (2.0 * PI * v).cos(), u, r * (2.0 * PI * v).sin()))
        });
    gives(&build(b), from_sun + from_sky, Terms { spp: 64.0, sure: 1e-3, rounding: 2e-5 }, "a sun");
}

#[test]
fn ten_thousand_lamps_are_the_sum_of_each() {
    // A ceiling of 100 x 100 panels of 1 mm; one in a hundred is a hundred times as bright. And as many point lights.
    let place = |k: u32| DVec3::new(f64::from(k % 100) * 0.01 - 0.495, f64::from(k / 100) * 0.01 - 0.495, 0.4);
    let strength = |k: u32| if k % 101 == 7 { 300.0 } else { 3.0 };
    let bsdf = plastic_bsdf();
    let sum = |of: &dyn Fn(u32, DVec3) -> f64| -> f64 { (0..10_000).map(|k| of(k, place(k))).sum() };
    for punctual in [false, true] {
        let mut b = floor(2.0);
        let [dim, bright] = [3.0f32, 300.0].map(|l| b.add_material(emitter(l)));
        for k in 0..10_000 {
            if punctual {
                let to_world = DAffine3::from_translation(place(k));
                let kind = PunctualKind::Point { intensity: Rgb::splat(strength(k) as f32 * 1e-6) };
                b.lights.push(PunctualLight { name: String::new(), to_world, kind });
            } else {
                let panel = moved(square(0.0, 1e-3, true), place(k));
                b.add_object("lamp", panel, if strength(k) > 3.0 { bright } else { dim });
            }
        }
        spot(&mut b, view() * 0.5, DVec3::ZERO, 1e-5);
        let expected = sum(&|k, p| {
            let wi = p.normalize();
            let cos = if punctual { 1.0 } else { wi.z };
            strength(k) * 1e-6 * cos / p.length_squared() * f_cos(&bsdf, DVec3::Z, view(), wi)
        });
        // A panel of 1 mm at 0.4 m is a point but for 2e-5.
        let what = format!("10 000 lamps, punctual {punctual}");
        gives(&build(b), expected, Terms { spp: 256.0, sure: 1e-2, rounding: 1e-4 }, &what);
    }
}

#[test]
fn in_the_dark_there_is_nothing() {
    // No light at all; lights of no strength of every kind; emission that a texture takes away; and a black sky.
    let dark = |add: &dyn Fn(&mut SceneBuilder)| {
        let mut b = floor(1.0);
        add(&mut b);
        spot(&mut b, view() * 4.0, DVec3::ZERO, 0.1);
        gives(&build(b), 0.0, terms(16.0, 0.0), "in the dark");
    };
    let black_image = |b: &mut SceneBuilder| {
        b.images.push(Image {
            name: "night".into(),
            width: 2,
            height: 2,
            texels: Texels::RgbF32(vec![[0.0; 3]; 4]).into(),
        });
        ImageId(0)
    };
    dark(&|_| {});
    dark(&|b| b.environment = sky(0.0));
    dark(&|b| {
        let source = EnvironmentSource::Image { image: black_image(b), scale: Rgb::WHITE };
        b.environment = Some(Environment { source, rotation: 0.3 });
    });
    dark(&|b| {
        let texture = Some(Texture::new(black_image(b), ColorEncoding::Linear));
        b.add(
            "off",
            square(0.5, 0.2, true),
            Material { emission: Parameter { factor: Rgb::splat(5.0), texture }, ..emitter(5.0) },
        );
    });
    dark(&|b| {
        let kinds = [
            PunctualKind::Point { intensity: Rgb::BLACK },
            PunctualKind::Spot { intensity: Rgb::BLACK, inner: 0.0, outer: 0.5 },
            PunctualKind::Directional { irradiance: Rgb::BLACK },
        ];
        for kind in kinds.into_iter().cycle().take(100) {
            let to_world = DAffine3::from_translation(DVec3::Z);
            b.lights.push(PunctualLight { name: String::new(), to_world, kind });
        }
    });
}

#[test]
fn one_lamp_among_ten_thousand_dead_ones() {
    // The others have no strength, no extent to speak of, or shine the other way: all light comes from one.
    let mut b = floor(1.0);
    let [off, on] = [b.add_material(black()), b.add_material(emitter(50.0))];
    let away = b.add_material(emitter(1e3));
    for k in 0..5_000 {
        let at = DVec3::new(f64::from(k % 100) * 0.01 - 0.5, f64::from(k / 100) * 0.02 - 0.5, 0.4);
        b.add_object("off", moved(square(0.0, 1e-3, true), at), off);
        b.add_object("away", moved(square(0.0, 1e-6, false), at + DVec3::Z * 1e-3), away);
    }
    b.add_object("on", square(0.3, 0.02, true), on);
    spot(&mut b, view() * 0.3, DVec3::ZERO, 1e-5);
    let expected = lit_by_panel(view(), DVec3::new(-0.01, -0.01, 0.3), DVec3::X * 0.02, DVec3::Y * 0.02, 50.0, 40);
    gives(&build(b), expected, Terms { spp: 256.0, sure: 1e-2, rounding: 2e-5 }, "one lamp");
}

#[test]
fn a_point_light_on_the_very_surface() {
    // At the surface the irradiance of a point light has no value; it must still be a number, and beside it be I cos / d^2.
    let scene = |target: DVec3| {
        let mut b = floor(1.0);
        let kind = PunctualKind::Point { intensity: Rgb::WHITE };
        b.lights.push(PunctualLight {
            name: "spark".into(),
            to_world: DAffine3::from_translation(DVec3::Z * 1e-6),
            kind,
        });
        spot(&mut b, target + view(), target, 1e-9);
        build(b)
    };
    assert!(pixel_means(&scene(DVec3::ZERO), 16.0, 1, "under the spark").mean() > 0.0);
    let target = DVec3::X * 1e-3;
    let wi = DVec3::new(-1e-3, 0.0, 1e-6);
    let expected = f_cos(&plastic_bsdf(), DVec3::Z, view(), wi.normalize()) / wi.length_squared();
    gives(&scene(target), expected, Terms { spp: 4.0, sure: 1e-3, rounding: 1e-3 }, "a millimetre beside the spark");
}
