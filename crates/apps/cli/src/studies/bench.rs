//! `dunkelfeld bench`: applies flags to a project and a measurement, then prints the findings and the path of the
//! report.

use super::bench_args::BenchArgs;
use super::series::run_study;
use crate::outcome::Outcome;
use dunkelfeld::Error;
use dunkelfeld_studies::bench::{BenchSettings, bench};

pub(crate) fn run(args: &BenchArgs) -> Result<Outcome, Error> {
    let settings = settings(args);
    settings.check()?;
    let own_size = ["width", "height"].iter().any(|flag| args.view.keys.value(flag).is_some());
    run_study(&args.input, args.output.as_deref(), "bench", &args.view, |project, folder, session| {
        bench(project, &args.input, &settings, folder, own_size, args.restart, session)
    })
}

fn settings(args: &BenchArgs) -> BenchSettings {
    BenchSettings::default()
        .with_quick(args.quick)
        .with_spp(args.spp.clone())
        .with_seeds(args.seeds)
        .with_strategies(args.strategies.clone())
        .with_noise(args.noise.clone())
        .with_effects(args.effects.as_ref().map(|choice| choice.0.clone()))
        .with_denoise(args.denoise.clone())
        .with_oidn(args.oidn.clone())
        .with_effect_spp(args.effect_spp)
        .with_reference_spp(args.reference_spp)
}
