//! All widths give the bits of one lane, for surfaces of each kind that differ from lane to lane, and [`Bsdf`] has them too.
//!
//! Replay: `cargo test -p dunkelfeld-bsdf --test it lanes::NAME`.

use crate::common::{Uniform, extreme_surface, facet_surfaces, wide_surfaces};
use dunkelfeld_bsdf::{
    Bsdf, BsdfSample, BsdfSamples, Dielectric, HenyeyGreenstein, InLanes, Lobe, Principled, ThinSheet, Translucent,
    View,
};
use dunkelfeld_geometry::{LocalDir, Vec3};
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, V3, dispatch};
use dunkelfeld_radiometry::Rgb;

/// Value (3) and density, direction (3), weight (3), density, lobe and index of a sample, albedo (3).
type Rows = [[u32; MAX_WIDTH]; 16];

struct Case<'a, M> {
    surfaces: [&'a M; MAX_WIDTH],
    wo: [Vec3; MAX_WIDTH],
    wi: [Vec3; MAX_WIDTH],
    /// Lobe, direction (2).
    u: [[f32; MAX_WIDTH]; 3],
}

#[inline(always)]
fn store<F: Lanes>(view: &impl View<F>, albedo: Rgb<F>, wi: V3<F>, u: [F; 3], at: usize, rows: &mut Rows) {
    let (value, pdf) = view.eval_pdf(wi);
    let s: BsdfSamples<F> = view.sample(u[0], [u[1], u[2]]);
    // Without a density there is no direction.
    let is_some = s.pdf.is_positive();
    let (wi, w, lobe) = (s.wi, s.weight, F::from_bits(s.lobe).only(is_some));
    let sample = [wi.x.only(is_some), wi.y.only(is_some), wi.z.only(is_some), w.r, w.g, w.b, s.pdf, lobe];
    let rest = [value.r, value.g, value.b, pdf, s.eta.only(is_some), albedo.r, albedo.g, albedo.b];
    for k in 0..8 {
        F::store_word(sample[k].to_bits(), &mut rows[k][at..]);
        F::store_word(rest[k].to_bits(), &mut rows[k + 8][at..]);
    }
}

