//! The film: exact sums for every pixel of an image.

use crate::accumulator::{Accumulate, PixelSums, Sample};
use crate::gaps::fill_gaps;
use crate::plane::Plane;

/// Why two films could not be joined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilmError {
    /// The films differ in size: width and height of both.
    SizeMismatch([u32; 4]),
}

impl std::fmt::Display for FilmError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::SizeMismatch([w, h, ow, oh]) => {
                write!(f, "the films differ in size: {w} x {h} and {ow} x {oh} pixels")
            }
        }
    }
}

impl std::error::Error for FilmError {}

/// An image's worth of exact sums. Films of disjoint sample sets merge to the film of their union, to the last bit.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    pixels: Plane<PixelSums>,
}

impl Film {
    /// An empty film.
    pub fn new(width: u32, height: u32) -> Self {
        Self { pixels: Plane::new(width, height, PixelSums::default()) }
    }

    /// A film from sums.
    pub fn from_sums(pixels: Plane<PixelSums>) -> Self {
        Self { pixels }
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.pixels.width()
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.pixels.height()
    }

    /// The sums of all pixels.
    pub fn pixels(&self) -> &Plane<PixelSums> {
        &self.pixels
    }

    /// The sums of all pixels, to be added to.
    pub fn pixels_mut(&mut self) -> &mut Plane<PixelSums> {
        &mut self.pixels
    }

    /// Adds sample number `index` of the pixel with linear index `pixel`.
    ///
    /// # Panics
    /// Outside the film.
    #[inline]
    pub fn add(&mut self, pixel: usize, index: u32, sample: &Sample) {
        self.pixels.data_mut()[pixel].add(index, sample);
    }

    /// Adds all samples of `other`; the caller vouches that the sample sets are disjoint.
    pub fn merge(&mut self, other: &Self) -> Result<(), FilmError> {
        if (self.width(), self.height()) != (other.width(), other.height()) {
            return Err(FilmError::SizeMismatch([self.width(), self.height(), other.width(), other.height()]));
        }
        for (a, b) in self.pixels.data_mut().iter_mut().zip(other.pixels.data()) {
            a.merge(b);
        }
        Ok(())
    }

    /// Mean radiance per pixel and channel [W/(m^2 sr)].
    pub fn mean(&self) -> Plane<[f32; 3]> {
        self.pixels.map(|p| p.mean().map(|v| v as f32))
    }

    /// [`Self::mean`] for a picture to look at: pixels without samples show the mean of their neighbours ([`fill_gaps`]).
    pub fn mean_without_gaps(&self) -> Plane<[f32; 3]> {
        let known = self.pixels.map(|p| p.count() > 0);
        if known.data().contains(&false) { fill_gaps(&self.mean(), &known) } else { self.mean() }
    }

    /// Variance of the mean per pixel and channel [(W/(m^2 sr))^2]; infinite where nothing is known.
    pub fn variance(&self) -> Plane<[f32; 3]> {
        self.pixels.map(|p| p.variance_of_mean().map(|v| v as f32))
    }

    /// Covariance of the mean of red and green, red and blue, green and blue per pixel [(W/(m^2 sr))^2]; infinite where nothing is known.
    pub fn covariance(&self) -> Plane<[f32; 3]> {
        self.pixels.map(|p| p.covariance_of_mean().map(|v| v as f32))
    }

    /// Number of samples per pixel.
    pub fn sample_counts(&self) -> Plane<u32> {
        self.pixels.map(PixelSums::count)
    }

    /// Number of samples of the whole film.
    pub fn total_samples(&self) -> u64 {
        self.pixels.data().iter().map(|p| u64::from(p.count())).sum()
    }

    /// Number of samples that were not finite, negative or out of range.
    pub fn invalid_samples(&self) -> u64 {
        self.pixels.data().iter().map(|p| u64::from(p.invalid)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_radiometry::Rgb;

    #[test]
    fn films_of_different_sizes_do_not_merge() {
        let error = Film::new(4, 3).merge(&Film::new(3, 4)).expect_err("sizes differ");
        assert_eq!(error, FilmError::SizeMismatch([4, 3, 3, 4]));
    }

    #[test]
    fn long_and_tiny_films_work() {
        for (w, h) in [(1, 1), (16_384, 1), (1, 16_384)] {
            let mut film = Film::new(w, h);
            let last = (w * h - 1) as usize;
            film.add(last, 0, &Sample { radiance: Rgb::WHITE, ..Sample::MISS });
            assert_eq!(film.mean().data()[last], [1.0; 3]);
            assert_eq!(film.total_samples(), 1);
        }
    }
}
