//! Histograms of pixels, which show defects (EMVA 1288 release 4.0 Linear, section 8.4). They are logarithmic and
//! accumulated, each with the normal distribution of the same variance.

use serde::Serialize;
use statrs::distribution::{Continuous, ContinuousCDF, Normal};

use crate::stack::SpatialStack;

/// Largest number of bins.
const MAX_BINS: i64 = 256;
/// Side of the box of the high-pass filter, in pixels.
const BOX: usize = 5;

/// Number of pixels by deviation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Histogram {
    /// Unit of the deviations: DN or %.
    pub unit: &'static str,
    /// Number of counted pixels.
    pub pixels: u64,
    /// Width of a bin.
    pub bin: f64,
    /// Middle of the first bin, as a deviation from the mean.
    pub first: f64,
    /// Pixels in each bin.
    pub counts: Vec<u64>,
    /// Standard deviation of the pixels.
    pub deviation: f64,
    /// Share of the pixels whose deviation is at least k bins in magnitude, k = 0, 1, ... \[%\].
    pub accumulated: Vec<f64>,
}

impl Histogram {
    /// Middle of a bin.
    pub fn at(&self, bin: usize) -> f64 {
        self.first + self.bin * bin as f64
    }

    /// Pixels that a normal distribution would have in a bin.
    pub fn model(&self, bin: usize) -> f64 {
        match Normal::new(0.0, self.deviation) {
            Ok(normal) => self.pixels as f64 * self.bin * normal.pdf(self.at(bin)),
            Err(_) => 0.0,
        }
    }

    /// Share of the pixels that a normal distribution would have at or beyond a deviation \[%\].
    pub fn accumulated_model(&self, deviation: f64) -> f64 {
        match Normal::new(0.0, self.deviation) {
            Ok(normal) => 200.0 * normal.sf(deviation.abs()),
            Err(_) => 0.0,
        }
    }

    /// The histogram of integers. `scale` integers make one unit.
    fn from_values(values: &[i64], scale: f64, unit: &'static str) -> Option<Self> {
        let (&least, &most) = (values.iter().min()?, values.iter().max()?);
        let n = values.len() as f64;
        let mean = values.iter().map(|&v| v as f64).sum::<f64>() / n;
        let deviation = (values.iter().map(|&v| (v as f64 - mean).powi(2)).sum::<f64>() / n).sqrt() / scale;
        // Bins contain a whole number of integers, so that none is favoured.
        let width = (most - least) / MAX_BINS + 1;
        let mut counts = vec![0u64; ((most - least) / width + 1) as usize];
        for v in values {
            if let Some(count) = counts.get_mut(((v - least) / width) as usize) {
                *count += 1;
            }
        }
        let bin = width as f64 / scale;
        let mut beyond = Vec::new();
        for v in values {
            let k = ((*v as f64 - mean).abs() / scale / bin) as usize;
            if beyond.len() <= k {
                beyond.resize(k + 1, 0u64);
            }
            beyond[k] += 1;
        }
        let mut total = 0;
        for count in beyond.iter_mut().rev() {
            total += *count;
            *count = total;
        }
        Some(Self {
            unit,
            pixels: values.len() as u64,
            bin,
            first: (least as f64 + 0.5 * (width - 1) as f64 - mean) / scale,
            counts,
            deviation,
            accumulated: beyond.into_iter().map(|c| 100.0 * c as f64 / n).collect(),
        })
    }
}

/// The histogram of the dark pixels \[DN\].
pub(crate) fn dark(stack: &SpatialStack) -> Option<Histogram> {
    let values: Vec<i64> = stack.sums().iter().map(|&s| i64::from(s)).collect();
    Histogram::from_values(&values, f64::from(stack.frames), "DN")
}

