//! The triangles of a part, which are split where a defect needs them fine, and straight walks over them.

use super::surface::corners_of;
use dunkelfeld_geometry::{DAffine3, DVec3, Mesh};
use std::collections::HashMap;

/// Most triangles that a split may add.
const MOST: usize = 500_000;
/// Most edges that a step of a walk may cross.
const MOST_CROSSINGS: usize = 1000;

/// A triangle, or a piece of one.
#[derive(Clone, Copy)]
pub(super) struct Piece {
    /// Its corners, counter-clockwise from outside.
    pub(super) nodes: [u32; 3],
    /// The triangle of the mesh.
    pub(super) source: usize,
    /// Weights of the corners of that triangle, in the order of the mesh, at each corner of the piece.
    pub(super) weights: [[f64; 3]; 3],
}

/// The triangles of a part. Those that meet share the nodes of their common edge, by the positions of the vertices.
#[derive(Clone)]
pub(super) struct Pieces {
    /// Positions of the nodes, relative to a place and in the axes of the world \[m\].
    pub(super) points: Vec<DVec3>,
    pub(super) pieces: Vec<Piece>,
    /// The piece with this edge, in the direction of its corners.
    edges: HashMap<[u32; 2], usize>,
}

/// A point of a walk.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stride {
    /// The piece that it lies in.
    pub(super) piece: usize,
    /// Relative to the place \[m\].
    pub(super) point: DVec3,
    /// Unit direction of the walk, in the plane of the piece.
    pub(super) along: DVec3,
    /// Unit normal of the piece.
    pub(super) normal: DVec3,
}

impl Pieces {
    /// The triangles of a mesh in their order, without those of no area; `to_place` leads to the axes of the world. Where several
    /// triangles have an edge in one direction, the surface ends.
    pub(super) fn new(mesh: &Mesh, to_place: &DAffine3) -> Self {
        let mut known: HashMap<[u64; 3], u32> = HashMap::new();
        let mut all = Self { points: Vec::new(), pieces: Vec::new(), edges: HashMap::new() };
        let is_reflected = to_place.matrix3.determinant() < 0.0;
        for source in 0..mesh.triangles.len() {
            let Some(local) = corners_of(mesh, source) else { continue };
            let mut nodes = local.map(|local| {
                // A sum with zero has no negative zeros.
                *known.entry((local + DVec3::ZERO).to_array().map(f64::to_bits)).or_insert_with(|| {
                    all.points.push(to_place.transform_point3(local));
                    (all.points.len() - 1) as u32
                })
            });
            let mut weights = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            if is_reflected {
                nodes.swap(1, 2);
                weights.swap(1, 2);
            }
            let [a, b, c] = nodes.map(|node| all.points[node as usize]);
            if (b - a).cross(c - a).length() <= 1e-12 * (b - a).length_squared().max((c - a).length_squared()) {
                continue;
            }
            if edges(nodes).iter().any(|edge| all.edges.contains_key(edge)) {
                // Its corners are nodes of its own, so that it has no neighbours.
                nodes = nodes.map(|node| {
                    all.points.push(all.points[node as usize]);
                    (all.points.len() - 1) as u32
                });
            }
            all.edges.extend(edges(nodes).map(|edge| (edge, all.pieces.len())));
            all.pieces.push(Piece { nodes, source, weights });
        }
        all
    }

    /// The piece that is a whole triangle of the mesh, before any is split.
    pub(super) fn whole(&self, triangle: usize) -> Option<usize> {
        self.pieces.binary_search_by_key(&triangle, |piece| piece.source).ok()
    }

    /// The same pieces around another place.
    pub(super) fn around(&self, place: DVec3) -> Self {
        let mut moved = self.clone();
        moved.points.iter_mut().for_each(|point| *point -= place);
        moved
    }

    /// The corners of a piece.
    pub(super) fn corners(&self, piece: usize) -> [DVec3; 3] {
        self.pieces[piece].nodes.map(|node| self.points[node as usize])
    }

    /// The cross product of two edges of a piece: normal times twice the area.
    pub(super) fn oriented_area(&self, piece: usize) -> DVec3 {
        let [a, b, c] = self.corners(piece);
        (b - a).cross(c - a)
    }

    /// The piece beyond an edge.
    pub(super) fn beyond(&self, [a, b]: [u32; 2]) -> Option<usize> {
        self.edges.get(&[b, a]).copied()
    }

