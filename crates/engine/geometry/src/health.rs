//! The health of a mesh: defects of its triangles, and whether it encloses a volume.
//!
//! [`clean`] removes triangles that a ray can never hit or would hit twice. [`MeshHealth::from_mesh`] describes the
//! remaining mesh. A mesh of glass must be closed and wound outward, because refraction needs an inside. Vertices with
//! equal positions count as one, regardless of their normals and texture coordinates. Both functions run in hashed
//! linear time.

use glam::{DVec3, Vec3};
use rustc_hash::{FxBuildHasher, FxHashMap};
use std::collections::hash_map::Entry;
use std::hash::BuildHasher as _;

use crate::{Aabb, Mesh, Threads};

/// A triangle whose height over its longest edge is below this fraction of that edge has no area. The limit is a few
/// hundredths of the rounding of its coordinates, so that needles with an area are kept.
const MIN_RELATIVE_HEIGHT: f64 = 1e-9;

/// Number of triangles that [`clean`] removed, by reason. A triangle with several defects is counted for the first one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Repairs {
    /// With an index beyond the vertices.
    pub out_of_range: usize,
    /// With a corner that is NaN or infinite.
    pub non_finite: usize,
    /// Without area: repeated or collinear corners.
    pub zero_area: usize,
    /// With the same three positions as an earlier triangle, wound the same way.
    pub duplicates: usize,
    /// With the same three positions as an earlier triangle, wound the other way (a sheet modelled from both sides).
    pub opposite_duplicates: usize,
}

impl Repairs {
    /// Total number of removed triangles.
    pub fn total(&self) -> usize {
        self.out_of_range + self.non_finite + self.zero_area + self.duplicates + self.opposite_duplicates
    }

    fn with(&self, other: &Self) -> Self {
        Self {
            out_of_range: self.out_of_range + other.out_of_range,
            non_finite: self.non_finite + other.non_finite,
            zero_area: self.zero_area + other.zero_area,
            duplicates: self.duplicates + other.duplicates,
            opposite_duplicates: self.opposite_duplicates + other.opposite_duplicates,
        }
    }
}

/// Removes the triangles that no ray can hit, or that would be hit twice. Of coincident triangles the first stays.
///
/// The order of the others and all vertices are kept. The result is the same for any number of threads.
pub fn clean(mesh: &mut Mesh, threads: Threads) -> Repairs {
    let defects = Defects::of(mesh, threads);
    defects.remove_from(mesh);
    defects.repairs
}

/// The triangles of a mesh that [`clean`] removes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Numbers of the triangles, in ascending order.
    triangles: Vec<u32>,
    repairs: Repairs,
}

/// Number of triangles whose corners are read as one task.
const CHUNK: usize = 1 << 13;
/// Triangles are compared in sets of about so many: the table of a set is small enough for a cache.
const COMPARED: usize = 1 << 14;
/// Maximum number of these sets.
const MAX_SETS: usize = 256;

impl Defects {
    /// Finds the defects of a mesh.
    pub fn of(mesh: &Mesh, threads: Threads) -> Self {
        let threads = if mesh.triangles.len() < Threads::LARGE { Threads::ONE } else { threads };
        let sets = (mesh.triangles.len() / COMPARED).next_power_of_two().min(MAX_SETS);
        let chunks = (0u32..).step_by(CHUNK).zip(mesh.triangles.chunks(CHUNK)).collect();
        let parts = threads.map(chunks, |(first, triangles)| Chunk::new(&mesh.positions, (first, triangles), sets));
        let compared = threads.map((0..sets).collect(), |set| {
            let numbers = parts.iter().flat_map(|chunk| &chunk.sets[set]).copied();
            duplicates(mesh, numbers, parts.iter().map(|chunk| chunk.sets[set].len()).sum())
        });
        let mut all = Self::default();
        for found in parts.into_iter().map(|chunk| chunk.defects).chain(compared) {
            all.triangles.extend(found.triangles);
            all.repairs = all.repairs.with(&found.repairs);
        }
        all.triangles.sort_unstable();
        all
    }

    /// Number of triangles by reason.
    pub fn repairs(&self) -> &Repairs {
        &self.repairs
    }

    /// Removes the triangles.
    pub fn remove_from(&self, mesh: &mut Mesh) {
        let mut defects = self.triangles.iter().copied().peekable();
        if defects.peek().is_some() {
            let mut numbers = 0..;
            mesh.triangles.retain(|_| defects.next_if_eq(&numbers.next().unwrap_or(u32::MAX)).is_none());
        }
    }
}

