//! Many poses of one part from one load of the scene: each pose changes the scene by keys of a job, and only the part is
//! built again. Prints the time of each step.
//! Run: `cargo run --release --example poses -- SCENE|JOB OBJECT [COUNT] [FOLDER]`.

#![allow(clippy::print_stdout, reason = "an example talks to its reader")]

use dunkelfeld::{Error, Project};
use std::time::Instant;

fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1);
    let usage =
        || Error::setting("arguments", "a scene and an object are needed", "write SCENE OBJECT [COUNT] [FOLDER]");
    let input = arguments.next().ok_or_else(usage)?;
    let object = arguments.next().ok_or_else(usage)?;
    let count: u32 = arguments.next().and_then(|n| n.parse().ok()).unwrap_or(10);
    let folder = arguments.next();

    let began = Instant::now();
    let mut project = Project::open(&input)?;
    let load = began.elapsed().as_secs_f64();
    println!("load: {load:.3} s");
    for pose in 0..count {
        let began = Instant::now();
        let degrees = 360.0 * f64::from(pose) / f64::from(count);
        project.set_overrides(&format!(
            "[[object]]\nname = \"{object}\"\npivot = \"center\"\nrotate = [0, \"{degrees}deg\", 0]\n"
        ))?;
        let change = began.elapsed().as_secs_f64();
        let result = project.render()?;
        let render = began.elapsed().as_secs_f64() - change;
        println!(
            "pose {pose}: change {change:.3} s ({:.1} % of the load), render {render:.3} s",
            100.0 * change / load
        );
        if let Some(folder) = &folder {
            result.save_image(format!("{folder}/pose-{pose:03}.png"))?;
        }
    }
    Ok(())
}
