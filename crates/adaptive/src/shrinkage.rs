//! What a neighbourhood of 7 x 7 pixels has not seen often enough, asked of wider ones.
//!
//! Where rare bright samples make up the light, a short pilot has met them in few places. There the pooled variance is far
//! too large, elsewhere it is far too small, and a plan that believes both starves most of the image. So the variance of
//! a pixel, in units of what a sensor would tolerate there, is drawn towards that of its surroundings, and this towards that of all
//! pixels that show the same: the more so the fewer degrees of freedom it rests on (shrinkage by a conjugate prior: Lindley and
//! Smith 1972). Where the pilot has seen enough, a neighbourhood speaks for itself.

use std::collections::HashMap;

use dunkelfeld_film::Plane;

use crate::evidence::{Evidence, Surface};
use crate::pooling::{FREEDOM, PixelNoise, satterthwaite};

/// Degrees of freedom that a wider neighbourhood's word is worth: as much as seven pixels with nothing rare in them.
const PRIOR_FREEDOM: f64 = 20.0;
/// Surroundings are the cell of this width that a pixel lies in, and the eight around it.
const CELL: u32 = 16;

/// Draws the variances of all pixels towards those of wider neighbourhoods, by 20 degrees of freedom. `noise` holds what the
/// neighbours of each pixel say ([`crate::pooling::Witnesses::Neighbours`]), and no pixel's own samples have a say here
/// either. Variances are compared over `mean + floor`, where the mean counts up to `most`: the sensor variance of a pixel if `floor` is
/// that of a black one, and `most` the signal at which it saturates. The freedom of the result counts that of the prior.
///
/// # Panics
/// If the planes differ in size.
pub fn shrunk(evidence: &Evidence, noise: &Plane<PixelNoise>, floor: f64, most: f64) -> Plane<PixelNoise> {
    assert!(evidence.is_consistent(), "planes differ in size");
    let (width, height) = (evidence.width(), evidence.height());
    assert_eq!((noise.width(), noise.height()), (width, height), "planes differ in size");
    let scale = |mean: f32| (f64::from(mean).clamp(0.0, most) + floor).max(f64::MIN_POSITIVE);
    let own = |i: usize| {
        let (n, variance) = (evidence.counts.data()[i], evidence.variance.data()[i]);
        let mut sums = Sums::default();
        if n > 0 && variance.is_finite() {
            sums.add(f64::from(n) * f64::from(variance), scale(evidence.mean.data()[i]));
        }
        sums
    };

    let mut everything = Sums::default();
    let mut kinds: HashMap<Kind, Sums> = HashMap::new();
    let mut cells: HashMap<(u32, u32, Kind), Sums> = HashMap::new();
    let places = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    for (i, ((x, y), surface)) in places().zip(evidence.surface.data()).enumerate() {
        let sums = own(i);
        everything.join(&sums);
        kinds.entry(Kind::of(surface)).or_default().join(&sums);
        cells.entry((x / CELL, y / CELL, Kind::of(surface))).or_default().join(&sums);
    }
    let around: HashMap<(u32, u32, Kind), Sums> = cells
        .keys()
        .map(|&(x, y, kind)| {
            let mut sums = Sums::default();
            // In a fixed order: sums of floating-point numbers depend on it.
            for (dx, dy) in (0..3).flat_map(|dy| (0..3).map(move |dx| (dx, dy))) {
                if let Some(near) = cells.get(&((x + dx).wrapping_sub(1), (y + dy).wrapping_sub(1), kind)) {
                    sums.join(near);
                }
            }
            ((x, y, kind), sums)
        })
        .collect();

    let pixels =
        places().zip(evidence.surface.data()).zip(noise.data()).enumerate().map(|(i, ((at, surface), noise))| {
            let (own, kind) = (own(i), Kind::of(surface));
            let without_own = |sums: Option<&Sums>| sums.copied().unwrap_or_default().without(&own);
            let Some(everywhere) = everything.without(&own).ratio() else { return *noise };
            let alike = without_own(kinds.get(&kind)).towards(everywhere);
            let nearby = without_own(around.get(&(at.0 / CELL, at.1 / CELL, kind))).towards(alike);
            let prior = nearby * scale(noise.mean);
            let freedom = if noise.variance.is_finite() { f64::from(noise.freedom) } else { 0.0 };
            let said = if freedom > 0.0 { freedom * f64::from(noise.variance) } else { 0.0 };
            PixelNoise {
                variance: ((said + PRIOR_FREEDOM * prior) / (freedom + PRIOR_FREEDOM)) as f32,
                freedom: (freedom + PRIOR_FREEDOM) as f32,
                ..*noise
            }
        });
    Plane::from_vec(width, height, pixels.collect()).unwrap_or_else(|| noise.clone())
}

