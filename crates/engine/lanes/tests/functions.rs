//! Errors of the elementary functions against f64, and the same bits at all widths.

use dunkelfeld_lanes::{
    Double, InstructionSet, Lanes, MAX_WIDTH, Mask, Real, V3, Word, atan2, cos_sin_of_angle, cos_sin_of_turn, dispatch,
    exp, ln, pow,
};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

const COUNT: usize = 400_000;

/// Evenly distributed numbers.
fn numbers(low: f64, high: f64, seed: u64) -> Vec<f32> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    (0..COUNT).map(|_| (low + (high - low) * (f64::from(rng.next_u32()) / 4_294_967_296.0)) as f32).collect()
}

#[test]
fn sine_and_cosine_of_a_turn() {
    for turn in numbers(-2.0, 2.0, 1).into_iter().chain([0.0, -0.0, 0.25, 0.125, -0.5, 1.0, 2.0]) {
        let (c, s) = cos_sin_of_turn(turn);
        let (sin, cos) = (f64::from(turn) * std::f64::consts::TAU).sin_cos();
        let (dc, ds) = ((f64::from(c) - cos).abs(), (f64::from(s) - sin).abs());
        assert!(dc < 1.3e-7 && ds < 1.3e-7, "turn {turn}: {dc:e} {ds:e}");
    }
}

#[test]
fn sine_and_cosine_of_large_angles() {
    for angle in numbers(-1e6, 1e6, 13).into_iter().chain(numbers(-4.0, 4.0, 14)) {
        let ((c, s), (sin, cos)) = (cos_sin_of_angle(angle), f64::from(angle).sin_cos());
        let (dc, ds) = ((f64::from(c) - cos).abs(), (f64::from(s) - sin).abs());
        assert!(dc < 2.5e-7 && ds < 2.5e-7, "angle {angle}: {dc:e} {ds:e}");
    }
    assert!([f32::MAX, f32::MIN].into_iter().all(|angle| cos_sin_of_angle(angle).0.abs() <= 1.0));
}

#[test]
fn arc_tangent() {
    for (y, x) in numbers(-1.0, 1.0, 2).into_iter().zip(numbers(-1.0, 1.0, 3)) {
        for scale in [1.0, 1e-3, 1e-7] {
            let (exact, found) = (f64::from(y * scale).atan2(x.into()), f64::from(atan2(y * scale, x)));
            assert!((found - exact).abs() < 4e-7 * exact.abs(), "atan2({}, {x}): {found} {exact}", y * scale);
        }
    }
    assert_eq!(atan2(0.0, 1.0), 0.0);
    assert_eq!(atan2(0.0, 0.0), 0.0);
    assert_eq!(atan2(0.0, -1.0), std::f32::consts::PI);
    assert_eq!(atan2(-1.0, 0.0), -std::f32::consts::FRAC_PI_2);
}

#[test]
fn angles_in_double_precision() {
    for (y, x) in numbers(0.0, 1.0, 8).into_iter().zip(numbers(-1.0, 1.0, 9)) {
        for scale in [1.0, 0.3, 1e-3, 1e-9] {
            let (y, x) = (f64::from(y) * scale, f64::from(x));
            let (exact, found) = (y.atan2(x), <f64 as Real>::angle(x, y));
            assert!((found - exact).abs() <= 1e-15 * exact, "angle({x}, {y}): {found} {exact}");
        }
    }
    let angle = <f64 as Real>::angle;
    assert_eq!((angle(1.0, 0.0), angle(0.0, 0.0), angle(0.0, 1.0)), (0.0, 0.0, std::f64::consts::FRAC_PI_2));
    assert_eq!(angle(-1.0, 0.0), std::f64::consts::PI);
}

