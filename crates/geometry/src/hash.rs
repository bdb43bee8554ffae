//! A fast hash for the bits of floats. It is used to weld positions and to group equal boxes.
//!
//! It does not resist chosen keys. A mesh made for collisions can slow down its own render.

use std::hash::{BuildHasherDefault, Hasher};

/// For `HashMap<_, _, FastHash>`. It has no seed, so all runs are equal.
pub type FastHash = BuildHasherDefault<BitsHasher>;

/// Multiply to 128 bits and fold (the mixing step of wyhash, Wang Yi 2019), word by word.
#[derive(Clone, Copy, Debug, Default)]
pub struct BitsHasher(u64);

impl Hasher for BitsHasher {
    fn write(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.write_u64(u64::from_le_bytes(word));
        }
    }

    fn write_u32(&mut self, word: u32) {
        self.write_u64(u64::from(word));
    }

    fn write_u64(&mut self, word: u64) {
        let product = u128::from(self.0 ^ word ^ 0x9e37_79b9_7f4a_7c15) * 0xd134_2543_de82_ef95;
        self.0 = (product >> 64) as u64 ^ product as u64;
    }

    fn finish(&self) -> u64 {
        self.0
    }
}
