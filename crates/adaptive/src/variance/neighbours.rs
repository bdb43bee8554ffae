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

use crate::required_samples::SensorNoise;
use crate::variance::inputs::{NoiseInputs, PixelFeatures};

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

/// Noise of a pixel for the predictions of its neighbours: variances of one sample over the tolerated variance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NeighbourNoise {
    /// Unknown: the pixel has too few samples.
    Nothing,
    /// The pixel is saturated beyond doubt.
    Saturated,
    /// The measured noise of the pixel.
    Noise {
        /// Variance under the assumption of independent samples.
        all: f32,
        /// The part of `all` that comes from the largest sample.
        largest: f32,
        /// Variance from the spread of the batches.
        batches: f32,
    },
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

/// The noise of each pixel over the tolerated variance. The tolerated variance is that of the sensor at the mean of the
/// pixel. Without a sensor it is one everywhere.
///
/// # Panics
/// If the planes differ in size.
pub fn neighbour_noise(evidence: &NoiseInputs, sensor: Option<SensorNoise>) -> Plane<NeighbourNoise> {
    assert!(evidence.is_consistent(), "planes differ in size");
    Plane::from_fn(evidence.width(), evidence.height(), |x, y| {
        let (n, variance) = (f64::from(*evidence.counts.at(x, y)), *evidence.variance.at(x, y));
        if !variance.is_finite() {
            return NeighbourNoise::Nothing;
        }
        let (mean, variance) = (f64::from(*evidence.mean.at(x, y)), f64::from(variance));
        if sensor.is_some_and(|s| s.is_saturated(mean, variance)) {
            return NeighbourNoise::Saturated;
        }
        let over = n / sensor.map_or(1.0, |s| s.variance(mean));
        // Without data of single samples, all variance may come from one sample.
        let (all, largest) = evidence.scatter.at(x, y).map_or((variance, variance), |s| (s.all, s.largest));
        let value = |v: f64| (over * v).min(f64::from(f32::MAX)) as f32;
        NeighbourNoise::Noise { all: value(all), largest: value(largest), batches: value(variance) }
    })
}

/// The predicted noise of the pixels of one row. Rows are independent of each other.
///
/// # Panics
/// If the planes differ in size.
pub fn predicted_noise_row(
    surface: &Plane<PixelFeatures>,
    neighbours: &Plane<NeighbourNoise>,
    y: u32,
) -> Vec<PredictedNoise> {
    assert_eq!((surface.width(), surface.height()), (neighbours.width(), neighbours.height()), "planes differ in size");
    let weights = Weights::new();
    (0..neighbours.width()).map(|x| expected_at(surface, neighbours, &weights, x, y)).collect()
}

/// The predicted noise of all pixels.
pub fn expected(evidence: &NoiseInputs, sensor: Option<SensorNoise>) -> Plane<PredictedNoise> {
    let neighbours = neighbour_noise(evidence, sensor);
    let rows = (0..neighbours.height()).flat_map(|y| predicted_noise_row(&evidence.surface, &neighbours, y)).collect();
    let unknown = PredictedNoise { ratio: f32::INFINITY, saturated: false };
    Plane::from_vec(neighbours.width(), neighbours.height(), rows).unwrap_or_else(|| neighbours.map(|_| unknown))
}

fn expected_at(
    surface: &Plane<PixelFeatures>,
    neighbours: &Plane<NeighbourNoise>,
    weights: &Weights,
    x: u32,
    y: u32,
) -> PredictedNoise {
    let own = surface.at(x, y);
    let (mut near, mut alike, mut anything) = (Sums::default(), Sums::default(), Sums::default());
    // Numbers of adjacent pixels, and of saturated ones among them.
    let (mut around, mut saturated) = (0, 0);
    let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(neighbours.width());
    for ny in y.saturating_sub(REACH)..(y + REACH + 1).min(neighbours.height()) {
        for nx in columns.clone().filter(|&nx| (nx, ny) != (x, y)) {
            let (dx, dy) = (nx.abs_diff(x), ny.abs_diff(y));
            let other = neighbours.at(nx, ny);
            if dx.max(dy) <= 1 {
                around += 1;
                saturated += u32::from(*other == NeighbourNoise::Saturated);
            }
            let noise = match *other {
                NeighbourNoise::Nothing => continue,
                NeighbourNoise::Saturated => [0.0; 3],
                NeighbourNoise::Noise { all, largest, batches } => [all, largest, batches].map(f64::from),
            };
            let weight = |scale: usize| weights.0[scale][dy as usize][dx as usize];
            anything.add(noise, weight(1));
            if surface.at(nx, ny).object == own.object {
                alike.add(noise, weight(1));
                near.add(noise, weight(0));
            }
        }
    }
    if around > 0 && saturated == around {
        return PredictedNoise { ratio: 0.0, saturated: true };
    }
    if anything.weight == 0.0 {
        return PredictedNoise { ratio: f32::INFINITY, saturated: false };
    }
    // A neighbourhood without events is informative, too, if many events were to be expected in it.
    let events_per_pixel = anything.events() / anything.pixels();
    let narrowed =
        |wider: f64, sums: &Sums| shrunk(sums.mean(), sums.events().max(events_per_pixel * sums.pixels()), wider);
    let independent = [&alike, &near].into_iter().fold(anything.mean(), narrowed);
    let evenness = shrunk(alike.by_batches(), alike.events(), anything.by_batches());
    PredictedNoise { ratio: (independent * evenness).min(f64::from(f32::MAX)) as f32, saturated: false }
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
struct Sums {
    weight: f64,
    weights_squared: f64,
    all: f64,
    squares: f64,
    /// Estimated variance of the weighted sum `all`, if no event contributes more than the largest of its pixel.
    scatter: f64,
    batches: f64,
}

impl Sums {
    #[inline]
    fn add(&mut self, [all, largest, batches]: [f64; 3], weight: f64) {
        self.weight += weight;
        self.weights_squared += weight * weight;
        self.all += weight * all;
        self.squares += weight * all * all;
        self.scatter += weight * weight * all * largest;
        self.batches += weight * batches;
    }

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
    use crate::variance::inputs::SensorVarianceRange;
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
