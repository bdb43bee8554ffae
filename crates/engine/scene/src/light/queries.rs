//! Light samples at vertices of paths, and the densities of directions in which light was found.

use super::*;
use crate::query::surface_points::SurfacePoints;
use crate::scene::Scene;

impl Scene {
    /// Maximum number of light samples of a vertex.
    pub const MAX_LIGHT_SAMPLES: u32 = MAX_LIGHTS_FOR_EACH as u32;

    /// The light samples of the scattering vertex with this number (from 0, counted along a path). With at most eight
    /// lights, vertices on surfaces and the first two vertices in media take a sample of each light, unless the
    /// technique is left out. All other vertices take a sample of one light.
    #[inline]
    pub fn light_choice_at(&self, vertex: u32, in_medium: bool) -> LightChoice {
        match self.lights.samples_each && !(in_medium && vertex >= MAX_VERTICES_FOR_EACH_IN_MEDIA) {
            true => LightChoice::Each,
            false => LightChoice::One,
        }
    }

    /// Number of light samples of a vertex, one for each call of [`Self::sample_lights`].
    #[inline]
    pub fn num_light_samples(&self, choice: LightChoice) -> u32 {
        match choice {
            LightChoice::One => self.lights.lights.len().min(1) as u32,
            LightChoice::Each => self.lights.lights.len() as u32,
        }
    }

