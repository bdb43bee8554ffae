//! Evaluation of textures: from coordinates to linear values.

use crate::material::Parameter;
use crate::material::texture::{
    Channel, ColorEncoding, Filter, Image, Texture, TextureTransform, Wrap, rgba, with_texels,
};
use crate::query::surface::TexturePoint;
use dunkelfeld_geometry::Vec2;
use dunkelfeld_lanes::{cos_sin_of_angle, pow};
use dunkelfeld_radiometry::Rgb;
use std::ops::Mul;
use std::sync::LazyLock;

/// sRGB byte to linear value (IEC 61966-2-1).
static SRGB_TO_LINEAR: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0)));

/// The sRGB transfer curve (IEC 61966-2-1), encoded to linear.
pub(crate) fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { pow((v + 0.055) / 1.055, 2.4) }
}

/// The linear value of a channel.
trait Linear: Channel {
    /// The linear value of a colour channel. Floating point is always linear.
    fn color(self, encoding: ColorEncoding) -> f32;
    /// The linear value of alpha.
    fn alpha(self) -> f32;
}

impl Linear for u8 {
    #[inline]
    fn color(self, encoding: ColorEncoding) -> f32 {
        match encoding {
            ColorEncoding::Srgb => SRGB_TO_LINEAR[usize::from(self)],
            ColorEncoding::Linear => self.alpha(),
        }
    }

    #[inline]
    fn alpha(self) -> f32 {
        f32::from(self) * (1.0 / 255.0)
    }
}

impl Linear for u16 {
    #[inline]
    fn color(self, encoding: ColorEncoding) -> f32 {
        match encoding {
            ColorEncoding::Srgb => srgb_to_linear(self.alpha()),
            ColorEncoding::Linear => self.alpha(),
        }
    }

    #[inline]
    fn alpha(self) -> f32 {
        f32::from(self) * (1.0 / 65535.0)
    }
}

impl Linear for f32 {
    #[inline]
    fn color(self, _: ColorEncoding) -> f32 {
        self
    }

    #[inline]
    fn alpha(self) -> f32 {
        self
    }
}

/// The linear value of a texel: red, green, blue, alpha.
#[inline]
fn linear<T: Linear, const N: usize>(texel: [T; N], encoding: ColorEncoding) -> [f32; 4] {
    let [r, g, b, a] = rgba(texel);
    [r.color(encoding), g.color(encoding), b.color(encoding), a.alpha()]
}

impl Image {
    /// The linear value of one texel: red, green, blue, alpha.
    fn texel(&self, x: u32, y: u32, encoding: ColorEncoding) -> [f32; 4] {
        let i = y as usize * self.width as usize + x as usize;
        with_texels!(&*self.texels, t => linear(t[i], encoding))
    }

    /// Mean linear value over all texels.
    fn mean(&self, encoding: ColorEncoding) -> [f32; 4] {
        let mut sum = [0f64; 4];
        for y in 0..self.height {
            for x in 0..self.width {
                for (s, v) in sum.iter_mut().zip(self.texel(x, y, encoding)) {
                    *s += f64::from(v);
                }
            }
        }
        let n = f64::from(self.width) * f64::from(self.height);
        sum.map(|s| (s / n) as f32)
    }

    /// Linear value at the given texel coordinates, nearest; used to tabulate an image.
    pub(crate) fn linear_texel(&self, x: u32, y: u32) -> [f32; 4] {
        self.texel(x.min(self.width - 1), y.min(self.height - 1), ColorEncoding::Linear)
    }
}

/// A value that a texture can multiply.
pub trait Texel: Copy + Mul<Output = Self> {
    /// The value of a texel: red, green, blue, alpha. A number is one channel of it.
    fn of(texel: [f32; 4], channel: u8) -> Self;
}

impl Texel for Rgb {
    #[inline]
    fn of([r, g, b, _]: [f32; 4], _: u8) -> Self {
        Self::new(r, g, b)
    }
}

impl Texel for f32 {
    #[inline]
    fn of(texel: [f32; 4], channel: u8) -> Self {
        texel[usize::from(channel & 3)]
    }
}

