//! Family 3, grazing: eye and light at 89.9 degrees, the critical angle, and chains of hundreds of total reflections.
//!
//! Hard, because cosines go to zero and stand in denominators: a microfacet term becomes 0 / 0, a half vector loses all its
//! digits, and beyond the critical angle a root turns imaginary. A path that is totally reflected three hundred times adds
//! up three hundred rounding errors of its direction and of the way it has come; a renderer with a depth limit of 16 or 64
//! shows black at the end of a light guide.
//!
//! Must give: Fresnel's formula in f64, at any angle; `f cos` of the material's BSDF, integrated where the light has an
//! extent; and for a light guide the transmittance of a plate as long as its unfolded way.

use super::facets;
use super::support::{
    Terms, absorbing, clear, f_cos, floor, fresnel, gives, integrate, plastic_bsdf, sky, spot, sun, terms,
    through_faces, two_halves,
};
use crate::support::{Add, black, build, emitter, square};
use dunkelfeld::geometry::{DVec3, Mesh, Vec3};
use dunkelfeld::scene::shapes::{cuboid, rectangle};
use dunkelfeld::scene::{Material, SceneBuilder};
use std::f64::consts::PI;

const PMMA: f64 = 1.49;

#[test]
fn smooth_pmma_near_the_horizon() {
    // A plate under a sky that is white above the horizon: what it reflects, through all internal reflections. And under one
    // that is white below: what it lets through. Together one, though each is computed by itself. The plate is so thin that
    // no ray reaches its rim before it has lost all.
    for degrees in [0.0f64, 60.0, 85.0, 89.0, 89.9] {
        let angle = degrees.to_radians();
        let through = through_faces(2.0, fresnel(angle, PMMA));
        for (above, below, expected) in [(1.0, 0.0, 1.0 - through), (0.0, 1.0, through), (1.0, 1.0, 1.0)] {
            let mut b = SceneBuilder::default();
            b.add("plate", cuboid(Vec3::new(-0.5, -1e-4, -0.5), Vec3::new(0.5, 0.0, 0.5)), clear(PMMA as f32));
            two_halves(&mut b, above, below);
            spot(&mut b, 0.4 * DVec3::new(angle.sin(), angle.cos(), 0.0), DVec3::ZERO, 1e-5);
            // A direction is known to 6e-8 rad; the cosine 1.7e-3 at 89.9 degrees, and with it 1 - R, to 3e-5.
            let sure = 3.0 * ((1.0 - expected).max(0.01) / expected / (256.0 * 256.0)).sqrt();
            let what = format!("sky {above}, ground {below}, at {degrees} degrees");
            gives(&build(b), expected, Terms { spp: 256.0, sure, rounding: 5e-5 }, &what);
        }
    }
}

#[test]
fn rough_plastic_lit_and_seen_along_its_surface() {
    // Parallel light has one direction: f cos of the BSDF, with nothing random.
    let at = |degrees: f64, azimuth: f64| {
        let (t, p) = (degrees.to_radians(), azimuth.to_radians());
        DVec3::new(t.sin() * p.cos(), t.sin() * p.sin(), t.cos())
    };
    for azimuth in [0.0, 90.0, 180.0] {
        for (seen, lit) in [(89.9, 89.9), (89.9, 45.0), (45.0, 89.9), (89.0, 89.9)] {
            let (wo, wi) = (at(seen, 0.0), at(lit, azimuth));
            let mut b = floor(1.0);
            sun(&mut b, wi);
            spot(&mut b, wo * 0.4, DVec3::ZERO, 1e-5);
            let expected = f_cos(&plastic_bsdf(), DVec3::Z, wo, wi);
            let what = format!("seen at {seen}, lit at {lit} degrees, azimuth {azimuth}");
            // The cosine is 1.7e-3, a direction is rounded to 6e-8, and f cos may go with the inverse of both.
            gives(&build(b), expected, Terms { spp: 4.0, sure: 1e-3, rounding: 3e-4 }, &what);
        }
    }
}

