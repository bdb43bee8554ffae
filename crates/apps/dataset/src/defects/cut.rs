//! A hole in a mesh: the triangles of a part are cut along a rim of given points, and those inside are left out.

use super::surface::{Facet, LocalSurface, SurfaceHit};
use super::tree::distance_to_triangle;
use dunkelfeld_geometry::{DVec2, DVec3, Mesh, Vec3, Vec4};
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::ops::{Add, Mul};

/// Points that are nearer to each other than this share of the radius are one point.
const NEAR: f64 = 1e-4;
/// Smallest cosine between the normals of the triangles that are cut and that of the middle.
const LEAST_COSINE: f64 = 0.5;

/// A corner of a piece.
#[derive(Clone, Copy)]
struct Node {
    /// In the tangent plane of the middle.
    at: DVec2,
    /// On the surface, relative to its origin \[m\].
    point: DVec3,
}

/// Pieces of the facets around a place. Pieces that meet share the nodes of their common edge.
#[derive(Default)]
struct Pieces {
    nodes: Vec<Node>,
    /// Corners, counter-clockwise in the tangent plane, and the facet.
    triangles: Vec<([usize; 3], usize)>,
    near: f64,
}

impl Pieces {
    /// Cuts an edge at the share `t` of its length. Gives the new node.
    fn cut_edge(&mut self, [u, v]: [usize; 2], t: f64) -> usize {
        let (node, [a, b]) = (self.nodes.len(), [self.nodes[u], self.nodes[v]]);
        self.nodes.push(Node { at: a.at.lerp(b.at, t), point: a.point.lerp(b.point, t) });
        for k in 0..self.triangles.len() {
            let (corners, facet) = self.triangles[k];
            if corners.contains(&u) && corners.contains(&v) {
                let with = |old| (corners.map(|c| if c == old { node } else { c }), facet);
                self.triangles[k] = with(u);
                self.triangles.push(with(v));
            }
        }
        node
    }

    /// The edges of all pieces, once for each piece.
    fn edges(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        self.triangles.iter().flat_map(|([a, b, c], _)| [[*a, *b], [*b, *c], [*c, *a]])
    }

    /// The node at a place. `None` outside of the pieces.
    fn insert(&mut self, at: DVec2) -> Option<usize> {
        if let Some(found) = self.nodes.iter().position(|n| n.at.distance(at) < self.near) {
            return Some(found);
        }
        let on_edge = self.edges().find_map(|[u, v]| {
            let (from, way) = (self.nodes[u].at, self.nodes[v].at - self.nodes[u].at);
            let t = (at - from).dot(way) / way.length_squared();
            (t > 0.0 && t < 1.0 && (from + way * t).distance(at) < self.near).then_some(([u, v], t))
        });
        if let Some((edge, t)) = on_edge {
            return Some(self.cut_edge(edge, t));
        }
        let weights = |corners: [usize; 3]| {
            let [a, b, c] = corners.map(|i| self.nodes[i].at);
            let area = (b - a).perp_dot(c - a);
            [(b - at).perp_dot(c - at) / area, (c - at).perp_dot(a - at) / area, (a - at).perp_dot(b - at) / area]
        };
        let found = self.triangles.iter().position(|(corners, _)| weights(*corners).iter().all(|w| *w >= 0.0))?;
        let (corners, facet) = self.triangles[found];
        let (node, mut point) = (self.nodes.len(), DVec3::ZERO);
        corners.iter().zip(weights(corners)).for_each(|(i, w)| point += self.nodes[*i].point * w);
        self.nodes.push(Node { at, point });
        let pieces = [0, 1, 2].map(|k| ([corners[k], corners[(k + 1) % 3], node], facet));
        self.triangles[found] = pieces[0];
        self.triangles.extend(&pieces[1..]);
        Some(node)
    }

    /// Cuts all edges between two nodes. Gives the nodes on the way, without the last one.
    fn cut(&mut self, [from, to]: [usize; 2]) -> Vec<usize> {
        let (start, way) = (self.nodes[from].at, self.nodes[to].at - self.nodes[from].at);
        // Share of the way, and distance to the left of it.
        let place = |at: DVec2| (way.dot(at - start) / way.length_squared(), way.perp_dot(at - start) / way.length());
        let places: Vec<(f64, f64)> = self.nodes.iter().map(|n| place(n.at)).collect();
        let is_on = |share: f64| share > 0.0 && share < 1.0;
        let others = (0..places.len()).filter(|i| *i != from && *i != to);
        let mut nodes: Vec<(f64, usize)> = others
            .filter(|i| places[*i].1.abs() <= self.near && is_on(places[*i].0))
            .map(|i| (places[i].0, i))
            .collect();
        let mut crossed = BTreeSet::new();
        for [u, v] in self.edges() {
            let [(s, left), (t, right)] = [places[u], places[v]];
            let is_across = left.abs() > self.near && right.abs() > self.near && left * right < 0.0;
            if is_across && is_on(s + (t - s) * left / (left - right)) {
                crossed.insert([u.min(v), u.max(v)]);
            }
        }
        for [u, v] in crossed {
            let (left, right) = (places[u].1, places[v].1);
            let node = self.cut_edge([u, v], left / (left - right));
            nodes.push((place(self.nodes[node].at).0, node));
        }
        nodes.sort_by(|a, b| a.0.total_cmp(&b.0));
        [from].into_iter().chain(nodes.into_iter().map(|(_, node)| node)).collect()
    }
}

/// A part of a surface with holes.
pub(super) struct Holes<'a> {
    surface: &'a LocalSurface<'a>,
    part: usize,
    /// The mesh with all its triangles, and the pieces of the cut ones after them.
    mesh: Mesh,
    /// The cut triangles.
    cut: HashSet<usize>,
}

