//! Results of films that take longer than an answer may: the noise for matched exposure, and denoised means. They are
//! kept, so that other cameras and newer films of the same scene can use them until theirs are ready.

use crate::developed::Developed;
use crate::locks::lock;
use crate::protocol::{Camera, Fault, Readiness};
use crate::snapshot::Snapshot;
use dunkelfeld::DenoiseMethod;
use dunkelfeld::film::MeanImage;
use dunkelfeld::sensor::ImageNoise;
use std::sync::{Arc, Mutex};

/// Results of each kind that are kept: those of two cameras that are compared.
pub(crate) const KEPT: usize = 2;

/// The films that a result belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Origin {
    /// The number of the scene.
    scene: u64,
    /// The number of the picture.
    film: u64,
}

impl Origin {
    fn of(snapshot: &Snapshot) -> Self {
        Self { scene: snapshot.scene.number, film: snapshot.id }
    }
}

/// Denoised means [W/(m² sr)]: that of a picture, or those of its lights.
pub(crate) type Means = Vec<MeanImage>;

/// Results with their films and keys.
type Kept<K, T> = Vec<(Origin, K, Arc<T>)>;

/// A result, and whether it is that of the films and the camera that were asked for.
#[derive(Debug)]
pub(crate) struct Found<T> {
    pub(crate) result: Arc<T>,
    pub(crate) is_exact: bool,
}

impl Readiness {
    pub(crate) fn of<T>(found: Option<&Found<T>>) -> Self {
        match found {
            None => Self::None,
            Some(found) if found.is_exact => Self::Exact,
            Some(_) => Self::Earlier,
        }
    }
}

/// The results that are kept, the newest one last.
#[derive(Debug, Default)]
struct Results {
    noise: Kept<Camera, ImageNoise>,
    /// With the methods that lead to them.
    denoised: Kept<Vec<DenoiseMethod>, Means>,
    /// The last analysis that failed, by the number of its scene and its camera.
    failed: Option<(u64, Camera, Fault)>,
    count: u64,
    /// Pictures behind cameras that use the results, the newest one last.
    pictures: Vec<Arc<Developed>>,
}

/// The results, for all threads.
#[derive(Debug, Default)]
pub(crate) struct Prepared(Mutex<Results>);

impl Prepared {
    /// Counts the results that have been added, and the analyses that failed.
    pub(crate) fn count(&self) -> u64 {
        lock(&self.0).count
    }

    /// Changes the pictures that are kept.
    pub(crate) fn pictures<T>(&self, change: impl FnOnce(&mut Vec<Arc<Developed>>) -> T) -> T {
        change(&mut lock(&self.0).pictures)
    }

    /// The noise of a picture behind a camera, or the newest one of the same scene.
    pub(crate) fn noise(&self, snapshot: &Snapshot, camera: &Camera) -> Option<Found<ImageNoise>> {
        newest(&lock(&self.0).noise, snapshot, |of| *of == camera.without_noise())
    }

    /// The denoised means of a picture, or the newest ones of the same scene and method.
    pub(crate) fn denoised(&self, snapshot: &Snapshot, method: DenoiseMethod) -> Option<Found<Means>> {
        let of_method: Vec<_> =
            lock(&self.0).denoised.iter().filter(|(_, methods, _)| methods.contains(&method)).cloned().collect();
        newest(&of_method, snapshot, |_| true)
    }

    pub(crate) fn add_noise(&self, snapshot: &Snapshot, camera: &Camera, noise: Arc<ImageNoise>) {
        let mut results = lock(&self.0);
        add(&mut results.noise, (Origin::of(snapshot), camera.without_noise(), noise));
        results.count += 1;
    }

    /// The reason why the analysis for a camera failed in the scene of a picture.
    pub(crate) fn failure(&self, snapshot: &Snapshot, camera: &Camera) -> Option<Fault> {
        let results = lock(&self.0);
        let (scene, of, fault) = results.failed.as_ref()?;
        (*scene == snapshot.scene.number && *of == camera.without_device()).then(|| fault.clone())
    }

    /// Keeps the outcome of an analysis: a fault, or that an earlier one is mended.
    pub(crate) fn finish(&self, snapshot: &Snapshot, camera: &Camera, outcome: Result<(), Fault>) {
        let key = (snapshot.scene.number, camera.without_device());
        let mut results = lock(&self.0);
        match outcome {
            Err(fault) => {
                results.failed = Some((key.0, key.1, fault));
                results.count += 1;
            }
            Ok(()) => {
                let other = |(scene, camera, _): &(u64, Camera, Fault)| (*scene, camera) != (key.0, &key.1);
                results.failed = results.failed.take().filter(other);
            }
        }
    }

    /// `methods` are those whose result this is: the one that was asked for, and the one that it has chosen.
    pub(crate) fn add_denoised(&self, snapshot: &Snapshot, methods: Vec<DenoiseMethod>, means: Arc<Means>) {
        let mut results = lock(&self.0);
        add(&mut results.denoised, (Origin::of(snapshot), methods, means));
        results.count += 1;
    }
}

