//! Joins the parts of a render that several processes computed.

use crate::checkpoint::exposure_recipe::{ExposureRecipe, labels_of};
use crate::checkpoint::{Description, ResumedWork, State, film_rows, load, text_of};
use crate::driver::Rendering;
use crate::error::{Error, written};
use crate::rendered_film::RenderedFilm;
use crate::settings::RenderSettings;
use crate::stage::Stage;
use dunkelfeld_adaptive::budget::StopReason;
use dunkelfeld_adaptive::{plan, weights};
use dunkelfeld_files::InputError;
use dunkelfeld_files::checkpoint::{CheckpointHead, write_checkpoint};
use dunkelfeld_film::{Film, Plane};
use dunkelfeld_integrator::LaneUse;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A part without its film.
struct Part<'a> {
    path: &'a Path,
    samples: Range<u32>,
    taken: u64,
    description: Description,
    recipe: ExposureRecipe,
}

impl Part<'_> {
    fn summary(&self) -> PartSummary {
        let seconds = self.description.state.elapsed;
        PartSummary { path: self.path.into(), samples: self.samples.clone(), taken: self.taken, seconds }
    }

    fn range(&self) -> String {
        format!("{}..{}", self.samples.start, self.samples.end)
    }
}

/// One part of a merged render.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PartSummary {
    /// Its checkpoint.
    pub path: PathBuf,
    /// Indices of its samples in every pixel.
    pub samples: Range<u32>,
    /// Samples of all pixels.
    pub taken: u64,
    /// Seconds that it was rendered.
    pub seconds: f64,
}

/// The finished parts of one render ([`RunSettings::samples`](crate::RunSettings::samples)), joined: bit by bit the film of one process that
/// rendered all of their samples.
pub struct JoinedParts {
    parts: Vec<PartSummary>,
    film: Film,
    ids: [Plane<u32>; 2],
    description: Description,
    recipe: ExposureRecipe,
}

impl JoinedParts {
    /// Reads the parts, in any order, and adds their sums. Neither scene nor job is needed.
    ///
    /// # Errors
    /// No parts, files that are not finished parts, parts of different renders, samples that occur twice or are missing in between.
    pub fn read(paths: &[PathBuf]) -> Result<Self, Error> {
        let (parts, film, ids) = join(paths)?;
        let (Some(first), Some(last)) = (parts.first(), parts.last()) else { return Err(no_parts()) };
        let samples = first.samples.start..last.samples.end;
        let (key, recipe) = (first.description.key.clone(), first.recipe.clone());
        let state = together(&parts);
        let description = Description { key, samples: Some(samples), recipe: Some(recipe.clone()), state };
        Ok(Self { parts: parts.iter().map(Part::summary).collect(), film, ids, description, recipe })
    }

    /// The parts, in the order of their samples.
    pub fn parts(&self) -> &[PartSummary] {
        &self.parts
    }

    /// Width and height of the film.
    pub fn size(&self) -> [u32; 2] {
        [self.film.width(), self.film.height()]
    }

    /// Indices of the samples in every pixel.
    pub fn samples(&self) -> Range<u32> {
        self.description.samples.clone().unwrap_or_default()
    }

    /// The settings for the exposure of the whole: those of the parts.
    pub fn settings(&self) -> RenderSettings {
        let mut settings = self.recipe.settings(self.film.width(), self.film.height());
        settings.run.samples = Some(self.samples());
        settings
    }

    /// Does the lens darken the image towards its corners?
    pub fn is_vignetted(&self) -> bool {
        self.recipe.is_vignetted
    }

    /// Did the parts replay a sample plan?
    pub fn is_replay(&self) -> bool {
        self.recipe.is_replay
    }

    /// Writes a checkpoint of the whole. It is a part again, which can be merged or continued.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_checkpoint(&self, path: &Path) -> Result<(), Error> {
        let [objects, materials] = &self.ids;
        let stored = text_of(&self.description).and_then(|text| {
            let head = CheckpointHead {
                width: self.film.width(),
                height: self.film.height(),
                text: &text,
                weights: None,
                target: None,
                objects: Some(objects),
                materials: Some(materials),
            };
            write_checkpoint(path, &head, &mut film_rows(&self.film))
        });
        written(path, stored)
    }

    /// The finished render. `load_seconds` is the duration of reading \[s\]. `threads` is the number of threads of the
    /// following stages.
    pub fn into_rendering(self, load_seconds: f64, threads: usize) -> Rendering {
        let Self { film, ids: [objects, materials], description: Description { mut state, .. }, recipe, .. } = self;
        state.stages.push((Stage::Load, load_seconds));
        Rendering {
            stop: StopReason::Samples,
            interrupted: false,
            invalid: state.invalid(),
            connections: state.connections(),
            lane_use: LaneUse::default(),
            weights: weights::uniform(film.width(), film.height()),
            forecast: None,
            threads,
            earlier: ResumedWork { seconds: state.elapsed, samples: film.total_samples(), was_complete: true },
            checkpoint_fault: None,
            stages: state.stages,
            film: RenderedFilm {
                is_spread: recipe.is_spread,
                ids: labels_of(&objects, &materials),
                object_names: recipe.object_names,
                material_names: recipe.material_names,
                ..RenderedFilm::without_ids(film)
            },
        }
    }
}

