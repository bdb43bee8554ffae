//! An emitting mesh as one light: points are drawn uniformly over its area.
//!
//! The lamps of a job are such lights. A ring of a hundred triangles then takes one light sample of a vertex, not a
//! choice among a hundred lights.

use crate::light::sample::{LightSample, LightSampleContext, LightTarget};
use crate::light::tree::{EmissionCone, LightBounds};
use dunkelfeld_geometry::shape::sample_triangle_area;
use dunkelfeld_geometry::{Aabb, Vec3};
use dunkelfeld_radiometry::Rgb;
use std::f32::consts::{FRAC_PI_2, PI};

/// The light of one emitting mesh, in render space.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct MeshLight {
    triangles: Vec<[Vec3; 3]>,
    /// Unit normals of the emitting side.
    normals: Vec<Vec3>,
    /// Share of the area of all triangles up to each one, itself included. Ends with 1.
    cumulative: Vec<f32>,
    area: f32,
    /// Centre of the bounding box, and the radius around it.
    center: Vec3,
    radius: f32,
    /// The cone of the normals: axis and half-angle \[rad\].
    axis: Vec3,
    spread: f32,
    two_sided: bool,
    /// The part that emits.
    pub(crate) part: u32,
    /// Radiance of a Lambertian mesh of the same power [W/(m^2 sr)].
    mean_radiance: Rgb,
    has_varying_radiance: bool,
}

impl MeshLight {
    /// The light of triangles in render space, each with the unit normal of its front. `None` if they have no area.
    pub(crate) fn new(
        triangles: Vec<[Vec3; 3]>,
        normals: Vec<Vec3>,
        two_sided: bool,
        part: u32,
        mean_radiance: Rgb,
        has_varying_radiance: bool,
    ) -> Option<Self> {
        let area_of =
            |[a, b, c]: &[Vec3; 3]| 0.5 * (b.as_dvec3() - a.as_dvec3()).cross(c.as_dvec3() - a.as_dvec3()).length();
        let areas: Vec<f64> = triangles.iter().map(area_of).collect();
        let total: f64 = areas.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let mut sum = 0.0;
        let mut cumulative: Vec<f32> = areas
            .iter()
            .map(|a| {
                sum += a;
                (sum / total) as f32
            })
            .collect();
        if let Some(last) = cumulative.last_mut() {
            *last = 1.0;
        }
        let bounds = Aabb::from_points(triangles.iter().flatten().copied());
        let center = 0.5 * (bounds.min + bounds.max);
        let radius = triangles.iter().flatten().map(|p| p.distance(center)).fold(0.0, f32::max);
        let mean_normal =
            normals.iter().zip(&areas).map(|(n, a)| n.as_dvec3() * *a).sum::<dunkelfeld_geometry::DVec3>();
        // Without a mean direction, as for a sphere, the cone contains all directions.
        let (axis, spread) = match (mean_normal / total).as_vec3().try_normalize() {
            Some(axis) if mean_normal.length() > 1e-3 * total => {
                let cosine = normals.iter().map(|n| n.dot(axis)).fold(1.0, f32::min);
                // Slightly wider than needed, so that rounding excludes no triangle.
                (axis, (cosine.clamp(-1.0, 1.0).acos() * (1.0 + 1e-5) + 1e-3).min(PI))
            }
            _ => (Vec3::Z, PI),
        };
        let area = total as f32;
        Some(Self {
            triangles,
            normals,
            cumulative,
            area,
            center,
            radius,
            axis,
            spread,
            two_sided,
            part,
            mean_radiance,
            has_varying_radiance,
        })
    }

