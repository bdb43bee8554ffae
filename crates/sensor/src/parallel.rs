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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_is_visited_once_within_a_pool_and_outside() {
        let visit = |width: u32, count: usize| {
            let mut values = vec![0u32; count];
            let visited = for_rows(&mut values, width, |y, row| {
                row.iter_mut().zip(0..).for_each(|(value, x)| *value += 100 * y as u32 + x + 1);
                row.len() as u64
            });
            (values, visited)
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("threads");
        for (width, count) in [(4, 40), (1, 5), (7, 0), (0, 0)] {
            let expected = (0..count as u32).map(|i| 100 * (i / width.max(1)) + i % width.max(1) + 1).collect();
            assert_eq!(visit(width, count), (expected, count as u64));
            assert_eq!(pool.install(|| visit(width, count)), visit(width, count));
        }
    }
}
