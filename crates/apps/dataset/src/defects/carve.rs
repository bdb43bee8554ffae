//! Defects that change the shape of an opaque body: its triangles are split finely around the place, and their corners move.
//! So a defect may be deep, and may lie over an edge.

use super::pieces::{Pieces, edges};
use super::site::{Made, Site};
use dunkelfeld_geometry::{DQuat, DVec3, Mesh, Vec3, Vec4};
use dunkelfeld_scene::Material;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::ops::{Add, Mul};

/// Pieces whose normal has at most this cosine to the axis are on the other side of the body.
const OTHER_SIDE: f64 = -0.1;
/// Smallest thickness of the body below a defect, over its depth.
const LEAST_WALL: f64 = 0.1;
/// Smallest area of a piece after a change, seen along its normal before, over that before.
const LEAST_SCALE: f64 = 1e-3;
/// Smallest cosine between the normals of pieces that look smooth together: 37 degrees.
const LEAST_SMOOTH: f64 = 0.8;

/// A change of the shape of a body. Points are relative to the place of the defect and in the axes of the world \[m\].
pub(super) struct Change<'a> {
    /// The distance of a point from the space that changes, or less; 0 inside.
    pub(super) distance: &'a dyn Fn(DVec3) -> f64,
    /// The displacement of a point; zero outside of that space.
    pub(super) shift: &'a dyn Fn(DVec3) -> DVec3,
    /// Unit direction out of the body.
    pub(super) axis: DVec3,
    /// Longest edge of the pieces in that space \[m\].
    pub(super) step: f64,
}

/// The pieces of a part with their displacements.
struct Moved<'a> {
    mesh: &'a Mesh,
    pieces: Pieces,
    /// The displacement of each node.
    shifts: Vec<DVec3>,
    /// Does a corner of the piece move?
    is_changed: Vec<bool>,
}

/// Makes a change of the body at a place: the pieces that change are the defect, and the others stay. In a body that is thinner
/// than the change is deep, the other side bulges in the same shape. `None` if the surface ends there, if another surface is
/// near, or if the mesh is no surface.
pub(super) fn carve(site: &Site<'_>, mut pieces: Pieces, change: &Change<'_>, material: Material) -> Option<Made> {
    pieces.refine(|corners| {
        let middle = corners.iter().sum::<DVec3>() / 3.0;
        let radius = corners.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
        let [a, b, c] = corners;
        let longest = a.distance(*b).max(b.distance(*c)).max(c.distance(*a));
        longest > change.step && (change.distance)(middle) < radius
    })?;
    let moved = Moved::new(site, pieces, change)?;
    let (mesh, rest) = moved.meshes(site)?;
    Some(Made { hole: Some(rest), ..Made::new(mesh, None, material) })
}

impl<'a> Moved<'a> {
    fn new(site: &Site<'a>, pieces: Pieces, change: &Change<'_>) -> Option<Self> {
        let all: Vec<DVec3> = pieces.points.iter().map(|p| (change.shift)(*p)).collect();
        let mut moved = Self { mesh: site.below.1, pieces, shifts: all.clone(), is_changed: Vec::new() };
        let other_side = |i: usize| {
            let area = moved.pieces.oriented_area(i);
            area.dot(change.axis) <= OTHER_SIDE * area.length()
        };
        let is_front: Vec<bool> = (0..moved.pieces.pieces.len()).map(|i| !other_side(i)).collect();
        for is_through in [false, true] {
            let mut is_held = vec![!is_through; all.len()];
            let nodes = |i: usize| moved.pieces.pieces[i].nodes.map(|node| node as usize);
            (0..is_front.len()).filter(|i| is_front[*i]).flat_map(nodes).for_each(|node| is_held[node] = false);
            moved.shifts =
                all.iter().zip(is_held).map(|(shift, held)| if held { DVec3::ZERO } else { *shift }).collect();
            moved.is_changed =
                moved.pieces.pieces.iter().map(|piece| piece.nodes.iter().any(|n| moved.is_moved(*n))).collect();
            let is_split = (0..is_front.len()).any(|i| !is_through && moved.is_changed[i] && !is_front[i]);
            if !is_split && moved.has_room(site, change) {
                return (moved.is_inside() && moved.is_unfolded()).then_some(moved);
            }
        }
        None
    }

    fn is_moved(&self, node: u32) -> bool {
        self.shifts[node as usize] != DVec3::ZERO
    }

