//! A run: its clock, its progress, its cancellation switch, and its threads.

use crate::error::Error;
use crate::progress::{Cancel, Progress, ProgressState, Silent};
use crate::stage::Stage;
use rayon::ThreadPool;
use std::sync::Arc;
use std::time::Instant;
use thread_priority::{ThreadPriority, ThreadPriorityValue, set_current_thread_priority};

/// The largest nice value of threads in the background: with it they get the least time.
pub const MAX_NICE: u8 = 19;

/// Largest number of threads of a session.
pub const MAX_THREADS: usize = 1024;

/// Checks a number of threads.
///
/// # Errors
/// More than [`MAX_THREADS`].
pub fn check_threads(threads: usize) -> Result<(), Error> {
    if threads <= MAX_THREADS {
        return Ok(());
    }
    let help = format!("use at most {MAX_THREADS}, or 0 for one per core");
    Err(Error::setting("threads", format!("{threads} is out of range"), help))
}

static SILENT: Silent = Silent;
static NEVER: Cancel = Cancel::new();

/// The shared parts of all stages of a run: the instant from which a time budget counts, the sink of its progress, the
/// switch that cancels it, and one pool of threads. A copy shares the pool.
#[derive(Clone)]
pub struct Session<'a> {
    started: Instant,
    progress: &'a dyn Progress,
    cancel: &'a Cancel,
    pool: Arc<ThreadPool>,
}

impl Session<'static> {
    /// A session that starts now, without progress reports and without cancellation. With 0 threads it has one per
    /// core.
    ///
    /// # Errors
    /// More than [`MAX_THREADS`] threads; threads that cannot be started.
    pub fn new(threads: usize) -> Result<Self, Error> {
        Self::with_threads(threads, |_| {})
    }

    /// A session as that of [`Session::new`], whose threads have a lower priority than others: this nice value on Linux, 0 to
    /// [`MAX_NICE`], and the nearest priority on other systems. For long work beside a program that a person uses. With 0, and
    /// where the system refuses the priority, the threads are as others.
    ///
    /// # Errors
    /// As [`Session::new`]; a larger nice value.
    pub fn in_background(threads: usize, nice: u8) -> Result<Self, Error> {
        if nice > MAX_NICE {
            return Err(Error::setting("nice", format!("{nice} is out of range"), format!("use 0 to {MAX_NICE}")));
        }
        // The 40 nice values from 19 to -20 are spread over the priorities from 0 to 99.
        let priority = (100.0 - (f32::from(nice) + 20.5) / 39.0 * 100.0).max(0.0) as u8;
        Self::with_threads(threads, move |_| {
            let priority = ThreadPriorityValue::try_from(priority).map(ThreadPriority::Crossplatform);
            let _ = priority.map(|priority| nice > 0 && set_current_thread_priority(priority).is_ok());
        })
    }

    fn with_threads(threads: usize, start: impl Fn(usize) + Send + Sync + 'static) -> Result<Self, Error> {
        check_threads(threads)?;
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|i| format!("dunkelfeld-{i}"))
            .start_handler(start)
            .build()
            .map_err(|e| Error::Threads(e.to_string()))?;
        Ok(Self { started: Instant::now(), progress: &SILENT, cancel: &NEVER, pool: Arc::new(pool) })
    }
}

impl<'a> Session<'a> {
    /// The same session with a clock that started at `started`.
    pub fn with_start(self, started: Instant) -> Self {
        Self { started, ..self }
    }

