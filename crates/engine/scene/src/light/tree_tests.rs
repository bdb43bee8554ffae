//! Tests of the light tree: its draws follow its probabilities, and every visible light has a probability above zero.
//!
//! False-alarm rate of each statistical check: 1e-10. Replay: `cargo test -p dunkelfeld-scene light_tree NAME`.

use super::*;
use crate::light::delta::DeltaLight;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_sampling::warp::sample_sphere;
use dunkelfeld_testkit::chi_squared;

const RATE: f64 = 1e-10;

/// Four uniform numbers; the same for the same arguments.
fn uniform(stream: u32, index: u32) -> [f32; 4] {
    Sampler::new(17, stream, index / 64, index % 64).get_4d(0)
}

fn place(u: [f32; 4], size: f32) -> Vec3 {
    size * (Vec3::new(u[0], u[1], u[2]) - 0.5)
}

/// A light of these tests: a point, a spot with a hard edge, or a small square.
#[derive(Clone, Copy)]
enum Lamp {
    Point(Vec3, f32),
    Spot(Vec3, Vec3, f32, f32),
    Square { center: Vec3, normal: Vec3, edges: [Vec3; 2], radiance: f32, two_sided: bool },
}

impl Lamp {
    fn bounds(&self) -> LightBounds {
        match *self {
            Self::Point(p, peak) => {
                LightBounds { bounds: Aabb::from_points([p]), cone: EmissionCone::beam(Vec3::Z, PI), peak }
            }
            Self::Spot(p, axis, angle, peak) => {
                LightBounds { bounds: Aabb::from_points([p]), cone: EmissionCone::beam(axis, angle), peak }
            }
            Self::Square { center, normal, edges: [u, v], radiance, two_sided } => {
                let corners = [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)];
                let area = u.cross(v).length();
                LightBounds {
                    bounds: Aabb::from_points(corners.map(|(a, b)| center + a * u + b * v)),
                    cone: EmissionCone::surface(normal, two_sided),
                    peak: radiance * area,
                }
            }
        }
    }

    /// Irradiance at a receiver; for a square, that of its centre.
    fn irradiance(&self, r: &Receivers<f32>) -> f64 {
        let (point, normal) = (Vec3::from(r.point), Vec3::from(r.normal));
        let facing = |d: Vec3| match (normal == Vec3::ZERO, r.both_sides) {
            (true, _) => 1.0,
            (false, true) => d.dot(normal).abs(),
            (false, false) => d.dot(normal).max(0.0),
        };
        let delta = |light: DeltaLight| {
            let a = light.arriving_at::<f32>(point.into(), &[]);
            f64::from(a.irradiance.g * facing(a.direction.into()))
        };
        match *self {
            Self::Point(position, peak) => delta(DeltaLight::Point { position, intensity: Rgb::splat(peak) }),
            Self::Spot(position, axis, angle, peak) => delta(DeltaLight::Spot {
                position,
                axis,
                intensity: Rgb::splat(peak),
                cos_inner: angle.cos(),
                cos_outer: angle.cos(),
            }),
            Self::Square { center, normal, edges: [u, v], radiance, two_sided } => {
                let to_light = center - point;
                let d = to_light.normalize();
                let cos = -d.dot(normal);
                let cos = if two_sided { cos.abs() } else { cos.max(0.0) };
                f64::from(radiance * u.cross(v).length() * cos * facing(d) / to_light.length_squared())
            }
        }
    }
}

/// Lights of all kinds in a few clusters.
fn lamps(count: u32) -> Vec<Lamp> {
    (0..count)
        .map(|i| {
            let (a, b) = (uniform(1, i), uniform(2, i));
            let middle = place(uniform(3, i % 7), 4.0);
            let at = middle + place(a, 0.6);
            let axis = sample_sphere([b[0], b[1]]);
            let strength = (4.0 * b[2]).exp();
            match i % 4 {
                0 => Lamp::Point(at, strength),
                1 => Lamp::Spot(at, axis, 0.1 + 1.4 * b[3], strength),
                k => {
                    let u = axis.any_orthonormal_vector();
                    let edges = [0.1 * u, 0.2 * b[3] * axis.cross(u)];
                    Lamp::Square { center: at, normal: axis, edges, radiance: 30.0 * strength, two_sided: k == 3 }
                }
            }
        })
        .collect()
}

fn tree(lamps: &[Lamp]) -> LightTree {
    let bounds: Vec<_> = lamps.iter().map(|l| Some(l.bounds())).collect();
    LightTree::new(&bounds, &vec![1.0; lamps.len()])
}

/// Points between, in and beside the lights: with any normal, one- or two-sided, or in a medium.
fn receivers(count: u32) -> impl Iterator<Item = Receivers<f32>> {
    (0..count).map(|i| {
        let (a, b) = (uniform(4, i), uniform(5, i));
        let normal = if i % 5 == 4 { Vec3::ZERO } else { sample_sphere([b[0], b[1]]) };
        Receivers::single(place(a, [0.5, 5.0, 40.0][i as usize % 3]), normal, i % 5 > 2)
    })
}

fn sum(tree: &LightTree, r: &Receivers<f32>, lights: usize) -> f64 {
    (0..lights).map(|i| f64::from(tree.probability(r, i))).sum()
}

