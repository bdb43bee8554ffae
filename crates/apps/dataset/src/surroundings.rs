//! The surroundings of an instance: the pixels around it, and the values that they predict for it.

use crate::continuation::beyond;
use crate::surface_path::{SurfacePath, Surfaces};
use crate::visibility::Bounds;
use dunkelfeld_film::Plane;
use std::collections::BTreeMap;

/// Distances of the surroundings from the instance \[pixels\], along rows and columns: farther than the first, at most the
/// second.
pub(crate) const RING: [i64; 2] = [1, 5];

/// Fewest pixels of one colour in the ring of a defect, for a plane ...
pub(crate) const LEAST_PLANE: usize = 12;
/// ... and for a polynomial of the second degree.
const LEAST_SQUARE: usize = 24;
/// Scatter is structure beyond this number of standard deviations of its own.
const SIGNIFICANT: f64 = 2.0;

/// A box of pixels around an instance.
struct Window {
    from: [i64; 2],
    columns: usize,
    rows: usize,
}

impl Window {
    /// The pixels within the ring and one more, inside of the image.
    fn around(bounds: Bounds, [width, height]: [i64; 2]) -> Self {
        let [x0, y0] = bounds.from.map(|v| (i64::from(v) - RING[1] - 1).max(0));
        let [x1, y1] = bounds.to.map(|v| i64::from(v) + RING[1] + 1);
        let (columns, rows) = ((x1.min(width) - x0).max(0), (y1.min(height) - y0).max(0));
        Self { from: [x0, y0], columns: columns as usize, rows: rows as usize }
    }

    fn pixel(&self, k: usize) -> [i64; 2] {
        [self.from[0] + (k % self.columns) as i64, self.from[1] + (k / self.columns) as i64]
    }

    /// The pixels at the edges and corners of a pixel.
    fn beside(&self, k: usize) -> impl Iterator<Item = usize> + '_ {
        let (x, y) = (k % self.columns, k / self.columns);
        let rows = y.saturating_sub(1)..(y + 2).min(self.rows);
        rows.flat_map(move |ny| (x.saturating_sub(1)..(x + 2).min(self.columns)).map(move |nx| ny * self.columns + nx))
    }
}

/// The pixels of an instance and of its ring.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Surroundings {
    pub(crate) inside: Vec<[i64; 2]>,
    pub(crate) ring: Vec<[i64; 2]>,
}

impl Surroundings {
    /// The pixels of an instance, and those of its ring that are none of the `is_excluded` instances.
    ///
    /// With `surfaces`, the ring contains only pixels of the smooth surface that carries the instance and is connected to
    /// it, seen through the same covers. Pixels beside another surface are left out of both: a part of them may show it.
    pub(crate) fn new(
        instances: &Plane<u16>,
        id: u16,
        bounds: Bounds,
        is_excluded: impl Fn(u16) -> bool,
        surfaces: Option<Surfaces<'_>>,
    ) -> Self {
        let size = [instances.width(), instances.height()].map(i64::from);
        let window = Window::around(bounds, size);
        let index = |k: usize| {
            let [x, y] = window.pixel(k);
            (y * size[0] + x) as usize
        };
        let pixels = window.columns * window.rows;
        let mut inside: Vec<bool> = (0..pixels).map(|k| instances.data()[index(k)] == id).collect();
        let near = dilated(&inside, window.columns, RING[0] as usize);
        let far = dilated(&inside, window.columns, RING[1] as usize);
        let mut ring: Vec<bool> =
            (0..pixels).map(|k| far[k] && !near[k] && !is_excluded(instances.data()[index(k)])).collect();
        if let Some(surfaces) = surfaces {
            let paths: Vec<SurfacePath> = (0..pixels).map(|k| surfaces.at(index(k), id)).collect();
            restrict(&window, &paths, &mut inside, &mut ring);
        }
        let of = |mask: &[bool]| (0..pixels).filter(|k| mask[*k]).map(|k| window.pixel(k)).collect();
        Self { inside: of(&inside), ring: of(&ring) }
    }
}

