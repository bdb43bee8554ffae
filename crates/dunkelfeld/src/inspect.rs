//! The content of a scene, and its hazards.

use crate::memory::MemoryAccount;
use dunkelfeld_radiometry::photon::{lumens, luminous_efficacy};
use dunkelfeld_radiometry::{Nanometres, Rgb};
use dunkelfeld_scene::{
    AlphaMode, BuildReport, Camera, CoverStack, Effect, Effects, Opening, Projection, Scene, SceneSummary, Surface,
    Vignetting,
};
use serde::Serialize;

/// An object of the list.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ObjectEntry {
    /// Its name.
    pub name: String,
    /// Lowest and highest corner in world space \[m\]; `None` without triangles.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Its triangles.
    pub triangles: u64,
    /// Names of its materials, in the order of its parts.
    pub materials: Vec<String>,
}

/// A light of the list.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct LightEntry {
    /// Name of the object or light that emits.
    pub name: String,
    /// Its kind.
    pub kind: String,
    /// Emitted power \[W\], mean of the channels.
    pub watts: f64,
    /// Emitted luminous flux \[lm\], at 683 lm/W of the luminance-weighted power. Light of one wavelength counts with the
    /// luminous efficiency of the eye there.
    pub lumens: f64,
    /// Radiance [W/(m^2 sr)] per channel, where the light has a surface or is the environment.
    pub radiance: Option<[f32; 3]>,
    /// Lowest and highest corner in world space \[m\]; equal for a light without extent, `None` for light from
    /// infinitely far away.
    pub bounds: Option<[[f64; 3]; 2]>,
}

/// A material of the list.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct MaterialEntry {
    /// Its name.
    pub name: String,
    /// A short description of its main properties.
    pub description: String,
    /// Triangles with this material, over all instances.
    pub triangles: u64,
}

/// A camera of the list.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct CameraEntry {
    /// Its name.
    pub name: String,
    /// Description, as in `perspective, 30.0 degrees high, aperture 8.9 mm, sharp at 0.3 m` or `orthographic, 0.2 x 0.1
    /// m`.
    pub description: String,
    /// Position in world space \[m\].
    pub position: [f64; 3],
    /// Unit vector of the viewing direction in world space.
    pub direction: [f64; 3],
    /// Unit vector that is up in the image, in world space.
    pub up: [f64; 3],
}

/// A stack of clear covers of the list.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct CoverEntry {
    /// Unit vector in world space, normal to the layers.
    pub axis: [f64; 3],
    /// Are all faces planes, or are some curved?
    pub flat: bool,
    /// Its layers along the axis, the air between sheets included.
    pub layers: Vec<CoverLayerEntry>,
}

/// A layer of a stack of covers.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct CoverLayerEntry {
    /// Materials that fill it; none for air.
    pub materials: Vec<String>,
    /// Index of refraction.
    pub ior: f64,
    /// Mean thickness \[m\].
    pub thickness: f64,
}

/// An effect, and the cause of its use.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct EffectEntry {
    /// Its name, a value of `--without`.
    pub name: String,
    /// Does the scene need it?
    pub on: bool,
    /// The part of the scene that needs it.
    pub called_for_by: Vec<String>,
}

/// All data of `inspect`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Inspection {
    /// Number of objects.
    pub objects: usize,
    /// The objects.
    pub object_list: Vec<ObjectEntry>,
    /// Triangles over all instances and as stored.
    pub placed_triangles: u64,
    /// Triangles in memory.
    pub stored_triangles: u64,
    /// Parts that use the mesh of another part.
    pub instanced_parts: usize,
    /// Bytes of geometry, hierarchy and images.
    pub memory_bytes: u64,
    /// Bytes of images; part of the number above.
    pub texture_bytes: u64,
    /// The memory account of a render with the settings. `None` for a scene without settings.
    pub memory: Option<MemoryAccount>,
    /// Lowest and highest corner in world space \[m\].
    pub bounds: Option<[[f64; 3]; 2]>,
    /// The cameras.
    pub cameras: Vec<CameraEntry>,
    /// The lights.
    pub lights: Vec<LightEntry>,
    /// Number of lights, each emitting triangle or rectangle counted, and the method that selects among them.
    pub light_choice: String,
    /// Stacks of clear covers with connections to lights.
    pub covers: Vec<CoverEntry>,
    /// All effects, on or off.
    pub effects: Vec<EffectEntry>,
    /// The materials in use.
    pub materials: Vec<MaterialEntry>,
    /// Data that was repaired or left out during import.
    pub warnings: Vec<String>,
    /// Repairs made while building.
    pub notes: Vec<String>,
    /// Hazards: properties of the scene that can cause wrong images.
    pub hazards: Vec<String>,
    /// Settings whose default is seldom that of a real camera.
    pub hints: Vec<String>,
}

