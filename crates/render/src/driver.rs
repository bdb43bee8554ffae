//! The render loop: pilot, plan and rounds until the budget is met.

mod resume;

use crate::checkpoint::{AdaptiveState, CheckpointWriter, ResumedWork, Snapshot};
use crate::error::Error;
use crate::load::ProcessorLoad;
use crate::plan::forecast::{Forecast, Throughput};
use crate::plan::{FIRST_LOOK, NoiseVerdict, Planner, State};
use crate::rendered_film::{RenderedFilm, material_names};
use crate::round::pass::{Portion, Stride};
use crate::round::{ProgressReporter, RoundWork, TILE, abort_at, deadline, run};
use crate::session::Session;
use crate::settings::{DEFAULT_SPP, DenoiseMethod, RenderSettings};
use crate::stage::Stage;
use crate::training::train;
use crate::validate::validate;
use crate::view::camera;
use dunkelfeld_adaptive::budget::{Limits, Phase, Schedule, Settings, Step, StopReason};
use dunkelfeld_adaptive::plan;
use dunkelfeld_adaptive::tile_cost::{CostMap, TileGrid, WorkUnit, makespan, upper_makespan};
use dunkelfeld_film::{Film, Plane};
use dunkelfeld_integrator::{
    ConnectionTally, Estimator, LaneUse, LearnedRoulette, PixelIds, PixelSample, pixel_ids_of_row,
};
use dunkelfeld_scene::{RayGenerator, Scene};
use rayon::prelude::*;
use std::time::Instant;

/// Assumed duration of exposure, certificate and outputs on one thread [s per megapixel], until it has been measured.
const CLOSING_PER_MEGAPIXEL: f64 = 2.0;
/// Part of the rows of the image in a dry run of exposure and outputs. With a denoiser, which does not take its time row by
/// row, all rows.
const DRY_RUN_PART: usize = 8;
/// Largest share of the remaining time that a dry run may take. Shorter renders use the estimate.
const REHEARSAL_SHARE: f64 = 0.065;
/// Growth of the number of samples from one dry run to the next. More samples take longer to compress.
const DRY_RUN_GROWTH: u64 = 4;
/// One in so many pixels gets a sample even if the time is over, so that the image shows the scene.
const PREVIEW: u64 = 16;
/// Factor on the measured closing time, for a slow disk or a busy machine.
const CLOSING_MARGIN: f64 = 1.15;

/// A finished (or interrupted) render: statistics of every pixel, and the course of the render.
#[derive(Debug)]
#[non_exhaustive]
pub struct Rendering {
    /// Exact sums per pixel, ids and names.
    pub film: RenderedFilm,
    /// Reason for its end.
    pub stop: StopReason,
    /// Was it cancelled from outside?
    pub interrupted: bool,
    /// Seconds spent in each stage, in order.
    pub stages: Vec<(Stage, f64)>,
    /// The first samples that were not finite, negative or out of range.
    pub invalid: Vec<PixelSample>,
    /// Connections through clear covers.
    pub connections: ConnectionTally,
    /// Use of the lanes by the samples of this process.
    pub lane_use: LaneUse,
    /// Weights of the last plan, for display; their mean is one.
    pub weights: Plane<f32>,
    /// Forecast of the pilot; `None` without a sensor.
    pub forecast: Option<Forecast>,
    /// Threads that rendered.
    pub threads: usize,
    /// Contribution of a checkpoint, or of the parts of a merged render.
    pub earlier: ResumedWork,
    /// Error of the last write of the checkpoint; `None` if it succeeded, or if there is no checkpoint.
    pub checkpoint_fault: Option<String>,
}

impl Rendering {
    /// The rendered plan: samples per pixel. A replay of it gives the same film, bit by bit.
    pub fn plan(&self) -> Plane<u32> {
        self.film.sums.sample_counts()
    }
}

