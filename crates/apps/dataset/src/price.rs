//! The price of a set by its first images: core-hours, images per hour, and the noise of the renders that they buy.

use crate::record::{CertificateRecord, Cost, Record};
use dunkelfeld_report::words::{counted, rounded};
use serde::Serialize;
use std::fmt::{self, Display, Formatter};

/// The price of a set, estimated from some of its images.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Price {
    /// Images that it is estimated from.
    pub measured: u64,
    /// Images of the set.
    pub count: u64,
    /// Images that all jobs of the run make in an hour.
    pub images_per_hour: f64,
    /// Half the price if it buys any samples, the price of the study, and twice that.
    pub levels: Vec<PriceLevel>,
}

/// A price of a set, and what it buys.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PriceLevel {
    /// The price over that of the study.
    pub factor: f64,
    /// Time of the whole set \[h\] times the cores of an image.
    pub core_hours: f64,
    /// Samples over those of the study. Only the time of samples and their plan changes.
    pub samples: f64,
    /// Level k at which an image is hidden (99 % of its unsaturated pixels): the root of the mean over images of the `p99` of
    /// their worst capture. Noise falls with the root of the samples; with scrambled Sobol' points it falls at least as fast. `None`
    /// without a sensor, and if a variance is unknown.
    pub k: Option<f64>,
}

impl Price {
    /// The noise of each level, as a part of a sentence. `None` if it is unknown.
    pub(crate) fn noise(&self) -> Option<String> {
        let words = |level: &PriceLevel| {
            let k = rounded(level.k?);
            Some(match level.factor {
                f if f < 1.0 => format!("at half the price at k = {k}"),
                f if f > 1.0 => format!("at twice the price at k = {k}"),
                _ => format!("99 % of the pixels are hidden at k = {k}"),
            })
        };
        let mut levels: Vec<&PriceLevel> = self.levels.iter().collect();
        levels.sort_by_key(|level| level.factor != 1.0);
        let parts: Option<Vec<String>> = levels.into_iter().map(words).collect();
        parts.map(|parts| parts.join(", "))
    }
}

impl Display for Price {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let own = self.levels.iter().find(|level| level.factor == 1.0).map_or(0.0, |level| level.core_hours);
        let (count, rate) = (counted(self.count, "image"), rounded(self.images_per_hour));
        write!(f, "the set of {count} costs {} core-hours, at {rate} images an hour", rounded(own))?;
        self.noise().map_or(Ok(()), |noise| write!(f, "; {noise}"))
    }
}

/// Sums over images.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Measured {
    images: u64,
    /// Time of all stages, and that of the samples and their plan \[s\].
    total: f64,
    render: f64,
    /// Sum of the ratios of the noise; `None` as soon as one is unknown.
    ratio: Option<f64>,
}

impl Measured {
    pub(crate) fn add(&mut self, cost: &Cost, record: &Record) {
        let worst = |all: &mut dyn Iterator<Item = &CertificateRecord>| {
            all.map(|certificate| certificate.p99).try_fold(0.0, |worst: f64, p99| Some(worst.max(p99?)))
        };
        let captures = record.captures.values().filter_map(|capture| capture.certificate.as_ref());
        let ratio = record.certificate.as_ref().and_then(|own| worst(&mut std::iter::once(own).chain(captures)));
        let before = if self.images == 0 { Some(0.0) } else { self.ratio };
        self.ratio = before.zip(ratio).map(|(sum, ratio)| sum + ratio);
        self.images += 1;
        self.total += cost.total;
        self.render += cost.render + cost.plan;
    }

    /// The price of a set of `count` images, of which `jobs` are made at a time, each by `cores`. `None` without an image.
    pub(crate) fn price(&self, count: u64, jobs: usize, cores: usize) -> Option<Price> {
        let images = self.images as f64;
        let (seconds, render) = (self.total / images, self.render / images);
        if self.images == 0 || seconds <= 0.0 || render <= 0.0 {
            return None;
        }
        let level = |factor: f64| {
            // The rest of an image has a fixed price.
            let samples = 1.0 + (factor - 1.0) * seconds / render;
            let core_hours = factor * seconds * cores as f64 * count as f64 / 3600.0;
            let k = self.ratio.map(|sum| (sum / images / samples).sqrt());
            PriceLevel { factor, core_hours, samples, k }
        };
        let levels = [0.5, 1.0, 2.0].map(level).into_iter().filter(|level| level.samples > 0.0).collect();
        Some(Price { measured: self.images, count, images_per_hour: 3600.0 * jobs as f64 / seconds, levels })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests as fake;

    /// Two images of 10 s and 30 s, of which 4 s and 12 s are samples: 40 % of the time.
    #[test]
    fn twice_the_price_buys_more_than_twice_the_samples() {
        let mut measured = Measured::default();
        assert_eq!(measured.price(100, 2, 1), None);
        for (scale, p99) in [(1.0, 0.5), (3.0, 0.3)] {
            let mut record = fake::record(0);
            record["certificate"]["p99"] = p99.into();
            let cost = Cost { render: 3.0 * scale, plan: scale, total: 10.0 * scale, ..Cost::default() };
            measured.add(&cost, &serde_json::from_value(record).expect("a record"));
        }
        let price = measured.price(90, 2, 3).expect("a price");
        assert_eq!((price.measured, price.count, price.images_per_hour), (2, 90, 360.0));
        // 90 images of 20 s on 3 cores are 1.5 h. Half of that buys no samples: they are 8 s of 20 s.
        let [own, twice] = price.levels[..] else { panic!("{price:?}") };
        assert_eq!((own.factor, own.core_hours, own.samples), (1.0, 1.5, 1.0));
        assert_eq!((twice.factor, twice.core_hours, twice.samples), (2.0, 3.0, 3.5));
        // The mean of the ratios is 0.4.
        let k = |level: PriceLevel| level.k.expect("a level");
        assert!((k(own).powi(2) - 0.4).abs() < 1e-12 && (k(twice).powi(2) - 0.4 / 3.5).abs() < 1e-12);
        let words = "the set of 90 images costs 1.50 core-hours, at 360 images an hour; 99 % of the pixels are hidden at \
            k = 0.632, at twice the price at k = 0.338";
        assert_eq!(price.to_string(), words);
        // An unknown variance.
        let mut record = fake::record(0);
        record["certificate"]["p99"] = serde_json::Value::Null;
        measured.add(&Cost { total: 1.0, ..Cost::default() }, &serde_json::from_value(record).expect("a record"));
        assert!(measured.price(90, 1, 1).expect("a price").levels.iter().all(|level| level.k.is_none()));
    }
}
