//! Makes the images of a set: several at a time, next to other processes that do the same.

use crate::make::{Start, Worker, checked_count};
use crate::price::{Measured, Price};
use crate::record::{Cost, Record};
use crate::set::Set;
use crate::study::Study;
use derive_setters::Setters;
use dunkelfeld::{Cancel, Error};
use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
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

    /// Receives the price of the set, once after the first images if others follow.
    fn price(&self, _: &Price) {}

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
    /// The price of the whole set by the images that this run made.
    pub price: Option<Price>,
}

/// Makes the missing images of a set. Several processes can run on the same folder: each image is made by one of them. A
/// run ends when all its images are finished: it waits for those of other processes, and makes those of a process that
/// ends before. A process that finds all images finished writes the files of the whole set.
///
/// # Errors
/// Errors of the study, of its scene and of the folder. An image that cannot be made, because its draws do not fit, is in the
/// summary, and the other images are made. But if the set has no image yet, and the draws of the first image of the run do not
/// fit, the run ends with this error before a folder is made.
pub fn run(
    study: &Arc<Study>,
    folder: &Path,
    options: &RunOptions,
    progress: &dyn RunProgress,
    cancel: &Cancel,
) -> Result<RunSummary, Error> {
    let began = Instant::now();
    let count = checked_count(study, options.count)?;
    if let Some(seconds) = options.seconds.filter(|seconds| !(0.0..=MAX_SECONDS).contains(seconds)) {
        let problem = format!("a run of {seconds} s is out of range");
        return Err(Error::setting("time", problem, "write a time up to 10000 days, or leave it out"));
    }
    study.check_jobs(count)?;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = options.jobs.unwrap_or(cores).clamp(1, usize::try_from(count).unwrap_or(usize::MAX));
    let threads = options.threads.unwrap_or(if jobs > 1 { 1 } else { 0 });
    let mut first = Worker::open(study, threads)?;
    let Start { set, wanted, missing } = first.start(folder, options.count, options.indices.as_deref())?;
    first.warnings().iter().for_each(|warning| progress.warning(warning));
    let capacity = (jobs, if threads == 0 { cores } else { threads });
    let jobs = jobs.min(missing.len()).max(1);
    let (seconds, state) = (options.seconds, Mutex::new(State::default()));
    let run = Run { set: &set, missing: &missing, wanted, began, jobs, capacity, seconds, progress, cancel, state };
    run.report(0);
    std::thread::scope(|scope| {
        let run = &run;
        for _ in 1..jobs {
            scope.spawn(move || run.work(Worker::open(study, threads)));
        }
        run.work(Ok(first));
    });
    let state = run.state.into_inner().unwrap_or_else(PoisonError::into_inner);
    state.failed.map_or(Ok(()), Err)?;
    let mut unmade = state.unmade;
    unmade.sort_by_key(|(index, _)| *index);
    let interrupted = cancel.is_cancelled();
    let done = set.finished();
    let finished = done.len() as u64;
    // Images that cannot be made stay away, and do not keep the others from use.
    if finished + unmade.len() as u64 >= set.count() && !interrupted {
        set.assemble()?;
    }
    state.seen.finding().iter().filter(|_| !interrupted).for_each(|finding| progress.warning(finding));
    let open = missing.iter().filter(|index| done.binary_search(index).is_err()).count();
    let seconds = began.elapsed().as_secs_f64();
    let is_missed = |limit: &f64| seconds > limit + (0.02 * limit).max(0.2) && !interrupted;
    Ok(RunSummary {
        made: state.made,
        finished,
        count: set.count(),
        seconds,
        missed: options.seconds.filter(is_missed),
        interrupted,
        elsewhere: open.saturating_sub(unmade.len()) as u64,
        failed: unmade.into_iter().map(|(index, e)| (index, e.to_string())).collect(),
        matched: mean(&state.seen.matched),
        price: state.seen.measured.price(set.count(), capacity.0, capacity.1),
    })
}

/// Images after which the price of a set is reported.
const PRICED: u64 = 4;

/// Less time gives no useful image \[s\].
const LEAST: f64 = 0.02;

/// The share of one image: the time that is left over the images that a job still makes one after the other. `position` is
/// that of the image among `images`, which `jobs` make at the same time.
fn share(left: f64, position: usize, images: usize, jobs: usize) -> f64 {
    let rounds = images.div_ceil(jobs).saturating_sub(position / jobs).max(1);
    left / rounds as f64
}

/// A run, which its threads share.
struct Run<'a> {
    set: &'a Set,
    /// The images to make.
    missing: &'a [u64],
    /// Number of images that the run shall make or find.
    wanted: u64,
    began: Instant,
    jobs: usize,
    /// The jobs of a run of the whole set, and the cores of each.
    capacity: (usize, usize),
    /// The time of the run, if it has one.
    seconds: Option<f64>,
    progress: &'a dyn RunProgress,
    cancel: &'a Cancel,
    state: Mutex<State>,
}

