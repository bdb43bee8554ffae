//! Locks of the states that threads share.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks a state. A thread that failed with the lock leaves plain data behind, which stay usable.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
