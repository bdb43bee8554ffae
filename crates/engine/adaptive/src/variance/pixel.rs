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
use crate::variance::pooled::{PixelNoise, pooled_pixel};
use crate::variance::similarity::{SIDE, SLOTS, Similarity, cell, slot};

/// Side of a block \[pixels\]. If the scatter of its samples is known, the certified variance of a pixel depends on its
/// block alone.
pub const BLOCK: u32 = SIDE;

/// Sides of the cells whose pixels may share a sample: the first cell with another sample as large, or the last.
const CELLS: [u32; 3] = [4, 8, BLOCK];

/// Least ratio of two deviations that count as equally large. So the rounding of single precision does not decide which
/// pixels share.
const AS_LARGE: f64 = 1.0 - 1e-5;

/// Side of the cells for the evenness: the variance of the samples over that of independent ones. 64 pixels give it to a
/// tenth.
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
        let of_block = Block::new(evidence, left, top).noise();
        for (y, row) in (0..height).zip(noise.chunks_mut(width as usize)) {
            let row = row.iter_mut().skip(left as usize).take(BLOCK as usize);
            for (x, noise) in (0..).zip(row) {
                *noise = of_block[slot(x, y)].unwrap_or_else(|| pooled_pixel(evidence, left + x, top + y));
            }
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

/// Evenness of the samples of a cell: their variance by batches over that of independent ones, and the mean of
/// the cell.
#[derive(Clone, Copy)]
struct Evenness {
    rho: f64,
    mean: f32,
}

/// The pixels of a block, by slots. A pixel is known if both the scatter of its samples and its variance by batches are.
/// The numbers of the others are 0.
struct Block {
    similarity: Similarity,
    known: [bool; SLOTS],
    /// Number of samples, and its reciprocal.
    count: [f64; SLOTS],
    per_sample: [f64; SLOTS],
    mean: [f64; SLOTS],
    /// Variance of the mean from the spread of batches.
    batches: [f64; SLOTS],
    /// Variance of the mean as of independent samples: all of it, and the part of the largest sample.
    all: [f64; SLOTS],
    largest: [f64; SLOTS],
    /// Squared distance of the largest sample from the mean. It does not depend on the number of the other samples.
    deviation: [f64; SLOTS],
}

impl Block {
    fn new(evidence: &NoiseInputs, left: u32, top: u32) -> Self {
        let zero = [0.0; SLOTS];
        let mut block = Self {
            similarity: Similarity::new(),
            known: [false; SLOTS],
            count: zero,
            per_sample: zero,
            mean: zero,
            batches: zero,
            all: zero,
            largest: zero,
            deviation: zero,
        };
        let (width, height) = ((evidence.width() - left).min(BLOCK), (evidence.height() - top).min(BLOCK));
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            block.set(slot(x, y), evidence, left + x, top + y);
        }
        block
    }

    fn set(&mut self, slot: usize, evidence: &NoiseInputs, x: u32, y: u32) {
        let (batches, Some(Scatter { all, largest })) =
            (f64::from(*evidence.variance.at(x, y)), *evidence.scatter.at(x, y))
        else {
            return;
        };
        if !(batches.is_finite() && all.is_finite() && largest.is_finite() && largest >= 0.0) {
            return;
        }
        let count = f64::from(*evidence.counts.at(x, y));
        self.similarity.set(slot, evidence, x, y);
        self.known[slot] = true;
        (self.count[slot], self.per_sample[slot]) = (count, count.recip());
        self.mean[slot] = f64::from(*evidence.mean.at(x, y));
        (self.batches[slot], self.all[slot], self.largest[slot]) = (batches, all, largest);
        self.deviation[slot] = count * count * largest;
    }

    fn known(&self, cell: std::ops::Range<usize>) -> impl Iterator<Item = usize> {
        cell.filter(|&slot| self.known[slot])
    }

    /// The evenness of the samples of pixels that share their estimates with these weights. `None` if it is unknown.
    fn evenness_of(&self, cell: std::ops::Range<usize>, weight: impl Fn(usize) -> f64) -> Option<Evenness> {
        let (mut pixels, mut means, mut batches, mut all) = (0.0, 0.0, 0.0, 0.0);
        for slot in cell {
            let weight = weight(slot);
            pixels += weight;
            means += weight * self.mean[slot];
            batches += weight * self.batches[slot];
            all += weight * self.all[slot];
        }
        // Without variance there is nothing to correct.
        let rho = if batches == 0.0 { 0.0 } else { batches / all };
        rho.is_finite().then_some(Evenness { rho, mean: (means / pixels) as f32 })
    }

    /// The evenness of the samples in the cell of each pixel. `None` if it is unknown.
    fn evenness(&self) -> [Option<Evenness>; SLOTS] {
        let mut evenness = [None; SLOTS];
        let mut weights = [0.0; SLOTS];
        for start in (0..SLOTS).step_by((EVENNESS * EVENNESS) as usize) {
            let cell = cell(start, EVENNESS);
            if self.similarity.is_uniform(cell.clone()) {
                let of_cell = self.evenness_of(cell.clone(), |slot| f64::from(u8::from(self.known[slot])));
                self.known(cell).for_each(|slot| evenness[slot] = of_cell);
                continue;
            }
            for pixel in self.known(cell.clone()) {
                self.similarity.weigh(pixel, cell.clone(), &mut weights);
                evenness[pixel] = self.evenness_of(cell.clone(), |slot| f64::from(weights[slot]));
            }
        }
        evenness
    }

    /// The parts that each pixel takes of the largest samples of others and of its own.
    fn shared(&self, evenness: &[Option<Evenness>; SLOTS]) -> [f64; SLOTS] {
        let mut shared = [0.0; SLOTS];
        let uniform = CELLS.map(|side| UniformCells::new(self, side));
        // What all pixels of a uniform cell share, times their numbers of samples.
        let mut of_cells = CELLS.map(|_| [0.0; SLOTS]);
        let mut weights = [0.0; SLOTS];
        for pixel in self.known(0..SLOTS) {
            let Some(even) = evenness[pixel] else { continue };
            if self.largest[pixel] <= 0.0 {
                continue;
            }
            let mut is_weighed = false;
            for (i, side) in CELLS.into_iter().enumerate() {
                let (cell, is_last) = (cell(pixel, side), side == BLOCK);
                let as_large = AS_LARGE * self.deviation[pixel];
                let part = even.rho * self.largest[pixel];
                if let Some(of_cell) = uniform[i].at(pixel) {
                    if is_last || of_cell.largest_beside(pixel) >= as_large {
                        of_cells[i][cell.start] += part / of_cell.per_sample;
                        break;
                    }
                    continue;
                }
                if !is_weighed {
                    self.similarity.weigh(pixel, 0..SLOTS, &mut weights);
                    is_weighed = true;
                }
                let weights = &weights[cell.clone()];
                let mut others = weights.iter().zip(&self.deviation[cell.clone()]).zip(cell.clone());
                if !is_last && !others.any(|((&w, &d), slot)| w > 0.0 && slot != pixel && d >= as_large) {
                    continue;
                }
                // With similar samples, the variances of the means differ by the numbers of samples.
                let per_sample = &self.per_sample[cell.clone()];
                let parts: f64 = weights.iter().zip(per_sample).map(|(&w, r)| f64::from(w) * r).sum();
                let share = part / parts;
                let shared = shared[cell].iter_mut().zip(weights).zip(per_sample);
                shared.for_each(|((shared, &w), r)| *shared += share * f64::from(w) * r);
                break;
            }
        }
        for (side, of_cells) in CELLS.into_iter().zip(&of_cells) {
            for pixel in self.known(0..SLOTS) {
                shared[pixel] += of_cells[cell(pixel, side).start] * self.per_sample[pixel];
            }
        }
        shared
    }

    /// The noise of its pixels, by slots. `None` if it is unknown, or out of the range of f32.
    fn noise(&self) -> [Option<PixelNoise>; SLOTS] {
        let evenness = self.evenness();
        let shared = self.shared(&evenness);
        std::array::from_fn(|slot| {
            let Evenness { rho, mean } = evenness[slot]?;
            let body = rho * (self.all[slot] - self.largest[slot]).max(0.0);
            let variance = (self.count[slot] * (body + shared[slot])) as f32;
            variance.is_finite().then_some(PixelNoise { variance, mean })
        })
    }
}

