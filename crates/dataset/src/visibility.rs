//! Visibility of an instance for a camera: contrast to its surroundings over the noise of the camera.

use dunkelfeld_film::Plane;
use dunkelfeld_radiometry::{Electrons, Seconds};
use dunkelfeld_sensor::SensorModel;

/// Distances of the surroundings from the instance \[pixels\], along rows and columns: farther than the first, at most the
/// second.
const RING: [i64; 2] = [1, 5];

/// Pixels of an instance, as a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Bounds {
    /// Left, top.
    pub(crate) from: [u32; 2],
    /// Right, bottom, exclusive.
    pub(crate) to: [u32; 2],
}

/// Contrast of an instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Visibility {
    /// Mean of the instance minus mean of its surroundings \[DN\].
    pub(crate) contrast: f64,
    /// Magnitude of the contrast over the standard deviation of the temporal noise of the camera in the surroundings
    /// (EMVA 1288, release 4): of one pixel.
    pub(crate) cnr: f64,
}

/// The expected electrons of an image, and what turns them into grey values with noise.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Exposed<'a> {
    pub(crate) electrons: &'a Plane<f32>,
    pub(crate) model: &'a SensorModel,
    pub(crate) time: Seconds,
}

/// Sums of expected electrons over pixels behind one colour of the filter array.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    sum: f64,
    pixels: u64,
}

impl Mean {
    fn add(&mut self, electrons: f64) {
        self.sum += electrons;
        self.pixels += 1;
    }

    fn value(self) -> Option<f64> {
        (self.pixels > 0).then(|| self.sum / self.pixels as f64)
    }
}

/// The contrast of an instance to the pixels around it. Pixels of `is_excluded` instances are not part of the surroundings:
/// other defects. Electrons above saturation do not count. Behind a colour filter array, pixels of one colour are compared
/// with each other, and the result is that of the colour with the largest ratio. `None` if nothing surrounds the instance,
/// for example if it fills the image, and if both sides are saturated.
pub(crate) fn visibility(
    exposed: &Exposed<'_>,
    instances: &Plane<u16>,
    id: u16,
    bounds: Bounds,
    is_excluded: impl Fn(u16) -> bool,
) -> Option<Visibility> {
    let spec = exposed.model.spec();
    let saturation = exposed.model.saturation().0;
    // A filter array repeats after two rows and two columns.
    let has_filter = spec.quantum_efficiency.filter().is_some();
    let phase = |x: i64, y: i64| if has_filter { (y % 2 * 2 + x % 2) as usize } else { 0 };
    let [width, height] = [instances.width(), instances.height()].map(i64::from);
    let [x0, y0] = bounds.from.map(|v| i64::from(v) - RING[1]);
    let [x1, y1] = bounds.to.map(|v| i64::from(v) + RING[1]);
    let (x0, y0, x1, y1) = (x0.max(0), y0.max(0), x1.min(width), y1.min(height));
    let (columns, rows) = ((x1 - x0).max(0) as usize, (y1 - y0).max(0) as usize);
    let at = |x: i64, y: i64| (y * width + x) as usize;
    let electrons = |x: i64, y: i64| f64::from(exposed.electrons.data()[at(x, y)]).min(saturation);
    let mut inside = vec![false; columns * rows];
    let (mut means, mut rings) = ([Mean::default(); 4], [Mean::default(); 4]);
    for y in y0..y1 {
        for x in x0..x1 {
            if instances.data()[at(x, y)] == id {
                inside[(y - y0) as usize * columns + (x - x0) as usize] = true;
                means[phase(x, y)].add(electrons(x, y));
            }
        }
    }
    let near = dilated(&inside, columns, RING[0] as usize);
    let far = dilated(&inside, columns, RING[1] as usize);
    for (k, (near, far)) in near.iter().zip(&far).enumerate() {
        let (x, y) = (x0 + (k % columns) as i64, y0 + (k / columns) as i64);
        if *far && !*near && !is_excluded(instances.data()[at(x, y)]) {
            rings[phase(x, y)].add(electrons(x, y));
        }
    }
    let of_phase = |(mean, ring): (&Mean, &Mean)| {
        let (mean, ring) = (mean.value()?, ring.value()?);
        if mean >= saturation && ring >= saturation {
            return None;
        }
        let variance = exposed.model.temporal_variance(Electrons(ring), exposed.time);
        let difference = mean - ring;
        Some(Visibility { contrast: difference * spec.system_gain, cnr: difference.abs() / variance.sqrt() })
    };
    means.iter().zip(&rings).filter_map(of_phase).max_by(|a, b| a.cnr.total_cmp(&b.cnr))
}

