//! Analysis of the finished units, read back from the folder: all data of the report, as plain data.

use super::ablation::{Bias, bias};
use super::denoised::Truth;
use super::hidden::{Price, price, share, worst_ratio};
use super::runs::{Purpose, Unit};
use super::settings::BenchSettings;
use super::statistics::{Deviations, masked_mean};
use super::store::{Record, Store};
use crate::report::estimate::{Estimate, mean};
use crate::series::statistics::rank_correlation;
use crate::series::{View, exposure_words};
use dunkelfeld::adaptive::Strategy;
use dunkelfeld::film::Plane;
use dunkelfeld::scene::Effect;
use dunkelfeld::{Error, RenderSettings};
use dunkelfeld_report::words::rounded;
use std::collections::BTreeMap;

/// Data of a bench except its settings and units.
pub(super) struct About<'a> {
    pub(super) name: String,
    pub(super) threads: usize,
    /// Number of finished units, and of all.
    pub(super) finished: [usize; 2],
    pub(super) effects: &'a [Effect],
    /// Denoisers: name in tables, name with version.
    pub(super) denoisers: Vec<(&'static str, String)>,
    pub(super) reference: Unit,
}

/// One point of the charts: a strategy at a number of samples, with a denoiser or without.
#[derive(Clone, Debug)]
pub(super) struct Point {
    pub(super) strategy: Strategy,
    /// The denoiser of the image. [`OFF`] if none.
    pub(super) denoiser: &'static str,
    /// Samples per pixel, on average.
    pub(super) spp: u32,
    /// Number of its renders.
    pub(super) seeds: usize,
    /// Seconds of rendering and denoising of one of them.
    pub(super) seconds: Estimate,
    /// Mean variance between the renders: of the 8-bit picture, of the linear signal, and over the sensor's own.
    pub(super) picture: Estimate,
    pub(super) signal: Estimate,
    pub(super) ratio: Option<Estimate>,
    /// Mean squared error against the truth, from noise and bias: of the linear signal, over the sensor's variance if
    /// there is one. Only if denoisers are compared and the largest sample count has enough renders.
    pub(super) squared_error: Option<Estimate>,
    /// The variance that each render estimates from its own samples, over the measured variance. Undefined for a
    /// denoised image.
    pub(super) stated: f64,
    /// Share of the pixels hidden at one half.
    pub(super) hidden: Option<f64>,
}

/// Data of a strategy at the largest sample count.
#[derive(Clone, Debug)]
pub(super) struct Top {
    pub(super) strategy: Strategy,
    pub(super) spp: u32,
    /// Samples per pixel of the first render.
    pub(super) counts: Plane<u32>,
    /// Variance between the renders, of the 8-bit picture [DN^2].
    pub(super) picture_variance: Plane<f64>,
    /// The signal of the first render.
    pub(super) signal: Plane<f32>,
    /// Seconds by stage: means over the renders; exposing and writing of the first.
    pub(super) stages: Vec<(String, f64)>,
    /// Share of the lanes of each stage that had work: means over the renders.
    pub(super) lanes: BTreeMap<String, f64>,
    pub(super) prices: Vec<Price>,
}

/// Images of a denoiser for the renders of a point, with and without it.
#[derive(Clone, Debug)]
pub(super) struct Look {
    pub(super) strategy: Strategy,
    pub(super) denoiser: &'static str,
    pub(super) spp: u32,
    /// Variance between the renders, of the 8-bit picture [DN^2].
    pub(super) picture_variance: Plane<f64>,
    /// The signal of the first render.
    pub(super) signal: Plane<f32>,
}

/// A scene without one of its effects.
#[derive(Clone, Debug)]
pub(super) struct Ablation {
    pub(super) effect: Effect,
    /// Seconds saved without the effect, and seconds of a render with all effects.
    pub(super) saved: Estimate,
    pub(super) whole: Estimate,
    pub(super) bias: Bias,
    pub(super) seeds: usize,
}

