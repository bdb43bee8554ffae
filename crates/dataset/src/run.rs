//! Makes the images of a set: several at a time, next to other processes that do the same.

use crate::make::{Worker, checked_count};
use crate::record::Record;
use crate::set::Set;
use crate::study::Study;
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
    /// Wall-clock seconds of the whole run. Each image gets its share of the time that is left, instead of the budget of the
    /// job.
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

/// What a time for the whole set buys, measured on images from its beginning, middle and end.
#[derive(Clone, Debug, PartialEq)]
pub struct SetForecast {
    /// Seconds of one image.
    pub seconds: f64,
    /// For each measured image with a sensor, the k at which 99 % of its unsaturated pixels are hidden.
    pub levels: Vec<f64>,
}

/// A sink for the progress of a run. Called from the threads of the run.
pub trait RunProgress: Sync {
    /// Receives the progress after each image.
    fn update(&self, state: &RunState);

    /// Receives the forecast of a run with a time, before its other images are made.
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
    /// Was it cancelled?
    pub interrupted: bool,
    /// Images that could not be made, with the errors.
    pub failed: Vec<(u64, String)>,
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
    let set = first.open_set(folder, Some(count))?;
    let mut wanted: Vec<u64> = match &options.indices {
        Some(indices) => indices.clone(),
        None => (0..count).collect(),
    };
    let total = wanted.len() as u64;
    wanted.retain(|index| !set.is_finished(*index));
    let already = total - wanted.len() as u64;
    let tests = if options.seconds.is_some() { tests_first(&mut wanted) } else { 0 };
    let shared = Shared {
        set: &set,
        wanted: &wanted,
        next: AtomicUsize::new(0),
        made: AtomicU64::new(0),
        beside: Mutex::new((0.0, 0)),
        total,
        already,
        began,
        deadline: options.seconds,
        jobs,
        progress,
        cancel,
        failed: Mutex::new(None),
        has_images: (0..set.count()).any(|index| set.is_finished(index)),
        unmade: Mutex::new(Vec::new()),
        stop: AtomicBool::new(false),
    };
    shared.report();
    let mut first = Some(first);
    if tests > 0 {
        let mut levels = Vec::new();
        let seconds = shared.seconds().unwrap_or_default();
        let mut worker = first.take();
        for _ in 0..tests {
            let Some(worker) = worker.as_mut() else { break };
            match shared.next_image(worker) {
                Ok(Some(record)) => {
                    levels.extend(record.certificate.and_then(|c| c.p99).map(f64::sqrt));
                }
                Ok(None) => break,
                Err(e) => return Err(e),
            }
        }
        progress.forecast(&SetForecast { seconds, levels });
        first = worker;
    }
    std::thread::scope(|scope| {
        let shared = &shared;
        for _ in 1..jobs.min(wanted.len()) {
            scope.spawn(move || shared.work(Worker::open(study, threads)));
        }
        if let Some(first) = first {
            shared.work(Ok(first));
        }
    });
    let Shared { made, failed, unmade, .. } = shared;
    if let Ok(Some(e)) = failed.into_inner() {
        return Err(e);
    }
    let interrupted = cancel.is_cancelled();
    let finished = (0..set.count()).filter(|index| set.is_finished(*index)).count() as u64;
    let unmade = unmade.into_inner().unwrap_or_default();
    // Images that cannot be made stay away, and do not keep the others from use.
    if finished + unmade.len() as u64 >= set.count() && !interrupted {
        set.assemble(study)?;
    }
    Ok(RunSummary {
        made: made.into_inner(),
        finished,
        count: set.count(),
        seconds: began.elapsed().as_secs_f64(),
        interrupted,
        failed: unmade,
    })
}

/// Puts the first, the middle and the last image first, if there are enough others; gives their number.
fn tests_first(wanted: &mut [u64]) -> usize {
    const TESTS: usize = 3;
    let n = wanted.len();
    if n < 4 * TESTS {
        return 0;
    }
    wanted.swap(1, n / 2);
    wanted.swap(2, n - 1);
    TESTS
}

/// The parts of a run that its threads share.
struct Shared<'a> {
    set: &'a Set,
    wanted: &'a [u64],
    next: AtomicUsize,
    made: AtomicU64,
    /// Seconds of the images beside their samples, and the number of images.
    beside: Mutex<(f64, u64)>,
    total: u64,
    already: u64,
    began: Instant,
    deadline: Option<f64>,
    jobs: usize,
    progress: &'a dyn RunProgress,
    cancel: &'a Cancel,
    failed: Mutex<Option<Error>>,
    /// Had the set images before?
    has_images: bool,
    /// Images that could not be made.
    unmade: Mutex<Vec<(u64, String)>>,
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

    /// The seconds of the samples of the next image, if the run has a time.
    fn seconds(&self) -> Option<f64> {
        /// Less time gives no useful image.
        const LEAST: f64 = 0.02;
        let left = self.deadline? - self.began.elapsed().as_secs_f64();
        let images = self.wanted.len().saturating_sub(self.next.load(Ordering::Relaxed)).max(1);
        let beside = self.beside.lock().map_or(0.0, |beside| beside.0 / beside.1.max(1) as f64);
        Some((left * self.jobs as f64 / images as f64 - beside).max(LEAST))
    }

    /// Makes the next image that nobody else makes; `None` at the end.
    fn next_image(&self, worker: &mut Worker) -> Result<Option<Record>, Error> {
        loop {
            if self.stop.load(Ordering::Relaxed) || self.cancel.is_cancelled() {
                return Ok(None);
            }
            let seconds = self.seconds();
            let Some(&index) = self.wanted.get(self.next.fetch_add(1, Ordering::Relaxed)) else { return Ok(None) };
            let Some(claim) = self.set.claim(index)? else { continue };
            let image = match worker.make(index, seconds, self.cancel) {
                Ok(Some(image)) => image,
                Ok(None) => return Ok(None),
                Err(e @ Error::Input(_)) if self.made.load(Ordering::Relaxed) > 0 || self.has_images => {
                    if let Ok(mut unmade) = self.unmade.lock() {
                        unmade.push((index, e.to_string()));
                    }
                    continue;
                }
                Err(e) => return Err(e),
            };
            let record = self.set.commit(claim, image)?;
            // The first image pays for cold caches.
            if let Ok(mut beside) = self.beside.lock()
                && self.made.load(Ordering::Relaxed) > 0
            {
                beside.0 += record.1.total - record.1.render;
                beside.1 += 1;
            }
            self.made.fetch_add(1, Ordering::Relaxed);
            self.report();
            return Ok(Some(record.0));
        }
    }

    fn work(&self, worker: Result<Worker, Error>) {
        let result = worker.and_then(|mut worker| {
            while self.next_image(&mut worker)?.is_some() {}
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
