//! Training paths of the learned Russian roulette: their outcomes, vertex by vertex.

use crate::dimensions;
use crate::estimator::{Estimator, PixelSample};
use crate::learned_roulette::{CONNECTION, LearnedRoulette, SHADOW, Visit};
use crate::observer::{ConnectionTally, Event, Observer};
use crate::wavefront::{Watch, Wavefront};
use dunkelfeld_film::Sample;
use dunkelfeld_lanes::InstructionSet;
use dunkelfeld_sampling::{BATCHES, Sampler};
use dunkelfeld_scene::{Moment, RayGenerator, Scene};
use std::ops::Range;

/// Seed of the training paths. They are the same for all seeds of a render.
const SEED: u64 = 0x0074_7261_696e_696e;

/// Longest stored part of a training path \[vertices\]. The rest of a longer path counts for its last stored vertex.
const MAX_VISITS: usize = 64;

/// Vertices and further rays of a batch, on average over its paths, after which no path of the batch begins. It limits
/// the time of training in media that scatter many times.
const COST_PER_PATH: f32 = 32.0;

/// Paths that are followed together. The limit of the cost is checked after each so many paths.
const TOGETHER: usize = 8;

/// Pixels in which the variance of the first light samples is measured, and samples of each batch there, as in a
/// render of 32 samples per pixel.
const VARIANCE_PIXELS: u32 = 256;
const BATCH_SAMPLES: u32 = 8;

/// Rounds of training. The paths of each round use the statistics of the round before. More
/// rounds do not reduce the noise (`docs/research/equal-time.md`).
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
        let first_variance = first_light_variance(scene, camera, [width, height]);
        (0..ROUNDS).try_fold(None, |previous: Option<Self>, round| {
            let batch = |n| TrainingBatch::trace(scene, camera, previous.as_ref(), [width, height], n);
            let batches = trace(round * per_round..(round + 1) * per_round, &batch);
            let visits: Vec<&[Visit]> = batches.iter().map(|b| b.visits.as_slice()).collect();
            Self::from_visits(&visits, first_variance).map(Some)
        })?
    }
}

/// The mean variance of the first light samples of a path in a pixel [W^2/(m^4 sr^2)], from the scatter of the batches of the
/// sampler in some pixels. The noisiest pixels, at the edges of lamps, are left out.
fn first_light_variance(scene: &Scene, camera: &RayGenerator, [width, height]: [u32; 2]) -> f64 {
    let estimator = Estimator { scene, camera, width, seed: SEED, frame: 0, roulette: None };
    let mut wavefront = Wavefront::new(&estimator, InstructionSet::best());
    wavefront.only_first_light = true;
    let pixels = (0..VARIANCE_PIXELS).map(|number| {
        let [x, y] = Sampler::new(SEED, u32::MAX - 2, 0, number).get_2d(dimensions::CAMERA);
        [(x * width as f32) as u32, (y * height as f32) as u32]
    });
    let at: Vec<_> =
        pixels.flat_map(|[x, y]| (0..BATCHES * BATCH_SAMPLES).map(move |index| PixelSample { x, y, index })).collect();
    let mut samples = Vec::new();
    wavefront.samples(&at, &mut ConnectionTally::default(), &mut samples);
    let of_pixel = |samples: &[Sample]| {
        let mut sums = [0.0; BATCHES as usize];
        for (index, sample) in samples.iter().enumerate() {
            sums[index % sums.len()] += f64::from(sample.radiance.max_channel());
        }
        let mean = sums.iter().sum::<f64>() / f64::from(BATCHES);
        let deviations: f64 = sums.iter().map(|sum| (sum - mean) * (sum - mean)).sum();
        deviations / (f64::from(BATCHES - 1) * f64::from(BATCH_SAMPLES))
    };
    let mut variances: Vec<f64> = samples.chunks((BATCHES * BATCH_SAMPLES) as usize).map(of_pixel).collect();
    variances.sort_by(f64::total_cmp);
    let kept = &variances[..variances.len() - variances.len() / 16];
    kept.iter().sum::<f64>() / kept.len() as f64
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
        let ray = |path: u32| {
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
            (camera.camera_ray(x * width as f32, y, lens).ray.at_time(time), sampler)
        };
        let estimator = Estimator { scene, camera, width, seed: SEED, frame: 0, roulette: previous };
        let mut wavefront = Wavefront::new(&estimator, InstructionSet::best());
        let mut batch = Self::default();
        for first in (0..Self::PATHS).step_by(TOGETHER) {
            if batch.cost() > COST_PER_PATH * Self::PATHS as f32 {
                break;
            }
            let mut outcomes = PathOutcomes(vec![Vec::new(); TOGETHER]);
            let watch = Watch { tally: &mut ConnectionTally::default(), observer: Some(&mut outcomes) };
            wavefront.begin();
            for (ray, sampler) in (first..first + TOGETHER as u32).map(ray) {
                wavefront.push(&ray, &sampler);
            }
            wavefront.follow(watch);
            batch.visits.extend(outcomes.0.into_iter().flatten());
        }
        batch
    }
}

/// The outcomes of paths, vertex by vertex.
struct PathOutcomes(Vec<Vec<Visit>>);

impl Observer for PathOutcomes {
    fn needs_outcomes(&self) -> bool {
        true
    }

    fn event(&mut self, path: usize, event: Event) {
        let Some(visits) = self.0.get_mut(path) else { return };
        if let Event::Vertex { position, material, in_medium, .. } = event {
            if visits.len() < MAX_VISITS {
                visits.push(Visit {
                    point: position,
                    material: material.filter(|_| !in_medium),
                    is_first: visits.is_empty(),
                    cost: 1.0,
                    ..Visit::default()
                });
            } else if let Some(last) = visits.last_mut() {
                last.cost += 1.0;
                // Its rest is not stored, and nothing is learned from it.
                last.throughput = 0.0;
            }
        }
        let Some(visit) = visits.last_mut() else { return };
        match event {
            Event::Split { .. } | Event::Vertex { .. } => {}
            Event::Emitted(light) => visit.added += light.max_channel(),
            Event::ShadowRay { index, light } => visit.add_ray(SHADOW, index, 1, light),
            Event::Connection { index, connection } => {
                visit.add_ray(CONNECTION, index, connection.rays, connection.contribution);
            }
            Event::Scattered { throughput, .. } => visit.throughput = throughput.max_channel(),
        }
    }
}
