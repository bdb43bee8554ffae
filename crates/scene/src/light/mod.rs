//! Lights: choice of a light, sampling of a direction toward it, and the density of both.
//!
//! A vertex samples one light or each of them. If one is chosen among few lights, the weight of each is an
//! estimate of the irradiance that it can send to the receiver. Among many lights a tree makes the choice. Densities
//! include the choice.

pub(crate) mod delta;
pub mod emission_profile;
pub(crate) mod environment;
pub mod luminaire;
pub(crate) mod mesh_light;
pub mod sample;
pub mod summary;
pub(crate) mod sun;
pub(crate) mod tree;

use crate::light::delta::DeltaLight;
use crate::light::environment::EnvironmentLight;
use crate::light::luminaire::LightProfile;
use crate::light::mesh_light::MeshLight;
use crate::light::sample::{LightSample, LightSampleContext, LightTarget};
use crate::light::sun::Sun;
use crate::light::tree::{EmissionCone, LightBounds, LightTree};
use crate::sampling_options::Techniques;
use dunkelfeld_bsdf::EFFECTS;
use dunkelfeld_geometry::shape::{RectangleSampler, ShapeSample, pdf_triangle, sample_triangle};
use dunkelfeld_geometry::{Aabb, Vec3};
use dunkelfeld_radiometry::Rgb;
use std::f32::consts::PI;

/// Maximum number of lights that are weighted one by one at each receiver. More lights are stored in a tree.
pub(crate) const MAX_WEIGHTED_ONE_BY_ONE: usize = 64;

/// Up to this many lights a vertex takes a sample of each light, at surfaces and in media at the first vertices of a
/// path.
pub(crate) const MAX_LIGHTS_FOR_EACH: usize = 8;

/// Number of first scattering vertices of a path with a sample of each light in media. In a dense medium thousands of
/// vertices may follow.
const MAX_VERTICES_FOR_EACH_IN_MEDIA: u32 = 2;

/// No light: marks triangles that do not emit.
pub(crate) const NO_LIGHT: u32 = u32::MAX;

/// The light samples of a vertex.
///
/// Each light sample is a sampling technique of its own that draws one direction. With [`Self::Each`], a
/// scattered ray that hits a light competes only with the sample of that light. The samples of other lights do not draw
/// points on it (multi-sample combination, Veach 1997, section 9.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightChoice {
    /// A sample of one light, chosen in proportion to its estimated contribution.
    One,
    /// A sample of each light.
    Each,
}

/// Shape of an area light in render space; planar, with unit normal on the emitting (front) side.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) enum AreaShape {
    /// Two triangles that form a rectangle.
    Rectangle(RectangleSampler),
    /// A single triangle.
    Triangle([Vec3; 3]),
}

/// One emitting triangle or rectangle.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) struct AreaLight {
    pub(crate) shape: AreaShape,
    /// Unit normal of the front.
    pub(crate) normal: Vec3,
    pub(crate) center: Vec3,
    /// Half the diameter: the light lies inside this distance from its centre.
    pub(crate) radius: f32,
    pub(crate) area: f32,
    pub(crate) two_sided: bool,
    /// The part it belongs to, and its one or two triangles (the second may be `u32::MAX`).
    pub(crate) part: u32,
    pub(crate) triangles: [u32; 2],
    /// Mean radiance over the surface [W/(m^2 sr)].
    pub(crate) mean_radiance: Rgb,
    /// See [`CompiledMaterial::has_varying_radiance`](crate::query::surface::CompiledMaterial).
    pub(crate) has_varying_radiance: bool,
}

#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) enum Light {
    Area(AreaLight),
    /// An emitting mesh as one light: its index in [`LightTable::mesh_lights`].
    Mesh(u32),
    Delta(DeltaLight),
    Sun(Sun),
    Environment,
}

/// All lights of a scene, and the choice among them.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub(crate) struct LightTable {
    pub(crate) lights: Vec<Light>,
    pub(crate) mesh_lights: Vec<MeshLight>,
    /// True if a light of `lights` is a sun.
    has_suns: bool,
    pub(crate) environment: Option<EnvironmentLight>,
    pub(crate) profiles: Vec<LightProfile>,
    /// The tree for the choice, if there are more lights than are weighed one by one.
    pub(crate) tree: Option<LightTree>,
    /// True if surfaces, and the first vertices of a path in media, take a sample of each light.
    samples_each: bool,
}

