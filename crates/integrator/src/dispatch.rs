//! The two kernels of the path loop, and the choice of one.

use crate::learned_roulette::LearnedRoulette;
use crate::path;
use crate::recorder::Recorder;
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::Ray;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{AllFeatures, KernelFeatures, Scene};

/// All features but media.
pub(crate) type Wide = KernelFeatures<true, true, true, false>;

/// True if the path of a ray needs the kernel with media.
///
/// A ray may start inside a solid only within the bounds of the solids of the scene. This is tested for each ray,
/// because a lens has an extent.
#[inline]
pub(crate) fn needs_media(scene: &Scene, ray: &Ray) -> bool {
    let features = scene.features();
    features.media || (features.solids && scene.may_be_inside(ray.origin))
}

/// Traces a camera ray.
#[inline]
pub(crate) fn trace_path<R: Recorder>(
    scene: &Scene,
    roulette: Option<&LearnedRoulette>,
    ray: Ray,
    sampler: Sampler,
    recorder: R,
) -> (Sample, R) {
    if needs_media(scene, &ray) {
        path::trace_path::<AllFeatures, R>(scene, roulette, ray, sampler, recorder)
    } else {
        path::trace_path::<Wide, R>(scene, roulette, ray, sampler, recorder)
    }
}
