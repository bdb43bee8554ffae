//! The variance of the mean of a pixel, from its own samples and those of its block. The certificate uses it.
//!
//! A pooled variance ([`crate::variance::pooled`]) is that of a neighbourhood. If noise changes from pixel to pixel,
//! pooling spreads that of a few pixels over all around them. The squares of a pixel's own samples do not. They have
//! two errors. They overestimate the noise of quasi-random samples, which are spread more evenly than independent ones.
//! They also lack the events that the pixel has not sampled yet. The pixels around give both corrections:
//!
//! v = rho (q - l) + sum of rho' l' / c', rho = sum of b / sum of q
//!
//! q is the variance of the pixel's mean under the assumption of independent samples. l is the part of q that comes
//! from its largest sample. b is the variance from the spread of batches: it is unbiased for quasi-random samples but
//! has three degrees of freedom. b and q are summed over a cell of 8 x 8 pixels (a ratio estimator: Cochran 1977,
//! chapter 6). So all but the largest sample stays with its own pixel. Other pixels might have had the largest sample
//! as well. So it is shared among c' pixels, and each takes a part of it, as in the estimate of Good (1953) for species
//! that were observed once. The c' pixels are those of the smallest cell, 4 x 4, 8 x 8 or 16 x 16, that contains
//! another sample as large. If such samples are common, they stay near. A sample that is unique in its surroundings
//! counts for all of them.
//!
//! Only similar pixels share their estimates: they show the same surface, have a similar brightness, and half to twice
//! as many samples. The probability of an event depends on the number of samples, and pixels take parts in inverse
//! proportion to their numbers. Cells are aligned, nothing leaves its block of 16 x 16, and nothing is counted twice.
//! If the pixels form groups of similar pixels, the certified variances of the means of a block add up to those from
//! its batches.

use dunkelfeld_film::{Plane, Scatter};

use crate::variance::inputs::NoiseInputs;
use crate::variance::pooled::{PixelNoise, Pool, pixel};

/// Side of a block \[pixels\]. If the scatter of its samples is known, the certified variance of a pixel depends on its
/// block alone.
pub const BLOCK: u32 = 16;

/// Sides of the cells whose pixels may share a sample: the first cell with another sample as large, or the last.
const CELLS: [u32; 3] = [4, 8, BLOCK];

/// Least ratio of two deviations that count as equally large. So the rounding of single precision does not decide which
/// pixels share.
const AS_LARGE: f64 = 1.0 - 1e-5;

/// Side of the cells for the evenness: the variance of the samples over that of independent ones.
const EVENNESS: u32 = 8;

/// The noise of the pixels of one row of blocks, row by row, from their own samples. Pixels of unknown scatter have the
/// noise of [`crate::variance::pooled::noise_row`]. Rows of blocks are independent of each other.
///
/// # Panics
/// If the planes differ in size.
pub fn pixel_noise_of_blocks(evidence: &NoiseInputs, row_of_blocks: u32) -> Vec<PixelNoise> {
    assert!(evidence.is_consistent(), "planes differ in size");
    let (width, top) = (evidence.width(), row_of_blocks.saturating_mul(BLOCK));
    let height = evidence.height().saturating_sub(top).min(BLOCK);
    let mut noise = vec![PixelNoise::UNKNOWN; width as usize * height as usize];
    if height == 0 {
        return noise;
    }
    for left in (0..width).step_by(BLOCK as usize) {
        let block = Block::new(evidence, left, top);
        for (row, of_block) in block.noise().chunks(block.width as usize).enumerate() {
            let start = row * width as usize + left as usize;
            noise[start..start + of_block.len()].copy_from_slice(of_block);
        }
    }
    noise
}

/// The noise of all pixels.
pub fn pixel_noise(evidence: &NoiseInputs) -> Plane<PixelNoise> {
    let (width, height) = (evidence.width(), evidence.height());
    let noise = (0..height.div_ceil(BLOCK)).flat_map(|row| pixel_noise_of_blocks(evidence, row)).collect();
    Plane::from_vec(width, height, noise).unwrap_or_else(|| Plane::new(width, height, PixelNoise::UNKNOWN))
}