impl LightTable {
    pub(crate) fn new(
        mut lights: Vec<Light>,
        mesh_lights: Vec<MeshLight>,
        environment: Option<EnvironmentLight>,
        profiles: Vec<LightProfile>,
        scene_radius: f32,
        techniques: Techniques,
    ) -> Self {
        if environment.as_ref().is_some_and(|e| !e.mean.is_black()) {
            lights.push(Light::Environment);
        }
        // A single light needs no choice.
        let samples_each = lights.len() <= if techniques.every_light { MAX_LIGHTS_FOR_EACH } else { 1 };
        let has_suns = lights.iter().any(|l| matches!(l, Light::Sun(_)));
        let mut table = Self { lights, mesh_lights, has_suns, environment, profiles, tree: None, samples_each };
        if table.lights.len() > MAX_WEIGHTED_ONE_BY_ONE {
            let bounds: Vec<_> = table.lights.iter().map(|l| table.bounds(l)).collect();
            let powers: Vec<_> = table.lights.iter().map(|l| table.power(l, scene_radius).mean()).collect();
            table.tree = Some(LightTree::new(&bounds, &powers));
        }
        table
    }

    /// Emitted power \[W\]; for light from infinitely far away, over the scene's cross-section.
    pub(crate) fn power(&self, light: &Light, scene_radius: f32) -> Rgb {
        match light {
            Light::Area(a) => a.power(),
            Light::Mesh(m) => self.mesh_lights.get(*m as usize).map_or(Rgb::BLACK, MeshLight::power),
            Light::Delta(d) => d.power(scene_radius, &self.profiles),
            Light::Sun(s) => s.irradiance() * (PI * scene_radius * scene_radius),
            Light::Environment => self.environment_mean() * (PI * PI * scene_radius * scene_radius),
        }
    }

    /// The bounds of a light for a tree; `None` for one infinitely far away.
    fn bounds(&self, light: &Light) -> Option<LightBounds> {
        let at = |position: Vec3, axis: Vec3, angle: f32, peak: Rgb| LightBounds {
            bounds: Aabb::from_points([position]),
            cone: EmissionCone::beam(axis, angle),
            peak: peak.mean(),
        };
        match light {
            Light::Area(a) => Some(a.bounds()),
            Light::Mesh(m) => self.mesh_lights.get(*m as usize).map(MeshLight::bounds),
            Light::Delta(DeltaLight::Point { position, intensity }) => Some(at(*position, Vec3::Z, PI, *intensity)),
            Light::Delta(DeltaLight::Spot { position, axis, intensity, cos_outer, .. }) => {
                Some(at(*position, *axis, cos_outer.clamp(-1.0, 1.0).acos(), *intensity))
            }
            Light::Delta(DeltaLight::Profile { position, axes, scale, profile }) => {
                let profile = self.profiles.get(*profile as usize);
                let (cutoff_angle, peak) = profile.map_or((PI, 0.0), |p| (p.cutoff_angle(), p.peak()));
                Some(at(*position, -axes[2], cutoff_angle, *scale * peak))
            }
            Light::Delta(DeltaLight::Directional { .. }) | Light::Sun(_) | Light::Environment => None,
        }
    }

    fn environment_mean(&self) -> Rgb {
        self.environment.as_ref().map_or(Rgb::BLACK, |e| e.mean)
    }

    /// The light samples of the scattering vertex with this number (from 0, counted along a path), in a medium or on a
    /// surface.
    #[inline]
    pub(crate) fn choice_at(&self, vertex: u32, in_medium: bool) -> LightChoice {
        if self.samples_each && !(in_medium && vertex >= MAX_VERTICES_FOR_EACH_IN_MEDIA) {
            LightChoice::Each
        } else {
            LightChoice::One
        }
    }

    /// The number of light samples of a vertex.
    #[inline]
    pub(crate) fn num_light_samples(&self, choice: LightChoice) -> usize {
        match choice {
            LightChoice::One => self.lights.len().min(1),
            LightChoice::Each => self.lights.len(),
        }
    }

