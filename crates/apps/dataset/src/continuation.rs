//! The part of an instance that its ring does not reach around, and the nearest pixels of the ring.

use crate::hull::convex_hull;
use crate::surroundings::Value;
use std::collections::BTreeMap;

/// The pixels of the instance outside of the convex hull of the ring, each with the mean of the pixels of the ring that are
/// nearest to it.
pub(crate) fn beyond<'a>(inside: &'a [Value], ring: &[Value]) -> Vec<(&'a Value, f64)> {
    if ring.is_empty() {
        return Vec::new();
    }
    let hull = convex_hull(ring.iter().map(|v| v.at).collect());
    let mut rows: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
    for (i, v) in inside.iter().enumerate() {
        rows.entry(v.at[1]).or_default().push(i);
    }
    let nearest = NearestRing::new(ring);
    let mut means: Vec<Option<f64>> = vec![None; inside.len()];
    for (y, pixels) in rows {
        let within = row_of_hull(&hull, y);
        for i in pixels {
            if within.is_none_or(|[from, to]| !(from..=to).contains(&inside[i].at[0])) {
                means[i] = Some(nearest.mean(inside[i].at));
            }
        }
    }
    inside.iter().zip(means).filter_map(|(v, mean)| Some((v, mean?))).collect()
}

/// The first and the last pixel of a row in a convex hull; the first is above the last if there is none. `None` for a
/// hull without an area.
fn row_of_hull(hull: &[[i64; 2]], y: i64) -> Option<[i64; 2]> {
    if hull.len() < 3 {
        return None;
    }
    let [mut from, mut to] = [i64::MIN, i64::MAX];
    for (a, b) in hull.iter().zip(hull.iter().cycle().skip(1)) {
        // A pixel of the row is on the left of the edge or on it: (b.x - a.x)(y - a.y) >= (b.y - a.y)(x - a.x).
        let (rise, across) = (b[1] - a[1], (b[0] - a[0]) * (y - a[1]));
        match rise.signum() {
            1 => to = to.min(a[0] + across.div_euclid(rise)),
            -1 => from = from.max(a[0] - across.div_euclid(-rise)),
            _ if across < 0 => return Some([1, 0]),
            _ => {}
        }
    }
    Some([from, to])
}

/// The pixels of a ring by their rows, each row in ascending order of x.
struct NearestRing<'a> {
    ring: &'a [Value],
    /// x and index of the pixels of each row.
    rows: BTreeMap<i64, Vec<(i64, usize)>>,
}

impl<'a> NearestRing<'a> {
    fn new(ring: &'a [Value]) -> Self {
        let mut rows: BTreeMap<i64, Vec<(i64, usize)>> = BTreeMap::new();
        for (i, v) in ring.iter().enumerate() {
            rows.entry(v.at[1]).or_default().push((v.at[0], i));
        }
        rows.values_mut().for_each(|row| row.sort_unstable());
        Self { ring, rows }
    }

