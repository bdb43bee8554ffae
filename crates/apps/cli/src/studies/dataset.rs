//! `dunkelfeld dataset`: makes the images of a study, or checks a set.

use super::dataset_args::DatasetArgs;
use crate::bar::Sink;
use crate::interrupt::cancel_on_interrupt;
use crate::outcome::{Outcome, print, say, say_object};
use crate::words::{counted, remaining, seconds};
use dunkelfeld::{Error, Progress, ProgressState, Stage};
use dunkelfeld_dataset::{Price, RunOptions, RunProgress, RunState, Study, run as run_study, verify};
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
    if let Some(price) = &summary.price {
        print(&format!("  {price}\n"));
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
    summary.failed.iter().take(LISTED).for_each(|(_, message)| say(&format!("flagged: {message}")));
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
                bar.set_message(format!("{} of {}{left}", state.finished, state.count));
            }
            Sink::Json => say_object(&json!({
                "event": "images", "finished": state.finished, "count": state.count, "elapsed": state.elapsed,
                "remaining": state.remaining,
            })),
            Sink::None => {}
        }
    }

    fn price(&self, price: &Price) {
        match self.sink {
            Sink::Bar(_) => self.sink.say(&price.to_string()),
            Sink::Json => {
                let mut line = json!(price);
                line["event"] = "price".into();
                say_object(&line);
            }
            Sink::None => {}
        }
    }

    fn warning(&self, warning: &str) {
        self.sink.say(&format!("warning: {warning}"));
    }
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
