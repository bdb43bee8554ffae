//! The films behind cameras that pages have asked for last.

use crate::developed::{Accept, Developed};
use crate::prepared::Prepared;
use crate::protocol::{Camera, Fault, Readiness};
use crate::snapshot::Snapshot;
use dunkelfeld::{DenoiseMethod, Session};
use std::sync::Arc;

/// Films behind cameras that are kept: two states that are compared, and one that changes.
pub(crate) const KEPT: usize = 4;

/// The last films behind cameras, and the results that they use.
#[derive(Debug, Default)]
pub(crate) struct Store {
    prepared: Prepared,
}

impl Store {
    /// The film behind a camera, computed on the threads of the session if it is not stored. Noise and denoised mean may be
    /// those of an earlier film or another camera, or missing.
    pub(crate) fn get(
        &self,
        snapshot: &Arc<Snapshot>,
        camera: &Camera,
        session: &Session<'_>,
    ) -> Result<Arc<Developed>, Fault> {
        self.find(snapshot, camera, Accept::Provisional, session)
    }

    /// The film behind a camera, with its own noise and denoised mean if `accept` asks for them.
    pub(crate) fn find(
        &self,
        snapshot: &Arc<Snapshot>,
        camera: &Camera,
        accept: Accept,
        session: &Session<'_>,
    ) -> Result<Arc<Developed>, Fault> {
        let is_it = |d: &Arc<Developed>| d.snapshot.id == snapshot.id && d.camera() == camera;
        let count = self.prepared.count();
        let is_usable = |d: &Developed| d.is_exact() || (accept == Accept::Provisional && d.prepared() == count);
        let found = self.prepared.pictures(|kept| {
            // Films of an earlier moment are not shown again, except in a comparison, which asks for the present one.
            kept.retain(|d| d.snapshot.id == snapshot.id && (!is_it(d) || is_usable(d)));
            let found = kept.remove(kept.iter().position(is_it)?);
            kept.push(found.clone());
            Some(found)
        });
        if let Some(found) = found {
            return Ok(found);
        }
        snapshot.find_mean(session);
        if camera.lights.is_some() {
            snapshot.find_means_of_lights(session);
        }
        let prepared = (&self.prepared, accept);
        let made = Arc::new(session.install(|| Developed::new(snapshot.clone(), camera, prepared, session))?);
        self.prepared.pictures(|kept| {
            if kept.len() >= KEPT {
                kept.remove(0);
            }
            kept.push(made.clone());
        });
        Ok(made)
    }

    /// Counts the results that films behind cameras use.
    pub(crate) fn prepared(&self) -> u64 {
        self.prepared.count()
    }

    /// Keeps the outcome of an analysis for a camera.
    pub(crate) fn finish(&self, snapshot: &Snapshot, camera: &Camera, outcome: Result<(), Fault>) {
        self.prepared.finish(snapshot, camera, outcome);
    }

    /// Is there noise for matched exposure with this camera?
    pub(crate) fn noise(&self, snapshot: &Snapshot, camera: &Camera) -> Readiness {
        Readiness::of(self.prepared.noise(snapshot, camera).as_ref())
    }

