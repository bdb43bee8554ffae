//! Progress on standard error: a bar with the remaining time, or one JSON object a line.

use crate::args::ProgressKind;
use dunkelfeld::{Progress, ProgressState};
use indicatif::{ProgressBar, ProgressStyle};

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
                // indicatif shows nothing unless standard error is a terminal.
                let bar = ProgressBar::new(1000);
                if let Ok(style) = ProgressStyle::with_template("{prefix:>8} [{bar:36}] {percent:>3} %  {msg}") {
                    bar.set_style(style.progress_chars("=> "));
                }
                Self::Bar(bar)
            }
        }
    }

    /// Takes the bar away, so that what is printed next stands alone.
    pub(crate) fn finish(&self) {
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
                bar.set_position((s.fraction * 1000.0) as u64);
                let remaining = s.remaining.map_or_else(|| "...".into(), |r| format!("{} left", seconds(r)));
                bar.set_message(format!("{remaining}, {} samples", count(s.samples)));
            }
            Self::Json => {
                let line = serde_json::json!({
                    "stage": s.stage.name(),
                    "fraction": s.fraction,
                    "elapsed": s.elapsed,
                    "remaining": s.remaining,
                    "samples": s.samples,
                });
                eprintln!("{line}");
            }
        }
    }
}

/// Seconds for people.
pub(crate) fn seconds(s: f64) -> String {
    match s {
        s if s < 10.0 => format!("{s:.1} s"),
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// A large number for people.
pub(crate) fn count(n: u64) -> String {
    match n {
        n if n < 10_000 => n.to_string(),
        n if n < 10_000_000 => format!("{:.1} k", n as f64 * 1e-3),
        n if n < 10_000_000_000 => format!("{:.1} M", n as f64 * 1e-6),
        n => format!("{:.1} G", n as f64 * 1e-9),
    }
}
