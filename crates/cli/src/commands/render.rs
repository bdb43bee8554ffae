//! `dunkelfeld render`: flags onto a project, render, write, say what came out.

use crate::args::{Allocate, RenderArgs};
use crate::bar::{Sink, count, seconds};
use crate::outcome::{Outcome, print};
use dunkelfeld::adaptive::allocation::Strategy;
use dunkelfeld::integrator::{Estimator, PixelSample};
use dunkelfeld::io::quantity::Time;
use dunkelfeld::sensor::{Exposure, Optics};
use dunkelfeld::{Cancel, Error, Project, ProjectResult, SensorChoice};
use std::fmt::Write;
use std::sync::Arc;
use std::time::Instant;

pub(crate) fn run(args: &RenderArgs, started: Instant) -> Result<Outcome, Error> {
    let mut project = Project::open_at(&args.input, started)?;
    apply(args, &mut project)?;
    for warning in &project.warnings {
        eprintln!("warning: {warning}");
    }
    for finding in project.report.hazards() {
        eprintln!("hazard: {}: {}", finding.place, finding.message);
    }
    if let Some(text) = &args.debug_sample {
        return debug_sample(&project, parse_sample(text)?);
    }

    let cancel = Arc::new(Cancel::new());
    let switch = Arc::clone(&cancel);
    // A second interrupt while the image is being written is ignored: writing takes moments and is atomic.
    if let Err(e) = ctrlc::set_handler(move || switch.cancel()) {
        eprintln!("warning: interrupts cannot be caught ({e}); Ctrl-C will end without an image");
    }
    let sink = Sink::new(args.progress);
    let rendered = project.render_with(&sink, &cancel);
    sink.finish();
    let mut result = rendered?;
    result.save(&project.outputs)?;
    report(args, &project, &result);
    Ok(match (result.rendering.interrupted, result.stats.is_flagged()) {
        (true, _) => Outcome::Interrupted,
        (false, true) => Outcome::Flagged,
        (false, false) => Outcome::Done,
    })
}

/// Flags win over what the project's file says.
fn apply(args: &RenderArgs, project: &mut Project) -> Result<(), Error> {
    let s = &mut project.settings;
    let set = |to: &mut u32, from: Option<u32>| *to = from.unwrap_or(*to);
    set(&mut s.width, args.width);
    set(&mut s.height, args.height);
    set(&mut s.frame, args.frame);
    s.seed = args.seed.unwrap_or(s.seed);
    s.threads = args.threads.unwrap_or(s.threads);
    if args.camera.is_some() {
        s.camera.clone_from(&args.camera);
    }
    if args.time.is_some() || args.spp.is_some() {
        // A limit on the command line replaces those of the job.
        s.budget = dunkelfeld::Budget { seconds: args.time.as_deref().map(time_limit).transpose()?, spp: args.spp };
    }
    if let Some(strategy) = args.allocate {
        s.strategy = match strategy {
            Allocate::Uniform => Strategy::Uniform,
            Allocate::Sobel => Strategy::Sobel,
        };
    }
    if let Some(path) = &args.replay {
        let plan = dunkelfeld::load_plan(path)?;
        if args.width.is_none() && args.height.is_none() {
            (s.width, s.height) = (plan.width(), plan.height());
        }
        s.replay = Some(plan);
    }
    apply_sensor(args, s)?;
    let o = &mut project.outputs;
    for (to, from) in [
        (&mut o.image, &args.image),
        (&mut o.linear, &args.linear),
        (&mut o.exr, &args.exr),
        (&mut o.stats, &args.stats),
        (&mut o.plan, &args.plan),
    ] {
        if from.is_some() {
            to.clone_from(from);
        }
    }
    if o.image.is_none() {
        o.image = Some(dunkelfeld::default_image_path(&args.input));
    }
    Ok(())
}

fn apply_sensor(args: &RenderArgs, s: &mut dunkelfeld::RenderSettings) -> Result<(), Error> {
    if let Some(name) = args.sensor.as_deref() {
        s.sensor = match (name, std::mem::replace(&mut s.sensor, SensorChoice::None)) {
            ("none", _) => SensorChoice::None,
            (name, SensorChoice::Emva { optics, exposure, .. }) => {
                SensorChoice::Emva { model: Box::new(dunkelfeld::find_sensor(name)?), optics, exposure }
            }
            (name, SensorChoice::None) => {
                let model = Box::new(dunkelfeld::find_sensor(name)?);
                SensorChoice::Emva { model, optics: default_optics()?, exposure: None }
            }
        };
    }
    let Some(text) = args.exposure.as_deref() else { return Ok(()) };
    match &mut s.sensor {
        SensorChoice::None => {
            Err(Error::setting("--exposure", "there is no sensor to expose", "add --sensor NAME, or leave it out"))
        }
        SensorChoice::Emva { exposure, .. } => {
            *exposure = match text {
                "auto" => None,
                text => Some(Exposure::new(dunkelfeld::radiometry::Seconds(time("--exposure", text)?))?),
            };
            Ok(())
        }
    }
}

fn default_optics() -> Result<Optics, Error> {
    let lens = dunkelfeld::io::job::LensSettings::default();
    Ok(Optics::new(lens.f_number, lens.transmission, lens.magnification.unwrap_or(0.0))?)
}

