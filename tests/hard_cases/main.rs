//! Hard cases: scenes at the edge of what numbers can hold, each against a value known from elsewhere.
//!
//! One file per family; each opens with what is hard, why it breaks others, and the value it must give. Every case asks
//! for three things: no panic, no sample that is not finite or negative, and the closed form or limit within four standard
//! errors, with a bound on the standard error stated in the case, so that a test cannot pass by being noisy: 1e-3 for
//! furnaces, whose sky is 1. `docs/numerics.md` lists what is checked where; `table.rs` holds it to the code.
//!
//! False alarms: `testkit::Claim` fails a case only if three renders with independent seeds, the later ones with four and
//! sixteen times the samples, are *all* off by more than four standard errors to the same side. For 256 pixel means that has
//! probability 1.4e-13, and the suite makes fewer than 1000 such checks: below 2e-10 in all. A true deviation fails all three
//! the more surely, as the second and third look closer. Replay:
//! `cargo test -p dunkelfeld --test hard_cases FAMILY::NAME`.

#[path = "../support/mod.rs"]
mod common;
mod support;

mod accumulation;
mod facets;
mod furnaces;
mod grazing;
mod invariance;
mod light;
mod limits;
mod shading;
mod table;
mod thin;
