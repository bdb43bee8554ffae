//! The shutter: the time of each sample, and for a line scan its place on the film.

use dunkelfeld_lanes::{cos_sin_of_turn, ln};
use dunkelfeld_sampling::Sampler;

/// Key of the deviations of line starts, so that they share no number with a sample.
const JITTER_KEY: u64 = 0x6c69_6e65_2073_6361;
/// No deviation exceeds this many standard deviations, because its random numbers have 24 bits.
const MAX_DEVIATION: f64 = 6.0;

/// The times at which the samples of an image are taken. Time 0 is the middle of the exposure of a frame, or of the
/// middle row of a line scan. The scene then has the pose of its file.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Shutter {
    /// All pixels are exposed at the same time.
    Frame {
        /// Exposure time \[s\].
        exposure: f64,
    },
    /// The rows are exposed one after the other.
    Lines(LineScan),
}

/// A line-scan camera: each row of the film is one exposure of the same sensor line. Row 0 is the first one.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct LineScan {
    /// Time from the start of a line to the start of the next one \[s\].
    pub period: f64,
    /// Exposure time of a line in one stage \[s\], at most the period.
    pub exposure: f64,
    /// Number of stages of time delay and integration (TDI); 1 for a single line.
    pub stages: u32,
    /// Standard deviation of the start of a line \[s\].
    pub jitter: f64,
    /// Place of the middle of the sensor line in the height of the film, in \[0, 1\] from the top.
    pub line: f64,
    /// Rows of the film.
    pub rows: u32,
    /// Number of lights that flash in turn, line by line, so that each has an image of its own; 1 if all are on together.
    pub in_turn: u32,
}

/// Time and place of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Time \[s\].
    pub time: f32,
    /// Film coordinate \[pixels\] from the top.
    pub y: f32,
}

impl Shutter {
    /// The times of all samples \[s\].
    pub fn times(&self) -> [f64; 2] {
        match self {
            Self::Frame { exposure } => [-0.5 * exposure, 0.5 * exposure],
            Self::Lines(lines) => {
                let reach = 0.5 * f64::from(lines.rows - lines.rows.min(1)) * lines.period
                    + 0.5 * f64::from(lines.stages - lines.stages.min(1)) * lines.period
                    + 0.5 * lines.exposure
                    + MAX_DEVIATION * lines.jitter;
                // The times of samples are f32.
                let reach = reach * (1.0 + f64::from(f32::EPSILON));
                [-reach, reach]
            }
        }
    }

    /// Exposure time \[s\] of a pixel; that of all stages of a line scan together.
    pub fn exposure(&self) -> f64 {
        match self {
            Self::Frame { exposure } => *exposure,
            Self::Lines(lines) => lines.total_exposure(),
        }
    }

    /// Time and place of a sample of the film row `row`. `dy` in `[0, 1)` is its place in the height of the pixel, `u` in
    /// `[0, 1)` chooses the stage and the time of the exposure. The deviation of a line is a function of seed, frame and
    /// line.
    #[inline]
    pub fn moment(&self, row: u32, dy: f32, u: f32, (seed, frame): (u64, u32)) -> Moment {
        match self {
            Self::Frame { exposure } => Moment { time: ((f64::from(u) - 0.5) * exposure) as f32, y: row as f32 + dy },
            Self::Lines(lines) => lines.moment(row, dy, u, (seed, frame)),
        }
    }

    /// The middle of the exposure of a row at the middle of its height, without deviation.
    pub fn middle(&self, row: u32) -> Moment {
        match self {
            Self::Frame { .. } => Moment { time: 0.0, y: row as f32 + 0.5 },
            Self::Lines(lines) => {
                Moment { time: (lines.period * lines.rows_from_middle(row)) as f32, y: lines.film_y(0.5, 0.0) as f32 }
            }
        }
    }
}

impl LineScan {
    /// Exposure time \[s\] of a pixel in all stages together.
    pub fn total_exposure(&self) -> f64 {
        self.exposure * f64::from(self.stages)
    }

