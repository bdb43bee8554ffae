//! The summary after a render: results on standard output, faults on standard error.

use crate::args::RenderArgs;
use crate::outcome::{print, program, say};
use crate::words::{about, count, exposure_time, seconds, shell};
use dunkelfeld::denoising::why_builtin;
use dunkelfeld::scene::Effect;
use dunkelfeld::stats::CertificateStats;
use dunkelfeld::{OutputPaths, Project, ProjectResult, RenderSettings, SensorChoice, Stats};
use std::fmt::Write;
use std::path::Path;

/// An automatic exposure above this time \[s\] gives a warning.
const LONG_EXPOSURE: f64 = 10.0;

/// An automatic exposure below this time \[s\], or of the shortest time of the camera, gives a warning.
const SHORT_EXPOSURE: f64 = 1e-6;

/// A share of saturated pixels above this value gives a warning.
const MANY_SATURATED: f64 = 0.5;

/// Largest factor of the samples that the advice after a render names.
const MAX_FACTOR: f64 = 100.0;

/// The warning of an automatic exposure that is long, or that the camera limits.
fn exposure_warning(settings: &RenderSettings, stats: &Stats) -> Option<String> {
    let (SensorChoice::Emva { model, exposure: None, .. }, Some(sensor)) = (&settings.sensor, &stats.sensor) else {
        return None;
    };
    let ([shortest, longest], seconds) = (model.exposure_range().map(|time| time.0), sensor.exposure_seconds);
    let advice = if sensor.no_light {
        return None;
    } else if seconds <= shortest.max(SHORT_EXPOSURE) {
        "and the camera has no shorter one: the light is strong; lower it ([[light]] power), or check its unit ([import] \
         emissive_unit) and its distance"
    } else if seconds > LONG_EXPOSURE {
        "longer than an inspection camera exposes: the light is weak; raise it ([[light]] power), check its unit \
         ([import] emissive_unit), or set --exposure"
    } else if seconds >= longest {
        "and the camera has no longer one: the light is weak; raise it ([[light]] power), or check its unit ([import] \
         emissive_unit)"
    } else {
        return None;
    };
    Some(format!("warning: the automatic exposure is {}, {advice}", exposure_time(seconds)))
}

pub(super) fn print_report(args: &RenderArgs, project: &Project, outputs: &OutputPaths, result: &ProjectResult) {
    let s = &result.stats;
    print(&summary(project, outputs, s));
    say_flaws(s);
    if let Some(reason) = dunkelfeld::commands::black_image(&project.scene, result) {
        say(&format!("warning: {reason}"));
    }
    if let Some(warning) = exposure_warning(result.settings(), s) {
        say(&warning);
    }
    if let Some(saturated) = s.sensor.as_ref().map(|s| s.saturated).filter(|share| *share > MANY_SATURATED) {
        let percent = 100.0 * saturated;
        say(&format!("warning: {percent:.0} % of the pixels are saturated; shorten the exposure, or lower the light"));
    }
    let camera = project.settings.camera.as_deref();
    if let Some(named) = s.sampling.invalid_named.first() {
        say(&format!("  to replay one: {}", replay_command(args, camera, s, named)));
    }
    if let Some(heavy) = s.sampling.heaviest_samples.first().filter(|h| h.dominates) {
        let (share, n) = (100.0 * heavy.share, s.sampling.dominated_pixels);
        let pixels = if n == 1 { "1 pixel is".into() } else { format!("{n} pixels are") };
        say(&format!(
            "warning: {pixels} dominated by a single sample; the heaviest makes up {share:.0} % of its pixel, to replay it: {}",
            replay_command(args, camera, s, &heavy.sample)
        ));
    }
    if let Some((denoise, why)) = s.denoise.as_ref().and_then(|d| Some((d, d.error.as_ref()?)))
        && s.denoising_failed()
    {
        say(&format!("flagged: {} failed, so the picture is not denoised: {why}", denoise.denoiser));
    }
    if s.time.budget_missed {
        let limit = s.time.budget_seconds.unwrap_or(0.0);
        let (over, all) = (seconds(s.time.total_seconds - limit), seconds(s.time.total_seconds));
        let level = if args.strict { "flagged" } else { "warning" };
        say(&format!("{level}: the time budget of {} was missed by {over}; it took {all} in all", seconds(limit)));
    }
    if let Some(fault) = &result.rendering.checkpoint_fault {
        say(&format!("flagged: the checkpoint is not up to date: {fault}"));
    }
    if result.rendering.interrupted {
        say("interrupted: the image contains the samples so far");
        if s.denoise.as_ref().is_some_and(|d| d.error.is_some()) {
            say("  it is not denoised; `dunkelfeld denoise` denoises an EXR");
        }
    }
}

