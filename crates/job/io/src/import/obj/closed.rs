//! Is the surface of a mesh closed? Vertices at the same place count as one: many exporters write a vertex once per face.

use std::cell::OnceCell;
use std::cmp::Ordering;
use std::collections::HashMap;

/// The places of a file's vertices.
pub(super) struct Places<'a> {
    positions: &'a [[f64; 3]],
    /// Hashes that are equal for equal places, and seldom for others.
    hashes: Vec<u64>,
    /// For each position, the first one at the same place. It is computed at the first use.
    first: OnceCell<Vec<u32>>,
}

impl<'a> Places<'a> {
    pub(super) fn new(positions: &'a [[f64; 3]]) -> Self {
        let hash = |p: &[f64; 3]| bits(p).into_iter().fold(0, mixed);
        Self { positions, hashes: positions.iter().map(hash).collect(), first: OnceCell::new() }
    }

    /// Does every edge occur equally often in both directions? Then the surface has no border. The triangles contain
    /// indices of positions.
    pub(super) fn are_closed(&self, triangles: impl Iterator<Item = [u32; 3]> + Clone) -> bool {
        let edges = triangles.flat_map(|[a, b, c]| [(a, b), (b, c), (c, a)]);
        // The edge hashes of a closed surface cancel. So most open surfaces need no exact test.
        let (mut sum, mut with_length) = (0_u64, true);
        for (from, to) in edges.clone() {
            let (from, to) = (self.hash(from), self.hash(to));
            match from.cmp(&to) {
                Ordering::Less => sum = sum.wrapping_add(mixed(from, to)),
                Ordering::Equal => with_length = false,
                Ordering::Greater => sum = sum.wrapping_sub(mixed(to, from)),
            }
        }
        if sum != 0 {
            return false;
        }
        // If the surface is closed by its vertices, it is also closed by their places.
        (with_length && are_balanced(edges.clone())) || {
            let first = self.first.get_or_init(|| first_at_same_place(self.positions));
            are_balanced(edges.map(|(from, to)| (first[from as usize], first[to as usize])))
        }
    }

    fn hash(&self, position: u32) -> u64 {
        self.hashes.get(position as usize).copied().unwrap_or_default()
    }
}

/// Adding zero makes -0 and +0 the same bits.
fn bits(position: &[f64; 3]) -> [u64; 3] {
    position.map(|v| (v + 0.0).to_bits())
}

/// A step of a multiplicative hash; the multiplier is that of Knuth's 64-bit linear congruential generator MMIX.
fn mixed(hash: u64, value: u64) -> u64 {
    let product = (hash.rotate_left(29) ^ value).wrapping_mul(6_364_136_223_846_793_005);
    product ^ (product >> 32)
}

/// Are there edges, and does each occur equally often in both directions? An edge from a vertex to itself has one
/// direction only.
fn are_balanced(edges: impl Iterator<Item = (u32, u32)>) -> bool {
    let (mut forward, mut backward) = (Vec::new(), Vec::new());
    let key = |from: u32, to: u32| u64::from(from) << 32 | u64::from(to);
    for (from, to) in edges {
        if from < to { forward.push(key(from, to)) } else { backward.push(key(to, from)) }
    }
    if forward.is_empty() || forward.len() != backward.len() {
        return false;
    }
    forward.sort_unstable();
    backward.sort_unstable();
    forward == backward
}

fn first_at_same_place(positions: &[[f64; 3]]) -> Vec<u32> {
    let mut first: HashMap<[u64; 3], u32> = HashMap::with_capacity(positions.len());
    (0..).zip(positions).map(|(i, p)| *first.entry(bits(p)).or_insert(i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    const CORNERS: [[f64; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    fn closed(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> bool {
        Places::new(positions).are_closed(triangles.iter().copied())
    }

    #[test]
    fn a_tetrahedron_is_closed_until_a_face_is_missing_or_turned() {
        assert!(closed(&CORNERS, &TETRAHEDRON));
        assert!(closed(&CORNERS, &[TETRAHEDRON, TETRAHEDRON].concat()));
        assert!(!closed(&CORNERS, &TETRAHEDRON[1..]));
        assert!(!closed(&CORNERS, &[[0, 1, 2], [0, 1, 3], [1, 2, 3], [2, 0, 3]]));
        assert!(!closed(&CORNERS, &[]));
    }

    #[test]
    fn vertices_of_their_own_at_the_same_place_are_one() {
        let positions: Vec<[f64; 3]> = TETRAHEDRON.iter().flatten().map(|i| CORNERS[*i as usize]).collect();
        let triangles: Vec<[u32; 3]> = (0..4).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        assert!(closed(&positions, &triangles));
        let mut negative = positions.clone();
        negative[0] = [-0.0; 3];
        assert!(closed(&negative, &triangles));
        negative[0] = [-1e-300; 3];
        assert!(!closed(&negative, &triangles));
    }

    #[test]
    fn an_edge_without_length_leaves_a_surface_open() {
        let collapsed = [[0, 0, 1], [0, 1, 0]];
        assert!(!closed(&CORNERS, &collapsed));
    }
}
