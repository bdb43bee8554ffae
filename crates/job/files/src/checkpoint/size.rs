//! The size of a checkpoint's film, from the head of its file alone.

use super::{CHECKPOINT_VERSION, HEAD, MAGIC, is_size};
use crate::input::{InputFiles, MAX_STREAMED, Role};
use std::io::Read;
use std::path::Path;

/// Width and height \[pixels\] of the film of a checkpoint. `None` for a file that is no checkpoint of this version, or
/// cannot be read: the error of [`read_checkpoint`](super::read_checkpoint) gives the reason.
pub fn checkpoint_size(path: &Path) -> Option<(u32, u32)> {
    let mut head = [0; HEAD];
    InputFiles::new().open(path, Role::Part, MAX_STREAMED).ok()?.read_exact(&mut head).ok()?;
    let word = |at: usize| Some(u32::from_le_bytes(head.get(at..at + 4)?.try_into().ok()?));
    let (width, height) = (word(12)?, word(16)?);
    (head.starts_with(&MAGIC) && word(8)? == CHECKPOINT_VERSION && is_size(width, height)).then_some((width, height))
}
