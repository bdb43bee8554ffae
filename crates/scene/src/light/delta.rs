//! Lights without extent: points, spots, IES profiles and distant lights.

use crate::build::builder::{PunctualKind, PunctualLight};
use crate::light::Light;
use crate::light::luminaire::LightProfile;
use crate::light::sun::Sun;
use dunkelfeld_geometry::{DAffine3, DVec3, Vec3};
use dunkelfeld_radiometry::Rgb;
use std::f32::consts::PI;

/// A light without extent, in render space.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) enum DeltaLight {
    Point {
        position: Vec3,
        intensity: Rgb,
    },
    Spot {
        position: Vec3,
        axis: Vec3,
        intensity: Rgb,
        cos_inner: f32,
        cos_outer: f32,
    },
    Directional {
        direction: Vec3,
        irradiance: Rgb,
    },
    /// A light with an IES profile: the index of the profile, and its axes x, y and z in render space.
    Profile {
        position: Vec3,
        axes: [Vec3; 3],
        scale: Rgb,
        profile: u32,
    },
}

/// Light that arrives from a light without extent, unoccluded.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arriving {
    /// Irradiance on a surface that faces the light [W/m^2].
    pub(crate) irradiance: Rgb,
    /// Unit direction toward the light.
    pub(crate) direction: Vec3,
    /// Position of the light; `None` for one infinitely far away.
    pub(crate) position: Option<Vec3>,
}

impl DeltaLight {
    /// The light of a builder without a surface, moved to render space.
    pub(crate) fn light(light: &PunctualLight, to_render: &DAffine3) -> Light {
        let to_render = *to_render * light.to_world;
        let position = to_render.translation.as_vec3();
        let m = to_render.matrix3;
        let back = m.z_axis.try_normalize().unwrap_or(DVec3::Z);
        let axis = (-back).as_vec3();
        let delta = match light.kind {
            PunctualKind::Sun { irradiance, half_angle } => {
                return Light::Sun(Sun::new(back.as_vec3(), half_angle, irradiance));
            }
            PunctualKind::Point { intensity } => Self::Point { position, intensity },
            PunctualKind::Spot { intensity, inner, outer } => {
                Self::Spot { position, axis, intensity, cos_inner: inner.cos(), cos_outer: outer.cos() }
            }
            PunctualKind::Directional { irradiance } => Self::Directional { direction: -axis, irradiance },
            PunctualKind::Profile { profile, scale } => {
                let x = m.x_axis.reject_from(back).try_normalize().unwrap_or_else(|| back.any_orthonormal_vector());
                let y = back.cross(x);
                // A mirrored luminaire has a mirrored profile.
                let y = if m.y_axis.dot(y) < 0.0 { -y } else { y };
                Self::Profile { position, axes: [x, y, back].map(|a| a.as_vec3()), scale, profile: profile as u32 }
            }
        };
        Light::Delta(delta)
    }

    /// Emitted power \[W\]; for a distant light, over the scene's cross-section.
    pub(crate) fn power(&self, scene_radius: f32, profiles: &[LightProfile]) -> Rgb {
        match *self {
            Self::Point { intensity, .. } => intensity * (4.0 * PI),
            // The integral of the edge (a squared ramp) is a third of its zone.
            Self::Spot { intensity, cos_inner, cos_outer, .. } => {
                intensity * (2.0 * PI * ((1.0 - cos_inner) + (cos_inner - cos_outer) / 3.0))
            }
            Self::Directional { irradiance, .. } => irradiance * (PI * scene_radius * scene_radius),
            Self::Profile { scale, profile, .. } => {
                scale * profiles.get(profile as usize).map_or(0.0, LightProfile::power)
            }
        }
    }

    /// Light that arrives at `p`, unoccluded.
    #[inline]
    pub(crate) fn arriving_at(&self, p: Vec3, profiles: &[LightProfile]) -> Arriving {
        // Direction toward the light and the inverse square of the distance. At the position of the light itself the
        // result is zero.
        let from = |position: Vec3| {
            let to_light = position - p;
            let d2 = to_light.length_squared();
            let inverse = if d2 > 0.0 { 1.0 / d2 } else { 0.0 };
            (to_light * inverse.sqrt(), inverse)
        };
        match *self {
            Self::Point { position, intensity } => {
                let (direction, inverse) = from(position);
                Arriving { irradiance: intensity * inverse, direction, position: Some(position) }
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
                Arriving { irradiance: intensity * (inverse * ramp * ramp), direction, position: Some(position) }
            }
            Self::Directional { direction, irradiance } => Arriving { irradiance, direction, position: None },
            Self::Profile { position, axes, scale, profile } => {
                let (direction, inverse) = from(position);
                let local = Vec3::from_array(axes.map(|a| -direction.dot(a)));
                let intensity = profiles.get(profile as usize).map_or(0.0, |p| p.intensity(local));
                Arriving { irradiance: scale * (intensity * inverse), direction, position: Some(position) }
            }
        }
    }
}
