//! A measurement: levels of light, dark levels, and stacks. The frames of each are reduced to statistics when they are
//! read.

use derive_setters::Setters;
use serde::Serialize;
use std::borrow::Cow;

use crate::frame::{AnalysisError, common_step};
use crate::stack::SpatialStack;
use crate::temporal::FramePair;

/// Exposure times whose relative difference is below this are the same.
const SAME_TIME: f64 = 1e-6;

/// Two frames with the same light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Exposure time \[s\].
    pub exposure: f64,
    /// Mean number of photons per pixel, mu_p. Zero in the dark.
    pub photons: f64,
    /// Statistics of the two frames.
    pub pair: FramePair,
}

/// A stack of frames with the same light.
#[derive(Clone, Debug, PartialEq)]
pub struct StackLevel {
    /// Exposure time \[s\].
    pub exposure: f64,
    /// Mean number of photons per pixel, mu_p. Zero in the dark.
    pub photons: f64,
    /// Statistics of the frames.
    pub stack: SpatialStack,
}

/// A whole measurement. The order of the levels does not matter.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measurement {
    /// Bits per grey value. `None` takes the smallest even number, from 8 on, that can represent the largest value.
    pub bits: Option<u32>,
    /// Pairs of frames. Those without photons are dark.
    pub levels: Vec<Level>,
    /// Stacks of frames: one in the dark, one at half of saturation.
    pub stacks: Vec<StackLevel>,
}

/// The release of EMVA 1288 whose rules are used, if the releases differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub enum Release {
    /// 3.1 (2016): saturation is the peak of the variance.
    #[serde(rename = "3.1")]
    R31,
    /// 4.0 (2021): saturation is the light at which 0.1 to 0.2 % of the pixels have the largest value.
    #[default]
    #[serde(rename = "4.0")]
    R40,
}

/// Settings of an analysis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct AnalysisSettings {
    /// The rules.
    pub release: Release,
    /// Distance between pixel centres \[um\], for figures per area.
    #[setters(into)]
    pub pixel_pitch: Option<f64>,
}

/// A level with the index of its dark level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sorted<'a> {
    pub(crate) level: &'a Level,
    /// Index of the dark level of its exposure time.
    pub(crate) dark: usize,
}

/// The levels in order, each with its dark level.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Ordered<'a> {
    /// By ascending photons.
    pub(crate) bright: Vec<Sorted<'a>>,
    /// By ascending exposure time.
    pub(crate) dark: Vec<&'a Level>,
    pub(crate) bits: u32,
    /// The bright and the dark stack of one exposure time.
    pub(crate) stacks: Option<(&'a StackLevel, &'a StackLevel)>,
}

pub(crate) fn same_time(a: f64, b: f64) -> bool {
    (a - b).abs() <= SAME_TIME * a.abs().max(b.abs())
}

impl Measurement {
    /// The measurement in steps of its grey values, and a note. If all values are multiples of a number above 1, as those
    /// that are stored left-aligned, that number is the step to which rounding and all rules in DN refer.
    pub(crate) fn in_steps(&self) -> (Cow<'_, Self>, Option<String>) {
        let of_stacks = self.stacks.iter().map(|s| s.stack.step);
        let step = self.levels.iter().map(|l| l.pair.step).chain(of_stacks).fold(0, common_step);
        if step < 2 {
            return (Cow::Borrowed(self), None);
        }
        let largest = |bits: u32| ((1u32 << bits.min(16)) - 1) / u32::from(step);
        let measurement = Self {
            bits: self.bits.map(|bits| 32 - largest(bits).leading_zeros()),
            levels: self.levels.iter().map(|l| Level { pair: l.pair.in_steps(step), ..*l }).collect(),
            stacks: self.stacks.iter().map(|s| StackLevel { stack: s.stack.in_steps(step), ..*s }).collect(),
        };
        let note = format!(
            "all grey values are multiples of {step}, so they are stored left-aligned or scaled: they were divided by {step}, \
             and K and all figures in DN are those of the quotients; store values right-aligned"
        );
        (Cow::Owned(measurement), Some(note))
    }

    /// Sorts bright levels by light and dark levels by time, and finds the dark level of each bright one.
    pub(crate) fn ordered(&self) -> Result<Ordered<'_>, AnalysisError> {
        let (mut bright, mut dark): (Vec<&Level>, Vec<&Level>) = self.levels.iter().partition(|l| l.photons > 0.0);
        if bright.is_empty() {
            return Err(AnalysisError::unfit(
                "there is no pair of frames with light",
                "add blocks of two frames each, at 50 or more levels from dark to saturation",
            ));
        }
        if dark.is_empty() {
            return Err(AnalysisError::unfit(
                "there is no pair of dark frames",
                "add a block of two frames without light for every exposure time",
            ));
        }
        bright.sort_by(|a, b| a.photons.total_cmp(&b.photons));
        dark.sort_by(|a, b| a.exposure.total_cmp(&b.exposure));
        let with_dark = |level: &'_ Level| {
            dark.iter().position(|d| same_time(d.exposure, level.exposure)).ok_or_else(|| {
                AnalysisError::unfit(
                    format!("the exposure time of {} ns has no dark frames", 1e9 * level.exposure),
                    "add a block of two frames without light with that exposure time",
                )
            })
        };
        let bright: Vec<Sorted<'_>> = bright
            .into_iter()
            .map(|level| Ok(Sorted { level, dark: with_dark(level)? }))
            .collect::<Result<_, AnalysisError>>()?;
        let largest = self.levels.iter().map(|l| l.pair.largest).max().unwrap_or(0);
        let needed = (16 - largest.leading_zeros()).max(8);
        let bits = self.bits.unwrap_or(needed + needed % 2);
        if needed > bits.max(8) {
            return Err(AnalysisError::unfit(
                format!("a frame holds the value {largest}, which is too large for {bits} bits"),
                "correct the number of bits, or store values right-aligned: 12 bits end at 4095",
            ));
        }
        Ok(Ordered { bright, dark, bits, stacks: self.stack_pair()? })
    }

    /// The bright and the dark stack. With several bright ones the caller must choose, since the light of half
    /// saturation is not known here.
    fn stack_pair(&self) -> Result<Option<(&StackLevel, &StackLevel)>, AnalysisError> {
        let bright: Vec<&StackLevel> = self.stacks.iter().filter(|s| s.photons > 0.0).collect();
        let (bright, others) = match bright.split_first() {
            None if self.stacks.is_empty() => return Ok(None),
            None => {
                return Err(AnalysisError::unfit(
                    "there is a stack of dark frames but none with light",
                    "add a block of 16 or more frames at half of saturation, with the exposure time of the dark stack",
                ));
            }
            Some((first, others)) => (*first, others),
        };
        if !others.is_empty() {
            return Err(AnalysisError::unfit(
                format!("there are {} stacks of frames with light", others.len() + 1),
                "keep one block of more than two frames with light, at half of saturation; levels have two frames each",
            ));
        }
        let dark = self.stacks.iter().find(|s| s.photons <= 0.0 && same_time(s.exposure, bright.exposure));
        let dark = dark.ok_or_else(|| {
            AnalysisError::unfit(
                format!(
                    "the stack with light has an exposure time of {} ns, and no dark stack has",
                    1e9 * bright.exposure
                ),
                "add a block of 16 or more frames without light with that exposure time",
            )
        })?;
        dark.stack.same_size(&bright.stack)?;
        Ok(Some((bright, dark)))
    }
}
