//! How noisy the mean of a pixel is, by its own samples as far as they can tell: what is certified.
//!
//! A pooled variance ([`crate::pooling`]) is that of a neighbourhood: where noise changes from pixel to pixel it smears that of a few
//! over all around them. The squares of a pixel's own samples do not.
//! They fail in two ways: they over-state the noise of quasi-random samples, which are spread more evenly than independent ones, and
//! they know nothing of what has not happened yet. The neighbourhood tells both:
//!
//! v = rho (q - l + sum of l / c), rho = sum of b / sum of q
//!
//! q: variance of the pixel's mean as of independent samples; l: the part of it that its largest sample brings; c: how many pixels it
//! may speak for; b: variance by the spread of batches, honest for quasi-random samples but with three degrees of freedom; sums go over
//! the pixels that may speak for this one, those of its neighbourhood with half to twice as many samples (how likely a sample was to
//! be met depends on it). So all but the largest sample is a pixel's own. That one all that it may
//! speak for might have seen, and each takes a part of it, as Good (1953) has it for species that were met once. Nothing is counted
//! twice: over pixels with as many samples the variances add up to those of the batches, as far as rho is the same everywhere (a ratio
//! estimator: Cochran 1977, chapter 6).

use dunkelfeld_film::{Plane, Scatter};

use crate::evidence::Evidence;
use crate::pooling::{POOL_REACH, PixelNoise, Pool, pixel, witnesses_of};

/// The pixels around one that may speak for it, and for which it may speak, itself among them: a bit each, row by row. None if its own
/// scatter is not known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fellows(u64);

/// Pixels in a row of the square around one.
const SIDE: u32 = 2 * POOL_REACH + 1;

impl Fellows {
    fn count(self) -> u32 {
        self.0.count_ones()
    }

    /// Their places, given that of the pixel, row by row.
    fn places(self, x: u32, y: u32) -> impl Iterator<Item = (u32, u32)> {
        let mut bits = self.0;
        std::iter::from_fn(move || {
            let bit = bits.trailing_zeros();
            bits &= bits.wrapping_sub(1);
            (bit < u64::BITS).then(|| (x + bit % SIDE - POOL_REACH, y + bit / SIDE - POOL_REACH))
        })
    }
}

/// The fellows of the pixels of one row. Rows are independent of each other.
///
/// # Panics
/// If the planes differ in size.
pub fn fellows_row(evidence: &Evidence, y: u32) -> Vec<Fellows> {
    assert!(evidence.is_consistent(), "planes differ in size");
    (0..evidence.width()).map(|x| fellows(evidence, x, y)).collect()
}

fn fellows(evidence: &Evidence, x: u32, y: u32) -> Fellows {
    if told_by(evidence, x, y).is_none() {
        return Fellows::default();
    }
    let n = u64::from(*evidence.counts.at(x, y));
    let bits = witnesses_of(evidence, x, y)
        .filter(|&(nx, ny)| {
            let other = u64::from(*evidence.counts.at(nx, ny));
            other <= 2 * n && n <= 2 * other && told_by(evidence, nx, ny).is_some()
        })
        .fold(0, |bits, (nx, ny)| bits | 1 << ((ny + POOL_REACH - y) * SIDE + nx + POOL_REACH - x));
    Fellows(bits)
}

/// The noise of the pixels of one row, by their own samples as far as they can tell, given the [`fellows_row`] of all rows; as
/// [`crate::pooling::noise_row`] has it where their scatter is not known. Rows are independent of each other.
///
/// # Panics
/// If the planes differ in size.
pub fn own_noise_row(evidence: &Evidence, fellows: &Plane<Fellows>, y: u32) -> Vec<PixelNoise> {
    assert_eq!((fellows.width(), fellows.height()), (evidence.width(), evidence.height()), "planes differ in size");
    let pooled = |x| pixel(evidence, x, y);
    (0..evidence.width()).map(|x| own(evidence, fellows, x, y).unwrap_or_else(|| pooled(x))).collect()
}

