//! Photon transfer of rendered frames: the experiments of Kludt et al. ("Noise analysis of a synthetically rendered scene in
//! sensor-realistic image simulation"), and what a camera's curve looks like when the sensor is part of the render.
//!
//! A scene is rendered many times with different seeds. Over these frames each pixel has a mean and a variance; pixels of
//! equal mean form a point of the photon transfer curve (EMVA 1288 release 4.0 Linear, equation 15). `runs.rs` names the
//! renders, `measure.rs` makes and keeps them, `analysis.rs` asks the analyser what they say, `findings.rs` holds that
//! against the paper, `page.rs` writes it down. `stack.rs` does the
//! same for frames that come as files.

mod analysis;
mod figures;
mod findings;
mod measure;
mod page;
mod renders;
mod runs;
mod settings;
mod stack;

pub use measure::{PtcOutcome, ptc, ptc_folder};
pub use settings::PtcSettings;
pub use stack::{FrameStack, StackSettings, ptc_of_frames};
