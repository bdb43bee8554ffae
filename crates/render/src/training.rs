//! Training of the learned Russian roulette, before a render.

use crate::settings::RenderSettings;
use dunkelfeld_integrator::LearnedRoulette;
use dunkelfeld_scene::{RayGenerator, Scene};
use rayon::prelude::*;

/// Trains the survival probabilities of a render on the threads of the current pool. The result is the same for any
/// number of threads. `None` if the settings have no training paths, or if no path meets a surface.
pub fn train(scene: &Scene, camera: &RayGenerator, settings: &RenderSettings) -> Option<LearnedRoulette> {
    if settings.training_paths == 0 {
        return None;
    }
    LearnedRoulette::train(
        scene,
        camera,
        [settings.width, settings.height],
        settings.training_paths,
        |batches, trace| batches.into_par_iter().map(trace).collect(),
    )
}
