//! `dunkelfeld dataset`: makes the images of a study, or checks a set.

use super::dataset_args::DatasetArgs;
use crate::bar::Sink;
use crate::interrupt::cancel_on_interrupt;
use crate::outcome::{Outcome, print, say, say_object};
use crate::words::{counted, remaining, seconds, three_digits};
use dunkelfeld::{Error, Progress, ProgressState, Stage};
use dunkelfeld_dataset::{LevelGap, RunOptions, RunProgress, RunState, SetForecast, Study, run as run_study, verify};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

pub(crate) fn run(args: &DatasetArgs) -> Result<Outcome, Error> {
    if let Some(folder) = &args.verify {
        return check(folder, args);
    }
    let path = args.study.clone().unwrap_or_default();
    let sink = Sink::new(args.progress);
    let study = Arc::new(Study::open(&path)?);
    let folder = args.output.clone().unwrap_or_else(|| PathBuf::from(&study.name));
    let mut options = RunOptions::default();
    options.count = args.count;
    options.indices = (!args.index.is_empty()).then(|| args.index.clone());
    options.jobs = args.jobs.map(usize::from);
    options.threads = args.threads.map(usize::from);
    options.seconds = args.time;
    let cancel = cancel_on_interrupt();
    let progress = SetProgress { sink: &sink };
    let summary = run_study(&study, &folder, &options, &progress, &cancel)?;
    drop(sink);
    let (made, finished, count) = (summary.made, summary.finished, summary.count);
    let rate = if summary.seconds > 0.0 { made as f64 / summary.seconds * 3600.0 } else { 0.0 };
    let pace = if made > 0 { format!(", {rate:.0} an hour") } else { String::new() };
    print(&format!("{made} images made{pace}; {finished} of {count} are in {}\n", folder.display()));
    if let Some(line) = summary.forecast.as_ref().and_then(|forecast| levels_line(&summary.levels, forecast)) {
        print(&format!("{line}\n"));
    }
    if finished == count {
        let page = folder.join("report.html");
        if page.is_file() {
            print(&format!("  {}\n", page.display()));
        }
    }
    if summary.interrupted {
        say("interrupted: the same command goes on");
        return Ok(Outcome::Interrupted);
    }
    if let Some(share) = summary.matched.filter(|share| *share < LEAST_MATCHED) {
        let percent = (100.0 * share).floor();
        say(&format!(
            "warning: noise-matched exposure holds for only {percent} % of the pixels of these images; the others are noisier than the camera; help: use more samples per pixel"
        ));
    }
    if let Some(limit) = summary.missed {
        let over = seconds(summary.seconds - limit);
        let all = seconds(summary.seconds);
        say(&format!("warning: the time budget of {} was missed by {over}; it took {all} in all", seconds(limit)));
    }
    // The message of an image has its own line with the help.
    summary
        .failed
        .iter()
        .take(LISTED)
        .for_each(|(_, message)| say(&format!("flagged: {}", message.replace("\n  help:", "; help:"))));
    if let Some(more) = summary.failed.len().checked_sub(LISTED).filter(|more| *more > 0) {
        say(&format!("flagged: {more} more images could not be made"));
    }
    if summary.elsewhere > 0 {
        let images = counted(summary.elsewhere, "image");
        say(&format!(
            "flagged: another process had {images} in work at the end of the time; help: run the same command again"
        ));
    }
    Ok(if summary.failed.is_empty() && summary.elsewhere == 0 { Outcome::Done } else { Outcome::Flagged })
}

/// Share of the pixels with matched noise below which a run warns.
const LEAST_MATCHED: f64 = 0.9;
/// Images that could not be made, of which messages are shown.
const LISTED: usize = 10;

/// The progress of a set, on the bar of a render.
struct SetProgress<'a> {
    sink: &'a Sink,
}

