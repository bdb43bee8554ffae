//! Linear Rec. 709 RGB triples.

use std::ops::{Add, AddAssign, Div, Index, Mul, MulAssign, Neg, Sub};

/// Three linear Rec. 709 channels. The name of a value states its quantity (radiance, reflectance, throughput).
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Rgb {
    /// Red.
    pub r: f32,
    /// Green.
    pub g: f32,
    /// Blue.
    pub b: f32,
}

impl Rgb {
    /// All channels zero.
    pub const BLACK: Self = Self::splat(0.0);
    /// All channels one.
    pub const WHITE: Self = Self::splat(1.0);

    /// A triple from its channels.
    #[inline]
    pub const fn new(r: f32, g: f32, b: f32) -> Self {
        Self { r, g, b }
    }

    /// The same value in every channel.
    #[inline]
    pub const fn splat(v: f32) -> Self {
        Self { r: v, g: v, b: v }
    }

    /// From an array in the order red, green, blue.
    #[inline]
    pub const fn from_array([r, g, b]: [f32; 3]) -> Self {
        Self { r, g, b }
    }

    /// To an array in the order red, green, blue.
    #[inline]
    pub const fn to_array(self) -> [f32; 3] {
        [self.r, self.g, self.b]
    }

    /// Relative luminance with the Rec. 709 weights (ITU-R BT.709).
    #[inline]
    pub fn luminance(self) -> f32 {
        0.2126 * self.r + 0.7152 * self.g + 0.0722 * self.b
    }

    /// The largest channel.
    #[inline]
    pub fn max_channel(self) -> f32 {
        self.r.max(self.g).max(self.b)
    }

    /// The mean of the channels.
    #[inline]
    pub fn mean(self) -> f32 {
        (self.r + self.g + self.b) * (1.0 / 3.0)
    }

    /// True if every channel is exactly zero.
    #[inline]
    pub fn is_black(self) -> bool {
        self.r == 0.0 && self.g == 0.0 && self.b == 0.0
    }

    /// True if every channel is finite.
    #[inline]
    pub fn is_finite(self) -> bool {
        self.r.is_finite() && self.g.is_finite() && self.b.is_finite()
    }

    /// Applies `f` to each channel.
    #[inline]
    pub fn map(self, f: impl Fn(f32) -> f32) -> Self {
        Self { r: f(self.r), g: f(self.g), b: f(self.b) }
    }

    /// `self * (1 - t) + other * t`.
    #[inline]
    pub fn lerp(self, other: Self, t: f32) -> Self {
        self * (1.0 - t) + other * t
    }
}

macro_rules! channelwise {
    ($trait:ident, $method:ident, $op:tt) => {
        impl $trait for Rgb {
            type Output = Self;
            #[inline]
            fn $method(self, o: Self) -> Self {
                Self { r: self.r $op o.r, g: self.g $op o.g, b: self.b $op o.b }
            }
        }
    };
}
channelwise!(Add, add, +);
channelwise!(Sub, sub, -);
channelwise!(Mul, mul, *);
channelwise!(Div, div, /);

impl Mul<f32> for Rgb {
    type Output = Self;
    #[inline]
    fn mul(self, s: f32) -> Self {
        Self { r: self.r * s, g: self.g * s, b: self.b * s }
    }
}

impl Mul<Rgb> for f32 {
    type Output = Rgb;
    #[inline]
    fn mul(self, c: Rgb) -> Rgb {
        c * self
    }
}

impl Div<f32> for Rgb {
    type Output = Self;
    #[inline]
    fn div(self, s: f32) -> Self {
        self * (1.0 / s)
    }
}

impl Neg for Rgb {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self * -1.0
    }
}

impl AddAssign for Rgb {
    #[inline]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}

impl MulAssign for Rgb {
    #[inline]
    fn mul_assign(&mut self, o: Self) {
        *self = *self * o;
    }
}

impl MulAssign<f32> for Rgb {
    #[inline]
    fn mul_assign(&mut self, s: f32) {
        *self = *self * s;
    }
}

impl Index<usize> for Rgb {
    type Output = f32;
    /// Channel 0 is red, 1 green, 2 blue.
    ///
    /// # Panics
    /// If `channel` is above 2.
    #[inline]
    fn index(&self, channel: usize) -> &f32 {
        match channel {
            0 => &self.r,
            1 => &self.g,
            2 => &self.b,
            _ => panic!("an Rgb has channels 0, 1 and 2, not {channel}"),
        }
    }
}