#[test]
fn rough_pmma_lit_and_seen_along_its_surface() {
    // A block of rough PMMA that absorbs what enters within a micrometre: what is left is the light that facets mirror, by the
    // formula in f64. Nothing is random.
    for roughness in [0.2f32, 0.5, 1.0] {
        for azimuth in [0.0f64, 90.0, 180.0] {
            for (seen, lit) in [(89.9f64, 89.9f64), (89.9, 45.0), (45.0, 89.9), (89.0, 89.9)] {
                let [seen, lit, azimuth] = [seen, lit, azimuth].map(f64::to_radians);
                let mut b = SceneBuilder::default();
                b.add(
                    "block",
                    cuboid(Vec3::new(-0.5, -0.5, -0.1), Vec3::new(0.5, 0.5, 0.0)),
                    Material { roughness: roughness.into(), ..absorbing(PMMA as f32, 0.0, 1e-6) },
                );
                sun(&mut b, DVec3::new(lit.sin() * azimuth.cos(), lit.sin() * azimuth.sin(), lit.cos()));
                spot(&mut b, 0.4 * DVec3::new(seen.sin(), 0.0, seen.cos()), DVec3::ZERO, 1e-5);
                let alpha = f64::from(roughness * roughness);
                let expected = facets::reflected(seen.cos(), lit.cos(), azimuth, alpha, PMMA);
                let what = format!("seen at {seen}, lit at {lit}, azimuth {azimuth} rad, roughness {roughness}");
                // As for plastic; a half vector is known to 6e-8, and a lobe of slope alpha to twice that over alpha.
                gives(&build(b), expected, Terms { spp: 4.0, sure: 1e-3, rounding: 5e-4 }, &what);
            }
        }
    }
}

#[test]
fn rough_plastic_under_a_sky_seen_along_its_surface() {
    // The directional albedo. Half vectors concentrate about the mirrored view, which is itself at the horizon: coordinates
    // in which the integrand is smooth are the square root of the cosine and the azimuth squared about the view.
    let angle = 89.9f64.to_radians();
    let wo = DVec3::new(angle.sin(), 0.0, angle.cos());
    let bsdf = plastic_bsdf();
    let expected = 2.0
        * integrate(1500, |s, t| {
            let (z, phi) = (s.powi(4), PI * t * t);
            let r = (1.0 - z * z).sqrt();
            // d(omega) = dz dphi = 4 s^3 ds 2 pi t dt, the azimuth counted from the mirrored view.
            let wi = DVec3::new(-r * phi.cos(), r * phi.sin(), z);
            4.0 * s.powi(3) * 2.0 * PI * t * f_cos(&bsdf, DVec3::Z, wo, wi)
        });
    let mut b = floor(1.0);
    b.environment = sky(1.0);
    spot(&mut b, wo * 0.4, DVec3::ZERO, 1e-5);
    gives(
        &build(b),
        expected,
        Terms { spp: 512.0, sure: 1e-3 / expected, rounding: 1e-3 },
        "sky over plastic at 89.9 degrees",
    );
}

#[test]
fn fresnel_on_both_sides_of_the_critical_angle() {
    // A prism: the ray enters at right angles and meets the second face from inside at the critical angle plus or minus an
    // offset. What gets out meets an emitter that stands across; what does not is absorbed by a screen inside.
    let ior = 1.5f64;
    let critical = (1.0 / ior).asin();
    for offset in [-0.1f64, -1e-2, -1e-3, -1e-4, 1e-4, 1e-3, 1e-2, 0.1] {
        let inside = critical + offset;
        let mut b = SceneBuilder::default();
        let glass = b.add_material(clear(ior as f32));
        // In the plane y = 0: the second face is z = 0, the solid below it; the first face is square to the ray, which
        // travels along (sin, cos) and meets z = 0 at the origin.
        let (sin, cos) = inside.sin_cos();
        let along = DVec3::new(sin, 0.0, cos);
        let across = DVec3::new(cos, 0.0, -sin);
        let enter = -0.1 * along;
        // Where the line of the first face meets z = 0, on the left, and a point far to its lower right.
        let left = enter + across * (enter.z / sin);
        let right = enter + across * 0.2;
        let corner = DVec3::new(right.x, 0.0, 0.0);
        let outline = [left, right, corner];
        let mut mesh = Mesh::default();
        for y in [-0.1, 0.1] {
            mesh.positions.extend(outline.map(|p| Vec3::new(p.x as f32, y, p.z as f32)));
        }
        mesh.triangles = vec![[0, 1, 2], [3, 5, 4], [0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2], [2, 5, 3], [2, 3, 0]];
        b.add_object("prism", mesh, glass);
        let dark = b.add_material(black());
        // Absorbs what the second face reflects.
        let normal = DVec3::new(sin, 0.0, -cos);
        let stop = 0.02 * normal;
        let wall = rectangle(
            (stop - 0.01 * across_of(normal) - DVec3::Y * 0.05).as_vec3(),
            (0.02 * across_of(normal)).as_vec3(),
            Vec3::Y * 0.1,
        );
        b.add_object("screen", wall, dark);
        let light = b.add_material(Material { double_sided: true, ..emitter(1.0) });
        // Outside, everything leaves toward +x and a little up.
        b.add_object("light", rectangle(Vec3::new(0.5, -0.5, 1e-6), Vec3::Y, Vec3::Z), light);
        spot(&mut b, -0.3 * along, DVec3::ZERO, 1e-5);
        let r0 = ((ior - 1.0) / (ior + 1.0)).powi(2);
        let out = (ior * inside.sin()).asin();
        let expected = if offset > 0.0 { 0.0 } else { (1.0 - r0) * (1.0 - fresnel(out, ior)) };
        // 1 - R goes with the root of the offset, and a direction is rounded to 1e-7 rad.
        let rounding = 1e-5 + 1e-7 / offset.abs();
        let sure = 1.5 * ((1.0 - expected) / expected.max(1e-3) / (256.0 * 256.0)).sqrt();
        gives(&build(b), expected, Terms { spp: 256.0, sure, rounding }, &format!("critical angle {offset:+} rad"));
    }
}

