//! Tables of handles. A handle is a key in the form of a pointer to nothing: a closed, foreign or invented one is not found.

use crate::status::{Failure, Status};
use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Distance of keys: a handle looks like an aligned pointer.
const STEP: usize = 16;

/// The next key of all tables, so that no two kinds share one.
static NEXT: AtomicUsize = AtomicUsize::new(STEP);

/// The objects of one kind.
pub(crate) struct Handles<T> {
    /// Name of the kind, for errors.
    kind: &'static str,
    objects: Mutex<Option<HashMap<usize, Arc<T>>>>,
}

/// The content of a lock. Its data stay valid if a thread panicked.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<T> Handles<T> {
    pub(crate) const fn new(kind: &'static str) -> Self {
        Self { kind, objects: Mutex::new(None) }
    }

    /// Stores an object and gives its handle.
    pub(crate) fn open<H>(&self, object: T) -> *mut H {
        let key = NEXT.fetch_add(STEP, Ordering::Relaxed);
        lock(&self.objects).get_or_insert_default().insert(key, Arc::new(object));
        std::ptr::without_provenance_mut(key)
    }

    /// The object of a handle. It lives until the call ends, also if another thread closes the handle.
    pub(crate) fn get<H>(&self, handle: *const H) -> Result<Arc<T>, Failure> {
        let objects = lock(&self.objects);
        objects.as_ref().and_then(|all| all.get(&handle.addr())).cloned().ok_or_else(|| self.unknown(handle.is_null()))
    }

    /// Forgets the object of a handle. NULL is no error.
    pub(crate) fn close<H>(&self, handle: *mut H) -> Result<(), Failure> {
        if handle.is_null() {
            return Ok(());
        }
        let object = lock(&self.objects).as_mut().and_then(|all| all.remove(&handle.addr()));
        // The object is dropped without the lock of the table.
        object.map(drop).ok_or_else(|| self.unknown(false))
    }

    fn unknown(&self, is_null: bool) -> Failure {
        let problem = if is_null { "is NULL" } else { "is closed, or no handle of this kind" };
        Failure::new(Status::Argument, self.kind, problem, "pass a handle that is open")
    }
}
