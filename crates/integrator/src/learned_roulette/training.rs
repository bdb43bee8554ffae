//! Training paths of the learned roulette: their outcomes vertex by vertex, and statistics of these.

use super::cells::{Cell, CellGrid, Lattice};
use super::{CONNECTION_COST, LIGHTS, LearnedRoulette, SHADOW_COST};
use crate::dimensions;
use crate::dispatch::trace_path;
use crate::mnee::ConnectionRecord;
use crate::recorder::Recorder;
use crate::vertex::Scattering;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{RayGenerator, Scene};
use std::collections::BTreeMap;

/// Seed of the training paths. They are the same for all seeds of a render.
const SEED: u64 = 0x0074_7261_696e_696e;

/// Weight of the statistics of the material in those of a cell \[observations\].
const PRIOR: f64 = 4.0;

/// Longest stored part of a training path \[vertices\]. The rest of a longer path counts for its last stored vertex.
const MAX_VISITS: usize = 64;

/// A vertex of a training path.
#[derive(Clone, Copy, Debug)]
struct Visit {
    point: Vec3,
    /// Index of the material; `None` in the environment and in media, where nothing is learned.
    material: Option<u32>,
    is_first: bool,
    /// Radiance that was added at this vertex [W/(m^2 sr)].
    added: f32,
    /// Throughput after scattering; 0 if the path ended.
    throughput: f32,
    cost: f32,
    shadow: [Outcomes; LIGHTS],
    connection: [Outcomes; LIGHTS],
}

/// Number of rays to a light, and of those that arrived.
#[derive(Clone, Copy, Debug, Default)]
struct Outcomes {
    traced: u8,
    arrived: u8,
}

/// The outcomes of some training paths: a pure function of scene, camera, film, earlier statistics and the number of the
/// batch.
#[derive(Clone, Debug, Default)]
pub struct TrainingBatch {
    visits: Vec<Visit>,
}

impl TrainingBatch {
    /// Number of paths in a batch.
    pub const PATHS: u32 = 256;

    /// Traces the paths of a batch, from random points of a film of `width` x `height` pixels.
    pub(super) fn trace(
        scene: &Scene,
        camera: &RayGenerator,
        previous: Option<&LearnedRoulette>,
        [width, height]: [u32; 2],
        number: u32,
    ) -> Self {
        let mut batch = Self::default();
        for path in 0..Self::PATHS {
            // The points of all batches are one sequence, evenly distributed over the film.
            let index = number.wrapping_mul(Self::PATHS).wrapping_add(path);
            let [x, y] = Sampler::new(SEED, 0, 0, index).get_2d(dimensions::CAMERA);
            let sampler = Sampler::new(SEED, 1, index, 0);
            let lens = camera.has_aperture().then(|| sampler.get_2d(dimensions::LENS));
            let ray = camera.camera_ray(x * width as f32, y * height as f32, lens).ray;
            let begin = batch.visits.len();
            trace_path(scene, previous, ray, &sampler, &mut TrainingRecorder { visits: &mut batch.visits, begin });
        }
        batch
    }
}

/// Stores the outcomes of a path.
struct TrainingRecorder<'a> {
    visits: &'a mut Vec<Visit>,
    /// Index of the first vertex of the path.
    begin: usize,
}

impl TrainingRecorder<'_> {
    fn visit(&mut self, position: [f32; 3], material: Option<u32>) {
        let count = self.visits.len() - self.begin;
        if let Some(last) = self.visits.last_mut().filter(|_| count >= MAX_VISITS) {
            last.cost += 1.0;
            return;
        }
        self.visits.push(Visit {
            point: Vec3::from_array(position),
            material,
            is_first: count == 0,
            added: 0.0,
            throughput: 0.0,
            cost: 1.0,
            shadow: [Outcomes::default(); LIGHTS],
            connection: [Outcomes::default(); LIGHTS],
        });
    }

    /// Changes the current vertex.
    fn update(&mut self, change: impl FnOnce(&mut Visit)) {
        if let Some(current) = self.visits.get_mut(self.begin..).and_then(<[Visit]>::last_mut) {
            change(current);
        }
    }

    fn add(&mut self, contribution: Rgb) {
        self.update(|v| v.added += contribution.max_channel());
    }
}

impl Recorder for TrainingRecorder<'_> {
    const TRAINING: bool = true;

    fn vertex(&mut self, position: [f32; 3], material: Option<u32>, _: Rgb) {
        self.visit(position, material);
    }

    fn medium_vertex(&mut self, position: [f32; 3], _: Option<u32>, _: Rgb) {
        self.visit(position, None);
    }

    fn add_emitted(&mut self, contribution: Rgb) {
        self.add(contribution);
    }

    fn add_direct(&mut self, contribution: Rgb) {
        self.add(contribution);
    }

    fn scattering(&mut self, _: &Scattering, throughput: Rgb) {
        self.update(|v| v.throughput = throughput.max_channel());
    }

    fn shadow_ray(&mut self, index: u32, arrived: bool) {
        self.update(|v| {
            v.cost += SHADOW_COST;
            v.shadow[index as usize % LIGHTS].count(arrived);
        });
    }

    fn connection(&mut self, record: &ConnectionRecord) {
        self.update(|v| v.cost += CONNECTION_COST * record.rays as f32);
    }

    fn connection_outcome(&mut self, index: u32, arrived: bool) {
        self.update(|v| v.connection[index as usize % LIGHTS].count(arrived));
    }

    fn connection_mis_weight(&mut self, _: f32) {}

    fn add_connection(&mut self, contribution: Rgb) {
        self.add(contribution);
    }

    fn scale(&mut self, _: f32) {}
}