/// The faults of an image, of a render or a merge.
pub(crate) fn say_flaws(s: &Stats) {
    if s.sensor.as_ref().is_some_and(|s| s.no_light) {
        say("warning: the image is black, so there is no automatic exposure; 1 s was used");
    }
    if s.sampling.invalid_samples > 0 {
        let n = s.sampling.invalid_samples;
        say(&format!("flagged: {n} samples were not finite, negative or out of range; they count as black"));
    }
    if s.sampling.pixels_without_samples > 0 {
        let [width, height] = s.run.size;
        let share = 100.0 * s.sampling.pixels_without_samples as f64 / (f64::from(width) * f64::from(height));
        let (level, help) = match s.budget_too_small() {
            true => ("flagged", "; give it more time"),
            false => ("warning", ""),
        };
        let shown = if s.sampling.samples > 0 { ", their neighbours are shown there" } else { "" };
        say(&format!("{level}: {share:.1} % of pixels have no sample{shown}{help}"));
    }
}

fn summary(project: &Project, o: &OutputPaths, s: &Stats) -> String {
    let mut text = as_seen(o.image.as_deref(), s);
    if let Some(c) = s.certificate.as_ref().filter(|c| !c.is_hidden) {
        text += &advice(c, s);
    }
    if let Some(d) = s.denoise.as_ref().filter(|d| d.error.is_none()) {
        let took = seconds(d.seconds);
        let _ = writeln!(text, "the picture is denoised by {} in {took}: for display, not for measurement", d.denoiser);
        if let Some(why) = why_builtin(&project.settings.denoise, &d.denoiser) {
            let _ = writeln!(text, "note: {why}");
        }
    }
    let [width, height] = s.run.size;
    let spread = match s.sampling.spp_range {
        [least, most] if least == most => format!("{most} in every pixel"),
        [least, most] => format!("{:.1} per pixel on average, {least} at least, {most} at most", s.sampling.mean_spp),
    };
    let _ = writeln!(
        text,
        "{width} x {height} pixels, {} samples: {spread} ({})",
        count(s.sampling.samples),
        s.run.allocation
    );
    let (techniques, effects): (Vec<Effect>, Vec<Effect>) =
        project.settings.run.without.iter().partition(|e| e.is_technique());
    for (left_out, what) in [
        (effects, "not the image of the scene as it is"),
        (techniques, "another way to the same image, with other noise"),
    ] {
        if !left_out.is_empty() {
            let names: Vec<&str> = left_out.iter().map(|e| e.name()).collect();
            let _ = writeln!(text, "without {}: {what}", names.join(", "));
        }
    }
    let threads = if s.run.threads == 1 { "1 thread".into() } else { format!("{} threads", s.run.threads) };
    let rate = count(s.sampling.samples_per_second as u64);
    let _ = writeln!(text, "{} in all, {rate} samples per second on {threads}", seconds(s.time.total_seconds));
    if s.time.was_complete {
        let _ =
            writeln!(text, "the checkpoint contained the whole render, which took {}", seconds(s.time.earlier_seconds));
    } else if s.time.earlier_seconds > 0.0 {
        let (samples, took) = (count(s.time.earlier_samples), seconds(s.time.earlier_seconds));
        let _ = writeln!(text, "continued from a checkpoint: {samples} samples and {took} are from earlier runs");
    }
    let reached = s.forecast.iter().flatten().find_map(|l| Some((l.k, l.seconds?, l.actual_seconds?)));
    if let Some((k, forecast, took)) = reached {
        let off = 100.0 * (forecast / took - 1.0);
        let (forecast, took) = (about(forecast), seconds(took));
        let _ = writeln!(text, "hidden at k = {k} after {took}; the forecast was {forecast} ({off:+.0} %)");
    }
    for path in [&o.image, &o.linear, &o.exr, &o.plan, &o.stats].into_iter().flatten() {
        let _ = writeln!(text, "wrote {}", path.display());
    }
    text
}

