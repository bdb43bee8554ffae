//! Bodies of foreign matter: dust, fibres, inclusions.

use super::draw::{self, Harmonics};
use super::material;
use super::site::{Made, Site};
use super::spec::{Dust, Fibre};
use super::walk::Course;
use dunkelfeld_geometry::{DMat3, DVec3, Mesh};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Pcg;
use std::collections::HashMap;
use std::f64::consts::TAU;

/// Number of planes that cut a particle.
const CUTS: usize = 14;
/// Share of its size by which a particle sinks into the surface.
const SINK: f64 = 0.03;
/// Corners of the cross section of a fibre.
const SIDES: usize = 10;
/// Grey mineral dust.
const DUST_COLOR: Rgb = Rgb::new(0.5, 0.46, 0.4);
const DUST_ROUGHNESS: f32 = 0.9;
/// Light textile fibre.
const FIBRE_COLOR: Rgb = Rgb::new(0.7, 0.7, 0.72);
const FIBRE_ROUGHNESS: f32 = 0.6;

/// Vertices and triangles of an icosahedron whose triangles are divided `levels` times into four, on the unit sphere.
/// Triangles wind counter-clockwise from outside.
fn icosphere(levels: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let g = 0.5 * (1.0 + 5f64.sqrt());
    let corners = [(-1.0, g), (1.0, g), (-1.0, -g), (1.0, -g)];
    let mut points: Vec<DVec3> = corners.iter().map(|(a, b)| DVec3::new(*a, *b, 0.0)).collect();
    points.extend(corners.iter().map(|(a, b)| DVec3::new(0.0, *a, *b)));
    points.extend(corners.iter().map(|(a, b)| DVec3::new(*b, 0.0, *a)));
    let mut points: Vec<DVec3> = points.into_iter().map(DVec3::normalize_or_zero).collect();
    // The faces are the triples of neighbours. All edges have the length 1.0515.
    let near = |a: usize, b: usize| points[a].distance(points[b]) < 1.2;
    let mut triangles = Vec::new();
    for (a, b, c) in (0..12).flat_map(|a| (0..a).flat_map(move |b| (0..b).map(move |c| (a, b, c)))) {
        if near(a, b) && near(b, c) && near(c, a) {
            let outward = points[a].dot(points[b].cross(points[c])) > 0.0;
            triangles.push(if outward { [a as u32, b as u32, c as u32] } else { [a as u32, c as u32, b as u32] });
        }
    }
    for _ in 0..levels {
        let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
        let mut divided = Vec::with_capacity(4 * triangles.len());
        for &[a, b, c] in &triangles {
            let mut middle = |i: u32, j: u32| {
                *middles.entry([i.min(j), i.max(j)]).or_insert_with(|| {
                    points.push((points[i as usize] + points[j as usize]).normalize_or_zero());
                    points.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            divided.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = divided;
    }
    (points, triangles)
}

/// An irregular closed particle around the origin with this largest extent \[m\], with flat faces. `up` is the
/// direction in which it is flattest.
///
/// A sphere is cut by random planes, stretched and turned. So it is convex before the division into triangles.
pub(super) fn particle(extent: f64, up: DVec3, stream: &mut Pcg) -> Mesh {
    let (points, triangles) = icosphere(3);
    let cuts: Vec<(DVec3, f64)> =
        (0..CUTS).map(|_| (draw::direction(stream), draw::between(stream, 0.45, 0.95))).collect();
    let rotation = draw::rotation(stream);
    let flat = DMat3::from_diagonal(DVec3::new(1.0, draw::between(stream, 0.6, 1.0), draw::between(stream, 0.4, 0.8)));
    let z = up.try_normalize().unwrap_or(DVec3::Y);
    let x = z.any_orthonormal_vector();
    let turn = DMat3::from_axis_angle(z, draw::angle(stream)) * DMat3::from_cols(x, z.cross(x), z);
    let shape = turn * flat * rotation;
    let place = |d: &DVec3| {
        let height = |(n, h): &(DVec3, f64)| if d.dot(*n) > 0.0 { h / d.dot(*n) } else { f64::INFINITY };
        shape * (*d * cuts.iter().map(height).fold(1.0, f64::min))
    };
    let placed: Vec<DVec3> = points.iter().map(place).collect();
    let widest = |p: &DVec3| placed.iter().map(|q| p.distance_squared(*q)).fold(0.0, f64::max);
    let size = placed.iter().map(widest).fold(0.0, f64::max).sqrt();
    let scale = extent / size;
    let middle = placed.iter().sum::<DVec3>() / placed.len() as f64;
    let positions = placed.iter().map(|p| ((p - middle) * scale).as_vec3()).collect();
    Mesh { positions, triangles, ..Mesh::default() }
}

/// A particle that rests on the surface.
pub(super) fn dust(site: &Site<'_>, dust: &Dust, stream: &mut Pcg) -> Made {
    let (length, foot) = (dust.length.0, &site.foot);
    let mut mesh = particle(length, foot.normal, stream);
    let heights = mesh.positions.iter().map(|p| p.as_dvec3().dot(foot.normal));
    let lowest = heights.fold(f64::INFINITY, f64::min);
    let shift = (foot.point - foot.normal * (lowest + SINK * length)).as_vec3();
    mesh.positions.iter_mut().for_each(|p| *p += shift);
    Made::new(mesh, None, material::own(&site.finish, DUST_COLOR, DUST_ROUGHNESS))
}

/// A closed tube along a curve on the surface. Its middle line rises and falls by at most three thicknesses.
pub(super) fn fibre(site: &Site<'_>, fibre: &Fibre, stream: &mut Pcg) -> Option<Made> {
    let (length, width, curvature) = (fibre.length.0, fibre.width.0, fibre.curvature.map_or(0.0, |turn| turn.0));
    let wander = Harmonics::draw(stream, 1, 5, 0.25);
    let heave = Harmonics::draw(stream, 1, 5, 0.4);
    let angle = fibre.angle.map_or_else(|| draw::angle(stream), |angle| angle.0);
    let steps = (0.5 * length / width).clamp(24.0, 120.0) as usize;
    let course = Course { length, steps, angle, curvature, wander: &wander };
    let curve = course.on(&site.surface, site.foot)?;
    let radius = 0.5 * width;
    let rise = (3.0 * width).min(0.05 * length);
    let last = curve.len() - 1;
    let center = |i: usize| {
        let foot = &curve[i].hit;
        let t = i as f64 / last as f64;
        foot.point + foot.normal * (0.95 * radius + rise * (0.4 + heave.at(0.5 * t)).clamp(0.0, 1.0))
    };
    let mut mesh = Mesh::default();
    let mut ends = [DVec3::ZERO; 2];
    for (i, foot) in curve.iter().enumerate() {
        let tangent = (center((i + 1).min(last)) - center(i.saturating_sub(1))).try_normalize()?;
        let up = (foot.hit.normal - tangent * tangent.dot(foot.hit.normal)).try_normalize()?;
        let side = tangent.cross(up);
        ends[usize::from(i > 0)] = tangent;
        for k in 0..SIDES {
            let (sin, cos) = (TAU * k as f64 / SIDES as f64).sin_cos();
            let normal = up * cos + side * sin;
            mesh.positions.push((center(i) + normal * radius).as_vec3());
            mesh.normals.push(normal.as_vec3());
        }
    }
    let at = |i: usize, k: usize| (i * SIDES + k % SIDES) as u32;
    for (i, k) in (0..last).flat_map(|i| (0..SIDES).map(move |k| (i, k))) {
        mesh.triangles.extend([[at(i, k), at(i, k + 1), at(i + 1, k + 1)], [at(i, k), at(i + 1, k + 1), at(i + 1, k)]]);
    }
    for (i, outward) in [(0, -ends[0]), (last, ends[1])] {
        let tip = mesh.positions.len() as u32;
        mesh.positions.push((center(i) + outward * (0.5 * radius)).as_vec3());
        mesh.normals.push(outward.as_vec3());
        for k in 0..SIDES {
            // The normals of an end are between those of the tube and of its tip.
            let ring = at(i, k) as usize;
            mesh.normals[ring] = (mesh.normals[ring] + outward.as_vec3()).normalize_or_zero();
            mesh.triangles.push(if i == 0 { [tip, at(i, k + 1), at(i, k)] } else { [tip, at(i, k), at(i, k + 1)] });
        }
    }
    Some(Made::new(mesh, Some(angle), material::own(&site.finish, FIBRE_COLOR, FIBRE_ROUGHNESS)))
}