impl<'a> Holes<'a> {
    /// The part `part` of a surface, with the mesh `mesh`, without holes.
    pub(super) fn new(surface: &'a LocalSurface<'a>, part: usize, mesh: &Mesh) -> Self {
        Self { surface, part, mesh: mesh.clone(), cut: HashSet::new() }
    }

    /// The mesh with the holes.
    pub(super) fn mesh(mut self) -> Mesh {
        let mut number = 0..;
        self.mesh.triangles.retain(|_| number.next().is_some_and(|i| !self.cut.contains(&i)));
        self.mesh
    }

    /// True if a facet is cut: it is around a hole or inside.
    pub(super) fn is_cut(&self, facet: &Facet) -> bool {
        facet.part == self.part && self.cut.contains(&facet.triangle)
    }

    /// Cuts a hole around `middle`, and gives the points of its rim: of each given one with those that lie between it and
    /// the next, where the rim meets edges. `rim` runs counter-clockwise from outside. It is made of straight lines in the
    /// tangent plane of the middle.
    ///
    /// `None` if the triangles inside are no disk with the part all around it.
    pub(super) fn add(&mut self, middle: SurfaceHit, rim: &[SurfaceHit]) -> Option<Vec<Vec<DVec3>>> {
        let surface = self.surface;
        let x = middle.normal.any_orthonormal_vector();
        let y = middle.normal.cross(x);
        let flat = |p: DVec3| DVec2::new(x.dot(p - middle.point), y.dot(p - middle.point));
        let radius = rim.iter().map(|foot| flat(foot.point).length()).fold(0.0, f64::max);
        let is_reflected = surface.to_mesh.matrix3.determinant() < 0.0;
        let mut pieces = Pieces { near: NEAR * radius, ..Pieces::default() };
        let mut known: BTreeMap<[u64; 3], usize> = BTreeMap::new();
        // The vertex of the mesh at a node of a facet.
        let mut vertices: BTreeMap<(usize, usize), u32> = BTreeMap::new();
        for (facet, corners) in surface.corners.iter().enumerate() {
            let found = &surface.facets[facet];
            let reach = distance_to_triangle(DVec3::ZERO, &corners.map(|p| flat(p).extend(0.0)));
            if found.part != self.part || found.normal.dot(middle.normal) < LEAST_COSINE || reach > radius + pieces.near
            {
                continue;
            }
            if !self.cut.insert(found.triangle) {
                return None;
            }
            let mut nodes = corners.map(|point| {
                // A sum with zero has no negative zeros.
                *known.entry((point + DVec3::ZERO).to_array().map(f64::to_bits)).or_insert_with(|| {
                    pieces.nodes.push(Node { at: flat(point), point });
                    pieces.nodes.len() - 1
                })
            });
            vertices.extend(nodes.iter().zip(self.mesh.triangles[found.triangle]).map(|(node, v)| ((facet, *node), v)));
            if is_reflected {
                nodes.swap(1, 2);
            }
            pieces.triangles.push((nodes, facet));
        }
        let ends: Vec<usize> = rim.iter().map(|foot| pieces.insert(flat(foot.point))).collect::<Option<_>>()?;
        let next = |j: usize| ends[(j + 1) % ends.len()];
        let ways: Vec<Vec<usize>> = (0..ends.len()).map(|j| pieces.cut([ends[j], next(j)])).collect();
        let all: Vec<usize> = ways.concat();
        let rim_edges: BTreeSet<[usize; 2]> = (0..all.len()).map(|i| [all[i], all[(i + 1) % all.len()]]).collect();
        let is_inside = |at: DVec2| {
            let crosses = |[a, b]: &&[usize; 2]| {
                let (a, b) = (pieces.nodes[*a].at, pieces.nodes[*b].at);
                (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
            };
            rim_edges.iter().filter(crosses).count() % 2 == 1
        };
        let centre = |c: &[usize; 3]| c.iter().map(|i| pieces.nodes[*i].at).sum::<DVec2>() / 3.0;
        let (inside, outside): (Vec<_>, Vec<_>) = pieces.triangles.iter().partition(|(c, _)| is_inside(centre(c)));
        let edges = |triangles: &[([usize; 3], usize)]| -> BTreeSet<[usize; 2]> {
            triangles.iter().flat_map(|([a, b, c], _)| [[*a, *b], [*b, *c], [*c, *a]]).collect()
        };
        let (within, beyond) = (edges(&inside), edges(&outside));
        let open: BTreeSet<[usize; 2]> = within.iter().filter(|[a, b]| !within.contains(&[*b, *a])).copied().collect();
        let is_joined = rim_edges.iter().all(|[a, b]| beyond.contains(&[*b, *a]));
        if open != rim_edges || rim_edges.len() != all.len() || within.len() != 3 * inside.len() || !is_joined {
            return None;
        }
        for (mut corners, facet) in outside {
            if is_reflected {
                corners.swap(1, 2);
            }
            let source = self.mesh.triangles[surface.facets[facet].triangle];
            let triangle = corners.map(|node| {
                *vertices.entry((facet, node)).or_insert_with(|| {
                    let point = pieces.nodes[node].point;
                    let weights = surface.weights_at(facet, point).map(|w| w as f32);
                    add_vertex(&mut self.mesh, source, weights, surface.to_mesh.transform_point3(point).as_vec3())
                })
            });
            self.mesh.triangles.push(triangle);
        }
        let points = ways.iter().map(|way| way.iter().map(|node| pieces.nodes[*node].point).collect());
        Some(points.collect())
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
