//! The state that the render, the analysis and the server share.

use crate::developed::{OWN_SENSOR, Sensors, fixed_f_number};
use crate::engine::Times;
pub(crate) use crate::locks::lock;
use crate::outlook::{MAX_SPP, from_measured, progress_at, seconds_at, within_view};
use crate::protocol::{
    Activity, Camera, EffectState, Fault, FilmState, ForecastPoint, ForecastSource, LensState, LightState,
    MaterialState, Noise, Note, PerLight, Ranges, RenderState, SceneState, SensorState, SourceKind, State,
};
use crate::scene_change::{SceneChange, SceneParts, has_power, has_switch};
use crate::snapshot::Snapshot;
use crate::statistics::Statistics;
use crate::store::Store;
use dunkelfeld::limits::DEFAULT_F_NUMBER;
use dunkelfeld::sensor::ExposureNoise;
use dunkelfeld::sensor::TimedExposure;
use dunkelfeld::{Cancel, DenoiseMethod, Project, RenderSettings, SensorChoice, Session};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Instant, SystemTime};
use tokio::sync::watch;

/// The level at which a view begins: total noise 12 % above that of the sensor.
const DEFAULT_TARGET: f64 = 0.5;

/// What the view shows.
#[derive(Clone, Debug)]
pub(crate) struct Subject {
    pub(crate) path: PathBuf,
    pub(crate) kind: SourceKind,
    /// The folder of the files that are saved.
    pub(crate) output: PathBuf,
    /// Nice value of the threads of the render.
    pub(crate) nice: u8,
}

/// Work for the thread that renders, which has the scene.
pub(crate) type Job = Box<dyn FnOnce(&Project) + Send>;

/// The requests to the thread that renders.
#[derive(Default)]
pub(crate) struct Control {
    pub(crate) jobs: Vec<Job>,
    pub(crate) is_paused: bool,
    /// A change of the scene that begins the render again.
    pub(crate) change: Option<SceneChange>,
    /// The change that the thread that renders is making.
    pub(crate) in_progress: Option<SceneChange>,
    /// A change of the files of the scene, which begins the render again.
    pub(crate) reload: bool,
    /// A page shows a picture with results of an earlier film or another camera.
    pub(crate) is_analysis_awaited: bool,
    /// A page shows a camera without a certificate.
    pub(crate) is_certificate_awaited: bool,
    pub(crate) quit: bool,
    /// Ends the render that runs.
    pub(crate) cancel: Arc<Cancel>,
}

/// A film for each light that is on.
#[derive(Debug)]
pub(crate) struct LightFilms {
    pub(crate) lights: usize,
    /// Memory of the render with these films \[bytes\].
    pub(crate) bytes: u64,
    /// The reason why there is less.
    pub(crate) fits: Result<(), Fault>,
}

/// Time of the last change of a file, and its length \[bytes\]. `None` without a file.
pub(crate) type Stamp = Option<(SystemTime, u64)>;

/// The data of the page that change during the view.
#[derive(Debug, Default)]
pub(crate) struct Live {
    /// The picture.
    pub(crate) snapshot: Option<Arc<Snapshot>>,
    pub(crate) render: RenderState,
    /// The times of the render that runs.
    pub(crate) times: Times,
    pub(crate) error: Option<Fault>,
    pub(crate) notes: Vec<Note>,
    pub(crate) statistics: Statistics,
    /// The forecast of the plan, for the camera of the job. Its seconds are without pauses.
    pub(crate) plan: Vec<ForecastPoint>,
    pub(crate) target: f64,
    /// The settings with which the scene was opened.
    pub(crate) settings: Option<RenderSettings>,
    pub(crate) is_vignetted: bool,
    /// The exposure for which the samples are made, if there is one.
    pub(crate) timed: Option<TimedExposure>,
    pub(crate) parts: SceneParts,
    /// Counts the scenes of the thread that renders.
    pub(crate) scene_number: u64,
    pub(crate) change: SceneChange,
    pub(crate) light_films: Option<LightFilms>,
    pub(crate) saved: Vec<String>,
    pub(crate) sensors: Sensors,
    /// The files of the scene, as they were when they were read.
    pub(crate) files: BTreeMap<PathBuf, Stamp>,
    /// The text of the job as it was read; `None` for a scene without a job.
    pub(crate) job: Option<String>,
}

