//! Conversion of weights to whole samples: the total number of samples of each pixel.
//!
//! A plan only grows. A round raises a common level L. A pixel that already has more samples than `L` times its weight
//! stays as it is. The others share the rest in proportion to their weights.
//!
//! Shares are real numbers, samples are whole ones. The rounding visits the pixels in serpentine order and adds the
//! rest to the next pixel (one-dimensional error diffusion with a perturbed threshold, Ulichney 1987). So totals are
//! exact, every run of pixels gets its share to within a few samples, and the hashed threshold prevents patterns. A
//! round may therefore have any number of samples, even fewer than there are pixels. A hash decides which pixels get
//! them, never a clock.

use dunkelfeld_film::{BATCHES, Plane};

/// Samples per pixel, as totals since the first sample. Sample indices of a pixel run from zero to this number.
pub type SamplePlan = Plane<u32>;

/// No pixel gets more samples than this.
pub const MAX_SPP: u32 = 1 << 30;

/// From this share on, the samples of a pixel are rounded to full sets of film batches. The rounding is then a few per
/// cent, and the batch means stay equally weighted.
pub(crate) const COARSE_FROM: f64 = 8.0 * BATCHES as f64;

/// A plan without samples.
pub fn empty(width: u32, height: u32) -> SamplePlan {
    Plane::new(width, height, 0)
}

/// All samples of a plan.
pub fn total(plan: &SamplePlan) -> u64 {
    plan.data().iter().map(|&n| u64::from(n)).sum()
}

/// The number of samples whose mean over `pixels` is nearest to `spp`. Zero if `spp` is not a positive number.
pub fn total_for_mean(spp: f64, pixels: u64) -> u64 {
    // `as` saturates, and turns NaN into zero.
    (spp * pixels as f64).round() as u64
}

/// The plan of a round: `target_total` samples in all, at least `current` everywhere, the others in proportion to the
/// weights.
///
/// Equals `current` if that holds `target_total` samples or more. Weights are relative. Those that are negative or not
/// finite count as zero, and if none is positive all are equal. The total is met exactly unless every pixel that may
/// grow has [`MAX_SPP`]. The result is a pure function of the arguments.
///
/// # Panics
/// If the planes differ in size.
pub fn next_round(current: &SamplePlan, weights: &Plane<f32>, target_total: u64) -> SamplePlan {
    let size = (current.width(), current.height());
    assert_eq!(size, (weights.width(), weights.height()), "planes differ in size");
    if target_total <= total(current) || current.data().is_empty() {
        return current.clone();
    }
    let valid = Weights::new(weights);
    let level = water_level(current.data(), &valid, target_total);
    // The samples of a pixel at the level, never less than it has.
    let share = |i: usize| (level * valid.at(i)).min(f64::from(MAX_SPP)).max(f64::from(current.data()[i]));
    let mut plan = round_shares(current, share, target_total);
    hand_out_rest(&mut plan, current, &valid, target_total);
    plan
}

/// The samples of `plan` beyond `current`.
///
/// # Panics
/// If the planes differ in size.
pub fn increment(current: &SamplePlan, plan: &SamplePlan) -> Plane<u32> {
    assert_eq!((current.width(), current.height()), (plan.width(), plan.height()), "plans differ in size");
    let mut more = plan.clone();
    more.data_mut().iter_mut().zip(current.data()).for_each(|(n, c)| *n = n.saturating_sub(*c));
    more
}

/// Valid weights: none negative, all finite, and all equal if none is positive.
struct Weights(Vec<f32>);

impl Weights {
    fn new(weights: &Plane<f32>) -> Self {
        let usable = |w: f32| if w > 0.0 && w.is_finite() { w } else { 0.0 };
        let mut used: Vec<f32> = weights.data().iter().map(|&w| usable(w)).collect();
        if used.iter().all(|&w| w == 0.0) {
            used.fill(1.0);
        }
        Self(used)
    }

    #[inline]
    fn at(&self, i: usize) -> f64 {
        f64::from(self.0[i])
    }
}

/// The level L for which `sum max(current_i, L w_i) = total`.
///
/// Starts with every pixel in the sum and removes those whose current samples exceed their share. Each pass lowers the
/// level, so a removed pixel stays out. The loop ends when a pass removes none.
fn water_level(current: &[u32], weights: &Weights, total: u64) -> f64 {
    let mut level = f64::INFINITY;
    loop {
        let (mut dry, mut weight) = (0u64, 0.0);
        for (&c, &w) in current.iter().zip(&weights.0) {
            let w = f64::from(w);
            // A pixel of zero weight is never in the sum: `inf * 0` is NaN, and the comparison with NaN is false. The
            // loop has no branches, since the result of the comparison is not predictable.
            let is_wet = level * w > f64::from(c);
            weight += if is_wet { w } else { 0.0 };
            dry += if is_wet { 0 } else { u64::from(c) };
        }
        let lowered = total.saturating_sub(dry) as f64 / weight;
        if weight == 0.0 || lowered >= level {
            return if level.is_finite() { level } else { 0.0 };
        }
        level = lowered;
    }
}

