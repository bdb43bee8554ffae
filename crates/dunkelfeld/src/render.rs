//! The render: pilot, plan, rounds, until the budget is met.

use crate::error::Error;
use crate::forecast::{Forecast, Pace};
use crate::planner::{FIRST_LOOK, Planner, State, Verdict};
use crate::progress::{Cancel, Progress, Stage};
use crate::round::{Reporter, RoundWork, TILE, deadline, give_up, run};
use crate::settings::{DEFAULT_SPP, MAX_PIXELS, MAX_SIDE, RenderSettings};
use dunkelfeld_adaptive::allocation::Strategy;
use dunkelfeld_adaptive::cost::{CostMap, TileGrid, feared_makespan, makespan};
use dunkelfeld_adaptive::plan;
use dunkelfeld_adaptive::schedule::{Limits, Phase, Schedule, Settings, Step, StopReason};
use dunkelfeld_film::{Film, Plane};
use dunkelfeld_integrator::{ConnectionTally, Estimator, Label, PixelSample, label};
use dunkelfeld_scene::{Camera, RayGenerator, Scene};
use dunkelfeld_sensor::ExposureNoise;
use rayon::prelude::*;
use std::time::Instant;

/// What exposing, certifying and writing takes [s per megapixel], until it has been measured.
const CLOSING_PER_MEGAPIXEL: f64 = 1.8;
/// The rehearsal of exposing and writing may take this share of the time left; in shorter renders the guess has to do.
const REHEARSAL_SHARE: f64 = 0.05;
/// One in so many pixels gets a sample whatever the clock says: enough to see what the image shows.
const PREVIEW: u64 = 16;
/// What is kept back beyond the rehearsed time: a slow disk, a busy machine.
const CLOSING_MARGIN: f64 = 1.15;

/// A finished (or interrupted) render: statistics of every pixel, and how they came about.
#[derive(Debug)]
pub struct Rendering {
    /// Exact sums per pixel.
    pub film: Film,
    /// What each pixel's centre shows.
    pub labels: Plane<Option<Label>>,
    /// Why it ended.
    pub stop: StopReason,
    /// Was it cancelled from outside?
    pub interrupted: bool,
    /// Seconds spent in each stage, in order.
    pub stages: Vec<(Stage, f64)>,
    /// The first samples that were not finite, negative or out of range.
    pub invalid: Vec<PixelSample>,
    /// Connections through clear covers.
    pub connections: ConnectionTally,
    /// Weights of the last plan, for looking at; mean one.
    pub weights: Plane<f32>,
    /// What the pilot foretold, behind a sensor.
    pub forecast: Option<Forecast>,
    /// Threads that rendered.
    pub threads: usize,
}

impl Rendering {
    /// The plan that was rendered: samples per pixel. Replaying it gives the same film, bit by bit.
    pub fn plan(&self) -> Plane<u32> {
        self.film.sample_counts()
    }
}

/// A pool of worker threads; 0 takes as many as there are cores.
pub fn thread_pool(threads: usize) -> Result<rayon::ThreadPool, Error> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|i| format!("dunkelfeld-{i}"))
        .build()
        .map_err(|e| Error::Threads(e.to_string()))
}

/// Binds the camera that the settings show or name to the film.
///
/// # Errors
/// A camera that the scene does not have, or one without rays for this film.
pub fn camera(scene: &Scene, settings: &RenderSettings) -> Result<RayGenerator, Error> {
    let camera = match &settings.view {
        Some(view) => view.clone(),
        None => find_camera(scene, settings)?,
    };
    Ok(scene.ray_generator(&camera, settings.width, settings.height)?)
}

/// The camera of the scene that the settings name.
pub(crate) fn find_camera(scene: &Scene, settings: &RenderSettings) -> Result<Camera, Error> {
    let aspect = settings.width as f32 / settings.height as f32;
    scene.camera(settings.camera.as_deref(), aspect).ok_or_else(|| {
        let names: Vec<&str> = scene.cameras().iter().map(|c| c.name.as_str()).collect();
        let known = if names.is_empty() { "the scene has none".into() } else { names.join(", ") };
        let name = settings.camera.clone().unwrap_or_default();
        Error::setting(
            "camera",
            format!("there is no camera \"{name}\""),
            format!(
                "cameras: {known}; leave it out for {}",
                if names.is_empty() { "a view of the whole scene" } else { "the first" }
            ),
        )
    })
}

