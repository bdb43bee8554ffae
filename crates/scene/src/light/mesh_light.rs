//! An emitting mesh as one light.
//!
//! The lamps of a job are such lights. A ring of a hundred triangles then takes one light sample of a vertex, not a
//! sample of each of a hundred lights. A sample chooses a facet, which is a planar piece of the mesh such as an LED, by
//! an estimate of the irradiance that it sends to the receiver with its emission profile: among few facets one by one,
//! among many by a light tree. It then draws a point uniformly over the area of the facet. A fixed share of the samples
//! chooses the facet by area alone, so that the density is never small where a facet is underestimated, as behind a
//! refracting surface (defensive mixture, Hesterberg 1995).

use crate::light::emission_profile::EmissionProfile;
use crate::light::in_proportion;
use crate::light::sample::{LightSample, LightSampleContext, LightTarget};
use crate::light::tree::{EmissionCone, LightBounds, LightTree, below_one};
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
    facets: Vec<Facet>,
    /// The facet of each triangle.
    facet_of: Vec<u32>,
    /// Share of the area of its facet up to each triangle, itself included. Ends with 1 in each facet.
    cumulative: Vec<f32>,
    choice: FacetChoice,
    /// The profile of its emission.
    profile: EmissionProfile,
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

/// Neighbouring triangles in a plane.
#[derive(Clone, Copy, Debug, serde::Serialize)]
struct Facet {
    /// Index of its first triangle. Its triangles follow each other.
    first: u32,
    /// Index after its last triangle.
    end: u32,
    /// Share of the area of the mesh before it, and with it.
    before: f32,
    after: f32,
    /// Area [m^2].
    area: f32,
    /// Centre of its bounding box, and the normal of its emitting side.
    center: Vec3,
    normal: Vec3,
}

/// The choice of a facet for a receiver.
#[derive(Clone, Debug, serde::Serialize)]
enum FacetChoice {
    /// There is one facet.
    Single,
    /// All facets are weighted one by one.
    Weighted,
    /// A tree selects among many.
    Tree(Box<LightTree>),
}

/// Most facets that are weighted one by one.
const MAX_WEIGHTED_FACETS: usize = 128;

/// Least cosine at the receiver in a weight: the cosine at the centre of a facet may be below that at other points.
const MIN_COSINE: f32 = 0.05;

impl Facet {
    fn triangles(&self) -> std::ops::Range<usize> {
        self.first as usize..self.end as usize
    }

    /// An estimate, up to a constant, of the irradiance from this facet at the receiver.
    #[inline]
    fn weight(&self, receiver: &LightSampleContext, profile: &EmissionProfile, two_sided: bool) -> f32 {
        let to_light = self.center - receiver.point;
        let d2 = to_light.length_squared().max(f32::MIN_POSITIVE);
        let inverse = 1.0 / d2.sqrt();
        let emitted = -to_light.dot(self.normal) * inverse;
        let emitted = if two_sided { emitted.abs() } else { emitted };
        let received = to_light.dot(receiver.normal) * inverse;
        let received = match receiver.normal == Vec3::ZERO {
            true => 1.0,
            false if receiver.both_sides => received.abs(),
            false => received,
        };
        if emitted <= 0.0 || received < -MIN_COSINE {
            return 0.0;
        }
        self.area * emitted * profile.estimate(emitted) * received.max(MIN_COSINE) * inverse * inverse
    }
}

/// Share of the samples that choose a facet by area.
const AREA_SHARE: f32 = 0.25;

/// Cosine between the normals of two triangles of a facet, at least.
const SAME_NORMAL: f32 = 1.0 - 1e-5;

