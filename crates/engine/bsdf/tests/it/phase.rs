//! The Henyey-Greenstein phase function: samples follow the density, its integral is one, and the mean cosine is `g`.
//!
//! Replay: `cargo test -p dunkelfeld-bsdf --test it phase`.

use crate::common::Uniform;
use dunkelfeld_bsdf::HenyeyGreenstein;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_testkit::{Claim, DensityTest, SampleMoments, direction_to_square, sidak, square_to_direction};
use std::f64::consts::PI;

/// False-alarm rate of each test function.
const RATE: f64 = 1e-9;

const MEAN_COSINES: [f32; 9] = [-0.95, -0.7, -0.3, -1e-4, 0.0, 1e-6, 0.3, 0.7, 0.95];

fn view() -> Vec3 {
    Vec3::new(0.48, -0.6, 0.64)
}

#[test]
fn directions_follow_their_density() {
    for (k, g) in MEAN_COSINES.into_iter().enumerate() {
        let phase = HenyeyGreenstein::new(g);
        for (v, wo) in [view(), Vec3::Z, Vec3::NEG_Z].into_iter().enumerate() {
            let mut u = Uniform::new((600 + 10 * k + v) as u64);
            let test = DensityTest { columns: 24, rows: 32, samples: 40_000 };
            let sample = || Some(direction_to_square(phase.sample(wo, u.pair()).to_array()));
            let density = |p| {
                let wi = Vec3::from_array(square_to_direction(p).map(|x| x as f32));
                4.0 * PI * f64::from(phase.pdf(wo, wi))
            };
            let what = format!("g {g}, wo {wo}");
            test.run(&what, sample, density).assert(sidak(RATE, 27), &what);
        }
    }
}

#[test]
fn sharp_peaks_have_the_shape_of_the_formula() {
    // No grid over the sphere resolves these: in the variable F(cos), the distribution in f64, the sample must be uniform.
    let cases = [0.99f32, 0.999, 0.9999, -0.9999, 1.0, -1.0];
    for (k, g) in cases.into_iter().enumerate() {
        let phase = HenyeyGreenstein::new(g);
        let (a, wo) = (f64::from(phase.mean_cosine().abs()), view());
        let mut u = Uniform::new(700 + k as u64);
        let sample = || {
            let wi = phase.sample(wo, u.pair());
            let peak = if g < 0.0 { wo } else { -wo };
            let versine = 0.5 * (wi.as_dvec3() - peak.as_dvec3()).length_squared();
            // The share of deflections with a larger cosine: integral of (1 - g^2) / 2 (1 + g^2 - 2 g c)^(-3/2).
            let s = ((1.0 - a).powi(2) + 2.0 * a * versine).sqrt();
            let share = 1.0 - (1.0 - a * a) / (2.0 * a) * (1.0 / s - 1.0 / (1.0 + a));
            Some([direction_to_square(wi.to_array())[0], share.clamp(0.0, 1.0)])
        };
        let what = format!("g {g}");
        // The azimuth about z is not uniform for a slanted view: one column.
        let test = DensityTest { columns: 1, rows: 64, samples: 100_000 };
        test.run(&what, sample, |_| 1.0).assert(sidak(RATE, cases.len()), &what);
    }
}

#[test]
fn the_mean_cosine_is_g_and_no_direction_is_preferred_for_zero() {
    for (k, g) in MEAN_COSINES.into_iter().chain([0.999]).enumerate() {
        let phase = HenyeyGreenstein::new(g);
        // The spread of cosines is 1 at most: the mean of 50 000 has an error of 0.005. For g = 0.999 all lie within a
        // few thousandths of one.
        Claim { expected: f64::from(g), tolerance: 1e-6, sure: 5e-3 }.assert(&format!("g {g}"), |look| {
            let mut u = Uniform::new(800 + k as u64 + 50 * u64::from(look));
            let cosine = |_| f64::from(-phase.sample(view(), u.pair()).dot(view()));
            (0..50_000u32 << (2 * look)).map(cosine).collect::<SampleMoments>().into()
        });
    }
    let isotropic = HenyeyGreenstein::new(0.0);
    let mut u = Uniform::new(820);
    for _ in 0..1000 {
        assert_eq!(isotropic.pdf(u.direction().0, u.direction().0), (0.25 / PI) as f32, "exactly 1 / 4 pi");
    }
}

#[test]
fn samples_invert_are_unit_vectors_and_agree_with_the_formula() {
    let mut u = Uniform::new(830);
    for _ in 0..20_000 {
        let g = 2.0 * u.next() - 1.0;
        let (phase, wo, numbers) = (HenyeyGreenstein::new(g), u.direction().0, u.pair());
        let wi = phase.sample(wo, numbers);
        assert!((wi.length() - 1.0).abs() < 1e-6, "g {g}: {wi}");
        let back = phase.invert(wo, wi);
        let turn = (back[1] - numbers[1]).abs();
        // Near the axis the azimuth loses precision with its sine. The rounding error of 1 - cos grows by the density.
        let sin = wi.cross(wo).length();
        assert!(turn.min(1.0 - turn) < 1e-6 / sin.max(1e-6), "g {g}, {numbers:?}: {back:?}");
        let tolerance = 1e-5 + 1e-6 * phase.pdf(wo, wi) * sin.max(1e-6) * 2.0 * PI as f32;
        assert!((back[0] - numbers[0]).abs() < tolerance, "g {g}, {numbers:?}: {back:?}");
        // The textbook form in f64.
        let (g, c) = (f64::from(phase.mean_cosine()), -wo.as_dvec3().normalize().dot(wi.as_dvec3().normalize()));
        let textbook = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * c).powf(1.5));
        let own = f64::from(phase.pdf(wo, wi));
        // Directions are unit vectors to 1e-7, and the bracket is as small as (1 - g)^2.
        let rounding = 1e-5 + 6e-7 * g.abs() / (1.0 - g.abs()).powi(2);
        assert!((own / textbook - 1.0).abs() < rounding, "g {g}, cos {c}: {own}, expected {textbook}");
    }
}
