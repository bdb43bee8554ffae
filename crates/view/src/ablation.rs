//! The influence of an effect: the image against one that the effect is left out of.

use crate::developed::Developed;
use crate::panics::caught;
use crate::protocol::{AblationAnswer, Camera, Fault};
use crate::shared::{Shared, lock};
use crate::snapshot::{Content, Snapshot};
use dunkelfeld::film::FilmLayers;
use dunkelfeld::scene::Effect;
use dunkelfeld::{Budget, Cancel, Error, KeptFilms, Progress, ProgressState, Project, ProjectOptions};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::{Duration, Instant};

/// The most samples per pixel of the image without the effect.
const MAX_SPP: f64 = 64.0;
/// A mean difference of so many standard deviations is significant. The probability of a false alarm is 6e-7.
const SIGNIFICANT: f64 = 5.0;

/// Comparisons that are kept.
const KEPT: usize = 8;
/// A comparison that no page has asked about for so long ends when another one waits.
const PATIENCE: Duration = Duration::from_secs(5);

/// A comparison that waits, runs or has ended.
#[derive(Debug)]
pub(crate) struct Ablation {
    effect: Effect,
    /// The camera with which the images are compared, and the number of the scene.
    camera: Camera,
    scene: u64,
    /// The image with the effect, until the comparison begins.
    with: Mutex<Option<Arc<Developed>>>,
    /// When a page asked about it last.
    asked: Mutex<Instant>,
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

/// The comparisons of a view. One runs at a time, in the order of their requests.
#[derive(Debug, Default)]
pub(crate) struct Ablations {
    list: Vec<Arc<Ablation>>,
    /// Is there a thread that works on the list?
    is_busy: bool,
}

impl Ablation {
    /// The difference of each pixel \[DN\], if the comparison has ended.
    pub(crate) fn difference(&self) -> Option<&[f32]> {
        self.result.get().and_then(|result| result.as_ref().ok()).map(|comparison| &comparison.difference[..])
    }

    fn is_waiting(&self) -> bool {
        self.result.get().is_none() && lock(&self.with).is_some()
    }

    fn is_abandoned(&self) -> bool {
        lock(&self.asked).elapsed() > PATIENCE
    }

    fn answer(&self) -> Result<AblationAnswer, Fault> {
        match self.result.get() {
            None if self.is_waiting() => Ok(AblationAnswer::Waiting),
            None => Ok(AblationAnswer::Running { fraction: f64::from(self.progress.load(Ordering::Relaxed)) / 1e3 }),
            Some(Ok(comparison)) => Ok(comparison.answer),
            Some(Err(fault)) => Err(fault.clone()),
        }
    }
}

impl Ablations {
    /// Drops the comparisons of other scenes, and ends those that run.
    pub(crate) fn keep_only(&mut self, scene: u64) {
        self.list.iter().filter(|ablation| ablation.scene != scene).for_each(|ablation| ablation.cancel.cancel());
        self.list.retain(|ablation| ablation.scene == scene);
    }

    /// The comparison of an effect that has ended, for the image of a scene behind a camera; without an effect the newest one.
    pub(crate) fn difference(&self, scene: u64, camera: &Camera, effect: Option<&str>) -> Option<Arc<Ablation>> {
        let camera = camera.without_noise();
        let is_it = |ablation: &&Arc<Ablation>| {
            ablation.scene == scene
                && ablation.camera == camera
                && effect.is_none_or(|effect| ablation.effect.name() == effect)
                && ablation.difference().is_some()
        };
        self.list.iter().rev().find(is_it).cloned()
    }

    fn find(&self, effect: Effect, with: &Developed) -> Option<Arc<Ablation>> {
        let (camera, scene) = (with.camera(), with.snapshot.scene.number);
        let is_it = |a: &&Arc<Ablation>| {
            a.effect == effect && a.scene == scene && a.camera == *camera && !a.cancel.is_cancelled()
        };
        self.list.iter().find(is_it).cloned()
    }

