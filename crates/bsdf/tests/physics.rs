//! Energy, reciprocity, limits, and numbers that stay numbers.

mod common;

use common::{Uniform, direction, extreme_surface, principled, wide_surfaces};
use dunkelfeld_bsdf::{Bsdf, Dielectric, Lobe, PrincipledParams, ThinSheet, fresnel};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_testkit::{SampleMoments, z_test};

/// Power scattered out of a white furnace, by sampling: red channel. Radiance gained by refraction is undone (eta^2).
fn furnace(bsdf: &Bsdf, wo: LocalDir, key: u64, keep: impl Fn(Lobe) -> bool) -> SampleMoments {
    let mut u = Uniform::new(key);
    (0..60_000)
        .map(|_| match bsdf.sample(wo, u.next(), u.pair()) {
            Some(s) if keep(s.lobe) => f64::from(s.weight.r * s.eta * s.eta),
            _ => 0.0,
        })
        .collect()
}

/// The surface with nothing but its diffuse layer: no specular reflection at all.
fn bare(base: f32) -> PrincipledParams {
    PrincipledParams { specular_factor: 0.0, base_color: Rgb::splat(base), ..Default::default() }
}

#[test]
fn the_sheen_colour_multiplies_the_sheen_and_nothing_else() {
    // The surface without sheen, plus the sheen of strength one times the colour, channel by channel; the base colour's
    // hue tints on top of it.
    let (wo, wi) = (direction(0.4, 0.3), direction(0.2, 2.9));
    let plain = PrincipledParams { base_color: Rgb::new(0.5, 0.2, 0.1), ..Default::default() };
    let color = Rgb::new(0.9, 0.3, 0.0);
    let eval = |p: PrincipledParams| principled(p).eval(wo, wi);
    for sheen_tint in [0.0, 1.0] {
        let without = eval(plain);
        let white = eval(PrincipledParams { sheen: 1.0, sheen_tint, ..plain });
        let colored = eval(PrincipledParams { sheen: 1.0, sheen_tint, sheen_color: color, ..plain });
        for c in 0..3 {
            let [without, white, colored, color] = [without, white, colored, color].map(|v| v.to_array()[c]);
            assert!(white > without * 1.01, "the sheen shows");
            let expected = without + color * (white - without);
            assert!((colored - expected).abs() < 1e-6, "channel {c}: {colored}, expected {expected}");
        }
    }
    // No colour, no sheen; and numbers that are none do no harm.
    for none in [Rgb::BLACK, Rgb::splat(f32::NAN), Rgb::splat(-1.0)] {
        assert_eq!(eval(PrincipledParams { sheen: 1.0, sheen_color: none, ..plain }), eval(plain));
    }
}

#[test]
fn refraction_obeys_snell_and_sheets_do_not_bend() {
    let wo = direction(0.6, 0.0);
    let s = Bsdf::Dielectric(Dielectric::smooth(1.5)).sample(wo, 0.999, [0.5; 2]).expect("refracted");
    assert!((s.wi.0.x + 0.8 / 1.5).abs() < 1e-6 && s.wi.0.z < 0.0 && s.eta == 1.5);
    assert!((s.weight.r - 1.0 / 2.25).abs() < 1e-6, "radiance falls by eta^2: {s:?}");
    let back = Bsdf::Dielectric(Dielectric::smooth(1.5)).sample(s.wi, 0.999, [0.5; 2]).expect("refracted");
    assert!((back.wi.0 - wo.0).length() < 1e-6 && (back.weight.r - 2.25).abs() < 1e-5, "{back:?}");
    let t = Bsdf::ThinSheet(ThinSheet::new(1.5, 0.0, Rgb::WHITE, Rgb::WHITE)).sample(wo, 0.999, [0.5; 2]);
    assert_eq!(t.map(|t| (t.wi, t.eta)), Some((-wo, 1.0)));
    // 2R / (1 + R) with R = 0.04.
    assert!((ThinSheet::new(1.5, 0.0, Rgb::WHITE, Rgb::WHITE).reflectance(1.0) - 0.08 / 1.04).abs() < 1e-7);
}

#[test]
fn light_takes_the_same_path_both_ways() {
    for (k, (name, bsdf)) in wide_surfaces().into_iter().enumerate() {
        let mut u = Uniform::new(2000 + k as u64);
        let eta = match bsdf {
            Bsdf::Dielectric(d) => d.eta(),
            _ if name.starts_with("glass") => 1.49,
            _ if name == "thinner inside" => 1.0 / 1.5,
            _ if name == "everything" => 1.5,
            _ => 1.0,
        };
        for _ in 0..3000 {
            let wo = u.direction();
            let Some(s) = bsdf.sample(wo, u.next(), u.pair()) else { continue };
            if s.lobe.contains(Lobe::DELTA) || wo.abs_cos_theta() < 0.01 || s.wi.abs_cos_theta() < 0.01 {
                continue;
            }
            // f / n_o^2 is symmetric (Veach 1997, section 5.2), with n_o the index on the side of the first direction.
            let n2 = |w: LocalDir| if w.0.z > 0.0 { 1.0 } else { eta * eta };
            let there = bsdf.eval(wo, s.wi) / (s.wi.abs_cos_theta() * n2(wo));
            let back = bsdf.eval(s.wi, wo) / (wo.abs_cos_theta() * n2(s.wi));
            for c in 0..3 {
                let bound = 5e-3 * there[c].max(back[c]) + 1e-6;
                assert!((there[c] - back[c]).abs() <= bound, "{name}: {wo:?} {s:?}: {there:?} there, {back:?} back");
            }
        }
    }
}

