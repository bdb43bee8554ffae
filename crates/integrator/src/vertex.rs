//! Vertices of a path at which light is scattered: points on a surface or in a medium.

use crate::ray_state::{RayState, SurfaceHit};
use crate::scatterer::{OneLane, Scatterer};
use dunkelfeld_bsdf::{Bsdf, BsdfSamples, Lobe, View};
use dunkelfeld_geometry::{LocalDir, Vec3};
use dunkelfeld_lanes::V3;
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

impl Scattering {
    /// From a direction in render space and the rest of a sample of one lane.
    #[inline]
    fn of(wi: V3<f32>, sample: &BsdfSamples<f32>) -> Self {
        let BsdfSamples { weight, pdf, eta, lobe, .. } = *sample;
        Self { wi: wi.into(), weight, pdf, lobe: Lobe::from_bits(lobe.0), eta }
    }
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

    /// The event of a smooth surface that is chosen by the number `u_lobe` in `[0, 1)`. `None` if light would also be
    /// reflected by the opposite facet ([`ShadingFrames::image`](dunkelfeld_scene::ShadingFrames::image)).
    #[inline]
    pub(crate) fn delta(&self, u_lobe: f32) -> Option<Scattering> {
        if !self.shading.bsdf.is_delta() {
            return None;
        }
        let scatterer = self.scatterer();
        let sample = scatterer.view.sample(u_lobe, [0.0; 2]);
        let wi = scatterer.frames.frame.to_world(sample.wi);
        (sample.pdf > 0.0 && scatterer.frames.consistent(wi, sample.wi)).then(|| Scattering::of(wi, &sample))
    }

