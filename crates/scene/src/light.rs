//! Lights: which one to ask, where on it to look, and how likely that was.
//!
//! One light is chosen per question. With few lights the choice weighs each by a bound of the irradiance it can send to
//! the asking point; with many, by power alone. Densities always include the choice.

use crate::environment::EnvironmentLight;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_geometry::shape::{
    Rectangle, ShapeSample, pdf_rectangle, pdf_triangle, sample_rectangle, sample_triangle,
};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Distribution1D;
use std::f32::consts::PI;

/// Up to this many lights are weighed one by one at every point that asks.
const FEW: usize = 64;

/// No light: marks triangles that do not emit.
pub(crate) const NO_LIGHT: u32 = u32::MAX;

/// The point that asks for light.
#[derive(Clone, Copy, Debug)]
pub struct LightReceiver {
    /// Position in render space.
    pub point: Vec3,
    /// Geometric normal on the side of the viewer.
    pub normal: Vec3,
    /// Can light from behind the surface be scattered too?
    pub both_sides: bool,
}

/// Shape of an area light in render space; planar, with unit normal on the emitting (front) side.
#[derive(Clone, Copy, Debug)]
pub(crate) enum AreaShape {
    /// Two triangles that form a rectangle.
    Rectangle(Rectangle),
    /// A single triangle.
    Triangle([Vec3; 3]),
}

/// One emitting triangle or rectangle.
#[derive(Clone, Copy, Debug)]
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
}

/// A light without extent, in render space.
#[derive(Clone, Copy, Debug)]
pub(crate) enum DeltaLight {
    Point { position: Vec3, intensity: Rgb },
    Spot { position: Vec3, axis: Vec3, intensity: Rgb, cos_inner: f32, cos_outer: f32 },
    Directional { direction: Vec3, irradiance: Rgb },
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Light {
    Area(AreaLight),
    Delta(DeltaLight),
    Environment,
}

/// A direction toward a light, as next-event estimation needs it.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit direction toward the light.
    pub direction: Vec3,
    /// The point on the light, with the light's normal there; `None` when infinitely far.
    pub target: Option<LightTarget>,
    /// Radiance arriving unoccluded [W/(m^2 sr)]; for lights without extent the irradiance on a facing surface [W/m^2].
    pub radiance: Rgb,
    /// Density [1/sr]; for lights without extent the probability of having chosen the light.
    pub pdf: f32,
    /// A light without extent: scattering cannot find it, so there is nothing to weigh it against.
    pub is_delta: bool,
}

/// The end of a shadow ray.
#[derive(Clone, Copy, Debug)]
pub struct LightTarget {
    /// Point on the light.
    pub point: Vec3,
    /// Unit normal of the light's surface, zero for points without a surface.
    pub normal: Vec3,
    /// Part and triangle on which the point lies, for textured emission; `None` for lights without a surface.
    pub(crate) surface: Option<(u32, u32)>,
}

/// All lights of a scene, and how to choose among them.
#[derive(Clone, Debug, Default)]
pub(crate) struct LightTable {
    pub(crate) lights: Vec<Light>,
    pub(crate) environment: Option<EnvironmentLight>,
    by_power: Option<Distribution1D>,
}

impl LightTable {
    pub(crate) fn new(mut lights: Vec<Light>, environment: Option<EnvironmentLight>, scene_radius: f32) -> Self {
        if environment.as_ref().is_some_and(|e| !e.mean.is_black()) {
            lights.push(Light::Environment);
        }
        let mut table = Self { lights, environment, by_power: None };
        if table.lights.len() > FEW {
            let powers: Vec<f64> = table.lights.iter().map(|l| f64::from(table.power(l, scene_radius))).collect();
            table.by_power = Some(Distribution1D::new(powers));
        }
        table
    }

