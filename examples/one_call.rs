//! From a scene file to an exposed frame in five lines. Run: `cargo run --release --example one_call -- [SCENE|JOB] [OUT.png]`.

use dunkelfeld::{Error, Project};

fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1);
    let input = arguments.next().unwrap_or_else(|| "scenes/inspection/inspection-open.toml".into());
    let output = arguments.next().unwrap_or_else(|| "one_call.png".into());

    let mut project = Project::open(&input)?;
    project.settings.budget.seconds = Some(2.0);
    project.settings.width = 256;
    project.settings.height = 256;
    project.render()?.save_image(&output)
}
