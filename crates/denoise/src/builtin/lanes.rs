//! Loops over neighbours in a row, in the form that a compiler turns into what registers the machine has.

/// Rows are worked on in multiples of so many numbers, so that none is left over for a slower loop
/// (compilers take four registers of eight at a time).
pub(super) const WIDTH: usize = 32;

/// `n` numbers from `start` on.
#[inline(always)]
pub(super) fn lanes(values: &[f32], start: usize, n: usize) -> &[f32] {
    &values[start..start + n]
}

/// The same to be written.
#[inline(always)]
pub(super) fn lanes_mut(values: &mut [f32], start: usize, n: usize) -> &mut [f32] {
    &mut values[start..start + n]
}

/// The lesser of two, the second if one is not a number: one instruction, which [`f32::min`] is not.
#[inline(always)]
pub(super) fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The greater of two, the second if one is not a number.
#[inline(always)]
pub(super) fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Sets each number of a row to an expression of its place and itself: `each!(row, |place, old| new)`.
///
/// A macro, as closures are compiled for the least of machines and are not always inlined into what is for better ones.
macro_rules! each {
    ($row:expr, |$place:ident, $old:pat_param| $new:expr) => {{
        let row: &mut [f32] = $row;
        // Counted, not iterated over: so the places are known to lie in other slices of this length.
        #[allow(clippy::needless_range_loop)]
        for $place in 0..row.len() {
            let $old = row[$place];
            row[$place] = $new;
        }
    }};
}
pub(super) use each;