/// The pixels within a distance of others, along rows and columns.
fn dilated(mask: &[bool], columns: usize, distance: usize) -> Vec<bool> {
    let Some(rows) = mask.len().checked_div(columns) else { return Vec::new() };
    let mut wide = vec![false; mask.len()];
    for y in 0..rows {
        let row = &mask[y * columns..(y + 1) * columns];
        for x in (0..columns).filter(|x| row[*x]) {
            wide[y * columns + x.saturating_sub(distance)..=y * columns + (x + distance).min(columns - 1)].fill(true);
        }
    }
    let mut all = vec![false; mask.len()];
    for y in 0..rows {
        for x in (0..columns).filter(|x| wide[y * columns + x]) {
            for to in y.saturating_sub(distance)..=(y + distance).min(rows - 1) {
                all[to * columns + x] = true;
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_io::sensor_file::preset;
    use dunkelfeld_sensor::{BayerPattern, ColorFilter, Efficiency};

    #[test]
    fn contrast_and_noise_are_those_of_the_model() {
        let model = preset("imx250").expect("a preset");
        let time = Seconds(0.01);
        // A square of 900 electrons on 400, next to another defect of 5000 electrons.
        let at = |x: u32, y: u32| (8..12).contains(&x) && (8..12).contains(&y);
        let other = |x: u32, y: u32| (14..16).contains(&x) && (8..12).contains(&y);
        let electrons = Plane::from_fn(24, 20, |x, y| {
            if at(x, y) {
                900.0
            } else if other(x, y) {
                5000.0
            } else {
                400.0
            }
        });
        let ids = Plane::from_fn(24, 20, |x, y| {
            if at(x, y) {
                3
            } else if other(x, y) {
                4
            } else {
                0
            }
        });
        let exposed = Exposed { electrons: &electrons, model: &model, time };
        let bounds = Bounds { from: [8, 8], to: [12, 12] };
        let found = visibility(&exposed, &ids, 3, bounds, |id| id == 4).expect("surroundings");
        let spec = model.spec();
        assert!((found.contrast - 500.0 * spec.system_gain).abs() < 1e-9);
        let variance = 400.0 + model.dark_variance(time) + 1.0 / (12.0 * spec.system_gain.powi(2));
        assert!((found.cnr - 500.0 / variance.sqrt()).abs() < 1e-9, "{found:?}");
        // With the other one in its surroundings the contrast is smaller.
        let mixed = visibility(&exposed, &ids, 3, bounds, |_| false).expect("surroundings");
        assert!(mixed.contrast < found.contrast);
        // Saturated on both sides, and on one.
        let bright = electrons.map(|e| e * 1e4);
        assert_eq!(visibility(&Exposed { electrons: &bright, ..exposed }, &ids, 3, bounds, |id| id == 4), None);
        let half = Plane::from_fn(24, 20, |x, y| if at(x, y) { 1e7 } else { 400.0 });
        let found =
            visibility(&Exposed { electrons: &half, ..exposed }, &ids, 3, bounds, |_| false).expect("a contrast");
        assert!((found.contrast - (model.saturation().0 - 400.0) * spec.system_gain).abs() < 1e-6);
        // Behind a filter array equal colours are compared: a plate and a print of the same colour have no contrast.
        let mut spec = model.spec().clone();
        let curve = spec.quantum_efficiency.curves()[0].clone();
        let filter = ColorFilter {
            pattern: BayerPattern::Rggb,
            curves: [curve.clone(), curve.clone(), curve],
            white_balance: true,
        };
        spec.quantum_efficiency = Efficiency::Mosaic(filter);
        let bayer = SensorModel::new(spec).expect("a sensor");
        let mosaic = Plane::from_fn(24, 20, |x, y| [300.0, 900.0, 900.0, 200.0][(y % 2 * 2 + x % 2) as usize]);
        let odd = Plane::from_fn(24, 20, |x, y| u16::from(x == 9 && (8..13).contains(&y)));
        let colored = Exposed { electrons: &mosaic, model: &bayer, time };
        let none =
            visibility(&colored, &odd, 1, Bounds { from: [9, 8], to: [10, 13] }, |_| false).expect("surroundings");
        assert_eq!((none.contrast, none.cnr), (0.0, 0.0));
        // Nothing surrounds an instance that fills the image.
        let full = Plane::new(24, 20, 3);
        assert_eq!(visibility(&exposed, &full, 3, Bounds { from: [0, 0], to: [24, 20] }, |_| false), None);
    }
}
