//! Makes the images of a set: several at a time, next to other processes that do the same.

use crate::make::{Worker, checked_count};
use crate::record::Record;
use crate::set::Set;
use crate::study::Study;
use derive_setters::Setters;
use dunkelfeld::{Cancel, Error};
use dunkelfeld_report::words::shortened;
use std::collections::{BTreeSet, VecDeque};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// The longest time of a run: 10000 days \[s\].
const MAX_SECONDS: f64 = 10_000.0 * 86_400.0;

/// Share of saturated pixels above which a run says so.
pub(crate) const MOST_SATURATED: f64 = 0.01;

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

/// A sink for the progress of a run. Called from the threads of the run.
pub trait RunProgress: Sync {
    /// Receives the progress after each image.
    fn update(&self, state: &RunState);

    /// Receives a setting of the study that has no effect, before the first image, and a finding about the images of the
    /// run, at its end.
    fn warning(&self, _: &str) {}
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
    /// Images that another process had in work when the time of this run was over.
    pub elsewhere: u64,
    /// Mean share of the pixels of the images that this run made for which noise-matched exposure holds; `None` with plain
    /// noise.
    pub matched: Option<f64>,
}

/// Makes the missing images of a set. Several processes can run on the same folder: each image is made by one of them. A
/// run ends when all its images are finished: it waits for those of other processes, and makes those of a process that
/// ends before. A process that finds all images finished writes the files of the whole set.
///
/// # Errors
/// Errors of the study, of its scene and of the folder. An image that cannot be made, because its draws do not fit, is in the
/// summary, and the other images are made. But if the set has no image yet, and the draws of the first image of the run do not
/// fit, the run ends with this error, and a new folder is removed.
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
    if let Some(seconds) = options.seconds.filter(|seconds| !(0.0..=MAX_SECONDS).contains(seconds)) {
        let problem = format!("a run of {seconds} s is out of range");
        return Err(Error::setting("time", problem, "write a time up to 10000 days, or leave it out"));
    }
    study.check_jobs(count)?;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = options.jobs.unwrap_or(cores).clamp(1, usize::try_from(count).unwrap_or(usize::MAX));
    let threads = options.threads.unwrap_or(if jobs > 1 { 1 } else { 0 });

    let mut first = Worker::open(study, threads)?;
    let is_new = !folder.exists();
    let set = first.open_set(folder, Some(count))?;
    first.warnings().iter().for_each(|warning| progress.warning(warning));
    let mut wanted: Vec<u64> = match &options.indices {
        Some(indices) => indices.clone(),
        None => (0..count).collect(),
    };
    // An index may be there twice.
    wanted.sort_unstable();
    wanted.dedup();
    let total = wanted.len() as u64;
    let before = set.finished();
    wanted.retain(|index| before.binary_search(index).is_err());
    if let (true, Some(index)) = (before.is_empty(), wanted.first()) {
        first.check(*index).inspect_err(|_| {
            if is_new {
                set.discard();
            }
        })?;
    }
    let already = total - wanted.len() as u64;
    let jobs = jobs.min(wanted.len()).max(1);
    let shared = Shared {
        set: &set,
        wanted: &wanted,
        next: AtomicUsize::new(0),
        elsewhere: Mutex::default(),
        made: AtomicU64::new(0),
        total,
        already,
        began,
        jobs,
        seconds: options.seconds,
        excess: Mutex::default(),
        progress,
        cancel,
        failed: Mutex::new(None),
        unmade: Mutex::new(Vec::new()),
        seen: Mutex::default(),
        stop: AtomicBool::new(false),
    };
    shared.report();
    std::thread::scope(|scope| {
        let shared = &shared;
        for _ in 1..jobs {
            scope.spawn(move || shared.work(Worker::open(study, threads)));
        }
        shared.work(Ok(first));
    });
    let Shared { made, failed, unmade, seen, .. } = shared;
    let mut unmade = unmade.into_inner().unwrap_or_default();
    unmade.sort_by_key(|(index, _)| *index);
    if let Some(e) = failed.into_inner().ok().flatten() {
        if is_new && made.load(Ordering::Relaxed) == 0 {
            set.discard();
        }
        return Err(e);
    }
    let interrupted = cancel.is_cancelled();
    let done = set.finished();
    let finished = done.len() as u64;
    // Images that cannot be made stay away, and do not keep the others from use.
    if finished + unmade.len() as u64 >= set.count() && !interrupted {
        set.assemble()?;
    }
    let seen = seen.into_inner().unwrap_or_default();
    seen.findings().iter().filter(|_| !interrupted).for_each(|finding| progress.warning(finding));
    let open = wanted.iter().filter(|index| done.binary_search(index).is_err()).count();
    let elsewhere = open.saturating_sub(unmade.len()) as u64;
    let seconds = began.elapsed().as_secs_f64();
    let is_missed = |limit: &f64| seconds > limit + (0.02 * limit).max(0.2) && !interrupted;
    Ok(RunSummary {
        made: made.into_inner(),
        finished,
        count: set.count(),
        seconds,
        missed: options.seconds.filter(is_missed),
        interrupted,
        failed: unmade.into_iter().map(|(index, e)| (index, e.in_one_line())).collect(),
        elsewhere,
        matched: mean(&seen.matched),
    })
}

