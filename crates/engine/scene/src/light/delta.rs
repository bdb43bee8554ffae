//! Lights without extent: points, spots, IES profiles and distant lights.

use crate::build::builder::{PunctualKind, PunctualLight};
use crate::light::Light;
use crate::light::emission_profile::spot;
use crate::light::luminaire::LightProfile;
use crate::light::sun::Sun;
use dunkelfeld_geometry::{DAffine3, DVec3, Vec3};
use dunkelfeld_lanes::{Frame, Lanes, V3, cos_sin_of_angle, vectorize};
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
pub(crate) struct Arriving<F> {
    /// Irradiance on a surface that faces the light [W/m^2].
    pub(crate) irradiance: Rgb<F>,
    /// Unit directions toward the light.
    pub(crate) direction: V3<F>,
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
                let [(cos_inner, _), (cos_outer, _)] = [inner, outer].map(cos_sin_of_angle);
                Self::Spot { position, axis, intensity, cos_inner, cos_outer }
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

    /// Light that arrives at points, unoccluded. Zero at the position of the light itself.
    #[inline(never)]
    pub(crate) fn arriving_at<F: Lanes>(&self, p: V3<F>, profiles: &[LightProfile]) -> Arriving<F> {
        let token = p.x.token();
        vectorize!(F, token, {
            let (position, intensity) = match *self {
                Self::Point { position, intensity } | Self::Spot { position, intensity, .. } => (position, intensity),
                Self::Profile { position, scale, .. } => (position, scale),
                Self::Directional { direction, irradiance } => {
                    let (irradiance, direction) = (Rgb::in_lanes(token, irradiance), V3::splat(token, direction));
                    return Arriving { irradiance, direction, position: None };
                }
            };
            let to_light = V3::splat(token, position) - p;
            let d2 = to_light.length_squared();
            let inverse = d2.recip().only(d2.is_positive());
            let direction = to_light * inverse.sqrt();
            let relative = match *self {
                Self::Spot { axis, cos_inner, cos_outer, .. } => {
                    spot(-direction.dot(V3::splat(token, axis)), cos_inner, cos_outer)
                }
                Self::Profile { axes: [x, y, z], profile, .. } => match profiles.get(profile as usize) {
                    Some(profile) => {
                        let axes = Frame {
                            tangent: V3::splat(token, x),
                            bitangent: V3::splat(token, y),
                            normal: V3::splat(token, z),
                        };
                        profile.intensities(-axes.to_local(direction))
                    }
                    None => F::splat(token, 0.0),
                },
                _ => F::splat(token, 1.0),
            };
            let irradiance = Rgb::in_lanes(token, intensity) * (inverse * relative);
            Arriving { irradiance, direction, position: Some(position) }
        })
    }
}
