//! Furnaces: how much of the light that comes from everywhere each lobe and each mix scatters, on both sides.
//!
//! What must come out is a closed form where there is one, else an integral of the very BSDF over its charts, which knows
//! nothing of the sampler. Either way the sampled mean must agree. A single facet bounce never gives more than it gets,
//! and with energy compensation white metal, clear boundaries and sheets give all of it.
//!
//! Replay: `cargo test -p dunkelfeld-bsdf --test furnace NAME`.

mod common;

use common::chart::{Chart, Way, albedo};
use common::{Uniform, direction, principled};
use dunkelfeld_bsdf::{Bsdf, Dielectric, Lobe, PrincipledParams, ThinSheet, fresnel};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_testkit::{SampleMoments, z_test};

/// False-alarm rate of one comparison: 6.5 standard errors.
const RATE: f64 = 1e-10;
/// Samples are drawn until the standard error is below this.
const STANDARD_ERROR: f64 = 8e-4;
/// What the cubature of the expectation may be off.
const CUBATURE: f64 = 2e-5;

/// Power scattered out of a white furnace, by sampling. Radiance gained by refraction is undone (eta^2).
fn furnace(bsdf: &Bsdf, wo: LocalDir, key: u64, keep: impl Fn(Lobe) -> bool) -> SampleMoments {
    let mut u = Uniform::new(key);
    let mut moments = SampleMoments::default();
    while moments.count() < 50_000 || (moments.standard_error() > STANDARD_ERROR && moments.count() < 3_000_000) {
        for _ in 0..1000 {
            let sample = bsdf.sample(wo, u.next(), u.pair());
            moments.push(match sample {
                Some(s) if keep(s.lobe) => f64::from(s.weight.r * s.eta * s.eta),
                _ => 0.0,
            });
        }
    }
    moments
}

/// The sampled mean against what it must be, which is known to `error`.
fn compare(what: &str, m: &SampleMoments, expected: f64, error: f64) {
    assert!(m.standard_error() <= STANDARD_ERROR, "{what}: standard error {:.1e}, heavy weights", m.standard_error());
    // All-or-nothing events of a share up to 23 / n may not have been seen at all, at this rate: 6.5 times 4 / n.
    let unseen = 4.0 / m.count() as f64;
    z_test(m.mean(), m.standard_error().hypot(error).hypot(unseen), expected).assert(RATE, what);
}

/// The surface with nothing but its diffuse layer: no specular reflection at all.
fn bare(base: f32) -> PrincipledParams {
    PrincipledParams { specular_factor: 0.0, base_color: Rgb::splat(base), ..Default::default() }
}

const ROUGHNESS: [f32; 5] = [0.1, 0.3, 0.5, 0.8, 1.0];
const VIEWS: [f32; 3] = [0.8, 0.1, -0.6];

/// A surface, the index of refraction below over above, and whether its lobes are physical.
struct Case {
    name: String,
    bsdf: Bsdf,
    eta: f32,
    charts: Vec<Chart>,
    physical: bool,
}

