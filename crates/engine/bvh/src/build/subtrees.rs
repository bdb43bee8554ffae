//! The binary tree on several threads, with the bits of a tree by one.
//!
//! The largest set is divided first. A set below [`SUBTREE`] boxes becomes a subtree without further tasks. As a division is
//! a function of the set, the order of the tasks changes nothing. At last the subtrees are joined in the order of the sets.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use super::split::{BinaryNode, Extent, Reference, Splitter};

/// Sets of fewer boxes are not divided into tasks.
const SUBTREE: usize = 1 << 12;

/// The sets of a tree, and the subtrees so far.
pub(super) struct Subtrees<'a> {
    splitter: &'a Splitter,
    state: Mutex<State<'a>>,
    /// There are new tasks, or no task is left.
    changed: Condvar,
}

struct State<'a> {
    tasks: BinaryHeap<Task<'a>>,
    /// Number of tasks that threads work on.
    running: usize,
    /// The sets of all tasks so far, the whole one first.
    sets: Vec<Set>,
}

/// A set of boxes to be divided or to become a subtree.
struct Task<'a> {
    references: &'a mut [Reference],
    /// The number of the first box in the list of all.
    first: u32,
    extent: Extent,
    levels: usize,
    /// The number of the set.
    set: usize,
}

/// A set of boxes.
enum Set {
    Unfinished,
    /// The numbers of two other sets.
    Divided([usize; 2]),
    Subtree(Vec<BinaryNode>),
}

impl<'a> Subtrees<'a> {
    /// A tree over at least one box, with at most so many levels.
    pub(super) fn new(splitter: &'a Splitter, references: &'a mut [Reference], extent: Extent, levels: usize) -> Self {
        let whole = Task { references, first: 0, extent, levels, set: 0 };
        let state = State { tasks: BinaryHeap::from([whole]), running: 0, sets: vec![Set::Unfinished] };
        Self { splitter, state: Mutex::new(state), changed: Condvar::new() }
    }

    /// Builds the tree and appends its nodes.
    pub(super) fn build(self, nodes: &mut Vec<BinaryNode>) {
        self.splitter.threads.run(|| {
            while let Some(task) = self.next() {
                let finished = Finished(&self);
                self.work(task);
                drop(finished);
            }
        });
        let State { mut sets, .. } = self.state.into_inner().unwrap_or_else(PoisonError::into_inner);
        join(&mut sets, 0, self.splitter.leaf_size, nodes);
    }

    fn lock(&self) -> MutexGuard<'_, State<'a>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The largest set of all. Waits for others if there is none now, and returns `None` if there will be none.
    fn next(&self) -> Option<Task<'a>> {
        let mut state = self.lock();
        loop {
            if let Some(task) = state.tasks.pop() {
                state.running += 1;
                return Some(task);
            }
            if state.running == 0 {
                return None;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn work(&self, task: Task<'a>) {
        let Task { references, first, extent, levels, set } = task;
        if references.len() < SUBTREE {
            let mut nodes = Vec::with_capacity(references.len() / 2);
            self.splitter.build_below(references, first, &extent, levels, &mut nodes);
            self.lock().sets[set] = Set::Subtree(nodes);
            return;
        }
        let (middle, [left_extent, right_extent]) = self.splitter.divide(references, &extent, levels);
        let (left, right) = references.split_at_mut(middle);
        let levels = levels.saturating_sub(1);
        let mut state = self.lock();
        let next = state.sets.len();
        state.sets[set] = Set::Divided([next, next + 1]);
        state.sets.extend([Set::Unfinished, Set::Unfinished]);
        state.tasks.push(Task { references: left, first, extent: left_extent, levels, set: next });
        let first = first + middle as u32;
        state.tasks.push(Task { references: right, first, extent: right_extent, levels, set: next + 1 });
    }
}

/// The end of a task, also by a panic: no thread may wait for it for ever.
struct Finished<'a, 'b>(&'a Subtrees<'b>);

impl Drop for Finished<'_, '_> {
    fn drop(&mut self) {
        self.0.lock().running -= 1;
        self.0.changed.notify_all();
    }
}

/// Appends the nodes of a set: each before its children, the first child with all below before the second one. Recursion is
/// as deep as the levels.
fn join(sets: &mut [Set], number: usize, leaf_size: usize, nodes: &mut Vec<BinaryNode>) {
    match std::mem::replace(&mut sets[number], Set::Unfinished) {
        Set::Unfinished => {}
        Set::Subtree(subtree) => {
            let before = nodes.len() as u32;
            nodes.extend(subtree.into_iter().map(|node| node.moved(before)));
        }
        Set::Divided([left, right]) => {
            let at = nodes.len();
            nodes.push(BinaryNode::EMPTY);
            join(sets, left, leaf_size, nodes);
            let second = nodes.len() as u32;
            join(sets, right, leaf_size, nodes);
            nodes[at] = BinaryNode::above(nodes, [at as u32 + 1, second], leaf_size);
        }
    }
}

impl Ord for Task<'_> {
    fn cmp(&self, other: &Self) -> Ordering {
        self.references.len().cmp(&other.references.len())
    }
}

impl PartialOrd for Task<'_> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Task<'_> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Task<'_> {}
