//! Images, and the textures that refer to them.

use dunkelfeld_geometry::Vec2;
use std::sync::Arc;

/// Index into [`SceneBuilder::images`](crate::SceneBuilder::images).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
pub struct ImageId(pub u32);

/// A decoded image: `width * height` texels, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Name for messages (usually the file's name).
    pub name: String,
    /// Width in texels, at least 1.
    pub width: u32,
    /// Height in texels, at least 1.
    pub height: u32,
    /// The texels. Copies of the image share them.
    pub texels: Arc<Texels>,
}

/// Texel storage: 1 (grey), 2 (grey, alpha), 3 (red, green, blue) or 4 channels (red, green, blue, alpha) of 8 or 16
/// bits, or grey or three channels of linear floating point (HDR, EXR).
///
/// An integer is divided by the largest value of its type. Grey is three equal channels. Alpha that is not stored is 1.
/// So images with equal values are equal, whatever channels they store.
#[derive(Clone, Debug, PartialEq)]
pub enum Texels {
    /// 8-bit grey.
    Gray8(Vec<[u8; 1]>),
    /// 8-bit grey and alpha.
    GrayAlpha8(Vec<[u8; 2]>),
    /// 8-bit red, green, blue.
    Rgb8(Vec<[u8; 3]>),
    /// 8-bit red, green, blue, alpha.
    Rgba8(Vec<[u8; 4]>),
    /// 16-bit grey.
    Gray16(Vec<[u16; 1]>),
    /// 16-bit grey and alpha.
    GrayAlpha16(Vec<[u16; 2]>),
    /// 16-bit red, green, blue.
    Rgb16(Vec<[u16; 3]>),
    /// 16-bit red, green, blue, alpha.
    Rgba16(Vec<[u16; 4]>),
    /// Linear floating-point grey.
    GrayF32(Vec<[f32; 1]>),
    /// Linear floating-point red, green, blue.
    RgbF32(Vec<[f32; 3]>),
}

/// The only list of the formats. Runs `$body` with `$t` bound to the vector of channel arrays of any format.
macro_rules! with_texels {
    ($texels:expr, $t:ident => $body:expr) => {
        match $texels {
            $crate::material::texture::Texels::Gray8($t) => $body,
            $crate::material::texture::Texels::GrayAlpha8($t) => $body,
            $crate::material::texture::Texels::Rgb8($t) => $body,
            $crate::material::texture::Texels::Rgba8($t) => $body,
            $crate::material::texture::Texels::Gray16($t) => $body,
            $crate::material::texture::Texels::GrayAlpha16($t) => $body,
            $crate::material::texture::Texels::Rgb16($t) => $body,
            $crate::material::texture::Texels::Rgba16($t) => $body,
            $crate::material::texture::Texels::GrayF32($t) => $body,
            $crate::material::texture::Texels::RgbF32($t) => $body,
        }
    };
}
pub(crate) use with_texels;

/// A value of one channel.
pub(crate) trait Channel: Copy {
    /// Little-endian bytes of the value.
    type Bytes: AsRef<[u8]>;
    /// Alpha of full coverage.
    const OPAQUE: Self;
    /// The value over the largest one of its type, by division. Floating point is unchanged.
    fn unit(self) -> f32;
    fn le_bytes(self) -> Self::Bytes;
}

impl Channel for u8 {
    type Bytes = [u8; 1];
    const OPAQUE: Self = Self::MAX;

    #[inline]
    fn unit(self) -> f32 {
        f32::from(self) / 255.0
    }

    fn le_bytes(self) -> [u8; 1] {
        [self]
    }
}

impl Channel for u16 {
    type Bytes = [u8; 2];
    const OPAQUE: Self = Self::MAX;

    #[inline]
    fn unit(self) -> f32 {
        f32::from(self) / 65535.0
    }

    fn le_bytes(self) -> [u8; 2] {
        self.to_le_bytes()
    }
}

impl Channel for f32 {
    type Bytes = [u8; 4];
    const OPAQUE: Self = 1.0;

    #[inline]
    fn unit(self) -> f32 {
        self
    }

    fn le_bytes(self) -> [u8; 4] {
        self.to_bits().to_le_bytes()
    }
}

