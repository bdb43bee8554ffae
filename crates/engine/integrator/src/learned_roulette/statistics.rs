//! Statistics of the outcomes of training paths, by cell.

use super::cells::{Cell, CellGrid, Lattice};
use super::{CONNECTION_COST, LIGHTS, LearnedRoulette, SHADOW_COST};
use dunkelfeld_geometry::Vec3;
use dunkelfeld_lanes::One;
use dunkelfeld_radiometry::Rgb;
use std::array::from_fn;
use std::collections::BTreeMap;

/// Costs of both kinds of rays to lights.
const COSTS: [f32; 2] = [SHADOW_COST, CONNECTION_COST];

/// Largest mean cost \[rays\] of the rests of paths with which these are split. Where rests are longer, their variance arises at
/// later vertices, and a split at the first one does not pay.
const MAX_REST_COST: f64 = 3.0;

/// The binary logarithm of the largest number of paths that a path is split into.
const MAX_SPLITS: f64 = 2.0;

/// Weight of the statistics of the material in those of a cell \[observations\]. A few observations determine
/// a second moment to a half.
const PRIOR: f64 = 4.0;

/// A vertex of a training path.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Visit {
    pub(crate) point: Vec3,
    /// Index of the material; `None` in the environment and in media, where nothing is learned.
    pub(crate) material: Option<u32>,
    pub(crate) is_first: bool,
    /// Radiance that was added at this vertex [W/(m^2 sr)].
    pub(crate) added: f32,
    /// Throughput after scattering; 0 if the path ended.
    pub(crate) throughput: f32,
    pub(crate) cost: f32,
    /// Shadow rays and connections to each light.
    pub(crate) rays: [[Outcomes; LIGHTS]; 2],
}

/// Number of rays to a light, and of those that arrived.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Outcomes {
    traced: u8,
    arrived: u8,
}

impl Visit {
    /// Were rays to lights traced here?
    fn is_lit(&self) -> bool {
        self.rays.as_flattened().iter().any(|outcomes| outcomes.traced > 0)
    }

    /// Adds the light of a shadow ray or connection to a light, for which a number of rays were traced.
    pub(crate) fn add_ray(&mut self, kind: usize, light: u32, rays: u32, added: Rgb) {
        self.added += added.max_channel();
        self.cost += COSTS[kind] * rays as f32;
        let outcomes = &mut self.rays[kind][light as usize % LIGHTS];
        if outcomes.traced < u8::MAX {
            outcomes.traced += 1;
            outcomes.arrived += u8::from(!added.is_black());
        }
    }
}

/// Sums of the observations in a cell, of a material or of all.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Rests of paths: number, squares for the throughput 1, cost.
    rests: [f64; 3],
    /// Paths whose first vertex lies here: number, sum and squares of their rests, cost.
    paths: [f64; 4],
    /// Rays of each kind to each light: number, arrived.
    rays: [[[f64; 2]; LIGHTS]; 2],
}

/// Radiance [W/(m^2 sr)] and cost of a path, or of its rest after a vertex.
#[derive(Clone, Copy, Debug, Default)]
struct Outcome {
    radiance: f64,
    cost: f64,
}

/// Means of the observations in a cell.
#[derive(Clone, Copy, Debug)]
struct Means {
    rest_square: f64,
    rest_cost: f64,
    variance: f64,
    cost: f64,
    rays: [[f64; LIGHTS]; 2],
}

impl Sums {
    /// Adds a vertex, the rest of the path after it, and the cost of the whole path.
    fn add(&mut self, visit: &Visit, rest: Outcome, cost: f64) {
        if visit.throughput > 0.0 {
            let radiance = rest.radiance / f64::from(visit.throughput);
            add(&mut self.rests, [1.0, radiance * radiance, rest.cost]);
        }
        if visit.is_first {
            add(&mut self.paths, [1.0, rest.radiance, rest.radiance * rest.radiance, cost]);
        }
        for (sum, o) in self.rays.as_flattened_mut().iter_mut().zip(visit.rays.as_flattened()) {
            add(sum, [o.traced.into(), o.arrived.into()]);
        }
    }

    /// Means with the weight of [`PRIOR`] observations on `prior`.
    fn means(&self, prior: &Means) -> Means {
        let mean = |n: f64, sum: f64, prior: f64| (sum + PRIOR * prior) / (n + PRIOR);
        let [rests, square, rest_cost] = self.rests;
        let [paths, sum, squares, cost] = self.paths;
        // The sum of squared deviations from the mean of the cell.
        let deviations = if paths > 0.0 { (squares - sum * sum / paths).max(0.0) } else { 0.0 };
        let arrived = |kind: usize, light: usize| {
            let [traced, arrived] = self.rays[kind][light];
            mean(traced, arrived, prior.rays[kind][light])
        };
        Means {
            rest_square: mean(rests, square, prior.rest_square),
            rest_cost: mean(rests, rest_cost, prior.rest_cost),
            variance: mean(paths, deviations, prior.variance),
            cost: mean(paths, cost, prior.cost),
            rays: from_fn(|kind| from_fn(|light| arrived(kind, light))),
        }
    }
}

impl Means {
    /// Without any observation, half of the rays to lights arrive.
    const UNKNOWN: Self = Self { rest_square: 0.0, rest_cost: 1.0, variance: 0.0, cost: 1.0, rays: [[0.5; LIGHTS]; 2] };

