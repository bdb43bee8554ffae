//! `dunkelfeld render`: applies flags to a project, renders, writes the files and prints a summary.

mod cameras;
mod debug_sample;
mod report;

use crate::args::RenderArgs;
use crate::bar::Sink;
use crate::interrupt::cancel_on_interrupt;
use crate::outcome::Outcome;
use crate::values::ExposureChoice;
use dunkelfeld::sensor::Exposure;
use dunkelfeld::{
    Cancel, CheckpointSettings, DefaultPath, Error, ExposureOption, Progress, ProgressState, Project, ProjectOptions,
    RenderOptions, ReplayOption, SensorOption, Stage,
};
pub(crate) use report::{as_seen, say_flaws};
use std::path::Path;
use std::time::Instant;

/// Maximum number of warnings, and of hazards, that are printed before a render.
const MAX_NOTICES: usize = 20;

pub(crate) fn run(args: &RenderArgs, started: Instant) -> Result<Outcome, Error> {
    let sink = Sink::new(args.run.progress);
    let begin = |stage, fraction, samples| {
        let elapsed = started.elapsed().as_secs_f64();
        sink.update(&ProgressState { stage, fraction, elapsed, remaining: None, samples });
    };
    // The lock comes before loading: another process may use the file.
    let checkpoint = args.checkpoint.as_ref().map(|path| checkpoint(args, path)).transpose()?;
    begin(Stage::Load, 0.0, 0);
    let options = ProjectOptions::default()
        .with_started(started)
        .with_without(args.without.clone())
        .with_threads(args.run.threads.map_or(0, usize::from))
        .with_can_change(false);
    let mut project = Project::open_with(&args.input, options)?;
    project.settings.checkpoint = checkpoint;
    apply(args, &mut project)?;
    for line in notices(args, &project) {
        sink.say(&line);
    }
    let cancel = cancel_on_interrupt();
    let cameras = project.defined_cameras();
    if cameras.len() > 1 {
        let turns = cameras::of_cameras(args, &mut project, &cameras, &sink)?;
        return cameras::run(args, project, turns, started, (&sink, &cancel));
    }
    if let Some(sample) = args.debug_sample {
        return debug_sample::run(&project, sample);
    }
    if project.outputs.image.is_none() {
        let DefaultPath { path, reason } = project.default_image_path(&args.input);
        project.outputs.image = Some(path);
        reason.iter().for_each(|reason| sink.say(&format!("note: {reason}")));
    }
    if let Some(frames @ 2..) = args.frames {
        let turns = cameras::of_frames(&project, frames)?;
        return cameras::run(args, project, turns, started, (&sink, &cancel));
    }
    Ok(render(args, &project, (&sink, &cancel))?.0)
}

/// Renders a project, writes its files and prints the summary. The second value is the exposure of the sensor.
fn render(
    args: &RenderArgs,
    project: &Project,
    (sink, cancel): (&Sink, &Cancel),
) -> Result<(Outcome, Option<Exposure>), Error> {
    let mut result = project.render_to_files(sink, cancel)?;
    let (elapsed, samples) = (result.elapsed(), result.stats.samples);
    sink.update(&ProgressState { stage: Stage::Write, fraction: 1.0, elapsed, remaining: None, samples });
    result.save(&project.outputs)?;
    sink.clear();
    report::print_report(args, project, &result);
    let is_flagged = result.stats.is_flagged()
        || result.rendering.checkpoint_fault.is_some()
        || (args.strict && result.stats.budget_missed);
    let outcome = match (result.rendering.interrupted, is_flagged) {
        (true, _) => Outcome::Interrupted,
        (false, true) => Outcome::Flagged,
        (false, false) => Outcome::Done,
    };
    Ok((outcome, result.frame.sensor.as_ref().map(|sensor| sensor.exposure)))
}

