//! A study of renders: the missing ones are rendered one by one. Its result.

use super::Meter;
use crate::report::table::Figures;
use dunkelfeld::{Error, Progress, ProgressState, Session, Stage};
use std::path::PathBuf;

/// The result of a study of renders.
#[derive(Clone, Debug)]
pub struct StudyOutcome {
    /// The files of the report, the page first. Empty if there are too few renders for a report.
    pub files: Vec<PathBuf>,
    /// The findings as a few lines of text.
    pub findings: Vec<String>,
    /// The figures of the report: the rows of its tables, by the name of the table. Unknown numbers are null. Empty without
    /// a report.
    pub figures: Figures,
    /// Number of finished renders, and of all.
    pub finished: [usize; 2],
    /// Was it cancelled from outside? Finished renders are kept. The same call continues with the missing ones.
    pub interrupted: bool,
    /// Samples that were not finite, negative or out of range, in all renders.
    pub invalid_samples: u64,
}

/// The renders of a study after [`render_missing`].
pub(crate) struct Made {
    /// Number of finished renders, and of all.
    pub(crate) finished: [usize; 2],
    /// Invalid samples of all finished renders.
    pub(crate) invalid_samples: u64,
}

/// Renders the missing units until the session is cancelled. `spp` is the number of samples per pixel of a unit. `finished`
/// returns the invalid samples of a finished unit. `render` renders a unit, stores it and returns its invalid samples; `None`
/// if it was interrupted.
pub(crate) fn render_missing<U>(
    all: &[U],
    (size, spp): ([u32; 2], impl Fn(&U) -> u32),
    finished: impl Fn(&U) -> Result<Option<u64>, Error>,
    session: &Session<'_>,
    mut render: impl FnMut(&U, &Session<'_>) -> Result<Option<u64>, Error>,
) -> Result<Made, Error> {
    let samples = |unit: &U| u64::from(spp(unit)) * u64::from(size[0]) * u64::from(size[1]);
    let (mut invalid_samples, mut done, mut missing) = (0, 0, Vec::new());
    for unit in all {
        match finished(unit)? {
            Some(invalid) => {
                invalid_samples += invalid;
                done += samples(unit);
            }
            None => missing.push(unit),
        }
    }
    let mut count = all.len() - missing.len();
    let meter = Meter::new(session.progress(), all.iter().map(samples).sum(), done);
    let metered = session.clone().with_progress(&meter);
    for unit in missing {
        // A render that ends before the first progress report also appears.
        meter.update(&ProgressState { stage: Stage::Pilot, fraction: 0.0, elapsed: 0.0, remaining: None, samples: 0 });
        if session.is_cancelled() {
            break;
        }
        let Some(invalid) = render(unit, &metered)? else { break };
        invalid_samples += invalid;
        count += 1;
        meter.finish(samples(unit));
    }
    Ok(Made { finished: [count, all.len()], invalid_samples })
}