    /// Emitted power [W], mean over the channels.
    fn power(&self, light: &Light, scene_radius: f32) -> f32 {
        match light {
            Light::Area(a) => a.power().mean(),
            Light::Delta(d) => d.power(scene_radius).mean(),
            Light::Environment => {
                self.environment.as_ref().map_or(0.0, |e| PI * PI * scene_radius * scene_radius * e.mean.mean())
            }
        }
    }

    /// A bound, up to a constant, of the irradiance that a light can send to the receiver.
    #[inline]
    fn weight(&self, light: &Light, receiver: &LightReceiver) -> f32 {
        match light {
            Light::Area(a) => {
                let to_light = a.center - receiver.point;
                let distance = a.normal.dot(to_light);
                // The light is planar: a point behind a one-sided light gets nothing.
                if !a.two_sided && distance >= 0.0 {
                    return 0.0;
                }
                if !receiver.both_sides && to_light.dot(receiver.normal) <= -a.radius {
                    return 0.0;
                }
                let d2 = to_light.length_squared();
                let r2 = a.radius * a.radius;
                let cos_light = (distance.abs() / d2.sqrt().max(f32::MIN_POSITIVE) + 0.2).min(1.0);
                a.mean_radiance.mean() * a.area * cos_light / (d2 + 0.5 * r2)
            }
            Light::Delta(d) => d.irradiance_at(receiver.point).0.mean(),
            Light::Environment => self.environment.as_ref().map_or(0.0, |e| PI * e.mean.mean()),
        }
    }

    /// Chooses a light: its index and probability.
    #[inline]
    fn choose(&self, receiver: &LightReceiver, u: f32) -> Option<(usize, f32)> {
        if let Some(by_power) = &self.by_power {
            let choice = by_power.sample_discrete(u);
            return Some((choice.index, choice.probability));
        }
        let mut weights = [0f32; FEW];
        let mut total = 0.0;
        for (w, light) in weights.iter_mut().zip(&self.lights) {
            *w = self.weight(light, receiver);
            total += *w;
        }
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let mut rest = u * total;
        let mut last = None;
        for (i, &w) in weights.iter().enumerate().take(self.lights.len()).filter(|(_, w)| **w > 0.0) {
            last = Some((i, w / total));
            if rest < w {
                break;
            }
            rest -= w;
        }
        last
    }

    /// The probability with which [`Self::choose`] chooses a light.
    #[inline]
    fn probability(&self, receiver: &LightReceiver, index: usize) -> f32 {
        if let Some(by_power) = &self.by_power {
            return by_power.pdf_discrete(index);
        }
        let mut total = 0.0;
        let mut own = 0.0;
        for (i, light) in self.lights.iter().enumerate() {
            let w = self.weight(light, receiver);
            total += w;
            if i == index {
                own = w;
            }
        }
        if total > 0.0 && total.is_finite() { own / total } else { 0.0 }
    }

