//! Family 4, limits: parameters at the ends of their ranges and beyond what nature has, in whole renders.
//!
//! Hard, because a limit is often another formula: roughness 0 is a mirror without a density, an index of 1 is no surface,
//! one below 1 reflects totally from outside, and with 1000 light stays inside for hundreds of reflections. Code that
//! changes formulas at a threshold shows a step there; code that does not divides zero by zero. A medium of a million per
//! metre has an exponential that underflows, and one of zero a distance that is infinite.
//!
//! Must give: the value of the limit on both sides of every threshold.

use super::support::{
    Terms, absorbing, clear, fresnel, gives, pixel_means, same, sky, spot, terms, through_faces, two_halves, view,
};
use crate::support::{Add, build, emitter, square};
use dunkelfeld::geometry::{DVec3, Vec3, Vec4};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::shapes::cuboid;
use dunkelfeld::scene::{Anisotropy, Clearcoat, Material, Scene, SceneBuilder, Sheen, Specular, Surface, Volume};

/// A plate of 4 mm in the plane y = 0 under a sky, seen at an angle \[rad\].
fn plate(material: Material, angle: f64, above: f32, below: f32) -> Scene {
    let mut b = SceneBuilder::default();
    b.add("plate", cuboid(Vec3::new(-2.0, -0.004, -2.0), Vec3::new(2.0, 0.0, 2.0)), material);
    two_halves(&mut b, above, below);
    spot(&mut b, 0.2 * DVec3::new(angle.sin(), angle.cos(), 0.0), DVec3::ZERO, 1e-5);
    build(b)
}

/// A floor of a material under a white sky.
fn floor(material: Material) -> Scene {
    let mut b = SceneBuilder::default();
    let m = b.add_material(material);
    let mut mesh = square(0.0, 1.0, false);
    mesh.tangents = vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4];
    b.add_object("floor", mesh, m);
    b.environment = sky(1.0);
    spot(&mut b, view(), DVec3::ZERO, 1e-4);
    build(b)
}

#[test]
fn roughness_toward_zero_is_the_mirror() {
    // A white metal loses nothing as its facets align: of alpha = 1e-2 already less than 1e-3.
    for roughness in [0.0f32, 1e-4, 1e-3, 1e-2, 0.05, 0.1] {
        let mirror = Material { metallic: 1.0.into(), roughness: roughness.into(), ..Material::default() };
        let terms = Terms { spp: 64.0, sure: 1e-3, rounding: 1e-3 };
        gives(&floor(mirror), 1.0, terms, &format!("white metal of roughness {roughness}"));
    }
    // Where a mirror image ends on one side of the view the other side is dark: no haze from a mirror.
    for roughness in [0.0f32, 1e-3] {
        let mut b = SceneBuilder::default();
        b.add(
            "floor",
            square(0.0, 1.0, false),
            Material { metallic: 1.0.into(), roughness: roughness.into(), ..Material::default() },
        );
        let light = b.add_material(emitter(1.0));
        // The view from straight above comes back to where it was; 3 degrees beside it hangs the light.
        b.add_object("light", super::support::moved(square(1.0, 0.1, true), DVec3::X * 0.1), light);
        spot(&mut b, DVec3::Z * 0.5, DVec3::ZERO, 1e-4);
        // What the tail of alpha = 1e-3 sends 1.5 degrees off its peak and further.
        let mean = pixel_means(&build(b), 64.0, 3, "beside the mirror image").mean();
        assert!(mean < 5e-3, "{mean} beside the mirror image");
    }
}

#[test]
fn rough_glass_toward_smooth_glass() {
    // On both sides of the threshold between a delta and a lobe (roughness 0.01) a plate passes the same light.
    let angle = 0.6f64;
    let expected = through_faces(2.0, fresnel(angle, 1.5));
    for roughness in [0.0f32, 1e-4, 0.0099, 0.0101, 0.02] {
        let glass = Material { roughness: roughness.into(), ..clear(1.5) };
        for (above, below, expected) in [(0.0, 1.0, expected), (1.0, 0.0, 1.0 - expected)] {
            let sure = 2.0 * ((1.0 - expected) / expected / (256.0 * 256.0)).sqrt();
            let what = format!("roughness {roughness}, sky {above}");
            // The lobe of alpha = 4e-4 is wide enough for R to vary over it by 1e-4.
            gives(
                &plate(glass.clone(), angle, above, below),
                expected,
                Terms { spp: 256.0, sure, rounding: 5e-4 },
                &what,
            );
        }
    }
}

#[test]
fn any_index_of_refraction() {
    let angle = 0.5f64;
    for ior in [0.7f64, 0.95, 0.9999, 1.0, 1.000_000_1, 1.0005, 1.0015, 1.33, 2.42, 10.0, 1000.0] {
        let through = through_faces(2.0, fresnel(angle, ior));
        for (above, below, expected) in [(0.0, 1.0, through), (1.0, 0.0, 1.0 - through), (1.0, 1.0, 1.0)] {
            // Between faces of index 1000 light is reflected 250 times, and few paths stand for many: a thousandth is
            // known to five percent.
            let spread = if ior > 100.0 { 6.0 } else { 2.0 };
            let sure = spread * ((1.0 - expected).max(1e-3) / expected.max(1e-7) / (256.0 * 128.0)).sqrt();
            let what = format!("index {ior}, sky {above}, ground {below}");
            // Nearer to 1 than 1e-3 the reflection, below 3e-7, is that of the rounded index.
            let scene = plate(clear(ior as f32), angle, above, below);
            if expected > 1e-5 {
                gives(&scene, expected, Terms { spp: 128.0, sure, rounding: 2e-4 }, &what);
            } else {
                assert!(pixel_means(&scene, 16.0, 3, &what).mean() < 1e-3, "{what}");
            }
        }
    }
}

