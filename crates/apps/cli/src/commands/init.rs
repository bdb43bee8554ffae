//! `dunkelfeld init`: a first job, for a scene or of a preset station.

use crate::args::InitArgs;
use crate::outcome::{Outcome, print};
use crate::words::shell;
use dunkelfeld::Error;
use dunkelfeld::commands::{STATIONS, Station, init};

pub(crate) fn run(args: &InitArgs) -> Result<Outcome, Error> {
    if args.input.is_none() && args.station.is_none() {
        print("preset stations, for `dunkelfeld init --station NAME`:\n");
        for station in STATIONS {
            print(&format!("  {:<18} {}\n", station.name, station.summary()));
        }
        print("a job for a scene: `dunkelfeld init scene.glb`\n");
        return Ok(Outcome::Done);
    }
    let station = args.station.as_deref().map(Station::named).transpose()?;
    let path = init(args.input.as_deref(), station, args.output.as_deref())?;
    let path = path.to_string_lossy();
    print(&format!("{path} was written; render it by: {}\n", shell(["dunkelfeld", "render", path.as_ref()])));
    Ok(Outcome::Done)
}
