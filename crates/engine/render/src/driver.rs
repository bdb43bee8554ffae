//! The render loop: pilot, plan and refinement until the budget is met.

mod resume;

use crate::checkpoint::{AdaptiveState, CheckpointWriter, ResumedWork, Snapshot};
use crate::error::Error;
use crate::plan::forecast::{Forecast, Throughput};
use crate::plan::{FIRST_LOOK, NoiseVerdict, Planner, State};
use crate::rendered_film::{RenderedFilm, material_names};
use crate::round::{Clock, End, ProgressReporter, RoundWork, TILE, run};
use crate::session::Session;
use crate::settings::{Capture, DEFAULT_SPP, DenoiseMethod, RenderSettings};
use crate::stage::Stage;
use crate::training::train;
use crate::validate::validate;
use crate::view::camera;
use dunkelfeld_adaptive::budget::{Affordable, Levels, Limits, Phase, Schedule, Settings, Step, StopReason};
use dunkelfeld_adaptive::tile_cost::TileGrid;
use dunkelfeld_adaptive::{WorkQueue, plan};
use dunkelfeld_film::{Film, Plane};
use dunkelfeld_integrator::{
    ConnectionTally, Estimator, LaneUse, LearnedRoulette, PixelIds, PixelSample, pixel_ids_of_row,
};
use dunkelfeld_scene::{LightGroups, RayGenerator, Scene};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Assumed duration of exposure, certificate and outputs on one thread [s per megapixel], until it has been measured.
const CLOSING_PER_MEGAPIXEL: f64 = 2.0;
/// Part of the rows of the image in a dry run of exposure and outputs. With a denoiser, which does not take its time row by
/// row, all rows.
const DRY_RUN_PART: usize = 8;
/// Largest share of the remaining time that a dry run may take. Shorter renders use the estimate.
const REHEARSAL_SHARE: f64 = 0.065;
/// Growth of the number of samples from one dry run to the next. More samples take longer to compress.
const DRY_RUN_GROWTH: u64 = 16;
/// One in so many pixels gets a sample in the first level of a render that has a time limit or is watched. It shows the
/// scene.
const PREVIEW: u64 = 16;
/// The first dry run is due when one in so many pixels has a sample. Fewer samples compress too well.
const FIRST_DRY_RUN: u64 = 2;
/// Time between the deadline for samples and the reserve for the end: this share of the limit, and at most so many seconds.
const MARGIN: (f64, f64) = (0.01, 0.25);
/// Time after the deadline for unfinished units: half of the tolerated overrun, this share of the limit and at least so many
/// seconds.
const GRACE: (f64, f64) = (0.01, 0.1);
/// Seconds for the first level of a render, if the deadline is earlier.
const FIRST_GRACE: f64 = 0.25;
/// Factor on the measured closing time, for a slow disk or a busy machine.
const CLOSING_MARGIN: f64 = 1.15;
/// The same for a film of fewer than two samples per pixel: its noise is unknown, so its certificate takes less time.
const EARLY_CLOSING_MARGIN: f64 = 1.3;

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
    /// The same render with the film of a capture.
    ///
    /// # Errors
    /// As [`RenderedFilm::weighted`].
    pub fn of_capture(&self, capture: &Capture) -> Result<Self, Error> {
        Ok(Self {
            film: self.film.of_capture(capture)?,
            stages: self.stages.clone(),
            invalid: self.invalid.clone(),
            weights: self.weights.clone(),
            forecast: self.forecast.clone(),
            checkpoint_fault: self.checkpoint_fault.clone(),
            ..*self
        })
    }

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
        let light_groups = light_groups(scene, settings)?;
        let film = RenderedFilm {
            groups: vec![sums.clone(); light_groups.as_ref().map_or(0, LightGroups::len)],
            sums,
            is_spread: settings.is_spread(),
            ids,
            object_names: scene.object_names().to_vec(),
            material_names: material_names(scene),
        };
        let trained = Instant::now();
        let roulette = train(scene, &camera, settings);
        let training_time = trained.elapsed();
        let (writer, saved) = match &settings.run.checkpoint {
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
        renderer.light_groups = light_groups;
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
    light_groups: Option<LightGroups>,
    session: &'a Session<'a>,
    /// The start of the clock, moved back by the time of earlier processes.
    started: Instant,
    film: RenderedFilm,
    /// Samples per pixel, and of the whole film. The film contains them too, but a scan of it would be needed.
    counts: Plane<u32>,
    taken: u64,
    planner: Planner<'a>,
    queue: WorkQueue,
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
}

