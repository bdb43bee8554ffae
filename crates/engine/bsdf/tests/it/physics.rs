//! Reciprocity, Snell's law, and finite values for all inputs.

use crate::common::{Uniform, direction, extreme_surface, facet_surfaces, wide_surfaces};
use dunkelfeld_bsdf::{Bsdf, Dielectric, Lobe, ThinSheet};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;

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
    let wide = wide_surfaces().into_iter().map(|(name, bsdf)| {
        let eta = match bsdf {
            Bsdf::Dielectric(d) => d.eta(),
            _ if name.starts_with("glass") => 1.49,
            _ if name == "thinner inside" => 1.0 / 1.5,
            _ if name == "everything" => 1.5,
            _ => 1.0,
        };
        (name, bsdf, eta, if eta == 1.0 { 1e-4 } else { 5e-3 })
    });
    // Half vectors in f32 lose 4 * 6e-8 / alpha of a value for each operation on them. For an index near one the
    // remainder of the two directions is as short as eta - 1.
    let facets = facet_surfaces().into_iter().map(|s| {
        let left = if s.eta == 1.0 { 1.0 } else { (s.eta - 1.0).abs().min(1.0) };
        let bound = 5e-3 + 1e-6 / (s.narrowest() * left);
        (s.name, s.bsdf, s.eta, bound)
    });
    for (k, (name, bsdf, eta, bound)) in wide.chain(facets).enumerate() {
        let mut u = Uniform::new(2000 + k as u64);
        for _ in 0..1500 {
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
                let bound = bound * there[c].max(back[c]) + 1e-6;
                assert!((there[c] - back[c]).abs() <= bound, "{name}: {wo:?} {s:?}: {there:?} there, {back:?} back");
            }
        }
    }
}

#[test]
fn numbers_stay_numbers() {
    let mut u = Uniform::new(5000);
    let last = 1.0 - f32::EPSILON / 2.0;
    let coordinates = [0.0, last, 0.5, 0.25, 1e-7];
    for k in 0..200_000 {
        let bsdf = extreme_surface(&mut u);
        let bsdf = if k % 4 == 0 { bsdf.with_energy_compensation() } else { bsdf };
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
