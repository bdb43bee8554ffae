//! The convex hull of points of a grid, and the smallest rectangle around it.

/// Twice the area of a triangle: positive if its corners turn to the left.
pub(crate) fn turn(a: [i64; 2], b: [i64; 2], c: [i64; 2]) -> i64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// The corners of the convex hull, turning to the left (Andrew 1979, by monotone chains).
pub(crate) fn convex_hull(mut points: Vec<[i64; 2]>) -> Vec<[i64; 2]> {
    points.sort_unstable();
    points.dedup();
    let chain = |points: &mut dyn Iterator<Item = [i64; 2]>| {
        let mut chain: Vec<[i64; 2]> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..]
                && turn(a, b, point) <= 0
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}

/// The corners \[px\] of the rectangle with the smallest area around the corners of a convex hull, in one direction around it.
/// One of its sides contains an edge of the hull (Freeman and Shapira 1975). Rectangles that are wider or higher than `limits`
/// do not count, but the one along the axes does. `None` for a hull without an area.
pub(crate) fn smallest_rectangle(hull: &[[i64; 2]], limits: [u32; 2]) -> Option<[[f64; 2]; 4]> {
    if hull.len() < 3 {
        return None;
    }
    let edges = hull.iter().zip(hull.iter().cycle().skip(1)).map(|(a, b)| [b[0] - a[0], b[1] - a[1]]);
    let rectangle = |[x, y]: [i64; 2]| {
        let length = (x * x + y * y) as f64;
        // Coordinates along the edge and across it, in units of one over its length.
        let range = |[u, v]: [i64; 2]| {
            let along = hull.iter().map(|p| p[0] * u + p[1] * v);
            along.fold([i64::MAX, i64::MIN], |[low, high], value| [low.min(value), high.max(value)])
        };
        let ([a, b], [c, d]) = (range([x, y]), range([-y, x]));
        let corners = [[a, c], [b, c], [b, d], [a, d]];
        let corners = corners.map(|[s, t]| [s * x - t * y, s * y + t * x].map(|v| v as f64 / length));
        ((b - a) as f64 * (d - c) as f64 / length, corners)
    };
    let fits = |corners: &[[f64; 2]; 4]| {
        (0..2).all(|axis| {
            let values = corners.map(|corner| corner[axis]);
            let [low, high] =
                [values.iter().copied().fold(f64::MAX, f64::min), values.iter().copied().fold(f64::MIN, f64::max)];
            high - low <= f64::from(limits[axis])
        })
    };
    let turned = edges.map(rectangle).filter(|(_, corners)| fits(corners));
    let all = std::iter::once(rectangle([1, 0])).chain(turned);
    all.min_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, corners)| corners)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_sampling::mix64;

    /// The definition: the area of the rectangle of many directions, each by the projections of all points.
    #[test]
    fn no_direction_has_a_smaller_rectangle() {
        let random = |i: u64| (mix64(i) >> 20) as i64;
        for set in 0..40u64 {
            let points: Vec<[i64; 2]> =
                (0..3 + set).map(|i| [0, 1].map(|k| random(set << 20 | i << 1 | k) % 200)).collect();
            let hull = convex_hull(points.clone());
            let Some(corners) = smallest_rectangle(&hull, [1000, 1000]) else { continue };
            let side = |i: usize, j: usize| (corners[i][0] - corners[j][0]).hypot(corners[i][1] - corners[j][1]);
            let area = side(0, 1) * side(1, 2);
            for step in 0..1000 {
                let (sin, cos) = (f64::from(step) * std::f64::consts::FRAC_PI_2 / 1000.0).sin_cos();
                let extent = |u: f64, v: f64| {
                    let along = points.iter().map(|p| p[0] as f64 * u + p[1] as f64 * v);
                    let [low, high] = along.fold([f64::MAX, f64::MIN], |[l, h], a| [l.min(a), h.max(a)]);
                    high - low
                };
                assert!(extent(cos, sin) * extent(-sin, cos) >= area * (1.0 - 1e-12), "{set}, {step}");
            }
            // All points are inside, and the corners go around it.
            for (a, b) in (0..4).map(|i| (corners[i], corners[(i + 1) % 4])) {
                let inside =
                    |p: &[i64; 2]| (b[0] - a[0]) * (p[1] as f64 - a[1]) - (b[1] - a[1]) * (p[0] as f64 - a[0]) >= -1e-6;
                assert!(points.iter().all(inside), "{set}: {corners:?}");
            }
        }
    }

    #[test]
    fn a_rectangle_that_is_wider_than_the_image_is_none() {
        // The rectangle of a diamond is the diamond; that of a band along the diagonal is wider than the image.
        let diamond = convex_hull(vec![[5, 0], [10, 5], [5, 10], [0, 5]]);
        let corners = smallest_rectangle(&diamond, [10, 10]).expect("a rectangle");
        assert!(
            corners.iter().all(|c| diamond.iter().any(|p| c[0] == p[0] as f64 && c[1] == p[1] as f64)),
            "{corners:?}"
        );
        let band = convex_hull(vec![[0, 0], [4, 0], [10, 6], [10, 10], [6, 10], [0, 4]]);
        let along = smallest_rectangle(&band, [10, 10]).expect("a rectangle");
        assert!(along.iter().flatten().all(|v| *v == 0.0 || *v == 10.0), "{along:?}");
        assert!(smallest_rectangle(&band, [20, 20]).expect("a rectangle").iter().flatten().any(|v| *v < 0.0));
        assert_eq!(smallest_rectangle(&[[0, 0], [4, 0]], [9, 9]), None);
    }
}
