//! The estimator of one sample: camera sample, ray, radiance, film sample.

use crate::dimensions;
use crate::learned_roulette::LearnedRoulette;
use crate::observer::{ConnectionTally, PathTrace};
use crate::wavefront::{Watch, Wavefront};
use dunkelfeld_film::Sample;
use dunkelfeld_geometry::Ray;
use dunkelfeld_lanes::InstructionSet;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{CameraRay, Moment, RayGenerator, Scene};

/// Coordinates of one sample of an image: pixel and index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelSample {
    /// Column, from the left.
    pub x: u32,
    /// Row, from the top.
    pub y: u32,
    /// Index of the sample in its pixel.
    pub index: u32,
}

/// All inputs of a sample except its coordinates.
#[derive(Clone, Copy, Debug)]
pub struct Estimator<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The camera, bound to a film.
    pub camera: &'a RayGenerator,
    /// Width of the film in pixels.
    pub width: u32,
    /// Seed of the image.
    pub seed: u64,
    /// Frame number. Frames of one seed are independent.
    pub frame: u32,
    /// Learned survival probabilities. `None` selects rules that need no training.
    pub roulette: Option<&'a LearnedRoulette>,
}

impl Estimator<'_> {
    /// One sample. [`Wavefront::samples`] computes many faster, with the same bits.
    pub fn sample(&self, at: PixelSample) -> Sample {
        self.samples(&[at])[0]
    }

    /// Samples, in order.
    pub fn samples(&self, at: &[PixelSample]) -> Vec<Sample> {
        let mut found = Vec::new();
        Wavefront::new(self, InstructionSet::best()).samples(at, &mut ConnectionTally::default(), &mut found);
        found
    }

    /// One sample with a record of its path, vertex by vertex.
    pub fn trace(&self, at: PixelSample) -> (Sample, PathTrace) {
        let (mut found, mut trace) = (Vec::new(), PathTrace::default());
        let watch = Watch { tally: &mut ConnectionTally::default(), observer: Some(&mut trace) };
        let weight = Wavefront::new(self, InstructionSet::best()).observed(&[at], watch, &mut found);
        // The lens scales the radiance, for example by vignetting.
        trace.scale(weight);
        (found[0], trace)
    }

    /// The source of all random numbers of a sample.
    #[inline]
    pub(crate) fn sampler(&self, at: PixelSample) -> Sampler {
        Sampler::new(self.seed, self.frame, at.y * self.width + at.x, at.index)
    }

    /// The ray of a sample from a uniform place in the pixel: the box filter of a sensor that integrates over its pixel.
    #[inline]
    pub(crate) fn camera_sample(&self, at: PixelSample, sampler: &Sampler, [dx, dy]: [f32; 2]) -> CameraSample {
        // The time of the sample. The rows of a line scan have the same place on the film.
        let Moment { time, y } = match self.scene.shutter() {
            None => Moment { time: 0.0, y: at.y as f32 + dy },
            Some(shutter) => shutter.moment(at.y, dy, sampler.get_1d(dimensions::TIME), (self.seed, self.frame)),
        };
        // The ray from the film through the lens into the scene. A pinhole needs no place on the lens.
        let lens = self.camera.has_aperture().then(|| sampler.get_2d(dimensions::LENS));
        let CameraRay { ray, weight, start } = self.camera.camera_ray(at.x as f32 + dx, y, lens);
        CameraSample { ray: ray.at_time(time), weight, start }
    }
}

/// The ray of a sample.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraSample {
    pub(crate) ray: Ray,
    /// Factor on the radiance.
    pub(crate) weight: f32,
    /// Distance from the camera to the origin of the ray \[m\].
    pub(crate) start: f32,
}

impl CameraSample {
    /// The sample of the path of this ray, with its radiance, as that of the film.
    #[inline]
    pub(crate) fn weighted(&self, radiance: Rgb, sample: &Sample) -> Sample {
        let depth = if sample.hit { self.start + sample.depth } else { sample.depth };
        Sample { radiance: radiance * self.weight, depth, ..*sample }
    }
}
