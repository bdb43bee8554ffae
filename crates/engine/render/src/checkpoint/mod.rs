//! Checkpoints: the data with which a later process continues a render.
//!
//! A sample is a pure function of its coordinates, and the sums of a film are exact. So the film, the plan and the
//! state of schedule and planner suffice for a later process to end with the same bits. Before it continues, it
//! verifies that it renders the same. The [`RenderKey`] in the file contains everything on which samples and plan
//! depend.

pub(crate) mod exposure_recipe;

use crate::checkpoint::exposure_recipe::{ExposureRecipe, numbers_of};
use crate::error::Error;
use crate::plan::PlannerState;
use crate::plan::forecast::Forecast;
use crate::render_key::RenderKey;
use crate::rendered_film::material_names;
use crate::settings::{CheckpointSettings, RenderSettings};
use crate::stage::Stage;
use dunkelfeld_adaptive::budget::{Schedule, StopReason};
use dunkelfeld_files::InputError;
use dunkelfeld_files::checkpoint::{Checkpoint, CheckpointHead, read_checkpoint, write_checkpoint};
use dunkelfeld_film::{Film, PixelSums, Plane};
use dunkelfeld_integrator::LearnedRoulette;
use dunkelfeld_integrator::{ConnectionTally, PixelIds, PixelSample};
use dunkelfeld_scene::{RayGenerator, Scene};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Checkpoints take at most this share of the time of one thread. So checkpoints of large films become rarer.
const MAX_TIME: f64 = 0.02;
/// Assumed duration of one write until it has been measured [s per megapixel]: 350 MB at 250 MB/s.
const SECONDS_PER_MEGAPIXEL: f64 = 1.4;
/// Assumed largest ratio of the duration of a checkpoint to that of the last one. A checkpoint that might not be
/// complete by the deadline is not started.
const MARGIN: f64 = 2.0;

/// Contribution of earlier processes to a resumed render, or of the parts to a merged render.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ResumedWork {
    /// Working time of the earlier processes \[s\].
    pub seconds: f64,
    /// Number of their samples.
    pub samples: u64,
    /// Was the render complete already?
    pub was_complete: bool,
}

/// The text of a checkpoint file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Description {
    pub(crate) key: RenderKey,
    /// The film holds these samples of every pixel, if it is a part.
    pub(crate) samples: Option<Range<u32>>,
    /// Settings for the exposure of the film without its scene. Files of earlier versions have them in parts only.
    pub(crate) recipe: Option<ExposureRecipe>,
    pub(crate) state: State,
}

/// Progress of a render.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct State {
    /// Working time of all processes \[s\].
    pub(crate) elapsed: f64,
    /// Reason for the end of the render; `None` while it is not complete.
    pub(crate) stop: Option<StopReason>,
    /// State of the planning; `None` for a render with a given plan.
    pub(crate) course: Option<AdaptiveState>,
    pub(crate) planner: PlannerState,
    pub(crate) forecast: Option<Forecast>,
    pub(crate) stages: Vec<(Stage, f64)>,
    /// Connections through covers: those attempted, those that converged, and the rays traced for them, up to the open
    /// round.
    pub(crate) connections: [u64; 3],
    /// Column, row and index of the first invalid samples.
    pub(crate) invalid: Vec<[u32; 3]>,
}

/// The decisions of an adaptive render. Together with the film, its shares and the [`PlannerState`] they determine all
/// later decisions. Every further value that influences the distribution of samples must be stored here or in
/// [`State`].
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct AdaptiveState {
    pub(crate) schedule: Schedule,
    /// The purpose of the current round.
    pub(crate) stage: Stage,
    /// Seconds reserved for the end, without the checkpoint.
    pub(crate) closing: f64,
    /// Samples from which on the next dry run of the outputs is due.
    pub(crate) dry_run_at: u64,
}

impl State {
    /// The tally of connections. No number in a file makes it overflow.
    pub(crate) fn connections(&self) -> ConnectionTally {
        let [attempts, converged, rays] = self.connections.map(|n| n.min(u64::MAX >> 8));
        ConnectionTally { attempts, converged, rays, ..ConnectionTally::default() }
    }

    /// The first invalid samples.
    pub(crate) fn invalid(&self) -> Vec<PixelSample> {
        self.invalid.iter().map(|&[x, y, index]| PixelSample { x, y, index }).collect()
    }
}

