//! `dunkelfeld expose`: reads an EXR, and writes frames of a camera.

use crate::args::ExposeArgs;
use crate::bar::Sink;
use crate::interrupt::cancel_on_interrupt;
use crate::outcome::{Outcome, print, say};
use crate::words::{counted, exposure_time, flagged_variances, seconds, three_digits};
use dunkelfeld::commands::{ExposeOutputs, ExposedFile, expose_exr};
use dunkelfeld::outputs::LensSource;
use dunkelfeld::radiometry::Number;
use dunkelfeld::sensor::Psf;
use dunkelfeld::{Error, ExposeOptions, OutputPaths, Session};
use std::fmt::Write;

pub(crate) fn run(args: &ExposeArgs) -> Result<Outcome, Error> {
    let sink = Sink::new(args.run.progress);
    let [files, keys] = args.keys.files_and_others();
    let mut options = ExposeOptions::default().with_keys(keys).with_frames(args.frames);
    options.layer.clone_from(&args.layer);
    options.threads = Some(args.run.thread_count());
    let settings = options.settings()?;
    let OutputPaths { image, linear, align, .. } = OutputPaths::of_keys(&files)?;
    let is_named = image.is_some() || linear.is_some();
    let mut outputs = ExposeOutputs::default().with_image(image).with_linear(linear);
    outputs.align = align;
    if !is_named {
        outputs.set_default_image(&args.input);
    }
    let cancel = cancel_on_interrupt();
    let session = Session::new(args.run.thread_count())?.with_progress(&sink).with_cancel(&cancel);
    let exposed = expose_exr(&args.input, &settings, &outputs, &session)?;
    drop(sink);
    print(&report(&exposed));
    if exposed.exposer.no_light() {
        say("warning: the image is black, so there is no automatic exposure; 1 s was used");
    }
    if exposed.frames < settings.frames {
        say(&format!("interrupted: {} of {} frames were written", exposed.frames, settings.frames));
        return Ok(Outcome::Interrupted);
    }
    let (invalid, invalid_variances) = (exposed.exposer.invalid(), exposed.exposer.invalid_variances());
    if invalid > 0 {
        say(&format!(
            "flagged: the radiance of {} is negative or not a number (they count as black) or infinite (they saturate)",
            counted(invalid, "pixel")
        ));
    }
    if invalid_variances > 0 {
        say(&flagged_variances(invalid_variances));
    }
    Ok(if invalid + invalid_variances > 0 { Outcome::Flagged } else { Outcome::Done })
}

/// The lens, each value with its source.
fn lens(exposed: &ExposedFile) -> String {
    let (lens, sources) = (&exposed.optics, &exposed.lens);
    let values = [
        format!("f/{}", Number(lens.f_number())),
        format!("transmission {}", Number(lens.transmission())),
        format!("magnification {}", three_digits(lens.magnification())),
    ];
    let values = values.iter().zip(sources).map(|(value, source)| match source {
        LensSource::Given => value.clone(),
        LensSource::Image => format!("{value} (of the file)"),
        LensSource::Default => format!("{value} (default, the file contains none)"),
    });
    let blur = match lens.psf() {
        Psf::None => None,
        Psf::Diffraction => Some("diffraction".into()),
        Psf::Gaussian { sigma } => Some(format!("Gaussian of {} um", three_digits(1e6 * sigma.0))),
        Psf::Table(_) => Some("MTF of a table".into()),
    };
    let glare = (lens.glare() > 0.0).then(|| format!("glare {}", Number(lens.glare())));
    values.chain(blur).chain(glare).collect::<Vec<_>>().join(", ")
}

fn report(exposed: &ExposedFile) -> String {
    let [width, height] = exposed.exposer.size();
    let mut text = format!(
        "{width} x {height} pixels, {}, exposed for {}; {:.2} % of the pixels are saturated\n",
        exposed.exposer.model().spec().name,
        exposure_time(exposed.exposer.exposure().time().0),
        100.0 * exposed.exposer.saturated()
    );
    let _ = writeln!(text, "lens: {}", lens(exposed));
    if let Some(share) = exposed.exposer.matched() {
        let percent = (1000.0 * share).floor() / 10.0;
        let _ = writeln!(text, "noise-matched exposure can hold in {percent:.1} % of the pixels");
    }
    let words = if exposed.frames == 1 { "1 frame".into() } else { format!("{} frames", exposed.frames) };
    let rate = f64::from(exposed.frames) / exposed.expose_seconds.max(1e-9);
    let (expose, write) = (seconds(exposed.expose_seconds), seconds(exposed.write_seconds));
    let _ = writeln!(text, "{words}, exposed in {expose} ({rate:.1} per second), written in {write}");
    match exposed.files.as_slice() {
        [first, .., last] if exposed.files.len() > 4 => {
            let _ = writeln!(text, "wrote {} ... {} ({} files)", first.display(), last.display(), exposed.files.len());
        }
        files => files.iter().for_each(|file| {
            let _ = writeln!(text, "wrote {}", file.display());
        }),
    }
    text
}
