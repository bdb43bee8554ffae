//! The part of an instance that its ring does not reach around, and the nearest pixels of the ring.

use crate::surroundings::Value;
use std::collections::BTreeMap;

/// The pixels of the instance outside of the convex hull of the ring, each with the mean of the pixels of the ring that are
/// nearest to it. The time is linear in the pixels of the box around both.
pub(crate) fn beyond<'a>(inside: &'a [Value], ring: &[Value]) -> Vec<(&'a Value, f64)> {
    if ring.is_empty() {
        return Vec::new();
    }
    let hull = convex_hull(ring.iter().map(|v| v.at).collect());
    let mut rows: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
    for (i, v) in inside.iter().enumerate() {
        rows.entry(v.at[1]).or_default().push(i);
    }
    let mut nearest = NearestRing::new(ring);
    let mut means: Vec<Option<f64>> = vec![None; inside.len()];
    for (y, mut pixels) in rows {
        let within = row_of_hull(&hull, y);
        pixels.retain(|i| within.is_none_or(|[from, to]| !(from..=to).contains(&inside[*i].at[0])));
        if pixels.is_empty() {
            continue;
        }
        pixels.sort_unstable_by_key(|i| inside[*i].at[0]);
        nearest.enter(y);
        for i in pixels {
            means[i] = Some(nearest.mean(inside[i].at[0]));
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

/// The squared distance to the ring along a row, as the lower envelope of parabolas (Felzenszwalb and Huttenlocher 2012).
/// Each has its vertex in a column of the ring, at the squared distance of the nearest pixel of the column. Parabolas that
/// touch the envelope in one point are kept, so that all pixels at the least distance are found.
struct NearestRing<'a> {
    ring: &'a [Value],
    /// Each column with pixels of the ring: its x, and the indices of these pixels in the order of their rows.
    columns: Vec<(i64, Vec<usize>)>,
    /// The first pixel of each column that is not above the row.
    next: Vec<usize>,
    y: i64,
    /// The columns of the envelope, each with the squared distance in the column.
    envelope: Vec<(usize, i64)>,
    /// The first entry of the envelope that is the least one at the last x.
    at: usize,
    /// The nearest pixels.
    found: Vec<usize>,
}

impl<'a> NearestRing<'a> {
    fn new(ring: &'a [Value]) -> Self {
        let mut columns: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
        for (i, v) in ring.iter().enumerate() {
            columns.entry(v.at[0]).or_default().push(i);
        }
        let mut columns: Vec<(i64, Vec<usize>)> = columns.into_iter().collect();
        columns.iter_mut().for_each(|(_, pixels)| pixels.sort_by_key(|i| ring[*i].at[1]));
        let next = vec![0; columns.len()];
        Self { ring, columns, next, y: i64::MIN, envelope: Vec::new(), at: 0, found: Vec::new() }
    }

    /// The pixels of a column above the row and not above it that are nearest to it.
    fn neighbours(&self, column: usize) -> [Option<usize>; 2] {
        let (pixels, next) = (&self.columns[column].1, self.next[column]);
        [next.checked_sub(1).and_then(|i| pixels.get(i)).copied(), pixels.get(next).copied()]
    }

    /// Squared distance of a pixel of the ring from the row.
    fn height(&self, pixel: usize) -> i64 {
        (self.ring[pixel].at[1] - self.y).pow(2)
    }

    /// Makes the envelope of a row. Rows are entered from the top.
    fn enter(&mut self, y: i64) {
        (self.y, self.at) = (y, 0);
        self.envelope.clear();
        for column in 0..self.columns.len() {
            let pixels = &self.columns[column].1;
            let next = &mut self.next[column];
            while pixels.get(*next).is_some_and(|i| self.ring[*i].at[1] < y) {
                *next += 1;
            }
            let Some(height) = self.neighbours(column).into_iter().flatten().map(|i| self.height(i)).min() else {
                continue;
            };
            while let [.., a, b] = self.envelope[..]
                && self.is_above(a, b, (column, height))
            {
                self.envelope.pop();
            }
            self.envelope.push((column, height));
        }
    }

    /// Is the parabola of b above those of a and c everywhere?
    fn is_above(&self, a: (usize, i64), b: (usize, i64), c: (usize, i64)) -> bool {
        let point = |(column, height): (usize, i64)| {
            let x = self.columns[column].0;
            (x, height + x * x)
        };
        let ((ax, a), (bx, b), (cx, c)) = (point(a), point(b), point(c));
        // b leaves the envelope if it falls below a only after c has fallen below it.
        (b - a) * (cx - bx) > (c - b) * (bx - ax)
    }

    /// Squared distance of an entry of the envelope at a place of the row.
    fn distance(&self, entry: usize, x: i64) -> Option<i64> {
        let (column, height) = *self.envelope.get(entry)?;
        Some((x - self.columns[column].0).pow(2) + height)
    }

    /// The mean of the pixels of the ring that are nearest to a pixel of the row. Pixels are visited from the left.
    fn mean(&mut self, x: i64) -> f64 {
        let Some(mut least) = self.distance(self.at, x) else { return 0.0 };
        while let Some(distance) = self.distance(self.at + 1, x).filter(|distance| *distance < least) {
            (self.at, least) = (self.at + 1, distance);
        }
        self.found.clear();
        let mut entry = self.at;
        while self.distance(entry, x) == Some(least) {
            let (column, height) = self.envelope[entry];
            for pixel in self.neighbours(column).into_iter().flatten() {
                if self.height(pixel) == height {
                    self.found.push(pixel);
                }
            }
            entry += 1;
        }
        // In the order of the ring: sums of floats depend on it.
        self.found.sort_unstable();
        self.found.iter().map(|i| self.ring[*i].value).sum::<f64>() / self.found.len() as f64
    }
}

/// Twice the area of a triangle: positive if its corners turn to the left.
fn turn(a: [i64; 2], b: [i64; 2], c: [i64; 2]) -> i64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// The corners of the convex hull, turning to the left (Andrew 1979, by monotone chains).
fn convex_hull(mut points: Vec<[i64; 2]>) -> Vec<[i64; 2]> {
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

#[cfg(test)]
mod tests {
    use super::*;
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

    /// An instance of a million pixels in the corner of an image, which a search in all pixels of the ring takes minutes for.
    /// The ring is to its left and above it, four pixels wide.
    #[test]
    fn the_nearest_pixels_of_a_large_instance_are_on_its_sides() {
        const SIDE: i64 = 1000;
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