/// Rounds the shares to samples in serpentine order. The remainder of a pixel goes to the next one.
fn round_shares(current: &SamplePlan, share: impl Fn(usize) -> f64, seed: u64) -> SamplePlan {
    let (width, height) = (current.width() as usize, current.height() as usize);
    let mut plan = current.clone();
    let samples = plan.data_mut();
    let seed = mix(seed);
    let mut carry = None;
    for y in 0..height {
        for step in 0..width {
            let x = if y % 2 == 0 { step } else { width - 1 - step };
            let i = y * width + x;
            let (least, wanted) = (samples[i], share(i));
            if wanted <= f64::from(least) {
                continue;
            }
            let quantum = if wanted >= COARSE_FROM { BATCHES as u32 } else { 1 };
            let floor = wanted as u32 / quantum * quantum;
            let (low, high) = (floor.max(least), floor + quantum);
            if wanted == f64::from(low) {
                samples[i] = low; // Nothing to round: flat plans stay flat.
                continue;
            }
            // The carry starts at a random value. Otherwise the first pixels would always get too few samples.
            let due = wanted + carry.unwrap_or_else(|| (hashed_unit(seed, u64::MAX) - 0.5) * f64::from(quantum));
            // With any threshold in [0, 1) the carry stays within a quantum on either side.
            let threshold = f64::from(low) + f64::from(high - low) * hashed_unit(seed, i as u64);
            let chosen = if due > threshold { high } else { low };
            carry = Some(due - f64::from(chosen));
            samples[i] = chosen.min(MAX_SPP);
        }
    }
    plan
}

/// Adds or removes the last few samples, so that the total is exact. It starts at a hashed pixel.
fn hand_out_rest(plan: &mut SamplePlan, current: &SamplePlan, weights: &Weights, target_total: u64) {
    let mut sum = total(plan);
    let pixels = plan.data().len();
    let start = (mix(target_total) % pixels as u64) as usize;
    let samples = plan.data_mut();
    while sum != target_total {
        let before = sum;
        for step in 0..pixels {
            let i = (start + step) % pixels;
            if sum < target_total && weights.at(i) > 0.0 && samples[i] < MAX_SPP {
                // More than one sample per pixel only if more samples than pixels are left.
                let gift = ((target_total - sum) / pixels as u64).clamp(1, u64::from(MAX_SPP - samples[i]));
                samples[i] += gift as u32;
                sum += gift;
            } else if sum > target_total && samples[i] > current.data()[i] {
                samples[i] -= 1;
                sum -= 1;
            }
            if sum == target_total {
                return;
            }
        }
        if sum == before {
            return; // Every pixel is full.
        }
    }
}