#[test]
fn sine_and_cosine_of_an_angle() {
    let tau = std::f64::consts::TAU;
    for angle in numbers(0.0, tau, 10).into_iter().map(f64::from).chain([0.0, 0.25, 0.5, 0.75, 1.0].map(|x| x * tau)) {
        let ((c, s), (sin, cos)) = (<f64 as Real>::cos_sin(angle), angle.sin_cos());
        let (dc, ds) = ((c - cos).abs(), (s - sin).abs());
        assert!(dc < 2e-15 && ds < 2e-15, "angle {angle}: {dc:e} {ds:e}");
        let ((c, s), (sin, cos)) = (<f32 as Real>::cos_sin(angle as f32), f64::from(angle as f32).sin_cos());
        let (dc, ds) = ((f64::from(c) - cos).abs(), (f64::from(s) - sin).abs());
        assert!(dc < 1e-6 && ds < 1e-6, "angle {angle} in single precision: {dc:e} {ds:e}");
    }
}

/// Results of all operations in double precision, and the bits of masks.
#[inline(always)]
fn doubles<F: Lanes>(token: F::Token, a: &[f64; MAX_WIDTH], b: &[f64; MAX_WIDTH], out: &mut [[f64; MAX_WIDTH]; 21]) {
    for at in (0..MAX_WIDTH).step_by(F::WIDTH) {
        let [mut first, mut second] = [[0.0; MAX_WIDTH]; 2];
        first[..MAX_WIDTH - at].copy_from_slice(&a[at..]);
        second[..MAX_WIDTH - at].copy_from_slice(&b[at..]);
        let (a, b) = (F::Double::load(token, &first), F::Double::load(token, &second));
        let (c, s) = F::Double::cos_sin(a.abs().min(a.constant(6.25)));
        let v = V3::<F>::narrow(V3::new(a, b, a * b)).widen();
        let is_less = F::Double::narrow_mask(F::Double::widen_mask(F::Double::narrow_mask(a.lt(b))));
        let narrow = is_less.select(a.narrow(), b.narrow());
        let all = [
            a + b,
            a - b,
            a * b,
            a / b,
            -a,
            a + 1.5,
            a * 3.0,
            a.sqrt(),
            a.abs(),
            a.min(b),
            a.max(b),
            (a.lt(b) & !a.is_positive()).select(a, b),
            (a.le(b) | b.is_finite()).select(a, a.tiny()),
            a.one_minus().only(a.gt(b) ^ a.ge(b)),
            F::Double::angle(a, b.abs()),
            c,
            s,
            F::Double::splat(token, 1e-300) * a,
            v.normalize().x,
            v.dot(v),
            F::Double::widen(narrow),
        ];
        assert_eq!(a.lt(b).bits(), is_less.bits());
        for (row, value) in out.iter_mut().zip(all) {
            let mut lanes = [0.0; MAX_WIDTH];
            value.store(&mut lanes);
            row[at..at + F::WIDTH].copy_from_slice(&lanes[..F::WIDTH]);
        }
    }
}

#[test]
fn all_widths_have_the_same_bits_in_double_precision() {
    let mut special = vec![0.0, -0.0, 1.0, -1.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN, 1e-40, 1e300, 1e-310];
    special.extend(
        numbers(-1.0, 1.0, 11)
            .into_iter()
            .zip(numbers(1.0, 2.0, 12))
            .take(2000)
            .map(|(x, y)| f64::from(x) / f64::from(y)),
    );
    let mut other = special.clone();
    other.rotate_left(5);
    for (a, b) in special.chunks_exact(MAX_WIDTH).zip(other.chunks_exact(MAX_WIDTH)) {
        let (a, b) = (a.try_into().unwrap(), b.try_into().unwrap());
        let of = |set: InstructionSet| {
            let mut out = [[0.0; MAX_WIDTH]; 21];
            dispatch!(set, F, token => doubles::<F>(token, a, b, &mut out));
            let bits = |x: f64| if x.is_nan() { f64::NAN.to_bits() } else { x.to_bits() };
            out.map(|row| row.map(bits))
        };
        let reference = of(InstructionSet::Scalar);
        for set in InstructionSet::all() {
            for (index, (found, expected)) in of(set).iter().zip(&reference).enumerate() {
                assert_eq!(found, expected, "operation {index} with {set:?}, {a:?}, {b:?}");
            }
        }
    }
}