    /// The surface as the only lane.
    #[inline]
    fn scatterer(&self) -> Scatterer<f32, OneLane<'_>> {
        let view = OneLane { bsdf: self.shading.bsdf, wo: self.wo_local };
        Scatterer { frames: self.shading.frames(self.hit.surface.normal), view }
    }

    /// See [`RayState::transmittance_toward`].
    #[inline]
    pub(crate) fn transmittance_toward(&self, scene: &Scene, wi: Vec3, distance: f32) -> Rgb {
        self.ray_state.transmittance_toward::<F>(scene, (&self.hit, &self.shading), [self.wo, wi], distance)
    }

    /// Direction toward the camera in the frame of shading.
    #[inline]
    pub(crate) fn wo_local(&self) -> LocalDir {
        self.wo_local
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
        self.scatterer().eval(wi.into())
    }

    #[inline]
    fn sample(&self, u: [f32; 3]) -> Option<Scattering> {
        let (wi, sample) = self.scatterer().sample(u);
        (sample.pdf > 0.0).then(|| Scattering::of(wi, &sample))
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

#[cfg(test)]
mod tests {
    use super::{SurfaceVertex, Vertex};
    use crate::ray_state::{RayState, SurfaceHit};
    use dunkelfeld_geometry::{Ray, Vec3};
    use dunkelfeld_scene::shapes::rectangle;
    use dunkelfeld_scene::{AllFeatures, Material, Scene, SceneBuilder, Surface, Volume};

    /// Calls `check` with the vertex of a plate whose shading normal is tilted by `tilt` degrees, for a viewer at an
    /// `elevation` and an `azimuth` from the direction of the tilt [degrees].
    fn on_tilted(
        material: &Material,
        tilt: f32,
        [elevation, azimuth]: [f32; 2],
        check: impl FnOnce(&SurfaceVertex<'_, AllFeatures>),
    ) {
        let mut b = SceneBuilder { energy_compensation: true, ..SceneBuilder::default() };
        let m = b.add_material(material.clone());
        let (sin, cos) = tilt.to_radians().sin_cos();
        let normals = vec![Vec3::new(sin, 0.0, cos); 4];
        b.add_object(
            "plate",
            dunkelfeld_geometry::Mesh { normals, ..rectangle(-Vec3::ONE, Vec3::X * 2.0, Vec3::Y * 2.0) },
            m,
        );
        let scene: Scene = b.build().expect("the scene is valid").0;
        let (sin, cos) = elevation.to_radians().sin_cos();
        let (y, x) = azimuth.to_radians().sin_cos();
        let wo = Vec3::new(cos * x, cos * y, sin);
        let center = -scene.world_origin().as_vec3() - Vec3::Z;
        let ray = Ray::new(center + Vec3::new(0.1, 0.2, 0.0) + wo, -wo);
        let hit = SurfaceHit::of_surface(scene.intersect(&ray).expect("the plate is hit"));
        let state = RayState::from_camera::<AllFeatures>(&scene, ray);
        check(&SurfaceVertex::new(&scene, state, hit, 0.5, &mut None));
    }

    const N: usize = 48;

    /// The mean weight of evenly distributed samples. The weight times the density is checked to be the BSDF, and the
    /// side of the surface to be that of the lobe.
    fn albedo(at: &SurfaceVertex<'_, AllFeatures>, what: &str) -> f64 {
        let mut sum = 0.0;
        for k in 0..N * N {
            let u = |i: usize| (i as f32 + 0.5) / N as f32;
            let u_lobe = (k as f32 * 0.618_034).fract();
            let Some(s) = at.sample([u(k % N), u(k / N), u_lobe]) else { continue };
            sum += f64::from(s.weight.g * s.eta * s.eta);
            assert_eq!(s.wi.z > 0.0, s.lobe.contains(dunkelfeld_bsdf::Lobe::REFLECTION), "{what}: the wrong side");
            let (value, pdf) = at.eval(s.wi);
            let near = |a: f32, b: f32| (a - b).abs() <= 2e-2 * a.abs().max(b.abs());
            assert!(near(pdf, s.pdf) && near(value.g, s.weight.g * s.pdf), "{what}: {pdf} {value:?} against {s:?}");
        }
        sum / (N * N) as f64
    }

    #[test]
    fn white_metal_with_tilted_normals_loses_no_light() {
        for roughness in [0.05, 0.2, 0.5, 0.8] {
            let metal = Material { metallic: 1.0, roughness, ..Material::default() };
            for tilt in [10.0, 30.0, 50.0, 70.0] {
                for view in [[90.0, 0.0], [30.0, 0.0], [30.0, 100.0], [30.0, 180.0], [5.0, 0.0], [5.0, 180.0]] {
                    let what = format!("roughness {roughness}, tilt {tilt}, view {view:?}");
                    on_tilted(&metal, tilt, view, |at| {
                        let albedo = albedo(at, &what);
                        // The tables of the energy compensation have an error of 0.3 %.
                        assert!((0.98..=1.005).contains(&albedo), "{what}: {albedo}");
                    });
                }
            }
        }
    }

    #[test]
    fn densities_and_values_on_tilted_normals_integrate_to_those_of_the_samples() {
        let plastic = Material { roughness: 0.5, ..Material::default() };
        let glass = Material { transmission: 1.0, surface: Surface::Solid(Volume::default()), ..plastic.clone() };
        for (name, material) in [("plastic", plastic), ("glass", glass)] {
            for tilt in [30.0, 60.0] {
                for view in [[80.0, 0.0], [30.0, 60.0], [20.0, 180.0]] {
                    let what = format!("{name}, tilt {tilt}, view {view:?}");
                    on_tilted(&material, tilt, view, |at| {
                        const STEPS: usize = 200;
                        let (mut value, mut density) = (0.0, 0.0);
                        for k in 0..2 * STEPS * STEPS {
                            let z = 1.0 - ((k / STEPS) as f32 + 0.5) / STEPS as f32;
                            let (y, x) = (((k % STEPS) as f32 + 0.5) / STEPS as f32 * std::f32::consts::TAU).sin_cos();
                            let r = (1.0 - z * z).sqrt();
                            let (v, pdf) = at.eval(Vec3::new(r * x, r * y, z));
                            // Radiance in a solid, without the factor of its index of refraction.
                            value += f64::from(v.g) * if z < 0.0 { 2.25 } else { 1.0 };
                            density += f64::from(pdf);
                        }
                        let cell = std::f64::consts::TAU / (STEPS * STEPS) as f64;
                        let (value, density, albedo) = (value * cell, density * cell, albedo(at, &what));
                        assert!(density < 1.005, "{what}: the density integrates to {density}");
                        assert!((value / albedo - 1.0).abs() < 0.02, "{what}: {value}, the samples give {albedo}");
                    });
                }
            }
        }
    }
}
