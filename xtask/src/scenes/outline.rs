//! Plane curves: filleted polygons, rounded rectangles, and their triangulation.

use glam::DVec2;

/// Replaces each vertex that has a radius by an arc of `segments` chords that touches both its edges.
///
/// With `closed` the last vertex joins the first; otherwise the two ends stay as they are.
pub(crate) fn fillet(vertices: &[(DVec2, f64)], closed: bool, segments: usize) -> Vec<DVec2> {
    let n = vertices.len();
    let mut path = Vec::with_capacity(n * (segments + 1));
    for (i, &(vertex, radius)) in vertices.iter().enumerate() {
        let end = !closed && (i == 0 || i == n - 1);
        if end || radius <= 0.0 {
            path.push(vertex);
            continue;
        }
        let back = (vertices[(i + n - 1) % n].0 - vertex).normalize();
        let ahead = (vertices[(i + 1) % n].0 - vertex).normalize();
        let half = 0.5 * back.angle_to(ahead).abs();
        let centre = vertex + (back + ahead).normalize() * (radius / half.sin());
        let from = vertex + back * (radius / half.tan()) - centre;
        let to = vertex + ahead * (radius / half.tan()) - centre;
        let sweep = from.angle_to(to);
        for k in 0..=segments {
            let angle = sweep * k as f64 / segments as f64;
            path.push(centre + DVec2::from_angle(angle).rotate(from));
        }
    }
    path
}

/// A rectangle of half sizes `half` with rounded corners, counter-clockwise, `4 (segments + 1)` points.
pub(crate) fn rounded_rectangle(half: DVec2, radius: f64, segments: usize) -> Vec<DVec2> {
    let corner = |x: f64, y: f64| (half * DVec2::new(x, y), radius);
    fillet(&[corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0), corner(-1.0, -1.0)], true, segments)
}

/// A circle, counter-clockwise.
pub(crate) fn circle(radius: f64, points: usize) -> Vec<DVec2> {
    (0..points).map(|i| DVec2::from_angle(std::f64::consts::TAU * i as f64 / points as f64) * radius).collect()
}

/// Triangulates a simple counter-clockwise polygon by clipping, each time, the ear whose smallest angle is largest.
///
/// Two parts of it may run along one line. Cubic in the number of points, which is at most a few hundred here, and free of the needles that the first ear found
/// would leave.
pub(crate) fn triangulate(polygon: &[DVec2]) -> Vec<[u32; 3]> {
    let mut left: Vec<usize> = (0..polygon.len()).collect();
    let mut triangles = Vec::with_capacity(polygon.len().saturating_sub(2));
    while left.len() > 3 {
        let n = left.len();
        let best = (0..n)
            .filter_map(|i| {
                let ear = [left[(i + n - 1) % n], left[i], left[(i + 1) % n]];
                let [a, b, c] = ear.map(|k| polygon[k]);
                let free = (b - a).perp_dot(c - b) > 0.0
                    && left.iter().all(|k| [a, b, c].contains(&polygon[*k]) || !inside(polygon[*k], a, b, c));
                free.then(|| (quality(a, b, c), i, ear))
            })
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        let Some((_, i, ear)) = best else { break };
        triangles.push(ear.map(|k| k as u32));
        left.remove(i);
    }
    if let [a, b, c] = left[..] {
        triangles.push([a as u32, b as u32, c as u32]);
    }
    triangles
}

/// Area over squared perimeter: largest for an equilateral triangle, 0 for a needle.
fn quality(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    let perimeter = (b - a).length() + (c - b).length() + (a - c).length();
    (b - a).perp_dot(c - a) / (perimeter * perimeter)
}

fn inside(p: DVec2, a: DVec2, b: DVec2, c: DVec2) -> bool {
    (b - a).perp_dot(p - a) >= 0.0 && (c - b).perp_dot(p - b) >= 0.0 && (a - c).perp_dot(p - c) >= 0.0
}
