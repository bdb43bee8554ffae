//! The interface between a render and its denoisers.

use dunkelfeld_film::Plane;

/// A plane of linear triples.
pub type Triples = Plane<[f32; 3]>;

/// The input of a denoiser. Only the mean is always present. A denoiser uses the planes that it supports and ignores
/// the rest.
///
/// All planes have the size of the mean ([`DenoiseInput::check`]). The auxiliary planes describe the first surface that
/// is not a clear sheet or a mirror, averaged over the pixel.
#[derive(Clone, Copy, Debug)]
pub struct DenoiseInput<'a> {
    /// Unbiased mean radiance [W/(m^2 sr) per channel].
    pub mean: &'a Triples,
    /// Variance of the mean, in the square of its unit. Infinite if it is unknown.
    pub variance: Option<&'a Triples>,
    /// The part of the mean that is light of the first surface. It has little noise and sharp edges. Its rest is filtered
    /// apart from it.
    pub first_light: Option<&'a Triples>,
    /// Reflectance in \[0, 1\].
    pub albedo: Option<&'a Triples>,
    /// Variance of the albedo's mean.
    pub albedo_variance: Option<&'a Triples>,
    /// Shading normal in world space, length up to 1. Zero without a surface.
    pub normal: Option<&'a Triples>,
    /// Variance of the normal's mean.
    pub normal_variance: Option<&'a Triples>,
    /// Distance from the camera \[m\]. 0 without a surface.
    pub depth: Option<&'a Plane<f32>>,
    /// Variance of the depth's mean \[m^2\].
    pub depth_variance: Option<&'a Plane<f32>>,
}

impl<'a> DenoiseInput<'a> {
    /// An input with the mean alone.
    pub fn new(mean: &'a Triples) -> Self {
        Self {
            mean,
            variance: None,
            first_light: None,
            albedo: None,
            albedo_variance: None,
            normal: None,
            normal_variance: None,
            depth: None,
            depth_variance: None,
        }
    }

    /// Checks that all planes have the size of the mean. The error contains the name of the first that does not.
    pub fn check(&self) -> Result<(), DenoiseError> {
        let size = (self.mean.width(), self.mean.height());
        let triples = [
            ("variance", self.variance),
            ("first light", self.first_light),
            ("albedo", self.albedo),
            ("albedo variance", self.albedo_variance),
            ("normal", self.normal),
            ("normal variance", self.normal_variance),
        ];
        let sizes = triples
            .into_iter()
            .filter_map(|(name, plane)| plane.map(|p| (name, (p.width(), p.height()))))
            .chain(self.depth.map(|p| ("depth", (p.width(), p.height()))))
            .chain(self.depth_variance.map(|p| ("depth variance", (p.width(), p.height()))));
        for (plane, got) in sizes {
            if got != size {
                return Err(DenoiseError::SizeMismatch { plane, got, expected: size });
            }
        }
        Ok(())
    }
}

/// The reason why there is no denoised image.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DenoiseError {
    /// A plane differs in size from the mean.
    #[error("the {plane} plane has {} x {} pixels, the mean has {} x {}", got.0, got.1, expected.0, expected.1)]
    SizeMismatch {
        /// The name of the plane.
        plane: &'static str,
        /// Its width and height.
        got: (u32, u32),
        /// Width and height of the mean.
        expected: (u32, u32),
    },
    /// The denoiser needs a plane that is missing.
    #[error("this denoiser needs the {0} plane")]
    Missing(&'static str),
    /// The library of the denoiser is not available.
    #[error("{0}")]
    Unavailable(String),
    /// The library of the denoiser reports an error. The text is that of the library.
    #[error("{0}")]
    Library(String),
    /// The caller requested a stop.
    #[error("denoising was cancelled")]
    Cancelled,
}

/// Runs independent pieces of work. Crates of this level start no threads. The owner of the threads provides them
/// through this trait.
pub trait Executor: Sync {
    /// Number of threads that work at once. A library with its own threads uses the same number.
    fn threads(&self) -> usize;

    /// Calls `work` once for each of `0..pieces`, in any order, and returns when all are done. The result of a piece
    /// must depend on its number only.
    fn for_each(&self, pieces: usize, work: &(dyn Fn(usize) + Sync));
}

/// An executor with one thread, that of the caller.
#[derive(Clone, Copy, Debug, Default)]
pub struct Serial;

impl Executor for Serial {
    fn threads(&self) -> usize {
        1
    }

    fn for_each(&self, pieces: usize, work: &(dyn Fn(usize) + Sync)) {
        (0..pieces).for_each(work);
    }
}

/// The threads and the progress callback of a denoiser.
#[derive(Clone, Copy)]
pub struct Control<'a> {
    /// The threads to work on.
    pub executor: &'a dyn Executor,
    /// Gets the finished fraction, from 0 to 1, and returns whether to continue. Any thread may call it, between pieces
    /// of at most some tens of milliseconds. The fraction may repeat.
    pub progress: &'a (dyn Fn(f64) -> bool + Sync),
}

impl Control<'static> {
    /// One thread, no progress, never cancelled.
    pub const SILENT: Self = Self { executor: &Serial, progress: &|_| true };
}

/// A method that computes a smoother image from a noisy mean.
pub trait Denoiser: Send + Sync {
    /// Name for messages and for the metadata of the image, with a version if the algorithm has one.
    fn name(&self) -> String;

    /// The denoised mean, of the size and unit of `input.mean`. It is finite at each pixel at which the input is.
    ///
    /// The result is the same for any number of threads of the executor, unless the denoiser's own library prevents it.
    fn denoise(&self, input: &DenoiseInput<'_>, control: &Control<'_>) -> Result<Triples, DenoiseError>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_of_another_size_are_named() {
        let (mean, other) = (Plane::new(4, 3, [1.0; 3]), Plane::new(3, 4, [0.0; 3]));
        let depth = Plane::new(4, 2, 0.0);
        let fits = DenoiseInput { albedo: Some(&mean), ..DenoiseInput::new(&mean) };
        assert_eq!(fits.check(), Ok(()));
        let wrong = DenoiseInput { normal: Some(&other), ..fits };
        let error = wrong.check().expect_err("the normal differs").to_string();
        assert_eq!(error, "the normal plane has 3 x 4 pixels, the mean has 4 x 3");
        let wrong = DenoiseInput { depth: Some(&depth), ..fits };
        assert!(matches!(wrong.check(), Err(DenoiseError::SizeMismatch { plane: "depth", .. })));
    }
}
