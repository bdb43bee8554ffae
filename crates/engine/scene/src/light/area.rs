//! Area lights: emitting triangles and rectangles.

use crate::light::sample::{LightSamples, Receivers};
use crate::light::tree::{EmissionCone, LightBounds};
use dunkelfeld_geometry::shape::{RectangleLanes, RectangleSampler, TriangleLanes};
use dunkelfeld_geometry::{Aabb, Vec3};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, V3, vectorize};
use dunkelfeld_radiometry::Rgb;
use std::f32::consts::PI;

/// Shape of an area light in render space; planar, with unit normal on the emitting (front) side.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) enum AreaShape {
    /// Two triangles that form a rectangle.
    Rectangle(RectangleSampler),
    /// A single triangle.
    Triangle([Vec3; 3]),
}

/// One emitting triangle or rectangle.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) struct AreaLight {
    pub(crate) shape: AreaShape,
    /// Unit normal of the front.
    pub(crate) normal: Vec3,
    pub(crate) center: Vec3,
    /// Half the diameter: the light lies inside this distance from its centre.
    pub(crate) radius: f32,
    pub(crate) area: f32,
    pub(crate) two_sided: bool,
    /// The part it belongs to, and its one or two triangles (the second may be `u32::MAX`).
    pub(crate) part: u32,
    pub(crate) triangles: [u32; 2],
    /// Mean radiance over the surface [W/(m^2 sr)].
    pub(crate) mean_radiance: Rgb,
    /// See [`CompiledMaterial::has_varying_radiance`](crate::query::surface::CompiledMaterial).
    pub(crate) has_varying_radiance: bool,
}

/// Area lights, one for each lane.
#[derive(Clone, Copy, Debug)]
struct AreaLanes<F: Lanes> {
    normal: V3<F>,
    center: V3<F>,
    radius: F,
    two_sided: F::Mask,
    radiance: Rgb<F>,
}

impl<F: Lanes> AreaLanes<F> {
    /// The same light in all lanes.
    #[inline(always)]
    fn splat(token: F::Token, light: &AreaLight) -> Self {
        Self {
            normal: V3::splat(token, light.normal),
            center: V3::splat(token, light.center),
            radius: F::splat(token, light.radius),
            two_sided: F::mask(token, if light.two_sided { u32::MAX >> (32 - F::WIDTH) } else { 0 }),
            radiance: Rgb::in_lanes(token, light.mean_radiance),
        }
    }

    /// The light of each lane.
    #[inline(always)]
    fn gather(token: F::Token, lights: &[&AreaLight; MAX_WIDTH]) -> Self {
        let [mut normals, mut centers] = [[Vec3::ZERO; MAX_WIDTH]; 2];
        let (mut radii, mut radiance, mut two_sided) = ([0.0; MAX_WIDTH], [Rgb::BLACK; MAX_WIDTH], 0);
        for lane in 0..F::WIDTH {
            let light = lights[lane];
            (normals[lane], centers[lane]) = (light.normal, light.center);
            (radii[lane], radiance[lane]) = (light.radius, light.mean_radiance);
            two_sided |= u32::from(light.two_sided) << lane;
        }
        Self {
            normal: V3::from_lanes(token, &normals),
            center: V3::from_lanes(token, &centers),
            radius: F::load(token, &radii),
            two_sided: F::mask(token, two_sided),
            radiance: Rgb::from_lanes(token, &radiance),
        }
    }

    /// Lanes in which light of the emitter can arrive. It cannot behind a one-sided emitter, which is planar, or below a
    /// surface that scatters light from above only.
    #[inline(always)]
    fn reaches(&self, receivers: &Receivers<F>) -> F::Mask {
        let to_light = self.center - receivers.point;
        (self.two_sided | self.normal.dot(to_light).lt(self.radius.constant(0.0)))
            & (receivers.both_sides | to_light.dot(receivers.normal).gt(-self.radius))
    }

