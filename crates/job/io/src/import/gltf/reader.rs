//! Reads the values of a glTF material and limits them to their ranges.

use super::texture::Textures;
use crate::import::warnings::Warnings;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{ColorEncoding, Texture};
use gltf::json::texture::Info;

/// Reads the values of one material and limits them to their ranges, with warnings.
pub(super) struct Reader<'r, 'a> {
    pub(super) place: String,
    pub(super) textures: &'r mut Textures<'a>,
    pub(super) warnings: &'r mut Warnings,
}

impl Reader<'_, '_> {
    pub(super) fn warn(&mut self, message: impl Into<String>) {
        self.warnings.push(&self.place, message);
    }

    pub(super) fn texture(&mut self, info: Option<&Info>, encoding: ColorEncoding) -> Option<Texture> {
        self.textures.resolve(info, encoding, &self.place, self.warnings)
    }

    /// A texture whose numbers are read from one channel (0 is red).
    pub(super) fn channel(&mut self, info: Option<&Info>, channel: u8) -> Option<Texture> {
        Some(Texture { channel, ..self.texture(info, ColorEncoding::Linear)? })
    }

    /// A factor in [0, 1].
    pub(super) fn unit(&mut self, name: &str, value: f32) -> f32 {
        self.within(name, value, 0.0, 1.0)
    }

    /// A factor in [low, high].
    pub(super) fn within(&mut self, name: &str, value: f32, low: f32, high: f32) -> f32 {
        let inside = value.clamp(low, high);
        if inside != value {
            self.warn(format!("{name} {value} is outside [{low}, {high}] and becomes {inside}"));
        }
        inside
    }

    /// A colour whose channels lie in [0, high].
    pub(super) fn color(&mut self, name: &str, value: [f32; 3], high: f32) -> Rgb {
        Rgb::from_array(value.map(|v| self.within(name, v, 0.0, high)))
    }
}