    /// The convex edges between pieces whose normals have at most this cosine: the start of each, the way to its end, and the
    /// unit mean of both normals.
    pub(super) fn convex_edges(&self, sharp: f64) -> impl Iterator<Item = (DVec3, DVec3, DVec3)> + '_ {
        let both = |i: usize| edges(self.pieces[i].nodes).into_iter().map(move |edge| (i, edge));
        (0..self.pieces.len()).flat_map(both).filter_map(move |(i, [a, b])| {
            let other = self.beyond([a, b]).filter(|_| a < b)?;
            let [here, there] = [i, other].map(|i| self.oriented_area(i).normalize_or_zero());
            let [a, b] = [a, b].map(|node| self.points[node as usize]);
            // The other piece is below this one.
            let far = self.corners(other).iter().sum::<DVec3>() / 3.0;
            let is_sharp = here.dot(there) <= sharp && (far - a).dot(here) < 0.0;
            let mean = (here + there).try_normalize()?;
            is_sharp.then_some((a, b - a, mean))
        })
    }

    /// Splits all pieces for which `is_coarse` is true, until it is for none. Each split halves the longest edge of a piece, and
    /// first those of its neighbours that are longer, so that no node lies on an edge of another piece (Rivara 1984). `None` if
    /// there would be too many.
    pub(super) fn refine(&mut self, is_coarse: impl Fn(&[DVec3; 3]) -> bool) -> Option<()> {
        let most = self.pieces.len() + MOST;
        let mut open: Vec<usize> = (0..self.pieces.len()).collect();
        while let Some(piece) = open.pop() {
            if !is_coarse(&self.corners(piece)) {
                continue;
            }
            let mut way = vec![piece];
            while let Some(&last) = way.last() {
                let edge = self.longest(last);
                match self.beyond(edge).filter(|other| sorted(self.longest(*other)) != sorted(edge)) {
                    Some(other) => way.push(other),
                    None => {
                        open.extend(self.halve(edge));
                        way.pop();
                    }
                }
            }
            open.push(piece);
            if self.pieces.len() > most {
                return None;
            }
        }
        Some(())
    }

    /// The longest edge of a piece. Equal ones are ordered by their nodes, the same from both sides.
    fn longest(&self, piece: usize) -> [u32; 2] {
        let length = |[a, b]: [u32; 2]| self.points[a as usize].distance_squared(self.points[b as usize]);
        let [a, b, c] = edges(self.pieces[piece].nodes);
        let longer = |a, b| {
            let order = length(a).total_cmp(&length(b)).then(sorted(a).cmp(&sorted(b)));
            if order.is_lt() { b } else { a }
        };
        longer(longer(a, b), c)
    }

    /// Splits the pieces on both sides of an edge at its middle, and gives the new pieces.
    fn halve(&mut self, [a, b]: [u32; 2]) -> Vec<usize> {
        let middle = self.points.len() as u32;
        self.points.push(0.5 * (self.points[a as usize] + self.points[b as usize]));
        let mut new = Vec::with_capacity(2);
        for edge in [[a, b], [b, a]] {
            let Some(old) = self.edges.remove(&edge) else { continue };
            let piece = self.pieces[old];
            let Some(k) = piece.nodes.iter().position(|node| *node == edge[0]) else { continue };
            let (next, number) = ((k + 1) % 3, self.pieces.len());
            let (from, to) = (piece.weights[k], piece.weights[next]);
            let weights = [0, 1, 2].map(|i| 0.5 * (from[i] + to[i]));
            let (mut near, mut far) = (piece, piece);
            (near.nodes[next], near.weights[next]) = (middle, weights);
            (far.nodes[k], far.weights[k]) = (middle, weights);
            self.pieces[old] = near;
            self.pieces.push(far);
            self.edges.extend(edges(near.nodes).map(|edge| (edge, old)));
            self.edges.extend(edges(far.nodes).map(|edge| (edge, number)));
            new.push(number);
        }
        new
    }

    /// The point after a turn by `turn` \[rad\], counter-clockwise from outside, and `distance` \[m\] straight ahead: over an edge
    /// the direction continues as if both pieces were unfolded into a plane (Polthier and Schmies 1998). `None` beyond the end of
    /// the surface.
    pub(super) fn step(&self, from: &Stride, distance: f64, turn: f64) -> Option<Stride> {
        let mut at = *from;
        let (sin, cos) = turn.sin_cos();
        at.along = at.along * cos + at.normal.cross(at.along) * sin;
        let mut rest = distance;
        for _ in 0..MOST_CROSSINGS {
            let exit = |edge: [u32; 2]| {
                let [a, b] = edge.map(|node| self.points[node as usize]);
                let inward = at.normal.cross(b - a);
                let speed = -at.along.dot(inward);
                (speed > 0.0).then(|| (((at.point - a).dot(inward) / speed).max(0.0), edge))
            };
            let exits = edges(self.pieces[at.piece].nodes).into_iter().filter_map(exit);
            let (way, edge) = exits.min_by(|a, b| a.0.total_cmp(&b.0))?;
            at.point += at.along * way.min(rest);
            if way >= rest {
                return Some(at);
            }
            rest -= way;
            let [a, b] = edge.map(|node| self.points[node as usize]);
            let unit = (b - a).try_normalize()?;
            let across = at.along.dot(unit.cross(at.normal));
            at.piece = self.beyond(edge)?;
            let normal = self.oriented_area(at.piece).try_normalize()?;
            at.along = (unit * at.along.dot(unit) + unit.cross(normal) * across).try_normalize()?;
            at.normal = normal;
        }
        None
    }
}

/// The edges of a triangle, in the direction of its corners.
pub(super) fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}
