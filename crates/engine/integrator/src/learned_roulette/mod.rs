//! Learned Russian roulette and splitting: survival probabilities of paths, shadow rays and connections by their expected
//! gain, and the number of paths that a path is split into.
//!
//! A part of a sample with the outcome `X` [W/(m^2 sr)] and the cost `c` \[rays\] is computed with the survival
//! probability `q` and divided by it. That adds `E[X^2] (1/q - 1)` to the variance of the sample and saves `c (1 - q)`
//! of its cost. The product of the variance `V` and the cost `C` of a sample is smallest for
//!
//! ```text
//! q = sqrt(E[X^2] / c) / sqrt(V / C)
//! ```
//!
//! (Bolin and Meyer 1997; Rath et al. 2022). Training paths measure `E[X^2]` and `c` before the render, in cells of
//! position and material (adjoint-driven roulette: Vorba and Křivánek 2016). `V` and `C` are those of the training paths
//! whose first vertex lies in the same cell. `V` leaves out the light samples of that vertex: their points are evenly
//! distributed over the samples of a pixel, so they add little to the variance of its mean.
//!
//! Behind its first light samples a path is split into `K` paths of a share `1/K` each (Vorba and Křivánek 2016). For the
//! variances `v` and the costs `c` of these samples (0) and of the rest (1), `(v_0 + v_1 / K) (c_0 + K c_1)` is smallest at
//! `K^2 = (v_1 / v_0) (c_0 / c_1)`. Training paths measure `c` and `v_1`; `v_0` is that of stratified samples in some pixels.
//! `K` is a power of two, the same for the whole image. The children survive as the path would. The gain of the light samples before them grows by `sqrt(K)`.
//!
//! The survivors are divided by `q`, so no learned value changes the expected image.

mod cells;
mod statistics;

pub(crate) use statistics::Visit;

use crate::learned_roulette::cells::{Cell, CellGrid, NONE};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_scene::Scene;

/// Number of lights with statistics of their own: the lights of a vertex that takes a sample of each.
pub(crate) const LIGHTS: usize = Scene::MAX_LIGHT_SAMPLES as usize;

/// The kinds of rays to lights: shadow rays, and connections through covers.
pub(crate) const SHADOW: usize = 0;
pub(crate) const CONNECTION: usize = 1;

/// Cost of a shadow ray with its light sample, relative to a ray to the next surface with its shading, by a profile.
const SHADOW_COST: f32 = 0.5;

/// Cost of a ray that is traced through a cover for a connection, relative to a ray to the next surface, by a profile.
const CONNECTION_COST: f32 = 1.0;

/// Smallest learned survival probability. The weight of outcomes that training has not met is at most five.
const MIN_SURVIVAL: f32 = 0.2;

/// The learned statistics of a scene and a camera.
#[derive(Clone, Debug, serde::Serialize)]
pub struct LearnedRoulette {
    grid: CellGrid,
    /// The binary logarithm of the number of paths that a path is split into behind its first light samples.
    pub(crate) splits: u32,
}

impl LearnedRoulette {
    /// Number of paths that a sample is split into behind its first light samples; 1 where it is not split.
    pub fn children(&self) -> u32 {
        1 << self.splits
    }

    /// The survival probabilities at vertices on surfaces. The first surface with statistics sets the `gain_scale` of a path,
    /// which is negative before. A lane has none if its material has no statistics, or if the noise of the first surface is
    /// zero.
    #[inline(always)]
    pub(crate) fn at_lanes<F: Lanes>(
        &self,
        token: F::Token,
        point: V3<F>,
        material: F::Word,
        gain_scale: F,
    ) -> VertexRoulettes<'_, F> {
        let (cells, found) = (self.grid.cells(), self.grid.find(point, material));
        let (mut gains, mut path, mut bits) = ([0.0; MAX_WIDTH], [0.0; MAX_WIDTH], 0);
        for lane in 0..F::WIDTH {
            if let Some(cell) = cells.get(found[lane] as usize) {
                (gains[lane], path[lane]) = (cell.gain_scale, cell.path);
                bits |= 1 << lane;
            }
        }
        let is_found = F::mask(token, bits);
        let is_unset = gain_scale.lt(gain_scale.constant(0.0));
        let gain_scale = (is_found & is_unset).select(F::load(token, &gains), gain_scale);
        let is_learned = is_found & gain_scale.is_positive() & gain_scale.is_finite();
        VertexRoulettes { cells, found, is_learned, gain_scale, path: F::load(token, &path) }
    }
}

