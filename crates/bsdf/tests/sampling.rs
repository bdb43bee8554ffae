//! Samplers follow the densities they claim (chi-squared), on both sides of every surface.

mod common;

use common::{Uniform, direction, wide_surfaces};
use dunkelfeld_bsdf::clearcoat;
use dunkelfeld_bsdf::microfacet::Ggx;
use dunkelfeld_bsdf::{Bsdf, Lobe};
use dunkelfeld_geometry::{LocalDir, Vec3};
use dunkelfeld_testkit::{DensityTest, direction_to_square, sidak, square_to_direction};
use std::f64::consts::PI;

/// False-alarm rate of each test function.
const RATE: f64 = 1e-9;

#[test]
fn directions_follow_their_density() {
    let surfaces = wide_surfaces();
    // Normal, oblique, grazing, and from below.
    let views = [(1.0, 0.0), (0.6, 0.7), (0.08, 2.0), (-0.5, -1.0)];
    let count = surfaces.len() * views.len();
    for (s, (name, bsdf)) in surfaces.iter().enumerate() {
        for (v, (cos, phi)) in views.into_iter().enumerate() {
            let wo = direction(cos, phi);
            let mut u = Uniform::new((s * 10 + v) as u64);
            let sample = || {
                let sample = bsdf.sample(wo, u.next(), u.pair())?;
                (!sample.lobe.contains(Lobe::DELTA)).then(|| direction_to_square(sample.wi.0.to_array()))
            };
            let test = DensityTest { columns: 24, rows: 16, samples: 40_000 };
            let what = format!("{name}, cos wo {cos}");
            test.run(&what, sample, |p| 4.0 * PI * f64::from(bsdf.pdf(wo, to_local(p))))
                .assert(sidak(RATE, count), &what);
        }
    }
}

fn to_local(p: [f64; 2]) -> LocalDir {
    let d = square_to_direction(p).map(|x| x as f32);
    LocalDir(Vec3::from_array(d))
}

#[test]
fn visible_normals_follow_their_density() {
    for (k, (ax, ay)) in [(0.3, 0.3), (0.6, 0.2), (1.0, 1.0), (0.2, 0.9)].into_iter().enumerate() {
        let ggx = Ggx::new(ax, ay);
        for (v, cos) in [1.0f32, 0.5, 0.15].into_iter().enumerate() {
            let wo = direction(cos, 0.4);
            let mut u = Uniform::new((100 + 10 * k + v) as u64);
            let what = format!("alpha {ax} x {ay}, cos {cos}");
            let test = DensityTest { columns: 24, rows: 32, samples: 40_000 };
            let sample = || Some(direction_to_square(ggx.sample_visible(wo, u.pair()).to_array()));
            let density = |p: [f64; 2]| {
                let m = to_local(p).0;
                if m.z > 0.0 { 4.0 * PI * f64::from(ggx.pdf_visible(wo, m)) } else { 0.0 }
            };
            test.run(&what, sample, density).assert(sidak(RATE, 12), &what);
        }
    }
}

#[test]
fn narrow_lobes_are_wide_ones_scaled() {
    // Seen along the normal, r^2 / (1 + r^2) of the slope r in units of alpha is uniform for GGX, whatever alpha
    // (Walter et al. 2007). That tests lobes that no grid over the sphere resolves.
    for (k, alpha) in [1e-4f32, 1e-3, 0.01, 0.3].into_iter().enumerate() {
        let ggx = Ggx::new(alpha, alpha);
        let mut u = Uniform::new(200 + k as u64);
        let what = format!("alpha {alpha}");
        let sample = || {
            let m = ggx.sample_visible(direction(1.0, 0.0), u.pair());
            let r2 = f64::from((m.x * m.x + m.y * m.y) / (m.z * m.z)) / f64::from(alpha).powi(2);
            Some([direction_to_square(m.to_array())[0], r2 / (1.0 + r2)])
        };
        DensityTest::default().run(&what, sample, |_| 1.0).assert(sidak(RATE, 4), &what);
    }
}