    /// Chooses a light and a direction toward it. `None`: no light can be seen from here.
    #[inline]
    pub(crate) fn sample(&self, receiver: &LightReceiver, u_choice: f32, u: [f32; 2]) -> Option<LightSample> {
        let (index, probability) = self.choose(receiver, u_choice)?;
        match &self.lights[index] {
            Light::Area(a) => {
                let s = a.sample(receiver.point, u)?;
                let to_light = s.point - receiver.point;
                let distance = to_light.length();
                let direction = to_light / distance;
                let cos_light = -direction.dot(a.normal);
                let pdf = s.pdf * probability;
                if !(distance > 0.0 && pdf > 0.0 && pdf.is_finite()) || (cos_light <= 0.0 && !a.two_sided) {
                    return None;
                }
                let target = LightTarget { point: s.point, normal: a.normal, surface: Some((a.part, a.triangles[0])) };
                Some(LightSample { direction, target: Some(target), radiance: a.mean_radiance, pdf, is_delta: false })
            }
            Light::Delta(d) => {
                let (irradiance, direction, position) = d.irradiance_at(receiver.point);
                let target = position.map(|point| LightTarget { point, normal: Vec3::ZERO, surface: None });
                (!irradiance.is_black()).then_some(LightSample {
                    direction,
                    target,
                    radiance: irradiance,
                    pdf: probability,
                    is_delta: true,
                })
            }
            Light::Environment => {
                let (direction, radiance, pdf) = self.environment.as_ref()?.sample(u);
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

    /// The density [1/sr] with which [`Self::sample`] would have found `point` on area light `index`.
    #[inline]
    pub(crate) fn pdf_area(&self, receiver: &LightReceiver, index: u32, point: Vec3) -> f32 {
        match self.lights.get(index as usize) {
            Some(Light::Area(a)) => a.pdf(receiver.point, point) * self.probability(receiver, index as usize),
            _ => 0.0,
        }
    }

    /// The density [1/sr] with which [`Self::sample`] would have found the environment in a direction.
    #[inline]
    pub(crate) fn pdf_environment(&self, receiver: &LightReceiver, direction: Vec3) -> f32 {
        // The environment, if it shines, is the last light.
        match (&self.environment, self.lights.last()) {
            (Some(e), Some(Light::Environment)) => e.pdf(direction) * self.probability(receiver, self.lights.len() - 1),
            _ => 0.0,
        }
    }
}

impl AreaLight {
    fn sample(&self, from: Vec3, u: [f32; 2]) -> Option<ShapeSample> {
        match &self.shape {
            AreaShape::Rectangle(r) => sample_rectangle(r, from, u),
            AreaShape::Triangle(t) => sample_triangle(t, from, u),
        }
    }

    fn pdf(&self, from: Vec3, point: Vec3) -> f32 {
        match &self.shape {
            AreaShape::Rectangle(r) => pdf_rectangle(r, from, point),
            AreaShape::Triangle(t) => pdf_triangle(t, from, point),
        }
    }

    /// Emitted power [W]: a Lambertian emitter sends pi L per area and side.
    pub(crate) fn power(&self) -> Rgb {
        self.mean_radiance * (PI * self.area * if self.two_sided { 2.0 } else { 1.0 })
    }
}

impl DeltaLight {
    /// Emitted power [W]; parallel light is counted over the scene's cross-section.
    pub(crate) fn power(&self, scene_radius: f32) -> Rgb {
        match *self {
            Self::Point { intensity, .. } => intensity * (4.0 * PI),
            // The smoothstep-like edge (squared ramp) holds a third of its zone.
            Self::Spot { intensity, cos_inner, cos_outer, .. } => {
                intensity * (2.0 * PI * ((1.0 - cos_inner) + (cos_inner - cos_outer) / 3.0))
            }
            Self::Directional { irradiance, .. } => irradiance * (PI * scene_radius * scene_radius),
        }
    }

    /// Irradiance [W/m^2] on a facing surface at `p`, the direction toward the light, its position if it has one.
    #[inline]
    fn irradiance_at(&self, p: Vec3) -> (Rgb, Vec3, Option<Vec3>) {
        let from = |position: Vec3| {
            let to_light = position - p;
            let d2 = to_light.length_squared();
            let inverse = if d2 > 0.0 { 1.0 / d2 } else { 0.0 };
            (to_light * inverse.sqrt(), inverse)
        };
        match *self {
            Self::Point { position, intensity } => {
                let (direction, inverse) = from(position);
                (intensity * inverse, direction, Some(position))
            }
            Self::Spot { position, axis, intensity, cos_inner, cos_outer } => {
                let (direction, inverse) = from(position);
                let cos = -direction.dot(axis);
                // KHR_lights_punctual: the ramp from outer to inner cosine, squared.
                let ramp = if cos_inner > cos_outer {
                    ((cos - cos_outer) / (cos_inner - cos_outer)).clamp(0.0, 1.0)
                } else {
                    f32::from(u8::from(cos >= cos_outer))
                };
                (intensity * (inverse * ramp * ramp), direction, Some(position))
            }
            Self::Directional { direction, irradiance } => (irradiance, direction, None),
        }
    }
}
