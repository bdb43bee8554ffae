//! Progress on standard error: a bar with the remaining time, or one JSON object a line.

use crate::args::ProgressKind;
use crate::outcome::say;
use crate::words::{count, remaining};
use dunkelfeld::{Progress, ProgressState};
use indicatif::{ProgressBar, ProgressStyle};

/// Steps of the bar.
const STEPS: u64 = 1000;

/// A progress sink of the chosen kind.
pub(crate) enum Sink {
    Bar(ProgressBar),
    Json,
    None,
}

impl Sink {
    pub(crate) fn new(kind: ProgressKind) -> Self {
        match kind {
            ProgressKind::Json => Self::Json,
            ProgressKind::None => Self::None,
            ProgressKind::Bar => {
                // indicatif shows nothing unless standard error is a terminal, and no colours where NO_COLOR is set.
                let bar = ProgressBar::new(STEPS);
                if let Ok(style) =
                    ProgressStyle::with_template("{prefix:>7.bold} {bar:30.cyan/blue} {percent:>3} %  {msg}")
                {
                    bar.set_style(style.progress_chars("━╸─"));
                }
                Self::Bar(bar)
            }
        }
    }

    /// Says something while the bar stands.
    pub(crate) fn say(&self, line: &str) {
        match self {
            Self::Bar(bar) => bar.suspend(|| say(line)),
            Self::Json | Self::None => say(line),
        }
    }
}

/// The bar goes away by itself, so that what is printed next stands alone, whichever way the command ends.
impl Drop for Sink {
    fn drop(&mut self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

impl Progress for Sink {
    fn update(&self, s: &ProgressState) {
        match self {
            Self::None => {}
            Self::Bar(bar) => {
                bar.set_prefix(s.stage.name());
                bar.set_position((s.fraction * STEPS as f64) as u64);
                let left = s.remaining.map(|r| format!("{} left", remaining(r)));
                let samples = (s.samples > 0).then(|| format!("{} samples", count(s.samples)));
                bar.set_message(left.into_iter().chain(samples).collect::<Vec<_>>().join(", "));
            }
            Self::Json => {
                let line = serde_json::json!({
                    "stage": s.stage.name(),
                    "fraction": s.fraction,
                    "elapsed": s.elapsed,
                    "remaining": s.remaining,
                    "samples": s.samples,
                });
                say(&line.to_string());
            }
        }
    }
}
