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
//! | a pilot with the same number of samples everywhere | [`budget`] (how many), [`plan`] (which pixels) |
//! | clip at white, gamma 2.2, eight bits | [`sobel::gamma_image`] |
//! | Sobel magnitude | [`sobel::magnitude`] |
//! | weights above a floor, mean one | [`weights::Strategy`] |
//! | whole samples per pixel whose average meets the budget | [`plan::next_round_of`] |
//! | a pilot (the paper's has about 8 % of the budget; a fifth knows more, and is less than most pixels get anyway), then rounds until it is used up | [`budget::Schedule`] |
//!
//! The edges stand for the variance, and the variance for what can be seen. With a sensor one can do better: measure the
//! variance itself, ask what each pixel [`required_samples`]s to be hidden beneath the sensor's own noise, share out the samples by what is to be
//! [`variance::neighbours`] of it, stop when it is reached, and say how far it was ([`certificate`]), by what each pixel's [`variance::pixel`] samples tell.
//!
//! The samples of a pixel must not decide how many others join them in its mean: whoever takes more where a sample was bright
//! dilutes the bright one, and the mean is too small (Kirk and Arvo 1991). So a plan is made once, from the pilot, and what a
//! pixel gets is decided by its neighbours alone ([`variance::neighbours`]).
//!
//! The paper leaves open how a target time becomes a number of samples. Here the render learns what samples cost ([`tile_cost`]), and approaches its deadline in rounds that shrink with the time
//! left. The clock decides how many samples a round has; a hash decides which pixels have them. A plan, once written,
//! can therefore be replayed to the same bits on any machine.
//!
//! ```
//! use dunkelfeld_adaptive::{weights, plan, budget};
//! use dunkelfeld_film::Plane;
//!
//! // A render of 8 x 4 pixels with 64 samples per pixel, a step edge in its middle.
//! let luminance = Plane::from_fn(8, 4, |x, _| if x < 4 { 0.1 } else { 0.8 });
//! let limits = budget::Limits { samples: Some(plan::total_for_mean(64.0, 32)), ..Default::default() };
//! let settings = budget::Settings { pixels: 32, pilot_spp: 16, closing_seconds: 0.0 };
//! let mut schedule = budget::Schedule::new(limits, settings);
//! let mut shares = weights::Shares::from_weights(weights::uniform(8, 4));
//! let mut taken = plan::empty(8, 4);
//! while let budget::Step::Round(round) = schedule.next(0.0, 1.0) {
//!     if round.replan {
//!         let pilot = weights::Pilot { luminance: &luminance, white: 1.0, sobel_floor: 0.25, measured: None };
//!         shares = weights::Strategy::Sobel.shares(&pilot);
//!     }
//!     let next = plan::next_round_of(&taken, &shares, schedule.taken() + round.samples);
//!     // ... render `plan::increment(&taken, &next)` here ...
//!     schedule.record(round.samples, round.samples as f64, 0.1);
//!     taken = next;
//! }
//! assert_eq!(plan::total(&taken), 64 * 32);
//! assert!(taken.at(3, 2) > taken.at(0, 2));
//! ```

#![forbid(unsafe_code)]

pub mod budget;
pub mod certificate;
pub mod plan;
pub mod required_samples;
pub mod sobel;
pub mod tile_cost;
pub mod variance;
pub mod weights;

pub use budget::{Limits, Phase, Round, Schedule, Settings, Step, StopReason};
pub use certificate::{Certificate, Claim, certify};
pub use plan::SamplePlan;
pub use required_samples::{RequiredSamples, SensorNoise};
pub use tile_cost::{CostMap, TileGrid, TileRect, WorkUnit};
pub use variance::inputs::{NoiseInputs, PixelFeatures};
pub use variance::neighbours::PredictedNoise;
pub use variance::pooled::PixelNoise;
pub use weights::{MeasuredNoise, Pilot, Shares, Strategy, UnknownStrategy};