/// The result of this picture with this property, or the newest one of its scene: one with this property if there is one.
fn newest<K, T>(kept: &[(Origin, K, Arc<T>)], snapshot: &Snapshot, is_wanted: impl Fn(&K) -> bool) -> Option<Found<T>> {
    let origin = Origin::of(snapshot);
    let of_scene = || kept.iter().rev().filter(|(of, ..)| of.scene == origin.scene);
    let (of, key, result) = of_scene().find(|(_, key, _)| is_wanted(key)).or_else(|| of_scene().next())?;
    Some(Found { result: result.clone(), is_exact: *of == origin && is_wanted(key) })
}

/// Adds a result. It replaces an earlier one with the same key, those of other scenes, and the oldest one of many.
fn add<K: PartialEq, T>(kept: &mut Kept<K, T>, new: (Origin, K, Arc<T>)) {
    // A result of an earlier scene comes too late.
    if kept.iter().any(|(of, ..)| of.scene > new.0.scene) {
        return;
    }
    kept.retain(|(of, key, _)| of.scene == new.0.scene && *key != new.1);
    if kept.len() >= KEPT {
        kept.remove(0);
    }
    kept.push(new);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::Noise;
    use crate::snapshot::{Content, PictureScene};
    use dunkelfeld::film::Film;
    use dunkelfeld::{ExposeSettings, Exposer, RenderedFilm, find_sensor};

    fn picture(scene: u64, film: u64) -> Snapshot {
        let content = Content::Film(RenderedFilm::without_ids(Film::new(2, 1)));
        let scene = Arc::new(PictureScene { number: scene, ..PictureScene::default() });
        Snapshot::new(film, content, (dunkelfeld::default_settings(), false), scene, 0.0, None)
    }

    fn means(value: f32) -> Arc<Means> {
        Arc::new(vec![dunkelfeld::film::Plane::new(2, 1, [value; 3]).into()])
    }

    fn first(found: Option<Found<Means>>) -> Option<(f32, bool)> {
        found.map(|found| (found.result[0].radiance.at(0, 0)[0], found.is_exact))
    }

    /// The result of a picture is exact for this picture alone, serves later ones of its scene, and no other scene.
    #[test]
    fn a_result_serves_the_pictures_of_its_scene() {
        let prepared = Prepared::default();
        assert_eq!(first(prepared.denoised(&picture(1, 1), DenoiseMethod::Auto)), None);
        prepared.add_denoised(&picture(1, 1), vec![DenoiseMethod::Auto, DenoiseMethod::Builtin], means(1.0));
        assert_eq!(first(prepared.denoised(&picture(1, 1), DenoiseMethod::Auto)), Some((1.0, true)));
        assert_eq!(first(prepared.denoised(&picture(1, 2), DenoiseMethod::Builtin)), Some((1.0, false)));
        assert_eq!(first(prepared.denoised(&picture(1, 1), DenoiseMethod::Oidn)), None);
        assert_eq!(first(prepared.denoised(&picture(2, 3), DenoiseMethod::Auto)), None);
        prepared.add_denoised(&picture(1, 2), vec![DenoiseMethod::Auto, DenoiseMethod::Builtin], means(2.0));
        assert_eq!(first(prepared.denoised(&picture(1, 2), DenoiseMethod::Auto)), Some((2.0, true)));
        assert_eq!(prepared.count(), 2);
        // Another scene ends those before.
        prepared.add_denoised(&picture(2, 3), vec![DenoiseMethod::Oidn], means(3.0));
        assert_eq!(first(prepared.denoised(&picture(1, 2), DenoiseMethod::Auto)), None);
        prepared.add_denoised(&picture(1, 2), vec![DenoiseMethod::Auto], means(4.0));
        assert_eq!(first(prepared.denoised(&picture(1, 2), DenoiseMethod::Auto)), None);
        assert_eq!(first(prepared.denoised(&picture(2, 3), DenoiseMethod::Oidn)), Some((3.0, true)));
    }

    /// The noise of the asked camera is preferred to a newer one of another camera. Seeds and the noise that is drawn make
    /// no other camera.
    #[test]
    fn the_noise_of_a_camera_is_preferred() {
        let film = |exposure: f64, device: u64, noise: Noise| Camera {
            exposure: Some(exposure),
            noise,
            device,
            ..Camera::plain(None)
        };
        let empty = RenderedFilm::without_ids(Film::new(2, 1));
        let sensor = ExposeSettings::new(find_sensor("imx250").expect("a preset")).expect("a sensor");
        let noise = || Arc::new(Exposer::of_film(&empty, &sensor).expect("a camera").image_noise(&empty));
        let prepared = Prepared::default();
        let (one, two) = (noise(), noise());
        prepared.add_noise(&picture(1, 1), &film(1.0, 0, Noise::Matched), one.clone());
        prepared.add_noise(&picture(1, 1), &film(2.0, 0, Noise::Matched), two.clone());
        let found = |exposure: f64, film_number: u64| {
            let found = prepared.noise(&picture(1, film_number), &film(exposure, 7, Noise::None)).expect("a result");
            (Arc::ptr_eq(&found.result, &one), Arc::ptr_eq(&found.result, &two), found.is_exact)
        };
        assert_eq!(found(1.0, 1), (true, false, true));
        assert_eq!(found(2.0, 1), (false, true, true));
        assert_eq!(found(1.0, 2), (true, false, false));
        assert_eq!(found(3.0, 1), (false, true, false));
        // A third camera replaces the oldest one.
        prepared.add_noise(&picture(1, 1), &film(3.0, 0, Noise::Matched), noise());
        assert_eq!(found(1.0, 1), (false, false, false));
    }
}
