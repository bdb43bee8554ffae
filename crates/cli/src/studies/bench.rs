//! `dunkelfeld bench`: applies flags to a project and a measurement, then prints the findings and the path of the
//! report.

use super::bench_args::BenchArgs;
use super::series::{conclude, noted, report};
use crate::bar::Sink;
use crate::commands::render::apply_view;
use crate::interrupt::cancel_on_interrupt;
use crate::outcome::Outcome;
use dunkelfeld::{DenoiseMethod, Error, Progress, ProgressState, Project, ProjectOptions, Session, Stage};
use dunkelfeld_studies::bench::{BenchSettings, bench, default_folder};

pub(crate) fn run(args: &BenchArgs) -> Result<Outcome, Error> {
    let settings = settings(args);
    settings.check()?;
    let sink = Sink::new(args.view.run.progress);
    sink.update(&ProgressState { stage: Stage::Load, fraction: 0.0, elapsed: 0.0, remaining: None, samples: 0 });
    let mut project = Project::open_with(&args.input, ProjectOptions::default().with_can_change(false))?;
    apply_view(&args.view, &mut project)?;
    let folder = args.output.clone().unwrap_or_else(|| noted(default_folder(&args.input, &project.inputs)));
    let own_size = args.view.width.is_some() || args.view.height.is_some();
    let cancel = cancel_on_interrupt();
    let session = Session::new(project.settings.threads)?.with_progress(&sink).with_cancel(&cancel);
    let outcome = bench(project, &args.input, &settings, &folder, own_size, args.restart, &session)?;
    drop(sink);
    report(&outcome.findings, &outcome.files);
    Ok(conclude(outcome.invalid_samples, outcome.finished, outcome.interrupted))
}

fn settings(args: &BenchArgs) -> BenchSettings {
    let mut settings = if args.quick { BenchSettings::quick() } else { BenchSettings::default() };
    if !args.spp.is_empty() {
        settings = settings.with_ladder(args.spp.clone());
    }
    if !args.strategies.is_empty() {
        settings.strategies.clone_from(&args.strategies);
    }
    if !args.noise.is_empty() {
        settings.levels.clone_from(&args.noise);
    }
    settings.denoisers = match args.denoise.as_slice() {
        [] | [DenoiseMethod::Auto] => None,
        [DenoiseMethod::Off] => Some(Vec::new()),
        named => Some(named.to_vec()),
    };
    settings.oidn.clone_from(&args.oidn);
    settings.seeds = args.seeds.unwrap_or(settings.seeds);
    settings.effect_spp = args.effect_spp.unwrap_or(settings.effect_spp);
    settings.reference_spp = args.reference_spp.unwrap_or(settings.reference_spp);
    settings.effects = args.effects.as_ref().map(|choice| choice.0.clone());
    settings
}
