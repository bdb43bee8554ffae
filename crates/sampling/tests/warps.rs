//! Every warp and distribution: one harness for density, inverse and robustness.

use dunkelfeld_sampling::warp::*;
use dunkelfeld_sampling::{Distribution1D, Distribution2D, keyed_stream};
use dunkelfeld_testkit::{DensityTest, direction_to_square, sidak, square_to_direction};
use glam::{Vec2, Vec3};
use rand_core::Rng;
use std::f64::consts::PI;

/// False-alarm rate of the whole table.
const RATE: f64 = 1e-9;

/// A warp, described on the unit square: where a sample lands, the density there, and the inverse.
struct Warp {
    name: String,
    sample: Box<dyn Fn([f32; 2]) -> [f64; 2]>,
    pdf: Box<dyn Fn([f64; 2]) -> f64>,
    round_trip: Box<dyn Fn([f32; 2]) -> [f32; 2]>,
    /// Largest error of the round trip, on the circle where a coordinate is an angle.
    tolerance: f32,
}

/// A warp to directions.
fn directional(
    name: &str,
    sample: impl Fn([f32; 2]) -> Vec3 + Copy + 'static,
    pdf: impl Fn(Vec3) -> f32 + 'static,
    invert: impl Fn(Vec3) -> [f32; 2] + 'static,
    tolerance: f32,
) -> Warp {
    Warp {
        name: name.into(),
        sample: Box::new(move |u| direction_to_square(sample(u).to_array())),
        pdf: Box::new(move |p| 4.0 * PI * f64::from(pdf(Vec3::from_array(square_to_direction(p).map(|x| x as f32))))),
        round_trip: Box::new(move |u| invert(sample(u))),
        tolerance,
    }
}

/// A warp to points of the plane within the unit circle.
fn planar(
    name: String,
    sample: impl Fn([f32; 2]) -> Vec2 + Copy + 'static,
    pdf: impl Fn(Vec2) -> f32 + 'static,
    invert: impl Fn(Vec2) -> [f32; 2] + 'static,
) -> Warp {
    Warp {
        name,
        sample: Box::new(move |u| sample(u).to_array().map(|x| 0.5 + 0.5 * f64::from(x).clamp(-1.0, 1.0))),
        pdf: Box::new(move |[x, y]| 4.0 * f64::from(pdf(Vec2::new(2.0 * x as f32 - 1.0, 2.0 * y as f32 - 1.0)))),
        round_trip: Box::new(move |u| invert(sample(u))),
        tolerance: 2e-5,
    }
}

fn distribution_2d(name: &str, width: usize, height: usize, weights: Vec<f64>) -> Warp {
    let d = Distribution2D::new(width, height, weights);
    let (a, b, c) = (d.clone(), d.clone(), d);
    Warp {
        name: name.into(),
        sample: Box::new(move |u| {
            let (p, pdf) = a.sample_continuous(u);
            let again = a.pdf_continuous(p);
            assert!((pdf - again).abs() <= 1e-4 * pdf, "sample claims {pdf}, pdf says {again} at {p:?} from {u:?}");
            p.map(f64::from)
        }),
        pdf: Box::new(move |p| f64::from(b.pdf_continuous(p.map(|x| x as f32)))),
        round_trip: Box::new(move |u| c.invert_continuous(c.sample_continuous(u).0)),
        tolerance: 1e-5,
    }
}

fn distribution_1d(name: &str, weights: Vec<f64>) -> Warp {
    let d = Distribution1D::new(weights);
    let (a, b, c) = (d.clone(), d.clone(), d);
    Warp {
        name: name.into(),
        sample: Box::new(move |[u, v]| [f64::from(a.sample_continuous(u).0), f64::from(v)]),
        pdf: Box::new(move |[x, _]| f64::from(b.pdf_continuous(x as f32))),
        round_trip: Box::new(move |[u, v]| [c.invert_continuous(c.sample_continuous(u).0), v]),
        tolerance: 1e-5,
    }
}