/// Triangles in a row.
struct Chunk {
    /// Those that have a defect of their own.
    defects: Defects,
    /// The numbers of the others. Triangles with the same positions are in the same set.
    sets: Vec<Vec<u32>>,
}

impl Chunk {
    fn new(positions: &[Vec3], (first, triangles): (u32, &[[u32; 3]]), sets: usize) -> Self {
        let room = triangles.len() / sets;
        let sets_of_chunk = (0..sets).map(|_| Vec::with_capacity(room + room / 4)).collect();
        let mut chunk = Self { defects: Defects::default(), sets: sets_of_chunk };
        let Repairs { out_of_range, non_finite, zero_area, .. } = &mut chunk.defects.repairs;
        for (number, triangle) in (first..).zip(triangles) {
            let reason = match corners_of(positions, triangle) {
                None => &mut *out_of_range,
                Some(corners) if !corners.iter().all(|c| c.is_finite()) => &mut *non_finite,
                Some(corners) if has_no_area(&corners) => &mut *zero_area,
                Some(corners) => {
                    let set = if sets == 1 { 0 } else { hash(&unordered(corners.map(position_key)).0) as usize % sets };
                    chunk.sets[set].push(number);
                    continue;
                }
            };
            *reason += 1;
            chunk.defects.triangles.push(number);
        }
        chunk
    }
}

/// A number for the set of a triangle, from bits of the hash that the table of a set does not use most.
fn hash(key: &[[u32; 3]; 3]) -> u64 {
    FxBuildHasher.hash_one(key) >> 32
}

/// The triangles that repeat an earlier one.
fn duplicates(mesh: &Mesh, numbers: impl Iterator<Item = u32>, count: usize) -> Defects {
    let mut defects = Defects::default();
    let mut seen: FxHashMap<[[u32; 3]; 3], bool> = FxHashMap::default();
    seen.reserve(count);
    for number in numbers {
        let Some(corners) = corners_of(&mesh.positions, &mesh.triangles[number as usize]) else { continue };
        let (key, even) = unordered(corners.map(position_key));
        match seen.entry(key) {
            Entry::Vacant(entry) => {
                entry.insert(even);
            }
            Entry::Occupied(first) => {
                let Repairs { duplicates, opposite_duplicates, .. } = &mut defects.repairs;
                *(if *first.get() == even { duplicates } else { opposite_duplicates }) += 1;
                defects.triangles.push(number);
            }
        }
    }
    defects
}

/// Properties of a mesh after [`clean`]. Triangles that `clean` would remove for their corners are ignored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshHealth {
    /// Number of triangles.
    pub triangles: usize,
    /// Number of different positions in use.
    pub vertices: usize,
    /// Edges used by one triangle only.
    pub open_edges: usize,
    /// Edges used by two triangles in the same direction: one of the two is wound the wrong way.
    pub inconsistent_edges: usize,
    /// Edges used by three triangles or more.
    pub non_manifold_edges: usize,
    /// Enclosed volume [m^3], negative if the winding points inward. It is undefined unless the mesh is closed.
    pub signed_volume: f64,
    /// Surface area [m^2].
    pub area: f64,
    /// Bounds of the triangles \[m\].
    pub bounds: Aabb,
}

impl MeshHealth {
    /// Computes the properties of a mesh.
    pub fn from_mesh(mesh: &Mesh) -> Self {
        let sound = |t: &&[u32; 3]| corners_of(&mesh.positions, t).is_some_and(|c| c.iter().all(|c| c.is_finite()));
        let corners_of = |t: &[u32; 3]| t.map(|i| mesh.positions[i as usize]);
        let bounds = Aabb::from_points(mesh.triangles.iter().filter(sound).flat_map(corners_of));
        // Volumes are relative to the centre, where the cancellation of the signed parts is least.
        let middle = if bounds.is_empty() { DVec3::ZERO } else { bounds.center().as_dvec3() };

        let mut welded = Weld::of(mesh);
        let mut half_edges: Vec<u64> = Vec::with_capacity(3 * mesh.triangles.len());
        let (mut triangles, mut six_volumes, mut twice_area) = (0, 0.0, 0.0);
        for corners in mesh.triangles.iter().filter(sound).map(corners_of) {
            half_edges.extend(welded.half_edges(corners));
            let [a, b, c] = corners.map(|c| c.as_dvec3() - middle);
            triangles += 1;
            six_volumes += a.dot(b.cross(c));
            twice_area += (b - a).cross(c - a).length();
        }
        half_edges.sort_unstable();

        let mut health = Self {
            triangles,
            vertices: welded.0.len(),
            open_edges: 0,
            inconsistent_edges: 0,
            non_manifold_edges: 0,
            signed_volume: six_volumes / 6.0,
            area: 0.5 * twice_area,
            bounds,
        };
        for uses in half_edges.chunk_by(|a, b| a >> 1 == b >> 1) {
            match uses {
                [_] => health.open_edges += 1,
                [a, b] if a == b => health.inconsistent_edges += 1,
                [_, _] => {}
                _ => health.non_manifold_edges += 1,
            }
        }
        health
    }

