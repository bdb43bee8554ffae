//! Every warp and distribution: one harness for density, inverse and robustness.

use dunkelfeld_sampling::warp::*;
use dunkelfeld_sampling::{Distribution1D, Distribution2D};
use dunkelfeld_testkit::{SamplerCase, check_corners, check_densities, check_inverses, check_names};
use glam::{Vec2, Vec3};

/// False-alarm rate of the whole table.
const RATE: f64 = 1e-9;

/// A warp to directions.
fn directional(
    function: &str,
    case: String,
    sample: impl Fn([f32; 2]) -> Vec3 + Copy + 'static,
    pdf: impl Fn(Vec3) -> f32 + 'static,
    invert: impl Fn(Vec3) -> [f32; 2] + 'static,
    tolerance: f32,
) -> SamplerCase {
    let density = move |w| pdf(Vec3::from_array(w));
    SamplerCase::directional(&format!("warp::{function}"), case, move |u| Some(sample(u).to_array()), density)
        .with_inverse(move |u| Some(invert(sample(u))), tolerance)
}

/// A warp to points of the plane within the unit circle.
fn planar(
    function: &str,
    case: String,
    sample: impl Fn([f32; 2]) -> Vec2 + Copy + 'static,
    pdf: impl Fn(Vec2) -> f32 + 'static,
    invert: impl Fn(Vec2) -> [f32; 2] + 'static,
) -> SamplerCase {
    SamplerCase::new(
        &format!("warp::{function}"),
        case,
        move |u| Some(sample(u).to_array().map(|x| 0.5 + 0.5 * f64::from(x).clamp(-1.0, 1.0))),
        move |[x, y]| 4.0 * f64::from(pdf(Vec2::new(2.0 * x as f32 - 1.0, 2.0 * y as f32 - 1.0))),
    )
    .with_inverse(move |u| Some(invert(sample(u))), 2e-5)
}

fn distribution_2d(name: &str, width: usize, height: usize, weights: Vec<f64>) -> SamplerCase {
    let d = Distribution2D::new(width, height, weights);
    let (a, b, c) = (d.clone(), d.clone(), d);
    SamplerCase::new(
        "distribution::sample_continuous",
        name,
        move |u| {
            let (p, pdf) = a.sample_continuous(u);
            let again = a.pdf_continuous(p);
            assert!((pdf - again).abs() <= 1e-4 * pdf, "sample claims {pdf}, pdf says {again} at {p:?} from {u:?}");
            Some(p.map(f64::from))
        },
        move |p| f64::from(b.pdf_continuous(p.map(|x| x as f32))),
    )
    .with_inverse(move |u| Some(c.invert_continuous(c.sample_continuous(u).0)), 1e-5)
}

fn distribution_1d(name: &str, weights: Vec<f64>) -> SamplerCase {
    let d = Distribution1D::new(weights);
    let (a, b, c) = (d.clone(), d.clone(), d);
    SamplerCase::new(
        "distribution::sample_continuous",
        name,
        move |[u, v]| Some([f64::from(a.sample_continuous(u).0), f64::from(v)]),
        move |[x, _]| f64::from(b.pdf_continuous(x as f32)),
    )
    .with_inverse(move |[u, v]| Some([c.invert_continuous(c.sample_continuous(u).0), v]), 1e-5)
}

fn all() -> Vec<SamplerCase> {
    let plain = String::new;
    let mut warps = vec![
        planar("sample_disk", plain(), sample_disk, pdf_disk, invert_disk),
        directional(
            "sample_cosine_hemisphere",
            plain(),
            sample_cosine_hemisphere,
            pdf_cosine_hemisphere,
            invert_cosine_hemisphere,
            2e-5,
        ),
        directional("sample_sphere", plain(), sample_sphere, pdf_sphere, invert_sphere, 1e-5),
        distribution_1d("line", vec![1.0, 0.0, 3.0, 0.5, 0.0, 0.0, 2.0]),
        distribution_1d("line of zeros", vec![0.0; 5]),
        distribution_1d("empty line", vec![]),
        distribution_2d("map", 8, 4, (0..32).map(|i| f64::from(i * 7 % 11)).collect()),
        distribution_2d("map with dark rows", 3, 4, vec![0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 0.0, 0.0, 0.0, 2.0, 2.0, 0.0]),
        distribution_2d("map of zeros", 3, 2, vec![0.0; 6]),
    ];
    for (corners, rotation) in [(3, 0.0), (5, 0.3), (6, -1.0), (9, 4.0)] {
        warps.push(planar(
            "sample_polygon",
            format!("of {corners} corners"),
            move |u| sample_polygon(u, corners, rotation),
            move |p| pdf_polygon(p, corners, rotation),
            move |p| invert_polygon(p, corners, rotation),
        ));
    }
    warps
}

#[test]
fn samples_follow_their_density() {
    check_densities(&all(), RATE);
}

#[test]
fn inverses_lead_back() {
    check_inverses(&all());
}

#[test]
fn corners_of_the_square_give_valid_points() {
    check_corners(&all());
    let last = 1.0 - f32::EPSILON / 2.0;
    for u in [[0.0, 0.5], [last, 0.5], [0.5, last], [0.5, 0.0]] {
        let w = sample_cosine_hemisphere(u);
        assert!(w.z > 0.0 && (w.length() - 1.0).abs() < 1e-5, "{u:?} gives {w}");
    }
}

#[test]
fn no_sampler_is_left_out() {
    let one_lane = "one lane of it is the function of the same name, which has its case";
    let exempt = [
        ("distribution::sample_discrete", "a choice has no inverse; it has a test of its own here"),
        ("lanes::sample_disk", one_lane),
        ("lanes::sample_polygon", one_lane),
        ("lanes::sample_cosine_hemisphere", one_lane),
        ("lanes::sample_sphere", one_lane),
    ];
    check_names(concat!(env!("CARGO_MANIFEST_DIR"), "/src"), &all(), &exempt);
}

#[test]
fn discrete_choices_have_the_weights_they_were_given() {
    let d = Distribution1D::new([0.0, 1.0, 0.0, 3.0, f64::NAN, -5.0, f64::INFINITY, 0.0]);
    assert_eq!((d.len(), d.sum()), (8, 4.0));
    assert_eq!((d.pdf_discrete(1), d.pdf_discrete(3), d.pdf_discrete(7), d.pdf_discrete(99)), (0.25, 0.75, 0.0, 0.0));
    for k in 0..1000 {
        let u = k as f32 / 1000.0;
        let c = d.sample_discrete(u);
        assert_eq!(c.index, if u < 0.25 { 1 } else { 3 });
        assert_eq!(c.probability, d.pdf_discrete(c.index));
        assert!((0.0..1.0).contains(&c.remapped));
    }
    assert_eq!(d.sample_discrete(1.0 - f32::EPSILON / 2.0).index, 3);
}

#[test]
fn a_range_of_1e12_keeps_its_shares() {
    let d = Distribution1D::new((0..10_000).map(|i| if i == 5_000 { 1e12 } else { 1.0 }));
    assert!((d.pdf_discrete(5_000) - 1.0).abs() < 1e-7);
    assert!((f64::from(d.pdf_discrete(9_999)) / 1e-12 - 1.0).abs() < 1e-3);
    let bad = Distribution1D::new([f64::MAX, f64::MAX]);
    assert_eq!(bad.pdf_discrete(0), 0.5);
}
