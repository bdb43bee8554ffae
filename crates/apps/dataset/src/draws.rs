//! Keyed random numbers: a draw is a pure function of the study, the index of the image, and the name of the value.

use dunkelfeld_sampling::{Pcg, hash_u64};
use rand_core::Rng;
use twox_hash::XxHash3_64;

/// The draws of one image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Draws {
    /// Seed of the study.
    pub(crate) seed: u64,
    /// Index of the image.
    pub(crate) index: u64,
}

impl Draws {
    /// The stream of random bits of a value. Streams of different names are independent.
    pub(crate) fn stream(self, name: &str) -> Pcg {
        let key = hash_u64([self.seed, self.index, XxHash3_64::oneshot(name.as_bytes())]);
        Pcg::new(u128::from(hash_u64([key, 1])) << 64 | u128::from(hash_u64([key, 2])))
    }

    /// A uniform number in [0, 1) for a value.
    pub(crate) fn uniform(self, name: &str) -> f64 {
        uniform(&mut self.stream(name))
    }
}

/// The next uniform number of a stream, in [0, 1): a multiple of 2^-53.
pub(crate) fn uniform(stream: &mut Pcg) -> f64 {
    (stream.next_u64() >> 11) as f64 * 2f64.powi(-53)
}