    /// True if every edge joins exactly two triangles, in opposite directions.
    pub fn is_closed(&self) -> bool {
        self.triangles > 0 && self.open_edges + self.inconsistent_edges + self.non_manifold_edges == 0
    }

    /// True if it is closed and wound inward.
    pub fn is_inside_out(&self) -> bool {
        self.is_closed() && self.signed_volume < 0.0
    }
}

/// The opposite of a half-edge of [`opposite_half_edges`] that has none.
pub const OPEN: u32 = u32::MAX;

/// For each half-edge of a mesh after [`clean`], the one of the neighbour in the opposite direction. The half-edge `3 t + k`
/// runs from corner k of triangle t to its next corner. [`OPEN`] where an edge does not join exactly two triangles, or joins them
/// with opposite windings.
pub fn opposite_half_edges(mesh: &Mesh) -> Vec<u32> {
    let (mut welded, mut opposite) = (Weld::of(mesh), vec![OPEN; 3 * mesh.triangles.len()]);
    let keys = (0..mesh.triangles.len()).flat_map(|t| welded.half_edges(mesh.corners(t)));
    let mut edges: Vec<(u64, u32)> = keys.zip(0..).collect();
    edges.sort_unstable();
    for uses in edges.chunk_by(|a, b| a.0 >> 1 == b.0 >> 1) {
        if let &[(up, a), (down, b)] = uses
            && up != down
        {
            (opposite[a as usize], opposite[b as usize]) = (b, a);
        }
    }
    opposite
}

/// Numbers of different positions.
struct Weld(FxHashMap<[u32; 3], u32>);

impl Weld {
    fn of(mesh: &Mesh) -> Self {
        let mut ids = FxHashMap::default();
        ids.reserve(mesh.positions.len());
        Self(ids)
    }

    /// Keys of the half-edges of a triangle: lower id, higher id, and in the lowest bit whether the edge is directed downward. So
    /// uses of one edge sort together, and those in one direction come first. Ids fit in 31 bits, because vertices are counted
    /// in u32 and three of them make a triangle of 12 bytes.
    fn half_edges(&mut self, corners: [Vec3; 3]) -> [u64; 3] {
        let [a, b, c] = corners.map(|corner| {
            let next = self.0.len() as u32;
            *self.0.entry(position_key(corner)).or_insert(next)
        });
        [(a, b), (b, c), (c, a)].map(|(from, to)| {
            let (lo, hi, down) = if from < to { (from, to, 0) } else { (to, from, 1) };
            (u64::from(lo) << 33) | (u64::from(hi) << 1) | down
        })
    }
}

fn corners_of(positions: &[Vec3], triangle: &[u32; 3]) -> Option<[Vec3; 3]> {
    let at = |i: u32| positions.get(i as usize).copied();
    Some([at(triangle[0])?, at(triangle[1])?, at(triangle[2])?])
}

fn has_no_area(corners: &[Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|c| c.as_dvec3());
    let (e1, e2, e3) = (b - a, c - a, c - b);
    let longest2 = e1.length_squared().max(e2.length_squared()).max(e3.length_squared());
    // Twice the area is height times longest edge.
    e1.cross(e2).length() <= MIN_RELATIVE_HEIGHT * longest2
}

/// The bits of a position, with the two zeros made one.
fn position_key(p: Vec3) -> [u32; 3] {
    (p + Vec3::ZERO).to_array().map(f32::to_bits)
}

