//! The influence of an effect: the image against one that the effect is left out of.

use crate::developed::Developed;
use crate::protocol::{AblationAnswer, Camera, Fault};
use crate::shared::{Shared, lock};
use crate::snapshot::{Content, Snapshot};
use dunkelfeld::film::FilmLayers;
use dunkelfeld::scene::Effect;
use dunkelfeld::{Budget, Cancel, Error, Progress, ProgressState, Project, ProjectOptions};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};

/// The most samples per pixel of the image without the effect.
const MAX_SPP: f64 = 64.0;
/// A mean difference of so many standard deviations is significant. The probability of a false alarm is 6e-7.
const SIGNIFICANT: f64 = 5.0;

/// A comparison that runs or has ended.
#[derive(Debug)]
pub(crate) struct Ablation {
    effect: String,
    /// The camera with which the images are compared, and the render.
    camera: Camera,
    restarted: u32,
    /// Progress in thousandths.
    progress: AtomicU32,
    cancel: Cancel,
    result: OnceLock<Result<Comparison, Fault>>,
}

#[derive(Debug)]
struct Comparison {
    answer: AblationAnswer,
    /// The difference of each pixel \[DN\], without the effect less with it.
    difference: Vec<f32>,
}

impl Ablation {
    /// The difference of each pixel \[DN\], if the comparison has ended.
    pub(crate) fn difference(&self) -> Option<&[f32]> {
        self.result.get().and_then(|result| result.as_ref().ok()).map(|comparison| &comparison.difference[..])
    }
}

impl Progress for Ablation {
    fn update(&self, state: &ProgressState) {
        self.progress.store((1000.0 * state.fraction) as u32, Ordering::Relaxed);
    }
}

/// Starts a comparison, or reports the one of this effect.
pub(crate) fn ask(shared: &Arc<Shared>, effect: &str, with: Arc<Developed>) -> Result<AblationAnswer, Fault> {
    let unknown = || Fault::new(format!("{effect:?} is no effect"), "choose an effect of the list");
    let found = Effect::ALL.into_iter().find(|e| e.name() == effect).ok_or_else(unknown)?;
    let restarted = lock(&shared.live).render.restarted;
    if with.snapshot.restarted != restarted || lock(&shared.control).change.is_some() {
        return Err(Fault::new("the picture is that of the scene before its change", "wait for the next picture"));
    }
    let mut slot = lock(&shared.ablation);
    if let Some(ablation) =
        slot.as_ref().filter(|a| a.effect == effect && a.restarted == restarted && a.camera == *with.camera())
    {
        return match ablation.result.get() {
            None => {
                Ok(AblationAnswer::Running { fraction: f64::from(ablation.progress.load(Ordering::Relaxed)) / 1e3 })
            }
            Some(Ok(comparison)) => Ok(comparison.answer),
            Some(Err(fault)) => {
                let fault = fault.clone();
                *slot = None;
                Err(fault)
            }
        };
    }
    if let Some(earlier) = slot.take() {
        earlier.cancel.cancel();
    }
    let ablation = Arc::new(Ablation {
        effect: effect.to_owned(),
        camera: with.camera().clone(),
        restarted,
        progress: AtomicU32::new(0),
        cancel: Cancel::new(),
        result: OnceLock::new(),
    });
    *slot = Some(ablation.clone());
    drop(slot);
    let shared = shared.clone();
    let run = move || {
        let result = compare(&shared, found, &with, &ablation);
        let _ = ablation.result.set(result);
        shared.notify();
    };
    std::thread::Builder::new().name("ablation".into()).spawn(run).map_err(|e| Error::Threads(e.to_string()))?;
    Ok(AblationAnswer::Running { fraction: 0.0 })
}

fn compare(shared: &Arc<Shared>, effect: Effect, with: &Developed, ablation: &Ablation) -> Result<Comparison, Fault> {
    let (change, parts, sensors) = {
        let live = lock(&shared.live);
        (live.change.clone(), live.parts.clone(), live.sensors.clone())
    };
    // One film is enough, as the factors of the lights do not change.
    let change = change.with_factors(&parts, with.camera().lights.as_ref())?;
    let mut without = change.without.clone();
    without.push(effect);
    let mut project = Project::open_with(&shared.subject.path, ProjectOptions::default().with_without(without))?;
    let text = toml::to_string(&change.overrides(&parts)).map_err(|e| Fault::new(e.to_string(), "reload the page"))?;
    project.set_overrides(&text)?;
    project.settings.camera = change.camera.clone().or(project.settings.camera.take());
    project.settings.budget = Budget::default().with_spp(with.snapshot.spp().clamp(1.0, MAX_SPP));
    project.settings.layers = FilmLayers::All;
    let (rendering, settings, is_vignetted) = project.render_film(ablation, &ablation.cancel)?;
    if ablation.cancel.is_cancelled() || lock(&shared.control).quit {
        return Err(Fault::new("another comparison has begun", "ask again"));
    }
    let snapshot = Snapshot::new(0, Content::Film(rendering.film), (settings, is_vignetted), 0.0, None);
    let without = with.at_exposure_of(Arc::new(snapshot), &sensors, &shared.session)?;
    with.certify(&shared.session);
    without.certify(&shared.session);
    difference(with, &without)
}

/// The difference of two images of one camera, and its standard deviation by the noise of the renders.
fn difference(with: &Developed, without: &Developed) -> Result<Comparison, Fault> {
    let no_sensor = || Fault::new("there is no sensor, so there are no grey values", "choose a sensor");
    let (a, b) = (with.exposer.as_ref().ok_or_else(no_sensor)?, without.exposer.as_ref().ok_or_else(no_sensor)?);
    let pixels = a.electrons().data().iter().zip(b.electrons().data());
    let difference: Vec<f32> =
        pixels.map(|(&a_e, &b_e)| (Developed::expected(b, b_e) - Developed::expected(a, a_e)) as f32).collect();
    let n = difference.len().max(1) as f64;
    let mean = difference.iter().map(|&d| f64::from(d)).sum::<f64>() / n;
    let largest = difference.iter().map(|&d| f64::from(d)).fold(0.0, |m: f64, d| if d.abs() > m.abs() { d } else { m });
    let variance = |developed: &Developed| -> Option<f64> {
        let (exposer, certified) = (developed.exposer.as_ref()?, developed.certified()?);
        let pixels = exposer.electrons().data().iter().zip(certified.ratios.data());
        Some(pixels.map(|(&e, &ratio)| f64::from(ratio) * Developed::camera_sigma(exposer, e).powi(2)).sum())
    };
    let sum = variance(with).zip(variance(without)).map_or(f64::INFINITY, |(a, b)| a + b);
    let sigma = sum.sqrt() / n;
    if !sigma.is_finite() {
        let problem = "the noise of a pixel is unknown, so that a difference cannot be judged";
        return Err(Fault::new(problem, "wait for more samples"));
    }
    let significant = mean.abs() > SIGNIFICANT * sigma;
    Ok(Comparison { answer: AblationAnswer::Finished { mean, largest, sigma, significant }, difference })
}
