//! Intersection of rays with the scene, and transmittance of shadow rays.

use crate::geometry::triangle_data::FLAT;
use crate::light::emission_profile::EmissionProfile;
use crate::query::surface::{self, TexturePoint};
use crate::query::surface_points::{HitLanes, SurfacePoints};
use crate::scene::Scene;
use dunkelfeld_bvh::Hit;
use dunkelfeld_geometry::{Ray, Vec2, Vec3, Vec4, offset_ray_origin, offset_ray_origins};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, One, V3};
use dunkelfeld_radiometry::Rgb;

/// A point on a surface, with the data that a ray needs to leave it.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Position in render space \[m\].
    pub point: Vec3,
    /// Bound of the position's rounding error, per axis \[m\].
    pub error: Vec3,
    /// Unit geometric normal, on the side given by the winding.
    pub normal: Vec3,
    /// Ray parameter of the hit \[m\].
    pub distance: f32,
    pub(crate) part: u32,
    pub(crate) material: u32,
    pub(crate) triangle: u32,
    /// Number of the normals of the triangle's corners; [`FLAT`](crate::geometry::triangle_data::FLAT) if the geometric
    /// normal is that of shading.
    pub(crate) normals: u32,
    pub(crate) barycentrics: [f32; 3],
    /// Time of the ray \[s\], which is that of the pose of a moving part.
    pub(crate) time: f32,
}

impl SurfacePoint {
    /// A point in a medium at a distance \[m\] along a ray. It lies on no surface: all that a surface has is zero.
    pub fn in_medium(ray: &Ray, distance: f32) -> Self {
        Self {
            point: ray.at(distance),
            error: Vec3::ZERO,
            normal: Vec3::Z,
            distance,
            part: 0,
            material: 0,
            triangle: 0,
            normals: FLAT,
            barycentrics: [0.0; 3],
            time: ray.time,
        }
    }

    /// Index of its material.
    #[inline]
    pub fn material(&self) -> u32 {
        self.material
    }

    /// The origin of a ray in the given direction, moved so that the ray does not hit this surface again.
    #[inline]
    pub fn ray_origin(&self, direction: Vec3) -> Vec3 {
        offset_ray_origin(self.point, self.error, self.normal, direction)
    }
}