    /// The mean of the pixels of the ring that are nearest to a pixel outside of it. Rows are searched from that of the pixel,
    /// until they are farther away than the nearest pixel.
    fn mean(&self, [x, y]: [i64; 2]) -> f64 {
        let (mut least, mut found) = (i64::MAX, Vec::new());
        let mut above = self.rows.range(..y).rev().map(|(row, pixels)| (y - row, pixels));
        let mut below = self.rows.range(y..).map(|(row, pixels)| (row - y, pixels));
        let mut search = |(rise, pixels): (i64, &Vec<(i64, usize)>)| {
            let next = pixels.partition_point(|(at, _)| *at < x);
            for (at, i) in [next.checked_sub(1), Some(next)].into_iter().flatten().filter_map(|k| pixels.get(k)) {
                let distance = (at - x).pow(2) + rise.pow(2);
                if distance < least {
                    (least, found) = (distance, Vec::new());
                }
                if distance == least {
                    found.push(*i);
                }
            }
            rise.pow(2) <= least
        };
        let _ = above.all(&mut search);
        let _ = below.all(&mut search);
        // In the order of the ring: sums of floats depend on it.
        found.sort_unstable();
        found.iter().map(|i| self.ring[*i].value).sum::<f64>() / found.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::turn;
    use dunkelfeld_sampling::mix64;

    /// The definition: each pixel against all edges of the hull and all pixels of the ring.
    fn direct(inside: &[Value], ring: &[Value]) -> Vec<([i64; 2], u64)> {
        let hull = convex_hull(ring.iter().map(|v| v.at).collect());
        let is_beyond = |at: [i64; 2]| {
            let next = hull.iter().cycle().skip(1);
            hull.len() < 3 || hull.iter().zip(next).any(|(a, b)| turn(*a, *b, at) < 0)
        };
        let distance = |a: [i64; 2], b: [i64; 2]| (a[0] - b[0]).pow(2) + (a[1] - b[1]).pow(2);
        let of = |v: &Value| {
            let least = ring.iter().map(|r| distance(r.at, v.at)).min()?;
            let nearest: Vec<f64> = ring.iter().filter(|r| distance(r.at, v.at) == least).map(|r| r.value).collect();
            Some((v.at, (nearest.iter().sum::<f64>() / nearest.len() as f64).to_bits()))
        };
        inside.iter().filter(|v| is_beyond(v.at)).filter_map(of).collect()
    }

    fn values(side: i64, is_in: impl Fn(i64, i64) -> bool) -> Vec<Value> {
        let pixels = (0..side * side).map(|i| [i % side, i / side]).filter(|[x, y]| is_in(*x, *y));
        pixels
            .map(|at| Value { at, value: (mix64((at[1] * side + at[0]) as u64) >> 40) as f64 / 7.0, variance: None })
            .collect()
    }

    /// Rings of all kinds: with corners, on a line, of a single pixel, on circles with many pixels at one distance, of every
    /// second pixel as behind a colour filter array, and random ones. The results have the same bits.
    #[test]
    fn the_nearest_pixels_are_those_of_the_direct_search() {
        const SIDE: i64 = 41;
        let random = |seed: u64, x: i64, y: i64| mix64(seed << 32 | (y * SIDE + x) as u64);
        let of_circle = |x: i64, y: i64| [25 * 25, 400, 50].contains(&((x - 20).pow(2) + (y - 20).pow(2)));
        let mut rings = vec![
            values(SIDE, |x, y| x == 36 && y > 3 || y == 36 && x > 3),
            values(SIDE, |x, y| x < 4 && y < 30 || y < 4),
            values(SIDE, |x, _| x == 12),
            values(SIDE, |_, y| y == 25),
            values(SIDE, |x, y| x == y),
            values(SIDE, |x, y| x == 7 && y == 31),
            values(SIDE, |x, y| of_circle(x, y) && y > 20),
            values(SIDE, of_circle),
            values(SIDE, |x, y| (x < 5 || x + y > 70) && x % 2 == 1 && y % 2 == 0),
        ];
        rings.extend((0..40).map(|seed| values(SIDE, |x, y| random(seed, x, y) % (2 + 30 * seed) == 0)));
        let mut count = 0;
        for ring in rings.iter().filter(|ring| !ring.is_empty()) {
            let is_ring = |x: i64, y: i64| ring.iter().any(|v| v.at == [x, y]);
            let inside = values(SIDE, |x, y| !is_ring(x, y) && random(99, x, y) % 8 != 0);
            let found: Vec<([i64; 2], u64)> =
                beyond(&inside, ring).iter().map(|(v, mean)| (v.at, mean.to_bits())).collect();
            assert_eq!(found, direct(&inside, ring));
            count += found.len();
        }
        assert!(count > 10_000, "{count}");
        assert!(beyond(&values(5, |_, _| true), &[]).is_empty());
    }

    /// An instance of a quarter of a million pixels in the corner of an image. The ring is to its left and above it, four pixels
    /// wide.
    #[test]
    fn the_nearest_pixels_of_a_large_instance_are_on_its_sides() {
        const SIDE: i64 = 500;
        let inside = values(SIDE, |x, y| x > 5 && y > 5);
        let ring = values(SIDE, |x, y| x < 4 || y < 4);
        let value = |x: i64, y: i64| (mix64((y * SIDE + x) as u64) >> 40) as f64 / 7.0;
        let found = beyond(&inside, &ring);
        // Beyond the diagonal from corner to corner.
        assert_eq!(found.len(), inside.iter().filter(|v| v.at[0] + v.at[1] > SIDE - 1 + 3).count());
        for (v, mean) in found {
            let [x, y] = v.at;
            let expected = match x.cmp(&y) {
                std::cmp::Ordering::Less => value(3, y),
                std::cmp::Ordering::Greater => value(x, 3),
                std::cmp::Ordering::Equal => (value(x, 3) + value(3, y)) / 2.0,
            };
            assert_eq!(mean.to_bits(), expected.to_bits(), "{x}, {y}");
        }
    }
}
