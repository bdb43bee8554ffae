//! Makes the images of a set: several at a time, next to other processes that do the same.

use crate::make::{Worker, checked_count};
use crate::record::Record;
use crate::set::Set;
use crate::study::Study;
use crate::time_shares::{Share, TimeShares};
use derive_setters::Setters;
use dunkelfeld::{Cancel, Error};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// How a set is made.
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_", strip_option)]
#[non_exhaustive]
pub struct RunOptions {
    /// Number of images; by default that of the study.
    pub count: Option<u64>,
    /// Only these images. By default all that are missing.
    pub indices: Option<Vec<u64>>,
    /// Images that are made at the same time; by default one per core.
    pub jobs: Option<usize>,
    /// Threads of each image; by default one, and with one job at a time one per core.
    pub threads: Option<usize>,
    /// Wall-clock seconds of the whole run. Each image gets an equal share of the time that is left, instead of the budget of
    /// the job.
    pub seconds: Option<f64>,
}

/// The progress of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunState {
    /// Finished images of the set.
    pub finished: u64,
    /// Images that the run shall make or find.
    pub count: u64,
    /// Seconds since the start.
    pub elapsed: f64,
    /// Expected remaining seconds; `None` before the first image.
    pub remaining: Option<f64>,
}

/// The result of a time for the whole set, measured on its first images: one from the beginning, and in sets of 12 and more
/// images also one from the middle and one from the end.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SetForecast {
    /// Number of these images.
    pub images: u64,
    /// Mean budget of the renders of these images \[s\].
    pub seconds: f64,
    /// For each of these images whose level is known, the k at which 99 % of its unsaturated pixels are hidden.
    pub levels: Vec<f64>,
    /// The reason for an image without a level; that of the last such image.
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
}

impl LevelGap {
    /// The level of an image, or the reason why there is none.
    fn level(record: &Record) -> Result<f64, Self> {
        let certificate = record.certificate.as_ref().ok_or(Self::NoSensor)?;
        match certificate.p99 {
            _ if certificate.saturated >= 1.0 => Err(Self::Saturated),
            Some(ratio) => Ok(ratio.sqrt()),
            None => Err(Self::UnknownNoise),
        }
    }
}

/// A sink for the progress of a run. Called from the threads of the run.
pub trait RunProgress: Sync {
    /// Receives the progress after each image.
    fn update(&self, state: &RunState);

    /// Receives the forecast of a run with a time, after its first images.
    fn forecast(&self, _: &SetForecast) {}
}

/// The result of a run.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RunSummary {
    /// Images that this run made.
    pub made: u64,
    /// Images of the set that are finished.
    pub finished: u64,
    /// Images of the set.
    pub count: u64,
    /// Wall-clock seconds.
    pub seconds: f64,
    /// The time that it had, if it took more than 2 % and 0.2 s longer \[s\].
    pub missed: Option<f64>,
    /// Was it cancelled?
    pub interrupted: bool,
    /// Images that could not be made, with the errors.
    pub failed: Vec<(u64, String)>,
    /// Mean share of the pixels of the images that this run made for which noise-matched exposure holds; `None` with plain
    /// noise.
    pub matched: Option<f64>,
}