/// Renders a scene within a budget that began at `started`.
///
/// Same scene, settings and sample plan: same film, bit by bit, on any number of threads. With a time limit the clock
/// decides how many samples there are, never which pixel gets them.
///
/// # Errors
/// Settings outside their range, an unknown camera, a replayed plan of another size.
pub fn render(
    scene: &Scene,
    settings: &RenderSettings,
    started: Instant,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Rendering, Error> {
    render_rehearsed(scene, settings, started, progress, cancel, &|_, _| Ok(()))
}

/// Writes what there is so far, as it will be written in the end.
pub(crate) type Rehearsal<'a> = &'a (dyn Fn(&Film, &Plane<Option<Label>>) -> Result<(), Error> + Sync);

/// [`render`], with a rehearsal of the end once the pilot is done, if the time allows: it leaves a first image, finds out
/// early what cannot be written, and tells how much time to keep for the end.
pub(crate) fn render_rehearsed(
    scene: &Scene,
    settings: &RenderSettings,
    started: Instant,
    progress: &dyn Progress,
    cancel: &Cancel,
    rehearsal: Rehearsal<'_>,
) -> Result<Rendering, Error> {
    check(settings)?;
    let camera = camera(scene, settings)?;
    let pool = thread_pool(settings.threads)?;
    let threads = pool.current_num_threads();
    pool.install(|| Renderer::new(scene, &camera, settings, started, threads).run(progress, cancel, rehearsal))
}

pub(crate) fn check(s: &RenderSettings) -> Result<(), Error> {
    let range = format!("1 to {MAX_SIDE}");
    for (name, v) in [("width", s.width), ("height", s.height)] {
        if !(1..=MAX_SIDE).contains(&v) {
            return Err(Error::setting(name, format!("{v} is out of range"), format!("use {range}")));
        }
    }
    let pixels = u64::from(s.width) * u64::from(s.height);
    if pixels > MAX_PIXELS {
        let problem = format!("{} x {} pixels are more than {MAX_PIXELS}", s.width, s.height);
        return Err(Error::setting("film", problem, "render it in parts, or smaller"));
    }
    for (name, v) in [("time", s.budget.seconds), ("spp", s.budget.spp)] {
        if v.is_some_and(|v| !(v.is_finite() && v > 0.0)) {
            return Err(Error::setting(name, "the budget must be a positive number", "use 20s or 64"));
        }
    }
    if let Some(k) = s.budget.noise {
        if !(k.is_finite() && k > 0.0) {
            return Err(Error::setting("noise", "the level must be a positive number", "use 0.7"));
        }
        if !s.has_sensor() {
            let problem = "noise is hidden beneath that of a sensor, and there is none";
            return Err(Error::setting("noise", problem, "choose a sensor, or another budget"));
        }
    }
    if s.strategy == Some(Strategy::Sensor) && !s.has_sensor() {
        let problem = "samples cannot go where a sensor would notice: there is none";
        return Err(Error::setting("allocation", problem, "choose a sensor, or the allocation `variance`"));
    }
    if s.exposure_noise == ExposureNoise::Matched && !s.has_sensor() {
        let problem = "noise is matched to that of a sensor, and there is none";
        return Err(Error::setting("exposure noise", problem, "choose a sensor, or the exposure noise `plain`"));
    }
    if s.budget.spp.is_some_and(|v| v > f64::from(u32::MAX / 4)) {
        return Err(Error::setting("spp", "more samples per pixel than can be counted", "use less than 1e9"));
    }
    if let Some(p) = &s.replay
        && (p.width(), p.height()) != (s.width, s.height)
    {
        let problem = format!("the plan is {} x {} pixels, the film {} x {}", p.width(), p.height(), s.width, s.height);
        return Err(Error::setting("replay", problem, "render at the size of the plan"));
    }
    if s.replay.as_ref().is_some_and(|p| plan::total(p) == 0) {
        return Err(Error::setting("replay", "the plan has no samples", "use a plan of a render that took some"));
    }
    if let Some(most) = s.replay.as_ref().and_then(|p| p.data().iter().copied().max())
        && most > plan::MAX_SPP
    {
        let problem = format!("the plan asks for {most} samples in one pixel, more than {}", plan::MAX_SPP);
        return Err(Error::setting("replay", problem, "use a plan that a render wrote"));
    }
    Ok(())
}

/// The state of a render between rounds.
struct Renderer<'a> {
    scene: &'a Scene,
    camera: &'a RayGenerator,
    settings: &'a RenderSettings,
    started: Instant,
    threads: usize,
    film: Film,
    /// Samples per pixel, and of the whole film: what the film knows too, without going through all of it.
    counts: Plane<u32>,
    taken: u64,
    labels: Plane<Option<Label>>,
    planner: Planner<'a>,
    costs: CostMap,
    stages: Vec<(Stage, f64)>,
    invalid: Vec<PixelSample>,
    connections: ConnectionTally,
}