/// Lumens of a power \[W\] per channel. `lines` are the wavelengths of channels that carry light of one wavelength.
fn lumens_of(power: Rgb, lines: [Option<Nanometres>; 3]) -> f64 {
    let channels = power.to_array();
    let mut used = channels.iter().zip(lines).filter(|(watts, _)| **watts != 0.0);
    match (used.next(), used.next()) {
        (Some((_, Some(line))), None) => f64::from(power.mean()) * luminous_efficacy(line),
        _ => lumens(power),
    }
}

/// Lists a built scene.
pub fn inspect(scene: &Scene, report: &BuildReport) -> Inspection {
    inspect_lines(scene, report, [None; 3])
}

/// [`inspect`] of a scene whose channels have these wavelengths; `None`: none of their own.
pub(crate) fn inspect_lines(scene: &Scene, report: &BuildReport, lines: [Option<Nanometres>; 3]) -> Inspection {
    let summary = scene.summary();
    let SceneSummary { placed_triangles, stored_triangles, objects, instanced_parts, .. } = summary;
    let mut triangles = vec![0u64; scene.materials().len()];
    for part in scene.part_inventory() {
        triangles[part.material as usize] += part.triangles as u64;
    }
    let materials = scene
        .materials()
        .iter()
        .zip(triangles)
        .filter(|(_, n)| *n > 0)
        .map(|(m, triangles)| MaterialEntry { name: m.name.clone(), description: describe(m), triangles })
        .collect();
    let lights = scene
        .light_inventory()
        .into_iter()
        .map(|l| LightEntry {
            watts: f64::from(l.power.mean()),
            lumens: lumens_of(l.power, lines),
            radiance: l.radiance.map(|r| r.to_array()),
            bounds: l.bounds.map(|b| b.map(|corner| corner.to_array())),
            name: l.name,
            kind: l.kind,
        })
        .collect();
    let material_name = |m: u32| scene.materials().get(m as usize).map(|m| m.name.clone()).unwrap_or_default();
    let object_list = scene
        .object_inventory()
        .into_iter()
        .map(|o| ObjectEntry {
            bounds: o.bounds.map(|b| b.map(|corner| corner.to_array())),
            triangles: o.triangles,
            materials: o.materials.into_iter().map(material_name).collect(),
            name: o.name,
        })
        .collect();
    let (mut notes, mut hazards) = (Vec::new(), Vec::new());
    for f in &report.findings {
        let text = format!("{}: {}", f.place, f.message);
        match f.severity {
            dunkelfeld_scene::Severity::Note => notes.push(text),
            dunkelfeld_scene::Severity::Hazard => hazards.push(text),
        }
    }
    Inspection {
        objects,
        object_list,
        placed_triangles,
        stored_triangles,
        instanced_parts,
        memory_bytes: summary.memory_bytes,
        texture_bytes: summary.texture_bytes,
        memory: None,
        bounds: summary.bounds,
        cameras: scene.cameras().iter().map(camera_entry).collect(),
        lights,
        light_choice: scene.light_choice(),
        covers: scene.covers().iter().map(|stack| cover_entry(scene, stack)).collect(),
        effects: effect_entries(scene.effects()),
        materials,
        warnings: Vec::new(),
        notes,
        hazards,
        hints: Vec::new(),
    }
}

fn cover_entry(scene: &Scene, stack: &CoverStack) -> CoverEntry {
    let layers = stack.layers().iter().enumerate().filter(|(i, _)| stack.thickness(*i).is_finite());
    CoverEntry {
        axis: stack.axis().to_array(),
        flat: stack.is_flat(),
        layers: layers
            .map(|(i, layer)| CoverLayerEntry {
                materials: layer.materials.iter().map(|&m| scene.materials()[m as usize].name.clone()).collect(),
                ior: layer.ior,
                thickness: stack.thickness(i),
            })
            .collect(),
    }
}

fn effect_entries(effects: &Effects) -> Vec<EffectEntry> {
    Effect::ALL
        .into_iter()
        .map(|e| EffectEntry { name: e.name().into(), on: effects.has(e), called_for_by: effects.users(e).to_vec() })
        .collect()
}

impl Inspection {
    /// Records that a setting outside the scene needs an effect.
    pub(crate) fn add_effect(&mut self, effect: Effect, place: &str) {
        if let Some(entry) = self.effects.iter_mut().find(|e| e.name == effect.name()) {
            entry.on = true;
            if !entry.called_for_by.iter().any(|user| user == place) {
                entry.called_for_by.push(place.into());
            }
        }
    }
}

