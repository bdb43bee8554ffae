//! `dunkelfeld denoise`: reads an EXR, and writes it with a denoised layer, or writes a picture.

use crate::args::DenoiseArgs;
use crate::outcome::{Outcome, print, say};
use crate::words::{counted, flagged_variances, seconds};
use dunkelfeld::commands::{check_denoise_output, denoise_exr};
use dunkelfeld::denoising::{select_denoiser, why_builtin};
use dunkelfeld::{DenoiseMethod, DenoiseSettings, Error, Session};

pub(crate) fn run(args: &DenoiseArgs) -> Result<Outcome, Error> {
    let mut settings = DenoiseSettings::default();
    let method = args.denoise.or(args.oidn.is_none().then_some(DenoiseMethod::Auto));
    select_denoiser(method, args.oidn.as_deref(), &mut settings);
    check_denoise_output(&args.input, &args.output, &settings)?;
    let work = |session: &Session<'_>| denoise_exr(&args.input, &settings, args.memory.memory, session);
    let Some(file) = args.run.work(work)? else { return Ok(Outcome::Interrupted) };
    let features = match file.features.join(", ") {
        none if none.is_empty() => "the image alone".into(),
        some => format!("the image and its {some}"),
    };
    let text = format!(
        "{} x {} pixels, denoised by {} in {}; its input was {features}\nwrote {}\n",
        file.layers.width,
        file.layers.height,
        file.denoised.denoiser,
        seconds(file.denoised.seconds),
        args.output.display()
    );
    let denoiser = file.denoised.denoiser.clone();
    let (invalid, invalid_variances) = (file.invalid, file.invalid_variances);
    file.save(&args.output)?;
    print(&text);
    if let Some(why) = why_builtin(&settings, &denoiser) {
        say(&format!("note: {why}"));
    }
    if invalid > 0 {
        say(&format!(
            "flagged: the radiance of {} is negative, infinite or not a number; the denoised image is not to be \
             trusted there and around",
            counted(invalid, "pixel")
        ));
    }
    if invalid_variances > 0 {
        say(&flagged_variances(invalid_variances));
    }
    Ok(if invalid + invalid_variances > 0 { Outcome::Flagged } else { Outcome::Done })
}