/// A function that loads the lanes of a case, group by group, and stores what a view of them gives.
macro_rules! rows {
    ($name:ident, $kind:ty, |$surface:ident, $wo:ident| $view:expr, $albedo:expr) => {
        fn $name(set: InstructionSet, case: &Case<$kind>) -> Rows {
            let mut rows = [[0; MAX_WIDTH]; 16];
            dispatch!(set, F, token => {
                for at in (0..MAX_WIDTH).step_by(F::WIDTH) {
                    let (mut surfaces, mut wo, mut wi) = (case.surfaces, case.wo, case.wi);
                    surfaces.rotate_left(at);
                    wo.rotate_left(at);
                    wi.rotate_left(at);
                    let is_one = surfaces.iter().all(#[inline(always)] |&s| std::ptr::eq(s, surfaces[0]));
                    let $surface = if is_one {
                        InLanes::<F>::splat(token, surfaces[0])
                    } else {
                        InLanes::<F>::gather(token, &surfaces)
                    };
                    let $wo = V3::<F>::from_lanes(token, &wo);
                    let wi = V3::<F>::from_lanes(token, &wi);
                    let [a, b, c] = &case.u;
                    let u = [F::load(token, &a[at..]), F::load(token, &b[at..]), F::load(token, &c[at..])];
                    store(&$view, $albedo, wi, u, at, &mut rows);
                }
            });
            rows
        }
    };
}
rows!(plain, Principled, |surface, wo| surface.view::<false>(wo), surface.albedo(wo));
rows!(rich, Principled, |surface, wo| surface.view::<true>(wo), surface.albedo(wo));
rows!(dielectric, Dielectric, |surface, wo| surface.view(wo), surface.albedo(wo));
rows!(sheet, ThinSheet, |surface, wo| surface.view(wo), surface.albedo(wo));
rows!(translucent, Translucent, |surface, wo| surface.view(wo), surface.albedo(wo));
rows!(phase, HenyeyGreenstein, |surface, wo| surface.view(wo), Rgb::splat(wo.x));

/// A random direction: one of three is grazing, lies in the surface, or is its normal.
fn direction(u: &mut Uniform) -> Vec3 {
    let w = u.direction().0;
    let z = match (u.next() * 12.0) as u32 {
        0 => 0.0,
        1 => -0.0,
        2 => u.pick(&[1e-30, -1e-30, 1e-7, -1e-7]),
        3 => return Vec3::Z * 1f32.copysign(w.z),
        _ => return w,
    };
    w.with_z(0.0).normalize().with_z(z)
}

/// Checks `rounds` groups of surfaces, and `one_lane` with the numbers of one of their lanes.
fn check<M>(
    key: u64,
    surfaces: &[M],
    rounds: usize,
    rows: impl Fn(InstructionSet, &Case<M>) -> Rows,
    one_lane: impl Fn(&M, [LocalDir; 2], [f32; 3], [u32; 16]),
) {
    let mut u = Uniform::new(key);
    let mut samples = 0;
    for round in 0..rounds {
        let mut pick = || &surfaces[(u.next() * surfaces.len() as f32) as usize % surfaces.len()];
        let mut case = Case {
            surfaces: [pick(); MAX_WIDTH],
            wo: [Vec3::Z; MAX_WIDTH],
            wi: [Vec3::Z; MAX_WIDTH],
            u: [[0.0; MAX_WIDTH]; 3],
        };
        if round % 4 > 0 {
            case.surfaces = case.surfaces.map(|_| pick());
        }
        for lane in 0..MAX_WIDTH {
            case.wo[lane] = direction(&mut u);
            let other = direction(&mut u);
            // Mirror images and opposite directions meet the peaks and the vanishing half vectors.
            case.wi[lane] = match (u.next() * 8.0) as u32 {
                0 => -case.wo[lane],
                1 => case.wo[lane] * Vec3::new(-1.0, -1.0, 1.0),
                _ => other,
            };
            for k in 0..3 {
                case.u[k][lane] = if u.next() < 0.1 { u.pick(&[0.0, 0.5, 0.999_999_94]) } else { u.next() };
            }
        }
        let expected = rows(InstructionSet::Scalar, &case);
        for set in InstructionSet::all() {
            let found = rows(set, &case);
            for lane in 0..MAX_WIDTH {
                let of = |rows: &Rows| rows.map(|row| row[lane]);
                assert_eq!(of(&found), of(&expected), "key {key}, round {round}, lane {lane} of {set:?}");
            }
        }
        samples += expected[6].iter().filter(|&&pdf| pdf != 0).count();
        let lane = round % MAX_WIDTH;
        let directions = [LocalDir(case.wo[lane]), LocalDir(case.wi[lane])];
        one_lane(case.surfaces[lane], directions, case.u.map(|u| u[lane]), expected.map(|row| row[lane]));
    }
    assert!(4 * samples > rounds * MAX_WIDTH, "only {samples} samples");
}

/// The scalar functions have the bits of the lanes.
fn is_bsdf(bsdf: Bsdf, [wo, wi]: [LocalDir; 2], u: [f32; 3], row: [u32; 16]) {
    let number = row.map(f32::from_bits);
    let (value, pdf) = bsdf.eval_pdf(wo, wi);
    assert_eq!([value.r, value.g, value.b, pdf], number[8..12], "{bsdf:?} {wo:?} {wi:?}");
    let found = bsdf.sample(wo, u[0], [u[1], u[2]]);
    let of = |BsdfSample { wi, weight: w, pdf, lobe, eta }: BsdfSample| {
        ([wi.0.x, wi.0.y, wi.0.z, w.r, w.g, w.b, pdf], lobe.bits(), eta)
    };
    let expected =
        (number[6] > 0.0).then(|| (number.first_chunk::<7>().copied().unwrap_or_default(), row[7], number[12]));
    assert_eq!(found.map(of), expected, "{bsdf:?} {wo:?} {u:?}");
    assert_eq!(bsdf.albedo(wo).to_array(), number[13..], "{bsdf:?} {wo:?}");
}

/// All surfaces of the other tests, half of them with compensation.
fn surfaces() -> impl Iterator<Item = Bsdf> {
    let mut u = Uniform::new(7000);
    let extreme: Vec<Bsdf> = (0..600).map(|_| extreme_surface(&mut u)).collect();
    let all =
        wide_surfaces().into_iter().map(|s| s.1).chain(facet_surfaces().into_iter().map(|s| s.bsdf)).chain(extreme);
    all.enumerate().map(|(k, b)| if k % 2 == 0 { b } else { b.with_energy_compensation() })
}

fn of_kind<M>(kind: impl FnMut(Bsdf) -> Option<M>) -> Vec<M> {
    surfaces().filter_map(kind).collect()
}

#[test]
fn principled_surfaces() {
    let all = of_kind(|b| if let Bsdf::Principled(b) = b { Some(b) } else { None });
    check(7100, &all, 4000, rich, |&s, directions, u, row| is_bsdf(Bsdf::Principled(s), directions, u, row));
    let opaque: Vec<_> = all.into_iter().filter(|b| !b.is_rich()).collect();
    assert!(opaque.len() > 15, "only {} plain surfaces", opaque.len());
    check(7110, &opaque, 4000, plain, |&s, directions, u, row| is_bsdf(Bsdf::Principled(s), directions, u, row));
    // The code for more lobes changes nothing.
    check(7110, &opaque, 4000, rich, |&s, directions, u, row| is_bsdf(Bsdf::Principled(s), directions, u, row));
}

#[test]
fn clear_surfaces() {
    let boundaries = of_kind(|b| if let Bsdf::Dielectric(b) = b { Some(b) } else { None });
    check(7200, &boundaries, 3000, dielectric, |&s, directions, u, row| {
        is_bsdf(Bsdf::Dielectric(s), directions, u, row)
    });
    let sheets = of_kind(|b| if let Bsdf::ThinSheet(b) = b { Some(b) } else { None });
    check(7300, &sheets, 3000, sheet, |&s, directions, u, row| is_bsdf(Bsdf::ThinSheet(s), directions, u, row));
}

#[test]
fn translucent_surfaces() {
    let mut u = Uniform::new(7400);
    let all = of_kind(|b| {
        let Bsdf::Principled(b) = b else { return None };
        Some(Translucent::new(b, u.pick(&[0.0, 0.5, 1.0]), Rgb::new(u.next(), 0.0, u.next())))
    });
    check(7410, &all, 3000, translucent, |&s, directions, u, row| is_bsdf(Bsdf::Translucent(s), directions, u, row));
}

#[test]
fn phase_functions() {
    let mut u = Uniform::new(7500);
    let all: Vec<_> = (0..200)
        .map(|k| HenyeyGreenstein::new(if k < 5 { k as f32 / 2.0 - 1.0 } else { 2.0 * u.next() - 1.0 }))
        .collect();
    check(7510, &all, 2000, phase, |s, [wo, wi], u, row| {
        assert_eq!(s.pdf(wo.0, wi.0).to_bits(), row[11]);
        assert_eq!(s.sample(wo.0, [u[1], u[2]]).to_array().map(f32::to_bits), row[..3]);
        assert_eq!(row[7], Lobe::default().bits());
    });
}
