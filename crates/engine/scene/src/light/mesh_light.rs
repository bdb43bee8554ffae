//! An emitting mesh as one light.
//!
//! The lamps of a job are such lights. A ring of a hundred triangles then takes one light sample of a vertex, not a
//! sample of each of a hundred lights. A sample chooses a facet, which is a planar piece of the mesh such as an LED, by
//! an estimate of the irradiance that it sends to the receiver with its emission profile: among few facets one by one,
//! among many by a light tree. It then draws a point uniformly over the area of the facet. A fixed share of the samples
//! chooses the facet by area alone, so that the density is never small where a facet is underestimated, as behind a
//! refracting surface (defensive mixture, Hesterberg 1995).

use crate::light::emission_profile::EmissionProfile;
use crate::light::sample::{LightSamples, Receivers};
use crate::light::tree::{EmissionCone, LightBounds, LightTree, below_one};
use crate::light::{in_proportion, share_of};
use dunkelfeld_geometry::shape::sample_triangle_area;
use dunkelfeld_geometry::{Aabb, Vec3};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
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
    sin_cos_spread: [f32; 2],
    two_sided: bool,
    /// The part that emits.
    pub(crate) part: u32,
    /// Radiance of a Lambertian mesh of the same power [W/(m^2 sr)].
    mean_radiance: Rgb,
    pub(crate) has_varying_radiance: bool,
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

    /// An estimate, up to a constant, of the irradiance from this facet at the receivers.
    #[inline(always)]
    fn weight<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        profile: &EmissionProfile,
        two_sided: bool,
    ) -> F {
        let to_light = V3::splat(token, self.center) - receivers.point;
        let d2 = to_light.length_squared().max(F::splat(token, f32::MIN_POSITIVE));
        let inverse = d2.sqrt().recip();
        let emitted = -to_light.dot(V3::splat(token, self.normal)) * inverse;
        let emitted = if two_sided { emitted.abs() } else { emitted };
        let received = to_light.dot(receivers.normal) * inverse;
        let received = receivers.both_sides.select(received.abs(), received);
        // In a medium there is no normal.
        let has_normal = receivers.normal.length_squared().is_positive();
        let received = has_normal.select(received, F::splat(token, 1.0));
        let is_lit = emitted.is_positive() & received.ge(F::splat(token, -MIN_COSINE));
        let facing = received.max(F::splat(token, MIN_COSINE));
        (emitted * self.area * profile.estimate(emitted) * facing * inverse * inverse).only(is_lit)
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
            sin_cos_spread: spread.sin_cos().into(),
            two_sided,
            part,
            mean_radiance,
            has_varying_radiance,
        })
    }

    /// Lanes in which light of this emitter can arrive: the receiver is in front of some triangle's plane as far as the
    /// bounds can exclude it, and some part of the light is above the surface.
    #[inline(always)]
    fn reaches<F: Lanes>(&self, token: F::Token, receivers: &Receivers<F>) -> F::Mask {
        let to_light = V3::splat(token, self.center) - receivers.point;
        let (zero, radius) = (F::splat(token, 0.0), F::splat(token, self.radius));
        let is_above = receivers.both_sides | !to_light.dot(receivers.normal).le(-radius);
        if self.two_sided || self.spread >= FRAC_PI_2 {
            return is_above;
        }
        // The direction to the receiver, from any point of the light, deviates by at most the angle that the light
        // subtends. So its angle to the axis is at most a right angle, the spread and this angle.
        let distance = to_light.length();
        let sin_ball = (radius / distance).min(F::splat(token, 1.0));
        let cos_ball = (sin_ball * sin_ball).one_minus().sqrt();
        let [sin, cos] = self.sin_cos_spread;
        let is_anywhere = distance.le(radius) | (cos_ball * cos - sin_ball * sin).le(zero);
        let along = -to_light.dot(V3::splat(token, self.axis));
        is_above & (is_anywhere | along.ge(-distance * (cos_ball * sin + sin_ball * cos)))
    }

    /// An estimate, up to a constant, of the irradiance that the light can send to the receivers; zero if it can send
    /// none.
    #[inline(always)]
    pub(crate) fn weight<F: Lanes>(&self, token: F::Token, receivers: &Receivers<F>) -> F {
        let d2 = (V3::splat(token, self.center) - receivers.point).length_squared();
        let power = F::splat(token, self.mean_radiance.mean() * self.area);
        (power / (d2 + 0.5 * self.radius * self.radius)).only(self.reaches(token, receivers))
    }

    /// Directions toward points of the light, and their parts and triangles. `probability` is that of the choice of this light.
    #[inline(always)]
    pub(crate) fn sample<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        probability: F,
        u: [F; 2],
        active: F::Mask,
    ) -> (LightSamples<F>, [[u32; 2]; MAX_WIDTH]) {
        let mut surfaces = [[0; 2]; MAX_WIDTH];
        let active = active & self.reaches(token, receivers);
        if !active.any() {
            return (LightSamples::none(token), surfaces);
        }
        let (facets, rest, densities) = self.choose_facets(token, receivers, u[0], active);
        // The triangle of the facet, by a search in a table for each lane.
        let (mut corners, mut normals) = ([[Vec3::ZERO; MAX_WIDTH]; 3], [Vec3::ZERO; MAX_WIDTH]);
        let mut v = rest.to_array();
        for lane in 0..F::WIDTH {
            let facet = &self.facets[(facets[lane] as usize).min(self.facets.len() - 1)];
            let cumulative = &self.cumulative[facet.triangles()];
            let in_facet = cumulative.partition_point(|c| *c <= v[lane]).min(cumulative.len() - 1);
            let start = if in_facet == 0 { 0.0 } else { cumulative[in_facet - 1] };
            let share = cumulative[in_facet] - start;
            // The number that is left after the choices is uniform again.
            v[lane] = if share > 0.0 { ((v[lane] - start) / share).clamp(0.0, 1.0 - f32::EPSILON) } else { 0.5 };
            let index = facet.first as usize + in_facet;
            [corners[0][lane], corners[1][lane], corners[2][lane]] = self.triangles[index];
            normals[lane] = self.normals[index];
            surfaces[lane] = [self.part, index as u32];
        }
        let [a, b, c] = [
            V3::from_lanes(token, &corners[0]),
            V3::from_lanes(token, &corners[1]),
            V3::from_lanes(token, &corners[2]),
        ];
        let normal = V3::from_lanes(token, &normals);
        let [b1, b2] = sample_triangle_area([F::load(token, &v), u[1]]);
        let point = a + (b - a) * b1 + (c - a) * b2;
        let to_light = point - receivers.point;
        let d2 = to_light.length_squared();
        let direction = to_light * d2.sqrt().recip();
        let pdf = self.pdf_of(densities, d2, direction.dot(normal)) * probability;
        let is_valid = active & pdf.is_positive() & pdf.is_finite();
        let samples = LightSamples {
            direction,
            point,
            normal,
            is_finite: is_valid,
            radiance: Rgb::in_lanes(token, self.mean_radiance),
            pdf: pdf.only(is_valid),
            is_delta: F::mask(token, 0),
        };
        (samples, surfaces)
    }

    /// Chooses a facet for each active lane. Returns its index, a number that is uniform in [0, 1) again, and the density
    /// [1/m^2] of a point of the facet; zero if there is none.
    #[inline(always)]
    fn choose_facets<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        u: F,
        active: F::Mask,
    ) -> ([u32; MAX_WIDTH], F, F) {
        if let FacetChoice::Single = self.choice {
            return ([0; MAX_WIDTH], u, F::splat(token, 1.0 / self.facets[0].area));
        }
        let by_area = u.lt(F::splat(token, AREA_SHARE));
        let of_area = below_one_lanes(u / AREA_SHARE);
        let of_choice = below_one_lanes((u - AREA_SHARE) / (1.0 - AREA_SHARE));
        let (mut facets, mut rest) = ([0; MAX_WIDTH], [0.0; MAX_WIDTH]);
        let mut exists = by_area & active;
        let numbers = of_area.to_array();
        for lane in exists.lanes() {
            let u = numbers[lane];
            let index = self.facets.partition_point(|f| f.after <= u).min(self.facets.len() - 1);
            let Facet { before, after, .. } = self.facets[index];
            (facets[lane], rest[lane]) = (index as u32, below_one(((u - before) / (after - before)).max(0.0)));
        }
        let probabilities = match &self.choice {
            FacetChoice::Tree(tree) => {
                let (each, numbers) = (receivers.to_lanes(), of_choice.to_array());
                let mut found = 0;
                for lane in (active & !by_area).lanes() {
                    if let Some((index, left)) = tree.choose_with_rest(&each[lane], numbers[lane]) {
                        (facets[lane], rest[lane]) = (index as u32, left);
                        found |= 1 << lane;
                    }
                }
                exists = exists | F::mask(token, found);
                tree.probabilities(token, &each, &facets, exists)
            }
            _ => {
                let mut weights = [F::splat(token, 0.0); MAX_WEIGHTED_FACETS];
                let mut total = F::splat(token, 0.0);
                for (weight, facet) in weights.iter_mut().zip(&self.facets) {
                    *weight = facet.weight(token, receivers, &self.profile, self.two_sided);
                    total += *weight;
                }
                let count = self.facets.len().min(MAX_WEIGHTED_FACETS);
                let chosen = in_proportion(token, &weights[..count], total, of_choice);
                let by_weight = active & !by_area & chosen.exists;
                let left = below_one_lanes(chosen.rest / chosen.weight);
                let (indices, left) = (F::word_to_array(chosen.index), left.to_array());
                let mut own = chosen.weight.to_array();
                for lane in exists.lanes() {
                    own[lane] = weights[facets[lane] as usize % MAX_WEIGHTED_FACETS].to_array()[lane];
                }
                for lane in by_weight.lanes() {
                    (facets[lane], rest[lane]) = (indices[lane], left[lane]);
                }
                exists = exists | by_weight;
                let has_weights = total.is_positive() & total.is_finite();
                (F::load(token, &own) / total).only(has_weights)
            }
        };
        (facets, F::load(token, &rest), self.density(token, &facets, probabilities).only(exists))
    }

    /// The densities [1/m^2] of points of facets, which have given probabilities in the choice that is not by area: of that
    /// choice and of the one by area.
    #[inline(always)]
    fn density<F: Lanes>(&self, token: F::Token, facets: &[u32; MAX_WIDTH], probabilities: F) -> F {
        let [mut share, mut area] = [[0.0; MAX_WIDTH]; 2];
        for lane in 0..F::WIDTH {
            let facet = &self.facets[(facets[lane] as usize).min(self.facets.len() - 1)];
            (share[lane], area[lane]) = (facet.after - facet.before, facet.area);
        }
        (F::load(token, &share) * AREA_SHARE + probabilities * (1.0 - AREA_SHARE)) / F::load(token, &area)
    }

    /// The densities [1/sr] of points on triangles in [`Self::sample`], without the choice of the light. `normal` contains the
    /// unit normals of the surface there, on the side of its front.
    #[inline(always)]
    pub(crate) fn pdf<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        triangles: &[u32; MAX_WIDTH],
        (point, normal): (V3<F>, V3<F>),
    ) -> F {
        let (reaches, mut facets) = (self.reaches(token, receivers), [0; MAX_WIDTH]);
        for lane in 0..F::WIDTH {
            facets[lane] = self.facet_of.get(triangles[lane] as usize).copied().unwrap_or(0);
        }
        let densities = match &self.choice {
            FacetChoice::Single => F::splat(token, 1.0 / self.facets[0].area),
            FacetChoice::Tree(tree) => {
                self.density(token, &facets, tree.probabilities(token, &receivers.to_lanes(), &facets, reaches))
            }
            FacetChoice::Weighted => {
                let probabilities = share_of(
                    token,
                    &self.facets,
                    &facets,
                    #[inline(always)]
                    |facet| facet.weight(token, receivers, &self.profile, self.two_sided),
                );
                self.density(token, &facets, probabilities)
            }
        };
        let to_light = point - receivers.point;
        let d2 = to_light.length_squared();
        let direction = to_light * d2.sqrt().recip();
        self.pdf_of(densities, d2, direction.dot(normal)).only(reaches)
    }

    /// Area density to solid angle. `cosine` is that between the direction to the light and the normal of its front.
    #[inline(always)]
    fn pdf_of<F: Lanes>(&self, density: F, distance_squared: F, cosine: F) -> F {
        let cosine = if self.two_sided { cosine.abs() } else { -cosine };
        (density * distance_squared / cosine).only(cosine.is_positive())
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

#[inline(always)]
fn below_one_lanes<F: Lanes>(u: F) -> F {
    u.clamp(0.0, 1.0 - f32::EPSILON / 2.0)
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
