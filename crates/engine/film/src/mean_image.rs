//! The mean of a film, as an image.

use crate::plane::Plane;

/// Mean radiance of the pixels of a film, with what a lens that blurs needs beside it.
#[derive(Clone, Debug, PartialEq)]
pub struct MeanImage {
    /// Mean radiance [W/(m^2 sr)] per channel.
    pub radiance: Plane<[f32; 3]>,
    /// First moments of the radiance in the pixels, to the right and down
    /// ([`PixelSums::mean_moments`](crate::PixelSums::mean_moments)), if they are known.
    pub moments: Option<[Plane<[f32; 3]>; 2]>,
    /// Are the samples of a pixel spread over its neighbours ([`Self::SPREAD`])?
    pub is_spread: bool,
}

impl From<Plane<[f32; 3]>> for MeanImage {
    fn from(radiance: Plane<[f32; 3]>) -> Self {
        Self { radiance, moments: None, is_spread: false }
    }
}

impl MeanImage {
    /// Width \[pixels\] of the box over which the samples of a pixel are spread beyond it, for a lens that is not much sharper than
    /// the pixels.
    ///
    /// The place of a sample is uniform in its pixel plus uniform in this box. The radiance and its first moments then determine the
    /// image of a lens within 1 % up to the Nyquist frequency, and within 5 % above, where the means of pixels alone cannot tell the
    /// frequencies apart. A wider box leaves less noise for the lens to remove; a narrower one passes more above the Nyquist
    /// frequency (`docs/lens.md`).
    pub const SPREAD: f32 = 0.55;

    /// A mean without moments, of samples that are spread or not.
    pub fn without_moments(radiance: Plane<[f32; 3]>, is_spread: bool) -> Self {
        Self { radiance, moments: None, is_spread }
    }

    /// Width and height \[pixels\].
    pub fn size(&self) -> [u32; 2] {
        [self.radiance.width(), self.radiance.height()]
    }

    /// The image whose planes a linear function gives, one by one.
    pub fn map(&self, f: impl Fn(&Plane<[f32; 3]>) -> Plane<[f32; 3]>) -> Self {
        let moments = self.moments.as_ref().map(|axes| axes.each_ref().map(&f));
        Self { radiance: f(&self.radiance), moments, is_spread: self.is_spread }
    }
}
