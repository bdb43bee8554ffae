//! Poisson random numbers for means from zero to beyond any full well, fast enough for every pixel of a frame.

use std::sync::LazyLock;

use rand_core::Rng;
use rand_distr::{Distribution, StandardNormal};

/// Below this mean, numbers come from tables. Transformed rejection would need a mean of at least 10.
const TABLE_BELOW: usize = 32;
/// From this mean on, far beyond any full well, the number is a rounded normal one (the neglected skewness is 1e-4).
const NORMAL_FROM: f64 = 1e8;

/// A Poisson number of the given mean: a count, as f64. A mean that is not positive gives 0.
///
/// Exact to the resolution of the 53-bit uniform numbers below a mean of 1e8.
#[inline]
pub fn poisson(mean: f64, rng: &mut impl Rng) -> f64 {
    if mean >= TABLE_BELOW as f64 {
        if mean < NORMAL_FROM { by_rejection(mean, rng) } else { by_normal(mean, rng) }
    } else if mean > 0.0 {
        by_table(mean, rng)
    } else {
        0.0
    }
}

/// The sum of two Poisson numbers is one of the summed mean. A table gives the number for the whole part of the mean. A
/// short search gives that for the rest, below 1.
#[inline]
fn by_table(mean: f64, rng: &mut impl Rng) -> f64 {
    let whole = mean as usize;
    let rest = by_search(mean - whole as f64, rng);
    match whole.checked_sub(1).and_then(|i| TABLES.get(i)) {
        Some(table) => rest + table.draw(rng),
        None => rest,
    }
}

/// Inversion of the distribution function by sequential search, for a mean below 1.
#[inline]
fn by_search(mean: f64, rng: &mut impl Rng) -> f64 {
    let u = uniform(rng);
    // exp(-mean) is at least 1 - mean, so low means need no exponential function.
    if u < 1.0 - mean {
        return 0.0;
    }
    let mut probability = (-mean).exp();
    let mut cumulated = probability;
    let mut k = 0.0;
    // The probability of 20 or more is below 1e-18, which is less than the resolution of `u`.
    while u >= cumulated && k < 20.0 {
        k += 1.0;
        probability *= mean / k;
        cumulated += probability;
    }
    k
}

/// Slots of an alias table. The probability of 128 or more at a mean of 31 is 1e-38.
const SLOTS: usize = 128;

/// Alias table (Walker 1977, built as by Vose 1991). One random word selects a slot and decides between its two counts.
struct Alias([(f64, f64); SLOTS]);

/// Tables of the means 1, 2, ... `TABLE_BELOW` - 1.
static TABLES: LazyLock<Vec<Alias>> = LazyLock::new(|| (1..TABLE_BELOW).map(|m| Alias::new(m as f64)).collect());

impl Alias {
    fn new(mean: f64) -> Self {
        let mut weight = [0.0; SLOTS];
        let mut p = (-mean).exp();
        for (k, w) in weight.iter_mut().enumerate() {
            *w = p * SLOTS as f64;
            p *= mean / (k + 1) as f64;
        }
        // A slot keeps its own count with probability `weight`. The rest of the slot goes to a count with too much
        // probability.
        let mut table = std::array::from_fn(|k| (1.0, k as f64));
        let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..SLOTS).partition(|&k| weight[k] < 1.0);
        while let (Some(s), Some(&l)) = (small.pop(), large.last()) {
            table[s] = (weight[s], l as f64);
            weight[l] -= 1.0 - weight[s];
            if weight[l] < 1.0 {
                large.pop();
                small.push(l);
            }
        }
        Self(table)
    }

    #[inline]
    fn draw(&self, rng: &mut impl Rng) -> f64 {
        let word = rng.next_u64();
        // The slot takes the lowest 7 bits, the decision the highest 53. No bit is in both.
        let slot = word as usize % SLOTS;
        let (keep, alias) = self.0[slot];
        if unit(word) < keep { slot as f64 } else { alias }
    }
}

/// Transformed rejection with squeeze, PTRS (Hormann 1993, The transformed rejection method for generating Poisson
/// random variables, Insurance: Mathematics and Economics 12). Constants are those of the paper.
#[inline]
fn by_rejection(mean: f64, rng: &mut impl Rng) -> f64 {
    let b = 0.931 + 2.53 * mean.sqrt();
    let a = -0.059 + 0.02483 * b;
    let squeeze = 0.9277 - 3.6224 / (b - 2.0);
    loop {
        let u = uniform(rng) - 0.5;
        let v = uniform(rng);
        let us = 0.5 - u.abs();
        let k = floor((2.0 * a / us + b) * u + mean + 0.43);
        // This is the result in two of three cases at the lowest means, and in nine of ten at high ones.
        if us >= 0.07 && v <= squeeze {
            return k;
        }
        if k < 0.0 || (us < 0.013 && v > us) {
            continue;
        }
        if accepts(mean, a, b, us, v, k) {
            return k;
        }
    }
}

/// The floor of a number that is far from the limits of i64. It needs no function call on processors without an
/// instruction for it.
#[inline]
fn floor(x: f64) -> f64 {
    let towards_zero = x as i64 as f64;
    if towards_zero > x { towards_zero - 1.0 } else { towards_zero }
}

/// The exact comparison of PTRS, outside of the fast path.
#[inline(never)]
fn accepts(mean: f64, a: f64, b: f64, us: f64, v: f64, k: f64) -> bool {
    let inverse_alpha = 1.1239 + 1.1328 / (b - 3.4);
    (v * inverse_alpha / (a / (us * us) + b)).ln() <= k * mean.ln() - mean - ln_factorial(k)
}

#[cold]
fn by_normal(mean: f64, rng: &mut impl Rng) -> f64 {
    let z: f64 = StandardNormal.sample(rng);
    (mean + mean.sqrt() * z).round()
}

/// ln k! of 0 ... 511.
static LN_FACTORIALS: LazyLock<[f64; 512]> = LazyLock::new(|| {
    let mut sum = 0.0;
    std::array::from_fn(|k| {
        sum += if k > 1 { (k as f64).ln() } else { 0.0 };
        sum
    })
});

/// ln k! for a whole k: a table, then Stirling's series. The next term of the series would be below 1e-20 there.
#[inline]
fn ln_factorial(k: f64) -> f64 {
    if let Some(f) = LN_FACTORIALS.get(k as usize) {
        return *f;
    }
    let r = 1.0 / k;
    let series = r * (1.0 / 12.0 - r * r * (1.0 / 360.0 - r * r / 1260.0));
    (k + 0.5) * k.ln() - k + 0.918_938_533_204_672_8 + series
}

/// A uniform number in [0, 1) with 53 bits.
#[inline]
fn uniform(rng: &mut impl Rng) -> f64 {
    unit(rng.next_u64())
}

/// The highest 53 bits of a word as a number in [0, 1).
#[inline]
fn unit(word: u64) -> f64 {
    const STEP: f64 = 1.0 / (1u64 << 53) as f64;
    (word >> 11) as f64 * STEP
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The distribution is tested in `tests/it/poisson.rs`. There the correction terms are too small to be detected.
    #[test]
    fn the_factorial_is_exact_on_both_sides_of_its_series() {
        let mut sum = 0.0;
        for k in 1..2000 {
            sum += f64::from(k).ln();
            let got = ln_factorial(f64::from(k));
            assert!((got - sum).abs() < 1e-12 * sum.max(1.0), "ln {k}! = {got}, the sum of logarithms is {sum}");
        }
    }
}