fn no_parts() -> Error {
    Error::setting("merge", "there are no parts", "name the files of at least one part")
}

/// Parts, the sums of all, and their ids of objects and materials.
type Joined<'a> = (Vec<Part<'a>>, Film, [Plane<u32>; 2]);

/// Reads the parts and adds them up.
fn join(paths: &[PathBuf]) -> Result<Joined<'_>, Error> {
    let mut parts: Vec<Part<'_>> = Vec::with_capacity(paths.len());
    let mut whole: Option<(Film, [Plane<u32>; 2])> = None;
    for path in paths {
        let (description, stored) = load(path)?;
        let fault = |problem: String, help: &str| Error::from(InputError::new(path, "the part", problem, help));
        let planes = stored.objects.zip(stored.materials);
        let (Some(samples), Some(recipe), Some((objects, materials))) =
            (description.samples.clone(), description.recipe.clone(), planes)
        else {
            return Err(fault("is a whole render, not a part".into(), "merge files of `render --samples A..B`"));
        };
        if description.state.stop.is_none() {
            let help = "render it to its end, with the command that began it";
            return Err(fault(format!("(samples {}..{}) is not finished", samples.start, samples.end), help));
        }
        let most = stored.film.sample_counts().data().iter().copied().max().unwrap_or(0);
        if samples.is_empty() || samples.end > plan::MAX_SPP || most > samples.end - samples.start {
            let problem = format!("has {most} samples in a pixel and claims to be {}..{}", samples.start, samples.end);
            return Err(fault(problem, "render it again"));
        }
        if let Some(first) = parts.first() {
            let help = "merge parts of one scene with the same settings";
            let of = |difference| format!("is of another render than {}: {difference}", first.path.display());
            if let Some(difference) = first.description.key.difference(&description.key) {
                return Err(fault(of(difference), help));
            }
            if let Some(what) = first.recipe.difference(&recipe) {
                return Err(fault(of(format!("not the same {what}")), help));
            }
        }
        let (taken, part) = (stored.film.total_samples(), Part { path, samples, taken: 0, description, recipe });
        // This check precedes the addition: parts that do not overlap have no more samples than can be counted.
        let meets =
            |other: &&Part<'_>| part.samples.start < other.samples.end && other.samples.start < part.samples.end;
        if let Some(other) = parts.iter().find(meets) {
            return Err(misfit(&part, "overlap with", other));
        }
        match &mut whole {
            None => whole = Some((stored.film, [objects, materials])),
            Some((film, _)) => {
                film.merge(&stored.film).map_err(|e| fault(e.to_string(), "merge parts of one size"))?;
            }
        }
        parts.push(Part { taken, ..part });
    }
    let (film, numbers) = whole.ok_or_else(no_parts)?;
    parts.sort_by_key(|p| (p.samples.start, p.samples.end));
    match parts.windows(2).find(|pair| pair[0].samples.end < pair[1].samples.start) {
        Some(pair) => Err(misfit(&pair[1], "leave a gap after", &pair[0])),
        None => Ok((parts, film, numbers)),
    }
}

/// The error of a part whose samples do not fit those of another.
fn misfit(part: &Part<'_>, problem: &str, other: &Part<'_>) -> Error {
    let problem = format!("samples {} {problem} samples {} of {}", part.range(), other.range(), other.path.display());
    let help = "merge parts that follow upon each other, each once";
    InputError::new(part.path, "the part", problem, help).into()
}

/// The state of a render that took the samples of all parts.
fn together(parts: &[Part<'_>]) -> State {
    let mut all = State { stop: Some(StopReason::Samples), ..State::default() };
    for Part { description: Description { state, .. }, .. } in parts {
        all.elapsed += state.elapsed;
        for &(stage, seconds) in &state.stages {
            match all.stages.iter_mut().find(|(s, _)| *s == stage) {
                Some((_, total)) => *total += seconds,
                None => all.stages.push((stage, seconds)),
            }
        }
        for (total, n) in all.connections.iter_mut().zip(state.connections) {
            *total = total.saturating_add(n);
        }
        all.invalid.extend(&state.invalid);
    }
    all.invalid.sort_by_key(|&[x, y, index]| (y, x, index));
    all.invalid.truncate(crate::round::MAX_LISTED);
    all
}