    /// Does the surface go on beyond all edges that move?
    fn is_inside(&self) -> bool {
        let changed = (0..self.is_changed.len()).filter(|i| self.is_changed[*i]);
        let mut ends = changed.flat_map(|i| edges(self.pieces.pieces[i].nodes));
        self.is_changed.contains(&true)
            && ends.all(|edge| self.pieces.beyond(edge).is_some() || !edge.into_iter().any(|node| self.is_moved(node)))
    }

    /// Does no piece turn around or collapse?
    fn is_unfolded(&self) -> bool {
        let mut changed = (0..self.is_changed.len()).filter(|i| self.is_changed[*i]);
        changed.all(|i| {
            let old = self.pieces.oriented_area(i);
            old.dot(self.new_area(i)) > LEAST_SCALE * old.length_squared()
        })
    }

    /// The cross product of two edges of a piece after the change.
    fn new_area(&self, piece: usize) -> DVec3 {
        let new = |node: u32| self.pieces.points[node as usize] + self.shifts[node as usize];
        let [a, b, c] = self.pieces.pieces[piece].nodes.map(new);
        (b - a).cross(c - a)
    }

    /// Is there nothing else between the nodes and their new places, with a wall of the body behind them?
    fn has_room(&self, site: &Site<'_>, change: &Change<'_>) -> bool {
        let changed: HashSet<usize> =
            (0..self.is_changed.len()).filter(|i| self.is_changed[*i]).map(|i| self.pieces.pieces[i].source).collect();
        let nodes = (0..self.shifts.len()).filter(|i| self.is_moved(*i as u32));
        let ways: Vec<[DVec3; 2]> = nodes
            .map(|i| [self.pieces.points[i], self.pieces.points[i] + self.shifts[i] * (1.0 + LEAST_WALL)])
            .collect();
        let deepest = self.shifts.iter().map(|shift| shift.length()).fold(0.0, f64::max);
        let is_own = |part: usize, triangle: usize| part == site.below.0 && changed.contains(&triangle);
        let is_met = |[from, to]: &[DVec3; 2]| site.surface.is_met(*from, *to, |f| !is_own(f.part, f.triangle));
        !ways.iter().any(is_met) && site.has_room(&ways, change.axis * deepest)
    }

    /// The meshes of the defect and of the rest of the part, in the space of the part.
    fn meshes(&self, site: &Site<'_>) -> Option<(Mesh, Mesh)> {
        let (pieces, to_mesh) = (&self.pieces, &site.surface.to_mesh);
        let is_reflected = to_mesh.matrix3.determinant() < 0.0;
        let mut count = vec![0u32; self.mesh.triangles.len()];
        pieces.pieces.iter().for_each(|piece| count[piece.source] += 1);
        let mut full = self.mesh.clone();
        full.triangles.clear();
        let (mut rest, mut own, mut normals) = (Vec::new(), Vec::new(), Vec::new());
        let mut vertices: HashMap<(usize, u32), u32> = HashMap::new();
        let mut changed: BTreeMap<(usize, u32, [u64; 3]), u32> = BTreeMap::new();
        let around = self.around();
        let mut shifted = Vec::new();
        for (i, piece) in pieces.pieces.iter().enumerate() {
            let source = self.mesh.triangles[piece.source];
            if count[piece.source] == 1 && !self.is_changed[i] {
                rest.push(source);
                continue;
            }
            let mut corners = [0; 3];
            for (k, corner) in corners.iter_mut().enumerate() {
                let (node, weights) = (piece.nodes[k], piece.weights[k]);
                let shift = self.shifts[node as usize];
                let old = weights.iter().position(|w| *w == 1.0).map(|k| source[k]);
                let place = || to_mesh.transform_point3(pieces.points[node as usize] + shift).as_vec3();
                let position = match old {
                    Some(vertex) if shift == DVec3::ZERO => self.mesh.positions[vertex as usize],
                    _ => place(),
                };
                let mut add = || add_vertex(&mut full, source, weights.map(|w| w as f32), position);
                *corner = if self.is_changed[i] {
                    let normal = self.normal(&around, i, k, site);
                    *changed.entry((piece.source, node, normal.to_array().map(f64::to_bits))).or_insert_with(|| {
                        shifted.push((add(), normal));
                        shifted[shifted.len() - 1].0
                    })
                } else {
                    old.unwrap_or_else(|| *vertices.entry((piece.source, node)).or_insert_with(add))
                };
            }
            if is_reflected {
                corners.swap(1, 2);
            }
            if self.is_changed[i] { &mut own } else { &mut rest }.push(corners);
        }
        let to_normal = to_mesh.matrix3.inverse().transpose();
        normals.resize(full.positions.len(), Vec3::ZERO);
        shifted
            .iter()
            .for_each(|(vertex, n)| normals[*vertex as usize] = (to_normal * *n).normalize_or_zero().as_vec3());
        let defect = compact(&Mesh { normals, triangles: own, ..full.clone() });
        full.triangles = rest;
        Some((defect, full))
    }