/// The cells of one size of a block, as far as all of their pixels may share.
struct UniformCells {
    side: u32,
    cells: Vec<Option<UniformCell>>,
}

/// A cell whose pixels may share.
struct UniformCell {
    /// Sum of the reciprocal numbers of samples.
    per_sample: f64,
    /// The pixel with the largest deviation, that deviation, and the next one.
    first: usize,
    largest: f64,
    second: f64,
}

impl UniformCells {
    fn new(block: &Block, side: u32) -> Self {
        let of_cell = |start: usize| {
            let cell = cell(start, side);
            block.similarity.is_uniform(cell.clone()).then(|| {
                let mut of_cell = UniformCell { per_sample: 0.0, first: SLOTS, largest: -1.0, second: -1.0 };
                for slot in block.known(cell) {
                    of_cell.per_sample += block.per_sample[slot];
                    let deviation = block.deviation[slot];
                    if deviation > of_cell.largest {
                        (of_cell.first, of_cell.second) = (slot, of_cell.largest);
                        of_cell.largest = deviation;
                    } else {
                        of_cell.second = of_cell.second.max(deviation);
                    }
                }
                of_cell
            })
        };
        Self { side, cells: (0..SLOTS).step_by((side * side) as usize).map(of_cell).collect() }
    }

    fn at(&self, slot: usize) -> Option<&UniformCell> {
        self.cells[slot / (self.side * self.side) as usize].as_ref()
    }
}

impl UniformCell {
    /// The largest deviation of the other pixels.
    fn largest_beside(&self, pixel: usize) -> f64 {
        if pixel == self.first { self.second } else { self.largest }
    }
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
