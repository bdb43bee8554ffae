//! The estimator for one sample, on one page: camera sample, ray, radiance, film sample.

use crate::dimensions;
use crate::dispatch::follow;
use crate::recorder::{ConnectionTally, PathTrace, Recorder};
use dunkelfeld_film::Sample;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{CameraRay, RayGenerator, Scene};

/// Names one sample of an image: which pixel, and which of its samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelSample {
    /// Column, from the left.
    pub x: u32,
    /// Row, from the top.
    pub y: u32,
    /// Index of the sample in its pixel.
    pub index: u32,
}

/// Everything that a sample is a function of, but for its name.
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
    /// Frame number: frames of one seed are independent.
    pub frame: u32,
}

impl Estimator<'_> {
    /// One sample: a pure function of (scene, camera, seed, frame, pixel, sample index).
    ///
    /// Its radiance is an unbiased estimate of the mean over the pixel's area. It is finite and not negative unless the
    /// scene drives floating-point numbers out of their range; such a sample is returned as it is, for the film to count.
    #[inline]
    pub fn sample(&self, at: PixelSample) -> Sample {
        self.run(at, &mut ConnectionTally::default())
    }

    /// The same sample; connections through covers that it sought are counted.
    #[inline]
    pub fn sample_counting(&self, at: PixelSample, tally: &mut ConnectionTally) -> Sample {
        self.run(at, tally)
    }

    /// The same sample, with its path written down vertex by vertex.
    pub fn trace(&self, at: PixelSample) -> (Sample, PathTrace) {
        let mut trace = PathTrace::default();
        let sample = self.run(at, &mut trace);
        (sample, trace)
    }

    fn run(&self, at: PixelSample, recorder: &mut impl Recorder) -> Sample {
        // Every decision of this sample draws its numbers from here.
        let sampler = Sampler::new(self.seed, self.frame, at.y * self.width + at.x, at.index);
        // A box filter, sampled: a sensor integrates over its pixel.
        let [dx, dy] = sampler.get_2d(dimensions::CAMERA);
        // From the film through the lens into the scene; a pinhole needs no place on the lens.
        let lens = self.camera.has_aperture().then(|| sampler.get_2d(dimensions::LENS));
        let CameraRay { ray, weight, start } = self.camera.camera_ray(at.x as f32 + dx, at.y as f32 + dy, lens);
        // Along the path until it ends; what it brings back is what the film remembers.
        let sample = follow(self.scene, ray, &sampler, recorder);
        // What the lens does to it, seen from the camera.
        recorder.weigh(weight);
        let depth = if sample.hit { start + sample.depth } else { sample.depth };
        Sample { radiance: sample.radiance * weight, depth, ..sample }
    }
}
