//! `dunkelfeld ptc`: flags onto a project and a measurement, then what was found and where it lies.

use crate::args::{Denoise, PtcArgs};
use crate::bar::Sink;
use crate::commands::render::{apply_denoise, apply_sensor};
use crate::interrupt::cancel_on_interrupt;
use crate::outcome::{Outcome, print, say};
use dunkelfeld::ptc::{PtcSettings, ptc, ptc_folder};
use dunkelfeld::{Error, Progress, ProgressState, Project, Stage};
use std::time::Instant;

pub(crate) fn run(args: &PtcArgs, started: Instant) -> Result<Outcome, Error> {
    let settings = settings(args);
    settings.check()?;
    let sink = Sink::new(args.progress);
    sink.update(&ProgressState { stage: Stage::Load, fraction: 0.0, elapsed: 0.0, remaining: None, samples: 0 });
    let mut project = Project::open_at(&args.input, started)?;
    apply(args, &mut project)?;
    let folder = args.output.clone().unwrap_or_else(|| ptc_folder(&args.input));
    let cancel = cancel_on_interrupt();
    let outcome = ptc(project, &args.input, &settings, &folder, args.restart, &sink, &cancel)?;
    drop(sink);
    let mut text = outcome.findings.iter().fold(String::new(), |text, line| text + line + "\n");
    if let Some(page) = outcome.files.first() {
        let others = outcome.files.len() - 1;
        text += &format!("wrote {} and {others} tables and charts beside it\n", page.display());
    }
    print(&text);
    if outcome.invalid_samples > 0 {
        let n = outcome.invalid_samples;
        say(&format!("flagged: {n} samples were not finite, negative or out of range; they count as black"));
    }
    let [done, all] = outcome.finished;
    if outcome.interrupted && done < all {
        say(&format!("interrupted: {done} of {all} renders are kept; the same command goes on from there"));
        return Ok(Outcome::Interrupted);
    }
    Ok(if outcome.invalid_samples > 0 { Outcome::Flagged } else { Outcome::Done })
}

fn settings(args: &PtcArgs) -> PtcSettings {
    let mut settings = PtcSettings::default();
    settings.frames = args.frames.unwrap_or(settings.frames);
    if !args.spp.is_empty() {
        settings.spp.clone_from(&args.spp);
    }
    settings.edges = args.edges.unwrap_or(settings.edges);
    settings.camera = !args.pictures_only;
    let method = args.denoise.or(args.oidn.is_none().then_some(Denoise::Auto));
    apply_denoise(method, args.oidn.as_ref(), &mut settings.denoise);
    settings
}

/// Flags win over what the project's file says.
fn apply(args: &PtcArgs, project: &mut Project) -> Result<(), Error> {
    let s = &mut project.settings;
    s.width = args.width.unwrap_or(s.width);
    s.height = args.height.unwrap_or(s.height);
    s.seed = args.seed.unwrap_or(s.seed);
    s.threads = args.threads.map_or(s.threads, usize::from);
    if args.camera.is_some() {
        s.camera.clone_from(&args.camera);
    }
    apply_sensor(args.sensor.as_deref(), args.exposure, s, project.optics)
}
