//! Triangulation of polygons, also concave ones: ear clipping in the plane of Newell's normal.

use dunkelfeld_geometry::DVec3;
use earcut::Earcut;

/// Maximum number of corners: ear clipping is quadratic for hostile outlines, and no usual polygon is that large.
const MOST_CORNERS: usize = 20_000;

/// The result of a polygon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// It was triangulated.
    Done,
    /// It has no area.
    Degenerate,
    /// It has too many corners.
    TooLarge,
}

/// Triangulates polygons; keeps its work buffers between them.
#[derive(Default)]
pub(crate) struct Triangulator {
    earcut: Earcut<f64>,
    flat: Vec<[f64; 2]>,
    ears: Vec<u32>,
}

impl Triangulator {
    /// Appends the triangles of a polygon, as positions within `points`, with the winding of the polygon. Triangles
    /// without area are left out.
    pub(crate) fn triangulate(&mut self, points: &[DVec3], out: &mut Vec<[u32; 3]>) -> Outcome {
        if points.len() > MOST_CORNERS {
            return Outcome::TooLarge;
        }
        let Some(normal) = newell_normal(points) else { return Outcome::Degenerate };
        if points.len() == 3 {
            out.push([0, 1, 2]);
            return Outcome::Done;
        }
        self.project(points, normal);
        if let [a, b, c, d] = points
            && let (first, second) = self.diagonals()
            && (first || second)
        {
            // The shorter diagonal makes a smaller fold in a quad that is not planar.
            let shorter = a.distance_squared(*c) <= b.distance_squared(*d);
            let split = if first && (shorter || !second) { [[0, 1, 2], [0, 2, 3]] } else { [[0, 1, 3], [1, 2, 3]] };
            out.extend(split);
            return Outcome::Done;
        }
        self.ears.clear();
        self.earcut.earcut(self.flat.iter().copied(), &[], &mut self.ears);
        let before = out.len();
        for ear in self.ears.chunks_exact(3) {
            // The outline runs counter-clockwise in the projection, so its triangles must too.
            let triangle = [ear[0], ear[1], ear[2]];
            match self.area(triangle.map(|i| i as usize)) {
                area if area > 0.0 => out.push(triangle),
                area if area < 0.0 => out.push([ear[0], ear[2], ear[1]]),
                _ => {}
            }
        }
        if out.len() == before { Outcome::Degenerate } else { Outcome::Done }
    }

    /// Coordinates in the plane across `normal`, scaled to order one, so that products neither underflow nor overflow.
    fn project(&mut self, points: &[DVec3], normal: DVec3) {
        let (u, v) = normal.any_orthonormal_pair();
        let origin = points[0];
        let extent = points.iter().map(|p| (*p - origin).abs().max_element()).fold(0.0, f64::max);
        let scale = if extent > 0.0 { 1.0 / extent } else { 1.0 };
        // any_orthonormal_pair does not guarantee a handedness.
        let v = if u.cross(v).dot(normal) < 0.0 { -v } else { v };
        self.flat.clear();
        self.flat.extend(points.iter().map(|p| [(*p - origin).dot(u) * scale, (*p - origin).dot(v) * scale]));
    }

    /// Twice the signed area of a triangle of projected points.
    fn area(&self, [a, b, c]: [usize; 3]) -> f64 {
        let [a, b, c] = [self.flat[a], self.flat[b], self.flat[c]];
        (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
    }

    /// For four points: do the diagonals 0-2 and 1-3 split them into two triangles of positive area?
    fn diagonals(&self) -> (bool, bool) {
        let inside = |t: [usize; 3]| self.area(t) > 1e-12;
        (inside([0, 1, 2]) && inside([0, 2, 3]), inside([0, 1, 3]) && inside([1, 2, 3]))
    }
}

/// Unit normal of a polygon by Newell's method (Sutherland, Sproull, Schumacker 1974): twice its area vector. `None` if
/// the polygon has no area.
pub(crate) fn newell_normal(points: &[DVec3]) -> Option<DVec3> {
    let origin = *points.first()?;
    // Relative to a corner, so that a polygon far from the origin keeps its precision.
    let (mut sum, mut extent) = (DVec3::ZERO, 0.0_f64);
    for (i, point) in points.iter().enumerate() {
        let next = points[(i + 1) % points.len()];
        let (a, b) = (*point - origin, next - origin);
        sum += a.cross(b);
        extent = extent.max(a.length_squared());
    }
    // Below the rounding of the cross products the direction is noise.
    (sum.length() > 1e-14 * extent && extent > 0.0).then(|| sum.normalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area_vector(points: &[DVec3], triangles: &[[u32; 3]]) -> (DVec3, f64) {
        let areas = triangles.iter().map(|t| {
            let [a, b, c] = t.map(|i| points[i as usize]);
            (b - a).cross(c - a) * 0.5
        });
        areas.fold((DVec3::ZERO, 0.0), |(v, s), a| (v + a, s + a.length()))
    }

    fn check(points: &[DVec3], area: f64) {
        let mut out = Vec::new();
        assert_eq!(Triangulator::default().triangulate(points, &mut out), Outcome::Done);
        let (vector, sum) = area_vector(points, &out);
        // Equal sums mean that all triangles wind the same way and none covers another.
        assert!((sum - area).abs() < 1e-9 * area, "area {sum} instead of {area}: {out:?}");
        assert!((vector.length() - area).abs() < 1e-9 * area, "{vector} {out:?}");
        assert!(vector.dot(newell_normal(points).expect("has area")) > 0.0, "turned over: {out:?}");
    }

    /// An L and a star, viewed along each axis and wound in both directions.
    #[test]
    fn concave_polygons_keep_area_and_winding() {
        let l: &[[f64; 2]] = &[[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]];
        let arrow: &[[f64; 2]] = &[[0.0, 0.0], [2.0, 1.0], [0.0, 2.0], [0.5, 1.0]];
        for (outline, area) in [(l, 5.0), (arrow, 1.5)] {
            for start in 0..outline.len() {
                for place in [|x, y| DVec3::new(x, y, 7.0), |x, y| DVec3::new(-4e5, x, y), |x, y| DVec3::new(y, 0.0, x)]
                {
                    let mut points: Vec<DVec3> =
                        outline.iter().cycle().skip(start).take(outline.len()).map(|p| place(p[0], p[1])).collect();
                    check(&points, area);
                    points.reverse();
                    check(&points, area);
                }
            }
        }
    }

    #[test]
    fn convex_quads_split_along_the_shorter_diagonal() {
        let points = [[0.0, 0.0], [3.0, 0.0], [4.0, 1.0], [1.0, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
        let mut out = Vec::new();
        Triangulator::default().triangulate(&points, &mut out);
        assert_eq!(out, [[0, 1, 3], [1, 2, 3]]);
    }

    #[test]
    fn polygons_without_area_are_distinguished() {
        let mut out = Vec::new();
        let mut t = Triangulator::default();
        for points in [
            [DVec3::ONE; 4].as_slice(),
            &[DVec3::ZERO, DVec3::X, DVec3::X * 2.0],
            &[DVec3::ZERO, DVec3::X, DVec3::ZERO, DVec3::X],
        ] {
            assert_eq!(t.triangulate(points, &mut out), Outcome::Degenerate);
        }
        assert_eq!(t.triangulate(&vec![DVec3::X; MOST_CORNERS + 1], &mut out), Outcome::TooLarge);
        assert!(out.is_empty());
    }
}
