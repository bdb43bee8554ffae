//! The inputs of a sample.

use crate::learned_roulette::LearnedRoulette;
use crate::observer::{ConnectionTally, PathTrace};
use crate::wavefront::{Watch, Wavefront};
use dunkelfeld_film::Sample;
use dunkelfeld_lanes::InstructionSet;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{RayGenerator, Scene};

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
        let (mut found, mut trace) = ([Vec::new()], PathTrace::default());
        let watch = Watch { tally: &mut ConnectionTally::default(), observer: Some(&mut trace) };
        let weight = Wavefront::new(self, InstructionSet::best()).observed(&[at], watch, &mut found);
        // The lens scales the radiance, for example by vignetting.
        trace.scale(weight);
        (found[0][0], trace)
    }

    /// The source of all random numbers of a sample.
    #[inline]
    pub(crate) fn sampler(&self, at: PixelSample) -> Sampler {
        Sampler::new(self.seed, self.frame, at.y * self.width + at.x, at.index)
    }
}
