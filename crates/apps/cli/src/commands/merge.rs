//! `dunkelfeld merge`: joins parts of a render.

use crate::args::MergeArgs;
use crate::commands::render::{as_seen, say_flaws};
use crate::outcome::{Outcome, print};
use crate::words::count;
use dunkelfeld::commands::MergeSettings;
use dunkelfeld::{Error, OutputPaths};
use std::fmt::Write;
use std::time::Instant;

pub(crate) fn run(args: &MergeArgs, started: Instant) -> Result<Outcome, Error> {
    let outputs = OutputPaths::of_keys(&args.files.keys())?;
    let settings = MergeSettings::default()
        .with_parts(args.parts.clone())
        .with_outputs(outputs)
        .with_checkpoint(args.checkpoint.clone())
        .with_threads(args.threads.map_or(0, usize::from))
        .with_memory_limit(args.memory.memory);
    let merged = dunkelfeld::commands::merge(&settings, started)?;
    let (range, parts) = (&merged.samples, args.parts.len());
    let words = if parts == 1 { "1 part".into() } else { format!("{parts} parts") };
    let total = count(merged.stats.sampling.samples);
    let o = &settings.outputs;
    let mut text = as_seen(o.image.as_deref(), &merged.stats);
    let _ = writeln!(text, "{words}: samples {}..{}, {total} in all", range.start, range.end);
    for path in [&settings.checkpoint, &o.image, &o.linear, &o.exr, &o.stats].into_iter().flatten() {
        let _ = writeln!(text, "wrote {}", path.display());
    }
    print(&text);
    say_flaws(&merged.stats);
    Ok(if merged.stats.is_flagged() { Outcome::Flagged } else { Outcome::Done })
}
