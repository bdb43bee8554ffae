//! Axes: positions of values, and choice of the values with labels.

/// An axis from a range of values to a range of positions in the chart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    is_log: bool,
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Scale {
    /// A logarithmic axis that contains all positive values, with a margin at its ends; one decade around one if there
    /// are none.
    pub(super) fn log(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let usable = values.filter(|v| v.is_finite() && *v > 0.0).map(f64::log10);
        let (low, high) = usable.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (-0.5, 0.5) };
        // Half a decade at least, so that equal values do not make an axis without length.
        let room = (0.06 * (high - low)).max(0.5 * (0.5 - (high - low)));
        Self { is_log: true, low: low - room, high: high + room, from, to }
    }

    /// A linear axis from zero to the largest value.
    pub(super) fn linear(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let high = values.filter(|v| v.is_finite()).fold(0.0, f64::max);
        Self { is_log: false, low: 0.0, high: if high > 0.0 { 1.04 * high } else { 1.0 }, from, to }
    }

    /// A linear axis that contains all values, of either sign, with a margin at its ends.
    pub(super) fn span(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let usable = values.filter(|v| v.is_finite());
        let (low, high) = usable.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        let size = low.abs().max(high.abs());
        // For equal values, the axis extends by half of their magnitude to both sides, so that its labels differ.
        let room = match high - low > 1e-6 * size {
            true => 0.05 * (high - low),
            false if size > 1e-30 => 0.5 * size,
            false => 1.0,
        };
        Self { is_log: false, low: low - room, high: high + room, from, to }
    }

    /// An axis with given ends, without a margin. The ends of a logarithmic axis are positive.
    pub(super) fn exact(is_log: bool, low: f64, high: f64, from: f64, to: f64) -> Self {
        let [low, high] = [low, high].map(|v| if is_log { v.max(1e-300).log10() } else { v });
        let high = if high - low > 1e-9 * low.abs() { high } else { low + low.abs().max(1.0) };
        Self { is_log, low, high, from, to }
    }

    /// The position of a value, clamped to the ends of the axis.
    pub(super) fn place(&self, value: f64) -> f64 {
        let v = if self.is_log { value.max(1e-300).log10() } else { value };
        let share = ((v - self.low) / (self.high - self.low)).clamp(0.0, 1.0);
        self.from + share * (self.to - self.from)
    }

    /// The values at the ends.
    pub(super) fn ends(&self) -> [f64; 2] {
        [self.low, self.high].map(|v| if self.is_log { 10f64.powf(v) } else { v })
    }

    /// The values with labels.
    pub(super) fn ticks(&self) -> Vec<f64> {
        if !self.is_log {
            let raw = (self.high - self.low) / 5.0;
            let power = 10f64.powf(raw.log10().floor());
            let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= raw).unwrap_or(raw);
            let first = (self.low / step).ceil();
            let ticks = (0..20).map(|i| (first + f64::from(i)) * step);
            return ticks.take_while(|v| *v <= self.high).collect();
        }
        let (first, last) = (self.low.floor() as i32, self.high.ceil() as i32);
        let inside = |v: &f64| (self.low..=self.high).contains(&v.log10());
        let with = |steps: &[f64], every: usize| -> Vec<f64> {
            let decades = (first..=last).step_by(every).map(|d| 10f64.powi(d));
            decades.flat_map(|d| steps.iter().map(move |s| s * d)).filter(inside).collect()
        };
        let finer: [&[f64]; 4] = [&[1.0], &[1.0, 3.0], &[1.0, 2.0, 5.0], &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]];
        let first_enough = finer.iter().map(|steps| with(steps, 1)).find(|ticks| ticks.len() >= 3);
        match first_enough.unwrap_or_else(|| with(finer[3], 1)) {
            ticks if ticks.len() > 7 => with(&[1.0], ticks.len().div_ceil(6)),
            ticks => ticks,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        for values in [[0.3, 0.4], [1.0, 30.0], [1e-9, 1e7], [2.0, 2.0], [0.013, 9.1]] {
            let scale = Scale::log(values.into_iter(), 0.0, 100.0);
            let ticks = scale.ticks();
            assert!((2..=9).contains(&ticks.len()), "{values:?}: {ticks:?}");
            let [low, high] = scale.ends();
            assert!(ticks.iter().all(|t| (low..=high).contains(t)), "{values:?}: {ticks:?}");
            assert!(values.iter().all(|v| (0.0..=100.0).contains(&scale.place(*v))));
        }
        assert_eq!(Scale::linear([7.3].into_iter(), 0.0, 1.0).ticks(), [0.0, 2.0, 4.0, 6.0]);
        assert!(!Scale::log([f64::NAN, -1.0].into_iter(), 0.0, 1.0).ticks().is_empty());
    }
}
