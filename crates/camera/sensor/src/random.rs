//! Random numbers of a pixel, by key.

use dunkelfeld_sampling::{Pcg, mix64};

/// Random numbers of one pixel. `key` already contains all other coordinates, so two rounds of mixing suffice.
#[inline]
pub(crate) fn stream(key: u64, pixel: u64) -> Pcg {
    let high = mix64(key ^ pixel);
    Pcg::new(u128::from(high) << 64 | u128::from(mix64(high)))
}
