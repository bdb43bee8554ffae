//! Punctual lights and cameras of glTF.

use crate::import::options::LUMENS_PER_WATT;
use crate::import::warnings::Warnings;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Projection, PunctualKind};
use gltf::json::camera::Type as CameraType;
use gltf::json::extensions::scene::khr_lights_punctual::{Light, Spot, Type};
use gltf::json::validation::Checked;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Converts a light of KHR_lights_punctual: candela to W/sr and lux to W/m^2, both by [`LUMENS_PER_WATT`]. `None`, after
/// a warning, for one that cannot be used.
pub(super) fn light(source: &Light, place: &str, warnings: &mut Warnings) -> Option<PunctualKind> {
    let color = Rgb::from_array(source.color);
    let strength = color * source.intensity * (1.0 / LUMENS_PER_WATT);
    if !strength.is_finite() || strength.to_array().iter().any(|v| *v < 0.0) {
        warnings.push(place, "its colour or intensity is negative or not finite; the light is left out");
        return None;
    }
    if source.range.is_some() {
        warnings.push(place, "its range is ignored: light does not end");
    }
    match source.type_ {
        Checked::Valid(Type::Point) => Some(PunctualKind::Point { intensity: strength }),
        Checked::Valid(Type::Directional) => Some(PunctualKind::Directional { irradiance: strength }),
        Checked::Valid(Type::Spot) => {
            let (inner, outer) = cone(source.spot.as_ref(), place, warnings);
            Some(PunctualKind::Spot { intensity: strength, inner, outer })
        }
        Checked::Invalid => {
            warnings.push(place, "its type does not exist; the light is left out");
            None
        }
    }
}

/// Inner and outer half-angle [rad], with 0 <= inner <= outer and 0 < outer <= pi/2.
fn cone(spot: Option<&Spot>, place: &str, warnings: &mut Warnings) -> (f32, f32) {
    let (mut inner, mut outer) = spot.map_or((0.0, FRAC_PI_4), |s| (s.inner_cone_angle, s.outer_cone_angle));
    if !(outer > 0.0 && outer <= FRAC_PI_2) {
        // pi/2 as a decimal may round to just above it.
        let repaired = if outer > FRAC_PI_2 { FRAC_PI_2 } else { FRAC_PI_4 };
        if outer - repaired > 1e-6 || outer <= 0.0 {
            warnings.push(place, format!("outerConeAngle {outer} is outside (0, pi/2] and becomes {repaired}"));
        }
        outer = repaired;
    }
    if !(0.0..=outer).contains(&inner) {
        let repaired = inner.clamp(0.0, outer);
        warnings.push(place, format!("innerConeAngle {inner} is outside [0, {outer}] and becomes {repaired}"));
        inner = repaired;
    }
    (inner, outer)
}

/// Converts a camera to projection and aspect ratio. `None`, after a warning, for one that cannot be used.
pub(super) fn camera(
    source: &gltf::json::Camera,
    place: &str,
    warnings: &mut Warnings,
) -> Option<(Projection, Option<f32>)> {
    let positive = |v: f32| Some(v).filter(|v| v.is_finite() && *v > 0.0);
    let is_orthographic = matches!(source.type_, Checked::Valid(CameraType::Orthographic));
    let converted = match (&source.perspective, &source.orthographic) {
        (Some(p), _) if !is_orthographic => positive(p.yfov)
            .filter(|fov| *fov < PI)
            .map(|vertical_fov| (Projection::Perspective { vertical_fov }, p.aspect_ratio.and_then(positive))),
        (_, Some(o)) => {
            // Some exporters write negative magnifications in place of a rotation.
            let size = |v: f32| positive(v.abs());
            size(o.xmag).zip(size(o.ymag)).map(|(half_width, half_height)| {
                (Projection::Orthographic { half_width, half_height }, Some(half_width / half_height))
            })
        }
        _ => None,
    };
    if converted.is_none() {
        warnings.push(place, "its field of view or magnification is missing or out of range; it is left out");
    }
    converted
}
