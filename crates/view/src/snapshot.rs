//! The film, or the films of the lights, at some moment of a render.

use crate::developed::Sensors;
use crate::light_sum::{self, LightFilm};
use crate::protocol::Fault;
use crate::scene_change::{SceneChange, SceneParts};
use dunkelfeld::film::{MeanImage, PixelSums, Plane, mean_image};
use dunkelfeld::outputs::ExrImage;
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::RayGenerator;
use dunkelfeld::sensor::{ImageNoise, TimedExposure};
use dunkelfeld::{Exposer, RenderSettings, RenderedFilm, Session};
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

/// The origin of the pixels of a snapshot.
#[derive(Debug)]
pub(crate) enum Content {
    Film(RenderedFilm),
    /// A film for each light.
    Lights(Vec<LightFilm>),
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
    /// The number of its film.
    pub(crate) film: usize,
    /// The number of the sample.
    pub(crate) index: u32,
    /// Its share of the light of the pixel, in \[0, 1\].
    pub(crate) share: f64,
}

/// Films that no longer change, with the settings that expose it.
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
    /// Are there pixels without samples in a film?
    pub(crate) has_gaps: bool,
    /// Seconds of the render, without pauses.
    pub(crate) seconds: f64,
    /// The number of restarts before its render.
    pub(crate) restarted: u32,
    pub(crate) scene: Arc<PictureScene>,
    mean: OnceLock<MeanImage>,
}

impl Snapshot {
    /// Takes films of a scene. `before` is the snapshot before, if it is of the same render.
    pub(crate) fn new(
        id: u64,
        content: Content,
        (settings, is_vignetted): (RenderSettings, bool),
        scene: Arc<PictureScene>,
        seconds: f64,
        before: Option<&Self>,
    ) -> Self {
        let mut has_gaps = false;
        let size = films_of(&content).next().map(|film| [film.sums.width(), film.sums.height()]);
        let [width, height] = size.unwrap_or_default();
        let mut counts = Plane::new(width, height, 0);
        for film in films_of(&content) {
            let of_film = film.sums.sample_counts();
            has_gaps |= of_film.data().contains(&0);
            counts.data_mut().iter_mut().zip(of_film.data()).for_each(|(sum, n)| *sum += n);
        }
        let samples = counts.data().iter().map(|&n| u64::from(n)).sum();
        let recent = before.map(|before| {
            let mut earlier = before.counts.data().iter();
            counts.map(|&n| n.saturating_sub(earlier.next().copied().unwrap_or(0)))
        });
        let (mean, restarted) = (OnceLock::new(), 0);
        Self { id, content, settings, is_vignetted, counts, recent, samples, has_gaps, seconds, restarted, scene, mean }
    }

    /// An EXR.
    pub(crate) fn of_exr(image: ExrImage, settings: RenderSettings, scene: Arc<PictureScene>) -> Self {
        let counts = image.sample_counts().cloned().unwrap_or_else(|| image.radiance().map(|_| 0));
        Self {
            id: 1,
            content: Content::Exr(Box::new(image)),
            settings,
            is_vignetted: false,
            samples: counts.data().iter().map(|&n| u64::from(n)).sum(),
            counts,
            recent: None,
            has_gaps: false,
            seconds: 0.0,
            restarted: 0,
            scene,
            mean: OnceLock::new(),
        }
    }

    /// The EXR that is shown.
    pub(crate) fn exr(&self) -> Option<&ExrImage> {
        if let Content::Exr(image) = &self.content { Some(image) } else { None }
    }

    /// The films: one, one for each light, or none of an EXR.
    pub(crate) fn films(&self) -> impl Iterator<Item = &RenderedFilm> {
        films_of(&self.content)
    }

    /// The factor of each film, from factors by the names of lights.
    ///
    /// # Errors
    /// A factor out of range, and factors where all lights have one film.
    pub(crate) fn factors(&self, lights: Option<&BTreeMap<String, f64>>) -> Result<Vec<f64>, Fault> {
        if let Content::Lights(films) = &self.content {
            return light_sum::factors(films, lights);
        }
        if lights.is_some_and(|lights| lights.values().any(|factor| *factor != 1.0)) {
            let help = "switch the film for each light on and wait for its picture, or change the power of the lights";
            return Err(Fault::new("there is one film for all lights", help));
        }
        Ok(self.films().map(|_| 1.0).collect())
    }

