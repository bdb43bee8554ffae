//! `render` of several cameras or frames: one load of the scene, and one render and one set of files for each.

use super::render;
use crate::args::RenderArgs;
use crate::bar::Sink;
use crate::outcome::{Outcome, print};
use dunkelfeld::{Cancel, Error, OutputPaths, Project, SensorChoice};
use std::time::Instant;

/// Shortest time limit of a render \[s\], for one whose turn comes after the end of the budget.
const SHORTEST: f64 = 1e-3;

/// One of several renders.
pub(super) struct Turn {
    camera: Option<String>,
    frame: Option<u32>,
    outputs: OutputPaths,
}

/// The renders of the cameras that a job defines. Flags that belong to the render of one camera are refused.
pub(super) fn of_cameras(
    args: &RenderArgs,
    project: &mut Project,
    cameras: &[String],
    sink: &Sink,
) -> Result<Vec<Turn>, Error> {
    let of_one = [
        ("--checkpoint", args.checkpoint.is_some()),
        ("--frames", args.frames.is_some_and(|frames| frames > 1)),
        ("--replay", args.replay.is_some()),
        ("--samples", args.samples.is_some()),
        ("--debug-sample", args.debug_sample.is_some()),
    ];
    if let Some((flag, _)) = of_one.iter().find(|(_, given)| *given) {
        let names: Vec<String> = cameras.iter().map(|name| format!("\"{name}\"")).collect();
        let problem = format!("it is for one camera, and the job defines {}: {}", cameras.len(), names.join(", "));
        return Err(Error::setting(*flag, problem, "add `--camera NAME`"));
    }
    let mut turns = Vec::new();
    for camera in cameras {
        project.settings.camera = Some(camera.clone());
        project.fitted()?;
        let mut outputs = project.outputs.for_camera(camera);
        if outputs.image.is_none() {
            let chosen = project.default_image_path_of(&args.input, camera, &outputs);
            chosen.reason.iter().for_each(|reason| sink.say(&format!("note: {reason}")));
            outputs.image = Some(chosen.path);
        }
        turns.push(Turn { camera: Some(camera.clone()), frame: None, outputs });
    }
    Ok(turns)
}

/// The renders of several frames, whose outputs are named.
pub(super) fn of_frames(project: &Project, frames: u32) -> Result<Vec<Turn>, Error> {
    let first = project.settings.frame;
    let Some(last) = first.checked_add(frames - 1) else {
        let problem = format!("{frames} frames from number {first} on cannot be counted");
        return Err(Error::setting("--frames", problem, "use numbers below 2^32"));
    };
    let turn = |n| Turn { camera: None, frame: Some(n), outputs: project.outputs.for_frame(n, last) };
    Ok((first..=last).map(turn).collect())
}

/// Does the renders one after the other. The rest of a time budget is divided evenly among those that follow. Frames
/// have the automatic exposure of the first one.
pub(super) fn run(
    args: &RenderArgs,
    mut project: Project,
    turns: Vec<Turn>,
    started: Instant,
    (sink, cancel): (&Sink, &Cancel),
) -> Result<Outcome, Error> {
    let of_turn = |turn: &Turn| match project.capture_names(turn.camera.as_deref()) {
        names if names.is_empty() => vec![turn.outputs.clone()],
        names => names.iter().map(|name| turn.outputs.for_camera(name)).collect(),
    };
    let files: Vec<OutputPaths> = turns.iter().flat_map(of_turn).collect();
    project.check_outputs_of_all(&files)?;
    let (total, count) = (project.settings.budget.seconds, turns.len());
    let mut worst = Outcome::Done;
    for (i, Turn { camera, frame, outputs }) in turns.into_iter().enumerate() {
        if i > 0 {
            project.end_command_clock();
        }
        if let Some(total) = total {
            // The clock of the first render includes the start of the program.
            let elapsed = started.elapsed().as_secs_f64();
            let share = ((total - elapsed) / (count - i) as f64).max(SHORTEST);
            project.settings.budget.seconds = Some(if i == 0 { elapsed + share } else { share });
        }
        project.outputs = outputs;
        let before = if i == 0 { "" } else { "\n" };
        if let Some(camera) = camera {
            sink.begin_camera(&camera);
            print(&format!("{before}camera \"{camera}\"\n"));
            project.settings.camera = Some(camera);
        }
        if let Some(frame) = frame {
            print(&format!("{before}frame {frame}\n"));
            project.settings.frame = frame;
        }
        let (outcome, found) = render(args, &project, (sink, cancel))?;
        if let (SensorChoice::Emva { exposure: exposure @ None, .. }, Some(_)) = (&mut project.settings.sensor, frame) {
            *exposure = found;
        }
        match outcome {
            Outcome::Interrupted => return Ok(Outcome::Interrupted),
            Outcome::Done => {}
            flagged => worst = flagged,
        }
    }
    Ok(worst)
}
