//! `[[material]]` of a job: changes of the materials of a scene, and new ones.

use super::check;
use super::finish::{FinishSettings, GrainSettings, HeightSettings};
use crate::error::InputError;
use crate::toml_file::TomlFile;
use crate::toml_keys::{TableKeys, keys_of};
use dunkelfeld_radiometry::Rgb;
use serde::Deserialize;

/// `[[material]]`: a given value replaces the factor of that name. Textures still multiply it.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialOverride {
    /// Name of the material, or a pattern with `*` (any characters) and `?` (any one).
    pub name: String,
    /// `true` makes a new material of this name: a grey dielectric before the other keys. Default false.
    #[serde(default)]
    pub new: bool,
    /// `false` removes all textures of the material first.
    pub textures: Option<bool>,
    /// Base colour, 0 to 1.
    #[serde(default, deserialize_with = "check::color")]
    pub base_color: Option<Rgb>,
    /// Coverage, 0 to 1.
    #[serde(default, deserialize_with = "check::unit")]
    pub alpha: Option<f32>,
    /// `"opaque"`, `"mask"` or `"blend"`.
    pub alpha_mode: Option<AlphaKind>,
    /// Threshold of `alpha_mode = "mask"`, 0 to 1. Default 0.5.
    #[serde(default, deserialize_with = "check::unit")]
    pub alpha_cutoff: Option<f32>,
    /// 0 dielectric to 1 metal.
    #[serde(default, deserialize_with = "check::unit")]
    pub metallic: Option<f32>,
    /// Perceptual roughness, 0 to 1.
    #[serde(default, deserialize_with = "check::unit")]
    pub roughness: Option<f32>,
    /// Scales the normal map.
    #[serde(default, deserialize_with = "check::factor")]
    pub normal_scale: Option<f32>,
    /// Emitted radiance [W/(m^2 sr)].
    #[serde(default, deserialize_with = "check::light")]
    pub emission: Option<Rgb>,
    /// Is the emission two-sided?
    pub double_sided: Option<bool>,
    /// Does it emit its base colour and scatter nothing?
    pub unlit: Option<bool>,
    /// Index of refraction, 1 to 10.
    #[serde(default, deserialize_with = "check::ior")]
    pub ior: Option<f32>,
    /// Dielectric reflection and transmission.
    #[serde(skip)]
    pub dielectric: DielectricChange,
    /// Content of a solid.
    #[serde(skip)]
    pub interior: InteriorChange,
    /// Coat, sheen and anisotropy.
    #[serde(skip)]
    pub layers: LayerChange,
}

/// Keys of `[[material]]` about the light that a dielectric reflects and transmits.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct DielectricChange {
    /// Strength of the dielectric reflection, 0 to 1.
    #[serde(deserialize_with = "check::unit")]
    pub specular: Option<f32>,
    /// Tint of the dielectric reflection.
    #[serde(deserialize_with = "check::color")]
    pub specular_color: Option<Rgb>,
    /// Share of the base colour's hue in the dielectric reflection, 0 to 1.
    #[serde(deserialize_with = "check::unit")]
    pub specular_tint: Option<f32>,
    /// Share of the non-metallic light that is transmitted, 0 to 1.
    #[serde(deserialize_with = "check::unit")]
    pub transmission: Option<f32>,
    /// Share of the diffuse light that leaves on the other side, 0 to 1.
    #[serde(deserialize_with = "check::unit")]
    pub diffuse_transmission: Option<f32>,
    /// Colour of that light.
    #[serde(deserialize_with = "check::color")]
    pub diffuse_transmission_color: Option<Rgb>,
}

/// Keys of `[[material]]` about the inside.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct InteriorChange {
    /// `true`: the closed boundary of a solid that refracts, absorbs and scatters; `false`: a thin sheet.
    pub solid: Option<bool>,
    /// Where solids touch or overlap, the one with the highest priority is used, and of equal ones the smaller solid.
    /// Default 0.
    #[serde(deserialize_with = "check::priority")]
    pub priority: Option<i32>,
    /// Colour of white light after `attenuation_distance` in the solid, each channel above 0.
    #[serde(deserialize_with = "check::positive_color")]
    pub attenuation_color: Option<Rgb>,
    /// Distance \[m\] for `attenuation_color`; written as `"2mm"`.
    #[serde(deserialize_with = "check::distance")]
    pub attenuation_distance: Option<f32>,
    /// The single-scattering albedo, 0 to 1: the part of this attenuation that is scattered. The rest is absorbed.
    #[serde(deserialize_with = "check::color")]
    pub scattering_albedo: Option<Rgb>,
    /// Absorption coefficient of the solid [1/m]. It replaces the one from the attenuation. Written as `"0.5/mm"`.
    #[serde(deserialize_with = "check::coefficient")]
    pub absorption: Option<Rgb>,
    /// Scattering coefficient of the solid [1/m]. It replaces the one from the attenuation. Written as `"0.5/mm"`.
    #[serde(deserialize_with = "check::coefficient")]
    pub scattering: Option<Rgb>,
    /// Mean cosine g of the deflection by scattering (Henyey and Greenstein), -0.9999 to 0.9999.
    #[serde(deserialize_with = "check::mean_cosine")]
    pub scattering_anisotropy: Option<f32>,
}

