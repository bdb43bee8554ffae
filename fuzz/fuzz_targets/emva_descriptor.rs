//! Any bytes as the descriptor of an EMVA 1288 data set; one that can be read is the same when it is written and read again, and
//! every refusal can show its line.
#![no_main]

use dunkelfeld_fuzz::{Scratch, target};
use dunkelfeld_io::emva_descriptor::{read_descriptor, write_descriptor};
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

target!(|data| {
    match read_descriptor(&SCRATCH.write("emva.txt", data)) {
        Ok((descriptor, _)) => {
            let text = write_descriptor(&descriptor);
            let again = read_descriptor(&SCRATCH.write("again.txt", text.as_bytes()));
            assert!(again.is_ok_and(|(a, w)| w.is_empty() && a.blocks.len() == descriptor.blocks.len()), "{text}");
        }
        Err(e) => {
            drop((e.to_string(), e.caret()));
        }
    }
});
