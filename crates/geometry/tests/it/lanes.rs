//! Samples of rectangles, points of triangles, transforms and frames have the same bits at every width.

use dunkelfeld_geometry::shape::{
    Rectangle, RectangleLanes, RectangleSampler, TriangleLanes, pdf_rectangle, sample_rectangle, sample_triangle,
    sample_triangle_area,
};
use dunkelfeld_geometry::{DAffine3, DQuat, DVec3, Frame, Transform, Vec3, hit_point, hit_points};
use dunkelfeld_lanes::{Frame as LanesFrame, InstructionSet, Lanes, MAX_WIDTH, V3, dispatch};

type Vectors = [Vec3; MAX_WIDTH];
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

/// Points on a triangle from several references, with their densities.
#[inline(always)]
fn triangle_samples<F: Lanes>(token: F::Token, t: &[Vec3; 3], from: &Vectors, u: &[Row; 2], out: &mut [Row; 5]) {
    for at in (0..MAX_WIDTH).step_by(F::WIDTH) {
        let mut lanes = [Vec3::ZERO; MAX_WIDTH];
        lanes[..F::WIDTH].copy_from_slice(&from[at..at + F::WIDTH]);
        let triangle = TriangleLanes::<F>::new(t, V3::from_lanes(token, &lanes));
        let (point, _, pdf) = triangle.sample([F::load(token, &u[0][at..]), F::load(token, &u[1][at..])]);
        for (row, x) in out.iter_mut().zip([point.x, point.y, point.z, pdf, triangle.pdf(point)]) {
            x.store(&mut row[at..]);
        }
    }
}

#[test]
fn triangles_have_the_same_bits() {
    let mut state = 5u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32
    };
    let special = [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY, Vec3::splat(1e-30), Vec3::splat(1e20)];
    for round in 0..2000 {
        let mut vector = || Vec3::new(random(), random(), random());
        let corners = [vector(), vector(), vector()];
        let (mut from, mut u) = ([Vec3::ZERO; MAX_WIDTH], [[0.0; MAX_WIDTH]; 2]);
        from.iter_mut().for_each(|p| *p = vector() * [1.0, 3.0, 1e4][round % 3]);
        from[round % MAX_WIDTH] = special[round % special.len()];
        u.iter_mut().flatten().for_each(|u| *u = random());
        for set in InstructionSet::all() {
            let mut out = [[0.0; MAX_WIDTH]; 5];
            dispatch!(set, F, token => triangle_samples::<F>(token, &corners, &from, &u, &mut out));
            for lane in 0..MAX_WIDTH {
                let [x, y, z, pdf, same] = out.map(|row| row[lane]);
                assert_eq!(pdf.to_bits(), same.to_bits());
                let found = (pdf > 0.0).then_some((Vec3::new(x, y, z), pdf));
                let expected =
                    sample_triangle(&corners, from[lane], [u[0][lane], u[1][lane]]).map(|s| (s.point, s.pdf));
                assert_eq!(found, expected, "{set:?}, {corners:?} from {}", from[lane]);
            }
        }
    }
}

/// Points of triangles with their errors, both moved by a transform, normals, and frames.
#[inline(always)]
fn points<F: Lanes>(token: F::Token, t: &Transform, v: &[Vectors; 3], b: &[Row; 2], out: &mut [Vectors; 7]) {
    for at in (0..MAX_WIDTH).step_by(F::WIDTH) {
        let mut corners = [V3::splat(token, Vec3::ZERO); 3];
        for (corner, from) in corners.iter_mut().zip(v) {
            let mut lanes = [Vec3::ZERO; MAX_WIDTH];
            lanes[..F::WIDTH].copy_from_slice(&from[at..at + F::WIDTH]);
            *corner = V3::from_lanes(token, &lanes);
        }
        let (point, error) = hit_points::<F>(&corners, F::load(token, &b[0][at..]), F::load(token, &b[1][at..]));
        let (there, there_error) = t.points_with_error(point, error);
        let normal = t.normals(corners[0]);
        let frame = LanesFrame::from_normal_tangent(normal, corners[1]);
        for (row, x) in out.iter_mut().zip([point, error, there, there_error, normal, frame.tangent, frame.bitangent]) {
            row[at..at + F::WIDTH].copy_from_slice(&x.to_lanes()[..F::WIDTH]);
        }
    }
}

#[test]
fn points_and_transforms_have_the_same_bits() {
    let mut state = 3u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    let special = [Vec3::ZERO, Vec3::X, Vec3::NAN, Vec3::splat(1e-30), Vec3::splat(3e38), Vec3::INFINITY, -Vec3::Y];
    for round in 0..3000 {
        let scale = [1e-6, 1.0, 1.0, 1e6][round % 4];
        let mut vector = || Vec3::new(random(), random(), random()) * scale;
        let mut v = [[Vec3::ZERO; MAX_WIDTH]; 3];
        v.iter_mut().flatten().for_each(|v| *v = vector());
        // Each third round has lanes that are no numbers, and tangents along the normals.
        if round % 3 == 0 {
            let lane = round / 3 % MAX_WIDTH;
            v[round / 6 % 3][lane] = special[round / 9 % special.len()];
            v[1][(lane + 5) % MAX_WIDTH] = v[0][(lane + 5) % MAX_WIDTH];
        }
        let mut b = [[0.0; MAX_WIDTH]; 2];
        b.iter_mut().flatten().for_each(|b| *b = 0.5 + 0.5 * random());
        let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), f64::from(random()));
        let at = 100.0 * DVec3::new(random().into(), random().into(), random().into());
        let to_world = DAffine3::from_scale_rotation_translation(DVec3::new(-2.0, 0.25, 3.0), turn, at);
        let t = if round % 5 == 0 { Transform::IDENTITY } else { Transform::new(to_world).expect("an inverse") };
        for set in InstructionSet::all() {
            let mut out = [[Vec3::ZERO; MAX_WIDTH]; 7];
            dispatch!(set, F, token => points::<F>(token, &t, &v, &b, &mut out));
            for lane in 0..MAX_WIDTH {
                let (point, error) = hit_point(&[v[0][lane], v[1][lane], v[2][lane]], b[0][lane], b[1][lane]);
                let (there, there_error) = t.point_with_error(point, error);
                let normal = t.normal(v[0][lane]);
                let frame = Frame::from_normal_tangent(normal, v[1][lane]);
                let expected = [point, error, there, there_error, normal, frame.tangent, frame.bitangent];
                // The sign of a NaN is not part of a result.
                let bits = |v: Vec3| v.to_array().map(|x| if x.is_nan() { f32::NAN.to_bits() } else { x.to_bits() });
                assert_eq!(out.map(|row| bits(row[lane])), expected.map(bits), "round {round}, {set:?}, lane {lane}");
            }
        }
    }
}