/// The state that all threads share.
pub(crate) struct Shared {
    pub(crate) subject: Subject,
    pub(crate) live: Mutex<Live>,
    pub(crate) control: Mutex<Control>,
    pub(crate) wake: Condvar,
    pub(crate) store: Store,
    /// Held while files are written.
    pub(crate) writes: Mutex<()>,
    /// The threads of exposures and measurements.
    pub(crate) session: Session<'static>,
    /// The threads of analyses that no page waits for.
    pub(crate) background: Session<'static>,
    pub(crate) changed: watch::Sender<u64>,
    pub(crate) began: Instant,
}

impl Shared {
    pub(crate) fn new(subject: Subject, session: Session<'static>, background: Session<'static>) -> Self {
        let render = RenderState { stage: "load".into(), ..RenderState::default() };
        let sensors = Sensors::new(&SensorChoice::None);
        let live = Live { render, target: DEFAULT_TARGET, sensors, ..Live::default() };
        Self {
            subject,
            live: Mutex::new(live),
            control: Mutex::new(Control::default()),
            wake: Condvar::new(),
            store: Store::default(),
            writes: Mutex::new(()),
            session,
            background,
            changed: watch::Sender::new(0),
            began: Instant::now(),
        }
    }

    /// Tells the pages that the state has changed.
    pub(crate) fn notify(&self) {
        self.changed.send_modify(|version| *version += 1);
    }

    /// Changes the state, and tells the pages.
    pub(crate) fn update(&self, change: impl FnOnce(&mut Live)) {
        change(&mut lock(&self.live));
        self.notify();
    }

    /// Changes the requests to the thread that renders, and wakes it. `change` may lock `live`.
    pub(crate) fn control<T>(&self, change: impl FnOnce(&mut Control) -> T) -> T {
        let mut control = lock(&self.control);
        let (had_change, was_paused) = (control.change.is_some(), control.is_paused);
        let result = change(&mut control);
        // A change of nothing begins no render.
        if !had_change && control.change.is_some() {
            let present = control.in_progress.clone().unwrap_or_else(|| lock(&self.live).change.clone());
            if control.change.as_ref() == Some(&present) {
                (control.change, control.is_paused) = (None, was_paused);
            }
        }
        if control.change.is_some() || control.reload || control.quit {
            control.cancel.cancel();
        }
        drop(control);
        self.wake.notify_all();
        result
    }

    /// Wakes the threads that wait for a film or a camera. A thread that has just looked for one gets the signal too,
    /// because it holds the lock until it waits.
    pub(crate) fn wake(&self) {
        drop(lock(&self.control));
        self.wake.notify_all();
    }

    pub(crate) fn snapshot(&self) -> Option<Arc<Snapshot>> {
        lock(&self.live).snapshot.clone()
    }

    /// Shows a picture.
    pub(crate) fn publish(&self, snapshot: Snapshot) -> Arc<Snapshot> {
        let snapshot = Arc::new(snapshot);
        self.update(|live| live.snapshot = Some(snapshot.clone()));
        self.wake();
        snapshot
    }

    /// Is the picture that of a scene before a change that is being made?
    pub(crate) fn is_outdated(&self, snapshot: &Snapshot) -> bool {
        let live = lock(&self.live);
        let is_being_made = matches!(live.render.state, Activity::Loading | Activity::Running);
        is_being_made && live.error.is_none() && snapshot.scene.number != live.scene_number
    }

    /// The change of the scene that waits, or is being made, and whether the scene will be another one: a reload has no change
    /// until it begins. Both are of one moment.
    fn pending(&self) -> (Option<SceneChange>, bool) {
        let control = lock(&self.control);
        let change = control.change.clone().or_else(|| control.in_progress.clone());
        let is_pending = control.reload || change.is_some();
        (change, is_pending)
    }

