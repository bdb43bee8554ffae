//! `render` of a job with several cameras: one load of the scene, one render and one set of files for each camera.

use super::render;
use crate::args::RenderArgs;
use crate::bar::Sink;
use crate::outcome::{Outcome, print};
use dunkelfeld::{Cancel, Error, Project};
use std::time::Instant;

/// Shortest time limit of a render \[s\], for a camera whose turn comes after the end of the budget.
const SHORTEST: f64 = 1e-3;

/// Refuses flags that belong to the render of one camera.
pub(super) fn check(args: &RenderArgs, cameras: &[String]) -> Result<(), Error> {
    let of_one = [
        ("--checkpoint", args.checkpoint.is_some()),
        ("--replay", args.replay.is_some()),
        ("--samples", args.samples.is_some()),
        ("--debug-sample", args.debug_sample.is_some()),
    ];
    let Some((flag, _)) = of_one.iter().find(|(_, given)| *given) else { return Ok(()) };
    let names: Vec<String> = cameras.iter().map(|name| format!("\"{name}\"")).collect();
    let problem = format!("it is for one camera, and the job defines {}: {}", cameras.len(), names.join(", "));
    Err(Error::setting(*flag, problem, "add `--camera NAME`"))
}

/// Renders the cameras one after the other. The rest of a time budget is divided evenly among those that follow.
pub(super) fn run(
    args: &RenderArgs,
    mut project: Project,
    cameras: &[String],
    started: Instant,
    (sink, cancel): (&Sink, &Cancel),
) -> Result<Outcome, Error> {
    let mut files = Vec::new();
    for camera in cameras {
        project.settings.camera = Some(camera.clone());
        project.fitted()?;
        let mut outputs = project.outputs.for_camera(camera);
        if outputs.image.is_none() {
            let chosen = project.default_image_path_of(&args.input, camera, &outputs);
            chosen.reason.iter().for_each(|reason| sink.say(&format!("note: {reason}")));
            outputs.image = Some(chosen.path);
        }
        files.push(outputs);
    }
    project.check_outputs_of_all(&files)?;
    let total = project.settings.budget.seconds;
    let mut worst = Outcome::Done;
    for (i, (camera, outputs)) in cameras.iter().zip(files).enumerate() {
        if i > 0 {
            project.end_command_clock();
        }
        if let Some(total) = total {
            // The clock of the first render includes the start of the program.
            let elapsed = started.elapsed().as_secs_f64();
            let share = ((total - elapsed) / (cameras.len() - i) as f64).max(SHORTEST);
            project.settings.budget.seconds = Some(if i == 0 { elapsed + share } else { share });
        }
        project.settings.camera = Some(camera.clone());
        project.outputs = outputs;
        sink.begin_camera(camera);
        print(&format!("{}camera \"{camera}\"\n", if i == 0 { "" } else { "\n" }));
        match render(args, &project, (sink, cancel))? {
            Outcome::Interrupted => return Ok(Outcome::Interrupted),
            Outcome::Done => {}
            flagged => worst = flagged,
        }
    }
    Ok(worst)
}
