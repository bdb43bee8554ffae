//! Training of the learned Russian roulette, before a render.

use crate::settings::RenderSettings;
use dunkelfeld_integrator::LearnedRoulette;
use dunkelfeld_scene::{Effect, RayGenerator, Scene};
use rayon::prelude::*;

/// Trains the survival probabilities of a render on the threads of the current pool. The result is the same for any
/// number of threads. `None` if the settings have no training paths, or if no path meets a surface.
pub fn train(scene: &Scene, camera: &RayGenerator, settings: &RenderSettings) -> Option<LearnedRoulette> {
    let paths = settings.training_paths();
    if paths == 0 || !scene.effects().has(Effect::LearnedRoulette) {
        return None;
    }
    LearnedRoulette::train(scene, camera, [settings.width, settings.height], paths, |batches, trace| {
        batches.into_par_iter().map(trace).collect()
    })
}
