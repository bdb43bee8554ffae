//! The faces of a sheet: their orientation, their position along an axis, and their flatness.

use super::stack::CoverInterface;
use crate::scene::Scene;
use dunkelfeld_geometry::{DMat3, DVec2, DVec3};

/// A face whose normal is within this angle of the axis belongs to the upper or the lower side: the cosine of 30
/// degrees.
const FACING: f64 = 0.866_025_403_784_438_6;
/// Cosines of the decreasing cones around the axis in which the axis is refined: 10, 3, 1, 0.3 and 0.1 degrees.
const CONES: [f64; 5] = [0.984_807_753, 0.998_629_535, 0.999_847_695, 0.999_986_292, 0.999_998_477];
/// A face is a plane if at least this share of it lies in one plane.
const PLANE_SHARE: f64 = 0.75;
/// Tolerance of that plane, as a share of the extent of the face.
const PLANE_TOLERANCE: f64 = 1e-5;
/// Largest sine between the normals of the corners and the axis of a plane.
const NORMAL_TOLERANCE: f64 = 1e-3;

/// A triangle in render space.
pub(super) struct Triangle {
    corners: [DVec3; 3],
    /// Unit normal on the outside.
    normal: DVec3,
    /// Area [m^2].
    pub(super) area: f64,
    /// Unit normals of the corners, if they differ from that of the triangle.
    bent: Option<[DVec3; 3]>,
}

/// Side of a sheet that a triangle belongs to.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Facing {
    Along,
    Against,
    Aside,
}

impl Triangle {
    pub(super) fn facing(&self, axis: DVec3) -> Facing {
        match self.normal.dot(axis) {
            c if c >= FACING => Facing::Along,
            c if c <= -FACING => Facing::Against,
            _ => Facing::Aside,
        }
    }

    pub(super) fn corners(&self) -> &[DVec3; 3] {
        &self.corners
    }

    fn centroid(&self) -> DVec3 {
        (self.corners[0] + self.corners[1] + self.corners[2]) / 3.0
    }
}

/// The triangles of some parts; those without area are skipped.
pub(super) fn triangles<'a>(scene: &'a Scene, parts: &'a [usize]) -> impl Iterator<Item = Triangle> + 'a {
    parts.iter().flat_map(move |&index| {
        let part = &scene.parts[index];
        let count = scene.meshes[part.mesh as usize].triangles.len() as u32;
        (0..count).map(|triangle| scene.facet(part, triangle)).filter_map(move |facet| {
            let transform = part.transform.as_deref();
            let point = |p: dunkelfeld_geometry::Vec3| {
                transform.map_or(p.as_dvec3(), |t| t.to_world().transform_point3(p.as_dvec3()))
            };
            let normal = |n: dunkelfeld_geometry::Vec3| {
                let n = n.as_dvec3();
                transform.map_or(n, |t| t.to_object().matrix3.transpose() * n).normalize_or_zero()
            };
            let corners = facet.corners().map(point);
            let across = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let outside = normal(facet.normal());
            // The normal of the winding from f64 corners, on the side of the f32 normal. So mirrored instances keep
            // their outside.
            let exact = across.normalize_or_zero() * if across.dot(outside) < 0.0 { -1.0 } else { 1.0 };
            let bent = scene.corner_normals(part, facet).map(|n| n.map(normal));
            let area = 0.5 * across.length();
            (area > 0.0).then_some(Triangle { corners, normal: exact, area, bent })
        })
    })
}

/// Lowest and highest position of some parts along the axis, and across it; `None` without any surface.
pub(super) fn bounds(
    scene: &Scene,
    parts: &[usize],
    axis: DVec3,
    tangents: [DVec3; 2],
) -> Option<([f64; 2], [DVec2; 2])> {
    let corners = triangles(scene, parts).flat_map(|t| t.corners);
    corners.fold(None, |bounds, p| {
        let (height, q) = (axis.dot(p), DVec2::new(tangents[0].dot(p), tangents[1].dot(p)));
        let ([low, high], [from, to]) = bounds.unwrap_or(([height; 2], [q; 2]));
        Some(([low.min(height), high.max(height)], [from.min(q), to.max(q)]))
    })
}

/// The main direction of the surface normals; `None` without surface.
///
/// It is the principal eigenvector of `sum A n n^T`. It is refined by the mean normal within decreasing cones, as long
/// as a cone holds at least half of the faces along the axis. For a plane with a rim the result is the normal of the
/// plane.
pub(super) fn axis<I: Iterator<Item = Triangle>>(triangles: impl Fn() -> I) -> Option<DVec3> {
    let mut moments = DMat3::ZERO;
    for t in triangles() {
        moments += outer(t.normal, t.normal) * t.area;
    }
    let mut axis = principal_axes(moments)[0];
    if !(axis.is_normalized() && moments.is_finite()) {
        return None;
    }
    let within = |axis: DVec3, cosine: f64| {
        triangles().filter(|t| t.normal.dot(axis).abs() >= cosine).fold((DVec3::ZERO, 0.0), |(sum, area), t| {
            (sum + t.normal * (t.area * t.normal.dot(axis).signum()), area + t.area)
        })
    };
    let (_, all) = within(axis, FACING);
    for cone in CONES {
        let (sum, area) = within(axis, cone);
        if area < 0.5 * all {
            break;
        }
        axis = sum.try_normalize().unwrap_or(axis);
    }
    Some(axis)
}