/// Next step of the schedule.
enum Next {
    /// A round up to this plan, and beyond it up to so many samples of the image.
    Round(Plane<u32>, u64),
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
            light_groups: None,
            session,
            started: session.started(),
            film,
            counts: settings.samples_before(),
            taken: 0,
            planner: Planner::new(settings),
            queue: WorkQueue::new(TileGrid::new(width, height, TILE)),
            stages: Vec::new(),
            invalid: Vec::new(),
            connections: ConnectionTally::default(),
            lane_use: LaneUse::default(),
            writer: None,
            earlier: ResumedWork::default(),
            course: None,
            target: None,
            stopped: None,
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
                self.round(&plan, total, dry_run, &reporter)?;
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

    /// Pilot and refinement, until the schedule stops the render.
    fn rounds(&mut self, dry_run: &OutputDryRun<'_>) -> Result<StopReason, Error> {
        let limits = self.limits();
        let reporter = ProgressReporter::new(self.session.progress(), self.started, limits.seconds, limits.samples);
        reporter.resume(self.taken);
        if self.course.is_none() {
            self.course = Some(self.first_course(limits));
        }
        loop {
            // A round that an earlier process left open comes first.
            let (target, most) = match self.target.take() {
                Some(target) => (target, self.taken),
                None => match self.next_round(limits, &reporter, dry_run)? {
                    Next::Round(target, most) => (target, most),
                    Next::NoiseTarget => continue,
                    Next::Stop(reason) => return Ok(reason),
                },
            };
            let end = self.round(&target, most, dry_run, &reporter)?;
            if self.session.is_cancelled() {
                self.target = self.settings.budget.seconds.is_none().then_some(target);
                return Ok(StopReason::Samples);
            }
            if let Some(course) = &mut self.course {
                course.schedule.record(self.taken);
            }
            if end == End::Stop {
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
        Limits {
            seconds: budget.seconds,
            samples,
            stop_on_noise: budget.noise.is_some(),
            max_pilot_spp: self.settings.run.max_pilot_spp,
        }
    }

    fn first_course(&self, limits: Limits) -> AdaptiveState {
        let of_image = CLOSING_PER_MEGAPIXEL * self.pixels() as f64 * 1e-6 / self.session.threads().max(1) as f64
            + self.settings.denoise.expected_seconds(self.pixels(), self.session.threads());
        let closing = of_image * self.settings.run.captures.len().max(1) as f64;
        // If the noise ends the render, the pilot begins with a few samples that determine its size.
        let pilot_spp = self.settings.pilot_spp.min(if limits.stop_on_noise { FIRST_LOOK } else { u32::MAX });
        let settings = Settings { pixels: self.pixels(), pilot_spp };
        AdaptiveState {
            schedule: Schedule::new(limits, settings),
            stage: Stage::Pilot,
            closing,
            dry_run_at: self.pixels() / FIRST_DRY_RUN,
        }
    }

    /// Seconds reserved for the end, with the last checkpoint. The first checkpoint measures the duration of one.
    fn closing(&self) -> f64 {
        self.course.as_ref().map_or(0.0, |course| course.closing)
            + self.writer.as_ref().map_or(0.0, |writer| CLOSING_MARGIN * writer.expected_seconds())
    }

    /// The end of the time for samples; `None` without a time limit, and for a given plan.
    fn clock(&self) -> Option<Clock> {
        let limit = self.settings.budget.seconds.filter(|_| self.course.is_some())?;
        let after = |from: Instant, seconds: f64| from.checked_add(Duration::try_from_secs_f64(seconds.max(0.0)).ok()?);
        let deadline = after(self.started, limit - (MARGIN.0 * limit).min(MARGIN.1) - self.closing())?;
        let (is_first, first) = (self.taken == 0, after(Instant::now(), FIRST_GRACE)?);
        let abort_at = after(deadline, (GRACE.0 * limit).max(GRACE.1))?;
        Some(Clock { deadline, abort_at: if is_first { abort_at.max(first) } else { abort_at }, is_first })
    }

    /// Evaluates the schedule. Plans or evaluates the noise where that is due, and does a dry run of the outputs.
    fn next_round(
        &mut self,
        limits: Limits,
        reporter: &ProgressReporter<'_>,
        dry_run: &OutputDryRun<'_>,
    ) -> Result<Next, Error> {
        self.dry_run(dry_run)?;
        let Some(mut course) = self.course.clone() else { return Ok(Next::Stop(StopReason::Samples)) };
        let threads = self.session.threads();
        let left = |clock: Clock| clock.deadline.saturating_duration_since(Instant::now()).as_secs_f64();
        let affordable = match self.clock().map(|clock| self.queue.affordable(threads as f64 * left(clock))) {
            None => Affordable::All,
            Some(None) => Affordable::Unknown,
            Some(Some(samples)) => Affordable::Samples(samples),
        };
        let round = match course.schedule.next(affordable) {
            Step::Stop(reason) => return Ok(Next::Stop(reason)),
            Step::Round(round) => Some(round),
            Step::CheckNoise => None,
        };
        if round.is_none_or(|round| round.replan) {
            let began = Instant::now();
            let state = State { film: &self.film, counts: &self.counts };
            let pace = Throughput {
                elapsed: self.started.elapsed().as_secs_f64(),
                threads,
                costs: self.queue.costs(),
                closing: self.closing(),
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
        let next = match round {
            None => Next::NoiseTarget,
            Some(round) => {
                course.stage = if round.phase == Phase::Pilot { Stage::Pilot } else { Stage::Refine };
                let began = Instant::now();
                let target = plan::next_round(&self.counts, self.planner.weights(), self.taken + round.samples);
                self.spend(course.stage, began);
                Next::Round(target, round.most)
            }
        };
        self.course = Some(course);
        Ok(next)
    }

    /// Makes the outputs of the middle rows if that is due, and measures the duration of all of them from it.
    fn dry_run(&mut self, dry_run: &OutputDryRun<'_>) -> Result<(), Error> {
        let (Some(seconds), Some(course)) = (self.settings.budget.seconds, self.course.clone()) else { return Ok(()) };
        let taken = self.taken.max(self.queue.issued());
        if taken < course.dry_run_at {
            return Ok(());
        }
        let (began, threads) = (Instant::now(), self.session.threads());
        let all = self.film.sums.tile_rows().len();
        let is_denoised = self.settings.denoise.method != DenoiseMethod::Off;
        // Each thread has a row.
        let some = if is_denoised { all } else { all.div_ceil(DRY_RUN_PART).next_multiple_of(threads).min(all) };
        let of_all = all as f64 / some.max(1) as f64;
        let left = seconds - self.started.elapsed().as_secs_f64();
        let mut closing = course.closing;
        if self.closing() <= REHEARSAL_SHARE * left * of_all {
            match (all - some) / 2 {
                0 => dry_run(&self.film)?,
                first => dry_run(&self.film.copy_of_tile_rows(first..first + some))?,
            }
            let margin = if taken < 2 * self.pixels() { EARLY_CLOSING_MARGIN } else { CLOSING_MARGIN };
            closing = margin * of_all * began.elapsed().as_secs_f64();
            self.spend(course.stage, began);
        }
        let dry_run_at = if is_denoised { u64::MAX } else { DRY_RUN_GROWTH.saturating_mul(taken) };
        self.course = Some(AdaptiveState { closing, dry_run_at, ..course });
        Ok(())
    }

    /// Renders up to a target plan, and beyond it up to `most` samples of the image, or until the time is over.
    fn round(
        &mut self,
        target: &Plane<u32>,
        most: u64,
        dry_run: &OutputDryRun<'_>,
        reporter: &ProgressReporter<'_>,
    ) -> Result<End, Error> {
        self.queue.begin([&self.counts, target], self.taken);
        let most = most.max(self.queue.target());
        loop {
            let end = self.pass(target, most, reporter)?;
            if end != End::Pause {
                self.count();
                return Ok(end);
            }
            self.dry_run(dry_run)?;
        }
    }

    /// Counts the samples of the film.
    fn count(&mut self) {
        self.counts = self.settings.samples_before();
        let rendered = self.film.sums.sample_counts();
        self.counts.data_mut().iter_mut().zip(rendered.data()).for_each(|(count, n)| *count += n);
    }

    /// Renders some levels of a round.
    ///
    /// # Errors
    /// There is not enough memory for the film.
    fn pass(&mut self, target: &Plane<u32>, most: u64, reporter: &ProgressReporter<'_>) -> Result<End, Error> {
        let began = Instant::now();
        let estimator = Estimator {
            scene: self.scene,
            camera: self.camera,
            width: self.settings.width,
            seed: self.settings.seed,
            frame: self.settings.frame,
            roulette: self.roulette.as_ref(),
        };
        let (clock, interval) = (self.clock(), self.session.progress().film_interval());
        let state = self.state(None);
        let course = self.course.as_ref();
        // A given plan is available at each resumption, so it is not stored. The clock sets a plan anew.
        let (weights, open) = (course.map(|_| self.planner.weights()), course.and(clock.is_none().then_some(target)));
        let snapshot = Snapshot { state: &state, weights, target: open };
        let stage = course.map_or(Stage::Refine, |course| course.stage);
        let is_open = clock.is_some() || interval.is_some();
        let pause_at = match interval {
            Some(_) => 0,
            None => clock.zip(course).map_or(u64::MAX, |(_, course)| course.dry_run_at),
        };
        let first = if is_open { (self.pixels() / PREVIEW).max(1) } else { self.pixels() };
        let work = RoundWork {
            estimator: &estimator,
            light_groups: self.light_groups.as_ref(),
            counts: &self.counts,
            target,
            levels: Levels { first, most, pixels: self.pixels() },
            pause_at,
            interval,
            clock,
            cancel: self.session.cancel(),
            stage,
            writer: self.writer.as_ref().map(|writer| (writer, snapshot)),
        };
        let films = std::iter::once(&mut self.film.sums).chain(&mut self.film.groups);
        let result = run(films, &mut self.queue, &work, reporter);
        self.taken += result.samples;
        self.connections.add(&result.connections);
        self.lane_use.add(&result.lane_use);
        self.invalid.extend(result.invalid);
        // The clock decides how a round is divided into passes. Sorting makes the list independent of that division.
        self.invalid.sort_by_key(|s| (s.y, s.x, s.index));
        self.invalid.truncate(crate::round::MAX_LISTED);
        self.spend(stage, began);
        if interval.is_some() {
            self.session.progress().film(&self.film);
        }
        if result.out_of_memory {
            return Err(Error::film_memory());
        }
        Ok(result.end.unwrap_or(End::Stop))
    }

    fn spend(&mut self, stage: Stage, began: Instant) {
        let seconds = began.elapsed().as_secs_f64();
        match self.stages.last_mut() {
            Some((last, total)) if *last == stage => *total += seconds,
            _ => self.stages.push((stage, seconds)),
        }
    }
}

/// The groups of lights of the settings. `None` without groups.
fn light_groups(scene: &Scene, settings: &RenderSettings) -> Result<Option<LightGroups>, Error> {
    if settings.run.light_groups.is_empty() {
        return Ok(None);
    }
    let groups: Vec<&[String]> = settings.run.light_groups.iter().map(Vec::as_slice).collect();
    scene.light_groups(&groups).map(Some).map_err(|unknown| match unknown {
        Some(name) => {
            Error::setting("light groups", format!("the scene has no light {name:?}"), "use names of `inspect`")
        }
        None => {
            let problem = format!("there are {} groups of lights", groups.len());
            Error::setting("light groups", problem, format!("use at most {}", LightGroups::MAX - 1))
        }
    })
}

fn pixel_id_plane(scene: &Scene, camera: &RayGenerator, width: u32, height: u32) -> Plane<Option<PixelIds>> {
    let mut labels = Plane::new(width, height, None);
    labels.data_mut().par_chunks_mut((width as usize).max(1)).enumerate().for_each(|(y, row)| {
        pixel_ids_of_row(scene, camera, y as u32, row);
    });
    labels
}