/// A stored render.
pub(crate) struct Restored {
    pub(crate) state: State,
    pub(crate) weights: Option<Plane<f32>>,
    pub(crate) target: Option<Plane<u32>>,
    pub(crate) film: Film,
}

/// Does a description have this field?
pub(crate) fn has_field(text: &str, name: &str) -> bool {
    serde_json::from_str::<serde_json::Map<String, serde_json::Value>>(text).is_ok_and(|map| map.contains_key(name))
}

/// Reads a file and its description.
pub(crate) fn load(path: &Path) -> Result<(Description, Checkpoint), Error> {
    let mut checkpoint = read_checkpoint(path)?;
    let help = "use a file that this version of the program wrote, or another name to begin anew";
    let fault = |problem: String| InputError::new(path, "the description", problem, help);
    if has_field(&checkpoint.text, "saved_film") {
        let help = "name another file; `Film.load` of Python, and `SavedFilm::read`, read this one";
        let problem = "is a saved film, not a checkpoint: it cannot be continued or joined";
        return Err(InputError::new(path, "the description", problem, help).into());
    }
    let description: Description = serde_json::from_str(&std::mem::take(&mut checkpoint.text))
        .map_err(|e| fault(format!("is not that of a render: {e}")))?;
    let course = description.state.course.as_ref();
    if course.is_some_and(|c| c.schedule.taken() > checkpoint.film.total_samples()) {
        return Err(fault("counts more samples than the film has".into()).into());
    }
    Ok((description, checkpoint))
}

/// Writes the checkpoints of a running render.
pub(crate) struct CheckpointWriter {
    settings: CheckpointSettings,
    key: RenderKey,
    samples: Option<Range<u32>>,
    recipe: ExposureRecipe,
    numbers: [Plane<u32>; 2],
    size: (u32, u32),
    started: Instant,
    clock: Mutex<Clock>,
}

struct Clock {
    /// Time at which the last checkpoint was complete, and its duration.
    last: Instant,
    took: Duration,
    fault: Option<String>,
}

/// Contents of the file beside the sums.
#[derive(Clone, Copy)]
pub(crate) struct Snapshot<'a> {
    pub(crate) state: &'a State,
    pub(crate) weights: Option<&'a Plane<f32>>,
    pub(crate) target: Option<&'a Plane<u32>>,
}

/// Appends the sums of some rows.
pub(crate) type Rows<'a> = &'a mut dyn FnMut(Range<u32>, &mut Vec<PixelSums>);

impl CheckpointWriter {
    /// Locks and opens the checkpoint of a render that began at `started`. Returns the stored render, if the file
    /// exists.
    ///
    /// # Errors
    /// A file that cannot be read or written, that another process writes, or that belongs to another render.
    pub(crate) fn open(
        settings: &CheckpointSettings,
        scene: &Scene,
        camera: &RayGenerator,
        render: &RenderSettings,
        roulette: Option<&LearnedRoulette>,
        labels: &Plane<Option<PixelIds>>,
        started: Instant,
    ) -> Result<(Self, Option<Restored>), Error> {
        let mut settings = settings.clone();
        if settings.lock.is_none() {
            settings.lock()?;
        }
        let path = &settings.path;
        let key = RenderKey::new(scene, camera, render, roulette);
        let saved = path.exists().then(|| stored(path, &key, render)).transpose()?;
        let earlier = saved.as_ref().map_or(0.0, |s| s.state.elapsed);
        let pixels = f64::from(render.width) * f64::from(render.height);
        let writer = Self {
            settings,
            key,
            samples: render.run.samples.clone(),
            recipe: ExposureRecipe::new(
                render,
                [camera.has_vignetting(), render.is_spread()],
                [scene.object_names(), &material_names(scene)],
            ),
            numbers: numbers_of(labels),
            size: (render.width, render.height),
            started: began(started, earlier).0,
            clock: Mutex::new(Clock {
                last: Instant::now(),
                took: Duration::from_secs_f64(SECONDS_PER_MEGAPIXEL * 1e-6 * pixels),
                fault: None,
            }),
        };
        Ok((writer, saved))
    }

    /// Expected duration of one write \[s\]: the duration of the last one, or an estimate before the first.
    pub(crate) fn expected_seconds(&self) -> f64 {
        self.clock.lock().map_or(0.0, |clock| clock.took.as_secs_f64())
    }

