//! The range of figures if rounding to whole grey values hides dark noise below half a grey value.
//!
//! The noise of the bright levels contains the whole sigma_q^2 = 1/12 of rounding. That of such a steady dark level
//! does not: with hardly any noise its values are all equal, or alternate between two. Photon transfer should subtract
//! sigma_d^2 + sigma_q^2. For any variance that is measured there, this sum lies between 1/12 (no dark noise) and 0.24
//! DN^2 (release 4.0 Linear).

use crate::bound::Side;
use crate::measurement::Ordered;
use crate::shortcomings::is_cut_off;
use crate::summary::{Is, MIN_DARK_VARIANCE, RESULTS, ROUNDING, Summary};

/// The results with the smallest and the largest dark variance that rounding may hide. `None` for results without
/// hidden noise.
#[derive(Clone, Debug)]
pub(crate) struct Hidden {
    /// For dark noise, thresholds and range. `None` if dark values are cut off at zero, which reduces noise without a
    /// bound.
    dark: Option<[[f64; RESULTS]; 2]>,
    /// For the figures that follow from the regression for K.
    gain: Option<[[f64; RESULTS]; 2]>,
    /// Largest DSNU^2 \[e-^2\].
    dsnu2: Option<f64>,
}

impl Hidden {
    pub(crate) fn new(data: &Ordered<'_>, summary: &Summary) -> Self {
        let is_low = |variance: f64| variance < MIN_DARK_VARIANCE;
        let ends = || [ROUNDING, MIN_DARK_VARIANCE].map(|v| summary.with_dark_variance(v).results());
        let spoils_gain = summary.bright[..summary.used].iter().any(|p| is_low(summary.dark[p.dark].variance.value));
        let ranges = (summary.is_bound || spoils_gain).then(ends);
        let total = summary.spatial.as_ref().map(|(_, dark, _)| dark.temporal.value + dark.split().total.max(0.0));
        let min_gain = |r: &[[f64; RESULTS]; 2]| r[0][Is::Gain as usize].min(r[1][Is::Gain as usize]);
        let dsnu2 = match (&ranges, total) {
            (Some(r), Some(total)) if is_low(total) => Some((MIN_DARK_VARIANCE - ROUNDING) / min_gain(r).powi(2)),
            _ => None,
        };
        Self {
            dark: ranges.filter(|_| summary.is_bound && !is_cut_off(data)),
            gain: ranges.filter(|_| spoils_gain),
            dsnu2: dsnu2.filter(|_| !is_cut_off(data)),
        }
    }

    /// The range of K.
    pub(crate) fn gains(&self) -> Option<[f64; 2]> {
        let [a, b] = self.gain.as_ref()?.map(|r| r[Is::Gain as usize]);
        Some([a.min(b), a.max(b)])
    }

    /// Returns whether DSNU is below the resolution of rounding.
    pub(crate) fn has_dsnu(&self) -> bool {
        self.dsnu2.is_some()
    }

    /// The bound of a result, if only a bound is known.
    pub(crate) fn bound(&self, is: Is) -> Option<(f64, Side)> {
        let of = |side| {
            let [a, b] = self.dark.as_ref()?.map(|r| r[is as usize]);
            Some((if side == Side::Below { a.max(b) } else { a.min(b) }, side))
        };
        match is {
            Is::DarkNoise2 | Is::DarkVariance | Is::LeastElectrons | Is::LeastPhotons => of(Side::Below),
            Is::RowNoise2 => self.bound(Is::DarkNoise2),
            Is::Range | Is::RangeDb => of(Side::Above),
            Is::Dsnu2 | Is::DsnuPixel2 | Is::DsnuRow2 | Is::DsnuColumn2 => self.dsnu2.map(|v| (v, Side::Below)),
            _ => None,
        }
    }
}
