//! The kernels of the path loop, and the choice of one.

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
pub(crate) fn follow(scene: &Scene, ray: Ray, sampler: &Sampler, recorder: &mut impl Recorder) -> Sample {
    if !EFFECTS {
        return path::follow::<KernelFeatures<false, false, false, false>>(scene, ray, sampler, recorder);
    }
    let FeatureSet { detail, chance, solids, media } = scene.features();
    if media || (solids && scene.may_be_inside(ray.origin)) {
        return path::follow::<AllFeatures>(scene, ray, sampler, recorder);
    }
    match (detail, chance, solids) {
        (false, false, false) => {
            path::follow::<KernelFeatures<false, false, false, false>>(scene, ray, sampler, recorder)
        }
        (false, false, true) => {
            path::follow::<KernelFeatures<false, false, true, false>>(scene, ray, sampler, recorder)
        }
        (false, true, false) => {
            path::follow::<KernelFeatures<false, true, false, false>>(scene, ray, sampler, recorder)
        }
        (false, true, true) => path::follow::<KernelFeatures<false, true, true, false>>(scene, ray, sampler, recorder),
        (true, false, false) => {
            path::follow::<KernelFeatures<true, false, false, false>>(scene, ray, sampler, recorder)
        }
        (true, false, true) => path::follow::<KernelFeatures<true, false, true, false>>(scene, ray, sampler, recorder),
        (true, true, false) => path::follow::<KernelFeatures<true, true, false, false>>(scene, ray, sampler, recorder),
        (true, true, true) => path::follow::<KernelFeatures<true, true, true, false>>(scene, ray, sampler, recorder),
    }
}
