//! The Henyey-Greenstein phase function: samples follow the density, its integral is one, and the mean cosine is `g`.
//!
//! Replay: `cargo test -p dunkelfeld-bsdf --test it phase`.

use crate::common::Uniform;
use dunkelfeld_bsdf::HenyeyGreenstein;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_testkit::{DensityTest, direction_to_square, sidak};
use std::f64::consts::PI;

/// False-alarm rate of each test function.
const RATE: f64 = 1e-9;

fn view() -> Vec3 {
    Vec3::new(0.48, -0.6, 0.64)
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
