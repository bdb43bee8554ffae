//! Differences between a measurement and the requirements of the standard, in sentences that name the affected figures.

use crate::hidden::Hidden;
use crate::histogram::Histogram;
use crate::measurement::Ordered;
use crate::summary::{Is, RESULTS, Summary};

/// The requirements of the standard.
const LEVELS: usize = 50;
const STACK: u32 = 16;
const EXPOSURES: usize = 6;
/// If a larger share of dark values is zero, the lower part of the noise is cut off.
const AT_ZERO: f64 = 0.005;

/// The notes for a linear camera.
pub(crate) fn linear(data: &Ordered<'_>, summary: &Summary, hidden: &Hidden) -> Vec<String> {
    let mut notes = Vec::new();
    notes.extend(few_levels(data));
    if summary.is_bound {
        notes.push(rounding(data, "sigma_d, sigma_y.dark, mu_e.min and mu_p.min"));
    }
    if let Some([low, high]) = hidden.gains() {
        notes.push(format!(
            "the dark variance of levels in the regression for K is below 0.24 DN^2, so that it need not hold the 1/12 of rounding that the \
             bright levels have: K lies between {low:.5} and {high:.5} DN/e-, whatever its standard error, and with it err eta, mu_e.sat, \
             SNR_max, mu_I.mean, mu_I.var and DSNU1288; a larger gain would help it"
        ));
    }
    if hidden.has_dsnu() {
        notes.push(
            "differences between dark pixels are below what rounding shows: DSNU1288 and its parts are upper bounds, and PRNU1288 errs by \
             what of them is hidden"
                .into(),
        );
    }
    notes.extend(cut_off(data, "sigma_d, mu_e.min and mu_p.min come out too small, K and DR too large"));
    match summary.exposures() {
        n if n < crate::summary::MIN_EXPOSURES => {
            notes.push(format!(
                "{n} exposure time(s) do not determine the dark current; the standard requires {EXPOSURES}"
            ));
        }
        n if n < EXPOSURES => {
            notes.push(format!("the dark current is from {n} exposure times, the standard requires {EXPOSURES}"));
        }
        _ => {}
    }
    match data.stacks {
        None => notes.push("there are no stacks of frames: nonuniformity was not measured".into()),
        Some((bright, dark)) => {
            let least = bright.stack.frames.min(dark.stack.frames);
            if least < STACK {
                notes.push(format!("a stack has {least} frames, the standard requires {STACK}"));
            }
            let share = bright.photons / summary.saturation.value;
            if !(0.4..=0.6).contains(&share) {
                notes.push(format!(
                    "the bright stack is at {:.0} % of saturation, the standard requires 50 %",
                    100.0 * share
                ));
            }
        }
    }
    notes
}

/// The note on a response that changes smoothly over the image. The standard errors of the nonuniformity do not contain
/// the shape of the light.
///
/// Of independent pixels, the high-pass filter of the histogram keeps 24/25 of the variance, and of rows and columns 4/5.
/// It keeps nearly nothing of what is smooth. The variance of the pixels is known from the split.
pub(crate) fn uneven(
    summary: &Summary,
    results: &[f64; RESULTS],
    errors: &[f64; RESULTS],
    response: &Histogram,
) -> Option<String> {
    let (bright, dark, _) = summary.spatial.as_ref()?;
    let noise =
        [bright, dark].map(|s| s.temporal.value / s.frames).iter().sum::<f64>() / (bright.mean - dark.mean).powi(2);
    let filtered = (response.deviation / 100.0).powi(2) - 0.96 * noise;
    let [all, pixels] = [Is::Prnu2, Is::PrnuPixel2].map(|is| results[is as usize]);
    let even = (filtered / 0.8 - (0.96 / 0.8 - 1.0) * pixels).max(0.0);
    // The parts of rows and columns in both estimates are of the same rows and columns.
    let is_uneven = all - even > 4.0 * errors[Is::Prnu2 as usize] && even < 0.9 * all;
    is_uneven.then(|| {
        format!(
            "the response changes smoothly over the image, by uneven light or by the camera: PRNU1288 is {:.3} % with \
             that, and {:.3} % after the high-pass filter of 5 x 5 pixels; it is also in PRNU1288.row and PRNU1288.col; \
             take the stacks in more even light",
            100.0 * all.sqrt(),
            100.0 * even.sqrt()
        )
    })
}

/// The notes for the general module. `is_bound` is true if rounding hides the dark noise.
pub(crate) fn general(data: &Ordered<'_>, is_bound: bool) -> Vec<String> {
    let mut notes: Vec<String> = few_levels(data).into_iter().collect();
    if is_bound {
        notes.push(rounding(data, "sigma_p.dark and mu_p.min"));
    }
    notes.extend(cut_off(data, "sigma_p.dark and mu_p.min come out too small, DR too large"));
    notes
}

/// Returns whether so many dark values are zero that the lower part of the noise is cut off.
pub(crate) fn is_cut_off(data: &Ordered<'_>) -> bool {
    at_zero(data) > AT_ZERO
}

fn at_zero(data: &Ordered<'_>) -> f64 {
    data.dark.iter().map(|d| d.pair.at_zero).fold(0.0, f64::max)
}

fn few_levels(data: &Ordered<'_>) -> Option<String> {
    let levels = data.bright.len();
    (levels < LEVELS).then(|| format!("there are {levels} levels of light, the standard requires {LEVELS}"))
}

fn rounding(data: &Ordered<'_>, figures: &str) -> String {
    let what = match is_cut_off(data) {
        false => format!("{figures} are upper bounds, and DR is a lower one"),
        true => format!("it is set to that, but with dark values cut off at zero {figures} and DR are not even bounds"),
    };
    format!("the dark variance is below 0.24 DN^2, where rounding rules: {what}; a larger gain would show them")
}

fn cut_off(data: &Ordered<'_>, what: &str) -> Option<String> {
    is_cut_off(data).then(|| {
        let share = 100.0 * at_zero(data);
        format!("{share:.1} % of the dark values are zero, the standard allows 0.5 %: {what}; raise the black level")
    })
}