impl Scene {
    /// The nearest surface along a ray, regardless of its coverage.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<SurfacePoint> {
        self.bvh.closest_hit(ray).map(|hit| self.surface_point(&hit, ray.time))
    }

    /// The point on a surface of a hit at a time \[s\].
    #[inline(always)]
    pub fn surface_point(&self, hit: &Hit, time: f32) -> SurfacePoint {
        let Hit { t, instance, part, triangle, b1, b2 } = *hit;
        let hits = HitLanes { t, b1, b2, instance: One(instance), part: One(part), triangle: One(triangle) };
        self.surface_points::<f32>((), &hits, time).lane(0)
    }

    /// Texture coordinates and vertex colour at a point.
    #[inline]
    pub(crate) fn texture_point(&self, p: &SurfacePoint) -> TexturePoint {
        let mesh = &self.meshes[self.parts[p.part as usize].mesh as usize];
        let vertices = mesh.triangles[p.triangle as usize].map(|i| i as usize);
        let uvs = [0, 1].map(|set| {
            let uv = &mesh.uvs[set];
            if uv.is_empty() { Vec2::ZERO } else { mix(&p.barycentrics, vertices.map(|v| uv[v])) }
        });
        let color =
            if mesh.colors.is_empty() { Vec4::ONE } else { mix(&p.barycentrics, vertices.map(|v| mesh.colors[v])) };
        TexturePoint { uvs, color }
    }

    /// True if surfaces of a material are random: present or absent, or one of two kinds.
    #[inline]
    pub fn is_random(&self, material: u32) -> bool {
        self.compiled[material as usize].is_stochastic()
    }

    /// The probability that light hits the surface at a point, in \[0, 1\]. `direction` is that of a ray that meets it.
    #[inline]
    pub fn coverage(&self, p: &SurfacePoint, direction: Vec3) -> f32 {
        let compiled = &self.compiled[p.material as usize];
        if !compiled.has_coverage {
            return 1.0;
        }
        if compiled.is_back_invisible && direction.dot(p.normal) > 0.0 {
            return 0.0;
        }
        compiled.coverage(&self.materials[p.material as usize], &self.images, || self.texture_point(p))
    }

    /// True if surfaces of a material emit light, at some places at least.
    #[inline(always)]
    pub fn emits(&self, material: u32) -> bool {
        self.compiled[material as usize].emits
    }

    /// Radiance [W/(m^2 sr)] that the surface emits toward the unit direction `toward`.
    #[inline]
    pub fn emitted(&self, p: &SurfacePoint, toward: Vec3) -> Rgb {
        if self.emits(p.material) { self.emitted_lanes(p.material, &p.into(), toward.into()) } else { Rgb::BLACK }
    }

    /// [`Self::emitted`] of points on one material that emits.
    #[inline(always)]
    pub fn emitted_lanes<F: Lanes>(&self, material: u32, points: &SurfacePoints<F>, toward: V3<F>) -> Rgb<F> {
        let (material, token) = (&self.materials[material as usize], toward.x.token());
        let (cosine, mut emission) = (toward.dot(points.normal), [material.emission.factor; MAX_WIDTH]);
        if material.emission.texture.is_some() || material.unlit {
            for (lane, emission) in emission.iter_mut().enumerate().take(F::WIDTH) {
                *emission = surface::emission(material, &self.images, &self.texture_point(&points.lane(lane)));
            }
        }
        let radiance = match material.emission_profile {
            EmissionProfile::Lambertian => Rgb::from_lanes(token, &emission),
            profile => Rgb::from_lanes(token, &emission) * profile.eval(cosine.abs()),
        };
        let is_dark = cosine.le(cosine.constant(0.0));
        match material.double_sided || material.unlit {
            true => radiance,
            false => Rgb::select(is_dark, Rgb::in_lanes(token, Rgb::BLACK), radiance),
        }
    }

    /// Transmittance of a segment: 0 behind a surface that covers fully, else the product of the open shares of partly
    /// covering surfaces.
    #[inline]
    pub fn transmittance(&self, ray: &Ray) -> f32 {
        if !self.has_coverage {
            return f32::from(u8::from(!self.bvh.occluded(ray)));
        }
        let mut open = 1.0;
        let occluded = self.bvh.occluded_with_alpha(ray, |hit| {
            open *= 1.0 - self.coverage(&self.surface_point(&hit, ray.time), ray.direction);
        });
        if occluded { 0.0 } else { open }
    }
}

/// Directions and lengths of shadow rays. `end` has the points on the lights, their normals (zero for points without a
/// surface), and the lanes whose light has a point. In the other lanes the ray has no end.
#[inline(always)]
pub fn shadow_rays<F: Lanes>(
    origin: V3<F>,
    direction: V3<F>,
    (point, normal, is_finite): (V3<F>, V3<F>, F::Mask),
) -> (V3<F>, F) {
    let infinity = direction.x.constant(f32::INFINITY);
    if !is_finite.any() {
        return (direction, infinity);
    }
    // The light's surface is planar. Its points have the rounding error of an interpolated point. The end of the ray has
    // the rounding error of its direction, which at grazing angles would hit the surface too early.
    let (reach, scale) = ((point - origin).length(), 4.0 * f32::EPSILON);
    let size = point.abs();
    let error = V3::new((size.x + reach) * scale, (size.y + reach) * scale, (size.z + reach) * scale);
    let offset = offset_ray_origins(point, error, normal, -direction) - origin;
    let distance = offset.length();
    let is_apart = distance.is_positive() & is_finite;
    // The ray is shortened by two units of rounding, so that it does not reach its end. This is a relative change of
    // 1e-7, independent of the length.
    let length = (distance * (1.0 - 2.0 * f32::EPSILON)).only(is_apart);
    (V3::select(is_apart, offset / distance, direction), is_finite.select(length, infinity))
}

/// The barycentric mean of three values.
#[inline]
pub(crate) fn mix<T>(b: &[f32; 3], [v0, v1, v2]: [T; 3]) -> T
where
    T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
{
    v0 * b[0] + v1 * b[1] + v2 * b[2]
}
