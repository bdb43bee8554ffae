//! Vectors of three numbers per lane.

use crate::{Double, Lanes, MAX_WIDTH, Mask, Real};
use glam::Vec3;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A vector per lane: three arrays of lanes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct V3<F> {
    /// First coordinate.
    pub x: F,
    /// Second coordinate.
    pub y: F,
    /// Third coordinate.
    pub z: F,
}

impl<F> V3<F> {
    /// From its coordinates.
    #[inline(always)]
    pub fn new(x: F, y: F, z: F) -> Self {
        Self { x, y, z }
    }
}

impl From<Vec3> for V3<f32> {
    #[inline(always)]
    fn from(v: Vec3) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

impl From<V3<f32>> for Vec3 {
    #[inline(always)]
    fn from(v: V3<f32>) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

impl<F: Lanes> V3<F> {
    /// The same vector in all lanes.
    #[inline(always)]
    pub fn splat(token: F::Token, v: Vec3) -> Self {
        Self::new(F::splat(token, v.x), F::splat(token, v.y), F::splat(token, v.z))
    }
    /// The vector of each lane.
    #[inline(always)]
    pub fn from_lanes(token: F::Token, lanes: &[Vec3; MAX_WIDTH]) -> Self {
        let [mut x, mut y, mut z] = [[0.0; MAX_WIDTH]; 3];
        for lane in 0..F::WIDTH {
            [x[lane], y[lane], z[lane]] = lanes[lane].to_array();
        }
        Self::new(F::load(token, &x), F::load(token, &y), F::load(token, &z))
    }
    /// The vectors, one for each lane; zero beyond the last lane.
    #[inline(always)]
    pub fn to_lanes(self) -> [Vec3; MAX_WIDTH] {
        let (x, y, z) = (self.x.to_array(), self.y.to_array(), self.z.to_array());
        let mut lanes = [Vec3::ZERO; MAX_WIDTH];
        for lane in 0..F::WIDTH {
            lanes[lane] = Vec3::new(x[lane], y[lane], z[lane]);
        }
        lanes
    }
    /// The record of each lane. A row of it is a vector and a further number.
    #[inline(always)]
    pub fn load_records<'a, const N: usize>(
        token: F::Token,
        record: impl Fn(usize) -> &'a [[f32; 4]; N],
    ) -> [(Self, F); N] {
        let zero = F::splat(token, 0.0);
        let mut rows = [(Self::new(zero, zero, zero), zero); N];
        for (k, row) in rows.iter_mut().enumerate() {
            let [x, y, z, w] = F::load_rows(
                token,
                #[inline(always)]
                |lane| &record(lane)[k],
            );
            *row = (Self::new(x, y, z), w);
        }
        rows
    }
    /// Calls `store` with the record of each lane of a mask, in ascending order: the inverse of [`Self::load_records`].
    #[inline(always)]
    pub fn store_records<const N: usize>(
        rows: [(Self, F); N],
        mask: F::Mask,
        mut store: impl FnMut(usize, [[f32; 4]; N]),
    ) {
        let mut of_lanes = [[[0.0; 4]; MAX_WIDTH]; N];
        for (of_lanes, (v, w)) in of_lanes.iter_mut().zip(rows) {
            *of_lanes = F::to_rows([v.x, v.y, v.z, w]);
        }
        mask.each(
            #[inline(always)]
            |lane| {
                let mut record = [[0.0; 4]; N];
                for (row, of_lanes) in record.iter_mut().zip(&of_lanes) {
                    *row = of_lanes[lane % MAX_WIDTH];
                }
                store(lane, record);
            },
        );
    }
    /// The same vector of double precision in all lanes.
    #[inline(always)]
    pub fn splat_double(token: F::Token, v: V3<f64>) -> V3<F::Double> {
        V3::new(Double::splat(token, v.x), Double::splat(token, v.y), Double::splat(token, v.z))
    }
    /// The vectors in double precision.
    #[inline(always)]
    pub fn widen(self) -> V3<F::Double> {
        V3::new(Double::widen(self.x), Double::widen(self.y), Double::widen(self.z))
    }
    /// The nearest vectors of single precision.
    #[inline(always)]
    pub fn narrow(v: V3<F::Double>) -> Self {
        Self::new(v.x.narrow(), v.y.narrow(), v.z.narrow())
    }
}

impl<F: Real> V3<F> {
    /// Dot product, summed in the order x, y, z.
    #[inline(always)]
    pub fn dot(self, o: Self) -> F {
        self.x * o.x + self.y * o.y + self.z * o.z
    }
    /// Cross product.
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        Self::new(self.y * o.z - self.z * o.y, self.z * o.x - self.x * o.z, self.x * o.y - self.y * o.x)
    }
    /// Absolute values of the coordinates.
    #[inline(always)]
    pub fn abs(self) -> Self {
        Self::new(self.x.abs(), self.y.abs(), self.z.abs())
    }
    /// The largest coordinate.
    #[inline(always)]
    pub fn max_element(self) -> F {
        self.x.max(self.y).max(self.z)
    }
    /// Square of the length.
    #[inline(always)]
    pub fn length_squared(self) -> F {
        self.dot(self)
    }
    /// Length.
    #[inline(always)]
    pub fn length(self) -> F {
        self.dot(self).sqrt()
    }
    /// The unit vector of the same direction. Not finite for a vector of length zero.
    #[inline(always)]
    pub fn normalize(self) -> Self {
        self * self.length().recip()
    }
    /// The unit vector of the same direction; `other` where the length is zero or not finite.
    #[inline(always)]
    pub fn normalize_or(self, other: Self) -> Self {
        let (unit, is_some) = self.try_normalize();
        Self::select(is_some, unit, other)
    }
    /// The unit vector of the same direction, and whether there is one: the length is neither zero nor not finite.
    #[inline(always)]
    pub fn try_normalize(self) -> (Self, F::Mask) {
        let inverse = self.length().recip();
        (self * inverse, inverse.is_positive() & inverse.is_finite())
    }
    /// `yes` in the lanes that are true, `no` in the others.
    #[inline(always)]
    pub fn select(mask: F::Mask, yes: Self, no: Self) -> Self {
        Self::new(mask.select(yes.x, no.x), mask.select(yes.y, no.y), mask.select(yes.z, no.z))
    }
}

impl<F: Real> Add for V3<F> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self::new(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}

impl<F: Real> Sub for V3<F> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self::new(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}

impl<F: Real> Mul<F> for V3<F> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: F) -> Self {
        Self::new(self.x * s, self.y * s, self.z * s)
    }
}

impl<F: Real> Div<F> for V3<F> {
    type Output = Self;
    #[inline(always)]
    fn div(self, s: F) -> Self {
        Self::new(self.x / s, self.y / s, self.z / s)
    }
}

impl<F: Real> Neg for V3<F> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::new(-self.x, -self.y, -self.z)
    }
}

impl<F: Real> AddAssign for V3<F> {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}
