//! Where the samples go, and how many there may be: pure functions on planes. No clock, no threads, no rendering.
//!
//! The founding paper (C. Kludt, F. Seiler, V. Eichinger, J. Meyer, I. Effenberger, T. Längle, J. Beyerer: *Noise
//! analysis of a synthetically rendered scene in sensor-realistic image simulation*) renders a scene fifty times and
//! finds that the temporal variance of its pixels is high where the image has edges. Measuring that variance costs fifty
//! renderings; the edges can be had from one. So it proposes to filter one rendering with a Sobel operator, to set the
//! samples of each pixel accordingly, and to let the time that is available decide their average. Step by step:
//!
//! | step | here |
//! |---|---|
//! | a pilot with the same number of samples everywhere | [`schedule`] (how many), [`plan`] (which pixels) |
//! | clip at white, gamma 2.2, eight bits | [`sobel::gamma_image`] |
//! | Sobel magnitude | [`sobel::magnitude`] |
//! | weights above a floor, mean one | [`allocation::Strategy`] |
//! | whole samples per pixel whose average meets the budget | [`plan::next_round`] |
//! | rounds until the time is used up, replanned from all data at about 8 % and 31 % | [`schedule::Schedule`] |
//!
//! The paper plans once, and leaves open how a target time becomes a number of samples. Here the render replans as
//! data comes in, learns what samples cost ([`cost`]), and approaches its deadline in rounds that shrink with the time
//! left. The clock decides how many samples a round has; a hash decides which pixels have them. A plan, once written,
//! can therefore be replayed to the same bits on any machine.
//!
//! ```
//! use dunkelfeld_adaptive::{allocation, plan, schedule};
//! use dunkelfeld_film::Plane;
//!
//! // A render of 8 x 4 pixels with 64 samples per pixel, a step edge in its middle.
//! let luminance = Plane::from_fn(8, 4, |x, _| if x < 4 { 0.1 } else { 0.8 });
//! let limits = schedule::Limits { samples: Some(plan::total_for_mean(64.0, 32)), ..Default::default() };
//! let settings = schedule::Settings { pixels: 32, pilot_spp: 16, closing_seconds: 0.0 };
//! let mut schedule = schedule::Schedule::new(limits, settings);
//! let mut weights = allocation::uniform(8, 4);
//! let mut taken = plan::empty(8, 4);
//! while let schedule::Step::Round(round) = schedule.next(0.0, 1.0) {
//!     if round.replan {
//!         let pilot = allocation::Pilot { luminance: &luminance, white: 1.0, sobel_floor: 0.25 };
//!         weights = allocation::Strategy::Sobel.weights(&pilot);
//!     }
//!     let next = plan::next_round(&taken, &weights, schedule.taken() + round.samples);
//!     // ... render `plan::increment(&taken, &next)` here ...
//!     schedule.record(round.samples, round.samples as f64, 0.1);
//!     taken = next;
//! }
//! assert_eq!(plan::total(&taken), 64 * 32);
//! assert!(taken.at(3, 2) > taken.at(0, 2));
//! ```

#![forbid(unsafe_code)]

pub mod allocation;
pub mod cost;
pub mod plan;
pub mod schedule;
pub mod sobel;

pub use allocation::{Pilot, Strategy, UnknownStrategy};
pub use cost::{CostMap, TileGrid, TileRect, WorkUnit};
pub use plan::SamplePlan;
pub use schedule::{Limits, Phase, Round, Schedule, Settings, Step, StopReason};
