//! The samplers of shapes: density per solid angle, inverse, ends of the random numbers, for near, far and slanted views.
//!
//! Replay: `cargo test -p dunkelfeld-geometry --test it samplers::NAME`.

use dunkelfeld_geometry::Vec3;
use dunkelfeld_geometry::shape::{
    Rectangle, invert_rectangle, invert_triangle, invert_triangle_area, pdf_rectangle, pdf_triangle, pdf_triangle_area,
    sample_rectangle, sample_triangle, sample_triangle_area,
};
use dunkelfeld_testkit::{SamplerCase, check_corners, check_densities, check_inverses, check_names};

/// Points over the middle, a corner, beside the shape, close to its plane, and far away.
const REFERENCES: [[f32; 3]; 6] =
    [[0.5, 0.4, 0.3], [0.02, -0.01, 0.05], [1.5, 0.3, -0.4], [2.0, 2.0, 0.1], [0.5, 0.5, 3.0], [30.0, -20.0, 900.0]];

fn rectangle() -> Rectangle {
    Rectangle { corner: Vec3::ZERO, edge_u: Vec3::new(1.2, 0.0, 0.0), edge_v: Vec3::new(0.0, 0.7, 0.0) }
}

fn corners() -> [Vec3; 3] {
    [Vec3::ZERO, Vec3::new(1.1, 0.1, 0.0), Vec3::new(0.3, 0.9, 0.0)]
}

/// Solid angle per area of the shape at a point of it: `|cos| / d^2`.
fn solid_angle_per_area(reference: Vec3, point: Vec3) -> f64 {
    let d = (point - reference).as_dvec3();
    reference.as_dvec3().z.abs() / d.length_squared().powf(1.5)
}

fn all() -> Vec<SamplerCase> {
    let mut cases = vec![
        SamplerCase::new(
            "triangle::sample_triangle_area",
            "",
            |u| Some(sample_triangle_area(u).map(f64::from)),
            |p| f64::from(pdf_triangle_area(p.map(|x| x as f32))),
        )
        .with_inverse(|u| Some(invert_triangle_area(sample_triangle_area(u))), 1e-6),
    ];
    for reference in REFERENCES.map(Vec3::from_array) {
        let r = rectangle();
        // A sample is described by fractions of the edges, or by the weights of two corners. The density over them is
        // the one per solid angle, times solid angle per area, times area per unit of the coordinates.
        let density = move |p: [f64; 2]| {
            let point = r.point(p[0] as f32, p[1] as f32);
            let pdf = f64::from(pdf_rectangle(&r, reference, point));
            pdf * solid_angle_per_area(reference, point) * f64::from(r.area())
        };
        let sample = move |u| Some(sample_rectangle(&r, reference, u)?.coordinates.map(f64::from));
        let there_and_back = move |u| invert_rectangle(&r, reference, sample_rectangle(&r, reference, u)?.coordinates);
        cases.push(
            SamplerCase::new("rectangle::sample_rectangle", format!("from {reference}"), sample, density)
                .with_inverse(there_and_back, 2e-5),
        );

        let t = corners();
        let (e1, e2) = (t[1] - t[0], t[2] - t[0]);
        let density = move |p: [f64; 2]| {
            if p[0] + p[1] > 1.0 {
                return 0.0;
            }
            let point = t[0] + p[0] as f32 * e1 + p[1] as f32 * e2;
            let pdf = f64::from(pdf_triangle(&t, reference, point));
            pdf * solid_angle_per_area(reference, point) * f64::from(e1.cross(e2).length())
        };
        let sample = move |u| Some(sample_triangle(&t, reference, u)?.coordinates.map(f64::from));
        let there_and_back = move |u| invert_triangle(&t, reference, sample_triangle(&t, reference, u)?.coordinates);
        cases.push(
            SamplerCase::new("triangle::sample_triangle", format!("from {reference}"), sample, density)
                .with_inverse(there_and_back, 2e-5),
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
    let exempt = [
        ("rectangle::sample", "the method behind `sample_rectangle`, which has its case"),
        ("triangle::sample", "the method behind `sample_triangle`, which has its case"),
    ];
    check_names(concat!(env!("CARGO_MANIFEST_DIR"), "/src"), &all(), &exempt);
}