/// A short description of a camera: projection, aperture and focus, aberrations of the lens.
pub(crate) fn camera_entry(camera: &Camera) -> CameraEntry {
    let mut words = vec![match camera.projection {
        Projection::Perspective { vertical_fov } => {
            format!("perspective, {:.1} degrees high", vertical_fov.to_degrees())
        }
        Projection::Orthographic { half_width, half_height } => {
            format!("orthographic, {} x {} m", 2.0 * half_width, 2.0 * half_height)
        }
    }];
    let lens = &camera.lens;
    if let Some(aperture) = &lens.aperture {
        words.push(match aperture.opening {
            Opening::Radius(radius) => format!("aperture {:.3} mm", 2e3 * radius),
            Opening::NumericalAperture(sine) => format!("numerical aperture {sine:.4}"),
        });
        if let Some(blades) = aperture.blades {
            words.push(format!("{} blades", blades.count));
        }
        words.push(format!("sharp at {:.4} m", aperture.focus_distance));
    }
    for (on, name) in [
        (!lens.distortion.is_none(), "distorted"),
        (lens.principal_point != [0.0; 2], "axis off the middle"),
        (lens.vignetting != Vignetting::None, "vignetting"),
    ] {
        if on {
            words.push(name.into());
        }
    }
    let axes = camera.to_world.matrix3;
    CameraEntry {
        name: camera.name.clone(),
        description: words.join(", "),
        position: camera.to_world.translation.to_array(),
        direction: (-axes.z_axis).normalize_or_zero().to_array(),
        up: axes.y_axis.normalize_or_zero().to_array(),
    }
}

/// A short description of a material: its scattering first, then other properties.
fn describe(m: &dunkelfeld_scene::Material) -> String {
    if m.unlit {
        return "unlit".into();
    }
    let mut words = Vec::new();
    let transmits = m.transmission.factor > 0.0 && m.metallic.factor < 1.0;
    if m.emission.factor.is_black() || !m.base_color.factor.is_black() {
        let textured = |t: bool| if t { ", textured" } else { "" };
        let body = match (transmits, m.surface) {
            (true, Surface::Solid(v)) => {
                let medium = dunkelfeld_scene::Medium::new(&v);
                let inside = match (medium.absorption.is_black(), medium.scatters()) {
                    (true, false) => "",
                    (false, false) => ", absorbing",
                    (true, true) => ", scattering",
                    (false, true) => ", absorbing and scattering",
                };
                format!("clear solid, ior {}{inside}", m.ior)
            }
            (true, Surface::Thin) => format!("thin sheet, ior {}", m.ior),
            _ if m.metallic.factor >= 1.0 => "metal".into(),
            _ if m.diffuse_transmission.share.factor > 0.0 => "translucent".into(),
            _ if m.metallic.factor > 0.0 => "partly metal".into(),
            _ => "dielectric".into(),
        };
        let color = m.base_color.factor.to_array().map(|v| format!("{v:.3}")).join(" ");
        words.push(format!("{body}{}", textured(m.base_color.texture.is_some())));
        words.push(format!("base colour {color}"));
        words.push(format!("roughness {:.3}{}", m.roughness.factor, textured(m.roughness.texture.is_some())));
    }
    match m.alpha_mode {
        AlphaMode::Opaque | AlphaMode::FrontOnly => {}
        AlphaMode::Mask { cutoff } => words.push(format!("cut out at {cutoff}")),
        AlphaMode::Blend => words.push(format!("coverage {}", m.alpha.factor)),
    }
    for (on, name) in [
        (m.normal_map.texture.is_some(), "normal map"),
        (m.clearcoat.strength.factor > 0.0, "clear coat"),
        (!m.sheen.color.factor.is_black(), "sheen"),
        (m.anisotropy.strength.factor != 0.0, "anisotropic"),
    ] {
        if on {
            words.push(name.into());
        }
    }
    if !m.emission.factor.is_black() {
        words.push(format!(
            "emits {} W/(m^2 sr), {}",
            m.emission.factor.mean(),
            if m.double_sided { "both sides" } else { "front" }
        ));
    }
    words.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One watt in one channel: a third of the mean of a grey triple.
    #[test]
    fn lumens_of_one_wavelength_are_those_of_the_eye() {
        let red = Rgb::new(3.0, 0.0, 0.0);
        let at = |nm: f64, power: Rgb| lumens_of(power, [Some(Nanometres(nm)), None, None]);
        assert!((at(625.0, red) / (683.0 * 0.321) - 1.0).abs() < 0.03, "{}", at(625.0, red));
        assert_eq!(at(850.0, red), 0.0);
        // White light beside it, and red light without a wavelength.
        assert_eq!(at(850.0, Rgb::WHITE), lumens(Rgb::WHITE));
        assert_eq!(lumens_of(red, [None; 3]), lumens(red));
    }
}
