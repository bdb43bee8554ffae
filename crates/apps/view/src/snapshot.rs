//! The film at some moment of a render.

use crate::developed::Sensors;
use crate::protocol::Fault;
use crate::scene_change::{SceneChange, SceneParts};
use dunkelfeld::film::mean_image;
use dunkelfeld::film::{MeanImage, Plane};
use dunkelfeld::light_layers::sum_of_means;
use dunkelfeld::outputs::ExrImage;
use dunkelfeld::scene::RayGenerator;
use dunkelfeld::sensor::TimedExposure;
use dunkelfeld::{RenderSettings, RenderedFilm, Session};
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

/// The largest factor of a light.
const MAX_FACTOR: f64 = 1e6;

/// The origin of the pixels of a snapshot.
#[derive(Debug)]
pub(crate) enum Content {
    Film(RenderedFilm),
    /// An EXR of any renderer.
    Exr(Box<ExrImage>),
}

/// The scene of a picture. Answers about a picture are of its scene, which may be older than the newest one.
#[derive(Clone, Debug, Default)]
pub(crate) struct PictureScene {
    /// Counts the scenes of the thread that renders.
    pub(crate) number: u64,
    pub(crate) change: SceneChange,
    pub(crate) parts: SceneParts,
    /// The text of the job as it was read; `None` for a scene without a job.
    pub(crate) job: Option<String>,
    pub(crate) sensors: Sensors,
    /// The exposure for which its samples are made, if there is one.
    pub(crate) timed: Option<TimedExposure>,
    /// `None` for a stored picture.
    pub(crate) camera: Option<RayGenerator>,
    /// The natural vignetting of the camera, computed when it is needed.
    pub(crate) vignetting: OnceLock<Option<Arc<Plane<f32>>>>,
}

impl PictureScene {
    /// The natural vignetting of each pixel, at its centre. `None` for parallel rays, and without a camera.
    fn vignetting(&self, [width, height]: [u32; 2]) -> Option<Arc<Plane<f32>>> {
        let of_pixel = |camera: &RayGenerator, x: u32, y: u32| {
            camera.natural_vignetting(f64::from(x) + 0.5, f64::from(y) + 0.5).unwrap_or(1.0) as f32
        };
        let plane = || {
            let camera = self.camera.as_ref().filter(|camera| camera.natural_vignetting(0.0, 0.0).is_some())?;
            Some(Arc::new(Plane::from_fn(width, height, |x, y| of_pixel(camera, x, y))))
        };
        self.vignetting.get_or_init(plane).clone()
    }
}

/// The heaviest sample of a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Heaviest {
    /// The number of the sample.
    pub(crate) index: u32,
    /// Its share of the light of the pixel, in \[0, 1\].
    pub(crate) share: f64,
}

/// A film that no longer changes, with the settings that expose it.
#[derive(Debug)]
pub(crate) struct Snapshot {
    /// A number that grows with each content.
    pub(crate) id: u64,
    pub(crate) content: Content,
    /// The settings with the lens combined with the camera.
    pub(crate) settings: RenderSettings,
    pub(crate) is_vignetted: bool,
    /// Samples per pixel, and those since the snapshot before.
    pub(crate) counts: Plane<u32>,
    pub(crate) recent: Option<Plane<u32>>,
    pub(crate) samples: u64,
    /// Are there pixels without samples?
    pub(crate) has_gaps: bool,
    /// Seconds of the render, without pauses.
    pub(crate) seconds: f64,
    /// The number of restarts before its render.
    pub(crate) restarted: u32,
    pub(crate) scene: Arc<PictureScene>,
    mean: OnceLock<MeanImage>,
    /// The means of the lights that have films of their own.
    means_of_lights: OnceLock<Vec<MeanImage>>,
}

impl Snapshot {
    /// Takes a film of a scene. `before` is the snapshot before, if it is of the same render.
    pub(crate) fn new(
        id: u64,
        content: Content,
        (settings, is_vignetted): (RenderSettings, bool),
        scene: Arc<PictureScene>,
        seconds: f64,
        before: Option<&Self>,
    ) -> Self {
        let (counts, has_gaps) = match &content {
            Content::Film(film) => {
                let counts = film.sums.sample_counts();
                let has_gaps = counts.data().contains(&0);
                (counts, has_gaps)
            }
            Content::Exr(image) => {
                (image.sample_counts().cloned().unwrap_or_else(|| image.radiance().map(|_| 0)), false)
            }
        };
        let recent = before.map(|before| {
            let mut earlier = before.counts.data().iter();
            counts.map(|&n| n.saturating_sub(earlier.next().copied().unwrap_or(0)))
        });
        Self {
            id,
            content,
            settings,
            is_vignetted,
            samples: counts.data().iter().map(|&n| u64::from(n)).sum(),
            has_gaps,
            counts,
            recent,
            seconds,
            restarted: 0,
            scene,
            mean: OnceLock::new(),
            means_of_lights: OnceLock::new(),
        }
    }

    /// An EXR.
    pub(crate) fn of_exr(image: ExrImage, settings: RenderSettings, scene: Arc<PictureScene>) -> Self {
        Self::new(1, Content::Exr(Box::new(image)), (settings, false), scene, 0.0, None)
    }

    /// The EXR that is shown.
    pub(crate) fn exr(&self) -> Option<&ExrImage> {
        if let Content::Exr(image) = &self.content { Some(image) } else { None }
    }

    /// The film; `None` for an EXR.
    pub(crate) fn film(&self) -> Option<&RenderedFilm> {
        match &self.content {
            Content::Film(film) => Some(film),
            Content::Exr(_) => None,
        }
    }