#[test]
fn draws_follow_the_probabilities() {
    const N: u32 = 100_000;
    let lamps = lamps(300);
    let tree = tree(&lamps);
    for (k, r) in receivers(10).enumerate() {
        // The last entry counts draws without a light: a path down the tree may end where no light is visible.
        let mut observed = vec![0u64; lamps.len() + 1];
        for i in 0..N {
            let drawn = tree.choose(&r, uniform(6 + k as u32, i)[0]);
            if let Some((light, probability)) = drawn {
                assert_eq!(probability.to_bits(), tree.probability(&r, light).to_bits(), "light {light}");
            }
            observed[drawn.map_or(lamps.len(), |(light, _)| light)] += 1;
        }
        let mut expected: Vec<f64> =
            (0..lamps.len()).map(|i| f64::from(N) * f64::from(tree.probability(&r, i))).collect();
        let nothing = f64::from(N) - expected.iter().sum::<f64>();
        assert!(nothing > -1.0, "the probabilities exceed one by {}", -nothing / f64::from(N));
        if nothing < 1.0 {
            assert_eq!(observed.pop(), Some(0), "receiver {k}");
        } else {
            expected.push(nothing);
        }
        chi_squared(&observed, &expected).assert(RATE, &format!("receiver {k}: {r:?}"));
    }
}

#[test]
fn probabilities_sum_to_one_if_every_light_can_contribute_and_to_less_otherwise() {
    let all = lamps(1000);
    let tree_of_all = tree(&all);
    let points: Vec<Lamp> = all.iter().filter(|l| matches!(l, Lamp::Point(..))).copied().collect();
    let tree_of_points = tree(&points);
    for r in receivers(60) {
        let total = sum(&tree_of_all, &r, all.len());
        assert!(total < 1.0 + 1e-4, "{total} at {r:?}");
        let seen = Receivers { both_sides: true, ..r };
        let total = sum(&tree_of_points, &seen, points.len());
        assert!((total - 1.0).abs() < 1e-4, "{total} at {seen:?}");
    }
}

#[test]
fn every_light_that_can_contribute_has_a_positive_probability() {
    let lamps = lamps(1000);
    let tree = tree(&lamps);
    for r in receivers(200) {
        for (i, lamp) in lamps.iter().enumerate().filter(|(_, l)| l.irradiance(&r) > 0.0) {
            assert!(tree.probability(&r, i) > 0.0, "light {i} brings {} to {r:?}", lamp.irradiance(&r));
        }
    }
    // A receiver almost in the plane of a light, and lights that emit almost past it.
    let square = |height: f32| Lamp::Square {
        center: Vec3::new(1.0, 0.0, height),
        normal: -Vec3::Z,
        edges: [0.1 * Vec3::X, 0.1 * Vec3::Y],
        radiance: 1.0,
        two_sided: false,
    };
    let lamps: Vec<Lamp> = [1e-9, 1e-7, 1e-5, 1e-3].map(square).into_iter().collect();
    let tree = self::tree(&lamps);
    let r = Receivers::single(Vec3::ZERO, Vec3::Z, false);
    assert!((0..lamps.len()).all(|i| tree.probability(&r, i) > 0.0));
}

#[test]
fn lights_that_face_away_have_probability_zero() {
    // Two walls of panels back to back. On either side only one of them can be drawn.
    let wall = |x: f32, normal: Vec3| {
        (0..100u32).map(move |i| Lamp::Square {
            center: Vec3::new(x, (i % 10) as f32 * 0.1, (i / 10) as f32 * 0.1),
            normal,
            edges: [0.1 * Vec3::Y, 0.1 * Vec3::Z],
            radiance: 1.0,
            two_sided: false,
        })
    };
    let lamps: Vec<Lamp> = wall(0.01, Vec3::X).chain(wall(-0.01, -Vec3::X)).collect();
    let tree = tree(&lamps);
    let r = Receivers::single(Vec3::new(3.0, 0.5, 0.5), -Vec3::X, true);
    let share: f64 = (100..200).map(|i| f64::from(tree.probability(&r, i))).sum();
    assert_eq!(share, 0.0);
    assert!((sum(&tree, &r, 200) - 1.0).abs() < 1e-5);
    // Nor do lights below the horizon of a surface that scatters light from above only.
    let up = Receivers::single(Vec3::new(0.5, 0.5, 3.0), Vec3::Z, false);
    assert_eq!(tree.choose(&up, 0.5), None);
}

#[test]
fn infinite_lights_have_their_share_of_the_power_and_dark_lights_have_none() {
    let mut bounds: Vec<Option<LightBounds>> = lamps(100).iter().map(|l| Some(l.bounds())).collect();
    bounds.extend([None, None]);
    bounds[3].as_mut().unwrap().peak = 0.0;
    let mut power = vec![1.0; 102];
    (power[100], power[101]) = (40.0, 10.0);
    let tree = LightTree::new(&bounds, &power);
    for r in receivers(20) {
        // 50 W of 149 W.
        let [a, b] = [100, 101].map(|i| tree.probability(&r, i));
        assert!((a / b - 4.0).abs() < 1e-4 && (a + b - 50.0 / 149.0).abs() < 1e-5, "{a} and {b}");
        assert_eq!(tree.probability(&r, 3), 0.0);
        for i in 0..1000 {
            if let Some((light, p)) = tree.choose(&r, uniform(9, i)[0]) {
                assert_eq!(p.to_bits(), tree.probability(&r, light).to_bits());
            }
        }
    }
    // Without lights in the tree, they have all draws.
    let tree = LightTree::new(&[None, None], &[1.0, 3.0]);
    let r = Receivers::single(Vec3::ZERO, Vec3::Z, false);
    assert!((sum(&tree, &r, 2) - 1.0).abs() < 1e-6 && tree.choose(&r, 0.9).is_some());
    // Without any light nothing is drawn.
    assert_eq!(LightTree::new(&[], &[]).choose(&r, 0.5), None);
}
