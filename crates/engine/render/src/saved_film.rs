//! A film in a file: its sums to the last bit, the ids of its pixels, and the settings that expose it.

use crate::checkpoint::exposure_recipe::{ExposureRecipe, labels_of, numbers_of};
use crate::checkpoint::has_field;
use crate::error::{Error, written};
use crate::rendered_film::RenderedFilm;
use crate::settings::RenderSettings;
use dunkelfeld_denoise::DenoiseMethod;
use dunkelfeld_files::InputError;
use dunkelfeld_files::checkpoint::{CheckpointHead, read_checkpoint, write_checkpoint};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::Path;

/// A rendered film together with its exposure. A file of it has the format of checkpoints, and cannot be continued. A
/// checkpoint is read as well.
#[derive(Clone, Debug)]
pub struct SavedFilm {
    /// The film.
    pub film: RenderedFilm,
    /// Settings that expose it as its render did.
    pub settings: RenderSettings,
    /// Does the lens darken the image towards its corners?
    pub is_vignetted: bool,
}

#[derive(Serialize, Deserialize)]
struct Description {
    saved_film: ExposureRecipe,
    /// The samples of every pixel, if the film is a part of a render.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    samples: Option<Range<u32>>,
    /// The denoiser of the picture. The place of its library is that of each machine.
    #[serde(default)]
    denoise: DenoiseMethod,
}

/// The part of the description of a checkpoint that exposes its film.
#[derive(Deserialize)]
struct OfCheckpoint {
    recipe: Option<ExposureRecipe>,
    samples: Option<Range<u32>>,
}

impl SavedFilm {
    /// Writes the film, completely or not at all.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let Self { film, settings, is_vignetted } = self;
        let saved_film =
            ExposureRecipe::new(settings, [*is_vignetted, film.is_spread], [&film.object_names, &film.material_names]);
        let [objects, materials] = numbers_of(&film.ids);
        let stored = serde_json::to_string(&Description {
            saved_film,
            samples: settings.run.samples.clone(),
            denoise: settings.denoise.method,
        })
        .map_err(Into::into)
        .and_then(|text| {
            let head = CheckpointHead {
                width: film.sums.width(),
                height: film.sums.height(),
                text: &text,
                weights: None,
                target: None,
                objects: Some(&objects),
                materials: Some(&materials),
            };
            write_checkpoint(path, &head, &mut |rows, out| film.sums.read_rows(rows, out))
        });
        written(path, stored)
    }

    /// Reads a film that [`Self::write`] wrote, or that of a checkpoint.
    ///
    /// # Errors
    /// The file cannot be read, or is another one.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let checkpoint = read_checkpoint(path)?;
        let help = "use a file that a saved film has, such as `film.save(\"a.film\")` in Python";
        let fault = |problem: String| InputError::new(path, "the description", problem, help);
        let unreadable = |e| fault(format!("is not that of a saved film: {e}"));
        let (saved_film, samples, denoise) = if has_field(&checkpoint.text, "key") {
            let found: OfCheckpoint = serde_json::from_str(&checkpoint.text).map_err(unreadable)?;
            let help = "write it again by a render with this checkpoint";
            let problem = "is a checkpoint of an earlier version, without sensor and names";
            let recipe = found.recipe.ok_or_else(|| InputError::new(path, "the description", problem, help))?;
            (recipe, found.samples, DenoiseMethod::Off)
        } else {
            let found: Description = serde_json::from_str(&checkpoint.text).map_err(unreadable)?;
            (found.saved_film, found.samples, found.denoise)
        };
        let (Some(objects), Some(materials)) = (&checkpoint.objects, &checkpoint.materials) else {
            return Err(fault("has no ids of objects and materials".into()).into());
        };
        let ids = labels_of(objects, materials);
        let sums = checkpoint.film;
        let mut settings = saved_film.settings(sums.width(), sums.height());
        settings.run.samples = samples;
        settings.denoise.method = denoise;
        let is_vignetted = saved_film.is_vignetted;
        let ExposureRecipe { is_spread, object_names, material_names, .. } = saved_film;
        let film = RenderedFilm { is_spread, ids, object_names, material_names, ..RenderedFilm::without_ids(sums) };
        Ok(Self { film, settings, is_vignetted })
    }
}
