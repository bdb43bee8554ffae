//! Punctual lights, their profiles, and cameras of glTF.

use super::accessor::Accessors;
use super::schema;
use crate::error::ImportWarning;
use crate::ies::parse_ies;
use crate::import_options::LUMENS_PER_WATT;
use crate::input::Role;
use crate::loader::AssetLoader;
use crate::warnings::Warnings;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{LightProfile, Projection, PunctualKind};
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use std::path::PathBuf;

/// Converts a light of KHR_lights_punctual: candela to W/sr and lux to W/m^2, both by [`LUMENS_PER_WATT`]. `None`, after
/// a warning, for one that cannot be used.
pub(super) fn light(source: &schema::Light, place: &str, warnings: &mut Warnings) -> Option<PunctualKind> {
    let color = Rgb::from_array(source.color.unwrap_or([1.0; 3]).map(|v| v as f32));
    let strength = color * (source.intensity.unwrap_or(1.0) as f32) * (1.0 / LUMENS_PER_WATT);
    if !strength.is_finite() || strength.to_array().iter().any(|v| *v < 0.0) {
        warnings.push(place, "its colour or intensity is negative or not finite; the light is left out");
        return None;
    }
    if source.range.is_some() {
        warnings.push(place, "its range is ignored: light does not end");
    }
    match source.kind.as_deref() {
        Some("point") => Some(PunctualKind::Point { intensity: strength }),
        Some("directional") => Some(PunctualKind::Directional { irradiance: strength }),
        Some("spot") => {
            let (inner, outer) = cone(source.spot.as_ref(), place, warnings);
            Some(PunctualKind::Spot { intensity: strength, inner, outer })
        }
        other => {
            let kind = other.unwrap_or("(none)");
            warnings.push(place, format!("the light type {kind} does not exist; the light is left out"));
            None
        }
    }
}

/// Reads a profile of EXT_lights_ies: a file beside the scene or bytes of a buffer.
///
/// # Errors
/// What keeps it from being used, in words.
pub(super) fn profile(
    source: &schema::Profile,
    index: usize,
    accessors: &Accessors<'_>,
    loader: &AssetLoader,
) -> Result<(LightProfile, Vec<ImportWarning>), String> {
    let loaded;
    let bytes = match (&source.uri, source.buffer_view) {
        (Some(uri), _) => {
            loaded = loader.load_uri(uri, Role::LightProfile).map_err(|e| e.problem)?;
            &loaded
        }
        (None, Some(view)) => accessors.view_bytes(view.get())?,
        (None, None) => return Err("it has neither a URI nor a buffer view".into()),
    };
    let file = source.uri.as_deref().filter(|uri| !uri.starts_with("data:"));
    let name = source.name.as_deref().filter(|n| !n.trim().is_empty()).or(file);
    let path = name.map_or_else(|| PathBuf::from(format!("profile {index}")), PathBuf::from);
    parse_ies(&path, bytes).map_err(|e| format!("{}: {}", e.place, e.problem))
}

/// The factor that a node puts on its profile. `None`, after a warning, if it cannot be used.
pub(super) fn profile_scale(source: &schema::ProfileReference, place: &str, warnings: &mut Warnings) -> Option<Rgb> {
    let color = Rgb::from_array(source.color.unwrap_or([1.0; 3]).map(|v| v as f32));
    let scale = color * source.multiplier.unwrap_or(1.0) as f32;
    let fits = scale.is_finite() && scale.to_array().iter().all(|v| *v >= 0.0);
    if !fits {
        warnings.push(place, "the colour or multiplier of its light profile is negative or not finite; it is left out");
    }
    fits.then_some(scale)
}

/// Inner and outer half-angle [rad], with 0 <= inner <= outer and 0 < outer <= pi/2.
fn cone(spot: Option<&schema::Spot>, place: &str, warnings: &mut Warnings) -> (f32, f32) {
    let angle = |v: Option<f64>, default: f32| v.map_or(default, |v| v as f32);
    let mut outer = angle(spot.and_then(|s| s.outer_cone_angle), FRAC_PI_4);
    let mut inner = angle(spot.and_then(|s| s.inner_cone_angle), 0.0);
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
    source: &schema::Camera,
    place: &str,
    warnings: &mut Warnings,
) -> Option<(Projection, Option<f32>)> {
    let positive = |v: Option<f64>| v.map(|v| v as f32).filter(|v| v.is_finite() && *v > 0.0);
    let converted = match (&source.perspective, &source.orthographic) {
        (Some(p), _) if source.kind.as_deref() != Some("orthographic") => positive(p.yfov)
            .filter(|fov| *fov < PI)
            .map(|vertical_fov| (Projection::Perspective { vertical_fov }, positive(p.aspect_ratio))),
        (_, Some(o)) => {
            // Negative magnifications are used by some exporters for what a rotation should do.
            let size = |v: Option<f64>| positive(v.map(f64::abs));
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
