//! The saturation point of a camera.

use statrs::distribution::{Continuous, ContinuousCDF, Normal};

use crate::frame::AnalysisError;
use crate::measurement::{Ordered, Release};

/// Target share of values at the largest value. Release 4.0 allows 0.1 to 0.2 %, and this is the middle.
pub(crate) const AT_LARGEST: f64 = 0.0015;
/// Least number of values from which a share is estimated.
const MIN_COUNT: f64 = 10.0;

/// The saturation point.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Saturation {
    pub(crate) photons: f64,
    pub(crate) error: f64,
    /// Mean grey value there, without dark \[DN\].
    pub(crate) signal: f64,
    /// The largest grey value \[DN\], if most pixels of the brightest level have it.
    pub(crate) largest: Option<u16>,
    /// A note on the method, if it is not that of the release.
    pub(crate) note: Option<String>,
}

/// Finds the saturation point.
///
/// Levels form a grid, and the point lies between two of them. Release 4.0 uses the share of values that are the
/// largest possible. For normal noise around the mean, that share is a normal integral. So the point follows from the
/// level whose share is most informative, and from the width of the distribution on the last level below.
pub(crate) fn saturation(data: &Ordered<'_>, release: Release) -> Result<Saturation, AnalysisError> {
    let by_share = by_share(data);
    let largest = by_share.and_then(|_| data.bright.iter().map(|s| s.level.pair.largest).max());
    let is_other = by_share.is_none() && release == Release::R40;
    let by_share = by_share.filter(|_| release == Release::R40);
    let (photons, error) = by_share.map_or_else(|| by_peak(data), Ok)?;
    let note = is_other.then(|| {
        "the brightest frames do not end at one largest value: saturation is the peak of the variance, as in release 3.1"
            .to_owned()
    });
    Ok(Saturation { photons, error, signal: signal_at(data, photons), largest, note })
}

/// Photons and standard error from the share of the largest value. `None` if no level saturates.
fn by_share(data: &Ordered<'_>) -> Option<(f64, f64)> {
    let largest = data.bright.iter().map(|s| s.level.pair.largest).max()?;
    let dark = data.dark.iter().map(|d| share(&d.pair, largest)).fold(0.0, f64::max);
    let shares: Vec<f64> = data.bright.iter().map(|s| (share(&s.level.pair, largest) - dark).max(0.0)).collect();
    // A camera is saturated only if most of its pixels are.
    if *shares.last()? < 0.5 {
        return None;
    }
    let first = shares.iter().position(|s| *s > AT_LARGEST)?;
    let below = data.bright.get(first.checked_sub(1)?)?;
    let above = data.bright.get(first)?;
    let (low, high) = (below.level.photons, above.level.photons);
    let normal = Normal::standard();
    let target = normal.inverse_cdf(AT_LARGEST);
    let dark_mean = data.dark[below.dark].pair.mean.value;
    // A longer exposure has more dark current.
    let dark_growth = (data.dark[above.dark].pair.mean.value - dark_mean) / (high - low);
    let slope = (below.level.pair.mean.value - dark_mean) / low + dark_growth;
    let width = below.level.pair.spread.sqrt() / slope;
    let candidate = |i: usize| {
        let (s, n) = (shares[i], 2.0 * data.bright[i].level.pair.pixels as f64);
        (s * n >= MIN_COUNT && s <= 0.5).then(|| {
            let z = normal.inverse_cdf(s);
            let counting = (s * (1.0 - s) / (0.5 * n)).sqrt() / normal.pdf(z);
            // The width changes from level to level, by about half the relative change of the light.
            let drift = (target - z) * 0.5 * (high - low) / low;
            let at = data.bright[i].level.photons + (target - z) * width;
            (at.clamp(low, high), width * counting.hypot(drift))
        })
    };
    let best = [first - 1, first].into_iter().filter_map(candidate).min_by(|a, b| a.1.total_cmp(&b.1));
    Some(best.unwrap_or((0.5 * (low + high), (high - low) / 12f64.sqrt())))
}

fn share(pair: &crate::temporal::FramePair, largest: u16) -> f64 {
    if pair.largest == largest { pair.at_largest } else { 0.0 }
}

/// Photons and standard error from the peak of the variance: a level of the grid, with an error of about one step to
/// either side.
fn by_peak(data: &Ordered<'_>) -> Result<(f64, f64), AnalysisError> {
    let variance = |i: usize| data.bright.get(i).map_or(0.0, |s| s.level.pair.variance.value);
    let peak = (0..data.bright.len()).max_by(|a, b| variance(*a).total_cmp(&variance(*b))).unwrap_or(0);
    let last = data.bright.len() - 1;
    if peak == last || variance(last) > 0.7 * variance(peak) {
        return Err(AnalysisError::unfit(
            "the brightest level is not saturated",
            "add levels with more light, until the frames no longer become brighter (two levels or more)",
        ));
    }
    let at = |i: usize| data.bright.get(i).map_or(0.0, |s| s.level.photons);
    let step = if peak == 0 { at(1) - at(0) } else { 0.5 * (at(peak + 1) - at(peak - 1)) };
    Ok((at(peak), step / 3f64.sqrt()))
}

/// Mean grey value without dark at a number of photons, interpolated between the levels.
fn signal_at(data: &Ordered<'_>, photons: f64) -> f64 {
    let signal = |i: usize| {
        let s = &data.bright[i];
        (s.level.photons, s.level.pair.mean.value - data.dark[s.dark].pair.mean.value)
    };
    let after = data.bright.partition_point(|s| s.level.photons < photons).min(data.bright.len() - 1);
    let ((x1, y1), (x0, y0)) = (signal(after), if after > 0 { signal(after - 1) } else { (0.0, 0.0) });
    if x1 > x0 { y0 + (y1 - y0) * ((photons - x0) / (x1 - x0)) } else { y1 }
}