/// The checkpoint of the flags, locked.
fn checkpoint(args: &RenderArgs, path: &Path) -> Result<CheckpointSettings, Error> {
    let mut checkpoint = CheckpointSettings::new(path);
    checkpoint.seconds = args.checkpoint_every.unwrap_or(checkpoint.seconds);
    checkpoint.lock()?;
    Ok(checkpoint)
}

/// Flags override the project's file.
fn apply(args: &RenderArgs, project: &mut Project) -> Result<(), Error> {
    project.apply_options(options(args, project.settings.has_sensor())?)?;
    let o = &mut project.outputs;
    for (to, from) in [
        (&mut o.image, &args.image),
        (&mut o.linear, &args.linear),
        (&mut o.exr, &args.exr),
        (&mut o.stats, &args.stats),
        (&mut o.plan, &args.plan),
    ] {
        if from.is_some() {
            to.clone_from(from);
        }
    }
    o.align = args.align.unwrap_or(o.align);
    project.keep_needed_layers();
    Ok(())
}

/// The flags as options. The checkpoint is not among them: it is locked before the scene is loaded.
fn options(args: &RenderArgs, has_sensor: bool) -> Result<RenderOptions, Error> {
    let (sensor, exposure) = sensor_options(args.sensor.as_deref(), args.exposure, has_sensor)?;
    let has_sensor = sensor.as_ref().map_or(has_sensor, |sensor| *sensor != SensorOption::None);
    if args.exposure_noise.is_some() && !has_sensor {
        let problem = "there is no sensor that adds noise";
        return Err(Error::setting("--exposure-noise", problem, "add --sensor NAME, or leave it out"));
    }
    let mut options = RenderOptions::default();
    (options.width, options.height, options.camera) = (args.width, args.height, args.camera.clone());
    (options.time, options.spp, options.noise, options.share) = (args.time, args.spp, args.noise, args.share);
    (options.seed, options.frame, options.strategy) = (args.seed, args.frame, args.allocate);
    options.replay = args.replay.clone().map(ReplayOption::File);
    options.samples.clone_from(&args.samples);
    (options.sensor, options.exposure, options.exposure_noise) = (sensor, exposure, args.exposure_noise);
    options.vignetting = args.vignetting;
    (options.denoise, options.oidn) = (args.denoise, args.oidn.clone());
    options.memory = args.memory.memory;
    options.threads = args.run.threads.map(usize::from);
    Ok(options)
}

/// Another sensor or exposure, from the flags of any command. `has_sensor` is that of the job.
pub(crate) fn sensor_options(
    sensor: Option<&str>,
    exposure: Option<ExposureChoice>,
    has_sensor: bool,
) -> Result<(Option<SensorOption>, Option<ExposureOption>), Error> {
    let has_sensor = sensor.map_or(has_sensor, |name| name != "none");
    if exposure.is_some() && !has_sensor {
        let problem = "there is no sensor to expose";
        return Err(Error::setting("--exposure", problem, "add --sensor NAME, or leave it out"));
    }
    let sensor = sensor.map(|name| match name {
        "none" => SensorOption::None,
        name => SensorOption::Named(name.into()),
    });
    Ok((sensor, exposure.map(ExposureChoice::option)))
}

/// Findings of import and scene builder, up to a maximum number of lines, and notes about flags.
fn notices(args: &RenderArgs, project: &Project) -> Vec<String> {
    let warnings = project.warnings.iter().map(|w| format!("warning: {w}"));
    let report = project.findings();
    let hazards = report.hazards().map(|f| format!("hazard: {}: {}", f.place, f.message));
    let findings = [warnings.collect::<Vec<_>>(), hazards.collect()].into_iter().flat_map(shortened);
    findings.chain(args.exposure.and_then(ExposureChoice::note)).collect()
}

fn shortened(mut lines: Vec<String>) -> Vec<String> {
    let more = lines.len().saturating_sub(MAX_NOTICES);
    if more > 0 {
        lines.truncate(MAX_NOTICES);
        lines.push(format!("... and {more} more; `dunkelfeld inspect` lists them all"));
    }
    lines
}