/// Every lobe alone, and every pair and mix of them.
fn cases(roughness: f32) -> Vec<Case> {
    let alpha = f64::from(roughness * roughness);
    let charts = |slopes: [f64; 2], eta: f32| {
        let refract = Chart::Facets { slopes, way: Way::Refract(f64::from(eta)) };
        let mut charts =
            vec![Chart::Cosine { above: true }, Chart::Cosine { above: false }, Chart::reflect(slopes), refract];
        if slopes[1] < 0.05 {
            // A step between the peak and the hemisphere, for the tails.
            charts.push(Chart::reflect([0.1; 2]));
            charts.push(Chart::Facets { slopes: [0.1; 2], way: Way::Refract(f64::from(eta)) });
        }
        charts
    };
    let white = Rgb::WHITE;
    let metal = PrincipledParams { base_color: white, metallic: 1.0, ..Default::default() };
    let black = PrincipledParams { base_color: Rgb::BLACK, ..Default::default() };
    let glass = PrincipledParams { base_color: white, spec_trans: 1.0, ..Default::default() };
    let plastic = PrincipledParams { base_color: Rgb::splat(0.7), ..Default::default() };
    let cloth = PrincipledParams { sheen: 1.0, sheen_tint: 0.5, ..plastic };
    let everything = PrincipledParams {
        metallic: 0.3,
        anisotropic: 0.5,
        spec_tint: 0.4,
        spec_trans: 0.4,
        sheen: 0.5,
        clearcoat: 0.8,
        ..plastic
    };
    let coated = |p: PrincipledParams| PrincipledParams { clearcoat: 1.0, clearcoat_gloss: 1.0 - roughness, ..p };
    let list = [
        ("diffuse", bare(1.0), false),
        ("sheen", PrincipledParams { sheen: 1.0, ..bare(0.0) }, true),
        ("coat", coated(bare(0.0)), true),
        ("real lacquer", PrincipledParams { clearcoat: 4.0, ..coated(bare(0.0)) }, true),
        ("white metal", metal, true),
        ("brushed metal", PrincipledParams { anisotropic: 0.8, ..metal }, true),
        ("specular", black, true),
        ("tinted specular", PrincipledParams { spec_tint: 1.0, base_color: Rgb::splat(0.01), ..black }, false),
        ("glass", glass, true),
        ("thinner inside", PrincipledParams { eta: 1.0 / 1.5, ..glass }, true),
        ("plastic", plastic, false),
        ("cloth", cloth, false),
        ("coated plastic", coated(plastic), false),
        ("coated metal", coated(metal), false),
        ("coated glass", coated(glass), false),
        ("half metal", PrincipledParams { metallic: 0.5, ..plastic }, false),
        ("half glass", PrincipledParams { spec_trans: 0.5, ..plastic }, false),
        ("metal in glass", PrincipledParams { metallic: 0.5, ..glass }, false),
        ("everything", everything, false),
    ];
    let mut found: Vec<Case> = list
        .into_iter()
        .map(|(name, p, physical)| {
            let p = PrincipledParams { roughness, ..p };
            let aspect = f64::from(1.0 - 0.9 * p.anisotropic).sqrt();
            let slopes = [alpha / aspect, alpha * aspect];
            let mut charts = charts(slopes, p.eta);
            if p.clearcoat > 0.0 {
                charts.push(Chart::reflect([f64::from(0.1 - 0.099 * p.clearcoat_gloss).sqrt(); 2]));
            }
            Case { name: name.into(), bsdf: principled(p), eta: p.eta, charts, physical }
        })
        .collect();
    for eta in [1.49, 1.0 / 1.49, 30.0] {
        let bsdf = Bsdf::Dielectric(Dielectric::new(eta, alpha as f32, white, white));
        let charts = charts([alpha; 2], eta);
        found.push(Case { name: format!("dielectric {eta:.2}"), bsdf, eta, charts, physical: true });
    }
    let bsdf = Bsdf::ThinSheet(ThinSheet::new(1.49, alpha as f32, white, white));
    let pass = Chart::Facets { slopes: [alpha; 2], way: Way::Pass };
    let charts = vec![Chart::reflect([alpha; 2]), pass, Chart::Cosine { above: true }, Chart::Cosine { above: false }];
    found.push(Case { name: "sheet".into(), bsdf, eta: 1.0, charts, physical: true });
    found
}

fn every_lobe_and_mix(roughness: f32) {
    for (k, case) in cases(roughness).into_iter().enumerate() {
        for (v, cos) in VIEWS.into_iter().enumerate() {
            let what = format!("{}, roughness {roughness}, cos {cos}", case.name);
            let wo = direction(cos, 0.3);
            let expected = albedo(&case.bsdf, wo, case.eta, &case.charts);
            if case.physical {
                assert!(expected <= 1.0 + CUBATURE, "{what}: gives {expected} of what it gets");
            }
            let key = (10_000.0 * roughness) as u64 + 10 * k as u64 + v as u64;
            compare(&what, &furnace(&case.bsdf, wo, key, |_| true), expected, CUBATURE);
        }
    }
}

#[test]
fn lobes_and_mixes_of_roughness_0_1() {
    every_lobe_and_mix(ROUGHNESS[0]);
}