/// A unit vector at right angles to `n` in the plane y = 0.
fn across_of(n: DVec3) -> DVec3 {
    DVec3::new(n.z, 0.0, -n.x)
}

#[test]
fn a_light_guide_is_a_plate_as_long_as_its_way() {
    // A rod of 2 mm, an emitter across its far end, inside. The ray makes an angle with the axis at which it meets the sides
    // beyond the critical angle: it is reflected totally, again and again, and arrives at the same angle. The near face
    // passes 1 - R and divides radiance by the square of the index.
    let ior = PMMA;
    for (length, color) in [(0.05f64, 1.0f64), (0.4, 1.0), (0.4, 0.5)] {
        let outside = 70f64.to_radians();
        let sin = outside.sin() / ior;
        let cos = (1.0 - sin * sin).sqrt();
        let reflections = length * sin / cos / 0.002;
        let mut b = SceneBuilder::default();
        b.add(
            "rod",
            cuboid(Vec3::new(-1e-3, -1e-3, -length as f32), Vec3::new(1e-3, 1e-3, 0.0)),
            absorbing(ior as f32, color as f32, 1.0),
        );
        b.add("light", square(-length as f32 + 1e-4, 0.00199, false), emitter(1.0));
        spot(&mut b, 0.2 * DVec3::new(outside.sin(), 0.0, outside.cos()), DVec3::ZERO, 1e-4);
        let r = fresnel(outside, ior);
        let expected = (1.0 - r) * color.powf((length - 1e-4) / cos) / (ior * ior);
        assert!(length < 0.1 || reflections > 150.0, "{reflections} reflections");
        // From the 64th vertex on two percent of the paths end at each one, and the others stand for them.
        let ends = 0.98f64.powf(64.0 - reflections.max(64.0));
        let sure = 2.0 * (ends / (1.0 - r) / (256.0 * 512.0)).sqrt();
        let what = format!("{reflections:.0} total reflections, {color} left after 1 m");
        gives(&build(b), expected, Terms { spp: 512.0, sure, rounding: 2e-5 }, &what);
    }
}

#[test]
fn light_at_the_horizon_of_a_light_guide_stays_out_of_its_sides() {
    // Seen through its side a long rod shows total reflection or the sky, never anything that was not there: in a white
    // furnace a clear body of any shape is invisible.
    let mut b = SceneBuilder::default();
    b.add("rod", cuboid(Vec3::new(-1e-3, -1e-3, -0.2), Vec3::new(1e-3, 1e-3, 0.2)), clear(PMMA as f32));
    b.environment = sky(1.0);
    spot(&mut b, DVec3::new(0.2, 0.07, 0.03), DVec3::ZERO, 8e-4);
    gives(&build(b), 1.0, terms(64.0, 1e-3), "a rod in a white furnace");
}