/// Variances of the mean of a pixel, from its samples.
#[derive(Clone, Copy)]
struct BatchVariances {
    /// Number of samples.
    count: f64,
    /// Variance from the spread of batches.
    batches: f64,
    /// Variance as of independent samples: all of it, and the part of the largest sample.
    all: f64,
    largest: f64,
}

impl BatchVariances {
    fn by(evidence: &NoiseInputs, x: u32, y: u32) -> Option<Self> {
        let (batches, Scatter { all, largest }) =
            (f64::from(*evidence.variance.at(x, y)), (*evidence.scatter.at(x, y))?);
        let is_known = batches.is_finite() && all.is_finite() && largest.is_finite() && largest >= 0.0;
        is_known.then_some(Self { count: f64::from(*evidence.counts.at(x, y)), batches, all, largest })
    }

    /// Squared distance of the largest sample from the mean. It does not depend on the number of the other samples.
    fn deviation(&self) -> f64 {
        self.count * self.count * self.largest
    }
}

/// Evenness of the samples of a cell: their variance by batches over that of independent ones, and the mean of
/// the cell.
#[derive(Clone, Copy)]
struct Evenness {
    rho: f64,
    mean: f32,
}

/// The pixels of a block.
struct Block<'a> {
    evidence: &'a NoiseInputs,
    left: u32,
    top: u32,
    width: u32,
    height: u32,
    /// Row by row. `None` if the scatter of a pixel or its variance by batches is unknown.
    pixels: Vec<Option<BatchVariances>>,
}

impl<'a> Block<'a> {
    fn new(evidence: &'a NoiseInputs, left: u32, top: u32) -> Self {
        let (width, height) = ((evidence.width() - left).min(BLOCK), (evidence.height() - top).min(BLOCK));
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let pixels = places.map(|(x, y)| BatchVariances::by(evidence, left + x, top + y)).collect();
        Self { evidence, left, top, width, height, pixels }
    }

    /// Column and row in the image of the pixel with an index in the block.
    fn place(&self, pixel: usize) -> (u32, u32) {
        (self.left + pixel as u32 % self.width, self.top + pixel as u32 / self.width)
    }

    /// The pixels of a pixel's cell with which it may share estimates, including itself, with their variances.
    fn similar(&self, pixel: usize, cell: u32) -> impl Iterator<Item = (usize, BatchVariances)> {
        let (x, y) = (pixel as u32 % self.width / cell * cell, pixel as u32 / self.width / cell * cell);
        let rows = y..(y + cell).min(self.height);
        let columns = x..(x + cell).min(self.width);
        let others = rows.flat_map(move |y| columns.clone().map(move |x| (y * self.width + x) as usize));
        others.filter_map(move |other| {
            let is_used = other == pixel || self.are_alike(pixel, other);
            self.pixels[other].filter(|_| is_used).map(|own| (other, own))
        })
    }

    fn are_alike(&self, one: usize, other: usize) -> bool {
        let (e, a, b) = (self.evidence, self.place(one), self.place(other));
        let (n, m) = (u64::from(*e.counts.at(a.0, a.1)), u64::from(*e.counts.at(b.0, b.1)));
        n <= 2 * m
            && m <= 2 * n
            && e.level.at(a.0, a.1).is_like(e.level.at(b.0, b.1))
            && e.surface.at(a.0, a.1).is_like(e.surface.at(b.0, b.1))
    }

