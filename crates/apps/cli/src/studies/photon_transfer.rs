//! `dunkelfeld ptc`: applies flags to a project and a measurement, then prints the findings and the path of the report.

use super::photon_transfer_args::PtcArgs;
use super::series::{report, run_study};
use crate::outcome::Outcome;
use dunkelfeld::{Error, Session};
use dunkelfeld_studies::default_folder;
use dunkelfeld_studies::photon_transfer::{PtcSettings, is_frame, of_render_only, ptc, ptc_of_frames};
use std::path::{Path, PathBuf};

pub(crate) fn run(args: &PtcArgs) -> Result<Outcome, Error> {
    match args.inputs.as_slice() {
        inputs if inputs.iter().all(|path| is_frame(path)) => of_frames(args),
        [input] => of_scene(args, input),
        _ => {
            let problem = format!("{} inputs are neither one scene nor a stack of frames", args.inputs.len());
            Err(Error::setting("inputs", problem, "give one scene or job, or frames (.png, .tif, .bmp) alone"))
        }
    }
}

/// The photon transfer of files.
fn of_frames(args: &PtcArgs) -> Result<Outcome, Error> {
    let keys = ["sensor", "exposure", "width", "height", "seed"];
    let flags = [("camera", args.view.camera.is_some()), ("restart", args.restart)];
    let threads = [("threads", args.view.run.threads.is_some())];
    let given = keys.map(|flag| (flag, args.view.keys.value(flag).is_some())).into_iter().chain(flags).chain(threads);
    if let Some((flag, _)) = given.into_iter().find(|(_, is_given)| *is_given) {
        return Err(of_render_only(flag));
    }
    let work = |session: &Session<'_>| ptc_of_frames(&args.inputs, &settings(args), session);
    let Some(stack) = args.view.run.work(work)? else { return Ok(Outcome::Interrupted) };
    let first = args.inputs.first().map_or_else(PathBuf::new, Clone::clone);
    let folder = args.output.clone().unwrap_or_else(|| default_folder(&first, "ptc"));
    let files = stack.write(&folder)?;
    report(&stack.findings(), &files);
    Ok(Outcome::Done)
}

/// Prints the findings and the path of the report on standard output.
fn of_scene(args: &PtcArgs, input: &Path) -> Result<Outcome, Error> {
    let settings = settings(args);
    settings.check()?;
    run_study(input, args.output.as_deref(), "ptc", &args.view, |project, folder, session| {
        ptc(project, input, &settings, folder, args.restart, session)
    })
}

fn settings(args: &PtcArgs) -> PtcSettings {
    PtcSettings::default()
        .with_frames(args.frames)
        .with_spp(args.spp.clone())
        .with_denoise(args.denoise)
        .with_oidn(args.oidn.clone())
        .with_edges(args.edges)
        .with_pictures_only(args.pictures_only)
        .with_dark(args.dark)
        .with_saturation(args.saturation)
}
