//! Any bytes as a checkpoint, whose checksums the reader does not compare while it is fuzzed: one that is accepted reads the
//! same when it is written again, and can be averaged.
#![no_main]

use dunkelfeld_fuzz::{Scratch, target};
use dunkelfeld_io::checkpoint::{Checkpoint, CheckpointHead, read_checkpoint, write_checkpoint};
use std::path::Path;
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

target!(|data| {
    match read_checkpoint(&SCRATCH.write("in.checkpoint", data)) {
        Ok(checkpoint) => {
            std::hint::black_box(checkpoint.film.total_samples());
            let first = SCRATCH.path("first.checkpoint");
            write(&first, &checkpoint);
            let again = read_checkpoint(&first).expect("what was written can be read");
            let second = SCRATCH.path("second.checkpoint");
            write(&second, &again);
            // As bytes: numbers that are not numbers are not equal to themselves.
            assert!(std::fs::read(first).expect("there") == std::fs::read(second).expect("there"));
        }
        Err(e) => drop((e.to_string(), e.caret())),
    }
});

fn write(path: &Path, checkpoint: &Checkpoint) {
    let film = &checkpoint.film;
    let head = CheckpointHead {
        width: film.width(),
        height: film.height(),
        text: &checkpoint.text,
        weights: checkpoint.weights.as_ref(),
        target: checkpoint.target.as_ref(),
        objects: checkpoint.objects.as_ref(),
        materials: checkpoint.materials.as_ref(),
    };
    write_checkpoint(path, &head, &mut |rows, out| film.read_rows(rows, out)).expect("what was read can be written");
}
