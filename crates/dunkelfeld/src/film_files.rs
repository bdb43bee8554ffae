//! Files of a film in memory: those that the command of its render writes, and the film itself.

use crate::denoising::{denoise_frame, find_denoiser};
use crate::frame::develop_film;
use crate::guard::check_outputs;
use crate::outputs::{OutputPaths, Written, save_plan, save_text};
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_render::{Error, SavedFilm, Session};
use std::path::Path;

/// Writes files of a film, on threads of its own: the bytes that `dunkelfeld render` writes for the same render. `stats` are
/// the statistics ([`Stats::to_json`](crate::Stats::to_json)) for [`OutputPaths::stats`]. The film is exposed, and the picture
/// denoised, by the settings of its render. No file replaces one of `inputs` or the checkpoint of the render, and each file
/// is written completely or not at all.
///
/// # Errors
/// No output at all, statistics that there are none of, a name that does not fit, an output that is an input or another
/// output, and files that cannot be written; earlier files remain.
pub fn save_film_files(
    saved: &SavedFilm,
    stats: Option<&str>,
    outputs: &OutputPaths,
    inputs: &InputFiles,
) -> Result<(), Error> {
    let SavedFilm { film, settings, is_vignetted } = saved;
    if outputs.is_empty() {
        return Err(Error::setting("output", "no file is named", "name an image, or another output"));
    }
    if outputs.stats.is_some() && stats.is_none() {
        let problem = "a film from a file has no statistics";
        return Err(Error::setting("stats", problem, "save them after the render"));
    }
    let mut inputs = inputs.clone();
    inputs.add_library(settings.denoise.oidn.as_deref());
    let checkpoint = settings.run.checkpoint.as_ref().map(|keep| keep.path.as_path());
    outputs.check_beside(settings.has_sensor(), checkpoint, &inputs)?;
    let session = Session::new(settings.run.threads)?;
    if outputs.image.is_some() || outputs.linear.is_some() || outputs.exr.is_some() {
        let shows_denoised = outputs.image.is_some() || outputs.exr.is_some();
        let denoiser = if shows_denoised { find_denoiser(&settings.denoise)? } else { None };
        session.install(|| {
            let mut frame = develop_film(film, settings)?;
            if let Some(denoiser) = &denoiser {
                denoise_frame(&mut frame, &film.sums, &**denoiser, settings, &session)?;
            }
            Written { film, frame: &frame, settings, is_vignetted: *is_vignetted }.save(outputs)
        })?;
    } else if let Some(path) = &outputs.plan {
        session.install(|| save_plan(path, &film.sums.sample_counts(), settings))?;
    }
    match (&outputs.stats, stats) {
        (Some(path), Some(text)) => save_text(path, text),
        _ => Ok(()),
    }
}

/// [`SavedFilm::write`] that replaces neither one of `inputs` nor the checkpoint of the render, which could not be continued
/// then.
///
/// # Errors
/// Such a file, and one that cannot be written.
pub fn save_film(saved: &SavedFilm, path: &Path, inputs: &InputFiles) -> Result<(), Error> {
    let mut inputs = inputs.clone();
    if let Some(keep) = &saved.settings.run.checkpoint {
        inputs.add(&keep.path, Role::Checkpoint);
    }
    check_outputs(&[("the film", path)], &inputs)?;
    saved.write(path)
}