impl RunProgress for SetProgress<'_> {
    fn update(&self, state: &RunState) {
        match self.sink {
            Sink::Bar(bar) => {
                bar.set_length(state.count.max(1));
                bar.set_position(state.finished);
                bar.set_prefix("images");
                let left = state.remaining.map_or(String::new(), |s| format!(", {}", remaining(s)));
                let level = state.level.map_or(String::new(), |k| format!(", median k = {k:.2}"));
                bar.set_message(format!("{} of {}{level}{left}", state.finished, state.count));
            }
            Sink::Json => say_object(&json!({
                "event": "images", "finished": state.finished, "count": state.count, "elapsed": state.elapsed,
                "remaining": state.remaining, "level": state.level,
            })),
            Sink::None => {}
        }
    }

    fn warning(&self, warning: &str) {
        self.sink.say(&format!("warning: {warning}"));
    }

    fn forecast(&self, forecast: &SetForecast) {
        match self.sink {
            Sink::Json => say_object(&json!({
                "event": "forecast", "count": forecast.count, "end": forecast.end, "seconds": forecast.seconds, "spp": forecast.spp,
                "test_images": forecast.images, "levels": forecast.levels, "reason": forecast.gap.map(reason),
            })),
            Sink::Bar(_) | Sink::None => self.sink.say(&forecast_line(forecast)),
        }
    }
}

/// The line of a forecast.
fn forecast_line(forecast: &SetForecast) -> String {
    let reached = match (range(&forecast.levels), forecast.gap) {
        (Some(range), _) => format!("99 % of the pixels of an image are hidden at k = {range}"),
        (None, gap) => reason(gap.unwrap_or(LevelGap::UnknownNoise)).to_owned(),
    };
    if forecast.gap == Some(LevelGap::NoTime) {
        return reason(LevelGap::NoTime).to_owned();
    }
    format!(
        "forecast from {}: {}, {:.2} s and about {} samples per pixel for the render of each; {reached}; the set is finished in {}",
        counted(forecast.images, "test image"),
        counted(forecast.count, "image"),
        forecast.seconds,
        three_digits(forecast.spp),
        remaining(forecast.end)
    )
}

/// The reason of a forecast without a level.
fn reason(gap: LevelGap) -> &'static str {
    match gap {
        LevelGap::NoSensor => "without a sensor there is no level of noise",
        LevelGap::Saturated => "all pixels are saturated, so that there is no level of noise",
        LevelGap::UnknownNoise => "the level of noise is not known: more than 1 % of the pixels have too few samples",
        LevelGap::NoTime => "the time is too short for a forecast of the noise",
    }
}

/// The levels that were reached, beside those of the forecast. `None` if no image has one.
fn levels_line(levels: &[f64], forecast: &SetForecast) -> Option<String> {
    let (reached, median) = (range(levels)?, levels.get(levels.len() / 2)?);
    let of_forecast = range(&forecast.levels).map_or_else(String::new, |range| format!("; the forecast was {range}"));
    let images = counted(levels.len() as u64, "image");
    Some(format!("99 % of the pixels are hidden at k = {reached}, median {median:.2}, in {images}{of_forecast}"))
}

/// `0.41 to 0.52`, or one number.
fn range(levels: &[f64]) -> Option<String> {
    let [least, most] = [f64::min, f64::max].map(|of| levels.iter().copied().reduce(of));
    let [least, most] = [least?, most?].map(|k| format!("{k:.2}"));
    Some(if least == most { most } else { format!("{least} to {most}") })
}

fn check(folder: &Path, args: &DatasetArgs) -> Result<Outcome, Error> {
    let sink = Sink::new(args.progress);
    let began = Instant::now();
    let found = verify(folder, &|done, count| {
        let fraction = done as f64 / count.max(1) as f64;
        let elapsed = began.elapsed().as_secs_f64();
        let remaining = (done > 0).then(|| elapsed * (1.0 / fraction - 1.0));
        sink.update(&ProgressState { stage: Stage::Load, fraction, elapsed, remaining, samples: 0 });
    })?;
    drop(sink);
    for fault in &found.faults {
        say(&format!("flagged: {fault}"));
    }
    if found.more > 0 {
        say(&format!("flagged: {} more faults", found.more));
    }
    if found.finished < found.count {
        let missing = found.count - found.finished;
        say(&format!(
            "flagged: {missing} of {} images are not finished; help: `dunkelfeld dataset` with the study and -o {} makes them",
            found.count,
            folder.display()
        ));
    }
    print(&format!(
        "{} of {} images are finished; {} files and {} annotations were checked\n",
        found.finished, found.count, found.files, found.annotations
    ));
    Ok(if found.is_whole() { Outcome::Done } else { Outcome::Flagged })
}
