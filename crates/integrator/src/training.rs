//! Training paths of the learned Russian roulette: their outcomes, vertex by vertex.

use crate::dimensions;
use crate::dispatch::trace_path;
use crate::learned_roulette::{CONNECTION_COST, LIGHTS, LearnedRoulette, Outcomes, SHADOW_COST, Visit};
use crate::mnee::ConnectionRecord;
use crate::recorder::Recorder;
use crate::vertex::Scattering;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{Moment, RayGenerator, Scene};
use std::ops::Range;

/// Seed of the training paths. They are the same for all seeds of a render.
const SEED: u64 = 0x0074_7261_696e_696e;

/// Longest stored part of a training path \[vertices\]. The rest of a longer path counts for its last stored vertex.
const MAX_VISITS: usize = 64;

/// Vertices and further rays of a batch, on average over its paths, after which no path of the batch begins. It limits
/// the time of training in media that scatter many times.
const COST_PER_PATH: f32 = 32.0;

/// Rounds of training. The paths of each round use the statistics of the round before.
const ROUNDS: u32 = 3;

impl LearnedRoulette {
    /// Traces about `paths` training paths of a film of `width` x `height` pixels, in at least one batch per round.
    /// `trace` computes the batches with the numbers in a range and returns them in order, on any number of threads. The
    /// result is a pure function of scene, camera, film and number of paths. `None` if no path meets a surface.
    pub fn train(
        scene: &Scene,
        camera: &RayGenerator,
        [width, height]: [u32; 2],
        paths: u32,
        trace: impl Fn(Range<u32>, &(dyn Fn(u32) -> TrainingBatch + Sync)) -> Vec<TrainingBatch>,
    ) -> Option<Self> {
        let per_round = (paths / (ROUNDS * TrainingBatch::PATHS)).max(1);
        (0..ROUNDS).try_fold(None, |previous: Option<Self>, round| {
            let batch = |n| TrainingBatch::trace(scene, camera, previous.as_ref(), [width, height], n);
            let batches = trace(round * per_round..(round + 1) * per_round, &batch);
            let visits: Vec<&[Visit]> = batches.iter().map(|b| b.visits.as_slice()).collect();
            Self::from_visits(&visits).map(Some)
        })?
    }
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

    /// Cost of the paths of the batch \[rays\], for the learned statistics.
    pub fn cost(&self) -> f32 {
        self.visits.iter().map(|visit| visit.cost).sum()
    }

    /// Traces the paths of a batch, from random points of a film of `width` x `height` pixels.
    fn trace(
        scene: &Scene,
        camera: &RayGenerator,
        previous: Option<&LearnedRoulette>,
        [width, height]: [u32; 2],
        number: u32,
    ) -> Self {
        let mut batch = Self::default();
        let mut cost = 0.0;
        for path in 0..Self::PATHS {
            if cost > COST_PER_PATH * Self::PATHS as f32 {
                break;
            }
            // The points of all batches are four sequences, each evenly distributed over the film.
            let index = number.wrapping_mul(Self::PATHS).wrapping_add(path);
            let [x, y] = Sampler::new(SEED, u32::MAX, 0, index).get_2d(dimensions::CAMERA);
            let sampler = Sampler::new(SEED, u32::MAX - 1, index, 0);
            let lens = camera.has_aperture().then(|| sampler.get_2d(dimensions::LENS));
            let y = y * height as f32;
            let Moment { time, y } = match scene.shutter() {
                None => Moment { time: 0.0, y },
                Some(shutter) => shutter.moment(y as u32, y.fract(), sampler.get_1d(dimensions::TIME), (SEED, 0)),
            };
            let ray = camera.camera_ray(x * width as f32, y, lens).ray.at_time(time);
            let begin = batch.visits.len();
            trace_path(scene, previous, ray, sampler, TrainingRecorder { visits: &mut batch.visits, begin });
            cost += batch.visits[begin..].iter().map(|visit| visit.cost).sum::<f32>();
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
            // Its rest is not stored, and nothing is learned from it.
            last.throughput = 0.0;
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

    // Nothing is learned from the rest of a long path.
    fn abandons(&mut self) -> bool {
        true
    }

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
