//! The forecast of a run with a time: pilots of test images before the first image of the set.

use crate::make::{Prepared, Worker};
use crate::record::Record;
use crate::study::Study;
use crate::time_shares::TimeShares;
use dunkelfeld::{Cancel, Error, PilotForecast, Progress, ProgressState, render};
use dunkelfeld_scene::FilmWindow;
use std::sync::Arc;
use std::time::Instant;

/// Most test images.
const TESTS: usize = 3;
/// Samples per pixel of a pilot at least: with less, the estimates of the noise are too uncertain.
const PILOT_SPP: u32 = 16;
/// A pilot is followed by one with a quarter of its samples, which gives the trend of the estimates.
const FIRST: u32 = 4;
/// Samples per pixel of a pilot at most, as a share of those of the image: that of the pilot of a render.
const PILOT_SHARE: f64 = 0.2;
/// Pixels of a pilot at least: one in a hundred of them decides.
const LEAST_PIXELS: f64 = 576.0;
/// Largest share of the time of the set that the pilots take.
const ALLOWANCE: f64 = 0.02;
/// With less for each image \[s\], the pilots may take a tenth of the time of the set, and at most 0.4 s.
const SHORT: f64 = 1.0;
const SHORT_ALLOWANCE: (f64, f64) = (0.1, 0.4);
/// The part of the allowance for which the pilots are sized. The speed of the machine is known from a short measurement.
const AIM: f64 = 0.6;
/// Expected analysis of both on one thread \[s per pixel\].
const ANALYSIS: f64 = 15e-6;
/// Samples per second of a thread if they have not been measured.
const UNKNOWN_RATE: f64 = 1e5;
/// Time in which a render measures the duration of its exposure, over that duration: an eighth of the rows, four times.
const DRY_RUNS: f64 = 0.5;

/// The result of a time for the whole set, from pilots of test images before the first image: those of the first missing
/// image, and in sets of 12 and more missing images also of the middle and the last one.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SetForecast {
    /// Images that the run shall make.
    pub count: u64,
    /// Number of test images.
    pub images: u64,
    /// Budget of the render of an image \[s\].
    pub seconds: f64,
    /// Expected mean samples per pixel of the test images; 0 without one.
    pub spp: f64,
    /// Expected seconds from the start of the run to its end.
    pub end: f64,
    /// For each test image whose level is known, the k at which 99 % of its unsaturated pixels will be hidden.
    pub levels: Vec<f64>,
    /// The reason for a test image without a level; that of the last such image.
    pub gap: Option<LevelGap>,
}

/// A reason why an image has no level of noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LevelGap {
    /// The study has no sensor.
    NoSensor,
    /// All pixels are saturated.
    Saturated,
    /// The noise of more than 1 % of the pixels is unknown, for example since they have too few samples.
    UnknownNoise,
    /// The time of the set is too short for a pilot. Only a forecast has this reason.
    NoTime,
}

impl LevelGap {
    /// The level of an image, or the reason why there is none.
    pub(crate) fn level(record: &Record) -> Result<f64, Self> {
        let certificate = record.certificate.as_ref().ok_or(Self::NoSensor)?;
        match certificate.p99 {
            _ if certificate.saturated >= 1.0 => Err(Self::Saturated),
            Some(ratio) => Ok(ratio.sqrt()),
            None => Err(Self::UnknownNoise),
        }
    }
}

/// Measured on an image that is not written.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Measured {
    /// Seconds outside of the render: change of the scene, labels, files.
    pub(crate) outside: f64,
    /// Seconds of the change of the scene.
    pub(crate) change: f64,
    /// Seconds of exposure and certificate.
    pub(crate) expose: f64,
    /// Samples per second of a job; `None` if they were not measured.
    pub(crate) rate: Option<f64>,
}

/// The positions of the test images among so many missing ones: the first, the middle and the last one, or the first one.
fn test_positions(missing: usize) -> Vec<usize> {
    match missing {
        0 => Vec::new(),
        n if n < 4 * TESTS => vec![0],
        n => vec![0, n / 2, n - 1],
    }
}

/// Pilots that run at the same time on the first workers, each on the next test image.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Round {
    tests: usize,
    workers: usize,
    /// Pilots of each worker.
    pilots: usize,
    /// Pixels of a pilot with 16 samples each that fit.
    pixels: f64,
    /// Expected samples per second of a worker.
    rate: f64,
    /// Seconds of a pilot at most, without the change of the scene.
    limit: f64,
}