    /// Is the picture that of the scene before a change or a restart?
    pub(crate) fn is_earlier(&self, snapshot: &Snapshot) -> bool {
        let (_, is_pending) = self.pending();
        is_pending || snapshot.scene.number != lock(&self.live).scene_number
    }

    /// The state of the view.
    pub(crate) fn state(&self) -> State {
        let snapshot = self.snapshot();
        let ((pending, _), is_earlier) =
            (self.pending(), snapshot.as_ref().is_some_and(|shown| self.is_earlier(shown)));
        let live = lock(&self.live);
        let settings = live.settings.as_ref();
        let [width, height] = match (&snapshot, settings) {
            (Some(snapshot), _) => snapshot.size(),
            (None, Some(settings)) => [settings.width, settings.height],
            (None, None) => [0, 0],
        };
        let sensor = |(name, model): &(String, dunkelfeld::sensor::SensorModel)| {
            let spec = model.spec();
            let label = match &name[..] {
                OWN_SENSOR if self.subject.kind == SourceKind::Exr => format!("as opened ({})", spec.name),
                OWN_SENSOR => format!("{OWN_SENSOR} ({})", spec.name),
                _ => name.clone(),
            };
            SensorState {
                name: name.clone(),
                label,
                bits: spec.bit_depth,
                colour: spec.quantum_efficiency.filter().is_some(),
                saturation: model.saturation().0,
                temperature: spec.temperature.0,
                dark_noise: spec.dark_noise.0,
                pixel: spec.pixel_pitch.micrometres(),
            }
        };
        let camera = live.camera().without_noise();
        let statistics = live.statistics.of(&camera);
        let (forecast, forecast_from) = live.forecast(&camera);
        let mut render = live.render.clone();
        if matches!(render.state, Activity::Running | Activity::Paused) {
            let is_reached = statistics.is_some_and(|of| of.is_reached(live.target));
            (render.fraction, render.remaining) =
                progress_at(render.elapsed, seconds_at(&forecast, live.target), is_reached);
        }
        let title = self.subject.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        State {
            version: env!("CARGO_PKG_VERSION"),
            title,
            path: self.subject.path.to_string_lossy().into_owned(),
            source: self.subject.kind,
            width,
            height,
            film: snapshot.as_ref().map(|snapshot| FilmState {
                id: snapshot.id,
                samples: snapshot.samples,
                spp: snapshot.spp(),
                seconds: snapshot.seconds,
                first: snapshot.has_gaps,
                earlier: is_earlier,
            }),
            render,
            error: live.error.clone(),
            notes: live.notes.clone(),
            curve: statistics.map_or_else(Vec::new, |of| of.curve.clone()),
            forecast: within_view(&forecast),
            forecast_from,
            max_spp: MAX_SPP,
            target: live.target,
            certificate: statistics.and_then(|of| of.certificate),
            statistics_of: camera,
            prepared: self.store.prepared(),
            sensors: live.sensors.all().iter().map(sensor).collect(),
            camera: Camera {
                // The picture may still be that before a change of the lens.
                vignetting: snapshot.as_ref().map_or(live.is_vignetted, |snapshot| snapshot.is_vignetted),
                ..live.first_camera()
            },
            ranges: Ranges::KNOBS,
            frame: settings.map_or(0, |settings| settings.frame),
            timed: live.timed.map(|timed| format!("{} for this exposure", timed.reason)),
            lens: live.lens(),
            scene: (self.subject.kind == SourceKind::Render && settings.is_some())
                .then(|| live.scene(pending.as_ref())),
            saved: live.saved.clone(),
        }
    }
}

impl Live {
    /// The camera of the statistics.
    pub(crate) fn camera(&self) -> Camera {
        self.statistics.shown().cloned().unwrap_or_else(|| self.first_camera())
    }

    /// The camera for which a film is to be analysed. `None` if it is.
    pub(crate) fn next_camera(&mut self, film: u64) -> Option<Camera> {
        let first = self.first_camera();
        self.statistics.next(film, || first)
    }