/// Pixels that are asked together, wherever they lie: those of an object, its border by itself.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Kind {
    object: u32,
    border: bool,
}

impl Kind {
    fn of(surface: &Surface) -> Self {
        Self { object: surface.object, border: surface.border }
    }
}

/// Variances of single samples, what they are compared with, and how much they can be trusted. The largest variance is kept by
/// itself: it may be so large that sums with it forget all others.
#[derive(Clone, Copy, Default)]
struct Sums {
    count: u32,
    largest: f64,
    /// Of all but the largest.
    variance: f64,
    squares: f64,
    scale: f64,
}

impl Sums {
    fn add(&mut self, variance: f64, scale: f64) {
        self.join(&Self { count: 1, largest: variance, scale, ..Self::default() });
    }

    fn join(&mut self, other: &Self) {
        let smaller = self.largest.min(other.largest);
        self.largest = self.largest.max(other.largest);
        self.count += other.count;
        self.variance += other.variance + smaller;
        self.squares += other.squares + smaller * smaller;
        self.scale += other.scale;
    }

    /// These without one pixel that is among them. What rounding leaves below zero is nothing.
    fn without(&self, one: &Self) -> Self {
        let mut rest = *self;
        if one.largest >= self.largest {
            rest.largest = 0.0;
        } else {
            rest.variance = (self.variance - one.largest).max(0.0);
            rest.squares = (self.squares - one.largest * one.largest).max(0.0);
        }
        rest.count = self.count.saturating_sub(one.count);
        rest.scale = (self.scale - one.scale).max(0.0);
        rest
    }

    /// Variance over scale; `None` without pixels.
    fn ratio(&self) -> Option<f64> {
        (self.count > 0 && self.scale > 0.0).then(|| (self.variance + self.largest) / self.scale)
    }