/// Three keys in ascending order, and whether the permutation is even, which corresponds to the winding.
fn unordered(mut keys: [[u32; 3]; 3]) -> ([[u32; 3]; 3], bool) {
    let mut even = true;
    for (i, j) in [(0, 1), (1, 2), (0, 1)] {
        if keys[i] > keys[j] {
            keys.swap(i, j);
            even = !even;
        }
    }
    (keys, even)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit cube with four vertices of its own per face, as in exported meshes with flat shading.
    fn cube() -> Mesh {
        let mut mesh = Mesh::default();
        for axis in 0..3 {
            for side in [0.0, 1.0] {
                let at = |u: f32, v: f32| {
                    let mut p = [0.0; 3];
                    (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (side, u, v);
                    Vec3::from(p)
                };
                let base = mesh.positions.len() as u32;
                mesh.positions.extend([at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)]);
                let quad = if side == 1.0 { [0, 1, 2, 0, 2, 3] } else { [0, 2, 1, 0, 3, 2] };
                mesh.triangles.extend(quad.chunks(3).map(|t| [base + t[0], base + t[1], base + t[2]]));
            }
        }
        mesh
    }

    #[test]
    fn a_cube_of_split_vertices_is_closed_and_has_its_volume() {
        let health = MeshHealth::from_mesh(&cube());
        assert!(health.is_closed() && !health.is_inside_out(), "{health:?}");
        assert_eq!((health.triangles, health.vertices), (12, 8));
        assert!((health.signed_volume - 1.0).abs() < 1e-12 && (health.area - 6.0).abs() < 1e-12);

        let mut inverted = cube();
        inverted.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        assert!(MeshHealth::from_mesh(&inverted).is_inside_out());

        let mut far = cube();
        far.positions.iter_mut().for_each(|p| *p += Vec3::new(1000.0, -1000.0, 0.0));
        assert!((MeshHealth::from_mesh(&far).signed_volume - 1.0).abs() < 1e-9);
    }

    #[test]
    fn neighbours_share_an_edge_in_opposite_directions() {
        let mut mesh = cube();
        mesh.triangles.pop();
        let opposite = opposite_half_edges(&mesh);
        let end = |half: u32, step: u32| mesh.corners(half as usize / 3)[((half + step) % 3) as usize];
        for (half, &other) in (0..).zip(&opposite).filter(|(_, other)| **other != OPEN) {
            assert_eq!([end(half, 0), end(half, 1)], [end(other, 1), end(other, 0)]);
        }
        assert_eq!(opposite.iter().filter(|other| **other == OPEN).count(), 3, "the edges of the hole");
    }

    #[test]
    fn holes_flipped_triangles_and_fins_are_distinguished() {
        let mut open = cube();
        open.triangles.pop();
        let h = MeshHealth::from_mesh(&open);
        assert_eq!((h.open_edges, h.inconsistent_edges, h.non_manifold_edges), (3, 0, 0));
        let mut flipped = cube();
        flipped.triangles[5].swap(0, 1);
        let h = MeshHealth::from_mesh(&flipped);
        assert_eq!((h.open_edges, h.inconsistent_edges, h.non_manifold_edges), (0, 3, 0));
        let mut fin = cube();
        fin.positions.push(Vec3::splat(9.0));
        fin.triangles.push([0, 1, 24]);
        let h = MeshHealth::from_mesh(&fin);
        assert_eq!((h.open_edges, h.non_manifold_edges), (2, 1));
        assert!(!MeshHealth::from_mesh(&Mesh::default()).is_closed());
    }

    #[test]
    fn clean_takes_out_each_kind_of_bad_triangle_with_a_report() {
        let mut mesh = cube();
        let good = mesh.triangles.clone();
        let [a, b, c] = good[0];
        mesh.positions.push(Vec3::new(f32::NAN, 0.0, 0.0));
        mesh.positions.push(Vec3::new(0.5, 0.5, f32::INFINITY));
        mesh.positions.push(mesh.positions[a as usize] * -0.0);
        mesh.triangles.extend([
            [0, 1, 999],
            [u32::MAX, 0, 1],
            [0, 1, 24],
            [25, 1, 2],
            [a, a, b],
            [b, c, a],
            [a, b, c],
            [a, c, b],
        ]);
        let repairs = clean(&mut mesh, Threads::ONE);
        let want = Repairs { out_of_range: 2, non_finite: 2, zero_area: 1, duplicates: 2, opposite_duplicates: 1 };
        assert_eq!(repairs, want);
        assert_eq!(repairs.total(), 8);
        assert_eq!(mesh.triangles, good);
        assert_eq!(clean(&mut mesh, Threads::ONE), Repairs::default());
    }

    #[test]
    fn needles_stay_and_collinear_corners_go() {
        let mut mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(0.5, 1e-7, 0.0), Vec3::new(0.5, 0.0, 0.0), -Vec3::ZERO],
            triangles: vec![[0, 1, 2], [0, 1, 3], [4, 0, 2], [4, 1, 2]],
            ..Mesh::default()
        };
        let repairs = clean(&mut mesh, Threads::ONE);
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
        assert_eq!((repairs.zero_area, repairs.duplicates), (2, 1), "-0 and 0 are one position");
    }
}
