//! `dunkelfeld render`: applies flags to a project, renders, writes the files and prints a summary.

mod cameras;
mod debug_sample;
mod report;

use crate::args::RenderArgs;
use crate::bar::Sink;
use crate::interrupt::cancel_on_interrupt;
use crate::outcome::{Outcome, print};
use dunkelfeld::film::CheckpointSettings;
use dunkelfeld::guard::DefaultPath;
use dunkelfeld::sensor::Exposure;
use dunkelfeld::{
    Cancel, Error, OutputPaths, Progress, ProgressState, Project, ProjectOptions, ProjectResult, RenderOptions,
    ReplayOption, Stage,
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
        .with_can_change(false)
        .with_keys(args.keys.keys());
    let mut project = Project::open_with(&args.input, options)?;
    let mut options = RenderOptions::default().with_keys(args.keys.keys());
    options.camera.clone_from(&args.camera);
    options.samples.clone_from(&args.samples);
    options.replay = args.replay.clone().map(ReplayOption::File);
    project.apply_options(options)?;
    project.settings.run.checkpoint = checkpoint;
    for line in notices(&project) {
        sink.say(&line);
    }
    let cancel = cancel_on_interrupt();
    if args.frames.is_some_and(|frames| frames > 1) && !project.capture_names(None).is_empty() {
        let problem = "a capture has one frame, and the job has captures";
        return Err(Error::setting("--frames", problem, "remove [[capture]], and set the lights of one image"));
    }
    let cameras = project.defined_cameras();
    if cameras.len() > 1 {
        let turns = cameras::of_cameras(args, &mut project, &cameras, &sink)?;
        return cameras::run(args, project, turns, started, (&sink, &cancel));
    }
    if let ([camera], false) = (cameras.as_slice(), project.capture_names(None).is_empty()) {
        // A capture may be of another camera than the first one.
        project.settings.camera = Some(camera.clone());
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
    let (mut worst, mut exposure) = (Outcome::Done, None);
    project.render_captures_to_files(sink, cancel, &mut |capture, result| {
        if let Some(capture) = capture {
            print(&format!("capture \"{capture}\"\n"));
        }
        let outputs = capture.map_or_else(|| project.outputs.clone(), |capture| project.outputs.for_camera(capture));
        let (outcome, found) = finish(args, project, result, &outputs, sink)?;
        (worst, exposure) = (worst.max(outcome), found);
        Ok(())
    })?;
    Ok((worst, exposure))
}

/// Writes the files of an image and prints the summary. The second value is the exposure of the sensor.
fn finish(
    args: &RenderArgs,
    project: &Project,
    mut result: ProjectResult,
    outputs: &OutputPaths,
    sink: &Sink,
) -> Result<(Outcome, Option<Exposure>), Error> {
    let (elapsed, samples) = (result.elapsed(), result.stats.sampling.samples);
    sink.update(&ProgressState { stage: Stage::Write, fraction: 1.0, elapsed, remaining: None, samples });
    result.save(outputs)?;
    sink.clear();
    report::print_report(args, project, outputs, &result);
    let is_flagged = result.stats.is_flagged()
        || result.rendering.checkpoint_fault.is_some()
        || (args.strict && result.stats.time.budget_missed);
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

/// Findings of import and scene builder, up to a maximum number of lines.
fn notices(project: &Project) -> Vec<String> {
    let warnings = project.warnings.iter().map(|w| format!("warning: {w}"));
    let report = project.findings();
    let hazards = report.hazards().map(|f| format!("hazard: {}: {}", f.place, f.message));
    [warnings.collect::<Vec<_>>(), hazards.collect()].into_iter().flat_map(shortened).collect()
}

fn shortened(mut lines: Vec<String>) -> Vec<String> {
    let more = lines.len().saturating_sub(MAX_NOTICES);
    if more > 0 {
        lines.truncate(MAX_NOTICES);
        lines.push(format!("... and {more} more; `dunkelfeld inspect` lists them all"));
    }
    lines
}