/// The survival probabilities at the vertices of lanes.
pub(crate) struct VertexRoulettes<'a, F: Lanes> {
    cells: &'a [Cell],
    /// Index of the cell of each lane.
    found: [u32; MAX_WIDTH],
    /// Lanes with statistics.
    pub(crate) is_learned: F::Mask,
    /// `1 / sqrt(V / C)` of the paths \[m^2 sr/W\]; below zero where no vertex has set it.
    pub(crate) gain_scale: F,
    path: F,
}

impl<'a, F: Lanes> VertexRoulettes<'a, F> {
    /// No statistics. The `gain_scale` of the paths stays.
    #[inline(always)]
    pub(crate) fn none(token: F::Token, gain_scale: F) -> Self {
        let zero = F::splat(token, 0.0);
        Self { cells: &[], found: [NONE; MAX_WIDTH], is_learned: F::mask(token, 0), gain_scale, path: zero }
    }

    /// Survival probability of the path after scattering; the other probability in lanes without statistics. `throughput`
    /// is the largest channel. A path without throughput ends.
    #[inline(always)]
    pub(crate) fn path_survival(&self, throughput: F, other: F) -> F {
        let zero = throughput.constant(0.0);
        let survival = throughput.eq(zero).select(zero, clamp(throughput * self.gain_scale * self.path));
        self.is_learned.select(survival, other)
    }

    /// Survival probability of the shadow ray or the connection (`kind`) of a light sample; the other probability in lanes
    /// without statistics. `expected` is an upper bound of its contribution to the pixel [W/(m^2 sr)].
    #[inline(always)]
    pub(crate) fn ray_survival(&self, kind: usize, index: u32, expected: F, other: F) -> F {
        if !self.is_learned.any() {
            return other;
        }
        let mut shares = [0.0; MAX_WIDTH];
        for (share, found) in shares.iter_mut().zip(self.found) {
            if let Some(cell) = self.cells.get(found as usize) {
                *share = cell.rays[kind][index as usize % LIGHTS];
            }
        }
        let survival = clamp(expected * self.gain_scale * F::load(expected.token(), &shares));
        self.is_learned.select(survival, other)
    }
}

/// A probability in [[`MIN_SURVIVAL`], 1]. Values that are not a number survive, so that the film can count them.
#[inline(always)]
fn clamp<F: Lanes>(q: F) -> F {
    let one = q.constant(1.0);
    q.lt(one).select(q.max(q.constant(MIN_SURVIVAL)), one)
}

#[cfg(test)]
mod tests {
    use super::cells::Lattice;
    use super::*;
    use dunkelfeld_geometry::Vec3;
    use dunkelfeld_lanes::{InstructionSet, One, dispatch};
    use std::collections::BTreeMap;