/// A time such as `5ms`, in seconds.
fn time(flag: &str, text: &str) -> Result<f64, Error> {
    match text.parse::<Time>() {
        Ok(t) => Ok(f64::from(t)),
        Err(e) => Err(Error::setting(flag, e.to_string(), "write a number with its unit, such as 5ms, 20s or 2min")),
    }
}

fn time_limit(text: &str) -> Result<f64, Error> {
    match time("--time", text)? {
        t if t > 0.0 && t.is_finite() => Ok(t),
        t => Err(Error::setting("--time", format!("{t} s is no time to render in"), "write a time above zero, such as 20s")),
    }
}

fn parse_sample(text: &str) -> Result<PixelSample, Error> {
    let numbers: Vec<u32> = text.split(',').map_while(|t| t.trim().parse().ok()).collect();
    match (numbers.as_slice(), text.split(',').count()) {
        (&[x, y, index], 3) => Ok(PixelSample { x, y, index }),
        _ => Err(Error::setting("--debug-sample", format!("\"{text}\" is not a sample"), "write X,Y,SAMPLE, as in 12,40,7")),
    }
}

/// One sample, vertex by vertex.
fn debug_sample(project: &Project, at: PixelSample) -> Result<Outcome, Error> {
    let s = &project.settings;
    if at.x >= s.width || at.y >= s.height {
        let problem = format!("pixel {},{} is outside {} x {}", at.x, at.y, s.width, s.height);
        return Err(Error::setting("--debug-sample", problem, "name a pixel of the image; the first is 0,0"));
    }
    let camera = dunkelfeld::camera(&project.scene, s)?;
    let estimator =
        Estimator { scene: &project.scene, camera: &camera, width: s.width, seed: s.seed, frame: s.frame };
    let (sample, trace) = estimator.trace(at);
    let origin = project.scene.world_origin();
    let mut text = String::new();
    for (i, v) in trace.vertices.iter().enumerate() {
        match v.material {
            Some(m) => {
                let [x, y, z] = [0, 1, 2].map(|k| f64::from(v.position[k]) + origin[k]);
                let name = project.scene.materials().get(m as usize).map_or("?", |m| m.name.as_str());
                let _ = writeln!(text, "{i}: \"{name}\" at {x:.6} {y:.6} {z:.6} m");
            }
            None => {
                let [x, y, z] = v.position;
                let _ = writeln!(text, "{i}: left the scene toward {x:.6} {y:.6} {z:.6}");
            }
        }
        let rgb = |c: dunkelfeld::radiometry::Rgb| format!("{:e} {:e} {:e}", c.r, c.g, c.b);
        let _ = writeln!(text, "   throughput {}", rgb(v.throughput));
        if !v.emitted.is_black() {
            let _ = writeln!(text, "   emitted    {}", rgb(v.emitted));
        }
        if !v.direct.is_black() {
            let _ = writeln!(text, "   direct     {}", rgb(v.direct));
        }
        if let Some(([x, y, z], pdf, weight)) = v.scattered {
            let _ = writeln!(text, "   scattered  toward {x:.6} {y:.6} {z:.6}, pdf {pdf:e}, weight {}", rgb(weight));
        }
    }
    let r = sample.radiance;
    let _ = writeln!(text, "radiance {:e} {:e} {:e} W/(m^2 sr)", r.r, r.g, r.b);
    print(&text);
    Ok(if sample.is_valid() { Outcome::Done } else { Outcome::Flagged })
}

/// What came out, in a few lines.
fn report(args: &RenderArgs, project: &Project, result: &ProjectResult) {
    let s = &result.stats;
    let mut text = format!(
        "{} x {} pixels, {} samples, {:.1} per pixel ({} to {}), {}\n",
        s.size[0],
        s.size[1],
        count(s.samples),
        s.mean_spp,
        s.spp_range[0],
        s.spp_range[1],
        s.allocation
    );
    let _ = writeln!(text, "{} in all, {} samples/s on {} threads", seconds(s.total_seconds), count(s.samples_per_second as u64), s.threads);
    if let Some(sensor) = &s.sensor {
        let _ = writeln!(
            text,
            "{}: exposed for {:.4} ms, {:.0} electrons on average, {:.2} % of pixels saturated",
            sensor.name,
            sensor.exposure_seconds * 1e3,
            sensor.mean_electrons,
            sensor.saturated * 100.0
        );
    }
    let o = &project.outputs;
    for path in [&o.image, &o.linear, &o.exr, &o.plan, &o.stats].into_iter().flatten() {
        let _ = writeln!(text, "wrote {}", path.display());
    }
    print(&text);
    if s.sensor.as_ref().is_some_and(|s| s.no_light) {
        eprintln!("warning: the image is black, so there is no automatic exposure; 1 s was used");
    }
    if s.invalid_samples > 0 {
        let named = s.invalid_named.first().map_or("", String::as_str);
        eprintln!(
            "flagged: {} samples were not finite, negative or out of range; they count as black. Replay one: render {} --debug-sample {named} --seed {} --frame {}",
            s.invalid_samples,
            args.input.display(),
            s.seed,
            s.frame
        );
    }
    if s.budget_missed {
        let limit = s.budget_seconds.unwrap_or(0.0);
        eprintln!("flagged: the time budget of {} was missed; it took {}", seconds(limit), seconds(s.total_seconds));
    }
    if result.rendering.interrupted {
        eprintln!("interrupted: the image holds what was rendered so far");
    }
}