/// The noise of all pixels.
pub fn own_noise(evidence: &Evidence) -> Plane<PixelNoise> {
    let (width, height) = (evidence.width(), evidence.height());
    let fellows = (0..height).flat_map(|y| fellows_row(evidence, y)).collect();
    let Some(fellows) = Plane::from_vec(width, height, fellows) else {
        return evidence.mean.map(|_| PixelNoise::UNKNOWN);
    };
    let noise = (0..height).flat_map(|y| own_noise_row(evidence, &fellows, y)).collect();
    Plane::from_vec(width, height, noise).unwrap_or_else(|| Plane::new(width, height, PixelNoise::UNKNOWN))
}

/// What the means of a pixel tell of the variance of one sample: by batches, and as of independent samples, all and the largest's part.
fn told_by(evidence: &Evidence, x: u32, y: u32) -> Option<(f64, Scatter)> {
    let (n, variance) = (f64::from(*evidence.counts.at(x, y)), f64::from(*evidence.variance.at(x, y)));
    let scatter = (*evidence.scatter.at(x, y))?;
    variance.is_finite().then_some((n * variance, Scatter { all: n * scatter.all, largest: n * scatter.largest }))
}

fn own(evidence: &Evidence, fellows: &Plane<Fellows>, x: u32, y: u32) -> Option<PixelNoise> {
    let (_, own) = told_by(evidence, x, y)?;
    let (mut pool, mut all, mut shared, mut squares) = (Pool::default(), 0.0, 0.0, 0.0);
    let mut batches = 0.0;
    for (nx, ny) in fellows.at(x, y).places(x, y) {
        let Some((variance, scatter)) = told_by(evidence, nx, ny) else { continue };
        let share = scatter.largest / f64::from(fellows.at(nx, ny).count().max(1));
        pool.add(variance, f64::from(*evidence.mean.at(nx, ny)));
        batches += variance;
        all += scatter.all;
        shared += share;
        squares += share * share;
    }
    let rho = batches / all;
    if !rho.is_finite() {
        return None;
    }
    let pooled = pool.noise();
    let body = (own.all - own.largest).max(0.0);
    // Nothing of the body weighs more than the largest sample: it is made of body / largest events at least, whose number scatters
    // as Poisson's. The same goes for what is shared, one event a pixel. A variance with f degrees of freedom scatters by 2 / f.
    let spread = body * own.largest + squares;
    let relative = if spread > 0.0 { spread / (body + shared).powi(2) } else { 0.0 };
    let freedom = 2.0 / (relative + 2.0 / f64::from(pooled.freedom));
    let variance = (rho * (body + shared)) as f32;
    variance.is_finite().then_some(PixelNoise { variance, freedom: freedom as f32, mean: pooled.mean })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::{Level, Surface};
    use crate::pooling::noise;
    use dunkelfeld_film::{Accumulate, PixelSums, Sample};

    const WIDTH: u32 = 32;

    /// Numbers as good as random.
    struct Random(u64);

    impl Random {
        fn unit(&mut self) -> f64 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    /// A film whose samples are drawn pixel by pixel.
    fn film(count: u32, seed: u64, mut draw: impl FnMut(u32, u32, u32, &mut Random) -> f64) -> Plane<PixelSums> {
        let mut random = Random(seed << 32);
        Plane::from_fn(WIDTH, WIDTH, |x, y| {
            let mut sums = PixelSums::default();
            for index in 0..count {
                let v = draw(x, y, index, &mut random) as f32;
                let mut sample = Sample::MISS;
                (sample.radiance.r, sample.radiance.g, sample.radiance.b) = (v, v, v);
                sums.add(index, &sample);
            }
            sums
        })
    }

    fn evidence_of(film: &Plane<PixelSums>) -> Evidence {
        Evidence {
            counts: film.map(PixelSums::count),
            mean: film.map(|p| p.mean()[0] as f32),
            variance: film.map(|p| p.variance_of_mean()[0] as f32),
            scatter: film.map(PixelSums::scatter),
            largest: film.map(PixelSums::max_luminance),
            surface: Plane::new(WIDTH, WIDTH, Surface::default()),
            level: Plane::new(WIDTH, WIDTH, Level::ANY),
        }
    }

    fn total(noise: &Plane<PixelNoise>) -> f64 {
        noise.data().iter().map(|n| f64::from(n.variance)).sum()
    }

    #[test]
    fn noise_stays_in_the_pixel_that_has_it() {
        // One pixel in 64 has a hundred times the variance of the others.
        let is_loud = |x: u32, y: u32| x % 8 == 3 && y % 8 == 3;
        let film = film(256, 1, |x, y, _, random| if is_loud(x, y) { 10.0 } else { 1.0 } * random.unit());
        let (evidence, quiet, loud) = (evidence_of(&film), 1.0 / 12.0, 100.0 / 12.0);
        let (own, pooled) = (own_noise(&evidence), noise(&evidence));
        // In the middle of the film each neighbourhood holds all there is.
        let ratio = |noise: &Plane<PixelNoise>, wanted: bool, truth: f64| {
            let places = (8..24).flat_map(|y| (8..24).map(move |x| (x, y))).filter(|&(x, y)| is_loud(x, y) == wanted);
            let (sum, count) =
                places.fold((0.0, 0.0), |(s, c), (x, y)| (s + f64::from(noise.at(x, y).variance), c + 1.0));
            sum / count / truth
        };
        // Ratios of neighbourhoods have the freedom of the batches of one loud pixel, on average over four.
        for (wanted, truth) in [(false, quiet), (true, loud)] {
            let ratio = ratio(&own, wanted, truth);
            assert!((0.6..1.6).contains(&ratio), "loud {wanted}: {ratio}");
        }
        assert!(ratio(&pooled, false, quiet) > 1.5 && ratio(&pooled, true, loud) < 0.3, "pooled variances are smeared");
    }

    #[test]
    fn fellows_are_mutual_and_in_their_places() {
        let film = film(16, 4, |_, _, _, random| random.unit());
        let mut evidence = evidence_of(&film);
        evidence.surface =
            Plane::from_fn(WIDTH, WIDTH, |x, _| Surface { object: u32::from(x >= 5), ..Surface::default() });
        evidence.scatter.data_mut()[2 * 32 + 3] = None;
        let row = |y| fellows_row(&evidence, y);
        // In the corner of five columns: four by four pixels, one of which tells nothing.
        let corner: Vec<(u32, u32)> = row(0)[0].places(0, 0).collect();
        let wanted = (0..4).flat_map(|y| (0..4).map(move |x| (x, y))).filter(|&at| at != (3, 2));
        assert_eq!(corner, wanted.collect::<Vec<_>>());
        assert_eq!((row(2)[3], row(31)[31].count(), row(15)[20].count()), (Fellows::default(), 16, 49));
        for y in 0..WIDTH {
            for (x, fellows) in (0..).zip(row(y)) {
                assert!(
                    fellows.places(x, y).all(|(nx, ny)| row(ny)[nx as usize].places(nx, ny).any(|at| at == (x, y)))
                );
            }
        }
    }

    #[test]
    fn what_nobody_saw_twice_is_shared() {
        // One sample in 4096 is lit: of 64 samples per pixel one pixel in 64 has seen one.
        let (p, n) = (1.0 / 4096.0, 64);
        let mut sum = 0.0;
        for seed in 0..20 {
            let film = film(n, seed, |_, _, _, random| f64::from(u8::from(random.unit() < p)));
            let own = own_noise(&evidence_of(&film));
            let dark = own.data().iter().zip(film.data()).filter(|(_, p)| p.max_luminance() == 0.0);
            let (total, count) =
                dark.fold((0.0, 0.0), |(sum, count), (o, _)| (sum + f64::from(o.variance), count + 1.0));
            sum += total / count;
        }
        // The dark ones know nothing of it by themselves.
        let mean = sum / 20.0 / p;
        assert!((0.7..1.3).contains(&mean), "{mean}");
    }

    /// Rare samples in pixels of which every other row has sixteen times as many: each is certified what it has.
    #[test]
    fn pixels_with_other_numbers_of_samples_do_not_share() {
        let p = 1.0 / 64.0;
        let mut sums = [0.0; 2];
        for seed in 0..12 {
            let mut random = Random(seed << 32);
            let film = Plane::from_fn(WIDTH, WIDTH, |_, y| {
                let mut sums = PixelSums::default();
                for index in 0..if y % 2 == 0 { 16 } else { 256 } {
                    let v = f32::from(u8::from(random.unit() < p));
                    let mut sample = Sample::MISS;
                    (sample.radiance.r, sample.radiance.g, sample.radiance.b) = (v, v, v);
                    sums.add(index, &sample);
                }
                sums
            });
            let own = own_noise(&evidence_of(&film));
            for (i, noise) in own.data().iter().enumerate() {
                sums[i / WIDTH as usize % 2] += f64::from(noise.variance) / (p * (1.0 - p));
            }
        }
        for sum in sums {
            let ratio = sum / 12.0 / f64::from(WIDTH * WIDTH / 2);
            assert!((0.9..1.1).contains(&ratio), "{ratio}");
        }
    }

    #[test]
    fn it_is_right_on_average_for_independent_and_for_even_samples() {
        // Independent samples; and samples of which each batch holds one from every part of the range.
        let n = 64;
        for (even, truth) in [(false, 1.0 / 12.0), (true, 1.0 / 12.0 / 256.0)] {
            let film = film(n, 5, |_, _, index, random| {
                let stratum = f64::from(index / 4) / 16.0;
                if even { stratum + random.unit() / 16.0 } else { random.unit() }
            });
            let own = own_noise(&evidence_of(&film));
            let mean = total(&own) / f64::from(WIDTH * WIDTH) / truth;
            // 1024 variances with three degrees of freedom: a standard error of 2.6 %.
            assert!((mean - 1.0).abs() < 0.13, "even {even}: {mean}");
            let off = own.data().iter().map(|o| (f64::from(o.variance) / truth - 1.0).powi(2)).sum::<f64>();
            let rms = (off / f64::from(WIDTH * WIDTH)).sqrt();
            assert!(rms < 0.35, "a variance by batches alone is off by 0.82: {rms}");
        }
    }

    #[test]
    fn sums_of_neighbourhoods_are_those_of_their_batches() {
        let film = film(32, 9, |x, _, _, random| f64::from(x + 1) * random.unit().powi(4));
        let mut evidence = evidence_of(&film);
        // Seven by seven pixels that speak for each other, and for no one else.
        evidence.surface = Plane::from_fn(WIDTH, WIDTH, |x, y| {
            let inside = (10..14).contains(&x) && (10..14).contains(&y);
            Surface { object: u32::from(inside), ..Surface::default() }
        });
        let inside = || (10..14).flat_map(|y| (10..14).map(move |x| (x, y)));
        let own = own_noise(&evidence);
        let by_own: f64 = inside().map(|(x, y)| f64::from(own.at(x, y).variance)).sum();
        let by_batches: f64 = inside().map(|(x, y)| 32.0 * f64::from(*evidence.variance.at(x, y))).sum();
        assert!((by_own / by_batches - 1.0).abs() < 1e-5, "{by_own} {by_batches}");
    }

    #[test]
    fn where_scatter_is_not_known_neighbourhoods_speak() {
        let film = film(16, 3, |_, _, _, random| random.unit());
        let mut evidence = evidence_of(&film);
        evidence.scatter = Plane::new(WIDTH, WIDTH, None);
        assert_eq!(own_noise(&evidence), noise(&evidence));
        // Black: no noise at all, as batches have it.
        let black = evidence_of(&self::film(16, 3, |_, _, _, _| 0.0));
        assert!(own_noise(&black).data().iter().all(|n| n.variance == 0.0));
        // A sample a pixel: nothing is known.
        let one = evidence_of(&self::film(1, 3, |_, _, _, random| random.unit()));
        assert!(own_noise(&one).data().iter().all(|n| *n == PixelNoise::UNKNOWN));
    }

    #[test]
    fn freedom_is_that_of_few_events_where_there_are_few() {
        let even = own_noise(&evidence_of(&film(256, 2, |_, _, _, random| random.unit())));
        assert!(even.at(16, 16).freedom > 40.0, "{:?}", even.at(16, 16));
        let rare = own_noise(&evidence_of(&film(64, 2, |_, _, _, random| f64::from(u8::from(random.unit() < 1e-3)))));
        let noisy = || rare.data().iter().filter(|n| n.variance > 0.0);
        assert!(noisy().count() > 100 && noisy().all(|n| n.freedom < 40.0));
    }
}
