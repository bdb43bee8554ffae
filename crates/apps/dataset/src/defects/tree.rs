//! A bounding volume hierarchy in f64 over a few triangles, for projections and distances.

use dunkelfeld_geometry::DVec3;

/// Largest number of triangles of a leaf.
const LEAF: usize = 4;

/// A node. The children of an inner node are the next node and the node `right`.
struct Node {
    low: DVec3,
    high: DVec3,
    /// First entry of `order`, for a leaf.
    first: usize,
    /// Number of entries, 0 for an inner node.
    count: usize,
    right: usize,
}

/// The hierarchy: median splits along the longest axis of the centroids.
pub(super) struct Tree {
    nodes: Vec<Node>,
    order: Vec<usize>,
}

impl Tree {
    /// A tree over triangles, whose indices it stores.
    pub(super) fn new(triangles: &[[DVec3; 3]]) -> Self {
        let centers: Vec<DVec3> = triangles.iter().map(|[a, b, c]| (a + b + c) / 3.0).collect();
        let mut tree = Self { nodes: Vec::new(), order: (0..triangles.len()).collect() };
        if !triangles.is_empty() {
            tree.split(triangles, &centers, 0, triangles.len());
        }
        tree
    }

    fn split(&mut self, triangles: &[[DVec3; 3]], centers: &[DVec3], first: usize, end: usize) {
        let entries = &mut self.order[first..end];
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut from, mut to) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &i in entries.iter() {
            for corner in &triangles[i] {
                (low, high) = (low.min(*corner), high.max(*corner));
            }
            (from, to) = (from.min(centers[i]), to.max(centers[i]));
        }
        let node = self.nodes.len();
        let count = end - first;
        self.nodes.push(Node { low, high, first, count, right: 0 });
        if count <= LEAF {
            return;
        }
        let size = to - from;
        let axis = if size.x >= size.y.max(size.z) { 0 } else { 1 + usize::from(size.y < size.z) };
        let half = count / 2;
        // Equal coordinates are ordered by index, so that the tree does not depend on the selection algorithm.
        entries.select_nth_unstable_by(half, |a, b| centers[*a][axis].total_cmp(&centers[*b][axis]).then(a.cmp(b)));
        self.nodes[node].count = 0;
        self.split(triangles, centers, first, first + half);
        self.nodes[node].right = self.nodes.len();
        self.split(triangles, centers, first + half, end);
    }

    /// Visits the triangles in the boxes that `step` accepts. It is called with each box, and with each triangle of an
    /// accepted leaf. The result counts for boxes only.
    pub(super) fn visit(&self, mut step: impl FnMut(Step) -> bool) {
        let mut stack = vec![0];
        while let Some(index) = stack.pop() {
            let Some(node) = self.nodes.get(index) else { continue };
            if !step(Step::Box(node.low, node.high)) {
                continue;
            }
            if node.count == 0 {
                stack.extend([node.right, index + 1]);
            }
            for &triangle in &self.order[node.first..node.first + node.count] {
                step(Step::Triangle(triangle));
            }
        }
    }
}

/// A step of [`Tree::visit`].
pub(super) enum Step {
    /// Lowest and highest corner of a box.
    Box(DVec3, DVec3),
    /// Index of a triangle.
    Triangle(usize),
}

/// True if the segment from `from` to `from + way` meets the box (slab test; Kay and Kajiya 1986). Rounding can only
/// make the box larger.
pub(super) fn segment_meets_box(from: DVec3, way: DVec3, low: DVec3, high: DVec3) -> bool {
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    let margin = 1e-12 * (low.abs().max(high.abs()).max_element() + from.abs().max_element());
    for k in 0..3 {
        let (a, b) = (low[k] - margin - from[k], high[k] + margin - from[k]);
        if way[k] == 0.0 {
            if a > 0.0 || b < 0.0 {
                return false;
            }
            continue;
        }
        let (s, t) = (a / way[k], b / way[k]);
        enter = enter.max(s.min(t));
        leave = leave.min(s.max(t));
    }
    enter <= leave + 1e-12
}

/// The parameter in [0, 1] and the weights of the corners where a segment meets a triangle (Moeller and Trumbore
/// 1997). The triangle is larger by a millionth of a millionth, so that no segment passes between two triangles.
pub(super) fn segment_meets_triangle(from: DVec3, way: DVec3, [a, b, c]: &[DVec3; 3]) -> Option<(f64, [f64; 3])> {
    let (u, v) = (b - a, c - a);
    let p = way.cross(v);
    let det = u.dot(p);
    let s = from - a;
    let q = s.cross(u);
    let (t, v1, v2) = (v.dot(q) / det, s.dot(p) / det, way.dot(q) / det);
    let range = -1e-12..=1.0 + 1e-12;
    let weights = [1.0 - v1 - v2, v1, v2];
    let inside = det != 0.0 && range.contains(&t) && weights.iter().all(|w| *w >= -1e-12);
    inside.then_some((t, weights))
}

/// The distance between a point and a triangle (Ericson 2005, section 5.1.5: the regions of Voronoi).
pub(super) fn distance_to_triangle(p: DVec3, &[a, b, c]: &[DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a);
    let inside = |from: DVec3, to: DVec3| normal.cross(to - from).dot(p - from) >= 0.0;
    if normal != DVec3::ZERO && inside(a, b) && inside(b, c) && inside(c, a) {
        return ((p - a).dot(normal) / normal.length()).abs();
    }
    let edge = |from: DVec3, to: DVec3| {
        let way = to - from;
        let square = way.length_squared();
        let t = if square > 0.0 { ((p - from).dot(way) / square).clamp(0.0, 1.0) } else { 0.0 };
        p.distance(from + t * way)
    };
    edge(a, b).min(edge(b, c)).min(edge(c, a))
}

/// The distance between a point and a box; 0 inside.
pub(super) fn distance_to_box(p: DVec3, low: DVec3, high: DVec3) -> f64 {
    p.distance(p.clamp(low, high))
}
