//! Vertices of a path at which light is scattered: points on a surface or in a medium.

use crate::ray_state::{RayState, SurfaceHit};
use dunkelfeld_bsdf::{Bsdf, BsdfSample, Lobe};
use dunkelfeld_geometry::{LocalDir, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Features, LightSampleContext, Medium, Scene, ShadingPoint, SurfacePoint};
use std::marker::PhantomData;

/// A sampled direction in which the path continues.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scattering {
    /// Unit direction in render space.
    pub(crate) wi: Vec3,
    /// Scattered radiance over the density: BSDF (or phase function) times cosine over pdf.
    pub(crate) weight: Rgb,
    /// Density [1/sr]; for a delta lobe its probability.
    pub(crate) pdf: f32,
    pub(crate) lobe: Lobe,
    /// Index of refraction on the far side over that on the near side; 1 unless the light was refracted.
    pub(crate) eta: f32,
}

/// The interface between the path loop and a vertex at which light is scattered.
pub(crate) trait Vertex {
    /// True for a vertex in a medium.
    const IN_MEDIUM: bool;

    /// The point as the receiver of a light sample.
    fn receiver(&self) -> &LightSampleContext;

    /// True if the vertex scatters into single directions only. Then next-event estimation cannot connect it to a
    /// light.
    fn is_delta(&self) -> bool;

    /// The BSDF or phase function for light from `wi` toward the camera side [1/sr], cosine included, and the density
    /// of [`Self::sample`].
    fn eval(&self, wi: Vec3) -> (Rgb, f32);

    /// Samples a direction: `u` holds direction (2), lobe. `None` if the path ends here.
    fn sample(&self, u: [f32; 3]) -> Option<Scattering>;

    /// The state of the ray that continues in a direction.
    fn spawn_ray(&self, wi: Vec3) -> RayState;

    /// True for a surface that the auxiliary layers pass through: smooth glass or a mirror.
    fn is_see_through(&self) -> bool;

    /// Albedo and normal for the auxiliary layers.
    fn aov_features(&self) -> (Rgb, Vec3);

    /// Distance from the origin of the ray \[m\].
    fn distance(&self) -> f32;

    /// Index of the material of the surface; `None` in a medium.
    fn material(&self) -> Option<u32>;

    /// The surface on which the vertex lies; `None` in a medium.
    fn surface(&self) -> Option<&SurfacePoint>;
}

/// A point on a surface.
pub(crate) struct SurfaceVertex<'a, F> {
    pub(crate) hit: SurfaceHit<'a>,
    pub(crate) shading: ShadingPoint<'a>,
    /// Direction toward the camera.
    pub(crate) wo: Vec3,
    wo_local: LocalDir,
    ray_state: RayState,
    features: PhantomData<F>,
}

impl<'a, F: Features> SurfaceVertex<'a, F> {
    /// The vertex at the surface that the ray has hit. `u_kind` in `[0, 1)` decides between the two kinds of a
    /// stochastic surface. A BSDF that exists only for this point is stored in `storage`.
    #[inline]
    pub(crate) fn new(
        scene: &'a Scene,
        ray_state: RayState,
        hit: SurfaceHit<'a>,
        u_kind: f32,
        storage: &'a mut Option<Bsdf>,
    ) -> Self {
        let wo = -ray_state.ray.direction;
        let shading = match hit.relative_index() {
            Some(eta) if F::MEDIA => scene.shade_between(&hit.surface, wo, u_kind, eta, storage),
            _ => scene.shade_with::<F>(&hit.surface, wo, u_kind, storage),
        };
        let wo_local = shading.frame.to_local(wo);
        Self { hit, shading, wo, wo_local, ray_state, features: PhantomData }
    }

    /// The event of a smooth surface that is chosen by the number `u_lobe` in `[0, 1)`.
    #[inline]
    pub(crate) fn delta(&self, u_lobe: f32) -> Option<Scattering> {
        if self.shading.bsdf.is_delta() { self.sample([0.0, 0.0, u_lobe]) } else { None }
    }

    /// A world direction in the local frame. `None` if local frame and geometric normal disagree about its side.
    #[inline]
    fn consistent(&self, wi: Vec3) -> Option<LocalDir> {
        self.shading.local_direction(self.hit.surface.normal, wi)
    }
}