    /// The camera of the job: the start of the knobs.
    pub(crate) fn first_camera(&self) -> Camera {
        let settings = self.settings.as_ref();
        let exposure = match settings.map(|settings| &settings.sensor) {
            Some(SensorChoice::Emva { exposure, .. }) => exposure.map(|exposure| exposure.time().0),
            _ => None,
        };
        Camera {
            sensor: settings.is_some_and(RenderSettings::has_sensor).then(|| OWN_SENSOR.to_owned()),
            exposure,
            gain: 1.0,
            temperature: None,
            black_level: None,
            noise: match settings.map(|settings| settings.exposure_noise) {
                Some(ExposureNoise::Matched) => Noise::Matched,
                _ => Noise::Plain,
            },
            device: settings.map_or(0, |settings| settings.seed),
            denoise: settings.map_or(DenoiseMethod::Off, |settings| settings.denoise.method),
            vignetting: self.is_vignetted,
            f_number: None,
            glare: None,
            lights: None,
        }
    }

    /// The lens of the job, or the one in front of a sensor that it lacks.
    fn lens(&self) -> LensState {
        let settings = self.settings.as_ref();
        let (f_number, glare) = match settings.map(|settings| &settings.sensor) {
            Some(SensorChoice::Emva { optics, .. }) => (optics.f_number(), optics.glare()),
            _ => (DEFAULT_F_NUMBER, 0.0),
        };
        LensState { f_number, glare, fixed: settings.and_then(fixed_f_number) }
    }

    /// The expected noise of a camera without noise, and its origin.
    fn forecast(&self, camera: &Camera) -> (Vec<ForecastPoint>, ForecastSource) {
        if *camera == self.first_camera().without_noise() && !self.plan.is_empty() {
            return (self.plan.clone(), ForecastSource::Plan);
        }
        let measured = |of: &Statistics| from_measured(&of.curve);
        (self.statistics.of(camera).map_or_else(Vec::new, measured), ForecastSource::Points)
    }

    /// The scene with a change that is not made yet, or with that of the picture.
    fn scene(&self, pending: Option<&SceneChange>) -> SceneState {
        // Changes that are kept for other files are not made.
        let (parts, change) = (&self.parts, pending.unwrap_or(&self.change).restricted_to(&self.parts));
        let first = parts.cameras.first().cloned().unwrap_or_default();
        let of_job = self.settings.as_ref().and_then(|settings| settings.camera.clone());
        SceneState {
            cameras: parts.cameras.clone(),
            camera: change.camera.clone().or(of_job).unwrap_or(first),
            lights: (parts.lights.iter())
                .map(|(name, kind, watts)| {
                    let changed = change.lights.get(name);
                    let factor = changed.map_or(1.0, |c| c.factor);
                    LightState {
                        name: name.clone(),
                        kind: kind.clone(),
                        on: changed.is_none_or(|c| c.on),
                        factor,
                        power: format!("{:.3} W", watts * factor),
                        has_power: has_power(kind),
                        has_switch: has_switch(kind),
                    }
                })
                .collect(),
            materials: (parts.materials.iter())
                .map(|base| {
                    let changed = change.materials.get(&base.name).copied().unwrap_or_default();
                    MaterialState {
                        name: base.name.clone(),
                        roughness: changed.roughness.or(base.roughness),
                        metallic: changed.metallic.or(base.metallic),
                        color: changed.color.or(base.color),
                        changed,
                    }
                })
                .collect(),
            effects: (parts.effects.iter())
                .map(|(name, used)| EffectState {
                    name: name.clone(),
                    title: name.replace('-', " "),
                    used: *used,
                    left_out: change.without.iter().any(|effect| effect.name() == name),
                })
                .collect(),
            per_light: PerLight {
                on: change.per_light,
                bytes: self.light_films.as_ref().map_or(0, |films| films.bytes),
                lights: self.light_films.as_ref().map_or(0, |films| films.lights),
            },
        }
    }
}
