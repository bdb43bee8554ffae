//! A sampled direction and its lobe.

use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;
use std::ops::BitOr;

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// The sampled direction, a unit vector away from the surface.
    pub wi: LocalDir,
    /// `eval / pdf`; for a delta lobe its coefficient over the probability of taking it. Never black.
    pub weight: Rgb,
    /// Density per unit solid angle [1/sr]; for a delta lobe the discrete probability of taking it.
    pub pdf: f32,
    /// The lobe from which the direction was drawn.
    pub lobe: Lobe,
    /// Index of refraction on the side of `wi` over that on the side of `wo`; 1 unless the light was refracted.
    ///
    /// The weight of a refraction contains the factor `1 / eta^2` by which radiance changes. Roulette should divide it
    /// out.
    pub eta: f32,
}

/// A set of properties of a scattering event.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lobe(u8);

impl Lobe {
    /// Diffuse or sheen reflection.
    pub const DIFFUSE: Self = Self(1);
    /// A rough specular lobe.
    pub const GLOSSY: Self = Self(2);
    /// A single direction: it has no density, and `eval` excludes it.
    pub const DELTA: Self = Self(4);
    /// `wi` and `wo` lie on the same side.
    pub const REFLECTION: Self = Self(8);
    /// `wi` and `wo` lie on different sides.
    pub const TRANSMISSION: Self = Self(16);
    /// The clear coat on top of the principled surface.
    pub const CLEARCOAT: Self = Self(32);

    /// True if all properties of `other` are present.
    #[inline]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl Lobe {
    /// The properties as a number, a bit for each.
    #[inline]
    pub const fn bits(self) -> u32 {
        self.0 as u32
    }

    /// The inverse of [`Self::bits`].
    #[inline]
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits as u8)
    }
}

impl BitOr for Lobe {
    type Output = Self;
    #[inline]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}