    /// An estimate, up to a constant, of the irradiance that a light can send to the receiver; zero if it can send
    /// none.
    #[inline(always)]
    fn weight(&self, light: &Light, receiver: &LightSampleContext) -> f32 {
        match light {
            Light::Area(a) => a.weight(receiver),
            _ if !EFFECTS => 0.0,
            Light::Mesh(m) => self.mesh_lights.get(*m as usize).map_or(0.0, |m| m.weight(receiver)),
            Light::Sun(s) if receiver.both_sides || s.is_above(receiver.normal) => s.irradiance().mean(),
            Light::Sun(_) => 0.0,
            Light::Delta(d) => {
                let arriving = d.arriving_at(receiver.point, &self.profiles);
                if receiver.faces(arriving.direction) { arriving.irradiance.mean() } else { 0.0 }
            }
            Light::Environment => PI * self.environment_mean().mean(),
        }
    }

    /// True if there are several lights and each is sampled.
    pub(crate) fn samples_each(&self) -> bool {
        self.samples_each && self.lights.len() > 1
    }

    /// True if there are so many lights that a tree chooses among them.
    pub(crate) fn has_tree(&self) -> bool {
        self.tree.is_some()
    }

    /// Chooses a light: its index and probability.
    #[inline(always)]
    fn choose(&self, receiver: &LightSampleContext, u: f32) -> Option<(usize, f32)> {
        match &self.tree {
            // The tree gets a copy of the receiver, because most scenes have no tree (`CONVENTIONS.md`).
            Some(tree) if EFFECTS => {
                let receiver = *receiver;
                tree.choose(&receiver, u)
            }
            // A small array for few lights, because the array is cleared for each choice.
            _ if self.lights.len() <= 8 => self.choose_by_weight::<8>(receiver, u),
            _ => self.choose_by_weight::<MAX_WEIGHTED_ONE_BY_ONE>(receiver, u),
        }
    }

    /// Chooses among at most N lights by weight.
    #[inline(always)]
    fn choose_by_weight<const N: usize>(&self, receiver: &LightSampleContext, u: f32) -> Option<(usize, f32)> {
        let mut weights = [0f32; N];
        let mut total = 0.0;
        for (w, light) in weights.iter_mut().zip(&self.lights) {
            *w = self.weight(light, receiver);
            total += *w;
        }
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        in_proportion(&weights, total, u).map(|(i, _)| (i, weights[i] / total))
    }

    /// The probability with which [`Self::choose`] chooses a light.
    #[inline]
    fn probability(&self, receiver: &LightSampleContext, index: usize) -> f32 {
        if EFFECTS && let Some(tree) = &self.tree {
            return tree.probability(receiver, index);
        }
        let mut total = 0.0;
        let mut selected_weight = 0.0;
        for (i, light) in self.lights.iter().enumerate() {
            let w = self.weight(light, receiver);
            total += w;
            if i == index {
                selected_weight = w;
            }
        }
        if total > 0.0 && total.is_finite() { selected_weight / total } else { 0.0 }
    }

    /// The probability that a vertex samples a light.
    #[inline]
    fn share(&self, receiver: &LightSampleContext, choice: LightChoice, index: usize) -> f32 {
        match choice {
            LightChoice::One => self.probability(receiver, index),
            LightChoice::Each => 1.0,
        }
    }

    /// A direction toward a light, for the light sample `index` of [`Self::num_light_samples`]. `None` if that light
    /// cannot reach the receiver. If a light is to be chosen, `None` if no light can reach it, or if the chosen one
    /// cannot.
    #[inline(always)]
    pub(crate) fn sample(
        &self,
        receiver: &LightSampleContext,
        choice: LightChoice,
        index: usize,
        u_choice: f32,
        u: [f32; 2],
    ) -> Option<LightSample> {
        match choice {
            LightChoice::Each => self.sample_light(receiver, index, 1.0, u),
            LightChoice::One => {
                let (index, probability) = self.choose(receiver, u_choice)?;
                self.sample_light(receiver, index, probability, u)
            }
        }
    }