impl Round {
    /// The round with the most test images whose pilots fit into the allowance \[s\]. All workers run pilots, since a machine
    /// on which all of them work makes fewer samples on each. If the changes of the scene leave no time for pilots, only the
    /// first worker runs one, of the image that it has.
    fn choose(allowance: f64, tests: usize, workers: usize, measured: Measured, pixels: f64) -> Option<Self> {
        let rate = measured.rate.unwrap_or(UNKNOWN_RATE);
        let per_pixel = f64::from(PILOT_SPP + PILOT_SPP / FIRST) / rate + ANALYSIS;
        let choices = [(tests, workers, measured.change), (1, workers, measured.change), (1, 1, 0.0)];
        choices.into_iter().find_map(|(tests, workers, change)| {
            let pilots = tests.div_ceil(workers);
            let time = |share: f64| share * allowance / pilots as f64 - change;
            let fitting = time(AIM) / per_pixel;
            let fits = fitting >= LEAST_PIXELS.min(pixels);
            fits.then(|| Self { tests, workers, pilots, pixels: fitting, rate, limit: time(1.0) })
        })
    }
}

/// Seconds that the pilots may take of the time that is left for the set, with so many seconds for each image.
fn allowance(left: f64, share: f64) -> f64 {
    let (part, most) = SHORT_ALLOWANCE;
    let of_short = if share < SHORT { (part * left).min(most) } else { 0.0 };
    of_short.max(ALLOWANCE * left)
}

/// Width, height and samples per pixel of a pilot of an image of this size that may have so many `pixels` with 16 samples
/// each. `most` are the samples per pixel at most.
fn size_of_pilot([width, height]: [u32; 2], pixels: f64, most: f64) -> ([u32; 2], u32) {
    let whole = f64::from(width) * f64::from(height);
    if pixels < whole {
        let scale = (pixels / whole).sqrt();
        let side = |n: u32| ((f64::from(n) * scale) as u32).max(1);
        return ([side(width), side(height)], PILOT_SPP);
    }
    let affordable = (f64::from(PILOT_SPP) * pixels / whole).min(most).max(f64::from(PILOT_SPP));
    // `as` saturates.
    ([width, height], PILOT_SPP << ((affordable as u32) / PILOT_SPP).max(1).ilog2())
}

/// Ends a pilot that takes too long.
struct Guard<'a> {
    began: Instant,
    limit: f64,
    outer: &'a Cancel,
    own: &'a Cancel,
}

impl Progress for Guard<'_> {
    fn update(&self, _: &ProgressState) {
        if self.began.elapsed().as_secs_f64() > self.limit || self.outer.is_cancelled() {
            self.own.cancel();
        }
    }
}

/// The pilot of a test image.
struct Pilot {
    forecast: Result<PilotForecast, LevelGap>,
    /// Pixels of the image.
    pixels: f64,
    /// Samples per second.
    rate: f64,
    /// Seconds of a plan of the image.
    plan: f64,
}

impl Pilot {
    /// Runs the pilot of an image: no label, no file. `None` if it was cancelled.
    fn run(worker: &mut Worker, index: u64, round: Round, share: f64, cancel: &Cancel) -> Result<Option<Self>, Error> {
        let Prepared { mut settings, session, scene } = worker.prepare(index, share)?;
        let whole = [settings.width, settings.height];
        let pixels = f64::from(whole[0]) * f64::from(whole[1]);
        // All pixels of a pilot have the same number of samples, so that its rate does not depend on a plan.
        let training = settings.training_paths();
        let (size, spp) = size_of_pilot(whole, round.pixels, PILOT_SHARE * share * round.rate / pixels);
        [settings.width, settings.height] = size;
        if let Some(view) = settings.view.as_mut().filter(|_| size != whole) {
            let window = view.window.unwrap_or(FilmWindow { full: whole, origin: [0.0; 2], step: 1.0 });
            let larger = |axis: usize| f64::from(whole[axis]) / f64::from(size[axis]);
            let step = window.step * larger(0).min(larger(1));
            view.window = Some(FilmWindow { step, ..window });
        }
        let mut part = settings.clone();
        (part.budget, part.strategy, part.samples) = (Default::default(), None, Some(0..spp));
        let area = f64::from(size[0]) * f64::from(size[1]);
        part.training_paths = Some((f64::from(training) * area / pixels) as u32);
        let own = Cancel::new();
        let began = Instant::now();
        // A render that is short looks at its clock too late.
        if round.limit <= 0.0 || cancel.is_cancelled() {
            own.cancel();
        }
        let guard = Guard { began, limit: round.limit, outer: cancel, own: &own };
        let session = session.with_start(began).with_progress(&guard).with_cancel(&own);
        let rendering = render(scene, &part, &session)?;
        part.samples = Some(0..spp / FIRST);
        let first = render(scene, &part, &session)?;
        if rendering.interrupted || first.interrupted {
            return Ok(None);
        }
        let sampling: f64 = rendering.stages.iter().map(|(_, seconds)| seconds).sum();
        let samples = rendering.film.sums.total_samples() as f64;
        let began = Instant::now();
        let forecast = session.install(|| PilotForecast::new(&rendering.film, &first.film, &settings))?;
        let forecast = match forecast {
            None => Err(LevelGap::NoSensor),
            Some(forecast) if forecast.is_saturated() => Err(LevelGap::Saturated),
            Some(forecast) => Ok(forecast),
        };
        // Two films were analysed, and a plan needs one.
        let plan = 0.5 * began.elapsed().as_secs_f64() * pixels / area;
        Ok(Some(Self { forecast, pixels, rate: samples / sampling.max(1e-9), plan }))
    }