impl Outcomes {
    fn count(&mut self, arrived: bool) {
        self.traced = self.traced.saturating_add(1);
        self.arrived = self.arrived.saturating_add(u8::from(arrived));
    }
}

/// Sums of the observations in a cell, of a material or of all.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Rests of paths: number, squares for the throughput 1, cost.
    rests: [f64; 3],
    /// Paths whose first vertex lies here: number, sum and squares of their rests, cost.
    paths: [f64; 4],
    /// Rays to each light: number, arrived.
    shadow: [[f64; 2]; LIGHTS],
    connection: [[f64; 2]; LIGHTS],
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
    shadow: [f64; LIGHTS],
    connection: [f64; LIGHTS],
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
        for (sums, outcomes) in [(&mut self.shadow, &visit.shadow), (&mut self.connection, &visit.connection)] {
            for (sum, o) in sums.iter_mut().zip(outcomes) {
                add(sum, [o.traced.into(), o.arrived.into()]);
            }
        }
    }

    /// Means with the weight of [`PRIOR`] observations on `prior`.
    fn means(&self, prior: &Means) -> Means {
        let mean = |n: f64, sum: f64, prior: f64| (sum + PRIOR * prior) / (n + PRIOR);
        let [rests, square, rest_cost] = self.rests;
        let [paths, sum, squares, cost] = self.paths;
        // The sum of squared deviations from the mean of the cell.
        let deviations = if paths > 0.0 { (squares - sum * sum / paths).max(0.0) } else { 0.0 };
        let arrived = |sums: &[[f64; 2]; LIGHTS], prior: &[f64; LIGHTS]| {
            std::array::from_fn(|i| mean(sums[i][0], sums[i][1], prior[i]))
        };
        Means {
            rest_square: mean(rests, square, prior.rest_square),
            rest_cost: mean(rests, rest_cost, prior.rest_cost),
            variance: mean(paths, deviations, prior.variance),
            cost: mean(paths, cost, prior.cost),
            shadow: arrived(&self.shadow, &prior.shadow),
            connection: arrived(&self.connection, &prior.connection),
        }
    }
}

impl Means {
    /// Without any observation, half of the rays to lights arrive.
    const UNKNOWN: Self = Self {
        rest_square: 0.0,
        rest_cost: 1.0,
        variance: 0.0,
        cost: 1.0,
        shadow: [0.5; LIGHTS],
        connection: [0.5; LIGHTS],
    };

    fn cell(&self, key: u64) -> Cell {
        let gain = |second_moment: f64, cost: f64| (second_moment / cost).sqrt() as f32;
        Cell {
            key,
            gain_scale: gain(self.cost, self.variance),
            path: gain(self.rest_square, self.rest_cost),
            shadow: self.shadow.map(|a| gain(a, SHADOW_COST.into())),
            connection: self.connection.map(|a| gain(a, CONNECTION_COST.into())),
        }
    }
}

fn add<const N: usize>(sums: &mut [f64; N], values: [f64; N]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
}

/// The statistics of batches, in their order. `None` if no path met a surface.
pub(super) fn combine(batches: &[TrainingBatch]) -> Option<LearnedRoulette> {
    let visits = || batches.iter().flat_map(|b| &b.visits);
    let firsts: Vec<Vec3> = visits().filter(|v| v.is_first && v.material.is_some()).map(|v| v.point).collect();
    let lattice = Lattice::around(&firsts)?;

    // The order of the visits is fixed, and so are the sums.
    let mut cells: BTreeMap<u64, (u32, Sums)> = BTreeMap::new();
    let mut materials: BTreeMap<u32, Sums> = BTreeMap::new();
    let mut all = Sums::default();
    for path in batches.iter().flat_map(|b| b.visits.chunk_by(|_, next| !next.is_first)) {
        let cost: f64 = path.iter().map(|v| f64::from(v.cost)).sum();
        let mut rest = Outcome::default();
        for visit in path.iter().rev() {
            // Invalid samples are counted by the film. Nothing is learned from them.
            if let Some(material) = visit.material.filter(|_| rest.radiance.is_finite()) {
                let key = lattice.key(visit.point, material);
                cells.entry(key).or_insert((material, Sums::default())).1.add(visit, rest, cost);
                materials.entry(material).or_default().add(visit, rest, cost);
                all.add(visit, rest, cost);
            }
            rest.radiance += f64::from(visit.added);
            rest.cost += f64::from(visit.cost);
        }
    }

    let all = all.means(&Means::UNKNOWN);
    let materials: BTreeMap<u32, Means> = materials.iter().map(|(&m, sums)| (m, sums.means(&all))).collect();
    let cells = cells.iter().map(|(&key, (material, sums))| sums.means(&materials[material]).cell(key)).collect();
    let last = materials.keys().next_back()?;
    let by_material = (0..=*last).map(|m| materials.get(&m).map(|means| means.cell(u64::MAX))).collect();
    Some(LearnedRoulette { grid: CellGrid::new(lattice, cells, by_material) })
}