#[test]
fn lobes_and_mixes_of_roughness_0_3() {
    every_lobe_and_mix(ROUGHNESS[1]);
}

#[test]
fn lobes_and_mixes_of_roughness_0_5() {
    every_lobe_and_mix(ROUGHNESS[2]);
}

#[test]
fn lobes_and_mixes_of_roughness_0_8() {
    every_lobe_and_mix(ROUGHNESS[3]);
}

#[test]
fn lobes_and_mixes_of_roughness_1() {
    every_lobe_and_mix(ROUGHNESS[4]);
}

#[test]
fn diffuse_and_sheen_have_the_albedo_of_their_closed_form() {
    let up = direction(1.0, 0.0);
    for (k, roughness) in [0.0f32, 0.5, 1.0].into_iter().enumerate() {
        // At normal view the weight of wo vanishes and cos_d^2 = (1 + c) / 2. With B the beta function, the integral of
        // 2c [1 - (1-c)^5 / 2 + r (1+c) (1-c)^5] dc is 1 - B(2,6) + 2r [B(2,6) + B(3,6)] = 1 - 1/42 + 5r/84.
        let expected = 1.0 - 1.0 / 42.0 + f64::from(roughness) * 5.0 / 84.0;
        let bsdf = principled(PrincipledParams { roughness, ..bare(1.0) });
        compare(&format!("diffuse, roughness {roughness}"), &furnace(&bsdf, up, k as u64, |_| true), expected, 1e-6);
        let integral = albedo(&bsdf, up, 1.0, &[Chart::Cosine { above: true }]);
        assert!((integral - expected).abs() < 1e-5, "the cubature itself: {integral}, expected {expected}");
    }
    // Sheen: with x = cos_d, c = 2x^2 - 1 the integral is 2 pi (2x^2 - 1)(1 - x)^5 4x dx from sqrt(1/2) to 1.
    let f = |x: f64| std::f64::consts::TAU * (2.0 * x * x - 1.0) * (1.0 - x).powi(5) * 4.0 * x;
    let (a, n) = (0.5f64.sqrt(), 2000);
    let h = (1.0 - a) / f64::from(n);
    let expected: f64 = (0..n).map(|i| f(a + (f64::from(i) + 0.5) * h) * h).sum();
    let bsdf = principled(PrincipledParams { sheen: 1.0, ..bare(0.0) });
    compare("sheen", &furnace(&bsdf, up, 9, |_| true), expected, 1e-6);
    // Lambert in a furnace is the base colour: with roughness r = 7 / 15 at normal view the closed form gives it back
    // but for the diffuse factor, 1 - 1/42 + 1/36.
    let grey = principled(PrincipledParams { roughness: 7.0 / 15.0, ..bare(0.5) });
    compare("grey", &furnace(&grey, up, 10, |_| true), 0.5 * (1.0 - 1.0 / 42.0 + 1.0 / 36.0), 1e-6);
}

#[test]
fn compensated_white_metal_loses_nothing() {
    // A facet of a white metal reflects everything, so that 1 / E(wo) times the lobe integrates to one. What is left is the
    // error of the table, 0.3 % at most and 2 % for stretched lobes.
    for (k, roughness) in [0.05f32, 0.2, 0.4, 0.6, 0.8, 1.0].into_iter().enumerate() {
        for (a, (anisotropic, table)) in [(0.0, 6e-4), (0.4, 4e-3), (0.9, 4e-3)].into_iter().enumerate() {
            if a == 2 && roughness > 0.5 {
                // Facets that steep waste nine samples of ten.
                continue;
            }
            let metal = PrincipledParams { base_color: Rgb::WHITE, metallic: 1.0, roughness, anisotropic, ..bare(1.0) };
            let bsdf = principled(metal).with_energy_compensation();
            for (v, cos) in [1.0f32, 0.4, 0.1].into_iter().enumerate() {
                let what = format!("roughness {roughness}, anisotropic {anisotropic}, cos {cos}");
                let m = furnace(&bsdf, direction(cos, 0.8), (100_000 + 100 * k + 10 * a + v) as u64, |_| true);
                compare(&what, &m, 1.0, table);
                assert!((m.mean() - 1.0).abs() < if a == 0 { 5e-3 } else { 2e-2 }, "{what}: {}", m.mean());
            }
        }
    }
}