    /// The comparison of an effect with this image: that of the list, or a new one at its end.
    fn find_or_add(&mut self, effect: Effect, with: &Arc<Developed>) -> Arc<Ablation> {
        if let Some(found) = self.find(effect, with) {
            *lock(&found.asked) = Instant::now();
            if found.is_waiting() {
                // Its turn comes sooner if nobody wants the one before.
                let is_free = |a: &&Arc<Ablation>| !a.is_waiting() && a.result.get().is_none() && a.is_abandoned();
                self.list.iter().filter(is_free).for_each(|a| a.cancel.cancel());
            }
            return found;
        }
        if self.list.len() >= KEPT
            && let Some(oldest) = self.list.iter().position(|a| a.result.get().is_some())
        {
            self.list.remove(oldest);
        }
        let ablation = Arc::new(Ablation {
            effect,
            camera: with.camera().clone(),
            scene: with.snapshot.scene.number,
            with: Mutex::new(Some(with.clone())),
            asked: Mutex::new(Instant::now()),
            progress: AtomicU32::new(0),
            cancel: Cancel::new(),
            result: OnceLock::new(),
        });
        self.list.push(ablation.clone());
        ablation
    }

    fn forget(&mut self, ablation: &Arc<Ablation>) {
        self.list.retain(|a| !Arc::ptr_eq(a, ablation));
    }

