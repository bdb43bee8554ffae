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
    fn leave(&self, wi: Vec3) -> RayState;

    /// True for a surface that the auxiliary layers pass through: smooth glass or a mirror.
    fn is_see_through(&self) -> bool;

    /// Albedo and normal for the auxiliary layers.
    fn look(&self) -> (Rgb, Vec3);

    /// Distance from the origin of the ray \[m\].
    fn distance(&self) -> f32;

    /// The surface on which the vertex lies; `None` in a medium.
    fn surface(&self) -> Option<&SurfacePoint>;
}

/// A point on a surface.
pub(crate) struct SurfaceVertex<'a, F> {
    pub(crate) met: SurfaceHit<'a>,
    pub(crate) shading: ShadingPoint<'a>,
    /// Direction toward the camera.
    pub(crate) wo: Vec3,
    wo_local: LocalDir,
    arrived: RayState,
    features: PhantomData<F>,
}

impl<'a, F: Features> SurfaceVertex<'a, F> {
    /// The vertex at the surface that the ray has hit. `u_kind` in `[0, 1)` decides between the two kinds of a
    /// stochastic surface. A BSDF that exists only for this point is stored in `own`.
    #[inline]
    pub(crate) fn new(
        scene: &'a Scene,
        arrived: RayState,
        met: SurfaceHit<'a>,
        u_kind: f32,
        own: &'a mut Option<Bsdf>,
    ) -> Self {
        let wo = -arrived.ray.direction;
        let shading = match met.relative_index() {
            Some(eta) if F::MEDIA => scene.shade_between(&met.hit, wo, u_kind, eta, own),
            _ => scene.shade_with::<F>(&met.hit, wo, u_kind, own),
        };
        let wo_local = shading.frame.to_local(wo);
        Self { met, shading, wo, wo_local, arrived, features: PhantomData }
    }

    /// The event of a smooth surface that is chosen by the number `u_lobe` in `[0, 1)`.
    #[inline]
    pub(crate) fn delta(&self, u_lobe: f32) -> Option<Scattering> {
        if self.shading.bsdf.is_delta() { self.sample([0.0, 0.0, u_lobe]) } else { None }
    }

    /// A world direction in the local frame. `None` if local frame and geometric normal disagree about its side.
    #[inline]
    fn consistent(&self, wi: Vec3) -> Option<LocalDir> {
        self.shading.local_direction(self.met.hit.normal, wi)
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
        self.shading.consistent(self.met.hit.normal, world, wi).then_some(Scattering {
            wi: world,
            weight,
            pdf,
            lobe,
            eta,
        })
    }

    #[inline]
    fn leave(&self, wi: Vec3) -> RayState {
        self.arrived.leave::<F>(&self.met, &self.shading, self.wo, wi)
    }

    #[inline]
    fn is_see_through(&self) -> bool {
        self.shading.bsdf.is_see_through()
    }

    #[inline]
    fn look(&self) -> (Rgb, Vec3) {
        (self.shading.bsdf.albedo(self.wo_local), self.shading.frame.normal)
    }

    #[inline]
    fn distance(&self) -> f32 {
        self.met.hit.distance
    }

    #[inline]
    fn surface(&self) -> Option<&SurfacePoint> {
        Some(&self.met.hit)
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
    arrived: RayState,
}

impl<'a> MediumVertex<'a> {
    /// The point at a distance \[m\] along the ray through a medium.
    #[inline]
    pub(crate) fn new(medium: &'a Medium, arrived: RayState, distance: f32) -> Self {
        let point = arrived.ray.at(distance);
        // A receiver without a surface: it accepts light from all directions.
        let receiver = LightSampleContext { point, normal: Vec3::ZERO, both_sides: true };
        Self { medium, point, wo: -arrived.ray.direction, receiver, distance, arrived }
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
    fn leave(&self, wi: Vec3) -> RayState {
        self.arrived.turned(self.point, wi)
    }

    #[inline]
    fn is_see_through(&self) -> bool {
        false
    }

    #[inline]
    fn look(&self) -> (Rgb, Vec3) {
        (self.medium.albedo(), self.wo)
    }

    #[inline]
    fn distance(&self) -> f32 {
        self.distance
    }

    #[inline]
    fn surface(&self) -> Option<&SurfacePoint> {
        None
    }
}