    /// Samples per pixel of the image if its render has a budget of `seconds`, of which the exposure takes `expose`.
    fn spp(&self, seconds: f64, rate: f64, expose: f64) -> f64 {
        samples_per_pixel(seconds, rate / self.pixels, self.plan, expose)
    }

    /// The level of the image with so many samples per pixel.
    fn level(&self, spp: f64) -> Result<f64, LevelGap> {
        let forecast = self.forecast.as_ref().map_err(|gap| *gap)?;
        forecast.level_after(spp).ok_or(LevelGap::UnknownNoise)
    }
}

/// Samples per pixel of an image whose render has a budget of `seconds`: of the time beside exposure and plan. A render with
/// fewer than 16 samples per pixel has no plan.
fn samples_per_pixel(seconds: f64, rate: f64, plan: f64, expose: f64) -> f64 {
    let left = (seconds - (1.0 + DRY_RUNS) * expose).max(0.0);
    match (left - plan).max(0.0) * rate {
        spp if spp >= f64::from(PILOT_SPP) => spp,
        _ => (left * rate).min(f64::from(PILOT_SPP)),
    }
}

/// The inputs of a forecast.
pub(crate) struct Run<'a> {
    pub(crate) study: &'a Arc<Study>,
    pub(crate) threads: usize,
    /// The missing images.
    pub(crate) wanted: &'a [u64],
    pub(crate) measured: Measured,
    pub(crate) shares: &'a TimeShares,
    pub(crate) began: Instant,
    pub(crate) cancel: &'a Cancel,
}

impl Run<'_> {
    /// Makes the forecast. `None` if there is no image to make, or if no test image can be made; its error is that of the image
    /// when it shall be written.
    pub(crate) fn forecast(&self, workers: &mut [Option<Result<Worker, Error>>]) -> Option<SetForecast> {
        let elapsed = || self.began.elapsed().as_secs_f64();
        let positions = test_positions(self.wanted.len());
        let first = workers.first().and_then(|worker| worker.as_ref()?.as_ref().ok())?;
        let (before, pixels) = (elapsed(), first.pixels());
        let share = self.shares.expected(before);
        let allowance = allowance((self.shares.deadline() - before).max(0.0), share);
        let round = Round::choose(allowance, positions.len(), workers.len(), self.measured, pixels);
        let mut pilots: Vec<Vec<Pilot>> = positions.iter().map(|_| Vec::new()).collect();
        let mut is_stopped = round.is_none();
        if let Some(round) = round {
            let indices: Vec<u64> = positions.iter().filter_map(|p| self.wanted.get(*p).copied()).collect();
            let run = |job: usize, worker: &mut Worker| -> Vec<(usize, Option<Pilot>)> {
                let tests = (0..round.pilots).map(|number| (job + number * round.workers) % round.tests);
                let pilot = |test: usize| {
                    let index = *indices.get(test)?;
                    let pilot = Pilot::run(worker, index, round, share, self.cancel).ok()?;
                    Some((test, pilot))
                };
                tests.filter_map(pilot).collect()
            };
            let run = &run;
            let made: Vec<(usize, Option<Pilot>)> = std::thread::scope(|scope| {
                let running = workers.iter_mut().take(round.workers).enumerate().map(|(job, slot)| {
                    scope.spawn(move || {
                        let worker = slot.get_or_insert_with(|| Worker::open(self.study, self.threads));
                        worker.as_mut().map_or_else(|_| Vec::new(), |worker| run(job, worker))
                    })
                });
                let running: Vec<_> = running.collect();
                running.into_iter().filter_map(|thread| thread.join().ok()).flatten().collect()
            });
            for (test, pilot) in made {
                match (pilot, pilots.get_mut(test)) {
                    (Some(pilot), Some(of_test)) => of_test.push(pilot),
                    _ => is_stopped = true,
                }
            }
        }
        let now = elapsed();
        let seconds = self.shares.expected(now);
        let end = self.shares.expected_end(now);
        let mut forecast = SetForecast { count: self.wanted.len() as u64, seconds, end, ..SetForecast::default() };
        for of_test in &pilots {
            let Some(pilot) = of_test.first() else { continue };
            let rate = of_test.iter().map(|pilot| pilot.rate).sum::<f64>() / of_test.len() as f64;
            forecast.images += 1;
            let spp = pilot.spp(seconds, rate, self.measured.expose);
            forecast.spp += spp;
            match pilot.level(spp) {
                Ok(level) => forecast.levels.push(level),
                Err(gap) => forecast.gap = Some(gap),
            }
        }
        forecast.spp /= forecast.images.max(1) as f64;
        if forecast.images == 0 {
            forecast.gap = Some(LevelGap::NoTime).filter(|_| is_stopped);
        }
        (forecast.images > 0 || is_stopped).then_some(forecast)
    }
}

#[cfg(test)]
#[path = "forecast_tests.rs"]
mod tests;