#[test]
fn the_factors_are_as_exact_as_they_say() {
    // By cubature, not by sampling: what a factor is off by, over slopes between the nodes of the tables and views down to a
    // cosine of 0.03.
    let mut u = Uniform::new(88);
    let mut worst = [0.0f64; 3];
    for _ in 0..30 {
        let roughness = 0.15 + 0.85 * u.next();
        let wo = direction(0.03 + 0.97 * u.next(), 6.0 * u.next());
        let alpha = f64::from(roughness * roughness);
        let metal = PrincipledParams { base_color: Rgb::WHITE, metallic: 1.0, roughness, ..bare(1.0) };
        let sheer = |slopes| [Chart::reflect(slopes), Chart::Cosine { above: true }];
        let even = albedo(&principled(metal).with_energy_compensation(), wo, 1.0, &sheer([alpha; 2]));
        let anisotropic = u.next();
        let aspect = f64::from(1.0 - 0.9 * anisotropic).sqrt();
        let brushed = principled(PrincipledParams { anisotropic, ..metal }).with_energy_compensation();
        let brushed = albedo(&brushed, wo, 1.0, &sheer([alpha / aspect, alpha * aspect]));
        let eta = 1.3 + u.next();
        let wo = if u.next() < 0.5 { wo } else { -wo };
        let clear = Bsdf::Dielectric(Dielectric::new(eta, alpha as f32, Rgb::WHITE, Rgb::WHITE));
        let refract = Chart::Facets { slopes: [alpha; 2], way: Way::Refract(f64::from(eta)) };
        let both = [Chart::reflect([alpha; 2]), refract, Chart::Cosine { above: true }, Chart::Cosine { above: false }];
        let clear = albedo(&clear.with_energy_compensation(), wo, eta, &both);
        for (worst, found) in worst.iter_mut().zip([even, brushed, clear]) {
            *worst = worst.max((found - 1.0).abs());
        }
    }
    let [even, brushed, clear] = worst;
    assert!(
        even < 3e-3 && brushed < 2e-2 && clear < 2e-2,
        "metal {even:.1e}, brushed {brushed:.1e}, clear {clear:.1e}"
    );
    // What docs/materials.md says of white metal at normal view, without compensation.
    let lost = |roughness: f32| {
        let metal = PrincipledParams { base_color: Rgb::WHITE, metallic: 1.0, roughness, ..bare(1.0) };
        let alpha = f64::from(roughness * roughness);
        1.0 - albedo(
            &principled(metal),
            direction(1.0, 0.0),
            1.0,
            &[Chart::reflect([alpha; 2]), Chart::Cosine { above: true }],
        )
    };
    assert!((lost(0.5) - 0.084).abs() < 5e-4, "{}", lost(0.5));
    // At slope one D is even in the solid angle and g1 = 2 c / (1 + c) with c = cos of twice the facet's angle, so that E is
    // the integral of 2 x (2 x^2 - 1) / x^2 dx over x from sqrt(1/2) to 1, which is 1 - ln 2.
    assert!((lost(1.0) - std::f64::consts::LN_2).abs() < 2e-5, "{}", lost(1.0));
}