impl<T: Texel> Parameter<T> {
    /// The value at a place.
    #[inline]
    pub(crate) fn at(&self, images: &[Image], at: &TexturePoint) -> T {
        match &self.texture {
            None => self.factor,
            Some(t) => self.factor * T::of(at.eval(t, images), t.channel),
        }
    }

    /// The mean value over all texels.
    pub(crate) fn mean(&self, images: &[Image]) -> T {
        match &self.texture {
            None => self.factor,
            Some(t) => self.factor * T::of(t.mean(images), t.channel),
        }
    }
}

impl Texture {
    /// Mean linear value over all texels; white if there is no such image.
    pub(crate) fn mean(&self, images: &[Image]) -> [f32; 4] {
        images.get(self.image.0 as usize).map_or([1.0; 4], |image| image.mean(self.encoding))
    }

    /// The linear value (red, green, blue, alpha) at texture coordinates `uv`. Coordinates count as zero if they are
    /// not finite, also after the conversion to texels.
    pub(crate) fn eval(&self, images: &[Image], uv: Vec2) -> [f32; 4] {
        let image = &images[self.image.0 as usize];
        let Vec2 { x, y } = in_texels(image, self.transform.apply(uv));
        // The format is decided once for each evaluation. The code below is compiled for each format.
        with_texels!(&*image.texels, t => self.filtered(t, [image.width, image.height], [x, y]))
    }

    /// The change of the linear value of the channel per texture coordinate, after the transform, of the uniform cubic B-spline
    /// over the texels: it has no steps (Sigg and Hadwiger 2005). Coordinates as in [`Self::eval`].
    pub(crate) fn gradient(&self, images: &[Image], uv: Vec2) -> Vec2 {
        let image = &images[self.image.0 as usize];
        let (size, place) = ([image.width, image.height], (in_texels(image, uv) - 0.5).to_array());
        let [x, y] = place.map(|v| spline(v - v.floor()));
        let [columns, rows] =
            [0, 1].map(|k| OFFSETS.map(|offset| wrap(place[k].floor() + offset, size[k], self.wrap[k]) as usize));
        let mut sum = Vec2::ZERO;
        with_texels!(&*image.texels, t => for (j, row) in rows.into_iter().enumerate() {
            for (i, column) in columns.into_iter().enumerate() {
                let value = linear(t[row * image.width as usize + column], self.encoding)[usize::from(self.channel & 3)];
                sum += Vec2::new(x[i][1] * y[j][0], x[i][0] * y[j][1]) * value;
            }
        });
        sum * Vec2::new(image.width as f32, image.height as f32)
    }

    /// The linear value at coordinates counted in texels, which must be finite.
    #[inline]
    fn filtered<T: Linear, const N: usize>(&self, texels: &[[T; N]], size: [u32; 2], [x, y]: [f32; 2]) -> [f32; 4] {
        let [width, height] = size;
        let texel = |x: u32, y: u32| linear(texels[y as usize * width as usize + x as usize], self.encoding);
        match self.filter {
            Filter::Nearest => texel(wrap(x.floor(), width, self.wrap[0]), wrap(y.floor(), height, self.wrap[1])),
            Filter::Linear => {
                let (fx, fy) = (x - 0.5, y - 0.5);
                let (x0, y0) = (fx.floor(), fy.floor());
                let (ax, ay) = (fx - x0, fy - y0);
                let xs = [x0, x0 + 1.0].map(|v| wrap(v, width, self.wrap[0]));
                let ys = [y0, y0 + 1.0].map(|v| wrap(v, height, self.wrap[1]));
                let [a, b, c, d] = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| texel(xs[i], ys[j]));
                std::array::from_fn(|k| {
                    let top = a[k] + ax * (b[k] - a[k]);
                    let bottom = c[k] + ax * (d[k] - c[k]);
                    top + ay * (bottom - top)
                })
            }
        }
    }
}

impl TextureTransform {
    /// The coordinates on the image.
    #[inline]
    pub(crate) fn apply(&self, uv: Vec2) -> Vec2 {
        if *self == Self::default() {
            return uv;
        }
        let (cos, sin) = cos_sin_of_angle(self.rotation);
        let s = uv * self.scale;
        // KHR_texture_transform: the matrix [[cos, sin], [-sin, cos]] acts on (u, v), v pointing down.
        Vec2::new(cos * s.x + sin * s.y, cos * s.y - sin * s.x) + self.offset
    }
}