impl<'a> Renderer<'a> {
    fn new(
        scene: &'a Scene,
        camera: &'a RayGenerator,
        settings: &'a RenderSettings,
        started: Instant,
        threads: usize,
    ) -> Self {
        let (width, height) = (settings.width, settings.height);
        let began = Instant::now();
        let mut renderer = Self {
            scene,
            camera,
            settings,
            started,
            threads,
            film: Film::new(width, height),
            counts: plan::empty(width, height),
            taken: 0,
            labels: labels(scene, camera, width, height),
            planner: Planner::new(settings),
            costs: CostMap::new(TileGrid::new(width, height, TILE)),
            stages: Vec::new(),
            invalid: Vec::new(),
            connections: ConnectionTally::default(),
        };
        renderer.spend(Stage::Build, began);
        renderer
    }

    fn pixels(&self) -> u64 {
        u64::from(self.settings.width) * u64::from(self.settings.height)
    }

    fn run(mut self, progress: &dyn Progress, cancel: &Cancel, rehearsal: Rehearsal<'_>) -> Result<Rendering, Error> {
        let stop = match &self.settings.replay {
            Some(plan) => {
                let total = plan::total(plan);
                let reporter = Reporter::new(progress, self.started, None, Some(total));
                self.round(plan, Stage::Refine, None, cancel, &reporter);
                StopReason::Samples
            }
            None => self.rounds(progress, cancel, rehearsal)?,
        };
        let (weights, forecast) = self.planner.into_parts();
        Ok(Rendering {
            film: self.film,
            labels: self.labels,
            stop,
            interrupted: cancel.is_cancelled(),
            stages: self.stages,
            invalid: self.invalid,
            connections: self.connections,
            weights,
            forecast,
            threads: self.threads,
        })
    }

    /// Pilot and refinements, until the schedule says stop.
    fn rounds(
        &mut self,
        progress: &dyn Progress,
        cancel: &Cancel,
        rehearse: Rehearsal<'_>,
    ) -> Result<StopReason, Error> {
        let budget = self.settings.budget;
        let spp = budget.spp.or((budget.seconds.is_none() && budget.noise.is_none()).then_some(DEFAULT_SPP));
        let samples = spp.map(|spp| plan::total_for_mean(spp, self.pixels()).max(1));
        let mut closing = CLOSING_PER_MEGAPIXEL * self.pixels() as f64 * 1e-6;
        let preview = (self.pixels() / PREVIEW).max(1);
        let limits = Limits {
            seconds: budget.seconds,
            samples,
            at_least: preview.min(samples.unwrap_or(u64::MAX)),
            judged: budget.noise.is_some(),
        };
        // Judged, the pilot begins with a look that tells how large it is to be.
        let pilot_spp = self.settings.pilot_spp.min(if limits.judged { FIRST_LOOK } else { u32::MAX });
        let settings = Settings { pixels: self.pixels(), pilot_spp, closing_seconds: closing };
        let mut schedule = Schedule::new(limits, settings);
        let reporter = Reporter::new(progress, self.started, budget.seconds, samples);
        let mut work_per_sample = 1.0;
        let mut rehearsed = false;
        loop {
            let step = schedule.next(self.started.elapsed().as_secs_f64(), work_per_sample);
            let round = match step {
                Step::Stop(reason) => return Ok(reason),
                Step::Round(round) => Some(round),
                Step::Judge => None,
            };
            if round.is_none_or(|round| round.replan) {
                let began = Instant::now();
                let state = State { film: &self.film, labels: &self.labels, counts: &self.counts };
                let pace = Pace {
                    elapsed: self.started.elapsed().as_secs_f64(),
                    per_work: schedule.pace(),
                    threads: self.threads,
                    costs: &self.costs,
                    closing,
                    limits: (budget.seconds, samples),
                };
                let tell = |forecast: &Forecast| progress.forecast(forecast);
                let mut verdict = None;
                match budget.noise.filter(|_| round.is_none()) {
                    Some(k) => verdict = Some(self.planner.judge(k, state, &pace, tell)?),
                    None => self.planner.plan(state, &pace)?.into_iter().for_each(tell),
                }
                let is_pilot_done = !matches!(verdict, Some(Verdict::GrowPilot(_)));
                let left = budget.seconds.map_or(0.0, |s| s - self.started.elapsed().as_secs_f64());
                if !rehearsed && is_pilot_done && closing < REHEARSAL_SHARE * left {
                    rehearsed = true;
                    let began = Instant::now();
                    rehearse(&self.film, &self.labels)?;
                    closing = closing.max(CLOSING_MARGIN * began.elapsed().as_secs_f64());
                    schedule.set_closing_seconds(closing);
                }
                self.spend(Stage::Plan, began);
                match verdict {
                    None => {}
                    Some(Verdict::Hidden) => return Ok(StopReason::Judged),
                    Some(Verdict::GrowPilot(spp)) => {
                        schedule.grow_pilot(spp);
                    }
                    Some(Verdict::After(samples)) => {
                        reporter.expect(samples);
                        schedule.judged(samples);
                    }
                }
            }
            let Some(round) = round else { continue };
            let stage = if round.phase == Phase::Pilot { Stage::Pilot } else { Stage::Refine };
            let began = Instant::now();
            let (samples, target) = self.target(round.samples, &schedule, limits.at_least);
            self.spend(stage, began);
            // Beyond the samples that a preview must have, a round that would pass the deadline is cut.
            let guard =
                (self.taken >= limits.at_least).then(|| deadline(self.started, budget.seconds, closing)).flatten();
            let began = Instant::now();
            let (taken, work) = self.round(&target, stage, guard, cancel, &reporter);
            if cancel.is_cancelled() {
                return Ok(StopReason::Samples);
            }
            schedule.record(taken, work, began.elapsed().as_secs_f64());
            if taken > 0 {
                work_per_sample = work / taken as f64;
            }
            if taken < samples && guard.is_some_and(|d| Instant::now() > d) {
                return Ok(StopReason::Time);
            }
        }
    }