/// Red, green, blue, alpha of a texel of 1 to 4 channels.
#[inline]
pub(crate) fn rgba<T: Channel, const N: usize>(texel: [T; N]) -> [T; 4] {
    match *texel.as_slice() {
        [v] => [v, v, v, T::OPAQUE],
        [v, a] => [v, v, v, a],
        [r, g, b] => [r, g, b, T::OPAQUE],
        [r, g, b, a, ..] => [r, g, b, a],
        [] => [T::OPAQUE; 4],
    }
}

impl Texels {
    /// Number of texels.
    pub fn len(&self) -> usize {
        with_texels!(self, t => t.len())
    }

    /// True if there are no texels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes of the texels.
    pub fn bytes(&self) -> usize {
        with_texels!(self, t => size_of_val(t.as_slice()))
    }

    /// Number of stored channels: 1 to 4.
    pub fn channels(&self) -> usize {
        fn count<T, const N: usize>(_: &[[T; N]]) -> usize {
            N
        }
        with_texels!(self, t => count(t))
    }

    /// Bytes of the value of a channel: 1, 2, or 4 for floating point.
    pub fn value_bytes(&self) -> usize {
        fn size<T, const N: usize>(_: &[[T; N]]) -> usize {
            size_of::<T>()
        }
        with_texels!(self, t => size(t))
    }

    /// True if the values are floating-point numbers, without bounds.
    pub fn is_float(&self) -> bool {
        matches!(self, Self::GrayF32(_) | Self::RgbF32(_))
    }

    /// Red, green, blue and alpha of texel `i` as stored (not decoded from sRGB), integers over their largest value; `None`
    /// beyond the last texel.
    pub fn get(&self, i: usize) -> Option<[f32; 4]> {
        with_texels!(self, t => t.get(i).map(|t| rgba(*t).map(Channel::unit)))
    }
}

/// Encoding of stored colour values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize)]
pub enum ColorEncoding {
    /// Values are linear (normal maps, roughness, HDR images).
    #[default]
    Linear,
    /// Red, green and blue are encoded with the sRGB transfer curve (IEC 61966-2-1); alpha is linear.
    Srgb,
}

/// Handling of texture coordinates outside `[0, 1)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize)]
pub enum Wrap {
    /// Repeat the image.
    #[default]
    Repeat,
    /// Repeat it mirrored.
    Mirror,
    /// Hold the edge texel.
    Clamp,
}

/// Interpolation between texel centres.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize)]
pub enum Filter {
    /// Bilinear between the four nearest texel centres.
    #[default]
    Linear,
    /// The nearest texel.
    Nearest,
}

/// An affine map of texture coordinates (KHR_texture_transform): `uv' = offset + rotation * (scale * uv)`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct TextureTransform {
    /// Added last.
    pub offset: Vec2,
    /// Counter-clockwise angle \[rad\] in the sense of KHR_texture_transform (v axis pointing down).
    pub rotation: f32,
    /// Applied first.
    pub scale: Vec2,
}

impl Default for TextureTransform {
    fn default() -> Self {
        Self { offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE }
    }
}

/// A reference to an image, with coordinates, wrapping and filter.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Texture {
    /// The image.
    pub image: ImageId,
    /// Encoding of the values.
    pub encoding: ColorEncoding,
    /// Wrapping along u and v.
    pub wrap: [Wrap; 2],
    /// Filtering.
    pub filter: Filter,
    /// Texture coordinate set, 0 or 1.
    pub uv_set: u8,
    /// Channel that a number is read from: 0 red, 1 green, 2 blue, 3 alpha. A colour is red, green and blue.
    pub channel: u8,
    /// Map applied to the coordinates first.
    pub transform: TextureTransform,
}

impl Texture {
    /// A repeating, bilinear texture on coordinate set 0, whose numbers are red.
    pub fn new(image: ImageId, encoding: ColorEncoding) -> Self {
        Self {
            image,
            encoding,
            wrap: [Wrap::Repeat; 2],
            filter: Filter::Linear,
            uv_set: 0,
            channel: 0,
            transform: TextureTransform::default(),
        }
    }
}