#[test]
fn compensated_boundaries_and_sheets_lose_nothing() {
    for (k, roughness) in [0.1f32, 0.4, 0.7, 1.0].into_iter().enumerate() {
        let alpha = roughness * roughness;
        let glass = PrincipledParams { base_color: Rgb::WHITE, spec_trans: 1.0, roughness, ..Default::default() };
        let surfaces = [
            ("dielectric 1.49", Bsdf::Dielectric(Dielectric::new(1.49, alpha, Rgb::WHITE, Rgb::WHITE))),
            ("dielectric 2.4", Bsdf::Dielectric(Dielectric::new(2.4, alpha, Rgb::WHITE, Rgb::WHITE))),
            ("glass", principled(glass)),
            ("sheet", Bsdf::ThinSheet(ThinSheet::new(1.49, alpha, Rgb::WHITE, Rgb::WHITE))),
        ];
        for (s, (name, bsdf)) in surfaces.into_iter().enumerate() {
            for (v, cos) in [0.9f32, 0.2, -0.9, -0.3].into_iter().enumerate() {
                let bsdf = bsdf.with_energy_compensation();
                let m = furnace(&bsdf, direction(cos, 0.3), (200_000 + 100 * k + 10 * s + v) as u64, |_| true);
                let what = format!("{name}, roughness {roughness}, cos {cos}: {} +- {}", m.mean(), m.standard_error());
                assert!(m.standard_error() <= STANDARD_ERROR, "{what}: heavy weights");
                let table = if name == "sheet" { 3e-3 } else { 2e-2 };
                assert!((m.mean() - 1.0).abs() < table + 6.5 * m.standard_error(), "{what}");
            }
        }
    }
}

#[test]
fn compensation_multiplies_by_a_function_of_wo_alone() {
    // Which is what reciprocity is lost to, and all that it is lost to: f / factor(wo) is the reciprocal f without it.
    let metal = PrincipledParams { base_color: Rgb::new(0.9, 0.6, 0.3), metallic: 1.0, roughness: 0.7, ..bare(1.0) };
    let surfaces = [
        principled(metal),
        principled(PrincipledParams { anisotropic: 0.7, ..metal }),
        Bsdf::Dielectric(Dielectric::new(1.5, 0.4, Rgb::WHITE, Rgb::WHITE)),
        Bsdf::ThinSheet(ThinSheet::new(1.5, 0.4, Rgb::WHITE, Rgb::WHITE)),
    ];
    let mut u = Uniform::new(77);
    for bsdf in surfaces {
        let more = bsdf.with_energy_compensation();
        for cos in [0.9f32, 0.3, -0.5] {
            let wo = direction(cos, 0.3);
            let mut factor: Option<Rgb> = None;
            for _ in 0..200 {
                let wi = u.direction();
                let (plain, compensated) = (bsdf.eval(wo, wi), more.eval(wo, wi));
                assert_eq!(bsdf.pdf(wo, wi), more.pdf(wo, wi), "densities do not change");
                if plain.r < 1e-4 || plain.b < 1e-4 {
                    continue;
                }
                let ratio = Rgb::new(compensated.r / plain.r, compensated.g / plain.g, compensated.b / plain.b);
                let first = *factor.get_or_insert(ratio);
                for c in 0..3 {
                    assert!((ratio[c] - first[c]).abs() < 1e-4 * first[c], "{bsdf:?}: {ratio:?} and {first:?}");
                    assert!(ratio[c] >= 0.98, "{bsdf:?}: {ratio:?} takes light away");
                }
            }
        }
    }
}

/// Power that leaves a plane-parallel slab on both sides, by a random walk between its two faces.
fn slab(face: &Bsdf, wo: LocalDir, key: u64) -> SampleMoments {
    let mut u = Uniform::new(key);
    let mut moments = SampleMoments::default();
    while moments.count() < 5_000 || (moments.standard_error() > STANDARD_ERROR && moments.count() < 400_000) {
        // The frame of a face has +z outside: each face is the other one turned over.
        let (mut w, mut weight) = (wo, 1.0f64);
        loop {
            let Some(s) = face.sample(w, u.next(), u.pair()) else {
                weight = 0.0;
                break;
            };
            weight *= f64::from(s.weight.g * s.eta * s.eta);
            if s.wi.0.z > 0.0 || weight == 0.0 {
                break;
            }
            // What goes down from this face comes up to the other one, which is turned over: along its own normal, and
            // with wo pointing back to where the light is looked for.
            w = LocalDir::new(-s.wi.0.x, -s.wi.0.y, s.wi.0.z);
        }
        moments.push(weight);
    }
    moments
}