#[test]
fn exponential_and_logarithm() {
    for x in numbers(-86.9, 87.9, 4) {
        let relative = f64::from(exp(x)) / f64::from(x).exp() - 1.0;
        assert!(relative.abs() < 2e-7, "exp({x}): {relative:e}");
        let y = exp(x);
        let (exact, found) = (f64::from(y).ln(), f64::from(ln(y)));
        assert!((found - exact).abs() < 2e-7 * exact.abs().max(1.0), "ln({y}): {found} {exact}");
    }
    assert_eq!((exp(0.0), ln(1.0), exp(-200.0)), (1.0, 0.0, 0.0));
    for (x, y) in numbers(0.001, 1.0, 5).into_iter().zip(numbers(0.0, 10.0, 6)) {
        let exact = f64::from(x).powf(y.into());
        let relative = f64::from(pow(x, y)) / exact - 1.0;
        assert!(relative.abs() < 2e-7 * (1.0 - exact.ln()), "{x}^{y}: {relative:e}");
    }
}

/// Results of all operations for the lanes of `a` and `b`.
#[inline(always)]
fn results<F: Lanes>(token: F::Token, a: &[f32; MAX_WIDTH], b: &[f32; MAX_WIDTH], out: &mut [[f32; MAX_WIDTH]; 27]) {
    for at in (0..MAX_WIDTH).step_by(F::WIDTH) {
        let (a, b) = (F::load(token, &a[at..]), F::load(token, &b[at..]));
        let (c, s) = cos_sin_of_turn(a);
        let long = F::join(a.to_bits(), b.to_bits());
        let [low, high] = F::split(((long ^ (long >> 30)) * 0xbf58_476d_1ce4_e5b9 + 0x9e37_79b9_7f4a_7c15) ^ 7);
        let all = [
            F::from_word(low >> 1),
            F::from_word(high >> 1),
            a + b,
            a - b,
            a * b,
            a / b,
            -a,
            a + 1.5,
            a.sqrt(),
            a.abs(),
            a.min(b),
            a.max(b),
            a.lt(b).select(a, b),
            a.le(b).select(b, a),
            a.eq(b).select(a, -b),
            a.copysign(b),
            a.round(),
            a.floor(),
            F::from_word(a.to_bits() >> 1),
            F::from_bits((a.to_bits() * 7 + b.to_bits()) ^ 0x55),
            F::from_word(a.to_bits().reverse_bits() >> 1),
            c,
            s,
            atan2(a, b),
            exp(a),
            ln(b.abs()),
            F::mask(token, 0b0110_1001_1100_0101).select(a, b),
        ];
        for (row, value) in out.iter_mut().zip(all) {
            value.store(&mut row[at..]);
        }
    }
}

#[test]
fn all_widths_have_the_same_bits() {
    let mut special = vec![0.0, -0.0, 1.0, -1.0, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, f32::MIN_POSITIVE, 1e-40];
    special.extend(numbers(-3.0, 3.0, 7).into_iter().take(2000));
    let mut other = special.clone();
    other.rotate_left(5);
    for (a, b) in special.chunks_exact(MAX_WIDTH).zip(other.chunks_exact(MAX_WIDTH)) {
        let (a, b) = (a.try_into().unwrap(), b.try_into().unwrap());
        let of = |set: InstructionSet| {
            let mut out = [[0.0; MAX_WIDTH]; 27];
            dispatch!(set, F, token => results::<F>(token, a, b, &mut out));
            // The sign of a NaN is not part of a result. A mask of one lane repeats its first bit.
            let bits = |x: f32| if x.is_nan() { f32::NAN.to_bits() } else { x.to_bits() };
            out[..26].iter().map(|row| row.map(bits)).collect::<Vec<_>>()
        };
        let reference = of(InstructionSet::Scalar);
        for set in InstructionSet::all() {
            for (index, (found, expected)) in of(set).iter().zip(&reference).enumerate() {
                assert_eq!(found, expected, "operation {index} with {set:?}, {a:?}, {b:?}");
            }
        }
    }
}

