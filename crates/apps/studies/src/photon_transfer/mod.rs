//! Photon transfer of rendered frames: the experiments of Kludt et al. ("Noise analysis of a synthetically rendered
//! scene in sensor-realistic image simulation"), and the curve of a camera if the sensor is part of the render.
//!
//! A scene is rendered many times with different seeds. Over these frames each pixel has a mean and a variance. Pixels
//! of equal mean form a point of the photon transfer curve (EMVA 1288 release 4.0 Linear, equation 15). `runs.rs` lists
//! the renders. `measure.rs` renders and stores them. `analysis.rs` applies the analyser. `findings.rs` compares the
//! results with the paper. `page.rs` writes the report. `stack.rs` does the same for frames from files.

mod analysis;
mod figures;
mod findings;
mod measure;
mod page;
mod renders;
mod runs;
mod settings;
mod stack;

pub use measure::ptc;
pub use settings::{PtcSettings, of_render_only};
pub use stack::{FrameStack, is_frame, ptc_of_frames};