/// Number of threads: `threads` itself, or the number of cores if it is 0.
pub fn thread_count(threads: usize) -> usize {
    if threads > 0 { threads } else { std::thread::available_parallelism().map_or(1, usize::from) }
}

/// Renders a scene on the threads of the session, within a budget that starts with the clock of the session.
///
/// The same scene, settings and sample plan give the same film, bit by bit, on any number of threads. With a time limit
/// the clock decides how many samples there are, but not which pixels get them.
///
/// # Errors
/// Settings outside their range, an unknown camera, a replayed plan of another size.
pub fn render(scene: &Scene, settings: &RenderSettings, session: &Session<'_>) -> Result<Rendering, Error> {
    render_with_dry_run(scene, settings, session, &|_| Ok(()))
}

/// Dry run of the outputs at the end of a render: writes those of some rows of its film, and removes them.
pub type OutputDryRun<'a> = dyn Fn(&RenderedFilm) -> Result<(), Error> + Sync + 'a;

/// [`render`] with dry runs of the outputs, if there is a time limit. They measure the time to reserve for the end, and detect
/// write errors early.
pub fn render_with_dry_run(
    scene: &Scene,
    settings: &RenderSettings,
    session: &Session<'_>,
    dry_run: &OutputDryRun<'_>,
) -> Result<Rendering, Error> {
    validate(settings)?;
    let camera = camera(scene, settings)?;
    session.install(|| {
        let began = Instant::now();
        let sums = Film::with_layers(settings.width, settings.height, settings.film_layers());
        let ids = pixel_id_plane(scene, &camera, settings.width, settings.height);
        let film = RenderedFilm {
            sums,
            ids,
            object_names: scene.object_names().to_vec(),
            material_names: material_names(scene),
        };
        let trained = Instant::now();
        let roulette = train(scene, &camera, settings);
        let training_time = trained.elapsed();
        let (writer, saved) = match &settings.checkpoint {
            Some(keep) => {
                let (writer, saved) = CheckpointWriter::open(
                    keep,
                    scene,
                    &camera,
                    settings,
                    roulette.as_ref(),
                    &film.ids,
                    session.started(),
                )?;
                (Some(writer), saved)
            }
            None => (None, None),
        };
        let mut renderer = Renderer::new(scene, &camera, settings, session, film);
        renderer.roulette = roulette;
        renderer.writer = writer;
        if let Some(saved) = saved {
            renderer.restore(saved);
        }
        renderer.spend(Stage::Build, began + training_time);
        if renderer.roulette.is_some() {
            renderer.stages.push((Stage::Training, training_time.as_secs_f64()));
        }
        renderer.run(dry_run)
    })
}

/// The state of a render between rounds.
struct Renderer<'a> {
    scene: &'a Scene,
    camera: &'a RayGenerator,
    settings: &'a RenderSettings,
    /// Learned survival probabilities, if the render has training paths.
    roulette: Option<LearnedRoulette>,
    session: &'a Session<'a>,
    /// The start of the clock, moved back by the time of earlier processes.
    started: Instant,
    film: RenderedFilm,
    /// Samples per pixel, and of the whole film. The film contains them too, but a scan of it would be needed.
    counts: Plane<u32>,
    taken: u64,
    planner: Planner<'a>,
    costs: CostMap,
    stride: Stride,
    load: ProcessorLoad,
    /// Number of passes so far, and the samples per second of the last one, for passes that are watched.
    passes: u64,
    rate: Option<f64>,
    /// Seconds for which the render waited for a receiver of its film.
    waited: f64,
    stages: Vec<(Stage, f64)>,
    invalid: Vec<PixelSample>,
    connections: ConnectionTally,
    lane_use: LaneUse,
    writer: Option<CheckpointWriter>,
    earlier: ResumedWork,
    /// State between the rounds, as the checkpoint of the current round stores it.
    course: Option<AdaptiveState>,
    /// Data of an earlier process: the plan of its last round, and the reason for its end.
    target: Option<Plane<u32>>,
    stopped: Option<StopReason>,
    /// The phase of a render with another budget, which this one continues.
    continued: Option<Phase>,
}

