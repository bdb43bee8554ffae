//! Limits: roughness toward zero, indices of refraction at, near and far from one, parameters at the ends of their
//! ranges. Typical defects there are half vectors of length zero, delta lobes with a density, 0 / 0 in Fresnel's
//! formulas, and discontinuities of lobes in a parameter.
//!
//! Replay: `cargo test -p dunkelfeld-bsdf --test it limits::NAME`.

use crate::common::chart::{Chart, Way, albedo};
use crate::common::{Uniform, direction, principled};
use dunkelfeld_bsdf::{Bsdf, Dielectric, Lobe, PrincipledParams, ThinSheet, fresnel};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;
use std::f32::consts::PI;

/// Reflected and transmitted share of the light, by integration or (delta lobes) by a sample of each.
fn shares(bsdf: &Bsdf, wo: LocalDir, eta: f32, alpha: f32, through: Way) -> [f64; 2] {
    if !bsdf.is_delta() {
        // Decade by decade from the peak to the hemisphere, for the tails.
        let decades = [1.0, 10.0, 100.0, 1000.0].map(|k| k * f64::from(alpha));
        let steps = |way: Way| -> Vec<Chart> {
            decades.iter().filter(|a| **a < 0.2).map(|a| Chart::Facets { slopes: [*a; 2], way }).collect()
        };
        let all = albedo(bsdf, wo, eta, &[steps(Way::Reflect), steps(through)].concat());
        let reflected = albedo(bsdf, wo, eta, &steps(Way::Reflect));
        return [reflected, all - reflected];
    }
    [(0.0, Lobe::REFLECTION), (1.0 - f32::EPSILON / 2.0, Lobe::TRANSMISSION)].map(|(u, side)| {
        let sample = bsdf.sample(wo, u, [0.5; 2]).filter(|s| s.lobe.contains(side));
        sample.map_or(0.0, |s| f64::from(s.weight.g * s.pdf * s.eta * s.eta))
    })
}

#[test]
fn roughness_goes_to_zero_without_a_jump() {
    // From 0 through 1e-4 to 1e-2, boundaries and sheets, for both sides. The Fresnel term bends over the lobe, and
    // facets mask each other in second order of alpha over the cosine. Nearer to the critical angle than 15 degrees the
    // tails of the lobe cross it.
    for cos in [0.95f32, 0.4, 0.15, -0.99, -0.9] {
        let eta = if cos > 0.0 { 1.49 } else { 1.0 / 1.49 };
        let r = f64::from(fresnel::dielectric(cos.abs(), eta).reflectance);
        let r_sheet = f64::from(fresnel::dielectric(cos.abs(), 1.49).reflectance);
        let r_sheet = 2.0 * r_sheet / (1.0 + r_sheet);
        for alpha in [0.0f32, 1e-4, 1e-3, 1e-2] {
            let solid = Bsdf::Dielectric(Dielectric::new(1.49, alpha, Rgb::WHITE, Rgb::WHITE));
            let sheet = Bsdf::ThinSheet(ThinSheet::new(1.49, alpha, Rgb::WHITE, Rgb::WHITE));
            let bent = 2.0 * f64::from(alpha * alpha / (cos * cos)).max(f64::from(alpha) * 0.1) + 4e-5;
            for (name, bsdf, eta, through, r) in
                [("solid", solid, 1.49, Way::Refract(f64::from(1.49f32)), r), ("sheet", sheet, 1.0, Way::Pass, r_sheet)]
            {
                let [reflected, transmitted] = shares(&bsdf, direction(cos, 0.3), eta, alpha, through);
                let what = format!("{name}, alpha {alpha}, cos {cos}: R {reflected} instead of {r}, T {transmitted}");
                assert!((reflected - r).abs() < bent, "{what}");
                assert!((reflected + transmitted - 1.0).abs() < bent, "{what}");
            }
        }
    }
}