/// A number in [0, 1) that depends on nothing but its arguments. `seed` is a mixed number.
fn hashed_unit(seed: u64, index: u64) -> f64 {
    (mix(seed ^ index) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood 2014).
pub(crate) fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Weights with structure on every scale: steep edges, smooth slopes, four orders of magnitude.
    fn varied(width: u32, height: u32) -> Plane<f32> {
        Plane::from_fn(width, height, |x, y| {
            let smooth = 0.2 + (x as f32 * 0.13).sin().powi(2);
            let edge = if (x / 7 + y / 5) % 6 == 0 { 30.0 } else { 1.0 };
            smooth * edge * (0.5 + hashed_unit(7, u64::from(y * width + x)) as f32)
        })
    }

    fn even(width: u32, height: u32) -> Plane<f32> {
        Plane::new(width, height, 1.0)
    }

    #[test]
    fn uniform_plans_are_flat_when_they_can_be() {
        let shares = even(13, 11);
        for spp in [1u32, 16, 64, 2500] {
            let plan = next_round(&empty(13, 11), &shares, u64::from(spp) * 143);
            assert!(plan.data().iter().all(|&n| n == spp), "{spp} spp: {:?}", plan.data());
        }
        let plan = next_round(&empty(13, 11), &shares, 143 * 5 / 2);
        assert!(plan.data().iter().all(|&n| n == 2 || n == 3));
    }

    #[test]
    fn the_total_is_exact_and_every_pixel_has_its_share() {
        let weights = varied(61, 47);
        let sum: f64 = weights.data().iter().map(|&w| f64::from(w)).sum();
        for target in [1, 17, 2866, 2867, 2868, 50_000, 1_000_003, 40_000_000] {
            let plan = next_round(&empty(61, 47), &weights, target);
            assert_eq!(total(&plan), target);
            for (&n, &w) in plan.data().iter().zip(weights.data()) {
                let share = f64::from(w) / sum * target as f64;
                let step = if share >= COARSE_FROM { 4.0 } else { 1.0 };
                // The last few samples that make the total exact may add one more.
                assert!((f64::from(n) - share).abs() <= step + 1.0, "{n} samples for a share of {share}");
            }
        }
    }

    #[test]
    fn large_counts_are_multiples_of_the_batches() {
        let plan = next_round(&empty(61, 47), &varied(61, 47), 61 * 47 * 200);
        let large: Vec<u32> = plan.data().iter().copied().filter(|&n| n >= 40).collect();
        let odd = large.iter().filter(|&&n| n % BATCHES as u32 != 0).count();
        assert!(large.len() > 500 && odd <= 4, "{odd} of {} pixels break their batches", large.len());
    }

    #[test]
    fn plans_never_shrink_and_full_pixels_stay() {
        let weights = varied(40, 30);
        let pilot = Plane::new(40, 30, 16);
        let mut plan = pilot.clone();
        for target in [1200 * 16 + 1, 1200 * 17, 1200 * 24, 1200 * 40, 1200 * 41, 1200 * 400] {
            let next = next_round(&plan, &weights, target);
            assert_eq!(total(&next), target);
            assert!(next.data().iter().zip(plan.data()).all(|(n, c)| n >= c));
            plan = next;
        }
        // The level is above the pilot everywhere: the rounds end with the plan of a single round.
        let direct = next_round(&pilot, &weights, 1200 * 400);
        for (&a, &b) in plan.data().iter().zip(direct.data()) {
            assert!(a.abs_diff(b) <= 9, "{a} in rounds, {b} at once");
        }
    }

    #[test]
    fn small_rounds_are_spread_over_the_whole_image() {
        // 64 rounds of a fiftieth of a sample per pixel: every quarter of the image gets a quarter of the samples each
        // time.
        let (width, height) = (64, 64);
        let shares = even(width, height);
        let mut plan = Plane::new(width, height, 16);
        for round in 1..=64 {
            let next = next_round(&plan, &shares, 4096 * 16 + round * 82);
            let more = increment(&plan, &next);
            for quarter in 0..4 {
                let (x0, y0) = (quarter % 2 * 32, quarter / 2 * 32);
                let sum: u32 =
                    (0..32).flat_map(|y| (0..32).map(move |x| (x, y))).map(|(x, y)| more.at(x0 + x, y0 + y)).sum();
                assert!((8..=36).contains(&sum), "round {round}, quarter {quarter}: {sum} of 82 samples");
            }
            plan = next;
        }
    }

    #[test]
    fn rounding_favours_no_pixel() {
        // Over many seeds (the seed is the total) each pixel of a plan with mean 1/2 is chosen half of the time. There
        // are 16 384 decisions per column. The largest variance, 1.75, is that of four samples with probability 1/8.
        // Neighbours in the serpentine order have negative correlation. A bound of 7 sigma has a false-alarm rate below
        // 2e-10 over 64 columns.
        let mut hits = [0u32; 64];
        for extra in 0..256 {
            let plan = next_round(&Plane::new(64, 64, extra * 3), &even(64, 64), u64::from(extra) * 3 * 4096 + 2048);
            for y in 0..64 {
                for (x, hit) in hits.iter_mut().enumerate() {
                    *hit += plan.at(x as u32, y) - extra * 3;
                }
            }
        }
        for (x, hit) in hits.into_iter().enumerate() {
            assert!((f64::from(hit) - 8192.0).abs() < 7.0 * (16_384f64 * 1.75).sqrt(), "column {x}: {hit} of 16384");
        }
    }

    #[test]
    fn invalid_weights_are_replaced_by_equal_weights() {
        for w in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            let plan = next_round(&empty(5, 4), &Plane::new(5, 4, w), 60);
            assert!(plan.data().iter().all(|&n| n == 3), "weight {w}");
        }
        let one = Plane::from_vec(3, 1, vec![0.0, 2.0, f32::NAN]).expect("three values");
        assert_eq!(next_round(&empty(3, 1), &one, 9).data(), [0, 9, 0]);
    }
}