#[test]
fn roughness_has_a_smooth_limit() {
    // The reflected share of a boundary at roughness 0, 1e-4, 1e-3 and 1e-2, from outside and inside.
    for (k, cos) in [0.9f32, 0.4, -0.9].into_iter().enumerate() {
        let eta = if cos > 0.0 { 1.49 } else { 1.0 / 1.49 };
        let expected = f64::from(fresnel::dielectric(cos.abs(), eta).reflectance);
        for (j, alpha) in [0.0f32, 1e-4, 1e-3, 1e-2].into_iter().enumerate() {
            let bsdf = Bsdf::Dielectric(Dielectric::new(1.49, alpha, Rgb::WHITE, Rgb::WHITE));
            let key = (3000 + 10 * k + j) as u64;
            let m = furnace(&bsdf, direction(cos, 0.0), key, |l| l.contains(Lobe::REFLECTION));
            // The Fresnel term bends over the lobe: second order in alpha.
            let error = m.standard_error() + f64::from(alpha);
            z_test(m.mean(), error, expected).assert(1e-10, &format!("cos {cos}, alpha {alpha}"));
            let all = furnace(&bsdf, direction(cos, 0.0), key, |_| true);
            assert!((all.mean() - 1.0).abs() < 2e-3, "cos {cos}, alpha {alpha}: T + R = {}", all.mean());
        }
    }
    // A mirror-like metal reflects what its colour says, into the mirror direction.
    let metal = principled(PrincipledParams { roughness: 0.0, metallic: 1.0, ..Default::default() });
    let wo = direction(0.9, 0.0);
    let s = metal.sample(wo, 0.5, [0.3, 0.5]).expect("reflected");
    assert!((s.wi.0 - direction(0.9, std::f32::consts::PI).0).length() < 0.01);
}

#[test]
fn a_matched_index_is_not_there() {
    let bsdf = Bsdf::Dielectric(Dielectric::new(1.0, 0.3, Rgb::WHITE, Rgb::WHITE));
    let wo = direction(0.3, 1.0);
    let s = bsdf.sample(wo, 0.0, [0.1, 0.9]).expect("passes");
    assert!(bsdf.is_delta() && (s.wi.0 + wo.0).length() < 1e-6 && s.weight == Rgb::WHITE && s.pdf == 1.0);
    // As part of the principled surface it is a delta lobe beside the others; together they keep the energy.
    let glass = PrincipledParams { base_color: Rgb::WHITE, spec_trans: 1.0, eta: 1.0, ..Default::default() };
    let m = furnace(&principled(glass), wo, 4000, |l| l.contains(Lobe::DELTA | Lobe::TRANSMISSION));
    assert!((m.mean() - 1.0).abs() < 1e-5 && m.standard_error() < 1e-5, "{m:?}");
}

#[test]
fn numbers_stay_numbers() {
    let mut u = Uniform::new(5000);
    let last = 1.0 - f32::EPSILON / 2.0;
    let coordinates = [0.0, last, 0.5, 0.25, 1e-7];
    for k in 0..200_000 {
        let bsdf = extreme_surface(&mut u);
        let odd = |u: &mut Uniform| match (u.next() * 4.0) as u32 {
            0 => direction(
                u.pick(&[1e-7, -1e-7, 1e-30, 1.0, -1.0, 0.0, 1e-3, -1e-4]),
                u.pick(&[0.0, 1.0, std::f32::consts::PI]),
            ),
            _ => u.direction(),
        };
        let wo = odd(&mut u);
        let wi = match (u.next() * 6.0) as u32 {
            0 => wo,
            1 => -wo,
            2 => LocalDir::new(-wo.0.x, -wo.0.y, wo.0.z),
            _ => odd(&mut u),
        };
        let context = || format!("case {k}: {bsdf:?}\nwo {wo:?}, wi {wi:?}");
        let (value, pdf) = bsdf.eval_pdf(wo, wi);
        assert!(value.is_finite() && value.to_array().iter().all(|v| *v >= 0.0), "eval {value:?}; {}", context());
        assert!(pdf.is_finite() && pdf >= 0.0, "pdf {pdf}; {}", context());
        assert!(bsdf.albedo(wo).to_array().iter().all(|v| (0.0..=1.0).contains(v)), "albedo; {}", context());
        let pick = |u: &mut Uniform| if u.next() < 0.3 { u.pick(&coordinates) } else { u.next() };
        let (a, b, c) = (pick(&mut u), pick(&mut u), pick(&mut u));
        if let Some(s) = bsdf.sample(wo, a, [b, c]) {
            let good = s.weight.is_finite()
                && s.weight.to_array().iter().all(|v| *v >= 0.0)
                && !s.weight.is_black()
                && s.pdf > 0.0
                && s.pdf.is_finite()
                && (s.wi.0.length() - 1.0).abs() < 1e-4
                && s.eta.is_finite()
                && s.eta > 0.0;
            assert!(good, "{s:?} from u = {a}, [{b}, {c}]; {}", context());
        }
    }
}