/// Two unit vectors perpendicular to the axis and to each other, along the main directions of the normals of the rim.
pub(super) fn tangents<I: Iterator<Item = Triangle>>(triangles: impl Fn() -> I, axis: DVec3) -> [DVec3; 2] {
    let mut moments = DMat3::ZERO;
    for t in triangles() {
        let flat = t.normal - axis * axis.dot(t.normal);
        moments += outer(flat, flat) * t.area;
    }
    // The remainder of the normals of the faces is rounding error. Then any direction perpendicular to the axis is
    // valid.
    let u = principal_axes(moments)[0];
    let u = (u - axis * axis.dot(u)).try_normalize().filter(|u| u.dot(axis).abs() < 1e-6);
    let u = u.unwrap_or_else(|| axis.any_orthonormal_vector());
    [u, axis.cross(u)]
}

/// Position of the triangles of one side along the axis, and whether they form a plane perpendicular to it; `None`
/// without any.
///
/// `rounding` is the rounding error of the coordinates of the scene \[m\].
pub(super) fn measure(
    own: &[Triangle],
    axis: DVec3,
    tangents: [DVec3; 2],
    rounding: f64,
) -> Option<(CoverInterface, bool)> {
    let mut footprint = [DVec2::INFINITY, DVec2::NEG_INFINITY];
    let mut area = 0.0;
    for t in own {
        area += t.area;
        for p in t.corners {
            let q = DVec2::new(tangents[0].dot(p), tangents[1].dot(p));
            footprint = [footprint[0].min(q), footprint[1].max(q)];
        }
    }
    let is_there = area > 0.0 && area.is_finite();
    if !is_there {
        return None;
    }
    let tolerance = PLANE_TOLERANCE * (footprint[1] - footprint[0]).max_element() + 4.0 * rounding;
    let middle = median(own.iter().map(|t| (axis.dot(t.centroid()), t.area)).collect(), area);
    let deviation =
        |t: &Triangle, height: f64| t.corners.iter().map(|p| (axis.dot(*p) - height).abs()).fold(0.0, f64::max);
    let is_straight = |t: &Triangle| {
        let normals = t.bent.iter().flatten().chain([&t.normal]);
        normals.into_iter().all(|n| n.cross(axis).length() < NORMAL_TOLERANCE)
    };
    let in_plane = |t: &&Triangle| deviation(t, middle) <= tolerance && is_straight(t);
    let (sum, flat) =
        own.iter().filter(in_plane).fold((0.0, 0.0), |(s, a), t| (s + t.area * axis.dot(t.centroid()), a + t.area));
    let is_flat = flat >= PLANE_SHARE * area;
    let height =
        if is_flat { sum / flat } else { own.iter().map(|t| t.area * axis.dot(t.centroid())).sum::<f64>() / area };
    let deviation = own.iter().map(|t| deviation(t, height)).fold(0.0, f64::max);
    Some((CoverInterface { height, deviation, footprint }, is_flat))
}

/// The value below which half of the weight lies.
fn median(mut values: Vec<(f64, f64)>, weight: f64) -> f64 {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut sum = 0.0;
    let half = values.iter().find(|(_, w)| {
        sum += w;
        sum >= 0.5 * weight
    });
    half.or(values.last()).map_or(0.0, |v| v.0)
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The unit eigenvectors of a symmetric matrix, the one of the largest eigenvalue first (Jacobi 1846).
fn principal_axes(m: DMat3) -> [DVec3; 3] {
    let (mut a, mut axes) = (m, DMat3::IDENTITY);
    // Each sweep squares the off-diagonal elements. Six sweeps exceed the precision of f64.
    for (p, q) in [(0, 1), (0, 2), (1, 2)].into_iter().cycle().take(18) {
        let coupling = a.col(q)[p];
        if coupling == 0.0 {
            continue;
        }
        let theta = 0.5 * (a.col(q)[q] - a.col(p)[p]) / coupling;
        let tangent = theta.signum() / (theta.abs() + theta.hypot(1.0));
        let cosine = 1.0 / tangent.hypot(1.0);
        let mut turn = DMat3::IDENTITY;
        (turn.col_mut(p)[p], turn.col_mut(q)[q]) = (cosine, cosine);
        (turn.col_mut(q)[p], turn.col_mut(p)[q]) = (tangent * cosine, -tangent * cosine);
        a = turn.transpose() * a * turn;
        axes *= turn;
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a.col(j)[j].total_cmp(&a.col(i)[i]));
    order.map(|i| axes.col(i).normalize_or_zero())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn principal_axes_are_those_of_the_matrix() {
        let turn = DMat3::from_axis_angle(DVec3::new(0.48, 0.6, 0.64), 1.1);
        for values in [[3.0, 2.0, 1.0], [1e-9, 1.0, 1e9], [0.0, 0.0, 5.0], [4.0, 4.0, 1.0]] {
            let m = turn * DMat3::from_diagonal(DVec3::from_array(values)) * turn.transpose();
            let mut descending = values;
            descending.sort_by(|a, b| b.total_cmp(a));
            for (axis, value) in principal_axes(m).into_iter().zip(descending) {
                assert!(axis.is_normalized());
                let largest = descending[0];
                assert!((m * axis - axis * value).length() < 1e-14 * largest, "{values:?}: {axis} for {value}");
            }
        }
    }
}