    /// Is there a denoised mean?
    pub(crate) fn denoised(&self, snapshot: &Snapshot, method: DenoiseMethod) -> Readiness {
        Readiness::of(self.prepared.denoised(snapshot, method).as_ref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::developed::{OWN_SENSOR, Sensors};
    use crate::protocol::Noise;
    use crate::snapshot::{Content, PictureScene};
    use dunkelfeld::film::{Accumulate, Film, PixelSums, Sample};
    use dunkelfeld::radiometry::Rgb;
    use dunkelfeld::{ExposeSettings, RenderedFilm, SensorChoice, find_sensor};

    const SIZE: [u32; 2] = [64, 48];

    /// A picture whose samples in each pixel are 0.5 to 1.5 times its mean, with so many of them.
    fn picture(id: u64, samples: u32) -> Arc<Snapshot> {
        let mut sums = vec![PixelSums::default(); (SIZE[0] * SIZE[1]) as usize];
        for (pixel, sums) in sums.iter_mut().enumerate() {
            for index in 0..samples {
                let random = ((pixel as u32 * 7919 + index * 104_729) % 1009) as f32 / 1008.0;
                sums.add(index, &Sample { radiance: Rgb::splat(20.0 * (0.5 + random)), ..Sample::MISS });
            }
        }
        let mut film = Film::new(SIZE[0], SIZE[1]);
        film.add_rows(0, &sums).expect("memory");
        let model = find_sensor("imx250").expect("a preset");
        let optics = ExposeSettings::new(model.clone()).expect("a sensor").optics;
        let sensor = SensorChoice::Emva { model: Box::new(model), optics, exposure: None };
        let mut settings = dunkelfeld::default_settings();
        (settings.width, settings.height, settings.sensor) = (SIZE[0], SIZE[1], sensor);
        let scene = PictureScene { sensors: Sensors::new(&settings.sensor), ..PictureScene::default() };
        let content = Content::Film(RenderedFilm::without_ids(film));
        Arc::new(Snapshot::new(id, content, (settings, false), Arc::new(scene), 0.0, None))
    }

    fn camera(exposure: f64, device: u64) -> Camera {
        let plain = Camera::plain(Some(OWN_SENSOR));
        Camera { exposure: Some(exposure), noise: Noise::Matched, device, ..plain }
    }

    /// The analysis of a camera serves its other devices exactly, and newer films and other exposures until theirs is there.
    #[test]
    fn matched_noise_does_not_wait_for_a_new_analysis() {
        let (store, session) = (Store::default(), Session::new(1).expect("a thread"));
        let (first, second) = (picture(1, 64), picture(2, 128));
        let get = |picture: &Arc<Snapshot>, camera: &Camera| store.get(picture, camera, &session).expect("a frame");
        let exact = |picture: &Arc<Snapshot>, camera: &Camera| {
            store.find(picture, camera, Accept::Exact, &session).expect("a frame")
        };
        let frame = |developed: &Developed| developed.values(0).expect("a frame").expect("grey values");
        // There is no analysis to use: the noise is plain, and no answer waits.
        let plain = get(&first, &Camera { noise: Noise::Plain, ..camera(1e-3, 0) });
        let missing = get(&first, &camera(1e-3, 0));
        assert_eq!((plain.readiness(), missing.readiness()), (Readiness::Exact, Readiness::None));
        assert_eq!(frame(&missing), frame(&plain));
        assert!(exact(&first, &camera(1e-3, 0)).is_exact());
        assert_eq!(store.prepared(), 1);
        assert!(get(&first, &camera(1e-3, 5)).is_exact());
        assert_eq!(store.prepared(), 1);
        for (picture, camera) in [(&first, camera(2e-3, 0)), (&second, camera(1e-3, 0))] {
            let provisional = get(picture, &camera);
            assert_eq!(provisional.readiness(), Readiness::Earlier);
            let before = store.prepared();
            assert!(Arc::ptr_eq(&provisional, &get(picture, &camera)));
            let wanted = exact(picture, &camera);
            assert!(wanted.is_exact() && store.prepared() == before + 1);
            // The picture is replaced by the exact one.
            assert!(Arc::ptr_eq(&wanted, &get(picture, &camera)));
            // The variances of all pixels are equal, and are converted by the exposure and the number of samples. So most
            // grey values are the same: the fluctuation of the estimate moves the others by one.
            let pairs = || frame(&provisional).data().to_vec().into_iter().zip(frame(&wanted).data().to_vec());
            let differ = pairs().filter(|(a, b)| a != b).count();
            assert!(pairs().all(|(a, b)| a.abs_diff(b) <= 3), "{differ}");
        }
    }

    /// A page that waits for an analysis gets the reason why there is none.
    #[test]
    fn a_failed_analysis_is_the_answer() {
        let (store, session) = (Store::default(), Session::new(1).expect("a thread"));
        let (first, second) = (picture(1, 16), picture(2, 32));
        let get = |picture, camera: &Camera| store.get(picture, camera, &session).map(|d| d.readiness());
        let fault = Fault::new("no memory", "use fewer pixels");
        assert_eq!(get(&first, &camera(1e-3, 0)), Ok(Readiness::None));
        store.finish(&first, &camera(1e-3, 0), Err(fault.clone()));
        assert_eq!(store.prepared(), 1);
        // Of all devices and films of the scene, and of no other camera.
        assert_eq!(get(&first, &camera(1e-3, 3)), Err(fault.clone()));
        assert_eq!(get(&second, &camera(1e-3, 0)), Err(fault));
        assert_eq!(get(&second, &camera(2e-3, 0)), Ok(Readiness::None));
        assert_eq!(get(&second, &Camera { noise: Noise::Plain, ..camera(1e-3, 0) }), Ok(Readiness::Exact));
        store.finish(&second, &camera(2e-3, 0), Ok(()));
        assert!(get(&second, &camera(1e-3, 0)).is_err());
        store.finish(&second, &camera(1e-3, 0), Ok(()));
        assert_eq!(get(&second, &camera(1e-3, 0)), Ok(Readiness::None));
    }

    #[test]
    fn a_denoised_mean_serves_newer_pictures() {
        let (store, session) = (Store::default(), Session::new(1).expect("a thread"));
        let (first, second) = (picture(1, 16), picture(2, 32));
        let denoised = Camera { denoise: DenoiseMethod::Builtin, noise: Noise::Plain, ..camera(1e-3, 0) };
        let get = |picture, camera: &Camera| store.get(picture, camera, &session).expect("a frame");
        let missing = get(&first, &denoised);
        assert_eq!(missing.readiness(), Readiness::None);
        let one = store.find(&first, &denoised, Accept::Exact, &session).expect("a frame");
        assert!(one.is_exact());
        // Other cameras of the picture, and those of the next one.
        assert!(get(&first, &Camera { exposure: Some(5e-3), ..denoised.clone() }).is_exact());
        let provisional = get(&second, &denoised);
        assert_eq!(provisional.readiness(), Readiness::Earlier);
        let electrons = |developed: &Developed| developed.exposer.as_ref().expect("a sensor").electrons().clone();
        assert_eq!(electrons(&provisional), electrons(&one));
        assert_ne!(electrons(&missing), electrons(&one));
        let exact = store.find(&second, &denoised, Accept::Exact, &session).expect("a frame");
        assert!(exact.is_exact() && electrons(&exact) != electrons(&one));
    }
}