/// Next step of the schedule.
enum Next {
    /// A round up to this plan.
    Round(Plane<u32>),
    /// No step yet: the noise has been evaluated, and the schedule must be evaluated again.
    NoiseTarget,
    Stop(StopReason),
}

impl<'a> Renderer<'a> {
    fn new(
        scene: &'a Scene,
        camera: &'a RayGenerator,
        settings: &'a RenderSettings,
        session: &'a Session<'a>,
        film: RenderedFilm,
    ) -> Self {
        let (width, height) = (settings.width, settings.height);
        Self {
            scene,
            camera,
            settings,
            roulette: None,
            session,
            started: session.started(),
            film,
            counts: settings.samples_before(),
            taken: 0,
            planner: Planner::new(settings),
            costs: CostMap::new(TileGrid::new(width, height, TILE)),
            stride: Stride::default(),
            load: ProcessorLoad::default(),
            passes: 0,
            rate: None,
            waited: 0.0,
            stages: Vec::new(),
            invalid: Vec::new(),
            connections: ConnectionTally::default(),
            lane_use: LaneUse::default(),
            writer: None,
            earlier: ResumedWork::default(),
            course: None,
            target: None,
            stopped: None,
            continued: None,
        }
    }

    fn pixels(&self) -> u64 {
        u64::from(self.settings.width) * u64::from(self.settings.height)
    }

    fn run(mut self, dry_run: &OutputDryRun<'_>) -> Result<Rendering, Error> {
        let stop = match (self.stopped, self.settings.given_plan()) {
            (Some(stop), _) => stop,
            (None, Some(plan)) => {
                let total = self.taken + plan::total(&plan::increment(&self.counts, &plan));
                let reporter = ProgressReporter::new(self.session.progress(), self.started, None, Some(total));
                reporter.resume(self.taken);
                self.round(&plan, Stage::Refine, None, &reporter)?;
                StopReason::Samples
            }
            (None, None) => self.rounds(dry_run)?,
        };
        let interrupted = self.session.is_cancelled() && !self.earlier.was_complete;
        if !self.earlier.was_complete {
            self.keep((!interrupted).then_some(stop), true);
        }
        let (weights, forecast) = self.planner.into_parts();
        Ok(Rendering {
            film: self.film,
            stop,
            interrupted,
            stages: self.stages,
            invalid: self.invalid,
            connections: self.connections,
            lane_use: self.lane_use,
            weights,
            forecast,
            threads: self.session.threads(),
            earlier: self.earlier,
            checkpoint_fault: self.writer.and_then(CheckpointWriter::fault),
        })
    }

    /// Pilot and refinements, until the schedule stops the render.
    fn rounds(&mut self, dry_run: &OutputDryRun<'_>) -> Result<StopReason, Error> {
        let limits = self.limits();
        let reporter = ProgressReporter::new(self.session.progress(), self.started, limits.seconds, limits.samples);
        reporter.resume(self.taken);
        let mut course = match self.course.take() {
            Some(course) => course,
            None => self.first_course(limits),
        };
        loop {
            // A round that an earlier process left open comes first.
            let target = match self.target.take() {
                Some(target) => target,
                None => match self.next_round(&mut course, limits, &reporter, dry_run)? {
                    Next::Round(target) => target,
                    Next::NoiseTarget => continue,
                    Next::Stop(reason) => return Ok(reason),
                },
            };
            // The preview has a minimum number of samples. A round beyond it that would pass the deadline is cut.
            let guard = (self.taken >= limits.at_least)
                .then(|| deadline(self.started, limits.seconds, self.closing(&course)))
                .flatten();
            self.course = Some(course.clone());
            let (before, began, waited) = (self.taken, Instant::now(), self.waited);
            let work = self.round(&target, course.stage, guard, &reporter)?;
            if self.session.is_cancelled() {
                self.target = Some(target);
                return Ok(StopReason::Samples);
            }
            // Includes the samples of this round that an earlier process took.
            let seconds = began.elapsed().as_secs_f64() - (self.waited - waited);
            course.schedule.record(self.taken - course.schedule.taken(), work, seconds);
            if self.taken > before {
                course.work_per_sample = work / (self.taken - before) as f64;
            }
            self.course = Some(course.clone());
            if guard.is_some_and(|d| Instant::now() > d) && self.taken < plan::total(&target) {
                return Ok(StopReason::Time);
            }
            self.keep(None, false);
        }
    }