#[test]
fn a_rough_plate_of_matched_index_is_not_there() {
    for ior in [1.0f32, 1.0009, 0.9991] {
        let glass = Material { roughness: 0.5.into(), ..clear(ior) };
        gives(
            &plate(glass, 0.9, 0.0, 1.0),
            1.0,
            Terms { spp: 64.0, sure: 1e-3, rounding: 1e-4 },
            &format!("index {ior}"),
        );
    }
}

#[test]
fn every_corner_of_the_parameters_is_a_number_below_a_bound() {
    // Together they give no more light than arrives; the bound allows for the noise of two samples per pixel.
    let ends = [0.0f32, 1.0];
    for k in 0..256u32 {
        let end = |bit: u32| ends[(k >> bit & 1) as usize];
        let m = Material {
            metallic: end(0).into(),
            roughness: end(1).into(),
            transmission: end(2).into(),
            clearcoat: Clearcoat { strength: end(3).into(), roughness: end(4).into() },
            sheen: Sheen { color: Rgb::splat(end(5)).into(), ..Sheen::default() },
            anisotropy: Anisotropy { strength: (2.0 * end(6) - 1.0).into(), ..Anisotropy::default() },
            specular: Specular { tint: end(7), ..Specular::default() },
            base_color: Rgb::new(1.0, 0.0, 0.5).into(),
            ..Material::default()
        };
        let what = format!("{m:?}");
        let mean = pixel_means(&floor(m), 2.0, 3, &what).mean();
        assert!((0.0..1.6).contains(&mean), "{mean} of {what}");
    }
}

#[test]
fn anisotropy_of_plus_one_is_minus_one_turned() {
    let metal = |anisotropy: f32, anisotropy_rotation: f32| {
        let mut b = SceneBuilder::default();
        let base_color = Rgb::splat(0.9);
        let m = Material {
            metallic: 1.0.into(),
            roughness: 0.4.into(),
            base_color: base_color.into(),
            anisotropy: Anisotropy { strength: anisotropy.into(), rotation: anisotropy_rotation, grain: None },
            ..Material::default()
        };
        let m = b.add_material(m);
        let mut mesh = square(0.0, 1.0, false);
        mesh.tangents = vec![Vec4::new(0.8, 0.6, 0.0, 1.0); 4];
        b.add_object("floor", mesh, m);
        b.add("light", super::support::moved(square(0.7, 0.4, true), DVec3::new(-0.5, 0.1, 0.0)), emitter(3.0));
        spot(&mut b, view(), DVec3::ZERO, 1e-4);
        build(b)
    };
    let turn = std::f32::consts::FRAC_PI_2;
    same(&metal(1.0, turn), &metal(-1.0, 0.0), terms(256.0, 1e-2), "turned by a right angle");
    same(&metal(1.0, 0.3), &metal(1.0, 0.3 + 2.0 * turn), terms(256.0, 1e-2), "turned by two right angles");
}

#[test]
fn densities_of_nothing_and_of_a_million() {
    // Nothing: an attenuation distance that is infinite, or a colour of white. A million per metre: of a plate of 4 mm only
    // the reflection of the upper face is left.
    let angle = 0.7f64;
    for (color, distance) in [(1.0f32, 1e-6f32), (0.3, f32::INFINITY), (1.0, f32::INFINITY)] {
        let what = format!("colour {color} after {distance} m");
        gives(&plate(absorbing(1.5, color, distance), angle, 1.0, 1.0), 1.0, terms(64.0, 1e-3), &what);
    }
    let r = fresnel(angle, 1.5);
    for (color, distance) in [(0.367_879_4f32, 1e-6f32), (1e-38, 1e-6), (0.0, 1e-6), (0.0, 1e-30)] {
        let what = format!("colour {color} after {distance} m");
        let sure = 1.5 * ((1.0 - r) / r / (256.0 * 256.0)).sqrt();
        let terms = Terms { spp: 256.0, sure, rounding: 1e-5 };
        gives(&plate(absorbing(1.5, color, distance), angle, 1.0, 1.0), r, terms, &what);
    }
}

#[test]
fn fog_of_a_million_per_metre_without_absorption_is_white() {
    // Two free paths in two micrometres, of index 1 and 1.5, and almost none in a metre: in a white furnace they are not seen.
    for (ior, scattering, thickness) in
        [(1.0f32, 1e6f32, 2e-6f32), (1.5, 1e6, 2e-6), (1.0, 1e-6, 1.0), (1.5, 1e3, 1e-3)]
    {
        for g in [-0.9f32, 0.0, 0.99] {
            let volume = Volume { scattering: Rgb::splat(scattering), scattering_anisotropy: g, ..Volume::default() };
            let mut b = SceneBuilder::default();
            let m = b.add_material(Material { surface: Surface::Solid(volume), ..clear(ior) });
            let (low, high) = (Vec3::new(-0.5, -0.5, 0.0), Vec3::new(0.5, 0.5, thickness));
            b.add_object("fog", cuboid(low, high), m);
            b.environment = sky(1.0);
            spot(&mut b, view(), DVec3::ZERO, 1e-4);
            let what = format!("{scattering} per metre, index {ior}, g {g}");
            // Light connects straight through an index of 1, and brings the noise of its question.
            let spp = if ior == 1.0 && scattering > 1.0 { 1024.0 } else { 256.0 };
            gives(&build(b), 1.0, Terms { spp, sure: 1e-3, rounding: 1e-5 }, &what);
        }
    }
}
