//! All widths have the bits of one lane.

use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, One, V3, dispatch};
use dunkelfeld_sampling::{Sampler, mix64, warp};

type Rows = Vec<[f32; MAX_WIDTH]>;

#[inline(always)]
fn numbers<F: Lanes>(token: F::Token, samplers: &[Sampler; MAX_WIDTH], set: u32, out: &mut Rows) {
    for at in (0..MAX_WIDTH).step_by(F::WIDTH) {
        let mut words = [[0; MAX_WIDTH]; 3];
        for lane in 0..F::WIDTH {
            let [One(low), One(high), One(index)] = samplers[at + lane].words();
            [words[0][lane], words[1][lane], words[2][lane]] = [low, high, index];
        }
        let words = [F::load_word(token, &words[0]), F::load_word(token, &words[1]), F::load_word(token, &words[2])];
        let numbers = Sampler::<F>::from_words(token, words).numbers(set);
        let ([a, b], [c, d]) = (numbers.first_two(), numbers.last_two());
        let all = [a, b, c, d, numbers.get(0), numbers.get(1), numbers.get(2), numbers.get(3)];
        for (row, x) in out.iter_mut().zip(all) {
            x.store(&mut row[at..]);
        }
    }
}

#[test]
fn random_numbers() {
    for k in 0..2000u64 {
        let (set, seed) = (mix64(k) as u32 >> (k % 32), mix64(k ^ 77));
        let samplers: [Sampler; MAX_WIDTH] = std::array::from_fn(|lane| {
            let h = mix64(seed ^ lane as u64);
            Sampler::new(seed, h as u32 & 3, (h >> 40) as u32, (h >> 8) as u32 >> (k % 31))
        });
        for instructions in InstructionSet::all() {
            let mut found = vec![[0.0; MAX_WIDTH]; 8];
            dispatch!(instructions, F, token => numbers::<F>(token, &samplers, set, &mut found));
            for (lane, sampler) in samplers.iter().enumerate() {
                let expected = sampler.get_4d(set).map(f32::to_bits);
                let lane: Vec<u32> = found.iter().map(|row| row[lane].to_bits()).collect();
                assert_eq!((&lane[..4], &lane[4..]), (&expected[..], &expected[..]), "{instructions:?}, set {set}");
            }
        }
    }
}

#[inline(always)]
fn warps<F: Lanes>(token: F::Token, u: &[[f32; MAX_WIDTH]; 2], out: &mut Rows) {
    for at in (0..MAX_WIDTH).step_by(F::WIDTH) {
        let u = [F::load(token, &u[0][at..]), F::load(token, &u[1][at..])];
        let ([x, y], V3 { x: hx, y: hy, z: hz }) =
            (warp::lanes::sample_disk(u), warp::lanes::sample_cosine_hemisphere(u));
        let V3 { x: sx, y: sy, z: sz } = warp::lanes::sample_sphere(u);
        let pdf = warp::lanes::pdf_cosine_hemisphere(V3::new(hx, hy, hz));
        for (row, v) in out.iter_mut().zip([x, y, hx, hy, hz, sx, sy, sz, pdf]) {
            v.store(&mut row[at..]);
        }
    }
}

#[test]
fn points_of_warps() {
    for k in 0..4000u64 {
        let mut u: [[f32; MAX_WIDTH]; 2] = std::array::from_fn(|d| {
            std::array::from_fn(|lane| (mix64(k << 8 | (lane << 1 | d) as u64) >> 40) as f32 / (1 << 24) as f32)
        });
        (u[0][3], u[1][3]) = (0.5, 0.5);
        (u[0][5], u[1][6]) = (0.0, 0.0);
        let of = |set: InstructionSet| {
            let mut out = vec![[0.0; MAX_WIDTH]; 9];
            dispatch!(set, F, token => warps::<F>(token, &u, &mut out));
            out.iter().map(|row| row.map(f32::to_bits)).collect::<Vec<_>>()
        };
        let expected = of(InstructionSet::Scalar);
        for set in InstructionSet::all() {
            assert_eq!(of(set), expected, "{set:?}, {u:?}");
        }
    }
}
