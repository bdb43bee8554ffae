//! The samplers of the lobes: density, inverse, ends of the random numbers, over slopes and views.
//!
//! Replay: `cargo test -p dunkelfeld-bsdf --test it samplers::NAME`.

use crate::common::chart::{Chart, narrow, wide};
use crate::common::direction;
use dunkelfeld_bsdf::microfacet::Ggx;
use dunkelfeld_bsdf::{HenyeyGreenstein, clearcoat};
use dunkelfeld_geometry::{LocalDir, Vec3};
use dunkelfeld_testkit::{DensityTest, SamplerCase, check_corners, check_densities, check_inverses, check_names};

const UP: LocalDir = LocalDir(Vec3::Z);

/// A sampler of normals in the chart of facets of the given slopes. With `wo` along the normal of the surface, a facet
/// is the half vector of its mirrored `wo`.
fn normals(
    function: &str,
    case: String,
    slopes: [f32; 2],
    sample: impl Fn([f32; 2]) -> Vec3 + Copy + 'static,
    pdf: impl Fn(Vec3) -> f32 + 'static,
    invert: impl Fn(Vec3) -> [f32; 2] + 'static,
    tolerance: f32,
) -> SamplerCase {
    let chart = Chart::normals(slopes.map(f64::from));
    SamplerCase::new(
        function,
        case,
        move |u| chart.square(wide(UP), wide(LocalDir(sample(u)))),
        move |p| {
            let (m, per_area) = chart.at(wide(UP), p).expect("a normal");
            f64::from(pdf(narrow(m).0)) / per_area
        },
    )
    .with_inverse(move |u| Some(invert(sample(u))), tolerance)
    .with_grid(DensityTest { columns: 14, rows: 12, samples: 30_000 })
}

fn all() -> Vec<SamplerCase> {
    let mut cases = Vec::new();
    for (ax, ay) in [(1e-4, 1e-4), (1e-3, 1e-2), (0.04, 0.04), (0.05, 0.5), (1.0, 1.0), (3.1, 0.3)] {
        for cos in [1.0f32, 0.5, 0.1, 3e-3] {
            let (ggx, wo) = (Ggx::new(ax, ay), direction(cos, 0.4));
            let case = format!("{ax} x {ay}, cos {cos}");
            // A normal in f32 determines its slope to 6e-8 / alpha, and so the random numbers. A view along the surface
            // stretches the cap by as much as the slopes.
            let tolerance = 2e-5 + 3e-7 / ax.min(ay) + 1e-6 / cos;
            cases.push(normals(
                "microfacet::sample_visible",
                case.clone(),
                [ax, ay],
                move |u| ggx.sample_visible(wo.0.into(), u).into(),
                move |m| ggx.pdf_visible(wo.0.into(), m.into()),
                move |m| ggx.invert_visible(wo.0.into(), m.into()),
                tolerance,
            ));
            if cos < 0.1 * ggx.stretch(wo.0.into()) {
                // The cut of the cap lies where steep facets are dense: no grid resolves it. See tests/it/sampling.rs.
                continue;
            }
            cases.push(normals(
                "microfacet::sample_bounded",
                case,
                [ax, ay],
                move |u| ggx.sample_bounded(wo.0.into(), u).into(),
                move |m| ggx.pdf_bounded(wo.0.into(), m.into()),
                move |m| ggx.invert_bounded(wo.0.into(), m.into()),
                tolerance,
            ));
        }
    }
    for gloss in [0.0, 0.5, 0.9, 1.0] {
        let alpha = clearcoat::alpha_from_gloss(gloss);
        let coat = clearcoat::Coat::new(alpha);
        cases.push(normals(
            "clearcoat::sample_half_vector",
            format!("gloss {gloss}"),
            // Uniform in the logarithm of the angle from alpha to 1: the geometric mean resolves both ends.
            [alpha.sqrt(); 2],
            move |u| coat.sample_half_vector(u).into(),
            move |m| coat.pdf_half_vector(m.into()),
            move |m| coat.invert_half_vector(m.into()),
            1e-4,
        ));
    }
    for g in [0.0f32, 1e-6, 0.3, 0.8, 0.95, -0.6, -0.95] {
        let (phase, wo) = (HenyeyGreenstein::new(g), direction(0.3, 1.0).0);
        let sample = move |u| Some(phase.sample(wo, u).to_array());
        let pdf = move |w| phase.pdf(wo, Vec3::from_array(w));
        cases.push(
            SamplerCase::directional("phase::sample", format!("g {g}"), sample, pdf)
                .with_inverse(move |u| Some(phase.invert(wo, phase.sample(wo, u))), 1e-4),
        );
    }
    cases
}

#[test]
fn samples_follow_their_density() {
    // False-alarm rate of all cases together.
    check_densities(&all(), 1e-9);
}

#[test]
fn inverses_lead_back() {
    check_inverses(&all());
}

#[test]
fn corners_of_the_square_give_valid_points() {
    check_corners(&all());
}

#[test]
fn no_sampler_is_left_out() {
    let mixed = "several lobes, chosen between by a third number: no inverse; tests/it/sampling.rs";
    check_names(concat!(env!("CARGO_MANIFEST_DIR"), "/src"), &all(), &[("bsdf::sample", mixed)]);
}
