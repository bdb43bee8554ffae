//! `dunkelfeld bench`: applies flags to a project and a measurement, then prints the findings and the path of the
//! report.

use super::bench_args::BenchArgs;
use super::series::{conclude, noted, open, report};
use crate::bar::Sink;
use crate::interrupt::cancel_on_interrupt;
use crate::outcome::Outcome;
use dunkelfeld::{Error, Progress, ProgressState, Session, Stage};
use dunkelfeld_studies::bench::{BenchOptions, BenchSettings, bench, default_folder};

pub(crate) fn run(args: &BenchArgs) -> Result<Outcome, Error> {
    let settings = settings(args);
    settings.check()?;
    let sink = Sink::new(args.view.run.progress);
    sink.update(&ProgressState { stage: Stage::Load, fraction: 0.0, elapsed: 0.0, remaining: None, samples: 0 });
    let project = open(&args.input, &args.view)?;
    let folder = args.output.clone().unwrap_or_else(|| noted(default_folder(&args.input, &project.inputs)));
    let own_size = ["width", "height"].iter().any(|flag| args.view.keys.value(flag).is_some());
    let cancel = cancel_on_interrupt();
    let session = Session::new(project.settings.threads)?.with_progress(&sink).with_cancel(&cancel);
    let outcome = bench(project, &args.input, &settings, &folder, own_size, args.restart, &session)?;
    drop(sink);
    report(&outcome.findings, &outcome.files);
    Ok(conclude(outcome.invalid_samples, outcome.finished, outcome.interrupted))
}

fn settings(args: &BenchArgs) -> BenchSettings {
    let options = BenchOptions::default()
        .with_quick(args.quick)
        .with_spp(args.spp.clone())
        .with_seeds(args.seeds)
        .with_strategies(args.strategies.clone())
        .with_noise(args.noise.clone())
        .with_effects(args.effects.as_ref().map(|choice| choice.0.clone()))
        .with_denoise(args.denoise.clone())
        .with_oidn(args.oidn.clone())
        .with_effect_spp(args.effect_spp)
        .with_reference_spp(args.reference_spp);
    options.into()
}
