//! Division of an image into tiles that are computed independently, and assembly of the results.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use dunkelfeld_film::Plane;

use crate::denoiser::{Control, DenoiseError};

/// Edge of a tile in pixels. It is small enough that the neighbourhood of a tile stays in the cache of a core, and that
/// a tile takes at most some tens of milliseconds.
const EDGE: u32 = 60;

/// A rectangle of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tile {
    /// The first column.
    pub(super) x: u32,
    /// The first row.
    pub(super) y: u32,
    /// Number of columns, at least 1.
    pub(super) width: usize,
    /// Number of rows, at least 1.
    pub(super) height: usize,
}

/// The plane of the results of `work` for each tile, row by row. The threads of the executor share the tiles. A result
/// must depend on its tile alone, so the plane is the same for any number of threads. Progress runs through `share`, a
/// part of \[0, 1\].
///
/// # Errors
/// [`DenoiseError::Cancelled`] if the progress callback returns false.
pub(super) fn map_tiles<T: Clone + Default + Send + Sync>(
    (width, height): (u32, u32),
    control: &Control<'_>,
    share: (f64, f64),
    work: impl Fn(&Tile) -> Vec<T> + Sync,
) -> Result<Plane<T>, DenoiseError> {
    let (columns, rows) = (width.div_ceil(EDGE), height.div_ceil(EDGE));
    let tile = |i: usize| {
        let (x, y) = (i as u32 % columns * EDGE, i as u32 / columns * EDGE);
        Tile { x, y, width: EDGE.min(width - x) as usize, height: EDGE.min(height - y) as usize }
    };
    let pieces = columns as usize * rows as usize;
    let results: Vec<OnceLock<Vec<T>>> = (0..pieces).map(|_| OnceLock::new()).collect();
    let (done, cancelled) = (AtomicUsize::new(0), AtomicBool::new(false));
    control.executor.for_each(pieces, &|i| {
        if cancelled.load(Ordering::Relaxed) {
            return;
        }
        let values = results[i].get_or_init(|| work(&tile(i)));
        debug_assert_eq!(values.len(), tile(i).width * tile(i).height);
        let fraction = (done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / pieces as f64;
        if !(control.progress)(share.0 + (share.1 - share.0) * fraction) {
            cancelled.store(true, Ordering::Relaxed);
        }
    });
    if cancelled.into_inner() {
        return Err(DenoiseError::Cancelled);
    }
    let mut plane = Plane::new(width, height, T::default());
    for (i, values) in results.into_iter().enumerate() {
        let Tile { x, y, width: w, .. } = tile(i);
        for (row, values) in values.into_inner().unwrap_or_default().chunks(w).enumerate() {
            let start = (y as usize + row) * width as usize + x as usize;
            plane.data_mut()[start..start + values.len()].clone_from_slice(values);
        }
    }
    Ok(plane)
}