/// The image and its exposure, and whether the camera would show the noise of the render: one line each.
pub(crate) fn as_seen(image: Option<&Path>, s: &Stats) -> String {
    let mut text = image.map_or(String::new(), |path| format!("{}: ", path.display()));
    match &s.sensor {
        Some(sensor) => {
            let before = if sensor.saturated > 0.0 { " before saturation" } else { "" };
            let _ = writeln!(
                text,
                "{}, exposed for {}, {:.0} electrons on average{before}, {:.2} % of pixels saturated",
                sensor.name,
                exposure_time(sensor.exposure_seconds),
                sensor.mean_electrons,
                sensor.saturated * 100.0
            );
        }
        None if image.is_some() => text += "no sensor, radiance 1 W/(m^2 sr) is white\n",
        None => {}
    }
    let is_black = s.sensor.as_ref().is_some_and(|s| s.mean_electrons <= 0.0);
    if let Some(c) = s.certificate.as_ref().filter(|_| !is_black) {
        let _ = writeln!(text, "{}", verdict(c));
    }
    if let Some(share) = s.sensor.as_ref().and_then(|sensor| sensor.matched) {
        let _ = writeln!(text, "{}", matched(share));
    }
    text
}

/// Would the camera show the noise of the render?
fn verdict(c: &CertificateStats) -> String {
    let unknown = 100.0 * c.unknown as f64 / c.pixels.max(1) as f64;
    if c.hidden_at.is_none() {
        return format!(
            "noise of the render: unknown, {unknown:.1} % of the unsaturated pixels have too few samples for an estimate"
        );
    }
    let (share, k) = (100.0 * c.hidden, c.k);
    let blocks = c.hidden_blocks.map_or(String::new(), |share| {
        format!(", and in {:.1} % of the blocks of 8 x 8 pixels for their means", 100.0 * share)
    });
    match c.is_hidden {
        true => format!(
            "noise of the render: hidden, the camera would not show the difference; in {share:.1} % of the unsaturated \
             pixels it is at most {k} times the noise of the camera{blocks}"
        ),
        false => format!(
            "noise of the render: visible, the camera would show the difference; only in {share:.1} % of the \
             unsaturated pixels it is at most {k} times the noise of the camera{blocks}"
        ),
    }
}

/// The ways to an image whose noise is that of the camera.
fn advice(c: &CertificateStats, s: &Stats) -> String {
    let mut ways = Vec::new();
    let forecast = s.forecast.iter().flatten().find(|level| level.k == c.k).and_then(|level| level.seconds);
    // The variance of a mean decreases with the number of samples.
    let factor = c.ratio_p99.map(|ratio| ratio / (c.k * c.k)).filter(|factor| *factor > 1.0);
    ways.push(match (forecast, factor) {
        (Some(time), _) => format!("more time, about {} in all (--noise {} stops there)", about(time), c.k),
        (None, Some(factor)) if factor <= MAX_FACTOR => {
            let factor = if factor < 10.0 { format!("{factor:.1}") } else { format!("{factor:.0}") };
            format!("more time, about {factor} times the samples (--noise {} stops there)", c.k)
        }
        (None, Some(_)) => format!("more time (1 % of the pixels needs more than {MAX_FACTOR:.0} times the samples)"),
        (None, None) => format!("more time (--noise {} stops when it is hidden)", c.k),
    });
    if s.denoise.is_none() {
        ways.push("--denoise auto for a picture to look at".into());
    }
    if s.sensor.as_ref().is_some_and(|sensor| sensor.matched.is_none()) {
        ways.push("--exposure-noise matched for frames with the noise of the camera".into());
    }
    format!("  to hide it: {}\n", ways.join("; or "))
}

/// The share of pixels where noise-matched exposure holds, in one line.
fn matched(share: f64) -> String {
    // A share just below one is not printed as all.
    let percent = (1000.0 * share).floor() / 10.0;
    format!(
        "exposure noise: matched; frames have the noise of the camera in {percent:.1} % of pixels, elsewhere the noise of the render is too large, comes from a single sample or is unknown"
    )
}

/// The command that traces a sample again: everything that a camera sample depends on.
fn replay_command(args: &RenderArgs, camera: Option<&str>, s: &Stats, sample: &str) -> String {
    let mut words = vec![program().to_owned(), "render".into(), args.input.display().to_string()];
    let mut flag = |name: &str, value: String| words.extend([name.into(), value]);
    flag("--width", s.run.size[0].to_string());
    flag("--height", s.run.size[1].to_string());
    if let Some(camera) = camera {
        flag("--camera", camera.into());
    }
    // The field of view of a focal length is that of the sensor's film.
    for name in ["sensor", "vignetting"] {
        if let Some(value) = args.keys.value(name) {
            flag(&format!("--{name}"), value.into());
        }
    }
    flag("--seed", s.run.seed.to_string());
    flag("--frame", s.run.frame.to_string());
    // A short render has no training, unlike this command.
    if s.run.training_paths == 0 && !s.run.without.iter().any(|e| e == "learned-roulette") {
        flag("--without", "learned-roulette".into());
    }
    for effect in &s.run.without {
        flag("--without", effect.clone());
    }
    flag("--debug-sample", sample.into());
    shell(words)
}
