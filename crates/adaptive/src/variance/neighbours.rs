//! The noise of a pixel as predicted from its neighbours. Plans are made from it.
//!
//! If the samples of a pixel decide how many more it gets, its mean is biased ([`crate`]). So the prediction uses its
//! neighbours alone, near ones and far ones. If light is rare, a short pilot has sampled it in few pixels, and the
//! estimates of the near neighbours rest on few events. These estimates are shrunk towards those of wider
//! neighbourhoods (conjugate prior: Lindley and Smith 1972). The shrinkage is stronger for fewer events. The number of
//! events is the observed one, or the one that the neighbourhood would have if it were like the wider one. With many
//! events, the near neighbours determine the prediction alone.
//!
//! The averaged quantity is v / s, the variance of a sample over the tolerated variance of its pixel. The average is
//! the root mean square. An image waits for the pixels whose required samples were underestimated, so larger values
//! among different neighbours have more weight. The squares of the samples give v with a much lower error than the
//! spread of four batches. The squares overestimate the noise of quasi-random samples by a factor, which the many
//! batches of wider neighbourhoods determine.

use dunkelfeld_film::Plane;
use dunkelfeld_lanes::{InstructionSet, dispatch};

use crate::required_samples::SensorNoise;
use crate::variance::inputs::NoiseInputs;

/// Neighbourhoods, the near one first: standard deviation of a Gaussian, and its reach, in pixels. The near one uses
/// pixels of the same object. The wide one uses pixels of the same object, or all pixels.
const SCALES: [(f64, u32); 2] = [(2.0, 4), (4.0, REACH)];
const REACH: u32 = 8;
/// Distances along an axis.
const DISTANCES: usize = REACH as usize + 1;
/// Weight of the estimate of the wider neighbourhood \[events\].
const PRIOR: f64 = 8.0;
/// Upper bound of the number of events. From it on the uncertainty is negligible.
const MAX_EVENTS: f64 = 1e9;

/// Pixels of a row that are predicted together.
const LANES: usize = 8;
type Lane = [f64; LANES];

/// Noise of the pixels of an image for the predictions of their neighbours: variances of one sample over the tolerated
/// variance. The tolerated variance is that of the sensor at the mean of the pixel. Without a sensor it is one everywhere.
pub struct NeighbourNoise {
    width: usize,
    height: usize,
    /// Values per row. There is a margin of unknown pixels, of [`REACH`] or more, on all sides.
    stride: usize,
    /// 1 where the noise of the pixel is known, otherwise 0.
    known: Vec<f64>,
    /// Variance under the assumption of independent samples. Like the next two, 0 if it is unknown, and if the pixel is
    /// saturated beyond doubt.
    all: Vec<f64>,
    /// The part of `all` that comes from the largest sample.
    largest: Vec<f64>,
    /// Variance from the spread of the batches.
    batches: Vec<f64>,
    /// The object of the pixel.
    object: Vec<f64>,
    /// Is the pixel saturated beyond doubt? `None` outside the image.
    saturated: Vec<Option<bool>>,
}

/// Predicted noise of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PredictedNoise {
    /// Variance of one sample over the tolerated variance. Infinite if no neighbour has a variance, 0 if the pixel is
    /// saturated.
    pub ratio: f32,
    /// The adjacent pixels are all saturated beyond doubt.
    pub saturated: bool,
}

impl PredictedNoise {
    /// No neighbour has a variance.
    pub const UNKNOWN: Self = Self { ratio: f32::INFINITY, saturated: false };
}

/// The predicted noise of all pixels.
pub fn expected(evidence: &NoiseInputs, sensor: Option<SensorNoise>) -> Plane<PredictedNoise> {
    let neighbours = NeighbourNoise::new(evidence, sensor);
    let rows = (0..evidence.height()).flat_map(|y| neighbours.predicted_row(y)).collect();
    Plane::of_pixels(evidence.width(), evidence.height(), rows)
}

