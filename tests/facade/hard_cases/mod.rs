//! Hard cases: scenes at the limits of floating-point numbers, each against an independent value.
//!
//! One file per family; each begins with the difficulty, the failure of other programs, and the expected value. Every case checks
//! three properties: no panic, no sample that is not finite or negative, and the closed form or limit within four standard
//! errors, with a bound on the standard error stated in the case, so that a test cannot pass by being noisy: 1e-3 for
//! furnaces, whose sky is 1. `docs/numerics.md` lists the cases and their tests; `table.rs` compares it with the code.
//!
//! False alarms: `testkit::Claim` fails a case only if three renders with independent seeds, the later ones with four and
//! sixteen times the samples, are *all* off by more than four standard errors to the same side. For 256 pixel means that has
//! probability 1.4e-13, and the suite makes fewer than 1000 such checks: below 2e-10 in all. A true deviation fails all three,
//! since the second and third are more precise. Replay:
//! `cargo test -p dunkelfeld --test it hard_cases::FAMILY::NAME`.

mod support;

mod facets;
mod furnaces;
mod grazing;
mod invariance;
mod light;
mod limits;
mod shading;
mod table;
mod thin;