/// Leaves only the pixels of the surface that carries the instance.
fn restrict(window: &Window, paths: &[SurfacePath], inside: &mut [bool], ring: &mut [bool]) {
    let is_plain = |k: &usize| !paths[*k].is_bent && !paths[*k].is_covered;
    let own: Vec<usize> = (0..paths.len()).filter(|k| inside[*k]).collect();
    let around = || (0..paths.len()).filter(|k| ring[*k]).filter(is_plain);
    // Where the instance hides its surface or bends the rays, the ring shows what is below it.
    let first = most(own.iter().filter(|k| !paths[**k].is_bent).map(|k| paths[*k].first));
    let host = most(own.iter().copied().filter(is_plain).map(|k| paths[k].path)).or_else(|| {
        most(around().filter(|k| first.is_none_or(|first| paths[*k].first == first)).map(|k| paths[k].path))
    });
    let Some(host) = host else {
        inside.fill(false);
        ring.fill(false);
        return;
    };
    let host_first = paths.iter().find(|p| p.path == host && !p.is_bent && !p.is_covered).map(|p| p.first);
    let is_passed = |k: usize| paths[k].is_bent || (paths[k].is_covered && Some(paths[k].first) == host_first);
    let mut reached = vec![false; paths.len()];
    let mut open: Vec<usize> = own.iter().copied().filter(|k| is_passed(*k) || paths[*k].path == host).collect();
    // Of a surface with an edge below the instance, the side with the most pixels counts.
    open.sort_unstable();
    let mut parts: Vec<(usize, Vec<usize>)> = Vec::new();
    for start in open {
        if reached[start] {
            continue;
        }
        reached[start] = true;
        let (mut stack, mut part, mut own_pixels) = (vec![start], Vec::new(), 0);
        while let Some(k) = stack.pop() {
            part.push(k);
            own_pixels += usize::from(inside[k]);
            for next in window.beside(k) {
                let goes_on = is_passed(next)
                    || (paths[next].path == host && (is_passed(k) || paths[k].continues_in(&paths[next])));
                if goes_on && !reached[next] {
                    reached[next] = true;
                    stack.push(next);
                }
            }
        }
        parts.push((own_pixels, part));
    }
    let mut is_host = vec![false; paths.len()];
    if let Some((_, part)) = parts.iter().max_by_key(|(own_pixels, _)| *own_pixels) {
        part.iter().for_each(|k| is_host[*k] = true);
    }
    let is_pure = |k: usize| is_host[k] && window.beside(k).all(|next| is_host[next]);
    for k in 0..paths.len() {
        inside[k] &= is_pure(k) || (is_host[k] && is_passed(k));
        ring[k] &= is_pure(k) && is_plain(&k);
    }
}

/// The most frequent value; of equal ones the lowest.
fn most(values: impl Iterator<Item = u32>) -> Option<u32> {
    let mut counts: BTreeMap<u32, u64> = BTreeMap::new();
    values.for_each(|value| *counts.entry(value).or_default() += 1);
    counts.into_iter().max_by_key(|(value, count)| (*count, std::cmp::Reverse(*value))).map(|(value, _)| value)
}

/// The pixels within a distance of others, along rows and columns.
fn dilated(mask: &[bool], columns: usize, distance: usize) -> Vec<bool> {
    let Some(rows) = mask.len().checked_div(columns) else { return Vec::new() };
    let mut wide = vec![false; mask.len()];
    for y in 0..rows {
        let row = &mask[y * columns..(y + 1) * columns];
        for x in (0..columns).filter(|x| row[*x]) {
            wide[y * columns + x.saturating_sub(distance)..=y * columns + (x + distance).min(columns - 1)].fill(true);
        }
    }
    let mut all = vec![false; mask.len()];
    for y in 0..rows {
        for x in (0..columns).filter(|x| wide[y * columns + x]) {
            for to in y.saturating_sub(distance)..=(y + distance).min(rows - 1) {
                all[to * columns + x] = true;
            }
        }
    }
    all
}

/// A pixel with a value and the variance of its estimate; `None` if that is unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Value {
    pub(crate) at: [i64; 2],
    pub(crate) value: f64,
    pub(crate) variance: Option<f64>,
}

/// The mean of an instance less that of its surroundings, and its variance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Difference {
    pub(crate) value: f64,
    /// Variance of `value`; `None` if it is unknown.
    pub(crate) variance: Option<f64>,
    /// The mean that the surroundings predict for the pixels of the instance.
    pub(crate) below: f64,
    /// The least and the largest value of the surroundings.
    pub(crate) range: [f64; 2],
}

/// The least and the largest value.
fn range_of(values: &[Value]) -> [f64; 2] {
    let all = || values.iter().map(|v| v.value);
    [all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max)]
}

/// The mean of the instance less the mean of the ring.
pub(crate) fn difference_of_means(inside: &[Value], ring: &[Value]) -> Option<Difference> {
    let mean = |values: &[Value]| {
        let n = values.len() as f64;
        let variance: Option<f64> = values.iter().map(|v| v.variance).sum();
        (!values.is_empty()).then(|| (values.iter().map(|v| v.value).sum::<f64>() / n, variance.map(|v| v / (n * n))))
    };
    let ((inside, of_inside), (below, of_ring)) = (mean(inside)?, mean(ring)?);
    Some(Difference {
        value: inside - below,
        variance: of_inside.zip(of_ring).map(|(a, b)| a + b),
        below,
        range: range_of(ring),
    })
}

