//! Samples follow their densities (chi-squared), on both sides of every surface.

use crate::common::chart::{narrow, wide};
use crate::common::{Uniform, direction, facet_surfaces, wide_surfaces};
use dunkelfeld_bsdf::clearcoat;
use dunkelfeld_bsdf::{Bsdf, Lobe};
use dunkelfeld_geometry::{LocalDir, Vec3};
use dunkelfeld_testkit::{DensityTest, direction_to_square, sidak, square_to_direction};
use std::f64::consts::PI;

/// False-alarm rate of each test function.
const RATE: f64 = 1e-9;

#[test]
#[ignore = "long: .ci/run runs it"]
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
            let test = DensityTest { columns: 16, rows: 12, samples: 40_000 };
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
#[ignore = "long: .ci/run runs it"]
fn facets_of_any_roughness_follow_their_density() {
    // Half vectors in units of the roughness: lobes that no grid over the sphere resolves. The left half of the square is
    // the first chart of a surface, the right half the second.
    let surfaces = facet_surfaces();
    let views = [(0.7, 0.7), (0.15, 2.0), (-0.6, -1.0)];
    let count = surfaces.len() * views.len();
    for (s, surface) in surfaces.iter().enumerate() {
        for (v, (cos, phi)) in views.into_iter().enumerate() {
            let wo = direction(cos, phi);
            if cos < 0.0 && surface.bsdf.pdf(wo, direction(cos, phi + 3.0)) == 0.0 && surface.charts.len() == 1 {
                continue;
            }
            let halves = surface.charts.len() as f64;
            let mut u = Uniform::new((1000 + s * 10 + v) as u64);
            let sample = || {
                let sample = surface.bsdf.sample(wo, u.next(), u.pair())?;
                let wi = wide(sample.wi);
                let mut squares = surface.charts.iter().map(|c| c.square(wide(wo), wi)).enumerate();
                let (k, [x, y]) = squares.find_map(|(k, p)| Some((k, p?))).expect("some facet");
                Some([(x + k as f64) / halves, y])
            };
            let density = |[x, y]: [f64; 2]| {
                let k = ((x * halves) as usize).min(surface.charts.len() - 1);
                let at = surface.charts[k].at(wide(wo), [(x * halves - k as f64).clamp(0.0, 1.0), y]);
                // A millionth everywhere, for samples that f32 rounds over the borders of the lobe.
                1e-6 + at.map_or(0.0, |(wi, d)| halves * f64::from(surface.bsdf.pdf(wo, narrow(wi))) / d)
            };
            let what = format!("{}, cos wo {cos}", surface.name);
            let test = DensityTest { columns: 12, rows: 8, samples: 20_000 };
            test.run(&what, sample, density).assert(sidak(RATE, count), &what);
        }
    }
}

#[test]
fn the_density_of_the_coat_is_the_derivative_of_its_distribution() {
    for gloss in [0.0f32, 0.5, 1.0] {
        // The share of half vectors within sin^2 is ln((sin^2 + a^2 cos^2) / a^2) / ln(1 / a^2) (Burley 2012, GTR1).
        let alpha = clearcoat::alpha_from_gloss(gloss);
        let a2 = f64::from(alpha).powi(2);
        let at = |sin2: f64| ((sin2 + a2 * (1.0 - sin2)) / a2).ln() / (1.0 / a2).ln();
        for sin2 in [1e-7, 1e-4, 0.01, 0.5] {
            let h = sin2 * 1e-4;
            let expected = (at(sin2 + h) - at(sin2 - h)) / (2.0 * h) / PI;
            let (s, c) = (sin2.sqrt() as f32, (1.0 - sin2).sqrt() as f32);
            let d = f64::from(clearcoat::Coat::new(alpha).distribution(Vec3::new(s, 0.0, c).into()));
            assert!((d / expected - 1.0).abs() < 1e-4, "gloss {gloss}, sin^2 {sin2}: {d}, expected {expected}");
        }
    }
}

#[test]
fn the_weight_of_a_sample_is_that_of_evaluation() {
    let narrow = facet_surfaces().into_iter().map(|s| (s.name, s.bsdf));
    let all: Vec<_> = wide_surfaces().into_iter().chain(narrow).collect();
    let compensated = all.iter().map(|(n, b)| (format!("{n}, compensated"), b.with_energy_compensation()));
    for (k, (name, bsdf)) in all.iter().cloned().chain(compensated).enumerate() {
        let mut u = Uniform::new(500 + k as u64);
        let mut taken = 0;
        for _ in 0..1000 {
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
        assert!(taken > 150, "{name}: only {taken} samples");
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