    /// The limits of an adaptive render.
    fn limits(&self) -> Limits {
        let budget = self.settings.budget;
        let spp = budget.spp.or((budget.seconds.is_none() && budget.noise.is_none()).then_some(DEFAULT_SPP));
        let samples = spp.map(|spp| plan::total_for_mean(spp, self.pixels()).max(1));
        let preview = (self.pixels() / PREVIEW).max(1);
        Limits {
            seconds: budget.seconds,
            samples,
            at_least: preview.min(samples.unwrap_or(u64::MAX)),
            stop_on_noise: budget.noise.is_some(),
            max_pilot_spp: self.settings.max_pilot_spp,
        }
    }

    fn first_course(&self, limits: Limits) -> AdaptiveState {
        let closing = CLOSING_PER_MEGAPIXEL * self.pixels() as f64 * 1e-6 / self.session.threads().max(1) as f64
            + self.settings.denoise.expected_seconds(self.pixels(), self.session.threads());
        // If the noise ends the render, the pilot begins with a few samples that determine its size.
        let pilot_spp = self.settings.pilot_spp.min(if limits.stop_on_noise { FIRST_LOOK } else { u32::MAX });
        let settings = Settings { pixels: self.pixels(), pilot_spp, closing_seconds: closing };
        let mut schedule = Schedule::new(limits, settings);
        if let Some(phase) = self.continued {
            schedule.start_at(self.taken, phase);
        }
        AdaptiveState { schedule, stage: Stage::Pilot, work_per_sample: 1.0, closing, dry_run_at: limits.at_least }
    }

    /// Seconds reserved for the end, with the last checkpoint. The first checkpoint measures the duration of one. Other
    /// programs lengthen the end as they lengthened the rounds.
    fn closing(&self, course: &AdaptiveState) -> f64 {
        self.load.stretched(course.closing)
            + self.writer.as_ref().map_or(0.0, |writer| CLOSING_MARGIN * writer.expected_seconds())
    }

    /// Evaluates the schedule. Plans or evaluates the noise where that is due, and does a dry run of the outputs.
    fn next_round(
        &mut self,
        course: &mut AdaptiveState,
        limits: Limits,
        reporter: &ProgressReporter<'_>,
        dry_run: &OutputDryRun<'_>,
    ) -> Result<Next, Error> {
        if let Some(seconds) = limits.seconds {
            self.dry_run(course, seconds, dry_run)?;
        }
        let closing = self.closing(course);
        course.schedule.set_closing_seconds(closing);
        let round = match course.schedule.next(self.started.elapsed().as_secs_f64(), course.work_per_sample) {
            Step::Stop(reason) => return Ok(Next::Stop(reason)),
            Step::Round(round) => Some(round),
            Step::CheckNoise => None,
        };
        if round.is_none_or(|round| round.replan) {
            let began = Instant::now();
            let state = State { film: &self.film, counts: &self.counts };
            let pace = Throughput {
                elapsed: self.started.elapsed().as_secs_f64(),
                per_work: course.schedule.pace(),
                threads: self.session.threads(),
                costs: &self.costs,
                closing,
                limits: (limits.seconds, limits.samples),
            };
            let report = |forecast: &Forecast| reporter.sink.forecast(forecast);
            let mut verdict = None;
            match self.settings.budget.noise.filter(|_| round.is_none()) {
                Some(k) => verdict = Some(self.planner.judge(k, state, &pace, report)?),
                None => self.planner.plan(state, &pace)?.into_iter().for_each(report),
            }
            self.spend(Stage::Plan, began);
            match verdict {
                None => {}
                Some(NoiseVerdict::Hidden) => return Ok(Next::Stop(StopReason::NoiseTarget)),
                Some(NoiseVerdict::GrowPilot(spp)) => {
                    course.schedule.grow_pilot(spp);
                }
                Some(NoiseVerdict::After(samples)) => {
                    reporter.expect(samples);
                    course.schedule.stop_on_noise(samples);
                }
            }
        }
        let Some(round) = round else { return Ok(Next::NoiseTarget) };
        course.stage = if round.phase == Phase::Pilot { Stage::Pilot } else { Stage::Refine };
        let began = Instant::now();
        let target = self.target(round.samples, &course.schedule, limits.at_least);
        self.spend(course.stage, began);
        Ok(Next::Round(target))
    }