    /// A direction toward one light, which was chosen with the given probability.
    // Always: one copy for all kernels would be called, and its answer copied, for every light sample.
    #[inline(always)]
    fn sample_light(
        &self,
        receiver: &LightSampleContext,
        index: usize,
        probability: f32,
        u: [f32; 2],
    ) -> Option<LightSample> {
        match self.lights.get(index)? {
            Light::Area(a) => {
                let s = a.sample(receiver, u)?;
                let to_light = s.point - receiver.point;
                let distance = to_light.length();
                let direction = to_light / distance;
                let cos_light = -direction.dot(a.normal);
                let pdf = s.pdf * probability;
                if !(distance > 0.0 && pdf > 0.0 && pdf.is_finite()) || (cos_light <= 0.0 && !a.two_sided) {
                    return None;
                }
                let surface = a.has_varying_radiance.then_some((a.part, a.triangles[0]));
                let target = LightTarget { point: s.point, normal: a.normal, surface };
                Some(LightSample { direction, target: Some(target), radiance: a.mean_radiance, pdf, is_delta: false })
            }
            _ if EFFECTS => {
                // Bound to a variable first. If the call were returned directly, the result of the other branch would
                // be kept in memory as well.
                let found = self.sample_other_light(*receiver, index, probability, u)?;
                Some(found)
            }
            _ => None,
        }
    }

    /// [`Self::sample_light`] for all lights but triangles and rectangles. It is a separate function because most lights
    /// are of these shapes.
    // The receiver is passed by value, as to all rare functions (`CONVENTIONS.md`).
    #[inline(never)]
    fn sample_other_light(
        &self,
        receiver: LightSampleContext,
        index: usize,
        probability: f32,
        u: [f32; 2],
    ) -> Option<LightSample> {
        match self.lights.get(index)? {
            Light::Area(_) => None,
            Light::Mesh(m) => self.mesh_lights.get(*m as usize)?.sample(&receiver, probability, u),
            Light::Sun(s) => {
                let (direction, pdf) = s.sample(u);
                receiver.faces(direction).then_some(LightSample {
                    direction,
                    target: None,
                    radiance: s.disc_radiance(),
                    pdf: pdf * probability,
                    is_delta: false,
                })
            }
            Light::Delta(d) => {
                let arriving = d.arriving_at(receiver.point, &self.profiles);
                let target = arriving.position.map(|point| LightTarget { point, normal: Vec3::ZERO, surface: None });
                let reaches = !arriving.irradiance.is_black() && receiver.faces(arriving.direction);
                reaches.then_some(LightSample {
                    direction: arriving.direction,
                    target,
                    radiance: arriving.irradiance,
                    pdf: probability,
                    is_delta: true,
                })
            }
            Light::Environment => {
                let (direction, radiance, pdf) = self.environment.as_ref()?.sample(&receiver, u);
                let pdf = pdf * probability;
                (pdf > 0.0 && pdf.is_finite()).then_some(LightSample {
                    direction,
                    target: None,
                    radiance,
                    pdf,
                    is_delta: false,
                })
            }
        }
    }

    /// The density [1/sr] of `point` on the light `index` with a surface in [`Self::sample`]. `triangle` of the part
    /// contains it. `normal` is the unit normal of the surface there, on the side of its front.
    #[inline]
    pub(crate) fn pdf_area(
        &self,
        receiver: &LightSampleContext,
        choice: LightChoice,
        index: u32,
        (triangle, point, normal): (u32, Vec3, Vec3),
    ) -> f32 {
        match self.lights.get(index as usize) {
            Some(Light::Area(a)) => a.pdf(receiver, point) * self.share(receiver, choice, index as usize),
            Some(Light::Mesh(m)) if EFFECTS => {
                let pdf = self.mesh_lights.get(*m as usize).map_or(0.0, |m| m.pdf(receiver, triangle, point, normal));
                pdf * self.share(receiver, choice, index as usize)
            }
            _ => 0.0,
        }
    }

    /// The suns, each with its index.
    #[inline]
    pub(crate) fn suns(&self) -> impl Iterator<Item = (usize, &Sun)> {
        let lights: &[Light] = if EFFECTS && self.has_suns { &self.lights } else { &[] };
        lights.iter().enumerate().filter_map(|(i, l)| if let Light::Sun(s) = l { Some((i, s)) } else { None })
    }

