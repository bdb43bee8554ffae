//! Scattering at surfaces in lanes: the BSDF in the frame of shading, without light through the surface.

use dunkelfeld_bsdf::{BsdfSample, BsdfSamples, Lobe, View};
use dunkelfeld_geometry::{LocalDir, Vec3};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Bsdfs, ShadingFrames};

/// Points on surfaces, one for each lane: frames of shading and BSDFs seen from the camera side.
pub(crate) struct Scatterer<F: Lanes, V> {
    pub(crate) frames: ShadingFrames<F>,
    pub(crate) view: V,
}

impl<F: Lanes, V: View<F>> Scatterer<F, V> {
    /// The BSDF for light from `wi` toward the camera side [1/sr], cosine included, and the density of [`Self::sample`].
    #[inline(always)]
    pub(crate) fn eval(&self, wi: V3<F>) -> (Rgb<F>, F) {
        let local = self.frames.frame.to_local(wi);
        let direct = self.view.eval_pdf(local);
        let is_bent = self.frames.is_bent;
        if !is_bent.any() {
            return direct;
        }
        let is_consistent = !is_bent | self.frames.consistent(wi, local);
        let (image, cos, is_reflected) = self.frames.inconsistent_image(wi);
        let (value, pdf) = self.with_image(direct, local, (image, cos, is_reflected & is_consistent));
        (Rgb::select(is_consistent, value, Rgb::splat(pdf.constant(0.0))), pdf.only(is_consistent))
    }

    /// Samples directions in render space: `u` holds direction (2), lobe. The density is zero where the path ends.
    #[inline(always)]
    pub(crate) fn sample(&self, [u_x, u_y, u_lobe]: [F; 3]) -> (V3<F>, BsdfSamples<F>) {
        let mut sample = self.view.sample(u_lobe, [u_x, u_y]);
        let mut wi = self.frames.frame.to_world(sample.wi);
        let is_scattered = sample.pdf.is_positive();
        let is_consistent = self.frames.consistent(wi, sample.wi);
        let is_bent = self.frames.is_bent;
        if !is_bent.any() {
            sample.pdf = sample.pdf.only(is_consistent);
            return (wi, sample);
        }
        // Light that leaves a facet in an inconsistent direction continues in its image.
        let token = u_x.token();
        let delta = F::splat_word(token, Lobe::DELTA.bits());
        let is_delta = F::word_eq(sample.lobe & delta, delta);
        let (image, cos) = self.frames.image(wi);
        let image_local = self.frames.frame.to_local(image);
        let is_turned = is_bent & !is_consistent;
        wi = V3::select(is_turned, image, wi);
        let local = V3::select(is_turned, image_local, sample.wi);
        let other = V3::select(is_turned, sample.wi, image_local);
        let is_smooth = is_turned & is_delta;
        let lit = sample.weight * self.opposite_albedo(local, cos);
        sample.weight = Rgb::select(is_smooth, lit, sample.weight);
        let is_shared = is_scattered & is_bent & !is_delta & (is_turned | !self.frames.consistent(image, image_local));
        if is_shared.any() {
            let (value, pdf) = self.with_image(self.view.eval_pdf(local), local, (other, cos, is_shared));
            let weight = value / pdf;
            let is_valid = pdf.is_positive() & weight.all_finite();
            sample.weight = Rgb::select(is_shared, weight, sample.weight);
            sample.pdf = is_shared.select(pdf.only(is_valid), sample.pdf);
        }
        sample.pdf = sample.pdf.only(is_scattered & (is_consistent | is_bent));
        (wi, sample)
    }

    /// Adds the light of the inconsistent images of directions in some lanes. The opposite facet reflects it to these
    /// directions. `cos` is the cosine at that facet.
    #[inline(always)]
    fn with_image(
        &self,
        (value, pdf): (Rgb<F>, F),
        wi: V3<F>,
        (image, cos, lanes): (V3<F>, F, F::Mask),
    ) -> (Rgb<F>, F) {
        if !lanes.any() {
            return (value, pdf);
        }
        let (reflected, its_pdf) = self.view.eval_pdf(image);
        let with = value + reflected * self.opposite_albedo(wi, cos);
        (Rgb::select(lanes, with, value), lanes.select(pdf + its_pdf, pdf))
    }

    /// Albedo of the opposite facet for light on the side of `wi`.
    #[inline(always)]
    fn opposite_albedo(&self, wi: V3<F>, cos: F) -> Rgb<F> {
        self.view.albedo(V3::new((cos * cos).one_minus().sqrt(), cos.constant(0.0), cos.copysign(wi.z)))
    }
}

/// Points at which light scatters, one for each lane. As a view its BSDFs are evaluated one by one.
#[derive(Clone, Copy)]
pub(crate) struct Scattering<'g, F: Lanes> {
    pub(crate) token: F::Token,
    /// Number of lanes that are used. As a view the results of the others are zero.
    pub(crate) len: usize,
    pub(crate) frames: ShadingFrames<F>,
    /// Directions toward the camera, in the frames of shading.
    pub(crate) wo: V3<F>,
    pub(crate) bsdfs: Bsdfs<'g>,
}

