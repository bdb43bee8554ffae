//! Rows of an image on several threads.

use rayon::prelude::*;

/// Calls a function with the number and the values of each row, and returns the sum of its results. It runs on the threads of
/// the pool of the caller. Outside of a pool it runs on the thread of the caller, so that no pool is started.
pub(crate) fn for_rows<T: Send>(
    values: &mut [T],
    width: u32,
    of_row: impl Fn(usize, &mut [T]) -> u64 + Send + Sync,
) -> u64 {
    let width = width.max(1) as usize;
    match rayon::current_thread_index() {
        Some(_) => values.par_chunks_mut(width).enumerate().map(|(y, row)| of_row(y, row)).sum(),
        None => values.chunks_mut(width).enumerate().map(|(y, row)| of_row(y, row)).sum(),
    }
}