impl NeighbourNoise {
    /// The noise of each pixel.
    ///
    /// # Panics
    /// If the planes differ in size.
    pub fn new(evidence: &NoiseInputs, sensor: Option<SensorNoise>) -> Self {
        assert!(evidence.is_consistent(), "planes differ in size");
        let (width, height) = (evidence.width() as usize, evidence.height() as usize);
        let stride = width.next_multiple_of(LANES) + 2 * REACH as usize;
        let size = stride * (height + 2 * REACH as usize);
        let zeros = || vec![0.0; size];
        let mut out = Self {
            width,
            height,
            stride,
            known: zeros(),
            all: zeros(),
            largest: zeros(),
            batches: zeros(),
            object: zeros(),
            saturated: vec![None; size],
        };
        for (x, y) in (0..evidence.height()).flat_map(|y| (0..evidence.width()).map(move |x| (x, y))) {
            let at = out.index(x as usize, y as usize);
            out.object[at] = evidence.surface.at(x, y).object.into();
            out.saturated[at] = Some(false);
            let (n, variance) = (f64::from(*evidence.counts.at(x, y)), *evidence.variance.at(x, y));
            if !variance.is_finite() {
                continue;
            }
            out.known[at] = 1.0;
            let (mean, variance) = (f64::from(*evidence.mean.at(x, y)), f64::from(variance));
            if sensor.is_some_and(|s| s.is_saturated(mean, variance)) {
                out.saturated[at] = Some(true);
                continue;
            }
            let over = n / sensor.map_or(1.0, |s| s.variance(mean));
            // Without data of single samples, all variance may come from one sample.
            let (all, largest) = evidence.scatter.at(x, y).map_or((variance, variance), |s| (s.all, s.largest));
            let value = |v: f64| f64::from((over * v).min(f64::from(f32::MAX)) as f32);
            (out.all[at], out.largest[at], out.batches[at]) = (value(all), value(largest), value(variance));
        }
        out
    }

    /// The place of a pixel in the columns.
    #[inline(always)]
    fn index(&self, x: usize, y: usize) -> usize {
        (y + REACH as usize) * self.stride + x + REACH as usize
    }

    /// The predicted noise of the pixels of one row. Rows are independent of each other.
    ///
    /// # Panics
    /// If the row is outside the image.
    pub fn predicted_row(&self, y: u32) -> Vec<PredictedNoise> {
        self.predicted_row_by(InstructionSet::best(), y as usize)
    }

    fn predicted_row_by(&self, set: InstructionSet, y: usize) -> Vec<PredictedNoise> {
        assert!(y < self.height, "row {y} is outside the image");
        let weights = Weights::new();
        let mut row = Vec::with_capacity(self.width);
        for x in (0..self.width).step_by(LANES) {
            let sums = dispatch!(set, _F, _token => self.sums(&weights, x, y));
            let lanes = LANES.min(self.width - x);
            row.extend((0..lanes).map(|lane| self.predicted(sums.each_ref().map(|sums| sums.lane(lane)), x + lane, y)));
        }
        row
    }

    /// Sums over the neighbourhoods of some pixels of a row: near ones of the same object, wide ones of the same object, wide
    /// ones of all. The sums of each pixel have the order of its neighbours, row by row.
    #[inline(always)]
    fn sums(&self, weights: &Weights, x: usize, y: usize) -> [Sums<Lane>; 3] {
        let (mut near, mut alike, mut anything) = (Sums::default(), Sums::default(), Sums::default());
        let own = lanes(&self.object, self.index(x, y));
        for row in 0..=2 * REACH as usize {
            for column in 0..=2 * REACH as usize {
                let (dx, dy) = (column.abs_diff(REACH as usize), row.abs_diff(REACH as usize));
                if (dx, dy) == (0, 0) {
                    continue;
                }
                let at = (y + row) * self.stride + x + column;
                let noise = [lanes(&self.all, at), lanes(&self.largest, at), lanes(&self.batches, at)];
                let (known, object) = (lanes(&self.known, at), lanes(&self.object, at));
                let [near_weight, weight] = [weights.0[0][dy][dx], weights.0[1][dy][dx]];
                let mut of_all = [0.0; LANES];
                let mut of_object = [0.0; LANES];
                for i in 0..LANES {
                    of_all[i] = weight * known[i];
                    of_object[i] = if object[i] == own[i] { of_all[i] } else { 0.0 };
                }
                anything.add(noise, of_all);
                alike.add(noise, of_object);
                if near_weight > 0.0 {
                    for i in 0..LANES {
                        of_object[i] = if object[i] == own[i] { near_weight * known[i] } else { 0.0 };
                    }
                    near.add(noise, of_object);
                }
            }
        }
        [near, alike, anything]
    }

