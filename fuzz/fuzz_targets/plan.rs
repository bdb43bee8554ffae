//! Any bytes as a saved sample plan: a plane of counts, or refused.
#![no_main]

use dunkelfeld_fuzz::{Scratch, target};
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

target!(|data| {
    match dunkelfeld::outputs::load_plan(&SCRATCH.write("plan.exr", data)) {
        Ok(plan) => {
            let samples = plan.samples;
            assert_eq!(samples.data().len() as u64, u64::from(samples.width()) * u64::from(samples.height()));
        }
        Err(e) => drop(e.to_string()),
    }
});
