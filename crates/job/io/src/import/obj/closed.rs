//! Is the surface of a mesh closed? Vertices at the same place count as one: many exporters write a vertex once per face.

use std::collections::HashMap;

/// For each position, the first one at the same place.
pub(super) fn first_at_same_place(positions: &[[f64; 3]]) -> Vec<u32> {
    // Adding zero makes -0 and +0 the same bits.
    let bits = |p: &[f64; 3]| p.map(|v| (v + 0.0).to_bits());
    let mut first: HashMap<[u64; 3], u32> = HashMap::with_capacity(positions.len());
    (0..).zip(positions).map(|(i, p)| *first.entry(bits(p)).or_insert(i)).collect()
}

/// Does every edge occur equally often in both directions? Then the surface has no border. The triangles contain
/// indices of `first`, which [`first_at_same_place`] gives.
pub(super) fn are_closed(first: &[u32], triangles: impl Iterator<Item = [u32; 3]>) -> bool {
    let places = triangles.map(|t| t.map(|position| first[position as usize]));
    are_balanced(places.flat_map(|[a, b, c]| [(a, b), (b, c), (c, a)]))
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

#[cfg(test)]
mod tests {
    use super::*;

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    const CORNERS: [[f64; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    fn closed(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> bool {
        are_closed(&first_at_same_place(positions), triangles.iter().copied())
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
