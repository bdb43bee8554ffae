//! Scenes: opened, changed and rendered.

use crate::cancel::CANCELS;
use crate::film::Film;
use crate::film_data::{FILMS, FilmData};
use crate::handles::{Handles, lock};
use crate::options::{Progress as CProgress, ProgressFunction, RenderOptions};
use crate::pointers::{In, Out, Text, c_text};
use crate::status::{Failure, Status, call, call_for};
use dunkelfeld::{Cancel, Progress, ProgressState, Project};
use std::ffi::{c_char, c_void};
use std::path::Path;
use std::sync::atomic::{AtomicPtr, Ordering};
use std::sync::{Arc, Mutex, PoisonError, TryLockError};

/// A scene or a job.
#[derive(Debug)]
pub struct Scene {
    _opaque: (),
}

static SCENES: Handles<Mutex<Project>> = Handles::new("scene");

/// Works on the project of a scene, unless another call does.
fn with<T>(scene: *const Scene, work: impl FnOnce(&mut Project) -> Result<T, Failure>) -> Result<T, Failure> {
    let project = SCENES.get(scene)?;
    let mut project = match project.try_lock() {
        Ok(project) => project,
        Err(TryLockError::Poisoned(project)) => PoisonError::into_inner(project),
        Err(TryLockError::WouldBlock) => {
            let problem = "serves another call: a render on another thread, or the render that reports this progress";
            return Err(Failure::new(Status::Busy, "scene", problem, "call it later, or open the scene once more"));
        }
    };
    work(&mut project)
}

/// Opens a scene (.glb, .gltf, .obj, .stl, .ply) or a job (.toml). Close it by dunkelfeld_scene_close().
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_scene_open(path: *const c_char, scene: *mut *mut Scene) -> Status {
    // SAFETY: what the header says of pointers.
    let (path, scene) = unsafe { (Text::of(path), Out::of(scene)) };
    call(|| {
        scene.check("scene")?;
        let project = Project::open(path.required("path")?)?;
        scene.set("scene", SCENES.open(Mutex::new(project)))
    })
}

/// Opens a job from its text (TOML). Paths in it are relative to `folder`, or to the current folder if that is NULL.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_scene_from_job(
    job: *const c_char,
    folder: *const c_char,
    scene: *mut *mut Scene,
) -> Status {
    // SAFETY: what the header says of pointers.
    let (job, folder, scene) = unsafe { (Text::of(job), Text::of(folder), Out::of(scene)) };
    call(|| {
        scene.check("scene")?;
        let path = Path::new(folder.get("folder")?.unwrap_or_default()).join("job.toml");
        let project = Project::from_text(path, job.required("job")?)?;
        scene.set("scene", SCENES.open(Mutex::new(project)))
    })
}

/// Changes scene and settings by keys of a job (TOML), which are merged into the job. They replace those of an earlier call; an empty
/// text is the scene as it was opened. After an error the scene is as before.
///
/// One call at a time per scene.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_scene_set_overrides(scene: *mut Scene, overrides: *const c_char) -> Status {
    // SAFETY: what the header says of pointers.
    let overrides = unsafe { Text::of(overrides) };
    call(|| {
        let overrides = overrides.required("overrides")?;
        with(scene, |project| Ok(project.set_overrides(overrides)?))
    })
}

/// The content of a scene as JSON: objects, materials, lights, cameras, effects, hazards. Close the text by dunkelfeld_text_close().
///
/// One call at a time per scene.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_scene_inspect(scene: *mut Scene, json: *mut *mut c_char) -> Status {
    // SAFETY: what the header says of pointers.
    let json = unsafe { Out::of(json) };
    call(|| {
        json.check("json")?;
        let inspection = with(scene, |project| Ok(project.inspect()))?;
        let text = serde_json::to_string(&inspection);
        let fault = |e: serde_json::Error| Failure::new(Status::Internal, "inspection", e.to_string(), "report it");
        json.set_text("json", &text.map_err(fault)?)
    })
}

/// Renders a scene. `options` may be NULL. No file is written, except a checkpoint. A cancelled render returns
/// DUNKELFELD_STATUS_INTERRUPTED and a film with the samples until then. Close the film by dunkelfeld_film_close().
///
/// One call at a time per scene.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_scene_render(
    scene: *mut Scene,
    options: *const RenderOptions,
    film: *mut *mut Film,
) -> Status {
    // SAFETY: what the header says of pointers.
    let (options, film) = unsafe { (In::of(options), Out::of(film)) };
    call_for(|| {
        film.check("film")?;
        let c = options.get("options")?;
        let options = c.to_options()?;
        let cancel = if c.cancel.is_null() { Arc::new(Cancel::new()) } else { CANCELS.get(c.cancel)? };
        let caller = Caller {
            function: c.progress,
            user: AtomicPtr::new(c.user),
            cancel: &cancel,
            one_at_a_time: Mutex::new(()),
        };
        let data = with(scene, |project| {
            let result = project.render_options(options, &caller, &cancel)?;
            Ok(FilmData::new(result))
        })?;
        let status = if data.is_interrupted { Status::Interrupted } else { Status::Ok };
        film.set("film", FILMS.open(data))?;
        Ok(status)
    })
}

/// Closes a scene. A render of it on another thread goes on. NULL is allowed.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub extern "C" fn dunkelfeld_scene_close(scene: *mut Scene) -> Status {
    call(|| SCENES.close(scene))
}

/// Closes a text that a function of this library returned. NULL is allowed. A text must be closed once.
///
/// Thread-safe.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dunkelfeld_text_close(text: *mut c_char) {
    // SAFETY: what the header says of pointers.
    let text = unsafe { Out::of(text) };
    crate::pointers::close_text(text);
}

/// Calls the progress function of a caller.
struct Caller<'a> {
    function: ProgressFunction,
    /// Passed on as it is.
    user: AtomicPtr<c_void>,
    cancel: &'a Cancel,
    one_at_a_time: Mutex<()>,
}

impl Progress for Caller<'_> {
    fn update(&self, state: &ProgressState) {
        let Some(function) = self.function else { return };
        let stage = c_text(state.stage.name());
        let progress = CProgress {
            struct_size: size_of::<CProgress>(),
            stage: stage.as_ptr(),
            fraction: state.fraction,
            elapsed: state.elapsed,
            remaining: state.remaining.unwrap_or(-1.0),
            samples: state.samples,
        };
        let _alone = lock(&self.one_at_a_time);
        if function(self.user.load(Ordering::Relaxed), &raw const progress) != 0 {
            self.cancel.cancel();
        }
    }
}
