//! The allocation of samples to pixels and the number of samples: pure functions on planes, without clock, threads or
//! rendering.
//!
//! The founding paper (C. Kludt, F. Seiler, V. Eichinger, J. Meyer, I. Effenberger, T. Längle, J. Beyerer: *Noise
//! analysis of a synthetically rendered scene in sensor-realistic image simulation*) renders a scene fifty times. It
//! finds that the temporal variance of the pixels is high at the edges of the image. Measuring the variance costs fifty
//! renderings, finding the edges costs one. So the paper proposes to filter one rendering with a Sobel operator and to
//! set the samples of each pixel accordingly. The available time decides their average. The steps are:
//!
//! | step | here |
//! |---|---|
//! | a pilot with the same number of samples everywhere | [`budget`] (how many), [`plan`] (which pixels) |
//! | clip at white, gamma 2.2, eight bits | [`sobel::gamma_image`] |
//! | Sobel magnitude | [`sobel::magnitude`] |
//! | weights above a floor, mean one | [`weights::Strategy`] |
//! | whole samples per pixel whose average meets the budget | [`plan::next_round`] |
//! | a pilot, then rounds until the budget is used up (the pilot of the paper has about 8 % of the budget; a fifth gives better estimates, and is less than most pixels get anyway) | [`budget::Schedule`], [`queue`] |
//!
//! The edges are a proxy of the variance, and the variance is a proxy of visible noise. With a sensor, the render uses
//! the variance itself, over that of the sensor ([`weights::sensor`]). The module [`required_samples`] computes the samples
//! that each pixel needs until its noise is hidden by that of the sensor. The render stops when the target is reached. The
//! [`certificate`] states the level that was reached, from the samples of each pixel and of its cell ([`variance::pixel`]).
//!
//! The samples of a pixel must not decide how many others join them in its mean. If a pixel with a bright sample gets
//! more samples, these dilute the bright one, and the mean is too small (Kirk and Arvo 1991). So a plan is made once,
//! from the pilot, and the samples of a pixel depend on its neighbours alone.
//!
//! The paper leaves open how a target time becomes a number of samples. Here the render measures the cost of samples
//! ([`tile_cost`]) and approaches its deadline in levels that shrink with the time left ([`queue`]). The clock decides the
//! levels, and a hash decides which pixels get their samples. So a written plan can be replayed to the same bits on any
//! machine.
//!
//! ```
//! use dunkelfeld_adaptive::{weights, plan, budget};
//! use dunkelfeld_film::Plane;
//!
//! // A render of 8 x 4 pixels with 64 samples per pixel, a step edge in its middle.
//! let luminance = Plane::from_fn(8, 4, |x, _| if x < 4 { 0.1 } else { 0.8 });
//! let limits = budget::Limits { samples: Some(plan::total_for_mean(64.0, 32)), ..Default::default() };
//! let settings = budget::Settings { pixels: 32, pilot_spp: 16 };
//! let mut schedule = budget::Schedule::new(limits, settings);
//! let mut weights = weights::uniform(8, 4);
//! let mut taken = plan::empty(8, 4);
//! while let budget::Step::Round(round) = schedule.next(budget::Affordable::All) {
//!     if round.replan {
//!         let pilot = weights::Pilot { luminance: &luminance, white: 1.0, sobel_floor: 0.25, noise: None };
//!         weights = weights::Strategy::Sobel.weights(&pilot);
//!     }
//!     let next = plan::next_round(&taken, &weights, schedule.taken() + round.samples);
//!     // ... render `plan::increment(&taken, &next)` here ...
//!     schedule.record(plan::total(&next));
//!     taken = next;
//! }
//! assert_eq!(plan::total(&taken), 64 * 32);
//! assert!(taken.at(3, 2) > taken.at(0, 2));
//! ```

#![forbid(unsafe_code)]

pub mod budget;
pub mod certificate;
pub mod plan;
pub mod queue;
pub mod required_samples;
pub mod sobel;
pub mod tile_cost;
pub mod variance;
pub mod weights;

pub use budget::{Affordable, Levels, Limits, Phase, Round, Schedule, Settings, Step, StopReason};
pub use certificate::{Certificate, Claim, certify};
pub use plan::SamplePlan;
pub use queue::{WorkQueue, WorkUnit};
pub use required_samples::{RequiredSamples, SensorNoise};
pub use tile_cost::{CostMap, TileGrid, TileRect};
pub use variance::inputs::{NoiseInputs, PixelFeatures};
pub use variance::pooled::PixelNoise;
pub use weights::{Pilot, Strategy, UnknownStrategy};
