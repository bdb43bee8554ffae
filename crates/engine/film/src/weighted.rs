//! The sums of a weighted sum of lights, from the sums of groups of lights over the same samples.
//!
//! The sums of radiance are linear, batch by batch. So mean and variance of the image with factors on its lights are those of
//! a render with these factors: the batches contain the covariance of the groups, which share their samples.
//!
//! The squares of single samples are not linear. Their exact sum would need the products of all pairs of groups. Instead the
//! standard deviation of the samples is set to its upper bound `sum f_g sd_g` over the groups with the factors `f_g`
//! (Minkowski). It is exact for one group, and for groups in proportion. The square is at most n times too large for n
//! groups. The certificate takes from it only the distribution of the noise over the pixels of a cell, and its amount from the
//! batches, so a common factor cancels.

use crate::accumulator::{PixelSums, heaviest_key, number};
use crate::square_sum::SquareSum;
use dunkelfeld_radiometry::Rgb;

impl PixelSums {
    /// The sums of the same samples with factors on the light of some groups, and without all other light. The groups are
    /// given by their own sums. Factors are finite and not negative. Auxiliary layers and numbers of samples stay.
    ///
    /// The heaviest sample is that of the group in which one sample raises the mean most. The other groups have their means in
    /// it.
    pub(crate) fn weighted<'a>(&self, groups: impl Iterator<Item = (&'a Self, f64)>) -> Self {
        let mut sums = Self {
            batches: Default::default(),
            first_light: Default::default(),
            moments: Default::default(),
            heaviest_key: 0,
            luminance_squares: SquareSum::default(),
            ..*self
        };
        let n = f64::from(self.count().max(1));
        let (mut mean, mut deviation, mut heaviest) = (0.0, 0.0, None);
        for (of_group, factor) in groups {
            let radiance = sums.batches.iter_mut().zip(&of_group.batches);
            for (sum, part) in radiance.chain([(&mut sums.first_light, &of_group.first_light)]) {
                sum.0.iter_mut().zip(part.0).for_each(|(sum, v)| *sum = sum.saturating_add(scaled(v, factor)));
            }
            for (sum, &part) in sums.moments.as_flattened_mut().iter_mut().zip(of_group.moments.as_flattened()) {
                let scaled = scaled(part.unsigned_abs(), factor) as i128;
                *sum = sum.saturating_add(if part < 0 { -scaled } else { scaled });
            }
            let of_samples = luminance(of_group.mean());
            mean += factor * of_samples;
            let square = of_group.luminance_squares.to_f64() / n;
            deviation += factor * (square - of_samples * of_samples).max(0.0).sqrt();
            if let Some((index, largest)) = of_group.heaviest() {
                let lift = factor * (f64::from(largest) - of_samples);
                if factor > 0.0 && heaviest.is_none_or(|(most, _)| lift > most) {
                    heaviest = Some((lift, index));
                }
            }
        }
        if let Some((lift, index)) = heaviest {
            sums.heaviest_key = heaviest_key(index, ((mean + lift) as f32).max(0.0));
            sums.luminance_squares = SquareSum::from_f64(n * (mean * mean + deviation * deviation));
        }
        sums
    }
}

fn luminance([r, g, b]: [f64; 3]) -> f64 {
    let weight = |r: f32, g: f32, b: f32| f64::from(Rgb::new(r, g, b).luminance());
    weight(1.0, 0.0, 0.0) * r + weight(0.0, 1.0, 0.0) * g + weight(0.0, 0.0, 1.0) * b
}

/// A sum times a factor, in the units of the sum.
fn scaled(v: u128, factor: f64) -> u128 {
    // `as` saturates.
    if factor == 1.0 { v } else { (number(v) * factor).round() as u128 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accumulator::{Accumulate, sample, signed_number};

    /// The light of two groups in some samples, and its sums.
    fn groups(count: u32) -> (Vec<[Rgb; 2]>, [PixelSums; 2]) {
        let light = |index: u32| {
            let [a, b] = [0x9e37_79b9u32, 0x85eb_ca6b].map(|key| (index + 1).wrapping_mul(key) >> 8);
            [a, b].map(|v| Rgb::new(1.0, 0.5, 0.25) * (v as f32 / 16_777_216.0))
        };
        let all: Vec<[Rgb; 2]> = (0..count).map(light).collect();
        let of = |group: usize| sums_of(all.iter().map(|light| light[group]));
        (all.clone(), [of(0), of(1)])
    }

    fn sums_of(light: impl Iterator<Item = Rgb>) -> PixelSums {
        let mut sums = PixelSums::default();
        (0..).zip(light).for_each(|(index, light)| sums.add(index, &sample(light)));
        sums
    }

    #[test]
    fn mean_and_variance_are_those_of_the_weighted_samples() {
        let (light, [one, two]) = groups(23);
        let whole = sums_of(light.iter().map(|[a, b]| *a + *b));
        for [f, g] in [[1.0, 1.0], [3.0, 0.125], [0.0, 2.0]] {
            let found = whole.weighted([(&one, f), (&two, g)].into_iter());
            let wanted = sums_of(light.iter().map(|[a, b]| *a * f as f32 + *b * g as f32));
            let near = |found: f64, wanted: f64| assert!((found / wanted - 1.0).abs() < 1e-5, "{found} {wanted}");
            for c in 0..3 {
                near(found.mean()[c], wanted.mean()[c]);
                near(found.variance_of_mean()[c], wanted.variance_of_mean()[c]);
                near(found.mean_first_light()[c].into(), wanted.mean_first_light()[c].into());
                near(signed_number(found.moments[0][c]), signed_number(wanted.moments[0][c]));
            }
            assert_eq!((found.counts, found.albedo, found.places), (whole.counts, whole.albedo, whole.places));
            let [bound, scatter] = [found, wanted].map(|sums| sums.scatter().expect("23 samples").all);
            assert!(bound >= scatter * (1.0 - 1e-5) && bound <= 2.0 * scatter, "{bound} {scatter}");
        }
    }

    /// One group with the factor 1 has the sums of its render, and one without light is black.
    #[test]
    fn one_group_has_its_own_sums() {
        let (_, [one, two]) = groups(9);
        let found = two.weighted([(&one, 1.0), (&two, 0.0)].into_iter());
        assert_eq!((found.batches, found.first_light, found.moments), (one.batches, one.first_light, one.moments));
        let [found, wanted] = [found, one].map(|sums| sums.scatter().expect("nine samples"));
        assert!((found.all / wanted.all - 1.0).abs() < 1e-5 && (found.largest / wanted.largest - 1.0).abs() < 1e-5);
        let black = two.weighted([(&one, 0.0)].into_iter());
        assert_eq!((black.mean(), black.heaviest(), black.scatter().map(|s| s.all)), ([0.0; 3], None, Some(0.0)));
        let bright = sums_of([Rgb::splat(1e13), Rgb::splat(3e13)].into_iter());
        let scatter = bright.weighted([(&bright, 1e3)].into_iter()).scatter().expect("two samples").all;
        assert!((scatter / 1e32 - 1.0).abs() < 1e-6, "{scatter}");
        assert_eq!(PixelSums::default().weighted([(&PixelSums::default(), 2.0)].into_iter()), PixelSums::default());
    }
}