fn all() -> Vec<Warp> {
    let mut warps = vec![
        planar("disk".into(), sample_disk, pdf_disk, invert_disk),
        directional(
            "cosine hemisphere",
            sample_cosine_hemisphere,
            pdf_cosine_hemisphere,
            invert_cosine_hemisphere,
            2e-5,
        ),
        directional("hemisphere", sample_hemisphere, pdf_hemisphere, invert_hemisphere, 1e-5),
        directional("sphere", sample_sphere, pdf_sphere, invert_sphere, 1e-5),
        distribution_1d("line", vec![1.0, 0.0, 3.0, 0.5, 0.0, 0.0, 2.0]),
        distribution_1d("line of zeros", vec![0.0; 5]),
        distribution_1d("empty line", vec![]),
        distribution_2d("map", 8, 4, (0..32).map(|i| f64::from(i * 7 % 11)).collect()),
        distribution_2d("map with dark rows", 3, 4, vec![0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 0.0, 0.0, 0.0, 2.0, 2.0, 0.0]),
        distribution_2d("map of zeros", 3, 2, vec![0.0; 6]),
    ];
    for one_minus_cos in [1.9f32, 1.0, 0.2] {
        warps.push(directional(
            &format!("cone {one_minus_cos}"),
            move |u| sample_cone(u, one_minus_cos),
            move |w| pdf_cone(w, one_minus_cos),
            move |w| invert_cone(w, one_minus_cos),
            1e-5,
        ));
    }
    for (corners, rotation) in [(3, 0.0), (5, 0.3), (6, -1.0), (9, 4.0)] {
        warps.push(planar(
            format!("polygon of {corners} corners"),
            move |u| sample_polygon(u, corners, rotation),
            move |p| pdf_polygon(p, corners, rotation),
            move |p| invert_polygon(p, corners, rotation),
        ));
    }
    warps
}

#[test]
fn samples_follow_their_density() {
    let warps = all();
    for w in &warps {
        let mut stream = keyed_stream(1, 0, 0, 0);
        let mut uniform = || (stream.next_u32() >> 8) as f32 / (1 << 24) as f32;
        DensityTest { columns: 21, rows: 20, samples: 100_000 }
            .run(&format!("warp {}", w.name), || Some((w.sample)([uniform(), uniform()])), &w.pdf)
            .assert(sidak(RATE, warps.len()), &w.name);
    }
}

#[test]
fn inverses_lead_back() {
    for w in all() {
        for i in 0..64 {
            for j in 0..64 {
                let u = [(i as f32 + 0.37) / 64.0, (j as f32 + 0.61) / 64.0];
                let v = (w.round_trip)(u);
                let error = u.iter().zip(v).map(|(a, b)| (a - b).abs().min(1.0 - (a - b).abs())).fold(0.0, f32::max);
                assert!(error < w.tolerance, "{}: {u:?} came back as {v:?}", w.name);
            }
        }
    }
}

#[test]
fn corners_of_the_square_give_valid_points() {
    let last = 1.0 - f32::EPSILON / 2.0;
    for w in all() {
        for u in [[0.0, 0.0], [last, 0.0], [0.0, last], [last, last], [0.5, 0.5], [0.5, 0.0], [1e-30, 1e-30]] {
            let p = (w.sample)(u);
            assert!(p.iter().all(|x| (0.0..=1.0).contains(x)), "{}: {u:?} gives {p:?}", w.name);
            assert!((w.round_trip)(u).iter().all(|x| (0.0..=1.0).contains(x)), "{}: {u:?}", w.name);
        }
    }
    for u in [[0.0, 0.5], [last, 0.5], [0.5, last], [0.5, 0.0]] {
        let w = sample_cosine_hemisphere(u);
        assert!(w.z > 0.0 && (w.length() - 1.0).abs() < 1e-5, "{u:?} gives {w}");
    }
}

#[test]
fn sine_and_cosine_of_a_turn() {
    for i in -80_000..=80_000 {
        let turn = i as f32 / 40_000.0;
        let (s, c) = sin_cos_turn(turn);
        let (es, ec) = (f64::from(turn) * 2.0 * PI).sin_cos();
        let error = (f64::from(s) - es).abs().max((f64::from(c) - ec).abs());
        assert!(error < 1.5e-7, "{turn} of a turn: {s}, {c}");
        assert!((s * s + c * c - 1.0).abs() < 3e-7);
    }
}

#[test]
fn a_cone_as_small_as_a_star_keeps_its_precision() {
    let small = 1e-11; // half-angle 4.5 microradians
    for u in [[0.25, 0.1], [0.999, 0.7]] {
        let w = sample_cone(u, small);
        assert!(pdf_cone(w, small) > 0.0);
        let back = invert_cone(w, small);
        assert!((back[0] - u[0]).abs() < 1e-4 && (back[1] - u[1]).abs() < 1e-4, "{u:?} came back as {back:?}");
    }
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
