//! `dunkelfeld init`: a job for a scene.

use crate::args::InitArgs;
use crate::outcome::{Outcome, print};
use crate::words::shell;
use dunkelfeld::{Error, init};

pub(crate) fn run(args: &InitArgs) -> Result<Outcome, Error> {
    let path = init(&args.input, args.output.as_deref())?;
    let path = path.to_string_lossy();
    print(&format!("{path} was written; render it by: {}\n", shell(["dunkelfeld", "render", path.as_ref()])));
    Ok(Outcome::Done)
}
