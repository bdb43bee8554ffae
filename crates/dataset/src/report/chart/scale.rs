//! Axes: positions of values, choice of labelled values, format of labels.

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
    /// An axis with given ends, without a margin. The ends of a logarithmic axis are positive.
    pub(super) fn exact(is_log: bool, low: f64, high: f64, from: f64, to: f64) -> Self {
        let [low, high] = [low, high].map(|v| if is_log { v.max(1e-300).log10() } else { v });
        let high = if high - low > 1e-9 * low.abs() { high } else { low + low.abs().max(1.0) };
        Self { is_log, low, high, from, to }
    }

    /// A linear axis from zero to the largest value.
    pub(super) fn linear(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let high = values.filter(|v| v.is_finite()).fold(0.0, f64::max);
        Self { is_log: false, low: 0.0, high: if high > 0.0 { 1.04 * high } else { 1.0 }, from, to }
    }

    /// The position of a value, clamped to the ends of the axis.
    pub(super) fn place(&self, value: f64) -> f64 {
        let v = if self.is_log { value.max(1e-300).log10() } else { value };
        let share = ((v - self.low) / (self.high - self.low)).clamp(0.0, 1.0);
        self.from + share * (self.to - self.from)
    }

    /// The values with labels.
    pub(super) fn ticks(&self) -> Vec<f64> {
        if !self.is_log {
            let raw = (self.high - self.low) / 5.0;
            let power = 10f64.powf(raw.log10().floor());
            let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= raw).unwrap_or(raw);
            let first = (self.low / step).ceil();
            let ticks = (0..20).map(|i| (first + f64::from(i)) * step + 0.0);
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

/// The label of a tick.
pub(crate) fn label(v: f64) -> String {
    if v == 0.0 || (1e-3..1e4).contains(&v.abs()) {
        // The digits of the value, without the rounding error of its last bits.
        let text = format!("{v:.6}");
        return text.trim_end_matches('0').trim_end_matches('.').to_string();
    }
    let power = v.abs().log10().floor() as i32;
    let factor = v / 10f64.powi(power);
    let factor = format!("{factor:.1}");
    match factor.trim_end_matches(".0") {
        "1" => power_of_ten(power),
        factor => format!("{factor}\u{b7}{}", power_of_ten(power)),
    }
}

/// The text of a power of ten.
pub(crate) fn power_of_ten(power: i32) -> String {
    let raised = |c| match c {
        '-' => '\u{207b}',
        '1' => '\u{b9}',
        '2' => '\u{b2}',
        '3' => '\u{b3}',
        c => char::from_u32(0x2070 + c.to_digit(10).unwrap_or(0)).unwrap_or(c),
    };
    format!("10{}", power.to_string().chars().map(raised).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        for [low, high] in [[0.3, 0.4], [1.0, 30.0], [1e-9, 1e7], [0.013, 9.1], [-3.0, 5.0], [-1e300, 1e300]] {
            let scale = Scale::exact(low > 0.0, low, high, 0.0, 100.0);
            let ticks = scale.ticks();
            assert!((2..=20).contains(&ticks.len()), "{low} {high}: {ticks:?}");
            assert!(
                ticks.iter().all(|t| (low - 1e-3 * low.abs()..=high * 1.001).contains(t)),
                "{low} {high}: {ticks:?}"
            );
        }
        assert_eq!(Scale::linear([7.3].into_iter(), 0.0, 1.0).ticks(), [0.0, 2.0, 4.0, 6.0]);
        assert_eq!(Scale::exact(false, 1000.0, 1004.0, 0.0, 1.0).ticks(), [1000.0, 1001.0, 1002.0, 1003.0, 1004.0]);
        assert!(Scale::exact(false, 1e17, 1e17, 0.0, 1.0).ticks().len() <= 20);
    }

    #[test]
    fn decades_lie_at_equal_distances() {
        let scale = Scale::exact(true, 1.0, 1e4, 10.0, 210.0);
        let step = scale.place(10.0) - scale.place(1.0);
        assert!((scale.place(1e4) - scale.place(1e3) - step).abs() < 1e-9);
    }

    #[test]
    fn labels_read_as_people_write_them() {
        let labels = [0.0, 0.001, 0.5, 20.0, 3000.0, 1e5, 3e-4, 1e-12].map(label);
        let powers = ["10\u{2075}", "3\u{b7}10\u{207b}\u{2074}", "10\u{207b}\u{b9}\u{b2}"];
        assert_eq!(labels, ["0", "0.001", "0.5", "20", "3000", powers[0], powers[1], powers[2]]);
    }
}