#[test]
fn a_slab_transmits_what_it_does_not_reflect() {
    let face = |alpha: f32| Bsdf::Dielectric(Dielectric::new(1.49, alpha, Rgb::WHITE, Rgb::WHITE));
    for (k, cos) in [1.0f32, 0.5, 0.05, 1e-3].into_iter().enumerate() {
        // Smooth: each sample carries all of the light wherever it goes, T + R = 1 path by path.
        let smooth = slab(&face(0.0), direction(cos, 0.2), 300 + k as u64);
        assert!((smooth.mean() - 1.0).abs() < 1e-5 && smooth.standard_error() < 1e-6, "cos {cos}: {smooth:?}");
        for alpha in [0.05f32, 0.3, 0.8] {
            // Rough: never more than there is, and with compensation all of it, to the error of the table (2 %) at each of
            // the few faces that a path meets.
            let rough = slab(&face(alpha), direction(cos.max(0.05), 0.2), 310 + k as u64);
            let bound = 1.0 + 6.5 * rough.standard_error() + 1e-5;
            assert!(rough.mean() <= bound, "alpha {alpha}, cos {cos}: {}", rough.mean());
            let whole = slab(&face(alpha).with_energy_compensation(), direction(cos.max(0.05), 0.2), 320 + k as u64);
            let bound = 0.05 + 6.5 * whole.standard_error();
            assert!((whole.mean() - 1.0).abs() < bound, "alpha {alpha}, cos {cos}: {} with compensation", whole.mean());
        }
    }
}

#[test]
fn smooth_boundaries_split_light_without_loss() {
    for eta in [1.49f32, 1.0 / 1.49, 1.0, 1e3, 1e-3, 1.000_01] {
        let (solid, sheet) = (Dielectric::smooth(eta), ThinSheet::new(eta, 0.0, Rgb::WHITE, Rgb::WHITE));
        for bsdf in [Bsdf::Dielectric(solid), Bsdf::ThinSheet(sheet)] {
            for cos in [1.0f32, 0.7, 0.2, 1e-3, -1.0, -0.5, -1e-3] {
                let wo = direction(cos, 0.5);
                let reflected = bsdf.sample(wo, 0.0, [0.5; 2]);
                let transmitted = bsdf.sample(wo, 1.0 - f32::EPSILON / 2.0, [0.5; 2]);
                // Each sample's weight is its coefficient over its probability: the shares are weight * pdf.
                let share = |s: Option<dunkelfeld_bsdf::BsdfSample>, side| match s {
                    Some(s) if s.lobe.contains(side) => s.weight.g * s.pdf * s.eta * s.eta,
                    _ => 0.0,
                };
                let (r, t) = (share(reflected, Lobe::REFLECTION), share(transmitted, Lobe::TRANSMISSION));
                assert!((r + t - 1.0).abs() < 3e-7, "{bsdf:?}, cos {cos}: R + T = {}", r + t);
                for s in [reflected, transmitted].into_iter().flatten() {
                    assert!(s.lobe.contains(Lobe::DELTA) && (s.wi.0.length() - 1.0).abs() < 1e-6, "{bsdf:?}: {s:?}");
                }
                // Fresnel in f64, straight from Snell.
                let (c, e) = (f64::from(cos.abs()), f64::from(if cos > 0.0 { eta } else { 1.0 / eta }));
                let sin2 = (1.0 - c * c) / (e * e);
                let f = if sin2 >= 1.0 {
                    1.0
                } else {
                    let ct = (1.0 - sin2).sqrt();
                    0.5 * (((c - e * ct) / (c + e * ct)).powi(2) + ((e * c - ct) / (e * c + ct)).powi(2))
                };
                let expected = if matches!(bsdf, Bsdf::Dielectric(_)) {
                    f
                } else {
                    let f = f64::from(fresnel::dielectric(cos.abs(), eta).reflectance);
                    2.0 * f / (1.0 + f)
                };
                // Near the critical angle, and grazing a boundary that is nearly none, cos_t^2 is a small difference of
                // numbers around one.
                let bound = 1e-5 + 3e-7 / ((1.0 - sin2).abs() + 1e-9);
                assert!((f64::from(r) - expected).abs() < bound, "{bsdf:?}, cos {cos}: R = {r}, expected {expected}");
            }
        }
    }
}
