//! Progress on standard error: a bar with the remaining time, or one JSON object a line.

use crate::outcome::{say, say_json, say_object};
use crate::run_args::ProgressKind;
use crate::words::{about, count, remaining};
use dunkelfeld::adaptive::Forecast;
use dunkelfeld::{Progress, ProgressState, Stage};
use indicatif::{ProgressBar, ProgressStyle};

/// Steps of the bar.
const STEPS: u64 = 1000;

/// A render that takes longer than this from its pilot on [s] is announced.
const LONG: f64 = 5.0;

/// A progress sink of the chosen kind.
pub(crate) enum Sink {
    Bar(ProgressBar),
    Json,
    None,
}

impl Sink {
    pub(crate) fn new(kind: ProgressKind) -> Self {
        match kind {
            ProgressKind::Json => {
                say_json();
                Self::Json
            }
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

    /// Begins the render of one of several cameras.
    pub(crate) fn begin_camera(&self, name: &str) {
        if let Self::Json = self {
            say_object(&serde_json::json!({ "event": "camera", "name": name }));
        }
    }

    /// Removes the bar until the next stage, so that other output is separate.
    pub(crate) fn clear(&self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }

    /// Prints a line while the bar is shown.
    pub(crate) fn say(&self, line: &str) {
        match self {
            Self::Bar(bar) => bar.suspend(|| say(line)),
            Self::Json | Self::None => say(line),
        }
    }
}

/// The bar is removed automatically, so that later output is separate, however the command ends.
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
                if bar.is_finished() {
                    bar.reset();
                }
                bar.set_prefix(s.stage.name());
                bar.set_position((s.fraction * STEPS as f64) as u64);
                let left = s.remaining.map(|r| format!("{} left", remaining(r)));
                let samples = (s.samples > 0).then(|| format!("{} samples", count(s.samples)));
                bar.set_message(left.into_iter().chain(samples).collect::<Vec<_>>().join(", "));
            }
            Self::Json => {
                let line = serde_json::json!({
                    "event": "progress",
                    "stage": s.stage.name(),
                    "fraction": s.fraction,
                    "elapsed": s.elapsed,
                    "remaining": s.remaining,
                    "samples": s.samples,
                });
                say_object(&line);
            }
        }
    }

    fn forecast(&self, forecast: &Forecast) {
        match self {
            Self::None => {}
            Self::Json => {
                let line = serde_json::json!({
                    "event": "forecast",
                    "stage": Stage::Plan.name(),
                    "fraction": 0.0,
                    "elapsed": forecast.made_at,
                    "remaining": forecast.remaining,
                    "samples": forecast.made_from,
                    "forecast": forecast.levels,
                    "course": forecast.course,
                });
                say_object(&line);
            }
            // A stage that ends before a user can read its name is not shown.
            Self::Bar(_) if forecast.remaining.is_some_and(|r| r >= LONG) => {
                if let Some(line) = expectation(forecast) {
                    Self::say(self, &line);
                }
            }
            Self::Bar(_) => {}
        }
    }
}

/// `about 94 s until the noise is hidden at k = 0.7: 90 % of the pixels after 40 s, 99 % after 94 s; the last 1 % is
/// `bracket`; 31 s at k = 1, 250 s at k = 0.5`.
fn expectation(forecast: &Forecast) -> Option<String> {
    let first = forecast.shown()?;
    let time = |seconds: Option<f64>| seconds.map_or_else(|| "an unknown time".into(), about);
    let mut line = format!("about {} until the noise is hidden at k = {}", time(first.seconds), first.k);
    if let Some(course) = &forecast.course {
        let percent = |share: f64| (1e4 * share).round() / 100.0;
        let early = course.early_seconds.map_or(String::new(), |s| format!("90 % of the pixels after {}, ", about(s)));
        let of = if early.is_empty() { " of the pixels" } else { "" };
        line += &format!(": {early}{} %{of} after {}", percent(course.share), time(first.seconds));
        if !course.last_objects.is_empty() {
            let names: Vec<String> = course.last_objects.iter().map(|name| format!("`{name}`")).collect();
            line += &format!("; the last {} % is mostly {}", percent(1.0 - course.share), names.join(" and "));
        }
    }
    let others =
        forecast.levels.iter().filter(|l| l.k != first.k).map(|l| format!("{} at k = {}", time(l.seconds), l.k));
    Some(format!("{line}; {}", others.collect::<Vec<_>>().join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld::adaptive::{ForecastCourse, ForecastLevel};

    #[test]
    fn the_expectation_names_its_own_level_first() {
        let level =
            |k, seconds| ForecastLevel { k, samples: None, seconds, actual_samples: None, actual_seconds: None };
        let levels = vec![level(1.0, Some(31.2)), level(0.7, Some(94.0)), level(0.25, None)];
        let mut forecast =
            Forecast { levels, target: None, made_at: 3.0, made_from: 4096, course: None, remaining: None };
        assert_eq!(
            expectation(&forecast).as_deref(),
            Some("about 94 s until the noise is hidden at k = 0.7; 31 s at k = 1, an unknown time at k = 0.25")
        );
        forecast.target = Some(1.0);
        assert!(
            expectation(&forecast)
                .is_some_and(|line| line.starts_with("about 31 s until the noise is hidden at k = 1;"))
        );
        let last_objects = vec!["bracket".to_string()];
        forecast.course = Some(ForecastCourse { share: 0.99, early_seconds: Some(12.3), last_objects });
        assert_eq!(
            expectation(&forecast).as_deref(),
            Some(
                "about 31 s until the noise is hidden at k = 1: 90 % of the pixels after 12 s, 99 % after 31 s; the last \
                 1 % is mostly `bracket`; 94 s at k = 0.7, an unknown time at k = 0.25"
            )
        );
    }
}