/// Less time gives no useful image \[s\].
const LEAST: f64 = 0.02;

/// The share of one image: the time that is left over the images that a job still makes one after the other. `position` is
/// that of the image among `images`, which `jobs` make at the same time.
fn share(left: f64, position: usize, images: usize, jobs: usize) -> f64 {
    let rounds = images.div_ceil(jobs).saturating_sub(position / jobs).max(1);
    left / rounds as f64
}

/// The parts of a run that its threads share.
struct Shared<'a> {
    set: &'a Set,
    wanted: &'a [u64],
    next: AtomicUsize,
    /// Positions of images that another process makes.
    elsewhere: Mutex<VecDeque<usize>>,
    made: AtomicU64,
    total: u64,
    already: u64,
    began: Instant,
    jobs: usize,
    /// The time of the run, if it has one.
    seconds: Option<f64>,
    /// Seconds of the finished images beyond their budgets, and the number of these images.
    excess: Mutex<(f64, u64)>,
    progress: &'a dyn RunProgress,
    cancel: &'a Cancel,
    failed: Mutex<Option<Error>>,
    /// Images that could not be made.
    unmade: Mutex<Vec<(u64, Error)>>,
    seen: Mutex<Seen>,
    stop: AtomicBool,
}

impl Shared<'_> {
    /// Does the run end before its last image?
    fn is_over(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.cancel.is_cancelled()
    }

    fn report(&self) {
        let (made, elapsed) = (self.made.load(Ordering::Relaxed), self.began.elapsed().as_secs_f64());
        let finished = (self.already + made).min(self.total);
        let left = (self.total - finished) as f64;
        let remaining = (made > 0).then(|| elapsed / made as f64 * left);
        self.progress.update(&RunState { finished, count: self.total, elapsed, remaining });
    }

    /// The budget of the image at a position, if the run has a time: its share less the mean time of an image beyond its budget,
    /// for the change of the scene, labels and files. Before that is known, it is a tenth of the share.
    fn budget(&self, position: usize) -> Option<f64> {
        let left = self.seconds? - self.began.elapsed().as_secs_f64();
        let (sum, count) = self.excess.lock().map(|excess| *excess).unwrap_or_default();
        let share = share(left, position, self.wanted.len(), self.jobs);
        let beyond = if count == 0 { 0.1 * share } else { sum / count as f64 };
        Some((share - beyond).max(LEAST))
    }

    /// The position of the next image: those of other processes come last.
    fn next_position(&self) -> Option<usize> {
        let position = self.next.fetch_add(1, Ordering::Relaxed);
        if position < self.wanted.len() { Some(position) } else { self.elsewhere.lock().ok()?.pop_front() }
    }

    /// Another process makes the image at a position: this one comes back to it, until its time is over.
    fn leave(&self, position: usize) {
        const PAUSE: Duration = Duration::from_millis(50);
        let is_late = self.seconds.is_some_and(|seconds| self.began.elapsed().as_secs_f64() > seconds);
        // The images that nobody makes come first.
        if self.next.load(Ordering::Relaxed) >= self.wanted.len() {
            std::thread::sleep(PAUSE);
        }
        if let (false, Ok(mut elsewhere)) = (is_late, self.elsewhere.lock()) {
            elsewhere.push_back(position);
        }
    }

    /// Makes the next image that nobody else makes. False at the end.
    fn next_image(&self, worker: &mut Worker) -> Result<bool, Error> {
        loop {
            if self.is_over() {
                return Ok(false);
            }
            let Some(position) = self.next_position() else { return Ok(false) };
            let Some(&index) = self.wanted.get(position) else { return Ok(false) };
            let Some(claim) = self.set.claim(index)? else {
                if !self.set.is_finished(index) {
                    self.leave(position);
                }
                continue;
            };
            let (began, budget) = (Instant::now(), self.budget(position));
            let image = match worker.make(index, budget, self.cancel) {
                Ok(Some(image)) => image,
                Ok(None) => return Ok(false),
                Err(e @ Error::Input(_)) => {
                    if let Ok(mut unmade) = self.unmade.lock() {
                        unmade.push((index, e));
                    }
                    continue;
                }
                Err(e) => return Err(e),
            };
            let (record, _) = self.set.commit(claim, image)?;
            if let (Some(budget), Ok(mut excess)) = (budget, self.excess.lock()) {
                *excess = (excess.0 + began.elapsed().as_secs_f64() - budget, excess.1 + 1);
            }
            if let Ok(mut seen) = self.seen.lock() {
                seen.add(&record);
            }
            self.made.fetch_add(1, Ordering::Relaxed);
            self.report();
            return Ok(true);
        }
    }

    fn work(&self, worker: Result<Worker, Error>) {
        let _guard = StopOnPanic(&self.stop);
        let result = worker.and_then(|mut worker| {
            while self.next_image(&mut worker)? {}
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

/// The images that a run made.
#[derive(Default)]
struct Seen {
    /// Shares of the pixels with matched noise, and of those that are saturated.
    matched: Vec<f64>,
    saturated: Vec<f64>,
    /// Names of visible objects without a pose.
    unposed: BTreeSet<String>,
}

impl Seen {
    fn add(&mut self, record: &Record) {
        self.matched.extend(record.matched);
        self.saturated.extend(record.certificate.map(|certificate| certificate.saturated));
        let unposed = record.instances.iter().filter(|instance| instance.matrix.is_some());
        self.unposed.extend(unposed.map(|instance| instance.name.clone()));
    }

    /// What a user of the set should know, in sentences.
    fn findings(&self) -> Vec<String> {
        let mut findings = Vec::new();
        if let Some(share) = mean(&self.saturated).filter(|share| *share > MOST_SATURATED) {
            findings.push(format!(
                "{:.0} % of the pixels of these images are saturated, and show no contrast; help: use a shorter exposure \
                 or less light",
                100.0 * share
            ));
        }
        if !self.unposed.is_empty() {
            let names: Vec<String> = self.unposed.iter().map(|name| format!("{name:?}")).collect();
            findings.push(format!(
                "{}: no pose in `poses` and `scene_gt.json`, since the matrix mirrors, shears, is flat or has too few \
                 decimals; `matrix` in the records has it",
                shortened(&names.join(", "), 400)
            ));
        }
        findings
    }
}

/// The mean; `None` without a value.
fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Ends a run if a thread of it panics, so that no other one waits for its image.
struct StopOnPanic<'a>(&'a AtomicBool);

impl Drop for StopOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With images that take their share, each job makes ceil(N / J) images at most, all have T / ceil(N / J), and the last one
    /// ends at T.
    #[test]
    fn all_images_have_the_same_share() {
        for (images, jobs) in [(1, 1usize), (12usize, 1), (12, 2), (13, 2), (3, 2), (16, 3), (100, 7), (5, 8)] {
            let all = 3.0 * images.div_ceil(jobs) as f64;
            let mut ends = vec![0.0; jobs];
            for position in 0..images {
                let end = &mut ends[position % jobs];
                let share = share(all - *end, position, images, jobs);
                assert!((share - 3.0).abs() < 1e-9, "{images} on {jobs}: {share}");
                *end += share;
            }
            assert!((ends[0] - all).abs() < 1e-9);
        }
        // Images of other processes leave their time to the others.
        assert_eq!(share(6.0, 2, 12, 1), 0.6);
        assert_eq!(share(6.0, 12, 12, 1), 6.0);
    }
}
