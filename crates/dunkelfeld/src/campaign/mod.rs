//! Many renders as one long piece of work: each is kept in a folder as soon as it is finished, so that what was interrupted
//! goes on where it was; all tell one progress; all are seen alike.

mod kept;
mod meter;
pub(crate) mod statistics;
mod view;

pub(crate) use kept::{Facts, Kept, UNITS, hash_text, plane_of, push_plane};
pub(crate) use meter::Meter;
pub(crate) use view::{View, exposure_words};