    /// Makes the outputs of the middle rows if that is due, and measures the duration of all of them from it.
    fn dry_run(&mut self, course: &mut AdaptiveState, seconds: f64, dry_run: &OutputDryRun<'_>) -> Result<(), Error> {
        let began = Instant::now();
        let all = self.film.sums.tile_rows().len();
        let is_denoised = self.settings.denoise.method != DenoiseMethod::Off;
        let some = if is_denoised { all } else { all.div_ceil(DRY_RUN_PART) };
        let of_all = all as f64 / some.max(1) as f64;
        let left = seconds - self.started.elapsed().as_secs_f64();
        if self.taken < course.dry_run_at || self.closing(course) > REHEARSAL_SHARE * left * of_all {
            return Ok(());
        }
        match (all - some) / 2 {
            0 => dry_run(&self.film)?,
            first => dry_run(&self.film.copy_of_tile_rows(first..first + some))?,
        }
        course.closing = CLOSING_MARGIN * of_all * self.load.on_idle_processors(began.elapsed().as_secs_f64());
        course.dry_run_at = if is_denoised { u64::MAX } else { DRY_RUN_GROWTH * self.taken };
        self.spend(course.stage, began);
        Ok(())
    }

    /// The plan of a round of so many samples. It has fewer if these samples are too much work in their tiles.
    fn target(&mut self, mut samples: u64, schedule: &Schedule, at_least: u64) -> Plane<u32> {
        loop {
            let target = plan::next_round(&self.counts, self.planner.shares(), self.taken + samples);
            if self.settings.budget.seconds.is_none() || self.taken < at_least {
                return target;
            }
            let units = self.costs.cut(&plan::increment(&self.counts, &target), self.session.threads());
            match schedule.trimmed(samples, upper_makespan(&units, self.session.threads())) {
                Some(fewer) => samples = fewer,
                None => return target,
            }
        }
    }

    /// Renders up to a target plan, in passes. Returns the expected work.
    ///
    /// A tile is added to the film, and to checkpoints, when all of its samples of a pass are complete. So a pass has
    /// no more samples of a pixel than the [`Stride`], however large the round is. The sums are exact: passes change no
    /// bit of the result.
    fn round(
        &mut self,
        target: &Plane<u32>,
        stage: Stage,
        deadline: Option<Instant>,
        reporter: &ProgressReporter<'_>,
    ) -> Result<f64, Error> {
        let mut increment = plan::increment(&self.counts, target);
        let mut units = self.costs.cut(&increment, self.session.threads());
        let work = makespan(&units, self.session.threads());
        loop {
            let portion = self.portion();
            let needed = plan::total(&increment);
            portion.limit(increment.data_mut(), self.passes);
            self.passes += 1;
            let is_last = plan::total(&increment) == needed;
            if !is_last {
                units = self.costs.cut(&increment, self.session.threads());
            }
            let pass = Pass { target, increment: &increment, units: &units, deadline, stage };
            // The missing samples were cut off by the deadline or by a cancellation.
            if self.pass(pass, reporter)? < plan::total(&increment) || is_last {
                return Ok(work);
            }
            increment = plan::increment(&self.counts, target);
            units = self.costs.cut(&increment, self.session.threads());
        }
    }