impl<F: Lanes> View<F> for Scattering<'_, F> {
    #[inline(always)]
    fn eval_pdf(&self, wi: V3<F>) -> (Rgb<F>, F) {
        let (wo, wi, mut values, mut pdfs) =
            (self.wo.to_lanes(), wi.to_lanes(), [Rgb::BLACK; MAX_WIDTH], [0.0; MAX_WIDTH]);
        for lane in 0..self.len {
            (values[lane], pdfs[lane]) = self.bsdfs.lane(lane).eval_pdf(LocalDir(wo[lane]), LocalDir(wi[lane]));
        }
        (Rgb::from_lanes(self.token, &values), F::load(self.token, &pdfs))
    }

    #[inline(always)]
    fn sample(&self, u_lobe: F, [u_x, u_y]: [F; 2]) -> BsdfSamples<F> {
        let (wo, u_lobe, u_x, u_y) = (self.wo.to_lanes(), u_lobe.to_array(), u_x.to_array(), u_y.to_array());
        let (mut wi, mut weights, mut lobes) = ([Vec3::Z; MAX_WIDTH], [Rgb::BLACK; MAX_WIDTH], [0; MAX_WIDTH]);
        let (mut pdfs, mut etas) = ([0.0; MAX_WIDTH], [1.0; MAX_WIDTH]);
        for lane in 0..self.len {
            let sample = self.bsdfs.lane(lane).sample(LocalDir(wo[lane]), u_lobe[lane], [u_x[lane], u_y[lane]]);
            if let Some(BsdfSample { wi: LocalDir(direction), weight, pdf, lobe, eta }) = sample {
                (wi[lane], weights[lane], lobes[lane]) = (direction, weight, lobe.bits());
                (pdfs[lane], etas[lane]) = (pdf, eta);
            }
        }
        BsdfSamples {
            wi: V3::from_lanes(self.token, &wi),
            weight: Rgb::from_lanes(self.token, &weights),
            pdf: F::load(self.token, &pdfs),
            lobe: F::load_word(self.token, &lobes),
            eta: F::load(self.token, &etas),
        }
    }

    #[inline(always)]
    fn albedo(&self, wo: V3<F>) -> Rgb<F> {
        let (directions, mut found) = (wo.to_lanes(), [Rgb::BLACK; MAX_WIDTH]);
        for lane in 0..self.len {
            found[lane] = self.bsdfs.lane(lane).albedo(LocalDir(directions[lane]));
        }
        Rgb::from_lanes(self.token, &found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_geometry::{Mesh, Ray};
    use dunkelfeld_scene::shapes::rectangle;
    use dunkelfeld_scene::{Material, SceneBuilder, Surface, Volume};

    type At<'a> = Scatterer<f32, Scattering<'a, f32>>;

    /// Calls `check` with a point on a plate whose shading normal is tilted by `tilt` degrees, for a viewer at an
    /// `elevation` and an `azimuth` from the direction of the tilt [degrees].
    fn on_tilted(material: &Material, tilt: f32, [elevation, azimuth]: [f32; 2], check: impl FnOnce(&At<'_>)) {
        let mut b = SceneBuilder { energy_compensation: true, ..SceneBuilder::default() };
        let m = b.add_material(material.clone());
        let (sin, cos) = tilt.to_radians().sin_cos();
        let normals = vec![Vec3::new(sin, 0.0, cos); 4];
        b.add_object("plate", Mesh { normals, ..rectangle(-Vec3::ONE, Vec3::X * 2.0, Vec3::Y * 2.0) }, m);
        let scene = b.build().expect("the scene is valid").0;
        let (sin, cos) = elevation.to_radians().sin_cos();
        let (y, x) = azimuth.to_radians().sin_cos();
        let wo = Vec3::new(cos * x, cos * y, sin);
        let center = -scene.world_origin().as_vec3() - Vec3::Z;
        let ray = Ray::new(center + Vec3::new(0.1, 0.2, 0.0) + wo, -wo);
        let surface = scene.intersect(&ray).expect("the plate is hit");
        let frames = scene.shade_lanes::<f32>(surface.material(), &(&surface).into(), wo.into()).frames;
        let (wo, mut storage) = (frames.frame.to_local(wo.into()), None);
        let bsdfs = Bsdfs::Same(scene.bsdf(&surface, 0.5, None, &mut storage));
        check(&Scatterer { frames, view: Scattering { token: (), len: 1, frames, wo, bsdfs } });
    }

    const N: usize = 48;

    /// The mean weight of evenly distributed samples. The weight times the density is checked to be the BSDF, and the
    /// side of the surface to be that of the lobe.
    fn albedo(at: &At<'_>, what: &str) -> f64 {
        let mut sum = 0.0;
        for k in 0..N * N {
            let u = |i: usize| (i as f32 + 0.5) / N as f32;
            let u_lobe = (k as f32 * 0.618_034).fract();
            let (wi, s) = at.sample([u(k % N), u(k / N), u_lobe]);
            if s.pdf == 0.0 {
                continue;
            }
            sum += f64::from(s.weight.g * s.eta * s.eta);
            assert_eq!(wi.z > 0.0, Lobe::from_bits(s.lobe.0).contains(Lobe::REFLECTION), "{what}: the wrong side");
            let (value, pdf) = at.eval(wi);
            let near = |a: f32, b: f32| (a - b).abs() <= 2e-2 * a.abs().max(b.abs());
            assert!(near(pdf, s.pdf) && near(value.g, s.weight.g * s.pdf), "{what}: {pdf} {value:?} against {s:?}");
        }
        sum / (N * N) as f64
    }

    #[test]
    fn white_metal_with_tilted_normals_loses_no_light() {
        for roughness in [0.05, 0.2, 0.5, 0.8] {
            let metal = Material { metallic: 1.0.into(), roughness: roughness.into(), ..Material::default() };
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
        let plastic = Material { roughness: 0.5.into(), ..Material::default() };
        let glass =
            Material { transmission: 1.0.into(), surface: Surface::Solid(Volume::default()), ..plastic.clone() };
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
                            let (v, pdf) = at.eval(V3::new(r * x, r * y, z));
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