/// The histogram of the response of the pixels \[%\]: bright minus dark, without the parts that are smooth over [`BOX`]
/// x [`BOX`] pixels, since these may come from the light.
pub(crate) fn response(bright: &SpatialStack, dark: &SpatialStack) -> Option<Histogram> {
    let (width, height) = (bright.width as usize, bright.height as usize);
    let (lb, ld) = (i64::from(bright.frames), i64::from(dark.frames));
    // In units of 1 / (L_bright L_dark BOX^2) DN all values are integers.
    let light: Vec<i64> =
        bright.sums().iter().zip(dark.sums()).map(|(&b, &d)| i64::from(b) * ld - i64::from(d) * lb).collect();
    let cells = (BOX * BOX) as i64;
    let half = BOX / 2;
    if width < BOX || height < BOX {
        return None;
    }
    let mut values = Vec::with_capacity((width - 2 * half) * (height - 2 * half));
    let mut columns = vec![0i64; width];
    for y in half..height - half {
        if y == half {
            for row in light.chunks_exact(width).take(BOX) {
                columns.iter_mut().zip(row).for_each(|(c, v)| *c += v);
            }
        } else {
            let (old, new) = ((y - half - 1) * width, (y + half) * width);
            for (x, c) in columns.iter_mut().enumerate() {
                *c += light[new + x] - light[old + x];
            }
        }
        let mut sum: i64 = columns[..BOX].iter().sum();
        for x in half..width - half {
            if x > half {
                sum += columns[x + half] - columns[x - half - 1];
            }
            values.push(cells * light[y * width + x] - sum);
        }
    }
    let percent = (bright.mean - dark.mean) / 100.0;
    if percent <= 0.0 {
        return None;
    }
    Histogram::from_values(&values, (lb * ld * cells) as f64 * percent, "%")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Frame;
    use crate::stack::StackAccumulator;

    fn still(width: u32, values: &[u16]) -> SpatialStack {
        let height = values.len() as u32 / width;
        let mut stack = StackAccumulator::new(width, height);
        for _ in 0..2 {
            stack.add(Frame::new(width, height, values).expect("size")).expect("same size");
        }
        stack.finish().expect("two frames")
    }

    #[test]
    fn a_histogram_by_hand() {
        // Eight pixels of 10 and one of 19: mean 11, variance (8 * 1 + 64) / 9 = 8.
        let mut values = [10u16; 9];
        values[4] = 19;
        let h = dark(&still(3, &values)).expect("pixels");
        assert!((h.deviation - 8f64.sqrt()).abs() < 1e-12);
        // Two frames: sums from 20 to 38, bins of half a grey value.
        assert_eq!((h.bin, h.first, h.counts.len()), (0.5, -1.0, 19));
        assert_eq!((h.counts[0], h.counts[18], h.counts.iter().sum::<u64>()), (8, 1, 9));
        assert!((h.at(18) - 8.0).abs() < 1e-12);
        // All pixels deviate by at least 1, and one pixel by more, up to 8.
        assert_eq!(h.accumulated.len(), 17);
        assert!((h.accumulated[2] - 100.0).abs() < 1e-12 && (h.accumulated[3] - 100.0 / 9.0).abs() < 1e-12);
        assert!((h.accumulated_model(h.deviation) - 31.7311).abs() < 1e-3);
    }

    #[test]
    fn smooth_light_is_no_defect_and_a_dim_pixel_is() {
        let night = still(20, &[10; 400]);
        let mut values: Vec<u16> = (0..400).map(|i| 1000 + 4 * (i % 20) as u16 + 3 * (i / 20) as u16).collect();
        let h = response(&still(20, &values), &night).expect("pixels");
        // The mean of a ramp over a box is the value at its centre.
        assert_eq!((h.pixels, h.counts.len()), (256, 1));
        values[210] -= 500;
        let h = response(&still(20, &values), &night).expect("pixels");
        let light = still(20, &values).mean - 10.0;
        // The filtered deficit is 24 / 25 of the deficit against the neighbours. The increase of the neighbours shifts
        // the mean of all.
        let least = h.first - 0.5 * h.bin;
        assert!((least + 100.0 * 500.0 * 0.96 / light).abs() < 2.0 * h.bin, "{least} {h:?}");
        assert_eq!(h.counts[0], 1);
    }
}