    /// The next one that waits, with its image. One that nobody wants any more is dropped.
    fn next(&mut self) -> Option<(Arc<Ablation>, Arc<Developed>)> {
        self.list.retain(|a| !(a.is_waiting() && a.is_abandoned()));
        let next = self.list.iter().find(|a| a.is_waiting())?.clone();
        let with = lock(&next.with).take()?;
        Some((next, with))
    }
}

impl Progress for Ablation {
    fn update(&self, state: &ProgressState) {
        self.progress.store((1000.0 * state.fraction) as u32, Ordering::Relaxed);
    }
}

/// Starts a comparison, or reports the one of this effect, camera and scene.
pub(crate) fn ask(shared: &Arc<Shared>, effect: &str, with: &Arc<Developed>) -> Result<AblationAnswer, Fault> {
    let unknown = || Fault::new(format!("{effect:?} is no effect"), "choose an effect of the list");
    let effect = Effect::ALL.into_iter().find(|e| e.name() == effect).ok_or_else(unknown)?;
    let scene = lock(&shared.live).scene_number;
    if with.snapshot.scene.number != scene || lock(&shared.control).change.is_some() {
        return Err(Fault::earlier_scene());
    }
    let mut ablations = lock(&shared.ablations);
    ablations.keep_only(scene);
    let ablation = ablations.find_or_add(effect, with);
    let answer = ablation.answer();
    if answer.is_err() {
        // The next request begins it again.
        ablations.forget(&ablation);
        return answer;
    }
    if !ablations.is_busy && ablation.is_waiting() {
        let state = shared.clone();
        let started = std::thread::Builder::new().name("ablation".into()).spawn(move || work(&state));
        if let Err(e) = started {
            ablations.forget(&ablation);
            return Err(Error::Threads(e.to_string()).into());
        }
        ablations.is_busy = true;
    }
    answer
}

/// Makes the comparisons of the list one after the other.
fn work(shared: &Arc<Shared>) {
    loop {
        let (ablation, with) = {
            let mut ablations = lock(&shared.ablations);
            match ablations.next() {
                Some(next) => next,
                None => {
                    ablations.is_busy = false;
                    return;
                }
            }
        };
        let made = caught("the comparison", "compute it again", || compare(shared, ablation.effect, &with, &ablation));
        let _ = ablation.result.set(made.and_then(|result| result));
        shared.notify();
    }
}

fn compare(shared: &Arc<Shared>, effect: Effect, with: &Developed, ablation: &Ablation) -> Result<Comparison, Fault> {
    let scene = with.snapshot.scene.clone();
    // One film is enough, as the factors of the lights do not change.
    let change = scene.change.with_factors(&scene.parts, with.camera().lights.as_ref())?;
    let mut without = change.without.clone();
    without.push(effect);
    let mut project = Project::open_with(&shared.subject.path, ProjectOptions::default().with_without(without))?;
    let text =
        toml::to_string(&change.overrides(&scene.parts)).map_err(|e| Fault::new(e.to_string(), "reload the page"))?;
    project.set_overrides(&text)?;
    project.settings.camera = change.camera.clone().or(project.settings.camera.take());
    project.settings.budget = Budget::default().with_spp(with.snapshot.spp().clamp(1.0, MAX_SPP));
    project.settings.layers = FilmLayers::All;
    let (rendering, settings, is_vignetted) =
        project.render_film_beside(shared.subject.nice, KeptFilms::default(), ablation, &ablation.cancel)?;
    if ablation.cancel.is_cancelled() || lock(&shared.control).quit {
        return Err(Fault::new("the comparison was ended, for another one or another scene", "compute it again"));
    }
    let content = Content::Film(rendering.film);
    let snapshot = Snapshot::new(0, content, (settings, is_vignetted), scene, 0.0, None);
    let without = with.at_exposure_of(Arc::new(snapshot), &shared.session)?;
    with.certify(&shared.background);
    without.certify(&shared.background);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::AblationAnswer;
    use crate::snapshot::PictureScene;
    use dunkelfeld::film::Film;
    use dunkelfeld::{RenderSettings, RenderedFilm, Session};

    fn camera(exposure: f64) -> Camera {
        Camera { exposure: Some(exposure), ..Camera::plain(None) }
    }

    fn image(scene: u64, exposure: f64) -> Arc<Developed> {
        let content = Content::Film(RenderedFilm::without_ids(Film::new(2, 1)));
        let scene = Arc::new(PictureScene { number: scene, ..PictureScene::default() });
        let snapshot = Arc::new(Snapshot::new(1, content, (RenderSettings::default(), false), scene, 0.0, None));
        let store = crate::store::Store::default();
        store.get(&snapshot, &camera(exposure), &Session::new(1).expect("a thread")).expect("no sensor")
    }

    fn finish(ablation: &Ablation, mean: f64) {
        let answer = AblationAnswer::Finished { mean, largest: mean, sigma: 1.0, significant: false };
        ablation.result.set(Ok(Comparison { answer, difference: vec![mean as f32; 2] })).expect("once");
    }

    /// Two pages with two cameras: neither ends the comparison of the other, and each gets its own difference.
    #[test]
    fn comparisons_of_two_cameras_do_not_disturb_each_other() {
        let mut ablations = Ablations::default();
        let (a, b) = (image(1, 1e-3), image(1, 2e-3));
        let effect = Effect::ALL[0];
        let first = ablations.find_or_add(effect, &a);
        let second = ablations.find_or_add(effect, &b);
        let (running, _) = ablations.next().expect("one waits");
        assert!(Arc::ptr_eq(&running, &first));
        assert_eq!(first.answer(), Ok(AblationAnswer::Running { fraction: 0.0 }));
        for _ in 0..3 {
            assert!(Arc::ptr_eq(&ablations.find_or_add(effect, &b), &second));
            assert!(Arc::ptr_eq(&ablations.find_or_add(effect, &a), &first));
        }
        assert_eq!(second.answer(), Ok(AblationAnswer::Waiting));
        assert!(!first.cancel.is_cancelled());
        finish(&first, 1.0);
        let (running, _) = ablations.next().expect("the other waits");
        assert!(Arc::ptr_eq(&running, &second));
        finish(&second, 2.0);
        assert!(ablations.next().is_none());
        let difference = |ablations: &Ablations, scene, exposure, effect| {
            let found = ablations.difference(scene, &camera(exposure), effect)?;
            found.difference().map(|difference| difference[0])
        };
        assert_eq!(difference(&ablations, 1, 1e-3, Some(effect.name())), Some(1.0));
        assert_eq!(difference(&ablations, 1, 2e-3, None), Some(2.0));
        assert_eq!(difference(&ablations, 1, 2e-3, Some(Effect::ALL[1].name())), None);
        assert_eq!(difference(&ablations, 1, 3e-3, None), None);
        // Another scene has none of them.
        assert_eq!(difference(&ablations, 2, 1e-3, None), None);
        let third = ablations.find_or_add(Effect::ALL[1], &a);
        ablations.keep_only(2);
        assert!(ablations.list.is_empty() && third.cancel.is_cancelled());
    }

    /// A page that was closed does not keep another one waiting.
    #[test]
    fn a_comparison_that_nobody_asks_about_gives_way() {
        let mut ablations = Ablations::default();
        let (a, b) = (image(1, 1e-3), image(1, 2e-3));
        let first = ablations.find_or_add(Effect::ALL[0], &a);
        ablations.next().expect("one waits");
        let Some(earlier) = Instant::now().checked_sub(2 * PATIENCE) else { return };
        *lock(&first.asked) = earlier;
        let second = ablations.find_or_add(Effect::ALL[0], &b);
        assert!(!first.cancel.is_cancelled(), "it is finished unless another one waits for it");
        ablations.find_or_add(Effect::ALL[0], &b);
        assert!(first.cancel.is_cancelled());
        // One that waits and that nobody wants is not begun.
        *lock(&second.asked) = earlier;
        assert!(ablations.next().is_none());
    }
}
