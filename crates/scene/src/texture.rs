//! Images, and the textures that look into them.

use dunkelfeld_geometry::Vec2;

/// Index into [`SceneBuilder::images`](crate::SceneBuilder::images).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
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
    /// The texels.
    pub texels: Texels,
}

/// Texel storage.
#[derive(Clone, Debug, PartialEq)]
pub enum Texels {
    /// Four bytes a texel, red green blue alpha.
    Rgba8(Vec<[u8; 4]>),
    /// Four 16-bit values a texel.
    Rgba16(Vec<[u16; 4]>),
    /// Linear floating point, three channels (HDR, EXR).
    RgbF32(Vec<[f32; 3]>),
}

/// How stored colour values map to linear light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ColorEncoding {
    /// Values are linear (normal maps, roughness, HDR images).
    #[default]
    Linear,
    /// Red, green and blue are encoded with the sRGB transfer curve (IEC 61966-2-1); alpha is linear.
    Srgb,
}

/// What happens outside `[0, 1)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Wrap {
    /// Repeat the image.
    #[default]
    Repeat,
    /// Repeat it mirrored.
    Mirror,
    /// Hold the edge texel.
    Clamp,
}

/// How a value between texel centres is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Filter {
    /// Bilinear between the four nearest texel centres.
    #[default]
    Linear,
    /// The nearest texel.
    Nearest,
}

/// An affine map of texture coordinates (KHR_texture_transform): `uv' = offset + rotation * (scale * uv)`.
#[derive(Clone, Copy, Debug, PartialEq)]
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

/// One use of an image: which, with which coordinates, wrapped and filtered how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texture {
    /// The image.
    pub image: ImageId,
    /// How its values are encoded.
    pub encoding: ColorEncoding,
    /// Wrapping along u and v.
    pub wrap: [Wrap; 2],
    /// Filtering.
    pub filter: Filter,
    /// Texture coordinate set, 0 or 1.
    pub uv_set: u8,
    /// Map applied to the coordinates first.
    pub transform: TextureTransform,
}

impl Texture {
    /// A repeating, bilinear texture on coordinate set 0.
    pub fn new(image: ImageId, encoding: ColorEncoding) -> Self {
        Self {
            image,
            encoding,
            wrap: [Wrap::Repeat; 2],
            filter: Filter::Linear,
            uv_set: 0,
            transform: TextureTransform::default(),
        }
    }
}