    /// Points in and around a cube of one metre.
    fn points(count: usize) -> Vec<Vec3> {
        let mut state = 5u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1 << 24) as f32
        };
        (0..count).map(|_| Vec3::new(random(), random(), random()) * 1.2 - 0.1).collect()
    }

    fn cell(value: f32) -> Cell {
        Cell { gain_scale: value, path: 0.5 * value, rays: [[2.0 * value; LIGHTS], [0.0; LIGHTS]] }
    }

    /// Cells of the even materials at most of the points; the materials 0 to 3 have values of their own, except 2.
    fn roulette(points: &[Vec3]) -> (Lattice, BTreeMap<[u32; 2], Cell>, LearnedRoulette) {
        let lattice = Lattice::around(points).expect("a radius above zero");
        let visited = points.iter().enumerate().filter(|(i, _)| i % 3 != 0);
        let by_key: BTreeMap<[u32; 2], Cell> = visited
            .map(|(i, &p)| (lattice.key::<f32>(p.into(), One(2 * (i as u32 % 3))).map(|half| half.0), cell(i as f32)))
            .collect();
        let by_material = [Some(cell(-1.0)), Some(cell(0.0)), None, Some(cell(f32::INFINITY))];
        let grid = CellGrid::new(lattice, by_key.iter().map(|(&key, &cell)| (key, cell)), by_material.into_iter());
        (lattice, by_key, LearnedRoulette { grid, splits: 0 })
    }

    #[test]
    fn each_point_has_the_cell_of_its_key() {
        let points = points(20_000);
        let (lattice, by_key, roulette) = roulette(&points);
        let far = [Vec3::splat(-1e9), Vec3::splat(1e9), Vec3::NAN, Vec3::INFINITY];
        for &p in points.iter().chain(&far) {
            for material in [0, 1, 2, 3, 4, 5, 70_000] {
                let key = lattice.key::<f32>(p.into(), One(material)).map(|half| half.0);
                let of_material = [Some(-1.0), Some(0.0), None, Some(f32::INFINITY)];
                let expected = by_key.get(&key).map(|cell| cell.gain_scale);
                let expected = expected.or_else(|| of_material.get(material as usize).copied().flatten());
                let found = roulette.at_lanes::<f32>((), p.into(), One(material), -1.0);
                assert_eq!(found.gain_scale, expected.unwrap_or(-1.0), "{p}, material {material}");
                assert_eq!(found.is_learned, expected.is_some_and(|gain| gain > 0.0 && gain.is_finite()));
            }
        }
    }

    #[inline(always)]
    fn found<F: Lanes>(
        token: F::Token,
        roulette: &LearnedRoulette,
        (points, materials, gains): (&[Vec3; MAX_WIDTH], &[u32; MAX_WIDTH], &[f32; MAX_WIDTH]),
    ) -> [[f32; MAX_WIDTH]; 3] {
        let mut out = [[0.0; MAX_WIDTH]; 3];
        for at in (0..MAX_WIDTH).step_by(F::WIDTH) {
            let mut of_lanes = [Vec3::ZERO; MAX_WIDTH];
            of_lanes[..F::WIDTH].copy_from_slice(&points[at..at + F::WIDTH]);
            let (point, material) = (V3::from_lanes(token, &of_lanes), F::load_word(token, &materials[at..]));
            let learned = roulette.at_lanes::<F>(token, point, material, F::load(token, &gains[at..]));
            let x = F::splat(token, 0.01);
            let all = [learned.gain_scale, learned.path_survival(x, -x), learned.ray_survival(SHADOW, 1, x, -x)];
            for (row, value) in out.iter_mut().zip(all) {
                value.store(&mut row[at..]);
            }
        }
        out
    }

    #[test]
    fn lanes_have_the_values_of_single_vertices() {
        let points = points(20_000);
        let (.., roulette) = roulette(&points);
        for (round, lanes) in points.chunks_exact(MAX_WIDTH).enumerate() {
            let lanes = lanes.try_into().expect("as many points as lanes");
            let materials = std::array::from_fn(|lane| ((lane + round) % 6) as u32);
            let gains = std::array::from_fn(|lane| if (lane ^ round) % 3 == 0 { 0.25 * lane as f32 } else { -1.0 });
            let found = |set| dispatch!(set, F, token => found::<F>(token, &roulette, (lanes, &materials, &gains)));
            let expected = found(InstructionSet::Scalar);
            for set in InstructionSet::all() {
                assert_eq!(found(set), expected, "{set:?}, round {round}");
            }
        }
    }
}