/// Keys of `[[material]]` about coat, sheen and anisotropy.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct LayerChange {
    /// Strength of a clear coat, 0 to 1.
    #[serde(deserialize_with = "check::unit")]
    pub clearcoat: Option<f32>,
    /// Roughness of the clear coat, 0 to 1.
    #[serde(deserialize_with = "check::unit")]
    pub clearcoat_roughness: Option<f32>,
    /// Sheen colour, 0 to 1.
    #[serde(deserialize_with = "check::color")]
    pub sheen_color: Option<Rgb>,
    /// Sheen roughness, 0 to 1.
    #[serde(deserialize_with = "check::unit")]
    pub sheen_roughness: Option<f32>,
    /// Anisotropy, -1 to 1; positive stretches highlights along the tangent.
    #[serde(deserialize_with = "check::signed_unit")]
    pub anisotropy: Option<f32>,
    /// Rotation of the anisotropy's axis \[rad\]; written as `"30deg"`.
    #[serde(deserialize_with = "check::angle")]
    pub anisotropy_rotation: Option<f32>,
    /// The direction of grooves, for the anisotropy and for `finish`.
    pub grain: Option<GrainSettings>,
    /// The height field of a machined surface.
    pub finish: Option<FinishSettings>,
    /// The height field of an image.
    pub height: Option<HeightSettings>,
}

/// `alpha_mode` of a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AlphaKind {
    /// Covers fully.
    Opaque,
    /// Covers where alpha reaches the cutoff.
    Mask,
    /// Covers stochastically.
    Blend,
}

/// The keys of `[[material]]`.
pub fn material_keys() -> Vec<&'static str> {
    [
        keys_of::<MaterialOverride>(),
        keys_of::<DielectricChange>(),
        keys_of::<InteriorChange>(),
        keys_of::<LayerChange>(),
    ]
    .concat()
}

impl MaterialOverride {
    /// Reads the entries of a job.
    pub(super) fn read_all(file: &TomlFile) -> Result<Vec<Self>, InputError> {
        let read = |mut keys: TableKeys<'_>| {
            let given = |list: &[&'static str]| list.iter().copied().find(|key| keys.has(key));
            let by_color = given(&["attenuation_color", "attenuation_distance", "scattering_albedo"]);
            let outright = given(&["absorption", "scattering"]);
            let (dielectric, interior, layers) = (keys.take(&[])?, keys.take(&[])?, keys.take(&[])?);
            let mut change = Self { dielectric, interior, layers, ..keys.rest()? };
            if let Some(height) = &mut change.layers.height {
                height.image = keys.file().resolve(&height.image);
                if change.layers.finish.is_some() {
                    return Err(keys.error("height", "`finish` and `height` exclude each other", "keep one of them"));
                }
            }
            if change.new && (change.name.is_empty() || change.name.contains(['*', '?'])) {
                let problem = "a new material cannot have a pattern as its name, or none";
                return Err(keys.error("name", problem, "write a name without `*` and `?`"));
            }
            if let (Some(first), Some(second)) = (by_color, outright) {
                let problem = format!("`{first}` and `{second}` both define the light inside the solid");
                let help = "describe the medium by `attenuation_color`, `attenuation_distance` and `scattering_albedo`, or by `absorption` and `scattering`";
                return Err(keys.error(second, problem, help));
            }
            if change.layers.grain.is_some_and(|grain| grain.grain().is_none()) {
                return Err(keys.error("grain", "a direction of no length", "write a direction such as [1, 0, 0]"));
            }
            Ok(change)
        };
        TableKeys::of_list(file, "material").into_iter().map(read).collect()
    }
}