/// Texture coordinates in texels. Those near the limit of f32 overflow in the conversion, and become zero.
#[inline]
fn in_texels(image: &Image, uv: Vec2) -> Vec2 {
    let texels = uv * Vec2::new(image.width as f32, image.height as f32);
    if texels.is_finite() { texels } else { Vec2::ZERO }
}

/// The texels under a cubic B-spline, from the one below a place.
const OFFSETS: [f32; 4] = [-1.0, 0.0, 1.0, 2.0];

/// The weights of these texels in the value and in the derivative, at a place between 0 and 1.
fn spline(t: f32) -> [[f32; 2]; 4] {
    let (s, [t2, t3]) = (1.0 - t, [t * t, t * t * t]);
    [
        [s * s * s / 6.0, -0.5 * s * s],
        [0.5 * t3 - t2 + 2.0 / 3.0, 1.5 * t2 - 2.0 * t],
        [0.5 * (t + t2 - t3) + 1.0 / 6.0, 0.5 + t - 1.5 * t2],
        [t3 / 6.0, 0.5 * t2],
    ]
}

/// Folds an integral texel coordinate into `[0, size)`.
#[inline]
fn wrap(coordinate: f32, size: u32, mode: Wrap) -> u32 {
    let n = size as f32;
    let folded = match mode {
        Wrap::Clamp => coordinate,
        Wrap::Repeat => coordinate - (coordinate / n).floor() * n,
        Wrap::Mirror => {
            let m = coordinate - (coordinate / (2.0 * n)).floor() * 2.0 * n;
            if m >= n { 2.0 * n - 1.0 - m } else { m }
        }
    };
    // The cast from float to integer saturates. The minimum corrects the rounding of huge coordinates.
    (folded.max(0.0) as u32).min(size - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::texture::{ImageId, Texels};

    fn ramp() -> Vec<Image> {
        let texels = Texels::Rgba8(vec![[0, 10, 0, 255], [255, 20, 0, 255], [0, 30, 255, 0], [255, 40, 255, 0]]);
        vec![Image { name: "ramp".into(), width: 2, height: 2, texels: texels.into() }]
    }

    fn texture() -> Texture {
        Texture::new(ImageId(0), ColorEncoding::Linear)
    }

    #[test]
    fn texel_centres_are_exact_and_the_middle_is_the_mean() {
        let images = ramp();
        let t = texture();
        assert_eq!(t.eval(&images, Vec2::new(0.25, 0.25))[0], 0.0);
        assert_eq!(t.eval(&images, Vec2::new(0.75, 0.25))[0], 1.0);
        let middle = t.eval(&images, Vec2::new(0.5, 0.5));
        assert!((middle[0] - 0.5).abs() < 1e-6 && (middle[3] - 0.5).abs() < 1e-6);
        assert!((middle[1] - 25.0 / 255.0).abs() < 1e-6);
    }

    #[test]
    fn wrapping_modes_differ_outside_the_unit_square() {
        let images = ramp();
        let at = |wrap, u| {
            Texture { wrap: [wrap; 2], filter: Filter::Nearest, ..texture() }.eval(&images, Vec2::new(u, 0.1))[0]
        };
        assert_eq!([at(Wrap::Repeat, 1.1), at(Wrap::Clamp, 1.1), at(Wrap::Mirror, 1.1)], [0.0, 1.0, 1.0]);
        assert_eq!([at(Wrap::Repeat, -0.1), at(Wrap::Clamp, -0.1), at(Wrap::Mirror, -0.1)], [1.0, 0.0, 0.0]);
        for u in [f32::NAN, f32::INFINITY, 1e30, -1e30, f32::MAX, f32::MIN] {
            for wrap in [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror] {
                for filter in [Filter::Nearest, Filter::Linear] {
                    let t = Texture { wrap: [wrap; 2], filter, ..texture() };
                    let value = t.eval(&images, Vec2::new(u, 0.1));
                    assert!(value.iter().all(|v| (0.0..=1.0).contains(v)), "{value:?} at {u}, {wrap:?}, {filter:?}");
                }
            }
        }
    }
}
