//! Samples of rectangles have the same bits at every width.

use dunkelfeld_geometry::Vec3;
use dunkelfeld_geometry::shape::{
    Rectangle, RectangleLanes, RectangleSampler, pdf_rectangle, sample_rectangle, sample_triangle_area,
};
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, V3, dispatch};

type Row = [f32; MAX_WIDTH];

#[inline(always)]
fn samples<F: Lanes>(
    token: F::Token,
    rectangles: &[RectangleSampler],
    of_lanes: Option<&[usize; MAX_WIDTH]>,
    references: &[Row; 3],
    u: &[Row; 2],
    out: &mut [Row; 7],
) {
    for at in (0..MAX_WIDTH).step_by(F::WIDTH) {
        let mut each = [&rectangles[0]; MAX_WIDTH];
        let lanes = match of_lanes {
            None => RectangleLanes::<F>::splat(token, &rectangles[0]),
            Some(of_lanes) => {
                for lane in 0..F::WIDTH {
                    each[lane] = &rectangles[of_lanes[at + lane]];
                }
                RectangleLanes::gather(token, each)
            }
        };
        let [x, y, z] = references;
        let reference = V3::new(F::load(token, &x[at..]), F::load(token, &y[at..]), F::load(token, &z[at..]));
        let u = [F::load(token, &u[0][at..]), F::load(token, &u[1][at..])];
        let s = lanes.sample(reference, u);
        let (pdf, [b1, b2]) = (lanes.pdf(reference, s.point), sample_triangle_area(u));
        for (row, x) in out.iter_mut().zip([s.point.x, s.point.y, s.point.z, s.pdf, pdf, b1, b2]) {
            x.store(&mut row[at..]);
        }
    }
}

#[test]
fn all_widths_have_the_same_bits() {
    let mut state = 7u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32
    };
    let shapes = [[1.0, 0.7], [0.015, 0.24], [0.3, 0.001], [0.5, 0.5], [1e-3, 2e-3]].map(|[width, length]| Rectangle {
        corner: Vec3::new(0.3, -0.2, 0.1),
        edge_u: Vec3::new(0.6, 0.8, 0.0) * width,
        edge_v: Vec3::new(-0.48, 0.36, 0.8) * length,
    });
    let rectangles = shapes.map(|r| RectangleSampler::new(&r));
    for round in 0..3000 {
        let of_lanes: [usize; MAX_WIDTH] = std::array::from_fn(|_| (random() * 5.0) as usize);
        let (mut references, mut u) = ([[0.0; MAX_WIDTH]; 3], [[0.0; MAX_WIDTH]; 2]);
        for lane in 0..MAX_WIDTH {
            let r = shapes[if round % 2 == 0 { of_lanes[lane] } else { 0 }];
            let height = 2.0 * random().powi(4) * if round % 5 == 0 { 1e-3 } else { 1.0 };
            let p = r.point(3.0 * random() - 1.0, 3.0 * random() - 1.0) + r.normal() * height;
            (references[0][lane], references[1][lane], references[2][lane]) = (p.x, p.y, p.z);
            (u[0][lane], u[1][lane]) = (random(), random());
        }
        for set in InstructionSet::all() {
            let mut out = [[0.0; MAX_WIDTH]; 7];
            let each = (round % 2 == 0).then_some(&of_lanes);
            dispatch!(set, F, token => samples::<F>(token, &rectangles, each, &references, &u, &mut out));
            for lane in 0..MAX_WIDTH {
                let r = &shapes[if round % 2 == 0 { of_lanes[lane] } else { 0 }];
                let reference = Vec3::new(references[0][lane], references[1][lane], references[2][lane]);
                let u = [u[0][lane], u[1][lane]];
                let s = sample_rectangle(r, reference, u);
                let (point, pdf) = s.map_or((Vec3::NAN, 0.0), |s| (s.point, s.pdf));
                let ([b1, b2], at) = (sample_triangle_area(u), format!("{set:?}, {reference}, {u:?}"));
                let found = out.map(|row| row[lane].to_bits());
                assert_eq!(found[3..], [pdf, pdf, b1, b2].map(f32::to_bits), "{at}");
                if pdf > 0.0 {
                    assert_eq!(found[..3], point.to_array().map(f32::to_bits), "{at}");
                    assert_eq!(pdf.to_bits(), pdf_rectangle(r, reference, point).to_bits(), "{at}");
                }
            }
        }
    }
}
