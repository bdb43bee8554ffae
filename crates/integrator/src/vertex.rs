//! A point on a surface at which light is scattered, of a single path.

use crate::ray_state::{RayState, SurfaceHit};
use crate::scatterer::{OneLane, Scatterer};
use dunkelfeld_bsdf::{Bsdf, View};
use dunkelfeld_scene::{Scene, ShadingPoint};

/// A point on a surface at which light is scattered.
pub(crate) struct Vertex<'a> {
    shading: ShadingPoint<'a>,
    hit: SurfaceHit<'a>,
    /// The ray that has reached the point.
    ray_state: RayState,
}

impl<'a> Vertex<'a> {
    /// The vertex at the surface that the ray has hit. `u_kind` in `[0, 1)` decides between the two kinds of a
    /// stochastic surface. A BSDF that exists only for this point is stored in `storage`.
    #[inline]
    pub(crate) fn on_surface(
        scene: &'a Scene,
        ray_state: RayState,
        hit: SurfaceHit<'a>,
        u_kind: f32,
        storage: &'a mut Option<Bsdf>,
    ) -> Self {
        let eta = hit.interface.and_then(|interface| interface.relative_index());
        let shading = scene.shade_between(&hit.surface, -ray_state.ray.direction, u_kind, eta, storage);
        Self { shading, hit, ray_state }
    }

    /// The ray behind a smooth surface, after the event that is chosen by the number `u_lobe` in `[0, 1)`. `None` at other
    /// surfaces, and if light would also be reflected by the opposite facet
    /// ([`ShadingFrames::image`](dunkelfeld_scene::ShadingFrames::image)).
    #[inline]
    pub(crate) fn delta(&self, u_lobe: f32) -> Option<RayState> {
        if !self.shading.bsdf.is_delta() {
            return None;
        }
        let scatterer = self.scatterer();
        let sample = scatterer.view.sample(u_lobe, [0.0; 2]);
        let wi = scatterer.frames.frame.to_world(sample.wi);
        let is_possible = sample.pdf > 0.0 && scatterer.frames.consistent(wi, sample.wi);
        is_possible.then(|| self.ray_state.spawn_ray(&self.hit, &self.shading, wi.into()))
    }

    /// The vertex as the only lane.
    #[inline]
    fn scatterer(&self) -> Scatterer<f32, OneLane<'_>> {
        let wo = self.shading.frame.to_local(-self.ray_state.ray.direction);
        let frames = self.shading.frames(self.hit.surface.normal);
        Scatterer { frames, view: OneLane { bsdf: self.shading.bsdf, wo } }
    }
}

#[cfg(test)]
mod tests {
    use super::Vertex;
    use crate::ray_state::{RayState, SurfaceHit};
    use dunkelfeld_bsdf::Lobe;
    use dunkelfeld_geometry::{Ray, Vec3};
    use dunkelfeld_lanes::V3;
    use dunkelfeld_scene::shapes::rectangle;
    use dunkelfeld_scene::{Material, Scene, SceneBuilder, Surface, Volume};

    /// Calls `check` with the vertex of a plate whose shading normal is tilted by `tilt` degrees, for a viewer at an
    /// `elevation` and an `azimuth` from the direction of the tilt [degrees].
    fn on_tilted(material: &Material, tilt: f32, [elevation, azimuth]: [f32; 2], check: impl FnOnce(&Vertex<'_>)) {
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
        let surface = scene.intersect(&ray).expect("the plate is hit");
        let hit = SurfaceHit { surface, interface: None };
        let state = RayState::from_camera(&scene, ray);
        check(&Vertex::on_surface(&scene, state, hit, 0.5, &mut None));
    }

    const N: usize = 48;

    /// The mean weight of evenly distributed samples. The weight times the density is checked to be the BSDF, and the
    /// side of the surface to be that of the lobe.
    fn albedo(at: &Vertex<'_>, what: &str) -> f64 {
        let mut sum = 0.0;
        for k in 0..N * N {
            let u = |i: usize| (i as f32 + 0.5) / N as f32;
            let u_lobe = (k as f32 * 0.618_034).fract();
            let (wi, s) = at.scatterer().sample([u(k % N), u(k / N), u_lobe]);
            if s.pdf == 0.0 {
                continue;
            }
            sum += f64::from(s.weight.g * s.eta * s.eta);
            assert_eq!(wi.z > 0.0, Lobe::from_bits(s.lobe.0).contains(Lobe::REFLECTION), "{what}: the wrong side");
            let (value, pdf) = at.scatterer().eval(wi);
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
                            let (v, pdf) = at.scatterer().eval(V3::new(r * x, r * y, z));
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