    /// The samples of the next pass.
    fn portion(&self) -> Portion {
        let most = self.stride.samples();
        match self.session.progress().film_interval() {
            None => Portion { samples: most, one_in: 1 },
            Some(interval) => {
                let Portion { samples, one_in } = Portion::watched(interval, self.pixels(), self.rate);
                Portion { samples: samples.min(most), one_in }
            }
        }
    }

    /// Renders a pass of a round. Returns the number of samples that reached the film.
    ///
    /// # Errors
    /// There is not enough memory for the film.
    fn pass(&mut self, pass: Pass<'_>, reporter: &ProgressReporter<'_>) -> Result<u64, Error> {
        let Pass { target, increment, units, deadline, stage } = pass;
        let began = Instant::now();
        let estimator = Estimator {
            scene: self.scene,
            camera: self.camera,
            width: self.settings.width,
            seed: self.settings.seed,
            frame: self.settings.frame,
            roulette: self.roulette.as_ref(),
        };
        let state = self.state(None);
        // A given plan is available at each resumption, so it is not stored.
        let plans = self.course.is_some();
        let (shares, open) = (plans.then(|| self.planner.shares()), plans.then_some(target));
        let snapshot = Snapshot { state: &state, shares, target: open };
        let round = RoundWork {
            estimator: &estimator,
            counts: &self.counts,
            increment,
            units,
            costs: &self.costs,
            deadline,
            abort_at: abort_at(deadline, self.settings.budget.seconds),
            cancel: self.session.cancel(),
            stage,
            writer: self.writer.as_ref().map(|writer| (writer, snapshot)),
        };
        let result = run(&mut self.film.sums, &round, reporter);
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
        self.load.add(result.load);
        self.connections.add(&result.connections);
        self.lane_use.add(&result.lane_use);
        self.invalid.extend(result.invalid);
        // The clock decides how a round is divided into passes. Sorting makes the list independent of that division.
        self.invalid.sort_by_key(|s| (s.y, s.x, s.index));
        self.invalid.truncate(crate::round::MAX_LISTED);
        self.spend(stage, began);
        if self.session.progress().film_interval().is_some() {
            let seconds = began.elapsed().as_secs_f64();
            if result.samples > 0 && seconds > 0.0 {
                self.rate = Some(result.samples as f64 / seconds);
            }
            let began = Instant::now();
            self.show_film();
            self.waited += began.elapsed().as_secs_f64();
        }
        let dearest = result.tiles.iter().map(|&(.., seconds)| seconds).fold(0.0, f64::max);
        self.stride.measured(dearest.min(began.elapsed().as_secs_f64()));
        if result.out_of_memory {
            return Err(Error::film_memory());
        }
        Ok(result.samples)
    }

    fn spend(&mut self, stage: Stage, began: Instant) {
        let seconds = began.elapsed().as_secs_f64();
        match self.stages.last_mut() {
            Some((last, total)) if *last == stage => *total += seconds,
            _ => self.stages.push((stage, seconds)),
        }
    }
}

/// A part of a round.
#[derive(Clone, Copy)]
struct Pass<'a> {
    /// The plan of the round.
    target: &'a Plane<u32>,
    /// New samples per pixel.
    increment: &'a Plane<u32>,
    units: &'a [WorkUnit],
    deadline: Option<Instant>,
    stage: Stage,
}

fn pixel_id_plane(scene: &Scene, camera: &RayGenerator, width: u32, height: u32) -> Plane<Option<PixelIds>> {
    let mut labels = Plane::new(width, height, None);
    labels.data_mut().par_chunks_mut((width as usize).max(1)).enumerate().for_each(|(y, row)| {
        pixel_ids_of_row(scene, camera, y as u32, row);
    });
    labels
}