    /// The density [1/sr] of a direction toward the sun of an index in [`Self::sample`].
    pub(crate) fn pdf_sun(
        &self,
        receiver: &LightSampleContext,
        choice: LightChoice,
        index: u32,
        direction: Vec3,
    ) -> f32 {
        match self.lights.get(index as usize) {
            Some(Light::Sun(s)) if receiver.faces(direction) => {
                s.pdf(direction) * self.share(receiver, choice, index as usize)
            }
            _ => 0.0,
        }
    }

    /// The density [1/sr] of a direction toward the environment in [`Self::sample`].
    #[inline]
    pub(crate) fn pdf_environment(&self, receiver: &LightSampleContext, choice: LightChoice, direction: Vec3) -> f32 {
        // The environment is the last light if it emits.
        match (&self.environment, self.lights.last()) {
            (Some(e), Some(Light::Environment)) if EFFECTS => {
                e.pdf(receiver, direction) * self.share(receiver, choice, self.lights.len() - 1)
            }
            _ => 0.0,
        }
    }
}

/// Chooses an index in proportion to its weight, by a number `u` in [0, 1). Returns it with what is left of `u * total`
/// in its weight. `total` is the sum of the weights.
#[inline(always)]
pub(crate) fn in_proportion(weights: &[f32], total: f32, u: f32) -> Option<(usize, f32)> {
    let mut rest = u * total;
    let mut last = None;
    for (i, &w) in weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
        last = Some((i, rest));
        if rest < w {
            break;
        }
        rest -= w;
    }
    last
}

impl AreaLight {
    /// True if light of this emitter can arrive. It cannot behind a one-sided emitter, which is planar, or below a
    /// surface that scatters light from above only.
    #[inline]
    fn reaches(&self, receiver: &LightSampleContext) -> bool {
        let to_light = self.center - receiver.point;
        (self.two_sided || self.normal.dot(to_light) < 0.0)
            && (receiver.both_sides || to_light.dot(receiver.normal) > -self.radius)
    }

    /// See [`LightTable::weight`]. The cosine at the light is that of its centre plus a margin, because the cosines at
    /// its ends differ.
    #[inline(always)]
    fn weight(&self, receiver: &LightSampleContext) -> f32 {
        if !self.reaches(receiver) {
            return 0.0;
        }
        let to_light = self.center - receiver.point;
        let d2 = to_light.length_squared();
        let r2 = self.radius * self.radius;
        let cos_light = (self.normal.dot(to_light).abs() / d2.sqrt().max(f32::MIN_POSITIVE) + 0.2).min(1.0);
        self.mean_radiance.mean() * self.area * cos_light / (d2 + 0.5 * r2)
    }

    #[inline]
    fn sample(&self, receiver: &LightSampleContext, u: [f32; 2]) -> Option<ShapeSample> {
        match &self.shape {
            _ if !self.reaches(receiver) => None,
            AreaShape::Rectangle(r) => r.sample(receiver.point, u),
            AreaShape::Triangle(t) => sample_triangle(t, receiver.point, u),
        }
    }

    #[inline]
    fn pdf(&self, receiver: &LightSampleContext, point: Vec3) -> f32 {
        match &self.shape {
            _ if !self.reaches(receiver) => 0.0,
            AreaShape::Rectangle(r) => r.pdf(receiver.point, point),
            AreaShape::Triangle(t) => pdf_triangle(t, receiver.point, point),
        }
    }

    /// Emitted power \[W\]: a Lambertian emitter sends pi L per area and side.
    pub(crate) fn power(&self) -> Rgb {
        self.mean_radiance * (PI * self.area * if self.two_sided { 2.0 } else { 1.0 })
    }

    fn bounds(&self) -> LightBounds {
        let bounds = match &self.shape {
            AreaShape::Rectangle(r) => {
                let r = r.rectangle();
                Aabb::from_points([r.point(0.0, 0.0), r.point(1.0, 0.0), r.point(0.0, 1.0), r.point(1.0, 1.0)])
            }
            AreaShape::Triangle(t) => Aabb::from_points(*t),
        };
        let cone = EmissionCone::surface(self.normal, self.two_sided);
        LightBounds { bounds, cone, peak: self.mean_radiance.mean() * self.area }
    }
}