    fn rows_from_middle(&self, row: u32) -> f64 {
        f64::from(row) - 0.5 * f64::from(self.rows - self.rows.min(1))
    }

    /// Stages from the middle one: the stage 0 is exposed first.
    fn stages_from_middle(&self, stage: u32) -> f64 {
        f64::from(stage) - 0.5 * f64::from(self.stages - self.stages.min(1))
    }

    /// Film coordinate of the place `dy` in the pixel of the sensor line that is `stages` behind the middle one. The
    /// image of the object moves toward lower rows, so a later stage lies above.
    fn film_y(&self, dy: f64, stages: f64) -> f64 {
        self.line * f64::from(self.rows) - 0.5 + dy - stages
    }

    fn moment(&self, row: u32, dy: f32, u: f32, key: (u64, u32)) -> Moment {
        // One number for the stage and the time, so that samples are stratified over both.
        let scaled = f64::from(u) * f64::from(self.stages);
        let stage = (scaled as u32).min(self.stages.saturating_sub(1));
        let share = scaled - f64::from(stage);
        let stages = self.stages_from_middle(stage);
        let start = (self.rows_from_middle(row) + stages) * self.period + self.deviation(row + stage, key);
        Moment { time: (start + (share - 0.5) * self.exposure) as f32, y: self.film_y(f64::from(dy), stages) as f32 }
    }

    /// The deviation \[s\] of the clock tick with a number: a normal variate (Box and Muller 1958). Stage s of row y is
    /// exposed at the tick y + s, with stage 0 of row y + s.
    fn deviation(&self, tick: u32, (seed, frame): (u64, u32)) -> f64 {
        if self.jitter == 0.0 {
            return 0.0;
        }
        let [u, v] = Sampler::new(seed ^ JITTER_KEY, frame, tick, 0).get_2d(0);
        self.jitter * f64::from((-2.0 * ln(1.0 - u)).sqrt() * cos_sin_of_turn(v).0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: (u64, u32) = (7, 3);

    fn lines() -> LineScan {
        LineScan { period: 1e-3, exposure: 4e-4, stages: 1, jitter: 0.0, line: 0.5, rows: 5, in_turn: 1 }
    }

    #[test]
    fn deviations_are_normal_belong_to_a_line_and_stay_within_the_times() {
        let scan = LineScan { jitter: 1e-4, rows: 4000, stages: 2, ..lines() };
        let shutter = Shutter::Lines(scan);
        let [from, to] = shutter.times();
        let (mut sum, mut squares) = (0.0, 0.0);
        for row in 0..4000 {
            let deviation = scan.deviation(row, KEY);
            // Both stages of a clock tick deviate equally: stage 1 of row n and stage 0 of row n + 1.
            if row > 0 {
                let late = shutter.moment(row - 1, 0.5, 0.75, KEY).time;
                let early = shutter.moment(row, 0.5, 0.25, KEY).time;
                assert!((late - early).abs() < 1e-6, "row {row}");
            }
            assert!((from..=to).contains(&f64::from(shutter.moment(row, 0.5, 0.0, KEY).time)));
            (sum, squares) = (sum + deviation, squares + deviation * deviation);
        }
        // False alarm below 1e-9: six standard errors of the mean of n values are 6 / sqrt(n), and of the variance
        // 6 sqrt(2 / n).
        let n = 4000f64;
        let (mean, variance) = (sum / n / 1e-4, squares / n / 1e-8);
        assert!(mean.abs() < 6.2 / n.sqrt(), "mean {mean}");
        assert!((variance - 1.0).abs() < 6.2 * (2.0 / n).sqrt(), "variance {variance}");
        assert_ne!(scan.deviation(5, KEY), scan.deviation(5, (7, 4)), "frames differ");
        assert_eq!(scan.deviation(5, KEY), scan.deviation(5, KEY));
    }
}