/// What a run has done so far.
#[derive(Default)]
struct State {
    /// Position of the next image.
    next: usize,
    /// Positions of images that another process makes.
    elsewhere: VecDeque<usize>,
    made: u64,
    /// Seconds of the finished images beyond their budgets, and the number of these images.
    excess: (f64, u64),
    /// Images that could not be made.
    unmade: Vec<(u64, Error)>,
    seen: Seen,
    /// The error that ends the run.
    failed: Option<Error>,
    /// Has a thread ended by an error?
    is_stopped: bool,
}

impl Run<'_> {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn report(&self, made: u64) {
        let elapsed = self.began.elapsed().as_secs_f64();
        let already = self.wanted - self.missing.len() as u64;
        let finished = (already + made).min(self.wanted);
        let remaining = (made > 0).then(|| elapsed / made as f64 * (self.wanted - finished) as f64);
        self.progress.update(&RunState { finished, count: self.wanted, elapsed, remaining });
    }

    /// The budget of the image at a position, if the run has a time: its share less the mean time of an image beyond its budget,
    /// for the change of the scene, labels and files. Before that is known, it is a tenth of the share.
    fn budget(&self, position: usize) -> Option<f64> {
        let left = self.seconds? - self.began.elapsed().as_secs_f64();
        let (sum, count) = self.state().excess;
        let share = share(left, position, self.missing.len(), self.jobs);
        let beyond = if count == 0 { 0.1 * share } else { sum / count as f64 };
        Some((share - beyond).max(LEAST))
    }

    /// The position of the next image: those of other processes come last. `None` at the end.
    fn next_position(&self) -> Option<usize> {
        let mut state = self.state();
        if state.is_stopped || self.cancel.is_cancelled() {
            return None;
        }
        state.next += 1;
        if state.next <= self.missing.len() { Some(state.next - 1) } else { state.elsewhere.pop_front() }
    }

    /// Another process makes the image at a position: this one comes back to it, until its time is over.
    fn leave(&self, position: usize) {
        const PAUSE: Duration = Duration::from_millis(50);
        let is_late = self.seconds.is_some_and(|seconds| self.began.elapsed().as_secs_f64() > seconds);
        // The images that nobody makes come first.
        if self.state().next >= self.missing.len() {
            std::thread::sleep(PAUSE);
        }
        if !is_late {
            self.state().elsewhere.push_back(position);
        }
    }

    /// Makes images that nobody else makes, to the end of the run.
    fn make(&self, worker: &mut Worker) -> Result<(), Error> {
        while let Some(position) = self.next_position() {
            let index = self.missing[position];
            let Some(claim) = self.set.claim(index)? else {
                if !self.set.is_finished(index) {
                    self.leave(position);
                }
                continue;
            };
            let (began, budget) = (Instant::now(), self.budget(position));
            let image = match worker.make(index, budget, self.cancel) {
                Ok(Some(image)) => image,
                Ok(None) => return Ok(()),
                Err(e @ Error::Input(_)) => {
                    self.state().unmade.push((index, e));
                    continue;
                }
                Err(e) => return Err(e),
            };
            let (record, cost) = self.set.commit(claim, image)?;
            let mut state = self.state();
            if let Some(budget) = budget {
                state.excess = (state.excess.0 + began.elapsed().as_secs_f64() - budget, state.excess.1 + 1);
            }
            state.seen.add(&record, &cost);
            state.made += 1;
            let (made, measured) = (state.made, state.seen.measured);
            drop(state);
            self.report(made);
            if made == PRICED.min(self.missing.len() as u64 - 1)
                && let Some(price) = measured.price(self.set.count(), self.capacity.0, self.capacity.1)
            {
                self.progress.price(&price);
            }
        }
        Ok(())
    }

    fn work(&self, worker: Result<Worker, Error>) {
        if let Err(e) = worker.and_then(|mut worker| self.make(&mut worker)) {
            let mut state = self.state();
            state.is_stopped = true;
            state.failed.get_or_insert(e);
        }
    }
}

/// The images that a run made.
#[derive(Default)]
struct Seen {
    /// Shares of the pixels with matched noise, and of those that are saturated.
    matched: Vec<f64>,
    saturated: Vec<f64>,
    measured: Measured,
}

impl Seen {
    fn add(&mut self, record: &Record, cost: &Cost) {
        self.measured.add(cost, record);
        self.matched.extend(record.matched);
        self.saturated.extend(record.certificate.map(|certificate| certificate.saturated));
    }

    /// What a user of the set should know, in a sentence.
    fn finding(&self) -> Option<String> {
        let share = mean(&self.saturated).filter(|share| *share > MOST_SATURATED)?;
        Some(format!(
            "{:.0} % of the pixels of these images are saturated, and show no contrast; help: use a shorter exposure or less \
             light",
            100.0 * share
        ))
    }
}

/// The mean; `None` without a value.
fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
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