    /// The sums of the samples of a pixel in all films.
    pub(crate) fn sums_at(&self, x: u32, y: u32) -> PixelSums {
        let mut sums = PixelSums::default();
        self.films().for_each(|film| sums.merge(&film.sums.pixel(x, y)));
        sums
    }

    /// The sample with the largest share of the light of a pixel, for films with these factors. `None` for a black pixel.
    pub(crate) fn heaviest(&self, factors: &[f64], x: u32, y: u32) -> Option<Heaviest> {
        let mut total = 0.0;
        let mut heaviest: Option<(usize, u32, f64)> = None;
        for (film, (rendered, &factor)) in self.films().zip(factors).enumerate() {
            let sums = rendered.sums.pixel(x, y);
            let [r, g, b] = sums.mean().map(|v| v as f32);
            total += factor * f64::from(Rgb::new(r, g, b).luminance());
            let Some((index, luminance)) = sums.heaviest().filter(|_| factor > 0.0) else { continue };
            let part = factor * f64::from(luminance) / f64::from(sums.count().max(1));
            if heaviest.is_none_or(|(.., largest)| part > largest) {
                heaviest = Some((film, index, part));
            }
        }
        let (film, index, part) = heaviest.filter(|_| total > 0.0)?;
        Some(Heaviest { film, index, share: (part / total).min(1.0) })
    }

    /// The name of the light of a film, if each has one.
    pub(crate) fn light(&self, film: usize) -> Option<&str> {
        match &self.content {
            Content::Lights(films) => films.get(film).map(|light| &light.name[..]),
            Content::Film(_) | Content::Exr(_) => None,
        }
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
        match &self.content {
            Content::Lights(films) => light_sum::find_means(films, session),
            Content::Exr(_) => {}
            Content::Film(_) => {
                self.mean.get_or_init(|| session.install(|| self.read_mean()));
            }
        }
    }

    /// The mean in front of the lens, without gaps, after [`Self::find_mean`]. Each film of a light has its own.
    pub(crate) fn mean(&self) -> &MeanImage {
        match &self.content {
            Content::Exr(image) => image.mean(),
            Content::Film(_) | Content::Lights(_) => self.mean.get_or_init(|| self.read_mean()),
        }
    }

    /// Matched exposure of the films with these factors, with the noise of these or of other films of their scene.
    ///
    /// # Errors
    /// The noise of another number of films.
    pub(crate) fn matched(&self, exposer: Exposer, noise: &ImageNoise, factors: &[f64]) -> Result<Exposer, Fault> {
        Ok(match &self.content {
            Content::Exr(_) => exposer.with_noise(noise, &[(None, 1.0)])?,
            Content::Film(_) => {
                let films: Vec<_> = factors.iter().map(|&factor| (Some(&self.counts), factor)).collect();
                exposer.with_noise(noise, &films)?
            }
            Content::Lights(films) => {
                let counts: Vec<_> = films.iter().map(|light| light.film.sums.sample_counts()).collect();
                let films: Vec<_> = counts.iter().map(Some).zip(factors.iter().copied()).collect();
                exposer.with_noise(noise, &films)?
            }
        })
    }

    fn read_mean(&self) -> MeanImage {
        let empty = || Plane::new(self.counts.width(), self.counts.height(), [0.0; 3]).into();
        self.films().next().map_or_else(empty, |film| mean_image(&film.sums, film.is_spread))
    }
}

fn films_of(content: &Content) -> impl Iterator<Item = &RenderedFilm> {
    let (one, lights): (_, &[LightFilm]) = match content {
        Content::Film(film) => (Some(film), &[]),
        Content::Lights(films) => (None, films),
        Content::Exr(_) => (None, &[]),
    };
    one.into_iter().chain(lights.iter().map(|light| &*light.film))
}