    /// The ratio, drawn towards another.
    fn towards(&self, prior: f64) -> f64 {
        let Some(ratio) = self.ratio() else { return prior };
        let (sum, squares) = (self.variance + self.largest, self.squares + self.largest * self.largest);
        let freedom = satterthwaite(sum, squares, f64::from(self.count)).max(FREEDOM);
        (freedom * ratio + PRIOR_FREEDOM * prior) / (freedom + PRIOR_FREEDOM)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::Level;
    use crate::pooling::{Witnesses, noise};

    /// Sixteen samples per pixel, mean 90, floor 10: variances of single samples over 100 are what is drawn together.
    fn image(width: u32, height: u32, mut ratio: impl FnMut(u32, u32) -> f32) -> Evidence {
        Evidence {
            counts: Plane::new(width, height, 16),
            mean: Plane::new(width, height, 90.0),
            variance: Plane::from_fn(width, height, |x, y| ratio(x, y) * 100.0 / 16.0),
            scatter: Plane::new(width, height, None),
            largest: Plane::new(width, height, 90.0),
            surface: Plane::new(width, height, Surface::default()),
            level: Plane::new(width, height, Level::ANY),
        }
    }

    fn ratios(evidence: &Evidence) -> Plane<f32> {
        shrunk(evidence, &noise(evidence, Witnesses::Neighbours), 10.0, f64::INFINITY).map(|n| n.variance / 100.0)
    }

    #[test]
    fn where_all_agree_nothing_changes() {
        let ratios = ratios(&image(40, 40, |_, _| 3.0));
        assert!(ratios.data().iter().all(|r| (r - 3.0).abs() < 1e-4));
    }

    #[test]
    fn a_rare_event_raises_its_surroundings_and_a_little_what_is_far() {
        // One pixel of 6400 has met an event that raises the variance of its square to 100.
        let with = |event: f32| ratios(&image(80, 80, |x, y| if (x, y) == (40, 40) { event } else { 1.0 }));
        let (quiet, seen) = (with(1.0), with(4800.0));
        let (near, cell, far) = (*seen.at(41, 40), *seen.at(50, 40), *seen.at(2, 2));
        // By itself, the square of 48 neighbours would say 101.
        assert!(near > 10.0 && near < 40.0, "near {near}");
        assert!(cell < 3.0 && cell > 1.0, "in the next cell {cell}");
        assert!(far > 1.0 && far < 1.3, "far {far}");
        assert!((quiet.at(41, 40) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn a_neighbourhood_that_has_seen_enough_speaks_for_itself() {
        // Half the image has ten times the noise of the other, and all of its pixels say so: 144 degrees of freedom against 20.
        let ratios = ratios(&image(96, 96, |x, _| if x < 48 { 1.0 } else { 10.0 }));
        assert!((*ratios.at(8, 48) - 1.0).abs() < 0.1, "{}", ratios.at(8, 48));
        assert!((*ratios.at(88, 48) - 10.0).abs() < 0.2, "{}", ratios.at(88, 48));
    }

    #[test]
    fn other_objects_have_next_to_no_say() {
        let mut evidence = image(64, 64, |x, y| if x < 32 { 50.0 } else { f32::from(u8::from((x + y) % 40 == 0)) });
        evidence.surface = Plane::from_fn(64, 64, |x, _| Surface { object: u32::from(x >= 32), ..Surface::default() });
        let ratios = ratios(&evidence);
        assert!(*ratios.at(40, 30) < 1.0, "{}", ratios.at(40, 30));
        assert!((*ratios.at(20, 30) - 50.0).abs() < 1.0);
    }

    #[test]
    fn brightness_is_taken_out() {
        // Variance over (mean + floor) is the same in the dark half as in the bright one.
        let mut evidence = image(64, 64, |_, _| 1.0);
        evidence.mean = Plane::from_fn(64, 64, |x, _| if x < 32 { 0.0 } else { 990.0 });
        evidence.variance = Plane::from_fn(64, 64, |x, _| if x < 32 { 10.0 } else { 1000.0 } / 16.0);
        let planned = shrunk(&evidence, &noise(&evidence, Witnesses::Neighbours), 10.0, f64::INFINITY);
        assert!((planned.at(10, 30).variance - 10.0).abs() < 1e-3, "{:?}", planned.at(10, 30));
        assert!((planned.at(50, 30).variance - 1000.0).abs() < 0.1, "{:?}", planned.at(50, 30));
    }

    #[test]
    fn a_pixel_has_no_say_in_what_is_expected_of_it() {
        let evidence = image(40, 40, |x, y| 1.0 + ((x * 7 + y * 3) % 5) as f32);
        let at = 20 * 40 + 20;
        let before = ratios(&evidence).data()[at];
        let mut other = evidence;
        other.variance.data_mut()[at] = 1e6;
        other.mean.data_mut()[at] = 1e5;
        other.largest.data_mut()[at] = 1e5;
        let after = ratios(&other).data()[at];
        assert!((after / before - 1.0).abs() < 1e-6, "{before} {after}");
    }

    #[test]
    fn even_a_pixel_that_outweighs_all_others_has_no_say_in_what_is_expected_of_it() {
        // Squares of its variance have digits for nothing else.
        let at = 20 * 40 + 20;
        let with = |own: f32| ratios(&image(40, 40, |x, y| if (x, y) == (20, 20) { own } else { 3.0 })).data()[at];
        for own in [0.0, 3.0, 1e12, 1e20] {
            assert!((with(own) / 3.0 - 1.0).abs() < 1e-4, "{own}: {}", with(own));
        }
    }

    #[test]
    fn saturated_pixels_are_compared_with_what_they_can_show() {
        let mut evidence = image(40, 40, |_, _| 1.0);
        evidence.mean = Plane::from_fn(40, 40, |x, y| if (x + y) % 7 == 0 { 1e6 } else { 90.0 });
        let drawn = shrunk(&evidence, &noise(&evidence, Witnesses::Neighbours), 10.0, 90.0);
        assert!(drawn.data().iter().all(|n| (n.variance / 100.0 - 1.0).abs() < 1e-4));
    }

    #[test]
    fn what_is_unknown_is_what_the_others_say() {
        let mut evidence = image(30, 30, |_, _| 2.0);
        evidence.surface.data_mut()[0] = Surface { object: 9, ..Surface::default() };
        (0..30).for_each(|x| evidence.variance.data_mut()[x] = f32::INFINITY);
        assert!(ratios(&evidence).data().iter().all(|r| (r - 2.0).abs() < 1e-3));
        evidence.variance = Plane::new(30, 30, f32::INFINITY);
        let unknown = shrunk(&evidence, &noise(&evidence, Witnesses::Neighbours), 10.0, f64::INFINITY);
        assert!(unknown.data().iter().all(|n| n.variance == f32::INFINITY && n.freedom == 0.0));
        assert!(
            shrunk(&image(0, 0, |_, _| 0.0), &Plane::new(0, 0, PixelNoise::UNKNOWN), 1.0, f64::INFINITY)
                .data()
                .is_empty()
        );
    }
}
