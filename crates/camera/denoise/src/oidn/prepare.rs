//! Preparation of images for the library: finite, in range, and with a scale that is stable between seeds.

use crate::denoiser::Triples;
use dunkelfeld_film::{Plane, fill_gaps};
use std::borrow::Cow;

/// The largest value for the library, after scaling. Above it, the half-precision weights of the library lose
/// precision.
const BRIGHTEST: f32 = 65_504.0;
/// This quantile of the luminance is scaled to [`WHITE`], as in automatic exposure.
const QUANTILE: f64 = 0.995;
const WHITE: f32 = 0.9;
/// Number of pixels that suffices for the quantile.
const MAX_EXAMINED: usize = 1 << 20;

/// The radiance for the library, and its scale factor. Values that are not finite are replaced by the mean of their
/// neighbours, negative ones by zero.
pub(super) fn radiance(mean: &Triples) -> (Cow<'_, Triples>, f32) {
    let finite = finite(mean);
    let scale = input_scale(&finite);
    let brightest = (BRIGHTEST / scale).min(f32::MAX);
    let in_range = |v: &f32| (0.0..=brightest).contains(v);
    if finite.data().as_flattened().iter().all(in_range) {
        return (finite, scale);
    }
    (Cow::Owned(finite.map(|v| v.map(|v| v.clamp(0.0, brightest)))), scale)
}

/// A feature with every component in `least..=1`. NaN becomes zero.
pub(super) fn feature(plane: &Triples, least: f32) -> Triples {
    plane.map(|v| v.map(|v| if v.is_nan() { 0.0 } else { v.clamp(least, 1.0) }))
}

/// The plane itself, or a copy in which pixels that are not finite have the mean of their neighbours, or zero.
fn finite(mean: &Triples) -> Cow<'_, Triples> {
    let is_finite = |v: &[f32; 3]| v.iter().all(|v| v.is_finite());
    if mean.data().iter().all(is_finite) {
        return Cow::Borrowed(mean);
    }
    let known = mean.map(is_finite);
    let zeroed = mean.map(|v| if is_finite(v) { *v } else { [0.0; 3] });
    Cow::Owned(fill_gaps(&zeroed, &known))
}

/// The factor that scales the bright parts of an image to about one. The library's own exposure uses the mean of
/// logarithms, which differs from seed to seed in dark images.
fn input_scale(mean: &Plane<[f32; 3]>) -> f32 {
    let step = mean.data().len().div_ceil(MAX_EXAMINED).max(1);
    let luminance = |[r, g, b]: [f32; 3]| 0.2126 * r.max(0.0) + 0.7152 * g.max(0.0) + 0.0722 * b.max(0.0);
    let mut values: Vec<f32> = mean.data().iter().step_by(step).map(|&v| luminance(v)).collect();
    if values.is_empty() {
        return 1.0;
    }
    let at = ((values.len() - 1) as f64 * QUANTILE) as usize;
    let (_, bright, above) = values.select_nth_unstable_by(at, f32::total_cmp);
    // If almost all pixels are black, the brightest pixel counts.
    let bright = if *bright > 0.0 { *bright } else { above.iter().copied().fold(0.0, f32::max) };
    let scale = WHITE / bright;
    if bright > 0.0 && scale.is_normal() { scale } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn non_finite_pixels_take_the_neighbours_and_negative_ones_are_black() {
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0];
        let is_odd = |x: u32, y: u32| y == 0 && x.is_multiple_of(2);
        let mean = Plane::from_fn(8, 4, |x, y| [if is_odd(x, y) { odd[x as usize / 2] } else { 1.0 }, 1.0, 1.0]);
        let (safe, scale) = radiance(&mean);
        assert!((scale - 0.9).abs() < 1e-6, "{scale}");
        let expected = Plane::from_fn(8, 4, |x, y| [if (x, y) == (6, 0) { 0.0 } else { 1.0 }, 1.0, 1.0]);
        assert_eq!(*safe, expected);
        let (all, scale) = (Plane::new(3, 1, [f32::NAN; 3]), 1.0);
        assert_eq!(radiance(&all), (Cow::Owned(Plane::new(3, 1, [0.0; 3])), scale));
    }

    #[test]
    fn the_scale_follows_the_bright_parts_not_a_firefly_and_never_leaves_its_range() {
        let image = |bright: f32, most: f32| {
            Plane::from_fn(100, 10, |x, y| {
                [if (x, y) == (0, 0) {
                    most
                } else if x < 50 {
                    bright
                } else {
                    0.0
                }; 3]
            })
        };
        assert!((radiance(&image(2.0, 2.0)).1 - 0.45).abs() < 1e-6);
        assert_eq!(radiance(&image(2.0, 1e6)).1, radiance(&image(2.0, 2.0)).1);
        let brightest = radiance(&image(2.0, f32::MAX)).0.at(0, 0)[0];
        assert!(brightest * 0.45 <= 65_600.0, "{brightest}");
        assert!((radiance(&image(0.0, 3.0)).1 - 0.3).abs() < 1e-6, "all but one pixel black");
        for value in [0.0, f32::MIN_POSITIVE * 1e-3, f32::MAX] {
            let scale = radiance(&Plane::new(2, 2, [value; 3])).1;
            assert!(scale.is_normal() && scale > 0.0, "{value}: {scale}");
        }
        assert_eq!(radiance(&Plane::new(0, 0, [0.0; 3])).1, 1.0);
    }

    #[test]
    fn features_are_numbers_in_their_range() {
        let plane = Plane::new(1, 1, [f32::NAN, 2.0, f32::NEG_INFINITY]);
        assert_eq!(feature(&plane, -1.0).data(), [[0.0, 1.0, -1.0]]);
        assert_eq!(feature(&plane, 0.0).data(), [[0.0, 1.0, 0.0]]);
    }
}