/// The mean of the instance less the prediction of a polynomial in x and y, which is fitted to the ring by least squares.
/// The variance contains that of the fit. Scatter of the ring about the polynomial that is
/// significantly beyond its variance is structure of the surface. The fit may be off by as much below the instance, so that
/// it is added as a whole: structure of neighbouring pixels does not average out. `None` with fewer than [`LEAST_PLANE`]
/// pixels in the ring.
///
/// Where the ring does not reach around the instance, the shading may go on as the polynomial does or stay as it is at the
/// nearest pixels, as behind the terminator of a round surface. The difference of both is added to the error, for the pixels of
/// the instance outside of the convex hull of the ring.
pub(crate) fn difference_on_surface(inside: &[Value], ring: &[Value]) -> Option<Difference> {
    let most = if ring.len() >= LEAST_SQUARE { 6 } else { 3 };
    if ring.len() < LEAST_PLANE || inside.is_empty() {
        return None;
    }
    [most, 3, 1].into_iter().find_map(|terms| fitted(inside, ring, terms))
}

fn fitted(inside: &[Value], ring: &[Value], terms: usize) -> Option<Difference> {
    let low = [0, 1].map(|i| ring.iter().map(|v| v.at[i]).min().unwrap_or(0) as f64);
    let high = [0, 1].map(|i| ring.iter().map(|v| v.at[i]).max().unwrap_or(0) as f64);
    let basis = |v: &Value| {
        let [x, y] = [0, 1].map(|i| (v.at[i] as f64 - 0.5 * (low[i] + high[i])) / (0.5 * (high[i] - low[i])).max(0.5));
        [1.0, x, y, x * x, x * y, y * y]
    };
    let mut matrix = [[0.0; 8]; 6];
    let n = inside.len() as f64;
    for v in ring {
        let b = basis(v);
        for (row, bi) in matrix.iter_mut().zip(b) {
            row.iter_mut().zip(b).for_each(|(entry, bj)| *entry += bi * bj);
            row[7] += bi * v.value;
        }
    }
    for v in inside {
        matrix.iter_mut().zip(basis(v)).for_each(|(row, b)| row[6] += b / n);
    }
    let [of_mean, coefficients] = solved(matrix, terms, 1e-6 * ring.len() as f64)?;
    let dot = |a: &[f64; 6], b: [f64; 6]| a.iter().zip(b).take(terms).map(|(a, b)| a * b).sum::<f64>();
    let squares: f64 = ring.iter().map(|v| (v.value - dot(&coefficients, basis(v))).powi(2)).sum();
    let scatter = squares / (ring.len() - terms) as f64;
    let known: Vec<f64> = ring.iter().filter_map(|v| v.variance).collect();
    // The deviation of the variance of so many normal values over the variance (chi-squared).
    let deviation = (2.0 / (ring.len() - terms) as f64).sqrt();
    let mean = if known.is_empty() { scatter } else { known.iter().sum::<f64>() / known.len() as f64 };
    let structure = (scatter - mean * (1.0 + SIGNIFICANT * deviation)).max(0.0);
    let variance_of = |v: &Value| v.variance.unwrap_or(mean);
    let of_inside = inside.iter().map(variance_of).sum::<f64>() / (n * n);
    let of_ring: f64 = ring.iter().map(|v| dot(&of_mean, basis(v)).powi(2) * variance_of(v)).sum();
    let below: f64 = ring.iter().map(|v| dot(&of_mean, basis(v)) * v.value).sum();
    let value = inside.iter().map(|v| v.value).sum::<f64>() / n - below;
    let continued: f64 =
        beyond(inside, ring).into_iter().map(|(v, nearest)| dot(&coefficients, basis(v)) - nearest).sum();
    let variance = of_inside + of_ring + structure + (continued / n).powi(2);
    Some(Difference { value, variance: Some(variance), below, range: range_of(ring) })
}

/// Solves two systems of equations with a symmetric matrix by elimination with pivots on the diagonal. `None` if a pivot is
/// below `least`.
fn solved(mut m: [[f64; 8]; 6], terms: usize, least: f64) -> Option<[[f64; 6]; 2]> {
    for k in 0..terms {
        let pivot = m[k];
        if pivot[k] < least {
            return None;
        }
        for (_, row) in m.iter_mut().take(terms).enumerate().filter(|(i, _)| *i != k) {
            let factor = row[k] / pivot[k];
            row.iter_mut().zip(pivot).for_each(|(entry, p)| *entry -= factor * p);
        }
    }
    let mut found = [[0.0; 6]; 2];
    for (k, row) in m.iter().take(terms).enumerate() {
        found[0][k] = row[6] / row[k];
        found[1][k] = row[7] / row[k];
    }
    Some(found)
}