#[test]
fn coat_half_vectors_follow_their_density() {
    // For GTR1 the share within angle t is ln(1 + (1/a^2 - 1) cos^2 ...); tested in that variable, which is uniform.
    for (k, gloss) in [0.0f32, 0.5, 1.0].into_iter().enumerate() {
        let alpha = clearcoat::alpha_from_gloss(gloss);
        let a2 = f64::from(alpha).powi(2);
        let mut u = Uniform::new(300 + k as u64);
        let sample = || {
            let m = clearcoat::sample_half_vector(u.pair(), alpha);
            let sin2 = f64::from(m.x).powi(2) + f64::from(m.y).powi(2);
            // Integral of 2 pi D cos sin dt from 0 to t, in closed form (Burley 2012, appendix B).
            let share = ((sin2 + a2 * (1.0 - sin2)) / a2).ln() / (1.0 / a2).ln();
            Some([direction_to_square(m.to_array())[0], share.clamp(0.0, 1.0)])
        };
        let what = format!("gloss {gloss}");
        DensityTest::default().run(&what, sample, |_| 1.0).assert(sidak(RATE, 3), &what);
        // The density is the derivative of that share.
        let at = |sin2: f64| ((sin2 + a2 * (1.0 - sin2)) / a2).ln() / (1.0 / a2).ln();
        for sin2 in [1e-7, 1e-4, 0.01, 0.5] {
            let h = sin2 * 1e-4;
            let expected = (at(sin2 + h) - at(sin2 - h)) / (2.0 * h) / PI;
            let (s, c) = (sin2.sqrt() as f32, (1.0 - sin2).sqrt() as f32);
            let d = f64::from(clearcoat::distribution(Vec3::new(s, 0.0, c), alpha));
            assert!((d / expected - 1.0).abs() < 1e-4, "gloss {gloss}, sin^2 {sin2}: {d}, expected {expected}");
        }
    }
}

#[test]
fn bounded_normals_waste_fewer_samples() {
    // At grazing angles much of what plain visible normals reflect goes below the surface (Eto and Tokuyoshi 2023).
    let ggx = Ggx::new(0.8, 0.8);
    let wo = direction(0.2, 0.0);
    let mut u = Uniform::new(400);
    let lost = |sample: &mut dyn FnMut() -> Vec3| {
        (0..20_000).filter(|_| dunkelfeld_bsdf::microfacet::reflect(wo, sample()).0.z <= 0.0).count()
    };
    let plain = lost(&mut || ggx.sample_visible(wo, u.pair()));
    let bounded = lost(&mut || ggx.sample_bounded(wo, u.pair()));
    assert!(2 * bounded < plain, "lost {bounded} bounded, {plain} plain");
}

#[test]
fn a_sample_weighs_what_evaluation_says() {
    for (k, (name, bsdf)) in wide_surfaces().into_iter().enumerate() {
        let mut u = Uniform::new(500 + k as u64);
        let mut taken = 0;
        for _ in 0..2000 {
            let wo = u.direction();
            let Some(s) = bsdf.sample(wo, u.next(), u.pair()) else { continue };
            if s.lobe.contains(Lobe::DELTA) {
                continue;
            }
            taken += 1;
            let (value, pdf) = bsdf.eval_pdf(wo, s.wi);
            assert!((s.pdf - pdf).abs() <= 1e-5 * pdf, "{name}: {s:?} but pdf {pdf} for wo {wo:?}");
            for c in 0..3 {
                let claimed = s.weight[c] * s.pdf;
                assert!((claimed - value[c]).abs() <= 1e-5 * value[c], "{name}: {s:?} but eval {value:?}");
            }
            assert_eq!(s.lobe.contains(Lobe::TRANSMISSION), !wo.same_side(s.wi), "{name}: {s:?} from {wo:?}");
            assert_eq!(s.lobe.contains(Lobe::REFLECTION), wo.same_side(s.wi), "{name}: {s:?} from {wo:?}");
        }
        assert!(taken > 300, "{name}: only {taken} samples");
    }
}

#[test]
fn an_absorber_and_a_ray_in_the_surface_scatter_nothing() {
    let flat = LocalDir::new(1.0, 0.0, 0.0);
    for (name, bsdf) in wide_surfaces() {
        assert!(bsdf.sample(flat, 0.3, [0.2, 0.7]).is_none(), "{name}");
        assert_eq!(bsdf.pdf(flat, direction(0.5, 0.0)), 0.0, "{name}");
        assert!(bsdf.eval(direction(0.5, 0.0), flat).is_black(), "{name}");
    }
    assert!(Bsdf::Absorber.sample(direction(0.5, 0.0), 0.5, [0.5, 0.5]).is_none());
    assert!(Bsdf::Absorber.is_delta());
}