    fn cell(&self) -> Cell {
        let gain = |second_moment: f64, cost: f64| (second_moment / cost).sqrt() as f32;
        Cell {
            gain_scale: gain(self.cost, self.variance),
            path: gain(self.rest_square, self.rest_cost),
            rays: from_fn(|kind| self.rays[kind].map(|arrived| gain(arrived, COSTS[kind].into()))),
        }
    }
}

/// Paths up to their first light samples, and their rests.
#[derive(Clone, Copy, Debug, Default)]
struct RestSums {
    paths: f64,
    /// Paths that continue.
    rests: f64,
    /// Costs of both parts \[rays\].
    costs: [f64; 2],
    /// Sum and squares of the radiance of the rests [W/(m^2 sr)].
    moments: [f64; 2],
}

impl RestSums {
    fn add(&mut self, cost: f64, rest: Outcome) {
        self.paths += 1.0;
        self.rests += f64::from(u8::from(rest.cost > 0.0));
        add(&mut self.costs, [cost - rest.cost, rest.cost]);
        add(&mut self.moments, [rest.radiance, rest.radiance * rest.radiance]);
    }

    /// The binary logarithm of the number of paths that a path is split into, for the variance of its first light samples
    /// [W^2/(m^4 sr^2)].
    fn splits(&self, first_variance: f64) -> u32 {
        let [before, behind] = self.costs;
        if behind > MAX_REST_COST * self.rests {
            return 0;
        }
        let [sum, squares] = self.moments.map(|moment| moment / self.paths);
        let ratio = (squares - sum * sum) / first_variance * (before / behind);
        (0.5 * ratio.log2()).round().clamp(0.0, MAX_SPLITS) as u32
    }
}

fn add<const N: usize>(sums: &mut [f64; N], values: [f64; N]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
}

impl LearnedRoulette {
    /// The statistics of batches of training paths: their vertices, path after path. The order of the batches is part of
    /// the result. `first_variance` is that of first light samples in pixels [W^2/(m^4 sr^2)]. `None` if no path met a
    /// surface.
    pub(crate) fn from_visits(batches: &[&[Visit]], first_variance: f64) -> Option<Self> {
        let visits = || batches.iter().copied().flatten();
        let firsts: Vec<Vec3> = visits().filter(|v| v.is_first && v.material.is_some()).map(|v| v.point).collect();
        let lattice = Lattice::around(&firsts)?;

        // The order of the visits is fixed, and so are the sums.
        let mut cells: BTreeMap<[u32; 2], (u32, Sums)> = BTreeMap::new();
        let mut materials: BTreeMap<u32, Sums> = BTreeMap::new();
        let mut all = Sums::default();
        let mut rests = RestSums::default();
        for path in batches.iter().flat_map(|visits| visits.chunk_by(|_, next| !next.is_first)) {
            let cost: f64 = path.iter().map(|v| f64::from(v.cost)).sum();
            let (first_lit, mut rest) = (path.iter().position(Visit::is_lit), Outcome::default());
            for (number, visit) in path.iter().enumerate().rev() {
                // Invalid samples are counted by the film. Nothing is learned from them.
                if let Some(material) = visit.material.filter(|_| rest.radiance.is_finite()) {
                    let key = lattice.key(visit.point.into(), One(material)).map(|half| half.0);
                    cells.entry(key).or_insert((material, Sums::default())).1.add(visit, rest, cost);
                    materials.entry(material).or_default().add(visit, rest, cost);
                    all.add(visit, rest, cost);
                }
                if first_lit == Some(number) {
                    rests.add(cost, rest);
                }
                rest.radiance += f64::from(visit.added);
                rest.cost += f64::from(visit.cost);
            }
        }

        let all = all.means(&Means::UNKNOWN);
        let materials: BTreeMap<u32, Means> = materials.iter().map(|(&m, sums)| (m, sums.means(&all))).collect();
        let by_key = cells.iter().map(|(&key, (material, sums))| (key, sums.means(&materials[material]).cell()));
        let last = materials.keys().next_back()?;
        let by_material = (0..=*last).map(|m| materials.get(&m).map(Means::cell));
        Some(Self { grid: CellGrid::new(lattice, by_key, by_material), splits: rests.splits(first_variance) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The product of variance and cost is the smallest of the powers of two.
    #[test]
    fn the_number_of_children_is_the_most_efficient_one() {
        let sums = |cost: f64, rest: f64| {
            let mut sums = RestSums::default();
            for radiance in [0.0, 0.0, 0.0, 4.0] {
                sums.add(cost + rest, Outcome { radiance, cost: rest });
            }
            sums
        };
        for (before, behind) in [(0.5, 2.9), (2.7, 1.4), (1.5, 1.1), (6.6, 2.6), (40.0, 2.0), (2.7, 0.01)] {
            for first in [0.1, 0.5, 3.0, 20.0] {
                let product = |splits: u32| {
                    let children = f64::from(1 << splits);
                    (first + 3.0 / children) * (before + children * behind)
                };
                let best = (0..=MAX_SPLITS as u32).min_by(|a, b| product(*a).total_cmp(&product(*b)));
                assert_eq!(Some(sums(before, behind).splits(first)), best, "{before} {behind} {first}");
            }
        }
        assert_eq!(sums(100.0, 5.0).splits(0.01), 0, "long rests");
        assert_eq!(RestSums::default().splits(0.0), 0, "no light sample at all");
    }
}