/// All data of the report.
pub(super) struct Results {
    pub(super) name: String,
    pub(super) program: String,
    pub(super) size: [u32; 2],
    pub(super) seed: u64,
    pub(super) seeds: u32,
    pub(super) threads: usize,
    pub(super) camera: String,
    pub(super) settings: BenchSettings,
    pub(super) finished: [usize; 2],
    /// Points of renders without denoising.
    pub(super) points: Vec<Point>,
    /// Denoisers: name in tables, name with version.
    pub(super) denoisers: Vec<(&'static str, String)>,
    /// Points with and without each denoiser, by strategy; empty if there are none.
    pub(super) denoised: Vec<Point>,
    pub(super) looks: Vec<Look>,
    pub(super) tops: Vec<Top>,
    pub(super) ablations: Vec<Ablation>,
    pub(super) reference: Plane<f32>,
    pub(super) pilot: Option<(u32, Plane<f32>)>,
    /// Sobel magnitude of the pilot, and its rank correlation with the variance of the uniform picture.
    pub(super) sobel: Option<(Plane<f32>, f64)>,
    pub(super) unsaturated: f64,
    pub(super) view: View,
}

impl Results {
    /// Reads the finished units. `None` as long as there is no reference.
    pub(super) fn gather(
        store: &Store,
        settings: &BenchSettings,
        render: &RenderSettings,
        about: &About<'_>,
    ) -> Result<Option<Self>, Error> {
        let base = render.seed;
        if store.record(&about.reference, base)?.is_none() {
            return Ok(None);
        }
        let radiance = store.radiance(&about.reference)?;
        let view = View::new(&render.sensor, &radiance)?;
        let reference = view.signal(&radiance);
        let counts = view.unsaturated(&reference);
        let s = view.sensor_variance(&reference);
        let reader = Reader { store, base, settings, view: &view, counts: &counts, s: s.as_ref() };

        let mut points = Vec::new();
        let mut tops = Vec::new();
        let highest = settings.ladder().last().copied();
        for &strategy in settings.strategies() {
            for &spp in settings.ladder() {
                let Some(measured) = reader.point(strategy, spp, OFF)? else { continue };
                if Some(spp) == highest {
                    tops.push(reader.top(&measured)?);
                }
                points.push(measured.point);
            }
        }
        let (denoised, looks) = reader.denoised(&about.denoisers, &reference)?;
        let pilot = Unit { purpose: Purpose::Pilot, spp: render.pilot_spp, index: 0 };
        let pilot = match store.record(&pilot, base)? {
            Some(_) => Some((render.pilot_spp, store.signal(&pilot)?)),
            None => None,
        };
        let sobel = pilot.as_ref().map(|(_, pilot)| {
            let sobel = view.sobel(pilot);
            let steep: Vec<f64> = sobel.data().iter().map(|&v| f64::from(v)).collect();
            let plain = tops.iter().find(|t: &&Top| t.strategy == Strategy::Uniform);
            (sobel, plain.map_or(f64::NAN, |t| rank_correlation(&steep, t.picture_variance.data())))
        });
        Ok(Some(Self {
            name: about.name.clone(),
            program: format!("dunkelfeld {}", env!("CARGO_PKG_VERSION")),
            size: [render.width, render.height],
            seed: base,
            seeds: settings.seeds(),
            threads: about.threads,
            camera: exposure_words(&view, &reference),
            settings: settings.clone(),
            finished: about.finished,
            points,
            denoisers: about.denoisers.clone(),
            denoised,
            looks,
            tops,
            ablations: reader.ablations(about.effects)?,
            unsaturated: counts.iter().filter(|c| **c).count() as f64 / counts.len().max(1) as f64,
            reference,
            pilot,
            sobel,
            view,
        }))
    }

    /// The findings as a few lines of text.
    pub(super) fn findings(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if !self.has_light() {
            lines.push("no light: the image is black, so that there is no noise to hide or to compare".into());
        }
        let best = |k: f64| {
            let at = self.tops.iter().filter_map(|t| t.prices.iter().find(|p| p.k == k).map(|p| p.seconds.value));
            at.fold(f64::INFINITY, f64::min)
        };
        let k = self.headline_level();
        for top in &self.tops {
            if let Some(price) = top.prices.iter().find(|p| p.k == k && p.seconds.value > 0.0) {
                let over_best = price.seconds.value / best(k);
                let compared = if over_best.is_finite() && !price.is_beyond_reach() {
                    format!(" ({over_best:.1} x the best)")
                } else {
                    String::new()
                };
                let [time, spp] = price.words();
                lines.push(format!(
                    "{}: hidden at k = {k} after {}{spp} samples per pixel, {time}{compared}",
                    top.strategy,
                    if price.is_beyond_reach() { "" } else { "about " },
                ));
            }
        }
        if let Some(lanes) = self.tops.first().map(|top| &top.lanes).filter(|lanes| !lanes.is_empty()) {
            let shares = lanes.iter().map(|(stage, share)| format!("{stage} {:.0} %", 100.0 * share));
            lines.push(format!("lanes with work: {}", shares.collect::<Vec<_>>().join(", ")));
        }
        for a in &self.ablations {
            if let Some(verdict) = a.bias.verdict {
                lines.push(format!(
                    "without {}: {:+.0} % of the time; visible to this camera? {} (99 % of pixels within {} sigma)",
                    a.effect.name(),
                    -100.0 * a.saved.value / a.whole.value,
                    verdict.words(),
                    rounded(a.bias.p99_sigma)
                ));
            }
        }
        lines
    }