    /// The pieces around each node of a changed piece.
    fn around(&self) -> HashMap<u32, Vec<usize>> {
        let mut around: HashMap<u32, Vec<usize>> = HashMap::new();
        let all = || self.pieces.pieces.iter().enumerate();
        for (_, piece) in all().filter(|(i, _)| self.is_changed[*i]) {
            around.extend(piece.nodes.map(|node| (node, Vec::new())));
        }
        for (i, piece) in all() {
            piece.nodes.iter().for_each(|node| {
                if let Some(list) = around.get_mut(node) {
                    list.push(i);
                }
            });
        }
        around
    }

    /// The unit normal at a corner of a changed piece, in the axes of the world: that of the surface before, turned as the pieces
    /// around the corner turn that look smooth together.
    fn normal(&self, around: &HashMap<u32, Vec<usize>>, i: usize, k: usize, site: &Site<'_>) -> DVec3 {
        let is_smooth = |a: DVec3, b: DVec3| a.dot(b) >= LEAST_SMOOTH * a.length() * b.length();
        let (piece, own) = (&self.pieces.pieces[i], [self.pieces.oriented_area(i), self.new_area(i)]);
        let (mut before, mut after) = (DVec3::ZERO, DVec3::ZERO);
        for &other in around.get(&piece.nodes[k]).into_iter().flatten() {
            let [old, new] = [self.pieces.oriented_area(other), self.new_area(other)];
            if is_smooth(new, own[1]) {
                after += new;
                before += if is_smooth(old, own[0]) { old } else { DVec3::ZERO };
            }
        }
        let flat = own[0].normalize_or_zero();
        let smooth = site.surface.smooth_normal(self.mesh, piece.source, piece.weights[k], flat);
        match (before.try_normalize(), after.try_normalize()) {
            (Some(before), Some(after)) => DQuat::from_rotation_arc(before, after) * smooth,
            _ => smooth,
        }
    }
}

/// The mesh without the vertices that no triangle uses.
fn compact(mesh: &Mesh) -> Mesh {
    let mut used: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    fn take<T: Copy>(values: &[T], used: &[u32]) -> Vec<T> {
        used.iter().filter_map(|i| values.get(*i as usize)).copied().collect()
    }
    let new = |i: u32| used.partition_point(|v| *v < i) as u32;
    Mesh {
        positions: take(&mesh.positions, &used),
        triangles: mesh.triangles.iter().map(|t| t.map(new)).collect(),
        normals: take(&mesh.normals, &used),
        tangents: take(&mesh.tangents, &used),
        uvs: [0, 1].map(|set| take(&mesh.uvs[set], &used)),
        colors: take(&mesh.colors, &used),
    }
}

/// Adds a vertex in a triangle, with the attributes of the corners mixed.
fn add_vertex(mesh: &mut Mesh, corners: [u32; 3], weights: [f32; 3], position: Vec3) -> u32 {
    fn add<T>(values: &mut Vec<T>, count: usize, corners: [u32; 3], weights: [f32; 3], finish: impl Fn(T, T) -> T)
    where
        T: Copy + Add<Output = T> + Mul<f32, Output = T>,
    {
        if values.len() == count {
            let [a, b, c] = corners.map(|i| values[i as usize]);
            values.push(finish(a * weights[0] + b * weights[1] + c * weights[2], a));
        }
    }
    let count = mesh.positions.len();
    add(&mut mesh.normals, count, corners, weights, |n, _| n.normalize_or_zero());
    let unit = |t: Vec4, first: Vec4| t.truncate().normalize_or_zero().extend(first.w);
    add(&mut mesh.tangents, count, corners, weights, unit);
    add(&mut mesh.colors, count, corners, weights, |c, _| c);
    mesh.uvs.iter_mut().for_each(|uvs| add(uvs, count, corners, weights, |uv, _| uv));
    mesh.positions.push(position);
    count as u32
}
