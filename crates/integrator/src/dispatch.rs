//! The kernels of the path loop, and the choice of one.

use crate::learned_roulette::LearnedRoulette;
use crate::path;
use crate::recorder::Recorder;
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::Ray;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{AllFeatures, EFFECTS, FeatureSet, KernelFeatures, Scene};

/// Traces a camera ray with the kernel that has exactly the features that the scene needs.
///
/// A ray may start inside a solid only within the bounds of the solids of the scene. This is tested for each ray,
/// because a lens has an extent.
#[inline]
pub(crate) fn trace_path<R: Recorder>(
    scene: &Scene,
    roulette: Option<&LearnedRoulette>,
    ray: Ray,
    sampler: Sampler,
    recorder: R,
) -> (Sample, R) {
    if !EFFECTS {
        return path::trace_path::<KernelFeatures<false, false, false, false>, R>(scene, roulette, ray, sampler, recorder);
    }
    let FeatureSet { textured, stochastic, solids, media } = scene.features();
    if media || (solids && scene.may_be_inside(ray.origin)) {
        return path::trace_path::<AllFeatures, R>(scene, roulette, ray, sampler, recorder);
    }
    match (textured, stochastic, solids) {
        (false, false, false) => {
            path::trace_path::<KernelFeatures<false, false, false, false>, R>(scene, roulette, ray, sampler, recorder)
        }
        (false, false, true) => {
            path::trace_path::<KernelFeatures<false, false, true, false>, R>(scene, roulette, ray, sampler, recorder)
        }
        (false, true, false) => {
            path::trace_path::<KernelFeatures<false, true, false, false>, R>(scene, roulette, ray, sampler, recorder)
        }
        (false, true, true) => {
            path::trace_path::<KernelFeatures<false, true, true, false>, R>(scene, roulette, ray, sampler, recorder)
        }
        (true, false, false) => {
            path::trace_path::<KernelFeatures<true, false, false, false>, R>(scene, roulette, ray, sampler, recorder)
        }
        (true, false, true) => {
            path::trace_path::<KernelFeatures<true, false, true, false>, R>(scene, roulette, ray, sampler, recorder)
        }
        (true, true, false) => {
            path::trace_path::<KernelFeatures<true, true, false, false>, R>(scene, roulette, ray, sampler, recorder)
        }
        (true, true, true) => {
            path::trace_path::<KernelFeatures<true, true, true, false>, R>(scene, roulette, ray, sampler, recorder)
        }
    }
}