    /// A light sample of each active lane: a direction toward a light, with the radiance that arrives unoccluded. The
    /// light is that of the index `index` (below [`Self::num_light_samples`]) in all lanes, or is chosen by `u_choice`. A
    /// lane has no sample if that light cannot reach the receiver, or if no light can. The light samples of a vertex are
    /// summed.
    #[inline(always)]
    #[expect(clippy::too_many_arguments)]
    pub fn sample_lights<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        choice: LightChoice,
        index: u32,
        u_choice: F,
        u: [F; 2],
        active: F::Mask,
    ) -> LightSamples<F> {
        match choice {
            LightChoice::Each => self.sample_same(token, receivers, index, F::splat(token, 1.0), u, active),
            LightChoice::One => {
                let (indices, probability, exists) = self.lights.choose(token, receivers, u_choice, active);
                self.sample_each(token, receivers, &indices, probability, u, active & exists)
            }
        }
    }

    /// The index of the light that [`Self::sample_lights`] chooses in each lane. Lanes without a choice have any.
    #[inline(always)]
    pub fn chosen_lights<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        u_choice: F,
        active: F::Mask,
    ) -> [u32; MAX_WIDTH] {
        self.lights.choose(token, receivers, u_choice, active).0
    }

    /// Samples of the light of each lane, which was chosen with the given probability.
    #[inline(always)]
    fn sample_each<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        indices: &[u32; MAX_WIDTH],
        probability: F,
        u: [F; 2],
        active: F::Mask,
    ) -> LightSamples<F> {
        let (lights, mut samples, mut left) = (&self.lights.lights, LightSamples::none(token), active.bits());
        while left != 0 {
            let index = indices[left.trailing_zeros() as usize % MAX_WIDTH];
            let mut same = F::word_eq(F::load_word(token, indices), F::splat_word(token, index)).bits();
            let here = match lights.get(index as usize) {
                // Rectangles are sampled at once.
                Some(Light::Area(first @ AreaLight { shape: AreaShape::Rectangle(rectangle), .. }))
                    if same & left != left =>
                {
                    let (mut areas, mut rectangles) = ([first; MAX_WIDTH], [rectangle; MAX_WIDTH]);
                    let (mut varying, mut surfaces) = (0, [[0; 2]; MAX_WIDTH]);
                    same = 0;
                    for lane in 0..F::WIDTH {
                        if left >> lane & 1 == 1
                            && let Some(Light::Area(area)) = lights.get(indices[lane] as usize)
                            && let AreaShape::Rectangle(rectangle) = &area.shape
                        {
                            (areas[lane], rectangles[lane]) = (area, rectangle);
                            same |= 1 << lane;
                            varying |= u32::from(area.has_varying_radiance) << lane;
                            surfaces[lane] = [area.part, area.triangles[0]];
                        }
                    }
                    let mut found = sample_rectangles(token, receivers, (&areas, rectangles), probability, u);
                    self.vary(&mut found, F::mask(token, varying), &surfaces);
                    found
                }
                _ => self.sample_same(token, receivers, index, probability, u, F::mask(token, same & left)),
            };
            samples = LightSamples::select(F::mask(token, same & left), here, samples);
            left &= !same;
        }
        samples
    }

    /// Samples of one light in the active lanes, which was chosen with the given probability.
    #[inline(always)]
    fn sample_same<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        index: u32,
        probability: F,
        u: [F; 2],
        active: F::Mask,
    ) -> LightSamples<F> {
        let mut samples = LightSamples::none(token);
        match self.lights.lights.get(index as usize) {
            Some(Light::Area(a)) => {
                samples = a.sample(token, receivers, probability, u);
                if a.has_varying_radiance {
                    self.vary(&mut samples, active, &[[a.part, a.triangles[0]]; MAX_WIDTH]);
                }
            }
            Some(Light::Mesh(m)) => {
                if let Some(mesh) = self.lights.mesh_lights.get(*m as usize) {
                    let surfaces;
                    (samples, surfaces) = mesh.sample(token, receivers, probability, u, active);
                    if mesh.has_varying_radiance {
                        self.vary(&mut samples, active, &surfaces);
                    }
                }
            }
            Some(light) => samples = self.lights.sample_without_surface(token, receivers, light, probability, u),
            _ => {}
        }
        samples.pdf = samples.pdf.only(active);
        samples
    }

    /// Evaluates the radiance of samples of some lanes at their points, where it is not constant. `surfaces` are parts and
    /// triangles of the points.
    #[inline(always)]
    fn vary<F: Lanes>(&self, samples: &mut LightSamples<F>, lanes: F::Mask, surfaces: &[[u32; 2]; MAX_WIDTH]) {
        let lanes = lanes & samples.pdf.is_positive();
        if lanes.any() {
            let (points, directions) = (samples.point.to_lanes(), samples.direction.to_lanes());
            let mut radiance = samples.radiance.to_lanes();
            for lane in lanes.lanes() {
                let [part, triangle] = surfaces[lane];
                radiance[lane] = self.radiance_at(part, triangle, points[lane], -directions[lane]);
            }
            samples.radiance = Rgb::from_lanes(samples.pdf.token(), &radiance);
        }
    }

    /// The densities [1/sr] of points on surfaces in [`Self::sample_lights`]; 0 if a surface does not emit. `chosen` is true for
    /// receivers that choose one light.
    #[inline(never)]
    pub fn light_pdf<F: Lanes>(&self, receivers: &Receivers<F>, chosen: F::Mask, points: &SurfacePoints<F>) -> F {
        let token = points.distance.token();
        vectorize!(F, token, {
            let (parts, triangles) = (F::word_to_array(points.part), F::word_to_array(points.triangle));
            let mut lights = [NO_LIGHT; MAX_WIDTH];
            for lane in 0..F::WIDTH {
                let of_part = &self.parts[parts[lane] as usize].lights;
                lights[lane] = of_part.get(triangles[lane] as usize).copied().unwrap_or(NO_LIGHT);
            }
            let (mut pdf, mut left) = (F::splat(token, 0.0), F::mask(token, u32::MAX >> (32 - F::WIDTH)));
            while let Some(first) = left.lanes().next() {
                let same = F::word_eq(F::load_word(token, &lights), F::splat_word(token, lights[first]));
                let here = match self.lights.lights.get(lights[first] as usize) {
                    Some(Light::Area(a)) => a.pdf(token, receivers, points.point),
                    Some(Light::Mesh(m)) if let Some(mesh) = self.lights.mesh_lights.get(*m as usize) => {
                        mesh.pdf(token, receivers, &triangles, (points.point, points.normal))
                    }
                    _ => F::splat(token, 0.0),
                };
                pdf = same.select(here, pdf);
                left = left & !same;
            }
            pdf * self.lights.share(receivers, chosen, &lights)
        })
    }

    /// The indices of the lights of kind sun.
    #[inline]
    pub fn suns(&self) -> impl Iterator<Item = u32> {
        let lights: &[Light] = if self.lights.has_suns { &self.lights.lights } else { &[] };
        (0..).zip(lights).filter(|(_, light)| matches!(light, Light::Sun(_))).map(|(index, _)| index)
    }

    /// Radiance [W/(m^2 sr)] of the sun of an index along directions.
    #[inline(always)]
    pub fn sun_radiance<F: Lanes>(&self, sun: u32, direction: V3<F>) -> Rgb<F> {
        match self.lights.lights.get(sun as usize) {
            Some(Light::Sun(s)) => s.radiance(direction),
            _ => Rgb::splat(direction.x.constant(0.0)),
        }
    }

    /// The densities [1/sr] of directions toward the sun of an index in [`Self::sample_lights`]. `chosen` is as for
    /// [`Self::light_pdf`].
    #[inline(always)]
    pub fn sun_pdf<F: Lanes>(&self, receivers: &Receivers<F>, chosen: F::Mask, sun: u32, direction: V3<F>) -> F {
        match self.lights.lights.get(sun as usize) {
            Some(Light::Sun(s)) => {
                let pdf = s.pdf(direction).only(receivers.faces(direction));
                pdf * self.lights.share(receivers, chosen, &[sun; MAX_WIDTH])
            }
            _ => direction.x.constant(0.0),
        }
    }

    /// Radiance [W/(m^2 sr)] of the environment along directions, without suns.
    #[inline(always)]
    pub fn environment_radiance<F: Lanes>(&self, direction: V3<F>) -> Rgb<F> {
        match &self.lights.environment {
            Some(environment) => environment.radiance(direction),
            None => Rgb::splat(direction.x.constant(0.0)),
        }
    }

    /// The densities [1/sr] of directions toward the environment in [`Self::sample_lights`]. `chosen` is as for
    /// [`Self::light_pdf`].
    #[inline(always)]
    pub fn environment_pdf<F: Lanes>(&self, receivers: &Receivers<F>, chosen: F::Mask, direction: V3<F>) -> F {
        // The environment is the last light if it emits.
        match (&self.lights.environment, self.lights.lights.last()) {
            (Some(e), Some(Light::Environment)) => {
                let index = self.lights.lights.len() as u32 - 1;
                e.pdf(receivers, direction) * self.lights.share(receivers, chosen, &[index; MAX_WIDTH])
            }
            _ => direction.x.constant(0.0),
        }
    }
}
