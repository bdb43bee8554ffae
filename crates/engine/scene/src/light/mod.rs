//! Lights: choice of a light, sampling of a direction toward it, and the density of both.
//!
//! A vertex samples one light or each of them. If one is chosen among few lights, the weight of each is an
//! estimate of the irradiance that it can send to the receiver. Among many lights a tree makes the choice. Densities
//! include the choice.

pub(crate) mod area;
pub(crate) mod delta;
pub mod emission_profile;
pub(crate) mod environment;
pub mod groups;
pub mod luminaire;
pub(crate) mod mesh_light;
mod queries;
pub mod sample;
pub mod summary;
pub(crate) mod sun;
pub(crate) mod tree;

use crate::light::area::{AreaLight, AreaShape, sample_rectangles};
use crate::light::delta::{Arriving, DeltaLight};
use crate::light::environment::EnvironmentLight;
use crate::light::luminaire::LightProfile;
use crate::light::mesh_light::MeshLight;
use crate::light::sample::{LightSamples, Receivers};
use crate::light::sun::Sun;
use crate::light::tree::{EmissionCone, LightBounds, LightTree};
use crate::sampling_options::Techniques;
use dunkelfeld_geometry::{Aabb, Vec3};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3, vectorize};
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

    /// An estimate, up to a constant, of the irradiance that a light can send to the receivers; zero if it can send
    /// none.
    #[inline(always)]
    fn weight<F: Lanes>(&self, token: F::Token, light: &Light, receivers: &Receivers<F>) -> F {
        match light {
            Light::Area(a) => a.weight(token, receivers),
            Light::Mesh(m) => match self.mesh_lights.get(*m as usize) {
                Some(mesh) => mesh.weight(token, receivers),
                None => F::splat(token, 0.0),
            },
            Light::Sun(s) => {
                F::splat(token, s.irradiance().mean()).only(receivers.both_sides | s.is_above(receivers.normal))
            }
            Light::Delta(d) => {
                let arriving = d.arriving_at(receivers.point, &self.profiles);
                arriving.irradiance.mean().only(receivers.faces(arriving.direction))
            }
            Light::Environment => F::splat(token, PI * self.environment_mean().mean()),
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

    /// Chooses a light for each lane: its index and probability, and the lanes that have one.
    #[inline(always)]
    fn choose<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        u: F,
        active: F::Mask,
    ) -> ([u32; MAX_WIDTH], F, F::Mask) {
        match &self.tree {
            Some(tree) => {
                let (each, u) = (receivers.to_lanes(), u.to_array());
                let (mut indices, mut probabilities) = ([0; MAX_WIDTH], [0.0; MAX_WIDTH]);
                for lane in active.lanes() {
                    if let Some((index, probability)) = tree.choose(&each[lane], u[lane]) {
                        (indices[lane], probabilities[lane]) = (index as u32, probability);
                    }
                }
                let probability = F::load(token, &probabilities);
                (indices, probability, probability.is_positive())
            }
            // A small array for few lights, because the array is cleared for each choice.
            _ if self.lights.len() <= 8 => self.choose_by_weight::<F, 8>(token, receivers, u),
            _ => self.choose_by_weight::<F, MAX_WEIGHTED_ONE_BY_ONE>(token, receivers, u),
        }
    }

    /// Chooses among at most N lights by weight.
    #[inline(always)]
    fn choose_by_weight<F: Lanes, const N: usize>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        u: F,
    ) -> ([u32; MAX_WIDTH], F, F::Mask) {
        let mut weights = [F::splat(token, 0.0); N];
        let mut total = F::splat(token, 0.0);
        for (weight, light) in weights.iter_mut().zip(&self.lights) {
            *weight = self.weight(token, light, receivers);
            total += *weight;
        }
        let chosen = in_proportion(token, &weights[..self.lights.len().min(N)], total, u);
        (F::word_to_array(chosen.index), chosen.weight / total, chosen.exists)
    }

    /// The probabilities that vertices sample the light of each lane. `chosen` is true where they choose one.
    #[inline(always)]
    fn share<F: Lanes>(&self, receivers: &Receivers<F>, chosen: F::Mask, lights: &[u32; MAX_WIDTH]) -> F {
        let one = receivers.point.x.constant(1.0);
        if chosen.any() { chosen.select(self.probability(one.token(), receivers, chosen, lights), one) } else { one }
    }

    /// The probabilities with which [`Self::choose`] chooses the light of each lane of a mask.
    #[inline(never)]
    fn probability<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        chosen: F::Mask,
        lights: &[u32; MAX_WIDTH],
    ) -> F {
        vectorize!(F, token, {
            match &self.tree {
                Some(tree) => tree.probabilities(token, &receivers.to_lanes(), lights, chosen),
                None => share_of(
                    token,
                    &self.lights,
                    lights,
                    #[inline(always)]
                    |light| self.weight(token, light, receivers),
                ),
            }
        })
    }

    /// Samples of a light without a surface.
    #[inline(never)]
    fn sample_without_surface<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        light: &Light,
        probability: F,
        u: [F; 2],
    ) -> LightSamples<F> {
        vectorize!(F, token, {
            let none = LightSamples::none(token);
            match (light, &self.environment) {
                (Light::Sun(s), _) => {
                    let (direction, pdf) = s.sample(u);
                    let pdf = (pdf * probability).only(receivers.faces(direction));
                    LightSamples { direction, radiance: Rgb::in_lanes(token, s.disc_radiance()), pdf, ..none }
                }
                (Light::Delta(d), _) => {
                    let Arriving { irradiance, direction, position } = d.arriving_at(receivers.point, &self.profiles);
                    let reaches = irradiance.is_lit() & receivers.faces(direction);
                    let (point, is_finite) = match position {
                        Some(position) => (V3::splat(token, position), reaches),
                        None => (none.point, none.is_finite),
                    };
                    let (radiance, pdf) = (irradiance, probability.only(reaches));
                    LightSamples { direction, point, is_finite, radiance, pdf, is_delta: reaches, ..none }
                }
                (Light::Environment, Some(environment)) => {
                    let (direction, radiance, pdf) = environment.sample(receivers, u);
                    let pdf = pdf * probability;
                    let pdf = pdf.only(pdf.is_positive() & pdf.is_finite());
                    LightSamples { direction, radiance, pdf, ..none }
                }
                _ => none,
            }
        })
    }

    /// True if there are suns.
    pub(crate) fn has_suns(&self) -> bool {
        self.has_suns
    }
}