#[test]
fn sharp_lobes_point_where_smooth_ones_do() {
    let mut u = Uniform::new(4100);
    for alpha in [1e-4f32, 1e-3, 1e-2] {
        for cos in [0.9f32, 0.3, -0.9] {
            let wo = direction(cos, 0.4);
            let smooth = Bsdf::Dielectric(Dielectric::smooth(1.49));
            let rough = Bsdf::Dielectric(Dielectric::new(1.49, alpha, Rgb::WHITE, Rgb::WHITE));
            let mut near = 0;
            for _ in 0..500 {
                let (lobe, u) = (u.next(), u.pair());
                let Some(s) = rough.sample(wo, lobe, u) else { continue };
                let side = if s.lobe.contains(Lobe::REFLECTION) { 0.0 } else { 1.0 - f32::EPSILON / 2.0 };
                let Some(d) = smooth.sample(wo, side, [0.5; 2]) else { continue };
                // Half of all facets tilt by less than alpha; a reflection turns by twice that, a refraction by about eta.
                near += usize::from((s.wi.0 - d.wi.0).length() < 12.0 * alpha / cos.abs());
            }
            assert!(near > 450, "alpha {alpha}, cos {cos}: {near} of 500 lie near the smooth direction");
        }
    }
    // A mirror-like metal reflects its colour into the mirror direction; its slope is 0.001.
    let metal = principled(PrincipledParams { roughness: 0.0, metallic: 1.0, ..Default::default() });
    for cos in [1.0f32, 0.9, 0.2] {
        let wo = direction(cos, 0.0);
        let s = metal.sample(wo, 0.5, [0.3, 0.5]).expect("reflected");
        assert!((s.wi.0 - direction(cos, PI).0).length() < 0.01);
        let schlick = 0.5 + 0.5 * f64::from(fresnel::schlick_weight(cos));
        let integral = albedo(&metal, wo, 1.0, &[Chart::reflect([1e-3; 2]), Chart::reflect([0.05; 2])]);
        assert!((integral - schlick).abs() < 1e-4 + 2e-6 / f64::from(cos * cos), "cos {cos}: {integral}, {schlick}");
    }
}

#[test]
fn a_matched_index_is_not_there() {
    let wo = direction(0.3, 1.0);
    for eta in [1.0f32, 1.0 + 5e-4, 1.0 - 5e-4] {
        let bsdf = Bsdf::Dielectric(Dielectric::new(eta, 0.3, Rgb::WHITE, Rgb::WHITE));
        let s = bsdf.sample(wo, 0.5, [0.1, 0.9]).expect("passes");
        assert!(bsdf.is_delta() && s.lobe.contains(Lobe::TRANSMISSION), "{s:?}");
        // Snell: the direction turns by (eta - 1) tan(theta), here 3.2.
        let turned = (s.wi.0 + wo.0).length();
        assert!(turned <= 4.0 * (eta - 1.0).abs() + 1e-6, "eta {eta}: {s:?}");
        assert!((s.weight.g * s.pdf * s.eta * s.eta - 1.0).abs() < 2e-5, "eta {eta}: {s:?}");
    }
    let exact = Bsdf::Dielectric(Dielectric::new(1.0, 0.3, Rgb::WHITE, Rgb::WHITE)).sample(wo, 0.0, [0.1, 0.9]);
    assert_eq!(exact.map(|s| (s.wi, s.weight, s.pdf)), Some((-wo, Rgb::WHITE, 1.0)));
    // As part of the principled surface it is a delta lobe beside the others; together they keep the energy.
    let glass = PrincipledParams { base_color: Rgb::WHITE, spec_trans: 1.0, eta: 1.0, ..Default::default() };
    let mut u = Uniform::new(4000);
    for _ in 0..200 {
        let s = principled(glass).sample(wo, u.next(), u.pair()).expect("passes");
        assert!(s.lobe.contains(Lobe::DELTA | Lobe::TRANSMISSION) && s.wi == -wo, "{s:?}");
        assert!((s.weight.g - 1.0).abs() < 1e-5, "{s:?}");
    }
}

#[test]
fn indices_near_one_and_far_from_it_have_their_limits() {
    for alpha in [0.05f32, 0.3] {
        // Just outside the matched range: nothing is reflected, and the light passes almost straight.
        for eta in [1.002f32, 1.0 / 1.002] {
            let bsdf = Bsdf::Dielectric(Dielectric::new(eta, alpha, Rgb::WHITE, Rgb::WHITE));
            let wo = direction(0.8, 0.3);
            let mut u = Uniform::new(4200);
            let mut straight = 0;
            for _ in 0..400 {
                let Some(s) = bsdf.sample(wo, u.next(), u.pair()) else { continue };
                assert!(s.weight.is_finite() && s.pdf.is_finite(), "{s:?}");
                straight += usize::from((s.wi.0 + wo.0).length() < 0.01);
            }
            assert!(straight >= 390, "alpha {alpha}, eta {eta}: {straight} of 400 go straight on");
        }
        // An index of 1000 reflects ((n - 1) / (n + 1))^2 = 0.996 at normal incidence and transmits almost nothing from
        // inside.
        let dense = Bsdf::Dielectric(Dielectric::new(1e3, alpha, Rgb::WHITE, Rgb::WHITE));
        let mirror = principled(PrincipledParams {
            base_color: Rgb::WHITE,
            metallic: 1.0,
            roughness: alpha.sqrt(),
            ..Default::default()
        });
        let (wo, slopes) = (direction(0.9, 0.1), [f64::from(alpha); 2]);
        let charts = [Chart::Cosine { above: true }, Chart::reflect(slopes)];
        let (r, whole) = (albedo(&dense, wo, 1e3, &charts), albedo(&mirror, wo, 1.0, &charts));
        let expected = (999.0f64 / 1001.0).powi(2);
        assert!((r / whole - expected).abs() < 2e-4, "alpha {alpha}: {r} of {whole}, expected the share {expected}");
        let out = dense.sample(direction(-0.5, 0.0), 1.0 - f32::EPSILON / 2.0, [0.3, 0.3]);
        assert!(out.is_none_or(|s| s.lobe.contains(Lobe::REFLECTION)), "total reflection inside: {out:?}");
    }
}

