//! A light sample: its receiver, its direction, and the point on the light.

use dunkelfeld_geometry::Vec3;
use dunkelfeld_lanes::{Lanes, V3};
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
    /// Part and triangle of the point, if the radiance must be evaluated there. `None` if the radiance is constant over
    /// the light, and for lights without a surface.
    pub(crate) surface: Option<(u32, u32)>,
}

impl LightTarget {
    /// A point on a light whose radiance is given.
    #[inline]
    pub fn new(point: Vec3, normal: Vec3) -> Self {
        Self { point, normal, surface: None }
    }
}

/// Receivers of light samples, one for each lane: the form of [`LightSampleContext`] in lanes.
#[derive(Clone, Copy, Debug)]
pub struct Receivers<F: Lanes> {
    /// Positions in render space.
    pub point: V3<F>,
    /// Geometric normals on the side of the viewer; zero in a medium.
    pub normal: V3<F>,
    /// Lanes that can scatter light from behind the surface too.
    pub both_sides: F::Mask,
}

/// Light samples, one for each lane: the form of [`LightSample`] in lanes.
#[derive(Clone, Copy, Debug)]
pub struct LightSamples<F: Lanes> {
    /// Unit directions toward the lights.
    pub direction: V3<F>,
    /// Points on the lights, in lanes with such a point.
    pub point: V3<F>,
    /// Unit normals of the lights there; zero for points without a surface.
    pub normal: V3<F>,
    /// Lanes whose light has a point. The other lights are infinitely far away.
    pub is_finite: F::Mask,
    /// See [`LightSample::radiance`].
    pub radiance: Rgb<F>,
    /// See [`LightSample::pdf`]; zero in lanes without a sample.
    pub pdf: F,
    /// Lanes with a light without extent.
    pub is_delta: F::Mask,
}