    /// The evenness of the samples in the cell of a pixel. `None` if it is unknown.
    fn evenness(&self, pixel: usize) -> Option<Evenness> {
        self.pixels[pixel]?;
        let (mut pool, mut batches, mut all) = (Pool::default(), 0.0, 0.0);
        for (neighbour, own) in self.similar(pixel, EVENNESS) {
            let (x, y) = self.place(neighbour);
            pool.add(own.batches, f64::from(*self.evidence.mean.at(x, y)));
            batches += own.batches;
            all += own.all;
        }
        // Without variance there is nothing to correct.
        let rho = if batches == 0.0 { 0.0 } else { batches / all };
        let PixelNoise { mean, .. } = pool.noise();
        rho.is_finite().then_some(Evenness { rho, mean })
    }

    /// The parts that each pixel takes of the largest samples of others and of its own.
    fn shared(&self, evenness: &[Option<Evenness>]) -> Vec<f64> {
        let mut shared = vec![0.0; self.pixels.len()];
        let mut similar = Vec::with_capacity(self.pixels.len());
        for (pixel, (own, even)) in self.pixels.iter().zip(evenness).enumerate() {
            let (Some(own), Some(even)) = (own, even) else { continue };
            if own.largest <= 0.0 {
                continue;
            }
            for cell in CELLS {
                similar.clear();
                similar.extend(self.similar(pixel, cell));
                if similar
                    .iter()
                    .any(|&(neighbour, other)| neighbour != pixel && other.deviation() >= AS_LARGE * own.deviation())
                {
                    break;
                }
            }
            // With similar samples, the variances of the means differ by the numbers of samples.
            let parts: f64 = similar.iter().map(|(_, other)| other.count.recip()).sum();
            for (neighbour, other) in &similar {
                shared[*neighbour] += even.rho * own.largest / (other.count * parts);
            }
        }
        shared
    }

    /// The noise of its pixels, row by row.
    fn noise(&self) -> Vec<PixelNoise> {
        let evenness: Vec<_> = (0..self.pixels.len()).map(|pixel| self.evenness(pixel)).collect();
        let shared = self.shared(&evenness);
        let known = |i: usize, count| own(&self.pixels[i]?, &evenness[i]?, shared[i], count);
        let noise = |i| {
            let (x, y) = self.place(i);
            known(i, *self.evidence.counts.at(x, y)).unwrap_or_else(|| pixel(self.evidence, x, y))
        };
        (0..self.pixels.len()).map(noise).collect()
    }
}