    /// True if light of this emitter can arrive: the receiver is in front of some triangle's plane as far as the bounds
    /// can exclude it, and some part of the light is above the surface.
    #[inline]
    fn reaches(&self, receiver: &LightSampleContext) -> bool {
        let to_light = self.center - receiver.point;
        if !receiver.both_sides && to_light.dot(receiver.normal) <= -self.radius {
            return false;
        }
        let distance = to_light.length();
        if self.two_sided || self.spread >= FRAC_PI_2 || distance <= self.radius {
            return true;
        }
        // The direction to the receiver, from any point of the light, deviates by at most the angle that the light
        // subtends.
        let subtended = (self.radius / distance).min(1.0).asin();
        let limit = (FRAC_PI_2 + self.spread + subtended).min(PI);
        -to_light.dot(self.axis) >= distance * limit.cos()
    }

    /// An estimate, up to a constant, of the irradiance that the light can send to the receiver; zero if it can send
    /// none.
    pub(crate) fn weight(&self, receiver: &LightSampleContext) -> f32 {
        if !self.reaches(receiver) {
            return 0.0;
        }
        let d2 = self.center.distance_squared(receiver.point);
        self.mean_radiance.mean() * self.area / (d2 + 0.5 * self.radius * self.radius)
    }

    /// A direction toward a point of the light. `probability` is that of the choice of this light.
    pub(crate) fn sample(&self, receiver: &LightSampleContext, probability: f32, u: [f32; 2]) -> Option<LightSample> {
        if !self.reaches(receiver) {
            return None;
        }
        let index = self.cumulative.partition_point(|c| *c <= u[0]).min(self.triangles.len() - 1);
        let before = if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        let share = self.cumulative[index] - before;
        // The number that is left after the choice is uniform again.
        let v = if share > 0.0 { ((u[0] - before) / share).clamp(0.0, 1.0 - f32::EPSILON) } else { 0.5 };
        let ([a, b, c], normal) = (self.triangles[index], self.normals[index]);
        let [b1, b2] = sample_triangle_area([v, u[1]]);
        let point = a + b1 * (b - a) + b2 * (c - a);
        let to_light = point - receiver.point;
        let distance = to_light.length();
        let direction = to_light / distance;
        let pdf = self.pdf_of(distance * distance, direction.dot(normal)) * probability;
        if !(pdf > 0.0 && pdf.is_finite()) {
            return None;
        }
        let surface = self.has_varying_radiance.then_some((self.part, index as u32));
        let target = LightTarget { point, normal, surface };
        Some(LightSample { direction, target: Some(target), radiance: self.mean_radiance, pdf, is_delta: false })
    }

    /// The density [1/sr] of a point on a triangle in [`Self::sample`], without the choice of the light.
    pub(crate) fn pdf(&self, receiver: &LightSampleContext, point: Vec3, normal: Vec3) -> f32 {
        if !self.reaches(receiver) {
            return 0.0;
        }
        let to_light = point - receiver.point;
        let d2 = to_light.length_squared();
        self.pdf_of(d2, to_light.dot(normal) / d2.sqrt())
    }

    /// Area density to solid angle. `cosine` is that between the direction to the light and the normal of its front.
    #[inline]
    fn pdf_of(&self, distance_squared: f32, cosine: f32) -> f32 {
        let cosine = if self.two_sided { cosine.abs() } else { -cosine };
        if cosine > 0.0 { distance_squared / (cosine * self.area) } else { 0.0 }
    }

    /// Emitted power \[W\].
    pub(crate) fn power(&self) -> Rgb {
        self.mean_radiance * (PI * self.area * if self.two_sided { 2.0 } else { 1.0 })
    }

    pub(crate) fn bounds(&self) -> LightBounds {
        let cone =
            EmissionCone { axis: self.axis, spread: self.spread, emission: FRAC_PI_2, two_sided: self.two_sided };
        let bounds = Aabb::from_points(self.triangles.iter().flatten().copied());
        LightBounds { bounds, cone, peak: self.mean_radiance.mean() * self.area }
    }

    /// Number of triangles.
    pub(crate) fn len(&self) -> usize {
        self.triangles.len()
    }
}
