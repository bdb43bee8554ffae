//! A light sample: its receiver, its direction, and the point on the light.

use dunkelfeld_geometry::Vec3;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_radiometry::Rgb;

/// Receivers of light samples, one for each lane.
#[derive(Clone, Copy, Debug)]
pub struct Receivers<F: Lanes> {
    /// Positions in render space.
    pub point: V3<F>,
    /// Geometric normals on the side of the viewer; zero in a medium.
    pub normal: V3<F>,
    /// Lanes in which light from behind the surface can be scattered too.
    pub both_sides: F::Mask,
}

impl Receivers<f32> {
    /// A single receiver.
    #[inline(always)]
    pub fn single(point: Vec3, normal: Vec3, both_sides: bool) -> Self {
        Self { point: point.into(), normal: normal.into(), both_sides }
    }
}

impl<F: Lanes> Receivers<F> {
    /// Lanes in which the receiver can scatter light from a direction to the viewer.
    #[inline(always)]
    pub fn faces(&self, direction: V3<F>) -> F::Mask {
        self.both_sides | direction.dot(self.normal).is_positive()
    }

    /// The receiver of each lane, for code that treats them one by one.
    #[inline(always)]
    pub fn to_lanes(self) -> [Receivers<f32>; MAX_WIDTH] {
        let (points, normals, bits) = (self.point.to_lanes(), self.normal.to_lanes(), self.both_sides.bits());
        let mut lanes = [Receivers::single(Vec3::ZERO, Vec3::ZERO, false); MAX_WIDTH];
        for lane in 0..F::WIDTH {
            lanes[lane] = Receivers::single(points[lane], normals[lane], bits >> lane & 1 == 1);
        }
        lanes
    }
}

/// Directions toward lights, as next-event estimation needs them, one for each lane. Only lanes with a density above zero
/// are valid.
#[derive(Clone, Copy, Debug)]
pub struct LightSamples<F: Lanes> {
    /// Unit directions toward the light.
    pub direction: V3<F>,
    /// Points on the light, if it is not infinitely far away.
    pub point: V3<F>,
    /// Unit normals of the light's surface; zero for points without a surface.
    pub normal: V3<F>,
    /// Lanes whose light has a point.
    pub is_finite: F::Mask,
    /// Radiance that arrives unoccluded [W/(m^2 sr)]; for lights without extent the irradiance on a facing surface
    /// [W/m^2].
    pub radiance: Rgb<F>,
    /// Density [1/sr]; for lights without extent the probability of the choice of the light. Zero if there is no sample.
    pub pdf: F,
    /// Lanes with a light without extent. Scattering cannot sample it, so its weight is 1.
    pub is_delta: F::Mask,
}

impl<F: Lanes> LightSamples<F> {
    #[inline(always)]
    pub(crate) fn none(token: F::Token) -> Self {
        let (zero, no) = (F::splat(token, 0.0), F::mask(token, 0));
        let v = V3::new(zero, zero, zero);
        Self { direction: v, point: v, normal: v, is_finite: no, radiance: Rgb::splat(zero), pdf: zero, is_delta: no }
    }

    /// `yes` in the lanes of the mask, `no` in the others.
    #[inline(always)]
    pub(crate) fn select(mask: F::Mask, yes: Self, no: Self) -> Self {
        Self {
            direction: V3::select(mask, yes.direction, no.direction),
            point: V3::select(mask, yes.point, no.point),
            normal: V3::select(mask, yes.normal, no.normal),
            is_finite: mask & yes.is_finite | !mask & no.is_finite,
            radiance: Rgb::select(mask, yes.radiance, no.radiance),
            pdf: mask.select(yes.pdf, no.pdf),
            is_delta: mask & yes.is_delta | !mask & no.is_delta,
        }
    }
}