impl<F: Features> Vertex for SurfaceVertex<'_, F> {
    const IN_MEDIUM: bool = false;

    #[inline]
    fn receiver(&self) -> &LightSampleContext {
        &self.shading.receiver
    }

    #[inline]
    fn is_delta(&self) -> bool {
        self.shading.bsdf.is_delta()
    }

    #[inline]
    fn eval(&self, wi: Vec3) -> (Rgb, f32) {
        match self.consistent(wi) {
            Some(local) => self.shading.bsdf.eval_pdf(self.wo_local, local),
            None => (Rgb::BLACK, 0.0),
        }
    }

    #[inline]
    fn sample(&self, [u_x, u_y, u_lobe]: [f32; 3]) -> Option<Scattering> {
        let BsdfSample { wi, weight, pdf, lobe, eta } = self.shading.bsdf.sample(self.wo_local, u_lobe, [u_x, u_y])?;
        let world = self.shading.frame.to_world(wi);
        self.shading.consistent(self.hit.surface.normal, world, wi).then_some(Scattering {
            wi: world,
            weight,
            pdf,
            lobe,
            eta,
        })
    }

    #[inline]
    fn spawn_ray(&self, wi: Vec3) -> RayState {
        self.ray_state.spawn_ray::<F>(&self.hit, &self.shading, self.wo, wi)
    }

    #[inline]
    fn is_see_through(&self) -> bool {
        self.shading.bsdf.is_see_through()
    }

    #[inline]
    fn aov_features(&self) -> (Rgb, Vec3) {
        (self.shading.bsdf.albedo(self.wo_local), self.shading.frame.normal)
    }

    #[inline]
    fn distance(&self) -> f32 {
        self.hit.surface.distance
    }

    #[inline]
    fn material(&self) -> Option<u32> {
        Some(self.shading.material)
    }

    #[inline]
    fn surface(&self) -> Option<&SurfacePoint> {
        Some(&self.hit.surface)
    }
}

/// A point inside a medium at which light is scattered.
pub(crate) struct MediumVertex<'a> {
    medium: &'a Medium,
    /// Position in render space.
    pub(crate) point: Vec3,
    /// Direction toward the camera.
    wo: Vec3,
    receiver: LightSampleContext,
    distance: f32,
    ray_state: RayState,
}

impl<'a> MediumVertex<'a> {
    /// The point at a distance \[m\] along the ray through a medium.
    #[inline]
    pub(crate) fn new(medium: &'a Medium, ray_state: RayState, distance: f32) -> Self {
        let point = ray_state.ray.at(distance);
        // A receiver without a surface: it accepts light from all directions.
        let receiver = LightSampleContext { point, normal: Vec3::ZERO, both_sides: true };
        Self { medium, point, wo: -ray_state.ray.direction, receiver, distance, ray_state }
    }
}

impl Vertex for MediumVertex<'_> {
    const IN_MEDIUM: bool = true;

    #[inline]
    fn receiver(&self) -> &LightSampleContext {
        &self.receiver
    }

    #[inline]
    fn is_delta(&self) -> bool {
        false
    }

    #[inline]
    fn eval(&self, wi: Vec3) -> (Rgb, f32) {
        let phase = self.medium.phase.pdf(self.wo, wi);
        (Rgb::splat(phase), phase)
    }

    #[inline]
    fn sample(&self, [u_x, u_y, _]: [f32; 3]) -> Option<Scattering> {
        let wi = self.medium.phase.sample(self.wo, [u_x, u_y]);
        let pdf = self.medium.phase.pdf(self.wo, wi);
        Some(Scattering { wi, weight: Rgb::WHITE, pdf, lobe: Lobe::default(), eta: 1.0 })
    }

    #[inline]
    fn spawn_ray(&self, wi: Vec3) -> RayState {
        self.ray_state.spawn_in_medium(self.point, wi)
    }

    #[inline]
    fn is_see_through(&self) -> bool {
        false
    }

    #[inline]
    fn aov_features(&self) -> (Rgb, Vec3) {
        (self.medium.albedo(), self.wo)
    }

    #[inline]
    fn distance(&self) -> f32 {
        self.distance
    }

    #[inline]
    fn material(&self) -> Option<u32> {
        None
    }

    #[inline]
    fn surface(&self) -> Option<&SurfacePoint> {
        None
    }
}