#[test]
fn rows_become_columns() {
    let mut rows = [[0.0; 4]; MAX_WIDTH];
    for (lane, row) in rows.iter_mut().enumerate() {
        *row = [0, 1, 2, 3].map(|column| (4 * lane + column) as f32);
    }
    for set in InstructionSet::all() {
        let columns = dispatch!(set, F, token => {
            let columns = F::load_rows(token, #[inline(always)] |lane| &rows[lane]);
            assert_eq!(F::to_rows(columns)[..F::WIDTH], rows[..F::WIDTH], "{set:?}");
            let [a, b, c, d] = columns;
            [a.to_array(), b.to_array(), c.to_array(), d.to_array()]
        });
        for (column, lanes) in columns.iter().enumerate() {
            for lane in 0..set.lanes() {
                assert_eq!(lanes[lane], rows[lane][column], "{set:?}");
            }
        }
    }
}

#[test]
fn records_are_stored_as_they_were_loaded() {
    let mut records = [[[0.0; 4]; 3]; MAX_WIDTH];
    for (k, number) in records.as_flattened_mut().as_flattened_mut().iter_mut().enumerate() {
        *number = k as f32;
    }
    for set in InstructionSet::all() {
        let mut stored = Vec::new();
        let second = dispatch!(set, F, token => {
            let rows = V3::<F>::load_records(token, #[inline(always)] |lane| &records[lane]);
            V3::store_records(rows, F::mask(token, 0b0101_1010_0101_1011), #[inline(always)] |lane, record| stored.push((lane, record)));
            let (V3 { x, y, z }, w) = rows[1];
            [x.to_array(), y.to_array(), z.to_array(), w.to_array()]
        });
        let lanes = (0..set.lanes()).filter(|lane| 0b0101_1010_0101_1011 >> lane & 1 == 1);
        assert_eq!(stored, lanes.map(|lane| (lane, records[lane])).collect::<Vec<_>>(), "{set:?}");
        for lane in 0..set.lanes() {
            assert_eq!([0, 1, 2, 3].map(|k| second[k][lane]), records[lane][1], "{set:?}");
        }
    }
}

#[test]
fn masks_have_their_bits() {
    for set in InstructionSet::all() {
        let bits = dispatch!(set, F, token => F::mask(token, 0b1010_0110_0101_1010).bits());
        assert_eq!(bits, 0b1010_0110_0101_1010 & ((1 << set.lanes()) - 1));
        let mut found = Vec::new();
        dispatch!(set, F, token => F::mask(token, 0b1010_0110_0101_1010).each(#[inline(always)] |lane| found.push(lane)));
        let lanes: Vec<usize> = dispatch!(set, F, token => F::mask(token, 0b1010_0110_0101_1010).lanes().collect());
        assert_eq!(lanes, found);
        let mut list = vec![7.0];
        dispatch!(set, F, token => {
            let numbers: [f32; MAX_WIDTH] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];
            F::load(token, &numbers).append(F::mask(token, 0b1010_0110_0101_1010), &mut list);
        });
        assert_eq!(list, [7.0].into_iter().chain(found.iter().map(|lane| *lane as f32)).collect::<Vec<_>>());
        assert_eq!(found, (0..set.lanes()).filter(|lane| 0b1010_0110_0101_1010 >> lane & 1 == 1).collect::<Vec<_>>());
    }
}
