//! Points where tests make operations of the file system fail. Builds without the feature `faults` contain no such code.
//!
//! Every write calls these functions before each operation. `before` may return an error in its place, `most` may
//! shorten a write.

use std::io;

/// An operation of the file system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Creation of a file or folder under the partial name.
    Create,
    /// The advisory lock of a file.
    Lock,
    /// Write of bytes into a partial file.
    Write,
    /// Change of the position in a partial file.
    Seek,
    /// Sync of a file or folder to the disk.
    Sync,
    /// Rename of the partial name to that of the target.
    Rename,
}

/// Runs an operation, and repeats it as long as a signal interrupts it (EINTR).
pub(crate) fn retry<T>(operation: Operation, mut run: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    loop {
        match before(operation).and_then(|()| run()) {
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            result => return result,
        }
    }
}

#[cfg(not(any(test, feature = "faults")))]
fn before(_: Operation) -> io::Result<()> {
    Ok(())
}

/// Number of bytes that a write of `bytes` bytes writes at a time.
#[cfg(not(any(test, feature = "faults")))]
pub(crate) fn most(bytes: usize) -> usize {
    bytes
}

#[cfg(any(test, feature = "faults"))]
pub use plan::{Fault, with_fault};
#[cfg(any(test, feature = "faults"))]
pub(crate) use plan::{before, most};

#[cfg(any(test, feature = "faults"))]
mod plan {
    use super::Operation;
    use std::cell::RefCell;
    use std::io;

    /// The fault of an operation.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Fault {
        /// This operating-system error, once.
        Once(i32),
        /// This error for this and every later operation of the same kind, as on a full disk.
        EverAfter(i32),
        /// A write writes a single byte.
        Short,
    }

    #[derive(Debug)]
    struct Plan {
        fault: Fault,
        /// The operations where the fault may occur.
        kinds: Vec<Operation>,
        /// Number of the operation of the fault, from zero.
        at: usize,
        seen: usize,
        /// The kind of the operation where it occurred.
        met: Option<Operation>,
        short: bool,
    }

    thread_local! {
        static PLAN: RefCell<Option<Plan>> = const { RefCell::new(None) };
    }

    /// Runs `work` on this thread with a fault at operation number `at` of these kinds. Did the fault occur?
    pub fn with_fault<T>(
        fault: Fault,
        kinds: &[Operation],
        at: usize,
        work: impl FnOnce() -> T,
    ) -> (T, Option<Operation>) {
        let plan = Plan { fault, kinds: kinds.to_vec(), at, seen: 0, met: None, short: false };
        PLAN.with_borrow_mut(|slot| *slot = Some(plan));
        let result = work();
        let plan = PLAN.with_borrow_mut(Option::take);
        (result, plan.and_then(|p| p.met))
    }

    pub(crate) fn before(operation: Operation) -> io::Result<()> {
        PLAN.with_borrow_mut(|slot| {
            let Some(plan) = slot.as_mut().filter(|plan| plan.kinds.contains(&operation)) else { return Ok(()) };
            let number = plan.seen;
            plan.seen += 1;
            let is_due = match plan.fault {
                Fault::EverAfter(_) => plan.met.map_or(number == plan.at, |met| met == operation),
                _ => number == plan.at,
            };
            if !is_due {
                return Ok(());
            }
            plan.met = Some(operation);
            match plan.fault {
                Fault::Once(code) | Fault::EverAfter(code) => Err(io::Error::from_raw_os_error(code)),
                Fault::Short => {
                    plan.short = true;
                    Ok(())
                }
            }
        })
    }

    pub(crate) fn most(bytes: usize) -> usize {
        PLAN.with_borrow_mut(|slot| {
            let short = slot.as_mut().is_some_and(|plan| std::mem::take(&mut plan.short));
            if short { bytes.min(1) } else { bytes }
        })
    }
}