/// The noise of a pixel with `count` samples. `None` if it is out of the range of f32.
fn own(own: &BatchVariances, even: &Evenness, shared: f64, count: u32) -> Option<PixelNoise> {
    let body = even.rho * (own.all - own.largest).max(0.0);
    let variance = (f64::from(count) * (body + shared)) as f32;
    variance.is_finite().then_some(PixelNoise { variance, mean: even.mean })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::variance::inputs::{PixelFeatures, SensorVarianceRange};
    use crate::variance::pooled::noise;
    use dunkelfeld_film::{Accumulate, PixelSums, Sample};

    const WIDTH: u32 = 32;

    /// Pseudo-random numbers.
    struct Random(u64);

    impl Random {
        fn unit(&mut self) -> f64 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    /// A film whose samples are drawn pixel by pixel, with the given number in each.
    fn film(
        count: impl Fn(u32, u32) -> u32,
        seed: u64,
        mut draw: impl FnMut(u32, u32, u32, &mut Random) -> f64,
    ) -> Plane<PixelSums> {
        let mut random = Random(seed << 32);
        Plane::from_fn(WIDTH, WIDTH, |x, y| {
            let mut sums = PixelSums::default();
            for index in 0..count(x, y) {
                let v = draw(x, y, index, &mut random) as f32;
                let mut sample = Sample::MISS;
                (sample.radiance.r, sample.radiance.g, sample.radiance.b) = (v, v, v);
                sums.add(index, &sample);
            }
            sums
        })
    }

    fn evidence_of(film: &Plane<PixelSums>) -> NoiseInputs {
        NoiseInputs {
            counts: film.map(PixelSums::count),
            mean: film.map(|p| p.mean()[0] as f32),
            variance: film.map(|p| p.variance_of_mean()[0] as f32),
            scatter: film.map(PixelSums::scatter),
            largest: film.map(PixelSums::max_luminance),
            surface: Plane::new(WIDTH, WIDTH, PixelFeatures::default()),
            level: Plane::new(WIDTH, WIDTH, SensorVarianceRange::ANY),
        }
    }

    fn total(noise: &Plane<PixelNoise>) -> f64 {
        noise.data().iter().map(|n| f64::from(n.variance)).sum()
    }

    #[test]
    fn noise_is_attributed_to_its_pixel() {
        // One pixel in 64 has a hundred times the variance of the others.
        let is_loud = |x: u32, y: u32| x % 8 == 3 && y % 8 == 3;
        let film = film(|_, _| 256, 1, |x, y, _, random| if is_loud(x, y) { 10.0 } else { 1.0 } * random.unit());
        let (evidence, quiet, loud) = (evidence_of(&film), 1.0 / 12.0, 100.0 / 12.0);
        let (own, pooled) = (pixel_noise(&evidence), noise(&evidence));
        // In the middle of the film each cell and each neighbourhood is complete.
        let ratio = |noise: &Plane<PixelNoise>, wanted: bool, truth: f64| {
            let places = (8..24).flat_map(|y| (8..24).map(move |x| (x, y))).filter(|&(x, y)| is_loud(x, y) == wanted);
            let (sum, count) =
                places.fold((0.0, 0.0), |(s, c), (x, y)| (s + f64::from(noise.at(x, y).variance), c + 1.0));
            sum / count / truth
        };
        // The batches of one loud pixel decide the ratio of a cell; it is averaged over four cells.
        for (wanted, truth) in [(false, quiet), (true, loud)] {
            let ratio = ratio(&own, wanted, truth);
            assert!((0.6..1.6).contains(&ratio), "loud {wanted}: {ratio}");
        }
        assert!(ratio(&pooled, false, quiet) > 1.5 && ratio(&pooled, true, loud) < 0.3, "pooled variances are smeared");
    }

    /// An image of one surface without noise except for some events, each with the whole noise of its pixel.
    fn events(width: u32, height: u32, events: &[(u32, u32, f64)]) -> NoiseInputs {
        let of = |x, y| events.iter().find(|e| (e.0, e.1) == (x, y)).map_or(0.0, |e| e.2);
        NoiseInputs {
            counts: Plane::new(width, height, 16),
            mean: Plane::new(width, height, 1.0),
            variance: Plane::from_fn(width, height, |x, y| of(x, y) as f32),
            scatter: Plane::from_fn(width, height, |x, y| Some(Scatter { all: of(x, y), largest: of(x, y) })),
            largest: Plane::new(width, height, 1.0),
            surface: Plane::new(width, height, PixelFeatures::default()),
            level: Plane::new(width, height, SensorVarianceRange::ANY),
        }
    }

    #[test]
    fn a_lone_event_is_shared_by_its_block() {
        let own = pixel_noise(&events(40, 40, &[(17, 30, 256.0)]));
        for y in 0..40 {
            for x in 0..40 {
                let inside = (16..32).contains(&x) && (16..32).contains(&y);
                // Sixteen samples of variance 256 in one of 256 pixels.
                assert_eq!(own.at(x, y).variance, if inside { 16.0 } else { 0.0 }, "{x} {y}");
            }
        }
    }

    #[test]
    fn a_repeated_event_is_shared_in_the_smallest_cell_that_contains_both() {
        // Two equal events in one cell of 4 x 4, a third in the same cell of 8 x 8, a larger one in the next cell.
        let own = pixel_noise(&events(16, 16, &[(0, 0, 1.0), (3, 3, 1.0), (5, 5, 1.0), (8, 8, 16.0)]));
        let at = |x, y| f64::from(own.at(x, y).variance) / 16.0;
        let (small, middle, all) = (2.0 / 16.0, 1.0 / 64.0, 16.0 / 256.0);
        for (x, y, wanted) in [(1, 2, small + middle + all), (4, 4, middle + all), (9, 9, all), (15, 0, all)] {
            assert!((at(x, y) - wanted).abs() < 1e-6, "{x} {y}: {} {wanted}", at(x, y));
        }
    }

    #[test]
    fn rounding_does_not_separate_equal_events() {
        let own = pixel_noise(&events(16, 16, &[(0, 0, 1.0), (3, 3, 1.0 + 1e-7)]));
        let (inside, outside) = (f64::from(own.at(1, 1).variance), own.at(4, 4).variance);
        assert!((inside - 2.0).abs() < 1e-6 && outside == 0.0, "{inside} {outside}");
    }

    #[test]
    fn only_similar_pixels_share_events() {
        let mut evidence = events(16, 16, &[(2, 2, 1.0)]);
        evidence.surface =
            Plane::from_fn(16, 16, |x, _| PixelFeatures { object: u32::from(x >= 5), ..PixelFeatures::default() });
        evidence.counts = Plane::from_fn(16, 16, |_, y| if y < 8 { 16 } else { 33 });
        evidence.scatter.data_mut()[3] = None;
        let own = pixel_noise(&evidence);
        // Five columns of eight rows. One pixel has no data.
        let share = 16.0 / 39.0;
        for y in 0..16 {
            for x in 0..16 {
                let wanted = if (x, y) == (3, 0) { None } else { Some(if x < 5 && y < 8 { share } else { 0.0 }) };
                let variance = own.at(x, y).variance;
                assert!(wanted.is_none_or(|w| (variance - w).abs() < 1e-6), "{x} {y}: {variance}");
            }
        }
    }

    #[test]
    fn single_events_are_shared_by_the_block() {
        // One sample in 4096 is lit: with 64 samples per pixel, one pixel in 64 has one.
        let (p, n) = (1.0 / 4096.0, 64);
        let mut sum = 0.0;
        for seed in 0..20 {
            let film = film(|_, _| n, seed, |_, _, _, random| f64::from(u8::from(random.unit() < p)));
            let own = pixel_noise(&evidence_of(&film));
            let dark = own.data().iter().zip(film.data()).filter(|(_, p)| p.max_luminance() == 0.0);
            let (total, count) =
                dark.fold((0.0, 0.0), |(sum, count), (o, _)| (sum + f64::from(o.variance), count + 1.0));
            sum += total / count;
        }
        // The dark pixels have no variance of their own.
        let mean = sum / 20.0 / p;
        assert!((0.7..1.3).contains(&mean), "{mean}");
    }

    /// Certified over true variance if one sample in `lit` is lit. The mean over the even rows of an image and that
    /// over the odd ones, which have their own numbers of samples.
    fn certified_by_row(lit: u32, counts: [u32; 2]) -> [f64; 2] {
        const SEEDS: u32 = 12;
        let (p, mut sums) = (f64::from(lit).recip(), [0.0; 2]);
        for seed in 0..SEEDS {
            let film = film(|_, y| counts[y as usize % 2], seed.into(), |_, _, _, r| f64::from(u8::from(r.unit() < p)));
            for (i, noise) in pixel_noise(&evidence_of(&film)).data().iter().enumerate() {
                sums[i / WIDTH as usize % 2] += f64::from(noise.variance) / (p * (1.0 - p));
            }
        }
        sums.map(|sum| sum / f64::from(SEEDS * WIDTH * WIDTH / 2))
    }

    #[test]
    fn pixels_with_sixteen_times_as_many_samples_do_not_share() {
        for ratio in certified_by_row(64, [16, 256]) {
            assert!((0.9..1.1).contains(&ratio), "{ratio}");
        }
    }

    /// Pixels with twice as many samples share events, and the mean of more samples has less noise.
    #[test]
    fn pixels_with_twice_as_many_samples_share_in_proportion() {
        for ratio in certified_by_row(512, [32, 64]) {
            // Some thousand events have a standard error of 3 %.
            assert!((0.85..1.15).contains(&ratio), "{ratio}");
        }
    }

    #[test]
    fn it_is_right_on_average_for_independent_and_for_even_samples() {
        // Independent samples, and samples of which each batch has one from every part of the range.
        let n = 64;
        for (even, truth) in [(false, 1.0 / 12.0), (true, 1.0 / 12.0 / 256.0)] {
            let film = film(
                |_, _| n,
                5,
                |_, _, index, random| {
                    let stratum = f64::from(index / 4) / 16.0;
                    if even { stratum + random.unit() / 16.0 } else { random.unit() }
                },
            );
            let own = pixel_noise(&evidence_of(&film));
            let mean = total(&own) / f64::from(WIDTH * WIDTH) / truth;
            // 1024 variances with three degrees of freedom have a standard error of 2.6 %.
            assert!((mean - 1.0).abs() < 0.13, "even {even}: {mean}");
            let off = own.data().iter().map(|o| (f64::from(o.variance) / truth - 1.0).powi(2)).sum::<f64>();
            let rms = (off / f64::from(WIDTH * WIDTH)).sqrt();
            assert!(rms < 0.35, "a variance by batches alone is off by 0.82: {rms}");
        }
    }

    #[test]
    fn variances_of_a_block_add_up_to_those_of_its_batches() {
        let film = film(|_, _| 32, 9, |x, y, _, random| f64::from(x * y + 1) * random.unit().powi(4));
        // Incomplete blocks at the edge of the image, and a surface that ends in a block.
        let crop = |plane: &Plane<f32>| Plane::from_fn(27, 22, |x, y| *plane.at(x, y));
        let whole = evidence_of(&film);
        let evidence = NoiseInputs {
            // The same means with fewer samples, or with more.
            counts: Plane::from_fn(27, 22, |x, y| 32 + 16 * ((x + y) % 3)),
            mean: crop(&whole.mean),
            variance: crop(&whole.variance),
            scatter: Plane::from_fn(27, 22, |x, y| *whole.scatter.at(x, y)),
            largest: crop(&whole.largest),
            surface: Plane::from_fn(27, 22, |x, _| PixelFeatures {
                object: u32::from(x > 20),
                ..PixelFeatures::default()
            }),
            level: Plane::new(27, 22, SensorVarianceRange::ANY),
        };
        let own = pixel_noise(&evidence);
        for (left, top) in [(0, 0), (16, 0), (0, 16), (16, 16)] {
            let (columns, rows) = (left..(left + 16).min(27), top..(top + 16).min(22));
            let places = || rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y)));
            let by_own: f64 = places().map(|(x, y)| f64::from(own.at(x, y).of_mean(*evidence.counts.at(x, y)))).sum();
            let by_batches: f64 = places().map(|(x, y)| f64::from(*evidence.variance.at(x, y))).sum();
            assert!((by_own / by_batches - 1.0).abs() < 1e-5, "{left} {top}: {by_own} {by_batches}");
        }
    }

    #[test]
    fn neighbourhoods_are_used_where_scatter_is_unknown() {
        let film = film(|_, _| 16, 3, |_, _, _, random| random.unit());
        let mut evidence = evidence_of(&film);
        evidence.scatter = Plane::new(WIDTH, WIDTH, None);
        assert_eq!(pixel_noise(&evidence), noise(&evidence));
        // Black pixels have no noise, as by batches.
        let black = evidence_of(&self::film(|_, _| 16, 3, |_, _, _, _| 0.0));
        assert!(pixel_noise(&black).data().iter().all(|n| n.variance == 0.0));
        // With one sample per pixel the noise is unknown.
        let one = evidence_of(&self::film(|_, _| 1, 3, |_, _, _, random| random.unit()));
        assert!(pixel_noise(&one).data().iter().all(|n| *n == PixelNoise::UNKNOWN));
    }
}