    /// The prediction of a pixel from the sums over its neighbourhoods.
    fn predicted(&self, [near, alike, anything]: [Sums; 3], x: usize, y: usize) -> PredictedNoise {
        let rows = [y + REACH as usize - 1, y + REACH as usize, y + REACH as usize + 1];
        let adjacent = rows.into_iter().flat_map(|row| {
            let left = row * self.stride + x + REACH as usize - 1;
            (left..left + 3).filter(|&at| at != self.index(x, y)).filter_map(|at| self.saturated[at])
        });
        // Are there adjacent pixels, and are all of them saturated?
        if adjacent.clone().all(|is_saturated| is_saturated) && adjacent.count() > 0 {
            return PredictedNoise { ratio: 0.0, saturated: true };
        }
        if anything.weight == 0.0 {
            return PredictedNoise::UNKNOWN;
        }
        // A neighbourhood without events is informative, too, if many events were to be expected in it.
        let events_per_pixel = anything.events() / anything.pixels();
        let narrowed =
            |wider: f64, sums: &Sums| shrunk(sums.mean(), sums.events().max(events_per_pixel * sums.pixels()), wider);
        let independent = [&alike, &near].into_iter().fold(anything.mean(), narrowed);
        let evenness = shrunk(alike.by_batches(), alike.events(), anything.by_batches());
        PredictedNoise { ratio: (independent * evenness).min(f64::from(f32::MAX)) as f32, saturated: false }
    }
}

/// The values of the pixels from a place on.
#[inline(always)]
fn lanes(values: &[f64], at: usize) -> Lane {
    let mut lanes = [0.0; LANES];
    lanes.copy_from_slice(&values[at..at + LANES]);
    lanes
}

/// The weighted mean of a value that rests on `events` events and of that of the wider neighbourhood.
fn shrunk(value: f64, events: f64, wider: f64) -> f64 {
    (events * value + PRIOR * wider) / (events + PRIOR)
}

/// Weights by distance along either axis, for each of the scales. Zero beyond their reach.
struct Weights([[[f64; DISTANCES]; DISTANCES]; 2]);

impl Weights {
    fn new() -> Self {
        Self(SCALES.map(|(deviation, reach)| {
            let along = |d: usize| if d > reach as usize { 0.0 } else { (-0.5 * (d as f64 / deviation).powi(2)).exp() };
            std::array::from_fn(|dy| std::array::from_fn(|dx| along(dx) * along(dy)))
        }))
    }
}

/// Weighted sums over a neighbourhood.
#[derive(Default)]
struct Sums<F = f64> {
    weight: F,
    weights_squared: F,
    all: F,
    squares: F,
    /// Estimated variance of the weighted sum `all`, if no event contributes more than the largest of its pixel.
    scatter: F,
    batches: F,
}

impl Sums<Lane> {
    #[inline(always)]
    fn add(&mut self, [all, largest, batches]: [Lane; 3], weight: Lane) {
        for i in 0..LANES {
            let weighted = weight[i] * all[i];
            self.weight[i] += weight[i];
            self.weights_squared[i] += weight[i] * weight[i];
            self.all[i] += weighted;
            self.squares[i] += weighted * all[i];
            self.scatter[i] += weight[i] * weight[i] * all[i] * largest[i];
            self.batches[i] += weight[i] * batches[i];
        }
    }

    /// The sums of one pixel.
    fn lane(&self, i: usize) -> Sums {
        Sums {
            weight: self.weight[i],
            weights_squared: self.weights_squared[i],
            all: self.all[i],
            squares: self.squares[i],
            scatter: self.scatter[i],
            batches: self.batches[i],
        }
    }
}

impl Sums {
    /// Number of pixels of equal weight with the same variance of the mean (Kish 1965).
    fn pixels(&self) -> f64 {
        if self.weight > 0.0 { self.weight * self.weight / self.weights_squared } else { 0.0 }
    }

    /// The root mean square.
    fn mean(&self) -> f64 {
        if self.weight > 0.0 { (self.squares / self.weight).sqrt() } else { 0.0 }
    }

    /// Effective number of events, as a lower bound: this number of equal events has the same relative variance.
    fn events(&self) -> f64 {
        if self.all > 0.0 { (self.all * (self.all / self.scatter)).min(MAX_EVENTS) } else { 0.0 }
    }

