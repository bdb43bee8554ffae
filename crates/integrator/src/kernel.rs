//! The instances of the path loop, and the choice among them.

use crate::path;
use crate::trace::Recorder;
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::Ray;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{FeatureSet, Scene, With};

/// Follows a camera ray with the kernel that can do what the scene calls for, and no more.
#[inline]
pub(crate) fn follow(scene: &Scene, ray: Ray, sampler: &Sampler, recorder: &mut impl Recorder) -> Sample {
    let FeatureSet { detail, chance, solids } = scene.features();
    match (detail, chance, solids) {
        (false, false, false) => path::follow::<With<false, false, false>>(scene, ray, sampler, recorder),
        (false, false, true) => path::follow::<With<false, false, true>>(scene, ray, sampler, recorder),
        (false, true, false) => path::follow::<With<false, true, false>>(scene, ray, sampler, recorder),
        (false, true, true) => path::follow::<With<false, true, true>>(scene, ray, sampler, recorder),
        (true, false, false) => path::follow::<With<true, false, false>>(scene, ray, sampler, recorder),
        (true, false, true) => path::follow::<With<true, false, true>>(scene, ray, sampler, recorder),
        (true, true, false) => path::follow::<With<true, true, false>>(scene, ray, sampler, recorder),
        (true, true, true) => path::follow::<With<true, true, true>>(scene, ray, sampler, recorder),
    }
}