/// Makes the missing images of a set. Several processes can run on the same folder: each image is made by one of them. The
/// process that finds all images finished writes the files of the whole set.
///
/// # Errors
/// Errors of the study, of its scene and of the folder. An image that cannot be made, because its draws do not fit, ends a run
/// that has made none before. Otherwise it is in the summary, and the other images are made.
pub fn run(
    study: &Arc<Study>,
    folder: &Path,
    options: &RunOptions,
    progress: &dyn RunProgress,
    cancel: &Cancel,
) -> Result<RunSummary, Error> {
    let began = Instant::now();
    let count = checked_count(study, options.count)?;
    if let Some(index) = options.indices.iter().flatten().find(|index| **index >= count) {
        let problem = format!("there is no image {index}: the set has {count}, counted from 0");
        return Err(Error::setting("index", problem, "write a smaller index, or a larger --count"));
    }
    study.check_jobs(count)?;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = options.jobs.unwrap_or(cores).clamp(1, usize::try_from(count).unwrap_or(usize::MAX));
    let threads = options.threads.unwrap_or(if jobs > 1 { 1 } else { 0 });

    let first = Worker::open(study, threads)?;
    let is_new = !folder.exists();
    let set = first.open_set(folder, Some(count))?;
    let mut wanted: Vec<u64> = match &options.indices {
        Some(indices) => indices.clone(),
        None => (0..count).collect(),
    };
    let total = wanted.len() as u64;
    wanted.retain(|index| !set.is_finished(*index));
    let already = total - wanted.len() as u64;
    let tests = if options.seconds.is_some() { tests_first(&mut wanted) } else { 0 };
    let jobs = jobs.min(wanted.len()).max(1);
    let mut workers: Vec<Option<Result<Worker, Error>>> = (1..jobs).map(|_| None).collect();
    workers.insert(0, Some(Ok(first)));
    let mut shares = None;
    if let (Some(seconds), Some(index)) = (options.seconds, wanted.first()) {
        let outside = load_together(&mut workers, study, threads, *index, cancel);
        shares = Some(TimeShares::new(seconds, wanted.len() as u64, jobs, outside));
    }
    let shared = Shared {
        set: &set,
        wanted: &wanted,
        next: AtomicUsize::new(0),
        made: AtomicU64::new(0),
        total,
        already,
        began,
        shares: shares.map(Mutex::new),
        tests: Mutex::new(Tests { first: tests, left: tests, made: 0, forecast: SetForecast::default() }),
        progress,
        cancel,
        failed: Mutex::new(None),
        has_images: (0..set.count()).any(|index| set.is_finished(index)),
        unmade: Mutex::new(Vec::new()),
        matched: Mutex::new((0.0, 0)),
        stop: AtomicBool::new(false),
    };
    shared.report();
    std::thread::scope(|scope| {
        let shared = &shared;
        let mut workers = workers.into_iter().enumerate();
        let first = workers.next();
        for (job, worker) in workers {
            scope.spawn(move || shared.work(job, worker.unwrap_or_else(|| Worker::open(study, threads))));
        }
        if let Some((job, Some(first))) = first {
            shared.work(job, first);
        }
    });
    let Shared { made, failed, unmade, matched, .. } = shared;
    if let Ok(Some(e)) = failed.into_inner() {
        if is_new && made.load(Ordering::Relaxed) == 0 {
            set.discard();
        }
        return Err(e);
    }
    let interrupted = cancel.is_cancelled();
    let finished = (0..set.count()).filter(|index| set.is_finished(*index)).count() as u64;
    let unmade = unmade.into_inner().unwrap_or_default();
    // Images that cannot be made stay away, and do not keep the others from use.
    if finished + unmade.len() as u64 >= set.count() && !interrupted {
        set.assemble()?;
    }
    let seconds = began.elapsed().as_secs_f64();
    let is_missed = |limit: &f64| seconds > limit + (0.02 * limit).max(0.2) && !interrupted;
    Ok(RunSummary {
        made: made.into_inner(),
        finished,
        count: set.count(),
        seconds,
        missed: options.seconds.filter(is_missed),
        interrupted,
        failed: unmade,
        matched: matched.into_inner().ok().and_then(|(sum, images)| (images > 0).then(|| sum / f64::from(images))),
    })
}

/// Most images of the forecast.
const TESTS: usize = 3;

/// Puts the first, the middle and the last image first, if there are enough others; gives the number of images of the
/// forecast. In a small set it is the first image alone.
fn tests_first(wanted: &mut [u64]) -> usize {
    let n = wanted.len();
    if n < 4 * TESTS {
        return n.min(1);
    }
    wanted.swap(1, n / 2);
    wanted.swap(2, n - 1);
    TESTS
}

/// Loads the scenes of all workers but the first, which makes an image meanwhile. So all images begin with the same time,
/// and the first one that counts has warm caches. Gives the seconds of that image outside of its render.
fn load_together(
    workers: &mut [Option<Result<Worker, Error>>],
    study: &Arc<Study>,
    threads: usize,
    index: u64,
    cancel: &Cancel,
) -> f64 {
    /// Time of the samples \[s\].
    const SHORT: f64 = 0.02;
    let Some((Some(Ok(first)), others)) = workers.split_first_mut() else { return 0.0 };
    std::thread::scope(|scope| {
        for worker in others {
            scope.spawn(move || *worker = Some(Worker::open(study, threads)));
        }
        // An image that cannot be made is named when it shall be written.
        let made = first.make(index, Some(SHORT), cancel).ok().flatten();
        made.map_or(0.0, |made| made.cost.change + made.cost.label + made.cost.write)
    })
}

/// The images of the forecast.
struct Tests {
    /// The forecast is made from so many images, the first ones.
    first: usize,
    /// Number of images that have not ended.
    left: usize,
    made: u64,
    /// With the sum of the seconds.
    forecast: SetForecast,
}

/// The parts of a run that its threads share.
struct Shared<'a> {
    set: &'a Set,
    wanted: &'a [u64],
    next: AtomicUsize,
    made: AtomicU64,
    total: u64,
    already: u64,
    began: Instant,
    /// The time of the run, if it has one.
    shares: Option<Mutex<TimeShares>>,
    tests: Mutex<Tests>,
    progress: &'a dyn RunProgress,
    cancel: &'a Cancel,
    failed: Mutex<Option<Error>>,
    /// Had the set images before?
    has_images: bool,
    /// Images that could not be made.
    unmade: Mutex<Vec<(u64, String)>>,
    /// Sum of the matched shares of the images that were made, and their number.
    matched: Mutex<(f64, u32)>,
    stop: AtomicBool,
}