    /// The variance from batches over that of independent samples.
    fn by_batches(&self) -> f64 {
        if self.all > 0.0 { self.batches / self.all } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::variance::inputs::{PixelFeatures, SensorVarianceRange};
    use dunkelfeld_film::Scatter;

    const SIDE: u32 = 40;

    /// Sixteen samples per pixel with many events in each, without signal. The variances of single samples come from
    /// their squares. Those from batches are a quarter of them.
    fn image(mut variance: impl FnMut(u32, u32) -> f64) -> NoiseInputs {
        let scatter = Plane::from_fn(SIDE, SIDE, |x, y| {
            let all = variance(x, y) / 16.0;
            Some(Scatter { all, largest: all / 1000.0 })
        });
        NoiseInputs {
            counts: Plane::new(SIDE, SIDE, 16),
            mean: Plane::new(SIDE, SIDE, 0.0),
            variance: scatter.map(|s| s.map_or(0.0, |s| 0.25 * s.all as f32)),
            scatter,
            largest: Plane::new(SIDE, SIDE, 0.0),
            surface: Plane::new(SIDE, SIDE, PixelFeatures::default()),
            level: Plane::new(SIDE, SIDE, SensorVarianceRange::ANY),
        }
    }

    fn ratio(evidence: &NoiseInputs, x: u32, y: u32) -> f32 {
        expected(evidence, None).at(x, y).ratio
    }

    #[test]
    fn all_instruction_sets_have_the_same_bits() {
        let mut evidence = image(|x, y| f64::from((7 * x + 31 * y) % 17).exp());
        evidence.surface =
            Plane::from_fn(SIDE, SIDE, |x, y| PixelFeatures { object: (x / 9 + y / 7) % 3, ..Default::default() });
        let neighbours = NeighbourNoise::new(&evidence, None);
        for y in 0..SIDE as usize {
            let scalar = neighbours.predicted_row_by(InstructionSet::Scalar, y);
            InstructionSet::all()
                .into_iter()
                .for_each(|set| assert_eq!(neighbours.predicted_row_by(set, y), scalar, "{set:?}"));
        }
    }

    #[test]
    fn where_all_agree_that_is_expected_as_batches_have_it() {
        let expected = expected(&image(|_, _| 12.0), None);
        assert!(expected.data().iter().all(|e| (e.ratio - 3.0).abs() < 1e-4 && !e.saturated));
    }

    #[test]
    fn the_prediction_of_a_pixel_does_not_use_its_own_samples() {
        let of = |own: f64| image(|x, y| if (x, y) == (20, 20) { own } else { f64::from(1 + (7 * x + 3 * y) % 5) });
        let before = ratio(&of(1.0), 20, 20);
        for own in [0.0, 3.0, 1e12, 1e30] {
            let mut evidence = of(own);
            evidence.mean.data_mut()[(20 * SIDE + 20) as usize] = own as f32;
            assert_eq!(ratio(&evidence, 20, 20), before, "{own}");
            assert!(own < 5.0 || ratio(&evidence, 21, 20) > before);
        }
    }

    #[test]
    fn neighbours_with_many_events_use_their_own_samples() {
        let halves = image(|x, _| if x < 20 { 1.0 } else { 100.0 });
        assert!((ratio(&halves, 14, 20) / 0.25 - 1.0).abs() < 0.05, "{}", ratio(&halves, 14, 20));
        assert!((ratio(&halves, 25, 20) / 25.0 - 1.0).abs() < 0.05, "{}", ratio(&halves, 25, 20));
    }

    #[test]
    fn one_event_is_taken_for_its_surroundings() {
        // One pixel has one event, which is all its noise. The other pixels have none.
        let mut evidence = image(|x, y| if (x, y) == (20, 20) { 1e4 } else { 0.0 });
        evidence.scatter.data_mut()[(20 * SIDE + 20) as usize] = Some(Scatter { all: 625.0, largest: 625.0 });
        evidence.variance.data_mut()[(20 * SIDE + 20) as usize] = 625.0;
        let at = |x| ratio(&evidence, x, 20);
        // Root mean square over the widest neighbourhood: 1e4 / sqrt(2 pi 16) at its centre.
        let widest = 1e4 / (2.0 * std::f32::consts::PI * 16.0).sqrt();
        assert!(at(21) > widest && at(21) < 2.0 * widest, "{}", at(21));
        assert!(at(25) > 0.2 * widest && at(25) < widest, "{}", at(25));
        assert_eq!(at(29), 0.0, "out of reach");
    }

    #[test]
    fn other_objects_are_used_only_without_pixels_of_the_same_object() {
        let mut evidence = image(|x, _| if x < 20 { 1.0 } else { 400.0 });
        evidence.surface =
            Plane::from_fn(SIDE, SIDE, |x, _| PixelFeatures { object: u32::from(x >= 20), ..PixelFeatures::default() });
        assert!((ratio(&evidence, 19, 20) / 0.25 - 1.0).abs() < 0.05, "{}", ratio(&evidence, 19, 20));
        // A pixel whose object has no other pixel uses all pixels around it.
        evidence.surface.data_mut()[(20 * SIDE + 5) as usize] =
            PixelFeatures { object: 99, ..PixelFeatures::default() };
        assert!((ratio(&evidence, 5, 20) / 0.25 - 1.0).abs() < 1e-4);
    }

    #[test]
    fn noise_is_compared_with_that_of_the_sensor_and_saturated_pixels_are_excluded() {
        let sensor = SensorNoise { floor: 10.0, saturation: 1000.0 };
        let mut evidence = image(|x, _| if x < 20 { 40.0 } else { 400.0 });
        evidence.mean = Plane::from_fn(SIDE, SIDE, |x, _| if x < 20 { 0.0 } else { 90.0 });
        let all = expected(&evidence, Some(sensor));
        assert!(
            all.data().iter().all(|e| (e.ratio - 1.0).abs() < 1e-4),
            "40 over 10 and 400 over 100, in batches a quarter"
        );
        // A bright square and a single saturated pixel, with noise far above that of the others.
        let is_full = |x: u32, y: u32| (10..16).contains(&x) && (10..16).contains(&y) || (x, y) == (30, 30);
        let at = |x: u32, y: u32| (y * SIDE + x) as usize;
        for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))).filter(|&(x, y)| is_full(x, y)) {
            evidence.mean.data_mut()[at(x, y)] = 1e6;
            evidence.scatter.data_mut()[at(x, y)] = Some(Scatter { all: 1e9, largest: 1e9 });
        }
        let some = expected(&evidence, Some(sensor));
        for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
            let inside = (11..15).contains(&x) && (11..15).contains(&y);
            let expected = some.at(x, y);
            assert_eq!(expected.saturated, inside, "{x}, {y}");
            assert!(
                if inside { expected.ratio == 0.0 } else { expected.ratio > 0.3 && expected.ratio < 1.0001 },
                "{x}, {y}: {expected:?}"
            );
        }
        assert!((some.at(30, 5).ratio - 1.0).abs() < 1e-4 && some.at(30, 31).ratio > 0.9);
        // One uncertain pixel in a saturated image does not send samples to the pixels around it.
        evidence.mean = Plane::from_fn(SIDE, SIDE, |x, y| if (x, y) == (20, 20) { 90.0 } else { 1e6 });
        let doubt = expected(&evidence, Some(sensor));
        assert!(doubt.at(20, 20).saturated && doubt.at(21, 20).ratio < 0.4 && doubt.at(23, 20).ratio < 0.1);
    }

    #[test]
    fn neighbours_without_events_where_many_were_expected_have_influence() {
        // An object before a black background: a noisy pixel has a thousand events.
        let part = image(|x, _| if x < 20 { 0.0 } else { 100.0 });
        assert!(ratio(&part, 15, 20) < 0.01 * 25.0, "{}", ratio(&part, 15, 20));
        assert!(ratio(&part, 21, 20) > 0.7 * 25.0, "{}", ratio(&part, 21, 20));
        // One event in forty pixels: nine by nine pixels without an event are not significant.
        let mut rare = image(|x, y| if x >= 17 && (x + 6 * y) % 40 == 0 { 100.0 } else { 0.0 });
        rare.scatter.data_mut().iter_mut().flatten().for_each(|s| s.largest = s.all);
        assert!(ratio(&rare, 12, 20) > 0.3 * ratio(&rare, 27, 20), "{} {}", ratio(&rare, 12, 20), ratio(&rare, 27, 20));
    }

    #[test]
    fn unknown_pixels_are_excluded() {
        let mut evidence = image(|_, _| 8.0);
        (0..SIDE).for_each(|x| evidence.variance.data_mut()[x as usize] = f32::INFINITY);
        assert!(expected(&evidence, None).data().iter().all(|e| (e.ratio - 2.0).abs() < 1e-4));
        // Without squares, the batches alone.
        evidence.scatter = Plane::new(SIDE, SIDE, None);
        assert!(expected(&evidence, None).data().iter().all(|e| (e.ratio - 2.0).abs() < 1e-4));
        evidence.variance = Plane::new(SIDE, SIDE, f32::INFINITY);
        assert!(expected(&evidence, None).data().iter().all(|e| e.ratio == f32::INFINITY));
        // Variances beyond the range of f32.
        let blinding = expected(&image(|x, _| if x < 20 { 1e38 } else { 0.0 }), None);
        assert!(blinding.data().iter().all(|e| e.ratio.is_finite()));
    }
}
