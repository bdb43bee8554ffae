//! Computations on several threads.

use std::num::NonZeroUsize;
use std::sync::{Mutex, PoisonError};
use std::thread::{Builder, available_parallelism, scope};

/// The number of threads that a computation may use. Its result does not depend on it.
///
/// The threads exist during the computation alone, and take up no other work while they wait. So a thread that holds a lock,
/// or a worker of a pool, may start one. They have the priority of the caller (Linux).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Threads(NonZeroUsize);

impl Threads {
    /// The thread of the caller alone.
    pub const ONE: Self = Self(NonZeroUsize::MIN);

    /// So many threads; 0 means one per core.
    pub fn new(count: usize) -> Self {
        Self(NonZeroUsize::new(count).or_else(|| available_parallelism().ok()).unwrap_or(NonZeroUsize::MIN))
    }

    /// Number of threads.
    pub fn count(self) -> usize {
        self.0.get()
    }

    /// At most so many of these threads, and at least one.
    #[must_use]
    pub fn at_most(self, count: usize) -> Self {
        NonZeroUsize::new(count).map_or(Self::ONE, |count| Self(self.0.min(count)))
    }

    /// Runs `work` once on each thread, one of which is that of the caller. A thread that the system refuses is left out.
    /// Returns the results of all threads.
    pub fn run<R: Send>(self, work: impl Fn() -> R + Sync) -> Vec<R> {
        if self == Self::ONE {
            return vec![work()];
        }
        scope(|scope| {
            let spawn = |_| Builder::new().name("dunkelfeld-build".into()).spawn_scoped(scope, &work).ok();
            let others: Vec<_> = (1..self.count()).filter_map(spawn).collect();
            let own = work();
            let join = |thread: std::thread::ScopedJoinHandle<'_, R>| match thread.join() {
                Ok(result) => result,
                Err(panic) => std::panic::resume_unwind(panic),
            };
            std::iter::once(own).chain(others.into_iter().map(join)).collect()
        })
    }

    /// The results of tasks in their order. The threads take them in this order too, each when it has finished another one:
    /// the longest tasks should come first.
    pub fn map<T: Send, R: Send>(self, tasks: Vec<T>, work: impl Fn(T) -> R + Sync) -> Vec<R> {
        let threads = self.at_most(tasks.len());
        if threads == Self::ONE {
            return tasks.into_iter().map(work).collect();
        }
        let count = tasks.len();
        let queue = Mutex::new(tasks.into_iter().enumerate());
        let next = || queue.lock().unwrap_or_else(PoisonError::into_inner).next();
        let worked = threads.run(|| {
            let taken = std::iter::from_fn(next);
            taken.map(|(number, task)| (number, work(task))).collect::<Vec<_>>()
        });
        let mut numbered = Vec::with_capacity(count);
        worked.into_iter().for_each(|results| numbered.extend(results));
        numbered.sort_unstable_by_key(|(number, _)| *number);
        numbered.into_iter().map(|(_, result)| result).collect()
    }
}

impl Threads {
    /// Smallest number of triangles that is worth several threads: their tree takes some milliseconds.
    pub const LARGE: usize = 1 << 14;

    /// The results of tasks in their order. Sizes are numbers of triangles. `work` receives a task and the threads that it
    /// may use. A task with a large share of all triangles has all threads, and is done alone. The others have one thread
    /// each, and the largest ones come first. So the memory of the tasks that are done at the same time is bounded.
    pub fn map_sized<T: Send, R: Send>(
        self,
        tasks: Vec<T>,
        size: impl Fn(&T) -> usize,
        work: impl Fn(T, Self) -> R + Sync,
    ) -> Vec<R> {
        let total: usize = tasks.iter().map(&size).sum();
        let threads = if total < Self::LARGE { Self::ONE } else { self };
        let has_all = |size: usize| size >= Self::LARGE && size.saturating_mul(4 * threads.count()) > total;
        let count = tasks.len();
        let mut numbered: Vec<(usize, T)> = tasks.into_iter().enumerate().collect();
        numbered.sort_by_key(|(_, task)| std::cmp::Reverse(size(task)));
        let rest = numbered.iter().position(|(_, task)| !has_all(size(task))).unwrap_or(count);
        let others = numbered.split_off(rest);
        let mut results: Vec<(usize, R)> = numbered.into_iter().map(|(i, task)| (i, work(task, threads))).collect();
        results.extend(threads.map(others, |(i, task)| (i, work(task, Self::ONE))));
        results.sort_unstable_by_key(|(i, _)| *i);
        results.into_iter().map(|(_, result)| result).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_tasks_have_all_threads_and_results_have_the_order_of_the_tasks() {
        const LARGE: usize = Threads::LARGE;
        let tasks = vec![3, LARGE / 2, 10 * LARGE, 7, LARGE];
        let results = Threads::new(2).map_sized(tasks.clone(), |size| *size, |size, threads| (size, threads.count()));
        assert_eq!(results, [(3, 1), (LARGE / 2, 1), (10 * LARGE, 2), (7, 1), (LARGE, 1)]);
        let caller = std::thread::current().id();
        let small = Threads::new(2).map_sized(vec![1, 2, 3], |size| *size, |_, _| std::thread::current().id());
        assert_eq!(small, [caller; 3], "small tasks start no thread");
    }

    #[test]
    #[should_panic(expected = "a fault in a task")]
    fn a_panic_of_a_task_reaches_the_caller() {
        Threads::new(2).map(vec![0, 1, 2, 3], |i| assert!(i != 2, "a fault in a task"));
    }
}