    /// The plan of a round of so many samples, or of fewer if they turn out to be too much work where they go.
    fn target(&mut self, mut samples: u64, schedule: &Schedule, at_least: u64) -> (u64, Plane<u32>) {
        loop {
            let target = plan::next_round_of(&self.counts, self.planner.shares(), self.taken + samples);
            if self.settings.budget.seconds.is_none() || self.taken < at_least {
                return (samples, target);
            }
            let units = self.costs.cut(&plan::increment(&self.counts, &target), self.threads);
            match schedule.trimmed(samples, feared_makespan(&units, self.threads)) {
                Some(fewer) => samples = fewer,
                None => return (samples, target),
            }
        }
    }

    /// Renders up to a target plan; returns the samples taken and their expected work.
    fn round(
        &mut self,
        target: &Plane<u32>,
        stage: Stage,
        deadline: Option<Instant>,
        cancel: &Cancel,
        reporter: &Reporter<'_>,
    ) -> (u64, f64) {
        let began = Instant::now();
        let increment = plan::increment(&self.counts, target);
        let units = self.costs.cut(&increment, self.threads);
        let work = makespan(&units, self.threads);
        let estimator = Estimator {
            scene: self.scene,
            camera: self.camera,
            width: self.settings.width,
            seed: self.settings.seed,
            frame: self.settings.frame,
        };
        let round = RoundWork {
            estimator: &estimator,
            counts: &self.counts,
            increment: &increment,
            units: &units,
            costs: &self.costs,
            deadline,
            give_up: give_up(deadline, self.settings.budget.seconds),
            cancel,
            stage,
        };
        let result = run(&mut self.film, &round, reporter);
        for &(tile, ..) in &result.tiles {
            let rect = self.costs.grid().rect(tile);
            let width = self.settings.width as usize;
            for y in rect.y0 as usize..rect.y1 as usize {
                let row = y * width + rect.x0 as usize..y * width + rect.x1 as usize;
                let added = &increment.data()[row.clone()];
                self.counts.data_mut()[row].iter_mut().zip(added).for_each(|(count, added)| *count += added);
            }
        }
        self.taken += result.samples;
        self.costs.record(&result.tiles);
        self.connections.add(&result.connections);
        self.invalid.extend(result.invalid);
        self.invalid.truncate(16);
        self.spend(stage, began);
        (result.samples, work)
    }

    fn spend(&mut self, stage: Stage, began: Instant) {
        let seconds = began.elapsed().as_secs_f64();
        match self.stages.last_mut() {
            Some((last, total)) if *last == stage => *total += seconds,
            _ => self.stages.push((stage, seconds)),
        }
    }
}

fn labels(scene: &Scene, camera: &RayGenerator, width: u32, height: u32) -> Plane<Option<Label>> {
    let rows: Vec<Vec<Option<Label>>> =
        (0..height).into_par_iter().map(|y| (0..width).map(|x| label(scene, camera, x, y)).collect()).collect();
    Plane::from_vec(width, height, rows.concat()).unwrap_or_else(|| Plane::new(width, height, None))
}