impl MeshLight {
    /// The light of triangles in render space, each with the unit normal of its front. `None` if they have no area.
    pub(crate) fn new(
        triangles: Vec<[Vec3; 3]>,
        normals: Vec<Vec3>,
        two_sided: bool,
        part: u32,
        mean_radiance: Rgb,
        profile: EmissionProfile,
        has_varying_radiance: bool,
    ) -> Option<Self> {
        let area_of =
            |[a, b, c]: &[Vec3; 3]| 0.5 * (b.as_dvec3() - a.as_dvec3()).cross(c.as_dvec3() - a.as_dvec3()).length();
        let areas: Vec<f64> = triangles.iter().map(area_of).collect();
        let total: f64 = areas.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
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
        let (facets, cumulative) = facets(&triangles, &normals, &areas);
        let ranges = facets.iter().enumerate().flat_map(|(i, f)| (f.first..f.end).map(move |_| i as u32));
        let facet_of = ranges.collect();
        let choice = match facets.len() {
            0 | 1 => FacetChoice::Single,
            2..=MAX_WEIGHTED_FACETS => FacetChoice::Weighted,
            _ => {
                let bounds = facets.iter().map(|f| {
                    let surface = EmissionCone::surface(f.normal, two_sided);
                    Some(LightBounds {
                        bounds: Aabb::from_points(triangles[f.triangles()].iter().flatten().copied()),
                        cone: EmissionCone { emission: profile.cutoff_angle(), ..surface },
                        peak: f.after - f.before,
                    })
                });
                let tree = LightTree::new(&bounds.collect::<Vec<_>>(), &vec![1.0; facets.len()]);
                FacetChoice::Tree(Box::new(tree.with_profile(profile)))
            }
        };
        Some(Self {
            triangles,
            normals,
            facets,
            facet_of,
            cumulative,
            choice,
            profile,
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
        let (facet, u) = self.choose_facet(receiver, u[0]).map(|(facet, rest)| (facet, [rest, u[1]]))?;
        let cumulative = &self.cumulative[self.facets[facet].triangles()];
        let in_facet = cumulative.partition_point(|c| *c <= u[0]).min(cumulative.len() - 1);
        let start = if in_facet == 0 { 0.0 } else { cumulative[in_facet - 1] };
        let share = cumulative[in_facet] - start;
        // The number that is left after the choices is uniform again.
        let v = if share > 0.0 { ((u[0] - start) / share).clamp(0.0, 1.0 - f32::EPSILON) } else { 0.5 };
        let index = self.facets[facet].first as usize + in_facet;
        let ([a, b, c], normal) = (self.triangles[index], self.normals[index]);
        let [b1, b2] = sample_triangle_area([v, u[1]]);
        let point = a + b1 * (b - a) + b2 * (c - a);
        let to_light = point - receiver.point;
        let distance = to_light.length();
        let direction = to_light / distance;
        let density = self.facet_density(receiver, facet);
        let pdf = self.pdf_of(density, distance * distance, direction.dot(normal)) * probability;
        if !(pdf > 0.0 && pdf.is_finite()) {
            return None;
        }
        let surface = self.has_varying_radiance.then_some((self.part, index as u32));
        let target = LightTarget { point, normal, surface };
        Some(LightSample { direction, target: Some(target), radiance: self.mean_radiance, pdf, is_delta: false })
    }

    /// Chooses a facet. Returns its index and a number that is uniform in [0, 1) again.
    fn choose_facet(&self, receiver: &LightSampleContext, u: f32) -> Option<(usize, f32)> {
        if let FacetChoice::Single = self.choice {
            return Some((0, u));
        }
        if u < AREA_SHARE {
            let u = below_one(u / AREA_SHARE);
            let index = self.facets.partition_point(|f| f.after <= u).min(self.facets.len() - 1);
            let Facet { before, after, .. } = self.facets[index];
            return Some((index, below_one(((u - before) / (after - before)).max(0.0))));
        }
        let u = below_one((u - AREA_SHARE) / (1.0 - AREA_SHARE));
        match &self.choice {
            FacetChoice::Tree(tree) => tree.choose_with_rest(receiver, u),
            _ => self.choose_weighted(receiver, u),
        }
    }

    fn choose_weighted(&self, receiver: &LightSampleContext, u: f32) -> Option<(usize, f32)> {
        let mut weights = [0f32; MAX_WEIGHTED_FACETS];
        let mut total = 0.0;
        for (weight, facet) in weights.iter_mut().zip(&self.facets) {
            *weight = facet.weight(receiver, &self.profile, self.two_sided);
            total += *weight;
        }
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        in_proportion(&weights, total, u).map(|(index, rest)| (index, below_one((rest / weights[index]).max(0.0))))
    }

    /// The probability of a facet in the choice that is not by area.
    fn probability(&self, receiver: &LightSampleContext, facet: usize) -> f32 {
        match &self.choice {
            FacetChoice::Single => 1.0,
            FacetChoice::Tree(tree) => tree.probability(receiver, facet),
            FacetChoice::Weighted => {
                let mut total = 0.0;
                let mut own = 0.0;
                for (index, f) in self.facets.iter().enumerate() {
                    let weight = f.weight(receiver, &self.profile, self.two_sided);
                    total += weight;
                    if index == facet {
                        own = weight;
                    }
                }
                if total > 0.0 && total.is_finite() { own / total } else { 0.0 }
            }
        }
    }

    /// The density [1/m^2] of a point of a facet in [`Self::sample`].
    #[inline]
    fn facet_density(&self, receiver: &LightSampleContext, facet: usize) -> f32 {
        let Facet { before, after, area, .. } = self.facets[facet];
        let probability = match self.choice {
            FacetChoice::Single => 1.0,
            _ => AREA_SHARE * (after - before) + (1.0 - AREA_SHARE) * self.probability(receiver, facet),
        };
        probability / area
    }

    /// The density [1/sr] of a point on a triangle in [`Self::sample`], without the choice of the light.
    pub(crate) fn pdf(&self, receiver: &LightSampleContext, triangle: u32, point: Vec3, normal: Vec3) -> f32 {
        let Some(&facet) = self.facet_of.get(triangle as usize).filter(|_| self.reaches(receiver)) else { return 0.0 };
        let to_light = point - receiver.point;
        let d2 = to_light.length_squared();
        self.pdf_of(self.facet_density(receiver, facet as usize), d2, to_light.dot(normal) / d2.sqrt())
    }

    /// Area density to solid angle. `cosine` is that between the direction to the light and the normal of its front.
    #[inline]
    fn pdf_of(&self, density: f32, distance_squared: f32, cosine: f32) -> f32 {
        let cosine = if self.two_sided { cosine.abs() } else { -cosine };
        if cosine > 0.0 { density * distance_squared / cosine } else { 0.0 }
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

/// The facets of a mesh: runs of triangles in which each shares a corner and the normal with the one before. With them,
/// the share of the area of its facet up to each triangle.
fn facets(triangles: &[[Vec3; 3]], normals: &[Vec3], areas: &[f64]) -> (Vec<Facet>, Vec<f32>) {
    let mut facets: Vec<Facet> = Vec::new();
    for t in 0..triangles.len() {
        let continues = t > 0
            && normals[t].dot(normals[t - 1]) > SAME_NORMAL
            && triangles[t].iter().any(|p| triangles[t - 1].contains(p));
        match facets.last_mut().filter(|_| continues) {
            Some(facet) => facet.end = t as u32 + 1,
            None => {
                let (first, normal) = (t as u32, normals[t]);
                let center = Vec3::ZERO;
                facets.push(Facet { first, end: first + 1, before: 0.0, after: 1.0, area: 0.0, center, normal });
            }
        }
    }
    let total: f64 = areas.iter().sum();
    let mut cumulative = Vec::with_capacity(areas.len());
    let mut sum = 0.0;
    for facet in &mut facets {
        let bounds = Aabb::from_points(triangles[facet.triangles()].iter().flatten().copied());
        facet.center = 0.5 * (bounds.min + bounds.max);
        let own = &areas[facet.triangles()];
        let area: f64 = own.iter().sum();
        let mut so_far = 0.0;
        cumulative.extend(own.iter().map(|a| {
            so_far += a;
            if area > 0.0 { (so_far / area) as f32 } else { 1.0 }
        }));
        facet.area = area as f32;
        facet.before = (sum / total) as f32;
        sum += area;
        facet.after = (sum / total) as f32;
    }
    if let Some(last) = facets.last_mut() {
        last.after = 1.0;
    }
    (facets, cumulative)
}