    /// The lights that have films of their own.
    pub(crate) fn lights(&self) -> impl Iterator<Item = &str> {
        self.settings.run.light_groups.iter().flatten().map(String::as_str)
    }

    /// The factor of each light with a film of its own, from factors by the names of lights. A light that the list leaves out
    /// has the factor 1. A name without a film is that of a light that is off, or of an earlier scene. Empty if all factors are 1.
    ///
    /// # Errors
    /// A factor out of range, and factors where all lights have one film.
    pub(crate) fn factors(&self, lights: Option<&BTreeMap<String, f64>>) -> Result<Vec<f64>, Fault> {
        let Some(lights) = lights else { return Ok(Vec::new()) };
        if let Some((name, factor)) = lights.iter().find(|(_, factor)| !(0.0..=MAX_FACTOR).contains(*factor)) {
            let problem = format!("the factor {factor} of the light {name:?} is out of range");
            return Err(Fault::new(problem, "use 0 to 1000000"));
        }
        let is_one_film = self.film().is_none_or(|film| film.groups.is_empty());
        if is_one_film && lights.values().any(|factor| *factor != 1.0) {
            let help = "switch the film for each light on and wait for its picture, or change the power of the lights";
            return Err(Fault::new("there is one film for all lights", help));
        }
        let factors: Vec<f64> = self.lights().map(|name| lights.get(name).copied().unwrap_or(1.0)).collect();
        Ok(if factors.iter().all(|factor| *factor == 1.0) { Vec::new() } else { factors })
    }

    /// The film with these factors of its lights. `None` without factors, and for an EXR. Runs on the threads of the current pool.
    ///
    /// # Errors
    /// Too little memory.
    pub(crate) fn weighted(&self, factors: &[f64]) -> Result<Option<RenderedFilm>, Fault> {
        let film = self.film().filter(|_| !factors.is_empty());
        Ok(film.map(|film| film.weighted(factors)).transpose()?)
    }

    /// The transmission of a lens with the other choice of vignetting, relative to that of the film.
    ///
    /// # Errors
    /// A stored picture, and parallel rays.
    pub(crate) fn other_transmission(&self) -> Result<Arc<Plane<f32>>, Fault> {
        let Some(shares) = self.scene.vignetting(self.size()) else {
            let problem = "the lens is unknown, or its rays are parallel and have no vignetting";
            return Err(Fault::new(problem, "open the scene or its job, with a camera of perspective"));
        };
        Ok(if self.is_vignetted { Arc::new(shares.map(|share| 1.0 / share)) } else { shares })
    }

    /// Width and height \[pixels\].
    pub(crate) fn size(&self) -> [u32; 2] {
        [self.counts.width(), self.counts.height()]
    }

    /// Mean samples per pixel.
    pub(crate) fn spp(&self) -> f64 {
        self.samples as f64 / self.counts.data().len().max(1) as f64
    }

    /// Computes [`Self::mean`], once. Not for threads of the session: while such a thread waits for others it takes up other
    /// work, which could wait for this result.
    pub(crate) fn find_mean(&self, session: &Session<'_>) {
        if self.film().is_some() {
            self.mean.get_or_init(|| session.install(|| self.read_mean()));
        }
    }

    /// Computes the means of [`Self::weighted_mean`], as [`Self::find_mean`].
    pub(crate) fn find_means_of_lights(&self, session: &Session<'_>) {
        self.means_of_lights.get_or_init(|| session.install(|| self.read_means_of_lights()));
    }

    /// The mean with these factors of the lights, after [`Self::find_means_of_lights`].
    pub(crate) fn weighted_mean(&self, factors: &[f64]) -> Result<MeanImage, Fault> {
        let means = self.means_of_lights.get_or_init(|| self.read_means_of_lights());
        Ok(sum_of_means(&means.iter().zip(factors.iter().copied()).collect::<Vec<_>>())?)
    }

    /// The mean in front of the lens, without gaps, after [`Self::find_mean`].
    pub(crate) fn mean(&self) -> &MeanImage {
        match &self.content {
            Content::Exr(image) => image.mean(),
            Content::Film(_) => self.mean.get_or_init(|| self.read_mean()),
        }
    }

    fn read_mean(&self) -> MeanImage {
        let empty = || Plane::new(self.counts.width(), self.counts.height(), [0.0; 3]).into();
        self.film().map_or_else(empty, |film| mean_image(&film.sums, film.is_spread))
    }

    fn read_means_of_lights(&self) -> Vec<MeanImage> {
        self.film().map_or_else(Vec::new, |film| film.groups.iter().map(|of| mean_image(of, film.is_spread)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld::film::Film;

    #[test]
    fn lights_have_the_factors_of_their_names() {
        let lights = [vec!["left".to_owned()], vec!["right".to_owned()]];
        let mut film = RenderedFilm::without_ids(Film::new(2, 1));
        film.groups = vec![film.sums.clone(), film.sums.clone()];
        let settings = RenderSettings::without_sensor().running(|run| run.with_light_groups(lights.to_vec()));
        let picture = Snapshot::new(1, Content::Film(film), (settings, false), Arc::default(), 0.0, None);
        assert_eq!(picture.factors(None), Ok(vec![]));
        let factors = |name: &str, factor: f64| picture.factors(Some(&BTreeMap::from([(name.to_owned(), factor)])));
        assert_eq!(factors("right", 0.5), Ok(vec![1.0, 0.5]));
        assert_eq!((factors("right", 1.0), factors("gone", 3.0)), (Ok(vec![]), Ok(vec![])));
        for wrong in [-1.0, 2e6, f64::NAN, f64::INFINITY] {
            assert!(factors("right", wrong).is_err(), "{wrong}");
        }
    }
}