/// The share of the weight of an entry of each lane in the sum of all; zero without a positive finite sum.
#[inline(always)]
pub(crate) fn share_of<T, F: Lanes>(
    token: F::Token,
    entries: &[T],
    of: &[u32; MAX_WIDTH],
    weight: impl Fn(&T) -> F,
) -> F {
    let of = F::load_word(token, of);
    let [mut total, mut own] = [F::splat(token, 0.0); 2];
    for (index, entry) in (0..).zip(entries) {
        let weight = weight(entry);
        total += weight;
        own = F::word_eq(of, F::splat_word(token, index)).select(weight, own);
    }
    (own / total).only(total.is_positive() & total.is_finite())
}

/// An entry of a list of weights for each lane.
pub(crate) struct InProportion<F: Lanes> {
    pub(crate) index: F::Word,
    pub(crate) weight: F,
    /// Part of `u * total` that is left in the weight.
    pub(crate) rest: F,
    /// Lanes with an entry. There is none without a positive finite total.
    pub(crate) exists: F::Mask,
}

/// Chooses entries in proportion to their weights, by numbers `u` in [0, 1). `total` is the sum of the weights.
#[inline(always)]
pub(crate) fn in_proportion<F: Lanes>(token: F::Token, weights: &[F], total: F, u: F) -> InProportion<F> {
    let zero = F::splat(token, 0.0);
    let mut rest = u * total;
    // The bits of the index, as a number for the selection.
    let mut index = zero;
    let (mut weight, mut left) = (zero, zero);
    let mut is_open = total.is_positive() & total.is_finite();
    for (i, w) in weights.iter().enumerate() {
        let here = is_open & w.is_positive();
        index = here.select(F::from_bits(F::splat_word(token, i as u32)), index);
        weight = here.select(*w, weight);
        left = here.select(rest, left);
        is_open = is_open & !(here & rest.lt(*w));
        rest -= *w;
    }
    InProportion { index: index.to_bits(), weight, rest: left, exists: weight.is_positive() }
}
