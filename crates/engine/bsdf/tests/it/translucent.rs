//! Diffuse transmission: samples follow the density, and its albedo is that of its parts.
//!
//! Replay: `cargo test -p dunkelfeld-bsdf --test it translucent`.

use crate::common::{Uniform, direction};
use dunkelfeld_bsdf::{Bsdf, Lobe, Principled, PrincipledParams, Translucent};
use dunkelfeld_geometry::{LocalDir, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_testkit::{Claim, DensityTest, SampleMoments, direction_to_square, sidak, square_to_direction};
use std::f64::consts::PI;

/// False-alarm rate of each test function.
const RATE: f64 = 1e-9;

fn surfaces() -> Vec<(&'static str, Bsdf)> {
    let of = |p: PrincipledParams, share: f32, color: Rgb| {
        Bsdf::Translucent(Translucent::new(Principled::new(&p), share, color * share))
    };
    let paper = PrincipledParams { base_color: Rgb::new(0.8, 0.7, 0.5), roughness: 0.6, ..Default::default() };
    let bare = PrincipledParams { specular_factor: 0.0, ..paper };
    vec![
        ("paper", of(paper, 0.4, Rgb::new(0.9, 0.6, 0.3))),
        ("no reflection", of(bare, 1.0, Rgb::WHITE)),
        ("no transmission", of(paper, 0.0, Rgb::WHITE)),
        ("black transmission", of(paper, 0.5, Rgb::BLACK)),
        ("glossy leaf", of(PrincipledParams { roughness: 0.3, ..paper }, 0.7, Rgb::new(0.2, 0.8, 0.1))),
    ]
}

#[test]
fn directions_follow_their_density_on_both_sides() {
    let views = [(1.0, 0.0), (0.4, 0.7), (-0.6, -1.0)];
    let count = surfaces().len() * views.len();
    for (s, (name, bsdf)) in surfaces().into_iter().enumerate() {
        for (v, (cos, phi)) in views.into_iter().enumerate() {
            let wo = direction(cos, phi);
            let mut u = Uniform::new((900 + s * 10 + v) as u64);
            let sample = || Some(direction_to_square(bsdf.sample(wo, u.next(), u.pair())?.wi.0.to_array()));
            let density = |p| {
                let wi = LocalDir(Vec3::from_array(square_to_direction(p).map(|x| x as f32)));
                4.0 * PI * f64::from(bsdf.pdf(wo, wi))
            };
            let what = format!("{name}, cos wo {cos}");
            let test = DensityTest { columns: 24, rows: 16, samples: 40_000 };
            test.run(&what, sample, density).assert(sidak(RATE, count), &what);
        }
    }
}

#[test]
fn transmittance_is_share_times_colour() {
    // Lambert: without specular reflection, the albedo of transmission is its coefficient for every direction.
    let bare = PrincipledParams { specular_factor: 0.0, ..Default::default() };
    let bsdf = Bsdf::Translucent(Translucent::new(Principled::new(&bare), 0.4, Rgb::splat(0.36)));
    for cos in [1.0, 0.3, -0.8] {
        let wo = direction(cos, 0.4);
        Claim { expected: 0.36, tolerance: 1e-6, sure: 3e-3 }.assert(&format!("cos {cos}"), |look| {
            let mut u = Uniform::new(990 + u64::from(look));
            let passed = |_| {
                let s = bsdf.sample(wo, u.next(), u.pair());
                s.filter(|s| s.lobe.contains(Lobe::TRANSMISSION)).map_or(0.0, |s| f64::from(s.weight.r))
            };
            (0..40_000u32 << (2 * look)).map(passed).collect::<SampleMoments>().into()
        });
    }
}
