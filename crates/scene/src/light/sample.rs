//! A light sample: its receiver, its direction, and the point on the light.

use dunkelfeld_geometry::Vec3;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_radiometry::Rgb;

/// The receiver of a light sample.
#[derive(Clone, Copy, Debug)]
pub struct LightSampleContext {
    /// Position in render space.
    pub point: Vec3,
    /// Geometric normal on the side of the viewer; zero in a medium.
    pub normal: Vec3,
    /// True if light from behind the surface can be scattered too.
    pub both_sides: bool,
}

impl LightSampleContext {
    /// True if the receiver can scatter light from a direction to the viewer.
    #[inline]
    pub fn faces(&self, direction: Vec3) -> bool {
        self.both_sides || direction.dot(self.normal) > 0.0
    }
}

/// A direction toward a light, as next-event estimation needs it.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit direction toward the light.
    pub direction: Vec3,
    /// The point on the light, with the light's normal there; `None` for a light infinitely far away.
    pub target: Option<LightTarget>,
    /// Radiance that arrives unoccluded [W/(m^2 sr)]; for lights without extent the irradiance on a facing surface
    /// [W/m^2].
    pub radiance: Rgb,
    /// Density [1/sr]; for lights without extent the probability of the choice of the light.
    pub pdf: f32,
    /// True for a light without extent. Scattering cannot sample it, so its weight is 1.
    pub is_delta: bool,
}

/// The end of a shadow ray.
#[derive(Clone, Copy, Debug)]
pub struct LightTarget {
    /// Point on the light.
    pub point: Vec3,
    /// Unit normal of the light's surface; zero for points without a surface.
    pub normal: Vec3,
}

/// Receivers of light samples, one for each lane. See [`LightSampleContext`].
#[derive(Clone, Copy, Debug)]
pub struct Receivers<F: Lanes> {
    /// Positions in render space.
    pub point: V3<F>,
    /// Geometric normals on the side of the viewer; zero in a medium.
    pub normal: V3<F>,
    /// Lanes in which light from behind the surface can be scattered too.
    pub both_sides: F::Mask,
}

impl From<&LightSampleContext> for Receivers<f32> {
    #[inline(always)]
    fn from(receiver: &LightSampleContext) -> Self {
        Self { point: receiver.point.into(), normal: receiver.normal.into(), both_sides: receiver.both_sides }
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
    pub(crate) fn to_lanes(self) -> [LightSampleContext; MAX_WIDTH] {
        let (points, normals, bits) = (self.point.to_lanes(), self.normal.to_lanes(), self.both_sides.bits());
        let mut lanes = [LightSampleContext { point: Vec3::ZERO, normal: Vec3::ZERO, both_sides: false }; MAX_WIDTH];
        for lane in 0..F::WIDTH {
            let both_sides = bits >> lane & 1 == 1;
            lanes[lane] = LightSampleContext { point: points[lane], normal: normals[lane], both_sides };
        }
        lanes
    }
}

/// Directions toward lights, one for each lane. See [`LightSample`]. Only lanes with a density above zero are valid.
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
    /// Lanes with a light without extent.
    pub is_delta: F::Mask,
}

impl<F: Lanes> LightSamples<F> {
    #[inline(always)]
    pub(crate) fn none(token: F::Token) -> Self {
        let (zero, no) = (F::splat(token, 0.0), F::mask(token, 0));
        let v = V3::new(zero, zero, zero);
        Self { direction: v, point: v, normal: v, is_finite: no, radiance: Rgb::splat(zero), pdf: zero, is_delta: no }
    }

    /// The sample of each lane.
    #[inline(always)]
    pub(crate) fn from_lanes(token: F::Token, lanes: &[Option<LightSample>; MAX_WIDTH]) -> Self {
        let [mut directions, mut points, mut normals] = [[Vec3::ZERO; MAX_WIDTH]; 3];
        let [mut r, mut g, mut b, mut pdf] = [[0.0; MAX_WIDTH]; 4];
        let (mut is_finite, mut is_delta) = (0, 0);
        for lane in 0..F::WIDTH {
            if let Some(s) = &lanes[lane] {
                (directions[lane], pdf[lane]) = (s.direction, s.pdf);
                [r[lane], g[lane], b[lane]] = s.radiance.to_array();
                is_delta |= u32::from(s.is_delta) << lane;
                if let Some(target) = &s.target {
                    (points[lane], normals[lane]) = (target.point, target.normal);
                    is_finite |= 1 << lane;
                }
            }
        }
        Self {
            direction: V3::from_lanes(token, &directions),
            point: V3::from_lanes(token, &points),
            normal: V3::from_lanes(token, &normals),
            is_finite: F::mask(token, is_finite),
            radiance: Rgb::new(F::load(token, &r), F::load(token, &g), F::load(token, &b)),
            pdf: F::load(token, &pdf),
            is_delta: F::mask(token, is_delta),
        }
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

impl LightSamples<f32> {
    /// The sample of the only lane.
    #[inline(always)]
    pub(crate) fn single(self) -> Option<LightSample> {
        let target = LightTarget { point: self.point.into(), normal: self.normal.into() };
        (self.pdf > 0.0).then_some(LightSample {
            direction: self.direction.into(),
            target: self.is_finite.then_some(target),
            radiance: self.radiance,
            pdf: self.pdf,
            is_delta: self.is_delta,
        })
    }
}
