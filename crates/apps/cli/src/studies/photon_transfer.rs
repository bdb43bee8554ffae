//! `dunkelfeld ptc`: applies flags to a project and a measurement, then prints the findings and the path of the report.

use super::photon_transfer_args::PtcArgs;
use super::series::{noted, report, run_study};
use crate::bar::Sink;
use crate::interrupt::cancel_on_interrupt;
use crate::outcome::{Outcome, say};
use dunkelfeld::{Error, Session};
use dunkelfeld_studies::default_folder;
use dunkelfeld_studies::photon_transfer::{PtcOptions, PtcSettings, StackSettings, is_frame, ptc, ptc_of_frames};
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
    let scene_only = [
        ("--frames", args.frames.is_some()),
        ("--spp", !args.spp.is_empty()),
        ("--denoise", args.denoise.is_some() || args.oidn.is_some()),
        ("--pictures-only", args.pictures_only),
        ("--sensor", args.view.keys.value("sensor").is_some()),
        ("--exposure", args.view.keys.value("exposure").is_some()),
        ("--width or --height", ["width", "height"].iter().any(|flag| args.view.keys.value(flag).is_some())),
        ("--camera", args.view.camera.is_some()),
        ("--seed", args.view.keys.value("seed").is_some()),
        ("--restart", args.restart),
        ("--threads", args.view.run.threads.is_some()),
    ];
    if let Some((flag, _)) = scene_only.iter().find(|(_, given)| *given) {
        let problem = "is a setting of a render, and the input is frames";
        return Err(Error::setting(*flag, problem, "leave it out, or give a scene"));
    }
    let defaults = StackSettings::default();
    let settings = StackSettings::default()
        .with_dark(args.dark.unwrap_or(defaults.dark))
        .with_saturation(args.saturation)
        .with_edges(args.edges.unwrap_or(defaults.edges));
    let sink = Sink::new(args.view.run.progress);
    let cancel = cancel_on_interrupt();
    let session = Session::new(1)?.with_progress(&sink).with_cancel(&cancel);
    let stack = ptc_of_frames(&args.inputs, &settings, &session)?;
    drop(sink);
    let Some(stack) = stack else {
        say("interrupted: nothing was written");
        return Ok(Outcome::Interrupted);
    };
    let first = args.inputs.first().map_or_else(PathBuf::new, Clone::clone);
    let folder = args.output.clone().unwrap_or_else(|| noted(default_folder(&first, "ptc", &stack.inputs)));
    let files = stack.write(&folder)?;
    report(&stack.findings(), &files);
    Ok(Outcome::Done)
}

/// Prints the findings and the path of the report on standard output.
fn of_scene(args: &PtcArgs, input: &Path) -> Result<Outcome, Error> {
    for (flag, value) in [("--dark", args.dark), ("--saturation", args.saturation)] {
        if value.is_some() {
            let problem = "is for frames; with a scene, the sensor has that value";
            return Err(Error::setting(flag, problem, "leave it out, or give frames"));
        }
    }
    let settings = settings(args);
    settings.check()?;
    run_study(input, args.output.as_deref(), "ptc", &args.view, |project, folder, session| {
        ptc(project, input, &settings, folder, args.restart, session)
    })
}

fn settings(args: &PtcArgs) -> PtcSettings {
    let options = PtcOptions::default()
        .with_frames(args.frames)
        .with_spp(args.spp.clone())
        .with_denoise(args.denoise)
        .with_oidn(args.oidn.clone())
        .with_edges(args.edges)
        .with_pictures_only(args.pictures_only);
    options.into()
}
