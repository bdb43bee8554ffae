//! Derivatives of shading normals over triangles, for ray differentials at curved surfaces.

use crate::geometry::triangle_data::{Facet, FacetLanes};
use crate::query::shading::visible_normals;
use crate::query::surface_points::{CornerLanes, SurfacePoints};
use crate::scene::Scene;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};

/// The derivatives of shading normals at points of triangles, one for each lane, in render space.
#[derive(Clone, Copy, Debug)]
pub struct NormalDifferentials<F: Lanes> {
    /// Change of the second and the third barycentric coordinate per displacement [1/m].
    gradients: [V3<F>; 2],
    /// Change of the unit normal per change of these.
    changes: [V3<F>; 2],
}

impl<F: Lanes> NormalDifferentials<F> {
    /// The changes of the unit normals for displacements \[m\] in the planes of the triangles, to first order. A part of
    /// a displacement across that plane has no effect.
    #[inline(always)]
    pub fn along(&self, displacement: V3<F>) -> V3<F> {
        let [a, b] = self.gradients;
        self.changes[0] * a.dot(displacement) + self.changes[1] * b.dot(displacement)
    }
}

impl Scene {
    /// The lanes in which the normal of the frame of [`Self::shade_lanes`] depends on the viewer in direction `wo`, and the
    /// derivatives of the normals, which are zero in lanes with a constant normal. No derivatives if all are constant.
    /// `normals` are those of the frames. Normal maps are ignored, because no cover has any.
    #[inline(always)]
    pub fn normal_differentials<F: Lanes>(
        &self,
        token: F::Token,
        points: &SurfacePoints<F>,
        wo: V3<F>,
        normals: V3<F>,
    ) -> (F::Mask, Option<NormalDifferentials<F>>) {
        if !points.is_smooth.any() {
            return (F::mask(token, 0), None);
        }
        let (triangles, mut facets) = (F::word_to_array(points.triangle), [&Facet::NONE; MAX_WIDTH]);
        let corners = self.corner_lanes(
            token,
            points,
            #[inline(always)]
            |lane, part| facets[lane] = self.facet(part, triangles[lane]),
        );
        let (_, is_turned) = visible_normals(self.shading_normals(token, points, &corners), points.normal, wo);
        let CornerLanes { normals: [n0, n1, n2], is_placed } = corners;
        // The derivative of `v / |v|` with `v` the interpolated normal, on the side of `normals`.
        let FacetLanes { corners: [c0, c1, c2], .. } = Facet::load::<F>(token, &facets);
        let (c0, n0) = (c0, n0);
        let (mut edges, mut turns) = ([c1 - c0, c2 - c0], [n1 - n0, n2 - n0]);
        let mut mixed = n0 + turns[0] * points.b1 + turns[1] * points.b2;
        if is_placed != 0 {
            self.each_pose(
                token,
                (points.part, points.time),
                is_placed,
                #[inline(always)]
                |lanes, transform| {
                    mixed = V3::select(lanes, V3::narrow(transform.covectors::<F>(token, mixed.widen())), mixed);
                    for k in 0..2 {
                        edges[k] =
                            V3::select(lanes, V3::narrow(transform.vectors::<F>(token, edges[k].widen())), edges[k]);
                        turns[k] =
                            V3::select(lanes, V3::narrow(transform.covectors::<F>(token, turns[k].widen())), turns[k]);
                    }
                },
            );
        }
        let length = mixed.length();
        let unit = mixed / length;
        let [e1, e2] = edges;
        let across = e1.cross(e2);
        let inverse = across.length_squared().recip();
        let gradients = [e2.cross(across) * inverse, across.cross(e1) * inverse];
        let scale = length.recip();
        let scale = unit.dot(normals).lt(scale.constant(0.0)).select(-scale, scale);
        let [c1, c2] = [(turns[0] - unit * unit.dot(turns[0])) * scale, (turns[1] - unit * unit.dot(turns[1])) * scale];
        let size = gradients[0].dot(gradients[1]) + c1.dot(c1) + c2.dot(c2);
        let is_known = points.is_smooth & size.is_finite();
        let none = V3::splat(token, Vec3::ZERO);
        let [g1, g2] = gradients;
        let differentials = NormalDifferentials {
            gradients: [V3::select(is_known, g1, none), V3::select(is_known, g2, none)],
            changes: [V3::select(is_known, c1, none), V3::select(is_known, c2, none)],
        };
        (is_turned & points.is_smooth, Some(differentials))
    }
}