impl Shared<'_> {
    fn report(&self) {
        let (made, elapsed) = (self.made.load(Ordering::Relaxed), self.began.elapsed().as_secs_f64());
        let finished = (self.already + made).min(self.total);
        let left = (self.total - finished) as f64;
        let remaining = (made > 0).then(|| elapsed / made as f64 * left);
        self.progress.update(&RunState { finished, count: self.total, elapsed, remaining });
    }

    /// The share of the next image, if the run has a time.
    fn begin(&self, job: usize) -> Option<Share> {
        let mut shares = self.shares.as_ref()?.lock().ok()?;
        Some(shares.begin(job, self.began.elapsed().as_secs_f64()))
    }

    /// Ends an image; `is_made` is false if it was not made.
    fn end(&self, job: usize, share: Option<Share>, is_made: bool) {
        let (Some(share), Some(Ok(mut shares))) = (share, self.shares.as_ref().map(Mutex::lock)) else { return };
        if is_made {
            shares.finish(job, share, self.began.elapsed().as_secs_f64());
        } else {
            shares.release(job);
        }
    }

    /// Counts an image of the forecast, which is reported after the last one of them.
    fn test(&self, position: usize, made: Option<(Share, &Record)>) {
        let Ok(mut tests) = self.tests.lock() else { return };
        if position >= tests.first || tests.left == 0 {
            return;
        }
        if let Some((share, record)) = made {
            tests.made += 1;
            tests.forecast.seconds += share.seconds;
            match LevelGap::level(record) {
                Ok(level) => tests.forecast.levels.push(level),
                Err(gap) => tests.forecast.gap = Some(gap),
            }
        }
        tests.left -= 1;
        if tests.left == 0 && tests.made > 0 {
            let mean = tests.forecast.seconds / tests.made as f64;
            let forecast = SetForecast { images: tests.made, seconds: mean, ..tests.forecast.clone() };
            self.progress.forecast(&forecast);
        }
    }

    /// Makes the next image that nobody else makes. False at the end.
    fn next_image(&self, job: usize, worker: &mut Worker) -> Result<bool, Error> {
        loop {
            if self.stop.load(Ordering::Relaxed) || self.cancel.is_cancelled() {
                return Ok(false);
            }
            let position = self.next.fetch_add(1, Ordering::Relaxed);
            let Some(&index) = self.wanted.get(position) else { return Ok(false) };
            let share = self.begin(job);
            let Some(claim) = self.set.claim(index)? else {
                self.end(job, share, false);
                self.test(position, None);
                continue;
            };
            let image = match worker.make(index, share.map(|share| share.seconds), self.cancel) {
                Ok(Some(image)) => image,
                Ok(None) => return Ok(false),
                Err(e @ Error::Input(_)) if self.made.load(Ordering::Relaxed) > 0 || self.has_images => {
                    if let Ok(mut unmade) = self.unmade.lock() {
                        unmade.push((index, e.to_string()));
                    }
                    self.end(job, share, false);
                    self.test(position, None);
                    continue;
                }
                Err(e) => return Err(e),
            };
            let (record, _) = self.set.commit(claim, image)?;
            self.end(job, share, true);
            if let (Some(share), Ok(mut matched)) = (record.matched, self.matched.lock()) {
                *matched = (matched.0 + share, matched.1 + 1);
            }
            self.test(position, share.map(|share| (share, &record)));
            self.made.fetch_add(1, Ordering::Relaxed);
            self.report();
            return Ok(true);
        }
    }

    fn work(&self, job: usize, worker: Result<Worker, Error>) {
        let result = worker.and_then(|mut worker| {
            while self.next_image(job, &mut worker)? {}
            Ok(())
        });
        if let Err(e) = result {
            self.stop.store(true, Ordering::Relaxed);
            if let Ok(mut failed) = self.failed.lock() {
                failed.get_or_insert(e);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::CertificateRecord;
    use std::collections::BTreeMap;

    #[test]
    fn a_small_set_has_one_test_image_and_others_three() {
        let mut few: Vec<u64> = (0..11).collect();
        assert_eq!((tests_first(&mut few), &few[..3]), (1, &[0, 1, 2][..]));
        let mut many: Vec<u64> = (0..12).collect();
        assert_eq!((tests_first(&mut many), &many[..3]), (3, &[0, 6, 11][..]));
        assert_eq!(tests_first(&mut []), 0);
    }

    #[test]
    fn an_image_without_a_level_has_its_true_reason() {
        let certificate = CertificateRecord { k: 1.0, hidden: 0.5, median: None, p99: Some(0.25), saturated: 0.5 };
        let record = |certificate| Record {
            index: 0,
            drawn: BTreeMap::new(),
            seed: 0,
            frame: 0,
            width: 1,
            height: 1,
            exposure: None,
            samples: 1,
            certificate,
            matched: None,
            instances: Vec::new(),
            files: BTreeMap::new(),
        };
        for (certificate, expected) in [
            (Some(certificate), Ok(0.5)),
            (Some(CertificateRecord { p99: None, ..certificate }), Err(LevelGap::UnknownNoise)),
            (Some(CertificateRecord { saturated: 1.0, ..certificate }), Err(LevelGap::Saturated)),
            (None, Err(LevelGap::NoSensor)),
        ] {
            assert_eq!(LevelGap::level(&record(certificate)), expected);
        }
    }
}
