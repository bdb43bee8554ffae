//! Derivative of the shading normal over a triangle, for ray differentials at a curved surface.

use crate::query::intersect::{SurfacePoint, mix};
use crate::query::shading::visible_normals;
use crate::scene::Scene;
use dunkelfeld_geometry::{DVec3, Vec3};

/// The derivative of the shading normal at a point of a triangle, in render space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalDifferential {
    /// Change of the second and the third barycentric coordinate per displacement [1/m].
    gradients: [DVec3; 2],
    /// Change of the unit normal per change of these.
    changes: [DVec3; 2],
}

impl NormalDifferential {
    /// The change of the unit normal for a displacement \[m\] in the plane of the triangle, to first order. A part of
    /// the displacement across that plane has no effect.
    #[inline]
    pub fn along(&self, displacement: DVec3) -> DVec3 {
        self.changes[0] * self.gradients[0].dot(displacement) + self.changes[1] * self.gradients[1].dot(displacement)
    }
}

impl Scene {
    /// The normal of the frame that [`Self::shade`] gives for a viewer in direction `wo`, and its derivative. There is
    /// no derivative if the normal is constant over the triangle. `None` if the normal also depends on `wo`. Normal maps
    /// are ignored, because no cover has any.
    pub fn normal_differential(&self, p: &SurfacePoint, wo: Vec3) -> Option<(Vec3, Option<NormalDifferential>)> {
        let normal = self.shading_normals((), &p.into());
        let (_, is_turned) = visible_normals::<f32>(normal, p.normal.into(), wo.into());
        if is_turned {
            return None;
        }
        let normal = Vec3::from(normal);
        let is_behind = !self.compiled[p.material as usize].is_solid && p.normal.dot(wo) < 0.0;
        let oriented = if is_behind { -normal } else { normal };
        Some((oriented, self.interpolation_differential(p, oriented)))
    }

    /// The derivative of `v / |v|` with `v` the interpolated normal, in render space and on the side of `oriented`.
    fn interpolation_differential(&self, p: &SurfacePoint, oriented: Vec3) -> Option<NormalDifferential> {
        let part = &self.parts[p.part as usize];
        let facet = self.facet(part, p.triangle);
        let normals = self.corner_normals(part, facet)?;
        let [n0, n1, n2] = normals;
        let transform = part.transform.as_deref();
        let to_render = |n: Vec3| transform.map_or(n.as_dvec3(), |t| t.to_object().matrix3.transpose() * n.as_dvec3());
        let mixed = to_render(mix(&p.barycentrics, normals));
        let length = mixed.length();
        let unit = mixed / length;
        let corners =
            facet.corners().map(|c| transform.map_or(c.as_dvec3(), |t| t.to_world().transform_point3(c.as_dvec3())));
        let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
        let across = e1.cross(e2);
        let inverse = 1.0 / across.length_squared();
        let gradients = [e2.cross(across) * inverse, across.cross(e1) * inverse];
        let side = if unit.dot(oriented.as_dvec3()) < 0.0 { -1.0 } else { 1.0 };
        let changes = [n1 - n0, n2 - n0].map(|change| {
            let change = to_render(change);
            (change - unit * unit.dot(change)) * (side / length)
        });
        let is_known = gradients.iter().chain(&changes).all(|v| v.is_finite());
        let varies = changes.iter().any(|c| *c != DVec3::ZERO);
        (is_known && varies).then_some(NormalDifferential { gradients, changes })
    }
}