#[test]
fn no_dial_jumps_at_its_ends() {
    // A small step from an end changes a value by a small multiple of the step, for every parameter, on surfaces that have
    // the lobe in question. One jump is Mitsuba's: a surface that refracts everything has no sheen.
    type Dial = (&'static str, fn(&mut PrincipledParams, f32));
    let dials: [Dial; 9] = [
        ("metallic", |p, x| p.metallic = x),
        ("spec_tint", |p, x| p.spec_tint = x),
        ("spec_trans", |p, x| p.spec_trans = x),
        ("sheen", |p, x| p.sheen = x),
        ("sheen_tint", |p, x| p.sheen_tint = x),
        ("clearcoat", |p, x| p.clearcoat = x),
        ("clearcoat_gloss", |p, x| p.clearcoat_gloss = 0.9 * x),
        ("anisotropic", |p, x| p.anisotropic = x),
        ("base_color", |p, x| p.base_color = Rgb::new(0.3, x, 0.8)),
    ];
    let colored = PrincipledParams { base_color: Rgb::new(0.7, 0.4, 0.1), roughness: 0.5, ..Default::default() };
    let bases = [
        colored,
        PrincipledParams { metallic: 1.0, ..colored },
        PrincipledParams { spec_trans: 1.0, ..colored },
        PrincipledParams { sheen: 1.0, clearcoat: 1.0, clearcoat_gloss: 0.5, sheen_tint: 1.0, ..colored },
    ];
    let mut u = Uniform::new(4300);
    const STEP: f32 = 1e-4;
    for (name, set) in dials {
        for (b, base) in bases.into_iter().enumerate() {
            if name == "spec_trans" && base.sheen > 0.0 {
                continue;
            }
            for (end, inside) in [(0.0, STEP), (1.0, 1.0 - STEP)] {
                let at = |x: f32| {
                    let mut p = base;
                    set(&mut p, x);
                    principled(p)
                };
                let (edge, near) = (at(end), at(inside));
                // Each face of glass takes the root of its colour, which is steep at black.
                let steepness = if name == "base_color" && end == 0.0 { 2.0 * STEP.sqrt() } else { 50.0 * STEP };
                for _ in 0..300 {
                    let (wo, wi) = (u.direction(), u.direction());
                    let (e, n) = (edge.eval(wo, wi), near.eval(wo, wi));
                    for c in 0..3 {
                        let bound = steepness * (1.0 + e[c].max(n[c]));
                        let what = format!("{name} at {end}, base {b}, {wo:?} {wi:?}: {} and {}", e[c], n[c]);
                        assert!((e[c] - n[c]).abs() <= bound, "{what}");
                    }
                }
            }
        }
    }
}

#[test]
fn anisotropy_of_either_sign_is_the_same_surface_turned() {
    let metal = PrincipledParams { metallic: 1.0, roughness: 0.4, ..Default::default() };
    let turned = |w: LocalDir| LocalDir::new(-w.0.y, w.0.x, w.0.z);
    let mut u = Uniform::new(4400);
    for strength in [1.0f32, 0.5, 0.01] {
        for p in [metal, PrincipledParams { metallic: 0.0, spec_trans: 1.0, ..metal }] {
            let along = principled(PrincipledParams { anisotropic: strength, ..p });
            let across = principled(PrincipledParams { anisotropic: -strength, ..p });
            for _ in 0..300 {
                let (wo, wi) = (u.direction(), u.direction());
                let ((a, pa), (b, pb)) = (along.eval_pdf(wo, wi), across.eval_pdf(turned(wo), turned(wi)));
                assert!((a.g - b.g).abs() <= 1e-5 * a.g + 1e-9, "{strength}: {a:?} and {b:?} turned");
                assert!((pa - pb).abs() <= 1e-5 * pa + 1e-9, "{strength}: {pa} and {pb} turned");
            }
        }
    }
}
