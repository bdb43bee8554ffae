//! Linear Rec. 709 RGB triples.

use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask};
use std::ops::{Add, AddAssign, Div, Index, Mul, MulAssign, Neg, Sub};

/// Three linear Rec. 709 channels, of one number or of lanes. The name of a value states its quantity (radiance,
/// reflectance, throughput).
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Rgb<F = f32> {
    /// Red.
    pub r: F,
    /// Green.
    pub g: F,
    /// Blue.
    pub b: F,
}

impl Rgb {
    /// All channels zero.
    pub const BLACK: Self = Self::splat(0.0);
    /// All channels one.
    pub const WHITE: Self = Self::splat(1.0);

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
}

impl<F: Copy> Rgb<F> {
    /// A triple from its channels.
    #[inline(always)]
    pub const fn new(r: F, g: F, b: F) -> Self {
        Self { r, g, b }
    }

    /// The same value in every channel.
    #[inline(always)]
    pub const fn splat(v: F) -> Self {
        Self { r: v, g: v, b: v }
    }

    /// From an array in the order red, green, blue.
    #[inline(always)]
    pub const fn from_array([r, g, b]: [F; 3]) -> Self {
        Self { r, g, b }
    }

    /// To an array in the order red, green, blue.
    #[inline(always)]
    pub const fn to_array(self) -> [F; 3] {
        [self.r, self.g, self.b]
    }
}

impl<F: Lanes> Rgb<F> {
    /// The same colour in all lanes.
    #[inline(always)]
    pub fn in_lanes(token: F::Token, c: Rgb) -> Self {
        Self::new(F::splat(token, c.r), F::splat(token, c.g), F::splat(token, c.b))
    }

    /// The colour of each lane.
    #[inline(always)]
    pub fn from_lanes(token: F::Token, lanes: &[Rgb; MAX_WIDTH]) -> Self {
        let [mut r, mut g, mut b] = [[0.0; MAX_WIDTH]; 3];
        for lane in 0..F::WIDTH {
            [r[lane], g[lane], b[lane]] = lanes[lane].to_array();
        }
        Self::new(F::load(token, &r), F::load(token, &g), F::load(token, &b))
    }

    /// The colours, one for each lane; black beyond the last lane.
    #[inline(always)]
    pub fn to_lanes(self) -> [Rgb; MAX_WIDTH] {
        let (r, g, b) = (self.r.to_array(), self.g.to_array(), self.b.to_array());
        let mut lanes = [Rgb::BLACK; MAX_WIDTH];
        for lane in 0..F::WIDTH {
            lanes[lane] = Rgb::new(r[lane], g[lane], b[lane]);
        }
        lanes
    }

    /// Relative luminance with the Rec. 709 weights (ITU-R BT.709).
    #[inline(always)]
    pub fn luminance(self) -> F {
        self.r * 0.2126 + self.g * 0.7152 + self.b * 0.0722
    }

    /// The largest channel.
    #[inline(always)]
    pub fn max_channel(self) -> F {
        self.r.max(self.g).max(self.b)
    }

    /// The mean of the channels.
    #[inline(always)]
    pub fn mean(self) -> F {
        (self.r + self.g + self.b) * (1.0 / 3.0)
    }

    /// `self * (1 - t) + other * t`.
    #[inline(always)]
    pub fn lerp(self, other: Self, t: F) -> Self {
        self * t.one_minus() + other * t
    }

    /// `yes` in the lanes that are true, `no` in the others.
    #[inline(always)]
    pub fn select(mask: F::Mask, yes: Self, no: Self) -> Self {
        Self::new(mask.select(yes.r, no.r), mask.select(yes.g, no.g), mask.select(yes.b, no.b))
    }

    /// The lanes in which some channel is not zero. A NaN is not zero.
    #[inline(always)]
    pub fn is_lit(self) -> F::Mask {
        let zero = self.r.constant(0.0);
        !(self.r.eq(zero) & self.g.eq(zero) & self.b.eq(zero))
    }

    /// The lanes in which every channel is finite.
    #[inline(always)]
    pub fn all_finite(self) -> F::Mask {
        self.r.is_finite() & self.g.is_finite() & self.b.is_finite()
    }
}

macro_rules! channelwise {
    ($trait:ident, $method:ident, $op:tt) => {
        impl<F: Lanes> $trait for Rgb<F> {
            type Output = Self;
            #[inline(always)]
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

impl<F: Lanes> Mul<F> for Rgb<F> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: F) -> Self {
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

impl<F: Lanes> Div<F> for Rgb<F> {
    type Output = Self;
    // One division for three channels.
    #[allow(clippy::suspicious_arithmetic_impl)]
    #[inline(always)]
    #[expect(clippy::suspicious_arithmetic_impl, reason = "one division instead of three")]
    fn div(self, s: F) -> Self {
        self * s.recip()
    }
}

impl<F: Lanes> Neg for Rgb<F> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { r: -self.r, g: -self.g, b: -self.b }
    }
}

impl<F: Lanes> AddAssign for Rgb<F> {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}

impl<F: Lanes> MulAssign for Rgb<F> {
    #[inline(always)]
    fn mul_assign(&mut self, o: Self) {
        *self = *self * o;
    }
}

impl<F: Lanes> MulAssign<F> for Rgb<F> {
    #[inline(always)]
    fn mul_assign(&mut self, s: F) {
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