    /// Does any pixel of the reference have light?
    pub(super) fn has_light(&self) -> bool {
        self.reference.data().iter().any(|v| *v > 0.0)
    }

    /// The level k of the main findings: one half if it is among the requested levels.
    pub(super) fn headline_level(&self) -> f64 {
        let levels = self.settings.levels();
        levels.iter().copied().find(|k| *k == 0.5).or(levels.first().copied()).unwrap_or(0.5)
    }
}

/// The denoiser entry of renders without denoising.
pub(super) const OFF: &str = "off";

/// The strategy of the comparison of denoisers: the default one of renders if it is available.
pub(super) fn shown_strategy(strategies: &[Strategy]) -> Option<Strategy> {
    strategies.iter().copied().find(|s| *s == Strategy::Sensor).or(strategies.first().copied())
}

/// A point with its renders: the spread of their pictures and of their signals, and the signals.
struct Measured {
    point: Point,
    picture: Deviations,
    signal: Deviations,
    signals: Vec<Plane<f32>>,
}

/// Reads units of a folder.
struct Reader<'a> {
    store: &'a Store,
    base: u64,
    settings: &'a BenchSettings,
    view: &'a View,
    counts: &'a [bool],
    s: Option<&'a Plane<f64>>,
}

impl Reader<'_> {
    fn finished(&self, purpose: Purpose, spp: u32) -> Result<Vec<(Unit, Record)>, Error> {
        let mut found = Vec::new();
        for index in 0..self.settings.seeds() {
            let unit = Unit { purpose, spp, index };
            if let Some(record) = self.store.record(&unit, self.base)? {
                found.push((unit, record));
            }
        }
        Ok(found)
    }

    fn signals(&self, units: &[(Unit, Record)], denoiser: &str) -> Result<Vec<Plane<f32>>, Error> {
        let signal = |unit| if denoiser == OFF { self.store.signal(unit) } else { self.store.denoised(unit, denoiser) };
        units.iter().map(|(unit, _)| signal(unit)).collect()
    }

    /// A point with its spread; `None` with fewer than three renders.
    fn point(&self, strategy: Strategy, spp: u32, denoiser: &'static str) -> Result<Option<Measured>, Error> {
        let units = self.finished(Purpose::Point(strategy), spp)?;
        let signals = self.signals(&units, denoiser)?;
        let pictures: Vec<Plane<f32>> = signals.iter().map(|p| self.view.picture(p).map(|&v| f32::from(v))).collect();
        let (Some(picture), Some(signal)) = (Deviations::of(&pictures), Deviations::of(&signals)) else {
            return Ok(None);
        };
        let denoising = |r: &Record| r.denoise_seconds.get(denoiser).copied().unwrap_or(0.0);
        let seconds: Vec<f64> = units.iter().map(|(_, r)| r.total_seconds + denoising(r)).collect();
        let stated: Vec<f64> = units.iter().filter_map(|(_, r)| r.stated_variance).collect();
        let is_off = denoiser == OFF;
        let all = vec![true; self.counts.len()];
        let linear = signal.jackknife(|v| masked_mean(v, self.counts));
        let ratio = self.s.map(|s| {
            signal.jackknife(|v| {
                let mut v = v.clone();
                v.data_mut().iter_mut().zip(s.data()).for_each(|(v, s)| *v /= s);
                masked_mean(&v, self.counts)
            })
        });
        let point = Point {
            strategy,
            denoiser,
            spp,
            seeds: units.len(),
            seconds: mean(&seconds),
            picture: picture.jackknife(|v| masked_mean(v, &all)),
            signal: linear,
            ratio,
            squared_error: None,
            stated: if is_off { mean(&stated).value / linear.value } else { f64::NAN },
            hidden: self.s.filter(|_| is_off).map(|s| share(&signal.variance(), s, self.counts, 0.5)),
        };
        Ok(Some(Measured { point, picture, signal, signals }))
    }

    fn top(&self, Measured { point, picture, signal, .. }: &Measured) -> Result<Top, Error> {
        let units = self.finished(Purpose::Point(point.strategy), point.spp)?;
        let first = Unit { purpose: Purpose::Point(point.strategy), spp: point.spp, index: 0 };
        let counts = self.store.sample_counts(&first)?;
        let worst = self.s.map(|s| worst_ratio(signal, s, self.counts));
        let prices = worst.map_or(Vec::new(), |worst| {
            let levels = self.settings.levels().iter();
            levels.map(|&k| price(k, worst, f64::from(point.spp), point.seconds)).collect()
        });
        Ok(Top {
            strategy: point.strategy,
            spp: point.spp,
            counts,
            picture_variance: picture.variance(),
            signal: self.store.signal(&first)?,
            stages: stages(&units),
            lanes: lanes(&units),
            prices,
        })
    }

    /// Points with and without each denoiser, and their images at the smallest and the largest sample count.
    fn denoised(
        &self,
        denoisers: &[(&'static str, String)],
        reference: &Plane<f32>,
    ) -> Result<(Vec<Point>, Vec<Look>), Error> {
        let (mut points, mut looks) = (Vec::new(), Vec::new());
        let (Some(&lowest), Some(&highest)) = (self.settings.ladder().first(), self.settings.ladder().last()) else {
            return Ok((points, looks));
        };
        if denoisers.is_empty() {
            return Ok((points, looks));
        }
        let shown = shown_strategy(self.settings.strategies());
        for &strategy in self.settings.strategies() {
            let top = self.signals(&self.finished(Purpose::Point(strategy), highest)?, OFF)?;
            let truth = Truth::new(reference, &top, self.counts, self.s);
            for key in [OFF].into_iter().chain(denoisers.iter().map(|d| d.0)) {
                for &spp in self.settings.ladder() {
                    let Some(measured) = self.point(strategy, spp, key)? else { continue };
                    let Measured { mut point, picture, signals, .. } = measured;
                    point.squared_error = truth.as_ref().map(|t| t.error(&signals, spp == highest));
                    if Some(strategy) == shown && (spp == lowest || spp == highest) {
                        let picture_variance = picture.variance();
                        let look = |signal| Look { strategy, denoiser: key, spp, picture_variance, signal };
                        looks.extend(signals.into_iter().next().map(look));
                    }
                    points.push(point);
                }
            }
        }
        Ok((points, looks))
    }

    fn ablations(&self, effects: &[Effect]) -> Result<Vec<Ablation>, Error> {
        let spp = self.settings.effect_spp();
        let mut whole = self.finished(Purpose::Effects(None), spp)?;
        whole.truncate(whole.len() / 2 * 2);
        let signals = self.signals(&whole, OFF)?;
        let mut found = Vec::new();
        for &effect in effects {
            let mut units = self.finished(Purpose::Effects(Some(effect)), spp)?;
            units.truncate(whole.len().min(units.len()) / 2 * 2);
            let with = &whole[..units.len()];
            // Two seeds determine a difference, but not its standard error.
            if units.len() < 4 || units.iter().zip(with).any(|(a, b)| a.0.index != b.0.index) {
                continue;
            }
            let white = self.view.white();
            let Some(bias) = bias(&signals[..units.len()], &self.signals(&units, OFF)?, white, self.s) else {
                continue;
            };
            let seconds = |units: &[(Unit, Record)]| units.iter().map(|(_, r)| r.total_seconds).collect::<Vec<_>>();
            let (a, b) = (seconds(with), seconds(&units));
            let saved: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
            found.push(Ablation { effect, saved: mean(&saved), whole: mean(&a), bias, seeds: units.len() });
        }
        Ok(found)
    }
}

/// Mean seconds by stage, in the order of the stages in a render. A stage that was timed only once counts once.
fn stages(units: &[(Unit, Record)]) -> Vec<(String, f64)> {
    ["pilot", "plan", "refine", "expose", "write"]
        .into_iter()
        .filter_map(|stage| {
            let all: Vec<f64> = units.iter().filter_map(|(_, r)| r.seconds.get(stage).copied()).collect();
            (!all.is_empty()).then(|| (stage.to_string(), mean(&all).value))
        })
        .collect()
}

/// Mean share of the lanes of each stage that had work.
fn lanes(units: &[(Unit, Record)]) -> BTreeMap<String, f64> {
    let names = units.first().map(|(_, record)| record.lanes.keys().cloned()).into_iter().flatten();
    let share = |name: &String| {
        let all: Vec<f64> = units.iter().filter_map(|(_, record)| record.lanes.get(name).copied()).collect();
        mean(&all).value
    };
    names.map(|name| (name.clone(), share(&name))).collect()
}