    /// The same session, which reports to `progress`.
    pub fn with_progress<'b>(self, progress: &'b dyn Progress) -> Session<'b>
    where
        'a: 'b,
    {
        Session { started: self.started, progress, cancel: self.cancel, pool: self.pool }
    }

    /// The same session, which `cancel` ends.
    pub fn with_cancel<'b>(self, cancel: &'b Cancel) -> Session<'b>
    where
        'a: 'b,
    {
        Session { started: self.started, progress: self.progress, cancel, pool: self.pool }
    }

    /// When the clock started.
    pub fn started(&self) -> Instant {
        self.started
    }

    /// Seconds since the start.
    pub fn elapsed(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// The sink of the progress.
    pub fn progress(&self) -> &'a dyn Progress {
        self.progress
    }

    /// The switch that cancels the session.
    pub fn cancel(&self) -> &'a Cancel {
        self.cancel
    }

    /// Is the session cancelled?
    pub fn is_cancelled(&self) -> bool {
        self.cancel.is_cancelled()
    }

    /// Number of threads.
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Runs two pieces of work side by side on the threads of the session.
    pub fn join<A: Send, B: Send>(&self, a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
        self.install(|| rayon::join(a, b))
    }

    /// Runs `work` on the threads of the session.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        if rayon::current_thread_index().is_none() || self.pool.current_thread_index().is_some() {
            return self.pool.install(work);
        }
        // A worker of another pool, such as one that calls a progress function, would take up other work of its pool while it
        // waits. That work could wait for a lock that this thread holds. A thread without a pool only waits.
        std::thread::scope(|scope| match scope.spawn(|| self.pool.install(work)).join() {
            Ok(result) => result,
            Err(panic) => std::panic::resume_unwind(panic),
        })
    }

    /// Reports that `stage` begins, after so many samples.
    pub fn begin(&self, stage: Stage, fraction: f64, samples: u64) {
        self.progress.update(&ProgressState { stage, fraction, elapsed: self.elapsed(), remaining: None, samples });
    }

    /// Reports a share of work whose duration grows in proportion with it.
    pub fn report_share(&self, stage: Stage, fraction: f64) {
        let elapsed = self.elapsed();
        let remaining = (fraction > 0.0).then(|| elapsed * (1.0 - fraction) / fraction);
        self.progress.update(&ProgressState { stage, fraction, elapsed, remaining, samples: 0 });
    }
}

impl std::fmt::Debug for Session<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut text = f.debug_struct("Session");
        text.field("threads", &self.threads()).field("is_cancelled", &self.is_cancelled()).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_scene::{Material, SceneBuilder, shapes};
    use rayon::prelude::*;
    use std::sync::Mutex;

    /// A worker of a pool holds a lock while it builds a scene on several threads. If it took up other work of its pool while
    /// it waits, it would wait for its own lock.
    #[test]
    fn a_scene_is_built_within_a_pool_and_a_lock() {
        let mut builder = SceneBuilder { threads: 3, ..SceneBuilder::default() };
        let grey = builder.add_material(Material::default());
        builder.add_object("ball", shapes::sphere(Default::default(), 1.0, 120, true), grey);
        assert!(builder.meshes[0].mesh.triangles.len() > 1 << 14, "it has several threads");
        let fingerprint = |builder: SceneBuilder| builder.build().expect("valid").0.fingerprint();
        let alone = fingerprint(SceneBuilder { threads: 1, ..builder.clone() });
        let lock = Mutex::new(());
        let all: Vec<u128> = Session::new(2).expect("threads").install(|| {
            let build = |_| {
                let _guard = lock.lock().expect("no panic");
                fingerprint(builder.clone())
            };
            (0..8).into_par_iter().with_max_len(1).map(build).collect()
        });
        assert_eq!(all, [alone; 8]);
    }
}

#[cfg(all(test, target_os = "linux"))]
mod priorities {
    use super::*;

    /// The nice value of this thread (getpriority(2): on Linux it is that of a thread).
    fn nice() -> i32 {
        rustix::process::getpriority_process(None).expect("a priority")
    }

    /// Threads in the background have a lower priority than the others, and the caller keeps its own.
    #[test]
    fn background_threads_have_a_lower_priority() {
        let own = nice();
        let of = |session: Session<'_>| session.install(nice);
        assert_eq!(of(Session::new(2).expect("threads")), own);
        for value in [0, 1, 10, 18, MAX_NICE] {
            let expected = if value == 0 { own } else { i32::from(value).max(own) };
            assert_eq!(of(Session::in_background(2, value).expect("threads")), expected);
        }
        assert!(Session::in_background(2, MAX_NICE + 1).is_err());
        assert_eq!(nice(), own);
    }
}