    /// Samples from points on the lights with their densities.
    #[inline(always)]
    fn samples(&self, receivers: &Receivers<F>, point: V3<F>, pdf: F, probability: F) -> LightSamples<F> {
        let to_light = point - receivers.point;
        let distance = to_light.length();
        let direction = to_light * distance.recip();
        let is_in_front = self.two_sided | direction.dot(self.normal).lt(pdf.constant(0.0));
        let pdf = pdf * probability;
        let is_valid =
            self.reaches(receivers) & is_in_front & distance.is_positive() & pdf.is_positive() & pdf.is_finite();
        LightSamples {
            direction,
            point,
            normal: self.normal,
            is_finite: is_valid,
            radiance: self.radiance,
            pdf: pdf.only(is_valid),
            is_delta: F::mask(pdf.token(), 0),
        }
    }
}

/// Samples of a rectangle for each lane.
#[inline(always)]
pub(crate) fn sample_rectangles<F: Lanes>(
    token: F::Token,
    receivers: &Receivers<F>,
    (lights, rectangles): (&[&AreaLight; MAX_WIDTH], [&RectangleSampler; MAX_WIDTH]),
    probability: F,
    u: [F; 2],
) -> LightSamples<F> {
    let s = RectangleLanes::gather(token, rectangles).sample(receivers.point, u);
    AreaLanes::gather(token, lights).samples(receivers, s.point, s.pdf, probability)
}

impl AreaLight {
    /// An estimate, up to a constant, of the irradiance that the light can send to the receivers; zero if it can send
    /// none. The cosine at the light is that of its centre plus a margin, because the cosines at its ends differ.
    #[inline(always)]
    pub(crate) fn weight<F: Lanes>(&self, token: F::Token, receivers: &Receivers<F>) -> F {
        let light = AreaLanes::<F>::splat(token, self);
        let to_light = light.center - receivers.point;
        let d2 = to_light.length_squared();
        let d = d2.sqrt().max(d2.constant(f32::MIN_POSITIVE));
        let cosine_times_d = (light.normal.dot(to_light).abs() + d * 0.2).min(d);
        let (power, half_radius2) = (self.mean_radiance.mean() * self.area, 0.5 * self.radius * self.radius);
        (cosine_times_d * power / ((d2 + half_radius2) * d)).only(light.reaches(receivers))
    }

    /// Samples of this light.
    #[inline(always)]
    pub(crate) fn sample<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        probability: F,
        u: [F; 2],
    ) -> LightSamples<F> {
        let light = AreaLanes::splat(token, self);
        let (point, pdf) = match &self.shape {
            AreaShape::Rectangle(r) => {
                let s = RectangleLanes::splat(token, r).sample(receivers.point, u);
                (s.point, s.pdf)
            }
            AreaShape::Triangle(corners) => sample_triangles(token, corners, receivers.point, u),
        };
        light.samples(receivers, point, pdf, probability)
    }

    /// The densities [1/sr] of points in [`Self::sample`].
    #[inline(always)]
    pub(crate) fn pdf<F: Lanes>(&self, token: F::Token, receivers: &Receivers<F>, point: V3<F>) -> F {
        let pdf = match &self.shape {
            AreaShape::Rectangle(r) => RectangleLanes::splat(token, r).pdf(receivers.point, point),
            AreaShape::Triangle(t) => TriangleLanes::new(t, receivers.point).pdf(point),
        };
        pdf.only(AreaLanes::splat(token, self).reaches(receivers))
    }

    /// Emitted power \[W\]: a Lambertian emitter sends pi L per area and side.
    pub(crate) fn power(&self) -> Rgb {
        self.mean_radiance * (PI * self.area * if self.two_sided { 2.0 } else { 1.0 })
    }

    pub(crate) fn bounds(&self) -> LightBounds {
        let bounds = match &self.shape {
            AreaShape::Rectangle(r) => {
                let r = r.rectangle();
                Aabb::from_points([r.point(0.0, 0.0), r.point(1.0, 0.0), r.point(0.0, 1.0), r.point(1.0, 1.0)])
            }
            AreaShape::Triangle(t) => Aabb::from_points(*t),
        };
        let cone = EmissionCone::surface(self.normal, self.two_sided);
        LightBounds { bounds, cone, peak: self.mean_radiance.mean() * self.area }
    }
}

/// Points on a triangle with their densities [1/sr].
#[inline(never)]
fn sample_triangles<F: Lanes>(token: F::Token, corners: &[Vec3; 3], from: V3<F>, u: [F; 2]) -> (V3<F>, F) {
    vectorize!(F, token, {
        let (point, _, pdf) = TriangleLanes::new(corners, from).sample(u);
        (point, pdf)
    })
}