    /// Writes a checkpoint if enough time has passed since the last one, if the write will be complete by the deadline,
    /// and if no other thread holds the writer.
    pub(crate) fn keep_if_due(&self, snapshot: Snapshot<'_>, deadline: Option<Instant>, rows: Rows<'_>) {
        let Ok(mut clock) = self.clock.try_lock() else { return };
        let is_due =
            clock.last.elapsed().as_secs_f64() >= self.settings.seconds.max(clock.took.as_secs_f64() / MAX_TIME);
        let is_in_time = deadline.is_none_or(|d| Instant::now() + clock.took.mul_f64(MARGIN) < d);
        // With an interval of 0 s, as in tests, a checkpoint is written at every opportunity.
        if (is_due || self.settings.seconds == 0.0) && is_in_time {
            self.store(&mut clock, snapshot, rows);
        }
    }

    /// Writes a checkpoint of the present state.
    pub(crate) fn keep(&self, snapshot: Snapshot<'_>, rows: Rows<'_>) {
        if let Ok(mut clock) = self.clock.lock() {
            self.store(&mut clock, snapshot, rows);
        }
    }

    /// The error of the last write of a checkpoint; `None` if it succeeded.
    pub(crate) fn fault(self) -> Option<String> {
        self.clock.into_inner().ok().and_then(|c| c.fault)
    }

    /// A failed write does not end the render. The previous checkpoint stays, and the error is stored.
    fn store(&self, clock: &mut Clock, snapshot: Snapshot<'_>, rows: Rows<'_>) {
        let began = Instant::now();
        let description = Description {
            key: self.key.clone(),
            samples: self.samples.clone(),
            recipe: Some(self.recipe.clone()),
            state: State { elapsed: self.started.elapsed().as_secs_f64(), ..snapshot.state.clone() },
        };
        let result = write(&self.settings.path, self.size, &description, snapshot, &self.numbers, rows);
        clock.fault = result.err().map(|e| e.to_string());
        clock.took = began.elapsed();
        clock.last = Instant::now();
    }
}

fn write(
    path: &Path,
    (width, height): (u32, u32),
    description: &Description,
    snapshot: Snapshot<'_>,
    [objects, materials]: &[Plane<u32>; 2],
    rows: Rows<'_>,
) -> std::io::Result<()> {
    let head = CheckpointHead {
        width,
        height,
        text: &text_of(description)?,
        weights: snapshot.weights,
        target: snapshot.target,
        objects: Some(objects),
        materials: Some(materials),
    };
    write_checkpoint(path, &head, rows)
}

/// A description as text, in the format of the file.
pub(crate) fn text_of(description: &Description) -> std::io::Result<String> {
    serde_json::to_string(description).map_err(std::io::Error::other)
}

/// Contents of the file, if it belongs to this render.
fn stored(path: &Path, key: &RenderKey, render: &RenderSettings) -> Result<Restored, Error> {
    let (description, stored) = load(path)?;
    let other = if description.samples != render.run.samples {
        Some(format!("not the same part, {} there and {} here", part(&description.samples), part(&render.run.samples)))
    } else {
        description.key.difference(key)
    };
    if let Some(difference) = other {
        let problem = format!("is the checkpoint of another render: {difference}");
        let help = "render the same as before, name another checkpoint, or delete this one to begin anew";
        return Err(InputError::new(path, "the description", problem, help).into());
    }
    let Checkpoint { weights, target, film, .. } = stored;
    if (film.width(), film.height()) != (render.width, render.height) {
        let (problem, help) = ("does not have the size of the description", "delete it to begin anew");
        return Err(InputError::new(path, "the film", problem, help).into());
    }
    Ok(Restored { state: description.state, weights, target, film })
}

/// The start of a render without its pauses, and the seconds from that start to `started`. If the clock does not reach
/// back that far, the time of earlier processes is left out.
pub(crate) fn began(started: Instant, earlier: f64) -> (Instant, f64) {
    let before = Duration::try_from_secs_f64(earlier).ok().and_then(|d| started.checked_sub(d));
    before.map_or((started, 0.0), |before| (before, earlier))
}

fn part(samples: &Option<Range<u32>>) -> String {
    samples.as_ref().map_or_else(|| "the whole render".into(), |s| format!("samples {}..{}", s.start, s.end))
}

/// The sums of some rows of a film.
pub(crate) fn film_rows(film: &Film) -> impl FnMut(Range<u32>, &mut Vec<PixelSums>) + '_ {
    |rows, out| film.read_rows(rows, out)
}
