//! Faces that coincide with a hit. A ray that leaves the hit starts beyond its rounding error, and steps over them.

use crate::query::intersect::SurfacePoint;
use crate::scene::Scene;
use dunkelfeld_geometry::Ray;

impl Scene {
    /// The next of the faces that a ray steps over when it passes a surface of partial coverage; `hit` is the nearest
    /// hit of the ray. `last` is the face that this function gave before, `None` at first. The faces are in a fixed
    /// order: those with partial coverage first, then by part. A face at an edge of two triangles of one part counts
    /// once.
    ///
    /// The steps are those of [`Scene::interface`]: a face counts if the origin of the ray is before it, and the origin
    /// of the continued ray is not.
    #[inline(never)]
    pub fn next_coincident(&self, ray: &Ray, hit: SurfacePoint, last: Option<SurfacePoint>) -> Option<SurfacePoint> {
        let key = |p: &SurfacePoint| {
            let is_full = !self.compiled[p.material as usize].has_coverage;
            (is_full, p.part, ray.direction.dot(p.normal) < 0.0)
        };
        let (end, passed, last) = (hit.ray_origin(ray.direction), key(&hit), last.as_ref().map(key));
        let mut found: Option<SurfacePoint> = None;
        self.each_face_near(ray, &hit, |point| {
            let place = key(&point);
            let is_next = place != passed && last.is_none_or(|last| place > last);
            // Of two triangles at an edge the first one counts, independently of the order in which they are found.
            let order = |p: &SurfacePoint| (key(p), p.triangle);
            let is_first = found.as_ref().is_none_or(|found| order(&point) < order(found));
            if is_next && is_first && self.crosses(ray, end, &point, true) {
                found = Some(SurfacePoint { distance: hit.distance, ..point });
            }
        });
        found
    }

    /// Calls `found` for the faces at the distance of a hit, up to the rounding of distances, and for the hit itself.
    #[inline]
    pub(crate) fn each_face_near(&self, ray: &Ray, hit: &SurfacePoint, mut found: impl FnMut(SurfacePoint)) {
        // The range contains all coincident faces in spite of the rounding of distances. Their sides decide which of
        // them count.
        let cos = ray.direction.dot(hit.normal).abs().max(1e-3);
        let reach = 16.0 * f32::EPSILON * (self.radius + hit.distance) / cos;
        let start = (hit.distance - reach).max(0.0);
        let probe = Ray::with_end(ray.at(start), ray.direction, hit.distance - start + reach).at_time(ray.time);
        self.bvh.each_hit(&probe, |other| found(self.surface_point(&other, ray.time)));
    }
}
