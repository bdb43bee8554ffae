//! A film at some moment of its render.

use crate::developed::Sensors;
use crate::scene_change::{SceneChange, SceneParts};
use dunkelfeld::film::Plane;
use dunkelfeld::{RenderSettings, RenderedFilm, Session, mean_without_gaps};
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

/// The origin of the pixels of a snapshot.
#[derive(Debug)]
pub(crate) enum Content {
    Film(RenderedFilm),
    /// An EXR of any renderer.
    Exr(PathBuf),
}

/// The scene of a picture. Answers about a picture are of its scene, which may be older than the newest one.
#[derive(Clone, Debug, Default)]
pub(crate) struct PictureScene {
    /// Counts the scenes of the thread that renders.
    pub(crate) number: u64,
    pub(crate) change: SceneChange,
    pub(crate) parts: SceneParts,
    /// Names by their number in the film.
    pub(crate) materials: Vec<String>,
    /// The text of the job as it was read; `None` for a scene without a job.
    pub(crate) job: Option<String>,
    pub(crate) sensors: Sensors,
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
    /// Seconds of the render, without pauses.
    pub(crate) seconds: f64,
    /// The number of restarts before its render.
    pub(crate) restarted: u32,
    pub(crate) scene: Arc<PictureScene>,
    mean: OnceLock<Plane<[f32; 3]>>,
}

impl Snapshot {
    /// Takes a film of a scene. `before` is the snapshot before, if it is of the same render.
    pub(crate) fn new(
        id: u64,
        film: RenderedFilm,
        (settings, is_vignetted): (RenderSettings, bool),
        scene: Arc<PictureScene>,
        seconds: f64,
        before: Option<&Self>,
    ) -> Self {
        let counts = film.sums.sample_counts();
        let samples = counts.data().iter().map(|&n| u64::from(n)).sum();
        let recent = before.map(|before| {
            let mut earlier = before.counts.data().iter();
            counts.map(|&n| n.saturating_sub(earlier.next().copied().unwrap_or(0)))
        });
        let (content, mean, restarted) = (Content::Film(film), OnceLock::new(), 0);
        Self { id, content, settings, is_vignetted, counts, recent, samples, seconds, restarted, scene, mean }
    }

    /// An EXR, from its mean radiance.
    pub(crate) fn of_exr(
        path: PathBuf,
        mean: Plane<[f32; 3]>,
        settings: RenderSettings,
        scene: Arc<PictureScene>,
    ) -> Self {
        let counts = Plane::new(mean.width(), mean.height(), 0);
        Self {
            id: 1,
            content: Content::Exr(path),
            settings,
            is_vignetted: false,
            counts,
            recent: None,
            samples: 0,
            seconds: 0.0,
            restarted: 0,
            scene,
            mean: OnceLock::from(mean),
        }
    }

    /// The sums of the samples, if there are some.
    pub(crate) fn film(&self) -> Option<&RenderedFilm> {
        match &self.content {
            Content::Film(film) => Some(film),
            Content::Exr(_) => None,
        }
    }

    /// Width and height \[pixels\].
    pub(crate) fn size(&self) -> [u32; 2] {
        [self.counts.width(), self.counts.height()]
    }

    /// Mean samples per pixel.
    pub(crate) fn spp(&self) -> f64 {
        self.samples as f64 / self.counts.data().len().max(1) as f64
    }

    /// Are there pixels without samples?
    pub(crate) fn has_gaps(&self) -> bool {
        self.film().is_some() && self.counts.data().contains(&0)
    }

    /// Computes [`Self::mean`], once. Not for threads of the session: while such a thread waits for others it takes up other
    /// work, which could wait for this result.
    pub(crate) fn find_mean(&self, session: &Session<'_>) {
        self.mean.get_or_init(|| session.install(|| self.read_mean()));
    }

    /// Mean radiance [W/(m² sr)], without gaps, after [`Self::find_mean`].
    pub(crate) fn mean(&self) -> &Plane<[f32; 3]> {
        self.mean.get_or_init(|| self.read_mean())
    }

    fn read_mean(&self) -> Plane<[f32; 3]> {
        let empty = || Plane::new(self.counts.width(), self.counts.height(), [0.0; 3]);
        self.film().map_or_else(empty, |film| mean_without_gaps(&film.sums))
    }
}
